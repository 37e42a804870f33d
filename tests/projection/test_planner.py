"""The planner in machine code: what NumPy finds, in as many steps, in memory it is given."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from scipy.spatial.transform import Rotation

import noslip as ns
from motions import eased, facing
from noslip import Blade, Boundary, Constraint, PoseTrajectory
from noslip.constraints import ConstraintSystem, PlaneContact
from noslip.errors import InputError
from noslip.projection import newton, planner
from noslip.projection.heading import turn_edge_into_path
from noslip.projection.newton import Outcome
from noslip.projection.problem import Problem
from noslip.projection.request import ADAPTING, LEARNING, Request, Weights
from noslip.projection.stage import Stage
from noslip.projection.trajectory import project
from refusals import refusal
from rules import needle, no_roll, table
from strategies import seeds
from waiting import PATIENCE

BLADE = Blade()
UNSMOOTHED = Weights(10.0, 0.0, 1e-4)
"""With what depends exactly, and nothing that joins the positions of one sample to the next."""


def resting(seed: int, count: int, flat: bool) -> PoseTrajectory:
    """A cut that rests for a fifth of its time at the start, and again at the end."""
    motion, s = facing(seed, count, flat=flat), np.linspace(0, 1, count)
    done = eased(np.clip((s - 0.2) / 0.6, 0, 1))
    columns = [np.interp(done, s, column) for column in motion.positions.T]
    return PoseTrajectory(motion.times, np.column_stack(columns), motion.rotations)


def moved(motion: PoseTrajectory) -> tuple[Boundary, ...]:
    goal = motion.positions[-1] + [0.02, -0.05, 0.0]
    return Boundary.keeping(motion, 0.0, "pose"), Boundary(1.0, goal, motion.rotations[-1])


def at_rest(motion: PoseTrajectory) -> tuple[Boundary, ...]:
    """A pose at rest at the start, and a place at rest at the end, with any rotation."""
    start, still = Boundary.keeping(motion, 0.0, "pose"), (np.zeros(3), np.zeros(3))
    return (
        replace(start, linear_velocity=still[0], angular_velocity=still[1]),
        Boundary(1.0, motion.positions[-1], None, *still),
    )


def passing(motion: PoseTrajectory) -> tuple[Boundary, ...]:
    k = len(motion) // 2
    place = motion.positions[k] + [0.0, -0.02, 0.0]
    return Boundary.keeping(motion, 0.0, "position"), Boundary(k / (len(motion) - 1), place)


def sideways(motion: PoseTrajectory) -> Constraint:
    """A half-space that the cut leaves."""
    top = motion.positions[:, 1].max()
    return ns.constraints.HalfSpace(point=(0, top - 0.01, 0), normal=(0, -1, 0))


def sphere(motion: PoseTrajectory) -> Constraint:
    center = motion.positions[len(motion) // 2] + [0, 0.03, 0.02]
    return ns.KeepOutSphere(center=tuple(center), radius=0.06)


SYSTEMS: dict[str, Callable[[PoseTrajectory], list[Constraint]]] = {
    "none": lambda motion: [],
    "blade": lambda motion: [BLADE],
    "the same blade twice": lambda motion: [BLADE, BLADE],
    "needle": lambda motion: [needle],
    "needle and blade": lambda motion: [needle, BLADE],
    "wheel": lambda motion: [ns.Wheel()],
    "contact": lambda motion: [PlaneContact(), BLADE],
    "table and no roll": lambda motion: [table, no_roll],
    "limit": lambda motion: [BLADE, sideways(motion)],
    "the same limit twice": lambda motion: [BLADE, sideways(motion), sideways(motion)],
    "limits": lambda motion: [BLADE, sphere(motion), ns.SpeedLimit(speed=9.0)],
    "acceleration": lambda motion: [BLADE, ns.constraints.AccelerationLimit(linear=1e3)],
}
ON_THE_GROUND = ("wheel", "contact", "table and no roll")
BOUNDARIES: dict[str, Callable[[PoseTrajectory], tuple[Boundary, ...]]] = {
    "free": lambda motion: (),
    "moved": moved,
    "at rest": at_rest,
    "passing": passing,
}
CASES = [
    (facing, "free", LEARNING),
    (resting, "free", LEARNING),
    (facing, "moved", ADAPTING),
    (facing, "at rest", ADAPTING),
    (facing, "passing", ADAPTING),
    (facing, "free", UNSMOOTHED),
]


def problem(request: Request) -> tuple[Problem, float]:
    """A projection as it is set up, and its first barrier; with limits, from that without."""
    system, smoothing = request.system, request.weights.rotation_smoothing
    heading = turn_edge_into_path(request.reference, system, smoothing)
    posed = Problem(request, heading.turns)
    if system.limits.size:
        posed.begin_at(project(replace(request, system=system.equalities)).trajectory)
    return posed, 1.0 / len(request.reference)


def both(
    request: Request, monkeypatch: pytest.MonkeyPatch, most: int = 60
) -> list[tuple[bool, newton.Plan]]:
    """What machine code and NumPy find: whether it converged, and where it ended."""
    found = []
    for allowed in "10":
        monkeypatch.setenv("NOSLIP_COMPILE", "0")
        posed, barrier = problem(request)
        monkeypatch.setenv("NOSLIP_COMPILE", allowed)
        found.append((planner.solve(posed.plan, most, barrier), posed.plan))
    return found


@pytest.mark.parametrize("hold", [False, True])
@pytest.mark.parametrize("name", SYSTEMS)
@given(seed=seeds)
@settings(max_examples=2, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_machine_code_finds_what_numpy_finds(
    compiling: Path, monkeypatch: pytest.MonkeyPatch, name: str, hold: bool, seed: int
) -> None:
    for make, bounds, weights in CASES[: 2 if hold else None]:
        motion = make(seed, 80, flat=name in ON_THE_GROUND)
        system = ConstraintSystem(SYSTEMS[name](motion))
        request = Request(motion, system, BOUNDARIES[bounds](motion), weights, hold)
        (converged, ours), (also, theirs) = both(request, monkeypatch)
        # What does not converge soon wanders, each way its own.
        soon = min(ours.iteration, theirs.iteration) <= 25
        assert converged == also or not soon
        if converged and soon:
            assert ours.iteration == theirs.iteration
            np.testing.assert_allclose(ours.z, theirs.z, rtol=0, atol=1e-9)


def test_it_is_what_a_projection_uses(compiling: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    motion = facing(2)
    monkeypatch.setattr(newton, "iterate", None)
    assert ns.project_trajectory(motion, BLADE).converged


def test_it_goes_on_where_it_stopped(compiling: Path) -> None:
    request = Request(facing(1, 200), ConstraintSystem(BLADE), moved(facing(1, 200)), ADAPTING)
    whole, in_parts = problem(request)[0].plan, problem(request)[0].plan
    compiled = planner.native(whole.stage).wait()
    assert compiled is not None
    assert planner.solve(whole, 40, 0.0)
    struct = planner.struct_of(in_parts, compiled)
    compiled.begin(ctypes.byref(struct), 0.0)
    outcomes = []
    while not outcomes or outcomes[-1] in (Outcome.GOING_ON, Outcome.NEARLY):
        outcomes.append(compiled.iterate(ctypes.byref(struct), 1))
    assert outcomes[-1] == Outcome.CONVERGED
    assert struct.iteration == whole.iteration == len(outcomes)
    np.testing.assert_array_equal(in_parts.z, whole.z)


@pytest.mark.parametrize("change", ["not finite", "no pivot"])
def test_what_machine_code_does_not_trust_is_done_in_numpy(
    change: str, compiling: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A turn of no weight that bends its own way leaves no pivot: L D L^T needs another order."""
    motion = facing(3, 100)
    request = Request(motion, ConstraintSystem(BLADE), (), LEARNING)
    found = []
    for allowed in "10":
        monkeypatch.setenv("NOSLIP_COMPILE", allowed)
        plan = problem(request)[0].plan
        if change == "no pivot":
            # Second differences alone: their first pivot is 1, and so is what is next to nothing.
            plan.turn_weights[0] = -plan.bending[0] - plan.turn_slopes[0]
        else:
            plan.turn_weights[0] = np.nan
        found.append((planner.solve(plan, 40, 0.0), plan.iteration, plan.z))
    (ours, steps, z), (also, as_many, same) = found
    assert (ours, steps) == (also, as_many)
    assert ours == (change == "no pivot")
    np.testing.assert_array_equal(z, same)


