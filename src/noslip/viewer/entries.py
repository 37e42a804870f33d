"""The motions that are shown, what belongs to each, and the scene that they make."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
import viser

from noslip._typing import Floats
from noslip.constraints.declaration import Constraint
from noslip.constraints.system import ConstraintSystem
from noslip.edge import Edge
from noslip.errors import InputError
from noslip.identification import Identified
from noslip.primitive import ConstrainedDMP
from noslip.trajectory import PoseTrajectory
from noslip.viewer.arm import Arm, Simulation
from noslip.viewer.changes import Adapted, Adapter, Wish
from noslip.viewer.drawing import Drawing, Follower, legend
from noslip.viewer.shapes import shapes
from noslip.viewer.tool import Part, scalpel
from noslip.viewer.track import Track

Shown = PoseTrajectory | ConstrainedDMP | Simulation
"""What a page takes: a recording, a primitive, or what ``noslip simulate`` wrote."""
LEAST_WORST = 1e-3
"""Violation that has the last color, at least: what holds must not look as if it did not."""
TOOL_LENGTH = 0.45
"""Of the scalpel, over the scene's size: its turning is seen, and it hides little of the path."""


@dataclass
class Entry:
    """A motion on the page as it is shown now, and the primitive that it came from, if it did.

    ``primitive`` is as it was learned, ``current`` as it was adapted last.  ``found`` is what holds
    in a recording, or a line that says why that is not known (yet); it is shown while ``sought``.
    """

    track: Track
    primitive: ConstrainedDMP | None = None
    adapter: Adapter | None = None
    current: ConstrainedDMP | None = None
    wish: Wish = field(default_factory=Wish)
    outcome: Adapted | None = None
    follower: Follower | None = None
    found: Identified | str | None = None
    sought: bool = False

    @property
    def held(self) -> tuple[Constraint, ...]:
        """What a shield holds: what was found, and the limits; without it, all that is checked."""
        system = self.track.system
        found = self.found.constraints if isinstance(self.found, Identified) else ()
        if not (self.sought and found):
            return system.constraints
        return (*found, *system.limits.constraints)


def entries(
    shown: Mapping[str, Shown],
    constraints: Sequence[Constraint] = (),
    followers: Mapping[str, Follower] = MappingProxyType({}),
) -> dict[str, Entry]:
    """Prepare recordings, primitives and simulations, by name; primitives are rolled out.

    Constraints are what recordings are checked against, and primitives and simulations besides
    their own; recordings beside these are checked against theirs too.  A follower has the name of
    its motion; a simulation has its arm.
    """
    for name in followers:
        if name not in shown:
            raise InputError(
                f"followers: there is no motion {name!r}; there are {', '.join(shown)}"
            )
    declaring = [what for what in shown.values() if not isinstance(what, PoseTrajectory)]
    asked = [*constraints, *(c for what in declaring for c in what.constraints)]
    found: dict[str, Entry] = {}
    for name, what in shown.items():
        own = asked if isinstance(what, PoseTrajectory) else [*what.constraints, *constraints]
        held = ConstraintSystem(unique(own))
        if isinstance(what, ConstrainedDMP):
            track = Track(name, what.rollout(), held, what.regular.rollout())
            entry = Entry(track, what, Adapter(what), what)
        elif isinstance(what, Simulation):
            track = Track(name, what.executed, held, what.commanded, "the commanded motion")
            entry = Entry(track, follower=what.arm)
        else:
            entry = Entry(Track(name, what, held))
        entry.follower = followers.get(name, entry.follower)
        found[node_name(name, found)] = entry
    return found


def drawn(
    server: viser.ViserServer,
    shown: Mapping[str, Entry],
    tool: Sequence[Part] | None = None,
) -> Drawing:
    """Draw entries on a server, at the beginning of their motions."""
    motions = [entry.track.motion for entry in shown.values()]
    center, size = extent(motions)
    constraints = unique([c for e in shown.values() for c in e.track.system.constraints])
    if tool is None:
        tool = suitable_scalpel(motions, constraints, size)
    low = min(float(motion.positions[:, 2].min()) for motion in motions)
    arms = (entry.follower for entry in shown.values())
    points = next((arm.points for arm in arms if isinstance(arm, Arm)), None)
    drawing = Drawing(server, tool, center=center, size=size, floor=low, arm=points)
    drawing.add_shapes(shapes(constraints, center, size))
    for name, entry in shown.items():
        drawing.put(name, entry.track, worst(shown), entry.follower)
    drawing.move(0.0)
    return drawing


def suitable_scalpel(
    motions: Sequence[PoseTrajectory], constraints: Sequence[Constraint], size: float
) -> list[Part]:
    """Return a scalpel along the constraints' axes, its handle on the upper side."""
    edged = ConstraintSystem(constraints).edged
    edge = edged.edge if edged and edged.edge and edged.edge.lateral else Edge()
    tool = scalpel(TOOL_LENGTH * size, edge)
    handle = tool[-1].vertices.mean(axis=0)
    up = float(np.mean([motion.rotations.apply(handle)[:, 2].mean() for motion in motions]))
    if up >= 0:
        return tool
    return scalpel(TOOL_LENGTH * size, edge, flip=True)


def worst(shown: Mapping[str, Entry]) -> float:
    """Violation that has the last color: the largest of all motions."""
    return max(LEAST_WORST, *(float(entry.track.violation.max()) for entry in shown.values()))


def key(shown: Mapping[str, Entry], track: Track) -> str:
    """Return what the colors of the trails and of a motion's arrows mean, as HTML."""
    largest = max((entry.track for entry in shown.values()), key=lambda t: t.violation.max())
    unit = largest.report.worst.unit if largest.report else ""
    return legend(worst(shown), unit, track.arrows(len(track.motion) // 2, 1.0))


def unique(constraints: Sequence[Constraint]) -> list[Constraint]:
    """Return constraints without those that are there already."""
    found: list[Constraint] = []
    for constraint in constraints:
        if constraint not in found:
            found.append(constraint)
    return found


def extent(motions: list[PoseTrajectory]) -> tuple[Floats, float]:
    """Center (m), shape (3,), and size (m) of a scene: of the box about all paths."""
    points = np.concatenate([motion.positions for motion in motions])
    low, high = points.min(axis=0), points.max(axis=0)
    # A tool that only turns has no path; it is looked at from 10 cm.
    return (low + high) / 2, float(np.linalg.norm(high - low)) or 0.1


def node_name(name: str, taken: Mapping[str, object]) -> str:
    """Return a motion's name as a node of the scene: short, without slashes, and not yet taken."""
    short = re.sub(r"[^\w.+-]+", "_", re.split(r"[/\\]", name)[-1]) or "motion"
    numbered = (short if k == 1 else f"{short}_{k}" for k in range(1, len(taken) + 2))
    return next(candidate for candidate in numbered if candidate not in taken)
