"""Poses and primitives of other libraries: what carries over, and how far the rest is off."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from scipy.spatial.transform import RigidTransform, Rotation

import noslip as ns
from noslip import ConstrainedDMP, PoseTrajectory, learn
from noslip._typing import Floats
from noslip.demonstrations.excision import synthetic_excisions
from noslip.errors import InputError, MissingDependencyError
from noslip.interop import (
    from_movement_primitives,
    from_pqs,
    from_pydmps,
    from_transforms,
    to_movement_primitives,
    to_pqs,
    to_pydmps,
    to_transforms,
)
from noslip.rule import no_rule
from noslip.runtime.rhythm import settled
from strategies import seeds

PAGE = Path(__file__).resolve().parents[1] / "docs" / "interop.md"
STEPS = 500


def random_poses(seed: int, count: int = 20) -> PoseTrajectory:
    """Poses without any order."""
    rng = np.random.default_rng(seed)
    return PoseTrajectory(
        times=np.cumsum(rng.uniform(0.01, 1, count)),
        positions=rng.normal(size=(count, 3)),
        rotations=Rotation.from_quat(rng.normal(size=(count, 4))),
    )


def smooth(seed: int, *, turning: float = 0.2) -> PoseTrajectory:
    """Waves, which neither start nor end at rest."""
    rng = np.random.default_rng(seed)
    s = np.linspace(0, 1, 1001)
    waves = np.column_stack(
        [s, *(f(np.pi * k * s) / k**2 for k in (1, 2) for f in (np.sin, np.cos))]
    )
    tilt = Rotation.from_quat(rng.normal(size=4))
    return PoseTrajectory(
        times=3.0 + 2 * s,
        positions=waves @ rng.normal(size=(5, 3)),
        rotations=Rotation.from_rotvec(turning * waves @ rng.normal(size=(5, 3))) * tilt,
    )


# -------------------------------------------------------------------- poses


@given(seeds)
def test_pqs_there_and_back_change_nothing(seed: int) -> None:
    poses = random_poses(seed)
    back = from_pqs(poses.times, to_pqs(poses))
    assert np.array_equal(back.times, poses.times)
    assert np.array_equal(back.positions, poses.positions)
    assert np.array_equal(back.quaternions, poses.quaternions)
    assert np.array_equal(to_pqs(back), to_pqs(poses))


@given(seeds)
def test_transforms_there_and_back_change_nothing(seed: int) -> None:
    poses = random_poses(seed)
    made = to_transforms(poses)
    for given_as in (made, made.as_matrix()):
        back = from_transforms(poses.times, given_as)
        assert np.array_equal(back.times, poses.times)
        assert np.array_equal(back.positions, poses.positions)
        assert (back.rotations * poses.rotations.inv()).magnitude().max() < 1e-14


def test_pqs_and_transforms_are_those_of_pytransform3d() -> None:
    trajectories = pytest.importorskip("pytransform3d.trajectories", reason="interop extra")
    poses = random_poses(3)
    matrices = to_transforms(poses).as_matrix()
    np.testing.assert_allclose(
        trajectories.transforms_from_pqs(to_pqs(poses)), matrices, rtol=0, atol=1e-14
    )
    again = from_pqs(poses.times, trajectories.pqs_from_transforms(matrices))
    assert (again.rotations * poses.rotations.inv()).magnitude().max() < 1e-14


def test_a_chain_of_frames_is_their_product() -> None:
    manager = pytest.importorskip("pytransform3d.transform_manager", reason="interop extra")
    poses = random_poses(4)
    tip = RigidTransform.from_components([0.1, 0.2, 0.3], Rotation.from_rotvec([0.4, 0, 0.1]))
    frames = manager.TemporalTransformManager()
    moving = manager.NumpyTimeseriesTransform(poses.times, to_pqs(poses))
    frames.add_transform("tool", "world", moving)
    frames.add_transform("tip", "tool", manager.StaticTransform(tip.as_matrix()))
    found = from_transforms(poses.times, frames.get_transform_at_time("tip", "world", poses.times))
    expected = poses.positions + poses.rotations.apply([0.1, 0.2, 0.3])
    np.testing.assert_allclose(found.positions, expected, rtol=0, atol=1e-12)
    turns = poses.rotations * tip.rotation
    assert (found.rotations * turns.inv()).magnitude().max() < 1e-12


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda a: a[:, :6], r"pqs: pqs has shape \(4, 6\), expected \(N, 7\)"),
        (lambda a: a[0], r"pqs has shape \(7,\)"),
        (lambda a: a * [[1], [1], [np.nan], [1]], r"pqs\[2\] is not finite"),
        (lambda a: a * ([1] * 3 + [1.01] * 4), "sample 0: the quaternion's norm is 1.01"),
        (lambda a: 0 * a, "sample 0: the quaternion's norm is 0 and must be 1"),
        (lambda a: "poses", "not an array of numbers"),
        (lambda a: a[:3], "shape"),
    ],
)
def test_wrong_pqs_are_refused(change: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        from_pqs(np.arange(4.0), change(to_pqs(random_poses(0, 4))))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda a: a[:, :3], r"transforms has shape \(4, 3, 4\), expected \(N, 4, 4\)"),
        (lambda a: np.swapaxes(a, 1, 2), "sample 0: the last row's error"),
        (lambda a: a * np.array([2.0, 2, 2, 1]), "sample 0: the rotation's error"),
        (lambda a: a * np.array([-1.0, 1, 1, 1]), "the rotation's determinant is -1"),
        (lambda a: a * np.nan, r"transforms\[0\] is not finite"),
    ],
)
def test_wrong_transforms_are_refused(change: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        from_transforms(np.arange(4.0), change(to_transforms(random_poses(0, 4)).as_matrix()))


def test_a_quaternion_that_is_nearly_of_length_one_is_normalized() -> None:
    poses = random_poses(1)
    scaled = to_pqs(poses) * ([1] * 3 + [1 + 5e-4] * 4)
    found = from_pqs(poses.times, scaled).rotations
    assert (found * poses.rotations.inv()).magnitude().max() < 1e-14
    np.testing.assert_allclose(np.linalg.norm(found.as_quat(), axis=1), 1, rtol=0, atol=1e-15)


# -------------------------------------------------------------------- imports


def test_importing_the_module_imports_no_other_library() -> None:
    code = (
        "import sys, noslip.interop; "
        "sys.exit(any(m.split('.')[0] in ('movement_primitives', 'pytransform3d') "
        "for m in sys.modules))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_missing_library_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "movement_primitives.dmp", None)
    dmp = learn(smooth(0), basis_functions=10)
    for convert in (to_movement_primitives, from_movement_primitives):
        with pytest.raises(MissingDependencyError, match=r"pip install 'noslip\[interop\]'"):
            convert(dmp)  # type: ignore[arg-type]


# -------------------------------------------------------------------- primitives


@pytest.fixture(scope="module")
def theirs() -> Any:
    return pytest.importorskip("movement_primitives.dmp", reason="interop extra").CartesianDMP


def product(p: Floats, q: Floats) -> Floats:
    """Hamilton product."""
    return np.array(
        [p[0] * q[0] - p[1:] @ q[1:], *(p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:]))]
    )


def solved(
    forces: Floats, stiffness: tuple[float, float], start: Floats, goal: Floats, velocity: Floats
) -> Floats:
    """Solve the equations that both libraries state, by Runge and Kutta, from sampled forces.

    Forces have the shape (2 STEPS + 1, 6); the result is (STEPS + 1, 7), over one duration.
    """
    (alpha, beta), h = stiffness, 1 / STEPS

    def rates(force: Floats, y: Floats) -> Floats:
        q, v = y[3:7], y[7:]
        error = Rotation.from_quat(
            product(goal[3:], q * [1, -1, -1, -1]), scalar_first=True
        ).as_rotvec()
        pull = beta * np.concatenate([goal[:3] - y[:3], error]) - v
        return np.concatenate(
            [v[:3], 0.5 * product(np.array([0, *v[3:]]), q), alpha * pull + force]
        )

    y = np.concatenate([start, velocity])
    path = [y[:7]]
    for k in range(0, 2 * STEPS, 2):
        a = rates(forces[k], y)
        b = rates(forces[k + 1], y + h / 2 * a)
        c = rates(forces[k + 1], y + h / 2 * b)
        d = rates(forces[k + 2], y + h * c)
        y = y + h / 6 * (a + 2 * b + 2 * c + d)
        path.append(y[:7])
    return np.array(path)


def our_solution(dmp: ConstrainedDMP, goal: Floats | None = None) -> Floats:
    law = dmp.law
    forces = law.forcing(law.clock.at(np.linspace(0, 1, 2 * STEPS + 1)))
    stiffness = law.attractor.alpha, law.attractor.beta
    goal = law.goal.point if goal is None else goal
    return solved(forces, stiffness, law.start, goal, law.start_velocity)


def their_solution(dmp: Any, goal: Floats | None = None) -> Floats:
    tau = dmp.execution_time_
    times = np.linspace(0, tau, 2 * STEPS + 1)
    forces = np.vstack([dmp.forcing_term_pos(times), dmp.forcing_term_rot(times)]).T
    alpha, beta = dmp.alpha_y[0], dmp.beta_y[0]
    if dmp.smooth_scaling:
        turn = Rotation.from_quat([dmp.goal_y[3:], dmp.start_y[3:]], scalar_first=True)
        way = [*(dmp.goal_y - dmp.start_y)[:3], *(turn[0] * turn[1].inv()).as_rotvec()]
        forces = forces - alpha * beta * np.outer(dmp.forcing_term_pos.phase(times), way)
    goal = dmp.goal_y if goal is None else goal
    return solved(forces, (alpha, beta), dmp.start_y, goal, dmp.start_yd * tau)


def their_steps(dmp: Any) -> Floats:
    """Its own motion with the velocity it is configured to start with."""
    dmp.reset()
    steps = round(dmp.execution_time_ / dmp.dt_)
    rows = [dmp.step(dmp.current_y, dmp.current_yd)[0] for _ in range(steps)]
    return np.array([dmp.start_y, *rows])


def imitated(theirs: Any, demonstration: PoseTrajectory, weights: int, **options: Any) -> Any:
    dmp = theirs(
        execution_time=demonstration.duration,
        dt=demonstration.duration / STEPS,
        n_weights_per_dim=weights,
        **options,
    )
    dmp.imitate(demonstration.clock, to_pqs(demonstration))
    return dmp


def apart(a: Floats, b: Floats) -> tuple[float, float]:
    """Return the largest distance, in lengths of b's path, and the largest turn, in degrees."""
    length = np.linalg.norm(np.diff(b[:, :3], axis=0), axis=1).sum()
    turns = Rotation.from_quat(a[:, 3:], scalar_first=True).inv()
    turns = Rotation.from_quat(b[:, 3:], scalar_first=True) * turns
    distance = np.linalg.norm(a[:, :3] - b[:, :3], axis=1).max()
    return float(distance / length), float(np.degrees(turns.magnitude().max()))


