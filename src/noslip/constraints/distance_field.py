"""Obstacles of any form, as their signed distance on a regular grid.

The distance between samples is a cubic B-spline of them, twice continuously differentiable, whose
coefficients are lowered until it nowhere says more than there is: with coefficients c_k at the
cells' centers, and x counted in cells,

    ``d(x) = sum_k c_k B(x - k)``,  B the product of the uniform cubic B-splines of the axes

(Unser, Aldroubi and Eden, B-spline signal processing, IEEE Trans. Signal Processing 41, 1993).
Distances of cells to each other are exact ones (Maurer, Qi and Raghavan, A linear time algorithm
for computing exact Euclidean distance transforms, IEEE Trans. PAMI 25, 2003).
"""

from __future__ import annotations

import base64
import hashlib
import itertools
import math
import zlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from noslip import _arguments
from noslip._typing import Expression, Floats
from noslip.constraints.occupied import MISSED, Unknown, read_map, voxels
from noslip.constraints.shape import Ball, Capsule
from noslip.errors import InputError

MOST_CELLS = {2: 2**23, 3: 2**22}
"""Of a grid, by its dimensions: 2900 cells a side, or 161.  Exact distances of so many take a
gigabyte while they are found."""
LOWERED = {2: 0.2, 3: 0.35}
"""Cells by which a spline is lowered: of random maps, with any share of their cells occupied, it
exceeds the distance outside by at most 0.18 (2-D) and 0.34 (3-D) once it does so at no center."""
_LOWERINGS = 12
"""Each leaves 0.7 (3-D) of what a coefficient is too high at most: 1 % of a cell after all."""
MARGIN_CELLS = 10
"""Free cells around what a field is made of, unless told: the rim is then clear of obstacles."""
_MORE = 2
"""Cells beyond a margin, so that no less than it is found at the rim, where the spline is lower."""
_FINEST = 2.0**50
"""Over which what is looked up is rounded: by 1e-15, less than its own rounding."""
_POINTS_AT_ONCE = 2**15
"""Of which distances are found together: some 30 MB of intermediate results."""


