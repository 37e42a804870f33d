"""A small cut of the benchmark of rhythms."""

from __future__ import annotations

import numpy as np
import pytest

import noslip as ns
from benchmarks import rhythms


@pytest.mark.slow
def test_a_lap_closes_and_does_not_slip(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rhythms, "BLOCK", 5)
    lap = rhythms.shapes(0)[2]
    dmp = ns.learn(lap.recorded, lap.constraint, rhythmic=True, basis_functions=30)
    run = rhythms.many_periods(lap, dmp, 10)
    assert not list(run.failures)
    assert run.slipped > 1e-3
    # What is stepped there is the rollout.
    assert run.away <= 1e-9 and dmp.rollout(cycles=10).end_error <= 1e-9


def test_a_period_that_is_shifted_in_time_is_the_same() -> None:
    angle = 2 * np.pi * np.linspace(0, 1, 201)
    curve = np.column_stack([np.cos(angle), np.sin(angle)])
    places = ns.Trajectory(2 * angle, curve, names=["x", "y"])
    shifted = np.column_stack([np.cos(angle + 1), np.sin(angle + 1)])
    rms, most = rhythms.apart(shifted, places)
    assert rms <= most <= 1e-3
    assert rhythms.apart(1.1 * shifted, places)[1] == pytest.approx(0.1 / (2 * np.pi), rel=0.05)
