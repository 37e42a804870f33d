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
        inputs, phi = _residual(system, hold_position)
        unknown, multipliers = inputs[0], ca.SX.sym("lambda", system.size)
        jacobian = ca.jacobian(phi, unknown)
        # It is symmetric: below the diagonal, and on it, is enough.
        curvature = ca.tril(ca.hessian(ca.dot(multipliers, phi), unknown)[0])
        values, slopes = ca.densify(phi), jacobian.nonzeros()
        self.system = system
        self.rows, self.unknowns = system.size, 3 if hold_position else 6
        self.equalities = system.equalities.size
        # With accelerations a row asks something of the sample after its own, too.
        self.reaches_over = "acceleration" in system.limits.row_levels
        self.functions = (
            _of_stage("values", inputs, [values]),
            _of_stage("slope", inputs, [values, *slopes]),
            _of_stage("curvature", [*inputs, multipliers], curvature.nonzeros()),
        )
        self.values, self._slope, self._curvature = map(_Mapped, self.functions)
        self.slope_places, self.curvature_places = _places(jacobian), _places(curvature)

    @classmethod
    def of(cls, system: ConstraintSystem, hold_position: bool) -> Stage:
        """Return the one that the system owns: to build it takes as long as two Newton steps."""
        return system.owned(("stage", hold_position), lambda: cls(system, hold_position))

    def slope(self, *stages: Floats) -> tuple[Floats, Entries]:
        """Residuals, shape (N, m), and their Jacobian.

        Parameters
        ----------
        *stages : array, shape (N, ...)
            Unknowns and reference of the three samples; see :func:`_residual`.
        """
        result = self._slope(*stages)
        columns = np.ascontiguousarray(result[:, self.rows :].T)
        return result[:, : self.rows], dict(zip(self.slope_places, columns, strict=True))

    def curvature(self, *stages: Floats) -> Entries:
        """Second derivative of ``lambda . phi``, its lower triangle; multipliers come last."""
        columns = np.ascontiguousarray(self._curvature(*stages).T)
        return dict(zip(self.curvature_places, columns, strict=True))


class _Mapped:
    """A function of one stage, evaluated in place for all stages at once."""

    def __init__(self, function: ca.Function) -> None:
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


def of_three(rows: Floats) -> Floats:
    """Rows (N + 2, n), each but the outermost between its neighbors: shape (N, 3 n)."""
    return np.hstack([rows[:-2], rows[1:-1], rows[2:]])


def _residual(system: ConstraintSystem, hold_position: bool) -> tuple[list[Any], Expression]:
    """Inputs and residual of a stage.

    The inputs are the unknowns, the reference's quaternions and its positions, each of three
    samples; then the sample's time, the time step and the path's length.
    """
    unknowns = 3 if hold_position else 6
    inputs = [ca.SX.sym(name, n) for name, n in zip("zqpt", (3 * unknowns, 12, 9, 3), strict=True)]
    z, q, p = (ca.vertsplit(each, each.numel() // 3) for each in inputs[:3])
    time, time_step, length = ca.vertsplit(inputs[3])
    equalities, limits = system.equalities, system.limits

    turned = [
        quaternion_product(quaternion_exp(part[:3]), reference)
        for part, reference in zip(z, q, strict=True)
    ]

    def rate(first: int) -> Expression:
        turn = quaternion_product(turned[first + 1], quaternion_conjugate(turned[first]))
        return quaternion_log(turn) / time_step

    def velocity(first: int) -> Expression:
        velocity = (p[first + 1] - p[first]) / time_step
        if hold_position:
            return velocity
        return velocity + length * (z[first + 1][3:] - z[first][3:]) / time_step

    position = p[1] if hold_position else p[1] + length * z[1][3:]
    linear, angular = velocity(0), rate(0)
    accelerations = (velocity(1) - linear) / time_step, (rate(1) - angular) / time_step
    # The quaternions are continuous from sample to sample, so their sum is halfway between them.
    middle = turned[0] + turned[1]
    at_middle = (
        time - time_step / 2,
        position - time_step / 2 * linear,
        middle / ca.norm_2(middle),
        linear,
        angular,
    )
    at_end = (time, position, turned[1], linear, angular)

    def residual(part: ConstraintSystem, *accelerations: Expression) -> Expression:
        middles, ends = (part.residual(*at, *accelerations) for at in (at_middle, at_end))
        return part.by_level(middles, ends)

    return inputs, ca.vertcat(residual(equalities), residual(limits, *accelerations))


def _of_stage(name: str, inputs: list[Expression], outputs: Sequence[Expression]) -> ca.Function:
    stacked = ca.cse(ca.vertcat(ca.SX(0, 1), *outputs))
    given = ["z", "q", "p", "at", "multipliers"][: len(inputs)]
    return ca.Function(name, inputs, [stacked], given, ["found"])


def _places(matrix: ca.SX) -> list[tuple[int, int]]:
    rows, columns = matrix.sparsity().get_triplet()
    return list(zip(rows, columns, strict=True))
