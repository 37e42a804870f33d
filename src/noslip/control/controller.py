"""A primitive in a control loop: step by step, from what was measured, to goals that move.

What leads a tool back that was pushed off its path depends on how far it is:

- within the tolerance it is *steered*: the orientation's target is turned towards the path
  (:mod:`noslip.control.steering`);
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
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from noslip import _arguments
from noslip._typing import Floats
from noslip._values import LONGEST_REPR, is_same, shortened
from noslip.adapting import REPLANNED_SAMPLES, replan
from noslip.control.steering import PATH, Guidance
from noslip.errors import InputError, NoslipError
from noslip.law.law import Law
from noslip.law.layout import STATE
from noslip.projection import planner
from noslip.rule import Rule
from noslip.runtime import engine
from noslip.runtime.engine import Compiled, Memory, Virtual
from noslip.runtime.rollout import initial_state, motion_from, rollout
from noslip.runtime.state import State
from noslip.runtime.stepper import stepper_of

TOLERANCE = 2e-3
"""Of the path's length: farther off its path a tool is led back by a new plan."""
ANGLE_TOLERANCE = 0.05
"""rad."""
FARTHEST = 3.0
"""Over the path's length: a goal farther away is not planned for in the loop."""
_POSITION, _QUATERNION, _LINEAR, _ANGULAR = (STATE[name] for name in STATE)
_PASSED, _NOW = PATH.index("passed"), PATH.index("time")
_BUILT = ("_library", "_guidance", "_engine")
"""What a copy builds anew."""
_PAUSE = 0.02
"""Fraction of the duration between two plans, and that a tool takes to come to a halt."""
_STANDING = 1e15
"""Over the plan's duration: that of a motion which stands still."""


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


class Primitive(Protocol):
    """What has a law and a rule."""

    @property
    def law(self) -> Law:
        """What it wants."""

    @property
    def rule(self) -> Rule:
        """What it must."""


