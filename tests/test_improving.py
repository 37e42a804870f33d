"""Trials under constraints: every one is feasible, the best is found, a search repeats."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import noslip as ns
from measures import residuals
from motions import planar_cut
from noslip._typing import Floats
from noslip.errors import CompromiseWarning, ConvergenceError, InputError, MissingDependencyError
from noslip.improving import splines

BLADE = [ns.Blade()]


@cache
def planar() -> ns.ConstrainedDMP:
    """A blade's cut in the plane."""
    return ns.learn(planar_cut(count=61), BLADE, basis_functions=15)


def quadratic(goal: Floats, motion: ns.Motion) -> float:
    """Mean squared distance from wanted positions, mm^2."""
    return 1e6 * float(np.mean(np.sum((motion.positions - goal) ** 2, axis=1)))


def bump(motion: ns.Motion) -> Floats:
    """Cubic B-spline over the whole motion, its peak 1: from its closed form."""
    u = 2 - 4 * np.abs(motion.times / motion.duration - 0.5)
    return np.where(u < 1, u**3, u**3 - 4 * (u - 1) ** 3)[:, None] / 4


@given(st.integers(1, 12))
def test_splines_leave_both_ends_as_they_are_and_peak_at_one(count: int) -> None:
    s = np.linspace(0, 1, 4 * (count + 3) * 10 + 1)
    found = splines(s, count)
    assert found.shape == (len(s), count)
    np.testing.assert_allclose(found.max(axis=0), 1, atol=1e-3)
    assert found.min() >= 0
    # A cubic whose value, slope and curvature vanish.
    near = s * (count + 3) <= 0.5
    for column, mirrored in zip(found.T, found[::-1].T, strict=True):
        for side in (column, mirrored):
            assert np.all(side[near] <= 1.5 / 6 * (s[near] * (count + 3)) ** 3 + 1e-12)


def test_the_optimum_of_a_quadratic_cost_is_found() -> None:
    """A blade may rise and sink, so a wanted rise is the optimum; its cost is 0."""
    dmp, height = planar(), -0.012
    own = dmp.rollout()
    goal = own.positions + height * bump(own) * [0, 0, 1]
    improved = ns.improve(dmp, lambda m: quadratic(goal, m), evaluations=71, shapes=1, sigma=0.005)
    found = improved.rollout()
    outcome = improved.history[-1].outcome
    assert outcome["after"] <= 0.03 * outcome["before"]
    assert np.abs(found.positions - goal).max() <= 0.2 * abs(height)
    least = outcome["least"]
    assert least == sorted(least, reverse=True)
    assert (least[0], least[-1]) == (outcome["before"], outcome["after"])


@pytest.mark.parametrize("vary", ["position", "pose"])
def test_every_trial_keeps_its_constraint_and_comes_to_its_goal(vary: Any) -> None:
    dmp = planar()
    tried = []

    def cost(motion: ns.Motion) -> float:
        tried.append(motion)
        return float(np.sin(1e4 * motion.positions[:, 2].sum()))

    improved = ns.improve(dmp, cost, evaluations=13, vary=vary, shapes=1, sigma=0.01, seed=3)
    assert len(tried) > 7
    given_motion = dmp.rollout()
    for motion in (*tried, improved.rollout()):
        assert np.abs(residuals(motion, BLADE)).max() <= 1e-10
        assert motion.duration == given_motion.duration
        length = motion.path_length
        assert np.linalg.norm(motion.positions[-1] - dmp.goal_position) <= 1e-3 * length
        off = (motion.rotations[-1] * dmp.goal_rotation.inv()).magnitude()
        assert np.degrees(off) <= 0.1
        np.testing.assert_allclose(motion.positions[0], dmp.start_position, atol=1e-12)
    # They are no copies of the given one.
    moved = [np.abs(m.positions - given_motion.positions).max() for m in tried[1:]]
    assert np.median(moved) >= 2e-3


