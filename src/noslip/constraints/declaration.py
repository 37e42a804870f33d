"""A constraint is declared once, as an expression of the motion that must be zero, or not negative.

Everything else follows from that expression by automatic differentiation: the matrix A and the
vector b of the Udwadia-Kalaba equation, the correction of each discrete step, the Jacobians of the
trajectory projection, the check of a recording.

A constraint is a value: equal to another that declares the same, and sent to another process by
what it declares.  One of the catalog is its class and its fields; any other is its attributes and
its expression, as data.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import MISSING, dataclass, fields
from functools import lru_cache
from typing import Any, ClassVar, Literal, TypeVar

import casadi as ca
import numpy as np

from noslip import _arguments
from noslip._typing import Expression
from noslip._values import call_text, keep_repr, shortened
from noslip.constraints.expression import MOST_OPERATIONS, Instructions, Opaque
from noslip.constraints.instant import (
    AcceleratedInstant,
    Coordinates,
    Instant,
    coordinate_symbols,
    motion_symbols,
)
from noslip.constraints.shape import Shape
from noslip.edge import Edge
from noslip.errors import ConstraintError
from noslip.space import Space

Level = Literal["position", "velocity", "acceleration"]
Relation = Literal["zero", "nonnegative"]
UNITS: dict[Level, str] = {"position": "m", "velocity": "m/s", "acceleration": "m/s²"}
"""Of a residual, unless its constraint says another."""
LONGEST_NAME = 200
"""Characters of a constraint's name: more than a line of a report shows."""
ROW = ", "
"""Between a constraint's name and that of one of its rows: ``"wheel, sideways"``."""
SIDEWAYS = "sideways"
"""What a row is called that keeps a tool with an edge from slipping, of a constraint of several."""
MOST_ROWS = 64
"""Of the constraints of a system, together: a box has 6.  Time grows with the third power: learning
of 100 rows takes half a minute, of 2000 days."""
MOST_COORDINATES = 1000
"""Of what moves; nothing that steps in a millisecond has as many."""
MOST_PRIORITIES = 10
"""Each soft priority weighs its limits by another power of ten; more would lose the least ones."""


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
    edge : Edge or None
        Of a tool with a direction of travel: the trajectory projection starts from the rotation
        that turns it into the path.
    radii : tuple of float
        Of inequalities ``r - |x| >= 0``, x affine in velocities or accelerations: r of each row.
        The tool is kept within such balls as they are, not within planes that touch them.
    from_files : tuple of str
        Arguments that may be files, which a user names but no saved primitive does.
    known_as : str
        What the catalog calls it; empty outside of it.
    coordinates : int
        0: declared of a body's pose and motion; else of so many coordinates, such as joints.
    body : str
        Of which body, where there are several; the first one by default.
    row_names : tuple of str
        What its rows are called beside its name, ``("sideways", "vertical")``; by default they are
        numbered.
    """

    name: str
    level: Level = "velocity"
    relation: Relation = "zero"
    unit: str | None = None
    barrier_rate: float | None = None
    priority: int = 0
    edge: Edge | None = None
    radii: tuple[float, ...] = ()
    from_files: ClassVar[tuple[str, ...]] = ()
    known_as: ClassVar[str] = ""
    coordinates: int = 0
    body: str = ""
    row_names: tuple[str, ...] = ()

    @property
    def parameters(self) -> dict[str, Any]:
        """What it was declared with, by name; of what is read from a file too.

        Numbers, texts and tuples of these; fields of a dataclass that are something else are left
        out.
        """
        if (known := vars(self).get("_parameters")) is not None:
            return dict(known)
        found: dict[str, Any] = {}
        for name in getattr(self, "__dataclass_fields__", ()):
            value = getattr(self, name)
            try:
                found[name] = plain(value.travel if isinstance(value, Edge) else value)
            except TypeError:
                continue
        return found

    @abstractmethod
    def residual(self, motion: Instant) -> Expression:
        """Return what must be zero, or not negative: a scalar, a column, or a list of scalars."""

    def relative(self, motion: Instant) -> Instant:
        """Motion of the tool relative to its work: the motion itself, unless the work moves."""
        return motion

    def in_space(self, space: Space) -> Constraint:
        """Return what it comes to where this moves: itself, unless it is about whatever moves."""
        return self

    def shape(self) -> Shape | None:
        """What it looks like; None, if it has no place."""
        return None

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        keep_repr(cls)

    def __repr__(self) -> str:
        """Its class and what it was given, the first field always; one's own by its name."""
        if not is_registered(self):
            given = ", ".join(f"{name}={value!r}" for name, value in self.parameters.items())
            told = f" ({given})" if given else ""
            return shortened(f"<{self.level} {_KINDS[self.relation]} {self.name!r}{told}>", 110)
        first = next(f.name for f in fields(self) if not f.kw_only)  # type: ignore[arg-type]
        value = getattr(self, first)
        shown = {first: value.travel if isinstance(value, Edge) else value}
        return call_text(type(self).__name__, shown | given_arguments(self))

    def __eq__(self, other: object) -> bool:
        if self is other or not isinstance(other, Constraint):
            return self is other
        return declared(self) == declared(other)

    def __hash__(self) -> int:
        return hash(declared(self))

    def __copy__(self) -> Constraint:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> Constraint:
        return self

    def __reduce__(self) -> Any:
        identity = declared(self)
        if identity is self:
            return super().__reduce__()
        return DeclaredConstraint, (identity,)


