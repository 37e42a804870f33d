"""What constraints look like: surfaces, depth limits and keep-out zones, as triangles."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip.constraints.declaration import Constraint, of_a_user
from noslip.constraints.formula import surface_value
from noslip.constraints.moving_frame import InMovingFrame
from noslip.constraints.of_body import OfBody
from noslip.constraints.shape import Ball, Capsule, Cells, Implicit, Mark, Plane, Sides, Tube
from noslip.constraints.shape import Shape as Place
from noslip.figures.style import PALETTE
from noslip.space import IN
from noslip.viewer.colors import rgb

REACH = 0.75
"""Half the side of what has no end, such as a plane, over the scene's size: somewhat beyond the
paths."""
MARK = 0.015
"""Radius of a point, over the scene's size: seen, and no larger than the tip of the tool."""
AXIS = 0.08
"""Length of a moving frame's axes, over the scene's size: shorter than the arrows at the tool."""
GRID = 41
"""Points along a side of a surface that is given by a formula: odd, so that one is the middle; the
cost grows as their square."""
MOST_CELLS = 2**18
"""Of a grid that is drawn as it is: some 50,000 triangles."""
NEWTON_STEPS = 30
"""Onto such a surface: from a near start its quadratic rate needs a few; from elsewhere it may need
more."""
_ON_SURFACE = 1e-9
"""Distance from the surface at which a point counts as on it, over the scene's size: far below a
pixel."""
COLORS = {
    "contact": rgb(PALETTE["sky"]),
    "limit": rgb(PALETTE["orange"]),
    "keep-out": rgb(PALETTE["vermillion"]),
    "mark": rgb(PALETTE["green"]),
    "frame": rgb(PALETTE["gray"]),
}
"""By kind: what is touched, what bounds, what is forbidden, and what only helps to see."""
OPACITIES = {"contact": 0.25, "limit": 0.2, "keep-out": 0.35, "mark": 1.0, "frame": 1.0}
"""By kind: what is forbidden is seen best, and the path through all of them."""


class Frame:
    """The frame of a constraint that moves, or of several one in the other.

    ``inner`` is what holds in the frame, itself in none that moves.
    """

    def __init__(self, constraint: InMovingFrame) -> None:
        t = ca.SX.sym("t")
        origin, turn = ca.SX.zeros(3), ca.SX.eye(3)
        inner: Constraint = constraint
        while isinstance(inner, InMovingFrame):
            c, R = inner.pose(t)
            origin, turn, inner = origin + ca.mtimes(turn, c), ca.mtimes(turn, R), inner.inner
        self.inner = inner
        self._pose = ca.Function("pose", [t], [origin, turn])

    def pose(self, time: float) -> tuple[Floats, Rotation]:
        """Origin (m), shape (3,), and rotation, frame to world, at a time (s)."""
        origin, turn = self._pose(time)
        return np.array(origin).ravel(), Rotation.from_matrix(np.array(turn))


@dataclass(frozen=True, eq=False)
class Shape:
    """A triangle mesh of a kind of ``COLORS``: vertices (m), faces of their indices, each (.., 3).

    In the world frame, or in a ``frame`` that moves.
    """

    name: str
    kind: str
    vertices: Floats
    faces: NDArray[np.int64]
    frame: Frame | None = None

    def pose(self, time: float) -> tuple[Floats, Rotation]:
        """Origin (m) and rotation of its frame at a time (s)."""
        if self.frame is None:
            return np.zeros(3), Rotation.identity()
        return self.frame.pose(time)


def shapes(constraints: Iterable[Constraint], center: ArrayLike, size: float) -> list[Shape]:
    """Return what constraints look like near a scene; those without a place are left out.

    One in a moving frame moves with it, and so do the frame's axes, at the point of it that is the
    scene's center at the beginning.  What has no end is drawn about the point nearest to the center
    (m) of the scene, as far as its size (m) goes.
    """
    middle, found = np.asarray(center, dtype=np.float64), []
    for constraint in constraints:
        if isinstance(constraint, OfBody) and IN not in constraint.body:
            constraint = constraint.inner
        if isinstance(constraint, InMovingFrame):
            frame = Frame(constraint)
            origin, turn = frame.pose(0.0)
            there = turn.inv().apply(middle - origin)
            still = shapes([frame.inner], there, size)
            axes = Shape(constraint.name, "frame", *_axes(there, size))
            found += [replace(shape, frame=frame) for shape in [*still, axes]]
            continue
        with of_a_user(f"constraint {constraint.name!r}: its shape"):
            shape = constraint.shape()
        mesh = None if shape is None else _meshed(shape, middle, size)
        if shape is not None and mesh is not None:
            found.append(Shape(constraint.name, shape.kind, *mesh))
    return found


