"""From near a feasible motion onto the constraints: many motions at once.

A trajectory projection (:mod:`noslip.projection.trajectory`) factorizes the matrix of its
optimality conditions anew in each Newton step, of each trajectory.  Motions that all lie near one
feasible motion share that motion's matrix: simplified Newton steps

    ``z <- z - W^-1 J^T (J W^-1 J^T)^-1 phi(z)``

with weights W and Jacobian J of the feasible motion converge linearly, the faster the nearer, at
the price of two triangular solutions and one evaluation of the constraints; combined by what the
steps before have taught (Anderson 1965), in half as many.  Where they end satisfies the constraints
as exactly; it is the nearest such motion to first order (a retraction onto the manifold of feasible
motions; Absil, Mahony and Sepulchre 2008, section 4.1).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from noslip._typing import Expression, Floats
from noslip.constraints.system import ConstraintSystem
from noslip.distribution.arrays import OnArrays, in_cache
from noslip.distribution.blocks import Blocks
from noslip.distribution.kernels import Kernels, kernels
from noslip.errors import ConvergenceError
from noslip.projection import newton
from noslip.projection.problem import Problem
from noslip.projection.request import Request
from noslip.rotations import quaternion_conjugate, quaternion_log, quaternion_product
from noslip.space import Space, Twisted

MOST_STEPS = 20
"""Twice what motions take that lie within three standard deviations; what takes more is projected
exactly in less time."""
ARRIVED = 5e-11
"""Residual, in the constraint's own unit, at which a motion has arrived: a twentieth of what is
told as none (:data:`noslip.constraints.check.ROUNDING`).  Each factor of 5 takes another step."""
WORST = 1e2
"""Factor on the least residual so far at which an iteration is given up."""
DEPTH = 3
"""Steps that are remembered: with more, a motion arrives no sooner."""
TOGETHER = 128
"""Motions that are moved at once: enough for products of matrices to run at full speed, few enough
to stay in the processor's cache."""


@dataclass(frozen=True, eq=False)
class Retracted:
    """What became of motions.

    Attributes
    ----------
    points : array, shape (N, n + 4 b, S)
    residual : array, shape (S,)
        Largest of each, over the one at which it has arrived.
    arrived : array of bool, shape (S,)
        Which satisfy the constraints.
    steps : int
        Newton steps of the slowest.
    """

    points: Floats
    residual: Floats
    arrived: NDArray[np.bool_]
    steps: int


