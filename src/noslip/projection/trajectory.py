"""Trajectory projection: the feasible trajectory nearest to a given one.

Unknown at each sample are a rotation correction delta (``R = Exp(delta) R_ref``) and, unless held,
a displacement of the position.  Minimized is, with time normalized by the duration and L the path's
length,

    ``int (w_p |p - p_ref|^2 + mu_p |p'' - p_ref''|^2) / L^2 + w_R u |delta|^2 + mu_R |delta''|^2``

subject to the constraints on the discrete motion that the primitive will run, ``(R_k+1,
(p_k+1 - p_k) / dt, ...)``.  The weight u follows the speed: a turn of the tool costs per path cut,
so nothing pulls the tool round while it rests.  Only the acceleration of the *correction* costs, so
a feasible trajectory comes back unchanged.

The paper's "orientation optimized for zero constraint force" is the case with the position held; a
new goal or start is the case with other boundary values.

Newton steps on the optimality conditions, whose matrix is banded when samples and multipliers are
interleaved: time and memory grow linearly with the number of samples.

Limits join as further rows, by the primal-dual interior-point method: a slack s > 0 and a
multiplier mu > 0 with ``h - s = 0`` and ``mu s = tau``, tau going to zero.  In the matrix a limit
is a row like an equality's, with ``-s / mu`` on its diagonal.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from noslip import _arguments
from noslip._typing import Floats
from noslip.constraints.declaration import Constraint
from noslip.constraints.system import ConstraintSystem, as_system
from noslip.errors import ConvergenceError, InputError
from noslip.projection.band import Band
from noslip.projection.blend import spread
from noslip.projection.heading import turn_edge_into_path
from noslip.projection.stage import Entries, stage_function
from noslip.trajectory import PoseTrajectory, continuous_quaternions

End = Literal["free", "position", "rotation", "pose"]

POSITION_WEIGHT = 1e5
POSITION_SMOOTHING = 1e-6
ROTATION_SMOOTHING = 1e-6
MAX_ITERATIONS = 40

_REST_WEIGHT = 1e-3
"""What a turn costs at rest, relative to its cost at mean speed."""
_TURNED_REFERENCE = 1.2 * np.pi
"""Beyond this turn, nearest means nearest to the turned demonstration: Exp is singular at 2 pi."""
_LARGEST_TURN = 0.7
"""Longest Newton step (rad): the linearization holds for little more."""
_GAUSS_NEWTON_STEPS = 2
"""Steps without the constraints' curvature, before multipliers are worth trusting."""
_NEAR = 0.05
"""A careful attempt uses the curvature only once its steps are shorter than this (rad)."""
_ATTEMPTS = ((1.0, False, 1), (10.0, True, 2), (100.0, True, 2), (1000.0, False, 1))
"""Factor on the rotation's smoothing, whether careful, factor on the iterations allowed."""
_DUAL_REGULARIZATION = 1e-12
_STEP_TOLERANCE = 1e-6
_STILL = 1e-3
"""Longest step (rad, or path lengths) of an iteration that may end for want of patience."""
_RESIDUAL_TOLERANCE = 1e-11
"""Relative to the path's mean speed (velocity level) or length (position level)."""
_LIMIT_ATTEMPTS = ((1.0, 1e-2, False), (1.0, 1.0, False), (1.0, 1.0, True), (100.0, 1.0, True))
"""Factor on the rotation's smoothing, first tau over the step in time normalized, careful."""
_LAST_BARRIER = 1e-11
_LIMIT_TOLERANCE = 1e-8
"""As for equalities, of which no such precision is asked."""
_STUCK, _MOST_STUCK = 1e-2, 6
"""An iteration that goes no farther than this fraction of its step, and how many may in a row."""
_BARRIER_FALL, _SHORT_STEP_FALL, _LONG_STEP = 0.1, 0.8, 0.7
"""tau relative to the mean of mu s, after steps longer than this fraction, and after others."""
_LEAST_SLACK = 1e-3
"""First slack of a limit that is violated, relative to the path's mean speed or length."""
_TO_THE_BOUNDARY = 0.99
_LIMIT_PATIENCE = 4
"""Iterations with limits over those without."""
_MOST_SAMPLES = 4000
"""Beyond this, the fourth power of the count in the smoothing terms eats up the precision."""


