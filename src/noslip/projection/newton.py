"""Newton and interior-point iterations of a trajectory projection.

Newton steps on the optimality conditions, whose matrix is banded when samples and multipliers are
interleaved: time and memory grow linearly with the number of samples.

Limits join as further rows, by the primal-dual interior-point method: a slack s > 0 and a
multiplier mu > 0 with ``h - s = 0`` and ``mu s = tau``, tau going to zero.  In the matrix a limit
is a row like an equality's, with ``-s / mu`` on its diagonal.

The same iterations stand in C (``plan.c``, see :mod:`noslip.projection.planner`), which takes its
constants from here.  There the matrix is factorized without pivoting, as ``L D L^T`` stage by
stage; where that is not to be trusted, this module goes on.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip.projection.band import Band, Ring
from noslip.projection.blend import inverse_left_jacobian
from noslip.projection.stage import Entries, Stage, of_three

LARGEST_TURN = 0.7
"""Longest Newton step (rad): the linearization holds for little more."""
GAUSS_NEWTON_STEPS = 2
"""Steps without the constraints' curvature, before multipliers are worth trusting."""
NEAR = 0.05
"""A careful attempt uses the curvature only once its steps are shorter than this (rad)."""
DUAL_REGULARIZATION = 1e-10
"""On the diagonal of the constraints' rows, over the square of their entries, each of these
measured by its own unknown's diagonal: dependent rows stay solvable.  It is proximal, so that
multipliers end where they would without it."""
VANISHING = 1e-12
"""Square of a row's entries, over that of the same row elsewhere, below which it counts as
vanished: so small, what it asks for is below the residual's tolerance."""
STEP_TOLERANCE = 1e-6
"""Longest last step (rad, or path lengths): quadratic convergence leaves its square."""
STILL, NEARLY = 1e-3, 10.0
"""Longest step (rad, or path lengths) of an iteration that may end for want of patience, and its
largest residual over the tolerance."""
STUCK, MOST_STUCK = 1e-2, 6
"""An iteration that goes no farther than this fraction of its step, and how many may in a row."""
BARRIER_FALL, SHORT_STEP_FALL, LONG_STEP = 0.1, 0.8, 0.7
"""tau relative to the mean of mu s, after steps longer than this fraction, and after others."""
LEAST_SLACK = 1e-3
"""First slack of a limit that is violated, relative to the path's mean speed or length."""
TO_THE_BOUNDARY = 0.99
"""Share of the way to where a slack or multiplier would vanish that a step may go."""
MOST_GROWTH = 1e6
"""Of an entry in a factorization without pivoting, over what it is measured by: with more, more
than 1e-10 of it may be lost."""
SMALL_TURN = 1e-3
"""Turns (rad) below which sine and cotangent are their series."""


class Outcome(IntEnum):
    """What becomes of iterations; ``plan.h`` says more."""

    GOING_ON = 0
    CONVERGED = 1
    NEARLY = 2
    LOST = 3
    UNRELIABLE = 4


