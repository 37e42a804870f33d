"""One trajectory projection: what is iterated on, set up from a request, and what comes of it."""

from __future__ import annotations

from dataclasses import replace
from itertools import takewhile

import numpy as np
from numpy.typing import NDArray

from noslip._typing import Floats
from noslip.boundary import Boundary, end_twist
from noslip.constraints.declaration import UNITS
from noslip.projection import planner
from noslip.projection.blend import spread
from noslip.projection.carried import ToolPaths
from noslip.projection.newton import Plan
from noslip.projection.request import Request
from noslip.projection.result import ProjectedTrajectory
from noslip.projection.stage import Stage
from noslip.quaternions import turned, turns_between, without_flips
from noslip.space import Samples

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
_MOST_FORMS, _SAME_FORM = 12, 1e-4
"""How often what leads tools from their paths is taken anew, and the change (rad) for which it is
not: a tool is then off where it is led by a hundredth of a micrometer."""
_APPROACH = 0.05
"""Share of the samples over which a clearance grows from none, at the ends and where a pose is
fixed."""


class Problem:
    """One projection as a banded Newton iteration.

    Stage k holds its unknowns z_k (rotation vectors, and displacements over L unless held)
    and its multipliers lambda_k, one a row of the constraints on the step that ends in k.  At
    stage 0 only position-level rows exist.

    Parameters
    ----------
    request : Request
    turns : array, shape (N, 3 b)
        First guess of the correction (rad); all zeros may be of fewer.

    Of joints that carry a tool L is 1 rad, and a turn of a joint costs what one of the tool does;
    w_p and mu_p weigh how far the tool is led from its path, over that path's length.  So joints
    give way first that leave the tool where it is, and what is redundant stays near the
    demonstration.
    """

    def __init__(self, request: Request, turns: Floats) -> None:
        trajectory, system, boundaries = request.reference, request.system, request.fixed
        self.given, self.smoothing, self.begin = (
            trajectory,
            request.weights.rotation_smoothing,
            request.begin,
        )
        self.equalities, self.limits = system.equalities, system.limits
        self.is_periodic = request.is_periodic
        # The first sample of a period is its last.
        self.own = slice(int(self.is_periodic), None)
        count = self.count = len(trajectory) - int(self.is_periodic)
        self.time_step = request.time_step
        self.space = space = system.space
        self.length = request.length or trajectory.path_length or 1.0
        self.tools = ToolPaths(space, trajectory.positions[self.own])
        self.lengths = self._lengths()
        if self.is_carrying:
            self.length = 1.0
        self.levels = np.array(self.equalities.row_levels + self.limits.row_levels, dtype=object)
        self.is_limit = np.arange(system.size) >= self.equalities.size

        self.positions = trajectory.positions[self.own]
        self.reference = trajectory.quaternions[self.own]
        turns = np.broadcast_to(turns, (len(trajectory), space.angular))
        turned_on = turns[-1] - turns[0]
        turns = turns[self.own]
        farthest = np.linalg.norm(turns.reshape(count, -1, 3), axis=2).max(initial=0.0)
        # Nor does a turn close that goes on and on.
        goes_on = self.is_periodic and np.abs(turned_on).max(initial=0.0) > _TURNED_REFERENCE
        if farthest > _TURNED_REFERENCE or goes_on:
            led = _turned(self.reference, turns)
            each = (led[:, k : k + 4] for k in range(0, led.shape[1], 4))
            self.reference = np.hstack([without_flips(quaternions) for quaternions in each])
            turns = np.zeros_like(turns)
        stage = Stage.of(system, request.hold_position)
        # With what an end lacks of a neighbor.
        z = np.zeros((count + 2, stage.unknowns))
        self.z = z[1:-1]
        self.turns, self.shifts = self.z[:, : space.angular], self.z[:, space.angular :]
        self.turns[:] = turns
        self.fixed = self._fix(boundaries)
        scales = self.lengths / np.select(
            [self.levels == "velocity", self.levels == "acceleration"],
            [trajectory.duration, trajectory.duration**2],
            1.0,
        )
        positions, quaternions = self._stages(self.positions, self.reference)
        turn_weights, turn_slopes = self._weigh()
        weights, h = request.weights, 1 / (len(trajectory) - 1)
        tolerances = self._tolerances()
        bending = np.array([weights.rotation_smoothing, weights.position_smoothing])
        bending[0] += weights.position_smoothing * self.tools.lever
        self.plan = Plan(
            stage,
            # C reads it row after row; a filter leaves it column after column.
            np.ascontiguousarray(positions),
            quaternions,
            turn_weights,
            turn_slopes,
            self.fixed,
            self._active(boundaries, request.hold_position),
            self._clearance(request),
            1 / scales,
            np.where(self.is_limit, np.maximum(_LIMIT_TOLERANCE, tolerances), tolerances),
            self._twists(request),
            z,
            self.time_step,
            self.length,
            self.begin + self.own.start * self.time_step,
            weights.position * h,
            bending / h**3,
            _LAST_BARRIER / count,
            is_periodic=self.is_periodic,
        )
        self._take_form()

    @property
    def is_carrying(self) -> bool:
        """Whether joints carry a tool."""
        return len(self.tools.lengths) > 0

    def _take_form(self) -> None:
        """What it costs to lead tools from their paths, about the correction as it is."""
        if not self.is_carrying:
            return
        own, size = slice(self.space.angular, None), self.z.shape[1]
        metric, pull = self.tools.form(self.shifts)
        self.plan.metric, self.plan.pull = np.zeros((self.count, size, size)), np.zeros_like(self.z)
        self.plan.metric[:, own, own] = self.plan.position_weight * metric
        self.plan.pull[:, own] = self.plan.position_weight * pull

    def begin_at(self, trajectory: Samples) -> None:
        """Take a trajectory as the first guess."""
        turns = _turns(self.reference, trajectory.quaternions[self.own])
        moved = (trajectory.positions[self.own] - self.positions) / self.length
        guess = np.hstack([turns, moved])[:, : self.z.shape[1]]
        self.z += np.where(self.fixed, 0.0, guess - self.z)

    def keeps_limits(self) -> bool:
        """Whether the first guess keeps all limits as it is."""
        value = planner.values(self.plan) * self.plan.row_scale
        return bool(np.all((value >= -_LIMIT_TOLERANCE) | ~self.plan.heeded))

    def _fix(self, boundaries: dict[int, Boundary]) -> NDArray[np.bool_]:
        """Mark the unknowns that boundaries fix, and spread the change over the first guess."""
        fixed = np.zeros_like(self.z, dtype=bool)
        turns, shifts = {}, {}
        for sample, boundary in boundaries.items():
            k = (sample - self.own.start) % self.count
            if boundary.quaternion is not None:
                turns[k] = _turns(self.reference[k], boundary.quaternion)
            if boundary.position is not None and self.shifts.size:
                shifts[k] = (boundary.position - self.positions[k]) / self.length
        both = slice(self.space.angular), slice(self.space.angular, None)
        for wanted_here, columns in zip((turns, shifts), both, strict=True):
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
        if self.is_periodic:
            return active
        active[0] = self.levels == "position"
        # Constraints that a fixed boundary pose alone decides are not the projection's to satisfy.
        decided = np.zeros(self.count, dtype=bool)
        for k, boundary in boundaries.items():
            holds_position = boundary.position is not None or hold_position
            holds_rotation = boundary.rotation is not None or not self.space.rotations
            decided[k] = holds_position and holds_rotation
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
        places = [] if self.is_periodic else [0, self.count - 1]
        places += [k for k, b in request.fixed.items() if b.position is not None]
        samples = np.arange(self.own.start, self.count + self.own.start)
        away = np.abs(samples[:, None] - places).min(axis=1, initial=self.count) / (
            _APPROACH * self.count
        )
        units = np.array(self.equalities.row_units + self.limits.row_units, dtype=object)
        cleared = self.is_limit & (self.levels == "position") & (units == UNITS["position"])
        return np.asarray(request.clearance * np.minimum(away, 1.0)[:, None] * cleared)

    def _weigh(self) -> tuple[Floats, Floats]:
        """What a turn costs at each sample, and what its change costs in each step."""
        h = 1 / (len(self.given) - 1)
        velocities, _ = self.given.step_velocities()
        if self.is_carrying:
            places = self.tools.places
            if self.is_periodic:
                places = np.concatenate([places[:, -1:], places], axis=1)
            velocities = np.hstack(list(np.diff(places, axis=1) / self.time_step))
        speed = np.linalg.norm(velocities, axis=1)
        if self.is_periodic:
            steps = slice(None)
        else:
            speed, steps = np.concatenate([speed[:1], speed]), slice(1, None)
        relative = speed / mean if (mean := speed.mean()) else np.ones(self.count)
        return h * (relative + _REST_WEIGHT), _SLOPE / h / (1 + (relative[steps] / _SLOW) ** 2)

    def _twists(self, request: Request) -> list[Floats | None]:
        """Twists that are asked for at the ends, and the reference's own."""
        twists: list[Floats | None] = [None, None]
        if not request.twists:
            return twists
        reference = self.given.with_points(np.hstack([self.given.positions, self.reference]))
        for k, asked in request.twists.items():
            end = min(k, 1)
            own = end_twist(reference, end)
            twists[end] = np.array([np.concatenate(asked), np.concatenate(own)])
        return twists

    def _stages(self, positions: Floats, quaternions: Floats) -> tuple[Floats, Floats]:
        """Positions and quaternions, shape (N + 2, ...), with what an end lacks of a neighbor.

        No step leads to the first sample; nothing is asked of one, but a rule may be undefined at
        rest: it is taken as the step after it.
        """
        if self.is_periodic:
            # After an odd number of whole turns a quaternion comes back as its opposite.
            before = _on_the_side_of(quaternions[-1], quaternions[0])
            after = _on_the_side_of(quaternions[0], quaternions[-1])
            p = np.vstack([positions[-1], positions, positions[0]])
            return p, np.vstack([before, quaternions, after])
        before = _turned(quaternions[0], -_turns(quaternions[0], quaternions[1]))
        p = np.vstack(
            [2 * positions[0] - positions[1], positions, 2 * positions[-1] - positions[-2]]
        )
        return p, np.vstack([before, quaternions, quaternions[-1]])

    def solve(
        self, max_iterations: int, careful: bool, barrier: float = 0.0
    ) -> ProjectedTrajectory:
        """Iterate from the first guess; ``careful`` converges from farther, and more slowly.

        With limits, ``barrier`` is the first tau over the step in time normalized.
        """
        self.plan.careful, iterations = careful, 0
        for _ in range(_MOST_FORMS if self.is_carrying else 1):
            before = self.z.copy()
            self._take_form()
            converged = planner.solve(self.plan, max_iterations, barrier / self.count)
            iterations += self.plan.iteration
            if not converged or np.abs(self.z - before).max() < _SAME_FORM:
                break
        return self.result(converged, iterations, self._whole(self.plan.multipliers))

    def _whole(self, rows: Floats, first: float | Floats = 0.0) -> Floats:
        """Rows of stages as rows of samples: of a period, with those of the first."""
        if not self.is_periodic:
            return rows
        return np.vstack([np.full((1, rows.shape[1]), first), rows])

    def _lengths(self) -> Floats:
        """What each row's residual is measured by: the path's length, or that of the tool's."""
        found, own = [], self.tools.lengths
        carried = [k for k, body in enumerate(self.space.bodies) if not body.is_placed]
        for part in (self.equalities, self.limits):
            for constraint, rows in zip(part.constraints, part.rows, strict=True):
                body = -1 if constraint.coordinates else self.space.body(constraint.body)
                length = own[carried.index(body)] if body in carried else self.length
                found += rows * [length]
        return np.array(found, dtype=np.float64)

    def _tolerances(self) -> Floats:
        """Residuals that count as none: at least what the rounding of the positions causes."""
        both = (np.abs(each).max(initial=0.0) for each in (self.given.positions, self.tools.places))
        speed_scale = self.lengths / self.given.duration
        rounding = 16 * np.finfo(float).eps * max(both) / self.time_step / speed_scale
        return np.asarray(np.maximum(_RESIDUAL_TOLERANCE, rounding))

    def result(self, converged: bool, iterations: int, multipliers: Floats) -> ProjectedTrajectory:
        """What the iterations have come to."""
        quaternions = _turned(self.plan.quaternions[1:-1], self.turns)
        positions = self.positions.copy()
        if self.shifts.size:
            positions += self.length * self.shifts
        if self.is_periodic:
            positions = np.vstack([positions[-1], positions])
            quaternions = np.vstack([_on_the_side_of(quaternions[-1], quaternions[0]), quaternions])
        trajectory = self.given.with_points(np.hstack([positions, quaternions]))
        residuals, margins = self._residuals(trajectory)
        return ProjectedTrajectory(
            trajectory=trajectory,
            turns=_turns(self.given.quaternions, quaternions),
            converged=converged,
            iterations=iterations,
            residual=float(np.abs(residuals).max(initial=0.0)),
            residuals=residuals,
            multipliers=multipliers,
            margins=margins,
            backing=0,
            smoothing=self.smoothing,
        )

    def _residuals(self, trajectory: Samples) -> tuple[Floats, Floats]:
        """Residuals (N, m) and margins (N, k) of a trajectory."""
        own = trajectory.positions[self.own], trajectory.quaternions[self.own]
        positions, quaternions = self._stages(*own)
        as_it_is = np.zeros((self.count + 2, self.z.shape[1]))
        values = planner.values(
            replace(self.plan, positions=positions, quaternions=quaternions, z=as_it_is)
        )
        applies = np.ones_like(self.plan.active)
        if not self.is_periodic:
            # No step leads to the first sample.
            applies[0], applies[-1] = self.levels == "position", self.plan.active[-1]
        if self.plan.stage.system.has_angles or not np.isfinite(values[applies]).all():
            self._require_defined(trajectory)
        nothing = np.where(self.is_limit, np.inf, 0.0)
        values = self._whole(np.where(applies, values, nothing), nothing)
        return values[:, : self.equalities.size], values[:, self.equalities.size :]

    def _require_defined(self, trajectory: Samples) -> None:
        """Refuse constraints that are undefined along a trajectory."""
        # Of equal steps: stamps as large as Unix time are rounded to a fraction of a microsecond.
        steps = np.arange(len(trajectory))
        times: Floats = np.asarray(steps * self.time_step + self.begin, np.float64)
        linear, angular = (
            velocities * (np.diff(trajectory.times)[:, None] / self.time_step)
            for velocities in trajectory.step_velocities()
        )
        accelerations = [
            np.pad(np.diff(v, axis=0) / self.time_step, ((0, 1), (0, 0))) for v in (linear, angular)
        ]
        pose = (times, trajectory.positions, trajectory.quaternions)
        t, p, q = (part[:1] for part in pose)
        for part, more in ((self.equalities, ()), (self.limits, accelerations)):
            part.residuals(t, p, q, linear[:1], angular[:1])
            part.of_steps(*pose, linear, angular, *more)


def _turned(quaternions: Floats, turns: Floats) -> Floats:
    """Rotations, shape (..., 4 b), turned by rotation vectors, shape (..., 3 b)."""
    found = turned(_each(turns, 3), _each(quaternions, 4))
    return found.reshape(quaternions.shape)


def _turns(begins: Floats, ends: Floats) -> Floats:
    """Rotation vectors, shape (..., 3 b), that lead from rotations to others."""
    found = turns_between(_each(begins, 4), _each(ends, 4))
    return found.reshape(*begins.shape[:-1], -1)


def _on_the_side_of(quaternion: Floats, near: Floats) -> Floats:
    """The same rotations, shape (4 b,), by the quaternions near others."""
    both = _each(quaternion, 4), _each(near, 4)
    signs = np.where(np.sum(both[0] * both[1], axis=1, keepdims=True) < 0, -1.0, 1.0)
    return (signs * both[0]).reshape(quaternion.shape)


def _each(rows: Floats, width: int) -> Floats:
    return rows.reshape(*rows.shape[:-1], rows.shape[-1] // width, width)
