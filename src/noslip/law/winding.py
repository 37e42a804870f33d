"""Rotations beyond half a turn: the goal that the orientation is drawn to, along the motion."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation, RotationSpline

from noslip._typing import Floats
from noslip._values import Value
from noslip.errors import InputError
from noslip.law.attractor import Attractor
from noslip.quaternions import product, turned, turns_between, without_flips

FARTHEST_FROM_GOAL = 0.75 * np.pi
"""Beyond this angle to a fixed goal the logarithm comes near its jump at pi."""
FARTHEST_FROM_WINDING = 0.4 * np.pi
_MOST_KNOTS = 1 << 14
KNOTS_PER_TURN = 16
"""Of a cycle: what a spline through them is off a smooth lap is a thousandth of a turn."""
_FELT = 40
"""Knots beyond which a cubic spline no longer feels its ends: each leaves 0.27 of it."""
_AS_IT_IS = np.array([1.0, 0.0, 0.0, 0.0])


def turning(quaternions: Floats) -> float:
    """All turns of rotations together (rad)."""
    steps = turns_between(quaternions[:-1], quaternions[1:])
    return float(np.linalg.norm(steps, axis=1).sum())


def farthest_from_goal(quaternions: Floats) -> float:
    """Largest angle (rad) of rotations to the last of them."""
    turns = turns_between(quaternions, quaternions[-1:])
    return float(np.linalg.norm(turns, axis=1).max())


@dataclass(frozen=True, eq=False)
class Winding(Value):
    """W(t / duration): the rotation that plays the goal's part in ``Log(R_g R^T)``.

    The logarithm of eq. 7 knows only angles up to pi, so an attractor to a fixed goal cannot tell
    a turn and a half from half a turn back.  A demonstration that stays within 135 degrees of its
    goal has the fixed goal of the paper (one knot); one that turns farther has a goal that leads
    it there, a spline through few of its own rotations.  A new goal turns all of it alike, in the
    tool's frame: the learned force, in the world's, then still matches it.

    Parameters
    ----------
    quaternions : array, shape (K, 4)
        Knots (qw, qx, qy, qz), evenly spaced in time; the last is the goal.
    is_cyclic : bool
        Whether the last knot is the first one again, and so on.
    """

    quaternions: Floats
    is_cyclic: bool = False

    def __post_init__(self) -> None:
        quaternions = np.array(self.quaternions, dtype=np.float64)
        fits = quaternions.ndim == 2 and quaternions.shape[1] == 4 and len(quaternions)
        if not fits or not np.isfinite(quaternions).all():
            raise InputError("winding: knots are finite quaternions, shape (K, 4)")
        quaternions.flags.writeable = False
        object.__setattr__(self, "quaternions", quaternions)

    @classmethod
    def around(cls, quaternions: Floats, least: int = 0) -> Winding:
        """Fewest knots, in powers of two or all, that keep the logarithm away from its jump.

        Parameters
        ----------
        quaternions : array, shape (N, 4)
        least : int
            Intervals between knots, at least; 0 lets a single knot do.
        """
        if not least and farthest_from_goal(quaternions) <= FARTHEST_FROM_GOAL:
            return cls(quaternions[-1:])
        count, continuous = len(quaternions), without_flips(quaternions)
        fractions = np.linspace(0.0, 1.0, count)
        most = min(_MOST_KNOTS, count - 1)
        intervals, nearest, winding = min(max(least, 2), most), np.inf, None
        while True:
            samples = np.round(np.linspace(0, count - 1, intervals + 1)).astype(int)
            candidate = cls(without_flips(continuous[samples]))
            along = candidate.at(fractions).as_quat(scalar_first=True)
            distance = float(np.linalg.norm(turns_between(quaternions, along), axis=1).max())
            if distance < nearest:
                nearest, winding = distance, candidate
            if distance <= FARTHEST_FROM_WINDING or intervals == most:
                break
            intervals = min(2 * intervals, most)
        assert winding is not None
        return winding

    @classmethod
    def cycle(cls, quaternions: Floats, middle: Floats) -> Winding:
        """What a cycle of rotations, the last the first again, is led by.

        Its mean, where all stay near that; else some of the rotations themselves, enough that a
        spline through them comes round smoothly.
        """
        apart = np.linalg.norm(turns_between(quaternions, middle[None]), axis=1).max()
        if apart <= FARTHEST_FROM_GOAL:
            return cls(middle[None], is_cyclic=True)
        continuous = without_flips(quaternions)
        count = len(continuous) - 1
        turns = max(1, round(turning(quaternions) / (2 * np.pi)))
        knots = min(count, KNOTS_PER_TURN * turns)
        samples = np.round(np.linspace(0, count, knots + 1)).astype(int)
        return cls(continuous[samples], is_cyclic=True)

    @cached_property
    def goal(self) -> Rotation:
        """Where it ends."""
        return Rotation.from_quat(self.quaternions[-1], scalar_first=True)

    @cached_property
    def _spline(self) -> RotationSpline:
        quaternions, rounds = self.quaternions, 1
        if self.is_cyclic:
            # Before and after it, as often as it takes that no spline feels the ends.
            rounds = 2 * -(-_FELT // (len(quaternions) - 1)) + 1
            quaternions = np.vstack([np.tile(quaternions[:-1], (rounds, 1)), quaternions[-1:]])
        places = np.linspace(-(rounds // 2), rounds // 2 + 1, len(quaternions))
        return RotationSpline(places, Rotation.from_quat(quaternions, scalar_first=True))

    @property
    def splines(self) -> Floats:
        """Rotation vector in each interval as a cubic of the fraction since its knot.

        Shape (K - 1, 4, 3), the cubic coefficient first; ``R = R_knot Exp(vector)``.
        """
        if len(self.quaternions) == 1:
            return np.zeros((0, 4, 3))
        curves = np.moveaxis(self._spline.interpolator.c, 0, 1)
        own = len(self.quaternions) - 1
        before = (len(curves) - own) // 2
        return np.asarray(curves[before : before + own])

    def _along(self, fractions: Floats) -> Floats:
        """Quaternions between the knots, shape (N, 4), many times as fast as SciPy's own."""
        inside = fractions % 1.0 if self.is_cyclic else np.clip(fractions, 0.0, 1.0)
        intervals = len(self.quaternions) - 1
        interval = np.minimum((inside * intervals).astype(int), intervals - 1)
        within = (inside - interval / intervals)[:, None]
        cubic, square, slope, _ = np.moveaxis(self.splines[interval], 1, 0)
        turns = within * (slope + within * (square + within * cubic))
        return product(self.quaternions[interval], turned(turns, _AS_IT_IS))

    def at(self, fractions: ArrayLike, goal: Rotation | None = None) -> Rotation:
        """W at fractions of the duration, led to another goal if one is given."""
        if len(self.quaternions) == 1:
            knot = np.repeat(self.quaternions, np.size(fractions), axis=0)
            rotations = Rotation.from_quat(knot, scalar_first=True)
        else:
            rotations = Rotation.from_quat(self._along(np.ravel(fractions)), scalar_first=True)
        if goal is None:
            return rotations
        # In the tool's frame; most often there is nothing to turn.
        turn = self.goal.inv() * goal
        return rotations if turn.magnitude() == 0.0 else rotations * turn

    def along(
        self,
        begin: float,
        steps: int,
        step_fraction: float,
        attractor: Attractor,
        before: float,
        goal: Rotation,
    ) -> tuple[Floats, Floats]:
        """Return W, led to a goal, where each of the coming steps begins, and what it leaves out.

        A step holds its target still.  What that leaves out of one that moves is to be added to the
        force, as :meth:`noslip.law.basis.Basis.stepping_activations` does for a learned one: the
        motion is then of fourth order in the step.

        Parameters
        ----------
        begin : float
            Fraction of the duration at which the first step begins.
        steps : int
        step_fraction : float
            ``dt / tau``.
        attractor : Attractor
        before : float
            The step before the first one; 0 at the start of the motion.
        goal : Rotation

        Returns
        -------
        quaternions : array, shape (steps, 4)
        left_out : array, shape (steps, 3)
            Rotation vectors, world frame (rad).
        """
        leading, left_out = _along(self, begin, steps, step_fraction, attractor, before)
        if goal is self.goal or (turn := self.goal.inv() * goal).magnitude() == 0.0:
            return leading, left_out
        turned = Rotation.from_quat(leading, scalar_first=True) * turn
        return np.asarray(turned.as_quat(scalar_first=True)), left_out


# As for the basis functions: rollouts of one primitive repeat.
@lru_cache(maxsize=4)
def _along(
    winding: Winding, begin: float, steps: int, h: float, attractor: Attractor, earlier: float
) -> tuple[Floats, Floats]:
    around = winding.at(begin + np.arange(-1, steps + 1) * h)
    left_out = np.zeros((steps, 3))
    if len(winding.quaternions) > 1:
        turns = (around[1:] * around[:-1].inv()).as_rotvec()
        before, after = turns[:-1], turns[1:]
        change, bend = np.tile(attractor.led_by(h, h), (steps, 1)).T[:, :, None]
        change[0], bend[0] = attractor.led_by(earlier, h)
        left_out = change * (after + before) / 2 + bend * (after - before)
    found = np.asarray(around[1:-1].as_quat(scalar_first=True)), left_out
    for part in found:
        part.flags.writeable = False
    return found
