"""A primitive in a control loop."""

from noslip.control.controller import Controller, Replanned

__all__ = ["Controller", "Replanned"]
