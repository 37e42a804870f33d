"""ROS bags: which poses are read, through which frames, and what each refusal says."""

from __future__ import annotations

import tracemalloc
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from noslip import PoseTrajectory, load_demonstrations
from noslip.errors import InputError, RecordingWarning
from noslip.recordings import bag_topics, write_bag

pytest.importorskip("rosbags", reason="needs the extra bags")

from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

Message = tuple[str, str, int, Any]
"""Topic, type, time in the bag (ns), message."""

POSE = "geometry_msgs/msg/PoseStamped"
TRANSFORM = "geometry_msgs/msg/TransformStamped"
COVARIANCE = "geometry_msgs/msg/PoseWithCovarianceStamped"
ARRAY = "geometry_msgs/msg/PoseArray"
ODOMETRY = "nav_msgs/msg/Odometry"
PATH = "nav_msgs/msg/Path"
TF = "tf2_msgs/msg/TFMessage"
STRING = "std_msgs/msg/String"


class Ros:
    """Messages of one generation of ROS, made with its own type store."""

    def __init__(self, generation: int = 2, tf_type: str = TF) -> None:
        self.generation = generation
        self.tf_type = tf_type
        self.store = get_typestore(Stores.ROS1_NOETIC if generation == 1 else Stores.ROS2_JAZZY)
        if generation == 1:
            definition = "geometry_msgs/TransformStamped[] transforms"
            self.store.register(get_types_from_msg(definition, tf_type))
        self.types = self.store.types

    def header(self, stamp: int, frame: str) -> Any:
        time = self.types["builtin_interfaces/msg/Time"](*divmod(stamp, 10**9))
        count = [0] if self.generation == 1 else []
        return self.types["std_msgs/msg/Header"](*count, time, frame)

    def point(self, place: Sequence[float], kind: str = "Point") -> Any:
        return self.types[f"geometry_msgs/msg/{kind}"](*map(float, place))

    def quaternion(self, turn: Rotation | Sequence[float]) -> Any:
        scalar_last = turn.as_quat() if isinstance(turn, Rotation) else turn
        return self.types["geometry_msgs/msg/Quaternion"](*map(float, scalar_last))

    def pose(self, stamp: int, frame: str, place: Any, turn: Any) -> Any:
        pose = self.types["geometry_msgs/msg/Pose"](self.point(place), self.quaternion(turn))
        return self.types[POSE](self.header(stamp, frame), pose)

    def transform(self, stamp: int, frame: str, child: str, place: Any, turn: Any) -> Any:
        moved = self.types["geometry_msgs/msg/Transform"](
            self.point(place, "Vector3"), self.quaternion(turn)
        )
        return self.types[TRANSFORM](self.header(stamp, frame), child, moved)

    def tf(self, *transforms: Any) -> Any:
        return self.types[self.tf_type](list(transforms))

    def odometry(self, stamp: int, frame: str, child: str, place: Any, turn: Any) -> Any:
        covariance = np.zeros(36)
        pose = self.types["geometry_msgs/msg/PoseWithCovariance"](
            self.pose(0, "", place, turn).pose, covariance
        )
        still = self.point((0, 0, 0), "Vector3")
        twist = self.types["geometry_msgs/msg/TwistWithCovariance"](
            self.types["geometry_msgs/msg/Twist"](still, still), covariance
        )
        return self.types[ODOMETRY](self.header(stamp, frame), child, pose, twist)

    def path(self, stamp: int, frame: str, poses: list[Any]) -> Any:
        return self.types[PATH](self.header(stamp, frame), poses)

    def write(self, path: Path, messages: Iterable[Message]) -> Path:
        """Write a bag of the kind that the path's suffix names; a folder by rosbag2's writer."""
        if self.generation == 1:
            writer: Any = rosbag1.Writer(path)
        else:
            plugin = "MCAP" if path.name.endswith("mcap") else "SQLITE3"
            writer = rosbag2.Writer(path, version=9, storage_plugin=rosbag2.StoragePlugin[plugin])
        with writer:
            connections: dict[tuple[str, str], Any] = {}
            for topic, kind, received, message in messages:
                if (topic, kind) not in connections:
                    connections[topic, kind] = writer.add_connection(
                        topic, kind, typestore=self.store
                    )
                if message is not None:
                    serialize = (
                        self.store.serialize_ros1
                        if self.generation == 1
                        else self.store.serialize_cdr
                    )
                    writer.write(connections[topic, kind], received, serialize(message, kind))
        return path


