"""Compiled stepping: the recursion that turns a primitive's parameters into motion.

One CasADi graph carries the state over one step; a whole rollout is the same graph accumulated.
What depends on the phase alone (forcing term, goals, step factors) is computed outside of the
graph for all steps at once and handed in, a row a step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from noslip._typing import Expression, Floats
from noslip.codegen.library import Native
from noslip.rotations import (
    quaternion_conjugate,
    quaternion_exp,
    quaternion_log,
    quaternion_product,
)

STATE_SIZE = 13
"""Position (3), quaternion (4), linear (3) and angular velocity (3)."""


@dataclass(frozen=True)
class StepSymbols:
    """What a coupling term may use: the state and the step, as expressions.

    Attributes
    ----------
    position, quaternion, linear_velocity, angular_velocity : expression
        State before the step.
    time_step : expression
        From this state to the next (s).
    kick : expression
        Time over which the acceleration acts on the velocity (s).
    previous_step : expression
        Length of the step that led here (s); 0 at the start.
    time : expression
        At the end of the step (s).
    residual_rate : expression
        How fast a residual at position level decays (1/s); 0 keeps it.
    slip_rate : expression
        The same at velocity level.
    barrier_rate : expression
        How fast the margin of a limit may shrink that names no rate of its own (1/s).
    """

    position: Expression
    quaternion: Expression
    linear_velocity: Expression
    angular_velocity: Expression
    time_step: Expression
    kick: Expression
    previous_step: Expression
    time: Expression
    residual_rate: Expression
    slip_rate: Expression
    barrier_rate: Expression

    def advance(self, linear: Expression, angular: Expression) -> tuple[Expression, Expression]:
        """Pose after the step at given velocities: ``p + dt v``, ``Exp(dt w) R``."""
        # By way of the middle, where constraints are asked: both have one sine and cosine.
        half = quaternion_exp(self.time_step / 2 * angular)
        turned = quaternion_product(half, quaternion_product(half, self.quaternion))
        return self.position + self.time_step * linear, turned


@dataclass(frozen=True)
class Coupled:
    """What a coupling term makes of the velocities.

    Attributes
    ----------
    linear, angular : expression, shape (3,)
        Velocities after the step.
    values : expression, shape (m,)
        Residuals and margins after the step.
    multipliers : expression, shape (m,)
        Of accelerations.
    forces : expression, shape (6, m)
        What each row adds to the acceleration.
    yielding : expression, shape (m,)
        1 for limits that gave way.
    """

    linear: Expression
    angular: Expression
    values: Expression
    multipliers: Expression
    forces: Expression
    yielding: Expression


Coupling = Callable[[StepSymbols, Expression, Expression], Coupled]
"""(symbols, unconstrained v+, w+) -> what the constraints make of them."""

CLOCK = (
    "time_step",
    "kick",
    "previous_step",
    "time",
    "residual_rate",
    "slip_rate",
    "barrier_rate",
    "decay",
    "gain",
)
STEP_FIELDS = dict.fromkeys(CLOCK, 1) | {
    "position_target": 3,
    "rotation_goal": 4,
    "rotation_offset": 3,
}
STEP_SIZE = sum(STEP_FIELDS.values())
AT_ONCE = 1e18
"""A rate that leaves nothing after any step (1/s)."""
KICK = CLOCK.index("kick")
"""Column of the kick."""


def step_table(count: int) -> tuple[Floats, dict[str, Floats]]:
    """Return an empty table of steps, shape (count, STEP_SIZE), and views of its columns."""
    table = np.empty((count, STEP_SIZE))
    views, column = {}, 0
    for name, width in STEP_FIELDS.items():
        views[name] = table[:, column] if width == 1 else table[:, column : column + width]
        column += width
    return table, views


def output_columns(rows: int) -> dict[str, slice]:
    """Where a step's outputs stand that has so many constraint rows."""
    widths = {"force": 6, "values": rows, "multipliers": rows, "yielding": rows, "parts": 6 * rows}
    columns, first = {}, 0
    for name, width in (widths | {"end": 0}).items():
        columns[name] = slice(first, first + width)
        first += width
    return columns


class Stepper:
    """The step of a pose primitive, with a coupling term or without.

    Parameters
    ----------
    coupling : Coupling or None
        Moves the unconstrained velocities onto the constraints.
    rows : int
        Number of constraint rows, 0 without coupling.
    """

    def __init__(self, coupling: Coupling | None = None, rows: int = 0) -> None:
        self.rows = rows
        self.outputs = output_columns(rows)
        self.function = _step_function(coupling)
        self._accumulated = lru_cache(maxsize=8)(self._accumulate)
        self.native = Native(self.function, rows)
        self._runs = 0

    def _accumulate(self, count: int) -> ca.Function:
        return self.function if count == 1 else self.function.mapaccum(count)

    def run(self, state: Floats, table: Floats, states: Floats, outputs: Floats) -> None:
        """Carry a state over the table's steps.

        Parameters
        ----------
        state : array, shape (STATE_SIZE,)
        table : array, shape (count, STEP_SIZE)
        states : array, shape (count, STATE_SIZE)
            Written to: after each step.
        outputs : array, shape (count, ...)
            Written to; columns as :func:`output_columns` says.  All arrays are contiguous.
        """
        count = len(table)
        # Whoever runs many steps twice will do so often.
        self._runs += count > 1
        if self._runs == 2:
            self.native.begin()
        if (library := self.native.library) is not None:
            library.run(*(a.ctypes.data for a in (state, table, states, outputs)), count)
            return
        # CasADi reads and writes these arrays in place: a call that converts costs 80 us.
        buffer, evaluate = self._accumulated(count).buffer()
        buffer.set_arg(0, state.data)
        buffer.set_arg(1, table.data)
        buffer.set_res(0, states.data)
        buffer.set_res(1, outputs.data)
        evaluate()


def _step_function(coupling: Coupling | None) -> Any:
    state = ca.SX.sym("state", STATE_SIZE)
    step = ca.SX.sym("step", STEP_SIZE)
    field, column = {}, 0
    for name, width in STEP_FIELDS.items():
        field[name] = step[column : column + width]
        column += width
    symbols = StepSymbols(
        position=state[0:3],
        quaternion=state[3:7],
        linear_velocity=state[7:10],
        angular_velocity=state[10:13],
        time_step=field["time_step"],
        kick=field["kick"],
        previous_step=field["previous_step"],
        time=field["time"],
        residual_rate=field["residual_rate"],
        slip_rate=field["slip_rate"],
        barrier_rate=field["barrier_rate"],
    )
    decay, gain = field["decay"], field["gain"]
    turn = quaternion_log(
        quaternion_product(field["rotation_goal"], quaternion_conjugate(symbols.quaternion))
    )
    linear = decay * symbols.linear_velocity + gain * (field["position_target"] - symbols.position)
    angular = decay * symbols.angular_velocity + gain * (turn + field["rotation_offset"])
    output = force = ca.SX(6, 1)
    if coupling is not None:
        held = coupling(symbols, linear, angular)
        force = ca.vertcat(held.linear - linear, held.angular - angular) / symbols.kick
        output = ca.vertcat(
            force, held.values, held.multipliers, held.yielding, ca.vec(held.forces)
        )
        linear, angular = held.linear, held.angular
    position, quaternion = symbols.advance(linear, angular)
    quaternion = quaternion / ca.norm_2(quaternion)
    after = ca.densify(ca.vertcat(position, quaternion, linear, angular))
    # The coupling term evaluates poses and residuals more than once; each is computed once.
    return ca.Function("step", [state, step], ca.cse([after, ca.densify(output)]))
