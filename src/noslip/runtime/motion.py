"""A rolled-out motion: poses and velocities, and what the constraints did to them."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Self, cast

import numpy as np
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip._values import Value
from noslip.bodies import Bodies
from noslip.constraints.check import residual_text
from noslip.constraints.declaration import ROW
from noslip.errors import InputError
from noslip.law.channels import Channels
from noslip.law.layout import STATE, layouts
from noslip.law.points import rotation_of
from noslip.rule import no_rule
from noslip.runtime.state import State
from noslip.runtime.stepper import stepper_of
from noslip.space import POSE, Space
from noslip.timed import Timed
from noslip.trajectory import PoseTrajectory
from noslip.vectors import Trajectory

_SCALAR_LAST = np.roll(np.r_[STATE["quaternion"]], -1)
"""Places of a quaternion as SciPy wants it."""
HELD = 1e-9
"""A margin above minus this counts as kept: rounding of a motion far from the origin."""


@dataclass(frozen=True)
class GaveWay:
    """A limit that did not hold throughout.

    Attributes
    ----------
    name : str
    violation : float
        Largest violation, in the margin's unit.
    time : float
        When (s).
    share : float
        Share of the samples in violation.
    """

    name: str
    violation: float
    time: float
    share: float


@dataclass(frozen=True, eq=False)
class Asked(Value):
    """What the law asked of a motion.

    Attributes
    ----------
    start : State
        Where it began, and with which goal.
    steps : array, shape (N - 1, ...)
        What depends on the phase alone, the step of :class:`noslip.law.layout.Layouts`.
    space : Space
    returns : bool
        Whether it should end where it began.
    is_rhythm : bool
        Whether it is one: if it does not return, it should be where the law alone would be.
    """

    start: State
    steps: Floats
    space: Space = POSE
    returns: bool = False
    is_rhythm: bool = False

    @property
    def goal(self) -> tuple[Floats, Rotation]:
        """Where it should end: position (m) and rotation."""
        if self.returns:
            return self.start.position, self.start.rotation
        if self.is_rhythm:
            last, n = self._alone[1][-1], self.space.linear
            return last[:n], rotation_of(last[n : self.space.point_size])
        return self.start.goal_position, self.start.goal_rotation

    @cached_property
    def _alone(self) -> tuple[Floats, Floats]:
        stepper, first = stepper_of(no_rule(self.space)), self.start.vector()
        states = np.empty((len(self.steps), len(first)))
        stepper.run(first, self.steps, states, np.empty((len(self.steps), stepper.outputs.size)))
        times = np.append(self.start.time, self.steps[:, layouts(self.space).step["time"]])
        return times, np.vstack([first, states])

    def alone(self, times: Floats) -> Floats:
        """Positions at these times if nothing constrained the law (m), shape (N, 3)."""
        own, states = self._alone
        columns = states.T[: self.space.linear]
        return np.column_stack([np.interp(times, own, column) for column in columns])


@dataclass(frozen=True, eq=False)
class Commanded(Value):
    """What was commanded pose by pose.

    Attributes
    ----------
    poses : PoseTrajectory
    """

    poses: PoseTrajectory

    @property
    def goal(self) -> tuple[Floats, Rotation]:
        """The last pose: position (m) and rotation."""
        return self.poses.positions[-1], self.poses.rotations[-1]

    def alone(self, times: Floats) -> Floats:
        """Positions commanded at these times (m), shape (N, 3)."""
        own, columns = self.poses.times, self.poses.positions.T
        return np.column_stack([np.interp(times, own, column) for column in columns])


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class RolledOut(Timed):
    """What the constraints did to a motion, whatever moves.

    Attributes
    ----------
    constraint_residuals : array, shape (N, m)
        m/s, or the constraint's own unit; one column a row of the equalities.
    multipliers : array, shape (N, m)
        Lagrange multipliers lambda of the accelerations.
    constraint_forces : array, shape (N, n + 3 b)
        ``a - a_unconstrained``: linear (m/s^2), then angular (rad/s^2), world frame.
    constraint_names : tuple of str
        One a column.
    margins, limit_multipliers : array, shape (N, k)
        The same of the limits; a margin below zero is a violation, a multiplier above zero a push.
    limit_names : tuple of str
    row_forces : array, shape (N, m + k, n + 3 b)
        The part of ``constraint_forces`` that each equality, then each limit, causes.
    asked : Asked or Commanded
        Where it should end, and what the law, or whoever commands it, wants on the way.
    """

    constraint_residuals: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    multipliers: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    constraint_forces: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    constraint_names: tuple[str, ...] = ()
    margins: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    limit_multipliers: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    limit_names: tuple[str, ...] = ()
    row_forces: Floats = field(default_factory=lambda: np.zeros((0, 0, 0)))
    asked: Asked | Commanded

    def __post_init__(self) -> None:
        super().__post_init__()  # type: ignore[misc]
        rows, limits = len(self.constraint_names), len(self.limit_names)
        size = self.space.velocity_size
        self._freeze("constraint_residuals", self.constraint_residuals, (rows,))
        self._freeze("multipliers", self.multipliers, (rows,))
        self._freeze("constraint_forces", self.constraint_forces, (size,))
        if not limits and not len(self.margins):
            none = np.zeros((len(self.times), 0))
            object.__setattr__(self, "margins", none)
            object.__setattr__(self, "limit_multipliers", none)
        if not len(self.row_forces):
            object.__setattr__(self, "row_forces", np.zeros((len(self.times), rows + limits, size)))
        self._freeze("margins", self.margins, (limits,))
        self._freeze("limit_multipliers", self.limit_multipliers, (limits,))
        self._freeze("row_forces", self.row_forces, (rows + limits, size))

    @classmethod
    def of_steps(
        cls,
        times: Floats,
        states: Floats,
        outputs: dict[str, Floats],
        constraint_names: tuple[str, ...],
        limit_names: tuple[str, ...],
        asked: Asked,
    ) -> Self:
        """Return what a stepper has made, whose arrays it keeps: only NaN is looked for.

        Parameters
        ----------
        times : array, shape (N,)
        states : array, shape (N, 13 + m)
            Columns as :meth:`noslip.law.layout.Layouts.carried` says.
        outputs : dict of array, shape (N, ...)
            Named as in :meth:`noslip.law.layout.Layouts.output`.
        constraint_names, limit_names : tuple of str
            One a row.
        asked : Asked
        """
        if not np.isfinite(states).all():
            row = int(np.argmin(np.isfinite(states).all(axis=1)))
            raise InputError(
                f"the motion is not finite from {times[row]:.6g} s on; start, goal or "
                "constraints are out of what can be computed with"
            )
        space = asked.space
        rows, values = len(constraint_names), states[:, layouts(space).state.size :]
        multipliers = outputs["multipliers"]
        motion = object.__new__(cls)
        own, others = cls._moving(times, states, space)
        arrays = own | {
            "times": times,
            "constraint_residuals": values[:, :rows],
            "multipliers": multipliers[:, :rows],
            "constraint_forces": outputs["force"],
            "margins": values[:, rows:],
            "limit_multipliers": multipliers[:, rows:],
            "row_forces": outputs["parts"].reshape(
                len(times), rows + len(limit_names), space.velocity_size
            ),
        }
        for array in arrays.values():
            array.flags.writeable = False
        motion.__dict__.update(
            arrays,
            **others,
            constraint_names=constraint_names,
            limit_names=limit_names,
            asked=asked,
            name="rollout",
        )
        return motion

    @classmethod
    def _moving(
        cls, times: Floats, states: Floats, space: Space
    ) -> tuple[dict[str, Floats], dict[str, Any]]:
        """Arrays of what moves, and other fields, from states of a space."""
        raise NotImplementedError

    @property
    def end_error(self) -> float:
        """Distance from where it ends to its goal (m, or :attr:`unit`)."""
        return float(np.linalg.norm(self.positions[-1] - self.asked.goal[0]))

    @property
    def end_rotation_error(self) -> float:
        """The same of the rotation (rad); of several the largest."""
        last = self.rotations[-max(1, self.space.rotations) :]
        return float(np.max((last * self.asked.goal[1].inv()).magnitude()))

    @property
    def path_error(self) -> float:
        """Largest distance from where the law alone, or the command, is at the same time (m).

        That is how far constraints and limits push the motion off its way.
        """
        return float(np.linalg.norm(self.positions - self.asked.alone(self.times), axis=1).max())

    @property
    def clock(self) -> Floats:
        """Times as constraints see them: its own, which begin where a re-planned motion does."""
        return self.times

    def force_of(self, name: str) -> Floats:
        """What one constraint or limit added to the acceleration, shape (N, 6).

        Parameters
        ----------
        name : str
            Of a constraint, all of its rows together, or of a single row ("wheel, sideways").
        """
        names = (*self.constraint_names, *self.limit_names)
        columns = [
            i for i, row in enumerate(names) if row == name or row.startswith(f"{name}{ROW}")
        ]
        if not columns:
            raise InputError(f"no constraint {name!r} took part; there are {', '.join(names)}")
        return np.asarray(self.row_forces[:, columns].sum(axis=1))

    def _facts(self) -> dict[str, str]:
        """What a notebook tells of it: also what each row of the constraints comes to."""
        held = dict(zip(self.constraint_names, np.abs(self.constraint_residuals).T, strict=True))
        left = dict(zip(self.limit_names, self.margins.T, strict=True))
        return (
            super()._facts()
            | {"ends off its goal by": residual_text(self.end_error, self.unit)}
            | {f"{name}, residual": residual_text(max(row), "1") for name, row in held.items()}
            | {
                f"{name}, least margin": "0" if abs(min(row)) < HELD else f"{min(row):.3g}"
                for name, row in left.items()
            }
        )

    @property
    def gave_way(self) -> tuple[GaveWay, ...]:
        """Limits that did not hold throughout, and by how much; empty if all did."""
        found = []
        for name, margin in zip(self.limit_names, self.margins.T, strict=True):
            worst = int(np.argmin(margin))
            if margin[worst] < -HELD:
                share = float(np.mean(margin < -HELD))
                found.append(GaveWay(name, float(-margin[worst]), float(self.times[worst]), share))
        return tuple(found)


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Motion(RolledOut, PoseTrajectory):
    """A rolled-out motion and what the constraints did to it.

    ``linear_velocities[k]`` and ``angular_velocities[k]`` belong to the step that led to sample k,
    so that ``positions[k+1] == positions[k] + dt * linear_velocities[k+1]``.  For what it holds
    besides see :class:`RolledOut`.
    """

    def accompanied(self, channels: Channels) -> Motion:
        """Return the motion of a law from its start with what follows its phase."""
        assert isinstance(self.asked, Asked)
        return self.with_channels(channels.along(self, self.asked.start.duration))

    @classmethod
    def _moving(
        cls, times: Floats, states: Floats, space: Space
    ) -> tuple[dict[str, Floats], dict[str, Any]]:
        arrays = {
            "positions": states[:, STATE["position"]],
            "linear_velocities": states[:, STATE["linear_velocity"]],
            "angular_velocities": states[:, STATE["angular_velocity"]],
        }
        # Each step has normalized them; SciPy would take a fifth of the rollout's time.
        rotations = Rotation(states[:, _SCALAR_LAST], normalize=False, copy=False)
        return arrays, {"rotations": rotations}


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class VectorMotion(RolledOut, Trajectory):
    """The same of coordinates: ``values[k+1] == values[k] + dt * velocities[k+1]``."""

    @classmethod
    def _moving(
        cls, times: Floats, states: Floats, space: Space
    ) -> tuple[dict[str, Floats], dict[str, Any]]:
        place = layouts(space).state
        arrays = {
            "values": states[:, place["position"]],
            "velocities": states[:, place["linear_velocity"]],
        }
        named = {"names": space.coordinates, "units": space.units, "carrier": space.carrier}
        return arrays, named


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class BodiesMotion(RolledOut, Bodies):
    """The same of several bodies; ``motion["knife"]`` is the motion of one, without forces."""

    @classmethod
    def _moving(
        cls, times: Floats, states: Floats, space: Space
    ) -> tuple[dict[str, Floats], dict[str, Any]]:
        return {}, {"parts": parts_of(times, states, space)}


def parts_of(times: Floats, states: Floats, space: Space) -> OrderedDict[str, PoseTrajectory]:
    """Return the motion of each body of a space by its name, from states."""
    place = layouts(space).state
    names = "position", "quaternion", "linear_velocity", "angular_velocity"
    columns = [np.split(states[:, place[name]], space.rotations, axis=1) for name in names]
    parts: OrderedDict[str, PoseTrajectory] = OrderedDict()
    for body, p, q, v, w in zip(space.bodies, *columns, strict=True):
        turns = Rotation.from_quat(q, scalar_first=True)
        parts[body.name] = PoseTrajectory(times, p, turns, v, w, body.name)
    return parts


def motion_class(space: Space) -> type[Motion]:
    """Return what holds a motion of a space; they have the same attributes but for rotations."""
    if space.is_pose:
        return Motion
    return cast("type[Motion]", BodiesMotion if space.rotations else VectorMotion)
