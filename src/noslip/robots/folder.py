"""What ``noslip simulate`` left in a folder."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from scipy.spatial.transform import Rotation

from noslip.constraints.declaration import Constraint
from noslip.document import Reader, read_json
from noslip.errors import InputError
from noslip.robots.placement import Placement
from noslip.trajectory import PoseTrajectory

SUMMARY = "summary.json"
"""By which such a folder is known."""
_FIELDS = ("robot", "model", "tool", "placement", "constraints")
"""Of the summary, by which the arm and its motion are found again."""


@dataclass(frozen=True, eq=False)
class SimulatedFolder:
    """An arm's motion as it was written.

    Attributes
    ----------
    summary : mapping
        As JSON has it.
    placement : Placement
        Where the motion's own world lies, seen from the base.
    constraints : tuple of Constraint
        Of the primitive.
    executed : PoseTrajectory
        Of the tool, in the motion's own world.
    """

    summary: dict[str, Any]
    placement: Placement
    constraints: tuple[Constraint, ...]
    executed: PoseTrajectory


def read_folder(path: str | Path) -> SimulatedFolder:
    """Read what the tool of a simulated arm did.

    Raises
    ------
    InputError
        If a file or a field is missing or damaged.
    """
    folder = Path(path)
    file = folder / SUMMARY
    found = read_json(file, "a summary of noslip simulate")
    summary: dict[str, Any] = found if isinstance(found, dict) else {}
    if missing := [field for field in _FIELDS if field not in summary]:
        raise InputError(
            f"{file}: no field {missing[0]}; it is of an older noslip or of another program: "
            "simulate again"
        )
    read = Reader(file)
    place = read.part(summary, "placement")
    turn = read.array(place, "quaternion", (4,))
    placement = Placement(
        read.array(place, "position", (3,)),
        read.field(place, "quaternion", lambda _: Rotation.from_quat(turn, scalar_first=True)),
    )
    tool = PoseTrajectory.from_csv(folder / "tool.csv")
    return SimulatedFolder(
        summary,
        placement,
        read.system(summary).constraints,
        replace(placement.undo(tool), name=folder.name),
    )
