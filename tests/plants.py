"""A robot under a controller: lag, delay, a sensor that is slow, noisy, biased, and hands."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from math import exp
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip._typing import Floats


@dataclass
class Plant:
    """Follows a command by a first-order lag after a delay (s); what is measured is not what is.

    Parameters
    ----------
    lag, delay : float
    rate : float
        Of the sensor (Hz); 0 is every cycle.
    noise, angle_noise : float
        Standard deviations (m, rad).
    bias : array, shape (3,)
        Of the sensor (m).
    dropout : float
        Share of samples that are lost.
    hand : callable, optional
        Displacement (m) at which a hand holds the tool, of where it was taken, at a time; None: it
        does not.
    """

    lag: float = 0.0
    delay: float = 0.0
    rate: float = 0.0
    noise: float = 0.0
    angle_noise: float = 0.0
    bias: Any = (0.0, 0.0, 0.0)
    dropout: float = 0.0
    hand: Callable[[float], Floats | None] = lambda _: None
    seed: int = 0
    time: float = field(default=0.0, init=False)

    def begin(self, position: Floats, rotation: Rotation) -> None:
        self.position, self.rotation = np.array(position), rotation
        self._line = deque([(-np.inf, self.position, rotation)])
        self._rng, self._next, self._taken = np.random.default_rng(self.seed), 0.0, None
        self.time = 0.0

    def advance(self, position: Floats, rotation: Rotation, h: float) -> None:
        self._line.append((self.time, np.array(position), rotation))
        self.time += h
        while len(self._line) > 1 and self._line[1][0] <= self.time - h - self.delay + 1e-12:
            self._line.popleft()
        _, place, turned = self._line[0]
        share = 1 - exp(-h / self.lag) if self.lag else 1.0
        turn = (turned * self.rotation.inv()).as_rotvec()
        self.rotation = Rotation.from_rotvec(share * turn) * self.rotation
        off = self.hand(self.time)
        if off is None:
            self._taken = None
            self.position = self.position + share * (place - self.position)
        else:
            if self._taken is None:
                self._taken = self.position
            self.position = self._taken + off

    def measured(self) -> tuple[Floats, Rotation] | None:
        if self.rate and self.time < self._next - 1e-9:
            return None
        self._next = self.time + 1 / self.rate if self.rate else 0.0
        if self._rng.random() < self.dropout:
            return None
        turn = Rotation.from_rotvec(self.angle_noise * self._rng.normal(size=3))
        off = self.noise * self._rng.normal(size=3) + self.bias
        return self.position + off, turn * self.rotation


@dataclass(frozen=True)
class Run:
    """What was commanded, cycle by cycle, and where the tool went."""

    states: list[ns.State]
    speeds: Floats
    modes: list[str]
    tool: Floats
    time: float

    @property
    def positions(self) -> Floats:
        return np.array([state.position for state in self.states])

    @property
    def residual(self) -> float:
        """Largest of what was commanded; a tool that a hand led is not asked."""
        sizes = [
            np.abs(state.constraint_residuals).max(initial=0.0)
            for state, mode in zip(self.states, self.modes, strict=True)
            if mode != "yield"
        ]
        return float(max(sizes))

    def rates(self, h: float) -> tuple[Floats, Floats]:
        """Speeds and turning of the command, those of cycles in which it followed a hand apart."""
        kept = [mode != "yield" for mode in self.modes[1:]]
        turns = [
            (after.rotation * before.rotation.inv()).magnitude()
            for before, after in zip(self.states, self.states[1:], strict=False)
        ]
        speeds = np.linalg.norm(np.diff(self.positions, axis=0), axis=1)
        return speeds[kept] / h, np.array(turns)[kept] / h


def drive(
    controller: ns.Controller,
    plant: Plant,
    *,
    goal: Callable[[float], Any] = lambda _: None,
    most: float = 5.0,
    beyond: float = 0.0,
    late: Callable[[int], float] = lambda _: 0.0,
) -> Run:
    """Run a loop until it is done and some seconds beyond, or for so many durations."""
    state = controller.reset()
    plant.begin(state.position, state.rotation)
    states, speeds, modes, tool = [state], [controller.speed], ["track"], [plant.position]
    h, ended = controller.time_step, np.inf
    passed = h
    while plant.time < min(most * controller.law.duration, ended):
        time_step = None if passed == h else passed
        state = controller.step(plant.measured(), goal(plant.time), time_step=time_step)
        states.append(state)
        speeds.append(controller.speed)
        modes.append(controller.mode)
        if controller.done and np.isinf(ended) and plant.time >= beyond:
            ended = plant.time
        passed = h + late(len(states))
        plant.advance(state.position, state.rotation, passed)
        tool.append(plant.position)
    return Run(states, np.array(speeds), modes, np.array(tool), plant.time)
