"""Learned primitives: their motion satisfies the constraints, and follows the demonstration."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from learned import numerical
from measures import assert_same_poses, forward_speed, rms, slip, spin_about, steps
from motions import eased, facing, numerical_example
from noslip import (
    Blade,
    Controller,
    PoseTrajectory,
    check,
    learn,
    load_demonstrations,
    prepare,
    project_trajectory,
)
from noslip._typing import Floats
from noslip.constraints import KeepOutSphere, Wheel
from noslip.errors import ConstraintError, ConvergenceError, InputError, RecordingWarning
from refusals import refusal
from rules import ceiling, no_roll, table
from strategies import seeds, triple

BLADE = Blade()
EPSILON = np.finfo(float).eps


def cut(
    seed: int, count: int = 601, *, duration: float = 2.0, flat: bool = False
) -> PoseTrajectory:
    """Random, its edge along its path up to a random smooth error of 20 degrees."""
    return facing(seed, count, askew=0.35, flat=flat, duration=duration)


def turned(motion: PoseTrajectory, seed: int) -> PoseTrajectory:
    """Held in any way at all."""
    return PoseTrajectory(
        times=motion.times,
        positions=motion.positions,
        rotations=motion.rotations * Rotation.random(random_state=seed),
        name=motion.name,
    )


def nudge(rng: np.random.Generator) -> Rotation:
    return Rotation.from_rotvec(0.2 * rng.normal(size=3))


def distances(motion: PoseTrajectory, demonstration: PoseTrajectory) -> Floats:
    """Return the way to the demonstration at the same fraction of the motion, shape (N,)."""
    fractions = motion.times / motion.times[-1]
    reference = demonstration.resampled(
        times=demonstration.times[0] + fractions * demonstration.duration
    )
    return np.asarray(np.linalg.norm(motion.positions - reference.positions, axis=1))


# -------------------------------------------------------------------- satisfied, whatever is asked


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("motions")


@settings(max_examples=30)
@given(
    seed=seeds,
    arbitrary=st.booleans(),
    duration=st.floats(0.05, 600),
    steps=st.none() | st.floats(50, 2000),
    moved=st.booleans(),
)
def test_what_is_written_to_a_file_does_not_slip(
    folder: Path,
    seed: int,
    arbitrary: bool,
    duration: float,
    steps: float | None,
    moved: bool,
) -> None:
    rng = np.random.default_rng(seed)
    demonstration = turned(cut(seed), seed) if arbitrary else cut(seed)
    dmp = learn(demonstration, [BLADE])
    asked: dict[str, Any] = {"duration": duration}
    if steps is not None:
        asked["time_step"] = duration / steps
    if moved:
        asked |= {
            "start_position": dmp.start_position + 0.1 * rng.normal(size=3),
            "goal_position": dmp.goal_position + 0.2 * rng.normal(size=3),
            "start_rotation": Rotation.from_rotvec(0.2 * rng.normal(size=3)) * dmp.start_rotation,
            "goal_rotation": Rotation.from_rotvec(0.2 * rng.normal(size=3)) * dmp.goal_rotation,
        }
    motion = dmp.rollout(**asked)
    table_of = np.loadtxt(motion.to_csv(folder / "motion.csv"), delimiter=",", skiprows=1)
    assert np.all(np.isfinite(table_of))
    t, p = table_of[:, 0], table_of[:, 1:4]
    written = PoseTrajectory(t, p, Rotation.from_quat(table_of[:, 4:], scalar_first=True))
    step = np.diff(t)[:, None]
    # A coordinate is a multiple of the distance between neighboring floats there; no difference
    # of two of them, over the period, is finer than that.
    rounding = 4 * EPSILON * np.abs(p).max() / step.min()
    speed = np.abs(np.diff(p, axis=0) / step).max()
    assert np.abs(slip(written)).max() <= 1e-10 + rounding + 8 * EPSILON * speed
    assert np.abs(motion.constraint_residuals).max() <= 1e-10


@given(seeds)
@settings(max_examples=25)
def test_learned_motions_follow_their_demonstrations(seed: int) -> None:
    demonstration = cut(seed)
    motion = learn(demonstration, [BLADE]).rollout()
    off = distances(motion, demonstration)
    assert rms(off) <= 8e-3 * demonstration.path_length
    assert off[-1] <= 1e-2 * demonstration.path_length
    # The edge leads, as it does in the demonstration.
    assert forward_speed(demonstration).min() > 0
    assert forward_speed(motion).min() >= 0
    assert motion.duration == pytest.approx(demonstration.duration, rel=1e-12)


def follows(count: int, position: float, work: float) -> None:
    for seed in range(8):
        demonstration = cut(seed, count)
        dmp = learn(demonstration, [BLADE])
        feasible = project_trajectory(demonstration, [BLADE]).trajectory
        motion = dmp.rollout()
        assert rms(distances(motion, feasible)) <= position * demonstration.path_length
        # The coupling term has next to nothing to do, compared to the demonstrated orientation.
        done = [rms(m.constraint_forces) for m in (motion, dmp.constrained.rollout())]
        assert done[0] <= work * done[1]


def test_learned_motions_follow_their_projections() -> None:
    follows(601, position=1e-3, work=0.2)


# A correction may begin with a sharp turn within a few samples, of which no difference of samples
# tells the velocity at the start.  The step's own inverse does: the start velocity from which the
# first, half kick gives the first step of the projected trajectory, (v - K / (h/2) (x* - x)) / P.
# With it, these motions are 5e-5 of the path from their projections, and the work is below 0.08.
@pytest.mark.parametrize("count", [601, 1200])
def test_learned_motions_follow_their_projections_closely(count: int) -> None:
    follows(count, position=1e-4, work=0.1)


@given(seeds)
@settings(max_examples=15)
def test_the_comparison_cases_are_the_papers(seed: int) -> None:
    demonstration = cut(seed)
    dmp = learn(demonstration, [BLADE])
    # Regular: tracks position and orientation, and so slips as the demonstration does.
    regular = dmp.regular.rollout()
    assert distances(regular, demonstration).max() <= 2e-5 * demonstration.path_length
    assert np.abs(slip(regular) - slip(demonstration)).max() <= 1e-2
    # Constrained: keeps the demonstrated orientation, and pays with its position.
    constrained = dmp.constrained.rollout()
    np.testing.assert_array_equal(constrained.rotations.as_quat(), regular.rotations.as_quat())
    assert np.abs(slip(constrained)).max() <= 1e-10
    off = distances(constrained, demonstration).max()
    assert off > distances(dmp.rollout(), demonstration).max()


@pytest.mark.parametrize(("count", "steps"), [(301, None), (601, 100), (601, 2000)])
def test_the_constrained_case_keeps_the_demonstrated_orientation_at_any_step(
    count: int, steps: int | None
) -> None:
    dmp = learn(cut(2, count), [BLADE])
    time_step = None if steps is None else dmp.duration / steps
    constrained = dmp.constrained.rollout(time_step=time_step)
    regular = dmp.regular.rollout(time_step=time_step)
    assert (constrained.rotations * regular.rotations.inv()).magnitude().max() < 1e-12


# The learned rotation is shifted in time by half the difference of the steps, and its start is not:
# where a motion turns quickly from its first moment, the position pays for what that leaves.
@pytest.mark.parametrize(("steps", "share"), [(200, 1e-2), (300, 5e-3), (1000, 5e-3), (4000, 5e-3)])
def test_other_steps_make_nearly_the_same_motion(steps: int, share: float) -> None:
    for seed in range(6):
        demonstration = cut(seed)
        motion = learn(demonstration, [BLADE]).rollout(time_step=demonstration.duration / steps)
        assert rms(distances(motion, demonstration)) <= share * demonstration.path_length


# -------------------------------------------------------------------- the numerical example


def test_numerical_example_optimized() -> None:
    demonstration, motion = numerical_example(), numerical().rollout()
    np.testing.assert_allclose(motion.times, demonstration.times, rtol=0, atol=1e-12)
    assert np.abs(slip(motion)).max() <= 1e-10
    off = np.linalg.norm(motion.positions - demonstration.positions, axis=1)
    assert rms(off) <= 1.5e-3
    assert off[-1] <= 2e-3
    assert forward_speed(motion).min() >= 0
    changed = (motion.rotations * demonstration.rotations.inv()).magnitude()
    assert rms(changed) <= np.radians(67)


def test_numerical_example_turns_gently() -> None:
    motion = numerical().rollout()
    spin = steps(motion).angular
    assert np.linalg.norm(spin, axis=1).max() <= 12
    assert np.linalg.norm(np.diff(spin, axis=0), axis=1).max() / 1e-3 <= 250


def test_numerical_example_regular() -> None:
    demonstration, motion = numerical_example(), numerical().regular.rollout()
    off = np.linalg.norm(motion.positions - demonstration.positions, axis=1)
    assert rms(off) <= 1.5e-3
    assert np.abs(slip(motion)).max() > 0.5


def test_numerical_example_constrained() -> None:
    demonstration, motion = numerical_example(), numerical().constrained.rollout()
    assert np.abs(slip(motion)).max() <= 1e-10
    kept = (motion.rotations * demonstration.rotations.inv()).magnitude()
    assert kept.max() <= 1e-4
    off = np.linalg.norm(motion.positions - demonstration.positions, axis=1)
    assert off.max() > 0.1


# -------------------------------------------------------------------- recorded contours


@pytest.mark.recordings
@pytest.mark.parametrize("trimmed", ["by its mark", "by its speed"])
def test_recorded_contours_are_learned_without_slip(recordings: Path, trimmed: str) -> None:
    files = sorted((recordings / "contour_following").glob("*.csv"))
    assert len(files) == 8
    for file in files:
        [run] = load_demonstrations(file)
        if trimmed == "by its speed":
            demonstration = prepare(run, trim_speed=0.05, rate=120, lowpass=4.8)
        else:
            marks = np.genfromtxt(file, delimiter=",", names=True)["moving"]
            moving = np.flatnonzero(marks == 1)
            assert len(marks) == len(run)
            demonstration = prepare(run[moving[0] : moving[-1] + 1], rate=120, lowpass=4.8)
        dmp = learn(demonstration, [BLADE])
        motion = dmp.rollout()
        assert np.abs(slip(motion)).max() <= 1e-10, file.name
        backs_up = file.stem in ("data_demo_a_2", "data_demo_d_1")
        assert rms(distances(motion, demonstration)) <= (1.5e-3 if backs_up else 1e-3), file.name
        fractions = motion.times / motion.times[-1]
        held = demonstration.resampled(
            times=demonstration.times[0] + fractions * demonstration.duration
        ).rotations
        assert rms((motion.rotations * held.inv()).magnitude()) <= np.radians(8), file.name
        (record,) = dmp.record
        assert record.rotation_change <= np.radians(8)
        if trimmed == "by its speed":
            assert record.iterations <= 5
            assert record.position_change <= 7e-4 * demonstration.path_length


# -------------------------------------------------------------------- how it learns


def test_without_constraints_a_pose_primitive_is_learned() -> None:
    demonstration = cut(1)
    learned, plain = learn(demonstration), learn(demonstration)
    assert learned.constraints == ()
    (record,) = learned.record
    assert (record.iterations, record.position_change) == (0, 0.0)
    mine, theirs = learned.rollout(), plain.rollout()
    assert_same_poses(mine, theirs)
    assert mine.constraint_residuals.shape == (len(mine), 0)


@pytest.mark.parametrize("start", [0.0, 1234.5])
@pytest.mark.parametrize(("count", "samples"), [(25, 409), (301, 601), (1200, 1200)])
def test_any_rate_and_start_time_will_do(count: int, samples: int, start: float) -> None:
    demonstration = cut(2, count)
    late = PoseTrajectory(
        times=demonstration.times + start,
        positions=demonstration.positions,
        rotations=demonstration.rotations,
    )
    motion = learn(late, [BLADE]).rollout()
    assert len(motion) == samples
    assert np.abs(slip(motion)).max() <= 1e-10
    assert rms(distances(motion, cut(2, 1200))) <= 5e-3


def test_several_demonstrations_give_one_motion_among_them() -> None:
    demonstrations = [cut(seed, duration=1.0 + k) for k, seed in enumerate((1, 2, 3))]
    with pytest.warns(RecordingWarning, match="starts lie"):
        dmp = learn(demonstrations, [BLADE])
    assert [record.demonstration for record in dmp.record] == ["cut 1", "cut 2", "cut 3"]
    motion = dmp.rollout()
    assert motion.duration == pytest.approx(2.0)
    assert np.abs(slip(motion)).max() <= 1e-10
    mean = np.mean([d.positions for d in demonstrations], axis=0)
    # The coupling term has to move it there: a mean of feasible motions is not feasible.
    assert rms(np.linalg.norm(motion.positions - mean, axis=1)) < 0.05
    goals = [d.positions[-1] for d in demonstrations]
    np.testing.assert_allclose(dmp.goal_position, np.mean(goals, axis=0), rtol=0, atol=5e-3)


@pytest.mark.parametrize(("at", "where"), [(0, "starts"), (-1, "ends"), (100, "")])
def test_an_end_that_an_obstacle_moves_is_told(at: int, where: str) -> None:
    demonstration = facing(1, 200)
    center = triple(demonstration.positions[at])
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        dmp = learn(demonstration, [BLADE, KeepOutSphere(center=center, radius=0.05)])
    motion = dmp.rollout()
    told = [str(each.message) for each in caught if "clear of it" in str(each.message)]
    assert [message.split()[2] for message in told] == [where] * bool(where)
    for one, k in (("starts", 0), ("ends", -1)):
        off = np.linalg.norm(motion.positions[k] - demonstration.positions[k])
        assert (off > 0.04) == (one == where)
        if one == where:
            assert "keep-out-sphere" in told[0]
            assert float(told[0].split()[3]) == pytest.approx(1e3 * off, rel=0.01)


def bend(name: str, turn: float) -> PoseTrajectory:
    """A wheel's way along an arc that turns it so far (rad)."""
    angle = turn * eased(np.linspace(0, 1, 101))
    path = np.column_stack([np.sin(angle), 1 - np.cos(angle), 0 * angle]) / turn
    turns = Rotation.from_euler("z", angle[:, None])
    return PoseTrajectory(np.linspace(0, 2, 101), path, turns, name=name)


