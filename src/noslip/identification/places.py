"""Where in the world a point of the body stays: surfaces, pivots, hinges, and what rolls.

Each kind is a function of a pose that is zero if it holds.  Its parameters are fitted by least
squares, weighted by what the noise of a pose does to it, from a few starts each of which is solved
linearly.  The most specific kind that holds is believed, the simplest surface among those alike.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip.constraints.contact import CylinderContact, PlaneContact, SphereContact
from noslip.constraints.declaration import Constraint
from noslip.constraints.fixed_point import FixedPoint
from noslip.constraints.remote_center import RemoteCenter
from noslip.constraints.rolling import RollingDisc, RollingSphere
from noslip.constraints.tool_axis import ToolAxis
from noslip.identification.identified import Place
from noslip.identification.rows import crossing
from noslip.trajectory import PoseTrajectory

SHARE = 0.005
"""Of the motion's extent, how far from a place noise aside it may be: people's hands and bending
tools leave a table by more than a sensor's noise, random motions of many turns meet no place."""
TOLD = 0.01
"""Standard error (m) above which the recordings do not tell where a point of the body is."""
AHEAD = 1.5
"""Residual held out, over that fitted, above which a place is a coincidence."""
CLEAR = 3.0
"""Largest standard error of the body's point on a sphere or cylinder, over the residual.  A needle
that bends is near some sphere all along, whose point is told to 5 to 20 times the noise of one
sample; where the rule holds, a recording of some turns tells it to once the noise and less."""
LONGEST = 0.5
"""Meters: a point farther from the body's origin is none of the tool.  A door's hinge may be; what
drives on a circle moves just alike."""
TURNED = 0.05
"""Radians (rms): a body that turns less tells of none of its points."""
SURE = 0.1
"""Largest standard error of a believed axis (rad), and of a radius by itself: a patch so small or a
path so straight that they are not known does not show the rule."""
FINEST = 1e-7
"""Least noise (m, rad): what is left by the chords of samples, and by digits in files."""
_LONGEST = 2000
"""Samples that are fitted, at even intervals: real sensors err slowly, so that more tell little."""
_COARSE = 150
"""Samples that are enough for choosing a start."""
_STARTS = 4
"""Of the best of which the fit is the best."""
_GLANCE = 8
"""Steps after which starts are compared; near enough, ten are all that it takes."""
_DRAWS = 100
"""Of noise: they tell a variance to 14 %."""
_FOLDS = 4
"""Parts that are held out in turn."""
_FAR = 5.0
"""Times that share: a place as far as this from a few samples is given up without asking all."""
_SAFETY = 1.5
"""Of what noise alone would seem to tell of the parameters, how much is not believed."""
_SPANS = {"unit": 1.0, "body": 1.0, "world": 10.0, "length": 10.0}
"""By kind of parameter, what is known before any recording (m): tools are shorter than a meter."""
_NUDGE = 1e-6
"""Of a pose (m, rad), for derivatives of residuals by it."""


