"""The motions that are shown, what belongs to each, and the scene that they make."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
import viser

from noslip._typing import Floats
from noslip.constraints.declaration import Constraint
from noslip.constraints.moving_frame import InMovingFrame
from noslip.constraints.of_body import OfBody
from noslip.constraints.system import ConstraintSystem
from noslip.constraints.wheel import Wheel
from noslip.edge import Edge
from noslip.errors import InputError
from noslip.identification import Identified
from noslip.primitive import ConstrainedDMP
from noslip.space import Space
from noslip.trajectory import PoseTrajectory
from noslip.vectors import Trajectory
from noslip.viewer.arm import Arm, Simulation
from noslip.viewer.changes import Adapted, Adapter, Wish
from noslip.viewer.drawing import Drawing, Follower, legend
from noslip.viewer.links import Links, carrier_of
from noslip.viewer.shapes import shapes
from noslip.viewer.tool import Part, cart, scalpel
from noslip.viewer.track import Moving, Track

Shown = Moving | ConstrainedDMP | Simulation
"""What a page takes: a recording, a primitive, or what ``noslip simulate`` wrote."""
RECORDED = "What was recorded or executed stays as it is; choose a primitive."
"""Told where a goal would be changed."""
LEAST_WORST = 1e-3
"""Violation that has the last color, at least: what holds must not look as if it did not."""
REACH_OF_A_HAND = 1.0
"""Extent of a motion (m) beyond which no hand held the tool without moving up or down."""
_LEVEL = 1e-6
"""Meters, and parts of a unit quaternion, by which a vehicle may leave its plane: files round."""
TOOL_LENGTH = 0.45
"""Of the scalpel, over the scene's size: its turning is seen, and it hides little of the path."""

CART_LENGTH = 0.22
"""Of a cart: it lies on its path, which is to be seen."""


@dataclass
class Entry:
    """A motion on the page as it is shown now, and the primitive that it came from, if it did.

    ``primitive`` is as it was learned, ``current`` as it was adapted last; there is none where
    nothing can be changed here, for which ``fixed`` is the reason.  ``found`` is what holds
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
    fixed: str = RECORDED

    @property
    def held(self) -> tuple[Constraint, ...]:
        """What a shield holds: what was found, and the limits; without it, all that is checked."""
        constraints = [c for c in self.track.system.constraints if of_a_tool(c)]
        found = self.found.constraints if isinstance(self.found, Identified) else ()
        if not (self.sought and found):
            return tuple(constraints)
        return (*found, *(c for c in constraints if c.relation != "zero"))


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
    found: dict[str, Entry] = {}
    for name, what in shown.items():
        entry = _entry(name, what, held_by(what, shown.values(), constraints))
        entry.follower = followers.get(name, entry.follower)
        found[node_name(name, found)] = entry
    return found


def held_by(
    what: Shown, beside: Iterable[Shown], constraints: Sequence[Constraint]
) -> ConstraintSystem:
    """Return what a motion is checked against: its own constraints, and what is asked for.

    Recordings have none; they are checked against what others beside them declare, where that can
    be said of them.
    """
    space = _space(what)
    if not isinstance(what, Moving):
        return ConstraintSystem(unique([*what.constraints, *constraints]), space)
    others = [other for other in beside if not isinstance(other, Moving)]
    declared = [c for o in others for c in o.constraints if _space(o) == space or of_a_tool(c)]
    return ConstraintSystem(unique([*constraints, *declared]), space)


def of_a_tool(constraint: Constraint) -> bool:
    """Whether a constraint is of the one tool that there is, whatever carries it."""
    return not (constraint.coordinates or constraint.body)


def _space(what: Shown) -> Space:
    if isinstance(what, ConstrainedDMP):
        return what.law.space
    return what.executed.space if isinstance(what, Simulation) else what.space


def _entry(name: str, what: Shown, held: ConstraintSystem) -> Entry:
    if isinstance(what, Simulation):
        track = Track.of(name, what.executed, held, what.commanded, "the commanded motion")
        return Entry(track, follower=what.arm)
    if isinstance(what, ConstrainedDMP):
        track = Track.of(name, what.rollout(), held, what.regular.rollout())
        if what.law.clock.returns:
            entry = Entry(track, fixed="A rhythm has no goal: it goes round; see noslip adapt.")
        elif track.whole is not None:
            entry = Entry(track, fixed="Only poses of one tool are dragged here; see noslip adapt.")
        else:
            entry = Entry(track, what, Adapter(what), what)
    else:
        entry = Entry(Track.of(name, what, held))
    if isinstance(whole := entry.track.whole, Trajectory) and whole.carrier is not None:
        entry.follower = carrier_of(whole.carrier, whole.values)
    return entry


def drawn(
    server: viser.ViserServer,
    shown: Mapping[str, Entry],
    tool: Sequence[Part] | None = None,
) -> Drawing:
    """Draw entries on a server, at the beginning of their motions."""
    tracks = [entry.track for entry in shown.values()]
    motions = [motion for track in tracks for motion in (track.motion, *track.beside.values())]
    center, size = extent(motions)
    constraints = unique([c for track in tracks for c in track.system.constraints])
    if tool is None:
        tool = suitable_tool(tracks, size)
    low = min(float(motion.positions[:, 2].min()) for motion in motions)
    arms = (entry.follower for entry in shown.values())
    points = next((arm.points for arm in arms if isinstance(arm, Arm | Links)), None)
    drawing = Drawing(server, tool, center=center, size=size, floor=low, arm=points)
    drawing.add_shapes(shapes(constraints, center, size))
    for name, entry in shown.items():
        drawing.put(name, entry.track, worst(shown), entry.follower)
    drawing.move(0.0)
    return drawing


def suitable_tool(tracks: Sequence[Track], size: float) -> list[Part]:
    """Return a scalpel along the constraints' axes, its handle on the upper side; or a cart.

    A cart is what a wheel carries, and what moves in a plane, farther than a hand reaches.
    """
    edged = next((track.edged for track in tracks if track.edged is not None), None)
    edge = edged.edge if edged and edged.edge and edged.edge.lateral else Edge()
    motions = [track.motion for track in tracks]
    make, share = (cart, CART_LENGTH) if _drives(edged, motions) else (scalpel, TOOL_LENGTH)
    tool = make(share * size, edge)
    handle = tool[-1].vertices.mean(axis=0)
    up = float(np.mean([motion.rotations.apply(handle)[:, 2].mean() for motion in motions]))
    return tool if up >= 0 else make(share * size, edge, flip=True)


def _drives(edged: Constraint | None, motions: Sequence[PoseTrajectory]) -> bool:
    while isinstance(edged, OfBody | InMovingFrame):
        edged = edged.inner
    if edged is not None:
        return isinstance(edged, Wheel)
    ways = max(float(np.linalg.norm(np.ptp(motion.positions, axis=0))) for motion in motions)
    return ways > REACH_OF_A_HAND and all(_is_level(motion) for motion in motions)


def _is_level(motion: PoseTrajectory) -> bool:
    """Whether it keeps its height, and turns about z alone."""
    height = np.ptp(motion.positions[:, 2])
    return bool(height <= _LEVEL and np.abs(motion.quaternions[:, 1:3]).max() <= _LEVEL)


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
