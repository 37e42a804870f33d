"""From one long recording to its demonstrations: cut at rests, by contact, or at given times."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from noslip import _arguments
from noslip._instants import seconds
from noslip._pose_checks import MINIMUM_SAMPLES
from noslip._typing import Floats
from noslip._values import Value
from noslip.demonstrations.preparation import _averaged_speeds, trim_time
from noslip.errors import InputError
from noslip.scale import require_motion
from noslip.trajectory import PoseTrajectory

Contact = Literal["above", "below"]

MINIMUM_REST = 0.2
"""Seconds below the threshold that part two pieces by default."""
SHORT = 0.5
"""Share of the typical duration below which a piece is dropped by default."""
QUIETEST = 0.01
"""Share of a recording's time that is taken to be rest, to learn the noise from."""
ABOVE_NOISE = 3.0
"""Lower threshold over the median speed at rest; of white noise, 1 sample in 10 000 is faster."""
HYSTERESIS = 3.0
"""Upper threshold of the speed over the lower, where the noise leaves room for it."""
LEAST_HYSTERESIS = 1.5
"""Below this no rest stands out of the noise."""
LEAST_SPEED = 0.02
"""Lower threshold over the median speed in motion, at least: a rest may be free of noise."""
STANDS_OUT = 0.5
"""Share of the median speed in motion that the upper threshold may reach."""
CONTACT_LEVELS = (0.25, 0.5)
"""Thresholds of a contact signal, from its level without contact (0) to that in contact (1)."""


@dataclass(frozen=True)
class Interval:
    """A stretch of a recording, and what became of it.

    Attributes
    ----------
    start, end : float
        Times of its first and last sample (s), on the recording's clock.  Where a piece begins,
        the stretch before it ends.
    reason : str or None
        Why it was cut out; None of a piece that was kept.
    """

    start: float
    end: float
    reason: str | None = None

    @property
    def duration(self) -> float:
        """Seconds."""
        return self.end - self.start


@dataclass(frozen=True, eq=False)
class Segments(Value):
    """The pieces of a recording, what was cut out and why, and by what it was judged.

    Attributes
    ----------
    recording : PoseTrajectory
        The whole of it.
    pieces : tuple of PoseTrajectory
        Its samples as recorded, times included; named after it and numbered from 1.
    intervals : tuple of Interval
        From the recording's start to its end without a hole; those kept are the pieces, in order.
    quantity : "speed", "contact" or "times"
        What it was cut by.
    signal : array, shape (N,), or None
        That quantity at the recording's samples: the speed averaged as :func:`trim_speed` does
        (m/s), or the contact signal in its own unit.  None of given times.
    thresholds : pair of float, or None
        Lower and upper threshold of the signal; None of given times, and of a recording in which
        no rest stands out, which is one piece.
    in_contact : "above" or "below"
        On which side of the thresholds the pieces lie.
    minimum_duration : float
        Seconds below which a piece was dropped.
    """

    recording: PoseTrajectory
    pieces: tuple[PoseTrajectory, ...]
    intervals: tuple[Interval, ...]
    quantity: Literal["speed", "contact", "times"]
    signal: Floats | None = None
    thresholds: tuple[float, float] | None = None
    in_contact: Contact = "above"
    minimum_duration: float = 0.0

    def without(self, reasons: Mapping[int, str]) -> Segments:
        """Cut out some of the pieces as well; those that stay are numbered anew.

        Parameters
        ----------
        reasons : mapping of int to str
            Why, by the piece's number counted from 0.
        """
        if strangers := [i for i in reasons if not 0 <= i < len(self.pieces)]:
            raise InputError(
                f"{self.recording.name}: there is no piece {strangers[0]}, only {len(self.pieces)}"
            )
        kept = [k for k, interval in enumerate(self.intervals) if interval.reason is None]
        intervals = list(self.intervals)
        for i, reason in reasons.items():
            intervals[kept[i]] = replace(intervals[kept[i]], reason=reason)
        staying = (p for i, p in enumerate(self.pieces) if i not in reasons)
        return replace(
            self, pieces=_numbered(self.recording.name, staying), intervals=tuple(intervals)
        )


