"""Demonstrations and constraints -> a primitive that cannot break them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from noslip import _arguments, adapting
from noslip._typing import Floats
from noslip.boundary import Boundary, End
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
from noslip.primitives.scaling import Scaling, scaled_orientation, scaled_position
from noslip.primitives.stepping import Stepper
from noslip.projection.feasibility import project_pose, require_consistent
from noslip.projection.metric import Metric, inverse_metric
from noslip.projection.pointwise import POSITION_ONLY, coupling, project_velocities
from noslip.projection.request import ADAPTING, LEARNING, Request, Weights
from noslip.projection.result import ProjectedTrajectory
from noslip.projection.trajectory import project_heeding_what_it_can
from noslip.spread import Spread
from noslip.trajectory import PoseTrajectory

if TYPE_CHECKING:
    from noslip.runtime.batch import Motions
    from noslip.runtime.controller import Controller
    from noslip.runtime.export import Exported

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
        Rms over the samples, meters and radians.
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
            float(np.abs(projected.residuals[1:]).max(initial=0.0)),
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
    begin : float
        Time at its start (s), for constraints that depend on it; that of the state from which it
        was re-planned.
    spread : Spread or None
        How far the demonstrations lie apart, if there were several.
    """

    constraints: tuple[Constraint, ...]
    regular: PoseDMP
    inverse_metric: tuple[float, ...] = POSITION_ONLY
    stabilization: float = STABILIZATION
    barrier_rate: float = BARRIER_RATE
    record: tuple[LearningRecord, ...] = ()
    begin: float = 0.0
    spread: Spread | None = None

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
        )

    def _admissible(self, state: State, project: ProjectStart) -> State:
        """Return the state with its velocities, or its pose too, projected onto the constraints."""
        if not self.system.size:
            return state
        position, quaternion = state.position, state.quaternion
        if project == "pose":
            position, quaternion = project_pose(
                self.system, state.time, position, quaternion, inverse_metric=self.inverse_metric
            )
        equalities, limits = self.system.equalities, self.system.limits
        linear, angular = state.linear_velocity, state.angular_velocity
        if project == "nothing":
            residuals = equalities.instant(state.time, position, quaternion, linear, angular)[0]
        else:
            moving = np.concatenate([position, quaternion, linear, angular])
            linear, angular, residuals = _allowed_velocities(
                self.system, state.time, moving.tobytes(), self.inverse_metric, state.pull_in
            )
        margins = limits.residuals(state.time, position, quaternion, linear, angular)[0]
        return replace(
            state,
            position=position,
            rotation=quaternion,
            linear_velocity=linear,
            angular_velocity=angular,
            constraint_residuals=residuals,
            multipliers=np.zeros(equalities.size),
            margins=margins,
            limit_multipliers=np.zeros(limits.size),
        )

    # ---------------------------------------------------------------- new goals

    def adapt(
        self,
        *,
        goal_position: ArrayLike | None = None,
        goal_rotation: Rotation | None = None,
        goal_velocity: ArrayLike | None = None,
        start_position: ArrayLike | None = None,
        start_rotation: Rotation | None = None,
        start_velocity: ArrayLike | None = None,
        duration: float | None = None,
        via: Iterable[Boundary | Sequence[Any]] = (),
        scaling: Scaling = "none",
        start: End = "pose",
        end: End = "pose",
        samples: int | None = None,
        position_weight: float = ADAPTING.position,
        position_smoothing: float = ADAPTING.position_smoothing,
        rotation_smoothing: float = ADAPTING.rotation_smoothing,
    ) -> ConstrainedDMP:
        """Return a primitive that starts, passes and ends elsewhere, and keeps the constraints.

        The unconstrained primitive is rolled out, its motion moved to the new boundary values,
        projected onto the constraints with these values fixed, and fitted again.

        Parameters
        ----------
        goal_position, start_position : array, shape (3,), optional
            Meters; those of this primitive by default.
        goal_rotation, start_rotation : Rotation, optional
        goal_velocity, start_velocity : 0, array of shape (3,) or (6,), optional
            At rest (0), or linear velocity (m/s), then angular (rad/s), world frame; projected onto
            the constraints.  By default whatever suits the motion.
        duration : float, optional
            tau (s).
        via : sequence of (at, position), (at, position, rotation) or Boundary
            Points or poses to pass, at fractions of the duration.
        scaling : "none", "difference" or "rotation-dilation"
            How the path follows a new goal before it is projected, see
            :func:`noslip.primitives.scaling.scaled_position`.  Without scaling the displacement
            grows along the motion by minimum jerk.  Where the path turns, orientations that are
            not named turn along.
        start, end : "free", "position", "rotation" or "pose"
            What of the start and the goal is kept to; all of it by default.  What is not named in
            the call is that of this primitive.
        samples : int, optional
            Of the projection; by default one a step, from 5 a basis function up to 2001.
        position_weight, position_smoothing, rotation_smoothing : float
            Of the projection, see :func:`noslip.project_trajectory`.

        Raises
        ------
        InputError, ConstraintError
            If an argument is not what it must be, or no motion under the constraints can end there.
        ConvergenceError
            If the projection does not converge.
        """
        own, turned = self.position, self.orientation
        tau = self.duration
        if duration is not None:
            tau = _arguments.positive("duration", duration, "seconds")
        count = adapting.samples_of(self, samples)
        position, orientation = own, turned
        if scaling != "none":
            position = scaled_position(
                own, scaling, start_position=start_position, goal_position=goal_position
            )
            orientation = scaled_orientation(own, turned, position, scaling)
        first = adapting.placed(
            adapting.asked("start", start_position, start_rotation, start_velocity),
            (own.start, orientation.start),
            self.system,
            self.inverse_metric,
            self.begin,
        )
        last = adapting.placed(
            adapting.asked("goal", goal_position, goal_rotation, goal_velocity),
            (own.goal, orientation.goal),
            self.system,
            self.inverse_metric,
            self.begin + tau,
        )
        unconstrained = PoseDMP(position, orientation, self.phase, self.duration, self.steps)
        request = Request(
            unconstrained.rollout(duration=tau, time_step=tau / (count - 1)),
            self.system,
            (first.part(start), *Boundary.vias(via), last.part(end)),
            Weights(position_weight, position_smoothing, rotation_smoothing),
            begin=self.begin,
        )
        return self._of(adapting.adapt(unconstrained, request), tau, scaling)

    def replan(
        self,
        state: State,
        *,
        goal_position: ArrayLike | None = None,
        goal_rotation: Rotation | None = None,
        duration: float | None = None,
        end: End = "pose",
        samples: int = adapting.REPLANNED_SAMPLES,
        position_weight: float = ADAPTING.position,
        position_smoothing: float = ADAPTING.position_smoothing,
        rotation_smoothing: float = ADAPTING.rotation_smoothing,
    ) -> ConstrainedDMP:
        """Return a primitive for what remains of a motion, from any state in the middle of it.

        It starts in the state's pose, with its velocities, leads back onto the path as it was and
        ends at the goal.  What was planned for the rest of the motion is the first guess.

        Parameters
        ----------
        state : State
            Of this primitive, as :meth:`initial_state` and :meth:`step` give it, with whatever was
            measured in place of what was expected.
        goal_position, goal_rotation
            The state's own by default.
        duration : float, optional
            Of what remains (s); by default what is left, and longer where the way is.
        end : "free", "position", "rotation" or "pose"
            What of the goal is kept to.
        samples : int
            Of the projection, at most: fewer are faster.

        Returns
        -------
        ConstrainedDMP
            Its :meth:`initial_state` is the state to go on from.
        """
        count = adapting.samples_of(self, samples)
        adapting.require_state(state)
        planned = Request(
            self.rollout(duration=state.duration, time_step=state.duration / (count - 1)),
            self.system,
            weights=Weights(position_weight, position_smoothing, rotation_smoothing),
        )
        adapted = adapting.replan(
            self,
            planned,
            state,
            goal=adapting.asked("goal", goal_position, goal_rotation),
            end=end,
            duration=duration,
        )
        return self._of(adapted, adapted.request.reference.duration, "none", whole=False)

    def controller(self, *, time_step: float, **options: Any) -> Controller:
        """Return what steps this primitive in a control loop; see :class:`noslip.Controller`."""
        from noslip.runtime.controller import Controller

        return Controller(self, time_step=time_step, **options)

    def rollout_many(self, **options: Any) -> Motions:
        """Roll out thousands of times; see :func:`noslip.runtime.batch.rollout_many`."""
        from noslip.runtime.batch import rollout_many

        return rollout_many(self, **options)

    def export_c(self, folder: str | Path, *, name: str = "primitive") -> Exported:
        """Write the primitive as C99 for a robot; see :func:`noslip.runtime.export.export_c`."""
        from noslip.runtime.export import export_c

        return export_c(self, folder, name=name)

    def _of(
        self, adapted: adapting.Adapted, duration: float, scaling: Scaling, *, whole: bool = True
    ) -> ConstrainedDMP:
        """Return this primitive with an adapted motion."""
        position, orientation = adapted.primitive.position, adapted.primitive.orientation
        request = adapted.request
        if whole and request.leads_in:
            linear, angular = request.twist_at(0)
            position = replace(position, start_velocity=linear * duration)
            orientation = replace(orientation, start_velocity=angular * duration)
        regular_position = scaled_position(
            self.regular.position,
            scaling,
            start_position=position.start,
            goal_position=position.goal,
        )
        regular = replace(
            self.regular,
            position=regular_position,
            orientation=scaled_orientation(
                self.regular.position, self.regular.orientation, regular_position, scaling
            ).moved(orientation.start, orientation.goal),
            duration=duration,
        )
        found = replace(
            self,
            position=position,
            orientation=orientation,
            duration=duration,
            steps=adapted.primitive.steps,
            regular=regular,
            record=(LearningRecord.of(request.reference, adapted.projected),),
            # Of the whole motion, along its demonstrated way.
            spread=self.spread if whole and scaling == "none" else None,
            begin=request.begin,
        )
        found.take_over(self.system, self.stepper)
        return found

    def take_over(self, system: ConstraintSystem, stepper: Stepper) -> None:
        """Use graphs of the same constraints and metric: to build them takes most of a learning."""
        vars(self).update(system=system, stepper=stepper)

    def save(self, path: str | Path) -> Path:
        """Write the primitive as JSON; :func:`noslip.load_primitive` reads it back.

        The motion of what is read back is the same to the last bit.
        """
        from noslip.saving import save_primitive

        return save_primitive(self, path)

    @cached_property
    def stepper(self) -> Stepper:
        if not self.system.size:
            return super().stepper
        held = coupling(
            self.system,
            inverse_metric=self.inverse_metric,
            push="steering" if any(self.inverse_metric[3:]) else "force",
        )
        return Stepper(held, self.system.size)

    @property
    def _begin(self) -> float:
        return self.begin

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


# Rollouts begin in the same state again and again.
@lru_cache(maxsize=64)
def _allowed_velocities(
    system: ConstraintSystem,
    time: float,
    moving: bytes,
    inverse_metric: tuple[float, ...],
    residual_rate: float,
) -> tuple[Floats, Floats, Floats]:
    given = np.frombuffer(moving)
    found = project_velocities(
        system,
        time,
        given[0:3],
        given[3:7],
        given[7:10],
        given[10:13],
        inverse_metric=inverse_metric,
        residual_rate=residual_rate,
    )
    for part in found:
        part.flags.writeable = False
    return found


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
        Meters that weigh as much as a radian; by default the length of a mean step.
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
        spread=Spread.about(fitted, projected or sampled),
    )
