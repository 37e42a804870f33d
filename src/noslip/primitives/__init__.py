"""Movement primitives: phase, basis, forcing term; position, orientation and pose."""

from noslip.primitives.orientation import OrientationDMP
from noslip.primitives.pose import Motion, PoseDMP, State
from noslip.primitives.position import PositionDMP

__all__ = ["Motion", "OrientationDMP", "PoseDMP", "PositionDMP", "State"]
