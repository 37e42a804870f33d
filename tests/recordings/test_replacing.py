"""Data sets with other poses in them: what was asked for is there, and all else as it was."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip._turns import Turn, parse_turn
from noslip.errors import RecordingError
from noslip.recordings.lerobot import replace_lerobot
from noslip.recordings.robomimic import replace_robomimic
from recordings.test_datasets import NAMES, robomimic, table, v21, v30, write  # noqa: F401

WAYS = (
    "wxyz", "xyzw", "rotvec", "rotvec:deg", "rpy:rad", "euler:ZYX:deg", "euler:zxz:rad",
    "matrix:rows", "matrix:columns", "6d", "6d:columns",
)  # fmt: skip


def written(way: str) -> Turn:
    turn = parse_turn(way)
    return replace(turn, degrees=False) if turn.angular and turn.degrees is None else turn


@pytest.mark.parametrize("way", WAYS)
@given(seed=st.integers(0, 1000))
def test_a_rotation_is_written_as_it_was_read_and_nearest_to_what_was_there(way, seed) -> None:
    turn, random = written(way), np.random.default_rng(seed)
    turns = Rotation.random(20, rng=random)
    near = 5 * random.normal(size=(20, turn.counts[0]))
    numbers = turn.numbers(turns.as_quat(scalar_first=True), near)
    read = Rotation.from_quat(turn.quaternions("here", numbers), scalar_first=True)
    assert (read * turns.inv()).magnitude().max() < 1e-12
    again = turn.numbers(read.as_quat(scalar_first=True), numbers)
    np.testing.assert_allclose(again, numbers, atol=1e-11)


@given(seed=st.integers(0, 1000))
def test_six_numbers_that_are_no_rotation_yet_are_made_one(seed) -> None:
    """As networks mean them: the first row keeps its direction, the second is turned to it."""
    random = np.random.default_rng(seed)
    numbers = random.normal(size=(20, 6))
    of = parse_turn("6d").quaternions("here", numbers)
    rows = Rotation.from_quat(of, scalar_first=True).as_matrix()
    first, second = numbers[:, :3], numbers[:, 3:]
    along = np.sum(rows[:, 0] * first, axis=1)
    np.testing.assert_allclose(along, np.linalg.norm(first, axis=1))
    np.testing.assert_allclose(np.sum(rows[:, 2] * second, axis=1), 0, atol=1e-12)
    assert np.all(np.sum(rows[:, 1] * second, axis=1) > 0)


def moved(trajectory: ns.PoseTrajectory) -> ns.PoseTrajectory:
    """The same motion elsewhere, seen from elsewhere."""
    turn = Rotation.from_rotvec([0.1, -0.2, 0.3])
    return ns.PoseTrajectory(
        trajectory.times,
        turn.apply(trajectory.positions) + [0.5, -0.1, 0.2],
        turn * trajectory.rotations,
        name=trajectory.name,
    )


def assert_same_motion(found: ns.PoseTrajectory, wanted: ns.PoseTrajectory) -> None:
    """In single precision, as data sets are."""
    np.testing.assert_allclose(found.positions, wanted.positions, atol=1e-6)
    assert (found.rotations * wanted.rotations.inv()).magnitude().max() < 1e-6


def files_of(root: Path) -> dict[str, bytes]:
    return {str(f.relative_to(root)): f.read_bytes() for f in root.rglob("*") if f.is_file()}


@pytest.fixture(params=["v21", "v30"])
def data_set(request: Any) -> Path:
    """A LeRobot data set with videos, and with statistics of its columns."""
    root = request.getfixturevalue(request.param)
    states = np.vstack([all_states(root, k) for k in range(3)])
    (root / "videos").mkdir()
    (root / "videos" / "front.mp4").write_bytes(b"frames")
    said = {"observation.state": statistics(states), "action": {"mean": [1.0, 2.0]}}
    (root / "meta" / "stats.json").write_text(json.dumps(said))
    each = [statistics(all_states(root, k)) for k in range(3)]
    if request.param == "v21":
        lines = [
            {"episode_index": k, "stats": {"observation.state": e}} for k, e in enumerate(each)
        ]
        text = "".join(json.dumps(line) + "\n" for line in lines)
        (root / "meta" / "episodes_stats.jsonl").write_text(text)
    else:
        import pyarrow.parquet as pq

        file = root / "meta/episodes/chunk-000/file-000.parquet"
        content = {k: np.asarray(v) for k, v in pq.read_table(file).to_pydict().items()}
        for name in ("mean", "max", "q90", "count"):
            content[f"stats/observation.state/{name}"] = np.array([e[name] for e in each])
        write(file, table([content]))
    return root


def all_states(root: Path, number: int) -> np.ndarray:
    import pyarrow.parquet as pq

    found = [pq.read_table(file).to_pydict() for file in sorted((root / "data").rglob("*.parquet"))]
    rows = [
        state
        for one in found
        for state, of in zip(one["observation.state"], one["episode_index"], strict=True)
        if of == number
    ]
    return np.array(rows)


def statistics(states: np.ndarray) -> dict[str, Any]:
    of = {"min": np.min, "max": np.max, "mean": np.mean, "std": np.std}
    said = {name: f(states, axis=0).tolist() for name, f in of.items()}
    return said | {"q90": np.quantile(states, 0.9, axis=0).tolist(), "count": [len(states)]}


def test_a_lerobot_data_set_has_the_new_poses_and_all_else_as_before(data_set, tmp_path) -> None:
    before = ns.load_demonstrations(data_set)
    new = {trajectory.name: moved(trajectory) for trajectory in before[1:]}
    out = tmp_path / "out"
    replace_lerobot(data_set, out, new)
    after = ns.load_demonstrations(out)
    assert_same_motion(after[0], before[0])
    for found, old in zip(after[1:], before[1:], strict=True):
        assert_same_motion(found, new[old.name])
    import pyarrow.parquet as pq

    olds, news = files_of(data_set), files_of(out)
    assert set(olds) == set(news)
    for name in olds:
        if name.startswith("data/"):
            one, other = pq.read_table(data_set / name), pq.read_table(out / name)
            assert one.schema.equals(other.schema, check_metadata=True)
            assert one.drop("observation.state") == other.drop("observation.state")
        elif "stats" not in name and "episodes" not in name:
            assert olds[name] == news[name]
    for number in range(3):
        gripper = NAMES.index("gripper")
        np.testing.assert_array_equal(
            all_states(out, number)[:, gripper], all_states(data_set, number)[:, gripper]
        )


def test_a_data_set_of_links_to_what_is_read_only_becomes_one_of_files(data_set, tmp_path) -> None:
    """As a hub's cache keeps them."""
    new = {t.name: moved(t) for t in ns.load_demonstrations(data_set)}
    for k, file in enumerate([f for f in data_set.rglob("*") if f.is_file()]):
        blob = tmp_path / f"blob_{k}"
        file.rename(blob).chmod(0o444)
        file.symlink_to(blob)
    before = {f.name: f.read_bytes() for f in tmp_path.glob("blob_*")}
    out = tmp_path / "out"
    replace_lerobot(data_set, out, new)
    for found, wanted in zip(ns.load_demonstrations(out), new.values(), strict=True):
        assert_same_motion(found, wanted)
    assert not any(file.is_symlink() for file in out.rglob("*"))
    assert {f.name: f.read_bytes() for f in tmp_path.glob("blob_*")} == before


