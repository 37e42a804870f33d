"""Vectors and channels as values: they keep what they are given, in memory and in files."""

from __future__ import annotations

import pickle
from dataclasses import FrozenInstanceError
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.errors import InputError
from noslip.series import Series
from refusals import refusal

NAMES = st.text(
    st.characters(whitelist_categories=("Ll", "Lu", "Nd"), whitelist_characters="_.-/ "),
    min_size=1,
    max_size=12,
).map(lambda text: f"q{text.strip()}")
"""None of them is a unit of time, which would be read as a clock."""
UNITS = st.sampled_from(["1", "N", "N m", "N/m", "rad", "m/s", "A"])


@st.composite
def trajectories(draw: st.DrawFn) -> ns.Trajectory:
    """Any vectors on an irregular grid that starts anywhere."""
    count, size = draw(st.integers(8, 20)), draw(st.integers(1, 5))
    periods = draw(arrays(np.float64, count - 1, elements=st.floats(0.02, 0.05)))
    names = draw(st.lists(NAMES, min_size=size, max_size=size, unique_by=str.lower))
    return ns.Trajectory(
        draw(st.sampled_from([0.0, -3.7, 1.7e9])) + np.concatenate([[0.0], np.cumsum(periods)]),
        draw(arrays(np.float64, (count, size), elements=st.floats(-1e6, 1e6))),
        names=names,
        units=draw(st.lists(UNITS, min_size=size, max_size=size)),
        name="drawn",
    )


@settings(max_examples=12)
@given(trajectories())
@example(ns.Trajectory(np.arange(8) / 10, np.eye(8)[:, :3], names=["i", "end_t", "Q"]))
def test_files_give_back_every_number_name_and_unit(
    tmp_path_factory: pytest.TempPathFactory, drawn: ns.Trajectory
) -> None:
    folder = tmp_path_factory.mktemp("files")
    for written, read in (
        (drawn.to_csv(folder / "a.csv"), ns.Trajectory.from_csv),
        (drawn.to_npz(folder / "a.npz"), ns.Trajectory.from_npz),
        (drawn.to_csv(folder / "b.csv"), ns.load_trajectory),
    ):
        found = read(written)
        np.testing.assert_array_equal(found.times, drawn.times)
        np.testing.assert_array_equal(found.values, drawn.values)
        assert (found.names, found.units) == (drawn.names, drawn.units)


@settings(max_examples=25)
@given(trajectories(), st.floats(0, 1), st.floats(0, 1))
def test_slices_and_resampling_are_those_of_the_numbers(drawn, one, other) -> None:
    first = drawn[2:7]
    np.testing.assert_array_equal(first.values, drawn.values[2:7])
    assert (first.names, first.units) == (drawn.names, drawn.units)
    times = np.linspace(drawn.times[0], drawn.times[-1], 7)
    spline = CubicSpline(drawn.times, drawn.values)
    scale = np.abs(drawn.values).max() + 1e-300
    resampled = drawn.resampled(times=times)
    assert np.abs(resampled.values - spline(times)).max() <= 1e-9 * scale
    rates = spline(times, 1)
    assert np.abs(resampled.velocities - rates).max() <= 1e-9 * (np.abs(rates).max() + scale)
    # Along straight lines nothing leaves the range of what is recorded.
    some = drawn.times[0] + drawn.duration * np.array(sorted({0.0, one, other, 1.0}))
    if len(some) > 1 and np.diff(some).min() > 1e-6:
        between = drawn.between(some).values
        assert np.all(between >= drawn.values.min(axis=0) - 1e-9 * scale)
        assert np.all(between <= drawn.values.max(axis=0) + 1e-9 * scale)


def test_they_are_values() -> None:
    t, values = np.arange(9.0) / 10, np.arange(18.0).reshape(9, 2) ** 2
    one = ns.Trajectory(t, values, names=["a", "b"], units=("N", "1"))
    assert pickle.loads(pickle.dumps(one)) == one
    assert one != ns.Trajectory(t, values, names=["a", "b"], units=("N", "m"))
    with pytest.raises(FrozenInstanceError):
        one.values = values
    with pytest.raises(ValueError, match="read-only"):
        one.values[0] = 1
    values[0] = 7
    assert one.values[0, 0] == 0
    np.testing.assert_array_equal(one.column("b"), one.values[:, 1])
    assert "2 values" in repr(one)
    assert "b (1)" in one._repr_html_()
    # The mean of the squares' two differences is their slope in the middle.
    np.testing.assert_allclose(one.velocities[1:-1, 0], 8 * 10 * np.arange(1, 8))


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"names": ["a", "A"]}, "names must differ"),
        ({"names": ["a", "time"]}, "none be that of the time"),
        ({"names": ["a", "Stamp"]}, "none be that of the time"),
        ({"names": ["a", "b,c"]}, "without commas"),
        ({"names": ["a"]}, "names must be 2 texts"),
        ({"units": "mm"}, "units must be 2 texts"),
        ({"values": [[1.0, np.nan]] * 9}, "values[0] is not finite"),
        ({"values": [1.0] * 9}, "a row a sample"),
        ({"values": np.zeros((5, 9, 2))}, "of several recordings make a list of trajectories"),
        ({"times": np.zeros(9)}, "times must increase"),
    ],
)
def test_what_is_none_is_refused(change, told) -> None:
    usual = {"times": np.arange(9.0), "values": np.zeros((9, 2)), "names": ["a", "b"]}
    assert told in refusal(InputError, lambda: ns.Trajectory(**(usual | change)))


