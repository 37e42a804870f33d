"""LeRobot and robomimic data sets, laid out by hand as their specifications say."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from noslip import PoseTrajectory, load_demonstrations

FPS = 20
NAMES = ["x", "y", "z", "qx", "qy", "qz", "qw", "gripper"]


def episode(number: int, samples: int = 30) -> tuple[np.ndarray, np.ndarray]:
    """Return positions and quaternions, scalar last, in single precision as data sets are."""
    t = np.arange(samples) / FPS + number
    positions = np.column_stack([np.sin(t), t, 0.1 * number + 0 * t]).astype(np.float32)
    turns = Rotation.from_rotvec(np.column_stack([np.sin(t), t, 0.2 * t**2]))
    return positions, turns.as_quat().astype(np.float32)


def assert_episode(trajectory: PoseTrajectory, number: int, samples: int = 30) -> None:
    positions, scalar_last = episode(number, samples)
    np.testing.assert_array_equal(trajectory.positions, positions.astype(float))
    turn = (trajectory.rotations * Rotation.from_quat(scalar_last).inv()).magnitude()
    np.testing.assert_allclose(turn, 0, atol=1e-7)
    np.testing.assert_array_equal(trajectory.times, np.arange(samples) / FPS)
    assert trajectory.is_uniform


# -------------------------------------------------------------------- LeRobot


def rows(number: int, first: int, samples: int = 30) -> dict[str, Any]:
    """Return one episode's rows as LeRobot stores them."""
    positions, scalar_last = episode(number, samples)
    gripper = np.zeros((samples, 1), dtype=np.float32)
    frames = np.arange(samples)
    return {
        "observation.state": np.hstack([positions, scalar_last, gripper]),
        "action": np.zeros((samples, 2), dtype=np.float32),
        "timestamp": (frames / FPS).astype(np.float32),
        "frame_index": frames,
        "episode_index": np.full(samples, number),
        "index": first + frames,
        "task_index": np.zeros(samples, dtype=int),
    }


def table(parts: list[dict[str, Any]]) -> Any:
    pa = pytest.importorskip("pyarrow", reason="needs the extra tables")
    columns = {}
    for key in parts[0]:
        values = np.concatenate([part[key] for part in parts])
        if values.ndim == 1:
            columns[key] = pa.array(values)
        else:
            flat = pa.array(values.ravel())
            columns[key] = pa.FixedSizeListArray.from_arrays(flat, values.shape[1])
    return pa.table(columns)


def write(path: Path, content: Any) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="needs the extra tables")
    path.parent.mkdir(parents=True, exist_ok=True)
    parquet.write_table(content, path)


def write_info(root: Path, version: str, data_path: str, names: Any = NAMES, **more: Any) -> None:
    def feature(dtype: str, width: int, names: Any = None) -> dict[str, Any]:
        return {"dtype": dtype, "shape": [width], "names": names}

    info = {
        "codebase_version": version,
        "robot_type": "panda",
        "fps": FPS,
        "chunks_size": 2,
        "data_path": data_path,
        "features": {
            "observation.state": feature("float32", 8, names),
            "action": feature("float32", 2, ["left", "right"]),
            "observation.image": {"dtype": "video", "shape": [3, 96, 96], "names": None},
            "timestamp": feature("float32", 1),
            "frame_index": feature("int64", 1),
            "episode_index": feature("int64", 1),
        },
    }
    (root / "meta").mkdir(parents=True, exist_ok=True)
    (root / "meta" / "info.json").write_text(json.dumps(info | more))


@pytest.fixture
def v21(tmp_path: Path) -> Path:
    """Three episodes in chunks of two, a file each."""
    root = tmp_path / "v21"
    write_info(root, "v2.1", "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet")
    for number in range(3):
        write(
            root / f"data/chunk-{number // 2:03d}/episode_{number:06d}.parquet",
            table([rows(number, 30 * number)]),
        )
    lines = [json.dumps({"episode_index": k, "tasks": ["cut"], "length": 30}) for k in range(3)]
    (root / "meta" / "episodes.jsonl").write_text("\n".join(lines) + "\n")
    return root


