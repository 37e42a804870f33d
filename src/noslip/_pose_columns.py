"""Poses as named columns: which of them hold it, in which units, and how its rotation is written.

One mapping for every table, of text or not: what the names say, and what the user says instead.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from noslip._arguments import number
from noslip._pose_checks import Source
from noslip._pose_names import (
    METERS,
    POSE,
    POSITION,
    QUATERNION,
    SECONDS,
    UNITS,
    Column,
    Name,
    Place,
    Pose,
    degrees_of,
    described,
    is_clock,
    is_count,
    names_of,
    poses_of,
)
from noslip._samples import Samples
from noslip._turns import KINDS, Turn, parse_turn
from noslip._typing import Floats
from noslip._value_columns import (
    DEGREE,
    ValueColumns,
    known_as,
    listed_places,
    not_a_pose,
    of_joints,
    position_alone,
    require_once,
    rotation_alone,
    stacked,
    values_of,
)
from noslip.errors import RecordingError, RecordingWarning, did_you_mean, warn
from noslip.named_columns import listed, plural, shown


class Kinematics(Protocol):
    """What is asked of a robot whose joints were recorded."""

    name: str
    joint_names: tuple[str, ...]

    @property
    def size(self) -> int:
        """Its joints."""

    def forward(self, joint_positions: ArrayLike) -> tuple[Floats, Rotation]:
        """Return the tool's position (m) and rotation at joint positions, shape (N, size)."""


@dataclass(frozen=True, kw_only=True)
class Asked:
    """What the user says of a table; see :func:`noslip.load_demonstrations`."""

    values: bool = False
    channels: str | None = None
    columns: str | None = None
    time: str | None = None
    units: str | Iterable[str] | None = None
    rotation: str | None = None
    rate: float | None = None
    robot: Kinematics | None = None

    def unit(self, known: Mapping[str, float]) -> str | None:
        """Return the unit that the user states, of those known."""
        return next((unit for unit in self.stated_units() if unit in known), None)

    def stated_units(self) -> list[str]:
        """Return the units that the user states, as ``UNITS`` has them."""
        given = self.units
        if given is None:
            return []
        if isinstance(given, Mapping):
            given = given.values()
        words = given.split(",") if isinstance(given, str) else given
        units = [UNITS.get(str(word).strip().lower(), "") for word in words]
        if "" in units:
            raise RecordingError(
                f"units {self.units!r} are not known; times are in {', '.join(SECONDS)}, lengths "
                f"in {', '.join(METERS)}, angles in deg or rad"
            )
        return units

    def angle_units(self) -> list[str]:
        """Of these, those of angles."""
        return [unit for unit in self.stated_units() if unit in ("deg", "rad")]


@dataclass(frozen=True, kw_only=True)
class Known:
    """What is known of a table beyond its names, since its exporter is.

    Attributes
    ----------
    exporter : str
        What it is called.
    position, turn, numbers : str or Turn
        How the pose is written, where the names do not say: columns of the position, how the
        rotation is written, columns that it takes.
    euler : Turn or None
        What three angles are that the names tell.
    time, length : str
        Units.
    rate : float
        Samples per second, where it numbers them.
    note : str
        What a user should know.
    """

    exporter: str = ""
    position: tuple[str, ...] = ()
    turn: Turn | None = None
    numbers: tuple[str, ...] = ()
    euler: Turn | None = None
    time: str = ""
    length: str = ""
    rate: float | None = None
    note: str = ""


NOTHING = Known()
"""Is known of most tables."""
BY_COUNT = {7: Turn("quaternion", "wxyz"), 12: Turn("matrix"), 16: Turn("matrix")}
"""How the rotation is written of a pose of so many numbers, where nobody says it."""


