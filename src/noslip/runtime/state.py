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
            kept = state.__dict__[self._kept] = Rotation.from_quat(kept, scalar_first=True)
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
        From 1 down to ``exp(-alpha_s)`` at the end.
    position : array, shape (3,)
        Meters.
    rotation : Rotation
        Or a unit quaternion (qw, qx, qy, qz) where one is made; also ``goal_rotation``.
    linear_velocity, angular_velocity : array, shape (3,)
        Of the step that led here (at the start: of that instant); m/s and rad/s, world frame.
    previous_step : float
        Length of that step (s); 0 at the start.
    duration : float
        tau (s).
    goal_position : array, shape (3,)
    goal_rotation : Rotation
    first_goal_position, first_goal_rotation : array, shape (3,), and Rotation
        From where the goal moves, see :mod:`noslip.law.entry`; the goal itself in the paper's form.
    pull_in : float
        Rate at which a violation decays (1/s).
    braking : float
        Seconds within which a motion that ends at speed comes to rest after its end; 0 is at once.
    constraint_residuals, multipliers : array, shape (m,)
        Of the equalities.
    margins, limit_multipliers : array, shape (k,)
        Of the limits.
    acceleration : array, shape (6,)
        Of that step: linear (m/s^2), then angular (rad/s^2), world frame.
    constraint_forces : array, shape (6,)
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
    pull_in: float = 0.0
    braking: float = 0.0
    constraint_residuals: Floats = field(default_factory=lambda: np.zeros(0))
    multipliers: Floats = field(default_factory=lambda: np.zeros(0))
    margins: Floats = field(default_factory=lambda: np.zeros(0))
    limit_multipliers: Floats = field(default_factory=lambda: np.zeros(0))
    acceleration: Floats = field(default_factory=lambda: np.zeros(6))
    constraint_forces: Floats = field(default_factory=lambda: np.zeros(6))
    done: bool = False

    @property
    def quaternion(self) -> Floats:
        """Of the rotation: (qw, qx, qy, qz)."""
        kept = self.__dict__["_rotation"]
        if isinstance(kept, np.ndarray):
            return kept
        return np.asarray(kept.as_quat()[[3, 0, 1, 2]])

    def vector(self) -> Floats:
        """Pose and velocities, as :data:`noslip.law.layout.STATE` says."""
        return np.concatenate(
            [self.position, self.quaternion, self.linear_velocity, self.angular_velocity]
        )

    def carried(self, system: ConstraintSystem) -> Floats:
        """What a step carries, see :func:`noslip.law.layout.carried_layout`."""
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