@pytest.fixture
def v30(tmp_path: Path) -> Path:
    """Three episodes, of which two share a file."""
    root = tmp_path / "v30"
    write_info(root, "v3.0", "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet")
    write(root / "data/chunk-000/file-000.parquet", table([rows(0, 0), rows(1, 30, 25)]))
    write(root / "data/chunk-000/file-001.parquet", table([rows(2, 55)]))
    episodes = {
        "episode_index": np.arange(3),
        "data/chunk_index": np.zeros(3, dtype=int),
        "data/file_index": np.array([0, 0, 1]),
        "dataset_from_index": np.array([0, 30, 55]),
        "dataset_to_index": np.array([30, 55, 85]),
        "length": np.array([30, 25, 30]),
    }
    write(root / "meta/episodes/chunk-000/file-000.parquet", table([episodes]))
    return root


def test_lerobot_2_by_names_of_info(v21) -> None:
    found = load_demonstrations(v21)
    assert [trajectory.name for trajectory in found] == [f"{v21}/episode_{k:06d}" for k in range(3)]
    for number, trajectory in enumerate(found):
        assert_episode(trajectory, number)


def test_lerobot_3_shares_files(v30) -> None:
    for number, trajectory in enumerate(load_demonstrations(v30)):
        assert_episode(trajectory, number, samples=25 if number == 1 else 30)


@pytest.mark.parametrize(
    "columns",
    [
        "observation.state[0:3,6,3:6]",
        "observation.state[:3], observation.state[qw], observation.state[3:6]",
        "observation.state[x,y,z,qw,qx,qy,qz]",
    ],
)
def test_lerobot_columns_and_episodes_by_option(v30, columns) -> None:
    found = load_demonstrations(v30, episode=[2, 0], columns=columns)
    for number, trajectory in zip([2, 0], found, strict=True):
        assert_episode(trajectory, number)
    [one] = load_demonstrations(v30, episode=np.int64(1))
    assert_episode(one, 1, samples=25)


def test_lerobot_names_in_a_dictionary(v21) -> None:
    path = "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet"
    write_info(v21, "v2.1", path, names={"motors": NAMES})
    assert_episode(load_demonstrations(v21, episode=1)[0], 1)


def test_lerobot_seven_columns(tmp_path) -> None:
    root = tmp_path / "scalars"
    write_info(root, "v2.1", "data/{episode_index}.parquet", names=None)
    info = json.loads((root / "meta" / "info.json").read_text())
    part = rows(0, 0)
    for name, values in zip(NAMES, part["observation.state"].T, strict=True):
        part[name] = values
        info["features"][name] = {"dtype": "float32", "shape": [1], "names": None}
    (root / "meta" / "info.json").write_text(json.dumps(info))
    (root / "meta" / "episodes.jsonl").write_text('{"episode_index": 0}')
    write(root / "data" / "0.parquet", table([part]))
    assert_episode(load_demonstrations(root)[0], 0)


def test_lerobot_stamps_that_are_not_even_count(v21) -> None:
    part = rows(0, 0)
    part["timestamp"] = part["timestamp"] * np.float32(1.01)
    write(v21 / "data/chunk-000/episode_000000.parquet", table([part]))
    [trajectory] = load_demonstrations(v21, episode=0)
    np.testing.assert_array_equal(trajectory.times, part["timestamp"].astype(float))


