"""One run: a generator in a loop with a robot, a sensor and a clock."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.feedback.conditions import Conditions
from benchmarks.feedback.generators import Generator
from benchmarks.feedback.plant import Plant
from benchmarks.feedback.poses import Floats
from benchmarks.feedback.sensing import Eye, Goal
from benchmarks.feedback.tasks import Task

LONGEST = 5.0
"""Over the duration: what takes longer has not finished."""
STAYS = 0.5
"""s for which a motion must stay finished."""
FARTHEST = 50.0
"""Over the path's length: what is commanded farther away has run away."""

Bools = np.ndarray[tuple[int], np.dtype[np.bool_]]


@dataclass(frozen=True, eq=False)
class Record:
    """What happened, one row a cycle.

    Attributes
    ----------
    times : array, shape (N,)
        When a pose was commanded (s).
    elapsed : array, shape (N,)
        Since the command before (s).
    commanded : array, shape (N, 7)
    executed : array, shape (N, 7)
        Just before the next command.
    touched : array of bool, shape (N,)
        Whether a hand or a force acted meanwhile.
    led : array of bool, shape (N,)
        Whether the command went where a hand held the tool.
    done : array of bool, shape (N,)
        What the generator says.
    goal : array, shape (3,)
        In truth, at the end.
    since : float
        What its time is counted from: when a goal moved that did so after the end (s).
    plans : int
    period : float
        Nominal (s).
    failure : str
        What ended it early.
    """

    times: Floats
    elapsed: Floats
    commanded: Floats
    executed: Floats
    touched: Bools
    led: Bools
    done: Bools
    goal: Floats
    since: float
    plans: int
    period: float
    failure: str = ""


Make = Callable[[], Generator]


def run(task: Task, make: Make, period: float, conditions: Conditions, seed: int) -> Record:
    """Run until it stays finished, or for too long."""
    # Each has numbers of its own, so that what one draws does not change the others.
    of_eye, of_goal, of_clock = (np.random.default_rng([seed, k]) for k in range(3))
    duration, length = task.duration, task.length
    disturbance, clock = conditions.disturbance, conditions.clock
    begin, over = disturbance.at * duration, disturbance.over(duration)
    silent = (begin, over) if disturbance.kind == "silence" else (0.0, 0.0)
    plant = Plant(conditions.robot, disturbance, task.start, duration, length)
    eye = Eye(conditions.sensor, of_eye, silent)
    goal = Goal(disturbance, task.goal, duration, length, of_goal)
    rows: list[Floats] = []
    flags: list[tuple[bool, bool, bool]] = []
    time, elapsed, finished, failure, generator = 0.0, period, np.inf, "", None
    try:
        generator = make()
        while time < LONGEST * duration:
            told = goal.told(time)
            command = generator.step(elapsed, eye.see(time, plant.pose), told)
            off = np.abs(command.position - task.goal.position).max()
            if not off < FARTHEST * length or not np.isfinite(command.quaternion).all():
                raise RuntimeError("ran away")
            before, done, is_led = elapsed, generator.done, generator.is_led
            elapsed = period
            if clock.jitter:
                elapsed *= 1 + clock.jitter * of_clock.uniform(-1, 1)
            if clock.late and of_clock.random() < clock.late:
                elapsed += clock.lateness * of_clock.uniform(0.3, 1)
            plant.advance(command, elapsed)
            rows.append(np.concatenate([[time, before], *command, *plant.pose]))
            flags.append((plant.is_touched, is_led, done))
            time += elapsed
            finished = min(finished, time) if done else np.inf
            if time >= max(finished, over) + STAYS:
                break
    except Exception as error:  # Whatever a generator raises within its loop ends it.
        failure = f"{type(error).__name__}: {str(error)[:100]}"
    table = np.array(rows).reshape(-1, 16)
    touched, led, done_at = np.array(flags, dtype=bool).reshape(-1, 3).T
    return Record(
        times=table[:, 0],
        elapsed=table[:, 1],
        commanded=table[:, 2:9],
        executed=table[:, 9:],
        touched=touched,
        led=led,
        done=done_at,
        goal=goal.true,
        since=begin if begin > duration else 0.0,
        plans=0 if generator is None else generator.plans,
        period=period,
        failure=failure,
    )
