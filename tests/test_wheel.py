"""What is installed, not what lies in the repository: wheel, source distribution, every extra.

The wheel goes into an empty environment.  A job for each extra must fail there in one line that
names the extra, and must run where that extra is installed besides.  ``NOSLIP_WHEEL_PYTHON`` names
another interpreter to make the environments with: `make wheels` goes through those it finds.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tarfile
import zipfile
from collections.abc import Callable, Sequence
from email import message_from_bytes
from pathlib import Path
from typing import Any

import pytest

from noslip.cli.doctor import DEVELOPERS

pytestmark = pytest.mark.slow
ROOT = Path(__file__).parents[1]
PYTHON = os.environ.get("NOSLIP_WHEEL_PYTHON", sys.executable)

JOBS: dict[str, Sequence[str]] = {
    "align": ("-m", "noslip", "learn", "cut.csv", "again.csv", "--align", "--constraint", "blade",
              "--out", "aligned.json"),
    "bags": ("-m", "noslip", "convert", "cut.csv", "--out", "cut.mcap"),
    "cluster": ("-c", """
import importlib.util, noslip as ns
from noslip.many.executors import cluster
address = "tcp://127.0.0.1:1"
if importlib.util.find_spec("distributed"):
    from distributed import LocalCluster
    local = LocalCluster(n_workers=1, processes=False, dashboard_address=None)
    address = local.scheduler_address
with cluster(address) as executor:
    assert not ns.learn_each(["cut.csv"], ns.Blade(), out="each", executor=executor).failed
"""),
    "hdf5": ("-m", "noslip", "convert", "demo.hdf5", "--out", "demo.csv"),
    "improve": ("-c", """
import noslip as ns
dmp = ns.load_primitive("cut.json")
ns.improve(dmp, lambda motion: abs(motion.positions).max(), evaluations=12, seed=1)
"""),
    "interop": ("-c", """
import noslip as ns
from noslip import interop
interop.to_movement_primitives(ns.load_primitive("cut.json"))
"""),
    "maps": ("-c", """
import noslip as ns
ns.constraints.KeepOut("room.yaml")
"""),
    "meshes": ("-c", """
