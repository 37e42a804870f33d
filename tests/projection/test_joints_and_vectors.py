"""Trajectory projection of what is no pose: vectors, joints that carry a tool, several tools."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from motions import facing
from noslip import Blade, Boundary, Constraint, KeepOutSphere, PoseTrajectory, check
from noslip._typing import Floats
from noslip.boundary import rotations_of
from noslip.chain import Chain, Joint
from noslip.constraints import ConstraintSystem
from noslip.constraints.instant import Coordinates
from noslip.constraints.joints import JointLimits
from noslip.errors import InputError
from noslip.projection import planner
from noslip.projection.heading import NO_TURN
from noslip.projection.problem import Problem
from noslip.projection.request import LEARNING, Request
from noslip.projection.stage import Stage
from noslip.projection.trajectory import project_trajectory
from noslip.space import Space, several
from noslip.timed import Timed
from noslip.vectors import Trajectory
from strategies import seeds

ARM = Chain(
    [Joint("a"), Joint("b", position=(0.4, 0, 0)), Joint("c", position=(0.3, 0, 0))],
    position=(0.1, 0, 0),
)
"""A planar arm; its tool is 0.1 m beyond the last joint."""
SEVEN = Chain(
    [
        Joint("a"),
        Joint("b", axis=(0, 1, 0), position=(0, 0, 0.3)),
        Joint("c", position=(0, 0, 0.2)),
        Joint("d", axis=(0, 1, 0), position=(0, 0, 0.2)),
        Joint("e", position=(0, 0, 0.2)),
        Joint("f", axis=(0, 1, 0), position=(0, 0, 0.2)),
        Joint("g", position=(0.08, 0, 0)),
    ],
    position=(0, 0, 0.1),
    rotation=(0, 1, 0, 0),
)
"""As an arm of seven joints is built."""


class Left(Blade):
    body = "left"


class Right(Blade):
    body = "right"


class Unicycle(Constraint):
    """``x' sin(theta) - y' cos(theta) = 0`` of coordinates (x, y, theta)."""

    name = "unicycle"
    level = "velocity"
    coordinates = 3

    def residual(self, motion: Coordinates) -> Any:  # type: ignore[override]
        x, y, _ = ca.vertsplit(motion.rates)
        return x * ca.sin(motion.values[2]) - y * ca.cos(motion.values[2])


def planar(askew: float, count: int = 61) -> Trajectory:
    """Joints of the planar arm along a wave of 0.4 m, its blade askew by about an angle (rad)."""
    s = np.linspace(0, 1, count)
    heading = np.arctan2(0.48 * np.cos(6 * s), 0.2) + askew + 0.1 * np.sin(7 * s)
    x = 0.3 + 0.2 * s - 0.1 * np.cos(heading)
    y = 0.1 + 0.08 * np.sin(6 * s) - 0.1 * np.sin(heading)
    b = np.arccos((x**2 + y**2 - 0.4**2 - 0.3**2) / (2 * 0.4 * 0.3))
    a = np.arctan2(y, x) - np.arctan2(0.3 * np.sin(b), 0.4 + 0.3 * np.cos(b))
    values = np.unwrap(np.column_stack([a, b, heading - a - b]), axis=0)
    return Trajectory(2 * s, values, carrier=ARM, name="planar")


def bent(seed: int, count: int = 61) -> Trajectory:
    """A random cut of a tenth of a meter by seven joints, its blade askew by up to 0.3 rad."""
    home = np.array([0.0, 0.4, 0.1, 1.5, 0.1, 1.2, 0.3])
    place, rotation = SEVEN.forward(home)
    tool = facing(seed, count, askew=0.3, duration=2.0)
    led = rotation * tool.rotations[0].inv()
    moved = led.apply(0.1 * (tool.positions - tool.positions[0])) + place
    poses = PoseTrajectory(tool.times, moved, led * tool.rotations)
    return Trajectory(tool.times, SEVEN.inverse(poses, home), carrier=SEVEN, name="bent")


def ridden(count: int = 41) -> Trajectory:
    """A unicycle's wave of about a meter, heading wrongly."""
    s = np.linspace(0, 1, count)
    heading = np.arctan2(0.6 * np.cos(3 * s), 1.0) + 0.2 * np.sin(4 * s)
    values = np.column_stack([s, 0.2 * np.sin(3 * s), heading])
    return Trajectory(2 * s, values, names=("u", "v", "theta"), units=("m", "m", "rad"))


