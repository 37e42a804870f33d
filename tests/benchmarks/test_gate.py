"""The gate: ratios are those of two calls, and one that falls is told by name and exit code."""

from __future__ import annotations

import json
from pathlib import Path
from time import sleep

import numpy as np
import pytest

from benchmarks import gate, planner
from benchmarks.gate import MARGIN, Pair


def pair(slow: float, fast: float, *, at_most: bool = False) -> Pair:
    return Pair("naps", lambda: sleep(slow), lambda: sleep(fast), 3.0, at_most, rounds=3)


def test_a_ratio_is_that_of_the_calls() -> None:
    # A sleep is never shorter than asked; a busy machine makes it longer.
    assert pair(0.2, 0.02).ratio() > 2 > pair(0.02, 0.2).ratio()


@pytest.mark.parametrize("at_most", [False, True])
def test_worse_is_what_falls_by_more_than_the_margin(at_most: bool) -> None:
    one = pair(1, 1, at_most=at_most)
    better, worse = (0.1, 10.0) if at_most else (10.0, 0.1)
    assert not one.worse(better, 1.0) and not one.worse(1.0, 1.0) and one.worse(worse, 1.0)
    just = 1 + MARGIN if at_most else 1 / (1 + MARGIN)
    assert not one.worse(just, 1.0)


def run(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, slow: float, *options: str) -> int:
    monkeypatch.setattr(gate, "BASELINE", tmp_path / "baseline.json")
    monkeypatch.setattr(gate, "pairs", lambda folder: iter([pair(slow, 0.02)]))
    monkeypatch.setattr(gate, "singles", lambda folder: iter([("start", 1.2, 1.5)]))
    return gate.main(options)


def test_the_gate_closes_where_a_ratio_falls(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, tmp_path, 0.3, "--gate") == 0, "without a baseline nothing falls"
    assert run(monkeypatch, tmp_path, 0.3, "--write") == 0
    baseline = json.loads((tmp_path / "baseline.json").read_text())
    assert baseline["naps"] > 4 and baseline["start"] == 1.2
    assert run(monkeypatch, tmp_path, 0.3) == 0
    capsys.readouterr()
    assert run(monkeypatch, tmp_path, 0.02, "--gate") == 1
    told = capsys.readouterr()
    assert "FALLEN" in told.out and "naps" in told.err
    # Without the gate it is told all the same.
    assert run(monkeypatch, tmp_path, 0.02) == 0


def test_the_pairs_are_what_they_say(tmp_path: Path) -> None:
    dmp = gate.example()
    idle, turns = gate.idle(dmp), gate.in_turn(dmp)
    assert idle.system.limits.size == 16 and turns.system.limits.size == 8
    assert not idle.rollout().gave_way
    motion, own = turns.rollout(), dmp.rollout()
    assert abs(motion.positions - own.positions).max() > 1e-4
    assert (abs(motion.margins) < 1e-3).any(axis=0).sum() == 8


@pytest.mark.parametrize("name", ["ipopt", "fatrop"])
def test_general_solvers_come_to_the_planner_s_optimum(name: str) -> None:
    """Their problem is the same: to another they would find another answer."""
    found = planner.peer(name, 60)()
    ours = planner.Planning(60).plan.unknown
    assert np.abs(ours).max() > 0.05
    np.testing.assert_allclose(found, ours, rtol=0, atol=1e-8)
