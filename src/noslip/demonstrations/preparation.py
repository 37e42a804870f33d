"""From the recording of a sensor to the demonstration of a tool.

Each step takes a :class:`~noslip.trajectory.PoseTrajectory` and returns a new one of the same
name; :func:`prepare` strings them together in the order of Straižys, Burke and Ramamoorthy,
"Learning robotic cutting from demonstration", section "Learning elliptical excision".
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Literal, TypeVar, get_args

import numpy as np
import scipy
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from noslip import _arguments
from noslip._instants import interval, on_clock, seconds
from noslip._pose_checks import MINIMUM_SAMPLES
from noslip._typing import Floats
from noslip.errors import InputError
from noslip.scale import as_asked, ask_after_units
from noslip.timed import Timed
from noslip.trajectory import PoseTrajectory
from noslip.vectors import Trajectory

Recorded = TypeVar("Recorded", PoseTrajectory, Trajectory)
"""What is recorded, and comes back as it was: poses or vectors."""

PAPER_CUTOFF = 4.8
"""Cut-off frequency of the paper's low-pass filter (Hz)."""
PAPER_ORDER = 3
"""Order of the paper's Butterworth filter; run forwards and backwards, it counts twice."""
SPEED_WINDOW = 0.1
"""Seconds to either side over which :func:`trim_speed` averages the velocity."""
RIGID_TOLERANCE = 1e-3
"""How far a tool frame's rotation or quaternion may be from orthogonal or from unit length."""
RINGING_LEFT = 1e-9
"""Share of the low-pass filter's impulse response that may outlast the padding."""
HIGHEST_CUTOFF = 0.999
"""Of half the sampling rate; nearer to it, the filter rings for ever and removes nothing."""
ROTATION_PASSES = 3
"""Passes of the filter for rotations; planar rotations need one."""


# ---------------------------------------------------------------- tool frame


def tool_frame_matrix(tool_frame: ArrayLike) -> Floats:
    """Return a tool frame as a homogeneous matrix, shape (4, 4).

    Parameters
    ----------
    tool_frame : array
        The tool's pose in the sensor's frame, T_sb, lengths in meters: a homogeneous matrix
        (4, 4), a translation (3,), or ``x, y, z, qw, qx, qy, qz`` (7,).

    Raises
    ------
    InputError
        If it has another shape, holds a number that is not finite, or is not rigid (within
        ``RIGID_TOLERANCE``; what remains below that is rounded to the nearest rotation).
    """
    given = _arguments.numbers("tool_frame", tool_frame)
    if given.shape not in {(3,), (7,), (4, 4)}:
        raise InputError(
            f"tool_frame has shape {given.shape}; give x y z, x y z qw qx qy qz, or a 4 x 4 matrix"
        )
    if not np.all(np.isfinite(given)):
        raise InputError("tool_frame holds a number that is not finite")

    matrix = np.eye(4)
    if given.shape == (4, 4):
        _require_rigid(given)
        matrix[:3, :3] = Rotation.from_matrix(given[:3, :3]).as_matrix()
        matrix[:3, 3] = given[:3, 3]
        return matrix
    matrix[:3, 3] = given[:3]
    if given.shape == (7,):
        length = float(np.linalg.norm(given[3:]))
        if abs(length - 1) > RIGID_TOLERANCE:
            raise InputError(
                f"tool_frame's quaternion qw qx qy qz has length {length:g}; give a unit quaternion"
            )
        matrix[:3, :3] = Rotation.from_quat(given[3:], scalar_first=True).as_matrix()
    return matrix


def _require_rigid(matrix: Floats) -> None:
    if np.abs(matrix[3] - (0, 0, 0, 1)).max() > RIGID_TOLERANCE:
        row = " ".join(f"{number:g}" for number in matrix[3])
        raise InputError(f"tool_frame's last row is {row}; a homogeneous matrix ends in 0 0 0 1")
    turn = matrix[:3, :3]
    error = float(np.abs(turn.T @ turn - np.eye(3)).max())
    if error > RIGID_TOLERANCE:
        raise InputError(
            f"tool_frame's upper 3 x 3 block is not a rotation (R'R is {error:g} off the identity);"
            " give orthonormal columns"
        )
    if np.linalg.det(turn) < 0:
        raise InputError("tool_frame's upper 3 x 3 block mirrors; give right-handed axes")


