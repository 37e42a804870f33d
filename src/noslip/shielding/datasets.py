"""Recordings and data sets that keep constraints: each recording is projected as a whole.

A policy's chunks are projected as they come (:meth:`noslip.Shield.chunk`).  Of a recording all is
known, so the nearest feasible motion is that of the whole: no join, and no hold.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from types import MappingProxyType
from typing import Any

from noslip._files import making
from noslip._samples import Mending
from noslip.constraints.check import checked
from noslip.constraints.declaration import Constraint
from noslip.constraints.system import ConstraintSystem, as_system
from noslip.demonstrations.preparation import prepare
from noslip.errors import ConvergenceError, InputError
from noslip.projection.request import LEARNING, Weights
from noslip.projection.trajectory import project_trajectory
from noslip.recordings import load_demonstrations, write_recording
from noslip.recordings.formats import WRITTEN, expand, format_of
from noslip.trajectory import PoseTrajectory
from noslip.verification import deviations

WRITES = tuple(suffix for suffix in WRITTEN if suffix)
"""Suffixes of files that a recording is written to as it was read; of others as CSV."""


@dataclass(frozen=True, kw_only=True)
class ShieldedRecording:
    """What became of one recording: a row of the table.

    Attributes
    ----------
    name : str
    samples : int
    moved_mean, moved_max : float
        Distance from the recorded position (m).
    turned_mean, turned_max : float
        Angle from the recorded rotation (rad).
    slip_before, slip_after : float or None
        Way slipped under the worst constraint (m), None where none is of velocity in m/s; after
        means as it was written, with its rounding.
    residual_before, residual_after : float
        Largest violation of a constraint, in its unit.
    message : str
        Why it stands as it was recorded; empty if it does not.
    """

    name: str
    samples: int
    moved_mean: float
    moved_max: float
    turned_mean: float
    turned_max: float
    slip_before: float | None
    slip_after: float | None
    residual_before: float
    residual_after: float
    message: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Plain data, for JSON."""
        return asdict(self)


def shield_each(
    recordings: str | Path | Iterable[str | Path],
    constraints: ConstraintSystem | Constraint | Sequence[Constraint],
    out: str | Path,
    *,
    preparation: Mapping[str, Any] = MappingProxyType({}),
    weights: Weights = LEARNING,
    progress: Callable[[int, int], None] | None = None,
    **loading: Any,
) -> list[ShieldedRecording]:
    """Write recordings that keep constraints, nearest to those given, and say how far they moved.

    Parameters
    ----------
    recordings : path, glob or iterable of them
        A LeRobot data set or a robomimic file, which is copied with other poses in the columns that
        they were read from; or files, each of which becomes a file of its name in a folder.
    constraints : ConstraintSystem or constraints
    out : path
        The copy, or the folder; nothing is there yet.
    preparation : mapping
        Of :func:`noslip.prepare`, for files.
    weights : Weights
        Of the projection.
    progress : callable, optional
        Called with (done, total).
    **loading
        Of :func:`noslip.load_demonstrations`.

    Returns
    -------
    list of ShieldedRecording
        One of each, in order.  Where no feasible trajectory near it is found, its message says so:
        in a data set it stands as it was recorded, and no file is written.

    Raises
    ------
    InputError
        If ``out`` is there, a data set comes with other recordings or is to be prepared or mended,
        or for what :func:`noslip.load_demonstrations` names.
    """
    system = as_system(constraints)
    if not system.constraints:
        raise InputError("shielding needs at least one constraint")
    given = [recordings] if isinstance(recordings, (str, Path)) else list(recordings)
    files = list(dict.fromkeys(file for path in given for file in expand(path)))
    found = load_demonstrations(files, **loading)
    steps = {name: value for name, value in preparation.items() if value and name != "order"}
    replace = next((format_of(file).replace for file in files), None)
    if replace is None:
        found = [prepare(recording, **preparation) for recording in found] if steps else found
    elif len(files) > 1:
        raise InputError(f"{files[0]}: a data set; shield one at a time")
    elif steps or {f.name: loading.get(f.name, f.default) for f in fields(Mending)} != vars(
        Mending()
    ):
        raise InputError(
            f"{files[0]}: a data set keeps its samples and its frame; leave out what prepares or "
            "mends recordings, and give the constraint the tool's own axes and point"
        )
    motions = projected(found, system, weights, progress)
    with making(Path(out)) as beside:
        if replace is None:
            after = _written(beside, found, motions)
        else:
            taken = format_of(files[0]).options
            asked = {name: value for name, value in loading.items() if name in taken}
            new = {
                old.name: m for old, m in zip(found, motions, strict=True) if not isinstance(m, str)
            }
            replace(files[0], beside, new, **asked)
            # What single precision has left of them counts, not what was meant.
            after = load_demonstrations(beside, **loading)
    return [
        told(old, new, system, motion if isinstance(motion, str) else "")
        for old, new, motion in zip(found, after, motions, strict=True)
    ]


def projected(
    recordings: Sequence[PoseTrajectory],
    system: ConstraintSystem,
    weights: Weights,
    progress: Callable[[int, int], None] | None = None,
) -> list[PoseTrajectory | str]:
    """Return of each recording the nearest feasible trajectory, or why none was found."""
    motions: list[PoseTrajectory | str] = []
    for done, recording in enumerate(recordings, start=1):
        try:
            found = project_trajectory(
                recording,
                system,
                position_weight=weights.position,
                position_smoothing=weights.position_smoothing,
                rotation_smoothing=weights.rotation_smoothing,
            )
            motions.append(found.trajectory)
        except ConvergenceError as error:
            motions.append(str(error))
        if progress is not None:
            progress(done, len(recordings))
    return motions


def _written(
    folder: Path, recordings: Sequence[PoseTrajectory], motions: Sequence[PoseTrajectory | str]
) -> list[PoseTrajectory]:
    """Write each in a file of its recording's name; return them as written."""
    folder.mkdir()
    taken: dict[str, str] = {}
    for recording, motion in zip(recordings, motions, strict=True):
        path = Path(recording.name)
        suffix = path.suffix.lower() if path.suffix.lower() in WRITES else ".csv"
        file = f"{path.stem}{suffix}"
        if (other := taken.setdefault(file.casefold(), recording.name)) != recording.name:
            raise InputError(f"{recording.name}: would be {file}, as {other}; rename one")
        if isinstance(motion, PoseTrajectory):
            write_recording(motion, folder / file)
    pairs = zip(recordings, motions, strict=True)
    return [recording if isinstance(motion, str) else motion for recording, motion in pairs]


def told(
    before: PoseTrajectory, after: PoseTrajectory, system: ConstraintSystem, message: str = ""
) -> ShieldedRecording:
    """Say how far a motion is from its recording, and what both slip."""
    distances, angles = deviations(after, before)
    found = [checked(motion, system).constraints for motion in (before, after)]
    slips = [[c.slip_distance for c in each if c.slip_distance is not None] for each in found]
    return ShieldedRecording(
        name=before.name,
        samples=len(before),
        moved_mean=float(distances.mean()),
        moved_max=float(distances.max()),
        turned_mean=float(angles.mean()),
        turned_max=float(angles.max()),
        slip_before=max(slips[0], default=None),
        slip_after=max(slips[1], default=None),
        residual_before=max(c.peak for c in found[0]),
        residual_after=max(c.peak for c in found[1]),
        message=message,
    )