def segment(
    recording: PoseTrajectory,
    *,
    contact: ArrayLike | None = None,
    in_contact: Contact = "above",
    times: Iterable[tuple[float | None, float | None]] | None = None,
    thresholds: tuple[float, float] | None = None,
    minimum_duration: float | None = None,
    minimum_rest: float = MINIMUM_REST,
) -> Segments:
    """Cut a long recording into demonstrations, at its rests unless told otherwise.

    A piece begins and ends where the signal crosses the lower threshold, and counts only if it
    reaches the upper one in between; what interrupts it for less than ``minimum_rest`` belongs to
    it.  The signal is the speed of the position, averaged as by :func:`trim_speed`, so that turning
    on the spot counts as rest; or ``contact``.

    Left out, the thresholds come from the recording itself.  Of the speed: three times the median
    speed of its quietest stretches (at least 2 % of the median speed in motion), and three times
    that.  Where no rest stands out in this way, the recording is one piece.  Of a contact signal: a
    quarter and half of the way from its level without contact to that in contact.

    Pieces that last less than ``minimum_duration`` are cut out too, as the approach from the end of
    one cut to the start of the next mostly does: by default, less than half as long as the piece
    that holds the median instant of all motion.

    Prepare the recording first (tool frame, rate, low-pass): the filter then sees the rest around
    each piece.

    Parameters
    ----------
    recording : PoseTrajectory
        Any rate, any start time.
    contact : array, shape (N,), optional
        Cut by this instead, at the recording's samples: a component of the wrench, or a height
        such as ``recording.positions @ normal``.
    in_contact : "above" or "below"
        On which side of the thresholds contact is; "below" for a height.
    times : iterable of pairs of float or None, optional
        Or start and end of each piece (s) on the recording's clock, None for the recording's own.
    thresholds : pair of float, optional
        Of the speed (m/s) or of the contact signal (its unit), in either order.
    minimum_duration : float, optional
        Seconds; 0 keeps all.  Not for given times.
    minimum_rest : float
        Seconds.

    Returns
    -------
    Segments

    Raises
    ------
    InputError
        If an argument is not what it must be, nothing moves or touches, no piece is left, or given
        times overlap or hold fewer than 8 samples.
    """
    name = recording.name
    require_motion(recording)
    if in_contact not in ("above", "below"):
        raise InputError(f"{name}: in_contact must be 'above' or 'below', got {in_contact!r}")
    minimum_rest = _arguments.not_negative(f"{name}: minimum_rest", minimum_rest)
    if minimum_duration is not None:
        what = f"{name}: minimum_duration"
        minimum_duration = _arguments.not_negative(what, minimum_duration)
    if thresholds is not None:
        thresholds = _pair(name, thresholds)
    if times is not None:
        for argument, given in {
            "contact": contact,
            "thresholds": thresholds,
            "minimum_duration": minimum_duration,
        }.items():
            if given is not None:
                raise InputError(f"{name}: {argument} says nothing about given times; leave it out")
        return _at_times(recording, times)
    if contact is not None:
        signal = _contact_signal(recording, contact)
        chosen = thresholds or _contact_thresholds(name, signal, in_contact)
        found = _active(recording, signal, chosen, in_contact, minimum_rest)
        return _cut(
            recording, "contact", signal, chosen, found, minimum_duration, in_contact=in_contact
        )

    if thresholds is not None and thresholds[0] <= 0:
        raise InputError(
            f"{name}: thresholds of the speed must be positive (m/s), got {thresholds}"
        )
    speeds = _averaged_speeds(recording)
    if not speeds.max() > 0:
        raise InputError(f"{name}: only turns on the spot; cut it by contact or at given times")
    level = thresholds or _speed_thresholds(recording, speeds, minimum_rest)
    whole = [(0, len(recording) - 1)]
    found = _active(recording, speeds, level, "above", minimum_rest) if level else whole
    return _cut(recording, "speed", speeds, level, found, minimum_duration)


# ---------------------------------------------------------------- thresholds