@dataclass(frozen=True, kw_only=True)
class Clock:
    """Which columns hold the time.

    Attributes
    ----------
    columns : tuple of str
        A column, or one of seconds and one of nanoseconds; empty where the rate alone tells.
    unit : str
        One of ``SECONDS``, or ``date`` for text, or ``count``.
    said : bool
        Whether anything says so.
    rate : float or None
        Samples per second, where it is needed.
    """

    columns: tuple[str, ...] = ()
    unit: str = "count"
    said: bool = True
    rate: float | None = None

    def seconds(
        self, source: Source, of: Mapping[str, Floats], texts: Mapping[str, Sequence[str]]
    ) -> Floats:
        """Return the times (s), shape (N,), from columns of numbers, (N, width), or of text."""
        if self.unit == "date":
            return dates(source, self.columns[0], texts[self.columns[0]])
        if not self.columns:
            assert self.rate is not None
            return np.arange(len(next(iter(of.values())))) / self.rate
        first = of[self.columns[0]][:, 0]
        if self.rate is not None:
            return np.asarray(first / self.rate)
        if len(self.columns) == 2:
            return np.asarray(first + of[self.columns[1]][:, 0] / SECONDS["ns"])
        return first if self.unit == "s" else np.asarray(first / SECONDS[self.unit])

    def understood(self) -> dict[str, str]:
        """Return what its columns were taken for."""
        if not self.columns:
            return {"(no column)": f"time, from {self.rate} Hz"}
        told = {"count": f"number of the sample, {self.rate} Hz", "date": "date"}
        if len(self.columns) == 2:
            return dict(zip(self.columns, ("time, s", "time, ns"), strict=True))
        return {self.columns[0]: f"time, {told.get(self.unit, self.unit)}"}


# ---------------------------------------------------------------------- which columns it is


def layout_of(
    where: str | object, available: Mapping[str, Column], asked: Asked, known: Known = NOTHING
) -> Layout:
    """Return which columns of a table hold the time and the pose.

    Parameters
    ----------
    where : str or Path
        For messages.
    available : mapping
        The columns, by name in lower case.
    asked : Asked
        What the user says goes before what the names say.
    known : Known
        And that before what their exporter is known for.

    Raises
    ------
    InputError
        If a column is missing or there twice, or could be several, or the rate is needed and not
        there; the message names the option that tells.
    """
    timed = asked.time is None and asked.rate is None
    content = content_of(where, available, asked, known, timed=timed)
    return Layout(
        clock=clock_of(where, available, asked, known, content.pose.group),
        content=content,
        exporter=known.exporter,
        note=known.note,
    )


@dataclass(frozen=True, kw_only=True)
class PoseColumns:
    """Where a pose is: the columns of its position and rotation, and how they are written."""

    position: list[Place]
    rotation: list[Place]
    turn: Turn
    length_unit: str
    group: str = ""

    @property
    def places(self) -> list[Place]:
        """All of them."""
        return self.position + self.rotation

    @property
    def planar(self) -> bool:
        """Whether it is a pose in the plane."""
        return self.turn.kind == "planar"

    def poses(self, source: Source, of: Mapping[str, Floats]) -> tuple[Floats, Floats]:
        """Return positions (m), (N, 3), and quaternions, (N, 4), from columns, (N, width)."""
        turn, numbers = self.turn, stacked(self.rotation, of)
        if len(self.rotation) >= 12:
            turn, numbers, positions = _of_matrix(str(source.path), turn, numbers)
        else:
            # An orientation without a position turns about the origin.
            origin = np.zeros((len(numbers), 3))
            positions = stacked(self.position, of) if self.position else origin
        if turn.kind == "planar":
            positions = np.column_stack([positions, np.zeros(len(positions))])
            _check_planar_turns(source, self.rotation[0][0], turn, numbers[:, 0])
        if self.length_unit != "m":
            positions = positions / METERS[self.length_unit]
        return positions, turn.quaternions(str(source.path), numbers)

    def replaced(
        self, where: str | object, of: Mapping[str, Floats], positions: Floats, quaternions: Floats
    ) -> dict[str, Floats]:
        """Return the columns, (N, width), with other poses in them; what is beside these stays."""
        if len(self.rotation) >= 12:
            raise RecordingError(
                f"{where}: poses in matrices of {len(self.rotation)} numbers are read, but not "
                "replaced; choose columns of positions and rotations (--columns)"
            )
        columns = {name: of[name].copy() for name, _ in self.places}
        if not self.position:
            positions = positions[:, :0]
        lengths = positions[:, : len(self.position)] * METERS[self.length_unit]
        numbers = self.turn.numbers(quaternions, stacked(self.rotation, of))
        for (name, place), values in zip(self.places, np.hstack([lengths, numbers]).T, strict=True):
            columns[name][:, place] = values
        return columns

    def understood(self, available: Mapping[str, Column]) -> dict[str, str]:
        """Return what its columns were taken for."""
        lines: dict[str, str] = {}
        whole = f"; position, {self.length_unit}" if len(self.rotation) >= 12 else ""
        alone = "" if self.position else "; no position: at the origin"
        for part, places in (
            (f"position, {self.length_unit}", self.position),
            (f"{self.turn}{whole or alone}", self.rotation),
        ):
            for name in dict.fromkeys(name for name, _ in places):
                inside = [place for key, place in places if key == name]
                entire = inside == list(range(available[name].width))
                told = part if entire else f"{part} [{','.join(map(str, inside))}]"
                lines[name] = f"{lines[name]}; {told}" if name in lines else told
        return lines


