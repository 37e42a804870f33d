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
from noslip.space import Twisted

Entries = dict[tuple[int, int], Floats]
"""Structural nonzeros of a stage's matrix: (row, column) -> value at each stage."""

KEPT_COUNTS = 8
"""Numbers of stages for which the mapped functions are kept: those of a learning and its plans."""


class Stage:
    """What the constraints ask of one step, for any number of steps at once.

    Unknowns of a stage are those of the sample before the step, of its own, and of the next one: of
    each 3 b of rotation vectors, then, unless held, n of displacements over the length.
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
        self.rows, self.unknowns = system.size, int(inputs[0].numel()) // 3
        self.space = system.space
        # Joints turn a tool, and cost what its turns do.
        self.turns = self.unknowns if not system.space.is_placed else system.space.angular
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
    space = system.space
    turns, shifts = space.angular, 0 if hold_position else space.linear
    sizes = turns + shifts, 4 * space.rotations, space.linear
    inputs = [ca.SX.sym(name, 3 * size) for name, size in zip("zqp", sizes, strict=True)]
    z, q, p = (
        [each[k * size : (k + 1) * size] for k in range(3)]
        for each, size in zip(inputs, sizes, strict=True)
    )
    inputs.append(ca.SX.sym("t", 3))
    time, h, length = ca.vertsplit(inputs[3])

    def turn(by: Expression, reference: Expression) -> Expression:
        return quaternion_product(quaternion_exp(by), reference)

    def turning(after: Expression, before: Expression) -> Expression:
        return quaternion_log(quaternion_product(after, quaternion_conjugate(before)))

    def halfway(before: Expression, after: Expression) -> Expression:
        # Quaternions are continuous from sample to sample.
        middle = before + after
        return middle / ca.norm_2(middle)

    turned = [space.each(turn, z[k][:turns], q[k]) for k in range(3)]
    positions = [p[k] + length * z[k][turns:] if shifts else p[k] for k in range(3)]

    def step(first: int) -> tuple[Expression, Expression, Any]:
        """Velocity of a step, the middle's coordinates, and what bodies do in it."""
        before, after = turned[first : first + 2]
        linear = (p[first + 1] - p[first]) / h
        if shifts:
            linear += length * (z[first + 1][turns:] - z[first][turns:]) / h
        angular = space.each(turning, after, before) / h
        middle = positions[first + 1] - h / 2 * linear
        points = (
            (positions[first], before),
            (middle, space.each(halfway, before, after)),
            (positions[first + 1], after),
        )
        return linear, middle, space.steps_of_bodies(h, *points, linear, angular)

    (linear, middle, bodies), (linear_after, _, bodies_after) = step(0), step(1)

    def residual(part: ConstraintSystem, *, accelerated: bool) -> Expression:
        middles, ends = [], []
        for (there, over, moving), (*_, moving_after) in zip(bodies, bodies_after, strict=True):
            both = zip(moving_after, moving, strict=True)
            pushed = [(after - now) / h for after, now in both] if accelerated else (0, 0)
            middles.append(Twisted(*there, *moving, *pushed))
            ends.append(Twisted(*over, *moving, *pushed))
        acceleration = (linear_after - linear) / h if accelerated else 0
        return part.by_level(
            part.of_bodies(time - h / 2, middles, middle, linear, acceleration),
            part.of_bodies(time, ends, positions[1], linear, acceleration),
        )

    equalities, limits = system.equalities, system.limits
    return inputs, ca.vertcat(
        residual(equalities, accelerated=False), residual(limits, accelerated=limits.size > 0)
    )


def _of_stage(name: str, inputs: list[Expression], outputs: Sequence[Expression]) -> ca.Function:
    stacked = ca.cse(ca.vertcat(ca.SX(0, 1), *outputs))
    given = ["z", "q", "p", "at", "multipliers"][: len(inputs)]
    return ca.Function(name, inputs, [stacked], given, ["found"])


def _places(matrix: ca.SX) -> list[tuple[int, int]]:
    rows, columns = matrix.sparsity().get_triplet()
    return list(zip(rows, columns, strict=True))
