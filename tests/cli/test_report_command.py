"""``noslip report``: what it writes, what it says, and how it refuses."""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import noslip as ns

pytest.importorskip("jinja2", reason="the extra report is not installed")


@pytest.fixture
def noslip(noslip, monkeypatch, tmp_path):
    """Run the command in this process and in a folder with a recording and its primitive."""
    monkeypatch.chdir(tmp_path)
    t = np.linspace(0.0, 2.0, 121)
    path = np.column_stack([0.05 * t, 0.02 * np.sin(np.pi * t), 0 * t])
    yaw = np.arctan(0.4 * np.pi * np.cos(np.pi * t)) + np.radians(20)
    ns.PoseTrajectory(t, path + 1.0, Rotation.from_euler("z", yaw)).to_csv("cut.csv")
    (demonstration,) = ns.load_demonstrations("cut.csv")
    demonstration = ns.prepare(demonstration, rate=50, relative=True)
    ns.learn(demonstration, [ns.Blade()], basis_functions=20).save("cut.json")

    return partial(noslip, "report")


def test_a_report_says_its_finding_and_where_it_is(noslip):
    code, out, err = noslip(
        *("cut.csv", "cut.json", "--rate", "50", "--relative", "--out", "deep/report.html")
    )
    assert (code, err) == (0, "")
    title, wrote = out.splitlines()
    assert "learned motion does not slip, ends " in title
    assert wrote == "wrote deep/report.html"
    text = Path("deep/report.html").read_text()
    assert title in text
    assert "cut.csv --rate=50 --relative --constraint blade --basis-functions=20 --out" in text


def test_recordings_prepared_otherwise_are_warned_of(noslip):
    code, _, err = noslip("cut.json", "cut.csv", "--out", "report.html")
    assert code == 0
    assert "noslip: warning: the primitive starts 1.73 m from where the recordings do" in err


def test_one_run_writes_both(noslip, monkeypatch):
    pytest.importorskip("weasyprint", reason="the extra report is not installed")
    monkeypatch.setattr("noslip.reporting.content.pictures", lambda *_: [])
    code, out, _ = noslip("cut.json", "--out", "report.html", "--out", "report.pdf")
    assert code == 0
    assert out.splitlines()[1:] == ["wrote report.html", "wrote report.pdf"]
    assert Path("report.pdf").read_bytes().startswith(b"%PDF-")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["cut.json", "--out", "report.docx"], "report.docx: a report ends in .html or .pdf"),
        (["cut.json", "--out", "."], ". is a folder"),
        (["missing.json"], "missing.json: cannot be read"),
        (["cut.csv"], "cut.csv: a recording, not a primitive; learn one from it first"),
        (["cut.json", "cut.csv", "b.json"], "one primitive, got cut.json, b.json; report each"),
        (["cut.json", "missing.csv"], "missing.csv: no such file"),
    ],
)
def test_what_cannot_be_reported_gets_one_line_and_no_file(noslip, tmp_path, arguments, said):
    before = sorted(tmp_path.iterdir())
    code, out, err = noslip(*arguments)
    assert (code, out) == (2, "")
    assert err.startswith("noslip: error: ") and err.count("\n") == 1 and said in err
    assert sorted(tmp_path.iterdir()) == before


def test_a_missing_extra_is_named(noslip, tmp_path, monkeypatch):
    monkeypatch.setattr("noslip.reporting.content.pictures", lambda *_: [])
    monkeypatch.setitem(sys.modules, "jinja2", None)
    before = sorted(tmp_path.iterdir())
    code, _, err = noslip("cut.json")
    assert code == 2 and "pip install 'noslip[report]'" in err
    assert sorted(tmp_path.iterdir()) == before


def test_help_has_examples(noslip):
    code, out, _ = noslip("--help")
    assert code == 0
    assert "noslip report excision.json recordings/*.csv" in out
