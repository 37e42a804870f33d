"""A primitive as C99 in a folder, for a robot: no heap, no library but libm, parameters as data."""

from __future__ import annotations

import hashlib
import textwrap
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from noslip._files import write_beside
from noslip._typing import Floats
from noslip.adapting.sources import sources
from noslip.codegen import c99
from noslip.control.sources import sources as controller_sources
from noslip.errors import InputError
from noslip.exporting.counting import most_instructions
from noslip.exporting.names import checked, named, prefixed
from noslip.law.channels import Channels
from noslip.law.fitting import fewest_steps
from noslip.law.law import Law
from noslip.rule import Rule
from noslip.runtime import numbers
from noslip.runtime.rollout import rollout
from noslip.runtime.stepper import stepper_of
from noslip.space import Space

_COMPARED = 100
"""Samples of the motion that the generated test compares, about."""
_NO_PLAN = 1
"""Status of an example whose plan does not arrive: another goal than the example's might."""
_PLACEHOLDER = "primitive_of_this_export"
"""Where the name goes, until it is known not to be taken."""
"""And names that the files have."""


@dataclass(frozen=True)
class Exported:
    """What an export wrote.

    Attributes
    ----------
    files : tuple of Path
    instructions : int or None
        Most instructions that one step of the motion took, counted by callgrind; None where a C
        compiler or valgrind is missing.
    planning_instructions : int or None
        The same of a unit of a plan.
    """

    files: tuple[Path, ...]
    instructions: int | None
    planning_instructions: int | None


def export_c(
    law: Law,
    rule: Rule,
    folder: str | Path,
    *,
    name: str = "primitive",
    prefix: str = "noslip",
    channels: Channels | None = None,
) -> Exported:
    """Write a primitive as C99.

    Parameters
    ----------
    law : Law
    rule : Rule
    folder : path
        Made if it is missing.
    name : str
        Of the primitive in C, and of its files.
    prefix : str
        Of all other names: two exports with different ones can be linked into one program.
    channels : Channels, optional
        What goes with the motion; ``noslip_channels`` tells them at a state.

    Returns
    -------
    Exported
        ``noslip.h`` and ``noslip.c`` (the step under these constraints); ``replan.h``,
        ``replan.c``, ``plan.h`` and ``plan.c`` (new plans); ``controller.h`` and ``controller.c``
        (the loop); ``inside.h`` (what they share); ``grids.c``, where constraints look up fields
        of distances; ``NAME.h`` and ``NAME.c`` (this primitive's
        numbers); ``example.c``, ``example_replan.c``, ``example_controller.cpp``, ``test.c`` and
        ``CMakeLists.txt``.  Of anything but a pose that comes to an end, planner and controller are
        left out.

    Raises
    ------
    InputError
        If a name is no C identifier or is taken, or the folder is a file.
    """
    for what, given in (("name", name), ("prefix", prefix)):
        checked(what, given)
    folder = Path(folder)
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder} is a file; give the name of a folder")
    rows = rule.system.equalities.size, rule.system.limits.size
    texts = named(_texts(law, rule, _PLACEHOLDER, channels), _PLACEHOLDER, name)
    instructions = _instructions(texts, name, "example", "noslip_step")
    planning = None
    if _plans(law):
        planning = _instructions(texts, name, "example_replan", "noslip_replan")
    more = (
        ";\n * undisturbed: who pushes is found only where a limit may stop it." if rows[1] else "."
    )
    counted = (
        f"\n * At most {instructions} instructions in any step of {name} (callgrind, x86-64, -O2);"
        "\n * each step runs the same code, but for the exponentials of the basis functions near"
        f"{more}"
        if instructions
        else "\n * Instructions a step were not counted (that takes a C compiler and valgrind)."
    )
    texts["noslip.h"] = c99.header(*rows, counted, law.space)
    if _plans(law):
        texts["replan.h"] = texts["replan.h"].replace("@BOUND@", _planning_text(planning, name))
    texts = prefixed(texts, prefix)
    folder.mkdir(parents=True, exist_ok=True)
    written = [write_beside(folder / file, text.encode()) for file, text in texts.items()]
    return Exported(tuple(written), instructions, planning)


def _planning_text(instructions: int | None, name: str) -> str:
    if instructions is None:
        return "Instructions a unit were not counted (that takes a C compiler and valgrind)."
    return (
        f"At most {instructions} instructions in any unit of a plan of {name} with 101 knots, in\n"
        " * example_replan.c (callgrind, x86-64, -O2)."
    )


def _plans(law: Law) -> bool:
    """Whether there is something to plan: of poses, to an end."""
    return law.space.is_pose and not law.clock.returns


