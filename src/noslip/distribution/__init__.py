"""Distributions of motions that all keep the constraints: conditioned, sampled, held against others."""

from noslip.distribution.distribution import MotionDistribution, learn_distribution

__all__ = ["MotionDistribution", "learn_distribution"]
