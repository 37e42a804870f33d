"""How many instructions a function of exported C takes, counted by callgrind."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Sequence

from noslip._files import scratch


def most_instructions(
    texts: dict[str, str], sources: Sequence[str], function: str, *fine: int
) -> int | None:
    """Most instructions of a call of a function while a program runs.

    Parameters
    ----------
    texts : dict of str
        By file name.
    sources : sequence of str
        Files that make the program.
    function : str
    fine : int
        What it may exit with, besides 0.

    Returns
    -------
    int or None
        None where a C compiler or valgrind is missing, or the program fails.
    """
    compiler, valgrind = shutil.which("cc"), shutil.which("valgrind")
    if compiler is None or valgrind is None:
        return None
    with scratch() as at:
        for file, text in texts.items():
            (at / file).write_text(text, encoding="utf-8")
        build = [compiler, "-std=c99", "-O2", *sources, "-lm", "-o", "example"]
        count = [
            *(valgrind, "--tool=callgrind", f"--toggle-collect={function}"),
            *(f"--dump-after={function}", "./example"),
        ]
        for command in (build, count):
            done = subprocess.run(command, cwd=at, capture_output=True, check=False)
            if done.returncode not in (0, *fine):
                return None
        counts = [
            int(found[1])
            for dump in at.glob("callgrind.out.*.*")
            if (found := re.search(r"^(?:summary|totals): (\d+)", dump.read_text(), re.M))
        ]
    return max(counts, default=None)
