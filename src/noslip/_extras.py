"""Packages that only some of the library needs, each brought by one of its extras."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

from noslip.errors import MissingDependencyError


def need(what: str | Path, module: str, extra: str) -> Any:
    """Return a module that a file or a part of the library needs, or say which extra brings it."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise MissingDependencyError(
            f"{what}: {module.partition('.')[0]} is needed and cannot be imported; "
            f"pip install 'noslip[{extra}]'"
        ) from error
