"""Who gives way: the metric M of Gauss's principle.

The correction of a step's acceleration is the least in ``a^T M a``, with
``M = diag(w_1, w_2, w_3, w_4 L^2, w_5 L^2, w_6 L^2)`` over linear and angular acceleration; L is
the length that weighs as much as a radian.

- ``"position"``: the rotation is held, the position gives way.  The paper's choice.
- ``"shared"``: both, all weights 1.  A turn corrects a blade's slip in proportion to the way ds
  that it moves in half a step, to the middle where the blade is asked; so the rotation takes the
  share ``ds^2 / (ds^2 + L^2)``: most of it while it moves fast, none at rest, where the position
  gives way instead.  Nothing is singular there and the angular acceleration stays bounded.
- ``"auto"``, the default: the position where that can hold all that the demonstrations ask, else
  shared.  Also where a limit on the position meets a rule on velocities: before an obstacle a blade
  that may not turn can only stop.  And of a rhythm under such a rule: a blade that saws beside its
  cycle comes back to it by turning alone.

The rotation alone is no choice step by step: a heading asked for in the middle of each step,
``(theta_k + theta_k+1) / 2 = direction``, is passed by as much as it was missed before, for ever.
The trajectory projection does that job (``hold_position=True``), all steps at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import casadi as ca
import numpy as np

from noslip import _arguments
from noslip._typing import Floats
from noslip.constraints.system import ConstraintSystem
from noslip.errors import InputError
from noslip.projection.pointwise import holdable_rows, position_only
from noslip.trajectory import PoseTrajectory

Metric = Literal["auto", "position", "shared"] | Sequence[float]

_ROBUST = 0.05
"""Least singular value of what the position can do about the rows, of unit norm, by which it may
hold them alone: a blade's or a needle's is 1 everywhere; where it vanishes, rounding becomes a
kick, and at a twentieth a correction is twenty times what shared would make it."""
_MOVING = 1e-3
"""Speed over the mean from which a tool moves: at rest a row may vanish, and asks for nothing."""
_LOOKED_AT = 200
"""Steps of a motion that are looked at: a row all but vanishes over a stretch, not in one step."""
_SAME_ROW = 1e-9
"""Singular value, over the largest, below which rows repeat others; doubled rules are harmless."""


def inverse_metric(
    system: ConstraintSystem,
    metric: Metric,
    length: float | None,
    usual: float,
    demonstrations: Sequence[PoseTrajectory] = (),
    *,
    returns: bool = False,
) -> tuple[float, ...]:
    """Diagonal of M^-1, n + 3 b numbers.

    Parameters
    ----------
    system : ConstraintSystem
    metric : "auto", "position", "shared" or n + 3 b positive weights
        "auto" is "position" where that can hold every constraint all along the demonstrations, no
        limit is about turning (a tool that goes on turning cannot stand still for it), and neither
        a limit on the position (past an obstacle a blade must turn) nor a rhythm (back to its cycle
        it must turn) meets a rule on velocities, else "shared".  Where there are coordinates alone,
        these are the same.
    length : float or None
        L (m); None is the usual one.
    usual : float
        Of the path at hand (m); 0 for one that does not move.
    demonstrations : sequence of PoseTrajectory
        That the constraints hold along, or nearly.
    returns : bool
        Whether it is a rhythm's.

    Raises
    ------
    InputError
        If the metric is none of these, or lets the rotation alone give way.
    """
    if length is None:
        length = usual if usual > 0 else 1.0
    length = _arguments.positive("metric_length", length, "m")
    space, n = system.space, system.space.linear
    turn = 1 / length**2
    if isinstance(metric, str):
        name: str = metric
        if name == "auto":
            position = not space.rotations or (
                space.is_placed
                and all(holdable_rows(system, position_only(space)))
                and not _limits_turning(system.limits)
                and not _must_steer(system, returns)
                and all(_position_holds(system.equalities, each) for each in demonstrations)
            )
            name = "position" if position else "shared"
        if name == "rotation":
            raise InputError(_SWINGS)
        if name not in _NAMED:
            raise InputError(
                f"metric is one of {', '.join(_NAMED)}, or {space.velocity_size} positive weights; "
                f"got {metric!r}"
            )
        return position_only(space) if name == "position" else (1.0,) * n + (turn,) * space.angular
    weights = _arguments.positive_weights("metric", metric, space.velocity_size)
    inverse = [1 / weight for weight in weights]
    if not any(inverse[:n]):
        raise InputError(_SWINGS)
    return (*inverse[:n], *(turn * weight for weight in inverse[n:]))


_SWINGS = (
    "the rotation alone cannot hold constraints step by step: it swings about what is asked, for "
    'ever; use metric="shared", or leave the path as it is by hold_position=True'
)
"""Why, and what does that job."""


def _position_holds(equalities: ConstraintSystem, motion: PoseTrajectory) -> bool:
    """Whether the position alone can hold all rows wherever a motion moves."""
    linear, angular = motion.step_velocities()
    speeds = np.linalg.norm(linear, axis=1)
    moving = speeds > _MOVING * speeds.mean()
    if not equalities.size or not moving.any():
        return True
    moving = np.flatnonzero(moving)[:: -(-len(moving) // _LOOKED_AT)]
    quaternions, space = motion.quaternions, equalities.space
    middles = (quaternions[1:] + quaternions[:-1]).reshape(len(linear), -1, 4)
    middles /= np.linalg.norm(middles, axis=2, keepdims=True)
    at = np.column_stack(
        [
            (motion.clock[1:] + motion.clock[:-1])[moving] / 2,
            (motion.positions[1:] + motion.positions[:-1])[moving] / 2,
            middles.reshape(len(linear), -1)[moving],
            linear[moving],
            angular[moving],
        ]
    )
    # A radian weighs what the path would turn by, were it a circle.
    scale = np.repeat([1.0, 2 * np.pi / motion.path_length], [space.linear, space.angular])
    rows = equalities.rows_at(at) * scale
    return bool(_in_position(rows, space.linear).min() >= _ROBUST)


def _in_position(rows: Floats, n: int) -> Floats:
    """Least singular value of the linear part of rows' orthonormal basis.

    Parameters
    ----------
    rows : array, shape (N, m, n + 3 b)
    n : int
        How many columns are linear.

    Returns
    -------
    array, shape (N,)
    """
    norms = np.linalg.norm(rows, axis=2, keepdims=True)
    _, sizes, basis = np.linalg.svd(rows / np.where(norms > 0, norms, 1.0), full_matrices=False)
    kept = (sizes > _SAME_ROW * sizes[:, :1]) & (sizes > 0)
    # What repeats other rows is left out; it then comes last, as zeros.
    held = np.linalg.svd((basis * kept[:, :, None])[:, :, :n], compute_uv=False)
    count = kept.sum(axis=1)
    least = np.take_along_axis(held, np.clip(count, 1, held.shape[1])[:, None] - 1, axis=1)[:, 0]
    return np.where(count == 0, 1.0, np.where(count > n, 0.0, least))


def _must_steer(system: ConstraintSystem, returns: bool) -> bool:
    """Whether a rule on velocities stands in the way of a limit on the position, or to a cycle."""
    in_the_way = "velocity" in system.equalities.row_levels
    return in_the_way and (returns or "position" in system.limits.row_levels)


def _limits_turning(limits: ConstraintSystem) -> bool:
    def found() -> bool:
        function = limits.function
        motion = [ca.SX.sym(f"m{k}", function.size1_in(k)) for k in range(function.n_in())]
        rows = ca.vertcat(limits.first_order(*motion[:5]), limits.residual(*motion))
        return bool(ca.depends_on(rows, ca.vertcat(motion[4], motion[6])))

    return limits.owned("limits turning", found)


_NAMED = ("auto", "position", "shared")
