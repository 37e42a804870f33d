"""The C++ example of an exported controller: it compiles strictly, runs, and ends at its goal."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from cpp import CXX, OBJECTS, needs_cpp, ran
from test_replan_in_c import of

from noslip._typing import Floats

EXAMPLE = "example_controller.cpp"
STRICT = ("-std=c++14", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror")
HOLD = 2.0


def rows(text: str) -> Floats:
    header, *lines, told = text.splitlines()
    assert header == "t,x,y,z,qw,qx,qy,qz,tool_x,tool_y,tool_z,speed,mode"
    assert told.startswith("# done after ")
    return np.array([line.split(",") for line in lines], dtype=float)


def run(folder: Path, text: str, where: Path) -> subprocess.CompletedProcess[str]:
    """Compile the example, or another text of it, with what was exported; and run it."""
    (where / EXAMPLE).write_text(text)
    objects = [folder / name for name in OBJECTS]
    ran(CXX, *STRICT, "-O1", "-I", folder, EXAMPLE, *objects, "-o", "example", folder=where)
    return subprocess.run(["./example"], cwd=where, capture_output=True, text=True, check=False)


@needs_cpp
@pytest.mark.parametrize("name", ["blade", "wheel", "few basis functions", "breathing"])
def test_it_ends_at_its_goal(name: str, tmp_path: Path, exported: Callable[[str], Path]) -> None:
    dmp, folder = of(name), exported(name)
    done = run(folder, (folder / EXAMPLE).read_text(), tmp_path)
    assert done.returncode == 0, done.stdout[-200:]
    found = rows(done.stdout)
    motion = dmp.rollout()
    # A twentieth of the path farther, the way that it came.
    way = motion.positions[-1] - motion.positions[-1 - max(1, (len(motion) - 1) // 20)]
    goal = motion.positions[-1] + motion.path_length / 20 * way / np.linalg.norm(way)
    for at in (found[-1, 1:4], found[-1, 8:11]):
        assert np.linalg.norm(at - goal) <= 4e-3 * motion.path_length
    assert found[-1, 12] == HOLD
    # The push is waited for, and no command follows it.
    pushed = found[:, 0] > 0.3 * dmp.duration
    off = np.linalg.norm(found[pushed, 1:4] - found[pushed, 8:11], axis=1)
    assert off.max() > 0.02 * motion.path_length
    assert found[pushed, 11].min() < 0.9
    steps = np.linalg.norm(np.diff(found[:, 1:4], axis=0), axis=1) / np.diff(found[:, 0])
    assert steps.max() <= 1.3 * np.linalg.norm(motion.linear_velocities, axis=1).max()


@needs_cpp
def test_it_fails_where_it_does_not_end_there(
    tmp_path: Path, exported: Callable[[str], Path]
) -> None:
    folder = exported("blade")
    done = run(folder, (folder / EXAMPLE).read_text().replace("4e-3 * length", "-1.0"), tmp_path)
    assert done.returncode == 1
    assert done.stdout.splitlines()[-1].startswith("# NOT at its goal")


@needs_cpp
@pytest.mark.skipif(shutil.which("clang++") is None, reason="clang++ is missing (Debian: clang)")
def test_clang_has_nothing_to_say(exported: Callable[[str], Path]) -> None:
    ran("clang++", *STRICT, "-fsyntax-only", EXAMPLE, folder=exported("blade"))


@pytest.mark.slow
@needs_cpp
@pytest.mark.skipif(shutil.which("cmake") is None, reason="cmake is missing")
@pytest.mark.parametrize("real", ["double", "float"])
def test_cmake_builds_and_tests_what_is_exported(
    real: str, tmp_path: Path, exported: Callable[[str], Path]
) -> None:
    built = tmp_path / "build"
    ran("cmake", "-S", exported("blade"), "-B", built, f"-DNOSLIP_REAL={real}", folder=tmp_path)
    ran("cmake", "--build", built, folder=tmp_path)
    told = ran("ctest", "--test-dir", built, folder=tmp_path)
    assert re.search(r"100% tests passed.* out of 1", told)
    examples = {path.name for path in built.glob("primitive_example*")}
    # The planner, and so the controller, is of double precision.
    more = ("", "_replan", "_controller") if real == "double" else ("",)
    assert examples == {f"primitive_example{part}" for part in more}
    for name in sorted(examples):
        ran(built / name, folder=tmp_path)
