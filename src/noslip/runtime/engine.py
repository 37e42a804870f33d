"""One step in place: machine code where there is a C compiler, else CasADi's virtual machine.

The memory is that of ``noslip_state`` (``noslip.h``): what steps here is what steps on the robot.
"""

from __future__ import annotations

from math import ceil, isfinite

import numpy as np

from noslip.codegen.library import Library
from noslip.constraints.system import ConstraintSystem
from noslip.errors import InputError, NoslipError
from noslip.law.clock import Clock
from noslip.law.law import Law
from noslip.law.layout import Layouts, layouts
from noslip.rule import Rule
from noslip.runtime.lost import require_defined
from noslip.runtime.numbers import Struct
from noslip.runtime.rollout import steps_ahead
from noslip.runtime.state import State
from noslip.runtime.stepper import stepper_of
from noslip.space import POSE


class _Places:
    """Where each number stands in the memory of a space; plain attributes, for loops."""

    def __init__(self, table: Layouts) -> None:
        memory = table.memory(0)
        self.time, self.fraction = memory.index("time"), memory.index("fraction")
        self.previous_step, self.duration = memory.index("previous_step"), memory.index("duration")
        self.pull_in, self.braking = memory.index("pull_in"), memory.index("braking")
        self.amplitude = memory.index("amplitude")
        self.position, self.quaternion, self.linear, self.angular = (
            memory[name] for name in table.state
        )
        self.moving = memory.span("position", "angular_velocity")
        self.goal_position = memory["goal_position"]
        self.goal_quaternion = memory["goal_quaternion"]
        self.first_goal_position = memory["first_goal_position"]
        self.first_goal_quaternion = memory["first_goal_quaternion"]
        self.asked = memory.span("amplitude", "first_goal_quaternion")
        self.acceleration, self.force = memory["acceleration"], memory["force"]
        self.state_size, self.velocity = table.state.size, table.velocity
        self.kick = table.step.index("kick")


_OF_POSE = _Places(layouts(POSE))
TIME, FRACTION, PREVIOUS_STEP = _OF_POSE.time, _OF_POSE.fraction, _OF_POSE.previous_step
"""Of a pose, as those that follow."""
DURATION, BRAKING = _OF_POSE.duration, _OF_POSE.braking
POSITION, QUATERNION = _OF_POSE.position, _OF_POSE.quaternion
LINEAR, ANGULAR = _OF_POSE.linear, _OF_POSE.angular
MOVING = _OF_POSE.moving
"""Pose and velocities."""
VELOCITIES = slice(LINEAR.start, ANGULAR.stop)
_MOST_ROWS_AHEAD = 256
"""Rows of the step table computed at once: more would make one step wait for many."""
NOT_FINITE = (
    "the step is not finite; its state or goal is out of what can be computed with, and is kept"
)


