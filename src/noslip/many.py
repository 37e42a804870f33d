"""Many recordings -> a primitive each, in one process, in several, or on a cluster.

What is sent to a worker is a path and a text (JSON): constraints as their expressions, never as
pickled code.  A worker reads the recording and writes the primitive, so that both must lie where it
can reach them under the same path; figures of merit come back.  CasADi graphs are built once a
worker.
"""

from __future__ import annotations

import hashlib
import inspect
import json
import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
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
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from time import monotonic, perf_counter
from typing import Any

import numpy as np

from noslip import _arguments
from noslip._version import __version__
from noslip.comparison import Comparison, compare
from noslip.constraints.catalog import restore, specification
from noslip.constraints.check import check, step_residuals
from noslip.constraints.declaration import Constraint
from noslip.constraints.system import ConstraintSystem, as_system
from noslip.demonstrations.preparation import prepare
from noslip.errors import ConstraintError, InputError, MissingDependencyError, NoslipError
from noslip.learning import ConstrainedDMP, learn
from noslip.projection.pointwise import project_initial_velocity
from noslip.recordings.formats import SUFFIXES, expand, folder_format, load_demonstrations
from noslip.result_table import RecordingResult, read_results, require_format, write_results
from noslip.trajectory import PoseTrajectory

TABLE = "results.csv"
FLUSH = 2.0
"""Seconds between two writings of the table, at least."""
_FLUSH_SHARE = 0.05
"""Share of the time that writing the table may take."""
_ALONE = 2
"""How often a recording whose process died is tried again, with no other beside it."""
_THREADS = ("OMP", "OPENBLAS", "MKL", "BLIS", "VECLIB_MAXIMUM")
_WORKERS_WITHIN = 30.0
"""Seconds in which a cluster must show a worker."""

Recordings = str | Path | Iterable[str | Path]


@dataclass(frozen=True)
class LearnedEach:
    """What became of many recordings.

    Attributes
    ----------
    results : tuple of RecordingResult
        One a recording, in the order given.
    kept : int
        How many of them an earlier run had learned already.
    table : Path or None
        Where the results are written.
    """

    results: tuple[RecordingResult, ...]
    kept: int
    table: Path | None

    @property
    def failed(self) -> tuple[RecordingResult, ...]:
        """The results of those that have no primitive."""
        return tuple(result for result in self.results if result.status == "failed")


