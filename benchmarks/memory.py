"""Peak memory of this process, CasADi's and NumPy's included.

``tracemalloc`` sees Python's allocations only.
"""

from __future__ import annotations

import contextlib
import re
import sys
from pathlib import Path

_STATUS = Path("/proc/self/status")


class PeakMemory:
    """Largest resident memory since :meth:`start`, above what was resident then."""

    def __init__(self) -> None:
        self.begin: int | None = None

    def start(self) -> None:
        """Take the present as zero."""
        if _STATUS.exists():
            # On Linux the highest mark can be put back to the present level.
            with contextlib.suppress(OSError):
                Path("/proc/self/clear_refs").write_text("5")
            self.begin = _status("VmRSS")
        else:
            self.begin = _highest()

    def above(self) -> int | None:
        """Bytes, or None where the system does not say."""
        now = _status("VmHWM") if _STATUS.exists() else _highest()
        if now is None or self.begin is None:
            return None
        return max(0, now - self.begin)


def _status(field: str) -> int | None:
    found = re.search(rf"^{field}:\s+(\d+) kB", _STATUS.read_text(), re.MULTILINE)
    return int(found[1]) * 1024 if found else None


def _highest() -> int | None:
    try:
        import resource
    except ImportError:
        return None
    highest = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return highest if sys.platform == "darwin" else highest * 1024
