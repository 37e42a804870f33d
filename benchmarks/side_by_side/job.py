"""What every library is given, and how what it makes of it is judged."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as installed
from time import process_time
from typing import Any

import numpy as np

from benchmarks.example import MOVED_GOAL, SAMPLES, demonstration
from noslip import Blade, PoseTrajectory
from noslip._typing import Floats
from noslip.merit import FiguresOfMerit, figures_of_merit

LONGEST = 8.0
"""Seconds of a motion that is made again only once."""
MINUTES = 60.0
"""Seconds of one that is not."""
DEMONSTRATED, MOVED = "to the demonstrated end", "to an end 0.2 m aside"
NOTEBOOK = "as in the authors' notebook"


@dataclass(frozen=True, eq=False)
class Job:
    """A demonstration to follow without slip, and where to end.

    Attributes
    ----------
    name : str
    given : PoseTrajectory
    goal : array, shape (3,)
        Meters.
    """

    name: str
    given: PoseTrajectory
    goal: Floats

    @property
    def time_step(self) -> float:
        """Of the samples (s)."""
        return self.given.duration / (len(self.given) - 1)


def jobs(samples: int = SAMPLES) -> tuple[Job, Job]:
    """Return both jobs, of as many samples."""
    given = demonstration(samples)
    return (
        Job(DEMONSTRATED, given, given.positions[-1]),
        Job(MOVED, given, np.array(MOVED_GOAL)),
    )


def notebook(samples: int = SAMPLES) -> Job:
    """Return the demonstration as the notebook of the paper's authors has it.

    Its last sample is at 1 s, but 0.999 s from the first: it is a thousandth faster, and ends at
    rest.
    """
    times = demonstration(samples).times
    path = demonstration(samples, 1.0)
    given = PoseTrajectory(times, path.positions, path.rotations)
    return Job(NOTEBOOK, given, given.positions[-1])


@dataclass(frozen=True)
class Row:
    """What one library made of one job, or why it did not.

    Attributes
    ----------
    library, version, way : str
        The version is as installed or told; ``way`` is how the library is used.
    job : str
    merit : FiguresOfMerit or None
        Against the demonstration, under the blade.
    missed : float
        Distance from the goal at the end (m).
    slip_at_ends : float
        Largest speed across the blade as it stands at the steps' ends (m/s), where the paper's
        method asks for none; the merit's is that of their middles.
    first, seconds : float
        The first time, with all that is imported, compiled or built for it, and the lowest of those
        after it (processor seconds, of all threads): of the whole motion, fitted or planned and
        rolled out.
    skipped : str
        The reason.
    move : callable, optional
        What makes the motion.
    """

    library: str
    version: str
    way: str
    job: str = ""
    merit: FiguresOfMerit | None = None
    missed: float = np.nan
    slip_at_ends: float = np.nan
    first: float = np.nan
    seconds: float = np.nan
    skipped: str = ""
    move: Callable[[], PoseTrajectory] | None = None

    def to_dict(self) -> dict[str, Any]:
        """Plain data, for JSON; what was not measured is None."""
        found = asdict(replace(self, move=None))
        del found["move"]
        return {
            name: None if isinstance(value, float) and np.isnan(value) else value
            for name, value in found.items()
        }


def judged(
    library: str, version: str, way: str, job: Job, move: Callable[[], PoseTrajectory]
) -> Row:
    """Make a motion for the first time, and judge it."""
    motion, first = _timed(move)
    return Row(
        library,
        version,
        way,
        job.name,
        figures_of_merit(motion, job.given, Blade()),
        float(np.linalg.norm(motion.positions[-1] - job.goal)),
        slip_at_ends(motion),
        first,
        first,
        move=move,
    )


def timed(rows: Sequence[Row], rounds: int) -> list[Row]:
    """Make all motions again in turn, round after round: a slow phase hits all alike.

    What takes minutes is not made again.
    """
    found = list(rows)
    lowest: dict[int, float] = {}
    for turn in range(rounds):
        for k, row in enumerate(found):
            most = 1 if lowest.get(k, row.first) > LONGEST else rounds
            if row.move is None or turn >= most or row.first > MINUTES:
                continue
            _, seconds = _timed(row.move)
            lowest[k] = min(seconds, lowest.get(k, np.inf))
    for k, seconds in lowest.items():
        found[k] = replace(found[k], seconds=seconds)
    return found


def _timed(move: Callable[[], PoseTrajectory]) -> tuple[PoseTrajectory, float]:
    begun = process_time()
    motion = move()
    return motion, process_time() - begun


def slip_at_ends(motion: PoseTrajectory) -> float:
    """Return the largest speed along the tool's y axis, of the steps, as it stands at their ends.

    In m/s.
    """
    linear, _ = motion.step_velocities()
    return float(np.abs(motion.rotations[1:].inv().apply(linear)[:, 1]).max())


def version_of(package: str) -> str:
    """Return the version of a distribution, or nothing if it was not installed as one."""
    try:
        return installed(package)
    except PackageNotFoundError:
        return ""
