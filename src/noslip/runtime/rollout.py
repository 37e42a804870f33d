"""The motion of a law under a rule: whole, or step by step."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from typing import Any, Literal, TypeVar, get_args

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from noslip import _arguments
from noslip._typing import Floats
from noslip.boundary import Point
from noslip.constraints.system import ConstraintSystem
from noslip.errors import InputError, did_you_mean
from noslip.law.entry import GoalForm
from noslip.law.law import Law
from noslip.law.layout import CLOCK, layouts
from noslip.law.points import rotation_of
from noslip.projection.feasibility import project_pose
from noslip.projection.pointwise import project_velocities
from noslip.rule import Rule
from noslip.runtime.lost import require_defined
from noslip.runtime.motion import Asked, Motion, motion_class
from noslip.runtime.state import State
from noslip.runtime.stepper import stepper_of
from noslip.runtime.timing import require_time, timed
from noslip.space import Placed, Space

T = TypeVar("T")

ProjectStart = Literal["velocity", "pose", "nothing"]
HELD_RESIDUAL = 1e-12
"""Residual that rounding causes, over the largest velocity, or 1."""
SAME_STEP = 1e-6
"""Relative difference up to which a last step counts as equal: that of times that were rounded."""
AT_ONCE = 1e18
"""A rate that leaves nothing after any step (1/s)."""


def rollout(
    law: Law,
    rule: Rule,
    *,
    goal: Point | None = None,
    start: Point | State | None = None,
    goal_position: ArrayLike | None = None,
    goal_rotation: Rotation | None = None,
    start_position: ArrayLike | None = None,
    start_rotation: Rotation | None = None,
    duration: float | None = None,
    cycles: float = 1.0,
    amplitude: float = 1.0,
    time_step: float | None = None,
    project_start: ProjectStart = "velocity",
    pull_in: float | None = None,
    goal_form: GoalForm = "minimum-jerk",
) -> Motion:
    """Integrate from the start to the end of the duration, or over cycles.

    Parameters
    ----------
    law : Law
    rule : Rule
    goal, start : array, shape (n,), or a pair (position, Rotation), optional
        A point of what moves: coordinates such as joints, or a pose; of several bodies a mapping of
        names to such pairs, in which those that are left out stay where the law has them.  The
        start may be the State that another motion is in: this one takes over from it, in its pose,
        with its velocity, at its time.
    goal_position, start_position : array, shape (n,), optional
        Meters, or the coordinates' own units; the demonstrated ones by default.
    goal_rotation, start_rotation : Rotation, optional
        Of a rhythm the goal is the baseline, what it goes around.
    duration : float, optional
        tau (s); of a rhythm the period.  The motion keeps its shape; only its speed changes.  Soft
        limits on that speed may then give way, with a warning.
    cycles : float
        Of a rhythm: how many periods.
    amplitude : float
        Of a rhythm: factor on its size, about the baseline.
    time_step : float, optional
        Seconds.  By default the motion has the steps that it was planned on, whatever its duration:
        those of the demonstration, or a multiple (200 or more, and 4 a basis function).  If the
        duration is no multiple of it, the last step is shorter.
    project_start : "velocity", "pose" or "nothing"
        What of a start that violates the constraints is replaced by the nearest that does not.  By
        default the velocity (as in the paper).
    pull_in : float, optional
        Rate (1/s) at which what is still violated then decays, as ``exp(-rate t)``; by default the
        rule's ``stabilization`` over the duration.
    goal_form : "minimum-jerk" or "paper"
        How a start and goal that are given take the place of the learned ones: along a minimum-jerk
        blend; or the goal draws from the start on as in the paper's eqs. 1 and 4, which may lead
        backwards first.  See :mod:`noslip.law.entry`.

    Returns
    -------
    Motion
        ``times`` start at 0, or where a re-planned motion begins.

    Raises
    ------
    MissedError
        If a hard limit on velocities or accelerations cannot be kept in the duration given; the
        message says in which it can.
    """
    options: dict[str, Any] = {
        "goal": goal,
        "start": start,
        "goal_position": goal_position,
        "goal_rotation": goal_rotation,
        "start_position": start_position,
        "start_rotation": start_rotation,
        "project_start": project_start,
        "pull_in": pull_in,
        "goal_form": goal_form,
    }
    if not law.clock.returns and (cycles != 1 or amplitude != 1):
        raise InputError(
            "cycles and amplitude are for a rhythm; learn one with rhythmic=True, or scale a "
            "motion to its goal with adapt(scaling=...)"
        )
    options["amplitude"] = amplitude
    state = initial_state(law, rule, duration=duration, **options)
    if state.duration < law.duration and any(timed(rule.system)):
        usual = motion_from(law, rule, initial_state(law, rule, **options))
        require_time(usual, rule.system, state.duration)
    return motion_from(law, rule, state, time_step, _arguments.positive("cycles", cycles))


def motion_from(
    law: Law, rule: Rule, state: State, time_step: float | None = None, cycles: float = 1.0
) -> Motion:
    """Return the whole motion from an initial state; ``time_step`` is that of :func:`rollout`."""
    duration = cycles * state.duration
    if time_step is None:
        time_step = state.duration / law.steps
        steps = max(1, _arguments.samples("cycles", np.ceil(cycles * law.steps - 1e-9)))
    else:
        time_step = _arguments.positive("time_step", time_step, "seconds")
        if time_step > duration * (1 + 1e-9):
            raise InputError(
                f"time_step of {time_step:g} s is longer than the motion of "
                f"{duration:g} s; make it shorter"
            )
        wanted = np.ceil(duration / time_step * (1 - 1e-12) - 1e-9)
        steps = max(1, _arguments.samples(f"time_step={time_step:g}", wanted))
    last = duration - (steps - 1) * time_step
    if steps == 1 or abs(last - time_step) <= SAME_STEP * time_step:
        return integrate(law, rule, state, [(steps, time_step)])
    return integrate(law, rule, state, [(steps - 1, time_step), (1, last)])


def integrate(law: Law, rule: Rule, state: State, sections: Sequence[tuple[int, float]]) -> Motion:
    """Carry a state to the end of its duration, in sections of so many steps of so many seconds."""
    stepper, system = stepper_of(rule), rule.system
    times, table = _ahead(law, rule, state, sections)
    states = np.empty((len(times), stepper.carried.size))
    # The acceleration of the first sample is that of the step which leaves it.
    outputs = np.empty((len(times), stepper.outputs.size))
    states[0] = state.carried(system)
    stepper.run(states[0], table, states[1:], outputs[1:])
    require_defined(system, times, states)
    outputs[0] = outputs[1]
    return motion_class(law.space).of_steps(
        times,
        states,
        {name: outputs[:, stepper.outputs[name]] for name in stepper.outputs},
        tuple(system.equalities.row_names),
        tuple(system.limits.row_names),
        Asked(
            state,
            table,
            law.space,
            _returns(law, state, float(times[-1] - state.time)),
            law.clock.returns,
        ),
    )


def _returns(law: Law, state: State, seconds: float) -> bool:
    """Whether a motion of so long should end where it began: whole periods of its law's cycle."""
    if not law.clock.returns or state.phase != 0 or state.amplitude != 1:
        return False
    periods = seconds / state.duration
    begun = _begun_around(law, state.goal_position, state.amplitude)
    return abs(periods - round(periods)) <= SAME_STEP and np.array_equal(state.position, begun)


