"""Checking a recorded or rolled-out motion against constraints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from noslip import _arguments
from noslip._typing import Floats
from noslip.constraints.declaration import UNITS, Constraint, Level, Relation, row_units
from noslip.constraints.system import ConstraintSystem, as_system
from noslip.errors import InputError
from noslip.scale import require_motion
from noslip.trajectory import PoseTrajectory

TOLERANCE = 1e-3
"""By default a violation of more than 1e-3 counts, in the constraint's unit: 1 mm/s, or 1 mm."""
MILLIMETERS_BELOW = 0.2
"""Margins (m) below this are printed in millimeters."""


@dataclass(frozen=True)
class ConstraintCheck:
    """What one constraint's residual, or one limit's margin, does over a motion.

    The violation of an equality is its residual's size, of several rows their Euclidean norm.  That
    of a limit is how far its margin is below zero, of several rows the largest.

    Attributes
    ----------
    name : str
        Equal ones are numbered.
    level : "position", "velocity" or "acceleration"
    relation : "zero" or "nonnegative"
    unit : str
        Of the violation and of the margin; of a limit whose rows differ, that of the row with the
        least margin.
    peak, rms : float
        Largest, and time-weighted root mean square, violation.
    slip_distance : float or None
        Integral of the residual's size over time: the way slipped sideways (m).  Equalities of
        velocity alone, their rows in m/s.
    worst_time : float
        When the violation is largest, or the margin least (s).
    share_above_tolerance : float
        Share of the time with a violation above the tolerance, 0 to 1.
    tolerance : float
    satisfied : bool
        Whether the peak is within the tolerance.
    margin, margin_time : float or None
        Least margin of a limit, below zero where it is violated, and when (s).
    """

    name: str
    level: Level
    relation: Relation
    unit: str
    peak: float
    rms: float
    slip_distance: float | None
    worst_time: float
    share_above_tolerance: float
    tolerance: float
    satisfied: bool
    margin: float | None = None
    margin_time: float | None = None

    @property
    def verdict(self) -> str:
        """``holds`` or ``violated``."""
        return "holds" if self.satisfied else "violated"

    def __str__(self) -> str:
        verdict = f"{self.name}: {self.verdict.upper()}  "
        above = f"for {self.share_above_tolerance:.0%} of the time"
        if self.margin is None:
            peak, rms, tolerance = (
                with_unit(f"{value:{form}}", self.unit)
                for value, form in ((self.peak, ".3g"), (self.rms, ".3g"), (self.tolerance, "g"))
            )
            slip = ""
            if self.slip_distance is not None:
                slip = f", slipped {self.slip_distance * 1e3:.3g} mm"
            return (
                f"{verdict}peak {peak} at {self.worst_time:.3g} s, rms {rms}{slip}, above "
                f"{tolerance} {above}"
            )
        if self.satisfied:
            return verdict + margin_text(self)
        peak, rms, tolerance = (
            quantity_text(value, self.unit) for value in (self.peak, self.rms, self.tolerance)
        )
        return (
            f"{verdict}by {peak} at {self.worst_time:.3g} s, rms {rms}, by more than {tolerance} "
            f"{above}"
        )


