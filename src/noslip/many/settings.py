"""What every recording of a run is learned with, as a text that can be sent to a worker."""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from noslip import _arguments
from noslip._supplied import Supplied
from noslip._version import __version__
from noslip.chain import Chain
from noslip.constraints.catalog import restore, specification
from noslip.constraints.declaration import Constraint
from noslip.constraints.system import ConstraintSystem, each_of
from noslip.demonstrations.preparation import prepare
from noslip.errors import ConstraintError, InputError, did_you_mean
from noslip.learning import learn
from noslip.recordings import load_demonstrations


def settings_text(
    constraints: ConstraintSystem | Constraint | Sequence[Constraint],
    loading: Mapping[str, Any],
    preparation: Mapping[str, Any],
    options: Mapping[str, Any],
) -> str:
    """Return all that a worker needs besides the recording, as JSON."""
    asked = {
        "noslip": __version__,
        "constraints": _specifications(constraints),
        "loading": _completed(load_demonstrations, _sent(loading)),
        "preparation": _completed(prepare, preparation),
        "options": _completed(learn, _sent(options)),
    }
    return json.dumps(asked, sort_keys=True, default=lambda array: array.tolist())


def of_settings(text: str) -> dict[str, Any]:
    """Return what :func:`settings_text` was made of, but constraints as plain data."""
    asked: dict[str, Any] = json.loads(text)
    for options in (asked["loading"], asked["options"]):
        if options["robot"] is not None:
            options["robot"] = Chain.from_data(options["robot"])
    return asked


def _sent(options: Mapping[str, Any]) -> dict[str, Any]:
    """Return options with the chain of a robot's joints in its place, as plain data."""
    robot = options.get("robot")
    if robot is None:
        return dict(options)
    chain = robot if isinstance(robot, Chain) else Supplied.functions["robots.chain"](robot)
    return {**options, "robot": chain.as_data()}


def _specifications(
    constraints: ConstraintSystem | Constraint | Sequence[Constraint],
) -> list[dict[str, Any]]:
    """Return constraints as plain data; what they are about is known with the recordings."""
    if isinstance(constraints, ConstraintSystem):
        constraints = constraints.constraints
    specifications = []
    for constraint in each_of(constraints):
        try:
            specifications.append(specification(constraint))
            restore(json.loads(json.dumps(specifications[-1], default=float)))
        except (ConstraintError, TypeError, ValueError) as error:
            raise ConstraintError(
                f"{constraint.name!r} cannot be sent to a worker nor saved: {error}"
            ) from error
    return specifications


def _completed(function: Callable[..., Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """Return options with the function's defaults, so that naming a default changes nothing."""
    known = {
        name: parameter.default
        for name, parameter in inspect.signature(function).parameters.items()
        if parameter.kind is parameter.KEYWORD_ONLY and name != "progress"
    }
    for name, value in given.items():
        if name not in known:
            near = did_you_mean(name, known)
            raise InputError(
                f"{function.__name__} has no option {name!r}{near}; it has {', '.join(known)}"
            )
        try:
            json.dumps(value, default=lambda array: array.tolist())
        except (AttributeError, TypeError, ValueError):
            raise InputError(
                f"{name} must be made of numbers and texts to be sent to a worker, got "
                f"{_arguments.short(value)}"
            ) from None
    return known | dict(given)
