"""Poses in tables of text: CSV and its relatives, TUM, and what trackers and robots export."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from noslip._dialect import Dialect
from noslip._exporters import recognized
from noslip._pose_checks import Source
from noslip._pose_columns import Asked, Known, clock_of, layout_of
from noslip._pose_names import UNITS, Column
from noslip._samples import Samples
from noslip._typing import Floats
from noslip.errors import RecordingError, did_you_mean
from noslip.named_columns import NamedColumns, number


def read_text_table(path: str | Path, asked: Asked) -> Samples:
    """Return the poses in a table of text.

    Raises
    ------
    InputError
        If it is no table, or its columns tell no pose; see :func:`noslip.load_demonstrations`.
    """
    table, available, known = opened(path)
    layout = layout_of(table.where, available, asked, known)
    lines, of, texts = table.read(layout.numbers, layout.texts, blank=True)
    return layout.samples(path, available, of, texts, lines)


def opened(path: str | Path) -> tuple[NamedColumns, dict[str, Column], Known]:
    """Return a table of text up to its first row, its columns, and what is known of it.

    Raises
    ------
    InputError
        If it has no row.
    """
    table = NamedColumns.open(path)
    first = table.peek()
    if not first:
        raise RecordingError(f"{table.where}: a header and no samples; record something first")
    suffix = Path(path).suffix.lower()
    names, known = recognized(table.names, table.dialect, first, suffix)
    table = replace(table, names=_unique(names))
    header = table.dialect.header or ()
    # Only where names are those of the header is a header's cell what a column is called.
    raw = {cell.lower(): cell for cell in (" ".join(cell.split()) for cell in header)}
    columns = _columns(table.names, table.dialect, first)
    return table, {k: replace(c, raw=raw.get(k, "")) for k, c in columns.items()}, known


def read_text_column(path: str | Path, column: str, asked: Asked) -> tuple[Source, Floats, Floats]:
    """Return one more column of a table of text, with its times (s), unchecked but for numbers."""
    table, available, known = opened(path)
    name = " ".join(column.split()).lower()
    if name not in available:
        raise RecordingError(
            f"{path}: no column {name!r}{did_you_mean(name, available)}, found "
            f"{', '.join(available)}; name one of them"
        )
    clock = clock_of(path, available, asked, known)
    texts = clock.columns if clock.unit == "date" else ()
    numbers = tuple(dict.fromkeys([*(() if texts else clock.columns), name]))
    lines, of, words = table.read(numbers, texts)
    source = Source(path, ", ".join(clock.columns), "", lines)
    source.check_finite({f"column {each}": values for each, values in of.items()})
    columns = {each: values[:, None] for each, values in of.items()}
    return source, clock.seconds(source, columns, words), of[name]


def _unique(names: Sequence[str]) -> list[str]:
    """Return names of which those that repeat are numbered: x, x#2."""
    seen: dict[str, int] = {}
    unique = []
    for name in names:
        seen[name] = seen.get(name, 0) + 1
        unique.append(name if seen[name] == 1 else f"{name}#{seen[name]}")
    return unique


def _columns(names: Sequence[str], dialect: Dialect, first: Sequence[str]) -> dict[str, Column]:
    units = [*dialect.units, *[""] * len(names)]
    cells = [*first, *[""] * len(names)]
    return {
        name: Column(unit=UNITS.get(unit, ""), is_text=_is_text(cell, dialect.decimal))
        for name, unit, cell in zip(names, units, cells, strict=False)
        if name
    }


def _is_text(cell: str, decimal: str) -> bool:
    try:
        number(cell, decimal)
    except ValueError:
        return bool(cell.strip())
    return False
