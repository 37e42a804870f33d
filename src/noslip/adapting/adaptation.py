"""A motion moved to other ends, projected, and a primitive fitted to it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from noslip import _arguments
from noslip._values import Value
from noslip.adapting import compiled
from noslip.adapting.connecting import Connection, Shape, Way, eased
from noslip.adapting.constants import FEWEST_SAMPLES, MOST_SAMPLES
from noslip.adapting.ends import Velocity, asked, moving, placed, require_feasible
from noslip.adapting.unkept import unkept
from noslip.boundary import Boundary, End
from noslip.constraints.check import quantity_text
from noslip.constraints.system import ConstraintSystem
from noslip.errors import (
    CompromiseWarning,
    ConstraintError,
    ConvergenceError,
    InputError,
    MissedError,
    Refusal,
    muted,
    warn,
)
from noslip.law.fitting import MOST_BASIS_FUNCTIONS, fewest_steps, fit
from noslip.law.law import Law
from noslip.law.scaling import Scaling, scaled
from noslip.projection.blend import through
from noslip.projection.request import ADAPTING, MOST_ATTEMPTS, Request, Weights
from noslip.projection.result import ProjectedTrajectory
from noslip.projection.trajectory import project_heeding_what_it_can, project_nearby
from noslip.rule import Rule
from noslip.runtime.motion import Motion
from noslip.runtime.rollout import initial_state, motion_from, rollout
from noslip.runtime.timing import Pace, stretched, timed, unhurried
from noslip.trajectory import PoseTrajectory
from noslip.verification import followed_with, pose_at, verify

_FAST, _SAME_SPEED, _GROWTHS = 2.0, 1 + 1e-3, 3
"""How many times as fast as its law a motion may be to a goal that is far, what counts as the same
speed, and how often a duration grows: at once in most cases, since shape and duration are apart."""
_HURRIED = 1
"""Attempts at a motion near the demonstration's, where maneuvers lead to the goal as well."""
_PER_GAP, _AIMED = 2, 6
"""Basis functions from one place to pass to the next, which are to be told apart, and how often a
motion is aimed anew: each time it misses a tenth of what it did."""
_EXACT, _EXACT_TURN = 1e-6, 1e-6
"""Share of the path, and turn (rad), that a via point may be missed by."""


@dataclass(frozen=True, eq=False)
class Plan(Value):
    """A law and how it was found; not yet seen to come where it was asked to.

    Attributes
    ----------
    law : Law
        Fitted to the projected trajectory.
    request : Request
        What was projected: the unconstrained motion, moved to the boundaries.
    projected : ProjectedTrajectory
    notes : tuple of str
        What a person should know of it: compromises.
    maneuver : str
        That it was planned from, such as "right-straight-left, 2.31 m"; empty of the
        demonstration's own motion, led elsewhere.
    """

    law: Law
    request: Request
    projected: ProjectedTrajectory
    notes: tuple[str, ...] = ()
    maneuver: str = ""

    def noting(self, *notes: str) -> Plan:
        """Return the same with more notes."""
        return replace(self, notes=(*self.notes, *notes))

    def verified(self, before: Law, rule: Rule) -> Adapted:
        """See that it comes where it was asked to; note what it compromises on.

        Parameters
        ----------
        before : Law
            What it was adapted from.

        Raises
        ------
        MissedError
        """
        asked = [boundary for boundary in self.request.boundaries if boundary.at > 0]
        motion, compromise = verify(self.law, rule, asked)
        turning = _turning(motion, before, rule) if asked[1:] else ""
        return Adapted(**vars(self.noting(*filter(None, (compromise, turning)))), motion=motion)


@dataclass(frozen=True, eq=False, kw_only=True)
class Adapted(Plan):
    """What an adaptation comes to: a plan that was verified.

    Attributes
    ----------
    motion : Motion
        Of the law, at its default step: it was seen to come where it was asked to.
    """

    motion: Motion

    def told(self) -> Adapted:
        """Return it, and warn of its compromises."""
        for note in self.notes:
            warn(note, CompromiseWarning)
        return self


Projecting = Callable[[Request], ProjectedTrajectory]
Planning = Callable[[ConstraintSystem, float | None], Plan]
"""What shapes a path under constraints, in a duration (s) or in what it takes."""


