"""A primitive in a control loop."""

from noslip.control.controller import Controller, Replanned
from noslip.control.coordinates import SpaceController

__all__ = ["Controller", "Replanned", "SpaceController"]
