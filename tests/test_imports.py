"""What is loaded when: nothing before it is needed, and each part by itself."""

from __future__ import annotations

import os
import pkgutil
import subprocess
import sys

import pytest

import noslip as ns

OPTIONAL = {
    *("dtaidistance", "daqp", "h5py", "imageio", "jinja2", "mcap", "movement_primitives", "mujoco"),
    *("distributed", "pandas", "polars", "pyarrow", "pytransform3d", "rosbags", "viser"),
    *("weasyprint",),
}
"""Of the extras, and of others whose data we read."""
NEEDLESS = OPTIONAL | {
    *("matplotlib", "rich", "typer", "scipy.integrate", "scipy.interpolate", "scipy.ndimage"),
    *("scipy.optimize", "scipy.signal", "scipy.stats", "noslip.robots", "noslip.figures"),
}
"""Needed by some of the library's functions only."""


def loaded(code: str) -> set[str]:
    """Return the modules that a new process has after it ran some code."""
    shown = subprocess.run(
        [sys.executable, "-c", f"{code}\nimport sys; print(*sys.modules, file=sys.stderr)"],
        capture_output=True,
        text=True,
        env={**os.environ, "MPLBACKEND": "agg"},
        check=True,
    )
    return set(shown.stderr.split())


def test_the_library_alone_loads_nothing_else() -> None:
    assert not loaded("import noslip") & (NEEDLESS | {"casadi", "numpy", "scipy"})


def test_its_names_load_what_all_work_needs_and_no_more() -> None:
    found = loaded("from noslip import *; PoseTrajectory, learn")
    assert {"casadi", "scipy.spatial.transform", "noslip.learning"} <= found
    assert not found & NEEDLESS


def test_the_version_needs_no_numbers() -> None:
    code = """
import sys
from noslip.cli import main
sys.argv = ["noslip", "--version"]
try:
    main()
except SystemExit as exit:
    assert not exit.code"""
    assert not loaded(code) & (NEEDLESS - {"typer", "rich"} | {"casadi", "numpy", "scipy"})


def test_a_command_is_loaded_without_the_others() -> None:
    code = """
import sys
from noslip.cli import main
sys.argv = ["noslip", "check", "--help"]
try:
    main()
except SystemExit as exit:
    assert not exit.code"""
    found = loaded(code)
    assert "noslip.cli.check" in found
    assert not found & {"noslip.cli.learn", "noslip.cli.plot", "matplotlib", "noslip.robots"}


def test_extras_are_not_imported_before_they_are_needed() -> None:
    commands = "import noslip.cli; list(noslip.cli._Commands().items())"
    found = loaded(commands)
    assert {"noslip.cli.simulate", "noslip.cli.report"} <= found
    assert not found & OPTIONAL


def test_each_part_can_be_the_first_to_be_imported() -> None:
    """No folder leans on another that happened to be there; modules import downwards alone."""
    parts = [f"noslip.{m.name}" for m in pkgutil.iter_modules(ns.__path__) if m.ispkg]
    code = f"""
import importlib, sys
for part in {parts}:
    for name in [name for name in sys.modules if name.partition(".")[0] == "noslip"]:
        del sys.modules[name]
    importlib.import_module(part)"""
    assert loaded(code)


def test_every_name_is_there_is_listed_and_is_kept() -> None:
    for name in ns.__all__:
        assert getattr(ns, name) is getattr(ns, name)
    assert set(ns.__all__) <= set(dir(ns))
    for name in ("nothing", "__nothing__", "_nothing"):
        with pytest.raises(AttributeError, match=f"module 'noslip' has no attribute '{name}'"):
            getattr(ns, name)


def test_a_name_that_is_not_on_top_is_answered_with_where_it_is_or_what_was_meant() -> None:
    def answer(name: str) -> str:
        with pytest.raises(AttributeError) as refused:
            getattr(ns, name)
        return str(refused.value).removeprefix(f"module 'noslip' has no attribute {name!r}")

    assert answer("RollingDisc") == "; it is noslip.constraints.RollingDisc"
    assert answer("write_bag") == "; it is noslip.recordings.write_bag"
    assert answer("Balde") == " (did you mean Blade?)"
    loads = " (did you mean load_demonstrations, load_primitive or load_trajectory?)"
    assert answer("load") == loads
    assert answer("report") == " (did you mean reporting?)"


def test_parts_are_there_without_being_imported() -> None:
    code = "import noslip as ns; ns.robots.track; ns.figures.save_figure; ns.law.Law"
    assert "matplotlib" in loaded(code)


def test_motions_can_be_drawn_whoever_imported_them() -> None:
    code = """
from noslip.trajectory import PoseTrajectory
from scipy.spatial.transform import Rotation
PoseTrajectory([0, 1], [[0, 0, 0], [1, 0, 0]], Rotation.identity(2)).plot()"""
    assert "noslip.figures.motion" in loaded(code)