@dataclass(frozen=True, eq=False, repr=False)
class DistanceField:
    """Signed distance to obstacles: positive outside of them, negative inside.

    Outside of obstacles it is never more than the distance, and at most 1.3 cells
    less; inside it is negative but near a surface.  Beyond the grid the nearest cell's value goes
    on, which is no more than the distance to what the grid holds.  A grid of two dimensions is
    extruded along z, and needs none.

    Equal to another of the same numbers, and hashable.

    Parameters
    ----------
    coefficients : array of float32, shape (nx, ny) or (nx, ny, nz)
        c (m), of cells along the grid's axes.
    cell : float
        Edge of a cell (m).
    origin : 3 numbers
        Outer corner of the first cell (m, world frame); of two dimensions, z means nothing.
    yaw : float
        Angle from the world's x axis to the grid's, about z (rad).
    """

    coefficients: NDArray[np.float32]
    cell: float
    origin: tuple[float, ...] = (0.0, 0.0, 0.0)
    yaw: float = 0.0

    def __post_init__(self) -> None:
        kept = np.array(self.coefficients, dtype=np.float32, order="C")
        if kept.ndim not in MOST_CELLS or not kept.size or not np.isfinite(kept).all():
            raise InputError(
                "a distance field has a grid of 2 or 3 dimensions of finite numbers, got shape "
                f"{kept.shape}"
            )
        require_cells(kept.shape)
        kept.setflags(write=False)
        object.__setattr__(self, "coefficients", kept)
        object.__setattr__(self, "cell", _arguments.positive("cell", self.cell, "meters"))
        origin = _arguments.vector("origin", _three(self.origin))
        object.__setattr__(self, "origin", tuple(origin.tolist()))
        object.__setattr__(self, "yaw", _arguments.finite("yaw", self.yaw))

    @classmethod
    def from_grid(
        cls,
        occupied: ArrayLike,
        cell: float,
        origin: Sequence[float] = (0.0, 0.0, 0.0),
        *,
        yaw: float = 0.0,
        margin: float = 0.0,
    ) -> DistanceField:
        """Distance to the occupied cells of a grid, which are filled squares or cubes.

        Parameters
        ----------
        occupied : array of bool, shape (nx, ny) or (nx, ny, nz)
            Whether there is something; 0 and 1 will do.
        cell : float
            Edge of a cell (m).
        origin : 2 or 3 numbers
            Outer corner of the first cell (m, world frame).
        yaw : float
            Angle from the world's x axis to the grid's, about z (rad).
        margin : float
            Of free cells that are put around the grid (m); without, what touches its rim goes on
            beyond.

        Raises
        ------
        InputError
            If it is no such grid, too large, all free or all occupied.
        """
        grid = _occupied(occupied)
        cell = _arguments.positive("cell", cell, "meters")
        around = math.ceil(_arguments.not_negative("margin", margin) / cell)
        if around:
            around += _MORE
        require_cells(tuple(size + 2 * around for size in grid.shape))
        if around:
            grid = np.pad(grid, around)
        if not grid.any():
            raise InputError("the grid has no occupied cell: there is nothing to keep out of")
        if grid.all():
            raise InputError("all cells of the grid are occupied: there is no place to be")
        axes = _axes(_arguments.finite("yaw", yaw))[:, : grid.ndim]
        corner = _arguments.vector("origin", _three(origin)) - around * cell * axes.sum(axis=1)
        return cls._of_samples(_signed_distances(grid) * cell, cell, corner, yaw)

    @classmethod
    def from_map(
        cls, path: str | Path, *, unknown: Unknown = "occupied", margin: float = 0.0
    ) -> DistanceField:
        """Distance to what a map of ROS's map_server says is occupied; two dimensions.

        Parameters
        ----------
        path : path
            Of its YAML file, which names the image, PGM or PNG.
        unknown : "occupied" or "free"
            What is taken for what the map does not know.
        margin : float
            Of free cells that are put around it (m); without, what touches its rim goes on beyond.

        Raises
        ------
        InputError
            If a file is missing or is none of a map, or it is all free or all occupied.
        MissingDependencyError
            Without PyYAML (``noslip[maps]``).
        """
        found = read_map(path, unknown, MOST_CELLS[2])
        try:
            return cls.from_grid(found.grid, found.cell, found.origin, yaw=found.yaw, margin=margin)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None

    @classmethod
    def from_mesh(
        cls,
        mesh: Any,
        cell: float | None = None,
        *,
        scale: float = 1.0,
        margin: float | None = None,
    ) -> DistanceField:
        """Distance to the cells that a closed triangle mesh touches or holds.

        It is up to 3.2 cells less than that to the mesh itself, and never more.

        Parameters
        ----------
        mesh : path or trimesh.Trimesh
            STL, OBJ, PLY, OFF or GLB; in the world frame.
        cell : float, optional
            Edge of the grid's cells (m); by default a fortieth of the mesh's longest side.
        scale : float
            Meters of a unit of the mesh; 0.001 of one in millimeters.
        margin : float, optional
            Between mesh and the grid's rim (m); 10 cells by default.

        Raises
        ------
        InputError
            If the file is missing or is no mesh, or the mesh is not closed or takes too many cells.
        MissingDependencyError
            Without trimesh (``noslip[meshes]``).
        """
        scale = _arguments.positive("scale", scale, "meters")
        if cell is not None:
            cell = _arguments.positive("cell", cell, "meters")
        found = voxels(mesh, cell, scale, MOST_CELLS[3])
        around = MARGIN_CELLS * found.cell if margin is None else margin
        field = cls.from_grid(found.grid, found.cell, found.origin, margin=around)
        return cls(field.coefficients - MISSED * found.cell, field.cell, field.origin)

    @classmethod
    def from_points(
        cls, points: ArrayLike, radius: float, cell: float, *, margin: float | None = None
    ) -> DistanceField:
        """Distance to balls about points, such as those of a depth camera.

        Parameters
        ----------
        points : array, shape (N, 3), or (N, 2) for a field of the plane
            Centers (m, world frame).
        radius : float
            Of the balls (m), at least a cell.
        cell : float
            Edge of the grid's cells (m).
        margin : float, optional
            Between balls and the grid's rim (m); 10 cells by default.

        Raises
        ------
        InputError
            If there is no point, one is not finite, or the grid becomes too large.
        """
        centers = _arguments.numbers("points", points)
        if centers.ndim != 2 or centers.shape[1] not in MOST_CELLS or not len(centers):
            raise InputError(f"points must have shape (N, 3) or (N, 2), got {centers.shape}")
        if not np.isfinite(centers).all():
            raise InputError("points must be finite numbers (m), some are not; leave those out")
        cell, radius = _coarse("radius", radius, cell)
        tree = scipy.spatial.cKDTree(centers)
        return cls._sampled(
            lambda at: tree.query(at)[0] - radius,
            centers.min(axis=0) - radius,
            centers.max(axis=0) + radius,
            cell,
            margin,
        )

    @classmethod
    def union(cls, *parts: Any, cell: float, margin: float | None = None) -> DistanceField:
        """Distance to the nearest of several shapes.

        Parameters
        ----------
        *parts : KeepOutSphere, KeepOutCapsule, two corners, or DistanceField
            Two corners, each of 3 numbers (m), are those of a box along the world's axes.
        cell : float
            Edge of the grid's cells (m); shapes are thicker than two.
        margin : float, optional
            Between shapes and the grid's rim (m); 10 cells by default.

        Raises
        ------
        InputError
            If there is no shape, one is none or too thin, or the grid becomes too large.
        """
        if not parts:
            raise InputError("a union needs at least one shape")
        cell = _arguments.positive("cell", cell, "meters")
        shapes = [_shape(part, cell) for part in parts]
        flat = all(isinstance(part, DistanceField) and part.is_flat for part in parts)
        dimensions = 2 if flat else 3
        lower = np.min([shape.lower for shape in shapes], axis=0)[:dimensions]
        upper = np.max([shape.upper for shape in shapes], axis=0)[:dimensions]
        return cls._sampled(
            lambda at: np.min([shape.distance(at) for shape in shapes], axis=0),
            lower,
            upper,
            cell,
            margin,
        )

    @classmethod
    @lru_cache(maxsize=1)
    def example(cls) -> DistanceField:
        """A ball of 5 cm about the origin."""
        return cls.from_points(np.zeros((1, 3)), 0.05, 0.01)

    @classmethod
    def _sampled(
        cls,
        distance: Callable[[Floats], Floats],
        lower: Floats,
        upper: Floats,
        cell: float,
        margin: float | None,
    ) -> DistanceField:
        """Of what lies between two corners, from its signed distance at any points."""
        if margin is None:
            margin = MARGIN_CELLS * cell
        around = _arguments.not_negative("margin", margin) + _MORE * cell
        counts = np.ceil((upper - lower + 2 * around) / cell)
        require_cells(counts.tolist())
        counts = counts.astype(int)
        # In the middle of what the whole number of cells is too long.
        origin = (lower + upper - counts * cell) / 2
        centers = np.indices(tuple(counts.tolist())).reshape(len(counts), -1).T
        several = range(0, len(centers), _POINTS_AT_ONCE)
        parts = [centers[first : first + _POINTS_AT_ONCE] for first in several]
        found = [distance(origin + (part + 0.5) * cell) for part in parts]
        return cls._of_samples(np.concatenate(found).reshape(counts), cell, _three(origin))

    @classmethod
    def _of_samples(
        cls, distances: Floats, cell: float, origin: Iterable[float], yaw: float = 0.0
    ) -> DistanceField:
        """From signed distances at the cells' centers (m)."""
        c = distances.copy()
        for _ in range(_LOWERINGS):
            c -= np.maximum(_at_centers(c) - distances, 0)
        lowered = (c - LOWERED[c.ndim] * cell).astype(np.float32)
        return cls(lowered, cell, tuple(origin), yaw)

    def distance(self, points: ArrayLike) -> Floats:
        """Signed distances of points (m).

        Parameters
        ----------
        points : array, shape (N, 3) or (3,)
            World frame (m); of a field of two dimensions, shape (N, 2) will do.

        Returns
        -------
        array, shape (N,) or ()

        Raises
        ------
        InputError
            If they are no points, or not finite.
        """
        given = _arguments.numbers("points", points)
        if given.shape[-1:] not in [(3,), (self.coefficients.ndim,)] or given.ndim > 2:
            raise InputError(f"points must have shape (N, 3), got {given.shape}")
        if not np.isfinite(given).all():
            raise InputError("points must be finite numbers (m), some are not")
        rows = np.atleast_2d(given)
        parts = range(0, len(rows), _POINTS_AT_ONCE)
        found = [self._distance(rows[first : first + _POINTS_AT_ONCE]) for first in parts]
        return np.concatenate([np.zeros(0), *found]).reshape(given.shape[:-1])

    def _distance(self, points: Floats) -> Floats:
        c = self.coefficients
        dimensions = c.ndim
        offsets = points - np.array(self.origin)[: points.shape[1]]
        axes = _axes(self.yaw)[: points.shape[1], :dimensions]
        # Counted in cells, from center to center.
        at = np.clip(offsets @ axes / self.cell - 0.5, -4, np.array(c.shape) + 3)
        first = np.floor(at)
        weights = np.stack(_weights(at - first), axis=1)
        along = first.astype(np.int64)[:, None] + np.arange(-1, 3)[None, :, None]
        along = np.clip(along, 0, np.array(c.shape) - 1)
        # All cells about each point, then axis by axis from the last on.
        index = np.zeros((len(points), *(1,) * dimensions), dtype=np.int64)
        for axis, size in enumerate(c.shape):
            shape = [len(points), *(1,) * dimensions]
            shape[1 + axis] = 4
            index = index * size + along[:, :, axis].reshape(shape)
        found = c.ravel()[index].astype(np.float64)
        for axis in reversed(range(dimensions)):
            found = np.einsum("n...i,ni->n...", found, weights[:, :, axis])
        return found

    def place(self, at: Floats) -> Floats:
        """Where points are that are counted in cells from the first one's outer corner.

        Parameters
        ----------
        at : array, shape (N, 2) or (N, 3)

        Returns
        -------
        array, shape (N, 3)
            World frame (m).
        """
        axes = _axes(self.yaw)[:, : at.shape[1]]
        return np.asarray(np.array(self.origin) + self.cell * at @ axes.T)

    def expression(self, position: Expression) -> Expression:
        """The distance that :meth:`distance` finds (m), as an expression of a position.

        Of the grid a step of a graph looks up value, slopes and curvatures at a place x_0, all that
        is ever differentiated; the expression is their polynomial in x - x_0.

        Parameters
        ----------
        position : expression, shape (3,)
            World frame (m).
        """
        dimensions = self.coefficients.ndim
        axes = ca.DM(_axes(self.yaw)[:, :dimensions])
        at = axes.T @ (position - ca.DM(list(self.origin))) / self.cell - 0.5
        # A call's derivative would be NaN, that of rounding is 0: what was looked up is a constant.
        found = ca.floor(_look_up(self)(at) * _FINEST) / _FINEST
        step, value = at - found[:dimensions], ca.SX(0)
        for row, orders in enumerate(_orders(dimensions), dimensions):
            term = found[row]
            for axis, order in enumerate(orders):
                term *= step[axis] ** order / math.factorial(order)
            value += term
        return value

    @property
    def is_flat(self) -> bool:
        """Whether it has two dimensions."""
        return self.coefficients.ndim == 2

    @cached_property
    def rim(self) -> float:
        """Least distance at the grid's rim and beyond (m)."""
        c = self.coefficients
        ends = [c.take([0, -1], axis=axis).min() for axis in range(c.ndim)]
        return float(min(ends))

    @cached_property
    def digest(self) -> str:
        """What tells its numbers from those of another."""
        head = repr((self.coefficients.shape, self.cell, self.origin, self.yaw)).encode()
        return hashlib.sha256(head + self.coefficients.tobytes()).hexdigest()[:16]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, DistanceField) and self.digest == other.digest

    def __hash__(self) -> int:
        return hash(self.digest)

    def to_data(self) -> dict[str, Any]:
        """Return plain data, for JSON: the numbers to the bit, packed."""
        packed = zlib.compress(self.coefficients.astype("<f4").tobytes())
        return {
            "shape": list(self.coefficients.shape),
            "cell": self.cell,
            "origin": list(self.origin),
            "yaw": self.yaw,
            "coefficients": base64.b64encode(packed).decode("ascii"),
        }

    @classmethod
    def from_data(cls, data: Any) -> DistanceField:
        """Return the field that :meth:`to_data` wrote.

        Raises
        ------
        InputError
            If the data are none.
        """
        try:
            shape = [int(size) for size in data["shape"]]
            require_cells(shape)
            size = 4 * math.prod(shape)
            packed = base64.b64decode(data["coefficients"], validate=True)
            # No more than there must be, whatever a file says.
            raw = zlib.decompressobj().decompress(packed, size + 1)
            numbers = np.frombuffer(raw, dtype="<f4").reshape(shape)
            cell, origin, yaw = data["cell"], tuple(data["origin"]), data["yaw"]
        except InputError:
            raise
        except (KeyError, TypeError, ValueError, OverflowError, zlib.error) as error:
            reason = " ".join(f"{type(error).__name__}: {error}".split())
            raise InputError(f"a field of distances cannot be read: {reason}") from error
        return cls(numbers, cell, origin, yaw)

    def __reduce__(self) -> Any:
        return DistanceField, (self.coefficients, self.cell, self.origin, self.yaw)

    def __repr__(self) -> str:
        sides = " x ".join(map(str, self.coefficients.shape))
        return f"<distance field of {sides} cells of {self.cell:g} m>"


