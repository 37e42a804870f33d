"""Several demonstrations in step: the same part of the motion at the same fraction of the time."""

from __future__ import annotations

import importlib
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
import scipy

from noslip._typing import Floats
from noslip.demonstrations._several import at_fractions, several
from noslip.errors import InputError, MissingDependencyError
from noslip.trajectory import PoseTrajectory

SAMPLES = 401
"""Fractions of the duration at which motions are compared."""
KNOTS = 25
"""Knots of a warping beside its ends: the staircase of the path is averaged between them."""
PASSES = 3
"""The first aligns to one of the demonstrations, the others to the mean of all."""
LEAST_SLOPE = 0.05
"""Of a warping, on the average over the motion: time never stands still."""
PENALTY = 0.02
"""Price of a step along one motion alone, over the features' rms."""
LEAST_TURN = 0.2
"""Radians (rms) below which a demonstration's turning counts less than its path."""


def align(demonstrations: Iterable[PoseTrajectory]) -> list[PoseTrajectory]:
    """Bring several demonstrations into step, by dynamic time warping.

    A hand slows down here in one demonstration and there in the next; the mean of both, which is
    what a primitive learns, then mixes different parts of the motion.  Positions and rotations,
    relative to their first ones, are warped onto the demonstration that is nearest to all others,
    and then onto the mean (``dtaidistance.dtw_ndim``).  The staircase that a warping path is, is
    averaged over 1/25 of the motion and becomes a monotone curve (PCHIP) through these knots.  The
    common timing is the mean of all, not that of one.

    Parameters
    ----------
    demonstrations : several PoseTrajectory
        2 or more; of any duration and rate.

    Returns
    -------
    list of PoseTrajectory
        In the same order, under the same names: the same path in warped time, with uniform samples.
        First and last pose, time of the start, duration and number of samples stay.

    Raises
    ------
    InputError
        If there are fewer than 2, or one does not move at all.
    MissingDependencyError
        If dtaidistance is not installed.
    """
    motions = several(demonstrations, 2, "align")
    warping = _library()
    features = _features(motions)
    reference = features[_most_central(warping, features)]
    fractions = np.linspace(0.0, 1.0, SAMPLES)
    warps = np.tile(fractions, (len(motions), 1))
    for _ in range(PASSES):
        warps = np.array([_warp(warping, reference, feature) for feature in features])
        # The reference's own timing drops out: each is seen over the mean of all.
        common = warps.mean(axis=0)
        warps = np.array(
            [scipy.interpolate.PchipInterpolator(common, warp)(fractions) for warp in warps]
        )
        reference = np.mean(
            [_at(feature, warp) for feature, warp in zip(features, warps, strict=True)], axis=0
        )
    return [_warped(motion, warp) for motion, warp in zip(motions, warps, strict=True)]


def _library() -> Any:
    try:
        return importlib.import_module("dtaidistance.dtw_ndim")
    except ImportError:
        raise MissingDependencyError(
            "align needs dtaidistance; install it with: pip install 'noslip[align]'"
        ) from None


def _features(motions: list[PoseTrajectory]) -> list[Floats]:
    """Position and turn since the start, each over its rms among all, shape (SAMPLES, 6) each."""
    paths, turns = [], []
    for motion in motions:
        sampled = at_fractions(motion, SAMPLES)
        if not motion.path_length > 0:
            raise InputError(f"{motion.name}: stands still; align needs motions")
        steps = sampled.step_velocities()[1] * np.diff(sampled.times)[:, None]
        paths.append(sampled.positions - sampled.positions[0])
        turns.append(np.cumsum(np.vstack([0 * steps[:1], steps]), axis=0))
    path = _rms(paths)
    turn = max(_rms(turns), LEAST_TURN)
    return [np.hstack([p / path, t / turn]) for p, t in zip(paths, turns, strict=True)]


def _rms(curves: list[Floats]) -> float:
    return float(np.sqrt(np.mean(np.sum(np.square(curves), axis=2))))


def _most_central(warping: Any, features: list[Floats]) -> int:
    distances = np.array(
        [[warping.distance(a, b, use_c=True, penalty=PENALTY) for b in features] for a in features]
    )
    return int(np.argmin(np.median(distances, axis=1)))


def _warp(warping: Any, reference: Floats, feature: Floats) -> Floats:
    """Fraction of a motion at each fraction of the reference, shape (SAMPLES,): increasing."""
    path = np.array(warping.warping_path(reference, feature, use_c=True, penalty=PENALTY))
    # Along the diagonal of both, the staircase is a function, and neither motion is preferred.
    along = path.sum(axis=1) / (2 * (SAMPLES - 1))
    ahead = (path[:, 1] - path[:, 0]) / (SAMPLES - 1)
    bins = np.minimum((along * KNOTS).astype(int), KNOTS - 1)
    count = np.maximum(np.bincount(bins, minlength=KNOTS), 1)
    # Next to an end the knots would be too near to it for a slope.
    middle = (np.bincount(bins, along, KNOTS) / count)[1:-1]
    lead = (np.bincount(bins, ahead, KNOTS) / count)[1:-1]
    own, other = (
        np.concatenate([[0.0], curve, [1.0]]) for curve in (middle - lead / 2, middle + lead / 2)
    )
    own, other = (_increasing(curve) for curve in (own, other))
    warp: Floats = scipy.interpolate.PchipInterpolator(own, other)(np.linspace(0.0, 1.0, SAMPLES))
    return warp


def _increasing(curve: Floats) -> Floats:
    """Knots that rise by some of their average rise everywhere; the ends stay."""
    rises = np.maximum(np.diff(curve), 0.0)
    rises = (1 - LEAST_SLOPE) * rises / rises.sum() + LEAST_SLOPE / len(rises)
    return np.concatenate([[0.0], np.cumsum(rises)[:-1], [1.0]])


def _at(feature: Floats, warp: Floats) -> Floats:
    fractions = np.linspace(0.0, 1.0, SAMPLES)
    return np.column_stack([np.interp(warp, fractions, column) for column in feature.T])


def _warped(motion: PoseTrajectory, warp: Floats) -> PoseTrajectory:
    fractions = np.linspace(0.0, 1.0, len(motion))
    share = scipy.interpolate.PchipInterpolator(np.linspace(0.0, 1.0, SAMPLES), warp)(fractions)
    share = np.clip(share, 0.0, 1.0)
    moved = motion.resampled(times=motion.times[0] + motion.duration * share)
    times = motion.times[0] + motion.duration * fractions
    warped = motion.with_points(moved.points, times)
    if not (isinstance(moved, PoseTrajectory) and moved.channels):
        return warped
    return warped.with_channels(replace(moved.channels, times=times))
