"""What ``noslip`` offers at its top level; :mod:`noslip` loads it with the first of these names."""

from noslip import constraints, demonstrations, errors, recordings
from noslip._version import __version__
from noslip.bodies import Bodies
from noslip.boundary import Boundary
from noslip.citing import cite
from noslip.constraints import (
    Blade,
    Constraint,
    DepthLimit,
    Instant,
    KeepOutSphere,
    Needle,
    SpeedLimit,
    Wheel,
    keep_nonnegative,
    position_constraint,
    velocity_constraint,
)
from noslip.constraints.check import check
from noslip.control import Controller
from noslip.demonstrations import prepare, segment
from noslip.errors import NoslipError, NoslipWarning
from noslip.identification import identify
from noslip.improving import improve
from noslip.learning import learn
from noslip.many import learn_each
from noslip.primitive import ConstrainedDMP
from noslip.projection.trajectory import project_trajectory
from noslip.recordings import load_demonstrations, load_trajectory
from noslip.runtime.motion import Motion
from noslip.runtime.state import State
from noslip.saving import load_primitive
from noslip.shielding import Shield
from noslip.trajectory import PoseTrajectory
from noslip.vectors import Trajectory

__all__ = [
    "Blade",
    "Bodies",
    "Boundary",
    "ConstrainedDMP",
    "Constraint",
    "Controller",
    "DepthLimit",
    "Instant",
    "KeepOutSphere",
    "Motion",
    "Needle",
    "NoslipError",
    "NoslipWarning",
    "PoseTrajectory",
    "Shield",
    "SpeedLimit",
    "State",
    "Trajectory",
    "Wheel",
    "__version__",
    "check",
    "cite",
    "constraints",
    "demonstrations",
    "errors",
    "identify",
    "improve",
    "keep_nonnegative",
    "learn",
    "learn_each",
    "load_demonstrations",
    "load_primitive",
    "load_trajectory",
    "position_constraint",
    "prepare",
    "project_trajectory",
    "recordings",
    "segment",
    "velocity_constraint",
]
