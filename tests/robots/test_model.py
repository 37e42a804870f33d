"""The arm's model: published kinematics and limits, and other models by file."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pytest.importorskip("mujoco", reason="the extra robots is not installed")

from noslip import robots
from noslip.errors import InputError, MissingDependencyError

from .arms import published_forward

URDF = """
<robot name="two">
  <link name="base"/>
  <link name="upper"><inertial><mass value="1"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="lower"><inertial><mass value="1"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="a" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
    <limit lower="-2" upper="2" effort="40" velocity="3"/></joint>
  <joint name="b" type="revolute"><parent link="upper"/><child link="lower"/>
    <origin xyz="0.5 0 0"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="20" velocity="3"/></joint>
</robot>
"""
GRIPPER = """
<mujoco>
  <worldbody>
    <body name="arm"><joint name="turn" axis="0 0 1"/><geom size="0.05" mass="1"/>
      <body name="hand" pos="0.3 0 0"><joint name="reach" type="slide" axis="1 0 0" range="0 0.2"/>
        <geom size="0.02" mass="0.1"/><site name="tip" pos="0.1 0 0"/>
        <body name="finger"><joint name="grip" type="slide" axis="0 1 0"/>
          <geom size="0.01" mass="0.1"/></body>
      </body>
    </body>
  </worldbody>
  <actuator><position joint="grip"/></actuator>
  <keyframe><key qpos="0.4 0.1 0.02"/></keyframe>
</mujoco>
"""


def test_forward_kinematics_are_the_published_ones() -> None:
    arm = robots.panda()
    random = np.random.default_rng(0)
    postures = random.uniform(arm.lower, arm.upper, (200, 7))
    positions, rotations = arm.forward(postures)
    expected = np.array([published_forward(q) for q in postures])
    assert np.abs(positions - expected[:, :3, 3]).max() <= 1e-12
    assert np.abs(rotations.as_matrix() - expected[:, :3, :3]).max() <= 1e-12
    position, rotation = arm.forward(postures[0])
    assert np.array_equal(position, positions[0])
    assert rotation.approx_equal(rotations[0], atol=1e-14)


def test_limits_are_the_published_ones() -> None:
    arm = robots.panda()
    assert arm.lower.tolist() == [-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973]
    assert arm.upper.tolist() == [2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973]
    assert arm.velocity_limits.tolist() == [2.175] * 4 + [2.61] * 3
    assert arm.acceleration_limits.tolist() == [15, 7.5, 10, 12.5, 15, 20, 20]
    assert arm.torque_limits.tolist() == [87] * 4 + [12] * 3
    assert arm.unknown_limits == ()
    assert np.all((arm.lower < arm.home) & (arm.home < arm.upper))
    # In the home posture the edge points ahead and the tool stands upright on its work.
    assert np.allclose(arm.forward(arm.home)[1].as_matrix(), np.eye(3), atol=1e-5)


def test_the_arm_weighs_what_it_should_and_holds_itself_up() -> None:
    mujoco = pytest.importorskip("mujoco")
    arm = robots.panda()
    assert 16 <= arm.model.body_mass.sum() <= 21
    data = mujoco.MjData(arm.model)
    for q in np.random.default_rng(1).uniform(arm.lower, arm.upper, (50, 7)):
        data.qpos[:] = q
        mujoco.mj_forward(arm.model, data)
        assert np.all(np.abs(data.qfrc_bias) <= arm.torque_limits)


def test_an_urdf_is_read_with_its_ranges_and_efforts(tmp_path: Path) -> None:
    file = tmp_path / "two.urdf"
    file.write_text(URDF)
    arm = robots.load(file, tool="lower", velocity_limits=3.0)
    assert arm.joint_names == ("a", "b")
    assert arm.lower.tolist() == [-2, -1]
    assert arm.torque_limits.tolist() == [40, 20]
    assert arm.unknown_limits == ("acceleration",)
    position, rotation = arm.forward([0.3, 0.5])
    assert np.allclose(position, [0.5 * np.cos(0.3), 0.5 * np.sin(0.3), 0], atol=1e-15)
    assert rotation.approx_equal(Rotation.from_euler("z", 0.8), atol=1e-12)


def test_joints_that_do_not_lead_to_the_tool_stand_still(tmp_path: Path) -> None:
    file = tmp_path / "gripper.xml"
    file.write_text(GRIPPER)
    arm = robots.load(file, tool="tip")
    assert arm.joint_names == ("turn", "reach")
    assert arm.home.tolist() == [0.4, 0.1]
    assert arm.unknown_limits == ("position", "velocity", "acceleration", "torque")
    position, _ = arm.forward([0.0, 0.15])
    assert np.allclose(position, [0.55, 0, 0], atol=1e-15)


def test_errors_name_the_frames_that_a_model_has(tmp_path: Path) -> None:
    file = tmp_path / "gripper.xml"
    file.write_text(GRIPPER)
    with pytest.raises(InputError, match=r"'blade'; sites: tip; bodies: arm, hand, finger"):
        robots.load(file, tool="blade")
    with pytest.raises(InputError, match="no such file"):
        robots.load(tmp_path / "none.xml", tool="tip")
    (tmp_path / "bad.xml").write_text("<mujoco><worldbody><body></mujoco>")
    with pytest.raises(InputError, match=r"bad\.xml: not understood"):
        robots.load(tmp_path / "bad.xml", tool="tip")
    with pytest.raises(InputError, match="velocity_limits must be 2 numbers"):
        robots.load(file, tool="tip", velocity_limits=[1, 2, 3])
    with pytest.raises(InputError, match="must be positive"):
        robots.load(file, tool="tip", velocity_limits=[1, -2])
    with pytest.raises(InputError, match="name the tool"):
        robots.named("panda", model=file)
    with pytest.raises(InputError, match="'ur5' is not known; there is panda"):
        robots.named("ur5")


@pytest.mark.parametrize(
    ("joint", "message"), [("<freejoint/>", "fixed base"), ("", "no joint moves")]
)
def test_a_base_that_flies_or_no_joint_at_all_is_refused(
    tmp_path: Path, joint: str, message: str
) -> None:
    file = tmp_path / "base.xml"
    body = f'<body name="b">{joint}<geom size="1" mass="1"/></body>'
    file.write_text(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    with pytest.raises(InputError, match=message):
        robots.load(file, tool="b")


@pytest.mark.parametrize("q", [[0.0] * 6, [np.nan] * 7, [[[0.0] * 7]]])
def test_joint_positions_of_another_shape_are_refused(q: object) -> None:
    with pytest.raises(InputError, match="joint positions must be 7 finite numbers"):
        robots.panda().forward(q)  # type: ignore[arg-type]


def test_without_mujoco_the_message_says_how_to_install_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(MissingDependencyError, match=r"pip install 'noslip\[robots\]'"):
        robots.panda()


def test_a_table_stands_where_it_is_asked_for() -> None:
    geom = robots.panda(table=0.1).model.geom("table")
    assert geom.pos[2] + geom.size[2] == pytest.approx(0.1)
    names = robots.panda(table=None).model
    assert "table" not in [names.geom(k).name for k in range(names.ngeom)]
