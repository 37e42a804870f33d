"""The end of a motion is where its duration is over; after it, it holds or comes to rest."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from test_export import build, needs_compiler, run

import noslip as ns
from motions import gentle_cut
from noslip._typing import Floats

BRAKING = 0.3


@cache
def resting() -> ns.ConstrainedDMP:
    return ns.learn(gentle_cut(), [ns.Blade()])


@cache
def running() -> ns.ConstrainedDMP:
    """Half of that cut, at full speed at its end."""
    whole = gentle_cut()
    half = slice(0, len(whole) // 2)
    cut = ns.PoseTrajectory(whole.times[half], whole.positions[half], whole.rotations[half])
    return ns.learn(cut, [ns.Blade()])


@cache
def breathing() -> ns.ConstrainedDMP:
    """On a table that moves up and down."""
    moving = ns.velocity_constraint(_rising)
    return ns.ConstrainedDMP(resting().law, replace(resting().rule, system=_system(moving)))


def _rising(motion: ns.constraints.Instant) -> object:
    return motion.linear_velocity[2] - 0.01 * motion.time


def _system(*constraints: ns.Constraint) -> ns.constraints.ConstraintSystem:
    return ns.constraints.ConstraintSystem([ns.Blade(), *constraints])


def states_of(
    way: str, dmp: ns.ConstrainedDMP, h: float, monkeypatch: pytest.MonkeyPatch, braking: float = 0
) -> Iterator[ns.State]:
    if way == "step":
        state = replace(dmp.initial_state(), braking=braking)
        while True:
            yield state
            state = dmp.step(state, h)
    monkeypatch.setenv("NOSLIP_COMPILE", "1" if way == "compiled" else "0")
    # Not bounded, it ends at speed, as the primitive does.
    controller = ns.Controller(dmp, time_step=h, braking=braking, faster=np.inf)
    assert controller.is_compiled == (way == "compiled")
    yield controller.state
    while True:
        yield controller.step()


def walk(
    way: str,
    dmp: ns.ConstrainedDMP,
    h: float,
    monkeypatch: pytest.MonkeyPatch,
    beyond: float = 0.5,
    braking: float = 0,
) -> tuple[list[ns.State], int]:
    """States up to so many durations beyond the end, and which is the last of the motion."""
    states = []
    for state in states_of(way, dmp, h, monkeypatch, braking):
        states.append(state)
        if state.time > (1 + beyond) * dmp.duration:
            return states, next(i for i, s in enumerate(states) if s.done)
    raise AssertionError


WAYS = ["step", "virtual", pytest.param("compiled", marks=needs_compiler)]


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("make", [resting, running, breathing])
@pytest.mark.parametrize("part", [1 / 150, 0.0123])
def test_a_motion_ends_when_its_time_is_over_and_holds_its_pose(
    way: str, make: object, part: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    dmp = make()  # type: ignore[operator]
    h = part * dmp.duration
    states, last = walk(way, dmp, h, monkeypatch)
    end = states[last]
    # Steps that do not divide the duration, too: the last one is shorter.
    assert end.time == pytest.approx(dmp.duration, abs=1e-12)
    assert last == np.ceil(1 / part - 1e-9)
    motion = dmp.rollout(time_step=h)
    np.testing.assert_allclose(end.position, motion.positions[-1], rtol=0, atol=1e-12)
    for before, state in zip(states[last:], states[last + 1 :], strict=False):
        assert state.done
        assert state.time == pytest.approx(before.time + h, abs=1e-12)
        assert np.abs(state.constraint_residuals).max() <= 1e-12
        if make is not breathing:
            np.testing.assert_array_equal(state.vector()[7:], 0)
            np.testing.assert_allclose(
                state.vector(), [*end.vector()[:7], *np.zeros(6)], atol=1e-12
            )
    if make is breathing:
        # It goes along with what moves under it.
        rise = 0.01 * (states[-1].time ** 2 - end.time**2) / 2
        assert states[-1].position[2] - end.position[2] == pytest.approx(rise, rel=1e-9)


@pytest.mark.parametrize("way", WAYS)
def test_a_motion_that_ends_at_speed_is_braked_along_its_path(
    way: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    dmp, h = running(), 1e-3
    states, last = walk(way, dmp, h, monkeypatch, braking=BRAKING, beyond=0.6)
    after = states[last:]
    speeds = np.array([np.linalg.norm(s.linear_velocity) for s in after])
    times = np.array([s.time - after[0].time for s in after])
    assert speeds[0] > 0.1
    # Evenly, within what was stated; the way is that of a constant deceleration.
    expected = speeds[0] * np.maximum(0, 1 - times / BRAKING)
    np.testing.assert_allclose(speeds, expected, rtol=0, atol=2 * h / BRAKING * speeds[0])
    assert speeds[times > BRAKING + 2 * h].max() == 0
    way_of_it = np.linalg.norm(np.diff([s.position for s in after], axis=0), axis=1).sum()
    assert way_of_it == pytest.approx(speeds[0] * BRAKING / 2, rel=0.02)
    # The blade rolls on along its last bend, without slip.
    bends = np.array([s.angular_velocity[2] for s in after[:250]]) / speeds[:250]
    np.testing.assert_allclose(bends, bends[0], rtol=1e-3)
    assert max(np.abs(s.constraint_residuals).max() for s in after) <= 1e-12
    np.testing.assert_array_equal(after[-1].position, after[-50].position)


@needs_compiler
@pytest.mark.parametrize("braking", [0.0, BRAKING])
def test_the_exported_step_ends_as_python_does(
    braking: float, tmp_path: Path, uncounted: None
) -> None:
    dmp, count = running(), 150
    h = 0.0123 * dmp.duration
    dmp.export_c(tmp_path, name="cut")
    (tmp_path / "beyond.c").write_text(
        '#include "cut.h"\n#include <stdio.h>\n'
        "int main(void) {\n    noslip_state s;\n    int k, i;\n    noslip_start(&cut, &s);\n"
        f"    s.braking = {braking!r};\n    for (k = 0; k < {count}; ++k) {{\n"
        f"        if (noslip_step(&cut, &s, {h!r})) return 1;\n"
        '        printf("%.17g %d", s.time, noslip_done(&s));\n'
        '        for (i = 0; i < 3; ++i) printf(" %.17g", s.position[i]);\n'
        '        for (i = 0; i < 4; ++i) printf(" %.17g", s.quaternion[i]);\n'
        '        for (i = 0; i < 3; ++i) printf(" %.17g", s.linear_velocity[i]);\n'
        '        for (i = 0; i < 3; ++i) printf(" %.17g", s.angular_velocity[i]);\n'
        '        printf("\\n");\n    }\n    return 0;\n}\n'
    )
    found = np.loadtxt(run(build(tmp_path, "beyond.c")).stdout.splitlines())
    state, expected = replace(dmp.initial_state(), braking=braking), []
    for _ in range(count):
        state = dmp.step(state, h)
        expected.append([state.time, state.done, *state.vector()])
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(found[-1, -6:], 0)


def test_what_is_measured_does_not_move_a_tool_that_has_come_to_its_end() -> None:
    rng, controller = np.random.default_rng(0), ns.Controller(resting(), time_step=0.01)
    while not controller.done:
        state = controller.step()
    end: Floats = state.vector()
    for _ in range(100):
        noisy = state.position + 2e-5 * rng.normal(size=3)
        turned = Rotation.from_rotvec(1e-3 * rng.normal(size=3)) * state.rotation
        state = controller.step(replace(state, position=noisy, rotation=turned))
        np.testing.assert_allclose(state.vector()[:7], end[:7], rtol=0, atol=1e-12)
        np.testing.assert_array_equal(state.vector()[7:], 0)
    assert not controller.replanned
