"""A filter between whoever commands a tool and the tool: what comes out keeps the constraints."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

from scipy.spatial.transform import Rotation

from noslip import _arguments
from noslip._typing import Floats
from noslip.constraints.declaration import Constraint
from noslip.constraints.system import ConstraintSystem, as_system
from noslip.projection.metric import Metric
from noslip.runtime.motion import Motion
from noslip.runtime.state import State
from noslip.shielding.chunks import Chunks
from noslip.shielding.follower import Follower
from noslip.trajectory import PoseTrajectory


class Shield:
    """Poses of any policy, person or planner in; poses that keep the constraints out.

    A shield serves chunks of actions (:meth:`chunk`) or a stream of commands (:meth:`step`).

    Parameters
    ----------
    constraints : Constraint, several, or ConstraintSystem
        What holds at every step.
    rate : float
        Poses a second (Hz): of the chunks, or of the loop that calls :meth:`step`.
    metric : "auto", "position", "shared" or 6 positive weights
        Who gives way in :meth:`step`, see :mod:`noslip.projection.metric`.
    limits : Constraint or several
        Further constraints, such as limits on where the tool may be and how fast.

    Attributes
    ----------
    rate : float
    system : ConstraintSystem
        Constraints and limits.
    """

    def __init__(
        self,
        constraints: ConstraintSystem | Constraint | Sequence[Constraint],
        *,
        rate: float,
        metric: Metric = "auto",
        limits: ConstraintSystem | Constraint | Sequence[Constraint] = (),
    ) -> None:
        self.rate = _arguments.positive("rate", rate, "Hz")
        given = as_system(constraints).constraints + as_system(limits).constraints
        self.system, self.metric = ConstraintSystem(given), metric

    @cached_property
    def _chunks(self) -> Chunks:
        return Chunks(self.system, 1 / self.rate)

    @cached_property
    def _follower(self) -> Follower:
        return Follower(self.system, 1 / self.rate, self.metric)

    def reset(self, pose: State | tuple[Floats, Rotation] | None = None) -> None:
        """Begin anew: at rest in a pose, or wherever the first command is."""
        self.__dict__.pop("_chunks", None)
        self.__dict__.pop("_follower", None)
        if pose is not None:
            self._chunks.reset(pose)
            self._follower.reset(pose)

    def chunk(self, poses: PoseTrajectory, executed: int | None = None) -> Motion:
        """Return the motion nearest to a chunk of actions that keeps the constraints."""
        return self._chunks.next(poses, executed)

    def step(self, command: Any, measured: Any = None) -> State:
        """Return where to go in the next period, for a command that comes at each."""
        return self._follower.step(command, measured)
