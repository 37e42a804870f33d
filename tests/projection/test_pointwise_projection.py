"""Gauss's principle in each step: against dense solvers, the paper's formulas and recursions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from learned import constrained, fitted
from measures import residuals
from motions import held_askew
from noslip import (
    Blade,
    ConstrainedDMP,
    Constraint,
    State,
    learn,
    position_constraint,
    velocity_constraint,
)
from noslip._typing import Floats
from noslip.constraints import ConstraintSystem, Instant
from noslip.errors import ConstraintError, InputError
from noslip.law.step import StepSymbols
from noslip.projection.pointwise import (
    POSITION_ONLY,
    coupling,
    gauss_acceleration,
    project_velocities,
)
from refusals import refusal
from rules import needle, no_roll, table
from strategies import seeds

FULL = (1.0,) * 6
UNEVEN = (1.0, 2.0, 3.0, 0.5, 4.0, 9.0)
METRICS = [POSITION_ONLY, FULL, UNEVEN]

BLADE = Blade()
CENTER = np.array([0.2, -0.3, 3.0])


@position_constraint
def sphere(motion: Instant) -> Any:
    return ca.norm_2(motion.position - ca.DM(CENTER)) - 3


@position_constraint
def moving_plane(motion: Instant) -> Any:
    return motion.position[2] - 0.1 * ca.sin(3 * motion.time)


@position_constraint
def upright(motion: Instant) -> Any:
    return motion.rotation[2, 0] - 0.3 * motion.position[0]


@velocity_constraint
def curving(motion: Instant) -> Any:
    # Not linear in the velocities, and about the rotation.
    spin = ca.dot(motion.rotation[:, 2], motion.angular_velocity)
    return spin - 0.3 * ca.sumsqr(motion.linear_velocity)


SETS: dict[str, list[Constraint]] = {
    "blade": [BLADE],
    "needle": [needle],
    "sphere": [sphere],
    "moving plane": [moving_plane],
    "blade and moving plane": [BLADE, moving_plane],
    "blade and sphere": [BLADE, sphere],
}


# -------------------------------------------------------------------- one acceleration


def kkt(a: Floats, A: Floats, b: Floats, inverse_metric: Sequence[float]) -> Floats:
    """Solve ``[M A'; A 0] [a; lambda] = [M a_u; b]``, densely; for a positive metric."""
    M, rows = np.diag(1 / np.array(inverse_metric)), len(b)
    matrix = np.block([[M, A.T], [A, np.zeros((rows, rows))]])
    return np.linalg.solve(matrix, np.concatenate([M @ a, b]))[:6]


@st.composite
def problems(draw: st.DrawFn, most_rows: int = 5) -> tuple[Floats, Floats, Floats, Floats]:
    rng = np.random.default_rng(draw(seeds))
    rows = draw(st.integers(1, most_rows))
    A = rng.normal(size=(rows, 6))
    assume(np.linalg.cond(A) < 30)
    return rng.normal(size=6), A, rng.normal(size=rows), rng.uniform(0.1, 10, 6)


@given(problems())
def test_gauss_acceleration_solves_the_dense_kkt_system(problem: Any) -> None:
    a, A, b, inverse_metric = problem
    found = gauss_acceleration(a, A, b, inverse_metric)
    np.testing.assert_allclose(found, kkt(a, A, b, inverse_metric), rtol=0, atol=1e-10)
    np.testing.assert_allclose(A @ found, b, rtol=0, atol=1e-10)


@given(problems(), seeds)
def test_no_feasible_acceleration_is_nearer(problem: Any, seed: int) -> None:
    a, A, b, inverse_metric = problem
    found = gauss_acceleration(a, A, b, inverse_metric)
    cost = np.sum((found - a) ** 2 / inverse_metric)
    null = np.linalg.svd(A)[2][len(b) :]
    rng = np.random.default_rng(seed)
    for size in (1e-3, 1.0):
        other = found + size * rng.normal(size=len(null)) @ null
        np.testing.assert_allclose(A @ other, b, rtol=0, atol=1e-9)
        assert np.sum((other - a) ** 2 / inverse_metric) >= cost - 1e-10


@given(problems(most_rows=3), seeds, st.integers(1, 4))
def test_dependent_rows_change_no_acceleration(problem: Any, seed: int, more: int) -> None:
    a, A, b, inverse_metric = problem
    mix = np.random.default_rng(seed).normal(size=(more, len(b)))
    found = gauss_acceleration(a, np.vstack([A, mix @ A]), np.append(b, mix @ b), inverse_metric)
    np.testing.assert_allclose(
        found, gauss_acceleration(a, A, b, inverse_metric), rtol=0, atol=1e-9
    )


@given(problems(), st.integers(0, 4))
def test_rank_deficient_rows_are_met_in_the_least_squares_sense(problem: Any, rank: int) -> None:
    # The paper's pseudoinverse: with an identity metric, a + A^+ (b - A a).
    a, A, b, _ = problem
    u, s, vt = np.linalg.svd(A, full_matrices=False)
    s[rank:] = 0.0
    A = u * s @ vt
    expected = a + np.linalg.pinv(A, rcond=1e-9) @ (b - A @ a)
    np.testing.assert_allclose(gauss_acceleration(a, A, b, FULL), expected, rtol=0, atol=1e-9)


@given(problems(most_rows=2))
def test_the_papers_metric_moves_the_position_alone(problem: Any) -> None:
    a, A, b, _ = problem
    assume(np.linalg.cond(A[:, :3]) < 30)
    found = gauss_acceleration(a, A, b)
    np.testing.assert_array_equal(found[3:], a[3:])
    np.testing.assert_allclose(A @ found, b, rtol=0, atol=1e-9)
    # It is the limit of ever larger rotational inertia.
    heavy = gauss_acceleration(a, A, b, (1, 1, 1, 1e-9, 1e-9, 1e-9))
    np.testing.assert_allclose(found, heavy, rtol=1e-5, atol=1e-5)


@given(arrays(np.float64, 3, elements=st.floats(-5, 5)), seeds)
def test_the_blades_force_is_the_papers_closed_form(velocity: Floats, seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn, a, w = Rotation.random(random_state=rng), rng.normal(size=6), rng.normal(size=3)
    instant = (0.0, np.zeros(3), turn.as_quat(scalar_first=True), velocity, w)
    A, b = ConstraintSystem(BLADE).acceleration_form(*instant)
    found = gauss_acceleration(a, A, b)
    # f = c^+ (b - c' a) with c = R y and b = -(w x c)' v; c is of unit length.
    c = turn.apply([0, 1, 0])
    expected = a[:3] + c * (-np.cross(w, c) @ velocity - c @ a[:3])
    np.testing.assert_allclose(found[:3], expected, rtol=0, atol=1e-12)


# -------------------------------------------------------------------- one step


@dataclass(frozen=True)
class Step:
    """A state and the unconstrained velocities that a step begins with."""

    position: Floats
    quaternion: Floats
    velocities: Floats
    unconstrained: Floats
    time: float

    @classmethod
    def random(cls, seed: int, constraints: list[Constraint], metric: Sequence[float]) -> Step:
        """On the constraints, moving as they allow, and pushed by a random acceleration."""
        rng = np.random.default_rng(seed)
        position = rng.normal(size=3)
        quaternion = Rotation.random(random_state=rng).as_quat(scalar_first=True)
        time = rng.uniform(0.2, 1)
        if sphere in constraints:
            position = CENTER + 3 * position / np.linalg.norm(position)
        if moving_plane in constraints:
            position[2] = 0.1 * np.sin(3 * time)
        v, w, _ = project_velocities(
            constraints, time, position, quaternion, *rng.normal(size=(2, 3)), inverse_metric=metric
        )
        return cls(position, quaternion, np.concatenate([v, w]), rng.normal(size=6), time)


@cache
def coupled(names: tuple[str, ...], metric: tuple[float, ...]) -> Any:
    """Compile a coupling term as a function of numbers."""
    system = ConstraintSystem([rule for name in names for rule in SETS[name]])
    p, q, v, w = (ca.SX.sym(name, n) for name, n in zip("pqvw", (3, 4, 3, 3), strict=True))
    dt, previous, t, rate = (ca.SX.sym(name) for name in ("dt", "previous", "t", "rate"))
    free = ca.SX.sym("free", 6)
    before = ca.SX.sym("before", system.size)
    symbols = StepSymbols(p, q, v, w, before, dt, dt, previous, t + dt, rate, rate, rate)
    held = coupling(system, inverse_metric=metric)(symbols, free[:3], free[3:])
    outputs = [held.linear, held.angular, held.values, held.multipliers]
    return ca.Function("step", [p, q, v, w, before, dt, previous, t, rate, free], outputs)


def residuals_within(step: Step, name: str, part: float, twist: Floats) -> Floats:
    """Residuals a part of a step (s) away, taken with SciPy's rotations."""
    turned = Rotation.from_rotvec(part * twist[3:]) * Rotation.from_quat(
        step.quaternion, scalar_first=True
    )
    quaternion = turned.as_quat(scalar_first=True)
    at = step.time + part, step.position + part * twist[:3], quaternion, twist[:3], twist[3:]
    return ConstraintSystem(SETS[name]).residuals(*at)[0]


def take(
    step: Step, name: str, metric: tuple[float, ...], dt: float, previous: float | None = None
) -> tuple[Floats, ...]:
    """Return velocities, residuals and multipliers after a step of length ``dt``.

    The step before was as long, unless told; of no length at the start.
    """
    free = step.velocities + dt * step.unconstrained
    previous = dt if previous is None else previous
    v, w, residual, multipliers = coupled((name,), metric)(
        step.position,
        step.quaternion,
        step.velocities[:3],
        step.velocities[3:],
        residuals_within(step, name, -previous / 2, step.velocities),
        dt,
        previous,
        step.time,
        0.0,
        free,
    )
    velocities = np.concatenate([np.array(v).ravel(), np.array(w).ravel()])
    return velocities, np.array(residual).ravel(), np.array(multipliers).ravel()


@pytest.mark.parametrize("metric", METRICS, ids=["position", "full", "uneven"])
@pytest.mark.parametrize("name", SETS)
def test_a_step_tends_to_the_udwadia_kalaba_formula(name: str, metric: Any) -> None:
    system = ConstraintSystem(SETS[name])
    for seed in range(4):
        step = Step.random(seed, SETS[name], metric)
        A, b = system.acceleration_form(
            step.time, step.position, step.quaternion, step.velocities[:3], step.velocities[3:]
        )
        if np.linalg.cond(A * np.sqrt(metric)) > 20:
            continue
        exact = gauss_acceleration(step.unconstrained, A, b, metric)
        errors = []
        for dt in (4e-4, 2e-4, 1e-4):
            velocities, _, _ = take(step, name, metric, dt)
            errors.append(np.linalg.norm((velocities - step.velocities) / dt - exact))
        # Of first order: the error halves with the step.
        assert errors[2] < 0.55 * errors[1] + 1e-7, errors
        assert errors[1] < 0.55 * errors[0] + 1e-7, errors
        assert errors[2] < 1e-2 * (1 + np.linalg.norm(exact)), errors


@pytest.mark.parametrize("metric", METRICS, ids=["position", "full", "uneven"])
@pytest.mark.parametrize("name", SETS)
@pytest.mark.parametrize("is_first", [True, False])
def test_the_next_step_satisfies_the_constraint(is_first: bool, name: str, metric: Any) -> None:
    system = ConstraintSystem(SETS[name])
    velocity_rows = np.array(system.row_is_velocity)
    for seed in range(20):
        step, dt = Step.random(seed, SETS[name], metric), 2e-3
        velocities, residual, _ = take(step, name, metric, dt, 0.0 if is_first else None)

        middle, end = (residuals_within(step, name, part, velocities) for part in (dt / 2, dt))
        found = np.where(velocity_rows, middle, end)
        np.testing.assert_allclose(residual, found, rtol=0, atol=1e-13)
        # Nothing decays at a rate of zero: the middle is left by as much as the middle before was,
        # at the start by as much as the instant is, which is on the constraint.
        before = residuals_within(step, name, 0.0 if is_first else -dt / 2, step.velocities)
        np.testing.assert_allclose(found[velocity_rows], before[velocity_rows], rtol=0, atol=1e-12)
        assert np.abs(before[velocity_rows]).max(initial=0) <= (1e-12 if is_first else 20 * dt)
        # At position level the last pose counts too: straight on from where it came, here from
        # dt^2 beside the constraint.
        assert np.abs(found[~velocity_rows]).max(initial=0) <= 20 * dt**2


# At position level too, where the residual after a step depends on the velocity by dt alone.
@pytest.mark.parametrize(
    "name",
    [
        "blade",
        "needle",
        *(
            pytest.param(
                name,
            )
            for name in ("sphere", "moving plane", "blade and sphere")
        ),
    ],
)
def test_multipliers_make_up_the_constraint_force(name: str) -> None:
    dt = 1e-5
    step = Step.random(3, SETS[name], FULL)
    A, _ = ConstraintSystem(SETS[name]).acceleration_form(
        step.time, step.position, step.quaternion, step.velocities[:3], step.velocities[3:]
    )
    velocities, _, multipliers = take(step, name, FULL, dt)
    force = (velocities - step.velocities) / dt - step.unconstrained
    np.testing.assert_allclose(A.T @ multipliers, force, rtol=0, atol=1e-3 * np.linalg.norm(force))


# -------------------------------------------------------------------- whole motions


def start_on(name: str) -> Floats:
    position = fitted().start_position.copy()
    if "sphere" in name:
        away = position - CENTER
        return np.asarray(CENTER + 3 * away / np.linalg.norm(away))
    return position


@pytest.mark.parametrize("metric", METRICS, ids=["position", "full", "uneven"])
@pytest.mark.parametrize("name", SETS)
def test_rollouts_satisfy_the_constraints_at_every_step(name: str, metric: Any) -> None:
    motion = constrained(SETS[name], metric).rollout(start_position=start_on(name), time_step=1e-3)
    np.testing.assert_array_less(np.abs(motion.constraint_residuals), 1e-12)
    # Recomputed from poses, velocities are differences of rounded positions.
    np.testing.assert_array_less(np.abs(residuals(motion, SETS[name])), 2e-12)


@pytest.mark.parametrize("duration", [0.05, 600.0])
@pytest.mark.parametrize("name", SETS)
def test_rollouts_of_any_duration_satisfy_the_constraints(name: str, duration: float) -> None:
    # In the slow ones the moving plane sways 300 times as often per duration.
    motion = constrained(SETS[name], FULL).rollout(start_position=start_on(name), duration=duration)
    assert np.abs(motion.constraint_residuals).max() <= 1e-12 * max(1, 1 / duration)


@pytest.mark.parametrize("metric", [FULL, UNEVEN], ids=["full", "uneven"])
def test_rollouts_satisfy_rules_that_are_not_linear_in_velocities(metric: Any) -> None:
    motion = constrained([curving], metric).rollout(time_step=1e-3)
    assert np.abs(residuals(motion, [curving])).max() <= 1e-11


# Where the rows of one level, left unscaled, would vanish beside those of the other.
@pytest.mark.parametrize(
    "time_step",
    [
        1e-4,
        pytest.param(
            1e-5,
        ),
    ],
)
def test_short_steps_satisfy_constraints_of_mixed_levels(time_step: float) -> None:
    dmp = constrained(SETS["blade and moving plane"])
    motion = dmp.rollout(duration=200 * time_step, time_step=time_step)
    speed = np.abs(motion.linear_velocities).max()
    assert np.abs(motion.constraint_residuals[:, 0]).max() <= 1e-12 * speed
    assert np.abs(motion.constraint_residuals[:, 1]).max() <= 1e-12


@pytest.mark.parametrize("metric", METRICS, ids=["position", "full", "uneven"])
@pytest.mark.parametrize("name", SETS)
def test_repeated_rows_change_nothing(name: str, metric: Any) -> None:
    asked = {"start_position": start_on(name), "time_step": 2e-3}
    once = constrained(SETS[name], metric).rollout(**asked)
    twice = constrained(SETS[name] * 2, metric).rollout(**asked)
    np.testing.assert_allclose(twice.positions, once.positions, rtol=0, atol=1e-10)
    assert (twice.rotations * once.rotations.inv()).magnitude().max() < 1e-10
    np.testing.assert_allclose(
        twice.constraint_forces,
        once.constraint_forces,
        rtol=0,
        atol=1e-9 * np.abs(once.constraint_forces).max(),
    )
    # They share the multiplier.
    half = np.hsplit(twice.multipliers, 2)
    np.testing.assert_allclose(
        half[0] + half[1], once.multipliers, rtol=0, atol=1e-6 * np.abs(once.multipliers).max()
    )


def test_the_papers_metric_leaves_the_rotation_as_it_is() -> None:
    motion = constrained([BLADE]).rollout()
    plain = fitted().rollout()
    np.testing.assert_array_equal(motion.rotations.as_quat(), plain.rotations.as_quat())
    np.testing.assert_array_equal(motion.constraint_forces[:, 3:], 0.0)
    assert np.abs(motion.positions - plain.positions).max() > 1e-3


def test_a_constraint_that_holds_anyway_does_no_work() -> None:
    # Flat demonstrations on a table.
    flat = replace(
        held_askew(), positions=held_askew().positions * [1, 1, 0], linear_velocities=None
    )
    plain = learn(flat, basis_functions=30)
    motion = constrained([table], plain=plain).rollout()
    np.testing.assert_allclose(motion.constraint_forces, 0, atol=1e-9)
    np.testing.assert_allclose(motion.positions, plain.rollout().positions, rtol=0, atol=1e-13)


def test_constraint_forces_are_what_the_constraints_added() -> None:
    # Without their own force, the semi-implicit step is the attractor's.
    dmp = constrained([BLADE], FULL)
    state = dmp.initial_state()
    for _ in range(20):
        after = dmp.step(state, 1e-3)
        free = dmp.regular.step(replace(state, constraint_residuals=np.zeros(0)), 1e-3)
        kick = (state.previous_step + 1e-3) / 2
        added = np.concatenate(
            [
                after.linear_velocity - free.linear_velocity,
                after.angular_velocity - free.angular_velocity,
            ]
        )
        np.testing.assert_allclose(after.constraint_forces, added / kick, rtol=0, atol=1e-9)
        assert np.linalg.norm(after.constraint_forces) > 1e-6
        state = after


@given(seeds)
@settings(max_examples=5)
def test_a_constrained_rollout_is_the_repeated_step(seed: int) -> None:
    dmp = constrained(SETS["blade and moving plane"], FULL, seed=seed % 3)
    duration = float(np.random.default_rng(seed).uniform(0.5, 5))
    motion = dmp.rollout(duration=duration)
    states = off_start(dmp, [duration / dmp.steps] * dmp.steps, duration=duration)
    for of_motion, of_state in (
        ("positions", "position"),
        ("linear_velocities", "linear_velocity"),
        ("angular_velocities", "angular_velocity"),
        ("constraint_residuals", "constraint_residuals"),
    ):
        found = np.array([getattr(state, of_state) for state in states])
        expected = getattr(motion, of_motion)
        scale = max(1, np.abs(expected).max())
        np.testing.assert_allclose(found, expected, rtol=0, atol=2e-12 * scale)
    turns = Rotation.concatenate([state.rotation for state in states])
    assert (turns * motion.rotations.inv()).magnitude().max() < 1e-12


# -------------------------------------------------------------------- starts off the constraint


def off_start(
    dmp: ConstrainedDMP,
    steps: list[float],
    *,
    push: Floats | None = None,
    duration: float | None = None,
) -> list[State]:
    """Step from the start, after a push: a velocity that no projection has been asked about."""
    state = dmp.initial_state(duration=duration)
    if push is not None:
        state = replace(state, linear_velocity=state.linear_velocity + push)
    states = [state]
    for step in steps:
        states.append(dmp.step(states[-1], step))
    return states


@pytest.mark.parametrize("rate", [0.0, 5.0, 40.0])
@pytest.mark.parametrize("even", [True, False])
def test_a_velocity_residual_decays_exponentially(rate: float, even: bool) -> None:
    dmp = constrained([BLADE], stabilization=rate)
    gaps = np.random.default_rng(1).uniform(0.3, 1.7, 200) if not even else np.ones(200)
    steps = list(gaps / gaps.sum())
    lateral = fitted().start_rotation.apply([0, 1, 0])
    states = off_start(dmp, steps, push=0.2 * lateral)
    times = np.array([state.time for state in states])
    middles = (times[1:] + times[:-1]) / 2
    found = np.array([state.constraint_residuals[0] for state in states[1:]])
    # What has decayed to rounding is gone.
    np.testing.assert_allclose(found, 0.2 * np.exp(-rate * middles), rtol=0, atol=1e-11)


def test_the_rate_is_per_duration() -> None:
    dmp = constrained([BLADE], stabilization=10.0)
    lateral = fitted().start_rotation.apply([0, 1, 0])
    state = dmp.initial_state(duration=50.0)
    state = replace(state, linear_velocity=state.linear_velocity + 0.2 * lateral)
    for _ in range(100):
        state = dmp.step(state, 0.05)
    # In the middle of the last step, 4.975 s of 50 s.
    assert state.constraint_residuals[0] == pytest.approx(0.2 * np.exp(-10.0 * 0.0995), rel=1e-10)


@pytest.mark.parametrize("rate", [5.0, 20.0])
@pytest.mark.parametrize(("name", "off"), [("sphere", 0.05), ("moving plane", -0.02)])
@pytest.mark.parametrize("project_start", ["velocity", "nothing", "pose"])
def test_a_start_off_a_position_constraint_is_projected_or_pulled_in(
    name: str, off: float, rate: float, project_start: Any
) -> None:
    start = start_on(name)
    outward = (start - CENTER) / 3 if name == "sphere" else np.array([0, 0, 1.0])
    dmp, off_start = constrained(SETS[name]), start + off * outward
    choice = {"project_start": project_start, "pull_in": rate}
    motion = dmp.rollout(start_position=off_start, time_step=1e-3, **choice)
    found, times = motion.constraint_residuals[:, 0], motion.times
    if project_start == "pose":
        np.testing.assert_allclose(found, 0, rtol=0, atol=1e-12)
        np.testing.assert_allclose(motion.positions[0], start, rtol=0, atol=1e-6)
        return
    state = dmp.initial_state(start_position=off_start, **choice)
    _, (speed,), _ = ConstraintSystem(SETS[name]).instant(0.0, *split(state))
    if project_start == "velocity":
        assert speed == pytest.approx(-rate * off, abs=1e-12)
    # The critically damped oscillator from that speed on, whatever the step; begun with
    # -rate off it is the exponential alone.
    expected = (off + (speed + rate * off) * times) * np.exp(-rate * times)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11)
    if project_start == "velocity":
        np.testing.assert_allclose(found, off * np.exp(-rate * times), rtol=0, atol=1e-11)


def split(state: State) -> tuple[Floats, Floats, Floats, Floats]:
    vector = state.vector()
    return vector[:3], vector[3:7], vector[7:10], vector[10:]


def test_no_stabilization_keeps_an_offset() -> None:
    motion = constrained(SETS["sphere"], stabilization=0.0).rollout(
        start_position=start_on("sphere") + 0.05 * (start_on("sphere") - CENTER) / 3
    )
    np.testing.assert_allclose(motion.constraint_residuals, 0.05, rtol=0, atol=1e-11)


# -------------------------------------------------------------------- velocities


@given(seeds)
def test_the_blades_velocity_projection_is_the_papers(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn, (v, w) = Rotation.random(random_state=rng), rng.normal(size=(2, 3))
    found, spin, residual = project_velocities(
        BLADE, 0.0, rng.normal(size=3), turn.as_quat(scalar_first=True), v, w
    )
    P = turn.apply(np.eye(3)[[0, 2]]).T
    np.testing.assert_allclose(found, P @ np.linalg.inv(P.T @ P) @ P.T @ v, rtol=0, atol=1e-14)
    np.testing.assert_array_equal(spin, w)
    assert np.abs(residual).max() < 1e-14


@given(seeds, st.sampled_from(METRICS), st.sampled_from(sorted(SETS)))
def test_projected_velocities_satisfy_all_rows(seed: int, metric: Any, name: str) -> None:
    step = Step.random(seed, SETS[name], metric)
    instant = (step.time, step.position, step.quaternion)
    system = ConstraintSystem(SETS[name])
    _, phi, rows = system.instant(*instant, step.velocities[:3], step.velocities[3:])
    assume(np.linalg.cond(rows * np.sqrt(metric)) < 1e3)
    assert np.abs(phi).max() < 1e-12


def curving_velocities(seed: int) -> tuple[float, float]:
    """Return the residual that a projection of random velocities reports, and the true one."""
    rng = np.random.default_rng(seed)
    turn, (v, w) = Rotation.random(random_state=rng), 0.5 * rng.normal(size=(2, 3))
    found, spin, residual = project_velocities(
        curving,
        0.0,
        np.zeros(3),
        turn.as_quat(scalar_first=True),
        v,
        w,
        inverse_metric=FULL,
    )
    return residual[0], turn.apply([0, 0, 1]) @ spin - 0.3 * found @ found


def test_projected_velocities_satisfy_rules_that_are_not_linear() -> None:
    assert max(abs(curving_velocities(seed)[1]) for seed in range(100)) < 1e-10


def test_the_residual_of_projected_velocities_is_theirs() -> None:
    for seed in range(100):
        reported, true = curving_velocities(seed)
        assert reported == pytest.approx(true, abs=1e-13)


@given(seeds, st.sampled_from([FULL, UNEVEN]))
def test_projected_velocities_are_the_nearest_in_the_metric(seed: int, metric: Any) -> None:
    rng = np.random.default_rng(seed)
    turn, (v, w) = Rotation.random(random_state=rng), rng.normal(size=(2, 3))
    at = (0.0, rng.normal(size=3), turn.as_quat(scalar_first=True))
    constraints = [needle, upright]
    found, spin, _ = project_velocities(constraints, *at, v, w, inverse_metric=metric)
    _, phi, rows = ConstraintSystem(constraints).instant(*at, v, w)
    given_velocities = np.concatenate([v, w])
    # Linear rows: the same as one dense solve.
    expected = kkt(given_velocities, rows, rows @ given_velocities - phi, metric)
    np.testing.assert_allclose(np.concatenate([found, spin]), expected, rtol=0, atol=1e-9)


def test_repeated_rows_change_no_projected_velocity() -> None:
    at = (0.0, np.ones(3), Rotation.random(random_state=1).as_quat(scalar_first=True))
    v, w = np.array([1.0, -2.0, 0.5]), np.array([0.3, 0.2, -0.1])
    once = project_velocities([BLADE, moving_plane], *at, v, w)
    twice = project_velocities([BLADE, moving_plane, BLADE, moving_plane], *at, v, w)
    for a, b in zip(once[:2], twice[:2], strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-13)


@pytest.mark.parametrize("name", ["blade", "needle", "moving plane"])
def test_rollouts_start_with_a_velocity_that_the_constraints_allow(name: str) -> None:
    dmp = constrained(SETS[name])
    state = dmp.initial_state()
    _, phi, _ = ConstraintSystem(SETS[name]).instant(
        0.0,
        state.position,
        state.rotation.as_quat(scalar_first=True),
        state.linear_velocity,
        state.angular_velocity,
    )
    assert np.abs(phi).max() < 1e-14
    motion = dmp.rollout()
    np.testing.assert_array_equal(motion.linear_velocities[0], state.linear_velocity)


# -------------------------------------------------------------------- what cannot be held


@pytest.mark.parametrize(
    "metric", [(1, 1, 1), (0,) * 6, (1, 1, 1, -1, 0, 0), (1, 1, 1, np.nan, 0, 0)], ids=str
)
def test_a_metric_is_six_numbers_that_leave_something_free(
    metric: Any,
) -> None:
    assert "inverse_metric" in refusal(InputError, coupling, BLADE, inverse_metric=metric)


# Position only, as in the paper, cannot hold a rule about rotations.
def test_a_metric_that_cannot_hold_a_constraint_is_refused() -> None:
    with pytest.raises(ConstraintError, match=r"'no roll'.*metric"):
        constrained([no_roll]).rollout()
