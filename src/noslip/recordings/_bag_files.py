"""The kinds of file that bags are kept in, each read from its beginning to its end.

No index is needed, so what a recorder that was killed has left is read as well; one chunk is in
memory at a time.

References
----------
http://wiki.ros.org/Bags/Format/2.0; https://mcap.dev/spec; tables of rosbag2_storage_sqlite3.
"""

from __future__ import annotations

import bz2
import re
import shutil
import sqlite3
import struct
import sys
import zlib
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any, BinaryIO

from noslip._extras import need
from noslip._files import scratch
from noslip.errors import RecordingError

METADATA = "metadata.yaml"
"""What the folder of every ROS 2 bag has, and is known by."""
MOST_BYTES = 1 << 27
"""Of a record or a chunk: recorders cut chunks at a megabyte or a few, and no message of a sensor
comes near an eighth of a gigabyte; what says that it is larger is damaged, or means to fill the
memory.  Up to four times as much is taken: packed, unpacked, and two messages."""
MOST_UNPACKED = 1 << 34
"""Of a compressed SQLite file, which must be unpacked to the disk; 16 GB, hours of a robot."""
_MOST_METADATA = 1 << 22
"""Bytes; thousands of topics and files, for which YAML takes some ten seconds a megabyte."""
_MOST_BRACKETS = 5000
"""In it: one or two a topic, while YAML takes hours for a megabyte of them within one another."""
_BLOCK = 1 << 20
_STEPS_A_BYTE = 100
"""Of SQLite's machine for each byte of the file: a row takes some 30 steps and at least 10 bytes,
so what needs more does not end."""
_ZSTD = "compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd"
"""Standard Python's from 3.14 on; rosbags brings its copy for those before."""


@dataclass(frozen=True)
class Channel:
    """What a publisher sends on a topic.

    Attributes
    ----------
    topic : str
    type : str
        As ROS 2 writes it in full, such as ``geometry_msgs/msg/PoseStamped``.
    encoding : str
        Of its messages: ``cdr`` (ROS 2), ``ros1``, or what is not read, such as ``json``.
    definition : str
        Of its messages; empty where the file has none.
    idl : bool
        Whether that is written in IDL.
    publisher : str
        The node's name (ROS 1), or which channel of the topic it is, from 1.
    """

    topic: str
    type: str
    encoding: str
    definition: str = ""
    idl: bool = False
    publisher: str = "1"


Buffer = bytes | memoryview
Record = tuple[Channel, int, bytes | None]
"""Channel, time of receipt (ns) and message; None where the file only declares the channel."""
Note = Callable[[str], None]
"""Told of what is missing at a file's end."""


class _TornError(Exception):
    """The file ends within a record."""