def slip(motion: Trajectory) -> float:
    return float(np.abs(motion.tool.body_velocities[:, 1]).max())


def led(motion: Trajectory, reference: Trajectory) -> float:
    """How far a tool is led from its path (m)."""
    away = motion.tool.positions - reference.tool.positions
    return float(np.linalg.norm(away, axis=1).max())


# -------------------------------------------------------------------- joints


@given(st.floats(-0.6, 0.6))
@settings(max_examples=6)
def test_an_arm_turns_its_blade_into_the_path_and_stays_on_it(askew: float) -> None:
    recorded = planar(askew)
    found = project_trajectory(recorded, [Blade()])
    assert slip(found.trajectory) < 1e-11
    assert check(found.trajectory.tool, [Blade()]).satisfied
    assert led(found.trajectory, recorded) < 1e-3


@given(seeds)
@settings(max_examples=4)
def test_seven_joints_stay_near_where_they_were(seed: int) -> None:
    recorded = bent(seed)
    found = project_trajectory(recorded, [Blade()]).trajectory
    assert slip(found) < 1e-10
    assert led(found, recorded) < 3e-3 * recorded.tool.path_length
    # The turns that the tool needs are shared among joints.
    needed = (found.tool.rotations * recorded.tool.rotations.inv()).magnitude().max()
    assert np.abs(found.values - recorded.values).max() < 3 * needed + 1e-3


@given(seeds)
@settings(max_examples=3)
def test_what_is_feasible_comes_back(seed: int) -> None:
    once = project_trajectory(bent(seed), [Blade()]).trajectory
    again = project_trajectory(once, [Blade()], start="pose").trajectory
    np.testing.assert_allclose(again.values, once.values, atol=1e-6)


def test_ends_of_joints_are_met_with_their_rates() -> None:
    recorded = planar(0.2)
    rates = recorded.velocities[0] * 0.0
    start = Boundary(0.0, recorded.values[0], linear_velocity=rates)
    end = Boundary(1.0, recorded.values[-1] + [0.02, -0.01, 0.0])
    found = project_trajectory(recorded, [Blade()], start=start, end=end).trajectory
    np.testing.assert_allclose(found.values[0], recorded.values[0], atol=1e-14)
    np.testing.assert_allclose(found.values[-1], end.position, atol=1e-14)
    np.testing.assert_array_equal(found.velocities[0], rates)
    assert slip(found) < 1e-11
    # It sets off as slowly as steps allow.
    first, second = np.abs(np.diff(found.values[:3], axis=0)).max(axis=1)
    assert first < second


def test_limits_of_joints_and_of_their_tool_are_kept_together() -> None:
    recorded = planar(0.2)
    free = project_trajectory(recorded, [Blade()]).trajectory
    most = np.quantile(free.values[:, 1], 0.9)
    limits = JointLimits([None] * 3, [None, float(most), None])
    fastest = float(0.9 * np.abs(free.step_velocities()[0][:, 2]).max())
    rates = JointLimits([-9, -9, -fastest], [9, 9, fastest], level="velocity")
    ball = KeepOutSphere(tuple(free.tool.positions[30] + [0.0, 0.02, 0.0]), 0.025)
    found = project_trajectory(recorded, [Blade(), limits, rates, ball]).trajectory
    assert slip(found) < 1e-10
    assert found.values[:, 1].max() <= most + 1e-7
    assert np.abs(found.step_velocities()[0][:, 2]).max() <= fastest + 1e-7
    assert np.linalg.norm(found.tool.positions - ball.center, axis=1).min() >= 0.025 - 1e-7


