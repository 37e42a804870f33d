"""The figure of a distribution: its samples, its bounds, and what all motions pass."""

from __future__ import annotations

import numpy as np
from matplotlib.collections import PolyCollection

import noslip as ns
from noslip.figures import motion_distribution


def test_samples_and_bounds_are_those_of_the_distribution() -> None:
    t, rng = np.linspace(0, 1, 31), np.random.default_rng(1)
    demonstrations = []
    for bend, end, lean in rng.normal((0.3, 1.0, 0.1), 0.05, (6, 3)):
        path = [end * t + lean * np.sin(np.pi * t), bend * np.sin(np.pi * t) + lean * t]
        demonstrations.append(ns.Trajectory(t, np.transpose(path), units=("m", "m")))
    learned = ns.learn(demonstrations, basis_functions=15, distribution=True)
    pose = (demonstrations[0].values[15] + demonstrations[1].values[15]) / 2
    passing = learned.condition(ns.Boundary(0.5, pose))
    figure = motion_distribution(passing, count=6)
    paths, *values = figure.axes
    samples = passing.sample(6, seed=0)
    drawn = [line.get_xydata() for line in paths.get_lines()[:6]]
    np.testing.assert_allclose(drawn, samples.positions[:, :, :2])
    half = passing.interval(0.95)
    for k, ax in enumerate(values):
        assert ax.get_ylabel() == f"{passing.space.coordinates[k]} (m)"
        (band,) = [c for c in ax.collections if isinstance(c, PolyCollection)]
        outline = band.get_paths()[0].vertices
        for at in (20, 60):
            there = outline[np.abs(outline[:, 0] - at) < 1e-9, 1]
            assert np.isclose(np.ptp(there), 2 * half[at, k])
    marks = [line for line in values[1].get_lines() if line.get_marker() == "s"]
    assert [list(mark.get_xydata()[0]) for mark in marks] == [[50.0, pose[1]]]
    largest = 1e3 * half[:, :2].max()
    title = figure.get_suptitle().replace("\n", " ")
    assert title.startswith(f"95 % of motions stay within {largest:.3g} mm of the mean")
