"""Arms: motions tracked without slip, placements, closed-loop dynamics.  Extra ``robots``."""

from noslip.robots.chains import chain
from noslip.robots.dynamics import Control, Execution, execute, summary
from noslip.robots.executed import (
    Margins,
    ToolErrors,
    TrackedMotion,
    slip,
    slip_distance,
    tool_errors,
)
from noslip.robots.model import Robot, load, named, panda
from noslip.robots.placement import Candidate, Placement, place, postures
from noslip.robots.refusal import InfeasibleMotionError
from noslip.robots.timing import RAMP, TIME_STEP, timed
from noslip.robots.tracking import track
from noslip.robots.video import render

__all__ = [
    "RAMP",
    "TIME_STEP",
    "Candidate",
    "Control",
    "Execution",
    "InfeasibleMotionError",
    "Margins",
    "Placement",
    "Robot",
    "ToolErrors",
    "TrackedMotion",
    "chain",
    "execute",
    "load",
    "named",
    "panda",
    "place",
    "postures",
    "render",
    "slip",
    "slip_distance",
    "summary",
    "timed",
    "tool_errors",
    "track",
]
