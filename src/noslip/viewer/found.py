"""What was found to hold in a recording, drawn on its tool: axes, points and their regions."""

from __future__ import annotations

import numpy as np
import scipy
import trimesh

from noslip._typing import Floats
from noslip.figures.style import PALETTE
from noslip.identification import Identified, Row
from noslip.viewer.colors import rgb
from noslip.viewer.shapes import COLORS, OPACITIES, REACH, shapes, turned
from noslip.viewer.tool import Part

COLOR, REGION = rgb(PALETTE["orange"]), 0.4
"""Of all that was found, and the opacity of regions: what they are about is seen through them."""
LENGTH = 0.2
"""Of an axis to either side, over the scene's size: longer than the arrows at the tool."""
ROD = 0.002
"""Radius of an axis, and half the least of a region, over the scene's size: thin, but seen."""
WIDEST = np.radians(60.0)
"""Half the angle of a cone, at most: what is wider tells no direction."""
_AROUND = 24
"""Corners around a cone: round to the eye."""


def found_parts(found: Identified, size: float) -> list[Part]:
    """Return what was found, in the tool's frame, for a scene of a size (m).

    Each direction free of slip is a rod through its point, in the double cone of its 95 % region.
    The point is in the ellipsoid of its own; where nothing tells where it is along a line, there is
    that line.  The travel is an arrow.
    """
    parts = [part for row in found.rows for part in _row(row, size)]
    if found.travel is not None:
        start = np.zeros(3) if found.reference_point is None else found.reference_point
        tip = start + LENGTH * size * found.travel
        head = trimesh.creation.cone(4 * ROD * size, 16 * ROD * size)
        parts += [
            _rod(start, tip, ROD * size),
            Part(*turned(head, found.travel, tip), COLOR),
        ]
    return parts


def placed_parts(found: Identified, center: Floats, size: float) -> list[Part]:
    """Return surfaces and points of the world that were found, beside a scene's center (m)."""
    return [
        Part(shape.vertices, shape.faces, COLORS[shape.kind], OPACITIES[shape.kind])
        for shape in shapes(found.constraints, center, size)
    ]


def region(covariance: Floats, unknown: Floats) -> tuple[Floats, Floats]:
    """Return the 95 % region's semiaxes, across what is not known: directions and lengths.

    Shapes (3 - k, 3) and (3 - k,), for k orthonormal rows ``unknown``.
    """
    known = np.linalg.svd(unknown)[2][len(unknown) :]
    variances, turn = np.linalg.eigh(known @ covariance @ known.T)
    square = scipy.special.chdtri(len(known), 0.05)
    return turn.T @ known, np.sqrt(square * np.maximum(variances, 0.0))


def _row(row: Row, size: float) -> list[Part]:
    reach = LENGTH * size * row.axis
    parts = [_rod(row.point - reach, row.point + reach, ROD * size), _cones(row, size)]
    for along in row.unknown:
        far = REACH * size * along
        parts.append(_rod(row.point - far, row.point + far, ROD * size / 2, REGION))
    axes, lengths = region(row.point_covariance, row.unknown)
    if len(axes):
        widths = np.full(3, 2 * ROD * size)
        widths[: len(axes)] = np.clip(lengths, widths[0], REACH * size)
        ball = trimesh.creation.icosphere(subdivisions=2)
        vertices = row.point + ball.vertices * widths @ np.vstack([axes, row.unknown])
        parts.append(Part(vertices, np.array(ball.faces), COLOR, REGION))
    return parts


def _cones(row: Row, size: float) -> Part:
    """Return the surface of all axes on the rim of the region, to either side."""
    axes, angles = region(row.axis_covariance, row.axis[None])
    turns = np.linspace(0.0, 2 * np.pi, _AROUND, endpoint=False)
    lean = np.column_stack([np.cos(turns), np.sin(turns)]) * np.tan(np.minimum(angles, WIDEST))
    rim = LENGTH * size * (row.axis + lean @ axes)
    k, apex = np.arange(_AROUND), np.full(_AROUND, 2 * _AROUND)
    side = np.column_stack([apex, k, (k + 1) % _AROUND])
    faces = np.concatenate([side, side + [0, _AROUND, _AROUND]])
    return Part(row.point + np.concatenate([rim, -rim, np.zeros((1, 3))]), faces, COLOR, REGION)


def _rod(start: Floats, end: Floats, radius: float, opacity: float | None = None) -> Part:
    made = trimesh.creation.cylinder(radius, segment=np.array([start, end]), sections=12)
    return Part(np.array(made.vertices), np.array(made.faces), COLOR, opacity)
