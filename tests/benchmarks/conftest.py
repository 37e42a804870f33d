"""Make the ``benchmarks`` package importable: it lies in the repository's root, not in ``src``."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