def test_a_lerobot_data_set_says_what_is_true_of_its_columns(data_set, tmp_path) -> None:
    out = tmp_path / "out"
    new = {t.name: moved(t) for t in ns.load_demonstrations(data_set, episode=[0, 2])}
    replace_lerobot(data_set, out, new)
    said = json.loads((out / "meta" / "stats.json").read_text())
    whole = statistics(np.vstack([all_states(out, k) for k in range(3)]))
    for name, values in whole.items():
        np.testing.assert_allclose(said["observation.state"][name], values, atol=1e-6)
    assert said["action"] == {"mean": [1.0, 2.0]}
    each = [statistics(all_states(out, k)) for k in range(3)]
    if (file := out / "meta" / "episodes_stats.jsonl").exists():
        lines = file.read_text().splitlines()
        told = [json.loads(line)["stats"]["observation.state"] for line in lines]
    else:
        import pyarrow.parquet as pq

        rows = pq.read_table(out / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
        prefix = "stats/observation.state/"
        told = [{k.removeprefix(prefix): v for k, v in r.items() if prefix in k} for r in rows]
    for one, other in zip(told, each, strict=True):
        for name, values in one.items():
            np.testing.assert_allclose(values, other[name], atol=1e-6)


@pytest.mark.parametrize("text", ["{", '{"observation.state": 3}'])
def test_statistics_that_are_none_are_refused(data_set, tmp_path, text) -> None:
    (data_set / "meta" / "stats.json").write_text(text)
    new = {t.name: moved(t) for t in ns.load_demonstrations(data_set)}
    with pytest.raises(RecordingError, match="meta: cannot be read as statistics of LeRobot"):
        replace_lerobot(data_set, tmp_path / "out", new)


def test_a_robomimic_file_has_the_new_poses_and_all_else_as_before(robomimic, tmp_path) -> None:  # noqa: F811
    h5py = pytest.importorskip("h5py")
    with h5py.File(robomimic, "a") as file:
        for demo in file["data"].values():
            for key in ("robot0_eef_pos", "robot0_eef_quat"):
                here = demo["obs"][key][:]
                demo[f"next_obs/{key}"] = np.vstack([here[1:], here[-1:] + 1])
    before = ns.load_demonstrations(robomimic)
    new = {trajectory.name: moved(trajectory) for trajectory in before[:5]}
    out = tmp_path / "out.hdf5"
    replace_robomimic(robomimic, out, new)
    after = ns.load_demonstrations(out)
    for found, old in zip(after, before, strict=True):
        assert_same_motion(found, new.get(old.name, old))
    with h5py.File(robomimic) as one, h5py.File(out) as other:
        assert other["data"].attrs["env_args"] == one["data"].attrs["env_args"]
        for name, demo in other["data"].items():
            old = one["data"][name]
            np.testing.assert_array_equal(demo["obs/image"], old["obs/image"])
            for key in ("robot0_eef_pos", "robot0_eef_quat"):
                assert demo["obs"][key].dtype == np.float32
                if int(name.removeprefix("demo_")) < 5:
                    np.testing.assert_array_equal(demo["next_obs"][key][:-1], demo["obs"][key][1:])
                    np.testing.assert_array_equal(demo["next_obs"][key][-1], demo["obs"][key][-1])
                else:
                    np.testing.assert_array_equal(demo["next_obs"][key], old["next_obs"][key])


def test_actions_of_a_robomimic_file_are_poses_too_where_they_are_asked_for(
    robomimic,  # noqa: F811
    tmp_path,
) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(robomimic, "a") as file:
        for demo in file["data"].values():
            turns = Rotation.from_quat(demo["obs/robot0_eef_quat"][:])
            six = turns.as_matrix()[:, :2].reshape(30, 6)
            demo["actions"] = np.hstack([demo["obs/robot0_eef_pos"], six, np.ones((30, 1))])
    asked = {"columns": "actions[0:9]", "rotation": "6d"}
    before = ns.load_demonstrations(robomimic, **asked)
    new = {trajectory.name: moved(trajectory) for trajectory in before}
    out = tmp_path / "out.hdf5"
    replace_robomimic(robomimic, out, new, **asked)
    for found, wanted in zip(ns.load_demonstrations(out, **asked), new.values(), strict=True):
        assert_same_motion(found, wanted)
    with h5py.File(out) as file:
        assert np.all(file["data/demo_3/actions"][:, 9] == 1)


def test_what_cannot_be_replaced_is_refused(robomimic, tmp_path) -> None:  # noqa: F811
    h5py = pytest.importorskip("h5py")
    with h5py.File(robomimic, "a") as file:
        for demo in file["data"].values():
            demo["obs/pose"] = np.tile(np.eye(4).ravel(), (30, 1))
    asked = {"columns": "pose", "rotation": "matrix:rows"}
    new = {t.name: t for t in ns.load_demonstrations(robomimic, **asked)}
    with pytest.raises(RecordingError, match="matrices of 16 numbers are read, but not replaced"):
        replace_robomimic(robomimic, tmp_path / "out.hdf5", new, **asked)
