"""Reading files in the same words everywhere; writing so that no reader ever sees half of one."""

from __future__ import annotations

import codecs
import os
import tempfile
from pathlib import Path

from noslip.errors import InputError, RecordingError


def write_beside(path: str | Path, content: bytes) -> Path:
    """Write a file beside its place, then rename it there; return its path.

    Missing folders are made.  An interrupted write leaves what was there before.
    """
    target = Path(path)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        handle, beside = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.")
    except OSError as error:
        raise InputError(f"{target}: cannot be written: {error.strerror}") from error
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
        # mkstemp makes the file private; a result gets what a new file gets here.
        mask = os.umask(0)
        os.umask(mask)
        Path(beside).chmod(0o666 & ~mask)
        Path(beside).replace(target)
    except OSError as error:
        Path(beside).unlink(missing_ok=True)
        raise InputError(f"{target}: cannot be written: {error.strerror}") from error
    except BaseException:
        Path(beside).unlink(missing_ok=True)
        raise
    return target


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
    """Return what a file of UTF-8 text holds, a byte order mark apart, still encoded."""
    content = read_bytes(path).removeprefix(codecs.BOM_UTF8)
    try:
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
