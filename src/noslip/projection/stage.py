"""The constraints of one step of a trajectory projection: residual, Jacobian and curvature."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import casadi as ca
import numpy as np

from noslip._typing import Expression, Floats
from noslip.constraints.system import ConstraintSystem
from noslip.rotations import (
    quaternion_conjugate,
    quaternion_exp,
    quaternion_log,
    quaternion_product,
)

Entries = dict[tuple[int, int], Floats]
"""Structural nonzeros of a stage's matrix: (row, column) -> value at each stage."""


Evaluation = Callable[[Floats, Floats, Floats], tuple[Floats, Entries, Entries]]


# Building and differentiating the graph takes as long as two Newton steps.
@lru_cache(maxsize=16)
def stage_function(system: ConstraintSystem, hold_position: bool, count: int) -> Evaluation:
    """Residual, Jacobian and curvature of the constraints of one step, for all steps at once.

    Rows of equalities come first, then those of limits.
    """
    unknowns = 3 if hold_position else 6
    z = [ca.SX.sym(f"z_{name}", unknowns) for name in ("before", "here", "after")]
    q = [ca.SX.sym(f"q_{name}", 4) for name in ("before", "here", "after")]
    p, v, v_after = ca.SX.sym("p", 3), ca.SX.sym("v", 3), ca.SX.sym("v_after", 3)
    time, time_step, length = ca.SX.sym("t"), ca.SX.sym("dt"), ca.SX.sym("L")
    equalities, limits = system.equalities, system.limits
    rows = system.size
    multipliers = ca.SX.sym("lambda", rows)

    turned = [
        quaternion_product(quaternion_exp(part[:3]), reference)
        for part, reference in zip(z, q, strict=True)
    ]

    def rate(first: int) -> Expression:
        turn = quaternion_product(turned[first + 1], quaternion_conjugate(turned[first]))
        return quaternion_log(turn) / time_step

    position, velocity, next_velocity = p, v, v_after
    if not hold_position:
        position = p + length * z[1][3:]
        velocity = v + length * (z[1][3:] - z[0][3:]) / time_step
        next_velocity = v_after + length * (z[2][3:] - z[1][3:]) / time_step
    spin = rate(0)
    linear = (next_velocity - velocity) / time_step
    angular = (rate(1) - spin) / time_step
    # The quaternions are continuous from sample to sample, so their sum is halfway between them.
    middle = turned[0] + turned[1]
    at_middle = (
        time - time_step / 2,
        position - time_step / 2 * velocity,
        middle / ca.norm_2(middle),
        velocity,
        spin,
    )
    at_end = (time, position, turned[1], velocity, spin)

    def residual(part: ConstraintSystem, *accelerations: Expression) -> Expression:
        middles, ends = (part.residual(*at, *accelerations) for at in (at_middle, at_end))
        rows = [
            (ends if level == "position" else middles)[i] for i, level in enumerate(part.row_levels)
        ]
        return ca.vertcat(ca.SX(0, 1), *rows)

    phi = ca.vertcat(residual(equalities), residual(limits, linear, angular))
    jacobian = ca.jacobian(phi, ca.vertcat(*z))
    curvature, _ = ca.hessian(ca.dot(multipliers, phi), ca.vertcat(*z))
    parameters = ca.vertcat(*q, p, v, v_after, time, time_step, length)
    outputs = ca.vertcat(ca.densify(phi), *jacobian.nonzeros(), *curvature.nonzeros())
    function = ca.Function("stage", [*z, parameters, multipliers], [ca.cse(outputs)])
    mapped = function.map(count)
    jacobian_places = _places(jacobian)
    curvature_places = _places(curvature)
    width = outputs.shape[0]

    def evaluate(
        unknown: Floats, stage_parameters: Floats, weights: Floats
    ) -> tuple[Floats, Entries, Entries]:
        previous = np.concatenate([unknown[:1], unknown[:-1]])
        following = np.concatenate([unknown[1:], unknown[-1:]])
        result = np.empty((count, width))
        arguments = [
            np.ascontiguousarray(a)
            for a in (previous, unknown, following, stage_parameters, weights)
        ]
        buffer, run = mapped.buffer()
        for index, argument in enumerate(arguments):
            buffer.set_arg(index, argument.data)
        buffer.set_res(0, result.data)
        run()
        columns = np.ascontiguousarray(result.T)
        split = rows + len(jacobian_places)
        return (
            result[:, :rows],
            dict(zip(jacobian_places, columns[rows:split], strict=True)),
            dict(zip(curvature_places, columns[split:], strict=True)),
        )

    return evaluate


def _places(matrix: ca.SX) -> list[tuple[int, int]]:
    rows, columns = matrix.sparsity().get_triplet()
    return list(zip(rows, columns, strict=True))
