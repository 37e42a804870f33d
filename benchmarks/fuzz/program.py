"""Executions of a target, one a seed, and what of them must never happen."""

from __future__ import annotations

import resource
import sys
import tempfile
import time
import warnings
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.fuzz.targets import TARGETS, Damage, Read
from noslip.errors import NoslipError, muted

SLOW = 1.0
"""Processor time of an execution (s): more, and again more, is a hang."""
LARGE = 2**30
"""Bytes by which the largest memory of the process may grow."""
MOST_FOUND = 20
"""Kept of what is found: seeds, and what happened."""


@dataclass
class Tally:
    """What became of executions; by seed what must never happen."""

    executions: int = 0
    refused: int = 0
    slowest: float = 0.0
    memory: int = 0
    crashes: int = 0
    hangs: int = 0
    not_finite: int = 0
    found: dict[int, str] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Return plain data, for JSON."""
        return asdict(self)

    def note(self, seed: int, what: str) -> None:
        """Keep the seed of what must never happen."""
        if len(self.found) < MOST_FOUND:
            self.found[seed] = what


def run(target: str, seeds: Iterable[int]) -> Tally:
    """Damage and read one file a seed, in a folder for the purpose."""
    with tempfile.TemporaryDirectory() as folder:
        return _run(*TARGETS[target](Path(folder)), seeds)


def _run(damage: Damage, read: Read, seeds: Iterable[int]) -> Tally:
    tally, before = Tally(), _memory()
    for seed in seeds:
        content = damage(np.random.default_rng(seed))
        tally.executions += 1
        took = _execute(read, content, seed, tally)
        if took > SLOW:
            # What else the process does, such as collecting garbage, does not come twice.
            took = _execute(read, content, seed, Tally())
        tally.slowest = max(tally.slowest, took)
        if took > SLOW:
            tally.hangs += 1
            tally.note(seed, f"took {took:.2f} s")
    tally.memory = _memory() - before
    if tally.memory > LARGE:
        tally.note(-1, f"memory grew by {tally.memory / 2**20:.0f} MiB")
    return tally


def _execute(read: Read, content: Any, seed: int, tally: Tally) -> float:
    """Read what is damaged, note what becomes of it, and return the processor time (s)."""
    started = time.process_time()
    try:
        with warnings.catch_warnings(), muted(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            if not all(np.isfinite(values).all() for values in read(content)):
                tally.not_finite += 1
                tally.note(seed, "not finite")
    except NoslipError as error:
        tally.refused += 1
        if not str(error).isprintable() or len(str(error)) > 2000:
            tally.crashes += 1
            tally.note(seed, f"a message that is no line: {str(error)[:200]!r}")
    except Exception as error:
        tally.crashes += 1
        tally.note(seed, repr(error)[:300])
    return time.process_time() - started


def _memory() -> int:
    """Largest memory of the process so far (bytes)."""
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
