"""The tables that people read, and the JSON that programs do."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table

from benchmarks import peers
from benchmarks.comparison import OURS, PEER, Comparison, Ratio, StepCost
from benchmarks.example import ALPHA, ALPHA_S, BETA, DURATION
from benchmarks.growth import LEAST_MEMORY, THEIRS, Growth

FORMAT = 1
"""Version of the JSON's layout."""

_AXES = {"samples": "samples", "basis_functions": "basis functions"}


def as_json(
    comparison: Comparison, growths: Sequence[Growth], environment: dict[str, Any]
) -> bytes:
    """Everything measured; times in seconds, memory in bytes, quality in SI units."""
    content = {
        "format": FORMAT,
        "environment": environment,
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
        "quality": {name: asdict(quality) for name, quality in comparison.quality.items()},
        "paper_optimiser": {
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
            for growth in growths
        ],
        "left_out": [peers.MISSING] if peers.MISSING else [],
    }
    return (json.dumps(content, indent=2) + "\n").encode()


def show(
    console: Console,
    comparison: Comparison,
    growths: Sequence[Growth],
    environment: dict[str, Any],
) -> None:
    """Print all tables."""
    for line in _head(comparison, environment):
        console.print(line, highlight=False)
    tables = [
        _timings(comparison),
        _ratios(comparison.ratios),
        _step_costs(comparison.step_costs),
        _quality(comparison),
    ]
    for axis in _AXES:
        along = [growth for growth in growths if growth.axis == axis and growth.cases]
        if along:
            tables.append(_growth(along, axis))
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


def _quality(comparison: Comparison) -> Table:
    table = _table("Motion", "of", "slip m/s", "path rms m", "end m", "turn rad/s", "turn rad/s²")
    for name, quality in comparison.quality.items():
        table.add_row(
            name,
            f"{quality.residual:.1e}",
            f"{quality.position_rms:.1e}",
            f"{quality.position_end:.1e}",
            f"{quality.angular_speed:.1f}",
            f"{quality.angular_acceleration:.0f}",
        )
    table.caption = (
        "slip: largest |c(R_k+1).(p_k+1 - p_k)| / dt; the rest against the demonstration"
    )
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
        "time: lowest of the repetitions; memory: peak above what the process held before, '-' "
        "below 1 MB; exponents: slope of log time and log memory between the two largest sizes"
    )
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
