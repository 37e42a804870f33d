"""The planner's problem as general solvers take it: IPOPT and fatrop, both in CasADi's wheel.

The same unknowns, cost, rows, bounds and first guess.  CasADi's virtual machine evaluates rows and
cost for both; building is not part of what is measured.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse

from noslip._typing import Floats
from noslip.projection.newton import Plan

TOLERANCE = 1e-10
"""Of their optimality conditions; rows are met to a tenth of it."""

Solve = Callable[[], Floats]
"""Returns the correction, shape (N, 6)."""


def cost(plan: Plan, z: Floats) -> float:
    """What a correction costs: half of its squares, of its changes' and of its bending's."""
    weights, slopes, bending = plan.costs()
    parts = (weights * z**2, slopes * np.diff(z, axis=0) ** 2, bending * np.diff(z, 2, axis=0) ** 2)
    return float(sum(part.sum() for part in parts) / 2)


def ipopt(plan: Plan, compiled: bool = False) -> Solve:
    """All corrections in one vector; MUMPS inside.

    ``compiled`` has its functions compiled too, which takes 15 seconds for 200 samples.
    """
    count, size = plan.unknown.shape
    weights, slopes, bending = plan.costs()
    change, bend = (
        scipy.sparse.diags(steps, range(len(steps)), shape=(count - len(steps) + 1, count))
        for steps in ([-1, 1], [1, -2, 1])
    )
    quadratic = sum(
        # A sample's unknowns stand together.
        scipy.sparse.kron(
            scipy.sparse.diags(weights[:, j])
            + change.T @ scipy.sparse.diags(slopes[:, j]) @ change
            + bending[j] * bend.T @ bend,
            scipy.sparse.csc_matrix(([1.0], ([j], [j])), shape=(size, size)),
        )
        for j in range(size)
    )
    x = ca.MX.sym("x", size, count)
    row, at = _row(plan)
    rows = ca.vec(row.map(count - 1)(x[:, :-1], x[:, 1:], at[1:].T))
    flat = ca.vec(x)
    problem = {
        "x": flat,
        "f": ca.bilin(ca.DM(scipy.sparse.csc_matrix(quadratic)), flat, flat) / 2,
        "g": rows[np.flatnonzero(plan.active[1:])],
    }
    quiet = {"print_level": 0, "sb": "yes"}
    jit = {"jit": True, "compiler": "shell", "jit_options": {"flags": ["-O1"]}}
    own = quiet | {"constr_viol_tol": TOLERANCE / 10}
    solver = _solver("ipopt", problem, own, **(jit if compiled else {}))
    solve = _solving(solver, plan.unknown.ravel(), plan.fixed.ravel())
    return lambda: solve().reshape(count, size)


def fatrop(plan: Plan) -> Solve:
    """Optimal control: a correction and its change are the state, its bending is the input."""
    count, size = plan.unknown.shape
    weights, slopes, bending = plan.costs()
    row, at = _row(plan)
    begun = plan.unknown
    changes = np.diff(begun, axis=0, prepend=begun[:1])
    bends = np.diff(changes, axis=0)
    states = [ca.MX.sym(f"x{k}", 2 * size) for k in range(count)]
    inputs = [ca.MX.sym(f"u{k}", size) for k in range(count - 1)]
    x, guess, fixed, g, steps, f = [], [], [], [], [], ca.MX(0)
    for k, state in enumerate(states):
        z, change = state[:size], state[size:]
        x.append(state)
        guess += [begun[k], changes[k]]
        # There is no change before the first sample.
        fixed += [plan.fixed[k], np.full(size, k == 0)]
        f += ca.dot(weights[k], z**2)
        if k < count - 1:
            x.append(inputs[k])
            guess.append(bends[k])
            fixed.append(np.zeros(size, dtype=bool))
            g.append(states[k + 1] - ca.vertcat(z + change + inputs[k], change + inputs[k]))
            steps += [True] * 2 * size
        if k:
            f += ca.dot(slopes[k - 1], change**2)
            f += ca.dot(bending, inputs[k] ** 2) if k < count - 1 else 0
            asked = np.flatnonzero(plan.active[k]).tolist()
            g.append(row(z - change, z, at[k])[asked])
            steps += [True] * len(asked)
    problem = {"x": ca.vertcat(*x), "f": f / 2, "g": ca.vertcat(*g)}
    detected = {"structure_detection": "auto", "equality": steps, "expand": True}
    solver = _solver("fatrop", problem, {"print_level": 0}, **detected)
    solve = _solving(solver, np.concatenate(guess), np.concatenate(fixed))
    # Each sample's state and input, one after the other.
    return lambda: np.resize(solve(), count * 3 * size).reshape(count, -1)[:, :size]


def _row(plan: Plan) -> tuple[ca.Function, Floats]:
    """Scaled rows of a step by the corrections before and after it; what else they take at each."""
    size = plan.unknown.shape[1]
    _, *reference = plan.arguments()
    lengths = np.cumsum([each.shape[1] for each in reference])
    before, after = ca.SX.sym("before", size), ca.SX.sym("after", size)
    at = ca.SX.sym("at", int(lengths[-1]))
    given = ca.vertsplit(at, [0, *lengths.tolist()])
    (values,) = plan.stage.functions[0].call([ca.vertcat(before, after, after), *given])
    row = ca.Function("row", [before, after, at], [plan.row_scale * values])
    return row, np.hstack(reference)


def _solver(name: str, problem: dict[str, Any], own: dict[str, Any], **options: Any) -> ca.Function:
    options |= {name: {"tol": TOLERANCE, **own}, "print_time": False}
    return ca.nlpsol(name, name, problem, options)


def _solving(solver: ca.Function, guess: Floats, fixed: Floats) -> Solve:
    bounds = np.where(fixed, guess, -np.inf), np.where(fixed, guess, np.inf)

    def solve() -> Floats:
        found = solver(x0=guess, lbx=bounds[0], ubx=bounds[1], lbg=0, ubg=0)
        assert solver.stats()["success"], solver.stats()["return_status"]
        return np.asarray(found["x"]).ravel()

    return solve
