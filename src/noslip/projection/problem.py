"""One trajectory projection as a banded Newton and interior-point iteration.

Newton steps on the optimality conditions, whose matrix is banded when samples and multipliers are
interleaved: time and memory grow linearly with the number of samples.

Limits join as further rows, by the primal-dual interior-point method: a slack s > 0 and a
multiplier mu > 0 with ``h - s = 0`` and ``mu s = tau``, tau going to zero.  In the matrix a limit
is a row like an equality's, with ``-s / mu`` on its diagonal.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import takewhile

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip.boundary import Boundary, end_twist
from noslip.constraints.declaration import UNITS
from noslip.projection.band import Band
from noslip.projection.blend import inverse_left_jacobian, spread
from noslip.projection.request import Request
from noslip.projection.result import ProjectedTrajectory
from noslip.projection.stage import Entries, Stage
from noslip.trajectory import PoseTrajectory, continuous_quaternions

_REST_WEIGHT = 1e-3
"""What a turn costs at rest, relative to its cost at mean speed: enough for a definite matrix."""
_SLOPE, _SLOW = 1e-3, 0.3
"""What a change of the turn costs at rest, and the speed, over the mean, at which it costs half.

Without it the turn bends away at a free end, where the position gives way instead: the numerical
example's blade ends 8 degrees off its path, a hand's contour 65.  It halves that; a tenth of it
does next to nothing, ten times as much costs a sixth of the path's precision.
"""
_TURNED_REFERENCE = 1.2 * np.pi
"""Beyond this turn, nearest means nearest to the turned demonstration: Exp is singular at 2 pi."""
_LARGEST_TURN = 0.7
"""Longest Newton step (rad): the linearization holds for little more."""
_GAUSS_NEWTON_STEPS = 2
"""Steps without the constraints' curvature, before multipliers are worth trusting."""
_NEAR = 0.05
"""A careful attempt uses the curvature only once its steps are shorter than this (rad)."""
_DUAL_REGULARIZATION = 1e-12
"""On the diagonal of the constraints' rows, which are of order 1: dependent rows stay solvable, and
what it leaves of a residual is below rounding."""
_STEP_TOLERANCE = 1e-6
"""Longest last step (rad, or path lengths): quadratic convergence leaves its square."""
_STILL = 1e-3
"""Longest step (rad, or path lengths) of an iteration that may end for want of patience."""
_RESIDUAL_TOLERANCE = 1e-11
"""Relative to the path's mean speed (velocity level) or length (position level): what a hundred
roundings of a thousand samples amount to."""
_LAST_BARRIER = 1e-11
"""Last tau over the step in time normalized: limits are then approached to the residuals' own
tolerance."""
_LIMIT_TOLERANCE = 1e-8
"""As for equalities, of which no such precision is asked."""
_STUCK, _MOST_STUCK = 1e-2, 6
"""An iteration that goes no farther than this fraction of its step, and how many may in a row."""
_BARRIER_FALL, _SHORT_STEP_FALL, _LONG_STEP = 0.1, 0.8, 0.7
"""tau relative to the mean of mu s, after steps longer than this fraction, and after others."""
_LEAST_SLACK = 1e-3
"""First slack of a limit that is violated, relative to the path's mean speed or length."""
_APPROACH = 0.05
"""Share of the samples over which a clearance grows from none, at the ends and where a pose is
fixed."""
_TO_THE_BOUNDARY = 0.99
"""Share of the way to where a slack or multiplier would vanish that a step may go."""


