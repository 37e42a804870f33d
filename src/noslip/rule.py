"""What a primitive must: constraints, who gives way for them, and how fast violations decay."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from noslip import _arguments
from noslip._values import LONGEST_REPR, Value, shortened
from noslip.constraints.system import ConstraintSystem
from noslip.projection.pointwise import Push, position_only
from noslip.space import Space

STABILIZATION = 20.0
"""How fast a violation at the start decays, per duration: gone, to e^-20, when the motion ends."""
BARRIER_RATE = 300.0
"""How fast the margin of a limit may shrink that names no rate of its own, per duration: limits are
felt within the last hundredths of a motion before them, and not where they are far."""


@dataclass(frozen=True, eq=False)
class Rule(Value):
    """What holds at every step; empty for a primitive without constraints.

    Attributes
    ----------
    system : ConstraintSystem
    inverse_metric : tuple of floats
        Diagonal of M^-1: who gives way at run time; position only by default, as in the paper.
    push : "steering" or "force"
        Along what a correction acts: a turn of the tool through the way of half a step, so that it
        moves where it is steered to; or a force on the body, along the rows.  By default steering
        where the metric lets the rotation share the correction with the position.
    stabilization : float
        Rate at which a violation present at the start decays, per duration.
    barrier_rate : float
        Rate at which the margins of limits may shrink that name none of their own, per duration.
    """

    system: ConstraintSystem = field(default_factory=ConstraintSystem)
    inverse_metric: tuple[float, ...] = None  # type: ignore[assignment]
    push: Push = None  # type: ignore[assignment]
    stabilization: float = STABILIZATION
    barrier_rate: float = BARRIER_RATE

    def __repr__(self) -> str:
        names = ", ".join(self.system.names) or "no constraints"
        return shortened(f"Rule({names}; {self.yielding} gives way)", LONGEST_REPR)

    @property
    def yielding(self) -> str:
        """Who gives way at run time: "position", "rotation", or "position and rotation"."""
        n = self.system.space.linear
        parts = {"position": self.inverse_metric[:n], "rotation": self.inverse_metric[n:]}
        return " and ".join(name for name, weights in parts.items() if any(weights))

    def __post_init__(self) -> None:
        space, given = self.system.space, self.inverse_metric
        metric = position_only(space) if given is None else given
        metric = _arguments.inverse_metric(metric, space.velocity_size)
        checked = {
            "inverse_metric": metric,
            "push": self.push or _usual_push(space, metric),
            "stabilization": _arguments.not_negative("stabilization", self.stabilization),
            "barrier_rate": _arguments.positive("barrier_rate", self.barrier_rate),
        }
        for name, value in checked.items():
            object.__setattr__(self, name, value)


def no_rule(space: Space) -> Rule:
    """Return the rule of what moves freely in a space."""
    return Rule(ConstraintSystem((), space))


def _usual_push(space: Space, metric: Sequence[float]) -> Push:
    # Coordinates turn a tool as well as they move it.
    turns = any(metric[space.linear :]) or not (space.rotations and space.is_placed)
    return "steering" if turns else "force"
