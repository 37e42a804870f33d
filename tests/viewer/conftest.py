"""A cut of 10 cm in 4 s: as demonstrated, and learned under constraints that have a place."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import noslip as ns

CENTRE, RADIUS = (0.05, -0.03, 0.0), 0.012


def demonstration(rolled: float = 0.0, name: str = "cut.csv") -> ns.PoseTrajectory:
    """The blade's yaw follows the path; rolled by an angle (rad) about z, it slips."""
    s = np.linspace(0, 1, 401)
    u = s**3 * (10 - 15 * s + 6 * s**2)
    path = np.column_stack([0.1 * u, 0.02 * np.sin(2 * np.pi * u), 0 * u])
    yaw = np.arctan(0.4 * np.pi * np.cos(2 * np.pi * u)) + rolled
    return ns.PoseTrajectory(4 * s, path, Rotation.from_euler("z", yaw), name=name)


@pytest.fixture(scope="session")
def demonstrate() -> Callable[..., ns.PoseTrajectory]:
    return demonstration


@pytest.fixture(scope="session")
def cut() -> ns.PoseTrajectory:
    return demonstration()


@pytest.fixture(scope="session")
def slipping() -> ns.PoseTrajectory:
    """Turned by 0.2 rad out of its path."""
    return demonstration(0.2, "slipping.csv")


@pytest.fixture(scope="session")
def primitive(cut: ns.PoseTrajectory) -> ns.ConstrainedDMP:
    rules = [ns.Blade(), ns.PlaneContact(), ns.KeepOutSphere(centre=CENTRE, radius=RADIUS)]
    return ns.learn(cut, rules, basis_functions=30)
