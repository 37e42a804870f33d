"""``python -m benchmarks.side_by_side``: other libraries at the same job.

Prints a table for each of two ends: what each library makes of the job, at which version, in which
processor time, and what is left out and why.  Nothing in it is random.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from benchmarks import single_threaded

single_threaded()

import numpy as np  # noqa: E402

from benchmarks.environment import environment  # noqa: E402
from benchmarks.example import SAMPLES  # noqa: E402
from benchmarks.report import duration  # noqa: E402
from benchmarks.side_by_side import optimizers, ours, primitives, published, tracking  # noqa: E402
from benchmarks.side_by_side.job import MOVED, NOTEBOOK, Job, Row, jobs, notebook, timed  # noqa: E402

KINDS = ("noslip", "jaxls", "pink", "mink", *primitives.LIBRARIES, "paper")
HEADER = (
    "| | slip at most | path, rms off | goal missed by | peak angular speed "
    "| peak angular acceleration | time | times noslip's | first time |\n"
    "|---|---|---|---|---|---|---|---|---|"
)


def measure(kinds: Iterable[str], both: Sequence[Job], authors: Sequence[Path]) -> Iterator[Row]:
    """Measure one kind after the other, both jobs of each; the notebook's of the paper's method."""
    third = notebook(len(both[0].given))
    for kind in kinds:
        if kind == "noslip":
            yield from ours.rows([*both, third])
        elif kind == "jaxls":
            yield from optimizers.rows(both)
        else:
            for job in both:
                if kind in tracking.PACKAGES:
                    yield from tracking.rows(kind, job)
                elif kind != "paper":
                    yield from primitives.rows(kind, job)
                else:
                    yield from published.rows(job, authors)
            if kind == "paper":
                yield from published.rows(third, authors)


def line(row: Row, base: float) -> str:
    """Return a row of the table; ``base`` is noslip's time (s)."""
    name = ", ".join(part for part in (f"{row.library} {row.version}".strip(), row.way) if part)
    if row.merit is None:
        return f"| {name} | left out: {row.skipped} | | | | | | | |"
    merit = row.merit
    # To another end no path is given.
    off = length(merit.position_rms) if row.job != MOVED else ""
    is_papers = row.library in published.NAMES or row.job == NOTEBOOK
    ends = f"; {row.slip_at_ends:.1e} at the ends" if is_papers else ""
    return (
        f"| {name} | {merit.residual_peak:.1e} m/s{ends} | {off} "
        f"| {length(row.missed)} | {merit.angular_speed_peak:.1f} rad/s "
        f"| {merit.angular_acceleration_peak:,.0f} rad/s² | {duration(row.seconds)} "
        f"| {row.seconds / base:.2g} | {duration(row.first)} |"
    )


def length(meters: float) -> str:
    """Return meters in millimeters, of two digits."""
    return f"{1e3 * meters:.2g} mm"


def tables(rows: Sequence[Row], both: Sequence[Job]) -> Iterator[str]:
    """Return the lines of the tables."""
    for job in (*both, notebook(len(both[0].given))):
        of_job = [row for row in rows if row.job == job.name]
        times = [row.seconds for row in of_job if row.library == ours.LIBRARY]
        base = times[0] if times else np.nan
        yield f"\n{job.name}, {len(job.given)} samples\n\n{HEADER}"
        yield from (line(row, base) for row in of_job)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print; write if asked."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.side_by_side", description=__doc__.split("\n\n")[1]
    )
    parser.add_argument("--only", nargs="+", choices=KINDS, default=KINDS, help="some of them")
    parser.add_argument("--samples", type=int, default=SAMPLES, help="of the demonstration")
    parser.add_argument(
        "--authors", nargs="+", type=Path, default=[], metavar="FOLDER", help=published.ABSENT
    )
    parser.add_argument("--rounds", type=int, default=5, help="in which times are taken")
    parser.add_argument("--tune", action="store_true", help="find the steering of pink and mink")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures too")
    asked = parser.parse_args(arguments)
    both = jobs(asked.samples)
    if asked.tune:
        for library in (kind for kind in asked.only if kind in tracking.PACKAGES):
            steering, off = tracking.tune(library, both[0])
            print(f"{library}: {steering}, {length(off)} off")
        return 0
    rows = []
    for row in measure(asked.only, both, asked.authors):
        print(f"{row.library}, {row.way}, {row.job}: {row.skipped or 'done'}", file=sys.stderr)
        rows.append(row)
    rows = timed(rows, asked.rounds)
    print("\n".join(tables(rows, both)))
    if asked.json is not None:
        found = {"environment": environment(), "rows": [row.to_dict() for row in rows]}
        asked.json.write_text(json.dumps(found, indent=2) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
