"""Iterations of the trajectory projection, IPOPT and fatrop: ``python -m benchmarks.planner``.

The numerical example's primitive with its goal moved and both poses fixed, from the same first
guess to convergence; CPU time, and the least that the band would take at this machine's peak.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial
from time import process_time
from typing import Any

import numpy as np

from benchmarks import solvers
from benchmarks.control_loop import Floor, bandwidth, compiling, peak
from benchmarks.example import MOVED_GOAL, demonstration
from noslip import Blade, Boundary, PoseTrajectory, learn
from noslip.constraints import ConstraintSystem
from noslip.projection import planner
from noslip.projection.blend import through
from noslip.projection.heading import turn_edge_into_path
from noslip.projection.newton import GAUSS_NEWTON_STEPS, Plan
from noslip.projection.problem import Problem
from noslip.projection.request import ADAPTING, MAX_ITERATIONS, Request
from noslip.rule import Rule
from noslip.runtime.rollout import rollout

SAMPLES = (200, 1000, 4000, 20_000)
MOST_OF_PEERS = 1000
"""Samples of the largest problem for IPOPT and fatrop: they take up to 1.3 s, and 10 s to build."""
COMPILED_PEER = 200
"""Samples of the only problem for which IPOPT's functions are compiled, which takes 15 s."""
REPETITIONS = 7
SAME_COST = 1e-9
"""Relative: what counts as the same optimum."""


@cache
def _unconstrained(samples: int) -> PoseTrajectory:
    """What a primitive of the example wants, as an adaptation takes it."""
    law = learn(demonstration(), Blade()).law
    return rollout(law, Rule(), time_step=law.duration / (samples - 1))


@cache
def _problem(samples: int) -> Callable[[], Problem]:
    given, system = _unconstrained(samples), ConstraintSystem(Blade())
    ends = (
        Boundary.keeping(given, 0.0, "pose"),
        Boundary(1.0, np.array(MOVED_GOAL), given.rotations[-1]),
    )
    request = Request(through(given, ends), system, ends, ADAPTING)
    turns = turn_edge_into_path(request.reference, system, ADAPTING.rotation_smoothing).turns
    return partial(Problem, request, turns)


class Planning:
    """noslip's iterations, again and again from the same first guess."""

    def __init__(self, samples: int) -> None:
        self.plan = _problem(samples)().plan
        self._guess = self.plan.z.copy()
        self()

    def __call__(self) -> None:
        self.plan.z[:] = self._guess
        assert planner.solve(self.plan, MAX_ITERATIONS, 0.0)


def peer(name: str, samples: int, **options: Any) -> solvers.Solve:
    """Return a solver on the same problem, once it has found the same optimum."""
    ours, plan = Planning(samples).plan, _problem(samples)().plan
    solve: solvers.Solve = getattr(solvers, name)(plan, **options)
    least = solvers.cost(ours, ours.unknown)
    assert abs(solvers.cost(plan, solve()) - least) <= SAME_COST * least, f"{name}: another optimum"
    return solve


def floor(plan: Plan) -> tuple[Floor, Floor]:
    """What the band of all iterations asks of the machine; and with the rows' own functions."""
    count, size = len(plan.unknown), plan.stage.unknowns + plan.stage.rows
    columns, width = count * size, 2 * size
    # L D L^T takes half a square of multiplications and additions a column; its two triangles take
    # one of each an entry.
    operations = plan.iteration * columns * (width * (width + 1) + 4 * width)
    # Set up, read and written by the factorization, read by each triangle.
    numbers = columns * (width + 1)
    moved = plan.iteration * 8 * numbers * 5
    alone = Floor(operations, plan.iteration * numbers, moved, peak(), bandwidth(numbers))
    _, slope, curvature = (each.n_instructions() for each in plan.stage.functions)
    curved = max(0, plan.iteration - GAUSS_NEWTON_STEPS)
    more = count * ((plan.iteration + 1) * slope + curved * curvature)
    return alone, replace(alone, operations=operations + more)


def seconds(call: Callable[[], Any], repetitions: int = REPETITIONS) -> float:
    """Median CPU time of calls."""
    taken = []
    for _ in range(repetitions):
        begin = process_time()
        call()
        taken.append(process_time() - begin)
    return float(np.median(taken))


def main(samples: Sequence[int] = SAMPLES) -> None:
    """Print a row a number of samples."""
    names = (
        "NumPy",
        "compiled",
        "fatrop",
        "IPOPT",
        "IPOPT compiled",
        "band's floor",
        "with stages'",
    )
    print(f"{'samples':>7}", *(f"{name:>15}" for name in names))
    for count in samples:
        found: list[float | None] = []
        for is_compiled in (False, True):
            with compiling(is_compiled):
                ours = Planning(count)
                found.append(seconds(ours))
        for name, most, options in (
            ("fatrop", MOST_OF_PEERS, {}),
            ("ipopt", MOST_OF_PEERS, {}),
            ("ipopt", COMPILED_PEER, {"compiled": True}),
        ):
            found.append(seconds(peer(name, count, **options), 3) if count <= most else None)
        found += [each.seconds for each in floor(ours.plan)]
        told = ("-" if each is None else f"{1e3 * each:.2f} ms" for each in found)
        print(f"{count:7}", *(f"{each:>15}" for each in told), flush=True)


if __name__ == "__main__":
    main()
