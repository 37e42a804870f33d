"""What must hold: constraints, each declared once."""

from noslip.constraints.blade import Blade
from noslip.constraints.declaration import (
    Constraint,
    Motion,
    position_constraint,
    velocity_constraint,
)
from noslip.constraints.system import ConstraintSystem

__all__ = [
    "Blade",
    "Constraint",
    "ConstraintSystem",
    "Motion",
    "position_constraint",
    "velocity_constraint",
]
