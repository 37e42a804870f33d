"""Which goals are reached, and how: ``python -m benchmarks.reach``.

A straight demonstration of 1 m is learned under the constraints of a tool and adapted to goals all
around it.  Cars with a turning radius reach every pose (Dubins 1957), those that may back up by
ways as short as Reeds and Shepp's (1990): none may be refused.  What is asked of all others is to
be reached or refused for a reason that is true; each refusal is printed.
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
import time
import warnings
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import noslip as ns
from benchmarks import single_threaded
from noslip.constraints import AngularRateLimit, ForwardOnly, Needle, TurningRadius, Wheel
from noslip.constraints.check import step_accelerations, step_residuals
from noslip.errors import NoslipError, NoslipWarning
from noslip.maneuvers.planar import dubins, reeds_shepp

Floats = NDArray[np.float64]

RADIUS, AROUND = 0.3, 1.5
"""Turning radius, and how far goals lie along each axis (m)."""
RATE = 1.0
"""Of tools that may not turn faster (rad/s)."""
STEPS = (None, 1e-3, 0.0137)
"""Of rollouts (s): by default, of a control loop, and one that divides nothing."""
NEAR, NEAR_TURN, NEAR_SHARE, FAR = 1e-4, 1e-3, 0.98, 1e-3
"""Ends within so many m and rad in so many cases, and within so many m in all."""
LONGER, LONGER_SHARE, LONGEST, REVERSED = 1.05, 0.95, 1.2, 1.05
"""Times the shortest way in so many cases, in all, and in all where it may back up."""
MARGIN, SLIP = -1e-9, 1e-10
HARDER, SLOWER = 3.0, 2.0
"""Times the largest angular acceleration, and the median of the computing time, of what is adapted
without a maneuver."""


@dataclass(frozen=True)
class Job:
    """One adaptation.

    Attributes
    ----------
    group, case : str
        What it is counted with, and what it is.
    constraints : tuple of Constraint
    options : dict
        Of :meth:`noslip.ConstrainedDMP.adapt`.
    shortest : float or None
        Length of the shortest way (m), where that is known.
    """

    group: str
    case: str
    constraints: tuple[ns.Constraint, ...]
    options: Mapping[str, Any]
    shortest: float | None = None


@dataclass
class Outcome:
    """What became of a job; figures are NaN, and lists empty, if it was refused."""

    job: Job
    refused: str = ""
    maneuver: str = ""
    notes: list[str] = field(default_factory=list)
    ends: list[float] = field(default_factory=list)
    """Distance from the goal with each of the steps (m)."""
    turns: list[float] = field(default_factory=list)
    margins: list[float] = field(default_factory=list)
    slip: float = np.nan
    length: float = np.nan
    duration: float = np.nan
    turning_rate: float = np.nan
    acceleration: float = np.nan
    seconds: float = np.nan

    @property
    def longer(self) -> float:
        """Its length over the shortest one."""
        return self.length / self.job.shortest if self.job.shortest else np.nan

    def __str__(self) -> str:
        if self.refused:
            return self.refused
        how = self.maneuver or "no maneuver"
        return f"reached: {how}; {self.length:.3g} m in {self.duration:.3g} s"


def demonstration() -> ns.PoseTrajectory:
    """Straight along x, 1 m in 2 s, from rest to rest with the least jerk."""
    s = np.linspace(0, 1, 201)
    positions = np.outer(10 * s**3 - 15 * s**4 + 6 * s**5, [1.0, 0.0, 0.0])
    return ns.PoseTrajectory(2 * s, positions, Rotation.identity(len(s)), name="straight")


@lru_cache(maxsize=32)
def primitive(constraints: tuple[ns.Constraint, ...]) -> ns.ConstrainedDMP:
    """Of the demonstration, all that is compiled for it at hand."""
    learned = ns.learn(demonstration(), list(constraints))
    learned.compile()
    learned.adapt(goal_position=[1.01, 0, 0])
    return learned


def attempt(job: Job) -> Outcome:
    """Adapt, roll out, and measure."""
    learned, outcome = primitive(job.constraints), Outcome(job)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always", NoslipWarning)
        begun = time.process_time()
        try:
            adapted = learned.adapt(**job.options)
            motions = [adapted.rollout(time_step=step) for step in STEPS]
        except NoslipError as error:
            code = getattr(error, "code", None)
            outcome.refused = f"{code or type(error).__name__}: {error}"
        outcome.seconds = time.process_time() - begun
    outcome.notes = [str(each.message) for each in told]
    if outcome.refused:
        return outcome
    outcome.seconds = _adapting_alone(learned, job)
    outcome.maneuver = str(getattr(adapted.record[-1], "maneuver", "") or "")
    position = job.options.get("goal_position", learned.goal_position)
    rotation = job.options.get("goal_rotation", learned.goal_rotation)
    limits = [each for each in job.constraints if each.relation == "nonnegative"]
    equalities = [each for each in job.constraints if each.relation == "zero"]
    for motion in motions:
        outcome.ends.append(float(np.linalg.norm(motion.positions[-1] - position)))
        outcome.turns.append(float((motion.rotations[-1] * rotation.inv()).magnitude()))
        if limits:
            outcome.margins.append(float(step_residuals(motion, limits).min()))
    motion = motions[0]
    outcome.slip = float(max(np.abs(step_residuals(m, equalities)).max() for m in motions))
    outcome.length, outcome.duration = motion.path_length, motion.duration
    outcome.turning_rate = float(np.linalg.norm(motion.step_velocities()[1], axis=1).max())
    outcome.acceleration = float(np.linalg.norm(step_accelerations(motion)[1], axis=1).max())
    return outcome


def _adapting_alone(learned: ns.ConstrainedDMP, job: Job) -> float:
    """CPU time (s) of an adaptation that was done before."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NoslipWarning)
        begun = time.process_time()
        learned.adapt(**job.options)
        return time.process_time() - begun