@dataclass(frozen=True, kw_only=True)
class JointColumns:
    """Where the positions of a robot's joints are, from which its tool's pose comes."""

    values: ValueColumns
    robot: Kinematics
    group: str = ""
    planar: bool = False

    @property
    def rotation(self) -> list[Place]:
        """Where they are."""
        return self.values.rotation

    @property
    def places(self) -> list[Place]:
        """All of them."""
        return self.values.places

    def poses(self, source: Source, of: Mapping[str, Floats]) -> tuple[Floats, Floats]:
        """Return positions (m), (N, 3), and quaternions, (N, 4), from columns, (N, width)."""
        joints = self.values.named(of).values
        whole = np.isfinite(joints).all(axis=1)
        positions, quaternions = (np.full((len(joints), count), np.nan) for count in (3, 4))
        if whole.any():
            places, turns = self.robot.forward(joints[whole])
            positions[whole], quaternions[whole] = places, turns.as_quat(scalar_first=True)
        return positions, quaternions

    def replaced(self, where: str | object, *_: object) -> dict[str, Floats]:
        """Refuse: a pose does not say what the joints are."""
        raise RecordingError(
            f"{where}: poses that come from joints are not replaced; leave --robot out, and choose "
            "columns that hold a pose"
        )

    def understood(self, available: Mapping[str, Column]) -> dict[str, str]:
        """Return what its columns were taken for."""
        both = zip(self.rotation, self.values.factors, strict=True)
        return {
            column: f"joints of {self.robot.name}, {'deg' if factor == DEGREE else 'rad'}"
            for (column, _), factor in both
        }


Columns = PoseColumns | JointColumns | ValueColumns
"""Where a recording's motion is."""


@dataclass(frozen=True, kw_only=True)
class Content:
    """Where a recording's motion is, and the channels that go with it."""

    pose: Columns
    channels: ValueColumns | None = None

    @property
    def places(self) -> list[Place]:
        """All of them."""
        return self.pose.places + ([] if self.channels is None else self.channels.places)

    def samples(self, source: Source, of: Mapping[str, Floats]) -> dict[str, Any]:
        """Return those fields of :class:`Samples` that columns, (N, width), hold."""
        positions, quaternions = self.pose.poses(source, of)
        found = {
            "positions": positions,
            "quaternions": quaternions,
            "planar": self.pose.planar,
            "channels": None if self.channels is None else self.channels.named(of),
        }
        if isinstance(self.pose, ValueColumns):
            found |= {"names": self.pose.names, "units": self.pose.units}
        return found

    def understood(self, available: Mapping[str, Column]) -> dict[str, str]:
        """Return what its columns were taken for."""
        found = self.pose.understood(available)
        if self.channels is not None:
            for name, told in self.channels.understood(available).items():
                told = told.replace("values", "channels", 1)
                found[name] = f"{found[name]}; {told}" if name in found else told
        return found


def content_of(
    where: str | object,
    available: Mapping[str, Column],
    asked: Asked,
    known: Known = NOTHING,
    *,
    timed: bool = False,
) -> Content:
    """Return which columns hold the motion and its channels; see :func:`layout_of`."""
    pose = pose_of(where, available, asked, known, timed=timed)
    if asked.channels is None:
        return Content(pose=pose)
    if isinstance(pose, ValueColumns):
        raise RecordingError(
            f"{where}: {', '.join(pose.names)} are no pose, which channels go with; name all of "
            "them with columns"
        )
    channels = values_of(where, available, asked.channels)
    return Content(pose=pose, channels=channels)


