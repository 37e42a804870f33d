"""A surface as a formula: a function of the position, or text in x, y, z; no text is evaluated."""

from __future__ import annotations

import ast
from collections.abc import Callable
from typing import Any

import casadi as ca

from noslip._typing import Expression
from noslip.constraints.declaration import of_a_user
from noslip.constraints.expression import Instructions
from noslip.constraints.fields import safe_norm
from noslip.errors import ConstraintError

Surface = str | Callable[[Expression], Expression]
"""f of an implicit surface ``f(p) = 0``: text, or a function of a position (shape (3,)).

A constraint keeps a user's function as its instructions."""

LONGEST_FORMULA = 10_000
"""Characters: beyond what is written by hand, and parsed in milliseconds."""

_FUNCTIONS = {
    "abs": ca.fabs,
    "cos": ca.cos,
    "exp": ca.exp,
    "log": ca.log,
    "sin": ca.sin,
    "sqrt": ca.sqrt,
    "tan": ca.tan,
}
_OPERATIONS: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: lambda a, b: a + b,
    ast.Sub: lambda a, b: a - b,
    ast.Mult: lambda a, b: a * b,
    ast.Div: lambda a, b: a / b,
    ast.Pow: lambda a, b: a**b,
}
_KNOWN = f"known are x, y, z, pi, numbers, + - * / **, and {', '.join(_FUNCTIONS)}"


def checked_surface(name: str, surface: Any) -> Surface:
    """Return the surface if it is a formula of the position; `name` is what errors call it.

    Raises
    ------
    ConstraintError
        One line that says what is known.
    """
    if not (isinstance(surface, str) or callable(surface)):
        raise ConstraintError(
            f"{name} must be text in x, y, z or a function of the position, got {surface!r}"
        )
    position = ca.SX.sym("p", 3)
    with of_a_user(name):
        value = ca.SX(surface_value(surface, position))
    if value.shape != (1, 1):
        raise ConstraintError(f"{name} must give one number, it has shape {value.shape}")
    if not ca.depends_on(value, position):
        raise ConstraintError(f"{name} does not depend on the position: it is {value}")
    if isinstance(surface, str):
        return surface
    return Instructions.of(ca.Function("surface", [position], [ca.densify(value)]))


def surface_value(surface: Surface, position: Expression) -> Expression:
    """Return f at a position."""
    if not isinstance(surface, str):
        return surface(position)
    try:
        if len(surface) > LONGEST_FORMULA:
            raise ConstraintError(f"is longer than {LONGEST_FORMULA} characters")
        tree = ast.parse(surface.strip(), mode="eval").body
        return _evaluate(tree, {"x": position[0], "y": position[1], "z": position[2], "pi": ca.pi})
    except (SyntaxError, ValueError, OverflowError, RecursionError, MemoryError) as error:
        # Not a formula, or beyond what numbers and the parser can hold.
        problem = str(error) if isinstance(error, ConstraintError) else "is not understood"
        raise ConstraintError(f"{_short(surface)} {problem}; {_KNOWN}") from None


def surface_normal(surface: Surface, position: Expression) -> Expression:
    """Return ``grad f / |grad f|`` at a position: away from where f is negative."""
    place = ca.SX.sym("p", 3)
    slope = ca.gradient(ca.SX(surface_value(surface, place)), place)
    slope = ca.substitute(slope, place, position)
    return slope / safe_norm(slope)


def _evaluate(node: ast.AST, names: dict[str, Expression]) -> Expression:
    match node:
        case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
            # As an expression, no power of it can grow beyond a double.
            return ca.SX(float(value))
        case ast.Name(id=name) if name in names:
            return names[name]
        case ast.Name(id=name):
            raise ConstraintError(f"has an unknown name {name!r}")
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATIONS:
            return _OPERATIONS[type(op)](_evaluate(left, names), _evaluate(right, names))
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return -_evaluate(operand, names)
        case ast.UnaryOp(op=ast.UAdd(), operand=operand):
            return _evaluate(operand, names)
        case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]) if name in _FUNCTIONS:
            return _FUNCTIONS[name](_evaluate(argument, names))
        case ast.Call(func=ast.Name(id=name)) if name in _FUNCTIONS:
            raise ConstraintError(f"must give {name} one number")
        case ast.Call(func=ast.Name(id=name)):
            raise ConstraintError(f"has an unknown function {name!r}")
    raise ConstraintError("is not understood")


def _short(text: str) -> str:
    return repr(text if len(text) <= 60 else f"{text[:60]}...")