@dataclass(frozen=True, eq=False)
class ProjectedTrajectory:
    """Result of a trajectory projection.

    Attributes
    ----------
    trajectory : PoseTrajectory
    turns : array, shape (N, 3)
        ``Log(R R_ref^T)``, world frame (rad).
    converged : bool
    iterations : int
    residual : float
        Largest residual over all samples and rows of the equalities, in the constraints' own units.
    residuals : array, shape (N, m)
        Of the equalities.
    multipliers : array, shape (N, m + k)
        Of equalities, then limits.
    margins : array, shape (N, k)
        Of the limits; infinite where they do not apply (no step, no acceleration).
    backing : int
        Stretches in which the demonstration moves backwards, left so (see ``heading``).
    smoothing : float
        mu_R with which it converged.
    left_out : tuple of str
        Soft limits with which it did not converge, and which it therefore does not heed.
    """

    trajectory: PoseTrajectory
    turns: Floats
    converged: bool
    iterations: int
    residual: float
    residuals: Floats
    multipliers: Floats
    margins: Floats
    backing: int
    smoothing: float
    left_out: tuple[str, ...] = ()


def project_trajectory(
    trajectory: PoseTrajectory,
    constraints: ConstraintSystem | Constraint | Sequence[Constraint],
    *,
    hold_position: bool = False,
    start: End = "free",
    end: End = "free",
    start_position: ArrayLike | None = None,
    start_rotation: Rotation | None = None,
    end_position: ArrayLike | None = None,
    end_rotation: Rotation | None = None,
    keep: Mapping[int, End] | None = None,
    begin: float = 0.0,
    position_weight: float = POSITION_WEIGHT,
    position_smoothing: float = POSITION_SMOOTHING,
    rotation_smoothing: float = ROTATION_SMOOTHING,
    max_iterations: int = MAX_ITERATIONS,
    on_failure: Literal["raise", "return"] = "raise",
) -> ProjectedTrajectory:
    """Find the nearest trajectory that satisfies constraints and limits at every step.

    Parameters
    ----------
    trajectory : PoseTrajectory
        Uniformly sampled, 4 samples or more.
    constraints : ConstraintSystem or constraints
    hold_position : bool
        Only the orientation gives way, as in the paper.
    start, end : "free", "position", "rotation" or "pose"
        What of the first and last sample stays as it is.
    start_position, end_position : array, shape (3,), optional
        Fix the position there to another value (m).
    start_rotation, end_rotation : Rotation, optional
        Fix the rotation there to another value.
    keep : mapping from sample number to what stays as it is there, optional
        For samples between the ends.  If the second stays as it is together with the first, so
        does the velocity with which the motion begins.
    begin : float
        Time at the first sample (s), for constraints that depend on it.
    position_weight, position_smoothing, rotation_smoothing : float
        w_p, mu_p and mu_R of the module's formula; w_R is 1.
    max_iterations : int
        Newton steps in the first attempt.  If they do not suffice, it tries again with more
        smoothing of the rotation, up to a thousandfold, and with steps that converge from farther;
        the result says with how much.
    on_failure : "raise" or "return"

    Raises
    ------
    InputError
        If the samples are not uniform, or boundary values contradict ``hold_position``.
    ConvergenceError
        If no attempt converges (unless ``on_failure="return"``).
    """
    system = as_system(constraints)
    if not trajectory.is_uniform or len(trajectory) < 4:
        raise InputError(
            f"{trajectory.name}: a trajectory projection needs 4 or more uniform samples; "
            "resample it first"
        )
    last = len(trajectory) - 1
    boundaries = {
        0: _Boundary.of("start", start, start_position, start_rotation),
        last: _Boundary.of("end", end, end_position, end_rotation),
    }
    for k, kept in (keep or {}).items():
        if not isinstance(k, (int, np.integer)) or not 0 < k < last:
            raise InputError(f"keep: samples between the ends are 1 to {last - 1}, got {k!r}")
        boundaries[k] = _Boundary.of(f"keep[{k}]", kept, None, None)
    if hold_position and any(b.position is not None for b in boundaries.values()):
        raise InputError("hold_position=True keeps every position; no end can get another one")
    max_iterations = _arguments.count("max_iterations", max_iterations)
    weights = (
        _arguments.positive("position_weight", position_weight),
        _arguments.not_negative("position_smoothing", position_smoothing),
        _arguments.positive("rotation_smoothing", rotation_smoothing),
    )
    arguments = (hold_position, boundaries, begin, weights, max_iterations)
    best = _project(trajectory, system.equalities, *arguments)
    if best.converged and system.limits.size:
        best = _heed_limits(trajectory, system, best, *arguments)
    if best.converged or on_failure == "return":
        return best
    names = ", ".join(c.name for c in system.constraints)
    freer = "let the position give way (hold_position=False), " if hold_position else ""
    raise ConvergenceError(
        f"{trajectory.name}: no trajectory near it found that satisfies {names} (residual "
        f"{best.residual:.2g} after {best.iterations} iterations); {freer}low-pass it more, trim "
        "rests, raise rotation_smoothing, or free its ends"
    )