def _joints(
    where: str | object, available: Mapping[str, Column], asked: Asked, robot: Kinematics
) -> JointColumns:
    """Return where a robot's joints are: as listed, by their names, or in a column of as many."""
    named = [name.lower() for name in robot.joint_names]
    numbered = [f"q{k}" for k in range(1, robot.size + 1)]
    wide = [name for name, column in available.items() if column.width == robot.size]
    measured, known = [name for name in wide if "action" not in name], known_as(available)
    columns = asked.columns
    if columns is None:
        called = next((each for each in (named, numbered) if known.keys() >= set(each)), None)
        columns = ",".join(called or measured[:1])
    found = values_of(where, available, columns, asked.angle_units()) if columns else None
    if (
        found is None
        or len(found.rotation) != robot.size
        or (asked.columns is None and len(measured) > 1)
    ):
        raise RecordingError(
            f"{where}: where are the {robot.size} joints of {robot.name}? list them with "
            f'columns="..." (--columns); found {described(available)}'
        )
    return JointColumns(values=found, robot=robot)


def pose_of(
    where: str | object,
    available: Mapping[str, Column],
    asked: Asked,
    known: Known = NOTHING,
    *,
    timed: bool = False,
) -> Columns:
    """Return which columns hold the pose, or what is read instead; see :func:`layout_of`.

    Where a time is needed too, a message that columns are missing names it.
    """
    if asked.values:
        # Only where all columns are asked for are those of time left out.
        whole = asked.columns is None and all(c.width == 1 for c in available.values())
        clock = clock_of(where, available, asked, known).columns if whole else ()
        return values_of(where, available, asked.columns, asked.stated_units(), clock)
    if asked.robot is not None:
        return _joints(where, available, asked, asked.robot)
    names = list(names_of(available))
    turn = known.euler if asked.rotation is None else parse_turn(asked.rotation)
    poses = poses_of(names)
    group = _chosen_group(asked.columns, available, poses)
    if asked.columns is not None and group is None:
        if asked.rotation is None:
            chosen = list(listed_places(where, asked.columns, available))
            alone = not_a_pose(chosen, names, BY_COUNT)
            if alone is True:
                return values_of(where, available, asked.columns, asked.stated_units())
            if alone:
                return _turning(alone)
        found = _listed_pose(where, asked.columns, available, names, turn)
    elif known.turn is not None:
        found = PoseColumns(
            position=[(name, 0) for name in known.position],
            rotation=[(name, 0) for name in known.numbers],
            turn=known.turn if turn is None else replace(turn, degrees=turn.degrees),
            length_unit="",
        )
    else:
        if turn is None and group is None and asked.columns is None:
            if values := position_alone(where, available, asked.stated_units()):
                return values
            if turn_alone := rotation_alone(available):
                return _turning(turn_alone)
        found = _named_pose(where, available, names, poses, group, turn, timed=timed)
    stated = {name.place: name.unit for name in names}
    units = {stated.get(place, "") for place in found.position} & set(METERS)
    unit = asked.unit(METERS) or (units.pop() if len(units) == 1 else "") or known.length or "m"
    angle = asked.unit({"deg": 1, "rad": 1})
    if angle and found.turn.angular and found.turn.degrees is None:
        found = replace(found, turn=replace(found.turn, degrees=angle == "deg"))
    return replace(found, length_unit=unit)


def _turning(rotation: list[Place]) -> PoseColumns:
    """Return an orientation without a position."""
    turn = Turn("quaternion", "wxyz")
    return PoseColumns(position=[], rotation=rotation, turn=turn, length_unit="m")


def _chosen_group(
    columns: str | None, available: Mapping[str, Column], poses: Mapping[str, Pose]
) -> str | None:
    """Return the pose that the user names by what its columns begin with."""
    if columns is None or columns.strip().lower() in available:
        return None
    group = "_".join(re.findall(r"[a-z0-9]+", columns.lower()))
    return group if group in poses and poses[group].position else None


def _listed_pose(
    where: str | object,
    columns: str,
    available: Mapping[str, Column],
    names: Sequence[Name],
    turn: Turn | None,
) -> PoseColumns:
    """Return the pose in the columns that the user lists, position first."""
    chosen = list(listed_places(where, columns, available))
    if turn is None:
        turn = BY_COUNT.get(len(chosen))
    ahead = 2 if turn is not None and turn.kind == "planar" else 3
    wanted = () if turn is None else {(ahead if n < 12 else 0) + n for n in turn.counts}
    if turn is None or len(chosen) not in wanted:
        raise RecordingError(
            f"{where}: columns {columns} hold {len(chosen)} numbers; a pose has "
            f"{len(POSE)}: {', '.join(POSE)}, in this order; or say by rotation=... (--rotation) "
            f"how the rotation is written: {KINDS}"
        )
    if len(chosen) >= 12:
        # A position and 3 x 3 numbers, or 3 x 4: the numbers tell.
        return PoseColumns(position=[], rotation=chosen, turn=turn, length_unit="")
    rotation = chosen[ahead:]
    if turn.kind == "euler":
        rotation = _by_axis(rotation, names, turn)
    return PoseColumns(position=chosen[:ahead], rotation=rotation, turn=turn, length_unit="")


