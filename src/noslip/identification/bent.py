"""A needle whose path bends as it is pushed, fitted to its steps.

Its four rows (see :class:`noslip.Needle`) leave two twists: roll about the shaft, and a turn about
the axis of the bend's circle.  Either could be the shaft, but a needle is pushed forward.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import scipy
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip.identification.rows import (
    FIRM,
    LEVER,
    NOTHING,
    TOLD,
    Evidence,
    Fit,
    Trial,
    screws,
    squares,
)

_WEIGHINGS = 3
"""Fits, each weighed by the slip of the one before."""
_SETTLED = 1e-12
"""Relative changes of its last step."""
_NEAR = 4.0
"""Times the share of turning that may be left, within which a guess is worth a fit."""
_STRAIGHT = 1e-3
"""1/m: what bends less, in a kilometer, is straight."""


@dataclass(frozen=True, eq=False)
class Bent:
    """A needle's frame, shape (3, 3): lateral, bevel and shaft; its tip (m) and curvature (1/m)."""

    frame: Floats
    tip: Floats
    curvature: float

    @property
    def rows(self) -> tuple[Floats, Floats]:
        """Rows of speeds and of angular speeds, each of shape (2, 6)."""
        lateral, bevel, shaft = self.frame
        ahead = screws(shaft[None], self.tip)
        turns = np.hstack([np.zeros((2, 3)), [lateral, bevel]])
        turns[1] -= self.curvature * ahead[0]
        return screws(self.frame[:2], self.tip), turns

    def moved(self, change: Floats) -> Bent:
        """Frame turned by a rotation vector, tip shifted, curvature stretched: shape (7,)."""
        frame = self.frame @ Rotation.from_rotvec(change[:3]).as_matrix().T
        return Bent(frame, self.tip + change[3:6], self.curvature * np.exp(change[6]))


@dataclass(frozen=True, eq=False)
class BentTrial:
    """A bent needle fitted: its rows of speed, its curvature with standard error (1/m)."""

    trial: Trial
    bent: Bent
    error: float


def bent_needle(evidence: Evidence, most: float, unknown: Floats = NOTHING) -> BentTrial | None:
    """Fit a bent needle; None, if it leaves more than a share of the turning across the shaft."""
    total = evidence.fast.total
    starts = [start for start in _starts(total, unknown) if _left(total, start) < _NEAR * most]
    fits = [_weighed(evidence, start, unknown) for start in starts]
    fits = [found for found in fits if _left(total, found[0]) < most]
    if not fits:
        return None
    bent, fit, error, moments = max(fits, key=lambda found: _steadiness(evidence, found[0]))
    if evidence.net_way(bent.frame[2], bent.tip) < 0:
        bent = Bent(bent.frame * [[1], [-1], [-1]], bent.tip, bent.curvature)
        fit = replace(fit, axes=bent.frame[:2])
    totals = [moment.sum(axis=0) for moment in moments]
    others = tuple(
        _solved([whole - part for whole, part in zip(totals, own, strict=True)], bent, fit.unknown)
        for own in zip(*moments, strict=True)
    )
    return BentTrial(Trial(evidence, fit, tuple(fit for _, fit, _ in others)), bent, error)


def _left(total: Floats, bent: Bent) -> float:
    """The rms of the turning across the shaft that is not explained, over all of that."""
    every = np.hstack([np.zeros((2, 3)), bent.frame[:2]])
    left, whole = squares(total, bent.rows[1]).sum(), squares(total, every).sum()
    return float(np.sqrt(max(left, 0.0) / max(whole, 1e-12)))


def _steadiness(evidence: Evidence, bent: Bent) -> float:
    """How steadily the tip goes forward (or back), 1 at constant speed."""
    time = sum(float(steps.periods.sum()) for part in evidence.parts for steps in part)
    (square,) = squares(evidence.fast.total, screws(bent.frame[2:], bent.tip))
    return abs(evidence.net_way(bent.frame[2], bent.tip)) / float(
        np.sqrt(max(square, 1e-12)) * time
    )


