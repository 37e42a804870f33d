"""Goals of a beveled needle: surely reached, and reached."""

from __future__ import annotations

import numpy as np
import pytest

import noslip as ns
from benchmarks.needle_goals import main, needle_goals
from noslip.constraints.check import step_residuals


def test_goals_are_ends_of_what_a_needle_does() -> None:
    for goal in needle_goals(8):
        speed = goal.length / goal.insertion.duration
        residuals = step_residuals(goal.insertion, [ns.Needle(curvature=goal.curvature)])
        assert np.abs(residuals).max() <= 1e-2 * speed
        assert goal.insertion.path_length == pytest.approx(goal.length, rel=1e-4)
    assert needle_goals(1, curvature=5.0)[0].curvature == 5.0


def test_a_few_are_led_to(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--count", "12", "--ways"]) == 0
    told = capsys.readouterr().out
    assert told.startswith(("ways found to 11 of 12", "ways found to 12 of 12"))
