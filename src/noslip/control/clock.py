"""How fast a plan may be run through: bounds are met by time, not by deforming the path.

A plan is a motion over its own time u.  Its clock runs at ``du/dt = sigma <= 1``, so that what is
commanded is

    twist = sigma v(u),    acceleration = sigma^2 a(u) + sigma' v(u).

Half of the acceleration allowed is for the plan's own, ``sigma^2 |a| <= most / 2``; what that
leaves is for the clock's, ``|sigma'| |v| <= most - sigma^2 |a|``.  The squared speed of the clock
changes by ``2 sigma'`` over plan time, so a pass from the end backwards finds where to brake for
what comes (Bobrow, Dubowsky, Gibson 1985; Verscheure et al. 2009: linear in sigma^2).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import casadi as ca
import numpy as np

from noslip._typing import Floats
from noslip._values import Value
from noslip.constraints.system import ConstraintSystem
from noslip.runtime.motion import Motion

CELLS = 400
"""Of a plan's table: as many as a demonstration has samples that matter."""
HASTE = 2.0
"""Accelerations may exceed the demonstration's by so much more than speeds: a way back to the path
bends more sharply than the path."""
AT_REST, PLAN_AT_REST = 0.05, 2e-3
"""Over the mean speed, and over the largest rate: slower than that a primitive's own motion rests
at its ends, and so does a new plan, which is run into and out of as smoothly as it can be."""
_LEAST_TURN, _LEAST_TURN_CHANGE = 0.5, 1.5
"""rad per duration, and its square: what is taken for the peaks of a demonstration that hardly
turns, so that it may be led elsewhere: those of a turn by a quarter of a radian."""
_LEAST_SPEED = 0.02
"""Of the clock, with which the time to the end is foretold."""


@dataclass(frozen=True)
class Bounds:
    """What a command may do at most.

    Attributes
    ----------
    speed, rate : float
        m/s, rad/s.
    acceleration, angular_acceleration : float
        m/s^2, rad/s^2.
    """

    speed: float
    rate: float
    acceleration: float
    angular_acceleration: float

    @classmethod
    def of(cls, motion: Motion, faster: float) -> Bounds:
        """So many times the peaks of a motion; twice as many of its accelerations.

        The way is hardly longer where a tool is led back, but it turns more: of the linear speed
        half of what is beyond 1 is enough.
        """
        v, w, a, b = (float(x.max(initial=0.0)) for x in _sizes(motion))
        duration, length = motion.duration, motion.path_length
        least = length / duration, 4 * length / duration**2
        # Where nothing moves there is nothing to bound.
        v, a = max(v, least[0]) or np.inf, max(a, least[1]) or np.inf
        w = max(w, _LEAST_TURN / duration)
        b = max(b, _LEAST_TURN_CHANGE / duration**2)
        return cls(
            min(faster, (1 + faster) / 2) * v, faster * w, HASTE * faster * a, HASTE * faster * b
        )


