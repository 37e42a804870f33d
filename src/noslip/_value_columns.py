"""Columns that are read as they are: joints, grippers, forces; and what a list of columns means."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from noslip._pose_checks import Source
from noslip._pose_names import (
    METERS,
    UNITS,
    Column,
    Name,
    Place,
    described,
    is_clock,
    is_count,
    names_of,
    poses_of,
)
from noslip._samples import Named
from noslip._typing import Floats
from noslip.errors import RecordingError, did_you_mean

_OUTSIDE_BRACKETS = re.compile(r",(?![^\[]*\])")
"""A comma that separates columns, not places in one."""
_IN_BRACKETS = re.compile(r"^(.*?)\s*[\[(]([^\[\]()]*[^\[\]()\d\s][^\[\]()]*)[\])]$")
"""A name and its unit; a number in brackets is a place."""
_SUFFIX = re.compile(r"[^A-Za-z0-9]+[A-Za-z°]+$")
_UNWRITABLE = re.compile(r"[,;\t\"'#]")
"""What cannot stand in a name."""
STATE = "observation.state"
"""Where LeRobot keeps what a robot measures of itself."""
_JOINT = re.compile(r"joint|qpos|shoulder|elbow|wrist|(^|[._])q_?\d+$")
"""What names of joints hold."""
DEGREE = np.pi / 180
"""Radians."""


@dataclass(frozen=True, kw_only=True)
class ValueColumns:
    """Where numbers are that are read as they are, and what they are called.

    Attributes
    ----------
    rotation : list of Place
        Where they are; what all kinds of columns call their last ones.
    names, units : tuple of str
        One a number: meters, radians, or what the table states.
    factors : tuple of float
        To those units.
    """

    rotation: list[Place]
    names: tuple[str, ...]
    units: tuple[str, ...]
    factors: tuple[float, ...]
    group: str = ""
    planar: bool = False

    @property
    def places(self) -> list[Place]:
        """All of them."""
        return self.rotation

    def named(self, of: Mapping[str, Floats]) -> Named:
        """Return the numbers in columns, (N, width), with their names and units."""
        values = stacked(self.rotation, of) * np.array(self.factors)
        return Named(values=values, names=self.names, units=self.units)

    def poses(self, source: Source, of: Mapping[str, Floats]) -> tuple[Floats, Floats]:
        """Return the numbers, (N, n), and no quaternions, (N, 0)."""
        values = self.named(of).values
        return values, np.zeros((len(values), 0))

    def replaced(self, where: str | object, *_: object) -> dict[str, Floats]:
        """Refuse: there is no pose in them."""
        raise RecordingError(
            f"{where}: {', '.join(self.names)} hold no pose that could be replaced; choose columns "
            "that do"
        )

    def understood(self, available: Mapping[str, Column]) -> dict[str, str]:
        """Return what its columns were taken for."""
        lines: dict[str, str] = {}
        for (column, _), name, unit in zip(self.places, self.names, self.units, strict=True):
            told = f"{name} ({unit})"
            lines[column] = f"{lines[column]}, {told}" if column in lines else f"values {told}"
        return lines


def values_of(
    where: str | object,
    available: Mapping[str, Column],
    columns: str | None,
    units: Sequence[str] = (),
    clock: Collection[str] = (),
) -> ValueColumns:
    """Return which columns hold numbers to be read as they are.

    Parameters
    ----------
    where : str or Path
        For messages.
    available : mapping
        All columns.
    columns : str or None
        Names separated by commas; by default LeRobot's state of the robot, or all columns of a
        table but those of time and of text.
    units : sequence of str
        Of lengths and angles that state none: that of lengths is for what is called x, y, z where
        both are given.
    clock : collection of str
        Columns of time.
    """
    of = {name.place: name for name in names_of(available)}
    if columns is not None:
        chosen = list(listed_places(where, columns, available))
    elif STATE in available:
        chosen = list(listed_places(where, STATE, available))
    elif any(column.width > 1 for column in available.values()):
        raise RecordingError(
            f'{where}: which columns? name them with columns="..." (--columns); '
            f"found {described(available)}"
        )
    else:
        chosen = [p for p in of if p[0] not in clock and not available[p[0]].is_text]
    if not chosen:
        raise RecordingError(f"{where}: no columns of numbers, found {described(available)}")
    for name in dict.fromkeys(name for name, _ in chosen):
        if available[name].is_text:
            raise RecordingError(f"{where}: column {name} holds text; choose columns of numbers")
        require_once(where, available, [name])
    if len(set(chosen)) < len(chosen):
        raise RecordingError(f"{where}: columns {columns} name a number twice; name each once")
    told = [_called(place, of.get(place), available[place[0]]) for place in chosen]
    short = [name for name, _ in told]
    if len({name.lower() for name in short}) < len(short):
        short = [f"{p[0]}.{name}" for p, name in zip(chosen, short, strict=True)]
    found = [of[place] for place in chosen if place in of]
    axes = {name.place for pose in poses_of(found).values() for name in pose.position or ()}
    final = [
        _unit(unit, place in axes, units) for place, (_, unit) in zip(chosen, told, strict=True)
    ]
    return ValueColumns(
        rotation=chosen,
        names=tuple(_UNWRITABLE.sub("_", name) for name in short),
        units=tuple(unit for unit, _ in final),
        factors=tuple(factor for _, factor in final),
    )


def _called(place: Place, name: Name | None, column: Column) -> tuple[str, str]:
    """Return the name of a number and its unit as the table states it; empty if it does not."""
    if column.width == 1:
        raw = column.raw or place[0]
    else:
        raw = column.names[place[1]] if column.names else f"{place[0]}[{place[1]}]"
    if match := _IN_BRACKETS.match(raw):
        return match[1], match[2].strip()
    unit = name.unit if name is not None else column.unit
    if unit and not column.unit and unit in {*METERS, "deg", "rad"}:
        # It stands at the end of the name.
        raw = _SUFFIX.sub("", raw) or raw
    return raw, unit


def _unit(stated: str, is_axis: bool, asked: Sequence[str]) -> tuple[str, float]:
    """Return the unit in which a number is kept, and the factor to it."""
    unit = UNITS.get(stated.lower(), stated)
    lengths = [one for one in asked if one in METERS]
    angles = [one for one in asked if one in ("deg", "rad")]
    if not unit:
        fitting = [*lengths, *angles] if is_axis or not angles else [*angles, *lengths]
        unit = fitting[0] if fitting else "m" if is_axis else "1"
    if unit in METERS:
        return "m", 1 / METERS[unit]
    return ("rad", DEGREE) if unit == "deg" else (unit, 1.0)


def position_alone(
    where: str | object, available: Mapping[str, Column], units: Sequence[str]
) -> ValueColumns | None:
    """Return the position of a table that holds nothing else but times; None of any other."""
    rest = _beside_time(available)
    [*poses] = poses_of(rest).values()
    if len(rest) != 3 or len(poses) != 1 or not (found := poses[0].position):
        return None
    columns = ",".join(name.place[0] for name in found)
    return values_of(where, available, columns, units)


def rotation_alone(available: Mapping[str, Column]) -> list[Place] | None:
    """Return the quaternion of a table that holds nothing else but times; None of any other."""
    return _quaternion(_beside_time(available))


def _beside_time(available: Mapping[str, Column]) -> list[Name]:
    names = names_of(available)
    return [name for name in names if not is_clock(name) and not is_count(name)]


def _quaternion(names: Sequence[Name]) -> list[Place] | None:
    """Return the places of w, x, y and z, if these are all that the names say."""
    [*poses] = poses_of(names).values()
    found = poses[0].rotation() if len(poses) == 1 and len(names) == 4 else None
    if found is None or found[0].kind != "quaternion":
        return None
    return [name.place for name in found[1]]


def not_a_pose(
    chosen: Sequence[Place], names: Iterable[Name], counts: Collection[int]
) -> list[Place] | bool:
    """What listed columns are whose rotation nobody describes.

    Parameters
    ----------
    chosen : sequence of Place
        In the order listed.
    names : iterable of Name
        Of all columns.
    counts : collection of int
        Of numbers that are taken for a pose.

    Returns
    -------
    list of Place or bool
        The quaternion of an orientation without a position; True where they are no pose; False
        where they are one, or hold a position and something that may be a rotation.
    """
    said = [name for name in names if name.place in set(chosen)]
    if (turn := _quaternion(said)) is not None and len(chosen) == 4:
        return turn
    joints = len(said) == len(chosen) and all(
        _JOINT.search("_".join(name.tokens)) or _JOINT.search(name.raw.lower()) for name in said
    )
    if joints or len(chosen) not in counts:
        poses = poses_of(said).values()
        half = any(
            pose.position and (set(pose.parts) - {"p", "s"} or pose.angles()) for pose in poses
        )
        return joints or not half
    return False


def of_joints(available: Mapping[str, Column]) -> str:
    """Return what to do with joints, where there are some."""
    names = [part for name, column in available.items() for part in (name, *column.names)]
    if not any(_JOINT.search(name.lower()) for name in names):
        return ""
    return (
        "; it holds joints: from them the pose comes through a robot's model, robot=... (--robot); "
        "load_trajectory reads them as they are"
    )


# ---------------------------------------------------------------------- places


def known_as(available: Mapping[str, Column]) -> dict[str, str]:
    """Return columns by their names, with and without the unit that stands behind one."""
    bare: dict[str, list[str]] = {}
    for key in available:
        if match := _IN_BRACKETS.match(key):
            bare.setdefault(match[1], []).append(key)
    alone = {name: keys[0] for name, keys in bare.items() if len(keys) == 1}
    return alone | {key: key for key in available}


def listed_places(
    where: str | object, columns: str, available: Mapping[str, Column]
) -> Iterator[Place]:
    """Yield the numbers that a list of columns means: ``px,py,observation.state[0:3,6]``."""
    for entry in _OUTSIDE_BRACKETS.split(columns):
        yield from _places(where, entry.strip(), available)


def stacked(places: Sequence[Place], columns: Mapping[str, Floats]) -> Floats:
    """Return numbers from columns, (N, width), side by side."""
    return np.column_stack([columns[name][:, place] for name, place in places])


def require_once(where: str | object, available: Mapping[str, Column], used: Iterable[str]) -> None:
    """Refuse a name that stands for several columns; such tables name those by ``name#2``."""
    for name in used:
        if f"{name}#2" in available:
            count = sum(other.startswith(f"{name}#") for other in available) + 1
            raise RecordingError(f"{where}: column {name} appears {count} times; keep one")


def _places(where: str | object, entry: str, available: Mapping[str, Column]) -> Iterator[Place]:
    entry, known = entry.lower(), known_as(available)
    name, bracket, inside = entry, "", ""
    if entry not in known and entry.endswith("]"):
        name, bracket, inside = entry[:-1].partition("[")
    if name not in known:
        near = did_you_mean(name or entry, available)
        raise RecordingError(
            f"{where}: no column {name or entry}{near}; found {described(available)}"
        )
    name = known[name]
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
    names = [name.lower() for name in column.names]
    if part in names:
        place = names.index(part)
        return range(place, place + 1)
    first, colon, last = part.partition(":")
    try:
        start = int(first or 0)
        stop = int(last or column.width) if colon else start + 1
    except ValueError:
        return range(0)
    return range(start, stop) if 0 <= start < stop <= column.width else range(0)
