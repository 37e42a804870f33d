"""The state of a primitive in motion."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from noslip import _arguments
from noslip._typing import Floats
from noslip._values import Value
from noslip.constraints.system import ConstraintSystem
from noslip.errors import InputError
from noslip.law.points import rotation_of


class _Turn:
    """Field of a rotation that is made from a quaternion only when it is asked for.

    A control loop seldom asks, and making one takes longer than the step.
    """

    def __set_name__(self, owner: type, name: str) -> None:
        self._kept = f"_{name}"

    def __get__(self, state: Any, owner: type | None = None) -> Rotation:
        if state is None:
            # So that dataclasses take it for a field without default.
            raise AttributeError
        kept = state.__dict__[self._kept]
        if isinstance(kept, np.ndarray):
            kept = state.__dict__[self._kept] = rotation_of(kept)
        return kept

    def __set__(self, state: Any, value: Rotation | Floats) -> None:
        state.__dict__[self._kept] = value


@dataclass(frozen=True, eq=False, kw_only=True)
class State(Value):
    """Everything that a primitive in motion knows; immutable, each step gives a new one.

    Attributes
    ----------
    time : float
        Since the start (s).
    phase : float
        From 1 down to ``exp(-alpha_s)`` at the end; of a rhythm, from 0 to 1 in each period.
    position : array, shape (n,)
        Meters; 3 of a pose, else the coordinates in their own units.
    rotation : Rotation
        Or unit quaternions (qw, qx, qy, qz), shape (4 b,), where one is made; also
        ``goal_rotation``.  The identity where nothing turns.
    linear_velocity, angular_velocity : array, shape (n,) and (3 b,)
        Of the step that led here (at the start: of that instant); m/s and rad/s, world frame.
    previous_step : float
        Length of that step (s); 0 at the start.
    duration : float
        tau (s).
    goal_position : array, shape (n,)
    goal_rotation : Rotation
    first_goal_position, first_goal_rotation : array, shape (n,), and Rotation
        From where the goal moves, see :mod:`noslip.law.entry`; the goal itself in the paper's form.
    amplitude : float
        Factor on the learned force: on the size of a rhythm.
    pull_in : float
        Rate at which a violation decays (1/s).
    braking : float
        Seconds within which a motion that ends at speed comes to rest after its end; 0 is at once.
    constraint_residuals, multipliers : array, shape (m,)
        Of the equalities.
    margins, limit_multipliers : array, shape (k,)
        Of the limits.
    acceleration : array, shape (n + 3 b,)
        Of that step: linear (m/s^2), then angular (rad/s^2), world frame.
    constraint_forces : array, shape (n + 3 b,)
        What the constraints added to it.
    done : bool
        Whether the motion has come to its end.
    """

    time: float
    phase: float
    position: Floats
    rotation: _Turn = _Turn()
    linear_velocity: Floats
    angular_velocity: Floats
    previous_step: float
    duration: float
    goal_position: Floats
    goal_rotation: _Turn = _Turn()
    first_goal_position: Floats
    first_goal_rotation: _Turn = _Turn()
    amplitude: float = 1.0
    pull_in: float = 0.0
    braking: float = 0.0
    constraint_residuals: Floats = field(default_factory=lambda: np.zeros(0))
    multipliers: Floats = field(default_factory=lambda: np.zeros(0))
    margins: Floats = field(default_factory=lambda: np.zeros(0))
    limit_multipliers: Floats = field(default_factory=lambda: np.zeros(0))
    acceleration: Floats = None  # type: ignore[assignment]
    constraint_forces: Floats = None  # type: ignore[assignment]
    done: bool = False

    def __post_init__(self) -> None:
        for name in ("acceleration", "constraint_forces"):
            if getattr(self, name) is None:
                still = np.zeros(len(self.linear_velocity) + len(self.angular_velocity))
                object.__setattr__(self, name, still)

    @property
    def quaternion(self) -> Floats:
        """Of the rotation: (qw, qx, qy, qz), shape (4 b,)."""
        return self._quaternions("_rotation")

    @property
    def goal_quaternion(self) -> Floats:
        """The same of the goal."""
        return self._quaternions("_goal_rotation")

    @property
    def first_goal_quaternion(self) -> Floats:
        """The same of where the goal moves from."""
        return self._quaternions("_first_goal_rotation")

    def _quaternions(self, name: str) -> Floats:
        kept = self.__dict__[name]
        if isinstance(kept, np.ndarray):
            return kept
        if not len(self.angular_velocity):
            return np.zeros(0)
        return np.ravel(kept.as_quat(scalar_first=True))

    @property
    def values(self) -> Floats:
        """The coordinates: the position under the name that joints have it by."""
        return self.position

    @property
    def velocity(self) -> Floats:
        """Linear, then angular velocity at this instant, shape (n + 3 b,).

        That of the step that led here, whose middle it belongs to, and what half a step adds.
        """
        led_here = np.concatenate([self.linear_velocity, self.angular_velocity])
        return led_here + self.acceleration * self.previous_step / 2

    def vector(self) -> Floats:
        """Point and velocity, as the state of :class:`noslip.law.layout.Layouts` says."""
        return np.concatenate(
            [self.position, self.quaternion, self.linear_velocity, self.angular_velocity]
        )

    def carried(self, system: ConstraintSystem) -> Floats:
        """What a step carries, see :meth:`noslip.law.layout.Layouts.carried`."""
        parts = [self.vector()]
        for part, given in (
            (system.equalities, self.constraint_residuals),
            (system.limits, self.margins),
        ):
            # A state made by hand may come without.
            parts.append(given if given.size == part.size else np.zeros(part.size))
        return np.concatenate(parts)


def write_pose(name: str, given: Any, into: Floats) -> None:
    """Write a State, or a pair (position, Rotation), to a row of 7: x, y, z, qw, qx, qy, qz.

    For loops: whether its numbers are finite is not looked at.

    Raises
    ------
    InputError
        If it is neither.
    """
    if isinstance(given, State):
        place, (w, i, j, k) = given.position, given.quaternion.tolist()
    elif isinstance(given, tuple) and len(given) == 2:
        position, rotation = given
        if not isinstance(rotation, Rotation):
            raise InputError(f"{name}: a Rotation stands second, got {type(rotation).__name__}")
        if not rotation.single:
            raise InputError(f"{name}: one rotation stands second, got {len(rotation)}")
        try:
            place = np.asarray(position, dtype=np.float64)
        except (TypeError, ValueError):
            raise InputError(
                f"{name}: a position is 3 numbers, got {_arguments.short(position)}"
            ) from None
        if place.shape != (3,):
            raise InputError(f"{name}: a position has shape (3,), got {place.shape}")
        i, j, k, w = rotation.as_quat().tolist()
    else:
        raise InputError(
            f"{name} must be a State or a pair (position, Rotation), got {type(given).__name__}"
        )
    into[0], into[1], into[2] = place.tolist()
    into[3], into[4], into[5], into[6] = w, i, j, k