def assert_apart(a: Floats, b: Floats, lengths: float, degrees: float) -> None:
    distance, turn = apart(a, b)
    assert distance < lengths
    assert turn < degrees


@pytest.mark.parametrize(
    ("weights", "lengths", "degrees"),
    [(None, 1e-8, 1e-6), (100, 2e-7, 1e-5), (50, 5e-6, 3e-4), (25, 1e-3, 0.1)],
)
def test_to_theirs_the_equations_have_the_same_solution(
    theirs: Any, weights: int | None, lengths: float, degrees: float
) -> None:
    for seed in (1, 2, 3):
        dmp = learn(smooth(seed))
        made = to_movement_primitives(dmp, weights=weights)
        assert isinstance(made, theirs)
        assert made.n_weights_per_dim == (weights or 200)
        assert_apart(their_solution(made), our_solution(dmp), lengths, degrees)


@pytest.mark.parametrize("number", [0, 5])
def test_noisy_recordings_carry_over_too(theirs: Any, number: int) -> None:
    dmp = learn(synthetic_excisions()[number])
    functions = dmp.law.basis.count
    for weights, lengths, degrees in (
        (2 * functions, 4e-7, 1e-4),
        (functions, 5e-4, 0.1),
        (functions // 2, 3e-3, 0.5),
    ):
        made = to_movement_primitives(dmp, weights=weights)
        assert_apart(their_solution(made), our_solution(dmp), lengths, degrees)
    made = to_movement_primitives(dmp, time_step=dmp.duration / (2 * STEPS))
    made.int_dt = made.dt_
    # What noise leaves in the velocity at the start their steps take longer to lose.
    assert_apart(their_steps(made)[::2], our_solution(dmp), 3e-2, 3.5)


def test_their_own_steps_come_nearer_with_the_step(theirs: Any) -> None:
    dmp = learn(smooth(2))
    off = []
    for steps in (500, 1000, 2000):
        made = to_movement_primitives(dmp, time_step=dmp.duration / steps)
        made.int_dt = made.dt_
        off.append(apart(their_steps(made)[:: steps // STEPS], our_solution(dmp)))
    assert off[1][0] < 3e-3
    assert off[1][1] < 0.3
    ratios = np.array(off[:-1]) / np.array(off[1:])
    assert np.all((ratios > 1.7) & (ratios < 2.3))


def test_our_rollout_and_theirs_move_alike(theirs: Any) -> None:
    dmp = learn(smooth(3))
    ours = dmp.rollout()
    found = their_steps(to_movement_primitives(dmp))
    assert len(found) == len(ours)
    assert_apart(found, to_pqs(ours), 3e-3, 0.3)


def test_their_open_loop_starts_at_rest(theirs: Any) -> None:
    """The documented difference: without the velocity, a motion that starts moving is off."""
    dmp = learn(smooth(3))
    made = to_movement_primitives(dmp)
    distance, _ = apart(made.open_loop()[1][: dmp.steps + 1], to_pqs(dmp.rollout()))
    assert 5e-3 < distance < 0.1
    made.start_yd[:] = 0.0
    at_rest = their_solution(made)
    open_loop = made.open_loop()[1][: dmp.steps + 1 : dmp.steps // STEPS]
    assert_apart(open_loop, at_rest, 3e-3, 0.3)


def test_a_new_goal_has_the_same_effect_in_both(theirs: Any) -> None:
    dmp = learn(smooth(4))
    turned = Rotation.from_rotvec([0.2, -0.1, 0.3]) * dmp.goal_rotation
    goal = np.concatenate([dmp.goal_position + [0.3, -0.2, 0.1], turned.as_quat(scalar_first=True)])
    made = to_movement_primitives(dmp)
    assert_apart(their_solution(made, goal), our_solution(dmp, goal), 1e-6, 1e-4)
    made.configure(goal_y=goal)
    ours = dmp.rollout(goal_position=goal[:3], goal_rotation=turned, goal_form="paper")
    assert_apart(their_steps(made), to_pqs(ours), 3e-3, 0.3)


def test_another_duration_keeps_the_shape_in_theirs(theirs: Any) -> None:
    dmp = learn(smooth(4))
    made = to_movement_primitives(dmp)
    before = their_solution(made)
    made.execution_time_ *= 3
    made.start_yd /= 3
    assert_apart(their_solution(made), before, 1e-12, 1e-9)


@pytest.mark.parametrize("weights", [10, 25, 100])
@pytest.mark.parametrize("smooth_scaling", [False, True])
def test_from_theirs_the_equations_have_the_same_solution(
    theirs: Any, weights: int, smooth_scaling: bool
) -> None:
    dmp = imitated(theirs, smooth(5), weights, smooth_scaling=smooth_scaling)
    made = from_movement_primitives(dmp)
    assert made.law.basis.count == max(200, 4 * weights)
    expected = their_solution(dmp)
    assert_apart(our_solution(made), expected, 1e-6, 1e-4)
    assert_apart(to_pqs(made.rollout(time_step=made.duration / STEPS)), expected, 2e-6, 5e-4)
    assert_apart(dmp.open_loop()[1][: STEPS + 1], expected, 6e-3, 0.5)


def test_noisy_imitations_carry_over(theirs: Any) -> None:
    dmp = imitated(theirs, synthetic_excisions()[0], 100)
    made, expected = from_movement_primitives(dmp), their_solution(dmp)
    assert_apart(our_solution(made), expected, 1e-4, 0.01)
    assert_apart(to_pqs(made.rollout(time_step=made.duration / STEPS)), expected, 3e-4, 0.04)


def test_from_theirs_the_constants_are_the_same(theirs: Any) -> None:
    dmp = imitated(theirs, smooth(6), 20, alpha_y=30.0, beta_y=7.0)
    dmp.configure(start_yd=np.arange(6.0))
    made = from_movement_primitives(dmp, basis_functions=60)
    assert (
        made.law.attractor == ns.learn(smooth(6), alpha=30, beta=7, basis_functions=5).law.attractor
    )
    assert made.law.clock.alpha_s == dmp.forcing_term_pos.alpha_z == -np.log(0.01)
    assert made.duration == dmp.execution_time_
    assert made.steps == STEPS
    assert np.array_equal(made.start_position, dmp.start_y[:3])
    assert np.array_equal(made.goal_position, dmp.goal_y[:3])
    assert made.law.basis.count == 60
    state = made.initial_state()
    np.testing.assert_allclose(state.linear_velocity, [0, 1, 2], rtol=1e-15)
    np.testing.assert_allclose(state.angular_velocity, [3, 4, 5], rtol=1e-15)


def test_there_and_back_is_the_same_motion(theirs: Any) -> None:
    dmp = learn(smooth(7), basis_functions=50)
    back = from_movement_primitives(to_movement_primitives(dmp))
    assert_apart(to_pqs(back.rollout()), to_pqs(dmp.rollout()), 1e-5, 1e-3)


def test_a_constraint_stays_behind(theirs: Any) -> None:
    s = np.linspace(0, 1, 501)
    path = np.column_stack([0.1 * s, 0.02 * np.sin(2 * np.pi * s), 0 * s])
    cut = PoseTrajectory(4 * s, path, Rotation.from_euler("z", 0.5 * np.cos(2 * np.pi * s)))
    dmp = ns.learn(cut, ns.Blade())
    motion = from_pqs(*to_movement_primitives(dmp).open_loop())
    assert ns.check(dmp.rollout(), ns.Blade()).peak < 1e-10
    assert ns.check(motion, ns.Blade()).peak > 1e-4


def test_what_cannot_be_converted_is_refused(theirs: Any) -> None:
    far = learn(smooth(1, turning=3.0), basis_functions=20)
    assert len(far.law.goal.winding.quaternions) > 1
    near = learn(smooth(1), basis_functions=20)
    with pytest.raises(InputError, match="turns more than 135 degrees"):
        to_movement_primitives(far)
    with pytest.raises(InputError, match="weights must be 2 or more"):
        to_movement_primitives(near, weights=1)
    with pytest.raises(InputError, match="time_step must be a positive"):
        to_movement_primitives(near, time_step=0.0)
    with pytest.raises(InputError, match="dmp must be a ConstrainedDMP"):
        to_movement_primitives(theirs())
    with pytest.raises(InputError, match="dmp must be a CartesianDMP or a DMP"):
        from_movement_primitives(near)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"CartesianDMP \(start, goal\): sample 0: .* norm is 0"):
        from_movement_primitives(theirs())
    stiffer = imitated(theirs, smooth(1), 10, alpha_y=[25, 25, 25, 30, 30, 30])
    with pytest.raises(InputError, match=r"alpha_y is array.*learn\(from_pqs"):
        from_movement_primitives(stiffer)
    broken = imitated(theirs, smooth(1), 10)
    broken.start_yd[2] = np.nan
    with pytest.raises(InputError, match="start_yd is not finite"):
        from_movement_primitives(broken)
    broken.start_yd[2] = 0.0
    broken.forcing_term_rot.weights_[0, 3] = np.nan
    with pytest.raises(InputError, match="a weight is not finite"):
        from_movement_primitives(broken)


def test_the_advice_for_differing_constants_works(theirs: Any) -> None:
    stiffer = imitated(theirs, smooth(1), 25, alpha_y=[25, 25, 25, 30, 30, 30])
    times, poses = stiffer.open_loop()
    fitted = learn(from_pqs(times, poses))
    found = fitted.rollout(time_step=stiffer.dt_)
    assert_apart(to_pqs(found)[:STEPS], poses[:STEPS], 1e-3, 0.1)


# -------------------------------------------------------------------- vectors and rhythms


def reached(seed: int, size: int = 3) -> ns.Trajectory:
    """Waves of vectors, which neither start nor end at rest."""
    waves = smooth(seed)
    mixed = waves.positions @ np.random.default_rng(seed).normal(size=(3, size))
    return ns.Trajectory(waves.times, mixed, names=[f"q{k}" for k in range(size)])


def around(seed: int) -> ns.Trajectory:
    """One period of two coordinates, of three harmonics."""
    rng = np.random.default_rng(seed)
    turn = np.linspace(0, 2 * np.pi, 401)
    waves = [
        sum(rng.normal() * np.cos(k * turn + rng.uniform(0, 6)) / k for k in (1, 2, 3))
        for _ in "xy"
    ]
    return ns.Trajectory(turn / np.pi, np.column_stack(waves), names=["a", "b"])


def vector_solution(
    forces: Floats, constants: tuple[float, float], ends: tuple[Floats, Floats], velocity: Floats
) -> Floats:
    """Solve ``y'' = alpha (beta (g - y) - y') + f`` over 1, by Runge and Kutta, (STEPS + 1, n)."""
    (alpha, beta), (start, goal), h = constants, ends, 1 / STEPS

    def rates(force: Floats, y: Floats) -> Floats:
        place, v = np.split(y, 2)
        return np.concatenate([v, alpha * (beta * (goal - place) - v) + force])

    y = np.concatenate([start, velocity])
    path = [start]
    for k in range(0, 2 * STEPS, 2):
        a = rates(forces[k], y)
        b = rates(forces[k + 1], y + h / 2 * a)
        c = rates(forces[k + 1], y + h / 2 * b)
        d = rates(forces[k + 2], y + h * c)
        y = y + h / 6 * (a + 2 * b + 2 * c + d)
        path.append(y[: len(start)])
    return np.array(path)


FRACTIONS = np.linspace(0, 1, 2 * STEPS + 1)


def our_vectors(dmp: ConstrainedDMP) -> Floats:
    law = dmp.law
    forces = law.forcing(law.clock.at(FRACTIONS))
    constants = law.attractor.alpha, law.attractor.beta
    return vector_solution(
        forces, constants, (law.start, law.goal_position), np.array(law.start_velocity)
    )


def dmp_vectors(made: Any) -> Floats:
    """What the equations of a DMP say, not its steps."""
    forces = made.forcing_term(FRACTIONS * made.execution_time_).T
    alpha, beta = made.alpha_y[0], made.beta_y[0]
    if made.smooth_scaling:
        phases = made.forcing_term.phase(FRACTIONS * made.execution_time_)
        forces = forces - alpha * beta * np.outer(phases, made.goal_y - made.start_y)
    velocity = made.start_yd * made.execution_time_
    return vector_solution(forces, (alpha, beta), (made.start_y, made.goal_y), velocity)


def pydmps_vectors(made: Any, velocity: Floats) -> Floats:
    """What its equations say, not its steps; time and phase of a rhythm are in radians there."""
    is_rhythm = made.cs.pattern == "rhythmic"
    unit = 2 * np.pi if is_rhythm else 1.0
    phases = 1 + unit * FRACTIONS if is_rhythm else np.exp(-made.cs.ax * FRACTIONS)
    psi = made.gen_psi(phases)
    forces = np.column_stack(
        [
            made.gen_front_term(phases, d) * (psi @ made.w[d]) / psi.sum(axis=1)
            for d in range(made.n_dmps)
        ]
    )
    constants = unit * made.ay[0], unit * made.by[0]
    return vector_solution(unit**2 * forces, constants, (made.y0, made.goal), velocity)


def share_apart(a: Floats, b: Floats) -> float:
    """Largest distance, in lengths of b's path."""
    length = np.linalg.norm(np.diff(b, axis=0), axis=1).sum()
    return float(np.linalg.norm(a - b, axis=1).max() / length)


@pytest.fixture(scope="module")
def their_dmp() -> Any:
    return pytest.importorskip("movement_primitives.dmp", reason="interop extra").DMP


@pytest.fixture(scope="module")
def pydmps() -> dict[str, Any]:
    reason = "pip install pydmps"
    discrete = pytest.importorskip("pydmps.dmp_discrete", reason=reason).DMPs_discrete
    rhythmic = pytest.importorskip("pydmps.dmp_rhythmic", reason=reason).DMPs_rhythmic
    return {"discrete": discrete, "rhythmic": rhythmic}


@pytest.mark.parametrize("seed", [1, 2])
def test_vectors_move_alike_in_their_dmp_and_come_back(their_dmp: Any, seed: int) -> None:
    dmp = learn(reached(seed))
    made = to_movement_primitives(dmp)
    assert isinstance(made, their_dmp)
    assert share_apart(dmp_vectors(made), our_vectors(dmp)) < 1e-7
    off = []
    for steps in (STEPS, 2 * STEPS):
        made.dt_ = dmp.duration / steps
        off.append(share_apart(their_steps(made)[:: steps // STEPS], our_vectors(dmp)))
    # Their steps take the force of a step later.
    assert off[0] < 6e-3
    assert 1.7 < off[0] / off[1] < 2.3
    back = from_movement_primitives(made, names=["q0", "q1", "q2"])
    assert back.law.space == dmp.law.space
    assert share_apart(back.rollout().values, dmp.rollout().values) < 1e-6


def test_imitations_of_vectors_carry_over(their_dmp: Any) -> None:
    demonstration = reached(3)
    for options in ({}, {"smooth_scaling": True}):
        dmp = their_dmp(
            3,
            execution_time=2.0,
            dt=2.0 / STEPS,
            n_weights_per_dim=40,
            alpha_y=20.0,
            beta_y=5.0,
            **options,
        )
        dmp.imitate(demonstration.clock, demonstration.values)
        made = from_movement_primitives(dmp)
        assert made.law.space.coordinates == ("x0", "x1", "x2")
        assert share_apart(our_vectors(made), dmp_vectors(dmp)) < 1e-6
        assert share_apart(dmp.open_loop()[1][: STEPS + 1], our_vectors(made)) < 6e-3


@pytest.mark.parametrize("functions", [None, 40, 200])
def test_vectors_carry_over_to_pydmps_and_back(
    pydmps: dict[str, Any], functions: int | None
) -> None:
    dmp = learn(reached(4))
    made = pydmps["discrete"](**to_pydmps(dmp, functions=functions))
    ours = our_vectors(dmp)
    assert share_apart(pydmps_vectors(made, dmp.law.start_velocity), ours) < 5e-6
    back = from_pydmps(made, duration=dmp.duration, names=["q0", "q1", "q2"])
    assert back.law.space == dmp.law.space
    assert back.duration == dmp.duration
    assert np.array_equal(back.start_position, dmp.start_position)
    at_rest = pydmps_vectors(made, np.zeros(3))
    assert share_apart(our_vectors(back), at_rest) < 1e-6


def test_steps_of_pydmps_come_nearer_with_the_step(pydmps: dict[str, Any]) -> None:
    s = np.linspace(0, 1, 401)
    u = s**3 * (10 - 15 * s + 6 * s**2)
    rest_to_rest = np.column_stack([u, np.sin(2 * np.pi * u), 0.3 * u])
    dmp = learn(ns.Trajectory(2 * s, rest_to_rest))
    expected, off = our_vectors(dmp), []
    for steps in (500, 1000):
        made = pydmps["discrete"](**to_pydmps(dmp, time_step=dmp.duration / steps))
        path = made.rollout(tau=1 / dmp.duration, timesteps=steps)[0]
        off.append(share_apart(path[steps // STEPS - 1 :: steps // STEPS], expected[1:]))
    assert off[0] < 0.01
    assert 1.7 < off[0] / off[1] < 2.3


def test_a_goal_at_the_start_is_reached_in_pydmps_too(pydmps: dict[str, Any]) -> None:
    s = np.linspace(0, 1, 401)
    u = s**3 * (10 - 15 * s + 6 * s**2)
    loop = np.column_stack([np.sin(np.pi * u) ** 2, u])
    dmp = learn(ns.Trajectory(2 * s, loop))
    assert dmp.start_position[0] == pytest.approx(dmp.goal_position[0], abs=1e-12)
    options = to_pydmps(dmp)
    made = pydmps["discrete"](**options)
    assert np.array_equal(made.goal, options["goal"])
    assert share_apart(pydmps_vectors(made, dmp.law.start_velocity), our_vectors(dmp)) < 1e-6


@pytest.mark.parametrize("seed", [1, 2])
def test_rhythms_carry_over_to_pydmps_and_back(pydmps: dict[str, Any], seed: int) -> None:
    dmp = learn(around(seed), rhythmic=True)
    made = pydmps["rhythmic"](**to_pydmps(dmp))
    ours = our_vectors(dmp)
    assert share_apart(pydmps_vectors(made, dmp.law.start_velocity), ours) < 1e-9
    # Their steps start at rest, and are on the cycle some periods later.
    per_period = dmp.steps
    path = made.rollout(tau=2 * np.pi / dmp.duration, timesteps=4 * per_period)[0]
    found = path[3 * per_period - 1 :][: per_period + 1]
    assert share_apart(found, dmp.rollout(time_step=dmp.duration / per_period).values) < 0.02
    back = from_pydmps(made, duration=dmp.duration, names=["a", "b"])
    assert back.law.clock == dmp.law.clock
    assert share_apart(our_vectors(back), ours) < 1e-5
    cycles = back.rollout(cycles=3).values
    np.testing.assert_allclose(cycles[-1], cycles[0], rtol=0, atol=1e-9)


def test_imitations_of_pydmps_carry_over(pydmps: dict[str, Any]) -> None:
    demonstration = reached(5, 2)
    made = pydmps["discrete"](n_dmps=2, n_bfs=50, dt=1 / STEPS)
    made.imitate_path(demonstration.values.T)
    found = from_pydmps(made)
    assert found.duration == 1.0
    assert found.law.attractor == learn(demonstration, basis_functions=5).law.attractor
    assert share_apart(our_vectors(found), pydmps_vectors(made, np.zeros(2))) < 1e-6
    rhythm = pydmps["rhythmic"](n_dmps=2, n_bfs=30, dt=0.01)
    rhythm.imitate_path(around(1).values.T)
    law = from_pydmps(rhythm).law
    assert law.duration == 2 * np.pi
    assert settled(law, no_rule(law.space)).start == pytest.approx(law.start, abs=1e-9)


def test_what_has_no_counterpart_is_refused_in_a_line(their_dmp: Any) -> None:
    rhythm = learn(around(1), rhythmic=True, basis_functions=20)
    with pytest.raises(InputError, match="rhythm, of which movement_primitives has none"):
        to_movement_primitives(rhythm)
    with pytest.raises(InputError, match="dmp has rotations, which pydmps has not"):
        to_pydmps(learn(smooth(1), basis_functions=10))
    with pytest.raises(InputError, match="dmp must be a DMPs_discrete or a DMPs_rhythmic"):
        from_pydmps(rhythm)
    vectors = to_movement_primitives(learn(reached(1), basis_functions=20))
    with pytest.raises(InputError, match="names: got 2, but dmp has 3 dimensions"):
        from_movement_primitives(vectors, names=["a", "b"])
    vectors.start_y[1] = np.nan
    with pytest.raises(InputError, match="DMP: start_y is not finite"):
        from_movement_primitives(vectors)
    uneven = their_dmp(2, alpha_y=[25.0, 30.0])
    with pytest.raises(InputError, match=r"alpha_y .*learn\(ns.Trajectory\(\*dmp.open_loop"):
        from_movement_primitives(uneven)


def test_what_pydmps_cannot_hand_over_is_refused(pydmps: dict[str, Any]) -> None:
    made = pydmps["discrete"](n_dmps=2, n_bfs=5)
    made.w[1, 2] = np.nan
    with pytest.raises(InputError, match="DMPs_discrete: a weight is not finite"):
        from_pydmps(made)
    uneven = pydmps["discrete"](n_dmps=2, n_bfs=5, ay=np.array([25.0, 30.0]))
    with pytest.raises(InputError, match=r"DMPs_discrete: ay is .* one number here"):
        from_pydmps(uneven)
    with pytest.raises(InputError, match="duration must be a positive"):
        from_pydmps(pydmps["discrete"](n_dmps=2, n_bfs=5), duration=0.0)


# -------------------------------------------------------------------- the page


def test_the_page_runs(theirs: Any) -> None:
    pytest.importorskip("pytransform3d", reason="interop extra")
    names: dict[str, Any] = {}
    for block in re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL):
        exec(compile(block, PAGE.name, "exec"), names)
    # Through the chain of frames and by SciPy alone: the same blade, a meter apart in height.
    np.testing.assert_allclose(
        names["blade"].positions + [0, 0, 1], names["same"].positions, rtol=0, atol=1e-12
    )
    assert ns.check(names["constrained"].rollout(), ns.Blade()).peak < 1e-10
