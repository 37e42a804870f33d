"""Synthetic recordings of an elliptical excision, in place of the paper's, which are not public.

Modelled on Straižys, Burke and Ramamoorthy, "Learning robotic cutting from demonstration",
section "Learning elliptical excision": eight cuts along a parabola, recorded at 120 Hz by an
electromagnetic sensor mounted on the scalpel.  **No person moved here.**  The paper gives the
rate, the mounting of the sensor, the shape of the path and the size and sign of the lateral
motion; everything else is a plausible guess.  The cuts come one by one, or as the one recording of
a session, in which the scalpel is brought to the first, lifted from each to the next, and put away.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from noslip import _arguments
from noslip._typing import Floats
from noslip.errors import InputError
from noslip.trajectory import PoseTrajectory

TOOL_FRAME: Floats = np.array(
    [
        [1.0, 0.0, 0.0, 0.052],
        [0.0, 1.0, 0.0, 0.0],
        [0.0, 0.0, 1.0, 0.013],
        [0.0, 0.0, 0.0, 1.0],
    ]
)
"""The blade's pose in the sensor's frame, T_sb of the paper, in meters."""
TOOL_FRAME.flags.writeable = False

RATE = 120.0
"""Samples per second of the tracker."""
PHANTOM = np.array([0.32, -0.14, 0.06])
"""Where the cuts begin, seen from the tracker's base (m)."""
TREMOR_BAND = (8.0, 12.0)
"""Physiological hand tremor (Hz)."""
TREMOR_POSITION = 0.06e-3
"""Rms of the tremor at the blade, each axis (m): 0.1 mm in all."""
TREMOR_ROTATION = np.radians(0.1)
"""Rms of the tremor's rotation, each axis (rad)."""
TREMOR_SINES = 16
"""Sine waves that make the tremor up."""
NOISE_POSITION = 0.04e-3
"""Rms of the tracker's white noise, each axis (m)."""
NOISE_ROTATION = np.radians(0.03)
"""Rms of the tracker's white noise, each axis (rad)."""
OUTLIER = 5
"""One cut in eight, the sixth, is held in a clearly different way."""
PARKED = np.array([-0.06, -0.08, 0.05])
"""From the first cut to where the scalpel waits before and after a session (m)."""
PARKED_FOR = 0.6, 1.0
"""Seconds before the first transfer, and after the last."""
TRANSFER = 0.7, 1.4
"""Seconds of a transfer: some 5 to 12 cm, with peaks of 0.1 to 0.3 m/s, as free hands move.  Less
than half of the shortest cut, by which :func:`noslip.segment` tells them apart."""
LIFT = 15e-3, 25e-3
"""Above the straight way, halfway through a transfer (m)."""
SESSION = 1
"""Tells a session's random numbers from those of the cuts in it."""

Poses = tuple[Floats, Rotation]
"""Positions (m), shape (N, 3), and rotations."""


@dataclass(frozen=True, kw_only=True)
class _Excision:
    """What differs from one cut to the next.  Lengths in meters, times in seconds, radians."""

    begin: float
    """Time of the first sample."""
    rest_before: float
    duration: float
    rest_after: float
    skew: float
    """Positive: the speed peaks late."""
    origin: Floats
    heading: float
    """Of the parabola's chord in the world."""
    length: float
    height: float
    depth: float
    """Of the cut at the parabola's peak."""
    yaw_bias: Floats
    """Of the blade against the path: throughout, and added at the peak."""
    pitch: Floats
    roll: Floats
    """Pitch and roll: mean, change towards the peak, change from the first half to the second."""


def synthetic_excisions(*, seed: int = 7, count: int = 8) -> list[PoseTrajectory]:
    """Return synthetic sensor recordings of an elliptical excision, plainly no real ones.

    A hand guides a scalpel along a parabola of 4 to 5 cm by 1.5 to 2 cm, a few millimeters deep,
    within 3 to 6 s, with rest before and after.  The blade's x axis lags behind the path's
    tangent, by most (10 to 30 degrees) around the peak, so that the blade slips along its own
    +y, as the paper reports.  Hand tremor and the tracker's noise are added.  One cut in eight
    is an outlier: rolled far to the side.

    The poses are those of the *sensor*, at 120 Hz, in the frame of the tracker's base; times do
    not begin at zero.  The blade's motion comes out of
    ``prepare(recording, tool_frame=TOOL_FRAME, trim_speed=0.005, lowpass=True, relative=True)``.

    Parameters
    ----------
    seed : int
        Not negative.  The same seed gives the same recordings, whatever their number.
    count : int
        How many.

    Returns
    -------
    list of PoseTrajectory
        Named "synthetic excision 1" and so on.

    Raises
    ------
    InputError
        If the seed is negative or the count is not positive.
    """
    rngs, excisions = _drawn("synthetic_excisions", seed, count)
    return [
        _record(excision, rng, name=f"synthetic excision {number}")
        for number, (excision, rng) in enumerate(zip(excisions, rngs, strict=True), start=1)
    ]


