"""What may happen to a motion, and what it may cost: the list that the table is made of."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.feedback.conditions import Clock, Conditions, Disturbance, Kind, Robot, Sensor
from benchmarks.feedback.judge import Bounds
from benchmarks.feedback.tasks import Task

Draw = Callable[[np.random.Generator, Task], Conditions]

DEGREE = np.pi / 180
NOISE, TURNING_NOISE = 0.5e-3, 0.3 * DEGREE
"""At most (m, rad): what motion capture and visual trackers have."""
BIAS = 0.025
"""At most, over the path's length."""
USUAL = Conditions(
    Robot(lag=0.03, delay=0.005),
    Sensor(rate=100.0, noise=0.1e-3, turning_noise=0.05 * DEGREE),
)
"""On which disturbances happen: an arm under its maker's position control and encoders."""

MEDIAN_END = 5e-4
"""Of a scenario's distances from the goal over the path's length."""
UNDISTURBED = Bounds(time=1.03, plans=0, beyond_lag=1e-4, end=4e-3, drift=1e-9)
WORST = replace(UNDISTURBED, time=1.7, plans=2)
WAITING = Bounds(time=1.25, plans=2, end=4e-3)
FOLLOWING = replace(WAITING, time=2.0)
NEW_GOAL = replace(WAITING, time=1.75)
TWO_GOALS = replace(NEW_GOAL, plans=4)
MOVING_GOAL = replace(NEW_GOAL, plans=np.inf)


@dataclass(frozen=True)
class Scenario:
    """A recipe for runs.

    Attributes
    ----------
    name : str
    draw : callable
        Conditions for a task, from random numbers.
    bounds : Bounds
    follows : bool
        Whether the robot is compliant, and the generator is told so.
    moves_goal : bool
    """

    name: str
    draw: Draw
    bounds: Bounds
    follows: bool = False
    moves_goal: bool = False


def lagging(random: np.random.Generator) -> Robot:
    """Lag up to 100 ms, delay up to 20 ms."""
    return Robot(lag=random.uniform(0, 0.1), delay=random.uniform(0, 0.02))


def seeing(random: np.random.Generator) -> Sensor:
    """Noise up to 0.5 mm and 0.3 degrees, 30 to 120 Hz."""
    return Sensor(
        rate=random.uniform(30, 120),
        noise=random.uniform(0, NOISE),
        turning_noise=random.uniform(0, TURNING_NOISE),
    )


def biased(random: np.random.Generator, task: Task, share: float) -> tuple[float, float, float]:
    """A bias of a share of the path's length, in any direction (m)."""
    direction = random.normal(size=3)
    x, y, z = (share * task.length * direction / np.linalg.norm(direction)).tolist()
    return x, y, z


def _ideal(random: np.random.Generator, task: Task) -> Conditions:
    return Conditions()


def _lag(random: np.random.Generator, task: Task) -> Conditions:
    return Conditions(lagging(random), Sensor(rate=120))


def _uneven(random: np.random.Generator, task: Task) -> Conditions:
    robot = replace(lagging(random), turning_lag=random.uniform(0, 0.1))
    return Conditions(robot, Sensor(rate=120))


def _impedance(random: np.random.Generator, task: Task) -> Conditions:
    return Conditions(_compliant(random), Sensor(rate=120))


def _compliant(random: np.random.Generator) -> Robot:
    """Critically damped or a little less; 20 rad/s lag by 100 ms."""
    return Robot(frequency=random.uniform(20, 60), damping=random.uniform(0.7, 1.0))


def _noise(random: np.random.Generator, task: Task) -> Conditions:
    return Conditions(sensor=Sensor(rate=120, noise=NOISE, turning_noise=TURNING_NOISE))


def _bias(random: np.random.Generator, task: Task) -> Conditions:
    share = random.uniform(0, BIAS)
    return Conditions(sensor=Sensor(rate=120, bias=biased(random, task, share)))


def _slow_sensor(random: np.random.Generator, task: Task) -> Conditions:
    return Conditions(USUAL.robot, replace(USUAL.sensor, rate=30, age=random.uniform(0, 0.03)))


def _all_at_once(random: np.random.Generator, task: Task) -> Conditions:
    bias = biased(random, task, random.uniform(0, BIAS))
    return Conditions(lagging(random), replace(seeing(random), bias=bias))


