"""Tables of text whose header names the columns: the one reader of them, and their writer."""

from __future__ import annotations

import csv
import io
import reprlib
from array import array
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from noslip._files import read_text
from noslip._typing import Floats
from noslip.errors import RecordingError

DELIMITERS = ",;\t"
"""Of a CSV, of one where the comma is the decimal sign, of a copied spreadsheet; the header's most
frequent one counts, the first where it has none."""


@dataclass(frozen=True)
class NamedColumns:
    """A table of text on its way in.

    Attributes
    ----------
    path : path
    line : int
        Of the header, from 1.
    names : sequence of str
        Of the columns, in lower case.
    rows : iterator of (int, list of str)
        Line and cells of each row that is not blank; they pass once.
    """

    path: str | Path
    line: int
    names: Sequence[str]
    rows: Iterator[tuple[int, list[str]]]

    @classmethod
    def open(cls, path: str | Path) -> NamedColumns:
        """Read a file up to its header.

        Cells are separated by one of ``DELIMITERS``, and may be quoted.

        Raises
        ------
        InputError
            If it is no UTF-8 text or empty.
        """
        text = read_text(path)
        first = next((line for line in io.StringIO(text) if line.strip()), "")
        rows = _rows(path, text, delimiter=max(DELIMITERS, key=first.count))
        line, header = next(rows, (0, []))
        if not header:
            raise RecordingError(f"{path}: the file is empty")
        return cls(path, line, [" ".join(cell.split()).lower() for cell in header], rows)

    @property
    def where(self) -> str:
        """File and line of the header, for messages."""
        return f"{self.path}: line {self.line}"

    def read(
        self, numbers: Sequence[str], texts: Sequence[str] = ()
    ) -> tuple[list[int], dict[str, Floats], dict[str, list[str]]]:
        """Return the line of every row, columns of numbers and columns of text.

        Raises
        ------
        InputError
            If a row is too short or too long, or a cell is no number (see :func:`number`).
        """
        pick = [self.names.index(name) for name in numbers]
        pick_text = [self.names.index(name) for name in texts]
        lines: list[int] = []
        values = array("d")
        words: list[list[str]] = []
        for line, cells in self.rows:
            try:
                if len(cells) != len(self.names):
                    raise ValueError("perhaps only a separator at the end")
                values.extend([number(cells[index]) for index in pick])
            except ValueError:
                values.extend(self._numbers(line, cells, numbers))
            if pick_text:
                words.append([cells[index] for index in pick_text])
            lines.append(line)
        table = np.array(values, dtype=np.float64).reshape(len(lines), len(numbers))
        columns = zip(*words, strict=True) if words else [()] * len(texts)
        return (
            lines,
            dict(zip(numbers, table.T, strict=True)),
            {name: list(column) for name, column in zip(texts, columns, strict=True)},
        )

    def _numbers(self, line: int, cells: list[str], columns: Sequence[str]) -> list[float]:
        """Return the numbers of one row, or say what is wrong with it."""
        # Separators at the end of a row or of the header hold nothing.
        width, found = _filled(self.names), len(cells)
        if found < width:
            raise RecordingError(
                f"{self.path}: line {line}, column {self.names[found] or found + 1}: the row ends "
                f"after {found} of {width} cells; complete or remove it"
            )
        if _filled(cells) > len(self.names):
            raise RecordingError(
                f"{self.path}: line {line}, column {self.names[-1] or len(self.names)}: the row "
                f"goes on after it, {found} cells under {len(self.names)} names; write numbers "
                "with a decimal point"
            )
        numbers = []
        for name in columns:
            cell = cells[self.names.index(name)].strip()
            try:
                numbers.append(number(cell))
            except ValueError:
                problem = f"found {shown(cell)}, not a number" if cell else "the cell is empty"
                advice = "write a decimal point" if "," in cell else "fill in or remove the row"
                raise RecordingError(
                    f"{self.path}: line {line}, column {name}: {problem}; {advice}"
                ) from None
        return numbers


def number(cell: str) -> float:
    """Return the number that a cell holds: decimal, with or without exponent, nan or inf.

    Raises
    ------
    ValueError
        If it holds something else.
    """
    if "_" in cell:  # Python reads 1_5 as 15
        raise ValueError(f"found {shown(cell)}, not a number")
    return float(cell)


def numbers_text(names: Iterable[str], table: Floats, separator: str = ",") -> str:
    """Return a header and rows of numbers as text; a float read back is the float written."""
    rows = (separator.join(map(repr, row)) for row in table.tolist())
    return "\n".join([separator.join(names), *rows, ""])


def records_text(names: Iterable[str], rows: Iterable[Mapping[str, Any]]) -> str:
    """Return a header and rows of any values as CSV; what is None leaves its cell empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(names)
    for row in rows:
        writer.writerow(str(v).lower() if isinstance(v, bool) else v for v in row.values())
    return text.getvalue()


def _rows(path: str | Path, text: str, delimiter: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the line number and the cells of every row that is not blank."""
    # Strict, because a quote left open would otherwise swallow the rest of the file in silence.
    reader = csv.reader(
        io.StringIO(text, newline=""), delimiter=delimiter, skipinitialspace=True, strict=True
    )
    line = 1
    try:
        for cells in reader:
            if cells and (len(cells) > 1 or cells[0].strip()):
                yield line, cells
            line = reader.line_num + 1
    except csv.Error as error:
        raise RecordingError(
            f"{path}: line {line}: cannot be split into cells ({error}); check its quotes"
        ) from error


def _filled(cells: Sequence[str]) -> int:
    """Count the cells up to the last that is not blank."""
    return max((k for k, cell in enumerate(cells, start=1) if cell.strip()), default=0)


def plural(noun: str, names: list[str]) -> str:
    """Return a noun and names: column x, columns x, y."""
    return f"{noun}{'s' if len(names) > 1 else ''} {', '.join(names)}"


def listed(names: Iterable[str], quote: Callable[[str], str] | None = None) -> str:
    """List what a file holds, quoted unless told otherwise, but not all of hundreds."""
    every = [(quote or shown)(name) for name in names if name]
    return ", ".join([*every[:20], "..."] if len(every) > 20 else every) or "none"


def shown(text: str) -> str:
    """Quote what a file holds, on one line and not too long."""
    return reprlib.repr(text)
