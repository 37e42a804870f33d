"""What remains of a motion, led from the state that it is in back onto its path."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from noslip import _arguments
from noslip._typing import Floats
from noslip.adapting import compiled
from noslip.adapting.around import samples_of
from noslip.adapting.constants import DETOUR, FEWEST_LEFT, FEWEST_SAMPLES, LEAST_TIME, SETTLED
from noslip.adapting.ends import Velocity, allowed, asked, moving, placed
from noslip.adapting.impossible import require_reachable
from noslip.adapting.plan import Adapted, Plan, carried_out, projected_onto
from noslip.boundary import Boundary, End, rotations_of
from noslip.constraints.system import ConstraintSystem
from noslip.errors import ConvergenceError, InputError, MissedError, Refusal
from noslip.law.law import Law
from noslip.projection.blend import through
from noslip.projection.feasibility import project_pose
from noslip.projection.request import ADAPTING, Request, Weights
from noslip.projection.result import ProjectedTrajectory
from noslip.rule import Rule
from noslip.runtime.motion import Motion
from noslip.runtime.rollout import initial_state, integrate, point_or_parts
from noslip.runtime.state import State
from noslip.space import Space
from noslip.trajectory import PoseTrajectory

_BACKING = (0.15, 0.4)
"""Of the motion: how far it backs up along its own way where it finds none straight on, as at the
end of a cut from which a blade was pushed aside.  Either finds what the other does not."""
_ASTRAY = 10.0
"""Of the path's length: way of a plan that is none.  Those that lead on take up to six."""
REPLANNED_SAMPLES = 201
"""Of a re-planned motion unless told otherwise: planned in a few milliseconds."""


