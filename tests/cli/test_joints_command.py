"""Joints of a robot, vectors and channels in the commands."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import noslip as ns
from kinds import joint_cut
from motions import planar_cut
from noslip.result_table import read_results

pytest.importorskip("mujoco")

LENGTHS = 0.0, 0.4, 0.3, 0.2
ARM_MODEL = (
    '<mujoco><compiler angle="radian"/><worldbody>'
    + "".join(
        f'<body name="l{k}" pos="{x} 0 0"><joint name="j{k}" range="-2.9 2.9" axis="0 0 1"/>'
        '<geom size="0.01" mass="0.1"/>'
        for k, x in enumerate(LENGTHS)
    )
    + '<site name="knife" pos="0.1 0 0"/>'
    + len(LENGTHS) * "</body>"
    + "</worldbody></mujoco>"
)


@pytest.fixture
def robot(tmp_path: Path) -> tuple[str, ...]:
    """Options that name the arm of kinds.py."""
    model = tmp_path / "arm.xml"
    model.write_text(ARM_MODEL)
    return "--robot", str(model), "--robot-tool", "knife"


def in_degrees(joints: ns.Trajectory, path: Path) -> Path:
    """A table of joints whose names have units, as arms write them."""
    degrees = np.degrees(joints.values)
    units = ["deg"] * len(joints.names)
    return ns.Trajectory(joints.times, degrees, joints.names, units=units).to_csv(path)


def test_joints_are_found_by_names_with_units(noslip, robot, tmp_path):
    joints, out = joint_cut(), tmp_path / "poses.csv"
    for file in (joints.to_csv(tmp_path / "rad.csv"), in_degrees(joints, tmp_path / "deg.csv")):
        assert "j0 [" in file.read_text().splitlines()[0]
        assert noslip("convert", file, *robot, "--out", out).code == 0
        read = ns.load_demonstrations(out)[0]
        np.testing.assert_allclose(read.positions, joints.tool.positions, rtol=0, atol=1e-12)


def test_their_limits_have_a_name(noslip, robot, tmp_path):
    file = joint_cut().to_csv(tmp_path / "joints.csv")
    asked = noslip("check", file, *robot, "--values", "--constraint", "joint-limits", "--json")
    assert asked.code == 0, asked.err
    assert "joint position limits" in asked.out
    narrow = "joint-limits(lower=[-9, -9, -9, -9], upper=[9, 9, 0, 9])"
    assert noslip("check", file, *robot, "--values", "--constraint", narrow).code == 1
    refused = noslip("check", file, "--values", "--constraint", "joint-limits")
    assert (refused.code, refused.err.count("\n")) == (2, 1)
    assert "of which robot? read its joints with" in refused.err


def test_each_of_many_is_learned_with_its_robot(noslip, robot, tmp_path):
    folder, out = tmp_path / "runs", tmp_path / "out"
    joint_cut().to_csv(folder / "cut.csv")
    asked = *robot, "--values", "--constraint", "blade", "--constraint", "joint-limits"
    done = noslip("learn", "--each", folder, *asked, "--basis-functions", "15", "--out", out)
    assert done.code == 0, done.out + done.err
    for row in read_results(out / "results.csv"):
        assert (row.status, row.unit) == ("learned", "rad")
        assert row.rotation_rms_deg is None
        dmp = ns.load_primitive(row.primitive)
        assert dmp.law.space.carrier == ns.robots.chain(robot[1], tool="knife")
        assert [c.coordinates for c in dmp.constraints] == [0, 4]
        assert ns.check(dmp.rollout().tool, ns.Blade(), tolerance=1e-9).satisfied
    again = noslip("learn", "--each", folder, *asked, "--basis-functions", "15", "--out", out)
    assert again.out.startswith("learned 1 of 1 recordings, 1 of them before")


def test_channels_go_through_the_commands(noslip, tmp_path):
    cut = planar_cut(0.4, count=60)
    grip = ns.Trajectory(cut.times, 0.02 * cut.times[:, None], names=["grip"], units=["m"])
    file = cut.with_channels(grip).to_csv(tmp_path / "cut.csv")
    asked = "--channels", "grip", "--constraint", "blade", "--basis-functions", "15"
    one, out, pieces = (tmp_path / name for name in ("one.json", "one.csv", "pieces"))
    assert noslip("learn", file, *asked, "--out", one).code == 0
    assert noslip("rollout", one, "--out", out).code == 0
    assert noslip("segment", file, "--channels", "grip", "--out", pieces).code == 0
    for motion in ns.load_demonstrations([out, pieces / "cut_01.csv"], channels="grip"):
        told = motion.channels.column("grip")
        np.testing.assert_allclose(told, 0.02 * motion.times, rtol=0, atol=1e-9)
        assert motion.channels.units == ("m",)


@pytest.fixture
def there_and_back(tmp_path) -> Path:
    """Two coordinates that go, rest, and come back."""
    s = np.linspace(0, 1, 201)
    u = s**3 * (10 - 15 * s + 6 * s**2)
    path = np.concatenate([u, np.ones(100), 1 - u])
    values = np.column_stack([0.5 * path, 0.2 * path])
    times = np.arange(len(path)) / 100
    return ns.Trajectory(times, values, names=["a", "b"], units=["rad", "rad"]).to_csv(
        tmp_path / "long.csv"
    )


def test_vectors_are_cut_in_their_own_unit(noslip, there_and_back, tmp_path):
    asked = "--columns", "a,b", "--figure", tmp_path / "cuts.svg"
    cut = noslip("segment", there_and_back, *asked, "--out", tmp_path / "pieces")
    assert cut.code == 0
    assert "path (rad)" in cut.out
    assert "0.538" in cut.out
    assert "rad/s; shorter" in cut.out
    assert "mm" not in cut.out
    assert "m/s" not in (tmp_path / "cuts.svg").read_text()
    asked = "--columns", "a,b", "--at", "contact", "--height", "0,0,1"
    refused = noslip("segment", there_and_back, *asked, "--out", tmp_path / "others")
    assert (refused.code, refused.err.count("\n")) == (2, 1)
    assert "holds a, b; give --contact-column" in refused.err


def test_each_of_many_vectors_says_nothing_of_constraints(noslip, there_and_back, tmp_path):
    done = noslip("learn", "--each", there_and_back, "--values", "--out", tmp_path / "out")
    assert done.code == 0
    assert done.out.splitlines()[0] == "learned 1 of 1 recordings"
    assert "residual" not in done.out
