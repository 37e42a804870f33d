"""``noslip doctor``: what of this machine is used, and why something is not.

noslip doctor

noslip doctor --json
"""

from __future__ import annotations

import os
import platform
import shutil
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from typing import Any

import typer

from noslip._version import __version__
from noslip.cli import options, output
from noslip.codegen import library
from noslip.constraints import Blade
from noslip.constraints.check import residual_text
from noslip.experiments.numerical_example import demonstration
from noslip.learning import learn
from noslip.runtime.stepper import stepper_of

EXTRAS = {
    "bags": ("rosbags",),
    "tables": ("pyarrow",),
    "hdf5": ("h5py",),
    "maps": ("yaml",),
    "meshes": ("trimesh",),
    "align": ("dtaidistance",),
    "robots": ("mujoco", "daqp"),
    "video": ("imageio", "imageio_ffmpeg"),
    "cluster": ("distributed",),
    "lerobot": ("lerobot",),
    "viewer": ("viser",),
    "report": ("jinja2", "weasyprint"),
    "interop": ("movement_primitives", "pytransform3d"),
}
"""Packages that each extra brings."""


def run(as_json: options.AsJson = False) -> None:
    """Tell what is used on this machine, what is not, and why.

    Compiles a step for a blade and rolls it out, so that what is told has been tried.
    """
    found = _survey()
    if as_json:
        output.print_json(found)
        return
    width = max(map(len, found))
    for name, value in found.items():
        if isinstance(value, dict):
            value = ", ".join(f"{key}: {what}" for key, what in value.items())
        typer.echo(f"{name:<{width}}  {value}")


def _survey() -> dict[str, Any]:
    packages = {name: version(name) for name in ("casadi", "numpy", "scipy")}
    found = {
        "noslip": __version__,
        "Python": f"{platform.python_version()} on {platform.system()} {platform.machine()}",
        "packages": packages,
        "steps run as": _steps(),
        "C compiler": _compiler(),
        "cache": _cache(),
        "valgrind": shutil.which("valgrind")
        or "not found; noslip export does not count instructions",
    }
    return found | {"extras": {name: _extra(*names) for name, names in EXTRAS.items()}}


def _steps() -> str:
    dmp = learn(demonstration(), [Blade()])
    if dmp.compile():
        residual = abs(dmp.rollout().constraint_residuals).max()
        return f"machine code (tried: residual {residual_text(residual, 'm/s')})"
    if not library.wanted():
        why = f"NOSLIP_COMPILE is {os.environ['NOSLIP_COMPILE']}"
    else:
        why = stepper_of(dmp.rule).native.failure or f"no C compiler ({library.compiler_name()})"
    return f"CasADi's virtual machine, several times slower: {why}"


def _compiler() -> str:
    compiler = library.compiler()
    if compiler is None:
        name = library.compiler_name()
        return f"{name} not found; install one (Debian: gcc), or name one in CC"
    return f"{' '.join(compiler.command)} ({compiler.version})"


def _cache() -> str:
    try:
        folder = library.cache_folder()
        sizes = [file.stat().st_size for file in folder.glob("*.so")]
    except OSError as error:
        return f"not readable: {error.strerror or error}"
    return (
        f"{folder} ({len(sizes)} files, {sum(sizes) / 1e6:.1f} MB)"
        if sizes
        else f"{folder} (empty)"
    )


def _extra(*names: str) -> str:
    missing = [name for name in names if find_spec(name) is None]
    if missing:
        return "missing " + " ".join(missing)
    try:
        return " ".join(f"{name} {version(name.replace('_', '-'))}" for name in names)
    except PackageNotFoundError:
        return "there"
