"""Which constraint holds in recordings, and about which point.

The velocity level is fitted here, from the rows of :mod:`noslip.identification.rows`; the position
level by ``noslip.identification.places.fit_places(trajectories, noise)``, a list of
:class:`~noslip.identification.identified.Place`.
"""

from __future__ import annotations

from collections.abc import Iterable

from noslip.identification.identified import Identified
from noslip.trajectory import PoseTrajectory


def identify(
    trajectories: PoseTrajectory | Iterable[PoseTrajectory],
    *,
    noise: tuple[float, float] | None = None,
) -> Identified:
    """Find which constraint the tool of recordings obeys, and about which of its points.

    Parameters
    ----------
    trajectories : PoseTrajectory or several
        Of one tool and one sensor on it; in any body frame, at any rates.
    noise : (float, float), optional
        Standard deviation of a sample's position (m) and rotation (rad, about each axis); by
        default estimated from the recordings.

    Raises
    ------
    InputError
        If they are no recordings, stand still or are too short.
    """
    raise NotImplementedError
