"""Errors about motions say what is known: a code, the best motion found, what suffices."""

from __future__ import annotations

import copy
import json
import pickle
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import noslip as ns
from learned import cutting, under
from measures import slip, steps
from motions import cut, eased, facing, planar_cut
from noslip.errors import InputError, NoslipError, Refusal, muted
from noslip.maneuvers.search import _LEVELS
from noslip.robots.refusal import InfeasibleMotionError
from noslip.verification import verify

SPEED = 0.7
FAR = [1.6, 0.2, 0.0]


@cache
def limited() -> ns.ConstrainedDMP:
    return ns.learn(cut(), [ns.Blade(), ns.SpeedLimit(speed=SPEED)], basis_functions=40)


@cache
def walled() -> ns.ConstrainedDMP:
    """A blade's on this side of a wall at x = 0.5 m, which nothing passes."""

    @ns.keep_nonnegative(name="wall")
    def wall(motion: Any) -> Any:
        return (motion.position[0] - 0.5) ** 2 - 0.05**2

    return ns.learn(planar_cut(), [ns.Blade(), wall], basis_functions=20)


def rough() -> ns.PoseTrajectory:
    motion = facing(2, 101)
    off = 2e-3 * np.random.default_rng(0).normal(size=motion.positions.shape)
    return replace(motion, positions=motion.positions + off)


def beside() -> ns.PoseTrajectory:
    """Of a blade that stands beside its straight path by 3 degrees."""
    s = np.linspace(0.0, 1.0, 101)
    held = Rotation.from_euler("z", np.full(101, 0.05))
    return ns.PoseTrajectory(s, np.outer(eased(s), [1.0, 0, 0]), held)


def project(motion: ns.PoseTrajectory, **options: Any) -> None:
    ns.project_trajectory(motion, ns.Blade(), start="pose", end="pose", **options)


def at_rest() -> ns.State:
    begun = limited().initial_state()
    return replace(begun, linear_velocity=np.zeros(3), angular_velocity=np.zeros(3))


def stopped() -> None:
    # It may not turn, so it stops at an obstacle that it did not know of.
    ball = ns.KeepOutSphere(center=(0.5, 0.17, 0.1), radius=0.05)
    dmp = under(cutting(), [ns.Blade(), ball])
    verify(dmp.law, dmp.rule, [ns.Boundary(1.0, dmp.goal_position, dmp.goal_rotation)])


CASES: dict[str, tuple[Refusal, Callable[[], Any]]] = {
    "adapted": (Refusal.TOO_FAST, lambda: limited().adapt(goal_position=FAR, duration=1.0)),
    "rolled out": (Refusal.TOO_FAST, lambda: limited().rollout(duration=0.5)),
    "planned anew": (
        Refusal.TOO_FAST,
        lambda: limited().replan(at_rest(), goal_position=FAR, goal_velocity=0, duration=0.5),
    ),
    "not the nearest": (Refusal.NOT_CONVERGED, lambda: project(rough(), max_iterations=2)),
    "swinging": (Refusal.NOT_CONVERGED, lambda: project(beside(), hold_position=True)),
    "no way": (Refusal.NOT_FOUND, lambda: project(rough(), max_iterations=1)),
    "a wall": (Refusal.NOT_FOUND, lambda: walled().adapt(goal_position=[0.6, 0.0, 0.0])),
    "forbidden": (Refusal.IMPOSSIBLE, lambda: walled().adapt(goal_position=[0.48, 0.0, 0.0])),
    "stopped": (Refusal.MISSED, stopped),
}


@cache
def raised(name: str) -> NoslipError:
    with muted(), pytest.MonkeyPatch.context() as patch, pytest.raises(NoslipError) as caught:
        # The finest search for a way takes most of the time, and finds no more.
        patch.setattr("noslip.maneuvers.search._LEVELS", _LEVELS[:2])
        CASES[name][1]()
    return caught.value


@pytest.mark.parametrize("name", CASES)
def test_a_refusal_has_its_code_and_claims_no_more(name: str) -> None:
    error, code = raised(name), CASES[name][0]
    assert error.code is code and error.code == code.value
    assert (error.duration is not None) == (code is Refusal.TOO_FAST)
    assert (error.iterate is None) == (code is Refusal.IMPOSSIBLE)
    message = str(error)
    if code is not Refusal.IMPOSSIBLE:
        assert "impossible" not in message and "no motion that" not in message
    if code is not Refusal.TOO_FAST:
        assert "more time" not in message


@pytest.mark.parametrize("name", [name for name, case in CASES.items() if name != "forbidden"])
def test_the_iterate_is_a_motion_that_can_be_looked_at(name: str) -> None:
    found = raised(name).iterate
    assert isinstance(found, ns.PoseTrajectory) and len(found) > 10
    assert np.isfinite(found.positions).all()
    assert 0.01 < found.path_length < 5
    if name == "a wall":
        np.testing.assert_allclose(found.positions[-1], [0.6, 0.0, 0.0], atol=1e-9)
    else:
        assert np.abs(slip(found)).max() <= 1e-2


