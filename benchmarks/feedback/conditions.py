"""What a run is subjected to: robot, sensor, clock, disturbance, goal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Kind = Literal[
    "none", "hand", "force", "stall", "silence", "goal", "two goals", "drift", "noisy goal"
]


@dataclass(frozen=True)
class Robot:
    """How what is commanded becomes motion.

    Attributes
    ----------
    lag : float
        Time constant of the first order with which it follows (s); 0 follows at once.
    delay : float
        Before it begins to (s).
    turning_lag : float or None
        The same of the orientation, if it is another.
    frequency : float
        Of an impedance (rad/s), whose position follows in second order,
        ``x'' = w^2 (command - x) - 2 zeta w x' + w^2 displacement``; its orientation with the lag
        ``2 zeta / w`` unless told otherwise.  0: no impedance.
    damping : float
        Its zeta.
    """

    lag: float = 0.0
    delay: float = 0.0
    turning_lag: float | None = None
    frequency: float = 0.0
    damping: float = 1.0


@dataclass(frozen=True)
class Sensor:
    """What is seen of a pose, and when; seen in each cycle, exactly and at once, by default.

    Attributes
    ----------
    rate : float
        Samples a second; 0 in every cycle.
    noise, turning_noise : float
        Standard deviations of each component (m, rad).
    bias : 3 numbers
        Between what is measured and what is true (m, world frame).
    quantum : float
        Positions are multiples of it (m).
    lost : float
        Probability of a sample that never comes.
    age : float
        Of a sample when it comes (s).
    outliers : float
        Probability of a sample that is off by decimeters.
    """

    rate: float = 0.0
    noise: float = 0.0
    turning_noise: float = 0.0
    bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    quantum: float = 0.0
    lost: float = 0.0
    age: float = 0.0
    outliers: float = 0.0


@dataclass(frozen=True)
class Clock:
    """Cycles that are not what they should be.

    Attributes
    ----------
    jitter : float
        Over the period; uniform.
    late : float
        Probability that a cycle comes late.
    lateness : float
        By how much at most (s).
    """

    jitter: float = 0.0
    late: float = 0.0
    lateness: float = 0.0


@dataclass(frozen=True)
class Disturbance:
    """One thing that happens on the way.

    Attributes
    ----------
    kind : str
        A *hand* displaces the tool sideways and holds it there; a *force* displaces an impedance by
        this much at rest; in a *stall* the robot stands; in *silence* the sensor says nothing; the
        *goal* steps aside, or twice; it *drifts* until the motion's nominal end; it is *noisy*.
    size : float
        Over the path's length; of a drift, in the whole duration; of a noisy goal, in m.
    at : float
        When it begins, over the duration.
    held : float
        For how long (s).
    """

    kind: Kind = "none"
    size: float = 0.0
    at: float = 0.5
    held: float = 0.2

    BETWEEN = 0.3
    """Over the duration, from the goal's first step to its second."""
    RAMP = 0.1
    """s within which a hand or a force takes hold."""

    def over(self, duration: float) -> float:
        """When the last of it has happened (s)."""
        begin = self.at * duration
        if self.kind in ("hand", "force"):
            return begin + self.RAMP + self.held
        if self.kind in ("stall", "silence"):
            return begin + self.held
        if self.kind == "goal":
            return begin
        if self.kind == "two goals":
            return begin + self.BETWEEN * duration
        return max(begin, duration) if self.kind == "drift" else 0.0


@dataclass(frozen=True)
class Conditions:
    """All of them; what is not told is ideal."""

    robot: Robot = Robot()
    sensor: Sensor = Sensor()
    clock: Clock = Clock()
    disturbance: Disturbance = Disturbance()
