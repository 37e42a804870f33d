"""Ways around obstacles beside OMPL's planners: ``python -m benchmarks.obstacles``.

A car of one point with a turning radius drives between random poses on a map of random discs, and
on street maps of the Moving AI Lab as Bench-MR uses them (``--scenarios`` names the folder with its
``.map`` and ``.map.scen`` files).  Both sides are given the same map, and CPU time of one core.
OMPL tests poses that are 0.1 of the radius apart, noslip proves that the way between its samples is
clear; each way that was found is tested again a hundred times as finely.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import single_threaded
from noslip.constraints.distance_field import DistanceField
from noslip.maneuvers.maneuver import integrated
from noslip.maneuvers.search import through

Floats = NDArray[np.float64]
Margins = Callable[[Floats], Floats]

try:
    from ompl import base, geometric, util

    MISSING = ""
except ImportError as error:
    base = geometric = util = None
    MISSING = f"OMPL is left out: {error}; pip install ompl"

PLANNERS = ("RRTConnect", "RRTstar", "BITstar")
SPACES = {"Dubins": "DubinsStateSpace", "Reeds-Shepp": "ReedsSheppStateSpace"}
STREET_RADIUS = 4.0
"""Cells; that of Bench-MR's template."""
RIM = 12
"""Free cells around a street map."""
PARTS = 3
"""Cells of the distances to a cell of a street map."""
FINENESS = 1e-3
"""Between samples of a way that is judged, in radii."""


@dataclass(frozen=True)
class Job:
    """From a pose to another on a map.

    Attributes
    ----------
    map : str
    margins : callable
        Distances of points (N, 2) from the obstacles (m).
    start, goal : 3 floats
        Position and heading (m, rad).
    radius : float
        Of the tightest turn (m).
    low, high : 2 floats
        Corners of what OMPL samples (m).
    """

    map: str
    margins: Margins
    start: tuple[float, ...]
    goal: tuple[float, ...]
    radius: float
    low: tuple[float, ...]
    high: tuple[float, ...]


@dataclass(frozen=True)
class Way:
    """What a planner found: its poses, finely, and the CPU time that it took (s)."""

    poses: Floats
    seconds: float

    @property
    def length(self) -> float:
        """Of the way (m)."""
        return float(np.sum(np.hypot(*np.diff(self.poses[:, :2], axis=0).T)))

    @property
    def turning(self) -> float:
        """All turns, this way and that (rad)."""
        turns = np.diff(self.poses[:, 2])
        return float(np.sum(np.abs((turns + np.pi) % (2 * np.pi) - np.pi)))

    @property
    def cusps(self) -> int:
        """Changes of direction."""
        steps, angle = np.diff(self.poses[:, :2], axis=0), self.poses[:-1, 2]
        along = steps[:, 0] * np.cos(angle) + steps[:, 1] * np.sin(angle)
        ways = np.sign(along[np.abs(along) > 1e-9])
        return int(np.sum(ways[1:] != ways[:-1]))


def random_jobs(count: int, seed: int = 0) -> Iterator[Job]:
    """Pairs of free poses on a map of 10 by 10 radii with 20 discs."""
    rng = np.random.default_rng(seed)
    centers, sizes = rng.uniform(0, 10, (20, 2)), rng.uniform(0.3, 0.8, 20)

    def margins(points: Floats) -> Floats:
        return np.min(np.linalg.norm(points[:, None] - centers, axis=2) - sizes, axis=1)

    def pose() -> tuple[float, ...]:
        while True:
            point = rng.uniform(0, 10, 2)
            if margins(point[None])[0] > 0.1:
                return (*point.tolist(), float(rng.uniform(-np.pi, np.pi)))

    for _ in range(count):
        yield Job("20 random discs", margins, pose(), pose(), 1.0, (-5.0, -5.0), (15.0, 15.0))


def street_jobs(folder: Path, count: int) -> Iterator[Job]:
    """The last scenarios of each street map, its longest, with both headings 0 as in Bench-MR."""
    for file in sorted(folder.glob("*.map")):
        rows = file.read_text().split("map\n", 1)[1].split()
        free = np.array([[cell == "." for cell in row] for row in rows]).T
        # Some goals are on the rim: there is a margin around the map, and then a wall.
        walls = np.pad(np.pad(~free, RIM), 1, constant_values=True)
        # A distance errs by up to half a cell's diagonal, and gates are one cell wide.
        fine = np.repeat(np.repeat(walls, PARTS, axis=0), PARTS, axis=1)
        field = DistanceField.from_grid(fine, 1 / PARTS, (-RIM - 1.0, -RIM - 1.0))

        def margins(points: Floats, field: DistanceField = field) -> Floats:
            return np.asarray(field.distance(np.column_stack([points, np.zeros(len(points))])))

        for line in file.with_name(f"{file.name}.scen").read_text().splitlines()[-count:]:
            x0, y0, x1, y1 = (float(word) + 0.5 for word in line.split("\t")[4:8])
            start, goal, high = (x0, y0, 0.0), (x1, y1, 0.0), np.add(free.shape, RIM).tolist()
            yield Job(file.stem, margins, start, goal, STREET_RADIUS, (-RIM, -RIM), high)


