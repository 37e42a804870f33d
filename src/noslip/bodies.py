"""Timed poses of several tools that move together: two arms, a knife and the tissue it cuts."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from noslip._supplied import Supplied
from noslip._typing import Floats
from noslip.errors import InputError
from noslip.quaternions import inverse, product
from noslip.space import IN, Space, several
from noslip.timed import Timed
from noslip.trajectory import PoseTrajectory


@dataclass(frozen=True, eq=False, init=False)
class Bodies(Timed):
    """Poses of two or more bodies at common times; ``Bodies(knife=..., tissue=...)``. Immutable.

    Of bodies that were not sampled together, poses are taken at the times of the first one, from
    when the last one starts to when the first one ends; the others are splined there.  So their
    clocks must be one.

    Parameters
    ----------
    parts : mapping of str to PoseTrajectory, optional
        By the bodies' names; the first one is the tool, which rules are about that name no body.
    name : str
        Where they came from; error messages and figures use it.
    **bodies : PoseTrajectory
        The same as keywords.

    Raises
    ------
    InputError
        If there are fewer than two, a name is not one, or they were not recorded at one time.
    """

    parts: Mapping[str, PoseTrajectory]
    name: str = "bodies"

    def __init__(
        self,
        parts: Mapping[str, PoseTrajectory] | None = None,
        *,
        name: str = "bodies",
        **bodies: PoseTrajectory,
    ) -> None:
        object.__setattr__(self, "parts", {**(parts or {}), **bodies})
        object.__setattr__(self, "name", name)
        self.__post_init__()

    def __post_init__(self) -> None:
        for name, part in self.parts.items():
            if not (isinstance(name, str) and name.isprintable() and name.strip()) or IN in name:
                raise InputError(
                    f"{self.name}: a body's name is a text that can be printed, without {IN!r}; "
                    f"got {name!r}"
                )
            if not isinstance(part, PoseTrajectory):
                raise InputError(
                    f"{self.name}: {name} must be a PoseTrajectory, got {type(part).__name__}"
                )
        if len(self.parts) < 2:
            raise InputError(f"{self.name}: give two bodies or more; one is a PoseTrajectory")
        # In another order they move in another space, and are not equal.
        object.__setattr__(self, "parts", OrderedDict(_in_step(self.name, self.parts)))

    # ---------------------------------------------------------------- what it is

    plot = Supplied("Draw the paths, in the world and of one as another sees it; give the figure.")

    @property
    def names(self) -> tuple[str, ...]:
        """Of the bodies, in order."""
        return tuple(self.parts)

    @property
    def times(self) -> Floats:  # type: ignore[override]
        """Seconds, shape (N,)."""
        return self.tool.times

    @property
    def tool(self) -> PoseTrajectory:
        """The first body."""
        return next(iter(self.parts.values()))

    @cached_property
    def space(self) -> Space:  # type: ignore[override]
        """What they move in: R^3b x SO(3)^b."""
        return several(self.names)

    @cached_property
    def positions(self) -> Floats:  # type: ignore[override]
        """Of all bodies side by side, shape (N, 3 b)."""
        return _beside(part.positions for part in self.parts.values())

    @cached_property
    def quaternions(self) -> Floats:
        """The same of their rotations (w first), shape (N, 4 b), without sign flips."""
        return _beside(part.quaternions for part in self.parts.values())

    @cached_property
    def linear_velocities(self) -> Floats:
        """At the samples (m/s, world frame), shape (N, 3 b)."""
        return _beside(part.linear_velocities for part in self.parts.values())

    @cached_property
    def angular_velocities(self) -> Floats:
        """At the samples (rad/s, world frame), shape (N, 3 b)."""
        return _beside(part.angular_velocities for part in self.parts.values())

    @property
    def points(self) -> Floats:
        """Positions and quaternions, shape (N, 7 b)."""
        return np.hstack([self.positions, self.quaternions])

    @property
    def rotations(self) -> Rotation:
        """Of each sample those of all bodies: N b of them."""
        return Rotation.from_quat(self.quaternions.reshape(-1, 4), scalar_first=True)

    def step_velocities(self) -> tuple[Floats, Floats]:
        """Linear and angular velocity of every step, each of shape (N - 1, 3 b)."""
        return self._steps

    @cached_property
    def _steps(self) -> tuple[Floats, Floats]:
        linear, angular = zip(*(p.step_velocities() for p in self.parts.values()), strict=True)
        return _beside(linear), _beside(angular)

    # ---------------------------------------------------------------- parts of it

    def __getitem__(self, index: Any) -> Any:
        """Return a body by its name, ``bodies["knife"]``, or the samples of a slice.

        ``bodies["knife in tissue"]`` is the knife as the tissue sees it that moves.
        """
        if not isinstance(index, str):
            parts = {name: part[index] for name, part in self.parts.items()}
            arrays = {
                f.name: getattr(self, f.name)[index]
                for f in fields(self)
                if isinstance(getattr(self, f.name), np.ndarray)
            }
            return replace(self, parts=parts, **arrays)
        return self.body(index)

    def body(self, name: str) -> PoseTrajectory:
        """Return the motion of a body, or of one in another's frame; "" is the first one."""
        if name in self.parts:
            return self.parts[name]
        place = self.space.body(name)
        if place < len(self.parts):
            return self.tool
        seen: Any = self.space.seen[place]
        return relative(self.parts[seen.body.name], self.parts[seen.work.name], seen.name)

    # ---------------------------------------------------------------- new ones from it

    def with_points(self, points: Floats, times: Floats | None = None) -> Bodies:
        """Return other poses of the same bodies, shape (N, 7 b)."""
        moved, count = {}, 3 * len(self.parts)
        for k, (name, part) in enumerate(self.parts.items()):
            position = points[:, 3 * k : 3 * k + 3]
            turn = points[:, count + 4 * k : count + 4 * k + 4]
            moved[name] = part.with_points(np.hstack([position, turn]), times)
        return Bodies(moved, name=self.name)

    def with_velocities(self, linear: Floats, angular: Floats) -> Bodies:
        """Return the poses with other velocities (m/s, rad/s), each of shape (N, 3 b)."""
        parts = {
            name: part.with_velocities(linear[:, 3 * k : 3 * k + 3], angular[:, 3 * k : 3 * k + 3])
            for k, (name, part) in enumerate(self.parts.items())
        }
        return Bodies(parts, name=self.name)

    def resampled(self, *, rate: float | None = None, times: ArrayLike | None = None) -> Bodies:
        """Return the bodies at other instants, as :meth:`PoseTrajectory.resampled` does each."""
        parts = {name: p.resampled(rate=rate, times=times) for name, p in self.parts.items()}
        return Bodies(parts, name=self.name)


