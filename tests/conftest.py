"""What all tests share: the Hypothesis profile, the command, and the recordings beside us."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest
from hypothesis import HealthCheck, settings

settings.register_profile(
    "ci",
    deadline=None,
    max_examples=50,
    derandomize=bool(os.environ.get("CI")),
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("ci")

# Random constraints would each be compiled; tests of what is compiled allow it.
os.environ["NOSLIP_COMPILE"] = "0"


@pytest.fixture
def compiling(monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Allow compiling, into a cache folder that the tests of one run share."""
    if shutil.which("cc") is None:
        pytest.skip("no C compiler (cc) on this machine")
    folder = tmp_path_factory.getbasetemp() / "compiled"
    monkeypatch.setenv("NOSLIP_COMPILE", "1")
    monkeypatch.setenv("NOSLIP_CACHE", str(folder))
    monkeypatch.delenv("CC", raising=False)
    return folder


@pytest.fixture(scope="session")
def recordings() -> Path:
    """Folder of real recordings; it lies beside the repository and is not part of it."""
    folder = Path(__file__).resolve().parents[2] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("the recordings (../shared/data, seen from the repository) are absent")
    return folder


class Result(NamedTuple):
    code: int
    out: str
    err: str


@pytest.fixture
def noslip(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., Result]:
    """Run the command in this process, as main() would from a shell."""
    from noslip.cli import main

    def run(*arguments: object) -> Result:
        monkeypatch.setattr(sys, "argv", ["noslip", *map(str, arguments)])
        with pytest.raises(SystemExit) as stop:
            main()
            raise SystemExit(0)
        captured = capsys.readouterr()
        return Result(int(stop.value.code or 0), captured.out, captured.err)

    return run
