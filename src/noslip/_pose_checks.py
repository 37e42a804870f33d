"""What poses from a file must be, whatever its format, and how it is said where they are not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from noslip._arguments import MOST_SAMPLES
from noslip._instants import EXACT, seconds
from noslip._typing import Floats
from noslip.errors import RecordingError

MINIMUM_SAMPLES = 8
"""Fewest samples of a recording: a cubic spline rests on four, so of fewer than twice as many most
would be its ends."""
MAX_NORM_ERROR = 1e-3
"""How far a quaternion's norm may be off 1: what rounding to three decimals can do, four times
5e-4 in a square sum; what is scaled or in another order is off by more."""
MAX_GAP = 10.0
"""Longest time without a sample, in median periods: a few lost samples a spline bridges, across
more it invents motion."""
SAME_POSE = 1e-9
"""Poses that agree to this (m, and in each number of a unit quaternion) count as equal: no tracker
resolves it, and files that are rounded to ten digits keep it."""


def require_few(where: str | Path, samples: int) -> None:
    """Refuse more samples than are read; of compressed files, before they are decompressed."""
    if samples > MOST_SAMPLES:
        raise RecordingError(
            f"{where}: {samples:,} samples, at most {MOST_SAMPLES:,} are read; split or resample it"
        )


@dataclass(frozen=True)
class Source:
    """What a file calls its parts, so that the same checks can point into any file.

    Attributes
    ----------
    path : path
        The file, or a part of it.
    times, quaternions : str
        What holds these.
    lines : sequence of int, optional
        Of the samples; without it samples are counted from 0.
    """

    path: str | Path
    times: str
    quaternions: str
    lines: Sequence[int] | NDArray[np.intp] | None = None
    numbers: NDArray[np.intp] | None = None
    """Of the samples, where some were left out."""
    advice: str = "fill in or remove the sample"
    """Where one has no pose."""

    def picked(self, kept: NDArray[np.intp]) -> Source:
        """Return what to call some of the samples."""
        lines = None if self.lines is None else np.asarray(self.lines)[kept]
        numbers = kept if self.numbers is None else self.numbers[kept]
        return replace(self, lines=lines, numbers=numbers)

    def sample(self, index: int) -> str:
        """Return what to call a sample."""
        if self.lines is not None:
            return f"line {self.lines[index]}"
        return f"sample {index if self.numbers is None else self.numbers[index]}"

    def error(self, index: int, part: str, problem: str) -> RecordingError:
        """Return what to raise about a sample."""
        return RecordingError(f"{self.path}: {self.sample(index)}, {part}: {problem}")

    def check_finite(self, parts: Mapping[str, Floats]) -> None:
        """Refuse NaN and infinity, pointing at the first sample that holds one."""
        found: list[tuple[int, str]] = []
        for part, values in parts.items():
            if not np.isfinite(values).all():
                found.append((int(np.argwhere(~np.isfinite(values))[0][0]), part))
        if found:
            index, part = min(found, key=itemgetter(0))
            raise self.error(
                index,
                part,
                f"found {parts[part][index]}, not a finite number; {self.advice}",
            )

    def rotations(self, quaternions: Floats) -> Rotation:
        """Return the rotations of finite unit quaternions, scalar first, shape (N, 4)."""
        with np.errstate(over="ignore"):
            w, x, y, z = quaternions.T
            norms = np.sqrt(x * x + y * y + z * z + w * w)
        bad = np.flatnonzero(~(np.abs(norms - 1) <= MAX_NORM_ERROR))
        if len(bad):
            index = int(bad[0])
            norm = norms[index]
            found = f"has norm {norm:.6g}" if norm else "is zero, which is no rotation"
            advice = "correct or remove the sample" if norm else self.advice
            raise self.error(
                index,
                self.quaternions,
                f"the quaternion {found}; norms must be 1 to within {MAX_NORM_ERROR:g}, {advice}",
            )
        # As from_quat adds and divides, to the bit, in a tenth of its time.
        unit = np.column_stack([x, y, z, w]) / norms[:, None]
        return Rotation(unit, normalize=False, copy=False)

    def fields(
        self,
        times: Floats,
        positions: Floats,
        quaternions: Floats,
        beside: Mapping[str, Floats] | None = None,
    ) -> dict[str, Any]:
        """Return what a trajectory is made of, without samples that repeat the one before.

        Parameters
        ----------
        times : array, shape (N,)
            Seconds.
        positions : array, shape (N, n)
        quaternions : array, shape (N, 4) or (N, 0)
            Scalar first; none where nothing turns.
        beside : mapping, optional
            Further arrays, shape (N, k): velocities, which are not compared, and ``channels``.

        Returns
        -------
        dict
            ``times``, ``positions``, ``rotations`` (None where nothing turns), and what is beside.

        Raises
        ------
        InputError
            Of what :func:`noslip.load_demonstrations` refuses, at the first sample of its kind.
        """
        require_few(self.path, len(times))
        named = {self.times: times, "position": positions, self.quaternions: quaternions}
        self.check_finite({name: values for name, values in named.items() if values.size})
        self.check_finite(beside or {})
        rotations = self.rotations(quaternions) if quaternions.size else None
        numbers = positions
        if beside and "channels" in beside:
            numbers = np.hstack([positions, beside["channels"]])
        with np.errstate(over="ignore"):
            kept = self.distinct(times, numbers, rotations)
        if len(kept) < MINIMUM_SAMPLES:
            raise RecordingError(
                f"{self.path}: {len(kept)} distinct samples, at least {MINIMUM_SAMPLES} are "
                "needed; record more"
            )
        self.check_gaps(times, kept)
        arrays: dict[str, Any] = {"times": times, "positions": positions, **(beside or {})}
        if len(kept) < len(times):
            arrays = {name: values[kept] for name, values in arrays.items()}
            rotations = None if rotations is None else rotations[kept]
        return {**arrays, "rotations": rotations}

    def distinct(
        self, times: Floats, numbers: Floats, rotations: Rotation | None
    ) -> NDArray[np.intp]:
        """Return the samples to keep: all but equal ones repeated at the same time."""
        periods = np.diff(times)
        # Samples are compared where time stands still alone: of a million that is nowhere.
        still = np.flatnonzero(periods <= 0)
        turns = np.zeros(len(still))
        if rotations is not None:
            begins, ends = (rotations[still + k].as_quat() for k in (0, 1))
            turns = np.minimum(
                np.abs(ends - begins).max(axis=1, initial=0),
                np.abs(ends + begins).max(axis=1, initial=0),
            )
        moves = np.abs(numbers[still + 1] - numbers[still]).max(axis=1, initial=0)
        wrong = np.flatnonzero((periods[still] < 0) | (moves > SAME_POSE) | (turns > SAME_POSE))
        if len(wrong):
            move, before = moves[wrong[0]], int(still[wrong[0]])
            index = before + 1
            one, other = (seconds(times[k], times[0], EXACT) for k in (before, index))
            if periods[before] < 0:
                problem = (
                    f"time runs backwards, from {one} ({self.sample(before)}) to {other}; "
                    "unsorted='sort' or 'split' (--unsorted) goes on"
                )
            else:
                if rotations is None:
                    pose = f"with other values ({move:.2g} away)"
                else:
                    turned = (rotations[index] * rotations[before].inv()).magnitude()
                    pose = f"at another pose ({move:.2g} m and {turned:.2g} rad away)"
                problem = (
                    f"{other} is also the time of {self.sample(before)}, {pose}; "
                    "duplicates='first' or 'last' (--duplicates) keeps one"
                )
            raise self.error(index, self.times, problem)
        return np.flatnonzero(np.concatenate([[True], periods > 0])[: len(times)])

    def check_gaps(self, times: Floats, kept: NDArray[np.intp]) -> None:
        """Refuse a hole in the recording, which a spline would fill with invented motion."""
        stamps = times[kept]
        with np.errstate(over="ignore"):
            periods = np.diff(stamps)
        usual = float(np.median(periods))
        # The margin keeps a gap of exactly ten periods, whatever its rounding.
        gaps = np.flatnonzero(periods > MAX_GAP * usual * (1 + 1e-9))
        if len(gaps):
            before = int(gaps[0])
            raise self.error(
                int(kept[before + 1]),
                self.times,
                f"no sample from {stamps[before]} s ({self.sample(int(kept[before]))}) to "
                f"{stamps[before + 1]} s, over {MAX_GAP:g} times the median period of {usual:.3g} "
                "s; gaps='split' or 'interpolate' (--gaps) goes on",
            )
