"""Processes that write into one folder, one table and one cache, and are killed at random.

``python -m benchmarks.kills --rounds 1000`` (or ``make kills``), with 2 and with 10 processes at
once.  After each round: every row that was told stands in the table, every row's primitive is what
its checksum says, a summary tells only of files that are there, nothing is locked, and the next run
leaves nothing but what it is asked for.  What is learned is not the point: it is made beforehand.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from noslip._files import locked, renewing, write_beside
from noslip.codegen import library
from noslip.errors import InputError
from noslip.many import learning, worker
from noslip.many.learning import learn_each
from noslip.result_table import read_results

PROCESSES = (2, 10)
ROWS = 4
"""Recordings of each process; as many again are learned by all."""
LONGEST = 0.15
"""Seconds until the last kill: about as long as a process needs where ten run at once."""
COMPILED = 8
"""Of so many processes one compiles: a compiler takes longer than all else."""


class Place:
    """The folders of all rounds, and what belongs there after an undisturbed run."""

    def __init__(self, folder: Path, processes: int) -> None:
        self.recordings, self.out = folder / "recordings", folder / "out"
        self.family, self.cache = folder / "family", folder / "cache"
        self.recordings.mkdir()
        self.names = [
            [f"p{process}_{k}" for k in range(ROWS)] + [f"all_{k}" for k in range(ROWS)]
            for process in range(processes)
        ]
        for name in {name for names in self.names for name in names}:
            (self.recordings / f"{name}.csv").write_text(name)

    def learn(self, names: list[str], key: int) -> None:
        files = [self.recordings / f"{name}.csv" for name in names]
        learn_each(files, out=self.out, basis_functions=key)

    def adapt(self, key: int) -> None:
        """Write as ``adapt --goals`` does."""
        with renewing(self.family / "summary.csv") as last:
            for k in range(ROWS):
                write_beside(self.family / f"goal_{k}.json", b"%d " % key * 20_000)
            write_beside(last, str(key).encode())

    def compile(self, key: int) -> bytes:
        return library.built("step", {"step.c": f"int key(void) {{ return {key}; }}"}).read_bytes()


@contextmanager
def made_beforehand(told: int) -> Iterator[None]:
    """Learn at once, write the table after each row, and tell what it then holds."""

    def figures(self: worker.Worker, file: Path, primitive: Path) -> dict[str, Any]:
        key = self.asked["options"]["basis_functions"]
        write_beside(primitive, json.dumps([file.stem, key] * 3000).encode())
        return {"samples": key}

    write = learning._Table.write

    def writing(self: learning._Table) -> None:
        write(self)
        self.next = 0.0
        os.write(told, "".join(f"{name}\n" for name in self.added).encode())

    with (
        mock.patch.object(worker.Worker, "_figures", figures),
        mock.patch.object(learning._Table, "write", writing),
    ):
        yield


def process(place: Place, index: int, key: int, told: int) -> None:
    """What one process does, until it is killed."""
    with made_beforehand(told):
        if (key + index) % COMPILED == 0:
            place.compile(key)
        place.learn(place.names[index], key)
        try:
            place.adapt(key)
        except InputError as error:
            if "another noslip is writing there" not in str(error):
                raise


def faults(place: Place, told: set[str], key: int) -> Iterator[str]:
    """What must not be, after a round."""
    table = place.out / "results.csv"
    rows = {row.name: row for row in read_results(table)} if table.exists() else {}
    if lost := {name for name in told if name not in rows or rows[name].samples != key}:
        yield f"rows lost: {len(lost)}"
    for row in rows.values():
        content = (place.out / f"{row.name}.json").read_bytes()
        if hashlib.sha256(content).hexdigest() != row.checksum:
            yield "a primitive is not what its row says"
    summary = place.family / "summary.csv"
    for file in place.family.glob("*.json"):
        found = set(file.read_bytes().split())
        if len(found) != 1 or (summary.exists() and found != {summary.read_bytes()}):
            yield "a summary tells of other files" if len(found) == 1 else "a file is torn"
    for folder in (place.out, place.family):
        with locked(folder, wait=False):
            pass
    for names in place.names:
        place.learn(names, key)
    place.adapt(key)
    place.compile(key)
    expected = {f"{name}.json" for names in place.names for name in names} | {"results.csv"}
    if left := {file.name for file in place.out.iterdir()} - expected:
        yield f"left in the folder: {len(left)}"
    if left := {file.name for file in place.family.iterdir() if file.name.startswith(".")}:
        yield f"left in the family: {len(left)}"
    whole = {file.stem for file in place.cache.glob("*.so") if library._whole(file)}
    if left := {file.name for file in place.cache.iterdir() if file.stem not in whole}:
        yield f"left in the cache: {len(left)}"


def rounds(count: int, processes: int, seed: int, folder: Path) -> dict[str, Any]:
    """Let processes write and be killed so often; what was found."""
    place, random = Place(folder, processes), np.random.default_rng(seed)
    os.environ |= {"NOSLIP_CACHE": str(place.cache), "NOSLIP_COMPILE": "1"}
    found: Counter[str] = Counter()
    killed = rows = ended = 0
    for key in range(5, 5 + count):
        reading, writing = os.pipe()
        running = []
        for index in range(processes):
            child = os.fork()
            if child == 0:
                code = 1
                try:
                    process(place, index, key, writing)
                    code = 0
                finally:
                    os._exit(code)
            running.append(child)
        os.close(writing)
        begin = time.monotonic()
        moments = np.sort(random.uniform(0, LONGEST * processes / 10 + 0.02, processes))
        for moment, child in zip(moments, random.permutation(running), strict=True):
            time.sleep(max(0.0, begin + moment - time.monotonic()))
            if random.random() < 0.8:
                os.kill(int(child), signal.SIGKILL)
        with os.fdopen(reading) as told:
            names = set(told.read().split())
        for child in running:
            code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
            killed += code == -signal.SIGKILL
            ended += code == 0
            if code not in (0, -signal.SIGKILL):
                found[f"a process ended with {code}"] += 1
        rows += len(names)
        with Path(os.devnull).open("wb") as nowhere, made_beforehand(nowhere.fileno()):
            found.update(faults(place, names, key))
    return {
        "processes": processes,
        "rounds": count,
        "killed": killed,
        "ended": ended,
        "rows told": rows,
        "faults": dict(found),
    }


def main(arguments: list[str] | None = None) -> int:
    """Parse arguments, run, print a line for each number of processes; 1 if anything was found."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rounds", type=int, default=1000, help="for each number of processes")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    faulty = False
    for processes in PROCESSES:
        with tempfile.TemporaryDirectory() as folder:
            found = rounds(options.rounds, processes, options.seed, Path(folder))
        print(json.dumps(found), flush=True)
        faulty |= bool(found["faults"])
    return int(faulty)


if __name__ == "__main__":
    sys.exit(main())
