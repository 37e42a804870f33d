"""What a distribution is conditioned on: boundaries, with noise or without."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from noslip import _arguments
from noslip._typing import Floats
from noslip.boundary import Boundary, sample_of
from noslip.errors import InputError
from noslip.space import Space


def checked(boundary: Boundary, steps: int, space: Space) -> Boundary:
    """Return a boundary that a distribution can be conditioned on, at its sample."""
    if not isinstance(boundary, Boundary):
        raise InputError(f"condition on Boundary objects, got {_arguments.short(boundary)}")
    if boundary.has_twist or boundary.is_free:
        raise InputError(
            f"condition on a position or a rotation at {boundary.at:g}; velocities follow"
        )
    boundary.require_of(space)
    return replace(boundary, at=sample_of(boundary.at, steps) / (steps - 1))


def exactly(boundary: Boundary, noise: Floats) -> Boundary:
    """What of a boundary is asked for without noise."""
    return replace(
        boundary,
        position=None if noise[0] else boundary.position,
        rotation=None if noise[1] else boundary.rotation,
    )


def merged(boundaries: Iterable[Boundary], steps: int) -> tuple[Boundary, ...]:
    """Boundaries, one a sample; of those at the same one the last says what it names."""
    found: dict[int, Boundary] = {}
    for boundary in boundaries:
        k = sample_of(boundary.at, steps)
        if k in found:
            position, rotation = found[k].position, found[k].rotation
            boundary = replace(
                boundary,
                position=position if boundary.position is None else boundary.position,
                rotation=rotation if boundary.rotation is None else boundary.rotation,
            )
        found[k] = boundary
    return tuple(found[k] for k in sorted(found) if not found[k].is_free)


def noise_of(noise: float | Sequence[float]) -> Floats:
    given = _arguments.numbers("noise", noise)
    if given.ndim > 1 or given.size not in (1, 2) or not np.all((given >= 0) & np.isfinite(given)):
        raise InputError(
            "noise must be a number, 0 or more, or two: of positions (m) and of rotations (rad); "
            f"got {_arguments.short(noise)}"
        )
    return np.broadcast_to(given.ravel(), 2)