def learn_each(
    recordings: Recordings,
    constraints: ConstraintSystem | Constraint | Sequence[Constraint] = (),
    *,
    out: str | Path | None = None,
    table: str | Path | None = None,
    executor: Executor | None = None,
    jobs: int = 1,
    loading: Mapping[str, Any] | None = None,
    preparation: Mapping[str, Any] | None = None,
    project_start: bool = False,
    progress: Callable[[int, int], None] | None = None,
    **options: Any,
) -> LearnedEach:
    """Learn one primitive from each recording; one that fails does not stop the others.

    What an earlier call has learned from a file of the same content with the same settings is not
    learned again; what failed is tried again.  Interrupted, it leaves whole primitives and a whole
    table, and the next call goes on from there.

    Parameters
    ----------
    recordings : path, glob, folder or iterable of them
        A folder stands for all recordings in it and below.
    constraints : Constraint or several
    out : path, optional
        Folder for the primitives, ``<stem>.json``; recordings from a folder keep their folders
        below it.  Without it only the figures are kept.
    table : path, optional
        Table of the results, .csv or .parquet; ``results.csv`` in ``out`` by default.  Rows of
        other recordings stay in it.
    executor : concurrent.futures.Executor, optional
        Where the work is done: processes, threads, MPI, ``dask.distributed.Client.get_executor()``.
        It is not shut down.  Workers need noslip in the same version and the same folders.
    jobs : int
        Without an executor: processes of this machine, 1 for this one.  A script needs
        ``if __name__ == "__main__":`` around its call with more.
    loading, preparation : mapping, optional
        Options of :func:`noslip.load_demonstrations` and :func:`noslip.prepare`.
    project_start : bool
        Project the recordings' initial velocity onto the constraints.
    progress : callable, optional
        Called with (recordings done, all).
    **options
        Of :func:`noslip.learn`.

    Raises
    ------
    InputError
        If nothing is found, two recordings would become one primitive, the table is something else,
        or an option is not known.
    ConstraintError
        If a constraint uses more than arithmetic, so that it cannot be sent to a worker or saved.
    NoslipError
        If no worker process can be started.
    """
    jobs = _arguments.count("jobs", jobs)
    folder = None if out is None else Path(out)
    if folder is not None and folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file; give a folder for the primitives")
    own_table = None if folder is None else folder / TABLE
    target = own_table if table is None else Path(table)
    settings = _settings(constraints, loading or {}, preparation or {}, project_start, options)
    key = hashlib.sha256(settings.encode()).hexdigest()[:16]
    files = find_recordings(recordings, leave_out=[p for p in (target, own_table) if p])

    book = _Book(target, list(files))
    tasks: dict[str, _Task] = {}
    for name, file in files.items():
        primitive = None if folder is None else folder / f"{name}.json"
        if name in book.rows and _is_done(book.rows[name], file, primitive, key):
            continue
        if executor is not None:
            # Its workers may run in another folder.
            file, primitive = file.absolute(), primitive and primitive.absolute()
        tasks[name] = (name, str(file), None if primitive is None else str(primitive))
    kept = len(files) - len(tasks)

    # What is about to be replaced is no longer what the table says.
    book.rows = {name: row for name, row in book.rows.items() if name not in tasks}
    if progress is not None:
        progress(kept, len(files))
    try:
        book.write()
        with closing(_replies(settings, tasks, executor, jobs)) as replies:
            for done, (name, reply) in enumerate(replies, start=kept + 1):
                if isinstance(reply, str):
                    reply = RecordingResult(name=name, status="failed", message=reply, recording="")
                written = ""
                if folder is not None:
                    primitive = folder / f"{name}.json"
                    if reply.status == "learned":
                        written = str(primitive)
                    else:
                        # What an earlier run wrote there is no primitive of this recording.
                        primitive.unlink(missing_ok=True)
                book.add(
                    replace(reply, recording=str(files[name]), primitive=written, settings=key)
                )
                if progress is not None:
                    progress(done, len(files))
    finally:
        book.write()
    return LearnedEach(tuple(book.rows[name] for name in files), kept, target)


class _Book:
    """The table while it grows."""

    def __init__(self, path: Path | None, order: list[str]) -> None:
        self.path, self.order = path, order
        self.rows: dict[str, RecordingResult] = {}
        if path is not None:
            require_format(path)
            if path.exists():
                self.rows = {row.name: row for row in read_results(path)}
        self.next = 0.0

    def add(self, row: RecordingResult) -> None:
        self.rows[row.name] = row
        if monotonic() > self.next:
            self.write()

    def write(self) -> None:
        """Write the rows of other recordings, then ours as they were given."""
        if self.path is None:
            return
        begin = monotonic()
        ours = {name: self.rows[name] for name in self.order if name in self.rows}
        others = [row for name, row in self.rows.items() if name not in ours]
        write_results([*others, *ours.values()], self.path)
        self.next = monotonic() + max(FLUSH, (monotonic() - begin) / _FLUSH_SHARE)


