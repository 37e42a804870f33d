"""A constraint is declared once, as an expression of the motion that must be zero, or not negative.

Everything else follows from that expression by automatic differentiation: the matrix A and the
vector b of the Udwadia-Kalaba equation, the correction of each discrete step, the Jacobians of the
trajectory projection, the check of a recording.
"""

from __future__ import annotations

import inspect
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, overload

import casadi as ca

from noslip import _arguments
from noslip._typing import Expression
from noslip.errors import ConstraintError

Level = Literal["position", "velocity", "acceleration"]
Relation = Literal["zero", "nonnegative"]
AXES = ("x", "y", "z")
UNITS: dict[Level, str] = {"position": "m", "velocity": "m/s", "acceleration": "m/s²"}


@dataclass(frozen=True)
class Instant:
    """What a constraint may be written in: CasADi expressions of one instant of the motion.

    Attributes
    ----------
    time : expression, scalar
        Seconds since the motion began.
    position : expression, shape (3,)
        Of the tool's frame, meters, world frame.
    rotation : expression, shape (3, 3)
        Body to world; ``rotation[:, 1]`` is the body's y axis in the world.
    linear_velocity, angular_velocity : expression, shape (3,)
        Meters and radians per second, world frame; ``dR/dt = [w] R``.
    """

    time: Expression
    position: Expression
    rotation: Expression
    linear_velocity: Expression
    angular_velocity: Expression

    def at(self, reference_point: Sequence[float]) -> Instant:
        """Motion of the frame moved to a body-fixed point: ``p + R r`` and ``v + w x R r``.

        Parameters
        ----------
        reference_point : 3 numbers
            r, in the body's frame (m).
        """
        if not any(reference_point):
            return self
        arm = ca.mtimes(self.rotation, ca.DM(list(reference_point)))
        return replace(
            self,
            position=self.position + arm,
            linear_velocity=self.linear_velocity + ca.cross(self.angular_velocity, arm),
        )

    def __getattr__(self, name: str) -> Any:
        known = "time, position, rotation, linear_velocity, angular_velocity"
        hint = ""
        if "acceleration" in name:
            hint = (
                "; accelerations follow from the constraint (a limit on them is declared with "
                'keep_nonnegative(level="acceleration"))'
            )
        raise ConstraintError(f"a motion has {known}, but no {name!r}{hint}")


@dataclass(frozen=True)
class AcceleratedInstant(Instant):
    """A motion whose accelerations are known too, for inequalities at acceleration level.

    Attributes
    ----------
    linear_acceleration, angular_acceleration : expression, shape (3,)
        Of the step (m/s^2, rad/s^2), world frame, of the tool's frame.
    """

    linear_acceleration: Expression
    angular_acceleration: Expression

    def at(self, reference_point: Sequence[float]) -> AcceleratedInstant:
        """Motion of a body-fixed point: its acceleration is ``a + alpha x R r + w x (w x R r)``."""
        if not any(reference_point):
            return self
        arm = ca.mtimes(self.rotation, ca.DM(list(reference_point)))
        turning = ca.cross(self.angular_velocity, arm)
        return replace(
            self,
            position=self.position + arm,
            linear_velocity=self.linear_velocity + turning,
            linear_acceleration=self.linear_acceleration
            + ca.cross(self.angular_acceleration, arm)
            + ca.cross(self.angular_velocity, turning),
        )


class Constraint(ABC):
    """What the motion must satisfy for all time: ``residual(motion) = 0``, or ``>= 0``.

    Subclasses state ``residual``; :func:`velocity_constraint`, :func:`position_constraint` and
    :func:`keep_nonnegative` make one from a function.

    Attributes
    ----------
    name : str
        What reports, figures and errors call it.
    level : "position", "velocity" or "acceleration"
        ``psi(p, R, t)``, ``phi(p, R, v, w, t)``, not necessarily linear in the velocities, or (of
        inequalities alone) an expression of the step's acceleration too.
    relation : "zero" or "nonnegative"
    unit : str or None
        Of the residual; by default that of a length, a velocity, or an acceleration.
    barrier_rate : float or None
        Of inequalities: 1/s; the margin h may shrink no faster than like ``exp(-rate t)``.  None
        leaves it to the primitive (300 per duration).
    priority : int
        Of inequalities: 0 is hard.  Where not all can hold, soft ones (1, 2, ...) give way, the
        largest number first.
    lateral, edge : str or None
        For a tool with a direction of travel: the body axis that must not move, and the one that
        leads (either may carry a sign, as in ``"-x"``).  The trajectory projection starts from the
        rotation that turns the edge into the path.
    """

    name: str
    level: Level = "velocity"
    relation: Relation = "zero"
    unit: str | None = None
    barrier_rate: float | None = None
    priority: int = 0
    lateral: str | None = None
    edge: str | None = None

    @abstractmethod
    def residual(self, motion: Instant) -> Expression:
        """Return what must be zero, or not negative: a scalar, a column, or a list of scalars."""


