"""Recordings through a shield: whole, or in chunks where they are long."""

from __future__ import annotations

import numpy as np
import pytest

import noslip as ns
from motions import planar_cut
from noslip.constraints.system import as_system
from noslip.shielding import datasets

BLADE = as_system([ns.Blade()])
CUT = planar_cut(beside=0.1, count=121).resampled(rate=30)


@pytest.mark.parametrize("length", [8, 16, 40, 1000])
def test_a_long_recording_has_no_joins_to_see(monkeypatch, length) -> None:
    whole, _ = datasets.shielded(CUT, BLADE)
    monkeypatch.setattr(datasets, "LONGEST", length)
    found, held = datasets.shielded(CUT, BLADE)
    assert held == ""
    assert found.name == CUT.name
    np.testing.assert_array_equal(found.times, CUT.times)
    assert np.abs(found.body_velocities[:, 1]).max() < 1e-10
    assert np.linalg.norm(found.positions - whole.positions, axis=1).max() < 6e-3
    jumps = np.linalg.norm(np.diff(found.step_velocities()[1], axis=0), axis=1)
    assert jumps.max() < 0.2


@pytest.mark.parametrize("count", [4, 7, 8, 9, 15, 16, 17, 24, 25])
def test_every_sample_is_there_whatever_the_count(monkeypatch, count) -> None:
    monkeypatch.setattr(datasets, "LONGEST", 8)
    found, _ = datasets.shielded(CUT[:count], BLADE)
    np.testing.assert_array_equal(found.times, CUT.times[:count])
    assert np.abs(found.body_velocities[:, 1]).max() < 1e-10


def test_what_keeps_the_constraint_stays() -> None:
    fair = planar_cut(count=61)
    found, held = datasets.shielded(fair, BLADE)
    assert held == ""
    np.testing.assert_allclose(found.positions, fair.positions, atol=1e-9)
    assert (found.rotations * fair.rotations.inv()).magnitude().max() < 1e-9
