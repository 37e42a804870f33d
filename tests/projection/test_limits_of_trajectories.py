"""Limits in the trajectory projection: kept, nearest (against IPOPT), and left out when soft."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from scipy.spatial.transform import Rotation

import noslip as ns
from measures import slip
from motions import along, waving
from noslip import Blade, Constraint, PoseTrajectory, project_trajectory
from noslip._typing import Floats
from noslip.constraints import ConstraintSystem
from noslip.projection.request import LEARNING
from noslip.projection.result import ProjectedTrajectory
from strategies import seeds

BLADE = Blade()


def cut(seed: int, count: int = 201) -> PoseTrajectory:
    """A random smooth curve of 1.5 m in 2 s, with the edge a little beside its path."""
    rng = np.random.default_rng(seed)
    s = np.linspace(0, 1, count)
    x = waving(rng, s, 2)
    beside = Rotation.from_euler("z", 0.2 * np.sin(3 * s + rng.uniform(0, 6)))
    return PoseTrajectory(2 * s, x, beside * along(x, s), name=f"cut {seed}")


def speeds(motion: PoseTrajectory) -> Floats:
    return np.asarray(
        np.linalg.norm(np.diff(motion.positions, axis=0), axis=1) / np.diff(motion.times)
    )


def binding(name: str, given: PoseTrajectory) -> Constraint:
    """A limit that the cut itself violates."""
    middle = given.positions[len(given) // 2]
    if name == "half-space":
        top = given.positions[:, 1].max()
        return ns.constraints.HalfSpace(point=(0, top - 0.02, 0), normal=(0, -1, 0))
    if name == "keep-out sphere":
        return ns.KeepOutSphere(center=middle + [0, 0.03, 0.02], radius=0.1)
    if name == "keep-out capsule":
        return ns.constraints.KeepOutCapsule(
            start=middle + [0, 0.02, -0.2], end=middle + [0, 0.02, 0.2]
        )
    if name == "speed":
        return ns.SpeedLimit(speed=0.95 * speeds(given).max())
    if name == "angular rate":
        turns = given.step_velocities()[1]
        return ns.constraints.AngularRateLimit(rate=0.9 * np.linalg.norm(turns, axis=1).max())
    if name == "acceleration":
        bend = np.diff(given.positions, 2, axis=0) / given.period**2
        return ns.constraints.AccelerationLimit(linear=0.9 * np.linalg.norm(bend, axis=1).max())
    raise AssertionError(name)


BINDING = [
    "half-space", "keep-out sphere", "keep-out capsule", "speed", "angular rate", "acceleration",
]  # fmt: skip


@pytest.mark.parametrize("name", BINDING)
@given(seeds)
@settings(max_examples=5)
def test_limits_are_kept_and_the_blade_does_not_slip(name: str, seed: int) -> None:
    demonstration = cut(seed)
    limit = binding(name, demonstration)
    without = project_trajectory(demonstration, BLADE)
    found = project_trajectory(demonstration, [limit, BLADE])
    assert found.residual <= 1e-10
    assert found.margins.shape == (len(demonstration), 1)
    assert found.margins.min() >= -1e-7
    assert np.abs(slip(found.trajectory)).max() <= 1e-10
    # The margins are those of the motion itself.
    system = ConstraintSystem(limit)
    if limit.level != "acceleration":
        linear, angular = found.trajectory.step_velocities()
        margins = system.residuals(
            found.trajectory.times[1:],
            found.trajectory.positions[1:],
            found.trajectory.quaternions[1:],
            linear,
            angular,
        )
        np.testing.assert_allclose(found.margins[1:], margins, rtol=0, atol=1e-12)
    # It was in the way, and is all but reached; a rate may have fallen without it.
    in_the_way = cost(demonstration, found) > cost(demonstration, without) * (1 + 1e-9)
    assert found.margins.min() <= 1e-3 or not in_the_way
    assert cost(demonstration, found) >= cost(demonstration, without) - 1e-9


@given(seeds)
@settings(max_examples=10)
def test_limits_that_are_kept_anyway_change_nothing(seed: int) -> None:
    demonstration = cut(seed)
    without = project_trajectory(demonstration, BLADE)
    limits = [
        ns.constraints.Box(lower=(-9, -9, -9), upper=(9, 9, 9)),
        ns.SpeedLimit(speed=50.0),
        ns.constraints.AccelerationLimit(linear=1e4, angular=1e5),
    ]
    found = project_trajectory(demonstration, [BLADE, *limits])
    np.testing.assert_allclose(
        found.trajectory.positions, without.trajectory.positions, rtol=0, atol=1e-14
    )
    np.testing.assert_allclose(found.turns, without.turns, rtol=0, atol=1e-13)
    assert found.iterations == without.iterations


@given(seeds)
@settings(max_examples=5)
def test_what_keeps_its_limits_comes_back_unchanged(seed: int) -> None:
    demonstration = cut(seed)
    rules = [BLADE, binding("half-space", demonstration), binding("speed", demonstration)]
    once = project_trajectory(demonstration, rules).trajectory
    twice = project_trajectory(once, rules).trajectory
    np.testing.assert_allclose(twice.positions, once.positions, rtol=0, atol=1e-9)
    assert (twice.rotations * once.rotations.inv()).magnitude().max() <= 1e-9


# -------------------------------------------------------------------- against IPOPT


def corrections(given: PoseTrajectory, found: ProjectedTrajectory) -> Floats:
    length = given.path_length
    moved = (found.trajectory.positions - given.positions) / length
    return np.hstack([found.turns, moved])


def weights(given: PoseTrajectory) -> tuple[Floats, Floats, Floats]:
    """Of each correction, its first and its second differences (the documented cost)."""
    count = len(given)
    h = 1 / (count - 1)
    speed = speeds(given)
    relative = np.concatenate([speed[:1], speed]) / np.concatenate([speed[:1], speed]).mean()
    size = np.full((count, 6), LEARNING.position * h)
    size[:, :3] = h * (relative[:, None] + 1e-3)
    bend = np.array([LEARNING.rotation_smoothing] * 3 + [LEARNING.position_smoothing] * 3) / h**3
    slope = np.zeros((count - 1, 6))
    slope[:, :3] = 1e-3 / (1 + (relative[1:, None] / 0.3) ** 2) / h
    return size, slope, bend


def cost(given: PoseTrajectory, found: ProjectedTrajectory) -> float:
    z = corrections(given, found)
    size, slope, bend = weights(given)
    changes = np.sum(slope * np.diff(z, axis=0) ** 2) + np.sum(bend * np.diff(z, 2, axis=0) ** 2)
    return float(np.sum(size * z**2) + changes) / 2


def matrix(turn: Any) -> Any:
    """Rodrigues' formula, regular at zero."""
    angle = ca.sqrt(ca.sumsqr(turn) + 1e-30)
    K = ca.skew(turn) / angle
    return ca.DM.eye(3) + ca.sin(angle) * K + (1 - ca.cos(angle)) * (K @ K)


