"""Checking a recorded or rolled-out motion against constraints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal

import numpy as np

from noslip import _arguments
from noslip._instants import seconds
from noslip._supplied import Supplied
from noslip._typing import Floats
from noslip._values import html_table, with_unit
from noslip.constraints.declaration import UNITS, Constraint, Level, Relation, row_units
from noslip.constraints.edge_motion import edge_steps
from noslip.constraints.remedy import BetterPoint, better_point
from noslip.constraints.system import ConstraintSystem, as_system
from noslip.errors import InputError, one_line
from noslip.scale import require_motion
from noslip.timed import Timed
from noslip.trajectory import PoseTrajectory

Verdict = Literal["holds", "violated", "undecided"]

TOLERANCE = 1e-3
"""By default a violation of more than 1e-3 counts, in the constraint's unit: 1 mm/s, or 1 mm."""
SLIP_SHARE = 0.01
"""Of its way, what a tool may slip by default: hands that follow a contour with a blade slip 5 to
9 % (the eight recorded runs), a motion that holds the constraint nothing but rounding."""
ROUNDING = 1e-9
"""Residuals below this are told as none, in whatever unit: rounding leaves 1e-12 of a motion some
meters from the origin in steps of 1 ms, and no tool can tell a nanometer."""
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
    slip_distance, slip_share : float or None
        Integral of the residual's size over time, the way slipped sideways (m); and its share of
        the way of the tool's edge over its work (of the tool's origin, where no edge is named),
        None at rest.  Equalities of velocity alone, their rows in m/s.
    worst_time : float
        When the violation is largest, or the margin least (s).
    share_above_tolerance : float
        Share of the time with a violation above the tolerance, 0 to 1.
    tolerance, largest_slip_share : float
        What it was judged by.
    verdict : "holds", "violated" or "undecided"
        Violated if the peak is above the tolerance, or the share slipped above the largest one.
        Undecided if neither is, but the whole motion is slower than the tolerance: to slip fast, at
        some moment, it had no speed.
    margin, margin_time : float or None
        Least margin of a limit, below zero where it is violated, and when (s).
    better_point : BetterPoint or None
        Of a tool's constraint that is violated: another of its points (m, body frame), about which
        the same axes slip clearly less, and the way slipped there (m).
    first_time : float
        Of the motion (s).
    """

    name: str
    level: Level
    relation: Relation
    unit: str
    peak: float
    rms: float
    slip_distance: float | None
    slip_share: float | None
    worst_time: float
    share_above_tolerance: float
    tolerance: float
    largest_slip_share: float
    verdict: Verdict
    margin: float | None = None
    margin_time: float | None = None
    better_point: BetterPoint | None = None
    first_time: float = 0.0

    @property
    def satisfied(self) -> bool:
        """Whether it holds; False if that is undecided."""
        return self.verdict == "holds"

    @property
    def finding(self) -> str:
        """What was found, in a sentence without subject."""
        above = f"for {self.share_above_tolerance:.0%} of the time"
        peak, rms, tolerance = (
            residual_text(value, self.unit) for value in (self.peak, self.rms, self.tolerance)
        )
        when = f"at {seconds(self.worst_time, self.first_time, 3)}"
        if self.margin is not None:
            if self.satisfied:
                return margin_text(self)
            return f"by {peak} {when}, rms {rms}, by more than {tolerance} {above}"
        if self.peak < ROUNDING:
            return f"{'no residual' if self.slip_distance is None else 'no slip'} ({peak})"
        slip = "" if self.slip_distance is None else f", slipped {1e3 * self.slip_distance:.3g} mm"
        if self.slip_share is not None:
            more = self.slip_share > self.largest_slip_share
            than = f", more than {100 * self.largest_slip_share:.3g} %" if more else ""
            slip += f" ({100 * self.slip_share:.2g} % of its way{than})"
        found = f"peak {peak} {when}, rms {rms}{slip}, above {tolerance} {above}"
        if self.verdict == "undecided":
            found += (
                "; the whole motion is slower than that tolerance, which says nothing of it: give "
                "a smaller one"
            )
        if self.better_point is not None and self.slip_distance is not None:
            place = ", ".join(f"{value:g}" for value in self.better_point.point)
            found += (
                f"; with reference_point=({place}) it slips "
                f"{1e3 * self.better_point.slip_distance:.3g} mm instead of "
                f"{1e3 * self.slip_distance:.3g}"
            )
        return found

    def __str__(self) -> str:
        return f"{self.name}: {self.verdict.upper()}  {self.finding}"

    __repr__ = __str__


@dataclass(frozen=True)
class CheckReport:
    """The checks of one motion; it prints as a table, and a notebook shows it as one.

    Attributes
    ----------
    motion : str
        The trajectory's name.
    duration, path_length : float
        Seconds and meters.
    constraints : tuple of ConstraintCheck
        One for each constraint, in the order given.
    trajectory : PoseTrajectory
    system : ConstraintSystem
        What was checked.
    """

    motion: str
    duration: float
    path_length: float
    constraints: tuple[ConstraintCheck, ...]
    trajectory: PoseTrajectory = field(compare=False)
    system: ConstraintSystem = field(compare=False)

    @property
    def satisfied(self) -> bool:
        """Whether every constraint holds."""
        return all(check.satisfied for check in self.constraints)

    @property
    def verdict(self) -> str:
        """``holds``, or which constraints are violated, or of which it is undecided."""
        found = [
            f"{verdict}: {', '.join(names)}"
            for verdict in ("violated", "undecided")
            if (names := [check.name for check in self.constraints if check.verdict == verdict])
        ]
        return "; ".join(found) or "holds"

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
                asdict(check) | {"satisfied": check.satisfied} for check in self.constraints
            ],
        }

    def __str__(self) -> str:
        return "\n".join([self._heading, *(f"  {check}" for check in self.constraints)])

    __repr__ = __str__

    @property
    def _heading(self) -> str:
        # A file's name may hold any byte.
        motion = one_line(self.motion)
        path = f"{self.path_length * 1e3:.4g} mm"
        if self.trajectory.unit != "m":
            path = with_unit(f"{self.path_length:.4g}", self.trajectory.unit)
        return f"{motion}: {self.duration:.3g} s, path {path}"

    def _repr_html_(self) -> str:
        rows = [(check.name, check.verdict, check.finding) for check in self.constraints]
        return html_table(self._heading, rows)

    plot = Supplied("Draw residuals and margins over time; return the figure.")


def check(
    trajectory: PoseTrajectory,
    constraints: ConstraintSystem | Constraint | Sequence[Constraint],
    *,
    tolerance: float = TOLERANCE,
    slip_share: float = SLIP_SHARE,
) -> CheckReport:
    """Report how well a motion satisfies constraints, and by what margin it keeps limits.

    The residual is that of the discrete motion: at the middle of each step for what is declared of
    velocities, at each sample for what is declared of the pose.
    A motion that satisfies the constraints in continuous time is found to, to second order in the
    step.  Nothing is filtered or differentiated further, so low-pass noisy recordings first.

    Parameters
    ----------
    trajectory : PoseTrajectory
        A recording or a rollout; its rate may be irregular.
    constraints : Constraint or several
    tolerance : float
        Largest violation that still counts as satisfied, in each constraint's own unit.
    slip_share : float
        Largest share of its way, 0 to 1, by which a tool may slip and still count as not slipping:
        however slowly.  1 leaves the verdict to the tolerance.

    Returns
    -------
    CheckReport
        Where a tool's constraint is violated, with the point about which it slips clearly less, if
        there is one.

    Raises
    ------
    ConstraintError
        If a constraint is undefined somewhere on the motion; the message says where, and by what.
    """
    if not isinstance(trajectory, Timed):
        raise InputError(
            f"check takes one PoseTrajectory or Trajectory, got {type(trajectory).__name__}; read "
            "a file with load_demonstrations, check several one by one"
        )
    require_motion(trajectory)
    tolerance = _arguments.positive("tolerance", tolerance)
    slip_share = _arguments.not_negative("slip_share", slip_share)
    system = as_system(constraints, trajectory.space)
    if not system.constraints:
        raise InputError("check needs at least one constraint")
    report = checked(trajectory, system, tolerance=tolerance, slip_share=slip_share)
    found = (
        replace(each, better_point=better_point(trajectory.body(constraint.body), constraint))
        if each.verdict == "violated" and not constraint.coordinates
        else each
        for each, constraint in zip(report.constraints, system.constraints, strict=True)
    )
    return replace(report, constraints=tuple(found))


def checked(
    trajectory: PoseTrajectory,
    constraints: ConstraintSystem | Constraint | Sequence[Constraint],
    *,
    tolerance: float = TOLERANCE,
    slip_share: float = SLIP_SHARE,
) -> CheckReport:
    """Do what :func:`check` does, of any motion: also one that no recording could be."""
    system = as_system(constraints, trajectory.space)
    residuals = sample_residuals(trajectory, system)
    parts = np.split(residuals, np.cumsum(system.rows), axis=1)[:-1]
    results = tuple(
        _checked(trajectory, constraint, name, part, tolerance, slip_share)
        for constraint, name, part in zip(system.constraints, system.names, parts, strict=True)
    )
    return CheckReport(
        trajectory.name, trajectory.duration, trajectory.path_length, results, trajectory, system
    )


def _checked(
    trajectory: PoseTrajectory,
    constraint: Constraint,
    name: str,
    residuals: Floats,
    tolerance: float,
    largest_slip_share: float,
) -> ConstraintCheck:
    """Check one constraint by the residuals of all samples, shape (N, rows)."""
    # A step counts where it ends; the first sample of what is asked of poses, as long as no time.
    periods = np.diff(trajectory.times, prepend=trajectory.times[0])
    first = 0 if constraint.level == "position" else 1
    residuals, periods, times = residuals[first:], periods[first:], trajectory.times[first:]
    units = row_units(constraint)
    slip = share = margin = None
    fastest = np.inf
    if constraint.relation == "nonnegative":
        worst, row = np.unravel_index(np.argmin(residuals), residuals.shape)
        margin, unit = float(residuals[worst, row]), units[row]
        # Not less than +0: a violation has no sign.
        size = np.maximum(-residuals.min(axis=1), 0.0)
    else:
        size, unit = np.linalg.norm(residuals, axis=1), ", ".join(dict.fromkeys(units))
        worst = np.argmax(size)
        sideways = np.array([u == UNITS["velocity"] for u in units])
        if constraint.level == "velocity" and sideways.any():
            slip = float(np.linalg.norm(residuals[:, sideways], axis=1) @ periods)
            speeds = _speeds(trajectory, constraint)
            fastest, way = float(speeds.max()), float(speeds @ periods)
            share = slip / way if way > 0 else None
    peak, when = float(size[worst]), float(times[worst])
    verdict: Verdict = "holds"
    if peak > tolerance or (peak > ROUNDING and share is not None and share > largest_slip_share):
        verdict = "violated"
    elif fastest <= tolerance and peak > max(ROUNDING, largest_slip_share * fastest):
        verdict = "undecided"
    return ConstraintCheck(
        name=name,
        level=constraint.level,
        relation=constraint.relation,
        unit=unit,
        peak=peak,
        rms=float(np.sqrt(np.average(size**2, weights=periods))),
        slip_distance=slip,
        slip_share=share,
        worst_time=when,
        share_above_tolerance=float(periods[size > tolerance].sum() / periods.sum()),
        tolerance=tolerance,
        largest_slip_share=largest_slip_share,
        verdict=verdict,
        margin=margin,
        margin_time=None if margin is None else when,
        first_time=float(trajectory.times[0]),
    )


def _speeds(trajectory: PoseTrajectory, constraint: Constraint) -> Floats:
    """Speed in each step of the edge over its work, or else of the tool's origin (m/s)."""
    if constraint.coordinates:
        velocities = trajectory.step_velocities()[0]
    elif constraint.edge is None:
        velocities = trajectory.body(constraint.body).step_velocities()[0]
    else:
        velocities = edge_steps(trajectory.body(constraint.body), constraint).velocities
    return np.asarray(np.linalg.norm(velocities, axis=1))