# -------------------------------------------------------------------- an independent oracle


def turned(turn: Any, given: Rotation) -> Any:
    """A rotation turned by a vector, as a matrix: Rodrigues' formula, regular at zero."""
    angle = ca.sqrt(ca.sumsqr(turn) + 1e-30)
    K = ca.skew(turn) / angle
    turn = ca.DM.eye(3) + ca.sin(angle) * K + (1 - ca.cos(angle)) * (K @ K)
    return turn @ ca.DM(given.as_matrix())


def halfway(one: Any, other: Any) -> Any:
    """Middle of two rotations that are near each other: the polar factor of their sum."""
    cosine = ca.sqrt(1 + ca.trace(one.T @ other)) / 2
    turn = one.T @ other
    bent = (turn + turn.T) / 2 - ca.DM.eye(3)
    root = ca.DM.eye(3) + (turn - turn.T) / (4 * cosine) + bent / (2 * (1 + cosine))
    return one @ root


@pytest.mark.slow
@pytest.mark.parametrize("count", [100, 200])
def test_the_optimum_is_the_one_that_ipopt_finds(count: int, compiling: Path) -> None:
    """A cut with its goal moved, both poses fixed; the same problem stated anew, by matrices."""
    motion, system = facing(count, count), ConstraintSystem(BLADE)
    request = Request(motion, system, moved(motion), ADAPTING)
    found = problem(request)[0]
    assert planner.solve(found.plan, 40, 0.0)
    h, length = 1 / (count - 1), motion.path_length
    speed = np.linalg.norm(np.diff(motion.positions, axis=0), axis=1)
    speed = np.append(speed[0], speed)
    speed /= speed.mean()
    z = ca.MX.sym("z", 6, count)
    turn, shift = z[:3, :], z[3:, :]

    def square(columns: Any, weights: Any = 1.0) -> Any:
        return ca.sum2(ca.sum1(columns**2) * weights)

    first, second = (np.diff(np.eye(count), n, axis=0).T / h**n for n in (1, 2))
    objective = (
        square(turn, ca.DM(speed + 1e-3).T)
        + square(turn @ ca.DM(first), ca.DM(1e-3 / (1 + (speed[1:] / 0.3) ** 2)).T)
        + ADAPTING.rotation_smoothing * square(turn @ ca.DM(second))
        + ADAPTING.position * square(shift)
        + ADAPTING.position_smoothing * square(shift @ ca.DM(second))
    )
    R = [turned(turn[:, k], motion.rotations[k]) for k in range(count)]
    p = ca.DM(motion.positions.T) + length * shift
    slip = [
        halfway(R[k - 1], R[k])[:, 1].T @ (p[:, k] - p[:, k - 1]) / (length * h)
        for k in range(1, count)
    ]
    solver = ca.nlpsol(
        "oracle",
        "ipopt",
        {"x": ca.vec(z), "f": objective, "g": ca.vertcat(*slip)},
        {"expand": True, "print_time": False, "ipopt": {"print_level": 0, "sb": "yes"}},
    )
    begin, fixed = problem(request)[0].z, found.fixed
    bounds = {
        name: np.where(fixed, begin, free).ravel()
        for name, free in (("lbx", -np.inf), ("ubx", np.inf))
    }
    solved = solver(x0=begin.ravel(), lbg=0, ubg=0, **bounds)
    assert solver.stats()["success"]
    np.testing.assert_allclose(found.z, np.array(solved["x"]).reshape(-1, 6), rtol=0, atol=1e-9)


