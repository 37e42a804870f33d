"""noslip: movement primitives for tools that must not slip sideways."""

from noslip._version import __version__
from noslip.trajectory import PoseTrajectory

__all__ = ["PoseTrajectory", "__version__"]
