"""Timed vectors: joints, planar points, grippers, or any other coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip.chain import Chain
from noslip.errors import InputError
from noslip.series import Series
from noslip.space import Space, jointed, positions, vectors
from noslip.trajectory import PoseTrajectory


@dataclass(frozen=True, eq=False)
class Trajectory(Series):
    """Timed vectors of n numbers, with the rates that go with them. Immutable.

    Parameters
    ----------
    times : array, shape (N,)
        Seconds, strictly increasing; may start anywhere.
    values : array, shape (N, n)
        In the coordinates' own units.
    names : sequence of str, optional
        One a coordinate; "x0", "x1", ... by default.  Those called x, y, z are a position in space,
        in meters: the place of a tool that never turns.
    velocities : array, shape (N, n), optional
        Units per second.  Left out, they are estimated by differences of second order.
    units : sequence of str, optional
        One a coordinate; by default "m" of a position, else "rad" where a robot carries a tool,
        else "1".
    name : str
        Where the trajectory came from; error messages and figures use it.
    carrier : Chain, optional
        The robot of which these are joints; constraints of a tool are then about what it carries.

    Raises
    ------
    InputError
        If shapes disagree, a number is not finite, or the times do not increase.
    """

    carrier: Chain | None = None

    if TYPE_CHECKING:
        # Given as anything like an array, kept as arrays.
        def __init__(
            self,
            times: ArrayLike,
            values: ArrayLike,
            names: Sequence[str] | None = None,
            velocities: ArrayLike | None = None,
            units: Sequence[str] | None = None,
            name: str = "trajectory",
            carrier: Chain | None = None,
        ) -> None: ...

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.carrier is not None and self.carrier.size != len(self.names):
            raise InputError(
                f"{self.name}: {len(self.names)} coordinates, but {self.carrier.name} has "
                f"{self.carrier.size} joints"
            )

    def _usual_units(self) -> Sequence[str]:
        fits = self.carrier is not None and self.carrier.size == len(self.names)
        return self.carrier.units if fits and self.carrier else super()._usual_units()

    # ---------------------------------------------------------------- what it is

    @property
    def space(self) -> Space:  # type: ignore[override]
        """What it moves in."""
        if self.carrier is not None:
            return jointed(self.carrier, self.names, self.units)
        if self.names == ("x", "y", "z") and set(self.units) == {"m"}:
            return positions()
        return vectors(self.names, self.units)

    @property
    def points(self) -> Floats:
        """The values; points of :attr:`space`, shape (N, n)."""
        return self.values

    @property
    def linear_velocities(self) -> Floats:
        """The velocities, as what is the same for all trajectories calls them."""
        return self.velocities

    @property
    def quaternions(self) -> Floats:
        """None: nothing turns; shape (N, 0)."""
        return np.zeros((len(self), 0))

    @property
    def angular_velocities(self) -> Floats:
        """None: nothing turns; shape (N, 0)."""
        return np.zeros((len(self), 0))

    @property
    def rotations(self) -> Rotation:
        """The identity: nothing turns."""
        return Rotation.identity(len(self))

    @property
    def tool(self) -> PoseTrajectory:
        """Poses of the tool that the coordinates carry.

        Raises
        ------
        InputError
            If nothing carries one.
        """
        if self.space == positions():
            still = Rotation.identity(len(self))
            return PoseTrajectory(self.times, self.values, still, self.velocities, name=self.name)
        if self.carrier is None:
            raise InputError(
                f"{self.name}: no robot is known that carries a tool; give carrier, or robot to "
                "what reads or learns it"
            )
        return self.carrier.poses(self.times, self.values, self.velocities, name=self.name)

    def step_velocities(self) -> tuple[Floats, Floats]:
        """Rates of every step, shape (N - 1, n), and no angular ones, shape (N - 1, 0)."""
        return self._steps, np.zeros((len(self) - 1, 0))

    # ---------------------------------------------------------------- new ones from it

    def resampled(self, *, rate: float | None = None, times: ArrayLike | None = None) -> Trajectory:
        """Return it at other instants, by cubic splines; as :meth:`PoseTrajectory.resampled`."""
        # Of a rollout too the values alone: what constraints did to it is of its own steps.
        alone = replace(self.with_points(self.values), velocities=self.velocities)
        return super(Trajectory, alone).resampled(rate=rate, times=times)

    def with_points(self, points: Floats, times: Floats | None = None) -> Trajectory:
        """Return other values of the same coordinates."""
        return Trajectory(
            self.times if times is None else times,
            points,
            self.names,
            units=self.units,
            carrier=self.carrier,
            name=self.name,
        )

    def with_velocities(self, linear: Floats, angular: Floats) -> Trajectory:
        """Return the values with other rates, shape (N, n); of turning, shape (N, 0), are none."""
        return replace(self, velocities=linear)

    def on(self, carrier: Chain) -> Trajectory:
        """Return it as joints of a robot, which carry a tool.

        Coordinates that are named as the joints are put into their order; others are taken to be
        in it.

        Raises
        ------
        InputError
            If there are more or fewer.
        """
        joints = carrier.joint_names
        if set(joints) <= set(self.names):
            order = [self.names.index(joint) for joint in joints]
        elif len(joints) == len(self.names):
            order = list(range(len(joints)))
        else:
            raise InputError(
                f"{self.name}: has {', '.join(self.names)}, but the joints of {carrier.name} are "
                f"{', '.join(joints)}; name them so"
            )
        moved = self.values[:, order], self.velocities[:, order]
        return Trajectory(
            self.times, moved[0], joints, moved[1], tuple(carrier.units), self.name, carrier
        )