ROS = Ros()


def nanoseconds(times: np.ndarray) -> list[int]:
    return [round(time * 1e9) for time in times.tolist()]


def each(motion: PoseTrajectory) -> Iterable[tuple[int, np.ndarray, Rotation]]:
    return zip(nanoseconds(motion.times), motion.positions, motion.rotations, strict=True)


def poses(
    motion: PoseTrajectory, topic: str = "/tool", frame: str = "world", ros: Ros = ROS
) -> list[Message]:
    """Return stamped poses, received 5 ms late."""
    return [
        (topic, POSE, stamp + 5_000_000, ros.pose(stamp, frame, place, turn))
        for stamp, place, turn in each(motion)
    ]


def load(path: Path, **options: Any) -> PoseTrajectory:
    (trajectory,) = load_demonstrations(path, **options)
    return trajectory


# -------------------------------------------------------------------- the kinds of bags


@pytest.mark.parametrize("kind", ["ros1.bag", "sqlite3", "as_mcap"])
def test_every_kind_of_bag_holds_the_same_poses(tmp_path, motion, same, kind) -> None:
    ros = Ros(1 if kind == "ros1.bag" else 2)
    bag = ros.write(tmp_path / kind, poses(motion, ros=ros))
    same(load(bag), motion)
    assert load(bag).name == str(bag)
    assert load(bag, topic="tool", frame="/world").times[0] == pytest.approx(3.7, abs=1e-12)


