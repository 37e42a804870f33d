"""Chunks of recorded tools: what is counted of them."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.shield import Tally, stream, table

pytestmark = pytest.mark.recordings


def test_a_stream_of_chunks_is_judged_and_told_in_a_row(recordings: Path) -> None:
    family, feasible, size, tally = stream(("contour", False, 16, 0))
    assert tally.chunks > 3
    assert not tally.failed
    assert 0 < tally.slip <= 1e-10
    both = Tally()
    both.add(tally)
    both.add(tally)
    assert both.chunks == 2 * tally.chunks
    heading, rule, row = table({(family, feasible, size): both})
    assert row.startswith(f"| contour, as recorded | 16 | {both.chunks} | 0 | ")
    assert heading.count("|") == rule.count("|") == row.count("|")
