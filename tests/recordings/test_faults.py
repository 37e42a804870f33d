"""Faults of a recording: refused, with an option that then goes on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip import PoseTrajectory
from noslip._pose_checks import Source
from noslip._samples import Mending, Samples
from noslip.errors import InputError, RecordingError, RecordingWarning

COUNT = 60


def samples(count: int = COUNT) -> Samples:
    """A motion along a line, turning about a fixed axis: interpolation is exact."""
    t = 0.01 * np.arange(count)
    turns = Rotation.from_rotvec(np.outer(t, [0.3, -0.2, 0.9]))
    return Samples(
        name="run",
        source=Source("run", "times", "quaternions"),
        times=t,
        positions=np.outer(t, [0.1, 0.2, -0.05]) + [0.3, 0.1, 0.2],
        quaternions=turns.as_quat(scalar_first=True),
    )


def without(of: Samples, gone: list[int]) -> Samples:
    return of[np.setdiff1d(np.arange(len(of)), gone)]


def mended(of: Samples, **asked: object) -> list[PoseTrajectory]:
    with pytest.warns(RecordingWarning):
        return [PoseTrajectory(**each.checked()) for each in of.mended(Mending(**asked))]


def same(found: PoseTrajectory, of: Samples, tolerance: float = 1e-12) -> None:
    np.testing.assert_allclose(found.times, of.times, rtol=0, atol=tolerance)
    np.testing.assert_allclose(found.positions, of.positions, rtol=0, atol=tolerance)
    turned = found.rotations * Rotation.from_quat(of.quaternions, scalar_first=True).inv()
    np.testing.assert_allclose(turned.magnitude(), 0, atol=1e-7)


def refused(of: Samples, **asked: object) -> str:
    with pytest.raises(RecordingError) as caught:
        [each.checked() for each in of.mended(Mending(**asked))]
    return str(caught.value)


HOLES = st.tuples(st.integers(8, 30), st.integers(11, 20))


@given(hole=HOLES)
@settings(max_examples=20)
def test_a_gap_is_split_or_filled_on_the_line_and_the_shortest_turn(hole) -> None:
    begin, width = hole
    faulty = without(samples(), list(range(begin, begin + width)))
    assert "gaps='split' or 'interpolate' (--gaps) goes on" in refused(faulty)
    (filled,) = mended(faulty, gaps="interpolate")
    same(filled, samples())
    first, second = mended(faulty, gaps="split")
    same(first, samples()[np.arange(begin)])
    same(second, samples()[np.arange(begin + width, COUNT)])


@given(at=st.integers(0, COUNT - 2))
@settings(max_examples=20)
def test_of_two_poses_at_one_time_the_first_or_the_last_is_kept(at) -> None:
    good = samples()
    double = good[np.sort(np.append(np.arange(COUNT), at))]
    double.positions[at] += 1.0
    assert "duplicates='first' or 'last' (--duplicates) keeps one" in refused(double)
    (last,) = mended(double, duplicates="last")
    same(last, good)
    (first,) = mended(double, duplicates="first")
    np.testing.assert_array_equal(first.positions[at], double.positions[at])
    assert len(first) == COUNT


@given(shuffled=st.permutations(range(COUNT)))
@settings(max_examples=20)
def test_samples_out_of_order_are_sorted(shuffled) -> None:
    mixed = samples()[np.array(shuffled)]
    if list(shuffled) != sorted(shuffled):
        assert "unsorted='sort' or 'split' (--unsorted) goes on" in refused(mixed)
        (found,) = mended(mixed, unsorted="sort")
        same(found, samples())


def test_a_clock_that_starts_again_makes_two_recordings() -> None:
    twice = samples()[np.concatenate([np.arange(20, COUNT), np.arange(20)])]
    first, second = mended(twice, unsorted="split")
    same(first, samples()[np.arange(20, COUNT)])
    same(second, samples()[np.arange(20)])


@given(gone=st.sets(st.integers(0, COUNT - 1), min_size=1, max_size=8), data=st.data())
@settings(max_examples=30)
def test_samples_without_a_pose_are_left_out(gone, data) -> None:
    faulty = samples()[np.arange(COUNT)]
    for k in gone:
        kind = data.draw(st.sampled_from(["nan", "zero", "inf"]))
        if kind == "zero":
            faulty.quaternions[k] = 0.0
        else:
            faulty.positions[k, data.draw(st.integers(0, 2))] = float(kind)
    assert "lost='drop' (--lost drop) leaves such samples out" in refused(faulty)
    (found,) = mended(faulty, lost="drop")
    same(found, without(samples(), list(gone)))


@pytest.mark.parametrize("width", [3, 5, 12])
def test_a_pose_that_is_held_and_then_jumps_was_lost(width) -> None:
    held = samples()[np.arange(COUNT)]
    for values in (held.positions, held.quaternions):
        values[21 : 20 + width] = values[20]
    with pytest.warns(RecordingWarning, match="left out, without a pose") as told:
        (kept,) = held.mended(Mending(lost="drop"))
    assert str(told[0].message).startswith(f"run: {width - 1} of 60 samples")
    np.testing.assert_array_equal(kept.times, without(samples(), list(range(21, 20 + width))).times)
    if width > 10:  # a gap in disguise
        with pytest.warns(RecordingWarning, match=r"stands still .* at sample 21; was the tool"):
            held.mended(Mending())


def test_rest_and_a_slower_stream_are_not_lost() -> None:
    rest = samples()[np.repeat([0, *range(COUNT), COUNT - 1], [30, *[1] * COUNT, 30])]
    slow = samples()[np.repeat(np.arange(COUNT), 10)]
    for still in (rest, slow):
        timed = Samples(
            name="run",
            source=Source("run", "t", "q"),
            times=0.01 * np.arange(len(still)),
            positions=still.positions,
            quaternions=still.quaternions,
        )
        (kept,) = timed.mended(Mending(lost="drop"))
        assert len(kept) == len(still)


@given(
    fault=st.sampled_from(["nan", "zero", "gap", "twice", "back"]),
    at=st.integers(1, 15),
    end=st.sampled_from([None, 0.4]),
)
@settings(max_examples=40)
def test_faults_outside_of_what_matters_do_not(fault, at, end) -> None:
    good = samples()
    bad = good[np.arange(COUNT)]
    match fault:
        case "nan":
            bad.positions[at] = np.nan
        case "zero":
            bad.quaternions[at] = 0.0
        case "gap":
            bad.times[:at] -= 1.0
        case "twice":
            bad.times[at - 1] = bad.times[at]
        case "back":
            bad.times[at] = bad.times[at - 1] - 0.005
    refused(bad)
    (piece,) = bad.mended(Mending(within=(0.2, end)))
    found = PoseTrajectory(**piece.checked())
    # All that is whole is kept, for the filter.
    first = {"nan": at + 1, "zero": at + 1}.get(fault, at)
    if fault != "back":  # a time is wrong, which nothing tells
        same(found, good[np.arange(first, COUNT)])
    assert found.times[0] <= 0.2 and found.times[-1] == good.times[-1]
    bad.positions[30] = np.inf
    assert "sample 30" in refused(bad, within=(0.2, end))


def test_what_is_left_out_is_said_and_counted(tmp_path: Path, noslip) -> None:
    rows = [f"{0.01 * k:.2f},{0.001 * k},0,0,1,0,0,0" for k in range(COUNT)]
    rows[5] = "0.05,nan,0,0,1,0,0,0"
    rows[40:52] = []
    file = tmp_path / "run.csv"
    file.write_text("\n".join(["t,x,y,z,qw,qx,qy,qz", *rows]))
    asked = ["--lost", "drop", "--gaps", "interpolate"]
    told = noslip("convert", file, "--out", tmp_path / "out.csv", *asked)
    assert told.code == 0
    assert "1 of 48 samples left out, without a pose (lost=drop)" in told.err
    assert "12 samples filled in across 1 gaps, the first 0.39 to 0.52 s" in told.err
    (found,) = ns.load_demonstrations(tmp_path / "out.csv")
    assert len(found) == COUNT - 1


def test_a_choice_that_there_is_not() -> None:
    with pytest.raises(InputError, match="gaps is one of refuse, split, interpolate; got 'fill'"):
        Mending(gaps="fill")


def test_pieces_too_short_and_times_that_are_not_there() -> None:
    few = without(samples(30), list(range(7, 22)))
    assert "none of its 2 pieces has 8 samples" in refused(
        without(few, list(range(10, 15))), gaps="split"
    )
    assert "no samples from 5 to inf s; they go from 0 to 0.59 s" in refused(
        samples(), within=(5, None)
    )
