"""From recordings to what holds in them: which constraint, along which axes, about which point."""

from noslip.identification.calibration import ToolFrame, synchronized, time_offset, tool_frame
from noslip.identification.identified import Identified, Place, Row
from noslip.identification.identify import identify

__all__ = [
    "Identified",
    "Place",
    "Row",
    "ToolFrame",
    "identify",
    "synchronized",
    "time_offset",
    "tool_frame",
]
