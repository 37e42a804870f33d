"""The browser of tests: Chromium, headless, drawn in software."""

from __future__ import annotations

import os
import shutil

import pytest

CHROMIUM = os.environ.get("NOSLIP_CHROMIUM") or shutil.which("chromium")
ARGUMENTS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
]
NEEDS_CHROMIUM = [
    pytest.mark.slow,
    pytest.mark.skipif(
        CHROMIUM is None, reason="no Chromium found; name it with NOSLIP_CHROMIUM=/path/to/chromium"
    ),
]
"""Marks of a module whose tests all open it."""
