"""noslip: movement primitives for tools that must not slip sideways.

What a start needs is here; the rest is where its folder says: ``noslip.constraints``,
``noslip.recordings``, ``noslip.demonstrations``, ``noslip.robots``, ``noslip.errors``.
"""

from typing import Any

from noslip import constraints, demonstrations, errors, recordings, robots
from noslip._version import __version__
from noslip.boundary import Boundary
from noslip.constraints import (
    Blade,
    Constraint,
    DepthLimit,
    KeepOutSphere,
    Needle,
    SpeedLimit,
    Wheel,
    keep_nonnegative,
    position_constraint,
    velocity_constraint,
)
from noslip.constraints.check import CheckReport, check
from noslip.control import Controller
from noslip.demonstrations import prepare, segment
from noslip.errors import NoslipError, NoslipWarning
from noslip.learning import learn
from noslip.many import learn_each
from noslip.primitive import ConstrainedDMP
from noslip.projection.trajectory import project_trajectory
from noslip.recordings import load_demonstrations
from noslip.runtime.motion import Motion
from noslip.runtime.state import State
from noslip.saving import load_primitive
from noslip.trajectory import PoseTrajectory


def _plot(motion: PoseTrajectory, constraints: Any = ()) -> Any:
    """Draw it: path, pose over time, and what constraints say of it; return the figure.

    Parameters
    ----------
    constraints : Constraint or several, optional

    Returns
    -------
    matplotlib.figure.Figure
        :func:`noslip.figures.save_figure` writes it.
    """
    # Matplotlib takes as long to import as all the rest.
    from noslip.figures import compare_motions

    return compare_motions(motion, constraints)


def _plot_report(report: CheckReport) -> Any:
    """Draw what was checked, with residuals and margins over time; return the figure."""
    return _plot(report.trajectory, report.system)


PoseTrajectory.plot.function, CheckReport.plot.function = _plot, _plot_report

__all__ = [
    "Blade",
    "Boundary",
    "ConstrainedDMP",
    "Constraint",
    "Controller",
    "DepthLimit",
    "KeepOutSphere",
    "Motion",
    "Needle",
    "NoslipError",
    "NoslipWarning",
    "PoseTrajectory",
    "SpeedLimit",
    "State",
    "Wheel",
    "__version__",
    "check",
    "constraints",
    "demonstrations",
    "errors",
    "keep_nonnegative",
    "learn",
    "learn_each",
    "load_demonstrations",
    "load_primitive",
    "position_constraint",
    "prepare",
    "project_trajectory",
    "recordings",
    "robots",
    "segment",
    "velocity_constraint",
]