@pytest.mark.parametrize("plugin", ["MCAP", "SQLITE3"])
@pytest.mark.parametrize("mode", ["FILE", "MESSAGE", "STORAGE"])
def test_compressed_bags(tmp_path, motion, same, plugin, mode) -> None:
    if (plugin, mode) == ("SQLITE3", "STORAGE"):
        return  # there is none
    writer = rosbag2.Writer(
        tmp_path / "bag", version=9, storage_plugin=rosbag2.StoragePlugin[plugin]
    )
    writer.set_compression(rosbag2.CompressionMode[mode], rosbag2.CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection("/tool", POSE, typestore=ROS.store)
        for _, kind, received, message in poses(motion):
            writer.write(connection, received, ROS.store.serialize_cdr(message, kind))
    same(load(tmp_path / "bag"), motion)
    if mode == "FILE":
        (bare,) = (tmp_path / "bag").glob("*.zstd")
        same(load(bare), motion)


@pytest.mark.parametrize("kind", ["bare_mcap", "bare_db3"])
def test_a_file_without_its_folder(tmp_path, motion, same, kind) -> None:
    ROS.write(tmp_path / kind, poses(motion))
    suffix = kind.removeprefix("bare_")
    bare = (tmp_path / kind / f"{kind}.{suffix}").rename(tmp_path / f"run.{suffix}")
    same(load(bare), motion)


def test_a_bag_without_definitions_of_its_messages(tmp_path, motion, same) -> None:
    """As ROS 2 Humble writes SQLite: schema 3, no table of definitions."""
    import sqlite3

    bag = ROS.write(tmp_path / "humble", poses(motion))
    database = sqlite3.connect(bag / "humble.db3")
    database.execute("DELETE FROM message_definitions")
    database.execute("UPDATE schema SET schema_version = 3")
    database.commit()
    database.close()
    same(load(bag), motion)


def test_bags_among_globs_and_files(tmp_path, motion) -> None:
    ROS.write(tmp_path / "run_1", poses(motion))
    motion.to_csv(tmp_path / "run_2.csv")
    (tmp_path / "run_notes").mkdir()
    found = load_demonstrations(f"{tmp_path}/run_*", topic="/tool")
    assert [Path(trajectory.name).name for trajectory in found] == ["run_1", "run_2.csv"]


# -------------------------------------------------------------------- the kinds of messages


def test_transforms_odometry_and_paths(tmp_path, motion, same) -> None:
    messages: list[Message] = []
    for stamp, place, turn in each(motion):
        messages += [
            ("/vicon", TRANSFORM, stamp, ROS.transform(stamp, "world", "knife", place, turn)),
            ("/vicon", TRANSFORM, stamp, ROS.transform(stamp, "world", "hand", -place, turn)),
            ("/odom", ODOMETRY, stamp, ROS.odometry(stamp, "odom", "base", place, turn)),
        ]
    way = [ROS.pose(stamp, "", place, turn) for stamp, place, turn in each(motion)]
    messages += [("/plan", PATH, k, ROS.path(k, "map", way[: 10 * k])) for k in range(1, 5)]
    bag = ROS.write(tmp_path / "bag", messages)
    same(load(bag, topic="/odom"), motion)
    same(load(bag, topic="/plan", frame="map"), motion)
    same(load(bag, topic="/vicon", child_frame="knife"), motion)
    np.testing.assert_array_equal(
        load(bag, topic="/vicon", child_frame="hand").positions, -motion.positions
    )


@pytest.mark.filterwarnings("ignore:.*all stamps are zero:noslip.errors.RecordingWarning")
def test_times_of_the_bag_where_all_stamps_are_zero(tmp_path, motion, same) -> None:
    messages = [
        ("/tool", POSE, stamp, ROS.pose(0, "world", place, turn))
        for stamp, place, turn in each(motion)
    ]
    same(load(ROS.write(tmp_path / "bag", messages)), motion)


@pytest.mark.filterwarnings("ignore::noslip.errors.RecordingWarning")
def test_a_first_stamp_of_zero_is_a_time(tmp_path, motion) -> None:
    messages = [
        ("/tool", POSE, stamp, ROS.pose(k * 10**7, "world", place, turn))
        for k, (stamp, place, turn) in enumerate(each(motion))
    ]
    times = load(ROS.write(tmp_path / "bag", messages)).times
    np.testing.assert_array_equal(times, np.arange(40) / 100)


@pytest.mark.filterwarnings("ignore::noslip.errors.RecordingWarning")
def test_stamps_since_1970_keep_what_a_float_can(tmp_path, motion) -> None:
    late = [1_700_000_000_123_456_789 + k * 8_333_333 for k in range(40)]
    messages = [
        ("/tool", POSE, 0, ROS.pose(stamp, "world", place, turn))
        for stamp, (_, place, turn) in zip(late, each(motion), strict=True)
    ]
    found = load(ROS.write(tmp_path / "bag", messages)).times
    np.testing.assert_array_equal(found, [stamp / 10**9 for stamp in late])


@pytest.mark.parametrize("kind", ["as_mcap", "sqlite3"])
def test_messages_count_by_when_they_came_not_by_their_place(tmp_path, motion, same, kind) -> None:
    messages = poses(motion)
    same(load(ROS.write(tmp_path / kind, messages[20:] + messages[:20])), motion)


def test_poses_with_covariance_in_arrays_and_without_a_header(tmp_path, motion, same) -> None:
    messages: list[Message] = []
    with_covariance = ROS.types["geometry_msgs/msg/PoseWithCovariance"]
    for stamp, place, turn in each(motion):
        pose, other = (ROS.pose(stamp, "world", sign * place, turn).pose for sign in (1, -1))
        header = ROS.header(stamp, "world")
        stamped = ROS.types[COVARIANCE](header, with_covariance(pose, np.zeros(36)))
        messages += [
            ("/cov", COVARIANCE, stamp, stamped),
            ("/one", ARRAY, stamp, ROS.types[ARRAY](header, [pose])),
            ("/two", ARRAY, stamp, ROS.types[ARRAY](header, [other, pose])),
            ("/bare", "geometry_msgs/msg/Pose", stamp, pose),
        ]
    bag = ROS.write(tmp_path / "bag", messages)
    for topic, options in (("/cov", {}), ("/one", {}), ("/two", {"element": 1})):
        same(load(bag, topic=topic, **options), motion)
    for options in ({}, {"element": 2}):
        with pytest.raises(InputError, match=r"/two: arrays of 2 poses; choose one .*--element"):
            load(bag, topic="/two", **options)
    with pytest.warns(RecordingWarning, match="/bare: Pose has no stamp; times are those of rec"):
        same(load(bag, topic="/bare"), motion)


@pytest.mark.parametrize("frame", ["body", "world"])
def test_twists_are_integrated_if_asked(tmp_path, motion, refusal, frame) -> None:
    bag = write_bag(tmp_path / "bag", poses=motion, twist=frame)
    assert "holds geometry_msgs/TwistStamped: velocities, of which integrate=" in refusal(
        bag, topic="/twist"
    )
    found = load(bag, topic="/twist", integrate=frame)
    moved, turned = motion.positions - motion.positions[0], motion.rotations[0].inv()
    if frame == "body":  # seen from where it began
        moved, expected = turned.apply(moved), turned * motion.rotations
    else:
        expected = motion.rotations * turned
    np.testing.assert_allclose(found.positions, moved, atol=1e-9)
    np.testing.assert_allclose((found.rotations * expected.inv()).magnitude(), 0, atol=1e-9)
    other = {"body": "world", "world": "body"}[frame]
    assert np.abs(load(bag, integrate=other).positions - moved).max() > 0.01


# -------------------------------------------------------------------- several publishers


def two_publish(path: Path, one: PoseTrajectory, other: PoseTrajectory) -> Path:
    """Write a ROS 1 bag in which /left and /right publish on one topic."""
    ros = Ros(1)
    with rosbag1.Writer(path) as writer:
        connections = [
            writer.add_connection("/tool", POSE, typestore=ros.store, callerid=name)
            for name in ("/left", "/right")
        ]
        messages = [
            (message[2], connection, message[3])
            for connection, motion in zip(connections, (one, other), strict=True)
            for message in poses(motion, ros=ros)
        ]
        for received, connection, message in sorted(messages, key=lambda each: each[0]):
            writer.write(connection, received, ros.store.serialize_ros1(message, POSE))
    return path


def test_two_who_publish_at_once_are_told_apart(tmp_path, motion, same, refusal) -> None:
    other = PoseTrajectory(
        times=motion.times + 0.01, positions=-motion.positions, rotations=motion.rotations
    )
    bag = two_publish(tmp_path / "both.bag", motion, other)
    assert refusal(bag).endswith(
        '/tool: several publish at once; choose one with publisher="..." (--publisher): '
        "/left (40), /right (40)"
    )
    same(load(bag, publisher="/left"), motion)
    same(load(bag, publisher="/right"), other)
    assert "no publisher /up; there are /left, /right" in refusal(bag, publisher="/up")
    (told,) = bag_topics(bag)
    assert told.publishers == ("/left", "/right")


def test_links_that_two_publish_at_once(tmp_path, refusal) -> None:
    ros, link = Ros(1), arm(20, 0.0)
    with rosbag1.Writer(tmp_path / "tf.bag") as writer:
        connections = {
            name: writer.add_connection("/tf", TF, typestore=ros.store, callerid=name)
            for name in ("/arm", "/slam", "/old_slam")
        }
        for name, parent, child, offset in (
            ("/arm", "base", "tool", 0.0),
            ("/slam", "map", "base", 0.0),
            ("/old_slam", "map", "base", 1.0),
        ):
            for _, kind, stamp, message in tf_messages(
                parent, child, (link[0], link[1] + offset, link[2]), ros
            ):
                writer.write(connections[name], stamp, ros.store.serialize_ros1(message, kind))
    bag = tmp_path / "tf.bag"
    # Nobody doubts the link that is asked for.
    np.testing.assert_allclose(load(bag, frame="base", child_frame="tool").positions, link[1])
    assert refusal(bag, child_frame="tool").endswith(
        '/tf: map -> base: several publish at once; choose one with publisher="..." '
        "(--publisher): /old_slam (80), /slam (80)"
    )
    found = load(bag, child_frame="tool", publisher="/slam")
    np.testing.assert_allclose(found.positions, link[1] + link[2].apply(link[1]), atol=1e-12)


def test_channels_of_one_topic_in_an_mcap(tmp_path, motion, same, refusal) -> None:
    """They are called by their place: MCAP does not tell who published."""
    target = tmp_path / "two.mcap"
    writing = pytest.importorskip("mcap.writer", reason="needs mcap")
    with target.open("wb") as file:
        writer = writing.Writer(file)
        writer.start(profile="", library="")
        definition = ROS.store.generate_msgdef(POSE, ros_version=2)[0]
        schema = writer.register_schema(POSE, "ros2msg", definition.encode())
        channels = [writer.register_channel("/tool", "cdr", schema) for _ in range(2)]
        for message in poses(motion):
            for channel, later in zip(channels, (0, 10**9), strict=True):
                data = ROS.store.serialize_cdr(message[3], POSE)
                writer.add_message(channel, message[2] + later, data, message[2] + later)
        writer.finish()
    assert refusal(target).endswith("(--publisher): 1 (40), 2 (40)")
    same(load(target, publisher="2"), motion)


def test_a_definition_that_cannot_be_parsed_costs_no_other_topic(tmp_path, motion, same) -> None:
    writing = pytest.importorskip("mcap.writer", reason="needs mcap")
    target = tmp_path / "one_bad.mcap"
    with target.open("wb") as file:
        writer = writing.Writer(file)
        writer.start(profile="ros2", library="")
        good = ROS.store.generate_msgdef(POSE, ros_version=2)[0].encode()
        for topic, definition in (("/bad", b"][ no definition"), ("/good", good)):
            channel = writer.register_channel(
                topic, "cdr", writer.register_schema(POSE, "ros2msg", definition)
            )
            for _, kind, received, message in poses(motion):
                data = ROS.store.serialize_cdr(message, kind)
                writer.add_message(channel, received, data, received)
        writer.finish()
    damaged = r"not read: /bad \(geometry_msgs/PoseStamped, whose definition is damaged\)"
    with pytest.warns(RecordingWarning, match=damaged):
        same(load(target), motion)
    with pytest.warns(RecordingWarning, match=damaged):
        assert [topic.messages for topic in bag_topics(target)] == [40, 40]


def test_an_active_bag_is_read_as_far_as_it_is_whole(tmp_path, motion, same) -> None:
    whole = Ros(1).write(tmp_path / "run.bag", poses(motion, ros=Ros(1)))
    active = tmp_path / "run.bag.active"
    active.write_bytes(whole.read_bytes()[:-10])
    with pytest.warns(RecordingWarning, match="'rosbag reindex' mends it"):
        same(load(active), motion)


def test_a_node_that_was_started_again_goes_on(tmp_path, motion, same) -> None:
    first, then = motion[:20], motion[20:]
    same(load(two_publish(tmp_path / "again.bag", first, then)), motion)


# -------------------------------------------------------------------- tf


def arm(rate: float, offset: float) -> tuple[np.ndarray, np.ndarray, Rotation]:
    """Return a link's times, positions and rotations, at its own rate."""
    t = np.arange(offset, 4.0, 1 / rate)
    place = np.column_stack([0.3 * np.sin(t + offset), 0.1 * t, np.cos(2 * t)])
    return t, place, Rotation.from_rotvec(np.column_stack([0.4 * t, np.sin(t), 0.2 * np.cos(t)]))


def tf_messages(
    parent: str, child: str, link: tuple[np.ndarray, np.ndarray, Rotation], ros: Ros = ROS
) -> list[Message]:
    times, places, turns = link
    return [
        ("/tf", ros.tf_type, stamp, ros.tf(ros.transform(stamp, parent, child, place, turn)))
        for stamp, place, turn in zip(nanoseconds(times), places, turns, strict=True)
    ]


def static(
    parent: str, child: str, place: Sequence[float], turn: Rotation, ros: Ros = ROS
) -> Message:
    # Latched before the recording began: its stamp says nothing.
    return "/tf_static", ros.tf_type, 1, ros.tf(ros.transform(1, parent, child, place, turn))


def matrices(place: np.ndarray, turn: Rotation) -> np.ndarray:
    matrix = np.tile(np.eye(4), (len(place), 1, 1))
    matrix[:, :3, :3] = turn.as_matrix()
    matrix[:, :3, 3] = place
    return matrix


def between(link: tuple[np.ndarray, np.ndarray, Rotation], times: np.ndarray) -> np.ndarray:
    """Return a link's matrices at other times: positions linear, rotations by slerp."""
    stamps, places, turns = link
    place = np.stack([np.interp(times, stamps, axis) for axis in places.T], axis=1)
    return matrices(place, Slerp(stamps, turns)(times))


@pytest.fixture(params=[(1, "tf/msg/tfMessage"), (1, TF), (2, TF)], ids=["tf1", "ros1", "ros2"])
def tree(tmp_path: Path, request: pytest.FixtureRequest) -> Path:
    """Frames world -> base (50 Hz) -> flange (30 Hz) -> tool (static); world -> camera (static)."""
    ros = Ros(*request.param)
    messages = tf_messages("world", "base", arm(50, 0.0), ros)
    messages += tf_messages("base", "/flange", arm(30, 0.35), ros)
    messages += [
        static("flange", "tool", (0, 0.02, 0.1), Rotation.from_euler("xyz", [0.1, 0.5, -1]), ros),
        static("world", "camera", (1, 2, 3), Rotation.from_euler("xyz", [2, 0.3, 0.2]), ros),
        static("elsewhere", "beacon", (0, 0, 0), Rotation.identity(), ros),
    ]
    name = "tree.bag" if ros.generation == 1 else "tree"
    return ros.write(tmp_path / name, sorted(messages, key=lambda message: message[2]))


def expected(times: np.ndarray) -> np.ndarray:
    tool = matrices(np.array([[0, 0.02, 0.1]]), Rotation.from_euler("xyz", [[0.1, 0.5, -1]]))
    return between(arm(50, 0.0), times) @ between(arm(30, 0.35), times) @ tool


def found(trajectory: PoseTrajectory) -> np.ndarray:
    return matrices(trajectory.positions, trajectory.rotations)


def test_a_chain_of_links_at_different_rates(tree) -> None:
    trajectory = load(tree, frame="world", child_frame="tool")
    stamps, slow = arm(50, 0.0)[0], arm(30, 0.35)[0]
    inside = stamps[(stamps >= slow[0]) & (stamps <= slow[-1])]
    np.testing.assert_allclose(trajectory.times, inside, atol=1e-9)
    np.testing.assert_allclose(found(trajectory), expected(inside), atol=1e-7)


def test_frames_in_either_direction_and_across_the_tree(tree) -> None:
    forth = load(tree, frame="world", child_frame="tool")
    back = load(tree, topic="/tf", frame="tool", child_frame="world")
    np.testing.assert_allclose(
        found(back) @ found(forth), np.tile(np.eye(4), (len(forth), 1, 1)), atol=1e-12
    )
    seen = load(tree, frame="camera", child_frame="tool")
    camera = matrices(np.array([[1, 2, 3]]), Rotation.from_euler("xyz", [[2, 0.3, 0.2]]))
    np.testing.assert_allclose(camera @ found(seen), found(forth), atol=1e-12)


def test_the_root_is_the_frame_where_none_is_given(tree, same) -> None:
    same(load(tree, child_frame="/tool"), load(tree, frame="world", child_frame="tool"))


def test_the_last_of_static_transforms_counts_and_a_moving_one_comes_first(tmp_path) -> None:
    link, still = arm(20, 0.0), Rotation.identity()
    messages = [
        static("a", "b", (9, 9, 9), still),  # superseded by /tf
        static("b", "c", (9, 9, 9), still),  # superseded by the next
        static("b", "c", (0, 0, 1), still),
        *tf_messages("a", "b", link),
    ]
    trajectory = load(ROS.write(tmp_path / "b", messages), child_frame="c")
    np.testing.assert_allclose(trajectory.positions, link[1] + link[2].apply([0, 0, 1]), atol=1e-12)


def test_transforms_out_of_order_are_kept_by_time_as_in_tf2(tmp_path) -> None:
    link = arm(20, 0.0)
    messages = tf_messages("map", "robot", link)
    late = [message for pair in zip(messages[1::2], messages[::2], strict=True) for message in pair]
    late = [(topic, kind, 10**9 + k, each) for k, (topic, kind, _, each) in enumerate(late)]
    bag = ROS.write(tmp_path / "late", [*late, late[7]])
    np.testing.assert_allclose(load(bag).times, link[0], atol=1e-9)
    np.testing.assert_allclose(load(bag).positions, link[1], atol=1e-12)


def test_transforms_that_tf2_ignores_are_counted(tmp_path) -> None:
    times, places, turns = arm(20, 0.0)
    messages = tf_messages("map", "robot", (times, places, turns))
    nan = ROS.transform(nanoseconds(times)[5] + 1, "map", "robot", (np.nan, 0, 0), turns[5])
    again = ROS.transform(nanoseconds(times)[7], "map", "robot", (9, 9, 9), turns[7])
    extra = [("/tf", TF, k, ROS.tf(bad)) for k, bad in ((10**10, nan), (10**10 + 1, again))]
    bag = ROS.write(tmp_path / "odd", [*messages, *extra])
    with pytest.warns(RecordingWarning, match="1 of 8. transforms ignored, as tf2 does") as told:
        found = load(bag)
    assert len(told) == 2
    np.testing.assert_allclose(found.positions, places, atol=1e-12)


def test_a_lone_link_needs_no_names(tmp_path) -> None:
    bag = ROS.write(tmp_path / "lone", tf_messages("map", "robot", arm(20, 0.0)))
    np.testing.assert_allclose(load(bag).positions, arm(20, 0.0)[1], atol=1e-12)


LINKS = "base -> flange, elsewhere -> beacon, flange -> tool, world -> base, world -> camera"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({}, ["whose motion?", "--child-frame", LINKS]),
        ({"child_frame": "knife"}, ["no frame knife", LINKS]),
        ({"child_frame": "tool", "frame": "moon"}, ["no frame moon", LINKS]),
        ({"child_frame": "tool", "frame": "beacon"}, ["no links connect beacon and tool", LINKS]),
        ({"child_frame": "tool", "frame": "tool"}, ["tool does not move in itself"]),
        ({"child_frame": "camera"}, ["camera does not move in world", "static"]),
    ],
)
def test_wrong_frames(tree, refusal, options, words) -> None:
    message = refusal(tree, **options)
    assert all(word in message for word in words), message


