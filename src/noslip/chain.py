"""Joints from the world to a tool: where the tool is, as an expression of their positions.

A chain is a value: equal to another that says the same, sent and saved as what it says.  Models in
files (MJCF, URDF) become chains by :func:`noslip.robots.chain`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache
from typing import Any, Literal, get_args

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from noslip import _arguments
from noslip._pose_checks import MAX_NORM_ERROR
from noslip._typing import Expression, Floats
from noslip.errors import InputError
from noslip.quaternions import turns_between
from noslip.rotations import quaternion_product
from noslip.trajectory import PoseTrajectory

Kind = Literal["hinge", "slide"]
Numbers = Sequence[float] | Floats
"""So many numbers; kept as a tuple, so that values compare equal and can be saved."""
MOST_JOINTS = 64
"""Of a chain: more than any arm has; graphs grow with them."""
ROUNDING = 1e-14
"""Parts of a unit vector, or of an offset (m), that are left out of graphs: what rounding leaves
where a model's axes are parallel to each other or meet, dozens of times what a double resolves."""

REACHED, SETTLED = 1e-12, 1e-12
"""Pose (m, rad) that inverse kinematics may leave, and the last step of a joint (rad, m): a dozen
roundings of an arm of a meter or two."""
MOST_STEPS, LARGEST_STEP = 100, 0.3
"""Of inverse kinematics, and of a joint in one (rad, m): beyond, the linearization points
elsewhere."""
SINGULAR = 1e-6
"""Singular values of a Jacobian over the largest below which a direction is out of reach."""
_SAME_LENGTH = 1e-15
"""Of a square off 1: what is left when a vector was divided by its length."""


@dataclass(frozen=True)
class Offset:
    """A fixed pose in a frame.

    Attributes
    ----------
    position : array, shape (3,)
        Meters.
    rotation : Rotation
    """

    position: Floats = field(default_factory=lambda: np.zeros(3))
    rotation: Rotation = field(default_factory=Rotation.identity)

    def then(self, position: Any, quaternion: Numbers = (1.0, 0.0, 0.0, 0.0)) -> Offset:
        """Return the pose that stands at another in this one."""
        return Offset(
            self.position + self.rotation.apply(position),
            self.rotation * Rotation.from_quat(quaternion, scalar_first=True),
        )

    @property
    def quaternion(self) -> tuple[float, ...]:
        """Its rotation, ``(qw, qx, qy, qz)``."""
        return _quaternion(self.rotation)


@dataclass(frozen=True)
class Joint:
    """A hinge or a slide, and how its frame stands in that of the joint before.

    Parameters
    ----------
    name : str
    kind : "hinge" or "slide"
    axis : 3 numbers
        Through the origin of the joint's frame, in that frame; kept at length 1.
    position : 3 numbers
        Origin of the joint's frame in that of the joint before, as that one has moved it; of the
        first joint, in the world (m).
    rotation : 4 numbers
        Its rotation there, ``(qw, qx, qy, qz)``; kept at length 1.
    zero : float
        The joint's position at which it moves nothing (rad, m).
    lower, upper : float
        Bounds of its position (rad, m); infinite where there are none, as the others are.
    velocity, acceleration : float
        The largest it may have (rad/s, m/s; rad/s^2, m/s^2).

    Raises
    ------
    InputError
        If one is not what it must be; the message names the joint.
    """

    name: str
    kind: Kind = "hinge"
    axis: Numbers = (0.0, 0.0, 1.0)
    position: Numbers = (0.0, 0.0, 0.0)
    rotation: Numbers = (1.0, 0.0, 0.0, 0.0)
    zero: float = 0.0
    lower: float = -np.inf
    upper: float = np.inf
    velocity: float = np.inf
    acceleration: float = np.inf

    def __post_init__(self) -> None:
        where = f"joint {_arguments.short(self.name)}"
        if not isinstance(self.name, str) or not self.name or not self.name.isprintable():
            raise InputError(f"{where}: a name is a text that can be printed")
        if self.kind not in get_args(Kind):
            raise InputError(f"{where}: kind must be hinge or slide, got {self.kind!r}")
        axis = _arguments.vector(f"{where}: axis", self.axis, "a direction")
        if not axis.any():
            raise InputError(f"{where}: axis must not be zero")
        position = _arguments.vector(f"{where}: position", self.position)
        bounds = [_arguments.number(each) for each in (self.lower, self.upper)]
        if not bounds[0] < bounds[1]:
            raise InputError(
                f"{where}: lower must be less than upper, got {self.lower!r} and {self.upper!r}"
            )
        most = [_arguments.number(each) for each in (self.velocity, self.acceleration)]
        if not all(each > 0 for each in most):
            raise InputError(
                f"{where}: velocity and acceleration must be positive, "
                f"got {self.velocity!r} and {self.acceleration!r}"
            )
        kept = {
            "axis": _of_length_1(axis),
            "position": _tuple(position),
            "rotation": _unit_quaternion(f"{where}: rotation", self.rotation),
            "zero": _arguments.finite(f"{where}: zero", self.zero),
            **dict(zip(("lower", "upper", "velocity", "acceleration"), bounds + most, strict=True)),
        }
        for name, value in kept.items():
            object.__setattr__(self, name, value)

    @property
    def unit(self) -> str:
        """Of its position: rad or m."""
        return "rad" if self.kind == "hinge" else "m"


