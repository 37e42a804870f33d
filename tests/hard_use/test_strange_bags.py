"""Bags from strangers: no memory that a file only claims, no end without end, nothing elsewhere."""

from __future__ import annotations

import bz2
import os
import sqlite3
import struct
import threading
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import refusals
from motions import cut
from noslip import load_demonstrations
from noslip.errors import RecordingError
from noslip.recordings import _bag_files, write_bag

pytest.importorskip("rosbags", reason="needs the extra bags")

from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

LARGE = 300_000_000
"""Bytes of zeros that a bomb of a few hundred kilobytes unpacks to."""


def zstd(data: bytes) -> bytes:
    import importlib

    return bytes(importlib.import_module(_bag_files._ZSTD).compress(data))


def lz4(data: bytes) -> bytes:
    import lz4.frame

    return bytes(lz4.frame.compress(data))


def refusal(path: Path, most: int = 20_000_000) -> str:
    """Return the refusal of a bag, for which at most so many bytes were taken."""
    tracemalloc.start()
    try:
        message = refusals.refusal(RecordingError, load_demonstrations, path)
        assert tracemalloc.get_traced_memory()[1] < most
    finally:
        tracemalloc.stop()
    assert message.startswith(f"{path}") and message.isprintable() and len(message) < 1000
    return message


def record(op: int, body: bytes) -> bytes:
    return struct.pack("<BQ", op, len(body)) + body


def text(of: str) -> bytes:
    return struct.pack("<I", len(of)) + of.encode()


def mcap_chunk(kind: str, packed: bytes, says: int) -> bytes:
    body = struct.pack("<QQQI", 0, 1, says, 0) + text(kind) + struct.pack("<Q", len(packed))
    return b"\x89MCAP0\r\n" + record(6, body + packed)


def ros1_fields(**fields: bytes) -> bytes:
    return b"".join(
        struct.pack("<I", len(key) + 1 + len(value)) + key.encode() + b"=" + value
        for key, value in fields.items()
    )


def ros1_chunk(kind: str, packed: bytes, says: int) -> bytes:
    header = ros1_fields(op=b"\x05", compression=kind.encode(), size=struct.pack("<I", says))
    lengths = struct.pack("<I", len(header)), struct.pack("<I", len(packed))
    return b"#ROSBAG V2.0\n" + lengths[0] + header + lengths[1] + packed


