"""What other libraries are given and how it is judged; that they do what the table says of them."""

from __future__ import annotations

import importlib
import json
import sys
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from benchmarks.example import MOVED_GOAL
from benchmarks.side_by_side import job, optimizers, ours, primitives, published, tracking
from noslip import PoseTrajectory

command = importlib.import_module("benchmarks.side_by_side.__main__")
FEW = 60
BOTH = job.jobs(FEW)
LEAD = replace(tracking.BEST, ahead=0.01)
"""With steps seventeen times as long."""


def straight(turn: float) -> PoseTrajectory:
    """Go along x for 1 m in 1 s, turned about z all the way."""
    u = np.linspace(0.0, 1.0, 21)
    return PoseTrajectory(
        u, u[:, None] * [1.0, 0.0, 0.0], Rotation.from_euler("z", np.full(21, turn))
    )


@given(st.floats(-1.5, 1.5))
@settings(max_examples=20, deadline=None)
def test_slip_at_the_ends_of_steps_is_the_speed_across(turn: float) -> None:
    assert job.slip_at_ends(straight(turn)) == pytest.approx(abs(np.sin(turn)), abs=1e-9)


def test_what_is_measured_is_against_the_demonstration_and_the_goal() -> None:
    _, moved = BOTH
    row = job.judged("mine", "1", "as given", moved, lambda: moved.given)
    assert row.merit.position_rms == 0
    assert row.missed == pytest.approx(
        np.linalg.norm(np.array(MOVED_GOAL) - moved.given.positions[-1])
    )
    assert row.job == job.MOVED
    assert "move" not in row.to_dict()


def test_times_are_taken_in_turn_and_not_of_what_takes_minutes() -> None:
    made: list[str] = []

    def row(name: str, first: float) -> job.Row:
        return job.Row(name, "", "", first=first, seconds=first, move=lambda: made.append(name))

    rows = [row("a", 9.0), row("b", 100.0), row("c", 9.0), job.Row("d", "", "", skipped="absent")]
    found = job.timed(rows, 2)
    assert made == ["a", "c", "a", "c"]
    assert found[1].seconds == 100.0
    assert all(each.seconds < 1 for each in (found[0], found[2]))
    assert found[3] == rows[3]


@given(st.floats(0.01, 0.5), st.integers(3, 50))
@settings(max_examples=20, deadline=None)
def test_points_ahead_are_on_the_path_or_straight_beyond(ahead: float, count: int) -> None:
    u = np.linspace(0.0, 1.0, count)
    ends = np.column_stack([u, 0 * u, 0 * u])
    found = tracking.points_ahead(ends, ahead)
    np.testing.assert_allclose(found[:, 0], u + ahead, atol=1e-12)
    np.testing.assert_array_equal(found[:, 1:], 0)


def test_points_ahead_pass_samples_at_rest() -> None:
    resting = np.repeat([[0.0, 0, 0], [0.5, 0, 0], [1.0, 0, 0]], 3, axis=0)
    found = tracking.points_ahead(resting, 0.25)
    np.testing.assert_allclose(found[:, 0], np.repeat([0.25, 0.75, 1.25], 3))


def test_the_notebooks_motion_ends_at_rest() -> None:
    path = job.notebook().given
    assert path.duration == BOTH[0].given.duration
    np.testing.assert_allclose(path.positions[-1], [0, 1, 0], atol=1e-15)
    assert np.linalg.norm(path.positions[-1] - path.positions[-2]) < 1.2e-5


@pytest.mark.parametrize("library", list(tracking.PACKAGES))
def test_what_is_steered_keeps_to_the_path_and_slips_little(library: str) -> None:
    pytest.importorskip(library, reason=f"{library} is not installed")
    fair, _ = job.jobs(100)
    motion = tracking.follow(library, fair.given, LEAD)
    off = np.linalg.norm(motion.positions - fair.given.positions, axis=1)
    assert off.max() < 2e-3
    slip = np.abs(motion.step_middles()[2].inv().apply(motion.step_velocities()[0])[:, 1])
    assert slip.max() < 0.05 * np.linalg.norm(motion.linear_velocities, axis=1).max()


