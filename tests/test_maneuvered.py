"""Goals that nothing near the demonstration leads to are reached by maneuvers."""

from __future__ import annotations

import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.constraints import (
    AngularRateLimit,
    Constraint,
    ConstraintSystem,
    ForwardOnly,
    KeepOutSphere,
    TurningRadius,
)
from noslip.errors import ConvergenceError, InputError, Refusal, muted
from noslip.maneuvers.planar import dubins, reeds_shepp
from noslip.maneuvers.search import _LEVELS
from noslip.rule import Rule

pytestmark = pytest.mark.usefixtures("compiling")

RADIUS = 0.3
HEADING_LEFT = Rotation.from_euler("z", 90, degrees=True)


def turned(angle: float) -> Rotation:
    return Rotation.from_rotvec([0, 0, angle])


def straight(bend: float = 0.0) -> ns.PoseTrajectory:
    """A meter ahead in 4 s by minimum jerk; with a bend, along a sine of that amplitude."""
    share = np.linspace(0, 1, 201)
    x = share**3 * (10 - 15 * share + 6 * share**2)
    y, slope = bend * np.sin(2 * np.pi * x), 2 * np.pi * bend * np.cos(2 * np.pi * x)
    turns = np.column_stack([0 * x, 0 * x, np.arctan(slope)])
    return ns.PoseTrajectory(4 * share, np.column_stack([x, y, 0 * x]), Rotation.from_rotvec(turns))


def learned(*constraints: Constraint, bend: float = 0.0) -> ns.ConstrainedDMP:
    return ns.learn([straight(bend)], constraints=list(constraints))


@pytest.fixture(scope="module")
def car() -> ns.ConstrainedDMP:
    return learned(ns.Wheel(), TurningRadius(RADIUS))


@pytest.fixture(scope="module")
def parking() -> ns.ConstrainedDMP:
    return learned(ns.Wheel(), TurningRadius(RADIUS, reverse=True))


def adapted(dmp: ns.ConstrainedDMP, x: float, y: float, angle: float, **options: Any) -> Any:
    with muted():
        return dmp.adapt(goal_position=[x, y, 0], goal_rotation=turned(angle), **options)


def assert_ends(motion: ns.Motion, x: float, y: float, angle: float) -> None:
    assert np.linalg.norm(motion.positions[-1] - [x, y, 0]) <= 1e-4
    assert (motion.rotations[-1] * turned(angle).inv()).magnitude() <= 1e-3


def backed(motion: ns.Motion) -> float:
    """Way (m) that the body's x axis moved backwards."""
    heading = motion.rotations.as_matrix()[1:, :, 0]
    steps = np.diff(motion.positions, axis=0)
    return float(-np.minimum(np.einsum("ij,ij->i", heading, steps), 0).sum())


def poses(count: int, seed: int) -> list[tuple[float, float, float]]:
    rng = np.random.default_rng(seed)
    found = np.column_stack([rng.uniform(-1.5, 1.5, (count, 2)), rng.uniform(-np.pi, np.pi, count)])
    return [tuple(each) for each in found.tolist()]


@pytest.mark.parametrize("goal", poses(6, 2))
def test_a_car_comes_to_any_pose(car: ns.ConstrainedDMP, goal: tuple[float, float, float]) -> None:
    there = adapted(car, *goal)
    shortest = dubins(*goal, RADIUS)[0].length
    for step in (None, 1e-3, there.duration / 317):
        motion = there.rollout(time_step=step)
        assert_ends(motion, *goal)
        assert motion.margins.min() >= -1e-9
        assert ns.check(motion, [ns.Wheel()]).satisfied
    assert motion.path_length <= 1.05 * shortest


@pytest.mark.parametrize("goal", poses(4, 3))
def test_a_car_that_may_back_up_does_where_that_is_shorter(
    parking: ns.ConstrainedDMP, goal: tuple[float, float, float]
) -> None:
    there = adapted(parking, *goal, reverse=True)
    motion = there.rollout()
    assert_ends(motion, *goal)
    assert motion.path_length <= 1.05 * reeds_shepp(*goal, RADIUS)[0].length
    assert motion.margins.min() >= -1e-9


