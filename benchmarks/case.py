"""One case of the growth, in a process of its own so that its peak memory is its own.

``python -m benchmarks.case learn 10000 100`` (samples, basis functions; limits, vias) prints its
time and memory as JSON.
"""

from __future__ import annotations

import json
import sys
import warnings
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from time import process_time
from typing import Any

import numpy as np

from benchmarks import peers
from benchmarks.example import MOVED_GOAL, SAMPLES, demonstration
from benchmarks.memory import PeakMemory
from benchmarks.timing import forget
from noslip import Blade, ConstrainedDMP, KeepOutSphere, NoslipWarning, learn
from noslip.constraints.system import ConstraintSystem

LONGEST = 1.0
"""Repetitions stop after this many seconds."""
MOST_REPETITIONS = 20


@dataclass(frozen=True)
class Case:
    """What one task needs at one size.

    Attributes
    ----------
    task : str
    samples, basis_functions, limits, vias : int
    seconds : float
        CPU time, lowest of the repetitions (of the only call, if that took long): a case has no
        rival to share a slow phase of the machine with.
    first_seconds : float
        The first call, which also allocates and builds.
    memory : int or None
        Peak above what the process held before, in bytes.
    """

    task: str
    samples: int
    basis_functions: int
    seconds: float
    first_seconds: float
    memory: int | None
    limits: int = 0
    vias: int = 0


def prepare(
    task: str, samples: int, basis_functions: int, limits: int = 0, vias: int = 0
) -> Callable[[], Any]:
    """Return the call to measure.

    Rollouts are of a primitive that was learned from the example's usual number of samples; only
    their steps grow.
    """
    given = demonstration(samples)
    usual = demonstration(SAMPLES)
    if task == "fit":
        return lambda: learn(given, basis_functions=basis_functions)
    if task == "learn":
        return lambda: learn(given, Blade(), basis_functions=basis_functions)
    if task == "adapt":
        learned = learn(given, Blade(), basis_functions=basis_functions)
        passed = _beside(learned, vias)
        return lambda: learned.adapt(goal_position=MOVED_GOAL, samples=samples, via=passed)
    if task == "rollout":
        dmp = learn(usual, Blade(), basis_functions=basis_functions)
        dmp = replace(dmp, rule=replace(dmp.rule, system=_limited(limits)))
        return lambda: dmp.rollout(time_step=dmp.duration / (samples - 1))
    if task == "imitate":
        times, poses = peers.imitation(given)
        return lambda: peers.fit(times, poses, basis_functions)
    if task == "open_loop":
        fitted = peers.fit(*peers.imitation(usual), basis_functions)
        fitted.dt_ = fitted.int_dt = fitted.execution_time_ / (samples - 1)
        return lambda: fitted.open_loop()
    raise ValueError(f"no such task: {task}")


def _limited(count: int) -> ConstraintSystem:
    """A blade, and balls in a row that it passes by at a distance."""
    balls = [KeepOutSphere(center=(3 + 0.1 * k, 0, 0), radius=0.05) for k in range(count)]
    return ConstraintSystem([Blade(), *balls])


def _beside(dmp: ConstrainedDMP, count: int) -> list[tuple[float, Any]]:
    """Points to pass, evenly in time, a thousandth of the path above it."""
    if not count:
        return []
    motion, fractions = dmp.rollout(), (np.arange(count) + 1) / (count + 1)
    times = motion.times[0] + motion.duration * np.concatenate([[0.0], fractions])
    above = motion.resampled(times=times).positions[1:] + [0, 0, 1e-3 * motion.path_length]
    return list(zip(fractions.tolist(), above, strict=True))


def measure(task: str, samples: int, basis_functions: int, limits: int = 0, vias: int = 0) -> Case:
    """Run one case in this process."""
    warnings.simplefilter("ignore", NoslipWarning)
    call = prepare(task, samples, basis_functions, limits, vias)
    learns = task in ("fit", "learn", "adapt")
    peak = PeakMemory()
    forget()
    peak.start()
    first = _seconds(call)
    memory = peak.above()
    seconds: list[float] = []
    while first < 2 * LONGEST and sum(seconds) < LONGEST and len(seconds) < MOST_REPETITIONS:
        if learns:
            forget()
        seconds.append(_seconds(call))
    least = min([first, *seconds])
    return Case(task, samples, basis_functions, least, first, memory, limits, vias)


def _seconds(call: Callable[[], Any]) -> float:
    begin = process_time()
    call()
    return process_time() - begin


if __name__ == "__main__":
    name, *sizes = sys.argv[1:]
    print(json.dumps(asdict(measure(name, *map(int, sizes)))))
