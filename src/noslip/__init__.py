"""noslip: movement primitives for tools that must not slip sideways."""

from noslip import robots
from noslip._version import __version__
from noslip.adaptation import Via
from noslip.constraints import (
    AccelerationLimit,
    AngularRateLimit,
    Blade,
    Box,
    Constraint,
    CylinderContact,
    DepthLimit,
    ForwardOnly,
    HalfSpace,
    InMovingFrame,
    Instant,
    KeepOutCapsule,
    KeepOutSphere,
    Needle,
    PlaneContact,
    RemoteCenter,
    RollingDisc,
    RollingSphere,
    SpeedLimit,
    SphereContact,
    SurfaceContact,
    ToolAxis,
    TurningRadius,
    Wheel,
    keep_nonnegative,
    position_constraint,
    velocity_constraint,
)
from noslip.constraints.check import CheckReport, check
from noslip.demonstrations.alignment import align
from noslip.demonstrations.outliers import Outliers, outliers
from noslip.demonstrations.preparation import prepare
from noslip.demonstrations.segmentation import Segments, segment
from noslip.errors import (
    ConstraintError,
    ConvergenceError,
    InputError,
    MissingDependencyError,
    NoslipError,
    RecordingError,
)
from noslip.learning import ConstrainedDMP, learn
from noslip.many import LearnedEach, learn_each
from noslip.primitives import Motion, OrientationDMP, PoseDMP, PositionDMP, State
from noslip.projection.pointwise import project_initial_velocity
from noslip.projection.trajectory import project_trajectory
from noslip.recordings import (
    BagTopic,
    bag_topics,
    load_demonstrations,
    write_bag,
    write_joints,
    write_recording,
)
from noslip.result_table import RecordingResult
from noslip.runtime.controller import Controller
from noslip.saving import load_primitive
from noslip.trajectory import PoseTrajectory

__all__ = [
    "AccelerationLimit",
    "AngularRateLimit",
    "BagTopic",
    "Blade",
    "Box",
    "CheckReport",
    "ConstrainedDMP",
    "Constraint",
    "ConstraintError",
    "Controller",
    "ConvergenceError",
    "CylinderContact",
    "DepthLimit",
    "ForwardOnly",
    "HalfSpace",
    "InMovingFrame",
    "InputError",
    "Instant",
    "KeepOutCapsule",
    "KeepOutSphere",
    "LearnedEach",
    "MissingDependencyError",
    "Motion",
    "Needle",
    "NoslipError",
    "OrientationDMP",
    "Outliers",
    "PlaneContact",
    "PoseDMP",
    "PoseTrajectory",
    "PositionDMP",
    "RecordingError",
    "RecordingResult",
    "RemoteCenter",
    "RollingDisc",
    "RollingSphere",
    "Segments",
    "SpeedLimit",
    "SphereContact",
    "State",
    "SurfaceContact",
    "ToolAxis",
    "TurningRadius",
    "Via",
    "Wheel",
    "__version__",
    "align",
    "bag_topics",
    "check",
    "keep_nonnegative",
    "learn",
    "learn_each",
    "load_demonstrations",
    "load_primitive",
    "outliers",
    "position_constraint",
    "prepare",
    "project_initial_velocity",
    "project_trajectory",
    "robots",
    "segment",
    "velocity_constraint",
    "write_bag",
    "write_joints",
    "write_recording",
]