@dataclass(frozen=True)
class CheckReport:
    """The checks of one motion; printing it gives a table.

    Attributes
    ----------
    motion : str
        The trajectory's name.
    duration, path_length : float
        Seconds and meters.
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
        """The check with the largest violation relative to its tolerance."""
        return max(self.constraints, key=lambda check: check.peak / check.tolerance)

    peak = property(lambda self: self.worst.peak, doc="Peak violation of the worst constraint.")
    rms = property(lambda self: self.worst.rms, doc="Rms violation of the worst constraint.")
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
        return "\n".join(lines + [f"  {check}" for check in self.constraints])


def check(
    trajectory: PoseTrajectory,
    constraints: ConstraintSystem | Constraint | Sequence[Constraint],
    *,
    tolerance: float = TOLERANCE,
) -> CheckReport:
    """Report how well a motion satisfies constraints, and by what margin it keeps limits.

    The residual is that of the discrete motion, of each step from one sample to the next: at the
    step's middle for what is declared of velocities, at its end for what is declared of the pose.
    A motion that satisfies the constraints in continuous time is found to, to second order in the
    step.  Nothing is filtered or differentiated further, so low-pass noisy recordings first.

    Parameters
    ----------
    trajectory : PoseTrajectory
        A recording or a rollout; its rate may be irregular.
    constraints : Constraint or several
    tolerance : float
        Largest violation that still counts as satisfied, in each constraint's own unit.

    Returns
    -------
    CheckReport
    """
    if not isinstance(trajectory, PoseTrajectory):
        raise InputError(
            f"check takes one PoseTrajectory, got {type(trajectory).__name__}; check several "
            "one by one"
        )
    require_motion(trajectory)
    tolerance = _arguments.positive("tolerance", tolerance)
    system = as_system(constraints)
    if not system.constraints:
        raise InputError("check needs at least one constraint")
    residuals = step_residuals(trajectory, system)
    parts = np.split(residuals, np.cumsum(system.rows)[:-1], axis=1)
    results = tuple(
        _checked(trajectory, constraint, name, part, tolerance)
        for constraint, name, part in zip(system.constraints, system.names, parts, strict=True)
    )
    return CheckReport(trajectory.name, trajectory.duration, trajectory.path_length, results)


def _checked(
    trajectory: PoseTrajectory,
    constraint: Constraint,
    name: str,
    residuals: Floats,
    tolerance: float,
) -> ConstraintCheck:
    """Check one constraint by the residuals of all steps, shape (N - 1, rows)."""
    periods = np.diff(trajectory.times)
    units = row_units(constraint)
    slip = margin = None
    if constraint.relation == "nonnegative":
        worst, row = np.unravel_index(np.argmin(residuals), residuals.shape)
        margin, unit = float(residuals[worst, row]), units[row]
        # Not less than +0: a violation has no sign.
        size = np.maximum(-residuals.min(axis=1), 0.0)
    else:
        size, unit = np.linalg.norm(residuals, axis=1), constraint.unit or UNITS[constraint.level]
        worst = np.argmax(size)
        sideways = np.array([u == UNITS["velocity"] for u in units])
        if constraint.level == "velocity" and sideways.any():
            slip = float(np.linalg.norm(residuals[:, sideways], axis=1) @ periods)
    when = float(trajectory.times[worst + 1])
    return ConstraintCheck(
        name=name,
        level=constraint.level,
        relation=constraint.relation,
        unit=unit,
        peak=float(size[worst]),
        rms=float(np.sqrt(np.average(size**2, weights=periods))),
        slip_distance=slip,
        worst_time=when,
        share_above_tolerance=float(periods[size > tolerance].sum() / periods.sum()),
        tolerance=tolerance,
        satisfied=bool(size[worst] <= tolerance),
        margin=margin,
        margin_time=None if margin is None else when,
    )


def step_residuals(
    trajectory: PoseTrajectory, constraints: ConstraintSystem | Constraint | Sequence[Constraint]
) -> Floats:
    """Residual, or margin, of each step, shape (N - 1, m), as :meth:`ConstraintSystem.of_step`.

    Time is that of :attr:`PoseTrajectory.clock`, accelerations those of
    :func:`step_accelerations`.
    """
    system = as_system(constraints)
    linear, angular = trajectory.step_velocities()
    accelerated = "acceleration" in system.row_levels
    return system.of_steps(
        trajectory.clock,
        trajectory.positions,
        trajectory.quaternions,
        linear,
        angular,
        *(step_accelerations(trajectory) if accelerated else ()),
    )


def step_accelerations(trajectory: PoseTrajectory) -> tuple[Floats, Floats]:
    """Linear and angular acceleration of each step, both of shape (N - 1, 3).

    The change of a step's velocity from the step before, over the time between their middles, as in
    a rollout.  What came before the first step is not recorded; it gets the acceleration
    of the second (none, if there is no second).
    """
    periods = np.diff(trajectory.times)
    apart = (periods[1:] + periods[:-1])[:, None] / 2
    linear, angular = (
        np.concatenate([changes[:1], changes]) if len(changes) else np.zeros((1, 3))
        for changes in (np.diff(v, axis=0) / apart for v in trajectory.step_velocities())
    )
    return linear, angular


def with_unit(number: str, unit: str) -> str:
    """Return a number with its unit, unless that is 1."""
    return number if unit == "1" else f"{number} {unit}"


def margin_text(limit: ConstraintCheck) -> str:
    """Say what a limit's least margin is, and when."""
    assert limit.margin is not None
    return f"least margin {quantity_text(limit.margin, limit.unit)} at {limit.margin_time:.3g} s"


def quantity_text(value: float, unit: str) -> str:
    """Return a value of three digits with its unit; short lengths in millimeters."""
    if unit == "m" and 0 < abs(value) < MILLIMETERS_BELOW:
        value, unit = 1e3 * value, "mm"
    return with_unit(f"{value:.3g}", unit)