@pytest.mark.parametrize(("right", "away"), [(-2.0, True), (0.5, False)])
def test_a_mean_that_faces_away_from_a_demonstration_is_told(right: float, away: bool) -> None:
    demonstrations = [bend("left", 2.0), bend("also left", 2.0), bend("right", right)]
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        dmp = learn(demonstrations, [Wheel()])
    told = [str(each.message) for each in caught if "facing away" in str(each.message)]
    apart = (dmp.rollout().rotations[-1].inv() * demonstrations[-1].rotations[-1]).magnitude()
    assert bool(told) == away == bool(np.degrees(apart) > 90)
    if away:
        assert f"from 1 of 3 demonstrations, the most right, by {np.degrees(apart):.0f} " in told[0]


def test_the_record_tells_what_the_projection_did() -> None:
    demonstration = cut(4, 601)
    dmp = learn(demonstration, [BLADE], hold_position=True)
    [record] = dmp.record
    result = project_trajectory(demonstration, [BLADE], hold_position=True)
    assert record.demonstration == "cut 4"
    assert record.samples == 601
    assert record.position_change == 0.0
    assert record.rotation_change == pytest.approx(
        rms(np.linalg.norm(result.turns, axis=1)), rel=1e-12
    )
    assert record.residual == result.residual <= 1e-10
    assert (record.iterations, record.backing) == (result.iterations, 0)
    assert record.smoothing == result.smoothing


