"""New goals, starts and via points under the constraint.

A constraint that forbids velocities forbids no pose, yet no smooth feedback law leads a
non-holonomic system to every pose (Brockett 1983), and a coupling term alone stops short of a goal
that moved.  So a whole trajectory is adapted: the unconstrained primitive's motion is moved to the
new boundary values by minimum jerk, projected onto the constraints with these values fixed, and the
primitive is fitted to the result.  From a state in the middle of a motion, the same is re-planning.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, get_args

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from noslip import _arguments
from noslip._typing import Floats
from noslip.constraints.system import ConstraintSystem
from noslip.errors import ConstraintError, ConvergenceError, InputError
from noslip.law.fitting import FEWEST_STEPS, SAMPLES_PER_BASIS_FUNCTION, fit
from noslip.law.law import Law
from noslip.law.scaling import Scaling, scaled
from noslip.projection.blend import spread
from noslip.projection.feasibility import project_pose
from noslip.projection.pointwise import project_velocities
from noslip.projection.trajectory import (
    End,
    ProjectedTrajectory,
    project_heeding_what_it_can,
)
from noslip.rule import Rule
from noslip.runtime.rollout import rollout
from noslip.runtime.state import State
from noslip.trajectory import PoseTrajectory

POSITION_WEIGHT = 10.0
"""w_p of an adaptation: far less than in learning, for the path must be reshaped."""
POSITION_SMOOTHING = 1e-2
ROTATION_SMOOTHING = 1e-4
MOST_SAMPLES = 2001
"""An adapted motion is as smooth as its primitive; more samples than these add nothing."""
FEWEST_SAMPLES = 20
_STATE_VECTORS = ("position", "linear_velocity", "angular_velocity", "goal_position")
REPLANNED_SAMPLES = 201
"""Knots of a re-planned motion unless told otherwise."""
_OFF = 1e-9
"""Residual of a boundary pose that is none (m or rad)."""
_DETOUR = 5.0
"""Way for which time is allotted to a displacement, over its length: it may lie sideways."""
_SETTLED = 0.3
"""Fraction of what remains after which a displacement is to be gone, unless it is large."""
_LEAST_TIME = 0.05
"""Of the duration, that a re-planned motion takes at least."""


@dataclass(frozen=True)
class Via:
    """A point or a pose to pass on the way.

    Parameters
    ----------
    at : float
        When, as a fraction of the duration: 0 < at < 1.
    position : array, shape (3,), optional
        Meters.
    rotation : Rotation, optional
    """

    at: float
    position: ArrayLike | None = None
    rotation: Rotation | None = None

    def __post_init__(self) -> None:
        at = _arguments.positive("via at", self.at)
        if at >= 1:
            raise InputError(
                f"via at must be between 0 and 1, a fraction of the motion, got {at:g}"
            )
        object.__setattr__(self, "at", at)
        if self.position is not None:
            position = _arguments.vector("via position", self.position)
            object.__setattr__(self, "position", position)
        if self.rotation is not None:
            _arguments.rotation("via rotation", self.rotation)
        if self.position is None and self.rotation is None:
            raise InputError(f"via at {at:g} names neither a position nor a rotation")

    @classmethod
    def of(cls, given: Via | Sequence[Any]) -> Via:
        """Return a via from itself or from ``(at, position)`` or ``(at, position, rotation)``."""
        if isinstance(given, Via):
            return given
        try:
            return cls(*given)
        except TypeError:
            raise InputError(
                "via is a list of (at, position), (at, position, rotation) or Via; got "
                + _arguments.short(given)
            ) from None


@dataclass(frozen=True, eq=False)
class Adapted:
    """What an adaptation comes to.

    Attributes
    ----------
    law : Law
        Fitted to the projected trajectory.
    reference : PoseTrajectory
        What was projected: the unconstrained motion, moved to the boundary values.
    projected : ProjectedTrajectory
    """

    law: Law
    reference: PoseTrajectory
    projected: ProjectedTrajectory


@dataclass(frozen=True, eq=False)
class _Task:
    """A reference that already meets its boundary values, and what of it must stay.

    ``reference`` begins with one more sample, a step before the start, where ``moving``.
    """

    reference: PoseTrajectory
    keep: dict[int, End]
    begin: float
    moving: bool


def adapt(
    law: Law,
    system: ConstraintSystem,
    *,
    goal_position: Floats,
    goal_rotation: Rotation,
    start_position: Floats,
    start_rotation: Rotation,
    start_velocities: tuple[Floats, Floats] | None,
    duration: float,
    via: Iterable[Via | Sequence[Any]],
    start: End,
    end: End,
    samples: int,
    begin: float,
    weights: tuple[float, float, float],
) -> Adapted:
    """Adapt an unconstrained primitive's motion to boundary values under constraints.

    Parameters
    ----------
    law : Law
        Its own start and goal may be others.
    start_velocities : pair of arrays, shape (3,), or None
        Linear and angular velocity to begin with; None leaves them free.
    begin : float
        Time at the start (s), for constraints that depend on it.

    Notes
    -----
    The other parameters are those of :meth:`noslip.ConstrainedDMP.adapt`.
    """
    _require_end("start", start)
    _require_end("end", end)
    if start_velocities is not None and start != "pose":
        raise InputError(
            f'start_velocity needs a whole pose to begin in: start="pose", not {start!r}'
        )
    free = rollout(law, Rule(), duration=duration, time_step=duration / (samples - 1))
    try:
        vias = [Via.of(v) for v in via]
    except TypeError:
        raise InputError(
            "via is a list of (at, position), (at, position, rotation) or Via; got "
            + _arguments.short(via)
        ) from None
    places: dict[int, Via] = {}
    for passed in vias:
        place = round(passed.at * (samples - 1))
        if not 0 < place < samples - 1 or place in places:
            raise InputError(
                f"via at {passed.at:g} falls on an end or on another via; {samples} samples tell "
                f"{1 / (samples - 1):.2g} of the motion apart"
            )
        places[place] = passed
        require_feasible(
            system,
            f"via at {passed.at:g}",
            begin + passed.at * duration,
            None if passed.position is None else np.asarray(passed.position),
            passed.rotation,
        )
    goals: dict[int, tuple[ArrayLike | None, Rotation | None]] = {
        0: _kept(start, start_position, start_rotation),
        **{place: (v.position, v.rotation) for place, v in places.items()},
        samples - 1: _kept(end, goal_position, goal_rotation),
    }
    reference = through(free, goals, start_velocities)
    task = _task(reference, goals, begin, start_velocities)
    adapted = _carried_out(law, system, task, weights, law.steps)
    hard = [c.priority == 0 for c in system.limits.constraints]
    left_out = [
        name
        for name, is_hard in zip(system.limits.names, hard, strict=True)
        if is_hard and name in adapted.projected.left_out
    ]
    if left_out:
        raise ConvergenceError(
            f"no motion found that keeps {', '.join(left_out)} between these ends; give it more "
            "time (duration), other ends, or a priority above 0"
        )
    return adapted


def replan(
    law: Law,
    system: ConstraintSystem,
    nominal: PoseTrajectory,
    state: State,
    *,
    goal_position: ArrayLike | None,
    goal_rotation: Rotation | None,
    duration: float | None,
    end: End,
    samples: int,
    weights: tuple[float, float, float],
) -> tuple[Adapted, float]:
    """Adapt what remains of a motion to the state that it is in.

    Parameters
    ----------
    law : Law
        Whose constants the result has.
    nominal : PoseTrajectory
        The motion as planned, whole.
    duration : float or None
        Of what remains (s).  By default what is left of the motion, and the time that a
        displacement takes besides.

    Returns
    -------
    Adapted
    float
        Its duration (s).
    """
    _require_end("end", end)
    if duration is not None:
        duration = _arguments.positive("duration", duration, "seconds")
    goal = state.goal_position
    if goal_position is not None:
        goal = _arguments.vector("goal_position", goal_position)
    done = min(max(law.clock.fraction(state.phase), 0.0), 1.0)
    left = 1.0 - done
    step = state.previous_step or state.duration / law.steps
    if duration is None:
        now = round(done * (len(nominal) - 1))
        # Sideways, and the more so where little of the path is left to spread it over.
        displaced = float(np.linalg.norm(state.position - nominal.positions[now]))
        displaced += float(np.linalg.norm(goal - nominal.positions[-1]))
        way = float(np.linalg.norm(np.diff(nominal.positions[now:], axis=0), axis=1).sum())
        speed = nominal.path_length / state.duration
        detour = _DETOUR * displaced**2 / (displaced + way) if displaced else 0.0
        longer = detour / speed / state.duration if speed > 0 else 0.0
        turn = float((state.rotation * nominal.rotations[now].inv()).magnitude()) / np.pi
        duration = max(left + longer, turn, _LEAST_TIME) * state.duration
        duration = max(duration, FEWEST_SAMPLES * step)
    # Not on shorter steps than those that the motion is run on.
    samples = min(samples, max(round(duration / step) + 1, FEWEST_SAMPLES))
    rest = _rest(nominal, done, samples, duration)
    goal, goal_turn = boundary_pose(
        system,
        "goal",
        state.time + duration,
        (goal_position, goal_rotation),
        (state.goal_position, state.goal_rotation),
    )
    position, quaternion = state.position, state.rotation.as_quat(scalar_first=True)
    if "position" in system.row_levels:
        # A state off a surface is led back onto it at run time; the plan lies on it.
        position, quaternion = project_pose(system.equalities, state.time, position, quaternion)
    turned = Rotation.from_quat(quaternion, scalar_first=True)
    goals: dict[int, tuple[ArrayLike | None, Rotation | None]] = {
        0: (position, turned),
        samples - 1: _kept(end, goal, goal_turn),
    }
    velocities = _velocities_now(nominal, done, state)
    moved = through(rest, {samples - 1: goals[samples - 1]})
    # Back onto the path, not just to its end, if the way there is long enough.
    traveled = np.cumsum(np.linalg.norm(np.diff(moved.positions, axis=0), axis=1))
    displaced = float(np.linalg.norm(position - moved.positions[0]))
    k = max(round(_SETTLED * samples), int(np.searchsorted(traveled, _DETOUR * displaced)) + 1)
    if k < samples - 1:
        moved = through(moved, goals | {k: (moved.positions[k], moved.rotations[k])}, velocities)
    else:
        moved = through(moved, goals, velocities)
    task = _task(moved, goals, state.time, velocities)
    # The time step stays what it was, unless that is too long for the fit.
    steps = round(law.steps * duration / state.duration)
    steps = max(steps, SAMPLES_PER_BASIS_FUNCTION * law.basis.count, FEWEST_STEPS)
    return _carried_out(law, system, task, weights, steps), duration


def _require_end(name: str, value: str) -> None:
    if value not in get_args(End):
        raise InputError(f"{name} is one of {', '.join(get_args(End))}; got {value!r}")


def _rest(nominal: PoseTrajectory, done: float, samples: int, duration: float) -> PoseTrajectory:
    """What remains of a motion of which a fraction is done, over another duration."""
    times = np.linspace(0.0, duration, samples)
    if (1 - done) * nominal.duration < 4 * nominal.period:
        # Next to nothing: it stays where it ends.
        last = Rotation.concatenate([nominal.rotations[-1]] * samples)
        return PoseTrajectory(times, np.repeat(nominal.positions[-1:], samples, axis=0), last)
    fractions = np.linspace(done, 1.0, samples)
    rest = nominal.resampled(times=nominal.times[0] + nominal.duration * fractions)
    return PoseTrajectory(times, rest.positions, rest.rotations, name="re-planned")


def require_state(state: State) -> None:
    """Refuse what is not a state of a motion."""
    if not isinstance(state, State):
        raise InputError(f"state must be a State, got {type(state).__name__}")
    vectors = {name: getattr(state, name) for name in _STATE_VECTORS}
    for name, value in vectors.items():
        _arguments.vector(f"state: {name}", value)
    _arguments.positive("state: duration", state.duration, "seconds")
    _arguments.not_negative("state: previous_step", state.previous_step)
    for name in ("time", "phase"):
        _arguments.finite(f"state: {name}", getattr(state, name))


def samples_of(law: Law, samples: int | None) -> int:
    """Return how many samples an adaptation takes."""
    if samples is None:
        return _samples_for(law.basis.count, law.steps)
    samples = _arguments.count("samples", samples, MOST_SAMPLES)
    if samples < FEWEST_SAMPLES:
        raise InputError(f"samples must be {FEWEST_SAMPLES} or more, got {samples}")
    return samples


def _samples_for(basis_functions: int, steps: int) -> int:
    return min(max(steps, SAMPLES_PER_BASIS_FUNCTION * basis_functions) + 1, MOST_SAMPLES)


def boundary_pose(
    system: ConstraintSystem,
    what: str,
    time: float,
    given: tuple[ArrayLike | None, Rotation | None],
    own: tuple[Floats, Rotation],
) -> tuple[Floats, Rotation]:
    """Return a start or goal: what is given of it, the primitive's own for the rest.

    A start, and a goal of which nothing is given, is moved onto the constraints.
    """
    (position, rotation), (placed, turned) = given, own
    if position is not None:
        placed = _arguments.vector(f"{what}_position", position)
    if rotation is not None:
        turned = _arguments.rotation(f"{what}_rotation", rotation)
    is_asked_for = what == "goal" and (position is not None or rotation is not None)
    if "position" in system.equalities.row_levels and not is_asked_for:
        placed, quaternion = project_pose(
            system.equalities, time, placed, turned.as_quat(scalar_first=True)
        )
        turned = Rotation.from_quat(quaternion, scalar_first=True)
    if what != "start":
        require_feasible(system, what, time, placed, turned)
    return placed, turned


def start_velocities(
    system: ConstraintSystem,
    inverse_metric: Sequence[float],
    time: float,
    position: Floats,
    rotation: Rotation,
    given: ArrayLike,
) -> tuple[Floats, Floats]:
    """Return linear and angular velocity at the start, nearest to given ones."""
    try:
        values = np.ravel(np.array(given, dtype=np.float64))
    except (TypeError, ValueError):
        values = np.empty(0)
    if values.shape not in ((3,), (6,)) or not np.isfinite(values).all():
        raise InputError(
            "start_velocity must be 3 finite numbers (m/s), or 6 with the angular velocity (rad/s)"
        )
    linear, angular = values[:3], np.zeros(3) if len(values) == 3 else values[3:]
    return project_velocities(
        system.equalities,
        time,
        position,
        rotation.as_quat(scalar_first=True),
        linear,
        angular,
        inverse_metric=inverse_metric,
    )[:2]


def require_feasible(
    system: ConstraintSystem,
    what: str,
    time: float,
    position: Floats | None,
    rotation: Rotation | None,
) -> None:
    """Refuse a boundary pose that position-level equalities or hard limits do not allow.

    Where only a position or a rotation is given, what depends on the other is not asked.

    Raises
    ------
    ConstraintError
        Naming the constraint and by how much it is missed.
    """
    # What is open takes any value: rows that change with it are not decided.
    random = np.random.default_rng(0)
    tried = np.array(
        [
            system.residuals(
                time,
                random.normal(size=3) if position is None else position,
                (Rotation.random(rng=random) if rotation is None else rotation).as_quat(
                    scalar_first=True
                ),
                np.zeros(3),
                np.zeros(3),
            )[0]
            for _ in range(2 if position is None or rotation is None else 1)
        ]
    )
    values, decided = tried[0], np.ptp(tried, axis=0) <= _OFF
    priorities = system.per_row(c.priority for c in system.constraints)
    for name, counts, level, is_limit, unit, priority, value in zip(
        system.row_names,
        decided,
        system.row_levels,
        system.row_is_limit,
        system.row_units,
        priorities,
        values,
        strict=True,
    ):
        off = max(-value, 0.0) if is_limit else abs(value)
        if counts and level == "position" and priority == 0 and off > _OFF:
            raise ConstraintError(
                f"{what} violates {name!r} by {off:.3g} {unit}; no motion that satisfies it "
                f"{'ends' if what == 'goal' else 'passes'} there"
            )


def _kept(what: End, position: Floats, rotation: Rotation) -> tuple[Any, Any]:
    return (
        position if what in ("position", "pose") else None,
        rotation if what in ("rotation", "pose") else None,
    )


def through(
    free: PoseTrajectory,
    goals: Mapping[int, tuple[ArrayLike | None, Rotation | None]],
    velocities: tuple[Floats, Floats] | None = None,
) -> PoseTrajectory:
    """Return a motion displaced by minimum jerk such that it passes what it must, exactly.

    If velocities are given it begins with them.
    """
    positions, rotations = free.positions, free.rotations
    shifts = {
        float(free.times[k]): np.asarray(wanted) - positions[k]
        for k, (wanted, _) in goals.items()
        if wanted is not None
    }
    # In the tool's frame, as a new goal turns the attractor's.
    turns = {
        float(free.times[k]): (rotations[k].inv() * wanted).as_rotvec()
        for k, (_, wanted) in goals.items()
        if wanted is not None
    }
    faster = turning = None
    if velocities is not None:
        faster = velocities[0] - free.linear_velocities[0]
        turning = _rate_of_turn(turns[float(free.times[0])], free, velocities[1])
    if shifts:
        positions = positions + spread(shifts, free.times, faster)
        for k, (wanted, _) in goals.items():
            if wanted is not None:
                positions[k] = wanted
    if turns:
        rotations = rotations * Rotation.from_rotvec(spread(turns, free.times, turning))
    return PoseTrajectory(free.times, positions, rotations, name=free.name)


def _rate_of_turn(turn: Floats, free: PoseTrajectory, wanted: Floats) -> Floats:
    """Rate of a turn in the tool's frame with which a motion gets the angular velocity wanted.

    ``R Exp(turn)`` rotates at ``Exp(-turn) w + J turn'`` in its own frame, with the right Jacobian
    J of SO(3); its inverse to third order.
    """
    before = free.rotations[0]
    after = before * Rotation.from_rotvec(turn)
    missing = after.inv().apply(wanted - free.angular_velocities[0])
    once = np.cross(turn, missing)
    return np.asarray(missing + once / 2 + np.cross(turn, once) / 12)


def _task(
    reference: PoseTrajectory,
    goals: dict[int, tuple[ArrayLike | None, Rotation | None]],
    begin: float,
    velocities: tuple[Floats, Floats] | None,
) -> _Task:
    """Keep what goals name, and the velocities at the start if there are any."""
    keep: dict[int, End] = {}
    for k, (position, rotation) in goals.items():
        if position is not None and rotation is not None:
            keep[k] = "pose"
        elif position is not None or rotation is not None:
            keep[k] = "rotation" if position is None else "position"
    if velocities is None:
        return _Task(reference, keep, begin, moving=False)
    # A sample before the start.  Velocities are those at the start, half a step after that of the
    # step which leads there: in between lies half a step of the reference's acceleration.
    h = float(reference.times[1] - reference.times[0])
    steps = (np.diff(v[:2], axis=0)[0] / 2 for v in reference.step_velocities())
    linear, angular = (v - change for v, change in zip(velocities, steps, strict=True))
    back = Rotation.from_rotvec(-h * angular) * reference.rotations[0]
    longer = PoseTrajectory(
        np.concatenate([[reference.times[0] - h], reference.times]),
        np.vstack([reference.positions[0] - h * linear, reference.positions]),
        Rotation.concatenate([back, reference.rotations]),
        name=reference.name,
    )
    shifted: dict[int, End] = {k + 1: what for k, what in keep.items()}
    return _Task(longer, {0: "pose", **shifted, 1: "pose"}, begin - h, moving=True)


def _velocities_now(nominal: PoseTrajectory, done: float, state: State) -> tuple[Floats, Floats]:
    """Velocities at a state, half a step after those of the step that led to it."""
    # Both velocities of the nominal motion change but little within half a step.
    steps = len(nominal) - 1
    k = min(max(round(done * steps), 1), steps - 1)
    share = state.previous_step / 2 / nominal.period
    return (
        state.linear_velocity + share * np.diff(nominal.linear_velocities[k : k + 2], axis=0)[0],
        state.angular_velocity + share * np.diff(nominal.angular_velocities[k : k + 2], axis=0)[0],
    )


def _carried_out(
    law: Law,
    system: ConstraintSystem,
    task: _Task,
    weights: tuple[float, float, float],
    steps: int,
) -> Adapted:
    last = len(task.reference) - 1
    between = {k: what for k, what in task.keep.items() if 0 < k < last}
    projected = project_heeding_what_it_can(
        task.reference,
        system,
        start=task.keep.get(0, "free"),
        end=task.keep.get(last, "free"),
        keep=between,
        begin=task.begin,
        position_weight=weights[0],
        position_smoothing=weights[1],
        rotation_smoothing=weights[2],
    )
    first = 1 if task.moving else 0
    trajectory = projected.trajectory[first:]
    basis, attractor = law.basis, law.attractor
    samples = _samples_for(basis.count, steps)
    if len(trajectory) < samples:
        times = np.linspace(trajectory.times[0], trajectory.times[-1], samples)
        trajectory = trajectory.resampled(times=times)
    fitted = fit(
        trajectory,
        basis_functions=basis.count,
        alpha=attractor.alpha,
        beta=attractor.beta,
        alpha_s=law.clock.alpha_s,
    )
    return Adapted(
        replace(fitted, steps=steps),
        task.reference[first:],
        projected,
    )


def adapt_law(
    law: Law,
    rule: Rule,
    *,
    goal_position: ArrayLike | None = None,
    goal_rotation: Rotation | None = None,
    start_position: ArrayLike | None = None,
    start_rotation: Rotation | None = None,
    start_velocity: ArrayLike | None = None,
    duration: float | None = None,
    via: Iterable[Via | Sequence[Any]] = (),
    scaling: Scaling = "none",
    start: End = "pose",
    end: End = "pose",
    samples: int | None = None,
    position_weight: float = POSITION_WEIGHT,
    position_smoothing: float = POSITION_SMOOTHING,
    rotation_smoothing: float = ROTATION_SMOOTHING,
) -> Adapted:
    """Return a law that starts, passes and ends elsewhere, and keeps the constraints.

    The law is rolled out without constraints, its motion moved to the new boundary values,
    projected onto the constraints with these values fixed, and fitted again.

    Parameters
    ----------
    goal_position, start_position : array, shape (3,), optional
        Meters; those of this law by default.
    goal_rotation, start_rotation : Rotation, optional
    start_velocity : array, shape (3,) or (6,), optional
        Linear velocity (m/s), then angular (rad/s), world frame; projected onto the
        constraints.  By default whatever suits the motion.
    duration : float, optional
        tau (s).
    via : sequence of Via, (at, position) or (at, position, rotation)
        Points or poses to pass, at fractions of the duration.
    scaling : "none", "difference" or "rotation-dilation"
        How the path follows a new goal before it is projected, see
        :func:`noslip.law.scaling.scaled`.  Without scaling the displacement
        grows along the motion by minimum jerk.  Where the path turns, orientations that are
        not named turn along.
    start, end : "free", "position", "rotation" or "pose"
        What of the start and the goal is kept to; all of it by default.  What is not named in
        the call is that of this law.
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
    tau, count, system = law.duration, samples_of(law, samples), rule.system
    if duration is not None:
        tau = _arguments.positive("duration", duration, "seconds")
    free = law
    if scaling != "none":
        free = scaled(law, scaling, start_position=start_position, goal_position=goal_position)
    goal, goal_turn = boundary_pose(
        system,
        "goal",
        law.begin + tau,
        (goal_position, goal_rotation),
        (law.goal_position, free.goal_rotation),
    )
    first, first_turn = boundary_pose(
        system,
        "start",
        law.begin,
        (start_position, start_rotation),
        (law.start_position, free.start_rotation),
    )
    velocities = None
    if start_velocity is not None:
        velocities = start_velocities(
            system, rule.inverse_metric, law.begin, first, first_turn, start_velocity
        )
    adapted = adapt(
        free,
        system,
        goal_position=goal,
        goal_rotation=goal_turn,
        start_position=first,
        start_rotation=first_turn,
        start_velocities=velocities,
        duration=tau,
        via=via,
        start=start,
        end=end,
        samples=count,
        begin=law.begin,
        weights=(position_weight, position_smoothing, rotation_smoothing),
    )
    found = replace(adapted.law, duration=tau, begin=law.begin)
    if velocities is not None:
        found = replace(found, start_velocity=np.concatenate(velocities) * tau)
    return replace(adapted, law=found)


