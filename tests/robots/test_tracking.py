"""Tracking: no slip in any executed step, limits kept, and refusals that say what is feasible."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, Slerp

pytest.importorskip("mujoco", reason="the extra robots is not installed")
pytest.importorskip("daqp", reason="the extra robots is not installed")

import noslip as ns
from measures import slip
from noslip import robots
from noslip.constraints.system import as_system
from noslip.robots.kinematics import Chord, InverseKinematics
from strategies import unit

from .arms import Floats, arc, line, published_motion

BLADE = ns.Blade()
SLIP = 1e-6
"""m/s, of the executed tool."""
OFF, TURNED = 1e-4, np.radians(0.05)
STANDING = np.array([1.0, 0.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def arm() -> robots.Robot:
    return robots.panda()


def at(arm: robots.Robot, motion: ns.PoseTrajectory, *where: float) -> robots.Placement:
    """The motion's origin at this place, its axes the base's."""
    return robots.Placement(np.array(where), Rotation.identity())


def assert_kept(tracked: robots.TrackedMotion) -> None:
    """Everything that was promised, by kinematics of the tests' own."""
    arm, times = tracked.robot, tracked.times
    executed = published_motion(times, tracked.joint_positions)
    assert np.abs(slip(executed)).max() <= SLIP
    off = np.linalg.norm(executed.positions - tracked.commanded.positions, axis=1)
    turned = (executed.rotations * tracked.commanded.rotations.inv()).magnitude()
    assert off.max() <= OFF
    assert turned.max() <= TURNED
    assert_within_limits(arm, times, tracked.joint_positions)
    assert tracked.margins.distance >= 0.005 - 1e-9
    assert tracked.margins.smallest[0] >= -1e-9


def assert_within_limits(arm: robots.Robot, times: Floats, q: Floats) -> None:
    h = np.diff(times)[:, None]
    rates = np.vstack([np.zeros(arm.size), np.diff(q, axis=0) / h])
    gains = np.diff(rates, axis=0) / h
    assert np.all(q >= arm.lower - 1e-9)
    assert np.all(q <= arm.upper + 1e-9)
    assert np.all(np.abs(rates) <= arm.velocity_limits * (1 + 1e-6))
    assert np.all(np.abs(gains) <= arm.acceleration_limits * (1 + 1e-6) + 1e-6)


# -------------------------------------------------------------------- one step


@settings(max_examples=40)
@given(
    seed=st.integers(0, 2**31),
    speed=st.floats(0.0, 1.0),
    turn=st.floats(0.0, 3.0),
    slow=st.floats(0.02, 1.0),
    step=st.sampled_from([1e-3, 5e-3, 2e-2]),
)
def test_whatever_is_asked_a_step_does_not_slip_and_keeps_the_limits(
    seed: int, speed: float, turn: float, slow: float, step: float
) -> None:
    random = np.random.default_rng(seed)
    arm = robots.panda(table=None)
    arm = arm.with_limits(velocity=slow * arm.velocity_limits, acceleration=1e4)
    chord = Chord(as_system(BLADE), np.zeros(3), STANDING)
    ik = InverseKinematics(arm, chord, arm.home)
    q = arm.home + random.uniform(-0.5, 0.5, 7)
    # From within a collision no slow step leads out.
    assume(ik.distance_at(q) > 0.01)
    position, rotation = arm.forward(q)
    # In any direction, sideways too.
    wanted = position + step * speed * unit(random)
    turned = Rotation.from_rotvec(step * turn * unit(random)) * rotation
    here = position, rotation.as_quat(scalar_first=True)
    target = wanted, turned.as_quat(scalar_first=True)
    solved = ik.step(q, np.zeros(7), here, target, step, step)
    assert solved is not None
    times = np.array([0.0, step])
    executed = published_motion(times, np.array([q, solved.positions]))
    assert np.abs(slip(executed)).max() <= 1e-8
    assert np.all(np.abs(solved.velocities) <= arm.velocity_limits * (1 + 1e-9))
    assert np.all((solved.positions >= arm.lower) & (solved.positions <= arm.upper))