def test_lerobot_refusals(v21, refusal) -> None:
    write_info(v21, "v2.1", "data/{episode_index}.parquet", names=None)
    message = refusal(v21)
    assert 'columns="..." (--columns)' in message
    assert "observation.state[8], action[2] (left, right), 'timestamp'" in message
    assert "no column pose; found" in refusal(v21, columns="pose")
    assert "hold 2 numbers; a pose has 7" in refusal(v21, columns="action", rotation="wxyz")
    assert "nothing at [8]; it is observation.state[8]" in refusal(
        v21, columns="observation.state[8]"
    )
    state = "observation.state[0:3,6,3:6]"
    assert "no episode 7; there are 3 episodes, 0 to 2" in refusal(v21, columns=state, episode=7)
    assert "data/0.parquet: no such file" in refusal(v21, columns=state)
    write_info(v21, "v2.1", "data/{chunk}.parquet")
    assert "is not a template this version knows" in refusal(v21)
    write_info(v21, "v1.6", "data/{episode_index}.parquet")
    assert "codebase_version v1.6 is not known" in refusal(v21)
    write_info(v21, "v2.1", "data/{episode_index}.parquet", fps=0)
    assert "fps must be positive" in refusal(v21)
    (v21 / "meta" / "info.json").write_text("{")
    assert "not JSON" in refusal(v21)
    (v21 / "meta" / "info.json").write_text("[]")
    assert "codebase_version is missing" in refusal(v21)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda part: part["observation.state"].__setitem__((7, 0), np.nan), "sample 7, position"),
        (lambda part: part["observation.state"].__setitem__((7, slice(3, 7)), 0), "is zero"),
        (lambda part: part["timestamp"].__setitem__(7, 0.2), "time runs backwards"),
        (lambda part: part["episode_index"].__setitem__(slice(None), 5), "no frames in"),
        (lambda part: part.__setitem__("observation.state", np.zeros((30, 4))), "holds 4 numbers"),
    ],
)
def test_lerobot_bad_rows(v21, refusal, change: Callable[[dict], None], words) -> None:
    part = rows(0, 0)
    change(part)
    write(v21 / "data/chunk-000/episode_000000.parquet", table([part]))
    assert words in refusal(v21, episode=0)


def test_lerobot_incomplete(v30, refusal) -> None:
    (v30 / "meta/episodes/chunk-000/file-000.parquet").write_bytes(b"PAR1")
    assert "cannot be read as a table" in refusal(v30)
    (v30 / "meta/episodes/chunk-000/file-000.parquet").unlink()
    assert "no tables in meta/episodes" in refusal(v30)


# -------------------------------------------------------------------- robomimic


@pytest.fixture
def robomimic(tmp_path: Path) -> Path:
    """Eleven demonstrations, so that their order by name is not that by number."""
    h5py = pytest.importorskip("h5py", reason="needs the extra hdf5")
    path = tmp_path / "can.hdf5"
    with h5py.File(path, "w") as file:
        data = file.create_group("data")
        data.attrs["env_args"] = json.dumps({"env_kwargs": {"control_freq": FPS}})
        for number in range(11):
            positions, scalar_last = episode(number)
            observations = data.create_group(f"demo_{number}/obs")
            observations["robot0_eef_pos"] = positions
            observations["robot0_eef_quat"] = scalar_last
            observations["image"] = np.zeros((30, 2, 2, 3), dtype=np.uint8)
    return path


def edit(path: Path, change: Callable[[Any], None]) -> None:
    import h5py

    with h5py.File(path, "a") as file:
        change(file)


def test_robomimic(robomimic) -> None:
    found = load_demonstrations(robomimic)
    assert [Path(trajectory.name).name for trajectory in found] == [f"demo_{k}" for k in range(11)]
    for number, trajectory in enumerate(found):
        assert_episode(trajectory, number)
    [one] = load_demonstrations(robomimic, episode=10)
    assert_episode(one, 10)


def test_robomimic_rate_and_names_by_option(robomimic) -> None:
    def rename(file: Any) -> None:
        del file["data"].attrs["env_args"]
        for demo in file["data"].values():
            demo["obs"].move("robot0_eef_pos", "pos")

    edit(robomimic, rename)
    columns = "pos,robot0_eef_quat[3,0,1,2]"
    [one] = load_demonstrations(robomimic, episode=4, columns=columns, rate=2 * FPS)
    np.testing.assert_array_equal(one.times, np.arange(30) / (2 * FPS))


