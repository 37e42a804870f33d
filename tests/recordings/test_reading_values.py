"""Numbers that are no pose, from every kind of file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.errors import InputError
from noslip.recordings import write_recording
from refusals import refusal

TIMES = np.arange(40) / 40
JOINTS = tuple(f"panda_joint{k}" for k in range(1, 8))


@pytest.fixture
def joints() -> ns.Trajectory:
    values = np.random.default_rng(1).normal(size=(len(TIMES), 7))
    return ns.Trajectory(TIMES, values, names=JOINTS, units=("rad",) * 7, name="joints")


def table(path: Path, names: str, columns: list[np.ndarray]) -> Path:
    rows = (",".join(map(repr, row)) for row in np.column_stack([TIMES, *columns]).tolist())
    path.write_text("\n".join([f"t,{names}", *rows, ""]))
    return path


@pytest.mark.parametrize("suffix", [".csv", ".npz", ".parquet", ".feather", ".mcap", ""])
def test_joints_come_back_from_every_format(joints, tmp_path: Path, suffix: str) -> None:
    path = write_recording(joints, tmp_path / f"joints{suffix}")
    found = ns.load_trajectory(path)
    np.testing.assert_array_equal(found.values, joints.values)
    np.testing.assert_allclose(found.times, joints.times, atol=1e-9)
    assert (found.names, found.units) == (joints.names, joints.units)
    if suffix != ".npz":
        one, three = ns.load_demonstrations(path, columns=[JOINTS[2], JOINTS[0]]), [2, 0]
        np.testing.assert_array_equal(one[0].values, joints.values[:, three])


def test_seven_joints_are_no_pose_though_they_are_seven(joints, tmp_path: Path) -> None:
    path = joints.to_csv(tmp_path / "joints.csv")
    (found,) = ns.load_demonstrations(path, columns=JOINTS)
    np.testing.assert_array_equal(found.values, joints.values)
    plain = table(tmp_path / "q.csv", "q1,q2,q3,q4,q5,q6,q7", list(joints.values.T))
    (found,) = ns.load_demonstrations(plain, columns="q1,q2,q3,q4,q5,q6,q7")
    assert isinstance(found, ns.Trajectory)
    # What may be a pose is asked after, as ever.
    half = table(tmp_path / "h.csv", "x,y,z,roll,pitch,yaw", list(joints.values[:, :6].T))
    told = refusal(InputError, ns.load_demonstrations, half, columns="x,y,z,roll,pitch,yaw")
    assert "rotation=... (--rotation)" in told
    assert isinstance(ns.load_trajectory(half), ns.Trajectory)


def test_a_position_alone_and_an_orientation_alone(tmp_path: Path) -> None:
    u = np.linspace(0, 1, len(TIMES))
    path = table(tmp_path / "p.csv", "x [mm],y [mm],z [mm]", [100 * u, 200 * u, 0 * u])
    (place,) = ns.load_demonstrations(path)
    assert (place.names, place.units) == (("x", "y", "z"), ("m", "m", "m"))
    np.testing.assert_allclose(place.values[-1], [0.1, 0.2, 0.0])
    assert place.space.bodies
    plain = table(tmp_path / "c.csv", "x,y,z", [100 * u, 200 * u, 0 * u])
    (converted,) = ns.load_demonstrations(plain, units="mm")
    np.testing.assert_allclose(converted.values, place.values)
    turn = Rotation.from_rotvec(np.outer(u, [0.3, 0.4, 0.0])).as_quat(scalar_first=True)
    path = table(tmp_path / "q.csv", "qw,qx,qy,qz", list(turn.T))
    for (found,) in (
        ns.load_demonstrations(path),
        ns.load_demonstrations(path, columns="qw,qx,qy,qz"),
    ):
        np.testing.assert_array_equal(found.positions, 0.0)
        np.testing.assert_allclose(found.quaternions, turn, atol=1e-15)
    # Where anything else is there, a part of the pose may be it.
    more = table(tmp_path / "m.csv", "x,y,z,heading", [u, u, u, u])
    assert "qw, qx, qy, qz missing" in refusal(InputError, ns.load_demonstrations, more)


def test_units_are_kept_and_degrees_are_not(tmp_path: Path) -> None:
    u = np.linspace(0, 1, len(TIMES))
    path = table(tmp_path / "u.csv", "a_deg,Force [N],width [cm],b", [180 * u, u, u, u])
    found = ns.load_trajectory(path)
    assert found.names == ("a", "Force", "width", "b")
    assert found.units == ("rad", "N", "m", "1")
    np.testing.assert_allclose(found.values[-1], [np.pi, 1, 0.01, 1])
    assert ns.load_trajectory(path, ["force", "b"], units="deg").units == ("N", "rad")


def test_faults_are_told_and_mended_as_in_poses(tmp_path: Path) -> None:
    values = np.random.default_rng(2).normal(size=(len(TIMES), 2))
    values[7, 1] = np.nan
    path = table(tmp_path / "f.csv", "a,b", list(values.T))
    told = refusal(InputError, ns.load_trajectory, path)
    assert "line 9, column b: found nan" in told
    with pytest.warns(ns.errors.RecordingWarning, match="1 of 40 samples left out"):
        dropped = ns.load_trajectory(path, lost="drop")
    np.testing.assert_array_equal(dropped.values, np.delete(values, 7, axis=0))
    stamps = TIMES.copy()
    stamps[20:] += 2.0
    gap = ns.Trajectory(stamps, np.nan_to_num(values)).to_csv(tmp_path / "g.csv")
    assert "gaps='split'" in refusal(InputError, ns.load_trajectory, gap)
    with pytest.warns(ns.errors.RecordingWarning, match="split into 2 pieces"):
        first, second = ns.load_demonstrations(gap, values=True, gaps="split")
    assert len(first) == len(second) == 20
    with pytest.warns(ns.errors.RecordingWarning, match="samples filled in"):
        filled = ns.load_trajectory(gap, gaps="interpolate")
    middle = filled.between(np.array([stamps[19] + 1.0, stamps[20]])).values[0]
    share = 1.0 / (stamps[20] - stamps[19])
    np.testing.assert_allclose(middle, (1 - share) * values[19] + share * values[20])
    # Milliseconds that nothing says are milliseconds.
    slow = ns.Trajectory(1e3 * TIMES, np.nan_to_num(values)).to_csv(tmp_path / "s.csv")
    slow.write_text(slow.read_text().replace("t[s]", "t"))
    assert "units='ms'" in refusal(InputError, ns.load_trajectory, slow)
    assert ns.load_trajectory(slow, units="ms").duration == pytest.approx(TIMES[-1])


def test_a_wrench_and_the_rest_are_topics_of_their_own(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    names = ("fx", "fy", "fz", "tx", "ty", "tz", "stiffness")
    beside = ns.Trajectory(
        TIMES,
        rng.normal(size=(len(TIMES), 7)),
        names=names,
        units=("N",) * 3 + ("N m",) * 3 + ("N/m",),
    )
    turns = Rotation.from_rotvec(np.outer(TIMES, [0, 0, 1]))
    pose = ns.PoseTrajectory(TIMES, np.outer(TIMES, [0.1, 0, 0]), turns, channels=beside)
    bag = write_recording(pose, tmp_path / "cut.mcap")
    kinds = {topic.name: topic.type for topic in ns.recordings.bag_topics(bag)}
    assert kinds == {
        "/pose": "geometry_msgs/msg/PoseStamped",
        "/wrench": "geometry_msgs/msg/WrenchStamped",
        "/channels": "sensor_msgs/msg/JointState",
    }
    read = ns.load_trajectory(bag)
    assert (read.names, read.units) == (("stiffness",), ("N/m",))
    np.testing.assert_array_equal(read.values[:, 0], beside.column("stiffness"))
    np.testing.assert_allclose(ns.load_demonstrations(bag)[0].positions, pose.positions)
    for suffix in (".csv", ".parquet"):
        path = write_recording(pose, tmp_path / f"cut{suffix}")
        (found,) = ns.load_demonstrations(path, channels=["stiffness", "fx"])
        np.testing.assert_array_equal(found.channels.values, beside.values[:, [6, 0]])
        assert found.channels.units == ("N/m", "N")


def test_refusals(joints, tmp_path: Path) -> None:
    path, bag = joints.to_csv(tmp_path / "a.csv"), write_recording(joints, tmp_path / "a.mcap")
    for told, call in (
        ("no column q9", lambda: ns.load_trajectory(path, "q9")),
        ("name a number twice", lambda: ns.load_trajectory(path, [JOINTS[0], JOINTS[0]])),
        ("load_trajectory reads them", lambda: ns.load_demonstrations(path)),
        ("no message with joints q9", lambda: ns.load_trajectory(bag, "q9")),
        ("TUM's format holds poses", lambda: write_recording(joints, tmp_path / "a.tum")),
        ("twist is of poses", lambda: write_recording(joints, tmp_path / "b.csv", twist="body")),
        ("which channels go with", lambda: ns.load_demonstrations(
            path, columns=JOINTS[:2], channels=JOINTS[3])),
    ):  # fmt: skip
        assert told in refusal(InputError, call)