def apply_tool_frame(trajectory: PoseTrajectory, tool_frame: ArrayLike) -> PoseTrajectory:
    """Turn the motion of a sensor into the motion of the tool it is mounted on.

    ``T_wb(t) = T_ws(t) T_sb`` (the paper, section "Learning elliptical excision"); hence
    ``v_b = v_s + w x (R_ws t_sb)``, and the angular velocity stays.

    Parameters
    ----------
    trajectory : PoseTrajectory
        The sensor's poses in the world frame, T_ws.
    tool_frame : array, shape (4, 4), (3,) or (7,)
        The tool's pose in the sensor's frame, T_sb, in meters; see :func:`tool_frame_matrix`.

    Raises
    ------
    InputError
        If the tool frame is none; see :func:`tool_frame_matrix`.
    """
    try:
        matrix = tool_frame_matrix(tool_frame)
    except InputError as error:
        raise InputError(f"{trajectory.name}: {error}") from None
    lever = trajectory.rotations.apply(matrix[:3, 3])
    return PoseTrajectory(
        times=trajectory.times,
        positions=trajectory.positions + lever,
        rotations=trajectory.rotations * Rotation.from_matrix(matrix[:3, :3]),
        linear_velocities=(
            trajectory.linear_velocities + np.cross(trajectory.angular_velocities, lever)
        ),
        angular_velocities=trajectory.angular_velocities,
        name=trajectory.name,
        channels=trajectory.channels,
    )


# ---------------------------------------------------------------- trimming


def trim_time(
    trajectory: Recorded, start: float | None = None, end: float | None = None
) -> Recorded:
    """Keep the samples from ``start`` to ``end``, both included.

    Parameters
    ----------
    trajectory : PoseTrajectory
    start, end : float, optional
        Seconds on the trajectory's own clock, which need not begin at zero.

    Raises
    ------
    InputError
        If a bound is not a number, or fewer than ``MINIMUM_SAMPLES`` samples remain.
    """
    for argument, bound in (("start", start), ("end", end)):
        if bound is not None and np.isnan(_arguments.number(bound)):
            raise InputError(f"{trajectory.name}: trim_time's {argument} is not a number")
    times = trajectory.times
    began = float(times[0])
    start, end = (None if t is None else on_clock(float(t), began) for t in (start, end))
    first = 0 if start is None else int(np.searchsorted(times, start, side="left"))
    stop = len(times) if end is None else int(np.searchsorted(times, end, side="right"))
    remaining = max(stop - first, 0)
    if remaining < MINIMUM_SAMPLES:
        asked = f"{'its start' if start is None else seconds(start, began)} to "
        asked += "its end" if end is None else seconds(end, began)
        raise InputError(
            f"{trajectory.name}: trim_time from {asked} leaves {remaining} samples, fewer than "
            f"{MINIMUM_SAMPLES}; the recording runs from {interval(began, times[-1], began)}"
        )
    return trajectory[first:stop]


def trim_speed(trajectory: Recorded, threshold: float) -> Recorded:
    """Keep everything from the first to the last sample that moves faster than ``threshold``.

    Rest between them stays.  The speed is that of the position, and turning on the spot counts
    as rest.  It is judged on the velocity averaged over ``SPEED_WINDOW`` seconds to either side
    with triangular weights, at whatever rate the samples come: hand tremor and the noise of a
    tracker, divided by a period of 1/120 s, would otherwise look like centimeters per second.
    Nearer than that to an end, the nearest full window speaks.

    Parameters
    ----------
    trajectory : PoseTrajectory
    threshold : float
        Meters per second.

    Raises
    ------
    InputError
        If the threshold is not positive, nothing is that fast, or fewer than
        ``MINIMUM_SAMPLES`` samples are.
    """
    threshold = _arguments.positive(f"{trajectory.name}: trim_speed", threshold, "m/s")
    speeds = _averaged_speeds(trajectory)
    moving = np.flatnonzero(speeds > threshold)
    if len(moving) == 0:
        raise InputError(
            f"{trajectory.name}: nothing moves faster than trim_speed = {threshold:g} m/s, "
            f"the top speed is {speeds.max():g} m/s; choose a lower threshold"
        )
    kept = trajectory.times[moving[[0, -1]]]
    remaining = int(moving[-1] - moving[0]) + 1
    if remaining < MINIMUM_SAMPLES:
        raise InputError(
            f"{trajectory.name}: trim_speed = {threshold:g} m/s leaves {remaining} samples "
            f"({kept[0]:g} to {kept[1]:g} s), fewer than {MINIMUM_SAMPLES}; "
            "choose a lower threshold"
        )
    return trajectory[moving[0] : moving[-1] + 1]


