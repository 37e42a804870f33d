"""Parquet and Feather tables, with the columns of a CSV."""

from __future__ import annotations

import io
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from noslip._extras import need
from noslip._files import read_bytes, write_beside
from noslip._pose_checks import require_few
from noslip._pose_columns import Asked, layout_of
from noslip._pose_names import Column
from noslip._samples import Samples
from noslip._typing import Floats
from noslip.errors import RecordingError
from noslip.named_columns import plural
from noslip.recordings._format import MAPPING, VELOCITIES, Format
from noslip.recordings._reading import reading
from noslip.recordings.twists import motion_columns
from noslip.series import Series
from noslip.trajectory import PoseTrajectory

FEATHER = b"ARROW1\0\0"
"""How a Feather file begins, before its stream of messages; older ones are not compressed."""
MOST_BYTES = 2**30
"""Of a table's columns when decompressed."""


def read_table(path: Path, **asked: Any) -> list[Samples]:
    """Read the one recording of a Parquet or Feather table.

    Its columns are what those of a CSV are, in any case; of columns that are structures, their
    fields are columns, such as ``pose.position.x``.  Timestamps and durations of Arrow are times.

    Parameters
    ----------
    path : Path
    **asked
        Of :class:`noslip._pose_columns.Asked`.

    Raises
    ------
    MissingDependencyError
        Without pyarrow (``noslip[tables]``).
    InputError
        If it cannot be read, or for what :func:`noslip.load_demonstrations` names.
    """
    table = arrow_table(path)
    with reading(path, "a table"):
        while any(hasattr(kind, "fields") for kind in table.schema.types):
            table = table.flatten()
    held = {name.lower(): name for name in table.column_names}
    columns = columns_of(table)
    available = {key: replace(columns[name], raw=name) for key, name in held.items()}
    layout = layout_of(path, available, Asked(**asked))
    of = {key: numbers(path, table, held[key]) for key in layout.numbers}
    texts = {key: list(map(str, table[held[key]].to_pylist())) for key in layout.texts}
    return [layout.samples(path, available, of, texts)]


def arrow_table(path: Path, columns: Iterable[str] | None = None) -> Any:
    """Return a table, or those of its columns that are asked for, as pyarrow reads it."""
    # Through our own reading, for the same words about files that are not there.
    content = io.BytesIO(read_bytes(path))
    wanted = None if columns is None else list(columns)
    feather = path.suffix.lower() == ".feather"
    reader = need(path, "pyarrow.feather" if feather else "pyarrow.parquet", "tables")
    with reading(path, "a table"):
        if feather and content.getbuffer()[:8] == FEATHER:
            stream = io.BytesIO(content.getbuffer()[len(FEATHER) :])
            _require_size(path, *feather_size(stream))
            table = need(path, "pyarrow.ipc", "tables").open_stream(stream).read_all()
            table = table if wanted is None else table.select(set(wanted) & set(table.column_names))
        else:
            if not feather:
                _require_size(path, *_parquet_size(content.getvalue(), wanted))
            table = reader.read_table(content, columns=wanted)
        # Feather and Parquet may hold lengths that lead out of the file.
        table.validate(full=True)
        names = table.column_names
    if wanted is not None:
        missing = [name for name in wanted if name not in names]
        if missing:
            raise RecordingError(f"{path}: {plural('column', missing)} missing")
    return table


def _require_size(path: Path, rows: int, size: int) -> None:
    require_few(path, rows)
    if size > MOST_BYTES:
        raise RecordingError(
            f"{path}: {size:,} bytes when decompressed, at most {MOST_BYTES:,} are read; leave out "
            "columns, or split it"
        )


