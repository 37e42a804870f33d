"""Distributions of motions that all keep the constraints: conditioned, drawn from, compared."""

from noslip.distribution.distribution import MotionDistribution, learn_distribution
from noslip.distribution.impedance import Impedance

__all__ = ["Impedance", "MotionDistribution", "learn_distribution"]
