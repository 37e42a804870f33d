"""The examples in the gallery: run as their own command runs them, ``--out`` a scratch file.

sphinx-gallery looks for open pyplot figures; the examples have none, they write a file.  So each is
given the file as its argument, and what it wrote is its picture.
"""

from __future__ import annotations

import ast
import shutil
import tempfile
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx
from sphinx_gallery.scrapers import figure_rst

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples"
RECORDED = "other_placement"
"""Reads recordings that lie beside the repository."""
RECORDINGS = ROOT.parent / "shared" / "data" / "contour_following"
_SCRATCH = tempfile.TemporaryDirectory(prefix="noslip-gallery-")

left_out = "__init__" if RECORDINGS.is_dir() else RECORDED


def _picture(example: str) -> Path:
    return Path(_SCRATCH.name) / f"{Path(example).stem}.png"


def arguments(gallery_conf: dict[str, Any], script: dict[str, Any]) -> list[str]:
    """Arguments of an example's command."""
    example = Path(script["src_file"])
    found = ["--out", str(_picture(example.name))]
    return [*found, "--recordings", str(RECORDINGS)] if example.stem == RECORDED else found


def written_picture(block: Any, script: dict[str, Any], gallery_conf: dict[str, Any]) -> str:
    """Move the picture that an example wrote to where the gallery wants it."""
    written = _picture(script["src_file"])
    if not written.is_file():
        return ""
    image = next(script["image_path_iterator"])
    shutil.move(written, image)
    return str(figure_rst([image], gallery_conf["src_dir"], _title(written.stem)))


def _title(example: str) -> str:
    text = ast.get_docstring(ast.parse((EXAMPLES / f"{example}.py").read_text()))
    if text is None:
        raise ValueError(f"examples/{example}.py has no docstring")
    return text.partition("\n")[0]


def underline_title(app: Sphinx, page: str, source: list[str]) -> None:
    """Make a heading of the first line of an example's docstring, which argparse shows as text.

    The page is reached from gallery.md, and is in no table of contents.
    """
    example = Path(page).name
    if "gallery/" in page and (EXAMPLES / f"{example}.py").is_file():
        title = _title(example)
        titled = source[0].replace(title, f"{title}\n{'=' * len(title)}", 1)
        source[0] = f":orphan:\n\n{titled}"


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect to Sphinx."""
    app.connect("source-read", underline_title)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
