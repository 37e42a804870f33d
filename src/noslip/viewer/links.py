"""An arm of which only the joints are known: rods from joint to joint."""

from __future__ import annotations

from dataclasses import replace
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from noslip import robots
from noslip._typing import Floats
from noslip.chain import Chain
from noslip.trajectory import PoseTrajectory
from noslip.viewer.arm import Arm
from noslip.viewer.tool import HANDLE, Part, add_mesh

if TYPE_CHECKING:
    import viser

WIDTH = 6.0
"""Of a link, in pixels: seen at any size of an arm."""
BALL = 0.012
"""Radius of a joint, over the arm's length."""


class Links:
    """A chain's joints along a motion; a :class:`~noslip.viewer.drawing.Follower`.

    Parameters
    ----------
    chain : Chain
    joint_positions : array, shape (N, n)
        At the samples of the motion that it follows (rad, m).

    Attributes
    ----------
    corners : array, shape (N, n + 2, 3)
        The base, each joint and the tool, in the world (m).
    """

    def __init__(self, chain: Chain, joint_positions: Floats) -> None:
        count = len(joint_positions)
        parts = [replace(chain, joints=chain.joints[: k + 1]) for k in range(chain.size)]
        joints = [
            replace(part, position=(0.0, 0.0, 0.0)).forward(joint_positions[:, : k + 1])[0]
            for k, part in enumerate(parts)
        ]
        tool = chain.forward(joint_positions)[0]
        self.corners: Floats = np.stack([np.zeros((count, 3)), *joints, tool], axis=1)
        self._lines: Any = None
        self._balls: list[Any] = []

    @property
    def points(self) -> Floats:
        """Where it is at the beginning and at the end, world frame (m); the base comes first."""
        return np.concatenate([self.corners[0], self.corners[-1]])

    def add(self, scene: viser.SceneApi, node: str) -> None:
        """Draw it once, as it is at the beginning."""
        corners = self.corners[0]
        self._lines = scene.add_line_segments(
            f"{node}/links",
            _segments(corners),
            HANDLE,
            thickness=WIDTH,
            thickness_units="screen",
        )
        length = float(np.linalg.norm(np.diff(corners, axis=0), axis=1).sum())
        made = trimesh.creation.icosphere(subdivisions=2, radius=BALL * length)
        ball = Part(np.array(made.vertices), np.array(made.faces), HANDLE)
        self._balls = [
            add_mesh(scene, f"{node}/joint_{k}", ball, HANDLE) for k in range(len(corners) - 1)
        ]
        self._move(corners)

    def show(self, motion: PoseTrajectory, sample: int) -> None:
        """Move it to where its joints are at a sample."""
        self._move(self.corners[sample])

    def _move(self, corners: Floats) -> None:
        self._lines.points = _segments(corners)
        for ball, corner in zip(self._balls, corners, strict=False):
            ball.position = corner


def carrier_of(chain: Chain, joint_positions: Floats) -> Arm | Links:
    """Return what a chain looks like: its robot, where that is this library's own, else rods."""
    if chain.name == "panda" and find_spec("mujoco") is not None:
        robot = robots.panda(table=None)
        if robots.chain(robot) == chain:
            still = robots.Placement(np.zeros(3), Rotation.identity())
            return Arm(robot, joint_positions, still)
    return Links(chain, joint_positions)


def _segments(corners: Floats) -> Any:
    return np.stack([corners[:-1], corners[1:]], axis=1).astype(np.float32)
