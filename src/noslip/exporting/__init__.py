"""A primitive in C99, for a robot's own computer: its step, and its planner."""

from noslip.exporting.export import Exported as Exported
from noslip.exporting.export import export_c as export_c
