"""The examples run and hold what they show; the pages about constraints are complete and true."""

from __future__ import annotations

import importlib
import re
import runpy
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from noslip.constraints.catalog import CATALOG, parse_constraint
from noslip.constraints.check import check
from noslip.errors import MissingDependencyError

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES = sorted(path.stem for path in (ROOT / "examples").glob("*.py"))
DOCS = ROOT / "docs"
INDEX = DOCS / "constraints" / "index.md"
PAGES = sorted(page for part in ("constraints", "goals") for page in (DOCS / part).glob("*.md"))
ALL_PAGES = [*PAGES, *DOCS.glob("concepts/*.md"), *DOCS.glob("*.md")]
LARGEST_PICTURE = 200_000

# What these show is that limits give way, or that a start or a metric holds less.
GIVE_WAY = {"any_start", "metric", "priorities"}
# Limits lead these around, and not into a stop: what is learned, and where it was to arrive.
ARRIVE = {"keep_out": ("motion", "hand"), "travel": ("wide", "cart")}
FAR = 0.01
# What these execute comes of many chunks or primitives; its residuals are those of the poses.
EXECUTED = {"rhythms": "blade", "shielded_policy": "blade"}
# These read recordings that lie beside the repository.
RECORDED = {"other_placement"}
# This one has no constraint.
UNCONSTRAINED = {"primitive"}
HEADER = re.compile(r"# /// script\n((?:# .*\n)+)# ///\n")
RECORDINGS = ROOT.parent / "shared" / "data"


def run(name: str, monkeypatch: pytest.MonkeyPatch, *arguments: str) -> dict[str, Any]:
    """Run an example as its command would; a warning is an error here."""
    script = ROOT / "examples" / f"{name}.py"
    monkeypatch.setattr(sys, "argv", [str(script), *arguments])
    return runpy.run_path(str(script), run_name="__main__")


def header(name: str) -> tuple[dict[str, Any], str]:
    """Return what an example says that it needs (PEP 723), and the rest of it."""
    text = (ROOT / "examples" / f"{name}.py").read_text()
    found = HEADER.match(text)
    assert found, f"examples/{name}.py: begins with no '# /// script'"
    return tomllib.loads(found[1].replace("# ", "")), text[found.end() :]


def extras(name: str) -> set[str]:
    """Return the extras of noslip that an example's header names."""
    needs, _ = header(name)
    (noslip,) = needs["dependencies"]
    named = re.fullmatch(r"noslip(?:\[(\w+(?:,\w+)*)\])?", noslip)
    assert named, noslip
    return set(named[1].split(",")) if named[1] else set()


