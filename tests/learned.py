"""Primitives that several tests move, each made once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import noslip as ns
from motions import cut, held_askew, numerical_example
from noslip._typing import Floats
from noslip.constraints.system import ConstraintSystem
from noslip.projection.pointwise import POSITION_ONLY
from noslip.rule import Rule
from strategies import unit


@cache
def numerical() -> ns.ConstrainedDMP:
    """Of the paper's numerical example, under its blade."""
    return ns.learn(numerical_example(), [ns.Blade()])


@cache
def cutting() -> ns.ConstrainedDMP:
    """A blade's, cheap to adapt."""
    return ns.learn(cut(), [ns.Blade()], basis_functions=40)


@cache
def fitted(seed: int = 0) -> ns.ConstrainedDMP:
    """One that knows nothing of constraints."""
    return ns.learn(held_askew(seed), basis_functions=30)


def constrained(
    constraints: Sequence[ns.Constraint],
    metric: Sequence[float] = POSITION_ONLY,
    seed: int = 0,
    *,
    plain: ns.ConstrainedDMP | None = None,
    **settings: Any,
) -> ns.ConstrainedDMP:
    """Couple a primitive that knows nothing of the constraints to them."""
    plain = plain or fitted(seed)
    rule = Rule(ConstraintSystem(constraints), tuple(metric), **settings)
    return ns.ConstrainedDMP(plain.law, rule)


def under(
    dmp: ns.ConstrainedDMP, constraints: Sequence[ns.Constraint], **settings: Any
) -> ns.ConstrainedDMP:
    """The same law under other constraints."""
    system = ConstraintSystem(constraints, dmp.law.space)
    rule = replace(dmp.rule, system=system, **settings)
    return replace(dmp, rule=rule)


@dataclass(frozen=True)
class Goal:
    """A goal beside a primitive's own."""

    position: Floats
    rotation: Rotation

    @classmethod
    def beside(
        cls,
        dmp: ns.ConstrainedDMP,
        rng: np.random.Generator,
        length: float,
        *,
        farthest: float = 0.5,
        turned: float = 45.0,
    ) -> Goal:
        """From 1 % of the path's length away, in any direction, turned about any axis."""
        shift = rng.uniform(0.01, farthest) * length * unit(rng)
        turn = np.radians(rng.uniform(0, turned)) * unit(rng)
        return cls(dmp.goal_position + shift, Rotation.from_rotvec(turn) * dmp.goal_rotation)