@dataclass(frozen=True, eq=False)
class Session:
    """One recording of several cuts, and when the blade truly moves along each.

    Attributes
    ----------
    recording : PoseTrajectory
        Poses of the sensor.
    cuts : array, shape (n, 2)
        Start and end of each (s), on the recording's clock.
    """

    recording: PoseTrajectory
    cuts: Floats


def synthetic_session(*, seed: int = 7, count: int = 8) -> Session:
    """Return the cuts of :func:`synthetic_excisions` as one recording, made one after another.

    The scalpel waits, is brought to the first cut, and cuts, with the rest before and after that
    each has; then it is lifted to where the next begins, in about a second and turned on the way,
    and so on, and put back.  Tremor and the tracker's noise are there throughout, others than
    those of the single recordings.  Positions are the sensor's, at 120 Hz.

    Parameters
    ----------
    seed : int
        Not negative.
    count : int
        How many cuts.

    Raises
    ------
    InputError
        If the seed is negative or the count is not positive.
    """
    _, excisions = _drawn("synthetic_session", seed, count)
    rng = np.random.default_rng([seed, len(excisions), SESSION])
    held = [_held(excision, _since(excision)) for excision in excisions]
    parked = held[0][0][:1] + PARKED, held[0][1][:1]
    stops = [parked, *held, parked]
    waits = [int(rng.uniform(*PARKED_FOR) * RATE) for _ in range(2)]

    parts, begins, samples = [_still(parked, waits[0])], [], waits[0]
    for here, there in pairwise(stops):
        parts += [_transfer(here, there, rng), there]
        samples += len(parts[-2][0])
        begins.append(samples)
        samples += len(there[0])
    parts.append(_still(parked, waits[1]))

    positions = np.concatenate([part[0] for part in parts])
    rotations = Rotation.concatenate([part[1] for part in parts])
    times = excisions[0].begin + np.arange(len(positions)) / RATE
    starts = times[begins[:-1]] + [excision.rest_before for excision in excisions]
    return Session(
        recording=_sensed(times, (positions, rotations), rng, name="synthetic session"),
        cuts=np.column_stack([starts, starts + [excision.duration for excision in excisions]]),
    )


def _still(pose: Poses, samples: int) -> Poses:
    return np.repeat(pose[0], samples, axis=0), Rotation.concatenate([pose[1]] * samples)


def _transfer(here: Poses, there: Poses, rng: np.random.Generator) -> Poses:
    """From the last pose of one to the first of another, both left out, in an arc from above."""
    u = np.linspace(0, 1, int(rng.uniform(*TRANSFER) * RATE) + 2)[1:-1]
    share = _minimum_jerk(u)
    bell = 16 * (share * (1 - share)) ** 2
    begin, end = here[0][-1], there[0][0]
    lifted = np.outer(rng.uniform(*LIFT) * bell, [0, 0, 1])
    turns = Slerp([0, 1], Rotation.concatenate([here[1][-1], there[1][0]]))
    return begin + np.outer(share, end - begin) + lifted, turns(share)


def _drawn(who: str, seed: int, count: int) -> tuple[list[np.random.Generator], list[_Excision]]:
    """Excisions, and the random numbers that are left for the noise of each."""
    count = _arguments.count(f"{who}: count", count)
    if not (_arguments.number(seed) >= 0 and int(seed) == seed):
        raise InputError(f"{who}: seed must be a whole number, 0 or more, got {seed}")
    rngs = [np.random.default_rng([seed, number]) for number in range(count)]
    return rngs, [_draw(rng, outlier=k % 8 == OUTLIER) for k, rng in enumerate(rngs)]


def _draw(rng: np.random.Generator, *, outlier: bool) -> _Excision:
    def degrees(*spans: tuple[float, float]) -> Floats:
        return np.radians([rng.uniform(*span) for span in spans])

    return _Excision(
        begin=rng.uniform(2.0, 30.0),
        rest_before=rng.uniform(0.3, 0.5),
        duration=rng.uniform(3.0, 6.0),
        rest_after=rng.uniform(0.3, 0.5),
        skew=rng.uniform(-0.1, 0.2),
        origin=PHANTOM + rng.uniform(-5e-3, 5e-3, size=3),
        heading=float(degrees((-5, 5))[0]),
        length=rng.uniform(40e-3, 50e-3),
        height=rng.uniform(15e-3, 20e-3),
        depth=rng.uniform(2e-3, 4e-3),
        yaw_bias=degrees((0, 4), (10, 26)),
        pitch=degrees((25, 35), (-8, -2), (-3, 3)),
        roll=degrees((28, 34) if outlier else (-3, 5), (-4, 4), (-3, 3)),
    )