def brought() -> dict[str, str]:
    """Return the extra that brings each package, of those that bring packages themselves."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    found = {}
    for extra, needs in project["optional-dependencies"].items():
        if extra not in ("bench", "docs", "dev"):
            found |= {re.split(r"[\[>=<!~]", need)[0].lower(): extra for need in needs}
    return found


def is_png(path: Path) -> bool:
    return path.read_bytes().startswith(b"\x89PNG\r\n\x1a\n")


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_draws_its_picture_and_holds_its_constraints(
    name: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "picture.png"
    asked: set[str] = set()

    def import_module(module: str) -> Any:
        asked.add(module.partition(".")[0])
        return importlib.import_module(module)

    monkeypatch.setattr("noslip._extras.importlib", SimpleNamespace(import_module=import_module))
    if name in RECORDED and not RECORDINGS.is_dir():
        pytest.skip("the recordings (../shared/data, seen from the repository) are absent")
    monkeypatch.chdir(ROOT)
    try:
        found = run(name, monkeypatch, "--out", str(out))
    except MissingDependencyError as error:
        assert extras(name), error
        pytest.skip(str(error))
    assert is_png(out)
    assert list(tmp_path.iterdir()) == [out]
    packages = packages_distributions()
    needed = {name.lower() for module in asked for name in packages[module]} & set(brought())
    assert {brought()[package] for package in needed} == extras(name)
    assert name in UNCONSTRAINED or re.search(r"residual|margin", capsys.readouterr().out)
    if name in GIVE_WAY:
        return
    motion = found["motion"]
    if name in EXECUTED:
        assert check(motion, found[EXECUTED[name]]).peak <= 1e-10
        return
    assert np.abs(motion.constraint_residuals).max(initial=0) <= 1e-10
    assert motion.gave_way == ()
    if name in ARRIVE:
        learned, demonstrated = (found[variable] for variable in ARRIVE[name])
        missed = np.linalg.norm(learned.positions[-1] - demonstrated.positions[-1])
        assert missed <= FAR * demonstrated.path_length


def test_without_an_argument_the_picture_lies_in_the_current_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    run("blade", monkeypatch)
    assert is_png(tmp_path / "blade.png")


def test_each_example_is_about_one_screen_of_the_public_interface() -> None:
    for name in EXAMPLES:
        needs, text = header(name)
        assert needs["requires-python"] == ">=3.11"
        # In a checkout, before there is a release to install.
        assert needs["tool"]["uv"]["sources"]["noslip"] == {"path": ".."}
        assert len(text.splitlines()) <= 90, name
        imported = set(re.findall(r"^(?:from|import) (\S+)", text, re.MULTILINE))
        public = {"argparse", "dataclasses", "numpy", "matplotlib.lines", "scipy.spatial.transform"}
        # What is told of a compromise may be expected.
        public |= {"warnings"}
        assert imported <= public | {"noslip", "noslip.figures", "noslip.shielding"}, name


@pytest.mark.parametrize("name", EXAMPLES)
def test_each_example_has_a_page_with_its_picture(name: str) -> None:
    (page,) = (page for page in ALL_PAGES if f"python examples/{name}.py" in page.read_text())
    text = page.read_text()
    assert re.search(rf"\]\((\.\./)?images/{name}\.png\)", text)
    picture = ROOT / "docs" / "images" / f"{name}.png"
    assert is_png(picture)
    assert picture.stat().st_size <= LARGEST_PICTURE
    own = page.parent / "index.md"
    index = own if own.exists() else DOCS / "index.md"
    listed = " ".join(re.findall(r"```\{toctree\}\n(.*?)```", index.read_text(), re.DOTALL))
    assert page.relative_to(index.parent).with_suffix("").as_posix() in listed.split()
    gallery = (DOCS / "gallery.md").read_text()
    assert f"](images/{name}.png)]({page.relative_to(DOCS)})" in gallery


def test_each_page_of_a_constraint_or_goal_belongs_to_an_example() -> None:
    for page in PAGES:
        # What a page draws itself needs no example.
        if page.stem != "index" and ".. plot::" not in page.read_text():
            named = re.findall(r"python examples/(\w+)\.py", page.read_text())
            assert page.stem in named
            assert set(named) <= set(EXAMPLES)


def test_the_overview_and_a_page_name_each_constraint_of_the_catalog() -> None:
    overview = INDEX.read_text()
    pages = {path.stem: path.read_text() for path in PAGES if path.stem != "index"}
    for constraint in CATALOG.values():
        name = f"`{constraint.__name__}`"
        row = next(line for line in overview.splitlines() if line.startswith("|") and name in line)
        (page,) = re.findall(r"\]\((\w+)\.md\)", row)[:1]
        assert constraint.__name__ in pages[page]


def test_constraints_on_the_command_line_are_understood() -> None:
    texts = [
        quoted or plain
        for page in PAGES
        for quoted, plain in re.findall(r'--constraint (?:"([^"]+)"|(\S+))', page.read_text())
    ]
    own = [text for text in texts if ".py:" in text]
    assert len(texts) > 15
    assert own
    for text in set(texts) - set(own):
        parse_constraint(text)


CLASSES = ["holonomic", "non-holonomic", "scleronomic", "rheonomic", "catastatic", "acatastatic"]


def test_each_class_of_the_paper_has_a_constraint_an_example_and_a_test() -> None:
    rows = [line.split("|")[1:-1] for line in INDEX.read_text().splitlines() if "examples/" in line]
    table = {row[0].strip(): row[1:] for row in rows if len(row) == 5}
    assert list(table) == CLASSES
    for _, constraint, example, _ in table.values():
        assert re.search(r"`\w+", constraint)
        assert (ROOT / example.strip().strip("`")).is_file()


def test_the_tests_that_the_pages_name_exist() -> None:
    named = {
        found
        for page in PAGES
        for found in re.findall(r"(tests/[\w/]+\.py)::(\w+)", page.read_text())
    }
    assert len(named) >= len(CLASSES)
    for file, test in named:
        assert f"def {test}(" in (ROOT / file).read_text(), test
