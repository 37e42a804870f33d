"""Demonstrations as a distribution takes them: projected, apart from a reference, in a context."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from noslip import _arguments
from noslip._typing import Floats
from noslip.boundary import Boundary, End
from noslip.constraints.system import ConstraintSystem
from noslip.distribution.curves import FRACTIONS, Curves
from noslip.distribution.estimation import FEWEST
from noslip.distribution.retraction import Retraction
from noslip.errors import InputError
from noslip.law.fitting import evenly_sampled
from noslip.projection.request import ADAPTING, Request
from noslip.projection.trajectory import project_heeding_what_it_can
from noslip.trajectory import PoseTrajectory


def projected(
    trajectory: PoseTrajectory, system: ConstraintSystem, ends: tuple[End, End], functions: int
) -> PoseTrajectory:
    """Return a demonstration on the constraints, as learning projects it."""
    sampled = evenly_sampled(trajectory, functions)
    if not system.size:
        return sampled
    kept = (Boundary.keeping(sampled, at, end) for at, end in zip((0.0, 1.0), ends, strict=True))
    found: PoseTrajectory = project_heeding_what_it_can(
        Request(sampled, system, tuple(kept))
    ).trajectory
    return found


class Tangent:
    """Weights of curves -> those that lead along the constraints, to first order."""

    def __init__(self, reference: PoseTrajectory, system: ConstraintSystem, begin: float) -> None:
        self._points, self._kept = reference.points, dict[int, Floats]()
        self._space = reference.space
        self._retraction: Retraction | None = None
        if system.equalities.size:
            # What demonstrations have in common at their ends, curves along the constraints have.
            ends = tuple(Boundary.keeping(reference, at, "position") for at in (0.0, 1.0))
            if "position" in system.equalities.row_levels:
                ends = ()
            request = Request(reference, system.equalities, ends, ADAPTING, begin=begin)
            self._retraction = Retraction(request)

    def __call__(self, curves: Curves) -> Floats:
        if curves.count not in self._kept:
            self._kept[curves.count] = self._matrix(curves)
        return self._kept[curves.count]

    def _matrix(self, curves: Curves) -> Floats:
        size, channels, steps = curves.count, self._space.velocity_size, len(self._points)
        if self._retraction is None:
            return np.eye(channels * size)
        fractions = np.linspace(0.0, 1.0, steps)
        changes = np.zeros((steps, channels, channels, size))
        for channel in range(channels):
            changes[:, channel, channel] = curves.at(fractions)
        along = self._retraction.tangent(changes.reshape(steps, channels, -1), self._points)
        # Curves are smooth: between two steps, a chord is as good.
        nearest = np.interp(FRACTIONS, fractions, np.arange(steps))
        before = np.minimum(nearest.astype(int), steps - 2)
        share = (nearest - before)[:, None, None]
        seen = (1 - share) * along[before] + share * along[before + 1]
        found = np.einsum("sdw,sk->dkw", seen, curves.values)
        return np.asarray(found.reshape(channels * size, -1))


def deviations(trajectory: PoseTrajectory, reference: PoseTrajectory) -> Floats:
    """How a motion differs from the reference at the fractions, shape (101, n + 3 b)."""
    there, here = (
        each.resampled(times=each.times[0] + each.duration * FRACTIONS).points
        for each in (trajectory, reference)
    )
    return reference.space.difference(there, here)


def context_of(
    context: Mapping[str, Sequence[float]], count: int
) -> tuple[tuple[str, ...], Floats]:
    """Names and numbers, shape (count, c), of what demonstrations were made in."""
    columns = []
    for name, values in context.items():
        column = _arguments.numbers(f"context {name}", values)
        if column.shape != (count,) or not np.isfinite(column).all():
            raise InputError(
                f"context {name} must be {count} finite numbers, one a demonstration; got shape "
                f"{column.shape}"
            )
        if not np.ptp(column) > 0:
            raise InputError(f"context {name} is the same in all demonstrations: leave it out")
        columns.append(column)
    if count < FEWEST + len(columns):
        raise InputError(
            f"{len(columns)} numbers of context need {FEWEST + len(columns)} demonstrations or "
            f"more, got {count}"
        )
    return tuple(context), np.array(columns).T.reshape(count, len(columns))