# ---------------------------------------------------------------- what is asked


def cars(group: str, tool: ns.Constraint, count: int, *, reverse: bool = False) -> Iterator[Job]:
    """Poses in the plane at random."""
    rng = np.random.default_rng(19)
    bend = TurningRadius(RADIUS, reverse=True) if reverse else TurningRadius(RADIUS)  # type: ignore[call-arg]
    shortest = reeds_shepp if reverse else dubins
    for _ in range(count):
        x, y = rng.uniform(-AROUND, AROUND, 2)
        heading = rng.uniform(-np.pi, np.pi)
        options = _to([x, y, 0.0], [0, 0, heading]) | ({"reverse": True} if reverse else {})
        way = shortest(x, y, heading, RADIUS)[0].length
        case = f"x={x:.17g}, y={y:.17g}, heading={heading:.17g}"
        yield Job(group, case, (tool, bend), options, way)


def in_space(count: int) -> Iterator[Job]:
    """Poses of a blade in space at random."""
    rng = np.random.default_rng(20)
    constraints = (ns.Blade(), ForwardOnly(), TurningRadius(RADIUS))
    for _ in range(count):
        position = rng.uniform(-AROUND, AROUND, 3)
        turn = Rotation.random(random_state=rng).as_rotvec()
        case = f"position={position.tolist()}, turn={turn.tolist()}"
        yield Job("blade in space", case, constraints, _to(position, turn))


