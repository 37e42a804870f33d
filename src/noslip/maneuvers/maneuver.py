"""What a maneuver is: stretches of constant body twist, one after the other.

An arc, a straight, a turn where the tool stands, a helix: in the frame of the tool's edge (travel,
lateral axis, their cross product; at the edge's point) each is one twist, held for a while.  The
edge moves along its travel alone, so whatever a maneuver passes, a blade, a wheel or a needle may
pass without slip.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from noslip._typing import Floats
from noslip.quaternions import product, turned

_SMALL = 1e-4
"""Turns (rad) below which sine and cosine over them are their series."""


@dataclass(frozen=True)
class Stretch:
    """A stretch of constant body twist.

    Attributes
    ----------
    name : str
        As people say it: "left", "straight", "turn", ...
    advance : float
        Way along the edge's travel (m); negative backs up, 0 turns where the tool stands.
    turn : 3 floats
        Rotation vector of the whole stretch, in the edge's frame (rad).
    """

    name: str
    advance: float
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def twist(self) -> Floats:
        """Displacement, then rotation vector, of the whole stretch, edge's frame, shape (6,)."""
        return np.array([self.advance, 0.0, 0.0, *self.turn])

    @property
    def angle(self) -> float:
        """How far it turns (rad)."""
        return float(np.linalg.norm(self.turn))


@dataclass(frozen=True)
class Maneuver:
    """Stretches, one after the other.

    Attributes
    ----------
    stretches : tuple of Stretch
    """

    stretches: tuple[Stretch, ...]

    def __str__(self) -> str:
        """Its name and length: "right-straight-left, 2.31 m"."""
        return f"{self.name}, {self.length:.3g} m"

    @property
    def name(self) -> str:
        """Its stretches as people say them; where it stops on its way, there is a comma.

        "right-straight-left", "back right-straight-left" (all of it), "left, back right, left",
        "turn left, straight, turn right"; "stay" if there are none.
        """
        runs = itertools.groupby(self.stretches, lambda each: np.sign(each.advance))
        names = (
            ("back " if way < 0 else "") + "-".join(name for name, _ in itertools.groupby(words))
            for way, words in ((way, [each.name for each in run]) for way, run in runs)
        )
        return ", ".join(names) or "stay"

    @property
    def length(self) -> float:
        """Its way, forwards and backwards (m)."""
        return float(sum(abs(each.advance) for each in self.stretches))

    @property
    def turning(self) -> float:
        """Its turns, this way and that (rad)."""
        return float(sum(each.angle for each in self.stretches))

    @property
    def cusps(self) -> int:
        """How often it changes from forwards to backwards, or back."""
        ways = [np.sign(each.advance) for each in self.stretches if each.advance]
        return int(sum(one != other for one, other in itertools.pairwise(ways)))

    @cached_property
    def end(self) -> tuple[Floats, Floats]:
        """Where it leads: position (3,) and quaternion (4,), in the edge's frame at its start."""
        twists = [each.twist for each in self.stretches]
        positions, quaternions = integrated(np.array(twists).reshape(-1, 6))
        return positions[-1], quaternions[-1]


def integrated(
    twists: Floats,
    position: Sequence[float] | Floats = (0, 0, 0),
    quaternion: Sequence[float] | Floats = (1, 0, 0, 0),
) -> tuple[Floats, Floats]:
    """Poses that body twists lead through, one after the other.

    Parameters
    ----------
    twists : array, shape (N, 6)
        Displacement (m) and rotation vector (rad) of each, in the frame at its begin.
    position, quaternion : 3 and 4 numbers
        Of the first pose.

    Returns
    -------
    positions, quaternions : arrays, shape (N + 1, 3) and (N + 1, 4)
    """
    first = np.append(np.asarray(position, float), np.asarray(quaternion, float))
    steps = np.column_stack(exponential(twists))
    chain = np.vstack([first, steps])
    # Prefix products by doubling: every pass is one operation on whole arrays.
    reach = 1
    while reach < len(chain):
        before, after = chain[:-reach], chain[reach:]
        chain = np.vstack([chain[:reach], composed(before, after)])
        reach *= 2
    quaternions = chain[:, 3:]
    return chain[:, :3], quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)


def composed(first: Floats, then: Floats) -> Floats:
    """Poses, shape (N, 7), of the second as seen from the first."""
    q = first[:, 3:]
    return np.column_stack([first[:, :3] + rotated(q, then[:, :3]), product(q, then[:, 3:])])


def rotated(quaternions: Floats, vectors: Floats) -> Floats:
    """Vectors, shape (N, 3), turned by quaternions."""
    axis = quaternions[..., 1:]
    once = 2 * _cross(axis, vectors)
    return np.asarray(vectors + quaternions[..., :1] * once + _cross(axis, once))


def _cross(one: Floats, other: Floats) -> Floats:
    """Cross products of vectors; of a few, NumPy's takes four times as long."""
    return np.asarray(
        one[..., [1, 2, 0]] * other[..., [2, 0, 1]] - one[..., [2, 0, 1]] * other[..., [1, 2, 0]]
    )


def exponential(twists: Floats) -> tuple[Floats, Floats]:
    """Displacements (N, 3) and quaternions (N, 4) of body twists held for a unit of time.

    The exponential of SE(3) in closed form (Murray, Li and Sastry 1994, eq. 2.36).
    """
    way, turn = twists[:, :3], twists[:, 3:]
    angle = np.linalg.norm(turn, axis=1, keepdims=True)
    small = angle < _SMALL
    safe = np.where(small, 1.0, angle)
    square = angle**2
    one = np.where(small, 0.5 - square / 24, (1 - np.cos(safe)) / safe**2)
    two = np.where(small, 1 / 6 - square / 120, (safe - np.sin(safe)) / safe**3)
    once = _cross(turn, way)
    positions = way + one * once + two * _cross(turn, once)
    return positions, turned(turn, np.array([1.0, 0.0, 0.0, 0.0]))
