"""States, goals, measurements and times at random; ``benchmarks.fuzz exported`` takes as many."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from benchmarks.fuzz import exported
from noslip.exporting import export

EXECUTIONS = 3000


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler (cc)")
@pytest.mark.parametrize(
    ("omitted", "said"),
    [
        ("", ""),
        # Mistakes are found: what finds none is no proof that there are none.
        pytest.param("*state = kept;", "refused, and changed", marks=pytest.mark.slow),
        pytest.param("if (!(sum >= 0)) return 1;", "not finite", marks=pytest.mark.slow),
    ],
)
def test_exported_c_takes_whatever_comes(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    omitted: str,
    said: str,
    trials: Callable[[int], None],
) -> None:
    # Instructions are counted for a header, which takes seconds.
    monkeypatch.setattr(export, "_instructions", lambda *told: None)
    exported.export(tmp_path)
    step = tmp_path / "noslip.c"
    whole = step.read_text()
    assert omitted in whole
    step.write_text(whole.replace(omitted, ""))
    trials(EXECUTIONS)
    done = exported.run(exported.build(tmp_path), EXECUTIONS, 1)
    assert bool(done.returncode) == bool(said), done.stderr[-2000:]
    assert said in done.stderr