@settings(max_examples=60)
@given(
    seed=st.integers(0, 2**31),
    step=st.sampled_from([1e-3, 7e-3, 3e-2]),
    fast=st.floats(0.01, 100.0),
)
def test_bounds_leave_room_to_brake(seed: int, step: float, fast: float) -> None:
    """Whatever is chosen within them, ranges are kept and no step is without a choice."""
    random = np.random.default_rng(seed)
    arm = robots.panda(table=None)
    arm = arm.with_limits(
        velocity=fast * arm.velocity_limits, acceleration=fast * arm.acceleration_limits
    )
    ik = InverseKinematics(arm)
    q, x = random.uniform(arm.lower, arm.upper), np.zeros(7)
    side = random.choice([0.0, 1.0], size=7)
    gain = arm.acceleration_limits * step
    for _ in range(300):
        bounds = ik.bounds(q, x, step)
        assert np.all(bounds.lower <= bounds.upper)
        assert np.all((bounds.lower >= x - gain * 1.000001) & (bounds.upper <= x + gain * 1.000001))
        # To one end as fast as can be, now and then the other way.
        side = np.where(random.random(7) < 0.01, 1 - side, side)
        x = bounds.lower + side * (bounds.upper - bounds.lower)
        q = q + step * x
        assert np.all((q >= arm.lower - 1e-9) & (q <= arm.upper + 1e-9))
        assert np.all(np.abs(x) <= arm.velocity_limits * (1 + 1e-9))


@pytest.fixture(scope="module")
def low(arm: robots.Robot) -> Floats:
    """Joint positions with the blade's tip 0.2 m above the base, and nothing else so low."""
    placement = robots.Placement(np.array([0.4, 0.0, 0.2]), Rotation.identity())
    motion = line(np.array([0.1, 0.0, 0.0]))
    return robots.track(arm, motion, BLADE, placement=placement).joint_positions[0]


@pytest.mark.parametrize("gap", [0.005, 0.006, 0.01, 0.02])
def test_a_step_toward_a_table_uses_its_share_of_the_room_and_one_away_is_free(
    low: Floats, gap: float
) -> None:
    top, step = 0.2 - gap, 1e-3
    arm = robots.panda(table=top).with_limits(acceleration=1e4)
    position, rotation = arm.forward(low)
    here = position, rotation.as_quat(scalar_first=True)
    for way in (-1, 1):
        target = position + [0.0, 0.0, way * 0.5 * step], here[1]
        solved = InverseKinematics(arm).step(low, np.zeros(7), here, target, step, step)
        assert solved is not None
        reached = published_motion(np.array([0.0, step]), np.array([low, solved.positions]))
        # 5 mm are kept; of what is above them a step of 1 ms may use 1 %.
        expected = 0.005 + 0.99 * (gap - 0.005) if way < 0 else gap + 0.5 * step
        assert reached.positions[1, 2] - top == pytest.approx(expected, abs=2e-6)


def test_what_joints_cannot_do_falls_along_the_path(arm: robots.Robot) -> None:
    """Ten times too slow, the tool falls behind its target, by any amount but sideways."""
    slow = arm.with_limits(velocity=0.1 * arm.velocity_limits)
    motion = arc()
    tracked = robots.track(
        slow, motion, BLADE, placement=at(arm, motion, 0.4, 0, 0.3), refuse=False, start=arm.home
    )
    assert tracked.errors.position.max() > 0.01
    assert tracked.times[-1] > 1.5 * motion.duration
    assert_within_limits(slow, tracked.times, tracked.joint_positions)
    # Late, and not beside: where its clock says, the tool is on the path.
    assert np.all(np.diff(tracked.clock) >= 0)
    assert np.all(tracked.clock <= tracked.times + 1e-9)
    commanded = tracked.commanded
    positions = CubicSpline(commanded.times, commanded.positions)(tracked.clock)
    rotations = Slerp(commanded.times, commanded.rotations)(tracked.clock)
    executed = published_motion(tracked.times, tracked.joint_positions)
    assert np.abs(slip(executed)).max() <= SLIP
    assert np.linalg.norm(executed.positions - positions, axis=1).max() <= OFF
    assert (executed.rotations * rotations.inv()).magnitude().max() <= TURNED
    assert np.allclose(executed.positions[-1], tracked.commanded.positions[-1], atol=1e-4)


