"""A motion moved to other ends, projected, and a primitive fitted to it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from noslip import _arguments
from noslip.adapting.ends import require_feasible
from noslip.errors import ConvergenceError, InputError
from noslip.primitives.pose import SAMPLES_PER_BASIS_FUNCTION, PoseDMP
from noslip.projection.blend import through
from noslip.projection.request import Request
from noslip.projection.result import ProjectedTrajectory
from noslip.projection.trajectory import project_heeding_what_it_can

MOST_SAMPLES = 2001
"""An adapted motion is as smooth as its primitive; more samples than these add nothing."""
FEWEST_SAMPLES = 20
"""Fewer do not show where a motion bends once."""


@dataclass(frozen=True, eq=False)
class Adapted:
    """What an adaptation comes to.

    Attributes
    ----------
    primitive : PoseDMP
        Fitted to the projected trajectory.
    request : Request
        What was projected: the unconstrained motion, moved to the boundaries.
    projected : ProjectedTrajectory
    """

    primitive: PoseDMP
    request: Request
    projected: ProjectedTrajectory


def adapt(dmp: PoseDMP, request: Request) -> Adapted:
    """Adapt a motion to boundaries under constraints, and fit a primitive to it.

    Parameters
    ----------
    dmp : PoseDMP
        Whose constants the result has.
    request : Request
        Its reference is the motion as it is without constraints, of the duration wanted.

    Raises
    ------
    ConstraintError
        If a via violates a position-level constraint or hard limit.
    ConvergenceError
        If no motion is found.
    """
    duration = request.reference.duration
    for passed in request.fixed.values():
        if 0 < passed.at < 1:
            time = request.begin + passed.at * duration
            require_feasible(request.system, f"via at {passed.at:g}", time, passed)
    moved = through(request.reference, request.boundaries)
    adapted = carried_out(dmp, replace(request, reference=moved), dmp.steps)
    limits = request.system.limits
    left_out = [
        name
        for name, constraint in zip(limits.names, limits.constraints, strict=True)
        if constraint.priority == 0 and name in adapted.projected.left_out
    ]
    if left_out:
        raise ConvergenceError(
            f"no motion found that keeps {', '.join(left_out)} between these ends; give it more "
            "time (duration), other ends, or a priority above 0"
        )
    return adapted


def samples_of(dmp: PoseDMP, samples: int | None) -> int:
    """Return how many samples an adaptation takes."""
    if samples is None:
        return _samples_for(dmp.position.forcing.basis.count, dmp.steps)
    samples = _arguments.count("samples", samples, MOST_SAMPLES)
    if samples < FEWEST_SAMPLES:
        raise InputError(f"samples must be {FEWEST_SAMPLES} or more, got {samples}")
    return samples


def carried_out(dmp: PoseDMP, request: Request, steps: int) -> Adapted:
    """Project a reference that meets its boundaries, and fit a primitive of so many steps."""
    projected = project_heeding_what_it_can(request)
    trajectory = projected.trajectory
    basis, attractor = dmp.position.forcing.basis, dmp.position.attractor
    samples = _samples_for(basis.count, steps)
    if len(trajectory) < samples:
        times = np.linspace(trajectory.times[0], trajectory.times[-1], samples)
        trajectory = trajectory.resampled(times=times)
    fitted = PoseDMP.fit(
        trajectory,
        basis_functions=basis.count,
        alpha=attractor.alpha,
        beta=attractor.beta,
        alpha_s=dmp.phase.alpha_s,
    )
    return Adapted(replace(fitted, steps=steps), request, projected)


def _samples_for(basis_functions: int, steps: int) -> int:
    return min(max(steps, SAMPLES_PER_BASIS_FUNCTION * basis_functions) + 1, MOST_SAMPLES)