@dataclass(frozen=True)
class _Part:
    """Signed distance at points (N, 3) to what lies between two corners."""

    distance: Callable[[Floats], Floats]
    lower: Floats
    upper: Floats


def _shape(part: Any, cell: float) -> _Part:
    if isinstance(part, DistanceField):
        counts = np.array(part.coefficients.shape)
        corners = part.place(np.indices((2,) * len(counts)).reshape(len(counts), -1).T * counts)
        lower, upper = corners.min(axis=0), corners.max(axis=0)
        if part.is_flat:
            # As high as what it is put together with.
            lower[2], upper[2] = np.inf, -np.inf
        return _Part(part.distance, lower, upper)
    shape = part.shape() if hasattr(part, "shape") else part
    if isinstance(shape, Ball):
        ends = np.array([shape.center, shape.center])
    elif isinstance(shape, Capsule):
        ends = np.array([shape.start, shape.end])
    else:
        return _box(part, cell)
    _coarse("radius", shape.radius, cell)

    def distance(at: Floats) -> Floats:
        axis, away = ends[1] - ends[0], at - ends[0]
        along = np.clip(away @ axis / max(float(axis @ axis), 1e-300), 0, 1)
        return np.asarray(np.linalg.norm(away - along[:, None] * axis, axis=1) - shape.radius)

    return _Part(distance, ends.min(axis=0) - shape.radius, ends.max(axis=0) + shape.radius)