def sample_residuals(
    trajectory: PoseTrajectory, constraints: ConstraintSystem | Constraint | Sequence[Constraint]
) -> Floats:
    """Residual, or margin, at each sample, shape (N, m).

    Of the step that ends there, as :func:`step_residuals`; at the first sample its own of what is
    declared of poses, and that of the first step of all else.
    """
    system = as_system(constraints, trajectory.space)
    steps = step_residuals(trajectory, system)
    found = np.concatenate([steps[:1], steps])
    poses = np.array(system.row_levels, dtype=object) == "position"
    if poses.any():
        still = np.zeros(system.space.linear), np.zeros(system.space.angular)
        at = trajectory.clock[:1], trajectory.positions[:1], trajectory.quaternions[:1]
        found[0, poses] = system.of_poses.residuals(*at, *still)[0]
    return found


def step_residuals(
    trajectory: PoseTrajectory, constraints: ConstraintSystem | Constraint | Sequence[Constraint]
) -> Floats:
    """Residual, or margin, of each step, shape (N - 1, m), as :meth:`ConstraintSystem.of_step`.

    Time is that of :attr:`PoseTrajectory.clock`, accelerations those of
    :func:`step_accelerations`.
    """
    system = as_system(constraints, trajectory.space)
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
        np.concatenate([changes[:1], changes]) if len(changes) else np.zeros((1, changes.shape[1]))
        for changes in (np.diff(v, axis=0) / apart for v in trajectory.step_velocities())
    )
    return linear, angular


def margin_text(limit: ConstraintCheck) -> str:
    """Say what a limit's least margin is, and when."""
    assert limit.margin is not None and limit.margin_time is not None
    when = seconds(limit.margin_time, limit.first_time, 3)
    if abs(limit.margin) < ROUNDING:
        return f"reached at {when}"
    return f"least margin {quantity_text(limit.margin, limit.unit)} at {when}"


def residual_text(size: float, unit: str, below: str = "below", order: str = "") -> str:
    """Say how large a residual gets; all that rounding leaves reads alike, as "below 1e-9 m/s".

    `order` goes before any other value, as in "at most".
    """
    if 0 <= size < ROUNDING:
        return f"{below} {with_unit(f'{ROUNDING:.0e}'.replace('e-0', 'e-'), unit)}".lstrip()
    return f"{order} {quantity_text(size, unit)}".lstrip()


def quantity_text(value: float, unit: str) -> str:
    """Return a value of three digits with its unit; short lengths in millimeters."""
    if unit == "m" and 0 < abs(value) < MILLIMETERS_BELOW:
        value, unit = 1e3 * value, "mm"
    return with_unit(f"{value:.3g}", unit)
