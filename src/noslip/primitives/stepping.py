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
from numpy.typing import NDArray

from noslip.rotations import (
    Expression,
    quaternion_conjugate,
    quaternion_exp,
    quaternion_log,
    quaternion_product,
)

Floats = NDArray[np.float64]

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
    residual_decay : expression
        What is left of a residual after the step; 1 keeps it, 0 removes it at once.
    """

    position: Expression
    quaternion: Expression
    linear_velocity: Expression
    angular_velocity: Expression
    time_step: Expression
    kick: Expression
    previous_step: Expression
    time: Expression
    residual_decay: Expression

    def advance(self, linear: Expression, angular: Expression) -> tuple[Expression, Expression]:
        """Pose after the step at given velocities: ``p + dt v``, ``Exp(dt w) R``."""
        turned = quaternion_product(quaternion_exp(self.time_step * angular), self.quaternion)
        return self.position + self.time_step * linear, turned


Coupling = Callable[
    [StepSymbols, Expression, Expression], tuple[Expression, Expression, Expression, Expression]
]
"""(symbols, unconstrained v+, w+) -> (v+, w+, residuals (m,), multipliers (m,))."""

STEP_FIELDS = {
    "time_step": 1,
    "kick": 1,
    "previous_step": 1,
    "time": 1,
    "residual_decay": 1,
    "decay": 1,
    "gain": 1,
    "position_target": 3,
    "rotation_goal": 4,
    "rotation_offset": 3,
}
STEP_SIZE = sum(STEP_FIELDS.values())


def step_table(count: int) -> tuple[Floats, dict[str, Floats]]:
    """Return an empty table of steps, shape (count, STEP_SIZE), and views of its columns."""
    table = np.empty((count, STEP_SIZE))
    views, column = {}, 0
    for name, width in STEP_FIELDS.items():
        views[name] = table[:, column] if width == 1 else table[:, column : column + width]
        column += width
    return table, views


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
        self.output_size = 2 * rows + 6
        self._function = _step_function(coupling)
        self._accumulated = lru_cache(maxsize=8)(self._accumulate)

    def _accumulate(self, count: int) -> ca.Function:
        return self._function if count == 1 else self._function.mapaccum(count)

    def run(self, state: Floats, table: Floats) -> tuple[Floats, Floats]:
        """Carry a state over the table's steps.

        Returns
        -------
        states : array, shape (count, STATE_SIZE)
            After each step.
        outputs : array, shape (count, 2 m + 6)
            Residuals, multipliers, and constraint force (linear, angular acceleration).
        """
        count = len(table)
        states = np.empty((count, STATE_SIZE))
        outputs = np.empty((count, self.output_size))
        # CasADi reads and writes these arrays in place: a call that converts costs 80 us.
        start = np.ascontiguousarray(state, dtype=np.float64)
        steps = np.ascontiguousarray(table, dtype=np.float64)
        buffer, evaluate = self._accumulated(count).buffer()
        buffer.set_arg(0, start.data)
        buffer.set_arg(1, steps.data)
        buffer.set_res(0, states.data)
        buffer.set_res(1, outputs.data)
        evaluate()
        return states, outputs


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
        residual_decay=field["residual_decay"],
    )
    decay, gain = field["decay"], field["gain"]
    turn = quaternion_log(
        quaternion_product(field["rotation_goal"], quaternion_conjugate(symbols.quaternion))
    )
    linear = decay * symbols.linear_velocity + gain * (field["position_target"] - symbols.position)
    angular = decay * symbols.angular_velocity + gain * (turn + field["rotation_offset"])
    residuals = multipliers = ca.SX(0, 1)
    force = ca.SX(6, 1)
    if coupling is not None:
        held_linear, held_angular, residuals, multipliers = coupling(symbols, linear, angular)
        force = ca.vertcat(held_linear - linear, held_angular - angular) / symbols.kick
        linear, angular = held_linear, held_angular
    position, quaternion = symbols.advance(linear, angular)
    quaternion = quaternion / ca.norm_2(quaternion)
    after = ca.densify(ca.vertcat(position, quaternion, linear, angular))
    output = ca.densify(ca.vertcat(residuals, multipliers, force))
    # The coupling term evaluates poses and residuals more than once; each is computed once.
    return ca.Function("step", [state, step], ca.cse([after, output]))