class _DeclaredConstraint(Constraint):
    """A constraint made from a user's function."""

    def __init__(
        self,
        function: _Function,
        level: Level,
        name: str | None,
        relation: Relation = "zero",
        barrier_rate: float | None = None,
        priority: int = 0,
    ) -> None:
        self.function, self.level, self.relation = function, level, relation
        self.barrier_rate, self.priority = barrier_rate, priority
        self.name = name or getattr(function, "__name__", "constraint").replace("_", " ")
        self.__doc__ = inspect.getdoc(function)

    def residual(self, motion: Instant) -> Expression:
        return self.function(motion)

    def __repr__(self) -> str:
        return described(self)


def described(constraint: Constraint) -> str:
    """Level, kind and name, for people."""
    return f"<{constraint.level} {_KINDS[constraint.relation]} {constraint.name!r}>"


_KINDS: dict[Relation, str] = {"zero": "constraint", "nonnegative": "inequality"}
# An inequality at acceleration level is given an AcceleratedInstant.
_Function = Callable[[Any], Expression]


def _decorator(
    decorator: str, function: _Function | None, make: Callable[[_Function], Constraint]
) -> Constraint | Callable[[_Function], Constraint]:
    def declare(function: _Function) -> Constraint:
        if not callable(function):
            raise ConstraintError(
                f"@{decorator} is put before a function of the motion, got {function!r}"
            )
        return make(function)

    return declare if function is None else declare(function)


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
    return _decorator(
        "velocity_constraint", function, lambda f: _DeclaredConstraint(f, "velocity", name)
    )


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
    return _decorator(
        "position_constraint", function, lambda f: _DeclaredConstraint(f, "position", name)
    )


@overload
def keep_nonnegative(function: _Function, /) -> Constraint: ...
@overload
def keep_nonnegative(
    *,
    name: str | None = None,
    level: Level | None = None,
    barrier_rate: float | None = None,
    priority: int = 0,
) -> Callable[[_Function], Constraint]: ...
def keep_nonnegative(
    function: _Function | None = None,
    /,
    *,
    name: str | None = None,
    level: Level | None = None,
    barrier_rate: float | None = None,
    priority: int = 0,
) -> Constraint | Callable[[_Function], Constraint]:
    """Declare an inequality, ``h >= 0``, of the pose or of the velocities too.

    At run time it is a barrier row of the quadratic program: ``dh/dt + rate h >= 0`` at velocity
    level (relative degree one), the same twice over at position level (relative degree two).  The
    margin h is then never used up.

    Parameters
    ----------
    function : callable
        Takes the motion, returns the margin: a number, a column or a list.
    name : str, optional
    level : "position", "velocity" or "acceleration", optional
        By default "velocity" if the margin depends on a velocity, else "position".  At
        "acceleration", the motion has ``linear_acceleration`` and ``angular_acceleration`` too.
    barrier_rate : float, optional
        1/s; the higher, the later and the harder the limit acts.  By default 300 per duration.
    priority : int
        0 is hard.  Where not all can hold, soft limits (1, 2, ...) give way, the largest number
        first.

    Examples
    --------
    >>> @ns.keep_nonnegative
    ... def above_the_table(motion):
    ...     return motion.position[2]
    """

    def make(f: _Function) -> Constraint:
        constraint = _DeclaredConstraint(
            f, level or "velocity", name, "nonnegative", barrier_rate, priority
        )
        if level is None and not _depends_on_velocity(constraint):
            constraint.level = "position"
        return constraint

    return _decorator("keep_nonnegative", function, make)


def motion_symbols() -> AcceleratedInstant:
    """One instant of a motion, as symbols."""
    return AcceleratedInstant(
        ca.SX.sym("t"),
        ca.SX.sym("p", 3),
        ca.SX.sym("R", 3, 3),
        ca.SX.sym("v", 3),
        ca.SX.sym("w", 3),
        ca.SX.sym("a", 3),
        ca.SX.sym("alpha", 3),
    )


