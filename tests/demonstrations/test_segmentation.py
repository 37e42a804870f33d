"""Cutting long recordings: the true cuts come back, and everything cut out has a reason."""

from __future__ import annotations

import re
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from sessions import excision_session

import noslip as ns
from motions import eased
from noslip.demonstrations.excision import TOOL_FRAME
from noslip.demonstrations.preparation import prepare
from noslip.demonstrations.segmentation import segment
from noslip.errors import InputError
from refusals import refusal

LATE, UNSEEN = 0.6, 1e-3
"""Seconds by which an end may be found late, and meters that the blade may move unseen there."""


def blade_of(seed, noise=1.0):
    session, true = excision_session(seed, noise)
    return prepare(session, tool_frame=TOOL_FRAME), true


def kept(segments):
    return np.array([[i.start, i.end] for i in segments.intervals if i.reason is None])


def strokes(*, moves, rests, rate=50.0, length=0.1, noise=0.0, seed=0, start=3.0):
    """Strokes to and fro along x, each followed by a rest; and when they move."""
    rng = np.random.default_rng(seed)
    x, true, at = [np.zeros(int(rests[0] * rate))], [], 0.0
    for duration, rest in zip(moves, rests[1:], strict=True):
        u = np.arange(1, round(duration * rate) + 1) / round(duration * rate)
        begin = sum(map(len, x)) - 1
        to = length - at
        x += [at + (to - at) * eased(u), np.full(int(rest * rate), to)]
        true.append((start + begin / rate, start + (begin + len(u)) / rate))
        at = to
    x = np.concatenate(x)
    positions = np.outer(x, [1, 0, 0]) + noise * rng.standard_normal((len(x), 3))
    times = start + np.arange(len(x)) / rate
    recording = ns.PoseTrajectory(times, positions, Rotation.identity(len(x)), name="strokes")
    return recording, np.array(true)


# ---------------------------------------------------------------- at rests


@settings(max_examples=10)
@given(seed=st.integers(0, 10_000))
def test_the_eight_excisions_of_one_recording_come_back(seed):
    blade, true = blade_of(seed)
    segments = segment(blade)
    found = kept(segments)
    assert len(segments.pieces) == 8
    late = (found - true) * [1, -1]
    assert late.min() > -0.1
    assert late.max() < LATE
    clean = prepare(blade, lowpass=True)
    for (start, end), (begin, finish) in zip(true, found, strict=True):
        for a, b in ((start, begin), (end, finish)):
            at = [np.interp([a, b], clean.times, axis) for axis in clean.positions.T]
            assert np.linalg.norm(np.diff(at)) < UNSEEN


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("noise", [3.0, 6.0])
def test_they_come_back_from_much_more_noise(seed, noise):
    blade, true = blade_of(seed, noise)
    found = kept(segment(blade))
    assert found.shape == true.shape
    assert np.abs(found - true).max() < 1.4
    # A low-pass filter over the whole recording first finds the ends better.
    filtered = kept(segment(prepare(blade, lowpass=True)))
    assert np.abs(filtered - true).max() < np.abs(found - true).max()


@settings(max_examples=25)
@given(
    moves=st.lists(st.floats(1.5, 3.0), min_size=1, max_size=6),
    rest=st.floats(0.7, 3.0),
    noise=st.sampled_from([0.0, 2e-5, 2e-4]),
    rate=st.sampled_from([30.0, 50.0, 120.0]),
    seed=st.integers(0, 1000),
)
def test_strokes_between_rests_are_found(moves, rest, noise, rate, seed):
    recording, true = strokes(
        moves=moves, rests=[rest] * (len(moves) + 1), noise=noise, rate=rate, seed=seed
    )
    segments = segment(recording)
    assert kept(segments).shape == true.shape
    assert np.abs(kept(segments) - true).max() < 0.4


