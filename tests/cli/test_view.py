"""``noslip view``: what it serves, what it saves, and what it refuses."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import urllib.request
from pathlib import Path

import pytest

import noslip as ns
from motions import planar_cut
from waiting import PATIENCE, heed_ctrl_c

pytest.importorskip("viser", reason="the viewer needs viser (extra: viewer)")


@pytest.fixture
def recording(tmp_path) -> Path:
    return planar_cut(0.5).to_csv(tmp_path / "cut.csv")


def test_save_writes_one_file_and_serves_nothing(noslip, recording, tmp_path):
    out = tmp_path / "scene.html"
    result = noslip("view", recording, "--constraint", "blade", "--out", out)
    assert result.code == 0 and result.out.startswith(f"wrote {out}: ")
    assert result.err == "" and len(result.out.splitlines()) == 1
    assert out.read_bytes().lstrip().lower().startswith(b"<!doctype html>")


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["missing.csv"], "missing.csv: no such file"),
        (["cut.csv", "--out", "scene.png"], "must end in .html"),
        (["cut.csv", "--save", "scene.png"], "must end in .html"),
        (["cut.csv", "--tool-mesh", "tool.step"], "a tool is a mesh in"),
        (
            ["cut.csv", "--tool-mesh", "tool.stl", "--tool-scale", "0"],
            "tool scale must be a positive number",
        ),
        (["cut.csv", "--constraint", "sword"], "no constraint is called 'sword'"),
        (["cut.csv", "--no-open", "--host", "203.0.113.7"], "nothing can be served at"),
        (["cut.csv", "cut.json"], "cut.json: cannot be read"),
    ],
)
def test_bad_input_gets_one_line_and_exit_code_2(
    noslip, recording, monkeypatch, arguments, expected
):
    monkeypatch.chdir(recording.parent)
    result = noslip("view", *arguments)
    assert result.code == 2 and result.out == ""
    assert expected in result.err and len(result.err.splitlines()) == 1


def test_a_simulated_arm_is_saved_beside_other_motions(noslip, recording, tmp_path):
    pytest.importorskip("mujoco", reason="the extra robots is not installed")
    pytest.importorskip("daqp", reason="the extra robots is not installed")
    primitive = ns.learn(ns.PoseTrajectory.from_csv(recording), ns.Blade()).save(
        tmp_path / "c.json"
    )
    arm, out = tmp_path / "arm", tmp_path / "scene.html"
    placed = ("--placement", "0.45,0,0.25,0", "--dynamics", "none")
    assert noslip("simulate", primitive, *placed, "--out", arm).code == 0
    # Another of the same name, as of another run.
    again = shutil.copytree(arm, tmp_path / "again" / "arm")
    result = noslip("view", f"{arm}/", again, primitive, recording, "--out", out)
    assert result.code == 0 and result.out.startswith(f"wrote {out}: "), result.err
    text = out.read_text()
    for name in ("arm", "arm_2", "c.json", "cut.csv"):
        assert f"<b>{name}</b>" in text
    (arm / "tool.csv").unlink()
    refused = noslip("view", arm, "--out", out)
    assert refused.code == 2 and "tool.csv" in refused.err and refused.err.count("\n") == 1


def test_without_viser_the_extra_is_named(noslip, recording, monkeypatch):
    for module in [name for name in sys.modules if name.startswith("noslip.viewer")]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, "viser", None)
    result = noslip("view", recording)
    assert result.code == 2
    assert "pip install 'noslip[viewer]'" in result.err


def test_it_serves_until_it_is_interrupted(recording):
    command = [sys.executable, "-m", "noslip", "view", recording, "--no-open", "--port", "0"]
    with subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ,
        preexec_fn=heed_ctrl_c,
    ) as process:
        try:
            line = process.stdout.readline()
            assert line.startswith("http://127.0.0.1:") and "Ctrl-C" in line
            with urllib.request.urlopen(line.split()[0], timeout=PATIENCE) as answer:
                assert b"<html" in answer.read()
            process.send_signal(signal.SIGINT)
            out, err = process.communicate(timeout=PATIENCE)
        finally:
            process.kill()
    assert process.returncode == 130
    assert out == "" and err.strip() in ("", "noslip: interrupted")