@dataclass(eq=False)
class Plan:
    """What is iterated on: ``noslip_plan`` of ``plan.h``, which says what it all means.

    Attributes
    ----------
    stage : Stage
    positions, quaternions, z : array, shape (N + 2, ...)
        With n, 4 b and the stage's unknowns as columns.
    turn_weights : array, shape (N,)
    turn_slopes : array, shape (N - 1,)
    metric : array, shape (N, n, n), or None
    pull : array, shape (N, n), or None
    fixed : array of bool, shape (N, n)
    active : array of bool, shape (N, m)
    clearance, multipliers, slack : array, shape (N, m)
    row_scale, tolerance : array, shape (m,)
    twists : two arrays, shape (2, n + 3 b), or None
    bending : array, shape (2,)
    is_periodic : bool
        Whether a step leads from the last sample to the first; it is the first one's then, and
        slopes have N.
    """

    stage: Stage
    positions: Floats
    quaternions: Floats
    turn_weights: Floats
    turn_slopes: Floats
    fixed: NDArray[np.bool_]
    active: NDArray[np.bool_]
    clearance: Floats
    row_scale: Floats
    tolerance: Floats
    twists: list[Floats | None]
    z: Floats
    time_step: float
    length: float
    begin: float
    position_weight: float
    bending: Floats
    last_barrier: float
    metric: Floats | None = None
    pull: Floats | None = None
    is_periodic: bool = False
    careful: bool = False
    barrier: float = 0.0
    step_size: float = np.inf
    residual: float = np.inf
    iteration: int = 0
    stuck: int = 0
    multipliers: Floats = field(init=False)
    slack: Floats = field(init=False)

    def __post_init__(self) -> None:
        # Machine code reads them where they are.
        for name in ("positions", "quaternions", "turn_weights", "turn_slopes", "clearance"):
            setattr(self, name, np.ascontiguousarray(getattr(self, name)))
        count, rows = self.active.shape
        self.heeded = self.active & (np.arange(rows) >= self.stage.equalities)
        self.multipliers, self.slack = np.zeros((count, rows)), np.ones((count, rows))

    @cached_property
    def _reference(self) -> tuple[Floats, ...]:
        at = np.full((len(self.active), 3), [self.begin, self.time_step, self.length])
        at[:, 0] += np.arange(len(at)) * self.time_step
        return of_three(self.quaternions), of_three(self.positions), at

    @property
    def unknown(self) -> Floats:
        """Of the samples themselves, shape (N, n)."""
        return self.z[1:-1]

    def arguments(self) -> tuple[Floats, ...]:
        """What the stage is evaluated at."""
        first, last = (-2, 1) if self.is_periodic else (1, -2)
        self.z[0], self.z[-1] = self.z[first], self.z[last]
        return (of_three(self.z), *self._reference)

    def scaled(self, values: Floats) -> Floats:
        """Rows' residuals as numbers of order 1; zero where they are not asked for."""
        return np.where(self.active, (values - self.clearance) * self.row_scale, 0.0)

    def changes(self) -> Floats:
        """What each step changes of the correction, less what twists at the ends ask for."""
        if self.is_periodic:
            return self.unknown - np.roll(self.unknown, 1, axis=0)
        changes = np.diff(self.unknown, axis=0)
        for end, twists in enumerate(self.twists):
            if twists is None:
                continue
            n, wanted, (asked, own) = self.stage.space.linear, [], twists
            for k in range(0, self.stage.space.angular, 3):
                turn, at = self.unknown[-end, k : k + 3], slice(n + k, n + k + 3)
                # R = Exp(turn) R_ref turns with Exp(turn) w_ref + J turn'.
                rate = asked[at] - Rotation.from_rotvec(turn).apply(own[at])
                wanted.append(inverse_left_jacobian(turn, rate))
            wanted.append((asked[:n] - own[:n]) / self.length)
            changes[-end] -= self.time_step * np.concatenate(wanted)[: changes.shape[1]]
        return changes

    def beside(self, shift: int) -> tuple[Any, Any]:
        """Samples that have one so far from them, and those ones."""
        count = len(self.active)
        if self.is_periodic:
            return np.arange(count), (np.arange(count) + shift) % count
        at = slice(max(0, -shift), count - max(0, shift))
        return at, slice(at.start + shift, at.stop + shift)

    def costs(self) -> tuple[Floats, Floats, Floats]:
        """Weights (N, n) of the correction, (N - 1, n) of its changes, (n,) of its bending."""
        turns = np.arange(self.z.shape[1]) < self.stage.turns
        weights: Floats = np.where(turns, self.turn_weights[:, None], self.position_weight)
        slopes: Floats = np.where(turns, self.turn_slopes[:, None], 0.0)
        bending: Floats = np.where(turns, self.bending[0], self.bending[1])
        # Where a velocity is asked for, the correction bends as if mirrored there: half a second
        # difference, 2 (z_1 - z_0 - h z'), that leads on to the step beyond.
        for end, twists in enumerate(self.twists):
            if twists is not None:
                slopes[-end] += 2 * bending
        return weights, slopes, bending