def test_a_cusp_is_a_rest_in_one_motion(parking: ns.ConstrainedDMP) -> None:
    there = adapted(parking, 0.0, 0.3, 0.0, reverse=True)
    assert "back" in there.record[0].maneuver
    motion = there.rollout()
    forward = np.einsum("ij,ij->i", motion.rotations.as_matrix()[:, :, 0], motion.linear_velocities)
    assert min(forward.max(), -forward.min()) > 0.05
    cusps = np.flatnonzero(np.diff(np.sign(forward[np.abs(forward) > 1e-3])))
    assert 1 <= len(cusps) <= 4


def test_a_cusp_is_stepped_in_a_control_loop(parking: ns.ConstrainedDMP) -> None:
    there = adapted(parking, 0.0, 0.3, 0.0, reverse=True)
    controller = there.controller(time_step=0.01)
    for _ in range(round(1.2 * there.duration / 0.01)):
        state = controller.step()
    assert np.linalg.norm(state.position - [0, 0.3, 0]) <= 1e-3


def test_a_cusp_is_kept_in_c(parking: ns.ConstrainedDMP, tmp_path: Path, uncounted: None) -> None:
    adapted(parking, 0.0, 0.3, 0.0, reverse=True).export_c(tmp_path)
    sources = [f"{name}.c" for name in ("test", "noslip", "primitive", "plan", "replan")]
    build = ["cc", "-O1", "-o", "test", *sources, "controller.c", "-lm"]
    subprocess.run(build, cwd=tmp_path, check=True)
    assert subprocess.run([tmp_path / "test"], capture_output=True, check=False).returncode == 0


def test_forwards_only_where_it_is_asked_for(parking: ns.ConstrainedDMP) -> None:
    motion = adapted(parking, -0.5, 0.0, 0.0, reverse=False).rollout()
    assert_ends(motion, -0.5, 0, 0)
    assert backed(motion) <= 1e-6


def test_backing_up_against_a_rule_is_refused(car: ns.ConstrainedDMP) -> None:
    with pytest.raises(InputError, match="'turning-radius' lets the tool move forward only"):
        car.adapt(goal_position=[-1, 0, 0], reverse=True)


@pytest.mark.parametrize(
    ("tool", "more"),
    [
        (ns.Wheel(), []),
        (ns.Wheel(), [ForwardOnly()]),
        (ns.Blade(), [ForwardOnly()]),
        (ns.Needle(), []),
    ],
)
def test_what_turns_where_it_stands_turns_and_drives(
    tool: Constraint, more: list[Constraint]
) -> None:
    dmp = learned(tool, *more)
    for goal in ((-0.5, 0.0, 0.0), (-3.0, 0.0, 0.0), (0.0, 0.0, np.pi / 2), (0.0, 0.0, 0.0)):
        motion = adapted(dmp, *goal).rollout()
        assert_ends(motion, *goal)
        assert backed(motion) <= 1e-3
    with muted():
        there = dmp.adapt(start_rotation=HEADING_LEFT)
    assert_ends(there.rollout(), 1, 0, 0)


def test_backwards_where_that_is_asked_for() -> None:
    there = adapted(learned(ns.Wheel()), -0.5, 0.0, 0.0, reverse=True)
    assert backed(there.rollout()) == pytest.approx(0.5, rel=1e-3)


def test_a_limit_on_turns_lengthens_the_turns_alone() -> None:
    there = adapted(learned(ns.Wheel(), ForwardOnly(), AngularRateLimit(0.5)), -0.5, 0.0, 0.0)
    motion = there.rollout()
    assert motion.margins.min() >= -1e-9
    # Two half turns by minimum jerk, and the way between at the demonstration's pace.
    least = 2 * 1.875 * np.pi / 0.5 + 4 * np.sqrt(0.5)
    assert there.duration == pytest.approx(least, rel=0.05)


