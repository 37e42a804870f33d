"""One trajectory projection: what is iterated on, set up from a request, and what comes of it."""

from __future__ import annotations

from dataclasses import replace
from itertools import takewhile

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip.boundary import Boundary, end_twist
from noslip.constraints.declaration import UNITS
from noslip.projection import planner
from noslip.projection.blend import spread
from noslip.projection.newton import Plan
from noslip.projection.request import Request
from noslip.projection.result import ProjectedTrajectory
from noslip.projection.stage import Stage
from noslip.quaternions import turned, turns_between
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
_RESIDUAL_TOLERANCE = 1e-11
"""Relative to the path's mean speed (velocity level) or length (position level): what a hundred
roundings of a thousand samples amount to."""
_LAST_BARRIER = 1e-11
"""Last tau over the step in time normalized: limits are then approached to the residuals' own
tolerance."""
_LIMIT_TOLERANCE = 1e-8
"""As for equalities, of which no such precision is asked."""
_APPROACH = 0.05
"""Share of the samples over which a clearance grows from none, at the ends and where a pose is
fixed."""


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
        self.given, self.smoothing, self.begin = (
            trajectory,
            request.weights.rotation_smoothing,
            request.begin,
        )
        self.equalities, self.limits = system.equalities, system.limits
        count = self.count = len(trajectory)
        self.time_step = trajectory.duration / (count - 1)
        self.length = request.length or trajectory.path_length or 1.0
        self.levels = np.array(self.equalities.row_levels + self.limits.row_levels, dtype=object)
        self.is_limit = np.arange(system.size) >= self.equalities.size

        self.reference = trajectory.rotations
        if np.linalg.norm(turns, axis=1).max() > _TURNED_REFERENCE:
            self.reference = Rotation.from_rotvec(turns) * trajectory.rotations
            turns = np.zeros((count, 3))
        stage = Stage.of(system, request.hold_position)
        # With what an end lacks of a neighbor.
        z = np.zeros((count + 2, stage.unknowns))
        self.z = z[1:-1]
        self.z[:, :3] = turns
        self.fixed = self._fix(boundaries)
        speed_scale = self.length / trajectory.duration
        scales = {
            "position": self.length,
            "velocity": speed_scale,
            "acceleration": speed_scale / trajectory.duration,
        }
        positions, quaternions = self._stages(trajectory.positions, self.reference)
        turn_weights, turn_slopes = self._weigh()
        weights, h = request.weights, 1 / (count - 1)
        self.plan = Plan(
            stage,
            positions,
            quaternions,
            turn_weights,
            turn_slopes,
            self.fixed,
            self._active(boundaries, request.hold_position),
            self._clearance(request),
            np.array([1 / scales[level] for level in self.levels]),
            np.where(self.is_limit, max(_LIMIT_TOLERANCE, self._tolerance), self._tolerance),
            self._twists(request),
            z,
            self.time_step,
            self.length,
            self.begin,
            weights.position * h,
            np.array([weights.rotation_smoothing, weights.position_smoothing]) / h**3,
            _LAST_BARRIER / count,
        )

    def begin_at(self, trajectory: PoseTrajectory) -> None:
        """Take a trajectory as the first guess."""
        turns = (trajectory.rotations * self.reference.inv()).as_rotvec()
        self.z[:, :3] += np.where(self.fixed[:, :3], 0.0, turns - self.z[:, :3])
        if self.z.shape[1] == 6:
            moved = (trajectory.positions - self.given.positions) / self.length
            self.z[:, 3:] += np.where(self.fixed[:, 3:], 0.0, moved - self.z[:, 3:])

    def keeps_limits(self) -> bool:
        """Whether the first guess keeps all limits as it is."""
        value = planner.values(self.plan) * self.plan.row_scale
        return bool(np.all((value >= -_LIMIT_TOLERANCE) | ~self.plan.heeded))

    def _fix(self, boundaries: dict[int, Boundary]) -> NDArray[np.bool_]:
        """Mark the unknowns that boundaries fix, and spread the change over the first guess."""
        fixed = np.zeros_like(self.z, dtype=bool)
        turns, shifts = {}, {}
        for k, boundary in boundaries.items():
            if boundary.rotation is not None:
                turns[k] = (boundary.rotation * self.reference[k].inv()).as_rotvec()
            if boundary.position is not None and self.z.shape[1] == 6:
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

    def _active(self, boundaries: dict[int, Boundary], hold_position: bool) -> NDArray[np.bool_]:
        """Which rows are asked for at which sample."""
        active = np.ones((self.count, len(self.levels)), dtype=bool)
        active[0] = self.levels == "position"
        # Constraints that a fixed boundary pose alone decides are not the projection's to satisfy.
        decided = np.zeros(self.count, dtype=bool)
        for k, boundary in boundaries.items():
            holds_position = boundary.position is not None or hold_position
            decided[k] = holds_position and boundary.rotation is not None
        done = len(list(takewhile(lambda k: decided[k], range(self.count))))
        active[:done] = False
        # An acceleration is that from the step before a sample to the step after it.
        active[-1] &= self.levels != "acceleration"
        if 1 < done < self.count:
            active[done - 1] = self.levels == "acceleration"
        return active

    def _clearance(self, request: Request) -> Floats:
        """What limits are kept away from, shape (N, m)."""
        # None at what is fixed, which may lie on a limit.
        places = [0, self.count - 1]
        places += [k for k, b in request.fixed.items() if b.position is not None]
        away = np.abs(np.arange(self.count)[:, None] - places).min(axis=1) / (
            _APPROACH * self.count
        )
        units = np.array(self.equalities.row_units + self.limits.row_units, dtype=object)
        cleared = self.is_limit & (self.levels == "position") & (units == UNITS["position"])
        return np.asarray(request.clearance * np.minimum(away, 1.0)[:, None] * cleared)

    def _weigh(self) -> tuple[Floats, Floats]:
        """What a turn costs at each sample, and what its change costs in each step."""
        h = 1 / (self.count - 1)
        velocities, _ = self.given.step_velocities()
        speed = np.linalg.norm(velocities, axis=1)
        speed = np.concatenate([speed[:1], speed])
        relative = speed / mean if (mean := speed.mean()) else np.ones(self.count)
        return h * (relative + _REST_WEIGHT), _SLOPE / h / (1 + (relative[1:] / _SLOW) ** 2)

    def _twists(self, request: Request) -> list[Floats | None]:
        """Twists that are asked for at the ends, and the reference's own."""
        twists: list[Floats | None] = [None, None]
        reference = PoseTrajectory(self.given.times, self.given.positions, self.reference)
        for k, asked in request.twists.items():
            end = min(k, 1)
            own = end_twist(reference, end)
            twists[end] = np.array([np.concatenate(asked), np.concatenate(own)])
        return twists

    def _stages(self, positions: Floats, rotations: Rotation) -> tuple[Floats, Floats]:
        """Positions and quaternions, shape (N + 2, ...), with what an end lacks of a neighbor.

        No step leads to the first sample; nothing is asked of one, but a rule may be undefined at
        rest: it is taken as the step after it.
        """
        p, q = np.empty((self.count + 2, 3)), np.empty((self.count + 2, 4))
        p[1:-1], q[1:-1] = positions, continuous_quaternions(rotations)
        p[0], p[-1] = 2 * p[1] - p[2], 2 * p[-2] - p[-3]
        before = rotations[0] * rotations[1].inv() * rotations[0]
        q[0], q[-1] = before.as_quat(scalar_first=True), q[-2]
        q[0] *= np.sign(q[0] @ q[1])
        return p, q

    def solve(
        self, max_iterations: int, careful: bool, barrier: float = 0.0
    ) -> ProjectedTrajectory:
        """Iterate from the first guess; ``careful`` converges from farther, and more slowly.

        With limits, ``barrier`` is the first tau over the step in time normalized.
        """
        self.plan.careful = careful
        converged = planner.solve(self.plan, max_iterations, barrier / self.count)
        return self.result(converged, self.plan.iteration, self.plan.multipliers)

    @property
    def _tolerance(self) -> float:
        """Residual that counts as none: at least what the rounding of the positions causes."""
        largest = np.abs(self.given.positions).max(initial=0.0)
        speed_scale = self.length / self.given.duration
        rounding = 16 * np.finfo(float).eps * largest / self.time_step / speed_scale
        return max(_RESIDUAL_TOLERANCE, float(rounding))

    def result(self, converged: bool, iterations: int, multipliers: Floats) -> ProjectedTrajectory:
        """What the iterations have come to."""
        rotations = turned(self.z[:, :3], self.plan.quaternions[1:-1])
        positions = self.given.positions.copy()
        if self.z.shape[1] == 6:
            positions += self.length * self.z[:, 3:]
        trajectory = PoseTrajectory(
            times=self.given.times,
            positions=positions,
            rotations=Rotation.from_quat(rotations, scalar_first=True),
            name=self.given.name,
        )
        residuals, margins = self._residuals(trajectory)
        return ProjectedTrajectory(
            trajectory=trajectory,
            turns=turns_between(self.given.rotations.as_quat(scalar_first=True), rotations),
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
        positions, quaternions = self._stages(trajectory.positions, trajectory.rotations)
        as_it_is = np.zeros((self.count + 2, self.z.shape[1]))
        values = planner.values(
            replace(self.plan, positions=positions, quaternions=quaternions, z=as_it_is)
        )
        applies = np.ones_like(self.plan.active)
        # No step leads to the first sample.
        applies[0], applies[-1] = self.levels == "position", self.plan.active[-1]
        if self.plan.stage.system.has_angles or not np.isfinite(values[applies]).all():
            self._require_defined(trajectory)
        values = np.where(applies, values, np.where(self.is_limit, np.inf, 0.0))
        return values[:, : self.equalities.size], values[:, self.equalities.size :]

    def _require_defined(self, trajectory: PoseTrajectory) -> None:
        """Refuse constraints that are undefined along a trajectory."""
        # Of equal steps: stamps as large as Unix time are rounded to a fraction of a microsecond.
        times: Floats = np.asarray(np.arange(self.count) * self.time_step + self.begin, np.float64)
        linear, angular = replace(trajectory, times=times).step_velocities()
        accelerations = [
            np.pad(np.diff(v, axis=0) / self.time_step, ((0, 1), (0, 0))) for v in (linear, angular)
        ]
        pose = (times, trajectory.positions, trajectory.quaternions)
        t, p, q = (part[:1] for part in pose)
        for part, more in ((self.equalities, ()), (self.limits, accelerations)):
            part.residuals(t, p, q, linear[:1], angular[:1])
            part.of_steps(*pose, linear, angular, *more)
