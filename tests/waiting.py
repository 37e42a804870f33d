"""How long tests wait for what runs beside them, and what interrupts it."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable

PATIENCE = 600.0
"""Seconds after which something hangs: ten times what the slowest takes on an idle machine."""


def until(holds: Callable[[], object], what: str) -> None:
    """Wait for something to become true."""
    end = time.monotonic() + PATIENCE
    while not holds():
        assert time.monotonic() < end, f"waited {PATIENCE:g} s for: {what}"
        time.sleep(0.02)


def heed_ctrl_c() -> None:
    """Have a child be interrupted where its parent is not: the ``preexec_fn`` of its process.

    Under nohup and in background jobs interrupts are ignored, by every child too.
    """
    signal.signal(signal.SIGINT, signal.SIG_DFL)
