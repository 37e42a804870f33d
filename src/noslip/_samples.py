"""Timed poses as a file holds them, and what is done about their faults before they are checked."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Slerp

from noslip._instants import interval, on_clock
from noslip._pose_checks import MAX_GAP, MINIMUM_SAMPLES, SAME_POSE, Source, require_few
from noslip._typing import Floats
from noslip.errors import InputError, RecordingError, RecordingWarning, warn

Gaps = Literal["refuse", "split", "interpolate"]
Duplicates = Literal["refuse", "first", "last"]
Unsorted = Literal["refuse", "sort", "split"]
Lost = Literal["refuse", "drop"]
Interval = tuple[float | None, float | None]

FROZEN = 3
"""Equal poses in a row that may be a tracker's that lost the tool; two happen by rounding."""


@dataclass(frozen=True, kw_only=True)
class Mending:
    """What to do about the faults of a recording; by default each is refused.

    Attributes
    ----------
    gaps : "refuse", "split" or "interpolate"
        More than 10 median periods without a sample: make a recording of each piece, or fill it
        with samples on the straight line and the shortest turn.
    duplicates : "refuse", "first" or "last"
        Two poses at one time: which to keep.
    unsorted : "refuse", "sort" or "split"
        Time that runs backwards: sort the samples by time, or make a recording of each piece.
    lost : "refuse" or "drop"
        Samples without a pose: not finite, a quaternion that is zero, or a pose that stands still
        for three samples and more and then jumps.  Leave them out.
    within : pair of float or None, optional
        Start and end (s) of what matters: what lies outside is kept as far as it is whole.
    """

    gaps: Gaps = "refuse"
    duplicates: Duplicates = "refuse"
    unsorted: Unsorted = "refuse"
    lost: Lost = "refuse"
    within: Interval | None = None

    def __post_init__(self) -> None:
        for name, kind in (
            ("gaps", Gaps),
            ("duplicates", Duplicates),
            ("unsorted", Unsorted),
            ("lost", Lost),
        ):
            if getattr(self, name) not in get_args(kind):
                raise InputError(
                    f"{name} is one of {', '.join(get_args(kind))}; got {getattr(self, name)!r}"
                )


