"""What a check reports, for motions whose slip is known in closed form."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from learned import under
from measures import steps
from motions import planar_cut
from noslip import (
    Blade,
    KeepOutSphere,
    Needle,
    PoseTrajectory,
    SpeedLimit,
    check,
    keep_nonnegative,
    learn,
    load_demonstrations,
    position_constraint,
    prepare,
    velocity_constraint,
)
from noslip._typing import Floats
from noslip.constraints import AccelerationLimit, AngularRateLimit, Box, Instant, ToolAxis
from noslip.constraints.check import step_accelerations, step_residuals
from noslip.constraints.system import ConstraintSystem
from noslip.errors import ConstraintError, InputError
from noslip.merit import figures_of_merit
from refusals import refusal
from rules import needle
from strategies import seeds


def irregular(seed: int, count: int = 60, start: float = 0.0) -> Floats:
    gaps = np.random.default_rng(seed).uniform(0.2, 2.0, count - 1)
    return start + np.concatenate([[0.0], np.cumsum(gaps)]) / 50


def straight(
    times: Floats, speeds: Floats | float, direction: Floats, rotation: Rotation, name: str = "run"
) -> PoseTrajectory:
    """Constant direction and rotation; ``speeds`` of each step, or one for all."""
    way = np.concatenate([[0.0], np.cumsum(np.diff(times) * speeds)])
    return PoseTrajectory(
        times=times,
        positions=np.outer(way, direction) + np.array([0.3, -0.2, 0.1]),
        rotations=Rotation.from_quat(np.tile(rotation.as_quat(), (len(times), 1))),
        name=name,
    )


@position_constraint
def plane(motion: Instant) -> Any:
    return motion.position[2] - 0.1


# -------------------------------------------------------------------- slip in closed form


@given(seeds, st.floats(1e-4, 4), st.floats(-1e4, 1e4))
def test_pure_sideways_motion_slips_all_its_way(seed: int, speed: float, start: float) -> None:
    turn = Rotation.random(random_state=seed)
    motion = straight(irregular(seed, start=start), speed, turn.apply([0, 1, 0]), turn)
    found = check(motion, Blade(), tolerance=speed / 2)["blade"]
    assert found.slip_distance == pytest.approx(motion.path_length, rel=1e-9)
    assert found.peak == pytest.approx(speed, rel=1e-5)
    assert found.rms == pytest.approx(speed, rel=1e-6)
    assert found.share_above_tolerance == 1.0
    assert not found.satisfied


@given(seeds, st.sampled_from(["x", "z"]))
def test_motion_along_the_edge_or_plunging_does_not_slip(seed: int, axis: str) -> None:
    turn = Rotation.random(random_state=seed)
    direction = turn.apply(np.eye(3)["xyz".index(axis)])
    found = check(straight(irregular(seed), 0.4, direction, turn), Blade())["blade"]
    assert found.peak < 1e-12
    assert found.slip_distance is not None
    assert found.slip_distance < 1e-12
    assert found.share_above_tolerance == 0.0
    assert found.satisfied


@given(seeds, st.floats(0, np.pi / 2))
def test_a_blade_held_askew_slips_by_the_sine_of_its_angle(seed: int, angle: float) -> None:
    turn = Rotation.random(random_state=seed)
    direction = turn.apply([np.cos(angle), np.sin(angle), 0])
    motion = straight(irregular(seed), 0.7, direction, turn)
    found = check(motion, Blade())["blade"]
    assert found.slip_distance == pytest.approx(np.sin(angle) * motion.path_length, abs=1e-12)
    assert found.rms == pytest.approx(0.7 * np.sin(angle), abs=1e-11)


@given(seeds)
def test_shares_and_means_are_weighted_by_time(seed: int) -> None:
    # Sideways at a speed of its own in each step, some above and some below the tolerance.
    times = irregular(seed)
    periods = np.diff(times)
    speeds = np.random.default_rng(seed + 1).uniform(0.0, 2.0, len(periods))
    speeds[7] = 3.0
    motion = straight(times, speeds, np.array([0, 1.0, 0]), Rotation.identity())
    found = check(motion, Blade(), tolerance=1.0)["blade"]
    assert found.peak == pytest.approx(3.0, rel=1e-12)
    # A step's residual belongs to the pose where it ends.
    assert found.worst_time == times[8]
    above = periods[speeds > 1.0].sum() / periods.sum()
    assert found.share_above_tolerance == pytest.approx(above, rel=1e-9)
    assert found.rms == pytest.approx(np.sqrt(speeds**2 @ periods / periods.sum()), rel=1e-9)
    assert found.slip_distance == pytest.approx(speeds @ periods, rel=1e-9)


def test_slip_back_and_forth_does_not_cancel() -> None:
    speeds = np.where(np.arange(59) % 2, 0.5, -0.5)
    motion = straight(irregular(1), speeds, np.array([0, 1.0, 0]), Rotation.identity())
    assert check(motion, Blade()).slip_distance == pytest.approx(motion.path_length)


def test_the_pose_is_that_in_the_middle_of_a_step() -> None:
    # Askew where the step begins and where it ends, edge first halfway.
    motion = PoseTrajectory(
        times=[0.0, 1.0],
        positions=[[0, 0, 0], [0, 1, 0]],
        rotations=Rotation.from_euler("z", np.pi / 2 + np.array([-1.0, 1.0])),
    )
    assert check(motion, Blade()).peak < 1e-15
    assert check(motion, Blade(lateral="x", edge="y")).peak == pytest.approx(1.0)


@given(seeds)
def test_time_and_place_are_those_in_the_middle_of_a_step(seed: int) -> None:
    times = irregular(seed)
    ends, periods = times[-1], np.diff(times)
    # x = t^2 has its mean speed halfway in time; y' = y by halves is (1 + h/2) / (1 - h/2) a step.
    grown = np.cumprod(np.concatenate([[1.0], (1 + periods / 2) / (1 - periods / 2)]))
    turns = Rotation.from_rotvec(np.outer(times**2, [0, 0, 1]))
    motion = PoseTrajectory(times, np.column_stack([times**2, grown, 0 * times]), turns)

    @velocity_constraint
    def middle(motion: Instant) -> list[Any]:
        return [
            motion.linear_velocity[0] - 2 * motion.time,
            motion.linear_velocity[1] - motion.position[1],
            motion.angular_velocity[2] - 2 * motion.time,
        ]

    @position_constraint
    def end(motion: Instant) -> Any:
        return motion.position[0] - motion.time**2

    rounding = 1e-13 * max(ends**2, grown[-1]) / periods.min()
    assert np.abs(step_residuals(motion, [middle, end])).max() < rounding


@given(seeds, st.sampled_from([0.0, 0.5, -0.5, 3.0]))
def test_a_turning_blade_that_leads_its_path_slips_by_the_sine_of_its_lead(
    seed: int, lead: float
) -> None:
    # On a circle the chord is parallel to the tangent in the middle of its arc: a blade that is
    # tangent at the samples does not slip, one that leads by steps of its turn does.
    rng = np.random.default_rng(seed)
    radius, speed = rng.uniform(0.05, 2, 2)
    times = np.linspace(0, 1, 101)
    angle = speed * times
    motion = PoseTrajectory(
        times=times,
        positions=radius * np.column_stack([np.sin(angle), 1 - np.cos(angle), 0 * angle]),
        rotations=Rotation.from_euler("z", angle + lead * speed / 100),
    )
    chord = 2 * radius * np.sin(speed / 200) * 100
    found = check(motion, Blade())["blade"]
    slips = chord * np.sin(abs(lead) * speed / 100)
    assert found.peak == pytest.approx(slips, rel=1e-8, abs=1e-12)


@given(seeds, st.floats(1e-6, 9e-4), st.floats(0.0, np.pi / 2))
def test_however_slowly_a_blade_slips_its_share_of_the_way_tells(
    seed: int, speed: float, angle: float
) -> None:
    # 200 mm of a 200 mm path, at half a millimeter a second.
    turn = Rotation.random(random_state=seed)
    direction = turn.apply([np.cos(angle), np.sin(angle), 0])
    report = check(straight(irregular(seed), speed, direction, turn), Blade())
    found = report["blade"]
    assert found.peak < report.constraints[0].tolerance
    assert found.slip_share == pytest.approx(np.sin(angle), rel=1e-5, abs=1e-8)
    assert found.verdict == ("violated" if np.sin(angle) > 0.01 else "holds")
    assert f"{100 * found.slip_share:.2g} % of its way" in str(report) or found.peak < 1e-9


def test_what_is_slower_than_the_tolerance_is_undecided() -> None:
    # One step in 400 goes sideways, as fast as the others; none of all is as fast as 1 mm/s.
    times = np.arange(402) / 4
    ways = np.tile([1.25e-4, 0, 0], (401, 1))
    ways[200] = [0, 1.25e-4, 0]
    motion = PoseTrajectory(
        times, np.vstack([np.zeros(3), np.cumsum(ways, axis=0)]), Rotation.identity(402)
    )
    report = check(motion, Blade())
    assert report["blade"].verdict == "undecided"
    assert not report.satisfied
    assert report.verdict == "undecided: blade"
    assert report.to_dict()["constraints"][0]["verdict"] == "undecided"
    assert "slower than that tolerance" in str(report)
    assert check(motion, Blade(), tolerance=1e-4).verdict == "violated: blade"
    fast = PoseTrajectory(times / 4, motion.positions, motion.rotations)
    assert check(fast, Blade(), tolerance=1e-2).verdict == "undecided: blade"
    assert check(fast, Blade()).verdict == "violated: blade"


def test_the_way_is_that_of_the_point_that_must_not_slip() -> None:
    # Turning about its origin, a blade goes nowhere, and its tip, ahead of it, goes sideways only.
    times = np.arange(401) / 4
    still = np.zeros((401, 3))
    motion = PoseTrajectory(times, still, Rotation.from_euler("z", 1e-3 * times))
    found = check(motion, Blade(reference_point=(0.1, 0, 0)))["blade"]
    assert (found.slip_share, found.verdict) == (pytest.approx(1.0), "violated")
    at_rest = check(motion, Blade())["blade"]
    assert (at_rest.slip_share, at_rest.verdict) == (None, "holds")


def test_turning_is_no_slip() -> None:
    @velocity_constraint
    def no_spin(motion: Instant) -> Any:
        return motion.angular_velocity[2]

    times = np.arange(401) / 4
    along = np.outer(times, [1e-3, 0, 0])
    motion = PoseTrajectory(times, along, Rotation.from_euler("z", 5e-4 * times))
    found = check(motion, no_spin)["no spin"]
    assert (found.unit, found.slip_distance, found.verdict) == ("rad/s", None, "holds")


@given(seeds)
def test_rounding_reads_as_no_slip(seed: int) -> None:
    turn = Rotation.random(random_state=seed)
    motion = straight(irregular(seed), 0.4, turn.apply([1, 0, 0]), turn)
    flat = replace(motion, positions=motion.positions * [1, 1, 0] + [0, 0, 0.1 + 1e-13])
    assert str(check(motion, Blade())).endswith("blade: HOLDS  no slip (below 1e-9 m/s)")
    assert str(check(flat, plane)).endswith("plane: HOLDS  no residual (below 1e-9 m)")
    edge = Box(lower=(None,) * 3, upper=(None, None, 0.1))
    assert "box: HOLDS  reached at" in str(check(flat, edge))


# -------------------------------------------------------------------- kinds of constraints


def test_position_level_is_a_distance_without_a_slip() -> None:
    times = irregular(3)
    heights = 0.1 + 0.02 * np.sin(times)
    motion = PoseTrajectory(
        times=times,
        positions=np.column_stack([times, 0 * times, heights]),
        rotations=Rotation.identity(len(times)),
    )
    found = check(motion, plane, tolerance=0.01)["plane"]
    off = np.abs(heights - 0.1)
    assert found.level == "position"
    assert found.slip_distance is None
    assert found.peak == pytest.approx(off.max(), rel=1e-12)
    assert found.worst_time == times[np.argmax(off)]
    periods = np.diff(times)
    assert found.share_above_tolerance == pytest.approx(
        periods[off[1:] > 0.01].sum() / periods.sum(), rel=1e-12
    )


@given(seeds, st.sampled_from([0.0, 50.0]))
def test_a_pose_is_asked_at_the_first_sample_too(seed: int, start: float) -> None:
    # 50 mm above the plane where it begins, and on it ever after; and 50 mm below the table.
    times = irregular(seed, start=start)
    positions = np.column_stack([times, 0 * times, np.full_like(times, 0.1)])
    positions[0, 2] += 0.05
    motion = PoseTrajectory(times, positions, Rotation.identity(len(times)), name="late")
    low = Box(lower=(None,) * 3, upper=(None, None, 0.1))
    report = check(motion, [plane, low])
    assert report.verdict == "violated: plane, box"
    for found in report.constraints:
        assert found.peak == pytest.approx(0.05)
        assert found.worst_time == times[0]
    assert check(motion[1:], [plane, low]).satisfied
    assert "peak 50 mm at" in str(report)


def test_rows_of_one_constraint_count_by_their_norm() -> None:
    motion = straight(irregular(4), 1.0, np.array([0, 0.6, 0.8]), Rotation.identity())
    report = check(motion, needle)
    assert len(report.constraints) == 1
    assert report.peak == pytest.approx(1.0)
    assert report.slip_distance == pytest.approx(motion.path_length)


def test_each_constraint_gets_its_own_rows() -> None:
    motion = straight(irregular(4), 1.0, np.array([0, 0.6, 0.8]), Rotation.identity())
    report = check(motion, [plane, needle, Blade(), Blade(lateral="z")])
    assert [c.name for c in report.constraints] == ["plane", "needle", "blade", "blade 2"]
    assert [c.peak for c in report.constraints[1:]] == pytest.approx([1.0, 0.6, 0.8])


@given(seeds, st.sampled_from([0.0, 12.5, -300.0]))
def test_time_counts_from_the_first_sample(seed: int, start: float) -> None:
    @position_constraint
    def rising(motion: Instant) -> Any:
        return motion.position[2] - 0.25 * motion.time

    times = irregular(seed, start=start)
    motion = PoseTrajectory(
        times=times,
        positions=np.column_stack([0 * times, 0 * times, 0.25 * (times - start)]),
        rotations=Rotation.identity(len(times)),
    )
    assert check(motion, rising).peak < 1e-12


def test_angular_velocities_are_those_of_the_steps() -> None:
    @velocity_constraint
    def spin(motion: Instant) -> Any:
        return motion.angular_velocity

    times = irregular(5)
    motion = PoseTrajectory(
        times=times,
        positions=np.zeros((len(times), 3)),
        rotations=Rotation.from_rotvec(np.outer(times, [0.0, 3.0, 4.0])),
    )
    report = check(motion, spin)
    assert report.peak == pytest.approx(5.0, rel=1e-9)
    assert report.rms == pytest.approx(5.0, rel=1e-9)


def test_recorded_velocities_are_not_asked() -> None:
    # They need not be those of the samples; a controller plays the samples.
    motion = straight(irregular(6), 1.0, np.array([0, 1.0, 0]), Rotation.identity())
    lying = PoseTrajectory(
        times=motion.times,
        positions=motion.positions,
        rotations=motion.rotations,
        linear_velocities=np.zeros_like(motion.positions),
        name=motion.name,
    )
    assert check(lying, Blade()) == check(motion, Blade())


def test_a_residual_that_is_no_number_is_refused_by_the_constraints_name() -> None:
    @velocity_constraint
    def undefined(motion: Instant) -> Any:
        return ca.sqrt(motion.position[0] - 10) * motion.linear_velocity[0]

    motion = straight(irregular(7), 1.0, np.array([1.0, 0, 0]), Rotation.identity())
    with pytest.raises(ConstraintError, match="'undefined' is nan"):
        check(motion, undefined)


# -------------------------------------------------------------------- limits


def wandering(seed: int, start: float = 0.0) -> PoseTrajectory:
    """Random poses some decimeters apart, at irregular times."""
    rng = np.random.default_rng(seed)
    times = irregular(seed, start=start)
    ways = rng.normal(size=(len(times), 3)) * 0.02
    turns = Rotation.from_rotvec(rng.normal(size=(len(times), 3)) * 0.1)
    return PoseTrajectory(times=times, positions=np.cumsum(ways, axis=0), rotations=turns)


def margins_of(motion: PoseTrajectory) -> dict[str, Floats]:
    """The margins of LIMITS in each step, by NumPy; one column a row."""
    p = motion.positions
    _, _, _, v, w = steps(motion)
    middles = (motion.times[1:] + motion.times[:-1]) / 2
    a = np.diff(v, axis=0) / np.diff(middles)[:, None]
    sphere = np.linalg.norm(p - [0.05, 0, 0], axis=1) - 0.04
    return {
        "keep-out-sphere": sphere[:, None],
        "speed-limit": 1.5 - np.linalg.norm(v, axis=1)[:, None],
        "angular-rate-limit": 9.0 - np.linalg.norm(w, axis=1)[:, None],
        "box": np.column_stack([p + 0.06, 0.07 - p]),
        "acceleration-limit": 30.0 - np.linalg.norm(np.concatenate([a[:1], a]), axis=1)[:, None],
    }


LIMITS = [
    KeepOutSphere(center=(0.05, 0, 0), radius=0.04),
    SpeedLimit(speed=1.5),
    AngularRateLimit(rate=9.0),
    Box(lower=(-0.06, -0.06, -0.06), upper=(0.07, 0.07, 0.07)),
    AccelerationLimit(linear=30.0),
]
UNITS = ["m", "m/s", "rad/s", "m", "m/s²"]


@given(seeds, st.floats(1e-4, 1.0))
def test_a_limit_is_violated_by_what_its_margin_is_below_zero(seed: int, tolerance: float) -> None:
    motion = wandering(seed, start=7.0)
    periods = np.diff(motion.times)
    report = check(motion, LIMITS, tolerance=tolerance)
    wanted = margins_of(motion)
    assert [c.name for c in report.constraints] == list(wanted)
    assert [c.unit for c in report.constraints] == UNITS
    for found in report.constraints:
        least = wanted[found.name].min(axis=1)
        violation = np.maximum(0.0, -least)
        assert (found.relation, found.slip_distance) == ("nonnegative", None)
        assert found.margin == pytest.approx(least.min(), rel=1e-6, abs=1e-9)
        first = len(motion) - len(least)
        assert found.margin_time == found.worst_time == motion.times[first:][np.argmin(least)]
        assert found.peak == pytest.approx(violation.max(), rel=1e-6, abs=1e-9)
        # The first sample lasts no time.
        violation = violation[-len(periods) :]
        mean = np.sqrt(violation**2 @ periods / periods.sum())
        assert found.rms == pytest.approx(mean, rel=1e-6, abs=1e-9)
        share = periods[violation > tolerance].sum() / periods.sum()
        assert found.share_above_tolerance == pytest.approx(share, abs=1e-12)
        assert found.satisfied == (np.maximum(0.0, -least).max() <= tolerance)


@given(seeds)
def test_a_kept_limit_has_no_violation_but_a_margin(seed: int) -> None:
    motion = wandering(seed)
    speed = float(np.linalg.norm(motion.step_velocities()[0], axis=1).max())
    found = check(motion, SpeedLimit(speed=speed + 0.25))["speed-limit"]
    assert (found.peak, found.rms, found.share_above_tolerance) == (0.0, 0.0, 0.0)
    assert found.satisfied
    assert found.margin == pytest.approx(0.25, rel=1e-9)


def test_equalities_have_no_margin() -> None:
    found = check(wandering(1), Blade())["blade"]
    assert (found.relation, found.unit) == ("zero", "m/s")
    assert (found.margin, found.margin_time) == (None, None)


@given(seeds, st.floats(-1e3, 1e3))
def test_a_steady_acceleration_is_found_at_any_rate(seed: int, start: float) -> None:
    # The step's velocity is that in its middle; so is the change from one middle to the next.
    rng = np.random.default_rng(seed)
    times = irregular(seed)
    pull, speed = rng.normal(size=(2, 3))
    motion = PoseTrajectory(
        times=start + times,
        positions=np.outer(times, speed) + np.outer(times**2 / 2, pull),
        rotations=Rotation.from_rotvec(np.outer(times**2 / 2, [0, 0, 1.5])),
    )
    linear, angular = step_accelerations(motion)
    assert linear.shape == angular.shape == (len(times) - 1, 3)
    np.testing.assert_allclose(linear, np.broadcast_to(pull, linear.shape), atol=1e-7)
    np.testing.assert_allclose(angular, np.broadcast_to([0, 0, 1.5], angular.shape), atol=1e-7)
    bound = AccelerationLimit(linear=float(np.linalg.norm(pull)) + 0.5, angular=1.75)
    np.testing.assert_allclose(
        step_residuals(motion, bound), np.broadcast_to([0.5, 0.25], (len(times) - 1, 2)), atol=1e-6
    )


def test_one_step_has_no_acceleration() -> None:
    motion = planar_cut()[:2]
    assert check(motion, AccelerationLimit(linear=2.0)).constraints[0].margin == pytest.approx(2.0)


def test_a_check_finds_the_margins_of_a_rollout() -> None:
    times = np.linspace(0, 1, 201)
    motion = PoseTrajectory(
        times=times,
        positions=np.column_stack([np.sin(2 * times), times**2, 0 * times]),
        rotations=Rotation.from_euler("z", times),
    )
    limits = [AccelerationLimit(linear=3.0), SpeedLimit(speed=2.0)]
    dmp = under(learn(motion, basis_functions=20), limits)
    rollout = dmp.rollout()
    found = step_residuals(rollout, dmp.constraints)
    # The first step's acceleration is known to the rollout alone, from its initial velocity.
    np.testing.assert_allclose(found[1:], rollout.margins[2:], atol=1e-8)


def test_rows_of_several_units_keep_theirs() -> None:
    motion = wandering(5)
    both = AccelerationLimit(linear=1e4, angular=1.0)
    found = check(motion, both).constraints[0]
    assert found.unit == "rad/s²"
    angular = step_accelerations(motion)[1]
    assert found.peak == pytest.approx(np.linalg.norm(angular, axis=1).max() - 1.0)
    assert check(motion, AccelerationLimit(linear=1.0, angular=1e6)).constraints[0].unit == "m/s²"
    curved = Needle(curvature=2.0)
    assert ConstraintSystem([curved, Blade()]).row_units == ["m/s"] * 2 + ["rad/s"] * 2 + ["m/s"]
    # The way slipped is that of the rows in m/s.
    needle, straight_needle = check(motion, [curved, Needle()]).constraints
    assert needle.slip_distance == pytest.approx(straight_needle.slip_distance)
    assert needle.peak > straight_needle.peak


def test_limits_are_told_by_their_margins() -> None:
    motion = straight(irregular(4), 0.3, np.array([1.0, 0, 0]), Rotation.identity())
    end = motion.positions[-1, 0]
    kept = Box(lower=(None,) * 3, upper=(end + 0.0032, None, None))
    broken = Box(lower=(None,) * 3, upper=(end - 0.05, None, None))
    report = check(motion, [kept, broken, SpeedLimit(speed=0.2), SpeedLimit(speed=0.5)])
    _, *lines = str(report).splitlines()
    at = f"at {motion.times[-1]:.3g} s"
    assert lines[0] == f"  box: HOLDS  least margin 3.2 mm {at}"
    assert lines[1].startswith(f"  box 2: VIOLATED  by 50 mm {at}, rms ")
    assert "by more than 1 mm for " in lines[1]
    assert lines[2].startswith("  speed-limit: VIOLATED  by 0.1 m/s at ")
    assert "by more than 0.001 m/s for 100% of the time" in lines[2]
    assert lines[3].startswith("  speed-limit 2: HOLDS  least margin 0.2 m/s at ")
    assert report.verdict == "violated: box 2, speed-limit"
    assert report.worst is report["speed-limit"]
    data = report.to_dict()
    assert json.loads(json.dumps(data)) == data
    assert data["constraints"][0]["margin"] == pytest.approx(0.0032)
    assert data["constraints"][0]["relation"] == "nonnegative"
    assert data["constraints"][2]["unit"] == "m/s"


def test_angles_are_told_in_radians() -> None:
    report = check(wandering(6), ToolAxis(), tolerance=10)
    assert report["tool-axis"].unit == "rad"
    assert f"peak {report.peak:.3g} rad at " in str(report)


def test_limits_of_ones_own_count_like_those_of_the_catalog() -> None:
    @keep_nonnegative
    def low(motion: Instant) -> Any:
        return 0.02 - motion.position[2]

    motion = wandering(8)
    found = check(motion, low)["low"]
    assert (found.level, found.unit) == ("position", "m")
    assert found.margin == pytest.approx(0.02 - motion.positions[:, 2].max())


def test_a_comparison_counts_equalities_and_limits_apart() -> None:
    motion = wandering(9)
    found = figures_of_merit(motion, motion, [Blade(), *LIMITS, SpeedLimit(speed=3.0)])
    assert found.residual_peak == pytest.approx(check(motion, Blade()).peak)
    wanted = {name: float(margin.min()) for name, margin in margins_of(motion).items()}
    wanted["speed-limit 2"] = wanted["speed-limit"] + 1.5
    assert found.least_margins == pytest.approx(wanted, abs=1e-9)
    assert figures_of_merit(motion, motion, LIMITS).residual_peak == 0.0
    assert json.loads(json.dumps(found.to_dict()))["least_margins"] == found.least_margins


# -------------------------------------------------------------------- the report


@pytest.fixture
def report() -> Any:
    motion = straight(
        irregular(8), 0.02, np.array([0, 0.6, 0.8]), Rotation.identity(), name="cut 3.csv"
    )
    rules = [Blade(), plane, Blade(lateral="z")]
    return check(motion, rules, tolerance=0.014, slip_share=0.7)


def test_a_report_tells_what_holds_and_what_does_not(report: Any) -> None:
    blade, flat, across = report.constraints
    assert (blade.satisfied, blade.verdict) == (True, "holds")
    assert (flat.satisfied, flat.verdict) == (False, "violated")
    assert (across.satisfied, across.verdict) == (False, "violated")
    assert not report.satisfied
    assert report.verdict == "violated: plane, blade 2"
    assert report["blade"] is blade
    assert report.worst is max(report.constraints, key=lambda c: c.peak)
    for name in ("peak", "rms", "worst_time", "share_above_tolerance", "slip_distance"):
        assert getattr(report, name) == getattr(report.worst, name)
    with pytest.raises(KeyError, match="'knife'"):
        report["knife"]


def test_a_report_prints_a_line_a_constraint(report: Any) -> None:
    lines = str(report).splitlines()
    assert len(lines) == 4
    assert lines[0].startswith("cut 3.csv: ")
    assert f"path {report.path_length * 1e3:.4g} mm" in lines[0]
    assert lines[1].startswith("  blade: HOLDS  peak 0.012 m/s at ")
    assert "slipped" in lines[1]
    assert lines[2].startswith("  plane: VIOLATED  peak ")
    assert " mm at " in lines[2]
    assert "slipped" not in lines[2]
    assert "above 0.014 m/s for 100% of the time" in lines[3]


def test_a_report_is_plain_data(report: Any) -> None:
    data = report.to_dict()
    assert json.loads(json.dumps(data)) == data
    assert data["motion"] == "cut 3.csv"
    assert data["satisfied"] is False
    assert data["verdict"] == report.verdict
    assert data["path_length"] == report.path_length
    assert [c["name"] for c in data["constraints"]] == ["blade", "plane", "blade 2"]
    assert data["constraints"][0]["peak"] == report.constraints[0].peak
    assert data["constraints"][1]["slip_distance"] is None
    assert data["constraints"][2]["verdict"] == "violated"


def test_a_report_on_a_satisfied_motion_holds() -> None:
    motion = straight(irregular(9), 0.3, np.array([1.0, 0, 0]), Rotation.identity())
    report = check(motion, [Blade()])
    assert report.satisfied
    assert report.verdict == "holds"
    assert report.to_dict()["satisfied"] is True
    assert "HOLDS" in str(report)


@pytest.mark.parametrize("factor", [0.01, 0.999, 1.001, 100.0])
def test_the_tolerance_decides(factor: float) -> None:
    motion = straight(irregular(2), 0.02, np.array([0, 1.0, 0]), Rotation.identity())
    peak = check(motion, Blade()).peak
    for tolerance, wanted in ((peak * factor, factor >= 1), (peak, True)):
        found = check(motion, Blade(), tolerance=tolerance, slip_share=1)
        assert found.satisfied == wanted


@pytest.mark.parametrize(
    ("ask", "error", "reason"),
    [
        (lambda m: check(m, []), InputError, "at least one constraint"),
        (lambda m: check(m, Blade(), tolerance=0), InputError, "tolerance"),
        (lambda m: check(m, Blade(), tolerance=-1e-3), InputError, "tolerance"),
        (lambda m: check(m, Blade(), tolerance=np.nan), InputError, "tolerance"),
        (lambda m: check(m, Blade(), tolerance=np.inf), InputError, "tolerance"),
        (lambda m: check(m, Blade(), slip_share=-0.1), InputError, "slip_share"),
        (lambda m: check(m, [Blade]), ConstraintError, "Blade()"),
    ],
)
def test_a_check_that_makes_no_sense_is_refused(
    ask: Callable[[PoseTrajectory], object], error: type[Exception], reason: str
) -> None:
    motion = straight(irregular(2), 0.02, np.array([0, 1.0, 0]), Rotation.identity())
    assert reason in refusal(error, ask, motion)


# -------------------------------------------------------------------- real recordings


@pytest.mark.recordings
def test_recorded_contours_slip_a_few_centimeters(recordings: Path) -> None:
    runs = load_demonstrations(recordings / "contour_following" / "*.csv")
    assert len(runs) == 8
    for run in runs:
        report = check(prepare(run, trim_speed=0.05, rate=120, lowpass=4.8), Blade())
        assert report.slip_distance is not None
        assert 0.02 < report.slip_distance < 0.05, str(report)
        # Eight per cent of the motion is across the blade, according to those who recorded it.
        assert 0.05 < report.slip_distance / report.path_length < 0.09


@pytest.mark.recordings
def test_a_recorded_peg_violates_the_blade(recordings: Path) -> None:
    runs = load_demonstrations(recordings / "peg_on_hole" / "*.csv")
    assert len(runs) == 3
    for run in runs:
        for motion in (run, prepare(run, rate=120, lowpass=4.8)):
            report = check(motion, Blade())
            assert not report.satisfied
            assert report.slip_distance is not None
            assert report.slip_distance > 0.3 * motion.path_length
