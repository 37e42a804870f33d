"""The exported controller: Python's to rounding, whatever happens; no heap, bounded, clean."""

from __future__ import annotations

import csv
import re
import shutil
import subprocess
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from test_export import ARM, CC, EMULATOR, SANITIZED, build, needs_emulator

import noslip as ns
from benchmarks.feedback import tasks
from benchmarks.feedback.in_c import Exported, compiled, difference
from benchmarks.feedback.scenarios import SCENARIOS
from benchmarks.feedback.trial import Trial
from motions import along, eased
from noslip.control.controller import FASTER

pytestmark = pytest.mark.skipif(CC is None, reason="no C compiler (cc) on this machine")
SAME = 1e-9
"""m, and of quaternions."""
H = 0.005
WORDS = {
    "": "",
    "blocked": "blocked:",
    "silent": "nothing was measured",
    "held": "the tool is held aside",
    "no plan": "the tool is held aside",
    "paused": "paused",
    "waits": "the tool is",
}


@pytest.fixture(autouse=True)
def machine_code(compiling: None, uncounted: None) -> None:
    """What is compared is compiled; instructions are not counted, which takes seconds."""


@cache
def moving() -> ns.ConstrainedDMP:
    """A cut in tissue that breathes: its rule knows the time."""
    s = np.linspace(0, 1, 201)
    u = eased(s)
    path = np.column_stack([0.1 * u, 0.02 * np.sin(2 * np.pi * u), 0 * u])
    breathing = ns.constraints.InMovingFrame(ns.Blade())
    return ns.learn(ns.PoseTrajectory(2 * s, path, along(path, s)), [breathing])


@cache
def at_speed() -> ns.ConstrainedDMP:
    """A stretch of a cut, which begins and ends at speed."""
    s = np.linspace(0, 1, 201)
    path = np.column_stack([0.1 * s, 0.02 * np.sin(2 * np.pi * s), 0 * s])
    return ns.learn(ns.PoseTrajectory(2 * s, path, along(path, s)), [ns.Blade()])


PRIMITIVES = {"s-cut": lambda: tasks.task("s-cut").dmp, "moving": moving, "at speed": at_speed}


@cache
def code_of(name: str) -> Any:
    return compiled(PRIMITIVES[name]())


def agree_in(scenario: str, name: str, seed: int) -> None:
    assert difference(Trial(scenario, name, 200.0, seed, ())) <= SAME


@pytest.mark.parametrize("scenario", ["worst", "push, follows", "two goal steps"])
@pytest.mark.parametrize("name", ["s-cut", "wheel"])
def test_it_is_python_s_in_the_bench(scenario: str, name: str) -> None:
    agree_in(scenario, name, 3)


@pytest.mark.slow
@pytest.mark.parametrize("number", range(len(SCENARIOS)), ids=[each.name for each in SCENARIOS])
def test_it_is_python_s_in_every_scenario(number: int) -> None:
    scenario = SCENARIOS[number]
    can = [
        name
        for name in tasks.TASKS
        if not (tasks.missing(name) or (scenario.moves_goal and name == tasks.KEEPS_ITS_GOAL))
    ]
    # In turn, so that each task is in several scenarios; all in all take minutes.
    for name in {can[number % len(can)], can[(number + 2) % len(can)]}:
        agree_in(scenario.name, name, 4)


def cycles(name: str, begin: int, **settings: Any) -> Iterator[tuple[ns.Controller, Exported]]:
    """Both controllers of a primitive, a cycle after another: whoever iterates steps both."""
    dmp = PRIMITIVES[name]()
    ours = ns.Controller(dmp, H, **settings)
    if begin > 0:
        state = dmp.initial_state()
        for _ in range(begin):
            state = dmp.step(state, H)
        ours.reset(state)
    theirs = Exported(code_of(name), H, begin=begin, **settings)
    while True:
        yield ours, theirs


