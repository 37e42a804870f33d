"""Where the tool must stay: on one side of a plane, above a depth, within a box.

All take ``barrier_rate`` and ``priority`` too, see :class:`noslip.constraints.limit.Limit`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from noslip import _arguments
from noslip._typing import Expression
from noslip.constraints.declaration import register
from noslip.constraints.fields import ORIGIN, Triple, direction, point, settle, unit_vector
from noslip.constraints.instant import Instant
from noslip.constraints.limit import Limit
from noslip.constraints.shape import Plane, Sides
from noslip.errors import ConstraintError

_Bounds = tuple[float | None, float | None, float | None]


@register
@dataclass(frozen=True)
class HalfSpace(Limit):
    """``n . (p - p_0) >= 0``: the tool stays on the side of a plane that the normal points to.

    A forbidden-region virtual fixture (Abbott, Marayong and Okamura 2007).

    Parameters
    ----------
    point : 3 numbers
        p_0, any point of the plane (m, world frame).
    normal : 3 numbers
        n, towards the permitted side (world frame), of any length but 0.
    reference_point : 3 numbers
        The point of the tool that must stay there (m, body frame).
    """

    point: Triple = ORIGIN
    normal: Triple = (0.0, 0.0, 1.0)
    reference_point: Triple = ORIGIN

    name = "half-space"
    level = "position"

    def __post_init__(self) -> None:
        settle(self, self.name, point=point, normal=direction, reference_point=point)

    def shape(self) -> Plane:
        return Plane("limit", self.point, self.normal)

    def residual(self, motion: Instant) -> Expression:
        """Distance to the plane, negative behind it (m)."""
        return _height(motion, self.point, self.normal, self.reference_point)


@register
@dataclass(frozen=True)
class DepthLimit(Limit):
    """``d + n . (p - p_s) >= 0``: the tool goes at most a depth d below a flat surface.

    Parameters
    ----------
    depth : float
        d (m); 0 keeps the tool out of the material.
    surface_point : 3 numbers
        p_s, any point of the surface (m, world frame).
    normal : 3 numbers
        n, out of the material (world frame), of any length but 0.
    reference_point : 3 numbers
        The point of the tool whose depth it is, such as its tip (m, body frame).
    """

    depth: float = 0.01
    surface_point: Triple = ORIGIN
    normal: Triple = (0.0, 0.0, 1.0)
    reference_point: Triple = ORIGIN

    name = "depth-limit"
    level = "position"

    def __post_init__(self) -> None:
        settle(
            self,
            self.name,
            depth=_arguments.not_negative,
            surface_point=point,
            normal=direction,
            reference_point=point,
        )

    def shape(self) -> Plane:
        deepest = np.subtract(
            self.surface_point, self.depth * np.array(unit_vector(self.normal)).ravel()
        )
        return Plane("limit", tuple(deepest.tolist()), self.normal)

    def residual(self, motion: Instant) -> Expression:
        """How much deeper the tool may go (m)."""
        height = _height(motion, self.surface_point, self.normal, self.reference_point)
        return self.depth + height


@register
@dataclass(frozen=True)
class Box(Limit):
    """``l <= p <= u``, side by side: the tool stays within a box along the world's axes.

    Parameters
    ----------
    lower, upper : 3 numbers or None
        l and u (m, world frame); None (or an infinite number) leaves a side out.
    reference_point : 3 numbers
        The point of the tool that must stay there (m, body frame).
    """

    lower: _Bounds = (-1.0, -1.0, -1.0)
    upper: _Bounds = (1.0, 1.0, 1.0)
    reference_point: Triple = ORIGIN

    name = "box"
    level = "position"

    def __post_init__(self) -> None:
        settle(self, self.name, lower=_lower_sides, upper=_upper_sides, reference_point=point)
        if all(side is None for side in self.lower + self.upper):
            raise ConstraintError("box: lower and upper are all None; give at least one side")
        for axis, low, high in zip("xyz", self.lower, self.upper, strict=True):
            if low is not None and high is not None and not low < high:
                raise ConstraintError(
                    f"box: lower must be below upper, got {low} and {high} ({axis})"
                )

    def shape(self) -> Sides:
        return Sides("limit", self.lower, self.upper)

    @property
    def row_names(self) -> tuple[str, ...]:  # type: ignore[override]
        """Of the sides there are, in order."""
        sides = (("least", self.lower), ("largest", self.upper))
        return tuple(
            f"{end} {axis}"
            for end, side in sides
            for axis, place in zip("xyz", side, strict=True)
            if place is not None
        )

    def residual(self, motion: Instant) -> Expression:
        """Distances to the sides (m): from the lower ones x, y, z, then from the upper ones."""
        position = motion.at(self.reference_point).position
        lower = [position[i] - side for i, side in enumerate(self.lower) if side is not None]
        upper = [side - position[i] for i, side in enumerate(self.upper) if side is not None]
        return ca.vertcat(*lower, *upper)


def _height(
    motion: Instant, on_plane: Triple, normal: Triple, reference_point: Triple
) -> Expression:
    offset = motion.at(reference_point).position - ca.DM(list(on_plane))
    return ca.dot(unit_vector(normal), offset)


def _lower_sides(name: str, value: Any) -> _Bounds:
    return _sides(name, value, -math.inf)


def _upper_sides(name: str, value: Any) -> _Bounds:
    return _sides(name, value, math.inf)


def _sides(name: str, value: Any, left_out: float) -> _Bounds:
    try:
        sides = [left_out if side is None else float(side) for side in value]
    except (TypeError, ValueError, OverflowError):
        sides = []
    fits = all(abs(side) <= _arguments.LARGEST or side == left_out for side in sides)
    if len(sides) != 3 or not fits:
        raise ConstraintError(
            f"{name} must be 3 numbers (m), None to leave a side out; got "
            + " ".join(repr(value).split())[:80]
        )
    # JSON has no infinite numbers.
    x, y, z = (None if side == left_out else side for side in sides)
    return x, y, z
