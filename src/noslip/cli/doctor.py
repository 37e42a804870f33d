"""``noslip doctor``: what of this machine is used, and why something is not.

noslip doctor

noslip doctor --json
"""

from __future__ import annotations

import importlib
import os
import platform
import shutil
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, metadata, requires, version
from typing import Any

import typer
from packaging.requirements import Requirement

from noslip._version import __version__
from noslip.cli import options, output
from noslip.codegen import library
from noslip.constraints import Blade
from noslip.constraints.check import residual_text
from noslip.experiments.numerical_example import demonstration
from noslip.learning import learn
from noslip.runtime.stepper import stepper_of

DEVELOPERS = {"bench", "dev", "docs"}
"""Extras of the repository, not of the library."""

MODULES = {"pyyaml": "yaml"}
"""Modules that have another name than the package that brings them."""


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
    return found | {"extras": _extras()}


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


def _extras() -> dict[str, str]:
    """Each extra that the installed package declares, and whether what it brings can be used."""
    try:
        names = metadata("noslip").get_all("Provides-Extra") or []
    except PackageNotFoundError:
        return {"unknown": "noslip is not installed, only on the path: pip install it"}
    return {
        name: " ".join(_tried(wanted) for wanted in _wanted("noslip", name))
        for name in sorted(set(names) - DEVELOPERS)
    }


def _wanted(package: str, extra: str) -> Iterator[Requirement]:
    """What a package needs for one of its extras alone, extras of those packages included."""
    for text in requires(package) or []:
        wanted = Requirement(text)
        marker = wanted.marker
        if marker is None or not marker.evaluate({"extra": extra}):
            continue
        if marker.evaluate({"extra": ""}):  # needed in any case
            continue
        yield wanted
        for further in wanted.extras:
            try:
                yield from _wanted(wanted.name, further)
            except PackageNotFoundError:  # told of the package itself
                return


def _tried(wanted: Requirement) -> str:
    """A package and its version, or why it cannot be used: only importing it tells."""
    try:
        found = version(wanted.name)
    except PackageNotFoundError:
        return f"missing {wanted.name}"
    if found not in wanted.specifier:
        return f"{wanted.name} {found} is not {wanted.specifier}"
    try:
        importlib.import_module(MODULES.get(wanted.name, wanted.name.replace("-", "_")))
    except Exception as error:  # a library of the machine that is missing raises what it likes
        return f"{wanted.name} {found} cannot be imported: {str(error).splitlines()[0]}"
    return f"{wanted.name} {found}"