def turned_about() -> Iterator[Job]:
    """Starts that are turned, goals straight behind, and the start itself."""
    tools = {"wheel": Wheel(), "blade": ns.Blade(), "needle": Needle()}
    asked: dict[str, Mapping[str, Any]] = {
        f"start turned by {degrees}°": {
            "start_rotation": Rotation.from_euler("z", degrees, degrees=True)
        }
        for degrees in (90, 180)
    }
    asked |= {f"goal {way:g} m behind": _to([-way, 0, 0], [0, 0, 0]) for way in (0.5, 3.0)}
    asked["goal = start"] = _to([0, 0, 0], [0, 0, 0])
    asked |= {
        f"turn by {degrees}° where it stands": _to([0, 0, 0], [0, 0, np.radians(degrees)])
        for degrees in (90, 180)
    }
    rules: dict[str, tuple[ns.Constraint, ...]] = {
        "": (),
        ", forward only": (ForwardOnly(),),
        f", {RATE:g} rad/s": (AngularRateLimit(RATE),),
    }
    for name, tool in tools.items():
        for rule, limits in rules.items():
            for case, options in asked.items():
                yield Job("single", f"{name}{rule}: {case}", (tool, *limits), options)
    bends = (Wheel(), TurningRadius(RADIUS), AngularRateLimit(RATE))
    for case, options in asked.items():
        yield Job("single", f"car, {RATE:g} rad/s: {case}", bends, options)


def _to(position: Any, turn: Any) -> dict[str, Any]:
    return {
        "goal_position": np.asarray(position, float),
        "goal_rotation": Rotation.from_rotvec(np.asarray(turn, float)),
    }