def _parquet_size(content: bytes, columns: Collection[str] | None) -> tuple[int, int]:
    """Rows, and bytes when decompressed, that a file says it has in some columns, or in all.

    Read from the footer itself, ``FileMetaData`` of parquet.thrift: asked for a damaged column's
    metadata, pyarrow ends the process.
    """
    if content[-4:] != b"PAR1":
        return 0, 0
    end = len(content) - 8
    footer = _thrift(content[max(0, end - int.from_bytes(content[end : end + 4], "little")) : end])
    size = 0
    for group in footer.get(4, ()):
        for chunk in group.get(1, ()):
            held = chunk.get(3, {})
            if columns is None or held[3][0].decode() in columns:
                # A number takes eight bytes, however well it is encoded.
                size += max(held.get(6, 0), 8 * held.get(5, 0))
    return footer.get(3, 0), size


def _thrift(data: bytes) -> Any:
    """Return a struct in Thrift's compact protocol: values by the number of their field."""
    at = 0

    def varint() -> int:
        nonlocal at
        found = shift = 0
        while True:
            byte = data[at]
            at += 1
            found |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return found

    def whole() -> int:
        found = varint()
        return (found >> 1) ^ -(found & 1)

    def taken(length: int) -> bytes:
        nonlocal at
        at += length
        if at > len(data):
            raise ValueError("its footer ends early")
        return data[at - length : at]

    def value(kind: int) -> Any:
        match kind:
            case 1 | 2 | 3:
                return taken(1)[0]
            case 4 | 5 | 6:
                return whole()
            case 7:
                return taken(8)
            case 8:
                return taken(varint())
            case 9 | 10:
                head = taken(1)[0]
                count = head >> 4 if head < 240 else varint()
                return [value(head & 15) for _ in range(count)]
            case 11:
                count = varint()
                kinds = taken(1)[0] if count else 0
                return [(value(kinds >> 4), value(kinds & 15)) for _ in range(count)]
            case 12:
                return struct()
        raise ValueError(f"its footer holds a value of kind {kind}")

    def struct() -> dict[int, Any]:
        found: dict[int, Any] = {}
        number = 0
        while head := taken(1)[0]:
            number = number + (head >> 4) if head >> 4 else whole()
            kind = head & 15
            # Of a truth value the kind is the value.
            found[number] = kind if kind in (1, 2) else value(kind)
        return found

    return struct()


def feather_size(stream: io.BytesIO) -> tuple[int, int]:
    """Rows, and bytes when decompressed, of the batches in an Arrow stream."""
    ipc = need("a table", "pyarrow.ipc", "tables")
    messages = ipc.MessageReader.open_stream(stream)
    rows = size = 0
    while True:
        try:
            message = messages.read_next_message()
        except StopIteration:
            stream.seek(0)
            return rows, size
        if message.type in ("record batch", "dictionary"):
            body = message.body
            count, buffers = _batch(bytes(message.metadata), message.type)
            rows += count
            for offset, length, compressed in buffers:
                # Compressed ones say first how long they were, or -1.
                said = body[offset : offset + 8] if compressed and length >= 8 else b""
                size += max(length, int.from_bytes(bytes(said), "little", signed=True))


def _batch(metadata: bytes, kind: str) -> tuple[int, list[tuple[int, int, bool]]]:
    """Length and buffers (offset, length, whether compressed) of a batch, from its flatbuffer.

    ``Message.header`` is the table's third field; ``DictionaryBatch.data`` its second;
    ``RecordBatch.length``, ``.buffers`` and ``.compression`` the first, third and fourth (Arrow's
    Message.fbs).
    """

    def number(at: int, size: int, *, signed: bool = False) -> int:
        return int.from_bytes(metadata[at : at + size], "little", signed=signed)

    def field(table: int, index: int) -> int | None:
        vtable = table - number(table, 4, signed=True)
        place = number(vtable + 4 + 2 * index, 2) if 4 + 2 * index < number(vtable, 2) else 0
        return table + place if place else None

    def follow(at: int | None) -> int:
        if at is None:
            raise ValueError("a batch without its parts")
        return at + number(at, 4)

    table = follow(field(follow(0), 2))
    if kind == "dictionary":
        table = follow(field(table, 1))
    length, start = field(table, 0), follow(field(table, 2))
    starts = range(start + 4, start + 4 + 16 * number(start, 4), 16)
    compressed = field(table, 3) is not None
    buffers = [
        (number(at, 8, signed=True), number(at + 8, 8, signed=True), compressed) for at in starts
    ]
    return 0 if length is None else number(length, 8, signed=True), buffers


