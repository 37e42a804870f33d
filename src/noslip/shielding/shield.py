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
from noslip.shielding.poses import pose_of
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

    @property
    def compromise(self) -> str:
        """What the last chunk sent does not do as commanded, and why; empty if nothing."""
        return self._chunks.compromise

    def reset(self, pose: State | tuple[Floats, Rotation] | None = None) -> None:
        """Begin anew: at rest in a pose, or wherever the first command is."""
        self.__dict__.pop("_chunks", None)
        self.__dict__.pop("_follower", None)
        if pose is not None:
            self._chunks.reset(*pose_of("pose", pose))
            self._follower.reset(pose)

    def chunk(self, poses: PoseTrajectory, executed: int | None = None) -> Motion:
        """Return the motion near a chunk of actions that keeps the constraints.

        The chunk is smoothed, joined to what was executed of the last one with continuous pose and
        twist, and projected as a whole.  One that keeps the constraints and goes on from there
        comes back as it is.

        Parameters
        ----------
        poses : PoseTrajectory
            Commanded poses, 4 or more (16 to 100, say), ``1 / rate`` apart; of their times only the
            distance counts.
        executed : int, optional
            How many poses of the last chunk were carried out; by default all.

        Returns
        -------
        Motion
            As many poses; the first is one period after the last that was carried out, or after
            :meth:`reset`'s; without either it is near the chunk's own.  Times go on (s), from 0.
            ``end_error`` and ``path_error`` say how far it is from what was commanded.

        Warns
        -----
        CompromiseWarning
            If it does not do as commanded: it ends far off, a soft limit gives way, or nothing near
            the command keeps the constraints.  Then the tool brakes along them and rests.
            :attr:`compromise` says the same.

        Raises
        ------
        InputError
            If the poses are too few or not ``1 / rate`` apart, or more were executed than sent.
        """
        return self._chunks.next(poses, executed)

    def step(self, command: Any, measured: Any = None) -> State:
        """Return where to go in the next period, for a command that comes at each."""
        return self._follower.step(command, measured)
