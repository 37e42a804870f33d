"""How time and memory grow with the number of samples and of basis functions."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import log
from pathlib import Path
from time import perf_counter
from typing import Literal

from benchmarks import peers
from benchmarks.case import Case
from benchmarks.example import BASIS_FUNCTIONS, SAMPLES

Axis = Literal["samples", "basis_functions", "limits", "vias"]

SAMPLE_SIZES = (100, 1000, 10_000, 100_000)
BASIS_SIZES = (30, 100, 300, 1000)
LIMIT_SIZES, VIA_SIZES = (0, 1, 4, 16), (0, 1, 4, 16, 64)
LONGEST_CASE = 60.0
LONGEST_GROWTH = 140.0
"""Seconds after which what is left is skipped, and reported so."""
LEAST_MEMORY = 1_000_000
"""Bytes below which the peak says nothing about the task."""

TASKS = ("fit", "learn", "rollout", "imitate", "open_loop")
"""The last two are movement-primitives'."""
THEIRS = TASKS[3:]
ADAPTING = "adapt"
ADAPTED_SIZES = (100, 250, 500, 1000, 2000)
"""An adaptation takes 2001 samples at most."""
_ROOT = Path(__file__).resolve().parents[1]


@dataclass(frozen=True)
class Growth:
    """One task over increasing sizes.

    Attributes
    ----------
    task : str
    axis : str
        What grows.
    cases : tuple of Case
        In the order of size; sizes that took too long are missing.
    """

    task: str
    axis: Axis
    cases: tuple[Case, ...]

    @property
    def time_exponent(self) -> float | None:
        """Slope of log time over log size between the two largest sizes."""
        return self._exponent([case.seconds for case in self.cases])

    @property
    def memory_exponent(self) -> float | None:
        """The same of the peak memory; None where it is too little to be told from noise."""
        return self._exponent(
            [c.memory if c.memory and c.memory >= LEAST_MEMORY else None for c in self.cases]
        )

    def _exponent(self, values: Sequence[float | None]) -> float | None:
        if len(values) < 2 or not values[-2] or not values[-1]:
            return None
        sizes = [getattr(case, self.axis) for case in self.cases[-2:]]
        return log(values[-1] / values[-2]) / log(sizes[1] / sizes[0])


def grow(
    *,
    sample_sizes: Sequence[int] = SAMPLE_SIZES,
    basis_sizes: Sequence[int] = BASIS_SIZES,
    limit_sizes: Sequence[int] = (),
    via_sizes: Sequence[int] = (),
    tasks: Sequence[str] = TASKS,
    progress: Callable[[str], None] = lambda message: None,
) -> list[Growth]:
    """Measure each task at each size, each in its own process."""
    until = perf_counter() + LONGEST_GROWTH
    usual = {"samples": SAMPLES, "basis_functions": BASIS_FUNCTIONS, "limits": 0, "vias": 0}
    growing: list[tuple[Axis, str, Sequence[int]]] = []
    growing += [("samples", task, sample_sizes) for task in tasks]
    growing += [("basis_functions", task, basis_sizes) for task in tasks]
    growing += [("limits", "rollout", limit_sizes), ("vias", ADAPTING, via_sizes)]
    growths = []
    for axis, task, sizes in growing:
        if not sizes or (task in THEIRS and peers.MISSING):
            continue
        cases: list[Case] = []
        for size in sizes:
            progress(f"growth: {task}, {size} {axis}")
            case = run_case(task, *(usual | {axis: size}).values(), until - perf_counter())
            if case is None:
                break
            cases.append(case)
        growths.append(Growth(task, axis, tuple(cases)))
    return growths


def run_case(
    task: str,
    samples: int,
    basis_functions: int,
    limits: int = 0,
    vias: int = 0,
    seconds_left: float = LONGEST_CASE,
) -> Case | None:
    """Run one case in a child process; None if there is no time for it."""
    timeout = min(LONGEST_CASE, seconds_left)
    if timeout <= 0:
        return None
    sizes = map(str, (samples, basis_functions, limits, vias))
    command = [sys.executable, "-m", "benchmarks.case", task, *sizes]
    try:
        done = subprocess.run(
            command, cwd=_ROOT, timeout=timeout, capture_output=True, text=True, check=False
        )
    except subprocess.TimeoutExpired:
        return None
    if done.returncode:
        raise RuntimeError(f"{' '.join(command[1:])} failed:\n{done.stderr}")
    return Case(**json.loads(done.stdout))
