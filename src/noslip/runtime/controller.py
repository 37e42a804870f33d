"""A primitive in a control loop: step by step, from what was measured, to goals that move.

Three things lead a tool back that was pushed off its path, by how far it is:

- within the tolerance it is *steered*: the orientation's target is turned towards the path
  (:mod:`noslip.runtime.steering`), and the phase slows down (phase stopping: Ijspeert et al. 2013,
  section 2.3.3) by ``tau' = tau (1 + gain (e / tolerance)^2)``;
- beyond it, or when the goal moves, what remains is *re-planned* (:meth:`ConstrainedDMP.replan`);
- whatever happens, each step satisfies the constraints, as in a rollout.

What is guaranteed: the constraints at every step, to rounding.  What cannot be, by any smooth
feedback: that a tool which must not slip converges to a pose (Brockett 1983); a push in the last
moment needs a way back, which only a new plan, and time, can give.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from noslip import _arguments
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
PHASE_STOPPING = 1.0
RETURN_RATE = 8.0
"""k of the steering, per duration."""
_RETRY = 0.02
"""Fraction of the duration until a plan that failed is tried again."""


@dataclass(frozen=True)
class Replanned:
    """A change of plan.

    Attributes
    ----------
    time : float
        When (s).
    reason : str
        "path" or "goal".
    error : float
        How far off the path the tool was (m).
    duration : float
        Of the new plan (s); nan if there is none.
    failure : str
        Why there is none; the old plan is followed on.  Empty if all went well.
    """

    time: float
    reason: str
    error: float
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
    phase_stopping : float
        Gain with which the phase slows down while the tool is off its path; 0 never.
    samples : int
        Of a new plan.
    """

    def __init__(
        self,
        dmp: ConstrainedDMP,
        *,
        time_step: float,
        tolerance: float = TOLERANCE,
        angle_tolerance: float = ANGLE_TOLERANCE,
        phase_stopping: float = PHASE_STOPPING,
        samples: int = 201,
    ) -> None:
        self.dmp = dmp
        self.time_step = _arguments.positive("time_step", time_step, "seconds")
        self.tolerance = _arguments.positive("tolerance", tolerance)
        self.angle_tolerance = _arguments.positive("angle_tolerance", angle_tolerance, "rad")
        self.phase_stopping = _arguments.not_negative("phase_stopping", phase_stopping)
        self.samples = samples
        whole = dmp.rollout()
        self._length = whole.path_length
        self._steering = Steering(dmp.system, whole.path_length / dmp.duration)
        self.reset()

    def reset(self, state: State | None = None) -> State:
        """Begin anew, from a state of the primitive or from its start."""
        self.replanned: list[Replanned] = []
        self._follow(self.dmp)
        self._pause = 0.0
        self.state = self.plan.initial_state() if state is None else state
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
            Where to go from now on.
        time_step : float, optional
            Of this step (s), if a cycle came late.
        """
        h = self.time_step
        if time_step is not None:
            h = _arguments.positive("time_step", time_step, "seconds")
        state = self.state if measured_state is None else measured_state
        if not isinstance(state, State):
            raise InputError(f"measured_state must be a State, got {type(state).__name__}")
        goal, turned = state.goal_position, state.goal_rotation
        if goal_position is not None:
            goal = _arguments.vector("goal_position", goal_position)
        if goal_rotation is not None:
            turned = _arguments.rotation("goal_rotation", goal_rotation)
        moved = np.any(goal != state.goal_position)
        moved = moved or (turned * state.goal_rotation.inv()).magnitude() > 1e-12
        steer, slower = np.zeros(3), 1.0
        if moved:
            state = self._replan(state, goal, turned, "goal", 0.0)
        elif measured_state is not None:
            off, angle, wish = self._errors(state)
            if (off > 1 or angle > 1) and state.time >= self._pause:
                state = self._replan(state, goal, turned, "path", off)
            elif off > DEADBAND:
                steer = self._steering(*self._here(state), wish)
                slower += self.phase_stopping * min(off, 1.0) ** 2
        tau = state.duration
        after = self.plan.step(replace(state, duration=tau * slower, steering=steer), h)
        self.state = replace(after, duration=tau, steering=np.zeros(3))
        return self.state

    # ---------------------------------------------------------------- inside

    def _follow(self, plan: ConstrainedDMP) -> None:
        self.plan = plan
        self._path: ConstrainedMotion = plan.rollout()

    def _at(self, state: State) -> tuple[int, float]:
        """Sample of the path before a state's phase, and how far it is to the next."""
        place = min(self.plan.phase.fraction(state.phase), 1.0) * (len(self._path) - 1)
        k = min(int(place), len(self._path) - 2)
        return k, place - k

    def _here(self, state: State) -> tuple[float, Floats, Floats, Floats, Floats]:
        """Time, pose and velocities of the path at a state's phase."""
        k, share = self._at(state)
        path = self._path
        position = path.positions[k] + share * (path.positions[k + 1] - path.positions[k])
        return (
            state.time,
            position,
            path.quaternions[k],
            path.linear_velocities[k + 1],
            path.angular_velocities[k + 1],
        )

    def _errors(self, state: State) -> tuple[float, float, Floats]:
        """Distance and angle from the path over their tolerances; velocity that leads back."""
        k, share = self._at(state)
        path = self._path
        h = float(path.times[1] - path.times[0])
        position = path.positions[k] + share * h * path.linear_velocities[k + 1]
        turn = Rotation.from_rotvec(share * h * path.angular_velocities[k + 1])
        off = position - state.position
        angle = (turn * path.rotations[k] * state.rotation.inv()).magnitude()
        scale = self.tolerance * (self._length or 1.0)
        wish = RETURN_RATE / self.dmp.duration * off
        return float(np.linalg.norm(off)) / scale, float(angle) / self.angle_tolerance, wish

    def _replan(
        self, state: State, goal: Floats, turned: Rotation, reason: str, off: float
    ) -> State:
        """Change the plan; if there is none the old one is followed on."""
        error = off * self.tolerance * (self._length or 1.0)
        try:
            plan = self.plan.replan(
                state, goal_position=goal, goal_rotation=turned, samples=self.samples
            )
        except NoslipError as failure:
            self._pause = state.time + _RETRY * self.dmp.duration
            self.replanned.append(Replanned(state.time, reason, error, float("nan"), str(failure)))
            return state
        self.replanned.append(Replanned(state.time, reason, error, plan.duration))
        self._follow(plan)
        return plan.initial_state(start_position=state.position, start_rotation=state.rotation)