GROUPS = {
    "car with a wheel": lambda count: cars("car with a wheel", Wheel(), count),
    "car with a blade": lambda count: cars("car with a blade", ns.Blade(), count),
    "car that reverses": lambda count: cars(
        "car that reverses", Wheel(), -(-count // 5), reverse=True
    ),
    "blade in space": lambda count: in_space(-(-2 * count // 5)),
    "single": lambda count: turned_about(),
}
"""Jobs of each kind, for so many of the first."""
CARS = tuple(name for name in GROUPS if name.startswith("car"))


# ---------------------------------------------------------------- what is told


def table(outcomes: Mapping[str, Sequence[Outcome]]) -> Iterator[str]:
    """Lines of Markdown, one a group of random goals."""
    yield (
        "| goals | reached | end, mm (98 %, all) | end, mrad (98 %) | over the shortest way (95 %, "
        "all) | least margin: default step, 1 ms, 13.7 ms | slip, m/s | angular acceleration over "
        "that without a maneuver (medians, largest) | CPU time over that (medians, largest) |"
    )
    yield "|---|---|---|---|---|---|---|---|---|"
    for name, several in outcomes.items():
        if name == "single":
            continue
        reached = [each for each in several if not each.refused]
        if not reached:
            yield f"| {name} | 0 of {len(several)} |" + " |" * 7
            continue
        longer = _of(reached, "longer")
        ends, turns = (np.array([getattr(e, key)[0] for e in reached]) for key in ("ends", "turns"))
        margins = np.min([each.margins for each in reached], axis=0)
        harder = _over(reached, "acceleration")
        slower = _over(reached, "seconds")
        yield (
            f"| {name} | {len(reached)} of {len(several)} | "
            f"{1e3 * np.quantile(ends, NEAR_SHARE):.2g}, {1e3 * ends.max():.2g} | "
            f"{1e3 * np.quantile(turns, NEAR_SHARE):.2g} | "
            f"{np.quantile(longer, LONGER_SHARE):.3f}, {longer.max():.3f} | "
            f"{', '.join(f'{margin:.0e}' for margin in margins)} | "
            f"{max(each.slip for each in reached):.0e} | "
            f"{harder[0]:.2g}, {harder[1]:.2g} | {slower[0]:.2g}, {slower[1]:.2g} |"
        )


def _over(outcomes: Sequence[Outcome], name: str) -> tuple[float, float]:
    """Median and largest of those with a maneuver, over those of the others."""
    found = [_of([e for e in outcomes if bool(e.maneuver) is led], name) for led in (True, False)]
    if not all(map(len, found)):
        return np.nan, np.nan
    (median, most), (usual, usual_most) = [(np.median(each), each.max()) for each in found]
    return float(median / usual), float(most / usual_most)


def _of(outcomes: Sequence[Outcome], name: str) -> Floats:
    return np.array([getattr(each, name) for each in outcomes])


def ways(outcomes: Mapping[str, Sequence[Outcome]]) -> Iterator[str]:
    """How often each maneuver led there, and what was refused."""
    for name, several in outcomes.items():
        if name == "single":
            continue
        taken = Counter(
            each.maneuver.rsplit(", ", 1)[0] or "none" for each in several if not each.refused
        )
        yield f"{name}: " + ", ".join(f"{way} {count}" for way, count in taken.most_common())
        for each in several:
            if each.refused:
                yield f"  refused: {each.job.case}: {each.refused}"


def failures(outcomes: Mapping[str, Sequence[Outcome]]) -> Iterator[str]:
    """What is not as it must be, one line each."""
    for name, several in outcomes.items():
        for each in several:
            where = f"{name}: {each.job.case}"
            if each.refused:
                if name in CARS:
                    yield f"{where}: refused, though every pose can be reached: {each.refused}"
                continue
            if not max(each.ends) <= FAR:
                yield f"{where}: ends {max(each.ends):.3g} m off"
            if each.margins and not min(each.margins) >= MARGIN:
                yield f"{where}: margins {each.margins}"
            if not each.slip <= SLIP:
                yield f"{where}: slips by {each.slip:.3g}"
            longest = REVERSED if each.job.options.get("reverse") else LONGEST
            if name in CARS and not each.longer <= longest:
                yield f"{where}: {each.longer:.3g} times the shortest way ({each.maneuver})"
        if name in CARS:
            yield from _shares(name, [each for each in several if not each.refused])


def _shares(name: str, reached: Sequence[Outcome]) -> Iterator[str]:
    if not reached:
        return
    near = np.mean([each.ends[0] <= NEAR and each.turns[0] <= NEAR_TURN for each in reached])
    if not near >= NEAR_SHARE:
        yield f"{name}: {near:.1%} end within {NEAR:g} m and {NEAR_TURN:g} rad"
    short = np.mean(_of(reached, "longer") <= LONGER)
    if not short >= LONGER_SHARE:
        yield f"{name}: {short:.1%} are at most {LONGER:g} times as long as the shortest way"
    harder, slower = _over(reached, "acceleration")[1], _over(reached, "seconds")[0]
    if harder > HARDER:
        yield f"{name}: {harder:.3g} times the angular acceleration of those without a maneuver"
    if slower > SLOWER:
        yield f"{name}: maneuvers take {slower:.3g} times the time of those without"


def main(arguments: Sequence[str] | None = None) -> int:
    """Adapt, print tables; the exit code is 1 if anything is not as it must be."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=500, help="cars; of others in proportion")
    parser.add_argument("--groups", nargs="*", choices=GROUPS, default=list(GROUPS))
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args(arguments)
    jobs = [job for name in options.groups for job in GROUPS[name](options.count)]
    outcomes: dict[str, list[Outcome]] = defaultdict(list)
    # Of the processes that are started.
    single_threaded()
    with multiprocessing.get_context("spawn").Pool(options.processes) as pool:
        for outcome in pool.imap(attempt, jobs, 4):
            outcomes[outcome.job.group].append(outcome)
    print("\n".join(table(outcomes)))
    print()
    print("\n".join(ways(outcomes)))
    for outcome in outcomes["single"]:
        print(f"{outcome.job.case}: {outcome}")
        for note in outcome.notes:
            print(f"  told: {note}")
    failed = list(failures(outcomes))
    print(f"\n{len(jobs)} goals, {len(failed)} failures")
    print("\n".join(failed), file=sys.stderr)
    return bool(failed)


if __name__ == "__main__":
    sys.exit(main())
