"""All generators in one run of a scenario; and the gains of one of them, tuned."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields
from functools import lru_cache, partial
from zlib import crc32

import numpy as np

from benchmarks import peers
from benchmarks.feedback import cartesian, tasks
from benchmarks.feedback.conditions import Conditions, Robot
from benchmarks.feedback.generators import Controlled, Generator, Literal, Plain
from benchmarks.feedback.judge import Bounds, Figures, judged
from benchmarks.feedback.loop import LONGEST, run
from benchmarks.feedback.scenarios import SCENARIOS, TUNING, Scenario

OURS = "noslip"
GENERATORS: dict[str, Callable[..., Generator]] = {
    OURS: Controlled,
    "without feedback": Plain,
    "fed back literally": Literal,
}
if not peers.MISSING:
    GENERATORS |= {
        "CartesianDMP, fed back": cartesian.Cartesian,
        "CartesianDMP, phase stopping": cartesian.PhaseStopping,
    }
NAMED = {scenario.name: scenario for scenario in (*SCENARIOS, TUNING)}


@dataclass(frozen=True)
class Trial:
    """What is run: names, the loop's rate (Hz), and the seed of all that is random."""

    scenario: str
    task: str
    rate: float
    seed: int
    generators: tuple[str, ...]


@dataclass(frozen=True)
class Outcome:
    """How one generator came out of a trial, and which bounds it broke."""

    scenario: str
    task: str
    rate: float
    seed: int
    generator: str
    figures: Figures
    broken: tuple[str, ...]
    beyond_lag: float


def conditions_of(scenario: Scenario, task: tasks.Task, rate: float, seed: int) -> Conditions:
    """Of a trial: alike for all generators, and unlike those of any other trial."""
    key = crc32(f"{scenario.name} {task.name} {rate:g}".encode())
    return scenario.draw(np.random.default_rng([seed, key]), task)


@lru_cache(maxsize=64)
def plain(task: str, rate: float, robot: Robot) -> Figures:
    """What a robot makes of the motion when nothing happens and nothing is fed back."""
    given = tasks.task(task)
    make = partial(Plain, given, 1 / rate)
    return judged(given, run(given, make, 1 / rate, Conditions(robot), 0))


def tried(trial: Trial) -> list[Outcome]:
    """Run it with each of the generators."""
    scenario, task = NAMED[trial.scenario], tasks.task(trial.task)
    conditions = conditions_of(scenario, task, trial.rate, trial.seed)
    bounds, own = scenario.bounds, None
    if np.isfinite(bounds.beyond_lag):
        own = plain(trial.task, trial.rate, conditions.robot)
    found = []
    for name in trial.generators:
        make = partial(GENERATORS[name], task, 1 / trial.rate, follows=scenario.follows)
        figures = judged(task, run(task, make, 1 / trial.rate, conditions, trial.seed))
        found.append(
            Outcome(
                trial.scenario,
                trial.task,
                trial.rate,
                trial.seed,
                name,
                figures,
                tuple(bounds.broken(figures, own)),
                np.nan if own is None else figures.path - own.path,
            )
        )
    return found


# ---------------------------------------------------------------- gains

TUNED_ON = ("s-cut", "wheel")
TUNING_RATE, TUNING_SEEDS = 200.0, range(1000, 1003)
WORST_RATIO = 10.0
"""Of a measure over its bound: what is worse counts as no worse."""


def cost(figures: Figures, bounds: Bounds) -> float:
    """Mean of a run's measures over their bounds; slip aside, which no gain of theirs changes."""
    ratios = []
    for field in fields(bounds):
        bound = getattr(bounds, field.name)
        if field.name in ("slip", "plans", "beyond_lag") or not np.isfinite(bound):
            continue
        value = getattr(figures, field.name)
        if field.name == "time" and not figures.finished:
            value = LONGEST
        ratios.append(min(value / bound, WORST_RATIO) if np.isfinite(value) else WORST_RATIO)
    return float(np.mean(ratios))


def cost_of_gains(gains: cartesian.Gains) -> float:
    """Mean cost of phase stopping over the held-out runs."""
    costs = []
    for name in TUNED_ON:
        task = tasks.task(name)
        make = partial(cartesian.PhaseStopping, task, 1 / TUNING_RATE, gains=gains)
        for seed in TUNING_SEEDS:
            conditions = conditions_of(TUNING, task, TUNING_RATE, seed)
            record = run(task, make, 1 / TUNING_RATE, conditions, seed)
            costs.append(cost(judged(task, record), TUNING.bounds))
    return float(np.mean(costs))


def trials(
    scenarios: Iterable[str],
    names: Iterable[str],
    rates: Sequence[float],
    seeds: Iterable[int],
    generators: tuple[str, ...],
) -> list[Trial]:
    """Every combination that there is, seed by seed; a goal that moves is not every task's."""
    names, scenarios = list(names), list(scenarios)
    return [
        Trial(scenario, name, rate, seed, generators)
        for seed in seeds
        for scenario in scenarios
        for name in names
        for rate in rates
        if not (NAMED[scenario].moves_goal and name == tasks.KEEPS_ITS_GOAL)
    ]