def _by_axis(rotation: list[Place], names: Sequence[Name], turn: Turn) -> list[Place]:
    """Return three angles in the order of the axes, where their names tell the axes."""
    axes = {"roll": "x", "pitch": "y", "yaw": "z"}
    of = {name.place: name.tokens[-1] for name in names if name.tokens}
    told = {axes.get(of[p], of[p][-1]): p for p in rotation if p in of}
    order = turn.order.lower()
    return [told[axis] for axis in order] if set(told) == set(order) else rotation


def _named_pose(
    where: str | object,
    available: Mapping[str, Column],
    names: Sequence[Name],
    poses: dict[str, Pose],
    group: str | None,
    turn: Turn | None,
    *,
    timed: bool,
) -> PoseColumns:
    planar = _planar(names, turn)
    if group is None and planar is not None and (turn is None or turn.kind == "planar"):
        return planar
    groups = (
        [group] if group is not None else [name for name, pose in poses.items() if pose.position]
    )
    if "" in groups and poses[""].position:
        groups = [""]
    rotations = {name: _rotation(poses[name], turn) for name in groups}
    complete = [name for name in groups if rotations[name]]
    if not complete and len(groups) == 1:
        # The rotation may be called otherwise than the position.
        others = {name: _rotation(pose, turn) for name, pose in poses.items()}
        others = {name: found for name, found in others.items() if found}
        if len(others) == 1:
            complete, rotations = groups, {groups[0]: next(iter(others.values()))}
    if len(complete) > 1:
        raise RecordingError(
            f"{where}: which pose? {' and '.join(complete)} are there; choose one by what its "
            f'columns begin with, columns="{complete[0]}" (--columns {complete[0]})'
        )
    if not complete:
        timed = timed and not any(is_count(name) or is_clock(name) for name in names)
        raise _no_pose(where, available, poses, groups, timed=timed)
    chosen = complete[0]
    found = rotations[chosen]
    position = poses[chosen].position
    assert found is not None
    assert position is not None
    kind, parts = found
    require_once(where, available, [name.place[0] for name in (*position, *parts)])
    return PoseColumns(
        position=[name.place for name in position],
        rotation=[name.place for name in parts],
        turn=kind,
        length_unit="",
        group=chosen,
    )


def _rotation(pose: Pose, turn: Turn | None) -> tuple[Turn, list[Name]] | None:
    """Return how a pose's rotation is written and where, as the user says or the names do."""
    found = pose.rotation()
    if turn is None:
        return found
    if turn.kind in ("rotvec", "euler"):
        angles = pose.complete("v", POSITION) or pose.angles()
        if angles is None:
            return None
        if turn.kind == "euler":
            by_axis = dict(zip(POSITION, angles, strict=True))
            angles = [by_axis[axis] for axis in turn.order.lower()]
        degrees = degrees_of(angles) if turn.degrees is None else turn.degrees
        return replace(turn, degrees=degrees), angles
    return (turn, found[1]) if found is not None and found[0].kind == turn.kind else None


def _planar(names: Sequence[Name], turn: Turn | None) -> PoseColumns | None:
    """Return the pose of a vehicle: x, y and an angle, without a quaternion.

    ``theta`` is in radians where nothing is said; of ``yaw``, which others write in degrees as
    often, the unit must be.
    """
    of = {name.tokens: name for name in names}
    if any((part,) in of for part in QUATERNION) or not {("x",), ("y",)} <= set(of):
        return None
    angle = of.get(("theta",))
    said = None if turn is None else turn.degrees
    if angle is None and not {("z",), ("roll",), ("pitch",)} & set(of):
        angle = of.get(("yaw",))
        if angle is None or (degrees_of([angle]) is None and said is None):
            return None
    if angle is None:
        return None
    of_name = degrees_of([angle])
    return PoseColumns(
        position=[of["x",].place, of["y",].place],
        rotation=[angle.place],
        turn=Turn("planar", degrees=bool(said if of_name is None else of_name)),
        length_unit="",
    )


