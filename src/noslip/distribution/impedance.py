"""How stiffly a robot should hold to a motion: stiff where demonstrations agree, soft elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from noslip import _arguments
from noslip._typing import Floats
from noslip._values import Value
from noslip.errors import InputError
from noslip.series import Series
from noslip.spread import Spread
from noslip.trajectory import PoseTrajectory

LINEAR, ANGULAR = (100.0, 2000.0), (2.0, 100.0)
"""Least and largest stiffness (N/m; Nm/rad): what hands push aside with ease, and what arms of
seven joints hold without shaking."""
CHANNELS = {
    **dict.fromkeys(("kx", "ky", "kz"), "N/m"),
    **dict.fromkeys(("krx", "kry", "krz"), "Nm/rad"),
    **dict.fromkeys(("dx", "dy", "dz"), "Ns/m"),
    **dict.fromkeys(("drx", "dry", "drz"), "Nms/rad"),
}
"""Names and units of stiffness and damping beside a pose."""


@dataclass(frozen=True, eq=False)
class Impedance(Value):
    """A motion, and the diagonal impedance to hold it with, world frame.

    Attributes
    ----------
    trajectory : PoseTrajectory
        Its channels are stiffness and damping, as :data:`CHANNELS` names them; with them it is
        written to files and bags.
    stiffness : array, shape (N, 6)
        Along x, y, z (N/m), then about them (Nm/rad).
    damping : array, shape (N, 6)
        N s/m, then Nm s/rad.
    """

    trajectory: PoseTrajectory
    stiffness: Floats
    damping: Floats

    @classmethod
    def of(
        cls,
        motion: PoseTrajectory,
        spread: Spread,
        *,
        linear: Sequence[float] = LINEAR,
        angular: Sequence[float] = ANGULAR,
        damping_ratio: float = 1.0,
        mass: float = 1.0,
        inertia: float = 0.01,
    ) -> Impedance:
        """Impedance of a motion by how far others like it lie apart.

        ``k = k_min + (k_max - k_min) / (1 + v / v_mean)``, v the variance along the axis at that
        time and v_mean its mean along the motion and over the three axes: bounded, and falling with
        the variance as in Calinon, Sardellitti and Caldwell 2010.  ``d = 2 zeta sqrt(k m)``.

        Parameters
        ----------
        motion : PoseTrajectory
        spread : Spread
        linear, angular : two numbers
            Least and largest stiffness, N/m and Nm/rad.
        damping_ratio : float
            zeta; 1 is critical.
        mass, inertia : float
            That the robot shows at the tool (kg, kg m^2).
        """
        bounds = {"linear": _bounds("linear", linear), "angular": _bounds("angular", angular)}
        ratio = _arguments.not_negative("damping_ratio", damping_ratio)
        weights = _arguments.positive("mass", mass), _arguments.positive("inertia", inertia)
        fractions = (motion.times - motion.times[0]) / motion.duration
        stiffness, damping = [], []
        for (least, most), weight, deviation in zip(
            bounds.values(),
            weights,
            (spread.position_deviation, spread.rotation_deviation),
            strict=True,
        ):
            variance = deviation**2
            relative = variance / max(float(variance.mean()), np.finfo(float).tiny)
            along = [np.interp(fractions, spread.fractions, axis) for axis in relative.T]
            k = least + (most - least) / (1 + np.column_stack(along))
            stiffness.append(k)
            damping.append(2 * ratio * np.sqrt(k * weight))
        return cls(motion, np.hstack(stiffness), np.hstack(damping))

    def __post_init__(self) -> None:
        values = np.hstack([self.stiffness, self.damping])
        names, units = tuple(CHANNELS), tuple(CHANNELS.values())
        beside = Series(self.trajectory.times, values, names, units=units, name="impedance")
        object.__setattr__(self, "trajectory", self.trajectory.with_channels(beside))

    @property
    def channels(self) -> Series:
        """Stiffness and damping along the motion."""
        found = self.trajectory.channels
        assert found is not None
        return found


def _bounds(name: str, given: Sequence[float]) -> tuple[float, float]:
    array = _arguments.numbers(name, given)
    if array.shape != (2,) or not 0 <= array[0] <= array[1] or not np.isfinite(array).all():
        raise InputError(
            f"{name} must be the least and the largest stiffness, 0 or more, in this order; got "
            f"{_arguments.short(given)}"
        )
    return float(array[0]), float(array[1])