def test_a_search_repeats_to_the_bit_whoever_evaluates_it() -> None:
    dmp = planar()
    goal = dmp.rollout().positions + [0, 0, 0.01]

    def search(seed: int, **options: Any) -> ns.ConstrainedDMP:
        return ns.improve(
            dmp, lambda m: quadratic(goal, m), evaluations=8, shapes=1, seed=seed, **options
        )

    state = np.random.get_state()[1].copy()  # noqa: NPY002 - that it is left alone
    done: list[tuple[int, int]] = []
    first = search(1, progress=lambda *each: done.append(each))
    assert np.array_equal(np.random.get_state()[1], state)  # noqa: NPY002
    with ThreadPoolExecutor(2) as threads:
        assert search(1, executor=threads) == first
    assert search(2) != first
    assert done == [(8, 8)]


def test_what_costs_more_is_not_taken(tmp_path: Any) -> None:
    dmp = planar()
    own = dmp.rollout()
    with pytest.warns(CompromiseWarning, match="none of 7 trials cost less than the given"):
        same = ns.improve(dmp, lambda m: quadratic(own.positions, m), evaluations=8, shapes=1)
    assert same.law == dmp.law
    origin = same.history[-1]
    assert origin.verb == "improve"
    assert origin.options["shapes"] == 1
    assert origin.outcome["after"] == origin.outcome["before"] == 0.0
    assert origin.outcome["evaluations"] == 8
    assert ns.load_primitive(same.save(tmp_path / "same.json")) == same


def test_what_the_cost_refuses_is_not_taken() -> None:
    dmp = planar()

    def below(motion: ns.Motion) -> float:
        rise = float(motion.positions[:, 2].sum())
        return np.inf if rise > 1e-3 else -rise

    improved = ns.improve(dmp, below, evaluations=15, shapes=1, seed=4)
    assert 0 < improved.history[-1].outcome["refused"] < 14
    assert improved.rollout().positions[:, 2].sum() <= 1e-3


def test_where_no_trial_may_be_that_is_said() -> None:
    dmp = planar()
    asked: list[ns.Motion] = []

    def only_the_first(motion: ns.Motion) -> float:
        asked.append(motion)
        return 0.0 if len(asked) == 1 else np.inf

    with pytest.raises(ConvergenceError, match=r"none of 7 trials .* give a smaller sigma"):
        ns.improve(dmp, only_the_first, evaluations=8, shapes=1)


def raising(motion: ns.Motion) -> float:
    raise KeyError("torque")


@pytest.mark.parametrize(
    ("cost", "message"),
    [
        (raising, r"the cost raised KeyError at evaluation 1: 'torque'; return infinity"),
        (lambda m: np.nan, r"the cost returned nan at evaluation 1; it must be a number"),
        (lambda m: "cheap", r"the cost returned 'cheap' at evaluation 1"),
        (lambda m: -np.inf, r"the cost returned -inf at evaluation 1"),
        (lambda m: np.inf, "the given primitive's motion has an infinite cost"),
        (3.0, r"cost must be a function of a motion, got 3.0"),
    ],
)
def test_a_cost_that_is_none_is_refused_in_one_line(cost: Any, message: str) -> None:
    with pytest.raises(InputError, match=message) as raised:
        ns.improve(planar(), cost)
    assert "\n" not in str(raised.value)


def test_a_cost_that_fails_later_is_told_with_its_number() -> None:
    calls: list[ns.Motion] = []

    def fails(motion: ns.Motion) -> float:
        calls.append(motion)
        return 1.0 if len(calls) < 3 else np.nan

    with pytest.raises(InputError, match="the cost returned nan at evaluation 3"):
        ns.improve(planar(), fails, shapes=1)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"evaluations": 0}, "evaluations must be a whole number"),
        ({"evaluations": 5}, r"evaluations must be 12 or more for 12 numbers to search, got 5"),
        ({"vary": "path"}, "vary must be position, rotation or pose"),
        ({"shapes": 0}, "shapes must be a whole number"),
        ({"sigma": -1.0}, "sigma must be a positive number of meters"),
        ({"turn_sigma": np.nan}, "turn_sigma must be a positive number of radians"),
        ({"seed": -1}, "seed must be a whole number"),
    ],
)
def test_what_is_no_option_is_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        ns.improve(planar(), lambda m: 0.0, **options)


def test_without_its_package_the_message_names_the_extra(monkeypatch: Any) -> None:
    monkeypatch.setitem(__import__("sys").modules, "cma", None)
    with pytest.raises(MissingDependencyError, match=r"pip install 'noslip\[improve\]'"):
        ns.improve(planar(), lambda m: 0.0)
