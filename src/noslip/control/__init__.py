"""A primitive in a control loop."""

from noslip.control.controller import Controller
from noslip.control.coordinates import SpaceController
from noslip.control.planning import Replanned

__all__ = ["Controller", "Replanned", "SpaceController"]
