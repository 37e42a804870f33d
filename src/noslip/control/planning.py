"""New plans beside the loop: from a place ahead, in a thread.

A command is its own, so where it will be is known: a plan is made from the state at a *place* of
the plan that is followed now, and handed over there, with its pose and its twist, however fast the
clock ran meanwhile.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Literal, Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip._values import Value
from noslip.adapting import replan
from noslip.adapting.impossible import alone, common_rows
from noslip.control.clock import CELLS, PLAN_AT_REST, Bounds, Schedule
from noslip.errors import muted
from noslip.law.channels import Channels
from noslip.law.law import Law
from noslip.projection.request import ADAPTING
from noslip.rule import Rule
from noslip.runtime.engine import Compiled, Memory, Virtual
from noslip.runtime.rollout import initial_state, motion_from
from noslip.runtime.state import State
from noslip.runtime.stepper import stepper_of

Reason = Literal["push", "goal"]
SMOOTHER = 30.0
"""Times as smooth a turn of a pose as when a motion is adapted from rest: else it bends within few
samples from the twist that it is handed over with, at some ten times the accelerations of the
path."""
_ORIENTATIONS = 6
"""At which rules are asked what they forbid for good: more than any has rows."""


class Primitive(Protocol):
    """What has a law and a rule."""

    @property
    def law(self) -> Law:
        """What it wants."""

    @property
    def rule(self) -> Rule:
        """What it must."""


def channels_of(dmp: Primitive) -> Channels | None:
    """What goes with its motion, if it is a primitive that has learned some."""
    return getattr(dmp, "channels", None)


def channels_at(channels: Channels | None, memory: Memory) -> Floats:
    """The same at a state in place, shape (k,)."""
    if channels is None:
        return np.zeros(0)
    return np.asarray(channels.at(memory.data.item(memory.at.fraction))[0])


@dataclass(frozen=True, eq=False)
class Task(Value):
    """What is to be planned, and from where.

    Attributes
    ----------
    reason : "push" or "goal"
    plan : Law
        Followed now.
    memory : array
        Of its state now, in plan time.
    steps : int
        Of the loop, ahead: 0 is here.
    step : float
        Of plan time, each (s).
    resting : bool
        Whether the motion has come to its end there.
    goal_position : array, shape (n,)
    goal_rotation : Rotation or None
        None where nothing turns.
    duration : float or None
        Of the new plan (s); None is what it takes.
    samples : int
        Of its projection.
    """

    reason: Reason
    plan: Law
    memory: Floats
    steps: int
    step: float
    resting: bool
    goal_position: Floats
    goal_rotation: Rotation | None
    duration: float | None
    samples: int


@dataclass(frozen=True)
class Replanned:
    """A change of plan.

    Attributes
    ----------
    time : float
        When (s).
    reason : str
        What had moved: the tool, pushed, or the goal.
    duration : float
        Of the new plan (s); nan if there is none.
    failure : str
        Why there is none; the old plan is followed on.  Empty if all went well.
    """

    time: float
    reason: Reason
    duration: float
    failure: str = ""


@dataclass(frozen=True)
class Made:
    """What came of it: a plan with all that following it needs, or why there is none.

    Attributes
    ----------
    plan : Law or None
    state : State or None
        To follow it from.
    schedule : Schedule or None
    engine : Compiled or None
        What steps it, if it is machine code: it takes longer to set up than a cycle has.
    failure : str
    """

    plan: Law | None = None
    state: State | None = None
    schedule: Schedule | None = None
    engine: Compiled | None = None
    failure: str = ""


Found = tuple[Law, State, Schedule]
"""A plan, the state to follow it from, and what it allows its clock."""


@dataclass(frozen=True)
class Plans:
    """Plans of a rule, and what they allow the clock.

    Attributes
    ----------
    rule : Rule
    bounds : Bounds
    mean_speed : float
        Of the primitive (m/s).
    time_step : float
        Of the loop (s).
    rests : bool
        Whether plans that end at speed come to rest at their ends.
    smoother : float
        Times as smooth a turn as when a motion is adapted from rest.
    """

    rule: Rule
    bounds: Bounds
    mean_speed: float
    time_step: float
    rests: bool = True
    smoother: float = 1.0

    def schedule(self, plan: Law, state: State, at_rest: float = PLAN_AT_REST) -> Schedule:
        """What a plan allows its clock, from its first state."""
        motion = motion_from(plan, self.rule, state, state.duration / CELLS)
        return Schedule.of(
            motion, self.bounds, self.mean_speed, self.time_step, self.rests, at_rest
        )

    def __call__(self, task: Task, state: State) -> Found:
        """Plan from a state."""
        plan = replan(
            task.plan,
            self.rule,
            state,
            goal_position=task.goal_position,
            goal_rotation=task.goal_rotation,
            duration=task.duration,
            samples=task.samples,
            rotation_smoothing=self.smoother * ADAPTING.rotation_smoothing,
        ).law
        turn = state.rotation if plan.space.rotations else None
        begun = initial_state(plan, self.rule, start_position=state.position, start_rotation=turn)
        return plan, begun, self.schedule(plan, begun)


class Planner:
    """Makes plans for one controller, one at a time.

    Parameters
    ----------
    rule : Rule
    memory : Memory
        Of the controller.
    time_step : float
        Of the loop (s).
    find : callable
        (task, state) -> :data:`Found`.
    """

    def __init__(
        self, rule: Rule, memory: Memory, time_step: float, find: Callable[[Task, State], Found]
    ) -> None:
        self._rule, self._memory, self._time_step, self._find = rule, memory, time_step, find
        self._thread = ThreadPoolExecutor(1, "noslip-plan")

    def begin(self, task: Task) -> Future[Made]:
        """Begin to plan beside the loop."""
        return self._thread.submit(self._made, task)

    def _made(self, task: Task) -> Made:
        try:
            with muted():
                plan, begun, schedule = self._find(task, self._there(task))
        # Whatever it is must not end the loop.
        except Exception as failure:
            return Made(failure=str(failure) or type(failure).__name__)
        library = stepper_of(self._rule).native.library
        stepping = None
        if library is not None:
            stepping = Compiled(plan, self._rule, self._memory, library)
        return Made(plan, begun, schedule, stepping)

    def _there(self, task: Task) -> State:
        """The state at the place from which to plan."""
        memory = Memory(task.plan.clock, self._rule.system)
        memory.data[:] = task.memory
        ahead = engine_of(task.plan, self._rule, memory, self._time_step)
        for _ in range(task.steps):
            ahead.step(task.step)
        state = memory.state()
        if task.resting:
            linear, angular = (
                np.zeros_like(v) for v in (state.linear_velocity, state.angular_velocity)
            )
            state = replace(state, linear_velocity=linear, angular_velocity=angular)
        return state


def reachable(rule: Rule, state: State) -> Floats:
    """Projector, shape (3, 3), onto the displacements that no rule forbids for good.

    What a rule forbids the velocity however the tool is turned, as a wheel the height above its
    ground, no motion reaches.  It stands in the span of the rows at every orientation.
    """
    rows, rng = rule.system.equalities, np.random.default_rng(0)
    jacobians = []
    for turn in Rotation.from_rotvec(0.5 * rng.normal(size=(_ORIENTATIONS, 3))):
        quaternion = (turn * state.rotation).as_quat(scalar_first=True)
        twist = rng.normal(size=(2, 3))
        jacobians.append(rows.instant(state.time, state.position, quaternion, *twist)[2])
    # Of these, those that need no turn.
    directions = alone(common_rows(jacobians))
    return np.asarray(np.eye(3) - directions.T @ directions)


def engine_of(plan: Law, rule: Rule, memory: Memory, time_step: float) -> Virtual | Compiled:
    """What steps a plan: machine code if it is there."""
    library = stepper_of(rule).native.library
    if library is None:
        return Virtual(plan, rule, memory, time_step)
    return Compiled(plan, rule, memory, library)
