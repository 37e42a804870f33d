"""Written recordings, read back by us and by what is not ours."""

from __future__ import annotations

import re
import sqlite3
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from noslip import PoseTrajectory, load_demonstrations
from noslip.errors import InputError
from noslip.recordings import bag_topics, write_bag, write_joints, write_recording
from refusals import refusal


def load(path: Path, **options: str) -> PoseTrajectory:
    (trajectory,) = load_demonstrations(path, **options)
    return trajectory


@pytest.mark.parametrize(
    ("name", "package"),
    [
        ("run.csv", None),
        ("run.npz", None),
        ("run.tum", None),
        ("run.parquet", "pyarrow"),
        ("run.feather", "pyarrow"),
        ("run.mcap", "rosbags"),
        ("run_bag", "rosbags"),
    ],
)
def test_what_is_written_is_read_back(tmp_path, motion, same, name, package) -> None:
    if package:
        pytest.importorskip(package, reason="needs an extra")
    path = write_recording(motion, tmp_path / "new" / name)
    assert path == tmp_path / "new" / name
    same(load(path), motion, 1e-15)
    if package != "rosbags":  # bags keep whole nanoseconds
        np.testing.assert_array_equal(load(path).times, motion.times)
    assert [file.name for file in path.parent.iterdir()] == [name]


@pytest.mark.filterwarnings("ignore::noslip.errors.RecordingWarning")
# Every example overwrites the same file.
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=20)
@given(
    start=st.floats(0, 2e9),
    step=st.floats(1e-3, 10),
    seed=st.integers(0, 2**32 - 1),
)
def test_bags_round_times_to_what_they_can_hold(tmp_path, same, start, step, seed) -> None:
    pytest.importorskip("rosbags", reason="needs the extra bags")
    random = np.random.default_rng(seed)
    wild = PoseTrajectory(
        times=start + step * np.arange(12),
        positions=random.normal(size=(12, 3)) * 10.0 ** random.integers(-9, 9),
        rotations=Rotation.random(12, random_state=seed),
    )
    found = load(write_recording(wild, tmp_path / "wild.mcap"))
    np.testing.assert_array_equal(found.positions, wild.positions)
    np.testing.assert_allclose(found.times, wild.times, rtol=0, atol=0.51e-9 + np.spacing(start))


def test_an_unknown_suffix_and_a_place_that_is_taken(tmp_path, motion) -> None:
    with pytest.raises(InputError, match=r"cannot write \.xml; known are \.csv, \.tum"):
        write_recording(motion, tmp_path / "run.xml")
    pytest.importorskip("rosbags", reason="needs the extra bags")
    (tmp_path / "bag").mkdir()
    with pytest.raises(InputError, match="exists already"):
        write_recording(motion, tmp_path / "bag")
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        write_bag(tmp_path / "file" / "bag", poses=motion)


def test_a_bag_is_what_ros_expects(tmp_path, motion) -> None:
    """Metadata by a YAML parser, messages by SQLite and the bytes of CDR."""
    pytest.importorskip("rosbags", reason="needs the extra bags")
    yaml = pytest.importorskip("ruamel.yaml", reason="comes with rosbags").YAML(typ="safe")
    bag = write_bag(tmp_path / "bag", poses=motion, frame="base", topic="/knife")
    info = yaml.load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert info["storage_identifier"] == "sqlite3"
    assert info["relative_file_paths"] == ["bag.db3"]
    assert info["message_count"] == len(motion)
    assert info["starting_time"] == {"nanoseconds_since_epoch": 3_700_000_000}
    assert info["duration"] == {"nanoseconds": 1_950_000_000}
    [topic] = info["topics_with_message_count"]
    assert topic["message_count"] == len(motion)
    told = topic["topic_metadata"]
    assert told["name"], told["type"] == ("/knife", "geometry_msgs/msg/PoseStamped")
    assert (told["serialization_format"], told["offered_qos_profiles"]) == ("cdr", "")

    database = sqlite3.connect(bag / "bag.db3")
    stored = database.execute("SELECT timestamp, data FROM messages ORDER BY timestamp").fetchall()
    database.close()
    scalar_last = np.roll(motion.quaternions, -1, axis=1)
    for row, (stamp, data) in enumerate(stored):
        # Little-endian CDR: sec, nanosec, length and text of the frame; doubles aligned to 8.
        representation, sec, nanosec, length = struct.unpack_from("<4siII", data)
        assert representation == b"\0\1\0\0"
        assert sec * 10**9 + nanosec == stamp == round(motion.times[row] * 1e9)
        assert data[16 : 16 + length] == b"base\0"
        numbers = struct.unpack_from("<7d", data, 4 + 24)
        np.testing.assert_array_equal(numbers, [*motion.positions[row], *scalar_last[row]])


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_poses_and_joints_in_one_bag(tmp_path, motion, same, storage) -> None:
    highlevel = pytest.importorskip("rosbags.highlevel", reason="needs the extra bags")
    times = motion.times[0] + np.arange(100) / 50
    angles = np.column_stack([np.sin(times), times**2])
    rates = np.column_stack([np.cos(times), 2 * times])
    bag = write_bag(
        tmp_path / "both",
        poses=motion,
        joint_names=["shoulder", "elbow"],
        joint_times=times,
        joint_positions=angles,
        joint_velocities=rates,
        storage=storage,
    )
    same(load(bag), motion, 1e-15)
    assert {path.suffix for path in bag.iterdir()} == {
        ".yaml", ".db3" if storage == "sqlite3" else ".mcap"
    }  # fmt: skip
    if storage == "sqlite3":
        database = sqlite3.connect(bag / "both.db3")
        rows = database.execute("SELECT timestamp FROM messages ORDER BY id").fetchall()
        database.close()
        assert rows == sorted(rows)
    joints, poses = bag_topics(bag)
    assert (joints.name, joints.type) == ("/joint_states", "sensor_msgs/msg/JointState")
    assert (joints.messages, poses.messages) == (100, 40)
    assert poses.frames == (("world", ""),)
    with highlevel.AnyReader([bag]) as reader:
        every = [(c.topic, stamp, raw, c.msgtype) for c, stamp, raw in reader.messages()]
        read = [reader.deserialize(raw, kind) for topic, _, raw, kind in every if "joint" in topic]
    stamps = [stamp for _, stamp, _, _ in every]
    assert stamps == sorted(stamps)
    assert all(message.name == ["shoulder", "elbow"] for message in read)
    np.testing.assert_array_equal([message.position for message in read], angles)
    np.testing.assert_array_equal([message.velocity for message in read], rates)