def test_links_that_share_no_time(tmp_path, refusal) -> None:
    early, late = arm(20, 0.0), arm(20, 0.0)
    late = (late[0] + 10, *late[1:])
    bag = ROS.write(tmp_path / "b", tf_messages("a", "b", early) + tf_messages("b", "c", late))
    message = refusal(bag, child_frame="c")
    assert "0 samples in the time they share" in message
    assert "a -> b 0.000000 to 3.950000 s, b -> c 10.000000 to 13.950000 s" in message


def test_a_hole_in_one_link_is_not_bridged(tmp_path, refusal) -> None:
    fast, slow = arm(50, 0.0), arm(20, 0.0)
    kept = np.r_[0:20, 60:80]
    holed = (slow[0][kept], slow[1][kept], slow[2][kept])
    bag = ROS.write(tmp_path / "b", tf_messages("a", "b", fast) + tf_messages("b", "c", holed))
    message = refusal(bag, child_frame="c")
    assert "/tf: sample 48, stamp of the header: no sample from 0.94" in message
    with pytest.warns(RecordingWarning, match="split into 2 pieces"):
        before, after = load_demonstrations(bag, child_frame="c", gaps="split")
    assert before.times[-1] < 0.96 < 3.0 <= after.times[0]


def test_a_frame_with_two_parents(tmp_path, refusal) -> None:
    link = arm(20, 0.0)
    bag = ROS.write(tmp_path / "b", tf_messages("a", "c", link) + tf_messages("b", "c", link))
    assert "frame c has two parents, a and b" in refusal(bag, child_frame="c")


