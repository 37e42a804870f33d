"""Clock, basis functions and the fit of the forcing term, against their formulas."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from noslip._typing import Floats
from noslip.errors import InputError
from noslip.law import points as point
from noslip.law.attractor import Attractor
from noslip.law.basis import Basis
from noslip.law.clock import Phase
from noslip.law.fitting import demonstrated_forces
from noslip.law.forcing import ForcingTerm
from noslip.space import POSE

rates = st.floats(0.05, 20)
counts = st.integers(1, 120)


def equation_3(basis: Basis, phases: Floats) -> Floats:
    """Compute ``psi_i(s) s / sum psi(s)`` one number at a time."""
    rows = []
    for s in phases:
        exponents = -0.5 * ((s - basis.centers) / basis.widths) ** 2
        psi = np.exp(exponents - exponents.max())
        rows.append(psi * s / psi.sum())
    return np.array(rows)


# -------------------------------------------------------------------- phase


@given(rates, st.floats(0, 1))
def test_phase_is_the_closed_form(alpha_s: float, fraction: float) -> None:
    phase = Phase(alpha_s)
    assert phase.at(fraction) == pytest.approx(np.exp(-alpha_s * fraction), rel=1e-15, abs=0)


@given(rates, st.floats(0.01, 0.99))
def test_phase_obeys_its_equation(alpha_s: float, fraction: float) -> None:
    h = 1e-6
    rate = (Phase(alpha_s).at(fraction + h) - Phase(alpha_s).at(fraction - h)) / (2 * h)
    assert rate == pytest.approx(-alpha_s * Phase(alpha_s).at(fraction), rel=1e-6)


@given(rates, st.lists(st.floats(0, 0.3), min_size=1, max_size=5))
def test_decays_multiply_to_the_phase(alpha_s: float, fractions: list[float]) -> None:
    phase = Phase(alpha_s)
    stepped = np.prod([phase.later(1.0, fraction) for fraction in fractions])
    assert stepped == pytest.approx(float(phase.at(sum(fractions))), rel=1e-13, abs=0)


# -------------------------------------------------------------------- basis functions


@given(rates, counts, st.floats(-0.5, 2))
def test_activations_sum_to_the_phase(alpha_s: float, count: int, fraction: float) -> None:
    # Before the start and long after the end too, where every Gaussian alone would underflow.
    basis = Basis(count, Phase(alpha_s))
    s = basis.phase.at([fraction])
    activations = basis.activations(s)
    assert activations.shape == (1, count)
    assert np.all(activations >= 0)
    np.testing.assert_allclose(activations.sum(axis=1), s, rtol=1e-13)


@given(rates, counts)
def test_activations_are_equation_3(alpha_s: float, count: int) -> None:
    basis = Basis(count, Phase(alpha_s))
    phases = basis.phase.at(np.linspace(0, 1, 17))
    # Below e^-50 of the largest, which no sum can hold, they are zero.
    np.testing.assert_allclose(
        basis.activations(phases), equation_3(basis, phases), rtol=1e-11, atol=np.exp(-50)
    )


@given(rates, st.integers(2, 120))
def test_centers_are_evenly_spaced_in_time_and_one_width_apart(alpha_s: float, count: int) -> None:
    basis = Basis(count, Phase(alpha_s))
    times = -np.log(basis.centers) / alpha_s
    np.testing.assert_allclose(times, np.linspace(0, 1, count), atol=1e-12)
    # One standard deviation lies between the distances to the neighbors on either side.
    gaps = np.abs(np.diff(basis.centers))
    inner = basis.widths[1:-1]
    assert np.all(inner >= np.minimum(gaps[:-1], gaps[1:]) * (1 - 1e-12))
    assert np.all(inner <= np.maximum(gaps[:-1], gaps[1:]) * (1 + 1e-12))


def smooth_force(seed: int, times: Floats) -> Floats:
    rng = np.random.default_rng(seed)
    force = np.outer(times, rng.normal(size=2))
    for k in (1, 2, 3):
        force += np.outer(np.sin(np.pi * k * times), rng.normal(size=2))
        force += np.outer(np.cos(np.pi * k * times), rng.normal(size=2))
    return force


HUNDRED = Basis(100)
TIMES = np.linspace(0, 1, 1001)
PHASES = HUNDRED.phase.at(TIMES)
SOLVE = np.linalg.pinv(HUNDRED.activations(PHASES))


@given(st.integers(0, 2**32 - 1))
def test_a_hundred_functions_match_any_smooth_force(seed: int) -> None:
    force = smooth_force(seed, TIMES)
    fitted = ForcingTerm(HUNDRED, SOLVE @ force)(PHASES)
    # alpha beta = 156 makes this 1e-5 of the path; the attractor smooths it tenfold.
    assert np.abs(fitted - force).max() <= 2e-3 * np.ptp(force)


# -------------------------------------------------------------------- ridge regression


def stacked_system(
    attractor: Attractor, basis: Basis, paths: list[Floats]
) -> tuple[Floats, Floats]:
    """Rows of the regression of all demonstrations, from the step's equation alone.

    The recursion ``x+ - S x + P x- = K x*`` gives the target of each step.  The target's own
    change within the step enters by central differences.
    """
    companion = np.array([[0.0, 1.0], [-attractor.stiffness, -attractor.alpha]])
    rows, forces = [], []
    for path in paths:
        h = 1 / (len(path) - 1)
        transition = expm(companion * h)
        total, product = np.trace(transition), np.linalg.det(transition)
        kick = path[2:] - total * path[1:-1] + product * path[:-2]
        target = kick / (1 - total + product)
        forces.append(attractor.stiffness * (target - path[-1]))
        psi = equation_3(basis, basis.phase.at(np.arange(len(path)) * h))
        before, now, after = psi[:-2], psi[1:-1], psi[2:]
        change, bend = attractor.led_by(h, h)
        rows.append(now + change * (after - before) / 2 + bend * (after - 2 * now + before))
    return np.vstack(rows), np.vstack(forces)


def fit_positions(
    attractor: Attractor, basis: Basis, paths: list[Floats], ridge: float
) -> ForcingTerm:
    """The forces that the positions of demonstrations ask for, which do not turn."""
    points = [np.hstack([path, np.tile([1.0, 0, 0, 0], (len(path), 1))]) for path in paths]
    goal = point.goal(POSE, points)
    forces = [demonstrated_forces(attractor, goal, p)[:, :3] for p in points]
    return ForcingTerm.fit(basis, attractor, forces, ridge=ridge)


@pytest.mark.parametrize("ridge", [1e-6, 1e-3, 1.0])
@pytest.mark.parametrize("demonstrations", [1, 3])
def test_the_fit_is_the_ridge_solution_of_the_stacked_system(
    ridge: float, demonstrations: int
) -> None:
    attractor, basis = Attractor(), Basis(30)
    paths = [
        np.cumsum(smooth_force(seed, np.linspace(0, 1, 80 + 20 * seed)), axis=0) / 80
        for seed in range(demonstrations)
    ]
    paths = [np.column_stack([path, path[:, :1] ** 2]) for path in paths]
    rows, forces = stacked_system(attractor, basis, paths)
    strength = np.sqrt(ridge * np.mean(np.sum(rows**2, axis=0)))
    expected = np.linalg.lstsq(
        np.vstack([rows, strength * np.eye(basis.count)]),
        np.vstack([forces, np.zeros((basis.count, 3))]),
        rcond=None,
    )[0]
    fitted = fit_positions(attractor, basis, paths, ridge)
    np.testing.assert_allclose(fitted.weights, expected, rtol=0, atol=1e-5 * np.abs(expected).max())
    np.testing.assert_allclose(
        rows @ fitted.weights, rows @ expected, rtol=0, atol=1e-7 * np.abs(forces).max()
    )


def test_more_ridge_means_smaller_weights() -> None:
    times = np.linspace(0, 1, 200)
    path = np.column_stack([times**2, np.sin(3 * times), 0 * times])
    sizes = [
        np.linalg.norm(fit_positions(Attractor(), Basis(50), [path], ridge).weights)
        for ridge in (1e-6, 1e-3, 1.0, 1e3)
    ]
    assert sizes == sorted(sizes, reverse=True)
    assert sizes[-1] < 0.1 * sizes[0]


@given(st.integers(0, 2**32 - 1), rates)
def test_force_is_the_sum_of_equation_3(seed: int, alpha_s: float) -> None:
    basis = Basis(25, Phase(alpha_s))
    weights = np.random.default_rng(seed).normal(size=(25, 3))
    phases = basis.phase.at(np.linspace(0, 1, 7))
    expected = equation_3(basis, phases) @ weights
    np.testing.assert_allclose(ForcingTerm(basis, weights)(phases), expected, atol=1e-12)


@pytest.mark.parametrize(
    ("weights", "message"),
    [
        (np.zeros((4, 3)), r"weights have shape \(4, 3\), expected \(5, dimensions\)"),
        (np.zeros(5), r"weights have shape \(5,\), expected \(5, dimensions\)"),
        (np.full((5, 3), np.nan), "a weight is not finite"),
    ],
)
def test_weights_must_match_the_basis(weights: Floats, message: str) -> None:
    with pytest.raises(InputError, match=message):
        ForcingTerm(Basis(5), weights)


def test_weights_cannot_be_changed_from_outside() -> None:
    given_weights = np.ones((5, 3))
    term = ForcingTerm(Basis(5), given_weights)
    given_weights[:] = 7.0
    assert np.all(term.weights == 1.0)
    with pytest.raises(ValueError, match="read-only"):
        term.weights[0] = 0.0