def test_a_path_without_a_unit_is_told_without_one() -> None:
    numbers = ns.Trajectory(np.arange(9.0), np.arange(9.0)[:, None])
    assert repr(numbers) == "Trajectory('trajectory', 9 samples of 1 value, 8 s, path 8)"
    meters = ns.Trajectory(np.arange(9.0), np.arange(9.0)[:, None], units=["m"])
    assert repr(meters).endswith("path 8 m)")


def test_a_rule_of_a_tool_asks_who_carries_it() -> None:
    angles = np.column_stack([np.arange(9.0), np.arange(9.0)])
    joints = ns.Trajectory(np.arange(9.0), angles, names=["a", "b"])
    told = refusal(ns.errors.ConstraintError, lambda: ns.check(joints, ns.Blade()))
    assert "constraint 'blade': a, b carry no tool; of joints name the robot, robot=..." in told


def with_channels(count: int = 40) -> ns.PoseTrajectory:
    rng, t = np.random.default_rng(3), np.arange(count) / 50
    beside = ns.Trajectory(
        t,
        np.column_stack([rng.normal(size=(count, 2)), t > t.mean()]),
        names=("fx", "Stiffness", "gripper"),
        units=("N", "N/m", "1"),
    )
    turns = Rotation.from_rotvec(np.cumsum(rng.normal(size=(count, 3)), axis=0) / 50)
    path = np.cumsum(rng.normal(size=(count, 3)), axis=0) / 1000
    return ns.PoseTrajectory(t, path, turns, name="pose", channels=beside)


def test_channels_go_with_their_poses() -> None:
    pose = with_channels()
    assert pose[5:20].channels == pose.channels[5:20]
    assert pickle.loads(pickle.dumps(pose)) == pose
    resampled = pose.resampled(rate=333)
    np.testing.assert_array_equal(resampled.channels.times, resampled.times)
    lines = [np.interp(resampled.times, pose.times, c) for c in pose.channels.values.T]
    np.testing.assert_allclose(resampled.channels.values, np.column_stack(lines), atol=1e-15)
    assert pose.with_channels(None).channels is None
    moved = ns.prepare(pose, tool_frame=[0, 0, 0.1], lowpass=5.0, relative=True)
    assert moved.channels == pose.channels
    slower = pose.channels.resampled(rate=20)
    for told, other in (
        ("channels.between(poses.times)", slower),
        ("channels must be a Trajectory", pose),
    ):
        assert told in refusal(InputError, pose.with_channels, other)
    named = ns.Trajectory(pose.times, np.zeros((len(pose), 1)), names=["qw"])
    assert "qw, as the pose is" in refusal(InputError, lambda: pose.with_channels(named))


def test_channels_are_written_and_read_beside_poses(tmp_path: Path) -> None:
    pose = with_channels()
    archive = ns.PoseTrajectory.from_npz(pose.to_npz(tmp_path / "a.npz"))
    table = ns.PoseTrajectory.from_csv(
        pose.to_csv(tmp_path / "a.csv"), channels="Stiffness,gripper"
    )
    for found, columns in ((archive, [0, 1, 2]), (table, [1, 2])):
        np.testing.assert_array_equal(found.positions, pose.positions)
        assert type(found.channels) is Series
        np.testing.assert_array_equal(found.channels.values, pose.channels.values[:, columns])
        for what in ("names", "units"):
            own = getattr(pose.channels, what)
            assert getattr(found.channels, what) == tuple(own[k] for k in columns)
    assert ns.load_demonstrations(tmp_path / "a.csv")[0].channels is None


def test_vectors_are_prepared_as_poses_are() -> None:
    """Against the positions of poses that go the same way."""
    rng = np.random.default_rng(5)
    t, path = np.arange(200) / 100, np.cumsum(rng.normal(size=(200, 3)), axis=0) / 1000
    still = Rotation.identity(len(t))
    steps = {"trim_time": (0.3, 1.7), "rate": 60.0, "lowpass": 5.0, "relative": True}
    vectors = ns.prepare(ns.Trajectory(t, path, names=["x", "y", "z"]), **steps)
    poses = ns.prepare(ns.PoseTrajectory(t, path, still), **steps)
    np.testing.assert_allclose(vectors.values, poses.positions, atol=1e-15)
    np.testing.assert_array_equal(vectors.times, poses.times)
    assert vectors.names == ("x", "y", "z")
    assert "no tool_frame" in refusal(
        InputError, ns.prepare, ns.Trajectory(t, path), tool_frame=[0, 0, 1]
    )


def test_each_kind_of_file_names_the_other_s_reader(tmp_path: Path) -> None:
    pose = with_channels()
    vectors = ns.Trajectory(pose.times, pose.positions)
    poses, values = pose.to_npz(tmp_path / "p.npz"), vectors.to_npz(tmp_path / "v.npz")
    assert "load_trajectory" in refusal(InputError, lambda: ns.PoseTrajectory.from_npz(values))
    assert "array values missing" in refusal(InputError, lambda: ns.Trajectory.from_npz(poses))
    np.savez(tmp_path / "w.npz", times=pose.times, values=pose.positions, names=np.array(["a"]))
    with pytest.raises(InputError, match="holds 1 texts, expected 3"):
        ns.load_trajectory(tmp_path / "w.npz")