class Retraction:
    """Moves motions near a feasible one onto the equalities of its constraints.

    Parameters
    ----------
    request : Request
        Its reference satisfies the constraints; its boundaries say what stays as it is, its weights
        what gives way.

    Raises
    ------
    ConvergenceError
        If its boundaries leave no motion.
    """

    def __init__(self, request: Request) -> None:
        self.system = request.system.equalities
        self.space: Space = self.system.space
        reference = request.reference
        self._time_step = request.time_step
        at = np.arange(len(reference), dtype=np.float64)
        self._times: Floats = request.begin + self._time_step * at
        plan = Problem(request, np.zeros((len(reference), self.space.angular))).plan
        self.length = plan.length
        value, jacobian = plan.stage.slope(*plan.arguments())
        band, _ = newton.optimality(plan, plan.scaled(value), jacobian, {})
        system = self.system
        self._kernels = kernels_of(system) if system.size else None
        self._factor = Blocks(band, self._kernels)
        if not self._factor.is_finite:
            raise ConvergenceError(
                f"{reference.name}: the constraints leave no motion near it; condition on less, or "
                "with noise"
            )
        self._active, self._scale = plan.active, plan.row_scale
        self._tolerance = np.maximum(ARRIVED, plan.tolerance / plan.row_scale)
        self._step: _Between = system.owned("between", lambda: _Between(system))

    def residuals(self, points: Floats) -> Floats:
        """Residuals of the equalities, shape (N, m, S), zero where they are not asked for."""
        residuals = self._step if self._kernels is None else self._kernels.residuals
        found = residuals(self._times, self._time_step, points)
        return found if self._active.all() else np.where(self._active[:, :, None], found, 0.0)

    def corrections(self, residuals: Floats) -> Floats:
        """Least changes of a motion that take away residuals, to first order.

        Parameters
        ----------
        residuals : array, shape (N, m, S)

        Returns
        -------
        array, shape (N, n + 3 b, S)
            As :meth:`noslip.space.Space.moved` wants them.
        """
        turns, unknowns = self.space.angular, self.space.velocity_size
        steps = self._solved(residuals)
        # The projection has the turns first, and positions over the path's length.
        moves = self.length * steps[:, turns:unknowns]
        return np.concatenate([moves, steps[:, :turns]], axis=1)

    def _solved(self, residuals: Floats) -> Floats:
        """Unknowns and multipliers of the projection that residuals ask for."""
        count, rows, several = residuals.shape
        unknowns = self.space.velocity_size
        right = np.zeros((self._factor.rows, several))
        found = right[: count * (unknowns + rows)].reshape(count, -1, several)
        np.multiply(residuals, -self._scale[:, None], out=found[:, unknowns:])
        self._factor.solve(right)
        return found

    def tangent(self, changes: Floats, reference: Floats) -> Floats:
        """Changes of the feasible motion itself, to first order onto its constraints.

        Parameters
        ----------
        changes : array, shape (N, n + 3 b, S)
        reference : array, shape (N, n + 4 b)
            The feasible motion.
        """
        # Central differences: exact to the square of a step that is a millionth of the path.
        step = _DIFFERENCE * self.length / max(float(np.abs(changes).max()), 1e-300)
        found, begun = np.empty_like(changes), reference[:, :, None]
        for part in _lots(changes):
            there, back = (
                self.residuals(self.space.moved(begun, sign * step * changes[..., part], 1))
                for sign in (1.0, -1.0)
            )
            found[..., part] = changes[..., part] + self.corrections((there - back) / (2 * step))
        return found

    def __call__(self, points: Floats) -> Retracted:
        """Move motions, points of shape (N, n + 4 b, S), onto the constraints."""
        moved, missed = points.copy(), np.empty(points.shape[2])
        arrived, most = np.zeros(points.shape[2], dtype=bool), 0
        for part in _lots(points):
            moved[..., part], missed[part], arrived[part], steps = self._onto(points[..., part])
            most = max(most, steps)
        return Retracted(moved, missed, arrived, most)

    def _onto(self, points: Floats) -> tuple[Floats, Floats, NDArray[np.bool_], int]:
        """Move a few motions; the points, what is left, which arrived, and in how many steps."""
        found, size = points.copy(), np.empty(points.shape[2])
        going, left = np.arange(points.shape[2]), self.residuals(points)
        missed = self._missed(left)
        size[:] = missed
        least, pull = missed.copy(), np.zeros_like(left)
        past = _Past()
        for steps in range(MOST_STEPS + 1):
            on = (missed > 1) & np.isfinite(missed) & (missed <= WORST * least)
            if not on.all():
                going, least = going[on], least[on]
                points, left, pull = points[..., on], left[..., on], pull[..., on]
                past.keep(on)
            if not len(going) or steps == MOST_STEPS:
                break
            pull = past.next(pull, left)
            moved = self._led(points, self._solved(pull))
            left = self.residuals(moved)
            missed = self._missed(left)
            if len(going) == len(size):
                found = moved
            else:
                found[..., going] = moved
            size[going] = missed
            least = np.minimum(least, missed)
        return found, size, size <= 1, steps

    def _led(self, points: Floats, steps: Floats) -> Floats:
        if self._kernels is not None:
            return self._kernels.led(self.length, points, steps)
        return _led(self.space, self.length, points, steps)

    def _missed(self, residuals: Floats) -> Floats:
        off = np.abs(residuals / self._tolerance[:, None])
        return np.asarray(off.max(axis=(0, 1), initial=0.0))


def _lots(motions: Floats) -> Iterator[slice]:
    """Places of the motions that are moved at once."""
    for first in range(0, motions.shape[2], TOGETHER):
        yield slice(first, first + TOGETHER)


class _Past:
    """What steps have taught (Anderson 1965): a few of them span how the residual answers.

    Steps of ``a <- a + r(a)`` are combined such that the residual would vanish as far as it is
    linear in them (Walker and Ni 2011, eq. 2.2 and below).
    """

    def __init__(self) -> None:
        self._steps: list[Floats] = []
        self._lefts: list[Floats] = []
        self._before: tuple[Floats, Floats] | None = None

    def keep(self, on: NDArray[np.bool_]) -> None:
        self._steps, self._lefts = ([x[..., on] for x in xs] for xs in (self._steps, self._lefts))
        if self._before is not None:
            self._before = self._before[0][..., on], self._before[1][..., on]

    def next(self, pull: Floats, left: Floats) -> Floats:
        step = pull + left
        if self._before is not None:
            self._steps = [*self._steps, step - self._before[0]][-DEPTH:]
            self._lefts = [*self._lefts, left - self._before[1]][-DEPTH:]
        self._before = step, left
        count = len(self._lefts)
        if not count:
            return step
        normal, wanted = np.empty((left.shape[2], count, count)), np.empty((left.shape[2], count))
        for k, one in enumerate(self._lefts):
            wanted[:, k] = _dot(one, left)
            for j, other in enumerate(self._lefts[: k + 1]):
                normal[:, k, j] = normal[:, j, k] = _dot(one, other)
        size = np.einsum("skk->s", normal)[:, None, None]
        normal += (1e-14 * size + 1e-300) * np.eye(count)
        shares = np.linalg.solve(normal, wanted[:, :, None])[:, :, 0]
        found = step.copy()
        for share, change in zip(shares.T, self._steps, strict=True):
            found -= share * change
        return found


