"""Each kind of motion through each part of the library: a cell of the table in ``docs/kinds.md``.

A kind says what it is learned from and under which rule; a cell is one function, the same for all
kinds, so that none is filled by a special case.  What has no cell stands in :data:`OPEN` with the
reason, and the page says the same.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import noslip as ns
from motions import planar_cut
from noslip._typing import Floats
from noslip.constraints.check import check

PAGE = Path(__file__).parents[1] / "docs" / "kinds.md"
HELD = 1e-10


@dataclass(frozen=True)
class Kind:
    """What one kind is learned from, and what its motion is made of.

    Attributes
    ----------
    demonstration : callable
    limit : Constraint
        That its motion does not touch.
    rule : tuple of Constraint
    options : mapping
        Of learning.
    """

    demonstration: Callable[[], Any]
    limit: Any
    rule: tuple[Any, ...] = ()
    options: dict[str, Any] = field(default_factory=dict)


def reached(joints: int) -> ns.Trajectory:
    """Vectors from rest to rest."""
    s = np.linspace(0, 1, 201)
    u = s**3 * (10 - 15 * s + 6 * s**2)
    each = [0.5 * (k + 1) * u + 0.1 * np.sin(2 * np.pi * u) for k in range(joints)]
    return ns.Trajectory(2 * s, np.column_stack(each), names=[f"q{k}" for k in range(joints)])


def joint_cut() -> ns.Trajectory:
    """An arm's joints, whose blade moves about along its edge."""
    home = np.array([0.0, -0.3, 0.0, -2.0, 0.0, 1.7, 0.8])
    s = np.linspace(0, 1, 101)
    u = s**3 * (10 - 15 * s + 6 * s**2)
    way = np.outer(u, [0.25, 0.1, -0.05, 0.15, 0.02, -0.05, 0.1])
    return ns.Trajectory(3 * s, home + way, names=[f"joint{k}" for k in range(1, 8)])


def joint_limit(size: int) -> Any:
    from noslip.constraints.joint_limits import JointLimits

    return JointLimits(lower=(-3.0,) * size, upper=(6.0,) * size)


KINDS = {
    "poses": Kind(
        lambda: planar_cut(count=81),
        ns.KeepOutSphere(center=(0.0, 0.0, 1.0), radius=0.1),
        (ns.Blade(),),
    ),
    "vectors": Kind(lambda: reached(3), joint_limit(3)),
    "joints": Kind(joint_cut, joint_limit(7), (ns.Blade(),), {"robot": "panda"}),
}


@cache
def learned(name: str) -> ns.ConstrainedDMP:
    kind = KINDS[name]
    if "robot" in kind.options:
        pytest.importorskip("mujoco", reason="the extra robots is not installed")
    return ns.learn(kind.demonstration(), list(kind.rule), basis_functions=30, **kind.options)


def points(motion: Any) -> Floats:
    return np.asarray(motion.points)


# ---------------------------------------------------------------- cells


def fit(name: str, tmp_path: Path) -> None:
    """What is learned follows what was demonstrated."""
    kind, dmp = KINDS[name], learned(name)
    demonstration = kind.demonstration()
    motion = dmp.rollout(time_step=demonstration.period)
    off = np.abs(motion.positions - demonstration.positions).max()
    assert off <= 0.05 * demonstration.path_length


def rollout(name: str, tmp_path: Path) -> None:
    """A motion keeps its rule at any step, and comes to its goal."""
    dmp = learned(name)
    for step in (None, 0.013):
        motion = dmp.rollout(time_step=step)
        assert np.abs(motion.constraint_residuals).max(initial=0) <= HELD
        assert np.abs(motion.positions[-1] - dmp.goal_position).max() <= 1e-3


def adapt(name: str, tmp_path: Path) -> None:
    """A new goal is reached under the rule, and saved with all it has."""
    dmp = learned(name)
    rest = {"goal_rotation": dmp.goal_rotation} if dmp.law.space.is_pose else {}
    goal = dmp.goal_position + 0.01
    there = dmp.adapt(goal_position=goal, **rest)
    motion = there.rollout()
    assert np.abs(motion.constraint_residuals).max(initial=0) <= HELD
    assert np.abs(motion.positions[-1] - goal).max() <= 1e-4
    assert ns.load_primitive(there.save(tmp_path / "there.json")) == there


def limits(name: str, tmp_path: Path) -> None:
    """A limit that nothing touches changes nothing; check finds that it holds."""
    kind, dmp = KINDS[name], learned(name)
    held = [*kind.rule, kind.limit]
    limited = ns.learn(kind.demonstration(), held, basis_functions=30, **kind.options)
    motion, own = limited.rollout(), dmp.rollout()
    assert motion.margins.min() > 0
    assert np.abs(points(motion) - points(own)).max() <= 1e-3
    if name != "joints":
        assert check(motion, held).passed


def controller(name: str, tmp_path: Path) -> None:
    """Stepped in a loop it is the rollout."""
    dmp = learned(name)
    loop, motion = dmp.controller(time_step=0.01), dmp.rollout(time_step=0.01)
    for k in range(1, len(motion)):
        command = loop.step()
        assert np.abs(command.position - motion.positions[k]).max() <= 1e-6


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
OPEN: dict[tuple[str, str], str] = {}
"""Cells that are not there yet, and why."""
FILLED = [(kind, cell) for kind in KINDS for cell in CELLS if (kind, cell) not in OPEN]


@pytest.mark.parametrize(("kind", "cell"), FILLED)
def test_a_kind_of_motion_goes_through_a_part_of_the_library(
    kind: str, cell: str, tmp_path: Path
) -> None:
    CELLS[cell](kind, tmp_path)
