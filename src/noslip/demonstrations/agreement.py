"""Whether several demonstrations show one motion, so that their mean follows them."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from noslip._typing import Floats
from noslip.demonstrations._several import at_fractions
from noslip.errors import InputError, RecordingWarning, warn
from noslip.trajectory import PoseTrajectory

SAMPLES = 101
"""Places at which demonstrations are compared: enough for a dozen bends."""
APART = 0.1
"""Of the path, between two starts: the mean then begins where neither did.  Repeats at one place,
recorded with their rest, begin within 0.03."""
OUT_OF_STEP = 0.05
"""Of the path, rms: how far demonstrations stray from their mean in time, if most of that is due to
their timing.  Repeats by hand, recorded with their rest, stray by 0.04."""
BY_TIMING = 2.0
"""Most of it is due to the timing where they agree this much better at equal ways than at equal
times."""
OPPOSITE = 0.25
"""How much nearer than its own a path comes to another run backwards.  One and the same cut done
backwards: 0; placed any other way: above 0.4."""
UNLIKE = 0.5
"""Distance over the size (both rms) up to which two paths count as alike, whatever the way back is
like: a motion out and back the same way is its own reverse."""
HELD_OPPOSITE = -np.sqrt(3) / 2
"""Cosine of the angle, mean along the motion, at which two tools are held the other way round:
within 30 degrees of half a turn, where a mean orientation says nothing."""


def require_agreement(demonstrations: list[PoseTrajectory], *, aligned: bool = False) -> None:
    """Refuse demonstrations of opposite directions; warn of others whose mean follows none.

    Everything is judged relative to the length of the path, at equal shares of the way and of the
    time: units, rates and rests at the ends do not matter.

    Parameters
    ----------
    demonstrations : list of PoseTrajectory
        That move.
    aligned : bool
        Whether they are going to be brought into step.

    Raises
    ------
    InputError
        Naming two of which one runs backwards, or is held the other way round.
    """
    if len(demonstrations) < 2:
        return
    sampled = [at_fractions(d, SAMPLES) for d in demonstrations]
    turned = np.array([s.rotations.as_matrix().reshape(-1) for s in sampled])
    # Mean of the traces, of all samples and bodies.
    cosines = (turned @ turned.T / (turned.shape[1] / 9) - 1) / 2
    _refuse_pair(demonstrations, cosines < HELD_OPPOSITE, "hold the tool opposite ways")
    paths = np.array([s.positions for s in sampled])
    length = float(np.median([d.path_length for d in demonstrations]))
    if not length > 0:
        return
    ways = np.array([_at_equal_ways(path) for path in paths])
    shapes = ways - ways.mean(axis=1, keepdims=True)
    size = np.sqrt(np.mean(np.sum(shapes**2, axis=2)))
    along, back = _distances(shapes, shapes), _distances(shapes, shapes[:, ::-1])
    opposite = (along > UNLIKE * size) & (back < OPPOSITE * along)
    _refuse_pair(demonstrations, opposite, "run in opposite directions")

    starts = paths[:, 0]
    gaps = np.linalg.norm(starts[:, None] - starts, axis=2)
    if gaps.max() > APART * length:
        i, j = np.unravel_index(int(gaps.argmax()), gaps.shape)
        near = _stray(ways - ways[:, :1]) <= APART * length
        relative = "--relative (prepare(..., relative=True)), or " if near else ""
        why = "" if near else "relative to their starts they differ too: "
        warn(
            f"{demonstrations[i].name} and {demonstrations[j].name}: their starts lie "
            f"{gaps.max():.2g} m apart, paths are {length:.2g} m long, and what is learned is "
            f"their mean; {why}{relative}--each (learn_each) learns one of each",
            RecordingWarning,
        )
    in_time = _stray(paths - paths.mean(axis=1, keepdims=True))
    if not aligned and in_time > max(OUT_OF_STEP * length, BY_TIMING * _stray(shapes)):
        warn(
            f"{demonstrations[0].name} and {len(demonstrations) - 1} more: are out of step, by "
            f"{in_time:.2g} m (rms) of paths {length:.2g} m long; bring them into step: --align "
            "(align=True)",
            RecordingWarning,
        )


def _refuse_pair(demonstrations: list[PoseTrajectory], found: NDArray[np.bool_], what: str) -> None:
    for i, j in combinations(range(len(demonstrations)), 2):
        if found[i, j]:
            raise InputError(
                f"{demonstrations[i].name} and {demonstrations[j].name} {what}; leave one out, or "
                "learn one primitive of each: --each (learn_each)"
            )


def _at_equal_ways(path: Floats) -> Floats:
    """Positions at equal shares of the way, same shape; a path that stands still stays."""
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    shares = np.linspace(0.0, way[-1], len(path))
    return np.column_stack([np.interp(shares, way, column) for column in path.T])


def _distances(a: Floats, b: Floats) -> Floats:
    """Rms distance of each path of one set to each of another, shape (n, n)."""
    first, second = a.reshape(len(a), -1), b.reshape(len(b), -1)
    squares = np.sum(first**2, axis=1)[:, None] + np.sum(second**2, axis=1)
    return np.asarray(np.sqrt(np.maximum(squares - 2 * first @ second.T, 0.0) / a.shape[1]))


def _stray(paths: Floats) -> float:
    """Rms distance of paths from their mean."""
    return float(np.sqrt(np.mean(np.sum((paths - paths.mean(axis=0)) ** 2, axis=2))))