def _pair(name: str, thresholds: tuple[float, float]) -> tuple[float, float]:
    try:
        low, high = sorted(map(_arguments.number, thresholds))
    except (TypeError, ValueError):
        low = high = np.nan
    if not (np.isfinite(low) and np.isfinite(high)):
        raise InputError(f"{name}: thresholds must be two finite numbers, got {thresholds!r}")
    return low, high


def _speed_thresholds(
    recording: PoseTrajectory, speeds: Floats, minimum_rest: float
) -> tuple[float, float] | None:
    """Lower and upper threshold from the noise at rest; None where no rest stands out."""
    # The fastest sample around each tells a rest from a moment in which the tool turns back.
    window = int(np.clip(round(minimum_rest / recording.period), 1, len(speeds)))
    around = scipy.ndimage.maximum_filter1d(speeds, window)
    quiet = around <= ABOVE_NOISE * np.quantile(around, QUIETEST)
    low = ABOVE_NOISE * float(np.median(speeds[quiet]))
    moving = speeds[speeds > low]
    if not len(moving):
        return None
    typical = float(np.median(moving))
    low = max(low, LEAST_SPEED * typical)
    high = min(HYSTERESIS * low, STANDS_OUT * typical)
    return (low, high) if high >= LEAST_HYSTERESIS * low else None


def _contact_signal(recording: PoseTrajectory, contact: ArrayLike) -> Floats:
    signal = _arguments.numbers(f"{recording.name}: contact", contact)
    if signal.shape != (len(recording),):
        raise InputError(
            f"{recording.name}: contact has shape {signal.shape}, expected one number a sample, "
            f"({len(recording)},)"
        )
    if not np.all(np.isfinite(signal)):
        row = int(np.argmin(np.isfinite(signal)))
        raise InputError(f"{recording.name}: contact[{row}] is not finite")
    signal.flags.writeable = False
    return signal


def _contact_thresholds(name: str, signal: Floats, in_contact: Contact) -> tuple[float, float]:
    """Thresholds between the two levels of a signal: medians of two clusters, till they stay."""
    border = float(signal.min() + np.ptp(signal) / 2)
    for _ in range(100):
        upper = signal > border
        if not upper.any() or upper.all():
            break
        levels = float(np.median(signal[~upper])), float(np.median(signal[upper]))
        if border == sum(levels) / 2:
            break
        border = sum(levels) / 2
    if not upper.any() or upper.all():
        raise InputError(
            f"{name}: contact is {signal[0]:g} throughout; it does not tell contact from none"
        )
    apart = levels if in_contact == "above" else levels[::-1]
    low, high = sorted(apart[0] + share * (apart[1] - apart[0]) for share in CONTACT_LEVELS)
    return low, high


# ---------------------------------------------------------------- intervals

Span = tuple[int, int]
"""First and last sample."""


def _active(
    recording: PoseTrajectory,
    signal: Floats,
    thresholds: tuple[float, float],
    in_contact: Contact,
    minimum_rest: float,
) -> list[Span]:
    """Spans beyond the outer threshold that reach the inner one, joined over short gaps."""
    outer, inner = thresholds
    inward = signal
    if in_contact == "below":
        inward, outer, inner = -signal, -inner, -outer
    spans = [(a, b) for a, b in _runs(inward > outer) if inward[a : b + 1].max() > inner]
    if not spans:
        raise InputError(
            f"{recording.name}: nothing lies {in_contact} the thresholds {thresholds[0]:g} and "
            f"{thresholds[1]:g}; the signal runs from {signal.min():g} to {signal.max():g}; "
            "choose others"
        )
    joined = [spans[0]]
    for span in spans[1:]:
        if recording.times[span[0]] - recording.times[joined[-1][1]] < minimum_rest:
            joined[-1] = joined[-1][0], span[1]
        else:
            joined.append(span)
    return joined


def _runs(wanted: NDArray[np.bool_]) -> list[Span]:
    edges = np.diff(np.concatenate([[0], wanted.astype(int), [0]]))
    return [
        (int(a), int(b) - 1)
        for a, b in zip(np.flatnonzero(edges > 0), np.flatnonzero(edges < 0), strict=True)
    ]


