"""The tables that people read, and the JSON that programs do."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table

from benchmarks import peers
from benchmarks.comparison import OURS, PEER, Comparison, Ratio, StepCost
from benchmarks.control_loop import ControlLoop
from benchmarks.example import ALPHA, ALPHA_S, BETA, DURATION
from benchmarks.goals import Arrival
from benchmarks.growth import ADAPTING, LEAST_MEMORY, THEIRS, Growth
from benchmarks.many import WANTED, Throughput
from benchmarks.perturbation import REACHED, Recovery, Summary, summaries

FORMAT = 1
"""Version of the JSON's layout."""

_AXES = {
    "samples": "samples",
    "basis_functions": "basis functions",
    "limits": "limits that do not bind",
    "vias": "via points",
}


@dataclass(frozen=True)
class Results:
    """Everything measured.

    Attributes
    ----------
    comparison : Comparison
    growths : sequence of Growth
    arrivals : sequence of Arrival
    recoveries : sequence of Recovery
    environment : dict
    throughputs : sequence of Throughput
    loop : ControlLoop or None
    """

    comparison: Comparison
    growths: Sequence[Growth]
    arrivals: Sequence[Arrival]
    recoveries: Sequence[Recovery]
    environment: dict[str, Any]
    throughputs: Sequence[Throughput] = ()
    loop: ControlLoop | None = None


def as_json(results: Results) -> bytes:
    """Everything measured; times in seconds, memory in bytes, figures of merit in SI units."""
    comparison = results.comparison
    content = {
        "format": FORMAT,
        "environment": results.environment,
        "demonstration": {
            "name": "numerical example of the paper",
            "samples": comparison.samples,
            "duration": DURATION,
            "basis_functions": comparison.basis_functions,
            "alpha": ALPHA,
            "beta": BETA,
            "alpha_s": ALPHA_S,
        },
        "timings": [asdict(timing) for timing in comparison.timings.values()],
        "ratios": [{**asdict(ratio), "met": ratio.met} for ratio in comparison.ratios],
        "step_costs": [asdict(cost) for cost in comparison.step_costs],
        "merits": {name: merit.to_dict() for name, merit in comparison.merits.items()},
        "paper_optimizer": {
            "loss_evaluations": comparison.paper_evaluations,
            "unconverged_steps": comparison.paper_unconverged,
            "steps": comparison.samples - 1,
        },
        "growth": [
            {
                "task": growth.task,
                "axis": growth.axis,
                "time_exponent": growth.time_exponent,
                "memory_exponent": growth.memory_exponent,
                "cases": [asdict(case) for case in growth.cases],
            }
            for growth in results.growths
        ],
        "moved_goals": [asdict(arrival) for arrival in results.arrivals],
        "pushes": {
            "summaries": [asdict(summary) for summary in summaries(results.recoveries)],
            "cases": [asdict(recovery) for recovery in results.recoveries],
        },
        "many_recordings": [
            {**asdict(throughput), "rate": throughput.rate} for throughput in results.throughputs
        ],
        "control_loop": None if results.loop is None else asdict(results.loop),
        "left_out": [peers.MISSING] if peers.MISSING else [],
    }
    return (json.dumps(content, indent=2) + "\n").encode()


def show(console: Console, results: Results) -> None:
    """Print all tables."""
    comparison, growths = results.comparison, results.growths
    for line in _head(comparison, results.environment):
        console.print(line, highlight=False)
    tables = [
        _timings(comparison),
        _ratios(comparison.ratios),
        _step_costs(comparison.step_costs),
        _merits(comparison),
    ]
    for axis in _AXES:
        along = [growth for growth in growths if growth.axis == axis and growth.cases]
        # An adaptation has sizes of its own.
        adapting = [growth for growth in along if growth.task == ADAPTING]
        others = [growth for growth in along if growth.task != ADAPTING]
        tables += [_growth(group, axis) for group in (others, adapting) if group]
    if results.arrivals:
        tables.append(_moved_goals(results.arrivals))
    if results.recoveries:
        tables.append(_pushes(summaries(results.recoveries)))
    if results.throughputs:
        tables.append(_throughputs(results.throughputs))
    if results.loop is not None:
        tables += [_latencies(results.loop), _shares(results.loop)]
    for table in tables:
        console.print()
        console.print(table)


