"""The files that the pages take for granted, beside what ``noslip demo`` writes."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import noslip as ns
from motions import eased, sensed_blade

S = np.linspace(0, 1, 241)
U = eased(S)
REST, CUTS = 80, 4


def moved(
    x: object, y: object, z: object, yaw: object, *, duration: float = 3.0
) -> ns.PoseTrajectory:
    """Return a motion along x, y, z (m), turned about z (rad)."""
    path = np.column_stack([np.broadcast_to(axis, U.shape) for axis in (x, y, z)])
    return ns.PoseTrajectory(
        duration * S, path, Rotation.from_euler("z", np.broadcast_to(yaw, U.shape))
    )


def cut(depth: object = 0.0) -> ns.PoseTrajectory:
    """A curved cut of 10 cm, whose blade lags behind its path."""
    return moved(0.1 * U, 0.01 * np.sin(2 * np.pi * U), depth, 0.4 * np.cos(2 * np.pi * U))


def session() -> ns.PoseTrajectory:
    """Four cuts at 80 Hz; after each a rest, a fast way back above the table, and a rest."""
    one = cut()
    last, first = one.rotations[-1], one.rotations[0]
    share = U[::3]
    back = one.positions[-1] * (1 - share[:, None])
    back[:, 2] = 0.03 * np.sin(np.pi * share) ** 2
    turn = (first * last.inv()).as_rotvec()
    still = np.ones((REST, 1))
    positions = [one.positions, still * one.positions[-1], back, still * one.positions[0]]
    turned = Rotation.from_rotvec(share[:, None] * turn) * last
    turns = [one.rotations, last * Rotation.identity(REST), turned, first * Rotation.identity(REST)]
    path = np.concatenate(positions * CUTS)
    path = path + 1e-4 * np.random.default_rng(3).standard_normal(path.shape)
    return ns.PoseTrajectory(np.arange(len(path)) / 80, path, Rotation.concatenate(turns * CUTS))


def session_force() -> np.ndarray:
    """Force on the table in the session (N): while it cuts."""
    return np.tile(np.r_[np.full(len(U), 5.0), np.zeros(2 * REST + len(U[::3]))], CUTS)


MOTIONS: dict[str, Callable[[], ns.PoseTrajectory]] = {
    "cut": lambda: cut(-0.005 * np.sin(np.pi * U) ** 2),
    "sweep": lambda: moved(0.1 * U, 0.02 * U, 0.1 * (0.1 * U) ** 2, 0.2),
    "insertion": lambda: moved(0.1 * U, 0.005 * U**2, 0.0, 0.1 * U),
    "turn": lambda: moved(0.0, 0.0, -0.004 * U, -6 * np.pi * U),
    "arc": lambda: moved(0.1 * U, 0.02 * np.sin(np.pi * U), 0.0, 0.1),
    "disc": lambda: moved(0.1 * U, 0.0, 0.02, 0.0),
    "ball": lambda: moved(0.1 * U, 0.0, 0.02, 0.0),
    "scope": lambda: moved(0.01 * U, 0.0, 0.02 * U, 0.0),
    "carry": lambda: moved(0.1 * U, 0.05 * U, 0.05 * np.sin(np.pi * U), 0.2),
    "saw": lambda: moved(0.1 * U, 0.0, 0.0, 0.0),
    "corner": lambda: moved(0.3 * np.sin(U), 0.3 * (1 - np.cos(U)), 0.0, 0.8 * U),
    "door": lambda: moved(0.5 - 0.69 * np.cos(U), -0.7 * np.sin(U), 0.0, U),
    "push": lambda: moved(0.3 * np.sin(U), 0.3 * (1 - np.cos(U)), 0.0, 0.8 * U),
}

GOALS = """\
name,x,y,z,qw,qx,qy,qz,duration
near,0.050,0.010,0,1,0,0,0,4
far,0.055,0.012,0,0.995,0,0,0.0998,5
"""

RULES = '''\
"""Rules of the page "Rules of your own"."""
import numpy as np
import noslip as ns

LEAD = 0.00125

'''


def furnish(folder: Path, rules: str) -> None:
    """Write everything; ``noslip-demo`` is there already."""
    arm = (files("noslip.robots") / "panda.xml").read_text(encoding="utf-8")
    (folder / "my_arm.xml").write_text(arm.replace('site name="tool"', 'site name="scalpel_tip"'))
    for name, make in MOTIONS.items():
        ns.recordings.write_recording(make(), folder / f"{name}.csv")
    for seed in range(1, 4):
        ns.recordings.write_recording(sensed_blade(seed), folder / f"knife_{seed}.csv")
    ns.recordings.write_recording(session(), folder / "session.csv")
    add_column(folder / "session.csv", "fz", session_force())
    write_logs(folder)
    excision = folder / "noslip-demo" / "excision"
    for name, count in {"recordings": 4, "runs": 2, "cuts": 2}.items():
        (folder / name).mkdir()
        for i in range(1, count + 1):
            shutil.copy(excision / f"demonstration_{i}.csv", folder / name / f"cut_{i}.csv")
    shutil.copy(excision / "primitive_1.json", folder / "excision.json")
    (folder / "goals.csv").write_text(GOALS)
    (folder / "my_rules.py").write_text(RULES + rules)
    write_bag(folder / "run.bag", cut())
    write_lerobot(folder / "my_set", [cut()] * 4)
    write_robomimic(folder / "can.hdf5", [cut()] * 8)


def write_logs(folder: Path) -> None:
    """Write what a tracker exports, and a log in milliseconds and degrees."""
    cut().to_csv(folder / "tracker.csv")
    motion = cut()
    angles = motion.rotations.as_euler("ZYX", degrees=True)
    table = np.column_stack([1e3 * motion.times, 1e3 * motion.positions, angles])
    lines = [",".join(map(repr, row)) for row in table.tolist()]
    (folder / "log.csv").write_text("\n".join(["stamp,x,y,z,rz,ry,rx", *lines]))


def add_column(path: Path, name: str, values: np.ndarray) -> None:
    """Write a further column into a CSV."""
    header, *rows = path.read_text().splitlines()
    told = [f"{row},{value}" for row, value in zip(rows, values, strict=True)]
    path.write_text("\n".join([f"{header},{name}", *told]) + "\n")


def write_bag(path: Path, motion: ns.PoseTrajectory) -> None:
    """Write a ROS 1 bag: a knife in its base's frame on tf, and as stamped poses."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    tf = "tf2_msgs/msg/TFMessage"
    store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", tf))
    made = {name.rpartition("/")[2]: kind for name, kind in store.types.items()}
    made["Time"] = store.types["builtin_interfaces/msg/Time"]
    pose_type = "geometry_msgs/msg/PoseStamped"
    with Writer(path) as writer:
        links = writer.add_connection("/tf", tf, typestore=store)
        poses = writer.add_connection("/knife_pose", pose_type, typestore=store)
        for i, (time, place) in enumerate(zip(motion.times, motion.positions, strict=True)):
            stamp = 10**9 + round(time * 1e9)
            header = made["Header"](i, made["Time"](*divmod(stamp, 10**9)), "base")
            turn = made["Quaternion"](*motion.rotations[i].as_quat().tolist())
            shift = made["Transform"](made["Vector3"](*place.tolist()), turn)
            pose = made["Pose"](made["Point"](*place.tolist()), turn)
            message = made["TFMessage"]([made["TransformStamped"](header, "knife", shift)])
            writer.write(links, stamp, store.serialize_ros1(message, tf))
            message = made["PoseStamped"](header, pose)
            writer.write(poses, stamp, store.serialize_ros1(message, pose_type))


