"""Constraints by name: for the command line and for saved primitives."""

from __future__ import annotations

import ast
import dataclasses
import importlib.util
import re
import sys
from pathlib import Path
from typing import Any

from noslip.constraints.declaration import (
    CATALOG,
    Constraint,
    Declaration,
    DeclaredConstraint,
    constraint_function,
    declared,
    given_arguments,
    of_a_user,
    plain,
)
from noslip.constraints.decorators import FunctionConstraint
from noslip.constraints.distance_field import DistanceField
from noslip.constraints.expression import Instructions, Opaque
from noslip.edge import Edge
from noslip.errors import ConstraintError, did_you_mean

_OWN = re.compile(r"(.+\.py):([^(]*)(\(.*\))?", re.DOTALL)
"""File, name and arguments of a constraint of the user's own."""


def parse_constraint(text: str) -> Constraint:
    """Return the constraint that a text names; no code in the text is evaluated.

    Parameters
    ----------
    text : str
        A catalog name (``blade``), a call with literal arguments (``blade(lateral='z')``), or a
        constraint of the user's own as ``file.py:name`` or, with parameters,
        ``file.py:name(lead=0.003)``; that file is imported.

    Raises
    ------
    ConstraintError
        Naming what was found and what is known.
    """
    text = text.strip()
    if own := _OWN.fullmatch(text):
        return _from_file(text, *own.groups())
    try:
        tree = ast.parse(
            text.replace("-", "_", text.partition("(")[0].count("-")), mode="eval"
        ).body
    except (SyntaxError, RecursionError, MemoryError, ValueError):
        tree = None
    if isinstance(tree, ast.Name):
        return build(tree.id, {})
    if isinstance(tree, ast.Call) and isinstance(tree.func, ast.Name):
        return build(tree.func.id, _literal_arguments(text, tree))
    raise ConstraintError(
        f"constraint {text!r} is not understood; give a name ({_known()}), a call such as "
        "\"blade(lateral='z')\", or file.py:name"
    )


def build(name: str, arguments: dict[str, Any]) -> Constraint:
    """Return a catalog constraint with the given arguments."""
    factory = CATALOG.get(name.replace("_", "-"))
    if factory is None:
        near = did_you_mean(name, CATALOG)
        raise ConstraintError(f"no constraint is called {name!r}{near}; known are {_known()}")
    known = [f.name for f in dataclasses.fields(factory) if f.init]  # type: ignore[arg-type]
    unknown = sorted(set(arguments) - set(known))
    if unknown:
        near = did_you_mean(unknown[0], known)
        raise ConstraintError(
            f"{name} has no argument {unknown[0]!r}{near}; it has {', '.join(known)}"
        )
    return factory(**arguments)


def resolved(name: str, constraint: Any) -> Constraint:
    """Return what a rule is about: a constraint, or one by name as on the command line.

    Parameters
    ----------
    name : str
        Of the rule, for the error.
    constraint : Constraint or str
    """
    if isinstance(constraint, Constraint):
        return constraint
    if not isinstance(constraint, str):
        hint = f"; call it: {constraint.__name__}()" if isinstance(constraint, type) else ""
        raise ConstraintError(
            f"{name}: constraint must be a constraint or its name, got {constraint!r}{hint}"
        )
    if ".py:" in constraint:
        # Kept as text, it would be saved as text, and reading a file would run another one.
        raise ConstraintError(
            f"{name}: constraint {constraint!r} names a file; declare {name} with it in that "
            "file and name that"
        )
    try:
        return parse_constraint(constraint)
    except ConstraintError as error:
        raise ConstraintError(f"{name}: constraint: {error}") from None


def specification(constraint: Constraint) -> dict[str, Any]:
    """Return plain data from which :func:`restore` makes the same constraint again."""
    identity = declared(constraint)
    values = {
        field.name: _as_data(getattr(identity, field.name))
        for field in dataclasses.fields(identity)  # type: ignore[arg-type]
    }
    if isinstance(identity, Declaration):
        # Written where there are any.
        del values["parameters"]
        own = {"parameters": dict(identity.parameters)} if identity.parameters else {}
        return {"type": "declared", **values, **own}
    if isinstance(constraint.edge, Edge) and "edge" in values:
        # Its other parts are arguments too.
        values["edge"] = constraint.edge.travel
    return {"type": constraint.known_as, "arguments": values}


def constraint_text(constraint: Constraint) -> str:
    """Return the text from which :func:`parse_constraint` makes one of the catalog.

    Numbers have six digits, and none beyond a nanometer.
    """
    name = constraint.known_as.replace("-", "_")
    values = given_arguments(constraint).items()
    return f"{name}({', '.join(f'{key}={_written(value)}' for key, value in values)})".replace(
        "()", ""
    )


