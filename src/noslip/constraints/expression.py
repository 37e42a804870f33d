"""Expression graphs as plain data.

CasADi can serialize a function itself, but reading one back may run what the file says
(just-in-time compilers, external libraries).  Here a graph is a list of arithmetic instructions,
and reading it back can do nothing but arithmetic.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from noslip._typing import Expression
from noslip._values import shortened
from noslip.errors import ConstraintError

MOST_OPERATIONS = 2000
"""Of the constraints of a system, together: the largest of the catalog has 78.  Learning and
planning take seconds at this size, and a C compiler, whose time grows faster, minutes."""

_CONSTANT, _INPUT, _OUTPUT = "CONST", "INPUT", "OUTPUT"
_UNARY = [
    "NEG",
    "EXP",
    "LOG",
    "LOG1P",
    "EXPM1",
    "SQRT",
    "SQ",
    "TWICE",
    "SIN",
    "COS",
    "TAN",
    "ASIN",
    "ACOS",
    "ATAN",
    "NOT",
    "FLOOR",
    "CEIL",
    "FABS",
    "SIGN",
    "ERF",
    "ERFINV",
    "INV",
    "SINH",
    "COSH",
    "TANH",
    "ASINH",
    "ACOSH",
    "ATANH",
    "ASSIGN",
]
_BINARY = [
    "ADD",
    "SUB",
    "MUL",
    "DIV",
    "POW",
    "CONSTPOW",
    "LT",
    "LE",
    "EQ",
    "NE",
    "AND",
    "OR",
    "FMOD",
    "REMAINDER",
    "COPYSIGN",
    "IF_ELSE_ZERO",
    "FMIN",
    "FMAX",
    "ATAN2",
    "HYPOT",
]
_CODES = {
    name: getattr(ca, f"OP_{name}")
    for name in (_CONSTANT, _INPUT, _OUTPUT, *_UNARY, *_BINARY)
    if hasattr(ca, f"OP_{name}")
}
_NAMES = {code: name for name, code in _CODES.items()}


@dataclass(frozen=True)
class Instructions:
    """A function of expressions as its arithmetic: called like it, equal and sent by what it does.

    Attributes
    ----------
    steps : tuple of tuples
        Name, result, operands (or a number) of each instruction.
    """

    steps: tuple[tuple[Any, ...], ...]

    @classmethod
    def of(cls, function: Any) -> Instructions:
        """Return the instructions of a CasADi SX function with one output.

        Raises
        ------
        ConstraintError
            If it uses something other than arithmetic.
        """
        return cls(tuple(_steps(function)))

    @classmethod
    def from_data(cls, data: Any) -> Instructions:
        """Return the instructions that :meth:`to_data` wrote.

        Raises
        ------
        ConstraintError
            If the data are none.
        """
        if not isinstance(data, list) or len(data) > MOST_OPERATIONS:
            found = f"{len(data)} operations" if isinstance(data, list) else type(data).__name__
            raise ConstraintError(
                f"its expression cannot be read: expected a list of at most {MOST_OPERATIONS} "
                f"operations, found {found}"
            )
        for step in data:
            if not (isinstance(step, list) and 3 <= len(step) <= 4 and _is_step(*step)):
                raise ConstraintError(
                    f"its expression cannot be read: {shortened(repr(step))} is no operation"
                )
        return cls(tuple(map(tuple, data)))

    def to_data(self) -> list[list[Any]]:
        """Return plain data, for JSON."""
        return [list(step) for step in self.steps]

    def __call__(self, *arguments: Expression) -> Expression:
        """Evaluate on expressions; return the output as a column.

        Raises
        ------
        ConstraintError
            If an instruction is none.
        """
        work: dict[int, Any] = {}
        outputs: dict[int, Any] = {}
        try:
            for name, result, *operands in self.steps:
                if name == _CONSTANT:
                    work[result] = ca.SX(float(operands[0]))
                elif name == _INPUT:
                    argument, place = operands
                    work[result] = ca.vec(arguments[argument])[place]
                elif name == _OUTPUT:
                    outputs[result] = work[operands[0]]
                else:
                    work[result] = self.applied(name, [work[k] for k in operands])
            return ca.vertcat(*(outputs[row] for row in range(len(outputs))))
        except Exception as error:
            reason = " ".join(str(error).split())
            raise ConstraintError(f"its expression cannot be read: {reason}") from error

    @staticmethod
    def applied(name: str, operands: Sequence[Expression]) -> Expression:
        """Return the result of one operation."""
        if name in _UNARY:
            return ca.SX.unary(_CODES[name], *operands)
        if name in _BINARY:
            return ca.SX.binary(_CODES[name], *operands)
        raise ValueError(f"unknown operation {name!r}")

    def __repr__(self) -> str:
        return f"<formula of {len(self.steps)} operations>"


@dataclass(frozen=True, eq=False)
class Opaque:
    """A function of more than arithmetic: only itself, neither saved nor sent.

    Attributes
    ----------
    function : casadi.Function
    owner : object
        Whose function it is; two of the same owner are equal.
    reason : str
        What it uses.
    """

    function: Any
    owner: Any
    reason: str

    def __call__(self, *arguments: Expression) -> Expression:
        """Evaluate on expressions; those that are not given are zero."""
        left = self.function.n_in() - len(arguments)
        return self.function(*arguments, *[0] * left)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Opaque) and other.owner is self.owner

    def __hash__(self) -> int:
        return id(self.owner)

    def __reduce__(self) -> Any:
        raise ConstraintError(self.reason)

    def to_data(self) -> Any:
        """Refuse, with the reason."""
        raise ConstraintError(self.reason)


def _is_step(name: Any, *places: Any) -> bool:
    """Whether these are what :func:`_steps` yields: an operation and whole numbers, or a number."""
    *whole, last = places
    known = isinstance(name, str) and name in _CODES
    numbers = all(type(place) is int for place in whole) and type(last) in (int, float)
    return known and numbers and (type(last) is int or name == _CONSTANT)


def _steps(function: Any) -> Iterator[tuple[Any, ...]]:
    for k in range(function.n_instructions()):
        name = _NAMES.get(function.instruction_id(k))
        if name is None:
            raise ConstraintError(
                f"uses CasADi operation {function.instruction_id(k)}, which cannot be kept; write "
                "it with arithmetic"
            )
        result, operands = function.instruction_output(k), function.instruction_input(k)
        if name == _CONSTANT:
            yield name, result[0], function.instruction_constant(k)
        elif name == _OUTPUT:
            yield name, result[1], operands[0]
        else:
            yield name, result[0], *operands
