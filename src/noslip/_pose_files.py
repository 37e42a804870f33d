"""Poses in files: CSV and npz read here; those of every kind checked, and explained when wrong."""

from __future__ import annotations

import csv
import io
import reprlib
import zipfile
import zlib
from array import array
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip.errors import InputError, RecordingError

MIN_SAMPLES = 8
MAX_NORM_ERROR = 1e-3
MAX_GAP = 10.0
"""Longest time without a sample, in median periods."""
SAME_POSE = 1e-9
"""Poses that agree to this (m, and in each number of a unit quaternion) count as equal."""

TIME_NAMES = ("t", "time")
POSITION_NAMES = ("x", "y", "z")
QUATERNION_NAMES = ("qw", "qx", "qy", "qz")
PLANAR_NAMES = ("x", "y", "theta")
PLANAR_DEGREES_NAMES = ("x", "y", "theta_deg")

NPZ_REQUIRED = ("times", "positions", "quaternions")
NPZ_WIDTHS: dict[str, tuple[int, ...]] = {
    "times": (),
    "positions": (3,),
    "quaternions": (4,),
    "linear_velocities": (3,),
    "angular_velocities": (3,),
}


@dataclass(frozen=True)
class _Source:
    """What a file calls its parts, so that the same checks can point into any file.

    Readers of other formats (:mod:`noslip.recordings`) make one and share the checks below.
    """

    path: str | Path
    times: str
    quaternions: str
    lines: list[int] | None = None

    def sample(self, index: int) -> str:
        return f"sample {index}" if self.lines is None else f"line {self.lines[index]}"

    def error(self, index: int, part: str, problem: str) -> RecordingError:
        return RecordingError(f"{self.path}: {self.sample(index)}, {part}: {problem}")


# -------------------------------------------------------------------- CSV


def read_csv(path: str | Path, *, rate: float | None = None) -> dict[str, Any]:
    """Return the fields of a PoseTrajectory read from a CSV."""
    text = _decode(path, _read(path))
    first_line = next((line for line in io.StringIO(text) if line.strip()), "")
    rows = _rows(path, text, delimiter=max(",;\t", key=first_line.count))
    line, header = next(rows, (0, []))
    if not header:
        raise RecordingError(f"{path}: the file is empty")
    names = [" ".join(cell.split()).lower() for cell in header]
    _check_header(path, line, names)
    time, layout = _layout(f"{path}: line {line}", names, rate)
    columns = (time, *layout)

    lines, table = _numbers(path, rows, names, columns)
    if not lines:
        raise RecordingError(
            f"{path}: line {line}: a header and no samples; record something first"
        )

    of = dict(zip(columns, table.T, strict=True))
    source = _Source(
        path,
        times=f"column {time}",
        quaternions=f"columns {', '.join(QUATERNION_NAMES)}",
        lines=lines,
    )
    return _of_columns(source, of, rate)


def _of_columns(source: _Source, of: Mapping[str, Floats], rate: float | None) -> dict[str, Any]:
    """Return the fields of a trajectory from the columns that :func:`_layout` chose."""
    _check_finite(source, {f"column {name}": values for name, values in of.items()})
    time = next(name for name in (*TIME_NAMES, "i") if name in of)
    times = of[time] if rate is None or time != "i" else of[time] / rate
    if "theta_deg" in of:
        of = {**of, "theta": np.radians(of["theta_deg"])}
    if "theta" in of:
        height = np.zeros(len(times))
        return _poses(
            source,
            times,
            np.column_stack([of["x"], of["y"], height]),
            Rotation.from_rotvec(np.column_stack([height, height, of["theta"]])),
        )
    return _poses(
        source,
        times,
        np.column_stack(itemgetter(*POSITION_NAMES)(of)),
        _rotations(source, np.column_stack(itemgetter(*QUATERNION_NAMES)(of))),
    )


def _decode(path: str | Path, content: bytes) -> str:
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise RecordingError(
            f"{path}: line {line}: not UTF-8 text (byte 0x{content[error.start]:02x}); "
            "save it as CSV in UTF-8"
        ) from None
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        raise RecordingError(
            f"{path}: line {line}: binary content, not a CSV; save it as UTF-8 text"
        )
    return text


