"""A motion that turns about all axes, and what the tests of all formats ask of it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import refusals
from noslip import PoseTrajectory, load_demonstrations
from noslip.errors import InputError


@pytest.fixture(scope="session")
def motion() -> PoseTrajectory:
    """Forty samples at 20 Hz, whose times are not exact in binary or in nanoseconds."""
    t = 3.7 + np.arange(40) / 20
    return PoseTrajectory(
        times=t,
        positions=np.column_stack([np.sin(t), 0.2 * t, 0.1 * np.cos(3 * t)]),
        rotations=Rotation.from_rotvec(np.column_stack([np.sin(t), 2 * t, 0.3 * t**2])),
    )


@pytest.fixture
def refusal() -> Callable[..., str]:
    """Return the one line with which a recording is refused; it begins with the path."""

    def refuse(path: Path, **options: object) -> str:
        message = refusals.refusal(InputError, load_demonstrations, path, **options)
        assert message.startswith(str(path))
        return message

    return refuse


@pytest.fixture
def same() -> Callable[..., None]:
    """Assert that two trajectories hold the same poses at the same times."""

    def compare(one: PoseTrajectory, other: PoseTrajectory, tolerance: float = 1e-12) -> None:
        np.testing.assert_allclose(one.times, other.times, rtol=0, atol=1e-9)
        np.testing.assert_allclose(one.positions, other.positions, rtol=0, atol=tolerance)
        turn = (one.rotations * other.rotations.inv()).magnitude()
        np.testing.assert_allclose(turn, 0, atol=2 * tolerance + 1e-12)

    return compare
