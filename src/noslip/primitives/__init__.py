"""Movement primitives: phase, basis, forcing term; position, orientation and pose."""

from noslip.primitives.orientation import OrientationDMP
from noslip.primitives.pose import ConstrainedMotion, PoseDMP, State
from noslip.primitives.position import PositionDMP

__all__ = ["ConstrainedMotion", "OrientationDMP", "PoseDMP", "PositionDMP", "State"]
