"""Tables as people write them: 12 layouts, 6 rotations, 5 clocks, 4 dialects, 5 faults.

Each is read right, or refused with an option that then makes it right; never read wrongly.
"""

from __future__ import annotations

import itertools
import warnings
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from noslip import PoseTrajectory, load_demonstrations
from noslip.errors import RecordingError, RecordingWarning

COUNT = 30
T = 0.01 * np.arange(COUNT)
POSITIONS = np.column_stack([0.3 + 0.1 * T, 0.1 - 0.05 * T, 0.2 + 0.02 * np.sin(9 * T)])
TURNS = Rotation.from_rotvec(np.column_stack([0.3 + T, 0.2 - 0.5 * T, 0.4 + 0.8 * T]))
WXYZ = TURNS.as_quat(scalar_first=True)


def names(position: str, quaternion: str, other: str) -> dict[str, Any]:
    """Names of a layout: of the position and of quaternions by letter, of other rotations."""
    return {
        "position": [position.format(a) for a in "xyz"],
        "quaternion": [quaternion.format(a) for a in "wxyz"],
        "other": other,
    }


LAYOUTS = {
    "bare": names("{}", "q{}", "{}"),
    "capitals": names("{}", "q{}", "{}"),
    "p and t": names("p{}", "q{}", "{}"),
    "tum": names("t{}", "q{}", "{}"),
    "pos_ and quat_": names("pos_{}", "quat_{}", "{}"),
    "position.": names("Position.{}", "Rotation.{}", "{}"),
    "ros": names("pose.position.{}", "pose.orientation.{}", "pose.{}"),
    "field": names("field.pose.position.{}", "field.pose.orientation.{}", "field.pose.{}"),
    "slashes": names("/knife/pose/position/{}", "/knife/pose/orientation/{}", "/knife/pose/{}"),
    "euroc": names("p_RS_R_{} [m]", "q_RS_{} []", "{}"),
    "arm": names("left_eef_pos_{}", "left_eef_quat_{}", "left_eef_{}"),
    "no header": names("{}", "q{}", "{}"),
}


@dataclass
class Written:
    """Columns of a part, and the options that it needs to be understood."""

    of: dict[str, Any]
    needed: dict[str, Any] = field(default_factory=dict)
    word: str = ""


def rotation(kind: str, layout: dict[str, Any]) -> Written:
    def called(*parts: str) -> list[str]:
        return [layout["other"].format(part) for part in parts]

    match kind:
        case "wxyz":
            return Written(dict(zip(layout["quaternion"], WXYZ.T, strict=True)))
        case "xyzw":
            order = [1, 2, 3, 0]
            named = [layout["quaternion"][k] for k in order]
            return Written(dict(zip(named, WXYZ.T[order], strict=True)))
        case "rotvec":
            columns = called("rx", "ry", "rz")
            return Written(
                dict(zip(columns, TURNS.as_rotvec().T, strict=True)),
                {"rotation": "rotvec"},
                "--rotation",
            )
        case "euler":
            angles = TURNS.as_euler("ZYX", degrees=True).T[::-1]
            return Written(
                dict(zip(called("rx", "ry", "rz"), angles, strict=True)),
                {"rotation": "euler:ZYX:deg"},
                "--rotation",
            )
        case "rpy":
            angles = TURNS.as_euler("xyz").T
            return Written(
                dict(zip(called("roll", "pitch", "yaw"), angles, strict=True)),
                {"rotation": "rpy:rad"},
                "--rotation",
            )
    cells = TURNS.as_matrix().reshape(-1, 9).T
    return Written(
        dict(zip(called(*(f"r{i}{j}" for i in range(3) for j in range(3))), cells, strict=True))
    )


KINDS = ("wxyz", "xyzw", "rotvec", "euler", "rpy", "matrix")


