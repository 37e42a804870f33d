"""Any constraint relative to a frame that moves: tissue that breathes, a conveyor, a table."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

from noslip import _arguments
from noslip._typing import Expression
from noslip.constraints.blade import Blade
from noslip.constraints.catalog import resolved
from noslip.constraints.declaration import Constraint, of_a_user, register
from noslip.constraints.expression import Instructions
from noslip.constraints.fields import ORIGIN, Triple, number, point, settle
from noslip.constraints.instant import Instant
from noslip.errors import ConstraintError
from noslip.rotations import quaternion_exp, rotation_matrix

NAME = "in-moving-frame"
_INHERITED = (
    *("level", "relation", "edge", "unit", "barrier_rate", "priority", "radii", "body"),
    "row_names",
)
_LISTS = (list, tuple, np.ndarray)


@register
@dataclass(frozen=True)
class InMovingFrame(Constraint):
    """A constraint on the motion as seen from a frame with origin ``c(t)``, rotation ``R_f(t)``.

    The frame sways, by default, and may travel:

        ``c = velocity t + amplitude sin(2 pi t / period + phase)``
        ``R_f = Exp(rotation_amplitude sin(2 pi t / period + phase))``

    and the constraint is asked about the relative motion

        ``p' = R_f^T (p - c)``,    ``v' = R_f^T (v - dc/dt - w_f x (p - c))``
        ``R' = R_f^T R``,          ``w' = R_f^T (w - w_f)``

    A scalpel in tissue that breathes must not slip with respect to the tissue, not to the room.
    Rheonomic.  What the constraint itself calls world (normals, points) is the moving frame.

    Parameters
    ----------
    constraint : Constraint or str
        Equality or inequality; or its name and arguments as on the command line,
        ``"blade(lateral='z')"``, by which it is then saved too.
    amplitude : 3 numbers
        m, world frame.
    period : float
        s.
    phase : float
        rad.
    rotation_amplitude : 3 numbers
        Rotation vector (rad), world frame.
    velocity : 3 numbers
        m/s, world frame.
    frame : callable, optional
        Instead of all these: takes the time (s), a CasADi expression, and returns the origin (3
        expressions), or a tuple of the origin and the rotation matrix (3 x 3).  Rates follow by
        automatic differentiation.
    """

    constraint: Constraint | str = field(default_factory=Blade)
    amplitude: Triple = (0.0, 0.0, 0.005)
    period: float = 4.0
    phase: float = 0.0
    rotation_amplitude: Triple = ORIGIN
    velocity: Triple = ORIGIN
    frame: Callable[[Expression], Any] | None = None

    name = NAME

    def __post_init__(self) -> None:
        settle(
            self,
            NAME,
            amplitude=point,
            period=_period,
            phase=_phase,
            rotation_amplitude=_rotation_vector,
            velocity=_velocity,
        )
        inner = resolved(NAME, self.constraint)
        if inner.level == "acceleration":
            raise ConstraintError(
                f"{NAME}: constraint {inner.name!r} is a limit on accelerations; only those on "
                "poses and velocities can move with a frame"
            )
        object.__setattr__(self, "constraint", inner)
        object.__setattr__(self, "name", f"{inner.name} in moving frame")
        for attribute in _INHERITED:
            object.__setattr__(self, attribute, getattr(inner, attribute))
        if self.frame is not None:
            object.__setattr__(self, "frame", _frame_instructions(self.frame))

    @property
    def inner(self) -> Constraint:
        """What holds in the frame."""
        assert isinstance(self.constraint, Constraint)
        return self.constraint

    def residual(self, motion: Instant) -> Expression:
        """The constraint's own residual on the relative motion, in its unit."""
        return self.inner.residual(self._seen(motion))

    def relative(self, motion: Instant) -> Instant:
        """Motion relative to the frame, and to what moves in it."""
        return self.inner.relative(self._seen(motion))

    def _seen(self, motion: Instant) -> Instant:
        t = ca.SX.sym("t")
        c, R = self.pose(t)
        spin = ca.mtimes(ca.reshape(ca.jacobian(ca.vec(R), t), 3, 3), R.T)
        w = ca.vertcat(spin[2, 1], spin[0, 2], spin[1, 0])
        c, R, c_rate, w = ca.substitute([c, R, ca.jacobian(c, t), w], [t], [motion.time])
        away = motion.position - c
        carried = c_rate + ca.cross(w, away)
        return Instant(
            motion.time,
            ca.mtimes(R.T, away),
            ca.mtimes(R.T, motion.rotation),
            ca.mtimes(R.T, motion.linear_velocity - carried),
            ca.mtimes(R.T, motion.angular_velocity - w),
        )

    def pose(self, time: Expression) -> tuple[Expression, Expression]:
        """Origin (m), 3 x 1, and rotation matrix, frame to world, 3 x 3, at a time (s)."""
        if self.frame is not None:
            column = self.frame(time)
            return column[:3], ca.reshape(column[3:], 3, 3)
        sway = ca.sin(2 * np.pi / self.period * time + self.phase)
        origin = ca.DM(list(self.velocity)) * time + ca.DM(list(self.amplitude)) * sway
        if not any(self.rotation_amplitude):
            return ca.SX(origin), ca.SX.eye(3)
        turn = quaternion_exp(ca.DM(list(self.rotation_amplitude)) * sway)
        return ca.SX(origin), rotation_matrix(turn)