def _begun_around(law: Law, baseline: Floats, amplitude: float) -> Floats:
    """Where a rhythm begins about a baseline, as far from it as it swings."""
    return baseline + amplitude * (law.start_position - law.goal_position)


def initial_state(
    law: Law,
    rule: Rule,
    *,
    goal: Point | None = None,
    start: Point | State | None = None,
    goal_position: ArrayLike | None = None,
    goal_rotation: Rotation | None = None,
    start_position: ArrayLike | None = None,
    start_rotation: Rotation | None = None,
    duration: float | None = None,
    amplitude: float = 1.0,
    project_start: ProjectStart = "velocity",
    pull_in: float | None = None,
    goal_form: GoalForm = "minimum-jerk",
) -> State:
    """Return the state to :func:`step` from; the arguments are those of :func:`rollout`."""
    require_choice("project_start", project_start, ProjectStart)
    require_choice("goal_form", goal_form, GoalForm)
    if isinstance(goal, State):
        raise InputError(
            "goal is a point, and a state has a velocity; adapt(goal=...) ends with both"
        )

    def chosen(check: Callable[[str, Any], T], name: str, value: Any, default: T) -> T:
        return default if value is None else check(name, value)

    tau = law.duration
    if duration is not None:
        tau = _arguments.positive("duration", duration, "seconds")
    n, rotation = law.space.linear, partial(turn_of, law.space)
    vector = partial(_arguments.vector, unit=law.space.unit, size=n)
    ends: dict[str, tuple[Any, Any, Any]] = {"goal": (goal, goal_position, goal_rotation)}
    ends["start"] = start, start_position, start_rotation
    (goal_position, goal_rotation), (start_position, start_rotation) = (
        point_or_parts(law, name, *given) for name, given in ends.items()
    )
    taken_over = start if isinstance(start, State) else None
    velocity, begin = law.start_velocity / tau, law.begin
    if taken_over is not None:
        velocity, begin = velocity_of(law.space, "start", taken_over), taken_over.time
    start_position = chosen(vector, "start_position", start_position, law.start_position)
    start_rotation = chosen(rotation, "start_rotation", start_rotation, law.start_rotation)
    goal_position = chosen(vector, "goal_position", goal_position, law.goal_position)
    goal_rotation = chosen(rotation, "goal_rotation", goal_rotation, law.goal_rotation)
    first_position, first_rotation = goal_position, goal_rotation
    if goal_form == "minimum-jerk" and not law.clock.returns:
        # Where the learned way leads from the start; to the last bit, if both are the learned ones.
        first_position, first_rotation = law.goal_position, law.goal_rotation
        if start_position is not law.start_position:
            first_position = first_position + (start_position - law.start_position)
        if start_rotation is not law.start_rotation:
            first_rotation = first_rotation * (law.start_rotation.inv() * start_rotation)
    if law.clock.returns:
        velocity = velocity if taken_over else amplitude * velocity
        if start_position is law.start_position:
            start_position = _begun_around(law, goal_position, amplitude)
        if start_rotation is law.start_rotation and goal_rotation is not law.goal_rotation:
            start_rotation = start_rotation * (law.goal_rotation.inv() * goal_rotation)
    state = State(
        time=begin,
        phase=law.clock.phase(0.0),
        amplitude=_arguments.not_negative("amplitude", amplitude),
        position=start_position,
        rotation=start_rotation,
        linear_velocity=velocity[:n],
        angular_velocity=velocity[n:],
        previous_step=0.0,
        duration=tau,
        goal_position=goal_position,
        goal_rotation=goal_rotation,
        first_goal_position=first_position,
        first_goal_rotation=first_rotation,
        pull_in=chosen(_arguments.not_negative, "pull_in", pull_in, rule.stabilization / tau),
    )
    return admissible(rule, state, project_start) if rule.system.size else state


