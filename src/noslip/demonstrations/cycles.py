"""Recordings of rhythms: the periods that they hold, and that each comes back to its beginning."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import scipy

from noslip import _arguments
from noslip._typing import Floats
from noslip._values import with_unit
from noslip.errors import InputError, RecordingWarning, warn
from noslip.space import Space
from noslip.trajectory import PoseTrajectory

OPEN, OPEN_TURN = 0.05, np.radians(10.0)
"""Share of the path, and turn, by which a period may miss its beginning: a hand does by 0.02."""
ALIKE = 0.8
"""Of the normalized square difference function, from which on a recording repeats itself: 1 where
it does exactly, 0 where it is as far from itself as from its mean, and beyond 0.95 by hand."""
HIGHEST = 0.95
"""Share of its highest peak, the first of which beyond it is the period (McLeod and Wyvill 2005:
0.8 to 1): its multiples are peaks as well, and noise may make one of them the highest."""
SLACK = 0.25
"""Share by which a period of a hand may differ from the usual one."""
_FEWEST = 8
"""Samples of a period, of which velocities can be told."""
_SMOOTHED = 1 / 8
"""Of a period, the stretch whose quartic tells the velocity in its middle (Savitzky and Golay
1964): of noise of 0.3 mm at 100 Hz a hundredth is left, and a tenth harmonic keeps its own."""
_NEAR = 0.1
"""What may be missed at the recording's own beginning, over the spread of what moves: of a circle a
third of what :data:`OPEN` says."""
_BEGINNINGS = 16
"""In the first period, at which the cuts are tried: where it hurries, a return is told best."""


def periods(recording: PoseTrajectory, period: float | None = None) -> list[PoseTrajectory]:
    """Return the periods that a recording of a rhythm holds, one after another.

    How long they are is told by the first high peak of the normalized square difference function
    ``2 sum x_t . x_{t+lag} / sum (|x_t|^2 + |x_{t+lag}|^2)`` (McLeod and Wyvill 2005) of all
    that moves about its mean, and where each ends by when pose and velocity are nearest to what
    they were when it began: a hand is not a clock.  They begin with the recording, or a little
    later if that is where they close.  What is left at its end is left out.

    Parameters
    ----------
    recording : PoseTrajectory, Trajectory or Bodies
    period : float, optional
        Seconds, about; by default it is found, and told by a warning.

    Returns
    -------
    list of PoseTrajectory, or what the recording is
        The recording itself, if it does not repeat.

    Raises
    ------
    InputError
        If a period is given that is no length of time, or longer than the recording.

    Warns
    -----
    RecordingWarning
        Of the periods that were found, where none was given.
    """
    even = recording
    if not recording.is_uniform:
        even = recording.resampled(rate=1 / recording.period)
    step = even.period
    moving = _moving(even)
    if period is None:
        lag = _lag(moving)
    else:
        lag = _arguments.positive("period", period, "seconds") / step
        if lag > (len(even) - 1) * (1 + OPEN):
            raise InputError(
                f"{recording.name}: a period of {period:g} s is longer than its "
                f"{recording.duration:.4g} s; give seconds, or leave it out"
            )
        if lag < _FEWEST:
            raise InputError(
                f"{recording.name}: a period of {period:g} s is {lag:.2g} of its samples; at least "
                f"{_FEWEST} are needed, give seconds"
            )
    if lag < _FEWEST or lag > (len(even) - 1) * (1 - OPEN):
        return [recording]
    cuts = even.times[0] + step * _cuts(moving, lag)
    if len(cuts) < (3 if period is None else 2):
        return [recording]
    last = float(recording.times[-1])
    found = []
    for k, (begin, end) in enumerate(pairwise(cuts), start=1):
        times = np.linspace(begin, min(end, last), round((end - begin) / step) + 1)
        piece = recording.resampled(times=times)
        found.append(replace(piece, name=f"{recording.name}, period {k}"))
    if period is None:
        left = last - cuts[-1] + cuts[0] - recording.times[0]
        warn(
            f"{recording.name}: holds {len(found)} periods of {np.diff(cuts).mean():.4g} s, as "
            f"repeats of one; {left:.2g} s of it are left out.  If a period is another, give it "
            f"(period={recording.duration:.4g}: the whole of it)",
            RecordingWarning,
        )
    return found


def _moving(even: PoseTrajectory) -> Floats:
    """What moves about its mean, in sizes that compare; rotations without whole turns.

    A radian counts as much as the positions' spread.

    Returns
    -------
    array, shape (N, d)
    """
    away = even.positions - even.positions.mean(axis=0)
    size = np.sqrt(np.mean(np.sum(away**2, axis=1)))
    parts = [away / size if size > 0 else away]
    if even.space.rotations:
        turns = even.rotations.as_matrix().reshape(len(even), -1) / np.sqrt(2)
        parts.append(turns - turns.mean(axis=0))
    return np.hstack(parts)


def _lag(moving: Floats) -> float:
    """Samples of a period; 0 if there are not two that are alike."""
    count = len(moving)
    products = sum(scipy.signal.correlate(x, x, method="fft")[count - 1 :] for x in moving.T)
    squares = np.cumsum(np.sum(moving**2, axis=1))
    # Sums of the first N - lag and of the last N - lag squares.
    lags = np.arange(count // 2 + 1)
    sums = squares[count - 1 - lags] + squares[-1] - np.concatenate([[0.0], squares])[lags]
    if not squares[-1] > 0:
        return 0.0
    alike = 2 * products[lags] / np.maximum(sums, 1e-12 * squares[-1])
    peaks, _ = scipy.signal.find_peaks(np.append(alike, -np.inf))
    # Between the sample itself and where it is first as far as from the mean, all is alike.
    (apart,) = np.nonzero(alike < 0)
    if not len(apart):
        return 0.0
    peaks = peaks[peaks > apart[0]]
    if not len(peaks) or alike[peaks].max() < ALIKE:
        return 0.0
    return float(peaks[np.argmax(alike[peaks] >= HIGHEST * alike[peaks].max())])


def _cuts(moving: Floats, lag: float) -> Floats:
    """Samples, fractions too, at which periods begin and end."""
    # A phase plane: where one turns back, velocity tells the time, and position does not.
    window = max(7, 2 * round(_SMOOTHED * lag / 2) + 1)
    rates = scipy.signal.savgol_filter(moving, min(window, len(moving)), 4, deriv=1, axis=0)
    plane = np.hstack([moving, rates * lag / (2 * np.pi)])
    tried = []
    for first in np.linspace(0, lag, _BEGINNINGS, endpoint=False).astype(int):
        cuts = _returns(plane, int(first), lag)
        # Of poses alone: velocities are not told well at a recording's ends.
        gaps = _between(moving, cuts[1:]) - moving[first]
        worst = float(np.linalg.norm(gaps, axis=1).max(initial=0.0)) if len(gaps) else np.inf
        near = worst <= _NEAR
        # As many as close, from its own beginning if it may be; or those that close best.
        tried.append(((near, near * len(cuts), near and first == 0, -worst), cuts))
    most = max(len(cuts) for _, cuts in tried)
    return max((t for t in tried if len(t[1]) >= most - 1), key=lambda t: t[0])[1]


def _returns(plane: Floats, first: int, lag: float) -> Floats:
    """When a motion is nearest to what it was at a sample, again and again, from it on."""
    cuts, count = [float(first)], len(plane)
    while True:
        low = round(cuts[-1] + (1 - SLACK) * lag)
        high = min(round(cuts[-1] + (1 + SLACK) * lag), count - 1)
        if cuts[-1] + lag > count - 1 + OPEN * lag or low >= high:
            return np.array(cuts)
        away = np.linalg.norm(plane[low : high + 1] - plane[first], axis=1)
        cuts.append(_nearest(plane, plane[first], low + int(away.argmin())))


def _nearest(plane: Floats, point: Floats, sample: int) -> float:
    """Where the polyline comes nearest to a point, beside the sample that is nearest to it."""
    found, least = float(sample), float(np.linalg.norm(plane[sample] - point))
    for k in (sample - 1, sample):
        if 0 <= k < len(plane) - 1:
            way = plane[k + 1] - plane[k]
            share = float(np.clip((point - plane[k]) @ way / max(way @ way, 1e-300), 0, 1))
            gap = float(np.linalg.norm(plane[k] + share * way - point))
            if gap < least:
                found, least = k + share, gap
    return found


def _between(samples: Floats, at: Floats) -> Floats:
    """Values at fractions of samples, shape (M, d)."""
    low = np.minimum(at.astype(int), len(samples) - 2)
    return np.asarray(samples[low] + (at - low)[:, None] * (samples[low + 1] - samples[low]))


def closed(period: PoseTrajectory) -> PoseTrajectory:
    """Return a period whose last sample is its first one again.

    What a hand misses by is spread evenly over the period.  Rotations come back up to whole turns.

    Raises
    ------
    InputError
        If it ends elsewhere than it begins, by more than a twentieth of its path or 10 degrees.
    """
    points, space = period.points, period.space
    gap = space.difference(points[:1], points[-1:])
    away = float(np.linalg.norm(gap[0, : space.linear]))
    turn = float(np.abs(gap[0, space.linear :]).max(initial=0.0))
    if away > OPEN * period.path_length or turn > OPEN_TURN:
        apart = with_unit(f"{away:.3g}", period.unit)
        turned = f" and {np.degrees(turn):.3g} degrees" if space.rotations else ""
        raise InputError(
            f"{period.name}: ends {apart}{turned} from where it begins; "
            "cut it to one period (trajectory[first:last]), say how long one is (period=...), or "
            "learn a motion that ends, rhythmic=False"
        )
    if not gap.any():
        return period
    share = (period.times - period.times[0]) / period.duration
    return period.with_points(joined(space, points, share))


def joined(space: Space, points: Floats, share: Floats) -> Floats:
    """Points whose last one is the first again: the gap spread over them by its share at each."""
    gap = space.difference(points[:1], points[-1:])
    moved = space.moved(points, share[:, None] * gap)
    moved[-1, : space.linear] = moved[0, : space.linear]
    return moved