def _giving_time(planned: Planning, law: Law, rule: Rule, duration: float | None) -> Adapted:
    """Let time give way before the path, or refuse a duration in which neither may; verify it."""
    first: Plan | None = None

    def carried_out(shaping: ConstraintSystem, factor: float) -> Plan:
        nonlocal first
        if first is None or factor == 1:
            first = planned(shaping, duration)
            return first
        return planned(shaping, factor * first.law.duration)

    def own_motion(found: Plan, timeless: ConstraintSystem) -> Motion:
        return rollout(found.law, replace(rule, system=timeless))

    if not any(timed(rule.system)):
        return planned(rule.system, duration).verified(law, rule)
    found, pace = unhurried(rule.system, carried_out, own_motion, longer=duration is None)
    if pace.factor == 1:
        return found.verified(law, rule)
    if duration is None:
        taken = replace(pace, factor=found.law.duration / law.duration)
        return found.noting(taken.told(found.law.duration)).verified(law, rule)
    # So it is asked for: the path is reshaped, if that helps.
    refused = pace.refused(duration)
    try:
        reshaped = planned(rule.system, duration)
        kept = pace.name not in reshaped.projected.left_out
        note = pace.reshaped(duration) if kept else refused
        return reshaped.noting(note).verified(law, rule)
    except (ConvergenceError, MissedError) as error:
        if pace.is_soft:
            with suppress(MissedError):
                return found.noting(refused).verified(law, rule)
        # What is told must do; where that is refused too, it is not time that lacks.
        refusal = pace.refusal(duration, stretched(found.projected.trajectory, pace.factor))
        with muted():
            planned(rule.system, refusal.duration).verified(law, rule)
        raise refusal from error


