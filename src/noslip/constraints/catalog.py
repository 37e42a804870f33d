"""Constraints by name: for the command line and for saved primitives."""

from __future__ import annotations

import ast
import dataclasses
import importlib.util
import sys
from pathlib import Path
from typing import Any

from noslip._typing import Expression
from noslip.constraints.blade import Blade
from noslip.constraints.contact import CylinderContact, PlaneContact, SphereContact, SurfaceContact
from noslip.constraints.declaration import Constraint, Instant, constraint_function, described
from noslip.constraints.expression import from_data, to_data
from noslip.constraints.keep_out import KeepOutCapsule, KeepOutSphere
from noslip.constraints.moving_frame import InMovingFrame
from noslip.constraints.needle import Needle
from noslip.constraints.rates import AccelerationLimit, AngularRateLimit, SpeedLimit
from noslip.constraints.region import Box, DepthLimit, HalfSpace
from noslip.constraints.remote_center import RemoteCenter
from noslip.constraints.rolling import RollingDisc, RollingSphere
from noslip.constraints.tool_axis import ToolAxis
from noslip.constraints.travel import ForwardOnly, TurningRadius
from noslip.constraints.wheel import Wheel
from noslip.errors import ConstraintError

CATALOG: dict[str, type[Constraint]] = {
    "blade": Blade,
    "needle": Needle,
    "wheel": Wheel,
    "rolling-disc": RollingDisc,
    "rolling-sphere": RollingSphere,
    "plane-contact": PlaneContact,
    "sphere-contact": SphereContact,
    "cylinder-contact": CylinderContact,
    "surface-contact": SurfaceContact,
    "remote-center": RemoteCenter,
    "tool-axis": ToolAxis,
    "in-moving-frame": InMovingFrame,
    "half-space": HalfSpace,
    "depth-limit": DepthLimit,
    "box": Box,
    "keep-out-sphere": KeepOutSphere,
    "keep-out-capsule": KeepOutCapsule,
    "speed-limit": SpeedLimit,
    "angular-rate-limit": AngularRateLimit,
    "acceleration-limit": AccelerationLimit,
    "forward-only": ForwardOnly,
    "turning-radius": TurningRadius,
}


def parse_constraint(text: str) -> Constraint:
    """Return the constraint that a text names; no code in the text is evaluated.

    Parameters
    ----------
    text : str
        A catalog name (``blade``), a call with literal arguments (``blade(lateral='z')``), or a
        constraint of the user's own as ``file.py:name``; that file is imported.

    Raises
    ------
    ConstraintError
        Naming what was found and what is known.
    """
    text = text.strip()
    path, colon, name = text.rpartition(":")
    if colon and path.endswith(".py"):
        return _from_file(Path(path), name)
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
        raise ConstraintError(f"no constraint is called {name!r}; known are {_known()}")
    known = [f.name for f in dataclasses.fields(factory) if f.init]  # type: ignore[arg-type]
    unknown = sorted(set(arguments) - set(known))
    if unknown:
        raise ConstraintError(f"{name} has no argument {unknown[0]!r}; it has {', '.join(known)}")
    return factory(**arguments)


def specification(constraint: Constraint) -> dict[str, Any]:
    """Return plain data from which :func:`restore` makes the same constraint again."""
    for name, factory in CATALOG.items():
        if type(constraint) is factory:
            fields = dataclasses.fields(constraint)  # type: ignore[arg-type]
            arguments = {f.name: getattr(constraint, f.name) for f in fields if f.init}
            # What holds a function of the user's is saved by its expression instead.
            if all(_is_plain(value) for value in arguments.values()):
                return {"type": name, "arguments": arguments}
    return {
        "type": "declared",
        "name": constraint.name,
        "level": constraint.level,
        "relation": constraint.relation,
        "unit": constraint.unit,
        "barrier_rate": constraint.barrier_rate,
        "priority": constraint.priority,
        "lateral": constraint.lateral,
        "edge": constraint.edge,
        "expression": to_data(constraint_function(constraint)),
    }


def restore(data: dict[str, Any]) -> Constraint:
    """Return the constraint that :func:`specification` described."""
    if data["type"] != "declared":
        return build(str(data["type"]), dict(data["arguments"]))
    constraint = _RestoredConstraint(data)
    constraint_function(constraint)
    return constraint


class _RestoredConstraint(Constraint):
    """A user's constraint read back from its expression; the user's code is not needed."""

    def __init__(self, data: dict[str, Any]) -> None:
        self.name, self.level = str(data["name"]), data["level"]
        self.lateral, self.edge = data["lateral"], data["edge"]
        # Files of version 0.1 know equalities alone.
        self.relation, self.unit = data.get("relation", "zero"), data.get("unit")
        self.barrier_rate, self.priority = data.get("barrier_rate"), data.get("priority", 0)
        self._expression = data["expression"]

    def residual(self, motion: Instant) -> Expression:
        return from_data(self._expression, [*vars(motion).values()])

    def __repr__(self) -> str:
        return described(self)


def _is_plain(value: Any) -> bool:
    if isinstance(value, (list, tuple)):
        return all(_is_plain(item) for item in value)
    return value is None or isinstance(value, (str, bool, int, float))


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


def _from_file(path: Path, name: str) -> Constraint:
    if not path.is_file():
        raise ConstraintError(f"{path}: no such file; a constraint of your own is file.py:name")
    spec = importlib.util.spec_from_file_location(f"noslip_user_{path.stem}", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        reason = " ".join(str(error).split())
        raise ConstraintError(
            f"{path}: importing it failed: {type(error).__name__}: {reason}"
        ) from error
    found = getattr(module, name, None)
    if isinstance(found, type) and issubclass(found, Constraint):
        try:
            found = found()
        except TypeError as error:
            raise ConstraintError(
                f"{path}: {name} needs arguments ({error}); write {name.lower()} = {name}(...) in "
                "that file and name that"
            ) from error
    if not isinstance(found, Constraint):
        own = [key for key, value in vars(module).items() if isinstance(value, Constraint)]
        listing = f"it declares {', '.join(own)}" if own else "it declares no constraint"
        raise ConstraintError(f"{path}: {name!r} is not a constraint; {listing}")
    return found


def _known() -> str:
    return ", ".join(sorted(CATALOG))
