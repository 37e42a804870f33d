"""A primitive in a control loop: step by step, from what was measured, to goals that move.

What leads a tool back that was pushed off its path depends on how far it is:

- within the tolerance it is *steered*: the orientation's target is turned towards the path
  (:mod:`noslip.runtime.steering`);
- beyond it, or when the goal moves, what remains is *re-planned* (:meth:`ConstrainedDMP.replan`),
  with more time the more it was displaced: the phase slows down;
- between two plans, or if there is none, the phase *stops* while the tool is beyond the tolerance
  (phase stopping: Ijspeert et al. 2013, section 2.3): it waits, where the tool is held.

Whatever happens, each step satisfies the constraints, as in a rollout.

What is guaranteed: the constraints at every step, to rounding.  What cannot be, by any smooth
feedback: that a tool which must not slip converges to a pose (Brockett 1983); a push in the last
moment needs a way back, which only a new plan, and time, can give.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from noslip import _arguments
from noslip.adaptation import REPLANNED_SAMPLES
from noslip.errors import InputError, NoslipError
from noslip.learning import ConstrainedDMP
from noslip.primitives.pose import ConstrainedMotion, State
from noslip.runtime.steering import Steering

Floats = NDArray[np.float64]

TOLERANCE = 2e-3
"""Of the path's length: farther off its path a tool is led back by a new plan."""
ANGLE_TOLERANCE = 0.05
"""rad."""
DEADBAND = 0.1
"""Fraction of the tolerance within which nothing is done."""
RETURN_RATE = 8.0
"""k of the steering, per duration."""
_PAUSE = 0.02
"""Fraction of the duration between two plans."""


@dataclass(frozen=True)
class Replanned:
    """A change of plan.

    Attributes
    ----------
    time : float
        When (s).
    reason : str
        What had moved: the tool off its path, or the goal.
    duration : float
        Of the new plan (s); nan if there is none.
    failure : str
        Why there is none; the old plan is followed on.  Empty if all went well.
    """

    time: float
    reason: Literal["path", "goal"]
    duration: float
    failure: str = ""


