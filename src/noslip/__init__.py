"""noslip: movement primitives for tools that must not slip sideways.

What a start needs is here; the rest is where its folder says: ``noslip.constraints``,
``noslip.recordings``, ``noslip.demonstrations``, ``noslip.robots``, ``noslip.errors``.  Each is
loaded when it is first named (PEP 562), so that what a program does not use costs it nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from noslip._supplied import Supplied
from noslip._version import __version__ as __version__

if TYPE_CHECKING:
    from noslip import robots as robots
    from noslip._face import *  # noqa: F403
    from noslip.constraints.check import CheckReport
    from noslip.series import Series
    from noslip.trajectory import PoseTrajectory
else:

    def __getattr__(name):
        """Return a module of noslip, or what stands in ``_face``."""
        module = f"{__name__}.{name}"
        if not name.startswith("__"):
            try:
                return import_module(module)
            except ModuleNotFoundError as error:
                if error.name != module:
                    raise
        if not name.startswith("_") or name == "__all__":
            face = import_module("noslip._face")
            if hasattr(face, name):
                return globals().setdefault(name, getattr(face, name))
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}{_elsewhere(name)}")

    def _elsewhere(name):
        """Say where a name stands that is not on top, or which of these was meant."""
        if name.startswith("_"):
            return ""
        # Not above: it takes as long to import as all else here.
        from pkgutil import iter_modules

        face = import_module("noslip._face")
        for module in (face.constraints, face.demonstrations, face.recordings, face.errors):
            if hasattr(module, name):
                return f"; it is {module.__name__}.{name}"
        modules = (module.name for module in iter_modules(globals()["__path__"]))
        known = [*face.__all__, *(module for module in modules if not module.startswith("_"))]
        return face.errors.did_you_mean(name, known)

    def __dir__():
        return sorted({*globals(), *import_module("noslip._face").__all__})


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


def _plot_bodies(bodies: Any, constraints: Any = ()) -> Any:
    """Draw paths of bodies, in the world and of one as another sees it; return the figure."""
    from noslip.figures import bodies_paths

    return bodies_paths(bodies, constraints)


def _plot_values(values: Series, *, title: str | None = None) -> Any:
    """Draw the values over time; return the figure.

    Parameters
    ----------
    title : str, optional

    Returns
    -------
    matplotlib.figure.Figure
        :func:`noslip.figures.save_figure` writes it.
    """
    from noslip.figures import plot_values

    return plot_values(values, title=title)


def _plot_report(report: CheckReport) -> Any:
    """Draw what was checked, with residuals and margins over time; return the figure."""
    return report.trajectory.plot(report.system)


def _plot_identified(found: Any) -> Any:
    """Draw why: slip of each direction, the point and its region; return the figure."""
    from noslip.figures import identified_constraint

    return identified_constraint(found)


def _chain(robot: Any) -> Any:
    """Return the joints of a robot that lead to its tool; see :func:`noslip.robots.chain`."""
    from noslip.robots import chain

    return chain(robot)


Supplied.functions.update(
    {
        "robots.chain": _chain,
        "PoseTrajectory.plot": _plot,
        "Bodies.plot": _plot_bodies,
        "Series.plot": _plot_values,
        "CheckReport.plot": _plot_report,
        "Identified.plot": _plot_identified,
    }
)
