"""Poses and velocities as arrays in NumPy's npz."""

from __future__ import annotations

import io
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from noslip._files import read_bytes
from noslip._pose_checks import Source
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


def read_npz(path: str | Path) -> dict[str, Any]:
    """Return the fields of a PoseTrajectory read from an npz."""
    arrays = _arrays(path)
    source = Source(path, times="array times", quaternions="array quaternions")
    source.check_finite({f"array {name}": values for name, values in arrays.items()})
    times, positions, quaternions = map(arrays.pop, REQUIRED)
    return source.fields(times, positions, source.rotations(quaternions), arrays)


def npz_bytes(*arrays: Floats) -> bytes:
    """Return the arrays that ``WIDTHS`` names, in its order, as the content of an npz."""
    content = io.BytesIO()
    np.savez(content, **dict(zip(WIDTHS, arrays, strict=True)))  # type: ignore[arg-type]
    return content.getvalue()


def _arrays(path: str | Path) -> dict[str, Floats]:
    """Return the arrays of a trajectory by name, in the right shapes."""
    stored, found = _stored(path)
    missing = [name for name in REQUIRED if name not in stored]
    if missing:
        raise RecordingError(
            f"{path}: {plural('array', missing)} missing, found {listed(found)}; "
            "needed are times (N,), positions (N, 3) and quaternions (N, 4)"
        )
    samples = stored["times"].size
    for name, values in stored.items():
        expected = (samples, *WIDTHS[name])
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
    content = io.BytesIO(read_bytes(path))
    if not zipfile.is_zipfile(content):
        raise RecordingError(f"{path}: not an npz file; write it with numpy.savez")
    content.seek(0)
    stored: dict[str, NDArray[Any]] = {}
    part = "the archive"
    try:
        with np.load(content, allow_pickle=False) as archive:
            for name in filter(archive.files.__contains__, WIDTHS):
                part = f"array {name}"
                stored[name] = np.asarray(archive[name])
            return stored, archive.files
    except (OSError, EOFError, RuntimeError, ValueError, zipfile.BadZipFile, zlib.error) as error:
        raise RecordingError(
            f"{path}: {part} cannot be read ({' '.join(str(error).split())}); "
            "write plain arrays of numbers with numpy.savez"
        ) from error