def adapt(
    law: Law,
    rule: Rule,
    *,
    goal_position: ArrayLike | None = None,
    goal_rotation: Rotation | None = None,
    goal_velocity: Velocity = None,
    start_position: ArrayLike | None = None,
    start_rotation: Rotation | None = None,
    start_velocity: Velocity = None,
    duration: float | None = None,
    via: Iterable[Boundary | Sequence[Any]] = (),
    scaling: Scaling = "none",
    shape: Shape = "demonstrated",
    reverse: bool | None = None,
    start: End = "pose",
    end: End = "pose",
    samples: int | None = None,
    position_weight: float = ADAPTING.position,
    position_smoothing: float = ADAPTING.position_smoothing,
    rotation_smoothing: float = ADAPTING.rotation_smoothing,
) -> Adapted:
    """Find a law that starts, passes and ends elsewhere, and keeps the constraints.

    The law is rolled out without constraints, its motion moved to the new boundary values,
    projected onto the constraints with these values fixed, and fitted again.  Where that leads
    nowhere, backs up unasked, or goes astray, as it does to a goal behind a car, the motion is
    planned from a maneuver: the demonstration as far as it leads on, then arcs and straights in
    closed form, projected likewise.  ``record`` names it.

    Parameters
    ----------
    law : Law
    rule : Rule
    goal_position, start_position : array, shape (3,), optional
        Meters; those of the law by default.
    goal_rotation, start_rotation : Rotation, optional
    goal_velocity, start_velocity : 0, array of shape (3,) or (6,), or "free", optional
        At rest (0), or linear velocity (m/s), then angular (rad/s), world frame; projected onto
        the constraints.  By default that of the law, turned with the tool where constraints tie
        velocities to it: what rests at an end rests there, and a blade that ends moving forward
        moves forward in its new heading.  "free" is whatever suits the motion; so it is by default
        where the motion does not rest at an end of which ``start`` or ``end`` keeps but a part.
    duration : float, optional
        tau (s).  By default that of the law, or what it takes to a goal so far that the motion
        would be more than twice as fast; and as much longer as limits on speeds, rates and
        accelerations need that the path stays as it is, told by a warning.  If given, the path is
        reshaped for such limits.
    via : sequence of (at, position), (at, position, rotation) or Boundary
        Points or poses to pass, at fractions of the duration.
    scaling : "none", "difference" or "rotation-dilation"
        How the path follows a new goal before it is projected, see
        :func:`noslip.law.scaling.scaled`.  Without scaling the displacement
        grows along the motion by minimum jerk.  Where the path turns, orientations that are
        not named turn along.
    shape : "demonstrated" or "shortest"
        Whether the demonstration's shape is kept as far as it leads to the goal, or the motion is
        planned from the shortest maneuver.
    reverse : bool, optional
        Whether the tool may back up where that is shorter; by default where a
        :class:`noslip.constraints.TurningRadius` that is declared lets it.
    start, end : "free", "position", "rotation" or "pose"
        What of the start and the goal is kept to; all of it by default.  What is not named in
        the call is that of the law.
    samples : int, optional
        Of the projection; by default one a step, from 4 a basis function up to 2001.
    position_weight, position_smoothing, rotation_smoothing : float
        Of the projection, see :func:`noslip.project_trajectory`.

    Raises
    ------
    InputError, ConstraintError
        If an argument is not what it must be, or no motion under the constraints can end there.
    ConvergenceError
        If the projection does not converge.
    MissedError
        If the law's motion misses the goal, a via point or a hard limit, or such a limit cannot be
        kept in the duration given; the message says in which it can.
    """
    if duration is not None:
        duration = _arguments.positive("duration", duration, "seconds")
    passed = Boundary.vias(via)
    functions, gap = law.basis.count, np.diff([0.0, *(place.at for place in passed), 1.0]).min()
    while functions * gap < _PER_GAP and 2 * fewest_steps(functions) < MOST_SAMPLES:
        functions *= 2
    steps = law.steps * -(-fewest_steps(functions) // law.steps)
    count = samples_of(functions, steps, samples)
    named = {
        "start": (start_position, start_rotation, start_velocity),
        "goal": (goal_position, goal_rotation, goal_velocity),
    }
    free = law
    if scaling != "none":
        free = scaled(law, scaling, start_position=start_position, goal_position=goal_position)

    weights = Weights(position_weight, position_smoothing, rotation_smoothing)
    is_plain = (start, end) == ("pose", "pose") and not passed
    is_plain &= all(value is None for value in (*named["start"], goal_velocity))

    @lru_cache(maxsize=2)
    def own_motion(tau: float) -> Motion:
        begun = initial_state(free, rule, duration=tau)
        return motion_from(free, Rule(), begun, tau / (count - 1))

    def ends(own: Motion, rule: Rule, tau: float) -> tuple[Boundary, Boundary]:
        def reached(name: Literal["start", "goal"], *of_law: Any, at: float, kept: End) -> Boundary:
            place = placed(asked(name, *named[name]), of_law, rule.system, rule.inverse_metric, at)
            if named[name][2] is not None:
                return place.part(kept)
            return moving(place, own, rule, at, kept)

        return (
            reached("start", law.start_position, free.start_rotation, at=law.begin, kept=start),
            reached("goal", law.goal_position, free.goal_rotation, at=law.begin + tau, kept=end),
        )

    def carried(rule: Rule, request: Request, tau: float, project: Projecting) -> Plan:
        first = request.boundaries[0]
        # A velocity that is merely kept gives way, by some 1e-4 of its peak, to the plan's first
        # step; else the motion would end 5e-6 of its path off.
        exact = start_velocity is not None or not first.moves
        taken = round(steps * max(1.0, tau / law.duration)) if project is _driven else steps
        return carried_out(
            free,
            rule,
            request,
            min(taken, max(steps, MOST_SAMPLES - 1)),
            tau,
            functions=functions,
            exact_start=exact,
            project=project,
        )

    def nearby(attempts: int, system: ConstraintSystem, seconds: float | None) -> Plan:
        held = replace(rule, system=system)
        to = asked("goal", goal_position, goal_rotation).pose_or(
            law.goal_position, free.goal_rotation
        )

        def planned(tau: float) -> Plan:
            if is_plain:
                if made := compiled.made(
                    free, held, to, weights, duration=tau, samples=count, steps=steps
                ):
                    return Plan(made.law, made.request, made.projected)
                if attempts < MOST_ATTEMPTS and compiled.is_ready(held, weights):
                    raise ConvergenceError(
                        "no motion near the demonstration's found", code=Refusal.NOT_FOUND
                    )
            own = own_motion(tau)
            first, last = ends(own, held, tau)
            request = Request(
                own, system, (first, *passed, last), weights, begin=law.begin, attempts=attempts
            )
            for place in passed:
                time = request.begin + place.at * tau
                require_feasible(system, f"via at {place.at:g}", time, place)
            request = replace(request, reference=through(own, request.boundaries))
            return carried(held, request, tau, _projected)

        return _in_time(planned, law, seconds)

    def driven(way: Way, system: ConstraintSystem, seconds: float | None) -> Plan:
        held = replace(rule, system=system)

        def planned(tau: float) -> Plan:
            assert connection is not None
            boundaries = ends(own_motion(tau), held, tau)
            reference = connection.reference(way, tau, count)
            request = Request(reference, eased(system), boundaries, weights, begin=law.begin)
            request = replace(request, reference=through(reference, boundaries))
            return replace(carried(held, request, tau, _driven), maneuver=str(way))

        assert connection is not None
        needed = connection.time_needed(way)
        if seconds is not None or needed <= law.duration:
            return _in_time(planned, law, seconds)
        return planned(needed).noting(
            f"the motion takes {needed:.3g} s, not {law.duration:.3g}, at the pace of its law: "
            f"{way}; give a duration if it may be faster"
        )

    def in_time(planning: Planning) -> Adapted:
        return _giving_time(planning, law, rule, duration)

    connection = None
    if (start, end) == ("pose", "pose") and not passed:
        own = own_motion(duration or law.duration)
        boundaries = ends(own, rule, duration or law.duration)
        connection = Connection.of(rule.system, own, *boundaries, reverse=reverse)
    patiently = partial(nearby, MOST_ATTEMPTS)
    if connection is None or not connection.proposals:
        return in_time(patiently).told()
    found: Adapted | None = None
    failed: Exception | None = None
    if shape == "demonstrated" and connection.is_near:
        try:
            found = in_time(partial(nearby, _HURRIED))
        except (ConvergenceError, MissedError) as error:
            failed = error
        if found is not None and connection.accepts(found.motion):
            return found.told()
    for way in connection.ways(shape == "shortest"):
        try:
            return in_time(partial(driven, way)).told()
        except (ConvergenceError, MissedError) as error:
            failed = failed or error
    if found is None:
        found = in_time(patiently)
    if back := connection.backs_up(found.motion):
        told = (
            f"the motion backs up along {quantity_text(back, 'm')}; declare ForwardOnly where it "
            "must not, or ask for it (reverse=True)"
        )
        found = replace(found, notes=(*found.notes, told))
    return found.told()


def _in_time(planned: Callable[[float], Plan], law: Law, duration: float | None) -> Plan:
    """Plan a motion in its duration, or in a longer one in which it is not much too fast.

    If it takes longer, or is too fast for a path so long, a note tells.
    """
    usual, tau = _usual_speed(law), duration or law.duration
    found = planned(tau)
    # Speed over what is fast enough, and that which the duration asked for does not make up for.
    peak = _fastest(found.projected.trajectory)
    excess = peak / usual / _FAST if usual else 0.0
    if min(excess, excess * tau / law.duration) <= _SAME_SPEED:
        return found
    told = f"at {peak:.3g} m/s, {peak / usual:.3g} times as fast as its law does"
    if duration is None:
        try:
            longer = found
            # Rules with a time of their own do not just take longer.
            for _ in range(_GROWTHS):
                more = _fastest(longer.projected.trajectory) / usual / _FAST
                if more > _SAME_SPEED:
                    longer = planned(longer.law.duration * more)
            return longer.noting(
                f"the motion takes {longer.law.duration:.3g} s, not {law.duration:.3g}, in which "
                f"it would move {told}; give a duration if it may"
            )
        except (ConstraintError, ConvergenceError, MissedError):
            pass
    needed = Pace(excess).needed(tau)
    return found.noting(f"the motion moves {told}; a duration of {needed} s or more mends that")


def _fastest(motion: PoseTrajectory) -> float:
    return float(np.linalg.norm(motion.step_velocities()[0], axis=1).max())


# One law is adapted to many goals.
@lru_cache(maxsize=16)
def _usual_speed(law: Law) -> float:
    return _fastest(rollout(law, Rule()))


def samples_of(functions: int, steps: int, samples: int | None) -> int:
    """Return how many samples an adaptation to a law of so many functions and steps takes."""
    if samples is None:
        return min(max(steps, fewest_steps(functions)) + 1, MOST_SAMPLES)
    samples = _arguments.count("samples", samples, MOST_SAMPLES)
    if samples < FEWEST_SAMPLES:
        raise InputError(f"samples must be {FEWEST_SAMPLES} or more, got {samples}")
    return samples


def carried_out(
    law: Law,
    rule: Rule,
    request: Request,
    steps: int,
    duration: float,
    *,
    functions: int | None = None,
    exact_start: bool = False,
    project: Projecting | None = None,
) -> Plan:
    """Project a reference that meets its boundaries, fit a law of so many steps or more.

    The fit begins with the velocity that leads onto the path, or exactly with what was asked for.
    What its motion misses of a via point, between two samples or by the fit, is aimed past it.
    """
    functions = functions or law.basis.count
    steps = max(steps, fewest_steps(functions))
    asked = [boundary for boundary in request.boundaries if boundary.at > 0]
    aimed = request
    for _ in range(_AIMED):
        projected = (project or _projected)(aimed)
        found = _fitted(projected.trajectory, law, functions, steps)
        found = replace(found, duration=duration, steps=steps, begin=request.begin)
        if exact_start and 0 in request.twists:
            found = replace(found, start_velocity=np.concatenate(request.twists[0]) * duration)
        if len(asked) == 1 or (past := _aimed_past(aimed, asked, rollout(found, rule))) is None:
            break
        aimed = past
    else:
        gap = np.diff([0.0, *(b.at for b in asked)]).min()
        raise MissedError(
            f"no motion found that passes all of {', '.join(f'{b.at:g}' for b in asked)}: places "
            f"{gap:.2g} of the motion apart may be too far from each other for that; leave more of "
            "it between them",
            code=Refusal.NOT_FOUND,
            iterate=projected.trajectory,
        )
    return Plan(found, request, projected)


def _turning(motion: Motion, law: Law, rule: Rule) -> str:
    """Say that a motion turns much faster than its law, to pass what it was asked to."""
    peak, usual = (
        float(np.linalg.norm(m.step_velocities()[1], axis=1).max())
        for m in (motion, rollout(law, rule))
    )
    if peak <= _FAST * usual:
        return ""
    return (
        f"to pass its via points the motion turns at {peak:.3g} rad/s, not {usual:.3g}; give it a "
        "longer duration, or via points farther apart or nearer to its path"
    )


def _aimed_past(aimed: Request, asked: Sequence[Boundary], motion: Motion) -> Request | None:
    """Return a request aimed past what a motion misses by as much; None where it misses nothing."""
    corrected, exact = {b.at: b for b in aimed.boundaries}, True
    for boundary in asked:
        position, rotation = pose_at(motion, boundary.at)
        past = corrected[boundary.at]
        if boundary.position is not None and past.position is not None:
            missed = boundary.position - position
            exact &= bool(np.linalg.norm(missed) <= _EXACT * motion.path_length)
            past = replace(past, position=past.position + missed)
        if boundary.rotation is not None and past.rotation is not None:
            turn = boundary.rotation * rotation.inv()
            exact &= bool(turn.magnitude() <= _EXACT_TURN)
            past = replace(past, rotation=turn * past.rotation)
        corrected[boundary.at] = past
    return None if exact else replace(aimed, boundaries=tuple(corrected.values()))


def _projected(request: Request) -> ProjectedTrajectory:
    """Project a reference that meets its boundaries, heeding every hard limit."""
    projected = project_heeding_what_it_can(request)
    limits = request.system.limits
    left_out = [
        name
        for name, constraint in zip(limits.names, limits.constraints, strict=True)
        if constraint.priority == 0 and name in projected.left_out
    ]
    if left_out:
        raise unkept(request, projected, left_out)
    return projected


def _driven(request: Request) -> ProjectedTrajectory:
    """Project a reference that is a maneuver."""
    found = project_nearby(request)
    if not found.converged:
        raise ConvergenceError(
            "a maneuver leads there, but the iteration onto the constraints did not converge "
            f"(residual {found.residual:.2g} after {found.iterations} iterations); look at the "
            "error's iterate",
            code=Refusal.NOT_CONVERGED,
            iterate=found.trajectory,
        )
    return found


def _fitted(trajectory: PoseTrajectory, law: Law, functions: int, steps: int) -> Law:
    """Fit a law like another one, of the basis functions that it takes."""
    samples = min(steps + 1, MOST_SAMPLES)
    if len(trajectory) < samples:
        times = np.linspace(trajectory.times[0], trajectory.times[-1], samples)
        trajectory = trajectory.resampled(times=times)

    def fitted(trajectories: Sequence[PoseTrajectory], count: int) -> Law:
        return fit(
            trajectories,
            basis_functions=count,
            alpha=law.attractor.alpha,
            beta=law.attractor.beta,
            alpha_s=law.clock.alpha_s,
        )

    return followed_with(fitted, [trajectory], functions, MOST_BASIS_FUNCTIONS)[0]
