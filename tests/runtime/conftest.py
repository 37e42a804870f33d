"""Exported primitives, compiled once for all that links with them."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest
from cpp import CC, OBJECTS, SOURCES
from test_replan_in_c import of

from noslip.exporting import export
from objects import objects

Exporter = Callable[[str], Path]


@pytest.fixture(scope="session")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Exporter:
    """Folder of a primitive by its name, exported as ``primitive`` and compiled, uncounted."""

    @cache
    def exported(name: str) -> Path:
        folder = tmp_path_factory.mktemp("exported")
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(export, "_instructions", lambda *told: None)
            of(name).export_c(folder)
        made = objects(folder, SOURCES, CC, "-std=c99", "-O1")
        for name, code in zip(OBJECTS, made, strict=True):
            shutil.copy(code, folder / name)
        return folder

    return exported