def _written(value: Any) -> str:
    if isinstance(value, float):
        return f"{round(value, 9) + 0.0:.6g}"
    if isinstance(value, tuple | list):
        return f"({', '.join(map(_written, value))}{',' * (len(value) == 1)})"
    return repr(value)


def restore(data: dict[str, Any]) -> Constraint:
    """Return the constraint that :func:`specification` described.

    Raises
    ------
    ConstraintError
        If the data are incomplete, or describe none.
    """
    if data["type"] != "declared":
        arguments = {name: _from_data(value) for name, value in data["arguments"].items()}
        for name in getattr(CATALOG.get(str(data["type"])), "from_files", ()):
            if isinstance(arguments.get(name), str):
                raise ConstraintError(
                    f"{data['type']}: {name} is a file, which only a user may name"
                )
        return build(str(data["type"]), arguments)
    try:
        own = data.get("parameters", {})
        left = ("type", "parameters")
        values = {name: _from_data(value) for name, value in data.items() if name not in left}
        if not isinstance(own, dict):
            raise TypeError("its parameters are no object of names and values")
        values["row_names"] = tuple(values.get("row_names", ()))
        parameters = tuple((name, plain(value)) for name, value in own.items())
        constraint = DeclaredConstraint(Declaration(**values, parameters=parameters))
    except (TypeError, ConstraintError) as error:
        name = data.get("name", "without a name")
        raise ConstraintError(f"saved constraint {name!r} cannot be read: {error}") from error
    constraint_function(constraint)
    return constraint


def _as_data(value: Any) -> Any:
    if isinstance(value, Edge):
        return dataclasses.asdict(value)
    if isinstance(value, Constraint):
        return specification(value)
    if isinstance(value, DistanceField):
        return {"distances": value.to_data()}
    return {"instructions": value.to_data()} if isinstance(value, (Instructions, Opaque)) else value


def _from_data(value: Any) -> Any:
    if isinstance(value, dict) and "travel" in value:
        return Edge(**value)
    if isinstance(value, dict) and "instructions" in value:
        return Instructions.from_data(value["instructions"])
    if isinstance(value, dict) and "distances" in value:
        return DistanceField.from_data(value["distances"])
    return restore(value) if isinstance(value, dict) and "type" in value else value


def _literal_arguments(text: str, call: ast.Call) -> dict[str, Any]:
    if call.args or any(keyword.arg is None for keyword in call.keywords):
        raise ConstraintError(f"constraint {text!r}: name each argument, as in lateral='z'")
    arguments: dict[str, Any] = {}
    for keyword in call.keywords:
        if keyword.arg in arguments:
            raise ConstraintError(f"constraint {text!r}: {keyword.arg} is given twice")
        try:
            arguments[str(keyword.arg)] = ast.literal_eval(keyword.value)
        except (TypeError, ValueError, MemoryError, RecursionError):
            raise ConstraintError(
                f"constraint {text!r}: {keyword.arg} must be a literal (text, number, list), "
                "nothing is evaluated"
            ) from None
    return arguments


def _from_file(text: str, file: str, name: str, called: str | None) -> Constraint:
    path, arguments = Path(file), {}
    if called:
        try:
            tree = ast.parse(f"rule{called}", mode="eval").body
        except (SyntaxError, RecursionError, MemoryError, ValueError):
            tree = None
        if not isinstance(tree, ast.Call):
            raise ConstraintError(
                f"constraint {text!r} is not understood; parameters are named, as in "
                "file.py:name(lead=0.003)"
            )
        arguments = _literal_arguments(text, tree)
    if not path.is_file():
        raise ConstraintError(f"{path}: no such file; a constraint of your own is file.py:name")
    spec = importlib.util.spec_from_file_location(f"noslip_user_{path.stem}", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    with of_a_user(f"{path}: what it holds"):
        spec.loader.exec_module(module)
        found = getattr(module, name, None)
    if isinstance(found, type) and issubclass(found, Constraint):
        instead = f"write {name.lower()} = {name}(...) in that file and name that"
        with of_a_user(f"{path}: {name}()", lambda reason: f"{reason}; {instead}"):
            found = found(**arguments)
    elif isinstance(found, FunctionConstraint) and called:
        found = found(**arguments)
    elif isinstance(found, Constraint) and called:
        raise ConstraintError(f"{path}: {name!r} takes no parameters; name it without ()")
    if not isinstance(found, Constraint):
        own = [key for key, value in vars(module).items() if isinstance(value, Constraint)]
        listing = f"it declares {', '.join(own)}" if own else "it declares no constraint"
        near = did_you_mean(name, own)
        raise ConstraintError(f"{path}: {name!r} is not a constraint{near}; {listing}")
    return found


def _known() -> str:
    return ", ".join(sorted(CATALOG))