CATALOG: dict[str, type[Constraint]] = {}
"""The classes known by name, on the command line and in files; each puts itself in."""

Known = TypeVar("Known", bound=type[Constraint])


def register(kind: Known) -> Known:
    """Make a constraint's class known by its ``known_as``, by default its ``name``.

    It is a frozen dataclass of plain values.
    """
    if "known_as" not in vars(kind):
        kind.known_as = kind.name
    if CATALOG.setdefault(kind.known_as, kind) is not kind:
        raise ConstraintError(f"two constraints are called {kind.known_as!r}")
    return kind


def is_registered(constraint: Constraint) -> bool:
    """Whether a constraint is one of the catalog."""
    return any(type(constraint) is kind for kind in CATALOG.values())


@dataclass(frozen=True)
class Declaration:
    """What a constraint outside the catalog is: its attributes, and its residual as data."""

    name: str
    level: Level
    relation: Relation
    unit: str | None
    barrier_rate: float | None
    priority: int
    edge: Edge | None
    expression: Instructions | Opaque
    relative: Instructions | None
    coordinates: int = 0
    body: str = ""
    row_names: tuple[str, ...] = ()
    parameters: tuple[tuple[str, Any], ...] = ()


class DeclaredConstraint(Constraint):
    """A constraint from its declaration; the code that declared it is not needed.

    Parameters
    ----------
    declaration : Declaration
    """

    def __init__(self, declaration: Declaration) -> None:
        for name in _ATTRIBUTES:
            setattr(self, name, getattr(declaration, name))
        self._parameters = dict(declaration.parameters)
        self.instructions, self._relative = declaration.expression, declaration.relative

    def residual(self, motion: Instant) -> Expression:
        return self.instructions(*vars(motion).values())

    def relative(self, motion: Instant) -> Instant:
        if self._relative is None:
            return motion
        column = self._relative(*list(vars(motion).values())[:5])
        position, rotation, velocities = ca.vertsplit(column, [0, 3, 12, 18])
        rotation = ca.reshape(rotation, 3, 3)
        return Instant(motion.time, position, rotation, *ca.vertsplit(velocities, 3))


_ATTRIBUTES = [
    "name",
    "level",
    "relation",
    "unit",
    "barrier_rate",
    "priority",
    "edge",
    "coordinates",
    "body",
    "row_names",
]


def declared(constraint: Constraint) -> Constraint | Declaration:
    """Return what a constraint is, whoever made it: hashable, and without graphs.

    One of the catalog is itself.

    Raises
    ------
    ConstraintError
        See :func:`constraint_function`.
    """
    if is_registered(constraint):
        return constraint
    kept = {name: getattr(constraint, name) for name in _ATTRIBUTES}
    expression = getattr(constraint, "instructions", None) or residual_instructions(constraint)
    relative = relative_function(constraint)
    return Declaration(
        **kept,
        expression=expression,
        relative=None if relative is None else Instructions.of(relative),
        parameters=tuple(constraint.parameters.items()),
    )


def plain(value: Any) -> Any:
    """Return a parameter's value as data that is equal to itself: tuples of numbers and texts.

    Raises
    ------
    TypeError
        If it is something else, or a number that is not finite.
    """
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return tuple(map(plain, value))
    if value is None or isinstance(value, bool | str):
        return value
    if isinstance(value, int | float) and np.isfinite(value):
        return value
    raise TypeError(f"no plain data: {type(value).__name__}")


def from_declared(identity: Constraint | Declaration) -> Constraint:
    """Return a constraint that :func:`declared` finds to be this."""
    return DeclaredConstraint(identity) if isinstance(identity, Declaration) else identity


def relative_function(constraint: Constraint) -> Any:
    """CasADi function (t, p, R, v, w) -> column of the relative p, R, v, w; None of all motion."""
    if constraint.coordinates:
        return None
    motion = motion_symbols()
    with of_a_user(f"constraint {constraint.name!r}: its relative motion"):
        seen = constraint.relative(motion)
    if seen is motion:
        return None
    parts = seen.position, ca.vec(seen.rotation), seen.linear_velocity, seen.angular_velocity
    column = ca.densify(ca.vertcat(*map(ca.SX, parts)))
    return ca.Function("relative", list(vars(motion).values())[:5], [column])


