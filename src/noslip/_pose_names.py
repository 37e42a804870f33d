"""What the names of columns say: units, clocks, and the parts of poses."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from noslip._turns import Turn
from noslip._typing import Floats
from noslip.named_columns import listed

POSITION = ("x", "y", "z")
"""Meters; as everyone calls them."""
QUATERNION = ("qw", "qx", "qy", "qz")
"""Scalar first, as noslip has it everywhere."""
POSE = POSITION + QUATERNION
"""A pose in the order in which every table of ours has it."""
TIME = ("t", "time")
"""Either may name the time (s)."""
SECONDS = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
"""How many of a unit make a second."""
METERS = {"m": 1.0, "cm": 1e2, "mm": 1e3, "in": 1 / 0.0254}
"""How many of a unit make a meter."""
_SPELLINGS = {
    "s": ("sec", "secs", "second", "seconds"),
    "ms": ("msec", "millis", "millisecond", "milliseconds"),
    "us": ("usec", "µs", "μs", "micros", "microsecond", "microseconds"),
    "ns": ("nsec", "nsecs", "nanos", "nanosec", "nanosecs", "nanosecond", "nanoseconds"),
    "m": ("meter", "meters", "metre", "metres"),
    "cm": ("centimeter", "centimeters", "centimetres"),
    "mm": ("millimeter", "millimeters", "millimetres"),
    "in": ("inch", "inches"),
    "deg": ("degree", "degrees", "°"),
    "rad": ("radian", "radians"),
}
SPARSEST = 0.5
"""Seconds between samples.  Slower recorders exist, of slow processes; but where a motion is also
slower than a thousandth of the fastest, it is likely in milliseconds, at up to 2 kHz."""
UNITS = {word: unit for unit, words in _SPELLINGS.items() for word in (unit, *words)}
"""Units by what they are called, in lower case."""
_BRACKETED = re.compile(r"^(.*?)\s*[\[(]([^\[\]()]*)[\])]$")
_AS_SUFFIX = {"ms", "us", "ns", "mm", "cm", "deg", "rad", *_SPELLINGS["s"], *_SPELLINGS["ns"]}
"""Units that end a name without brackets, as in time_ms; single letters would be axes."""
_CLOCKS = {"t", "time", "timestamp", "timestamps", "stamp", "stamps"}
_COUNTS = {"i", "index", "frame", "sample"}
"""Columns that number the samples."""
_NO_POSE = frozenset(
    {"vel", "velocity", "v", "dx", "acc", "accel", "acceleration", "a", "force", "f", "torque"}
    | {"tau", "wrench", "gyro", "mag", "omega", "linear", "angular", "twist", "imu", "error"}
    | {
        "err",
        "std",
        "cov",
        "covariance",
        "residual",
        "marker",
        "target",
        "command",
        "cmd",
        "action",
    }
)
"""Words of names whose x, y and z are no position."""
WIDEST = 1000
"""Numbers in a column up to which their names are looked at: images and clouds are none of a
pose."""
Place = tuple[str, int]
"""A column, and which of the numbers that it holds."""


def clock_name(times: Floats) -> str:
    """Return what to call the column of times (s) that is written.

    It states the unit where samples are so sparse that a reader would ask after it.
    """
    sparse = np.median(np.diff(times)) >= SPARSEST or times[-1] - times[0] > 86400
    return "t[s]" if sparse else TIME[0]


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Attributes
    ----------
    width : int
        How many numbers a row holds there.
    names : tuple of str
        Of these, if they have any.
    unit : str
        As the table states it, one of ``UNITS``; empty if it does not.
    is_text : bool
        Whether it holds text, such as a date.
    raw : str
        Its name as the table writes it, where that is known.
    """

    width: int = 1
    names: tuple[str, ...] = ()
    unit: str = ""
    is_text: bool = False
    raw: str = ""

    def described(self, name: str) -> str:
        """Return what to call it in a message."""
        if self.width == 1:
            return name
        return f"{name}[{self.width}]" + (f" ({', '.join(self.names)})" if self.names else "")


@dataclass(frozen=True)
class Name:
    """A name of a column, or of a number in one, taken apart."""

    place: Place
    tokens: tuple[str, ...]
    unit: str
    raw: str


def names_of(available: Mapping[str, Column]) -> Iterator[Name]:
    for name, column in available.items():
        if column.width == 1:
            yield _taken_apart((name, 0), name, column.unit)
            continue
        if column.width > WIDEST:
            continue
        inside = column.names or tuple(map(str, range(column.width)))
        for place, part in enumerate(inside):
            told = _taken_apart((name, place), part, column.unit)
            prefix = _taken_apart((name, place), name, "").tokens
            yield replace(told, tokens=(*prefix, *told.tokens))


def _taken_apart(place: Place, name: str, unit: str) -> Name:
    base = name.strip().lower()
    if (match := _BRACKETED.match(base)) and not match[2].strip().isdigit():
        base, unit = match[1], unit or UNITS.get(match[2].strip(), "")
    tokens = [token for token in re.split(r"[^a-z0-9°µ]+", base) if token]
    if len(tokens) == 1 and len(tokens[0]) > 1 and UNITS.get(tokens[0]) in SECONDS:
        # A clock that is called after its unit: sec, nanosec.
        return Name(place, ("time",), UNITS[tokens[0]], name)
    if len(tokens) > 1 and tokens[-1] in _AS_SUFFIX:
        unit = unit or UNITS[tokens[-1]]
        tokens.pop()
    return Name(place, tuple(tokens), unit, name)


