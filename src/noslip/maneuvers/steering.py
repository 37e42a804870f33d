"""How a tool is steered, read from what is declared of it: which maneuvers lead it to a goal."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip.constraints.edge_motion import work_moves
from noslip.constraints.needle import Needle
from noslip.constraints.system import ConstraintSystem
from noslip.constraints.travel import TurningRadius
from noslip.edge import Edge, across
from noslip.maneuvers import planar, spatial
from noslip.maneuvers.beveled import Nearest, beveled, nearest_beveled
from noslip.maneuvers.clearing import Clear
from noslip.maneuvers.maneuver import Maneuver
from noslip.maneuvers.search import through
from noslip.quaternions import inverse, product

MARGIN, EASED = 1.01, 1.005
"""On radii, in maneuvers and in what they are projected onto: the barrier at run time, which acts
before a limit, does not push, and a maneuver has room to be projected in."""
_IN_PLANE = 1e-6
"""Height, over the distance, and tilt (rad), below which a goal lies in the plane of the start."""


@dataclass(frozen=True)
class Steering:
    """How a tool is steered.

    Attributes
    ----------
    edge : Edge
        With a lateral axis.
    radius : float
        The least of its bends (m); 0 where it may turn where it stands.
    curvature : float
        Of a beveled needle (1/m), which does not turn but by its roll; else 0.
    reverse : bool
        Whether it may back up.
    """

    edge: Edge
    radius: float = 0.0
    curvature: float = 0.0
    reverse: bool = False

    @classmethod
    def of(cls, system: ConstraintSystem, reverse: bool) -> Steering | None:
        """Read it from what is declared; None where nothing names an edge, or its work moves."""
        edged = system.edged
        if edged is None or edged.edge is None or edged.edge.lateral is None or work_moves(edged):
            return None
        radii = [c.radius for c in system.constraints if isinstance(c, TurningRadius)]
        bends = [_bend(c, edged.edge) for c in system.constraints if isinstance(c, Needle)]
        return cls(edged.edge, max(radii, default=0.0), max(bends, default=0.0, key=abs), reverse)

    def seen(self, positions: Floats, rotations: Rotation) -> tuple[Floats, Floats]:
        """Poses of the edge, positions (N, 3) and quaternions (N, 4), from those of the tool."""
        axes = rotations * Rotation.from_matrix(self.edge.frame.T)
        return self.edge.points(positions, rotations), axes.as_quat(scalar_first=True)

    def carried(self, points: Floats, quaternions: Floats) -> tuple[Floats, Rotation]:
        """Poses of the tool from those of its edge."""
        axes = Rotation.from_quat(quaternions, scalar_first=True)
        rotations = axes * Rotation.from_matrix(self.edge.frame)
        return points - rotations.apply(self.edge.point), rotations

    def proposals(
        self, first: tuple[Floats, Floats], last: tuple[Floats, Floats]
    ) -> list[Maneuver]:
        """Maneuvers from one pose of the edge to another, the shortest first."""
        position, quaternion = _seen_from(first, last)
        radius = MARGIN * self.radius
        if self.curvature:
            return beveled(position, quaternion, self.curvature)
        if not radius:
            return spatial.turn_drive_turn(position, quaternion, reverse=self.reverse)
        if (at := _in_plane(position, quaternion)) is None:
            # A blade that turns where it stands goes a shorter way, but stops for it.
            driven = spatial.arc_straight_arc(position, quaternion, radius)
            return driven + spatial.blade_turns(position, quaternion, radius)
        drive = planar.reeds_shepp if self.reverse else planar.dubins
        return drive(*at, radius)

    def nearest(self, first: tuple[Floats, Floats], last: tuple[Floats, Floats]) -> Nearest:
        """Return where a beveled needle comes nearest to a pose of the edge."""
        return nearest_beveled(*_seen_from(first, last), self.curvature)

    def around(
        self, first: tuple[Floats, Floats], last: tuple[Floats, Floats], clear: Clear, reach: float
    ) -> Maneuver | None:
        """Return a maneuver whose way is clear; None where none is found, or it is not in a plane.

        Parameters
        ----------
        first, last : (position, quaternion)
            Of the edge.
        clear : callable
            Margins (m) of poses of the edge, world frame.
        reach : float
            From the edge's point to the farthest point of the tool for which there is one (m).
        """
        at = _in_plane(*_seen_from(first, last))
        if at is None or self.curvature:
            return None
        turn = Rotation.from_quat(first[1], scalar_first=True)

        def seen(positions: Floats, quaternions: Floats) -> Floats:
            return clear(first[0] + turn.apply(positions), product(first[1], quaternions))

        radius = MARGIN * self.radius or None
        return through(*at, radius, seen, reverse=self.reverse, reach=reach)


def _seen_from(first: tuple[Floats, Floats], last: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
    """Position and quaternion of one pose as seen from another."""
    back = inverse(first[1])
    position = Rotation.from_quat(back, scalar_first=True).apply(last[0] - first[0])
    return position, product(back, last[1])


def _in_plane(position: Floats, quaternion: Floats) -> tuple[float, float, float] | None:
    """x, y (m) and heading (rad) of a pose in the plane of the start; None if it is not."""
    tilt = 2 * np.linalg.norm(quaternion[1:3])
    if abs(position[2]) > _IN_PLANE * np.linalg.norm(position) or tilt > _IN_PLANE:
        return None
    heading = 2 * np.arctan2(quaternion[3], quaternion[0])
    return float(position[0]), float(position[1]), float(heading)


def _bend(needle: Needle, edge: Edge) -> float:
    """Curvature of a needle about the third axis of its edge, which the bevel may be against."""
    bevel = across(needle.bevel, needle.shaft)
    return (needle.curvature or 0.0) * float(np.sign(bevel @ edge.frame[2]))
