"""Any motion in a control loop: vectors, joints, rhythms, several tools.

The law itself leads on, as in Ijspeert et al. (2013), section 2.3:

- the command goes on from what was commanded, whatever is measured;
- what is measured is compared with the commands of the last 0.2 s: its distance to the last one
  slows the clock, ``duration / sigma`` with ``sigma = 1 / (1 + e^2)`` (phase stopping, their eq.
  2.14), its distance to all of them is no lag;
- where that stays beyond a tolerance the command moves to what was measured, once, and goes on
  from there.

What nothing constrains, and a rhythm, a law leads to any goal:

- goals are filtered, critically damped;
- what a displacement, or a goal that moved, leaves to be done is foretold by the attractor, and at
  its end the phase waits for that.

Under constraints it would end where they let it.  So a new plan is made beside the loop, as in
:mod:`noslip.control.controller`, from where the command will be, and handed over there.

The clock slows by a longer duration: velocities shrink with it, as in
:func:`noslip.runtime.rhythm.retimed`, so rules that are homogeneous in the velocity hold in each
step, and rules that know the time know the true one.
"""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Future
from copy import deepcopy
from dataclasses import replace
from math import ceil, exp, log1p
from math import log as ln
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from noslip import _arguments
from noslip._typing import Floats
from noslip._values import LONGEST_REPR, is_same, shortened
from noslip.adapting import REPLANNED_SAMPLES, compiled
from noslip.boundary import rotations_of
from noslip.control.clock import Bounds, Schedule
from noslip.control.planning import (
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
)
from noslip.errors import InputError, NoslipError
from noslip.law.attractor import Attractor
from noslip.law.clock import DONE
from noslip.law.points import quaternions_of, rotation_of
from noslip.runtime.engine import Memory
from noslip.runtime.motion import Motion
from noslip.runtime.rollout import admissible, initial_state, point_or_parts, rollout, turn_of
from noslip.runtime.state import State
from noslip.runtime.stepper import stepper_of

Point = State | ArrayLike | tuple[ArrayLike, Rotation] | Mapping[str, tuple[ArrayLike, Rotation]]

TOLERANCE = 0.025
"""Of the path's length: as much as a bias of a pose may be."""
ANGLE_TOLERANCE = 0.06
"""rad."""
LAG, MOST_KEPT = 0.2, 100
"""s: as far behind as the command may be looked for; and how many commands are kept for that."""
PERSIST = 0.2
"""s for which something must be off before it is no knock."""
COMES_BACK = 0.8
"""What is off by less than so much of what it was is coming back by itself."""
SILENT = 0.2
"""s without a sample after which what was measured is not known any more: the clock waits."""
EASE = 0.05
"""Of the duration: time constant of the clock's changes and of goals; the attractor's is 0.08."""
SLOWEST = 1e-3
"""Sigma of a clock that waits: creeping, since velocities of none could not be scaled up again."""
LEFT = 1e-3
"""Of the tolerance: what is left of a displacement at the end is nobody's concern."""
PLAN_WITHIN = 0.1
"""s: a plan takes some 0.1 s."""
FASTER = 1.5
"""Times the peak angular speed of its own motion, and as in :class:`noslip.Controller` of other
speeds and of accelerations: beyond, the clock of a plan slows down."""
GOAL_MOVED = 0.02
"""Of the tolerance: a goal that moved less is not planned for."""
BETWEEN_PLANS, AFTER_FAILURE, GIVEN_UP = 0.05, 0.1, 5
"""Of the duration; after each failure in a row twice as long.  After so many it is done without."""
_MORE = 1.3
"""Times as much time for a plan, after each failure in a row."""
HASTY, _STANDS = 1.05, 0.02
"""Times the speed that a new plan allows at its start, up to which it is handed over; and the speed
of the clock at which what is to halt stands: the rest is dropped."""
_LATER = 10
"""Times as far ahead, at most, when plans come too late."""
_BUILT = ("_engine", "_planner", "_job")
"""What a copy builds anew."""
_SETTLED = 1e-9
"""Difference at which a filter has arrived."""
_ALMOST = 1 - 1e-3
"""Fraction of the motion at which the phase waits, at most: DONE is beyond."""
_LEAST_STEP = 1e-3
"""Of a step: the last one takes along what is less, whose velocities would be rounding."""
_FADED = 1e-4
"""Share of the learned force that leads a motion which ends at speed past its goal by next to
nothing."""