def _cut(
    recording: PoseTrajectory,
    quantity: Literal["speed", "contact"],
    signal: Floats,
    thresholds: tuple[float, float] | None,
    spans: list[Span],
    minimum_duration: float | None,
    *,
    in_contact: Contact = "above",
) -> Segments:
    times = recording.times
    durations = np.array([times[b] - times[a] for a, b in spans])
    least = SHORT * _typical(durations) if minimum_duration is None else minimum_duration
    judged = []
    for (a, b), duration in zip(spans, durations, strict=True):
        reason = None
        if duration < least:
            reason = f"lasts {duration:.3g} s, less than {least:.3g} s"
        elif b - a + 1 < MINIMUM_SAMPLES:
            reason = f"{b - a + 1} samples, fewer than {MINIMUM_SAMPLES}"
        judged.append((a, b, reason))
    if all(reason for *_, reason in judged):
        raise InputError(
            f"{recording.name}: no piece is left, the longest lasts {durations.max():.3g} s; "
            f"lower minimum_duration ({least:.3g} s) or the thresholds"
        )
    between = "rest" if quantity == "speed" else "no contact"
    return Segments(
        recording=recording,
        pieces=_pieces(recording, [(a, b) for a, b, reason in judged if reason is None]),
        intervals=_tiled(recording, judged, between),
        quantity=quantity,
        signal=signal,
        thresholds=thresholds,
        in_contact=in_contact,
        minimum_duration=float(least),
    )


def _typical(durations: Floats) -> float:
    """Duration of the piece that holds the median instant, the pieces sorted by duration."""
    longest_first = np.sort(durations)[::-1]
    reached = np.cumsum(longest_first)
    return float(longest_first[np.searchsorted(reached, reached[-1] / 2)])


def _at_times(
    recording: PoseTrajectory, given: Iterable[tuple[float | None, float | None]]
) -> Segments:
    try:
        pairs = [(start, end) for start, end in given]
    except (TypeError, ValueError):
        raise InputError(f"{recording.name}: times must be pairs of start and end (s)") from None
    if not pairs:
        raise InputError(f"{recording.name}: times holds no piece; give start and end of each")
    spans = []
    for start, end in pairs:
        kept = trim_time(recording, start, end)
        first, last = np.searchsorted(recording.times, kept.times[[0, -1]])
        spans.append((int(first), int(last)))
    spans.sort()
    for (_, before), (after, _) in pairwise(spans):
        if after < before:
            raise InputError(
                f"{recording.name}: times overlap: a piece begins at "
                f"{seconds(recording.times[after], recording.times[0])}, before the last one ends "
                f"at {seconds(recording.times[before], recording.times[0])}"
            )
    return Segments(
        recording=recording,
        pieces=_pieces(recording, spans),
        intervals=_tiled(recording, [(a, b, None) for a, b in spans], "not asked for"),
        quantity="times",
    )


def _pieces(recording: PoseTrajectory, spans: list[Span]) -> tuple[PoseTrajectory, ...]:
    return _numbered(recording.name, (recording[a : b + 1] for a, b in spans))


def _numbered(name: str, pieces: Iterable[PoseTrajectory]) -> tuple[PoseTrajectory, ...]:
    return tuple(
        replace(piece, name=f"{name}, piece {number}")
        for number, piece in enumerate(pieces, start=1)
    )


def _tiled(
    recording: PoseTrajectory, judged: list[tuple[int, int, str | None]], between: str
) -> tuple[Interval, ...]:
    """Intervals from the first sample to the last, the stretches between them included."""
    times = recording.times
    intervals, reached = [], float(times[0])
    for a, b, reason in judged:
        start, end = float(times[a]), float(times[b])
        if start > reached:
            intervals.append(Interval(reached, start, between))
        intervals.append(Interval(start, end, reason))
        reached = end
    if times[-1] > reached:
        intervals.append(Interval(reached, float(times[-1]), between))
    return tuple(intervals)
