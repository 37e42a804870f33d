"""Residuals and margins of motions, row by row, and what they say in a sentence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np

from noslip._typing import Floats
from noslip._values import with_unit
from noslip.constraints.check import (
    ROUNDING,
    checked,
    residual_text,
    sample_residuals,
)
from noslip.constraints.declaration import ROW, SIDEWAYS, UNITS
from noslip.constraints.system import as_system
from noslip.figures.quantities import NEGLIGIBLE, Constraints, least_span, scaled_unit, value_text
from noslip.figures.style import capitalized, number, short_name
from noslip.runtime.motion import HELD, Motion
from noslip.trajectory import PoseTrajectory

AT_GOAL = 1e-6
"""Distance from its goal (m) below which a motion is there: no tool can tell a micrometer."""


@dataclass(frozen=True, eq=False)
class ResidualRow:
    """One row of the constraints over several motions, in the unit of its axis.

    Attributes
    ----------
    name, source : str
        "lateral velocity" for a blade, otherwise what the row is called; and its constraint.
    own_unit, unit, scale : str, str, float
        Of the constraint; of the values; and how many of the latter make one of the former.
    is_slip, is_limit : bool
        Whether it is the lateral velocity of the tool; whether the values are the margin of a
        limit, which must not be negative.
    times, values : dict of arrays, shape (N - 1,), at position level (N,)
        By motion: seconds from its start to the end of each step; signed residual, or margin, of
        each step, as :func:`noslip.check` reports it.
    span : float
        What the axis shows at least, to either side.
    slipped : dict of float
        By motion, of a tool's constraint: the way slipped (m), of all its rows together, as
        :func:`noslip.check` tells it.
    """

    name: str
    source: str
    own_unit: str
    unit: str
    scale: float
    is_slip: bool
    is_limit: bool
    times: dict[str, Floats]
    values: dict[str, Floats]
    span: float
    slipped: dict[str, float]

    @property
    def label(self) -> str:
        """For an axis."""
        what = f"margin of {self.name}" if self.is_limit else self.name
        return f"{short_name(what)} ({self.unit})"

    @property
    def size_label(self) -> str:
        """For an axis of :meth:`sizes`."""
        what = f"violation of {self.name}" if self.is_limit else f"|{self.name}|"
        return f"{short_name(what)} ({self.unit})"

    def sizes(self, name: str) -> Floats:
        """How large the violations of a motion are, as :attr:`values`."""
        return violations(self.values[name], self.is_limit)

    @property
    def peaks(self) -> dict[str, float]:
        """Largest violation, by motion."""
        return {name: float(self.sizes(name).max()) for name in self.values}

    @property
    def margins(self) -> dict[str, float]:
        """Least value, by motion: of a limit, how much of it is left."""
        return {name: float(values.min()) for name, values in self.values.items()}

    @property
    def severity(self) -> float:
        """Largest violation of all as a share of what the axis shows at least."""
        return max(self.peaks.values()) / self.span

    @property
    def tightness(self) -> float:
        """Of limits: the less margin is left, the larger."""
        return -min(self.margins.values()) / self.span if self.is_limit else np.inf

    def keeps(self, name: str) -> bool:
        """Whether a motion keeps this limit, up to rounding."""
        return self.margins[name] >= -HELD * self.scale

    def hides(self, name: str) -> bool:
        """Whether a motion's residual looks like zero on a linear axis; margins need not."""
        return not self.is_limit and self.peaks[name] < NEGLIGIBLE * self.span

    @property
    def hidden(self) -> list[str]:
        """Motions whose residual is not zero and looks like it on a linear axis."""
        return [name for name, peak in self.peaks.items() if self.hides(name) and peak > 0]

    @property
    def verb(self) -> str:
        """What goes before :meth:`peak_text`, unless it slips."""
        name = short_name(self.name)
        return f"keeps “{name}” to" if all(map(self.hides, self.peaks)) else f"violates “{name}” by"

    def peak_text(self, name: str) -> str:
        """Say how large a motion's residual gets, as in "up to 3.48 m/s"."""
        if self.peaks[name] < ROUNDING * self.scale:
            return residual_text(0.0, self.own_unit, "less than")
        order = "at most" if self.hides(name) else "up to"
        return f"{order} {with_unit(number(self.peaks[name]), self.unit)}"

    def slip_text(self, name: str) -> str:
        """Say how far a motion slips, as in "slips 24 mm (up to 3.48 m/s)"."""
        if self.peaks[name] < ROUNDING * self.scale:
            return "does not slip"
        peak = with_unit(number(self.peaks[name]), self.unit)
        return f"slips {value_text(self.slipped[name], 'm')} (up to {peak})"

    def says(self, name: str) -> str:
        """Say what a motion does to this row, as in "slips 24 mm (up to 3.48 m/s)"."""
        if self.is_limit:
            return self.margin_text(name)
        return self.slip_text(name) if self.is_slip else f"{self.verb} {self.peak_text(name)}"

    @property
    def is_zero(self) -> bool:
        """Whether it is zero throughout, in all motions, but for rounding."""
        return not self.is_limit and max(self.peaks.values()) < ROUNDING * self.scale

    def margin_text(self, name: str, what: str | None = None) -> str:
        """Say what a motion does to this limit, as in "keeps 3.2 mm from “box”"."""
        what = what or f"“{short_name(self.name)}”"
        margin = self.margins[name] / self.scale
        if not self.keeps(name):
            return f"violates {what} by up to {value_text(-margin, self.own_unit)}"
        if margin <= HELD:
            reached = self.times[name][np.argmax(self.values[name] <= HELD * self.scale)]
            return f"reaches {what} at {number(reached)} s and keeps it"
        return f"keeps {value_text(margin, self.own_unit)} from {what}"


