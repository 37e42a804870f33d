"""Chains of joints from models in files: where MuJoCo has the tool, and how it moves."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

pytest.importorskip("mujoco", reason="the extra robots is not installed")

import mujoco

import noslip as ns
from noslip import robots
from noslip._typing import Floats
from noslip.chain import Chain, Joint
from noslip.errors import InputError
from noslip.robots.model import _robot

from .arms import published_forward

SCARA = """
<mujoco>
  <compiler angle="degree"/>
  <custom><numeric name="velocity_limits" data="2 3 0.5 6"/></custom>
  <worldbody>
    <body name="column" pos="0.1 -0.2 0.4" euler="0 0 30">
      <joint name="shoulder" axis="0 0 1" pos="0.02 0.01 0" range="-120 120" ref="20"/>
      <geom size="0.05" mass="1"/>
      <body name="arm" pos="0.3 0 0.05" euler="3 -4 0">
        <joint name="elbow" axis="0 0.1 -1" range="-150 150"/><geom size="0.05" mass="1"/>
        <body name="hand" pos="0.25 0 0" quat="0.3 0.9 0.1 -0.2">
          <joint name="lift" type="slide" axis="0 1 1" ref="0.03" range="-0.1 0.2"/>
          <joint name="wrist" axis="1 2 -3" pos="0 0 0.07"/>
          <geom size="0.02" mass="0.1"/>
          <body name="bracket" pos="0.01 0 -0.05" euler="0 90 0">
            <site name="tip" pos="0.02 0.01 -0.1" euler="10 20 30"/>
            <body name="finger">
              <joint name="grip" type="slide"/><geom size="0.01" mass="0.1"/>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <keyframe><key qpos="0.3 0.2 0.1 0.4 0.01"/></keyframe>
</mujoco>
"""
INERTIA = """<inertial><mass value="1"/>
  <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>"""
GANTRY = f"""
<robot name="gantry">
  <link name="base"/>
  <link name="rail">{INERTIA}</link><link name="head">{INERTIA}</link>
  <link name="plate">{INERTIA}</link><link name="knife">{INERTIA}</link>
  <joint name="along" type="prismatic"><parent link="base"/><child link="rail"/>
    <origin xyz="0 0.2 1.1" rpy="0 0 1.5708"/><axis xyz="1 0 0"/>
    <limit lower="-0.5" upper="0.5" effort="40" velocity="3"/></joint>
  <joint name="down" type="prismatic"><parent link="rail"/><child link="head"/>
    <origin xyz="0.1 0 0" rpy="0.2 0 0"/><axis xyz="0 0.6 -0.8"/>
    <limit lower="0" upper="0.3" effort="40" velocity="3"/></joint>
  <joint name="mount" type="fixed"><parent link="head"/><child link="plate"/>
    <origin xyz="0 0.03 0" rpy="3.14159 0 0.4"/></joint>
  <joint name="turn" type="continuous"><parent link="plate"/><child link="knife"/>
    <origin xyz="0 0 0.07" rpy="0 -0.1 0"/><axis xyz="0 0 1"/></joint>
