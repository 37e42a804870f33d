"""How much a knife slices for what it pushes.

Cutting by slicing takes less force than by pushing alone: with the ratio xi of the speed along the
edge over the speed into the material, the forces fall as 1 / (1 + xi^2) and xi / (1 + xi^2)
(Atkins, Xu and Jeronimidis 2004, "Cutting, by 'pressing and slicing', of thin floppy slices").
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from noslip import _arguments
from noslip._typing import Expression, Floats
from noslip.constraints.declaration import register
from noslip.constraints.fields import ORIGIN, Triple, body_axis, point, settle, settle_edge
from noslip.constraints.instant import Instant
from noslip.constraints.limit import Limit
from noslip.edge import Axis, Edge, across, checked_axis, unit_axis
from noslip.trajectory import PoseTrajectory

_KINK = 1e-3
"""Speed (m/s) at which the margin is rounded where the edge turns back: far below that of a cut."""


@register
@dataclass(frozen=True)
class SlicePushRatio(Limit):
    """``sqrt(v_e^2 + k^2) - k - xi v_n >= 0``: the blade pushes no faster than it slices, over xi.

    With the speed along the edge ``v_e = (R e_b) . v`` and that into the material
    ``v_n = (R n_b) . v``; at k = 1 mm/s the kink of ``|v_e|`` is rounded, to the safe side.  Where
    the edge turns back the blade does not push; to rest and to withdraw is always allowed.

    Parameters
    ----------
    ratio : float
        xi, the least one.
    edge : str or 3 numbers
        e_b, the body axis along the edge.
    into : str or 3 numbers
        n_b, the body axis into the material: its part perpendicular to the edge.
    reference_point : 3 numbers
        The point of the tool that cuts (m, body frame).
    """

    ratio: float = 1.0
    edge: Edge | Axis = "x"  # type: ignore[assignment]
    into: Axis = "-z"
    reference_point: Triple = ORIGIN

    name = "slice-push-ratio"
    level = "velocity"

    def __post_init__(self) -> None:
        settle(
            self,
            self.name,
            ratio=_arguments.positive,
            into=checked_axis,
            reference_point=point,
        )
        settle_edge(self, self.name, None)
        across(self.into, _along(self), "slice-push-ratio: into and edge")

    def residual(self, motion: Instant) -> Expression:
        """How much faster the edge slices than it must (m/s)."""
        velocity = motion.at(self.reference_point).linear_velocity
        slicing = ca.dot(body_axis(motion, _along(self)), velocity)
        pushing = ca.dot(body_axis(motion, across(self.into, _along(self))), velocity)
        return ca.sqrt(slicing**2 + _KINK**2) - _KINK - self.ratio * pushing


def slice_push_ratios(
    trajectory: PoseTrajectory,
    *,
    edge: Axis = "x",
    into: Axis = "-z",
    reference_point: Triple = ORIGIN,
) -> Floats:
    """Slice-push ratio of each step of a motion: speed along the edge over speed into the material.

    Parameters
    ----------
    trajectory : PoseTrajectory
    edge, into, reference_point
        As for :class:`SlicePushRatio`.

    Returns
    -------
    array, shape (N - 1,)
        Not negative; infinite where the blade does not push.
    """
    tool = Edge(edge, None, reference_point)
    linear, angular = np.split(trajectory.body_velocities, [3], axis=1)
    velocity = linear + np.cross(angular, tool.point)
    slicing = np.abs(velocity @ unit_axis(tool.travel))
    pushing = velocity @ across(checked_axis("into", into), tool.travel, "into and edge")
    ratios = np.full(len(slicing), np.inf)
    np.divide(slicing, pushing, out=ratios, where=pushing > 0)
    return ratios


def _along(limit: SlicePushRatio) -> Axis:
    assert isinstance(limit.edge, Edge)
    return limit.edge.travel
