"""A cut of 10 cm in 4 s: as demonstrated, and learned under constraints that have a place."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import noslip as ns
from motions import eased, gentle_cut

CENTER, RADIUS = (0.05, -0.03, 0.0), 0.012


def demonstration(rolled: float = 0.0, name: str = "cut.csv") -> ns.PoseTrajectory:
    """The blade's yaw follows the path; rolled by an angle (rad) about z, it slips."""
    s = np.linspace(0, 1, 401)
    u = eased(s)
    path = np.column_stack([0.1 * u, 0.02 * np.sin(2 * np.pi * u), 0 * u])
    yaw = np.arctan(0.4 * np.pi * np.cos(2 * np.pi * u)) + rolled
    return ns.PoseTrajectory(4 * s, path, Rotation.from_euler("z", yaw), name=name)


def knife_run(noise: tuple[float, float] = (5e-5, 5e-4)) -> ns.PoseTrajectory:
    """A blade that turns about all axes and does not slip at a point 5 cm ahead of its origin.

    Noise is of a sample's position and rotation (m, rad).
    """
    rng, rate, count = np.random.default_rng(5), 100.0, 800
    t = np.arange(count) / rate
    rates = np.column_stack([0.5 * np.sin(1.3 * t), 0.4 * np.cos(0.9 * t), 0.6 * np.sin(0.7 * t)])
    turns, points = [Rotation.identity()], [np.zeros(3)]
    for now, turn in zip(t[:-1], rates / rate, strict=False):
        # Along its travel and up, not sideways, in the middle of each step.
        middle = turns[-1] * Rotation.from_rotvec(turn / 2)
        points.append(points[-1] + middle.apply([0.08, 0.0, 0.03 * np.sin(2.1 * now)]) / rate)
        turns.append(turns[-1] * Rotation.from_rotvec(turn))
    rotations = Rotation.concatenate(turns)
    positions = np.array(points) - rotations.apply([0.05, 0.0, 0.0])
    shaken = Rotation.from_rotvec(rng.normal(scale=noise[1], size=(count, 3)))
    positions += rng.normal(scale=noise[0], size=(count, 3))
    return ns.PoseTrajectory(t, positions, rotations * shaken, name="knife.csv")


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
def knife() -> ns.PoseTrajectory:
    return knife_run()


@pytest.fixture(scope="session")
def primitive(cut: ns.PoseTrajectory) -> ns.ConstrainedDMP:
    rules = [
        ns.Blade(),
        ns.constraints.PlaneContact(),
        ns.KeepOutSphere(center=CENTER, radius=RADIUS),
    ]
    return ns.learn(cut, rules, basis_functions=30)


@pytest.fixture(scope="session")
def cut_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A primitive of a gentle curve, which an arm can follow in 1.5 s."""
    dmp = ns.learn(gentle_cut(), [ns.Blade(), ns.constraints.PlaneContact()])
    return dmp.save(tmp_path_factory.mktemp("primitive") / "cut.json")


@pytest.fixture(scope="session")
def simulate(cut_file: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """Run ``noslip simulate``; return the folder that it wrote."""
    pytest.importorskip("mujoco", reason="the extra robots is not installed")
    pytest.importorskip("daqp", reason="the extra robots is not installed")
    from noslip.cli.simulate import run

    def simulated(**options: object) -> Path:
        out = tmp_path_factory.mktemp("simulated") / "arm"
        run(cut_file, out=out, placement="0.45,0,0.25,0.3", **options)
        return out

    return simulated


@pytest.fixture(scope="session")
def arm_folder(simulate: Callable[..., Path]) -> Path:
    """An arm that is heavier than its controller believes: it sags beside its path."""
    return simulate(dynamics="impedance", model_error=0.1)
