"""What tests draw: seeds, axes, directions."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import strategies as st

from noslip._typing import Floats

seeds = st.integers(0, 2**32 - 1)
AXES = ("x", "y", "z", "-x", "-y", "-z")


def axis_vector(axis: str) -> Floats:
    return (-1.0 if axis.startswith("-") else 1.0) * np.eye(3)["xyz".index(axis[-1])]


def unit(rng: np.random.Generator, size: int = 3) -> Floats:
    """A random direction."""
    vector = rng.normal(size=size)
    return np.asarray(vector / np.linalg.norm(vector))


def triple(vector: Any) -> tuple[float, float, float]:
    """A vector as constraints take it."""
    x, y, z = (float(value) for value in vector)
    return x, y, z