# -------------------------------------------------------------------- without heap


STRICT = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wno-unused-parameter")
"""As of what runs on a robot."""


def compiled_to(folder: Path, stage: Stage, *options: str) -> Path:
    for name, text in planner.sources(stage).items():
        (folder / name).write_text(text, encoding="utf-8")
    result = folder / "plan.o"
    command = ["cc", *STRICT, *options, "-c", str(folder / "plan.c"), "-o", str(result)]
    subprocess.run(command, check=True, timeout=PATIENCE)
    return result


@pytest.mark.skipif(not (shutil.which("cc") and shutil.which("nm")), reason="no C compiler")
@pytest.mark.parametrize("name", ["none", "blade", "limits"])
def test_it_needs_nothing_but_libm(name: str, tmp_path: Path) -> None:
    stage = Stage.of(ConstraintSystem(SYSTEMS[name](facing(1))), False)
    code = compiled_to(tmp_path, stage, "-O1")
    told = subprocess.run(
        ["nm", "--undefined-only", str(code)], check=True, capture_output=True, text=True
    )
    needed = {line.split()[-1] for line in told.stdout.splitlines()}
    # Of the C library, a compiler may call what clears and copies.
    functions = {"sin", "cos", "sincos", "tan", "atan2", "sqrt"}
    assert needed <= functions | {"memset", "memcpy", "memmove", "_GLOBAL_OFFSET_TABLE_"}


