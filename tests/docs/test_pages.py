"""Every block of code on every page runs as it stands: Python, and the command line.

The blocks of a page run in order, in one folder, with the files (:mod:`workshop`) and names that a
page takes for granted.  What cannot run here is listed with the reason.
"""

from __future__ import annotations

import re
import shlex
import shutil
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.cli import main

sys.path.insert(0, str(Path(__file__).parent))

import workshop

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```", re.DOTALL | re.MULTILINE)
LANGUAGES = {"python", "console", "text", "c"}
"""Of these text is a file's content, and C is compiled by tests/runtime/test_export.py."""

ELSEWHERE = {
    "noslip demo --out noslip-demo": "run once for all pages, by the fixture",
    "make": "sets up a virtual environment; CI runs these targets",
    "python3 -m venv": "installs",
    ".venv/bin/pip": "installs",
    "pip install": "installs",
    "source": "belongs to an interactive shell",
    "cmake": "built and run by tests/runtime/test_example_controller.py",
    "ssh": "needs another machine",
    "noslip topics session": "tests/test_bag_to_arm.py runs this block",
    "noslip learn session --topic": "tests/test_bag_to_arm.py runs this block",
    "noslip simulate cut.json --robot panda --level tool": "tests/test_bag_to_arm.py runs it",
    "noslip check arm/tool.csv": "tests/test_bag_to_arm.py runs this block",
    "git clone": "needs the network",
    "python -m benchmarks.obstacles": "takes minutes; tests/benchmarks has a cut of it",
    "python -m benchmarks.improving": "takes minutes; tests/test_improving.py has what it asserts",
    "python -m benchmarks.distributions": "takes an hour; tests/benchmarks has a cut of it",
    **dict.fromkeys(
        (
            "noslip learn reach.csv",
            "noslip rollout reach.json",
            "noslip adapt reach.json",
            "noslip learn joints.csv",
            "noslip view joints.csv",
            "noslip learn stirring.csv",
            "noslip rollout stirring.json",
        ),
        "of the reader's own recordings; tests/cli/test_values_command.py runs the like",
    ),
    **dict.fromkeys(
        ("noslip learn cuts/", "noslip sample cuts.json"),
        "of the reader's own recordings; tests/cli/test_sample.py runs the like",
    ),
    "python -m benchmarks.filters": "reads recordings that lie beside the repository",
    "python -m benchmarks.side_by_side": "takes minutes; tests/benchmarks has a cut of it",
    "python -m benchmarks.field": "reads data sets that lie beside the repository",
    "dask": "needs a cluster; tests/test_many.py has one",
    "noslip learn --each /shared/recordings": "needs a cluster; tests/test_many.py has one",
}
"""Commands that do not run here, by how they begin."""
NEEDS_A_CLUSTER = "tcp://10.0.0.5"
"""Python that does not run here."""
COUNTS = "export.md"
"""The page on which instructions are counted; what others export is the same."""
REFUSED = "noslip simulate excision.json --placement"
ILLUSTRATION = ("noslip learn --each", "noslip view excision.json")
"""What these print on a page is of thousands of recordings, or of a server."""
NEAR = 0.1, 1e-3
"""Numbers on a page are within this share of those printed, or both are smaller than the latter."""
NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e-?\d+)?(?![\w.]*\d)")
SMALLER = {"jobs=8": "jobs=1", "--jobs 8": "--jobs 1", "evaluations=200": "evaluations=12"}
"""A process takes a second to start, and the recordings are four; a search takes seconds."""


def pages() -> list[Path]:
    written = [page for page in DOCS.rglob("*.md") if page.relative_to(DOCS).parts[0][0] != "_"]
    return [ROOT / "README.md", *sorted(written)]


def blocks(page: Path) -> list[tuple[str, str]]:
    return BLOCK.findall(page.read_text())


def dialogue(block: str) -> list[tuple[str, str]]:
    """Commands of a console block, each with what the page says it prints, in one line."""
    told: list[tuple[str, str]] = []
    for line in re.sub(r"\\\n\s*", "", block).splitlines():
        if line.startswith("$ "):
            told.append((line[2:], ""))
        elif told:
            told[-1] = (told[-1][0], f"{told[-1][1]} {line.strip()}".strip())
    return told


def commands(block: str) -> list[str]:
    return [command for command, _ in dialogue(block)]


def assert_printed(said: str, printed: str) -> None:
    """Whether the same words were printed, with numbers near those of the page; "..." is any."""
    words = NUMBER.sub("#", said)
    pattern = re.escape(words).replace(r"\#", f"({NUMBER.pattern})").replace(r"\.\.\.", ".*")
    found = re.search(pattern, " ".join(printed.split()))
    assert found, f"the page says\n  {said}\nbut printed was\n{printed}"
    share, small = NEAR
    for there, here in zip(NUMBER.findall(said), found.groups(), strict=True):
        a, b = float(there), float(here)
        assert abs(a - b) <= max(share * abs(b), small), f"{there} on the page, {here} printed"


PAGES = [page for page in pages() if {"python", "console"} & {kind for kind, _ in blocks(page)}]


def reason_not_to_run(command: str) -> str | None:
    found = [why for begin, why in ELSEWHERE.items() if command.startswith(begin)]
    return found[0] if found else None


class Measured:
    """Where the tool is: where the last step sent it, but once 1 mm aside."""

    def __init__(self, names: dict[str, Any]) -> None:
        self.names = names
        self.asked = 0

    def __array__(self, dtype: object = None, copy: object = None) -> np.ndarray:
        self.asked += 1
        assert self.asked < 20_000, "the motion does not come to its end"
        aside = 1e-3 if self.asked == 1000 else 0.0
        return np.asarray(self.names["state"].position + np.array([0.0, aside, 0.0]))

    def tolist(self) -> list[float]:
        return np.asarray(self).tolist()


@pytest.fixture(scope="session")
def furnished(once: Callable[[str, Callable[[Path], None]], Path], demo: Path) -> Path:
    """A folder with what ``noslip demo`` writes, and what the pages take for granted."""
    for extra in ("rosbags", "pyarrow", "h5py"):
        pytest.importorskip(extra, reason="the pages' recordings need all extras")

    def furnish(folder: Path) -> None:
        shutil.copytree(demo, folder / "noslip-demo")
        own = dict(enumerate(text for kind, text in blocks(DOCS / "constraints" / "own_rule.md")))
        workshop.furnish(folder, own[0])

    return once("workshop", furnish)


@pytest.fixture
def folder(furnished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy, so that no page depends on what another wrote."""
    here = tmp_path / "here"
    shutil.copytree(furnished, here)
    monkeypatch.chdir(here)
    return here


@cache
def learned() -> tuple[ns.PoseTrajectory, ns.ConstrainedDMP]:
    """A cut, and what was learned from it."""
    hand = workshop.cut()
    return hand, ns.learn(hand, ns.Blade())


def names_of_a_page() -> dict[str, Any]:
    """Names that pages take for granted."""
    hand, dmp = learned()
    turn = Rotation.from_euler("z", 0.3)
    names: dict[str, Any] = {
        "__name__": "__main__",
        "ns": ns,
        "np": np,
        "replace": replace,
        "hand": hand,
        "recording": workshop.session(),
        "dmp": dmp,
        "LEAD": 0.00125,
        "normal": np.array([0.0, 0.0, 1.0]),
        "wrench": np.outer(workshop.session_force(), [0, 0, 1]),
        "goals": dmp.goal_position + np.linspace(0, 0.01, 8)[:, None] * [0, 1, 0],
        "durations": np.linspace(2.0, 4.0, 8),
        "turned": turn * dmp.rollout().rotations[-1],
        "R0": hand.rotations[0],
        "R1": dmp.rollout().rotations[192],
        "p0": np.array([0.2, 0.1, 0.0]),
        "g": np.array([0.2, 0.2, 0.0]),
        "Rg": Rotation.from_euler("z", np.pi / 2) * dmp.rollout().rotations[-1],
        "where_the_goal_is": dmp.goal_position + np.array([0.0, 0.002, 0.0]),
        # A robot that is where it was sent, seen by nobody.
        "camera": SimpleNamespace(has_seen=lambda: False),
        "robot": SimpleNamespace(command=lambda position, rotation: None),
    }
    names["where_the_tool_is"] = Measured(names)
    return names


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_block_of_a_page_runs(
    page: Path,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    request: pytest.FixtureRequest,
) -> None:
    if page.name != COUNTS:
        request.getfixturevalue("uncounted")
    names = names_of_a_page()
    for kind, block in blocks(page):
        for text, smaller in SMALLER.items():
            block = block.replace(text, smaller)
        if kind == "python" and NEEDS_A_CLUSTER not in block:
            exec(compile(block, page.name, "exec"), names)
        elif kind == "console":
            for command, said in dialogue(block):
                if reason_not_to_run(command) is None:
                    printed = run(command, monkeypatch, capsys)
                    if not command.startswith(ILLUSTRATION):
                        assert_printed(said, printed)
    # Matplotlib's state is everybody's.
    assert mpl.get_backend().lower() == "agg"


def interrupt(seconds: float) -> None:
    raise KeyboardInterrupt


def run(command: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> str:
    """Run a command of noslip's as the shell would; only ``check`` may find a violation.

    A command that a page shows being refused must be.
    """
    words = shlex.split(command, comments=True)
    assert words[0] == "noslip", f"{command}: not run, and not listed as such"
    found = [
        sorted(map(str, Path().glob(word))) if "*" in word and "(" not in word else [word]
        for word in words
    ]
    monkeypatch.setattr(sys, "argv", [word for several in found for word in several])
    # A page in the browser is served until someone ends it.
    monkeypatch.setattr("noslip.cli.view.time", SimpleNamespace(sleep=interrupt))
    monkeypatch.setattr("noslip.cli.view.webbrowser", SimpleNamespace(open=str))
    with pytest.raises(SystemExit) as done:
        main()
    told = capsys.readouterr()
    fine = {"check": {0, None, 1}, "view": {0, None, 130}}.get(words[1], {0, None})
    if command.startswith(REFUSED):
        fine = {2}
    assert done.value.code in fine, f"{command}: exit code {done.value.code}\n{told.err}{told.out}"
    return told.out + told.err


def test_each_name_of_the_library_on_a_page_is_there() -> None:
    for page in pages():
        for dotted in re.findall(r"\bns((?:\.[A-Za-z_]\w*)+)", page.read_text()):
            found = ns
            for name in dotted[1:].split("."):
                assert hasattr(found, name), f"{page.name}: ns{dotted}"
                found = getattr(found, name)


def test_every_block_names_its_language() -> None:
    for page in pages():
        fences = re.findall(r"^```(.*)$", page.read_text(), re.MULTILINE)
        opened = fences[::2]
        known = {fence for fence in opened if not fence.startswith("{")}
        assert known <= LANGUAGES, f"{page.name}: {known - LANGUAGES}"
        assert all(not closing for closing in fences[1::2]), f"{page.name}: a fence is not closed"


def test_what_does_not_run_is_on_a_page() -> None:
    told = [
        command
        for page in pages()
        for kind, block in blocks(page)
        if kind == "console"
        for command in commands(block)
    ]
    assert len(told) > 60
    for begin in ELSEWHERE:
        assert any(command.startswith(begin) for command in told), f"{begin}: on no page any more"
