"""robomimic's HDF5 files: ``data/demo_k/obs/robot0_eef_pos`` and ``robot0_eef_quat``."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from noslip._arguments import MOST_SAMPLES
from noslip._extras import need
from noslip._pose_checks import Source, require_few
from noslip._pose_columns import Asked, pose_of
from noslip._pose_names import POSE, Column
from noslip._samples import Samples
from noslip._typing import Floats
from noslip.errors import RecordingError
from noslip.named_columns import listed
from noslip.recordings._episodes import chosen_episodes
from noslip.recordings._format import Format
from noslip.recordings._reading import reading

EEF_POSE = "robot0_eef_pos,robot0_eef_quat[3,0:3]"
"""The end effector's pose; robosuite's quaternions have the scalar last."""


def read_robomimic(
    path: Path,
    *,
    rate: float | None = None,
    episode: int | Iterable[int] | None = None,
    **asked: Any,
) -> list[Samples]:
    """Read the demonstrations of a robomimic data set, one trajectory each.

    Parameters
    ----------
    path : Path
    rate : float, optional
        Samples per second; by default the ``control_freq`` in the file's ``env_args``.
    episode : int or iterable of int, optional
        The k of ``demo_k``; by default all.
    **asked
        Of :class:`noslip._pose_columns.Asked`: where the pose is in ``obs``.

    Raises
    ------
    MissingDependencyError
        Without h5py (``noslip[hdf5]``).
    InputError
        If the file is none, no rate is known, or for what :func:`noslip.load_demonstrations` names.
    """
    h5py = need(path, "h5py", "hdf5")
    with reading(path, "HDF5"), h5py.File(path, "r") as file:
        data = _inside(path, file, "data", h5py)
        demos = {} if not isinstance(data, h5py.Group) else _demos(data)
        if not demos:
            raise RecordingError(
                f"{path}: no groups data/demo_0 and so on, found "
                f"{listed(file)}; robomimic's layout is needed"
            )
        frequency = _frequency(path, data) if rate is None else rate
        if not (np.isfinite(frequency) and frequency > 0):
            raise RecordingError(f"{path}: rate must be positive, got {frequency:g}")
        return [
            _read_demo(path, demos[k], data, frequency, Asked(**asked), h5py)
            for k in chosen_episodes(path, episode, list(demos))
        ]


def _demos(data: Any) -> dict[int, str]:
    """Return the names of the demonstrations by number, in order."""
    found = {name.removeprefix("demo_"): name for name in data if name.startswith("demo_")}
    return {int(k): found[k] for k in sorted(filter(str.isdecimal, found), key=int)}


def _frequency(path: Path, data: Any) -> float:
    try:
        return float(json.loads(data.attrs["env_args"])["env_kwargs"]["control_freq"])
    except (KeyError, TypeError, ValueError):
        raise RecordingError(
            f"{path}: no control_freq in the env_args; pass rate=... (samples per second; on the "
            "command line --sample-rate)"
        ) from None


def _inside(name: str | Path, group: Any, key: str, h5py: Any) -> Any:
    """Return what a group holds itself; links may lead to files that are none of a stranger's."""
    link = group.get(key, getlink=True)
    if link is not None and not isinstance(link, h5py.HardLink):
        raise RecordingError(
            f"{name}: {key} is a link to elsewhere ({type(link).__name__}), which is not followed; "
            "copy what it leads to into this file"
        )
    found = group.get(key)
    if isinstance(found, h5py.Dataset) and (found.is_virtual or found.external):
        raise RecordingError(
            f"{name}: {key} keeps its numbers in another file, which is not read; copy them into "
            "this file"
        )
    return found


def _read_demo(path: Path, number: str, data: Any, rate: float, asked: Asked, h5py: Any) -> Samples:
    name = f"{path}/{number}"
    demo = _inside(path, data, number, h5py)
    observations = _inside(name, demo, "obs", h5py) if isinstance(demo, h5py.Group) else None
    if not isinstance(observations, h5py.Group):
        raise RecordingError(
            f"{name}: no observations (obs); extract them with robomimic's dataset_states_to_obs.py"
        )
    held = {key: _inside(name, observations, key, h5py) for key in observations}
    available = {
        key: Column(value.shape[1] if value.ndim == 2 else 1)
        for key, value in held.items()
        if isinstance(value, h5py.Dataset) and value.ndim in (1, 2) and value.dtype.kind in "iuf"
    }
    if asked.columns is None:
        asked = replace(asked, columns=EEF_POSE)
    by_lower = {key.lower(): key for key in available}
    available = {key: available[name] for key, name in by_lower.items()}
    pose = pose_of(name, available, asked)
    lengths = {key: len(held[by_lower[key]]) for key, _ in pose.places}
    for length in lengths.values():
        require_few(name, length)
    if len(set(lengths.values())) > 1:
        found = ", ".join(f"{key} {length}" for key, length in lengths.items())
        raise RecordingError(f"{name}: observations of different lengths: {found}")

    def read(key: str) -> Floats:
        key = by_lower[key]
        # A chunk, which may be larger than what is in it, is decompressed as a whole.
        for shape in (held[key].shape, held[key].chunks or ()):
            if math.prod(shape) > MOST_SAMPLES * len(POSE):
                raise RecordingError(
                    f"{name}: {key} has shape or chunks {shape}, more numbers than "
                    f"{MOST_SAMPLES:,} poses; store the pose in a data set of its own"
                )
        values = np.asarray(held[key], dtype=np.float64)
        return values.reshape(len(values), -1)

    source = Source(name, "sample", "quaternion")
    positions, quaternions = pose.poses(source, {key: read(key) for key in lengths})
    told = pose.understood(available)
    return Samples(
        name=name,
        source=source,
        times=np.arange(len(positions)) / rate,
        positions=positions,
        quaternions=quaternions,
        understood=[f"{key}: {what}" for key, what in told.items()],
    )


HDF5 = Format(
    name="an HDF5 file",
    read=read_robomimic,
    options=("rate", "episode", "columns", "units", "rotation"),
    suffixes=(".hdf5", ".h5"),
    extra="hdf5",
)
"""As robomimic lays it out."""
