"""The tool that is shown: a scalpel made here, or a mesh from a file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import trimesh
import viser
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from noslip import _arguments
from noslip._typing import Floats
from noslip.edge import Edge
from noslip.errors import InputError

if TYPE_CHECKING:
    from noslip.viewer.shapes import Shape

SUFFIXES = (".stl", ".obj", ".glb")
"""Of the meshes that trimesh reads without more packages."""
STEEL, HANDLE = (168, 176, 186), (62, 74, 90)
"""Colors: a blade that reflects, a handle that is dark beside every path."""
_CUTTING = ((0.0, 0.0), (0.06, 0.025), (0.095, 0.08), (0.105, 0.15), (0.105, 0.30))
"""The edge, from the tip upwards: along its travel (x) and up (z), over the tool's length."""
_BACK = ((0.02, 0.36), (0.0, 0.30), (-0.035, 0.12))
"""The other side of the blade, from the handle back to the tip."""
_SHARP, _SPINE = 0.0002, 0.008
"""Half the thickness of the blade's edge and of its back, over the tool's length."""
_SHAFT = ((0.02, 0.34), (0.098, 0.30), (0.085, 1.0), (0.03, 1.0))
"""The handle, in the same plane."""
_SHAFT_HALF = 0.022
"""Half the thickness of the handle, over the tool's length."""

_CART_WIDTH, _CART_WHEEL = 0.6, 0.16
"""Of a cart from wheel to wheel, and the wheels' radius, over its length."""


def add_mesh(
    scene: viser.SceneApi, node: str, mesh: Part | Shape, color: tuple[int, int, int], **look: Any
) -> Any:
    """Draw triangles that are seen from both sides, without shadows."""
    return scene.add_mesh_simple(
        node,
        mesh.vertices,
        mesh.faces,
        color=color,
        side="double",
        cast_shadow=False,
        receive_shadow=False,
        **look,
    )


@dataclass(frozen=True, eq=False)
class Part:
    """A triangle mesh of one color, in the frame of the tool, of an arm's geom, or the world.

    Attributes
    ----------
    vertices : array, shape (V, 3)
        Meters.
    faces : array, shape (F, 3)
    color : 3 bytes
    opacity : float, optional
        Below 1 where it is seen through.
    """

    vertices: Floats
    faces: NDArray[np.int64]
    color: tuple[int, int, int]
    opacity: float | None = None


def scalpel(length: float, edge: Edge | None = None, *, flip: bool = False) -> list[Part]:
    """Return a scalpel whose tip is the tool's origin.

    Parameters
    ----------
    length : float
        Meters.
    edge : Edge, optional
        With a lateral axis: along its travel it cuts, across that it is flat; by default a
        blade's.
    flip : bool
        Whether the handle points the other way along the third axis.
    """
    blade = _wedge(np.array(_CUTTING + _BACK), [_SHARP] * len(_CUTTING) + [_SPINE] * len(_BACK))
    shaft = _wedge(np.array(_SHAFT), [_SHAFT_HALF] * len(_SHAFT))
    frame = (edge or Edge()).frame
    if flip:
        # A half turn about the edge: the lateral axis changes its sign alone, and it has none.
        frame[1:] *= -1
    return [
        Part(length * vertices @ frame, faces, color)
        for (vertices, faces), color in ((blade, STEEL), (shaft, HANDLE))
    ]


def cart(length: float, edge: Edge | None = None, *, flip: bool = False) -> list[Part]:
    """Return a cart whose axle is in the tool's origin, at the height of the ground.

    The parameters are those of :func:`scalpel`; it leads with the side that tapers.
    """
    half = _CART_WIDTH / 2
    parts = []
    for side in (-half, half):
        wheel = trimesh.creation.cylinder(_CART_WHEEL, height=0.06, sections=32)
        upright = np.eye(4)
        upright[:3, :3] = Rotation.from_euler("x", np.pi / 2).as_matrix()
        wheel.apply_transform(upright)
        wheel.apply_translation([0.0, side, _CART_WHEEL])
        parts.append(((np.array(wheel.vertices), np.array(wheel.faces)), HANDLE))
    low, high = 0.5 * _CART_WHEEL, 1.6 * _CART_WHEEL
    outline = np.array([(-0.2, low), (-0.2, high), (0.35, high), (0.8, low)])
    parts.append((_wedge(outline, [half - 0.05] * 3 + [half / 3]), STEEL))
    frame = (edge or Edge()).frame
    if flip:
        frame[1:] *= -1
    return [Part(length * vertices @ frame, faces, color) for (vertices, faces), color in parts]


def rod(length: float) -> list[Part]:
    """Return a rod along z with a ball at its end, the tool's origin: a body of no known shape."""
    stick = trimesh.creation.cylinder(0.04 * length, segment=np.array([[0, 0, 0], [0, 0, length]]))
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.1 * length)
    return [
        Part(np.array(made.vertices, dtype=np.float64), np.array(made.faces), color)
        for made, color in ((ball, STEEL), (stick, HANDLE))
    ]


def load_tool(path: str | Path, *, scale: float = 1.0) -> list[Part]:
    """Read a tool's mesh, in the tool's frame.

    Parameters
    ----------
    path : path
        ``.stl``, ``.obj`` or ``.glb``.
    scale : float
        Meters per unit of the file; 0.001 for one drawn in millimeters.

    Raises
    ------
    InputError
        If it cannot be read, or holds no triangles.
    """
    path = Path(path)
    scale = _arguments.positive("tool scale", scale, "meters per unit")
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"{path}: a tool is a mesh in {', '.join(SUFFIXES)}")
    if not path.is_file():
        raise InputError(f"{path}: no such file; check the path")
    try:
        mesh = trimesh.load(path, force="mesh")
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{path}: cannot be read as a mesh: {reason[:120]}") from error
    faces = np.array(getattr(mesh, "faces", ()), dtype=np.int64)
    vertices = np.array(getattr(mesh, "vertices", ()), dtype=np.float64)
    if not len(faces) or not np.isfinite(vertices).all():
        raise InputError(f"{path}: holds no triangles with finite corners; export it as a mesh")
    return [Part(scale * vertices, faces, STEEL)]


def _wedge(outline: Floats, halves: list[float]) -> tuple[Floats, NDArray[np.int64]]:
    """Return a convex outline in the x-z plane, given a thickness along y at each corner."""
    x, z = outline.T
    sides = [np.stack([x, sign * np.array(halves), z], axis=1) for sign in (-1, 1)]
    made = trimesh.convex.convex_hull(np.concatenate(sides))
    return np.array(made.vertices), np.array(made.faces)
