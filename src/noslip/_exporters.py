"""Tables of text by the programs that write them, known by their looks."""

from __future__ import annotations

import re
from collections.abc import Sequence

from noslip._dialect import Dialect
from noslip._pose_columns import NOTHING, Known
from noslip._pose_names import UNITS
from noslip._turns import Turn

_FRANKA = tuple(f"o_t_ee[{k}]" for k in range(16))
_UR = re.compile(r"((?:actual|target)_tcp_pose)_0")
_TUM = ("t", "x", "y", "z", "qx", "qy", "qz", "qw")
"""As the RGB-D benchmark of TU Munich orders them: the scalar of the quaternion last."""
_ROS2_ECHO = ("sec", "nanosec", "frame_id", "x", "y", "z", "qx", "qy", "qz", "qw")
"""What ``ros2 topic echo --csv`` writes of a PoseStamped, without a header."""


def recognized(
    names: Sequence[str], dialect: Dialect, first: Sequence[str], suffix: str
) -> tuple[Sequence[str], Known]:
    """Return names of the columns, and what is known beyond them.

    Parameters
    ----------
    names : sequence of str
        Of the columns, in lower case, or their numbers.
    dialect : Dialect
        What stands before the rows.
    first : sequence of str
        Cells of the first row.
    suffix : str
        Of the file, in lower case.
    """
    if dialect.header is None:
        return _headless(names, first, suffix)
    words = set(names)
    title = dialect.preamble[0] if dialect.preamble else []
    if title[:1] == ["Format Version"]:
        return _motive(names, dialect.preamble)
    if {"frame", "sub frame"} <= words:
        return _vicon(names, dialect)
    if words >= set(_FRANKA):
        turn = Turn("matrix", "columns")
        return names, Known(exporter="Franka", turn=turn, numbers=_FRANKA)
    for name in names:
        if match := _UR.fullmatch(name):
            pose = [f"{match[1]}_{k}" for k in range(6)]
            if words >= set(pose) and (match[1].startswith("actual") or len(words) < 8):
                return names, Known(
                    exporter="UR RTDE",
                    position=tuple(pose[:3]),
                    turn=Turn("rotvec", degrees=False),
                    numbers=tuple(pose[3:]),
                    time="s",
                )
    if {"tx", "ty", "tz", "rx", "ry", "rz", "face", "state"} <= words:
        return names, Known(
            exporter="NDI",
            position=("tx", "ty", "tz"),
            turn=Turn("euler", "ZYX", degrees=True),
            numbers=("rz", "ry", "rx"),
            length="mm",
        )
    if {"tx", "ty", "tz", "q0", "qx", "qy", "qz"} <= words and {"face", "state"} & words:
        return names, Known(exporter="NDI", length="mm")
    if {"x", "y", "z", "a", "b", "c"} <= words and not words & {"qw", "qx", "rx"}:
        return names, Known(
            exporter="KUKA",
            position=("x", "y", "z"),
            turn=Turn("euler", "ZYX", degrees=True),
            numbers=("a", "b", "c"),
            length="mm",
        )
    if {"x", "y", "z", "az", "el", "ro"} <= words:
        return names, Known(
            exporter="Polhemus",
            position=("x", "y", "z"),
            turn=Turn("euler", "ZYX", degrees=True),
            numbers=("az", "el", "ro"),
        )
    if "%time" in words:
        return names, Known(exporter="rostopic echo -p", time="ns")
    return names, NOTHING


def _headless(
    names: Sequence[str], first: Sequence[str], suffix: str
) -> tuple[Sequence[str], Known]:
    if len(first) == len(_ROS2_ECHO) and not _is_number(first[2]):
        return _ROS2_ECHO, Known(exporter="ros2 topic echo --csv")
    if suffix in (".tum", ".txt") and len(first) == len(_TUM):
        return _TUM, Known(exporter="TUM")
    if len(first) == 12:
        # KITTI's, if the numbers are those of poses; what else they are is asked after.
        return names, Known(exporter="KITTI", turn=Turn("matrix", "rows"), numbers=tuple(names))
    return names, NOTHING


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _motive(names: Sequence[str], preamble: Sequence[Sequence[str]]) -> tuple[Sequence[str], Known]:
    """Names as body.rotation.x; units and the kind of rotation stand in the first row."""
    title = preamble[0]
    facts = dict(zip(title[::2], title[1::2], strict=False))
    rows = [list(row) + [""] * (len(names) - len(row)) for row in preamble[1:]]
    labels: dict[str, list[str]] = {row[1].lower(): row for row in rows if row[1]}
    parts = next((row for row in rows if not any(row[:2])), [""] * len(names))
    kinds, bodies = (labels.get(key, [""] * len(names)) for key in ("type", "name"))
    told = []
    for k, name in enumerate(names):
        part = parts[k].strip().lower()
        if k < 2 or part not in ("rotation", "position") or not name:
            told.append(name if k < 2 else f"{bodies[k]} {part or name}".strip().lower())
            continue
        marker = "" if kinds[k].strip().lower() in ("rigid body", "bone", "") else "marker "
        told.append(f"{marker}{bodies[k]} {part} {name}".lower())
    rotation = facts.get("Rotation Type", "").strip()
    euler = rotation.upper() if len(rotation) == 3 else ""
    known = Known(
        exporter="Motive",
        length=UNITS.get(facts.get("Length Units", "").strip().lower(), ""),
        euler=Turn("euler", euler, degrees=True) if euler else None,
        note="Motive: the world's axes are as exported, Y up unless its settings say Z up",
    )
    return told, known


def _vicon(names: Sequence[str], dialect: Dialect) -> tuple[Sequence[str], Known]:
    """Names as body.rx; the rate stands in the second row, the bodies in the one before the names.

    What its three angles are depends on the settings of the export, and is asked after.
    """
    flat = [cell.strip() for row in dialect.preamble for cell in row if cell.strip()]
    rate = next((float(cell) for cell in flat if _is_number(cell)), None)
    bodies = dialect.preamble[-1] if dialect.preamble else []
    body, told = "", []
    for k, name in enumerate(names):
        if k < len(bodies) and bodies[k].strip() and not _is_number(bodies[k]):
            body = bodies[k].strip().rpartition(":")[2].lower()
        told.append(f"{body} {name}" if k > 1 and body else name)
    return told, Known(exporter="Vicon", rate=rate)
