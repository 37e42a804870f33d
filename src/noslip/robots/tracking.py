"""A tool's motion as joints: tracked on time, without slip, within every limit, or refused."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from noslip.constraints.system import as_system
from noslip.errors import InputError
from noslip.robots.executed import Constraints, TrackedMotion
from noslip.robots.model import Robot
from noslip.robots.placement import Candidate, Level, Placement, place, postures
from noslip.robots.refusal import refusal
from noslip.robots.run import Run
from noslip.robots.timing import RAMP, TIME_STEP, timed
from noslip.trajectory import PoseTrajectory

TRIED = 4
"""Candidates that are tracked, the best first: each is a whole tracking."""


def track(
    robot: Robot,
    motion: PoseTrajectory,
    constraints: Constraints = (),
    *,
    placement: Placement | None = None,
    start: ArrayLike | None = None,
    level: Level = "recorded",
    duration: float | None = None,
    ramp: float = RAMP,
    time_step: float = TIME_STEP,
    refuse: bool = True,
    seed: int = 0,
) -> TrackedMotion:
    """Execute a tool's motion with an arm, kinematically.

    In each step the joints' velocities solve a quadratic program
    (:mod:`noslip.robots.kinematics`): the tool's equalities are rows of it, held exactly at the
    executed step; limits of joints and distances of bodies bound it.  The arm starts and ends at
    rest: the motion's clock starts and stops over a ramp, along the same path.

    Parameters
    ----------
    robot : Robot
    motion : PoseTrajectory
        Of the tool, in the frame that its constraints are written in.
    constraints : ConstraintSystem or constraints
        Equalities are held.
    placement : Placement, optional
        Where the motion's frame lies before the arm; by default searched (:func:`place`).
    start : array, shape (n,), optional
        Posture near which the arm starts; by default searched.
    level : "recorded" or "tool"
        For the search of a placement, see :meth:`Placement.of`.
    duration : float, optional
        Of the motion, without the ramps; by default its own (s).
    ramp : float
        Of the clock, at either end (s); 0 for a motion that begins and ends at rest, or whose
        constraints depend on time.
    time_step : float
        Of the joints' trajectory (s).
    refuse : bool
        Raise where the path cannot be tracked to 0.1 mm and 0.05 degrees.  Otherwise the motion's
        clock waits there: the tool falls behind, along its path and within all limits, and may
        take up to three times as long.
    seed : int
        Of the search.

    Returns
    -------
    TrackedMotion

    Raises
    ------
    InfeasibleMotionError
        If a limit is in the way; it names the joint, the time and the margin, and offers a
        duration or placement that is feasible, if one was found.
    InputError
        If an argument is not what it must be, or a constraint does not stand the ramps.
    """
    system = as_system(constraints)
    commanded = timed(motion, system, duration=duration, ramp=ramp, time_step=time_step)
    if start is not None:
        if placement is None:
            raise InputError("a start posture needs a placement too")
        given = np.asarray(start, dtype=np.float64)
        robot.forward(given)
        candidates = [Candidate(placement, given, 0.0)]
    elif placement is not None:
        candidates = postures(robot, commanded, placement, seed=seed)[:TRIED]
        candidates = candidates or [Candidate(placement, robot.home, 0.0)]
    else:
        candidates = place(robot, commanded, level=level, seed=seed)[:TRIED]
        if not candidates:
            # What the refusal speaks of: the path's middle at the home posture.
            where, _ = robot.forward(robot.home)
            shown = Placement.of(commanded, where, level=level)
            candidates = [Candidate(shown, robot.home, 0.0)]
    failures = []
    for candidate in candidates:
        run = Run(robot, system, commanded, candidate, refuse=refuse)
        if run.failure is None:
            return run.result()
        failures.append(run)
    raise refusal(failures[0], motion, duration, ramp, seed, searched=placement is None)
