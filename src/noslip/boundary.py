"""What a motion must reach at its start, at its goal or on the way: one form from end to end."""

from __future__ import annotations

import copy
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from noslip import _arguments
from noslip._typing import Floats
from noslip._values import Value
from noslip.errors import InputError
from noslip.space import POSE, Samples, Space
from noslip.trajectory import PoseTrajectory

End = Literal["free", "position", "rotation", "pose"]
"""What of a pose is kept to."""
Point = ArrayLike | tuple[ArrayLike, Rotation] | Mapping[str, tuple[ArrayLike, Rotation]]
"""A place of whatever moves: coordinates, a pose, or poses of bodies by name."""


@dataclass(frozen=True, eq=False)
class Boundary(Value):
    """A pose, a twist or part of them that must be reached; what is None is free.

    Compares by value.

    Parameters
    ----------
    at : float
        When, as a fraction of the duration: at 0 the start, at 1 the goal, between them a via.
    position : array, shape (n,), optional
        Meters, world frame; or coordinates of whatever else moves.
    rotation : Rotation, optional
        Body to world; of several bodies, as many.
    linear_velocity : array, shape (n,), optional
        m/s, world frame; or rates of the coordinates.
    angular_velocity : array, shape (3 b,), optional
        rad/s, world frame, of the b rotations.

    Raises
    ------
    InputError
        If a value is not what it must be.
    """

    at: float
    position: Floats | None = None
    rotation: Rotation | None = None
    linear_velocity: Floats | None = None
    angular_velocity: Floats | None = None

    if TYPE_CHECKING:
        # Given as anything like an array, kept as arrays.
        def __init__(
            self,
            at: float,
            position: ArrayLike | None = None,
            rotation: Rotation | None = None,
            linear_velocity: ArrayLike | None = None,
            angular_velocity: ArrayLike | None = None,
        ) -> None: ...

    def __post_init__(self) -> None:
        at = _arguments.finite("boundary at", self.at)
        if not 0 <= at <= 1:
            raise InputError(
                f"boundary at must be a fraction of the motion from 0 to 1, got {at:g}"
            )
        object.__setattr__(self, "at", at)
        for name, unit in (
            ("position", "m"),
            ("linear_velocity", "m/s"),
            ("angular_velocity", "rad/s"),
        ):
            value = getattr(self, name)
            if value is not None:
                words = f"boundary {name.replace('_', ' ')}"
                array = _arguments.coordinates(words, value, unit)
                array.flags.writeable = False
                object.__setattr__(self, name, array)
        if self.rotation is not None:
            # Rotations can be assigned to by index; what the caller does to theirs stays theirs.
            given = self.rotation
            if not isinstance(given, Rotation) or given.single:
                _arguments.rotation("boundary rotation", given)
            object.__setattr__(self, "rotation", copy.deepcopy(given))

    # ---------------------------------------------------------------- made from

    @classmethod
    def keeping(cls, trajectory: Samples, at: float, what: End) -> Boundary:
        """Return what a trajectory has at a fraction of its samples.

        Parameters
        ----------
        trajectory : PoseTrajectory or Trajectory
        at : float
            Of the sample nearest to that fraction.
        what : "free", "position", "rotation" or "pose"
        """
        k = sample_of(at, len(trajectory))
        if isinstance(trajectory, PoseTrajectory):
            rotation = trajectory.rotations[k]
        else:
            rotation = rotations_of(trajectory.quaternions[k])
        return cls(at, trajectory.positions[k], rotation).part(what)

    @classmethod
    def via(cls, given: Boundary | Sequence[Any]) -> Boundary:
        """Return what is passed on the way, from ``(at, position[, rotation])`` or as it is.

        Raises
        ------
        InputError
            If it is none of these, names nothing, or is not between the ends.
        """
        if not isinstance(given, Boundary):
            try:
                at, position, *rotation = given
            except (TypeError, ValueError):
                raise InputError(_NO_VIA + _arguments.short(given)) from None
            if len(rotation) > 1:
                raise InputError(_NO_VIA + _arguments.short(given))
            _require_between(_arguments.finite("via at", at))
            given = cls(at, position, *rotation)
        _require_between(given.at)
        if given.is_free:
            raise InputError(f"via at {given.at:g} names neither a position nor a rotation")
        return given

    @classmethod
    def vias(
        cls, given: Iterable[Boundary | Sequence[Any]], space: Space = POSE
    ) -> tuple[Boundary, ...]:
        """Return each of several as :meth:`via` does, in order; points of a space."""
        try:
            several = list(given)
        except TypeError:
            raise InputError(_NO_VIA + _arguments.short(given)) from None
        vias = sorted((cls.via(v) for v in several), key=lambda passed: passed.at)
        for passed in vias:
            passed.require_of(space)
        return tuple(vias)

    def part(self, what: End) -> Boundary:
        """Return it with only a part of its pose; its twist stays."""
        if what not in get_args(End):
            name = {0.0: "start", 1.0: "end"}.get(self.at, f"what is kept at {self.at:g}")
            raise InputError(f"{name} must be free, position, rotation or pose; got {what!r}")
        return replace(
            self,
            position=self.position if what in ("position", "pose") else None,
            rotation=self.rotation if what in ("rotation", "pose") else None,
        )

    def pose_or(self, position: Floats, rotation: Rotation) -> tuple[Floats, Rotation]:
        """Return its position and rotation; the given ones where they are free."""
        return (
            position if self.position is None else self.position,
            rotation if self.rotation is None else self.rotation,
        )

    def twist_or(self, linear: Floats, angular: Floats) -> tuple[Floats, Floats]:
        """Return its linear and angular velocity; the given ones where they are free."""
        return (
            linear if self.linear_velocity is None else self.linear_velocity,
            angular if self.angular_velocity is None else self.angular_velocity,
        )

    # ---------------------------------------------------------------- what it is

    @property
    def quaternion(self) -> Floats | None:
        """The rotation as numbers (w first), shape (4 b,)."""
        return None if self.rotation is None else np.ravel(self.rotation.as_quat(scalar_first=True))

    def require_of(self, space: Space) -> None:
        """Refuse what is of another size than the points of a space."""
        n, b = space.linear, space.rotations
        for name, size in (
            ("position", n),
            ("linear_velocity", n),
            ("quaternion", 4 * b),
            ("angular_velocity", 3 * b),
        ):
            value = getattr(self, name)
            if value is not None and len(value) != size:
                words = name.replace("_", " ")
                raise InputError(
                    f"boundary at {self.at:g}: its {words} has {len(value)} numbers, but what "
                    f"moves has {size or 'none'}"
                )

    @property
    def is_free(self) -> bool:
        """Whether nothing must be reached."""
        return self.position is None and self.rotation is None and not self.has_twist

    @property
    def is_pose(self) -> bool:
        """Whether both position and rotation must be reached."""
        return self.position is not None and self.rotation is not None

    def is_whole(self, space: Space) -> bool:
        """Whether a whole point of a space must be reached."""
        return self.position is not None and (self.rotation is not None or not space.rotations)

    @property
    def moves(self) -> bool:
        """Whether a velocity must be reached that is not rest."""
        velocities = self.linear_velocity, self.angular_velocity
        return any(velocity is not None and velocity.any() for velocity in velocities)

    @property
    def has_twist(self) -> bool:
        """Whether a linear or an angular velocity must be reached."""
        return self.linear_velocity is not None or self.angular_velocity is not None


