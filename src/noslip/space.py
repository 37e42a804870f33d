"""What a motion moves in: R^n x SO(3)^b, and the bodies that constraints see of it.

A pose is R^3 x SO(3); joints or any other vector R^n; a position alone R^3; two tools
R^6 x SO(3)^2.  A point is n coordinates and b unit quaternions (w first), a velocity n rates and b
angular velocities (rad/s, world frame).

Constraints are declared of a body, which has a pose; :class:`Placed` is one whose pose is part of
the point, :class:`Carried` one that joints carry, :class:`Seen` one as another sees it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import permutations
from typing import Any, Protocol, Self

import casadi as ca
import numpy as np

from noslip._typing import Expression, Floats
from noslip.errors import InputError
from noslip.quaternions import turned, turns_between
from noslip.rotations import (
    quaternion_again,
    quaternion_conjugate,
    quaternion_exp,
    quaternion_log,
    quaternion_product,
    rotation_matrix,
)

IN = " in "
"""Between the names of a body and of the one that sees it."""

Pose = tuple[Expression, Expression]
"""Position, shape (3,), and unit quaternion, shape (4,), as expressions."""


@dataclass(frozen=True)
class Twisted:
    """A body at an instant: its pose, twist and acceleration, as expressions, world frame.

    Attributes
    ----------
    position, linear, linear_acceleration : expression, shape (3,)
    quaternion : expression, shape (4,)
    angular, angular_acceleration : expression, shape (3,)
    """

    position: Expression
    quaternion: Expression
    linear: Expression
    angular: Expression
    linear_acceleration: Expression = 0
    angular_acceleration: Expression = 0


class Samples(Protocol):
    """A sampled motion in a space, of whichever kind: what projections need of one."""

    @property
    def times(self) -> Floats:
        """Seconds."""

    @property
    def name(self) -> str:
        """What errors call it."""

    def __len__(self) -> int: ...

    @property
    def space(self) -> Space:
        """What it moves in."""

    @property
    def points(self) -> Floats:
        """Coordinates, then quaternions, shape (N, n + 4 b)."""

    @property
    def positions(self) -> Floats:
        """Coordinates, shape (N, n)."""

    @property
    def quaternions(self) -> Floats:
        """Rotations (w first), shape (N, 4 b), each near the one before, not near its opposite."""

    @property
    def clock(self) -> Floats:
        """Times from the first sample on (s)."""

    @property
    def duration(self) -> float:
        """Time from the first sample to the last (s)."""

    @property
    def path_length(self) -> float:
        """Length of the polyline through the coordinates."""

    @property
    def is_uniform(self) -> bool:
        """Whether all samples are the same time apart."""

    def step_velocities(self) -> tuple[Floats, Floats]:
        """Rates of each step, shape (N - 1, n), and its angular velocities, (N - 1, 3 b)."""

    @property
    def linear_velocities(self) -> Floats:
        """Rates at the samples, shape (N, n)."""

    @property
    def angular_velocities(self) -> Floats:
        """Angular velocities at the samples, shape (N, 3 b)."""

    def with_points(self, points: Floats, times: Floats | None = None) -> Self:
        """Return it elsewhere."""

    def with_velocities(self, linear: Floats, angular: Floats) -> Self:
        """Return it with other velocities at the samples."""


class Body(Protocol):
    """Something with a pose."""

    @property
    def name(self) -> str:
        """What constraints call it by."""

    def pose(self, position: Expression, quaternion: Expression) -> Pose:
        """Return its pose at a point of the space."""

    @property
    def is_placed(self) -> bool:
        """Whether its pose and twist are parts of the point and of its velocity."""


@dataclass(frozen=True)
class Placed:
    """A body whose pose is part of the point.

    Parameters
    ----------
    name : str
    first : int
        Of its three coordinates.
    turn : int or None
        Which rotation is its; None: it never turns.
    """

    name: str = "tool"
    first: int = 0
    turn: int | None = 0

    is_placed = True

    def pose(self, position: Expression, quaternion: Expression) -> Pose:
        """Return its pose at a point of the space."""
        turn = ca.DM([1, 0, 0, 0]) if self.turn is None else _part(quaternion, self.turn, 4)
        return position[self.first : self.first + 3], turn

    def twist(self, linear: Expression, angular: Expression) -> tuple[Expression, Expression]:
        """Return its linear and angular part of a velocity or acceleration of the space."""
        turning = ca.SX(3, 1) if self.turn is None else _part(angular, self.turn, 3)
        return linear[self.first : self.first + 3], turning


class Kinematics(Protocol):
    """What carries a tool: hashable, equal if it is the same."""

    @property
    def size(self) -> int:
        """How many joints it has."""

    def pose(self, q: Expression) -> Pose:
        """Return the tool's pose of joint values; continuous in them."""


