"""What is damaged, how, and what reads it: primitives, tables, bags."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip._typing import Floats
from noslip.errors import muted
from noslip.recordings import write_recording

Damage = Callable[[np.random.Generator], Any]
"""Damages a good file."""
Read = Callable[[Any], Iterable[Floats]]
"""Writes, reads and uses what that returned; returns the numbers that it gave."""
Target = tuple[Damage, Read]

VALUES: tuple[Any, ...] = (
    *(None, True, -1, 0, 1, 0.5, 5e-324, 1e-9, 1e12, 1e300, -1e300, float("nan"), float("inf")),
    *(10**400, 2**31, 2**63, "", "x", "1", "\x1b[2J", "a\r\nb", "\ud800", [], {}, [[]], [None]),
    *(["x"], {"x": 1}, [[1, 2], [3]], {"type": "blade", "arguments": {}}, {"instructions": []}),
    *({"travel": "x"}, [1e300] * 7, [[1.0, 0.0, 0.0, 0.0]] * 3, [[["deep"]]], "speed-limit"),
)
"""What is put where another value was."""
CELLS = (b"nan", b"inf", b"-1e999", b"1e300", b"", b'"', b"1_0", b"0x1", b";", b"\t", b"\r", b"\n")
"""What is put into text."""


def motion() -> ns.PoseTrajectory:
    """A cut of 40 samples."""
    s = np.linspace(0.0, 1.0, 40)
    path = np.column_stack([0.1 * s, 0.02 * np.sin(3 * s), 0 * s])
    held = Rotation.from_euler("z", np.arctan2(0.06 * np.cos(3 * s), 0.1))
    return ns.PoseTrajectory(s, path, held, name="cut")


def primitive(folder: Path) -> Target:
    """A saved primitive, signed anew after the damage."""

    @ns.velocity_constraint
    def no_roll(motion: Any) -> Any:
        return motion.rotation[:, 0].T @ motion.angular_velocity

    path = folder / "cut.json"
    with muted():
        learned = ns.learn(motion(), [ns.Blade(), no_roll], basis_functions=5, metric="shared")
    text = learned.adapt(goal_position=learned.goal_position + 0.01).save(path).read_text()

    def damage(rng: np.random.Generator) -> bytes:
        document = json.loads(text)
        for _ in range(rng.integers(1, 3)):
            _damage_data(rng, document["content"])
        try:
            content = json.dumps(document["content"], sort_keys=True, separators=(",", ":"))
        except ValueError:
            return b""
        document["checksum"] = "sha256:" + hashlib.sha256(content.encode()).hexdigest()
        return json.dumps(document).encode()

    def read(content: bytes) -> Iterable[Floats]:
        path.write_bytes(content)
        loaded = ns.load_primitive(path)
        repr(loaded), loaded._repr_html_(), hash(loaded)
        made = loaded.rollout(time_step=loaded.duration / 10)
        yield from (made.positions, made.quaternions, made.linear_velocities)
        yield from (made.angular_velocities, made.constraint_residuals)

    return damage, read


def tables(folder: Path) -> Target:
    """A recording in each of the formats that are one file."""
    suffixes = (".csv", ".npz", ".tum", ".parquet", ".feather")
    good = {s: write_recording(motion(), folder / f"cut{s}").read_bytes() for s in suffixes}

    def damage(rng: np.random.Generator) -> tuple[str, bytes]:
        suffix = suffixes[rng.integers(len(suffixes))]
        return suffix, _damage_bytes(rng, good[suffix], suffix in (".csv", ".tum"))

    return damage, _reader(folder)


def bags(folder: Path) -> Target:
    """A recording in an MCAP file, in the database of a ROS 2 bag, and in a ROS 1 bag."""
    good = {".mcap": write_recording(motion(), folder / "cut.mcap").read_bytes()}
    (database,) = write_recording(motion(), folder / "bag").glob("*.db3")
    good[".db3"] = database.read_bytes()
    good[".bag"] = _ros1(folder / "cut.bag")

    def damage(rng: np.random.Generator) -> tuple[str, bytes]:
        suffix = tuple(good)[rng.integers(len(good))]
        return suffix, _damage_bytes(rng, good[suffix], False)

    return damage, _reader(folder)


def _ros1(path: Path) -> bytes:
    """Return a ROS 1 bag of the recording."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    kind, types = "geometry_msgs/msg/PoseStamped", store.types
    pose, point, turn, header, time = (
        types[name]
        for name in (
            "geometry_msgs/msg/Pose",
            "geometry_msgs/msg/Point",
            "geometry_msgs/msg/Quaternion",
            "std_msgs/msg/Header",
            "builtin_interfaces/msg/Time",
        )
    )
    with Writer(path) as writer:
        connection = writer.add_connection("/pose", kind, typestore=store)
        for k, (place, (w, *xyz)) in enumerate(
            zip(motion().positions.tolist(), motion().quaternions.tolist(), strict=True)
        ):
            stamp = 10**9 + k * 10**7
            message = types[kind](
                header(k, time(*divmod(stamp, 10**9)), "world"), pose(point(*place), turn(*xyz, w))
            )
            writer.write(connection, stamp, store.serialize_ros1(message, kind))
    return path.read_bytes()


def _reader(folder: Path) -> Read:
    def read(given: tuple[str, bytes]) -> Iterable[Floats]:
        suffix, content = given
        path = folder / f"damaged{suffix}"
        path.write_bytes(content)
        for loaded in ns.load_demonstrations(path):
            yield from (loaded.times, loaded.positions, loaded.quaternions)
            yield from (loaded.linear_velocities, loaded.angular_velocities)

    return read


def _damage_data(rng: np.random.Generator, content: Any) -> None:
    """Change, remove, repeat or double one place in plain data."""
    at = content
    while True:
        keys = list(at) if isinstance(at, dict) else list(range(len(at)))
        if not keys:
            return
        key = keys[rng.integers(len(keys))]
        if not (isinstance(at[key], dict | list) and at[key] and rng.random() < 0.85):
            break
        at = at[key]
    match rng.integers(6):
        case 0 if isinstance(at, dict):
            del at[key]
        case 1 if isinstance(at, list):
            at.append(at[key])
        case 2 if isinstance(at[key], float):
            at[key] *= float(10.0 ** rng.integers(-20, 20))
        case 3 if isinstance(at[key], list) and len(at[key]) < 100:
            at[key] = at[key] * int(rng.integers(2, 40))
        case _:
            at[key] = VALUES[rng.integers(len(VALUES))]


def _damage_bytes(rng: np.random.Generator, content: bytes, is_text: bool) -> bytes:
    """Flip, cut out, repeat or overwrite some bytes."""
    damaged = bytearray(content)
    for _ in range(rng.integers(1, 5)):
        if not damaged:
            break
        at = int(rng.integers(len(damaged)))
        length = int(rng.integers(1, 1 + min(64, len(damaged) - at)))
        match rng.integers(5):
            case 0:
                del damaged[at : at + length]
            case 1:
                damaged[at:at] = damaged[at : at + length] * int(rng.integers(1, 4))
            case 2 if is_text:
                damaged[at:at] = CELLS[rng.integers(len(CELLS))]
            case 3:
                size = int(rng.choice([1, 2, 4, 8]))
                damaged[at : at + size] = bytes([int(rng.choice([0, 127, 255]))]) * size
            case _:
                damaged[at] = int(rng.integers(256))
    return bytes(damaged)


TARGETS: dict[str, Callable[[Path], Target]] = {
    "primitive": primitive,
    "tables": tables,
    "bags": bags,
}
"""By what the command line calls them."""
