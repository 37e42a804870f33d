"""What is compared, on which motion, and what the ratios should be."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from benchmarks import paper_method, peers
from benchmarks.example import (
    ALPHA,
    ALPHA_S,
    BASIS_FUNCTIONS,
    BETA,
    MOVED_GOAL,
    demonstration,
)
from benchmarks.timing import Candidate, Timing, forget, measure
from noslip import Blade, ConstrainedDMP, PoseTrajectory, State, learn
from noslip.adapting import REPLANNED_SAMPLES
from noslip.constraints import Box
from noslip.constraints.system import ConstraintSystem
from noslip.merit import FiguresOfMerit, figures_of_merit

PUSHED_AT, PUSH = 0.4, 0.05
"""When the motion is pushed sideways to be re-planned, and how far: fractions of its duration and
of its path."""

PAPER, PEER, OURS = "the paper's method", "movement-primitives", "noslip"

WARM_UP_SAMPLES = 30
"""The paper's method takes seconds; a coarse run warms up as well."""


@dataclass(frozen=True)
class Ratio:
    """How many times faster noslip is at one thing.

    Attributes
    ----------
    name : str
    value : float or None
        Median of the other over median of noslip; None if the other was not measured.
    target : float
    of_lowest : float or None
        The same of the lowest times, which a busy machine disturbs least.
    """

    name: str
    value: float | None
    target: float
    of_lowest: float | None

    @property
    def met(self) -> bool | None:
        """Whether this run reaches the target."""
        return None if self.value is None else self.value >= self.target


@dataclass(frozen=True)
class StepCost:
    """What a step costs within a rollout, everything that the rollout does shared out.

    Attributes
    ----------
    name : str
    seconds : float
        Median.
    target : float
        Of the machine that the project's targets were set for.
    """

    name: str
    seconds: float
    target: float


@dataclass(frozen=True)
class Comparison:
    """Result of the comparison on one demonstration."""

    samples: int
    basis_functions: int
    timings: Mapping[str, Timing]
    merits: Mapping[str, FiguresOfMerit]
    ratios: tuple[Ratio, ...]
    step_costs: tuple[StepCost, ...]
    paper_evaluations: int
    paper_unconverged: int


RATIOS = (
    ("learn with projection, against all of the paper's method", "paper", "learn", 80.0),
    ("constrained rollout, against movement-primitives' unconstrained one", "open_loop",
     "rollout", 25.0),
    ("learn with projection, against movement-primitives' imitate", "imitate", "learn", 1.0),
    ("adapt to a moved goal, against all of the paper's method", "paper", "adapt", 40.0),
    ("replan after a push, against all of the paper's method", "paper", "replan", 195.0),
)  # fmt: skip
"""(name, slow, fast, target)

The last two are 120 ms and 25 ms where the paper's method takes 4.9 s.
"""

STEP_COSTS = (
    ("blade, the position gives way", "rollout", 8e-6),
    ("blade, position and rotation share", "rollout_shared", 8e-6),
    ("blade and six barrier rows, the position gives way", "rollout_limits", 60e-6),
    ("blade and six barrier rows, both share", "rollout_limits_shared", 60e-6),
)
"""(name, rollout, target)"""

CORNER = Box(lower=(0.2, 0.2, -0.1), upper=(0.8, 0.8, 0.1))
"""The path begins outside of it, and leaves it again: limits are active most of the time."""


