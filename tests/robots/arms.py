"""What tests of arms share: motions to follow, and kinematics of their own."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from motions import eased
from noslip import PoseTrajectory
from noslip._typing import Floats

# Modified Denavit-Hartenberg rows of the arm as its manufacturer publishes them: a, d, alpha.
PUBLISHED = (
    (0.0, 0.333, 0.0),
    (0.0, 0.0, -np.pi / 2),
    (0.0, 0.316, np.pi / 2),
    (0.0825, 0.0, np.pi / 2),
    (-0.0825, 0.384, -np.pi / 2),
    (0.0, 0.0, np.pi / 2),
    (0.088, 0.0, np.pi / 2),
)
FLANGE = 0.107
SCALPEL = 0.18


def transform(rotation: Floats, translation: tuple[float, float, float]) -> Floats:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation, translation
    return T


def published_forward(q: Floats) -> Floats:
    """Pose of the scalpel's tip, 4 x 4, by the textbook's product of link transforms."""
    T = np.eye(4)
    for angle, (a, d, alpha) in zip(q, PUBLISHED, strict=True):
        twist = Rotation.from_euler("x", alpha).as_matrix()
        turn = Rotation.from_euler("z", angle).as_matrix()
        T = T @ transform(twist, (a, 0, 0)) @ transform(turn, (0, 0, d))
    mounted = Rotation.from_euler("ZX", [-np.pi / 4, np.pi]).as_matrix()
    return np.asarray(T @ transform(mounted, (0, 0, FLANGE + SCALPEL)))


def published_motion(times: Floats, joints: Floats) -> PoseTrajectory:
    poses = np.array([published_forward(q) for q in joints])
    return PoseTrajectory(times, poses[:, :3, 3], Rotation.from_matrix(poses[:, :3, :3]))


def arc(
    *, duration: float = 2.0, step: float = 1e-3, radius: float = 0.12, angle: float = 1.0
) -> PoseTrajectory:
    """A blade along an arc from the origin, z up, without slip in any step."""
    count = round(duration / step) + 1
    heading = angle * eased(np.linspace(0, 1, count))
    # Each step goes along the edge as it stands in the step's middle.
    middle = (heading[1:] + heading[:-1]) / 2
    ahead = Rotation.from_euler("z", middle[:, None]).apply([1.0, 0, 0])
    positions = np.vstack(
        [np.zeros(3), np.cumsum(ahead * radius * np.diff(heading)[:, None], axis=0)]
    )
    held = Rotation.from_euler("z", heading[:, None])
    return PoseTrajectory(step * np.arange(count), positions, held, name="arc")


def line(toward: Floats, *, duration: float = 2.0, step: float = 2e-3) -> PoseTrajectory:
    """Straight from the origin, without turning; x ahead in the direction of the way."""
    count = round(duration / step) + 1
    positions = eased(np.linspace(0, 1, count))[:, None] * np.asarray(toward, dtype=float)
    heading = np.arctan2(toward[1], toward[0])
    turns = Rotation.from_euler("z", np.full((count, 1), heading))
    return PoseTrajectory(step * np.arange(count), positions, turns, name="line")
