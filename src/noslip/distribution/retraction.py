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

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from noslip._typing import Expression, Floats
from noslip.constraints.system import ConstraintSystem
from noslip.distribution.arrays import OnArrays
from noslip.errors import ConvergenceError
from noslip.projection import newton
from noslip.projection.band import Band
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
IN_CACHE = 8
"""Motions of which all numbers of a turn stay in the cache."""
STAGES = 6
"""Samples of a block of the factorization: fewer are slower for their number, more for their
size."""


@dataclass(frozen=True, eq=False)
class Retracted:
    """What became of motions.

    Attributes
    ----------
    points : array, shape (S, N, n + 4 b)
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
        self._factor = _Blocks(band)
        if not self._factor.is_finite:
            raise ConvergenceError(
                f"{reference.name}: the constraints leave no motion near it; condition on less, or "
                "with noise"
            )
        self._active, self._scale = plan.active, plan.row_scale
        self._tolerance = np.maximum(ARRIVED, plan.tolerance / plan.row_scale)
        self._step: _Between = self.system.owned("between", lambda: _Between(self.system))

    def residuals(self, points: Floats) -> Floats:
        """Residuals of the equalities, shape (S, N, m), zero where they are not asked for."""
        found = self._step(self._times, self._time_step, points)
        return found if self._active.all() else np.where(self._active, found, 0.0)

    def corrections(self, residuals: Floats) -> Floats:
        """Least changes of a motion that take away residuals, to first order.

        Parameters
        ----------
        residuals : array, shape (S, N, m)

        Returns
        -------
        array, shape (S, N, n + 3 b)
            As :meth:`noslip.space.Space.moved` wants them.
        """
        several, count, rows = residuals.shape
        turns, unknowns = self.space.angular, self.space.velocity_size
        right = np.zeros((count, unknowns + rows, several))
        right[:, unknowns:] = (residuals * -self._scale).transpose(1, 2, 0)
        # The projection has the turns first, and positions over the path's length.
        steps = self._factor.solve(right.reshape(-1, several)).reshape(right.shape)
        found = np.empty((several, count, unknowns))
        found[:, :, : unknowns - turns] = self.length * steps[:, turns:unknowns].transpose(2, 0, 1)
        found[:, :, unknowns - turns :] = steps[:, :turns].transpose(2, 0, 1)
        return found

    def tangent(self, changes: Floats, reference: Floats) -> Floats:
        """Changes of the feasible motion itself, to first order onto its constraints.

        Parameters
        ----------
        changes : array, shape (S, N, n + 3 b)
        reference : array, shape (N, n + 4 b)
            The feasible motion.
        """
        # Central differences: exact to the square of a step that is a millionth of the path.
        step = _DIFFERENCE * self.length / max(float(np.abs(changes).max()), 1e-300)
        found = np.empty_like(changes)
        for first in range(0, len(changes), TOGETHER):
            part = slice(first, first + TOGETHER)
            there, back = (
                self.residuals(self.space.moved(reference[None], sign * step * changes[part]))
                for sign in (1.0, -1.0)
            )
            found[part] = changes[part] + self.corrections((there - back) / (2 * step))
        return found

    def __call__(self, points: Floats) -> Retracted:
        """Move motions, points of shape (S, N, n + 4 b), onto the constraints."""
        moved, missed = points.copy(), np.empty(len(points))
        arrived, most = np.zeros(len(points), dtype=bool), 0
        for first in range(0, len(points), TOGETHER):
            part = slice(first, first + TOGETHER)
            moved[part], missed[part], arrived[part], steps = self._onto(moved[part])
            most = max(most, steps)
        return Retracted(moved, missed, arrived, most)

    def _onto(self, points: Floats) -> tuple[Floats, Floats, NDArray[np.bool_], int]:
        """Move a few motions; the points, what is left, which arrived, and in how many steps."""
        found, size = points.copy(), np.empty(len(points))
        going, left = np.arange(len(points)), self.residuals(points)
        missed = self._missed(left)
        size[:] = missed
        least, pull = missed.copy(), np.zeros_like(left)
        past = _Past(pull, left)
        for steps in range(MOST_STEPS + 1):
            on = (missed > 1) & np.isfinite(missed) & (missed <= WORST * least)
            if not on.all():
                going, left, pull, least = going[on], left[on], pull[on], least[on]
                past.keep(on)
            if not len(going) or steps == MOST_STEPS:
                break
            pull = past.next(pull, left)
            moved = _led(self.space, points[going], self.corrections(pull))
            left = self.residuals(moved)
            missed = self._missed(left)
            found[going], size[going] = moved, missed
            least = np.minimum(least, missed)
        return found, size, size <= 1, steps

    def _missed(self, residuals: Floats) -> Floats:
        return np.asarray(np.abs(residuals / self._tolerance).max(axis=(1, 2), initial=0.0))


class _Past:
    """What steps have taught (Anderson 1965): a few of them span how the residual answers.

    Steps of ``a <- a + r(a)`` are combined such that the residual would vanish as far as it is
    linear in them (Walker and Ni 2011, eq. 2.2 and below).
    """

    def __init__(self, pull: Floats, left: Floats) -> None:
        self._pulls: list[Floats] = []
        self._lefts: list[Floats] = []
        self._before: tuple[Floats, Floats] | None = None

    def keep(self, on: NDArray[np.bool_]) -> None:
        self._pulls, self._lefts = ([x[on] for x in xs] for xs in (self._pulls, self._lefts))
        if self._before is not None:
            self._before = self._before[0][on], self._before[1][on]

    def next(self, pull: Floats, left: Floats) -> Floats:
        if self._before is not None:
            self._pulls = [*self._pulls, pull - self._before[0]][-DEPTH:]
            self._lefts = [*self._lefts, left - self._before[1]][-DEPTH:]
        self._before = pull, left
        step = pull + left
        if not self._lefts:
            return step
        changes = np.stack(self._lefts, axis=1).reshape(len(left), len(self._lefts), -1)
        flat = left.reshape(len(left), -1)
        normal = changes @ changes.swapaxes(1, 2)
        size = np.einsum("skk->s", normal)[:, None, None]
        normal += (1e-14 * size + 1e-300) * np.eye(normal.shape[1])
        shares = np.linalg.solve(normal, changes @ flat[:, :, None])[:, :, 0]
        for k, both in enumerate(zip(self._pulls, self._lefts, strict=True)):
            step -= shares[:, k, None, None] * sum(both)
        return step


_DIFFERENCE = 1e-6
"""Of the path, for central differences: their error is its square, their rounding 1e-10."""


class _Blocks:
    """A banded matrix, factorized in blocks of several stages, for many right-hand sides at once.

    As ``L D U`` of a block-tridiagonal matrix: products of small matrices, which take a quarter of
    the time of LAPACK's triangular solutions with a band.  A block's own pivots are all there are;
    what rounding that costs, the iteration makes up for.
    """

    def __init__(self, band: Band) -> None:
        self._size, self._width = STAGES * band.stage, band.width
        self._count = band.count * band.stage
        size, width = self._size, self._width
        self._inverses: list[Floats] = []
        self._lower: list[Floats] = []
        self._upper: list[Floats] = []
        for first in range(0, self._count, size):
            last = min(first + size, self._count)
            block = _part(band, first, last, first, last)
            if first:
                reach = min(first + width, last)
                below = _part(band, first, reach, first - width, first)
                above = _part(band, first - width, first, first, reach)
                before = self._inverses[-1]
                block[: reach - first, : reach - first] -= below @ before[-width:, -width:] @ above
                self._lower.append(below)
                self._upper.append(before[:, -width:] @ above)
            self._inverses.append(_inverse(block))

    @property
    def is_finite(self) -> bool:
        """Whether there is a solution."""
        return all(np.isfinite(each).all() for each in self._inverses)

    def solve(self, right: Floats) -> Floats:
        """Solve for right-hand sides of shape (unknowns, S), which are overwritten."""
        size, width, last = self._size, self._width, len(self._inverses) - 1
        for k, inverse in enumerate(self._inverses):
            first = k * size
            block = right[first : first + size]
            if k:
                lower = self._lower[k - 1]
                block[: len(lower)] -= lower @ right[first - width : first]
            right[first : first + size] = inverse @ block
        for k in range(last - 1, -1, -1):
            first, upper = (k + 1) * size, self._upper[k]
            right[k * size : first] -= upper @ right[first : first + upper.shape[1]]
        return right


def _part(band: Band, top: int, bottom: int, left: int, right: int) -> Floats:
    """Entries of a band as a dense matrix."""
    rows, columns = np.arange(top, bottom)[:, None], np.arange(left, right)
    inside = np.abs(rows - columns) <= band.width
    found = np.zeros(inside.shape)
    at = np.broadcast_to(2 * band.width + rows - columns, inside.shape)[inside]
    found[inside] = band.storage[at, np.broadcast_to(columns, inside.shape)[inside]]
    return found


def _inverse(block: Floats) -> Floats:
    try:
        return np.asarray(np.linalg.inv(block), dtype=np.float64)
    except np.linalg.LinAlgError:
        return np.full_like(block, np.nan)


def _led(space: Space, points: Floats, changes: Floats) -> Floats:
    """Points moved by changes, turned by ``2 atan(|r| / 2)``: to third order, without a sine.

    Any way to go does that begins like ``Exp(r) R``; this one takes half the time.
    """
    found = np.empty_like(points)
    for first in range(0, len(points), IN_CACHE):
        part = slice(first, first + IN_CACHE)
        _lead(space, points[part], changes[part], found[part])
    return found


def _lead(space: Space, points: Floats, changes: Floats, found: Floats) -> None:
    n = space.linear
    np.add(points[..., :n], changes[..., :n], out=found[..., :n])
    for k in range(space.rotations):
        a, b, c = np.moveaxis(changes[..., n + 3 * k : n + 3 * k + 3] / 2, -1, 0)
        first = n + 4 * k
        w, x, y, z = np.moveaxis(points[..., first : first + 4], -1, 0)
        size = np.sqrt(1 + a * a + b * b + c * c)
        for j, part in enumerate(
            (
                w - a * x - b * y - c * z,
                x + a * w + b * z - c * y,
                y + b * w + c * x - a * z,
                z + c * w + a * y - b * x,
            )
        ):
            np.divide(part, size, out=found[..., first + j])


class _Between:
    """Residuals of all rows in steps from point to point, of many motions at once."""

    def __init__(self, system: ConstraintSystem) -> None:
        self._size, self._evaluate = system.size, OnArrays(_residual(system))

    def __call__(self, times: Floats, time_step: float, points: Floats) -> Floats:
        """Of motions of shape (S, N, n + 4 b), shape (S, N, m): of the steps to each sample."""
        found = np.empty((*points.shape[:2], self._size))
        # No step leads to the first sample: what is asked of it is asked of its pose alone.
        for at, before in ((slice(0, 1), slice(0, 1)), (slice(1, None), slice(0, -1))):
            if self._size:
                pairs = [*np.moveaxis(points[:, before], -1, 0), *np.moveaxis(points[:, at], -1, 0)]
                found[:, at] = self._evaluate([times[at], time_step, *pairs])
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