def _record(excision: _Excision, rng: np.random.Generator, *, name: str) -> PoseTrajectory:
    since = _since(excision)
    return _sensed(excision.begin + since, _held(excision, since), rng, name=name)


def _since(excision: _Excision) -> Floats:
    """Seconds since the first sample, of all samples."""
    lasting = excision.rest_before + excision.duration + excision.rest_after
    return np.arange(int(lasting * RATE) + 1) / RATE


def _held(excision: _Excision, since: Floats) -> Poses:
    """The blade's poses, without tremor."""
    share = _path_share(excision, (since - excision.rest_before) / excision.duration)
    return _path(excision, share), _hold(excision, share)


def _sensed(times: Floats, blade: Poses, rng: np.random.Generator, *, name: str) -> PoseTrajectory:
    """What the sensor sees of a trembling hand that leads the blade."""
    positions, rotations = blade
    since = times - times[0]
    positions = positions + TREMOR_POSITION * _tremor(rng, since)
    rotations = Rotation.from_rotvec(TREMOR_ROTATION * _tremor(rng, since)) * rotations

    # T_ws = T_wb T_sb^-1.  The copy is for SciPy 1.17, whose rotations reject read-only arrays.
    mounting = TOOL_FRAME.copy()
    rotations = rotations * Rotation.from_matrix(mounting[:3, :3]).inv()
    positions = positions - rotations.apply(mounting[:3, 3])
    positions = positions + NOISE_POSITION * rng.standard_normal(positions.shape)
    noise = Rotation.from_rotvec(NOISE_ROTATION * rng.standard_normal(positions.shape))
    return PoseTrajectory(times=times, positions=positions, rotations=noise * rotations, name=name)


def _path_share(excision: _Excision, progress: Floats) -> Floats:
    """Where along the chord (0 to 1) the blade is: along the path, a minimum-jerk motion."""
    chord = np.linspace(0, 1, 501)
    steps = np.linalg.norm(np.diff(_path(excision, chord), axis=0), axis=1)
    traveled = np.concatenate([[0.0], np.cumsum(steps)])
    u = np.clip(progress, 0, 1)
    u = u - excision.skew * u * (1 - u)
    share: Floats = np.interp(_minimum_jerk(u) * traveled[-1], traveled, chord)
    return share


def _minimum_jerk(u: Floats) -> Floats:
    """Share of the way at a share of the time."""
    share: Floats = u**3 * (10 - 15 * u + 6 * u**2)
    return share


def _path(excision: _Excision, share: Floats) -> Floats:
    """Blade positions in the world frame, shape (N, 3)."""
    bow = 4 * share * (1 - share)
    flat = np.column_stack(
        [excision.length * share, excision.height * bow, -excision.depth * bow**2]
    )
    turned: Floats = Rotation.from_euler("z", excision.heading).apply(flat)
    return excision.origin + turned


def _hold(excision: _Excision, share: Floats) -> Rotation:
    """Blade rotations: roll, pitch and yaw about the world's axes, in this order."""
    towards_peak = np.sin(np.pi * share) ** 2
    halves = np.sin(2 * np.pi * share)

    slope = excision.height * 4 * (1 - 2 * share) / excision.length
    bias = excision.yaw_bias[0] + excision.yaw_bias[1] * towards_peak
    yaw = excision.heading + np.arctan(slope) - bias
    pitch, roll = (
        angle[0] + angle[1] * towards_peak + angle[2] * halves
        for angle in (excision.pitch, excision.roll)
    )
    return Rotation.from_euler("xyz", np.column_stack([roll, pitch, yaw]))


def _tremor(rng: np.random.Generator, times: Floats) -> Floats:
    """Three axes of band-limited tremor with unit rms, shape (N, 3)."""
    frequencies = rng.uniform(*TREMOR_BAND, size=(TREMOR_SINES, 1, 3))
    phases = rng.uniform(0, 2 * np.pi, size=(TREMOR_SINES, 1, 3))
    waves = np.sin(2 * np.pi * frequencies * times[:, None] + phases)
    return np.asarray(waves.sum(axis=0) * np.sqrt(2 / TREMOR_SINES))
