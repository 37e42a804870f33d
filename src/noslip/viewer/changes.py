"""What a person does to a motion: asks for another goal, or pushes the tool while it runs."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from noslip import _arguments
from noslip._typing import Floats
from noslip.boundary import Boundary
from noslip.constraints.check import residual_text
from noslip.control import Controller
from noslip.errors import NoslipError
from noslip.primitive import ConstrainedDMP
from noslip.projection.metric import inverse_metric
from noslip.rule import Rule
from noslip.runtime.motion import Motion
from noslip.runtime.state import State

COARSE_SAMPLES, COARSE_STEPS = 61, 200
"""Of an adaptation while a goal is dragged, and of its rollout: few, so that the drag is
followed."""
METRICS = ("as learned", "position", "shared")
"""What the dropdown offers: the primitive's own, or one of those known by name."""
MOST_STEPS_AT_ONCE = 200
"""Of a pushed motion between two frames: what takes longer runs slower than the clock, instead of
holding the page up."""


@dataclass(frozen=True, eq=False)
class Wish:
    """What is asked of a primitive; what is None stays as it is.  The duration is in seconds."""

    goal: Boundary = field(default_factory=lambda: Boundary(1.0))
    start: Boundary = field(default_factory=lambda: Boundary(0.0))
    duration: float | None = None
    metric: str = METRICS[0]


@dataclass(frozen=True, eq=False)
class Adapted:
    """What became of a wish: a primitive and its motion, or None and a message that says why.

    Attributes
    ----------
    residual, goal_error : float
        Largest of the motion, in the constraints' units; from the goal to where the motion ends
        (m).  Both nan without one.
    milliseconds : float
        That it took.
    message : str
        Why there is none, or what gives way.
    """

    primitive: ConstrainedDMP | None
    motion: Motion | None
    residual: float
    goal_error: float
    milliseconds: float
    message: str = ""

    def __str__(self) -> str:
        if self.primitive is None:
            return f"no such motion: {self.message}"
        text = (
            f"residual {residual_text(self.residual, '1', order='at most')}, ends "
            f"{1e3 * self.goal_error:.2g} mm from the goal, {self.milliseconds:.0f} ms"
        )
        (record,) = self.primitive.record[:1] or (None,)
        if record is not None and record.maneuver:
            text = f"{record.maneuver}: {text}"
        return f"{text}; {self.message}" if self.message else text


class Adapter:
    """Adapts one primitive to wishes, one after the other, fast enough to follow a drag."""

    def __init__(self, primitive: ConstrainedDMP) -> None:
        self.primitive = primitive
        self._by_metric: dict[str, ConstrainedDMP] = {METRICS[0]: primitive}

    def __call__(self, wish: Wish, *, coarse: bool = False) -> Adapted:
        """Adapt to a wish and roll out; what fails is told, not raised.

        A coarse motion, for every moment of a drag, has fewer samples; constraints hold as exactly.
        """
        began = time.perf_counter()
        try:
            dmp = self._adapted(wish, coarse)
            motion = dmp.rollout(time_step=dmp.duration / COARSE_STEPS if coarse else None)
        except (NoslipError, ArithmeticError) as error:
            passed = 1e3 * (time.perf_counter() - began)
            return Adapted(None, None, np.nan, np.nan, passed, str(error) or type(error).__name__)
        own = self.primitive.goal_position, self.primitive.goal_rotation
        goal, _ = wish.goal.pose_or(*own)
        return Adapted(
            dmp,
            motion,
            float(np.abs(motion.constraint_residuals).max(initial=0.0)),
            float(np.linalg.norm(motion.positions[-1] - goal)),
            1e3 * (time.perf_counter() - began),
            "; ".join(
                f"{limit.name} gives way by up to {limit.violation:.2g} at {limit.time:.2g} s"
                for limit in motion.gave_way
            ),
        )

    def _adapted(self, wish: Wish, coarse: bool) -> ConstrainedDMP:
        dmp = self._with_metric(wish.metric)
        if wish.goal.is_free and wish.start.is_free and wish.duration is None:
            return dmp
        return dmp.adapt(
            goal_position=wish.goal.position,
            goal_rotation=wish.goal.rotation,
            start_position=wish.start.position,
            start_rotation=wish.start.rotation,
            duration=wish.duration,
            samples=COARSE_SAMPLES if coarse else None,
        )

    def _with_metric(self, metric: str) -> ConstrainedDMP:
        if metric not in self._by_metric:
            dmp = self.primitive
            length = dmp.regular.rollout().path_length
            chosen = inverse_metric(dmp.system, metric, None, length)  # type: ignore[arg-type]
            rates = dmp.rule.stabilization, dmp.rule.barrier_rate
            rule = Rule(dmp.system, chosen, stabilization=rates[0], barrier_rate=rates[1])
            self._by_metric[metric] = replace(dmp, rule=rule)
        return self._by_metric[metric]


class PushedRun:
    """A primitive in its control loop, pushed off its path now and then.

    A hand holds the tool where it was pushed to until the controller leads on from there, or for
    half of the duration.  All ``states`` so far are kept; the first is where it begins.
    """

    def __init__(self, dmp: ConstrainedDMP) -> None:
        self.dmp = dmp
        self.controller = Controller(dmp, time_step=dmp.duration / dmp.steps, follows=True)
        self.states: list[State] = [self.controller.reset()]
        self._held: State | None = None
        self._plans, self._let_go = 0, 0.0

    @property
    def done(self) -> bool:
        """Whether the motion has come to its end."""
        return bool(self.controller.done)

    def push(self, by: ArrayLike) -> None:
        """Displace the tool (m, world frame) before the next step."""
        tool = self._held or self.states[-1]
        self._held = replace(tool, position=tool.position + _arguments.vector("push", by))
        self._plans = len(self.controller.replanned)
        self._let_go = self.states[-1].time + self.dmp.duration / 2

    def advance(self, until: float) -> None:
        """Run the loop up to a time (s) since it began, or to its end.

        What is measured is where the tool was sent, or where it is held.
        """
        until += self.states[0].time
        for _ in range(MOST_STEPS_AT_ONCE):
            now = self.states[-1]
            if self.done or now.time >= until:
                return
            self.states.append(self.controller.step(self._held or now))
            if len(self.controller.replanned) > self._plans or now.time > self._let_go:
                self._held = None

    @property
    def clock(self) -> float:
        """Time (s) since it began."""
        return self.states[-1].time - self.states[0].time

    @property
    def residual(self) -> float:
        """Largest so far, in the constraints' units."""
        sizes = [np.abs(state.constraint_residuals).max(initial=0.0) for state in self.states]
        return float(max(sizes))

    @property
    def path(self) -> Floats:
        """Positions so far (m), shape (N, 3); a push is a jump."""
        return np.array([state.position for state in self.states])

    def off(self, path: Floats) -> float:
        """Distance from where the tool is to the nearest point (m) of a path, shape (N, 3)."""
        tool = self._held or self.states[-1]
        return float(np.linalg.norm(path - tool.position, axis=1).min())

    @property
    def goal_error(self) -> float:
        """Distance from where the tool is to the goal (m)."""
        return float(np.linalg.norm(self.states[-1].position - self.dmp.goal_position))
