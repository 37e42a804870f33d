"""Recordings in files -> PoseTrajectory, and preparing them."""

from noslip.demonstrations.alignment import align
from noslip.demonstrations.loading import load_demonstrations
from noslip.demonstrations.outliers import Outliers, outliers
from noslip.demonstrations.preparation import prepare
from noslip.demonstrations.segmentation import Segments, segment

__all__ = [
    "Outliers",
    "Segments",
    "align",
    "load_demonstrations",
    "outliers",
    "prepare",
    "segment",
]
