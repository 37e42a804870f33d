"""What became of the job: misses raise, compromises warn, with numbers and true remedies."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import noslip as ns
from learned import constrained, cutting, under
from motions import cut, held_askew
from noslip.errors import CompromiseWarning, MissedError
from noslip.rule import Rule
from noslip.verification import FOLLOWED, MISSED, verify


def waves(count: float, samples: int = 1200) -> ns.PoseTrajectory:
    """A path of so many waves, from rest to rest, the tool along it."""
    s = np.linspace(0, 1, samples)
    s = s - np.sin(2 * np.pi * s) / (2 * np.pi)
    path = np.column_stack([s, 0.05 * np.sin(2 * np.pi * count * s), 0 * s])
    return ns.PoseTrajectory(2 * np.linspace(0, 1, samples), path, Rotation.identity(samples))


def distances(a: ns.PoseTrajectory, b: ns.PoseTrajectory) -> np.ndarray:
    """Between motions at the same fraction of each, on chords."""
    at = (a.times - a.times[0]) / a.duration
    own = (b.times - b.times[0]) / b.duration
    there = np.column_stack([np.interp(at, own, column) for column in b.positions.T])
    return np.linalg.norm(a.positions - there, axis=1)


# -------------------------------------------------------------------- basis functions


def test_too_few_basis_functions_say_so_with_the_number() -> None:
    demonstration = waves(3)
    with pytest.warns(CompromiseWarning, match="2 basis functions leave the demonstration") as told:
        dmp = ns.learn(demonstration, basis_functions=2)
    texts = " ".join(str(one.message) for one in told)
    share = float(re.findall(r"demonstration by ([\d.e-]+) of its path", texts)[0])
    off = distances(dmp.rollout(), demonstration).max() / demonstration.path_length
    assert share == pytest.approx(off, rel=0.05) and off > 10 * FOLLOWED


@pytest.mark.parametrize(("count", "least"), [(1, 100), (45, 200)])
def test_by_default_there_are_as_many_as_the_path_needs(count: float, least: int) -> None:
    demonstration = waves(count)
    dmp = ns.learn(demonstration)
    assert dmp.law.basis.count >= least
    assert distances(dmp.rollout(), demonstration).max() <= FOLLOWED * demonstration.path_length
    assert (dmp.law.basis.count == 100) == (least == 100)


# -------------------------------------------------------------------- learned


def test_the_mean_of_several_is_projected_too_and_ends_at_its_goal() -> None:
    demonstrations = [held_askew(seed) for seed in range(4)]
    dmp = ns.learn(demonstrations, [ns.Blade()])
    for step in (None, 0.001):
        motion = dmp.rollout(time_step=step)
        assert motion.end_error <= 1e-5 * motion.path_length
        assert motion.end_rotation_error <= np.radians(2e-3)
        assert motion.path_error <= 1e-4 * motion.path_length


def test_the_record_says_how_far_each_demonstration_is_left() -> None:
    demonstrations = [held_askew(seed) for seed in range(3)]
    dmp = ns.learn(demonstrations, [ns.Blade()], basis_functions=40)
    motion = dmp.rollout()
    for record, demonstration in zip(dmp.record, demonstrations, strict=True):
        off = distances(motion, demonstration)
        tolerance = 1e-4 * demonstration.path_length
        assert record.path_error == pytest.approx(off.max(), abs=tolerance)
        assert record.end_error == pytest.approx(off[-1], abs=tolerance)
        turned = (motion.rotations[-1] * demonstration.rotations[-1].inv()).magnitude()
        assert record.end_rotation_error == pytest.approx(turned, abs=1e-6)
        assert record.rotation_error >= record.end_rotation_error


def test_a_goal_that_is_missed_is_refused_with_a_remedy_that_is_true() -> None:
    # What was learned without knowing of an obstacle; the blade may not turn, so it stops.
    blocked = under(cutting(), [ns.Blade(), ns.KeepOutSphere(center=(0.5, 0.17, 0.1), radius=0.05)])
    goal = ns.Boundary(1.0, blocked.goal_position, blocked.goal_rotation)
    with pytest.raises(MissedError, match="keep-out-sphere in its way") as raised:
        verify(blocked.law, blocked.rule, [goal])
    motion = blocked.rollout()
    ((said, share),) = re.findall(r"ends ([\d.]+) mm \(([\d.]+) of its path\)", str(raised.value))
    assert float(said) == pytest.approx(1e3 * motion.end_error, rel=0.01)
    assert float(share) == pytest.approx(motion.end_error / motion.path_length, rel=0.05)
    assert motion.end_error > MISSED * motion.path_length
    # Loosened, it gets there; so it does if it is known when the motion is learned.
    loosened = under(cutting(), [ns.Blade(), ns.KeepOutSphere(center=(0.5, 0.17, 0), radius=0.05)])
    verify(loosened.law, loosened.rule, [goal])
    known = ns.learn(cut(), blocked.constraints, basis_functions=40).rollout()
    assert known.end_error <= 1e-3 * known.path_length and known.margins.min() >= -1e-9


def test_a_limit_that_pushes_the_path_aside_is_named_as_the_reason() -> None:
    ball = ns.KeepOutSphere(center=(0.5, 0.17, 0.1), radius=0.12)
    plane = ns.DepthLimit(depth=1.0)
    with pytest.warns(CompromiseWarning, match="primitive leaves cut by") as told:
        ns.learn(cut(), [ns.Blade(), plane, ball], basis_functions=40)
    (text,) = (str(one.message) for one in told if "leaves cut" in str(one.message))
    assert "; keep-out-sphere in its way: loosen that, or demonstrate" in text
    # Loosened, it does not.
    ns.learn(cut(), [ns.Blade(), plane], basis_functions=40)


def test_a_hard_limit_that_the_primitive_cannot_keep_is_not_exported(tmp_path: Path) -> None:
    @ns.velocity_constraint
    def advance(motion):  # type: ignore[no-untyped-def]
        return motion.linear_velocity[0] - 0.3

    dmp = constrained([advance, ns.SpeedLimit(speed=0.1)])
    with pytest.raises(MissedError, match="breaks speed-limit"):
        dmp.export_c(tmp_path / "c", name="cut")
    assert not (tmp_path / "c").exists()


def test_what_starts_outside_a_limit_and_is_led_in_is_no_failure() -> None:
    above = ns.constraints.HalfSpace(point=(0, 0, 0.02), normal=(0, 0, 1))
    demonstration = cut()
    dmp = under(ns.learn(demonstration, basis_functions=40), [above])
    motion = dmp.rollout(time_step=0.004)
    assert motion.margins[0] < -0.01 and motion.margins[-1] > 0


# -------------------------------------------------------------------- rolled out


def test_a_rollout_to_another_goal_says_what_it_misses_and_what_reaches_it() -> None:
    dmp, aside = cutting(), np.array([0.0, 0.2, 0.0])
    goal = dmp.goal_position + aside
    with pytest.warns(CompromiseWarning, match="from its goal; adapt") as told:
        motion = dmp.rollout(goal_position=goal)
    off = np.linalg.norm(motion.positions[-1] - goal)
    assert motion.end_error == pytest.approx(off, rel=1e-12) and off > MISSED
    ((said, unit),) = re.findall(r"ends ([\d.]+) (m|mm) ", str(told[0].message))
    assert float(said) == pytest.approx(off * {"m": 1, "mm": 1e3}[unit], rel=0.01)
    # The remedy is true.
    there = dmp.adapt(goal_position=goal).rollout()
    assert np.linalg.norm(there.positions[-1] - goal) <= 1e-5 * there.path_length


def test_path_error_is_the_distance_from_the_law_alone() -> None:
    dmp = cutting()
    pushed = under(
        dmp, [ns.Blade(), ns.constraints.HalfSpace(point=(0, 0.1, 0), normal=(0, -1, 0))]
    )
    motion, alone = pushed.rollout(), ns.ConstrainedDMP(dmp.law).rollout()
    off = np.linalg.norm(motion.positions - alone.positions, axis=1)
    assert motion.path_error == pytest.approx(off.max(), rel=1e-5)
    assert motion[10:90].path_error == pytest.approx(off[10:90].max(), rel=1e-5)
    assert replace(dmp, rule=Rule()).rollout().path_error == 0.0


def test_many_rollouts_know_and_tell_what_they_miss() -> None:
    dmp = cutting()
    shifts = np.array([[0, 0, 0], [0, 0.1, 0], [0.05, 0.02, 0]])
    goals = dmp.goal_position + shifts
    with pytest.warns(CompromiseWarning, match="2 of 3 motions end up to") as told:
        motions = dmp.rollout_many(goals=goals)
    off = np.linalg.norm(motions.positions[:, -1] - goals, axis=1)
    np.testing.assert_allclose(motions.end_errors, off, rtol=0, atol=1e-15)
    assert motions.end_rotation_errors.max() < 1e-3 and off[0] < 1e-5 < 1e-3 < off[1]
    ((said, unit),) = re.findall(r"up to ([\d.]+) (m|mm) ", str(told[0].message))
    assert float(said) == pytest.approx(off.max() * {"m": 1, "mm": 1e3}[unit], rel=0.01)


def test_each_of_many_recordings_keeps_its_warnings(tmp_path: Path) -> None:
    waves(3).to_csv(tmp_path / "waves.csv")
    with pytest.warns(CompromiseWarning, match="4 basis functions leave"):
        learned = ns.learn_each(tmp_path / "waves.csv", basis_functions=4)
    (result,) = learned.results
    assert result.status == "learned" and "4 basis functions leave" in result.message


def test_a_tool_that_cannot_move_at_all_says_how_far_its_goal_is() -> None:
    s = np.linspace(0, 1, 201)
    turning = ns.PoseTrajectory(s, np.zeros((201, 3)), Rotation.from_euler("z", s))

    @ns.position_constraint
    def pinned(motion):  # type: ignore[no-untyped-def]
        return motion.position

    dmp = under(ns.learn(turning, basis_functions=20), [pinned])
    with pytest.warns(CompromiseWarning, match=r"ends 1\d\d mm from its goal"):
        dmp.rollout(goal_position=[0.15, 0, 0])
