"""``noslip doctor`` tells what is used and why."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from benchmarks.timing import forget


def told(noslip: Callable[..., Any]) -> dict[str, str]:
    code, out, _ = noslip("doctor", "--json")
    assert code == 0
    found: dict[str, str] = json.loads(out)
    return found


def test_with_a_compiler_steps_are_machine_code(
    compiling: Path, noslip: Callable[..., Any]
) -> None:
    found = told(noslip)
    assert found["steps run as"].startswith("machine code")
    assert str(compiling) in found["cache"]
    assert "casadi" in found["packages"]


def test_without_one_it_says_why(
    compiling: Path, noslip: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")
    # What was compiled before stays compiled.
    forget()
    found = told(noslip)
    assert found["steps run as"].endswith("no C compiler (no-such-compiler)")
    assert "no-such-compiler not found" in found["C compiler"]


def test_turned_off_it_says_so(noslip: Callable[..., Any]) -> None:
    assert "NOSLIP_COMPILE is 0" in told(noslip)["steps run as"]


def test_as_text_there_is_a_line_each(noslip: Callable[..., Any]) -> None:
    lines = noslip("doctor").out.splitlines()
    assert [line.split("  ")[0] for line in lines][:3] == ["noslip", "Python", "packages"]
    assert any("extras" in line and "bags: " in line for line in lines)
