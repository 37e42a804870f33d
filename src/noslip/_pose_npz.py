"""Poses, vectors and what goes with them as arrays in NumPy's npz."""

from __future__ import annotations

import io
import math
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from noslip._files import read_bytes
from noslip._pose_checks import Source, require_few
from noslip._samples import Named, Samples
from noslip._typing import Floats
from noslip.errors import RecordingError
from noslip.named_columns import listed, plural

POSES: dict[str, tuple[int, ...]] = {
    "times": (),
    "positions": (3,),
    "quaternions": (4,),
    "linear_velocities": (3,),
    "angular_velocities": (3,),
}
"""Arrays of poses, and the width of a sample in each."""
CHANNELS = {"values": "channels", "names": "channel_names", "units": "channel_units"}
"""What arrays of a series are called beside poses."""
REQUIRED = {"positions": ("times", "positions", "quaternions"), "values": ("times", "values")}
"""Without these there is no motion, of poses or of vectors; velocities can be estimated."""
MOST_COLUMNS = 1000
"""Of vectors and channels: more is an image."""
LONGEST_TEXT = 4 * 200
"""Bytes of a name or unit."""


def read_npz(path: str | Path, *, values: bool = False) -> Samples:
    """Return the poses, or the vectors, in an npz.

    Parameters
    ----------
    path : path
    values : bool
        Vectors are needed.
    """
    arrays, texts = _contents(path, values=values)
    source = Source(path, times="array times", quaternions="array quaternions")
    columns = {f"array {name}": numbers for name, numbers in arrays.items()}
    times = arrays.pop("times")
    if "values" in arrays:
        found = arrays.pop("values")
        names, units = _texts(path, texts, ("names", "units"), found.shape[1])
        positions, quaternions, channels = found, np.zeros((len(times), 0)), None
    else:
        names, units, channels = (), (), None
        positions, quaternions = arrays.pop("positions"), arrays.pop("quaternions")
        if "channels" in arrays:
            beside = arrays.pop("channels")
            called = _texts(path, texts, tuple(CHANNELS.values())[1:], beside.shape[1])
            channels = Named(values=beside, names=called[0], units=called[1])
    return Samples(
        name=str(path),
        source=source,
        times=times,
        positions=positions,
        quaternions=quaternions,
        velocities=arrays,
        columns=columns,
        names=names,
        units=units,
        channels=channels,
    )


def npz_bytes(arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """Return arrays by name as the content of an npz."""
    content = io.BytesIO()
    np.savez(content, **arrays)  # type: ignore[arg-type]
    return content.getvalue()


def _texts(
    path: str | Path, found: Mapping[str, list[str]], wanted: Sequence[str], count: int
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return names and units of columns, where the file has them."""
    usual = [f"x{k}" for k in range(count)], ["1"] * count
    names, units = (found.get(name, own) for name, own in zip(wanted, usual, strict=True))
    for name, texts in zip(wanted, (names, units), strict=True):
        if len(texts) != count:
            raise RecordingError(
                f"{path}: array {name} holds {len(texts)} texts, expected {count}, one a column"
            )
    return tuple(names), tuple(units)


def _contents(path: str | Path, *, values: bool) -> tuple[dict[str, Floats], dict[str, list[str]]]:
    """Return the arrays of a trajectory by name, in the right shapes; nothing is ever unpickled.

    What they are is checked before anything is decompressed.
    """
    content = io.BytesIO(read_bytes(path))
    # An array with an archive behind it would be loaded as the array.
    if not (zipfile.is_zipfile(content) and content.getvalue().startswith(b"PK")):
        raise RecordingError(f"{path}: not an npz file; write it with numpy.savez")
    content.seek(0)
    part = "the archive"
    try:
        with np.load(content, allow_pickle=False) as archive:
            found = archive.files
            kind = "values" if values or ("values" in found and "positions" not in found) else None
            required = REQUIRED[kind or "positions"]
            if missing := [name for name in required if name not in found]:
                shapes = (
                    "times (N,) and values (N, n)"
                    if kind
                    else "times (N,), positions (N, 3) and quaternions (N, 4)"
                )
                raise RecordingError(
                    f"{path}: {plural('array', missing)} missing, found {listed(found)}; "
                    f"needed are {shapes}"
                )
            widths: Mapping[str, tuple[int | None, ...]] = (
                {"times": (), "values": (None,), "velocities": (None,)}
                if kind
                else {**POSES, "channels": (None,)}
            )
            samples, arrays = 0, dict[str, Floats]()
            for name in filter(found.__contains__, widths):
                part = f"array {name}"
                shape, held = _header(archive.zip, name)
                if name == "times":
                    samples = math.prod(shape)
                    require_few(path, samples)
                if held.kind not in "iuf":
                    raise RecordingError(
                        f"{path}: array {name} holds {held}, not real numbers; store it as float64"
                    )
                expected = (samples, *widths[name])
                if None in expected and len(shape) == 2 and 1 <= shape[1] <= MOST_COLUMNS:
                    # As wide as the values are.
                    same = arrays["values"].shape[1] if name == "velocities" else shape[1]
                    expected = (samples, same)
                if shape != expected:
                    wanted = str(expected).replace("None", "k")
                    raise RecordingError(
                        f"{path}: array {name} has shape {shape}, expected {wanted}"
                    )
                arrays[name] = np.asarray(archive[name], dtype=np.float64)
            texts = {}
            for name in {"names", "units"} if kind else {*CHANNELS.values()} - {"channels"}:
                if name in found:
                    part = f"array {name}"
                    shape, held = _header(archive.zip, name)
                    fits = len(shape) == 1 and shape[0] <= MOST_COLUMNS
                    if held.kind != "U" or not fits or held.itemsize > LONGEST_TEXT:
                        raise RecordingError(
                            f"{path}: array {name} holds {held} of shape {shape}, expected a row "
                            "of short texts"
                        )
                    texts[name] = archive[name].tolist()
            return arrays, texts
    except RecordingError:
        raise
    except (OSError, EOFError, RuntimeError, ValueError, zipfile.BadZipFile, zlib.error) as error:
        raise RecordingError(
            f"{path}: {part} cannot be read ({' '.join(str(error).split())[:200]}); "
            "write plain arrays of numbers with numpy.savez"
        ) from error


def _header(archive: zipfile.ZipFile, name: str) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Return the shape and kind of a stored array."""
    member = archive.getinfo(f"{name}.npy" if f"{name}.npy" in archive.namelist() else name)
    if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise ValueError("it is compressed otherwise than NumPy does")
    with archive.open(member) as file:
        version = np.lib.format.read_magic(file)
        read = {(1, 0): np.lib.format.read_array_header_1_0}.get(
            version, np.lib.format.read_array_header_2_0
        )
        shape, _, kind = read(file)
    return shape, kind
