"""``noslip convert`` and ``noslip topics``, and the options that choose inside a recording."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import noslip as ns
from motions import planar_cut
from noslip.recordings import write_bag


@pytest.fixture
def cut(tmp_path) -> Path:
    """A planar cut that hardly slips."""
    return planar_cut(beside=0.01, count=241).to_csv(tmp_path / "cut.csv")


def test_through_every_format_and_back(noslip, cut, tmp_path) -> None:
    pytest.importorskip("rosbags", reason="needs the extra bags")
    pytest.importorskip("pyarrow", reason="needs the extra tables")
    before = cut
    for name in ("a.tum", "b.parquet", "c_bag", "d.mcap", "e.feather", "f.npz", "g.csv"):
        code, out, err = noslip("convert", before, "--out", tmp_path / name)
        assert (code, err) == (0, "")
        assert out == f"wrote {tmp_path / name}: 241 samples, 2 s\n"
        before = tmp_path / name
    first, last = (np.loadtxt(path, delimiter=",", skiprows=1) for path in (cut, before))
    np.testing.assert_allclose(last, first, rtol=0, atol=1e-9)


def test_check_learn_and_plot_read_bags(noslip, cut, tmp_path) -> None:
    pytest.importorskip("rosbags", reason="needs the extra bags")
    bag, out = tmp_path / "run", tmp_path / "cut.json"
    assert noslip("convert", cut, "--out", bag)[0] == 0
    held = ["--topic", "/pose", "--constraint", "blade"]
    loose = ["--tolerance", "0.01", "--json"]
    code, of_bag, _ = noslip("check", bag, *held, *loose)
    assert code == 0
    _, of_csv, _ = noslip("check", cut, "--constraint", "blade", *loose)
    [one], [other] = json.loads(of_bag), json.loads(of_csv)
    peaks = [report["constraints"][0]["peak"] for report in (one, other)]
    assert peaks[0] == pytest.approx(peaks[1], rel=1e-3) != 0
    assert noslip("learn", bag, *held, "--out", out)[0] == 0
    assert noslip("plot", bag, *held, "--frame", "world", "--out", tmp_path / "p.png")[0] == 0
    assert noslip("rollout", out, "--out", tmp_path / "motion.mcap")[0] == 0
    steps = ns.load_primitive(out).steps
    assert len(ns.load_demonstrations(tmp_path / "motion.mcap")[0]) == steps + 1
    code, _, err = noslip("check", bag, "--topic", "/odom", "--constraint", "blade")
    assert code == 2
    assert err == (
        f"noslip: error: {bag}: no topic /odom; those with poses are /pose "
        "(geometry_msgs/PoseStamped, 241) (see noslip docs recordings)\n"
    )


def test_topics(noslip, cut, tmp_path) -> None:
    pytest.importorskip("rosbags", reason="needs the extra bags")
    [motion] = ns.load_demonstrations(cut)
    bag = write_bag(
        tmp_path / "bag",
        poses=motion,
        joint_names=["j"],
        joint_times=[0.0],
        joint_positions=[[1.0]],
        frame="base",
    )
    code, out, _ = noslip("topics", bag)
    lines = [line.split() for line in out.splitlines()]
    assert code == 0
    assert lines == [
        ["topic", "type", "messages", "frames"],
        ["/joint_states", "sensor_msgs/JointState", "1", "none"],
        ["/pose", "geometry_msgs/PoseStamped", "241", "base"],
    ]
    _, out, _ = noslip("topics", bag, "--json")
    assert json.loads(out)[1]["frames"] == [["base", ""]]
    code, _, err = noslip("topics", tmp_path / "none.bag")
    assert (code, err) == (
        2, f"noslip: error: {tmp_path / 'none.bag'}: no such file; check the path\n"
    )  # fmt: skip


def test_what_is_chosen_in_a_bag(noslip, cut, tmp_path) -> None:
    pytest.importorskip("rosbags", reason="needs the extra bags")
    bag, out = tmp_path / "cut.mcap", tmp_path / "out.csv"
    assert noslip("convert", cut, "--twist", "body", "--out", bag).code == 0
    assert "integrate=" in noslip("convert", bag, "--topic", "/twist", "--out", out).err
    assert noslip("convert", bag, "--integrate", "body", "--out", out).code == 0
    [there], [back] = ns.load_demonstrations(cut), ns.load_demonstrations(out)
    np.testing.assert_allclose(back.body_velocities, there.body_velocities, atol=1e-6)
    assert "no publisher 2; there are 1" in noslip("convert", bag, "--publisher", "2").err
    assert noslip("convert", bag, "--element", "0", "--out", out).code == 0


def test_episodes_and_columns(noslip, tmp_path) -> None:
    h5py = pytest.importorskip("h5py", reason="needs the extra hdf5")
    path = tmp_path / "can.hdf5"
    with h5py.File(path, "w") as file:
        for k in range(3):
            pose = np.zeros((20, 7))
            pose[:, 0], pose[:, 6] = (np.arange(20) + 100 * k) / 8, 1
            file[f"data/demo_{k}/obs/eef"] = pose
    choose = ["--columns", "eef[0:3,6,3:6]", "--sample-rate", 10]
    code, out, _ = noslip("convert", path, *choose, "--out", tmp_path / "all.csv")
    assert code == 0
    assert f"wrote {tmp_path / 'all_03.csv'}: 20 samples" in out
    [third] = ns.load_demonstrations(tmp_path / "all_03.csv")
    assert third.positions[0, 0] == 25
    assert noslip("convert", path, *choose, "--episode", 2, "--out", tmp_path / "2.csv")[0] == 0
    [two] = ns.load_demonstrations(tmp_path / "2.csv")
    assert two.positions[0, 0] == 25
    code, out, _ = noslip(
        "check", path, *choose, "--episode", 0, "--episode", 2, "--constraint", "blade"
    )
    assert code == 0
    assert "demo_0" in out
    assert "demo_2" in out
    assert "demo_1" not in out


def test_a_format_that_is_not_known(noslip, cut, tmp_path) -> None:
    code, _, err = noslip("convert", cut, "--out", tmp_path / "cut.xml")
    assert code == 2
    assert "must end in .csv, .tum, .npz, .parquet, .feather, .mcap, or no suffix" in err