@pytest.mark.parametrize("says", [0, 1000, LARGE, 2**32 - 1])
@pytest.mark.parametrize(
    ("suffix", "chunk", "kind", "pack"),
    [
        (".mcap", mcap_chunk, "zstd", zstd),
        (".mcap", mcap_chunk, "lz4", lz4),
        (".bag", ros1_chunk, "lz4", lz4),
        (".bag", ros1_chunk, "bz2", bz2.compress),
    ],
)
def test_chunks_that_hold_more_than_they_say(
    tmp_path: Path,
    suffix: str,
    chunk: Callable[..., bytes],
    kind: str,
    pack: Callable[[bytes], bytes],
    says: int,
) -> None:
    bomb = tmp_path / f"bomb{suffix}"
    bomb.write_bytes(chunk(kind, pack(bytes(LARGE // 10)), says))
    message = refusal(bomb)
    assert "a chunk does not hold the" in message or "a chunk says that it holds" in message


def test_chunks_of_millions_of_records(tmp_path: Path) -> None:
    """Ten kilobytes that declare a channel two million times; and a megabyte a thousand times."""
    declared = record(4, struct.pack("<HH", 0, 0) + text("/t") + text("cdr") + text(""))
    bomb = tmp_path / "records.mcap"
    chunk = declared * 2_000_000
    bomb.write_bytes(mcap_chunk("zstd", zstd(chunk), len(chunk)))
    assert "unpacks to more than a recording of its size holds" in refusals.refusal(
        RecordingError, load_demonstrations, bomb
    )
    message = declared + record(5, struct.pack("<HIQQ", 0, 0, 0, 0) + bytes(10**8))
    one = mcap_chunk("zstd", zstd(message), len(message))
    bomb.write_bytes(one + one.removeprefix(b"\x89MCAP0\r\n") * 30)
    assert "unpacks to more than a recording of its size holds" in refusal(bomb, 4 * len(message))


@pytest.mark.parametrize("size", [2**30, 2**62])
def test_records_that_claim_to_be_huge(tmp_path: Path, size: int) -> None:
    for op in (3, 4, 5, 6):
        path = tmp_path / f"{op}.mcap"
        path.write_bytes(b"\x89MCAP0\r\n" + struct.pack("<BQ", op, size))
        assert "a record says that it holds" in refusal(path)


@pytest.mark.filterwarnings("ignore:.*was not closed")
def test_chunks_within_chunks_and_records_without_end(tmp_path: Path) -> None:
    nested = record(6, b"\0" * 40)
    path = tmp_path / "nested.mcap"
    path.write_bytes(mcap_chunk("", nested, len(nested)))
    assert "a chunk holds what is no message" in refusal(path)
    path = tmp_path / "nested.bag"
    path.write_bytes(ros1_chunk("none", bytes(64), 64))
    refusal(path)


def compressed(folder: Path, mode: CompressionMode) -> Path:
    """Write a ROS 2 bag that is compressed, by message or as a file."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    writer = Writer(folder, version=9, storage_plugin=StoragePlugin.SQLITE3)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection(
            "/tool", "geometry_msgs/msg/PoseStamped", typestore=store
        )
        writer.write(connection, 1, bytes(100))
    return folder


def test_messages_that_unpack_to_too_much(tmp_path: Path) -> None:
    bag = compressed(tmp_path / "bag", CompressionMode.MESSAGE)
    with sqlite3.connect(bag / "bag.db3") as database:
        database.execute("UPDATE messages SET data = ?", (zstd(bytes(LARGE)),))
    database.close()
    assert "a chunk says that it holds 300,000,000 bytes" in refusal(bag)


def test_files_that_unpack_to_too_much(tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.setattr(_bag_files, "MOST_UNPACKED", LARGE // 10)
    bag = compressed(tmp_path / "bag", CompressionMode.FILE)
    (bag / "bag.db3.zstd").write_bytes(zstd(bytes(LARGE)))
    assert "holds over 30,000,000 bytes; unpack it with 'zstd -d'" in refusal(bag)


COUNTING = "WITH RECURSIVE c(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM c) "


@pytest.mark.parametrize(
    "change",
    [
        "ALTER TABLE messages RENAME TO m; CREATE VIEW messages AS "
        + COUNTING
        + "SELECT i AS id, 1 AS topic_id, i AS timestamp, x'00' AS data FROM c",
        "ALTER TABLE topics RENAME TO t; CREATE VIEW topics AS "
        + COUNTING
        + "SELECT i AS id, 'a' AS name, 'b' AS type, 'cdr' AS serialization_format FROM c",
        "DROP TABLE messages; CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp, "
        "data AS (zeroblob(200000000))); INSERT INTO messages VALUES (1, 1, 1)",
        "DROP TABLE messages; CREATE VIRTUAL TABLE messages USING fts5(topic_id, timestamp, data)",
    ],
    ids=["messages", "topics", "computed", "virtual"],
)
def test_databases_that_compute_without_end(tmp_path: Path, change: str) -> None:
    """A view may count for ever; were it read, a timer would end this test."""
    bag = write_bag(tmp_path / "bag", poses=cut())
    database = sqlite3.connect(bag / "bag.db3")
    try:
        database.executescript(change)
    except sqlite3.OperationalError as error:
        pytest.skip(f"this SQLite has no such table: {error}")
    finally:
        database.close()
    assert "is no plain table, but computed" in refusal(bag)


def test_a_database_has_a_budget(tmp_path: Path) -> None:
    """What is read of plain tables of a damaged file ends as well."""
    bag = write_bag(tmp_path / "bag", poses=cut())
    with (
        _bag_files._database(bag / "bag.db3", False) as database,
        pytest.raises(sqlite3.OperationalError, match="interrupted"),
    ):
        database.execute(COUNTING + "SELECT count(*) FROM c").fetchall()


@pytest.mark.parametrize("name", ["../bag/bag.db3", "/etc/passwd", "a/b/bag.db3", ".."])
def test_metadata_that_leads_out(tmp_path: Path, name: str) -> None:
    bag = write_bag(tmp_path / "bag", poses=cut())
    said = bag / "metadata.yaml"
    said.write_text(said.read_text().replace("bag.db3", name))
    assert "outside of the bag" in refusal(bag)


@pytest.mark.parametrize("content", ["[" * 50_000, "- " * 50_000, " " * (1 << 22) + "a: 1", None])
def test_metadata_that_grows(tmp_path: Path, content: str | None) -> None:
    """The last names ten lists of ten lists of ... by reference: printed, it has no end."""
    bag = write_bag(tmp_path / "bag", poses=cut())
    if content is None:
        lists = ["a0: &a0 [x]"]
        lists += [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 10)}]" for k in range(1, 20)]
        content = "\n".join(
            [*lists, "rosbag2_bagfile_information:", "  relative_file_paths: [*a19]"]
        )
    (bag / "metadata.yaml").write_text(content)
    refusal(bag, 60_000_000)


@pytest.mark.skipif(not hasattr(os, "symlink"), reason="no links here")
@pytest.mark.parametrize("name", ["bag.db3", "bag.db3-wal", "metadata.yaml"])
def test_links_that_lead_out(tmp_path: Path, name: str) -> None:
    bag = write_bag(tmp_path / "bag", poses=cut())
    elsewhere = tmp_path / "elsewhere"
    if (bag / name).exists():
        (bag / name).rename(elsewhere)
    else:
        elsewhere.write_bytes(b"private")
    (bag / name).symlink_to(elsewhere)
    message = refusals.refusal(RecordingError, load_demonstrations, bag)
    assert "out of the bag" in message


# -------------------------------------------------------------------- writing


def test_what_is_written_follows_links_and_goes_through_pipes(tmp_path: Path) -> None:
    real = tmp_path / "real.mcap"
    real.write_bytes(b"")
    link = tmp_path / "link.mcap"
    link.symlink_to(real)
    write_bag(link, poses=cut())
    assert link.is_symlink() and real.read_bytes().startswith(b"\x89MCAP0\r\n")
    pipe = tmp_path / "pipe.mcap"
    os.mkfifo(pipe)
    got: list[bytes] = []
    reader = threading.Thread(target=lambda: got.append(pipe.read_bytes()))
    reader.start()
    write_bag(pipe, poses=cut())
    reader.join()
    assert pipe.is_fifo()
    real.write_bytes(got[0])
    assert len(load_demonstrations(link)[0]) == len(cut())
    assert sorted(file.name for file in tmp_path.iterdir()) == [
        "link.mcap",
        "pipe.mcap",
        "real.mcap",
    ]
