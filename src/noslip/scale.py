"""What a recording's numbers say of its units, and whether anything can be learned from it."""

from __future__ import annotations

from typing import TypeVar

import numpy as np

from noslip._instants import seconds
from noslip._pose_names import SECONDS, SPARSEST
from noslip._typing import Floats
from noslip.errors import InputError, RecordingError, RecordingWarning, warn
from noslip.trajectory import PoseTrajectory
from noslip.vectors import Trajectory

Recording = PoseTrajectory | Trajectory
"""Of a tool, or of other coordinates."""
T = TypeVar("T", PoseTrajectory, Trajectory)

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
MOST_TURN = 2 * np.pi / 3
"""Radians from one sample to the next: with fewer than three samples a turn, nothing says which way
round it went."""
STILL = 1e-9
"""Meters and radians below which nothing moves: no tracker resolves it."""


def ask_after_units(recording: Recording, *, clock_said: bool | None = None) -> None:
    """Warn of a recording that is hardly in seconds, meters and radians; once of each.

    Of vectors that are no position it is the seconds alone.  Where the file could have stated the
    unit of its times and did not, they are refused instead; where it did, they are believed.

    Raises
    ------
    InputError
        If ``clock_said`` is False, and the times are hardly seconds.
    """
    # Not a field: what is derived from it is another recording, and is asked after anew.
    if not vars(recording).get("_asked"):
        object.__setattr__(recording, "_asked", True)
        doubt = clock_doubt(recording, clock_said)
        if doubt and clock_said is False:
            raise RecordingError(f"{recording.name}: {doubt}; {_remedy(recording)}")
        if clock_said or not doubt:
            doubt = _doubt(recording)
        if doubt:
            warn(f"{recording.name}: {doubt}", RecordingWarning)


def as_asked(recording: T) -> T:
    """Return a recording made from one whose units were asked after: they are the same."""
    object.__setattr__(recording, "_asked", True)
    return recording


def require_motion(recording: Recording) -> None:
    """Refuse a recording that stands still, or turns too far between samples; ask after its units.

    Raises
    ------
    InputError
        Naming the recording, and the sample where it turns by more than ``MOST_TURN``.
    """
    turns = _turns(recording)
    if np.ptp(recording.positions, axis=0).max() < STILL and turns.sum() < STILL:
        raise InputError(f"{recording.name}: does not move; give a recording of a motion")
    if turns.max(initial=0.0) > MOST_TURN:
        step = int(turns.argmax())
        raise InputError(
            f"{recording.name}: turns by {np.degrees(turns[step]):.0f} degrees from sample {step} "
            f"to {step + 1} ({seconds(recording.times[step], recording.times[0])}), so that "
            "nothing says which way round; record at a higher rate, or correct the rotation there"
        )
    ask_after_units(recording)


def _turns(recording: Recording) -> Floats:
    """Radians of each step."""
    _, angular = recording.step_velocities()
    return np.asarray(np.linalg.norm(angular, axis=1) * np.diff(recording.times))


def clock_doubt(recording: Recording, said: bool | None = None) -> str:
    """Return what speaks against seconds; empty if nothing does."""
    latest, at = np.abs(recording.times).max(), ""
    # What other numbers do in a second nobody knows, but where a file could have said what it is.
    slow = said is False
    if recording.unit == "m":
        turning = _turns(recording).sum() / recording.duration
        speed = recording.path_length / recording.duration
        slow = speed < FASTEST / 1000 and turning < FASTEST_TURN / 1000
        at = f", at {speed * 1e3:.2g} mm/s"
    times = "are its times in other units than seconds?"
    if latest > LATEST:
        return f"has stamps of {latest:.3g} s; {times}"
    if recording.duration > LONGEST:
        return f"lasts {recording.duration:.3g} s; {times}"
    if recording.period >= SPARSEST and slow:
        return f"is sampled every {recording.period:.3g} s{at}; {times}"
    return ""


def _remedy(recording: Recording) -> str:
    """Return how to say in which unit the times are, with the one that is likely."""
    likely = next((u for u in ("ms", "us") if recording.period / SECONDS[u] < SPARSEST), "ns")
    return (
        f"say which, units={likely!r} (--time-unit {likely}), or units='s' (--time-unit s) if they "
        "are seconds"
    )


def _doubt(recording: Recording) -> str:
    """Return what speaks against meters and radians; empty if nothing does."""
    # Of joints and the like, nothing says how far and how fast they go.
    if recording.unit != "m":
        return ""
    size = np.ptp(recording.positions, axis=0).max()
    speed = recording.path_length / recording.duration
    turning = _turns(recording).sum() / recording.duration
    if speed > FASTEST:
        return f"moves at {speed:.3g} m/s; are its positions in other units than meters?"
    if size > LARGEST:
        return f"is {size:.3g} m across; are its positions in other units than meters?"
    if turning > FASTEST_TURN:
        return f"turns at {turning:.3g} rad/s; are its angles in other units than radians?"
    return ""