def _box(corners: Any, cell: float) -> _Part:
    try:
        lower, upper = (_arguments.vector("corner", corner) for corner in corners)
    except (TypeError, ValueError):
        raise InputError(
            "a union is of KeepOutSphere, KeepOutCapsule, two corners of a box or DistanceField, "
            f"got {_arguments.short(corners)}"
        ) from None
    if not (upper - lower >= 2 * cell).all():
        raise InputError(
            f"box from {lower.tolist()} to {upper.tolist()}: its sides must be two cells "
            f"({2 * cell:g} m) or longer, from its lower corner to its upper; take smaller cells"
        )

    def distance(at: Floats) -> Floats:
        beyond = np.maximum(lower - at, at - upper)
        outside = np.linalg.norm(np.maximum(beyond, 0), axis=1)
        return np.asarray(outside + np.minimum(beyond.max(axis=1), 0))

    return _Part(distance, lower, upper)


def _coarse(name: str, value: Any, cell: Any) -> tuple[float, float]:
    """Edge of a cell, and a size that it does not miss."""
    edge, size = (
        _arguments.positive(what, given, "meters")
        for what, given in (("cell", cell), (name, value))
    )
    if size < edge:
        raise InputError(
            f"{name} must be a cell ({edge:g} m) or more, got {size:g}; take smaller cells"
        )
    return edge, size