# -------------------------------------------------------------------- refusals


def test_topics_are_listed_when_there_are_several_or_none_fits(tmp_path, motion, refusal) -> None:
    text = ("/note", STRING, 1, ROS.types[STRING]("hello"))
    bag = ROS.write(tmp_path / "b", [*poses(motion, "/a"), *poses(motion, "/b"), text])
    both = "/a (geometry_msgs/PoseStamped, 40), /b (geometry_msgs/PoseStamped, 40)"
    assert refusal(bag).endswith(
        f'several topics hold poses; choose one with topic="..." (--topic): {both}'
    )
    assert f"no topic /c; those with poses are {both}" in refusal(bag, topic="/c")
    assert "topic /note holds std_msgs/String, no poses" in refusal(bag, topic="/note")
    only = ROS.write(tmp_path / "text", [text])
    assert "no topic of poses, found '/note'" in refusal(only)


def test_frames_are_listed_when_there_are_several_or_none_fits(tmp_path, motion, refusal) -> None:
    half = len(motion) // 2
    bag = ROS.write(
        tmp_path / "b", poses(motion[:half], frame="world") + poses(motion[half:], frame="base")
    )
    assert "several frames" in refusal(bag)
    assert refusal(bag).endswith("base, world")
    assert "no poses of frame moon; it holds base, world" in refusal(bag, frame="moon")
    assert len(load(bag, frame="base")) == half