def project_heeding_what_it_can(
    trajectory: PoseTrajectory, system: ConstraintSystem, **options: Any
) -> ProjectedTrajectory:
    """Project as :func:`project_trajectory`; limits that it cannot heed are left to the run time.

    Raises
    ------
    ConvergenceError
        If the equalities alone do not converge.
    """
    if system.limits.size:
        result = project_trajectory(trajectory, system, **options, on_failure="return")
        if result.converged:
            return result
    result = project_trajectory(trajectory, system.equalities, **options)
    return replace(result, left_out=system.limits.names)


def _project(
    trajectory: PoseTrajectory,
    system: ConstraintSystem,
    hold_position: bool,
    boundaries: _Boundaries,
    begin: float,
    weights: tuple[float, float, float],
    max_iterations: int,
) -> ProjectedTrajectory:
    """Attempt after attempt; the best result if none converges."""
    best: ProjectedTrajectory | None = None
    if len(trajectory) > _MOST_SAMPLES and set(boundaries) == {0, len(trajectory) - 1}:
        unturned = np.zeros((len(trajectory), 3))
        as_given = _Problem(trajectory, system, hold_position, boundaries, begin, weights, unturned)
        if as_given.is_solved():
            return as_given.solve(1, careful=False)
        best = _project_from_coarse(
            trajectory, system, hold_position, boundaries, begin, weights, max_iterations
        )
        if best.converged:
            return best
    for factor, careful, patience in _ATTEMPTS:
        attempted = (*weights[:2], weights[2] * factor)
        heading = turn_edge_into_path(_moved(trajectory, boundaries), system, attempted[2])
        problem = _Problem(
            trajectory, system, hold_position, boundaries, begin, attempted, heading.turns
        )
        result = replace(problem.solve(patience * max_iterations, careful), backing=heading.backing)
        if result.converged:
            return result
        if best is None or result.residual < best.residual:
            best = result
    assert best is not None
    return best


def _heed_limits(
    trajectory: PoseTrajectory,
    system: ConstraintSystem,
    without: ProjectedTrajectory,
    hold_position: bool,
    boundaries: _Boundaries,
    begin: float,
    weights: tuple[float, float, float],
    max_iterations: int,
) -> ProjectedTrajectory:
    """Go on from the projection without limits; leave out soft ones, the least important first."""
    kept, left_out = list(system.constraints), list[str]()
    names = dict(zip(map(id, system.constraints), system.names, strict=True))
    while True:
        result = _project_within(
            trajectory,
            ConstraintSystem(kept) if left_out else system,
            without,
            hold_position,
            boundaries,
            begin,
            weights,
            max_iterations,
        )
        least = max((c.priority for c in kept if c.relation == "nonnegative"), default=0)
        if result.converged or least == 0:
            return replace(result, left_out=tuple(left_out))
        left_out += [names[id(c)] for c in kept if c.priority == least]
        kept = [c for c in kept if c.priority < least]


def _project_within(
    trajectory: PoseTrajectory,
    system: ConstraintSystem,
    without: ProjectedTrajectory,
    hold_position: bool,
    boundaries: _Boundaries,
    begin: float,
    weights: tuple[float, float, float],
    max_iterations: int,
) -> ProjectedTrajectory:
    """Interior-point iterations from a trajectory that satisfies the equalities."""
    weights = (*weights[:2], without.smoothing)
    turns = np.asarray(without.turns)
    best: ProjectedTrajectory | None = None
    for factor, barrier, careful in _LIMIT_ATTEMPTS:
        attempted = (*weights[:2], weights[2] * factor)
        problem = _Problem(trajectory, system, hold_position, boundaries, begin, attempted, turns)
        problem.begin_at(without.trajectory)
        if problem.keeps_limits():
            held = np.zeros((len(trajectory), system.size))
            held[:, : system.equalities.size] = without.multipliers
            kept = problem.result(True, without.iterations, held)
            return replace(kept, backing=without.backing)
        result = problem.solve(_LIMIT_PATIENCE * max_iterations, careful, barrier)
        result = replace(result, iterations=without.iterations + result.iterations)
        if result.converged or best is None:
            best = replace(result, backing=without.backing)
        if result.converged:
            break
    assert best is not None
    return best


