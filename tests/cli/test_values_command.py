"""Vectors, joints and rhythms on the command line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import noslip as ns


@pytest.fixture
def reach(noslip, tmp_path) -> Path:
    """A primitive of two coordinates that are no pose."""
    s = np.linspace(0, 1, 101)
    u = s**3 * (10 - 15 * s + 6 * s**2)
    values = np.column_stack([0.5 * u, 0.1 * np.sin(np.pi * u)])
    recording = ns.Trajectory(2 * s, values, names=["q1", "q2"]).to_csv(tmp_path / "reach.csv")
    primitive = tmp_path / "reach.json"
    learned = noslip("learn", recording, "--columns", "q1,q2", "--out", primitive)
    assert learned.code == 0
    assert "mm" not in learned.out
    assert "degrees" not in learned.out
    return primitive


@pytest.mark.parametrize("command", ["rollout", "adapt"])
def test_new_goals_are_values(noslip, reach, tmp_path, command):
    out = tmp_path / ("there.csv" if command == "rollout" else "there.json")
    assert noslip(command, reach, "--goal-values", "0.4,0.2", "--out", out).code == 0
    adapted = command == "adapt"
    motion = ns.load_primitive(out).rollout() if adapted else ns.load_trajectory(out)
    np.testing.assert_allclose(motion.values[-1], [0.4, 0.2], rtol=0, atol=1e-6)


def test_a_file_of_goals_has_the_coordinates_as_columns(noslip, reach, tmp_path):
    goals = tmp_path / "goals.csv"
    goals.write_text("name,q1,q2,duration\nnear,0.4,0.2,3\nfar,0.6,0.1,2\n")
    assert noslip("adapt", reach, "--goals", goals, "--out", tmp_path / "there").code == 0
    near = ns.load_primitive(tmp_path / "there" / "near.json")
    assert near.duration == 3.0
    np.testing.assert_allclose(near.goal_position, [0.4, 0.2], rtol=0, atol=1e-6)


def test_values_are_drawn(noslip, reach, tmp_path):
    figure = tmp_path / "values.svg"
    assert noslip("plot", reach, "--out", figure).code == 0
    assert figure.stat().st_size > 1000


def test_bounds_of_coordinates_are_checked(noslip, reach, tmp_path):
    rules = tmp_path / "bounds.py"
    rules.write_text(
        "from noslip.constraints import JointLimits\n"
        "wide = JointLimits([-1, -1], [1, 1])\nnarrow = JointLimits([-1, -1], [0.3, 1])\n"
    )
    recording = reach.with_suffix(".csv")
    for name, code in (("wide", 0), ("narrow", 1)):
        asked = "--columns", "q1,q2", "--constraint", f"{rules}:{name}"
        assert noslip("check", recording, *asked).code == code


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("rollout", "--goal-values", "1,2,3"), "--goal-values: expected 2 numbers"),
        (("rollout", "--goal-position", "1,2,3"), "give --goal-values"),
        (("rollout", "--goal-values", "nan,0"), "--goal-values: expected finite numbers"),
        (("adapt", "--goal-values", "0,1", "--figure", "f.png", "--out", "a.json"), "noslip plot"),
        (("plot", "--show", "constraints", "--out", "f.png"), "--show constraints: is of poses"),
        (("report", "--out", "f.html"), "is about poses"),
    ],
)
def test_what_is_about_poses_is_refused_in_a_line(noslip, reach, arguments, message):
    command, *rest = arguments
    refused = noslip(command, reach, *rest)
    assert refused.code == 2
    assert message in refused.err
    assert refused.err.count("\n") == 1


def test_a_rhythm_is_learned_and_goes_round(noslip, tmp_path):
    turn = np.linspace(0, 2 * np.pi, 101)
    circle = np.column_stack([np.cos(turn), np.sin(turn)])
    recording = ns.Trajectory(turn, circle, names=["a", "b"]).to_csv(tmp_path / "circle.csv")
    primitive, out = tmp_path / "circle.json", tmp_path / "rounds.csv"
    asked = "--columns", "a,b", "--rhythmic", "--out", primitive
    assert noslip("learn", recording, *asked).code == 0
    assert noslip("rollout", primitive, "--cycles", 3, "--out", out).code == 0
    rounds = ns.load_trajectory(out)
    assert rounds.duration == pytest.approx(6 * np.pi)
    np.testing.assert_allclose(rounds.values[-1], rounds.values[0], rtol=0, atol=1e-9)