def clock(kind: str) -> tuple[Written, float]:
    """Return the columns of time, and when the motion begins by them."""
    start = 1_700_000_000
    match kind:
        case "seconds":
            return Written({"time": T}), 0.0
        case "milliseconds":
            return Written({"timestamp": 1e3 * T}, {"units": "ms"}, "--time-unit ms"), 0.0
        case "dates":
            stamps = np.datetime64("2023-11-14T22:13:20") + np.arange(COUNT) * np.timedelta64(
                10, "ms"
            )
            return Written({"time": [f"{stamp}Z" for stamp in stamps]}), float(start)
        case "sec and nanosec":
            ticks = 10_000_000 * np.arange(COUNT)
            return Written({"sec": [start] * COUNT, "nanosec": ticks}), float(start)
    return Written({"i": np.arange(COUNT)}, {"rate": 100.0}, "--sample-rate"), 0.0


CLOCKS = ("seconds", "milliseconds", "dates", "sec and nanosec", "numbers")
DIALECTS = {"commas": ",", "decimal commas": ";", "tabs": "\t", "blanks": "  "}
FAULTS: dict[str, tuple[dict[str, Any], str]] = {
    "none": ({}, ""),
    "lost": ({"lost": "drop"}, "--lost"),
    "twice": ({"duplicates": "first"}, "--duplicates"),
    "backwards": ({"unsorted": "sort"}, "--unsorted"),
    "gap": ({"gaps": "split"}, "--gaps"),
}


def text(dialect: str, header: list[str], rows: list[list[str]]) -> str:
    sign = DIALECTS[dialect]
    if dialect == "decimal commas":
        rows = [[cell.replace(".", ",") if _decimal(cell) else cell for cell in r] for r in rows]
    if dialect == "blanks":
        header = [name.replace(" ", "") for name in header]
    lines = [sign.join(cells) for cells in ([header] if header else []) + rows]
    return "\n".join(lines) + "\n"


def _decimal(cell: str) -> bool:
    return cell.replace(".", "").replace("-", "").replace("e", "").isdigit()


def faulty(fault: str, rows: list[list[str]], clocks: int) -> tuple[list[list[str]], list[int]]:
    """Return rows with a fault, and which of the samples are left when it is mended."""
    kept = list(range(COUNT))
    match fault:
        case "lost":
            rows[12] = rows[12][:clocks] + ["nan"] * (len(rows[12]) - clocks)
            kept.remove(12)
        case "twice":
            again = rows[13][:clocks] + rows[14][clocks:]
            rows.insert(14, again)
        case "backwards":
            rows[15], rows[16] = rows[16], rows[15]
        case "gap":
            del rows[9:20]
            kept = kept[:9] + kept[20:]
    return rows, kept


def cell(value: Any) -> str:
    return (
        value if isinstance(value, str) else repr(value.item() if hasattr(value, "item") else value)
    )


def right(found: list[PoseTrajectory], start: float, kept: list[int]) -> bool:
    times = np.concatenate([one.times for one in found])
    if len(times) != len(kept):
        return False
    positions = np.concatenate([one.positions for one in found])
    turned = Rotation.concatenate([one.rotations for one in found]) * TURNS[kept].inv()
    # Since 1970 a double resolves 0.24 microseconds.
    return bool(
        np.abs(times - start - T[kept]).max() < (1e-9 if start == 0 else 5e-7)
        and np.abs(positions - POSITIONS[kept]).max() < 1e-9
        and turned.magnitude().max() < 1e-7
    )


def assert_right_or_refused(file: Path, start: float, kept: list[int], parts: list) -> str:
    """Load without options, then with them; return what was said at first."""
    needed: dict[str, Any] = {}
    for options, _ in parts:
        needed |= options
    said = ""
    try:
        found = load_demonstrations(file)
        assert right(found, start, kept), "read wrongly without a word"
    except RecordingError as error:
        said = str(error)
        # One fault is named at a time; it is one of those that there are.
        words = [word for options, word in parts if word]
        assert any(word in said for word in words), said
    assert right(load_demonstrations(file, **needed), start, kept), f"wrong with {needed}"
    return said


