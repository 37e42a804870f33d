"""Why an arm cannot execute a motion, and what it could: more time, or another place."""

from __future__ import annotations

import copyreg
from typing import Any

import numpy as np

from noslip.constraints.system import ConstraintSystem
from noslip.errors import NoslipError, Refusal
from noslip.robots.kinematics import APART
from noslip.robots.model import NEAR
from noslip.robots.placement import Candidate, Placement, place
from noslip.robots.run import Run
from noslip.robots.timing import timed
from noslip.trajectory import PoseTrajectory

COARSE_SAMPLES = 1000
"""Samples of the tracking that looks for a feasible duration: it is tracked in full where it is
asked for."""
SPARE = 1.05
"""Share by which an offered duration is longer than the one that just reaches a limit: what the
coarse tracking misses."""


class InfeasibleMotionError(NoslipError, RuntimeError):
    """A motion that an arm cannot execute, and what it could.

    Attributes
    ----------
    limit : str
        "position", "velocity", "acceleration", "reach" or "collision".
    joint : str
        The joint (out of reach, the one nearest to its range's end), or the pair of bodies.
    time : float
        When (s).
    margin : float
        Negative: what is missing, as a share of the limit; m for reach and collision.
    duration : float or None
        Of the motion, with which it is feasible (s).
    placement : Placement or None
        The nearest one found at which it is feasible.
    """

    page = "arm"

    def __init__(
        self,
        message: str,
        *,
        limit: str,
        joint: str,
        time: float,
        margin: float,
        duration: float | None = None,
        placement: Placement | None = None,
    ) -> None:
        code = Refusal.NOT_FOUND if duration is None else Refusal.TOO_FAST
        super().__init__(message, code=code, duration=duration)
        self.limit, self.joint, self.time, self.margin = limit, joint, time, margin
        self.placement = placement

    def __reduce__(self) -> tuple[Any, ...]:
        # What the constructor insists on is among the attributes.
        return copyreg.__newobj__, (type(self), *self.args), vars(self)  # type: ignore[attr-defined]


def refusal(
    run: Run,
    motion: PoseTrajectory,
    duration: float | None,
    ramp: float,
    seed: int,
    *,
    searched: bool,
) -> InfeasibleMotionError:
    """Say why a motion is refused, and offer what is feasible: more time, or another place."""
    assert run.failure is not None
    limit, joint, sample, margin = run.failure
    robot, system = run.robot, run.system
    time = float(run.commanded.clock[min(sample, len(run.commanded) - 1)])
    asked = motion.duration if duration is None else duration
    longer, place_found = None, None
    # More time helps exactly where the path can be tracked without limits of rates.
    start = Candidate(run.placement, run.joints[0], 0.0)
    factor = 1.0
    for _ in range(3):
        coarse = _coarse(motion, system, factor * asked, ramp)
        slow = Run(robot, system, coarse, start, rates=False) if coarse is not None else None
        if slow is None or slow.failure is not None:
            break
        excess, kind, name, k = slow.demand()
        if factor == 1.0 and excess > 1:
            share = excess if kind == "velocity" else excess**2
            limit, joint, margin, time = kind, name, 1 - share, float(slow.commanded.clock[k])
        factor *= max(excess, 1.0) * SPARE
        coarse = _coarse(motion, system, factor * asked, ramp)
        if coarse is not None and Run(robot, system, coarse, start).failure is None:
            longer = factor * asked
            break
    if longer is None and run.distance < NEAR:
        through = Run(robot, system, run.asked, start, rates=False, apart=False)
        if through.failure is None and through.touched is not None:
            limit, joint = "collision", " and ".join(through.pair)
            margin, time = through.distance - APART, float(run.asked.clock[through.touched])
    if longer is None:
        again = _coarse(motion, system, asked, ramp)
        if again is not None:
            near = place(robot, again, near=run.placement, seed=seed)
            tracked = (c for c in near if Run(robot, system, again, c).failure is None)
            best = next(tracked, None)
            place_found = best.placement if best else None
    what = {
        "reach": f"the pose is {-1e3 * margin:.3g} mm out of reach",
        "collision": f"{joint} come as near as {1e3 * (margin + APART):.3g} mm",
    }.get(limit, f"{joint} exceeds its limit of {limit} by {-margin:.0%}")
    if longer is not None:
        advice = f"feasible in {longer:.3g} s instead of {asked:.3g} s"
    elif place_found is not None:
        x, y, z = place_found.middle(motion)
        advice = (
            f"feasible with the path's middle at {x:.3f},{y:.3f},{z:.3f} m, turned by "
            f"{np.degrees((place_found.rotation * run.placement.rotation.inv()).magnitude()):.0f}°"
        )
    elif searched:
        advice = "no feasible placement was found: make the path smaller, or slower"
    else:
        advice = "no feasible duration or placement was found near it"
    return InfeasibleMotionError(
        f"{motion.name}: {robot.name} cannot follow it at {time:.3g} s: {what}; {advice}",
        limit=limit,
        joint=joint,
        time=time,
        margin=margin,
        duration=longer,
        placement=place_found,
    )


def _coarse(
    motion: PoseTrajectory, system: ConstraintSystem, duration: float, ramp: float
) -> PoseTrajectory | None:
    """The motion at a lower rate, if its constraints stand that."""
    step = (duration + ramp) / COARSE_SAMPLES
    try:
        return timed(motion, system, duration=duration, ramp=ramp, time_step=step)
    except NoslipError:
        return None