def _starts(total: Floats, unknown: Floats) -> Iterator[Bent]:
    """Guess: the origin is the tip; or there are two turns, of which one is the roll."""
    values, vectors = np.linalg.eigh(total[:3, :3])
    turning = np.linalg.eigh(total[3:, 3:])[0][-1]
    if turning < _STRAIGHT**2 * values[-1]:
        return
    shaft = vectors[:, -1]
    bends = total[3:, :3] @ shaft / values[-1]
    bends -= shaft * (shaft @ bends)
    if np.linalg.norm(bends) > _STRAIGHT:
        bevel = bends / np.linalg.norm(bends)
        yield Bent(
            np.array([np.cross(bevel, shaft), bevel, shaft]),
            np.zeros(3),
            float(np.linalg.norm(bends)),
        )
    squares = np.trace(total[:3, :3]), np.trace(total[3:, 3:])
    # Of a tool that hardly moves or turns, noise takes all off.
    if len(unknown) or min(squares) <= 0:
        return
    scale = np.sqrt(np.repeat(squares, 3))
    one, two = (scale * np.linalg.eigh(total / np.outer(scale, scale))[1][:, -2:].T)[::-1]
    # Twists along a line: their linear velocity is across the angular one.
    pitches = [one[:3] @ one[3:], one[:3] @ two[3:] + two[:3] @ one[3:], two[:3] @ two[3:]]
    root = np.sqrt(max(pitches[1] ** 2 - 4 * pitches[0] * pitches[2], 0.0))
    lines = []
    for sign in (1, -1):
        twist = 2 * pitches[2] * one + (-pitches[1] + sign * root) * two
        length = np.linalg.norm(twist[3:])
        if length < 1e-9:
            return
        twist = twist / length
        lines.append((twist[3:], np.cross(twist[3:], twist[:3])))
    for (shaft, place), (bevel, center) in (lines, lines[::-1]):
        across = np.cross(shaft, bevel)
        away = np.linalg.norm(across)
        if away < 0.1:
            return
        across /= away
        radius = across @ (place - center)
        # The foot on the shaft of what is perpendicular to both.
        tip = place + shaft * (np.cross(bevel, across) @ (center - place)) / (
            np.cross(bevel, across) @ shaft
        )
        bevel = bevel - shaft * (shaft @ bevel)
        bevel /= np.linalg.norm(bevel)
        ahead = np.sign(np.cross(bevel, across * radius) @ shaft) * shaft
        if abs(radius) > 1e-6:
            yield Bent(np.array([np.cross(bevel, ahead), bevel, ahead]), tip, 1 / abs(radius))


def _weighed(
    evidence: Evidence, bent: Bent, unknown: Floats
) -> tuple[Bent, Fit, float, list[Floats]]:
    for _ in range(_WEIGHINGS):
        moments = [evidence.moments(rows, evidence.slip(rows)) for rows in bent.rows]
        bent, fit, error = _solved([moment.sum(axis=0) for moment in moments], bent, unknown)
    return bent, fit, error, moments


def _solved(totals: list[Floats], start: Bent, unknown: Floats) -> tuple[Bent, Fit, float]:
    roots = []
    for total in totals:
        values, vectors = np.linalg.eigh(total)
        roots.append(np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T)
    prior = np.eye(3) / LEVER + FIRM * unknown.T @ unknown

    def residual(change: Floats) -> Floats:
        bent = start.moved(change)
        speeds, turns = (
            (root @ rows.T).ravel() for root, rows in zip(roots, bent.rows, strict=True)
        )
        return np.concatenate([speeds, turns, prior @ bent.tip, change[:3], change[6:]])

    found = scipy.optimize.least_squares(
        residual, np.zeros(7), x_scale="jac", method="lm", xtol=_SETTLED, ftol=_SETTLED
    )
    inverse = np.linalg.pinv(found.jac)
    covariance = inverse @ inverse.T
    spreads, directions = np.linalg.eigh(covariance[3:6, 3:6])
    if np.any(spreads > TOLD**2):
        more = np.vstack([unknown, directions.T[spreads > TOLD**2]])
        return _solved(totals, start, np.linalg.svd(more, full_matrices=False)[2])
    bent = start.moved(found.x)
    bent = Bent(bent.frame, bent.tip - unknown.T @ (unknown @ bent.tip), bent.curvature)
    fit = Fit(bent.frame[:2], bent.tip, covariance[:6, :6], unknown)
    return bent, fit, bent.curvature * float(np.sqrt(covariance[6, 6]))
