"""A primitive in a control loop: its command is its own; measurements steer clock and plans.

What is measured never overwrites what is commanded.  An observer (:mod:`noslip.control.observer`)
tells it apart into lag, bias, noise and a real displacement, and only the last one matters:

- *track*: within the band nothing happens.  Beyond, the clock of the plan slows down and stops
  (phase stopping: Ijspeert et al. 2013, section 2.3); a stiff robot comes back by itself.
- *yield* (``follows=True``): a tool that a hand holds aside is waited for; once it rests the
  command is moved to it, once, and one new plan leads on.
- *hold*: after the end.  Whenever the goal has moved, a new plan leads there.
- *fault*: a step failed; the command stands.

Bounds are met by time (:mod:`noslip.control.clock`): the clock runs at sigma <= 1, so that the
twist commanded is sigma times that of the plan, and rules homogeneous in the velocity hold exactly:
the engine steps in plan time.  Under rules that know the true time, or are not homogeneous, it
steps in true time with the duration stretched to T / sigma: the phase runs with the plan, the rules
with the time, and each step satisfies them exactly, too.

What cannot be, by any smooth feedback: that a tool which must not slip converges to a pose
(Brockett 1983); a push in the last moment needs a way back, which only a new plan, and time, give.
"""

from __future__ import annotations

from concurrent.futures import Future
from copy import deepcopy
from dataclasses import replace
from math import ceil, dist, expm1, isfinite, sqrt
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from noslip import _arguments
from noslip._typing import Floats
from noslip._values import LONGEST_REPR, is_same, shortened
from noslip.adapting import REPLANNED_SAMPLES, compiled
from noslip.control.clock import AT_REST, CELLS, Bounds, Schedule, runs_in_plan_time
from noslip.control.goal_filter import GoalFilter
from noslip.control.observer import SEEN, Observer, compile_now
from noslip.control.planning import (
    SMOOTHER,
    Made,
    Planner,
    Plans,
    Primitive,
    Reason,
    Replanned,
    Task,
    channels_at,
    channels_of,
    engine_of,
    reachable,
)
from noslip.errors import InputError, NoslipError
from noslip.law.clock import DONE
from noslip.law.law import Law
from noslip.runtime import engine
from noslip.runtime.engine import Compiled, Memory
from noslip.runtime.rollout import initial_state, rollout
from noslip.runtime.state import State, write_pose
from noslip.runtime.stepper import stepper_of

Mode = Literal["track", "yield", "hold", "fault"]
Pose = State | tuple[ArrayLike, Rotation]

TOLERANCE = 4e-3
"""Of the path's length: what is left within it is nobody's concern."""
ANGLE_TOLERANCE = 0.04
"""rad."""
BIAS, ANGLE_BIAS = 0.025, 0.06
"""Of the path's length, and rad: what may stand between command and measurement for ever."""
FASTER = 1.5
"""Times the peaks of the primitive's own motion."""
PLAN_WITHIN = 0.05
"""s: a plan takes some 20 ms."""
FARTHEST = 3.0
"""Over the path's length: a goal farther away is not planned for in the loop."""
MADE_GOOD, HALTED = 0.015, 0.1
"""s: so much of a late cycle is made good, in one command, which a robot takes for a little jump;
after a much longer one it has come to a halt, and the clock starts from 0."""
SILENT, SILENT_GAPS = 0.2, 10.0
"""s, and mean times between two measurements, after which a sensor is silent: the clock stops,
since what is not seen cannot be waited for."""
PERSIST = 0.05
"""s for which a tool must be off sideways to be yielded to: a knock is no hand."""
ACCEPT = 1.5
"""s after which an offset that stays is taken for a bias, or blocks."""
CALM, CALM_GAPS = 0.05, 3.0
"""s, and mean times between two measurements, for which a tool must rest to be followed."""
FOLLOW = 0.02
"""s, time constant of a command that is moved to the tool: nearly at once, without a jump."""
DEAREST = 0.75
"""Of the duration: how much longer than what is left a way on from where a tool is held may take.
One that takes longer is gone only if the tool stays there: most often it is let go before that."""
NO_TOOL = 1e6
"""Over the path's length: what is measured farther from the command is no tool, and no goal."""
_SMALLEST = 1e-12
"""Squared length of a quaternion that still is one; the largest is as large."""
FOLLOW_HASTE = 2.0
"""Over the bounds on rates, while it is: it goes where the tool is already."""
FUNNEL, DRIFT_FUNNEL = 0.02, 0.005
"""Of the way that remains: a goal that moved less is not planned for yet, after a jump, when little
is known of its noise, and else: the sooner it is planned for, the less a plan has to bend."""
GOAL_TOLERANCE, GOAL_ANGLE_TOLERANCE = 5e-4, 2.5e-3
"""Of the path's length, and rad: a goal that moved less is never planned for."""
LATE, LATE_WIDER = 0.25, 8.0
"""Of the duration: when less is left, so many times as much is not planned for: a way back is long
by then."""
GOAL_JUMP, GOAL_ANGLE_JUMP = 0.01, 0.05
"""Of the path's length, and rad: what is no noise of a goal."""
GOAL_SLOW = 0.02
"""Over the mean speed: a goal that moves more slowly rests."""
BETWEEN_PLANS, AFTER_FAILURE = 0.05, 0.1
"""Of the duration; after each failure in a row twice as long."""
HASTY, MOST_SLOWED = 1.05, 2
"""Times the speed that a new plan allows at its start, up to which it is handed over: by so much
may a command exceed its bounds for the few cycles that follow.  And how often it is made anew from
where the clock is slower instead, before it is given up for now."""
_DETOUR = 3.0
"""Way for which time is allotted to a displacement, over its length: it may lie sideways."""
_MORE = 1.3
"""Times as much time for a plan, after each failure in a row."""
_LEAST_TIME, _MOST_TIME = 0.2, 3.0
"""Of the duration: what a plan takes at least, and at most beyond what is left."""
PATIENCE = 0.2
"""s for which a goal must be off that did not jump: it begins to move, and its speed is not known
before."""
_LOOK_EVERY = 0.01
"""s between two looks at where the goal will be."""
_LEAST_RUN = 1e-4
"""Of a cycle: less is not worth a step, whose lengths are divided by."""
_STANDING = 1e15
"""Over the plan's duration: that of a motion which stands still."""
_POSE = slice(engine.MOVING.start, engine.MOVING.start + 7)
_TWIST = engine.VELOCITIES
_BUILT = ("_library", "_plans", "_planner", "_engine", "_job", "_now")
"""What a copy builds anew."""


