"""Chunks of actions as arrays, as policies give them, through a shield."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from noslip import _arguments
from noslip._turns import parse_turn
from noslip._typing import Floats
from noslip.errors import CompromiseWarning, InputError, warn
from noslip.quaternions import turned, turns_between
from noslip.runtime.motion import Motion
from noslip.runtime.state import State
from noslip.shielding.poses import pose_of
from noslip.shielding.shield import Shield
from noslip.trajectory import PoseTrajectory


class ActionShield:
    """A shield for arrays of actions: poses of the tool, and whatever stands beside them.

    Called with a chunk, shape (T, D), it returns one of the same shape and type, whose poses keep
    the constraints and whose other columns are the same to the bit.  So it goes between any policy
    and what carries out its actions.

    Parameters
    ----------
    shield : Shield
        Its rate is that of the actions.
    rotation : str
        How an action writes the rotation, in the words of :func:`noslip.load_demonstrations`:
        ``rotvec`` (robosuite, LeRobot), ``xyzw``, ``wxyz``, ``euler:xyz:rad``, ``matrix:rows``, or
        ``6d``, the first two rows of the matrix (diffusion policy, UMI).
    columns : sequence of int, optional
        Where an action has the position's three numbers, and then the rotation's; by default its
        first.  The second arm of two is ``range(7, 13)``, say.
    delta : pair of float, optional
        Actions are changes, not poses: ``p' = p + a_p delta[0]`` and ``R' = Exp(a_R delta[1]) R``,
        world frame.  robosuite's OSC_POSE has (0.05, 0.5), the m and rad of a 1, beyond which it
        clips.

    Attributes
    ----------
    motion : Motion or None
        What came out last, in double precision.

    Raises
    ------
    InputError
        If the rotation or the columns are not understood.
    """

    def __init__(
        self,
        shield: Shield,
        rotation: str = "rotvec",
        *,
        columns: Sequence[int] | None = None,
        delta: tuple[float, float] | None = None,
    ) -> None:
        turn = parse_turn(rotation)
        count = 3 + turn.counts[0]
        if turn.kind == "planar" or (turn.kind == "matrix" and not turn.order):
            raise InputError(f"rotation {rotation!r}: give a rotation in space, such as rotvec")
        if delta is not None and (turn.kind != "rotvec" or turn.degrees):
            raise InputError(f"rotation {rotation!r}: changes are rotvec, in radians; give that")
        self._columns = np.arange(count) if columns is None else np.asarray(columns)
        if self._columns.shape != (count,) or len(set(self._columns.tolist())) != count:
            raise InputError(
                f"columns: {rotation} takes {count} columns, position first; got "
                f"{_arguments.short(columns)}"
            )
        # Actions are numbers of a program: its angles are radians unless it says degrees.
        self._turn = replace(turn, degrees=bool(turn.degrees)) if turn.angular else turn
        self._delta = delta and tuple(_arguments.positive("delta", each) for each in delta)
        self.shield = shield
        self.reset()

    def reset(self, pose: State | tuple[Floats, Rotation] | None = None) -> None:
        """Begin an episode: at rest in a pose, which changes need, or wherever the first one is."""
        self.shield.reset(pose)
        self.motion: Motion | None = None
        self._base: tuple[Floats, Floats] | None = None
        if pose is not None:
            position, rotation = pose_of("pose", pose)
            self._base = position, rotation.as_quat(scalar_first=True)

    def __call__(self, actions: ArrayLike, executed: int | None = None) -> NDArray[Any]:
        """Return a chunk of actions that keeps the constraints.

        Parameters
        ----------
        actions : array, shape (T, D)
        executed : int, optional
            How many actions of the last chunk were carried out; by default all.

        Warns
        -----
        CompromiseWarning
            If a change is beyond the 1 at which controllers clip, which would break the constraint.
        """
        given = np.asarray(actions)
        if given.ndim != 2 or given.shape[1] <= self._columns.max():
            raise InputError(
                f"actions: expected shape (T, D), D more than {self._columns.max()}; got "
                f"{given.shape}"
            )
        if self.motion is not None and executed != 0:
            last = len(self.motion) if executed is None else executed
            self._base = self.motion.positions[last - 1], self.motion.quaternions[last - 1]
        numbers = _arguments.numbers("actions", given[:, self._columns])
        if not np.isfinite(numbers).all():
            raise InputError(
                f"actions: row {int(np.argwhere(~np.isfinite(numbers))[0][0])} is not finite"
            )
        positions, quaternions = self._poses(numbers)
        self.motion = motion = self.shield.chunk(
            PoseTrajectory(
                np.arange(len(given)) / self.shield.rate,
                positions,
                Rotation.from_quat(quaternions, scalar_first=True),
                name="actions",
            ),
            executed if self.motion is not None else None,
        )
        out = given.astype(np.result_type(given.dtype, np.float32))
        out[:, self._columns] = self._numbers(motion, numbers)
        return out

    def _poses(self, numbers: Floats) -> tuple[Floats, Floats]:
        """Return positions and quaternions of actions."""
        if self._delta is None:
            return numbers[:, :3], self._turn.quaternions("actions", numbers[:, 3:])
        if self._base is None:
            raise InputError(
                "actions: changes begin at a pose; give it to reset((position, rotation))"
            )
        position, quaternion = self._base
        quaternions = np.empty((len(numbers), 4))
        for k, change in enumerate(numbers[:, 3:] * self._delta[1]):
            quaternions[k] = quaternion = turned(change, quaternion)
        return position + np.cumsum(numbers[:, :3] * self._delta[0], axis=0), quaternions

    def _numbers(self, motion: Motion, near: Floats) -> Floats:
        """Return the actions, shape (T, 3 + n), that make a motion."""
        if self._delta is None:
            return np.hstack(
                [motion.positions, self._turn.numbers(motion.quaternions, near[:, 3:])]
            )
        assert self._base is not None
        positions = np.vstack([self._base[0], motion.positions])
        quaternions = np.vstack([self._base[1], motion.quaternions])
        turns = turns_between(quaternions[:-1], quaternions[1:])
        changes = np.hstack([np.diff(positions, axis=0) / self._delta[0], turns / self._delta[1]])
        if (largest := np.abs(changes).max()) > 1 and self._delta != (1.0, 1.0):
            warn(
                f"actions: a change of {largest:.3g} is beyond the 1 where controllers clip, which "
                "breaks the constraint; give the shield limits=SpeedLimit(...)",
                CompromiseWarning,
            )
        return changes
