"""A filter between whoever commands a tool and the tool: what comes out keeps the constraints."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path

from scipy.spatial.transform import Rotation

from noslip import _arguments
from noslip._typing import Floats
from noslip.constraints.declaration import Constraint
from noslip.constraints.system import ConstraintSystem, as_system
from noslip.exporting.export import Exported
from noslip.projection.metric import Metric
from noslip.runtime.motion import Motion
from noslip.runtime.state import State
from noslip.shielding.chunks import Chunks
from noslip.shielding.exporting import export_c
from noslip.shielding.follower import Follower, Pose
from noslip.shielding.poses import pose_of
from noslip.trajectory import PoseTrajectory


class Shield:
    """Poses of any policy, person or planner in; poses that keep the constraints out.

    A shield serves chunks of actions (:meth:`chunk`) or a stream of commands (:meth:`step`), not
    both in turn: neither knows of the other.

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
            Commanded poses, 4 to 1000 (16 to 100, say), ``1 / rate`` apart; of their times only the
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
            If there are too few poses or too many, they are not ``1 / rate`` apart, or more were
            executed than sent.
        """
        return self._chunks.next(poses, executed)

    def step(self, command: Pose | None = None, measured: Pose | None = None) -> State:
        """Return where to go in the next period (1 / rate), for a stream of commands.

        The tool follows a smoothed hand, lags behind it by 60 ms where it is fast to 0.2 s where it
        rests, keeps to at most twice its peak speeds, and makes up for what the constraints forbid
        by steering as it moves (:mod:`noslip.shielding.following`).  Some places it cannot reach:
        :attr:`distance` and :attr:`angle` say how far away the command is.

        The first step under given constraints builds their graphs; machine code is compiled beside
        the loop, and taken once it is there.

        Parameters
        ----------
        command : State, or (position, Rotation), optional
            Where the hand is (m, world frame).  None: none came, and the last one stands.
        measured : State, or (position, Rotation), optional
            Where the tool was seen to be, if it was since the last step.  A tool that is far from
            where it was commanded to is waited for, beyond lag, noise and bias; a command does not
            start from what is measured.  What is not finite is a sample that was lost.

        Raises
        ------
        InputError
            If the command is not finite, or none came yet; the state is as it was.
        """
        return self._follower.step(command, measured)

    @property
    def distance(self) -> float:
        """From where the tool is commanded to, to the last command of the stream (m)."""
        return self._follower.distance

    @property
    def angle(self) -> float:
        """The same of the orientation (rad)."""
        return self._follower.angle

    def export_c(self, folder: str | Path, *, prefix: str = "noslip") -> Exported:
        """Write :meth:`step` as C99: no heap, nothing but libm.

        Parameters
        ----------
        folder : path
            Made if it is missing.
        prefix : str
            Of all names: two exports with different ones can be linked into one program.

        Returns
        -------
        Exported
            ``shield.h`` and ``shield.c``, ``shield_example.c`` and ``shield_test.c``.

        Raises
        ------
        InputError
            If the prefix is no C identifier or is taken, or the folder is a file.
        """
        return export_c(self.system, 1 / self.rate, self.metric, folder, prefix=prefix)
