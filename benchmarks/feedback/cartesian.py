"""movement-primitives' ``CartesianDMP`` with feedback: literal, and with phase stopping.

Phase stopping (Ijspeert et al. 2013, section 2.3; pose instead of position):

    e' = a_e (measured - y - e),    tau -> tau (1 + k_c |e|^2),    y'' += k_t e / tau^2

with positions over the path's length.  What is measured seldom is held until the next sample.
"""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass
from functools import lru_cache
from math import expm1
from typing import Any

import numpy as np

from benchmarks import peers
from benchmarks.feedback.poses import Floats, Pose, turn_between
from benchmarks.feedback.tasks import Task

BASIS_FUNCTIONS = 100
SAMPLES = 1000
"""Of the motion that it imitates."""


@dataclass(frozen=True)
class Gains:
    """Of phase stopping.

    Attributes
    ----------
    error_rate : float
        a_e (1/s).
    slowing : float
        k_c, over the path's length squared, and 1/rad^2.
    pull : float
        k_t.
    """

    error_rate: float
    slowing: float
    pull: float


GRID = [
    Gains(error_rate, slowing, pull)
    for error_rate in (5.0, 20.0, 80.0)
    for slowing in (100.0, 300.0, 1e3, 3e3, 1e4)
    for pull in (0.0, 10.0, 100.0)
]
BEST = Gains(error_rate=20.0, slowing=1e3, pull=0.0)
"""Of the grid, on the held-out scenario: see ``python -m benchmarks.feedback --tune``."""


@lru_cache
def _fitted(task: Task) -> Any:
    """Fitted to the task's own motion; a goal that moves leaves it without a jump (Pastor 2009)."""
    motion = task.dmp.rollout(time_step=task.duration / SAMPLES)
    dmp = peers.CartesianDMP(  # type: ignore[attr-defined]
        execution_time=task.duration,
        dt=task.duration / SAMPLES,
        n_weights_per_dim=BASIS_FUNCTIONS,
        smooth_scaling=True,
    )
    dmp.imitate(*peers.imitation(motion))
    return dmp


class Cartesian:
    """Steps the primitive from the measured pose, its velocities being its own."""

    plans, is_led = 0, False

    def __init__(self, task: Task, period: float, *, follows: bool = False) -> None:
        self.dmp = deepcopy(_fitted(task))
        self.duration, self.length = task.duration, task.length
        self.pose, self.velocities = np.concatenate(task.start), np.zeros(6)

    @property
    def done(self) -> bool:
        """See :class:`Generator`."""
        return bool(self.dmp.t >= self.duration * (1 - 1e-9))

    def step(self, elapsed: float, measured: Pose | None, goal: Floats | None) -> Pose:
        """See :class:`Generator`."""
        if measured is not None:
            self.pose = self._signed(measured)
        return self._advance(elapsed, goal)

    def _signed(self, pose: Pose) -> Floats:
        """The measured pose, its quaternion on the side of the own one."""
        sign = -1.0 if pose.quaternion @ self.pose[3:] < 0 else 1.0
        return np.concatenate([pose.position, sign * pose.quaternion])

    def _advance(self, seconds: float, goal: Floats | None) -> Pose:
        """Go on by some seconds of its own time."""
        if goal is not None:
            self.dmp.goal_y[:3] = goal
        if self.done:
            # It only draws to its goal now; what is left of its forcing term would lead on.
            self.dmp.forcing_term_pos.weights_[:] = 0.0
            self.dmp.forcing_term_rot.weights_[:] = 0.0
        # In one step of the loop; its own default of 1 ms, if that is less.
        self.dmp.dt_, self.dmp.int_dt = seconds, min(seconds, 1e-3)
        self.pose, self.velocities = self.dmp.step(self.pose, self.velocities)
        return Pose(self.pose[:3].copy(), self.pose[3:].copy())


class PhaseStopping(Cartesian):
    """The command is its own; its phase waits for the robot."""

    def __init__(
        self, task: Task, period: float, *, follows: bool = False, gains: Gains = BEST
    ) -> None:
        super().__init__(task, period)
        self.gains, self.error = gains, np.zeros(6)
        self._measured: Pose | None = None

    def step(self, elapsed: float, measured: Pose | None, goal: Floats | None) -> Pose:
        """See :class:`Generator`."""
        self._measured = measured or self._measured
        gains, off = self.gains, np.zeros(6)
        if self._measured is not None:
            off[:3] = (self._measured.position - self.pose[:3]) / self.length
            off[3:] = turn_between(self.pose[3:], self._measured.quaternion)
        self.error = self.error - expm1(-gains.error_rate * elapsed) * (off - self.error)
        own = elapsed / (1 + gains.slowing * float(self.error @ self.error))
        pulled = self.error * ([self.length] * 3 + [1.0] * 3)
        self.velocities = self.velocities + own * gains.pull / self.duration**2 * pulled
        return self._advance(own, goal)
