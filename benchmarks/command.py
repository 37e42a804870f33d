"""The command line of the benchmark."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path

from rich.console import Console

from benchmarks import report
from benchmarks.comparison import compare
from benchmarks.control_loop import LATE_STEPS, MOTIONS, compiling, control
from benchmarks.environment import environment
from benchmarks.example import SAMPLES
from benchmarks.goals import SHIFTS, move_goals
from benchmarks.growth import (
    ADAPTED_SIZES,
    ADAPTING,
    BASIS_SIZES,
    LIMIT_SIZES,
    SAMPLE_SIZES,
    VIA_SIZES,
    grow,
)
from benchmarks.many import RECORDINGS, learn_many
from benchmarks.perturbation import CASES, perturb
from noslip._files import write_beside
from noslip.errors import InputError

ROUNDS, QUICK_ROUNDS = 5, 1
QUICK_CASES = 6
QUICK_RECORDINGS = 8
QUICK_STEPS, QUICK_MOTIONS = 2_000, 50
PIPED_WIDTH = 120
_EXAMPLES = """\
examples (from the repository's root):
  python -m benchmarks                                  print the tables; about 10 minutes
  python -m benchmarks --out benchmarks/results.json    and keep the figures
  python -m benchmarks --quick                          a smoke test; the figures are rough
"""


def run(arguments: Sequence[str] | None = None) -> int:
    """Parse arguments, measure, print, write; return the exit code."""
    options = _parser().parse_args(arguments)
    quick = options.quick
    # All but the last compares what is compiled on neither side.
    with _progress() as progress, compiling(False):
        comparison = compare(
            samples=SAMPLES,
            rounds=QUICK_ROUNDS if quick else ROUNDS,
            repeat_fast=8 if quick else 20,
            progress=progress,
        )
        growths = grow(
            sample_sizes=[n for n in SAMPLE_SIZES if not quick or n <= 10_000],
            basis_sizes=[n for n in BASIS_SIZES if not quick or n <= 300],
            progress=progress,
        )
        growths += grow(
            sample_sizes=ADAPTED_SIZES,
            basis_sizes=() if quick else BASIS_SIZES,
            limit_sizes=LIMIT_SIZES,
            via_sizes=VIA_SIZES[:-2] if quick else VIA_SIZES,
            tasks=(ADAPTING,),
            progress=progress,
        )
        progress("goals that move, and pushes: side by side, as nothing of them is timed")
        with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
            shifts, cases = SHIFTS[-1:] if quick else SHIFTS, QUICK_CASES if quick else CASES
            arriving = pool.submit(move_goals, samples=SAMPLES, shifts=shifts)
            recovering = pool.submit(perturb, samples=SAMPLES, cases=cases)
            arrivals, recoveries = arriving.result(), recovering.result()
        throughputs = learn_many(
            recordings=QUICK_RECORDINGS if quick else RECORDINGS,
            rounds=1 if quick else 3,
            progress=progress,
        )
        loop = control(
            steps=QUICK_STEPS if quick else LATE_STEPS,
            motions=QUICK_MOTIONS if quick else MOTIONS,
            rounds=20 if quick else 200,
            progress=progress,
        )
    results = report.Results(
        comparison, growths, arrivals, recoveries, environment(), throughputs, loop
    )
    console = Console()
    if not console.is_terminal:
        console = Console(width=PIPED_WIDTH)
    report.show(console, results)
    if options.out is not None:
        try:
            written = write_beside(options.out, report.as_json(results))
        except InputError as error:
            print(error, file=sys.stderr)
            return 1
        console.print(f"\nWritten: {written}", highlight=False)
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description="Measure noslip against the paper's method and against movement-primitives.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--out", type=Path, metavar="FILE", help="write all figures as JSON")
    parser.add_argument(
        "--quick", action="store_true", help="one round, and sizes up to 10 000 samples only"
    )
    return parser


@contextmanager
def _progress() -> Iterator[Callable[[str], None]]:
    """Show what is being measured on a terminal; say nothing when piped."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda message: None
        return
    with console.status("") as status:
        yield lambda message: status.update(message)