@given(seed=seeds)
@settings(max_examples=5)
def test_the_initial_velocity_projected_is_the_one_learned(seed: int) -> None:
    """Eq. 22 of the paper: ``v_0`` less its part across the blade, as it is held at the start."""
    demonstration = cut(seed)
    plain, projected = (
        learn(demonstration, [BLADE], project_start=p) for p in ("nothing", "velocity")
    )
    for held, before, law in (
        (demonstration.rotations[0], plain.demonstrated, projected.demonstrated),
        (plain.law.start_rotation, plain.law, projected.law),
    ):
        lateral = held.apply([0, 1, 0])
        v = before.start_velocity[:3]
        np.testing.assert_allclose(
            law.start_velocity[:3], v - lateral * (lateral @ v), rtol=0, atol=1e-12
        )
        np.testing.assert_array_equal(law.start_velocity[3:], before.start_velocity[3:])
    recorded = demonstration.linear_velocities[0] * demonstration.duration
    lateral = demonstration.rotations[0].apply([0, 1, 0])
    assume(abs(lateral @ recorded) > 1e-3)
    np.testing.assert_allclose(
        projected.demonstrated.start_velocity[:3],
        recorded - lateral * (lateral @ recorded),
        rtol=0,
        atol=1e-3,
    )
    # The unconstrained motion begins differently, and comes back to the demonstration.
    free = [dmp.regular.rollout() for dmp in (plain, projected)]
    gap = distances(*free)
    assert gap.max() > 1e-5
    assert gap[-1] < 1e-3 * gap.max()