@dataclass(frozen=True)
class Chain:
    """Joints one after another from the world to a tool's frame.

    Parameters
    ----------
    joints : sequence of Joint
        The one that stands in the world first.
    position : 3 numbers
        Origin of the tool's frame in that of the last joint (m).
    rotation : 4 numbers
        Its rotation there, ``(qw, qx, qy, qz)``.
    name : str
        Messages use it.

    Raises
    ------
    InputError
        If there is no joint, or two are of one name.
    """

    joints: Sequence[Joint]
    position: Numbers = (0.0, 0.0, 0.0)
    rotation: Numbers = (1.0, 0.0, 0.0, 0.0)
    name: str = "chain"

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name.isprintable():
            raise InputError(f"chain: name must be a text, got {_arguments.short(self.name)}")
        joints = tuple(self.joints)
        if not all(isinstance(joint, Joint) for joint in joints):
            raise InputError(f"{self.name}: joints must be joints, got {_arguments.short(joints)}")
        if not 1 <= len(joints) <= MOST_JOINTS:
            raise InputError(
                f"{self.name}: a chain has 1 to {MOST_JOINTS} joints, got {len(joints)}"
            )
        if len({joint.name for joint in joints}) < len(joints):
            names = [joint.name for joint in joints]
            raise InputError(f"{self.name}: joints need different names, got {names}")
        position = _tuple(_arguments.vector(f"{self.name}: position", self.position))
        rotation = _unit_quaternion(f"{self.name}: rotation", self.rotation)
        object.__setattr__(self, "joints", joints)
        object.__setattr__(self, "position", position)
        object.__setattr__(self, "rotation", rotation)

    def __repr__(self) -> str:
        return f"Chain({self.name!r}, {self.size} joints: {', '.join(self.joint_names)})"

    # ---------------------------------------------------------------- what it is

    @property
    def size(self) -> int:
        """Number of joints, n."""
        return len(self.joints)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Of the joints, in their order."""
        return tuple(joint.name for joint in self.joints)

    @property
    def units(self) -> tuple[str, ...]:
        """Of the joints' positions: rad, m."""
        return tuple(joint.unit for joint in self.joints)

    @property
    def lower(self) -> Floats:
        """Least positions of the joints, shape (n,) (rad, m); infinite where there are none."""
        return np.array([joint.lower for joint in self.joints])

    @property
    def upper(self) -> Floats:
        """Largest positions of the joints, as :attr:`lower`."""
        return np.array([joint.upper for joint in self.joints])

    @property
    def velocity_limits(self) -> Floats:
        """Largest speeds of the joints, shape (n,) (rad/s, m/s); infinite where unknown."""
        return np.array([joint.velocity for joint in self.joints])

    @property
    def acceleration_limits(self) -> Floats:
        """Largest accelerations of the joints, as :attr:`velocity_limits` (rad/s^2, m/s^2)."""
        return np.array([joint.acceleration for joint in self.joints])

    # ---------------------------------------------------------------- expressions

    def pose(self, q: Expression) -> tuple[Expression, Expression]:
        """Where the tool is, as expressions.

        Parameters
        ----------
        q : expression, shape (n,)
            Positions of the joints (rad, m).

        Returns
        -------
        position : expression, shape (3,)
            Of the tool's frame, in the world (m).
        quaternion : expression, shape (4,)
            ``(qw, qx, qy, qz)``, of length 1; continuous in q, so that its sign tells full turns.
        """
        links, last = _links(self)
        turns = _turns(links, q)
        quaternion: Any = [1.0, 0.0, 0.0, 0.0]
        for link, turn in zip(links, turns, strict=True):
            if link.rotation is not None:
                quaternion = quaternion_product(quaternion, link.rotation)
            if link.hinge:
                by: list[Any] = [turn.cosine, 0.0, 0.0, 0.0]
                by[1 + link.axis] = turn.sine
                quaternion = quaternion_product(quaternion, by)
        if last.rotation is not None:
            quaternion = quaternion_product(quaternion, last.rotation)
        position = _levers(links, last, turns)[0]
        return ca.vertcat(*position), quaternion

    def jacobian(self, q: Expression) -> Expression:
        """Return J with ``(v, w) = J dq/dt``: the tool's twist in the world, shape (6, n).

        Column i is ``(a x (p - o), a)`` of a hinge and ``(a, 0)`` of a slide, a being its axis and
        o a point of it: the geometric Jacobian, in half of the operations that a derivative of
        :meth:`pose` takes.
        """
        links, last = _links(self)
        turns = _turns(links, q)
        levers = _levers(links, last, turns)
        frame: list[list[Any]] = np.eye(3).tolist()
        columns = []
        for link, turn, lever in zip(links, turns, levers[1:], strict=True):
            if link.rotation is not None:
                frame = [_combined(frame, column) for column in _matrix(link.rotation)]
            k, i, j = link.axis, (link.axis + 1) % 3, (link.axis + 2) % 3
            axis = [link.sign * each for each in frame[k]]
            if link.hinge:
                across: list[Any] = [0.0, 0.0, 0.0]
                across[i], across[j] = -link.sign * lever[j], link.sign * lever[i]
                columns.append(ca.vertcat(*_combined(frame, across), *axis))
                c, s = turn.double
                frame[i], frame[j] = (
                    [c * x + s * y for x, y in zip(frame[i], frame[j], strict=True)],
                    [c * y - s * x for x, y in zip(frame[i], frame[j], strict=True)],
                )
            else:
                columns.append(ca.vertcat(*axis, 0.0, 0.0, 0.0))
        return ca.horzcat(*columns)

    # ---------------------------------------------------------------- numbers

    def forward(self, joint_positions: ArrayLike) -> tuple[Floats, Rotation]:
        """Forward kinematics of the tool's frame.

        Parameters
        ----------
        joint_positions : array, shape (n,) or (N, n)
            Radians and meters.

        Returns
        -------
        positions : array, shape (3,) or (N, 3)
            Meters, world frame.
        rotations : Rotation
            Tool to world; one, or N.

        Raises
        ------
        InputError
            If the number of joints is another one, or a number is not finite.
        """
        q = self._rows("joint positions", joint_positions)
        positions, quaternions, _ = self._evaluated(np.atleast_2d(q))
        rotations = Rotation.from_quat(quaternions, scalar_first=True)
        return (positions, rotations) if q.ndim == 2 else (positions[0], rotations[0])

    def poses(
        self,
        times: ArrayLike,
        values: ArrayLike,
        velocities: ArrayLike | None = None,
        *,
        name: str | None = None,
    ) -> PoseTrajectory:
        """Return the tool's motion from that of the joints.

        Parameters
        ----------
        times : array, shape (N,)
            Seconds, strictly increasing.
        values : array, shape (N, n)
            Positions of the joints (rad, m).
        velocities : array, shape (N, n), optional
            Of the joints (rad/s, m/s); by default the tool's twists are estimated from its poses.
        name : str, optional
            By default the chain's.

        Raises
        ------
        InputError
            If shapes disagree, a number is not finite, or the times do not increase.
        """
        q = self._rows("joint positions", values)
        positions, quaternions, jacobians = self._evaluated(np.atleast_2d(q))
        linear = angular = None
        if velocities is not None:
            rates = np.atleast_2d(self._rows("joint velocities", velocities))
            if rates.shape != np.atleast_2d(q).shape:
                raise InputError(
                    f"{self.name}: {len(np.atleast_2d(q))} joint positions but {len(rates)} "
                    "velocities"
                )
            found = np.einsum("kij,kj->ki", jacobians, rates)
            linear, angular = found[:, :3], found[:, 3:]
        return PoseTrajectory(
            times,
            positions,
            Rotation.from_quat(quaternions, scalar_first=True),
            linear,
            angular,
            name=self.name if name is None else name,
        )

    def inverse(self, motion: PoseTrajectory, near: ArrayLike) -> Floats:
        """Inverse kinematics: joints whose tool moves as given, to rounding.

        Bounds of the joints take no part.

        Parameters
        ----------
        motion : PoseTrajectory
            Of the tool, in the world.
        near : array, shape (n,) or (N, n)
            A posture near the first sample, each sample's joints being nearest to those before; or
            one a sample, to which they are nearest (rad, m).

        Returns
        -------
        array, shape (N, n)

        Raises
        ------
        InputError
            If the search ends away from a pose; the message names the first and the distance.
        """
        given = self._rows("near", near)
        count = len(motion)
        if given.ndim == 2 and len(given) != count:
            raise InputError(
                f"{self.name}: near has {len(given)} rows for {count} samples of {motion.name}"
            )
        positions, quaternions = motion.positions, motion.quaternions
        if given.ndim == 2:
            found, missed = self._reached(given, positions, quaternions)
        else:
            found, missed = np.empty((count, self.size)), np.empty(count)
            for k in range(count):
                at = slice(k, k + 1)
                before = found[k - 1 : k] if k else given[None]
                found[at], missed[at] = self._reached(before, positions[at], quaternions[at])
        if not np.all(missed <= REACHED):
            k = int(np.argmax(~(missed <= REACHED)))
            raise InputError(
                f"{self.name}: no joints were found for the tool of {motion.name} at "
                f"{motion.times[k]:g} s (sample {k}): {missed[k]:.3g} (m, rad) are left; give "
                "joints nearer to it, or a motion within reach"
            )
        return found

    def _reached(
        self, near: Floats, positions: Floats, quaternions: Floats
    ) -> tuple[Floats, Floats]:
        """Joints nearest to others whose tool is at poses, (N, n), and what is left of each, (N,).

        Newton's steps towards the pose, and back to what they are to be near across these.
        """
        q, missed = near, np.full(len(near), np.inf)
        for _ in range(MOST_STEPS):
            there, turned, J = self._evaluated(q)
            error = np.hstack([positions - there, turns_between(turned, quaternions)])
            missed = np.abs(error).max(axis=1)
            inverse = np.linalg.pinv(J, rcond=SINGULAR)
            back = near - q
            across = back - np.einsum("kij,kj->ki", inverse, np.einsum("kij,kj->ki", J, back))
            step = np.einsum("kij,kj->ki", inverse, error) + across
            largest = np.abs(step).max(axis=1, keepdims=True)
            if largest.max() <= SETTLED and missed.max() <= REACHED:
                break
            q = q + step * np.minimum(1.0, LARGEST_STEP / np.maximum(largest, LARGEST_STEP))
        return q, missed

    def _rows(self, what: str, values: ArrayLike) -> Floats:
        q = _arguments.numbers(f"{self.name}: {what}", values)
        if q.ndim not in (1, 2) or q.shape[-1] != self.size or not np.all(np.isfinite(q)):
            raise InputError(
                f"{self.name}: {what} must be {self.size} finite numbers a row, got shape {q.shape}"
            )
        return q

    def _evaluated(self, q: Floats) -> tuple[Floats, Floats, Floats]:
        """Positions (N, 3), quaternions (N, 4) and Jacobians (N, 6, n) at joint positions."""
        found = [np.ascontiguousarray(np.array(each).T) for each in kinematics(self)(q.T)]
        jacobians = found[2].reshape(len(q), self.size, 6).swapaxes(1, 2)
        return found[0], found[1], jacobians

    # ---------------------------------------------------------------- new ones from it

    def held(self, values: Mapping[str, float]) -> Chain:
        """Return the chain of all other joints: these are held at positions (rad, m).

        Raises
        ------
        InputError
            If there is no such joint, or no other.
        """
        unknown = set(values) - set(self.joint_names)
        if unknown:
            raise InputError(
                f"{self.name}: no joint is called {sorted(unknown)[0]!r}; "
                f"there are {', '.join(self.joint_names)}"
            )
        left, at = [], Offset()
        for joint in self.joints:
            at = at.then(joint.position, joint.rotation)
            if joint.name not in values:
                left.append(replace(joint, position=at.position, rotation=at.quaternion))
                at = Offset()
                continue
            moved = _arguments.finite(f"{self.name}: {joint.name}", values[joint.name]) - joint.zero
            step = moved * np.array(joint.axis)
            if joint.kind == "slide":
                at = at.then(step)
            else:
                at = at.then(np.zeros(3), _quaternion(Rotation.from_rotvec(step)))
        at = at.then(self.position, self.rotation)
        return Chain(tuple(left), _tuple(at.position), at.quaternion, self.name)

    # ---------------------------------------------------------------- plain data

    def as_data(self) -> dict[str, Any]:
        """Return plain data for JSON, from which :meth:`from_data` makes an equal chain."""
        return {
            "name": self.name,
            "joints": [
                {f.name: _plain(getattr(joint, f.name)) for f in fields(joint)}
                for joint in self.joints
            ],
            "position": list(self.position),
            "rotation": list(self.rotation),
        }

    @classmethod
    def from_data(cls, data: Any) -> Chain:
        """Make a chain from plain data.

        Raises
        ------
        InputError
            If it is not what :meth:`as_data` returns.
        """
        try:
            joints = [
                Joint(**{key: value for key, value in joint.items() if value is not None})
                for joint in data["joints"]
            ]
            return cls(tuple(joints), data["position"], data["rotation"], data["name"])
        except KeyError as error:
            raise InputError(f"chain: {error} is missing") from None
        except (TypeError, AttributeError) as error:
            raise InputError(f"chain: not what a chain is made of: {error}") from None


