"""HDF5 files: robomimic's and LIBERO's demonstrations, DROID's, and columns of any other."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from noslip._arguments import MOST_SAMPLES
from noslip._extras import need
from noslip._pose_checks import Source, require_few
from noslip._pose_columns import Asked, Content, Layout, content_of, layout_of
from noslip._pose_names import POSE, Column
from noslip._samples import Samples
from noslip._typing import Floats
from noslip.errors import RecordingError
from noslip.named_columns import listed
from noslip.recordings._episodes import chosen_episodes
from noslip.recordings._format import MAPPING, Format
from noslip.recordings._reading import reading
from noslip.trajectory import PoseTrajectory

EEF_POSE = "robot0_eef_pos,robot0_eef_quat[3,0:3]"
"""The end effector's pose; robosuite's quaternions have the scalar last."""
LIBERO: dict[str, Any] = {"columns": "ee_pos,ee_ori", "rotation": "rotvec"}
"""LIBERO's observations keep it as an axis times an angle (robosuite's quat2axisangle)."""
DROID: dict[str, Any] = {
    "columns": "observation/robot_state/cartesian_position",
    "rotation": "euler:xyz:rad",
    "time": "observation/timestamp/control/step_start",
    "units": "ms",
}
"""DROID's trajectory.h5: position and angles about the fixed axes; stamps in ms since 1970."""
DEEPEST = 5
"""Groups within groups that are looked into: DROID's stamps are four deep."""
MOST_COLUMNS = 1000
"""Data sets of a file that are looked at."""


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
            return [_read_columns(path, file, Asked(rate=rate, **asked), h5py)]
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


def replace_robomimic(
    path: Path,
    out: Path,
    poses: Mapping[str, PoseTrajectory],
    *,
    rate: float | None = None,
    episode: Any = None,
    **asked: Any,
) -> None:
    """Copy a file, with other poses in the data sets that :func:`read_robomimic` reads.

    All else stays to the bit, but for ``next_obs``, which is each observation's next; after the
    last one the pose stays.

    Parameters
    ----------
    path, out : Path
        The file, and that to make.
    poses : mapping of str to PoseTrajectory
        By the names of the demonstrations, which have as many samples.
    rate, episode
        Not used: ``poses`` says which.
    **asked
        As it was read with.
    """
    h5py = need(path, "h5py", "hdf5")
    shutil.copyfile(path, out)
    with h5py.File(out, "r+") as file:
        data = file.get("data")
        demos = _demos(data) if isinstance(data, h5py.Group) else {}
        for name in demos.values():
            if (new := poses.get(f"{path}/{name}")) is not None:
                held, content = _demo(f"{path}/{name}", data, name, Asked(**asked), h5py)
                after = _inside(path, data[name], "next_obs", h5py)
                _put(
                    path,
                    held,
                    content,
                    new,
                    h5py,
                    {} if after is None else _held(path, after, h5py),
                )
        if not demos and (new := poses.get(str(path))) is not None:
            held, layout = _layout(path, file, Asked(rate=rate, **asked), h5py)
            _put(path, held, layout.content, new, h5py, {})


def _put(
    path: Path,
    held: Mapping[str, Any],
    content: Content,
    new: PoseTrajectory,
    h5py: Any,
    after: Mapping[str, Any],
) -> None:
    of = _read(path, held, [key for key, _ in content.places], h5py)
    for key, values in content.pose.replaced(path, of, new.positions, new.quaternions).items():
        held[key][...] = values.reshape(held[key].shape)
        if key in after and after[key].shape == held[key].shape:
            after[key][...] = np.concatenate([held[key][1:], held[key][-1:]])


def _demo(
    name: str, data: Any, number: str, asked: Asked, h5py: Any
) -> tuple[dict[str, Any], Content]:
    """Return the data sets of a demonstration, and where the motion is among them."""
    demo = _inside(name, data, number, h5py)
    observations = _inside(name, demo, "obs", h5py) if isinstance(demo, h5py.Group) else None
    if not isinstance(observations, h5py.Group):
        raise RecordingError(
            f"{name}: no observations (obs); extract them with robomimic's dataset_states_to_obs.py"
        )
    held = _held(name, observations, h5py)
    if asked.columns is None and asked.robot is None and not asked.values:
        libero = {"ee_pos", "ee_ori"} <= set(held) and "robot0_eef_pos" not in held
        known: dict[str, Any] = LIBERO if libero else {"columns": EEF_POSE}
        asked = replace(asked, **known)
    elif asked.columns is not None and "actions" in asked.columns:
        held |= _held(name, demo, h5py)
    return held, content_of(name, _columns(held), asked)


