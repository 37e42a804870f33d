"""What a file holds of a distribution besides its primitive."""

from __future__ import annotations

from typing import Any

import numpy as np

from noslip import _arguments
from noslip._typing import Floats
from noslip.boundary import Boundary, End, rotations_of
from noslip.distribution.curves import SAMPLES
from noslip.distribution.estimation import FEWEST
from noslip.distribution.gaussian import Gaussian
from noslip.document import Reader, one_of
from noslip.errors import InputError
from noslip.space import Space

_LEAST_CURVES = 4
"""Weights of a cubic."""
_ROUNDING = 1e-9
"""Share of the largest variance by which rounding may make one negative."""


def boundary_to_data(boundary: Boundary) -> dict[str, Any]:
    """Return plain data of a pose that is kept, or of the part of it that is."""
    parts = {"position": boundary.position, "rotation": boundary.quaternion}
    known = {name: value.tolist() for name, value in parts.items() if value is not None}
    return {"at": boundary.at, **known}


def read(reader: Reader, content: dict[str, Any], space: Space) -> dict[str, Any]:
    """Return what :meth:`MotionDistribution.as_data` says, by the same names.

    Raises
    ------
    InputError
        If there is none, or a field is not what it must be; the message names file and field.
    """
    if "distribution" not in content:
        raise InputError(
            f"{reader.path}: holds a primitive, but no distribution; learn it with "
            "distribution=True, or read it with load_primitive"
        )
    part = reader.part(content, "distribution")
    curves = reader.count(part, "curves")
    if not _LEAST_CURVES <= curves <= SAMPLES:
        raise InputError(
            f"{reader.path}: field curves: from {_LEAST_CURVES} to {SAMPLES} weights, got {curves}"
        )
    context = reader.texts(part, "context")
    demonstrations = reader.count(part, "demonstrations")
    if demonstrations < FEWEST + len(context) or len(set(context)) < len(context):
        raise InputError(
            f"{reader.path}: field distribution: {demonstrations} demonstrations and "
            f"{len(context)} numbers of context; it takes {FEWEST} more than there are numbers, "
            "each of its own name"
        )
    size = space.velocity_size * curves + len(context)
    mean = reader.array(part, "mean", (size,))
    covariance = reader.array(part, "covariance", (size, size))
    _require_covariance(reader, covariance)
    noise = reader.array(part, "noise", (space.velocity_size,))
    if not noise.min() > 0:
        raise InputError(f"{reader.path}: field noise: must be above 0, got {noise.min():g}")
    return {
        "curves": curves,
        "gaussian": Gaussian(mean, covariance),
        "noise": noise,
        "score": reader.number(part, "score", _arguments.finite),
        "demonstrations": demonstrations,
        "context": context,
        "kept": tuple(_boundary(reader, each, space) for each in reader.parts(part, "kept")),
        "ends": reader.field(part, "ends", _ends),
    }


def _ends(value: Any) -> tuple[End, End]:
    if not isinstance(value, list) or len(value) != 2:
        raise ValueError(f"expected two, got {_arguments.short(value)}")
    return one_of(End, value[0]), one_of(End, value[1])


def _require_covariance(reader: Reader, covariance: Floats) -> None:
    largest = float(np.abs(covariance).max(initial=0.0))
    askew = float(np.abs(covariance - covariance.T).max(initial=0.0))
    least = float(np.linalg.eigvalsh(covariance).min(initial=0.0))
    if askew > _ROUNDING * largest or least < -_ROUNDING * largest:
        raise InputError(
            f"{reader.path}: field covariance: must be symmetric and have no negative variance; "
            f"asymmetric by {askew:.3g}, least variance {least:.3g}"
        )


def _boundary(reader: Reader, data: dict[str, Any], space: Space) -> Boundary:
    at = reader.number(data, "at", _arguments.not_negative)
    position = rotation = None
    if "position" in data:
        position = reader.array(data, "position", (space.linear,))
    if "rotation" in data:
        quaternion = reader.unit_quaternions(data, "rotation", (4 * space.rotations,))
        rotation = rotations_of(quaternion)
    boundary = reader.field(data, "at", lambda _: Boundary(at, position, rotation))
    if boundary.is_free:
        raise InputError(f"{reader.path}: field kept: nothing is kept at {at:g}")
    return boundary
