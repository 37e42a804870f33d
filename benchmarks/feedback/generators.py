"""What commands: noslip's controller, its primitive without feedback, and with it taken literally.

All see the same: seconds since the last cycle, the newest measured pose if there is a new one, and
the goal as it is seen.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from scipy.spatial.transform import Rotation

import noslip as ns
from benchmarks.feedback.poses import Floats, Pose, size, turn_between
from benchmarks.feedback.tasks import Task


class Generator(Protocol):
    """Commands a pose in each cycle."""

    @property
    def plans(self) -> int:
        """Made so far."""

    @property
    def done(self) -> bool:
        """Whether it says that the motion has come to its end."""

    @property
    def is_led(self) -> bool:
        """Whether its command goes now where a hand holds the tool."""

    def step(self, elapsed: float, measured: Pose | None, goal: Floats | None) -> Pose:
        """Command the next pose."""


class Controlled:
    """noslip's controller; ``follows`` says that the robot is compliant."""

    def __init__(self, task: Task, period: float, *, follows: bool) -> None:
        self.controller = ns.Controller(task.dmp, time_step=period, follows=follows)

    @property
    def plans(self) -> int:
        """Those that were found."""
        return sum(not plan.failure for plan in self.controller.replanned)

    @property
    def done(self) -> bool:
        """See :class:`Generator`."""
        return self.controller.done

    @property
    def is_led(self) -> bool:
        """See :class:`Generator`."""
        return self.controller.mode == "yield"

    def step(self, elapsed: float, measured: Pose | None, goal: Floats | None) -> Pose:
        """See :class:`Generator`."""
        given = None
        if measured is not None:
            turned = Rotation.from_quat(measured.quaternion, scalar_first=True)
            given = measured.position, turned
        state = self.controller.step(given, goal, time_step=elapsed)
        return Pose(state.position.copy(), state.quaternion.copy())


class Plain:
    """The primitive's own motion; nothing that is measured is used, nor any goal."""

    plans, is_led = 0, False

    def __init__(self, task: Task, period: float, *, follows: bool = False) -> None:
        self.dmp = task.dmp
        self.state = task.dmp.initial_state()

    @property
    def done(self) -> bool:
        """See :class:`Generator`."""
        return bool(self.state.done)

    def step(self, elapsed: float, measured: Pose | None, goal: Floats | None) -> Pose:
        """See :class:`Generator`."""
        if not self.state.done:
            self.state = self.dmp.step(self.state, elapsed)
        return Pose(self.state.position, self.state.quaternion)


class Literal:
    """Goes on from where the tool was measured to be, and plans anew when that is off the path.

    That is feedback as most libraries' step functions have it, with the best that a primitive
    offers besides: each step holds the constraint, and a plan leads back.
    """

    is_led = False
    TOLERANCE, ANGLE_TOLERANCE = 2e-3, 0.05
    """Of the path's length, and rad, beyond which a plan is made."""
    BETWEEN = 0.02
    """Of the duration, between two plans."""
    MOST_PLANS = 60
    """After so many it is given up: each takes some 20 ms of a loop."""

    def __init__(self, task: Task, period: float, *, follows: bool = False) -> None:
        self.task, self.period, self.plans = task, period, 0
        self._goal, self._moved = task.goal.position, False
        self._next_plan = self._time = 0.0
        self._follow(task.dmp, task.dmp.initial_state())

    def _follow(self, plan: Any, state: Any) -> None:
        self.plan, self.state, self._begin = plan, state, state.time
        # Where it is along its plan, undisturbed.
        motion = plan.rollout(time_step=min(self.period, plan.duration))
        self._path = list(zip(motion.positions, motion.quaternions, strict=True))

    @property
    def done(self) -> bool:
        """See :class:`Generator`."""
        return bool(self.state.done)

    def step(self, elapsed: float, measured: Pose | None, goal: Floats | None) -> Pose:
        """See :class:`Generator`."""
        self._time += elapsed
        if goal is not None and not np.array_equal(goal, self._goal):
            self._goal, self._moved = goal, True
        off = False
        if measured is not None:
            x, q = self._path[
                min(round((self.state.time - self._begin) / self.period), -1 % len(self._path))
            ]
            off = (
                size(measured.position - x) > self.TOLERANCE * self.task.length
                or size(turn_between(q, measured.quaternion)) > self.ANGLE_TOLERANCE
            )
            if off or not self.state.done:
                # What is measured of a tool that holds its pose must not move it.
                turned = Rotation.from_quat(measured.quaternion, scalar_first=True)
                self.state = replace(self.state, position=measured.position, rotation=turned)
        if (off or self._moved) and self._time >= self._next_plan:
            self._next_plan = self._time + self.BETWEEN * self.task.duration
            self._plan()
        if not self.state.done:
            self.state = self.plan.step(self.state, elapsed)
        return Pose(self.state.position, self.state.quaternion)

    def _plan(self) -> None:
        if self.plans >= self.MOST_PLANS:
            raise RuntimeError(f"{self.plans} plans, given up")
        try:
            plan = self.plan.replan(self.state, goal_position=self._goal)
        except ns.NoslipError:
            return
        self.plans, self._moved = self.plans + 1, False
        begun = plan.initial_state(
            start_position=self.state.position, start_rotation=self.state.rotation
        )
        self._follow(plan, begun)
