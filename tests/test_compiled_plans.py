"""Once a primitive is compiled its plans are made in machine code: the same, part by part."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import noslip as ns
from learned import under
from noslip.adapting import Adapted, adapt, compiled, replan
from noslip.codegen.library import compiler
from noslip.experiments.numerical_example import demonstration
from noslip.projection.request import ADAPTING

pytestmark = [
    pytest.mark.skipif(compiler() is None, reason="no C compiler on this machine"),
    pytest.mark.usefixtures("compiling"),
]

RULES: dict[str, Any] = {
    "blade": [ns.Blade()],
    "blade that is turned": [ns.Blade((0.02, 1, -0.1), (1, 0.3, 0.2))],
    "blade in a frame that breathes": [ns.constraints.InMovingFrame(ns.Blade())],
    "soft limit": [ns.Blade(), ns.SpeedLimit(speed=3.0, priority=1)],
    "nothing": [],
}


@pytest.fixture(scope="module")
def learned() -> ns.ConstrainedDMP:
    return ns.learn(demonstration(), [ns.Blade()])


def assert_same(one: Adapted, other: Adapted) -> None:
    scale = np.abs(one.law.forcing.weights).max()
    close = {"rtol": 0.0, "atol": 1e-9}
    np.testing.assert_allclose(
        one.law.forcing.weights / scale, other.law.forcing.weights / scale, **close
    )
    for name in ("start", "start_velocity"):
        np.testing.assert_allclose(getattr(one.law, name), getattr(other.law, name), **close)
    assert (one.law.steps, one.law.begin) == (other.law.steps, other.law.begin)
    assert one.law.duration == pytest.approx(other.law.duration, rel=1e-12)
    np.testing.assert_allclose(one.motion.positions, other.motion.positions, **close)
    mine, theirs = one.projected, other.projected
    for name in ("iterations", "backing", "left_out", "converged", "smoothing"):
        assert getattr(mine, name) == getattr(theirs, name), name
    for name in ("turns", "residuals", "margins"):
        np.testing.assert_allclose(getattr(mine, name), getattr(theirs, name), **close)
    for motion, same in (
        (one.request.reference, other.request.reference),
        (mine.trajectory, theirs.trajectory),
    ):
        np.testing.assert_allclose(motion.positions, same.positions, **close)
        np.testing.assert_allclose(motion.linear_velocities, same.linear_velocities, atol=1e-7)
        np.testing.assert_allclose(motion.angular_velocities, same.angular_velocities, atol=1e-7)
        assert (motion.rotations * same.rotations.inv()).magnitude().max() < 1e-7
    for boundary, same in zip(one.request.boundaries, other.request.boundaries, strict=True):
        np.testing.assert_allclose(boundary.position, same.position, **close)
        np.testing.assert_allclose(boundary.linear_velocity, same.linear_velocity, **close)
        np.testing.assert_allclose(boundary.angular_velocity, same.angular_velocity, **close)


def both(
    monkeypatch: pytest.MonkeyPatch, dmp: ns.ConstrainedDMP, plan: Callable[[], Adapted]
) -> tuple[Adapted, Adapted]:
    """A plan in machine code, and without."""
    assert dmp.compile()
    seen = []
    made = compiled.made
    with monkeypatch.context() as patched:
        patched.setattr(compiled, "made", lambda *a, **k: seen.append(made(*a, **k)) or seen[-1])
        fast = plan()
        assert seen and seen[-1] is not None
        patched.setattr(compiled, "made", lambda *a, **k: None)
        patched.setattr(compiled, "is_ready", lambda *a: False)
        return fast, plan()


@pytest.mark.parametrize("rule", RULES)
def test_adapting_is_the_same(
    rule: str, learned: ns.ConstrainedDMP, monkeypatch: pytest.MonkeyPatch
) -> None:
    dmp = under(learned, RULES[rule])
    goal = dmp.goal_position + [0.1, 0.05, 0.0]
    for scaling in ("none", "rotation-dilation"):
        fast, slow = both(
            monkeypatch,
            dmp,
            lambda s=scaling: adapt(dmp.law, dmp.rule, goal_position=goal, scaling=s),
        )
        assert_same(fast, slow)


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("duration", [None, 0.9])
def test_replanning_is_the_same(
    rule: str,
    duration: float | None,
    learned: ns.ConstrainedDMP,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    dmp = under(learned, RULES[rule])
    state = dmp.initial_state()
    for _ in range(300):
        state = dmp.step(state, 1e-3)
    aside = state.rotation.apply([0, 0.03, 0])
    pushed = replace(state, position=state.position + aside)
    fast, slow = both(
        monkeypatch,
        dmp,
        lambda: replan(
            dmp.law,
            dmp.rule,
            pushed,
            goal_position=dmp.goal_position,
            duration=duration,
            rotation_smoothing=ADAPTING.rotation_smoothing * (1 if duration is None else 30),
        ),
    )
    assert_same(fast, slow)


def test_what_c_does_not_do_is_done_in_python(learned: ns.ConstrainedDMP) -> None:
    assert learned.compile()
    goal = learned.goal_position + [0.05, 0.0, 0.0]
    middle = learned.rollout().positions[500] + [0.0, 0.01, 0.0]
    passing = learned.adapt(goal_position=goal, via=[(0.5, middle)])
    near = np.linalg.norm(passing.rollout().positions - middle, axis=1).min()
    assert near < 1e-3
    with pytest.raises(ns.NoslipError, match="goal_position"):
        learned.adapt(goal_position=[np.nan, 0, 0])
    assert compiled.made(
        learned.law, learned.rule, (goal, learned.goal_rotation), ADAPTING, samples=201, steps=999
    )
    stiffer = learned.adapt(goal_position=goal, position_weight=100.0)
    assert np.abs(stiffer.law.forcing.weights - learned.law.forcing.weights).max() > 0
    assert not compiled.made(
        learned.law,
        learned.rule,
        (goal, learned.goal_rotation),
        replace(ADAPTING, position=100.0),
        samples=201,
        steps=999,
    )
