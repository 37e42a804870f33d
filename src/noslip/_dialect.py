"""How a table of text is laid out: what parts its cells, where its header is, what is before it."""

from __future__ import annotations

import csv
import itertools
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

DELIMITERS = "\t;, "
"""Of a copied spreadsheet, of tables where the comma is the decimal sign, of others, and blanks in
any number; of those that fit alike the first counts."""
COMMENTS = ("#", "%")
"""How lines begin that are none of the table; its header may be one of them."""
WINDOW = 200
"""Lines that are looked at: the preamble of trackers has a dozen, and a sign between digits shows
by then."""
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
_UNIT = re.compile(
    r"[\[(]?(s|secs?|seconds|ms|[uµμ]s|ns|m|mm|cm|in|inch|meters?|metres?|deg|degrees|rad|radians|"
    r"°|n|nm|-|1|m/s|rad/s|deg/s|hz|n/a)?[\])]?"
)
"""A cell in a row of units, in lower case."""


@dataclass(frozen=True, kw_only=True)
class Dialect:
    """The layout of a table of text.

    Attributes
    ----------
    delimiter, decimal : str
    header : list of str or None
        Names of the columns as they stand there; None if the table has none.
    line : int
        Of the header, or of the first row where there is none, from 1.
    before : int
        Lines before the first row, blank ones and comments that follow the header apart.
    preamble : list of (list of str)
        Cells of the rows before the header.
    units : list of str
        Of the row of units after it, in lower case; empty if there is none.
    """

    delimiter: str
    decimal: str
    header: list[str] | None
    line: int
    before: int
    preamble: list[list[str]]
    units: list[str]


def split(lines: Iterable[str], delimiter: str) -> Iterable[list[str]]:
    """Yield the cells of lines, which may be quoted."""
    if delimiter == " ":
        lines = (line.replace("\t", " ") for line in lines)
    return csv.reader(lines, delimiter=delimiter, skipinitialspace=True, strict=True)


def is_comment(line: str) -> bool:
    """Whether a line is none of the table."""
    return line.lstrip().startswith(COMMENTS)


def sniff(lines: Iterable[str], *, plain: bool = False) -> Dialect:
    """Return the layout of a table from its first lines, each with its end.

    Of a plain table the first line is the header.
    """
    window = list(itertools.islice(lines, WINDOW))
    said = re.fullmatch(r"sep=(.)\s*", window[0], re.IGNORECASE) if window else None
    skipped = 1 if said else 0
    texts = [
        (number, line)
        for number, line in enumerate(window[skipped:], start=1 + skipped)
        if line.strip()
    ]
    if plain:
        texts = texts[:1]
    rows = [(number, line) for number, line in texts if plain or not is_comment(line)]
    if not rows:
        # A header alone, perhaps behind a sign of comments.
        rows = [(n, line.lstrip().lstrip("#%")) for n, line in texts[-1:]]
    delimiter = said.group(1) if said else _delimiter([line for _, line in rows])
    split_rows = [(number, _cells(line, delimiter)) for number, line in rows]
    data = next((k for k, (_, cells) in enumerate(split_rows) if _numeric(cells, delimiter)), None)
    decimal = "." if data is None else _decimal(split_rows[data:], delimiter)
    if data == 0 and not plain:
        number, cells = split_rows[0]
        header, line = _commented_header(texts, number, cells, delimiter)
        return Dialect(
            delimiter=delimiter,
            decimal=decimal,
            header=header,
            line=line,
            before=number - 1,
            preamble=[],
            units=[],
        )
    at = 0 if not data else _header_row([cells for _, cells in split_rows[: data + 1]])
    line, header = split_rows[at] if split_rows else (0, [])
    line = line if any(cell.strip() for cell in header) else 0
    units = _units(split_rows[at + 1][1]) if data is not None and at + 1 < data else []
    before = split_rows[at + 1][0] if units else line
    return Dialect(
        delimiter=delimiter,
        decimal=decimal,
        header=header,
        line=line,
        before=before,
        preamble=[cells for _, cells in split_rows[:at]],
        units=units,
    )


def _cells(line: str, delimiter: str) -> list[str]:
    try:
        return next(iter(split([line], delimiter)), [])
    except csv.Error:
        return []


def _is_number(cell: str, delimiter: str) -> bool:
    cell = cell.strip()
    if delimiter != "," and _DECIMAL_COMMA.fullmatch(cell):
        return True
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _numeric(cells: Sequence[str], delimiter: str) -> float:
    """Return the share of numbers in a row of the table, 0 of what is none."""
    filled = [cell for cell in cells if cell.strip()]
    numbers = sum(_is_number(cell, delimiter) for cell in filled)
    share = numbers / len(filled) if numbers >= 2 else 0.0
    return share if share >= 0.5 else 0.0


def _delimiter(lines: Sequence[str]) -> str:
    """Return what parts most cells that are numbers; else what the first line has most of."""
    shares = {
        delimiter: max((_numeric(_cells(line, delimiter), delimiter) for line in lines), default=0)
        for delimiter in DELIMITERS
    }
    if any(shares.values()):
        return max(DELIMITERS, key=shares.__getitem__)
    first = lines[0] if lines else ""
    for some in ("\t;,", " "):
        if any(sign in first.strip() for sign in some):
            return max(reversed(some), key=first.count)
    return ","


def _decimal(rows: Sequence[tuple[int, list[str]]], delimiter: str) -> str:
    commas = delimiter != "," and any(
        _DECIMAL_COMMA.fullmatch(cell.strip()) for _, cells in rows for cell in cells
    )
    return "," if commas else "."


def filled(cells: Sequence[str]) -> int:
    """Count the cells up to the last that is not blank."""
    return max((k for k, cell in enumerate(cells, start=1) if cell.strip()), default=0)


def _alike(one: Sequence[str], other: Sequence[str]) -> bool:
    """Whether two rows have as many cells, empty ones at the end apart."""
    return filled(one) <= len(other) and filled(other) <= len(one)


def _header_row(rows: Sequence[list[str]]) -> int:
    """Return which row is the header, of those up to the first of numbers, which is the last."""
    *before, data = rows
    if _alike(before[0], data):
        return 0
    # Behind a preamble of other width it is the last that fits, but for a row of units.
    fitting = [
        k
        for k, cells in enumerate(before)
        if _alike(cells, data) and not any(_is_number(cell, ",") for cell in cells)
    ]
    if len(fitting) > 1 and _units(before[fitting[-1]]):
        fitting.pop()
    return fitting[-1] if fitting else 0


def _units(cells: Sequence[str]) -> list[str]:
    """Return a row of units in lower case; empty if it is none."""
    lower = [cell.strip().lower() for cell in cells]
    named = any(lower) and all(_UNIT.fullmatch(cell) for cell in lower)
    return [cell.strip("[]()") for cell in lower] if named else []


def _commented_header(
    texts: Sequence[tuple[int, str]], first: int, cells: Sequence[str], delimiter: str
) -> tuple[list[str] | None, int]:
    """Return the header that a comment just before the first row is, if it has as many names."""
    comments = [(number, line) for number, line in texts if number < first]
    for number, line in reversed(comments):
        for sign in (delimiter, *DELIMITERS):
            bare = line.lstrip()
            # `%time` is a name of rostopic's.
            bare = bare if bare.startswith("%time") else bare.lstrip("#%")
            names = _cells(bare.strip(), sign)
            if len(names) > 1 and _alike(names, cells):
                return names, number
    return None, first
