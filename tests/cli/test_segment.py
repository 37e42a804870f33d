"""``noslip segment``: the pieces it writes, what it says, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import noslip as ns
from motions import eased


@pytest.fixture
def session(tmp_path) -> Path:
    """Five strokes of 2 s, the third rolled by 40 degrees, pressed with 5 N."""
    u = np.arange(1, 101) / 100
    s = eased(u)
    x, roll, force = [np.zeros(50)], [np.zeros(50)], [np.zeros(50)]
    for stroke in range(5):
        x += [0.1 * (stroke + s), np.full(50, 0.1 * (stroke + 1))]
        angle = 40.0 if stroke == 2 else float(stroke)
        roll += [np.full(100, angle), np.full(50, angle)]
        force += [np.full(100, 5.0), np.zeros(50)]
    x = np.concatenate(x)
    path = np.column_stack([x, 0.02 * np.sin(20 * np.pi * x), 0 * x])
    turns = Rotation.from_euler("x", np.concatenate(roll), degrees=True)
    trajectory = ns.PoseTrajectory(10 + np.arange(len(x)) / 50, path, turns)
    header, *rows = trajectory.csv_text().splitlines()
    file = tmp_path / "session.csv"
    pressed = np.concatenate(force)
    lines = [f"{row},{newton}" for row, newton in zip(rows, pressed, strict=True)]
    file.write_text("\n".join([f"{header},fz", *lines, ""]))
    return file


def test_pieces_are_written_with_the_recordings_clock(noslip, session, tmp_path):
    result = noslip("segment", session, "--out", tmp_path / "cuts", "--figure", tmp_path / "a.png")
    assert result.code == 0
    files = sorted((tmp_path / "cuts").iterdir())
    assert [file.name for file in files] == [f"session_{i:02}.csv" for i in range(1, 6)]
    pieces = ns.load_demonstrations(files)
    for number, piece in enumerate(pieces):
        assert abs(piece.times[0] - (11 + 3 * number)) < 0.3
        assert abs(piece.times[-1] - (13 + 3 * number)) < 0.3
    assert "session_05.csv" in result.out
    assert "5 pieces" in result.out
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")


def test_outliers_are_named_and_dropped_when_asked(noslip, session, tmp_path):
    kept = noslip("segment", session, "--out", tmp_path / "a")
    assert "piece 3 (17" in kept.err
    assert "turned by" in kept.err
    assert "kept, see --drop-outliers" in kept.err
    dropped = noslip("segment", session, "--out", tmp_path / "b", "--drop-outliers", "--json")
    assert "piece 3 (17" in dropped.err
    assert "dropped" in dropped.err
    result = json.loads(dropped.out)
    assert result["outliers"]["outlying"] == [False, False, True, False, False]
    reasons = [i["reason"] for i in result["intervals"] if i["reason"] != "rest"]
    assert reasons[2].startswith("far from the others: turned by")
    assert reasons[:2] + reasons[3:] == [None] * 4
    written = [i["file"] for i in result["intervals"] if i["file"]]
    assert sorted(map(str, (tmp_path / "b").iterdir())) == written
    assert len(written) == 4


def test_contact_and_times(noslip, session, tmp_path):
    by_force = noslip(
        *("segment", session, "--at", "contact", "--contact-column", "fz", "--rate", 40),
        *("--out", tmp_path / "a", "--relative", "--json"),
    )
    intervals = json.loads(by_force.out)["intervals"]
    found = [(i["start"], i["end"]) for i in intervals if i["file"]]
    np.testing.assert_allclose(found, [(11 + 3 * k, 13 + 3 * k) for k in range(5)], atol=0.06)
    (first, *_) = ns.load_demonstrations(str(tmp_path / "a" / "*_04.csv"))
    np.testing.assert_array_equal(first.positions[0], 0)
    at_times = noslip(
        *("segment", session, "--at", "times", "--times", "11:13", "--times", "20:"),
        *("--out", tmp_path / "b"),
    )
    assert at_times.code == 0
    assert len(list((tmp_path / "b").iterdir())) == 2


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--times", "1:2"], "--times says nothing about --at rests; give --at times"),
        (["--height", "0,0,1"], "give --at contact"),
        (["--at", "contact"], "--at contact needs --contact-column or --height"),
        (["--at", "times"], "--at times needs --times"),
        (["--at", "times", "--times", "3"], "expected START:END in seconds"),
        (["--at", "times", "--times", "a:b"], "expected START:END in seconds"),
        (["--at", "contact", "--contact-column", "fq"], "no column 'fq', found t, x"),
        (["--at", "contact", "--height", "0,0,0"], "0,0,0 is no direction"),
        (["--in-contact", "below"], "--in-contact is about --contact-column"),
        (["--thresholds", "1"], "--thresholds: expected 2 numbers"),
        (["--figure", "cuts.bmp"], "--figure: cuts.bmp must end in .png"),
        (["--thresholds", "7,8"], "nothing lies above the thresholds 7 and 8"),
    ],
)
def test_bad_usage_is_one_line_and_exit_code_2(noslip, session, tmp_path, arguments, message):
    result = noslip("segment", session, "--out", tmp_path / "cuts", *arguments)
    assert result.code == 2
    assert message in result.err
    assert result.err.count("noslip: error") == 1
    assert result.err.endswith("\n")
    assert not (tmp_path / "cuts").exists()


def test_pieces_of_an_earlier_run_are_not_mixed_with_new_ones(noslip, session, tmp_path):
    out = tmp_path / "cuts"
    assert noslip("segment", session, "--out", out).code == 0
    assert noslip("segment", session, "--out", out).code == 0
    again = noslip("segment", session, "--out", out, "--drop-outliers")
    assert again.code == 2
    assert "session_05.csv is left from an earlier run" in again.err


def test_learn_brings_pieces_into_step(noslip, tmp_path):
    pytest.importorskip("dtaidistance", reason="dtaidistance is not installed (noslip[align])")
    s = np.linspace(0, 1, 150)
    for number, power in enumerate((1.0, 1.6)):
        u = s**power
        path = np.column_stack([0.1 * u, 0.03 * np.sin(2 * np.pi * u), 0 * u])
        yaw = np.arctan2(0.06 * np.pi * np.cos(2 * np.pi * u), 0.1)
        ns.PoseTrajectory(2 * s, path, Rotation.from_euler("z", yaw)).to_csv(
            tmp_path / f"cut_{number}.csv"
        )
    distances = []
    for extra in ([], ["--align"]):
        result = noslip(
            *("learn", tmp_path / "cut_0.csv", tmp_path / "cut_1.csv", "--constraint", "blade"),
            *("--out", tmp_path / "p.json", "--json", *extra),
        )
        assert result.code == 0
        told = json.loads(result.out)["demonstrations"]
        distances.append(max(d["position_rms"] for d in told))
    assert distances[1] < distances[0] / 5
