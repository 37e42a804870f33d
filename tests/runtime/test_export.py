"""C99 of a primitive: compiles without a warning, agrees with Python, holds the constraints."""

from __future__ import annotations

import csv
import json
import re
import shutil
import subprocess
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import noslip as ns
from learned import under
from noslip.errors import NoslipError
from noslip.experiments.numerical_example import demonstration
from objects import objects

STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror", "-O1")
SANITIZED = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-O0", "-g0")
"""Not optimized: what is checked at each access takes long to optimize."""
CC = shutil.which("cc")
needs_compiler = pytest.mark.skipif(CC is None, reason="no C compiler (cc) on this machine")


def winding() -> ns.PoseTrajectory:
    """A cut that turns one and a half times."""
    s = np.linspace(0, 1, 501)
    yaw = 3 * np.pi * s
    velocity = np.column_stack([np.cos(yaw), np.sin(yaw), 0 * s])
    path = np.cumsum(velocity, axis=0) / 500
    return ns.PoseTrajectory(2 * s, path, Rotation.from_euler("z", yaw + 0.2))


def moving() -> ns.PoseTrajectory:
    s = np.linspace(0, 1, 301)
    path = np.column_stack([0.1 * s, 0.02 * np.sin(3 * s), 0.01 * s])
    return ns.PoseTrajectory(s, path, Rotation.from_euler("z", 0.3 * s))


CASES: dict[str, Any] = {
    "blade": lambda: ns.learn(demonstration(), [ns.Blade()]),
    "free": lambda: ns.learn(demonstration()),
    "shared": lambda: ns.learn(demonstration(), [ns.Blade()], metric="shared"),
    "winding": lambda: ns.learn(winding(), [ns.Blade()]),
    "few basis functions": lambda: ns.learn(moving(), [ns.Needle()], basis_functions=12),
    "steep phase": lambda: ns.learn(moving(), [ns.Blade()], alpha_s=12.0, basis_functions=100),
    "underdamped": lambda: ns.learn(moving(), [ns.Blade()], beta=10.0),
    "breathing": lambda: ns.learn(moving(), [ns.constraints.InMovingFrame(ns.Blade())]),
    "limits": lambda: under(
        primitive("blade"), [ns.Blade(), ns.DepthLimit(depth=0.1), ns.SpeedLimit(speed=3.0)]
    ),
    "a limit that pushes": lambda: under(
        ns.learn(moving(), ns.constraints.PlaneContact(normal=(0.1, 0, -1))),
        [ns.SpeedLimit(speed=0.11, priority=1), ns.constraints.PlaneContact(normal=(0.1, 0, -1))],
    ),
    "replanned": lambda: (dmp := primitive("blade")).replan(dmp.step(dmp.initial_state(), 1e-3)),
}


@cache
def primitive(name: str) -> ns.ConstrainedDMP:
    return CASES[name]()