CHECK = """
#include <stdio.h>
#include <stdlib.h>
#include "plan.h"
enum {{ N = {count}, U = NOSLIP_PLAN_UNKNOWNS, R = NOSLIP_PLAN_ROWS }};
static double *some(int n, FILE *file) {{
    double *numbers = malloc(sizeof(double) * (size_t)n);
    if (file && fread(numbers, sizeof(double), (size_t)n, file) != (size_t)n) exit(2);
    return numbers;
}}
static unsigned char *flags(int n, FILE *file) {{
    unsigned char *found = malloc((size_t)n);
    if (fread(found, 1, (size_t)n, file) != (size_t)n) exit(2);
    return found;
}}
int main(void) {{
    FILE *file = fopen("problem", "rb");
    noslip_plan p = {{0}};
    int k, outcome;
    p.knots = N;
    p.positions = some(3 * (N + 2), file);
    p.quaternions = some(4 * (N + 2), file);
    p.turn_weights = some(N, file);
    p.turn_slopes = some(N - 1, file);
    p.clearance = some(N * R, file);
    p.row_scale = some(R, file);
    p.tolerance = some(R, file);
    p.z = some((N + 2) * U, file);
    p.fixed = flags(N * U, file);
    p.active = flags(N * R, file);
    p.multipliers = some(N * R, 0);
    p.slack = some(N * R, 0);
    p.workspace = some(NOSLIP_PLAN_WORKSPACE(N), 0);
    {numbers}
    noslip_plan_begin(&p, {barrier!r});
    do outcome = noslip_plan_iterate(&p, 3);
    while ((outcome == NOSLIP_PLAN_GOING_ON || outcome == NOSLIP_PLAN_NEARLY) && p.iteration < 160);
    printf("%d %d", outcome, p.iteration);
    for (k = 0; k < N * U; ++k) printf(" %.17g", p.z[U + k]);
    return 0;
}}
"""
"""A plan in C alone, three steps a call."""


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler (cc) on this machine")
@pytest.mark.parametrize("name", ["blade", "limit"])
def test_it_stays_within_what_it_is_given(name: str, tmp_path: Path) -> None:
    """Under the sanitizers of addresses and of undefined behavior, and as Python runs it."""
    motion = facing(4, 80)
    request = Request(motion, ConstraintSystem(SYSTEMS[name](motion)), passing(motion))
    posed, barrier = problem(request)
    plan = posed.plan
    arrays = (
        *(plan.positions, plan.quaternions, plan.turn_weights, plan.turn_slopes, plan.clearance),
        *(plan.row_scale, plan.tolerance, plan.z, plan.fixed, plan.active),
    )
    (tmp_path / "problem").write_bytes(b"".join(a.tobytes() for a in arrays))
    names = ("time_step", "length", "begin", "position_weight", "last_barrier")
    numbers = [f"p.{name} = {getattr(plan, name)!r};" for name in names]
    numbers += [f"p.bending[{i}] = {float(plan.bending[i])!r};" for i in range(2)]
    program = CHECK.format(count=len(motion), numbers="\n    ".join(numbers), barrier=barrier)
    (tmp_path / "check.c").write_text(program)
    sanitize = "-fsanitize=address,undefined"
    compiled_to(tmp_path, plan.stage, sanitize, "-fno-sanitize-recover=all")
    build = ["cc", *STRICT, sanitize, "check.c", "plan.o", "-lm", "-o", "check"]
    if subprocess.run(build, cwd=tmp_path, timeout=PATIENCE).returncode:
        pytest.skip("no sanitizers for this C compiler")
    # What main() takes, it does not give back.
    done = subprocess.run(
        ["./check"],
        cwd=tmp_path,
        env={"ASAN_OPTIONS": "detect_leaks=0"},
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    )
    assert done.returncode == 0, done.stderr
    outcome, steps, *z = done.stdout.split()
    assert planner.solve(plan, 160, barrier)
    assert (int(outcome), int(steps)) == (Outcome.CONVERGED, plan.iteration)
    found = np.array(z, dtype=float).reshape(-1, 6)
    np.testing.assert_allclose(found, posed.z, rtol=0, atol=1e-9)


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler (cc) on this machine")
def test_a_blade_takes_little_memory_a_knot(compiling: Path) -> None:
    """Of a robot's: 1.2 kB, everything included."""
    motion = facing(1, 201)
    plan = problem(Request(motion, ConstraintSystem(BLADE)))[0].plan
    compiled = planner.native(plan.stage).wait()
    assert compiled is not None
    arrays = [value for value in vars(plan).values() if isinstance(value, np.ndarray)]
    taken = sum(a.nbytes for a in arrays) + 8 * compiled.workspace(len(motion))
    assert taken <= 1200 * len(motion) + 4000