class Memory:
    """What ``noslip_state`` holds, as one array.

    Attributes
    ----------
    data : array
    equalities, limits : slice
        Of ``data``: residuals, margins.
    multipliers, limit_multipliers, values, all_multipliers : slice
    """

    def __init__(self, clock: Clock, system: ConstraintSystem) -> None:
        equalities, rows = system.equalities.size, system.size
        layouts_of = layouts(system.space)
        layout = layouts_of.memory(rows)
        self.at = _Places(layouts_of)
        self.data = np.zeros(layout.size)
        values, multipliers = layout.index("values"), layout.index("multipliers")
        self.equalities = slice(values, values + equalities)
        self.limits = slice(values + equalities, values + rows)
        self.multipliers = slice(multipliers, multipliers + equalities)
        self.limit_multipliers = slice(multipliers + equalities, multipliers + rows)
        self.values = slice(values, values + rows)
        self.all_multipliers = slice(multipliers, multipliers + rows)
        self.known = layout.span("known_fraction", "known_factors")
        self._clock, self._system = clock, system

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Memory) and np.array_equal(self.data, other.data)

    __hash__ = None  # type: ignore[assignment]

    def set(self, state: State) -> None:
        """Write a state to it."""
        data, at = self.data, self.at
        data[at.time], data[at.fraction] = state.time, self._clock.fraction(state.phase)
        carried = state.carried(self._system)
        data[at.moving], data[self.values] = np.split(carried, [at.state_size])
        data[at.previous_step], data[at.duration] = state.previous_step, state.duration
        data[at.pull_in], data[at.braking] = state.pull_in, state.braking
        data[at.amplitude] = state.amplitude
        data[at.goal_position] = state.goal_position
        data[at.goal_quaternion] = state.goal_quaternion
        data[at.first_goal_position] = state.first_goal_position
        data[at.first_goal_quaternion] = state.first_goal_quaternion
        data[at.acceleration], data[at.force] = state.acceleration, state.constraint_forces
        # A state made by hand may come without.
        for given, part in (
            (state.multipliers, self.multipliers),
            (state.limit_multipliers, self.limit_multipliers),
        ):
            data[part] = given if given.size == part.stop - part.start else 0.0
        data[self.known] = -1.0

    def state(self) -> State:
        """What it holds; a copy."""
        data, at = self.data.copy(), self.at
        fraction = data.item(at.fraction)
        # The frozen dataclass sets its fields one by one, which takes longer than the step itself.
        state = object.__new__(State)
        state.__dict__.update(
            time=data.item(at.time),
            phase=self._clock.phase(fraction),
            position=data[at.position],
            _rotation=data[at.quaternion],
            linear_velocity=data[at.linear],
            angular_velocity=data[at.angular],
            previous_step=data.item(at.previous_step),
            duration=data.item(at.duration),
            goal_position=data[at.goal_position],
            _goal_rotation=data[at.goal_quaternion],
            first_goal_position=data[at.first_goal_position],
            _first_goal_rotation=data[at.first_goal_quaternion],
            pull_in=data.item(at.pull_in),
            braking=data.item(at.braking),
            amplitude=data.item(at.amplitude),
            constraint_residuals=data[self.equalities],
            multipliers=data[self.multipliers],
            margins=data[self.limits],
            limit_multipliers=data[self.limit_multipliers],
            acceleration=data[at.acceleration],
            constraint_forces=data[at.force],
            done=self._clock.is_over(fraction),
        )
        return state


class Compiled:
    """Steps by the exported C code, compiled for this machine.

    Parameters
    ----------
    law : Law
    rule : Rule
    memory : Memory
        Written to by each step.
    library : Library
    """

    def __init__(self, law: Law, rule: Rule, memory: Memory, library: Library) -> None:
        self._struct = Struct(law, rule)
        if (self._struct.size, memory.data.nbytes) != library.sizes:
            raise NoslipError(f"{library.path}: another layout than expected; remove the file")
        self._memory, self._system, self._law = memory, rule.system, law
        self._step = library.step
        self._primitive, self._state = self._struct.address, memory.data.ctypes.data

    def step(self, time_step: float) -> None:
        """Carry the state over a step (s)."""
        if self._step(self._primitive, self._state, time_step):
            data, at, law = self._memory.data, self._memory.at, self._law
            fraction, duration = data.item(at.fraction), data.item(at.duration)
            law.clock.made_good(fraction, time_step, duration, law.steps)
            raise _lost(self._system, self._memory, time_step)


def _lost(system: ConstraintSystem, memory: Memory, time_step: float) -> InputError:
    """Say whose fault it is that a step is not finite."""
    data, at = memory.data, memory.at
    states = np.stack([data[at.moving], np.full(at.state_size, np.nan)])
    require_defined(system, data[at.time] + np.array([0.0, time_step]), states)
    return InputError(NOT_FINITE)