def residual_instructions(constraint: Constraint) -> Instructions | Opaque:
    """Return a constraint's residual as data, if it is arithmetic."""
    # Of any other, the declaration under which its function is kept holds what is returned here.
    function = _function(constraint) if is_registered(constraint) else _built(constraint)
    try:
        return Instructions.of(function)
    except ConstraintError as error:
        return Opaque(function, constraint, str(error))


def given_arguments(constraint: Constraint) -> dict[str, Any]:
    """Return the arguments of one of the catalog that are not its defaults, by name.

    What it is about comes first, what all limits share last.
    """
    found = {}
    for field in sorted(fields(constraint), key=lambda f: bool(f.kw_only)):  # type: ignore[arg-type]
        value, factory = getattr(constraint, field.name), field.default_factory
        if isinstance(value, Edge):
            value = value.travel
        if value != (field.default if factory is MISSING else factory()):
            found[field.name] = value
    return found


@contextmanager
def of_a_user(what: str, advice: Callable[[str], str] = str) -> Iterator[None]:
    """Run code of a user's: whatever ends it but Ctrl-C is an error of that code.

    An exit would otherwise end the program, as if all was well.

    Parameters
    ----------
    what : str
        Whose code it is, for the message.
    advice : callable, optional
        What to say of a reason.
    """
    try:
        yield
    except KeyboardInterrupt:
        raise
    except ConstraintError as error:
        raise ConstraintError(f"{what}: {error}") from error
    except BaseException as error:
        reason = " ".join(f"{type(error).__name__}: {error}".split()).rstrip(":")
        raise ConstraintError(f"{what} cannot be evaluated: {advice(reason)}") from error


_KINDS: dict[Relation, str] = {"zero": "constraint", "nonnegative": "inequality"}


def constraint_function(constraint: Constraint) -> Any:
    """CasADi function (t, p, R, v, w, a, alpha) -> residual column, checked for what it must be.

    Declared of coordinates, it is one of (t, x, x', x'').  Those that declare the same share one.

    Raises
    ------
    ConstraintError
        If the declaration fails, gives no number or column of numbers, does not depend on the
        motion, or depends on other quantities than those of its level.
    """
    _require_attributes(constraint)
    return _function(declared(constraint))


@lru_cache(maxsize=256)
def _function(identity: Constraint | Declaration) -> Any:
    return _built(from_declared(identity))


