"""A constraint from a function of the motion."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import cached_property
from typing import Any, Concatenate, Generic, Literal, ParamSpec, overload

from noslip._typing import Expression
from noslip.constraints.declaration import (
    Constraint,
    Level,
    Relation,
    depends_on_velocity,
    plain,
    residual_instructions,
)
from noslip.constraints.expression import Instructions, Opaque
from noslip.constraints.instant import AcceleratedInstant, Instant
from noslip.errors import ConstraintError, did_you_mean

P = ParamSpec("P")

_Function = Callable[Concatenate[Instant, P], Expression]
_Accelerated = Callable[Concatenate[AcceleratedInstant, P], Expression]


class FunctionConstraint(Constraint, Generic[P]):
    """A constraint made from a user's function of the motion, and of parameters if it has more.

    Called with parameters, it returns the same rule with these in place of its own, which are the
    function's defaults: ``screw(lead=0.003)``.  Values are numbers, texts, and sequences of these;
    :attr:`parameters` tells them, and so does what is read back from a file.
    """

    def __init__(
        self,
        function: Callable[..., Expression],
        level: Level | None,
        name: str | None,
        relation: Relation = "zero",
        barrier_rate: float | None = None,
        priority: int = 0,
        given: dict[str, Any] | None = None,
    ) -> None:
        self.function, self.relation = function, relation
        self.barrier_rate, self.priority = barrier_rate, priority
        self.name = name or getattr(function, "__name__", "constraint").replace("_", " ")
        self.__doc__ = inspect.getdoc(function)
        self._asked_level, self._given = level, given or {}
        self.__signature__ = _of_parameters(function)
        self._parameters = self._known()
        self.level = level or "velocity"
        if level is None and not self._missing and not depends_on_velocity(self):
            self.level = "position"

    def __call__(self, *args: P.args, **parameters: P.kwargs) -> FunctionConstraint[P]:
        """Return the same rule with other parameters; those that are not given stay.

        Raises
        ------
        ConstraintError
            If it has no such parameter, or a value is not plain data.
        """
        try:
            bound = self.__signature__.bind_partial(*args, **parameters).arguments
        except TypeError as error:
            known = list(self.__signature__.parameters)
            near = "".join(did_you_mean(name, known) for name in parameters if name not in known)
            there = f"it has {', '.join(known)}" if known else "it has none"
            raise ConstraintError(
                f"constraint {self.name!r}: its parameters: {error}{near}; {there}"
            ) from None
        for name, value in bound.items():
            try:
                plain(value)
            except TypeError:
                raise ConstraintError(
                    f"constraint {self.name!r}: parameter {name} is a finite number, a text or a "
                    f"sequence of these, got {type(value).__name__}"
                ) from None
        return FunctionConstraint(
            self.function,
            self._asked_level,
            self.name,
            self.relation,
            self.barrier_rate,
            self.priority,
            self._given | bound,
        )

    @cached_property
    def instructions(self) -> Instructions | Opaque:
        """The residual as data, from when it is first needed."""
        return residual_instructions(self)

    def residual(self, motion: Instant) -> Expression:
        if self._missing:
            given = ", ".join(f"{name}=..." for name in self._missing)
            function = getattr(self.function, "__name__", "it")
            raise ConstraintError(f"give its parameters: {function}({given})")
        if not self._given:
            return self.function(motion)
        bound = inspect.signature(self.function).bind_partial(motion)
        bound.arguments.update(self._given)
        return self.function(*bound.args, **bound.kwargs)

    @property
    def _missing(self) -> list[str]:
        """Parameters without a value."""
        return [
            parameter.name
            for parameter in self.__signature__.parameters.values()
            if parameter.default is parameter.empty and parameter.name not in self._given
        ]

    def _known(self) -> dict[str, Any]:
        """Values by name; defaults that are no plain data, such as arrays of others, are none."""
        found = {}
        for name, parameter in self.__signature__.parameters.items():
            try:
                found[name] = plain(self._given.get(name, parameter.default))
            except TypeError:
                continue
        return found


def _of_parameters(function: Callable[..., Any]) -> inspect.Signature:
    """Return the signature of what a function takes beside the motion."""
    try:
        _, *others = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):
        # CasADi's functions and some of C tell none.
        others = []
    return inspect.Signature([p for p in others if p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD)])


def _decorator(
    decorator: str, function: Any, make: Callable[[Callable[..., Any]], FunctionConstraint[Any]]
) -> Any:
    def declare(function: Any) -> FunctionConstraint[Any]:
        if not callable(function):
            raise ConstraintError(
                f"@{decorator} is put before a function of the motion, got {function!r}"
            )
        return make(function)

    return declare if function is None else declare(function)


@overload
def velocity_constraint(function: _Function[P], /) -> FunctionConstraint[P]: ...
@overload
def velocity_constraint(
    *, name: str | None = None
) -> Callable[[_Function[P]], FunctionConstraint[P]]: ...
def velocity_constraint(function: Any = None, /, *, name: str | None = None) -> Any:
    """Declare ``phi(p, R, v, w, t) = 0``: non-holonomic, or any other rule about velocities.

    What the function takes beside the motion are the rule's parameters, see
    :class:`noslip.constraints.FunctionConstraint`.

    Examples
    --------
    >>> @ns.velocity_constraint
    ... def no_lateral_slip(motion: ns.Instant):
    ...     return motion.rotation[:, 1].T @ motion.linear_velocity
    """
    return _decorator(
        "velocity_constraint", function, lambda f: FunctionConstraint(f, "velocity", name)
    )


@overload
def position_constraint(function: _Function[P], /) -> FunctionConstraint[P]: ...
@overload
def position_constraint(
    *, name: str | None = None
) -> Callable[[_Function[P]], FunctionConstraint[P]]: ...
def position_constraint(function: Any = None, /, *, name: str | None = None) -> Any:
    """Declare ``psi(p, R, t) = 0``: holonomic, a rule about where the tool may be.

    Examples
    --------
    >>> @ns.position_constraint
    ... def stay_on_table(motion: ns.Instant, *, height: float = 0.0):
    ...     return motion.position[2] - height
    >>> higher = stay_on_table(height=0.01)
    """
    return _decorator(
        "position_constraint", function, lambda f: FunctionConstraint(f, "position", name)
    )


@overload
def keep_nonnegative(function: _Function[P], /) -> FunctionConstraint[P]: ...
@overload
def keep_nonnegative(
    *,
    level: Literal["acceleration"],
    name: str | None = None,
    barrier_rate: float | None = None,
    priority: int = 0,
) -> Callable[[_Accelerated[P]], FunctionConstraint[P]]: ...
@overload
def keep_nonnegative(
    *,
    name: str | None = None,
    level: Level | None = None,
    barrier_rate: float | None = None,
    priority: int = 0,
) -> Callable[[_Function[P]], FunctionConstraint[P]]: ...
def keep_nonnegative(
    function: Any = None,
    /,
    *,
    name: str | None = None,
    level: Level | None = None,
    barrier_rate: float | None = None,
    priority: int = 0,
) -> Any:
    """Declare an inequality, ``h >= 0``, of the pose or of the velocities too.

    At run time it is a barrier row of the quadratic program: ``dh/dt + rate h >= 0`` at velocity
    level (relative degree one), the same twice over at position level (relative degree two).  The
    margin h is then never used up.

    Parameters
    ----------
    function : callable
        Takes the motion, and parameters if it has any; returns the margin: a number, a column or
        a list.
    name : str, optional
    level : "position", "velocity" or "acceleration", optional
        By default "velocity" if the margin depends on a velocity, else "position".  At
        "acceleration", the motion is an :class:`noslip.constraints.AcceleratedInstant`, which has
        ``linear_acceleration`` and ``angular_acceleration`` too.
    barrier_rate : float, optional
        1/s; the higher, the later and the harder the limit acts.  By default 300 per duration.
    priority : int
        0 is hard.  Where not all can hold, soft limits (1, 2, ...) give way, the largest number
        first.

    Examples
    --------
    >>> @ns.keep_nonnegative
    ... def above_the_table(motion: ns.Instant):
    ...     return motion.position[2]
    """
    return _decorator(
        "keep_nonnegative",
        function,
        lambda f: FunctionConstraint(f, level, name, "nonnegative", barrier_rate, priority),
    )