def test_the_arm_that_ipopt_finds_is_the_same() -> None:
    """The same problem stated anew: complex numbers for the arm, a general solver for the band."""
    recorded = planar(0.25, count=41)
    # From where it is, not from where its tool's own motion leads.
    request = Request(recorded, ConstraintSystem([Blade()], recorded.space))
    found = Problem(request, NO_TURN.turns).solve(40, careful=False)
    assert found.converged
    count, h, T = len(recorded), 1 / (len(recorded) - 1), recorded.duration

    def arm(q: Any) -> tuple[Any, Any, Any]:
        a, b, c = q[0, :], q[0, :] + q[1, :], q[0, :] + q[1, :] + q[2, :]
        x = 0.4 * ca.cos(a) + 0.3 * ca.cos(b) + 0.1 * ca.cos(c)
        return x, 0.4 * ca.sin(a) + 0.3 * ca.sin(b) + 0.1 * ca.sin(c), c

    q, given_ = ca.MX.sym("q", 3, count), ca.DM(recorded.values.T)
    (x, y, heading), (x0, y0, _) = arm(q), arm(given_)
    path = np.array(ca.vertcat(x0, y0)).T
    steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
    speed = np.append(steps[0], steps)
    speed /= speed.mean()
    delta = q - given_
    first, second = (np.diff(np.eye(count), n, axis=0).T for n in (1, 2))

    def square(columns: Any, weights: Any) -> Any:
        return ca.sum2(ca.sum1(columns**2) * ca.DM(weights).T)

    levers = np.zeros(())
    for k in range(3):
        # What the tool moves by with a joint: the distance to it.
        joints = [np.zeros((count, 2)), None, None]
        a, b = recorded.values[:, 0], recorded.values[:, :2].sum(axis=1)
        joints[1] = 0.4 * np.column_stack([np.cos(a), np.sin(a)])
        joints[2] = joints[1] + 0.3 * np.column_stack([np.cos(b), np.sin(b)])
        levers = levers + np.mean(np.sum((path - joints[k]) ** 2, axis=1)) / 3
    bending = LEARNING.rotation_smoothing + LEARNING.position_smoothing * levers / steps.sum() ** 2
    objective = (
        LEARNING.position * h * ca.sum2((x - x0) ** 2 + (y - y0) ** 2) / steps.sum() ** 2
        + square(delta, h * (speed + 1e-3))
        + square(delta @ ca.DM(first), 1e-3 / h / (1 + (speed[1:] / 0.3) ** 2))
        + square(delta @ ca.DM(second), np.full(count - 2, bending / h**3))
    )
    middle = (heading[1:] + heading[:-1]) / 2
    across = (y[1:] - y[:-1]) * ca.cos(middle) - (x[1:] - x[:-1]) * ca.sin(middle)
    solver = ca.nlpsol(
        "oracle",
        "ipopt",
        {"x": ca.vec(q), "f": objective, "g": across / (h * T)},
        {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-11}},
    )
    solved = solver(x0=recorded.values.ravel(), lbg=0, ubg=0)
    assert solver.stats()["success"]
    theirs = np.array(solved["x"]).reshape(count, 3)
    np.testing.assert_allclose(found.trajectory.values, theirs, atol=1e-4)


def test_joints_go_round_and_round() -> None:
    a = 2 * np.pi * np.linspace(0, 1, 61)
    places = np.column_stack([0.45 + 0.05 * np.cos(a), 0.2 + 0.04 * np.sin(a), 0 * a])
    way = np.column_stack([-0.05 * np.sin(a), 0.04 * np.cos(a)])
    held = Rotation.from_euler("z", np.unwrap(np.arctan2(way[:, 1], way[:, 0])) + 0.2 * np.sin(a))
    values = ARM.inverse(PoseTrajectory(a / np.pi, places, held), [-0.2, 1.2, 0.5])
    # A wrist that turns on and on, of which nothing repeats but where its tool is.
    assert abs(values[-1, 2] - values[0, 2]) == pytest.approx(2 * np.pi, abs=1e-6)
    with pytest.raises(InputError, match=r"a period ends where it begins, but this ends 6\.28"):
        project_trajectory(Trajectory(a / np.pi, values, carrier=ARM), [Blade()], periodic=True)
    # One that goes to and fro.
    saw = planar(0.1, count=31).values
    there = Trajectory(a / np.pi, np.vstack([saw, saw[-2::-1]]), carrier=ARM)
    found = project_trajectory(there, [Blade()], periodic=True).trajectory
    np.testing.assert_array_equal(found.values[-1], found.values[0])
    assert slip(found) < 1e-11


