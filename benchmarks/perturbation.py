"""Pushes on the way: how often the goal is reached all the same, by noslip and as published.

Each case pushes the tool once, at a random time, by 1 to 20 % of the path: half of the cases
sideways, where the blade must not go, half in any direction.  A hand holds the tool there until
noslip's controller, which follows it, leads on by a new plan; the published method goes on from the
pushed position at once: in all cases by its trained coupling term, in every seventh by its
optimization at each step.  It is given the time that the controller took, if that is more than its
own: beyond its end it goes on without force, and counts as where it comes nearest to the goal from
its end on.

Recordings are played in one second, the paper's tau: its loss adds accelerations to angles, and
over their own four to six seconds its blade spins.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks import paper_method
from benchmarks.example import (
    ALPHA,
    ALPHA_S,
    BASIS_FUNCTIONS,
    BETA,
    DURATION,
    demonstration,
)
from noslip import Blade, PoseTrajectory, learn, load_demonstrations, prepare
from noslip.merit import figures_of_merit

Floats = NDArray[np.float64]

CASES = 200
OPTIMIZED_EVERY = 7
"""Case in which the published method optimizes too: BFGS at each step takes up to 5 s a case, all
else together a tenth of one.  Motions and kinds of push stay in proportion."""
SEED = 20
RECORDINGS = Path(__file__).resolve().parents[2] / "shared" / "data" / "contour_following"
RECORDED = ("a_1", "c_1")
"""Contour runs in two placements."""
SMALLEST, LARGEST = 0.01, 0.2
"""Of the path's length."""
EARLIEST, LATEST = 0.02, 0.98
"""Fractions of the motion."""
REACHED = 0.01
"""Of the path's length: the goal counts as reached."""
LONGEST = 4.0
"""Durations after which a controller that is not done is stopped."""

HELD = 0.5
"""Durations after which a hand lets go that is not followed: it led the tool along its path, or
hardly aside."""

NOT_PUSHED, SIDEWAYS, ANYWHERE = "not pushed", "pushed sideways", "pushed in any direction"
NOSLIP, OPTIMIZED, COUPLED = "noslip", "paper, BFGS at each step", "paper, coupling term alone"


@dataclass(frozen=True, eq=False)
class Push:
    """One case.

    Attributes
    ----------
    motion, kind : str
        Sideways is along the tool's y axis.
    at : float
        When, as a fraction of the duration.
    size : float
        Over the path's length.
    direction : array, shape (3,)
        Unit vector; of a sideways push only the sign of its first number counts.
    """

    motion: str
    kind: str
    at: float
    size: float
    direction: Floats

    def shift(self, rotation: Rotation, path_length: float) -> Floats:
        """Displacement (m) of a tool in this orientation."""
        direction = self.direction
        if self.kind == SIDEWAYS:
            direction = np.sign(direction[0]) * rotation.apply([0.0, 1.0, 0.0])
        return np.asarray(self.size * path_length * direction)


@dataclass(frozen=True)
class Recovery:
    """How one method came out of one push.

    Attributes
    ----------
    method, motion, kind : str
    at, size : float
        When (fraction of the duration) and how far (over the path's length) it was pushed.
    error : float
        Distance from the goal over the path's length; at the end, or, of the published method, the
        least from its end on.
    residual : float
        Largest slip after the push (m/s).
    angular_speed : float
        Largest after the push (rad/s).
    duration : float
        Over the duration without a push.
    """

    method: str
    motion: str
    kind: str
    at: float
    size: float
    error: float
    residual: float
    angular_speed: float
    duration: float


@dataclass(frozen=True)
class Summary:
    """What comes of several recoveries.

    Attributes
    ----------
    method, cases : str
    count : int
    reached : float
        Share of the cases that end within 1 % of the path from the goal.
    median, percentile_95, worst : float
        Error at the end, over the path's length.
    residual : float
        Largest slip after a push (m/s).
    angular_speed : float
        Median of the largest after the push (rad/s).
    duration : float
        Median, over that without a push.
    """

    method: str
    cases: str
    count: int
    reached: float
    median: float
    percentile_95: float
    worst: float
    residual: float
    angular_speed: float
    duration: float

    @classmethod
    def of(cls, method: str, cases: str, recoveries: Iterable[Recovery]) -> Summary:
        found = list(recoveries)
        errors = np.array([r.error for r in found])
        return cls(
            method,
            cases,
            len(found),
            float(np.mean(errors <= REACHED)),
            *(float(x) for x in np.percentile(errors, [50, 95, 100])),
            residual=max(r.residual for r in found),
            angular_speed=float(np.median([r.angular_speed for r in found])),
            duration=float(np.median([r.duration for r in found])),
        )


def summaries(recoveries: Sequence[Recovery]) -> list[Summary]:
    """Summarise what was not pushed, all pushes, each kind of them, and each motion's."""
    pushed = [r for r in recoveries if r.kind != NOT_PUSHED]
    groups = {NOT_PUSHED: [r for r in recoveries if r.kind == NOT_PUSHED], "all pushes": pushed}
    for kind in (SIDEWAYS, ANYWHERE):
        groups[kind] = [r for r in pushed if r.kind == kind]
    for motion in dict.fromkeys(r.motion for r in pushed):
        groups[motion] = [r for r in pushed if r.motion == motion]
    return [
        Summary.of(method, name, (r for r in group if r.method == method))
        for name, group in groups.items()
        for method in dict.fromkeys(r.method for r in group)
    ]