# Of the motions by which a duration is told to suffice the speeds are recomputed from the poses.
@pytest.mark.parametrize("name", ["adapted", "planned anew"])
def test_the_duration_told_suffices_for_the_iterate_and_for_another_try(name: str) -> None:
    error = raised(name)
    assert error.duration is not None and f"{error.duration:.4g} s" in str(error)
    found = error.iterate
    assert found.duration == pytest.approx(error.duration, rel=1e-3)
    speeds = np.linalg.norm(steps(found).linear, axis=1)
    assert SPEED * 0.99 <= speeds.max() <= SPEED * (1 + 1e-6)
    np.testing.assert_allclose(found.positions[-1], FAR, atol=1e-4)
    assert np.abs(slip(found)).max() <= 1e-9
    with muted():
        if name == "adapted":
            again = limited().adapt(goal_position=FAR, duration=error.duration)
        else:
            again = limited().replan(
                at_rest(), goal_position=FAR, goal_velocity=0, duration=error.duration
            )
    assert np.linalg.norm(again.rollout().positions[-1] - FAR) <= 1e-4


def test_what_did_not_converge_but_satisfies_the_constraint_does() -> None:
    found, asked = raised("not the nearest").iterate, rough()
    assert np.abs(slip(found)).max() <= 1e-8
    assert np.linalg.norm(found.positions - asked.positions, axis=1).max() <= 0.05
    np.testing.assert_allclose(found.positions[[0, -1]], asked.positions[[0, -1]], atol=1e-12)


def test_what_was_not_found_does_not_satisfy_it() -> None:
    assert np.abs(slip(raised("no way").iterate)).max() > 1e-8
    through = raised("a wall").iterate
    assert np.abs(through.positions[:, 0] - 0.5).min() < 0.05


def test_a_start_under_way_is_promised_no_duration() -> None:
    state = limited().initial_state()
    assert np.linalg.norm(state.linear_velocity) > 0.1
    with muted(), pytest.raises(NoslipError, match="more time") as caught:
        limited().replan(state, goal_position=FAR, duration=0.5)
    assert caught.value.code is Refusal.NOT_FOUND and caught.value.duration is None


# ---------------------------------------------------------------- as a value


@pytest.mark.parametrize(
    "copied", [copy.copy, copy.deepcopy, lambda e: pickle.loads(pickle.dumps(e))]
)
@pytest.mark.parametrize("name", ["rolled out", "no way", "forbidden", "stopped"])
def test_a_copy_says_the_same(name: str, copied: Callable[[NoslipError], NoslipError]) -> None:
    error = raised(name)
    other = copied(error)
    assert type(other) is type(error) and str(other) == str(error)
    assert (other.code, other.duration) == (error.code, error.duration)
    assert other.code is error.code
    assert other.iterate == error.iterate


def test_what_has_no_motion_to_do_with_has_no_code() -> None:
    with pytest.raises(InputError) as caught:
        cutting().adapt(duration=-1.0)
    assert caught.value.code is caught.value.iterate is caught.value.duration is None


@pytest.mark.parametrize("duration", [None, 3.0])
def test_an_arm_that_cannot_follow_says_whether_time_lacks(duration: float | None) -> None:
    error = InfeasibleMotionError(
        "x", limit="velocity", joint="j", time=1.0, margin=-0.1, duration=duration
    )
    code = Refusal.NOT_FOUND if duration is None else Refusal.TOO_FAST
    for one in (error, copy.copy(error), pickle.loads(pickle.dumps(error))):
        assert (one.code, one.duration, one.joint, str(one)) == (code, duration, "j", "x")


# ---------------------------------------------------------------- on the command line


def test_the_summary_and_json_tell_the_code(noslip: Any, tmp_path: Path) -> None:
    primitive = limited().save(tmp_path / "limited.json")
    goals = tmp_path / "goals.csv"
    x, y, z = limited().goal_position
    goals.write_text(f"name,x,y,z,duration\nhasty,{x},{y},{z},0.5\nfine,{x},{y},{z},4\n")
    told = noslip("adapt", primitive, "--goals", goals, "--out", tmp_path / "family", "--json")
    assert told.code == 1
    hasty, fine = json.loads(told.out)["goals"]
    assert (hasty["code"], fine["code"]) == ("too-fast", "")
    assert fine["needed_duration_s"] is None
    assert f"{hasty['needed_duration_s']:.4g} s" in hasty["message"]
    rows = (tmp_path / "family" / "summary.csv").read_text().splitlines()
    assert "code,needed_duration_s" in rows[0] and ",too-fast," in rows[1]
