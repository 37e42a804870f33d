"""A shield's stream as C99 in a folder, for a robot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from noslip._files import write_beside
from noslip._typing import Floats
from noslip.codegen import c99
from noslip.constraints.system import ConstraintSystem
from noslip.errors import InputError
from noslip.exporting.counting import most_instructions
from noslip.exporting.export import Exported
from noslip.exporting.names import checked, prefixed
from noslip.projection.metric import Metric
from noslip.runtime.state import State
from noslip.shielding.follower import Follower
from noslip.shielding.sources import sources

_COMPARED, _EVERY, _LATE = 100, 10, 3
"""Commands of the stream that the generated test compares, periods between two, and how many of
them late the tool is measured."""


def export_c(
    system: ConstraintSystem,
    period: float,
    metric: Metric,
    folder: str | Path,
    *,
    prefix: str = "noslip",
) -> Exported:
    """Write what follows commands under constraints as C99; see :meth:`noslip.Shield.export_c`."""
    checked("prefix", prefix)
    folder = Path(folder)
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder} is a file; give the name of a folder")
    follower = Follower(system, period, metric)
    commands = _commands()
    expected = _followed(follower, commands)
    reach = max(1.0, float(np.abs(expected[:, :3]).max()))
    texts = sources(follower.rule, period)
    texts["shield_example.c"] = c99.template("shield_example.c")
    texts["shield_test.c"] = c99.template("shield_test.c")
    for name, value in {
        "EVERY": str(_EVERY),
        "LATE": str(_LATE),
        "COMMANDS": _table(commands),
        "EXPECTED": _table(expected),
        "DIFFERENCE": repr(1e-12 * reach),
    }.items():
        texts["shield_test.c"] = texts["shield_test.c"].replace(f"@{name}@", value)
    files = [file for file in texts if file in ("shield.c", "grids.c", "shield_example.c")]
    instructions = most_instructions(texts, files, "noslip_shield_step")
    told = (
        f"At most {instructions} instructions in shield_example.c (callgrind, x86-64, -O2)."
        if instructions
        else "Instructions were not counted (that takes a C compiler and valgrind)."
    )
    texts["shield.h"] = texts["shield.h"].replace("@BOUND@", f" * {told}")
    folder.mkdir(parents=True, exist_ok=True)
    texts = prefixed(texts, prefix)
    written = [write_beside(folder / file, text.encode()) for file, text in texts.items()]
    return Exported(tuple(written), instructions, None)


def _commands() -> Floats:
    """A hand that moves in a wave and jumps once, away from where rules may be undefined."""
    s = np.linspace(0, 1, _COMPARED)
    jump = 0.02 * (s > 0.6)
    position = np.column_stack([0.3 + 0.1 * s, 0.1 + 0.02 * np.sin(6 * s) + jump, 0.2 + 0.01 * s])
    turn = np.column_stack([0.1 * s, 0.05 * np.cos(5 * s), 0.4 * np.sin(4 * s)])
    return np.hstack([position, Rotation.from_rotvec(turn).as_quat(scalar_first=True)])


def _followed(follower: Follower, commands: Floats) -> Floats:
    """Poses, shape (N, 7), in which the tool is when the next command comes."""
    found: list[State] = []
    for k, row in enumerate(commands):
        measured = found[k - _LATE] if k >= _LATE else None
        state = follower.step((row[:3], Rotation.from_quat(row[3:], scalar_first=True)), measured)
        for _ in range(_EVERY - 1):
            state = follower.step()
        found.append(state)
    return np.array([state.vector()[:7] for state in found])


def _table(rows: Floats) -> str:
    return ",\n".join("    {" + ", ".join(map(repr, row)) + "}" for row in rows.tolist())
