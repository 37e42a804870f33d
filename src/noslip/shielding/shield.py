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
