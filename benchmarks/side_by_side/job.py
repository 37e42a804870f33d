"""What every library is given, and how what it makes of it is judged."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as installed
from time import process_time

import numpy as np

from benchmarks.example import MOVED_GOAL, SAMPLES, demonstration
from noslip import Blade, PoseTrajectory
from noslip._typing import Floats
from noslip.merit import FiguresOfMerit, figures_of_merit

LONGEST = 5.0
"""Seconds after which a motion is not made again."""
DEMONSTRATED, MOVED = "to the demonstrated end", "to an end 0.2 m aside"


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
        The first time, with all that is compiled or built for it, and the median of those after it
        (processor seconds, of all threads): of the whole motion, fitted or planned and rolled out.
    skipped : str
        The reason.
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


def measured(
    library: str,
    version: str,
    way: str,
    job: Job,
    move: Callable[[], PoseTrajectory],
    *,
    repeat: int = 5,
) -> Row:
    """Run what makes a motion, the first time and then again, and judge the motion."""
    seconds = []
    for _ in range(repeat + 1):
        if sum(seconds) > LONGEST and len(seconds) > 1:
            break
        begun = process_time()
        motion = move()
        seconds.append(process_time() - begun)
    return Row(
        library,
        version,
        way,
        job.name,
        figures_of_merit(motion, job.given, Blade()),
        float(np.linalg.norm(motion.positions[-1] - job.goal)),
        slip_at_ends(motion),
        seconds[0],
        float(np.median(seconds[1:] or seconds)),
    )


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
