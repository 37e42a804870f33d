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

import objects

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
# NumPy, not loaded yet, heeds these.  Its matrices are small here: threads that wait for each other
# take half as much time of the processor again.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")


@pytest.fixture(scope="session")
def run_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder that all workers of one run share."""
    own = tmp_path_factory.getbasetemp()
    return own.parent if "PYTEST_XDIST_WORKER" in os.environ else own


@pytest.fixture(scope="session")
def once(run_folder: Path) -> Callable[[str, Callable[[Path], None]], Path]:
    """Have a folder filled by the worker that first wants it; the others wait, and find it full."""
    from noslip._files import locked

    def filled(name: str, fill: Callable[[Path], None]) -> Path:
        with locked(run_folder / name):
            folder, done = run_folder / name / "in", run_folder / name / "done"
            if not done.exists():
                folder.mkdir(exist_ok=True)
                fill(folder)
                done.touch()
        return folder

    return filled


@pytest.fixture(scope="session")
def demo(once: Callable[[str, Callable[[Path], None]], Path]) -> Path:
    """Folder that ``noslip demo`` wrote; to be read only."""

    def run(folder: Path) -> None:
        from noslip.cli import main

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(sys, "argv", ["noslip", "demo", "--out", str(folder / "results")])
            with pytest.raises(SystemExit) as done:
                main()
                raise SystemExit(0)
        assert not done.value.code

    return once("demo", run) / "results"


@pytest.fixture(scope="session", autouse=True)
def keep_objects(run_folder: Path) -> None:
    """Have what tests compile themselves kept for the others."""
    objects.FOLDER = run_folder / "objects"


@pytest.fixture
def compiling(monkeypatch: pytest.MonkeyPatch, run_folder: Path) -> Path:
    """Allow compiling, into a cache folder that the tests of one run share."""
    if shutil.which("cc") is None:
        pytest.skip("no C compiler (cc) on this machine")
    folder = run_folder / "compiled"
    monkeypatch.setenv("NOSLIP_COMPILE", "1")
    monkeypatch.setenv("NOSLIP_CACHE", str(folder))
    monkeypatch.delenv("CC", raising=False)
    # The same to the bit; better code takes longer to make than it then saves here.
    from noslip.codegen import library

    quick = tuple(flag.replace("-O2", "-O0") for flag in library.FLAGS)
    monkeypatch.setattr(library, "FLAGS", quick)
    monkeypatch.setattr("noslip.projection.planner.OPTIMIZED", "-O0")
    return folder


@pytest.fixture
def uncounted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out the counting of instructions in what is exported, which takes seconds."""
    monkeypatch.setattr("noslip.exporting.export._instructions", lambda *told: None)
    monkeypatch.setattr("noslip.shielding.exporting.most_instructions", lambda *told: None)


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
