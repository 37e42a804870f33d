"""Files of strangers, read in a process of its own, which may take so much time and memory.

    python -P -m noslip.strangers FILE RESULT

That process writes what it read in our own formats, and it is this that is read here: whatever a
file does to the one that reads it, it does not do here, and nothing is unpickled.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import warnings
from pathlib import Path

from noslip._files import scratch
from noslip.errors import InputError, NoslipError, RecordingWarning, one_line
from noslip.primitive import ConstrainedDMP
from noslip.recordings import load_demonstrations
from noslip.saving import load_primitive
from noslip.trajectory import PoseTrajectory

try:
    import resource
except ImportError:
    resource = None  # type: ignore[assignment]

SECONDS = 20
"""To read a file (s): ten times what the largest text takes that the viewer accepts."""
MEMORY = 3 * 2**30
"""Addresses for that (bytes): twice what the largest takes, a tenth of which is libraries."""
MOST_RESULT = 2**28
"""Bytes of what was read: of 2,000,000 samples."""
_REFUSED, _NO_MEMORY = 3, 4
"""Codes with which the process ends; Python itself has 1 and 2."""


class StrangersReader:
    """Reads one file after the other, until it is closed."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._closed = False

    def read(self, path: Path) -> tuple[PoseTrajectory | ConstrainedDMP, list[str]]:
        """Return a recording, or a primitive (.json) that has been rolled out, and the warnings.

        Raises
        ------
        InputError
            In one line: what is wrong with the file, or what reading it took.
        """
        with scratch() as folder:
            result = folder / ("read.json" if _is_primitive(path) else "read.npz")
            with (folder / "told").open("w+b") as out:
                code = self._run(path, result, out.fileno())
                out.seek(0)
                told = out.read(2**16).decode(errors="replace").splitlines()
            if code == _REFUSED and told:
                raise InputError(told[0])
            if code == _NO_MEMORY:
                raise InputError(f"{path}: needs more than {MEMORY / 2**30:g} GiB to be read")
            if code != 0 or not result.is_file():
                raise InputError(f"{path}: cannot be read (its reader ended with code {code})")
            return load_primitive(result) if _is_primitive(path) else (
                PoseTrajectory.from_npz(result)
            ), told

    def close(self) -> None:
        """End what is being read, and read no more."""
        with self._lock:
            self._closed = True
            if self._process is not None:
                self._process.kill()

    def _run(self, path: Path, result: Path, out: int) -> int:
        # -P: what lies in the working folder is no module.  A compiler would have no limits.
        command = [sys.executable, "-P", "-m", __name__, str(path), str(result)]
        threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
        with self._lock:
            if self._closed:
                raise InputError(f"{path}: nothing is read any more")
            process = self._process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=out,
                stderr=subprocess.DEVNULL,
                env=os.environ | threads | {"NOSLIP_COMPILE": "0"},
            )
        # While its input is open, the other process knows that this one lives.
        with process:
            try:
                return process.wait(SECONDS)
            except subprocess.TimeoutExpired:
                raise InputError(f"{path}: takes more than {SECONDS} s to be read") from None
            finally:
                process.kill()


def _is_primitive(path: Path) -> bool:
    return path.suffix.lower() == ".json"


# ---------------------------------------------------------------- in the other process


def _main(path: Path, result: Path) -> int:
    threading.Thread(target=_end_with_parent, daemon=True).start()
    _limit()
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always", RecordingWarning)
        try:
            _translate(path, result)
        except NoslipError as error:
            print(error)
            return _REFUSED
        except MemoryError:
            return _NO_MEMORY
        except Exception as error:
            print(one_line(f"{path}: cannot be read: {type(error).__name__}: {error}")[:2000])
            return _REFUSED
    for warning in warned:
        if issubclass(warning.category, RecordingWarning):
            print(warning.message)
    return 0


def _translate(path: Path, result: Path) -> None:
    if _is_primitive(path):
        primitive = load_primitive(path)
        # Whoever shows it does so too: within the limits, it is seen to end.
        primitive.rollout(), primitive.regular.rollout()
        primitive.save(result)
        return
    found = load_demonstrations(path)
    if len(found) != 1:
        raise InputError(f"{path}: holds {len(found)} recordings; give them one by one")
    found[0].to_npz(result)


def _end_with_parent() -> None:
    sys.stdin.buffer.read()
    os._exit(1)


def _limit() -> None:
    """Limit this process, where the system can."""
    if resource is None:
        return
    limits = {"AS": MEMORY, "CPU": SECONDS, "FSIZE": MOST_RESULT, "CORE": 0}
    for name, most in limits.items():
        what = getattr(resource, f"RLIMIT_{name}")
        _, hard = resource.getrlimit(what)
        least = most if hard == resource.RLIM_INFINITY else min(most, hard)
        resource.setrlimit(what, (least, hard))


if __name__ == "__main__":
    # Without what ends threads and libraries in order: nobody needs them.
    code = _main(Path(sys.argv[1]), Path(sys.argv[2]))
    sys.stdout.flush()
    os._exit(code)
