"""Goals that move: what the published method makes of them, and noslip's two answers.

The goal of the numerical example is shifted from the start, its orientation kept.  The published
method optimizes the orientation at each step on the way to the new goal; its trained primitive, the
orientation as optimized for the old goal, has the coupling term alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks import paper_method
from benchmarks.example import ALPHA, ALPHA_S, BASIS_FUNCTIONS, BETA, demonstration
from noslip import Blade, PoseTrajectory, learn
from noslip.merit import figures_of_merit

Floats = NDArray[np.float64]

SHIFTS = (0.02, 0.05, 0.2)
"""Meters; the path is 2.35 m long."""
OPTIMIZED, COUPLED = "paper, BFGS at each step", "paper, coupling term alone"
ROLLED_OUT, ADAPTED = "noslip, rollout to the goal", "noslip, adapt"
TO_THE_DEMONSTRATED = "noslip, adapt to the demonstrated end"


@dataclass(frozen=True)
class Arrival:
    """Where one method's motion ends, and how it gets there.

    Attributes
    ----------
    method, direction : str
    shift : float
        Of the goal (m).
    position : float
        Distance from the goal at the end (m).
    rotation : float
        Angle from where the method itself ends if the goal does not move (rad).
    from_demonstrated : float
        Angle from the demonstrated end (rad), the orientation goal of the published method.
    residual : float
        Largest slip (m/s).
    angular_speed : float
        Largest of the steps (rad/s).
    """

    method: str
    direction: str
    shift: float
    position: float
    rotation: float
    from_demonstrated: float
    residual: float
    angular_speed: float


def move_goals(
    *,
    samples: int,
    basis_functions: int = BASIS_FUNCTIONS,
    shifts: Sequence[float] = SHIFTS,
    progress: Callable[[str], None] = lambda message: None,
) -> list[Arrival]:
    """Shift the goal in four directions by each distance; the first arrivals are unshifted."""
    given = demonstration(samples)
    goal, turned = given.positions[-1], given.rotations[-1]
    progress("goals: unmoved")
    methods = _methods(given, basis_functions)
    unmoved = {name: move(goal) for name, move in methods.items()}
    ends = {name: motion.rotations[-1] for name, motion in unmoved.items()}
    y = np.array([0.0, 1.0, 0.0])
    directions = {
        "blade's y as demonstrated": turned.apply(y),
        "blade's y as it arrives": ends[OPTIMIZED].apply(y),
        "world x": np.array([1.0, 0.0, 0.0]),
        "world y": y,
    }

    def arrival(
        method: str, direction: str, shift: float, to: Floats, motion: PoseTrajectory
    ) -> Arrival:
        merit = figures_of_merit(motion, motion, Blade())
        return Arrival(
            method,
            direction,
            shift,
            position=float(np.linalg.norm(motion.positions[-1] - to)),
            rotation=_angle(motion.rotations[-1], ends[method]),
            from_demonstrated=_angle(motion.rotations[-1], turned),
            residual=merit.residual_peak,
            angular_speed=merit.angular_speed_peak,
        )

    arrivals = [arrival(name, "unmoved", 0.0, goal, motion) for name, motion in unmoved.items()]
    for direction, unit in directions.items():
        for shift in shifts:
            progress(f"goals: {direction}, {shift:g} m")
            to = goal + shift * unit
            arrivals += [
                arrival(name, direction, shift, to, move(to)) for name, move in methods.items()
            ]
    return arrivals


def _methods(
    given: PoseTrajectory, basis_functions: int
) -> dict[str, Callable[[Floats], PoseTrajectory]]:
    """Return each method's motion to a goal position."""
    primitives = paper_method.UncoupledPrimitives.fit(given, basis_functions)
    turning = paper_method.rollout(primitives).turning
    dmp = learn(
        given, Blade(), basis_functions=basis_functions, alpha=ALPHA, beta=BETA, alpha_s=ALPHA_S
    )
    time_step = given.duration / (len(given) - 1)

    def published(to: Floats, turning: Floats | None = None) -> PoseTrajectory:
        return paper_method.rollout(primitives, goal_position=to, turning=turning).motion

    def adapted(to: Floats, rotation: Rotation | None = None) -> PoseTrajectory:
        primitive = dmp.adapt(goal_position=to, goal_rotation=rotation)
        return primitive.rollout(time_step=time_step)

    return {
        OPTIMIZED: published,
        COUPLED: partial(published, turning=turning),
        ROLLED_OUT: lambda to: dmp.rollout(goal_position=to, time_step=time_step),
        ADAPTED: adapted,
        TO_THE_DEMONSTRATED: partial(adapted, rotation=given.rotations[-1]),
    }


def _angle(first: Rotation, second: Rotation) -> float:
    return float((first * second.inv()).magnitude())