def compare(
    *,
    samples: int,
    rounds: int,
    basis_functions: int = BASIS_FUNCTIONS,
    repeat_fast: int = 20,
    progress: Callable[[str], None] = lambda message: None,
) -> Comparison:
    """Time everything on the numerical example and judge each method's motion."""
    given = demonstration(samples)
    progress("preparing")
    ours = _learn(given, basis_functions)
    held = _learn(given, basis_functions, hold_position=True)
    candidates = [
        _paper(given, basis_functions),
        *_library(given, basis_functions, repeat_fast),
        *_noslip(given, basis_functions, ours, repeat_fast),
    ]
    timings = measure(candidates, rounds, progress)

    progress("figures of merit")
    paper = paper_method.run(given, basis_functions)
    motions = {
        "demonstration": given,
        PAPER: paper.motion,
        OURS: _rollout(ours, given),
        f"{OURS}, position held": _rollout(held, given),
        f"{OURS}, unconstrained": _rollout(ours.regular, given),
    }
    if not peers.MISSING:
        fitted = peers.fit(*peers.imitation(given), basis_functions)
        motions[f"{PEER}, unconstrained"] = peers.rollout(fitted)
    return Comparison(
        samples=samples,
        basis_functions=basis_functions,
        timings=timings,
        merits={name: figures_of_merit(motion, given, Blade()) for name, motion in motions.items()},
        ratios=tuple(
            Ratio(
                name,
                timings[slow].median / timings[fast].median if slow in timings else None,
                target,
                timings[slow].minimum / timings[fast].minimum if slow in timings else None,
            )
            for name, slow, fast, target in RATIOS
        ),
        step_costs=tuple(
            StepCost(name, timings[key].median / (samples - 1), target)
            for name, key, target in STEP_COSTS
        ),
        paper_evaluations=paper.evaluations,
        paper_unconverged=paper.unconverged,
    )


def _learn(
    given: PoseTrajectory, basis_functions: int, hold_position: bool = False
) -> ConstrainedDMP:
    return learn(
        given,
        Blade(),
        basis_functions=basis_functions,
        alpha=ALPHA,
        beta=BETA,
        alpha_s=ALPHA_S,
        hold_position=hold_position,
    )


def _rollout(dmp: ConstrainedDMP, given: PoseTrajectory) -> PoseTrajectory:
    """Roll out with the demonstration's own number of samples."""
    return dmp.rollout(time_step=given.duration / (len(given) - 1))


def pushed_state(dmp: ConstrainedDMP, given: PoseTrajectory) -> State:
    """Return a state on the way, pushed off its path across the blade."""
    state, time_step = dmp.initial_state(), given.duration / (len(given) - 1)
    for _ in range(round(PUSHED_AT * (len(given) - 1))):
        state = dmp.step(state, time_step)
    push = PUSH * given.path_length * state.rotation.apply([0.0, 1.0, 0.0])
    return replace(state, position=state.position + push)


class _Walk:
    """Single steps along the motion, each from where the last one led: none is a repetition."""

    def __init__(
        self, reset: Callable[[], Any], advance: Callable[[Any], Any], start: Callable[[], Any]
    ) -> None:
        self.reset, self.advance, self.start = reset, advance, start
        self.taken = 0
        self.state: Any = None

    def restart_at(self, most: int) -> Callable[[], None]:
        """Return what to do before a step: begin anew at the motion's start and end."""

        def before() -> None:
            if self.state is None or self.taken >= most:
                self.reset()
                self.state, self.taken = self.start(), 0

        return before

    def step(self) -> None:
        """Take the next step."""
        self.state = self.advance(self.state)
        self.taken += 1


def _paper(given: PoseTrajectory, basis_functions: int) -> Candidate:
    return Candidate(
        "paper",
        "all of it: fit, BFGS at each step, rollout",
        PAPER,
        lambda: paper_method.run(given, basis_functions),
        warm_up=lambda: paper_method.run(demonstration(WARM_UP_SAMPLES), basis_functions),
    )


