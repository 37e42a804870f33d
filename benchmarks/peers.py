"""movement-primitives, the field's usual library, behind two functions."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.example import BASIS_FUNCTIONS
from noslip import PoseTrajectory

try:
    from movement_primitives.dmp import CartesianDMP
    from movement_primitives.dmp import _cartesian_dmp as _inside

    MISSING = ""
except ImportError as error:
    CartesianDMP = _inside = None
    MISSING = f"movement-primitives is left out: {error}"


def step_functions() -> str:
    """Say which of its step functions run by default, for position and orientation."""
    return (
        f"{_inside.DEFAULT_DMP_STEP_FUNCTION} (position), "
        f"{_inside.DEFAULT_CARTESIAN_DMP_STEP_FUNCTION} (orientation)"
    )


def imitation(demonstration: PoseTrajectory) -> tuple[np.ndarray, np.ndarray]:
    """Return times (N,) and poses (N, 7) as ``imitate`` wants them."""
    poses = np.hstack([demonstration.positions, demonstration.quaternions])
    return demonstration.times - demonstration.times[0], poses


def fit(
    times: np.ndarray,
    poses: np.ndarray,
    basis_functions: int = BASIS_FUNCTIONS,
    *,
    smooth_scaling: bool = False,
) -> Any:
    """Fit its pose primitive, no constraint; its own defaults in all else.

    It integrates with the sampling step; for 1000 samples that is its default, 1 ms.
    """
    step = times[-1] / (len(times) - 1)
    dmp = CartesianDMP(
        execution_time=times[-1],
        dt=step,
        int_dt=step,
        n_weights_per_dim=basis_functions,
        smooth_scaling=smooth_scaling,
    )
    dmp.imitate(times, poses)
    return dmp


def rollout(dmp: Any) -> PoseTrajectory:
    """Return its rollout as a trajectory."""
    times, poses = dmp.open_loop()
    return PoseTrajectory(
        times=times,
        positions=poses[:, :3],
        rotations=Rotation.from_quat(poses[:, 3:], scalar_first=True),
        name="movement-primitives",
    )