_Mesh = tuple[Floats, NDArray[np.int64]]
"""Vertices, shape (V, 3), and faces, shape (F, 3)."""


def _meshed(shape: Place, center: Floats, size: float) -> _Mesh | None:
    match shape:
        case Plane():
            return _patch(shape.point, shape.normal, center, size)
        case Ball():
            return _ball(shape.center, shape.radius)
        case Tube():
            return _tube(shape.point, shape.axis, shape.radius, center, size)
        case Capsule():
            return _capsule(shape.start, shape.end, shape.radius)
        case Sides():
            return _sides(shape, center, size)
        case Implicit():
            return _surface(shape, center, size)
        case Cells():
            return _cells(shape, center, size)
        case Mark():
            return _ball(shape.point, MARK * size)


def _mesh(made: trimesh.Trimesh) -> _Mesh:
    return np.array(made.vertices, dtype=np.float64), np.array(made.faces, dtype=np.int64)


def turned(made: trimesh.Trimesh, axis: ArrayLike, origin: ArrayLike) -> _Mesh:
    """Return what was made along z as it lies along an axis, from an origin."""
    vertices, faces = _mesh(made)
    return np.asarray(origin) + vertices @ np.stack(_basis(axis)), faces


def _axes(origin: Floats, size: float) -> _Mesh:
    """Return three rods along the axes."""
    length = AXIS * size
    made = trimesh.creation.axis(
        origin_size=0.06 * length, axis_radius=0.03 * length, axis_length=length
    )
    made.apply_translation(origin)
    return _mesh(made)


def _basis(normal: ArrayLike) -> tuple[Floats, Floats, Floats]:
    """Three perpendicular unit vectors; the last is the normal's direction."""
    n = np.asarray(normal, dtype=np.float64)
    n = n / np.linalg.norm(n)
    u = np.cross(n, np.eye(3)[np.argmin(np.abs(n))])
    u /= np.linalg.norm(u)
    return u, np.cross(n, u), n


def _patch(point: ArrayLike, normal: ArrayLike, center: Floats, size: float) -> _Mesh:
    """Return a square of the plane through a point."""
    u, v, n = _basis(normal)
    middle = center - ((center - np.asarray(point)) @ n) * n
    square = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    return middle + REACH * size * square @ [u, v], np.array([[0, 1, 2], [0, 2, 3]])


def _ball(center: ArrayLike, radius: float) -> _Mesh:
    made = trimesh.creation.icosphere(subdivisions=3, radius=radius)
    made.apply_translation(center)
    return _mesh(made)


def _tube(point: ArrayLike, axis: ArrayLike, radius: float, center: Floats, size: float) -> _Mesh:
    """Return the length of an endless cylinder that lies beside the scene; open at its ends."""
    *_, n = _basis(axis)
    middle = np.asarray(point) + ((center - np.asarray(point)) @ n) * n
    reach = REACH * size
    made = trimesh.creation.revolve([[radius, -reach], [radius, reach]], sections=48)
    return turned(made, axis, middle)


def _capsule(start: ArrayLike, end: ArrayLike, radius: float) -> _Mesh:
    along = np.asarray(end, dtype=np.float64) - np.asarray(start)
    length = float(np.linalg.norm(along))
    if length == 0:
        return _ball(start, radius)
    made = trimesh.creation.capsule(height=length, radius=radius, count=(32, 32))
    # Its first hemisphere is moved to the origin.
    made.apply_translation([0.0, 0.0, -made.bounds[0, 2] - radius])
    return turned(made, along, start)


def _sides(box: Sides, center: Floats, size: float) -> _Mesh:
    """Return the sides of a box that there are; what is open ends where the scene does."""
    reach = REACH * size
    low = np.array([c - reach if s is None else s for s, c in zip(box.lower, center, strict=True)])
    high = np.array([c + reach if s is None else s for s, c in zip(box.upper, center, strict=True)])
    low, high = np.minimum(low, high), np.maximum(low, high)
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    faces = []
    for axis in range(3):
        for upper, sides in ((0, box.lower), (1, box.upper)):
            if sides[axis] is None:
                continue
            a, b, c, d = np.flatnonzero(corners[:, axis] == upper)
            faces += [[a, b, d], [a, d, c]]
    return np.where(corners == 1, high, low), np.array(faces)


