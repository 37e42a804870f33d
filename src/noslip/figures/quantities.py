"""What figures draw: angles, lengths and forces in the units of their axes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip._values import with_unit
from noslip.constraints.check import (
    MILLIMETERS_BELOW,
    ROUNDING,
    residual_text,
    step_accelerations,
)
from noslip.constraints.declaration import Constraint
from noslip.constraints.system import ConstraintSystem
from noslip.errors import InputError
from noslip.figures.style import number
from noslip.runtime.motion import Motion
from noslip.trajectory import PoseTrajectory

Motions = PoseTrajectory | Mapping[str, PoseTrajectory]
"""One motion, or several by name."""
Constraints = ConstraintSystem | Constraint | Sequence[Constraint]
"""One constraint or several."""
Part = Literal["linear", "angular"]
"""Of an acceleration or force."""

PARTS: tuple[Part, ...] = ("linear", "angular")
"""In the order of the columns."""
FORCE_UNITS: dict[Part, str] = {"linear": "m/s²", "angular": "rad/s²"}
"""Of accelerations that constraints add: forces for each unit of mass."""
ANGLES = ("roll", "pitch", "yaw")
"""Names of what :func:`roll_pitch_yaw` returns."""
GIMBAL_LOCK = 1e-7
"""Cosine of the pitch below which roll and yaw cannot be told apart: rounding of a rotation decides
there."""
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
    nearest to the sample before, so a motion through a pitch of 90 degrees goes on beyond.  At that
    pitch itself, where only roll minus yaw is defined, the roll keeps its last value.  Angles near
    which to begin may be given; by default the pitch begins within +-90, roll and yaw within +-180
    degrees.
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


def near_angles(motions: Iterable[PoseTrajectory]) -> list[Floats]:
    """Roll, pitch and yaw of motions (degrees); all begin as near as they can to the first one."""
    found: list[Floats] = []
    for motion in motions:
        found.append(roll_pitch_yaw(motion.rotations, found[0][0] if found else None))
    return found


def _flipped(angles: Floats) -> Floats:
    return np.column_stack([angles[:, 0] + np.pi, np.pi - angles[:, 1], angles[:, 2] + np.pi])


def _distance(a: Floats, b: Floats) -> Floats:
    turns = np.mod(a - b + np.pi, 2 * np.pi) - np.pi
    return np.asarray(np.linalg.norm(turns, axis=1))


def since_start(motion: PoseTrajectory) -> Floats:
    """Seconds since a motion began, shape (N,); the clock of a re-planned one began before it."""
    return np.asarray(motion.times - motion.times[0])


def length_unit(motions: Iterable[PoseTrajectory]) -> tuple[float, str]:
    """Return how many of the unit make a meter, and the unit: m, or mm for short paths."""
    return scaled_unit(max(map(extent, motions)))


def extent(motion: PoseTrajectory) -> float:
    """Largest extent of a motion along a world axis (m)."""
    return float(np.ptp(motion.positions, axis=0).max())


def widest_plane(motions: Iterable[PoseTrajectory]) -> tuple[int, int]:
    """World axes, in order, of the plane in which motions reach furthest; of equals the first."""
    reach = np.max([np.ptp(motion.positions, axis=0) for motion in motions], axis=0)
    a, b = sorted(np.argsort(-reach, kind="stable")[:2].tolist())
    return a, b


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


def value_text(value: float, unit: str) -> str:
    """Return a value with its unit, in millimeters if it is a small length or speed.

    What rounding leaves of a length or residual reads as its bound.
    """
    if abs(value) < ROUNDING:
        return residual_text(0.0, unit, "<") if value else with_unit("0", unit)
    scale, shown = scaled_unit(abs(value), unit)
    return with_unit(number(scale * value), shown)


def least_span(unit: str, motions: Iterable[PoseTrajectory]) -> float:
    """Return what an axis of residuals in a unit shows at least, to either side.

    A share of the largest length, speed or acceleration of the motions; of 1 for other units.
    """
    scales: dict[str, Callable[[PoseTrajectory], float]] = {
        "m": extent,
        "m/s": lambda motion: _longest(motion.step_velocities()[0]),
        "rad/s": lambda motion: _longest(motion.step_velocities()[1]),
        "m/s²": lambda motion: _longest(step_accelerations(motion)[0]),
        "rad/s²": lambda motion: _longest(step_accelerations(motion)[1]),
    }
    return VISIBLE * (max(map(scales[unit], motions)) if unit in scales else 1.0) or 1.0


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
    """Which forces there are to show: linear and angular ones, unless all are zero."""
    forces = list(forces)
    return [part for part in PARTS if any(force_sizes(force, part).any() for force in forces)]