def test_empty_bags(tmp_path, refusal) -> None:
    assert "no topic of poses, found none" in refusal(ROS.write(tmp_path / "none", []))
    silent = ROS.write(tmp_path / "silent", [("/tool", POSE, 0, None)])
    assert "/tool: no poses in it" in refusal(silent)
    first = Ros(1).write(tmp_path / "first.bag", [])
    assert "no topic of poses" in refusal(first)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"place": (np.nan, 0, 0)}, "sample 7, position: found [nan"),
        ({"turn": (0, 0, 0, np.inf)}, "sample 7, orientation: found ["),
        ({"turn": (0, 0, 0, 0)}, "sample 7, orientation: the quaternion is zero"),
        ({"turn": (0, 0, 0, 1.1)}, "sample 7, orientation: the quaternion has norm 1.1"),
        ({"stamp": 1}, "sample 7, stamp of the header: time runs backwards"),
        ({"stamp": 4_000_000_000}, "sample 7, stamp of the header: 4 s is also the time of"),
    ],
)
def test_a_bad_pose(tmp_path, motion, refusal, change, words) -> None:
    messages = []
    for k, (stamp, place, turn) in enumerate(each(motion)):
        one = {"stamp": stamp, "frame": "world", "place": place, "turn": turn}
        messages.append(("/tool", POSE, stamp, ROS.pose(**one | (change if k == 7 else {}))))
    assert words in refusal(ROS.write(tmp_path / "b", messages))