def _library(given: PoseTrajectory, basis_functions: int, repeat_fast: int) -> list[Candidate]:
    if peers.MISSING:
        return []
    times, poses = peers.imitation(given)
    fitted = peers.fit(times, poses, basis_functions)
    walk = _Walk(fitted.reset, lambda state: fitted.step(*state), lambda: (poses[0], np.zeros(6)))
    few = max(1, repeat_fast // 4)
    return [
        Candidate(
            "imitate",
            "fit (imitate)",
            PEER,
            lambda: peers.fit(times, poses, basis_functions),
            per_round=few,
        ),
        Candidate(
            "open_loop",
            "rollout, unconstrained (open_loop)",
            PEER,
            fitted.open_loop,
            per_round=few,
        ),
        Candidate(
            "peer_step",
            "one step, unconstrained",
            PEER,
            walk.step,
            before=walk.restart_at(len(given) - 1),
            per_round=5 * repeat_fast,
        ),
    ]


def _noslip(
    given: PoseTrajectory, basis_functions: int, ours: ConstrainedDMP, repeat_fast: int
) -> list[Candidate]:
    fresh: list[ConstrainedDMP] = []

    def renew() -> None:
        fresh[:] = [_learn(given, basis_functions)]
        forget()

    time_step = given.duration / (len(given) - 1)
    regular = ours.regular
    shared = learn(given, Blade(), basis_functions=basis_functions, metric="shared")
    # Run-time limits alone: the primitive itself goes on pressing against them.
    limits = ConstraintSystem([Blade(), CORNER])
    limited = replace(ours, rule=replace(ours.rule, system=limits))
    limited_shared = replace(shared, rule=replace(shared.rule, system=limits))
    pushed = pushed_state(ours, given)
    walk = _Walk(lambda: None, lambda state: ours.step(state, time_step), ours.initial_state)
    few = max(1, repeat_fast // 4)
    return [
        Candidate(
            "fit",
            "fit, unconstrained (ConstrainedDMP.fit)",
            OURS,
            lambda: learn(
                given, basis_functions=basis_functions, alpha=ALPHA, beta=BETA, alpha_s=ALPHA_S
            ),
            before=forget,
            per_round=repeat_fast,
        ),
        Candidate(
            "learn",
            "learn with projection",
            OURS,
            lambda: _learn(given, basis_functions),
            before=forget,
            per_round=few,
        ),
        Candidate(
            "learn_held",
            "learn with projection, position held",
            OURS,
            lambda: _learn(given, basis_functions, hold_position=True),
            before=forget,
            per_round=few,
        ),
        Candidate(
            "adapt",
            "adapt to a moved goal",
            OURS,
            lambda: ours.adapt(goal_position=MOVED_GOAL),
            before=forget,
            per_round=few,
        ),
        Candidate(
            "replan",
            f"replan after a push, {REPLANNED_SAMPLES - 1} knots, repeated",
            OURS,
            lambda: ours.replan(pushed),
            per_round=few,
        ),
        Candidate(
            "replan_first",
            f"replan after a push, {REPLANNED_SAMPLES - 1} knots, first",
            OURS,
            lambda: ours.replan(pushed),
            before=forget,
            per_round=few,
        ),
        Candidate(
            "rollout",
            "rollout, constrained, repeated",
            OURS,
            lambda: ours.rollout(time_step=time_step),
            per_round=2 * repeat_fast,
        ),
        Candidate(
            "rollout_first",
            "rollout, constrained, first of a new primitive",
            OURS,
            lambda: fresh[0].rollout(time_step=time_step),
            before=renew,
            per_round=few,
        ),
        Candidate(
            "rollout_unconstrained",
            "rollout, unconstrained, repeated",
            OURS,
            lambda: regular.rollout(time_step=time_step),
            per_round=2 * repeat_fast,
        ),
        *(
            Candidate(
                key,
                f"rollout, constrained, {label}",
                OURS,
                partial(dmp.rollout, time_step=time_step),
                per_round=repeat_fast,
            )
            for key, label, dmp in (
                ("rollout_shared", "shared metric", shared),
                ("rollout_limits", "six barrier rows", limited),
                ("rollout_limits_shared", "six barrier rows, shared metric", limited_shared),
            )
        ),
        Candidate(
            "step",
            "one step, constrained",
            OURS,
            walk.step,
            before=walk.restart_at(len(given) - 1),
            per_round=5 * repeat_fast,
        ),
    ]