# -------------------------------------------------------------------- vectors


def test_the_unicycle_that_ipopt_finds_is_the_same() -> None:
    recorded = ridden()
    found = project_trajectory(recorded, [Unicycle()], start="position")
    x, h, count = found.trajectory.values, recorded.period, len(recorded)
    v = np.diff(x, axis=0) / h
    middle = (x[1:, 2] + x[:-1, 2]) / 2
    assert np.abs(v[:, 0] * np.sin(middle) - v[:, 1] * np.cos(middle)).max() < 1e-12
    np.testing.assert_array_equal(x[0], recorded.values[0])
    z = ca.MX.sym("z", 3, count)
    second = np.diff(np.eye(count), 2, axis=0).T * (count - 1) ** 2
    smooth = LEARNING.position_smoothing / LEARNING.position
    steps, theta = z[:, 1:] - z[:, :-1], (z[2, 1:] + z[2, :-1]) / 2
    delta = z - ca.DM(recorded.values.T)
    solver = ca.nlpsol(
        "oracle",
        "ipopt",
        {
            "x": ca.vec(z),
            "f": ca.sumsqr(delta) + smooth * ca.sumsqr(delta @ ca.DM(second)),
            "g": (steps[0, :] * ca.sin(theta) - steps[1, :] * ca.cos(theta)) / h,
        },
        {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-11}},
    )
    lower, upper = np.full((count, 3), -np.inf), np.full((count, 3), np.inf)
    lower[0] = upper[0] = recorded.values[0]
    solved = solver(x0=recorded.values.ravel(), lbx=lower.ravel(), ubx=upper.ravel(), lbg=0, ubg=0)
    assert solver.stats()["success"]
    theirs = np.array(solved["x"]).reshape(count, 3)
    np.testing.assert_allclose(x, theirs, atol=1e-5)


def test_a_place_alone_keeps_out_of_a_ball() -> None:
    """The nearest of a straight line, with no smoothing to speak of, lies on the ball."""
    s = np.linspace(0, 1, 61)
    line = Trajectory(2 * s, np.column_stack([s, 0.02 + 0 * s, 0 * s]), names=("x", "y", "z"))
    ball = KeepOutSphere((0.5, 0.0, 0.0), 0.1)
    found = project_trajectory(line, [ball], start="position", end="position").trajectory
    away = np.linalg.norm(found.values - ball.center, axis=1)
    assert 0.1 - 1e-7 < away.min() < 0.1 + 1e-4
    np.testing.assert_allclose(found.values[:, 2], 0.0, atol=1e-7)


def test_what_does_not_fit_is_refused() -> None:
    motion = ridden()
    with pytest.raises(InputError, match="hold_position=True leaves the rotation"):
        project_trajectory(motion, [Unicycle()], hold_position=True)
    with pytest.raises(InputError, match="its position has 2 numbers, but what moves has 3"):
        project_trajectory(motion, [Unicycle()], end=Boundary(1.0, [1.0, 0.0]))
    with pytest.raises(InputError, match="its quaternion has 4 numbers, but what moves has none"):
        end = Boundary(1.0, [1.0, 0.0, 0.0], Rotation.identity())
        project_trajectory(motion, [Unicycle()], end=end)
    with pytest.raises(InputError, match="system of another space"):
        project_trajectory(motion, ConstraintSystem([Blade()]))
    with pytest.raises(InputError, match="3 coordinates and 0 rotations a sample"):
        Request(motion, ConstraintSystem([Blade()]))


