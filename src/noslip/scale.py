"""What a recording's numbers say of its units, and whether anything can be learned from it."""

from __future__ import annotations

import numpy as np

from noslip._typing import Floats
from noslip.errors import InputError, RecordingWarning, warn
from noslip.trajectory import PoseTrajectory

LATEST = 1e11
"""Stamps beyond this (s) lie 3000 years ahead; those since 1970 in milliseconds are beyond it."""
LONGEST = 86400.0
"""No hand and no arm works at one motion for more than a day (s)."""
LARGEST = 1000.0
"""Nor further than a kilometer (m): a meter, in millimeters."""
FASTEST = 5.0
"""Nor at a faster mean speed (m/s): a hand throws at it, and holds it for a moment."""
FASTEST_TURN = 20.0
"""Nor turns faster all the time (rad/s): three turns a second."""
SPARSEST = 0.5
"""Seconds between samples.  Slower recorders exist, of slow processes; but where a motion is also
slower than a thousandth of the fastest, it is likely in milliseconds, at up to 2 kHz."""
MOST_TURN = 2 * np.pi / 3
"""Radians from one sample to the next: with fewer than three samples a turn, nothing says which way
round it went."""
STILL = 1e-9
"""Meters and radians below which nothing moves: no tracker resolves it."""


def ask_after_units(recording: PoseTrajectory) -> None:
    """Warn of a recording that is hardly in seconds, meters and radians; once of each."""
    # Not a field: what is derived from it is another recording, and is asked after anew.
    if not vars(recording).get("_asked"):
        object.__setattr__(recording, "_asked", True)
        if doubt := _doubt(recording):
            warn(f"{recording.name}: {doubt}", RecordingWarning)


def as_asked(recording: PoseTrajectory) -> PoseTrajectory:
    """Return a recording made from one whose units were asked after: they are the same."""
    object.__setattr__(recording, "_asked", True)
    return recording


def require_motion(recording: PoseTrajectory) -> None:
    """Refuse a recording that stands still, or turns too far between samples; ask after its units.

    Raises
    ------
    InputError
        Naming the recording, and the sample where it turns by more than ``MOST_TURN``.
    """
    turns = _turns(recording)
    if np.ptp(recording.positions, axis=0).max() < STILL and turns.sum() < STILL:
        raise InputError(f"{recording.name}: does not move; give a recording of a motion")
    if turns.max() > MOST_TURN:
        step = int(turns.argmax())
        raise InputError(
            f"{recording.name}: turns by {np.degrees(turns[step]):.0f} degrees from sample {step} "
            f"to {step + 1} ({recording.times[step]:.6g} s), so that nothing says which way "
            "round; record at a higher rate, or correct the rotation there"
        )
    ask_after_units(recording)


def _turns(recording: PoseTrajectory) -> Floats:
    """Radians of each step."""
    _, angular = recording.step_velocities()
    return np.asarray(np.linalg.norm(angular, axis=1) * np.diff(recording.times))


def _doubt(recording: PoseTrajectory) -> str:
    """What speaks against seconds, meters and radians; empty if nothing does."""
    latest, size = np.abs(recording.times).max(), np.ptp(recording.positions, axis=0).max()
    speed = recording.path_length / recording.duration
    turning = _turns(recording).sum() / recording.duration
    slow = speed < FASTEST / 1000 and turning < FASTEST_TURN / 1000
    units = "are its {} in other units than {}?"
    times, positions = units.format("times", "seconds"), units.format("positions", "meters")
    if latest > LATEST:
        return f"has stamps of {latest:.3g} s; {times}"
    if recording.duration > LONGEST:
        return f"lasts {recording.duration:.3g} s; {times}"
    if recording.period >= SPARSEST and slow:
        return f"is sampled every {recording.period:.3g} s, at {speed * 1e3:.2g} mm/s; {times}"
    if speed > FASTEST:
        return f"moves at {speed:.3g} m/s; {positions}"
    if size > LARGEST:
        return f"is {size:.3g} m across; {positions}"
    if turning > FASTEST_TURN:
        return f"turns at {turning:.3g} rad/s; {units.format('angles', 'radians')}"
    return ""