@dataclass(frozen=True, eq=False)
class Schedule(Value):
    """What a plan allows its clock, at even places of its duration.

    Attributes
    ----------
    caps : array, shape (CELLS + 1,)
        Largest sigma^2.
    ramps : array, shape (CELLS + 1,)
        Largest change of sigma (1/s).
    left : array, shape (CELLS + 1,)
        Seconds to the end, as the clock will run.
    way : array, shape (CELLS + 1,)
        Meters to the end.
    velocities : array, shape (CELLS + 1, 6)
    begins_at_speed : bool
    is_free : bool
        Whether nothing is bounded anywhere.
    """

    caps: Floats
    ramps: Floats
    left: Floats
    way: Floats
    velocities: Floats
    begins_at_speed: bool
    is_free: bool

    @classmethod
    def of(
        cls,
        motion: Motion,
        bounds: Bounds,
        mean_speed: float,
        time_step: float,
        rests: bool,
        at_rest: float = PLAN_AT_REST,
    ) -> Schedule:
        """That of a plan's motion.

        Parameters
        ----------
        motion : Motion
            Of CELLS steps.
        bounds : Bounds
        mean_speed : float
            Of the primitive (m/s).
        time_step : float
            Of the loop (s).
        rests : bool
            Whether one that ends at speed comes to rest at its end.
        at_rest : float
            Over the mean speed, and over the largest rate: what a motion at rest may have.
        """
        step = motion.duration / CELLS
        v, w, a, b = _sizes(motion)
        with np.errstate(divide="ignore"):
            caps = np.minimum.reduce(
                [
                    np.ones(CELLS + 1),
                    (bounds.speed / v) ** 2,
                    (bounds.rate / w) ** 2,
                    bounds.acceleration / 2 / a,
                    bounds.angular_acceleration / 2 / b,
                ]
            )
            # Not within less than a few cycles, even at rest.
            ramps = np.minimum.reduce(
                [
                    np.full(CELLS + 1, 1 / (4 * time_step)),
                    (bounds.acceleration - caps * a) / v,
                    (bounds.angular_acceleration - caps * b) / w,
                ]
            )
            # From the speed at the end to rest within a cycle, as far as accelerations allow.
            stops = np.minimum(
                bounds.acceleration / 2 * time_step / v,
                bounds.angular_acceleration / 2 * time_step / w,
            )[[0, -1]]
        rests_there = (v <= at_rest * mean_speed) & (w <= at_rest * bounds.rate)
        still = np.where(rests_there[[0, -1]], 1.0, np.minimum(stops, 1.0)) ** 2
        if rests:
            caps[-1] = min(caps[-1], still[1])
            if still[1] < 1.0:
                # The last cycle may be cut short: it slows down and stops, both at once.
                ramps[-2 - int(time_step / step) :] /= 2
        for k in range(CELLS - 1, -1, -1):
            caps[k] = min(caps[k], caps[k + 1] + 2 * min(ramps[k], ramps[k + 1]) * step)
        speeds = np.maximum(np.sqrt(caps), _LEAST_SPEED)
        ways = np.linalg.norm(np.diff(motion.positions, axis=0), axis=1)
        return cls(
            caps,
            ramps,
            _remaining(2 * step / (speeds[:-1] + speeds[1:])),
            _remaining(ways),
            np.hstack([motion.linear_velocities, motion.angular_velocities]),
            bool(still[0] < 1.0),
            bool(caps.min() == 1.0),
        )

    def at(self, name: str, fraction: float) -> float:
        """Value of a table at a fraction of the duration."""
        return _between(getattr(self, name), fraction)

    def cap(self, fraction: float) -> float:
        """Largest sigma at a fraction of the duration."""
        return sqrt(_between(self.caps, fraction))

    def velocity(self, fraction: float) -> Floats:
        """Of the plan, shape (6,), at a fraction of the duration."""
        return np.asarray(self.velocities[min(round(fraction * CELLS), CELLS)])


def _between(table: Floats, fraction: float) -> float:
    place = min(max(fraction, 0.0), 1.0) * CELLS
    k = min(int(place), CELLS - 1)
    before = table.item(k)
    return before + (place - k) * (table.item(k + 1) - before)


def _remaining(parts: Floats) -> Floats:
    return np.append(np.cumsum(parts[::-1])[::-1], 0.0)


def _sizes(motion: Motion) -> list[Floats]:
    """Speeds and accelerations of a motion: linear and angular, shape (N,) each.

    A velocity is that of the step before its sample; a speed here heeds the step after, too.
    """
    velocities = motion.linear_velocities, motion.angular_velocities
    speeds = (np.linalg.norm(v, axis=1) for v in velocities)
    # Of steps; at the ends those of the first and of the last one.
    changes = (np.diff(v[1:], axis=0) / motion.period for v in velocities)
    ends = (np.linalg.norm(np.vstack([c[:1], c, c[-1:]]), axis=1) for c in changes)
    return [*(np.maximum(s, np.append(s[1:], 0.0)) for s in speeds), *ends]


def runs_in_plan_time(system: ConstraintSystem) -> bool:
    """Whether a motion keeps its rules however fast it is run through.

    So do rules that know no time, and whose residual is proportional to the speed, or to a power
    of it.  Limits need not be: a slower motion keeps them by more.
    """

    def found() -> bool:
        names = ("t", 1), ("p", 3), ("q", 4), ("v", 3), ("w", 3)
        state = [ca.SX.sym(name, size) for name, size in names]
        if ca.depends_on(system.residual(*state), state[0]):
            return False
        rows = system.equalities
        rng = np.random.default_rng(0)
        for _ in range(3):
            p, v, w = rng.normal(size=(3, 3))
            q = rng.normal(size=4)
            pose = 0.0, p, q / np.linalg.norm(q)
            whole = rows.instant(*pose, v, w)[0][rows.row_is_velocity]
            half = rows.instant(*pose, v / 2, w / 2)[0][rows.row_is_velocity]
            off = np.minimum(abs(half - whole / 2), abs(half - whole / 4))
            if not (off <= 1e-9 * (1 + abs(whole))).all():
                return False
        return True

    return system.owned("runs in plan time", found)