def test_without_rows_and_bounds_a_step_is_minks(arm: robots.Robot) -> None:
    mink = pytest.importorskip("mink", reason="an oracle, of the extra dev")
    free = arm.with_limits(velocity=1e6, acceleration=1e9)
    chord = Chord(as_system([]), np.zeros(3), STANDING)
    ik = InverseKinematics(free, chord, arm.home)
    step = 1e-3
    position, rotation = arm.forward(arm.home)
    moved = position + step * np.array([0.1, -0.05, 0.02])
    turned = Rotation.from_rotvec(step * np.array([0.2, 0.1, -0.3])) * rotation
    here = position, rotation.as_quat(scalar_first=True)
    target = moved, turned.as_quat(scalar_first=True)
    solved = ik.step(arm.home, np.zeros(7), here, target, step, step)
    assert solved is not None
    configuration = mink.Configuration(arm.model)
    configuration.update(arm.home)
    task = mink.FrameTask("noslip tool", "site", position_cost=1.0, orientation_cost=0.2)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turned.as_matrix(), moved
    task.set_target(mink.SE3.from_matrix(pose))
    velocities = mink.solve_ik(
        configuration, [task], step, "daqp", damping=1e-6, limits=[], primal_tol=1e-12
    )
    assert np.abs(solved.velocities - velocities).max() <= 1e-3 * np.abs(velocities).max()


# -------------------------------------------------------------------- a whole motion


@pytest.mark.parametrize(
    "constraints",
    [
        [BLADE],
        # Said twice, and a place besides: rows that depend on each other do no harm.
        [BLADE, BLADE, ns.constraints.PlaneContact()],
    ],
    ids=["blade", "blade twice and a plane"],
)
def test_an_arc_is_tracked_within_all_limits(
    arm: robots.Robot, constraints: list[ns.Constraint]
) -> None:
    motion = arc()
    tracked = robots.track(arm, motion, constraints, placement=at(arm, motion, 0.4, 0, 0.3))
    assert_kept(tracked)
    assert np.abs(tracked.slip).max() <= 1e-8
    assert np.abs(tracked.executed.positions[:, 2] - 0.3).max() <= 1e-8
    assert tracked.times[-1] == pytest.approx(motion.duration + robots.RAMP)
    assert np.all(tracked.joint_velocities[0] == 0)
    assert np.abs(tracked.joint_velocities[-1]).max() <= 0.01


def test_the_placement_may_be_turned_and_tilted(arm: robots.Robot) -> None:
    """Constraints are written in the motion's frame: a plane there is a slope here."""
    motion = arc()
    turn = Rotation.from_euler("ZY", [0.7, 0.4])
    tilted = robots.Placement(np.array([0.4, 0.1, 0.35]), turn)
    tracked = robots.track(arm, motion, [BLADE, ns.constraints.PlaneContact()], placement=tilted)
    assert_kept(tracked)
    height = (tracked.executed.positions - tilted.position) @ turn.apply([0, 0, 1])
    assert np.abs(height).max() <= 1e-8
    back = tilted.undo(tilted.apply(motion))
    assert np.allclose(back.positions, motion.positions, atol=1e-15)