class _Budget:
    """What a file may hold: a record for each of its bytes, and a thousand times its size.

    No recording comes near, whose stamps differ; a few kilobytes that unpack to hours of work do.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.left = path, 10**6 + path.stat().st_size

    def spend(self, size: int) -> None:
        """Count a record."""
        self.left -= 1 + size // 1000
        if self.left < 0:
            raise RecordingError(
                f"{self.path}: unpacks to more than a recording of its size holds; is it damaged?"
            )


def records(path: Path, note: Note) -> Iterator[Record]:
    """Yield what is in a bag, in the order in which it was written.

    Raises
    ------
    InputError
        If the file is of another kind, a chunk or record is larger than it may be, or a folder
        leads out of itself.
    """
    if not path.is_dir():
        yield from _file(path, note, None)
        return
    if not (path / METADATA).exists() and (left := unfinished(path)):
        note(
            f"{path}: has no {METADATA}, as if the recorder had been killed; what is whole is "
            "read, 'ros2 bag reindex' mends it"
        )
        for file in left:
            yield from _file(_within(path, file.name), note, None)
        return
    said = _metadata(path)
    by_message = said["compression"] if said["mode"] == "message" else None
    for file in said["files"]:
        yield from _file(file, note, by_message)


def unfinished(folder: Path) -> list[Path]:
    """Return the files that a killed recorder left, in order: they are named after the folder."""
    pattern = re.compile(rf"{re.escape(folder.resolve().name)}_(\d+)\.(db3|mcap)")
    found = [
        (match, file) for file in folder.glob("*_*") if (match := pattern.fullmatch(file.name))
    ]
    return [file for _, file in sorted(found, key=lambda each: int(each[0][1]))]


def _metadata(folder: Path) -> dict[str, Any]:
    """Return the files of a ROS 2 bag, and how they are compressed."""
    yaml = need(folder, "ruamel.yaml", "bags").YAML(typ="safe", pure=True)
    text = _within(folder, METADATA).read_bytes()
    if len(text) > _MOST_METADATA or text.count(b"[") + text.count(b"{") > _MOST_BRACKETS:
        raise RecordingError(f"{folder}: {METADATA} is too large; give the bag's files one by one")
    found = yaml.load(text.decode())["rosbag2_bagfile_information"]
    files = [_within(folder, name) for name in found["relative_file_paths"]]
    mode = (found.get("compression_mode") or "none").lower()
    compression = found.get("compression_format") or ""
    if mode not in ("none", "file", "message") or (mode != "none" and compression != "zstd"):
        raise RecordingError(
            f"{folder}: compressed by {mode} with {compression or 'what it does not say'}; only "
            "zstd by file or message is read"
        )
    return {"files": files, "mode": mode, "compression": compression}


def _within(folder: Path, name: str) -> Path:
    """Return a file of a bag; the oldest name it with the folder in front."""
    parts = PurePosixPath(name.replace("\\", "/"))
    file = folder / parts.name
    if parts.is_absolute() or ".." in parts.parts or len(parts.parts) > 2 or not parts.name:
        raise RecordingError(f"{folder}: {METADATA} names {name!r}, outside of the bag; correct it")
    if not file.exists():
        raise RecordingError(f"{folder}: {file.name} is missing; copy the whole folder")
    if file.resolve().parent != folder.resolve():
        raise RecordingError(f"{folder}: {file.name} leads out of the bag; copy the file itself")
    return file


def _file(path: Path, note: Note, by_message: str | None) -> Iterator[Record]:
    name, whole = path, path.suffix.lower() == ".zstd"
    if whole or path.suffix.lower() == ".active":
        name = path.with_suffix("")
    kind = name.suffix.lower()
    budget = _Budget(path)
    with ExitStack() as stack:
        if kind == ".db3":
            found = _sqlite(stack.enter_context(_database(path, whole)), path)
        elif kind in (".bag", ".mcap"):
            opened = need(path, _ZSTD, "bags").open(path) if whole else path.open("rb")
            file = stack.enter_context(opened)
            mending = "rosbag reindex" if kind == ".bag" else "mcap recover"
            torn = partial(_tell_torn, note, path, mending)
            found = (_ros1 if kind == ".bag" else _mcap)(file, budget, torn)
        else:
            raise RecordingError(f"{path}: {kind} is no file of a bag; known are .bag, .db3, .mcap")
        for channel, received, data in found:
            if by_message and data is not None:
                size = need(path, _ZSTD, "bags").get_frame_info(data).decompressed_size
                size = MOST_BYTES + 1 if size is None else size
                budget.spend(size)
                data = _unpacked(path, by_message, data, size)
            yield channel, received, data


def _tell_torn(note: Note, path: Path, mending: str) -> None:
    note(
        f"{path}: was not closed, as if the recorder had been killed; what is whole is read, "
        f"'{mending}' mends it"
    )


def _require_size(path: Path, what: str, size: int) -> None:
    if size > MOST_BYTES:
        raise RecordingError(
            f"{path}: {what} says that it holds {size:,} bytes, at most {MOST_BYTES:,} are read; "
            "is the file damaged?"
        )


def _take(file: BinaryIO, size: int, path: Path) -> bytes:
    """Return the next bytes of a file."""
    _require_size(path, "a record", size)
    data = file.read(size)
    if len(data) < size:
        raise _TornError
    return data


def _skip(file: BinaryIO, size: int) -> None:
    while size:
        data = file.read(min(size, _BLOCK))
        if not data:
            raise _TornError
        size -= len(data)


def _unpacked(path: Path, kind: str, data: bytes, size: int) -> bytes:
    """Return what a chunk holds, decompressed: as much as it says, and no more."""
    _require_size(path, "a chunk", size)
    match kind:
        case "" | "none":
            found = data
        case "bz2":
            found = bz2.BZ2Decompressor().decompress(data, size + 1)
        case "lz4":
            lz4 = need(path, "lz4.frame", "bags")
            found = lz4.LZ4FrameDecompressor().decompress(data, max_length=size + 1)
        case "zstd":
            found = need(path, _ZSTD, "bags").ZstdDecompressor().decompress(data, size + 1)
        case _:
            raise RecordingError(f"{path}: compressed as {kind!r}; known are bz2, lz4 and zstd")
    if len(found) != size:
        raise RecordingError(f"{path}: a chunk does not hold the {size:,} bytes that it says")
    return found


def _full(kind: str) -> str:
    """Return a type's name in full, which ROS 1 and some writers shorten."""
    package, slash, name = kind.partition("/")
    return f"{package}/msg/{name}" if slash and "/" not in name else kind


