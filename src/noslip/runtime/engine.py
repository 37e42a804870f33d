"""One step in place: machine code where there is a C compiler, else CasADi's virtual machine.

The memory is that of ``noslip_state`` (``noslip.h``): what steps here is what steps on the robot.
"""

from __future__ import annotations

from math import ceil, exp, isfinite

import numpy as np

from noslip.codegen.library import Library
from noslip.errors import InputError, NoslipError
from noslip.learning import ConstrainedDMP
from noslip.primitives.pose import DONE, State
from noslip.primitives.stepping import STATE_SIZE, STEP_SIZE
from noslip.runtime.numbers import Struct

TIME, FRACTION = 0, 1
MOVING = slice(2, 2 + STATE_SIZE)
"""Pose and velocities."""
POSITION, QUATERNION, LINEAR, ANGULAR = slice(2, 5), slice(5, 9), slice(9, 12), slice(12, 15)
VELOCITIES = slice(9, 15)
PREVIOUS_STEP, DURATION, PULL_IN = 15, 16, 17
GOAL_POSITION, GOAL_QUATERNION, STEERING = slice(18, 21), slice(21, 25), slice(25, 28)
ACCELERATION, FORCE = slice(28, 34), slice(34, 40)
_VALUES = 40
_KNOWN = 14
_MOST_ROWS_AHEAD = 256
NOT_FINITE = (
    "the step is not finite; its state or goal is out of what can be computed with, and is kept"
)
NO_STEERING = np.zeros(3)
NO_STEERING.flags.writeable = False


class Memory:
    """What ``noslip_state`` holds, as one array.

    Attributes
    ----------
    data : array
    equalities, limits : slice
        Of ``data``: residuals, margins.
    multipliers, limit_multipliers, values, all_multipliers : slice
    """

    def __init__(self, dmp: ConstrainedDMP) -> None:
        equalities, rows = dmp.system.equalities.size, dmp.system.size
        room = max(1, rows)
        self.data = np.zeros(_VALUES + 2 * room + _KNOWN)
        self.equalities = slice(_VALUES, _VALUES + equalities)
        self.limits = slice(_VALUES + equalities, _VALUES + rows)
        first = _VALUES + room
        self.multipliers = slice(first, first + equalities)
        self.limit_multipliers = slice(first + equalities, first + rows)
        self.values = slice(_VALUES, _VALUES + rows)
        self.all_multipliers = slice(first, first + rows)
        self.known = slice(first + room, None)
        self._alpha_s = dmp.phase.alpha_s

    def set(self, dmp: ConstrainedDMP, state: State) -> None:
        """Take over a state."""
        data = self.data
        data[TIME], data[FRACTION] = state.time, dmp.phase.fraction(state.phase)
        data[MOVING] = state.vector()
        data[PREVIOUS_STEP], data[DURATION] = state.previous_step, state.duration
        data[PULL_IN] = state.pull_in
        data[GOAL_POSITION] = state.goal_position
        data[GOAL_QUATERNION] = state.goal_rotation.as_quat(scalar_first=True)
        data[STEERING] = state.steering
        data[ACCELERATION], data[FORCE] = state.acceleration, state.constraint_forces
        # A state made by hand may come without.
        for name, part in {
            "constraint_residuals": self.equalities,
            "multipliers": self.multipliers,
            "margins": self.limits,
            "limit_multipliers": self.limit_multipliers,
        }.items():
            given = getattr(state, name)
            data[part] = given if given.size == part.stop - part.start else 0.0
        data[self.known] = -1.0

    def state(self) -> State:
        """What it holds, without its steering; a copy."""
        data = self.data.copy()
        fraction = data.item(FRACTION)
        # The frozen dataclass sets its fields one by one, which takes longer than the step itself.
        state = object.__new__(State)
        state.__dict__.update(
            time=data.item(TIME),
            phase=exp(-self._alpha_s * fraction),
            position=data[POSITION],
            _rotation=data[QUATERNION],
            linear_velocity=data[LINEAR],
            angular_velocity=data[ANGULAR],
            previous_step=data.item(PREVIOUS_STEP),
            duration=data.item(DURATION),
            goal_position=data[GOAL_POSITION],
            _goal_rotation=data[GOAL_QUATERNION],
            pull_in=data.item(PULL_IN),
            steering=NO_STEERING,
            constraint_residuals=data[self.equalities],
            multipliers=data[self.multipliers],
            margins=data[self.limits],
            limit_multipliers=data[self.limit_multipliers],
            acceleration=data[ACCELERATION],
            constraint_forces=data[FORCE],
            done=fraction >= DONE,
        )
        return state