def _averaged_speeds(trajectory: Timed) -> Floats:
    """Norm of the velocity averaged with triangular weights, shape (N,), in m/s."""
    times = trajectory.times - trajectory.times[0]
    half = min(SPEED_WINDOW, times[-1] / 2)
    centers = np.clip(times, half, times[-1] - half)
    # Two running means of the velocity are a second difference of the position's integral.
    integral = scipy.interpolate.make_interp_spline(
        times, trajectory.positions, k=1
    ).antiderivative()
    before = integral(np.maximum(centers - half, 0))
    after = integral(np.minimum(centers + half, times[-1]))
    velocities = (after - 2 * integral(centers) + before) / half**2
    return np.asarray(np.linalg.norm(velocities, axis=1))


# ---------------------------------------------------------------- low-pass filter


def lowpass(
    trajectory: Recorded, cutoff: float = PAPER_CUTOFF, order: int = PAPER_ORDER
) -> Recorded:
    """Low-pass positions and rotations with a Butterworth filter, without delay.

    The filter H runs forwards and backwards, so a frequency f keeps about the share
    ``1 / (1 + (f / cutoff)^(2 order))`` of its amplitude (half, at the cut-off).  The ends are
    continued by their point reflection, which leaves the first and last sample where they are.

    Rotations are filtered as a curve in the tangent space: with ``b`` the developed curve of a
    motion F, ``b[k+1] = b[k] + Log(F[k+1] F[k]')``, one pass is ::

        F  <-  Exp(H(b + Log(R F')) - b) F,        begun with F = R.

    For turns about one axis ``b`` is the angle, unwrapped, and one pass gives exactly the
    filtered angle, over any number of turns.  Otherwise further passes remove what the
    curvature of SO(3) left of the high frequencies.  The filter commutes with a constant
    rotation of the world or of the body, and signs of quaternions do not enter.  Velocities of
    the result are estimated anew.

    Parameters
    ----------
    trajectory : PoseTrajectory
        Uniform samples, turning by less than half a turn from one to the next.
    cutoff : float
        Hz, below half the sampling rate.  The paper's is 4.8.
    order : int
        Of the Butterworth filter, before it is run both ways.  The paper's is 3.

    Raises
    ------
    InputError
        If the samples are not uniform, or the cut-off or the order is out of range.
    """
    name = trajectory.name
    if not trajectory.is_uniform:
        raise InputError(
            f"{name}: lowpass needs uniform samples, but their period varies from "
            f"{np.diff(trajectory.times).min():g} to {np.diff(trajectory.times).max():g} s; "
            "resample first"
        )
    rate = (len(trajectory) - 1) / trajectory.duration
    if not 0 < _arguments.number(cutoff) < HIGHEST_CUTOFF * rate / 2:
        raise InputError(
            f"{name}: lowpass cutoff must lie between 0 and {rate / 2:g} Hz, half the sampling "
            f"rate, got {cutoff} Hz; lower it or resample at a higher rate"
        )
    order = _arguments.count(f"{name}: lowpass order", order)

    zeros, poles, gain = scipy.signal.butter(order, cutoff, fs=rate, output="zpk")
    sections = scipy.signal.zpk2sos(zeros, poles, gain)
    ringing = np.log(RINGING_LEFT) / np.log(np.abs(poles).max())
    padding = _arguments.samples(f"{name}: lowpass={cutoff:g} Hz", np.ceil(np.abs(ringing)))

    def smooth(samples: Floats) -> Floats:
        # Unlike SciPy's own padding, np.pad reflects again where a short recording ends.
        padded = np.pad(samples, ((padding,) * 2, (0, 0)), mode="reflect", reflect_type="odd")
        filtered = scipy.signal.sosfiltfilt(sections, padded, axis=0, padlen=0)
        return np.asarray(filtered[padding:-padding], dtype=np.float64)

    if isinstance(trajectory, Trajectory):
        return trajectory.with_points(smooth(trajectory.values))
    return PoseTrajectory(
        times=trajectory.times,
        positions=smooth(trajectory.positions),
        rotations=_smooth_rotations(trajectory.rotations, smooth),
        name=name,
        channels=trajectory.channels,
    )


def _smooth_rotations(rotations: Rotation, smooth: Callable[[Floats], Floats]) -> Rotation:
    filtered = rotations
    for _ in range(ROTATION_PASSES):
        steps = (filtered[1:] * filtered[:-1].inv()).as_rotvec()
        developed = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
        deviation = (rotations * filtered.inv()).as_rotvec()
        filtered = Rotation.from_rotvec(smooth(developed + deviation) - developed) * filtered
    return filtered


# ---------------------------------------------------------------- origin, and all of it


