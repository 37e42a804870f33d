"""``noslip adapt``: what it writes for one goal and for many, and what it refuses."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import noslip as ns
from motions import planar_cut
from noslip.cli import adapt

HEADER = [
    "name",
    "converged",
    "holds",
    "end_position_error_m",
    "end_rotation_error_deg",
    "path_error_m",
    "residual_peak",
    "angular_speed_peak_rad_s",
    "angular_speed_ratio",
    "iterations",
    "duration_s",
    "maneuver",
    "code",
    "needed_duration_s",
    "message",
]


def learned(*constraints: ns.Constraint) -> ns.ConstrainedDMP:
    return ns.learn(planar_cut(), constraints, basis_functions=20)


@pytest.fixture(scope="module")
def saved(tmp_path_factory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("primitives")
    return {
        "blade": learned(ns.Blade()).save(folder / "blade.json"),
        "table": learned(ns.constraints.PlaneContact(point=(0, 0, 0))).save(folder / "table.json"),
        "free": learned().save(folder / "free.json"),
    }


@pytest.fixture
def primitive(saved) -> Path:
    return saved["blade"]


def goals_file(folder: Path, text: str) -> Path:
    path = folder / "goals.csv"
    path.write_text(text)
    return path


def summary_of(folder: Path) -> list[dict[str, str]]:
    with (folder / "summary.csv").open(newline="") as file:
        rows = csv.DictReader(file)
        assert rows.fieldnames == HEADER
        return list(rows)


# ---------------------------------------------------------------- one goal


def test_the_primitive_written_ends_at_the_goal_and_keeps_its_constraint(
    noslip, primitive, tmp_path
):
    out = tmp_path / "adapted.json"
    goal, turn = [0.085, 0.05, 0.01], Rotation.from_euler("z", 0.3)
    result = noslip(
        *("adapt", primitive, "--out", out, "--goal-position", "0.085,0.05,0.01"),
        *("--goal-rotation", ",".join(map(repr, turn.as_quat(scalar_first=True).tolist()))),
        *("--start-position", "0.001,0.001,0", "--start-velocity", "0.05,0,0"),
        *("--via", "0.5:0.045,0.02,0.004", "--duration", 3),
    )
    assert result.code == 0, result.err
    motion = ns.load_primitive(out).rollout()
    np.testing.assert_allclose(motion.positions[-1], goal, atol=1e-4)
    np.testing.assert_allclose(motion.positions[0], [0.001, 0.001, 0], atol=1e-12)
    middle = motion.positions[len(motion) // 2]
    np.testing.assert_allclose(middle, [0.045, 0.02, 0.004], atol=5e-4)
    assert np.degrees((motion.rotations[-1].inv() * turn).magnitude()) < 1
    assert motion.duration == pytest.approx(3)
    assert ns.check(motion, ns.Blade(), tolerance=1e-9).satisfied
    ends, residual, speed, wrote = result.out.splitlines()
    assert (
        ends.startswith("ends within ")
        and " m and " in ends.replace("mm", "m")
        and ends.endswith("of the goal")
    )
    assert residual == "residual below 1e-9"
    assert speed.startswith("angular speed at most ") and "times that of the original" in speed
    assert wrote == f"wrote {out}"


def test_what_is_told_is_what_the_motion_written_does(noslip, primitive, tmp_path):
    out = tmp_path / "adapted.json"
    goal = np.array([0.09, 0.045, 0.0])
    result = noslip("adapt", primitive, "--out", out, "--goal-position", "0.09,0.045,0", "--json")
    assert result.code == 0
    told = json.loads(result.out)
    before, dmp = ns.load_primitive(primitive), ns.load_primitive(out)
    motion = dmp.rollout()
    off = np.linalg.norm(motion.positions[-1] - goal)
    turned = (motion.rotations[-1].inv() * before.goal_rotation).magnitude()
    peaks = [
        np.linalg.norm(m.step_velocities()[1], axis=1).max() for m in (before.rollout(), motion)
    ]
    assert told["end_position_error_m"] == pytest.approx(off, rel=1e-6)
    assert told["end_rotation_error_deg"] == pytest.approx(np.degrees(turned), rel=1e-6)
    assert told["angular_speed_peak_rad_s"] == pytest.approx(peaks[1])
    assert told["angular_speed_ratio"] == pytest.approx(peaks[1] / peaks[0])
    assert told["residual_peak"] == pytest.approx(ns.check(motion, ns.Blade()).peak)
    assert told["iterations"] == dmp.record[0].iterations
    assert told["duration_s"] == dmp.duration
    assert told["converged"] and told["holds"]


def test_options_reach_the_adaptation(noslip, primitive, tmp_path):
    out = tmp_path / "adapted.json"
    result = noslip(
        *("adapt", primitive, "--out", out, "--goal-position", "0.1,0.03,0", "--json"),
        *("--scaling", "rotation-dilation", "--end", "position"),
    )
    assert result.code == 0
    assert json.loads(result.out)["end_rotation_error_deg"] is None
    expected = ns.load_primitive(primitive).adapt(
        goal_position=[0.1, 0.03, 0], scaling="rotation-dilation", end="position"
    )
    found = ns.load_primitive(out).rollout()
    np.testing.assert_array_equal(found.positions, expected.rollout().positions)


def test_a_primitive_without_constraints_adapts_too(noslip, saved, tmp_path):
    out, figure = tmp_path / "adapted.json", tmp_path / "family.svg"
    result = noslip(
        *("adapt", saved["free"], "--out", out, "--goal-position", "0.1,0,0", "--figure", figure)
    )
    assert result.code == 0, result.err
    assert figure.stat().st_size > 5000
    assert f"wrote {figure}" in result.out


def test_a_goal_that_the_constraint_forbids_leaves_no_file(noslip, saved, tmp_path):
    out = tmp_path / "adapted.json"
    result = noslip("adapt", saved["table"], "--out", out, "--goal-position", "0.09,0.04,0.01")
    assert result.code == 2
    assert result.err.startswith("noslip: error: goal violates 'plane-contact' by 0.01 m")
    assert result.err.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_a_motion_that_breaks_a_hard_limit_exits_with_one(noslip, primitive, tmp_path, monkeypatch):
    monkeypatch.setattr(adapt, "checked", lambda motion, _: ns.check(motion, ns.SpeedLimit(0.01)))
    result = noslip("adapt", primitive, "--out", tmp_path / "a.json", "--goal-position", "0.1,0,0")
    assert result.code == 1
    assert "violated: speed-limit" in result.out


# ---------------------------------------------------------------- many goals


def test_each_row_becomes_a_primitive_and_a_line_of_the_summary(noslip, primitive, tmp_path):
    goals = goals_file(
        tmp_path,
        "name,x,y,z,qw,qx,qy,qz,duration\n"
        "near,0.09,0.045,0,1,0,0,0,2\n"
        "far away,0.1,0.05,0.01,0.99500417,0,0,0.09983342,3.5\n",
    )
    out = tmp_path / "family"
    result = noslip("adapt", primitive, "--goals", goals, "--out", out, "--end", "pose")
    assert result.code == 0, result.err
    assert result.err == ""
    assert sorted(p.name for p in out.iterdir()) == ["far away.json", "near.json", "summary.csv"]
    near, far = summary_of(out)
    assert (near["name"], far["name"]) == ("near", "far away")
    assert near["converged"] == near["holds"] == "true"
    motion = ns.load_primitive(out / "far away.json").rollout()
    assert motion.duration == pytest.approx(3.5)
    off = np.linalg.norm(motion.positions[-1] - [0.1, 0.05, 0.01])
    assert float(far["end_position_error_m"]) == pytest.approx(off, rel=1e-6)
    assert off < 5e-5
    assert float(far["duration_s"]) == 3.5
    assert "adapted to 2 of 2 goals" in result.out


@pytest.mark.parametrize(
    ("text", "options"),
    [
        ("x,y,z\n0.09,0.045,0\n0.1,0.04,0\n", ()),
        ("duration\n12\n3\n", ("--goal-position", "0.09,0.045,0")),
        ("qw;qx;qy;qz;\n1;0;0;0;\n\n0.99500417;0;0;0.09983342;\n", ("--duration", "4")),
    ],
)
def test_rows_without_names_are_numbered_and_options_hold_for_all(
    noslip, primitive, tmp_path, text, options
):
    out = tmp_path / "family"
    goals = goals_file(tmp_path, text)
    result = noslip("adapt", primitive, "--goals", goals, "--out", out, "--json", *options)
    assert result.code == 0, result.err
    told = json.loads(result.out)
    assert told["failed"] == 0
    assert [goal["name"] for goal in told["goals"]] == ["goal_001", "goal_002"]
    assert (out / "goal_002.json").is_file()
    durations = {"d": [12, 3], "q": [4, 4], "x": [pytest.approx(2)] * 2}[text[0]]
    assert [goal["duration_s"] for goal in told["goals"]] == durations


def test_a_row_that_fails_is_listed_and_the_rest_is_finished(noslip, saved, tmp_path):
    goals = goals_file(
        tmp_path, "name,x,y,z\non,0.09,0.04,0\noff,0.09,0.04,0.02\nalso,0.08,0.05,0\n"
    )
    out, figure = tmp_path / "family", tmp_path / "family.png"
    out.mkdir()
    (out / "off.json").write_text("of an earlier run")
    result = noslip("adapt", saved["table"], "--goals", goals, "--out", out, "--figure", figure)
    assert result.code == 1
    assert sorted(p.name for p in out.iterdir()) == ["also.json", "on.json", "summary.csv"]
    assert "adapted to 2 of 3 goals" in result.out
    (line,) = [line for line in result.out.splitlines() if line.startswith("off: ")]
    assert "FAILED, goal violates 'plane-contact' by 0.02 m" in line
    assert figure.read_bytes().startswith(b"\x89PNG")
    on, off, also = summary_of(out)
    assert (on["converged"], off["converged"], also["converged"]) == ("true", "false", "true")
    assert "plane-contact" in off["message"] and on["message"] == ""
    assert (on["code"], off["code"]) == ("", "impossible")
    empty = [name for name in HEADER if name not in ("name", "converged", "code", "message")]
    assert not any(off[name] for name in empty)


def test_where_all_fail_there_is_a_summary_and_no_figure(noslip, saved, tmp_path):
    out, figure = tmp_path / "family", tmp_path / "family.png"
    goals = goals_file(tmp_path, "x,y,z\n0.09,0.04,0.02\n")
    result = noslip("adapt", saved["table"], "--goals", goals, "--out", out, "--figure", figure)
    assert result.code == 1
    assert [p.name for p in out.iterdir()] == ["summary.csv"]
    assert not figure.exists()
    assert f"no {figure}" in result.out


# ---------------------------------------------------------------- what is refused


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "the file is empty"),
        ("x,y,z\n", "a header and no goals"),
        ("x,y\n0,0\n", "missing z; give all of x,y,z or none"),
        ("x,y,z,qw\n0,0,0,1\n", "missing qx, qy, qz"),
        ("name\nfirst\n", "no column of a goal"),
        ("x,y,z,duraton\n0,0,0,1\n", "column 'duraton' is not known"),
        ("x,y,z,x\n0,0,0,0\n", "column x appears twice"),
        ("0.1,0.2,0.3\n", "column '0.1' is not known"),
        ("x,y,z\n0,0,0\n0,nan,0\n", "line 3, column y: found nan"),
        ("x,y,z\n0,0,0\n0,inf,0\n", "line 3, column y: found inf"),
        ("x,y,z\n0,left,0\n", "line 2, column y: found 'left', not a number"),
        ("x,y,z\n0,1_5,0\n", "line 2, column y: found '1_5', not a number"),
        ("x,y,z\n0,0\n", "line 2, column z: the row ends after 2 of 3 cells"),
        ("x,y,z\n0,,0\n", "line 2, column y: the cell is empty"),
        ("qw,qx,qy,qz\n1,0,0,1\n", "the quaternion has norm 1.41421"),
        ("qw,qx,qy,qz\n0,0,0,0\n", "the quaternion is zero"),
        ("duration\n3\n0\n", "line 3, column duration: found 0"),
        ("name,duration\na,3\nA,4\n", "line 3, column name: 'A' is also that of line 2"),
        ("name,duration\n../up,3\n", "no name of a file"),
        ("name,duration\n,3\n", "no name of a file"),
    ],
)
def test_a_broken_file_of_goals_is_refused_as_a_whole(noslip, primitive, tmp_path, text, said):
    goals = goals_file(tmp_path, text)
    result = noslip("adapt", primitive, "--goals", goals, "--out", tmp_path / "family")
    assert (result.code, result.out) == (2, "")
    assert result.err.startswith(f"noslip: error: {goals}: ")
    assert result.err.count("\n") == 1
    assert said in result.err
    assert list(tmp_path.iterdir()) == [goals]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--goal-position", "1,2"], "--goal-position: expected 3 numbers"),
        (["--goal-position", "1,2,nan"], "--goal-position must be 3 finite numbers"),
        (["--goal-rotation", "1,1,0,0"], "--goal-rotation: 1,1,0,0 is not a unit quaternion"),
        (["--start-velocity", "1,2,3,4"], "--start-velocity: expected 1 or 3 or 6"),
        (["--start-velocity", "1,2,inf"], "--start-velocity: expected finite"),
        (["--duration", "0"], "--duration must be a positive number"),
        (["--via", "0.1,0,0"], "--via: expected AT:X,Y,Z"),
        (["--via", "0.5:0.1,0"], "--via: expected 3 or 4 or 7"),
        (["--via", "1.5:0.1,0,0"], "--via: AT must be between 0 and 1"),
        (["--figure", "family.gif"], "must end in .png, .svg, .pdf"),
        (["--goals", "missing.csv"], "missing.csv: no such file"),
    ],
)
def test_bad_options_get_one_line_that_names_them(noslip, primitive, tmp_path, options, said):
    result = noslip("adapt", primitive, "--out", tmp_path / "out", *options)
    assert (result.code, result.out) == (2, "")
    assert result.err.startswith("noslip: error: ")
    assert result.err.count("\n") == 1
    assert said in result.err
    assert not list(tmp_path.iterdir())


def test_outputs_in_the_wrong_place_are_refused(noslip, primitive, tmp_path):
    goals = goals_file(tmp_path, "name,x,y,z\nblade,0.09,0.04,0\n")
    file = tmp_path / "file"
    file.write_text("kept")
    before = primitive.read_bytes()
    for arguments, said in (
        (["--goals", goals, "--out", file], "is a file"),
        (["--out", tmp_path], "is a folder"),
        (["--goals", goals, "--out", primitive.parent], "would replace"),
        (
            ["--goals", goals, "--out", tmp_path / "a", "--goal-position", "0,0,0"],
            "has columns for it too",
        ),
    ):
        result = noslip("adapt", primitive, *arguments)
        assert result.code == 2
        assert said in result.err
    assert primitive.read_bytes() == before
    assert file.read_text() == "kept"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "goals.csv"]


def test_help_names_the_columns_and_gives_examples(noslip):
    result = noslip("adapt", "--help")
    assert result.code == 0
    assert "Examples" in result.out and "noslip adapt excision.json" in result.out
    assert "x,y,z" in result.out