def replan_law(
    law: Law,
    rule: Rule,
    state: State,
    *,
    goal_position: ArrayLike | None = None,
    goal_rotation: Rotation | None = None,
    duration: float | None = None,
    end: End = "pose",
    samples: int = REPLANNED_SAMPLES,
    position_weight: float = POSITION_WEIGHT,
    position_smoothing: float = POSITION_SMOOTHING,
    rotation_smoothing: float = ROTATION_SMOOTHING,
) -> Adapted:
    """Return a law for what remains of a motion, from any state in the middle of it.

    It starts in the state's pose, with its velocities, leads back onto the path as it was and
    ends at the goal.  What was planned for the rest of the motion is the first guess.

    Parameters
    ----------
    state : State
        Of this law, as ``initial_state`` and ``step`` give it, with whatever was
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
    Adapted
        The ``initial_state`` of its law is the state to go on from.
    """
    count = samples_of(law, samples)
    require_state(state)
    adapted, tau = replan(
        law,
        rule.system,
        rollout(law, rule, duration=state.duration, time_step=state.duration / (count - 1)),
        state,
        goal_position=goal_position,
        goal_rotation=goal_rotation,
        duration=duration,
        end=end,
        samples=count,
        weights=(position_weight, position_smoothing, rotation_smoothing),
    )
    return replace(adapted, law=replace(adapted.law, duration=tau, begin=state.time))