def relative_to_start(trajectory: Recorded) -> Recorded:
    """Subtract the first position from all; rotations and velocities stay."""
    if isinstance(trajectory, Trajectory):
        return replace(trajectory, values=trajectory.values - trajectory.values[0])
    return PoseTrajectory(
        times=trajectory.times,
        positions=trajectory.positions - trajectory.positions[0],
        rotations=trajectory.rotations,
        linear_velocities=trajectory.linear_velocities,
        angular_velocities=trajectory.angular_velocities,
        name=trajectory.name,
        channels=trajectory.channels,
    )


Order = Literal["filter", "paper"]
"""Whether the filter or the trimming comes first."""

# prepare()'s arguments carry the names of the steps that they ask for.
_trim_time, _trim_speed, _lowpass = trim_time, trim_speed, lowpass


def prepare(
    trajectory: Recorded,
    *,
    tool_frame: ArrayLike | None = None,
    trim_time: tuple[float | None, float | None] | None = None,
    trim_speed: float | None = None,
    rate: float | None = None,
    lowpass: float | bool | None = None,
    relative: bool = False,
    order: Order = "filter",
) -> Recorded:
    """Make a demonstration of a recording, by those steps that are asked for, in this order.

    Parameters
    ----------
    trajectory : PoseTrajectory or Trajectory
        As recorded; vectors have no tool frame, and their own unit in place of meters.
    tool_frame : array, shape (4, 4), (3,) or (7,), optional
        The tool's pose in the sensor's frame, in meters (:func:`apply_tool_frame`).
    trim_time : pair of float or None, optional
        Start and end to keep, seconds on the recording's clock, or after its first sample if that
        clock had run for a day by then (:func:`trim_time`).
    trim_speed : float, optional
        Cut off the rest before and after; m/s (:func:`trim_speed`).
    rate : float, optional
        Samples per second to resample at (:meth:`PoseTrajectory.resampled`).
    lowpass : float or True, optional
        Cut-off frequency in Hz, True for the paper's 4.8 (:func:`lowpass`).  Samples that are
        not uniform are resampled at their median rate first, unless ``rate`` is given.
    relative : bool
        Begin at the origin (:func:`relative_to_start`).
    order : "filter" or "paper"
        Whether the filter sees what trimming cuts off, or only what it leaves.  The paper trims
        first: the noise of the first and the last sample then stays, and turns a tool that begins
        slowly by 10 degrees and more.

    Returns
    -------
    PoseTrajectory or Trajectory
        Of the same name.

    Warns
    -----
    RecordingWarning
        Of odd units, as :func:`noslip.load_demonstrations`.

    Raises
    ------
    InputError
        Whatever the steps raise.
    """
    if order not in get_args(Order):
        raise InputError(f"order is one of {', '.join(get_args(Order))}; got {order!r}")
    ask_after_units(trajectory)
    motion = trajectory
    if tool_frame is not None:
        if isinstance(motion, Trajectory):
            raise InputError(
                f"{motion.name}: holds vectors, which have no tool_frame; leave it out"
            )
        motion = apply_tool_frame(motion, tool_frame)
    whole = motion
    if trim_time is not None:
        try:
            start, end = trim_time
        except (TypeError, ValueError):
            raise InputError(
                f"{motion.name}: trim_time must be a pair of start and end in seconds "
                f"(None leaves one open), got {trim_time!r}"
            ) from None
        motion = _trim_time(motion, start, end)
    if trim_speed is not None:
        motion = _trim_speed(motion, trim_speed)

    cutoff = PAPER_CUTOFF if lowpass is True else None if lowpass is False else lowpass
    seen = motion if order == "paper" or cutoff is None else whole
    if rate is None and cutoff is not None and not seen.is_uniform:
        rate = 1 / motion.period
    begin, samples = motion.times[0], len(motion)
    if rate is not None:
        kept = motion.resampled(rate=rate).times
        samples = len(kept)
        before, after = (
            _arguments.samples(f"{motion.name}: rate={rate:g}", time * rate)
            for time in (begin - seen.times[0], seen.times[-1] - kept[-1])
        )
        earlier = kept[0] - np.arange(before, 0, -1) / rate
        later = kept[-1] + np.arange(1, after + 1) / rate
        seen = seen.resampled(times=np.concatenate([earlier, kept, later]))
    if cutoff is not None:
        seen = _lowpass(seen, cutoff)
    first = int(np.argmin(np.abs(seen.times - begin)))
    motion = seen[first : first + samples]
    return as_asked(relative_to_start(motion) if relative else motion)