def test_a_pose_is_six_numbers_and_back() -> None:
    here, moved = BOTH
    values = primitives.coordinates(here.given)
    back = primitives.motion_of(here, here.given.times, values)
    np.testing.assert_allclose(back.positions, here.given.positions)
    assert (back.rotations * here.given.rotations.inv()).magnitude().max() < 1e-12
    np.testing.assert_allclose(primitives.goal_of(moved)[:3], MOVED_GOAL)
    np.testing.assert_allclose(primitives.goal_of(here), values[-1], atol=1e-12)


@pytest.mark.parametrize("library", [name for name in primitives.LIBRARIES if name != "dmpbbo"])
def test_libraries_reach_another_end_and_slip(library: str) -> None:
    known = primitives.LIBRARIES[library]
    pytest.importorskip(known.module, reason=f"{library} is not installed")
    _, moved = BOTH
    for move in known.ways.values():
        motion = move(moved)
        assert abs(len(motion) - FEW) <= 1
        assert np.linalg.norm(motion.positions[-1] - moved.goal) < 0.1
        assert job.slip_at_ends(motion) > 1


def test_a_motion_is_moved_to_a_goal_from_its_start() -> None:
    here, moved = BOTH
    found = optimizers.moved(here.given, moved)
    np.testing.assert_array_equal(found.positions[0], here.given.positions[0])
    np.testing.assert_allclose(found.positions[-1], moved.goal)
    np.testing.assert_allclose(
        np.diff(found.positions - here.given.positions, axis=0)[[0, -1]], 0, atol=1e-4
    )


def test_the_other_package_named_jaxls_is_told_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(optimizers, "find_spec", lambda name: None)
    rows = list(optimizers.rows(BOTH))
    assert [row.job for row in rows] == [job.DEMONSTRATED, job.MOVED]
    assert all("PyPI calls jaxls is another" in row.skipped for row in rows)


def test_authors_code_is_run_from_their_folder_and_leaves_no_module(tmp_path) -> None:
    (tmp_path / "utils.py").write_text("SHIFT = 0.25\n")
    (tmp_path / "nonholonomic_dmps.py").write_text(
        "import numpy as np\n"
        "import utils\n"
        "class NonholonomicDMP:\n"
        "    def __init__(self, N_bf, alphaz, betaz, dt): self.given = (N_bf, alphaz, betaz)\n"
        "    def imitate(self, poses):\n"
        "        assert self.given == (100, 25.0, 6.25)\n"
        "        self.poses = poses\n"
        "    def rollout(self, con, optim):\n"
        "        assert con and optim\n"
        "        moved = self.poses[:, :3] + utils.SHIFT\n"
        "        return moved, 0, 0, self.poses[:, 3:], 0, 0, [], []\n"
    )
    authors = published.Authors(tmp_path)
    assert authors.missing == ""
    here, _ = BOTH
    motion = authors.motion(here)
    np.testing.assert_allclose(motion.positions, here.given.positions + 0.25)
    assert not set(published.MODULES) & set(sys.modules)
    assert "no utils.py" in published.Authors(tmp_path / "absent").missing


def test_the_command_prints_both_tables_and_writes(
    tmp_path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(optimizers, "find_spec", lambda name: None)
    monkeypatch.setattr(ours, "compiling", nullcontext)
    out = tmp_path / "rows.json"
    asked = ["--samples", str(FEW), "--rounds", "1", "--json", str(out)]
    asked += ["--only", "noslip", "jaxls"]
    assert command.main(asked) == 0
    printed = capsys.readouterr().out
    for name in (job.DEMONSTRATED, job.MOVED, job.NOTEBOOK):
        assert f"{name}, {FEW} samples" in printed
    assert "| jaxls, one optimization | left out: from github.com/brentyi/jaxls" in printed
    content = json.loads(out.read_text())
    own = [row for row in content["rows"] if row["library"] == "noslip"]
    assert len(own) == 6
    assert all(row["merit"]["residual_peak"] < 1e-10 for row in own)
    assert all(row["missed"] < 2e-3 for row in own)
    base, other = (row["seconds"] for row in own if row["job"] == job.MOVED)
    assert f"| {other / base:.2g} |" in printed
