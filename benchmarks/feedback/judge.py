"""What a run came to: of the commands as such, and of what the robot executed.

Everything is found from poses, by NumPy and SciPy alone.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from benchmarks.feedback.loop import Bools, Record
from benchmarks.feedback.poses import Floats
from benchmarks.feedback.tasks import Task
from benchmarks.perturbation import REACHED

IN_TIME = 1.5
"""Periods: what was commanded after a longer cycle is compared with nothing before it."""
SHARES = np.linspace(0, 1, 8, endpoint=False)
"""Of a cycle's way, at which the tool is looked at."""
ROUNDING = 4.0
"""Units in the last place of a coordinate, that a commanded step may be off by."""


@dataclass(frozen=True)
class Figures:
    """Measures of a run; ratios, if nothing else is said.

    Attributes
    ----------
    finished : bool
        It said that it is done, and stayed so.
    time : float
        When, over the duration; nan if it has not.  Of a goal that moves after the end, since then.
    plans : int
    slip : float
        Commanded sideways in a step's middle, beyond what rounded poses tell, over the
        demonstration's top speed; in cycles in time, but not while a hand leads the command.
    turning, speed : float
        Commanded angular and linear speed, over the demonstration's peaks.
    turning_gain, gain : float
        The same of accelerations, from one cycle to the next.
    path : float
        Largest distance of the executed tool from the demonstration's path while nothing touches
        it, over the path's length.
    skipped : float
        Largest distance of a point of the demonstration's path from where the tool went while
        nothing touched it, over the path's length.
    end : float
        Distance of the tool from the goal at last, over the path's length.
    drift : float
        How far the command moved after it was done, over the path's length.
    failure : str
    """

    finished: bool
    time: float
    plans: int
    slip: float
    turning: float
    speed: float
    turning_gain: float
    gain: float
    path: float
    skipped: float
    end: float
    drift: float
    failure: str = ""

    @property
    def arrived(self) -> bool:
        """Whether it has finished, and at its goal."""
        return self.finished and self.end <= REACHED


@dataclass(frozen=True)
class Bounds:
    """Of :class:`Figures`, at most; inf where nothing is asked.  What is not finished breaks them.

    Attributes
    ----------
    beyond_lag : float
        Path error beyond that of the primitive's plain motion on the same robot.
    """

    time: float = np.inf
    plans: float = np.inf
    slip: float = 1e-12
    turning: float = 1.55
    speed: float = 1.3
    turning_gain: float = 3.5
    gain: float = 3.5
    beyond_lag: float = np.inf
    skipped: float = np.inf
    end: float = np.inf
    drift: float = np.inf

    def broken(self, figures: Figures, plain: Figures | None = None) -> list[str]:
        """What of a run is beyond them; ``plain`` is the plain motion on the same robot."""
        if not figures.finished:
            return [f"not finished ({figures.failure})" if figures.failure else "not finished"]
        found = []
        for field in fields(self):
            bound = getattr(self, field.name)
            if not np.isfinite(bound):
                continue
            if field.name == "beyond_lag":
                value = figures.path - (0.0 if plain is None else plain.path)
            else:
                value = getattr(figures, field.name)
            if not value <= bound:
                found.append(f"{field.name} {value:.3g} > {bound:g}")
        return found


NOTHING = Figures(False, np.nan, 0, *[np.nan] * 9)  # type: ignore[arg-type]
"""Of a run that never began."""


def judged(task: Task, record: Record) -> Figures:
    """Measure a run."""
    if not len(record.times):
        return replace(NOTHING, plans=record.plans, failure=record.failure)
    undone = np.flatnonzero(~record.done)
    first = undone[-1] + 1 if len(undone) else 0
    finished = first < len(record.times) and not record.failure
    time = (record.times[first] - record.since) / task.duration if finished else np.nan
    speed, turning, gain, turning_gain, slip = _commanded(task, record)
    free = ~record.touched
    position = record.executed[:, :3]
    drift = np.linalg.norm(record.commanded[first:, :3] - record.commanded[-1, :3], axis=1)
    return Figures(
        finished=bool(finished),
        time=float(time),
        plans=record.plans,
        slip=slip,
        turning=turning,
        speed=speed,
        turning_gain=turning_gain,
        gain=gain,
        path=float(off_path(task.path, position[free]).max(initial=0.0) / task.length),
        skipped=float(_skipped(task, position, free) / task.length),
        end=float(np.linalg.norm(position[-1] - record.goal) / task.length),
        drift=float(drift.max() / task.length) if finished else np.nan,
        failure=record.failure,
    )


def _commanded(task: Task, record: Record) -> tuple[float, float, float, float, float]:
    """Linear and angular speed, their accelerations, and slip, over the demonstration's."""
    poses = np.vstack([np.concatenate(task.start), record.commanded])
    positions = poses[:, :3]
    turns = Rotation.from_quat(poses[:, 3:], scalar_first=True)
    h = record.elapsed[:, None]
    v = np.diff(positions, axis=0) / h
    step = (turns[1:] * turns[:-1].inv()).as_rotvec()
    w = step / h
    in_time = (record.elapsed < IN_TIME * record.period) & ~record.led
    peaks = task.peaks(record.period)
    rates = [np.linalg.norm(x, axis=1)[~record.led].max(initial=0.0) for x in (v, w)]
    both = in_time[1:] & in_time[:-1]
    gains = [
        np.linalg.norm((np.diff(x, axis=0) / h[1:])[both], axis=1).max(initial=0.0) for x in (v, w)
    ]
    middle = Rotation.from_rotvec(step / 2) * turns[:-1]
    sideways = [np.sum(middle.apply(axis) * v, axis=1) for axis in task.body_axes]
    sideways += [v @ axis for axis in task.world_axes]
    rounding = ROUNDING * np.spacing(np.abs(positions).max()) / record.elapsed
    slips = np.abs(sideways).max(axis=0) - rounding
    # A late or long cycle may be several steps of the generator, whose chord bends.
    whole = (record.elapsed <= record.period * (1 + 1e-9)) & ~record.led
    slip = float(slips[whole].max(initial=0.0) / peaks[0])
    found = [*rates, *gains] / peaks
    return float(found[0]), float(found[1]), float(found[2]), float(found[3]), slip


def off_path(path: Floats, points: Floats) -> Floats:
    """Distances of points from a polyline, shape (N,)."""
    if not len(points):
        return np.zeros(0)
    nearest = cKDTree(path).query(points)[1]
    found = np.full(len(points), np.inf)
    for k in (np.maximum(nearest - 1, 0), np.minimum(nearest, len(path) - 2)):
        begin, way = path[k], path[k + 1] - path[k]
        length = np.maximum(np.sum(way * way, axis=1), np.finfo(float).tiny)
        share = np.clip(np.sum((points - begin) * way, axis=1) / length, 0.0, 1.0)
        found = np.minimum(found, np.linalg.norm(begin + share[:, None] * way - points, axis=1))
    return np.asarray(found)


def _skipped(task: Task, positions: Floats, free: Bools) -> float:
    """Largest distance from the path to the tool's untouched ways."""
    both = np.flatnonzero(free[1:] & free[:-1])
    if not len(both):
        return float("inf")
    # Densely: cycles may be far apart.
    ways = (
        positions[both, None] + SHARES[:, None] * (positions[both + 1] - positions[both])[:, None]
    )
    return float(cKDTree(ways.reshape(-1, 3)).query(task.path)[0].max())
