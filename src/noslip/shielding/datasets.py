"""Recordings and data sets that keep constraints: through a shield, each as one chunk.

A policy's chunks come one by one.  Of a recording all is known, so the nearest motion is that of
the whole: there are no joins, and what a tool must make up for it makes up for in time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from types import MappingProxyType
from typing import Any, Unpack

import numpy as np
from scipy.spatial.transform import Rotation

from noslip._files import making
from noslip._instants import seconds
from noslip._samples import Mending
from noslip.constraints.check import checked
from noslip.constraints.declaration import Constraint
from noslip.constraints.system import ConstraintSystem, as_system
from noslip.demonstrations.preparation import prepare
from noslip.errors import CompromiseWarning, InputError, muted, warn
from noslip.recordings import load_demonstrations, write_recording
from noslip.recordings.formats import WRITTEN, ReadingColumns, expand, format_of
from noslip.shielding.shield import Shield
from noslip.trajectory import PoseTrajectory
from noslip.verification import deviations

WRITES = tuple(suffix for suffix in WRITTEN if suffix)
"""Suffixes of files that a recording is written to as it was read; of others as CSV."""
LONGEST = 1000
"""Poses of a recording that are one chunk: smoothing them takes a second, cubic in their count."""
LENGTH = 100
"""Poses of a chunk where the whole must hold: three seconds of most data sets, of which half are
executed."""


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
    held : str
        What of it the motion does not do, and why: where no way near it keeps the constraints, the
        tool brakes and holds.  Empty if it does all.
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
    held: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Plain data, for JSON."""
        return asdict(self)


def shield_each(
    recordings: str | Path | Iterable[str | Path],
    constraints: ConstraintSystem | Constraint | Sequence[Constraint],
    out: str | Path,
    *,
    preparation: Mapping[str, Any] = MappingProxyType({}),
    progress: Callable[[int, int], None] | None = None,
    **loading: Unpack[ReadingColumns],
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
    progress : callable, optional
        Called with (done, total).
    **loading
        Of :func:`noslip.load_demonstrations`.

    Returns
    -------
    list of ShieldedRecording
        One of each, in order.

    Warns
    -----
    CompromiseWarning
        Of a recording in which the tool holds.

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
    motions, held = [], []
    for done, recording in enumerate(found, start=1):
        motion, text = shielded(recording, system)
        motions.append(motion)
        held.append(text)
        if progress is not None:
            progress(done, len(found))
    with making(Path(out)) as beside:
        if replace is None:
            _write(beside, motions)
        else:
            taken = format_of(files[0]).options
            asked = {name: value for name, value in loading.items() if name in taken}
            replace(files[0], beside, {motion.name: motion for motion in motions}, **asked)
            # What single precision has left of them counts, not what was meant.
            motions = load_demonstrations(beside, **loading)
    return [
        told(recording, motion, system, text)
        for recording, motion, text in zip(found, motions, held, strict=True)
    ]


def shielded(recording: PoseTrajectory, system: ConstraintSystem) -> tuple[PoseTrajectory, str]:
    """Return the nearest motion that keeps constraints, and what of the recording it does not do.

    It is that of the whole; where that must hold, that of one chunk after the other, which holds
    for as long as it must.
    """
    texts: list[str] = []
    for length in (LONGEST, LENGTH):
        with muted():
            motion, texts = _in_chunks(recording, system, length)
        if not texts:
            break
    text = "; ".join(dict.fromkeys(texts))
    if text:
        warn(f"{recording.name}: {text}", CompromiseWarning)
    return motion, text


def _in_chunks(
    recording: PoseTrajectory, system: ConstraintSystem, length: int
) -> tuple[PoseTrajectory, list[str]]:
    """Return the motion of chunks of a length, each carried out by half, and what is told."""
    shield = Shield(system, rate=1 / recording.period)
    parts: list[PoseTrajectory] = []
    texts = []
    for first in range(0, max(1, len(recording) - length // 2), length // 2):
        last = first + length >= len(recording)
        done = length // 2 if parts else None
        motion = shield.chunk(recording[first : first + length], done)
        parts.append(motion if last else motion[: length // 2])
        if shield.compromise:
            when = seconds(recording.times[first], recording.times[0], 3)
            texts.append(f"from {when} on {shield.compromise}")
        if last:
            break
    positions = np.concatenate([part.positions for part in parts])
    rotations = Rotation.concatenate([part.rotations for part in parts])
    found = PoseTrajectory(
        recording.times, positions, rotations, name=recording.name, channels=recording.channels
    )
    return found, texts


def _write(folder: Path, motions: Sequence[PoseTrajectory]) -> None:
    """Write each in a file of its recording's name."""
    folder.mkdir()
    taken: dict[str, str] = {}
    for motion in motions:
        path = Path(motion.name)
        suffix = path.suffix.lower() if path.suffix.lower() in WRITES else ".csv"
        file = f"{path.stem}{suffix}"
        if (other := taken.setdefault(file.casefold(), motion.name)) != motion.name:
            raise InputError(f"{motion.name}: would be {file}, as {other}; rename one")
        write_recording(motion, folder / file)


def told(
    before: PoseTrajectory, after: PoseTrajectory, system: ConstraintSystem, held: str = ""
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
        held=held,
    )