class Controller:
    """Steps a primitive, and leads it on when what is measured is not what was planned.

    The step runs as machine code where a C compiler is found, and is compiled when this object is
    made (the first under these constraints: a second or some; later ones from a cache).

    Parameters
    ----------
    dmp : ConstrainedDMP
        Or whatever has a law and a rule.
    time_step : float
        Of the loop (s).
    follows : bool
        Whether the robot is compliant, and a hand that holds its tool aside is to be followed.
    lag : float, optional
        Of the robot behind its command (s); estimated, up to 0.2 s, unless it is told.
    tolerance : float
        Distance between command and tool, over the path's length, that is nobody's concern, besides
        lag, bias and noise.
    angle_tolerance : float
        The same of the orientation (rad).
    bias : float
        What may stand between command and measurement for ever, over the path's length.
    faster : float
        How many times the peak angular speed of its own motion a command may reach; of the linear
        speed half of that beyond 1, of both accelerations twice as many times.  ``inf`` bounds
        nothing: a motion that begins at speed begins so.
    samples : int
        Of a new plan, at most.
    replan : bool
        Whether new plans are made.  Without them goals are refused, and no hand is followed.
    plan_within : float
        Seconds of the loop within which a plan is made beside it; then it is handed over.
    real_time : bool
        Whether the loop never waits for a plan.  One that comes too late is made anew, from farther
        ahead.  By default the loop waits, so that what comes of it does not depend on the machine.
    braking : float
        Seconds within which a motion that ends at speed comes to rest after its end, straight on or
        as constraints lead it; 0: it comes to rest at its end, or at once if nothing is bounded.

    Attributes
    ----------
    plan : Law
        What is followed now.
    replanned : list of Replanned
    memory : Memory
        The state in place, see :meth:`advance`.
    mode : "track", "yield", "hold" or "fault"
    blocked : bool
        Whether the tool stays off by more than a bias may be.
    """

    def __init__(
        self,
        dmp: Primitive,
        time_step: float = 1e-3,
        *,
        follows: bool = False,
        lag: float | None = None,
        tolerance: float = TOLERANCE,
        angle_tolerance: float = ANGLE_TOLERANCE,
        bias: float = BIAS,
        faster: float = FASTER,
        samples: int = REPLANNED_SAMPLES,
        replan: bool = True,
        plan_within: float = PLAN_WITHIN,
        real_time: bool = False,
        braking: float = 0.0,
    ) -> None:
        if not dmp.law.space.is_pose or dmp.law.clock.returns:
            raise InputError(
                "Controller plans for a pose that comes to an end; dmp.controller(time_step=...) "
                "returns what steps this primitive"
            )
        self.law, self.rule, self._learned = dmp.law, dmp.rule, channels_of(dmp)
        self.follows, self.replans, self.real_time = follows, replan, real_time
        self.time_step = _arguments.positive("time_step", time_step, "seconds")
        self.lag = None if lag is None else _arguments.not_negative("lag", lag)
        self.tolerance = _arguments.positive("tolerance", tolerance)
        self.angle_tolerance = _arguments.positive("angle_tolerance", angle_tolerance, "rad")
        self.bias = _arguments.not_negative("bias", bias)
        if faster != np.inf:
            faster = _arguments.positive("faster", faster)
        self.faster = faster
        self.samples = _arguments.count("samples", samples)
        self.plan_within = _arguments.not_negative("plan_within", plan_within)
        self.braking = _arguments.not_negative("braking", braking)
        self.memory = Memory(dmp.law.clock, dmp.rule.system)
        nominal = rollout(dmp.law, dmp.rule, time_step=dmp.law.duration / CELLS)
        self._length, self._duration = nominal.path_length or 1.0, dmp.law.duration
        self._mean_speed = self._length / self._duration
        self._bounds = Bounds.of(nominal, self.faster)
        self._before, self._pose = np.zeros(7), np.zeros(7)
        self._reachable = np.eye(3)
        if replan:
            self._reachable = reachable(dmp.rule, initial_state(dmp.law, dmp.rule))
        self._build()
        self.reset()

    def __repr__(self) -> str:
        text = f"Controller(time_step={self.time_step:g}, {self.law!r}, {self.rule!r})"
        return shortened(text, LONGEST_REPR)

    def _build(self) -> None:
        """Build what is made of graphs, or shared."""
        self._library = stepper_of(self.rule).native.wait()
        compile_now()
        self._now = self.memory.data[_POSE]
        if self.replans:
            compiled.compile_for(self.rule)
        self._plans = Plans(
            self.rule,
            self._bounds,
            self._mean_speed,
            self.time_step,
            self.braking == 0,
            SMOOTHER,
        )
        self._planner = Planner(self.rule, self.memory, self.time_step, self._plans)
        self._job: Future[Made] | None = None

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name not in _BUILT}

    def __copy__(self) -> Controller:
        # What steps in place must not be shared.
        return deepcopy(self)

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._build()
        self._engine = engine_of(self.plan, self.rule, self.memory, self.time_step)
        self._observer.bind(self._now, self._before, self._pose)
        if self._task is not None:
            self._job = self._planner.begin(self._task)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Controller):
            return NotImplemented
        mine, theirs = self.__getstate__(), other.__getstate__()
        return all(is_same(value, theirs[name]) for name, value in mine.items())

    # It changes with each step.
    __hash__ = None  # type: ignore[assignment]

    def reset(self, state: State | None = None) -> State:
        """Begin anew, from a state of the primitive or from its start."""
        begun = initial_state(self.law, self.rule) if state is None else state
        self.replanned: list[Replanned] = []
        self.mode: Mode = "track"
        self.blocked, self._failure = False, ""
        self._time, self._next_plan, self._next_look, self._failures = 0.0, 0.0, 0.0, 0
        self._wanted_speed, self._ramp = 1.0, 0.0
        self._silent, self._goal_since = False, -1.0
        # Of the plan under way: what is asked, since when, and where it is handed over.
        self._task: Task | None = None
        self._job = None
        self._hand_over, self._due, self._ahead = 0.0, 0.0, self.plan_within
        self._arrive, self._slowed = 1.0, 0
        # Of a tool that is off: since when sideways, since when at rest and where.
        self._aside, self._rest, self._rest_at = -1.0, -1.0, np.zeros(3)
        self._stage: Literal["wait", "move", "look"] = "wait"
        self._since = 0.0
        self._observer = Observer(
            (self.tolerance * self._length, self.angle_tolerance),
            (self.bias * self._length / 3, ANGLE_BIAS / 3),
            self.lag,
            self.time_step,
        )
        self._observer.bind(self._now, self._before, self._pose)
        self._target, self._target_rotation = np.array(begun.goal_position), begun.goal_rotation
        self._goal_rotation = begun.goal_rotation
        slow = GOAL_SLOW / self._duration
        self._goal = GoalFilter(begun.goal_position, GOAL_JUMP * self._length, slow * self._length)
        self._goal_turn = GoalFilter(np.zeros(3), GOAL_ANGLE_JUMP, slow)
        self._channels = self._learned
        first = begun
        if begun.previous_step > 0:
            goals = ("goal_position", "goal_rotation", "first_goal_position", "first_goal_rotation")
            asked = {name: getattr(begun, name) for name in goals}
            first = replace(initial_state(self.law, self.rule, duration=begun.duration), **asked)
        self._follow(self.law, begun, self._plans.schedule(self.law, first, AT_REST))
        moves = self._schedule.begins_at_speed or begun.previous_step > 0
        self._speed = 0.0 if moves and isfinite(self.faster) else 1.0
        return self.state

    # ---------------------------------------------------------------- what it tells

    @property
    def state(self) -> State:
        """The last, or the one to begin with; its velocities are those commanded."""
        state = self.memory.state()
        if self._speed != 1.0 and self._in_plan_time:
            for name in ("linear_velocity", "angular_velocity", "constraint_residuals"):
                state.__dict__[name] = self._speed * state.__dict__[name]
        return state

    @property
    def done(self) -> bool:
        """Whether the command has come to its end, and the tool, where it is measured, too."""
        if self.mode != "hold" or self._task is not None:
            return False
        if not self._observer.seen.item(_SAMPLES):
            return True
        behind = self._observer.size("place", "behind", "left")
        return behind <= self._observer.seen.item(_BAND) and self._observer.seen.item(_PACE) == 1.0

    @property
    def channels(self) -> Floats:
        """What goes with the last command and follows its phase, shape (k,)."""
        return channels_at(self._channels, self.memory)

    @property
    def is_compiled(self) -> bool:
        """Whether the step runs as machine code."""
        return self._library is not None

    @property
    def speed(self) -> float:
        """Sigma: of the motion, over that of the plan; 0 while it stands, 1 undisturbed."""
        return self._speed

    @property
    def reason(self) -> str:
        """Why it does not just go on, in words; empty if it does."""
        off = self._observer.seen.item(_FAR)
        if self.mode == "fault":
            return self._failure
        if self.blocked:
            return f"blocked: the tool stays {off:.3g} m off"
        if self._silent:
            return f"nothing was measured for {self._observer.seen.item(_AGE):.3g} s"
        if self.mode == "yield":
            failure = self.replanned[-1].failure if self.replanned and self._failures else ""
            told = f"the tool is held aside, {off:.3g} m off"
            return f"{told}; no plan leads on: {failure}" if failure else told
        if self._wanted_speed == 0.0:
            return "paused"
        if self._observer.seen.item(_PACE) < 1.0:
            return f"the tool is {off:.3g} m off: waited for"
        return ""

    @property
    def lag_and_bias(self) -> tuple[float, Floats]:
        """What the robot makes of a command: its lag (s), and where it stands besides (m)."""
        return self._observer.seen.item(_LAG), self._observer.seen[SEEN["place_bias"]].copy()

    # ---------------------------------------------------------------- a cycle

    def step(
        self,
        measured_state: Pose | None = None,
        goal: ArrayLike | tuple[ArrayLike, Rotation] | Rotation | None = None,
        *,
        time_step: float | None = None,
    ) -> State:
        """Return the next state: what to command.

        Parameters
        ----------
        measured_state : State, or (position, Rotation), optional
            Where the tool was measured to be, if it was measured since the last step.  What is not
            finite is a sample that was lost.
        goal : array of shape (3,), Rotation, or a pair of both, optional
            Where to go, as seen now.  If no motion is found that ends there, the old goal stays,
            the reason is told in ``replanned``, and it is tried again.
        time_step : float, optional
            Since the last step (s), if it was not what it should be.

        Raises
        ------
        InputError
            If an argument is not of its kind; the state is as it was.  Whatever else goes wrong
            does not end the loop: see ``mode`` and ``reason``.
        """
        self.advance(measured_state, goal, time_step=time_step)
        return self.state

    def advance(
        self,
        measured_state: Pose | None = None,
        goal: ArrayLike | tuple[ArrayLike, Rotation] | Rotation | None = None,
        *,
        time_step: float | None = None,
    ) -> None:
        """Step in place, as :meth:`step` does, for loops that must not allocate.

        What comes of it stands in ``memory.data``, at the places that :mod:`noslip.runtime.engine`
        names; velocities are the plan's: what is commanded is :attr:`speed` times them.
        """
        h = self.time_step
        if time_step is not None:
            h = _arguments.positive("time_step", time_step, "seconds")
        is_measured = measured_state is not None and self._take(measured_state)
        if goal is not None:
            self._aim(goal)
        self._time += h
        if self.mode == "fault":
            return
        passed = min(h, max(MADE_GOOD, 2 * self.time_step))
        if h > max(HALTED, 2 * self.time_step):
            self._set_speed(0.0)
        try:
            self._cycle(h, passed, is_measured)
        except (NoslipError, ArithmeticError, ValueError) as failure:
            self.mode, self._failure, self._speed = "fault", str(failure), 0.0

    def _cycle(self, h: float, passed: float, is_measured: bool) -> None:
        """A cycle of h seconds, of which so many are made good."""
        data, seen = self.memory.data, self._observer.seen
        if is_measured:
            self._measure()
        if self._time >= self._next_look and (self._goal.last or self._goal_turn.last):
            self._next_look = self._time + _LOOK_EVERY
            self._look_at_goal()
        observes = seen.item(_SAMPLES) > 0
        if observes:
            self._before[:] = self._now
            silent = max(SILENT, SILENT_GAPS * seen.item(_GAP))
            self._silent = seen.item(_SAMPLES) > 3 and seen.item(_AGE) > silent
        before = data.item(engine.TIME)
        lost = 0.0
        if self.mode == "track":
            lost = self._track(passed)
        elif self.mode == "yield":
            self._yield(passed)
        else:
            self._hold(passed)
        if self._in_plan_time:
            data[engine.TIME] = before + h - lost
        else:
            # Rules that know the time know the true one, however much of it is made good.
            data[engine.TIME] += h - passed
        if observes:
            # Of a late cycle the robot made what it makes of any.
            self._observer.moved(h if passed == h else self.time_step)

    def pause(self, within: float | None = None) -> None:
        """Come to a halt on the path.

        Only the clock slows down: whatever holds of rows that are homogeneous in the velocity still
        holds.  A halted tool keeps the constraints too, and moves along with those that move.

        Parameters
        ----------
        within : float, optional
            Seconds; by default as fast as accelerations are bounded.  0 is at once.
        """
        self._head_for(0.0, within)

    def resume(self, within: float | None = None) -> None:
        """Go on after a :meth:`pause`, at full speed within some seconds."""
        self._head_for(1.0, within)

    # ---------------------------------------------------------------- the clock

    def _head_for(self, speed: float, within: float | None) -> None:
        self._wanted_speed, self._ramp = speed, 0.0
        if within is not None:
            within = _arguments.not_negative("within", within)
            self._ramp = 1 / within if within > 0 else np.inf

    def _track(self, h: float, halt: bool = False) -> float:
        """Run the plan for some seconds at the clock's speed; the seconds left at its end."""
        data, schedule, speed = self.memory.data, self._schedule, self._speed
        slows = halt or self._silent or self._task is not None or self._wanted_speed < 1.0
        if speed == 1.0 == self._observer.seen.item(_PACE) and schedule.is_free and not slows:
            return self._run(h, 1.0)
        fraction, duration = data.item(engine.FRACTION), self._plan_duration
        ramp = schedule.at("ramps", fraction)
        # Where this cycle ends, braking was foreseen; the least keeps it from stopping short.
        wanted = min(schedule.cap(fraction), schedule.cap(fraction + speed * h / duration))
        wanted = max(wanted, min(ramp * h, 1.0))
        if self._task is not None and self._arrive < 1.0:
            # Slow enough for the new plan where it is handed over.
            way = max(self._hand_over - fraction, 0.0) * duration
            wanted = min(wanted, sqrt(self._arrive**2 + 2 * ramp * way))
        if halt or self._silent or (self._task is not None and self._due > 0.0):
            # A plan that begins where it stands finds it there.
            wanted = 0.0
        elif self._observer.seen.item(_SAMPLES):
            wanted = min(wanted, self._observer.seen.item(_PACE))
        if self._wanted_speed < wanted:
            wanted, ramp = self._wanted_speed, self._ramp or ramp
        elif self._ramp:
            ramp = self._ramp
            if speed >= self._wanted_speed:
                self._ramp = 0.0
        if wanted != speed:
            speed += max(min(wanted - speed, ramp * h), -ramp * h)
        return self._run(h, speed)

    def _run(self, h: float, speed: float) -> float:
        """Run for some seconds at some speed; on the new plan, where it is handed over."""
        data = self.memory.data
        self._set_speed(speed)
        fraction, run = data.item(engine.FRACTION), speed * h
        due = self._task is not None and self._time >= self._due - 1e-9
        # In whole cycles: the twist of a cycle is then that of one step, which does not slip.
        if due and fraction >= self._hand_over - 1e-9 and self._adopted():
            fraction, speed = data.item(engine.FRACTION), self._speed
            run = speed * h
        left = (1 - fraction) * self._plan_duration
        lost = 0.0
        if run >= left - 1e-9 * h and self._in_plan_time and speed > 0:
            lost, run = (run - left) / speed, left
        if run > _LEAST_RUN * self.time_step or not self._in_plan_time or 0 < run == left:
            self._steps(h, run)
        if data.item(engine.FRACTION) >= DONE:
            self.mode = "hold"
        return max(lost, 0.0)

    def _steps(self, h: float, run: float) -> None:
        """Step the plan by so much of its time, or for so many seconds of the true one."""
        whole = run if self._in_plan_time else h
        count = max(1, round(whole / self.time_step))
        for _ in range(count):
            self._engine.step(whole / count)

    def _set_speed(self, speed: float) -> None:
        """Set the clock's speed; in true time, stretch the plan's duration."""
        if not self._in_plan_time and (speed != self._speed or speed == 0.0):
            data = self.memory.data
            if speed == 0.0:
                # What stands moves only as what holds it does.
                data[_TWIST] = 0.0
            else:
                velocity = self._schedule.velocity(data.item(engine.FRACTION))
                data[_TWIST] += (speed - self._speed) * velocity
            self._speed = speed
            self._stretch()
        self._speed = speed

    def _stretch(self) -> None:
        """In true time: stretch the plan's duration."""
        stretch = 1 / self._speed if self._speed > 0 else _STANDING
        self.memory.data[engine.DURATION] = self._plan_duration * stretch

    def _hold(self, h: float) -> None:
        """Hold the pose after the end; come to rest, move along with what moves."""
        data = self.memory.data
        if self._task is not None and self._time >= self._due - 1e-9 and self._adopted():
            return
        if self._in_plan_time:
            self._engine.step(max(self._speed, _LEAST_RUN) * h)
        else:
            data[engine.DURATION] = self._plan_duration
            self._engine.step(h)

    def _follow(
        self, plan: Law, state: State, schedule: Schedule, stepping: Compiled | None = None
    ) -> None:
        self.plan, self._schedule = plan, schedule
        self._plan_duration = state.duration
        self._in_plan_time = runs_in_plan_time(self.rule.system)
        self.memory.set(state)
        self.memory.data[engine.BRAKING] = self.braking
        self._engine = stepping or engine_of(plan, self.rule, self.memory, self.time_step)

    # ---------------------------------------------------------------- what is measured

    def _take(self, measured: Pose) -> bool:
        """Take over a measured pose; whether it is one."""
        pose = self._pose
        write_pose("measured_state", measured, pose)
        x, y, z, w, i, j, k = pose.tolist()
        # Written so that NaN fails.
        if not _SMALLEST < w * w + i * i + j * j + k * k < 1 / _SMALLEST:
            return False
        away = dist((x, y, z), self.memory.data[engine.POSITION].tolist())
        return away <= NO_TOOL * self._length

    def _measure(self) -> None:
        observer, seen = self._observer, self._observer.seen
        learns = self.mode != "yield" and seen.item(_PACE) == 1.0
        observer.measured(learns)
        if self.mode == "yield":
            return
        self._accept()
        if not (self.follows and self.replans and self.mode == "track"):
            return
        # Sideways: what no lag and no stall explains.
        if seen.item(_FAR) > 1.5 * seen.item(_BAND):
            left = seen[SEEN["place_left"]]
            v = self.memory.data[engine.LINEAR]
            v = v / (np.linalg.norm(v) + 1e-12)
            if np.linalg.norm(left - (left @ v) * v) > 1.5 * seen.item(_BAND):
                if self._aside < 0:
                    self._aside = self._time
                if self._time - self._aside >= PERSIST:
                    self.mode, self._stage = "yield", "wait"
                    self._rest = self._aside = -1.0
                    self._task = self._job = None
                return
        self._aside = -1.0

    def _accept(self) -> None:
        """Take an offset that stays for a bias, if it is small enough; else it blocks."""
        seen = self._observer.seen
        if seen.item(_PACE) == 1.0:
            self._rest, self.blocked = -1.0, False
            return
        left = seen[SEEN["place_left"]]
        moved = np.linalg.norm(left - self._rest_at) > 0.5 * seen.item(_BAND)
        if self._rest < 0 or moved:
            self._rest, self._rest_at = self._time, left.copy()
        if self._time - self._rest > ACCEPT:
            self._settle()
            self._rest = -1.0

    def _settle(self) -> None:
        """Of an offset that has stayed: a bias, or it blocks."""
        observer = self._observer
        small = observer.size("place", "bias", "left") <= self.bias * self._length
        self.blocked = not small or observer.size("turn", "bias", "left") > ANGLE_BIAS
        if not self.blocked:
            observer.accept()

    def _yield(self, h: float) -> None:
        """Wait until the tool rests; plan from there; move the command there, once; look; go on."""
        observer, seen, data = self._observer, self._observer.seen, self.memory.data
        calm = max(CALM, CALM_GAPS * seen.item(_GAP))
        if self._speed > 0:
            self._track(h, halt=True)
            if self.mode == "hold":
                return
        if self._stage == "wait":
            self._wait(calm)
        elif self._stage == "move" and self._task is not None:
            # To a place that is fixed: nothing can run away.
            goes = self._task.memory
            turned = Rotation.from_quat(data[engine.QUATERNION], scalar_first=True)
            turn = Rotation.from_quat(goes[engine.QUATERNION], scalar_first=True) * turned.inv()
            steps = [goes[engine.POSITION] - data[engine.POSITION], turn.as_rotvec()]
            most = self._bounds.speed, self._bounds.rate
            near = 0.1 * self.tolerance * self._length, 0.1 * self.angle_tolerance
            sizes = [float(np.linalg.norm(step)) for step in steps]
            # The last of it whole: the plan starts just there.
            arrives = sizes[0] < near[0] and sizes[1] < near[1]
            part = 1.0 if arrives else -expm1(-h / FOLLOW)
            for i in (0, 1):
                share, allowed = part, FOLLOW_HASTE * most[i] * h
                if share * sizes[i] > allowed:
                    share, arrives = allowed / sizes[i], False
                steps[i] = share * steps[i]
            if arrives:
                self._stage, self._since, self._rest = "look", self._time, -1.0
            data[engine.POSITION] += steps[0]
            turned = Rotation.from_rotvec(steps[1]) * turned
            data[engine.QUATERNION] = turned.as_quat(scalar_first=True)
            observer.shifted(*steps)
        elif self._time - self._since >= max(calm, 3 * seen.item(_LAG)):
            if seen.item(_PACE) < 1.0:
                if observer.size("place", "bias", "left") > self.bias * self._length:
                    self._accept()
                    return
                # It went along: a bias.
                observer.accept()
            self._adopted()

    def _wait(self, calm: float) -> None:
        """Wait until the tool is back, or rests where a plan leads on from."""
        seen, data = self._observer.seen, self.memory.data
        if seen.item(_PACE) == 1.0:
            # It came back by itself.
            self.mode, self.blocked = "track", False
            self._task = self._job = None
            return
        left = seen[SEEN["place_left"]]
        tool = data[engine.POSITION] + seen[SEEN["place_behind"]] + seen[SEEN["place_bias"]] + left
        rests = 0.5 * self.tolerance * self._length + 4.5 * np.sqrt(seen.item(_VARIANCE))
        if self._rest < 0 or np.linalg.norm(tool - self._rest_at) > rests:
            self._rest, self._rest_at = self._time, tool
            self._task = self._job = None
        if self._time - self._rest < calm or self._speed > 0:
            return
        if self._task is not None:
            if self._time >= self._due - 1e-9 and self._leads_on():
                self._stage, self.blocked = "move", False
        elif self._time >= self._next_plan:
            turn = Rotation.from_quat(data[engine.QUATERNION], scalar_first=True)
            if seen.item(_TURN_FAR) > seen.item(_TURN_BAND):
                turn = Rotation.from_rotvec(seen[SEEN["turn_left"]]) * turn
            place = data[engine.POSITION] + self._reachable @ left
            self._plan("push", self._target, self._target_rotation, held=(place, turn))
        elif self._time - self._rest > ACCEPT:
            self._settle()

    def _leads_on(self) -> bool:
        """Whether the plan from where the tool is held is there, and takes not too long."""
        job, held = self._job, self._time - self._rest
        if job is None or (self.real_time and not job.done()):
            return False
        made = job.result()
        if made.schedule is None:
            self._task = self._job = None
            self._failed("push", made.failure)
            return False
        left = self._schedule.at("left", self.memory.data.item(engine.FRACTION))
        return held > ACCEPT or made.schedule.left.item(0) <= left + DEAREST * self._duration

    # ---------------------------------------------------------------- goals and plans

    def _aim(self, goal: Any) -> None:
        """Take a sample of the goal."""
        if not self.replans:
            raise InputError("goal: this controller makes no plans (replan=False)")
        position, rotation = goal if isinstance(goal, tuple) and len(goal) == 2 else (goal, None)
        if isinstance(position, Rotation):
            position, rotation = rotation, position
        if rotation is not None:
            rotation = _arguments.rotation("goal", rotation)
        if position is not None:
            place = _arguments.vector("goal", position).tolist()
            away = dist(place, self.memory.data[engine.POSITION].tolist())
            if not away <= NO_TOOL * self._length:
                raise InputError(
                    f"goal: {away:.3g} m away, the whole path {self._length:.3g} m; check its "
                    "unit and frame"
                )
            self._goal.take(self._time, place)
        if rotation is not None:
            turn = (rotation * self._goal_rotation.inv()).as_rotvec()
            last = np.array(self._goal_turn.last or turn)
            angle = float(np.linalg.norm(turn))
            if angle > 0 and last @ turn < 0 and np.linalg.norm(turn - last) > np.pi:
                # The same rotation, the other way round.
                turn = turn * (1 - 2 * np.pi / angle)
            self._goal_turn.take(self._time, turn.tolist())

    def _aim_at(self, ahead: float) -> tuple[Floats, Rotation, float, float]:
        """Where the goal will be, and the standard deviations of that (m, rad)."""
        position, off = self._goal.ahead(ahead) if self._goal.last else (self._target, 0.0)
        rotation, turned = self._target_rotation, 0.0
        if self._goal_turn.last:
            turn, turned = self._goal_turn.ahead(ahead)
            rotation = Rotation.from_rotvec(turn) * self._goal_rotation
        # What no motion reaches is noise, if it is small.
        beyond = position - self._target
        beyond = beyond - self._reachable @ beyond
        if np.linalg.norm(beyond) <= GOAL_JUMP * self._length:
            position = position - beyond
        return position, rotation, off, turned

    def _look_at_goal(self) -> None:
        """Plan for the goal, if it has moved out of the funnel."""
        for part in (self._goal, self._goal_turn):
            # What was told holds until it is told otherwise.
            if part.last:
                part.take(self._time, part.last)
        if self._task is not None or self.mode == "yield" or self._time < self._next_plan:
            return
        fraction = self.memory.data.item(engine.FRACTION)
        tracks = self.mode == "track"
        left = self._schedule.at("left", fraction) if tracks else 0.0
        aim, rotation, deviation, turned = self._aim_at(left)
        if self._goal.is_jumping or self._goal_turn.is_jumping:
            return
        jumped = max(self._goal.since, self._goal_turn.since) >= self._time - PATIENCE
        wide = 1.0 if tracks and left >= LATE * self._duration else LATE_WIDER
        funnel = FUNNEL if jumped else DRIFT_FUNNEL
        funnel *= self._schedule.at("way", fraction) if tracks else 0.0
        off = float(np.linalg.norm(aim - self._target))
        turn = (rotation * self._target_rotation.inv()).magnitude()
        near = off <= max(wide * GOAL_TOLERANCE * self._length, funnel) + 4 * deviation
        if near and turn <= wide * GOAL_ANGLE_TOLERANCE + 4 * turned:
            self._goal_since = -1.0
            return
        if self._goal_since < 0:
            self._goal_since = self._time
        if jumped or self._time - self._goal_since >= PATIENCE:
            self._goal_since = -1.0
            self._plan("goal", aim, rotation)

    def _plan(
        self,
        reason: Reason,
        aim: Floats,
        rotation: Rotation,
        arrive: float = 1.0,
        held: tuple[Floats, Rotation] | None = None,
    ) -> None:
        """Begin to plan, from where the command will be, with so much of the clock's speed.

        Or, while it stands, from a pose where the tool is held.
        """
        data, h, speed = self.memory.data, self.time_step, self._speed
        fraction = data.item(engine.FRACTION)
        step = speed * h if self.mode == "track" else 0.0
        steps = ceil(self._ahead / h - 1e-9) if step > 0 else 0
        if step > 0 and arrive < speed:
            # A little farther than it takes to brake.
            ramp = self._schedule.at("ramps", fraction)
            steps += ceil(1.1 * (speed * speed - arrive * arrive) / (2 * ramp) / step)
        place = min(fraction + steps * step / self._plan_duration, 1.0)
        memory, aside = data.copy(), 0.0
        if held is not None:
            memory[engine.POSITION] = held[0]
            memory[engine.QUATERNION] = held[1].as_quat(scalar_first=True)
            aside = float(np.linalg.norm(held[0] - data[engine.POSITION]))
        duration = self._time_for(aim, place, aside)
        if reason == "goal":
            # To where it is when this arrives.
            late = max(self._schedule.left.item(0) - self._plan_duration, 0.0)
            aim, rotation, *_ = self._aim_at(duration + late + self._ahead)
            duration = self._time_for(aim, place, aside)
        far = float(np.linalg.norm(aim - data[engine.POSITION]))
        self._next_plan = self._time + BETWEEN_PLANS * self._duration
        if far > FARTHEST * self._length:
            # A plan of thousands of seconds would be sought for seconds.
            self._failed(
                reason,
                f"the goal is {far:.3g} m away, the whole path {self._length:.3g} m; adapt the "
                "primitive to it first",
            )
            return
        if not self._in_plan_time:
            memory[engine.DURATION] = self._plan_duration
            memory[_TWIST] += (1 - self._speed) * self._schedule.velocity(fraction)
        self._task = Task(
            reason,
            self.plan,
            memory,
            steps,
            step,
            place >= DONE,
            np.asarray(aim),
            rotation,
            duration,
            self.samples,
        )
        # Where it stands there is no place to come to, only a time.
        self._hand_over, self._arrive = place, arrive
        self._due = 0.0 if steps else self._time + self._ahead
        self._job = self._planner.begin(self._task)

    def _time_for(self, aim: Floats, place: float, aside: float) -> float:
        """At the primitive's own mean speed, never that of the plan which happens to run."""
        schedule, T = self._schedule, self._duration
        way, left = schedule.at("way", place), (1 - place) * self._plan_duration
        off = aside + float(np.linalg.norm(aim - self._target))
        detour = _DETOUR * off * off / (off + way) if off > 0 else 0.0
        needed = max(left, way / self._bounds.speed) + detour / self._mean_speed
        # What was not found in that time may be in more.
        needed = max(needed, _LEAST_TIME * T, 20 * self.time_step) * _MORE**self._failures
        return min(needed, left + _MOST_TIME * T)

    def _adopted(self) -> bool:
        """Take over the plan that was made; whether there is one."""
        task, job = self._task, self._job
        if task is None or job is None:
            return False
        if self.real_time and not job.done():
            if self._speed > 0 and self.mode == "track":
                # The place is passed: the old plan goes on, the new one is made from farther ahead.
                self._task = self._job = None
                self._ahead = min(2 * self._ahead, 10 * self.plan_within)
                self._next_plan = self._time
            return False
        self._task = self._job = None
        made = job.result()
        if made.plan is None or made.state is None or made.schedule is None:
            self._failed(task.reason, made.failure)
            return False
        cap = made.schedule.cap(0.0)
        if self._speed > HASTY * cap and not task.resting:
            # It bends too sharply for this speed: a like one is made from where it is slower.
            self._slowed += 1
            assert task.goal_rotation is not None
            if self._slowed <= MOST_SLOWED:
                self._plan(task.reason, task.goal_position, task.goal_rotation, 0.9 * cap)
            else:
                self._slowed = 0
                self._failed(task.reason, "every plan bends too sharply for the speed")
                self._next_plan = self._time + BETWEEN_PLANS * self._duration
            return False
        self._slowed = self._failures = 0
        data = self.memory.data
        self.replanned.append(Replanned(data.item(engine.TIME), task.reason, made.plan.duration))
        begun = replace(
            made.state,
            time=data.item(engine.TIME),
            position=data[engine.POSITION].copy(),
            rotation=data[engine.QUATERNION].copy(),
        )
        if not task.resting:
            # Pose and twist are handed over as they are.
            begun = replace(
                begun,
                linear_velocity=data[engine.LINEAR].copy(),
                angular_velocity=data[engine.ANGULAR].copy(),
                previous_step=data.item(engine.PREVIOUS_STEP),
            )
        # As far beyond the place as the old plan has come.
        beyond = max(data.item(engine.FRACTION) - self._hand_over, 0.0) * self._plan_duration
        self._channels = self._channels and self._channels.after(self._hand_over)
        self._follow(made.plan, begun, made.schedule, made.engine)
        data[engine.FRACTION] = beyond / self._plan_duration
        assert task.goal_rotation is not None
        self._target, self._target_rotation = task.goal_position, task.goal_rotation
        if task.resting:
            self._speed = 0.0
        elif not self._in_plan_time:
            self._stretch()
        self.mode = "track"
        return True

    def _failed(self, reason: Reason, failure: str) -> None:
        self.replanned.append(Replanned(self._time, reason, np.nan, failure))
        self._next_plan = self._time + AFTER_FAILURE * 2**self._failures * self._duration
        self._failures = min(self._failures + 1, 10)


def _place(channel: str, name: str) -> int:
    return SEEN.index(f"{channel}_{name}")


_SAMPLES, _AGE, _GAP = _place("place", "samples"), SEEN.index("age"), SEEN.index("gap")
_LAG, _VARIANCE = _place("place", "lag"), _place("place", "variance")
_FAR, _BAND = _place("place", "far"), _place("place", "band")
_PACE = SEEN.index("pace")
_TURN_FAR, _TURN_BAND = _place("turn", "far"), _place("turn", "band")