def require_choice(name: str, value: object, choices: Any) -> None:
    """Refuse what is none of the words of a Literal."""
    if value not in get_args(choices):
        raise InputError(f"{name} is one of {', '.join(get_args(choices))}; got {value!r}")


def turn_of(space: Space, name: str, value: Any) -> Rotation:
    """Check a rotation of a space with one."""
    if space.rotations == 1:
        return _arguments.rotation(name, value)
    fits = isinstance(value, Rotation) and not value.single and len(value) == space.rotations
    if not fits:
        raise InputError(
            f"{name}: what moves has no rotation"
            if not space.rotations
            else f"{name} must be a SciPy Rotation of {space.rotations}"
        )
    return value


def velocity_of(space: Space, name: str, state: State) -> Floats:
    """Return the velocity of a state of a space."""
    velocity = state.velocity
    if len(velocity) != space.velocity_size:
        raise InputError(
            f"{name} is a state of another kind of motion: it has {len(velocity)} velocities, "
            f"this one {space.velocity_size}"
        )
    return _arguments.vector(f"{name}: its velocity", velocity, "m/s", space.velocity_size)


def point_or_parts(
    law: Law, name: str, point: Any, position: ArrayLike | None, rotation: Rotation | None
) -> tuple[ArrayLike | None, Rotation | None]:
    """Parts of a point that is given whole, or the parts as they are given.

    Parameters
    ----------
    law : Law
        Of whose bodies those stay as they are that a mapping of names leaves out.
    name : "goal" or "start"
    point : array, pair (position, Rotation), mapping of names to such pairs, or State
    """
    space = law.space
    if point is None:
        return position, rotation
    if position is not None or rotation is not None:
        raise InputError(f"{name} is given twice; give {name}, or its position and rotation")
    if isinstance(point, State):
        return point.position, point.rotation if space.rotations else None
    if not space.rotations:
        return point, None
    if isinstance(point, Mapping):
        own = (law.start if name == "start" else law.goal.point).copy()
        known = {placed.name: placed for placed in space.bodies}
        if not point:
            raise InputError(f"{name} names no body; there are {', '.join(known)}")
        for body, pose in point.items():
            what = f"{name} of {body}"
            if (placed := known.get(body)) is None:
                near = did_you_mean(str(body), known)
                raise InputError(f"{name}: no body {body!r}{near}; there are {', '.join(known)}")
            if not (isinstance(pose, tuple) and len(pose) == 2):
                raise InputError(
                    f"{what} is a pair (position, Rotation), got {_arguments.short(pose)}"
                )
            assert isinstance(placed, Placed)
            own[placed.first : placed.first + 3] = _arguments.vector(what, pose[0])
            if placed.turn is not None:
                at = space.linear + 4 * placed.turn
                turn = _arguments.rotation(f"{what}, its rotation,", pose[1])
                own[at : at + 4] = turn.as_quat(scalar_first=True)
        return own[: space.linear], rotation_of(own[space.linear :])
    if not (isinstance(point, tuple) and len(point) == 2):
        of = "a pose" if space.rotations == 1 else "several bodies"
        form = " or a mapping of names to such pairs" if space.rotations > 1 else ""
        raise InputError(
            f"{name} of {of} is a pair (position, Rotation){form}, got {_arguments.short(point)}; "
            f"{name}_position and {name}_rotation say one of both"
        )
    return point


