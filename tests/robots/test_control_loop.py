"""A controller that commands a simulated arm with joint friction, late and noisy encoders, pushed.

Torques follow the controller's poses by inverse kinematics and computed torque; what it is told of
the tool is found from the encoders by the textbook's kinematics.
"""

from __future__ import annotations

import copy
from collections import deque
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pytest.importorskip("mujoco", reason="the extra robots is not installed")
pytest.importorskip("daqp", reason="the extra robots is not installed")

import mujoco

import noslip as ns
from measures import slip
from noslip import PoseTrajectory, robots
from noslip._typing import Floats
from noslip.robots.kinematics import InverseKinematics

from .arms import arc, published_forward, published_motion

pytestmark = pytest.mark.slow

H = 1e-3
DELAY = 5
"""Cycles."""
FRICTION = np.array([1.0, 1.0, 1.0, 1.0, 0.3, 0.3, 0.3])
"""Coulomb's, of each joint (N m); nobody compensates it."""
ENCODER, RATE = 2e-5, 2e-3
"""Standard deviations of a measured joint (rad) and its rate (rad/s)."""
BANDWIDTH = 40.0
"""Of the arm's own control (rad/s)."""
FORCE, PUSHED = 25.0, (0.7, 0.9)
"""Of the hand, sideways (N), and when (s)."""
PLACE = np.array([0.4, 0.0, 0.3])


@dataclass
class Run:
    """What came of it, a row a cycle."""

    commanded: PoseTrajectory
    executed: PoseTrajectory
    torques: Floats
    done: float
    limits: Floats

    @property
    def slip(self) -> Floats:
        """Sideways speed of the executed tool (m/s)."""
        return slip(self.executed)


@pytest.fixture(scope="module")
def dmp() -> ns.ConstrainedDMP:
    given = arc(duration=2.0)
    return ns.learn(
        PoseTrajectory(given.times, given.positions + PLACE, given.rotations), ns.Blade()
    )


@pytest.fixture(scope="module")
def start(dmp: ns.ConstrainedDMP) -> Floats:
    """Joints with which the tool is where the motion begins."""
    robot = robots.panda()
    nowhere = robots.Placement(np.zeros(3), Rotation.identity())
    motion = dmp.rollout(time_step=0.01)
    tracked = robots.track(robot, motion, placement=nowhere, start=robot.home, time_step=0.01)
    return tracked.joint_positions[0]


