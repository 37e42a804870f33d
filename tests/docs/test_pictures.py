"""The pictures of the pages: each is drawn by one command, is small, and is shown with words."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest
from PIL import Image

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
IMAGES = DOCS / "images"
PAGES = [ROOT / "README.md", *DOCS.glob("*.md"), *DOCS.glob("*/*.md")]
LARGEST = 100_000
"""Bytes of a picture."""
FEWEST_WORDS = 5
"""Of what stands for a picture that is not seen."""


def test_the_command_that_draws_pictures_draws_those_that_there_are() -> None:
    commands = runpy.run_path(str(DOCS / "draw.py"))["commands"](Path(), Path())
    assert set(commands) == {path.stem for path in IMAGES.iterdir()}
    for name, (script, *_) in commands.items():
        assert script == "-m" or (ROOT / script).is_file(), name


@pytest.mark.parametrize("path", sorted(IMAGES.iterdir()), ids=lambda path: path.stem)
def test_each_picture_is_small_and_a_page_shows_it_with_words(path: Path) -> None:
    assert path.stat().st_size <= LARGEST
    with Image.open(path) as picture:
        # Twice the width of a page's text, so that it is sharp there, and not much more.
        assert 1000 <= picture.width <= 1500
    shown = [
        words
        for page in PAGES
        for words in re.findall(rf"!\[([^\]]*)\]\([^)]*images/{path.name}\)", page.read_text())
    ]
    assert shown
    assert all(len(words.split()) >= FEWEST_WORDS for words in shown), shown