class Problem:
    """One projection as a banded Newton iteration.

    Stage k holds its unknowns z_k (rotation vector, and position displacement over L unless held)
    and its multipliers lambda_k, one a row of the constraints on the step that ends in k.  At
    stage 0 only position-level rows exist.

    Parameters
    ----------
    request : Request
    turns : array, shape (N, 3)
        First guess of the correction (rad).
    """

    def __init__(self, request: Request, turns: Floats) -> None:
        trajectory, system, boundaries = request.reference, request.system, request.fixed
        hold_position = request.hold_position
        self.given, self.system = trajectory, system
        self.smoothing = request.weights.rotation_smoothing
        self.begin = request.begin
        self.equalities, self.limits = system.equalities, system.limits
        count, rows = len(trajectory), system.size
        self.count, self.rows = count, rows
        self.unknowns = 3 if hold_position else 6
        self.stage = self.unknowns + rows
        self.time_step = trajectory.duration / (count - 1)
        self.length = trajectory.path_length or 1.0
        levels = np.array(self.equalities.row_levels + self.limits.row_levels, dtype=object)
        self.is_limit = np.arange(rows) >= self.equalities.size
        speed_scale = self.length / trajectory.duration
        scales = {
            "position": self.length,
            "velocity": speed_scale,
            "acceleration": speed_scale / trajectory.duration,
        }
        self.row_scale = np.array([1 / scales[level] for level in levels])

        self.z = np.zeros((count, self.unknowns))
        self.reference = trajectory.rotations
        if np.linalg.norm(turns, axis=1).max() <= _TURNED_REFERENCE:
            self.z[:, :3] = turns
        else:
            self.reference = Rotation.from_rotvec(turns) * trajectory.rotations

        self.twists = request.twists
        self._turned_reference = PoseTrajectory(
            trajectory.times, trajectory.positions, self.reference
        )
        self.fixed = self._fix(boundaries)
        weights = request.weights
        self._weigh(weights.position, weights.position_smoothing, weights.rotation_smoothing)
        self._constraints = Stage.of(system, hold_position)
        self.parameters = self._stage_parameters()
        # Constraints that a fixed boundary pose alone decides are not the projection's to satisfy.
        self.active = np.ones((count, rows), dtype=bool)
        self.active[0] = levels == "position"
        decided = np.zeros(count, dtype=bool)
        for k, boundary in boundaries.items():
            holds_position = boundary.position is not None or hold_position
            decided[k] = holds_position and boundary.rotation is not None
        for k in takewhile(lambda k: decided[k], range(count)):
            self.active[k] = False
        # An acceleration is that from the step before a sample to the step after it.
        self.active[-1] &= levels != "acceleration"
        self.slack = np.ones((count, rows))
        # None at what is fixed, which may lie on a limit.
        places = [0, count - 1, *(k for k, b in boundaries.items() if b.position is not None)]
        away = np.abs(np.arange(count)[:, None] - places).min(axis=1) / (_APPROACH * count)
        units = np.array(self.equalities.row_units + self.limits.row_units, dtype=object)
        cleared = self.is_limit & (levels == "position") & (units == UNITS["position"])
        self.clearance = request.clearance * np.minimum(away, 1.0)[:, None] * cleared

    def begin_at(self, trajectory: PoseTrajectory) -> None:
        """Take a trajectory as the first guess."""
        turned = (trajectory.rotations * self.reference.inv()).as_rotvec()
        self.z[:, :3] += np.where(self.fixed[:, :3], 0.0, turned - self.z[:, :3])
        if self.unknowns == 6:
            moved = (trajectory.positions - self.given.positions) / self.length
            self.z[:, 3:] += np.where(self.fixed[:, 3:], 0.0, moved - self.z[:, 3:])

    def keeps_limits(self) -> bool:
        """Whether the first guess keeps all limits as it is."""
        value, _ = self._constraints.slope(self.z, self.parameters)
        heeded = self.active & self.is_limit
        return bool(np.all((value * self.row_scale >= -_LIMIT_TOLERANCE) | ~heeded))

    def _fix(self, boundaries: dict[int, Boundary]) -> NDArray[np.bool_]:
        """Mark the unknowns that boundaries fix, and spread the change over the first guess."""
        fixed = np.zeros_like(self.z, dtype=bool)
        turns, shifts = {}, {}
        for k, boundary in boundaries.items():
            if boundary.rotation is not None:
                turns[k] = (boundary.rotation * self.reference[k].inv()).as_rotvec()
            if boundary.position is not None and self.unknowns == 6:
                shifts[k] = (boundary.position - self.given.positions[k]) / self.length
        for wanted_here, columns in ((turns, slice(0, 3)), (shifts, slice(3, 6))):
            if not wanted_here:
                continue
            changes = {k: value - self.z[k, columns] for k, value in wanted_here.items()}
            self.z[:, columns] += spread(changes, np.arange(self.count))
            for k, value in wanted_here.items():
                self.z[k, columns] = value
                fixed[k, columns] = True
        return fixed

    def _weigh(self, position: float, position_smoothing: float, rotation_smoothing: float) -> None:
        h = 1 / (self.count - 1)
        velocities, _ = self.given.step_velocities()
        speed = np.linalg.norm(velocities, axis=1)
        speed = np.concatenate([speed[:1], speed])
        relative = speed / speed.mean() if speed.any() else np.ones(self.count)
        self.weights = np.full((self.count, self.unknowns), position * h)
        self.weights[:, :3] = h * (relative[:, None] + _REST_WEIGHT)
        self.bending = np.full(self.unknowns, position_smoothing / h**3)
        self.bending[:3] = rotation_smoothing / h**3
        # Of the step that leads from a sample to the next.
        self.slope = np.zeros((self.count - 1, self.unknowns))
        self.slope[:, :3] = _SLOPE / h / (1 + (relative[1:, None] / _SLOW) ** 2)
        # Where a velocity is asked for, the correction bends as if mirrored there: half a second
        # difference, 2 (z_1 - z_0 - h z'), that leads on to the step beyond.
        for k in self.twists:
            self.slope[min(k, self.count - 2)] += 2 * self.bending

    def _changes(self) -> Floats:
        """What each step changes of the correction, less what velocities at the ends ask for."""
        changes = np.diff(self.z, axis=0)
        for k, asked in self.twists.items():
            turn = self.z[k, :3]
            linear, angular = end_twist(self._turned_reference, min(k, 1))
            # R = Exp(turn) R_ref turns with Exp(turn) w_ref + J turn'.
            rate = asked[1] - Rotation.from_rotvec(turn).apply(angular)
            wanted = inverse_left_jacobian(turn, rate)
            if self.unknowns == 6:
                wanted = np.concatenate([wanted, (asked[0] - linear) / self.length])
            changes[min(k, self.count - 2)] -= self.time_step * wanted
        return changes

    def _stage_parameters(self) -> Floats:
        quaternions = continuous_quaternions(self.reference)
        previous = np.concatenate([[0], np.arange(self.count - 1)])
        following = np.concatenate([np.arange(1, self.count), [self.count - 1]])
        positions = self.given.positions
        # Of equal steps: stamps as large as Unix time are rounded to a fraction of a microsecond.
        velocities = np.diff(positions, axis=0) / self.time_step
        # No step leads to the first sample; nothing is asked of one, but a rule may be undefined at
        # rest: it is taken as the step after it.
        velocities = np.concatenate([velocities[:1], velocities])
        earlier = quaternions[previous]
        first, second = self.reference[0], self.reference[1]
        earlier[0] = ((first * second.inv()) * first).as_quat(scalar_first=True)
        earlier[0] *= np.sign(earlier[0] @ quaternions[0])
        times = self.given.times - self.given.times[0] + self.begin
        return np.column_stack(
            [
                earlier,
                quaternions,
                quaternions[following],
                positions,
                velocities,
                velocities[following],
                times,
                np.full(self.count, self.time_step),
                np.full(self.count, self.length),
            ]
        )

    # ------------------------------------------------------------ Newton

    def solve(
        self, max_iterations: int, careful: bool, barrier: float = 0.0
    ) -> ProjectedTrajectory:
        """Iterate from the first guess; ``careful`` converges from farther, and more slowly.

        With limits, ``barrier`` is the first tau over the step in time normalized.
        """
        multipliers = np.zeros((self.count, self.rows))
        heeded = self.active & self.is_limit
        barrier, last_barrier, stuck = barrier / self.count, _LAST_BARRIER / self.count, 0
        tolerance = np.where(self.is_limit, max(_LIMIT_TOLERANCE, self._tolerance), self._tolerance)
        if heeded.any():
            value, _ = self._constraints.slope(self.z, self.parameters)
            value = (value - self.clearance) * self.row_scale
            self.slack = np.where(heeded, np.maximum(value, _LEAST_SLACK), 1.0)
            multipliers = np.where(heeded, -barrier / self.slack, 0.0)
        converged, iteration, step_size = False, 0, np.inf
        for iteration in range(max_iterations + 1):
            value, jacobian = self._constraints.slope(self.z, self.parameters)
            value = np.where(self.active, (value - self.clearance) * self.row_scale, 0.0)
            missed = np.where(heeded, value - self.slack, value)
            residual = float(np.max(np.abs(missed) / tolerance, initial=0.0))
            if not np.isfinite(residual) or stuck > _MOST_STUCK:
                break
            is_last = barrier <= last_barrier
            if residual <= 1 and step_size <= _STEP_TOLERANCE and is_last:
                converged = True
                break
            if iteration == max_iterations:
                # Feasible and all but still: nothing that more iterations would change matters.
                still = residual <= 10 and step_size <= _STILL
                converged = bool(still and is_last)
                break
            curvature: Entries = {}
            if step_size < _NEAR if careful else iteration >= _GAUSS_NEWTON_STEPS:
                weights = multipliers * self.row_scale
                curvature = self._constraints.curvature(self.z, self.parameters, weights)
            step, new = self._newton_step(value, jacobian, curvature, multipliers, barrier)
            if not (np.all(np.isfinite(step)) and np.all(np.isfinite(new))):
                break
            step_size = float(np.abs(step).max(initial=0.0))
            fraction = min(1.0, _LARGEST_TURN / max(step_size, 1e-300))
            if heeded.any():
                push, more = -multipliers[heeded], multipliers[heeded] - new[heeded]
                slack = self.slack[heeded]
                widened = (barrier - push * slack - slack * more) / push
                fraction = min(fraction, _room(slack, widened), _room(push, more))
                self.slack[heeded] = slack + fraction * widened
                products = self.slack[heeded] * (push + fraction * more)
                fall = _BARRIER_FALL if fraction > _LONG_STEP else _SHORT_STEP_FALL
                barrier = min(barrier, max(fall * float(products.mean()), last_barrier))
                stuck = stuck + 1 if fraction < _STUCK else 0
            self.z += fraction * step
            multipliers += fraction * (new - multipliers)
        return self.result(converged, iteration, multipliers)

    def is_solved(self) -> bool:
        """Whether the trajectory as given satisfies everything: then it is the nearest."""
        if self.z.any() or self._changes().any():
            return False
        value, _ = self._constraints.slope(self.z, self.parameters)
        scaled = np.where(self.active, value * self.row_scale, 0.0)
        return bool(np.abs(scaled).max(initial=0.0) <= self._tolerance)

    @property
    def _tolerance(self) -> float:
        return max(_RESIDUAL_TOLERANCE, self._rounding())

    def _rounding(self) -> float:
        """Residual that the rounding of the positions alone causes."""
        largest = np.abs(self.given.positions).max(initial=0.0)
        speed_scale = self.length / self.given.duration
        return float(16 * np.finfo(float).eps * largest / self.time_step / speed_scale)

    def _newton_step(
        self,
        value: Floats,
        jacobian: Entries,
        curvature: Entries,
        multipliers: Floats,
        barrier: float,
    ) -> tuple[Floats, Floats]:
        reaches_over = "acceleration" in self.limits.row_levels
        band = Band(self.count, self.stage, self.unknowns if reaches_over else 0)
        for j in range(self.unknowns):
            band.add_bending(j, self.bending[j])
            band.add(0, j, j, self.weights[:, j])
            band.add_slope(j, self.slope[:, j])
        scaled_active = self.active * self.row_scale
        for (row, column), entries in jacobian.items():
            entries = entries * scaled_active[:, row]
            block, unknown = divmod(column, self.unknowns)
            i = self.unknowns + row
            # Columns 0 .. n-1 belong to the sample before, then come the one itself and the next.
            shift = block - 1
            band.add(shift, i, unknown, entries)
            band.add_transposed(shift, i, unknown, entries)
        for (row, column), entries in curvature.items():
            (a, i), (b, j) = divmod(row, self.unknowns), divmod(column, self.unknowns)
            band.add_between(a - 1, i, b - 1, j, entries)
            if row != column:
                band.add_between(b - 1, j, a - 1, i, entries)
        heeded = self.active & self.is_limit
        softness = np.where(self.active, _DUAL_REGULARIZATION, 1.0)
        softness[heeded] = self.slack[heeded] / -multipliers[heeded]
        for row in range(self.rows):
            i = self.unknowns + row
            band.add(0, i, i, -softness[:, row])

        right = np.zeros((self.count, self.stage))
        right[:, : self.unknowns] = -self._cost_gradient()
        asked = -value - _DUAL_REGULARIZATION * multipliers
        asked[heeded] = self.slack[heeded] - value[heeded] - barrier / multipliers[heeded]
        right[:, self.unknowns :] = asked
        right[:, self.unknowns :][~self.active] = 0.0
        for k, j in np.argwhere(self.fixed).tolist():
            band.fix(k, j)
            right[k, j] = 0.0
        solution = band.solve(right.ravel()).reshape(self.count, self.stage)
        return solution[:, : self.unknowns], solution[:, self.unknowns :]

    def _cost_gradient(self) -> Floats:
        gradient = self.weights * self.z
        bend = self.bending * (self.z[2:] - 2 * self.z[1:-1] + self.z[:-2])
        gradient[2:] += bend
        gradient[1:-1] -= 2 * bend
        gradient[:-2] += bend
        change = self.slope * self._changes()
        gradient[1:] += change
        gradient[:-1] -= change
        return gradient

    def result(self, converged: bool, iterations: int, multipliers: Floats) -> ProjectedTrajectory:
        """What the iterations have come to."""
        rotations = Rotation.from_rotvec(self.z[:, :3]) * self.reference
        positions = self.given.positions.copy()
        if self.unknowns == 6:
            positions += self.length * self.z[:, 3:]
        trajectory = PoseTrajectory(
            times=self.given.times,
            positions=positions,
            rotations=rotations,
            name=self.given.name,
        )
        residuals, margins = self._residuals(trajectory)
        return ProjectedTrajectory(
            trajectory=trajectory,
            turns=(rotations * self.given.rotations.inv()).as_rotvec(),
            converged=converged,
            iterations=iterations,
            residual=float(np.abs(residuals).max(initial=0.0)),
            residuals=residuals,
            multipliers=multipliers,
            margins=margins,
            backing=0,
            smoothing=self.smoothing,
        )

    def _residuals(self, trajectory: PoseTrajectory) -> tuple[Floats, Floats]:
        """Residuals (N, m) and margins (N, k) of a trajectory."""
        # Of equal steps: stamps as large as Unix time are rounded to a fraction of a microsecond.
        times: Floats = np.asarray(np.arange(self.count) * self.time_step + self.begin, np.float64)
        linear, angular = replace(trajectory, times=times).step_velocities()
        accelerations = [
            np.pad(np.diff(v, axis=0) / self.time_step, ((0, 1), (0, 0))) for v in (linear, angular)
        ]
        pose = (times, trajectory.positions, trajectory.quaternions)
        first = (*(part[:1] for part in pose), linear[:1], angular[:1])
        residuals, margins = (
            np.vstack([part.residuals(*first), part.of_steps(*pose, linear, angular, *more)])
            for part, more in ((self.equalities, ()), (self.limits, accelerations))
        )
        # No step leads to the first sample.
        residuals[0, self.equalities.row_is_velocity] = 0.0
        applies = np.ones((self.count, self.rows), dtype=bool)
        applies[0] = np.array(self.equalities.row_levels + self.limits.row_levels) == "position"
        applies[-1] = self.active[-1]
        margins[~applies[:, self.equalities.size :]] = np.inf
        return residuals, margins


def _room(values: Floats, steps: Floats) -> float:
    """Fraction of the steps that leaves positive values positive."""
    falling = steps < 0
    return float(np.min(-_TO_THE_BOUNDARY * values[falling] / steps[falling], initial=1.0))