@dataclass(frozen=True, eq=False)
class _Poses:
    """Poses about their mean position, of all recordings; `turns` is the integral of w dt."""

    positions: Floats
    matrices: Floats
    turns: Floats
    recording: NDArray[np.integer]
    picked: NDArray[np.integer]

    def moved(self, ways: Floats, turns: Floats) -> _Poses:
        """With other positions (m) and rotations (rotation vectors, world frame)."""
        return replace(
            self,
            positions=self.positions + ways,
            matrices=Rotation.from_rotvec(turns).as_matrix() @ self.matrices,
            turns=self.turns + turns,
        )

    def some(self, most: int) -> _Poses:
        """Keep samples at even intervals, and fit to all of them."""
        kept = slice(None, None, -(-len(self.positions) // most))
        fewer = replace(
            self,
            positions=self.positions[kept],
            matrices=self.matrices[kept],
            turns=self.turns[kept],
            recording=self.recording[kept],
        )
        return replace(fewer, picked=np.arange(len(fewer.positions)))

    def at(self, point: Floats) -> Floats:
        """Return where a body's point is, shape (N, 3)."""
        return np.asarray(self.positions + self.matrices @ point)

    @cached_property
    def nudged(self) -> list[_Poses]:
        """Along and about each axis of the world."""
        steps = _NUDGE * np.eye(3)
        zero = np.zeros(3)
        return [self.moved(s, zero) for s in steps] + [self.moved(zero, s) for s in steps]


Values = dict[str, Any]


@dataclass(frozen=True, eq=False)
class _Kind:
    """One rule: its parameters by name and kind, and what must be zero, shape (N, rows).

    If it `floats`, then only up to a constant in each recording.
    """

    name: str
    rows: int
    parts: dict[str, str]
    residual: Callable[[_Poses, Values], Floats]
    starts: Callable[[_Poses], Iterator[Values]]
    constraints: Callable[[Values], tuple[Constraint, ...]]
    floats: bool = False

    @property
    def spans(self) -> Floats:
        sizes = {part: 1 if part == "length" else 3 for part in _SPANS}
        return np.concatenate([np.full(sizes[k], _SPANS[k]) for k in self.parts.values()])

    def packed(self, values: Values) -> Floats:
        return np.concatenate([np.atleast_1d(values[name]) for name in self.parts])

    def split(self, x: Floats) -> Values:
        found: Values = {}
        for name, part in self.parts.items():
            size = 1 if part == "length" else 3
            value, x = x[:size], x[size:]
            if part == "unit":
                value = value / np.linalg.norm(value)
            found[name] = float(value[0]) if part == "length" else value
        return found

    def where(self, name: str) -> slice:
        before = list(self.parts)[: list(self.parts).index(name)]
        start = sum(1 if self.parts[k] == "length" else 3 for k in before)
        return slice(start, start + (1 if self.parts[name] == "length" else 3))

    def errors(self, poses: _Poses, x: Floats) -> Floats:
        """Residuals of the picked samples, shape (M, rows)."""
        found: Floats = self.residual(poses, self.split(x))[poses.picked]
        if self.floats:
            for k in np.unique(poses.recording[poses.picked]):
                mine = poses.recording[poses.picked] == k
                found[mine] -= found[mine].mean(axis=0)
        return found

    def noise(self, poses: _Poses, x: Floats, noise: tuple[float, float]) -> Floats:
        """Standard deviations of the residuals that noise of the poses makes, shape (M, rows)."""
        values = self.split(x)
        here = self.residual(poses, values)
        squares = np.zeros_like(here)
        for k, other in enumerate(poses.nudged):
            squares += (noise[k // 3] / _NUDGE * (self.residual(other, values) - here)) ** 2
        return np.asarray(np.sqrt(squares[poses.picked]))


@dataclass(frozen=True, eq=False)
class _Fit:
    x: Floats
    scales: Floats
    cost: float


def fit_places(
    trajectories: Sequence[PoseTrajectory], noise: tuple[float, float], *, surfaces: bool = True
) -> list[Place]:
    """Fit where the body stays, most specific first; no more is tried once a kind holds.

    A hinge keeps a point, and so do all surfaces through it: what follows from a kind that holds is
    not said again.  An axis that keeps its direction is said beside a surface.  A plane is a sphere
    of any large radius: it is tried first.

    Parameters
    ----------
    trajectories : sequence of PoseTrajectory
        Of one tool in one world.
    noise : (float, float)
        Standard deviation of a sample's position (m) and rotation (rad, about each axis).
    surfaces : bool
        Whether to try surfaces and an axis that keeps its direction too, not only pivots and what
        rolls.

    Returns
    -------
    list of Place
        What was tried.  ``values`` are the parameters by name, ``errors`` the standard error of a
        number and the covariance, shape (3, 3), of a vector: directions and points of the world in
        its frame, ``reference_point``, ``shaft``, ``axle`` and ``axis`` of a hinge in the body's.
    """
    noise = max(noise[0], FINEST), max(noise[1], FINEST)
    poses, origin = _poses(trajectories)
    # What does not leave the noise may turn on the spot.
    extent = max(float(np.sqrt(poses.positions.var(axis=0).sum())), 100 * noise[0])
    found: list[Place] = []
    if np.sqrt(poses.matrices.var(axis=0).sum() / 2) < TURNED:
        return found

    def holds(kind: _Kind) -> bool:
        found.append(_place(kind, poses, noise, origin, extent))
        return found[-1].holds

    if holds(_FIXED_POINT):
        if holds(_TOOL_AXIS):
            return [_hinge(*found)]
        return found[:1]
    if any(map(holds, (_ROLLING_DISC, _ROLLING_SPHERE, _REMOTE_CENTER))) or not surfaces:
        return found
    holds(_TOOL_AXIS)
    any(map(holds, (_PLANE, _SPHERE, _CYLINDER)))
    return found


def _poses(trajectories: Sequence[PoseTrajectory]) -> tuple[_Poses, Floats]:
    positions = np.concatenate([each.positions for each in trajectories])
    origin = positions.mean(axis=0)
    rotations = Rotation.concatenate([each.rotations for each in trajectories])
    counts = [len(each) for each in trajectories]
    recording = np.repeat(np.arange(len(counts)), counts)
    return _Poses(
        positions - origin,
        rotations.as_matrix(),
        _turns(rotations, recording),
        recording,
        np.arange(0, len(positions), -(-len(positions) // _LONGEST)),
    ), origin


def _turns(rotations: Rotation, recording: NDArray[np.integer]) -> Floats:
    """Integral of the angular velocity (rad), shape (N, 3), which rests between recordings."""
    steps = (rotations[1:] * rotations[:-1].inv()).as_rotvec()
    steps[np.diff(recording) > 0] = 0
    return np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])


# ---------------------------------------------------------------- fitting


def _place(
    kind: _Kind, poses: _Poses, noise: tuple[float, float], origin: Floats, extent: float
) -> Place:
    coarse = poses.some(_COARSE)
    starts = [
        _fit(kind, coarse, kind.packed(start), noise, rounds=1, steps=_GLANCE)
        for start in kind.starts(coarse)
    ]
    starts.sort(key=lambda fit: fit.cost)
    fits = [_fit(kind, coarse, start.x, noise, rounds=1) for start in starts[:_STARTS]]
    best = min(fits, key=lambda fit: fit.cost)
    unit = 1.0 if kind is _TOOL_AXIS else extent
    # Noise that were a tenth of all motion would be of a fit that has run away.
    alone = min(_rms(best.scales), 0.1 * unit)
    near = _rms(kind.errors(coarse, best.x)) < 2 * alone + _FAR * SHARE * unit
    if near:
        best = _fit(kind, poses, best.x, noise)
    else:
        poses = coarse
    covariance = _covariance(kind, poses, best, noise)
    point = kind.where("reference_point") if "reference_point" in kind.parts else None
    unknown = np.zeros((0, 3))
    if point is not None:
        squares, directions = np.linalg.eigh(covariance[point, point])
        unknown = directions.T[squares > TOLD**2]
        if len(unknown):
            best = _fit(kind, poses, best.x, noise, unknown)
    errors = kind.errors(poses, best.x)
    residual, alone = _rms(errors), _rms(best.scales)
    covariance = covariance * _excess(errors / best.scales)
    values, spread = _told(kind, best.x, covariance, origin)
    near = near and residual**2 < alone**2 + max(0.5 * alone, SHARE * unit) ** 2
    ahead = _held_out(kind, poses, best.x, noise, unknown) if near else residual
    holds = (
        near
        and ahead < AHEAD * max(residual, alone)
        and _is_sure(kind, values, spread, unknown)
        and (kind not in (_SPHERE, _CYLINDER) or _spread(spread) < CLEAR * max(residual, alone))
    )
    return Place(
        kind=kind.name,
        constraints=kind.constraints(values) if holds else (),
        rows=kind.rows,
        residual=residual,
        holdout=ahead,
        ratio=residual / alone,
        holds=holds,
        values=values,
        errors=spread,
        notes=_notes(kind, values, unknown),
    )


def _fit(
    kind: _Kind,
    poses: _Poses,
    x: Floats,
    noise: tuple[float, float],
    unknown: Floats | None = None,
    *,
    rounds: int = 2,
    steps: int = 20,
) -> _Fit:
    """Least squares from a start; a body's point stays at the origin along what is unknown.

    Weights are those of the start, then of what was found.
    """
    spans = kind.spans
    units = [kind.where(name) for name, part in kind.parts.items() if part == "unit"]
    pulled = np.ones(len(x))
    for unit in units:
        pulled[unit] = 0.0
    scales = kind.noise(poses, x, noise)

    def residuals(y: Floats) -> Floats:
        rows = [(kind.errors(poses, y) / scales).ravel(), pulled * y / spans]
        rows.append(np.array([y[unit] @ y[unit] - 1 for unit in units]))
        if unknown is not None and len(unknown):
            # A micrometer.
            rows.append(unknown @ y[kind.where("reference_point")] / 1e-6)
        return np.concatenate(rows)

    for _ in range(rounds):
        x = scipy.optimize.least_squares(residuals, x, method="lm", max_nfev=steps).x
        for unit in units:
            x[unit] /= np.linalg.norm(x[unit])
        cost = float(np.sum(residuals(x) ** 2))
        scales = kind.noise(poses, x, noise)
    return _Fit(x, scales, cost)


def _slopes(kind: _Kind, poses: _Poses, fit: _Fit) -> Floats:
    """Of the weighted residuals by the parameters over their spans, shape (M rows, k)."""
    columns = []
    for step in np.diag(1e-6 * kind.spans):
        ahead, behind = (kind.errors(poses, fit.x + side * step) for side in (1, -1))
        columns.append(((ahead - behind) / (2e-6 * fit.scales)).ravel())
    return np.column_stack(columns)


def _covariance(kind: _Kind, poses: _Poses, fit: _Fit, noise: tuple[float, float]) -> Floats:
    """Of the parameters: what is not told has what was known before.

    Noise of the poses makes it seem that they move where they do not; what that alone would tell,
    found by adding as much again, is not believed.
    """
    slopes = _slopes(kind, poses, fit)
    rng = np.random.default_rng(0)
    shape = poses.positions.shape
    shaken = poses.moved(noise[0] * rng.normal(size=shape), noise[1] * rng.normal(size=shape))
    false = _slopes(kind, shaken, fit) - slopes
    told, directions = np.linalg.eigh(slopes.T @ slopes - _SAFETY * false.T @ false)
    inverse = (directions / (1 + np.maximum(told, 0))) @ directions.T
    if kind.floats:
        inverse = inverse @ (np.eye(len(fit.x)) + _pulls(kind, poses, fit, noise, slopes)) @ inverse
    found = inverse * np.outer(kind.spans, kind.spans)
    for name, part in kind.parts.items():
        if part == "unit":
            where = kind.where(name)
            across = np.eye(len(fit.x))
            across[where, where] -= np.outer(fit.x[where], fit.x[where])
            found = across @ found @ across
    return np.asarray(found)


def _pulls(
    kind: _Kind, poses: _Poses, fit: _Fit, noise: tuple[float, float], slopes: Floats
) -> Floats:
    """What noise pulls the parameters by, covariance of ``slopes' errors``.

    Found by drawing noise anew: as a body rolls, that of its turns adds up.
    """
    rng, still = np.random.default_rng(1), kind.errors(poses, fit.x)
    rotations = Rotation.from_matrix(poses.matrices)
    shape, pulls = poses.positions.shape, []
    for _ in range(_DRAWS):
        shaken = Rotation.from_rotvec(noise[1] * rng.normal(size=shape)) * rotations
        moved = replace(
            poses,
            positions=poses.positions + noise[0] * rng.normal(size=shape),
            matrices=shaken.as_matrix(),
            turns=_turns(shaken, poses.recording),
        )
        pulls.append(slopes.T @ ((kind.errors(moved, fit.x) - still) / fit.scales).ravel())
    return np.asarray(np.transpose(pulls) @ pulls / _DRAWS)


def _excess(errors: Floats) -> float:
    """Factor of a variance for residuals larger than noise, and alike from one to the next.

    Of a first-order autoregression: ``(1 + rho) / (1 - rho)``.
    """
    alike = float(np.sum(errors[1:] * errors[:-1])) / max(float(np.sum(errors**2)), 1e-300)
    rho = min(alike, 0.99) if alike > 3 / np.sqrt(errors.size) else 0.0
    return max(1.0, float(np.mean(errors**2)) * (1 + rho) / (1 - rho))


def _held_out(
    kind: _Kind, poses: _Poses, x: Floats, noise: tuple[float, float], unknown: Floats
) -> float:
    """Root mean square residual on each recording, or eighth of the time, by fits to others."""
    recordings = poses.recording[poses.picked]
    parts = np.arange(len(poses.picked)) * 2 * _FOLDS // len(poses.picked)
    folds = (recordings if recordings[-1] >= _FOLDS - 1 else parts) % _FOLDS
    squares = []
    for k in range(_FOLDS):
        fit = _fit(kind, replace(poses, picked=poses.picked[folds != k]), x, noise, unknown)
        squares.append(kind.errors(replace(poses, picked=poses.picked[folds == k]), fit.x) ** 2)
    return float(np.sqrt(np.mean(np.concatenate(squares))))


def _spread(errors: Values) -> float:
    return float(np.sqrt(np.linalg.norm(errors["reference_point"], 2)))


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


# ---------------------------------------------------------------- what is said


def _told(kind: _Kind, x: Floats, covariance: Floats, origin: Floats) -> tuple[Values, Values]:
    values, errors = kind.split(x), {}
    for name, part in kind.parts.items():
        where = kind.where(name)
        block = covariance[where, where]
        errors[name] = float(np.sqrt(block[0, 0])) if part == "length" else block
        if part == "world":
            values[name] = values[name] + origin
        if part == "length":
            values[name] = abs(values[name])
    return values, errors


def _is_sure(kind: _Kind, values: Values, errors: Values, unknown: Floats) -> bool:
    if np.linalg.norm(values.get("reference_point", 0.0)) > LONGEST:
        return False
    for name, part in kind.parts.items():
        if part == "unit" and np.linalg.norm(errors[name], 2) > SURE**2:
            return False
        if part == "length" and errors[name] > SURE * values[name]:
            return False
    if kind is _REMOTE_CENTER and np.linalg.norm(errors["point"], 2) > TOLD**2:
        return False
    # Any turn tells two directions; a body that does not turn has no pivot.
    return kind is not _FIXED_POINT or len(unknown) < 2


def _notes(kind: _Kind, values: Values, unknown: Floats) -> tuple[str, ...]:
    """Say along which body directions the point is not told, but for those that do not matter."""
    free = values.get("shaft")
    if free is not None:
        unknown = unknown - np.outer(unknown @ free, free)
        unknown = np.linalg.svd(unknown)[2][: np.sum(np.linalg.norm(unknown, axis=1) > 0.5)]
    if not len(unknown):
        return ()
    if len(unknown) == 3:
        return (f"{kind.name}: of which point of the body cannot be told; turn the tool",)
    texts = (", ".join(f"{value:.2f}" for value in np.round(axis, 2) + 0.0) for axis in unknown)
    along = " and ".join(f"({text})" for text in texts)
    return (f"{kind.name}: where the point is along {along} of the body cannot be told",)


def _hinge(pivot: Place, axis: Place) -> Place:
    """A pivot and an axis that keeps its direction, as one."""
    return replace(
        pivot,
        kind="fixed axis",
        constraints=pivot.constraints + axis.constraints,
        rows=5,
        values=pivot.values | axis.values,
        errors=pivot.errors | axis.errors,
        notes=(),
    )


# ---------------------------------------------------------------- kinds


_DIRECTIONS = [
    np.array(d) / np.linalg.norm(d) for d in product((-1, 0, 1), repeat=3) if d > (0, 0, 0)
]
"""Half of those of a cube's faces, edges and corners."""
_POINTS = [np.zeros(3), *(0.1 * np.eye(3)), *(-0.1 * np.eye(3))]
"""Of the body (m), to start from."""


def _solved(rows: Floats, right: Floats) -> Floats:
    """Least squares, smallest where it is not told."""
    return np.asarray(np.linalg.lstsq(rows, right, rcond=1e-6)[0])


def _picked(poses: _Poses) -> tuple[Floats, Floats]:
    return poses.positions[poses.picked], poses.matrices[poses.picked]


def _triple(vector: Floats) -> tuple[float, ...]:
    return tuple(vector.tolist())


def _plane_residual(poses: _Poses, values: Values) -> Floats:
    return np.asarray(
        ((poses.at(values["reference_point"]) - values["point"]) @ values["normal"])[:, None]
    )


def _plane_starts(poses: _Poses) -> Iterator[Values]:
    positions, matrices = _picked(poses)
    flattest = np.linalg.svd(positions, full_matrices=False)[2]
    for normal in [*_DIRECTIONS, *flattest]:
        rows = np.column_stack([normal @ matrices, np.ones(len(positions))])
        *point, level = _solved(rows, -positions @ normal)
        yield {"point": -level * normal, "normal": normal, "reference_point": np.array(point)}


def _sphere_residual(poses: _Poses, values: Values) -> Floats:
    away = poses.at(values["reference_point"]) - values["point"]
    return np.asarray(np.linalg.norm(away, axis=1) - values["radius"])[:, None]


def _round(places: Floats) -> tuple[Floats, float]:
    """Center and radius of a sphere, or a circle, through places, shape (N, d), linearly."""
    rows = np.column_stack([2 * places, np.ones(len(places))])
    *center, rest = _solved(rows, np.sum(places**2, axis=1))
    return np.array(center), float(np.sqrt(max(rest + np.dot(center, center), 1e-6)))


def _sphere_starts(poses: _Poses) -> Iterator[Values]:
    positions, matrices = _picked(poses)
    # Linear in the center, the point and their products.
    both = 2 * np.einsum("kij,ki->kj", matrices, positions)
    rows = np.column_stack(
        [-2 * positions, both, -2 * matrices.reshape(-1, 9), np.ones(len(positions))]
    )
    bilinear = _solved(rows, -np.sum(positions**2, axis=1))[3:6]
    for point in [bilinear, *_POINTS]:
        center, radius = _round(positions + matrices @ point)
        yield {"point": center, "radius": radius, "reference_point": point}


def _cylinder_residual(poses: _Poses, values: Values) -> Floats:
    away = poses.at(values["reference_point"]) - values["point"]
    across = away - np.outer(away @ values["axis"], values["axis"])
    return np.asarray(np.linalg.norm(across, axis=1) - values["radius"])[:, None]


def _cylinder_starts(poses: _Poses) -> Iterator[Values]:
    positions, matrices = _picked(poses)
    for axis in _DIRECTIONS:
        across = np.linalg.svd(axis[None])[2][1:]
        flat, seen = positions @ across.T, across @ matrices
        # Linear in the center, the point and their products.
        both = np.einsum("kai,ka->ki", seen, flat)
        squares = np.einsum("kai,kaj->kij", seen, seen).reshape(-1, 9)
        rest = seen.reshape(-1, 6)
        rows = np.column_stack([2 * both, squares, -2 * flat, -2 * rest, np.ones(len(flat))])
        bilinear = _solved(rows, -np.sum(flat**2, axis=1))[:3]
        tried = list[tuple[float, int, float, Floats, Floats]]()
        for point in [bilinear, *_POINTS]:
            places = flat + seen @ point
            center, radius = _round(places)
            off = float(np.linalg.norm(places - center, axis=1).std())
            tried.append((off, len(tried), radius, center @ across, point))
        for _, _, radius, center, point in sorted(tried)[:2]:
            yield {"point": center, "axis": axis, "radius": radius, "reference_point": point}


def _remote_residual(poses: _Poses, values: Values) -> Floats:
    seen = np.einsum("kij,ki->kj", poses.matrices, values["point"] - poses.positions)
    return np.asarray((seen - values["reference_point"]) @ _across(values["shaft"]).T)


def _across(axis: Floats) -> Floats:
    """Two unit vectors perpendicular to one, as rows, that turn smoothly with it."""
    # No tie for axes of the body and the world: a small turn must not choose another.
    turn = crossing(axis)
    one = turn[:, np.argmin(np.abs(axis) + [0.0, 0.1, 0.2])]
    one = one / np.linalg.norm(one)
    return np.array([one, turn @ one])


def _remote_starts(poses: _Poses) -> Iterator[Values]:
    positions, matrices = _picked(poses)
    for shaft in _DIRECTIONS:
        across = _across(shaft)
        # Where the point of the world is, beside the shaft, as the body sees it.
        seen = np.einsum("kij,aj->kai", matrices, across)
        rows = np.concatenate(
            [
                np.column_stack([seen[:, k], -np.tile(np.eye(2)[k], (len(positions), 1))])
                for k in range(2)
            ]
        )
        right = np.concatenate([np.sum(seen[:, k] * positions, axis=1) for k in range(2)])
        x = _solved(rows, right)
        yield {"point": x[:3], "shaft": shaft, "reference_point": x[3:] @ across}


def _fixed_residual(poses: _Poses, values: Values) -> Floats:
    return np.asarray(poses.at(values["reference_point"]) - values["point"])


def _fixed_starts(poses: _Poses) -> Iterator[Values]:
    positions, matrices = _picked(poses)
    away = (matrices - matrices.mean(axis=0)).reshape(-1, 3)
    point = _solved(away, -(positions - positions.mean(axis=0)).ravel())
    yield {
        "point": (positions + matrices @ point).mean(axis=0),
        "reference_point": point,
    }


def _axis_residual(poses: _Poses, values: Values) -> Floats:
    return np.asarray(poses.matrices @ values["axis"] @ _across(values["direction"]).T)


def _axis_starts(poses: _Poses) -> Iterator[Values]:
    left, _, right = np.linalg.svd(_picked(poses)[1].mean(axis=0))
    yield {"axis": right[0], "direction": left[:, 0]}


def _ball_residual(poses: _Poses, values: Values) -> Floats:
    way = poses.turns @ crossing(values["radius"] * values["normal"])
    return poses.at(values["reference_point"]) - way


def _ball_starts(poses: _Poses) -> Iterator[Values]:
    positions, matrices = _picked(poses)
    turns = poses.turns[poses.picked]
    rows = np.concatenate([matrices, np.cross(turns[:, None], -np.eye(3)).swapaxes(1, 2)], axis=2)
    for k in np.unique(poses.recording):
        mine = poses.recording[poses.picked] == k
        rows[mine] -= rows[mine].mean(axis=0)
        positions[mine] = positions[mine] - positions[mine].mean(axis=0)
    x = _solved(rows.reshape(-1, 6), -positions.ravel())
    radius = float(np.linalg.norm(x[3:]))
    normal = x[3:] / radius if radius > FINEST else np.array([0.0, 0.0, 1.0])
    yield {"normal": normal, "radius": radius, "reference_point": x[:3]}


def _disc_residual(poses: _Poses, values: Values) -> Floats:
    axle = poses.matrices @ values["axle"]
    above = values["normal"] - (axle @ values["normal"])[:, None] * axle
    above /= np.maximum(np.linalg.norm(above, axis=1, keepdims=True), 1e-9)
    steps = np.cross(np.diff(poses.turns, axis=0), (above[1:] + above[:-1]) / 2)
    # From one recording to the next nothing rolls.
    steps[np.diff(poses.recording) > 0] = 0
    ways = np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
    return np.asarray(poses.at(values["reference_point"]) - values["radius"] * ways)


def _disc_starts(poses: _Poses) -> Iterator[Values]:
    steps = np.diff(poses.turns, axis=0)
    spins = np.einsum("kij,ki->kj", poses.matrices[1:], steps)[np.diff(poses.recording) == 0]
    axes = np.linalg.svd(spins, full_matrices=False)[2]
    for ball in _ball_starts(poses):
        for axle in axes:
            yield {"axle": axle, **ball}


_TOOL_AXIS = _Kind(
    "tool axis",
    2,
    {"axis": "unit", "direction": "unit"},
    _axis_residual,
    _axis_starts,
    lambda v: (ToolAxis(_triple(v["axis"]), _triple(v["direction"])),),
)
_FIXED_POINT = _Kind(
    "fixed point",
    3,
    {"point": "world", "reference_point": "body"},
    _fixed_residual,
    _fixed_starts,
    lambda v: (FixedPoint(_triple(v["point"]), _triple(v["reference_point"])),),
)
_ROLLING_DISC = _Kind(
    "rolling disc",
    3,
    {"axle": "unit", "normal": "unit", "radius": "length", "reference_point": "body"},
    _disc_residual,
    _disc_starts,
    lambda v: (
        RollingDisc(
            v["radius"], _triple(v["axle"]), _triple(v["normal"]), _triple(v["reference_point"])
        ),
    ),
    floats=True,
)
_ROLLING_SPHERE = _Kind(
    "rolling sphere",
    3,
    {"normal": "unit", "radius": "length", "reference_point": "body"},
    _ball_residual,
    _ball_starts,
    lambda v: (RollingSphere(v["radius"], _triple(v["normal"]), _triple(v["reference_point"])),),
    floats=True,
)
_REMOTE_CENTER = _Kind(
    "remote center",
    2,
    {"point": "world", "shaft": "unit", "reference_point": "body"},
    _remote_residual,
    _remote_starts,
    lambda v: (
        RemoteCenter(_triple(v["point"]), _triple(v["shaft"]), _triple(v["reference_point"])),
    ),
)
_PLANE = _Kind(
    "plane",
    1,
    {"point": "world", "normal": "unit", "reference_point": "body"},
    _plane_residual,
    _plane_starts,
    lambda v: (
        PlaneContact(_triple(v["point"]), _triple(v["normal"]), _triple(v["reference_point"])),
    ),
)
_SPHERE = _Kind(
    "sphere",
    1,
    {"point": "world", "radius": "length", "reference_point": "body"},
    _sphere_residual,
    _sphere_starts,
    lambda v: (SphereContact(_triple(v["point"]), v["radius"], _triple(v["reference_point"])),),
)
_CYLINDER = _Kind(
    "cylinder",
    1,
    {"point": "world", "axis": "unit", "radius": "length", "reference_point": "body"},
    _cylinder_residual,
    _cylinder_starts,
    lambda v: (
        CylinderContact(
            _triple(v["point"]), _triple(v["axis"]), v["radius"], _triple(v["reference_point"])
        ),
    ),
)
