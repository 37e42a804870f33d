"""Iterations of the trajectory projection alone: ``python -m benchmarks.planner``.

The numerical example's primitive with its goal moved and both poses fixed, in NumPy and compiled;
CPU time.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import cache
from time import process_time

import numpy as np

from benchmarks.example import MOVED_GOAL, demonstration
from noslip import Blade, Boundary, PoseTrajectory, learn
from noslip.constraints import ConstraintSystem
from noslip.projection import planner
from noslip.projection.blend import through
from noslip.projection.heading import turn_edge_into_path
from noslip.projection.problem import Problem
from noslip.projection.request import ADAPTING, Request
from noslip.rule import Rule
from noslip.runtime.rollout import rollout

SAMPLES = (200, 1000, 4000, 20_000)
REPETITIONS = 7


@cache
def _unconstrained(samples: int) -> PoseTrajectory:
    """What a primitive of the example wants, as an adaptation takes it."""
    law = learn(demonstration(), Blade()).law
    return rollout(law, Rule(), time_step=law.duration / (samples - 1))


def seconds(samples: int, compiled: bool) -> float:
    """Median time that the iterations take, from the first guess to convergence."""
    os.environ["NOSLIP_COMPILE"] = "1" if compiled else "0"
    given, system = _unconstrained(samples), ConstraintSystem(Blade())
    ends = (
        Boundary.keeping(given, 0.0, "pose"),
        Boundary(1.0, np.array(MOVED_GOAL), given.rotations[-1]),
    )
    request = Request(through(given, ends), system, ends, ADAPTING)
    turns = turn_edge_into_path(request.reference, system, ADAPTING.rotation_smoothing).turns
    taken = []
    for _ in range(REPETITIONS + 1):
        problem = Problem(request, turns)
        begin = process_time()
        converged = planner.solve(problem.plan, request.max_iterations, 0.0)
        taken.append(process_time() - begin)
        assert converged
    # The first one builds and compiles.
    return float(np.median(taken[1:]))


def main(samples: Sequence[int] = SAMPLES) -> None:
    print("samples      NumPy   compiled")
    for count in samples:
        slow, fast = (1e3 * seconds(count, compiled) for compiled in (False, True))
        print(f"{count:7} {slow:7.1f} ms {fast:7.2f} ms")


if __name__ == "__main__":
    main()
