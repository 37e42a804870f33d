"""Motions written for robots that take velocities, and planar ones."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.errors import CompromiseWarning, InputError
from noslip.recordings import load_demonstrations, write_recording
from noslip.recordings.twists import motion_columns

COUNT = 200


def drive(speed: np.ndarray, turning: np.ndarray, step: float) -> ns.PoseTrajectory:
    """What a unicycle does that holds each speed and turn rate for one step: exact arcs."""
    theta = np.concatenate([[0.0], np.cumsum(turning * step)])
    half = turning * step / 2
    chord = speed * step * np.sinc(half / np.pi)
    way = np.column_stack([chord * np.cos(theta[:-1] + half), chord * np.sin(theta[:-1] + half)])
    path = np.vstack([[0.0, 0.0], np.cumsum(way, axis=0)])
    return ns.PoseTrajectory(
        step * np.arange(len(theta)),
        np.column_stack([path, np.zeros(len(theta))]),
        Rotation.from_euler("z", theta),
        name="drive",
    )


@given(
    seed=st.integers(0, 2**16),
    step=st.sampled_from([0.001, 0.05, 0.5]),
    track=st.floats(0.05, 1.0),
    radius=st.floats(0.01, 0.3),
)
@settings(max_examples=30)
def test_a_drive_is_told_the_speeds_that_it_had(seed, step, track, radius) -> None:
    rng = np.random.default_rng(seed)
    speed, turning = rng.uniform(-0.5, 1.0, COUNT), rng.uniform(-2, 2, COUNT)
    of = motion_columns(drive(speed, turning, step), wheels={"track": track, "radius": radius})
    np.testing.assert_allclose(of["v"][:-1], speed, atol=1e-9)
    np.testing.assert_allclose(of["omega"][:-1], turning, atol=1e-9)
    np.testing.assert_allclose(radius * (of["left"] + of["right"]) / 2, of["v"], atol=1e-12)
    np.testing.assert_allclose(radius * (of["right"] - of["left"]), track * of["omega"], atol=1e-12)
    # A robot goes on with the last command.
    assert [of[name][-1] for name in ("v", "omega", "left", "right")] == [0, 0, 0, 0]


@pytest.fixture(scope="module")
def cut() -> ns.Motion:
    s = np.linspace(0, 1, 201)
    path = np.column_stack([0.1 * s, 0.02 * np.sin(3 * s), 0.01 * s**2])
    turns = Rotation.from_euler("zyx", np.column_stack([s, 0.3 * s, 0.2 * s**2]))
    return ns.learn(ns.PoseTrajectory(2 * s, path, turns), ns.Blade()).rollout()


def test_a_blades_body_twist_has_nothing_sideways(cut) -> None:
    twist = cut.body_velocities
    assert twist.shape == (len(cut) - 1, 6)
    assert np.abs(twist[:, 1]).max() < 1e-12
    assert np.abs(twist[:, 0]).max() > 0.01


@pytest.mark.parametrize("kind", ["body", "world"])
@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".feather"])
def test_twists_lead_from_sample_to_sample(cut, tmp_path, kind, suffix) -> None:
    pandas = pytest.importorskip("pandas", reason="read back by pandas")
    file = write_recording(cut, tmp_path / f"cut{suffix}", twist=kind)
    table = {".csv": pandas.read_csv, ".parquet": pandas.read_parquet}.get(
        suffix, pandas.read_feather
    )(file)
    step = np.diff(table["t"])[:, None]
    linear, angular = (table[[f"{v}{a}" for a in "xyz"]].to_numpy()[:-1] for v in "vw")
    turns = Rotation.from_quat(table[["qw", "qx", "qy", "qz"]].to_numpy(), scalar_first=True)
    if kind == "body":
        middle = turns[:-1] * Rotation.from_rotvec(step * angular / 2)
        linear, angular = middle.apply(linear), middle.apply(angular)
    places = table[["x", "y", "z"]].to_numpy()
    np.testing.assert_allclose(places[:-1] + step * linear, places[1:], atol=1e-14)
    turned = Rotation.from_rotvec(step * angular) * turns[:-1] * turns[1:].inv()
    assert turned.magnitude().max() < 1e-7
    assert not table.iloc[-1][["vx", "vy", "vz", "wx", "wy", "wz"]].any()
    # And the poses are still those of the motion.
    [again] = load_demonstrations(file)
    np.testing.assert_array_equal(again.positions, cut.positions)


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_planar_recording_comes_back_planar(tmp_path, noslip, suffix) -> None:
    rows = [f"{k},{0.05 * k},{0.1 * np.cos(0.1 * k)},{0.01 * k},{-3 * k}" for k in range(40)]
    source = tmp_path / "robot.csv"
    source.write_text("\n".join(["i,t,x,y,theta_deg", *rows]))
    out = tmp_path / f"out{suffix}"
    assert noslip("convert", source, "--out", out).code == 0
    [before], [after] = load_demonstrations(source), load_demonstrations(out)
    np.testing.assert_array_equal(after.positions, before.positions)
    np.testing.assert_allclose((after.rotations * before.rotations.inv()).magnitude(), 0, atol=1e-7)
    text = noslip("convert", out).out
    assert "theta: angle about z, rad" in text
    assert "qw" not in text


def test_wheels_from_a_shell(tmp_path, noslip) -> None:
    robot = drive(np.full(COUNT, 0.3), np.full(COUNT, 0.5), 0.05)
    file = robot.to_csv(tmp_path / "robot.csv")
    out = tmp_path / "wheels.csv"
    told = noslip("convert", file, "--wheels", "track=0.4,radius=0.1", "--out", out)
    assert told.code == 0
    header, first, *_, last = out.read_text().splitlines()
    assert header == "t,x,y,theta,v,omega,left,right"
    np.testing.assert_allclose(list(map(float, first.split(",")))[4:], [0.3, 0.5, 2, 4], rtol=1e-9)
    assert list(map(float, last.split(",")))[4:] == [0, 0, 0, 0]
    assert "track" in noslip("convert", file, "--wheels", "track=0.4", "--out", out).err
    assert noslip("convert", file, "--wheels", "radius", "--out", out).code == 2


def test_what_cannot_be_told_so_is_said(cut, tmp_path) -> None:
    with pytest.raises(InputError, match=r"is not planar: its height varies by 0\.01 m"):
        motion_columns(cut, planar=True)
    with pytest.raises(InputError, match="has no place for twist; leave it out, or write a CSV"):
        write_recording(cut, tmp_path / "cut.npz", twist="body")
    with pytest.raises(InputError, match="holds poses alone; write a CSV"):
        write_recording(cut, tmp_path / "cut.tum", twist="body")
    with pytest.raises(InputError, match="twist is one of body, world; got 'tool'"):
        motion_columns(cut, twist="tool")
    s = np.linspace(0, 1, 50)
    slip = ns.PoseTrajectory(s, np.column_stack([s, 0.1 * s, 0 * s]), Rotation.identity(50))
    with pytest.warns(CompromiseWarning, match="slips sideways by 10 % of its speed"):
        motion_columns(slip, planar=True, twist="body")


def test_tum_is_read_back_by_evo(cut, tmp_path) -> None:
    file_interface = pytest.importorskip("evo.tools.file_interface", reason="read back by evo")
    file = write_recording(cut, tmp_path / "cut.tum")
    found = file_interface.read_tum_trajectory_file(str(file))
    np.testing.assert_allclose(found.timestamps, cut.times, atol=1e-12)
    np.testing.assert_allclose(found.positions_xyz, cut.positions, atol=1e-12)
    turned = Rotation.from_quat(found.orientations_quat_wxyz, scalar_first=True)
    assert (turned * cut.rotations.inv()).magnitude().max() < 1e-7


def test_npz_is_read_back_by_numpy(cut, tmp_path) -> None:
    with np.load(write_recording(cut, tmp_path / "cut.npz")) as found:
        np.testing.assert_array_equal(found["positions"], cut.positions)
        np.testing.assert_array_equal(found["linear_velocities"], cut.linear_velocities)
