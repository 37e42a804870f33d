"""Outliers: found where there is one, and not where there is none."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.demonstrations.excision import OUTLIER, TOOL_FRAME, synthetic_excisions
from noslip.demonstrations.outliers import outliers
from noslip.demonstrations.preparation import prepare
from noslip.errors import InputError


def excisions(seed):
    return [
        prepare(x, tool_frame=TOOL_FRAME, trim_speed=0.003, lowpass=True)
        for x in synthetic_excisions(seed=seed)
    ]


@pytest.mark.parametrize("seed", range(12))
def test_the_excision_that_is_held_otherwise_is_the_outlier(seed):
    cuts = excisions(seed)
    judged = outliers(cuts)
    assert list(np.flatnonzero(judged.outlying)) == [OUTLIER]
    assert "turned by" in judged.reason(OUTLIER)
    assert "mm away" not in judged.reason(OUTLIER)
    assert judged.reason(0).startswith("within")
    without = [cut for i, cut in enumerate(cuts) if i != OUTLIER]
    assert not outliers(without).outlying.any()


def bow(height, *, duration=2.0, offset=(0, 0, 0), roll=0.0, samples=80):
    s = np.linspace(0, 1, samples)
    path = np.column_stack([0.1 * s, height * np.sin(np.pi * s), 0 * s]) + offset
    return ns.PoseTrajectory(duration * s, path, Rotation.from_euler("x", roll * np.ones(samples)))


@given(
    heights=st.lists(st.floats(0.018, 0.022), min_size=4, max_size=8),
    far=st.floats(0.06, 0.2),
    durations=st.floats(1, 5),
)
def test_a_path_far_from_the_others_is_found_wherever_and_however_fast_it_runs(
    heights, far, durations
):
    cuts = [
        bow(h, offset=(i, 0, 0), duration=durations + i, samples=60 + i)
        for i, h in enumerate(heights)
    ]
    judged = outliers([*cuts, bow(far, offset=(0, 9, 0))])
    assert judged.outlying[-1]
    assert "mm away" in judged.reason(len(cuts))


def test_distances_are_rms_over_the_motion():
    # sin has the rms 1 / sqrt(2) over half a period.
    judged = outliers([bow(0.0), bow(0.0), bow(0.0), bow(0.02, roll=0.3)])
    np.testing.assert_allclose(judged.position_distances[-1], 0.02 / np.sqrt(2), rtol=0.01)
    np.testing.assert_allclose(judged.rotation_distances[-1], 0.3, rtol=1e-9)
    assert list(judged.outlying) == [False, False, False, True]


def test_copies_are_no_outliers():
    assert not outliers([bow(0.02, offset=(0.1 * i, 0, 0)) for i in range(5)]).outlying.any()


def test_three_cannot_be_judged():
    with pytest.raises(InputError, match="4 demonstrations or more, got 3"):
        outliers([bow(0.02)] * 3)
    with pytest.raises(InputError, match="got int"):
        outliers([1, 2, 3, 4])
    with pytest.raises(InputError, match="threshold must be positive"):
        outliers([bow(0.02)] * 4, threshold=0)
