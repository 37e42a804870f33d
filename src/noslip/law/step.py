"""The step as an expression graph: the recursion that turns a law's parameters into motion.

One CasADi graph carries the state over one step; a whole rollout is the same graph accumulated.
What depends on the phase alone (forcing term, goals, step factors) is computed outside of the
graph for all steps at once and handed in, a row a step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields

import casadi as ca

from noslip._typing import Expression
from noslip.law.layout import layouts
from noslip.rotations import (
    quaternion_again,
    quaternion_conjugate,
    quaternion_exp,
    quaternion_log,
    quaternion_product,
)
from noslip.space import POSE, Space


@dataclass(frozen=True)
class StepSymbols:
    """What a coupling term may use: the state and the step, as expressions.

    Attributes
    ----------
    position, quaternion, linear_velocity, angular_velocity, values : expression
        State before the step, and the residuals and margins of the one that led to it.
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
    space : Space
        What they are of.
    """

    position: Expression
    quaternion: Expression
    linear_velocity: Expression
    angular_velocity: Expression
    values: Expression
    time_step: Expression
    kick: Expression
    previous_step: Expression
    time: Expression
    residual_rate: Expression
    slip_rate: Expression
    barrier_rate: Expression
    space: Space = POSE

    def advance(self, linear: Expression, angular: Expression) -> tuple[Expression, Expression]:
        """Pose after the step at given velocities: ``p + dt v``, ``Exp(dt w) R``."""
        # By way of the middle, where constraints are asked: both have one sine and cosine.
        each = self.space.each
        half = each(quaternion_exp, self.time_step / 2 * angular)
        halfway = each(quaternion_product, half, self.quaternion)
        turned = each(quaternion_again, half, halfway, self.quaternion)
        return self.position + self.time_step * linear, turned


@dataclass(frozen=True)
class Coupled:
    """What a coupling term makes of the velocities.

    Attributes
    ----------
    linear, angular : expression, shape (n,) and (3 b,)
        Velocities after the step.
    values : expression, shape (m,)
        Residuals and margins after the step.
    multipliers : expression, shape (m,)
        Of accelerations.
    forces : expression, shape (n + 3 b, m)
        What each row adds to the acceleration.
    yielding : expression, shape (m,)
        1 for limits that gave way.
    suffices : expression
        1 unless constraints that it leaves out would change it.
    """

    linear: Expression
    angular: Expression
    values: Expression
    multipliers: Expression
    forces: Expression
    yielding: Expression
    suffices: Expression = 1


Coupling = Callable[[StepSymbols, Expression, Expression], Coupled]
"""(symbols, unconstrained v+, w+) -> what the constraints make of them."""


def step_function(
    coupling: Coupling | None,
    rows: int,
    first: Coupling | None = None,
    space: Space = POSE,
) -> ca.Function:
    """Return the step (carried, row of the step table) -> (carried, outputs) as one graph.

    Parameters
    ----------
    coupling : Coupling or None
        Moves the unconstrained velocities onto the constraints.
    rows : int
        Of constraints.
    first : Coupling, optional
        Tried first; the other one is evaluated only where this one does not suffice.
    space : Space
        What moves.
    """
    if first is None:
        return _graph("step", coupling, rows, 2, space)
    whole, short = _graph("whole", coupling, rows, 2, space), _graph("short", first, rows, 3, space)
    given = [ca.MX.sym(name, whole.numel_in(k)) for k, name in enumerate(("state", "step"))]
    found = [ca.MX.sym(name, whole.numel_out(k)) for k, name in enumerate(("after", "output"))]
    kept = ca.Function("kept", [*given, *found], found)
    anew = ca.Function("anew", [*given, *found], whole(*given))
    *found, suffices = short(*given)
    chosen = ca.Function.if_else("chosen", kept, anew)(suffices, *given, *found)
    return ca.Function("step", given, chosen)


def _graph(
    name: str, coupling: Coupling | None, rows: int, outputs: int, space: Space
) -> ca.Function:
    """The step with one coupling term: after, output and whether that suffices."""
    places = layouts(space)
    layout, row = places.carried(rows), places.step
    state, step = ca.SX.sym("state", layout.size), ca.SX.sym("step", row.size)
    field = {name: step[row[name]] for name in row}
    parts = {"space": space} | field | {name: state[layout[name]] for name in layout}
    symbols = StepSymbols(**{f.name: parts[f.name] for f in fields(StepSymbols)})
    decay, gain = field["decay"], field["gain"]

    def turn_to(goal: Expression, quaternion: Expression) -> Expression:
        return quaternion_log(quaternion_product(goal, quaternion_conjugate(quaternion)))

    turn = space.each(turn_to, field["rotation_goal"], symbols.quaternion)
    linear = decay * symbols.linear_velocity + gain * (field["position_target"] - symbols.position)
    angular = decay * symbols.angular_velocity + gain * (turn + field["rotation_offset"])
    output, values, suffices = ca.SX(places.force.size, 1), ca.SX(0, 1), ca.SX(1)
    if coupling is not None:
        held = coupling(symbols, linear, angular)
        force = ca.vertcat(held.linear - linear, held.angular - angular) / symbols.kick
        output = ca.vertcat(force, held.multipliers, held.yielding, ca.vec(held.forces))
        values, suffices = held.values, ca.SX(held.suffices)
        linear, angular = held.linear, held.angular
    position, quaternion = symbols.advance(linear, angular)
    quaternion = space.each(lambda q: q / ca.norm_2(q), quaternion)
    after = ca.densify(ca.vertcat(position, quaternion, linear, angular, values))
    # The coupling term evaluates poses and residuals more than once; each is computed once.
    found = [after, ca.densify(output), suffices][:outputs]
    return ca.Function(name, [state, step], ca.cse(found))