def ours(job: Job, reverse: bool) -> Way | None:
    """The way that noslip finds."""
    x, y, angle = job.start
    cosine, sine = np.cos(angle), np.sin(angle)
    turn = np.array([[cosine, sine], [-sine, cosine]])
    goal = turn @ np.subtract(job.goal[:2], (x, y))

    def clear(positions: Floats, quaternions: Floats) -> Floats:
        return job.margins(positions[:, :2] @ turn + (x, y))

    begun = time.process_time()
    found = through(*goal, job.goal[2] - angle, job.radius, clear, reverse=reverse)
    seconds = time.process_time() - begun
    if found is None:
        return None
    twists = []
    for each in found.stretches:
        parts = int(np.ceil(abs(each.advance) / (FINENESS * job.radius)))
        twists += parts * [each.twist / parts]
    positions, quaternions = integrated(np.array(twists).reshape(-1, 6))
    headings = angle + 2 * np.arctan2(quaternions[:, 3], quaternions[:, 0])
    return Way(np.column_stack([positions[:, :2] @ turn + (x, y), headings]), seconds)


def theirs(job: Job, space_name: str, planner: str, seconds: float) -> Way | None:
    """The way that a planner of OMPL's finds in so many seconds."""
    util.setLogLevel(util.LOG_NONE)
    util.RNG.setSeed(1)
    space = getattr(base, SPACES[space_name])(job.radius)
    bounds = base.RealVectorBounds(2)
    for axis in range(2):
        bounds.setLow(axis, job.low[axis])
        bounds.setHigh(axis, job.high[axis])
    space.setBounds(bounds)
    setup = geometric.SimpleSetup(space)

    def valid(state: Any) -> bool:
        return bool(job.margins(np.array([[state.getX(), state.getY()]]))[0] >= 0)

    setup.setStateValidityChecker(valid)
    information = setup.getSpaceInformation()
    information.setStateValidityCheckingResolution(0.1 * job.radius / space.getMaximumExtent())
    ends = []
    for x, y, heading in (job.start, job.goal):
        state = space.allocState()
        state.setX(x)
        state.setY(y)
        state.setYaw(heading)
        ends.append(state)
    setup.setStartAndGoalStates(*ends)
    setup.setPlanner(getattr(geometric, planner)(information))
    begun = time.process_time()
    # CPU time, as ours is measured: on a busy machine the wall's says little.
    spent = base.PlannerTerminationCondition(lambda: time.process_time() - begun > seconds)
    setup.solve(spent)
    taken = time.process_time() - begun
    if not setup.haveExactSolutionPath():
        return None
    path = setup.getSolutionPath()
    path.interpolate(int(np.ceil(path.length() / (FINENESS * job.radius))))
    return Way(np.array([[s.getX(), s.getY(), s.getYaw()] for s in path.getStates()]), taken)


def compare(
    jobs: list[Job], space_name: str, seconds: float, several: tuple[str, ...]
) -> list[str]:
    """Rows of the table for one map: what each found, beside the shortest that anybody found."""
    found: dict[str, list[Way | None]] = {}
    found["noslip"] = [ours(job, space_name == "Reeds-Shepp") for job in jobs]
    for planner in several:
        found[f"OMPL {planner}"] = [theirs(job, space_name, planner, seconds) for job in jobs]
    every = list(zip(*found.values(), strict=True))
    shortest = [min((way.length for way in ways if way), default=np.nan) for ways in every]
    solvable = int(np.sum(np.isfinite(shortest)))
    rows = []
    for name, ways in found.items():
        solved = [
            (job, way, best) for job, way, best in zip(jobs, ways, shortest, strict=True) if way
        ]
        if not solved:
            rows.append(f"| {jobs[0].map}, {space_name} | {name} | 0 of {solvable} | | | | | | |")
            continue
        ratios = [way.length / best for _, way, best in solved]
        touched = sum(np.min(job.margins(way.poses[:, :2])) < -1e-9 for job, way, _ in solved)
        length = sum(way.length for _, way, _ in solved)
        turning = sum(way.turning * job.radius for job, way, _ in solved)
        times = [way.seconds for _, way, _ in solved]
        rows.append(
            f"| {jobs[0].map}, {space_name} | {name} | {len(solved)} of {solvable} | {touched} "
            f"| {np.mean(ratios):.3f} | {np.max(ratios):.2f} | {turning / length:.2f} "
            f"| {np.mean([way.cusps for _, way, _ in solved]):.1f} "
            f"| {np.median(times):.2f} s, {np.max(times):.1f} s |"
        )
    return rows


HEADING = (
    "| map, curves | planner | solved | of these touch | length over the shortest found, mean "
    "| worst | turning, of the most | cusps | CPU time, median and most |\n"
    "|---|---|---|---|---|---|---|---|---|"
)


def run() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.obstacles", description=__doc__)
    parser.add_argument("--count", type=int, default=100, help="pairs of poses among the discs")
    parser.add_argument("--seed", type=int, default=0, help="of the discs and the pairs")
    parser.add_argument("--seconds", type=float, default=4.0, help="that OMPL has for each")
    parser.add_argument("--planners", nargs="*", default=PLANNERS, help="of OMPL")
    parser.add_argument("--scenarios", type=Path, help="folder of .map and .map.scen files")
    parser.add_argument("--streets", type=int, default=5, help="scenarios of each street map")
    given = parser.parse_args()
    if MISSING:
        print(MISSING, file=sys.stderr)
    planners = () if MISSING else tuple(given.planners)
    maps: dict[str, list[Job]] = {}
    for job in random_jobs(given.count, given.seed):
        maps.setdefault(job.map, []).append(job)
    for job in street_jobs(given.scenarios, given.streets) if given.scenarios else ():
        maps.setdefault(job.map, []).append(job)
    print(HEADING)
    for jobs in maps.values():
        for name in SPACES:
            print("\n".join(compare(jobs, name, given.seconds, planners)), flush=True)
    return 0


if __name__ == "__main__":
    single_threaded()
    sys.exit(run())
