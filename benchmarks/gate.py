"""The ratios that must not fall: each of two calls on one machine in one run, in under two minutes.

``python -m benchmarks.gate`` prints them beside what is wanted and the committed baseline;
``--gate`` exits with 1 where one is worse than its baseline by more than :data:`MARGIN`;
``--write`` makes this run the baseline.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

import noslip as ns
from benchmarks import paper_method, peers, planner
from benchmarks.comparison import pushed_state
from benchmarks.control_loop import compiling
from benchmarks.example import BASIS_FUNCTIONS, MOVED_GOAL, SAMPLES, demonstration
from benchmarks.timing import Candidate, measure
from noslip.constraints import Box
from noslip.constraints.system import ConstraintSystem

BASELINE = Path(__file__).with_name("baseline.json")
MARGIN = 0.35
"""Share by which a ratio may be worse than its baseline: medians of the same commit differed by up
to a quarter between a quiet machine and one whose other core was busy."""
ROUNDS = 20
STARTS = 9
"""Of each process."""
PEERS_OF_THE_PLANNER = (
    ("IPOPT", 200, 50, ROUNDS),
    ("IPOPT", 1000, 200, 3),
    ("fatrop", 1000, 50, 7),
)
"""Name, samples, times as fast as it that is wanted, and rounds: IPOPT takes a second at 1000."""
ROWS = 200_000
"""Of the table that is read: a fifth of what people have, so that it is quick."""


@dataclass(frozen=True)
class Pair:
    """Two calls whose times are compared.

    Attributes
    ----------
    name : str
    slow, fast : callable
        The ratio is the time of the first over that of the second.
    wanted : float
        What it should be, on any machine.
    at_most : bool
        Whether smaller is better.
    rounds : int
    """

    name: str
    slow: Callable[[], Any]
    fast: Callable[[], Any]
    wanted: float
    at_most: bool = False
    rounds: int = ROUNDS

    def ratio(self) -> float:
        """Measure: medians, in turn."""
        pair = [Candidate("slow", "", "", self.slow), Candidate("fast", "", "", self.fast)]
        found = measure(pair, self.rounds)
        return found["slow"].median / found["fast"].median

    def worse(self, ratio: float, baseline: float) -> bool:
        """Whether a ratio is worse than a baseline by more than the margin."""
        if self.at_most:
            return ratio > baseline * (1 + MARGIN)
        return ratio < baseline / (1 + MARGIN)


def pairs(folder: Path) -> Iterator[Pair]:
    """What is compared; whatever needs a library that is missing is left out."""
    given, dmp = demonstration(), example()
    new_goal = partial(dmp.adapt, goal_position=MOVED_GOAL)
    learn = partial(ns.learn, given, ns.Blade(), basis_functions=BASIS_FUNCTIONS)
    yield Pair(
        "learn, times the paper's method",
        lambda: paper_method.run(given, BASIS_FUNCTIONS),
        learn,
        300,
        rounds=3,
    )
    if not peers.MISSING:
        open_loop = peers.fit(*peers.imitation(given), BASIS_FUNCTIONS).open_loop
        replan = partial(dmp.replan, pushed_state(dmp, given))
        yield Pair("adapt, times movement-primitives' rollout", open_loop, new_goal, 8)
        yield Pair("replan, times movement-primitives' rollout", open_loop, replan, 20)
        yield Pair("rollout, times movement-primitives' rollout", open_loop, dmp.rollout, 130)
    for name, samples, wanted, rounds in PEERS_OF_THE_PLANNER:
        solve, ours = planner.peer(name.lower(), samples), planner.Planning(samples)
        yield Pair(
            f"planner at {samples} samples, times {name}", solve, ours, wanted, False, rounds
        )
    alone = dmp.rollout
    yield Pair("16 limits that never bind, over none", idle(dmp).rollout, alone, 3, at_most=True)
    yield Pair("8 limits that bind in turn, over none", in_turn(dmp).rollout, alone, 15, True)
    peak = np.linalg.norm(dmp.rollout().linear_velocities, axis=1).max()
    slowed = _limited(dmp, [ns.SpeedLimit(speed=float(0.8 * peak))])
    hurried = partial(slowed.adapt, goal_position=MOVED_GOAL)
    yield Pair(
        "adapt under a speed limit that binds, over none", hurried, new_goal, 3, at_most=True
    )
    goals = np.asarray(dmp.goal_position) + 0.02 * np.random.default_rng(0).normal(size=(500, 3))
    many = partial(dmp.rollout_many, goals=goals, jobs=1)

    def one_by_one() -> None:
        for _ in range(len(goals)):
            dmp.rollout()

    yield Pair("500 rollouts at once, over one after another", many, one_by_one, 1, True, rounds=3)
    try:
        import pandas
    except ImportError:
        return
    path = folder / "long.csv"
    path.write_text(_long_motion().csv_text())
    yield Pair(
        "reading a long CSV, over pandas",
        lambda: ns.load_demonstrations(path),
        lambda: pandas.read_csv(path),
        3,
        at_most=True,
        rounds=3,
    )


def singles(folder: Path) -> Iterator[tuple[str, float, float]]:
    """Names, ratios and what is wanted, at most, of what is no call against another."""
    planning = planner.Planning(SAMPLES)
    band, _ = planner.floor(planning.plan)
    taken = planner.seconds(planning, ROUNDS)
    yield "planner, over its band at the machine's peak", taken / band.seconds, 8
    version = "import sys; sys.argv = ['noslip', '--version']; from noslip.cli import main; main()"
    numbers, engine, told, lazy, work = _processes(
        folder,
        "import numpy",
        "import casadi, scipy.spatial.transform",
        version,
        "import noslip",
        "from noslip import *",
    )
    yield "noslip --version, over importing numpy", told / numbers, 2.5
    yield "importing noslip, over casadi and rotations", lazy / engine, 1.5
    yield "importing all of its names, over the same", work / engine, 1.5


def _processes(folder: Path, *codes: str) -> list[float]:
    """CPU seconds of processes, medians; in turn, after a run that leaves their bytecode."""
    # As installed: not every environment lets Python keep what it compiles.
    env = {key: value for key, value in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}
    env["PYTHONPYCACHEPREFIX"] = str(folder / "bytecode")

    def seconds(code: str) -> float:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([sys.executable, "-c", code], check=True, stdout=subprocess.DEVNULL, env=env)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    taken = [[seconds(code) for code in codes] for _ in range(STARTS + 1)]
    return np.median(taken[1:], axis=0).tolist()


def _limited(dmp: ns.ConstrainedDMP, limits: Sequence[ns.Constraint]) -> ns.ConstrainedDMP:
    system = ConstraintSystem([*dmp.constraints, *limits])
    limited = replace(dmp, rule=replace(dmp.rule, system=system))
    limited.compile()
    return limited


def example() -> ns.ConstrainedDMP:
    """The numerical example's primitive, compiled."""
    dmp = ns.learn(demonstration(), ns.Blade(), basis_functions=BASIS_FUNCTIONS)
    dmp.compile()
    return dmp


