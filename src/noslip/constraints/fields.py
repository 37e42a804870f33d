"""Checked arguments of the catalog's constraints, and what they name in a motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, cast

import casadi as ca

from noslip import _arguments
from noslip._typing import Expression
from noslip.constraints.declaration import Constraint
from noslip.constraints.instant import Instant
from noslip.edge import Axis, Edge, across, checked_axis, unit, unit_axis
from noslip.errors import ConstraintError, InputError

Triple = Sequence[float]
"""Three numbers; kept as a tuple, so that constraints compare equal and can be saved."""

ORIGIN = (0.0, 0.0, 0.0)
_HARMLESS = 1e-30
"""Added to a squared length: below rounding for all but lengths under 1e-7."""

Check = Callable[[str, Any], Any]
"""(what an error calls the argument, value) -> the value as it is kept."""


def settle(constraint: Constraint, name: str, /, **checks: Check) -> None:
    """Check the fields of a frozen constraint and keep what the checks return.

    Raises
    ------
    ConstraintError
        One line that names the constraint and the argument.
    """
    for field, check in checks.items():
        try:
            value = check(f"{name}: {field}", getattr(constraint, field))
        except InputError as error:
            raise ConstraintError(str(error)) from None
        object.__setattr__(constraint, field, value)


def settle_edge(constraint: Constraint, name: str, lateral: Axis | None, both: str = "") -> None:
    """Make the :class:`Edge` of a constraint whose argument ``edge`` names the axis of travel.

    `both` is what an error calls the lateral axis and the edge.
    """
    settle(constraint, name, edge=_travel)
    travel, place = cast(Axis, constraint.edge), constraint.reference_point  # type: ignore[attr-defined]
    if lateral is not None:
        across(travel, lateral, f"{name}: {both}")
    object.__setattr__(constraint, "edge", Edge(travel, lateral, place))


def _travel(name: str, value: Any) -> Axis:
    # A copy with other arguments is given the edge that was made before.
    return checked_axis(name, value.travel if isinstance(value, Edge) else value)


def point(name: str, value: Any, unit: str = "m") -> tuple[float, ...]:
    """Three finite numbers, as a tuple."""
    return tuple(_arguments.vector(name, value, unit).tolist())


def direction(name: str, value: Any) -> tuple[float, ...]:
    """Three finite numbers, not all 0; the length is kept but means nothing."""
    numbers = point(name, value, "a direction")
    if not any(numbers):
        raise ConstraintError(f"{name} must not be zero, got {value!r}")
    return numbers


def length(name: str, value: Any) -> float:
    """Meters, above 0."""
    return _arguments.positive(name, value, "meters")


def number(name: str, value: Any, unit: str = "") -> float:
    """One finite number."""
    found = _arguments.number(value)
    if not abs(found) <= _arguments.LARGEST:
        raise ConstraintError(
            f"{name} must be a finite number{f' of {unit}' if unit else ''}, got {value!r}"
        )
    return found


def body_axis(motion: Instant, axis: Axis) -> Expression:
    """World direction of a body axis."""
    return motion.rotation @ ca.sparsify(ca.DM(unit_axis(axis)))


def unit_vector(numbers: Triple) -> Expression:
    """Constant column of length 1 along a direction."""
    return ca.DM(unit(numbers))


def safe_norm(vector: Expression) -> Expression:
    """Length of a vector, differentiable at 0 too (where the derivative is 0)."""
    return ca.sqrt(ca.sumsqr(vector) + _HARMLESS)
