"""Pointwise projection: Gauss's principle in each step, exact in discrete time.

The paper's coupling term is the least change of the acceleration, in a metric M, that satisfies the
constraint (Udwadia-Kalaba, eq. 14):

    ``a = a_u + M^-1 A^T (A M^-1 A^T)^+ (b - A a_u)``

Evaluated once a step, this formula leaves an error of the order of the step.  Here the velocities
``v+, w+`` are chosen such that the *next state* of the discrete motion, ``p+ = p + dt v+``,
``R+ = Exp(dt w+) R``, satisfies the constraint itself: the same projection, iterated by Newton's
method in the same metric a fixed number of times, unrolled in the expression graph.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from noslip import _arguments
from noslip.constraints.declaration import Constraint
from noslip.constraints.system import ConstraintSystem, as_system
from noslip.errors import ConstraintError
from noslip.primitives.stepping import Coupling, StepSymbols
from noslip.rotations import Expression, quaternion_exp, quaternion_product
from noslip.trajectory import PoseTrajectory

Floats = NDArray[np.float64]

POSITION_ONLY: tuple[float, ...] = (1.0, 1.0, 1.0, 0.0, 0.0, 0.0)
"""M^-1 of the paper: infinite rotational inertia, so that only the position gives way."""

RELATIVE_TIKHONOV = 1e-12
"""Added to ``A M^-1 A^T`` relative to its trace: makes repeated and dependent rows harmless."""
_SMALLEST_PIVOT = 1e-200
_APPROACHING, _RESTORING = 3, 3
"""Newton steps to the nearest point, and then straight onto the constraint."""
_MOST_ITERATIONS = 50


def gauss_acceleration(
    unconstrained: ArrayLike, A: ArrayLike, b: ArrayLike, inverse_metric: ArrayLike = POSITION_ONLY
) -> Floats:
    """Constrained acceleration by the Udwadia-Kalaba formula (the paper's eqs. 13 and 14).

    Parameters
    ----------
    unconstrained : array, shape (6,)
        Linear, then angular acceleration (m/s^2, rad/s^2), world frame.
    A : array, shape (m, 6)
    b : array, shape (m,)
    inverse_metric : array, shape (6,)
        Diagonal of M^-1; a zero keeps that acceleration as it is.

    Returns
    -------
    array, shape (6,)
    """
    a, A, b = (np.asarray(x, dtype=np.float64) for x in (unconstrained, A, b))
    weighted = np.asarray(inverse_metric, dtype=np.float64)[:, None] * A.T
    return np.asarray(a + weighted @ (np.linalg.pinv(A @ weighted, hermitian=True) @ (b - A @ a)))


def coupling(
    constraints: ConstraintSystem | Constraint | Sequence[Constraint],
    *,
    inverse_metric: Sequence[float] = POSITION_ONLY,
) -> Coupling:
    """Build the coupling term that holds constraints at each step.

    A violation present before a step shrinks by the step's ``residual_decay``: like
    ``exp(-kappa t)`` at velocity level, like a critically damped oscillator of that rate at
    position level.

    Parameters
    ----------
    constraints : ConstraintSystem or constraints
    inverse_metric : 6 numbers
        Diagonal of M^-1; position only by default, as in the paper.

    Returns
    -------
    Coupling
        For :class:`noslip.primitives.stepping.Stepper`.
    """
    system = as_system(constraints)
    metric = _arguments.inverse_metric(inverse_metric)
    weights = ca.DM(list(metric))
    _require_holdable(system, metric)

    def couple(
        s: StepSymbols, linear: Expression, angular: Expression
    ) -> tuple[Expression, Expression, Expression, Expression]:
        target = _decayed_residual(system, s)
        unconstrained = ca.vertcat(linear, angular)
        unknown = ca.SX.sym("nu", 6)
        # What the metric holds stays a known value: it then drops out of the derivatives.
        held = [weight == 0 for weight in metric]
        free = ca.vertcat(*(unconstrained[i] if held[i] else unknown[i] for i in range(6)))
        position, quaternion = s.advance(free[:3], free[3:])
        # Position-level rows over the step's length have the scale of velocities, and multipliers
        # of accelerations, as velocity-level rows do.
        scale = ca.vertcat(
            ca.SX(0, 1), *(1 if v else 1 / s.time_step for v in system.row_is_velocity)
        )
        phi = scale * system.residual(s.time, position, quaternion, free[:3], free[3:])
        goal = scale * target
        jacobian = ca.jacobian(phi, unknown)
        if not ca.depends_on(jacobian, unknown):
            # One row is divided by exactly; several are regularised, which further passes undo.
            approaching, restoring = (1 if system.size == 1 else 3), 0
        else:
            approaching, restoring = _APPROACHING, _RESTORING
        velocities, impulse = unconstrained, ca.SX(system.size, 1)
        for iteration in range(approaching + restoring):
            value, rows = ca.substitute([phi, jacobian], [unknown], [velocities])
            weighted = ca.mtimes(ca.diag(weights), rows.T)
            # Newton on the nearest point: the multipliers are corrected, not found anew, so that
            # what the regularisation leaves out of one iteration is made up for in the next.
            normal = ca.mtimes(rows, weighted)
            if iteration < approaching:
                moved = ca.mtimes(rows, velocities - unconstrained) - ca.mtimes(normal, impulse)
                impulse += _solve_regularised(normal, goal - value + moved)
                velocities = unconstrained + ca.mtimes(weighted, impulse)
            else:
                # Straight onto the constraint: quadratic, where the nearest point is linear.
                correction = _solve_regularised(normal, goal - value)
                impulse += correction
                velocities += ca.mtimes(weighted, correction)
        end_position, end_quaternion = s.advance(velocities[:3], velocities[3:])
        residual = system.residual(
            s.time, end_position, end_quaternion, velocities[:3], velocities[3:]
        )
        return velocities[:3], velocities[3:], residual, impulse / s.kick

    return couple


def _require_holdable(system: ConstraintSystem, metric: tuple[float, ...]) -> None:
    """Refuse a constraint that nothing which the metric leaves free can influence."""
    t, p, q = ca.SX.sym("t"), ca.SX.sym("p", 3), ca.SX.sym("q", 4)
    v, w = ca.SX.sym("v", 3), ca.SX.sym("w", 3)
    rows = ca.jacobian(system.first_order(t, p, q, v, w), ca.vertcat(v, w))
    for name, row in zip(system.row_names, range(system.size), strict=True):
        influenced = rows[row, :].sparsity().get_triplet()[1]
        if not any(metric[i] for i in influenced):
            raise ConstraintError(
                f"constraint {name!r} asks nothing of what inverse_metric leaves free; let the "
                "rotation give way too: inverse_metric=(1, 1, 1, 1, 1, 1)"
            )


def _decayed_residual(system: ConstraintSystem, s: StepSymbols) -> Expression:
    """What the residual may be after the step: zero, once it was zero.

    At position level the previous sample is needed too.  It is where the discrete motion came from,
    so a motion on the constraint stays on it to rounding.
    """
    before = s.time - s.time_step
    now = system.residual(before, s.position, s.quaternion, s.linear_velocity, s.angular_velocity)
    decay = s.residual_decay
    back = quaternion_exp(-s.previous_step * s.angular_velocity)
    earlier = system.residual(
        before - s.previous_step,
        s.position - s.previous_step * s.linear_velocity,
        quaternion_product(back, s.quaternion),
        s.linear_velocity,
        s.angular_velocity,
    )
    targets = [
        decay * now[i] if is_velocity else decay * (2 * now[i] - decay * earlier[i])
        for i, is_velocity in enumerate(system.row_is_velocity)
    ]
    return ca.vertcat(ca.SX(0, 1), *targets)


def _solve_regularised(matrix: Expression, right: Expression) -> Expression:
    """Solve a positive semi-definite system; dependent and vanished rows do no harm."""
    size = matrix.shape[0]
    if size == 1:
        return right / (matrix + _SMALLEST_PIVOT)
    shift = RELATIVE_TIKHONOV * ca.trace(matrix) + _SMALLEST_PIVOT
    regular = ca.densify(matrix) + shift * ca.SX.eye(size)
    return ca.ldl_solve(right, *ca.ldl(regular))


def project_velocities(
    constraints: ConstraintSystem | Constraint | Sequence[Constraint],
    time: float,
    position: ArrayLike,
    quaternion: ArrayLike,
    linear_velocity: ArrayLike,
    angular_velocity: ArrayLike,
    *,
    inverse_metric: Sequence[float] = POSITION_ONLY,
) -> tuple[Floats, Floats, Floats]:
    """Nearest velocities, in the metric, that the constraints allow at a pose.

    For the blade and the paper's metric this is the paper's projection of the initial velocity onto
    the blade's plane, ``P (P^T P)^-1 P^T v``.

    Returns
    -------
    linear_velocity, angular_velocity : array, shape (3,)
    residual : array, shape (m,)
        Of the constraints at this pose and the projected velocities.
    """
    system = as_system(constraints)
    given = np.concatenate([np.ravel(linear_velocity), np.ravel(angular_velocity)]).astype(float)
    weights = np.asarray(inverse_metric, dtype=np.float64)
    found = given
    residual, phi, rows = system.instant(time, position, quaternion, found[:3], found[3:])
    close = 1e-15 * max(1.0, np.abs(given).max())
    for iteration in range(_MOST_ITERATIONS):
        if np.abs(phi).max(initial=0.0) <= close:
            break
        weighted = weights[:, None] * rows.T
        inverse = np.linalg.pinv(rows @ weighted, hermitian=True)
        if iteration < _APPROACHING:
            found = given + weighted @ (inverse @ (rows @ (found - given) - phi))
        else:
            found = found - weighted @ (inverse @ phi)
        residual, phi, rows = system.instant(time, position, quaternion, found[:3], found[3:])
    return found[:3], found[3:], residual


def project_initial_velocity(
    trajectory: PoseTrajectory, constraints: ConstraintSystem | Constraint | Sequence[Constraint]
) -> PoseTrajectory:
    """Return a trajectory whose initial linear velocity satisfies the constraints.

    The last step of the paper's preparation (its section IV-B): the Udwadia-Kalaba method assumes
    that the motion starts on the constraint.  Poses stay as they are.
    """
    linear, angular, _ = project_velocities(
        constraints,
        0.0,
        trajectory.positions[0],
        trajectory.quaternions[0],
        trajectory.linear_velocities[0],
        trajectory.angular_velocities[0],
    )
    linear_velocities = trajectory.linear_velocities.copy()
    angular_velocities = trajectory.angular_velocities.copy()
    linear_velocities[0], angular_velocities[0] = linear, angular
    return replace(
        trajectory, linear_velocities=linear_velocities, angular_velocities=angular_velocities
    )
