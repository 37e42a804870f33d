"""A primitive from each of many recordings; what was learned before is kept."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager, closing, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from time import monotonic
from typing import Any, Unpack

from noslip import _arguments
from noslip._files import locked
from noslip.constraints.declaration import Constraint
from noslip.constraints.system import ConstraintSystem
from noslip.errors import CompromiseWarning, InputError, one_line, warn
from noslip.learning import Learning
from noslip.many.executors import Task, replies
from noslip.many.recordings import Recordings, content_hash, find_recordings
from noslip.many.settings import settings_text
from noslip.result_table import RecordingResult, read_results, require_format, write_results

FLUSH = 2.0
"""Seconds between two writings of the table, at least: what a crash may lose of it."""
_FLUSH_SHARE = 0.05
"""Share of the time that writing the table may take: a table of many rows is written less often."""


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
    progress: Callable[[int, int], None] | None = None,
    **options: Unpack[Learning],
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
    own_table = None if folder is None else folder / "results.csv"
    target = own_table if table is None else Path(table)
    settings = settings_text(constraints, loading or {}, preparation or {}, options)
    key = hashlib.sha256(settings.encode()).hexdigest()[:16]
    files = find_recordings(recordings, leave_out=[p for p in (target, own_table) if p])

    primitives = {name: None if folder is None else folder / f"{name}.json" for name in files}
    book = _Table(target, list(files))
    tasks: dict[str, Task] = {}
    with book.turn():
        book.rows = book.stored()
        for name, file in files.items():
            primitive = primitives[name]
            if name in book.rows and _is_done(book.rows[name], file, primitive, key):
                continue
            if executor is not None:
                # Its workers may run in another folder.
                file, primitive = file.absolute(), primitive and primitive.absolute()
            tasks[name] = (name, str(file), None if primitive is None else str(primitive))
        # What is about to be replaced is no longer what the table says.
        book.rows = {name: row for name, row in book.rows.items() if name not in tasks}
        book.store(book.rows)
    kept = len(files) - len(tasks)
    if progress is not None:
        progress(kept, len(files))
    try:
        with closing(replies(settings, tasks, executor, jobs)) as coming:
            for done, (name, reply) in enumerate(coming, start=kept + 1):
                if isinstance(reply, str):
                    reply = RecordingResult(name=name, status="failed", message=reply, recording="")
                if (primitive := primitives[name]) is not None and reply.status == "failed":
                    # What an earlier run wrote there is no primitive of this recording.
                    primitive.unlink(missing_ok=True)
                    primitive = None
                recording, written = one_line(files[name]), one_line(primitive or "")
                message = one_line(reply.message)
                reply = replace(reply, recording=recording, primitive=written, message=message)
                book.add(replace(reply, settings=key))
                if progress is not None:
                    progress(done, len(files))
    finally:
        book.write()
    for name in tasks:
        if book.rows[name].status == "learned" and book.rows[name].message:
            warn(book.rows[name].message, CompromiseWarning)
    return LearnedEach(tuple(book.rows[name] for name in files), kept, target)


class _Table:
    """The table while it grows; others may write their rows to it meanwhile."""

    def __init__(self, path: Path | None, order: list[str]) -> None:
        self.path, self.order = path, order
        self.rows: dict[str, RecordingResult] = {}
        self.added: dict[str, RecordingResult] = {}
        if path is not None:
            require_format(path)
        self.next = 0.0

    def turn(self) -> AbstractContextManager[None]:
        """Let no other process write the table between reading and writing it."""
        return nullcontext() if self.path is None else locked(self.path.parent)

    def stored(self) -> dict[str, RecordingResult]:
        """Rows as they stand in the table now."""
        if self.path is None or not self.path.exists():
            return {}
        return {row.name: row for row in read_results(self.path)}

    def add(self, row: RecordingResult) -> None:
        self.rows[row.name] = self.added[row.name] = row
        if monotonic() > self.next:
            self.write()

    def write(self) -> None:
        """Put the rows learned here into what others may have written meanwhile."""
        begin = monotonic()
        with self.turn():
            self.store(self.stored() | self.added)
        self.next = monotonic() + max(FLUSH, (monotonic() - begin) / _FLUSH_SHARE)

    def store(self, rows: Mapping[str, RecordingResult]) -> None:
        """Write the rows of other recordings, then ours as they were given."""
        if self.path is None:
            return
        ours = {name: rows[name] for name in self.order if name in rows}
        others = [row for name, row in rows.items() if name not in ours]
        write_results([*others, *ours.values()], self.path)


def _is_done(row: RecordingResult, file: Path, primitive: Path | None, settings: str) -> bool:
    """Whether an earlier run learned this recording with these settings."""
    content = content_hash(file) if row.content else ""
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
        and (primitive is None or content_hash(primitive) == row.checksum != "")
    )