def _no_pose(
    where: str | object,
    available: Mapping[str, Column],
    poses: Mapping[str, Pose],
    groups: Sequence[str],
    *,
    timed: bool,
) -> RecordingError:
    """Return what to raise where the names do not tell a pose."""
    for group in groups:
        pose = poses[group]
        if angles := pose.angles():
            called = ", ".join(name.raw for name in angles)
            rpy = "e" in pose.parts and "r" not in pose.parts
            hint = "rpy:deg or rpy:rad" if rpy else "rotvec, euler:ZYX:deg"
            return RecordingError(
                f"{where}: what are {called}? say it with rotation=... (--rotation), such as "
                f"{hint}; known are {KINDS}"
            )
    bare = poses.get("", Pose())
    wanted: tuple[str, ...] = POSE
    here = set(available)
    if {"x", "y", "yaw"} <= here and not here & {"z", "roll", "pitch", *QUATERNION}:
        return RecordingError(
            f'{where}: column yaw does not say its unit; say rotation="planar:rad" or "planar:deg" '
            "(--rotation)"
        )
    turned = here & {"theta", "theta_deg"}
    # Without a quaternion and a height it is most likely meant to be planar.
    if not here & set(QUATERNION) and (turned or ("z" not in here and {"x", "y"} <= here)):
        wanted = ("x", "y", "theta")
    have = set(bare.parts.get("p", {})) | {f"q{a}" for a in bare.parts.get("q", {})} | here
    missing = [name for name in wanted if name not in have | ({"theta"} if turned else set())]
    missing = ["t"] * timed + missing
    found = (
        shown(name) if column.width == 1 else column.described(name)
        for name, column in available.items()
    )
    return RecordingError(
        f"{where}: {plural('column', missing or list(wanted))} missing, found "
        f"{listed(found, str)}; needed are t "
        "(or time, or i with a rate), and x,y,z,qw,qx,qy,qz or x,y,theta (radians) or "
        'x,y,theta_deg; or say which they are with columns="..." (--columns) and rotation="..." '
        f"(--rotation), planar:rad of x, y and yaw{of_joints(available)}"
    )


# ---------------------------------------------------------------------- time


def clock_of(
    where: str | object,
    available: Mapping[str, Column],
    asked: Asked,
    known: Known = NOTHING,
    group: str = "",
) -> Clock:
    """Return which columns hold the time, of the pose of some group; see :func:`layout_of`."""
    names = list(names_of(available))
    counts = [name for name in names if is_count(name)]
    if asked.time is None:
        told = _best_clock(where, names, group)
    else:
        chosen = [one.strip().lower() for one in asked.time.split(",")]
        of = {name.place[0]: name for name in names}
        if missing := [one for one in chosen if one not in of]:
            near = did_you_mean(missing[0], available)
            raise RecordingError(
                f"{where}: no column {missing[0]}{near}; found {described(available)}"
            )
        told = [of[one] for one in chosen]
        if len(told) > 2:
            raise RecordingError(f"{where}: time is one column, or seconds and nanoseconds")
        if told[0] in counts or (asked.rate is not None and len(told) == 1):
            counts, told = told, []
    require_once(where, available, [name.place[0] for name in told or counts[:1]])
    if told:
        if asked.rate is not None:
            warn(
                f"{where}: {told[0].raw} stamps the samples, so rate={asked.rate:g} "
                "(--sample-rate) is not used; ns.prepare(recording, rate=...) (--rate) resamples",
                RecordingWarning,
            )
        columns = tuple(name.place[0] for name in told)
        if available[columns[0]].is_text:
            return Clock(columns=columns, unit="date")
        said = asked.unit(SECONDS) or (told[0].unit if told[0].unit in SECONDS else "")
        said = "s" if len(columns) == 2 else said or known.time
        return Clock(columns=columns, unit=said or "s", said=bool(said))
    rate = known.rate if asked.rate is None else asked.rate
    if counts:
        return Clock(columns=(counts[0].place[0],), rate=check_rate(where, counts[0].raw, rate))
    if rate is None:
        raise RecordingError(
            f"{where}: column t missing, found {described(available)}; needed are t (or time, or i "
            'with a rate); name it with time="..." (--time-column), or give the rate=... (samples '
            "per second; on the command line --sample-rate)"
        )
    return Clock(rate=check_rate(where, "i", rate))


