"""Inverse kinematics of a free body with an equality: how mink and pink hold a constraint.

A frame that stands ahead of the tool follows a target; the twist that leads it there is the nearest
of those for which nothing moves along the constraint's axes (a quadratic program, solved by DAQP).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

Pose = tuple[np.ndarray, Rotation]
Solve = Callable[[Pose, Pose], Pose]
"""(where the tool is, where the frame ahead of it is to be) -> where the tool is a step later."""


@dataclass(frozen=True)
class Follower:
    """What is solved at each step.

    Attributes
    ----------
    body, world : sequence of axes
        Along which the tool's point does not move: of the tool, of the world.
    ahead : array, shape (3,)
        Where the frame that follows stands in the tool (m).
    turning : float
        Cost of the orientation over that of the position (m / rad).
    gain : float
        Share of the error that a step makes good.
    step : float
        Seconds.
    """

    body: Sequence[Sequence[float]]
    world: Sequence[Sequence[float]]
    ahead: np.ndarray
    turning: float
    gain: float
    step: float


def solver(library: str, follower: Follower) -> Solve:
    """Return the step of ``"mink"`` or ``"pink"``."""
    return {"mink": _mink, "pink": _pink}[library](follower)


def _mink(asked: Follower) -> Solve:
    import mink
    import mujoco

    x, y, z = asked.ahead
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body name='tool'><freejoint/><geom size='0.01' mass='1'/>"
        f"<site name='ahead' pos='{x} {y} {z}'/></body></worldbody></mujoco>"
    )
    configuration = mink.Configuration(model)
    task = mink.FrameTask("ahead", "site", 1.0, asked.turning, gain=asked.gain)

    class Held(mink.Task):
        """No motion along some axes; a free joint moves in the world's and turns in its own."""

        def __init__(self) -> None:
            super().__init__(cost=np.ones(len(asked.body) + len(asked.world)))

        def compute_error(self, configuration: Any) -> np.ndarray:
            return np.zeros(len(self.cost))

        def compute_jacobian(self, configuration: Any) -> np.ndarray:
            turn = Rotation.from_quat(configuration.q[3:7], scalar_first=True)
            rows = np.vstack([turn.apply(asked.body), *np.reshape(asked.world, (-1, 1, 3))])
            return np.hstack([rows, np.zeros_like(rows)])

    held, step = [Held()], asked.step

    def solve(here: Pose, wanted: Pose) -> Pose:
        configuration.update(np.r_[here[0], here[1].as_quat(scalar_first=True)])
        task.set_target(mink.SE3(np.r_[wanted[1].as_quat(scalar_first=True), wanted[0]]))
        twist = mink.solve_ik(configuration, [task], step, "daqp", limits=[], constraints=held)
        configuration.integrate_inplace(twist, step)
        q = configuration.q
        return q[:3].copy(), Rotation.from_quat(q[3:7], scalar_first=True)

    return solve


def _pink(asked: Follower) -> Solve:
    import pink
    import pinocchio

    model = pinocchio.Model()
    joint = model.addJoint(0, pinocchio.JointModelFreeFlyer(), pinocchio.SE3.Identity(), "tool")
    model.appendBodyToJoint(joint, pinocchio.Inertia.Random(), pinocchio.SE3.Identity())
    offset = pinocchio.SE3(np.eye(3), np.asarray(asked.ahead, dtype=float))
    kind = pinocchio.FrameType.OP_FRAME
    model.addFrame(pinocchio.Frame("ahead", joint, 0, offset, kind))
    data = model.createData()
    task = pink.tasks.FrameTask("ahead", 1.0, asked.turning, gain=asked.gain)

    class Held(pink.tasks.Task):
        """No motion along some axes; a free flyer's twist is the body's."""

        def compute_error(self, configuration: Any) -> np.ndarray:
            return np.zeros(len(asked.body) + len(asked.world))

        def compute_jacobian(self, configuration: Any) -> np.ndarray:
            turn = Rotation.from_quat(configuration.q[3:7])
            world = np.reshape(asked.world, (-1, 3))
            rows = np.vstack([asked.body, turn.inv().apply(world) if len(world) else world])
            return np.hstack([rows, np.zeros_like(rows)])

        def __repr__(self) -> str:
            return "Held()"

    held, step = [Held(cost=1.0)], asked.step

    def solve(here: Pose, wanted: Pose) -> Pose:
        configuration = pink.Configuration(model, data, np.r_[here[0], here[1].as_quat()])
        task.set_target(pinocchio.SE3(wanted[1].as_matrix(), wanted[0]))
        twist = pink.solve_ik(configuration, [task], step, "daqp", limits=[], constraints=held)
        configuration.integrate_inplace(twist, step)
        q = configuration.q
        return q[:3].copy(), Rotation.from_quat(q[3:7])

    return solve
