"""Running times whose medians can be compared."""

from __future__ import annotations

import gc
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np

from noslip.constraints import system


def forget() -> None:
    """Empty noslip's caches, so that a repetition pays what the first call pays."""
    for name, module in list(sys.modules.items()):
        if name.split(".")[0] != "noslip":
            continue
        for value in vars(module).values():
            if hasattr(value, "cache_clear"):
                value.cache_clear()
    # Systems that live keep theirs; those declared from now on build new ones.
    system._living.clear()


@dataclass(frozen=True)
class Candidate:
    """Something to measure.

    Attributes
    ----------
    key, label : str
    library : str
    call : callable
    before : callable, optional
        Runs before each call, outside of the time taken.
    per_round : int
        Calls in each round: one for a slow candidate, many for a fast one.
    warm_up : callable, optional
        Called once before the first round; ``call`` itself if left out.
    """

    key: str
    label: str
    library: str
    call: Callable[[], Any]
    before: Callable[[], Any] | None = None
    per_round: int = 1
    warm_up: Callable[[], Any] | None = None


@dataclass(frozen=True)
class Timing:
    """Seconds a call of one candidate."""

    key: str
    label: str
    library: str
    runs: int
    median: float
    minimum: float
    lower_quartile: float
    upper_quartile: float

    @classmethod
    def of(cls, candidate: Candidate, seconds: Sequence[float]) -> Timing:
        lower, median, upper = (float(x) for x in np.percentile(seconds, [25, 50, 75]))
        return cls(
            candidate.key,
            candidate.label,
            candidate.library,
            len(seconds),
            median,
            min(seconds),
            lower,
            upper,
        )


def measure(
    candidates: Sequence[Candidate],
    rounds: int,
    progress: Callable[[str], None] = lambda message: None,
) -> dict[str, Timing]:
    """Time all candidates in turn, round after round: a slow phase of the machine hits all alike.

    The garbage collector rests during a call, as in the standard library's ``timeit``.
    """
    for candidate in candidates:
        progress(f"warm-up: {candidate.library}, {candidate.label}")
        if candidate.before is not None:
            candidate.before()
        (candidate.warm_up or candidate.call)()
    seconds: dict[str, list[float]] = {c.key: [] for c in candidates}
    for index in range(rounds):
        for candidate in candidates:
            progress(f"round {index + 1}/{rounds}: {candidate.library}, {candidate.label}")
            seconds[candidate.key] += [_seconds(candidate) for _ in range(candidate.per_round)]
    return {c.key: Timing.of(c, seconds[c.key]) for c in candidates}


def _seconds(candidate: Candidate) -> float:
    if candidate.before is not None:
        candidate.before()
    collecting = gc.isenabled()
    gc.disable()
    try:
        begin = perf_counter()
        candidate.call()
        return perf_counter() - begin
    finally:
        if collecting:
            gc.enable()