@dataclass(frozen=True, kw_only=True)
class Named:
    """Columns of numbers beside a pose.

    Attributes
    ----------
    values : array, shape (N, k)
    names, units : tuple of str
        One a column.
    """

    values: Floats
    names: tuple[str, ...]
    units: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Samples:
    """Timed poses, or vectors, as a file holds them; anything may be wrong with them.

    Attributes
    ----------
    name : str
        Of the recording.
    source : Source
        What the file calls its parts.
    times : array, shape (N,)
        Seconds.
    positions : array, shape (N, 3)
        Meters; of vectors their values, shape (N, n).
    quaternions : array, shape (N, 4)
        Scalar first; of vectors none, shape (N, 0).
    velocities : mapping
        ``linear_velocities`` and ``angular_velocities``, shape (N, 3), if the file has them; of
        vectors ``velocities``, shape (N, n).
    names, units : tuple of str
        Of vectors, one a value; empty of poses.
    channels : Named or None
        What the file holds beside the poses, where that was asked for.
    columns : mapping
        What the file calls its columns, and what they hold: where one is not finite, it is named.
    understood : sequence of str
        What each column was taken for, a line each.
    planar : bool
        Whether the file holds a pose in the plane.
    clock_said : bool or None
        Whether the file or the user states the unit of the times; None where it is a matter of
        the format.
    """

    name: str
    source: Source
    times: Floats
    positions: Floats
    quaternions: Floats
    velocities: Mapping[str, Floats] = field(default_factory=dict)
    names: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    channels: Named | None = None
    columns: Mapping[str, Floats] = field(default_factory=dict)
    understood: Sequence[str] = ()
    planar: bool = False
    clock_said: bool | None = None

    def __len__(self) -> int:
        return len(self.times)

    def checked(self) -> dict[str, Any]:
        """Return the fields of a trajectory; of channels, if there are some, those of a series.

        Raises
        ------
        InputError
            Of what :func:`noslip.load_demonstrations` refuses, at the first sample of its kind.
        """
        source = replace(self.source, advice="lost='drop' (--lost drop) leaves such samples out")
        source.check_finite(self.columns)
        beside = dict(self.velocities)
        if self.channels is not None:
            beside["channels"] = self.channels.values
        fields = source.fields(self.times, self.positions, self.quaternions, beside)
        if self.names:
            del fields["rotations"]
            fields["values"] = fields.pop("positions")
            return fields | {"names": self.names, "units": self.units}
        if self.channels is not None:
            fields["channels"] = {
                "values": fields["channels"],
                "names": self.channels.names,
                "units": self.channels.units,
            }
        return fields

    def mended(self, mending: Mending) -> list[Samples]:
        """Return the pieces that are left when faults are treated as asked; unchecked.

        Warns
        -----
        RecordingWarning
            Of how many samples were left out, sorted or filled in, and of how many pieces.
        """
        whole = self
        if mending.lost == "drop":
            gone = whole._lost()
            whole = whole._without(gone | whole._frozen(FROZEN), "without a pose", "lost=drop")
        else:
            whole._warn_of_frozen()
        backwards = np.flatnonzero(np.diff(whole.times) < 0)
        if mending.unsorted == "sort" and len(backwards):
            whole._say(f"sorted by time, which ran backwards {len(backwards)} times (unsorted)")
            whole = whole[np.argsort(whole.times, kind="stable")]
            backwards = backwards[:0]
        if mending.duplicates != "refuse":
            again = np.diff(whole.times) == 0
            first = mending.duplicates == "first"
            again = np.append(False, again) if first else np.append(again, False)
            asked = f"duplicates={mending.duplicates}"
            whole = whole._without(again, "at the time of another", asked)
            backwards = np.flatnonzero(np.diff(whole.times) < 0)
        if mending.within is not None:
            whole = whole._around(*mending.within)
            backwards = np.flatnonzero(np.diff(whole.times) < 0)
        cuts = set(backwards.tolist()) if mending.unsorted == "split" else set()
        if mending.gaps == "split":
            cuts |= set(whole._gaps().tolist())
        elif mending.gaps == "interpolate":
            whole = whole._filled()
        return whole._pieces(sorted(cuts)) if cuts else [whole]

    def __getitem__(self, kept: NDArray[np.intp]) -> Samples:
        return replace(
            self,
            source=self.source.picked(kept),
            times=self.times[kept],
            positions=self.positions[kept],
            quaternions=self.quaternions[kept],
            velocities={name: values[kept] for name, values in self.velocities.items()},
            columns={name: values[kept] for name, values in self.columns.items()},
            channels=self._channels(lambda values: values[kept]),
        )

    def _channels(self, change: Callable[[Floats], Floats]) -> Named | None:
        beside = self.channels
        return beside and replace(beside, values=change(beside.values))

    def _say(self, what: str) -> None:
        warn(f"{self.name}: {what}", RecordingWarning)

    def _without(self, gone: NDArray[np.bool_], what: str, asked: str) -> Samples:
        count = int(np.sum(gone))
        if not count:
            return self
        self._say(f"{count} of {len(self)} samples left out, {what} ({asked})")
        return self[np.flatnonzero(~gone)]

    def _lost(self) -> NDArray[np.bool_]:
        beside = [] if self.channels is None else [self.channels.values]
        numbers = np.column_stack(
            [self.times, self.positions, self.quaternions, *self.velocities.values(), *beside]
        )
        no_pose = ~self.quaternions.any(axis=1, keepdims=True) & (not self.names)
        lost = np.column_stack([~np.isfinite(numbers), no_pose])
        return np.asarray(lost.any(axis=1))

    def _frozen(self, fewest: float) -> NDArray[np.bool_]:
        """Whether a sample repeats a pose that a tracker held while the tool moved on.

        That is a run of equal poses, so many or more, that ends in a jump of half the way at least
        that the usual steps would have led.  Where most samples repeat, the poses came at a slower
        rate, and nothing was lost.
        """
        frozen = np.zeros(len(self), dtype=bool)
        # Where one number hardly ever repeats, nothing stands still; most recordings end here.
        again = self.positions[1:, 0] == self.positions[:-1, 0]
        if again.sum() < fewest - 1:
            return frozen
        kept = np.flatnonzero(~self._lost())
        if len(kept) < MINIMUM_SAMPLES:
            return frozen
        poses = np.column_stack([self.positions, self.quaternions])[kept]
        with np.errstate(over="ignore"):
            steps = np.abs(np.diff(poses, axis=0)).max(axis=1)
        moving = steps > 0
        if not moving.any() or np.mean(~moving) > 0.5:
            return frozen
        usual = float(np.median(steps[moving]))
        edges = np.flatnonzero(np.diff(np.concatenate([[True], moving, [True]]).astype(int)))
        for begin, end in zip(edges[::2], edges[1::2], strict=True):
            count = end - begin
            if count + 1 < fewest or begin == 0 or end == len(steps):
                continue
            if steps[end] > max(0.5 * (count + 1) * usual, SAME_POSE):
                frozen[kept[begin + 1 : end + 1]] = True
        return frozen

    def _warn_of_frozen(self) -> None:
        # As long as a gap is one in disguise.
        found = np.flatnonzero(self._frozen(MAX_GAP))
        if len(found):
            self._say(
                f"the pose stands still for {MAX_GAP:g} samples and more and then jumps, the first "
                f"time at {self.source.sample(int(found[0]))}; was the tool lost? lost=drop "
                "(--lost drop) leaves such samples out"
            )

    def _gaps(self) -> NDArray[np.intp]:
        """Return the samples before a gap."""
        periods = np.diff(self.times)
        forwards = periods[periods > 0]
        if not len(forwards):
            return np.zeros(0, dtype=np.intp)
        return np.flatnonzero(periods > MAX_GAP * float(np.median(forwards)) * (1 + 1e-9))

    def _filled(self) -> Samples:
        """Return it with samples at the median period in its gaps."""
        gaps = self._gaps()
        if not len(gaps):
            return self
        periods = np.diff(self.times)
        usual = float(np.median(periods[periods > 0]))
        counts = np.ceil(periods[gaps] / usual * (1 - 1e-9)) - 1
        require_few(self.name, int(min(len(self) + counts.sum(), 1e15)))
        if self._lost().any():
            return self  # refused later, at the sample
        at, places = [np.arange(len(self), dtype=np.float64)], []
        for before, count in zip(gaps, counts.astype(int), strict=True):
            parts = before + np.arange(1, count + 1) / (count + 1)
            at.append(parts)
            places.append(interval(self.times[before], self.times[before + 1], self.times[0]))
        where = np.sort(np.concatenate(at))
        low = np.minimum(where.astype(int), len(self) - 2)
        share = (where - low)[:, None]

        def between(values: Floats) -> Floats:
            filled: Floats = values[low] + share * (values[low + 1] - values[low])
            return filled

        self._say(
            f"{len(where) - len(self)} samples filled in across {len(gaps)} gaps, the first "
            f"{places[0]} (gaps=interpolate)"
        )
        quaternions = self.quaternions[low]
        if quaternions.size:
            turns = self.source.rotations(self.quaternions)
            quaternions = Slerp(np.arange(len(self)), turns)(where).as_quat(scalar_first=True)
        return replace(
            self,
            source=self.source.picked(low),
            times=between(self.times[:, None])[:, 0],
            positions=between(self.positions),
            quaternions=quaternions,
            velocities={name: between(values) for name, values in self.velocities.items()},
            columns={},
            channels=self._channels(between),
        )

    def _around(self, start: float | None, end: float | None) -> Samples:
        """Return what is whole around a time that matters."""
        began = float(self.times[0])
        begin = -np.inf if start is None else on_clock(start, began)
        stop = np.inf if end is None else on_clock(end, began)
        inside = np.flatnonzero((self.times >= begin) & (self.times <= stop) & ~self._lost())
        if not len(inside):
            raise RecordingError(
                f"{self.name}: no samples from {interval(begin, stop, began)}; they go from "
                + interval(
                    np.nanmin(self.times, initial=np.inf),
                    np.nanmax(self.times, initial=-np.inf),
                    began,
                )
            )
        lost = self._lost()
        periods = np.diff(self.times)
        # Faults are between samples, before or after the one that is none.
        broken = lost[1:] | lost[:-1] | ~(periods > 0)
        broken[self._gaps()] = True
        faults = np.flatnonzero(broken)
        first, last = int(inside[0]), int(inside[-1])
        before, after = faults[faults < first], faults[faults >= last]
        return self[
            np.arange(
                before[-1] + 1 if len(before) else 0,
                after[0] + 1 if len(after) else len(self),
            )
        ]

    def _pieces(self, cuts: Sequence[int]) -> list[Samples]:
        pieces = np.split(np.arange(len(self)), np.asarray(cuts) + 1)
        long = [piece for piece in pieces if len(piece) >= MINIMUM_SAMPLES]
        if not long:
            raise RecordingError(
                f"{self.name}: none of its {len(pieces)} pieces has {MINIMUM_SAMPLES} samples; "
                "record more"
            )
        short = len(pieces) - len(long)
        self._say(
            f"split into {len(pieces)} pieces; {short} with fewer than {MINIMUM_SAMPLES} samples "
            "left out"
        )
        return [
            replace(self[piece], name=f"{self.name}/part_{k}")
            for k, piece in enumerate(long, start=1)
        ]
