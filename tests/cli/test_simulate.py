"""``noslip simulate``: what it writes, and what it refuses."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from waiting import PATIENCE

pytest.importorskip("mujoco", reason="the extra robots is not installed")
pytest.importorskip("daqp", reason="the extra robots is not installed")

import noslip as ns
from motions import gentle_cut
from noslip import robots
from noslip.constraints.catalog import restore


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("simulate")
    cut = gentle_cut()
    cut.to_csv(folder / "cut.csv")
    ns.learn(cut, ns.Blade()).save(folder / "cut.json")
    return folder


PLACED = ("--placement", "0.45,0,0.25,0")


def test_joints_figures_and_a_summary_are_written(noslip, folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "arm"
    cut = folder / "cut.csv"
    result = noslip("simulate", folder / "cut.json", *PLACED, "--recording", cut, "--out", out)
    assert result.code == 0, result.err
    files = {path.name for path in out.iterdir()}
    tables = {"joints.csv", "executed.csv", "tool.csv"}
    assert files == tables | {"joints.png", "slip.png", "summary.json"}
    for name in files:
        assert f"wrote {out / name}" in result.out
    joints = np.genfromtxt(out / "joints.csv", delimiter=",", names=True)
    assert joints["t"][-1] == pytest.approx(1.5 + robots.RAMP, abs=2e-3)
    # The joints lead the tool where the arm's own kinematics say.
    tool = ns.PoseTrajectory.from_csv(out / "tool.csv")
    q = np.column_stack([joints[f"q{k}"] for k in range(1, 8)])
    positions, _ = robots.panda().forward(q)
    assert np.abs(positions - tool.positions).max() <= 1e-4
    summary = json.loads((out / "summary.json").read_text())
    assert summary["kinematic"]["slip"]["blade"] <= 1e-6
    [slipped], [person] = summary["dynamic"]["slip_distance"], summary["recording_slip_distance"]
    assert person == pytest.approx(robots.slip_distance(gentle_cut(), ns.Blade())[0], rel=1e-3)
    assert 10 * slipped < person
    assert f"the person: {1e3 * person:.3g} mm" in result.out
    # What noslip view needs to show the arm again.
    assert summary["model"] is None and summary["tool"] is None
    assert [restore(entry) for entry in summary["constraints"]] == [ns.Blade()]
    executed = np.genfromtxt(out / "executed.csv", delimiter=",", names=True)
    assert executed.dtype == joints.dtype and len(executed) == len(joints)
    q = np.column_stack([executed[f"q{k}"] for k in range(1, 8)])
    positions, _ = robots.panda().forward(q)
    assert np.abs(positions - tool.positions).max() <= 1e-12


def test_progress_is_shown_on_a_terminal_alone(noslip, folder: Path, tmp_path: Path, monkeypatch):
    monkeypatch.delenv("FORCE_COLOR", raising=False)
    piped = noslip("simulate", folder / "cut.json", *PLACED, "--out", tmp_path)
    assert piped.err == ""
    # By which rich takes what it writes to for a terminal.
    monkeypatch.setenv("FORCE_COLOR", "1")
    shown = noslip("simulate", folder / "cut.json", *PLACED, "--out", tmp_path)
    assert [stage in shown.err for stage in ("tracking", "dynamics", "writing")] == 3 * [True]
    assert shown.out == piped.out
    searched = noslip(
        "simulate", folder / "cut.json", "--dynamics", "none", "--out", tmp_path / "searched"
    )
    assert "searching a placement" in searched.err and "dynamics" not in searched.err


@pytest.mark.parametrize("name", ["arm.mcap", "arm_bag"])
def test_joints_and_tool_are_written_as_a_bag(noslip, folder: Path, tmp_path: Path, name: str):
    rosbags = pytest.importorskip("rosbags.highlevel", reason="needs the extra bags")
    typesys = pytest.importorskip("rosbags.typesys", reason="needs the extra bags")
    out, bag = tmp_path / "arm", tmp_path / name
    result = noslip("simulate", folder / "cut.json", *PLACED, "--bag", bag, "--out", out)
    assert result.code == 0, result.err
    assert f"wrote {bag}" in result.out
    tool = ns.PoseTrajectory.from_csv(out / "tool.csv")
    table = np.loadtxt(out / "executed.csv", delimiter=",", skiprows=1)
    types = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    found: dict[str, list] = {"/pose": [], "/joint_states": []}
    with rosbags.AnyReader([bag], default_typestore=types) as reader:
        for connection, _, raw in reader.messages():
            found[connection.topic].append(reader.deserialize(raw, connection.msgtype))
    poses, joints = found["/pose"], found["/joint_states"]
    assert len(poses) == len(joints) == len(tool)
    assert poses[0].header.frame_id == "base"
    places = [[getattr(p.pose.position, axis) for axis in "xyz"] for p in poses]
    assert np.array(places).tolist() == tool.positions.tolist()
    assert joints[0].name == [f"joint{k}" for k in range(1, 8)]
    assert np.array([j.position for j in joints]).tolist() == table[:, 1:8].tolist()
    assert np.array([j.velocity for j in joints]).tolist() == table[:, 8:].tolist()
    stamps = [j.header.stamp.sec + 1e-9 * j.header.stamp.nanosec for j in joints]
    assert stamps == pytest.approx(table[:, 0], abs=1e-9)
    again = noslip("simulate", folder / "cut.json", *PLACED, "--bag", bag, "--out", out)
    assert again.code == (0 if name.endswith(".mcap") else 2)


def test_without_rosbags_a_bag_is_refused_before_the_work(
    noslip, folder: Path, tmp_path: Path, monkeypatch
):
    monkeypatch.setattr("noslip.cli.simulate.find_spec", lambda name: None)
    bag, out = tmp_path / "arm.mcap", tmp_path / "arm"
    result = noslip("simulate", folder / "cut.json", *PLACED, "--bag", bag, "--out", out)
    assert result.code == 2 and "pip install 'noslip[bags]'" in result.err
    assert not out.exists()


def test_as_json_nothing_else_is_printed(noslip, folder: Path, tmp_path: Path) -> None:
    result = noslip(
        "simulate", folder / "cut.json", *PLACED, "--dynamics", "none", "--json", "--out", tmp_path
    )
    found = json.loads(result.out)
    assert "dynamic" not in found
    assert found["robot"] == "panda"
    assert all(Path(path).is_file() for path in found["written"])


def test_another_controller_noise_and_duration_do_something(
    noslip, folder: Path, tmp_path: Path
) -> None:
    noisy = ("--dynamics", "impedance", "--noise", "--delay", 0.002, "--duration", 2)
    result = noslip("simulate", folder / "cut.json", *PLACED, *noisy, "--out", tmp_path)
    assert result.code == 0, result.err
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["duration"] == pytest.approx(2 + robots.RAMP, abs=2e-3)
    assert summary["dynamic"]["control"] == "impedance"
    assert summary["dynamic"]["position_error"] > 1e-5


def test_a_model_of_ones_own_is_taken(noslip, folder: Path, tmp_path: Path) -> None:
    model = tmp_path / "arm.xml"
    model.write_text(Path(robots.__file__).with_name("panda.xml").read_text())
    options = ("--robot", model, "--robot-tool", "tool", "--dynamics", "none", *PLACED)
    result = noslip("simulate", folder / "cut.json", *options, "--out", tmp_path / "own")
    assert result.code == 0, result.err
    assert result.out.startswith("arm.xml: ")


@pytest.mark.slow
def test_a_video_is_drawn_where_that_can_be(folder: Path, tmp_path: Path) -> None:
    """In a process of its own: MuJoCo chooses how to draw when it is first imported."""
    ffmpeg = pytest.importorskip("imageio_ffmpeg", reason="the extra video is not installed")
    arguments = ["simulate", folder / "cut.json", "--dynamics", "none", "--video", *PLACED]
    command = [sys.executable, "-m", "noslip", *map(str, arguments), "--out", str(tmp_path)]
    result = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE)
    if result.returncode:
        assert "no OpenGL without a window here: set MUJOCO_GL" in result.stderr
        pytest.skip(result.stderr)
    film = [ffmpeg.get_ffmpeg_exe(), "-i", str(tmp_path / "arm.mp4")]
    decoded = subprocess.run(
        [*film, "-f", "rawvideo", "-pix_fmt", "rgb24", "-"], capture_output=True, check=True
    )
    frames = np.frombuffer(decoded.stdout, np.uint8).reshape(-1, 480, 640, 3).astype(float)
    assert len(frames) == pytest.approx(30 * (1.5 + robots.RAMP), abs=2)
    assert frames[0].std() > 10
    assert np.abs(frames[0] - frames[-1]).max() > 50


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--placement", "0.4,0,0.2"), "--placement: expected 4 numbers"),
        (("--placement", "0.4,0,nan,0"), "placement must be"),
        (("--robot", "ur5"), "there is panda"),
        (("--robot", "none.xml"), "--robot none.xml needs --robot-tool"),
        (("--robot-tool", "tip"), "--robot-tool is for a model's file"),
        (("--robot", "none.xml", "--robot-tool", "tip"), "none.xml: no such file"),
        ((*PLACED, "--delay", "0.5"), "delay must be"),
        ((*PLACED, "--bag", "arm.bag"), "--bag: arm.bag must end in .mcap"),
        ((*PLACED, "--bag", str(Path(__file__).parent)), "exists already"),
        ((*PLACED, "--duration", "0.05"), "exceeds its limit"),
        (("--placement", "1.2,0,0.2,0"), "out of reach"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(
    noslip, folder: Path, tmp_path: Path, options: tuple[str, ...], message: str
) -> None:
    out = tmp_path / "arm"
    result = noslip("simulate", folder / "cut.json", *options, "--out", out)
    assert result.code == 2
    assert message in result.err
    assert result.err.startswith("noslip: error: ")
    assert result.err.count("\n") == 1
    assert not out.exists()


def test_a_file_in_place_of_the_folder_is_refused(noslip, folder: Path) -> None:
    result = noslip("simulate", folder / "cut.json", "--out", folder / "cut.csv")
    assert result.code == 2
    assert "is a file; give a folder" in result.err