def relative(body: PoseTrajectory, work: PoseTrajectory, name: str) -> PoseTrajectory:
    """Return a body's motion in the frame of another that moves; of equal times."""
    back = inverse(work.quaternions)
    turned = Rotation.from_quat(product(back, body.quaternions), scalar_first=True)
    place = work.rotations.inv().apply(body.positions - work.positions)
    return PoseTrajectory(body.times, place, turned, name=name, channels=body.channels)


def _beside(parts: Any) -> Floats:
    array = np.hstack(list(parts))
    array.flags.writeable = False
    return array


def _in_step(name: str, parts: Mapping[str, PoseTrajectory]) -> dict[str, PoseTrajectory]:
    """Bodies at common times."""
    first = next(iter(parts.values()))
    if all(np.array_equal(part.times, first.times) for part in parts.values()):
        return dict(parts)
    begin, end = (
        bound(part.times[k] for part in parts.values()) for k, bound in ((0, max), (-1, min))
    )
    times = first.times[(first.times >= begin) & (first.times <= end)]
    if len(times) < 2:
        spans = ", ".join(f"{key} {p.times[0]:g} to {p.times[-1]:g} s" for key, p in parts.items())
        raise InputError(f"{name}: bodies must be recorded at one time, got {spans}")
    return {
        key: part if np.array_equal(part.times, times) else part.resampled(times=times)
        for key, part in parts.items()
    }
