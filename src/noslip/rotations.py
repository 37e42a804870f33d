"""Rotations as CasADi expressions: quaternions ``(qw, qx, qy, qz)``, exponential and logarithm.

Arrays of rotations outside of expressions are SciPy's ``Rotation``; this module is for what is
differentiated or compiled.  Near angle 0 both maps switch to their Taylor series, so that values
and derivatives are exact there; at angle pi the logarithm takes one of its two values and stays
finite.
"""

from __future__ import annotations

import casadi as ca

from noslip._typing import Expression

_SERIES_BELOW = 1e-3
"""Squared angle (or squared tangent) below which the series are exact in double."""
_LEAST_SQUARE = 1e-30
"""Added to a squared angle: its root is not 0, also in single, and sin(x) / x of it is 1."""


def quaternion_product(a: Expression, b: Expression) -> Expression:
    """Hamilton product; turning by ``b``, then by ``a``."""
    return ca.vertcat(
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    )


def quaternion_conjugate(q: Expression) -> Expression:
    """Inverse of a unit quaternion."""
    return ca.vertcat(q[0], -q[1], -q[2], -q[3])


def quaternion_exp(rotation_vector: Expression) -> Expression:
    """Unit quaternion of ``Exp(rotation_vector)``; the vector has shape (3,), radians.

    The paper's eq. (6) with the time step where it belongs: the angle is ``|w| dt``.
    """
    square = ca.sumsqr(rotation_vector)
    small = square < _SERIES_BELOW
    angle = ca.sqrt(ca.if_else(small, 1.0, square))
    # sin(angle / 2) / angle and cos(angle / 2) as series in the squared angle.
    sine_series = 0.5 - square * (1 / 48 - square * (1 / 3840 - square / 645120))
    cosine_series = 1 - square * (1 / 8 - square * (1 / 384 - square * (1 / 46080)))
    sine = ca.if_else(small, sine_series, ca.sin(angle / 2) / angle)
    cosine = ca.if_else(small, cosine_series, ca.cos(angle / 2))
    return ca.vertcat(cosine, sine * rotation_vector)


def quaternion_turn(rotation_vector: Expression) -> Expression:
    """Return what :func:`quaternion_exp` does in a third of its operations; no derivative at 0.

    For what is known when a graph is differentiated, such as the step before.
    """
    angle = ca.sqrt(ca.sumsqr(rotation_vector) + _LEAST_SQUARE)
    return ca.vertcat(ca.cos(angle / 2), ca.sin(angle / 2) / angle * rotation_vector)


def quaternion_again(half: Expression, halfway: Expression, begun: Expression) -> Expression:
    """Turn ``halfway = half begun`` by the unit quaternion ``half`` once more.

    ``half^2 = 2 half_w half - 1``, which takes a third of a product's operations.
    """
    return 2 * half[0] * halfway - begun


def quaternion_log(q: Expression) -> Expression:
    """Rotation vector of a unit quaternion, shape (3,), angle within [0, pi].

    The paper's eq. (7) divides by the sine of the angle, which vanishes at 0 and at pi; the
    half-angle form does not.
    """
    sign = ca.if_else(q[0] < 0, -1.0, 1.0)
    cosine = sign * q[0]
    vector = sign * q[1:4]
    square = ca.sumsqr(vector)
    small = square < _SERIES_BELOW * cosine * cosine
    sine = ca.sqrt(ca.if_else(small, 1.0, square))
    safe_cosine = ca.if_else(small, cosine, 1.0)
    tangent = ca.if_else(small, square, 0.0) / (safe_cosine * safe_cosine)
    terms = 1 / 3 - tangent * (1 / 5 - tangent * (1 / 7 - tangent / 9))
    series = 2 / safe_cosine * (1 - tangent * terms)
    return ca.if_else(small, series, 2 * ca.atan2(sine, cosine) / sine) * vector


def rotation_matrix(q: Expression) -> Expression:
    """3 x 3 matrix of a unit quaternion; turns body vectors into the world frame."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    return ca.vertcat(
        ca.horzcat(1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        ca.horzcat(2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        ca.horzcat(2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