# -------------------------------------------------------------------- several tools


@dataclass(frozen=True, eq=False)
class Tools(Timed):
    """Poses of two tools."""

    times: Floats
    points: Floats
    name: str = "tools"

    @property
    def space(self) -> Space:
        return several(["left", "right"])

    @property
    def positions(self) -> Floats:  # type: ignore[override]
        return self.points[:, :6]

    @property
    def quaternions(self) -> Floats:
        return self.points[:, 6:]

    @property
    def linear_velocities(self) -> Floats:
        return np.gradient(self.positions, self.times, axis=0)

    @property
    def angular_velocities(self) -> Floats:
        return np.zeros((len(self), 6))

    def step_velocities(self) -> tuple[Floats, Floats]:
        moved = self.space.difference(self.points[1:], self.points[:-1])
        moved /= np.diff(self.times)[:, None]
        return moved[:, :6], moved[:, 6:]

    def with_points(self, points: Floats, times: Floats | None = None) -> Tools:
        return Tools(self.times if times is None else times, points, self.name)

    def with_velocities(self, linear: Floats, angular: Floats) -> Tools:
        return self


def both(seed: int, count: int = 41) -> tuple[Tools, list[Any]]:
    tools = [facing(seed + k, count) for k in range(2)]
    parts = [each.positions for each in tools] + [each.quaternions for each in tools]
    return Tools(tools[0].times, np.hstack(parts)), tools


def test_two_tools_are_projected_as_each_alone() -> None:
    motion, tools = both(3)
    rules = [Left(), Right()]
    # Of rotations alone, which do not share a length.
    found = project_trajectory(motion, rules, position_weight=1e9).trajectory
    for k, tool in enumerate(tools):
        alone = project_trajectory(tool, [Blade()], position_weight=1e9).trajectory
        at = slice(6 + 4 * k, 10 + 4 * k)
        rotations = Rotation.from_quat(found.points[:, at], scalar_first=True)
        # How turns are weighed by the speed, that of both together is not that of either.
        assert (rotations * alone.rotations.inv()).magnitude().max() < 0.05
        np.testing.assert_allclose(found.points[:, 3 * k : 3 * k + 3], alone.positions, atol=1e-4)
        moved = np.diff(found.points[:, 3 * k : 3 * k + 3], axis=0) / tool.period
        middle = Rotation.from_quat(found.points[1:, at] + found.points[:-1, at], scalar_first=True)
        assert np.abs(middle.inv().apply(moved)[:, 1]).max() < 1e-11


# -------------------------------------------------------------------- in machine code


@pytest.mark.parametrize("kind", ["joints", "vectors", "tools"])
def test_machine_code_finds_what_numpy_finds(
    kind: str, compiling: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    motion, rule = {
        "joints": lambda: (planar(0.2), Blade()),
        "vectors": lambda: (ridden(), Unicycle()),
        "tools": lambda: (both(3)[0], Left()),
    }[kind]()
    ends = ()
    if kind == "tools":
        # What turns set off with is solved for each rotation in closed form.
        pose = Boundary(0.0, motion.positions[0], rotations_of(motion.quaternions[0]))
        twist = (motion.step_velocities()[0][0], motion.step_velocities()[1][0])
        ends = (replace(pose, linear_velocity=twist[0], angular_velocity=twist[1]),)
    request = Request(motion, ConstraintSystem([rule], motion.space), ends)
    native = Problem(request, NO_TURN.turns).solve(60, careful=False)
    assert planner.native(Stage.of(request.system, hold_position=False)).wait() is not None
    monkeypatch.setattr(planner, "_compiled", lambda stage: None)
    numpy = Problem(request, NO_TURN.turns).solve(60, careful=False)
    assert native.converged
    assert native.iterations == numpy.iterations
    np.testing.assert_allclose(native.trajectory.points, numpy.trajectory.points, atol=1e-9)
