"""The edge of a tool: which way it travels, which way it must not, and at which of its points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from noslip import _arguments
from noslip._typing import Floats
from noslip.errors import ConstraintError, InputError

AXES = ("x", "y", "z")
"""Body axes, in the order of a vector's components."""


@dataclass(frozen=True)
class Edge:
    """A tool's axis of travel, its lateral axis and its point, in the body's frame.

    Velocities are those relative to the work: where that moves, see
    :func:`noslip.constraints.edge_motion.edge_motion`.

    Attributes
    ----------
    travel : str
        The body axis that leads, such as ``"x"``, or ``"-x"`` for a tool recorded backwards.
    lateral : str or None
        The body axis along which it must not move; None, if only the way forward is known.
    point : 3 numbers
        Where the edge is (m).

    Raises
    ------
    ConstraintError
        If one is no body axis, both are the same, or the point is none.
    """

    travel: str = "x"
    lateral: str | None = "y"
    point: Sequence[float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        travel, _ = axis_index(self.travel, "edge: travel")
        if self.lateral is not None and axis_index(self.lateral, "edge: lateral")[0] == travel:
            raise ConstraintError(
                f"edge: travel and lateral must be different axes, got {self.travel!r} and "
                f"{self.lateral!r}"
            )
        try:
            point = tuple(_arguments.vector("edge: point", self.point).tolist())
        except InputError as error:
            raise ConstraintError(str(error)) from None
        object.__setattr__(self, "point", point)

    def travel_axes(self, rotations: Rotation) -> Floats:
        """Unit vectors of its travel, turned by rotations: shape (N, 3), or (3,) by one."""
        return axis_vectors(rotations, self.travel)

    def lateral_axes(self, rotations: Rotation) -> Floats:
        """Unit vectors across it, as :meth:`travel_axes`; the lateral axis must be known."""
        if self.lateral is None:
            raise ConstraintError("edge: its lateral axis is not known")
        return axis_vectors(rotations, self.lateral)

    def points(self, positions: Floats, rotations: Rotation) -> Floats:
        """Return where its point is (m), shape (N, 3), with the tool's origin at positions."""
        return np.asarray(positions + rotations.apply(self.point))

    def velocities(self, rotations: Rotation, linear: Floats, angular: Floats) -> Floats:
        """Velocity of its point (m/s), shape (N, 3), from the twists of the tool."""
        return np.asarray(linear + np.cross(angular, rotations.apply(self.point)))


def axis_index(axis: str, name: str = "axis") -> tuple[int, float]:
    """Index and sign of a body axis such as ``"y"`` or ``"-x"``."""
    letter = axis.removeprefix("-") if isinstance(axis, str) else axis
    if not isinstance(letter, str) or letter not in AXES:
        raise ConstraintError(f"{name}: a body axis is one of x, y, z, -x, -y, -z; got {axis!r}")
    return AXES.index(letter), -1.0 if axis.startswith("-") else 1.0


def axis_vectors(rotations: Rotation, axis: str) -> Floats:
    """Unit vectors of a body axis, turned by rotations, shape (N, 3), or (3,) by a single one."""
    index, sign = axis_index(axis)
    return np.asarray(sign * rotations.as_matrix()[..., index])