@cache
def table(name: str, kind: str, time: str) -> tuple[Written, Written, float, list[str], list[Any]]:
    """Rotation, clock and its start; header and rows of all columns."""
    layout = LAYOUTS[name]
    turn, (clocked, start) = rotation(kind, layout), clock(time)
    columns = {
        **clocked.of,
        **dict(zip(layout["position"], POSITIONS.T, strict=True)),
        **turn.of,
    }
    rows = [list(map(cell, row)) for row in zip(*columns.values(), strict=True)]
    return turn, clocked, start, list(columns), rows


@pytest.mark.parametrize("name", LAYOUTS)
def test_every_table_is_read_right_or_refused_with_the_option_that_helps(
    name: str, tmp_path: Path
) -> None:
    refused, count = 0, 0
    # A sixth of all of them, each layout another: together they have every combination.
    every = itertools.product(KINDS, CLOCKS, DIALECTS, FAULTS)
    for kind, time, dialect, fault in itertools.islice(
        every, list(LAYOUTS).index(name) % 6, None, 6
    ):
        if time == "numbers" and fault in ("twice", "backwards"):
            continue  # the same number twice is no clock's fault
        turn, clocked, start, columns, whole = table(name, kind, time)
        rows, kept = faulty(fault, list(whole), len(clocked.of))
        header = [key.upper() for key in columns] if name == "capitals" else columns
        parts = [(clocked.needed, clocked.word), (turn.needed, turn.word), FAULTS[fault]]
        if name == "no header":
            header = []
            places = [str(k) for k in range(len(clocked.of), len(columns))]
            told = {"columns": ",".join(places), "rotation": turn.needed.get("rotation", kind)}
            if kind == "euler":  # by number, angles stand in the order of the axes
                told["columns"] = ",".join([*places[:3], *places[:2:-1]])
            told["rotation"] = {"matrix": "matrix:rows"}.get(kind, told["rotation"])
            if time != "numbers":
                told["time"] = ",".join(str(k) for k in range(len(clocked.of)))
            else:
                told["time"] = "0"
            if time == "seconds":
                told["units"] = "s"
            parts.append((told, "--columns"))
        file = tmp_path / "run.csv"
        file.write_text(text(dialect, header, rows))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RecordingWarning)
            try:
                said = assert_right_or_refused(file, start, kept, parts)
            except Exception as error:
                raise AssertionError(
                    f"{name}, {kind}, {time}, {dialect}, {fault}: {error}"
                ) from error
        refused, count = refused + bool(said), count + 1
    assert count >= 75
    assert 0 < refused < count or name == "no header"


PREFIXES = st.text("abdefghijklmn_/.", max_size=8).filter(
    lambda s: not set(s.replace("/", "_").replace(".", "_").split("_")) & {"a", "f", "dx", "acc"}
)


@given(prefix=PREFIXES, sign=st.sampled_from(["_", ".", "/"]), upper=st.booleans())
@settings(max_examples=60, deadline=None)
def test_what_stands_before_the_names_does_not_matter(
    tmp_path_factory: pytest.TempPathFactory, prefix: str, sign: str, upper: bool
) -> None:
    columns = dict(zip([f"pos{sign}{a}" for a in "xyz"], POSITIONS.T, strict=True))
    columns |= dict(zip([f"quat{sign}{a}" for a in "wxyz"], WXYZ.T, strict=True))
    named = {f"{prefix}{sign}{key}": values for key, values in columns.items()}
    header = ["time", *(key.upper() if upper else key for key in named)]
    rows = [list(map(cell, row)) for row in zip(T, *named.values(), strict=True)]
    file = tmp_path_factory.mktemp("names") / "run.csv"
    file.write_text(text("commas", header, rows))
    assert right(load_demonstrations(file), 0.0, list(range(COUNT)))
