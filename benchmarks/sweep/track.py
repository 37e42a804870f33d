"""A motion as its file tells it, by NumPy alone; quaternions have w first."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Instants:
    """Poses with velocities, one a row: where rules are asked."""

    times: Floats
    positions: Floats
    quaternions: Floats
    linear: Floats
    angular: Floats

    def axis(self, vector: Floats) -> Floats:
        """World directions of a vector of the body."""
        return turned(self.quaternions, vector)

    def point(self, offset: Floats) -> Floats:
        """World positions of a point of the body."""
        return self.positions + self.axis(offset)

    def velocity(self, offset: Floats) -> Floats:
        """Velocities of a point of the body."""
        return self.linear + np.cross(self.angular, self.axis(offset))


@dataclass(frozen=True)
class Track:
    """Samples of a motion.

    Attributes
    ----------
    times : array, shape (N,)
    positions : array, shape (N, 3)
    quaternions : array, shape (N, 4)
        Of continuous signs.
    """

    times: Floats
    positions: Floats
    quaternions: Floats

    @classmethod
    def read(cls, path: Path) -> Track:
        """Read t,x,y,z,qw,qx,qy,qz."""
        table = np.loadtxt(path, delimiter=",", skiprows=1)
        quaternions = table[:, 4:8] / np.linalg.norm(table[:, 4:8], axis=1)[:, None]
        signs = np.sign(np.sum(quaternions[1:] * quaternions[:-1], axis=1))
        quaternions[1:] *= np.cumprod(signs)[:, None]
        return cls(table[:, 0] - table[0, 0], table[:, 1:4], quaternions)

    def write(self, path: Path) -> None:
        """Write the same, in full precision."""
        table = np.column_stack([self.times, self.positions, self.quaternions])
        np.savetxt(path, table, "%.17g", ",", header="t,x,y,z,qw,qx,qy,qz", comments="")

    @property
    def duration(self) -> float:
        """Seconds."""
        return float(self.times[-1])

    @cached_property
    def length(self) -> float:
        """Of the path (m)."""
        return float(np.linalg.norm(np.diff(self.positions, axis=0), axis=1).sum())

    @cached_property
    def turning(self) -> float:
        """All turns together (rad)."""
        steps = np.diff(self.times)
        return float(np.linalg.norm(self.steps.angular, axis=1) @ steps)

    @cached_property
    def steps(self) -> Instants:
        """The middles of the steps, N - 1 of them."""
        h = np.diff(self.times)[:, None]
        q = self.quaternions
        middle = q[1:] + q[:-1]
        return Instants(
            (self.times[1:] + self.times[:-1]) / 2,
            (self.positions[1:] + self.positions[:-1]) / 2,
            middle / np.linalg.norm(middle, axis=1)[:, None],
            np.diff(self.positions, axis=0) / h,
            rotation_vectors(times(q[1:], conjugate(q[:-1]))) / h,
        )

    @cached_property
    def samples(self) -> Instants:
        """The samples but the first, each with the velocity of the step that leads to it."""
        return Instants(
            self.times[1:],
            self.positions[1:],
            self.quaternions[1:],
            self.steps.linear,
            self.steps.angular,
        )

    @cached_property
    def accelerations(self) -> tuple[Floats, Floats]:
        """Linear and angular acceleration from each step to the next, shape (N - 2, 3) each."""
        apart = np.diff(self.steps.times)[:, None]
        return np.diff(self.steps.linear, axis=0) / apart, (
            np.diff(self.steps.angular, axis=0) / apart
        )

    def at(self, fractions: Floats | float) -> tuple[Floats, Floats]:
        """Positions and quaternions at fractions of the motion, on chords between samples."""
        wanted = np.atleast_1d(fractions) * self.duration
        columns = [np.interp(wanted, self.times, c) for c in self.positions.T]
        turns = [np.interp(wanted, self.times, c) for c in self.quaternions.T]
        quaternions = np.column_stack(turns)
        return np.column_stack(columns), quaternions / np.linalg.norm(quaternions, axis=1)[:, None]

    def off(self, other: Track) -> tuple[Floats, Floats]:
        """Distance (m) and angle (rad) of each sample to another motion at the same fraction."""
        positions, quaternions = other.at(self.times / self.duration)
        return (
            np.linalg.norm(self.positions - positions, axis=1),
            angles(self.quaternions, quaternions),
        )


def times(a: Floats, b: Floats) -> Floats:
    """Product of quaternions."""
    (w, x, y, z), (s, u, v, t) = np.moveaxis(a, -1, 0), np.moveaxis(b, -1, 0)
    return np.stack(
        [
            w * s - x * u - y * v - z * t,
            w * u + x * s + y * t - z * v,
            w * v - x * t + y * s + z * u,
            w * t + x * v - y * u + z * s,
        ],
        axis=-1,
    )


def conjugate(q: Floats) -> Floats:
    """The rotation back."""
    return q * np.array([1.0, -1.0, -1.0, -1.0])


def turned(q: Floats, vector: Floats) -> Floats:
    """Turn a vector by each quaternion."""
    pure = np.concatenate([[0.0], np.asarray(vector, dtype=float)])
    return times(times(q, np.broadcast_to(pure, q.shape)), conjugate(q))[..., 1:]


def rotation_vectors(q: Floats) -> Floats:
    """Log, of the shorter way round."""
    q = np.where(q[..., :1] < 0, -q, q)
    sine = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    half = np.arctan2(sine, q[..., :1])
    return np.where(sine > 0, 2 * half / np.where(sine > 0, sine, 1.0), 2.0) * q[..., 1:]


def quaternion(vector: Floats) -> Floats:
    """Exp of a rotation vector, or of one a row."""
    vector = np.asarray(vector, dtype=float)
    half = np.linalg.norm(vector, axis=-1, keepdims=True) / 2
    return np.concatenate([np.cos(half), np.sinc(half / np.pi) * vector / 2], axis=-1)


def angles(a: Floats, b: Floats) -> Floats:
    """Angle between rotations (rad)."""
    return np.linalg.norm(rotation_vectors(times(a, conjugate(b))), axis=-1)