def _place(channels: dict[int, Channel], topic: str) -> str:
    """Return what to call a publisher that has no name: its place on the topic."""
    return str(1 + sum(channel.topic == topic for channel in channels.values()))


# ------------------------------------------------------------------------------- ROS 1


def _ros1(file: BinaryIO, budget: _Budget, torn: Callable[[], None]) -> Iterator[Record]:
    path = budget.path
    if file.readline(32) != b"#ROSBAG V2.0\n":
        raise RecordingError(f"{path}: not a ROS bag of version 2.0; rosbag's fixbag converts it")
    channels: dict[int, Channel] = {}
    closed = True
    try:
        while length := file.read(4):
            header = _fields(_take(file, _u32(length), path))
            size = _u32(_take(file, 4, path))
            match header[b"op"][0]:
                case 2 | 7:
                    yield _ros1_record(channels, header, _take(file, size, path))
                case 3:
                    closed = header[b"index_pos"] != bytes(8)
                    _skip(file, size)
                case 5:
                    kind = header[b"compression"].decode()
                    # A recorder that was killed had not filled in the size of the last chunk.
                    if size or _u32(header[b"size"]):
                        chunk = _take(file, size, path)
                        chunk = _unpacked(path, kind, chunk, _u32(header[b"size"]))
                        yield from _ros1_chunk(channels, chunk, budget)
                case _:
                    _skip(file, size)
    except _TornError:
        closed = False
    if not closed:
        torn()


def _ros1_chunk(channels: dict[int, Channel], chunk: bytes, budget: _Budget) -> Iterator[Record]:
    at = 0
    while at < len(chunk):
        begin = at + 4 + _u32(chunk, at)
        end = begin + 4 + _u32(chunk, begin)
        header = _fields(chunk[at + 4 : begin])
        if end > len(chunk) or header[b"op"][0] not in (2, 7):
            raise ValueError("a chunk holds what is no message")
        budget.spend(end - at)
        yield _ros1_record(channels, header, chunk[begin + 4 : end])
        at = end


def _ros1_record(channels: dict[int, Channel], header: dict[bytes, bytes], data: bytes) -> Record:
    number = _u32(header[b"conn"])
    if header[b"op"][0] == 2:
        seconds, rest = struct.unpack("<II", header[b"time"])
        return channels[number], seconds * 10**9 + rest, data
    if number not in channels:  # every chunk, and the index, declare them again
        said = {key: value.decode(errors="replace") for key, value in _fields(data).items()}
        topic = header[b"topic"].decode()
        channels[number] = Channel(
            topic,
            _full(said[b"type"]),
            "ros1",
            said[b"message_definition"],
            publisher=said.get(b"callerid") or _place(channels, topic),
        )
    return channels[number], 0, None


