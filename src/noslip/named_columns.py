"""Tables of text whose header names the columns: the one reader of them, and their writer."""

from __future__ import annotations

import csv
import io
import re
import reprlib
from array import array
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from noslip._extras import need
from noslip._files import read_utf8
from noslip._typing import Floats
from noslip.errors import MissingDependencyError, RecordingError

DELIMITERS = ",;\t"
"""Of a CSV, of one where the comma is the decimal sign, of a copied spreadsheet; the header's most
frequent one counts, the first where it has none."""
LONG = 1_000_000
"""Characters (7000 rows of poses) that the loops over rows take while pyarrow is being loaded."""
_CELL = 18
"""Characters of a number with full precision, about."""
_LINE = re.compile(rb"[^\r\n]*(?:\r\n?|\n)|[^\r\n]+")
"""With its end, of any kind."""


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
    content : bytes
        The file, as UTF-8; empty where it is not at hand.
    body : int
        Where in it the rows begin.
    delimiter : str
        Between its cells.
    after : int
        Line in which the body begins.
    """

    path: str | Path
    line: int
    names: Sequence[str]
    rows: Iterator[tuple[int, list[str]]]
    content: bytes = b""
    body: int = 0
    delimiter: str = DELIMITERS[0]
    after: int = 0

    @classmethod
    def open(cls, path: str | Path) -> NamedColumns:
        """Read a file up to its header.

        Cells are separated by one of ``DELIMITERS``, and may be quoted.

        Raises
        ------
        InputError
            If it is no UTF-8 text or empty.
        """
        content = read_utf8(path)
        first = next((text for text in _lines(content) if text.strip()), "")
        delimiter = max(DELIMITERS, key=first.count)
        lines = enumerate(_LINE.finditer(content), start=1)
        texts = (match.group().decode() for _, match in lines)
        line, header = next(_rows(path, texts, delimiter), (0, []))
        if not header:
            raise RecordingError(f"{path}: the file is empty")
        names = [" ".join(cell.split()).lower() for cell in header]
        after, rest = next(lines, (0, None))
        body = rest.start() if rest else len(content)
        rows = _rows(path, _lines(content, body), delimiter, after)
        return cls(path, line, names, rows, content, body, delimiter, after)

    @property
    def where(self) -> str:
        """File and line of the header, for messages."""
        return f"{self.path}: line {self.line}"

    def read(
        self, numbers: Sequence[str], texts: Sequence[str] = ()
    ) -> tuple[Sequence[int], dict[str, Floats], dict[str, list[str]]]:
        """Return the line of every row, columns of numbers and columns of text.

        Raises
        ------
        InputError
            If a row is too short or too long, or a cell is no number (see :func:`number`).
        """
        pick = [self.names.index(name) for name in numbers]
        pick_text = [self.names.index(name) for name in texts]
        if not texts and (fast := self._simple_columns(pick)) is not None:
            lines = range(self.after, self.after + len(fast[0]))
            return lines, dict(zip(numbers, fast, strict=True)), {}
        read: list[int] = []
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
            read.append(line)
        table = np.array(values, dtype=np.float64).reshape(len(read), len(numbers))
        columns = zip(*words, strict=True) if words else [()] * len(texts)
        return (
            read,
            dict(zip(numbers, table.T, strict=True)),
            {name: list(column) for name, column in zip(texts, columns, strict=True)},
        )

    def _simple_columns(self, places: Sequence[int]) -> list[Floats] | None:
        """Return columns of a long table of plain rows; None of any other.

        What pyarrow does not take for a finite number is left to the loop, as is all that
        it would split into other cells, or rows into other lines: quotes, and rows that are blank.
        """
        content, begin, end = self.content, self.body, len(self.content)
        if end - begin < LONG or content.find(b'"', begin) >= 0:
            return None
        if not (content.isascii() or content[begin:].isascii()):
            return None
        while end > begin and content[end - 1] in b"\r\n":
            end -= 1
        try:
            arrow, csv = need(self.path, "pyarrow", ""), need(self.path, "pyarrow.csv", "")
        except MissingDependencyError:
            return None
        names = [str(place) for place in range(len(self.names))]
        kinds = {names[place]: arrow.float64() for place in places}
        try:
            table = csv.read_csv(
                arrow.py_buffer(content).slice(begin, end - begin),
                csv.ReadOptions(use_threads=False, column_names=names),
                csv.ParseOptions(
                    delimiter=self.delimiter, quote_char=False, ignore_empty_lines=False
                ),
                csv.ConvertOptions(column_types=kinds, include_columns=list(kinds), null_values=[]),
            )
        except arrow.ArrowInvalid:
            return None
        columns = [table[names[place]].to_numpy() for place in places]
        return columns if all(np.isfinite(values).all() for values in columns) else None

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
    header = separator.join(names)
    if table.size * _CELL >= LONG and (body := _long_text(table, separator)) is not None:
        return f"{header}\n{body}"
    rows = (separator.join(map(repr, row)) for row in table.tolist())
    return "\n".join([header, *rows, ""])


def _long_text(table: Floats, separator: str) -> str | None:
    """Return the rows of a long table as pyarrow writes them, the same text; None without it."""
    try:
        arrow, csv = need("a long table", "pyarrow", ""), need("", "pyarrow.csv", "")
        compute = need("", "pyarrow.compute", "")
    except MissingDependencyError:
        return None
    columns = []
    for values in table.T:
        size = np.abs(values)
        texts = arrow.array(values).cast(arrow.string())
        # Both write the fewest digits that read back as the number, and within these two bands of
        # sizes alike; elsewhere exponents (1e-7, 1e+14) and whole numbers (1) look otherwise.
        alike = (size < 1e-9) & (size > 0) | (size >= 1e-4) & (size < 1e9) & (np.rint(size) != size)
        others = arrow.array(map(repr, values[~alike].tolist()), arrow.string())
        columns.append(compute.replace_with_mask(texts, arrow.array(~alike), others))
    sink = arrow.BufferOutputStream()
    options = csv.WriteOptions(include_header=False, delimiter=separator, quoting_style="none")
    csv.write_csv(arrow.table(columns, [str(k) for k in range(len(columns))]), sink, options)
    return str(sink.getvalue(), "ascii")


def records_text(names: Iterable[str], rows: Iterable[Mapping[str, Any]]) -> str:
    """Return a header and rows of any values as CSV; what is None leaves its cell empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(names)
    for row in rows:
        writer.writerow(str(v).lower() if isinstance(v, bool) else v for v in row.values())
    return text.getvalue()


def _lines(content: bytes, begin: int = 0) -> Iterator[str]:
    """Yield the lines of UTF-8 text, each with its end."""
    return (match.group().decode() for match in _LINE.finditer(content, begin))


def _rows(
    path: str | Path, lines: Iterable[str], delimiter: str, first: int = 1
) -> Iterator[tuple[int, list[str]]]:
    """Yield the line number, from that of the first, and the cells of every row but blank ones."""
    # Strict, because a quote left open would otherwise swallow the rest of the file in silence.
    reader = csv.reader(lines, delimiter=delimiter, skipinitialspace=True, strict=True)
    line = first
    try:
        for cells in reader:
            if cells and (len(cells) > 1 or cells[0].strip()):
                yield line, cells
            line = first + reader.line_num
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
