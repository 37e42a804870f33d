"""Motions that a command is given, whatever holds them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from noslip.cli import options
from noslip.constraints.declaration import Constraint
from noslip.primitive import ConstrainedDMP
from noslip.saving import load_primitive
from noslip.trajectory import PoseTrajectory


def is_primitive(name: str) -> bool:
    """Whether an argument is a primitive's file; there are no recordings in JSON."""
    return name.endswith(".json")


def is_simulated(name: str) -> bool:
    """Whether it is a folder that noslip simulate wrote."""
    # The package is large, and asked for by few: its file is known by name.
    return (Path(name) / "summary.json").is_file()


@dataclass(frozen=True)
class Found:
    """Recordings, primitives rolled out, and what simulated arms executed.

    Attributes
    ----------
    motions : mapping of name to trajectory
        By the shortest name that tells them apart.
    primitives : mapping of file to ConstrainedDMP
    constraints : list of Constraint
        That primitives and simulated arms hold, each once.
    """

    motions: dict[str, PoseTrajectory]
    primitives: dict[str, ConstrainedDMP]
    constraints: list[Constraint]

    @classmethod
    def of(cls, names: list[str], given: options.Loading) -> Found:
        """Read what arguments name: recordings first, as the options ask."""
        primitives = {name: load_primitive(name) for name in names if is_primitive(name)}
        arms = [name for name in names if is_simulated(name)]
        recordings = [name for name in names if name not in {*primitives, *arms}]
        motions: dict[str, PoseTrajectory] = {}
        held: list[Constraint] = []
        if recordings:
            for trajectory in given.load(recordings):
                motions[_label(trajectory.name, motions)] = trajectory
        for name, primitive in primitives.items():
            motions[_label(name, motions)] = replace(primitive.rollout(), name=name)
            held += [c for c in primitive.constraints if c not in held]
        for name in arms:
            from noslip.robots.folder import read_folder

            written = read_folder(name)
            motions[_label(name, motions)] = written.executed
            held += [c for c in written.constraints if c not in held]
        return cls(motions, primitives, held)


def _label(name: str, taken: dict[str, PoseTrajectory]) -> str:
    """Short name of a file, longer where two would be the same."""
    short = Path(name).stem
    return short if short not in taken else name
