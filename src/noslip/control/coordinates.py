"""Any motion in a control loop: vectors, joints, rhythms, several tools.

What :mod:`noslip.control.controller` does for the pose of a tool it does by plans; here the law
itself leads on, as in Ijspeert et al. (2013), section 2.3, and no plan is made:

- the command goes on from what was commanded, whatever is measured;
- what is measured is compared with the commands of the last 0.2 s: its distance to the last one
  slows the clock, ``duration / sigma`` with ``sigma = 1 / (1 + e^2)`` (phase stopping, their eq.
  2.14), its distance to all of them is no lag;
- where that stays beyond a tolerance the command moves to what was measured, once, and the law
  leads on from there;
- goals are filtered, critically damped;
- what a displacement, or a goal that moved, leaves to be done is foretold by the attractor alone,
  without constraints, and at its end the phase waits for that.

The clock slows by a longer duration: velocities shrink with it, as in
:func:`noslip.runtime.rhythm.retimed`, so rules that are homogeneous in the velocity hold in each
step, and rules that know the time know the true one.
"""

from __future__ import annotations

from collections.abc import Mapping
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
from noslip.control.planning import Primitive, channels_at, channels_of, engine_of
from noslip.errors import InputError, NoslipError
from noslip.law.attractor import Attractor
from noslip.law.points import quaternions_of, rotation_of
from noslip.runtime.engine import Memory
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

    Attributes
    ----------
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
    ) -> None:
        self.law, self.rule, self._learned = dmp.law, dmp.rule, channels_of(dmp)
        self.time_step = _arguments.positive("time_step", time_step, "seconds")
        angle = _arguments.positive("angle_tolerance", angle_tolerance, "rad")
        self.tolerance = self._tolerance(tolerance)
        self._tolerances = np.append(self.tolerance, np.full(self.law.space.angular, angle))
        self.memory = Memory(self.law.clock, self.rule.system)
        stepper_of(self.rule).native.wait()
        self.reset()

    def _tolerance(self, given: ArrayLike | None) -> Floats:
        space = self.law.space
        if given is not None:
            if np.ndim(given) == 0:
                given = np.full(space.linear, _arguments.positive("tolerance", given))
            found = _arguments.vector("tolerance", given, size=space.linear)
            if not (found > 0).all():
                raise InputError(f"tolerance must be above 0, got {_arguments.short(given)}")
            return found
        steps = np.diff(rollout(self.law, self.rule).positions, axis=0)
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
        return {name: value for name, value in vars(self).items() if name != "_engine"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._engine = engine_of(self.law, self.rule, self.memory, self.time_step)

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
        self._sigma, self._force = _Damped(1.0, 1.0), _Damped(begun.amplitude, begun.amplitude)
        goal = np.append(begun.goal_position, begun.goal_quaternion)
        # The goal asked for; where the one that leads is besides; what the motion has left to do.
        self._goal, self._aside, self._left = goal, _Damped(none, 0.0), _Led(none)
        # Over the tolerance: how far off it was measured, and by no lag.
        self._off = self._beyond = 0.0
        self._clock = 0.0
        self._seen_at = self._since = -1.0
        self._at_first, self._may_take_over = 0.0, True
        rows = min(ceil(LAG / self.time_step), MOST_KEPT)
        self._every = ceil(LAG / self.time_step / rows)
        self._kept, self._count = np.tile(self._point, (rows, 1)), 0
        self._engine = engine_of(self.law, self.rule, self.memory, self.time_step)
        return self.state

    # ---------------------------------------------------------------- what it tells

    @property
    def state(self) -> State:
        """The last, or the one to begin with."""
        return self.memory.state()

    @property
    def channels(self) -> Floats:
        """What goes with the last command and follows its phase, shape (k,)."""
        return channels_at(self._learned, self.memory)

    @property
    def done(self) -> bool:
        """Whether the command has come to its end, and what is measured, too; a rhythm never."""
        over = self.law.clock.is_over(self.memory.data.item(self.memory.at.fraction))
        return over and not self._needed() and self._beyond <= 1

    @property
    def speed(self) -> float:
        """Sigma: of the motion, over its own; 1 undisturbed."""
        return float(self._sigma.value)

    @property
    def reason(self) -> str:
        """Why it does not just go on, in words; empty if it does."""
        if self._is_silent:
            return f"nothing was measured for {self._clock - self._seen_at:.3g} s"
        if self._off > 1:
            return f"what is measured is off by {self._off:.3g} times the tolerance: waited for"
        if self._needed():
            return "the goal, or what moves, was displaced: the phase waits"
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
        slow = SLOWEST if self._is_silent else 1 / (1 + max(0.0, self._off - 1) ** 2)
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
        if not self._sigma.step(sigma, h / (EASE * self._duration)):
            return
        self._sigma.value = min(max(self._sigma.value, SLOWEST), 1.0)
        data, at = self.memory.data, self.memory.at
        duration = self._duration / self._sigma.value
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
