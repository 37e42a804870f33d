"""The edge of a tool: which way it travels, which way it must not, and at which of its points."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from noslip import _arguments
from noslip._typing import Floats
from noslip.errors import ConstraintError, InputError

Axis = str | Sequence[float] | Floats
"""A body axis: x, y or z with its sign, as in ``"-x"``, or a direction in the body's frame, three
numbers of any length."""

AXES = ("x", "y", "z")
"""Body axes, in the order of a vector's components."""
_PARALLEL = 0.1
"""Sine of the angle (6 degrees) below which two axes are taken for the same one: what is left of
one across the other would be of another direction than anyone gave."""


@dataclass(frozen=True)
class Edge:
    """A tool's axis of travel, its lateral axis and its point, in the body's frame.

    Velocities are those relative to the work: where that moves, see
    :func:`noslip.constraints.edge_motion.edge_motion`.

    Attributes
    ----------
    travel : str or 3 numbers
        The body axis that leads, such as ``"x"``, or ``"-x"`` for a tool recorded backwards: its
        part perpendicular to the lateral axis.
    lateral : str, 3 numbers or None
        The body axis along which it must not move; None, if only the way forward is known.
    point : 3 numbers
        Where the edge is (m).

    Raises
    ------
    ConstraintError
        If one is no body axis, both are parallel, or the point is none.
    """

    travel: Axis = "x"
    lateral: Axis | None = "y"
    point: Sequence[float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "travel", checked_axis("edge: travel", self.travel))
        if self.lateral is not None:
            object.__setattr__(self, "lateral", checked_axis("edge: lateral", self.lateral))
            across(self.travel, self.lateral, "edge: travel and lateral")
        try:
            point = tuple(_arguments.vector("edge: point", self.point).tolist())
        except InputError as error:
            raise ConstraintError(str(error)) from None
        object.__setattr__(self, "point", point)

    @property
    def frame(self) -> Floats:
        """Its travel, its lateral axis and their cross product as rows, body frame: (3, 3).

        The lateral axis must be known.
        """
        if self.lateral is None:
            raise ConstraintError("edge: its lateral axis is not known")
        travel, lateral = across(self.travel, self.lateral), unit_axis(self.lateral)
        return np.array([travel, lateral, np.cross(travel, lateral)])

    def travel_axes(self, rotations: Rotation) -> Floats:
        """Unit vectors of its travel, turned by rotations: shape (N, 3), or (3,) by one."""
        travel = unit_axis(self.travel) if self.lateral is None else self.frame[0]
        return np.asarray(rotations.as_matrix() @ travel)

    def lateral_axes(self, rotations: Rotation) -> Floats:
        """Unit vectors across it, as :meth:`travel_axes`; the lateral axis must be known."""
        return np.asarray(rotations.as_matrix() @ self.frame[1])

    def points(self, positions: Floats, rotations: Rotation) -> Floats:
        """Return where its point is (m), shape (N, 3), with the tool's origin at positions."""
        return np.asarray(positions + rotations.apply(self.point))

    def velocities(self, rotations: Rotation, linear: Floats, angular: Floats) -> Floats:
        """Velocity of its point (m/s), shape (N, 3), from the twists of the tool."""
        return np.asarray(linear + np.cross(angular, rotations.apply(self.point)))


def checked_axis(name: str, value: Axis) -> Axis:
    """Return a body axis as it is kept: one of the six by its name, any other as a tuple."""
    try:
        numbers = _letter(value) if isinstance(value, str) else _arguments.vector(name, value)
    except InputError:
        numbers = np.zeros(3)
    if not numbers.any():
        raise ConstraintError(
            f"{name}: a body axis is one of x, y, z, -x, -y, -z or three numbers, not all 0; "
            f"got {value!r}"
        )
    if np.count_nonzero(numbers) > 1:
        return tuple(numbers.tolist())
    return ("-" if numbers.sum() < 0 else "") + AXES[int(np.argmax(numbers != 0))]


def _letter(name: str) -> Floats:
    sign = -1.0 if name.startswith("-") else 1.0
    return sign * np.array([float(letter == name.removeprefix("-")) for letter in AXES])


def unit_axis(axis: Axis) -> Floats:
    """Unit vector of a body axis, body frame, shape (3,)."""
    return _letter(axis) if isinstance(axis, str) else unit(axis)


def unit(numbers: Sequence[float] | Floats) -> Floats:
    """Vector of length 1 along a direction, shape (3,)."""
    # Divided by its largest component first: squares of tiny numbers would vanish.
    vector = np.array(numbers) / np.max(np.abs(numbers))
    return np.asarray(vector / np.linalg.norm(vector))


def across(axis: Axis, other: Axis, what: str = "axes") -> Floats:
    """Unit vector of the part of a body axis that is perpendicular to another, shape (3,).

    Raises
    ------
    ConstraintError
        If they are parallel, naming `what`.
    """
    vector, away = unit_axis(axis), unit_axis(other)
    vector = vector - (vector @ away) * away
    if not np.linalg.norm(vector) > _PARALLEL:
        raise ConstraintError(f"{what} must not be parallel, got {axis!r} and {other!r}")
    return unit(vector)


def axis_names(axes: Iterable[Floats]) -> tuple[str, ...]:
    """Return what body axes are called: by their letters, if all have one, else numbered."""
    named = [checked_axis("axis", axis.tolist()) for axis in axes]
    if all(isinstance(name, str) for name in named):
        return tuple(str(name).removeprefix("-") for name in named)
    return tuple(str(k) for k in range(1, len(named) + 1))


def other_axes(axis: Axis) -> tuple[Floats, Floats]:
    """Two unit vectors perpendicular to a body axis and to each other: z and x for ``"-y"``.

    They are the two body axes that follow the nearest one in cyclic order, turned with it.
    """
    vector = unit_axis(axis)
    nearest = int(np.argmax(np.abs(vector)))
    first = across(AXES[(nearest + 1) % 3], axis)
    return first, np.sign(vector[nearest]) * np.cross(vector, first)