def root(turn: Any) -> Any:
    """Of a rotation by less than half a turn: the one by half its angle, about the same axis."""
    cosine = ca.sqrt(1 + ca.trace(turn)) / 2
    one = ca.DM.eye(3)
    bent = (turn + turn.T) / 2 - one
    return one + (turn - turn.T) / (4 * cosine) + bent / (2 * (1 + cosine))


@pytest.mark.parametrize("name", ["half-space", "keep-out sphere", "speed", "acceleration"])
def test_the_result_is_the_one_that_ipopt_finds(name: str) -> None:
    # The same problem stated anew: matrices for quaternions, a general solver for the banded one.
    demonstration = cut(5, count=41)
    limit = binding(name, demonstration)
    found = project_trajectory(demonstration, [BLADE, limit])
    count, length, h = len(demonstration), demonstration.path_length, demonstration.period
    size, slope, bend = weights(demonstration)

    z = ca.MX.sym("z", 6, count)
    R = [matrix(z[:3, k]) @ ca.DM(demonstration.rotations[k].as_matrix()) for k in range(count)]
    p = ca.DM(demonstration.positions.T) + length * z[3:, :]
    v = (p[:, 1:] - p[:, :-1]) / h
    second = z[:, 2:] - 2 * z[:, 1:-1] + z[:, :-2]
    first = z[:, 1:] - z[:, :-1]
    objective = (
        ca.sum1(ca.sum2(ca.DM(size.T) * z**2))
        + ca.sum1(ca.sum2(ca.DM(slope.T) * first**2))
        + ca.sum1(ca.sum2(ca.DM(bend) * second**2))
    ) / 2
    slip = [(R[k - 1] @ root(R[k - 1].T @ R[k]))[:, 1].T @ v[:, k - 1] for k in range(1, count)]
    if name == "half-space":
        margins = [limit.point[1] - p[1, k] for k in range(count)]  # type: ignore[attr-defined]
    elif name == "keep-out sphere":
        center, radius = ca.DM(limit.center), limit.radius  # type: ignore[attr-defined]
        margins = [ca.norm_2(p[:, k] - center) - radius for k in range(count)]
    elif name == "speed":
        fastest = limit.speed  # type: ignore[attr-defined]
        margins = [fastest - ca.norm_2(v[:, k]) for k in range(count - 1)]
    else:
        most = limit.linear  # type: ignore[attr-defined]
        margins = [most**2 - ca.sumsqr((v[:, k + 1] - v[:, k]) / h) for k in range(count - 2)]
    solver = ca.nlpsol(
        "oracle",
        "ipopt",
        {"x": ca.vec(z), "f": objective, "g": ca.vertcat(*slip, *margins)},
        {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-11}},
    )
    guess = corrections(demonstration, found) + 1e-3 * np.random.default_rng(0).normal(
        size=(count, 6)
    )
    zeros = np.zeros(len(slip))
    solved = solver(
        x0=guess.ravel(),
        lbg=np.concatenate([zeros, np.zeros(len(margins))]),
        ubg=np.concatenate([zeros, np.full(len(margins), np.inf)]),
    )
    assert solver.stats()["success"]
    ours, theirs = cost(demonstration, found), float(solved["f"])
    assert ours == pytest.approx(theirs, rel=1e-5)
    nearest = np.array(solved["x"]).reshape(count, 6)
    np.testing.assert_allclose(
        corrections(demonstration, found)[:, 3:], nearest[:, 3:], rtol=0, atol=2e-5
    )


