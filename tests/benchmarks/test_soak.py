"""The soak: a short one passes, and one that must fail fails."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from benchmarks import soak

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler (cc)")


def test_a_short_soak_passes(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, uncounted: None
) -> None:
    # Compiling takes longer than so few steps.
    monkeypatch.setattr(soak, "FLAGS", tuple(flag.replace("-O2", "-O0") for flag in soak.FLAGS))
    assert soak.main(["--steps", "200000", "--seed", "3"]) == 0
    told = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [found["set"] for found in told] == [chosen.name for chosen in soak.SETS]
    steps = [found["soak"] for found in told]
    for found in steps:
        assert found["not finite"] == 0
        assert found["residual"] <= 1e-10
        assert found["off SO(3)"] <= 1e-12
    for found in told:
        assert found["soak_controller"]["faults"] == found["soak_controller"]["not finite"] == 0
    assert sum(found["steps"] for found in steps) == pytest.approx(200_000, rel=1e-2)
    assert sum(found["pushes"] for found in steps) > 50


def test_it_notices_what_slips(tmp_path: Path, uncounted: None) -> None:
    pushed = soak.Set("plane", (soak.ns.constraints.PlaneContact(),), 1.0, 1.0)
    # Off its plane a tool is pulled in, not at once.
    assert not soak.soak(pushed, 20_000, 0, tmp_path)["passed"]