</robot>
"""
ARM = robots.panda()
CHAIN = robots.chain(ARM)


def moved(arm: robots.Robot, q: Floats) -> tuple[Floats, Floats, Floats]:
    """The tool's position, its rotation's matrix and its Jacobian, as MuJoCo has them."""
    data, J = mujoco.MjData(arm.model), np.zeros((6, arm.size))
    data.qpos[:] = q
    mujoco.mj_kinematics(arm.model, data)
    mujoco.mj_comPos(arm.model, data)
    mujoco.mj_jacSite(arm.model, data, J[:3], J[3:], arm.site)
    return data.site_xpos[arm.site], data.site_xmat[arm.site].reshape(3, 3), J


def assert_same(arm: robots.Robot, chain: Chain, postures: Floats) -> None:
    symbols = ca.SX.sym("q", chain.size)
    jacobian = ca.Function("J", [symbols], [chain.jacobian(symbols)])
    positions, rotations = chain.forward(postures)
    for q, position, rotation in zip(postures, positions, rotations, strict=True):
        expected = moved(arm, q)
        assert np.abs(position - expected[0]).max() <= 1e-12
        assert np.abs(rotation.as_matrix() - expected[1]).max() <= 1e-12
        assert np.abs(np.array(jacobian(q)) - expected[2]).max() <= 1e-12


def postures(arm: robots.Robot, seed: int, count: int = 10) -> Floats:
    lower = np.where(np.isfinite(arm.lower), arm.lower, -4.0)
    upper = np.where(np.isfinite(arm.upper), arm.upper, 4.0)
    return np.random.default_rng(seed).uniform(lower, upper, (count, arm.size))


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=15)
def test_the_arm_is_where_mujoco_and_its_manufacturer_have_it(seed: int) -> None:
    several = postures(ARM, seed)
    assert_same(ARM, CHAIN, several)
    expected = np.array([published_forward(q) for q in several])
    assert np.abs(CHAIN.forward(several)[0] - expected[:, :3, 3]).max() <= 1e-12


@pytest.mark.parametrize(
    ("name", "text", "tool"),
    [
        ("scara.xml", SCARA, "tip"),
        ("scara.xml", SCARA, "bracket"),
        ("gantry.urdf", GANTRY, "knife"),
    ],
)
def test_models_in_files_are_as_mujoco_reads_them(
    tmp_path: Path, name: str, text: str, tool: str
) -> None:
    """Slides, oblique axes, positions of reference, several joints of a body, fixed ones."""
    file = tmp_path / name
    file.write_text(text)
    arm = robots.load(file, tool=tool)
    chain = robots.chain(file, tool=tool)
    assert chain == robots.chain(arm)
    assert chain.joint_names == arm.joint_names
    assert_same(arm, chain, postures(arm, 0, 30))
    assert np.array_equal(chain.lower, arm.lower)
    assert np.array_equal(chain.upper, arm.upper)
    assert np.array_equal(chain.velocity_limits, arm.velocity_limits)


numbers = st.one_of(st.sampled_from([0.0, 1.0, -1.0, 0.5]), st.floats(-1, 1))
triples = st.tuples(numbers, numbers, numbers)
directions = triples.filter(lambda v: np.linalg.norm(v) > 0.01)
joints = st.tuples(st.sampled_from(["hinge", "slide"]), directions, triples, numbers)
bodies = st.tuples(triples, triples, st.lists(joints, max_size=2))


def listed(values: Any) -> str:
    return " ".join(map(repr, values))


@given(st.lists(bodies, min_size=1, max_size=4), st.integers(0, 2**32 - 1))
@settings(max_examples=20)
def test_any_tree_of_bodies_is_as_mujoco_has_it(several: list[Any], seed: int) -> None:
    text, count = '<site name="tip" pos="0.1 0.2 0.3" euler="0.1 0.2 0.3"/>', 0
    for k, (place, turn, held) in enumerate(several):
        inside = '<geom size="0.1" mass="1"/>'
        for kind, axis, anchor, ref in held:
            count += 1
            inside += (
                # Without armature, joints along one axis are a singular matrix to MuJoCo.
                f'<joint name="j{count}" type="{kind}" armature="1" axis="{listed(axis)}" '
                f'pos="{listed(anchor)}" ref="{ref!r}"/>'
            )
        text = (
            f'<body name="b{k}" pos="{listed(place)}" euler="{listed(turn)}">{inside}{text}</body>'
        )
    model = f'<mujoco><compiler angle="radian"/><worldbody>{text}</worldbody></mujoco>'
    if not count:
        with pytest.raises(InputError, match="no joint moves"):
            arm_of(model)
        return
    arm = arm_of(model)
    assert_same(arm, robots.chain(arm), postures(arm, seed, 3))


def arm_of(text: str) -> robots.Robot:
    return _robot("model", mujoco.MjSpec.from_string(text), "tip", None)


def test_some_of_the_joints_move_and_the_others_stand_as_at_home() -> None:
    last = robots.chain("panda", joints=["joint6", "joint5"], held={"joint1": 0.7})
    assert last.joint_names == ("joint5", "joint6")
    q = ARM.home.copy()
    q[[0, 4, 5]] = 0.7, 0.3, 2.0
    position, rotation = last.forward([0.3, 2.0])
    expected = moved(ARM, q)
    assert np.abs(position - expected[0]).max() <= 1e-12
    assert np.abs(rotation.as_matrix() - expected[1]).max() <= 1e-12
    assert robots.chain(held={"joint7": 0.1}).joint_names == ARM.joint_names[:6]


def swept(seed: int) -> tuple[ns.PoseTrajectory, Floats]:
    """A motion of the tool through postures within the joints' ranges, and its joints."""
    random = np.random.default_rng(seed)
    middle, half = (ARM.upper + ARM.lower) / 2, (ARM.upper - ARM.lower) / 2
    begin, bend = middle + 0.5 * half * random.uniform(-1, 1, (2, 7)), random.uniform(-1, 1, 7)
    share = np.linspace(0, 1, 40)[:, None]
    joints = begin[0] + 0.3 * share * (begin[1] - begin[0]) + 0.1 * bend * np.sin(3 * share)
    return CHAIN.poses(share[:, 0], joints), joints


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=8)
def test_inverse_kinematics_reach_each_pose_by_the_nearest_joints(seed: int) -> None:
    motion, joints = swept(seed)
    near = joints + 0.02 * np.random.default_rng(seed).uniform(-1, 1, joints.shape)
    found = CHAIN.inverse(motion, near)
    reached = CHAIN.poses(motion.times, found)
    assert np.abs(reached.positions - motion.positions).max() <= 2e-12
    assert (reached.rotations * motion.rotations.inv()).magnitude().max() <= 2e-12
    for q, wished in zip(found, near, strict=True):
        # Nowhere along what leaves the tool where it is does it get nearer.
        free = np.linalg.svd(moved(ARM, q)[2])[2][6:]
        assert np.abs(free @ (wished - q)).max() <= 1e-6


