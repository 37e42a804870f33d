"""A motion's clock for an arm: from rest to rest, at the arm's rate, on the constraints."""

from __future__ import annotations

import numpy as np

from noslip import _arguments
from noslip._typing import Floats
from noslip.constraints.system import as_system
from noslip.errors import InputError
from noslip.projection.trajectory import project_trajectory
from noslip.robots.executed import Constraints, slip
from noslip.trajectory import PoseTrajectory

TIME_STEP = 1e-3
"""Of the joints' trajectory (s): that of the arms' own interfaces."""
RAMP = 0.25
"""Time over which the motion's clock starts and stops (s): short beside work of seconds; the
shorter, the more it asks of the joints' accelerations."""
DISCRETE = 1e-7
"""Residual of the commanded motion above which it is projected onto the constraints anew: at 1e-7
m/s a tenth of a millimeter takes a quarter of an hour."""
RETIMING = 1e-2
"""Residual above which a constraint does not stand the ramps: far above what a projection
removes."""


def timed(
    motion: PoseTrajectory,
    constraints: Constraints = (),
    *,
    duration: float | None = None,
    ramp: float = RAMP,
    time_step: float = TIME_STEP,
) -> PoseTrajectory:
    """Return a motion at an arm's rate, from rest to rest.

    The clock runs with a quintic step's smoothness from 0 to 1 over the ramp, and back at the end,
    so that a motion of duration T takes ``T + ramp``.  A path sampled anew fulfills constraints on
    its steps only to the order of the step: it is projected onto them
    (:func:`noslip.project_trajectory`).

    Raises
    ------
    InputError
        If a constraint does not stand another timing.
    """
    system = as_system(constraints).equalities
    duration = motion.duration if duration is None else _arguments.positive("duration", duration)
    ramp = min(_arguments.not_negative("ramp", ramp), duration)
    time_step = _arguments.positive("time_step", time_step)
    steps = _arguments.samples("time_step", np.ceil((duration + ramp) / time_step - 1e-9))
    times: Floats = time_step * np.arange(max(steps, 3) + 1.0)
    clock = _clock(np.minimum(times, duration + ramp), duration, ramp) / duration
    if (
        ramp == 0
        and len(times) == len(motion)
        and np.allclose(times, motion.clock, rtol=0, atol=1e-9)
    ):
        return motion
    sampled = motion.resampled(times=motion.times[0] + clock * motion.duration)
    moved = sampled.with_points(sampled.points, times)
    if not system.size:
        return moved
    off = np.abs(slip(moved, system)).max(axis=0)
    linear, angular = moved.step_velocities()
    turned = np.linalg.norm(linear, axis=1).max() * np.linalg.norm(angular, axis=1).max()
    # Beside a step's length, which a coarser motion leaves.
    if off.max() > RETIMING + motion.period * turned:
        row = int(np.argmax(off))
        raise InputError(
            f"{motion.name}: {system.row_names[row]!r} is {off[row]:.3g} {system.row_units[row]} "
            "off when the motion is timed for an arm; it does not hold, or depends on time: give "
            "ramp=0 and the motion's own duration"
        )
    if off.max() <= DISCRETE:
        return moved
    projected: PoseTrajectory = project_trajectory(moved, system).trajectory
    return projected


def _clock(times: Floats, duration: float, ramp: float) -> Floats:
    """Time along the motion: its rate rises as a quintic step, and falls at the end."""
    if ramp == 0:
        return np.minimum(times, duration)

    def risen(u: Floats) -> Floats:
        u = np.clip(u, 0, 1)
        return np.asarray(ramp * u**4 * (2.5 - 3 * u + u**2))

    end = duration + ramp
    plain = np.clip(times - ramp, 0, duration - ramp)
    left = risen((end - times) / ramp)
    return np.asarray(np.clip(risen(times / ramp) + plain + ramp / 2 - left, 0, duration))
