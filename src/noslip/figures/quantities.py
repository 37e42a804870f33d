"""What figures draw: angles, lengths and residuals in the units of their axes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip.constraints.check import (
    MILLIMETERS_BELOW,
    step_accelerations,
    step_residuals,
    with_unit,
)
from noslip.constraints.declaration import Constraint
from noslip.constraints.system import ConstraintSystem, as_system
from noslip.errors import InputError
from noslip.figures.style import capitalized, number, short_name
from noslip.runtime.motion import HELD, Motion
from noslip.trajectory import PoseTrajectory

Motions = PoseTrajectory | Mapping[str, PoseTrajectory]
"""One motion, or several by name."""
Constraints = ConstraintSystem | Constraint | Sequence[Constraint]
Part = Literal["linear", "angular"]

PARTS: tuple[Part, ...] = ("linear", "angular")
FORCE_UNITS: dict[Part, str] = {"linear": "m/s²", "angular": "rad/s²"}
ANGLES = ("roll", "pitch", "yaw")
GIMBAL_LOCK = 1e-7
"""Cosine of the pitch below which roll and yaw cannot be told apart."""
VISIBLE = 0.1
"""Share of the top speed (of the path's extent, for a position) that a residual's axis spans at
least to either side: what cannot be seen on it is small against the motion itself."""
NEGLIGIBLE = 1e-4
"""Share of that span below which a residual looks like zero; a logarithmic axis then shows it."""

MARGIN_SHARE = 0.1
"""Share of that span which the axis of a margin shows at least: what is left counts by itself."""


def named(motions: Motions) -> dict[str, PoseTrajectory]:
    """Return motions by name, checked."""
    if isinstance(motions, PoseTrajectory):
        return {motions.name: motions}
    found = dict(motions)
    if not found:
        raise InputError("a figure needs at least one motion")
    for name, motion in found.items():
        if not isinstance(motion, PoseTrajectory):
            raise InputError(
                f"motions are PoseTrajectory objects, but {name!r} is a {type(motion).__name__}"
            )
    return found


def roll_pitch_yaw(rotations: Rotation, near: ArrayLike | None = None) -> Floats:
    """Extrinsic xyz Euler angles without jumps, shape (N, 3), degrees.

    ``R = Rz(yaw) Ry(pitch) Rx(roll)``.  Of all angles of a rotation, each sample takes those
    nearest to the sample before, so a motion through a pitch of 90 degrees goes on beyond.  At
    that pitch itself, where only roll minus yaw is defined, the roll keeps its last value.

    Parameters
    ----------
    rotations : Rotation, length N
    near : array, shape (3,), optional
        Degrees to begin nearest to; by default the pitch begins within +-90, roll and yaw within
        +-180 degrees.
    """
    R = rotations.as_matrix()
    level = np.hypot(R[:, 2, 1], R[:, 2, 2])
    roll = np.arctan2(R[:, 2, 1], R[:, 2, 2])
    defined = np.flatnonzero(level > GIMBAL_LOCK)
    if len(defined):
        last = np.searchsorted(defined, np.arange(len(roll)), side="right") - 1
        roll = roll[defined[np.maximum(last, 0)]]
    else:
        roll = np.zeros(len(roll))
    # R Rx(roll)' = Rz(yaw) Ry(pitch), whose second column is (-sin yaw, cos yaw, 0).
    lateral = np.cos(roll)[:, None] * R[:, :, 1] - np.sin(roll)[:, None] * R[:, :, 2]
    yaw = np.arctan2(-lateral[:, 0], lateral[:, 1])
    angles = np.column_stack([roll, np.arctan2(-R[:, 2, 0], level), yaw])

    # (roll + 180, 180 - pitch, yaw + 180) is the same rotation; flipping both of two samples
    # leaves their distance, so who is flipped follows from the number of flips so far.
    first = angles[:1] if near is None else np.radians(np.asarray(near, dtype=np.float64))[None]
    before = np.concatenate([first, angles[:-1]])
    flips = _distance(_flipped(angles), before) < _distance(angles, before)
    angles = np.where((np.cumsum(flips) % 2 == 1)[:, None], _flipped(angles), angles)
    continued = np.unwrap(np.concatenate([first, angles]), axis=0)[1:]
    return np.asarray(np.degrees(continued), dtype=np.float64)


def _flipped(angles: Floats) -> Floats:
    return np.column_stack([angles[:, 0] + np.pi, np.pi - angles[:, 1], angles[:, 2] + np.pi])


def _distance(a: Floats, b: Floats) -> Floats:
    turns = np.mod(a - b + np.pi, 2 * np.pi) - np.pi
    return np.asarray(np.linalg.norm(turns, axis=1))


def length_unit(motions: Iterable[PoseTrajectory]) -> tuple[float, str]:
    """Return how many of the unit make a meter, and the unit: m, or mm for short paths."""
    return scaled_unit(max(map(extent, motions)))


def length(meters: float) -> str:
    """Return a length with its unit."""
    return amount(meters, "m")


def extent(motion: PoseTrajectory) -> float:
    """Largest extent of a motion along a world axis (m)."""
    return float(np.ptp(motion.positions, axis=0).max())


def top_speed(motion: PoseTrajectory) -> float:
    """Largest speed of a step (m/s)."""
    return _longest(motion.step_velocities()[0])


def angle_unit(degrees: bool) -> tuple[float, str]:
    """Return how many of the unit make a degree, and the unit."""
    return (1.0, "°") if degrees else (float(np.radians(1.0)), "rad")


def index_of(name: str, names: Sequence[str], what: str) -> int:
    """Return where a name stands among those that are known; `what` is what errors call it."""
    if name not in names:
        raise InputError(f"{what} is one of {', '.join(names)}; got {name!r}")
    return list(names).index(name)


def scaled_unit(size: float, unit: str = "m") -> tuple[float, str]:
    """Return a factor and the unit to show values up to a size in: m and m/s may become mm."""
    if unit in ("m", "m/s") and 0 < size < MILLIMETERS_BELOW:
        return 1e3, f"m{unit}"
    return 1.0, unit


def amount(value: float, unit: str) -> str:
    """Return a value with its unit, in millimeters if it is a small length or speed."""
    scale, shown = scaled_unit(abs(value), unit)
    return with_unit(number(scale * value), shown)


def label(name: str, unit: str) -> str:
    """Return an axis' label: a quantity and its unit."""
    return f"{short_name(name)} ({unit})"


def least_span(unit: str, motions: Iterable[PoseTrajectory]) -> float:
    """Return what an axis of residuals in a unit shows at least, to either side.

    A share of the largest length, speed or acceleration of the motions; of 1 for other units.
    """
    motions = list(motions)
    scales: dict[str, Callable[[PoseTrajectory], float]] = {
        "m": extent,
        "m/s": top_speed,
        "rad/s": lambda motion: _longest(motion.step_velocities()[1]),
        "m/s²": lambda motion: _longest(step_accelerations(motion)[0]),
        "rad/s²": lambda motion: _longest(step_accelerations(motion)[1]),
    }
    if unit not in scales:
        return VISIBLE
    return VISIBLE * max(map(scales[unit], motions)) or 1.0


def _longest(vectors: Floats) -> float:
    return float(np.linalg.norm(vectors, axis=1).max())


def coupled(motions: Mapping[str, PoseTrajectory]) -> dict[str, Motion]:
    """Return the rollouts among motions in which constraints or limits took part."""
    return {
        name: motion
        for name, motion in motions.items()
        if isinstance(motion, Motion) and (motion.constraint_names or motion.limit_names)
    }


def force_sizes(forces: Floats, part: Part) -> Floats:
    """Sizes of the linear or angular accelerations of shape (N, 6)."""
    columns = slice(0, 3) if part == "linear" else slice(3, 6)
    return np.asarray(np.linalg.norm(forces[:, columns], axis=1))


def force_parts(forces: Iterable[Floats]) -> list[Part]:
    """Which forces there are to show: the linear ones, and the angular ones unless all are zero."""
    forces = list(forces)
    parts: list[Part] = ["linear"] if forces else []
    if any(force_sizes(force, "angular").any() for force in forces):
        parts.append("angular")
    return parts


@dataclass(frozen=True, eq=False)
class ResidualRow:
    """One row of the constraints over several motions, in the unit of its axis.

    Attributes
    ----------
    name : str
        "lateral velocity" for a blade; otherwise what the constraint is called.
    source : str
        What the constraint is called that the row belongs to.
    own_unit : str
        Of the constraint.
    unit : str
        Of the values.
    scale : float
        How many of the latter make one of the former.
    is_slip : bool
        Whether it is the lateral velocity of the tool.
    is_limit : bool
        Whether the values are the margin of a limit, which must not be negative.
    times : dict of arrays, shape (N - 1,)
        Seconds from the start of the motion of that name to the end of each step.
    values : dict of arrays, shape (N - 1,)
        Signed residual, or margin, of each step; :func:`noslip.check` reports the same.
    span : float
        What the axis shows at least, to either side.
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

    @property
    def label(self) -> str:
        """For an axis."""
        return label(f"margin of {self.name}" if self.is_limit else self.name, self.unit)

    @property
    def size_label(self) -> str:
        """For an axis of :meth:`sizes`."""
        return label(f"violation of {self.name}" if self.is_limit else f"|{self.name}|", self.unit)

    def sizes(self, name: str) -> Floats:
        """How large the violations of a motion are, shape (N - 1,)."""
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
        """What goes before :meth:`amount`."""
        if all(self.hides(name) for name in self.peaks):
            return "slips" if self.is_slip else f"keeps “{short_name(self.name)}” to"
        return "slips" if self.is_slip else f"violates “{short_name(self.name)}” by"

    def amount(self, name: str) -> str:
        """Say how large a motion's residual gets, as in "up to 3.48 m/s"."""
        order = "at most" if self.hides(name) else "up to"
        return f"{order} {with_unit(number(self.peaks[name]), self.unit)}"

    def told(self, name: str, what: str | None = None) -> str:
        """Say what a motion does to this limit, as in "keeps 3.2 mm from “box”"."""
        what = what or f"“{short_name(self.name)}”"
        margin = self.margins[name] / self.scale
        if not self.keeps(name):
            return f"violates {what} by up to {amount(-margin, self.own_unit)}"
        if margin <= HELD:
            reached = self.times[name][np.argmax(self.values[name] <= HELD * self.scale)]
            return f"reaches {what} at {number(reached)} s and keeps it"
        return f"keeps {amount(margin, self.own_unit)} from {what}"


def violations(values: Floats, is_limit: bool) -> Floats:
    """Sizes of residuals, or how far margins are below zero."""
    return np.asarray(np.maximum(-values, 0.0) if is_limit else np.abs(values))


def residual_rows(
    motions: Mapping[str, PoseTrajectory], constraints: Constraints
) -> list[ResidualRow]:
    """Residuals and margins of the steps of all motions, one entry a row of the constraints."""
    system = as_system(constraints)
    times = {name: motion.times[1:] - motion.times[0] for name, motion in motions.items()}
    residuals = {name: step_residuals(motion, system) for name, motion in motions.items()}
    tools = [c for c in system.constraints if c.edge is not None and c.edge.lateral is not None]
    sources = np.repeat(np.arange(len(system.constraints)), system.rows)

    found = []
    for row, (row_name, own_unit) in enumerate(
        zip(system.row_names, system.row_units, strict=True)
    ):
        source = system.constraints[sources[row]]
        is_slip = len(tools) == 1 and source is tools[0] and system.rows[sources[row]] == 1
        span = least_span(own_unit, motions.values())
        peak = max(float(np.abs(values[:, row]).max()) for values in residuals.values())
        scale, unit = scaled_unit(max(peak, span), own_unit)
        found.append(
            ResidualRow(
                name="lateral velocity" if is_slip else row_name,
                source=system.names[sources[row]],
                own_unit=own_unit,
                unit=unit,
                scale=scale,
                is_slip=is_slip,
                is_limit=source.relation == "nonnegative",
                times=times,
                values={name: scale * values[:, row] for name, values in residuals.items()},
                span=scale * span,
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


def finding(rows: Sequence[ResidualRow]) -> str:
    """Say what the last and the first motion do to the constraint that is violated most.

    Of more than four motions, which are a set rather than a comparison, it names the worst.  If
    that is an equality, it goes on with the limit that is violated most, or else used up most.
    """
    worst = max(rows, key=prominence)
    text = _finding(worst)
    limits = [row for row in rows if row.is_limit]
    if worst.is_limit or not limits:
        return text
    return f"{text}.  {_finding(max(limits, key=prominence))}"


def prominence(row: ResidualRow) -> tuple[float, float]:
    """Key by which rows are sorted: how much they are violated, then how little margin is left."""
    severity = 0.0 if row.is_limit and all(map(row.keeps, row.values)) else row.severity
    return severity, row.tightness


def _finding(row: ResidualRow) -> str:
    first, *others = row.values
    if len(others) > 3:
        peak = max(row.values, key=lambda name: (row.peaks[name], -row.margins[name]))
        told = row.told(peak) if row.is_limit else f"{row.verb} {row.amount(peak)}"
        return f"{len(others) + 1} motions: the worst, {short_name(peak)}, {told}"
    last = others[-1] if others else first
    who = capitalized(short_name(last))
    if row.is_limit:
        text = f"{who} {row.told(last)}"
        return f"{text}, {short_name(first)} {row.told(first, 'it')}" if others else text
    text = f"{who} {row.verb} {row.amount(last)}"
    return f"{text}, {short_name(first)} {row.amount(first)}" if others else text
