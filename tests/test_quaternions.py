"""Many rotations at once: what SciPy says of each, also at no turn and at half a turn."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from scipy.spatial.transform import Rotation

from noslip.quaternions import inverse, product, turned, turns_between, without_flips
from strategies import seeds


def some(seed: int) -> Rotation:
    """Random rotations, and near each other: by nothing, next to nothing and half a turn."""
    first = Rotation.random(random_state=seed)
    axis = first.as_rotvec() / first.magnitude()
    turns = [0.0, 1e-300, 1e-17, 1e-9, 1e-8, 1e-4, 1.0, np.pi - 1e-9, -2.0]
    near = Rotation.from_rotvec(np.outer(turns, axis)) * first
    return Rotation.concatenate([near, Rotation.random(20, random_state=seed)])


@given(seeds)
def test_scipy_says_the_same(seed: int) -> None:
    rotations = some(seed)
    quaternions = rotations.as_quat(scalar_first=True)
    one, other = quaternions[1:], quaternions[:-1]
    expected = (rotations[1:] * rotations[:-1].inv()).as_rotvec()
    np.testing.assert_allclose(turns_between(other, one), expected, rtol=0, atol=1e-14)
    led = turned(expected, other)
    apart = Rotation.from_quat(led, scalar_first=True) * rotations[1:].inv()
    assert apart.magnitude().max() <= 1e-14
    np.testing.assert_allclose(
        product(one, inverse(other)),
        Rotation.as_quat(rotations[1:] * rotations[:-1].inv(), scalar_first=True),
        rtol=0,
        atol=1e-15,
    )


@given(seeds)
def test_turns_are_exact_however_small(seed: int) -> None:
    turns = np.random.default_rng(seed).normal(size=(40, 3))
    turns *= (np.logspace(-20, 0.4, 40) / np.linalg.norm(turns, axis=1))[:, None]
    still = np.tile([1.0, 0.0, 0.0, 0.0], (40, 1))
    found = turns_between(still, turned(turns, still))
    np.testing.assert_allclose(found, turns, rtol=1e-14, atol=1e-300)


@given(seeds)
def test_neighbors_are_not_opposite(seed: int) -> None:
    given = some(seed).as_quat(scalar_first=True)
    given *= np.random.default_rng(seed).choice([-1.0, 1.0], (len(given), 1))
    found = without_flips(given)
    assert (np.sum(found[1:] * found[:-1], axis=1) >= 0).all()
    np.testing.assert_array_equal(np.abs(found), np.abs(given))
