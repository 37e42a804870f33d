"""``noslip doctor`` tells what is used and why."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from noslip.cli import main


def told(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    monkeypatch.setattr("sys.argv", ["noslip", "doctor", "--json"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 0
    found: dict[str, str] = json.loads(capsys.readouterr().out)
    return found


def test_with_a_compiler_steps_are_machine_code(
    compiling: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    found = told(capsys, monkeypatch)
    assert found["steps run as"].startswith("machine code")
    assert str(compiling) in found["cache"]
    assert "casadi" in found["packages"]


def test_without_one_it_says_why(
    compiling: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")
    found = told(capsys, monkeypatch)
    assert found["steps run as"].endswith("no C compiler (no-such-compiler)")
    assert "no-such-compiler not found" in found["C compiler"]


def test_turned_off_it_says_so(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert "NOSLIP_COMPILE is 0" in told(capsys, monkeypatch)["steps run as"]


def test_as_text_there_is_a_line_each(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["noslip", "doctor"])
    with pytest.raises(SystemExit):
        main()
    lines = capsys.readouterr().out.splitlines()
    assert [line.split("  ")[0] for line in lines][:3] == ["noslip", "Python", "packages"]
    assert any("extras" in line and "bags: " in line for line in lines)