def _best_clock(where: str | object, names: Sequence[Name], group: str) -> list[Name]:
    """Return the clock to read: one of plain name, else the pose's own stamp, else any other."""

    def rank(name: Name) -> int:
        if len(name.tokens) == 1 and name.raw[:1] not in "_%":
            return 0
        *before, last = name.tokens
        prefix = "_".join(word for word in before if word not in ("header", "stamp"))
        return 1 if "stamp" in (last, *before) and group.startswith(prefix) and before else 2

    ranked: dict[int, dict[tuple[str, ...], list[Name]]] = {}
    for name in names:
        if not is_clock(name):
            continue
        ranked.setdefault(rank(name), {}).setdefault(name.tokens, []).append(name)
    if not ranked:
        return []
    best = ranked[min(ranked)]
    if len(best) > 1:
        raise RecordingError(
            f"{where}: columns {' and '.join(one[0].raw for one in best.values())} both give a "
            'time; keep one, or name it with time="..." (--time-column)'
        )
    (found,) = best.values()
    if len(found) == 1:
        return found
    by_unit = {name.unit: name for name in found}
    if len(found) == 2 and set(by_unit) == {"s", "ns"}:
        return [by_unit["s"], by_unit["ns"]]
    raise RecordingError(
        f"{where}: columns {' and '.join(name.raw for name in found)} both give a time; keep one, "
        'or name it with time="..." (--time-column)'
    )


def check_rate(where: str | object, column: str, rate: float | None) -> float:
    """Refuse a rate that does not turn numbers of samples into times."""
    if rate is None:
        raise RecordingError(
            f"{where}: column {column} counts samples and no column t gives their "
            "time; pass rate=... (samples per second; on the command line --sample-rate)"
        )
    if not 0 < number(rate) < np.inf:
        raise RecordingError(f"{where}: rate must be positive (samples per second), got {rate}")
    return rate


# ---------------------------------------------------------------------- samples


@dataclass(frozen=True, kw_only=True)
class Layout:
    """Which columns hold the time and the motion, and what a user should know of them."""

    clock: Clock
    content: Content
    exporter: str = ""
    note: str = ""

    @property
    def texts(self) -> tuple[str, ...]:
        """Columns that are read as text."""
        return self.clock.columns if self.clock.unit == "date" else ()

    @property
    def numbers(self) -> tuple[str, ...]:
        """Columns that are read as numbers, each once."""
        times = () if self.texts else self.clock.columns
        return tuple(dict.fromkeys([*times, *(name for name, _ in self.content.places)]))

    def understood(self, available: Mapping[str, Column]) -> list[str]:
        """Return what each column was taken for, a line each."""
        lines = dict.fromkeys(available, "not used")
        lines |= self.clock.understood() | self.content.understood(available)
        told = [f"as {self.exporter} writes it"] if self.exporter else []
        told += [f"{name}: {what}" for name, what in lines.items()]
        return told + [self.note] * bool(self.note)

    def samples(
        self,
        path: str | Path,
        available: Mapping[str, Column],
        of: Mapping[str, Floats],
        texts: Mapping[str, Sequence[str]],
        lines: Sequence[int] | None = None,
    ) -> Samples:
        """Return the poses in columns.

        Parameters
        ----------
        path : path
        available : mapping
            All columns.
        of, texts : mapping
            Columns of numbers, shape (N,) or (N, width), and of text.
        lines : sequence of int, optional
            Of the samples.
        """
        rotation = dict.fromkeys(name for name, _ in self.content.pose.rotation)
        source = Source(
            path,
            f"column {', '.join(self.clock.columns) or 't'}",
            f"column{'s' if len(rotation) > 1 else ''} {', '.join(rotation)}",
            lines,
        )
        columns = {key: v if v.ndim == 2 else v[:, None] for key, v in of.items()}
        return Samples(
            name=str(path),
            source=source,
            times=self.clock.seconds(source, columns, texts),
            **self.content.samples(source, columns),
            columns={
                f"column {key}": values[:, 0] if values.shape[1] == 1 else values
                for key, values in columns.items()
            },
            understood=self.understood(available),
            clock_said=self.clock.said,
        )


