"""Of which of several bodies a rule is, or of which as another one that moves sees it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

from noslip import _arguments
from noslip._typing import Expression
from noslip.bodies import Bodies
from noslip.constraints.blade import Blade
from noslip.constraints.catalog import resolved
from noslip.constraints.declaration import Constraint, register
from noslip.constraints.fields import ORIGIN, Triple, point, settle
from noslip.constraints.instant import Instant
from noslip.errors import ConstraintError, InputError
from noslip.rotations import rotation_matrix
from noslip.space import IN

_INHERITED = ("level", "relation", "edge", "unit", "barrier_rate", "priority", "radii", "row_names")
_UNTURNED = (1.0, 0.0, 0.0, 0.0)


@register
@dataclass(frozen=True)
class OfBody(Constraint):
    """A constraint on one of several bodies, see :func:`of` and :func:`relative_to`.

    Parameters
    ----------
    constraint : Constraint or str
        Of the pose and motion of one body; or its name and arguments as on the command line.
    body : str
        Its name, ``"knife"``; the first one by default; or ``"knife in tissue"``, as the moving
        frame of another one sees it: what the constraint calls world is then that frame, and a
        step's twist leads from the relative pose before it to the one after it.
    """

    constraint: Constraint | str = field(default_factory=Blade)
    body: str = ""

    name = "of-body"

    def __post_init__(self) -> None:
        inner = resolved("of-body", self.constraint)
        if not isinstance(self.body, str):
            raise ConstraintError(f"of-body: body is a name, got {self.body!r}")
        if inner.coordinates or inner.body:
            what = f"body {inner.body!r}" if inner.body else "coordinates"
            raise ConstraintError(
                f"of-body: constraint {inner.name!r} is of {what} already; give it as it was before"
            )
        object.__setattr__(self, "constraint", inner)
        object.__setattr__(self, "name", f"{inner.name} of {self.body or 'the first body'}")
        for attribute in _INHERITED:
            object.__setattr__(self, attribute, getattr(inner, attribute))

    @property
    def inner(self) -> Constraint:
        """What holds of the body."""
        assert isinstance(self.constraint, Constraint)
        return self.constraint

    def residual(self, motion: Instant) -> Expression:
        """The constraint's own, in its unit."""
        return self.inner.residual(motion)

    def relative(self, motion: Instant) -> Instant:
        """Motion relative to what moves under the body, as the constraint says."""
        return self.inner.relative(motion)


def of(constraint: Constraint, body: str) -> OfBody:
    """Return a constraint as that of a body, such as ``of(Blade(), "knife")``."""
    return OfBody(constraint, body)


def relative_to(constraint: Constraint, body: str, work: str) -> OfBody:
    """Return a constraint on a body's motion in the frame of another one that moves.

    ``relative_to(Blade(), "knife", "tissue")``: a knife that does not slip in tissue that moves.
    """
    return OfBody(constraint, f"{body}{IN}{work}")


@dataclass(frozen=True)
class HoldTogether(Constraint):
    """Two bodies keep their relative pose: ``p - p_0 = 0``, ``vee(R_0^T R - R^T R_0) / 2 = 0``.

    p and R are the first body's pose in the second one's frame: two hands on one tray.
    Holonomic, six rows: three in m, then three that are the sine of the angle that is off, about
    its axis (rad).

    Parameters
    ----------
    first, second : str
        The bodies' names.
    position : 3 numbers
        p_0, m, in the second body's frame.
    quaternion : 4 numbers
        R_0 (w first); of any length but 0.
    """

    first: str
    second: str
    position: Triple = ORIGIN
    quaternion: tuple[float, ...] = _UNTURNED

    level = "position"
    unit = "m, rad"
    row_names = ("x", "y", "z", "about x", "about y", "about z")

    def __post_init__(self) -> None:
        settle(self, "hold-together", position=point, quaternion=_unit_quaternion)
        for what in ("first", "second"):
            if not (isinstance(name := getattr(self, what), str) and name):
                raise ConstraintError(f"hold-together: {what} is a body's name, got {name!r}")
        object.__setattr__(self, "body", f"{self.first}{IN}{self.second}")
        object.__setattr__(self, "name", f"{self.first} held to {self.second}")

    @classmethod
    def as_recorded(cls, bodies: Bodies, first: str, second: str) -> HoldTogether:
        """Return the rule that two bodies stay as they are when a recording begins."""
        seen = bodies.body(f"{first}{IN}{second}")
        return cls(first, second, seen.positions[0].tolist(), tuple(seen.quaternions[0].tolist()))

    def residual(self, motion: Instant) -> Expression:
        """How far the relative pose is from what it must be (m, then rad)."""
        off = ca.mtimes(rotation_matrix(ca.DM(list(self.quaternion))).T, motion.rotation)
        sine = ca.vertcat(off[2, 1] - off[1, 2], off[0, 2] - off[2, 0], off[1, 0] - off[0, 1]) / 2
        return ca.vertcat(motion.position - ca.DM(list(self.position)), sine)


def _unit_quaternion(name: str, value: Any) -> tuple[float, ...]:
    try:
        numbers = _arguments.vector(name, value, "w first", size=4)
    except InputError as error:
        raise ConstraintError(str(error)) from None
    length = float(np.linalg.norm(numbers))
    if not length > 0:
        raise ConstraintError(f"{name} must not be zero")
    # Of length 1 but for rounding it stays as it is: read again, it is equal.
    if abs(length - 1) > 1e-15:
        numbers = numbers / length
    return tuple(numbers.tolist())
