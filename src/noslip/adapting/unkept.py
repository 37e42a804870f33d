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
    path, names = projected.trajectory, ", ".join(left_out)
    places = "ends or via points" if request.boundaries[2:] else "ends"
    asked = paces(_of_steps(path, request.begin), hard)
    kept = [pace for pace in asked if pace is not None]
    slowest = max(kept, key=lambda pace: pace.factor, default=None)
    remedies = [f"other {places}", "a way there that is demonstrated", "a priority above 0"]
    if slowest is None or len(kept) < len(asked) or slowest.factor == 1:
        return ConvergenceError(
            f"no motion found that keeps {names} between these {places}: give it "
            f"{', '.join(remedies[:-1])}, or {remedies[-1]}",
            code=Refusal.NOT_FOUND,
            iterate=path,
        )
    needed = slowest.needed(path.duration)
    told = f"no motion found that keeps {names} between these {places} in {path.duration:.4g} s"
    if any(boundary.moves for boundary in request.boundaries):
        # Slower, it would not begin or end as asked for: more time helps, how much is not known.
        return ConvergenceError(
            f"{told}: along its path it takes {needed} s or more; give it more time (duration), or "
            f"{remedies[-1]}",
            code=Refusal.NOT_FOUND,
            iterate=path,
        )
    return ConvergenceError(
        f"{told}: along its path it takes {needed} s; give it that (duration), or {remedies[-1]}",
        code=Refusal.TOO_FAST,
        iterate=stretched(path, slowest.factor),
        duration=float(needed),
    )


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