def controlled(
    dmp: ns.ConstrainedDMP, start: Floats, *, force: float, feedback: bool = True, **options: bool
) -> Run:
    """Run the arm until the controller is done, and half a second longer."""
    robot, random = robots.panda(), np.random.default_rng(0)
    controller = ns.Controller(dmp, time_step=H, **options)
    believed = mujoco.MjData(robot.model)
    model = copy.copy(robot.model)
    model.dof_frictionloss[:] = FRICTION
    model.opt.timestep = H / 4
    data = mujoco.MjData(model)
    data.qpos[:] = start
    mujoco.mj_forward(model, data)
    tool = model.site_bodyid[robot.site]
    ik = InverseKinematics(robot)
    ik.move(start)
    wanted: deque[tuple[Floats, Floats]] = deque([(start, np.zeros(7))] * (DELAY + 1), DELAY + 1)
    seen: deque[tuple[Floats, Floats]] = deque([(start, np.zeros(7))] * (DELAY + 1), DELAY + 1)
    poses, joints, torques, done = [], [], [], np.nan
    for k in range(round(3 * dmp.duration / H)):
        time = k * H
        noise = random.normal(size=(2, 7))
        seen.append((data.qpos + ENCODER * noise[0], data.qvel + RATE * noise[1]))
        q, dq = seen[0]
        measured = None
        if feedback:
            T = published_forward(q)
            measured = T[:3, 3], Rotation.from_matrix(T[:3, :3])
        state = controller.step(measured)
        poses.append((state.position.copy(), state.quaternion.copy()))
        joints.append(data.qpos.copy())
        if controller.done and np.isnan(done):
            done = time
        if time > done + 0.5:
            break
        # The arm's own control.
        before = wanted[-1]
        here = ik.position.copy(), ik.quaternion.copy()
        solved = ik.step(*before, here, poses[-1], time + H, H)
        assert solved is not None
        wanted.append((solved.positions, solved.velocities))
        acceleration = (solved.velocities - before[1]) / H
        believed.qpos[:], believed.qvel[:] = q, dq
        mujoco.mj_fwdPosition(robot.model, believed)
        mujoco.mj_fwdVelocity(robot.model, believed)
        inertia = np.zeros((7, 7))
        mujoco.mj_fullM(robot.model, believed, inertia)
        pull = BANDWIDTH**2 * (wanted[0][0] - q) + 2 * BANDWIDTH * (wanted[0][1] - dq)
        torque = inertia @ (acceleration + pull) + believed.qfrc_bias - believed.qfrc_passive
        torques.append(np.clip(torque, -robot.torque_limits, robot.torque_limits))
        data.qfrc_applied[:] = torques[-1]
        pushes = PUSHED[0] <= time < PUSHED[1]
        lateral = published_forward(data.qpos)[:3, 1]
        data.xfrc_applied[tool, :3] = force * pushes * lateral
        mujoco.mj_step(model, data, 4)
    times = H * np.arange(len(poses))
    turned = Rotation.from_quat([q for _, q in poses], scalar_first=True)
    commanded = PoseTrajectory(times, np.array([p for p, _ in poses]), turned)
    executed = published_motion(times, np.array(joints))
    return Run(commanded, executed, np.array(torques), done, robot.torque_limits)


@pytest.fixture(scope="module")
def plain(dmp: ns.ConstrainedDMP, start: Floats) -> Run:
    """The same arm, nothing measured, nobody pushing."""
    return controlled(dmp, start, force=0.0, feedback=False)


def way(run: Run, during: tuple[float, float] | None = None) -> float:
    """Way that the tool slipped sideways, but while a hand acts and until it is back (m)."""
    begin, end = during or (np.inf, np.inf)
    times = run.executed.times[1:]
    free = (times < begin) | (times > end + 0.3)
    return float(np.abs(run.slip[free]).sum() * H)


def assert_well(run: Run, plain: Run, dmp: ns.ConstrainedDMP) -> None:
    """What holds pushed or not."""
    assert np.abs(slip(run.commanded)).max() <= 1e-12
    assert np.all(np.abs(run.torques).max(axis=0) <= 0.5 * run.limits)
    # Friction lets it slip by 2 mm on its way of 0.12 m; feedback adds nothing.
    assert way(run, PUSHED) <= 1.02 * way(plain) <= 2.5e-3
    off = run.executed.positions[-1] - dmp.goal_position
    assert np.linalg.norm(off) <= 4e-3 * dmp.rollout().path_length


def test_encoders_friction_and_delay_change_nothing_of_what_is_commanded(
    dmp: ns.ConstrainedDMP, start: Floats, plain: Run
) -> None:
    run = controlled(dmp, start, force=0.0)
    assert_well(run, plain, dmp)
    assert run.done <= 1.03 * dmp.duration
    same = len(plain.commanded)
    assert np.abs(run.commanded.positions[:same] - plain.commanded.positions).max() <= 1e-4


@pytest.mark.parametrize("follows", [False, True])
def test_a_push_costs_time_but_no_slip(
    dmp: ns.ConstrainedDMP, start: Floats, plain: Run, follows: bool
) -> None:
    run = controlled(dmp, start, force=FORCE, follows=follows)
    off = np.linalg.norm(run.executed.positions - run.commanded.positions, axis=1)
    assert off.max() > 5e-3, "nothing was pushed"
    assert_well(run, plain, dmp)
    assert 1.03 * dmp.duration < run.done <= 1.25 * dmp.duration
