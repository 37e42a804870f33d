"""What figures draw: angles, lengths and residuals in the units of their axes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from noslip.constraints.check import step_residuals
from noslip.constraints.declaration import Constraint
from noslip.constraints.system import ConstraintSystem, as_system
from noslip.errors import InputError
from noslip.figures.style import capitalised, number, short_name
from noslip.trajectory import Floats, PoseTrajectory

Motions = PoseTrajectory | Mapping[str, PoseTrajectory]
"""One motion, or several by name."""
Constraints = ConstraintSystem | Constraint | Sequence[Constraint]

ANGLES = ("roll", "pitch", "yaw")
GIMBAL_LOCK = 1e-7
"""Cosine of the pitch below which roll and yaw cannot be told apart."""
MILLIMETRES_BELOW = 0.2
"""Extents (m) and speeds (m/s) below this are shown in millimetres."""
VISIBLE = 0.1
"""Share of the top speed (of the path's extent, for a position) that a residual's axis spans at
least to either side: what cannot be seen on it is small against the motion itself."""
NEGLIGIBLE = 1e-4
"""Share of that span below which a residual looks like zero; a logarithmic axis then shows it."""


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
    """Return how many of the unit make a metre, and the unit: m, or mm for short paths."""
    return _unit(max(map(extent, motions)))


def length(metres: float) -> str:
    """Return a length with its unit."""
    scale, unit = _unit(metres)
    return f"{number(scale * metres)} {unit}"


def extent(motion: PoseTrajectory) -> float:
    """Largest extent of a motion along a world axis (m)."""
    return float(np.ptp(motion.positions, axis=0).max())


def top_speed(motion: PoseTrajectory) -> float:
    """Largest speed of a step (m/s)."""
    return float(np.linalg.norm(motion.step_velocities()[0], axis=1).max())


def _unit(size: float) -> tuple[float, str]:
    return (1e3, "mm") if 0 < size < MILLIMETRES_BELOW else (1.0, "m")


@dataclass(frozen=True, eq=False)
class ResidualRow:
    """One row of the constraints over several motions, in the unit of its axis.

    Attributes
    ----------
    name : str
        "lateral velocity" for a blade; otherwise what the constraint is called.
    unit : str
    is_slip : bool
        Whether it is the lateral velocity of the tool.
    times : dict of arrays, shape (N - 1,)
        Seconds from the start of the motion of that name to the end of each step.
    values : dict of arrays, shape (N - 1,)
        Signed residual of each step; :func:`noslip.check` reports the same.
    span : float
        What the axis shows at least, to either side.
    """

    name: str
    unit: str
    is_slip: bool
    times: dict[str, Floats]
    values: dict[str, Floats]
    span: float

    @property
    def label(self) -> str:
        """For an axis."""
        return f"{self.name} ({self.unit})"

    @property
    def peaks(self) -> dict[str, float]:
        """Largest size of the residual, by motion."""
        return {name: float(np.abs(values).max()) for name, values in self.values.items()}

    @property
    def severity(self) -> float:
        """Largest residual of all as a share of what the axis shows at least."""
        return max(self.peaks.values()) / self.span

    def hides(self, name: str) -> bool:
        """Whether a motion's residual looks like zero on a linear axis."""
        return self.peaks[name] < NEGLIGIBLE * self.span

    @property
    def hidden(self) -> list[str]:
        """Motions whose residual is not zero and looks like it on a linear axis."""
        return [name for name, peak in self.peaks.items() if self.hides(name) and peak > 0]

    @property
    def verb(self) -> str:
        """What goes before :meth:`amount`."""
        return "slips" if self.is_slip else f"violates “{self.name}” by"

    def amount(self, name: str) -> str:
        """Say how large a motion's residual gets, as in "up to 3.48 m/s"."""
        order = "at most" if self.hides(name) else "up to"
        return f"{order} {number(self.peaks[name])} {self.unit}"


def residual_rows(
    motions: Mapping[str, PoseTrajectory], constraints: Constraints
) -> list[ResidualRow]:
    """Residuals of the steps of all motions, one entry a row of the constraints."""
    system = as_system(constraints)
    times = {name: motion.times[1:] - motion.times[0] for name, motion in motions.items()}
    residuals = {name: step_residuals(motion, system) for name, motion in motions.items()}
    speed, reach = max(map(top_speed, motions.values())), max(map(extent, motions.values()))
    tools = [constraint for constraint in system.constraints if constraint.lateral is not None]
    sources = np.repeat(np.arange(len(system.constraints)), system.rows)

    found = []
    for row, row_name in enumerate(system.row_names):
        source = system.constraints[sources[row]]
        is_slip = len(tools) == 1 and source is tools[0] and system.rows[sources[row]] == 1
        at_speed = source.level == "velocity"
        span = VISIBLE * (speed if at_speed else reach)
        peak = max(float(np.abs(values[:, row]).max()) for values in residuals.values())
        scale, unit = _unit(max(peak, span))
        found.append(
            ResidualRow(
                name="lateral velocity" if is_slip else row_name,
                unit=f"{unit}/s" if at_speed else unit,
                is_slip=is_slip,
                times=times,
                values={name: scale * values[:, row] for name, values in residuals.items()},
                span=scale * span or 1.0,
            )
        )
    return found


def finding(rows: Sequence[ResidualRow]) -> str:
    """Say what the last and the first motion do to the constraint that is violated most.

    Of more than four motions, which are a set rather than a comparison, it names the worst.
    """
    worst = max(rows, key=lambda row: row.severity)
    first, *others = worst.values
    if len(others) > 3:
        peak = max(worst.peaks, key=lambda name: worst.peaks[name])
        return (
            f"{len(others) + 1} motions: the worst, {short_name(peak)}, {worst.verb} "
            f"{worst.amount(peak)}"
        )
    last = others[-1] if others else first
    text = f"{capitalised(short_name(last))} {worst.verb} {worst.amount(last)}"
    return f"{text}, {short_name(first)} {worst.amount(first)}" if others else text
