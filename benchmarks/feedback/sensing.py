"""What of a robot is measured, and where its goal is seen."""

from __future__ import annotations

from collections import deque

import numpy as np

from benchmarks.feedback.conditions import Disturbance, Sensor
from benchmarks.feedback.poses import Floats, Pose, body_axis, turned

OUTLIER = 0.05
"""m, the standard deviation of a sample that is none."""
GOAL_RATE = 60.0
"""Hz, at which a noisy goal is seen: a camera's."""
_SAME = 1e-9


class Eye:
    """A sensor: samples at its own rate, which arrive when they are old enough.

    ``silent`` is the span of time within which it says nothing (s).
    """

    def __init__(
        self, sensor: Sensor, random: np.random.Generator, silent: tuple[float, float] = (0.0, 0.0)
    ) -> None:
        self.sensor, self.random, self.silent = sensor, random, silent
        self._next = 0.0
        self._on_the_way: deque[tuple[float, Pose]] = deque()

    def see(self, time: float, pose: Pose) -> Pose | None:
        """Look at a pose; the newest sample that has arrived since the last call, if any."""
        sensor = self.sensor
        if not sensor.rate or time >= self._next - _SAME:
            if sensor.rate:
                # On its own grid, whatever cycles it is asked in.
                missed = np.floor((time + _SAME - self._next) * sensor.rate)
                self._next += (missed + 1) / sensor.rate
            is_lost = sensor.lost > 0 and self.random.random() < sensor.lost
            if not is_lost and not self.silent[0] <= time < self.silent[1]:
                self._on_the_way.append((time + sensor.age, self._sample(pose)))
        newest = None
        while self._on_the_way and self._on_the_way[0][0] <= time + _SAME:
            newest = self._on_the_way.popleft()[1]
        return newest

    def _sample(self, pose: Pose) -> Pose:
        sensor, random = self.sensor, self.random
        position = pose.position + sensor.noise * random.normal(size=3) + sensor.bias
        if sensor.outliers and random.random() < sensor.outliers:
            position = position + OUTLIER * random.normal(size=3)
        if sensor.quantum:
            position = sensor.quantum * np.round(position / sensor.quantum)
        quaternion = pose.quaternion
        if sensor.turning_noise:
            quaternion = turned(sensor.turning_noise * random.normal(size=3), quaternion)
        return Pose(position, quaternion)


class Goal:
    """Where a motion is to go, in truth and as it is told."""

    def __init__(
        self,
        disturbance: Disturbance,
        pose: Pose,
        duration: float,
        length: float,
        random: np.random.Generator,
    ) -> None:
        self.disturbance, self.random = disturbance, random
        self.first = self.true = pose.position
        self._begin, self._duration, self._length = disturbance.at * duration, duration, length
        self._ahead, self._aside = (body_axis(pose.quaternion, k) for k in (0, 1))
        self._next, self._seen = 0.0, pose.position

    def told(self, time: float) -> Floats | None:
        """Where it is seen at a time (s); None where nobody looks for it."""
        kind, size = self.disturbance.kind, self.disturbance.size
        if kind == "noisy goal":
            if time >= self._next - _SAME:
                self._next = time + 1 / GOAL_RATE
                self._seen = self.first + size * self.random.normal(size=3)
            return self._seen
        step = size * self._length
        if kind in ("goal", "two goals"):
            self.true = self.first
            if time >= self._begin:
                self.true = self.first + step * (0.5 * self._ahead + 0.87 * self._aside)
            second = self._begin + self.disturbance.BETWEEN * self._duration
            if kind == "two goals" and time >= second:
                self.true = self.first + step * (0.5 * self._ahead - 0.87 * self._aside)
            return self.true
        if kind == "drift":
            drifted = max(0.0, min(time, self.disturbance.over(self._duration)) - self._begin)
            way = step * drifted / self._duration
            self.true = self.first + way * (self._ahead + self._aside) / np.sqrt(2)
            return self.true
        return None
