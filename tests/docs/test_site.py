"""The site builds without a warning, and its own links and names are all there."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import noslip
from noslip import figures
from waiting import PATIENCE

pytest.importorskip("myst_nb", reason="needs the extra docs")
pytest.importorskip("sphinx_gallery", reason="needs the extra docs")
inventory = pytest.importorskip("sphinx.util.inventory", reason="needs the extra docs")

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
FETCHED = re.compile(r"""<(?:script|img|link rel="stylesheet")[^>]* (?:src|href)="(?:https?:)?//""")
"""What a browser would get from elsewhere to show a page."""
NOTEBOOKS = sorted((DOCS / "notebooks").glob("*.ipynb"))
sys.path.insert(0, str(DOCS / "_ext"))

from links import broken_links  # noqa: E402 - found on the path above


@pytest.fixture(scope="module")
def site(once: Callable[[str, Callable[[Path], None]], Path]) -> Path:
    """The built pages."""
    return once("site", build) / "built"


def build(folder: Path) -> None:
    """Build the pages.

    The examples and the notebooks have tests of their own and are not run again; all else is as
    ``make docs`` builds it, from a copy, since the gallery writes beside its source.
    """
    copy, out = folder / "source", folder / "built"
    copy.mkdir()
    for part in ("docs", "examples"):
        (copy / part).mkdir()
        for path in (ROOT / part).rglob("*"):
            inside = path.relative_to(ROOT)
            if path.is_file() and not {"_build", "_generated"} & set(inside.parts):
                (copy / inside).parent.mkdir(parents=True, exist_ok=True)
                (copy / inside).write_bytes(path.read_bytes())
    unrun = ["-D", "plot_gallery=0", "-D", "nb_execution_mode=off"]
    command = [sys.executable, "-m", "sphinx", "--fail-on-warning", "--quiet", *unrun]
    source = {"PYTHONPATH": os.pathsep.join([str(ROOT / "src"), os.environ.get("PYTHONPATH", "")])}
    done = subprocess.run(
        [*command, str(copy / "docs"), str(out)],
        env=os.environ | source,
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=False,
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_no_link_is_broken(site: Path) -> None:
    assert len(list(site.rglob("*.html"))) > 60
    assert broken_links(site) == []


@pytest.mark.slow
@pytest.mark.parametrize("module", [noslip, figures], ids=lambda module: module.__name__)
def test_the_reference_has_every_public_name(site: Path, module: object) -> None:
    with (site / "objects.inv").open("rb") as file:
        known = inventory.InventoryFile.load(file, "", lambda base, uri: uri)
    names = {name for kind, found in known.items() if kind.startswith("py:") for name in found}
    asked = {f"{module.__name__}.{name}" for name in module.__all__ if name != "__version__"}
    assert asked <= names, sorted(asked - names)


def test_an_interrupted_build_begins_anew(tmp_path: Path) -> None:
    if shutil.which("make") is None:
        pytest.skip("no make on this machine")
    shutil.copy(ROOT / "Makefile", tmp_path)
    builder = tmp_path / "bin" / "sphinx-build"
    builder.parent.mkdir()
    make = ["make", "docs", "--old-file=.venv/.dev", "BIN=bin"]

    def build_with(*lines: str) -> bool:
        """Whether make is content with a builder of these lines."""
        builder.write_text("\n".join(["#!/bin/sh", *lines]))
        builder.chmod(0o755)
        done = subprocess.run(make, cwd=tmp_path, capture_output=True, text=True, check=False)
        return done.returncode == 0

    half = "docs/_build/html/half docs/_generated/half"
    start = ["mkdir -p docs/_build/html docs/_generated", f"touch {half}"]
    assert not build_with(*start, "kill -9 $$")
    assert build_with(
        "for f in docs/_build/html docs/_generated; do test ! -e $f || exit 1; done", *start
    )
    # What was built to its end is there for the next one.
    assert build_with(f"for f in {half}; do test -e $f || exit 1; done")


@pytest.mark.slow
def test_no_page_needs_a_network(site: Path) -> None:
    wanting = [path for path in site.rglob("*.html") if FETCHED.search(path.read_text())]
    assert wanting == []
    assert FETCHED.search(
        '<script defer="defer" src="https://cdn.jsdelivr.net/npm/mathjax@4/x.js">'
    )


def test_broken_links_are_found(tmp_path: Path) -> None:
    (tmp_path / "b.html").write_text('<p id="here">')
    (tmp_path / "a.html").write_text(
        '<a href="b.html#here">.</a><a href="b.html#gone">.</a><a href="#top">.</a>'
        '<img src="c.png"><a href="https://example.org/x">.</a><a href="http:/one">.</a>'
    )
    assert broken_links(tmp_path) == [
        "a.html: #top: no such anchor",
        "a.html: b.html#gone: no such anchor",
        "a.html: c.png: no such file",
        "a.html: http:/one: not an address",
    ]


def test_links_of_the_readme_lead_somewhere() -> None:
    links = re.findall(r"\]\(([^)]+)\)", (ROOT / "README.md").read_text())
    assert len(links) > 8
    for link in links:
        if not link.startswith("https://"):
            assert (ROOT / link.partition("#")[0]).is_file(), link


def test_each_erratum_and_equation_of_the_paper_is_on_its_page() -> None:
    page = (DOCS / "paper.md").read_text()
    told = re.findall(r"^\| ([\d, –]+) \|", page.partition("## Figures")[0], re.MULTILINE)
    numbers = set()
    for cell in told:
        for part in cell.split(","):
            first, _, last = part.strip().partition("–")
            numbers |= set(range(int(first), int(last or first) + 1))
    assert numbers == set(range(1, 23))


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebooks_are_kept_without_outputs(notebook: Path) -> None:
    cells = json.loads(notebook.read_text())["cells"]
    assert all(not cell.get("outputs") and not cell.get("execution_count") for cell in cells)


@pytest.mark.slow
@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebooks_run(notebook: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    nbclient = pytest.importorskip("nbclient", reason="needs the extra dev")
    nbformat = pytest.importorskip("nbformat", reason="needs the extra dev")
    monkeypatch.setenv("PYTHONPATH", str(ROOT / "src"))
    content = nbformat.read(notebook, as_version=4)
    resources = {"metadata": {"path": str(tmp_path)}}
    nbclient.NotebookClient(
        content, timeout=int(PATIENCE), kernel_name="python3", resources=resources
    ).execute()
    shown = [output for cell in content.cells for output in cell.get("outputs", [])]
    assert any("image/png" in output.get("data", {}) for output in shown)