def _texts(law: Law, rule: Rule, name: str, channels: Channels | None) -> dict[str, str]:
    motion = rollout(law, rule)
    steps = len(motion) - 1
    every = max(1, steps // _COMPARED)
    beside, space = channels and channels.along(motion), law.space
    reach = float(np.abs(motion.positions).max()) + float(np.ptp(motion.positions, axis=0).max())
    speed = max(float(np.linalg.norm(motion.linear_velocities, axis=1).max()), 1.0)
    columns = ["t", *space.coordinates, *_quaternion_names(space)]
    columns += beside.csv_columns() if beside else []
    system = rule.system
    # A twentieth of the path farther the way that it came: surfaces allow that, if anything.
    aside = motion.positions[-1] - motion.positions[-1 - max(1, steps // 20)]
    aside *= motion.path_length / 20 / max(float(np.linalg.norm(aside)), 1e-300)
    values = {
        "NAME": name,
        "STEPS": str(steps),
        "EVERY": str(every),
        "EXPECTED": _rows(motion.points[every::every]),
        "CHANNELS": "0" if channels is None else str(len(channels.names)),
        "EXPECTED_CHANNELS": _rows(beside.values[every::every]) if beside else "",
        "CHANNEL_SIZES": ", ".join(
            map(repr, np.fmax(1.0, np.abs(beside.values).max(axis=0)).tolist())
        )
        if beside
        else "",
        "DIFFERENCE": repr(1e-12 * max(1.0, reach)),
        "SINGLE_DIFFERENCE": repr(2e-3 * max(1.0, reach)),
        "SINGLE_RESIDUAL": repr(1e-4 * speed),
        "FUNCTIONS": str(law.basis.count),
        "FIT_STEPS": str(fewest_steps(law.basis.count)),
        "COLUMNS": ",".join(columns).replace("\\", "\\\\").replace("?", "\\?"),
        "PLANNER": " plan.c replan.c controller.c" if _plans(law) else "",
        "ASIDE": "{" + ", ".join(map(repr, aside.tolist())) + "}",
        "LENGTH": repr(motion.path_length or 1.0),
    }
    declared = f"#ifndef {name.upper()}_H\n#define {name.upper()}_H\n\n"
    declared += f'#include "noslip.h"\n\nextern const noslip_primitive {name};\n'
    declared += f"{_declared_channels(name, channels)}\n#endif\n"
    texts = {
        "noslip.h": c99.header(system.equalities.size, system.limits.size, space=space),
        "inside.h": c99.template("inside.h"),
        # Forces and values, without each row's own part.
        "noslip.c": c99.source(stepper_of(rule).function, system.size, parts=False, space=space),
        **(sources(rule) | controller_sources(law, rule) if _plans(law) else {}),
        f"{name}.h": declared,
        f"{name}.c": numbers.text(law, rule, name, channels),
    }
    values["GRIDS"] = " grids.c" if "grids.c" in texts else ""
    examples = ["example.c"]
    if _plans(law):
        examples += ["example_replan.c", "example_controller.cpp"]
    for file in (*examples, "test.c", "CMakeLists.txt"):
        text = c99.template(file)
        for key, value in values.items():
            text = text.replace(f"@{key}@", value)
        texts[file] = text
    # Numbers of a primitive under other constraints do not link with this step.
    rule_id = f"noslip_rule_{hashlib.sha256(texts['noslip.c'].encode()).hexdigest()[:16]}"
    declared = "\n/* Of the constraints: what is for others does not link. */\n"
    declared += f"extern const int {rule_id};\n"
    texts["noslip.c"] += f"{declared}const int {rule_id} = 1;\n"
    texts[f"{name}.c"] += (
        f"{declared}extern const int *const {name}_rule;\n"
        f"const int *const {name}_rule = &{rule_id};\n"
    )
    return texts


def _rows(values: Floats) -> str:
    return ",\n".join("    {" + ", ".join(map(repr, row)) + "}" for row in values.tolist())


def _declared_channels(name: str, channels: Channels | None) -> str:
    """Which channels noslip_channels tells, and how many."""
    if channels is None:
        return ""
    both = zip(channels.names, channels.units, strict=True)
    told = ", ".join(f"{name} ({unit})" for name, unit in both)
    told = textwrap.fill(told, 90).replace("*/", "* /").replace("/*", "/ *").replace("\n", "\n * ")
    size = f"#define {name.upper()}_CHANNELS {len(channels.names)}"
    return f"\n/* What noslip_channels tells: {told}. */\n{size}\n"


def _quaternion_names(space: Space) -> list[str]:
    parts = ("qw", "qx", "qy", "qz")
    if space.rotations <= 1:
        return list(parts[: 4 * space.rotations])
    return [f"{body.name}.{part}" for body in space.bodies for part in parts]


def _instructions(texts: dict[str, str], name: str, example: str, function: str) -> int | None:
    """Most instructions of a call of a function while an example runs."""
    sources = ["noslip.c", f"{name}.c", f"{example}.c"]
    sources += [file for file in texts if file in ("plan.c", "replan.c", "grids.c")]
    return most_instructions(texts, sources, function, _NO_PLAN)
