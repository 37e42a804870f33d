"""Where joints carry a tool, its motion comes first, and then the joints that make it.

The joints nearest to a demonstration whose tool does not slip move that tool aside rather than turn
it: joints know nothing of its path.  Of contours that hands followed, at 7 joints, the path is left
by 6 mm.  So the tool's motion is projected as any other is, where the rotation gives way before the
path; joints nearest to the reference make that motion (redundant ones stay as they were), and
become the reference of the projection that holds constraints of the tool and of the joints at once.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from noslip._typing import Floats
from noslip.boundary import Boundary, End, kept_twist
from noslip.chain import Chain
from noslip.constraints.system import ConstraintSystem
from noslip.errors import ConvergenceError, InputError, Refusal
from noslip.projection.request import Request
from noslip.projection.result import ProjectedTrajectory
from noslip.quaternions import turns_between
from noslip.space import Samples, Space
from noslip.trajectory import PoseTrajectory


def carrier_of(space: Space) -> Chain | None:
    """Return the joints that carry the one body of a space; None if none do."""
    carrier = space.carrier if len(space.bodies) == 1 else None
    return carrier if isinstance(carrier, Chain) else None


def tool_of(trajectory: Any, space: Space) -> Any:
    """Return the motion of the tool that joints carry; where none do, the trajectory itself."""
    carrier = carrier_of(space)
    if carrier is None:
        return trajectory
    return carrier.poses(trajectory.times, trajectory.positions, name=trajectory.name)


def projected_tool(found: ProjectedTrajectory, reference: Samples, space: Space) -> Any:
    """Return a projection as one of the tool, where joints carry it."""
    if carrier_of(space) is None:
        return found
    tool, before = tool_of(found.trajectory, space), tool_of(reference, space)
    turns = turns_between(before.quaternions, tool.quaternions)
    return replace(found, trajectory=tool, turns=turns)


def kept_ends(
    trajectory: Samples, space: Space, start: End, end: End
) -> tuple[tuple[Boundary, Boundary], tuple[End, End]]:
    """Return what is kept of the first and last sample, and what of the tool's pose there.

    Of joints that carry a tool, "position" and "rotation" are the tool's; "pose" is all joints.
    """
    kept = start, end
    first, last = (
        Boundary.keeping(trajectory, at, what) for at, what in zip((0.0, 1.0), kept, strict=True)
    )
    if carrier_of(space) is not None:
        first, last = (
            boundary if what == "pose" else boundary.part("free")
            for boundary, what in zip((first, last), kept, strict=True)
        )
    return (first, last), kept


def tool_request(request: Request) -> Request | None:
    """Return what is asked of the tool alone; None where no joints carry one, or it is free."""
    carrier = carrier_of(request.system.space)
    if carrier is None:
        return None
    system = ConstraintSystem(c for c in request.system.constraints if not c.coordinates)
    if not (system.size or request.hold_position):
        return None
    reference = request.reference
    tool = carrier.poses(reference.times, reference.positions, name=reference.name)
    ends = {
        at: _kept(tool, at, what) for at, what in zip((0.0, 1.0), request.tool_ends, strict=True)
    }
    passed = {b.at: _of_tool(b, carrier, ends.get(b.at)) for b in request.fixed.values()}
    share = tool.path_length / (reference.path_length or 1.0)
    return replace(
        request,
        reference=tool,
        system=system,
        boundaries=tuple((ends | passed).values()),
        tool_ends=("free", "free"),
        clearance=request.clearance * share,
        length=0.0,
    )


def led_by(request: Request, found: ProjectedTrajectory) -> Request:
    """Return a request whose reference are the joints nearest to it that move the tool as found.

    Where the tool's motion was not found, or is out of reach, it is the request as it was.

    Raises
    ------
    ConvergenceError
        If it is that, and the tool's positions were to be held.
    """
    carrier = carrier_of(request.system.space)
    assert carrier is not None
    reference, why = request.reference, "its projection does not converge"
    if found.converged:
        try:
            joints = carrier.inverse(found.trajectory, reference.positions)
        except InputError as error:
            why = str(error)
        else:
            for k, boundary in request.fixed.items():
                # To the bit.
                if boundary.position is not None:
                    joints[k] = boundary.position
            return replace(request, reference=reference.with_points(joints), hold_position=False)
    if request.hold_position:
        raise ConvergenceError(
            f"{reference.name}: no joints hold the positions of the tool: {why}; let them give way "
            "(hold_position=False)",
            code=Refusal.NOT_FOUND,
            iterate=reference,
        )
    return request


def _kept(tool: PoseTrajectory, at: float, what: End) -> Boundary:
    """What an end keeps of the tool's pose; a tool at rest does not turn."""
    at_rest = not np.any(np.hstack(kept_twist(tool, at)))
    still = np.zeros(3) if at_rest else None
    return replace(Boundary.keeping(tool, at, what), angular_velocity=still)


def _of_tool(boundary: Boundary, carrier: Chain, kept: Boundary | None) -> Boundary:
    """What a boundary of the joints is for the tool, of whose pose there something is kept."""
    joints = boundary.position
    if joints is None:
        # At rest, wherever that is.
        at_rest = kept or Boundary(boundary.at)
        return replace(at_rest, linear_velocity=np.zeros(3), angular_velocity=np.zeros(3))
    position, rotation = carrier.forward(joints)
    rates: Floats | None = boundary.linear_velocity
    if rates is None:
        return Boundary(boundary.at, position, rotation)
    moving = carrier.poses([0.0, 1.0], [joints] * 2, [rates] * 2)
    twist = moving.linear_velocities[0], moving.angular_velocities[0]
    return Boundary(boundary.at, position, rotation, *twist)
