"""Expression graphs as plain data.

CasADi can serialize a function itself, but reading one back may run what the file says
(just-in-time compilers, external libraries).  Here a graph is a list of arithmetic instructions,
and reading it back can do nothing but arithmetic.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from noslip.errors import ConstraintError

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


def to_data(function: Any) -> list[list[Any]]:
    """Instructions of an SX function with one output: name, result, operands (or a number).

    Raises
    ------
    ConstraintError
        If it uses something other than arithmetic.
    """
    instructions: list[list[Any]] = []
    for k in range(function.n_instructions()):
        name = _NAMES.get(function.instruction_id(k))
        if name is None:
            raise ConstraintError(
                f"constraint uses CasADi operation {function.instruction_id(k)}, which cannot be "
                "saved; write it with arithmetic"
            )
        result, operands = function.instruction_output(k), function.instruction_input(k)
        if name == _CONSTANT:
            instructions.append([name, result[0], function.instruction_constant(k)])
        elif name == _OUTPUT:
            instructions.append([name, result[1], operands[0]])
        else:
            instructions.append([name, result[0], *operands])
    return instructions


def from_data(instructions: Any, arguments: list[Any]) -> Any:
    """Evaluate instructions on expressions; return the output as a column.

    Raises
    ------
    ConstraintError
        If the data are not instructions that :func:`to_data` wrote.
    """
    work: dict[int, Any] = {}
    outputs: dict[int, Any] = {}
    try:
        for name, result, *operands in instructions:
            if name == _CONSTANT:
                work[result] = ca.SX(float(operands[0]))
            elif name == _INPUT:
                argument, place = operands
                work[result] = ca.vec(arguments[argument])[place]
            elif name == _OUTPUT:
                outputs[result] = work[operands[0]]
            elif name in _UNARY:
                work[result] = ca.SX.unary(_CODES[name], work[operands[0]])
            elif name in _BINARY:
                work[result] = ca.SX.binary(_CODES[name], work[operands[0]], work[operands[1]])
            else:
                raise ValueError(f"unknown operation {name!r}")
        return ca.vertcat(*(outputs[row] for row in range(len(outputs))))
    except Exception as error:
        reason = " ".join(str(error).split())
        raise ConstraintError(f"its expression cannot be read: {reason}") from error