def _clock(random: np.random.Generator, task: Task) -> Conditions:
    return replace(USUAL, clock=Clock(jitter=0.1, late=0.01, lateness=0.01))


def _worst(random: np.random.Generator, task: Task) -> Conditions:
    sensor = Sensor(
        rate=30,
        noise=NOISE,
        turning_noise=TURNING_NOISE,
        bias=biased(random, task, BIAS),
        quantum=1e-4,
        lost=0.1,
        outliers=0.01,
    )
    return Conditions(Robot(lag=0.1, delay=0.02), sensor, Clock(0.1, 0.03, 0.02))


def _sized(
    kind: Kind,
    smallest: float = 0.0,
    largest: float = 0.0,
    *,
    held: tuple[float, float] = (0.0, 0.0),
    at: tuple[float, float] = (0.1, 0.9),
) -> Draw:
    """A disturbance whose size, time and length (both over the duration) lie in ranges."""

    def draw(random: np.random.Generator, task: Task) -> Conditions:
        lasting = random.uniform(*held) * task.duration
        happening = Disturbance(
            kind, random.uniform(smallest, largest), random.uniform(*at), lasting
        )
        robot = _compliant(random) if kind == "force" else USUAL.robot
        return replace(USUAL, robot=robot, disturbance=happening)

    return draw


_HELD = 0.05, 0.1
"""Over the duration, that a hand, force or stall lasts: all of it is time lost."""

SCENARIOS = (
    Scenario("ideal", _ideal, UNDISTURBED),
    Scenario("lag and delay", _lag, UNDISTURBED),
    Scenario("unequal lags", _uneven, UNDISTURBED),
    Scenario("impedance", _impedance, UNDISTURBED),
    Scenario("noise", _noise, UNDISTURBED),
    Scenario("bias", _bias, UNDISTURBED),
    Scenario("slow sensor", _slow_sensor, UNDISTURBED),
    Scenario("all at once", _all_at_once, UNDISTURBED),
    Scenario("late cycles", _clock, replace(UNDISTURBED, time=1.7)),
    Scenario("worst", _worst, WORST),
    Scenario("push, waits", _sized("hand", 0.01, 0.2, held=_HELD), WAITING),
    Scenario("push, follows", _sized("hand", 0.01, 0.2, held=_HELD), FOLLOWING, follows=True),
    Scenario("force, waits", _sized("force", 0.01, 0.05, held=_HELD), WAITING),
    Scenario("force, follows", _sized("force", 0.01, 0.05, held=_HELD), FOLLOWING, follows=True),
    Scenario("stall", _sized("stall", held=_HELD), WAITING),
    Scenario("silent sensor", _sized("silence", held=(0.05, 0.25)), replace(WAITING, time=1.4)),
    Scenario("goal step", _sized("goal", 0.02, 0.1, at=(0.1, 0.8)), NEW_GOAL, moves_goal=True),
    Scenario(
        "two goal steps", _sized("two goals", 0.02, 0.1, at=(0.1, 0.6)), TWO_GOALS, moves_goal=True
    ),
    Scenario(
        "goal after the end", _sized("goal", 0.02, 0.1, at=(1.2, 1.3)), NEW_GOAL, moves_goal=True
    ),
    Scenario(
        "drifting goal", _sized("drift", 0.02, 0.1, at=(0.0, 0.3)), MOVING_GOAL, moves_goal=True
    ),
    Scenario("noisy goal", _sized("noisy goal", 0.1e-3, 0.5e-3), replace(UNDISTURBED, plans=2)),
)


def _tuning(random: np.random.Generator, task: Task) -> Conditions:
    """A lag and a hand, as the list has them, but in no run of the list."""
    robot = Robot(lag=random.uniform(0, 0.1), delay=random.uniform(0, 0.02))
    push = Disturbance("hand", random.uniform(0.01, 0.2), random.uniform(0.1, 0.9), 0.15)
    return Conditions(robot, USUAL.sensor, disturbance=push)


TUNING = Scenario("tuning", _tuning, replace(WAITING, skipped=0.02))
"""Held out: gains of others are sought on it, with seeds of their own."""
