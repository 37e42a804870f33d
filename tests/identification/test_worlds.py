"""The worlds obey their rules: asked of the library's own residuals, which did not make them."""

from __future__ import annotations

import numpy as np
import pytest

from identification.worlds import KINDS, world
from measures import residuals
from noslip.constraints import TurningRadius


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", [0, 1])
def test_a_world_keeps_its_rule_to_the_chords_of_its_samples(kind: str, seed: int) -> None:
    for rate, bound in ((100, 5e-5), (400, 3e-6)):
        made = world(kind, seed, rate=rate)
        rules = [rule for rule in made.constraints if not isinstance(rule, TurningRadius)]
        if rules:
            assert np.abs(residuals(made.exact, rules)).max() < bound
        assert 0.1 < made.exact.path_length < 3.0


def test_a_car_bends_as_tightly_as_it_can_and_no_tighter() -> None:
    made = world("car", 3)
    margin = residuals(made.exact, [made.constraints[1]])
    assert -1e-5 < margin.min() < 1e-3


def test_noise_is_what_was_asked_for_and_a_seed_is_a_world() -> None:
    made, again = (world("blade", 5, (1e-4, 1e-3)) for _ in range(2))
    assert made.trajectory == again.trajectory
    away = made.trajectory.positions - made.exact.positions
    turns = (made.trajectory.rotations * made.exact.rotations.inv()).as_rotvec()
    assert np.allclose([away.std(), turns.std()], [1e-4, 1e-3], rtol=0.1)