def require_cells(shape: Sequence[float]) -> None:
    """Refuse a grid that memory does not hold."""
    cells = math.prod(shape)
    most = MOST_CELLS.get(len(shape), MOST_CELLS[3])
    if cells > most:
        raise InputError(
            f"the grid has {cells:.3g} cells ({' x '.join(f'{size:g}' for size in shape)}), at "
            f"most {most:,} are held; take larger cells, or cut out the part that matters"
        )


def _occupied(value: ArrayLike) -> NDArray[np.bool_]:
    try:
        grid = np.asarray(value)
    except ValueError:
        grid = np.empty(0)
    if grid.ndim not in MOST_CELLS or not grid.size:
        raise InputError(f"occupied must be a grid of 2 or 3 dimensions, got shape {grid.shape}")
    require_cells(grid.shape)
    if grid.dtype != np.bool_ and not (grid.dtype.kind in "iuf" and np.isin(grid, (0, 1)).all()):
        raise InputError(
            "occupied must say of each cell whether there is something: True or False, 1 or 0; "
            "of probabilities, give grid > 0.5"
        )
    return grid.astype(bool, copy=False)


def _three(origin: Any) -> Any:
    """An origin in the plane, with a z."""
    try:
        return [*origin, 0.0] if len(origin) == 2 else origin
    except TypeError:
        return origin