def _cells(shape: Cells, center: Floats, size: float) -> _Mesh | None:
    """Faces between cells inside and outside, their corners moved onto the surface.

    Of a grid of two dimensions walls, as far as the scene goes.
    """
    dimensions = len(shape.counts)
    step = math.ceil((math.prod(shape.counts) / MOST_CELLS) ** (1 / dimensions))
    counts = tuple(-(-count // step) for count in shape.counts)
    middles = np.indices(counts).reshape(dimensions, -1).T + 0.5
    inside = (shape.value(shape.place(step * middles)) <= 0).reshape(counts)
    inside = np.pad(inside, 1)
    quads = []
    for axis in range(dimensions):
        leads_in = np.diff(inside.astype(int), axis=axis)
        u, v = np.roll(np.eye(dimensions, dtype=int), -1 - axis, axis=0)[: dimensions - 1][[0, -1]]
        around = [0 * u, u, u + v, v] if dimensions == 3 else [0 * u, u]
        for sign, order in ((-1, 1), (1, -1)):
            base = np.argwhere(leads_in == sign) - 1
            base[:, axis] += 1
            quads.append(base[:, None] + np.array(around)[::order])
    corners, numbers = np.unique(
        np.concatenate(quads).reshape(-1, dimensions), axis=0, return_inverse=True
    )
    if not len(corners):
        return None
    points = shape.place(step * corners.astype(np.float64))
    points = _onto(shape, points, step * shape.cell)
    numbers = numbers.reshape(-1, len(around))
    if dimensions == 2:
        count, reach = len(points), REACH * size
        points = np.concatenate([points, points])
        points[:, 2] = center[2] + np.repeat([-reach, reach], count)
        numbers = np.hstack([numbers, numbers[:, ::-1] + count])
    return points, np.concatenate([numbers[:, [0, 1, 2]], numbers[:, [0, 2, 3]]])


def _onto(shape: Cells, points: Floats, cell: float) -> Floats:
    """Points moved onto the surface near them, by a cell at most."""
    found = points
    steps = cell / 4 * np.eye(3)
    for _ in range(3):
        ahead, behind = ([shape.value(found + s * step) for step in steps] for s in (1, -1))
        slope = np.stack([a - b for a, b in zip(ahead, behind, strict=True)], axis=1) / (cell / 2)
        square = np.maximum(np.sum(slope**2, axis=1), 0.1)
        moved = found - (shape.value(found) / square)[:, None] * slope - points
        far = np.linalg.norm(moved, axis=1) / cell
        found = points + moved / np.maximum(far, 1)[:, None]
    return found


def _surface(shape: Implicit, center: Floats, size: float) -> _Mesh | None:
    """Points of a grid beside the scene, moved onto ``f = 0`` along the gradient at its middle.

    Where no point of the surface is found, there is a hole.
    """
    p = ca.SX.sym("p", 3)
    f = surface_value(shape.surface, p)
    function = ca.Function("surface", [p], [f, ca.jacobian(f, p)])

    middle, reach = center[None], REACH * size
    for _ in range(NEWTON_STEPS):
        off, slope = _value_at(function, middle)
        square = float(np.sum(slope**2))
        if not square > 0:
            return None
        middle = middle - off[:, None] * slope / square
    _, slope = _value_at(function, middle)
    if not (np.isfinite(middle).all() and np.linalg.norm(slope) > 0):
        return None
    u, v, n = _basis(slope[0])
    a, b = (g.ravel() for g in np.meshgrid(*[np.linspace(-reach, reach, GRID)] * 2, indexing="ij"))
    points = middle + a[:, None] * u + b[:, None] * v
    with np.errstate(all="ignore"):
        for _ in range(NEWTON_STEPS):
            off, slope = _value_at(function, points)
            points = points - (off / (slope @ n))[:, None] * n
        off, slope = _value_at(function, points)
        apart = np.abs(off) / np.linalg.norm(slope, axis=1)
    near = np.abs((points - middle) @ n) <= 2 * reach
    good = np.isfinite(points).all(axis=1) & (apart <= _ON_SURFACE * size) & near
    k = np.arange(GRID * GRID).reshape(GRID, GRID)
    corners = np.stack([k[:-1, :-1], k[1:, :-1], k[1:, 1:], k[:-1, 1:]], axis=-1).reshape(-1, 4)
    corners = corners[good[corners].all(axis=1)]
    if not len(corners):
        return None
    points[~good] = middle
    return points, np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])


def _value_at(function: ca.Function, points: Floats) -> tuple[Floats, Floats]:
    """Value and gradient, shapes (N,) and (N, 3)."""
    found, slopes = function.map(len(points))(points.T)
    return np.array(found).ravel(), np.array(slopes).reshape(len(points), 3)