def test_progress_is_reported_after_each_demonstration() -> None:
    seen: list[tuple[int, int]] = []
    learn([cut(1), cut(1)], [BLADE], progress=lambda done, of: seen.append((done, of)))
    assert seen == [(1, 2), (2, 2)]


def test_held_positions_turn_the_tool_alone() -> None:
    demonstration = cut(5)
    [held], [free] = (
        learn(demonstration, [BLADE], hold_position=hold).record for hold in (True, False)
    )
    assert held.position_change == 0.0
    assert 0.0 < free.position_change < 1e-3 * demonstration.path_length
    assert held.rotation_change > free.rotation_change


@pytest.mark.parametrize("end", ["start", "end"])
def test_a_fixed_end_pose_is_kept(end: Any) -> None:
    demonstration = cut(6)
    dmp = learn(demonstration, [BLADE], **{end: "pose"})
    k = 0 if end == "start" else -1
    found = dmp.start_rotation if end == "start" else dmp.goal_rotation
    assert (found * demonstration.rotations[k].inv()).magnitude() < 1e-9
    free = learn(demonstration, [BLADE])
    moved = free.start_rotation if end == "start" else free.goal_rotation
    assert (moved * demonstration.rotations[k].inv()).magnitude() > 1e-3


@pytest.mark.parametrize("seed", range(3))
def test_constraints_of_both_levels_hold_together(seed: int) -> None:
    dmp = learn(cut(seed, flat=True), [BLADE, table])
    for asked in ({}, {"goal_position": dmp.goal_position + np.array([0.1, 0.1, 0])}):
        motion = dmp.rollout(**asked)
        assert np.abs(slip(motion)).max() <= 1e-10
        assert np.abs(motion.positions[:, 2]).max() <= 1e-10
    assert motion.constraint_names == ("blade", "table")


