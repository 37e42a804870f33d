"""The page of peers' tests names tests that exist."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs" / "peers.md").read_text()


def test_each_test_that_the_page_names_exists() -> None:
    named = set(re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", TEXT))
    assert len(named) > 20
    missing = [
        f"{file}::{test}"
        for file, test in sorted(named)
        if not (ROOT / file).is_file() or f"def {test}(" not in (ROOT / file).read_text()
    ]
    assert missing == []


def test_each_row_has_a_test_or_a_reason() -> None:
    rows = [line.split("|")[1:-1] for line in TEXT.splitlines() if line.startswith("|")]
    rows = [[cell.strip() for cell in row] for row in rows]
    told = [row for row in rows if not row[1].startswith(("---", "our test", "why not"))]
    assert len(told) > 30
    without = TEXT.split("## movement_primitives: without counterpart")[1].split("\n## ")[0]
    for row in told:
        has_test = "`tests/" in row[1] or row[1].startswith("none")
        assert has_test or f"| {row[1]} |" in without, row[0]
