"""Where the work is done: in this process, in several of this machine, or on a cluster."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    as_completed,
    wait,
)
from contextlib import closing, contextmanager
from typing import Any

from noslip._extras import need
from noslip.errors import InputError, NoslipError
from noslip.many.worker import as_line, learn_one
from noslip.result_table import RecordingResult

Task = tuple[str, str, str | None]
"""Name, recording and primitive of what is to be learned, as :func:`learn_one` takes them."""
Reply = tuple[str, RecordingResult | str]
"""Name and result, or why there is none."""
_RETRIES = 2
"""How often a recording whose process died is tried again, in a process that does nothing else: a
process may die of what others did to the machine, twice in a row hardly."""
_WORKERS_WITHIN = 30.0
"""Seconds in which a cluster must show a worker: a job scheduler may take as long to start one."""


def replies(
    settings: str, tasks: Mapping[str, Task], executor: Executor | None, jobs: int
) -> Generator[Reply, None, None]:
    """Do all tasks; yield the result of each, or why there is none, in the order of completion."""
    if executor is not None:
        yield from _in_executor(settings, tasks, executor)
    elif jobs > 1 and tasks:
        yield from _in_processes(settings, tasks, jobs)
    else:
        with _noted_interrupts() as heed:
            for name, task in tasks.items():
                reply = learn_one(settings, *task)
                heed()
                yield name, reply


@contextmanager
def _noted_interrupts() -> Iterator[Callable[[], None]]:
    """Yield what raises a KeyboardInterrupt that was lost.

    CasADi forgets one that comes while it converts its arguments.
    """
    noted: list[int] = []

    def note(number: int, frame: Any) -> None:
        noted.append(number)
        signal.default_int_handler(number, frame)

    def heed() -> None:
        if noted:
            raise KeyboardInterrupt

    ours = threading.current_thread() is threading.main_thread()
    if not ours or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield heed
        return
    signal.signal(signal.SIGINT, note)
    try:
        yield heed
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _in_executor(
    settings: str, tasks: Mapping[str, Task], executor: Executor
) -> Generator[Reply, None, None]:
    pending: dict[Future[RecordingResult], str] = {}
    try:
        for name, task in tasks.items():
            try:
                pending[executor.submit(learn_one, settings, *task)] = name
            except RuntimeError as error:  # Broken, or shut down.
                yield name, as_line(error)
        for future in as_completed(list(pending)):
            try:
                reply: RecordingResult | str = future.result()
            except CancelledError:
                reply = "canceled: the executor, or its scheduler, is gone"
            except Exception as error:
                reply = as_line(error)
            yield pending.pop(future), reply
    finally:
        for future in pending:
            future.cancel()


def _in_processes(
    settings: str, tasks: Mapping[str, Task], jobs: int
) -> Generator[Reply, None, None]:
    """Do all tasks in processes of this machine, in new ones where some have died.

    Which recording a process died of is not known, so all that were under way are suspects; they
    are done again at the end, one by one.
    """
    waiting, suspects = deque(tasks.values()), deque[Task]()
    while waiting:
        fruitful = False
        for task, reply in _one_pool(settings, waiting, min(jobs, len(waiting)), 2 * jobs):
            if reply is None:
                suspects.append(task)
                continue
            fruitful = True
            yield task[0], reply
        if not fruitful:
            _require_workers()
    for task in suspects:
        tries = (r for _ in range(_RETRIES) for _, r in _one_pool(settings, deque([task]), 1, 1))
        with closing(tries):
            died = "the process that learned it died each time, alone as it was: too little memory?"
            yield task[0], next((r for r in tries if r is not None), died)


def _one_pool(
    settings: str, waiting: deque[Task], jobs: int, under_way: int
) -> Generator[tuple[Task, RecordingResult | str | None], None, None]:
    """Do what waits until nothing does or a process has died; None for what was lost then."""
    pending: dict[Future[RecordingResult], Task] = {}
    broken = False
    with processes(jobs) as pool:
        while pending or (waiting and not broken):
            while waiting and not broken and len(pending) < under_way:
                try:
                    future = pool.submit(learn_one, settings, *waiting[0])
                except BrokenExecutor:
                    broken = True
                else:
                    pending[future] = waiting.popleft()
            for future in wait(pending, return_when=FIRST_COMPLETED).done:
                reply: RecordingResult | str | None
                try:
                    reply = future.result()
                except BrokenExecutor:
                    reply, broken = None, True
                except Exception as error:
                    reply = as_line(error)
                yield pending.pop(future), reply


@contextmanager
def processes(jobs: int) -> Iterator[ProcessPoolExecutor]:
    """Yield a pool of fresh processes, with one thread each for the linear algebra."""
    names = [
        f"{library}_NUM_THREADS" for library in ("OMP", "OPENBLAS", "MKL", "BLIS", "VECLIB_MAXIMUM")
    ]
    before = {name: os.environ.get(name) for name in names}
    pool = ProcessPoolExecutor(
        jobs, mp_context=multiprocessing.get_context("spawn"), initializer=_prepare_process
    )
    # Read when NumPy is loaded, which is before anything of ours runs there: to be inherited.
    os.environ.update(dict.fromkeys(names, "1"))
    try:
        yield pool
    finally:
        for name, value in before.items():
            os.environ.pop(name)
            if value is not None:
                os.environ[name] = value
        pool.shutdown(wait=True, cancel_futures=True)


def _prepare_process() -> None:
    # Ctrl-C goes to all processes of a terminal; the one that waits for this one deals with it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """Leave no process behind where the parent was killed."""
    if (parent := multiprocessing.parent_process()) is not None:
        parent.join()
        os._exit(1)


def _require_workers() -> None:
    try:
        with processes(1) as pool:
            pool.submit(os.getpid).result()
    except BrokenExecutor:
        raise NoslipError(
            "worker processes cannot be started; in a script, call learn_each below "
            'if __name__ == "__main__":, or use one job'
        ) from None


@contextmanager
def cluster(address: str) -> Iterator[Executor]:
    """Yield an executor on the Dask cluster whose scheduler is at an address.

    Dask itself does again what a worker that died was doing.

    Raises
    ------
    MissingDependencyError, InputError
        If ``distributed`` is missing, or no scheduler or worker answers there.
    """
    distributed = need("a cluster", "distributed", "cluster")
    try:
        client = distributed.Client(address, timeout=_WORKERS_WITHIN / 3, set_as_default=False)
    except (OSError, ValueError) as error:
        raise InputError(
            f"{address}: no Dask scheduler answers there ({' '.join(str(error).split())}); "
            "give the address that `dask scheduler` prints, such as tcp://10.0.0.5:8786"
        ) from error
    with client:
        try:
            client.wait_for_workers(1, timeout=_WORKERS_WITHIN)
        except TimeoutError:
            raise InputError(
                f"{address}: the scheduler has no worker; start some with "
                f"`dask worker {address} --nthreads 1`"
            ) from None
        yield client.get_executor(pure=False)
