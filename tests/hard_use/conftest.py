"""Counts trials, and ends with a table of them by kind."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

import pytest

KINDS = {
    "test_exported_c": "what exported C is given",
    "test_fuzz": "damage at random",
    "test_outputs": "outputs under kills, locks and full disks",
    "test_strange_bags": "bags from strangers",
    "test_strangers": "files from strangers",
    "test_user_rules": "users' rules",
    "test_viewer_doors": "the viewer's doors",
}
"""What the trials of each file are."""
COUNTED = "trials"


_running: list[pytest.Item] = []


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Remember which test runs."""
    _running[:] = [item]


@pytest.fixture(scope="session")
def trials() -> Callable[[int], None]:
    """Say that a test made so many trials by itself; Hypothesis takes none but of the session."""
    return lambda count: _running[0].user_properties.append((COUNTED, count))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print how many were tried, and how many survived; a test's trials survive together."""
    tried: Counter[str] = Counter()
    survived: Counter[str] = Counter()
    for outcome in ("passed", "failed"):
        for report in terminalreporter.getreports(outcome):
            name = report.nodeid.partition("::")[0].rpartition("/")[2].removesuffix(".py")
            if report.when == "call" and "hard_use/" in report.nodeid:
                kind = KINDS.get(name, name)
                count = sum(n for key, n in report.user_properties if key == COUNTED) or 1
                tried[kind] += count
                survived[kind] += count if report.passed else 0
    if tried:
        terminalreporter.section("trials")
        for kind in sorted(tried):
            terminalreporter.line(f"{tried[kind]:6} tried {survived[kind]:6} survived  {kind}")
        terminalreporter.line(f"{tried.total():6} tried {survived.total():6} survived  in all")