def _rows(path: str | Path, text: str, delimiter: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the line number and the cells of every row that is not blank."""
    # Strict, because a quote left open would otherwise swallow the rest of the file in silence.
    reader = csv.reader(
        io.StringIO(text, newline=""), delimiter=delimiter, skipinitialspace=True, strict=True
    )
    line = 1
    try:
        for cells in reader:
            if cells and (len(cells) > 1 or cells[0].strip()):
                yield line, cells
            line = reader.line_num + 1
    except csv.Error as error:
        raise RecordingError(
            f"{path}: line {line}: cannot be split into cells ({error}); check its quotes"
        ) from error


def _check_header(path: str | Path, line: int, names: list[str]) -> None:
    """Tell a row of numbers from a header."""
    first = next(filter(None, names), "")
    try:
        float(first)
    except ValueError:
        return
    raise RecordingError(
        f"{path}: line {line}: found {_shown(first)} where a column name should be; "
        "put a header first, such as t,x,y,z,qw,qx,qy,qz"
    )


def _layout(where: str, names: list[str], rate: float | None) -> tuple[str, tuple[str, ...]]:
    """Choose the column of time and those of the pose."""
    present = set(names)
    layout: tuple[str, ...] = POSITION_NAMES + QUATERNION_NAMES
    if not present.intersection(QUATERNION_NAMES):
        for planar in (PLANAR_NAMES, PLANAR_DEGREES_NAMES):
            if planar[-1] in present:
                layout = planar
                break
        else:
            # Without a quaternion and a height it is most likely meant to be planar.
            layout = layout if "z" in present or not {"x", "y"} <= present else PLANAR_NAMES
    missing = [name for name in layout if name not in present]
    times = [name for name in TIME_NAMES if name in present]
    if not times and "i" not in present:
        missing.insert(0, "t")
    if missing:
        raise RecordingError(
            f"{where}: {_plural('column', missing)} missing, found {_listed(names)}; "
            "needed are t (or time, or i with a rate), and x,y,z,qw,qx,qy,qz or x,y,theta "
            "(radians) or x,y,theta_deg"
        )
    if len(times) > 1:
        raise RecordingError(f"{where}: columns t and time both give a time; keep one")
    time = times[0] if times else "i"
    for name in (time, *layout):
        if names.count(name) > 1:
            raise RecordingError(
                f"{where}: column {name} appears {names.count(name)} times; keep one"
            )
    if time == "i":
        if rate is None:
            raise RecordingError(
                f"{where}: column i counts samples and no column t gives their "
                "time; pass rate=... (samples per second; on the command line --sample-rate)"
            )
        if not (np.isfinite(rate) and rate > 0):
            raise RecordingError(
                f"{where}: rate must be positive (samples per second), got {rate:g}"
            )
    return time, layout


def _numbers(
    path: str | Path,
    rows: Iterable[tuple[int, list[str]]],
    names: list[str],
    columns: tuple[str, ...],
) -> tuple[list[int], Floats]:
    """Return the line of every row, and the numbers in its named columns."""
    pick = itemgetter(*map(names.index, columns))
    lines: list[int] = []
    numbers = array("d")
    for line, cells in rows:
        try:
            if len(cells) != len(names):
                raise ValueError("perhaps only a separator at the end")
            numbers.extend([_number(cell) for cell in pick(cells)])
        except ValueError:
            numbers.extend(_row_numbers(path, line, cells, names, columns))
        lines.append(line)
    return lines, np.array(numbers, dtype=np.float64).reshape(-1, len(columns))


def _number(cell: str) -> float:
    if "_" in cell:  # Python reads 1_5 as 15
        raise ValueError(cell)
    return float(cell)


def _row_numbers(
    path: str | Path, line: int, cells: list[str], names: list[str], columns: tuple[str, ...]
) -> list[float]:
    """Return the numbers of one row, or say what is wrong with it."""
    # Separators at the end of a row or of the header hold nothing.
    width, found = _filled(names), len(cells)
    if found < width:
        raise RecordingError(
            f"{path}: line {line}, column {names[found] or found + 1}: the row ends after "
            f"{found} of {width} cells; complete or remove it"
        )
    if _filled(cells) > len(names):
        raise RecordingError(
            f"{path}: line {line}, column {names[-1] or len(names)}: the row goes on after it, "
            f"{found} cells under {len(names)} names; write numbers with a decimal point"
        )
    numbers = []
    for name in columns:
        cell = cells[names.index(name)].strip()
        try:
            numbers.append(_number(cell))
        except ValueError:
            problem = f"found {_shown(cell)}, not a number" if cell else "the cell is empty"
            advice = "write a decimal point" if "," in cell else "fill in or remove the row"
            raise RecordingError(
                f"{path}: line {line}, column {name}: {problem}; {advice}"
            ) from None
    return numbers


def _filled(cells: list[str]) -> int:
    """Count the cells up to the last that is not blank."""
    return max((k for k, cell in enumerate(cells, start=1) if cell.strip()), default=0)


# -------------------------------------------------------------------- npz


def read_npz(path: str | Path) -> dict[str, Any]:
    """Return the fields of a PoseTrajectory read from an npz."""
    arrays = _arrays(path)
    source = _Source(path, times="array times", quaternions="array quaternions")
    _check_finite(source, {f"array {name}": values for name, values in arrays.items()})
    return _poses(
        source,
        arrays.pop("times"),
        arrays.pop("positions"),
        _rotations(source, arrays.pop("quaternions")),
        velocities=arrays,
    )


def _arrays(path: str | Path) -> dict[str, Floats]:
    """Return the arrays of a trajectory by name, in the right shapes."""
    stored, found = _stored(path)
    missing = [name for name in NPZ_REQUIRED if name not in stored]
    if missing:
        raise RecordingError(
            f"{path}: {_plural('array', missing)} missing, found {_listed(found)}; "
            "needed are times (N,), positions (N, 3) and quaternions (N, 4)"
        )
    samples = stored["times"].size
    for name, values in stored.items():
        expected = (samples, *NPZ_WIDTHS[name])
        if values.shape != expected:
            raise RecordingError(
                f"{path}: array {name} has shape {values.shape}, expected {expected}"
            )
        if values.dtype.kind not in "iuf":
            raise RecordingError(
                f"{path}: array {name} holds {values.dtype}, not real numbers; store it as float64"
            )
    return {name: values.astype(np.float64) for name, values in stored.items()}


def _stored(path: str | Path) -> tuple[dict[str, NDArray[Any]], list[str]]:
    """Return the arrays we know and the names of all; nothing is ever unpickled."""
    content = io.BytesIO(_read(path))
    if not zipfile.is_zipfile(content):
        raise RecordingError(f"{path}: not an npz file; write it with numpy.savez")
    content.seek(0)
    stored: dict[str, NDArray[Any]] = {}
    part = "the archive"
    try:
        with np.load(content, allow_pickle=False) as archive:
            for name in filter(archive.files.__contains__, NPZ_WIDTHS):
                part = f"array {name}"
                stored[name] = np.asarray(archive[name])
            return stored, archive.files
    except (OSError, EOFError, RuntimeError, ValueError, zipfile.BadZipFile, zlib.error) as error:
        raise RecordingError(
            f"{path}: {part} cannot be read ({' '.join(str(error).split())}); "
            "write plain arrays of numbers with numpy.savez"
        ) from error


# -------------------------------------------------------------------- both


def _read(path: str | Path) -> bytes:
    file = Path(path)
    if file.is_dir():
        raise InputError(f"{path}: a folder, not a file; give {file / '*.csv'}")
    try:
        return file.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; check the path") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error


def _check_finite(source: _Source, parts: Mapping[str, Floats]) -> None:
    """Refuse NaN and infinity, pointing at the first sample that holds one."""
    found: list[tuple[int, str]] = []
    for part, values in parts.items():
        bad = np.argwhere(~np.isfinite(values))
        found += [(int(where[0]), part) for where in bad[:1]]
    if found:
        index, part = min(found, key=itemgetter(0))
        raise source.error(
            index,
            part,
            f"found {parts[part][index]}, not a finite number; fill in or remove the sample",
        )


def _rotations(source: _Source, quaternions: Floats) -> Rotation:
    """Return the rotations of unit quaternions, scalar first."""
    with np.errstate(over="ignore"):
        norms = np.linalg.norm(quaternions, axis=1)
    bad = np.flatnonzero(~(np.abs(norms - 1) <= MAX_NORM_ERROR))
    if len(bad):
        index = int(bad[0])
        found = f"has norm {norms[index]:.6g}" if norms[index] else "is zero, which is no rotation"
        raise source.error(
            index,
            source.quaternions,
            f"the quaternion {found}; norms must be 1 to within {MAX_NORM_ERROR:g}, "
            "correct or remove the sample",
        )
    return Rotation.from_quat(quaternions, scalar_first=True)


def _checked(
    source: _Source, times: Floats, positions: Floats, quaternions: Floats
) -> dict[str, Any]:
    """Return the fields of a trajectory from raw numbers, quaternions scalar first."""
    parts = {source.times: times, "position": positions, source.quaternions: quaternions}
    _check_finite(source, parts)
    return _poses(source, times, positions, _rotations(source, quaternions))


def _poses(
    source: _Source,
    times: Floats,
    positions: Floats,
    rotations: Rotation,
    velocities: Mapping[str, Floats] | None = None,
) -> dict[str, Any]:
    """Return the fields of a trajectory from finite numbers, after the checks on time."""
    with np.errstate(over="ignore"):
        kept = _distinct(source, times, positions, rotations)
    if len(kept) < MIN_SAMPLES:
        raise RecordingError(
            f"{source.path}: {len(kept)} distinct samples, at least {MIN_SAMPLES} are needed; "
            "record more"
        )
    _check_gaps(source, times, kept)
    arrays = {"times": times, "positions": positions, **(velocities or {})}
    return {**{name: values[kept] for name, values in arrays.items()}, "rotations": rotations[kept]}


def _distinct(
    source: _Source, times: Floats, positions: Floats, rotations: Rotation
) -> NDArray[np.intp]:
    """Return the samples to keep: all but equal poses repeated at the same time."""
    periods = np.diff(times)
    quaternions = rotations.as_quat()
    turns = np.minimum(
        np.abs(quaternions[1:] - quaternions[:-1]).max(axis=1, initial=0),
        np.abs(quaternions[1:] + quaternions[:-1]).max(axis=1, initial=0),
    )
    moves = np.abs(np.diff(positions, axis=0)).max(axis=1, initial=0)
    moved = (moves > SAME_POSE) | (turns > SAME_POSE)
    wrong = np.flatnonzero((periods < 0) | ((periods == 0) & moved))
    if len(wrong):
        before, index = int(wrong[0]), int(wrong[0]) + 1
        if periods[before] < 0:
            problem = (
                f"time runs backwards, from {times[before]} s ({source.sample(before)}) to "
                f"{times[index]} s; sort the samples or split the recording"
            )
        else:
            turned = (rotations[index] * rotations[before].inv()).magnitude()
            problem = (
                f"{times[index]} s is also the time of {source.sample(before)}, at another pose "
                f"({moves[before]:.2g} m and {turned:.2g} rad away); correct the time or remove one"
            )
        raise source.error(index, source.times, problem)
    return np.flatnonzero(np.concatenate([[True], periods > 0])[: len(times)])


def _check_gaps(source: _Source, times: Floats, kept: NDArray[np.intp]) -> None:
    """Refuse a hole in the recording, which a spline would fill with invented motion."""
    stamps = times[kept]
    with np.errstate(over="ignore"):
        periods = np.diff(stamps)
    usual = float(np.median(periods))
    # The margin keeps a gap of exactly ten periods, whatever its rounding.
    gaps = np.flatnonzero(periods > MAX_GAP * usual * (1 + 1e-9))
    if len(gaps):
        before = int(gaps[0])
        raise source.error(
            int(kept[before + 1]),
            source.times,
            f"no sample from {stamps[before]} s ({source.sample(int(kept[before]))}) to "
            f"{stamps[before + 1]} s, over {MAX_GAP:g} times the median period of {usual:.3g} s; "
            "split the recording there",
        )


def _plural(noun: str, names: list[str]) -> str:
    return f"{noun}{'s' if len(names) > 1 else ''} {', '.join(names)}"


def _listed(names: Iterable[str]) -> str:
    """List what a file holds, but not all of hundreds."""
    shown = [_shown(name) for name in names if name]
    return ", ".join([*shown[:20], "..."] if len(shown) > 20 else shown) or "none"


def _shown(text: str) -> str:
    """Quote what a file holds, on one line and not too long."""
    return reprlib.repr(text)