@lru_cache(maxsize=64)
def kinematics(chain: Chain) -> ca.Function:
    """Return ``q -> (position, quaternion, Jacobian)`` of a chain: (n,) -> (3,), (4,), (6, n)."""
    q = ca.SX.sym("q", chain.size)
    found = [*chain.pose(q), chain.jacobian(q)]
    return ca.Function("kinematics", [q], [ca.densify(each) for each in ca.cse(found)])


# -------------------------------------------------------------------- shortest expressions


@dataclass(frozen=True)
class _Link:
    """A fixed pose and a joint about or along a coordinate axis, which the fixed pose leads to.

    Attributes
    ----------
    position : tuple of 3 float
    rotation : tuple of 4 float or None
        None is no rotation.
    axis, sign : int
        Index of the coordinate axis, and 1 or -1.
    hinge : bool
    zero : float
    """

    position: tuple[float, ...]
    rotation: tuple[float, ...] | None
    axis: int = 0
    sign: int = 1
    hinge: bool = False
    zero: float = 0.0


@dataclass(frozen=True)
class _Turn:
    """How far a joint has moved: sine and cosine of a hinge's half angle, or a slide's way."""

    sine: Expression
    cosine: Expression

    @property
    def double(self) -> tuple[Expression, Expression]:
        """Cosine and sine of the whole angle."""
        twice = 2 * self.sine
        return 1 - twice * self.sine, twice * self.cosine