def constraint_function(constraint: Constraint) -> Any:
    """CasADi function (t, p, R, v, w, a, alpha) -> residual column, checked for what it must be.

    Raises
    ------
    ConstraintError
        If the declaration fails, gives no number or column of numbers, does not depend on the
        motion, or depends on other quantities than those of its level.
    """
    motion = motion_symbols()
    column = _column(constraint, motion)
    name = constraint.name
    if constraint.relation not in list(_KINDS) or constraint.level not in list(UNITS):
        raise ConstraintError(
            f"constraint {name!r}: level is {', '.join(UNITS)}, relation zero or nonnegative; got "
            f"{constraint.level!r} and {constraint.relation!r}"
        )
    if constraint.level == "acceleration" and constraint.relation == "zero":
        raise ConstraintError(
            f"constraint {name!r}: an equality is declared at position or velocity level; "
            "accelerations follow from it"
        )
    if constraint.barrier_rate is not None:
        _arguments.positive(f"constraint {name!r}: barrier_rate", constraint.barrier_rate, "1/s")
    if not (type(constraint.priority) is int and 0 <= constraint.priority < MOST_PRIORITIES):
        raise ConstraintError(
            f"constraint {name!r}: priority is 0 (hard) or a whole number up to "
            f"{MOST_PRIORITIES - 1} (soft), got {constraint.priority!r}"
        )
    levels = _levels(motion)
    if not any(ca.depends_on(column, quantity) for quantity in levels.values()):
        raise ConstraintError(
            f"constraint {name!r} does not depend on the motion: it is {column[0]}"
        )
    declare = "{}_constraint" if constraint.relation == "zero" else "keep_nonnegative(level={!r})"
    several = column.shape[0] > 1
    for index, row in enumerate(ca.vertsplit(column)):
        if row.is_constant():
            continue
        which = f"constraint {name!r}" + (f" in row {index}" if several else "")
        on_velocity = ca.depends_on(row, levels["velocity"])
        if constraint.level == "velocity" and not on_velocity:
            apart = ", apart from the other rows" if several else ""
            raise ConstraintError(
                f"{which} depends on no velocity; declare it with "
                f"{declare.format('position')}{apart}"
            )
        if constraint.level == "position" and on_velocity:
            raise ConstraintError(
                f"{which} depends on a velocity; declare it with {declare.format('velocity')}"
            )
        if constraint.level == "acceleration" and not ca.depends_on(row, levels["acceleration"]):
            raise ConstraintError(f"{which} depends on no acceleration; leave out its level")
    return ca.Function("constraint", [*vars(motion).values()], [column])


MOST_PRIORITIES = 10


def _column(constraint: Constraint, motion: AcceleratedInstant) -> Expression:
    """Evaluate a declaration; an error says what to change."""
    given: Instant = motion
    if constraint.level != "acceleration":
        given = Instant(*list(vars(motion).values())[:5])
    try:
        value = constraint.residual(given)
        if value is None:
            raise ValueError("it returns nothing; is a return missing?")
        if isinstance(value, (list, tuple)):
            value = ca.vertcat(*value)
        column = ca.SX(value)
    except ConstraintError as error:
        raise ConstraintError(f"constraint {constraint.name!r}: {error}") from error
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        if "truth value" in reason:
            raise ConstraintError(
                f"constraint {constraint.name!r} cannot be evaluated: if, and, or, min and max "
                "cannot look into an expression; write two rules, or casadi.if_else, casadi.fmin "
                "and casadi.fmax"
            ) from error
        raise ConstraintError(
            f"constraint {constraint.name!r} cannot be evaluated: {reason}; write it with the "
            "motion's CasADi expressions (casadi.dot, casadi.norm_2, @, .T)"
        ) from error
    if column.shape[1] != 1 or column.shape[0] < 1:
        wanted = "zero" if constraint.relation == "zero" else "0 or more"
        raise ConstraintError(
            f"constraint {constraint.name!r} has shape {column.shape}; it must be one number or a "
            f"column of numbers, all {wanted} when it holds"
        )
    if any(row.is_op(operation) for row in ca.vertsplit(column) for operation in _COMPARISONS):
        wanted = "a - b for a == b" if constraint.relation == "zero" else "a - b for a >= b"
        raise ConstraintError(
            f"constraint {constraint.name!r} returns a comparison, which is only ever 0 or 1; "
            f"return the quantity itself: {wanted}"
        )
    return ca.densify(column)


_COMPARISONS = (ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE, ca.OP_NOT, ca.OP_AND, ca.OP_OR)


def _levels(motion: AcceleratedInstant) -> dict[Level, Expression]:
    """Quantities that a constraint of a level may depend on, and one below it may not."""
    return {
        "position": ca.vertcat(motion.position, ca.vec(motion.rotation)),
        "velocity": ca.vertcat(motion.linear_velocity, motion.angular_velocity),
        "acceleration": ca.vertcat(motion.linear_acceleration, motion.angular_acceleration),
    }


def _depends_on_velocity(constraint: Constraint) -> bool:
    motion = motion_symbols()
    return bool(ca.depends_on(_column(constraint, motion), _levels(motion)["velocity"]))


def axis_index(axis: str, name: str = "axis") -> tuple[int, float]:
    """Index and sign of a body axis such as ``"y"`` or ``"-x"``."""
    letter = axis.removeprefix("-") if isinstance(axis, str) else axis
    if not isinstance(letter, str) or letter not in AXES:
        raise ConstraintError(f"{name}: a body axis is one of x, y, z, -x, -y, -z; got {axis!r}")
    return AXES.index(letter), -1.0 if axis.startswith("-") else 1.0
