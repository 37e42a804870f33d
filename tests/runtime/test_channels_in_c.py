"""Channels in exported C: Python's to 1e-12, along a motion, around a rhythm, and on new plans."""

from __future__ import annotations

import csv
import subprocess
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from test_export import build, needs_compiler, run

import noslip as ns
from motions import planar_cut

pytestmark = needs_compiler
NAMES = ("fz", "grip */ ??= %d", "stiff\\n ä")
"""What C must not take for the end of a comment, a trigraph, a format or an escape."""


def beside(motion: ns.PoseTrajectory) -> ns.PoseTrajectory:
    """A force that comes again, a gripper that closes in between, a constant stiffness."""
    u = motion.clock / motion.duration
    told = [-3 - 2 * np.cos(2 * np.pi * u), (abs(u - 0.5) < 0.2) * 1.0, np.full_like(u, 4e3)]
    values = ns.Trajectory(
        motion.times, np.column_stack(told), names=NAMES, units=("N", "1", "N/m")
    )
    return motion.with_channels(values)


def lap() -> ns.PoseTrajectory:
    times = np.linspace(0.0, 2.0, 201)
    angle = np.pi * times
    path = np.column_stack([0.1 * np.cos(angle), 0.1 * np.sin(angle), 0 * angle])
    return ns.PoseTrajectory(times, path, Rotation.from_euler("z", angle + np.pi / 2))


@cache
def once() -> ns.ConstrainedDMP:
    return ns.learn(beside(planar_cut(0.5)), [ns.Blade()], basis_functions=40)


@cache
def rhythm() -> ns.ConstrainedDMP:
    return ns.learn(beside(lap()), [ns.Blade()], rhythmic=True, basis_functions=31)


ANY = r"""
#include "cut.h"
#include <math.h>
#include <stdio.h>
int main(void) {
    noslip_state s;
    noslip_real v[CUT_CHANNELS] = {7, 7, 7};
    double fraction;
    noslip_start(&cut, &s);
    s.fraction = (noslip_real)NAN;
    if (noslip_channels(&cut, &s, v) != 1 || v[0] < 7 || v[0] > 7) return 1;
    while (scanf("%lf", &fraction) == 1) {
        s.fraction = (noslip_real)fraction;
        if (noslip_channels(&cut, &s, v)) return 2;
        printf("%.17g %.17g %.17g\n", (double)v[0], (double)v[1], (double)v[2]);
    }
    return 0;
}
"""


def numbers_of(program: Path, given: np.ndarray) -> np.ndarray:
    """Lines of numbers that a program makes of some."""
    done = subprocess.run(
        [str(program)],
        input="\n".join(map(repr, given.tolist())),
        capture_output=True,
        text=True,
        check=True,
    )
    return np.array([line.split() for line in done.stdout.splitlines()], dtype=float)


def table(program: Path) -> tuple[list[str], np.ndarray]:
    rows = list(csv.reader(run(program).stdout.splitlines()))
    return rows[0], np.array(rows[1:], dtype=float)


@pytest.mark.parametrize("learned", [once, rhythm])
def test_they_are_pythons_wherever_it_is(learned, tmp_path: Path, uncounted: None) -> None:
    """Along the motion, and at any fraction: ends hold; those of a rhythm come again."""
    dmp = learned()
    dmp.export_c(tmp_path, name="cut")
    tested = run(build(tmp_path, "test.c"))
    assert tested.returncode == 0, tested.stdout
    names, found = table(build(tmp_path, "example.c"))
    motion = dmp.rollout()
    assert names[8:] == motion.channels.csv_columns()
    np.testing.assert_allclose(found[:, 8:], motion.channels.values, rtol=1e-12, atol=1e-12)
    (tmp_path / "any.c").write_text(ANY)
    fractions = np.append(np.random.default_rng(0).uniform(-1, 3, 300), [0.0, 1.0, 2.0])
    at_any = numbers_of(build(tmp_path, "any.c"), fractions)
    np.testing.assert_allclose(at_any, dmp.channels.at(fractions), rtol=1e-12, atol=1e-12)
    # The generated test fails where they differ.
    numbers = tmp_path / "cut.c"
    text, first = numbers.read_text(), f"R({dmp.channels.trend[0, 0].item()!r})"
    assert first in text
    numbers.write_text(text.replace(first, "R(-2.9)"))
    assert run(build(tmp_path, "test.c")).returncode == 1


