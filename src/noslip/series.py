"""Timed numbers with names and units: what vectors are, and the channels beside a pose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import scipy
from numpy.typing import ArrayLike

from noslip import _arguments
from noslip._files import write_beside
from noslip._pose_columns import Asked
from noslip._pose_names import clock_name, names_time
from noslip._pose_npz import npz_bytes, read_npz
from noslip._pose_text import read_text_table
from noslip._samples import Samples
from noslip._supplied import Supplied
from noslip._typing import Floats
from noslip.errors import InputError, did_you_mean
from noslip.named_columns import numbers_text
from noslip.timed import Timed, step_estimates

_AXES = ("x", "y", "z")
_SEPARATORS = frozenset(",;\t\"'#")
"""Of text that a name cannot hold: it would be read back as another."""


@dataclass(frozen=True, eq=False)
class Series(Timed):
    """Timed numbers, with names, units and rates of change. Immutable.

    Parameters
    ----------
    times : array, shape (N,)
        Seconds, strictly increasing; may start anywhere.
    values : array, shape (N, n)
        In units of their own.
    names : sequence of str, optional
        One a column; "x0", "x1", ... by default.
    velocities : array, shape (N, n), optional
        Units per second.  Left out, they are estimated by differences of second order.
    units : sequence of str, optional
        One a column; by default "m" of what is called x, y, z, else "1".
    name : str
        Where it came from; error messages and figures use it.

    Raises
    ------
    InputError
        If shapes disagree, a number is not finite, the times do not increase, or a name cannot
        head a column of a table.
    """

    times: Floats
    values: Floats
    names: tuple[str, ...] = None  # type: ignore[assignment]
    velocities: Floats = None  # type: ignore[assignment]
    units: tuple[str, ...] = None  # type: ignore[assignment]
    name: str = "trajectory"

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
        ) -> None: ...

    def __post_init__(self) -> None:
        times = self._require_times()
        shape = np.shape(self.values)
        if len(shape) != 2 or not shape[1]:
            raise InputError(
                f"{self.name}: values has shape {shape}, expected ({len(times)}, n): a row a sample"
                + "; of several recordings make a list of trajectories" * (len(shape) == 3)
            )
        self._freeze("values", self.values, (shape[1],))
        given = self.velocities
        rates = step_estimates(times, self._steps) if given is None else given
        self._freeze("velocities", rates, (shape[1],))
        self._name("names", tuple(f"x{k}" for k in range(shape[1])))
        self._name("units", self._usual_units())

    def _usual_units(self) -> Sequence[str]:
        return ("m" if self.names == _AXES else "1",) * len(self.names)

    def _name(self, what: str, usual: Sequence[str]) -> None:
        """Store texts, one a column."""
        given = getattr(self, what)
        texts = tuple(usual) if given is None else tuple(given)
        count = self.values.shape[1]
        if isinstance(given, str) or len(texts) != count or not all(map(_is_text, texts)):
            raise InputError(
                f"{self.name}: {what} must be {count} texts of one line, without commas, "
                f"semicolons, quotes or #, got {_arguments.short(given)}"
            )
        lower = [text.lower() for text in texts]
        if what == "names" and (len(set(lower)) < count or any(map(names_time, lower))):
            raise InputError(
                f"{self.name}: names must differ, and none be that of the time, "
                f"got {', '.join(texts)}"
            )
        object.__setattr__(self, what, texts)

    # ---------------------------------------------------------------- what it is

    plot = Supplied("Draw the values over time; return the figure.")

    @property
    def unit(self) -> str:  # type: ignore[override]
        """Of :attr:`path_length`: that of all columns, or "1" if they differ."""
        return self.units[0] if len(set(self.units)) == 1 else "1"

    @property
    def positions(self) -> Floats:  # type: ignore[override]
        """The values, as what is the same for all trajectories calls them."""
        return self.values

    def __repr__(self) -> str:
        count = len(self.names)
        size = f"{count} {'values' if count > 1 else 'value'}"
        return super().__repr__().replace(f"{len(self)} samples", f"{len(self)} samples of {size}")

    def _facts(self) -> dict[str, str]:
        named = zip(self.names, self.units, strict=True)
        return super()._facts() | {
            "values": ", ".join(f"{name} ({unit})" for name, unit in named),
        }

    def column(self, name: str) -> Floats:
        """Return the values under one name, shape (N,)."""
        if name not in self.names:
            near = did_you_mean(name, self.names)
            raise InputError(
                f"{self.name}: no value {name!r}{near}; there are {', '.join(self.names)}"
            )
        return np.asarray(self.values[:, self.names.index(name)])

    @cached_property
    def _steps(self) -> Floats:
        steps = np.diff(self.values, axis=0) / np.diff(self.times)[:, None]
        steps.flags.writeable = False
        return steps

    # ---------------------------------------------------------------- new ones from it

    def with_points(self, points: Floats, times: Floats | None = None) -> Self:
        """Return other values under the same names."""
        own = self.times if times is None else times
        rates: Any = None  # estimated anew
        return replace(self, times=own, values=points, velocities=rates)

    def retimed(self, times: Floats) -> Self:
        """Return the same values at other times, shape (N,)."""
        return self.with_points(self.values, times)

    def resampled(self, *, rate: float | None = None, times: ArrayLike | None = None) -> Self:
        """Return it at other instants, by cubic splines; as :meth:`PoseTrajectory.resampled`."""
        instants = self._instants(rate, times)
        inside = np.clip(instants, self.times[0], self.times[-1])
        values, rates = self._spline(inside), self._spline(inside, 1)
        return replace(self, times=instants, values=values, velocities=rates)

    def between(self, times: Floats, onto: Floats | None = None) -> Self:
        """Return it at other instants along straight lines, so that jumps do not ring.

        Parameters
        ----------
        times : array, shape (M,)
            Seconds; beyond the ends, what is there.
        onto : array, shape (M,), optional
            When the result has these values (s), if not then.
        """
        columns = [np.interp(times, self.times, column) for column in self.values.T]
        return self.with_points(np.column_stack(columns), times if onto is None else onto)

    @cached_property
    def _spline(self) -> Any:
        return scipy.interpolate.CubicSpline(self.times, self.values)

    # ---------------------------------------------------------------- files

    def csv_columns(self) -> list[str]:
        """Return what heads each column in a table: its name, and its unit if it has one."""
        return [
            name if unit == "1" else f"{name} [{unit}]"
            for name, unit in zip(self.names, self.units, strict=True)
        ]

    def csv_text(self) -> str:
        """Return time and values as the text of a CSV; a float read back is the float written."""
        table = np.column_stack([self.times, self.values])
        return numbers_text((clock_name(self.times), *self.csv_columns()), table)

    def to_csv(self, path: str | Path) -> Path:
        """Write :meth:`csv_text` to a file."""
        return write_beside(path, self.csv_text().encode())

    @classmethod
    def from_csv(
        cls, path: str | Path, *, columns: str | None = None, rate: float | None = None
    ) -> Self:
        """Read the columns of a CSV as they are; by default all that hold numbers, but the time.

        See :func:`noslip.load_demonstrations` for what is understood.
        """
        return cls.of_samples(read_text_table(path, Asked(columns=columns, rate=rate, values=True)))

    def to_npz(self, path: str | Path) -> Path:
        """Write times, values, velocities, names and units as NumPy's ``.npz``."""
        return write_beside(path, npz_bytes(self.arrays()))

    def arrays(self) -> dict[str, Any]:
        """Return what :meth:`to_npz` writes, by name."""
        names, units = (np.array(texts, dtype=np.str_) for texts in (self.names, self.units))
        return {
            "times": self.times,
            "values": self.values,
            "velocities": self.velocities,
            "names": names,
            "units": units,
        }

    @classmethod
    def from_npz(cls, path: str | Path) -> Self:
        """Read an ``.npz`` with times, values and, if there, velocities, names and units."""
        return cls.of_samples(read_npz(path, values=True))

    @classmethod
    def of_samples(cls, samples: Samples) -> Self:
        """Return what a file holds, checked.

        Raises
        ------
        InputError
            If it holds poses, or for what :func:`noslip.load_demonstrations` refuses.
        """
        if not samples.names:
            raise InputError(
                f"{samples.name}: holds poses; name the columns to read as they are, or read it "
                "with load_demonstrations"
            )
        return cls(**samples.checked(), name=samples.name)


def _is_text(value: Any) -> bool:
    return (
        isinstance(value, str)
        and bool(value.strip())
        and value.isprintable()
        and not _SEPARATORS & set(value)
    )