@pytest.mark.parametrize("name", PRIMITIVES)
@pytest.mark.parametrize(("begin", "follows"), [(0, True), (120, False)])
def test_it_is_python_s_whatever_comes(name: str, begin: int, follows: bool) -> None:
    """Noise, a hand, goals of every kind, pauses, late and halted cycles, lost samples, silence."""
    rng = np.random.default_rng([7, follows, len(name)])
    dmp = PRIMITIVES[name]()
    modes, reasons = set(), set()
    pair = cycles(name, begin, follows=follows)
    ours, theirs = next(pair)
    for k in range(1400):
        elapsed = H * (1 + 0.2 * rng.uniform(-1, 1))
        if k == 150:
            elapsed = 0.03
        if k == 700:
            elapsed = 0.3
        if k in (60, 80):
            speed = float(k == 80)
            (ours.resume if speed else ours.pause)(within=0.05)
            theirs.head_for(speed, 0.05)
        if k == 100:
            ours.pause()
            theirs.head_for(0.0)
        if k == 120:
            ours.resume()
            theirs.head_for(1.0)
        place, turned = ours.state.position, ours.state.rotation
        if k == 200:
            held = place
        if 200 <= k < 300:
            # A hand holds it, wherever the command goes.
            place = held + np.array([0.0, 0.006, 0.0]) * min(1.0, (k - 200) / 20)
        seen = place + 1e-4 * rng.normal(size=3)
        rotation = Rotation.from_rotvec(1e-3 * rng.normal(size=3)) * turned
        measured: Any = (seen, rotation)
        pose = np.concatenate([seen, rotation.as_quat(scalar_first=True)])
        if k == 50:
            pose[1] = np.nan
            measured = (pose[:3], rotation)
        if k % 2 or 400 <= k < 460:
            measured = pose = None
        goal: Any = None
        position = quaternion = None
        if k >= 300:
            position = dmp.goal_position + [0.004, 0.0, 0.0]
            goal = position
        if k >= 800:
            asked = Rotation.from_euler("z", 0.1) * dmp.goal_rotation
            goal, quaternion = (position, asked), asked.as_quat(scalar_first=True)
        if k >= 900:
            position = dmp.goal_position + [10.0, 0.0, 0.0]
            goal = (position, goal[1])
        ours.advance(measured, goal, time_step=elapsed)
        found = theirs.step(elapsed, pose, position, quaternion)
        state = ours.state
        expected = np.concatenate([state.position, state.quaternion])
        # Each plan is the same to 1e-9, and one begins where another led.
        np.testing.assert_allclose(found, expected, rtol=0, atol=10 * SAME, err_msg=f"cycle {k}")
        assert theirs.mode == ours.mode, k
        assert ours.reason.startswith(WORDS[theirs.reason]), k
        assert bool(ours.reason) == bool(theirs.reason), k
        assert theirs.told[13] == pytest.approx(ours.speed, abs=1e-6)
        assert theirs.done == ours.done, k
        velocities = np.concatenate([state.linear_velocity, state.angular_velocity])
        np.testing.assert_allclose(theirs.told[7:13], velocities, rtol=0, atol=1e-6)
        modes.add(ours.mode)
        reasons.add(theirs.reason)
    lag, bias = ours.lag_and_bias
    np.testing.assert_allclose(theirs.told[20:24], [lag, *bias], rtol=0, atol=10 * SAME)
    made = [plan for plan in ours.replanned if not plan.failure]
    assert theirs.plans == len(made) > 0
    assert theirs.told[17] == len(ours.replanned) - len(made) > 0
    assert modes >= {"track", "hold"} | ({"yield"} if follows else set())
    assert reasons >= {"", "paused", "silent"}


# ---------------------------------------------------------------- as a program

PARTS = ("noslip.c", "plan.c", "replan.c", "controller.c")
MAIN = r"""
#include "cut.h"
#include "controller.h"
#include <math.h>
#include <stdio.h>
#include <string.h>

static noslip_controller c, before;

/* Even noise, the same everywhere. */
static double noise(void) {
    static unsigned seed = 1;
    seed = seed * 1664525u + 1013904223u;
    return (double)(seed >> 8) / 16777216.0 - 0.5;
}

static void refuse(void) {
    const double nowhere[3] = {NAN, 0, 0};
    before = c;
    if (!noslip_controller_step(&c, 0, 0, 0, 0) || !noslip_controller_step(&c, NAN, 0, 0, 0)
        || !noslip_controller_step(&c, H, 0, nowhere, 0) || memcmp(&c, &before, sizeof c)) {
        printf("not refused\n");
    }
}

int main(void) {
    double tool[7], seen[7], goal[3], left = 0, turned = 0;
    int k, i, finished = 0;
    noslip_controller_init(&c, &cut, -1);
    if (!noslip_controller_start(&c, 0)) printf("not refused\n");
    noslip_controller_init(&c, &cut, H);
    c.real_time = REAL_TIME;
    c.units = REAL_TIME;
    if (noslip_controller_start(&c, 0)) return 1;
    refuse();
    memcpy(tool, c.state.position, sizeof(double) * 3);
    memcpy(tool + 3, c.state.quaternion, sizeof(double) * 4);
    for (i = 0; i < 3; ++i) goal[i] = c.state.goal_position[i] + (i == 0 ? ASIDE : 0);
    for (k = 0; k < 3000 && finished < 100; ++k) {
        for (i = 0; i < 7; ++i) {
            const double command = i < 3 ? c.state.position[i] : c.state.quaternion[i - 3];
            tool[i] += (1 - exp(-H / 0.03)) * (command - tool[i]);
            seen[i] = tool[i] + (i < 3 ? 2e-4 * noise() : 0);
            if (i == 1 && k >= 150 && k < 250) seen[i] += ASIDE;
        }
        if (noslip_controller_step(&c, H, k % 3 == 0 ? seen : 0, k >= 100 ? goal : 0, 0)) return 1;
        for (i = 0; i < 3; ++i) printf("%.17g,", c.state.position[i]);
        for (i = 0; i < 4; ++i) printf("%.17g%c", c.state.quaternion[i], i < 3 ? ',' : '\n');
        finished = noslip_controller_done(&c) ? finished + 1 : 0;
    }
    for (i = 0; i < 3; ++i) left += pow(c.state.position[i] - goal[i], 2);
    fprintf(stderr, "%d %.17g %d %d\n", finished, sqrt(left), c.plans, c.failures);
    c.state.linear_velocity[0] = NAN;
    memcpy(seen, c.state.position, sizeof(double) * 3);
    noslip_controller_step(&c, H, 0, 0, 0);
    for (i = 0; i < 3; ++i) turned += fabs(c.state.position[i] - seen[i]);
    for (i = 0; i < 6; ++i) turned += fabs(c.twist[i]);
    if (c.mode != NOSLIP_MODE_FAULT || noslip_controller_reason(&c) != NOSLIP_REASON_FAULT
        || !(turned <= 0) || noslip_controller_step(&c, H, 0, 0, 0)) printf("no fault\n");
    return 0;
}
"""


