"""Anyone's poses in, poses that keep constraints out; no primitive needed."""

from noslip.shielding.actions import ActionShield
from noslip.shielding.datasets import ShieldedRecording, shield_each
from noslip.shielding.shield import Shield

__all__ = ["ActionShield", "Shield", "ShieldedRecording", "shield_each"]
