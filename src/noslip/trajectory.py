"""The value that flows through everything: timed poses of one tool."""

from __future__ import annotations

import copy
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import scipy
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from noslip._files import write_beside
from noslip._pose_columns import Asked
from noslip._pose_names import POSE as POSE_COLUMNS
from noslip._pose_names import clock_name
from noslip._pose_npz import CHANNELS, npz_bytes, read_npz
from noslip._pose_text import read_text_table
from noslip._samples import Samples
from noslip._supplied import Supplied
from noslip._typing import Floats
from noslip.errors import InputError
from noslip.named_columns import listed, numbers_text
from noslip.quaternions import inverse, product, turns_between, without_flips
from noslip.series import Series
from noslip.space import POSE, Space
from noslip.timed import Timed, step_estimates


@dataclass(frozen=True, eq=False)
class PoseTrajectory(Timed):
    """Timed poses of a tool, with the velocities that go with them. Immutable.

    Parameters
    ----------
    times : array, shape (N,)
        Seconds, strictly increasing; may start anywhere.
    positions : array, shape (N, 3)
        Meters, world frame.
    rotations : Rotation, length N
        Body to world.
    linear_velocities, angular_velocities : array, shape (N, 3), optional
        Meters and radians per second, world frame (the angular velocity is the body's,
        ``dR/dt = [w] R``).  Left out, they are estimated by differences of second order.
    name : str
        Where the trajectory came from; error messages and figures use it.
    channels : Series, optional
        What goes with the pose at the same times: a gripper, a wrench, a stiffness; a
        :class:`noslip.Trajectory` is one.  Slices, resampling, preparing and alignment keep them.

    Raises
    ------
    InputError
        If shapes disagree, a number is not finite, or the times do not increase.
    """

    times: Floats
    positions: Floats
    rotations: Rotation
    linear_velocities: Floats = field(default=None)  # type: ignore[arg-type]
    angular_velocities: Floats = field(default=None)  # type: ignore[arg-type]
    name: str = "trajectory"
    channels: Series | None = None

    if TYPE_CHECKING:
        # Given as anything like an array, kept as arrays.
        def __init__(
            self,
            times: ArrayLike,
            positions: ArrayLike,
            rotations: Rotation,
            linear_velocities: ArrayLike | None = None,
            angular_velocities: ArrayLike | None = None,
            name: str = "trajectory",
            channels: Series | None = None,
        ) -> None: ...

    def __post_init__(self) -> None:
        times = self._require_times()
        self._freeze("positions", self.positions, (3,))
        if not isinstance(self.rotations, Rotation):
            raise InputError(
                f"{self.name}: rotations must be a SciPy Rotation, "
                f"got {type(self.rotations).__name__}; of quaternions take "
                "Rotation.from_quat(quaternions, scalar_first=True)"
            )
        quaternions = self.rotations.as_quat()
        if quaternions.shape != (len(times), 4):
            count = len(quaternions) if quaternions.ndim == 2 else "not a row of"
            raise InputError(f"{self.name}: {len(times)} times but {count} rotations")
        if not np.all(np.isfinite(quaternions)):
            raise InputError(f"{self.name}: rotations hold a number that is not finite")
        # Rotations can be assigned to by index; what the caller does to theirs must stay theirs.
        object.__setattr__(self, "rotations", copy.deepcopy(self.rotations))
        for k, kind in enumerate(("linear_velocities", "angular_velocities")):
            given = getattr(self, kind)
            self._freeze(
                kind, step_estimates(times, self._steps[k]) if given is None else given, (3,)
            )
        self._require_channels()

    def _require_channels(self) -> None:
        """Refuse channels at other times, and those that have the names of the pose's columns."""
        beside = self.channels
        if beside is None:
            return
        if not isinstance(beside, Series):
            raise InputError(
                f"{self.name}: channels must be a Trajectory, got {type(beside).__name__}"
            )
        if not np.array_equal(beside.times, self.times):
            raise InputError(
                f"{self.name}: channels have other times than the poses; give them at these, "
                "channels.between(poses.times)"
            )
        if taken := set(beside.names) & set(POSE_COLUMNS):
            raise InputError(
                f"{self.name}: a channel is called {', '.join(sorted(taken))}, as the pose is; "
                "rename it"
            )

    def with_channels(self, channels: Series | None) -> Self:
        """Return it with other channels, or none; their times must be its own."""
        found = copy.copy(self)
        object.__setattr__(found, "channels", channels)
        found._require_channels()
        return found

    # ---------------------------------------------------------------- what it is

    plot = Supplied("Draw it, and what constraints say of it; return the figure.")

    @property
    def quaternions(self) -> Floats:
        """Unit quaternions ``(qw, qx, qy, qz)``, shape (N, 4), without sign flips."""
        return continuous_quaternions(self.rotations)

    @property
    def space(self) -> Space:  # type: ignore[override]
        """What it moves in."""
        return POSE

    @property
    def points(self) -> Floats:
        """Positions and quaternions, shape (N, 7)."""
        return np.hstack([self.positions, self.quaternions])

    @property
    def tool(self) -> PoseTrajectory:
        """The tool's own motion: itself."""
        return self

    def with_points(self, points: Floats, times: Floats | None = None) -> PoseTrajectory:
        """Return other poses under the same name, shape (N, 7).

        Each has the channels of its sample, if there are as many.
        """
        beside = self.channels if len(points) == len(self) else None
        if beside is not None and times is not None:
            beside = beside.retimed(times)
        return PoseTrajectory(
            self.times if times is None else times,
            points[:, :3],
            Rotation.from_quat(points[:, 3:], scalar_first=True),
            name=self.name,
            channels=beside,
        )

    def with_velocities(self, linear: Floats, angular: Floats) -> PoseTrajectory:
        """Return the poses with other velocities (m/s, rad/s), each of shape (N, 3)."""
        return replace(self, linear_velocities=linear, angular_velocities=angular)

    def step_velocities(self) -> tuple[Floats, Floats]:
        """Linear and angular velocity of every step, each of shape (N - 1, 3).

        Step ``k`` leads from sample ``k`` to sample ``k + 1`` with ``p' = p + h v`` and
        ``R' = Exp(h w) R``.  These are the velocities of the discrete motion itself: what a
        controller that plays the samples executes, and what constraints are held on.
        """
        return self._steps

    @property
    def body_velocities(self) -> Floats:
        """Twist of every step as the body feels it, shape (N - 1, 6): m/s, then rad/s.

        In the frame in the middle of the step, :meth:`step_middles`, where velocity-level
        constraints hold: what must not slip is zero to rounding.
        """
        _, _, rotations = self.step_middles()
        return np.hstack([rotations.inv().apply(v) for v in self.step_velocities()])

    @cached_property
    def _steps(self) -> tuple[Floats, Floats]:
        periods = np.diff(self.times)[:, None]
        quaternions = self.rotations.as_quat(scalar_first=True)
        turns = turns_between(quaternions[:-1], quaternions[1:])
        steps = np.diff(self.positions, axis=0) / periods, turns / periods
        for velocities in steps:
            velocities.flags.writeable = False
        return steps

    # ---------------------------------------------------------------- new ones from it

    def step_middles(self) -> tuple[Floats, Floats, Rotation]:
        """Time (s, of :attr:`clock`), position (m) and rotation in the middle of each step.

        That is where velocity-level constraints are asked: half of the chord, half of the turn.
        """
        half = np.diff(self.times) / 2
        linear, angular = self.step_velocities()
        turns = Rotation.from_rotvec(half[:, None] * angular)
        return (
            self.clock[:-1] + half,
            self.positions[:-1] + half[:, None] * linear,
            turns * self.rotations[:-1],
        )

    def resampled(
        self, *, rate: float | None = None, times: ArrayLike | None = None
    ) -> PoseTrajectory:
        """Return the trajectory at other instants, by cubic splines.

        Positions and quaternions follow cubic splines, the quaternions' normalized (both twice
        continuously differentiable); velocities are the splines' own derivatives.  Channels follow
        straight lines from sample to sample: a gripper's jump stays one.

        Parameters
        ----------
        rate : float
            Samples per second.  The first sample stays; the last is the last that fits.
        times : array, shape (M,)
            Or the instants themselves (s), within the recorded time.
        """
        instants = self._instants(rate, times)
        inside = np.clip(instants, self.times[0], self.times[-1])
        poses, rates = self._spline(inside), self._spline(inside, 1)
        quaternions, size = poses[:, 3:], np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
        # Of q / |q|; what changes the length alone is the product's real part.
        turning = product(rates[:, 3:], inverse(quaternions))[:, 1:] * (2 / size**2)
        return PoseTrajectory(
            times=instants,
            positions=poses[:, :3],
            rotations=Rotation.from_quat(quaternions, scalar_first=True),
            linear_velocities=rates[:, :3],
            angular_velocities=turning,
            name=self.name,
            channels=None if self.channels is None else self.channels.between(inside, instants),
        )

    @cached_property
    def _spline(self) -> Any:
        return scipy.interpolate.CubicSpline(
            self.times, np.hstack([self.positions, self.quaternions])
        )

    # ---------------------------------------------------------------- files

    def csv_text(self) -> str:
        """Return ``t,x,y,z,qw,qx,qy,qz`` and channels as text; floats are read back as they are."""
        names, table = [clock_name(self.times), *POSE_COLUMNS], [self.times[:, None], self.points]
        if self.channels is not None:
            names += self.channels.csv_columns()
            table.append(self.channels.values)
        return numbers_text(names, np.hstack(table))

    def to_csv(self, path: str | Path) -> Path:
        """Write :meth:`csv_text` to a file."""
        return write_beside(path, self.csv_text().encode())

    @classmethod
    def from_csv(
        cls, path: str | Path, *, rate: float | None = None, channels: str | None = None
    ) -> Self:
        """Read a CSV; see :func:`noslip.load_demonstrations` for what is understood."""
        return cls.of_samples(read_text_table(path, Asked(rate=rate, channels=channels)))

    def to_npz(self, path: str | Path) -> Path:
        """Write the poses, velocities and channels as NumPy's ``.npz``."""
        arrays = {
            "times": self.times,
            "positions": self.positions,
            "quaternions": self.quaternions,
            "linear_velocities": self.linear_velocities,
            "angular_velocities": self.angular_velocities,
        }
        if self.channels is not None:
            arrays |= {
                CHANNELS.get(name, ""): array for name, array in self.channels.arrays().items()
            }
            arrays.pop("", None)
        return write_beside(path, npz_bytes(arrays))

    @classmethod
    def from_npz(cls, path: str | Path) -> Self:
        """Read an ``.npz`` with times, positions and quaternions (qw, qx, qy, qz)."""
        return cls.of_samples(read_npz(path))

    @classmethod
    def of_samples(cls, samples: Samples) -> Self:
        """Return what a file holds, checked.

        Raises
        ------
        InputError
            If it holds no poses, or for what :func:`noslip.load_demonstrations` refuses.
        """
        if samples.names:
            raise InputError(
                f"{samples.name}: holds {listed(samples.names, str)}, no poses; read it with "
                "load_trajectory"
            )
        fields = samples.checked()
        if (beside := fields.pop("channels", None)) is not None:
            fields["channels"] = Series(fields["times"], **beside, name=samples.name)
        return cls(**fields, name=samples.name)


def continuous_quaternions(rotations: Rotation) -> Floats:
    """Quaternions ``(qw, qx, qy, qz)``, shape (N, 4), each within a quarter sphere of the last."""
    return without_flips(rotations.as_quat(scalar_first=True))
