"""``noslip segment``: one long recording in, its demonstrations out.

noslip segment session.csv --out cuts/ --figure cuts.png

noslip segment session.csv --tool-frame 0.052,0,0.013 --lowpass 4.8 --drop-outliers --out cuts/

noslip segment session.csv --at contact --contact-column fz --out cuts/

noslip segment session.csv --at contact --height 0,0,1 --thresholds 0.001,0.002 --out cuts/

noslip segment session.csv --at times --times 3:9.5 --times 14:21 --out cuts/
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import typer
from rich.table import Table
from rich.text import Text

from noslip._instants import counts_from_afar, interval
from noslip._typing import Floats
from noslip.cli import options, output
from noslip.demonstrations.outliers import FEWEST, Outliers, outliers
from noslip.demonstrations.preparation import relative_to_start
from noslip.demonstrations.segmentation import MINIMUM_REST, Segments, segment
from noslip.errors import InputError, one_line
from noslip.figures.segments import BETWEEN, recording_cuts
from noslip.figures.style import save_figure
from noslip.recordings import read_column
from noslip.recordings.formats import expand
from noslip.trajectory import PoseTrajectory

_CUTS = "Where to cut"
"""Heading of these options in the help."""


At = Literal["rests", "contact", "times"]
"""What tells the pieces of a recording."""


Side = Literal["above", "below"]
"""On which side of the thresholds contact is."""


@dataclass(frozen=True)
class Given(options.Loading):
    """A long recording has holes; they are cuts."""

    gaps: options.GapsChoice = "split"


@options.grouped
def run(
    recording: options.Recording,
    out: Annotated[Path, options.out("the pieces: a folder, made if missing")],
    at: Annotated[
        At, typer.Option(help="Cut where the tool rests, by contact, or at given times.")
    ] = "rests",
    contact_column: Annotated[
        str | None,
        options.optional(
            "NAME",
            "Column of the recording that tells contact (with --at contact), such as fz.",
            _CUTS,
        ),
    ] = None,
    in_contact: Annotated[
        Side | None,
        typer.Option(
            help="Of --contact-column, on which side of the thresholds contact is (by default "
            "above).",
            rich_help_panel=_CUTS,
            show_default=False,
        ),
    ] = None,
    height: Annotated[
        str | None,
        options.optional(
            "X,Y,Z",
            "Or contact where the tool is low along this direction, upwards in the world.",
            _CUTS,
        ),
    ] = None,
    times: Annotated[
        list[str],
        options.optional(
            "START:END",
            "A piece (s, with --at times); repeatable, either side may be empty.",
            _CUTS,
        ),
    ] = [],  # noqa: B006 - typer's way to say none
    thresholds: Annotated[
        str | None,
        options.optional(
            "A,B",
            "Of the speed (m/s, or a vector's own unit over s), the column or the height (m); by "
            "default from the recording.",
            _CUTS,
        ),
    ] = None,
    minimum_duration: Annotated[
        float | None,
        options.optional("S", "Cut out what is shorter; by default half a typical piece.", _CUTS),
    ] = None,
    minimum_rest: Annotated[
        float,
        typer.Option(metavar="S", help="What parts two pieces.", rich_help_panel=_CUTS),
    ] = MINIMUM_REST,
    drop_outliers: Annotated[
        bool,
        typer.Option(
            "--drop-outliers",
            help="Cut out pieces that lie far from the others; by default they are only named.",
        ),
    ] = False,
    figure: options.Figure = None,
    as_json: options.AsJson = False,
    given: Given = Given(),
) -> None:
    """Cut a long recording into demonstrations, one CSV file a piece.

    The recording is prepared as a whole, or between its holes, and then cut.  Thresholds come
    from its own noise at rest; approach motions, much shorter than the rest, are cut out too.
    Look at --figure before you learn from the pieces.
    """
    if out.exists() and not out.is_dir():
        raise InputError(f"--out: {out} is a file; give a folder")
    options.figure(figure)
    _require_consistent(at, contact_column, in_contact, height, times)
    (source, *others) = expand(recording)
    if others:
        raise InputError(f"{recording}: {1 + len(others)} recordings; segment one at a time")
    cuts: dict[str, Any] = {"minimum_duration": minimum_duration, "minimum_rest": minimum_rest}
    if thresholds is not None:
        cuts["thresholds"] = tuple(options.numbers("--thresholds", thresholds, (2,)))
    if times:
        cuts["times"] = [_start_and_end(text) for text in times]
    parts = replace(given, relative=False).load([recording])
    if len(parts) > 1 and not parts[0].name.endswith("/part_1"):
        raise InputError(f"{recording}: {len(parts)} recordings; segment one at a time")
    found = []
    for whole in parts:
        if contact_column is not None:
            stamps, values = read_column(
                source, contact_column, rate=given.sample_rate, time=given.time_column
            )
            cuts["contact"] = np.interp(whole.times, stamps, values)
            cuts["in_contact"] = in_contact or "above"
        elif height is not None:
            cuts["contact"] = _height(whole, height)
            cuts["in_contact"] = "below"
        found.append(segment(whole, **cuts))

    found, judged = _judged(found, drop_outliers)
    files = _write(found, source, out, given.relative)
    figures = [_numbered(figure, k, found) for k in range(len(found))]
    for each, drawn in zip(found, figures, strict=True):
        if drawn is not None:
            save_figure(recording_cuts(each), drawn)
    if as_json:
        results = [
            _result(each, names, judged, drawn)
            for each, names, drawn in zip(found, files, figures, strict=True)
        ]
        output.print_json(results[0] if len(results) == 1 else {"parts": results})
        return
    screen = output.console()
    first = 1
    for each, names in zip(found, files, strict=True):
        screen.print(_table(each, names, first, float(parts[0].times[0])))
        screen.print(_thresholds_text(each))
        first += len(names)
    screen.print(f"wrote {_count(found)} to {out}")
    for drawn in filter(None, figures):
        screen.print(f"wrote {drawn}")


def _numbered(figure: Path | None, number: int, found: Sequence[Segments]) -> Path | None:
    """Return what to draw a part of a recording with holes to."""
    if figure is None or len(found) == 1:
        return figure
    return figure.with_stem(f"{figure.stem}_{number + 1}")


def _judged(found: list[Segments], drop_outliers: bool) -> tuple[list[Segments], Outliers | None]:
    """Name the pieces that lie far from the others, or cut them out."""
    pieces = [piece for each in found for piece in each.pieces]
    judged = outliers(pieces) if len(pieces) >= FEWEST else None
    outlying = np.flatnonzero(judged.outlying).tolist() if judged else []
    far = {i: judged.reason(i) for i in outlying} if judged else {}
    for index, reason in far.items():
        fate = "dropped" if drop_outliers else "kept, see --drop-outliers"
        piece = pieces[index]
        when = interval(piece.times[0], piece.times[-1], found[0].recording.times[0])
        typer.echo(one_line(f"noslip: {piece.name} ({when}): {reason}; {fate}"), err=True)
    if drop_outliers and judged is None:
        typer.echo(
            f"noslip: --drop-outliers: {_count(found)} only; outliers show among {FEWEST} and more",
            err=True,
        )
    if not drop_outliers:
        return found, judged
    kept, before = [], 0
    for each in found:
        inside = range(before, before + len(each.pieces))
        kept.append(each.without({i - before: far[i] for i in inside if i in far}))
        before = inside.stop
    return kept, judged


def _require_consistent(
    at: At, column: str | None, in_contact: Side | None, height: str | None, times: list[str]
) -> None:
    """Refuse options that belong to another way of cutting."""
    given = {"--contact-column": column, "--height": height, "--times": times or None}
    options_of = {"contact": {"--contact-column", "--height"}, "times": {"--times"}}
    wanted = options_of.get(at, set())
    named = {option for option, value in given.items() if value is not None}
    if stray := sorted(named - wanted):
        kind = "times" if stray[0] == "--times" else "contact"
        raise InputError(f"{stray[0]} says nothing about --at {at}; give --at {kind}")
    if wanted and len(named) != 1:
        raise InputError(f"--at {at} needs {' or '.join(sorted(wanted))}")
    if in_contact is not None and column is None:
        raise InputError("--in-contact is about --contact-column; give that, too")


def _height(whole: PoseTrajectory, text: str) -> Floats:
    direction = np.array(options.vector("--height", text))
    if not np.any(direction):
        raise InputError("--height: 0,0,0 is no direction; give the world's upward one")
    if not (whole.space.bodies and whole.space.is_placed):
        raise InputError(
            f"--height: is of a place in space, and {whole.name} holds "
            f"{', '.join(whole.space.coordinates)}; give --contact-column"
        )
    return np.asarray(whole.positions @ (direction / np.linalg.norm(direction)))


def _start_and_end(text: str) -> tuple[float | None, float | None]:
    start, colon, end = text.partition(":")
    try:
        bounds = [float(side) if side.strip() else None for side in (start, end)]
    except ValueError:
        bounds = [math.nan]
    if not colon or any(bound is not None and math.isnan(bound) for bound in bounds):
        raise InputError(
            f"--times: expected START:END in seconds, either side may be empty; got {text!r}"
        )
    return bounds[0], bounds[1]


def _write(found: Sequence[Segments], source: Path, out: Path, relative: bool) -> list[list[Path]]:
    """Write the pieces of each part; refuse to leave those of another run among them."""
    stem, count = source.stem, itertools.count(1)
    files = [[out / f"{stem}_{next(count):02}.csv" for _ in each.pieces] for each in found]
    written = {file for names in files for file in names}
    stale = sorted(set(out.glob(f"{stem}_[0-9][0-9].csv")) - written) if out.is_dir() else []
    if stale:
        raise InputError(
            f"--out: {stale[0]} is left from an earlier run, and this one has "
            f"{_count(found)}; remove it or give another folder"
        )
    for each, names in zip(found, files, strict=True):
        for piece, file in zip(each.pieces, names, strict=True):
            (relative_to_start(piece) if relative else piece).to_csv(file)
    return files


def _result(
    segments: Segments, files: list[Path], judged: Outliers | None, figure: Path | None
) -> dict[str, Any]:
    written = iter(files)
    result: dict[str, Any] = {
        "recording": segments.recording.name,
        "cut_by": segments.quantity,
        "thresholds": None if segments.thresholds is None else list(segments.thresholds),
        "minimum_duration": segments.minimum_duration,
        "intervals": [
            {
                "start": interval.start,
                "end": interval.end,
                "reason": interval.reason,
                "file": str(next(written)) if interval.reason is None else None,
            }
            for interval in segments.intervals
        ],
    }
    if judged is not None:
        result["outliers"] = {
            "pieces": list(judged.names),
            "position_distances": judged.position_distances.tolist(),
            "rotation_distances": judged.rotation_distances.tolist(),
            "position_limit": judged.position_limit,
            "rotation_limit": judged.rotation_limit,
            "outlying": judged.outlying.tolist(),
        }
    if figure is not None:
        result["figure"] = str(figure)
    return result


def _table(segments: Segments, files: list[Path], first: int, began: float) -> Table:
    before = began if counts_from_afar(began) else 0.0
    # As text: brackets in a file's name are no markup.
    after = ", times after its start" if before else ""
    title = Text(one_line(f"{segments.recording.name}: {_count([segments])}{after}"))
    table = Table(title=title, title_justify="left", title_style="bold")
    placed, unit = segments.recording.unit == "m", segments.recording.unit
    path = f"path ({'mm' if placed else unit})" if unit != "1" else "path"
    for heading in ("", "from (s)", "to (s)", "lasts (s)", path):
        table.add_column(heading, justify="right")
    table.add_column("")
    numbered = enumerate(zip(segments.pieces, files, strict=True), start=first)
    for cut in segments.intervals:
        ends = (cut.start - before, cut.end - before)
        span = tuple(f"{seconds:.2f}" for seconds in (*ends, cut.duration))
        if cut.reason is None:
            count, (piece, file) = next(numbered)
            table.add_row(
                str(count),
                *span,
                f"{piece.path_length * 1e3:.1f}" if placed else f"{piece.path_length:.3g}",
                Text(one_line(file.name)),
            )
        elif cut.reason not in BETWEEN:
            table.add_row("", *span, "", cut.reason, style="dim")
    return table


def _count(found: Sequence[Segments]) -> str:
    count = sum(len(each.pieces) for each in found)
    return f"{count} piece{'s' if count != 1 else ''}"


def _thresholds_text(segments: Segments) -> str:
    if segments.quantity == "times":
        return "cut at the given times"
    if segments.thresholds is None:
        return "no rest stands out of the recording: one piece"
    low, high = segments.thresholds
    speed = segments.quantity == "speed"
    per_second = f" {segments.recording.unit}/s"
    what, unit = ("speed", per_second) if speed else ("contact signal", "")
    return (
        f"thresholds of the {what} {low:.3g} and {high:.3g}{unit}; shorter than "
        f"{segments.minimum_duration:.3g} s is cut out"
    )