def _dot(one: Floats, other: Floats) -> Floats:
    """Products of motions' numbers, summed, shape (S,)."""
    return np.asarray(np.einsum("nms,nms->s", one, other))


_DIFFERENCE = 1e-6
"""Of the path, for central differences: their error is its square, their rounding 1e-10."""


def kernels_of(system: ConstraintSystem) -> Kernels | None:
    """Machine code of a system of equalities; None without a compiler."""
    return kernels(system, lambda: _residual(system))


def _led(space: Space, length: float, points: Floats, steps: Floats) -> Floats:
    """Points led by steps of a projection, turned by ``2 atan(|r| / 2)``: without a sine.

    Any way to go does that begins like ``Exp(r) R``; this one, to third order, takes half the time.
    """
    found = np.empty_like(points)
    for rows in in_cache(len(points), points.shape[2]):
        _lead(space, length, points[rows], steps[rows], found[rows])
    return found


def _lead(space: Space, length: float, points: Floats, steps: Floats, found: Floats) -> None:
    n, turns = space.linear, space.angular
    np.add(points[:, :n], length * steps[:, turns : turns + n], out=found[:, :n])
    for k in range(space.rotations):
        a, b, c = (steps[:, 3 * k + j] / 2 for j in range(3))
        first = n + 4 * k
        w, x, y, z = (points[:, first + j] for j in range(4))
        shorter = 1 / np.sqrt(1 + a * a + b * b + c * c)
        for j, part in enumerate(
            (
                w - a * x - b * y - c * z,
                x + a * w + b * z - c * y,
                y + b * w + c * x - a * z,
                z + c * w + a * y - b * x,
            )
        ):
            np.multiply(part, shorter, out=found[:, first + j])


class _Between:
    """Residuals of all rows in steps from point to point, of many motions at once."""

    def __init__(self, system: ConstraintSystem) -> None:
        self._size, self._evaluate = system.size, OnArrays(_residual(system))

    def __call__(self, times: Floats, time_step: float, points: Floats) -> Floats:
        """Of motions of shape (N, n + 4 b, S), shape (N, m, S): of the steps to each sample."""
        found = np.empty((len(points), self._size, points.shape[2]))
        # No step leads to the first sample: what is asked of it is asked of its pose alone.
        for at, before in ((slice(0, 1), slice(0, 1)), (slice(1, None), slice(0, -1))):
            if self._size:
                pairs = [points[part, j] for part in (before, at) for j in range(points.shape[1])]
                found[at] = self._evaluate([times[at, None], time_step, *pairs])
        return found


def _residual(system: ConstraintSystem) -> ca.Function:
    """(time of the end, step, point before, point after) -> residuals, each at its level."""
    space = system.space
    width = space.point_size
    given = ca.SX.sym("given", 2 + 2 * width)
    time, h, before, after = ca.vertsplit(given, [0, 1, 2, 2 + width, 2 + 2 * width])
    ends = [ca.vertsplit(point, [0, space.linear, width]) for point in (before, after)]
    linear = (ends[1][0] - ends[0][0]) / h
    turns = space.each(
        lambda one, other: quaternion_log(quaternion_product(other, quaternion_conjugate(one))),
        ends[0][1],
        ends[1][1],
    )
    halfway = space.each(lambda one, other: _unit(one + other), ends[0][1], ends[1][1])
    between = (ends[0][0] + ends[1][0]) / 2, halfway
    steps = space.steps_of_bodies(h, ends[0], between, ends[1], linear, turns / h)
    middles = [Twisted(*there, *moving) for there, _, moving in steps]
    lasts = [Twisted(*over, *moving) for _, over, moving in steps]
    middle = system.of_bodies(time - h / 2, middles, between[0], linear)
    last = system.of_bodies(time, lasts, ends[1][0], linear)
    found = ca.cse(ca.densify(system.by_level(middle, last)))
    return ca.Function("between", [given], [found])


def _unit(vector: Expression) -> Expression:
    return vector / ca.norm_2(vector)