def _head(comparison: Comparison, environment: dict[str, Any]) -> Iterable[str]:
    yield (
        f"The paper's numerical example: {comparison.samples} samples, "
        f"{comparison.basis_functions} basis functions, nothing compiled on the spot"
    )
    versions = ("python", "noslip", "numpy", "scipy", "casadi", "movement-primitives")
    yield ", ".join(f"{name} {environment[name] or '(absent)'}" for name in versions)
    yield (
        f"{environment['cpu']}, {environment['cores']} cores; "
        f"BLAS threads: {environment['blas_threads']}"
    )
    if peers.MISSING:
        yield peers.MISSING
    else:
        yield f"movement-primitives' step functions: {peers.step_functions()}"
    yield (
        f"the paper's method: {comparison.paper_evaluations} evaluations of its loss; BFGS reports "
        f"no convergence at {comparison.paper_unconverged} of {comparison.samples - 1} steps"
    )


def _table(title: str, first: str, *columns: str) -> Table:
    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column(first, overflow="fold")
    for column in columns:
        table.add_column(column, justify="right", no_wrap=True)
    return table


def _timings(comparison: Comparison) -> Table:
    table = _table("Time", "what", "median", "lowest", "quartiles", "runs")
    library = None
    for timing in comparison.timings.values():
        if timing.library != library:
            library = timing.library
            table.add_row(f"[bold]{library}[/bold]")
        table.add_row(
            f"  {timing.label}",
            duration(timing.median),
            duration(timing.minimum),
            f"{duration(timing.lower_quartile)} .. {duration(timing.upper_quartile)}",
            str(timing.runs),
        )
    return table


def _ratios(ratios: Iterable[Ratio]) -> Table:
    table = _table("How many times faster noslip is", "what", "ratio", "of lowest", "target", "")
    for ratio in ratios:
        target = "no slower" if ratio.target == 1 else f"{ratio.target:g} or more"
        if ratio.value is None:
            table.add_row(ratio.name, "not measured", "", target, "")
        else:
            verdict = "met" if ratio.met else "MISSED"
            table.add_row(
                ratio.name, f"{ratio.value:.1f}", f"{ratio.of_lowest:.1f}", target, verdict
            )
    table.caption = "ratio of the medians, which the targets are for; beside it that of the lowest"
    table.caption_justify = "left"
    return table


def _step_costs(costs: Iterable[StepCost]) -> Table:
    table = _table("A step of noslip's rollout, uncompiled", "what", "median", "target")
    for cost in costs:
        table.add_row(cost.name, duration(cost.seconds), f"{duration(cost.target)} or less")
    return table


def _merits(comparison: Comparison) -> Table:
    table = _table("Motion", "of", "slip m/s", "path rms m", "end m", "turn rad/s", "turn rad/s²")
    for name, merit in comparison.merits.items():
        table.add_row(
            name,
            f"{merit.residual_peak:.1e}",
            f"{merit.position_rms:.1e}",
            f"{merit.end_error:.1e}",
            f"{merit.angular_speed_peak:.1f}",
            f"{merit.angular_acceleration_peak:.0f}",
        )
    table.caption = "slip: as noslip.check finds; path and end: off the demonstration"
    table.caption_justify = "left"
    return table


def _growth(growths: Sequence[Growth], axis: str) -> Table:
    sizes = sorted({getattr(case, axis) for growth in growths for case in growth.cases})
    table = _table(
        f"Growth with {_AXES[axis]}: time and peak memory",
        "task",
        *(f"{size:,}" for size in sizes),
        "exponents",
    )
    for growth in growths:
        cells = {getattr(case, axis): case for case in growth.cases}
        row = [
            f"{duration(cells[size].seconds)} {memory(cells[size].memory):>7}"
            if size in cells
            else "skipped"
            for size in sizes
        ]
        library = PEER if growth.task in THEIRS else OURS
        exponents = f"{_exponent(growth.time_exponent)} {_exponent(growth.memory_exponent):>5}"
        table.add_row(f"{library} {growth.task}", *row, exponents)
    table.caption = (
        "CPU time: lowest of the repetitions; memory: peak above what the process held before, '-' "
        "below 1 MB; exponents: slope of log time and log memory between the two largest sizes"
    )
    table.caption_justify = "left"
    return table


def _moved_goals(arrivals: Iterable[Arrival]) -> Table:
    table = _table(
        "Goal moved from the start", "by", "end m", "end °", "goal °", "slip m/s", "turn rad/s"
    )
    moved = None
    for a in arrivals:
        if moved != (a.direction, a.shift):
            moved = a.direction, a.shift
            by = f"{a.shift:g} m along {a.direction}" if a.shift else a.direction
            table.add_row(f"[bold]{by}[/bold]")
        table.add_row(
            f"  {a.method}",
            f"{a.position:.1e}",
            f"{np.degrees(a.rotation):.1f}",
            f"{np.degrees(a.from_demonstrated):.1f}",
            f"{a.residual:.1e}",
            f"{a.angular_speed:.1f}",
        )
    table.caption = (
        "end m: distance from the goal; end °: from where the same method ends if the goal does "
        "not move; goal °: from the demonstrated end; slip and turn: the largest"
    )
    table.caption_justify = "left"
    return table


