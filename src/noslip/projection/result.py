"""What a trajectory projection comes to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from noslip._typing import Floats
from noslip._values import Value


@dataclass(frozen=True, eq=False)
class ProjectedTrajectory(Value):
    """Result of a trajectory projection.

    Attributes
    ----------
    trajectory : PoseTrajectory or Trajectory
        As the reference.
    turns : array, shape (N, 3 b)
        ``Log(R R_ref^T)``, world frame (rad).
    converged : bool
    iterations : int
    residual : float
        Largest residual over all samples and rows of the equalities, in the constraints' own units.
    residuals : array, shape (N, m)
        Of the equalities.
    multipliers : array, shape (N, m + k)
        Of equalities, then limits.
    margins : array, shape (N, k)
        Of the limits; infinite where they do not apply (no step, no acceleration).
    backing : int
        Stretches in which the demonstration moves backwards, left so (see ``heading``).
    smoothing : float
        mu_R with which it converged.
    left_out : tuple of str
        Soft limits with which it did not converge, and which it therefore does not heed.
    """

    trajectory: Any
    turns: Floats
    converged: bool
    iterations: int
    residual: float
    residuals: Floats
    multipliers: Floats
    margins: Floats
    backing: int
    smoothing: float
    left_out: tuple[str, ...] = ()
