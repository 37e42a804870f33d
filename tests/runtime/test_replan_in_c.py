"""New plans in exported C: Python's to rounding, in bounded units, with a code for the outcome."""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation
from test_export import ARM, CC, EMULATOR, SANITIZED, STRICT, moving, needs_compiler, primitive

import noslip as ns
from learned import under
from noslip.adapting import replan
from noslip.experiments.numerical_example import demonstration
from noslip.runtime.rollout import rollout
from noslip.runtime.state import State
from objects import objects

Floats = NDArray[np.float64]
KNOTS, MOST_STEPS = 201, 1100
SOURCES = ("noslip.c", "plan.c", "replan.c", "cut.c")
MAIN = r"""
#include "cut.h"
#include "replan.h"
#include <stdio.h>

static double memory[NOSLIP_REPLAN_MEMORY(KNOTS, MOST_STEPS, FUNCTIONS)];

static void read(double *numbers, int count) {
    int i;
    for (i = 0; i < count; ++i) {
        if (scanf("%lf", &numbers[i]) != 1) numbers[i] = 0;
    }
}

static void print(const double *numbers, int count) {
    int i;
    for (i = 0; i < count; ++i) printf(" %.17g", numbers[i]);
}

int main(void) {
    static noslip_workspace w;
    noslip_state s;
    noslip_goal goal;
    double given[2];
    int outcome, calls = 0, k;
    noslip_start(&cut, &s);
    read(given, 2);
    read(s.position, 3), read(s.quaternion, 4);
    read(s.linear_velocity, 3), read(s.angular_velocity, 3);
    read(&s.time, 1), read(&s.fraction, 1), read(&s.previous_step, 1), read(&s.duration, 1);
    read(goal.position, 3), read(goal.quaternion, 4), read(&goal.duration, 1);
    w.memory = memory;
    w.knots = KNOTS;
    w.steps = (int)given[1];
    w.units = UNITS;
    do {
        outcome = given[0] > 0 ? noslip_adapt(&cut, &goal, &w) : noslip_replan(&cut, &s, &goal, &w);
        ++calls;
    } while (outcome == NOSLIP_REPLAN_GOING_ON);
    printf("%d %d %d %.17g", outcome, calls, w.iterations, w.end_error);
    printf(" %.17g\n", w.primitive.duration);
    if (outcome > NOSLIP_REPLAN_MISSES) return 0;
    for (k = 0; k < FUNCTIONS; ++k) {
        print(w.primitive.weights[k], 6);
        printf("\n");
    }
    noslip_start(&w.primitive, &s);
    for (k = 0; k <= w.steps; ++k) {
        print(s.position, 3), print(s.quaternion, 4);
        printf("\n");
        noslip_step(&w.primitive, &s, w.primitive.duration / w.steps);
    }
    return 0;
}
"""


@dataclass(frozen=True)
class Planned:
    """What C made of a plan."""

    outcome: str
    calls: int
    iterations: int
    end_error: float
    duration: float
    weights: Floats
    poses: Floats


def outcomes(folder: Path) -> list[str]:
    text = (folder / "replan.h").read_text()
    return re.findall(r"^    NOSLIP_REPLAN_(\w+),? +/\*", text, re.M)