def _pushes(found: Iterable[Summary]) -> Table:
    table = _table(
        "Pushed by 1 to 20 % of the path", "cases", "number", "reached", "median", "95 %", "worst",
        "slip m/s", "turn rad/s", "time",
    )  # fmt: skip
    cases = None
    for s in found:
        if cases != s.cases:
            cases = s.cases
            table.add_row(f"[bold]{cases}[/bold]")
        table.add_row(
            f"  {s.method}",
            str(s.count),
            f"{s.reached:.1%}",
            *(f"{error:.2%}" for error in (s.median, s.percentile_95, s.worst)),
            f"{s.residual:.1e}",
            f"{s.angular_speed:.1f}",
            f"{s.duration:.2f}",
        )
    table.caption = (
        f"reached: within {REACHED:.0%} of the path from the goal at the end; median, 95 % and "
        "worst: distance from it over the path; slip: the largest after the push; turn: median of "
        "the largest angular speed after the push; time: median over that without a push"
    )
    table.caption_justify = "left"
    return table


def _throughputs(found: Sequence[Throughput]) -> Table:
    table = _table(
        f"Many recordings: {found[0].recordings} of {found[0].samples} samples",
        "processes", "time", "recordings/s", "times the first", "failed", "start",
    )  # fmt: skip
    for t in found:
        table.add_row(
            str(t.processes),
            duration(t.seconds),
            f"{t.rate:.1f}",
            f"{t.rate / found[0].rate:.2f}",
            str(t.failed),
            duration(t.start),
        )
    table.caption = (
        f"time: lowest of the rounds, processes started before; two should reach {WANTED:g} times "
        "one, where two cores are idle"
    )
    table.caption_justify = "left"
    return table


def _latencies(loop: ControlLoop) -> Table:
    table = _table(
        "In the control loop: a step",
        "step", "number", "median", "target", "99.9 %", "target", "worst",
    )  # fmt: skip
    for step in loop.latencies:
        table.add_row(
            step.name,
            str(step.steps),
            duration(step.median),
            "-" if step.target is None else duration(step.target),
            duration(step.late),
            "-" if step.late_target is None else duration(step.late_target),
            duration(step.worst),
        )
    floor = loop.floor
    table.caption = (
        f"floor: {floor.operations} operations, {floor.functions} exponentials, roots and "
        f"divisions, {floor.bytes} bytes a step: {1e9 * floor.seconds:.0f} ns at this machine's "
        f"{floor.peak / 1e9:.1f} billion operations (of a matrix product) and "
        f"{floor.bandwidth / 1e9:.0f} GB a second"
    )
    table.caption_justify = "left"
    return table


def _shares(loop: ControlLoop) -> Table:
    table = _table("In the control loop: rollouts and batches", "what", "value", "target", "met")
    for name, seconds in loop.rollouts.items():
        table.add_row(f"rollout, {name}", duration(seconds), "-", "-")
    if loop.batch:
        batch = loop.batch
        table.add_row(
            f"a motion of {batch['motions']:.0f}, {batch['cores']:.0f} cores",
            duration(batch["seconds a motion"]),
            "-",
            "-",
        )
    for share in loop.shares:
        sign = "<=" if share.at_most else ">="
        met = "yes" if share.met else "no"
        table.add_row(share.name, f"{share.value:.3g}", f"{sign} {share.target:g}", met)
    table.caption = "; ".join(loop.left_out)
    table.caption_justify = "left"
    return table


def _exponent(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def duration(seconds: float) -> str:
    """Return seconds with three digits and a unit."""
    for factor, unit in ((1.0, "s"), (1e3, "ms"), (1e6, "µs")):
        if seconds * factor >= 1:
            return f"{_three(seconds * factor)} {unit}"
    return f"{seconds * 1e6:.2f} µs"


def memory(size: int | None) -> str:
    """Return bytes in MB."""
    return "-" if size is None or size < LEAST_MEMORY else f"{size / 1e6:.0f} MB"


def _three(value: float) -> str:
    return f"{value:.{max(0, 3 - len(str(int(value))))}f}"