def _read_demo(path: Path, number: str, data: Any, rate: float, asked: Asked, h5py: Any) -> Samples:
    name = f"{path}/{number}"
    held, content = _demo(name, data, number, replace(asked, rate=rate), h5py)
    columns = _read(name, held, [key for key, _ in content.places], h5py)
    source = Source(name, "sample", "quaternion")
    found = content.samples(source, columns)
    told = content.understood(_columns(held))
    return Samples(
        name=name,
        source=source,
        times=np.arange(len(found["positions"])) / rate,
        **found,
        understood=[f"{key}: {what}" for key, what in told.items()],
    )


def _read_columns(path: Path, file: Any, asked: Asked, h5py: Any) -> Samples:
    """Read a file whose data sets are the columns of one recording."""
    held, layout = _layout(path, file, asked, h5py)
    return layout.samples(path, _columns(held), _read(path, held, layout.numbers, h5py), {})


def _layout(path: Path, file: Any, asked: Asked, h5py: Any) -> tuple[dict[str, Any], Layout]:
    """Return the data sets of such a file, and where the time and the pose are among them."""
    held = _held(path, file, h5py, DEEPEST)
    available = _columns(held)
    if not available:
        raise RecordingError(
            f"{path}: no columns of numbers and no groups data/demo_0 and so on, found "
            f"{listed(file)}"
        )
    if (
        DROID["columns"] in available
        and asked.columns is None
        and asked.robot is None
        and not asked.values
    ):
        known = dict(DROID)
        if asked.rate is not None or DROID["time"] not in available:
            del known["time"], known["units"]
        asked = replace(asked, **{k: v for k, v in known.items() if getattr(asked, k) is None})
    return held, layout_of(path, available, asked)


def _held(
    name: str | Path, group: Any, h5py: Any, depth: int = 1, prefix: str = ""
) -> dict[str, Any]:
    """Return the data sets of numbers in a group and those in it, by name in lower case."""
    found: dict[str, Any] = {}
    for key in group:
        value = _inside(name, group, key, h5py)
        if isinstance(value, h5py.Group) and depth > 1:
            found |= _held(name, value, h5py, depth - 1, f"{prefix}{key.lower()}/")
        if isinstance(value, h5py.Dataset) and value.ndim in (1, 2) and value.dtype.kind in "iuf":
            found[f"{prefix}{key.lower()}"] = value
        if len(found) > MOST_COLUMNS:
            raise RecordingError(f"{name}: more than {MOST_COLUMNS} data sets; split it")
    return found


def _columns(held: Mapping[str, Any]) -> dict[str, Column]:
    return {key: Column(value.shape[1] if value.ndim == 2 else 1) for key, value in held.items()}


def _read(
    name: str | Path, held: Mapping[str, Any], keys: Iterable[str], h5py: Any
) -> dict[str, Floats]:
    """Return data sets of equal length, shape (N, width), each read once."""
    wanted = list(dict.fromkeys(keys))
    lengths = {key: len(held[key]) for key in wanted}
    for length in lengths.values():
        require_few(name, length)
    if len(set(lengths.values())) > 1:
        found = ", ".join(f"{key} {length}" for key, length in lengths.items())
        raise RecordingError(f"{name}: observations of different lengths: {found}")
    columns = {}
    for key in wanted:
        # A chunk, which may be larger than what is in it, is decompressed as a whole.
        for shape in (held[key].shape, held[key].chunks or ()):
            if math.prod(shape) > MOST_SAMPLES * len(POSE):
                raise RecordingError(
                    f"{name}: {key} has shape or chunks {shape}, more numbers than "
                    f"{MOST_SAMPLES:,} poses; store the pose in a data set of its own"
                )
        values = np.asarray(held[key], dtype=np.float64)
        columns[key] = values.reshape(len(values), -1)
    return columns


HDF5 = Format(
    name="an HDF5 file",
    read=read_robomimic,
    options=("episode", *MAPPING),
    suffixes=(".hdf5", ".h5"),
    replace=replace_robomimic,
    extra="hdf5",
)
"""As robomimic, LIBERO or DROID lay it out, or of columns."""