@dataclass(frozen=True)
class Carried:
    """A body that the coordinates carry as joints.

    Parameters
    ----------
    kinematics : Kinematics
    name : str
    """

    kinematics: Kinematics
    name: str = "tool"

    is_placed = False

    def pose(self, position: Expression, quaternion: Expression) -> Pose:
        """Return its pose at a point of the space."""
        return self.kinematics.pose(position)


@dataclass(frozen=True)
class Seen:
    """A body as another one sees it, that moves: ``R_b^T (p_a - p_b)`` and ``R_b^T R_a``.

    Parameters
    ----------
    body, work : Placed
        a and b.
    """

    body: Placed
    work: Placed

    is_placed = False

    @property
    def name(self) -> str:
        """What constraints call it by."""
        return f"{self.body.name}{IN}{self.work.name}"

    def pose(self, position: Expression, quaternion: Expression) -> Pose:
        """Return its pose at a point of the space."""
        (p, q), (c, f) = (each.pose(position, quaternion) for each in (self.body, self.work))
        turned = quaternion_product(quaternion_conjugate(f), q)
        return ca.mtimes(rotation_matrix(f).T, p - c), turned


@dataclass(frozen=True)
class Space:
    """R^n x SO(3)^b.

    Parameters
    ----------
    coordinates : tuple of str
        Names of the n coordinates.
    units : tuple of str
        Of each coordinate; "m" where left out.
    rotations : int
        b.
    bodies : tuple of Body
        That constraints may be declared of; the first one is the tool.
    """

    coordinates: tuple[str, ...] = ("x", "y", "z")
    units: tuple[str, ...] = ()
    rotations: int = 1
    bodies: tuple[Body, ...] = (Placed(),)

    def __post_init__(self) -> None:
        units = self.units or ("m",) * len(self.coordinates)
        if len(units) != len(self.coordinates):
            raise InputError(f"{len(self.coordinates)} coordinates, but {len(units)} units")
        object.__setattr__(self, "units", units)

    @property
    def unit(self) -> str:
        """Of the coordinates, in words for messages."""
        (unit, *others) = dict.fromkeys(self.units)
        return "in their own units" if others or unit == "1" else unit

    @property
    def linear(self) -> int:
        """n: how many coordinates there are."""
        return len(self.coordinates)

    @property
    def angular(self) -> int:
        """3 b."""
        return 3 * self.rotations

    @property
    def velocity_size(self) -> int:
        """Numbers of a velocity: n + 3 b."""
        return self.linear + self.angular

    @property
    def point_size(self) -> int:
        """Numbers of a point: n + 4 b."""
        return self.linear + 4 * self.rotations

    @property
    def is_pose(self) -> bool:
        """Whether a point is a pose, and nothing else."""
        return (self.linear, self.rotations) == (3, 1)

    @property
    def carrier(self) -> Any:
        """What carries the tool, if joints do."""
        bodies = (body for body in self.bodies if isinstance(body, Carried))
        return next((body.kinematics for body in bodies), None)

    @cached_property
    def is_placed(self) -> bool:
        """Whether all bodies are parts of the point."""
        return all(body.is_placed for body in self.bodies)

    @cached_property
    def seen(self) -> tuple[Body, ...]:
        """The bodies, then, of two or more that are placed, each as each other one sees it."""
        placed = [body for body in self.bodies if isinstance(body, Placed)]
        return (*self.bodies, *(Seen(*pair) for pair in permutations(placed, 2)))

    def body(self, name: str) -> int:
        """Return which one of :attr:`seen` has a name; "" is the first one."""
        names = [body.name for body in self.seen]
        if not name and names:
            return 0
        if name not in names:
            if not names:
                raise InputError(
                    f"{', '.join(self.coordinates)} carry no tool; of joints name the robot, "
                    "robot=... (--robot) to what reads or learns them or trajectory.on(chain); of "
                    "poses say how they turn, rotation=... (--rotation) to what reads them"
                )
            raise InputError(f"no body {name!r}; there are {', '.join(names)}")
        return names.index(name)

    # ---------------------------------------------------------------- arrays of points

    def difference(self, ends: Floats, begins: Floats, axis: int = -1) -> Floats:
        """``(x' - x, Log(R' R^T))`` of points, shape (N, n + 3 b).

        Parameters
        ----------
        axis : int
            Along which the numbers of a point stand.
        """
        n = self.linear
        parts = [_along(axis, ends, 0, n) - _along(axis, begins, 0, n)]
        for k in range(self.rotations):
            at = n + 4 * k, n + 4 * k + 4
            one, other = (_along(axis, points, *at) for points in (begins, ends))
            parts.append(turns_between(one, other, axis))
        return np.concatenate(parts, axis)

    def moved(self, points: Floats, changes: Floats, axis: int = -1) -> Floats:
        """``(x + d, Exp(r) R)``: the inverse of :meth:`difference`, shape (N, n + 4 b)."""
        n = self.linear
        parts = [_along(axis, points, 0, n) + _along(axis, changes, 0, n)]
        for k in range(self.rotations):
            by = _along(axis, changes, n + 3 * k, n + 3 * k + 3)
            parts.append(turned(by, _along(axis, points, n + 4 * k, n + 4 * k + 4), axis))
        return np.concatenate(parts, axis)

    def carried(self, positions: Floats) -> tuple[Floats, Floats]:
        """Places of bodies that joints carry, and the derivatives of these.

        Parameters
        ----------
        positions : array, shape (N, n)

        Returns
        -------
        places : array, shape (c, N, 3)
        derivatives : array, shape (c, N, 3, n)
        """
        found = np.array([_places(body, positions) for body in self.bodies if not body.is_placed])
        found = found.reshape(-1, len(positions), 3 * (1 + self.linear))
        return found[..., :3], found[..., 3:].reshape(*found.shape[:2], 3, self.linear)

    # ---------------------------------------------------------------- expressions

    def each(self, function: Callable[..., Expression], *parts: Expression) -> Expression:
        """Apply a function of rotations to each one; parts are b quaternions or b vectors."""
        if self.rotations == 1:
            return function(*parts)
        found = [
            function(*(_part(part, k, part.numel() // self.rotations) for part in parts))
            for k in range(self.rotations)
        ]
        return ca.vertcat(ca.SX(0, 1), *found)

    def bodies_at(
        self,
        position: Expression,
        quaternion: Expression,
        linear: Expression,
        angular: Expression,
        acceleration: Expression,
        angular_acceleration: Expression,
    ) -> list[Twisted]:
        """Of :attr:`seen` at a point that moves; of n, 4 b, n, 3 b, n and 3 b numbers."""
        found = []
        rates = linear, angular, acceleration, angular_acceleration
        for body in self.seen:
            if isinstance(body, Placed):
                moving = body.twist(linear, angular)
                pushed = body.twist(acceleration, angular_acceleration)
            else:
                moving, pushed = _carried(self, body, position, quaternion, *rates)
            found.append(Twisted(*body.pose(position, quaternion), *moving, *pushed))
        return found

    def bodies_of_step(
        self,
        time_step: Expression,
        position: Expression,
        quaternion: Expression,
        linear: Expression,
        angular: Expression,
        acceleration: Expression,
        angular_acceleration: Expression,
    ) -> tuple[list[Twisted], list[Twisted]]:
        """Bodies in the middle and at the end of a step from a point on, at constant velocity.

        Their twist is the step's own: from their pose before to their pose after it, so that
        poses alone tell it.
        """
        h = time_step
        half = self.each(quaternion_exp, h / 2 * angular)
        halfway = self.each(quaternion_product, half, quaternion)
        end = position + h * linear, self.each(quaternion_again, half, halfway, quaternion)
        middle = position + h / 2 * linear, halfway
        steps = self.steps_of_bodies(h, (position, quaternion), middle, end, linear, angular)
        middles, ends = [], []
        rates = linear, angular, acceleration, angular_acceleration
        for body, (there, over, moving) in zip(self.seen, steps, strict=True):
            if isinstance(body, Placed):
                pushed = body.twist(acceleration, angular_acceleration)
            else:
                _, pushed = _carried(self, body, *middle, *rates)
            middles.append(Twisted(*there, *moving, *pushed))
            ends.append(Twisted(*over, *moving, *pushed))
        return middles, ends

    def steps_of_bodies(
        self,
        time_step: Expression,
        before: Pose,
        middle: Pose,
        after: Pose,
        linear: Expression,
        angular: Expression,
    ) -> list[tuple[Pose, Pose, tuple[Expression, Expression]]]:
        """Of each of :attr:`seen` its pose in a step's middle, that at its end, and its twist.

        Parameters
        ----------
        before, middle, after : (n numbers, 4 b numbers)
            Points of the space.
        linear, angular : expression
            The step's own velocity there.
        """
        found = []
        for body in self.seen:
            over = body.pose(*after)
            if isinstance(body, Placed):
                found.append((body.pose(*middle), over, body.twist(linear, angular)))
            else:
                there, moving = between(body.pose(*before), over, time_step)
                found.append((there, over, moving))
        return found


def between(before: Pose, after: Pose, time_step: Expression) -> tuple[Pose, Pose]:
    """Pose halfway between two, and the twist that leads from one to the other.

    Quaternions are near each other, not near each other's opposite.
    """
    (p, q), (p_after, q_after) = before, after
    linear = (p_after - p) / time_step
    turn = quaternion_log(quaternion_product(q_after, quaternion_conjugate(q)))
    middle = q + q_after
    halfway = p + time_step / 2 * linear, middle / ca.norm_2(middle)
    return halfway, (linear, turn / time_step)


def _places(body: Any, positions: Floats) -> Floats:
    count, size = positions.shape
    return np.array(_place(body, size).map(count)(positions.T)).T


@lru_cache(16)
def _place(body: Any, size: int) -> Any:
    x = ca.SX.sym("x", size)
    p, _ = body.pose(x, ca.SX(0, 1))
    slopes = ca.densify(ca.jacobian(p, x))
    return ca.Function("place", [x], [ca.cse(ca.vertcat(p, ca.vec(slopes.T)))])


def _carried(space: Space, body: Any, *moving: Expression) -> tuple[Pose, Pose]:
    """Twist and acceleration of a body that is not placed, at a point that moves."""
    # Zeros that are left out would not fit.
    v, w, a, alpha = _carrying(space, body)(*(ca.densify(ca.SX(part)) for part in moving))
    return (v, w), (a, alpha)


@lru_cache(16)
def _carrying(space: Space, body: Any) -> Any:
    sizes = space.linear, 4 * space.rotations, *(2 * (space.linear, space.angular))
    given = [ca.SX.sym(name, size) for name, size in zip("xqvwab", sizes, strict=True)]
    x, q, v, w, a, alpha = given

    def rate(w: Expression, q: Expression) -> Expression:
        return quaternion_product(ca.vertcat(0, w), q) / 2

    place, turn = body.pose(x, q)
    point, rates = ca.vertcat(x, q), ca.vertcat(v, space.each(rate, w, q))
    linear = ca.jtimes(place, point, rates)
    turning = quaternion_product(ca.jtimes(turn, point, rates), quaternion_conjugate(turn))
    angular = 2 * turning[1:]
    both, along = ca.vertcat(point, v, w), ca.vertcat(rates, a, alpha)
    found = linear, angular, ca.jtimes(linear, both, along), ca.jtimes(angular, both, along)
    return ca.Function("carrying", given, [*map(ca.densify, found)])


def _along(axis: int, array: Floats, first: int, last: int) -> Floats:
    """Part of an array along an axis."""
    return np.moveaxis(np.moveaxis(array, axis, 0)[first:last], 0, axis)


def _part(rows: Expression, index: int, width: int) -> Expression:
    return rows[width * index : width * (index + 1)]


POSE = Space()
"""R^3 x SO(3): what a tool moves in."""


def vectors(names: Sequence[str], units: Sequence[str] = ()) -> Space:
    """Return R^n; constraints may be declared of the coordinates."""
    return Space(tuple(names), tuple(units), 0, ())


def positions() -> Space:
    """Return R^3 as the place of a tool that never turns."""
    return Space(rotations=0, bodies=(Placed(turn=None),))


def jointed(kinematics: Kinematics, names: Sequence[str], units: Sequence[str] = ()) -> Space:
    """Return R^n as joints that carry a tool."""
    return Space(tuple(names), tuple(units), 0, (Carried(kinematics),))


def several(names: Sequence[str]) -> Space:
    """Return the poses of several tools."""
    axes = tuple(f"{name}.{axis}" for name in names for axis in "xyz")
    bodies = tuple(Placed(name, 3 * k, k) for k, name in enumerate(names))
    return Space(axes, (), len(names), bodies)
