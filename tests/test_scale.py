"""Recordings in odd units are asked after wherever they enter; what does not move is refused."""

from __future__ import annotations

import copy
import pickle
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.errors import InputError, RecordingError, RecordingWarning
from noslip.trajectory import PoseTrajectory
from refusals import refusal

VERBS: dict[str, Callable[[PoseTrajectory], object]] = {
    "learn": lambda motion: ns.learn(motion, basis_functions=10),
    "check": lambda motion: ns.check(motion, ns.Blade()),
    "segment": ns.segment,
    "prepare": ns.prepare,
}
VERBS_OF_MOTION = {name: verb for name, verb in VERBS.items() if name != "prepare"}


def moving(
    *, rate: float, seconds: float, length: float, turn: float = 1.0, begin: float = 0.0
) -> PoseTrajectory:
    """A straight motion that turns on its way; truly in seconds, meters and radians."""
    s = np.linspace(0, 1, round(rate * seconds) + 1)
    path = length * np.column_stack([s, 0 * s, 0 * s])
    turns = Rotation.from_rotvec(np.outer(turn * s, [0, 0, 1]))
    return PoseTrajectory(begin + seconds * s, path, turns, name="hand")


def scaled(motion: PoseTrajectory, times: float = 1.0, positions: float = 1.0) -> PoseTrajectory:
    """The same motion in other units."""
    return PoseTrajectory(
        motion.times * times, motion.positions * positions, motion.rotations, name=motion.name
    )


tools = st.builds(
    moving,
    rate=st.floats(15, 1000),
    seconds=st.floats(0.6, 60),
    length=st.floats(0.01, 0.6),
    turn=st.floats(0, 3),
)
"""What hands and robots do."""


@given(motion=tools, begin=st.sampled_from([0.0, -5.0, 1.7e9]))
def test_motions_of_tools_are_in_seconds_and_meters(motion: PoseTrajectory, begin: float) -> None:
    ns.prepare(PoseTrajectory(motion.times + begin, motion.positions, motion.rotations))


@given(motion=tools, units=st.sampled_from([1e3, 1e6, 1e9]))
def test_other_units_of_time_are_asked_after(motion: PoseTrajectory, units: float) -> None:
    with pytest.warns(RecordingWarning, match="hand: .* are its times in other units than seconds"):
        ns.prepare(scaled(motion, times=units))


@given(
    motion=st.builds(
        moving, rate=st.just(100.0), seconds=st.floats(1, 5), length=st.floats(0.05, 0.6)
    )
)
def test_millimeters_are_asked_after(motion: PoseTrajectory) -> None:
    with pytest.warns(RecordingWarning, match="are its positions in other units than meters"):
        ns.prepare(scaled(motion, positions=1e3))


@pytest.mark.parametrize("units", [1e3, 1e6, 1e9])
def test_stamps_since_1970_in_other_units_are_asked_after(units: float) -> None:
    motion = moving(rate=100, seconds=2, length=0.1, begin=1.7e9)
    with pytest.warns(RecordingWarning, match="stamps of 1.7e"):
        ns.prepare(scaled(motion, times=units))


def test_a_turn_rate_in_degrees_is_asked_after() -> None:
    with pytest.warns(RecordingWarning, match="turns at .* rad/s; are its angles"):
        ns.prepare(moving(rate=200, seconds=2, length=0.1, turn=90))


@pytest.mark.parametrize("name", VERBS)
def test_every_verb_that_takes_a_recording_asks_after_its_units_once(name: str) -> None:
    crawling = scaled(moving(rate=100, seconds=1, length=0.1), times=1e3)
    with pytest.warns(RecordingWarning) as told:
        VERBS[name](crawling)
        VERBS[name](crawling)
    assert len(told) == 1
    assert told[0].filename == __file__


def test_a_recording_is_asked_after_once_from_its_file_to_what_is_learned(tmp_path: Path) -> None:
    file = scaled(moving(rate=100, seconds=1, length=0.1), times=1e3).to_npz(tmp_path / "ms.npz")
    with pytest.warns(RecordingWarning) as told:
        [recording] = ns.load_demonstrations(file)
        prepared = ns.prepare(recording, relative=True)
        ns.check(prepared, ns.Blade())
        ns.learn(prepared, basis_functions=10)
    assert len(told) == 1
    assert prepared == recording == pickle.loads(pickle.dumps(recording)) == copy.copy(prepared)


