"""Single poses, quaternions scalar first: what a plant needs thousands of times."""

from __future__ import annotations

from math import atan2, cos, sin, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

NOWHERE = np.zeros(3)
_SMALL = 1e-9


class Pose(NamedTuple):
    """Position (m), shape (3,), and quaternion, shape (4,)."""

    position: Floats
    quaternion: Floats


def size(vector: Floats) -> float:
    """Length of a vector of three."""
    x, y, z = vector.tolist()
    return sqrt(x * x + y * y + z * z)


def product(one: Floats, other: Floats) -> Floats:
    """Hamilton's product: turned by the other, then by the one."""
    a, b, c, d = one.tolist()
    w, x, y, z = other.tolist()
    return np.array(
        [
            a * w - b * x - c * y - d * z,
            a * x + b * w + c * z - d * y,
            a * y + c * w + d * x - b * z,
            a * z + d * w + b * y - c * x,
        ]
    )


def turned(turn: Floats, quaternion: Floats) -> Floats:
    """Return ``Exp(turn) R``, normalized."""
    angle = size(turn)
    share = 0.5 if angle < _SMALL else sin(angle / 2) / angle
    found = product(np.concatenate([[cos(angle / 2)], share * turn]), quaternion)
    return np.asarray(found / sqrt(found @ found))


def turn_between(begin: Floats, end: Floats) -> Floats:
    """Shortest rotation vector from one to the other, world frame (rad)."""
    w, x, y, z = product(end, begin * [1.0, -1.0, -1.0, -1.0]).tolist()
    sine = sqrt(x * x + y * y + z * z)
    if w < 0:
        w, x, y, z = -w, -x, -y, -z
    share = 2.0 if sine < _SMALL else 2 * atan2(sine, w) / sine
    return share * np.array([x, y, z])


def body_axis(quaternion: Floats, index: int) -> Floats:
    """Return an axis of the body in the world."""
    w, x, y, z = quaternion.tolist()
    columns = (
        (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)),
        (2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)),
        (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)),
    )
    return np.array(columns[index])