def test_the_demonstrations_shape_is_kept_as_far_as_it_leads() -> None:
    dmp = learned(ns.Wheel(), TurningRadius(0.2), bend=0.1)
    kept, shortest = (
        adapted(dmp, -1.0, 1.0, -np.pi / 2, shape=shape) for shape in ("demonstrated", "shortest")
    )
    assert "of the demonstration, then" in kept.record[0].maneuver
    assert "demonstration" not in shortest.record[0].maneuver
    own, motion = dmp.rollout().positions, kept.rollout().positions
    # A quarter of the demonstration's way, at least, is passed again.
    first = own[1:][np.cumsum(np.linalg.norm(np.diff(own, axis=0), axis=1)) <= 0.25]
    off = np.linalg.norm(first[:, None] - motion[None], axis=2).min(axis=1)
    assert off.max() <= 1e-2
    assert shortest.rollout().path_length < kept.rollout().path_length


def test_a_blade_comes_to_poses_in_space() -> None:
    dmp = learned(ns.Blade(), ForwardOnly(), TurningRadius(RADIUS))
    rng = np.random.default_rng(4)
    for _ in range(2):
        position, rotation = rng.uniform(-1.5, 1.5, 3), Rotation.random(rng=rng)
        with muted():
            motion = dmp.adapt(goal_position=position, goal_rotation=rotation).rollout()
        assert np.linalg.norm(motion.positions[-1] - position) <= 1e-3
        assert (motion.rotations[-1] * rotation.inv()).magnitude() <= 1e-2
        assert motion.margins.min() >= -1e-9


def hindered(dmp: ns.ConstrainedDMP, *limits: Constraint) -> ns.ConstrainedDMP:
    system = ConstraintSystem([*dmp.constraints, *limits])
    return replace(dmp, rule=Rule(system, dmp.rule.inverse_metric))


def test_what_is_in_the_way_is_gone_around(car: ns.ConstrainedDMP) -> None:
    places = [(0.8, 0.0, 0), (0.8, 0.25, 0), (0.8, -0.25, 0), (0.5, 0.5, 0), (0.5, -0.5, 0)]
    walls = [KeepOutSphere(center, 0.2) for center in places]
    there = adapted(hindered(car, *walls), 1.8, 0.0, 0.0)
    fine = there.rollout(time_step=there.duration / 5000)
    assert_ends(fine, 1.8, 0, 0)
    for center in places:
        assert np.linalg.norm(fine.positions - center, axis=1).min() >= 0.2


def test_a_closed_wall_is_not_found_never_impossible(
    car: ns.ConstrainedDMP, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The finest search takes most of the time, and finds no more.
    monkeypatch.setattr("noslip.maneuvers.search._LEVELS", _LEVELS[:2])
    around = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    walls = [KeepOutSphere((1.2 * np.cos(a), 1.2 * np.sin(a), 0), 0.35) for a in around.tolist()]
    with pytest.raises(ConvergenceError) as refused:
        adapted(hindered(car, *walls), 2.5, 0.0, 0.0)
    assert refused.value.code == Refusal.NOT_FOUND


def test_a_maneuver_is_recorded_saved_and_read(car: ns.ConstrainedDMP, tmp_path: Path) -> None:
    there = adapted(car, -0.5, 0.2, 0.0)
    assert there.record[0].maneuver.endswith(" m")
    again = ns.load_primitive(there.save(tmp_path / "there.json"))
    assert again.record == there.record
    assert np.array_equal(again.rollout().positions, there.rollout().positions)


def test_what_shape_is_neither(car: ns.ConstrainedDMP) -> None:
    with pytest.raises(InputError, match="shape must be demonstrated or shortest, got 'short'"):
        car.adapt(goal_position=[1, 0, 0], shape="short")