def test_a_path_without_stamps_has_no_times(tmp_path, motion, refusal) -> None:
    way = [ROS.pose(0, "", place, turn) for _, place, turn in each(motion)]
    bag = ROS.write(tmp_path / "b", [("/plan", PATH, 5, ROS.path(5, "map", way))])
    assert "carry no stamps" in refusal(bag)


@pytest.mark.filterwarnings("ignore:.*was not closed")
@pytest.mark.parametrize("kind", ["ros1.bag", "as_mcap", "sqlite3"])
def test_a_damaged_bag_is_one_line(tmp_path, motion, kind) -> None:
    """Cut anywhere, a bag is read or refused, and never anything else."""
    ros = Ros(1 if kind == "ros1.bag" else 2)
    bag = ros.write(tmp_path / kind, poses(motion, ros=ros))
    [file] = [bag] if bag.is_file() else [f for f in bag.iterdir() if f.name != "metadata.yaml"]
    whole = file.read_bytes()
    refused = 0
    for share in (0.0, 0.05, 0.3, 0.6, 0.9, 0.99):
        file.write_bytes(whole[: int(share * len(whole))])
        try:
            load(bag)
        except ValueError as error:  # InputError is one
            refused += 1
            assert str(error).startswith(str(bag))
            assert "\n" not in str(error)
    assert refused