def _fields(data: bytes) -> dict[bytes, bytes]:
    """Return the fields of a header, each with its length in front."""
    found, at = {}, 0
    while at < len(data):
        end = at + 4 + _u32(data, at)
        key, equals, value = data[at + 4 : end].partition(b"=")
        if not equals or end > len(data):
            raise ValueError("a header is damaged")
        found[key], at = value, end
    return found


def _u32(data: Buffer, at: int = 0) -> int:
    return int(struct.unpack_from("<I", data, at)[0])


# ------------------------------------------------------------------------------- MCAP

_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _FOOTER, _DATA_END = 3, 4, 5, 6, 2, 15


def _mcap(file: BinaryIO, budget: _Budget, torn: Callable[[], None]) -> Iterator[Record]:
    path = budget.path
    if file.read(8) != b"\x89MCAP0\r\n":
        raise RecordingError(f"{path}: not an MCAP file; check the path")
    found = _Mcap()
    try:
        while True:
            kind, size = struct.unpack("<BQ", _take(file, 9, path))
            if kind in (_DATA_END, _FOOTER):
                return  # an index follows, which repeats what was there
            if kind == _CHUNK:
                yield from found.chunk(_take(file, size, path), budget)
            elif kind in (_SCHEMA, _CHANNEL, _MESSAGE):
                yield from found.record(kind, _take(file, size, path))
            else:
                _skip(file, size)
    except _TornError:
        torn()


class _Mcap:
    def __init__(self) -> None:
        self.schemas: dict[int, tuple[str, str, str]] = {0: ("", "", "")}
        self.channels: dict[int, Channel] = {}

    def chunk(self, data: bytes, budget: _Budget) -> Iterator[Record]:
        size, checksum = struct.unpack_from("<QI", data, 16)
        kind, at = _text(data, 28)
        (length,) = struct.unpack_from("<Q", data, at)
        records = data[at + 8 : at + 8 + length]
        chunk = memoryview(_unpacked(budget.path, kind, records, size))
        if checksum and zlib.crc32(chunk) != checksum:
            raise ValueError("the checksum of a chunk is wrong")
        at = 0
        while at < len(chunk):
            op, length = struct.unpack_from("<BQ", chunk, at)
            begin, at = at + 9, at + 9 + length
            if op not in (_SCHEMA, _CHANNEL, _MESSAGE) or at > len(chunk):
                raise ValueError("a chunk holds what is no message")
            budget.spend(length)
            yield from self.record(op, chunk[begin:at])

    def record(self, op: int, data: Buffer) -> Iterator[Record]:
        if op == _MESSAGE:
            number, _, received, _ = struct.unpack_from("<HIQQ", data)
            yield self.channels[number], received, bytes(data[22:])
        elif op == _SCHEMA:
            (number,) = struct.unpack_from("<H", data)
            name, at = _text(data, 2)
            encoding, at = _text(data, at)
            self.schemas[number] = (name, encoding, _text(data, at)[0])
        else:
            number, schema = struct.unpack_from("<HH", data)
            # Every chunk may declare its channels again.
            if number not in self.channels:
                self.channels[number] = self._channel(data, *self.schemas[schema])
                yield self.channels[number], 0, None

    def _channel(self, data: Buffer, kind: str, written: str, definition: str) -> Channel:
        topic, at = _text(data, 4)
        encoding, at = _text(data, at)
        end = at + 4 + _u32(data, at)
        at += 4
        said: dict[str, str] = {}
        while at < end:
            key, at = _text(data, at)
            said[key], at = _text(data, at)
        encoding = encoding or {"ros1msg": "ros1", "ros2msg": "cdr", "ros2idl": "cdr"}.get(
            written, ""
        )
        return Channel(
            topic,
            _full(kind),
            encoding,
            definition,
            written == "ros2idl",
            said.get("callerid") or _place(self.channels, topic),
        )


