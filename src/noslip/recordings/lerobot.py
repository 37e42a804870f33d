"""LeRobot data sets, versions 2.x (a Parquet file an episode) and 3.0 (episodes share files)."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from noslip._extras import need
from noslip._files import read_text, write_beside
from noslip._pose_checks import Source
from noslip._pose_columns import Asked, Content, content_of
from noslip._pose_names import Column
from noslip._samples import Samples
from noslip._typing import Floats
from noslip.errors import InputError, RecordingError
from noslip.named_columns import shown
from noslip.recordings._episodes import chosen_episodes
from noslip.recordings._format import Format
from noslip.recordings._reading import reading
from noslip.recordings.tables import arrow_table, numbers, write_columns
from noslip.trajectory import PoseTrajectory

INFO = Path("meta") / "info.json"
"""What every data set has, and its folder is known by."""
_TEMPLATE = re.compile(r"([^{}]|\{(episode|chunk|file)_(index|chunk)(:0?\dd)?\})*")
"""Of data_path: what else a format may ask for would lead to other values, or fill the memory."""
STAMP_TOLERANCE = 1e-4
"""How far a frame's stamp may lie from ``frame_index / fps`` (s): LeRobot's own tolerance."""


def is_lerobot(folder: Path) -> bool:
    """Whether a folder is a LeRobot data set."""
    return (folder / INFO).is_file()


def read_lerobot(
    path: Path, *, episode: int | Iterable[int] | None = None, **asked: Any
) -> list[Samples]:
    """Read the episodes of a LeRobot data set, one trajectory each.

    Parameters
    ----------
    path : Path
        The folder that holds ``meta`` and ``data``.
    episode : int or iterable of int, optional
        By default all.
    **asked
        Of :class:`noslip._pose_columns.Asked`; the numbers of a vector such as
        ``observation.state`` have the names that ``info.json`` gives them.

    Raises
    ------
    MissingDependencyError
        Without pyarrow (``noslip[tables]``).
    InputError
        If something is missing or of another version, or for what
        :func:`noslip.load_demonstrations` names.

    Notes
    -----
    Frames are at ``frame_index / fps``.  Stamps, which are single precision, count where they
    differ from that by more than 0.1 ms.
    """
    need(path, "pyarrow.parquet", "tables")
    with reading(path, "a LeRobot data set"):
        return _read(path, episode, Asked(**asked))


def _read(path: Path, episode: int | Iterable[int] | None, asked: Asked) -> list[Samples]:
    info = _info(path)
    fps = float(info["fps"])
    available, content, named = _content(path, info, asked)
    wanted = {*named, "timestamp", "frame_index", "episode_index"}

    where = _where_episodes_are(path, info)
    chosen = chosen_episodes(path, episode, list(where))
    episodes = []
    read: tuple[Path, dict[str, Floats]] | None = None
    for number in chosen:
        file = where[number]
        if read is None or read[0] != file:
            table = arrow_table(file, sorted(wanted))
            read = file, {key: numbers(file, table, key) for key in wanted}
        rows = np.flatnonzero(read[1]["episode_index"][:, 0] == number)
        of = {key.lower(): values[rows] for key, values in read[1].items()}
        episodes.append(
            _episode(_name(path, number), file, of, content, fps, content.understood(available))
        )
    return episodes


def _content(
    path: Path, info: dict[str, Any], asked: Asked
) -> tuple[dict[str, Column], Content, list[str]]:
    """Return all columns of numbers, where the motion is among them, and what those are called."""
    held = _features(path, info)
    by_lower = {name.lower(): name for name in held}
    available = {key: held[name] for key, name in by_lower.items()}
    content = content_of(path / INFO, available, asked)
    used = dict.fromkeys(key for key, _ in content.places)
    return available, content, [by_lower[key] for key in used]


def _name(path: Path, number: int) -> str:
    return f"{path}/episode_{number:06d}"


def replace_lerobot(
    path: Path, out: Path, poses: Mapping[str, PoseTrajectory], *, episode: Any = None, **asked: Any
) -> None:
    """Copy a data set, with other poses in the columns that :func:`read_lerobot` reads.

    All else stays to the bit, but for what ``meta`` says of these columns: minima, maxima, means,
    standard deviations and quantiles, of the data set and of each episode.

    Parameters
    ----------
    path, out : Path
        The data set, and the folder to make.
    poses : mapping of str to PoseTrajectory
        By the names of the episodes, which have as many samples.
    episode
        Not used: ``poses`` says which.
    **asked
        As it was read with.
    """
    info = _info(path)
    _, content, named = _content(path, info, Asked(**asked))
    # Files of a hub's cache are links to what is read-only.
    shutil.copytree(path, out, copy_function=shutil.copyfile)
    by_file: dict[Path, list[int]] = {}
    for number, file in _where_episodes_are(out, info).items():
        by_file.setdefault(file, []).append(number)
    of_episodes: dict[int, dict[str, Floats]] = {}
    for file, episodes in by_file.items():
        table = arrow_table(file)
        whole = {key: numbers(file, table, key) for key in named}
        of = numbers(file, table, "episode_index")[:, 0]
        for number in episodes:
            rows = np.flatnonzero(of == number)
            if (new := poses.get(_name(path, number))) is not None:
                lower = {key.lower(): values[rows] for key, values in whole.items()}
                for key, values in content.pose.replaced(
                    file, lower, new.positions, new.quaternions
                ).items():
                    whole[next(name for name in named if name.lower() == key)][rows] = values
            of_episodes[number] = {key: values[rows] for key, values in whole.items()}
        write_columns(file, table, whole)
    with reading(path / "meta", "statistics of LeRobot"):
        _restate(out, info, of_episodes)


def _restate(path: Path, info: dict[str, Any], of: Mapping[int, Mapping[str, Floats]]) -> None:
    """Say anew what ``meta`` says of columns: of the data set, and of each episode."""
    whole = {
        key: np.concatenate([one[key] for one in of.values()]) for key in next(iter(of.values()))
    }
    if (file := path / "meta" / "stats.json").is_file():
        said = json.loads(read_text(file))
        for key in set(said) & set(whole):
            said[key] |= {
                name: _statistic(name, whole[key], old) for name, old in said[key].items()
            }
        write_beside(file, json.dumps(said, indent=4).encode())
    if (file := path / "meta" / "episodes_stats.jsonl").is_file():
        lines = [json.loads(line) for line in read_text(file).splitlines() if line.strip()]
        for line in lines:
            for key, old in line["stats"].items():
                if key in (values := of[line["episode_index"]]):
                    old |= {name: _statistic(name, values[key], was) for name, was in old.items()}
        write_beside(file, "".join(f"{json.dumps(line)}\n" for line in lines).encode())
    if info["codebase_version"].startswith("v3."):
        for file in sorted((path / "meta" / "episodes").glob("*/*.parquet")):
            table = arrow_table(file)
            order = numbers(file, table, "episode_index")[:, 0].astype(int)
            new = {}
            for column in table.column_names:
                prefix, _, rest = column.partition("/")
                key, _, name = rest.rpartition("/")
                if prefix == "stats" and key in whole and name != "count":
                    new[column] = np.array([_statistic(name, of[k][key], None) for k in order])
            write_columns(file, table, new)


def _statistic(name: str, values: Floats, old: Any) -> Any:
    """Return what LeRobot calls so, of each number of a column; what it is not for is as before."""
    plain: dict[str, Callable[..., Floats]] = {
        "min": np.min, "max": np.max, "mean": np.mean, "std": np.std
    }  # fmt: skip
    if name in plain:
        return plain[name](values, axis=0).tolist()
    if re.fullmatch(r"q\d\d", name):
        return np.quantile(values, int(name[1:]) / 100, axis=0).tolist()
    return old


def _episode(
    name: str,
    file: Path,
    of: dict[str, Floats],
    content: Content,
    fps: float,
    understood: dict[str, str],
) -> Samples:
    if not len(of["timestamp"]):
        raise RecordingError(f"{name}: no frames in {file}; is the data set complete?")
    for key, place in content.places:
        if of[key].shape[1] <= place:
            raise RecordingError(
                f"{file}: column {key} holds {of[key].shape[1]} numbers, fewer than {INFO} says"
            )
    stamps, even = of["timestamp"][:, 0], of["frame_index"][:, 0] / fps
    times = even if np.all(np.abs(stamps - even) <= STAMP_TOLERANCE) else stamps
    source = Source(name, "timestamp", "quaternion")
    return Samples(
        name=name,
        source=source,
        times=times,
        **content.samples(source, of),
        understood=[f"{key}: {told}" for key, told in understood.items()],
    )


def _info(path: Path) -> dict[str, Any]:
    file = path / INFO
    try:
        info: dict[str, Any] = json.loads(read_text(file))
    except ValueError as error:
        if isinstance(error, InputError):
            raise
        raise RecordingError(f"{file}: not JSON ({error})") from None
    needed = {"codebase_version": str, "fps": int | float, "data_path": str, "features": dict}
    for key, kind in needed.items():
        if not isinstance(info, dict) or not isinstance(info.get(key), kind):
            raise RecordingError(f"{file}: {key} is missing; LeRobot 2.x or 3.0 is needed")
    if not info["codebase_version"].startswith(("v2.", "v3.")):
        raise RecordingError(
            f"{file}: codebase_version {info['codebase_version']} is not known; v2.x and v3.x are"
        )
    if not (np.isfinite(info["fps"]) and info["fps"] > 0):
        raise RecordingError(f"{file}: fps must be positive, got {info['fps']}")
    return info


def _features(path: Path, info: dict[str, Any]) -> dict[str, Column]:
    """Return the columns of numbers, with the names of what they hold."""
    features = {}
    for key, feature in info["features"].items():
        try:
            shape, dtype = list(feature["shape"]), str(feature["dtype"])
        except (KeyError, TypeError):
            raise RecordingError(f"{path / INFO}: feature {key} lacks a shape or a dtype") from None
        if len(shape) > 1 or not dtype.startswith(("float", "int", "uint")):
            continue
        width = int(shape[0]) if shape else 1
        names = feature.get("names")
        if isinstance(names, dict):  # such as {"motors": [...]}, or {"x": 0, ...}
            lists = [value for value in names.values() if isinstance(value, list)]
            names = [name for one in lists for name in one] if lists else list(names)
        if isinstance(names, list) and len(names) == 1 and isinstance(names[0], list):
            (names,) = names
        fits = isinstance(names, list) and len(names) == width
        features[key] = Column(width, tuple(map(str, names)) if fits and width > 1 else ())
    return features


def _where_episodes_are(path: Path, info: dict[str, Any]) -> dict[int, Path]:
    """Return the file of each episode, in order."""
    template = info["data_path"]
    inside = not Path(template).is_absolute() and ".." not in Path(template).parts
    if not (inside and _TEMPLATE.fullmatch(template)):
        raise RecordingError(
            f"{path / INFO}: data_path {shown(template)} is not a template this version knows, of "
            "a file in the data set"
        )
    try:
        if info["codebase_version"].startswith("v3."):
            return {
                episode: path / template.format(chunk_index=chunk, file_index=file)
                for episode, chunk, file in _episodes_of_v3(path)
            }
        size = int(info.get("chunks_size", 1000))
        return {
            episode: path / template.format(episode_chunk=episode // size, episode_index=episode)
            for episode in _episodes_of_v2(path)
        }
    except (KeyError, IndexError, ValueError, ZeroDivisionError) as error:
        if isinstance(error, InputError):
            raise
        raise RecordingError(
            f"{path / INFO}: data_path {shown(template)} is not a template this version knows"
        ) from None


def _episodes_of_v2(path: Path) -> list[int]:
    file = path / "meta" / "episodes.jsonl"
    episodes = []
    for line, text in enumerate(read_text(file).splitlines(), start=1):
        if text.strip():
            try:
                episodes.append(int(json.loads(text)["episode_index"]))
            except (ValueError, KeyError, TypeError):
                raise RecordingError(f"{file}: line {line}: no episode_index in it") from None
    return sorted(episodes)


def _episodes_of_v3(path: Path) -> list[tuple[int, int, int]]:
    """Return episode, chunk and file, from every table of meta/episodes."""
    keys = ("episode_index", "data/chunk_index", "data/file_index")
    found = sorted((path / "meta" / "episodes").glob("*/*.parquet"))
    if not found:
        raise RecordingError(f"{path}: no tables in meta/episodes; is the data set complete?")
    rows: list[tuple[int, int, int]] = []
    for file in found:
        table = arrow_table(file, keys)
        columns = [numbers(file, table, key)[:, 0].astype(int).tolist() for key in keys]
        rows += zip(*columns, strict=True)
    return sorted(rows)


LEROBOT = Format(
    name="a LeRobot data set",
    read=read_lerobot,
    options=("episode", "columns", "units", "rotation", "robot"),
    folders="LeRobot data sets",
    is_folder=is_lerobot,
    replace=replace_lerobot,
    extra="tables",
)
"""A folder."""
