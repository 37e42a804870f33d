"""Tables of text whose header names the columns: the one reader of them, and their writer."""

from __future__ import annotations

import csv
import io
import itertools
import re
import reprlib
from array import array
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from noslip._dialect import Dialect, filled, is_comment, sniff, split
from noslip._extras import need
from noslip._files import read_utf8
from noslip._typing import Floats
from noslip.errors import MissingDependencyError, RecordingError

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
        Of the header, or of the first row where there is none, from 1.
    names : sequence of str
        Of the columns, in lower case; their numbers from 0 where there is no header.
    rows : iterator of (int, list of str)
        Line and cells of each row that is not blank; they pass once.
    content : bytes
        The file, as UTF-8; empty where it is not at hand.
    body : int
        Where in it the rows begin.
    dialect : Dialect
        What parts its cells, and what stands before the rows.
    after : int
        Line in which the body begins.
    """

    path: str | Path
    line: int
    names: Sequence[str]
    rows: Iterator[tuple[int, list[str]]]
    content: bytes
    body: int
    dialect: Dialect
    after: int

    @classmethod
    def open(cls, path: str | Path, *, plain: bool = False) -> NamedColumns:
        """Read a file up to its first row.

        What parts the cells, which may be quoted, is found from the first lines, as are a header
        behind other lines or a sign of comments, a row of units, and commas as decimal signs.
        Of a plain table the first line is the header, and no line is a comment.

        Raises
        ------
        InputError
            If it is no text in UTF-8 or UTF-16, or empty.
        """
        content = read_utf8(path)
        dialect = sniff(_lines(content), plain=plain)
        if not dialect.line:
            raise RecordingError(f"{path}: the file is empty")
        after, body = dialect.before + 1, 0
        for match in itertools.islice(_LINE.finditer(content), dialect.before):
            body = match.end()
        rows = _rows(path, _lines(content, body), dialect.delimiter, after, plain=plain)
        first = next(rows, (0, []))
        rows = itertools.chain([first] if first[1] else [], rows)
        header = dialect.header
        names = (
            [str(k) for k in range(len(first[1]))]
            if header is None
            else [" ".join(cell.split()).lower() for cell in header]
        )
        return cls(path, dialect.line, names, rows, content, body, dialect, after)

    def peek(self) -> list[str]:
        """Return the cells of the first row, which is read nevertheless."""
        first = next(self.rows, None)
        if first is None:
            return []
        object.__setattr__(self, "rows", itertools.chain([first], self.rows))
        return first[1]

    @property
    def where(self) -> str:
        """File and line of the header, for messages."""
        return f"{self.path}: line {self.line}"

    def read(
        self, numbers: Sequence[str], texts: Sequence[str] = (), *, blank: bool = False
    ) -> tuple[Sequence[int], dict[str, Floats], dict[str, list[str]]]:
        """Return the line of every row, columns of numbers and columns of text.

        A cell that is blank is not a number where ``blank`` is true, else it is refused.

        Raises
        ------
        InputError
            If a row is too short or too long, or a cell is no number (see :func:`number`).
        """
        pick = [self.names.index(name) for name in numbers]
        decimal = self.dialect.decimal
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
                values.extend([number(cells[index], decimal) for index in pick])
            except ValueError:
                values.extend(self._numbers(line, cells, numbers, blank))
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
                    delimiter=self.dialect.delimiter, quote_char=False, ignore_empty_lines=False
                ),
                csv.ConvertOptions(
                    column_types=kinds,
                    include_columns=list(kinds),
                    null_values=[],
                    decimal_point=self.dialect.decimal,
                ),
            )
        except arrow.ArrowInvalid:
            return None
        columns = [table[names[place]].to_numpy() for place in places]
        return columns if all(np.isfinite(values).all() for values in columns) else None

    def _numbers(
        self, line: int, cells: list[str], columns: Sequence[str], blank: bool
    ) -> list[float]:
        """Return the numbers of one row, or say what is wrong with it."""
        # Separators at the end of a row or of the header hold nothing.
        width, found = filled(self.names), len(cells)
        if found < width:
            raise RecordingError(
                f"{self.path}: line {line}, column {self.names[found] or found + 1}: the row ends "
                f"after {found} of {width} cells; complete or remove it"
            )
        if filled(cells) > len(self.names):
            raise RecordingError(
                f"{self.path}: line {line}, column {self.names[-1] or len(self.names)}: the row "
                f"goes on after it, {found} cells under {len(self.names)} names; write numbers "
                "with a decimal point"
            )
        numbers = []
        for name in columns:
            cell = cells[self.names.index(name)].strip()
            try:
                numbers.append(np.nan if blank and not cell else number(cell, self.dialect.decimal))
            except ValueError:
                problem = f"found {shown(cell)}, not a number" if cell else "the cell is empty"
                advice = "write a decimal point" if "," in cell else "fill in or remove the row"
                raise RecordingError(
                    f"{self.path}: line {line}, column {name}: {problem}; {advice}"
                ) from None
        return numbers


def number(cell: str, decimal: str = ".") -> float:
    """Return the number that a cell holds: decimal, with or without exponent, nan or inf.

    Raises
    ------
    ValueError
        If it holds something else.
    """
    if "_" in cell:  # Python reads 1_5 as 15
        raise ValueError(f"found {shown(cell)}, not a number")
    if decimal == ",":
        if "." in cell:  # of thousands, or of another table
            raise ValueError(f"found {shown(cell)}, not a number")
        cell = cell.replace(",", ".")
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
    path: str | Path, lines: Iterable[str], delimiter: str, first: int, *, plain: bool
) -> Iterator[tuple[int, list[str]]]:
    """Yield the line number, from that of the first, and the cells of every row but blank ones."""
    # Strict, because a quote left open would otherwise swallow the rest of the file in silence.
    bare = lines if plain else (_bare(line, delimiter) for line in lines)
    reader = split(bare, delimiter)
    line = first
    try:
        for cells in reader:
            if cells and (len(cells) > 1 or cells[0].strip()):
                yield line, cells
            line = first + reader.line_num  # type: ignore[attr-defined]
    except csv.Error as error:
        raise RecordingError(
            f"{path}: line {line}: cannot be split into cells ({error}); check its quotes"
        ) from error


def _bare(line: str, delimiter: str) -> str:
    """Return a line without its comment; between cells that blanks part, one may end it."""
    if is_comment(line):
        return "\n"
    return line.partition("#")[0] if delimiter == " " else line


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
