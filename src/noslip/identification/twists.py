"""Steps of recordings as the body feels them, and the noise of the poses that they come from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from noslip._typing import Floats
from noslip.quaternions import inverse, product
from noslip.trajectory import PoseTrajectory

FINEST_NOISE = 1e-6
"""Meters and radians: no tracker is finer, and the differences of exact poses would say 0."""
LONGEST_GAP = 8.0
"""Median periods without a sample, after which a recording counts as another one."""
FEWEST_SAMPLES = 12
"""Of a piece: fewer say nothing of its noise."""
_STENCIL = 5
"""Samples of a difference: over five, motions at 15 Hz and more are cubics to within 0.01 mm."""
_MEDIAN_SQUARE = 0.4549364
"""Median of the square of a standard normal variable."""

_USUAL, _USUAL_SQUARE = 3.0, 0.9733369
"""Standard deviations that are no outlier, and the mean square of what lies within them."""


@dataclass(frozen=True, eq=False)
class Steps:
    """The steps of one piece of a recording, in the frame in the middle of each.

    Attributes
    ----------
    ways : array, shape (N, 6)
        Displacement of the body's origin (m) and turn (rad) of each step.
    periods : array, shape (N,)
        Seconds of each step.
    noise : (float, float)
        Standard deviation of a pose's position (m) and of its rotation about each axis (rad).
    """

    ways: Floats
    periods: Floats
    noise: tuple[float, float]


def steps_of(recording: PoseTrajectory, noise: tuple[float, float] | None = None) -> list[Steps]:
    """Return the steps of a recording, in pieces where samples are missing.

    A pose that repeats the one before is left out: a tracker that holds it, or is read too often,
    measured nothing.
    """
    poses = np.hstack([recording.positions, recording.quaternions])
    kept = np.flatnonzero(np.concatenate([[True], np.any(np.diff(poses, axis=0) != 0, axis=1)]))
    if len(kept) < FEWEST_SAMPLES:
        return []
    periods = np.diff(recording.times[kept])
    cuts = np.flatnonzero(periods > LONGEST_GAP * np.median(periods)) + 1
    pieces = [
        PoseTrajectory(
            recording.times[piece], recording.positions[piece], recording.rotations[piece]
        )
        for piece in np.split(kept, cuts)
        if len(piece) >= FEWEST_SAMPLES
    ]
    if pieces and noise is None:
        noise = _noise(pieces)
    found = []
    for piece in pieces:
        periods = np.diff(piece.times)
        found.append(Steps(piece.body_velocities * periods[:, None], periods, noise or (0.0, 0.0)))
    return found


def _noise(pieces: list[PoseTrajectory]) -> tuple[float, float]:
    """Standard deviations of positions (m) and rotations (rad), of the axes that have any noise."""
    differences = np.concatenate([_differences(piece) for piece in pieces]) ** 2
    # Jerks and outliers aside, all of the sample tells, not its middle alone.
    usual = differences <= _USUAL**2 / _MEDIAN_SQUARE * np.median(differences, axis=0)
    squares = np.mean(differences, axis=0, where=usual) / _USUAL_SQUARE
    linear, angular = (
        float(np.sqrt(part[part > FINEST_NOISE**2].mean()))
        if np.any(part > FINEST_NOISE**2)
        else FINEST_NOISE
        for part in (squares[:3], squares[3:])
    )
    return linear, angular


def _differences(piece: PoseTrajectory) -> Floats:
    """Differences that cubics do not have, of unit gain, shape (M, 6): m, then rad."""
    count = len(piece) - _STENCIL + 1
    window = np.arange(count)[:, None] + np.arange(_STENCIL)
    times = piece.times[window] / piece.period
    apart = times[:, :, None] - times[:, None, :]
    weights = 1 / np.prod(apart + np.eye(_STENCIL), axis=2)
    weights /= np.linalg.norm(weights, axis=1, keepdims=True)
    quaternions = piece.quaternions[window]
    # Twice the vector part: turns from the middle one, smooth and, at the noise's size, rad.
    turns = 2 * product(inverse(quaternions[:, _STENCIL // 2, None]), quaternions)[..., 1:]
    values = np.concatenate([piece.positions[window], turns], axis=2)
    return np.asarray(np.einsum("ks,ksi->ki", weights, values))
