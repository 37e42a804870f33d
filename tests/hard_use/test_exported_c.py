"""States, goals, measurements and times at random; ``benchmarks.fuzz exported`` takes as many."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from benchmarks.fuzz import exported
from noslip.exporting import export

EXECUTIONS = 3000


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder in which all is exported and compiled."""
    folder = tmp_path_factory.mktemp("whole")
    with pytest.MonkeyPatch.context() as patch:
        # Instructions are counted for a header, which takes seconds.
        patch.setattr(export, "_instructions", lambda *told: None)
        exported.export(folder)
    return folder


@pytest.fixture
def unoptimized(monkeypatch: pytest.MonkeyPatch) -> None:
    """Better code takes longer to make than a few executions then save."""
    quick = tuple(flag.replace("-O1", "-O0") for flag in exported.FLAGS)
    monkeypatch.setattr(exported, "FLAGS", quick)


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
    whole: Path,
    unoptimized: None,
    tmp_path: Path,
    omitted: str,
    said: str,
    trials: Callable[[int], None],
) -> None:
    # What has not changed is compiled once.
    exported.build(whole)
    folder = shutil.copytree(whole, tmp_path / "changed")
    step = folder / "noslip.c"
    text = step.read_text()
    assert omitted in text
    if omitted:
        step.write_text(text.replace(omitted, ""))
    trials(EXECUTIONS)
    done = exported.run(exported.build(folder), EXECUTIONS, 1)
    assert bool(done.returncode) == bool(said), done.stderr[-2000:]
    assert said in done.stderr
