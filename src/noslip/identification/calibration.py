"""Where a sensor sits on a tool whose rule is known, and by how much its rotations come late."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
from scipy.spatial.transform import Slerp

from noslip import _arguments
from noslip._typing import Floats
from noslip._values import Value
from noslip.constraints.blade import Blade
from noslip.constraints.needle import Needle
from noslip.constraints.wheel import Wheel
from noslip.edge import Edge, unit
from noslip.errors import InputError
from noslip.identification.identify import moving, parts_of, tool_axes
from noslip.identification.rows import Trial, evidence, tried
from noslip.trajectory import PoseTrajectory

LATEST = 0.1
"""Seconds: trackers and filters that are later than that are seen by eye."""
_STEPS, _NEAR, _BETWEEN = 10, 5, 2001
"""Offsets tried either way; those beside the best, through which a cubic is laid, since the square
of the slip is not quite a parabola; and places along it, a twentieth of a millisecond apart."""
_ROUNDED = 1e-6
"""Seconds."""


Rule = Blade | Needle | Wheel


@dataclass(frozen=True, eq=False, repr=False)
class ToolFrame(Value):
    """A tool's frame in that of the sensor on it, ready for ``prepare(tool_frame=found.matrix)``.

    Attributes
    ----------
    matrix : array, shape (4, 4)
        T_sb (m): in it the rule holds as it was given.
    covariance : array, shape (6, 6)
        Of the frame's turn (rad) and then its origin (m), sensor frame, across `unknown` and the
        turns that the rule leaves free: about a blade's lateral axis, about a needle's shaft.
    unknown : array, shape (k, 3)
        Orthonormal directions, sensor frame, along which the recordings do not tell where the
        rule's point is: it is the one nearest to the sensor's origin.
    slip, holdout : float
        Root mean square speed across the rule, over that of the tool: as fitted, and of recordings,
        or blocks of time, that were left out.
    """

    matrix: Floats
    covariance: Floats
    unknown: Floats
    slip: float
    holdout: float


def tool_frame(
    trajectories: PoseTrajectory | Iterable[PoseTrajectory],
    constraint: Rule,
    *,
    noise: tuple[float, float] | None = None,
) -> ToolFrame:
    """Find where a sensor sits on a tool, from motions under a rule that is known.

    What the rule leaves free is chosen: of a blade, the edge leads along the travel; of a needle,
    the roll about the shaft is the sensor's; of a wheel on a ground, the third axis is the ground's
    normal; of a point, what is nearest to the sensor's origin.

    Parameters
    ----------
    trajectories : PoseTrajectory or several
        Of the sensor; several recordings, turned about all axes, tell most.
    constraint : Blade, Needle or Wheel
        What the tool obeys, in its own frame.
    noise : (float, float), optional
        As for :func:`noslip.identify`.

    Raises
    ------
    InputError
        As :func:`noslip.identify`, and if the constraint is another one.
    """
    recordings = _recordings("tool_frame", trajectories, constraint)
    trial, ground = _fitted(recordings, constraint, noise)
    lateral, _, travel = tool_axes(trial)
    if ground is not None:
        travel = np.cross(lateral, ground)
        backwards = np.sign(trial.evidence.net_way(travel, trial.fit.point)) or 1.0
        lateral, travel = backwards * lateral, backwards * travel
    found = np.array([travel, lateral, np.cross(travel, lateral)])
    edge = cast(Edge, constraint.edge)
    turn = found.T @ edge.frame
    matrix = np.eye(4)
    matrix[:3, :3] = turn
    matrix[:3, 3] = trial.fit.point - turn @ edge.point
    rows = trial.fit.axes
    slip, holdout = (
        float(np.sqrt(sum(of(axis) ** 2 for axis in rows))) for of in (trial.share, trial.holdout)
    )
    return ToolFrame(matrix, trial.fit.covariance, trial.fit.unknown, slip, holdout)


def time_offset(trajectories: PoseTrajectory | Iterable[PoseTrajectory], constraint: Rule) -> float:
    """Seconds by which a recording's rotations come later than its positions.

    The offset at which the rule holds best, about whichever axes and point: a tool that turns while
    it moves seems to slip if its two streams are not in step.  Within 0.1 s either way.  A hand
    that turns its tool too late looks alike.

    Parameters
    ----------
    trajectories : PoseTrajectory or several
        Of one sensor on one tool, that turns as it moves.
    constraint : Blade, Needle or Wheel
        What the tool obeys; its axes and point need not be known.
    """
    recordings = _recordings("time_offset", trajectories, constraint)
    noise = parts_of(recordings, None)[0][0].noise

    # Offsets of whole samples, at which noise is as it was measured; between, it averages out.
    period = float(np.median(np.concatenate([np.diff(each.times) for each in recordings])))
    step = period * max(1, round(LATEST / _STEPS / period))
    count = max(1, round(LATEST / step))
    offsets = step * np.arange(-count, count + 1)

    def slip(offset: float) -> float:
        moved = [_later(each, offset, count * step) for each in recordings]
        trial, _ = _fitted(moved, constraint, noise)
        return sum(trial.share(axis) ** 2 for axis in trial.fit.axes)

    slips = np.array([slip(offset) for offset in offsets])
    least = int(np.argmin(slips))
    near = slice(max(0, least - _NEAR), least + _NEAR + 1)
    cubic = np.polyfit(offsets[near], slips[near], min(3, len(slips[near]) - 1))
    between = np.linspace(offsets[near][0], offsets[near][-1], _BETWEEN)
    return float(between[np.argmin(np.polyval(cubic, between))])


def synchronized(trajectory: PoseTrajectory, offset: float) -> PoseTrajectory:
    """A recording whose rotations come later than its positions, with both in step.

    Parameters
    ----------
    trajectory : PoseTrajectory
    offset : float
        Seconds, as :func:`time_offset` finds them.  The samples whose rotations are not there,
        at one of the ends, are cut off.
    """
    offset = _arguments.finite("offset", offset)
    return _later(trajectory, offset, abs(offset), offset > 0, offset < 0)


def _later(
    trajectory: PoseTrajectory, offset: float, cut: float, end: bool = True, begin: bool = True
) -> PoseTrajectory:
    """Take rotations from later in the recording, and cut time off its ends."""
    times = trajectory.times
    first, last = times[0] + begin * cut, times[-1] - end * cut
    # Sums of times are rounded: what is cut off is whole samples.
    inside = np.flatnonzero((times > first - _ROUNDED) & (times < last + _ROUNDED))
    if len(inside) < 2:
        raise InputError(
            f"{trajectory.name}: it lasts {trajectory.duration:.3g} s, so that an offset of "
            f"{offset:g} s leaves nothing of it"
        )
    kept = trajectory[inside[0] : inside[-1] + 1]
    turns = Slerp(times, trajectory.rotations)(np.clip(kept.times + offset, times[0], times[-1]))
    return PoseTrajectory(
        kept.times, kept.positions, turns, name=trajectory.name, channels=kept.channels
    )


def _recordings(
    name: str, trajectories: PoseTrajectory | Iterable[PoseTrajectory], constraint: Rule
) -> Sequence[PoseTrajectory]:
    if not isinstance(constraint, Rule):
        raise InputError(
            f"{name}: the rule is a Blade, a Needle or a Wheel, got {constraint!r}; identify finds "
            "others"
        )
    return moving(trajectories, name)


def _fitted(
    recordings: Sequence[PoseTrajectory], constraint: Rule, noise: tuple[float, float] | None
) -> tuple[Trial, Floats | None]:
    """The rule's rows, and of a wheel the ground's normal in the body's frame."""
    told = evidence(parts_of(recordings, noise))
    if isinstance(constraint, Needle):
        return tried(told, 2), None
    ground = None
    if isinstance(constraint, Wheel) and constraint.normal is not None:
        normal = unit(constraint.normal)
        means = [each.rotations.inv().apply(normal).mean(axis=0) for each in recordings]
        ground = unit(np.mean(means, axis=0))
    return tried(told, 1, ground=ground), ground
