"""The command line: runs everything, prints a table, and fails where a bound is broken."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import nullcontext
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table

from benchmarks import peers
from benchmarks.feedback import cartesian, in_c
from benchmarks.feedback.judge import Bounds, Figures
from benchmarks.feedback.scenarios import MEDIAN_END, SCENARIOS
from benchmarks.feedback.tasks import TASKS, missing
from benchmarks.feedback.trial import (
    GENERATORS,
    NAMED,
    OURS,
    Outcome,
    Trial,
    cost_of_gains,
    trials,
    tried,
)
from noslip._files import write_beside

RATES = (200.0, 1000.0)
SEEDS, QUICK_SEEDS = 20, 1
QUICK_TASKS, QUICK_RATES = ("s-cut", "needle"), (200.0,)
PROCESSES = 2
IN_C = 1e-9
"""m, and of quaternions: what the exported controller may differ by."""
PIPED_WIDTH = 180
COLUMNS = (
    "scenario",
    "generator",
    "arrived",
    "time / T",
    "plans",
    "slip",
    "turning, speed",
    "their gains",
    "beyond lag",
    "skipped",
    "end",
    "within bounds",
)
NOTES = """\
arrived: done, and within 1 % of the path of its goal.
time: of those, over the duration; of a goal that moves after the end, since then.
slip: commanded, over the demonstration's top speed.
turning, speed, their gains: commanded angular and linear speed and acceleration, over the
demonstration's peaks; not while a hand leads the command.
beyond lag: distance of the executed path from the demonstration's, over its length, beyond that of
the plain motion on the same robot.
skipped: distance of the demonstration's path from where the tool went untouched, over its length.
end: distance from the goal, over the path's length.
Each of the worst run; where there are two, of the median run (and of the worst)."""
_EXAMPLES = """\
examples (from the repository's root):
  python -m benchmarks.feedback                    the whole table: hours
  python -m benchmarks.feedback --quick --gate     minutes; fails where noslip breaks a bound
  python -m benchmarks.feedback --generator noslip --scenario "goal step" --task wheel --rate 1000
  python -m benchmarks.feedback --add a.json --add b.json --markdown table.md
  python -m benchmarks.feedback --tune             seek phase stopping's gains anew
"""
Given = TypeVar("Given")
Found = TypeVar("Found")


def run(arguments: Sequence[str] | None = None) -> int:
    """Parse arguments, run, print; return the exit code."""
    options = _parser().parse_args(arguments)
    if options.tune:
        return _tune(options.processes)
    quick = options.quick
    outcomes = []
    for file in options.add:
        try:
            outcomes += read(file)
        except (OSError, ValueError, KeyError, TypeError) as error:
            print(
                f"--add {file}: no runs as --json writes them ({error}); make them anew",
                file=sys.stderr,
            )
            return 2
    # From files alone, if nothing says what to run.
    runs = quick or options.generator or not options.add
    names = options.task or (QUICK_TASKS if quick else TASKS)
    left_out = [reason for name in names if (reason := missing(name))] if runs else []
    if runs and peers.MISSING:
        left_out.append(peers.MISSING)
    count = options.seeds or (QUICK_SEEDS if quick else SEEDS)
    wanted = trials(
        options.scenario or [scenario.name for scenario in SCENARIOS],
        [name for name in names if not missing(name)],
        options.rate or (QUICK_RATES if quick else RATES),
        range(options.first_seed, options.first_seed + count),
        tuple(options.generator or GENERATORS),
    )
    if options.in_c:
        return _compare(wanted, options.processes)
    if runs:
        outcomes += [one for found in _each(tried, wanted, options.processes) for one in found]
    _show(outcomes, left_out)
    broken = [one for one in outcomes if one.generator == OURS and one.broken]
    for one in broken:
        print(
            f"{one.scenario}, {one.task}, {one.rate:g} Hz, seed {one.seed}: "
            + "; ".join(one.broken),
            file=sys.stderr,
        )
    medians = list(_broken_median(outcomes))
    for text in medians:
        print(text, file=sys.stderr)
    if options.json is not None:
        write_beside(options.json, as_json(outcomes, left_out))
    if options.markdown is not None:
        write_beside(options.markdown, ("\n".join(markdown(outcomes)) + "\n").encode())
    return int(options.gate and bool(broken or medians))


def _count(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"must be a whole number, 1 or more, got {text!r}")
    return int(text)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.feedback",
        description=__doc__,
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("--quick", action="store_true", help="one seed, two tasks, 200 Hz")
    add("--gate", action="store_true", help="exit with 1 where noslip breaks a bound")
    add("--seeds", type=_count, metavar="N", help=f"of each combination; {SEEDS} by default")
    add("--first-seed", type=int, default=0, metavar="K")
    add(
        "--scenario", action="append", choices=list(NAMED), help="again for several; all by default"
    )
    add("--task", action="append", choices=list(TASKS), help="the same")
    add("--rate", action="append", type=float, metavar="HZ", help="of the loop; the same")
    add("--generator", action="append", choices=list(GENERATORS), help="the same")
    add("--processes", type=_count, default=PROCESSES)
    add("--markdown", type=Path, metavar="FILE", help="write a short table, as the docs have it")
    add("--json", type=Path, metavar="FILE", help="write every run's figures")
    add("--in-c", action="store_true", help="compare the exported controller with Python's")
    add(
        "--add",
        action="append",
        default=[],
        type=Path,
        metavar="FILE",
        help="of --json: its runs, judged anew, beside these; alone without --generator or --quick",
    )
    add("--tune", action="store_true", help="seek phase stopping's gains on the held-out scenario")
    return parser


def _each(
    work: Callable[[Given], Found], given: Sequence[Given], processes: int
) -> Iterator[Found]:
    """Work on each, in order, and say how far it is."""
    with ProcessPoolExecutor(processes) if processes > 1 else nullcontext() as pool:
        for k, found in enumerate(map(work, given) if pool is None else pool.map(work, given)):
            print(f"\r{k + 1} of {len(given)}", end="", file=sys.stderr, flush=True)
            yield found
    print(file=sys.stderr)


def _tune(processes: int) -> int:
    costs = list(_each(cost_of_gains, cartesian.GRID, processes))
    for cost, gains in sorted(zip(costs, cartesian.GRID, strict=True), key=lambda pair: pair[0])[
        :5
    ]:
        print(f"{cost:.4f}  {gains}")
    return 0


def _compare(wanted: Sequence[Trial], processes: int) -> int:
    """Say how far the exported controller is from Python's."""
    found = list(_each(in_c.difference, wanted, processes))
    for trial, off in zip(wanted, found, strict=True):
        if not off <= IN_C:
            print(
                f"{trial.scenario}, {trial.task}, {trial.rate:g} Hz, seed {trial.seed}: {off:.3g}"
            )
    print(f"{len(found)} runs in C and in Python: commands differ by {max(found):.2g} at most")
    return int(not max(found) <= IN_C)


# ---------------------------------------------------------------- tables


def _groups(outcomes: Iterable[Outcome]) -> dict[tuple[str, str], list[Outcome]]:
    found: dict[tuple[str, str], list[Outcome]] = {}
    for one in outcomes:
        found.setdefault((one.scenario, one.generator), []).append(one)
    order = list(NAMED)
    return dict(sorted(found.items(), key=lambda item: order.index(item[0][0])))


def _broken_median(outcomes: Sequence[Outcome]) -> Iterator[str]:
    """The bound that noslip's runs of a scenario have together."""
    for (scenario, generator), group in _groups(outcomes).items():
        median = np.median([one.figures.end for one in group])
        if generator == OURS and not median <= MEDIAN_END:
            yield f"{scenario}: median end {median:.3g} > {MEDIAN_END:g}"


def _values(group: Iterable[Any], name: str) -> list[float]:
    """Of a figure, where there is one; nan, so that there is something to take the median of."""
    found = [float(getattr(one, name)) for one in group]
    return [value for value in found if np.isfinite(value)] or [np.nan]


def _number(value: float) -> str:
    return f"{value:.3g}" if np.isfinite(value) else "-"


def _both(group: Sequence[Any], name: str) -> str:
    values = _values(group, name)
    return f"{_number(np.median(values))} ({_number(max(values))})"


def rows(outcomes: Sequence[Outcome]) -> Iterator[tuple[str, ...]]:
    """Of the table, see :data:`COLUMNS`."""
    for (scenario, generator), group in _groups(outcomes).items():
        figures = [one.figures for one in group]
        done = [f for f in figures if f.arrived]
        most = {
            name: _number(max(_values(figures, name)))
            for name in ("plans", "slip", "turning", "speed", "turning_gain", "gain")
        }
        yield (
            scenario,
            generator,
            f"{len(done)} of {len(group)}",
            _both(done, "time"),
            most["plans"],
            most["slip"],
            f"{most['turning']}, {most['speed']}",
            f"{most['turning_gain']}, {most['gain']}",
            _number(max(_values(group, "beyond_lag"))),
            _both(figures, "skipped"),
            _both(figures, "end"),
            _within(group),
        )


def _within(group: Sequence[Outcome]) -> str:
    return f"{sum(not one.broken for one in group)} of {len(group)}"


def told(bounds: Bounds) -> tuple[str, ...]:
    """The row of a scenario's bounds."""

    def most(value: float) -> str:
        return f"{value:g}" if np.isfinite(value) else ""

    end = f"({most(bounds.end)})"
    return (
        "all",
        f"({most(bounds.time)})",
        most(bounds.plans),
        most(bounds.slip),
        f"{most(bounds.turning)}, {most(bounds.speed)}",
        f"{most(bounds.turning_gain)}, {most(bounds.gain)}",
        most(bounds.beyond_lag),
        f"({most(bounds.skipped)})" if np.isfinite(bounds.skipped) else "",
        end,
        "",
    )


def table(outcomes: Sequence[Outcome]) -> list[tuple[str, ...]]:
    """All rows; each scenario begins with its bounds."""
    found, last = [], ""
    for scenario, *row in rows(outcomes):
        if scenario != last:
            found.append((scenario, "at most", *told(NAMED[scenario].bounds)))
        last = scenario
        found.append(("", *row))
    return found


def markdown(outcomes: Sequence[Outcome]) -> list[str]:
    """A row a scenario, a column a generator: arrived, median time, worst end; within bounds."""
    groups = _groups(outcomes)
    generators = list(dict.fromkeys(generator for _, generator in groups))
    lines = ["| | " + " | ".join(generators) + " |", "|---" * (len(generators) + 1) + "|"]
    for scenario in dict.fromkeys(scenario for scenario, _ in groups):
        cells = [scenario]
        for generator in generators:
            group = groups.get((scenario, generator), [])
            if not group:
                cells.append("")
                continue
            figures = [one.figures for one in group]
            done = [f for f in figures if f.arrived]
            time, end = np.median(_values(done, "time")), max(_values(figures, "end"))
            share = len(done) / len(group)
            when = f"{time:.2f} T, " if done else ""
            cells.append(f"{share:.0%}, {when}{end:.0e}; {_within(group)}")
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def _show(outcomes: Sequence[Outcome], left_out: Sequence[str]) -> None:
    console = Console()
    if not console.is_terminal:
        console = Console(width=PIPED_WIDTH)
    shown = Table(*COLUMNS, box=box.SIMPLE)
    for row in table(outcomes):
        shown.add_row(*row, style="bold" if row[1] == OURS else None)
    console.print(shown)
    console.print(NOTES, highlight=False)
    for reason in left_out:
        print(reason)


def as_json(outcomes: Sequence[Outcome], left_out: Sequence[str]) -> bytes:
    """Every run; figures that do not exist are null."""

    def plain(value: Any) -> Any:
        if isinstance(value, dict):
            return {name: plain(item) for name, item in value.items()}
        if isinstance(value, float) and not np.isfinite(value):
            return None
        return value

    content = {
        "runs": [plain(asdict(one)) for one in outcomes],
        "bounds": {name: plain(asdict(NAMED[name].bounds)) for name in NAMED},
        "phase_stopping": asdict(cartesian.BEST),
        "left_out": list(left_out),
    }
    return (json.dumps(content, indent=1) + "\n").encode()


def read(file: Path) -> list[Outcome]:
    """Runs as :func:`as_json` wrote them, held against the bounds as they are now."""

    def figure(value: Any) -> Any:
        return np.nan if value is None else value

    found = []
    for run in json.loads(file.read_text())["runs"]:
        figures = Figures(**{name: figure(value) for name, value in run["figures"].items()})
        beyond = figure(run["beyond_lag"])
        bounds = NAMED[run["scenario"]].bounds
        plain = replace(figures, path=figures.path - beyond)
        given = run | {"figures": figures, "beyond_lag": beyond}
        found.append(Outcome(**given | {"broken": tuple(bounds.broken(figures, plain))}))
    return found
