"""What the page "When it cannot be done" quotes is what the program says."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import pytest

from noslip.constraints.catalog import CATALOG

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "refusals.md"
NAMES = "|".join([*CATALOG, "cut", "times", "seconds", "via 0.5", "heading"])
GIVEN = re.compile(
    rf"(?<!\w)('(?!shared)[^']+'|{NAMES}|atan2\(0, 0\)|-?[\d.]+(e-?\d+)?)(?!\w)|; |\.\.\."
)
"""What a message is filled with: names, numbers, another message."""
MOST_PIECES = 3
"""Of texts that the source puts together between two fillings."""


@cache
def source() -> str:
    """All texts of the library; a newline where one is filled in, and between them."""
    texts = []
    for path in (ROOT / "src" / "noslip").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                texts.append(f"\n{node.value}\n")
    return "".join(texts)


def is_said(words: list[str], pieces: int = MOST_PIECES) -> bool:
    """Whether words stand in the source, in so many pieces at most."""
    if not words:
        return True
    return pieces > 0 and any(
        " ".join(words[:n]) in source() and is_said(words[n:], pieces - 1)
        for n in range(len(words), 0, -1)
    )


def quoted() -> list[str]:
    cells = [line.split("|")[1] for line in PAGE.read_text().splitlines() if line.startswith("| ")]
    return [text for cell in cells for text in re.findall(r'"([^"]+)"', cell)]


@pytest.mark.parametrize("text", quoted())
def test_what_is_quoted_is_said(text: str) -> None:
    for said in filter(None, (part.strip(" (),:;%") for part in GIVEN.sub("\n", text).split("\n"))):
        assert is_said(said.split()), said


def test_the_page_quotes_every_kind() -> None:
    assert len(quoted()) > 35
    assert not is_said(["the", "motion", "arrives", "late", "and", "is", "sorry"])
