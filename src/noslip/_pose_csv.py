"""Poses as named columns, and the CSV that holds them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from operator import itemgetter
from pathlib import Path

import numpy as np

from noslip._arguments import number
from noslip._pose_checks import Source
from noslip._samples import Samples
from noslip._typing import Floats
from noslip.errors import RecordingError
from noslip.named_columns import NamedColumns, listed, numbers_text, plural, shown

TIME = ("t", "time")
"""Either may name the time (s)."""
POSITION = ("x", "y", "z")
"""Meters; as everyone calls them."""
QUATERNION = ("qw", "qx", "qy", "qz")
"""Scalar first, as noslip has it everywhere."""
POSE = POSITION + QUATERNION
"""A pose in the order in which every table of ours has it."""
PLANAR = (("x", "y", "theta"), ("x", "y", "theta_deg"))
"""Of vehicles and planar robots, in radians or degrees."""


def read_csv(path: str | Path, *, rate: float | None = None) -> Samples:
    """Return the poses in a CSV."""
    table = NamedColumns.open(path)
    _check_header(table)
    time, layout = pose_layout(table.where, table.names, rate)
    lines, of, _ = table.read((time, *layout))
    if not lines:
        raise RecordingError(f"{table.where}: a header and no samples; record something first")
    source = Source(path, f"column {time}", f"columns {', '.join(QUATERNION)}", lines)
    return poses_of_columns(str(path), source, of, rate)


def _check_header(table: NamedColumns) -> None:
    """Tell a row of numbers from a header."""
    first = next(filter(None, table.names), "")
    try:
        float(first)
    except ValueError:
        return
    raise RecordingError(
        f"{table.where}: found {shown(first)} where a column name should be; "
        "put a header first, such as t,x,y,z,qw,qx,qy,qz"
    )


def csv_text(times: Floats, positions: Floats, quaternions: Floats) -> str:
    """Return poses as the text of a CSV."""
    table = np.column_stack([times, positions, quaternions])
    return numbers_text((TIME[0], *POSE), table)


def pose_layout(
    where: str, names: Sequence[str], rate: float | None
) -> tuple[str, tuple[str, ...]]:
    """Choose the column of time and those of the pose.

    Parameters
    ----------
    where : str
        For messages.
    names : sequence of str
        Of all columns.
    rate : float or None
        Samples per second, needed where column ``i`` numbers the samples.

    Raises
    ------
    InputError
        If one is missing or there twice, or the rate is needed and not there or not positive.
    """
    present = set(names)
    layout: tuple[str, ...] = POSE
    if not present.intersection(QUATERNION):
        for planar in PLANAR:
            if planar[-1] in present:
                layout = planar
                break
        else:
            # Without a quaternion and a height it is most likely meant to be planar.
            layout = layout if "z" in present or not {"x", "y"} <= present else PLANAR[0]
    missing = [name for name in layout if name not in present]
    times = [name for name in TIME if name in present]
    if not times and "i" not in present:
        missing.insert(0, "t")
    if missing:
        raise RecordingError(
            f"{where}: {plural('column', missing)} missing, found {listed(names)}; "
            "needed are t (or time, or i with a rate), and x,y,z,qw,qx,qy,qz or x,y,theta "
            "(radians) or x,y,theta_deg"
        )
    if len(times) > 1:
        raise RecordingError(f"{where}: columns t and time both give a time; keep one")
    time = times[0] if times else "i"
    for name in (time, *layout):
        if names.count(name) > 1:
            raise RecordingError(
                f"{where}: column {name} appears {names.count(name)} times; keep one"
            )
    if time == "i":
        check_rate(where, rate)
    return time, layout


def check_rate(where: str, rate: float | None) -> None:
    """Refuse a rate that does not turn numbers of samples into times."""
    if rate is None:
        raise RecordingError(
            f"{where}: column i counts samples and no column t gives their "
            "time; pass rate=... (samples per second; on the command line --sample-rate)"
        )
    if not 0 < number(rate) < np.inf:
        raise RecordingError(f"{where}: rate must be positive (samples per second), got {rate}")


def poses_of_columns(
    name: str, source: Source, of: Mapping[str, Floats], rate: float | None
) -> Samples:
    """Return the poses in the columns that :func:`pose_layout` chose."""
    time = next(name for name in (*TIME, "i") if name in of)
    times = of[time] if rate is None or time != "i" else of[time] / rate
    if "theta_deg" in of:
        of = {**of, "theta": np.radians(of["theta_deg"])}
    if "theta" in of:
        _check_planar_turns(source, of["theta"])
        height = np.zeros(len(times))
        positions = np.column_stack([of["x"], of["y"], height])
        half = of["theta"] / 2
        quaternions = np.column_stack([np.cos(half), height, height, np.sin(half)])
    else:
        positions, quaternions = (
            np.column_stack(itemgetter(*names)(of)) for names in (POSITION, QUATERNION)
        )
    return Samples(
        name=name,
        source=source,
        times=times,
        positions=positions,
        quaternions=quaternions,
        columns={f"column {each}": values for each, values in of.items()},
    )


def _check_planar_turns(source: Source, theta: Floats) -> None:
    """Refuse angles (rad) that jump by more than half a turn, unless they are all within a turn."""
    jumps = np.abs(np.diff(theta, prepend=theta[:1]))
    # Angles within one turn may be wrapped: there a jump is none.
    if np.ptp(theta) > 2 * np.pi + 1e-3 and jumps.max() > np.pi:
        raise source.error(
            int(jumps.argmax()),
            "column theta",
            f"turns by {jumps.max():.3g} rad since the sample before, more than half a turn; are "
            "these degrees (name the column theta_deg), or is the rate too low?",
        )