@pytest.mark.slow
def test_a_coarse_motion_is_executed_finely_without_slip(arm: robots.Robot) -> None:
    motion = arc(step=0.02)
    tracked = robots.track(arm, motion, BLADE, placement=at(arm, motion, 0.4, 0, 0.3))
    assert len(tracked.times) > 10 * len(motion)
    assert_kept(tracked)
    # At the same fraction of the way, it is where the motion was.
    ends = tracked.placement.undo(tracked.executed).positions[[0, -1]]
    assert np.allclose(ends, motion.positions[[0, -1]], atol=1e-3)


def test_a_motion_of_the_arms_own_rate_from_rest_is_taken_as_it_is(arm: robots.Robot) -> None:
    motion = arc()
    assert robots.timed(motion, BLADE, ramp=0.0) is motion


def test_the_clock_starts_and_stops_smoothly() -> None:
    motion = line(np.array([0.3, 0.0]) @ np.eye(2, 3))
    steady = ns.PoseTrajectory(
        motion.times,
        np.linspace(0, 1, len(motion))[:, None] * [0.3, 0, 0],
        motion.rotations,
    )
    timed = robots.timed(steady, ramp=0.5, time_step=1e-3)
    speeds = np.diff(timed.positions[:, 0]) / 1e-3
    assert timed.duration == pytest.approx(steady.duration + 0.5)
    assert np.all(speeds >= -1e-9)
    assert speeds.max() == pytest.approx(0.15, rel=1e-6)
    assert max(speeds[0], speeds[-1]) < 1e-4
    assert np.abs(np.diff(speeds)).max() / 1e-3 <= 0.15 / 0.5 * 1.9
    assert np.allclose(timed.positions[[0, -1]], steady.positions[[0, -1]], atol=1e-12)


def test_a_constraint_that_depends_on_time_does_not_stand_ramps(arm: robots.Robot) -> None:
    @ns.position_constraint
    def keeps_pace(motion: ns.constraints.Instant) -> object:
        return motion.position[0] - 0.1 * motion.time

    count = 1001
    times = np.linspace(0, 1, count)
    steady = ns.PoseTrajectory(
        times, times[:, None] * [0.1, 0, 0], Rotation.identity(count), name="steady"
    )
    with pytest.raises(ns.errors.InputError, match=r"steady: 'keeps pace' .* ramp=0"):
        robots.track(arm, steady, keeps_pace, placement=at(arm, steady, 0.4, 0, 0.3))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"duration": -1.0}, "duration must be"),
        ({"ramp": -1.0}, "ramp must be"),
        ({"time_step": 0.0}, "time_step must be"),
        ({"start": [0.0] * 7}, "needs a placement"),
        ({"level": "upside down"}, "level must be"),
        ({"seed": -1}, "seed must be"),
    ],
)
def test_arguments_are_checked(
    arm: robots.Robot, arguments: dict[str, object], message: str
) -> None:
    with pytest.raises(ns.errors.InputError, match=message):
        robots.track(arm, arc(step=0.01), BLADE, **arguments)  # type: ignore[arg-type]


# -------------------------------------------------------------------- refusals


def test_too_fast_is_refused_with_joint_time_margin_and_a_feasible_duration(
    arm: robots.Robot,
) -> None:
    motion = arc(step=2e-3)
    placement = at(arm, motion, 0.4, 0, 0.3)
    with pytest.raises(robots.InfeasibleMotionError) as refused:
        robots.track(arm, motion, BLADE, placement=placement, duration=0.25, ramp=0.0)
    error = refused.value
    assert error.limit in ("velocity", "acceleration")
    assert error.joint in arm.joint_names
    assert 0 < error.time < 0.25
    assert error.margin < 0
    assert error.duration is not None
    assert error.joint in str(error)
    assert f"feasible in {error.duration:.3g} s" in str(error)
    offered = robots.track(
        arm, motion, BLADE, placement=placement, duration=error.duration, ramp=0.0
    )
    assert_kept(offered)
    # Not merely slow: two thirds of the offered time are too little.
    with pytest.raises(robots.InfeasibleMotionError):
        robots.track(
            arm, motion, BLADE, placement=placement, duration=0.66 * error.duration, ramp=0.0
        )


