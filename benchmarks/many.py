"""Many short recordings: how much faster two processes learn them than one.

Both do the same recordings in the same run, round after round, in processes that have started and
have built their graphs; how long that took is told apart.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

from benchmarks.recordings import SAMPLES, write_recordings
from noslip import Blade
from noslip.many import learn_each
from noslip.many.executors import processes as worker_processes

RECORDINGS = 200
WANTED = 1.6
"""Times the throughput of one process that two should reach."""


@dataclass(frozen=True)
class Throughput:
    """Recordings learned by some processes.

    Attributes
    ----------
    processes, recordings, samples : int
        The latter two of each round, and of each recording.
    start : float
        Seconds until the processes are there and have learned one recording each.
    seconds : float
        Least of the rounds.
    failed : int
        Of all rounds.
    """

    processes: int
    recordings: int
    samples: int
    start: float
    seconds: float
    failed: int

    @property
    def rate(self) -> float:
        """Recordings a second."""
        return self.recordings / self.seconds


def learn_many(
    *,
    recordings: int = RECORDINGS,
    rounds: int = 3,
    processes: tuple[int, ...] = (1, 2),
    progress: Callable[[str], None] = lambda message: None,
) -> list[Throughput]:
    """Learn the same recordings by each number of processes, in turn."""
    starts: dict[int, float] = {}
    seconds: dict[int, list[float]] = {count: [] for count in processes}
    failed = dict.fromkeys(processes, 0)
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        files = write_recordings(folder / "recordings", recordings)
        pools = {}
        for count in processes:
            progress(f"many recordings: {count} process(es) start")
            begin = perf_counter()
            pools[count] = stack.enter_context(worker_processes(count))
            # Twice as many as processes: each gets one, or is there by then.
            learn_each(files[: 2 * count], Blade(), executor=pools[count])
            starts[count] = perf_counter() - begin
        for index in range(rounds):
            for count, pool in pools.items():
                progress(f"many recordings: round {index + 1}/{rounds}, {count} process(es)")
                out = folder / f"out_{count}_{index}"
                begin = perf_counter()
                learned = learn_each(files, Blade(), out=out, executor=pool)
                seconds[count].append(perf_counter() - begin)
                failed[count] += len(learned.failed)
    return [
        Throughput(count, recordings, SAMPLES, starts[count], min(seconds[count]), failed[count])
        for count in processes
    ]
