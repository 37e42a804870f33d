"""Columns of a table: ``"x,y,z,qw,qx,qy,qz"``, ``"state[0:3,6,3:6]"`` of a pose, and any other."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from noslip._pose_checks import Source
from noslip._pose_csv import POSE, TIME, check_rate
from noslip._typing import Floats
from noslip.errors import RecordingError
from noslip.named_columns import NamedColumns, listed

_OUTSIDE_BRACKETS = re.compile(r",(?![^\[]*\])")
"""A comma that separates columns, not places in one."""


@dataclass(frozen=True)
class Column:
    """A column of a table: how many numbers a row holds there, and their names if it has any."""

    width: int = 1
    names: tuple[str, ...] = ()

    def described(self, name: str) -> str:
        """Return what to call it in a message."""
        if self.width == 1:
            return name
        return f"{name}[{self.width}]" + (f" ({', '.join(self.names)})" if self.names else "")


def pose_columns(
    where: str | object, columns: str | None, available: Mapping[str, Column]
) -> list[tuple[str, int]]:
    """Return where a pose's seven numbers are: the column and the place in it, for each.

    Parameters
    ----------
    where : str or Path
        The file, for messages.
    columns : str or None
        Names separated by commas, in the order x, y, z, qw, qx, qy, qz.  Of a column that holds
        several numbers: all of them, or those in brackets: places from 0, slices or names, as in
        ``state[0:3,6,3:6]``.  None finds the pose by the names x, y, z, qw, qx, qy, qz, of columns
        or of the numbers in one column.
    available : mapping
        The columns there are.

    Raises
    ------
    InputError
        If a name is unknown, or they do not hold seven numbers together.
    """
    if columns is None:
        return _by_name(where, available)
    entries = [entry.strip() for entry in _OUTSIDE_BRACKETS.split(columns)]
    chosen = [place for entry in entries for place in _places(where, entry, available)]
    if len(chosen) != len(POSE):
        raise RecordingError(
            f"{where}: columns {columns} hold {len(chosen)} numbers; a pose has {len(POSE)}: "
            f"{', '.join(POSE)}, in this order"
        )
    return chosen


def stacked(places: list[tuple[str, int]], read: Callable[[str], Floats]) -> Floats:
    """Return the chosen numbers, shape (N, 7); every column is read once, as (N, width)."""
    of = {name: read(name) for name, _ in places}
    return np.column_stack([of[name][:, place] for name, place in places])


def read_column(
    path: str | Path, column: str, *, rate: float | None = None
) -> tuple[Floats, Floats]:
    """Read one more column of a CSV recording, a component of the wrench, say.

    Parameters
    ----------
    path : path
    column : str
        Its name in the header.
    rate : float, optional
        Samples per second of files that number their samples (column ``i``).

    Returns
    -------
    times, values : array, shape (M,)
        Seconds, increasing, and the column in its own unit; a time given twice is taken once.

    Raises
    ------
    InputError
        If the file cannot be read, lacks the column or holds no number in it.
    """
    if Path(path).suffix.lower() != ".csv":
        raise RecordingError(f"{path}: column {column!r} can only be read from a CSV; convert it")
    table = NamedColumns.open(path)
    name = " ".join(column.split()).lower()
    time = next((each for each in (*TIME, "i") if each in table.names), TIME[0])
    for wanted in (time, name):
        if wanted not in table.names:
            raise RecordingError(
                f"{path}: no column {wanted!r}, found {', '.join(table.names)}; name one of them"
            )
    if time == "i":
        check_rate(table.where, rate)
    lines, of, _ = table.read((time, name))
    if not lines:
        raise RecordingError(f"{path}: column {name}: it has no samples; record something first")
    source = Source(path, time, "", lines)
    source.check_finite({f"column {each}": values for each, values in of.items()})
    stamps, first = np.unique(of[time], return_index=True)
    return stamps / rate if rate is not None and time == "i" else stamps, of[name][first]


def _by_name(where: str | object, available: Mapping[str, Column]) -> list[tuple[str, int]]:
    if all(name in available for name in POSE):
        return [(name, 0) for name in POSE]
    named = [name for name, column in available.items() if set(POSE) <= set(column.names)]
    if len(named) == 1:
        return [(named[0], available[named[0]].names.index(name)) for name in POSE]
    problem = f"{' and '.join(named)} both hold" if named else "none is called"
    raise RecordingError(
        f"{where}: which columns are the pose? {problem} {', '.join(POSE)}; say it with "
        f'columns="..." (--columns), such as state[0:3,6,3:6]; found {_described(available)}'
    )


def _places(
    where: str | object, entry: str, available: Mapping[str, Column]
) -> Iterator[tuple[str, int]]:
    name, bracket, inside = entry, "", ""
    if entry not in available and entry.endswith("]"):
        name, bracket, inside = entry[:-1].partition("[")
    if name not in available:
        raise RecordingError(f"{where}: no column {name or entry}; found {_described(available)}")
    column = available[name]
    for part in map(str.strip, inside.split(",") if bracket else [":"]):
        places = _inside(part, column)
        if not places:
            raise RecordingError(
                f"{where}: column {name} has nothing at [{part}]; it is "
                f"{column.described(name)}, places count from 0"
            )
        yield from ((name, place) for place in places)


def _inside(part: str, column: Column) -> range:
    """Return the places that a name, a number or a slice means."""
    if part in column.names:
        place = column.names.index(part)
        return range(place, place + 1)
    first, colon, last = part.partition(":")
    try:
        start = int(first or 0)
        stop = int(last or column.width) if colon else start + 1
    except ValueError:
        return range(0)
    return range(start, stop) if 0 <= start < stop <= column.width else range(0)


def _described(available: Mapping[str, Column]) -> str:
    return listed([column.described(name) for name, column in available.items()], str)