def violations(values: Floats, is_limit: bool) -> Floats:
    """Sizes of residuals, or how far margins are below zero."""
    return np.asarray(np.maximum(-values, 0.0) if is_limit else np.abs(values))


def residual_rows(
    motions: Mapping[str, PoseTrajectory], constraints: Constraints
) -> list[ResidualRow]:
    """Residuals and margins of the steps of all motions, one entry a row of the constraints."""
    system = as_system(constraints)
    residuals = {name: sample_residuals(motion, system) for name, motion in motions.items()}
    if not system.size:
        return []
    checks = {name: checked(motion, system).constraints for name, motion in motions.items()}
    tools = [c for c in system.constraints if c.edge is not None and c.edge.lateral is not None]
    sources = np.repeat(np.arange(len(system.constraints)), system.rows)

    found = []
    for row, (row_name, own_unit) in enumerate(
        zip(system.row_names, system.row_units, strict=True)
    ):
        source = system.constraints[sources[row]]
        # No step leads to the first sample; only a pose can be asked of it.
        first = 0 if source.level == "position" else 1
        is_slip = (
            source.relation == "zero"
            and source.edge is not None
            and own_unit == UNITS["velocity"]
            and (system.rows[sources[row]] == 1 or f"{ROW}{SIDEWAYS}" in row_name)
        )
        slips = {name: found[sources[row]].slip_distance for name, found in checks.items()}
        span = least_span(own_unit, motions.values())
        peak = max(float(np.abs(values[:, row]).max()) for values in residuals.values())
        scale, unit = scaled_unit(max(peak, span), own_unit)
        found.append(
            ResidualRow(
                name="lateral velocity" if is_slip and len(tools) == 1 else row_name,
                source=system.names[sources[row]],
                own_unit=own_unit,
                unit=unit,
                scale=scale,
                is_slip=is_slip,
                is_limit=source.relation == "nonnegative",
                times={name: (m.times - m.times[0])[first:] for name, m in motions.items()},
                values={name: scale * values[first:, row] for name, values in residuals.items()},
                span=scale * span,
                slipped={name: slip or 0.0 for name, slip in slips.items()},
            )
        )
    return found


def least_margins(rows: Sequence[ResidualRow]) -> list[ResidualRow]:
    """Return the rows, those of one limit and one unit as a single one: the least of its margins.

    What it takes to keep six sides of a box is one number; six panels would hide it.
    """
    merged = []
    for (source, is_limit, _), group in groupby(rows, lambda r: (r.source, r.is_limit, r.own_unit)):
        together = list(group)
        if not is_limit or len(together) == 1:
            merged += together
            continue
        scale = min(row.scale for row in together)
        (first, *_) = [row for row in together if row.scale == scale]
        values = {
            name: np.min([scale / row.scale * row.values[name] for row in together], axis=0)
            for name in first.values
        }
        merged.append(replace(first, name=source, values=values))
    return merged


def finding(rows: Sequence[ResidualRow], motions: Mapping[str, PoseTrajectory]) -> str:
    """Say what the first and the last motion do to the constraint that is violated most.

    Of more than four motions, which are a set rather than a comparison, it names the worst.  If
    that is an equality, it goes on with the limit that is violated most, or else used up most.
    Of a rollout it says how far from its goal it ends.
    """
    worst = max(rows, key=prominence)
    text = _finding(worst, motions)
    limits = [row for row in rows if row.is_limit]
    if not worst.is_limit and limits:
        text += f".  {_finding(max(limits, key=prominence), {})}"
    return text


def prominence(row: ResidualRow) -> tuple[float, float]:
    """Key by which rows are sorted: how much they are violated, then how little margin is left."""
    severity = 0.0 if row.is_limit and all(map(row.keeps, row.values)) else row.severity
    return severity, row.tightness


def _finding(row: ResidualRow, motions: Mapping[str, PoseTrajectory]) -> str:
    first, *others = row.values
    last = others[-1] if others else first
    if len(others) > 3:
        peak = max(row.values, key=lambda name: (row.peaks[name], -row.margins[name]))
        text = f"{len(others) + 1} motions: the worst, {short_name(peak)}, {row.says(peak)}"
        rest = max((row.peaks[name] for name in row.values if name != peak), default=0.0)
        if row.is_slip and row.peaks[last] < ROUNDING * row.scale < rest:
            text += f"; {short_name(last)} does not slip{_end_text(motions.get(last))}"
        return text
    end = _end_text(motions.get(last))
    if not others:
        return f"{capitalized(short_name(last))} {row.says(last)}{end}"
    if row.is_limit:
        told = f"{row.margin_text(last)}, {short_name(first)} {row.margin_text(first, 'it')}"
        return f"{capitalized(short_name(last))} {told}"
    text = row.says(first)
    if row.is_slip:
        return f"{capitalized(short_name(first))} {text}; {short_name(last)} {row.says(last)}{end}"
    text = f"{row.verb} {row.peak_text(last)}, {short_name(first)} {row.peak_text(first)}"
    return f"{capitalized(short_name(last))} {text}"


def _end_text(motion: PoseTrajectory | None) -> str:
    """Say how far from its goal a rollout ends; nothing of a motion that has none."""
    if not isinstance(motion, Motion):
        return ""
    if motion.end_error < AT_GOAL:
        return f", ends within {1e6 * AT_GOAL:g} µm of its goal"
    return f", ends {value_text(motion.end_error, 'm')} from its goal"
