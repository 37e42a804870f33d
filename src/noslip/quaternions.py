"""Many rotations at once, as quaternions ``(qw, qx, qy, qz)`` in arrays.

SciPy's ``Rotation`` stands for rotations everywhere; a product of a thousand takes it ten times as
long as here.
"""

from __future__ import annotations

import numpy as np

from noslip._typing import Floats

SMALL = 1e-8
"""Sine of half an angle below which the angle is twice that, to the last bit."""


def product(one: Floats, other: Floats, axis: int = -1) -> Floats:
    """Hamilton product, shape (..., 4); turning by the other, then by the one.

    Parameters
    ----------
    axis : int
        Along which the numbers of a quaternion stand.
    """
    a, b, c, d = np.moveaxis(one, axis, 0)
    w, x, y, z = np.moveaxis(other, axis, 0)
    found = np.empty(np.broadcast_shapes(one.shape, other.shape))
    parts = np.moveaxis(found, axis, 0)
    parts[0] = a * w - b * x - c * y - d * z
    # In pairs that cancel where one is the inverse of the other: exactly no turn.
    parts[1] = (a * x + b * w) + (c * z - d * y)
    parts[2] = (a * y + c * w) + (d * x - b * z)
    parts[3] = (a * z + d * w) + (b * y - c * x)
    return found


def inverse(quaternions: Floats, axis: int = -1) -> Floats:
    """Of unit quaternions."""
    signs = np.array([1.0, -1.0, -1.0, -1.0])
    return np.moveaxis(np.moveaxis(quaternions, axis, -1) * signs, -1, axis)


def turns_between(begins: Floats, ends: Floats, axis: int = -1) -> Floats:
    """Rotation vectors, shape (N, 3), that lead from rotations to others: ``Log(R' R^T)`` (rad)."""
    w, x, y, z = np.moveaxis(product(ends, inverse(begins, axis), axis), axis, 0)
    sine = np.sqrt(x * x + y * y + z * z)
    small = sine < SMALL
    scale = np.where(small, 2.0, 2 * np.arctan2(sine, np.abs(w)) / np.where(small, 1.0, sine))
    scale = np.where(w < 0, -scale, scale)
    return np.stack([scale * x, scale * y, scale * z], axis=axis)


def turned(turns: Floats, quaternions: Floats, axis: int = -1) -> Floats:
    """Rotations turned by rotation vectors, shape (N, 3): ``Exp(turn) R``."""
    angle = np.sqrt(np.sum(turns**2, axis=axis, keepdims=True))
    small = angle < SMALL
    sine = np.where(small, 0.5, np.sin(angle / 2) / np.where(small, 1.0, angle))
    return product(np.concatenate([np.cos(angle / 2), sine * turns], axis), quaternions, axis)


def without_flips(quaternions: Floats) -> Floats:
    """The same rotations, each quaternion within a quarter sphere of the one before."""
    flips = np.where(np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0, -1.0, 1.0)
    signs = np.concatenate([[1.0], np.cumprod(flips)])
    return np.ascontiguousarray(quaternions * signs[:, None])
