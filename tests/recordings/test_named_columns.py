"""Columns by name: one reader, whatever the table is for."""

from __future__ import annotations

import math
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from noslip import named_columns
from noslip.errors import InputError
from noslip.named_columns import NamedColumns, number, numbers_text
from noslip.recordings import load_demonstrations, read_column
from noslip.recordings.formats import FORMATS
from noslip.result_table import RecordingResult, read_results, write_results


def test_a_column_is_read_with_its_times(tmp_path):
    file = tmp_path / "a.csv"
    file.write_text("t;x;fz\n1.0;0;5\n1.5;0;6.5\n1.5;0;6.5\n2.0;0;7\n")
    times, values = read_column(file, "Fz")
    np.testing.assert_array_equal(times, [1.0, 1.5, 2.0])
    np.testing.assert_array_equal(values, [5.0, 6.5, 7.0])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t,x\n1,2\n", "no column 'fz', found t, x"),
        ("x,fz\n1,2\n", "column t missing"),
        ("t,fz\n1,2\n2,high\n", "line 3, column fz: found 'high', not a number"),
        ("t,fz\n1,nan\n", "line 2, column fz: found nan"),
        ("t,fz\n", "no samples"),
        ("i,fz\n0,1\n", "pass rate="),
    ],
)
def test_a_column_that_cannot_be_read_is_told(tmp_path, text, message):
    file = tmp_path / "a.csv"
    file.write_text(text)
    with pytest.raises(InputError, match=message):
        read_column(file, "fz")


# Rows of a recording, of a column, of goals and of results; `1_5` is 15 to Python.
def test_a_number_is_read_in_one_way_everywhere(tmp_path):
    file = tmp_path / "a.csv"
    rows = "".join(f"{k},{k},0,0,1,0,0,0,{k}\n" for k in range(9))
    file.write_text("t,x,y,z,qw,qx,qy,qz,fz\n" + rows + "9,1_5,0,0,1,0,0,0,1_5\n")
    readers = {
        "x": [load_demonstrations, lambda path: NamedColumns.open(path).read(("x",))],
        "fz": [lambda path: read_column(path, "fz")],
    }
    for column, every in readers.items():
        for read in every:
            with pytest.raises(InputError) as caught:
                read(file)
            assert str(caught.value).startswith(
                f"{file}: line 11, column {column}: found '1_5', not a number"
            )
    table = write_results(
        [RecordingResult(name="a", status="failed", recording="a", samples=7, seconds=0.5)],
        tmp_path / "results.csv",
    )
    for good, column in ((",7,", "samples"), (",0.5,", "seconds")):
        wrong = tmp_path / "wrong.csv"
        wrong.write_text(table.read_text().replace(good, ",1_5,"))
        with pytest.raises(InputError, match=f"row 2, column {column}: found '1_5'"):
            read_results(wrong)


@pytest.mark.parametrize(
    ("cell", "value"),
    [("1e3", 1e3), (" -.5 ", -0.5), ("+2", 2.0), ("nan", np.nan), ("-inf", -np.inf)],
)
def test_what_a_number_is(cell, value):
    np.testing.assert_equal(number(cell), value)


@pytest.mark.parametrize("cell", ["1_5", "1,5", "1 000", "1'000", "0x10", "1m", ""])
def test_what_a_number_is_not(cell):
    with pytest.raises(ValueError, match=r"."):
        number(cell)


def test_the_page_on_recordings_lists_every_format():
    """Suffixes, extra, and whether a format is written, by the table people read."""
    page = Path(__file__).parents[2] / "docs" / "recordings.md"
    lines = [line for line in page.read_text().splitlines() if line.startswith("| ")]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    paths = [row for row in rows if len(row) == 5]
    for each in FORMATS:
        for suffix in (*each.suffixes, *each.named_only):
            row = next(row for row in paths if f"`{suffix}`" in row[0])
            assert row[4].strip("`") == each.extra
            # A row may hold suffixes that are read only; then it says which are written.
            written = row[3].startswith("yes") and ("(" not in row[3] or suffix in row[3])
            assert written == (suffix in each.written)