def test_robomimic_refusals(robomimic, refusal, tmp_path) -> None:
    assert "no episode 11; there are 11 episodes, 0 to 10" in refusal(robomimic, episode=11)
    found = "robot0_eef_pos[3], robot0_eef_quat[4]"
    assert f"no column pos; found {found}" in refusal(robomimic, columns="pos")
    assert "rate must be positive" in refusal(robomimic, rate=-1.0)

    def shorten(file: Any) -> None:
        del file["data/demo_0/obs/robot0_eef_pos"]
        file["data/demo_0/obs/robot0_eef_pos"] = np.zeros((5, 3))
        del file["data/demo_1/obs"]
        file["data/demo_2/obs/robot0_eef_quat"][7] = 0
        file["data/demo_3/obs/robot0_eef_pos"][7] = np.nan
        del file["data"].attrs["env_args"]

    edit(robomimic, shorten)
    assert "no control_freq" in refusal(robomimic)
    assert "different lengths" in refusal(robomimic, episode=0, rate=20.0)
    assert "demo_1: no observations" in refusal(robomimic, episode=1, rate=20.0)
    assert "demo_2: sample 7, quaternion: the quaternion is zero" in refusal(
        robomimic, episode=2, rate=20.0
    )
    assert "demo_3: sample 7, position" in refusal(robomimic, episode=3, rate=20.0)
    other = tmp_path / "other.h5"
    edit(other, lambda file: file.create_group("weights"))
    assert "no groups data/demo_0 and so on, found 'weights'" in refusal(other)
    other.write_bytes(b"no HDF5")
    assert "cannot be read as HDF5" in refusal(other)


# -------------------------------------------------------------------- end effectors and joints


def lerobot(root: Path, state: np.ndarray, names: Any) -> Path:
    """A data set of one episode whose state holds something else."""
    path = "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet"
    write_info(root, "v2.1", path)
    info = json.loads((root / "meta" / "info.json").read_text())
    for key in ("observation.state", "action"):
        info["features"][key] |= {"shape": [state.shape[1]], "names": names}
    (root / "meta" / "info.json").write_text(json.dumps(info))
    states = state.astype(np.float32)
    content = rows(0, 0) | {"observation.state": states, "action": states + 7}
    write(root / "data/chunk-000/episode_000000.parquet", table([content]))
    (root / "meta" / "episodes.jsonl").write_text('{"episode_index": 0}\n')
    return root


NESTED = [["ee.x", "ee.y", "ee.z", "ee.wx", "ee.wy", "ee.wz", "ee.gripper_pos"]]


@pytest.mark.parametrize("names", [NESTED[0], NESTED, {"motors": NESTED[0]}])
def test_lerobots_end_effector(tmp_path, names) -> None:
    positions, scalar_last = episode(0)
    vector = Rotation.from_quat(scalar_last).as_rotvec()
    state = np.column_stack([positions, vector, 0 * vector[:, 0]])
    [found] = load_demonstrations(lerobot(tmp_path / "ee", state, names))
    np.testing.assert_allclose(found.positions, positions, atol=1e-7)
    assert (found.rotations * Rotation.from_quat(scalar_last).inv()).magnitude().max() < 1e-6


def test_several_arms_are_asked_for(tmp_path, refusal) -> None:
    positions, scalar_last = episode(0)
    arm = [f"eef_pos_{a}" for a in "xyz"] + [f"eef_quat_{a}" for a in "xyzw"]
    names = [f"{side}_{part}" for side in ("left", "right") for part in arm]
    state = np.hstack([positions + 1, scalar_last, positions, scalar_last])
    root = lerobot(tmp_path / "arms", state, names)
    message = refusal(root)
    assert "which pose? observation_state_left_eef and observation_state_right_eef" in message
    [found] = load_demonstrations(root, columns="observation.state.right_eef")
    assert_episode(found, 0)