def _project_from_coarse(
    trajectory: PoseTrajectory,
    system: ConstraintSystem,
    hold_position: bool,
    boundaries: _Boundaries,
    begin: float,
    weights: tuple[float, float, float],
    max_iterations: int,
) -> ProjectedTrajectory:
    """Project fewer samples, carry the correction over by splines, and make it exact.

    On the fine grid only what interpolation left is corrected, so its many samples cost neither
    iterations nor precision.
    """
    times = np.linspace(trajectory.times[0], trajectory.times[-1], _MOST_SAMPLES)
    few = trajectory.resampled(times=times)
    ends = {k and _MOST_SAMPLES - 1: boundary for k, boundary in boundaries.items()}
    coarse = _project(few, system, hold_position, ends, begin, weights, max_iterations)
    turned = coarse.trajectory.rotations * few.rotations.inv()
    moved = coarse.trajectory.positions - few.positions
    inside = np.clip(trajectory.times, times[0], times[-1])
    guess = PoseTrajectory(
        times=trajectory.times,
        positions=trajectory.positions + CubicSpline(times, moved)(inside),
        rotations=RotationSpline(times, turned)(inside) * trajectory.rotations,
        name=trajectory.name,
    )
    kept = {k: replace(b, position=None, rotation=None) for k, b in boundaries.items()}
    weights = (*weights[:2], coarse.smoothing)
    problem = _Problem(
        guess, system, hold_position, kept, begin, weights, np.zeros((len(guess), 3))
    )
    fine = problem.solve(max_iterations, careful=False)
    return replace(
        fine,
        turns=(fine.trajectory.rotations * trajectory.rotations.inv()).as_rotvec(),
        iterations=coarse.iterations + fine.iterations,
        backing=coarse.backing,
    )


@dataclass(frozen=True, eq=False)
class _Boundary:
    """What a sample must keep, or an end become."""

    fixes_position: bool
    fixes_rotation: bool
    position: Floats | None
    rotation: Rotation | None

    @classmethod
    def of(
        cls, name: str, fixed: str, position: ArrayLike | None, rotation: Rotation | None
    ) -> _Boundary:
        if fixed not in get_args(End):
            raise InputError(f"{name} must be free, position, rotation or pose; got {fixed!r}")
        if position is not None:
            position = _arguments.vector(f"{name}_position", position)
        if rotation is not None:
            rotation = _arguments.rotation(f"{name}_rotation", rotation)
        return cls(
            fixed in ("position", "pose") or position is not None,
            fixed in ("rotation", "pose") or rotation is not None,
            position,
            rotation,
        )


_Boundaries = dict[int, _Boundary]
"""By sample number."""


def _moved(trajectory: PoseTrajectory, boundaries: _Boundaries) -> PoseTrajectory:
    """Return the trajectory with its ends moved to where boundaries want their positions."""
    shifts: dict[int, Floats] = {
        k: boundary.position - trajectory.positions[k]
        for k, boundary in boundaries.items()
        if boundary.position is not None
    }
    if not shifts:
        return trajectory
    positions = trajectory.positions + spread(shifts, np.arange(len(trajectory)))
    return PoseTrajectory(trajectory.times, positions, trajectory.rotations, name=trajectory.name)


