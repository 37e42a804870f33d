"""A constraint is declared once, as an expression of the motion that must be zero.

Everything else follows from that expression by automatic differentiation: the matrix A and the
vector b of the Udwadia-Kalaba equation, the correction of each discrete step, the Jacobians of the
trajectory projection, the check of a recording.
"""

from __future__ import annotations

import inspect
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, overload

import casadi as ca

from noslip.errors import ConstraintError
from noslip.rotations import Expression

Level = Literal["velocity", "position"]
AXES = ("x", "y", "z")


@dataclass(frozen=True)
class Motion:
    """What a constraint may be written in: CasADi expressions of one instant of the motion.

    Attributes
    ----------
    time : expression, scalar
        Seconds since the motion began.
    position : expression, shape (3,)
        Of the tool's frame, metres, world frame.
    rotation : expression, shape (3, 3)
        Body to world; ``rotation[:, 1]`` is the body's y axis in the world.
    linear_velocity, angular_velocity : expression, shape (3,)
        Metres and radians per second, world frame; ``dR/dt = [w] R``.
    """

    time: Expression
    position: Expression
    rotation: Expression
    linear_velocity: Expression
    angular_velocity: Expression

    def __getattr__(self, name: str) -> Any:
        known = "time, position, rotation, linear_velocity, angular_velocity"
        hint = " (accelerations follow from the constraint)" if "acceleration" in name else ""
        raise ConstraintError(f"a motion has {known}, but no {name!r}{hint}")


class Constraint(ABC):
    """An equality that the motion must satisfy for all time: ``residual(motion) = 0``.

    Subclasses state ``residual``; :func:`velocity_constraint` and :func:`position_constraint`
    make one from a function.

    Attributes
    ----------
    name : str
        What reports, figures and errors call it.
    level : "velocity" or "position"
        ``phi(p, R, v, w, t) = 0``, not necessarily linear in the velocities, or
        ``psi(p, R, t) = 0``.
    lateral, edge : str or None
        For a tool with a direction of travel: the body axis that must not move, and the one that
        leads (either may carry a sign, as in ``"-x"``).  The trajectory projection starts from the
        rotation that turns the edge into the path.
    """

    name: str
    level: Level = "velocity"
    lateral: str | None = None
    edge: str | None = None

    @abstractmethod
    def residual(self, motion: Motion) -> Expression:
        """Return what must be zero: a scalar, a column, or a list of scalars."""


class _DeclaredConstraint(Constraint):
    """A constraint made from a user's function."""

    def __init__(
        self, function: Callable[[Motion], Expression], level: Level, name: str | None
    ) -> None:
        if not callable(function):
            raise ConstraintError(
                f"@{level}_constraint is put before a function of the motion, got {function!r}"
            )
        self.function = function
        self.level = level
        self.name = name or getattr(function, "__name__", "constraint").replace("_", " ")
        self.__doc__ = inspect.getdoc(function)

    def residual(self, motion: Motion) -> Expression:
        return self.function(motion)

    def __repr__(self) -> str:
        return f"<{self.level} constraint {self.name!r}>"


_Function = Callable[[Motion], Expression]


@overload
def velocity_constraint(function: _Function, /) -> Constraint: ...
@overload
def velocity_constraint(*, name: str | None = None) -> Callable[[_Function], Constraint]: ...
def velocity_constraint(
    function: _Function | None = None, /, *, name: str | None = None
) -> Constraint | Callable[[_Function], Constraint]:
    """Declare ``phi(p, R, v, w, t) = 0``: non-holonomic, or any other rule about velocities.

    Examples
    --------
    >>> @ns.velocity_constraint
    ... def no_lateral_slip(motion):
    ...     return motion.rotation[:, 1].T @ motion.linear_velocity
    """
    if function is None:
        return lambda f: _DeclaredConstraint(f, "velocity", name)
    return _DeclaredConstraint(function, "velocity", name)


@overload
def position_constraint(function: _Function, /) -> Constraint: ...
@overload
def position_constraint(*, name: str | None = None) -> Callable[[_Function], Constraint]: ...
def position_constraint(
    function: _Function | None = None, /, *, name: str | None = None
) -> Constraint | Callable[[_Function], Constraint]:
    """Declare ``psi(p, R, t) = 0``: holonomic, a rule about where the tool may be.

    Examples
    --------
    >>> @ns.position_constraint
    ... def stay_on_table(motion):
    ...     return motion.position[2]
    """
    if function is None:
        return lambda f: _DeclaredConstraint(f, "position", name)
    return _DeclaredConstraint(function, "position", name)


def constraint_function(constraint: Constraint) -> Any:
    """CasADi function (t, p, R, v, w) -> residual column, checked for what it must be.

    Raises
    ------
    ConstraintError
        If the declaration fails, gives no number or column of numbers, does not depend on the
        motion, or depends on velocities although declared at position level (or never does
        although declared at velocity level).
    """
    motion = Motion(
        ca.SX.sym("t"),
        ca.SX.sym("p", 3),
        ca.SX.sym("R", 3, 3),
        ca.SX.sym("v", 3),
        ca.SX.sym("w", 3),
    )
    try:
        value = constraint.residual(motion)
        if isinstance(value, (list, tuple)):
            value = ca.vertcat(*value)
        column = ca.SX(value)
    except ConstraintError as error:
        raise ConstraintError(f"constraint {constraint.name!r}: {error}") from error
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ConstraintError(
            f"constraint {constraint.name!r} cannot be evaluated: {reason}; write it with the "
            "motion's CasADi expressions (casadi.dot, casadi.norm_2, @, .T)"
        ) from error
    if column.shape[1] != 1 or column.shape[0] < 1:
        raise ConstraintError(
            f"constraint {constraint.name!r} has shape {column.shape}; it must be one number or a "
            "column of numbers, all zero when it holds"
        )
    column = ca.densify(column)
    velocities = ca.vertcat(motion.linear_velocity, motion.angular_velocity)
    pose = ca.vertcat(motion.position, ca.vec(motion.rotation))
    if not ca.depends_on(column, ca.vertcat(pose, velocities)):
        raise ConstraintError(
            f"constraint {constraint.name!r} does not depend on the motion: it is {value}"
        )
    on_velocity = ca.depends_on(column, velocities)
    if constraint.level == "velocity" and not on_velocity:
        raise ConstraintError(
            f"constraint {constraint.name!r} depends on no velocity; declare it with "
            "position_constraint"
        )
    if constraint.level == "position" and on_velocity:
        raise ConstraintError(
            f"constraint {constraint.name!r} depends on a velocity; declare it with "
            "velocity_constraint"
        )
    return ca.Function("constraint", [*vars(motion).values()], [column])


def axis_index(axis: str, name: str = "axis") -> tuple[int, float]:
    """Index and sign of a body axis such as ``"y"`` or ``"-x"``."""
    letter = axis.removeprefix("-") if isinstance(axis, str) else axis
    if letter not in AXES:
        raise ConstraintError(f"{name}: a body axis is one of x, y, z, -x, -y, -z; got {axis!r}")
    return AXES.index(letter), -1.0 if axis.startswith("-") else 1.0
