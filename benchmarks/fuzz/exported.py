"""Builds and runs ``exported.c``: the exported step and controller under whatever comes."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import noslip as ns
from benchmarks.fuzz.targets import motion
from noslip.errors import muted

HERE = Path(__file__).parent
SANITIZED = "-fsanitize=address,undefined,float-cast-overflow"
FLAGS = ("-std=c99", "-O1", "-D_XOPEN_SOURCE=600", "-fno-sanitize-recover=all", "-I.")
SOURCES = ("noslip.c", "plan.c", "replan.c", "controller.c", "cut.c")


def build(folder: Path) -> Path:
    """Compile the target beside an exported ``cut``; ``guided`` where libFuzzer is installed.

    Of what was compiled in this folder before, only texts that changed since are again.

    Raises
    ------
    subprocess.CalledProcessError
        If nothing compiles with sanitizers.
    """
    probe = "int LLVMFuzzerTestOneInput(void) { return 0; }"
    linked = ["clang", f"{SANITIZED},fuzzer", "-xc", "-", "-o", "guided"]
    if shutil.which("clang") and not _done(linked, folder, probe).returncode:
        compiler, name = ["clang", f"{SANITIZED},fuzzer"], "guided"
    else:
        compiler, name = ["cc", SANITIZED, "-DDRIVEN"], "driven"
    sources = [*(folder / source for source in SOURCES), HERE / "exported.c"]
    objects = [folder / f"{source.stem}.{name}.o" for source in sources]
    for source, made in zip(sources, objects, strict=True):
        if not made.exists() or made.stat().st_mtime_ns < source.stat().st_mtime_ns:
            command = [*compiler, *FLAGS, f"-I{HERE.parent}", "-c", str(source), "-o", str(made)]
            _done(command, folder).check_returncode()
    _done([*compiler, *map(str, objects), "-lm", "-o", name], folder).check_returncode()
    return folder / name


def run(program: Path, executions: int, seed: int) -> subprocess.CompletedProcess[str]:
    """Run the target; what it says, and 0 if nothing happened that must never."""
    given = [str(executions), str(seed)]
    if program.name == "guided":
        given = [f"-runs={executions}", f"-seed={seed}", "-max_len=1024"]
    return _done([str(program), *given], program.parent)


def export(folder: Path) -> Path:
    """Export a blade's primitive as ``cut``."""
    with muted():
        return ns.learn(motion(), [ns.Blade()], basis_functions=10).export_c(folder, name="cut")


def _done(
    command: list[str], folder: Path, given: str | None = None
) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command, cwd=folder, input=given, capture_output=True, text=True, check=False
    )
