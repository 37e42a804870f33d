"""Motions as columns for robots that take velocities: twists, and the speeds of a drive."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, get_args

import numpy as np

from noslip import _arguments
from noslip._pose_names import POSE, clock_name
from noslip._typing import Floats
from noslip.errors import CompromiseWarning, InputError, warn
from noslip.named_columns import numbers_text
from noslip.series import Series
from noslip.trajectory import PoseTrajectory

Twist = Literal["body", "world"]
TWIST = ("vx", "vy", "vz", "wx", "wy", "wz")
"""Columns of a twist: m/s and rad/s."""
WHEELS = ("track", "radius")
"""Of a differential drive: distance between the wheels' planes, and their radius; meters."""
FLAT = 1e-9
"""How far (m, and in each number of a unit quaternion) a planar motion may leave its plane: what
rounding does."""
SLIPS = 1e-6
"""Share of its speed that a vehicle may slip sideways before its speed alone misleads."""


def twists(trajectory: PoseTrajectory, kind: Twist) -> Floats:
    """Return the twist to command at each sample until the next, shape (N, 6); the last is zero.

    Parameters
    ----------
    trajectory : PoseTrajectory
    kind : "body" or "world"
        The frame in which it is given: that of :attr:`PoseTrajectory.body_velocities`, or the
        world's.

    Notes
    -----
    A robot that gets no further command goes on with the last one, so the last is zero.
    """
    if kind not in get_args(Twist):
        raise InputError(f"twist is one of {', '.join(get_args(Twist))}; got {kind!r}")
    if kind == "body":
        steps = trajectory.body_velocities
    else:
        steps = np.hstack(trajectory.step_velocities())
    return np.vstack([steps, np.zeros((1, 6))])


def motion_columns(
    trajectory: PoseTrajectory | Series,
    *,
    twist: Twist | None = None,
    planar: bool = False,
    wheels: Mapping[str, float] | None = None,
) -> dict[str, Floats]:
    """Return a motion as named columns, shape (N,) each; its channels follow.

    Parameters
    ----------
    trajectory : PoseTrajectory or Series
        Of vectors only the times and values.
    twist : "body" or "world", optional
        Add the twist of the step that follows each sample; of a planar motion ``v`` (m/s,
        forward) and ``omega`` (rad/s) whatever it says.
    planar : bool
        ``x, y, theta`` (radians, without jumps) instead of the pose.
    wheels : mapping, optional
        ``track`` and ``radius`` of a differential drive (m): add the wheels' speeds ``left`` and
        ``right`` (rad/s).

    Raises
    ------
    InputError
        If the motion is not planar and should be, the wheels lack a measure, or a channel is called
        as a column of the motion.

    Warns
    -----
    CompromiseWarning
        If the motion slips sideways, which ``v`` and ``omega`` leave out.

    Notes
    -----
    ``v`` is the speed along the arc of the step, so that a drive that holds ``v`` and ``omega``
    until the next sample arrives there.
    """
    if isinstance(trajectory, Series):
        return {clock_name(trajectory.times): trajectory.times} | _named(trajectory)
    of = _pose_columns(trajectory, twist=twist, planar=planar, wheels=wheels)
    if trajectory.channels is None:
        return of
    beside = _named(trajectory.channels)
    if both := set(of) & set(beside):
        raise InputError(
            f"{trajectory.name}: channel {', '.join(sorted(both))} is called as a column of the "
            "motion; rename it"
        )
    return of | beside


def _named(series: Series) -> dict[str, Floats]:
    return dict(zip(series.csv_columns(), series.values.T, strict=True))


def _pose_columns(
    trajectory: PoseTrajectory,
    *,
    twist: Twist | None,
    planar: bool,
    wheels: Mapping[str, float] | None,
) -> dict[str, Floats]:
    times = {clock_name(trajectory.times): trajectory.times}
    if not planar and wheels is None:
        columns = np.column_stack([trajectory.positions, trajectory.quaternions])
        of = times | dict(zip(POSE, columns.T, strict=True))
        if twist is not None:
            of |= dict(zip(TWIST, twists(trajectory, twist).T, strict=True))
        return of
    theta = _plane(trajectory)
    of = times | {"x": trajectory.positions[:, 0], "y": trajectory.positions[:, 1], "theta": theta}
    if twist is None and wheels is None:
        return of
    forward, omega = _drive(trajectory)
    of |= {"v": forward, "omega": omega}
    if wheels is not None:
        if set(wheels) != set(WHEELS):
            raise InputError(
                f"wheels need {' and '.join(WHEELS)} (m), got {', '.join(wheels) or 'none'}"
            )
        track, radius = (_arguments.positive(f"wheels: {name}", wheels[name]) for name in WHEELS)
        of["left"] = (forward - omega * track / 2) / radius
        of["right"] = (forward + omega * track / 2) / radius
    return of


def motion_text(trajectory: PoseTrajectory | Series, **asked: Any) -> str:
    """Return :func:`motion_columns` as the text of a CSV; a float read back is the one written."""
    of = motion_columns(trajectory, **asked)
    return numbers_text(of, np.column_stack(list(of.values())))


def _plane(trajectory: PoseTrajectory) -> Floats:
    """Return the angles about z of a planar motion (rad), shape (N,), without jumps."""
    height = float(np.ptp(trajectory.positions[:, 2]))
    tilt = float(np.abs(trajectory.quaternions[:, 1:3]).max())
    if height > FLAT or tilt > FLAT:
        raise InputError(
            f"{trajectory.name}: is not planar: its height varies by {height:.2g} m, and it tilts "
            f"by {2 * np.degrees(np.arcsin(min(tilt, 1.0))):.2g} degrees; leave planar out"
        )
    w, _, _, z = trajectory.quaternions.T
    return np.unwrap(2 * np.arctan2(z, w))


def _drive(trajectory: PoseTrajectory) -> tuple[Floats, Floats]:
    """Return forward speed along the arc and turn rate at each sample; the last are zero."""
    steps = twists(trajectory, "body")
    forward, sideways, omega = steps[:, 0], steps[:, 1], steps[:, 5]
    size = float(np.sqrt(np.mean(sideways**2) / max(np.mean(forward**2), np.finfo(float).tiny)))
    if size > SLIPS:
        warn(
            f"{trajectory.name}: slips sideways by {100 * size:.2g} % of its speed, which v and "
            "omega leave out; hold a wheel, or move the point onto the axle (tool_frame, "
            "--tool-frame)",
            CompromiseWarning,
        )
    half = np.append(np.diff(trajectory.times), 0.0) * omega / 2
    return forward / np.sinc(half / np.pi), omega
