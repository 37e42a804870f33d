"""New goals, starts and via points under the constraint.

A constraint that forbids velocities forbids no pose, yet no smooth feedback law leads a
non-holonomic system to every pose (Brockett 1983), and a coupling term alone stops short of a goal
that moved.  So a whole trajectory is adapted: the unconstrained primitive's motion is moved to the
new boundary values by minimum jerk, projected onto the constraints with these values fixed, and the
primitive is fitted to the result.  From a state in the middle of a motion, the same is re-planning.
"""

from noslip.adapting.adaptation import adapt
from noslip.adapting.connecting import Shape
from noslip.adapting.plan import Adapted
from noslip.adapting.replanning import REPLANNED_SAMPLES, replan

__all__ = ["REPLANNED_SAMPLES", "Adapted", "Shape", "adapt", "replan"]