def find_recordings(recordings: Recordings, *, leave_out: Iterable[Path] = ()) -> dict[str, Path]:
    """Return the files that paths, globs and folders stand for, by the name of their primitive.

    Hidden files and folders are passed over, and so is ``leave_out``.

    Raises
    ------
    InputError
        If a path is missing, a folder holds no recording, or two files have one name.
    """
    passed_over = {path.resolve() for path in leave_out}
    found: dict[Path, tuple[str, Path]] = {}
    for path in [recordings] if isinstance(recordings, (str, Path)) else recordings:
        folder = Path(path).expanduser()
        if folder.is_dir() and folder_format(folder) is None:
            inside = [
                (file.relative_to(folder), file)
                for file in sorted(folder.rglob("*"))
                if file.suffix.lower() in SUFFIXES and file.resolve() not in passed_over
            ]
            named = [
                (below.with_suffix("").as_posix(), file)
                for below, file in inside
                if not any(part.startswith(".") for part in below.parts) and file.is_file()
            ]
            if not named:
                raise InputError(
                    f"{path}: no recording in this folder; known are {', '.join(SUFFIXES)}"
                )
        else:
            named = [(file.stem, file) for file in expand(path)]
        for name, file in named:
            if file.resolve() not in passed_over:
                found.setdefault(file.resolve(), (name, file))
    if not found:
        raise InputError("no recordings given; give files, globs or folders")
    files: dict[str, Path] = {}
    taken: dict[str, Path] = {}
    for name, file in found.values():
        # Some file systems take upper and lower case for the same.
        other = taken.setdefault(name.casefold(), file)
        if other is not file:
            raise InputError(
                f"{file}: its primitive would be {name}.json, as that of {other}; give the folder "
                "that holds both, or rename one"
            )
        files[name] = file
    return files


@contextmanager
def cluster(address: str) -> Iterator[Executor]:
    """Yield an executor on the Dask cluster whose scheduler is at an address.

    Dask itself does again what a worker that died was doing.

    Raises
    ------
    MissingDependencyError, InputError
        If ``distributed`` is missing, or no scheduler or worker answers there.
    """
    try:
        Client: Any = import_module("distributed").Client
    except ImportError as error:
        raise MissingDependencyError(
            "a cluster needs dask.distributed: pip install 'noslip[cluster]'"
        ) from error
    try:
        client = Client(address, timeout=_WORKERS_WITHIN / 3, set_as_default=False)
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


# ---------------------------------------------------------------- what is asked for


def _settings(
    constraints: ConstraintSystem | Constraint | Sequence[Constraint],
    loading: Mapping[str, Any],
    preparation: Mapping[str, Any],
    project_start: bool,
    options: Mapping[str, Any],
) -> str:
    """Return all that a worker needs besides the recording, as JSON."""
    asked = {
        "noslip": __version__,
        "constraints": _specifications(as_system(constraints)),
        "loading": _completed(load_demonstrations, loading),
        "preparation": _completed(prepare, preparation),
        "project_start": bool(project_start),
        "options": _completed(learn, options),
    }
    return json.dumps(asked, sort_keys=True, default=lambda array: array.tolist())


def _specifications(system: ConstraintSystem) -> list[dict[str, Any]]:
    specifications = []
    for constraint in system.constraints:
        try:
            specifications.append(specification(constraint))
            restore(json.loads(json.dumps(specifications[-1], default=float)))
        except (ConstraintError, TypeError, ValueError) as error:
            raise ConstraintError(
                f"{constraint.name!r} cannot be sent to a worker nor saved: {error}"
            ) from error
    return specifications