def write_lerobot(root: Path, motions: list[ns.PoseTrajectory]) -> None:
    """Write a LeRobot data set 2.1, an episode a file: position, then qx qy qz qw."""
    import pyarrow as pa
    import pyarrow.parquet as parquet

    def feature(dtype: str, width: int) -> dict[str, object]:
        return {"dtype": dtype, "shape": [width], "names": None}

    info = {
        "codebase_version": "v2.1",
        "fps": 80,
        "chunks_size": 1000,
        "data_path": "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet",
        "features": {
            "observation.state": feature("float32", 7),
            "timestamp": feature("float32", 1),
            "frame_index": feature("int64", 1),
            "episode_index": feature("int64", 1),
        },
    }
    (root / "meta").mkdir(parents=True)
    (root / "meta" / "info.json").write_text(json.dumps(info))
    (root / "data" / "chunk-000").mkdir(parents=True)
    lines = []
    for number, motion in enumerate(motions):
        state = np.hstack([motion.positions, motion.rotations.as_quat()]).astype(np.float32)
        frames = np.arange(len(motion))
        columns = {
            "observation.state": pa.FixedSizeListArray.from_arrays(pa.array(state.ravel()), 7),
            "timestamp": pa.array((frames / 80).astype(np.float32)),
            "frame_index": pa.array(frames),
            "episode_index": pa.array(np.full(len(motion), number)),
        }
        file = root / f"data/chunk-000/episode_{number:06d}.parquet"
        parquet.write_table(pa.table(columns), file)
        lines.append(json.dumps({"episode_index": number, "length": len(motion)}))
    (root / "meta" / "episodes.jsonl").write_text("\n".join(lines) + "\n")


def write_robomimic(path: Path, motions: list[ns.PoseTrajectory]) -> None:
    """Write a robomimic file."""
    import h5py

    with h5py.File(path, "w") as file:
        data = file.create_group("data")
        data.attrs["env_args"] = json.dumps({"env_kwargs": {"control_freq": 80}})
        for number, motion in enumerate(motions):
            observations = data.create_group(f"demo_{number}/obs")
            observations["robot0_eef_pos"] = motion.positions
            observations["robot0_eef_quat"] = motion.rotations.as_quat()
