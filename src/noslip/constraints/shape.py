"""What a constraint looks like, where it has a place: values beside its declaration.

Who draws them, such as the viewer, knows these few shapes and no constraint.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from noslip._typing import Expression, Floats

Kind = Literal["contact", "limit", "keep-out", "mark"]
"""What a shape means: where the tool stays, a side it keeps to, where it must not be, a point."""

Triple = Sequence[float]


@dataclass(frozen=True)
class Plane:
    """A plane through a point (m), world frame."""

    kind: Kind
    point: Triple
    normal: Triple


@dataclass(frozen=True)
class Ball:
    """A ball (m), world frame."""

    kind: Kind
    center: Triple
    radius: float


@dataclass(frozen=True)
class Tube:
    """An endless cylinder about an axis through a point (m), world frame."""

    kind: Kind
    point: Triple
    axis: Triple
    radius: float


@dataclass(frozen=True)
class Capsule:
    """What lies within a radius of a line (m), world frame."""

    kind: Kind
    start: Triple
    end: Triple
    radius: float


@dataclass(frozen=True)
class Sides:
    """Sides of a box along the world's axes (m); None where there is none."""

    kind: Kind
    lower: Sequence[float | None]
    upper: Sequence[float | None]


@dataclass(frozen=True)
class Implicit:
    """The surface ``f(p) = 0`` of a position (m), world frame."""

    kind: Kind
    surface: str | Callable[[Expression], Expression]


@dataclass(frozen=True)
class Cells:
    """What is not above 0 within a grid; one of two dimensions is extruded along z.

    Attributes
    ----------
    counts : tuple of int
        Cells along the grid's axes.
    cell : float
        Edge of a cell (m).
    place : callable
        Points in cells from the first one's outer corner, shape (N, n) -> world (m), (N, 3).
    value : callable
        World (m), shape (N, 3) -> distance to what is drawn (m), (N,).
    """

    kind: Kind
    counts: tuple[int, ...]
    cell: float
    place: Callable[[Floats], Floats]
    value: Callable[[Floats], Floats]


@dataclass(frozen=True)
class Mark:
    """A point (m), world frame."""

    point: Triple
    kind: Kind = "mark"


Shape = Plane | Ball | Tube | Capsule | Sides | Implicit | Cells | Mark