import noslip as ns
ns.constraints.KeepOut("box.stl")
"""),
    "report": ("-m", "noslip", "report", "cut.json", "--out", "cut.html"),
    "robots": ("-m", "noslip", "simulate", "cut.json", "--level", "tool", "--out", "arm"),
    "tables": ("-m", "noslip", "convert", "cut.csv", "--out", "cut.parquet"),
    "viewer": ("-m", "noslip", "view", "cut.json", "--out", "cut-view.html"),
}  # fmt: skip
"""What needs an extra, the least of it; run in a folder with the files of `folder`."""

ELSEWHERE = {
    "lerobot": "brings PyTorch: gigabytes",
    "video": "draws with OpenGL and on an arm: tests/cli/test_simulate.py",
}
"""Extras that no job is for, and why."""


def ran(
    command: Sequence[str | Path], folder: Path, **options: Any
) -> subprocess.CompletedProcess[str]:
    """Run a command that sees nothing of the repository."""
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "COVERAGE"))}
    return subprocess.run(
        list(map(str, command)),
        cwd=folder,
        env=kept | {"NOSLIP_COMPILE": "0", "MPLBACKEND": "agg"},
        capture_output=True,
        text=True,
        check=False,
        **options,
    )


def made(command: Sequence[str | Path], folder: Path) -> str:
    """Run a command that must succeed; return what it printed."""
    done = ran(command, folder)
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"
    return done.stdout


Once = Callable[[str, Callable[[Path], None]], Path]


@pytest.fixture(scope="session")
def built(once: Once) -> Path:
    """Folder with the source distribution, and the wheel that was built from it alone."""

    def build(folder: Path) -> None:
        hatch = [sys.executable, "-m", "hatchling", "build", "--directory", folder]
        made([*hatch, "--target", "sdist"], ROOT)
        (source,) = folder.glob("*.tar.gz")
        with tarfile.open(source) as archive:
            archive.extractall(folder / "source", filter="data")
        (unpacked,) = (folder / "source").iterdir()
        made([*hatch, "--target", "wheel"], unpacked)

    return once("wheel-built", build)


def environment(folder: Path, wanted: str | None, *below: Path) -> None:
    """Make an environment with what pip is asked for, on top of others whose programs are given."""
    made([PYTHON, "-m", "venv", "--without-pip", folder], folder.parent)
    (packages,) = folder.glob("lib/python*/site-packages")
    beneath = [next(each.parent.glob("lib/python*/site-packages")) for each in below]
    (packages / "beneath.pth").write_text("".join(f"{each}\n" for each in beneath))
    if wanted is None:
        return
    pip = [sys.executable, "-m", "pip", "--python", folder / "bin" / "python"]
    done = ran([*pip, "install", "-q", "--no-compile", wanted], folder)
    if "NewConnectionError" in done.stderr:
        pytest.skip("no package index can be reached")
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="session")
def core(built: Path, once: Once) -> Path:
    """Programs of an environment with the wheel and what it declares to need, no more."""
    (wheel,) = built.glob("*.whl")
    return once("wheel-core", lambda folder: environment(folder, str(wheel))) / "bin"


@pytest.fixture(scope="session")
def extended(core: Path, built: Path, once: Once) -> Callable[[str], Path]:
    """Programs of an environment that has one extra besides."""
    (wheel,) = built.glob("*.whl")

    def extended(extra: str) -> Path:
        wanted = f"{wheel}[{extra}]"
        return once(f"wheel-{extra}", lambda folder: environment(folder, wanted, core)) / "bin"

    return extended


@pytest.fixture(scope="session")
def folder(core: Path, once: Once) -> Path:
    """Folder with what the jobs read, made by the main job of the installed wheel."""
    return once("wheel-jobs", lambda folder: prepare(core, folder))


def prepare(core: Path, folder: Path) -> None:
    h5py, trimesh = pytest.importorskip("h5py"), pytest.importorskip("trimesh")
    made([core / "noslip", "demo", "--out", "demo"], folder)
    for name, k in (("cut", 1), ("again", 2)):
        (folder / "demo" / "excision" / f"demonstration_{k}.csv").rename(folder / f"{name}.csv")
    made(
        [core / "noslip", "learn", "cut.csv", "--constraint", "blade", "--out", "cut.json"], folder
    )
    made([core / "noslip", "rollout", "cut.json", "--out", "motion.csv"], folder)
    made([core / "noslip", "check", "motion.csv", "--constraint", "blade"], folder)
    with h5py.File(folder / "demo.hdf5", "w") as file:
        demo = file.create_group("data/demo_0/obs")
        file["data"].attrs["env_args"] = json.dumps({"env_kwargs": {"control_freq": 20}})
        demo["robot0_eef_pos"] = [[0.0, 0.0, 0.01 * k] for k in range(20)]
        demo["robot0_eef_quat"] = [[0.0, 0.0, 0.0, 1.0]] * 20
    (folder / "room.pgm").write_bytes(b"P5 4 4 255 " + bytes([0] + [254] * 15))
    (folder / "room.yaml").write_text(
        "image: room.pgm\nresolution: 1.0\norigin: [5, 5, 0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.2\n"
    )
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    box.apply_translation((2, 2, 2))
    box.export(folder / "box.stl")


def test_the_source_distribution_is_all_there_is(built: Path) -> None:
    listed = ran(["git", "ls-files"], ROOT).stdout.splitlines()
    if not listed:
        pytest.skip("not a checkout of git")
    (source,) = built.glob("*.tar.gz")
    with tarfile.open(source) as archive:
        inside = {name.partition("/")[2] for name in archive.getnames()}
    assert set(listed) <= inside


def test_a_wheel_has_every_module_and_says_that_it_is_typed(built: Path) -> None:
    (wheel,) = built.glob("*.whl")
    inside = set(zipfile.ZipFile(wheel).namelist())
    source = ROOT / "src"
    wanted = {
        str(file.relative_to(source))
        for file in (source / "noslip").rglob("*")
        if file.is_file() and "__pycache__" not in file.parts
    }
    assert wanted <= inside
    assert "noslip/py.typed" in inside
    assert not {name for name in inside if name.startswith(("tests/", "benchmarks/"))}


def test_every_extra_has_a_job(built: Path) -> None:
    (wheel,) = built.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        (told,) = (name for name in archive.namelist() if name.endswith("/METADATA"))
        declared = set(message_from_bytes(archive.read(told)).get_all("Provides-Extra") or [])
    assert declared - DEVELOPERS == set(JOBS) | set(ELSEWHERE)


def test_doctor_finds_no_extra_where_there_is_none(core: Path, folder: Path) -> None:
    found = json.loads(made([core / "noslip", "doctor", "--json"], folder))["extras"]
    assert set(found) == set(JOBS) | set(ELSEWHERE)
    assert {what.split()[0] for what in found.values()} == {"missing"}


@pytest.mark.parametrize("extra", JOBS)
def test_an_extra_is_asked_for_where_it_is_missing_and_enough_where_it_is_there(
    extra: str, core: Path, folder: Path, extended: Callable[[str], Path]
) -> None:
    without = ran([core / "python", *JOBS[extra]], folder)
    assert without.returncode != 0
    assert f"pip install 'noslip[{extra}]'" in without.stderr.splitlines()[-1]

    made([extended(extra) / "python", *JOBS[extra]], folder)


def test_doctor_finds_every_extra_where_it_is_there(
    core: Path, folder: Path, extended: Callable[[str], Path], tmp_path: Path
) -> None:
    environment(tmp_path / "all", None, core, *map(extended, JOBS))
    python = tmp_path / "all" / "bin" / "python"
    found = json.loads(made([python, "-m", "noslip", "doctor", "--json"], folder))["extras"]
    wrong = ("missing", "cannot", "is not")
    assert not {extra: found[extra] for extra in JOBS if any(w in found[extra] for w in wrong)}
