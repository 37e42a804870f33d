"""From recordings to demonstrations: preparing, cutting, aligning, leaving out."""

from noslip.demonstrations.alignment import align
from noslip.demonstrations.outliers import Outliers, outliers
from noslip.demonstrations.preparation import prepare
from noslip.demonstrations.segmentation import Segments, segment

__all__ = [
    "Outliers",
    "Segments",
    "align",
    "outliers",
    "prepare",
    "segment",
]