def dates(source: Source, column: str, texts: Sequence[str]) -> Floats:
    """Return dates in ISO 8601 as seconds since 1970; where they name no zone, as if in UTC.

    Raises
    ------
    InputError
        If one is none.
    """
    seconds = np.empty(len(texts))
    for index, text in enumerate(texts):
        match = _ISO.fullmatch(text.strip())
        try:
            if match is None:
                raise ValueError(text)
            whole = np.datetime64(f"{match[1]}T{match[2]}", "s").astype(np.int64)
        except ValueError:
            raise source.error(
                index,
                f"column {column}",
                f"found {text[:40]!r}, neither a number nor a date such as "
                "2024-05-01T10:00:00.01; name the column of time (--time-column)",
            ) from None
        zone = 0
        if match[5]:
            zone = int(f"{match[5]}1") * (int(match[6]) * 3600 + int(match[7] or 0) * 60)
        seconds[index] = int(whole) - zone + float(f"0{match[3] or '.0'}".replace(",", "."))
    return seconds


_ISO = re.compile(r"(\d{4}-\d\d-\d\d)[T ](\d\d:\d\d:\d\d)([.,]\d+)?\s*(Z|z|([+-])(\d\d):?(\d\d)?)?")
"""Date, time, fraction, and the zone."""


def _of_matrix(where: str, turn: Turn, numbers: Floats) -> tuple[Turn, Floats, Floats]:
    """Return rotation and position of 3 x 4 or 4 x 4 matrices, or of positions and 3 x 3.

    Which of them they are their numbers tell, and the order if it is not known.
    """
    orders = [turn.order] if turn.order else ["rows", "columns"]
    found = [order for order in orders if _is_pose(_matrices(order, numbers), numbers)]
    if numbers.shape[1] == 12 and _is_pose(numbers[:, 3:].reshape(-1, 3, 3), numbers):
        found += [f"position and {order}" for order in orders]
    if len(found) != 1:
        raise RecordingError(
            f"{where}: are the matrices written by rows or by columns? say it with rotation=... "
            "(--rotation matrix:rows or matrix:columns)"
            if found
            else f"{where}: {numbers.shape[1]} columns that are no pose's matrix; say with "
            'columns="..." (--columns), rotation="..." (--rotation) and time="..." (--time-column) '
            f"what they are, by their numbers from 0; rotations are {KINDS}"
        )
    *first, order = found[0].split(" and ")
    if first:
        return Turn("matrix", order), numbers[:, 3:], numbers[:, :3]
    matrices = _matrices(order, numbers)
    upper = matrices[:, :3]
    return Turn("matrix", "rows"), upper[:, :, :3].reshape(-1, 9), upper[:, :, 3]


def _matrices(order: str, numbers: Floats) -> Floats:
    """Return matrices, shape (N, 3, 4) or (N, 4, 4)."""
    rows = numbers.shape[1] // 4
    if order == "rows":
        return numbers.reshape(-1, rows, 4)
    return numbers.reshape(-1, 4, rows).transpose(0, 2, 1)


def _is_pose(matrices: Floats, numbers: Floats) -> bool:
    """Whether matrices hold rotations, and below them 0, 0, 0, 1; those of lost poses apart."""
    good = matrices[np.isfinite(numbers).all(axis=1) & numbers.any(axis=1)]
    if not len(good):
        return True
    turns = good[:, :3, :3]
    off = np.abs(turns @ turns.transpose(0, 2, 1) - np.eye(3)).max()
    below = np.abs(good[:, 3:] - [0, 0, 0, 1]).max(initial=0.0) if good.shape[1] == 4 else 0.0
    return bool(max(off, below) <= 1e-2)


def _check_planar_turns(source: Source, column: str, turn: Turn, angles: Floats) -> None:
    """Refuse angles that jump by more than half a turn, unless they are all within a turn."""
    theta = np.radians(angles) if turn.degrees else angles
    jumps = np.abs(np.diff(theta, prepend=theta[:1]))
    # Angles within one turn may be wrapped: there a jump is none.
    if np.ptp(theta) > 2 * np.pi + 1e-3 and jumps.max() > np.pi:
        raise source.error(
            int(jumps.argmax()),
            f"column {column}",
            f"turns by {jumps.max():.3g} rad since the sample before, more than half a turn; are "
            "these degrees (name the column theta_deg), or is the rate too low?",
        )
