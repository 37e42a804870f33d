"""What every recording of a run is learned with, as a text that can be sent to a worker."""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from noslip import _arguments
from noslip._version import __version__
from noslip.constraints.catalog import restore, specification
from noslip.constraints.declaration import Constraint
from noslip.constraints.system import ConstraintSystem, as_system
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
    if loading.get("robot") is not None:
        raise InputError(
            "robot: a model cannot be sent to a worker; write the tool's poses first (noslip "
            "convert ... --robot ... --out ...)"
        )
    asked = {
        "noslip": __version__,
        "constraints": _specifications(as_system(constraints)),
        "loading": _completed(load_demonstrations, loading),
        "preparation": _completed(prepare, preparation),
        "options": _completed(learn, options),
    }
    return json.dumps(asked, sort_keys=True, default=lambda array: array.tolist())


def _specifications(system: ConstraintSystem) -> list[dict[str, Any]]:
    specifications = []
    for constraint in system.constraints:
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