def _text(data: Buffer, at: int) -> tuple[str, int]:
    """Return a text with its length in front, and where it ends."""
    end = at + 4 + _u32(data, at)
    if end > len(data):
        raise ValueError("a text is cut off")
    return bytes(data[at + 4 : end]).decode(errors="replace"), end


# ------------------------------------------------------------------------------- SQLite


@contextmanager
def _database(path: Path, whole: bool) -> Iterator[sqlite3.Connection]:
    """Open a database; what SQLite keeps beside the file is put into a copy of it."""
    pending = [path.with_name(path.name + end) for end in ("-wal", "-journal")]
    pending = [file for file in pending if file.is_file() and file.stat().st_size]
    address = f"{path.absolute().as_uri()}?mode=ro&immutable=1"
    with ExitStack() as stack:
        if whole or pending:
            copy = stack.enter_context(scratch()) / "copy.db3"
            opened = need(path, _ZSTD, "bags").open(path) if whole else path.open("rb")
            _copy(stack.enter_context(opened), copy, path)
            for file in pending:
                if file.resolve().parent != path.resolve().parent:
                    raise RecordingError(f"{file}: leads out of the bag; copy the file itself")
                shutil.copyfile(file, f"{copy}{file.name.removeprefix(path.name)}")
            path, address = copy, copy.as_uri()
        database = stack.enter_context(closing(sqlite3.connect(address, uri=True)))
        database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MOST_BYTES)
        budget = iter(range(10 + path.stat().st_size * _STEPS_A_BYTE // _BLOCK))
        database.set_progress_handler(lambda: next(budget, None) is None, _BLOCK)
        yield database


def _copy(source: BinaryIO, target: Path, path: Path) -> None:
    left = MOST_UNPACKED
    with target.open("wb") as file:
        while data := source.read(_BLOCK):
            left -= len(data)
            if left < 0:
                raise RecordingError(
                    f"{path}: holds over {MOST_UNPACKED:,} bytes; unpack it with 'zstd -d'"
                )
            file.write(data)


def _sqlite(database: sqlite3.Connection, path: Path) -> Iterator[Record]:
    _require_tables(database, path)
    definitions: dict[str, tuple[str, bool]] = {}
    if _columns(database, "message_definitions"):
        rows = database.execute(
            "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
        )
        definitions = {kind: (text, encoding == "ros2idl") for kind, encoding, text in rows}
    channels: dict[int, Channel] = {}
    for number, topic, kind, encoding in database.execute(
        "SELECT id, name, type, serialization_format FROM topics ORDER BY id"
    ):
        definition, idl = definitions.get(kind, ("", False))
        channels[number] = Channel(
            topic, _full(kind), encoding, definition, idl, _place(channels, topic)
        )
        yield channels[number], 0, None
    for number, received, data in database.execute(
        "SELECT topic_id, timestamp, data FROM messages ORDER BY rowid"
    ):
        if number in channels:
            yield channels[number], int(received), bytes(data)


def _require_tables(database: sqlite3.Connection, path: Path) -> None:
    """Refuse views and other tables that compute what they hold."""
    known = ("topics", "messages", "message_definitions")
    found = {
        name: (kind, sql or "")
        for kind, name, sql in database.execute("SELECT type, name, sql FROM sqlite_master")
        if name in known
    }
    for name in known[:2]:
        if name not in found:
            raise RecordingError(f"{path}: no table {name}, so no ROS bag; check the path")
    for name, (kind, sql) in found.items():
        if (
            kind != "table"
            or not sql.upper().startswith("CREATE TABLE")
            or any(hidden for *_, hidden in database.execute(f"PRAGMA table_xinfo({name})"))
        ):
            raise RecordingError(
                f"{path}: {name} is no plain table, but computed; record or convert the bag anew"
            )


def _columns(database: sqlite3.Connection, table: str) -> list[Any]:
    return database.execute(f"PRAGMA table_info({table})").fetchall()
