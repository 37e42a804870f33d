"""Reading files in the same words everywhere; writing so that no reader ever sees half of one."""

from __future__ import annotations

import codecs
import errno
import os
import platform
import stat
import tempfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from noslip.errors import InputError, RecordingError

try:
    import fcntl
except ImportError:
    fcntl = None  # type: ignore[assignment]


def write_beside(path: str | Path, content: bytes) -> Path:
    """Write a file beside its place, then rename it there; return its path.

    Missing folders are made.  An interrupted write leaves what was there before.  A link stays, and
    what it leads to is replaced; a file keeps its mode; devices and pipes are written to.
    """
    given = Path(path)
    try:
        target = Path(os.path.realpath(given)) if given.is_symlink() else given
        if target.is_symlink():
            raise OSError(errno.ELOOP, os.strerror(errno.ELOOP))
        mode = target.stat().st_mode if target.exists() else None
        if mode is not None and not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
            target.write_bytes(content)
            return given
        # Root may write what is read-only; who made it so did not mean that.
        if mode is not None and not (mode & 0o222 and os.access(target, os.W_OK)):
            raise InputError(f"{given}: is read-only; make it writable or give another name")
        target.parent.mkdir(parents=True, exist_ok=True)
        with _beside(target) as beside:
            beside.write_bytes(content)
            if mode is None:
                # What stands beside is private; a result gets what a new file gets here.
                mask = os.umask(0)
                os.umask(mask)
                mode = 0o666 & ~mask
            beside.chmod(stat.S_IMODE(mode))
            beside.replace(target)
    except OSError as error:
        raise InputError(f"{given}: cannot be written: {error.strerror or error}") from error
    return given


@contextmanager
def _beside(target: Path) -> Iterator[Path]:
    """Make the file that is to take a place, for this writer alone.

    It has one name a machine, so that what a killed process left there is used again.  Where the
    system has no locks each has a name of its own.
    """
    try:
        path, handle = _own(target)
    except OSError:
        handle, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.")
        os.close(handle)
        path, handle = Path(name), -1
    try:
        yield path
    except BaseException:
        path.unlink(missing_ok=True)
        raise
    finally:
        if handle >= 0:
            os.close(handle)


def _own(target: Path) -> tuple[Path, int]:
    """Open and lock the file beside a place."""
    if fcntl is None:
        raise OSError
    machine = zlib.crc32(platform.node().encode())
    path = target.with_name(f".{target.name}.{machine:08x}")
    while True:
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_NOFOLLOW, 0o600)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX)
            if _leads_to(path, handle):
                return path, handle
        except OSError:
            os.close(handle)
            path.unlink(missing_ok=True)
            raise
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)


def _leads_to(path: Path, handle: int) -> bool:
    """Whether a path is still that of an open file: who had it before may have renamed it."""
    try:
        return os.path.samestat(path.lstat(), os.fstat(handle))
    except FileNotFoundError:
        # The moment between two writers is no fault: what stands there next is another's.
        return False


@contextmanager
def locked(folder: Path, *, wait: bool = True) -> Iterator[None]:
    """Be the only process that writes into a folder.

    The lock is the system's, on the folder itself: a process that was killed holds none, and no
    file is left.  Where the system has none for folders (Windows, some network drives), there is
    none.

    Raises
    ------
    InputError
        If there can be no such folder, or another process holds it and this is not to wait.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle = -1 if fcntl is None else os.open(folder, os.O_RDONLY)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror}") from error
    if fcntl is None:
        yield
        return
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except BlockingIOError:
            raise InputError(
                f"{folder}: another noslip is writing there; wait for it or give another folder"
            ) from None
        except OSError:
            pass
        yield
    finally:
        os.close(handle)


@contextmanager
def renewing(last: Path) -> Iterator[Path]:
    """Write a folder's files anew: what tells of them goes first, and comes last.

    So it never stands beside files that it does not tell of, wherever the writing stops.
    """
    with locked(last.parent, wait=False):
        try:
            last.unlink(missing_ok=True)
        except OSError as error:
            raise InputError(f"{last}: cannot be replaced: {error.strerror}") from error
        yield last


@contextmanager
def making(target: Path) -> Iterator[Path]:
    """Make a file or folder beside its place, where nothing may be, and rename it there.

    Raises
    ------
    InputError
        If something is there, or it cannot be written.
    """
    if target.exists() or target.is_symlink():
        raise InputError(f"{target}: is there already; give another name or remove it")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=target.parent, prefix=f".{target.name}.") as made:
            beside = Path(made) / target.name
            yield beside
            beside.rename(target)
    except OSError as error:
        raise InputError(f"{target}: cannot be written: {error.strerror or error}") from error


@contextmanager
def scratch() -> Iterator[Path]:
    """Make a temporary folder; that it is full is said of it, not of what is made there."""
    made = ""
    try:
        with tempfile.TemporaryDirectory(prefix="noslip-") as made:
            yield Path(made)
    except OSError as error:
        if made and error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        raise InputError(
            f"TMPDIR: the temporary folder cannot be written to ({error.strerror}); free some "
            "space there or name another"
        ) from error


def read_bytes(path: str | Path) -> bytes:
    """Return what a file holds."""
    file = Path(path)
    if file.is_dir():
        raise InputError(f"{path}: a folder, not a file; give {file / '*.csv'}")
    try:
        return file.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; check the path") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error


def read_utf8(path: str | Path) -> bytes:
    """Return what a file of text holds, a byte order mark apart, encoded as UTF-8.

    UTF-16 is known by its byte order mark.
    """
    content = read_bytes(path).removeprefix(codecs.BOM_UTF8)
    try:
        if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
            content = content.decode("utf-16").encode()
        if not content.isascii():
            content.decode()
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise RecordingError(
            f"{path}: line {line}: not UTF-8 text (byte 0x{content[error.start]:02x}); "
            "save it as CSV in UTF-8"
        ) from None
    if b"\0" in content:
        line = content.count(b"\n", 0, content.index(b"\0")) + 1
        raise RecordingError(
            f"{path}: line {line}: binary content, not a CSV; save it as UTF-8 text"
        )
    return content


def read_text(path: str | Path) -> str:
    """Return what a file of UTF-8 text holds, a byte order mark apart."""
    return read_utf8(path).decode()