def _completed(function: Callable[..., Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """Return options with the function's defaults, so that naming a default changes nothing."""
    known = {
        name: parameter.default
        for name, parameter in inspect.signature(function).parameters.items()
        if parameter.kind is parameter.KEYWORD_ONLY and name != "progress"
    }
    for name, value in given.items():
        if name not in known:
            raise InputError(f"{function.__name__} has no option {name!r}; it has {_list(known)}")
        try:
            json.dumps(value, default=lambda array: array.tolist())
        except (AttributeError, TypeError, ValueError):
            raise InputError(
                f"{name} must be made of numbers and texts to be sent to a worker, got "
                f"{_arguments.short(value)}"
            ) from None
    return known | dict(given)


def _is_done(row: RecordingResult, file: Path, primitive: Path | None, settings: str) -> bool:
    """Whether an earlier run learned this recording with these settings."""
    content = _content(file) if row.content else ""
    other = Path(row.recording)
    if row.content != content and other.exists() and not other.samefile(file):
        raise InputError(
            f"{file}: its primitive would replace {row.name}.json, learned from {other}; give "
            "another --out, or the folder that holds both"
        )
    return (
        row.status == "learned"
        and row.settings == settings
        and row.content == content
        and (primitive is None or primitive.is_file())
    )


def _content(file: Path) -> str:
    try:
        with file.open("rb") as opened:
            return hashlib.file_digest(opened, "sha256").hexdigest()
    except OSError:
        return ""  # Reading it says what is wrong.


def _list(names: Iterable[str]) -> str:
    return ", ".join(names)


# ---------------------------------------------------------------- in a worker


class _Worker:
    """What a process needs for all recordings."""

    def __init__(self, settings: str) -> None:
        self.asked = json.loads(settings)
        if self.asked["noslip"] != __version__:
            raise NoslipError(
                f"a worker runs noslip {__version__}, this is {self.asked['noslip']}; install the "
                "same version on both"
            )
        self.system = ConstraintSystem([restore(data) for data in self.asked["constraints"]])
        self.steppers: dict[tuple[float, ...], Any] = {}

    def learn(self, name: str, file: Path, primitive: Path | None) -> RecordingResult:
        begin = perf_counter()
        content = _content(file)
        try:
            figures, failure = self._figures(file, primitive), ""
        except Exception as error:
            figures, failure = {}, _told(error)
        return RecordingResult(
            name=name,
            status="failed" if failure else "learned",
            message=failure,
            recording=str(file),
            content=content,
            seconds=perf_counter() - begin,
            **figures,
        )

    def _figures(self, file: Path, primitive: Path | None) -> dict[str, Any]:
        loaded = load_demonstrations([file], **self.asked["loading"])
        if len(loaded) != 1:
            raise InputError(f"{file}: holds {len(loaded)} recordings; give files with one each")
        demonstration = prepare(loaded[0], **self.asked["preparation"])
        if self.asked["project_start"]:
            demonstration = project_initial_velocity(demonstration, self.system)
        dmp = learn(demonstration, self.system, **self.asked["options"])
        figures = self._compared(dmp, demonstration)
        if primitive is not None:
            dmp.save(primitive)
        return figures

    def _compared(self, dmp: ConstrainedDMP, demonstration: PoseTrajectory) -> dict[str, Any]:
        system = self.system
        # The graphs of the constraints and of a step do not depend on what was learned.
        if dmp.inverse_metric not in self.steppers:
            self.steppers[dmp.inverse_metric] = dmp.stepper
        dmp.take_over(system, self.steppers[dmp.inverse_metric])
        motion = dmp.rollout()
        compared: Comparison = compare(motion, demonstration, system)
        off = step_residuals(demonstration, system.equalities)
        off = np.abs(off).max(axis=1, initial=0.0)
        force, torque = motion.constraint_forces[:, :3], motion.constraint_forces[:, 3:]
        end = motion.rotations[-1] * demonstration.rotations[-1].inv()
        figures: dict[str, Any] = {
            "samples": len(demonstration),
            "duration_s": demonstration.duration,
            "path_length_m": demonstration.path_length,
            "recording_residual_peak": float(off.max()),
            "recording_residual_rms": float(np.sqrt(np.mean(off**2))),
            "residual_peak": compared.residual_peak,
            "residual_rms": compared.residual_rms,
            "holds": check(motion, system).satisfied if system.size else True,
            "least_margins": _list(f"{k}={v:.6g}" for k, v in compared.least_margins.items()),
            "end_position_error_m": compared.position_end,
            "end_rotation_error_deg": float(np.degrees(end.magnitude())),
            "position_rms_m": compared.position_rms,
            "rotation_rms_deg": float(np.degrees(compared.rotation_rms)),
            "rotation_peak_deg": float(np.degrees(compared.rotation_peak)),
            "angular_speed_peak_rad_s": compared.angular_speed_peak,
            "angular_acceleration_peak_rad_s2": compared.angular_acceleration_peak,
            "slowest_edge_speed_m_s": compared.slowest_edge_speed,
            "force_peak_m_s2": float(np.linalg.norm(force, axis=1).max(initial=0.0)),
            "torque_peak_rad_s2": float(np.linalg.norm(torque, axis=1).max(initial=0.0)),
        }
        for record in dmp.record:
            figures |= {
                "iterations": record.iterations,
                "backing": record.backing,
                "smoothing": record.smoothing,
                "left_out": _list(record.left_out),
                "projected_residual": record.residual,
                "position_change_m": record.position_change,
                "rotation_change_deg": float(np.degrees(record.rotation_change)),
            }
        return figures


_worker = lru_cache(maxsize=2)(_Worker)
# Compiled graphs work in buffers of their own: one thread at a time.
_ONE_THREAD = threading.Lock()


def _learn_one(settings: str, name: str, file: str, primitive: str | None) -> RecordingResult:
    """What a worker is asked to do."""
    target = None if primitive is None else Path(primitive)
    with _ONE_THREAD:
        return _worker(settings).learn(name, Path(file), target)


def _told(error: BaseException) -> str:
    """Return an error as one line; those of noslip speak for themselves."""
    text = " ".join(str(error).split())
    if isinstance(error, NoslipError) and text:
        return text
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


# ---------------------------------------------------------------- where it is done

_Task = tuple[str, str, str | None]
_Reply = tuple[str, RecordingResult | str]
_DIED = "the process that learned it died each time, with no other beside it: too little memory?"


def _replies(
    settings: str, tasks: Mapping[str, _Task], executor: Executor | None, jobs: int
) -> Generator[_Reply, None, None]:
    """Do all tasks; yield the result of each, or why there is none, in the order of completion."""
    if executor is not None:
        yield from _in_executor(settings, tasks, executor)
    elif jobs > 1 and tasks:
        yield from _in_processes(settings, tasks, jobs)
    else:
        with _noted_interrupts() as heed:
            for name, task in tasks.items():
                reply = _learn_one(settings, *task)
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
    settings: str, tasks: Mapping[str, _Task], executor: Executor
) -> Generator[_Reply, None, None]:
    pending: dict[Future[RecordingResult], str] = {}
    try:
        for name, task in tasks.items():
            try:
                pending[executor.submit(_learn_one, settings, *task)] = name
            except RuntimeError as error:  # Broken, or shut down.
                yield name, _told(error)
        for future in as_completed(list(pending)):
            try:
                reply: RecordingResult | str = future.result()
            except CancelledError:
                reply = "canceled: the executor, or its scheduler, is gone"
            except Exception as error:
                reply = _told(error)
            yield pending.pop(future), reply
    finally:
        for future in pending:
            future.cancel()


def _in_processes(
    settings: str, tasks: Mapping[str, _Task], jobs: int
) -> Generator[_Reply, None, None]:
    """Do all tasks in processes of this machine, in new ones where some have died.

    Which recording a process died of is not known, so all that were under way are suspects; they
    are done again at the end, one by one.
    """
    waiting, suspects = deque(tasks.values()), deque[_Task]()
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
        replies = (r for _ in range(_ALONE) for _, r in _one_pool(settings, deque([task]), 1, 1))
        with closing(replies):
            yield task[0], next((r for r in replies if r is not None), _DIED)


def _one_pool(
    settings: str, waiting: deque[_Task], jobs: int, under_way: int
) -> Generator[tuple[_Task, RecordingResult | str | None], None, None]:
    """Do what waits until nothing does or a process has died; None for what was lost then."""
    pending: dict[Future[RecordingResult], _Task] = {}
    broken = False
    with _processes(jobs) as pool:
        while pending or (waiting and not broken):
            while waiting and not broken and len(pending) < under_way:
                try:
                    future = pool.submit(_learn_one, settings, *waiting[0])
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
                    reply = _told(error)
                yield pending.pop(future), reply


@contextmanager
def _processes(jobs: int) -> Iterator[ProcessPoolExecutor]:
    """Yield a pool of fresh processes, with one thread each for the linear algebra."""
    names = [f"{library}_NUM_THREADS" for library in _THREADS]
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
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: Any) -> None:
    """Leave no process behind where the parent was killed."""
    parent.join()
    os._exit(1)


def _require_workers() -> None:
    try:
        with _processes(1) as pool:
            pool.submit(os.getpid).result()
    except BrokenExecutor:
        raise NoslipError(
            "worker processes cannot be started; in a script, call learn_each below "
            'if __name__ == "__main__":, or use one job'
        ) from None