def step(law: Law, rule: Rule, state: State, time_step: float) -> State:
    """Carry a state over one time step (s); the same motion as :func:`rollout`.

    Steps may differ in length; the last one ends where the motion does.  After its end it holds its
    pose, or comes to rest within ``state.braking`` seconds, straight on or as constraints lead it.
    One longer than a tenth of the duration is made good in steps as long as the motion's own.
    """
    time_step = _arguments.positive("time_step", time_step, "seconds")
    fraction = law.clock.fraction(state.phase)
    count, seconds = law.clock.made_good(fraction, time_step, state.duration, law.steps)
    for _ in range(count):
        state = _stepped(law, rule, state, seconds)
    return state


def _stepped(law: Law, rule: Rule, state: State, time_step: float) -> State:
    """The state after one step, however long."""
    fraction = law.clock.fraction(state.phase)
    if law.clock.is_over(fraction):
        _, after_end = law.clock.slowed(fraction, time_step, state.duration, state.braking)
        phase = float(law.clock.at(after_end))
    else:
        # A whole step would go beyond the end.
        time_step = min(time_step, law.clock.left(fraction) * state.duration)
        phase = law.clock.later(state.phase, time_step / state.duration)
    table = steps_ahead(law, rule, state, 1, time_step)
    stepper, rows = stepper_of(rule), rule.system.equalities.size
    places = layouts(law.space)
    before = state.carried(rule.system)
    after, outputs = np.empty_like(before), np.empty((1, stepper.outputs.size))
    stepper.run(before, table, after[None], outputs)
    require_defined(rule.system, state.time + np.array([0, time_step]), np.stack([before, after]))
    found = {name: outputs[0, stepper.outputs[name]] for name in stepper.outputs}
    values = after[stepper.carried["values"]]
    return replace(
        state,
        time=state.time + time_step,
        phase=phase,
        position=after[places.state["position"]],
        rotation=after[places.state["quaternion"]],
        linear_velocity=after[places.state["linear_velocity"]],
        angular_velocity=after[places.state["angular_velocity"]],
        previous_step=time_step,
        acceleration=(after[places.velocity] - before[places.velocity])
        / table[0, places.step.index("kick")],
        constraint_residuals=values[:rows],
        multipliers=found["multipliers"][:rows],
        margins=values[rows:],
        limit_multipliers=found["multipliers"][rows:],
        constraint_forces=found["force"],
        done=law.clock.is_over(law.clock.fraction(phase)),
    )


