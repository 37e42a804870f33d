"""A rhythm led to another baseline: the same cycle elsewhere, nearest among those that hold."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from noslip import _arguments
from noslip._typing import Floats
from noslip._values import Value
from noslip.adapting.constants import FEWEST_SAMPLES, MOST_SAMPLES
from noslip.adapting.ends import asked
from noslip.adapting.plan import Plan, carried_out
from noslip.constraints.system import ConstraintSystem
from noslip.demonstrations.cycles import joined
from noslip.errors import InputError
from noslip.law.fitting import fewest_steps
from noslip.law.law import Law
from noslip.projection.request import Request, Weights
from noslip.rule import Rule, no_rule
from noslip.runtime.rhythm import settled
from noslip.runtime.rollout import initial_state, motion_from


@dataclass(frozen=True, eq=False)
class Around(Value):
    """A rhythm, and the baseline that it is led to.

    Attributes
    ----------
    law : Law
        Of a rhythm.
    rule : Rule
    position : array, shape (n,), or None
        Of the baseline; the law's own by default.
    rotation : Rotation or None
        Of a pose's baseline; the path turns along.
    weights : Weights
    samples : int or None
    """

    law: Law
    rule: Rule
    position: ArrayLike | None
    rotation: Rotation | None
    weights: Weights
    samples: int | None

    def planned(self, system: ConstraintSystem, seconds: float | None) -> Plan:
        """Plan it under constraints, in a period (s)."""
        law, tau = self.law, seconds or self.law.duration
        count = samples_of(law.basis.count, law.steps, self.samples)
        alone = no_rule(law.space)
        own = motion_from(law, alone, initial_state(law, alone, duration=tau), tau / (count - 1))
        reference = own.with_points(self._moved(own.points))
        request = Request(
            reference, system, weights=self.weights, begin=law.begin, is_periodic=True
        )
        held = replace(self.rule, system=system)
        found = carried_out(law, held, request, law.steps, tau)
        return replace(found, law=settled(found.law, held))

    def _moved(self, points: Floats) -> Floats:
        """The cycle about the other baseline, its last sample the first again."""
        space, own = self.law.space, self.law.goal
        to = asked("goal", self.position, self.rotation, space=space)
        n, moved = space.linear, points.copy()
        swing = points[:, :n] - own.position
        if to.rotation is not None:
            if not space.is_pose:
                raise InputError("the baseline of a rhythm is turned of a pose alone")
            turn = to.rotation * own.rotation.inv()
            swing = turn.apply(swing)
            turned = turn * Rotation.from_quat(points[:, n:], scalar_first=True)
            moved[:, n:] = turned.as_quat(scalar_first=True)
        moved[:, :n] = swing + (own.position if to.position is None else to.position)
        # What a law alone is off its cycle by is spread over it.
        return joined(space, moved, np.linspace(0.0, 1.0, len(moved)))


def samples_of(functions: int, steps: int, samples: int | None) -> int:
    """Return how many samples an adaptation to a law of so many functions and steps takes."""
    if samples is None:
        return min(max(steps, fewest_steps(functions)) + 1, MOST_SAMPLES)
    samples = _arguments.count("samples", samples, MOST_SAMPLES)
    if samples < FEWEST_SAMPLES:
        raise InputError(f"samples must be {FEWEST_SAMPLES} or more, got {samples}")
    return samples