def test_beyond_reach_is_refused_and_placed_anew(arm: robots.Robot) -> None:
    motion = arc(step=2e-3)
    with pytest.raises(robots.InfeasibleMotionError, match="out of reach") as refused:
        robots.track(arm, motion, BLADE, placement=at(arm, motion, 0.85, 0, 0.2))
    assert refused.value.limit == "reach"
    assert refused.value.placement is not None
    assert_kept(robots.track(arm, motion, BLADE, placement=refused.value.placement))


def test_a_line_over_the_edge_of_reach_is_refused_on_its_way(arm: robots.Robot) -> None:
    motion = line(np.array([0.5, 0.0, 0.0]))
    with pytest.raises(robots.InfeasibleMotionError) as refused:
        robots.track(arm, motion, BLADE, placement=at(arm, motion, 0.45, 0, 0.3))
    assert 0.2 < refused.value.time < motion.duration + robots.RAMP


def test_at_the_edge_of_reach_no_joint_jumps(arm: robots.Robot) -> None:
    """Made to try all the same, the arm stretches and stays there."""
    motion = line(np.array([0.5, 0.0, 0.0]))
    placement = at(arm, motion, 0.45, 0, 0.3)
    tracked = robots.track(
        arm, motion, BLADE, placement=placement, start=arm.home, refuse=False, time_step=4e-3
    )
    assert tracked.errors.position[-1] > 0.05
    assert_within_limits(arm, tracked.times, tracked.joint_positions)
    executed = published_motion(tracked.times, tracked.joint_positions)
    assert np.abs(slip(executed)).max() <= SLIP
    assert np.linalg.norm(executed.positions, axis=1).max() < 1.2


def test_nowhere_near_is_refused_without_an_offer(arm: robots.Robot) -> None:
    motion = arc(step=5e-3)
    with pytest.raises(robots.InfeasibleMotionError, match="no feasible") as refused:
        robots.track(arm, motion, BLADE, placement=at(arm, motion, 5.0, 0, 0.3))
    assert refused.value.placement is None
    assert refused.value.duration is None
    assert isinstance(refused.value, ns.NoslipError)


def test_a_table_in_the_way_is_a_collision() -> None:
    motion = line(np.array([0.1, 0.0, 0.0]))
    placement = robots.Placement(np.array([0.4, 0.0, 0.2]), Rotation.identity())
    lower = robots.panda(table=0.19)
    tracked = robots.track(lower, motion, BLADE, placement=placement)
    assert_kept(tracked)
    assert tracked.margins.distance == pytest.approx(0.01, abs=1e-4)
    assert tracked.margins.pair == ("blade", "table")
    higher = robots.panda(table=0.2)
    with pytest.raises(robots.InfeasibleMotionError, match="0 mm") as refused:
        robots.track(higher, motion, BLADE, placement=placement)
    assert refused.value.limit == "collision"
    assert refused.value.joint == "blade and table"
    assert refused.value.placement is not None
    assert_kept(robots.track(higher, motion, BLADE, placement=refused.value.placement))


@pytest.mark.slow
def test_a_path_that_sinks_into_a_table_is_refused_or_stops_above_it() -> None:
    arm = robots.panda(table=0.2)
    down = line(np.array([0.01, 0.0, -0.15]))
    placement = robots.Placement(np.array([0.45, 0.0, 0.3]), Rotation.identity())
    with pytest.raises(robots.InfeasibleMotionError) as refused:
        robots.track(arm, down, placement=placement)
    assert refused.value.limit == "collision"
    assert 0.5 < refused.value.time < 2.0
    tracked = robots.track(
        arm, down, placement=placement, start=arm.home, refuse=False, time_step=2e-3
    )
    assert 0.004 < tracked.margins.distance < 0.006
    assert tracked.executed.positions[:, 2].min() > 0.204
    assert_within_limits(arm, tracked.times, tracked.joint_positions)


