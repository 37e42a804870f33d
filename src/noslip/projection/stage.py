"""The constraints of one step of a trajectory projection: residual, Jacobian and curvature."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

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

KEPT_COUNTS = 8
"""Numbers of stages for which the mapped functions are kept: those of a learning and its plans."""


class Stage:
    """What the constraints ask of one step, for any number of steps at once.

    Unknowns of a stage are those of the sample before the step, of its own, and of the next one.
    Rows of equalities come first, then those of limits.

    Parameters
    ----------
    system : ConstraintSystem
    hold_position : bool
        Only the rotation is unknown.
    """

    def __init__(self, system: ConstraintSystem, hold_position: bool) -> None:
        z, parameters, phi = _residual(system, hold_position)
        unknown, multipliers = ca.vertcat(*z), ca.SX.sym("lambda", system.size)
        jacobian = ca.jacobian(phi, unknown)
        # It is symmetric: below the diagonal, and on it, is enough.
        curvature = ca.tril(ca.hessian(ca.dot(multipliers, phi), unknown)[0])
        self.rows = system.size
        self._slope = _Mapped("slope", [*z, parameters], [ca.densify(phi), *jacobian.nonzeros()])
        self._curvature = _Mapped("curvature", [*z, parameters, multipliers], curvature.nonzeros())
        self._slope_places, self._curvature_places = _places(jacobian), _places(curvature)

    @classmethod
    def of(cls, system: ConstraintSystem, hold_position: bool) -> Stage:
        """Return the one that the system owns: to build it takes as long as two Newton steps."""
        return system.owned(("stage", hold_position), lambda: cls(system, hold_position))

    def slope(self, unknown: Floats, parameters: Floats) -> tuple[Floats, Entries]:
        """Residuals, shape (N, m), and their Jacobian.

        Parameters
        ----------
        unknown : array, shape (N, n)
        parameters : array, shape (N, ...)
        """
        result = self._slope(*_neighbors(unknown), parameters)
        columns = np.ascontiguousarray(result[:, self.rows :].T)
        return result[:, : self.rows], dict(zip(self._slope_places, columns, strict=True))

    def curvature(self, unknown: Floats, parameters: Floats, multipliers: Floats) -> Entries:
        """Second derivative of ``lambda . phi``, its lower triangle."""
        result = self._curvature(*_neighbors(unknown), parameters, multipliers)
        columns = np.ascontiguousarray(result.T)
        return dict(zip(self._curvature_places, columns, strict=True))


class _Mapped:
    """A function of one stage, evaluated in place for all stages at once."""

    def __init__(self, name: str, inputs: list[Expression], outputs: Sequence[Expression]) -> None:
        function = ca.Function(name, inputs, [ca.cse(ca.vertcat(ca.SX(0, 1), *outputs))])
        self._width = function.numel_out(0)
        self._map = lru_cache(KEPT_COUNTS)(function.map)

    def __call__(self, *arguments: Floats) -> Floats:
        count = len(arguments[0])
        result = np.empty((count, self._width))
        buffer, run = self._map(count).buffer()
        # Referred to until the call is over.
        given = [np.ascontiguousarray(a) for a in arguments]
        for index, argument in enumerate(given):
            buffer.set_arg(index, argument.data)
        buffer.set_res(0, result.data)
        run()
        return result


def _neighbors(unknown: Floats) -> tuple[Floats, Floats, Floats]:
    before = np.concatenate([unknown[:1], unknown[:-1]])
    after = np.concatenate([unknown[1:], unknown[-1:]])
    return before, unknown, after


def _residual(
    system: ConstraintSystem, hold_position: bool
) -> tuple[list[Any], Expression, Expression]:
    """Unknowns of three samples, parameters, residual."""
    unknowns = 3 if hold_position else 6
    z = [ca.SX.sym(f"z_{name}", unknowns) for name in ("before", "here", "after")]
    q = [ca.SX.sym(f"q_{name}", 4) for name in ("before", "here", "after")]
    p, v, v_after = ca.SX.sym("p", 3), ca.SX.sym("v", 3), ca.SX.sym("v_after", 3)
    time, time_step, length = ca.SX.sym("t"), ca.SX.sym("dt"), ca.SX.sym("L")
    equalities, limits = system.equalities, system.limits

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
        return part.by_level(middles, ends)

    phi = ca.vertcat(residual(equalities), residual(limits, linear, angular))
    parameters = ca.vertcat(*q, p, v, v_after, time, time_step, length)
    return z, parameters, phi


def _places(matrix: ca.SX) -> list[tuple[int, int]]:
    rows, columns = matrix.sparsity().get_triplet()
    return list(zip(rows, columns, strict=True))