def test_a_rule_about_rotations_holds_where_they_may_give_way() -> None:
    dmp = learn(cut(7), [BLADE, no_roll], metric=(1,) * 6)
    motion = dmp.rollout()
    assert np.abs(slip(motion)).max() <= 1e-10
    assert np.abs(spin_about(motion, (1, 0, 0))).max() <= 1e-10


@given(seeds)
@settings(max_examples=10)
def test_an_offset_start_is_led_onto_a_position_constraint(seed: int) -> None:
    dmp = learn(cut(seed, flat=True), [table], stabilization=30.0)
    motion = dmp.rollout(start_position=dmp.start_position + np.array([0, 0, 0.05]))
    found = motion.positions[:, 2]
    assert found[0] == pytest.approx(0.05, abs=1e-9)
    assert np.all(np.diff(found) < 1e-12)
    x = 30.0 * motion.times / motion.times[-1]
    np.testing.assert_allclose(found, 0.05 * np.exp(-x), rtol=0, atol=1e-9)
    assert abs(found[-1]) < 1e-9


def test_the_check_of_a_motion_agrees() -> None:
    assert check(numerical().rollout(), BLADE, tolerance=1e-10).satisfied
    assert not check(numerical().regular.rollout(), BLADE).satisfied


def test_other_basis_functions_and_constants_are_used() -> None:
    dmp = learn(cut(8), [BLADE], basis_functions=40, alpha=30, beta=7.5, alpha_s=2.0, ridge=1e-5)
    for law in (dmp.law, dmp.regular.law):
        assert law.basis.count == 40
        assert (law.attractor.alpha, law.attractor.beta) == (30, 7.5)
        assert law.clock.alpha_s == 2.0
    assert np.abs(slip(dmp.rollout())).max() <= 1e-10


