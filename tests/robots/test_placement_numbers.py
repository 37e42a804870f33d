"""A placement that is told can be asked for again."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest

from noslip import robots

from .arms import arc


@pytest.mark.parametrize("level", ["recorded", "tool"])
def test_numbers_and_of_are_inverse(level: Literal["recorded", "tool"]) -> None:
    motion = arc()
    placement = robots.Placement.of(motion, [0.4, 0.1, 0.3], yaw=-2.0, level=level)
    middle, yaw = placement.numbers(motion, level)
    np.testing.assert_allclose([*middle, yaw], [0.4, 0.1, 0.3, -2.0], atol=1e-12)
