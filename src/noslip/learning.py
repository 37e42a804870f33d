"""Demonstrations and constraints -> a primitive that cannot break them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from noslip import _arguments
from noslip.constraints.declaration import Constraint
from noslip.constraints.system import ConstraintSystem, as_system
from noslip.primitives.pose import (
    MOST_BASIS_FUNCTIONS,
    PoseDMP,
    ProjectStart,
    State,
    as_demonstrations,
    default_steps,
    evenly_sampled,
)
from noslip.primitives.stepping import Stepper
from noslip.projection.feasibility import project_pose, require_consistent
from noslip.projection.metric import Metric, inverse_metric
from noslip.projection.pointwise import POSITION_ONLY, coupling, project_velocities
from noslip.projection.trajectory import (
    POSITION_SMOOTHING,
    POSITION_WEIGHT,
    ROTATION_SMOOTHING,
    End,
    ProjectedTrajectory,
    project_trajectory,
)
from noslip.trajectory import PoseTrajectory

_NO_LEAD = 1e-9
STABILIZATION = 20.0
"""How fast a violation at the start decays, per duration."""
BARRIER_RATE = 300.0
"""How fast the margin of a limit may shrink that names no rate of its own, per duration."""


@dataclass(frozen=True)
class LearningRecord:
    """What the projection made of one demonstration.

    Attributes
    ----------
    demonstration : str
    samples, iterations, backing : int
        ``backing`` counts stretches in which the demonstration moves backwards (left so).
    residual : float
        Largest residual of the projected trajectory, in the constraints' units.
    position_change, rotation_change : float
        Rms over the samples, metres and radians.
    smoothing : float
        Rotation smoothing with which it converged.
    left_out : tuple of str
        Limits that the projection could not heed; they hold at run time alone.
    """

    demonstration: str
    samples: int
    iterations: int
    backing: int
    residual: float
    position_change: float
    rotation_change: float
    smoothing: float
    left_out: tuple[str, ...] = ()

    @classmethod
    def of(cls, demonstration: PoseTrajectory, projected: ProjectedTrajectory) -> LearningRecord:
        moved = projected.trajectory.positions - demonstration.positions
        return cls(
            demonstration.name,
            len(demonstration),
            projected.iterations,
            projected.backing,
            projected.residual,
            float(np.sqrt(np.mean(np.sum(moved**2, axis=1)))),
            float(np.sqrt(np.mean(np.sum(projected.turns**2, axis=1)))),
            projected.smoothing,
            projected.left_out,
        )


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ConstrainedDMP(PoseDMP):
    """A pose primitive with the Udwadia-Kalaba coupling term (the paper's eq. 19).

    Its rollouts satisfy the constraints at every step; with the orientation learned from the
    projected demonstrations, the coupling term has next to nothing to do.

    Attributes
    ----------
    constraints : tuple of Constraint
    regular : PoseDMP
        The paper's first comparison: fitted to the demonstrations as they are, no coupling.
    inverse_metric : tuple of 6 floats
        Diagonal of M^-1: who gives way at run time; position only by default, as in the paper.
    stabilization : float
        Rate at which a violation present at the start decays, per duration.
    barrier_rate : float
        Rate at which the margins of limits may shrink that name none of their own, per duration.
    record : tuple of LearningRecord
    projected_step : float or None
        Step of the projected demonstrations, as a fraction of the duration.
    """

    constraints: tuple[Constraint, ...]
    regular: PoseDMP
    inverse_metric: tuple[float, ...] = POSITION_ONLY
    stabilization: float = STABILIZATION
    barrier_rate: float = BARRIER_RATE
    record: tuple[LearningRecord, ...] = ()
    projected_step: float | None = None

    @cached_property
    def system(self) -> ConstraintSystem:
        """The constraints, stacked."""
        return ConstraintSystem(self.constraints)

    @cached_property
    def constrained(self) -> ConstrainedDMP:
        """The paper's second comparison: coupled, with the orientation as demonstrated."""
        return replace(
            self,
            position=self.regular.position,
            orientation=self.regular.orientation,
            projected_step=None,
        )

    def _admissible(self, state: State, project: ProjectStart) -> State:
        """Return the state with its velocities, or its pose too, projected onto the constraints."""
        if not self.system.size:
            return state
        position, quaternion = state.position, state.rotation.as_quat(scalar_first=True)
        if project == "pose":
            position, quaternion = project_pose(
                self.system, 0.0, position, quaternion, inverse_metric=self.inverse_metric
            )
        equalities, limits = self.system.equalities, self.system.limits
        linear, angular = state.linear_velocity, state.angular_velocity
        if project == "nothing":
            residuals = equalities.instant(0.0, position, quaternion, linear, angular)[0]
        else:
            linear, angular, residuals = project_velocities(
                self.system,
                0.0,
                position,
                quaternion,
                linear,
                angular,
                inverse_metric=self.inverse_metric,
                residual_rate=state.pull_in,
            )
        margins = limits.residuals(0.0, position, quaternion, linear, angular)[0]
        return replace(
            state,
            position=position,
            rotation=Rotation.from_quat(quaternion, scalar_first=True),
            linear_velocity=linear,
            angular_velocity=angular,
            constraint_residuals=residuals,
            multipliers=np.zeros(equalities.size),
            margins=margins,
            limit_multipliers=np.zeros(limits.size),
        )

    def save(self, path: str | Path) -> Path:
        """Write the primitive as JSON; :func:`noslip.load_primitive` reads it back.

        The motion of what is read back is the same to the last bit.
        """
        from noslip.saving import save_primitive

        return save_primitive(self, path)

    @cached_property
    def _stepper(self) -> Stepper:
        if not self.system.size:
            return super()._stepper
        return Stepper(coupling(self.system, inverse_metric=self.inverse_metric), self.system.size)

    def _rotation_lead(self, step_fraction: float) -> float:
        # A velocity constraint ties the rotation at the end of a step to the chord of the step,
        # that is, to the motion half a step earlier.  What was learned from steps of one length is
        # half the difference early or late in steps of another.
        at_velocity = self.system.equalities.row_is_velocity.any()
        if self.projected_step is None or not at_velocity:
            return 0.0
        lead = (self.projected_step - step_fraction) / 2
        return lead if abs(lead) > _NO_LEAD else 0.0

    @property
    def _residual_rate(self) -> float:
        return self.stabilization

    @property
    def _barrier_rate(self) -> float:
        return self.barrier_rate

    @property
    def _constraint_names(self) -> tuple[str, ...]:
        return tuple(self.system.equalities.row_names)

    @property
    def _limit_names(self) -> tuple[str, ...]:
        return tuple(self.system.limits.row_names)


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
    position_weight: float = POSITION_WEIGHT,
    position_smoothing: float = POSITION_SMOOTHING,
    rotation_smoothing: float = ROTATION_SMOOTHING,
    metric: Metric | None = None,
    metric_length: float | None = None,
    stabilization: float = STABILIZATION,
    barrier_rate: float = BARRIER_RATE,
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
        As for :meth:`PoseDMP.fit`.
    hold_position : bool
        Project by the orientation alone, as in the paper.  By default the position gives way too,
        by a fraction of a thousandth of the path, which spares the tool sharp turns.
    start, end : "free", "position", "rotation" or "pose"
        What of the demonstrations' first and last sample the projection must keep.
    position_weight, position_smoothing, rotation_smoothing : float
        See :func:`noslip.project_trajectory`.
    metric : "position", "rotation", "shared" or 6 positive weights, optional
        Who gives way at run time: M of Gauss's principle, see :mod:`noslip.projection.metric`.  By
        default the position, as in the paper, where that can hold every constraint and no limit is
        about turning; else both.
    metric_length : float, optional
        Metres that weigh as much as a radian; by default the length of a mean step.
    stabilization : float
        Rate at which a violation present at the start decays, per duration.
    barrier_rate : float
        Rate at which the margins of limits may shrink that name none of their own, per duration.
    progress : callable, optional
        Called with (demonstrations done, all) after each projection.

    Raises
    ------
    InputError, ConstraintError
        If demonstrations or constraints are not what they must be.
    ConvergenceError
        If a projection does not converge; the message says what to change.
    """
    recorded = as_demonstrations(demonstrations)
    system = as_system(constraints)
    length = recorded[0].path_length / default_steps(recorded[0])
    chosen = inverse_metric(system, metric, metric_length, length)
    barrier_rate = _arguments.positive("barrier_rate", barrier_rate)
    stabilization = _arguments.not_negative("stabilization", stabilization)
    basis_functions = _arguments.count("basis_functions", basis_functions, MOST_BASIS_FUNCTIONS)
    for demonstration in recorded:
        require_consistent(system, demonstration)
    projected, record = [], []
    sampled = [evenly_sampled(d, basis_functions) for d in recorded]
    for index, demonstration in enumerate(sampled):
        if system.size:
            result = _projected(
                demonstration,
                system,
                hold_position=hold_position,
                start=start,
                end=end,
                position_weight=position_weight,
                position_smoothing=position_smoothing,
                rotation_smoothing=rotation_smoothing,
            )
            record.append(LearningRecord.of(demonstration, result))
            projected.append(result.trajectory)
        if progress is not None:
            progress(index + 1, len(recorded))
    constants = {"alpha": alpha, "beta": beta, "alpha_s": alpha_s, "ridge": ridge}
    regular = replace(
        PoseDMP.fit(sampled, basis_functions=basis_functions, **constants),
        steps=default_steps(recorded[0]),
    )
    fitted = regular
    if projected:
        fitted = PoseDMP.fit(projected, basis_functions=basis_functions, **constants)
    return ConstrainedDMP(
        position=fitted.position,
        orientation=fitted.orientation,
        phase=regular.phase,
        duration=regular.duration,
        steps=regular.steps,
        constraints=system.constraints,
        regular=regular,
        inverse_metric=chosen,
        stabilization=stabilization,
        barrier_rate=barrier_rate,
        record=tuple(record),
        projected_step=(
            float(np.mean([1 / (len(d) - 1) for d in projected])) if projected else None
        ),
    )


def _projected(
    demonstration: PoseTrajectory, system: ConstraintSystem, **options: Any
) -> ProjectedTrajectory:
    """Project a demonstration; limits that it cannot heed are left to the run time."""
    if system.limits.size:
        result = project_trajectory(demonstration, system, **options, on_failure="return")
        if result.converged:
            return result
    result = project_trajectory(demonstration, system.equalities, **options)
    return replace(result, left_out=system.limits.names)
