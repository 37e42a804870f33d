"""Who gives way: the metric M of Gauss's principle.

The correction of a step's acceleration is the least in ``a^T M a``, with
``M = diag(w_1, w_2, w_3, w_4 L^2, w_5 L^2, w_6 L^2)`` over linear and angular acceleration; L is
the length that weighs as much as a radian.

- ``"position"``: the rotation is held, the position gives way.  The paper's choice.
- ``"rotation"``: the position is held.  A blade must then turn into its path at any price; at rest,
  where a turn does not help, nothing can.
- ``"shared"``: both, all weights 1.  A turn corrects a blade's slip in proportion to the way ds
  that it moves in a step, so the rotation takes the share ``ds^2 / (ds^2 + L^2)``: most of it while
  it moves fast, none at rest, where the position gives way instead.  Nothing is singular there and
  the angular acceleration stays bounded.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import casadi as ca

from noslip import _arguments
from noslip.constraints.system import ConstraintSystem
from noslip.errors import InputError
from noslip.projection.pointwise import POSITION_ONLY, holdable_rows

Metric = Literal["position", "rotation", "shared"] | Sequence[float]


def inverse_metric(
    system: ConstraintSystem, metric: Metric | None, length: float | None, usual: float
) -> tuple[float, ...]:
    """Diagonal of M^-1, 6 numbers.

    Parameters
    ----------
    system : ConstraintSystem
    metric : "position", "rotation", "shared" or 6 positive weights, or None
        None is "position" where that can hold every constraint and no limit is about turning (a
        tool that goes on turning cannot stand still for it), else "shared".
    length : float or None
        L (m); None is the usual one.
    usual : float
        Of the path at hand (m); 0 for one that does not move.

    Raises
    ------
    InputError
        If the metric is none of these.
    """
    if length is None:
        length = usual if usual > 0 else 1.0
    length = _arguments.positive("metric_length", length, "m")
    turn = 1 / length**2
    if metric is None:
        position = all(holdable_rows(system, POSITION_ONLY)) and not _limits_turning(system.limits)
        metric = "position" if position else "shared"
    if isinstance(metric, str):
        if metric not in _NAMED:
            raise InputError(
                f"metric is one of {', '.join(_NAMED)}, or 6 positive weights; got {metric!r}"
            )
        return _scaled(_NAMED[metric], turn)
    return _scaled([1 / weight for weight in _arguments.positive_weights("metric", metric)], turn)


def _limits_turning(limits: ConstraintSystem) -> bool:
    motion = [ca.SX.sym(name, n) for name, n in zip("tpqvwab", (1, 3, 4, 3, 3, 3, 3), strict=True)]
    rows = ca.vertcat(limits.first_order(*motion[:5]), limits.residual(*motion))
    return bool(ca.depends_on(rows, ca.vertcat(motion[4], motion[6])))


def _scaled(inverse_weights: Sequence[float], turn: float) -> tuple[float, ...]:
    return (*inverse_weights[:3], *(turn * weight for weight in inverse_weights[3:]))


_NAMED = {
    "position": POSITION_ONLY,
    "rotation": (0.0, 0.0, 0.0, 1.0, 1.0, 1.0),
    "shared": (1.0, 1.0, 1.0, 1.0, 1.0, 1.0),
}
