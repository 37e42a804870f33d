"""Distributions of motions: against textbook formulas, SciPy, exact projections and simulation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from inspect import signature
from pathlib import Path
from typing import Any, get_type_hints

import casadi as ca
import numpy as np
import pytest
import scipy
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg.lapack import dgbsv
from scipy.spatial.transform import Rotation

import kinds
import noslip as ns
from kinds import ARM, joint_cut
from motions import eased
from noslip import learning
from noslip._typing import Floats
from noslip.constraints.system import ConstraintSystem
from noslip.distribution import MotionDistribution, estimation, learn_distribution
from noslip.distribution import retraction as moving
from noslip.distribution.arrays import OnArrays
from noslip.distribution.blocks import Blocks
from noslip.distribution.curves import FRACTIONS, Curves
from noslip.distribution.demonstrated import deviations, projected
from noslip.distribution.estimation import log_likelihood
from noslip.distribution.gaussian import Gaussian
from noslip.document import write_document
from noslip.errors import CompromiseWarning, InputError
from noslip.projection.band import Band
from noslip.projection.request import ADAPTING, Request
from noslip.projection.trajectory import project
from noslip.saving import load_distribution
from noslip.space import POSE
from noslip.vectors import Trajectory
from refusals import refusal
from strategies import seeds

ENDS: tuple[ns.boundary.End, ns.boundary.End] = ("free", "position")
BLADE = ns.Blade()


def cuts(count: int = 6, seed: int = 1) -> list[ns.PoseTrajectory]:
    """Planar cuts of 0.1 m by one hand: each bends, tilts and hurries a little otherwise."""
    rng, found, s = np.random.default_rng(seed), [], np.linspace(0, 1, 101)
    for number in range(count):
        bend, late, tilt, askew = rng.normal(size=4)
        u = eased(s + 0.05 * late * s * (1 - s))
        path = np.column_stack([0.1 * u, (0.02 + 0.004 * bend) * np.sin(np.pi * u), 0 * u])
        slope = (0.2 + 0.04 * bend) * np.pi * np.cos(np.pi * u)
        yaw = np.arctan(slope) + 0.03 * askew * np.sin(np.pi * s)
        held = Rotation.from_euler("ZX", np.column_stack([yaw, 0.05 * tilt * np.sin(2 * s)]))
        found.append(ns.PoseTrajectory(2 * s, path, held, name=f"cut {number}"))
    return found


FEW = {"weights": (12, 16), "shrinkage": (0.2, 0.5, 0.8), "length": (0.1, 0.3)}
"""Of the shapes that are tried: these motions are simple, and the time of tests is short."""


@cache
def learned() -> MotionDistribution:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(estimation, "CHOICES", FEW)
        return learn_distribution(ns.learn(cuts(), BLADE, basis_functions=30), cuts())


def beside(distribution: MotionDistribution, at: float, share: float) -> ns.Boundary:
    """A pose beside the mean, by a share of the standard deviation."""
    motion = distribution.motion
    k, row = round(at * (len(motion) - 1)), round(at * (len(FRACTIONS) - 1))
    moved = share * distribution.spread.position_deviation[row]
    turned = Rotation.from_rotvec(share * distribution.spread.rotation_deviation[row])
    return ns.Boundary(at, motion.positions[k] + moved, turned * motion.rotations[k])


# -------------------------------------------------------------------- normal distributions


def spread(rng: np.random.Generator, size: int) -> Floats:
    root = rng.normal(size=(size, size))
    return np.asarray(root @ root.T + 0.1 * np.eye(size))


@given(seeds, st.integers(1, 4), st.floats(0.0, 2.0))
def test_conditions_are_those_of_the_joint_distribution(seed: int, seen: int, noise: float) -> None:
    rng = np.random.default_rng(seed)
    rows, values = rng.normal(size=(seen, 6)), rng.normal(size=seen)
    known = Gaussian(rng.normal(size=6), spread(rng, 6))
    found = known.given(rows, values, np.full(seen, noise))
    if noise > 0.1:
        # By precisions, which add up.
        precision = np.linalg.inv(known.covariance) + rows.T @ rows / noise**2
        covariance = np.linalg.inv(precision)
        pull = np.linalg.solve(known.covariance, known.mean) + rows.T @ values / noise**2
        np.testing.assert_allclose(found.covariance, covariance, atol=1e-8)
        np.testing.assert_allclose(found.mean, covariance @ pull, atol=1e-7)
    if noise == 0:
        np.testing.assert_allclose(rows @ found.mean, values, atol=1e-8)
        np.testing.assert_allclose(rows @ found.covariance, 0, atol=1e-8)
    assert np.linalg.eigvalsh(found.covariance).min() > -1e-10


def test_what_is_known_exactly_is_not_to_be_otherwise() -> None:
    rows, nothing = np.eye(3)[:1], np.zeros(1)
    known = Gaussian(np.zeros(3), np.eye(3)).given(rows, np.ones(1), nothing)
    again = known.given(rows, np.ones(1), nothing)
    np.testing.assert_allclose(again.covariance, np.diag([0, 1, 1]), atol=1e-12)
    assert known.surprise(rows, np.ones(1), nothing) == (0.0, 0)
    assert "known exactly" in refusal(InputError, known.given, rows, np.zeros(1), nothing)


@given(seeds, st.integers(2, 12))
@settings(max_examples=2)
def test_density_is_students_of_all_values(seed: int, freedom: int) -> None:
    rng = np.random.default_rng(seed)
    curves = Curves(np.linspace(0, 1, 50), 4)
    mean, covariance, noise = rng.normal(size=4), spread(rng, 4), rng.uniform(0.1, 2, 1)
    values, basis = rng.normal(size=(len(FRACTIONS), 1)), curves.values
    shape = basis @ covariance @ basis.T + np.diag(np.repeat(noise**2, len(FRACTIONS)))
    oracle = scipy.stats.multivariate_t(basis @ mean, shape, df=freedom).logpdf(values.T.ravel())
    found = log_likelihood(Gaussian(mean, covariance), noise, values, curves, freedom)
    assert found == pytest.approx(oracle / values.size, abs=1e-9)


@given(seeds, st.integers(4, 20))
@settings(max_examples=15)
def test_curves_hold_cubics_of_the_way(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    path = np.cumsum(rng.uniform(0, 1, size=(301, 3)), axis=0)
    curves = Curves.along(path, count)
    np.testing.assert_allclose(curves.values.T @ curves.values, np.eye(count), atol=1e-12)
    cubic = np.polynomial.Polynomial(rng.normal(size=4))(curves.places)
    np.testing.assert_allclose(curves.values @ (curves.values.T @ cubic), cubic, atol=1e-9)
    np.testing.assert_allclose(curves.at(FRACTIONS), curves.values, atol=1e-9)


# -------------------------------------------------------------------- onto the constraints


def test_graphs_on_arrays_are_those_of_the_virtual_machine() -> None:
    x = ca.SX.sym("x", 3)
    known = [ca.sin(x[0]) * ca.atan2(x[1], x[2]), ca.if_else(x[0] < x[1], x[2] ** 3, -2 * x[0])]
    known += [ca.fmax(x[0], ca.fabs(x[1])) / ca.sqrt(1 + x[2] ** 2), ca.DM(3)]
    values = np.random.default_rng(0).normal(size=(3, 7, 5))
    for graph in (known, [*known, ca.erf(x[0])]):
        function = ca.Function("f", [x], [ca.densify(ca.vertcat(*graph))])
        found = OnArrays(function)(list(values)).swapaxes(0, 1)
        oracle = np.array(function(values.reshape(3, -1))).reshape(-1, 7, 5)
        np.testing.assert_allclose(found, oracle, atol=1e-14)


@given(seeds, st.integers(5, 40), st.integers(1, 4))
@settings(max_examples=20)
def test_blocks_solve_what_lapack_does(seed: int, count: int, stage: int) -> None:
    rng = np.random.default_rng(seed)
    band = Band(count, stage, 0)
    band.storage[band.width :] = rng.normal(size=(2 * band.width + 1, count * stage))
    band.storage[2 * band.width] += 10.0 * band.width
    right = rng.normal(size=(count * stage, 3))
    width = band.width
    oracle = dgbsv(width, width, band.storage.copy(order="F"), right.copy(order="F"))[2]
    blocks = Blocks(band)
    found = np.zeros((blocks.rows, 3))
    found[: len(right)] = right
    blocks.solve(found)
    found = found[: len(right)]
    np.testing.assert_allclose(found, oracle, atol=1e-10 * np.abs(oracle).max())


def test_moving_onto_the_constraints_is_the_nearest_way_to_first_order() -> None:
    distribution = learned()
    motion = distribution.motion
    ends = (ns.Boundary.keeping(motion, 1.0, "position"),)
    retraction = moving.Retraction(Request(motion, distribution.system, ends, ADAPTING))
    drawn = POSE.difference(distribution.drawn(1, seed=3)[0], motion.points)
    apart = []
    for share in (1.0, 0.5):
        points = POSE.moved(motion.points, share * drawn)
        found = retraction(points[:, :, None])
        assert found.arrived.all()
        trajectory = distribution.trajectory(points, "drawn")
        kept = (ns.Boundary.keeping(trajectory, 1.0, "position"),)
        exact = project(Request(trajectory, distribution.system, kept, ADAPTING))
        apart.append(np.abs(POSE.difference(found.points[:, :, 0], exact.trajectory.points)).max())
    # Of second order: half as far, a quarter apart.
    assert apart[1] < 0.4 * apart[0] < 0.1 * np.abs(drawn).max()


# -------------------------------------------------------------------- distributions


@given(at=st.floats(0.15, 0.85), share=st.floats(-1.0, 1.0), seed=seeds)
@settings(max_examples=4)
def test_samples_keep_the_constraint_and_pass_the_pose(at: float, share: float, seed: int) -> None:
    pose = beside(learned(), at, share)
    conditioned = learned().condition(pose)
    motions = conditioned.sample(6, seed=seed)
    k = round(at * (motions.states.shape[1] - 1))
    assert np.abs(motions.positions[:, k] - pose.position).max() < 1e-9
    turned = Rotation.from_quat(motions.quaternions[:, k], scalar_first=True) * pose.rotation.inv()
    assert turned.magnitude().max() < 1e-9
    drawn = conditioned.drawn(6, seed=seed)
    assert np.abs(motions.positions[:, -1] - drawn[:, -1, :3]).max() < 1e-9
    for number in range(len(motions)):
        (found,) = ns.check(motions[number], BLADE).constraints
        assert found.peak < 1e-10
    assert np.abs(motions.constraint_residuals).max() < 1e-10


def test_first_samples_are_alike_for_any_count() -> None:
    few, many = (learned().sample(count, seed=5).states for count in (2, 5))
    np.testing.assert_allclose(few, many[:2], atol=1e-9)


def test_its_mean_is_a_primitive_that_passes_the_pose() -> None:
    pose = beside(learned(), 0.4, 1.0)
    conditioned = learned().condition(pose)
    motion = conditioned.mean.rollout()
    off, _ = ns.verification.deviations(motion, conditioned.motion)
    assert off.max() < 1e-3 * motion.path_length
    assert ns.check(motion, BLADE).constraints[0].peak < 1e-10
    spread_there = conditioned.mean.spread
    assert spread_there is not None
    assert spread_there.position_deviation[40].max() < 1e-6
    assert spread_there.position_deviation[80].max() > 1e-4


def test_noise_leaves_room() -> None:
    pose = beside(learned(), 0.4, 1.0)
    loose = learned().condition(pose, noise=(0.002, 0.05))
    k = round(0.4 * (len(loose.motion) - 1))
    off = np.linalg.norm(loose.motion.positions[k] - pose.position)
    before = np.linalg.norm(learned().motion.positions[k] - pose.position)
    assert 1e-5 < off < before
    assert loose.kept == ()
    # The same noise again is twice the evidence.
    nearer = loose.condition(pose, noise=(0.002, 0.05)).motion.positions[k] - pose.position
    assert np.linalg.norm(nearer) < off


def test_likely_is_what_was_demonstrated() -> None:
    shown = learned().log_likelihood(cuts()[0])
    other = cuts(1, seed=9)[0]
    aside = other.with_points(other.points + np.eye(7)[1] * 0.02)
    assert shown > learned().log_likelihood(other) > learned().log_likelihood(aside)


def test_what_was_not_demonstrated_is_told() -> None:
    middle = learned().motion.positions[len(learned().motion) // 2]
    with pytest.warns(CompromiseWarning, match="standard deviations from what was demonstrated"):
        learned().condition(ns.Boundary(0.5, middle + [0, 0.03, 0]))
    # All end in one place: another one is no matter of likelihood.
    end = ns.Boundary(1.0, learned().motion.positions[-1] + [0, 0.03, 0])
    assert "have it in common" in refusal(InputError, learned().condition, end)


def test_turning_beyond_the_spread_is_told() -> None:
    known, curves = learned().gaussian, learned().curves
    turned = known.mean.reshape(6, -1).copy()
    turned[5] += 0.5 * curves.values.sum(axis=0)
    askew = replace(learned(), gaussian=Gaussian(turned.ravel(), known.covariance))
    with pytest.warns(CompromiseWarning, match="turn the mean motion by"):
        assert ns.check(askew.motion, BLADE).constraints[0].peak < 1e-8
    with pytest.warns(CompromiseWarning, match="turn 2 of 2 samples"):
        askew.sample(2)


def test_limits_hold_of_each_sample() -> None:
    wall = ns.keep_nonnegative(lambda motion: 0.021 - motion.position[1], level="position")
    primitive = learned().primitive
    rule = replace(primitive.rule, system=ConstraintSystem([BLADE, wall]))
    distribution = replace(learned(), primitive=replace(primitive, rule=rule))
    motions = distribution.sample(4, seed=2)
    assert (distribution.drawn(4, seed=2)[:, :, 1] > 0.021).any()
    assert motions.margins.min() > -1e-8
    assert motions.positions[:, :, 1].max() < 0.021 + 1e-8
    assert np.abs(motions.constraint_residuals).max() < 1e-10


@pytest.mark.usefixtures("compiling")
def test_compiled_samples_are_the_same_but_for_rounding() -> None:
    motion = learned().motion
    ends = (ns.Boundary.keeping(motion, 1.0, "position"),)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NOSLIP_COMPILE", "0")
        plain = moving.Retraction(Request(motion, learned().system, ends, ADAPTING))
        drawn = np.moveaxis(learned().drawn(5, seed=1), 0, -1)
        expected = plain(drawn)
    retraction = moving.Retraction(Request(motion, learned().system, ends, ADAPTING))
    found = retraction(drawn)
    assert found.arrived.all()
    np.testing.assert_allclose(found.points, expected.points, atol=1e-9)
    np.testing.assert_allclose(retraction.residuals(drawn), plain.residuals(drawn), atol=1e-12)


# -------------------------------------------------------------------- vectors, context, intervals


def waves(count: int, seed: int, size: float | None = None) -> tuple[list[Trajectory], Floats]:
    """Curves in the plane, whose height follows a number linearly, but for noise."""
    rng, u = np.random.default_rng(seed), eased(np.linspace(0, 1, 101))
    sizes = rng.uniform(1, 2, count) if size is None else np.full(count, size)
    own = 0.05 * rng.normal(size=(count, 2))
    shapes = [
        np.column_stack([u + a * u * (1 - u), (0.3 * c + b) * np.sin(np.pi * u)])
        for (a, b), c in zip(own, sizes, strict=True)
    ]
    return [Trajectory(2 * u + 1e-3 * FRACTIONS, shape) for shape in shapes], sizes


@cache
def waving() -> MotionDistribution:
    shown, sizes = waves(8, 0)
    primitive = ns.learn(shown, basis_functions=30)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(estimation, "CHOICES", FEW)
        return learn_distribution(primitive, shown, context={"size": sizes.tolist()})


def test_context_is_a_regression() -> None:
    shown, sizes = waves(8, 0)
    heights = [motion.resampled(times=[0.0, 1.0]).values[1, 1] for motion in shown]
    slope, offset = np.polyfit(sizes, heights, 1)
    for size in (1.2, 1.8):
        motion = waving().condition(context={"size": size}).motion
        middle = motion.resampled(times=[motion.times[0], motion.times[0] + motion.duration / 2])
        assert middle.values[1, 1] == pytest.approx(offset + slope * size, abs=3e-3)
    assert waving().condition(context={"size": 1.5}).interval()[50, 1] < waving().interval()[50, 1]


def test_intervals_hold_what_they_say() -> None:
    conditioned = waving().condition(context={"size": 1.5})
    fresh, _ = waves(200, 1, size=1.5)
    off = np.array([deviations(f, conditioned.reference) for f in fresh]) - conditioned.middle
    for level in (0.9, 0.95, 0.99):
        inside = np.abs(off) <= conditioned.interval(level)
        assert level - 0.12 < inside[:, 10:91].mean() <= 1


def test_intervals_with_confidence_hold_of_so_many_sets() -> None:
    """Of one normal number in 4 samples, simulated: mean and variance are as in the estimate."""
    count, level, confidence = 4, 0.9, 0.8
    drawn = np.random.default_rng(3).normal(size=(20_000, count))
    freedom = estimation.freedom_of(waving().demonstrations, 1)
    wide = waving().interval(level, confidence)[50, 0] / waving().interval(level)[50, 0]
    student = scipy.stats.t.ppf((1 + level) / 2, freedom)
    short = scipy.stats.chi2.ppf(1 - confidence, freedom)
    assert wide * student == pytest.approx(1.6448536 * np.sqrt(freedom / short), rel=1e-6)
    short = scipy.stats.chi2.ppf(1 - confidence, count - 1)
    half = 1.6448536 * np.sqrt((count - 1) / short * (1 + 1 / count)) * drawn.std(axis=1, ddof=1)
    middle = drawn.mean(axis=1)
    held = scipy.stats.norm.cdf(middle + half) - scipy.stats.norm.cdf(middle - half) >= level
    assert held.mean() == pytest.approx(confidence, abs=0.02)


@pytest.mark.parametrize(
    ("ask", "told"),
    [
        (lambda d: d.interval(0.9, confidence=1.0), "confidence must be between 0 and 1"),
        (lambda d: d.condition(), "at least one boundary"),
        (lambda d: d.condition(ns.Boundary(0.5)), "a position or a rotation"),
        (lambda d: d.condition(ns.Boundary(0.5, [0, 0, 0])), "position"),
        (lambda d: d.condition("here"), "Boundary objects"),
        (lambda d: d.condition(context={"width": 1}), "there are size"),
        (lambda d: d.condition(context={"size": float("nan")}), "finite"),
        (lambda d: d.condition(ns.Boundary(0.5, [0, 0]), noise=-1), "noise"),
        (lambda d: d.interval(1.0), "between 0 and 1"),
        (lambda d: d.sample(0), "count"),
        (lambda d: d.impedance(), "pose"),
        (lambda d: learn_distribution(d.primitive, waves(2, 0)[0]), "3 demonstrations or more"),
        (
            lambda d: MotionDistribution.about(kinds.learned("rhythms"), waves(3, 0)[0]),
            "would tear a rhythm",
        ),
        (
            lambda d: ns.learn(waves(3, 0)[0], rhythmic=True, distribution=True),
            "leave out rhythmic",
        ),
        (
            lambda d: learn_distribution(d.primitive, waves(3, 0)[0], context={"a": [1, 2]}),
            "3 finite numbers",
        ),
    ],
)
def test_what_makes_no_sense_is_refused(ask: Callable[..., object], told: str) -> None:
    assert told in refusal(InputError, ask, waving())


# -------------------------------------------------------------------- impedance


def test_impedance_is_stiff_where_motions_agree(tmp_path: Path) -> None:
    conditioned = learned().condition(beside(learned(), 0.5, 0.5))
    found = conditioned.impedance(linear=(50, 500), angular=(1, 10), damping_ratio=0.7, mass=2.0)
    assert found.stiffness[:, :3].min() >= 50 and found.stiffness[:, :3].max() <= 500
    k = len(found.stiffness) // 2
    assert found.stiffness[k] == pytest.approx([500] * 3 + [10] * 3, rel=1e-3)
    assert found.stiffness[:, :3].min() < 300
    expected = 2 * 0.7 * np.sqrt(found.stiffness[:, :3] * 2.0)
    np.testing.assert_allclose(found.damping[:, :3], expected)
    (back,) = ns.load_demonstrations(found.trajectory.to_csv(tmp_path / "held.csv"))
    np.testing.assert_array_equal(back.positions, found.trajectory.positions)
    table = np.genfromtxt(tmp_path / "held.csv", delimiter=",", names=True)
    np.testing.assert_array_equal(table["kry_Nmrad"], found.stiffness[:, 4])
    # The same beside the poses of what the mean primitive does, read back from its file.
    held = conditioned.held(linear=(50, 500), angular=(1, 10), damping_ratio=0.7, mass=2.0)
    beside_it = ns.load_primitive(held.save(tmp_path / "held.json")).rollout().channels
    assert beside_it is not None and beside_it.units[:4] == ("N/m",) * 3 + ("Nm/rad",)
    stiff = np.interp(0.25, np.linspace(0, 1, len(found.stiffness)), found.stiffness[:, 1])
    along = np.linspace(0, 1, len(beside_it.times))
    assert np.interp(0.25, along, beside_it.column("ky")) == pytest.approx(stiff, rel=0.05)
    with pytest.raises(InputError, match="least and the largest"):
        conditioned.impedance(linear=(5, 1))


def test_a_projected_demonstration_stays() -> None:
    once = projected(cuts()[0], learned().system, ENDS, 30)
    again = projected(once, learned().system, ENDS, 30)
    assert np.abs(POSE.difference(again.points, once.points)).max() < 1e-6


def test_two_tools_are_distributed_under_the_blade_of_one(tmp_path: Path) -> None:
    shown, random = kinds.tools(), np.random.default_rng(0)
    s = np.linspace(0, 1, len(shown))[:, None]
    several = [
        shown.with_points(
            shown.space.moved(shown.points, 0.03 * s * (1 - s) * random.normal(size=12))
        )
        for _ in range(4)
    ]
    rule = kinds.KINDS["two tools"].rule
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(estimation, "CHOICES", {"weights": (8,), "shrinkage": (0.5,)})
        found = ns.learn(several, list(rule), distribution=True, basis_functions=30)
    place = found.motion.positions[len(found.motion) // 2] + 0.003 * found.middle[50, :6]
    motions = found.condition(ns.Boundary(0.5, place)).sample(2)
    assert isinstance(motions[0], ns.Bodies)
    assert ns.check(motions[1], list(rule)).constraints[0].peak <= 1e-10
    passed = motions.positions[:, round(0.5 * (motions.states.shape[1] - 1))]
    np.testing.assert_allclose(passed, np.broadcast_to(place, passed.shape), atol=1e-9)


def test_joints_of_a_robot_are_distributed_as_learning_took_them() -> None:
    """Its robot, and demonstrations that can be read once."""
    cut, random = joint_cut(), np.random.default_rng(0)
    aside = np.linspace(0, 1, len(cut))[:, None]
    several = (
        ns.Trajectory(cut.times, cut.values + 0.02 * random.normal(size=4) * aside, cut.names)
        for _ in range(4)
    )
    found = ns.learn(several, [ns.Blade()], robot=ARM, distribution=True, basis_functions=30)
    (origin,) = found.primitive.history
    assert origin.options["distribution"] is True
    motion = found.sample(1, seed=0)[0]
    assert ns.check(motion, [ns.Blade()]).constraints[0].peak <= 1e-10


# -------------------------------------------------------------------- in files


def test_it_is_saved_and_read_back(tmp_path: Path) -> None:
    conditioned = learned().condition(beside(learned(), 0.4, 0.5))
    back = load_distribution(conditioned.save(tmp_path / "cuts.json"))
    np.testing.assert_array_equal(back.interval(), conditioned.interval())
    np.testing.assert_array_equal(back.gaussian.mean, conditioned.gaussian.mean)
    assert back.log_likelihood(cuts()[1]) == conditioned.log_likelihood(cuts()[1])
    found, expected = (each.sample(2, seed=3).states for each in (back, conditioned))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
    assert repr(back) == repr(conditioned)
    # To all else the file is that of the primitive.
    primitive = ns.load_primitive(tmp_path / "cuts.json")
    np.testing.assert_array_equal(
        primitive.rollout().positions, conditioned.primitive.rollout().positions
    )
    alone = primitive.save(tmp_path / "alone.json")
    assert "no distribution" in refusal(InputError, load_distribution, alone)


def test_a_context_is_read_back(tmp_path: Path) -> None:
    back = load_distribution(waving().save(tmp_path / "waves.json"))
    found, expected = (d.condition(context={"size": 1.5}).middle for d in (back, waving()))
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize(
    ("field", "value", "told"),
    [
        ("covariance", "negative", "negative variance"),
        ("covariance", "askew", "symmetric"),
        ("covariance", "nan", "covariance"),
        ("covariance", [[1.0]], "shape"),
        ("mean", [1.0], "shape"),
        ("noise", "zero", "above 0"),
        ("curves", 3, "weights"),
        ("curves", 10**9, "curves"),
        ("demonstrations", 2, "demonstrations"),
        ("context", ["size", "size"], "its own name"),
        ("ends", ["free"], "expected two"),
        ("ends", ["free", "there"], "ends"),
        ("kept", [{"at": 0.5}], "nothing is kept"),
        ("kept", [{"at": 1.5, "position": [0.0, 0.0]}], "fraction"),
        ("kept", [{"at": 0.5, "position": [0.0]}], "shape"),
        ("score", None, "score"),
        ("score", ..., "score is missing"),
    ],
)
def test_a_wrong_file_is_refused(tmp_path: Path, field: str, value: Any, told: str) -> None:
    data = waving().as_data()
    own = data["distribution"]
    wrong = np.array(own["covariance"])
    match value:
        case "negative":
            wrong[0, 0] = -1.0
        case "askew":
            wrong[0, 1] += 1.0
        case "nan":
            wrong[0, 0] = np.nan
    replaced = {"negative": wrong, "askew": wrong, "nan": wrong}.get(str(value))
    if value is ...:
        del own[field]
    elif value == "zero":
        own[field] = [0.0] * len(own[field])
    else:
        own[field] = value if replaced is None else replaced.tolist()
    path = write_document(tmp_path / "wrong.json", data)
    message = refusal(InputError, load_distribution, path)
    assert message.startswith(f"{path}: ") and told in message


def test_a_type_checker_is_told_all_options_of_learning() -> None:
    known = set(signature(ns.learn).parameters)
    told = set(get_type_hints(learning._Options)) | {"demonstrations", "constraints"}
    assert told | {"distribution"} == known
