"""What became of each of many recordings: a row each, in CSV or Parquet."""

from __future__ import annotations

import io
from collections.abc import Iterable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal

from noslip._extras import need
from noslip._files import write_beside
from noslip.errors import InputError, RecordingError
from noslip.named_columns import NamedColumns, number, records_text
from noslip.recordings.tables import arrow_table

FORMATS = (".csv", ".parquet")
"""For people and spreadsheets; for what keeps types."""


@dataclass(frozen=True, kw_only=True)
class RecordingResult:
    """A row: what became of one recording.  What does not apply, or was not reached, is None.

    Attributes
    ----------
    name : str
        Of the primitive, without ``.json``: the file's stem, with its folders below a folder given.
    status : "learned" or "failed"
    message : str
        Why it failed, or what a person should know (the warnings).
    recording, primitive : str
        Paths; the latter empty where there is none.
    unit : str
        Of positions: what stands for m in the names of columns; another of vectors alone.
    samples, duration_s, path_length_m
        Of the recording as prepared.
    recording_residual_peak, recording_residual_rms : float or None
        How far the recording itself is off the equalities, in their units (SI).
    iterations, backing, smoothing, left_out
        Of its projection, see :class:`noslip.provenance.LearningRecord`; ``left_out`` separated by
        commas.
    projected_residual : float or None
        What the projection leaves of the residual.
    position_change_m, rotation_change_deg : float or None
        By which the projection moves the recording (rms).
    motion_duration_s : float or None
        Of the primitive's motion: longer than the recording where limits on its speed ask for it.
    residual_peak, residual_rms : float or None
        Of the same motion.
    holds : bool or None
        Whether that motion keeps every constraint and limit, to ``check``'s default tolerance.
    least_margins : str
        Of each limit along that motion, ``name=margin`` separated by commas.
    end_position_error_m, end_rotation_error_deg : float or None
        From the recording's last sample to that motion's; rotations of what turns alone.
    position_rms_m, rotation_rms_deg, rotation_error_deg : float or None
        Between recording and motion.
    angular_speed_peak_rad_s, angular_acceleration_peak_rad_s2 : float or None
    slowest_edge_speed_m_s : float or None
        Negative where the tool moves backwards.
    force_peak_m_s2, torque_peak_rad_s2 : float or None
        Largest acceleration that the constraints add, linear and angular.
    seconds : float or None
        Spent on this recording, reading and writing included.
    content, settings : str
        Hashes of the file and of all that it was learned with.
    checksum : str
        Hash of the primitive as it was written: what no longer matches is learned again.
    """

    name: str
    status: Literal["learned", "failed"]
    message: str = ""
    recording: str
    primitive: str = ""
    unit: str = ""
    samples: int | None = None
    duration_s: float | None = None
    path_length_m: float | None = None
    recording_residual_peak: float | None = None
    recording_residual_rms: float | None = None
    iterations: int | None = None
    backing: int | None = None
    smoothing: float | None = None
    left_out: str = ""
    projected_residual: float | None = None
    position_change_m: float | None = None
    rotation_change_deg: float | None = None
    motion_duration_s: float | None = None
    residual_peak: float | None = None
    residual_rms: float | None = None
    holds: bool | None = None
    least_margins: str = ""
    end_position_error_m: float | None = None
    end_rotation_error_deg: float | None = None
    position_rms_m: float | None = None
    rotation_rms_deg: float | None = None
    rotation_error_deg: float | None = None
    angular_speed_peak_rad_s: float | None = None
    angular_acceleration_peak_rad_s2: float | None = None
    slowest_edge_speed_m_s: float | None = None
    force_peak_m_s2: float | None = None
    torque_peak_rad_s2: float | None = None
    seconds: float | None = None
    content: str = ""
    settings: str = ""
    checksum: str = ""


_KINDS = {f.name: str(f.type).removesuffix(" | None") for f in fields(RecordingResult)}
"""Columns and what stands in them; annotations are texts here, such as "float | None"."""


def require_format(path: Path) -> None:
    """Refuse a table that cannot be written, before anything is learned."""
    if path.suffix.lower() not in FORMATS:
        raise InputError(f"{path}: a table ends in {' or '.join(FORMATS)}")
    if path.is_dir():
        raise InputError(f"{path}: is a folder; give the name of a table")
    if path.suffix.lower() == ".parquet":
        need(path, "pyarrow.parquet", "tables")


def write_results(results: Iterable[RecordingResult], path: Path) -> Path:
    """Write a table as CSV or Parquet, in one step: no reader sees half of one.

    CSV has empty cells, Parquet nulls, for what is None.
    """
    require_format(path)
    rows = [vars(result) for result in results]
    if path.suffix.lower() == ".csv":
        return write_beside(path, records_text(_KINDS, rows).encode())
    arrow, parquet = (need(path, name, "tables") for name in ("pyarrow", "pyarrow.parquet"))
    types = {"int": arrow.int64(), "float": arrow.float64(), "bool": arrow.bool_()}
    schema = arrow.schema(
        [(name, types.get(kind, arrow.string())) for name, kind in _KINDS.items()]
    )
    content = io.BytesIO()
    parquet.write_table(arrow.Table.from_pylist(rows, schema=schema), content)
    return write_beside(path, content.getvalue())


def read_results(path: str | Path) -> list[RecordingResult]:
    """Read a table that ``noslip learn --each`` wrote.

    Raises
    ------
    InputError
        If it cannot be read or is no such table; the message names the file and the column.
    """
    path = Path(path)
    require_format(path)
    advice = "move it away or give another name for the table"
    try:
        columns = _columns(path)
    except RecordingError as error:
        reason = str(error).removeprefix(f"{path}: ")
        raise InputError(f"{path}: not a table of results ({reason}); {advice}") from error
    results = []
    for line, row in enumerate(zip(*columns, strict=True), start=2):
        cells = {}
        for (name, kind), cell in zip(_KINDS.items(), row, strict=True):
            try:
                cells[name] = _value(kind, cell)
            except ValueError as error:
                raise InputError(f"{path}: row {line}, column {name}: {error}; {advice}") from None
        results.append(RecordingResult(**cells))
    return results


def _columns(path: Path) -> list[list[Any]]:
    """Return the cells of a table's columns, in the order of a row's fields."""
    if path.suffix.lower() == ".csv":
        table = NamedColumns.open(path, plain=True)
        names, columns = table.names, None
    else:
        arrow = arrow_table(path)
        names, columns = arrow.column_names, arrow.to_pydict()
    for name in _KINDS:
        if name not in names:
            raise RecordingError(f"{path}: no column {name}")
    if columns is None:
        columns = table.read((), tuple(_KINDS))[2]
    return [columns[name] for name in _KINDS]


def _value(kind: str, cell: Any) -> Any:
    if kind not in ("int", "float", "bool"):
        return "" if cell is None else str(cell)
    if cell is None or cell == "":
        return None
    if kind != "bool":
        value = number(str(cell))
        if kind == "int" and not value.is_integer():
            raise ValueError(f"found {cell!r}, not a whole number")
        return int(value) if kind == "int" else value
    if str(cell).lower() not in ("true", "false"):
        raise ValueError(f"found {cell!r}, neither true nor false")
    return str(cell).lower() == "true"