class Virtual:
    """Steps in CasADi's virtual machine, what depends on the phase alone computed ahead.

    Rows of the step table are used while steps come as foreseen; one that does not costs a new row,
    and the more come as foreseen from there, the farther it looks ahead.

    Parameters
    ----------
    law : Law
    rule : Rule
    memory : Memory
        Written to by each step.
    time_step : float
        Of the steps to expect (s).
    """

    def __init__(self, law: Law, rule: Rule, memory: Memory, time_step: float) -> None:
        self._law, self._rule, self._memory = law, rule, memory
        stepper = stepper_of(rule)
        self._columns = stepper.outputs
        row = layouts(law.space).step.size
        self._now, self._row = np.empty(stepper.carried.size), np.empty(row)
        self._after, self._output = np.empty_like(self._now), np.empty(stepper.outputs.size)
        self._change = np.empty(law.space.velocity_size)
        buffer, self._evaluate = stepper.function.buffer()
        buffer.set_arg(0, self._now.data)
        buffer.set_arg(1, self._row.data)
        buffer.set_res(0, self._after.data)
        buffer.set_res(1, self._output.data)
        self._buffer, self._values = buffer, memory.values
        # All the way to the end, of steps as they are meant to be.
        at = memory.at
        fraction, duration = memory.data.item(at.fraction), memory.data.item(at.duration)
        self._ahead = max(1, ceil(min(1.0, law.clock.left(fraction)) * duration / time_step))
        self._table = steps_ahead(law, rule, memory.state(), self._ahead, time_step)
        self._next, self._expected = 0, (fraction, duration, time_step)
        self._asked = memory.data[at.asked].tobytes()

    def step(self, time_step: float) -> None:
        """Carry the state over a step (s)."""
        data, at = self._memory.data, self._memory.at
        fraction, duration = data.item(at.fraction), data.item(at.duration)
        if self._asked != (asked := data[at.asked].tobytes()):
            # Rows of the table hold what was asked for when they were made.
            self._asked, self._next = asked, len(self._table)
        count, seconds = self._law.clock.made_good(fraction, time_step, duration, self._law.steps)
        kept = data.copy() if count > 1 else data
        try:
            for _ in range(count):
                self._step(seconds)
        except InputError:
            data[:] = kept
            raise

    def _step(self, h: float) -> None:
        data, at = self._memory.data, self._memory.at
        fraction, duration = data.item(at.fraction), data.item(at.duration)
        share = h / duration
        over = self._law.clock.is_over(fraction)
        if over:
            _, after_step = self._law.clock.slowed(fraction, h, duration, data.item(at.braking))
        else:
            # The last step ends where the motion does; a whole one would go beyond.
            if share > (left := self._law.clock.left(fraction)):
                share = left
                h = share * duration
            after_step = self._law.clock.later_fraction(fraction, share)
        if over or self._next == len(self._table) or self._expected != (fraction, duration, h):
            self._look_ahead(h, over)
        self._row[:] = self._table[self._next]
        size = at.state_size
        self._now[:size], self._now[size:] = data[at.moving], data[self._values]
        self._evaluate()
        after, output, columns = self._after, self._output, self._columns
        if not isfinite(after[:size].sum()):
            raise _lost(self._rule.system, self._memory, h)
        np.subtract(after[at.velocity], self._now[at.velocity], out=self._change)
        np.multiply(self._change, 1 / self._row[at.kick], out=data[at.acceleration])
        data[at.moving], data[self._values] = after[:size], after[size:]
        data[at.force] = output[columns["force"]]
        data[self._memory.all_multipliers] = output[columns["multipliers"]]
        data[at.time] += h
        data[at.fraction] = after_step
        data[at.previous_step] = h
        self._next += 1
        self._expected = (after_step, duration, h)

    def _look_ahead(self, time_step: float, over: bool) -> None:
        used_up = 0 < len(self._table) == self._next and self._expected[2] == time_step
        self._ahead = min(2 * self._ahead, _MOST_ROWS_AHEAD) if used_up and not over else 1
        self._table = steps_ahead(
            self._law, self._rule, self._memory.state(), self._ahead, time_step
        )
        self._next = 0