def test_without_any_nothing_is_told(tmp_path: Path, uncounted: None) -> None:
    replace(once(), channels=None).export_c(tmp_path, name="cut")
    assert "CHANNELS" not in (tmp_path / "cut.h").read_text()
    (tmp_path / "none.c").write_text(
        '#include "cut.h"\nint main(void) {\n    noslip_state s;\n    noslip_real v = 7;\n'
        "    noslip_start(&cut, &s);\n"
        "    return cut.channels || noslip_channels(&cut, &s, &v) || v < 7 || v > 7;\n}\n"
    )
    assert run(build(tmp_path, "none.c")).returncode == 0


PLAN = r"""
#include "cut.h"
#include "replan.h"
#include <stdio.h>
static double memory[NOSLIP_REPLAN_MEMORY(101, 400, 40)];
int main(void) {
    static noslip_workspace w;
    noslip_state s;
    noslip_goal goal = {{0}, {0}, 0};
    noslip_real v[CUT_CHANNELS];
    double fraction;
    int k;
    noslip_start(&cut, &s);
    for (k = 0; k < 100; ++k) noslip_step(&cut, &s, cut.duration / 250);
    for (k = 0; k < 3; ++k) goal.position[k] = cut.goal_position[k] + 0.003 * (k < 2);
    for (k = 0; k < 4; ++k) goal.quaternion[k] = cut.goal_quaternion[k];
    w.memory = memory;
    w.knots = 101;
    w.steps = 400;
    if (noslip_replan(&cut, &s, &goal, &w) != NOSLIP_REPLAN_DONE) return 1;
    noslip_start(&w.primitive, &s);
    while (scanf("%lf", &fraction) == 1) {
        s.fraction = fraction;
        noslip_channels(&w.primitive, &s, v);
        printf("%.17g %.17g %.17g\n", v[0], v[1], v[2]);
    }
    return 0;
}
"""


def test_a_new_plan_goes_on_with_them(tmp_path: Path, uncounted: None) -> None:
    once().export_c(tmp_path, name="cut")
    (tmp_path / "replanned.c").write_text(PLAN)
    # What is compiled for this alone need not be fast.
    program = build(tmp_path, "replanned.c", "cut", "-O0", parts=("noslip.c", "plan.c", "replan.c"))
    fractions = np.linspace(0, 1, 11)
    expected = once().channels.after(0.4).at(fractions)
    np.testing.assert_allclose(numbers_of(program, fractions), expected, rtol=0, atol=1e-10)


def test_a_controller_tells_them_with_its_command() -> None:
    """Before and after the goal moves, and a new plan leads there."""
    dmp, h = once(), 0.02
    controller, told = dmp.controller(time_step=h), []
    while not controller.done and len(told) < 300:
        moved = [0.003, 0.003, 0.0] if len(told) > 20 else np.zeros(3)
        controller.step(goal=dmp.goal_position + moved)
        told.append(controller.channels)
    assert [one.failure for one in controller.replanned] == [""]
    # They go on as they were, and end as demonstrated.
    usual = np.abs(np.diff(dmp.rollout(time_step=h).channels.values, axis=0)).max(axis=0)
    assert np.all(np.abs(np.diff(told, axis=0)).max(axis=0) <= 1.5 * usual + 1e-9)
    np.testing.assert_allclose(told[-1], dmp.channels.at(1.0)[0], atol=1e-9)
    assert ns.Controller(replace(dmp, channels=None), h).channels.shape == (0,)
    around = rhythm().controller(time_step=h)
    state = around.step()
    np.testing.assert_array_equal(around.channels, rhythm().channels.at_phase(state.phase))