def test_the_intervals_cover_the_recording_and_the_pieces_are_its_samples():
    recording, _ = strokes(moves=[2, 0.6, 2], rests=[1, 1, 1, 1], noise=2e-5)
    segments = segment(recording)
    intervals = segments.intervals
    assert intervals[0].start == recording.times[0]
    assert intervals[-1].end == recording.times[-1]
    assert all(a.end == b.start for a, b in pairwise(intervals))
    reasons = [i.reason for i in intervals]
    assert [reason for reason in reasons if reason != "rest"][::2] == [None, None]
    assert reasons[3].startswith("lasts 0.")
    for (start, end), piece in zip(kept(segments), segments.pieces, strict=True):
        inside = (recording.times >= start) & (recording.times <= end)
        np.testing.assert_array_equal(piece.times, recording.times[inside])
        np.testing.assert_array_equal(piece.positions, recording.positions[inside])
    assert [p.name for p in segments.pieces] == ["strokes, piece 1", "strokes, piece 2"]


def test_a_minimum_duration_of_zero_keeps_short_strokes_too():
    recording, true = strokes(moves=[2, 0.6, 2], rests=[1, 1, 1, 1], noise=2e-5)
    found = kept(segment(recording, minimum_duration=0))
    assert found.shape == true.shape


def test_a_short_halt_belongs_to_its_piece():
    recording, true = strokes(moves=[2, 2], rests=[1, 0.5, 1])
    joined = kept(segment(recording, minimum_rest=1.0))
    assert joined.shape == (1, 2)
    assert np.abs(joined - [true[0, 0], true[1, 1]]).max() < 0.4


def test_a_stutter_that_never_reaches_the_upper_threshold_is_rest():
    recording, true = strokes(moves=[2, 2], rests=[1, 2, 1])
    (low, high) = segment(recording).thresholds
    t, positions = recording.times, recording.positions.copy()
    middle = true[:, 0].mean() + 1
    creep = 0.5 * (low + high) * 0.3
    positions[:, 1] += creep * np.clip((t - middle) / 0.3 + 0.5, 0, 1)
    moved = ns.PoseTrajectory(t, positions, recording.rotations)
    segments = segment(moved, thresholds=(high, low))
    assert segments.thresholds == (low, high)
    assert len(segments.pieces) == 2
    inside = np.abs(t - middle) < 0.05
    assert segments.signal[inside].min() > low
    assert kept(segments).shape == (2, 2)
    assert not any(i.reason not in (None, "rest") for i in segments.intervals)


def test_without_a_rest_the_recording_is_one_piece():
    t = np.linspace(0, 5, 300)
    circle = 0.1 * np.column_stack([np.cos(t), np.sin(t), 0 * t])
    recording = ns.PoseTrajectory(t, circle, Rotation.identity(len(t)))
    segments = segment(recording)
    assert segments.thresholds is None
    assert len(segments.pieces) == 1
    np.testing.assert_array_equal(segments.pieces[0].times, t)


# ---------------------------------------------------------------- by contact, and at given times


@settings(max_examples=10)
@given(seed=st.integers(0, 1000), noise=st.floats(0, 0.1), upside_down=st.booleans())
def test_contact_is_found_where_a_noisy_force_acts(seed, noise, upside_down):
    rng = np.random.default_rng(seed)
    recording, true = strokes(moves=[2, 1.5, 3], rests=[1, 1, 1, 1])
    t = recording.times
    pressed = ((t[:, None] >= true[:, 0]) & (t[:, None] <= true[:, 1])).any(axis=1)
    force = 2.0 + 5.0 * pressed + noise * 5 * rng.standard_normal(len(t))
    force, side = (-force, "below") if upside_down else (force, "above")
    segments = segment(recording, contact=force, in_contact=side, thresholds=None)
    found = kept(segments)
    assert found.shape == true.shape
    # One sample, as the force is a step; two where the noise makes it cross earlier.
    assert np.abs(found - true).max() <= 2.5 * recording.period
    assert {i.reason for i in segments.intervals} == {None, "no contact"}


