"""The nearest feasible trajectory: feasible, nearest, and the same seen from elsewhere."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from measures import forward_speed, slip, speed_along, spin_about, steps
from motions import eased, facing
from noslip import (
    Blade,
    Boundary,
    Constraint,
    PoseTrajectory,
    check,
    position_constraint,
    project_trajectory,
)
from noslip._typing import Floats
from noslip.constraints import Instant
from noslip.errors import ConvergenceError, InputError
from noslip.projection.request import LEARNING
from noslip.projection.result import ProjectedTrajectory
from refusals import refusal
from rules import ceiling, needle, no_roll, table
from strategies import AXES, axis_vector, seeds

BLADE = Blade()
FORWARD = (1, 0, 0)


def change(result: ProjectedTrajectory, motion: PoseTrajectory) -> float:
    """Largest change that a projection made (m and rad)."""
    moved = np.abs(result.trajectory.positions - motion.positions).max()
    return max(moved, np.linalg.norm(result.turns, axis=1).max())


@position_constraint
def ball(motion: Instant) -> Any:
    return ca.norm_2(motion.position - ca.DM([0.7, 0, -3])) - 3


@position_constraint
def lift(motion: Instant) -> Any:
    return motion.position[2] - 0.1 * ca.sin(3 * motion.time)


# -------------------------------------------------------------------- feasible


@given(seeds, st.booleans())
def test_the_blade_does_not_slip(seed: int, hold: bool) -> None:
    motion = facing(seed)
    result = project_trajectory(motion, BLADE, hold_position=hold)
    assert np.abs(slip(result.trajectory)).max() <= 1e-10
    assert result.converged
    assert result.residual <= 1e-10
    np.testing.assert_allclose(result.residuals[1:, 0], slip(result.trajectory), rtol=0, atol=1e-11)
    assert change(result, motion) > 1e-3


@given(seeds)
@settings(max_examples=15)
def test_arbitrary_orientations_are_projected_too(seed: int) -> None:
    motion = facing(seed)
    turned = replace(
        motion,
        rotations=motion.rotations * Rotation.random(random_state=seed),
        angular_velocities=None,
    )
    result = project_trajectory(turned, BLADE)
    assert np.abs(slip(result.trajectory)).max() <= 1e-10


@given(seeds)
@settings(max_examples=15)
def test_the_edge_leads_at_every_step(seed: int) -> None:
    for hold in (False, True):
        result = project_trajectory(facing(seed), BLADE, hold_position=hold)
        assert forward_speed(result.trajectory).min() >= 0
        assert result.backing == 0


@pytest.mark.parametrize("seed", range(3))
def test_position_level_constraints_hold(seed: int) -> None:
    motion = facing(seed)
    z = motion.positions[:, 2]
    assert np.abs(z).max() > 1e-2
    on_table = project_trajectory(motion, table).trajectory
    assert np.abs(on_table.positions[:, 2]).max() <= 1e-10
    on_ball = project_trajectory(motion, ball).trajectory
    off = np.linalg.norm(on_ball.positions - [0.7, 0, -3], axis=1) - 3
    assert np.abs(off).max() <= 1e-10
    lifted = project_trajectory(motion, lift).trajectory
    height = lifted.positions[:, 2] - 0.1 * np.sin(3 * motion.times)
    assert np.abs(height).max() <= 1e-10


@pytest.mark.parametrize("hold", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_a_needle_moves_along_its_axis_alone(seed: int, hold: bool) -> None:
    found = project_trajectory(facing(seed), needle, hold_position=hold).trajectory
    for axis in np.eye(3)[1:]:
        assert np.abs(speed_along(found, axis)).max() <= 1e-10
    assert np.abs(forward_speed(found)).min() > 0.1


@pytest.mark.parametrize("seed", range(3))
def test_constraints_hold_together(seed: int) -> None:
    found = project_trajectory(facing(seed), [BLADE, table]).trajectory
    assert np.abs(slip(found)).max() <= 1e-10
    assert np.abs(found.positions[:, 2]).max() <= 1e-10
    found = project_trajectory(facing(seed), [lift, BLADE, no_roll]).trajectory
    assert np.abs(slip(found)).max() <= 1e-10
    assert np.abs(found.positions[:, 2] - 0.1 * np.sin(3 * found.times)).max() <= 1e-10
    assert np.abs(spin_about(found, FORWARD)).max() <= 1e-9


@pytest.mark.parametrize("seed", range(3))
def test_a_users_constraint_on_the_angular_velocity_holds(seed: int) -> None:
    # It names no edge, so nothing is turned into the path first.
    motion = facing(seed)
    assert np.abs(spin_about(motion, FORWARD)).max() > 0.05
    result = project_trajectory(motion, no_roll)
    assert np.abs(spin_about(result.trajectory, FORWARD)).max() <= 1e-9
    np.testing.assert_allclose(result.trajectory.positions, motion.positions, atol=1e-12)


def test_no_constraint_changes_nothing() -> None:
    motion = facing(1)
    result = project_trajectory(motion, [])
    assert result.converged
    assert change(result, motion) < 1e-12


def test_a_repeated_constraint_changes_nothing_more() -> None:
    motion = facing(1)
    once, twice = (project_trajectory(motion, [BLADE] * n) for n in (1, 2))
    np.testing.assert_allclose(twice.turns, once.turns, rtol=0, atol=1e-9)
    np.testing.assert_allclose(
        twice.trajectory.positions, once.trajectory.positions, rtol=0, atol=1e-9
    )


@pytest.mark.parametrize("count", [4, 5, 6, 20])
@pytest.mark.parametrize("hold", [False, True])
def test_few_samples_are_enough(count: int, hold: bool) -> None:
    found = project_trajectory(facing(3, count), BLADE, hold_position=hold).trajectory
    assert np.abs(slip(found)).max() <= 1e-10


def test_a_tool_at_rest_stays_as_it_is() -> None:
    still = PoseTrajectory(
        times=np.arange(50) / 10,
        positions=np.ones((50, 3)),
        rotations=Rotation.from_rotvec(np.tile([0.3, 0.1, 0.2], (50, 1))),
    )
    assert change(project_trajectory(still, BLADE), still) < 1e-12


# -------------------------------------------------------------------- unchanged


@given(seeds, st.booleans())
@settings(max_examples=20)
def test_a_feasible_trajectory_comes_back_unchanged(seed: int, hold: bool) -> None:
    feasible = project_trajectory(facing(seed), BLADE).trajectory
    again = project_trajectory(feasible, BLADE, hold_position=hold)
    assert change(again, feasible) < 1e-9


def test_a_long_feasible_trajectory_comes_back_unchanged() -> None:
    feasible = project_trajectory(facing(0, 4501), BLADE).trajectory
    assert np.abs(slip(feasible)).max() <= 1e-10
    assert change(project_trajectory(feasible, BLADE), feasible) < 1e-7


def wandering(count: int, rate: float = 120.0, seed: int = 1) -> PoseTrajectory:
    """A blade that wanders about at up to half a turn of its path a second, held askew."""
    rng = np.random.default_rng(seed)
    t = np.arange(count) / rate
    x = np.zeros((count, 3))
    for _ in range(30):
        w = 2 * np.pi * rng.uniform(0.05, 0.5)
        wave = np.sin(w * t[:, None] + rng.uniform(0, 6, 3))
        x += 0.3 * rng.normal(size=3) * wave / w * [1, 1, 0.1]
    v = np.gradient(x, t, axis=0)
    yaw = np.unwrap(np.arctan2(v[:, 1], v[:, 0])) + 0.2 * np.sin(2 * np.pi * 0.3 * t)
    return PoseTrajectory(
        times=t,
        positions=x,
        rotations=Rotation.from_euler("ZY", np.column_stack([yaw, np.full(count, 0.3)])),
    )


# A hundred seconds at 120 Hz: thinned out too much, it would not follow its path.
@pytest.mark.slow
def test_a_long_recording_is_projected_as_a_short_one_is() -> None:
    found = project_trajectory(wandering(12501), BLADE, hold_position=True).trajectory
    assert np.abs(slip(found)).max() <= 1e-10


@pytest.mark.slow
def test_four_thousand_samples_are_projected_in_one_piece() -> None:
    found = project_trajectory(wandering(4000), BLADE, hold_position=True).trajectory
    assert np.abs(slip(found)).max() <= 1e-10


# -------------------------------------------------------------------- nearest


class Documented:
    """The cost that the module documents and a blade's constraint, on the dense unknowns.

    ``int (w_p |p - p_ref|^2 + mu_p |p'' - p_ref''|^2) / L^2 + w_R u |d|^2 + g |d'|^2
    + mu_R |d''|^2`` with time normalized, by sums and differences; u is the speed over its mean,
    g is ``1e-3 / (1 + (u / 0.3)^2)``.
    """

    def __init__(self, motion: PoseTrajectory, hold: bool) -> None:
        self.motion, self.hold, self.count = motion, hold, len(motion)
        self.h = 1 / (self.count - 1)
        self.length = motion.path_length
        speed = np.linalg.norm(steps(motion).linear, axis=1)
        speed = np.concatenate([speed[:1], speed])
        relative = speed / speed.mean()
        self.u = relative + 1e-3
        self.g = 1e-3 / (1 + (relative[1:] / 0.3) ** 2)

    def split(self, z: Floats) -> tuple[Floats, Floats]:
        turns = z[: 3 * self.count].reshape(-1, 3)
        moved = np.zeros_like(turns) if self.hold else z[3 * self.count :].reshape(-1, 3)
        return turns, moved

    def cost(self, z: Floats) -> float:
        turns, moved = self.split(z)
        bent = [np.diff(x, 2, axis=0) / self.h**2 for x in (turns, moved)]
        return self.h * float(
            LEARNING.position * np.sum(moved**2)
            + LEARNING.position_smoothing * np.sum(bent[1] ** 2)
            + np.sum(self.u[:, None] * turns**2)
            + np.sum(self.g[:, None] * (np.diff(turns, axis=0) / self.h) ** 2)
            + LEARNING.rotation_smoothing * np.sum(bent[0] ** 2)
        )

    def trajectory(self, z: Floats) -> PoseTrajectory:
        turns, moved = self.split(z)
        return PoseTrajectory(
            times=self.motion.times,
            positions=self.motion.positions + self.length * moved,
            rotations=Rotation.from_rotvec(turns) * self.motion.rotations,
        )

    def slip(self, z: Floats) -> Floats:
        return slip(self.trajectory(z))

    def pack(self, result: ProjectedTrajectory) -> Floats:
        moved = (result.trajectory.positions - self.motion.positions) / self.length
        return np.concatenate([result.turns.ravel()] + ([] if self.hold else [moved.ravel()]))


@pytest.mark.slow
@pytest.mark.parametrize("hold", [True, False])
@pytest.mark.parametrize("seed", [0, 1])
def test_the_result_minimizes_the_documented_cost(seed: int, hold: bool) -> None:
    motion = facing(seed, 12)
    problem = Documented(motion, hold)
    result = project_trajectory(motion, BLADE, hold_position=hold)
    mine = problem.pack(result)
    assert np.abs(problem.slip(mine)).max() < 1e-10
    # Displacements weigh 1e5 times as much: scaled, so that the solver sees one size.
    scale = np.ones_like(mine)
    scale[3 * len(motion) :] = LEARNING.position**-0.5
    found = minimize(
        lambda y: problem.cost(y * scale),
        np.zeros_like(mine),
        method="SLSQP",
        constraints={"type": "eq", "fun": lambda y: problem.slip(y * scale)},
        options={"maxiter": 500, "ftol": 1e-14},
    )
    assert found.success
    theirs = found.x * scale
    assert problem.cost(mine) <= problem.cost(theirs) * (1 + 1e-6)
    np.testing.assert_allclose(mine[: 3 * len(motion)], theirs[: 3 * len(motion)], atol=2e-4)
    np.testing.assert_allclose(mine[3 * len(motion) :], theirs[3 * len(motion) :], atol=2e-6)


@pytest.mark.parametrize("hold", [True, False])
def test_the_cost_has_no_slope_along_what_the_constraint_allows(hold: bool) -> None:
    # First-order optimality: the gradient is a combination of the constraint's gradients.
    motion = facing(4, 15)
    problem = Documented(motion, hold)
    z = problem.pack(project_trajectory(motion, BLADE, hold_position=hold))

    def differences(function: Any) -> Floats:
        rows = []
        for i in range(len(z)):
            nudge = np.zeros_like(z)
            nudge[i] = 1e-6
            rows.append((function(z + nudge) - function(z - nudge)) / 2e-6)
        return np.array(rows)

    gradient, slopes = differences(problem.cost), differences(problem.slip)
    multipliers = np.linalg.lstsq(slopes, gradient, rcond=None)[0]
    left = gradient - slopes @ multipliers
    assert np.linalg.norm(left) < 1e-6 * np.linalg.norm(gradient)
    assert np.linalg.norm(gradient) > 1e-3


def test_a_heavier_position_gives_way_less() -> None:
    motion = facing(2)
    moved, turned = [], []
    for weight in (1e3, 1e5, 1e7):
        result = project_trajectory(motion, BLADE, position_weight=weight)
        moved.append(np.abs(result.trajectory.positions - motion.positions).max())
        turned.append(np.linalg.norm(result.turns))
    held = project_trajectory(motion, BLADE, hold_position=True)
    assert moved == sorted(moved, reverse=True)
    assert turned == sorted(turned)
    assert turned[-1] <= np.linalg.norm(held.turns) * (1 + 1e-3)


def test_more_smoothing_bends_the_correction_less() -> None:
    motion = facing(2)
    bends = []
    for smoothing in (1e-8, 1e-6, 1e-4):
        result = project_trajectory(motion, BLADE, hold_position=True, rotation_smoothing=smoothing)
        assert result.smoothing == smoothing
        bends.append(np.linalg.norm(np.diff(result.turns, 2, axis=0)))
    assert bends == sorted(bends, reverse=True)


# -------------------------------------------------------------------- what is kept, what is asked


@given(seeds)
@settings(max_examples=15)
def test_held_positions_are_the_same_to_the_bit(seed: int) -> None:
    motion = facing(seed)
    found = project_trajectory(motion, BLADE, hold_position=True).trajectory
    np.testing.assert_array_equal(found.positions, motion.positions)
    np.testing.assert_array_equal(found.times, motion.times)


@pytest.mark.parametrize("end", ["start", "end"])
@pytest.mark.parametrize("fixed", ["free", "position", "rotation", "pose"])
def test_what_is_fixed_of_an_end_stays(end: Any, fixed: Any) -> None:
    motion = facing(2)
    result = project_trajectory(motion, BLADE, **{end: fixed})
    k = 0 if end == "start" else -1
    moved = np.abs(result.trajectory.positions[k] - motion.positions[k]).max()
    turned = np.linalg.norm(result.turns[k])
    assert (moved < 1e-15) == (fixed in ("position", "pose"))
    assert (turned < 1e-15) == (fixed in ("rotation", "pose"))
    assert np.abs(slip(result.trajectory)).max() <= 1e-10


@given(seeds)
@settings(max_examples=15)
def test_other_end_poses_are_reached_exactly(seed: int) -> None:
    motion = facing(seed)
    rng = np.random.default_rng(seed)
    end_position = motion.positions[-1] + [0.1, 0.15, 0.05]
    end_rotation = Rotation.from_rotvec(rng.uniform(-0.2, 0.2, 3)) * motion.rotations[-1]
    start_position = motion.positions[0] + rng.uniform(-0.05, 0.05, 3)
    start_rotation = Rotation.from_rotvec(rng.uniform(-0.2, 0.2, 3)) * motion.rotations[0]
    start = Boundary(0, start_position, start_rotation)
    end = Boundary(1, end_position, end_rotation)
    found = project_trajectory(motion, BLADE, start=start, end=end).trajectory
    for k, position, rotation in (
        (0, start_position, start_rotation),
        (-1, end_position, end_rotation),
    ):
        np.testing.assert_allclose(found.positions[k], position, atol=1e-14)
        assert (found.rotations[k] * rotation.inv()).magnitude() < 1e-14
    assert np.abs(slip(found)).max() <= 1e-10


def test_an_end_rotation_is_reached_with_the_position_held() -> None:
    # Turned about the lateral axis, which stays perpendicular to the last step.
    motion = facing(6)
    last = project_trajectory(motion, BLADE, hold_position=True).trajectory.rotations[-1]
    wanted = last * Rotation.from_rotvec([0.0, 0.3, 0.0])
    found = project_trajectory(motion, BLADE, hold_position=True, end=Boundary(1, rotation=wanted))
    assert (found.trajectory.rotations[-1] * wanted.inv()).magnitude() < 1e-14
    assert np.abs(slip(found.trajectory)).max() <= 1e-10
    # Turned about the edge's normal, the last step would be askew, and no position may give way.
    askew = last * Rotation.from_rotvec([0.0, 0.0, 0.3])
    with pytest.raises(ConvergenceError, match="hold_position=False"):
        project_trajectory(motion, BLADE, hold_position=True, end=Boundary(1, rotation=askew))


@pytest.mark.parametrize("end", ["start", "end"])
@pytest.mark.parametrize("angle", [0.035, 0.1])
def test_a_tool_that_would_swing_from_step_to_step_is_refused(end: str, angle: float) -> None:
    # Held positions say where it heads midway: beside a rotation that does not fit it alternates.
    # A circle at constant speed: what is off is off for ever.
    turns = Rotation.from_rotvec(np.outer(np.linspace(0, 1, 201), [0.0, 0.0, 1.0]))
    motion = PoseTrajectory(np.linspace(0, 2, 201), turns.apply([0.0, -0.1, 0.0]), turns)
    askew = motion.rotations[{"start": 0, "end": -1}[end]] * Rotation.from_rotvec([0, 0, angle])
    asked: dict[str, Any] = {end: Boundary(float(end == "end"), rotation=askew)}
    with pytest.raises(ConvergenceError, match="would swing by") as told:
        project_trajectory(motion, BLADE, hold_position=True, **asked)
    swing = float(re.findall(r"by ([0-9.]+) degrees", str(told.value))[0])
    assert np.radians(swing) == pytest.approx(angle, rel=0.02)
    # The remedy that is named.
    found = project_trajectory(motion, BLADE, hold_position=False, **asked).trajectory
    assert np.abs(slip(found)).max() <= 1e-10


def test_velocities_of_the_result_are_those_of_its_motion() -> None:
    found = project_trajectory(facing(1, 1001), BLADE).trajectory
    v, w = steps(found).linear, steps(found).angular
    np.testing.assert_allclose(found.linear_velocities[1:-1], (v[:-1] + v[1:]) / 2, atol=1e-9)
    np.testing.assert_allclose(found.angular_velocities[1:-1], (w[:-1] + w[1:]) / 2, atol=1e-9)


def test_turns_lead_from_the_given_to_the_found_rotations() -> None:
    motion = facing(1)
    result = project_trajectory(motion, BLADE)
    turned = Rotation.from_rotvec(result.turns) * motion.rotations
    assert (turned * result.trajectory.rotations.inv()).magnitude().max() < 1e-14
    assert result.trajectory.name == motion.name


# -------------------------------------------------------------------- seen from elsewhere


@given(seeds, st.booleans())
@settings(max_examples=15)
def test_turning_the_world_turns_the_result(seed: int, hold: bool) -> None:
    motion = facing(seed)
    world = Rotation.random(random_state=seed)
    moved = PoseTrajectory(
        times=motion.times + 7.5,
        positions=world.apply(motion.positions) + np.array([1.0, -2.0, 0.5]),
        rotations=world * motion.rotations,
    )
    here = project_trajectory(motion, BLADE, hold_position=hold)
    there = project_trajectory(moved, BLADE, hold_position=hold)
    np.testing.assert_allclose(there.turns, world.apply(here.turns), rtol=0, atol=1e-7)
    expected = world.apply(here.trajectory.positions) + np.array([1.0, -2.0, 0.5])
    np.testing.assert_allclose(there.trajectory.positions, expected, rtol=0, atol=1e-8)


@given(seeds, st.floats(0.05, 600), st.floats(0.01, 100))
@settings(max_examples=15)
def test_other_clocks_and_yardsticks_give_the_same_result(
    seed: int, duration: float, scale: float
) -> None:
    motion = facing(seed)
    other = PoseTrajectory(
        times=motion.times * duration,
        positions=motion.positions * scale,
        rotations=motion.rotations,
    )
    here, there = (project_trajectory(m, BLADE) for m in (motion, other))
    np.testing.assert_allclose(there.turns, here.turns, rtol=0, atol=1e-7)
    np.testing.assert_allclose(
        there.trajectory.positions / scale, here.trajectory.positions, rtol=0, atol=1e-8
    )
    assert there.residual * duration / scale <= 1e-9


@pytest.mark.parametrize("hold", [False, True])
def test_the_names_of_the_body_axes_make_no_difference(hold: bool) -> None:
    motion = facing(2, 101)
    here = project_trajectory(motion, BLADE, hold_position=hold)
    for lateral, edge in itertools.permutations(AXES, 2):
        if lateral[-1] == edge[-1]:
            continue
        x, y = axis_vector(edge), axis_vector(lateral)
        renamed = Rotation.from_matrix(np.column_stack([x, y, np.cross(x, y)]))
        other = PoseTrajectory(
            times=motion.times,
            positions=motion.positions,
            rotations=motion.rotations * renamed.inv(),
        )
        there = project_trajectory(other, Blade(lateral, edge), hold_position=hold)
        np.testing.assert_allclose(there.turns, here.turns, rtol=0, atol=1e-7)


@pytest.mark.parametrize("hold", [False, True])
def test_a_mirrored_motion_has_a_mirrored_result(hold: bool) -> None:
    motion = facing(5)
    mirror = np.array([1.0, -1.0, 1.0])
    matrices = motion.rotations.as_matrix() * np.outer(mirror, mirror)
    other = PoseTrajectory(
        times=motion.times,
        positions=motion.positions * mirror,
        rotations=Rotation.from_matrix(matrices),
    )
    here, there = (project_trajectory(m, BLADE, hold_position=hold) for m in (motion, other))
    # Rotation vectors are axial: what a mirror keeps is their part along its normal.
    np.testing.assert_allclose(there.turns, -here.turns * mirror, rtol=0, atol=1e-7)


# Such stamps are rounded to 0.2 us, which is 2e-4 of a step here.
def test_stamps_since_1970_leave_no_residual() -> None:
    motion = facing(1, 1001)
    late = replace(motion, times=motion.times + 1.7e9)
    assert late.is_uniform
    result = project_trajectory(late, BLADE)
    assert result.converged
    assert result.residual <= 1e-9


# -------------------------------------------------------------------- backwards on purpose


def sawing(hold_rest: int = 40) -> PoseTrajectory:
    """Cut forwards, rest, and come back along a bent path with the blade held as before."""
    go = np.linspace(0, 1, 121)
    way = np.concatenate([eased(go), np.ones(hold_rest), eased(go)[::-1]])
    positions = np.column_stack([way, 0.1 * np.sin(2 * way), 0 * way])
    heading = np.arctan(0.2 * np.cos(2 * way)) + 0.2 * np.sin(5 * way)
    return PoseTrajectory(
        times=np.arange(len(way)) / 100,
        positions=positions,
        rotations=Rotation.from_euler("Z", heading),
        name="saw",
    )


@pytest.mark.parametrize("hold", [False, True])
def test_a_motion_backwards_stays_backwards_and_is_reported(hold: bool) -> None:
    motion = sawing()
    result = project_trajectory(motion, BLADE, hold_position=hold)
    assert result.backing == 1
    speed = forward_speed(result.trajectory)
    assert np.all(speed[10:110] > 0)
    assert np.all(speed[170:270] < 0)
    assert np.abs(slip(result.trajectory)).max() <= 1e-10
    # It was held 11 degrees askew at most; nobody turned it round.
    assert np.degrees(np.linalg.norm(result.turns, axis=1).max()) < 20


def test_a_tool_recorded_backwards_is_turned_round_by_its_edge() -> None:
    motion = facing(2)
    backwards = project_trajectory(motion, Blade(edge="-x"))
    assert backwards.backing == 1
    assert backwards.trajectory.rotations[50].apply([-1, 0, 0]) @ steps(motion).linear[50] < 0
    turned = PoseTrajectory(
        times=motion.times,
        positions=motion.positions,
        rotations=motion.rotations * Rotation.from_euler("z", np.pi),
    )
    result = project_trajectory(turned, Blade(edge="-x"))
    assert result.backing == 0
    assert forward_speed(result.trajectory).max() <= 0


# -------------------------------------------------------------------- refused


def test_samples_must_be_uniform_and_enough() -> None:
    motion = facing(1)
    times = motion.times.copy()
    times[50] += 1e-3
    for given_motion in (replace(motion, times=times), motion[:3]):
        message = refusal(InputError, project_trajectory, given_motion, BLADE)
        assert "4 or more uniform samples" in message
        assert "resample" in message
        assert motion.name in message


@pytest.mark.parametrize(
    ("asked", "named"),
    [
        ({"start": "both"}, "start"),
        ({"end": None}, "end"),
        ({"hold_position": True, "end": Boundary(1, [0, 0, 0])}, "hold_position"),
        ({"hold_position": True, "start": Boundary(0, [0, 0, 0])}, "hold_position"),
        ({"start": Boundary(1, [0, 0, 0])}, "start"),
        ({"end": Boundary(0.5, [0, 0, 0])}, "end"),
        ({"boundaries": [Boundary(0.5, angular_velocity=[0, 0, 0])]}, "velocity at 0.5"),
        ({"max_iterations": 0}, "max_iterations"),
        pytest.param({"position_weight": -1.0}, "position_weight"),
        pytest.param({"position_smoothing": -1.0}, "position_smoothing"),
        pytest.param({"rotation_smoothing": -1.0}, "rotation_smoothing"),
        pytest.param({"rotation_smoothing": np.nan}, "rotation_smoothing"),
    ],
)
def test_contradictory_options_are_refused_by_name(asked: dict[str, Any], named: str) -> None:
    assert named in refusal(InputError, project_trajectory, facing(1, 51), BLADE, **asked)


@pytest.mark.parametrize(
    ("rules", "asked", "advice"),
    [
        ([table, ceiling], {}, "trim its rests"),
        ([table], {"hold_position": True}, "let the position give way (hold_position=False)"),
        ([table], {"end": "pose"}, "free its ends"),
        ([table, BLADE], {"end": Boundary(1, [1.5, 0, 0.2])}, "free its ends"),
    ],
)
def test_the_impossible_is_refused_with_what_to_change(
    rules: Sequence[Constraint], asked: dict[str, Any], advice: str
) -> None:
    motion = facing(1, 101)
    message = refusal(ConvergenceError, project_trajectory, motion, rules, **asked)
    assert motion.name in message
    assert ", ".join(rule.name for rule in rules) in message
    assert advice in message
    assert "rotation_smoothing" not in message


def test_failure_can_be_returned_instead() -> None:
    result = project_trajectory(facing(1, 101), [table, ceiling], on_failure="return")
    assert not result.converged
    assert result.residual > 0.1
    assert np.all(np.isfinite(result.trajectory.positions))


# Even of a first one that is fixed where the constraint does not hold.
def test_the_reported_residual_is_the_largest_of_all_samples() -> None:
    motion = facing(1, 101)
    result = project_trajectory(motion, table, start="pose")
    assert result.residual == pytest.approx(np.abs(result.trajectory.positions[:, 2]).max())


def test_the_result_passes_the_check() -> None:
    motion = facing(3)
    assert not check(motion, BLADE).satisfied
    assert check(project_trajectory(motion, BLADE).trajectory, BLADE, tolerance=1e-10).satisfied