def columns_of(table: Any) -> dict[str, Column]:
    """Return what the columns of a table are; lists have the length of the first."""
    columns = {}
    for name in table.column_names:
        kind, first = table.schema.field(name).type, table[name][0].as_py() if len(table) else None
        said = str(kind)
        columns[name] = Column(
            width=len(first) if isinstance(first, list) else 1,
            unit="s" if said.startswith(("timestamp", "duration")) else "",
            is_text=said in ("string", "large_string"),
        )
    return columns


def numbers(path: Path, table: Any, name: str) -> Floats:
    """Return a column, shape (N, width); a cell that is empty becomes NaN, which is refused."""
    column = table[name]
    kind = column.type
    values = np.empty(0)
    width = 1
    if hasattr(kind, "value_type") and len(column):  # lists
        lengths = {len(cell) if cell.is_valid else 0 for cell in column}
        width = lengths.pop() if len(lengths) == 1 else 0
        kind = kind.value_type
        flat = [chunk.flatten() for chunk in column.chunks]
        values = np.concatenate([chunk.to_numpy(zero_copy_only=False) for chunk in flat])
    elif len(column):
        values = column.to_numpy()
    if values.dtype.kind in "mM":
        # Whole numbers, since a float holds no nanoseconds since 1970; what is missing is NaN.
        ticks = values.astype(values.dtype.str.partition("[")[0] + "[ns]").astype(np.int64)
        values = np.where(np.isnat(values), np.nan, ticks / 1e9)
    if width == 0 or values.dtype.kind not in "iuf":
        raise RecordingError(
            f"{path}: column {name} ({column.type}) does not hold the same count of numbers in "
            "every row; choose columns of numbers"
        )
    return values.astype(np.float64).reshape(-1, width)


def write_columns(path: Path, table: Any, of: Mapping[str, Floats]) -> Path:
    """Write a Parquet table with other numbers, shape (N, width), in columns that it has.

    They keep their type, and the table what it says of itself.
    """
    pyarrow = need(path, "pyarrow", "tables")
    for name, values in of.items():
        at = table.column_names.index(name)
        field = table.schema.field(at)
        value = getattr(field.type, "value_type", field.type)
        flat = pyarrow.array(values.ravel().astype(value.to_pandas_dtype()))
        if value is not field.type:
            ends = np.arange(len(values) + 1) * values.shape[1]
            flat = pyarrow.ListArray.from_arrays(pyarrow.array(ends, "int32"), flat)
        table = table.set_column(at, field, flat.cast(field.type))
    sink = pyarrow.BufferOutputStream()
    need(path, "pyarrow.parquet", "tables").write_table(table, sink)
    return write_beside(path, sink.getvalue().to_pybytes())


def write_table(trajectory: PoseTrajectory | Series, path: Path, **asked: Any) -> Path:
    """Write a trajectory as a Parquet or Feather file, by the path's suffix."""
    pyarrow = need(path, "pyarrow", "tables")
    of = motion_columns(trajectory, **asked)
    table = pyarrow.table({name: np.ascontiguousarray(values) for name, values in of.items()})
    sink = pyarrow.BufferOutputStream()
    if path.suffix.lower() == ".feather":
        need(path, "pyarrow.feather", "tables").write_feather(table, sink)
    else:
        need(path, "pyarrow.parquet", "tables").write_table(table, sink)
    return write_beside(path, sink.getvalue().to_pybytes())


TABLE = Format(
    name="a table",
    read=read_table,
    options=MAPPING,
    suffixes=(".parquet", ".feather"),
    write=write_table,
    write_options=VELOCITIES,
    written=(".parquet", ".feather"),
    extra="tables",
)
"""Parquet or Feather."""