# -------------------------------------------------------------------- refused


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({"metric": (1, 1, 1)}, "metric"),
        ({"metric": (0,) * 6}, "metric"),
        ({"metric": (1, 1, 1, -1, 1, 1)}, "metric"),
        ({"metric": (1, 1, 1, np.nan, 1, 1)}, "metric"),
        ({"metric": (np.inf,) * 6}, "metric"),
        ({"metric": "positions"}, "metric"),
        ({"metric_length": 0.0}, "metric_length"),
        ({"barrier_rate": -1.0}, "barrier_rate"),
        ({"stabilization": -1.0}, "stabilization"),
        ({"stabilization": np.nan}, "stabilization"),
        ({"basis_functions": 0}, "basis_functions"),
        ({"alpha": 0.0}, "alpha"),
        ({"ridge": -1.0}, "ridge"),
        ({"start": "nowhere"}, "start"),
        ({"end": "nowhere"}, "end"),
        pytest.param({"metric": 3}, "metric"),
        pytest.param({"stabilization": "fast"}, "stabilization"),
    ],
)
def test_arguments_out_of_range_are_refused_by_name(arguments: Any, named: str) -> None:
    assert named in refusal(InputError, learn, cut(1), [BLADE], **arguments)


@pytest.mark.parametrize(
    ("demonstrations", "named"),
    [
        ([], "demonstration"),
        ("cut.csv", "load_demonstrations"),
        ([3], "PoseTrajectory"),
        ((np.arange(9.0), np.zeros((9, 2))), "make arrays Trajectory(times, values)"),
    ],
)
def test_demonstrations_are_needed(demonstrations: Any, named: str) -> None:
    assert named in refusal(InputError, learn, demonstrations, [BLADE])


@pytest.mark.parametrize(
    ("rules", "named"),
    [
        ("blade", "expected a constraint"),
        ([Blade], "Blade()"),
        ([lambda motion: motion.position], "declare it first"),
        pytest.param(None, "constraint"),
    ],
)
def test_constraints_must_be_declared(rules: Any, named: str) -> None:
    assert named in refusal(ConstraintError, learn, cut(1), rules)


def test_the_impossible_is_refused_by_the_demonstrations_name() -> None:
    message = refusal(ConvergenceError, learn, cut(1), [table], hold_position=True)
    assert "cut 1" in message
    assert "table" in message


def test_contradictions_are_named_and_nothing_else() -> None:
    message = refusal(ConstraintError, learn, cut(1), [BLADE, table, ceiling])
    assert "'table' and 'ceiling' seem to contradict" in message
    assert "blade" not in message


@pytest.mark.parametrize("factor", [0.1, 0.25, 2.0, 4.0])
def test_the_path_does_not_depend_on_the_time_step(factor: float) -> None:
    # Half a step of heading, left uncorrected, would be 2e-3 of this path at four times the step.
    dmp = numerical()
    own = dmp.rollout()
    other = dmp.rollout(time_step=factor * own.times[1])
    reference = own.resampled(times=np.minimum(other.times, own.times[-1]))
    off = np.linalg.norm(other.positions - reference.positions, axis=1)[:-1]
    assert off.max() <= 1e-4 * own.path_length


def test_what_is_built_for_one_primitive_serves_all_under_equal_constraints(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    built: list[str] = []
    function = ca.Function.__init__

    def noted(self: ca.Function, *given: Any) -> None:
        function(self, *given)
        built.extend(name for name in given[:1] if isinstance(name, str))

    def use(duration: float, count: int) -> list[str]:
        built.clear()
        demonstration = cut(count, count, duration=duration)
        dmp = learn(demonstration, [Blade(reference_point=(0.0123, 0, 0))])
        there = dmp.adapt(goal_position=dmp.goal_position + [0.01, 0.0, 0.0])
        there.rollout_many(durations=[1.0, 2.0])
        controller = Controller(there, time_step=0.01)
        for _ in range(20):
            controller.step(goal=dmp.goal_position + [0.1, 0.0, 0.0])
        assert len(controller.replanned) == 1
        return list(built)

    monkeypatch.setattr(ca.Function, "__init__", noted)
    assert "step" in use(1.0, 300)
    assert use(2.5, 401) == []
