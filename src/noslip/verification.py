"""What became of the job: a primitive's own motion, held against what was asked of it.

A motion that holds its constraints and misses its goal is a failure.  Whatever makes a primitive
rolls it out, at its default step and at a fine one, and looks where it ends, what it passes, how
far it leaves its way and which hard limits it breaks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip.boundary import Boundary
from noslip.constraints.check import quantity_text
from noslip.errors import CompromiseWarning, MissedError, Refusal, warn
from noslip.law.law import Law
from noslip.law.points import rotation_of
from noslip.projection.metric import inverse_metric
from noslip.projection.pointwise import position_only
from noslip.rule import Rule, no_rule
from noslip.runtime.batch import Motions
from noslip.runtime.motion import Asked, Motion
from noslip.runtime.rollout import rollout
from noslip.trajectory import PoseTrajectory

MISSED, MISSED_TURN = 2e-2, np.radians(2.0)
"""Share of the path, and turn, by which a goal or via point is missed: seen with the eye, and a
hundred times what any primitive needs that goes where it was asked to; the turn for each whole turn
of the motion, and once at least."""
TOLD, TOLD_TURN = 1e-3, np.radians(0.1)
"""The same from which it is told: a user of tenths of a millimeter would want to know."""
BROKEN = 1e-6
"""Violation of a hard limit, in its unit, that is none: of a micrometer, far above rounding."""
FOLLOWED = 1e-3
"""Share of the path by which a law may leave what it was fitted to."""
_FINE, _FINEST = 1e-3, 2000
"""Step of a control loop (s), and the steps at which a motion is that of any finer step to 1e-6."""
_LONGER = (2.0, 5.0)
"""Factors on the duration that are tried for a remedy: beyond, it is not time that lacks."""


@dataclass(frozen=True)
class Deviation:
    """How far a motion is from what it was made for, at worst.

    Attributes
    ----------
    end_error, end_rotation_error : float
        At the goal (m, rad).
    path_error, rotation_error : float
        Anywhere, at the same fraction of the motion (m, rad).
    """

    end_error: float
    end_rotation_error: float
    path_error: float
    rotation_error: float

    @classmethod
    def between(cls, motion: PoseTrajectory, reference: PoseTrajectory) -> Deviation:
        """Return how far a motion is from a reference."""
        distances, angles = deviations(motion, reference)
        return cls(
            float(distances[-1]), float(angles[-1]), float(distances.max()), float(angles.max())
        )


def deviations(motion: PoseTrajectory, reference: PoseTrajectory) -> tuple[Floats, Floats]:
    """Distance (m) and angle (rad) of each sample to a reference at the same fraction of it."""
    fractions = (motion.times - motion.times[0]) / motion.duration
    at = reference.times[0] + fractions * reference.duration
    if len(motion) != len(reference) or not np.allclose(at, reference.times, 1e-9):
        reference = reference.resampled(times=at)
    distances = np.linalg.norm(motion.positions - reference.positions, axis=1)
    # An angle a lies 2 sin(a / 4) apart on the sphere of quaternions, on the nearer side.
    here, there = motion.quaternions, reference.quaternions
    apart = np.minimum(np.linalg.norm(here - there, axis=1), np.linalg.norm(here + there, axis=1))
    return distances, 4 * np.arcsin(apart / 2)


def followed_with(
    fitted: Callable[[Sequence[PoseTrajectory], int], Law],
    followed: Sequence[PoseTrajectory],
    fewest: int,
    most: int,
) -> tuple[Law, float]:
    """Return the law of trajectories, of as many basis functions as it takes to follow each.

    Parameters
    ----------
    fitted : callable
        (trajectories, basis functions) -> law.
    followed : sequence of PoseTrajectory
        Each is asked to be followed alone: the mean of several is not any of them.
    fewest, most : int
        Their number is doubled from the fewest on, until none is left by a thousandth of its path
        or of its turning (of a whole turn at least).

    Returns
    -------
    (Law, float)
        Of all of them; and how far one is left, over its path or turning.
    """

    def alone(one: PoseTrajectory, count: int) -> tuple[Law, float]:
        law = fitted([one], count)
        motion = rollout(law, no_rule(law.space), time_step=law.duration / (len(one) - 1))
        off = Deviation.between(motion, one)
        way, turning = max(one.path_length, BROKEN), max(_turning(one), 2 * np.pi)
        return law, max(off.path_error / way, off.rotation_error / turning)

    count = fewest
    while True:
        laws, offs = zip(*(alone(one, count) for one in followed), strict=True)
        if max(offs) <= FOLLOWED or 2 * count > most:
            return laws[0] if len(laws) == 1 else fitted(followed, count), max(offs)
        count *= 2


def verify(
    law: Law,
    rule: Rule,
    asked: Sequence[Boundary],
    *,
    strict: bool = True,
    seeks_remedy: bool = True,
) -> tuple[Motion, str]:
    """Roll a law out under its rule, and see that it comes where it was asked to.

    Parameters
    ----------
    law : Law
    rule : Rule
    asked : sequence of Boundary
        Poses, or parts of them, to pass and to end in.
    strict : bool
        Whether to raise; else all is a compromise.
    seeks_remedy : bool
        Whether it is tried what else would do, which takes seconds.

    Returns
    -------
    (Motion, str)
        At the default step; and a sentence if it comes near, but not there, else an empty one.

    Raises
    ------
    MissedError
        If it misses one of them or breaks a hard limit; what else would do is tried, and told.
    """
    motions = _at_steps(law, rule)
    wrong = _wrong(motions, rule, asked)
    if wrong is None:
        return motions[0], ""
    is_failure, text = wrong
    if seeks_remedy:
        missed = _missed(text, motions[0], law, rule, asked)
    else:
        text += "; choose other ends, or a longer duration"
        missed = MissedError(text, code=Refusal.MISSED, iterate=motions[0])
    if is_failure and strict:
        raise missed
    return motions[0], str(missed)


def _at_steps(law: Law, rule: Rule, duration: float | None = None) -> list[Motion]:
    """The motion at its default step, and at a fine one if that is finer."""
    usual = rollout(law, rule, duration=duration)
    fine = max(_FINE, usual.duration / _FINEST)
    if fine >= 0.9 * usual.period:
        return [usual]
    return [usual, rollout(law, rule, duration=duration, time_step=fine)]


def tell(law: Law, rule: Rule, motion: Motion) -> None:
    """Warn if a motion of a law breaks a hard limit or ends elsewhere than at its goal.

    Of the law's own motion that was told when the law was made; longer steps are another matter.

    Warns
    -----
    CompromiseWarning
    """
    wrong = _wrong([motion], rule, [_goal_of(motion)])
    if wrong is None:
        return
    remedy = "adapt to what is asked, and a way there is planned"
    if law.clock.returns:
        remedy = "constraints lead it there: learn a rhythm of that size, or from nearer its cycle"
    usual = rollout(law, rule)
    if _same_task(motion, usual):
        if motion.period <= usual.period or any(_misses(usual, rule, [_goal_of(usual)])):
            return
        remedy = f"the default step of {usual.period:.3g} s mends that"
    warn(f"{wrong[1]}; {remedy}", CompromiseWarning)


def _same_task(motion: Motion, other: Motion) -> bool:
    """Whether two motions of a law have the same start, goal and duration."""
    one, another = motion.asked, other.asked
    assert isinstance(one, Asked)
    assert isinstance(another, Asked)
    same_start = np.array_equal(one.start.vector(), another.start.vector())
    same_time = abs(motion.duration - other.duration) <= 1e-9 * other.duration
    return same_start and same_time and _goal_of(motion) == _goal_of(other)


def tell_many(law: Law, rule: Rule, motions: Motions) -> None:
    """Warn if some of many motions end elsewhere than at their goals, or break a hard limit.

    Warns
    -----
    CompromiseWarning
    """
    off, turned = motions.end_errors, motions.end_rotation_errors
    far = off > TOLD * motions.path_lengths + BROKEN
    missed = far | (turned > TOLD_TURN)
    for k in np.flatnonzero(missed & ~far):
        missed[k] = turned[k] > TOLD_TURN * _whole_turns(motions[int(k)])
    if missed.any():
        warn(
            f"{missed.sum()} of {len(motions)} motions end up to {quantity_text(off.max(), 'm')} "
            f"and {np.degrees(turned.max()):.2g} degrees from their goals; adapt to each, and a "
            "way there is planned",
            CompromiseWarning,
        )
    limits = rule.system.limits
    hard = np.array(limits.per_row(c.priority == 0 for c in limits.constraints), dtype=bool)
    # One after another: thousands of motions are not copied.
    least = np.array([margins[:, hard].min(initial=np.inf) for margins in motions.margins])
    if (least < -BROKEN).any():
        warn(
            f"{(least < -BROKEN).sum()} of {len(motions)} motions break a hard limit, motion "
            f"{int(least.argmin())} by {-least.min():.3g}; adapt to each, from starts inside of it",
            CompromiseWarning,
        )


def misses_goal(motion: Motion) -> bool:
    """Whether a motion fails to come to its goal."""
    return any(is_failure for is_failure, _ in _missed_poses(motion, [_goal_of(motion)]))


def require_hard_limits(law: Law, rule: Rule) -> None:
    """Refuse a law whose motion breaks a hard limit.

    Raises
    ------
    MissedError
    """
    motion = rollout(law, rule)
    if wrong := _wrong([motion], rule, ()):
        raise _missed(wrong[1], motion, law, rule, ())


def _goal_of(motion: Motion) -> Boundary:
    return Boundary(1.0, *motion.asked.goal)


def _wrong(
    motions: Sequence[Motion], rule: Rule, asked: Sequence[Boundary]
) -> tuple[bool, str] | None:
    """All that the first motion which fails, or else compromises, does not do as asked."""
    found = [wrong for motion in motions if (wrong := list(_misses(motion, rule, asked)))]
    if not found:
        return None
    worst = max(found, key=lambda wrong: any(is_failure for is_failure, _ in wrong))
    return any(is_failure for is_failure, _ in worst), "the motion " + ", and ".join(
        text for _, text in worst
    )


def _misses(motion: Motion, rule: Rule, asked: Sequence[Boundary]) -> Iterator[tuple[bool, str]]:
    """What a motion does not do as asked: whether that is a failure, and in words."""
    yield from _broken_limits(motion, rule)
    yield from _missed_poses(motion, asked)


def _broken_limits(motion: Motion, rule: Rule) -> Iterator[tuple[bool, str]]:
    limits = rule.system.limits
    hard = [c.priority == 0 for c in limits.constraints]
    rows = zip(
        limits.row_names, limits.row_units, limits.per_row(hard), motion.margins.T, strict=True
    )
    for name, unit, is_hard, margin in rows:
        # What starts outside is led in; then it counts from when it is in.
        inside = np.maximum.accumulate(margin >= -BROKEN)
        worst = float(margin[inside].min(initial=0.0)) if inside.any() else float(margin[-1])
        if is_hard and worst < -BROKEN:
            yield True, f"breaks {name} by {quantity_text(-worst, unit)}"


def _missed_poses(motion: Motion, asked: Sequence[Boundary]) -> Iterator[tuple[bool, str]]:
    length, turns = motion.path_length, _whole_turns(motion)
    for boundary in asked:
        position, rotation = pose_at(motion, boundary.at)
        off = turned = 0.0
        if boundary.position is not None:
            off = float(np.linalg.norm(position - boundary.position))
        if boundary.rotation is not None and motion.space.rotations:
            turned = float(np.max((rotation * boundary.rotation.inv()).magnitude()))
        if off <= TOLD * length + BROKEN and turned <= TOLD_TURN * turns:
            continue
        times = "times" if off > length else "of"
        share = f" ({off / length:.2g} {times} its path)" if length else ""
        parts = [quantity_text(off, motion.unit) + share] if off else []
        parts += [f"{np.degrees(turned):.2g} degrees"] if turned > TOLD_TURN * turns else []
        passes = "ends" if boundary.at == 1 else "passes"
        target = "its goal" if boundary.at == 1 else f"via {boundary.at:g}"
        is_failure = off > MISSED * length + BROKEN or turned > MISSED_TURN * turns
        yield is_failure, f"{passes} {' and '.join(parts)} from {target}"


def _whole_turns(motion: PoseTrajectory) -> float:
    return max(1.0, _turning(motion) / (2 * np.pi))


def _turning(motion: PoseTrajectory) -> float:
    """All turns of a motion together (rad)."""
    # A rollout's velocities are those of its steps; of others this is near enough.
    return float(np.linalg.norm(motion.angular_velocities[1:], axis=1) @ np.diff(motion.times))


def pose_at(motion: PoseTrajectory, fraction: float) -> tuple[Floats, Rotation]:
    """Pose at a fraction of a motion, on the chord between two samples."""
    time = motion.times[0] + fraction * motion.duration
    k = int(np.clip(np.searchsorted(motion.times, time, "right") - 1, 0, len(motion) - 2))
    share = (time - motion.times[k]) / (motion.times[k + 1] - motion.times[k])
    space, (before, after) = motion.space, motion.points[k : k + 2]
    point = space.moved(before, share * space.difference(after, before))
    return point[: space.linear], rotation_of(point[space.linear :])


def _missed(
    text: str, motion: Motion, law: Law, rule: Rule, asked: Sequence[Boundary]
) -> MissedError:
    """What is wrong with a motion, and what mends it."""
    remedy, duration = _remedy(law, rule, asked)
    code = Refusal.MISSED if duration is None else Refusal.TOO_FAST
    return MissedError(f"{text}; {remedy}", code=code, iterate=motion, duration=duration)


def _remedy(law: Law, rule: Rule, asked: Sequence[Boundary]) -> tuple[str, float | None]:
    """What makes it do as asked, and the duration (s) if that does: one after another is tried."""

    def does(rule: Rule, duration: float | None = None) -> bool:
        return _wrong(_at_steps(law, rule, duration), rule, asked) is None

    system = rule.system
    if rule.inverse_metric == position_only(system.space) and system.size:
        usual = rollout(law, no_rule(law.space)).path_length / law.steps
        if does(replace(rule, inverse_metric=inverse_metric(system, "shared", None, usual))):
            return "metric 'shared' mends that", None
    for factor in _LONGER:
        if does(rule, longer := factor * law.duration):
            return f"a duration of {longer:.3g} s, not {law.duration:.3g}, mends that", longer
    if system.limits.size and does(replace(rule, system=system.equalities)):
        names = ", ".join(system.limits.names)
        return f"{names} in its way: loosen that, or choose ends farther from it", None
    others = ["other ends or via points" if asked[1:] else "other ends"]
    others += ["a path farther from the limits"] if system.limits.size else []
    return (
        f"no metric that was tried mends that, nor {_LONGER[-1]:g} times the duration: choose "
        f"{', '.join(others)} or more basis functions"
    ), None
