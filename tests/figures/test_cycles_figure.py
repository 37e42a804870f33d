"""Cycles of a rhythm on one another: each is drawn, and the title says how well they close."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.errors import InputError
from noslip.figures import rhythm_cycles

PERIOD = 2.0


def rounds(drift: float = 0.0, count: int = 3) -> ns.PoseTrajectory:
    """A wheel's laps on a circle of 0.1 m, each farther out than the one before."""
    t = np.linspace(0, count * PERIOD, 100 * count + 1)
    a = 2 * np.pi * t / PERIOD
    out = 0.1 + drift * np.floor(t / PERIOD)
    path = np.column_stack([out * np.sin(a), -out * np.cos(a), 0 * a])
    return ns.PoseTrajectory(t, path, Rotation.from_euler("z", a), name="laps")


def test_each_cycle_is_drawn_and_a_turn_is_no_difference() -> None:
    figure = rhythm_cycles(rounds(), PERIOD)
    x, *_, yaw = figure.axes
    assert x.get_ylabel() == "x (m)" and yaw.get_ylabel() == "yaw (°)"
    for ax in (x, yaw):
        first, _, last = (line.get_ydata() for line in ax.get_lines())
        np.testing.assert_allclose(first, last, atol=1e-6)
    assert np.ptp(yaw.get_lines()[0].get_ydata()) == pytest.approx(360)
    assert re.match("3 cycles of 2 s: the last two differ by at most <", figure.get_suptitle())


def test_the_title_says_how_far_cycles_drift() -> None:
    told = rhythm_cycles(rounds(drift=1e-3), PERIOD, ns.Wheel()).get_suptitle().replace("\n", " ")
    assert re.search("differ by at most (.*) mm and ", told)[1] == "1"
    assert "Laps slips" in told


def test_vectors_go_round_too_and_one_cycle_is_refused() -> None:
    t = np.linspace(0, 4, 401)
    joints = ns.Trajectory(t, np.column_stack([np.sin(np.pi * t), 0 * t]), units=("rad", "rad"))
    figure = rhythm_cycles(joints, PERIOD)
    # What rests has no panel, and is named.
    assert [ax.get_ylabel() for ax in figure.axes] == ["x0 (rad)"]
    assert figure.legends[0].get_title().get_text().endswith(": x1")
    resting = ns.Trajectory(t, np.zeros((401, 2)), units=("rad", "rad"))
    assert len(rhythm_cycles(resting, PERIOD).axes) == 2
    with pytest.raises(InputError, match="less than two periods of 3 s"):
        rhythm_cycles(joints, 3.0)
