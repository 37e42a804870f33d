"""Timed vectors: joints, planar points, grippers, or any other coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from noslip._supplied import Supplied
from noslip._typing import Floats
from noslip.chain import Chain
from noslip.errors import InputError
from noslip.space import Space, jointed, positions, vectors
from noslip.timed import Timed
from noslip.trajectory import PoseTrajectory, step_estimates

_AXES = ("x", "y", "z")


@dataclass(frozen=True, eq=False)
class Trajectory(Timed):
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
    carrier : Chain, optional
        The robot of which these are joints; constraints of a tool are then about what it carries.
    name : str
        Where the trajectory came from; error messages and figures use it.

    Raises
    ------
    InputError
        If shapes disagree, a number is not finite, or the times do not increase.
    """

    times: Floats
    values: Floats
    names: tuple[str, ...] = None  # type: ignore[assignment]
    velocities: Floats = None  # type: ignore[assignment]
    units: tuple[str, ...] = None  # type: ignore[assignment]
    carrier: Chain | None = None
    name: str = "trajectory"

    def __post_init__(self) -> None:
        times = self._require_times()
        shape = np.shape(self.values)
        if len(shape) != 2 or not shape[1]:
            raise InputError(
                f"{self.name}: values has shape {shape}, expected ({len(times)}, n): a row a sample"
            )
        self._freeze("values", self.values, (shape[1],))
        given = self.velocities
        rates = step_estimates(times, self._steps) if given is None else given
        self._freeze("velocities", rates, (shape[1],))
        self._name("names", tuple(f"x{k}" for k in range(shape[1])))
        if self.carrier is not None and self.carrier.size != shape[1]:
            raise InputError(
                f"{self.name}: {shape[1]} coordinates, but {self.carrier.name} has "
                f"{self.carrier.size} joints"
            )
        usual = ("m",) if self.names == _AXES else ("1",)
        own = self.carrier.units if self.carrier is not None else usual * shape[1]
        self._name("units", own)

    def _name(self, what: str, usual: Sequence[str]) -> None:
        """Store texts, one a coordinate."""
        given = getattr(self, what)
        texts = tuple(usual) if given is None else tuple(given)
        count = self.values.shape[1]
        if isinstance(given, str) or len(texts) != count or not all(map(_is_text, texts)):
            raise InputError(f"{self.name}: {what} must be {count} texts, got {given!r}")
        if what == "names" and len(set(texts)) < count:
            raise InputError(f"{self.name}: names must differ, got {', '.join(texts)}")
        object.__setattr__(self, what, texts)

    # ---------------------------------------------------------------- what it is

    plot = Supplied("Draw the values over time; return the figure.")

    @property
    def unit(self) -> str:  # type: ignore[override]
        """Of :attr:`path_length`: that of all coordinates, or "1" if they differ."""
        return self.units[0] if len(set(self.units)) == 1 else "1"

    @property
    def space(self) -> Space:  # type: ignore[override]
        """What it moves in."""
        if self.carrier is not None:
            return jointed(self.carrier, self.names, self.units)
        if self.names == _AXES and set(self.units) == {"m"}:
            return positions()
        return vectors(self.names, self.units)

    @property
    def points(self) -> Floats:
        """The values; points of :attr:`space`, shape (N, n)."""
        return self.values

    @property
    def positions(self) -> Floats:  # type: ignore[override]
        """The values, as what is the same for all trajectories calls them."""
        return self.values

    @property
    def linear_velocities(self) -> Floats:
        """The velocities, likewise."""
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

    @cached_property
    def _steps(self) -> Floats:
        steps = np.diff(self.values, axis=0) / np.diff(self.times)[:, None]
        steps.flags.writeable = False
        return steps

    # ---------------------------------------------------------------- new ones from it

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
        units = tuple(carrier.units)
        return Trajectory(self.times, moved[0], joints, moved[1], units, carrier, self.name)

    def resampled(self, *, rate: float | None = None, times: ArrayLike | None = None) -> Trajectory:
        """Return the trajectory at other instants, by cubic splines.

        Parameters
        ----------
        rate : float
            Samples per second.  The first sample stays; the last is the last that fits.
        times : array, shape (M,)
            Or the instants themselves (s), within the recorded time.
        """
        instants = self._instants(rate, times)
        inside = np.clip(instants, self.times[0], self.times[-1])
        found = self.with_points(self._spline(inside), instants)
        return replace(found, velocities=self._spline(inside, 1))

    @cached_property
    def _spline(self) -> Any:
        return scipy.interpolate.CubicSpline(self.times, self.values)


def _is_text(value: Any) -> bool:
    return isinstance(value, str) and bool(value) and value.isprintable()