@pytest.mark.filterwarnings("ignore:.*stands still:noslip.errors.RecordingWarning")
# Where samples have stamps, these go before the rate, and that is warned of.
@pytest.mark.filterwarnings("ignore:.*is not used:noslip.errors.RecordingWarning")
@pytest.mark.recordings
def test_real_recordings_are_in_seconds_and_meters(recordings: Path) -> None:
    read = 0
    for file in sorted(recordings.glob("*/*.csv")):
        try:
            read += len(ns.load_demonstrations(file, rate=14.5))
        except RecordingError:
            # One has two poses at one time.
            assert file.stem == "trolley_mid"
    assert read >= 40


@pytest.mark.recordings
def test_the_same_motion_in_milliseconds_is_no_silent_pass(recordings: Path) -> None:
    cases = recordings.parent / "cases"
    if not cases.is_dir():
        pytest.skip("the cases (../shared/cases, seen from the repository) are absent")
    [seconds] = ns.load_demonstrations(cases / "csv_same_in_seconds.csv")
    assert not ns.check(seconds, ns.Blade()).satisfied
    for name in ("csv_ms_false_pass.csv", "epoch_ms.csv", "tum_ns.tum"):
        unit = "ns" if name == "tum_ns.tum" else "ms"
        message = refusal(RecordingError, ns.load_demonstrations, cases / name)
        assert (
            f"other units than seconds?; say which, units='{unit}' (--time-unit {unit})" in message
        )
        [read] = ns.load_demonstrations(cases / name, units=unit)
        assert read.period == pytest.approx(0.01, rel=1e-3)


@pytest.mark.parametrize("name", VERBS_OF_MOTION)
def test_what_does_not_move_is_refused(name: str) -> None:
    still = PoseTrajectory(np.arange(20.0), np.ones((20, 3)), Rotation.identity(20), name="still")
    assert "still: does not move" in refusal(InputError, VERBS_OF_MOTION[name], still)


@pytest.mark.parametrize("name", VERBS_OF_MOTION)
@pytest.mark.parametrize("degrees", [121.0, 180.0, 200.0, 239.0])
def test_turns_that_may_have_gone_either_way_are_refused(name: str, degrees: float) -> None:
    motion = moving(rate=10, seconds=4, length=0.4, turn=np.radians(30) * 40)
    turns = motion.rotations.as_rotvec()
    turns = np.outer(np.radians(np.where(np.arange(41) < 20, 0, degrees)), [0, 0, 1])
    flipped = PoseTrajectory(
        motion.times, motion.positions, Rotation.from_rotvec(turns), name="flip"
    )
    message = refusal(InputError, VERBS_OF_MOTION[name], flipped)
    assert "flip: turns by" in message
    assert "from sample 19 to 20" in message


def test_a_single_sample_is_no_motion() -> None:
    message = refusal(InputError, PoseTrajectory, [0.0], np.zeros((1, 3)), Rotation.identity(1))
    assert "at least 2 samples, got 1" in message


@pytest.mark.parametrize("rate", [0.05, 0.3])
def test_planar_angles_that_jump_by_more_than_half_a_turn_are_refused(
    rate: float, tmp_path: Path
) -> None:
    """Degrees under the name of radians, of a robot that drives round in circles."""
    t = np.arange(0, 60, rate)
    theta = np.degrees(t / 2)
    rows = "\n".join(
        f"{a},{np.sin(b)},{1 - np.cos(b)},{c}" for a, b, c in zip(t, t / 2, theta, strict=True)
    )
    file = tmp_path / "robot.csv"
    file.write_text(f"t,x,y,theta_deg\n{rows}\n")
    ns.load_demonstrations(file)
    file.write_text(f"t,x,y,theta\n{rows}\n")
    if rate == 0.3:
        message = refusal(RecordingError, ns.load_demonstrations, file)
        assert "more than half a turn; are these degrees (name the column theta_deg)" in message
    else:
        with pytest.warns(RecordingWarning, match="are its angles in other units than radians"):
            ns.load_demonstrations(file)


def test_angles_wrapped_into_one_turn_may_jump(tmp_path: Path) -> None:
    t = np.arange(0, 60, 0.05)
    theta = (t / 2 + np.pi) % (2 * np.pi) - np.pi
    rows = "\n".join(f"{a},{a},0,{c}" for a, c in zip(t, theta, strict=True))
    (tmp_path / "robot.csv").write_text(f"t,x,y,theta\n{rows}\n")
    with warnings.catch_warnings(action="error"):
        [motion] = ns.load_demonstrations(tmp_path / "robot.csv")
    np.testing.assert_allclose(motion.angular_velocities[:, 2], 0.5, rtol=1e-6)