class _Problem:
    """One projection as a banded Newton iteration.

    Stage k holds its unknowns z_k (rotation vector, and position displacement over L unless held)
    and its multipliers lambda_k, one a row of the constraints on the step that ends in k.  At
    stage 0 only position-level rows exist.
    """

    def __init__(
        self,
        trajectory: PoseTrajectory,
        system: ConstraintSystem,
        hold_position: bool,
        boundaries: _Boundaries,
        begin: float,
        weights: tuple[float, float, float],
        turns: Floats,
    ) -> None:
        self.given, self.system, self.smoothing = trajectory, system, weights[2]
        self.begin = begin
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

        self.fixed = self._fix(boundaries)
        self._weigh(*weights)
        self._evaluate = stage_function(system, hold_position, count)
        self.parameters = self._stage_parameters()
        # Constraints that a fixed boundary pose alone decides are not the projection's to satisfy.
        self.active = np.ones((count, rows), dtype=bool)
        self.active[0] = levels == "position"
        for k in range(count):
            sample = boundaries.get(k)
            if sample is None or not (
                (sample.fixes_position or hold_position) and sample.fixes_rotation
            ):
                break
            self.active[k] = False
        # An acceleration is that from the step before a sample to the step after it.
        self.active[-1] = levels != "acceleration"
        self.slack = np.ones((count, rows))

    def begin_at(self, trajectory: PoseTrajectory) -> None:
        """Take a trajectory as the first guess."""
        turned = (trajectory.rotations * self.reference.inv()).as_rotvec()
        self.z[:, :3] += np.where(self.fixed[:, :3], 0.0, turned - self.z[:, :3])
        if self.unknowns == 6:
            moved = (trajectory.positions - self.given.positions) / self.length
            self.z[:, 3:] += np.where(self.fixed[:, 3:], 0.0, moved - self.z[:, 3:])

    def keeps_limits(self) -> bool:
        """Whether the first guess keeps all limits as it is."""
        value, _, _ = self._evaluate(self.z, self.parameters, np.zeros((self.count, self.rows)))
        heeded = self.active & self.is_limit
        return bool(np.all((value * self.row_scale >= -_LIMIT_TOLERANCE) | ~heeded))

    def _fix(self, boundaries: _Boundaries) -> NDArray[np.bool_]:
        """Mark the unknowns that boundaries fix, and spread the change over the first guess."""
        fixed = np.zeros_like(self.z, dtype=bool)
        turns, shifts = {}, {}
        for k, boundary in boundaries.items():
            if boundary.fixes_rotation:
                wanted = boundary.rotation or self.given.rotations[k]
                turns[k] = (wanted * self.reference[k].inv()).as_rotvec()
            if boundary.fixes_position and self.unknowns == 6:
                at = self.given.positions[k]
                moved = at if boundary.position is None else boundary.position
                shifts[k] = (moved - at) / self.length
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

    def _stage_parameters(self) -> Floats:
        quaternions = continuous_quaternions(self.reference)
        previous = np.concatenate([[0], np.arange(self.count - 1)])
        following = np.concatenate([np.arange(1, self.count), [self.count - 1]])
        positions = self.given.positions
        # Of equal steps: stamps as large as Unix time are rounded to a fraction of a microsecond.
        velocities = np.diff(positions, axis=0, prepend=positions[:1]) / self.time_step
        times = self.given.times - self.given.times[0] + self.begin
        return np.column_stack(
            [
                quaternions[previous],
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
            value, _, _ = self._evaluate(self.z, self.parameters, multipliers)
            self.slack = np.where(heeded, np.maximum(value * self.row_scale, _LEAST_SLACK), 1.0)
            multipliers = np.where(heeded, -barrier / self.slack, 0.0)
        converged, iteration, step_size = False, 0, np.inf
        for iteration in range(max_iterations + 1):
            value, jacobian, curvature = self._evaluate(
                self.z, self.parameters, multipliers * self.row_scale
            )
            value = np.where(self.active, value * self.row_scale, 0.0)
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
            use_curvature = step_size < _NEAR if careful else iteration >= _GAUSS_NEWTON_STEPS
            step, new = self._newton_step(
                value, jacobian, curvature if use_curvature else None, multipliers, barrier
            )
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
        if self.z.any():
            return False
        multipliers = np.zeros((self.count, self.rows))
        value, _, _ = self._evaluate(self.z, self.parameters, multipliers)
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
        curvature: Entries | None,
        multipliers: Floats,
        barrier: float,
    ) -> tuple[Floats, Floats]:
        reaches_over = "acceleration" in self.limits.row_levels
        band = Band(self.count, self.stage, self.unknowns if reaches_over else 0)
        for j in range(self.unknowns):
            band.add_bending(j, self.bending[j])
            band.add(0, j, j, self.weights[:, j])
        scaled_active = self.active * self.row_scale
        for (row, column), entries in jacobian.items():
            entries = entries * scaled_active[:, row]
            block, unknown = divmod(column, self.unknowns)
            i = self.unknowns + row
            # Columns 0 .. n-1 belong to the sample before, then come the one itself and the next.
            shift = block - 1
            band.add(shift, i, unknown, entries)
            band.add_transposed(shift, i, unknown, entries)
        for (row, column), entries in (curvature or {}).items():
            (a, i), (b, j) = divmod(row, self.unknowns), divmod(column, self.unknowns)
            band.add_between(a - 1, i, b - 1, j, entries)
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
        linear, angular = trajectory.step_velocities()
        # Of equal steps: stamps as large as Unix time are rounded to a fraction of a microsecond.
        times = np.arange(self.count) * self.time_step + self.begin
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
