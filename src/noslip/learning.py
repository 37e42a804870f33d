"""Demonstrations and constraints -> a primitive that cannot break them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import wraps
from typing import ParamSpec

import numpy as np

from noslip import _arguments
from noslip.boundary import Boundary, End
from noslip.constraints.declaration import Constraint
from noslip.constraints.system import ConstraintSystem, as_system
from noslip.demonstrations.agreement import require_agreement
from noslip.demonstrations.alignment import align as bring_into_step
from noslip.law.fitting import (
    MOST_BASIS_FUNCTIONS,
    as_demonstrations,
    default_steps,
    evenly_sampled,
    fit,
)
from noslip.law.law import Law
from noslip.law.layout import FORCE, STATE
from noslip.primitive import ConstrainedDMP
from noslip.projection.feasibility import require_consistent
from noslip.projection.metric import Metric, inverse_metric
from noslip.projection.pointwise import project_velocities
from noslip.projection.request import LEARNING, Request, Weights
from noslip.projection.trajectory import project_heeding_what_it_can
from noslip.provenance import LearningRecord, Origin
from noslip.rule import BARRIER_RATE, STABILIZATION, Rule
from noslip.scale import require_motion
from noslip.spread import Spread
from noslip.trajectory import PoseTrajectory

P = ParamSpec("P")


def _noted(learning: Callable[P, ConstrainedDMP]) -> Callable[P, ConstrainedDMP]:
    """Let what is learned hold the options that it was learned with."""

    @wraps(learning)
    def noted(*args: P.args, **options: P.kwargs) -> ConstrainedDMP:
        learned = learning(*args, **options)
        return replace(learned, history=(Origin.of("learn", learning, *args, **options),))

    return noted


@_noted
def learn(
    demonstrations: PoseTrajectory | Iterable[PoseTrajectory],
    constraints: ConstraintSystem | Constraint | Sequence[Constraint] = (),
    *,
    basis_functions: int = 100,
    alpha: float = 25.0,
    beta: float = 6.25,
    alpha_s: float = 1.0,
    ridge: float = 1e-6,
    hold_position: bool = False,
    start: End = "free",
    end: End = "free",
    position_weight: float = LEARNING.position,
    position_smoothing: float = LEARNING.position_smoothing,
    rotation_smoothing: float = LEARNING.rotation_smoothing,
    metric: Metric = "auto",
    metric_length: float | None = None,
    stabilization: float = STABILIZATION,
    barrier_rate: float = BARRIER_RATE,
    align: bool = False,
    project_start: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> ConstrainedDMP:
    """Learn a primitive from demonstrations that holds constraints exactly.

    Each demonstration is projected onto the constraints (the nearest trajectory that satisfies
    them), one primitive is fitted to all projected ones, and the Udwadia-Kalaba coupling term keeps
    its motion on the constraints at every step.

    Parameters
    ----------
    demonstrations : PoseTrajectory or several
        Any rate, any start time.
    constraints : Constraint or several
        Equalities, zero along the motion, and limits, not negative; none gives an ordinary pose
        primitive.
    basis_functions, alpha, beta, alpha_s, ridge
        As for :func:`noslip.law.fit`.
    hold_position : bool
        Project by the orientation alone, as in the paper.  By default the position gives way too,
        by a fraction of a thousandth of the path, which spares the tool sharp turns.
    start, end : "free", "position", "rotation" or "pose"
        What of the demonstrations' first and last sample the projection must keep.
    position_weight, position_smoothing, rotation_smoothing : float
        See :func:`noslip.project_trajectory`.
    metric : "auto", "position", "shared" or 6 positive weights
        Who gives way at run time: M of Gauss's principle, see :mod:`noslip.projection.metric`.
        "auto" is the position, as in the paper, where that can hold every constraint all along the
        demonstrations and no limit is about turning; else both.
    metric_length : float, optional
        Meters that weigh as much as a radian; by default the length of a mean step, twice the lever
        of a turn in it: with the lever itself, a tool turns 1.2 to 1.7 times as fast through a rest
        that its orientation was not made for, and is turned off its way round obstacles.
    stabilization : float
        Rate at which a violation present at the start decays, per duration.
    barrier_rate : float
        Rate at which the margins of limits may shrink that name none of their own, per duration.
    align : bool
        Bring several demonstrations into step first, see
        :func:`noslip.demonstrations.alignment.align`.
    project_start : bool
        Begin with the demonstrated velocity projected onto the constraints at the start (the
        paper's eq. 22), as a rollout does by itself; the unconstrained law then does too.
    progress : callable, optional
        Called with (demonstrations done, all) after each projection.

    Warns
    -----
    RecordingWarning
        If several demonstrations start apart or are out of step, so that their mean follows none,
        or one is hardly in seconds, meters and radians.

    Raises
    ------
    InputError, ConstraintError
        If demonstrations or constraints are not what they must be: a demonstration stands still or
        turns by more than a third of a turn between samples, or two run in opposite directions.
    ConvergenceError
        If a projection does not converge; the message says what to change.
    """
    recorded = as_demonstrations(demonstrations)
    for demonstration in recorded:
        require_motion(demonstration)
    require_agreement(recorded, aligned=align)
    system = as_system(constraints)
    if align:
        recorded = bring_into_step(recorded)
    mean_step = recorded[0].path_length / default_steps(recorded[0])

    def rule_along(demonstrations: Sequence[PoseTrajectory]) -> Rule:
        return Rule(
            system,
            inverse_metric(system, metric, metric_length, mean_step, demonstrations),
            stabilization=stabilization,
            barrier_rate=barrier_rate,
        )

    # What is out of range is refused before the projections take their time.
    rule_along(())
    basis_functions = _arguments.count("basis_functions", basis_functions, MOST_BASIS_FUNCTIONS)
    for demonstration in recorded:
        require_consistent(system, demonstration)
    weights = Weights(position_weight, position_smoothing, rotation_smoothing)
    projected, record = [], []
    sampled = [evenly_sampled(d, basis_functions) for d in recorded]
    for index, demonstration in enumerate(sampled):
        if system.size:
            ends = (
                Boundary.keeping(demonstration, 0.0, start),
                Boundary.keeping(demonstration, 1.0, end),
            )
            result = project_heeding_what_it_can(
                Request(demonstration, system, ends, weights, hold_position)
            )
            record.append(LearningRecord.of(demonstration, result))
            projected.append(result.trajectory)
        if progress is not None:
            progress(index + 1, len(recorded))
    constants = {"alpha": alpha, "beta": beta, "alpha_s": alpha_s, "ridge": ridge}
    demonstrated = fit(sampled, basis_functions=basis_functions, **constants)
    demonstrated = replace(demonstrated, steps=default_steps(recorded[0]))
    if project_start:
        demonstrated = _begun_on(demonstrated, system)
    law = demonstrated
    if projected:
        law = replace(
            fit(projected, basis_functions=basis_functions, **constants),
            duration=demonstrated.duration,
            steps=demonstrated.steps,
        )
        if project_start:
            law = _begun_on(law, system)
    spread = Spread.about(law, projected or sampled)
    return ConstrainedDMP(
        law, rule_along(projected or sampled), demonstrated, tuple(record), spread
    )


def _begun_on(law: Law, system: ConstraintSystem) -> Law:
    """Return a law whose start velocity satisfies the constraints: the paper's eq. 22."""
    start, velocity = law.start, law.start_velocity / law.duration
    linear, angular, _ = project_velocities(
        system,
        0.0,
        start[STATE["position"]],
        start[STATE["quaternion"]],
        velocity[FORCE["linear"]],
        velocity[FORCE["angular"]],
    )
    return replace(law, start_velocity=law.duration * np.concatenate([linear, angular]))
