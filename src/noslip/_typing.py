"""Names for types that are used everywhere."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
"""An array of double precision; docstrings give its shape."""

Expression = Any
"""A CasADi SX expression, or numbers where it is constant; docstrings give its shape."""
