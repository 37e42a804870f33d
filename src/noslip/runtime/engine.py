"""One step in place: machine code where there is a C compiler, else CasADi's virtual machine.

The memory is that of ``noslip_state`` (``noslip.h``): what steps here is what steps on the robot.
"""

from __future__ import annotations

from math import ceil, exp, isfinite

import numpy as np

from noslip._typing import Floats
from noslip.codegen.library import Library
from noslip.constraints.system import ConstraintSystem
from noslip.errors import InputError, NoslipError
from noslip.law.clock import Phase
from noslip.law.law import Law
from noslip.law.layout import STATE, STEP, VELOCITY, memory_layout
from noslip.rule import Rule
from noslip.runtime.lost import require_defined
from noslip.runtime.numbers import Struct
from noslip.runtime.rollout import steps_ahead
from noslip.runtime.state import State
from noslip.runtime.stepper import stepper_of

_PLACES = memory_layout(0)
"""Before the constraints' rows, places are alike for all of them."""
TIME, FRACTION, PREVIOUS_STEP, DURATION, PULL_IN, BRAKING = (
    _PLACES.index(name)
    for name in ("time", "fraction", "previous_step", "duration", "pull_in", "braking")
)
POSITION, QUATERNION, LINEAR, ANGULAR = (_PLACES[name] for name in STATE)
MOVING = _PLACES.span("position", "angular_velocity")
"""Pose and velocities."""
VELOCITIES = _PLACES.span("linear_velocity", "angular_velocity")
GOAL_POSITION, GOAL_QUATERNION, ACCELERATION, FORCE = (
    _PLACES[name] for name in ("goal_position", "goal_quaternion", "acceleration", "force")
)
FIRST_GOAL_POSITION, FIRST_GOAL_QUATERNION = (
    _PLACES[f"first_{name}"] for name in ("goal_position", "goal_quaternion")
)
_KICK = STEP.index("kick")
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

    def __init__(self, clock: Phase, system: ConstraintSystem) -> None:
        equalities, rows = system.equalities.size, system.size
        layout = memory_layout(rows)
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
        data = self.data
        data[TIME], data[FRACTION] = state.time, self._clock.fraction(state.phase)
        carried = state.carried(self._system)
        data[MOVING], data[self.values] = np.split(carried, [STATE.size])
        data[PREVIOUS_STEP], data[DURATION] = state.previous_step, state.duration
        data[PULL_IN], data[BRAKING] = state.pull_in, state.braking
        data[GOAL_POSITION] = state.goal_position
        data[GOAL_QUATERNION] = state.goal_rotation.as_quat(scalar_first=True)
        data[FIRST_GOAL_POSITION] = state.first_goal_position
        data[FIRST_GOAL_QUATERNION] = state.first_goal_rotation.as_quat(scalar_first=True)
        data[ACCELERATION], data[FORCE] = state.acceleration, state.constraint_forces
        # A state made by hand may come without.
        for given, part in (
            (state.multipliers, self.multipliers),
            (state.limit_multipliers, self.limit_multipliers),
        ):
            data[part] = given if given.size == part.stop - part.start else 0.0
        data[self.known] = -1.0

    def state(self) -> State:
        """What it holds; a copy."""
        data = self.data.copy()
        fraction = data.item(FRACTION)
        # The frozen dataclass sets its fields one by one, which takes longer than the step itself.
        state = object.__new__(State)
        state.__dict__.update(
            time=data.item(TIME),
            phase=exp(-self._clock.alpha_s * fraction),
            position=data[POSITION],
            _rotation=data[QUATERNION],
            linear_velocity=data[LINEAR],
            angular_velocity=data[ANGULAR],
            previous_step=data.item(PREVIOUS_STEP),
            duration=data.item(DURATION),
            goal_position=data[GOAL_POSITION],
            _goal_rotation=data[GOAL_QUATERNION],
            first_goal_position=data[FIRST_GOAL_POSITION],
            _first_goal_rotation=data[FIRST_GOAL_QUATERNION],
            pull_in=data.item(PULL_IN),
            braking=data.item(BRAKING),
            constraint_residuals=data[self.equalities],
            multipliers=data[self.multipliers],
            margins=data[self.limits],
            limit_multipliers=data[self.limit_multipliers],
            acceleration=data[ACCELERATION],
            constraint_forces=data[FORCE],
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
            data, law = self._memory.data, self._law
            law.clock.made_good(data.item(FRACTION), time_step, data.item(DURATION), law.steps)
            raise _lost(self._system, data, time_step)


def _lost(system: ConstraintSystem, data: Floats, time_step: float) -> InputError:
    """Say whose fault it is that a step is not finite."""
    states = np.stack([data[MOVING], np.full(STATE.size, np.nan)])
    require_defined(system, data[TIME] + np.array([0.0, time_step]), states)
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
        self._now, self._row = np.empty(stepper.carried.size), np.empty(STEP.size)
        self._after, self._output = np.empty_like(self._now), np.empty(stepper.outputs.size)
        self._change = np.empty(VELOCITY.stop - VELOCITY.start)
        buffer, self._evaluate = stepper.function.buffer()
        buffer.set_arg(0, self._now.data)
        buffer.set_arg(1, self._row.data)
        buffer.set_res(0, self._after.data)
        buffer.set_res(1, self._output.data)
        self._buffer, self._values = buffer, memory.values
        # All the way to the end, of steps as they are meant to be.
        fraction, duration = memory.data.item(FRACTION), memory.data.item(DURATION)
        self._ahead = max(1, ceil((1 - fraction) * duration / time_step))
        self._table = steps_ahead(law, rule, memory.state(), self._ahead, time_step)
        self._next, self._expected = 0, (fraction, duration, time_step)

    def step(self, time_step: float) -> None:
        """Carry the state over a step (s)."""
        data = self._memory.data
        fraction, duration = data.item(FRACTION), data.item(DURATION)
        count, seconds = self._law.clock.made_good(fraction, time_step, duration, self._law.steps)
        kept = data.copy() if count > 1 else data
        try:
            for _ in range(count):
                self._step(seconds)
        except InputError:
            data[:] = kept
            raise

    def _step(self, h: float) -> None:
        data = self._memory.data
        fraction, duration = data.item(FRACTION), data.item(DURATION)
        share = h / duration
        over = self._law.clock.is_over(fraction)
        if over:
            _, after_step = self._law.clock.slowed(fraction, h, duration, data.item(BRAKING))
        else:
            # The last step ends where the motion does; a whole one would go beyond.
            if share > 1 - fraction:
                share = 1 - fraction
                h = share * duration
            after_step = fraction + share
        if over or self._next == len(self._table) or self._expected != (fraction, duration, h):
            self._look_ahead(h, over)
        self._row[:] = self._table[self._next]
        self._now[: STATE.size], self._now[STATE.size :] = data[MOVING], data[self._values]
        self._evaluate()
        after, output, columns = self._after, self._output, self._columns
        if not isfinite(after[: STATE.size].sum()):
            raise _lost(self._rule.system, data, h)
        np.subtract(after[VELOCITY], self._now[VELOCITY], out=self._change)
        np.multiply(self._change, 1 / self._row[_KICK], out=data[ACCELERATION])
        data[MOVING], data[self._values] = after[: STATE.size], after[STATE.size :]
        data[FORCE] = output[columns["force"]]
        data[self._memory.all_multipliers] = output[columns["multipliers"]]
        data[TIME] += h
        data[FRACTION] = after_step
        data[PREVIOUS_STEP] = h
        self._next += 1
        self._expected = (after_step, duration, h)

    def _look_ahead(self, time_step: float, over: bool) -> None:
        used_up = 0 < len(self._table) == self._next and self._expected[2] == time_step
        self._ahead = min(2 * self._ahead, _MOST_ROWS_AHEAD) if used_up and not over else 1
        self._table = steps_ahead(
            self._law, self._rule, self._memory.state(), self._ahead, time_step
        )
        self._next = 0