def replan(
    law: Law,
    rule: Rule,
    state: State,
    *,
    goal: Any = None,
    goal_position: ArrayLike | None = None,
    goal_rotation: Rotation | None = None,
    goal_velocity: Velocity = None,
    duration: float | None = None,
    end: End = "pose",
    samples: int = REPLANNED_SAMPLES,
    position_weight: float = ADAPTING.position,
    position_smoothing: float = ADAPTING.position_smoothing,
    rotation_smoothing: float = ADAPTING.rotation_smoothing,
) -> Adapted:
    """Find a law for what remains of a motion, from any state in the middle of it.

    It starts in the state's pose, with its velocities, leads back onto the path as it was and
    ends at the goal.  What was planned for the rest of the motion is the first guess.

    Parameters
    ----------
    law : Law
    rule : Rule
    state : State
        Of the law, as ``initial_state`` and ``step`` give it, with whatever was
        measured in place of what was expected.
    goal : array, shape (n,), or a pair (position, Rotation), optional
        A point of what moves, as for :func:`noslip.adapting.adapt`.
    goal_position, goal_rotation
        The state's own by default.
    goal_velocity : 0, array of shape (n,) or (n + 3 b,), or "free", optional
        As for :func:`noslip.adapting.adapt`; that of the motion by default, and at rest where next
        to nothing of it is left.
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
    law.require_end("replan")
    space, system = law.space, rule.system
    samples = samples_of(law.basis.count, law.steps, samples)
    require_state(state, space)
    done = min(max(law.clock.fraction(state.phase), 0.0), 1.0)
    weights = Weights(position_weight, position_smoothing, rotation_smoothing)
    parts = point_or_parts(law, "goal", goal, goal_position, goal_rotation)
    wanted = asked("goal", *parts, goal_velocity, space)
    own = state.goal_position, rotations_of(state.goal_quaternion)
    if duration is not None:
        duration = _arguments.positive("duration", duration, "seconds")
    # A goal that nothing names is moved onto the constraints; C does not do that in a given time.
    is_plain = goal_velocity is None and end == "pose" and space.is_pose
    if is_plain and (duration is None or not wanted.is_free):
        to, seconds = wanted.pose_or(*own), duration or 0.0
        if made := compiled.made(
            law, rule, to, weights, state=state, duration=seconds, samples=samples, steps=law.steps
        ):
            return Plan(made.law, made.request, made.projected).verified(law, rule).told()
    nominal, now = _nominal(law, rule, state, done, samples - 1)
    is_given = duration is not None
    if duration is None:
        toward = state.goal_position if wanted.position is None else wanted.position
        step = state.previous_step or state.duration / law.steps
        duration = max(_time_needed(nominal, state, now, done, toward), FEWEST_SAMPLES * step)

    # Of a pose one attempt, which is that of the exported C.
    once = space.is_pose or not system.equalities.size

    def planned(backing: float) -> Adapted:
        rest = _rest(nominal, now, samples, duration, backing)
        at_end = state.time + duration
        last = placed(wanted, own, system, rule.inverse_metric, at_end)
        if goal_velocity is None:
            ends_as = rest if is_given or _is_over(nominal, now) else nominal
            last = moving(last, ends_as, rule, at_end, end)
        last = last.part(end)
        start = _start(system, state, nominal, now)
        first = allowed(start, system, rule.inverse_metric, state.time)
        assert first.position is not None
        require_reachable(system, first, last)
        # Back onto the path, not just to its end, if the way there is long enough.
        moved = through(rest, [last])
        traveled = np.cumsum(np.linalg.norm(np.diff(moved.positions, axis=0), axis=1))
        displaced = float(np.linalg.norm(first.position - moved.positions[0]))
        k = max(round(SETTLED * samples), int(np.searchsorted(traveled, DETOUR * displaced)) + 1)
        back = []
        if k < samples - 1 and not backing:
            back = [Boundary.keeping(moved, k / (samples - 1), "pose")]
        request = Request(
            through(moved, [first, *back, last]),
            system,
            (first, last),
            weights,
            begin=state.time,
        )
        # The time step stays what it was, unless that is too long for the fit.
        steps = round(law.steps * duration / state.duration)
        longest = _ASTRAY * (nominal.path_length + displaced)
        plan = carried_out(
            law,
            rule,
            request,
            steps,
            request.reference.duration,
            project=projected_onto if once else partial(_projected_nearby, longest),
        )
        # Where another attempt follows, what would mend this one is not sought.
        return plan.verified(law, rule, seeks_remedy=once)

    attempts = (0.0,) if once else (0.0, *_BACKING)
    found: Adapted | None = None
    failed: ConvergenceError | MissedError | None = None
    for backing in attempts:
        try:
            another = planned(backing)
        except (ConvergenceError, MissedError) as error:
            failed = failed or error
            continue
        found = another if found is None or another.is_exact else found
        if found.is_exact:
            break
    if found is None:
        assert failed is not None
        raise failed
    return found.told()


def _projected_nearby(longest: float, request: Request) -> ProjectedTrajectory:
    """Project a reference; refuse what went so far astray that following it is in vain."""
    found = projected_onto(request)
    if found.trajectory.path_length > longest:
        raise ConvergenceError(
            "no motion near the path found that leads on from there; give it another goal, or a "
            "state nearer to its path",
            code=Refusal.NOT_FOUND,
            iterate=found.trajectory,
        )
    return found


def _nominal(law: Law, rule: Rule, state: State, done: float, steps: int) -> tuple[Motion, int]:
    """The motion as it was planned, and the sample in it that is now.

    As many steps lead from there to the end, if there is anything left of it to speak of.
    """
    start = initial_state(law, rule, duration=state.duration)
    passed = round(done * steps)
    sections = [(steps, state.duration / steps)]
    if 0 < passed < steps - FEWEST_LEFT:
        left = (1 - done) * state.duration
        sections = [(passed, done * state.duration / passed), (steps, left / steps)]
    return integrate(law, rule, start, sections), passed


def _time_needed(nominal: Motion, state: State, now: int, done: float, goal: Floats) -> float:
    """Seconds for what is left of a motion, and for a displacement besides."""
    # Sideways, and the more so where little of the path is left to spread it over.
    displaced = float(np.linalg.norm(state.position - nominal.positions[now]))
    displaced += float(np.linalg.norm(goal - nominal.positions[-1]))
    way = float(np.linalg.norm(np.diff(nominal.positions[now:], axis=0), axis=1).sum())
    speed = nominal.path_length / state.duration
    detour = DETOUR * displaced**2 / (displaced + way) if displaced else 0.0
    longer = detour / speed / state.duration if speed > 0 else 0.0
    point = np.append(state.position, state.quaternion)
    turns = nominal.space.difference(point, nominal.points[now])[nominal.space.linear :]
    turn = np.linalg.norm(turns.reshape(-1, 3), axis=1).max(initial=0.0) / np.pi
    return max(1.0 - done + longer, float(turn), LEAST_TIME) * state.duration


def _start(system: ConstraintSystem, state: State, nominal: Motion, now: int) -> Boundary:
    """Point and velocities to go on from."""
    position, quaternion = state.position, state.quaternion
    if "position" in system.row_levels:
        # A state off a surface is led back onto it at run time; the plan lies on it.
        position, quaternion = project_pose(system.equalities, state.time, position, quaternion)
    linear, angular = _velocities_now(nominal, now, state)
    turning = angular if len(angular) else None
    return Boundary(0.0, position, rotations_of(quaternion), linear, turning)


def _rest(
    nominal: Motion, now: int, samples: int, duration: float, backing: float
) -> PoseTrajectory:
    """What remains of a motion, over another duration; along its way back and on again first."""
    times, places = np.linspace(0.0, duration, samples), np.arange(now, now + samples)
    if _is_over(nominal, now):
        # Next to nothing: it stays where it ends.
        places[:] = len(nominal) - 1
    points = nominal.points[places]
    if backing:
        way = backing * samples * np.sin(np.pi * np.linspace(0.0, 1.0, samples)) ** 2
        way = np.maximum(places - way, 0.0)
        before = np.minimum(way.astype(int), len(nominal) - 2)
        chord = nominal.space.difference(nominal.points[before + 1], nominal.points[before])
        points = nominal.space.moved(nominal.points[before], (way - before)[:, None] * chord)
    return nominal.with_points(points, times)


def _is_over(nominal: Motion, now: int) -> bool:
    """Whether too little is left of a motion to plan it as it was."""
    return len(nominal) - 1 - now <= FEWEST_LEFT


def _velocities_now(nominal: Motion, now: int, state: State) -> tuple[Floats, Floats]:
    """Velocities at a state, half a step after those of the step that led to it."""
    # Both velocities of the nominal motion change but little within half a step.
    k = min(max(now, 1), len(nominal) - 2)
    share = state.previous_step / (nominal.times[k + 1] - nominal.times[k - 1])
    return (
        state.linear_velocity + share * np.diff(nominal.linear_velocities[k : k + 2], axis=0)[0],
        state.angular_velocity + share * np.diff(nominal.angular_velocities[k : k + 2], axis=0)[0],
    )


def require_state(state: State, space: Space) -> None:
    """Refuse what is not a state of a motion in a space."""
    if not isinstance(state, State):
        raise InputError(f"state must be a State, got {type(state).__name__}")
    rates = f"{space.unit}/s" if len(set(space.units)) == 1 else "in their own units"
    for name, unit, size in (
        ("position", space.unit, space.linear),
        ("linear_velocity", rates, space.linear),
        ("angular_velocity", "rad/s", space.angular),
        ("goal_position", space.unit, space.linear),
    ):
        _arguments.vector(f"state: {name}", getattr(state, name), unit, size)
    _arguments.positive("state: duration", state.duration, "seconds")
    _arguments.not_negative("state: previous_step", state.previous_step)
    for name in ("time", "phase"):
        _arguments.finite(f"state: {name}", getattr(state, name))
