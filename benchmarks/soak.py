"""Steps the exported C code for hours' worth of control, and looks for what must never happen.

``python -m benchmarks.soak --steps 100000000`` (or ``make soak``): random primitives, goals,
durations, step lengths, late cycles, pushes and hostile states; no number that is not finite, no
residual or speed sideways above 1e-10 of the motion's top speed, no orientation off SO(3) by more
than 1e-12, nothing refused that changes anything.  Controllers, on robots that err in every way:
no fault, no command beyond its bounds.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.runtime import numbers

HERE = Path(__file__).parent
CONTROLLER = ("noslip.c", "plan.c", "replan.c", "controller.c")
CYCLES = 0.005
"""Of the steps: those of a controller, which plans all the time, take so much longer."""
PRIMITIVES = 8
FLAGS = ("-std=c99", "-O2", "-Wall", "-Wextra", "-pedantic", "-Werror", "-D_XOPEN_SOURCE=600")


@dataclass(frozen=True)
class Set:
    """Constraints that are soaked together.

    Attributes
    ----------
    name : str
    constraints : tuple
    share : float
        Of all steps.
    push : float
        How far goals and poses are moved, over the motion's extent.
    """

    name: str
    constraints: tuple[Any, ...]
    share: float
    push: float


SETS = (
    Set("blade", (ns.Blade(),), 0.69, 1.0),
    Set("needle", (ns.Needle(),), 0.2, 1.0),
    Set("wheel", (ns.Wheel(),), 0.08, 0.0),
    Set("blade with limits", (ns.Blade(), ns.SpeedLimit(speed=50.0)), 0.02, 1.0),
    Set("blade on a plane", (ns.Blade(), ns.constraints.PlaneContact()), 0.01, 0.0),
)


def demonstration(seed: int) -> ns.PoseTrajectory:
    """A smooth random motion in the plane, the tool along it."""
    rng = np.random.default_rng(seed)
    s = np.linspace(0, 1, 401)
    waves = rng.normal(size=(3, 2)) / np.array([[1.0], [2.0], [3.0]])
    yaw = sum(
        a * np.sin((k + 1) * np.pi * s) + b * np.cos((k + 1) * np.pi * s)
        for k, (a, b) in enumerate(waves)
    )
    speed = 0.02 + s**2 * (1 - s) ** 2 * 30
    heading = np.column_stack([np.cos(yaw), np.sin(yaw), 0 * s])
    path = np.cumsum(rng.uniform(0.03, 0.3) * speed[:, None] * heading, axis=0) / len(s)
    duration = rng.uniform(0.5, 5)
    return ns.PoseTrajectory(duration * s, path, Rotation.from_euler("z", yaw))


def soak(chosen: Set, steps: int, seed: int, folder: Path) -> dict[str, Any]:
    """Compile and step; what the program tells."""
    learned = [
        ns.learn(demonstration(PRIMITIVES * seed + k), list(chosen.constraints))
        for k in range(PRIMITIVES)
    ]
    learned[0].export_c(folder, name="p0")
    names = [f"p{k}" for k in range(PRIMITIVES)]
    for name, dmp in zip(names[1:], learned[1:], strict=True):
        (folder / f"{name}.c").write_text(numbers.text(dmp.law, dmp.rule, name))
    declared = "".join(f"extern const noslip_primitive {name};\n" for name in names)
    listed = ", ".join(f"&{name}" for name in names)
    (folder / "primitives.h").write_text(
        f'#include "noslip.h"\n#define PRIMITIVES {PRIMITIVES}\n{declared}'
        f"static const noslip_primitive *const primitives[] = {{{listed}}};\n"
    )
    found: dict[str, Any] = {"set": chosen.name}
    passed = True
    for program, parts, arguments in (
        ("soak", ("noslip.c",), (steps, chosen.push)),
        ("soak_controller", CONTROLLER, (max(1, round(CYCLES * steps)),)),
    ):
        sources = [*parts, *(f"{name}.c" for name in names)]
        build = ["cc", *FLAGS, "-I.", *sources, str(HERE / f"{program}.c"), "-lm", "-o", program]
        subprocess.run(build, cwd=folder, check=True)
        run = [f"./{program}", str(arguments[0]), str(seed), *map(str, arguments[1:])]
        done = subprocess.run(run, cwd=folder, capture_output=True, text=True, check=False)
        found[program] = json.loads(done.stdout)
        passed &= done.returncode == 0
    return {**found, "passed": passed}


def main(arguments: list[str] | None = None) -> int:
    """Parse arguments, soak, print a line a set; 1 if something happened that must not."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--steps", type=int, default=100_000_000, help="in all")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    passed = True
    for chosen in SETS:
        with tempfile.TemporaryDirectory() as folder:
            found = soak(
                chosen, max(1, round(chosen.share * options.steps)), options.seed, Path(folder)
            )
        print(json.dumps(found), flush=True)
        passed &= found["passed"]
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main())
