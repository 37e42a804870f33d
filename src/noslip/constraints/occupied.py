"""Occupied cells from files: maps of rooms, and triangle meshes."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Any, Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from noslip import _arguments
from noslip._extras import need
from noslip._files import read_text
from noslip.errors import InputError

Unknown = Literal["occupied", "free"]

MAPS = (".yaml", ".yml")
"""What files of maps end with."""
MESHES = (".stl", ".obj", ".ply", ".off", ".glb")
"""What files of meshes end with."""
MISSED = 0.15
"""Cells by which a mesh's surface may reach into a cell that is not found to be occupied: its
points are found a quarter of a cell apart, so that none is farther than this from one of them."""
_BETWEEN = 0.25
CELLS_OF_A_MESH = 40
"""Along its longest side, unless told: with the free cells around at most 60 a side, which C
holds."""
_MOST_HALVINGS = 40
"""Of an edge: from the longest that numbers hold to a cell."""
_one_reader = Lock()


@dataclass(frozen=True)
class Occupied:
    """Which cells of a grid are occupied, shape (nx, ny) or (nx, ny, nz), and where they are."""

    grid: NDArray[np.bool_]
    cell: float
    origin: tuple[float, ...]
    yaw: float = 0.0


def read_map(path: str | Path, unknown: Unknown, most_cells: int) -> Occupied:
    """Read a map of ROS's map_server: an image, PGM or PNG, and the YAML file that names it.

    A pixel's occupancy is ``(255 - x) / 255`` of its gray x, or ``x / 255`` if negated; above
    ``occupied_thresh`` it is occupied, below ``free_thresh`` free, between them unknown
    (https://wiki.ros.org/map_server).

    Raises
    ------
    InputError
        If a file is missing or is none of a map.
    """
    path = Path(path)
    if unknown not in ("occupied", "free"):
        raise InputError(f"unknown must be 'occupied' or 'free', got {unknown!r}")
    yaml = need(path, "yaml", "maps")
    try:
        told = yaml.safe_load(read_text(path))
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        if isinstance(error, InputError):
            raise
        reason = " ".join(str(error).split())
        raise InputError(f"{path}: is no YAML: {reason}") from error
    keys = ("image", "resolution", "origin", "occupied_thresh", "free_thresh")
    missing = [key for key in keys if not isinstance(told, dict) or key not in told]
    if missing:
        raise InputError(
            f"{path}: names no {missing[0]}; a map of map_server has {', '.join(keys)}"
        )
    if told.get("mode", "trinary") not in ("trinary", "scale"):
        raise InputError(f"{path}: mode is {told['mode']!r}; maps are read as trinary or scale")
    x, y, yaw = _arguments.vector(f"{path}: origin", told["origin"], "m, m, rad").tolist()
    cell = _arguments.positive(f"{path}: resolution", told["resolution"], "meters")
    bounds = [
        _arguments.between(f"{path}: {key}", told[key], 0, 1)
        for key in ("free_thresh", "occupied_thresh")
    ]
    gray = _gray(path.parent / str(told["image"]), most_cells)
    share = gray / 255 if told.get("negate", 0) else (255 - gray) / 255
    occupied = share > bounds[1] if unknown == "free" else share >= bounds[0]
    # The image's first row is the farthest in y.
    return Occupied(np.ascontiguousarray(occupied[::-1].T), cell, (x, y, 0.0), yaw)


def _gray(path: Path, most_cells: int) -> NDArray[np.float64]:
    """Gray values of an image from 0 to 255, shape (rows, columns); what is clear is white."""
    # Matplotlib's own.
    image_module = need(path, "PIL.Image", "maps")
    if not path.is_file():
        raise InputError(f"{path}: no such image; put it beside the YAML file that names it")
    try:
        with _whole_images(path), image_module.open(path, formats=("PPM", "PNG")) as image:
            if image.width * image.height > most_cells:
                raise InputError(
                    f"{path}: {image.width} x {image.height} pixels, at most {most_cells:,} are "
                    "held; cut out the part that matters"
                )
            if image.mode not in ("1", "L", "LA", "P", "RGB", "RGBA"):
                raise InputError(
                    f"{path}: its pixels are {image.mode}; save it with 8 bits of gray"
                )
            return np.asarray(image.convert("L"), dtype=np.float64)
    except InputError:
        raise
    except Exception as error:
        # Whatever a damaged image leads its reader to.
        reason = " ".join(str(error).split())
        raise InputError(f"{path}: cannot be read as PGM or PNG: {reason}") from error


@contextmanager
def _whole_images(path: Path) -> Iterator[None]:
    """Have Pillow refuse images that end early, also where another library told it to fill them.

    WeasyPrint does, of the whole process; what is missing would be read as walls.
    """
    image_file = need(path, "PIL.ImageFile", "maps")
    with _one_reader:
        told = image_file.LOAD_TRUNCATED_IMAGES
        image_file.LOAD_TRUNCATED_IMAGES = False
        try:
            yield
        finally:
            image_file.LOAD_TRUNCATED_IMAGES = told


def voxels(mesh: Any, cell: float | None, scale: float, most_cells: int) -> Occupied:
    """Cells that a closed triangle mesh touches or holds.

    Parameters
    ----------
    mesh : path or trimesh.Trimesh
    cell : float, optional
        Edge of a cell (m); by default a fortieth of the longest side.
    scale : float
        Meters of a unit of the mesh.
    most_cells : int

    Raises
    ------
    InputError
        If there is no mesh, or it is not closed: then it has no inside.
    """
    name = mesh if isinstance(mesh, (str, Path)) else "mesh"
    trimesh = need(name, "trimesh", "meshes")
    if isinstance(mesh, (str, Path)):
        path = Path(mesh)
        if not path.is_file():
            raise InputError(f"{path}: no such file")
        try:
            mesh = trimesh.load(path, force="mesh")
        except Exception as error:
            # Whatever a damaged file leads its reader to.
            reason = " ".join(f"{error}".split()) or type(error).__name__
            raise InputError(f"{path}: cannot be read as a triangle mesh: {reason}") from error
    if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
        raise InputError(f"{name}: is no triangle mesh, got {_arguments.short(mesh)}")
    vertices = np.asarray(mesh.vertices, dtype=np.float64) * scale
    if not np.isfinite(vertices).all():
        raise InputError(f"{name}: has vertices that are not finite numbers")
    if not mesh.is_watertight:
        raise InputError(
            f"{name}: is not closed: it has no inside; repair it (trimesh.repair.fill_holes)"
            ", or take DistanceField.from_points of its vertices"
        )
    sides = np.ptp(vertices, axis=0)
    cell = cell or float(sides.max()) / CELLS_OF_A_MESH
    counts = np.ceil(sides / cell) + 2
    if math.prod(counts.tolist()) > most_cells:
        raise InputError(
            f"{name}: takes {math.prod(counts.tolist()):.3g} cells of {cell:g} m, at most "
            f"{most_cells:,} are held; take larger cells, or give its unit as scale (0.001 for mm)"
        )
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    origin = middle - counts * cell / 2
    points, _ = trimesh.remesh.subdivide_to_size(
        vertices, np.asarray(mesh.faces), _BETWEEN * cell, max_iter=_MOST_HALVINGS
    )
    grid = np.zeros(counts.astype(int), dtype=bool)
    grid[tuple(((points - origin) / cell).astype(int).T)] = True
    return Occupied(scipy.ndimage.binary_fill_holes(grid), cell, tuple(origin.tolist()))
