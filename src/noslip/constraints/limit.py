"""What all limits of the catalogue share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from noslip import _arguments
from noslip.constraints.declaration import Constraint, Relation, axis_index
from noslip.errors import InputError
from noslip.rotations import Expression

Triple = tuple[float, float, float]

ROUNDING = 1e-12
"""How much :func:`rounded_length` may exceed the length, relative to the limit's own scale."""


@dataclass(frozen=True, kw_only=True)
class Limit(Constraint):
    """An inequality of the catalogue: ``residual(motion) >= 0``; the residual h is its margin.

    Margins are in the unit of what is limited and change by at most as much as that does (distances
    are 1-Lipschitz), so that their linearisation is good far from the limit too.

    Parameters
    ----------
    barrier_rate : float, optional
        1/s; the margin may shrink no faster than like ``exp(-rate t)``: ``dh/dt + rate h >= 0``
        at velocity level, the same twice over (relative degree two) at position level.  The higher,
        the later and the harder the limit acts.  By default 100 per duration of the motion.
    priority : int
        0 is hard.  Where not all can hold, soft limits (1, 2, ...) give way, the largest number
        first.
    """

    barrier_rate: float | None = None
    priority: int = 0

    relation: ClassVar[Relation] = "nonnegative"  # type: ignore[misc]

    def _check(self, **checks: Callable[[str, Any], Any]) -> None:
        """Replace arguments by what their checks return; errors name limit and argument."""
        for argument, check in checks.items():
            value = check(f"{self.name}: {argument}", getattr(self, argument))
            object.__setattr__(self, argument, value)


def three_numbers(name: str, value: Any) -> Triple:
    """Return 3 finite numbers (m) as a tuple: equal points compare equal, and save as JSON."""
    x, y, z = _arguments.vector(name, value).tolist()
    return x, y, z


def direction(name: str, value: Any) -> Triple:
    """Return 3 finite numbers, not all 0, as given: made a unit vector twice, they might differ."""
    x, y, z = _arguments.vector(name, value, "a direction").tolist()
    if x == y == z == 0:
        raise InputError(f"{name} must not be zero: it is a direction, such as (0, 0, 1)")
    return x, y, z


def body_axis(name: str, value: Any) -> str:
    """Return a body axis with its sign, such as ``"-x"``."""
    axis_index(value, name)
    return str(value)


def unit_vector(along: Sequence[float]) -> Expression:
    """Return the vector of length 1 that points along another, of whatever length."""
    # Divided by its largest component first: squares of tiny numbers would vanish.
    vector = np.array(along) / np.max(np.abs(along))
    return ca.DM(vector / np.linalg.norm(vector))


def rounded_length(vector: Expression, scale: float) -> Expression:
    """``sqrt(x . x + e^2)`` with ``e = 1e-12 scale``: the length, differentiable at 0 as well.

    It is never less than the length, and exceeds it by e at 0, by ``e^2 / (2 |x|)`` elsewhere.
    """
    return ca.sqrt(ca.sumsqr(vector) + (ROUNDING * scale) ** 2)
