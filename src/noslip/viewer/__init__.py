"""The browser page on which motions are looked at, dragged and pushed (extra ``viewer``)."""

from noslip.errors import MissingDependencyError

try:
    import viser  # noqa: F401
except ImportError as error:
    raise MissingDependencyError(
        "the viewer needs viser; install it: pip install 'noslip[viewer]'"
    ) from error

from noslip.viewer.arm import Arm, Simulation, read_simulation
from noslip.viewer.drawing import Drawing, Follower
from noslip.viewer.page import Page
from noslip.viewer.recording import save_page
from noslip.viewer.tool import Part, load_tool, scalpel

__all__ = [
    "Arm",
    "Drawing",
    "Follower",
    "Page",
    "Part",
    "Simulation",
    "load_tool",
    "read_simulation",
    "save_page",
    "scalpel",
]