class Compiled:
    """Steps by the exported C code, compiled for this machine.

    Parameters
    ----------
    dmp : ConstrainedDMP
    memory : Memory
        Written to by each step.
    library : Library
    """

    def __init__(self, dmp: ConstrainedDMP, memory: Memory, library: Library) -> None:
        self._struct = Struct(dmp)
        if (self._struct.size, memory.data.nbytes) != library.sizes:
            raise NoslipError(f"{library.path}: another layout than expected; remove the file")
        self._memory = memory
        self._step = library.step
        self._primitive, self._state = self._struct.address, memory.data.ctypes.data

    def step(self, time_step: float) -> None:
        """Carry the state over a step (s)."""
        if self._step(self._primitive, self._state, time_step):
            raise InputError(NOT_FINITE)


class Virtual:
    """Steps in CasADi's virtual machine, what depends on the phase alone computed ahead.

    Rows of the step table are used while steps come as foreseen; one that does not costs a new row,
    and the more come as foreseen from there, the farther it looks ahead.

    Parameters
    ----------
    dmp : ConstrainedDMP
    memory : Memory
        Written to by each step.
    time_step : float
        Of the steps to expect (s).
    """

    def __init__(self, dmp: ConstrainedDMP, memory: Memory, time_step: float) -> None:
        self._dmp, self._memory = dmp, memory
        stepper = dmp.stepper
        self._columns = stepper.outputs
        self._now, self._row = np.empty(STATE_SIZE), np.empty(STEP_SIZE)
        self._after, self._output = np.empty(STATE_SIZE), np.empty(stepper.outputs["end"].stop)
        self._change = np.empty(6)
        buffer, self._evaluate = stepper.function.buffer()
        buffer.set_arg(0, self._now.data)
        buffer.set_arg(1, self._row.data)
        buffer.set_res(0, self._after.data)
        buffer.set_res(1, self._output.data)
        self._buffer = buffer
        # All the way to the end, of steps as they are meant to be.
        fraction, duration = memory.data.item(FRACTION), memory.data.item(DURATION)
        self._ahead = max(1, ceil((1 - fraction) * duration / time_step)) + 1
        self._table = dmp.steps_ahead(memory.state(), self._ahead, time_step)
        self._next, self._expected = 0, (fraction, duration, time_step)

    def step(self, time_step: float) -> None:
        """Carry the state over a step (s)."""
        data, h = self._memory.data, time_step
        fraction, duration = data[FRACTION], data[DURATION]
        if self._next == len(self._table) or self._expected != (fraction, duration, h):
            self._look_ahead(h)
        self._row[:] = self._table[self._next]
        self._row[-3:] += data[STEERING]
        self._now[:] = data[MOVING]
        self._evaluate()
        after, output, columns = self._after, self._output, self._columns
        if not isfinite(after.sum()):
            raise InputError(NOT_FINITE)
        np.subtract(after[7:], self._now[7:], out=self._change)
        np.multiply(self._change, 1 / self._row[1], out=data[ACCELERATION])
        data[MOVING] = after
        data[FORCE] = output[columns["force"]]
        data[self._memory.values] = output[columns["values"]]
        data[self._memory.all_multipliers] = output[columns["multipliers"]]
        data[TIME] += h
        data[FRACTION] = fraction + h / duration
        data[PREVIOUS_STEP] = h
        self._next += 1
        self._expected = (data[FRACTION], duration, h)

    def _look_ahead(self, time_step: float) -> None:
        used_up = 0 < len(self._table) == self._next and self._expected[2] == time_step
        self._ahead = min(2 * self._ahead, _MOST_ROWS_AHEAD) if used_up else 1
        self._table = self._dmp.steps_ahead(self._memory.state(), self._ahead, time_step)
        self._next = 0
