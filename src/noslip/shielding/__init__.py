"""Anyone's poses in, poses that keep constraints out; no primitive needed."""

from noslip.shielding.shield import Shield

__all__ = ["Shield"]