def begin(plan: Plan, barrier: float) -> None:
    """Begin from the correction in ``plan.z``."""
    plan.barrier, plan.step_size, plan.iteration, plan.stuck = 0.0, np.inf, 0, 0
    plan.multipliers[:] = 0.0
    if plan.heeded.any():
        plan.barrier = barrier
        value = plan.scaled(plan.stage.slope(*plan.arguments())[0])
        plan.slack = np.where(plan.heeded, np.maximum(value, LEAST_SLACK), 1.0)
        plan.multipliers = np.where(plan.heeded, -barrier / plan.slack, 0.0)


def iterate(plan: Plan, steps: int) -> Outcome:
    """Do so many Newton steps or fewer."""
    heeded = plan.heeded
    while True:
        stages = plan.arguments()
        value, jacobian = plan.stage.slope(*stages)
        value = plan.scaled(value)
        missed = np.where(heeded, value - plan.slack, value)
        plan.residual = float(np.max(np.abs(missed) / plan.tolerance, initial=0.0))
        if not np.isfinite(plan.residual) or plan.stuck > MOST_STUCK:
            return Outcome.LOST
        is_last = plan.barrier <= plan.last_barrier
        if plan.residual <= 1 and plan.step_size <= STEP_TOLERANCE and is_last:
            return Outcome.CONVERGED
        if steps <= 0:
            still = plan.residual <= NEARLY and plan.step_size <= STILL and is_last
            return Outcome.NEARLY if still else Outcome.GOING_ON
        curvature: Entries = {}
        if plan.step_size < NEAR if plan.careful else plan.iteration >= GAUSS_NEWTON_STEPS:
            curvature = plan.stage.curvature(*stages, plan.multipliers * plan.row_scale)
        step, pull = _newton_step(plan, value, jacobian, curvature)
        if not (np.all(np.isfinite(step)) and np.all(np.isfinite(pull))):
            return Outcome.LOST
        _go(plan, step, pull)
        steps -= 1


def _newton_step(
    plan: Plan, value: Floats, jacobian: Entries, curvature: Entries
) -> tuple[Floats, Floats]:
    """Solve the optimality conditions: steps of correction and multipliers.

    Not the multipliers themselves: they do not vanish, and neither would their rounding.
    """
    band, right = optimality(plan, value, jacobian, curvature)
    solution = band.solve(right.ravel()).reshape(right.shape)
    unknowns = plan.z.shape[1]
    return solution[:, :unknowns], solution[:, unknowns:]


def optimality(
    plan: Plan, value: Floats, jacobian: Entries, curvature: Entries
) -> tuple[Band, Floats]:
    """Optimality conditions of a step, as a matrix and a right-hand side, shape (N, n + m)."""
    count, unknowns, rows = len(value), plan.z.shape[1], plan.stage.rows
    kind = Ring if plan.is_periodic else Band
    band = kind(count, unknowns + rows, unknowns if plan.stage.reaches_over else 0)
    weights, slopes, bending = plan.costs()
    for j in range(unknowns):
        band.add_bending(j, bending[j])
        band.add(0, j, j, weights[:, j])
        band.add_slope(j, slopes[:, j])
    if plan.metric is not None:
        for i, j in np.ndindex(unknowns, unknowns):
            band.add(0, i, j, plan.metric[:, i, j])
    right = np.zeros((count, unknowns + rows))
    right[:, :unknowns] = -_cost_gradient(plan, weights, slopes, bending)
    for (row, column), entries in jacobian.items():
        # Columns 0 .. n-1 belong to the sample before, then come the one itself and the next.
        block, unknown = divmod(column, unknowns)
        shift = block - 1
        entries = np.where(plan.active[:, row], entries * plan.row_scale[row], 0.0)
        band.add(shift, unknowns + row, unknown, entries)
        band.add_transposed(shift, unknowns + row, unknown, entries)
        at, of = plan.beside(shift)
        right[of, unknown] -= entries[at] * plan.multipliers[at, row]
    asked = plan.active.any(axis=1)
    for (row, column), entries in curvature.items():
        (a, i), (b, j) = divmod(row, unknowns), divmod(column, unknowns)
        entries = np.where(asked, entries, 0.0)
        band.add_between(a - 1, i, b - 1, j, entries)
        if row != column:
            band.add_between(b - 1, j, a - 1, i, entries)
    heeded, multipliers = plan.heeded, plan.multipliers
    diagonal = np.where(plan.active, 0.0, -1.0)
    diagonal[heeded] = plan.slack[heeded] / multipliers[heeded]
    right[:, unknowns:] = -value
    right[:, unknowns:][heeded] -= plan.barrier / multipliers[heeded]
    for k, j in np.argwhere(plan.fixed).tolist():
        band.fix(k, j)
        right[k, j] = 0.0
    sizes = _sizes(plan, band, jacobian, diagonal)
    softness = np.where(plan.active, DUAL_REGULARIZATION * sizes, 0.0)
    for row in range(rows):
        band.add(0, unknowns + row, unknowns + row, diagonal[:, row] - softness[:, row])
    return band, right


