"""Ways around obstacles beside OMPL's: a small cut of the table."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.obstacles import HEADING, MISSING, compare, ours, random_jobs, street_jobs, theirs


def test_ours_are_clear_and_end_at_the_goal() -> None:
    for job in random_jobs(2, seed=3):
        way = ours(job, reverse=True)
        assert way is not None
        assert np.min(job.margins(way.poses[:, :2])) >= -1e-9
        assert way.poses[-1, :2] == pytest.approx(job.goal[:2], abs=1e-6)
        assert way.length >= np.hypot(*np.subtract(job.goal[:2], job.start[:2]))


@pytest.mark.skipif(bool(MISSING), reason=MISSING or "OMPL is there")
def test_theirs_are_as_long_as_they_say() -> None:
    job = next(random_jobs(1, seed=3))
    way = theirs(job, "Dubins", "RRTConnect", 1.0)
    assert way is not None
    assert way.cusps == 0
    assert way.poses[-1, :2] == pytest.approx(job.goal[:2], abs=1e-2)


def test_a_row_for_each_planner() -> None:
    (row,) = compare(list(random_jobs(2, seed=3)), "Dubins", 1.0, ())
    assert row.startswith("| 20 random discs, Dubins | noslip | 2 of 2 | 0 | 1.000 | 1.00 |")
    assert row.count("|") == HEADING.splitlines()[0].count("|")


def test_a_street_map_is_read(tmp_path: Path) -> None:
    """A wall of two cells, upright in the file's rows, with a gate at the bottom."""
    rows = ["....@@...."] * 8 + [".........."] * 2
    (tmp_path / "town.map").write_text(
        "type octile\nheight 10\nwidth 10\nmap\n" + "\n".join(rows) + "\n"
    )
    (tmp_path / "town.map.scen").write_text("version 1\n1\ttown.map\t10\t10\t1\t8\t8\t8\t7\n")
    (job,) = street_jobs(tmp_path, 1)
    assert (job.start, job.goal) == ((1.5, 8.5, 0.0), (8.5, 8.5, 0.0))
    assert job.margins(np.array([[5.0, 3.0]]))[0] < 0 < job.margins(np.array([[5.0, 9.5]]))[0]
    way = ours(job, reverse=False)
    assert way is not None
    assert way.length == pytest.approx(7.0)