def test_from_one_posture_joints_follow_without_a_jump() -> None:
    motion, joints = swept(7)
    found = CHAIN.inverse(motion, joints[0] + 1e-3)
    reached = CHAIN.poses(motion.times, found)
    assert np.abs(reached.positions - motion.positions).max() <= 2e-12
    assert np.abs(np.diff(found, axis=0)).max() <= 2 * np.abs(np.diff(joints, axis=0)).max()


def test_a_motion_out_of_reach_is_refused() -> None:
    motion, joints = swept(1)
    far = robots.Placement(np.array([0.0, 0.0, 3.0]), Rotation.identity()).apply(motion)
    with pytest.raises(InputError, match=r"no joints were found .* at 0 s \(sample 0\): .* left"):
        CHAIN.inverse(far, joints)
    with pytest.raises(InputError, match="near has 3 rows for 40 samples"):
        CHAIN.inverse(motion, joints[:3])


def test_expressions_are_short() -> None:
    """Of the arm, axes that are parallel or meet leave less than half of the general products."""
    q = ca.SX.sym("q", 7)

    def count(*found: Any) -> int:
        return int(ca.Function("f", [q], ca.cse(list(found))).n_instructions())

    pose = CHAIN.pose(q)
    oblique = [
        Joint(j.name, "hinge", (0.1, 0.2, 0.3), (0.1, 0.2, 0.3), j.rotation) for j in CHAIN.joints
    ]
    assert count(*pose) < 0.5 * count(*Chain(oblique, (0.1, 0.2, 0.3)).pose(q))
    derivative = [ca.jacobian(each, q) for each in pose]
    assert count(*pose, CHAIN.jacobian(q)) < 0.5 * count(*pose, *derivative)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda: robots.chain("ur5"), "robot 'ur5' is not known"),
        (lambda: robots.chain("none.xml"), "name the tool"),
        (lambda: robots.chain("none.xml", tool="tip"), "no such file"),
        (lambda: robots.chain(joints=["elbow"]), "'elbow' does not lead to the tool; there are"),
        (lambda: robots.chain(joints=["joint1"], held={"joint1": 0.0}), "both move and be held"),
        (lambda: robots.chain(held={"elbow": 1.0}), "no joint is called 'elbow'"),
        (lambda: robots.chain(joints=[]), "1 to 64 joints, got 0"),
    ],
)
def test_what_is_no_chain_of_a_robot_is_refused(wrong: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        wrong()