def test_joints_as_csv(tmp_path) -> None:
    times, angles = np.arange(3) / 10, np.array([[0.1, 1], [0.2, 2], [0.3, 3]])
    path = write_joints(times, ["a", "b"], angles, angles / 3, tmp_path / "joints.csv")
    header, *rows = path.read_text().splitlines()
    assert header == "t,a,b,a_velocity,b_velocity"
    table = np.array([[float(cell) for cell in row.split(",")] for row in rows])
    np.testing.assert_array_equal(table, np.column_stack([times, angles, angles / 3]))
    path = write_joints(times, ["a", "b"], angles, None, tmp_path / "joints.csv")
    assert path.read_text().splitlines()[:2] == ["t,a,b", "0.0,0.1,1.0"]


def test_joints_as_a_bag(tmp_path) -> None:
    pytest.importorskip("rosbags", reason="needs the extra bags")
    bag = write_joints([0.0, 0.1], ["a"], [[1.0], [2.0]], None, tmp_path / "joints.mcap")
    [topic] = bag_topics(bag)
    assert (topic.name, topic.messages) == ("/joint_states", 2)


GOOD = {
    "joint_names": ["a", "b"],
    "joint_times": [0.0, 0.1, 0.2],
    "joint_positions": np.zeros((3, 2)),
}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"joint_names": ["a", "a"]}, "different names"),
        ({"joint_names": "ab"}, "different names"),
        ({"joint_names": []}, "different names"),
        ({"joint_times": [0.0, 0.1]}, r"positions have shape \(3, 2\), expected \(2, 2\)"),
        ({"joint_times": [0.0, 0.1, 0.1]}, "increases"),
        ({"joint_times": None}, "increases"),
        ({"joint_times": [0.0, 0.1, 1e-10 + 0.1]}, "less than a nanosecond"),
        ({"joint_times": [-1.0, 0.1, 0.2]}, "stamps of ROS"),
        ({"joint_times": [0.0, 0.1, 3e9]}, "stamps of ROS"),
        ({"joint_times": [0.0, np.nan, 0.2]}, "increases"),
        ({"joint_positions": np.full((3, 2), np.inf)}, "positions of joints, sample 0"),
        ({"joint_positions": [["a", "b"]] * 3}, "not an array of numbers"),
        ({"joint_velocities": np.zeros(3)}, r"velocities have shape \(3,\)"),
        ({"joint_positions": None}, "nothing to write"),
        ({"storage": "bag"}, "storage must be sqlite3 or mcap"),
    ],
)
def test_joints_that_are_refused(tmp_path, change, words) -> None:
    pytest.importorskip("rosbags", reason="needs the extra bags")
    assert re.search(words, refusal(InputError, write_bag, tmp_path / "bag", **GOOD | change))
    assert not list(tmp_path.iterdir())


def test_joints_of_another_suffix(tmp_path) -> None:
    with pytest.raises(InputError, match=r"cannot write joints as \.npz"):
        write_joints([0.0], ["a"], [[1.0]], None, tmp_path / "joints.npz")


@pytest.mark.parametrize("twists", ["body", "world"])
def test_an_mcap_is_read_by_the_reader_of_its_makers(tmp_path, motion, twists) -> None:
    """CDR by hand: four bytes of header, the stamp, the frame, then doubles at multiples of 8."""
    reader = pytest.importorskip("mcap.reader", reason="needs mcap")
    pytest.importorskip("rosbags", reason="needs the extra bags")
    target = write_bag(tmp_path / "cut.mcap", poses=motion, twist=twists, body_frame="knife")
    seen: dict[str, list[np.ndarray]] = {}
    with target.open("rb") as file:
        for schema, channel, message in reader.make_reader(file).iter_messages():
            assert channel.message_encoding == "cdr"
            numbers = 7 if schema.name == "geometry_msgs/msg/PoseStamped" else 6
            seen.setdefault(channel.topic, []).append(
                np.frombuffer(message.data[-8 * numbers :], "<f8")
            )
            frame = b"knife" if (channel.topic, twists) == ("/twist", "body") else b"world"
            assert frame in message.data
    np.testing.assert_array_equal(np.array(seen["/pose"])[:, :3], motion.positions)
    steps = np.hstack(motion.step_velocities()) if twists == "world" else motion.body_velocities
    np.testing.assert_array_equal(np.array(seen["/twist"]), [*steps, np.zeros(6)])