_NO_VIA = "via is a list of (at, position), (at, position, rotation) or Boundary; got "
"""Said of each form that is none of these, and of what is no list."""


def sample_of(at: float, count: int) -> int:
    """Return the sample nearest to a fraction of a motion of ``count`` samples."""
    return round(at * (count - 1))


def rotations_of(quaternion: Floats) -> Rotation | None:
    """Return rotations of quaternions (w first), shape (4 b,); None if there are none."""
    if not len(quaternion):
        return None
    several = quaternion if len(quaternion) == 4 else quaternion.reshape(-1, 4)
    return Rotation.from_quat(several, scalar_first=True)


def end_twist(trajectory: Samples, at: float) -> tuple[Floats, Floats]:
    """Return linear (m/s) and angular velocity (rad/s) with which samples start or end.

    Parameters
    ----------
    trajectory : PoseTrajectory or Trajectory
        Of equal steps.
    at : 0 or 1
    """
    found = []
    for steps in trajectory.step_velocities():
        near = (steps if at == 0 else steps[::-1])[:3]
        # Those of steps belong to their middles: a parabola through them.
        found.append(np.asarray(_TO_THE_END[len(near)] @ near))
    return found[0], found[1]


def kept_twist(trajectory: Samples, at: float) -> tuple[Floats, Floats]:
    """Return :func:`end_twist`, where what rests but for rounding is at rest."""
    linear, angular = (
        velocity if np.linalg.norm(velocity) > _AT_REST * speeds.max() else np.zeros_like(velocity)
        for velocity, speeds in zip(
            end_twist(trajectory, at),
            (np.linalg.norm(steps, axis=1) for steps in trajectory.step_velocities()),
            strict=True,
        )
    )
    return linear, angular


_AT_REST = 1e-3
"""Of the peak: a fit leaves a hundredth of that of a motion at rest, and nobody sees it move."""
_TO_THE_END = {1: np.ones(1), 2: np.array([3, -1]) / 2, 3: np.array([15, -10, 3]) / 8}
"""Weights of the nearest steps in the velocity at an end, by how many there are."""


def twist(name: str, value: ArrayLike, space: Space = POSE) -> tuple[Floats, Floats | None]:
    """Return linear (m/s) and angular velocity (rad/s) from the forms that a caller may give.

    Parameters
    ----------
    name : str
        Of the argument, for the error.
    value : 0, array of shape (n,) or (n + 3 b,)
        At rest; a linear velocity without turning; linear, then angular velocity.
    space : Space
        What moves.
    """
    n, whole = space.linear, space.velocity_size
    try:
        values = np.ravel(_arguments.numbers(name, value))
    except InputError:
        values = np.empty(0)
    if values.shape == (1,) and values[0] == 0:
        values = np.zeros(n)
    if values.shape not in ((n,), (whole,)) or not np.isfinite(values).all():
        more = f", or {whole} with the angular velocity (rad/s)" if whole > n else ""
        unit = f" ({space.units[0]}/s)" if len(set(space.units)) == 1 else ""
        raise InputError(f"{name} must be 0, {n} finite numbers{unit}{more}")
    if not space.rotations:
        return values, None
    return values[:n], np.zeros(space.angular) if len(values) == n else values[n:]


def _require_between(at: float) -> None:
    if not 0 < _arguments.finite("via at", at) < 1:
        raise InputError(f"via at must be a fraction of the motion with 0 < at < 1, got {at:g}")
