"""Poses and velocities as arrays in NumPy's npz."""

from __future__ import annotations

import io
import math
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from noslip._files import read_bytes
from noslip._pose_checks import Source, require_few
from noslip._samples import Samples
from noslip._typing import Floats
from noslip.errors import RecordingError
from noslip.named_columns import listed, plural

REQUIRED = ("times", "positions", "quaternions")
"""Without these there is no motion; velocities can be estimated."""
WIDTHS: dict[str, tuple[int, ...]] = {
    "times": (),
    "positions": (3,),
    "quaternions": (4,),
    "linear_velocities": (3,),
    "angular_velocities": (3,),
}
"""Of a sample in each array."""


def read_npz(path: str | Path) -> Samples:
    """Return the poses in an npz."""
    arrays = _arrays(path)
    source = Source(path, times="array times", quaternions="array quaternions")
    columns = {f"array {name}": values for name, values in arrays.items()}
    times, positions, quaternions = map(arrays.pop, REQUIRED)
    return Samples(
        name=str(path),
        source=source,
        times=times,
        positions=positions,
        quaternions=quaternions,
        velocities=arrays,
        columns=columns,
    )


def npz_bytes(*arrays: Floats) -> bytes:
    """Return the arrays that ``WIDTHS`` names, in its order, as the content of an npz."""
    content = io.BytesIO()
    np.savez(content, **dict(zip(WIDTHS, arrays, strict=True)))  # type: ignore[arg-type]
    return content.getvalue()


def _arrays(path: str | Path) -> dict[str, Floats]:
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
            missing = [name for name in REQUIRED if name not in found]
            if missing:
                raise RecordingError(
                    f"{path}: {plural('array', missing)} missing, found {listed(found)}; "
                    "needed are times (N,), positions (N, 3) and quaternions (N, 4)"
                )
            samples, arrays = 0, {}
            for name in filter(found.__contains__, WIDTHS):
                part = f"array {name}"
                shape, kind = _header(archive.zip, name)
                if name == "times":
                    samples = math.prod(shape)
                    require_few(path, samples)
                if kind.kind not in "iuf":
                    raise RecordingError(
                        f"{path}: array {name} holds {kind}, not real numbers; store it as float64"
                    )
                expected = (samples, *WIDTHS[name])
                if shape != expected:
                    raise RecordingError(
                        f"{path}: array {name} has shape {shape}, expected {expected}"
                    )
                arrays[name] = np.asarray(archive[name], dtype=np.float64)
            return arrays
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
