"""A constraint from a function of the motion."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import cached_property
from typing import Any, overload

from noslip._typing import Expression
from noslip.constraints.declaration import (
    Constraint,
    Level,
    Relation,
    depends_on_velocity,
    residual_instructions,
)
from noslip.constraints.expression import Instructions, Opaque
from noslip.constraints.instant import Instant
from noslip.errors import ConstraintError

# An inequality at acceleration level is given an AcceleratedInstant.
_Function = Callable[[Any], Expression]


class _FunctionConstraint(Constraint):
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

    @cached_property
    def instructions(self) -> Instructions | Opaque:
        """The residual as data, from when it is first needed."""
        return residual_instructions(self)

    def residual(self, motion: Instant) -> Expression:
        return self.function(motion)


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
        "velocity_constraint", function, lambda f: _FunctionConstraint(f, "velocity", name)
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
        "position_constraint", function, lambda f: _FunctionConstraint(f, "position", name)
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
        constraint = _FunctionConstraint(
            f, level or "velocity", name, "nonnegative", barrier_rate, priority
        )
        if level is None and not depends_on_velocity(constraint):
            constraint.level = "position"
        return constraint

    return _decorator("keep_nonnegative", function, make)