def test_metadata_that_is_no_bag(tmp_path, refusal) -> None:
    (tmp_path / "odd").mkdir()
    (tmp_path / "odd" / "metadata.yaml").write_text("a: [1, 2")
    assert "cannot be read as a ROS bag" in refusal(tmp_path / "odd")


# -------------------------------------------------------------------- what is inside


def test_topics_tell_types_counts_and_frames(tree, tmp_path, motion) -> None:
    moving, fixed = bag_topics(tree)
    assert (moving.name, moving.messages) == ("/tf", 200 + 110)
    assert set(moving.frames) == {("world", "base"), ("base", "flange")}
    assert (fixed.name, fixed.type, fixed.messages) == ("/tf_static", moving.type, 3)
    assert moving.type in (TF, "tf/msg/tfMessage")
    text = ("/note", STRING, 1, ROS.types[STRING]("hello"))
    note, tool = bag_topics(ROS.write(tmp_path / "b", [*poses(motion), text]))
    assert (note.name, note.messages, note.frames) == ("/note", 1, ())
    assert tool.frames == (("world", ""),)


def test_a_bag_takes_no_more_memory_for_what_lies_beside_the_poses(tmp_path, motion) -> None:
    image = ROS.types[STRING]("." * 500_000)
    beside = [("/image", STRING, stamp, image) for _, _, stamp, _ in poses(motion)]
    bag = ROS.write(tmp_path / "large", [*poses(motion), *beside])
    assert sum(file.stat().st_size for file in bag.iterdir()) > 20e6
    tracemalloc.start()
    load(bag)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 10e6


def test_a_folder_that_a_killed_recorder_left(tmp_path, motion, same) -> None:
    """Without metadata; its files are named after it, and numbered."""
    folder = tmp_path / "run"
    folder.mkdir()
    for k, part in enumerate([motion[:25], motion[25:]]):
        whole = ROS.write(tmp_path / f"run_{k}", poses(part))
        (whole / f"run_{k}.db3").rename(folder / f"run_{k}.db3")
    with pytest.warns(RecordingWarning, match="no metadata.yaml.*'ros2 bag reindex' mends it"):
        same(load(folder), motion)


def test_paths_of_two_publishers_are_two_motions(tmp_path, motion, same, refusal) -> None:
    ros, bag = Ros(1), tmp_path / "two.bag"
    with rosbag1.Writer(bag) as writer:
        for k, name in enumerate(["/a", "/b"]):
            one = writer.add_connection("/plan", PATH, typestore=ros.store, callerid=name)
            way = [
                ros.pose(stamp + k * 10**10, "", place + k, turn)
                for stamp, place, turn in each(motion)
            ]
            message = ros.path(1, "map", way)
            writer.write(one, 1 + k, ros.store.serialize_ros1(message, PATH))
    assert "(--publisher): /a (40), /b (40)" in refusal(bag)
    same(load(bag, publisher="/a"), motion)
