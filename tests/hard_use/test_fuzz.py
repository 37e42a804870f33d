"""A few hundred executions of each fuzzer; ``python -m benchmarks.fuzz`` runs as many as asked."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import example, given, settings

from benchmarks.fuzz.program import Tally, run
from strategies import seeds

pytest.importorskip("pyarrow")
pytest.importorskip("rosbags")


Trials = Callable[[int], None]


def survived(tally: Tally, trials: Trials) -> None:
    trials(tally.executions)
    assert (tally.crashes, tally.hangs, tally.not_finite) == (0, 0, 0), tally.found
    assert not tally.found


# A seed is a hundred executions: what is damaged is made once for all of them.
# The first is the seed 0, always.
few = settings(max_examples=2)


def hundred(seed: int) -> range:
    return range(seed, seed + 100)


@given(seed=seeds)
@example(seed=0)
@few
def test_damaged_primitives_are_refused_or_move(seed: int, trials: Trials) -> None:
    survived(run("primitive", hundred(seed)), trials)


# From 460 on: an npz whose error quoted a kilobyte of the file; 8467: a Parquet file whose column's
# metadata ends the process when pyarrow is asked for them.
@given(seed=seeds)
@example(seed=460)
@example(seed=8467)
@few
def test_damaged_tables_are_refused_or_read(seed: int, trials: Trials) -> None:
    survived(run("tables", hundred(seed)), trials)


@given(seed=seeds)
@example(seed=0)
@few
def test_damaged_bags_are_refused_or_read(seed: int, trials: Trials) -> None:
    survived(run("bags", hundred(seed)), trials)
