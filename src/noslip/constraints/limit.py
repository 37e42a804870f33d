"""What all limits of the catalog share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import casadi as ca

from noslip._typing import Expression
from noslip.constraints.declaration import Constraint, Relation

ROUNDING = 1e-12
"""How much :func:`rounded_length` may exceed the length, relative to the limit's own scale."""


@dataclass(frozen=True, kw_only=True)
class Limit(Constraint):
    """An inequality of the catalog: ``residual(motion) >= 0``; the residual h is its margin.

    Margins are in the unit of what is limited and change by at most as much as that does (distances
    are 1-Lipschitz), so that their linearization is good far from the limit too.

    Parameters
    ----------
    barrier_rate : float, optional
        1/s; the margin may shrink no faster than like ``exp(-rate t)``: ``dh/dt + rate h >= 0``
        at velocity level, the same twice over (relative degree two) at position level.  The higher,
        the later and the harder the limit acts.  By default 300 per duration of the motion.
    priority : int
        0 is hard.  Where not all can hold, soft limits (1, 2, ...) give way, the largest number
        first.
    """

    barrier_rate: float | None = None
    priority: int = 0

    relation: ClassVar[Relation] = "nonnegative"  # type: ignore[misc]


def rounded_length(vector: Expression, scale: float) -> Expression:
    """``sqrt(x . x + e^2)`` with ``e = 1e-12 scale``: the length, differentiable at 0 as well.

    It is never less than the length, and exceeds it by e at 0, by ``e^2 / (2 |x|)`` elsewhere.
    """
    return ca.sqrt(ca.sumsqr(vector) + (ROUNDING * scale) ** 2)
