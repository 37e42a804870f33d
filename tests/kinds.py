"""Kinds of motion, one of each: poses, vectors, joints of a blade, rhythms, two tools."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np

import noslip as ns
from motions import planar_cut
from noslip.chain import Chain, Joint
from noslip.constraints import JointLimits, of


@dataclass(frozen=True)
class Kind:
    """What one kind is learned from, and what its motion is made of.

    Attributes
    ----------
    demonstration : callable
    limit : Constraint
        That its motion does not touch.
    rule : tuple of Constraint
    options : mapping
        Of learning.
    """

    demonstration: Callable[[], Any]
    limit: Any
    rule: tuple[Any, ...] = ()
    options: dict[str, Any] = field(default_factory=dict)


def reached(joints: int) -> ns.Trajectory:
    """Vectors from rest to rest."""
    s = np.linspace(0, 1, 201)
    u = s**3 * (10 - 15 * s + 6 * s**2)
    each = [0.5 * (k + 1) * u + 0.1 * np.sin(2 * np.pi * u) for k in range(joints)]
    return ns.Trajectory(2 * s, np.column_stack(each), names=[f"q{k}" for k in range(joints)])


ARM = Chain(
    [Joint(f"j{k}", position=(length, 0, 0)) for k, length in enumerate((0.0, 0.4, 0.3, 0.2))],
    (0.1, 0, 0),
    name="planar",
)
"""Four hinges in a plane: one more than a pose of the plane takes."""


def joint_cut() -> ns.Trajectory:
    """Joints of that arm along a bent cut, whose edge is a little off its path."""
    cut = planar_cut(0.3, wavering=0.1, count=101)
    tool = cut.with_points(cut.points + [0.45, 0.1, 0, 0, 0, 0, 0])
    joints = ARM.inverse(tool, [-0.8, 1.2, 1.0, -1.0])
    return ns.Trajectory(tool.times, joints, ARM.joint_names, carrier=ARM)


def loop() -> ns.Trajectory:
    """Vectors once around a closed curve."""
    t = np.linspace(0, 2, 201)
    turn = np.pi * t
    each = [np.cos(turn), np.sin(turn) + 0.2 * np.sin(2 * turn)]
    return ns.Trajectory(t, np.column_stack(each), names=["x", "y"])


def tools() -> ns.Bodies:
    """A blade that cuts, and what holds the work beside it."""
    knife = planar_cut(count=81)
    s = np.linspace(0, 1, len(knife))
    u = s**3 * (10 - 15 * s + 6 * s**2)
    aside = knife.points[:1] + np.column_stack([0.05 * u, 0.2 + 0.02 * u, *np.zeros((5, len(s)))])
    return ns.Bodies(knife=knife, holder=knife.with_points(aside))


def joint_limit(size: int) -> Any:
    return JointLimits(lower=(-3.0,) * size, upper=(6.0,) * size)


KINDS = {
    "poses": Kind(
        lambda: planar_cut(count=81),
        ns.KeepOutSphere(center=(0.0, 0.0, 1.0), radius=0.1),
        (ns.Blade(),),
    ),
    "vectors": Kind(lambda: reached(3), joint_limit(3)),
    "joints": Kind(joint_cut, joint_limit(4), (ns.Blade(),)),
    "rhythms": Kind(loop, joint_limit(2), (), {"rhythmic": True}),
    "two tools": Kind(
        tools,
        of(ns.KeepOutSphere(center=(0.0, 0.0, 1.0), radius=0.1), "knife"),
        (of(ns.Blade(), "knife"),),
    ),
}


@cache
def learned(name: str) -> ns.ConstrainedDMP:
    kind = KINDS[name]
    return ns.learn(kind.demonstration(), list(kind.rule), basis_functions=30, **kind.options)
