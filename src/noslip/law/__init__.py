"""What a primitive wants: clock, space, attractor, learned force, start and goal."""

from noslip.law.fitting import fit
from noslip.law.law import Law

__all__ = ["Law", "fit"]
