"""Where the tool must not go: obstacles with round boundaries, and of any form as a field.

All take ``barrier_rate`` and ``priority`` too, see :class:`noslip.constraints.limit.Limit`.
The margins are distances: inside an obstacle they are negative, and lead out the nearest way.  At
the very center no way is nearest: there the margin has slope 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from scipy.spatial.transform import Rotation

from noslip import _arguments
from noslip._typing import Expression, Floats
from noslip.constraints.declaration import register
from noslip.constraints.distance_field import DistanceField
from noslip.constraints.fields import ORIGIN, Triple, length, point, settle
from noslip.constraints.instant import Instant
from noslip.constraints.limit import ROUNDING, Limit, rounded_length
from noslip.constraints.occupied import MAPS, MESHES
from noslip.constraints.shape import Ball, Capsule, Cells
from noslip.errors import ConstraintError


@register
@dataclass(frozen=True)
class KeepOutSphere(Limit):
    """``|p - c| - r >= 0``: the tool stays out of a sphere.

    Parameters
    ----------
    center : 3 numbers
        c (m, world frame).
    radius : float
        r (m); add the tool's own size to that of the obstacle.
    reference_point : 3 numbers
        The point of the tool that must stay out (m, body frame).
    """

    center: Triple = ORIGIN
    radius: float = 0.05
    reference_point: Triple = ORIGIN

    name = "keep-out-sphere"
    level = "position"

    def __post_init__(self) -> None:
        settle(self, self.name, center=point, radius=length, reference_point=point)

    def shape(self) -> Ball:
        return Ball("keep-out", self.center, self.radius)

    def residual(self, motion: Instant) -> Expression:
        """Distance to the sphere (m)."""
        position = motion.at(self.reference_point).position
        return _clearance(position - ca.DM(list(self.center)), self.radius)


@register
@dataclass(frozen=True)
class KeepOutCapsule(Limit):
    """``min_s |p - a - s (b - a)| - r >= 0`` over s in [0, 1]: the tool stays out of a capsule.

    A capsule is what lies within a radius of a line segment: vessels, fingers, clamps.  The nearest
    point of the segment has ``s = (p - a) . (b - a) / |b - a|^2``, clamped to [0, 1] (Ericson,
    Real-Time Collision Detection, section 5.1.2).

    Parameters
    ----------
    start, end : 3 numbers
        a and b (m, world frame); equal ones make a sphere.
    radius : float
        r (m); add the tool's own size to that of the obstacle.
    reference_point : 3 numbers
        The point of the tool that must stay out (m, body frame).
    """

    start: Triple = ORIGIN
    end: Triple = (0.0, 0.0, 0.1)
    radius: float = 0.02
    reference_point: Triple = ORIGIN

    name = "keep-out-capsule"
    level = "position"

    def __post_init__(self) -> None:
        settle(self, self.name, start=point, end=point, radius=length, reference_point=point)

    def shape(self) -> Capsule:
        return Capsule("keep-out", self.start, self.end, self.radius)

    def residual(self, motion: Instant) -> Expression:
        """Distance to the capsule (m)."""
        axis = np.subtract(self.end, self.start)
        offset = motion.at(self.reference_point).position - ca.DM(list(self.start))
        square = float(axis @ axis)
        if square > 0:
            along = ca.dot(ca.DM(axis), offset) / square
            offset = offset - ca.fmax(0, ca.fmin(1, along)) * ca.DM(axis)
        return _clearance(offset, self.radius)


@register
@dataclass(frozen=True)
class KeepOut(Limit):
    """``d(p) - r - c >= 0``: the tool stays out of obstacles of any form, known by their distance.

    Parameters
    ----------
    field : DistanceField or path
        d, see :class:`noslip.constraints.DistanceField`; of a file that of a ROS map, what it does
        not know being occupied, or of a closed triangle mesh in meters, with as much room around as
        is to be kept.
    clearance : float
        c (m): how far from the obstacles the tool stays besides.
    reference_point : 3 numbers
        p, the point of the tool that must stay out (m, body frame); r is 0.
    spheres : sequence of (3 numbers, float), optional
        In place of that point: centers p (m, body frame) and radii r (m) of spheres that hold the
        tool.  Each is a row.
    """

    field: DistanceField = field(default_factory=DistanceField.example)
    clearance: float = 0.0
    reference_point: Triple = ORIGIN
    spheres: Sequence[tuple[Triple, float]] = ()

    name = "keep-out"
    level = "position"
    from_files = ("field",)

    def __post_init__(self) -> None:
        settle(
            self,
            self.name,
            clearance=_arguments.not_negative,
            reference_point=point,
            spheres=_spheres,
        )
        if self.spheres and any(self.reference_point):
            raise ConstraintError(
                "keep-out: spheres stand in place of reference_point; give one of both"
            )
        needed = self.clearance + max(radius for _, radius in self._body())
        settle(self, self.name, field=lambda name, value: _field(name, value, needed))
        rim = self.field.rim
        if needed > rim > 0:
            raise ConstraintError(
                f"keep-out: {needed:.4g} m are to be kept, and the field's grid ends {rim:.4g} m "
                f"from what it holds; make it with margin={needed:.4g} or more"
            )

    def shape(self) -> Cells:
        field = self.field
        return Cells(
            "keep-out",
            field.coefficients.shape,
            field.cell,
            field.place,
            lambda at: field.distance(at) - self.clearance,
        )

    def margins(self, positions: Floats, rotations: Rotation) -> Floats:
        """Least distance (m) of each of many poses, shape (N,): for who looks for a way."""
        found = [
            self.field.distance(positions + rotations.apply(center)) - radius
            for center, radius in self._body()
        ]
        least: Floats = np.min(found, axis=0) - self.clearance
        return least

    def _body(self) -> Sequence[tuple[Triple, float]]:
        return self.spheres or [(self.reference_point, 0.0)]

    def residual(self, motion: Instant) -> Expression:
        """Distances to the obstacles (m)."""
        return ca.vertcat(
            *(
                self.field.expression(motion.at(center).position) - radius - self.clearance
                for center, radius in self._body()
            )
        )


def _field(name: str, value: Any, needed: float) -> DistanceField:
    """A field, or that of a file with room for what is to be kept around it."""
    ending = Path(value).suffix.lower() if isinstance(value, (str, Path)) else ""
    if ending in MAPS:
        return DistanceField.from_map(value, margin=needed)
    if ending in MESHES:
        usual = DistanceField.from_mesh(value)
        return usual if usual.rim >= needed else DistanceField.from_mesh(value, margin=needed)
    if not isinstance(value, DistanceField):
        raise ConstraintError(
            f"{name} must be a DistanceField, or a file of a map or mesh that ends with "
            f"{', '.join(MAPS + MESHES)}; got {_arguments.short(value)}"
        )
    return value


def _spheres(name: str, value: Any) -> tuple[tuple[Triple, float], ...]:
    try:
        pairs = [(center, radius) for center, radius in value]
    except (TypeError, ValueError):
        raise ConstraintError(
            f"{name} must be pairs of a center (m, body frame) and a radius (m), as in "
            f"[((0, 0, 0), 0.02)]; got {_arguments.short(value)}"
        ) from None
    return tuple(
        (point(f"{name}: center", center), _arguments.not_negative(f"{name}: radius", radius))
        for center, radius in pairs
    )


def _clearance(offset: Expression, radius: float) -> Expression:
    # Less what the rounding may add: the distance is never overestimated.
    return rounded_length(offset, radius) - (1 + ROUNDING) * radius