def _axes(yaw: float) -> Floats:
    """The grid's axes in the world, as columns."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _weights(u: Any) -> list[Any]:
    """Of the four coefficients about a place u in [0, 1] between the middle two."""
    v = 1 - u
    inner = ((3 * u - 6) * u * u + 4) / 6, ((3 * v - 6) * v * v + 4) / 6
    return [v * v * v / 6, *inner, u * u * u / 6]


def _orders(dimensions: int) -> list[tuple[int, ...]]:
    """Of derivatives by the axes, up to the second."""
    several = itertools.product(range(3), repeat=dimensions)
    return [orders for orders in several if sum(orders) < 3]


@lru_cache(maxsize=2)
def spline(dimensions: int) -> ca.Function:
    """(4^n coefficients about a place, u) -> the derivatives :func:`_orders` there, per cell."""
    near, u = ca.SX.sym("near", 4**dimensions), ca.SX.sym("u", dimensions)
    parts: dict[tuple[int, ...], list[Expression]] = {(): ca.vertsplit(near)}
    for axis in reversed(range(dimensions)):
        weights = [ca.vertcat(*_weights(u[axis]))]
        weights += [ca.jacobian(weights[0], u[axis])]
        weights += [ca.jacobian(weights[1], u[axis])]
        parts = {
            (order, *orders): [
                ca.dot(weights[order], ca.vertcat(*values[first : first + 4]))
                for first in range(0, len(values), 4)
            ]
            for orders, values in parts.items()
            for order in range(3 - sum(orders))
        }
    found = [parts[orders][0] for orders in _orders(dimensions)]
    return ca.Function("spline", [near, u], [ca.cse(ca.vertcat(*found))])


@lru_cache(maxsize=8)
def places(shape: tuple[int, ...]) -> ca.Function:
    """A place in cells -> numbers of the 4^n coefficients about it, and u of :func:`spline`."""
    at = ca.SX.sym("at", len(shape))
    first = ca.floor(at)
    # Whole numbers of any size are exact; what is no number looks up the first cell, with u NaN.
    numbers = ca.SX(1, 1)
    for axis, size in enumerate(shape):
        along = ca.fmax(0, ca.fmin(size - 1, first[axis] + ca.DM([-1, 0, 1, 2])))
        numbers = ca.vec(ca.repmat(along, 1, numbers.numel()) + size * ca.repmat(numbers.T, 4, 1))
    return ca.Function("places", [at], [ca.densify(numbers), at - first])


@lru_cache(maxsize=16)
def _look_up(field: DistanceField) -> ca.Function:
    """A place in cells -> the same, and the derivatives :func:`_orders` there."""
    c, at = field.coefficients, ca.MX.sym("at", field.coefficients.ndim)
    numbers, u = places(c.shape)(at)
    # A constant would be copied at each call, all of it; this spline of no degree is not.
    number, knots = ca.MX.sym("number"), np.arange(c.size + 1.0).tolist()
    cell = ca.bspline(
        number + 0.5,
        ca.DM(c.ravel().astype(np.float64)),
        [knots],
        [0],
        1,
        {"lookup_mode": ["exact"]},
    )
    cells = ca.Function("cells", [number], [cell])
    near = cells.map(numbers.numel())(numbers.T).T
    # Kept as a call in graphs of SX, which cannot look up anything.
    options: dict[str, Any] = {"never_inline": True, "is_diff_in": [False]}
    options |= {"enable_forward": False, "enable_reverse": False}
    found = ca.vertcat(at, spline(c.ndim)(near, u))
    return ca.Function(f"grid_{field.digest}", [at], [found], options)


def _at_centers(c: Floats) -> Floats:
    """The spline of coefficients at the cells' centers."""
    for axis in range(c.ndim):
        c = scipy.ndimage.correlate1d(c, np.array([1, 4, 1]) / 6, axis=axis, mode="nearest")
    return c


def _signed_distances(occupied: NDArray[np.bool_]) -> Floats:
    """Of the cells' centers to the surface between occupied and free cells, in cells; exact.

    On a grid of half the cells' size, the points of a cell nearest to any center are among its
    nodes.
    """
    inner = (slice(1, None, 2),) * occupied.ndim

    def away(cells: NDArray[np.bool_]) -> Floats:
        """Distances of all centers to cells."""
        empty = np.ones([2 * size + 1 for size in cells.shape], dtype=bool)
        for first in itertools.product((0, 1, 2), repeat=cells.ndim):
            spread = tuple(slice(k, k + 2 * n, 2) for k, n in zip(first, cells.shape, strict=True))
            empty[spread] &= ~cells
        found = scipy.ndimage.distance_transform_edt(empty)[inner]
        return np.asarray(found, dtype=np.float64) / 2

    return away(occupied) - away(~occupied)