def perturb(
    *,
    samples: int,
    cases: int = CASES,
    basis_functions: int = BASIS_FUNCTIONS,
    optimized_every: int = OPTIMIZED_EVERY,
    recordings: Path = RECORDINGS,
    progress: Callable[[str], None] = lambda message: None,
) -> list[Recovery]:
    """Push all methods in the same way; without the recordings only the numerical example."""
    given = {"numerical example": demonstration(samples)}
    if recordings.is_dir():
        given |= {f"contour {name}": _recorded(recordings, name) for name in RECORDED}
    motions = {name: _Motion(name, motion, basis_functions) for name, motion in given.items()}
    none = [Push(name, NOT_PUSHED, 0.0, 0.0, np.zeros(3)) for name in motions]
    recoveries = []
    for index, push in enumerate([*none, *pushes(cases, list(motions))]):
        progress(f"pushes: {index + 1}/{cases + len(none)}")
        # Those that are not pushed come first, one a motion.
        optimized = index < len(none) or (index - len(none)) % optimized_every == 0
        recoveries += motions[push.motion].recoveries(push, optimized)
    return recoveries


def pushes(cases: int, motions: Sequence[str]) -> list[Push]:
    """Return pushes, the motions in turn, every other one of a motion sideways."""
    random = np.random.default_rng(SEED)
    directions = random.normal(size=(cases, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return [
        Push(
            motions[k % len(motions)],
            (SIDEWAYS, ANYWHERE)[k // len(motions) % 2],
            float(random.uniform(EARLIEST, LATEST)),
            float(random.uniform(SMALLEST, LARGEST)),
            directions[k],
        )
        for k in range(cases)
    ]


def _recorded(folder: Path, name: str) -> PoseTrajectory:
    (recording,) = load_demonstrations(folder / f"data_demo_{name}.csv")
    own = prepare(recording, trim_speed=0.05, rate=120, lowpass=4.8)
    times = np.linspace(0.0, DURATION, len(own))
    return PoseTrajectory(times, own.positions, own.rotations, name=name)


class _Motion:
    """One demonstration as all methods learned it."""

    def __init__(self, name: str, given: PoseTrajectory, basis_functions: int) -> None:
        self.name, self.given = name, given
        self.steps = len(given) - 1
        self.time_step = given.duration / self.steps
        self.dmp = learn(
            given, Blade(), basis_functions=basis_functions, alpha=ALPHA, beta=BETA, alpha_s=ALPHA_S
        )
        self.controller = self.dmp.controller(time_step=self.time_step, follows=True)
        primitives = paper_method.UncoupledPrimitives.fit(given, basis_functions)
        optimized = paper_method.Stepping(primitives)
        self.published = {OPTIMIZED: (optimized, self._walked(optimized))}
        turning = np.array([state.w for state in self.published[OPTIMIZED][1][1:]])
        coupled = paper_method.Stepping(primitives, turning=turning)
        self.published[COUPLED] = coupled, self._walked(coupled)

    def recoveries(self, push: Push, optimized: bool = True) -> list[Recovery]:
        """Push every method; the one that optimizes at each step only if told to."""
        before = round(push.at * self.steps)
        own, held = self._controlled(push, before)
        steps = before + held + len(own) - 1
        to_goal = own.positions[-1:] - self.dmp.goal_position
        found = [self._recovery(NOSLIP, push, own, to_goal, held * self.time_step)]
        for method in self.published:
            if method == OPTIMIZED and not optimized:
                continue
            after = self._continued(method, push, before, max(steps, self.steps))
            to_goal = after.positions[self.steps - before :] - self.given.positions[-1]
            found.append(self._recovery(method, push, after, to_goal))
        return found

    def _controlled(self, push: Push, before: int) -> tuple[PoseTrajectory, int]:
        """Return the controller's motion after the push, and how many steps the tool was held."""
        controller = self.controller
        state = controller.reset()
        for _ in range(before):
            state = controller.step(state)
        shift = push.shift(state.rotation, self.given.path_length)
        held, pushed = 0, replace(state, position=state.position + shift)
        # The hand lets go where the controller leads on, or some time later.
        while push.size and not controller.replanned and held < HELD * self.steps:
            state = controller.step(pushed)
            held += 1
        states, most = [state], round(LONGEST * self.steps) - before - held
        while not controller.done and len(states) <= most:
            states.append(controller.step(states[-1]))
        motion = PoseTrajectory(
            self.time_step * np.arange(len(states)),
            np.array([s.position for s in states]),
            Rotation.concatenate([s.rotation for s in states]),
            name="noslip",
        )
        return motion, held

    def _continued(self, method: str, push: Push, before: int, steps: int) -> PoseTrajectory:
        """Return the published method's motion after the push."""
        stepping, undisturbed = self.published[method]
        state = undisturbed[before]
        turn = Rotation.from_quat(state.turn, scalar_first=True)
        shift = push.shift(turn, self.given.path_length)
        states = [replace(state, position=state.position + shift)]
        while before + len(states) <= steps:
            states.append(stepping.step(states[-1]))
        return stepping.motion(states)

    def _recovery(
        self,
        method: str,
        push: Push,
        after: PoseTrajectory,
        to_goal: Floats,
        waited: float = 0.0,
    ) -> Recovery:
        missed = np.linalg.norm(to_goal, axis=1).min() / self.given.path_length
        merit = figures_of_merit(after, after, Blade())
        return Recovery(
            method,
            self.name,
            push.kind,
            push.at,
            push.size,
            float(missed),
            merit.residual_peak,
            merit.angular_speed_peak,
            round(push.at * self.steps) / self.steps
            + (waited + after.duration) / self.given.duration,
        )

    def _walked(self, stepping: paper_method.Stepping) -> list[paper_method.PaperState]:
        states = [stepping.start()]
        while len(states) <= self.steps:
            states.append(stepping.step(states[-1]))
        return states
