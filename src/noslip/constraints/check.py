"""Checking a recorded or rolled-out motion against constraints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from noslip import _arguments
from noslip.constraints.declaration import Constraint
from noslip.constraints.system import ConstraintSystem, as_system
from noslip.errors import InputError
from noslip.trajectory import PoseTrajectory

Floats = NDArray[np.float64]

TOLERANCE = 1e-3
"""By default a residual above 1 mm/s (velocity level) or 1 mm (position level) is a violation."""


@dataclass(frozen=True)
class ConstraintCheck:
    """What one constraint's residual does over a motion.

    Velocity-level residuals are in m/s (or the constraint's own unit), position-level ones in m.
    For a constraint of several rows the residual is their Euclidean norm.

    Attributes
    ----------
    name : str
    level : "velocity" or "position"
    peak, rms : float
        Largest, and time-weighted root mean square, residual.
    slip_distance : float or None
        Integral of the residual's size over time: the way slipped sideways (m).  Velocity level
        only.
    worst_time : float
        When the peak occurs (s).
    share_above_tolerance : float
        Share of the time with a residual above the tolerance, 0 to 1.
    tolerance : float
    satisfied : bool
        Whether the peak is within the tolerance.
    """

    name: str
    level: str
    peak: float
    rms: float
    slip_distance: float | None
    worst_time: float
    share_above_tolerance: float
    tolerance: float
    satisfied: bool

    @property
    def verdict(self) -> str:
        """``holds`` or ``violated``."""
        return "holds" if self.satisfied else "violated"


@dataclass(frozen=True)
class CheckReport:
    """The checks of one motion; printing it gives a table.

    Attributes
    ----------
    motion : str
        The trajectory's name.
    duration, path_length : float
        Seconds and metres.
    constraints : tuple of ConstraintCheck
        One for each constraint, in the order given.
    """

    motion: str
    duration: float
    path_length: float
    constraints: tuple[ConstraintCheck, ...]

    @property
    def satisfied(self) -> bool:
        """Whether every constraint holds."""
        return all(check.satisfied for check in self.constraints)

    @property
    def verdict(self) -> str:
        """``holds``, or which constraints are violated."""
        broken = [check.name for check in self.constraints if not check.satisfied]
        return "holds" if not broken else f"violated: {', '.join(broken)}"

    @property
    def worst(self) -> ConstraintCheck:
        """The check with the largest peak relative to its tolerance."""
        return max(self.constraints, key=lambda check: check.peak / check.tolerance)

    peak = property(lambda self: self.worst.peak, doc="Peak residual of the worst constraint.")
    rms = property(lambda self: self.worst.rms, doc="Rms residual of the worst constraint.")
    worst_time = property(lambda self: self.worst.worst_time, doc="When it peaks (s).")
    share_above_tolerance = property(
        lambda self: self.worst.share_above_tolerance, doc="Its share of time above the tolerance."
    )
    slip_distance = property(
        lambda self: self.worst.slip_distance, doc="Way slipped under the worst constraint (m)."
    )

    def __getitem__(self, name: str) -> ConstraintCheck:
        for check in self.constraints:
            if check.name == name:
                return check
        raise KeyError(f"no constraint {name!r} was checked")

    def to_dict(self) -> dict[str, Any]:
        """Plain data, for JSON."""
        return {
            "motion": self.motion,
            "duration": self.duration,
            "path_length": self.path_length,
            "satisfied": self.satisfied,
            "verdict": self.verdict,
            "constraints": [
                asdict(check) | {"verdict": check.verdict} for check in self.constraints
            ],
        }

    def __str__(self) -> str:
        lines = [f"{self.motion}: {self.duration:.3g} s, path {self.path_length * 1e3:.4g} mm"]
        for check in self.constraints:
            unit = "m/s" if check.level == "velocity" else "m"
            slip = ""
            if check.slip_distance is not None:
                slip = f", slipped {check.slip_distance * 1e3:.3g} mm"
            lines.append(
                f"  {check.name}: {check.verdict.upper()}  peak {check.peak:.3g} {unit} at "
                f"{check.worst_time:.3g} s, rms {check.rms:.3g} {unit}{slip}, above "
                f"{check.tolerance:g} {unit} for {check.share_above_tolerance:.0%} of the time"
            )
        return "\n".join(lines)


def check(
    trajectory: PoseTrajectory,
    constraints: ConstraintSystem | Constraint | Sequence[Constraint],
    *,
    tolerance: float = TOLERANCE,
) -> CheckReport:
    """Report how well a motion satisfies constraints.

    The residual is that of the discrete motion: of each step from one sample to the next, with the
    pose where the step ends.  That is what a controller which plays the samples executes; nothing
    is filtered or differentiated further, so low-pass noisy recordings first.

    Parameters
    ----------
    trajectory : PoseTrajectory
        A recording or a rollout; its rate may be irregular.
    constraints : Constraint or several
    tolerance : float
        Largest residual that still counts as satisfied (m/s, or m at position level).

    Returns
    -------
    CheckReport
    """
    if not isinstance(trajectory, PoseTrajectory):
        raise InputError(
            f"check takes one PoseTrajectory, got {type(trajectory).__name__}; check several "
            "one by one"
        )
    tolerance = _arguments.positive("tolerance", tolerance)
    system = as_system(constraints)
    if not system.constraints:
        raise InputError("check needs at least one constraint")
    residuals = step_residuals(trajectory, system)
    periods = np.diff(trajectory.times)
    results, row = [], 0
    for constraint, rows in zip(system.constraints, system.rows, strict=True):
        size = np.linalg.norm(residuals[:, row : row + rows], axis=1)
        row += rows
        worst = int(np.argmax(size))
        results.append(
            ConstraintCheck(
                name=constraint.name,
                level=constraint.level,
                peak=float(size[worst]),
                rms=float(np.sqrt(np.average(size**2, weights=periods))),
                slip_distance=float(size @ periods) if constraint.level == "velocity" else None,
                worst_time=float(trajectory.times[worst + 1]),
                share_above_tolerance=float(periods[size > tolerance].sum() / periods.sum()),
                tolerance=tolerance,
                satisfied=bool(size[worst] <= tolerance),
            )
        )
    return CheckReport(trajectory.name, trajectory.duration, trajectory.path_length, tuple(results))


def step_residuals(
    trajectory: PoseTrajectory, constraints: ConstraintSystem | Constraint | Sequence[Constraint]
) -> Floats:
    """Residual of each step at the pose where it ends, shape (N - 1, m).

    Time counts from the first sample.
    """
    linear, angular = trajectory.step_velocities()
    return as_system(constraints).residuals(
        trajectory.times[1:] - trajectory.times[0],
        trajectory.positions[1:],
        trajectory.quaternions[1:],
        linear,
        angular,
    )
