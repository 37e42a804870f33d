"""Colors of what the viewer draws."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from noslip._typing import Floats
from noslip.figures.style import PALETTE

Bytes = NDArray[np.uint8]
"""An array of colors, red, green and blue last."""


def rgb(color: str) -> tuple[int, int, int]:
    """Return the three bytes of ``#rrggbb``."""
    red, green, blue = (int(color[i : i + 2], 16) for i in (1, 3, 5))
    return red, green, blue


SLIP_COLORS = tuple(rgb(PALETTE[name]) for name in ("blue", "orange", "vermillion"))
"""Of no violation, half of the largest, and the largest."""


def slip_colors(sizes: Floats, worst: float) -> Bytes:
    """Colors of violations, shape (N, 3) of bytes: blue where there is none."""
    share = np.clip(sizes / worst, 0.0, 1.0) if worst > 0 else np.zeros_like(sizes)
    places = np.linspace(0.0, 1.0, len(SLIP_COLORS))
    channels = [np.interp(share, places, channel) for channel in zip(*SLIP_COLORS, strict=True)]
    return np.round(np.stack(channels, axis=1)).astype(np.uint8)