class Controller:
    """Steps a primitive, and leads it back when what is measured is not what was planned.

    Parameters
    ----------
    dmp : ConstrainedDMP
    time_step : float
        Of the loop (s).
    tolerance : float
        Distance from the path, over its length, beyond which what remains is re-planned.
    angle_tolerance : float
        The same for the orientation (rad).
    samples : int
        Of a new plan, at most.

    Attributes
    ----------
    state : State
        The last, or the one to begin with.
    plan : ConstrainedDMP
        What is followed now.
    replanned : list of Replanned
    """

    def __init__(
        self,
        dmp: ConstrainedDMP,
        *,
        time_step: float,
        tolerance: float = TOLERANCE,
        angle_tolerance: float = ANGLE_TOLERANCE,
        samples: int = REPLANNED_SAMPLES,
    ) -> None:
        self.dmp = dmp
        self.time_step = _arguments.positive("time_step", time_step, "seconds")
        self.tolerance = _arguments.positive("tolerance", tolerance)
        self.angle_tolerance = _arguments.positive("angle_tolerance", angle_tolerance, "rad")
        self.samples = samples
        whole = dmp.rollout()
        self._length = whole.path_length or 1.0
        self._steering = Steering(dmp.system, whole.path_length / dmp.duration)
        self.reset()

    def reset(self, state: State | None = None) -> State:
        """Begin anew, from a state of the primitive or from its start."""
        self.replanned: list[Replanned] = []
        self._pause = -np.inf
        self.state = self.dmp.initial_state() if state is None else state
        self._follow(self.dmp, self.state)
        self._goal, self._goal_rotation = self.state.goal_position, self.state.goal_rotation
        self._goal_moved = False
        return self.state

    @property
    def done(self) -> bool:
        """Whether the motion has come to its end."""
        return self.plan.phase.fraction(self.state.phase) >= 1 - 1e-9

    def step(
        self,
        measured_state: State | None = None,
        *,
        goal_position: ArrayLike | None = None,
        goal_rotation: Rotation | None = None,
        time_step: float | None = None,
    ) -> State:
        """Return the next state.

        Parameters
        ----------
        measured_state : State, optional
            Where the tool is now: the last state with measured values in place of its own
            (``dataclasses.replace``).  By default it is where it was sent.
        goal_position, goal_rotation : optional
            Where to go from now on.  If no motion is found that ends there, the old goal stays, the
        reason is told in ``replanned``, and it is tried again.
        time_step : float, optional
            Of this step (s), if a cycle came late.
        """
        h = self.time_step
        if time_step is not None:
            h = _arguments.positive("time_step", time_step, "seconds")
        state = self.state if measured_state is None else measured_state
        if not isinstance(state, State):
            raise InputError(f"measured_state must be a State, got {type(state).__name__}")
        if goal_position is not None:
            self._goal = _arguments.vector("goal_position", goal_position)
            self._goal_moved = True
        if goal_rotation is not None:
            self._goal_rotation = _arguments.rotation("goal_rotation", goal_rotation)
            self._goal_moved = True
        steer, waits = np.zeros(3), False
        if self._goal_moved and state.time >= self._pause:
            state, _ = self._replan(state, "goal")
        elif measured_state is not None:
            off, angle, steer = self._errors(state)
            if off > 1 or angle > 1:
                steer, waits = np.zeros(3), True
                if state.time >= self._pause:
                    state, found = self._replan(state, "path")
                    waits = not found
        after = self.plan.step(replace(state, steering=steer), h)
        phase = state.phase if waits else after.phase
        self.state = replace(after, phase=phase, steering=np.zeros(3))
        return self.state

    # ---------------------------------------------------------------- inside

    def _follow(self, plan: ConstrainedDMP, state: State) -> None:
        self.plan = plan
        begins = state.previous_step == 0.0
        # On the loop's own steps: undisturbed, the tool is exactly on it.
        self._path: ConstrainedMotion = plan.rollout(
            goal_position=state.goal_position,
            goal_rotation=state.goal_rotation,
            start_position=state.position if begins else None,
            start_rotation=state.rotation if begins else None,
            duration=state.duration,
            time_step=min(self.time_step, state.duration),
        )

    def _errors(self, state: State) -> tuple[float, float, Floats]:
        """Distance and angle from the path over their tolerances; turn that steers back."""
        path = self._path
        place = min(self.plan.phase.fraction(state.phase), 1.0) * (len(path) - 1)
        k = min(int(place), len(path) - 2)
        passed = (place - k) * (path.times[k + 1] - path.times[k])
        linear, angular = path.linear_velocities[k + 1], path.angular_velocities[k + 1]
        position = path.positions[k] + passed * linear
        rotation = Rotation.from_rotvec(passed * angular) * path.rotations[k]
        off = position - state.position
        distance = float(np.linalg.norm(off)) / self._length / self.tolerance
        steer = np.zeros(3)
        if distance > DEADBAND:
            quaternion = rotation.as_quat(scalar_first=True)
            wish = RETURN_RATE / self.dmp.duration * off
            steer = self._steering(state.time, position, quaternion, linear, angular, wish)
        angle = float((rotation * state.rotation.inv()).magnitude())
        allowed = self.angle_tolerance + float(np.linalg.norm(steer))
        return distance, angle / allowed, steer

    def _replan(self, state: State, reason: Literal["path", "goal"]) -> tuple[State, bool]:
        """Change the plan, if one is found; else the old one is followed on."""
        self._pause = state.time + _PAUSE * self.dmp.duration
        try:
            plan = self.plan.replan(
                state,
                goal_position=self._goal,
                goal_rotation=self._goal_rotation,
                samples=self.samples,
            )
        except NoslipError as failure:
            self.replanned.append(Replanned(state.time, reason, np.nan, str(failure)))
            return state, False
        self.replanned.append(Replanned(state.time, reason, plan.duration))
        self._goal_moved = False
        begun = plan.initial_state(start_position=state.position, start_rotation=state.rotation)
        self._follow(plan, begun)
        return begun, True
