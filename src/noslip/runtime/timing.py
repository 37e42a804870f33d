"""Time gives way before the path: the least duration in which a motion keeps its limits.

Run through uniformly slower, by a factor s, a motion passes the same poses; its velocities fall by
s, its accelerations by s^2.  Each row of a limit on these tells its own least factor, the root of
its least margin along the motion; the largest of them is the motion's (time scaling: Hollerbach
1984).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
import scipy

from noslip._typing import Floats
from noslip.constraints.declaration import Constraint, constraint_function
from noslip.constraints.system import ConstraintSystem
from noslip.errors import CompromiseWarning, MissedError, Refusal, warn
from noslip.runtime.motion import HELD, Motion
from noslip.trajectory import PoseTrajectory

T = TypeVar("T")

_SLOWEST = 1e4
"""Factor beyond which a limit asks for rest, which no duration gives."""
_BEYOND = 1e-9
"""By which a factor exceeds its root, relative: there the margin is no longer negative."""
_SAME = 1e-6
"""Relative difference of durations that is rounding: that of numbers as they are printed."""
_LEAST = 0.98
"""A duration is not called the least where so much of it would do."""
_ROUNDS = 4
"""A rule that depends on the time changes the path a little as it takes longer; else one is enough
to find the duration, and another to see that it is."""


@dataclass(frozen=True)
class Pace:
    """How much slower a motion must be run through.

    Attributes
    ----------
    factor : float
        On its duration.
    name : str
        Of the limit that asks for it; empty if none does.
    is_soft : bool
        Whether that limit may give way.
    """

    factor: float
    name: str = ""
    is_soft: bool = False

    def told(self, duration: float) -> str:
        """Say that a duration has been lengthened to this one (s)."""
        return (
            f"the motion takes {duration:.4g} s instead of {duration / self.factor:.4g} s, the "
            f"least in which it keeps {self.name!r} along its path; raise that limit for a faster "
            "one"
        )

    def refused(self, duration: float) -> str:
        """Say that a duration (s) is too short, and which is not."""
        return (
            f"{self.name!r} cannot be kept in {duration:.4g} s: along its path the motion takes "
            f"{self.needed(duration)} s; give it that, or leave the duration out"
        )

    def refusal(self, duration: float, motion: PoseTrajectory) -> MissedError:
        """Return the same as an error, with a motion along that path."""
        return MissedError(
            self.refused(duration),
            code=Refusal.TOO_FAST,
            iterate=motion,
            duration=float(self.needed(duration)),
        )

    def reshaped(self, duration: float) -> str:
        """Say that a motion keeps the limit in a duration (s), but is another."""
        return (
            f"{self.name!r} is kept in {duration:.4g} s by a motion of another shape; of its own "
            f"it takes {self.needed(duration)} s"
        )

    def needed(self, duration: float) -> str:
        """Seconds instead of a duration (s), rounded up: what is told must do."""
        needed = self.factor * duration
        unit = 10.0 ** (np.floor(np.log10(needed)) - 3)
        return f"{np.ceil(needed / unit) * unit:.4g}"


def unhurried(
    system: ConstraintSystem,
    carry_out: Callable[[ConstraintSystem, float], T],
    run: Callable[[T, ConstraintSystem], Motion],
    *,
    longer: bool = True,
) -> tuple[T, Pace]:
    """Carry something out with a duration in which its motion keeps the limits on its velocities.

    Limits on velocities and accelerations are first left out: the path is not to bend for them.
    Those that no duration satisfies take part after all, each for itself or, the softest first,
    because they contradict each other.

    Parameters
    ----------
    system : ConstraintSystem
    carry_out : callable
        Called with what shapes the path, and a factor on the duration.
    run : callable
        The motion of what was carried out, under constraints that say nothing of its speed.
    longer : bool
        Whether the duration may grow; else it is only told by how much it should.

    Returns
    -------
    What was carried out, and the factor on its duration (if not ``longer``: that it lacks).
    """
    hurrying = timed(system)
    timeless = system.part([not h for h in hurrying])
    total, rounds, was_shortened = Pace(1.0), 0, False
    while any(hurrying):
        found = carry_out(system.part([not h for h in hurrying]), total.factor)
        motion, limits = run(found, timeless), system.part(hurrying)
        asked = paces(motion, limits)
        needed = [each for each in asked if each is not None]
        rounds += 1
        if len(needed) < len(asked) or rounds > _ROUNDS:
            # Each for itself asks for no duration, or together they do: the softest is given up.
            softest = max(c.priority for c in limits.constraints)
            lost = [
                each is None if total.factor == 1 else c.priority == softest
                for c, each in zip(limits.constraints, asked, strict=True)
            ]
            given_up = iter(lost)
            hurrying = [h and not next(given_up) for h in hurrying]
            total, rounds, was_shortened = Pace(1.0), 0, False
            continue
        more = max(needed, key=_factor)
        if more.factor == 1 and not was_shortened and total.factor > 1:
            # A motion that was a jerk when it was fast may be none: once, that is made up for.
            enough = paces(motion, limits, 1 / total.factor)
            least = max((each for each in enough if each is not None), key=_factor)
            more = least if least.factor < _LEAST else more
            rounds, was_shortened = 0, True
        if more.factor == 1:
            return found, total
        total = replace(more, factor=total.factor * more.factor)
        if not longer:
            return found, total
    return carry_out(system, 1.0), Pace(1.0)


def _factor(pace: Pace) -> float:
    return pace.factor


def require_time(usual: Motion, system: ConstraintSystem, duration: float) -> None:
    """Refuse to run a motion through in a duration (s) in which it breaks a limit that it kept.

    Raises
    ------
    MissedError
        If the limit is hard; of a soft one it is warned.
    """
    limits, least = system.part(timed(system)), duration / usual.duration
    for found in paces(usual, limits, least):
        # What is not kept in the usual duration either is not a matter of time.
        if found is None or not least * (1 + _SAME) < found.factor <= 1 + _SAME:
            continue
        lacking = replace(found, factor=found.factor / least)
        if not found.is_soft:
            raise lacking.refusal(duration, usual)
        warn(lacking.refused(duration), CompromiseWarning)


def paces(
    motion: PoseTrajectory, limits: ConstraintSystem, least: float = 1.0
) -> list[Pace | None]:
    """For each limit, the least factor, of ``least`` or more, with which a motion keeps it.

    Velocities of a sample are those of the step that led to it, as in a :class:`Motion`.

    None where there is none: what asks for a way to travel, or for rest, asks it at any speed.
    """
    if not limits.size:
        return []

    def margins(factor: float) -> Floats:
        return np.asarray(_margins(motion, limits, factor).min(axis=0))

    low = margins(least)
    # What misses a limit by no more than rounding keeps it, as a motion does (:data:`HELD`).
    factors = np.where(low >= -HELD, least, np.nan)
    upper = least
    while np.isnan(factors).any() and upper < _SLOWEST * least:
        lower, upper = upper, 2 * upper
        for row in np.flatnonzero(np.isnan(factors) & (margins(upper) >= 0)):
            root = scipy.optimize.brentq(
                lambda factor: margins(factor)[row],  # noqa: B023
                lower,
                upper,
                xtol=1e-15,
            )
            factors[row] = root * (1 + _BEYOND)
    slowest = [part.max() for part in np.split(factors, np.cumsum(limits.rows)[:-1])]
    return [
        None if np.isnan(factor) else Pace(float(factor), name, limit.priority > 0)
        for factor, name, limit in zip(slowest, limits.names, limits.constraints, strict=True)
    ]


def stretched(trajectory: PoseTrajectory, factor: float) -> PoseTrajectory:
    """Return a trajectory run through so much slower."""
    if factor == 1:
        return trajectory
    times = trajectory.times[0] + factor * (trajectory.times - trajectory.times[0])
    rates = trajectory.linear_velocities / factor, trajectory.angular_velocities / factor
    return trajectory.with_points(trajectory.points, times).with_velocities(*rates)


def timed(system: ConstraintSystem) -> list[bool]:
    """For each constraint, whether it is a limit on velocities or accelerations that rest keeps.

    One that rest does not keep with room, such as a turning radius, asks for a way to travel, which
    no duration changes.
    """
    return [
        c.relation != "zero" and c.level != "position" and _kept_at_rest(c)
        for c in system.constraints
    ]


def _kept_at_rest(limit: Constraint) -> bool:
    still = np.zeros(limit.coordinates or 3)
    instant: list[Any] = [still, np.eye(3), still, still, still, still]
    rest = constraint_function(limit)(0, *([still] * 3 if limit.coordinates else instant))
    # What is no number at rest says nothing of it.
    return bool(np.all(~(np.asarray(rest) <= 0)))


def _margins(motion: PoseTrajectory, limits: ConstraintSystem, factor: float) -> Floats:
    """Margins of the start and of each step of a motion that takes so much longer, (N, k)."""
    begin = motion.times[0]
    times = begin + factor * (motion.times - begin)
    periods = np.diff(times)
    # The first kick lasts from the start to the middle of its step.
    kicks = (periods + np.concatenate([[0.0], periods[:-1]]))[:, None] / 2
    poses = times, motion.positions, motion.quaternions
    velocities = [v / factor for v in (motion.linear_velocities, motion.angular_velocities)]
    first = limits.residuals(*(part[:1] for part in (*poses, *velocities)))
    steps = limits.of_steps(
        *poses, *(v[1:] for v in velocities), *(np.diff(v, axis=0) / kicks for v in velocities)
    )
    return np.vstack([first, steps])