@pytest.mark.parametrize("seed", range(3))
def test_excisions_are_parted_by_the_height_of_the_blade(seed):
    blade, true = blade_of(seed)
    height = blade.positions[:, 2] - 0.06
    found = kept(segment(blade, contact=height, in_contact="below", thresholds=(0.008, 0.010)))
    # The blade rests on the phantom before and after it cuts.
    assert found.shape == true.shape
    assert np.all(found[:, 0] <= true[:, 0])
    assert np.all(found[:, 1] >= true[:, 1])


def test_given_times_are_taken_as_given():
    recording, _ = strokes(moves=[2, 2], rests=[1, 1, 1])
    segments = segment(recording, times=[(6, 7.5), (None, 5)])
    np.testing.assert_allclose(kept(segments), [[3.0, 5.0], [6.0, 7.5]], atol=1e-9)
    assert [i.reason for i in segments.intervals] == [None, "not asked for"] * 2
    assert segments.signal is None


def test_pieces_left_out_afterwards_keep_their_reason():
    recording, _ = strokes(moves=[2, 2, 2], rests=[1, 1, 1, 1])
    segments = segment(recording)
    fewer = segments.without({1: "too good"})
    assert [p.name for p in fewer.pieces] == ["strokes, piece 1", "strokes, piece 2"]
    np.testing.assert_array_equal(fewer.pieces[1].times, segments.pieces[2].times)
    assert [i.reason for i in fewer.intervals][1::2] == [None, "too good", None]
    with pytest.raises(InputError, match="no piece 2"):
        fewer.without({2: "gone"})


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"contact": [1.0, 2.0]}, r"contact has shape \(2,\)"),
        ({"contact": np.full(400, np.nan)}, r"contact\[0\] is not finite"),
        ({"contact": np.ones(400)}, "contact is 1 throughout"),
        ({"in_contact": "beside"}, "in_contact must be"),
        ({"times": []}, "holds no piece"),
        ({"times": [(3, 6), (5, 8)]}, "times overlap"),
        ({"times": [(90, 95)]}, "leaves 0 samples"),
        ({"times": [(3, 6)], "thresholds": (1, 2)}, "says nothing about given times"),
        ({"thresholds": (0, 1)}, "must be positive"),
        ({"thresholds": (1, np.nan)}, "two finite numbers"),
        ({"thresholds": (5, 6)}, "nothing lies above the thresholds 5 and 6"),
        ({"minimum_duration": 60}, "no piece is left, the longest lasts"),
        ({"minimum_rest": -1}, "minimum_rest must be"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(arguments, message):
    recording, _ = strokes(moves=[2, 2], rests=[1, 2, 1])
    assert len(recording) == 400
    found = refusal(InputError, segment, recording, **arguments)
    assert re.search(message, found) and "strokes" in found


def test_a_recording_at_rest_holds_no_demonstration():
    t = np.linspace(0, 5, 100)
    still = ns.PoseTrajectory(t, np.zeros((100, 3)), Rotation.identity(100))
    with pytest.raises(InputError, match="does not move"):
        segment(still)


# ---------------------------------------------------------------- real recordings


@pytest.mark.recordings
def test_a_robot_that_drives_squares_comes_back_as_four_sides(recordings):
    files = sorted((recordings / "wheeled_robots").glob("diff_square*.csv"))
    assert len(files) == 6
    for recording in ns.load_demonstrations(files):
        segments = segment(recording)
        assert len(segments.pieces) == 4
        headings = []
        for piece in segments.pieces:
            chord = piece.positions[-1] - piece.positions[0]
            assert 0.7 < np.linalg.norm(chord) < 0.8
            assert piece.path_length < 1.1 * np.linalg.norm(chord)
            headings.append(np.arctan2(chord[1], chord[0]))
        turns = np.degrees(np.diff(np.unwrap(headings)))
        assert np.abs(np.abs(turns) - 90).max() < 6


@pytest.mark.recordings
def test_the_contour_runs_are_one_motion_each(recordings):
    for recording in ns.load_demonstrations(recordings / "contour_following" / "data_demo_*.csv"):
        (piece,) = segment(recording).pieces
        assert piece.path_length > 0.9 * recording.path_length
