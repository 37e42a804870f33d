"""Measurements against the paper's method and against the usual library; ``make bench``."""