@lru_cache(maxsize=64)
def _links(chain: Chain) -> tuple[tuple[_Link, ...], _Link]:
    """Return joints about coordinate axes, and the tool at the last: few operations each.

    A joint's frame may be any whose axis it is.  Each is chosen parallel to the one before where
    that has a coordinate axis along the joint's, and its origin such that the way to it has no part
    along the axis: of arms as they are built, little but zeros is left.
    """
    links, left = [], Offset()
    for joint in chain.joints:
        at = left.then(joint.position, joint.rotation)
        axis = _rounded(at.rotation.apply(joint.axis))
        k = int(np.argmax(np.abs(axis)))
        sign = 1 if axis[k] > 0 else -1
        coordinate = sign * np.eye(3)[k]
        turn = Rotation.identity()
        if np.count_nonzero(axis) > 1:
            # The shortest turn; at most 55 degrees, so that 1 + cos is far from 0.
            between = np.concatenate([[1 + abs(axis[k])], np.cross(coordinate, axis)])
            turn = Rotation.from_quat(between, scalar_first=True)
        hinge = joint.kind == "hinge"
        # What the joint leaves as it is comes after it: of a slide all, of a hinge what is along.
        after = at.position if not hinge else (at.position @ axis) * axis
        before = _rounded(at.position - after)
        fixed = None if np.count_nonzero(axis) == 1 else _tuple(_rounded(_quaternion(turn)))
        links.append(_Link(_tuple(before), fixed, k, sign, hinge, joint.zero))
        left = Offset(turn.inv().apply(after), turn.inv() * at.rotation)
    at = left.then(chain.position, chain.rotation)
    quaternion = _rounded(at.quaternion)
    turned = np.count_nonzero(quaternion) > 1 or quaternion[0] == 0
    fixed = _tuple(quaternion) if turned else None
    return tuple(links), _Link(_tuple(_rounded(at.position)), fixed)


