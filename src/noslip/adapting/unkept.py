"""Limits that a plan does not keep: whether it is time that lacks, and what to do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from noslip.errors import ConvergenceError, Refusal
from noslip.projection.request import Request
from noslip.projection.result import ProjectedTrajectory
from noslip.runtime.timing import paces, stretched
from noslip.trajectory import PoseTrajectory


def unkept(
    request: Request, projected: ProjectedTrajectory, left_out: Sequence[str]
) -> ConvergenceError:
    """Return why a plan is refused that keeps the equalities, but not all hard limits together.

    Where it rests at its ends and keeps them if it is run through slower, it is too fast: the
    duration that suffices is told.  Else nothing says that there is no motion that keeps them.

    Parameters
    ----------
    request : Request
    projected : ProjectedTrajectory
        Onto the equalities alone.
    left_out : sequence of str
        The hard limits.
    """
    limits = request.system.limits
    hard = limits.part([name in left_out for name in limits.names])
    path = projected.trajectory
    asked = paces(_of_steps(path, request.begin), hard)
    kept = [pace for pace in asked if pace is not None]
    slowest = max(kept, key=lambda pace: pace.factor, default=None)
    if slowest is None or len(kept) < len(asked) or slowest.factor == 1:
        return not_found(request, left_out, path)
    needed = slowest.needed(path.duration)
    told = f"{_none_keeps(request, left_out)} in {path.duration:.4g} s"
    if any(boundary.moves for boundary in request.boundaries):
        # Slower, it would not begin or end as asked for: more time helps, how much is not known.
        return ConvergenceError(
            f"{told}: along its path it takes {needed} s or more; give it more time (duration), or "
            "a priority above 0",
            code=Refusal.NOT_FOUND,
            iterate=path,
        )
    return ConvergenceError(
        f"{told}: along its path it takes {needed} s; give it that (duration), or a priority above "
        "0",
        code=Refusal.TOO_FAST,
        iterate=stretched(path, slowest.factor),
        duration=float(needed),
    )


def not_found(request: Request, names: Sequence[str], best: PoseTrajectory) -> ConvergenceError:
    """Return that the search came to no motion that keeps some limits, and what to do."""
    return ConvergenceError(
        f"{_none_keeps(request, names)}: give it other {_places(request)}, a way there that is "
        "demonstrated, or a priority above 0",
        code=Refusal.NOT_FOUND,
        iterate=best,
    )


def broken(request: Request) -> list[str]:
    """Names of the hard limits on poses that a request's reference breaks."""
    limits = request.system.limits
    limits = limits.part([c.priority == 0 and c.level == "position" for c in limits.constraints])
    reference = request.reference
    rest = np.zeros_like(reference.positions)
    margins = limits.residuals(
        reference.times + request.begin, reference.positions, reference.quaternions, rest, rest
    )
    least = np.split(margins.min(axis=0), np.cumsum(limits.rows)[:-1])
    return [
        name for name, rows in zip(limits.names, least, strict=False) if rows.min(initial=0.0) < 0
    ]


def _none_keeps(request: Request, names: Sequence[str]) -> str:
    return f"no motion found that keeps {', '.join(names)} between these {_places(request)}"


def _places(request: Request) -> str:
    return "ends or via points" if request.boundaries[2:] else "ends"


def _of_steps(trajectory: PoseTrajectory, begin: float) -> PoseTrajectory:
    """Return a trajectory on the constraints' clock, with the velocities of its steps.

    Those of a sample are, as in a rollout, of the step that led to it; at the first, its own.
    """
    linear, angular = trajectory.step_velocities()
    return replace(
        trajectory,
        times=trajectory.times + begin,
        linear_velocities=np.vstack([trajectory.linear_velocities[:1], linear]),
        angular_velocities=np.vstack([trajectory.angular_velocities[:1], angular]),
    )