_PARTS: tuple[tuple[str, re.Pattern[str]], ...] = (
    (
        "q",
        re.compile(r"(?:(.*)_)?(?:q|quat_?|quaternion_?|orientation_?|rotation_?|rot_?)([wxyz])"),
    ),
    ("q", re.compile(r"()q_(?:.*_)?([wxyz])")),
    ("n", re.compile(r"(?:(.*)_)?q_?([0-9]+)")),
    ("v", re.compile(r"(?:(.*)_)?(?:rotvec_?|rotation_vector_?|axis_angle_?)([xyz])")),
    # LeRobot's end effectors: x, y, z, wx, wy, wz.
    ("v", re.compile(r"((?:.*_)?ee)_w([xyz])")),
    ("r", re.compile(r"(?:(.*)_)?(?:r|angle_?|euler_?)([xyz])")),
    ("e", re.compile(r"(?:(.*)_)?(roll|pitch|yaw)")),
    ("m", re.compile(r"(?:(.*)_)?(?:r|m|rot|mat|rotation)_?([0-3]_?[0-3])")),
    ("p", re.compile(r"()p_(?:.*_)?([xyz])")),
    (
        "p",
        re.compile(r"(?:(.*?)_)?(?:(?:pos|position|p|t|trans|translation|loc|location)_?)?([xyz])"),
    ),
)
"""What the end of a name may be: a part of a quaternion, by letter or number; of a rotation vector;
of three angles; roll, pitch or yaw; of a matrix; of the position.  The group before it tells poses
apart."""


@dataclass
class Pose:
    """What was found of one pose: places and units by part."""

    parts: dict[str, dict[str, Name]] = field(default_factory=dict)

    def complete(self, kind: str, letters: Sequence[str]) -> list[Name] | None:
        """Return the names of some parts, if all are there."""
        found = self.parts.get(kind, {})
        return [found[a] for a in letters] if all(a in found for a in letters) else None

    @property
    def position(self) -> list[Name] | None:
        """The names of x, y and z."""
        return self.complete("p", POSITION)

    def rotation(self) -> tuple[Turn, list[Name]] | None:
        """Return how the rotation is written and where, if the names tell."""
        if found := self.complete("q", ("w", "x", "y", "z")):
            return Turn("quaternion", "wxyz"), found
        vector = self.complete("q", POSITION)
        scalar = self.parts.get("n", {}).get("0") or self.parts.get("s", {}).get("w")
        if vector and scalar:
            return Turn("quaternion", "wxyz"), [scalar, *vector]
        numbered = self.parts.get("n", {})
        if set(numbered) == {"0", "1", "2", "3"}:
            return Turn("quaternion", "wxyz"), [numbered[k] for k in "0123"]
        if found := self.complete("v", POSITION):
            return Turn("rotvec", degrees=degrees_of(found)), found
        if (found := self.complete("e", ("roll", "pitch", "yaw"))) and found[0].unit:
            return Turn("euler", "xyz", degrees_of(found)), found
        for first in (0, 1):
            cells = [f"{i}{j}" for i in range(first, first + 3) for j in range(first, first + 3)]
            if found := self.complete("m", cells):
                return Turn("matrix", "rows"), found
        return None

    def angles(self) -> list[Name] | None:
        """Return three angles whose meaning the names do not tell."""
        found = self.complete("r", POSITION) or self.complete("e", ("roll", "pitch", "yaw"))
        if found or "w" in self.parts.get("q", {}):
            return found
        # Rotation X, Y and Z are angles where there is no W; qx, qy and qz lack qw.
        found = self.complete("q", POSITION)
        quaternion = found and any(token.startswith("q") for token in found[0].tokens)
        return None if quaternion else found


def degrees_of(names: Sequence[Name]) -> bool | None:
    units = {name.unit for name in names}
    return {"deg": True, "rad": False}.get(units.pop()) if len(units) == 1 else None


def poses_of(names: Iterable[Name]) -> dict[str, Pose]:
    """Return what looks like parts of poses, by what stands before."""
    poses: dict[str, Pose] = {}
    for name in names:
        if _NO_POSE.intersection(name.tokens[:-1]):
            continue
        tail = "_".join(name.tokens)
        for kind, pattern in _PARTS:
            if match := pattern.fullmatch(tail):
                group, part = (match[1] or "").strip("_"), match[2].replace("_", "")
                poses.setdefault(group, Pose()).parts.setdefault(kind, {}).setdefault(part, name)
                break
        else:
            if name.tokens and name.tokens[-1] == "w":
                group = "_".join(name.tokens[:-1])
                poses.setdefault(group, Pose()).parts.setdefault("s", {}).setdefault("w", name)
    return poses


def is_clock(name: Name) -> bool:
    return bool(name.tokens) and name.tokens[-1] in _CLOCKS


def names_time(text: str) -> bool:
    """Whether a column of this name would be taken for the time beside any other."""
    return any(is_clock(name) and len(name.tokens) == 1 for name in names_of({text: Column()}))


def is_count(name: Name) -> bool:
    words = [word for word in name.tokens if word not in ("number", "no", "id")]
    return bool(words) and all(word in _COUNTS for word in words)


def described(available: Mapping[str, Column]) -> str:
    """Return the columns of a table for a message."""
    return listed([column.described(name) for name, column in available.items()], str)