def test_joints_become_poses_through_a_robot(tmp_path, refusal, noslip) -> None:
    robots = pytest.importorskip("noslip.robots", reason="needs the extra robots")
    panda = robots.panda()
    t = np.arange(30)[:, None] / FPS
    joints = (0.3 * np.sin(t + np.arange(7)) + [0, 0, 0, -1.5, 0, 1.5, 0]).astype(np.float32)
    places, turns = panda.forward(joints.astype(float))
    names = [f"joint_{k}.pos" for k in range(7)]
    root = lerobot(tmp_path / "joints", joints, names)
    assert "it holds joints" in refusal(root)
    assert "--robot" in refusal(root)
    columns = ",".join(f"q{k}" for k in range(1, 8))
    body = np.column_stack([t[:, 0], joints.astype(float)])
    text = "\n".join(",".join(map(repr, row)) for row in body.tolist())
    (tmp_path / "joints.csv").write_text(f"t,{columns}\n{text}\n")
    for source in (root, tmp_path / "joints.csv"):
        [found] = load_demonstrations(source, robot=panda)
        np.testing.assert_allclose(found.positions, places, atol=1e-12)
        assert (found.rotations * turns.inv()).magnitude().max() < 1e-7
    told = noslip("convert", tmp_path / "joints.csv", "--robot", "panda")
    assert told.code == 0
    assert "q7: joints of panda, rad" in told.out
    assert "where are the 7 joints of panda?" in refusal(root, robot=panda, columns="action[0:6]")


@pytest.mark.recordings
def test_a_real_data_set_of_joints_says_so(recordings, refusal) -> None:
    root = recordings / "real" / "lerobot_v21_g1"
    if not root.is_dir():
        pytest.skip("the real recordings (../shared/data/real) are absent")
    assert "it holds joints" in refusal(root)


def h5(path: Path, of: dict[str, Any], **attributes: str) -> Path:
    h5py = pytest.importorskip("h5py", reason="needs the extra hdf5")
    with h5py.File(path, "w") as file:
        for name, values in of.items():
            file[name] = values
        if attributes:
            file["data"].attrs.update(attributes)
    return path


def test_liberos_observations(tmp_path) -> None:
    positions, scalar_last = episode(1)
    obs = "data/demo_0/obs"
    vector = Rotation.from_quat(scalar_last).as_rotvec()
    of = {f"{obs}/ee_pos": positions, f"{obs}/ee_ori": vector, f"{obs}/gripper": vector[:, :2]}
    env = json.dumps({"env_kwargs": {"control_freq": FPS}})
    [found] = load_demonstrations(h5(tmp_path / "libero.hdf5", of, env_args=env))
    assert_episode(found, 1)


def test_droids_trajectory(tmp_path) -> None:
    positions, scalar_last = episode(2)
    angles = Rotation.from_quat(scalar_last).as_euler("xyz")
    stamps = 1_690_000_000_000 + 50 * np.arange(30)
    state = "observation/robot_state"
    of = {
        f"{state}/cartesian_position": np.hstack([positions, angles]),
        f"{state}/joint_positions": np.zeros((30, 7)),
        "observation/timestamp/control/step_start": stamps,
        "action/cartesian_position": np.zeros((30, 6)),
    }
    [found] = load_demonstrations(h5(tmp_path / "trajectory.h5", of))
    np.testing.assert_allclose(found.times - found.times[0], np.arange(30) / FPS, atol=1e-6)
    np.testing.assert_allclose(found.positions, positions, atol=1e-7)
    assert (found.rotations * Rotation.from_quat(scalar_last).inv()).magnitude().max() < 1e-6


def test_columns_of_any_hdf5_and_alohas_joints(tmp_path, refusal) -> None:
    positions, scalar_last = episode(0)
    t = np.arange(30) / FPS
    of = {"log/time": t, "log/tool": np.hstack([positions, scalar_last])}
    file = h5(tmp_path / "log.h5", of)
    [found] = load_demonstrations(file, columns="log/tool", rotation="xyzw")
    assert_episode(found, 0)
    of = dict(zip("xyz", positions.T, strict=True)) | {"t": t}
    of |= dict(zip(["qx", "qy", "qz", "qw"], scalar_last.T, strict=True))
    [found] = load_demonstrations(h5(tmp_path / "columns.h5", of))
    assert_episode(found, 0)
    aloha = {"observations/qpos": np.zeros((30, 14)), "action": np.zeros((30, 14))}
    assert "it holds joints" in refusal(h5(tmp_path / "episode_0.hdf5", aloha))
