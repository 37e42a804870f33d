"""Which columns of a table hold the pose: ``"x,y,z,qw,qx,qy,qz"``, ``"state[0:3,6,3:6]"``."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from noslip import _pose_files as files
from noslip._typing import Floats
from noslip.errors import RecordingError

POSE = files.POSITION_NAMES + files.QUATERNION_NAMES
_OUTSIDE_BRACKETS = re.compile(r",(?![^\[]*\])")


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
    for part in inside.split(",") if bracket else [":"]:
        inside_column = _inside(part.strip(), column)
        if not inside_column:
            raise RecordingError(
                f"{where}: column {name} has nothing at [{part.strip()}]; it is "
                f"{column.described(name)}, places count from 0"
            )
        for place in inside_column:
            yield name, place


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
    shown = [column.described(name) for name, column in available.items()]
    return ", ".join([*shown[:20], "..."] if len(shown) > 20 else shown) or "none"
