"""The edge of a tool, and what moves under it, wherever the work and its point are."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip import Constraint, PoseTrajectory
from noslip.constraints import ConstraintSystem
from noslip.constraints.catalog import restore, specification
from noslip.constraints.edge_motion import edge_motion, edge_steps, work_moves
from noslip.edge import Edge
from noslip.errors import ConstraintError
from noslip.merit import figures_of_merit
from noslip.projection.heading import _smoothed, turn_edge_into_path
from noslip.projection.trajectory import project_trajectory
from strategies import seeds

SPEED, SMOOTHING = 0.05, 1e-6
BELT = (0.0, 0.3, 0.0)
STILL = {"amplitude": (0.0, 0.0, 0.0)}


def cut(samples: int = 301, duration: float = 2.0, off: float = 0.0) -> PoseTrajectory:
    """An S-cut with its edge along the path, turned away by up to an angle (rad)."""
    s = np.linspace(0, 1, samples)
    yaw = 0.9 * np.sin(2 * np.pi * s) * np.sin(np.pi * s)
    step = SPEED * duration / (samples - 1)
    middle = (yaw[1:] + yaw[:-1]) / 2
    path = np.cumsum(step * np.column_stack([np.cos(middle), np.sin(middle), 0 * middle]), axis=0)
    wrong = off * np.sin(5 * s)
    return PoseTrajectory(
        duration * s, np.vstack([np.zeros(3), path]), Rotation.from_euler("z", yaw + wrong)
    )


def carried(motion: PoseTrajectory, frame: ns.constraints.InMovingFrame) -> PoseTrajectory:
    """Return the motion of a tool in the world that makes this one in a frame."""
    t = ca.SX.sym("t")
    poses = [ca.Function("f", [t], list(frame.pose(t)))(time) for time in motion.clock]
    origins = np.array([np.array(c).ravel() for c, _ in poses])
    turns = Rotation.from_matrix(np.array([np.array(R) for _, R in poses]))
    return PoseTrajectory(
        motion.times, origins + turns.apply(motion.positions), turns * motion.rotations
    )


def on_belt(blade: Constraint | None = None) -> ns.constraints.InMovingFrame:
    return ns.constraints.InMovingFrame(blade or ns.Blade(), velocity=BELT, **STILL)  # type: ignore[arg-type]


def from_point(motion: PoseTrajectory, point: tuple[float, float, float]) -> PoseTrajectory:
    """Return the motion whose body-fixed point moves like the origin of this one."""
    return PoseTrajectory(
        motion.times, motion.positions - motion.rotations.apply(point), motion.rotations
    )


# ---------------------------------------------------------------- the value


def test_an_edge_knows_its_axes_and_its_point() -> None:
    edge, turn = Edge("-x", "z", (0.1, 0, 0)), Rotation.from_euler("z", [0.0, np.pi / 2])
    np.testing.assert_allclose(edge.travel_axes(turn), [[-1, 0, 0], [0, -1, 0]], atol=1e-15)
    np.testing.assert_allclose(edge.lateral_axes(turn), [[0, 0, 1], [0, 0, 1]], atol=1e-15)
    np.testing.assert_allclose(edge.points(np.zeros((2, 3)), turn)[1], [0, 0.1, 0], atol=1e-15)
    spin = np.array([[0.0, 0.0, 2.0]] * 2)
    found = edge.velocities(turn, np.ones((2, 3)), spin)
    np.testing.assert_allclose(found, [[1, 1.2, 1], [0.8, 1, 1]], atol=1e-15)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("w", "y"), "travel"),
        (("x", "q"), "lateral"),
        (("x", "-x"), "parallel"),
        (("x", "y", (0, 1)), "point"),
    ],
)
def test_what_is_no_edge_is_refused(arguments: Any, words: str) -> None:
    with pytest.raises(ConstraintError, match=words) as caught:
        Edge(*arguments)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("constraint", "expected"),
    [
        (ns.Blade("z", "-x", (1, 2, 3)), Edge("-x", "z", (1.0, 2.0, 3.0))),
        (ns.Wheel("-z", "y", reference_point=(0, 0, 1)), Edge("y", "-z", (0.0, 0.0, 1.0))),
        (ns.Needle("-y", bevel="x"), Edge("-y", "z")),
        (
            ns.constraints.ForwardOnly("z", reference_point=(1, 0, 0)),
            Edge("z", None, (1.0, 0.0, 0.0)),
        ),
        (on_belt(ns.Blade(edge="z", reference_point=(1, 0, 0))), Edge("z", "y", (1.0, 0.0, 0.0))),
        (ns.SpeedLimit(), None),
    ],
)
def test_each_constraint_names_its_edge(constraint: Constraint, expected: Edge | None) -> None:
    assert constraint.edge == expected
    assert restore(specification(constraint)).edge == expected


def test_other_arguments_of_the_same_blade_move_its_edge() -> None:
    blade = replace(ns.Blade(edge="-x"), lateral="z", reference_point=(0, 0, 1))
    assert blade.edge == Edge("-x", "z", (0.0, 0.0, 1.0))
    assert blade == ns.Blade("z", "-x", (0, 0, 1))


def test_of_several_the_one_that_knows_its_lateral_axis_is_asked() -> None:
    forward, blade = ns.constraints.ForwardOnly(), ns.Blade()
    assert ConstraintSystem([forward, blade]).edged is blade
    assert ConstraintSystem([ns.SpeedLimit(), forward]).edged is forward
    assert ConstraintSystem([ns.SpeedLimit()]).edged is None


# ---------------------------------------------------------------- relative to the work


def tumbling(t: Any) -> Any:
    c, s = ca.cos(2 * t), ca.sin(2 * t)
    return ca.vertcat(0.1 * t, 0.05 * ca.sin(3 * t), 0.2), [[c, -s, 0], [s, c, 0], [0, 0, 1]]


FRAMES = {
    "belt": on_belt(),
    "breathing": ns.constraints.InMovingFrame(
        amplitude=(0, 0.01, 0.02), rotation_amplitude=(0.2, 0, 0.4)
    ),
    "turntable": ns.constraints.InMovingFrame(frame=tumbling),
    "nested": ns.constraints.InMovingFrame(on_belt(), frame=tumbling),
}


@pytest.mark.parametrize("name", FRAMES)
def test_a_motion_that_a_frame_carries_looks_from_it_as_it_was(name: str) -> None:
    frame, motion = FRAMES[name], cut()
    inner = frame.inner
    there = carried(motion, frame)
    if isinstance(inner, ns.constraints.InMovingFrame):
        there = carried(carried(motion, inner), frame)
    for constraint in (frame, restore(specification(frame))):
        seen = edge_motion(constraint, there.clock, there.positions, there.rotations)
        np.testing.assert_allclose(seen.points, motion.positions, atol=1e-12)
        assert (seen.rotations * motion.rotations.inv()).magnitude().max() < 1e-12
        found = turn_edge_into_path(there, ConstraintSystem(constraint), SMOOTHING)
        assert found.backing == 0
        # Turns are about the axes of the world; how far is the same.
        expected = turn_edge_into_path(motion, ConstraintSystem(ns.Blade()), SMOOTHING)
        assert np.abs(found.turns).max() < np.abs(expected.turns).max() + 0.02


def test_velocities_from_there_are_those_of_the_poses_from_there() -> None:
    frame, h, t = FRAMES["nested"], 1e-5, 0.7
    twist, turning = np.array([0.1, -0.2, 0.3]), np.array([0.5, 0.6, -0.7])
    p, R = np.array([0.3, 0.2, 0.1]), Rotation.from_euler("xyz", [0.1, 0.2, 0.3])

    def at(time: float) -> np.ndarray[Any, Any]:
        turned = Rotation.from_rotvec(turning * (time - t)) * R
        return edge_motion(frame, time, p + twist * (time - t), turned).points[0]

    found = edge_motion(frame, t, p, R, twist, turning)
    np.testing.assert_allclose(found.velocities[0], (at(t + h) - at(t - h)) / (2 * h), atol=1e-8)


def test_a_user_says_what_moves_in_a_method() -> None:
    class OnBelt(Constraint):
        name, edge = "on belt", Edge()

        def relative(self, motion: ns.constraints.Instant) -> ns.constraints.Instant:
            return replace(motion, linear_velocity=motion.linear_velocity - ca.DM(list(BELT)))

        def residual(self, motion: ns.constraints.Instant) -> Any:
            seen = self.relative(motion)
            return ca.dot(seen.rotation[:, 1], seen.linear_velocity)

    for constraint in (OnBelt(), restore(specification(OnBelt()))):
        assert work_moves(constraint)
        seen = edge_motion(constraint, 0.0, np.zeros(3), Rotation.identity(), np.array([1, 0.3, 0]))
        np.testing.assert_allclose(seen.velocities, [[1, 0, 0]], atol=1e-15)
        assert seen.lateral_speed == pytest.approx([0.0], abs=1e-15)
    assert not work_moves(ns.Blade())


# ---------------------------------------------------------------- what it is for


def test_a_cut_on_a_belt_is_projected_like_one_at_rest() -> None:
    motion = carried(cut(off=0.1), on_belt())
    found = project_trajectory(motion, on_belt())
    at_rest = project_trajectory(cut(off=0.1), ns.Blade())
    assert found.iterations <= max(5, at_rest.iterations)
    assert found.smoothing == at_rest.smoothing == SMOOTHING
    assert found.backing == 0
    held = project_trajectory(motion, on_belt(), hold_position=True).trajectory.rotations
    still = project_trajectory(cut(off=0.1), ns.Blade(), hold_position=True).trajectory.rotations
    turn = held * still.inv()
    assert turn.magnitude().max() < 1e-2


@pytest.mark.parametrize("still", [False, True])
def test_a_blade_away_from_the_origin_does_not_back_up(still: bool) -> None:
    point = (0.0, -0.2, 0.0)
    blade: Constraint = ns.Blade(reference_point=point)
    if still:
        blade = ns.constraints.InMovingFrame(blade, **STILL)  # type: ignore[arg-type]
    motion = from_point(cut(off=0.1), point)
    found = turn_edge_into_path(motion, ConstraintSystem(blade), SMOOTHING)
    assert found.backing == 0
    assert np.abs(found.turns).max() < 0.15


@pytest.mark.parametrize("where", ["belt", "point", "both"])
def test_the_slowest_edge_speed_is_that_of_the_edge_over_the_work(where: str) -> None:
    point = (0.0, 0.0, 0.0) if where == "belt" else (0.0, -0.2, 0.0)
    blade: Constraint = ns.Blade(reference_point=point)
    motion = from_point(cut(), point)
    if where != "point":
        motion, blade = carried(motion, on_belt()), on_belt(blade)
    assert figures_of_merit(motion, motion, blade).slowest_edge_speed == pytest.approx(
        SPEED, rel=0.01
    )
    steps = edge_steps(motion, blade)
    assert np.abs(steps.slip_angles).max() < 0.02
    np.testing.assert_allclose(np.linalg.norm(steps.velocities, axis=1), SPEED, rtol=0.01)


@given(seeds, st.integers(4, 40), st.sampled_from([1e-9, 1e-6, 1e-3]))
def test_turns_are_smoothed_as_a_dense_solve_does(seed: int, count: int, smoothing: float) -> None:
    """Least ``sum w |x - value|^2 + smoothing |x''|^2``, time from 0 to 1, as it is written."""
    rng = np.random.default_rng(seed)
    values, weights = rng.normal(size=(count, 3)), rng.uniform(0.5, 2.0, count)
    bent = np.diff(np.eye(count), 2, axis=0) * (count - 1) ** 2
    rows = np.vstack([np.diag(np.sqrt(weights)), np.sqrt(smoothing) * bent])
    wanted = np.vstack([np.sqrt(weights)[:, None] * values, np.zeros((count - 2, 3))])
    dense = np.linalg.lstsq(rows, wanted, rcond=None)[0]
    np.testing.assert_allclose(_smoothed(values, weights, smoothing), dense, atol=1e-5)


@pytest.mark.parametrize("count", [4_001, 12_001, 50_001])
def test_turns_that_are_steady_are_smoothed_as_they_are_however_many(count: int) -> None:
    # A straight line has no second derivative, in the means of several samples neither.
    values = np.linspace(0.0, 1.0, count)[:, None] * [1.0, -2.0, 0.5]
    found = _smoothed(values, np.ones(count), 1e-8)
    inner = slice(count // 10, -count // 10)
    np.testing.assert_allclose(found[inner], values[inner], rtol=0, atol=1e-7)
