"""What is compiled: found, kept, rebuilt when broken, done without where there is no compiler."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import noslip as ns
from benchmarks.timing import forget
from noslip.codegen import c99, library
from noslip.constraints import ConstraintSystem
from noslip.experiments.numerical_example import demonstration
from noslip.rule import Rule
from noslip.runtime.stepper import stepper_of
from waiting import PATIENCE


def learned(**options: Any) -> ns.ConstrainedDMP:
    """Learn under a rule that no test has had compiled."""
    forget()
    return ns.learn(demonstration(), [ns.Blade()], **options)


def test_the_motion_is_the_same_to_the_bit(compiling: Path) -> None:
    dmp = learned()
    before = dmp.rollout(duration=2.0)
    assert dmp.compile()
    after = dmp.rollout(duration=2.0)
    for name in ("positions", "quaternions", "linear_velocities", "multipliers", "row_forces"):
        np.testing.assert_array_equal(getattr(before, name), getattr(after, name))


def test_limits_are_not_written_out_one_against_another() -> None:
    """Twice as many are less than three times as long: one exchange is, and it is called."""

    def length(limits: int) -> int:
        walls = [ns.DepthLimit(depth=1.0 + k) for k in range(limits)]
        rule = Rule(ConstraintSystem([ns.Blade(), *walls]))
        return len(c99.source(stepper_of(rule).function, rule.system.size))

    lengths = [length(limits) for limits in (4, 8, 16)]
    assert lengths[1] < 2.5 * lengths[0]
    assert lengths[2] < 3 * lengths[1]


def test_it_is_compiled_once_for_the_same_constraints(compiling: Path) -> None:
    assert learned().compile()
    kept = {file: file.stat().st_mtime_ns for file in compiling.iterdir()}
    other = learned(basis_functions=30).adapt(goal_position=[1.2, 0.9, 0.1])
    assert other.compile()
    assert {file: file.stat().st_mtime_ns for file in compiling.iterdir()} == kept


def test_it_is_begun_in_the_background_once_a_primitive_is_rolled_out_again(
    compiling: Path,
) -> None:
    dmp = learned()
    dmp.rollout()
    assert stepper_of(dmp.rule).native._thread is None
    for _ in range(3):
        dmp.rollout()
    assert stepper_of(dmp.rule).native._thread is not None
    assert stepper_of(dmp.rule).native.wait() is not None


PROGRAM = (
    "import noslip as ns\n"
    "from noslip.experiments.numerical_example import demonstration\n"
    "dmp = ns.learn(demonstration(), [ns.Blade()])\n"
    "assert dmp.compile()\n"
    "print(dmp.rollout().positions[-1].tolist())\n"
)
"""What a process that finds a cache does."""

Started = Callable[[Path], subprocess.Popen[str]]


@pytest.fixture(scope="module")
def started(tmp_path_factory: pytest.TempPathFactory) -> Started:
    """Start such a process with a cache.

    What it compiles is not optimized: the same to the bit, and made sooner.
    """
    if (found := shutil.which("cc")) is None:
        pytest.skip("no C compiler (cc) on this machine")
    compiler = tmp_path_factory.mktemp("compiler") / "cc"
    compiler.write_text(f'#!/bin/sh\nexec {found} "$@" -O0\n')
    compiler.chmod(0o755)

    def started(cache: Path) -> subprocess.Popen[str]:
        own = {"NOSLIP_COMPILE": "1", "NOSLIP_CACHE": str(cache), "CC": str(compiler)}
        return subprocess.Popen(
            [sys.executable, "-c", PROGRAM], env=os.environ | own, stdout=subprocess.PIPE, text=True
        )

    return started


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory, started: Started) -> tuple[Path, str]:
    """A cache, and what the process that filled it printed."""
    folder = tmp_path_factory.mktemp("built")
    printed = started(folder).communicate(timeout=PATIENCE)[0]
    # Its steps are the same to the bit; its plan, in machine code too, to rounding.
    end = learned().rollout().positions[-1]
    np.testing.assert_allclose(json.loads(printed), end, rtol=0, atol=1e-12)
    return folder, printed


@pytest.mark.parametrize("how", ["cut", "overwritten", "without its sum", "empty"])
def test_a_broken_cache_is_built_again(
    how: str, built: tuple[Path, str], started: Started, tmp_path: Path
) -> None:
    """The step's code and the plan's, which are read and built apart."""
    whole_cache, printed = built
    cache = shutil.copytree(whole_cache, tmp_path / "cache")
    files = [file for what in ("step", "plan") for file in cache.glob(f"{what}-*.so")]
    wholes = [file.read_bytes() for file in files]
    assert len(files) == 2
    for file, whole in zip(files, wholes, strict=True):
        if how == "without its sum":
            file.with_suffix(".sha256").unlink()
        else:
            file.write_bytes({"cut": whole[: len(whole) // 2], "empty": b""}.get(how, whole[::-1]))
    process = started(cache)
    assert process.communicate(timeout=PATIENCE)[0] == printed
    assert process.returncode == 0
    # Not as a whole: to show where so many bytes differ takes minutes.
    assert all(file.read_bytes() == whole for file, whole in zip(files, wholes, strict=True))


@pytest.mark.slow
def test_several_processes_may_build_at_once(started: Started, tmp_path: Path) -> None:
    running = [started(tmp_path) for _ in range(2)]
    told = {process.communicate(timeout=PATIENCE)[0] for process in running}
    assert [process.returncode for process in running] == [0] * 2
    assert len(told) == 1
    # A step and a projection; a whole plan is compiled in the background, if there is time.
    for kind in ("step", "plan"):
        assert sorted(file.suffix for file in tmp_path.glob(f"{kind}-*")) == [".sha256", ".so"]


@pytest.mark.parametrize("why", ["no compiler", "broken compiler", "no folder", "turned off"])
def test_without_it_everything_works(
    why: str, compiling: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if why == "no compiler":
        monkeypatch.setenv("CC", "no-such-compiler")
    elif why == "broken compiler":
        broken = tmp_path / "cc"
        broken.write_text("#!/bin/sh\necho 'cc: error: broken' >&2\nexit 1\n")
        broken.chmod(0o755)
        monkeypatch.setenv("CC", str(broken))
    elif why == "no folder":
        (tmp_path / "file").touch()
        monkeypatch.setenv("NOSLIP_CACHE", str(tmp_path / "file"))
    else:
        monkeypatch.setenv("NOSLIP_COMPILE", "0")
    dmp = learned()
    assert not dmp.compile()
    if why == "broken compiler":
        assert "broken" in stepper_of(dmp.rule).native.failure
    controller = dmp.controller(time_step=dmp.duration / dmp.steps)
    assert not controller.is_compiled
    while not controller.done:
        state = controller.step()
    np.testing.assert_allclose(state.position, dmp.rollout().positions[-1], rtol=0, atol=1e-12)


def test_compilers_may_have_options(compiling: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "cc -g0")
    found = library.compiler()
    assert found is not None
    assert found.command[1:] == ("-g0",)
    assert learned().compile()
