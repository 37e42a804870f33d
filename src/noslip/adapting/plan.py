"""A projected motion fitted by a law: in what time, and whether it comes where it was asked to."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from noslip._values import Value
from noslip.adapting.constants import MOST_SAMPLES
from noslip.adapting.unkept import broken, not_found, unkept
from noslip.boundary import Boundary
from noslip.constraints.system import ConstraintSystem
from noslip.errors import (
    CompromiseWarning,
    ConstraintError,
    ConvergenceError,
    MissedError,
    Refusal,
    muted,
    warn,
)
from noslip.law.fitting import MOST_BASIS_FUNCTIONS, fewest_steps, fit
from noslip.law.law import Law
from noslip.projection.request import Request
from noslip.projection.result import ProjectedTrajectory
from noslip.projection.trajectory import project_heeding_what_it_can, project_nearby
from noslip.rule import Rule, no_rule
from noslip.runtime.motion import Motion
from noslip.runtime.rollout import rollout
from noslip.runtime.timing import Pace, timed, unhurried
from noslip.trajectory import PoseTrajectory
from noslip.verification import followed_with, pose_at, verify

_FAST, _SAME_SPEED, _GROWTHS = 2.0, 1 + 1e-3, 3
"""How many times as fast as its law a motion may be to a goal that is far, what counts as the same
speed, and how often a duration grows: at once in most cases, since shape and duration are apart."""
_AIMED = 6
"""How often a motion is aimed anew: each time it misses a tenth of what it did."""
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

    def verified(self, before: Law, rule: Rule, seeks_remedy: bool = True) -> Adapted:
        """See that it comes where it was asked to; note what it compromises on.

        Parameters
        ----------
        before : Law
            What it was adapted from.
        rule : Rule
        seeks_remedy : bool
            As for :func:`noslip.verification.verify`.

        Raises
        ------
        MissedError
        """
        asked = [boundary for boundary in self.request.boundaries if boundary.at > 0]
        motion, compromise = verify(self.law, rule, asked, seeks_remedy=seeks_remedy)
        turning = _turning(motion, before, rule) if asked[1:] else ""
        noted = self.noting(*filter(None, (compromise, turning)))
        return Adapted(**vars(noted), motion=motion, is_exact=not compromise)


@dataclass(frozen=True, eq=False, kw_only=True)
class Adapted(Plan):
    """What an adaptation comes to: a plan that was verified.

    Attributes
    ----------
    motion : Motion
        Of the law, at its default step: it was seen to come where it was asked to.
    is_exact : bool
        Whether it comes all the way there, at a fine step too.
    """

    motion: Motion
    is_exact: bool = True

    def told(self) -> Adapted:
        """Return it, and warn of its compromises."""
        for note in self.notes:
            warn(note, CompromiseWarning)
        return self


Projecting = Callable[[Request], ProjectedTrajectory]
Planning = Callable[[ConstraintSystem, float | None], Plan]
"""What shapes a path under constraints, in a duration (s) or in what it takes."""


def giving_time(planned: Planning, law: Law, rule: Rule, duration: float | None) -> Adapted:
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
        with muted():
            enough = planned(rule.system, float(pace.needed(duration))).verified(law, rule)
        raise pace.refusal(duration, enough.motion) from error


def at_usual_speed(planned: Callable[[float], Plan], law: Law, duration: float | None) -> Plan:
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
    return _fastest(rollout(law, no_rule(law.space)))


def projected_onto(request: Request) -> ProjectedTrajectory:
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


def projected_along(request: Request) -> ProjectedTrajectory:
    """Project a reference that is a maneuver."""
    found = project_nearby(request)
    limits = request.system.limits
    if not found.converged and any(c.priority for c in limits.constraints):
        hard = replace(request, system=_hard(request.system))
        left_out = tuple(set(limits.names) - set(hard.system.limits.names))
        found = replace(project_nearby(hard), left_out=left_out)
    if not found.converged and (in_the_way := broken(request)):
        raise not_found(request, in_the_way, request.reference)
    if not found.converged:
        raise ConvergenceError(
            "a maneuver leads there, but the iteration onto the constraints did not converge "
            f"(residual {found.residual:.2g} after {found.iterations} iterations); look at the "
            "error's iterate",
            code=Refusal.NOT_CONVERGED,
            iterate=found.trajectory,
        )
    return found


def _hard(system: ConstraintSystem) -> ConstraintSystem:
    return system.part([c.priority == 0 for c in system.constraints])


def carried_out(
    law: Law,
    rule: Rule,
    request: Request,
    steps: int,
    duration: float,
    *,
    functions: int | None = None,
    exact_start: bool = False,
    project: Projecting = projected_onto,
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
        projected = project(aimed)
        found = _fitted(projected.trajectory, law, functions, steps)
        found = replace(found, duration=duration, steps=steps, begin=request.begin)
        if exact_start and 0 in request.twists:
            found = replace(found, start_velocity=np.hstack(request.twists[0]) * duration)
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
            exact &= bool(np.all(turn.magnitude() <= _EXACT_TURN))
            past = replace(past, rotation=turn * past.rotation)
        corrected[boundary.at] = past
    return None if exact else replace(aimed, boundaries=tuple(corrected.values()))


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
            alpha_s=law.clock.alpha_s or 1.0,
            rhythmic=law.clock.returns,
        )

    return followed_with(fitted, [trajectory], functions, MOST_BASIS_FUNCTIONS)[0]
