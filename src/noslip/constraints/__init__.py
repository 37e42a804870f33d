"""What must hold: constraints, each declared once.

Each file of this folder is read, so that a constraint in a new one is known without a list.
"""

import importlib
import pkgutil

from noslip.constraints.blade import Blade
from noslip.constraints.contact import CylinderContact, PlaneContact, SphereContact, SurfaceContact
from noslip.constraints.declaration import CATALOG, Constraint
from noslip.constraints.decorators import (
    FunctionConstraint,
    keep_nonnegative,
    position_constraint,
    velocity_constraint,
)
from noslip.constraints.distance_field import DistanceField
from noslip.constraints.fixed_point import FixedPoint
from noslip.constraints.instant import AcceleratedInstant, Instant
from noslip.constraints.joints import JointLimits, joint_limits
from noslip.constraints.keep_out import KeepOut, KeepOutCapsule, KeepOutSphere
from noslip.constraints.moving_frame import InMovingFrame
from noslip.constraints.needle import Needle
from noslip.constraints.of_body import HoldTogether, OfBody, of, relative_to
from noslip.constraints.rates import AccelerationLimit, AngularRateLimit, SpeedLimit
from noslip.constraints.region import Box, DepthLimit, HalfSpace
from noslip.constraints.remote_center import RemoteCenter
from noslip.constraints.rolling import RollingDisc, RollingSphere
from noslip.constraints.slice_push import SlicePushRatio, slice_push_ratios
from noslip.constraints.system import ConstraintSystem
from noslip.constraints.tool_axis import ToolAxis
from noslip.constraints.travel import ForwardOnly, TurningRadius
from noslip.constraints.wheel import Wheel

__all__ = [
    "AcceleratedInstant",
    "AccelerationLimit",
    "AngularRateLimit",
    "Blade",
    "Box",
    "Constraint",
    "ConstraintSystem",
    "CylinderContact",
    "DepthLimit",
    "DistanceField",
    "FixedPoint",
    "ForwardOnly",
    "FunctionConstraint",
    "HalfSpace",
    "HoldTogether",
    "InMovingFrame",
    "Instant",
    "JointLimits",
    "KeepOut",
    "KeepOutCapsule",
    "KeepOutSphere",
    "Needle",
    "OfBody",
    "PlaneContact",
    "RemoteCenter",
    "RollingDisc",
    "RollingSphere",
    "SlicePushRatio",
    "SpeedLimit",
    "SphereContact",
    "SurfaceContact",
    "ToolAxis",
    "TurningRadius",
    "Wheel",
    "joint_limits",
    "keep_nonnegative",
    "of",
    "position_constraint",
    "relative_to",
    "slice_push_ratios",
    "velocity_constraint",
]

for _file in pkgutil.iter_modules(__path__):
    importlib.import_module(f"{__name__}.{_file.name}")
globals().update({kind.__name__: kind for kind in CATALOG.values()})