class Controller:
    """Steps a primitive, and leads it back when what is measured is not what was planned.

    The step runs as machine code where a C compiler is found, and is compiled when this object is
    made (the first under these constraints: a second or some; later ones from a cache).

    Parameters
    ----------
    dmp : ConstrainedDMP
        Or whatever has a law and a rule.
    time_step : float
        Of the loop (s).
    tolerance : float
        Distance from the path, over its length, beyond which what remains is re-planned.
    angle_tolerance : float
        The same for the orientation (rad).
    samples : int
        Of a new plan, at most.
    replan : bool
        Whether new plans are made, within a step, which then takes some 20 ms.  Without them a tool
        beyond the tolerance is waited for, and goals are refused.
    braking : float
        Seconds within which a motion that ends at speed comes to rest after its end, straight on or
        as constraints lead it; 0 is at once.

    Attributes
    ----------
    plan : Law
        What is followed now.
    replanned : list of Replanned
    memory : Memory
        The state in place, see :meth:`advance`.
    """

    def __init__(
        self,
        dmp: Primitive,
        *,
        time_step: float,
        tolerance: float = TOLERANCE,
        angle_tolerance: float = ANGLE_TOLERANCE,
        samples: int = REPLANNED_SAMPLES,
        replan: bool = True,
        braking: float = 0.0,
    ) -> None:
        self.law, self.rule, self.replans = dmp.law, dmp.rule, replan
        self.time_step = _arguments.positive("time_step", time_step, "seconds")
        self.tolerance = _arguments.positive("tolerance", tolerance)
        self.angle_tolerance = _arguments.positive("angle_tolerance", angle_tolerance, "rad")
        self.samples = _arguments.count("samples", samples)
        self.braking = _arguments.not_negative("braking", braking)
        self.memory = Memory(dmp.law.clock, dmp.rule.system)
        self._length = rollout(dmp.law, dmp.rule).path_length
        self._build()
        self.reset()

    def __repr__(self) -> str:
        text = f"Controller(time_step={self.time_step:g}, {self.law!r}, {self.rule!r})"
        return shortened(text, LONGEST_REPR)

    def _build(self) -> None:
        """Build what is made of graphs, or shared."""
        self._library = stepper_of(self.rule).native.wait()
        if self.replans:
            planner.compile_for(self.rule.system)
        self._guidance = Guidance(
            self.rule.system,
            self._length,
            self.law.duration,
            self.tolerance,
            self.angle_tolerance,
        )

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name not in _BUILT}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._build()
        self._engine = self._engine_of(self.plan)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Controller):
            return NotImplemented
        mine, theirs = self.__getstate__(), other.__getstate__()
        return all(is_same(value, theirs[name]) for name, value in mine.items())

    # It changes with each step.
    __hash__ = None  # type: ignore[assignment]

    def reset(self, state: State | None = None) -> State:
        """Begin anew, from a state of the primitive or from its start."""
        self.replanned: list[Replanned] = []
        self._pause = -np.inf
        self._speed = self._wanted_speed = 1.0
        self._ramp = 0.0
        self._halted: Floats | None = None
        begun = initial_state(self.law, self.rule) if state is None else state
        self._goal = begun.goal_position.tolist()
        self._goal_rotation = begun.goal_rotation
        self._goal_moved = False
        self._follow(self.law, begun)
        return self.state

    @property
    def state(self) -> State:
        """The last, or the one to begin with."""
        return self.memory.state()

    @property
    def done(self) -> bool:
        """Whether the motion has come to its end."""
        return self.law.clock.is_over(self.memory.data.item(engine.FRACTION))

    @property
    def is_compiled(self) -> bool:
        """Whether the step runs as machine code."""
        return self._library is not None

    @property
    def speed(self) -> float:
        """Of the motion, over that of the plan: 0 while it is paused, 1 while it is not."""
        return self._speed

    def step(
        self,
        measured_state: State | None = None,
        goal: ArrayLike | tuple[ArrayLike, Rotation] | Rotation | None = None,
        *,
        time_step: float | None = None,
    ) -> State:
        """Return the next state.

        Parameters
        ----------
        measured_state : State, optional
            Where the tool is now: the last state with the measured pose, or pose and velocities, in
            place of its own (``dataclasses.replace``).  By default it is where it was sent.
        goal : array of shape (3,), Rotation, or a pair of both, optional
            Where to go from now on.  If no motion is found that ends there, the old goal stays, the
            reason is told in ``replanned``, and it is tried again.
        time_step : float, optional
            Of this step (s), if a cycle came late.

        Raises
        ------
        InputError
            If an argument is not what it must be, or not finite; the state is as it was.
        """
        self.advance(measured_state, goal, time_step=time_step)
        return self.memory.state()

    def advance(
        self,
        measured_state: State | None = None,
        goal: ArrayLike | tuple[ArrayLike, Rotation] | Rotation | None = None,
        *,
        time_step: float | None = None,
    ) -> None:
        """Step in place, as :meth:`step` does, for loops that must not allocate.

        What comes of it stands in ``memory.data``, at the places that :mod:`noslip.runtime.engine`
        names.
        """
        h = self.time_step
        if time_step is not None:
            h = _arguments.positive("time_step", time_step, "seconds")
        if goal is not None:
            self._aim(goal)
        data = self.memory.data
        waits = False
        if measured_state is not None:
            waits = self._measure(measured_state)
        else:
            data[engine.STEERING] = engine.NO_STEERING
            if self._goal_moved and self._may_replan:
                self._replan("goal")
        if self._speed != self._wanted_speed:
            self._change_speed(h)
        before = data.item(engine.FRACTION)
        self._engine.step(h)
        if waits:
            data[engine.FRACTION] = before

    def pause(self, within: float | None = None) -> None:
        """Come to a halt on the path.

        Only the clock slows down: whatever holds of rows that are homogeneous in the velocity still
        holds.  A halted tool keeps the constraints too, and moves along with those that move.

        Parameters
        ----------
        within : float, optional
            Seconds; by default a fiftieth of the duration.  0 is at once.
        """
        self._head_for(0.0, within)

    def resume(self, within: float | None = None) -> None:
        """Go on after a :meth:`pause`, at full speed within some seconds."""
        self._head_for(1.0, within)

    # ---------------------------------------------------------------- inside

    @property
    def _may_replan(self) -> bool:
        if not self.replans or not self._wanted_speed == self._speed == 1:
            return False
        return bool(self.memory.data[engine.TIME] >= self._pause)

    def _head_for(self, speed: float, within: float | None) -> None:
        if within is None:
            within = _PAUSE * self.law.duration
        within = _arguments.not_negative("within", within)
        self._wanted_speed = speed
        self._ramp = 1 / within if within > 0 else np.inf

    def _change_speed(self, h: float) -> None:
        """Stretch the plan's duration, and the velocities with it."""
        data, old = self.memory.data, self._speed
        change = min(self._ramp * h, abs(self._wanted_speed - old))
        new = old + change if self._wanted_speed > old else old - change
        if self._halted is not None:
            data[engine.VELOCITIES] = new * self._halted
            self._halted = None
        elif new == 0.0:
            # Scaled up again from next to nothing, rounding would be all that is left of them.
            self._halted = data[engine.VELOCITIES] / old
            data[engine.VELOCITIES] = 0.0
        else:
            data[engine.VELOCITIES] *= new / old
        if old > 0:
            # What slips goes on as slowly.
            data[self.memory.equalities] *= new / old
        data[engine.DURATION] = self.plan.duration * (1 / new if new > 0 else _STANDING)
        self._speed = new

    def _aim(self, goal: Any) -> None:
        """Take over a goal, if it is another one."""
        if not self.replans:
            raise InputError("goal: this controller makes no plans (replan=False)")
        position, rotation = goal if isinstance(goal, tuple) and len(goal) == 2 else (goal, None)
        if isinstance(position, Rotation):
            position, rotation = rotation, position
        if position is not None:
            asked = _arguments.vector("goal", position).tolist()
            if asked != self._goal:
                self._goal, self._goal_moved = asked, True
        if rotation is not None:
            asked_rotation = _arguments.rotation("goal", rotation)
            if (asked_rotation * self._goal_rotation.inv()).magnitude() > 0:
                self._goal_rotation, self._goal_moved = asked_rotation, True

    def _follow(self, plan: Law, state: State) -> None:
        self.plan = plan
        begun = state
        if state.previous_step > 0:
            goals = ("goal_position", "goal_rotation", "first_goal_position", "first_goal_rotation")
            asked = {name: getattr(state, name) for name in goals}
            begun = replace(initial_state(plan, self.rule, duration=state.duration), **asked)
        # On the loop's own steps: undisturbed, the tool is exactly on it.
        motion = motion_from(plan, self.rule, begun, min(self.time_step, state.duration))
        self._path = np.hstack(
            [
                motion.positions[:-1],
                motion.quaternions[:-1],
                # Of the step that leaves a sample.
                motion.linear_velocities[1:],
                motion.angular_velocities[1:],
            ]
        )
        self._last = len(self._path) - 1
        self._between = motion.duration / len(self._path)
        self.memory.set(state)
        self.memory.data[engine.BRAKING] = self.braking
        self._engine = self._engine_of(plan)

    def _engine_of(self, plan: Law) -> Virtual | Compiled:
        if self._library is None:
            return Virtual(plan, self.rule, self.memory, self.time_step)
        return Compiled(plan, self.rule, self.memory, self._library)

    def _measure(self, measured: State) -> bool:
        """Take over what was measured; steer, re-plan, or tell that the phase must wait."""
        if not isinstance(measured, State):
            raise InputError(f"measured_state must be a State, got {type(measured).__name__}")
        data, guidance = self.memory.data, self._guidance
        place = min(data.item(engine.FRACTION), 1.0) * len(self._path)
        k = min(int(place), self._last)
        given, path = guidance.measured, guidance.path
        given[_POSITION], given[_QUATERNION] = measured.position, measured.quaternion
        given[_LINEAR], given[_ANGULAR] = measured.linear_velocity, measured.angular_velocity
        done = self.done
        # After its end a tool is where it was sent.
        path[: STATE.size] = data[engine.MOVING] if done else self._path[k]
        path[_PASSED] = 0.0 if done else (place - k) * self._between
        path[_NOW] = data.item(engine.TIME)
        guidance()
        if not guidance.is_finite:
            raise InputError(
                "measured_state is not finite; leave it out where nothing was measured"
            )
        off = guidance.distance > 1 or guidance.angle > 1
        if done and not off and not self._goal_moved:
            # What is measured of a tool that holds its pose must not move it.
            data[engine.STEERING] = engine.NO_STEERING
            return False
        data[engine.MOVING] = guidance.state
        if self._speed != 1.0:
            return False
        wanted = (off or self._goal_moved) and self._may_replan
        if wanted and self._replan("goal" if self._goal_moved else "path"):
            return False
        data[engine.STEERING] = engine.NO_STEERING if off else guidance.steering
        return off

    def _replan(self, reason: Literal["path", "goal"]) -> bool:
        """Change the plan, if one is found; else the old one is followed on."""
        state = self.memory.state()
        self._pause = state.time + _PAUSE * self.law.duration
        far = np.linalg.norm(self._goal - state.position)
        try:
            # A plan of thousands of seconds would be sought for seconds, while the tool waits.
            if far > FARTHEST * self._length:
                raise InputError(
                    f"the goal is {far:.3g} m away, the whole path {self._length:.3g} m; adapt the "
                    "primitive to it first"
                )
            plan = replan(
                self.plan,
                self.rule,
                state,
                goal_position=self._goal,
                goal_rotation=self._goal_rotation,
                samples=self.samples,
            ).law
        except NoslipError as failure:
            self.replanned.append(Replanned(state.time, reason, np.nan, str(failure)))
            return False
        self.replanned.append(Replanned(state.time, reason, plan.duration))
        self._goal_moved = False
        begun = initial_state(
            plan, self.rule, start_position=state.position, start_rotation=state.rotation
        )
        self._follow(plan, begun)
        return True
