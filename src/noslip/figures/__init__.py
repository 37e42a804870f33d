"""What people look at: figures of motions, without a window and without global state.

Figure-level functions return a :class:`matplotlib.figure.Figure`; :func:`save_figure` writes it.
The others draw into axes and return what they drew.
"""

from noslip.figures.arm import executed_slip, joint_limits
from noslip.figures.bodies import bodies_paths
from noslip.figures.cycles import rhythm_cycles
from noslip.figures.distributed import motion_distribution
from noslip.figures.family import adapted_family
from noslip.figures.history import constraint_history, plot_constraint
from noslip.figures.identified import identified_constraint
from noslip.figures.learned_spread import learned_spread, plot_ellipses, plot_learned_spread
from noslip.figures.motion import (
    compare_motions,
    plot_forces,
    plot_orientation,
    plot_path,
    plot_positions,
    plot_residuals,
    plot_speed,
)
from noslip.figures.segments import recording_cuts
from noslip.figures.snapshots import blade_snapshots, plot_blades, plot_tool_frame
from noslip.figures.spread import demonstration_spread, orientation_adjustments, plot_spread
from noslip.figures.style import column_figure, save_figure
from noslip.figures.values import plot_values

__all__ = [
    "adapted_family",
    "blade_snapshots",
    "bodies_paths",
    "column_figure",
    "compare_motions",
    "constraint_history",
    "demonstration_spread",
    "executed_slip",
    "identified_constraint",
    "joint_limits",
    "learned_spread",
    "motion_distribution",
    "orientation_adjustments",
    "plot_blades",
    "plot_constraint",
    "plot_ellipses",
    "plot_forces",
    "plot_learned_spread",
    "plot_orientation",
    "plot_path",
    "plot_positions",
    "plot_residuals",
    "plot_speed",
    "plot_spread",
    "plot_tool_frame",
    "plot_values",
    "recording_cuts",
    "rhythm_cycles",
    "save_figure",
]