def _sizes(plan: Plan, band: Band, jacobian: Entries, diagonal: Floats) -> Floats:
    """Squares of rows' largest entries, measured by their unknowns' diagonals; or their own."""
    unknowns = plan.z.shape[1]
    sizes = np.zeros(plan.active.shape)
    for row, column in jacobian:
        block, unknown = divmod(column, unknowns)
        at, of = plan.beside(block - 1)
        entries = band.entries(block - 1, unknowns + row, unknown)
        measure = np.abs(band.entries(0, unknown, unknown)[of])
        sizes[at, row] = np.maximum(sizes[at, row], entries**2 / measure)
    least = VANISHING * np.where(plan.active, sizes, 0.0).max(axis=0, initial=0.0)
    sizes = np.maximum(np.maximum(sizes, np.abs(diagonal)), least)
    return np.where(sizes > 0, sizes, 1.0)


def _cost_gradient(plan: Plan, weights: Floats, slopes: Floats, bending: Floats) -> Floats:
    z = plan.unknown
    gradient = weights * z
    if plan.metric is not None and plan.pull is not None:
        gradient += (plan.metric @ z[..., None])[..., 0] + plan.pull
    if plan.is_periodic:
        bend = bending * (np.roll(z, -1, axis=0) - 2 * z + np.roll(z, 1, axis=0))
        change = slopes * plan.changes()
        gradient += np.roll(bend, 1, axis=0) - 2 * bend + np.roll(bend, -1, axis=0)
        return np.asarray(gradient + change - np.roll(change, -1, axis=0))
    bend = bending * (z[2:] - 2 * z[1:-1] + z[:-2])
    gradient[2:] += bend
    gradient[1:-1] -= 2 * bend
    gradient[:-2] += bend
    change = slopes * plan.changes()
    gradient[1:] += change
    gradient[:-1] -= change
    return gradient


def _go(plan: Plan, step: Floats, pull: Floats) -> None:
    """Go along a step, as far as it may be trusted and as limits let it."""
    heeded, multipliers = plan.heeded, plan.multipliers
    plan.step_size = float(np.abs(step).max(initial=0.0))
    fraction = min(1.0, LARGEST_TURN / max(plan.step_size, 1e-300))
    if heeded.any():
        push, more = -multipliers[heeded], -pull[heeded]
        slack = plan.slack[heeded]
        widened = (plan.barrier - push * slack - slack * more) / push
        fraction = min(fraction, _room(slack, widened), _room(push, more))
        plan.slack[heeded] = slack + fraction * widened
        products = plan.slack[heeded] * (push + fraction * more)
        fall = BARRIER_FALL if fraction > LONG_STEP else SHORT_STEP_FALL
        plan.barrier = min(plan.barrier, max(fall * float(products.mean()), plan.last_barrier))
        plan.stuck = plan.stuck + 1 if fraction < STUCK else 0
    plan.unknown[:] += fraction * step
    multipliers += fraction * pull
    plan.iteration += 1


def _room(values: Floats, steps: Floats) -> float:
    """Fraction of the steps that leaves positive values positive."""
    falling = steps < 0
    with np.errstate(over="ignore"):
        # What hardly falls leaves all the room there is.
        room = -TO_THE_BOUNDARY * values[falling] / steps[falling]
    return float(np.min(room, initial=1.0))
