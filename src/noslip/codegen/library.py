"""C compiled to machine code, where there is a compiler; kept in the user's cache folder.

Everything works without: CasADi's virtual machine runs the same graphs, operation by operation, so
that rollouts are the same to the bit.  What is compiled is keyed by its content, the compiler and
the flags; several processes may build at once, and what is broken is built again.
``NOSLIP_COMPILE=0`` turns it off; ``CC`` and ``NOSLIP_CACHE`` name another compiler and folder.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import platform
import shlex
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Generic, TypeVar

import casadi as ca

from noslip._files import scratch, write_beside
from noslip.codegen import c99
from noslip.errors import NoslipError
from noslip.space import POSE, Space

T = TypeVar("T")

FLAGS = ("-std=c99", "-O2", "-fPIC", "-shared", "-ffp-contract=off", "-fno-math-errno")
"""No contraction: a fused multiplication and addition would round otherwise than two operations."""
_LONGEST = 300.0
"""Seconds after which a compiler is given up."""


@dataclass(frozen=True)
class Compiler:
    """A C compiler.

    Attributes
    ----------
    command : tuple of str
    version : str
        What it says of itself, first line.
    """

    command: tuple[str, ...]
    version: str


@lru_cache(maxsize=4)
def _compiler(named: str) -> Compiler | None:
    command = shlex.split(named)
    path = shutil.which(command[0]) if command else None
    if path is None:
        return None
    try:
        answer = subprocess.run(
            [path, *command[1:], "--version"],
            capture_output=True,
            text=True,
            timeout=10,
            check=False,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    lines = answer.stdout.splitlines()
    return Compiler((path, *command[1:]), lines[0] if lines else path)


def wanted() -> bool:
    """Whether compiling is allowed (``NOSLIP_COMPILE``)."""
    return os.environ.get("NOSLIP_COMPILE", "1").lower() not in ("0", "no", "off", "false")


def compiler_name() -> str:
    """Name of the C compiler that is looked for: ``CC``, or cc."""
    return os.environ.get("CC") or "cc"


def compiler() -> Compiler | None:
    """Return the C compiler, or None if there is none."""
    return _compiler(compiler_name())


def cache_folder() -> Path:
    """Where what is compiled is kept."""
    if named := os.environ.get("NOSLIP_CACHE"):
        return Path(named)
    try:
        if sys.platform == "darwin":
            return Path.home() / "Library" / "Caches" / "noslip"
        return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "noslip"
    except RuntimeError:
        # A shared temporary folder would let others give us machine code to run.
        raise OSError("no home folder; name one for the cache in NOSLIP_CACHE") from None


class Native(Generic[T]):
    """Code on its way to machine code.

    Parameters
    ----------
    load : callable
        Finds it in the cache or builds it, and opens it.

    Attributes
    ----------
    library : T or None
        Once it is there, and while compiling is allowed.
    failure : str
        Why it is not, if compiling failed.
    """

    def __init__(self, load: Callable[[], T]) -> None:
        self._library: T | None = None
        self.failure = ""
        self._load = load
        self._thread: threading.Thread | None = None
        self._starting = threading.Lock()

    @property
    def library(self) -> T | None:
        # One is shared by all primitives under the same rule, whoever had it compiled.
        return self._library if wanted() else None

    def begin(self) -> None:
        """Compile in the background."""
        with self._starting:
            if self._thread is None and wanted() and compiler() is not None:
                # Not waited for at exit: what it writes appears whole or not at all.
                self._thread = threading.Thread(target=self._build, daemon=True)
                self._thread.start()

    def wait(self) -> T | None:
        """Compile if need be and wait; the machine code, or None without a compiler."""
        self.begin()
        if self._thread is not None:
            self._thread.join()
        return self.library

    def _build(self) -> None:
        try:
            self._library = self._load()
        except (OSError, subprocess.SubprocessError, AttributeError, NoslipError) as error:
            self.failure = str(error)


def built(name: str, texts: dict[str, str], *options: str) -> Path:
    """Machine code of C texts, from the cache or built anew.

    Parameters
    ----------
    name : str
        Of the file in the cache, before what tells it from others.
    texts : dict of str
        By file name.
    options : str
        Of the compiler, besides :data:`FLAGS`.
    """
    found = compiler()
    if found is None:
        raise OSError(f"no C compiler ({compiler_name()})")
    flags = (*FLAGS, *options)
    parts = [*texts.values(), *found.command, found.version, *flags, platform.machine()]
    key = hashlib.sha256("\0".join(parts).encode()).hexdigest()
    library = cache_folder() / f"{name}-{key[:32]}.so"
    if not _whole(library):
        content = _compiled(texts, found, flags)
        write_beside(library, content)
        write_beside(_sum(library), _digest(content))
    return library


def _digest(content: bytes) -> bytes:
    return hashlib.sha256(content).hexdigest().encode()


def _sum(library: Path) -> Path:
    return library.with_suffix(".sha256")


def _whole(library: Path) -> bool:
    """Whether a library is there and is what was written."""
    try:
        return _digest(library.read_bytes()) == _sum(library).read_bytes()
    except OSError:
        return False


def _compiled(texts: dict[str, str], found: Compiler, flags: Sequence[str]) -> bytes:
    with scratch() as folder:
        for name, text in texts.items():
            (folder / name).write_text(text, encoding="utf-8")
        sources = [name for name in texts if name.endswith(".c")]
        done = subprocess.run(
            [*found.command, *flags, *sources, "-lm", "-o", "built.so"],
            cwd=folder,
            capture_output=True,
            text=True,
            timeout=_LONGEST,
            check=False,
        )
        if done.returncode != 0:
            lines = [line for line in done.stderr.splitlines() if "error" in line]
            raise OSError(f"{found.command[0]}: {lines[0] if lines else 'failed'}")
        return (folder / "built.so").read_bytes()


def function(
    code: ctypes.CDLL, name: str, *arguments: Any, result: Any = None
) -> Callable[..., Any]:
    """A function of machine code, by its name and the types of its arguments and result."""
    found = code[name]
    found.argtypes, found.restype = arguments, result
    return found


@dataclass(frozen=True)
class Library:
    """Machine code of a step function; see ``noslip.h`` and ``many.c``.

    Attributes
    ----------
    path : Path
    run, step, drives, rollouts : callable
        ``noslip_run`` and so on, of addresses and counts.
    sizes : tuple of 2 int
        Bytes of ``noslip_primitive`` and ``noslip_state``.
    """

    path: Path
    run: Callable[..., None]
    step: Callable[..., int]
    drives: Callable[..., None]
    rollouts: Callable[..., None]
    sizes: tuple[int, int]

    @classmethod
    def of(cls, step_function: ca.Function, rows: int, space: Space = POSE) -> Library:
        """That of a step function with so many rows of constraints, in a space."""
        texts = {
            "noslip.h": c99.header(rows, 0, space=space),
            "inside.h": c99.template("inside.h"),
            "noslip.c": "\n".join(
                [c99.source(step_function, rows, space=space), c99.template("many.c")]
            ),
            **c99.grids(step_function),
        }
        path = built("step", texts)
        code, pointer, count = ctypes.CDLL(str(path)), ctypes.c_void_p, ctypes.c_longlong
        sizes = (count * 2)()
        function(code, "noslip_sizes", pointer)(ctypes.addressof(sizes))
        return cls(
            path=path,
            run=function(code, "noslip_run", *[pointer] * 4, count),
            # It is over before another thread could have taken its turn.
            step=function(
                ctypes.PyDLL(str(path)),
                "noslip_step",
                *[pointer] * 2,
                ctypes.c_double,
                result=ctypes.c_int,
            ),
            drives=function(code, "noslip_drives", pointer, count, *[pointer] * 2),
            rollouts=function(code, "noslip_rollouts", *[pointer] * 4, *[count] * 2, pointer),
            sizes=(sizes[0], sizes[1]),
        )