def build(
    folder: Path,
    main: str,
    name: str = "cut",
    *flags: str,
    parts: tuple[str, ...] = ("noslip.c",),
    compiler: str | None = CC,
) -> Path:
    """Compile the step, or more, the numbers and a main."""
    program = folder / main.removesuffix(".c")
    command = (compiler, *STRICT, *flags)
    made = objects(folder, (*parts, f"{name}.c", main), *command)
    done = subprocess.run(
        [*map(str, command), *map(str, made), "-lm", "-o", program.name],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return program


def run(program: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([str(program)], capture_output=True, text=True, check=False)


@needs_compiler
@pytest.mark.parametrize("name", CASES)
def test_the_step_in_c_is_the_step_in_python(name: str, tmp_path: Path, uncounted: None) -> None:
    dmp = primitive(name)
    dmp.export_c(tmp_path, name="cut")
    tested = run(build(tmp_path, "test.c"))
    assert tested.returncode == 0, tested.stdout
    rows = list(csv.reader(run(build(tmp_path, "example.c")).stdout.splitlines()))
    assert rows[0] == ["t", "x", "y", "z", "qw", "qx", "qy", "qz"]
    found = np.array(rows[1:], dtype=float)
    motion = dmp.rollout()
    assert found.shape == (len(motion), 8)
    reach = max(1.0, float(np.abs(motion.positions).max()))
    np.testing.assert_allclose(found[:, 1:4], motion.positions, rtol=0, atol=1e-12 * reach)
    turned = Rotation.from_quat(found[:, 4:], scalar_first=True) * motion.rotations.inv()
    assert turned.magnitude().max() <= 1e-7  # of the magnitude's own rounding
    np.testing.assert_allclose(found[:, 0], motion.times, rtol=0, atol=1e-12)


@needs_compiler
@pytest.mark.parametrize("name", ["blade", "winding", "limits"])
def test_it_is_clean_under_the_sanitizers(name: str, tmp_path: Path, uncounted: None) -> None:
    primitive(name).export_c(tmp_path, name="cut")
    tested = run(build(tmp_path, "test.c", "cut", *SANITIZED))
    assert tested.returncode == 0, tested.stdout + tested.stderr


@needs_compiler
def test_single_precision_agrees_to_its_own_limit(tmp_path: Path, uncounted: None) -> None:
    primitive("blade").export_c(tmp_path, name="cut")
    tested = run(build(tmp_path, "test.c", "cut", "-DNOSLIP_REAL=float"))
    assert tested.returncode == 0, tested.stdout
    apart = float(re.search(r"differs by (\S+),", tested.stdout)[1])
    assert 1e-9 < apart < 1e-4


@needs_compiler
def test_the_generated_test_fails_where_the_motion_differs(tmp_path: Path, uncounted: None) -> None:
    primitive("blade").export_c(tmp_path, name="cut")
    numbers = tmp_path / "cut.c"
    numbers.write_text(re.sub(r"\.alpha = R\((.*?)\)", ".alpha = R(25.001)", numbers.read_text()))
    tested = run(build(tmp_path, "test.c"))
    assert tested.returncode == 1
    assert "FAILED" in tested.stdout


@needs_compiler
def test_another_primitive_needs_no_new_code(tmp_path: Path, uncounted: None) -> None:
    dmp = primitive("blade")
    other = dmp.adapt(goal_position=dmp.goal_position + [0.3, 0.2, 0.1], duration=2.5)
    dmp.export_c(tmp_path / "one", name="cut")
    other.export_c(tmp_path / "two", name="cut")
    first, second = ((tmp_path / part / "noslip.c").read_text() for part in ("one", "two"))
    assert first == second
    headers = [(tmp_path / part / "noslip.h").read_text() for part in ("one", "two")]
    assert headers[0] == headers[1]


@needs_compiler
def test_the_header_is_understood_by_cpp(tmp_path: Path, uncounted: None) -> None:
    if shutil.which("c++") is None:
        pytest.skip("no C++ compiler on this machine")
    primitive("blade").export_c(tmp_path, name="cut")
    build(tmp_path, "example.c")
    (tmp_path / "loop.cpp").write_text(
        '#include "cut.h"\n'
        "int main() { noslip_state s; noslip_start(&cut, &s); return noslip_done(&s); }\n"
    )
    flags = ("-std=c++17", "-Wall", "-Wextra", "-pedantic", "-Werror", "-fsyntax-only")
    done = subprocess.run(["c++", *flags, "loop.cpp"], cwd=tmp_path, check=False)
    assert done.returncode == 0


ARM, EMULATOR = "arm-linux-gnueabihf-gcc", "qemu-arm"
needs_emulator = pytest.mark.skipif(
    shutil.which(ARM) is None or shutil.which(EMULATOR) is None,
    reason=f"{ARM} or {EMULATOR} is missing (Debian: gcc-arm-linux-gnueabihf, qemu-user)",
)


@pytest.mark.slow
@needs_emulator
@pytest.mark.parametrize("real", ["double", "float"])
@pytest.mark.parametrize("name", ["blade", "winding", "limits"])
def test_it_runs_on_a_32_bit_arm(name: str, real: str, tmp_path: Path, uncounted: None) -> None:
    primitive(name).export_c(tmp_path, name="cut")
    flags = [*STRICT, "-static", f"-DNOSLIP_REAL={real}"]
    build = [ARM, *flags, "noslip.c", "cut.c", "test.c", "-lm", "-o", "test"]
    done = subprocess.run(build, cwd=tmp_path, capture_output=True, text=True, check=False)
    if (name, real) == ("limits", "float"):
        assert "limits_need_double" in done.stderr
        return
    assert done.returncode == 0, done.stderr
    # Compares with Python's motion, to 1e-12 (or what single precision allows), and the residual.
    tested = subprocess.run(
        [EMULATOR, "./test"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert tested.returncode == 0, tested.stdout + tested.stderr


@pytest.mark.slow
@needs_compiler
@pytest.mark.skipif(shutil.which("valgrind") is None, reason="valgrind is missing")
def test_it_is_clean_under_valgrind(tmp_path: Path, uncounted: None) -> None:
    primitive("limits").export_c(tmp_path, name="cut")
    program = build(tmp_path, "test.c")
    command = ["valgrind", "--error-exitcode=9", "--leak-check=full", str(program)]
    tested = subprocess.run(command, capture_output=True, text=True, check=False)
    assert tested.returncode == 0, tested.stdout + tested.stderr


@needs_compiler
def test_it_uses_no_heap(tmp_path: Path, uncounted: None) -> None:
    primitive("limits").export_c(tmp_path, name="cut")
    shared = {"<tgmath.h>", "<math.h>", *(f'"{header.name}"' for header in tmp_path.glob("*.h"))}
    for file in [*tmp_path.glob("*.h"), tmp_path / "noslip.c", tmp_path / "cut.c"]:
        text = re.sub(r"/\*.*?\*/", "", file.read_text(), flags=re.DOTALL)
        assert not re.search(r"\b(malloc|calloc|realloc|free|alloca)\b", text)
        assert set(re.findall(r"#include (\S+)", text)) <= shared


@pytest.mark.slow
@needs_compiler
@pytest.mark.skipif(shutil.which("valgrind") is None, reason="valgrind is missing")
def test_the_header_tells_the_instructions_of_a_step(tmp_path: Path) -> None:
    exported = primitive("blade").export_c(tmp_path, name="cut")
    assert exported.instructions is not None
    assert 1000 < exported.instructions < 100_000
    assert f"At most {exported.instructions} instructions" in (tmp_path / "noslip.h").read_text()


@pytest.mark.parametrize("what", ["name", "prefix"])
@pytest.mark.parametrize(
    "name",
    [
        *("", "2cut", "my-cut", "double", "a b", "class", "NULL", "exp", "sinf", "main", "read"),
        *("_cut", "new", "malloc", "I", "nan", "time", "schnörkel", "a\nb"),
    ],
)
def test_a_name_that_c_or_its_libraries_have_is_refused(
    what: str, name: str, tmp_path: Path
) -> None:
    with pytest.raises(ns.errors.InputError, match=what):
        primitive("blade").export_c(tmp_path / "out", **{what: name})
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "name",
    [
        *("noslip", "plan", "replan", "controller", "inside", "test", "example", "example_replan"),
        *("state", "weights", "goal", "memory", "STEPS", "R", "REAL", "centers", "print", "Test"),
        *("cmakelists", "noslip_state"),
    ],
)
def test_a_name_that_the_export_itself_has_is_refused(
    name: str, tmp_path: Path, uncounted: None
) -> None:
    with pytest.raises(ns.errors.InputError, match="used by the exported code itself"):
        primitive("blade").export_c(tmp_path / "out", name=name)
    assert not (tmp_path / "out").exists()


@needs_compiler
@pytest.mark.parametrize("name", ["cut", "primitive", "my_state", "class_", "Excision2"])
def test_any_other_name_compiles_and_passes(name: str, tmp_path: Path, uncounted: None) -> None:
    primitive("blade").export_c(tmp_path, name=name)
    assert run(build(tmp_path, "test.c", name)).returncode == 0


@needs_compiler
def test_numbers_of_another_rule_do_not_link(tmp_path: Path, uncounted: None) -> None:
    """Else they would run without their limits."""
    with_limits, without = tmp_path / "with", tmp_path / "without"
    primitive("limits").export_c(with_limits, name="cut")
    primitive("blade").export_c(without, name="cut")
    shutil.copy(with_limits / "cut.c", without / "cut.c")
    link = [str(CC), "-std=c99", "noslip.c", "cut.c", "test.c", "-lm", "-o", "test"]
    done = subprocess.run(link, cwd=without, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert "noslip_rule_" in done.stderr
    # Another primitive under the same rule does.
    ns.learn(demonstration(), [ns.Blade()], basis_functions=50).export_c(with_limits, name="cut")
    shutil.copy(with_limits / "cut.c", without / "cut.c")
    subprocess.run(link, cwd=without, check=True)


RUN = r"""
#include "cut_@.h"
double run_@(void);
double run_@(void) {
    @_state s;
    int failed = 0;
    @_start(&cut_@, &s);
    while (!@_done(&s)) failed += @_step(&cut_@, &s, cut_@.duration / 1e3);
    return failed + s.position[0];
}
"""


@needs_compiler
def test_two_exports_with_prefixes_make_one_program(tmp_path: Path, uncounted: None) -> None:
    made: list[str] = []
    for side, name in (("a", "blade"), ("b", "limits")):
        folder = tmp_path / name
        primitive(name).export_c(folder, name=f"cut_{side}", prefix=side)
        (folder / "run.c").write_text(RUN.replace("@", side))
        sources = ["noslip.c", "plan.c", "replan.c", "controller.c", f"cut_{side}.c", "run.c"]
        made += map(str, objects(folder, sources, CC, *STRICT))
    (tmp_path / "main.c").write_text(
        "#include <stdio.h>\ndouble run_a(void); double run_b(void);\n"
        'int main(void) { printf("%.17g %.17g", run_a(), run_b()); return 0; }\n'
    )
    link = [str(CC), *STRICT, "main.c", *made, "-lm", "-o", "main"]
    subprocess.run(link, cwd=tmp_path, check=True)
    found = [float(each) for each in run(tmp_path / "main").stdout.split()]
    for name, end in zip(("blade", "limits"), found, strict=True):
        step = primitive(name).duration / 1e3
        expected = primitive(name).rollout(time_step=step).positions[-1, 0]
        assert end == pytest.approx(expected, abs=1e-12)


@needs_compiler
@pytest.mark.parametrize("flag", ["-ffast-math", "-Ofast", "-ffinite-math-only"])
def test_mathematics_that_ignores_nan_is_refused(
    flag: str, tmp_path: Path, uncounted: None
) -> None:
    primitive("blade").export_c(tmp_path, name="cut")
    for source in ("noslip.c", "replan.c", "controller.c"):
        command = [str(CC), "-std=c99", flag, "-c", source]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode != 0
        assert "would not be noticed" in done.stderr


@pytest.mark.skipif(shutil.which("clang") is None, reason="no clang on this machine")
@pytest.mark.parametrize("name", ["blade", "limits", "breathing"])
def test_clang_has_nothing_to_say_either(name: str, tmp_path: Path, uncounted: None) -> None:
    primitive(name).export_c(tmp_path, name="cut")
    sources = ["noslip.c", "plan.c", "replan.c", "controller.c", "cut.c"]
    objects(tmp_path, [*sources, "test.c", "example.c", "example_replan.c"], "clang", *STRICT)


def test_a_file_in_place_of_the_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("")
    with pytest.raises(ns.errors.InputError, match="is a file"):
        primitive("blade").export_c(tmp_path / "out")


def test_the_command_writes_the_files_and_names_them_after_the_primitive(
    tmp_path: Path, uncounted: None, noslip: Callable[..., Any]
) -> None:
    file = primitive("blade").save(tmp_path / "my cut.json")
    out = tmp_path / "c"
    result = noslip("export", file, "--out", out, "--json")
    assert result.code == 0
    told = json.loads(result.out)
    assert sorted(Path(path).name for path in told["files"]) == sorted(
        path.name for path in out.iterdir()
    )
    assert (out / "my_cut.h").exists()


@needs_compiler
def test_what_is_not_finite_changes_nothing_and_is_told(tmp_path: Path, uncounted: None) -> None:
    primitive("blade").export_c(tmp_path, name="cut")
    (tmp_path / "poison.c").write_text(
        '#include "cut.h"\n#include <math.h>\n#include <string.h>\n'
        "int main(void) {\n"
        "    const double steps[] = {0.0, -1e-3, NAN, INFINITY};\n"
        "    noslip_state s, before;\n    int i, told = 0;\n"
        "    noslip_start(&cut, &s);\n    if (noslip_step(&cut, &s, 1e-3)) return 1;\n"
        "    for (i = 0; i < 4; ++i) {\n"
        "        before = s;\n        told += noslip_step(&cut, &s, steps[i]);\n"
        "        if (memcmp(before.position, s.position, sizeof s.position)) return 2;\n"
        "        if (before.fraction < s.fraction || before.fraction > s.fraction) return 3;\n"
        "    }\n"
        "    before = s;\n    s.position[1] = NAN;\n    told += noslip_step(&cut, &s, 1e-3);\n"
        "    s = before;\n    for (i = 0; i < 4; ++i) s.quaternion[i] = 0;\n"
        "    told += noslip_step(&cut, &s, 1e-3);\n"
        "    s = before;\n    return noslip_step(&cut, &s, 1e-3) ? 4 : told == 6 ? 0 : 5;\n}\n"
    )
    assert run(build(tmp_path, "poison.c")).returncode == 0


LATE = r"""
#include "cut.h"
#include <math.h>
#include <stdio.h>
#include <string.h>

/* A step, whole or refused; how far its motion is from its own at the end. */
static int refused(noslip_state *s, double h) {
    const noslip_state before = *s;
    return noslip_step(&cut, s, h) == 1 && memcmp(&before, s, sizeof before) == 0;
}

int main(void) {
    noslip_state s;
    int k, failed = 0;
    noslip_start(&cut, &s);
    for (k = 0; k < 10; ++k) noslip_step(&cut, &s, cut.duration / cut.steps);
    failed += !refused(&s, 101 * cut.duration) || !refused(&s, INFINITY) || !refused(&s, NAN);
    failed += !refused(&s, 0) || !refused(&s, -1);
    s.angular_velocity[0] = 1e200, s.linear_velocity[1] = 1e308;
    failed += !refused(&s, cut.duration / cut.steps) || !refused(&s, cut.duration / 3);
    noslip_start(&cut, &s);
    for (k = 0; k < 10; ++k) noslip_step(&cut, &s, cut.duration / cut.steps);
    noslip_step(&cut, &s, cut.duration / 5);
    printf("%d\n", failed);
    for (k = 0; k < 3; ++k) printf("%.17g\n", s.position[k]);
    noslip_step(&cut, &s, 100 * cut.duration);
    for (k = 0; k < 3; ++k) printf("%.17g\n", s.position[k]);
    printf("%d\n", noslip_done(&s));
    return 0;
}
"""


@needs_compiler
@pytest.mark.parametrize("name", ["blade", "breathing", "limits"])
def test_a_late_step_is_made_good_or_refused(name: str, tmp_path: Path, uncounted: None) -> None:
    dmp = primitive(name)
    dmp.export_c(tmp_path, name="cut")
    (tmp_path / "late.c").write_text(LATE)
    told = [float(line) for line in run(build(tmp_path, "late.c")).stdout.split()]
    assert told[0] == 0
    motion, step = dmp.rollout(), dmp.duration / dmp.steps
    state = dmp.initial_state()
    for _ in range(10):
        state = dmp.step(state, step)
    state = dmp.step(state, dmp.duration / 5)
    np.testing.assert_allclose(told[1:4], state.position, rtol=0, atol=1e-12)
    # Beside its own motion, whose steps are as long, if not at the same places.
    off = np.linalg.norm(motion.positions - state.position, axis=1).min()
    assert off <= 2 * motion.path_length / dmp.steps
    np.testing.assert_allclose(
        told[4:7], motion.positions[-1], rtol=0, atol=1e-4 * motion.path_length
    )
    assert told[7] == 1
    with pytest.raises(NoslipError, match="more than 100 times the motion's"):
        dmp.step(state, 101 * dmp.duration)