def _turns(links: Sequence[_Link], q: Expression) -> list[_Turn]:
    turns = []
    for k, link in enumerate(links):
        moved = q[k] - link.zero if link.zero else q[k]
        if link.hinge:
            half = link.sign * 0.5 * moved
            turns.append(_Turn(ca.sin(half), ca.cos(half)))
        else:
            turns.append(_Turn(link.sign * moved, 1.0))
    return turns


def _levers(links: Sequence[_Link], last: _Link, turns: Sequence[_Turn]) -> list[list[Any]]:
    """From origins to the tool: of the world, in its frame; of each joint, in its unmoved frame."""
    lever: list[Any] = list(last.position)
    found = []
    for link, turn in zip(reversed(links), reversed(turns), strict=True):
        k, i, j = link.axis, (link.axis + 1) % 3, (link.axis + 2) % 3
        lever = list(lever)
        if link.hinge:
            c, s = turn.double
            lever[i], lever[j] = c * lever[i] - s * lever[j], s * lever[i] + c * lever[j]
        else:
            lever[k] = lever[k] + turn.sine
        found.append(lever)
        if link.rotation is not None:
            lever = _combined(_matrix(link.rotation), lever)
        lever = [x + y for x, y in zip(link.position, lever, strict=True)]
    return [lever, *reversed(found)]


