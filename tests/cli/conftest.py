"""What all tests of commands share: running one."""

from __future__ import annotations

import sys
from typing import NamedTuple

import pytest

from noslip.cli import main


class Result(NamedTuple):
    code: int
    out: str
    err: str


@pytest.fixture
def noslip(monkeypatch, capsys):
    """Run the command in this process, as main() would from a shell."""

    def run(*arguments: object) -> Result:
        monkeypatch.setattr(sys, "argv", ["noslip", *map(str, arguments)])
        with pytest.raises(SystemExit) as stop:
            main()
            raise SystemExit(0)
        captured = capsys.readouterr()
        return Result(int(stop.value.code or 0), captured.out, captured.err)

    return run