class SpaceController:
    """Steps a primitive of any space and clock, and heeds what is measured.

    Parameters
    ----------
    dmp : ConstrainedDMP
        Or whatever has a law and a rule.
    time_step : float
        Of the loop (s).
    tolerance : float or array, shape (n,), optional
        How far each coordinate may be off, in its own unit: by a bias, or noise.  By default 2.5 %
        of the length of the path through all coordinates of that unit; those that do not move may
        be anywhere.
    angle_tolerance : float
        The same of rotations (rad).
    replan : bool
        Whether new plans are made under constraints.  Without them it ends where these let it.
    samples : int
        Of a new plan, at most.
    plan_within : float
        Seconds of the loop within which a plan is made beside it; then it is handed over.
    real_time : bool
        Whether the loop never waits for a plan.  One that comes too late is made anew, from farther
        ahead.  By default the loop waits, so that what comes of it does not depend on the machine.

    Attributes
    ----------
    plan : Law
        What is followed now.
    replanned : list of Replanned
    memory : Memory
        The state in place.
    taken_over : int
        How often the command has moved to what was measured.
    """

    def __init__(
        self,
        dmp: Primitive,
        time_step: float = 1e-3,
        *,
        tolerance: ArrayLike | None = None,
        angle_tolerance: float = ANGLE_TOLERANCE,
        replan: bool = True,
        samples: int = REPLANNED_SAMPLES,
        plan_within: float = PLAN_WITHIN,
        real_time: bool = False,
    ) -> None:
        self.law, self.rule, self._learned = dmp.law, dmp.rule, channels_of(dmp)
        self.time_step = _arguments.positive("time_step", time_step, "seconds")
        self.replans = replan and dmp.rule.system.size > 0 and not dmp.law.clock.returns
        self.samples = _arguments.count("samples", samples)
        self.plan_within = _arguments.not_negative("plan_within", plan_within)
        self.real_time = real_time
        angle = _arguments.positive("angle_tolerance", angle_tolerance, "rad")
        motion = rollout(self.law, self.rule)
        self.tolerance = self._tolerance(tolerance, motion)
        self._tolerances = np.append(self.tolerance, np.full(self.law.space.angular, angle))
        self.memory = Memory(self.law.clock, self.rule.system)
        stepper_of(self.rule).native.wait()
        self._bounds = Bounds.of(motion, FASTER)
        self._mean_speed = (motion.path_length or 1.0) / motion.duration
        self._build()
        self.reset()

    def _build(self) -> None:
        """Build what is made of graphs, or shared."""
        if self.replans:
            compiled.compile_for(self.rule)
        plans = Plans(self.rule, self._bounds, self._mean_speed, self.time_step)
        self._planner = Planner(self.rule, self.memory, self.time_step, plans)
        self._job: Future[Made] | None = None

    def _tolerance(self, given: ArrayLike | None, motion: Motion) -> Floats:
        space = self.law.space
        if given is not None:
            if np.ndim(given) == 0:
                given = np.full(space.linear, _arguments.positive("tolerance", given))
            found = _arguments.vector("tolerance", given, size=space.linear)
            if not (found > 0).all():
                raise InputError(f"tolerance must be above 0, got {_arguments.short(given)}")
            return found
        steps = np.diff(motion.positions, axis=0)
        found = np.empty(space.linear)
        for unit in set(space.units):
            alike = np.array([each == unit for each in space.units])
            length = float(np.linalg.norm(steps[:, alike], axis=1).sum())
            found[alike] = TOLERANCE * length or np.inf
        return found

    def __repr__(self) -> str:
        text = f"SpaceController(time_step={self.time_step:g}, {self.law!r}, {self.rule!r})"
        return shortened(text, LONGEST_REPR)

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name not in _BUILT}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._build()
        self._engine = engine_of(self.plan, self.rule, self.memory, self.time_step)
        if self._task is not None:
            self._job = self._planner.begin(self._task)

    def __copy__(self) -> SpaceController:
        # What steps in place must not be shared.
        return deepcopy(self)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, SpaceController):
            return NotImplemented
        mine, theirs = self.__getstate__(), other.__getstate__()
        return all(is_same(value, theirs[name]) for name, value in mine.items())

    # It changes with each step.
    __hash__ = None  # type: ignore[assignment]

    def reset(self, state: State | None = None) -> State:
        """Begin anew, from a state of the primitive or from its start."""
        begun = initial_state(self.law, self.rule) if state is None else state
        none = np.zeros(self.law.space.velocity_size)
        self.memory.set(begun)
        self._duration, self._amplitude, self.taken_over = begun.duration, begun.amplitude, 0
        # Of the clock: what it is, what it is led to, and what a plan allows it.
        self._speed = 1.0
        self._schedule: Schedule | None = None
        self._sigma, self._force = _Damped(1.0, 1.0), _Damped(begun.amplitude, begun.amplitude)
        goal = np.append(begun.goal_position, begun.goal_quaternion)
        # The goal asked for; where the one that leads is besides; what the motion has left to do.
        self._goal, self._aside, self._left = goal, _Damped(none, 0.0), _Led(none)
        # What is followed, where it leads, where the plan under way is to lead, and whether the
        # command was moved since.
        self.plan, self._planned, self._sought, self._pushed = self.law, goal, goal, False
        self._channels = self._learned
        self.replanned: list[Replanned] = []
        self._task: Task | None = None
        self._job = None
        # Of the plan under way: where or when it is handed over, and how far ahead that is.
        self._hand_over, self._due, self._ahead = 0.0, 0.0, self.plan_within
        self._next_plan, self._failures, self._halts = 0.0, 0, False
        # Over the tolerance: how far off it was measured, and by no lag.
        self._off = self._beyond = 0.0
        self._clock = 0.0
        self._seen_at = self._since = -1.0
        self._at_first, self._may_take_over = 0.0, True
        rows = min(ceil(LAG / self.time_step), MOST_KEPT)
        self._every = ceil(LAG / self.time_step / rows)
        self._kept, self._count = np.tile(self._point, (rows, 1)), 0
        self._engine = engine_of(self.plan, self.rule, self.memory, self.time_step)
        return self.state

    # ---------------------------------------------------------------- what it tells

    @property
    def state(self) -> State:
        """The last, or the one to begin with."""
        return self.memory.state()

    @property
    def channels(self) -> Floats:
        """What goes with the last command and follows its phase, shape (k,)."""
        return channels_at(self._channels, self.memory)

    @property
    def done(self) -> bool:
        """Whether the command has come to its end, and what is measured, too; a rhythm never."""
        over = self.law.clock.is_over(self.memory.data.item(self.memory.at.fraction))
        return over and not self._needed() and not self._is_planning and self._beyond <= 1

    @property
    def speed(self) -> float:
        """Sigma: of the motion, over its own; 1 undisturbed."""
        return self._speed

    @property
    def reason(self) -> str:
        """Why it does not just go on, in words; empty if it does."""
        if self._is_silent:
            return f"nothing was measured for {self._clock - self._seen_at:.3g} s"
        if self._off > 1:
            return f"what is measured is off by {self._off:.3g} times the tolerance: waited for"
        if self._needed():
            return "the goal, or what moves, was displaced: the phase waits"
        if self._failures:
            return f"no plan leads to the goal: {self.replanned[-1].failure}"
        return ""

    @property
    def _is_silent(self) -> bool:
        return 0 <= self._seen_at < self._clock - SILENT

    @property
    def _point(self) -> Floats:
        at = self.memory.at
        return np.append(self.memory.data[at.position], self.memory.data[at.quaternion])

    # ---------------------------------------------------------------- a cycle

    def step(
        self,
        measured_state: Point | None = None,
        goal: Point | None = None,
        *,
        time_step: float | None = None,
    ) -> State:
        """Return the next state: what to command.

        Parameters
        ----------
        measured_state : State, or a point, optional
            What was measured, if it was since the last step.  A point is an array of shape (n,); of
            what turns a pair (position, Rotation), or a mapping of all bodies to such pairs.
        goal : a point, optional
            Where to go, as seen now; of a rhythm, what it goes around.
        time_step : float, optional
            Since the last step (s), if it was not what it should be.

        Raises
        ------
        InputError
            If an argument is not of its kind; nothing has changed then.  Or if the step is not
            finite, which no argument makes it within the range of what can be computed with.
        """
        h = self.time_step
        if time_step is not None:
            h = _arguments.positive("time_step", time_step, "seconds")
        measured = None
        if measured_state is not None:
            measured = self._point_of("measured_state", measured_state)
        if goal is not None:
            self._aim(self._point_of("goal", goal))
        self._clock += h
        if measured is not None:
            self._heed(measured)
        self._lead_goal(h)
        if self._task is None and self._is_planning and self._clock >= self._next_plan:
            self._plan()
        slow = SLOWEST if self._is_silent or self._halts else 1 / (1 + max(0.0, self._off - 1) ** 2)
        self._slow_to(max(slow, SLOWEST), h)
        self._advance(h)
        self._count += 1
        if self._count % self._every == 0:
            self._kept[self._count // self._every % len(self._kept)] = self._point
        return self.state

    def _point_of(self, name: str, given: Any) -> Floats:
        """Coordinates and quaternions of what is given, checked."""
        space = self.law.space
        if isinstance(given, State):
            point = np.append(given.position, given.quaternion)
            return _arguments.vector(name, point, size=space.point_size)
        bodies = {body.name for body in space.bodies}
        if name != "goal" and isinstance(given, Mapping) and set(given) != bodies:
            missing = ", ".join(sorted(bodies - set(given))) or "others are named"
            raise InputError(f"{name}: all bodies are measured at once; missing: {missing}")
        position, rotation = point_or_parts(self.law, name, given, None, None)
        place = _arguments.vector(name, position, size=space.linear)
        if rotation is None:
            return place
        return np.append(place, quaternions_of(space, turn_of(space, name, rotation)))

    def _advance(self, h: float) -> None:
        """Step; at the end the phase waits for what is left to be done."""
        data, at, clock = self.memory.data, self.memory.at, self.law.clock
        if self._is_due:
            self._adopt()
        fraction, time, duration = (
            data.item(place) for place in (at.fraction, at.time, at.duration)
        )
        share, left = h / duration, clock.left(fraction)
        waits = left <= share and self._needed() > 0
        if waits:
            # Each step is whole, though the phase does not come so far.
            data[at.fraction] = max(0.0, 1 - share)
            # What there leads to the end, or past it, would lead away while it is repeated.
            self._force.step(0.0, share / EASE)
            data[at.amplitude] = self._force.value
            data[at.first_goal_position] = data[at.goal_position]
            data[at.first_goal_quaternion] = data[at.goal_quaternion]
        elif 0 < left - share < _LEAST_STEP * share:
            h = left * duration
        try:
            self._engine.step(h)
        finally:
            if waits:
                data[at.fraction] = min(fraction, _ALMOST)
        self._left.step(self.law.attractor, self._aside.value, share)
        if waits:
            data[at.time] = time + h

    def _slow_to(self, sigma: float, h: float) -> None:
        """Lead the clock's speed a step nearer to another one: the duration is stretched."""
        if self._sigma.step(sigma, h / (EASE * self._duration)):
            self._sigma.value = min(max(self._sigma.value, SLOWEST), 1.0)
        data, speed = self.memory.data, float(self._sigma.value)
        if self._schedule is not None:
            # Where this cycle ends, braking was foreseen.
            fraction, most = data.item(self.memory.at.fraction), self._schedule.cap
            ramp = h * self._schedule.at("ramps", fraction)
            allowed = min(most(fraction), most(fraction + self._speed * h / self._duration))
            speed = max(min(speed, allowed), self._speed - ramp, SLOWEST)
            speed = min(speed, self._speed + ramp)
        if speed != self._speed:
            self._speed = speed
            self._stretch(data, self._duration / speed)

    def _stretch(self, data: Floats, duration: float) -> None:
        """Give a state another duration, in which it goes on along the same path."""
        at = self.memory.at
        slower = data.item(at.duration) / duration
        data[at.linear] *= slower
        data[at.angular] *= slower
        data[self.memory.equalities] *= slower
        data[at.pull_in] *= slower
        data[at.previous_step] /= slower
        data[at.duration] = duration

    # ---------------------------------------------------------------- what is measured

    def _heed(self, measured: Floats) -> None:
        """Tell a lag from a displacement; take one over that stays."""
        space, now = self.law.space, self._point
        known = np.vstack([self._kept, now])
        away = space.difference(np.broadcast_to(measured, known.shape), known) / self._tolerances
        sizes = np.abs(away).max(axis=1)
        self._seen_at = self._clock
        self._off, self._beyond = float(sizes[-1]), float(sizes.min())
        if self._beyond <= 1:
            self._since, self._may_take_over = -1.0, True
        elif self._since < 0 or self._beyond < COMES_BACK * self._at_first:
            self._since, self._at_first = self._clock, self._beyond
        elif self._clock - self._since >= PERSIST and self._may_take_over:
            # Whatever is off by as much again is pushed, or measured with a bias: once only.
            self._since, self._may_take_over = -1.0, False
            self._take_over(now, measured)

    def _take_over(self, now: Floats, measured: Floats) -> None:
        """Go on from what was measured, as the constraints let it."""
        space = self.law.space
        n = space.linear
        moved = replace(
            self.state, position=measured[:n].copy(), rotation=rotation_of(measured[n:])
        )
        if self.rule.system.size:
            try:
                moved = admissible(self.rule, moved, "pose")
            except NoslipError:
                # Nothing near it keeps the constraints: it is waited for.
                return
        point = np.append(moved.position, moved.quaternion)
        self.memory.set(moved)
        if self.replans:
            self._pushed, self._halts = True, False
            self._failures, self._next_plan = 0, self._clock
            self._task = self._job = None
        else:
            self._left.shift(space.difference(point, now))
        self._kept[:] = point
        self._off = float(np.abs(space.difference(measured, point) / self._tolerances).max())
        self.taken_over += 1

    # ---------------------------------------------------------------- goals

    def _aim(self, goal: Floats) -> None:
        """Ask for a goal; what leads stays where it is."""
        if np.array_equal(goal, self._goal):
            return
        farther = self.law.space.difference(self._goal, goal)
        self._goal = goal
        if self.replans:
            if self._has_moved(farther):
                self._failures = 0
            return
        self._aside.shift(farther)
        self._left.shift(farther)

    def _lead_goal(self, h: float) -> None:
        """Lead the goal of the law a step nearer to the one asked for."""
        if not self._aside.step(0.0, h / (EASE * self._duration)):
            return
        data, at, n = self.memory.data, self.memory.at, self.law.space.linear
        point = self.law.space.moved(self._goal, self._aside.value)
        data[at.goal_position], data[at.goal_quaternion] = point[:n], point[n:]
        if self.law.clock.returns:
            data[at.first_goal_position], data[at.first_goal_quaternion] = point[:n], point[n:]

    # ---------------------------------------------------------------- plans

    def _has_moved(self, change: Floats) -> bool:
        """Whether a goal is farther away than any noise; or at all, of what does not move."""
        least = np.where(np.isfinite(self._tolerances), GOAL_MOVED * self._tolerances, 0.0)
        return bool((np.abs(change) > least).any())

    @property
    def _is_planning(self) -> bool:
        """Whether the plan followed does not lead where it is asked to, and another is sought."""
        if not self.replans or self._failures >= GIVEN_UP:
            return False
        aside = self.law.space.difference(self._goal, self._planned)
        return self._task is not None or self._pushed or self._has_moved(aside)

    def _plan(self) -> None:
        """Begin to plan, from where the command will be."""
        data, at, space, h = self.memory.data, self.memory.at, self.law.space, self.time_step
        fraction, n = data.item(at.fraction), space.linear
        if self._halts and self._speed > _STANDS:
            return
        stands = self._halts or self.law.clock.is_over(fraction)
        steps = 0 if stands else ceil(self._ahead / h - 1e-9)
        place = fraction + steps * h / self._duration
        memory = data.copy()
        self._stretch(memory, self._duration)
        reason: Reason = "push" if self._pushed else "goal"
        duration = None
        if self._failures:
            # What was not found in that time may be in more.
            duration = self.law.duration * _MORE**self._failures
        self._task = Task(
            reason,
            self.plan,
            memory,
            steps,
            h,
            stands or place >= DONE,
            self._goal[:n],
            rotations_of(self._goal[n:]),
            duration,
            self.samples,
        )
        self._sought, self._hand_over = self._goal, 0.0 if stands else min(place, DONE)
        # Where it stands there is no place to come to, only a time.
        self._due = self._clock + self._ahead if stands else 0.0
        self._next_plan = self._clock + BETWEEN_PLANS * self._duration
        self._job = self._planner.begin(self._task)

    @property
    def _is_due(self) -> bool:
        """Whether the command has come to where a plan is handed over."""
        fraction = self.memory.data.item(self.memory.at.fraction)
        is_there = fraction >= self._hand_over - 1e-9 and self._clock >= self._due - 1e-9
        return self._task is not None and is_there

    def _adopt(self) -> None:
        """Go on with the plan that was made, if there is one."""
        task, job = self._task, self._job
        assert task is not None
        assert job is not None
        if self.real_time and not job.done():
            if not task.resting:
                # The place is passed: it is made anew from farther ahead.
                self._task = self._job = None
                self._ahead = min(2 * self._ahead, _LATER * self.plan_within)
                self._next_plan = self._clock
            return
        self._task = self._job = None
        made = job.result()
        if made.plan is None or made.state is None or made.schedule is None:
            self.replanned.append(Replanned(self._clock, task.reason, np.nan, made.failure))
            self._next_plan = self._clock + AFTER_FAILURE * 2**self._failures * self._duration
            self._failures += 1
            # Meanwhile what is followed goes on.
            self._halts = False
            return
        cap = made.schedule.cap(0.0)
        if not task.resting and self._speed > HASTY * cap:
            # It bends too sharply for this speed: another is made from rest.
            self._halts = True
            return
        self.replanned.append(Replanned(self._clock, task.reason, made.plan.duration))
        now, data, at = self.memory.data.copy(), self.memory.data, self.memory.at
        self._stretch(now, self._duration)
        # The command has come to its place but for what it crept meanwhile.
        begun = replace(
            made.state,
            time=now.item(at.time),
            position=now[at.position],
            rotation=rotation_of(now[at.quaternion]),
        )
        self.memory.set(admissible(self.rule, begun, "velocity"))
        beyond = 0.0
        if task.resting:
            self._speed, self._sigma = max(cap, SLOWEST), _Damped(1.0, 1.0)
        else:
            # Point and velocities are handed over as they are, as far beyond the place as it is.
            data[at.linear], data[at.angular] = now[at.linear], now[at.angular]
            data[at.previous_step] = now.item(at.previous_step)
            data[self.memory.values] = now[self.memory.values]
            beyond = (now.item(at.fraction) - self._hand_over) * self._duration
        place = min(now.item(at.fraction), 1.0) if task.resting else self._hand_over
        self._channels = self._channels and self._channels.after(place)
        self.plan, self._duration = made.plan, made.plan.duration
        self._schedule = made.schedule
        data[at.fraction] = max(beyond, 0.0) / self._duration
        self._stretch(data, self._duration / self._speed)
        self._planned, self._pushed, self._failures = self._sought, False, 0
        self._halts = False
        self._engine = made.engine or engine_of(self.plan, self.rule, self.memory, self.time_step)

    def _needed(self) -> float:
        """How much of the duration it takes until next to nothing is left to be done."""
        if self.law.clock.returns:
            return 0.0
        fading = _FADED < self._force.value < self._amplitude
        needed = self._left.needed(self.law.attractor, self._tolerances)
        return float(max(needed, EASE * fading))


class _Moving:
    """What is on its way: numbers and their rate."""

    def __init__(self, value: Any) -> None:
        self.value, self._rate, self.rests = value, 0.0 * value, True

    def shift(self, change: Any) -> None:
        """Displace it."""
        self.value, self.rests = self.value + change, False

    def __eq__(self, other: object) -> bool:
        if type(self) is not type(other):
            return NotImplemented
        theirs = vars(other)
        return all(is_same(part, theirs[name]) for name, part in vars(self).items())

    __hash__ = None  # type: ignore[assignment]


class _Damped(_Moving):
    """Leads numbers to one, critically damped; exact of any step."""

    def __init__(self, value: Any, aim: float) -> None:
        super().__init__(value)
        self._aim = aim

    def step(self, aim: float, share: float) -> bool:
        """Step, over so much of the time constant; whether it is on its way."""
        if self.rests and self._aim == aim:
            return False
        off, self._aim = self.value - aim, aim
        push, decay = self._rate + off, exp(-share)
        self.value = aim + decay * (off + share * push)
        self._rate = decay * (self._rate - share * push)
        self.rests = bool(np.abs(off).max() < _SETTLED and np.abs(self._rate).max() < _SETTLED)
        if self.rests:
            self.value, self._rate = aim + 0.0 * off, 0.0 * off
        return True


class _Led(_Moving):
    """What an attractor has left to do, were there no constraints: offset and rate."""

    def step(self, attractor: Attractor, aim: Floats, share: float) -> None:
        """Step, over so much of the duration, to where the goal leads."""
        if self.rests:
            return
        product, gain = attractor.factors(share, share)
        self._rate = product * self._rate + gain * (aim - self.value)
        self.value = self.value + share * self._rate
        self.rests = max(np.abs(self.value).max(), np.abs(self._rate).max()) < _SETTLED
        if self.rests:
            self.value, self._rate = 0.0 * self.value, 0.0 * self._rate

    def needed(self, attractor: Attractor, tolerances: Floats) -> float:
        """Of the duration, until less than :data:`LEFT` is left: ``(1 + y) exp(-y) d = LEFT``."""
        if self.rests:
            return 0.0
        root = (attractor.alpha**2 / 4 - attractor.stiffness) ** 0.5
        rate = attractor.alpha / 2 - complex(root).real
        far = np.linalg.norm((np.abs(self.value) + np.abs(self._rate) / rate) / tolerances)
        if far <= LEFT:
            return 0.0
        times = need = ln(far / LEFT)
        for _ in range(3):
            times = need + log1p(times)
        return float(times / rate)