@pytest.mark.slow
def test_the_arm_does_not_run_into_itself(arm: robots.Robot) -> None:
    """Its own ranges would stop it before."""
    wide = replace(arm, lower=np.full(7, -4.0), upper=np.full(7, 4.0))
    inwards = line(np.array([-0.34, 0.0, 0.0]), duration=4.0, step=4e-3)
    straight = ns.PoseTrajectory(
        inwards.times, inwards.positions, Rotation.identity(len(inwards)), name="inwards"
    )
    placement = at(wide, straight, 0.4, 0, 0.2)
    with pytest.raises(robots.InfeasibleMotionError, match="shoulder2 and holder") as refused:
        robots.track(wide, straight, BLADE, placement=placement, start=arm.home)
    assert refused.value.limit == "collision"
    stopped = robots.track(
        wide, straight, BLADE, placement=placement, start=arm.home, refuse=False, time_step=4e-3
    )
    assert stopped.margins.distance == pytest.approx(0.005, abs=1e-6)
    assert stopped.margins.pair == ("shoulder2", "holder")
    assert 0.02 < stopped.errors.position[-1] < 0.05
    assert_within_limits(wide, stopped.times, stopped.joint_positions)


def test_limits_that_nobody_gave_are_not_kept(tmp_path: Path) -> None:
    text = Path(robots.__file__).with_name("panda.xml").read_text()
    free = re.sub(r' (actuatorfrc)?range="[^"]*"', "", re.sub(r"<numeric [^>]*>", "", text))
    (tmp_path / "free.xml").write_text(free)
    arm = robots.load(tmp_path / "free.xml", tool="tool")
    assert arm.unknown_limits == ("position", "velocity", "acceleration", "torque")
    motion = arc(step=5e-3)
    tracked = robots.track(arm, motion, BLADE, placement=at(arm, motion, 0.4, 0, 0.3))
    assert np.abs(slip(published_motion(tracked.times, tracked.joint_positions))).max() <= SLIP
    assert tracked.margins.position == tracked.margins.velocity == 1.0


# -------------------------------------------------------------------- placements


def test_a_placement_is_found_where_the_arm_has_room(arm: robots.Robot) -> None:
    motion = arc()
    found = robots.place(arm, motion)
    assert [one.margin for one in found] == sorted((one.margin for one in found), reverse=True)
    assert found[0].margin > 0.2
    assert_kept(robots.track(arm, motion, BLADE))
    again = robots.place(arm, motion)
    assert np.array_equal(again[0].start, found[0].start)


@pytest.mark.slow
def test_a_motion_larger_than_the_arm_has_no_placement(arm: robots.Robot) -> None:
    motion = line(np.array([3.0, 0.0, 0.0]), duration=20.0, step=0.02)
    assert robots.place(arm, motion, candidates=30) == []
    with pytest.raises(robots.InfeasibleMotionError, match="smaller, or slower"):
        robots.track(arm, motion, BLADE)


def test_a_motion_is_placed_by_its_middle_and_made_upright() -> None:
    motion = arc(step=0.01)
    lying = robots.Placement(np.array([1.0, 2, 3]), Rotation.from_euler("x", 1.2)).apply(motion)
    placement = robots.Placement.of(lying, [0.5, 0, 0.2], yaw=0.3, level="tool")
    assert np.allclose(placement.middle(lying), [0.5, 0, 0.2], atol=1e-12)
    up = placement.apply(lying).rotations.apply([0, 0, 1])
    assert np.allclose(up, [0, 0, 1], atol=1e-9)
    assert robots.Placement.of(motion, [0.5, 0, 0.2], yaw=0.3).yaw == pytest.approx(0.3)
