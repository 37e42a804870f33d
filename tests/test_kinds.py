"""Each kind of motion through each part of the library: a cell of the table in ``docs/kinds.md``.

A kind says what it is learned from and under which rule; a cell is one function, the same for all
kinds, so that none is filled by a special case.  What has no cell stands in :data:`OPEN` with the
reason, and the page says the same.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import noslip as ns
from kinds import KINDS, learned
from noslip._typing import Floats
from noslip.constraints.check import check

PAGE = Path(__file__).parents[1] / "docs" / "kinds.md"
HELD = 1e-10


def points(motion: Any) -> Floats:
    return np.asarray(motion.points)


# ---------------------------------------------------------------- cells


def fit(name: str, tmp_path: Path) -> None:
    """What is learned follows what was demonstrated."""
    kind, dmp = KINDS[name], learned(name)
    demonstration = kind.demonstration()
    motion = dmp.rollout(time_step=demonstration.period)
    off = np.abs(motion.positions - demonstration.positions).max()
    # A blade that is held askew turns, and so do the joints that carry it.
    assert off <= 0.12 * demonstration.path_length


def rollout(name: str, tmp_path: Path) -> None:
    """A motion keeps its rule at any step, and comes to its goal."""
    dmp = learned(name)
    for step in (None, 0.013):
        motion = dmp.rollout(time_step=step)
        assert np.abs(motion.constraint_residuals).max(initial=0) <= HELD
        ends = KINDS[name].demonstration().positions[-1]
        assert np.abs(motion.positions[-1] - ends).max() <= 0.05


def adapt(name: str, tmp_path: Path) -> None:
    """A new goal is reached under the rule, and saved with all it has."""
    dmp = learned(name)
    whole = dmp.law.space.rotations and not dmp.law.clock.returns
    rest = {"goal_rotation": dmp.goal_rotation} if whole else {}
    goal = dmp.goal_position + 0.01
    there = dmp.adapt(goal_position=goal, **rest)
    motion = there.rollout()
    assert np.abs(motion.constraint_residuals).max(initial=0) <= HELD
    # A rhythm goes around it.
    ends = motion.positions[:-1].mean(axis=0) if dmp.law.clock.returns else motion.positions[-1]
    assert np.abs(ends - goal).max() <= 1e-4
    assert ns.load_primitive(there.save(tmp_path / "there.json")) == there


def limits(name: str, tmp_path: Path) -> None:
    """A limit that nothing touches changes nothing; check finds that it holds."""
    kind, dmp = KINDS[name], learned(name)
    held = [*kind.rule, kind.limit]
    limited = ns.learn(kind.demonstration(), held, basis_functions=30, **kind.options)
    motion, own = limited.rollout(), dmp.rollout()
    assert motion.margins.min() > 0
    assert np.abs(points(motion) - points(own)).max() <= 1e-3
    assert check(motion, held).satisfied


def controller(name: str, tmp_path: Path) -> None:
    """Stepped in a loop it comes to its goal under its rule; a rhythm goes on as in a rollout."""
    dmp = learned(name)
    loop, returns = dmp.controller(time_step=0.01), dmp.law.clock.returns
    commands = [loop.step() for _ in range(2 * round(dmp.duration / 0.01))]
    assert loop.done != returns
    residuals = [np.abs(command.constraint_residuals).max(initial=0) for command in commands]
    assert max(residuals) <= HELD
    motion = dmp.rollout(time_step=0.01, cycles=2 if returns else 1)
    assert np.abs(commands[-1].position - motion.positions[-1]).max() <= 1e-3


def export(name: str, tmp_path: Path) -> None:
    """It is written as C."""
    learned(name).export_c(tmp_path / "c")
    written = (tmp_path / "c" / "noslip.c").read_text()
    assert "noslip_step" in written


def figure(name: str, tmp_path: Path) -> None:
    """Its motion is drawn."""
    from noslip.figures import save_figure

    out = tmp_path / "motion.png"
    save_figure(learned(name).rollout().plot(), out)
    assert out.read_bytes().startswith(b"\x89PNG")


CELLS: dict[str, Callable[[str, Path], None]] = {
    "fit": fit,
    "rollout": rollout,
    "adapt": adapt,
    "limits": limits,
    "controller": controller,
    "C": export,
    "figures": figure,
}
ELSEWHERE = {
    ("poses", "C"): "tests/runtime/test_replan_in_c.py",
    ("poses", "figures"): "tests/test_faces.py",
}
"""Cells that many tests fill, and where."""
FILLED = [(kind, cell) for kind in KINDS for cell in CELLS if (kind, cell) not in ELSEWHERE]


@pytest.mark.parametrize(("kind", "cell"), FILLED)
def test_a_kind_of_motion_goes_through_a_part_of_the_library(
    kind: str, cell: str, tmp_path: Path
) -> None:
    CELLS[cell](kind, tmp_path)


def test_the_page_has_a_row_a_kind_and_a_cell_a_part() -> None:
    rows = [
        re.split(r"\s*\|\s*", line)[1:-1] for line in PAGE.read_text().splitlines() if "|" in line
    ]
    head, _, *body = rows
    assert head[1:] == list(CELLS)
    assert [row[0].split(",")[0] for row in body] == list(KINDS)
    for kind, row in zip(KINDS, body, strict=True):
        assert row[1:] == ["yes"] * len(CELLS), kind


def test_tests_that_fill_cells_elsewhere_exist() -> None:
    for place in ELSEWHERE.values():
        assert (PAGE.parents[1] / place).is_file()