def row_units(constraint: Constraint) -> list[str]:
    """For each row, the unit of its residual.

    Several in a constraint's ``unit`` are those of its rows, in order: ``"m/s, rad/s"`` of four
    rows are two rows of each.  Of a constraint without one, rows about velocities that the linear
    velocity has no part in are rad/s.
    """
    function = constraint_function(constraint)
    rows = function.size1_out(0)
    if constraint.unit is None and constraint.level == "velocity":
        if constraint.coordinates:
            return ["1/s"] * rows
        moving = set(function.jac_sparsity(0, 3).row())
        return [UNITS["velocity"] if row in moving else "rad/s" for row in range(rows)]
    unit = constraint.unit or UNITS[constraint.level]
    units = unit.split(", ")
    if rows % len(units):
        return [unit] * rows
    return [units[row * len(units) // rows] for row in range(rows)]


def names_of_rows(constraint: Constraint, rows: int, name: str) -> list[str]:
    """Return what each of a constraint's rows is called: its name, and which of several."""
    if rows == 1:
        return [name]
    own = constraint.row_names or [f"row {row}" for row in range(1, rows + 1)]
    return [f"{name}{ROW}{which}" for which in own]


def _require_attributes(constraint: Constraint) -> None:
    with of_a_user(f"an attribute of a {type(constraint).__name__}"):
        kept = {name: getattr(constraint, name) for name in _ATTRIBUTES}
    name, unit = kept["name"], kept["unit"]
    for what, text in {"name": name, "unit": "1" if unit is None else unit}.items():
        if not (isinstance(text, str) and text.isprintable() and 0 < len(text) <= LONGEST_NAME):
            raise ConstraintError(
                f"constraint {shortened(repr(name))}: its {what} must be a text of 1 to "
                f"{LONGEST_NAME} characters that can be printed, got {shortened(repr(text))}"
            )
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
    if not (constraint.edge is None or isinstance(constraint.edge, Edge)):
        raise ConstraintError(
            f"constraint {name!r}: edge is an Edge, as in Edge('x', lateral='y'), or None; got "
            f"{constraint.edge!r}"
        )
    if constraint.barrier_rate is not None:
        _arguments.positive(f"constraint {name!r}: barrier_rate", constraint.barrier_rate, "1/s")
    count = constraint.coordinates
    if not (type(count) is int and 0 <= count <= MOST_COORDINATES):
        raise ConstraintError(
            f"constraint {name!r}: coordinates is a whole number up to {MOST_COORDINATES}, 0 of a "
            f"body's motion; got {shortened(repr(count))}"
        )
    body = constraint.body
    # Of the first one it is empty, which counts as printable.
    if not (isinstance(body, str) and len(body) <= LONGEST_NAME and body.isprintable()):
        raise ConstraintError(
            f"constraint {name!r}: body is the name of one, got {shortened(repr(body))}"
        )
    rows = constraint.row_names
    if not (isinstance(rows, tuple) and all(isinstance(r, str) and r.isprintable() for r in rows)):
        raise ConstraintError(
            f"constraint {name!r}: row_names is a tuple of texts, got {shortened(repr(rows))}"
        )
    if not (type(constraint.priority) is int and 0 <= constraint.priority < MOST_PRIORITIES):
        raise ConstraintError(
            f"constraint {name!r}: priority is 0 (hard) or a whole number up to "
            f"{MOST_PRIORITIES - 1} (soft), got {constraint.priority!r}"
        )


def _built(constraint: Constraint) -> Any:
    _require_attributes(constraint)
    name, motion = constraint.name, _symbols(constraint)
    column = _column(constraint, motion)
    function = ca.Function("constraint", [*vars(motion).values()], [column])
    require_size(f"constraint {name!r} has", column.shape[0], function.n_instructions())
    levels = _levels(motion)
    if not any(ca.depends_on(column, quantity) for quantity in levels.values()):
        raise ConstraintError(
            f"constraint {name!r} does not depend on the motion: it is {shortened(str(column[0]))}"
        )
    declare = "{}_constraint" if constraint.relation == "zero" else "keep_nonnegative(level={!r})"
    several = column.shape[0] > 1
    if constraint.row_names and len(constraint.row_names) != column.shape[0]:
        raise ConstraintError(
            f"constraint {name!r} has {column.shape[0]} rows and {len(constraint.row_names)} "
            "row_names; give one of each"
        )
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
    return function


def require_size(what: str, rows: int, operations: int) -> None:
    """Refuse a rule, or several, that would take longer than anyone waits."""
    found = {"rows": (rows, MOST_ROWS), "operations": (operations, MOST_OPERATIONS)}
    for noun, (count, most) in found.items():
        if count > most:
            raise ConstraintError(
                f"{what} {count} {noun}, at most {most} are held; write it with fewer, or "
                "leave out what cannot matter"
            )


def _symbols(constraint: Constraint) -> AcceleratedInstant | Coordinates:
    if constraint.coordinates:
        return coordinate_symbols(constraint.coordinates)
    return motion_symbols()


def _column(constraint: Constraint, motion: AcceleratedInstant | Coordinates) -> Expression:
    """Evaluate a declaration; an error says what to change."""
    given: Any = motion
    if constraint.level != "acceleration" and isinstance(motion, AcceleratedInstant):
        given = Instant(*list(vars(motion).values())[:5])
    with of_a_user(f"constraint {constraint.name!r}", _advice):
        value = constraint.residual(given)
        if value is None:
            raise TypeError("it returns nothing; is a return missing?")
        if isinstance(value, (list, tuple)):
            value = ca.vertcat(*value)
        column = ca.SX(value)
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


def _advice(reason: str) -> str:
    if "truth value" in reason:
        return (
            "if, and, or, min and max cannot look into an expression; write two rules, or "
            "casadi.if_else, casadi.fmin and casadi.fmax"
        )
    return (
        f"{reason}; write it with the motion's CasADi expressions (casadi.dot, casadi.norm_2, @, "
        ".T)"
    )


_COMPARISONS = (ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE, ca.OP_NOT, ca.OP_AND, ca.OP_OR)


def _levels(motion: AcceleratedInstant | Coordinates) -> dict[Level, Expression]:
    """Quantities that a constraint of a level may depend on, and one below it may not."""
    if isinstance(motion, Coordinates):
        return {
            "position": motion.values,
            "velocity": motion.rates,
            "acceleration": motion.accelerations,
        }
    return {
        "position": ca.vertcat(motion.position, ca.vec(motion.rotation)),
        "velocity": ca.vertcat(motion.linear_velocity, motion.angular_velocity),
        "acceleration": ca.vertcat(motion.linear_acceleration, motion.angular_acceleration),
    }


def depends_on_velocity(constraint: Constraint) -> bool:
    motion = _symbols(constraint)
    return bool(ca.depends_on(_column(constraint, motion), _levels(motion)["velocity"]))
