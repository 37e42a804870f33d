"""A pose in the forms in which a caller may give one."""

from __future__ import annotations

from typing import Any

from scipy.spatial.transform import Rotation

from noslip import _arguments
from noslip._typing import Floats
from noslip.errors import InputError
from noslip.runtime.state import State


def pose_of(name: str, given: Any) -> tuple[Floats, Rotation]:
    """Return position (m) and rotation of a State or a pair (position, Rotation).

    Raises
    ------
    InputError
        If it is neither, or holds a number that is not finite.
    """
    if isinstance(given, State):
        given = given.position, given.rotation
    try:
        position, rotation = given
    except (TypeError, ValueError):
        raise InputError(
            f"{name} must be a State or a pair (position, Rotation), got {_arguments.short(given)}"
        ) from None
    return (
        _arguments.vector(f"{name}: position", position),
        _arguments.rotation(f"{name}: rotation", rotation),
    )
