"""``noslip shield``: what is written keeps the constraint, and all else is as it was."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import noslip as ns
from motions import planar_cut
from noslip.errors import InputError
from noslip.shielding.datasets import shield_each
from recordings.test_datasets import FPS, rows, table, write, write_info
from refusals import refusal

SINGLE = 1e-6
"""Slip that rounding to single precision may make here (m/s): a hundredth of a micrometer in a step
of 50 ms."""


@pytest.fixture
def cuts() -> list[ns.PoseTrajectory]:
    """Planar cuts that slip, of different lengths."""
    return [planar_cut(beside=0.01 * (k + 1), count=60 + k).resampled(rate=FPS) for k in range(3)]


def slip(motion: ns.PoseTrajectory) -> float:
    """Largest lateral speed in the middle of a step (m/s), from the poses alone."""
    return float(np.abs(motion.body_velocities[:, 1]).max())


@pytest.fixture
def data_set(cuts, tmp_path) -> Path:
    """A LeRobot data set of these, with an action and a gripper beside the pose."""
    root = tmp_path / "cuts"
    write_info(root, "v2.1", "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet")
    for k, cut in enumerate(cuts):
        put(root, k, cut)
    lines = [json.dumps({"episode_index": k}) for k in range(3)]
    (root / "meta" / "episodes.jsonl").write_text("\n".join(lines))
    return root


def put(root: Path, k: int, cut: ns.PoseTrajectory) -> None:
    """Write an episode."""
    part = rows(k, 0, len(cut))
    scalar_last = np.roll(cut.quaternions, -1, axis=1)
    gripper = np.linspace(0, 1, len(cut))[:, None]
    part["observation.state"] = np.hstack([cut.positions, scalar_last, gripper]).astype("f4")
    write(root / f"data/chunk-{k // 2:03d}/episode_{k:06d}.parquet", table([part]))


def test_a_recording_is_written_that_keeps_the_constraint(noslip, cuts, tmp_path) -> None:
    cut, out = cuts[0].to_csv(tmp_path / "cut.csv"), tmp_path / "kept.csv"
    code, told, _ = noslip("shield", cut, "--constraint", "blade", "--out", out)
    assert code == 0
    way = np.abs(cuts[0].body_velocities[:, 1]).sum() * cuts[0].period
    assert f"slips {1e3 * way:.3g} mm before, slips below 1e-9 m after" in told
    [kept] = ns.load_demonstrations(out)
    assert slip(kept) < 1e-12
    far = np.linalg.norm(kept.positions - cuts[0].positions, axis=1)
    assert f"(at most {1e3 * far.max():.3g})" in told
    assert far.max() < 1e-3


def test_each_of_several_files_is_written_under_its_name(noslip, cuts, tmp_path) -> None:
    given = [cut.to_csv(tmp_path / f"cut_{k}.csv") for k, cut in enumerate(cuts)]
    out = tmp_path / "kept"
    code, _, _ = noslip("shield", *given, "--each", "--constraint", "blade", "--out", out)
    assert code == 0
    assert sorted(file.name for file in out.iterdir()) == [file.name for file in given]
    for file in out.iterdir():
        assert slip(ns.PoseTrajectory.from_csv(file)) < 1e-12


def test_a_data_set_is_copied_with_motions_that_keep_the_constraint(
    noslip, data_set, cuts, tmp_path
) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    out = tmp_path / "kept"
    asked = ["--each", "--constraint", "blade", "--out", out, "--json"]
    code, told, _ = noslip("shield", data_set, *asked)
    assert code == 0
    rows_told = json.loads(told)["recordings"]
    kept = ns.load_demonstrations(out)
    for found, cut, row in zip(kept, cuts, rows_told, strict=True):
        assert slip(cut) > 100 * SINGLE > 100 * slip(found)
        distances = np.linalg.norm(found.positions - cut.positions, axis=1)
        assert row["moved_max"] == pytest.approx(distances.max(), abs=1e-6)
        angles = (found.rotations * cut.rotations.inv()).magnitude()
        assert row["turned_mean"] == pytest.approx(angles.mean(), abs=1e-6)
        assert row["slip_before"] > 100 * row["slip_after"]
    for name in ("chunk-000/episode_000000", "chunk-001/episode_000002"):
        before, after = (
            parquet.read_table(root / "data" / f"{name}.parquet") for root in (data_set, out)
        )
        assert before.drop("observation.state") == after.drop("observation.state")
        gripper = [np.array(t["observation.state"].to_pylist())[:, 7] for t in (before, after)]
        np.testing.assert_array_equal(*gripper)


def test_where_the_tool_must_hold_it_is_told_and_holds_no_longer_than_it_must(
    noslip, data_set, cuts, tmp_path
) -> None:
    """One episode has its blade across the path from its middle on."""
    across = cuts[1].rotations.as_rotvec()
    across[20:, 2] += np.pi / 2
    turned = ns.PoseTrajectory(cuts[1].times, cuts[1].positions, Rotation.from_rotvec(across))
    put(data_set, 1, turned)
    out = tmp_path / "kept"
    code, text, err = noslip("shield", data_set, "--each", "--constraint", "blade", "--out", out)
    assert code == 1
    assert [line.startswith("HELD") for line in text.splitlines()] == [False, True, False, False]
    assert "episode_000001: from 0 s on" in err
    for found in ns.load_demonstrations(out):
        assert slip(found) < SINGLE


def test_what_is_asked_wrongly_is_refused_and_nothing_is_written(
    noslip, data_set, cuts, tmp_path
) -> None:
    out, cut = tmp_path / "kept", cuts[0].to_csv(tmp_path / "cut.csv")

    def message(*asked: object) -> str:
        code, _, err = noslip("shield", *asked, "--out", out)
        assert code == 2
        assert not out.exists()
        return err

    blade = ("--constraint", "blade")
    assert "--constraint" in message(cut)
    assert "3 recordings; add --each" in message(data_set, *blade)
    assert "shield one at a time" in message(data_set, cut, "--each", *blade)
    assert "keeps its samples" in message(data_set, "--each", "--rate", "5", *blade)
    assert "keeps its samples" in message(data_set, "--each", "--lost", "drop", *blade)
    (tmp_path / "other").mkdir()
    again = cuts[1].to_csv(tmp_path / "other" / "cut.csv")
    assert "would be cut.csv, as" in message(cut, again, "--each", *blade)
    assert not [file for file in tmp_path.iterdir() if file.name.startswith(".")]
    out.write_text("mine")
    assert "is there already" in refusal(InputError, shield_each, data_set, [ns.Blade()], out)
