"""Distributions on the command line: learned, drawn from, refused where there is none."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import noslip as ns
from motions import eased


@pytest.fixture(scope="module")
def waves(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder, random = tmp_path_factory.mktemp("waves"), np.random.default_rng(0)
    u = eased(np.linspace(0, 1, 81))
    found = []
    for number in range(4):
        a, b = 0.05 * random.normal(size=2)
        values = np.column_stack([u + a * u * (1 - u), (0.3 + b) * np.sin(np.pi * u)])
        wave = ns.Trajectory(2 * np.linspace(0, 1, 81), values, names=["x", "y"])
        found.append(wave.to_csv(folder / f"wave_{number}.csv"))
    return found


def test_a_distribution_is_learned_and_drawn_from(
    noslip: Any, waves: list[Path], tmp_path: Path
) -> None:
    out, folder, mean = tmp_path / "waves.json", tmp_path / "samples", tmp_path / "mean.json"
    learning = ("--columns", "x,y", "--basis-functions", "30", "--out", out)
    assert noslip("learn", *waves, *learning, "--distribution").code == 0
    asked = ("--via", "0.5:0.5,0.31", "--count", "3", "--mean", mean, "--json")
    told = noslip("sample", out, *asked, "--out", folder)
    assert told.code == 0
    assert json.loads(told.out)["count"] == 3
    motions = [ns.load_trajectory(f, columns="x,y") for f in sorted(folder.iterdir())]
    assert len(motions) == 3
    for motion in motions:
        middle = motion.resampled(times=motion.times[[0, len(motion) // 2]]).values[1]
        assert middle == pytest.approx([0.5, 0.31], abs=5e-3)
    assert not np.allclose(motions[0].values, motions[1].values)
    assert noslip("rollout", mean, "--out", tmp_path / "mean.csv").code == 0
    # Of a primitive alone there is nothing to draw.
    refused = noslip("sample", mean, "--out", folder)
    assert refused.code == 2 and "no distribution" in refused.err
    refused = noslip("sample", out, "--given", "width", "--out", folder)
    assert refused.code == 2 and "NAME=X" in refused.err