# -------------------------------------------------------------------- many samples


@pytest.mark.slow
@pytest.mark.parametrize("weights", [LEARNING, ADAPTING])
def test_many_samples_are_as_precise_as_few(weights: Weights, compiling: Path) -> None:
    """What another number of samples changes falls with the step, as discretization does."""
    found = []
    for count in (2001, 4001, 20001):
        motion = facing(0, count)
        result = project(Request(motion, ConstraintSystem(BLADE), moved(motion), weights))
        assert result.converged
        found.append(result.trajectory.positions[:: (count - 1) // 2000])
    coarse, fine = (float(np.abs(one - found[2]).max()) for one in found[:2])
    assert coarse <= 1e-4
    assert fine <= coarse / 2


def test_the_first_guess_of_many_samples_is_that_of_few() -> None:
    """Also where a tool rests and nothing but the smoothing says how it turns."""
    few, many = (
        turn_edge_into_path(resting(0, n, flat=True), ConstraintSystem(BLADE), 1e-6).turns
        for n in (10_001, 100_001)
    )
    assert np.abs(few).max() > 0.01
    np.testing.assert_allclose(many[::10], few, rtol=0, atol=1e-3)


def test_more_samples_than_precision_allows_are_refused() -> None:
    motion = facing(0, 30_000)
    told = refusal(InputError, Request, motion, ConstraintSystem(BLADE), (), ADAPTING)
    assert "30000 samples" in told
    assert f"resample it to {ADAPTING.most_samples}" in told
    assert 20_000 < ADAPTING.most_samples < 30_000 < 100_000 < LEARNING.most_samples
