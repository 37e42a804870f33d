"""noslip: movement primitives for tools that must not slip sideways."""

from noslip._version import __version__
from noslip.constraints import (
    Blade,
    Constraint,
    Motion,
    position_constraint,
    velocity_constraint,
)
from noslip.constraints.check import CheckReport, check
from noslip.demonstrations.loading import load_demonstrations
from noslip.demonstrations.preparation import prepare
from noslip.errors import (
    ConstraintError,
    ConvergenceError,
    InputError,
    MissingDependencyError,
    NoslipError,
)
from noslip.learning import ConstrainedDMP, learn
from noslip.primitives import ConstrainedMotion, OrientationDMP, PoseDMP, PositionDMP, State
from noslip.projection.pointwise import project_initial_velocity
from noslip.projection.trajectory import project_trajectory
from noslip.saving import load_primitive
from noslip.trajectory import PoseTrajectory

__all__ = [
    "Blade",
    "CheckReport",
    "ConstrainedDMP",
    "ConstrainedMotion",
    "Constraint",
    "ConstraintError",
    "ConvergenceError",
    "InputError",
    "MissingDependencyError",
    "Motion",
    "NoslipError",
    "OrientationDMP",
    "PoseDMP",
    "PoseTrajectory",
    "PositionDMP",
    "State",
    "__version__",
    "check",
    "learn",
    "load_demonstrations",
    "load_primitive",
    "position_constraint",
    "prepare",
    "project_initial_velocity",
    "project_trajectory",
    "velocity_constraint",
]
