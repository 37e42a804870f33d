"""Primitives that several tests move, each made once."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import noslip as ns
from motions import cut, held_askew, numerical_example
from noslip.projection.pointwise import POSITION_ONLY


@cache
def numerical() -> ns.ConstrainedDMP:
    """Of the paper's numerical example, under its blade."""
    return ns.learn(numerical_example(), [ns.Blade()])


@cache
def cutting() -> ns.ConstrainedDMP:
    """A blade's, cheap to adapt."""
    return ns.learn(cut(), [ns.Blade()], basis_functions=40)


@cache
def fitted(seed: int = 0) -> ns.PoseDMP:
    """One that knows nothing of constraints."""
    return ns.PoseDMP.fit(held_askew(seed), basis_functions=30)


def constrained(
    constraints: Sequence[ns.Constraint],
    metric: Sequence[float] = POSITION_ONLY,
    seed: int = 0,
    *,
    plain: ns.PoseDMP | None = None,
    **settings: Any,
) -> ns.ConstrainedDMP:
    """Couple a primitive that knows nothing of the constraints to them."""
    plain = plain or fitted(seed)
    return ns.ConstrainedDMP(
        position=plain.position,
        orientation=plain.orientation,
        phase=plain.phase,
        duration=plain.duration,
        steps=plain.steps,
        constraints=tuple(constraints),
        regular=plain,
        inverse_metric=tuple(metric),
        **settings,
    )