def idle(dmp: ns.ConstrainedDMP) -> ns.ConstrainedDMP:
    """The same under sixteen rows of limits, all far away."""
    far = [ns.KeepOutSphere(center=(3 + 0.1 * k, 0, 0), radius=0.05) for k in range(10)]
    return _limited(dmp, [Box(lower=(-9, -9, -9), upper=(9, 9, 9)), *far])


def in_turn(dmp: ns.ConstrainedDMP) -> ns.ConstrainedDMP:
    """The same under eight balls above its path that it ducks under, one after another."""
    motion, radius, depth = dmp.rollout(), 0.2, 0.04
    places = motion.positions[(np.linspace(0.15, 0.85, 8) * (len(motion) - 1)).astype(int)]
    above = places + [0, 0, radius - depth]
    return _limited(dmp, [ns.KeepOutSphere(center=tuple(c), radius=radius) for c in above.tolist()])


def _long_motion() -> ns.PoseTrajectory:
    motion = demonstration(ROWS)
    return replace(motion, times=motion.times * 200)


# ---------------------------------------------------------------- command


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print, and compare with the baseline."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.gate", description=__doc__)
    parser.add_argument("--gate", action="store_true", help="exit with 1 where a ratio has fallen")
    parser.add_argument("--write", action="store_true", help="make this run the baseline")
    chosen = parser.parse_args(arguments)
    baseline = json.loads(BASELINE.read_text()) if BASELINE.exists() else {}
    console = Console(width=None if sys.stdout.isatty() else 110)
    table = Table("ratio of times", "now", "baseline", "wanted", "")
    now, fallen = dict[str, float](), list[str]()

    def add(name: str, ratio: float, wanted: float, at_most: bool, is_worse: bool) -> None:
        now[name] = float(f"{ratio:.3g}")
        met = ratio <= wanted if at_most else ratio >= wanted
        sign, before = "<=" if at_most else ">=", baseline.get(name)
        told = "FALLEN" if is_worse else "" if met else "not met"
        table.add_row(
            name,
            f"{ratio:.3g}",
            "-" if before is None else f"{before:.3g}",
            f"{sign} {wanted:g}",
            told,
        )
        if is_worse:
            fallen.append(name)

    with warnings.catch_warnings(), compiling(True), tempfile.TemporaryDirectory() as folder:
        warnings.simplefilter("ignore", ns.NoslipWarning)
        for pair in pairs(Path(folder)):
            print(f"{pair.name} ...", file=sys.stderr, flush=True)
            ratio = pair.ratio()
            is_worse = pair.name in baseline and pair.worse(ratio, baseline[pair.name])
            if is_worse:
                # Once more: what a busy moment did is not a regression.
                ratio = (min if pair.at_most else max)(ratio, pair.ratio())
                is_worse = pair.worse(ratio, baseline[pair.name])
            add(pair.name, ratio, pair.wanted, pair.at_most, is_worse)
        for name, ratio, wanted in singles(Path(folder)):
            is_worse = name in baseline and ratio > baseline[name] * (1 + MARGIN)
            add(name, ratio, wanted, True, is_worse)
    console.print(table)
    if chosen.write:
        BASELINE.write_text(json.dumps(now, indent=2) + "\n")
        print(f"written: {BASELINE}")
    if fallen:
        print("fallen by more than a third: " + ", ".join(fallen), file=sys.stderr)
    return int(chosen.gate and bool(fallen))


if __name__ == "__main__":
    raise SystemExit(main())
