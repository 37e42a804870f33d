"""Constants of adapting and re-planning, which their code in C takes from here."""

from __future__ import annotations

MOST_SAMPLES = 2001
"""An adapted motion is as smooth as its primitive; more samples than these add nothing."""
FEWEST_SAMPLES = 20
"""Fewer do not show where a motion bends once."""
DETOUR = 5.0
"""Way for which time is allotted to a displacement, over its length: it may lie sideways."""
SETTLED = 0.3
"""Fraction of what remains after which a displacement is to be gone, unless it is large."""
FEWEST_LEFT = 4
"""Steps of a plan: where no more of the motion than these would take is left, it is over."""
LEAST_TIME = 0.05
"""Of the duration, that a re-planned motion takes at least: a jump to the end is no plan."""
OFF = 1e-9
"""Residual of a boundary pose that is none (m or rad): above rounding, below any tool's play."""
