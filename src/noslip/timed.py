"""What all trajectories are: samples in time, whatever moves."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, replace
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from noslip import _arguments
from noslip._instants import interval, seconds
from noslip._typing import Floats
from noslip._values import Value, html_table, shortened, with_unit
from noslip.errors import InputError
from noslip.space import Space

UNIFORM_TOLERANCE = 1e-6
"""Largest relative spread of the sampling period that still counts as uniform."""


class Timed(Value):
    """Base of frozen dataclasses that hold samples in time: ``times``, ``name``, and what moves.

    A subclass says what its coordinates (``positions``, shape (N, n)) and rotations are, in which
    space they move, and in which unit their path is measured.
    """

    times: Floats
    name: str
    positions: Floats
    rotations: Rotation
    space: Space
    tool: Any
    unit = "m"
    """Of :attr:`path_length`."""

    def _require_times(self) -> Floats:
        """Store the times; refuse fewer than two, and those that do not increase."""
        times = self._freeze("times", self.times, ())
        if len(times) < 2:
            raise InputError(
                f"{self.name}: a trajectory needs at least 2 samples, got {len(times)}"
            )
        if not np.all(np.diff(times) > 0):
            row = int(np.argmin(np.diff(times) > 0)) + 1
            raise InputError(
                f"{self.name}: times must increase, but sample {row} is at "
                f"{seconds(times[row], times[0])}, the one before at "
                f"{seconds(times[row - 1], times[0])}"
            )
        return times

    def _freeze(self, name: str, value: ArrayLike, columns: tuple[int, ...]) -> Floats:
        """Store a read-only float copy of a field whose first axis is time."""
        array = _arguments.numbers(f"{self.name}: {name}", value)
        samples = array.shape[0] if array.ndim else 0
        expected = (samples if name == "times" else len(self.times), *columns)
        if array.shape != expected:
            raise InputError(f"{self.name}: {name} has shape {array.shape}, expected {expected}")
        if not np.all(np.isfinite(array)):
            row = int(np.argwhere(~np.isfinite(array))[0][0])
            raise InputError(f"{self.name}: {name}[{row}] is not finite")
        if name == "positions" and np.abs(array).max(initial=0.0) > _arguments.LARGEST:
            row = int(np.argmax(np.abs(array).max(axis=1)))
            raise InputError(
                f"{self.name}: positions[{row}] is {np.abs(array[row]).max():.3g} m away; "
                "positions are meters"
            )
        array.flags.writeable = False
        object.__setattr__(self, name, array)
        return array

    # ---------------------------------------------------------------- what it is

    def __len__(self) -> int:
        return len(self.times)

    def __repr__(self) -> str:
        return (
            f"{type(self).__name__}({shortened(repr(self.name), 50)}, {len(self)} samples, "
            f"{self.duration:.6g} s, path {with_unit(f'{self.path_length:.6g}', self.unit)})"
        )

    def _repr_html_(self) -> str:
        return html_table(f"{type(self).__name__} {self.name}", self._facts().items())

    def _facts(self) -> dict[str, str]:
        """What a notebook tells of it, as label and text."""
        ends = np.round(self.positions[[0, -1]], 6) + 0.0
        first, last = (" ".join(f"{x:.4g}" for x in position) for position in ends)
        return {
            "samples": f"{len(self)}",
            "duration": f"{self.duration:.4g} s",
            "path": with_unit(f"{self.path_length:.4g}", self.unit),
            "from, to": with_unit(f"{first}; {last}", self.unit),
        }

    def body(self, name: str) -> Any:
        """Return the motion of a body by the name that constraints call it by: the tool's."""
        return self.tool

    @property
    def duration(self) -> float:
        """Time from the first sample to the last (s)."""
        return float(self.times[-1] - self.times[0])

    @property
    def path_length(self) -> float:
        """Length of the polyline through the positions (m, or :attr:`unit`)."""
        return float(np.linalg.norm(np.diff(self.positions, axis=0), axis=1).sum())

    @property
    def period(self) -> float:
        """Median time between samples (s)."""
        return float(np.median(np.diff(self.times)))

    @property
    def clock(self) -> Floats:
        """Times as constraints see them (s): of a recording, from its first sample on."""
        return np.asarray(self.times - self.times[0])

    @property
    def is_uniform(self) -> bool:
        """Whether all samples are the same time apart (to a millionth)."""
        periods = np.diff(self.times)
        return bool(np.ptp(periods) <= UNIFORM_TOLERANCE * periods.mean() + 4 * self._rounding)

    @property
    def _rounding(self) -> float:
        """Distance between neighboring floats at the times; 0.2 us for stamps since 1970."""
        return float(np.spacing(np.abs(self.times).max()))

    def __getitem__(self, index: slice) -> Self:
        """Return the samples of a slice as a trajectory of its own."""
        if not isinstance(index, slice):
            raise TypeError("a trajectory is sliced, as in trajectory[10:200]")
        arrays: dict[str, Any] = {
            f.name: getattr(self, f.name)[index]
            for f in fields(self)  # type: ignore[arg-type]
            if isinstance(getattr(self, f.name), (np.ndarray, Rotation, Timed))
        }
        return replace(self, **arrays)  # type: ignore[type-var]

    def __iter__(self) -> Iterator[Any]:
        raise TypeError("iterate over trajectory.positions or trajectory.times instead")

    def _instants(self, rate: float | None, times: ArrayLike | None) -> Floats:
        """Instants to resample at, from either of the arguments of ``resampled``."""
        if (rate is None) == (times is None):
            raise InputError(f"{self.name}: resample with either a rate or times")
        if rate is not None:
            rate = _arguments.positive(f"{self.name}: rate", rate)
            intervals = (self.duration + 2 * self._rounding) * rate * (1 + 1e-12) + 1e-9
            count = _arguments.samples(f"{self.name}: rate={rate:g}", intervals)
            if count < 1:
                raise InputError(
                    f"{self.name}: {rate:g} samples per second leave fewer than 2 samples "
                    f"in {self.duration:g} s"
                )
            instants = self.times[0] + np.arange(count + 1) / rate
            instants = np.minimum(instants, self.times[-1])
        else:
            instants = _arguments.numbers(f"{self.name}: times", times)
            margin = 1e-9 * max(self.duration, abs(self.times[0]), abs(self.times[-1]))
            if instants.ndim != 1 or len(instants) < 2 or not np.all(np.isfinite(instants)):
                raise InputError(f"{self.name}: resample at 2 or more finite times")
            if instants.min() < self.times[0] - margin or instants.max() > self.times[-1] + margin:
                began = self.times[0]
                raise InputError(
                    f"{self.name}: recorded from {interval(began, self.times[-1], began)}, cannot "
                    f"be resampled from {interval(instants.min(), instants.max(), began)}"
                )
        return np.asarray(instants)


def step_estimates(times: Floats, steps: Floats) -> Floats:
    """Second-order estimate: at a sample, the two adjoining steps weighted as np.gradient does."""
    periods = np.diff(times)[:, None]
    if len(steps) == 1:
        return np.repeat(steps, 2, axis=0)
    before, after = periods[:-1], periods[1:]
    inner = (after * steps[:-1] + before * steps[1:]) / (before + after)
    first = steps[0] + (steps[0] - steps[1]) * periods[0] / (periods[0] + periods[1])
    last = steps[-1] + (steps[-1] - steps[-2]) * periods[-1] / (periods[-1] + periods[-2])
    return np.concatenate([first[None], inner, last[None]])