def steps_ahead(law: Law, rule: Rule, state: State, steps: int, time_step: float) -> Floats:
    """Return what depends on the phase alone in the coming steps, a row a step.

    Returns
    -------
    array, shape (steps, ...)
        Columns as the step of :class:`noslip.law.layout.Layouts` says.  After the end of the
        motion one step alone.
    """
    tau = state.duration
    # What violates a constraint from the start is pulled in; what was pushed off it, or was
    # measured to be, goes on without slip at once.
    fast = max(1.0, *map(abs, state.linear_velocity), *map(abs, state.angular_velocity))
    held = np.abs(state.constraint_residuals).max(initial=0.0) <= HELD_RESIDUAL * fast
    started = state.previous_step > 0
    slip_rates = (
        AT_ONCE if held and started else state.pull_in,
        AT_ONCE if held else state.pull_in,
    )
    # The first kick begins in the middle of the step before; the others are alike.
    kicks = (state.previous_step + time_step) / 2, time_step
    fraction = law.clock.fraction(state.phase)
    over = law.clock.is_over(fraction)
    if over:
        # Drawn nowhere any more.
        share, _ = law.clock.slowed(fraction, time_step, tau, state.braking)
        slip_rates = AT_ONCE, AT_ONCE
    column = layouts(law.space).step
    table = np.empty((steps, column.size))
    for rows, k in ((slice(None), 1), (0, 0)):
        before = time_step if k else state.previous_step
        decay, gain = (share, 0.0) if over else law.attractor.factors(before / tau, time_step / tau)
        table[rows, CLOCK] = (
            time_step,
            kicks[k],
            before,
            0.0,
            state.pull_in,
            slip_rates[k],
            rule.barrier_rate / tau,
            decay,
            gain / tau,
        )
    table[:, column.index("time")] = state.time + np.arange(1, steps + 1) * time_step
    targets = law.targets(
        fraction,
        steps,
        time_step / tau,
        state.goal_position,
        state.goal_rotation,
        state.first_goal_position,
        state.first_goal_rotation,
        state.previous_step / tau,
        state.amplitude,
    )
    for name, values in targets.items():
        table[:, column[name]] = values
    return table


def _ahead(
    law: Law, rule: Rule, state: State, sections: Sequence[tuple[int, float]]
) -> tuple[Floats, Floats]:
    """Times of the samples, and rows of the steps, of sections of equal steps."""
    times, tables = [np.array([state.time])], []
    at = state
    for steps, time_step in sections:
        times.append(at.time + time_step * np.arange(1, steps + 1, dtype=np.float64))
        tables.append(steps_ahead(law, rule, at, steps, time_step))
        after = law.clock.later(at.phase, steps * time_step / state.duration)
        at = replace(at, time=times[-1][-1], phase=after, previous_step=time_step)
    times[-1][-1] = state.time + sum(steps * seconds for steps, seconds in sections)
    return np.concatenate(times), tables[0] if len(tables) == 1 else np.vstack(tables)


def admissible(rule: Rule, state: State, project: ProjectStart) -> State:
    """Return the state with its velocities, or its pose too, projected onto the constraints."""
    system = rule.system
    position, quaternion = state.position, state.quaternion
    if project == "pose":
        position, quaternion = project_pose(
            system, state.time, position, quaternion, inverse_metric=rule.inverse_metric
        )
    equalities, limits = system.equalities, system.limits
    linear, angular = state.linear_velocity, state.angular_velocity
    if project == "nothing":
        residuals = equalities.instant(state.time, position, quaternion, linear, angular)[0]
    else:
        moving = np.concatenate([position, quaternion, linear, angular])
        linear, angular, residuals = _allowed_velocities(
            system, state.time, moving.tobytes(), rule.inverse_metric, state.pull_in
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


# Rollouts begin in the same state again and again.
@lru_cache(maxsize=64)
def _allowed_velocities(
    system: ConstraintSystem,
    time: float,
    moving: bytes,
    inverse_metric: tuple[float, ...],
    residual_rate: float,
) -> tuple[Floats, Floats, Floats]:
    given, places = np.frombuffer(moving), layouts(system.space).state
    found = project_velocities(
        system,
        time,
        *(given[places[name]] for name in places),
        inverse_metric=inverse_metric,
        residual_rate=residual_rate,
    )
    for part in found:
        part.flags.writeable = False
    return found