def _combined(columns: Sequence[Sequence[Any]], weights: Sequence[Any]) -> list[Any]:
    """Sum of weighted columns."""
    return [
        sum((weight * column[row] for column, weight in zip(columns, weights, strict=True)), 0.0)
        for row in range(3)
    ]


def _matrix(quaternion: Numbers) -> list[list[float]]:
    """Columns of a rotation."""
    matrix = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
    return [_rounded(column).tolist() for column in matrix.T]


def _rounded(values: ArrayLike) -> Floats:
    array = np.asarray(values, dtype=np.float64)
    return np.where(np.abs(array) < ROUNDING, 0.0, array)


def _quaternion(rotation: Rotation) -> tuple[float, ...]:
    return _tuple(rotation.as_quat(scalar_first=True))


def _unit_quaternion(name: str, value: Any) -> tuple[float, ...]:
    numbers = _arguments.numbers(name, value)
    norm = float(np.linalg.norm(numbers))
    if numbers.shape != (4,) or not abs(norm - 1) <= MAX_NORM_ERROR:
        raise InputError(
            f"{name} must be 4 numbers (qw, qx, qy, qz) of norm 1, got {_arguments.short(value)}"
        )
    return _of_length_1(numbers)


def _of_length_1(vector: Floats) -> tuple[float, ...]:
    if abs(float(vector @ vector) - 1) < _SAME_LENGTH:
        # To the bit, so that data read back are equal.
        return _tuple(vector)
    # Divided by its largest component first: squares of tiny numbers would vanish.
    vector = vector / np.abs(vector).max()
    return _tuple(vector / np.linalg.norm(vector))


def _tuple(values: ArrayLike) -> tuple[float, ...]:
    # Not -0.
    return tuple((np.asarray(values, dtype=np.float64) + 0.0).tolist())


def _plain(value: Any) -> Any:
    """A field of a joint for JSON, which has no infinite numbers: None for these."""
    if isinstance(value, tuple):
        return list(value)
    return None if isinstance(value, float) and np.isinf(value) else value