PLAIN = st.floats(allow_nan=False, allow_infinity=False)
"""The repr of any of them is a cell that both ways read."""
CELLS = st.one_of(
    PLAIN.map(repr),
    st.floats().map("{:+.3g}".format),
    st.integers().map(str),
    st.decimals(allow_nan=False, allow_infinity=False, places=30).map(str),
    st.sampled_from(
        ["", " ", " 1", "1 ", "\t1", "1\xa0", "\u0661", "1_5", "1,5", "1 5", "1-5", ".5"]
    ),
    st.sampled_from(["5.", ".", "-", "- 1", "e5", "1e", "1E+5", "1e999", "1e-999", "0x10", "1d5"]),
    st.sampled_from(["1.2.3", "1e5e5", "1f", "nan", "nan(1)", "-NAN", "inf", "Infinity", "-0"]),
    st.sampled_from(['"1"', '"1', '"a\n1"', "word", "007", "true"]),
)
"""Whatever may stand in a file."""


@st.composite
def tables(draw: st.DrawFn) -> str:
    """Texts of tables, plain ones and others, in all dialects and with all faults."""
    delimiter = draw(st.sampled_from([",", ";", "\t", ", "]))
    ends = st.sampled_from(["\n", "\r\n", "\r"]) if draw(st.booleans()) else st.just("\n")
    names = draw(st.lists(st.sampled_from(["a", "b", "word", '"c"', ""]), max_size=2))
    names.insert(draw(st.integers(0, len(names))), "x")
    plain = draw(st.booleans())
    widths = st.just(len(names)) if plain else st.integers(max(len(names) - 1, 0), len(names) + 1)
    cells = PLAIN.map(repr) if plain else CELLS
    rows = widths.flatmap(lambda width: st.lists(cells, min_size=width, max_size=width))
    lines = [names, *draw(st.lists(rows, max_size=5))]
    text = "".join(delimiter.join(line) + draw(ends) for line in lines)
    before, after = (draw(st.sampled_from(["", "", "\n", " \r\n"])) for _ in range(2))
    return before + text.removesuffix(draw(st.sampled_from(["", "\n"]))) + after


def outcome(path: Path, long: float) -> object:
    """What is read, to the bit, or what is said."""
    with patch.object(named_columns, "LONG", long):
        try:
            table = NamedColumns.open(path)
            lines, of, _ = table.read([name for name in table.names if name in "abcx" and name])
        except InputError as error:
            return str(error)
    return list(lines), {name: values.tobytes() for name, values in of.items()}


@given(text=tables())
def test_a_long_table_is_read_as_a_short_one(tmp_path_factory, text):
    pytest.importorskip("pyarrow", reason="needs the extra tables")
    path = tmp_path_factory.getbasetemp() / "table.csv"
    path.write_text(text, newline="", encoding="utf-8")
    assert outcome(path, long=0) == outcome(path, long=math.inf)


# Whole numbers, exponents of one digit and sizes at which a notation changes are drawn on purpose.
NOTATIONS = st.one_of(
    st.floats(),
    st.builds(lambda digits, power: digits * 10.0**power, st.floats(-10, 10), st.integers(-12, 20)),
    st.builds(round, st.floats(-1e17, 1e17), st.integers(-2, 20)).map(float),
    st.sampled_from([0.0, -0.0, 1e-9, 1e-5, 1e-4, 1e9, 1e15, 1e16, 5e-324]),
)


@given(rows=st.lists(st.tuples(NOTATIONS, NOTATIONS), min_size=1, max_size=20))
def test_a_long_table_is_written_as_a_short_one(rows):
    pytest.importorskip("pyarrow", reason="needs the extra tables")
    table = np.array(rows)
    for separator in ", ":
        with patch.object(named_columns, "LONG", 0):
            long = numbers_text("ab", table, separator)
        lines = [f"a{separator}b", *(separator.join(map(repr, row)) for row in table.tolist())]
        assert long == "\n".join([*lines, ""])


@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize("delimiter", [",", "; ", "\t"])
def test_the_loop_over_rows_is_left_to_what_is_not_plain(tmp_path, delimiter, end):
    pytest.importorskip("pyarrow", reason="needs the extra tables")
    path = tmp_path / "table.csv"
    values = np.random.default_rng(0).normal(size=(20_000, 3)) * 10.0 ** np.arange(-150, 151, 150)
    rows = [
        ["t", "x", "word", "y"],
        *(f"{t!r} {x!r} up {y!r}".split() for t, x, y in values.tolist()),
    ]
    path.write_text("".join(delimiter.join(row) + end for row in rows), newline="")
    table = NamedColumns.open(path)
    lines, of, _ = table.read(("y", "t", "x"))
    np.testing.assert_array_equal(np.column_stack([of["t"], of["x"], of["y"]]), values)
    assert list(lines) == list(range(2, 20_002))
    assert next(table.rows)[0] == 2, "rows were passed"