def program(
    name: str, folder: Path, *flags: str, compiler: str | None = CC, real_time: int = 0
) -> Path:
    PRIMITIVES[name]().export_c(folder, name="cut")
    aside = 0.04 * PRIMITIVES[name]().rollout().path_length
    given = f"#define H {H!r}\n#define ASIDE {aside!r}\n#define REAL_TIME {real_time}\n"
    (folder / "main.c").write_text(given + MAIN)
    return build(folder, "main.c", "cut", *flags, parts=PARTS, compiler=compiler)


def ran(*command: str | Path) -> tuple[np.ndarray, list[float]]:
    done = subprocess.run([*map(str, command)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "refused" not in done.stdout
    assert "no fault" not in done.stdout
    poses = np.array(list(csv.reader(done.stdout.splitlines())), dtype=float)
    return poses, [float(each) for each in done.stderr.split("\n")[0].split()]


@pytest.mark.parametrize("name", PRIMITIVES)
def test_it_is_clean_and_ends_at_its_goal(name: str, tmp_path: Path) -> None:
    plain, clean = tmp_path / "plain", tmp_path / "clean"
    poses, (finished, left, plans, failures) = ran(program(name, plain))
    length = PRIMITIVES[name]().rollout().path_length
    assert (finished, plans, failures) == (100, 1, 0)
    assert left <= 4e-3 * length
    checked, _ = ran(program(name, clean, *SANITIZED))
    np.testing.assert_allclose(checked, poses, rtol=0, atol=SAME)


def test_work_in_units_comes_in_time_or_is_begun_anew(tmp_path: Path) -> None:
    """A unit a cycle is too little at first: the plan is made from farther ahead until it comes."""
    poses, (finished, left, plans, _) = ran(program("s-cut", tmp_path, real_time=1))
    assert (finished, plans) == (100, 1)
    assert left <= 4e-3 * PRIMITIVES["s-cut"]().rollout().path_length
    # Nothing jumps.
    steps = np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1)
    assert steps.max() <= 1.3 * FASTER * peak_speed() * H


def peak_speed() -> float:
    motion = PRIMITIVES["s-cut"]().rollout()
    return float(np.linalg.norm(motion.linear_velocities, axis=1).max())


def test_it_asks_for_no_heap(tmp_path: Path) -> None:
    PRIMITIVES["s-cut"]().export_c(tmp_path, name="cut")
    subprocess.run(
        [str(CC), "-std=c99", "-c", *PARTS], cwd=tmp_path, check=True, capture_output=True
    )
    names = subprocess.run(
        ["nm", "-u", *(name.replace(".c", ".o") for name in PARTS)],
        cwd=tmp_path,
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    assert not re.search(r"\b(malloc|calloc|realloc|free|printf|fopen)\b", names)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("valgrind") is None, reason="no valgrind")
def test_nothing_uninitialized_is_read(tmp_path: Path) -> None:
    main = program("s-cut", tmp_path, "-g")
    poses, _ = ran(main)
    checked, _ = ran("valgrind", "-q", "--error-exitcode=9", main)
    np.testing.assert_allclose(checked, poses, rtol=0, atol=SAME)


@pytest.mark.slow
@needs_emulator
def test_it_is_the_same_on_a_32_bit_arm(tmp_path: Path) -> None:
    here, there = tmp_path / "here", tmp_path / "there"
    poses, told = ran(program("s-cut", here))
    arm = program("s-cut", there, "-static", compiler=ARM)
    checked, other = ran(EMULATOR, arm)
    np.testing.assert_allclose(checked, poses, rtol=0, atol=SAME)
    assert told[2:] == other[2:]
