"""Motions of joints, as they must be to be written."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from noslip import _arguments
from noslip._typing import Floats
from noslip.errors import InputError


def checked_joints(
    target: Path,
    names: Sequence[str],
    times: ArrayLike | None,
    positions: ArrayLike,
    velocities: ArrayLike | None,
) -> tuple[Floats, Floats, Floats | None]:
    """Return times, positions and velocities of joints after checks."""
    if isinstance(names, str) or not names or len(set(names)) != len(names):
        raise InputError(f"{target}: joints need different names, one each, got {names!r}")
    stamps, angles, rates = (
        None if given is None else _arguments.numbers(f"{target}: {what} of joints", given)
        for what, given in (
            ("times", [] if times is None else times),
            ("positions", positions),
            ("velocities", velocities),
        )
    )
    assert stamps is not None
    assert angles is not None
    if stamps.ndim != 1 or not len(stamps) or not np.all(np.diff(stamps) > 0):
        raise InputError(f"{target}: times of joints must be one row that increases")
    shape = (len(stamps), len(names))
    for what, values in (("positions", angles), ("velocities", rates)):
        if values is not None and values.shape != shape:
            raise InputError(f"{target}: {what} have shape {values.shape}, expected {shape}")
    for what, values in (("times", stamps), ("positions", angles), ("velocities", rates)):
        if values is not None and not np.all(np.isfinite(values)):
            row = int(np.argwhere(~np.isfinite(values))[0][0])
            raise InputError(f"{target}: {what} of joints, sample {row}, are not finite")
    return stamps, angles, rates
