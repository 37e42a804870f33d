"""A newcomer's exercise: a constraint in one new file, known, drawn, saved and exported."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import noslip as ns
from waiting import PATIENCE

ROOT = Path(__file__).resolve().parents[1]

EXERCISE = """
import sys
import numpy as np
import noslip as ns
from noslip.cli import main
from noslip.constraints import Bore
from noslip.exporting import export
from noslip.viewer.shapes import shapes

# How many instructions it takes is not what this is about, and takes seconds.
export._instructions = lambda *told: None

def run(*arguments):
    sys.argv, code = ["noslip", *arguments], 0
    try:
        main()
    except SystemExit as end:
        code = end.code or 0
    print("exit", code)

rule = "bore(radius=0.03, axis=(1, 0, 0))"
run("check", "cut.csv", "--constraint", rule)
run("learn", "cut.csv", "--constraint", "blade", "--constraint", rule, "--out", "cut.json")
run("rollout", "cut.json", "--out", "motion.csv")
run("check", "motion.csv", "--constraint", "blade", "--constraint", rule)
run("plot", "motion.csv", "--constraint", rule, "--out", "motion.png")
run("export", "cut.json", "--out", "c")
assert Bore(radius=0.03, axis=(1, 0, 0)) in ns.load_primitive("cut.json").constraints
(tube,) = shapes([Bore(radius=0.03, axis=(1, 0, 0))], np.zeros(3), 0.2)
np.testing.assert_allclose(np.linalg.norm(tube.vertices[:, 1:], axis=1), 0.03)
"""


@pytest.fixture
def newcomers(tmp_path: Path) -> Path:
    """A copy of the package with the file that CONTRIBUTING.md shows."""
    page = (ROOT / "CONTRIBUTING.md").read_text()
    (path, code) = re.findall(
        r"`src/noslip/(constraints/\w+\.py)`:\n\n```python\n(.*?)```", page, re.S
    )[0]
    shutil.copytree(
        ROOT / "src" / "noslip", tmp_path / "noslip", ignore=shutil.ignore_patterns("__pycache__")
    )
    assert not (tmp_path / "noslip" / path).exists()
    (tmp_path / "noslip" / path).write_text(code)
    return tmp_path


def test_a_constraint_in_one_new_file_is_known_drawn_saved_and_exported(newcomers: Path) -> None:
    s = np.linspace(0, 1, 201)
    path = np.column_stack([0.2 * s, 0.04 * np.sin(np.pi * s), 0 * s])
    yaw = np.arctan2(0.04 * np.pi * np.cos(np.pi * s), 0.2)
    ns.PoseTrajectory(2 * s, path, Rotation.from_euler("z", yaw)).to_csv(newcomers / "cut.csv")
    done = subprocess.run(
        [sys.executable, "-c", EXERCISE],
        cwd=newcomers,
        env={**os.environ, "PYTHONPATH": str(newcomers), "MPLBACKEND": "agg"},
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    codes = [int(code) for code in re.findall(r"^exit (\d+)$", done.stdout, re.M)]
    # The recording leaves the bore; what is learned keeps within it.
    assert codes == [1, 0, 0, 0, 0, 0], done.stdout + done.stderr
    assert "bore: VIOLATED" in done.stdout
    assert "bore: HOLDS" in done.stdout
    assert (newcomers / "motion.png").stat().st_size > 10_000
    assert list((newcomers / "c").glob("*.c"))