def _frame_instructions(frame: Any) -> Instructions:
    """Origin, then the rotation matrix's columns, of a user's function of time; checked."""
    if isinstance(frame, Instructions):
        return frame
    if not callable(frame):
        raise ConstraintError(f"{NAME}: frame must be a function of time, got {frame!r}")
    t = ca.SX.sym("t")
    takes = "it takes the time and returns 3 expressions, or a tuple of them and a 3 x 3 matrix"
    with of_a_user(f"{NAME}: frame", lambda reason: f"{reason}; {takes}"):
        value = frame(t)
        origin, rotation = value if _is_pair(value) else (value, np.eye(3))
        origin, rotation = ca.SX(_matrix(origin)), ca.SX(_matrix(rotation))
        pose = ca.Function("frame", [t], [origin, rotation])
    if origin.shape != (3, 1) or rotation.shape != (3, 3):
        raise ConstraintError(
            f"{NAME}: frame must return 3 expressions, or a tuple of them and a 3 x 3 matrix; "
            f"got shapes {origin.shape} and {rotation.shape}"
        )
    for instant in (0.0, 0.37):
        R = np.array(pose(instant)[1])
        if not np.abs(R.T @ R - np.eye(3)).max() < 1e-6 or np.linalg.det(R) < 0:
            raise ConstraintError(
                f"{NAME}: frame must return a rotation matrix; at {instant:g} s it is none"
            )
    column = ca.densify(ca.vertcat(origin, ca.vec(rotation)))
    return Instructions.of(ca.Function("frame", [t], [column]))


def _is_pair(value: Any) -> bool:
    return isinstance(value, tuple) and len(value) == 2


def _matrix(value: Any) -> Expression:
    """An expression from an expression, an array, or lists of numbers and expressions."""
    if not isinstance(value, _LISTS):
        return ca.SX(value)
    return ca.vertcat(*(ca.horzcat(*row) if isinstance(row, _LISTS) else row for row in value))


def _period(name: str, value: Any) -> float:
    return _arguments.positive(name, value, "seconds")


def _phase(name: str, value: Any) -> float:
    return number(name, value, "radians")


def _rotation_vector(name: str, value: Any) -> tuple[float, ...]:
    return point(name, value, "rad")


def _velocity(name: str, value: Any) -> tuple[float, ...]:
    return point(name, value, "m/s")
