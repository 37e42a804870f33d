"""Goals all around: what is asked of them, and what is told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.reach import CARS, GROUPS, Outcome, attempt, failures, table, ways


@pytest.fixture(scope="module")
def outcome() -> Outcome:
    job = next(iter(GROUPS["car with a wheel"](1)))
    ahead = {"goal_position": np.array([1.2, 0.1, 0.0])}
    return attempt(replace(job, options=ahead, shortest=float(np.hypot(1.2, 0.1))))


def test_a_goal_ahead_is_reached_and_told(outcome: Outcome) -> None:
    assert not outcome.refused
    assert max(outcome.ends) < 1e-4
    assert min(outcome.margins) >= -1e-9
    assert 1 <= outcome.longer < 1.05
    assert 0 < outcome.acceleration < 1e3
    assert not list(failures({"car with a wheel": [outcome]}))
    heading, rule, row = table({"car with a wheel": [outcome]})
    assert row.startswith("| car with a wheel | 1 of 1 | ")
    assert heading.count("|") == rule.count("|") == row.count("|")
    assert str(outcome).startswith("reached: ")


def test_what_is_not_as_it_must_be_is_told(outcome: Outcome) -> None:
    for wrong, words in (
        (replace(outcome, ends=[0.002] * 3), "ends 0.002 m off"),
        (replace(outcome, ends=[np.nan] * 3), "ends nan m off"),
        (replace(outcome, margins=[-1.0]), "margins"),
        (replace(outcome, slip=1.0), "slips by 1"),
        (replace(outcome, length=3.0), "times the shortest way"),
        (replace(outcome, refused="not-found: none"), "refused, though every pose"),
    ):
        assert words in next(iter(failures({"car with a wheel": [wrong]})))
    refused = replace(outcome, refused="not-found: none")
    assert "  refused: " in "\n".join(ways({"blade in space": [refused]}))
    assert not list(failures({"blade in space": [refused]}))
    *_, row = table({"blade in space": [refused]})
    assert row.startswith("| blade in space | 0 of 1 |")


def test_groups_have_the_goals_that_are_promised() -> None:
    counts = {name: len(list(jobs(500))) for name, jobs in GROUPS.items() if "reverses" not in name}
    assert counts["car with a wheel"] == counts["car with a blade"] == 500
    assert counts["blade in space"] == 200
    assert {job.group for name in CARS[:2] for job in GROUPS[name](2)} == set(CARS[:2])
