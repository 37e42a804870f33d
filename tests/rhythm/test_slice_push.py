"""The slice-push ratio: measured of motions, and held."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.constraints import SlicePushRatio, slice_push_ratios
from noslip.errors import ConstraintError
from noslip.trajectory import PoseTrajectory


def _cut(slicing: float, pushing: float, turn: list[float]) -> PoseTrajectory:
    """Straight, at constant speeds along the edge (x) and into the material (-z)."""
    rotation = Rotation.from_rotvec(turn)
    times = np.linspace(0.0, 1.0, 11)
    way = rotation.apply([slicing, 0.0, -pushing])
    return PoseTrajectory(times, times[:, None] * way, Rotation.concatenate([rotation] * 11))


_TURNS = st.lists(st.floats(-1, 1), min_size=3, max_size=3)


@given(st.floats(-0.5, 0.5), st.floats(0.01, 0.5), _TURNS)
def test_it_is_speed_along_the_edge_over_speed_into_the_material(
    slicing: float, pushing: float, turn: list[float]
) -> None:
    found = slice_push_ratios(_cut(slicing, pushing, turn))
    np.testing.assert_allclose(found, abs(slicing) / pushing, rtol=1e-9, atol=1e-9)


@given(st.floats(-0.5, 0.5), st.floats(-0.5, 0), _TURNS)
def test_what_withdraws_or_rests_does_not_push(
    slicing: float, pushing: float, turn: list[float]
) -> None:
    away = min(pushing, -1e-6)
    assert np.isinf(slice_push_ratios(_cut(slicing, away, turn))).all()
    assert ns.check(_cut(slicing, away, turn), [SlicePushRatio(5.0)]).satisfied


@given(st.floats(0.02, 0.5), st.floats(0.2, 5), st.floats(0.2, 5), _TURNS)
def test_what_is_held_is_what_is_measured(
    slicing: float, has: float, asked: float, turn: list[float]
) -> None:
    cut = _cut(slicing, slicing / has, turn)
    kept = ns.check(cut, [SlicePushRatio(asked)]).satisfied
    # The kink is rounded to the safe side, by a millimeter a second.
    if kept:
        assert slice_push_ratios(cut).min() >= asked * (1 - 1e-9)
    elif has > asked:
        assert slicing - asked * slicing / has < 1e-3


def test_a_push_is_turned_into_a_slice() -> None:
    cut = _cut(0.05, 0.1, [0, 0, 0])
    limit = SlicePushRatio(1.0)
    dmp = ns.learn(cut, [limit], start="position", end="free")
    motion = dmp.rollout()
    assert ns.check(motion, [limit]).satisfied
    assert slice_push_ratios(motion).min() >= 1 - 1e-6


def test_axes_must_differ() -> None:
    with pytest.raises(ConstraintError, match="into and edge"):
        SlicePushRatio(edge="x", into="-x")