# -------------------------------------------------------------------- what gives way


@pytest.mark.parametrize("priority", [1, 3])
def test_a_soft_limit_that_contradicts_a_hard_one_is_left_out(priority: int) -> None:
    inside = ns.constraints.HalfSpace(point=(0.5, 0, 0), normal=(-1, 0, 0))
    outside = ns.constraints.HalfSpace(point=(0.6, 0, 0), normal=(1, 0, 0), priority=priority)
    found = project_trajectory(cut(3), [BLADE, inside, outside])
    assert found.converged
    assert found.left_out == ("half-space 2",)
    assert found.trajectory.positions[:, 0].max() <= 0.5 + 1e-7


def test_soft_limits_are_left_out_the_least_important_first() -> None:
    demonstration = cut(3)
    inside = ns.constraints.HalfSpace(point=(0.5, 0, 0), normal=(-1, 0, 0))
    outside = ns.constraints.HalfSpace(point=(0.6, 0, 0), normal=(1, 0, 0), priority=2)
    slow = ns.SpeedLimit(speed=5.0, priority=1)
    found = project_trajectory(demonstration, [BLADE, inside, outside, slow])
    assert found.left_out == ("half-space 2",)
    assert found.trajectory.positions[:, 0].max() <= 0.5 + 1e-7


def test_hard_limits_that_contradict_each_other_are_refused_by_name() -> None:
    inside = ns.constraints.HalfSpace(point=(0.5, 0, 0), normal=(-1, 0, 0))
    outside = ns.constraints.HalfSpace(point=(0.6, 0, 0), normal=(1, 0, 0))
    with pytest.raises(
        ns.errors.ConstraintError, match="'half-space' and 'half-space 2' seem to contradict"
    ):
        ns.learn(cut(3), [BLADE, inside, outside])


def test_a_wall_that_learning_cannot_heed_is_refused_by_name() -> None:
    # Across the path of a position that is held: the projection has nothing to give.
    wall = ns.constraints.HalfSpace(point=(0.7, 0, 0), normal=(-1, 0, 0))
    with pytest.raises(ns.errors.MissedError, match="half-space in its way"):
        ns.learn(cut(4), [BLADE, wall], hold_position=True)


# Limits on speeds and accelerations are given time instead.
@pytest.mark.parametrize("name", BINDING[:3])
def test_a_primitive_learned_with_a_limit_keeps_it(name: str) -> None:
    demonstration = cut(8)
    limit = binding(name, demonstration)
    dmp = ns.learn(demonstration, [BLADE, limit])
    assert dmp.record[0].left_out == ()
    motion = dmp.rollout()
    assert np.abs(motion.constraint_residuals).max() <= 1e-10
    # The first step follows from the start alone: an acceleration limit knows none before it.
    assert motion.margins[1:].min() >= -1e-6
    assert not [entry for entry in motion.gave_way if entry.violation > 1e-6]
    reach = np.ptp(demonstration.positions, axis=0).max()
    projected = project_trajectory(demonstration, [BLADE, limit]).trajectory
    same = motion.resampled(times=projected.times) if len(motion) != len(projected) else motion
    off = np.linalg.norm(same.positions - projected.positions, axis=1)
    assert np.sqrt(np.mean(off**2)) <= 0.01 * reach
