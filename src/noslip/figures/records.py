"""What one constraint or limit did during a rollout: values, multipliers and forces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np

from noslip._typing import Floats
from noslip._values import with_unit
from noslip.constraints.check import ROUNDING, residual_text
from noslip.constraints.declaration import ROW
from noslip.constraints.system import as_system
from noslip.errors import InputError
from noslip.figures.quantities import NEGLIGIBLE, Constraints, least_span, scaled_unit, value_text
from noslip.figures.residuals import violations
from noslip.figures.style import PALETTE, line_styles, number
from noslip.runtime.motion import HELD, Motion


@dataclass(frozen=True, eq=False)
class ConstraintRecord:
    """A constraint or limit during a rollout; of several units, its rows of one.

    Attributes
    ----------
    name, is_limit, unit : str, bool, str or None
        The unit of its residuals or margins is None if it is not known.
    row_names : tuple of str
        What tells its rows apart, such as "sideways".
    values, multipliers : array, shape (N, rows)
        Residuals or margins in that unit.
    forces : array, shape (N, 6)
        What its rows together added to the acceleration (m/s^2, rad/s^2).
    span : float
        What an axis of its residuals shows at least, to either side.
    """

    name: str
    is_limit: bool
    unit: str | None
    row_names: tuple[str, ...]
    values: Floats
    multipliers: Floats
    forces: Floats
    span: float

    @property
    def acts(self) -> bool:
        """Whether it added any acceleration."""
        return bool(self.forces.any())

    @property
    def rows(self) -> int:
        return int(self.values.shape[1])

    @property
    def styles(self) -> dict[str, dict[str, Any]]:
        """Of the rows' lines, by their labels."""
        if self.rows == 1:
            return {self.name: {"color": PALETTE["blue"], "linestyle": "-", "linewidth": 1.1}}
        return line_styles(self.row_names)

    @property
    def violation(self) -> Floats:
        """Largest of its rows, shape (N,)."""
        return np.asarray(violations(self.values, self.is_limit).max(axis=1))

    @property
    def peak(self) -> float:
        return float(self.violation.max())

    @property
    def holds(self) -> bool:
        """Whether no violation can be seen; of limits, whether there is none but rounding."""
        return self.peak <= (HELD if self.is_limit else NEGLIGIBLE * self.span)

    @property
    def margin(self) -> float:
        """Least of all rows."""
        return float(self.values.min())

    @property
    def axis(self) -> tuple[float, str]:
        """How many of an axis' units make one of its own, and that unit."""
        return scaled_unit(max(self.span, float(np.abs(self.values).max())), self.unit or "1")

    @property
    def peak_text(self) -> str:
        """The largest residual, in its axis' unit, or violation of a limit."""
        if self.is_limit:
            return value_text(self.peak, self.unit or "1")
        if self.peak < ROUNDING:
            return residual_text(self.peak, self.unit or "1", below="")
        scale, unit = self.axis
        return with_unit(number(scale * self.peak), unit)

    @property
    def margin_text(self) -> str:
        """The least margin."""
        return value_text(self.margin, self.unit or "1")

    @property
    def extreme_text(self) -> str:
        """The largest residual, or the least margin."""
        if not self.is_limit:
            return f"≤ {self.peak_text}"
        if not self.holds:
            return f"violated by {self.peak_text}"
        return "reached" if self.margin <= HELD else f"≥ {self.margin_text}"


def _sources(names: Sequence[str]) -> dict[str, str]:
    """Constraint of each row, as the names of several of its rows tell it."""
    first = [name.partition(ROW)[0] for name in names]
    return {
        name: constraint if first.count(constraint) > 1 else name
        for name, constraint in zip(names, first, strict=True)
    }


def constraint_records(motion: Motion, constraints: Constraints) -> list[ConstraintRecord]:
    system = as_system(constraints)
    known: dict[str, str] = dict(zip(system.row_names, system.row_units, strict=True))
    names = (*motion.constraint_names, *motion.limit_names)
    source = dict(zip(system.row_names, system.per_row(system.names), strict=True))
    if not known:
        source = _sources(names)
    if missing := [name for name in names if known and name not in known]:
        raise InputError(
            f"{missing[0]!r} took part in {motion.name}, but is not among the constraints given: "
            + ", ".join(known)
        )
    values = np.hstack([motion.constraint_residuals, motion.margins])
    multipliers = np.hstack([motion.multipliers, motion.limit_multipliers])
    found = []
    for (name, unit), group in groupby(
        range(len(names)), lambda row: (source.get(names[row], names[row]), known.get(names[row]))
    ):
        rows = list(group)
        found.append(
            ConstraintRecord(
                name=str(name),
                is_limit=rows[0] >= len(motion.constraint_names),
                unit=unit,
                row_names=tuple(names[row].removeprefix(f"{name}{ROW}") for row in rows),
                values=values[:, rows],
                multipliers=multipliers[:, rows],
                forces=np.sum([motion.force_of(names[row]) for row in rows], axis=0),
                span=least_span(unit or "1", [motion]),
            )
        )
    return found
