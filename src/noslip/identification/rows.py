"""Directions of a body that are free of slip, fitted to its steps.

A direction ``a`` along which the body's point ``r`` does not move is a row
``a . (v + w x r) = 0`` of the body twist, linear in the line ``(a, r x a)``.  No velocity has to be
estimated, since the row holds of every sum of steps alike.  What is minimized is the sum of squares
of the way slipped, weighted by its covariance: noise of poses cancels from one step to the next,
slip adds up.  The noise's own share of the sum is taken off, without which it would pull the axis
away from the directions in which there is little motion (errors in variables).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip.identification.twists import FINEST_NOISE, Steps

HIGHEST_FREQUENCY = 3.0
"""Hz, up to which slip is weighed: hands move at 2, and noise of trackers above it is not white."""
TOLD = 0.03
"""Standard error (m) beyond which the recordings do not tell where a point is along a direction."""
LEVER = 1.0
"""Meters within which a point is sought where little tells of it: no tool is longer."""
QUIET = 0.03
"""Share of the speed that noise may be, averaged over a window: then it is subtracted to 1 %."""
FINEST_SPEED = 1e-5
"""m/s: what moves slower stands still."""
_SHORTEST = 0.2
"""Seconds of the shortest window: a low-pass filter at 2 Hz, below which hands move."""
_WEIGHINGS = 3
"""Fits, each weighed by the slip of the one before."""
_ROUNDS, _FEW = 50, 6
"""Of Gauss-Newton; ten do where the rows are well told, six tell which start is the best."""
SETTLED = 1e-9
"""Meters and radians of its last step."""
FIRM = 1e6
"""1/m: holds a point where it is along a direction, firmer than data to a micrometer."""
NOTHING: Floats = np.zeros((0, 3))
"""No direction."""


def crossing(vector: Floats) -> Floats:
    """Return the matrix, shape (3, 3), of the cross product with a vector on its left.

    Of one vector with many it is several times as fast as ``np.cross``.
    """
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def screws(axes: Floats, point: Floats) -> Floats:
    """Rows ``(a, r x a)`` of a body twist, shape (n, 6), of axes, shape (n, 3), through a point."""
    return np.hstack([axes, axes @ crossing(point).T])


@dataclass(frozen=True, eq=False)
class Fit:
    """Rows through one point: orthonormal `axes`, shape (n, 3), and the point, shape (3,).

    `covariance` is that of the axes' common turn (rad, body frame) and the point (m), shape (6, 6),
    across `unknown`, shape (k, 3): orthonormal directions along which nothing tells of the point.
    """

    axes: Floats
    point: Floats
    covariance: Floats
    unknown: Floats


def moment(steps: Steps, lines: Floats, slip: float) -> Floats:
    """Whitened second moment of the steps, less what noise adds to it, shape (6, 6).

    Parameters
    ----------
    lines : array, shape (n, 6)
        Rows by which steps are weighed, see :func:`screws`.
    slip : float
        Spectral density of the slip's speed (m^2/s): its way's variance over a second.
    """
    ways, linear, angular = steps.ways, *steps.noise
    count, period = len(ways), float(steps.periods.mean())
    square = np.mean(lines**2 @ np.repeat([linear**2, angular**2], 3))
    # White slip and noise of poses meet at a frequency; beyond the highest, noise weighs more.
    square = max(square, slip / (period * (2 * np.pi * HIGHEST_FREQUENCY) ** 2))
    # An error of the rotation turns the step, and errors turn with the body: they add up, too.
    moves, turns, axes = ways[:, None, :3], ways[:, None, 3:], lines[:, :3]
    swung = np.cross(moves, axes) + np.cross(turns, lines[:, 3:])
    errors = angular**2 * swung**2 + linear**2 * np.cross(turns, axes) ** 2
    added = slip * steps.periods + np.mean(np.sum(errors, axis=2), axis=1)
    band = np.empty((2, count))
    band[0], band[1] = -square, 2 * square + added
    whitened = ways.T @ scipy.linalg.solveh_banded(band, ways)
    # Eigenvalues of the differences' covariance; the noise is theirs, and that of turned steps.
    own = 2 - 2 * np.cos(np.pi * np.arange(1, count + 1) / (count + 1))
    inverse = 1 / (square * own + added.mean())
    squares = ways[:, :3].T @ ways[:, :3] / count
    whitened[:3, :3] -= inverse.sum() * angular**2 * (np.trace(squares) * np.eye(3) - squares)
    shares = np.repeat([linear**2, angular**2], 3)
    return np.asarray(whitened - (own @ inverse) * np.diag(shares))


def fit(whitened: Floats, rows: int, unknown: Floats = NOTHING, start: Fit | None = None) -> Fit:
    """Return the rows through one point of which a whitened moment is least.

    They are sought from `start`, or from many places.  The point stays at 0 along directions given
    as unknown, shape (k, 3), and along those of which the moment does not tell.
    """
    values, vectors = np.linalg.eigh(whitened)
    root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
    # Turns of the axes that change nothing, and points of which nothing is told, stay as they are.
    prior = np.diag([1.0, 1.0, 1.0, *np.full(3, 1 / LEVER)])
    prior[3:, 3:] += FIRM * unknown.T @ unknown
    starts = [(start.axes, start.point)] if start else list(_starts(root, rows, prior))
    tried = [_descended(root, axes, point, prior, _FEW) for axes, point in starts]
    _, axes, point, _ = min(tried, key=lambda found: found[0])
    _, axes, point, covariance = _descended(root, axes, point, prior)
    spreads, directions = np.linalg.eigh(covariance[3:, 3:])
    if np.any(spreads > TOLD**2):
        unknown = np.vstack([unknown, directions.T[spreads > TOLD**2]])
        unknown = np.linalg.svd(unknown, full_matrices=False)[2]
        prior[3:, 3:] += FIRM * unknown.T @ unknown
        _, axes, point, covariance = _descended(root, axes, point, prior)
    return Fit(axes, point - unknown.T @ (unknown @ point), covariance, unknown)


def _starts(root: Floats, rows: int, prior: Floats) -> Iterator[tuple[Floats, Floats]]:
    """Axes and points: rows may hold about several, of which one holds best."""
    jacobian, wanted = _linear(root, np.eye(3), np.zeros(3), prior)
    points = np.zeros((2, 3))
    points[1] = np.linalg.lstsq(jacobian, wanted, rcond=None)[0][3:]
    for point in points:
        axes = np.linalg.svd(root @ np.vstack([np.eye(3), crossing(point)]))[2]
        yield from ((np.roll(axes, -k, axis=0)[:rows], point) for k in range(3))
    # Of any lines, each about a point of its own.
    levers = -np.linalg.lstsq(
        np.vstack([root[:, 3:], prior[3:, 3:]]),
        np.vstack([root[:, :3], np.zeros((3, 3))]),
        rcond=None,
    )[0]
    axes = np.linalg.svd(root[:, :3] + root[:, 3:] @ levers)[2][::-1]
    yield from (
        (np.roll(axes, -k, axis=0)[:rows], np.cross(axes[k], levers @ axes[k])) for k in range(3)
    )


def _linear(root: Floats, axes: Floats, point: Floats, prior: Floats) -> tuple[Floats, Floats]:
    """Jacobian of the residuals after the axes' turn and the point, and the residuals' negative."""
    jacobian, values = [prior], [np.append(np.zeros(3), prior[3:, 3:] @ point)]
    speeds = root[:, :3] + root[:, 3:] @ crossing(point)
    for axis in axes:
        turned = -crossing(axis)
        values.append(speeds @ axis)
        jacobian.append(np.hstack([speeds @ turned, root[:, 3:] @ turned]))
    return np.vstack(jacobian), -np.concatenate(values)


def _descended(
    root: Floats, axes: Floats, point: Floats, prior: Floats, rounds: int = _ROUNDS
) -> tuple[float, Floats, Floats, Floats]:
    """Gauss-Newton: cost, axes, point and covariance."""
    jacobian, wanted = _linear(root, axes, point, prior)
    for _ in range(rounds):
        change = np.linalg.lstsq(jacobian, wanted, rcond=None)[0]
        while True:
            turned = axes @ Rotation.from_rotvec(change[:3]).as_matrix().T
            linear = _linear(root, turned, point + change[3:], prior)
            if np.sum(linear[1] ** 2) <= np.sum(wanted**2) or np.abs(change).max() < SETTLED:
                break
            change = change / 4
        axes, point = turned, point + change[3:]
        jacobian, wanted = linear
        if np.abs(change).max() < SETTLED:
            break
    inverse = np.linalg.pinv(jacobian)
    return float(np.sum(wanted**2)), axes, point, inverse @ inverse.T


@dataclass(frozen=True, eq=False)
class Spread:
    """Second moment of the twist's means over windows of time, the share of the noise subtracted.

    Attributes
    ----------
    window : float
        Seconds.
    parts : array, shape (n, 6, 6)
        Of each part, over the number of all windows.
    noise : array, shape (6, 6)
        What was subtracted in all.
    count : int
        Windows in all.
    """

    window: float
    parts: Floats
    noise: Floats
    count: int

    @cached_property
    def total(self) -> Floats:
        return np.asarray(self.parts.sum(axis=0))

    def density(self, lines: Floats) -> float:
        """Spectral density of slip along rows (m^2/s) beyond what noise may feign."""
        noise = squares(self.noise, lines).mean() * np.sqrt(2 / (self.count * len(lines)))
        return self.window * float(squares(self.total, lines).mean() - 2 * noise)


@dataclass(frozen=True, eq=False)
class Evidence:
    """What recordings tell of rows, in parts each of which can be held out.

    `fast` is over windows as short as the noise admits, `slow` over windows four times as long.
    """

    parts: tuple[tuple[Steps, ...], ...]
    fast: Spread
    slow: Spread

    def slip(self, lines: Floats) -> float:
        """Spectral density of slip along rows (m^2/s)."""
        return max(self.fast.density(lines), self.slow.density(lines), FINEST_NOISE**2)

    def moments(self, lines: Floats, slip: float) -> Floats:
        """Whitened moments of the parts, shape (n, 6, 6); see :func:`moment`."""
        return np.array([sum(moment(steps, lines, slip) for steps in part) for part in self.parts])

    def net_way(self, axis: Floats, point: Floats) -> float:
        """Meters that a point moved along an axis, less those back."""
        line = screws(axis[None], point)[0]
        return float(sum(steps.ways.sum(axis=0) @ line for part in self.parts for steps in part))


def evidence(parts: Sequence[Sequence[Steps]]) -> Evidence:
    """Gather it."""
    pieces = [steps for part in parts for steps in part]
    duration = sum(float(steps.periods.sum()) for steps in pieces)
    window = max(_SHORTEST, 3 * max(float(np.median(steps.periods)) for steps in pieces))
    while True:
        fast = _spread(parts, window)
        speed = np.trace(fast.total[:3, :3])
        if np.trace(fast.noise[:3, :3]) / 3 < QUIET**2 * speed or window > duration / 32:
            return Evidence(tuple(map(tuple, parts)), fast, _spread(parts, 4 * window))
        window *= 1.5


def means(steps: Steps, window: float) -> tuple[Floats, Floats, NDArray[np.intp]]:
    """Twists averaged over windows of time, (M, 6), their seconds, (M, 1), and first steps."""
    clock = np.cumsum(steps.periods)
    # Equal ones: in a short last one, noise would be all there is.
    count = max(1, round(float(clock[-1]) / window))
    index = np.floor((clock - steps.periods / 2) * count / clock[-1])
    starts = np.flatnonzero(np.diff(index, prepend=-1.0))
    lengths = np.add.reduceat(steps.periods, starts)[:, None]
    return np.add.reduceat(steps.ways, starts) / lengths, lengths, starts


def _spread(parts: Sequence[Sequence[Steps]], window: float) -> Spread:
    found, noises, count = [], np.zeros((6, 6)), 0
    for part in parts:
        total = np.zeros((6, 6))
        for steps in part:
            twists, lengths, starts = means(steps, window)
            linear, angular = steps.noise
            noise = np.diag(np.repeat([linear**2, angular**2], 3)) * 2 * np.sum(lengths**-2.0)
            # Errors of the rotation turn each step.
            counts = np.diff(starts, append=len(steps.ways))
            moves = steps.ways[:, :3] / np.repeat(lengths, counts, axis=0)
            squares = moves.T @ moves
            noise[:3, :3] += angular**2 * (np.trace(squares) * np.eye(3) - squares)
            total += twists.T @ twists - noise
            noises, count = noises + noise, count + len(starts)
        found.append(total)
    return Spread(window, np.array(found) / count, noises / count, count)


@dataclass(frozen=True, eq=False)
class Trial:
    """Rows that were fitted to all of the evidence, and to all but one part of it in turn."""

    evidence: Evidence
    fit: Fit
    others: tuple[Fit, ...]

    def share(self, axis: Floats, point: Floats | None = None) -> float:
        """Root mean square speed of a point along an axis over all of its speed, without noise."""
        place = self.fit.point if point is None else point
        return _share(*_squared(self.evidence.fast.total, axis, place))

    def holdout(self, axis: Floats) -> float:
        """The same, of the parts held out: along the axis that the others have in its place."""
        inside = self.fit.axes.T @ self.fit.axes
        among = np.linalg.norm(inside @ axis) > np.sqrt(0.5)
        sums = np.zeros(2)
        for other, part in zip(self.others, self.evidence.fast.parts, strict=True):
            plane = other.axes.T @ other.axes
            along = plane @ axis if among else axis - plane @ axis
            sums += _squared(part, along / np.linalg.norm(along), other.point)
        return _share(*sums)

    @property
    def worst(self) -> float:
        """Largest slip held out of its rows."""
        return max(self.holdout(axis) for axis in self.fit.axes)

    @property
    def doubt(self) -> float:
        """By how much noise alone may raise a share, at two standard errors."""
        fast, fit = self.evidence.fast, self.fit
        _, speed = _squared(fast.total, fit.axes[0], fit.point)
        noise = squares(fast.noise, screws(fit.axes, fit.point)).max()
        return _share(2 * noise * np.sqrt(2 / fast.count), speed)


def _share(square: float, of: float) -> float:
    return float(np.sqrt(max(square, 0.0) / max(of, FINEST_SPEED**2)))


def squares(moment: Floats, lines: Floats) -> Floats:
    """Mean squares of rows."""
    return np.asarray(np.einsum("ki,ij,kj->k", lines, moment, lines))


def _squared(moment: Floats, axis: Floats, point: Floats) -> Floats:
    """Mean square of a point's speed along an axis, and of all of it, shape (2,)."""
    own, *each = squares(moment, screws(np.vstack([axis, np.eye(3)]), point))
    return np.array([own, sum(each)])


def tried(
    evidence: Evidence, rows: int, unknown: Floats = NOTHING, ground: Floats | None = None
) -> Trial:
    """Fit rows through one point.

    The point stays at 0 along directions given as unknown, shape (k, 3).  On a ground, whose normal
    is a unit vector (3,), body frame, motion is planar: the rows lie in the plane.
    """
    confined = np.eye(6)
    if ground is not None:
        unknown = np.vstack([unknown, ground])
        plane = np.eye(3) - np.outer(ground, ground)
        confined = scipy.linalg.block_diag(plane, np.eye(3) - plane)

    def solved(moment: Floats, start: Fit | None = None) -> Fit:
        # Rows out of the plane cost more than any in it.
        free = confined @ moment @ confined
        return fit(free + FIRM * np.trace(free) * (np.eye(6) - confined), rows, unknown, start)

    found, start = solved(evidence.fast.total / FINEST_SPEED**2), None
    for _ in range(_WEIGHINGS):
        lines = screws(found.axes, found.point)
        moments = evidence.moments(lines, evidence.slip(lines))
        total = moments.sum(axis=0)
        found = start = solved(total, start)
    unknown = found.unknown
    return Trial(evidence, found, tuple(solved(total - own, found) for own in moments))
