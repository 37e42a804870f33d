"""noslip at the job: learned, and adapted to another end; compiled or not."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

from benchmarks.control_loop import compiling
from benchmarks.example import ALPHA, ALPHA_S, BASIS_FUNCTIONS, BETA
from benchmarks.side_by_side.job import MOVED, Job, Row, judged
from benchmarks.timing import forget
from noslip import Blade, ConstrainedDMP, PoseTrajectory, __version__, learn

LIBRARY = "noslip"


def rows(jobs: Sequence[Job]) -> Iterator[Row]:
    """Learn or adapt, and roll out in the demonstration's steps."""
    forget()
    for mover in (Mover(compiled=False), Mover(compiled=True)):
        way = "compiled" if mover.compiled else "without a compiler"
        for job in jobs:
            yield judged(LIBRARY, __version__, way, job, partial(mover.move, job))


class Mover:
    """Remembers what it learned, to adapt it."""

    learned: ConstrainedDMP

    def __init__(self, compiled: bool) -> None:
        self.compiled = compiled

    def move(self, job: Job) -> PoseTrajectory:
        """Learn, or adapt what was learned last; roll out."""
        with compiling(self.compiled):
            return self._found(job).rollout(time_step=job.time_step)

    def _found(self, job: Job) -> ConstrainedDMP:
        if job.name != MOVED:
            self.learned = learn(
                job.given,
                Blade(),
                basis_functions=BASIS_FUNCTIONS,
                alpha=ALPHA,
                beta=BETA,
                alpha_s=ALPHA_S,
            )
            return self.learned
        return self.learned.adapt(goal_position=job.goal)