def build(
    dmp: ns.ConstrainedDMP,
    folder: Path,
    units: int = 0,
    flags: tuple[str, ...] = (),
    compiler: str | None = CC,
    knots: int = KNOTS,
) -> Path:
    dmp.export_c(folder, name="cut")
    (folder / "main.c").write_text(MAIN)
    sizes = {
        "KNOTS": knots,
        "MOST_STEPS": MOST_STEPS,
        "FUNCTIONS": dmp.law.basis.count,
        "UNITS": units,
    }
    defined = [f"-D{name}={value}" for name, value in sizes.items()]
    command = [str(compiler), *STRICT, *flags]
    made = map(str, objects(folder, SOURCES, *command))
    command += [*defined, "main.c", *made, "-lm", "-o", "main"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder / "main"


def run(
    program: Path,
    dmp: ns.ConstrainedDMP,
    state: State | None,
    goal: ArrayLike,
    rotation: Rotation,
    duration: float = 0.0,
    *,
    steps: int = 400,
    before: tuple[str, ...] = (),
) -> Planned:
    at = dmp.initial_state() if state is None else state
    given = [
        *(float(state is None), steps, *at.position, *at.rotation.as_quat(scalar_first=True)),
        *(*at.linear_velocity, *at.angular_velocity, at.time, dmp.law.clock.fraction(at.phase)),
        *(at.previous_step, at.duration, *np.asarray(goal)),
        *(*rotation.as_quat(scalar_first=True), duration),
    ]
    text = " ".join(repr(float(x)) for x in given)
    done = subprocess.run(
        [*before, str(program)], input=text, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    first, *lines = done.stdout.splitlines()
    code, calls, iterations, missed, seconds = first.split()
    rows = [np.array(line.split(), dtype=float) for line in lines]
    count = dmp.law.basis.count if rows else 0
    return Planned(
        outcomes(program.parent)[int(code)],
        int(calls),
        int(iterations),
        float(missed),
        float(seconds),
        np.array(rows[:count]),
        np.array(rows[count:]),
    )


def pushed(dmp: ns.ConstrainedDMP, at: float, push: float) -> State:
    """A state so far into the motion, pushed aside by a share of the path."""
    state = dmp.initial_state()
    for _ in range(round(at * 500)):
        state = dmp.step(state, dmp.duration / 500)
    aside = push * dmp.rollout().path_length * state.rotation.apply([0, 1, 0])
    return replace(state, position=state.position + aside)


def farther(dmp: ns.ConstrainedDMP, share: float) -> Floats:
    """A goal farther the way that the motion comes, by a share of its path."""
    path = dmp.rollout().positions
    way = path[-1] - path[-30]
    return dmp.goal_position + share * dmp.rollout().path_length * way / np.linalg.norm(way)


def assert_same(found: Planned, law: Any, rule: Any, tolerance: float) -> None:
    motion = rollout(law, rule)
    assert found.duration == pytest.approx(law.duration, rel=1e-12)
    scale = max(1.0, float(np.abs(law.offset_weights).max()))
    np.testing.assert_allclose(found.weights, law.offset_weights, rtol=0, atol=tolerance * scale)
    np.testing.assert_allclose(found.poses[:, :3], motion.positions, rtol=0, atol=tolerance)
    same = np.abs(np.sum(found.poses[:, 3:] * motion.quaternions, axis=1))
    assert same.min() > 1 - tolerance


CASES = {
    "contact": lambda: ns.learn(
        moving(), [ns.constraints.PlaneContact(normal=(0.1, 0, -1)), ns.Blade()]
    ),
    "wheel": lambda: ns.learn(moving(), [ns.Wheel()]),
    "nothing binds": lambda: under(
        primitive("blade"), [ns.Blade(), ns.KeepOutSphere(center=(0.5, 0.5, 1.0), radius=0.2)]
    ),
}
NAMES = ["blade", "free", "shared", "winding", "few basis functions", "underdamped", "breathing"]
NAMES += ["replanned", *CASES]


@cache
def of(name: str) -> ns.ConstrainedDMP:
    return CASES[name]() if name in CASES else primitive(name)


@needs_compiler
@pytest.mark.parametrize("name", NAMES)
def test_a_plan_in_c_is_pythons(name: str, tmp_path: Path, uncounted: None) -> None:
    dmp = of(name)
    goal, rotation = farther(dmp, 0.03), dmp.goal_rotation
    program = build(dmp, tmp_path)
    for at, push in ((0.0, 0.01), (0.35, 0.02), (0.7, -0.03), (0.99, 0.0)):
        state = pushed(dmp, at, push)
        plan = replan(dmp.law, dmp.rule, state, goal_position=goal, goal_rotation=rotation)
        found = run(program, dmp, state, goal, rotation, steps=plan.law.steps)
        assert found.outcome == "DONE"
        assert found.iterations == plan.projected.iterations
        assert_same(found, plan.law, dmp.rule, 1e-9)


@needs_compiler
@pytest.mark.parametrize("name", ["blade", "free", "winding", "breathing", "contact", "wheel"])
def test_an_adaptation_in_c_is_pythons(name: str, tmp_path: Path, uncounted: None) -> None:
    dmp = of(name)
    goal, rotation = farther(dmp, 0.05), dmp.goal_rotation
    program = build(dmp, tmp_path)
    for duration in (None, 1.3 * dmp.duration):
        adapted = dmp.adapt(
            goal_position=goal, goal_rotation=rotation, samples=KNOTS, duration=duration
        )
        steps = adapted.law.steps
        found = run(program, dmp, None, goal, rotation, duration or 0.0, steps=steps)
        assert found.outcome == "DONE"
        assert_same(found, adapted.law, dmp.rule, 1e-9)


@needs_compiler
def test_a_limit_that_binds_is_kept_as_in_python(tmp_path: Path, uncounted: None) -> None:
    slow = ns.SpeedLimit(speed=2.0)
    dmp = under(primitive("blade"), [ns.Blade(), slow])
    state, goal = pushed(dmp, 0.4, 0.02), farther(dmp, 0.02)
    plan = replan(dmp.law, dmp.rule, state, goal_position=goal, goal_rotation=dmp.goal_rotation)
    program, rotation = build(dmp, tmp_path), dmp.goal_rotation
    found = run(program, dmp, state, goal, rotation, steps=plan.law.steps)
    assert found.outcome == "DONE"
    # Where limits bind the barrier is as near as it may be: 1e-8 of the mean speed.
    scale = np.abs(plan.law.offset_weights).max()
    np.testing.assert_allclose(found.weights, plan.law.offset_weights, atol=1e-6 * scale, rtol=0)
    steps = np.diff(found.poses[:, :3], axis=0) / (found.duration / plan.law.steps)
    assert np.linalg.norm(steps, axis=1).max() <= 2.0 * (1 + 1e-9)
    assert run(program, dmp, state, goal, rotation, 0.05).outcome == "LIMITS"


@needs_compiler
@pytest.mark.parametrize("units", [1, 3])
def test_in_units_it_is_the_same_to_the_bit(units: int, tmp_path: Path, uncounted: None) -> None:
    dmp = primitive("blade")
    state, goal = pushed(dmp, 0.4, 0.05), farther(dmp, 0.02)
    whole = run(build(dmp, tmp_path / "0"), dmp, state, goal, dmp.goal_rotation)
    program = build(dmp, tmp_path / "1", units)
    several = run(program, dmp, state, goal, dmp.goal_rotation)
    assert whole.calls == 1 and several.calls >= 15 / units
    np.testing.assert_array_equal(whole.weights, several.weights)
    np.testing.assert_array_equal(whole.poses, several.poses)


@needs_compiler
def test_what_became_of_it_has_a_code(tmp_path: Path, uncounted: None) -> None:
    dmp = of("contact")
    program = build(dmp, tmp_path)
    state, goal = pushed(dmp, 0.4, 0.0), farther(dmp, 0.02)
    rotation = dmp.goal_rotation

    def outcome(
        state: State = state, goal: ArrayLike = goal, duration: float = 0.0, steps: int = 400
    ) -> str:
        return run(program, dmp, state, goal, rotation, duration, steps=steps).outcome

    assert outcome() == "DONE"
    assert outcome(goal=goal + [0, 0, 0.01]) == "NOT_ALLOWED"
    assert outcome(goal=[np.nan, 0, 0]) == "NOT_FINITE"
    assert outcome(duration=-1.0) == "NOT_FINITE"
    assert outcome(replace(state, linear_velocity=np.array([np.inf, 0, 0]))) == "NOT_FINITE"
    assert outcome(steps=399) == "WRONG"
    few = build(dmp, tmp_path / "few", knots=19)
    assert run(few, dmp, state, goal, rotation).outcome == "WRONG"


@needs_compiler
@pytest.mark.parametrize("name", ["blade", "winding", "limits", "contact"])
def test_it_is_clean_under_the_sanitizers(name: str, tmp_path: Path, uncounted: None) -> None:
    dmp = of(name)
    program = build(dmp, tmp_path, 1, SANITIZED)
    assert run(program, dmp, pushed(dmp, 0.3, 0.02), farther(dmp, 0.02), dmp.goal_rotation).calls
    assert run(program, dmp, None, farther(dmp, 0.02), dmp.goal_rotation).calls


@pytest.mark.slow
@needs_compiler
@pytest.mark.skipif(shutil.which("valgrind") is None, reason="valgrind is missing")
def test_it_is_clean_under_valgrind(tmp_path: Path, uncounted: None) -> None:
    dmp = primitive("limits")
    program = build(dmp, tmp_path, 1)
    before = ("valgrind", "--error-exitcode=9", "--leak-check=full")
    state, goal = pushed(dmp, 0.3, 0.02), farther(dmp, 0.02)
    run(program, dmp, state, goal, dmp.goal_rotation, before=before)


@pytest.mark.slow
@pytest.mark.skipif(
    shutil.which(ARM) is None or shutil.which(EMULATOR) is None,
    reason=f"{ARM} or {EMULATOR} is missing (Debian: gcc-arm-linux-gnueabihf, qemu-user)",
)
@pytest.mark.parametrize("name", ["blade", "winding", "contact"])
def test_on_a_32_bit_arm_it_is_pythons(name: str, tmp_path: Path, uncounted: None) -> None:
    dmp = of(name)
    state, goal, rotation = pushed(dmp, 0.35, 0.02), farther(dmp, 0.03), dmp.goal_rotation
    plan = replan(dmp.law, dmp.rule, state, goal_position=goal, goal_rotation=rotation)
    program = build(dmp, tmp_path, 1, ("-static",), ARM)
    steps = plan.law.steps
    found = run(program, dmp, state, goal, rotation, steps=steps, before=(EMULATOR,))
    assert found.outcome == "DONE"
    assert_same(found, plan.law, dmp.rule, 1e-9)


@needs_compiler
def test_it_asks_for_no_heap_and_little_stack(tmp_path: Path, uncounted: None) -> None:
    primitive("limits").export_c(tmp_path, name="cut")
    told = (tmp_path / "replan.h").read_text()
    most = int(re.search(r"less than (\d+) kB of stack", told)[1])
    frames = 0
    for file in ("noslip.c", "plan.c", "replan.c"):
        command = [str(CC), *STRICT, "-fstack-usage", "-c", file]
        subprocess.run(command, cwd=tmp_path, check=True)
        unknown = subprocess.run(
            ["nm", "-u", file.replace(".c", ".o")], cwd=tmp_path, capture_output=True, text=True,
            check=True,
        ).stdout  # fmt: skip
        assert not re.search(r"\b(malloc|calloc|realloc|free)\b", unknown)
        for line in (tmp_path / file.replace(".c", ".su")).read_text().splitlines():
            frames += int(line.split()[1])
            assert "static" in line or "bounded" in line
    assert frames < 1000 * most


@needs_compiler
def test_memory_is_as_little_as_it_says(tmp_path: Path, uncounted: None) -> None:
    primitive("blade").export_c(tmp_path, name="cut")
    (tmp_path / "size.c").write_text(
        '#include "replan.h"\n#include <stdio.h>\n'
        'int main(void) { printf("%d %d\\n", (int)NOSLIP_REPLAN_MEMORY(400, 400, 100),\n'
        "                        (int)NOSLIP_REPLAN_MEMORY(200, 400, 100)); return 0; }\n"
    )
    subprocess.run([str(CC), *STRICT, "size.c", "-o", "size"], cwd=tmp_path, check=True)
    done = subprocess.run([str(tmp_path / "size")], capture_output=True, text=True, check=True)
    more, less = (8 * int(number) for number in done.stdout.split())
    assert (more - less) / 200 <= 1200  # bytes a knot
    assert less <= 300_000


@needs_compiler
def test_the_example_plans_while_it_moves(tmp_path: Path, uncounted: None) -> None:
    dmp = ns.learn(demonstration(), [ns.Blade()])
    dmp.export_c(tmp_path, name="cut")
    made = objects(tmp_path, (*SOURCES, "example_replan.c"), CC, *STRICT)
    command = [str(CC), *map(str, made), "-lm", "-o", "example"]
    subprocess.run(command, cwd=tmp_path, check=True)
    done = subprocess.run([str(tmp_path / "example")], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    rows = np.array([line.split(",") for line in done.stdout.splitlines()[1:]], dtype=float)
    motion = ns.PoseTrajectory(
        rows[:, 0], rows[:, 1:4], Rotation.from_quat(rows[:, 4:], scalar_first=True)
    )
    own = dmp.rollout()
    moved = np.linalg.norm(motion.positions[-1] - own.positions[-1])
    assert moved == pytest.approx(own.path_length / 20, rel=1e-3)
    # The plan takes over without a jolt, and nothing slips.
    for mine, theirs in zip(motion.step_velocities(), own.step_velocities(), strict=True):
        jolts = [np.linalg.norm(np.diff(steps, axis=0), axis=1).max() for steps in (mine, theirs)]
        assert jolts[0] <= 2 * jolts[1]
    assert ns.check(motion, [ns.Blade()]).satisfied


def test_a_header_for_cpp(tmp_path: Path, uncounted: None) -> None:
    if shutil.which("c++") is None:
        pytest.skip("no C++ compiler on this machine")
    primitive("blade").export_c(tmp_path, name="cut")
    (tmp_path / "loop.cpp").write_text(
        '#include "cut.h"\n#include "replan.h"\n'
        "int main() { noslip_workspace w{}; return noslip_replan(&cut, nullptr, nullptr, &w); }\n"
    )
    flags = ("-std=c++17", "-Wall", "-Wextra", "-pedantic", "-Werror", "-fsyntax-only")
    done = subprocess.run(["c++", *flags, "loop.cpp"], cwd=tmp_path, check=False)
    assert done.returncode == 0
