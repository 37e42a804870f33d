"""Robots that follow a command, exactly between the instants at which something changes."""

from __future__ import annotations

from collections import deque
from functools import lru_cache
from math import expm1

import numpy as np
from scipy.linalg import expm

from benchmarks.feedback.conditions import Disturbance, Robot
from benchmarks.feedback.poses import NOWHERE, Floats, Pose, body_axis, turn_between, turned

LONGEST = 5e-3
"""s that are advanced at once."""
FINEST = 1e-3
"""The same while a hand or a force takes hold: that is no constant."""
_SAME = 1e-12


class Plant:
    """A robot under a disturbance.

    Parameters
    ----------
    robot : Robot
    disturbance : Disturbance
    pose : Pose
        Where it stands at first, at rest.
    duration, length : float
        Of the motion: what the disturbance is told over (s, m).

    Attributes
    ----------
    pose : Pose
    velocity : array, shape (3,)
        Of an impedance (m/s).
    is_touched : bool
        Whether a hand or a force acts, or acted in the last advance.
    """

    def __init__(
        self, robot: Robot, disturbance: Disturbance, pose: Pose, duration: float, length: float
    ) -> None:
        self.robot, self.disturbance, self.length = robot, disturbance, length
        self.pose, self.velocity, self.time = pose, np.zeros(3), 0.0
        self.is_touched = False
        self._begin = disturbance.at * duration
        self._end = disturbance.over(duration)
        self._commands: deque[tuple[float, Pose]] = deque([(-np.inf, pose)])
        self._held: tuple[Floats, Floats] | None = None

    def advance(self, command: Pose, seconds: float) -> None:
        """Follow a command that is held for some seconds."""
        self._commands.append((self.time + self.robot.delay, command))
        end, kind = self.time + seconds, self.disturbance.kind
        self.is_touched = False
        acts = kind in ("hand", "force", "stall")
        while self.time < end - _SAME:
            while len(self._commands) > 1 and self._commands[1][0] <= self.time + _SAME:
                self._commands.popleft()
            until = min(end, self.time + LONGEST)
            if len(self._commands) > 1:
                until = min(until, self._commands[1][0])
            is_acting = acts and self._begin - _SAME <= self.time < self._end - _SAME
            if is_acting:
                ramps = kind != "stall" and self.time < self._begin + self.disturbance.RAMP
                until = min(until, self._end, self.time + (FINEST if ramps else LONGEST))
            elif acts and self.time < self._begin:
                until = min(until, self._begin)
            self._follow(until, is_acting)
            self.time = until

    def _follow(self, until: float, is_acting: bool) -> None:
        """Follow the command that has arrived."""
        robot, kind, h = self.robot, self.disturbance.kind, until - self.time
        command = self._commands[0][1]
        if is_acting and kind == "stall":
            self.velocity = np.zeros(3)
            return
        displacement = NOWHERE
        if is_acting:
            self.is_touched = True
            displacement = self._displacement((self.time + until) / 2 if kind == "force" else until)
        position = self.pose.position
        if is_acting and kind == "hand" and self._held is not None:
            self.velocity, position = np.zeros(3), self._held[0] + displacement
        elif robot.frequency:
            off = np.stack([position - command.position - displacement, self.velocity])
            off = _transition(robot.frequency, robot.damping, round(h, 12)) @ off
            self.velocity, position = off[1], command.position + displacement + off[0]
        else:
            position = position + _share(h, robot.lag) * (command.position - position)
        lag = robot.turning_lag
        if lag is None:
            lag = 2 * robot.damping / robot.frequency if robot.frequency else robot.lag
        turn = turn_between(self.pose.quaternion, command.quaternion)
        self.pose = Pose(position, turned(_share(h, lag) * turn, self.pose.quaternion))

    def _displacement(self, time: float) -> Floats:
        if self._held is None:
            aside = self.disturbance.size * self.length * body_axis(self.pose.quaternion, 1)
            self._held = self.pose.position, aside
        s = min(max((time - self._begin) / self.disturbance.RAMP, 0.0), 1.0)
        return s * s * (3 - 2 * s) * self._held[1]


def _share(seconds: float, lag: float) -> float:
    """Of what is left, that a lag goes within some seconds."""
    return 1.0 if lag <= 0 else -expm1(-seconds / lag)


@lru_cache(maxsize=256)
def _transition(frequency: float, damping: float, seconds: float) -> Floats:
    """Of an impedance's offset and velocity, shape (2, 2)."""
    A = np.array([[0.0, 1.0], [-(frequency**2), -2 * damping * frequency]])
    return np.asarray(expm(seconds * A))
