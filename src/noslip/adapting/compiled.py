"""A whole plan in machine code: that of the exported C, and its parts.

It is compiled in the background once a rule is first planned under, or when asked for.

It is the same to rounding as what this package does in NumPy, which goes on where C stops: with
limits of positions, whose obstacles are led around first, and where nothing is found, to say why.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip.adapting.constants import MOST_SAMPLES
from noslip.adapting.sources import sources
from noslip.boundary import Boundary
from noslip.codegen import c99
from noslip.codegen.library import Native, built, function
from noslip.errors import NoslipError
from noslip.law.forcing import ForcingTerm
from noslip.law.law import Law
from noslip.law.layout import FORCE
from noslip.law.points import Goal
from noslip.law.winding import Winding
from noslip.projection import planner
from noslip.projection.request import ADAPTING, Request, Weights
from noslip.projection.result import ProjectedTrajectory
from noslip.quaternions import turns_between
from noslip.rule import Rule
from noslip.runtime import numbers
from noslip.runtime.state import State
from noslip.runtime.stepper import stepper_of
from noslip.trajectory import PoseTrajectory
from noslip.verification import FOLLOWED

_MOST_KNOTS = 33
"""``NOSLIP_WINDING_KNOTS``."""
_NUMBERS = {
    "start": 7,
    "goal": 7,
    "start_velocity": 6,
    "first_pose": 7,
    "first_twist": 6,
    "last_pose": 7,
    "last_twist": 6,
    "duration": 1,
    "begin": 1,
    "smoothing": 1,
    "left_by": 1,
    "winding": 4 * _MOST_KNOTS,
}
"""What ``noslip_planned`` returns, before the weights."""
_DONE = 1
"""``NOSLIP_REPLAN_DONE``."""


@dataclass(frozen=True)
class Library:
    """Machine code of a rule's plans.

    Attributes
    ----------
    sizes : callable
        (knots, steps, functions, address of two numbers): bytes of a primitive, memory.
    plan : callable
        ``noslip_planned``.
    """

    sizes: Callable[..., None]
    plan: Callable[..., int]

    @classmethod
    def of(cls, rule: Rule) -> Library:
        system, step = rule.system, stepper_of(rule).function
        texts = {
            "noslip.h": c99.header(system.equalities.size, system.limits.size),
            "inside.h": c99.template("inside.h"),
            "noslip.c": c99.source(step, system.size, parts=False),
            **sources(rule),
        }
        texts["replan.c"] += c99.template("planned.c")
        code, pointer, integer = (
            ctypes.CDLL(str(built("replan", texts))),
            ctypes.c_void_p,
            ctypes.c_int,
        )
        return cls(
            function(code, "noslip_planned_sizes", *[integer] * 3, pointer),
            function(
                code,
                "noslip_planned",
                *([pointer] * 4 + [ctypes.c_double] + [integer] * 3 + [pointer] * 6),
                result=integer,
            ),
        )


def native(rule: Rule) -> Native[Library]:
    """Machine code of a rule's plans, or the way to it."""
    key = ("replan", rule.inverse_metric, rule.push)
    return rule.system.owned(key, lambda: Native(lambda: Library.of(rule)))


def compile_for(rule: Rule) -> None:
    """Have a rule's plans compiled, if that may be, so that none waits for it."""
    planner.compile_for(rule.system)
    if rule.system.space.is_pose:
        native(rule).wait()


@dataclass(frozen=True)
class Made:
    """What a plan comes to.

    Attributes
    ----------
    law : Law
    request : Request
        What was projected.
    projected : ProjectedTrajectory
    """

    law: Law
    request: Request
    projected: ProjectedTrajectory


def is_ready(rule: Rule, weights: Weights) -> bool:
    """Whether what plans with such weights is for C, and there; if not yet, it is begun."""
    usual = replace(ADAPTING, rotation_smoothing=weights.rotation_smoothing)
    if weights != usual or "position" in rule.system.limits.row_levels:
        return False
    # Who plans once may do so often; meanwhile it is planned without.
    native(rule).begin()
    return native(rule).library is not None


def made(
    law: Law,
    rule: Rule,
    goal: tuple[Floats, Rotation],
    weights: Weights,
    *,
    state: State | None = None,
    duration: float = 0.0,
    samples: int,
    steps: int,
) -> Made | None:
    """Plan from a state of a law, or all of it; None where that is not for C, or nothing is found.

    Parameters
    ----------
    law : Law
    rule : Rule
    goal : (position, rotation)
    weights : Weights
        Of the projection: C knows those of adapting, and smoother turns.
    state : State, optional
    duration : float
        Of what is left, or of all of it (s); 0 is what it takes.
    samples : int
        Of the projection.
    steps : int
        Of the law that is found, in the duration of the state or in its own.
    """
    if not is_ready(rule, weights):
        return None
    system, library = rule.system, native(rule).library
    assert library is not None
    smoother = weights.rotation_smoothing / ADAPTING.rotation_smoothing
    functions, rows = law.basis.count, system.size
    struct, sizes = numbers.Struct(law, rule), np.zeros(2, dtype=np.int32)
    library.sizes(samples, MOST_SAMPLES, functions, sizes.ctypes.data)
    if sizes[0] != struct.size:
        raise NoslipError("noslip_primitive has another layout than expected")
    given = None if state is None else _given(law, state)
    to = np.concatenate([goal[0], goal[1].as_quat(scalar_first=True), [duration]])
    memory, counts = np.empty(sizes[1]), np.zeros(5, dtype=np.int32)
    reference, found = np.empty(7 * samples), np.empty(7 * samples)
    values, multipliers = np.empty((samples, rows)), np.empty((samples, rows))
    told = np.empty(sum(_NUMBERS.values()) + FORCE.size * functions)
    outcome = library.plan(
        struct.address,
        None if given is None else given.ctypes.data,
        to.ctypes.data,
        memory.ctypes.data,
        smoother,
        *(samples, steps, MOST_SAMPLES - 1),
        *(array.ctypes.data for array in (reference, found, values, multipliers, told, counts)),
    )
    if outcome != _DONE:
        return None
    parts = dict(zip(_NUMBERS, np.split(told, np.cumsum(list(_NUMBERS.values()))), strict=False))
    if parts["left_by"].item() > FOLLOWED:
        return None
    offsets = told[-FORCE.size * functions :].reshape(functions, FORCE.size)
    iterations, heeded, backing, knots, steps = counts.tolist()
    seconds, begin = parts["duration"].item(), parts["begin"].item()
    winding = Winding(parts["winding"][: 4 * knots].reshape(knots, 4))
    planned = Law(
        law.attractor,
        ForcingTerm(law.basis, law.attractor.stiffness * offsets),
        parts["start"],
        parts["start_velocity"],
        Goal(parts["goal"][:3], winding),
        seconds,
        steps,
        begin,
    )
    times = np.linspace(0.0, seconds, samples)
    ends = [
        Boundary(at, pose[:3], _rotation(pose[3:]), twist[:3], twist[3:])
        for at, pose, twist in (
            (0.0, parts["first_pose"], parts["first_twist"]),
            (1.0, parts["last_pose"], parts["last_twist"]),
        )
    ]
    moved = _motion(times, reference)
    levels = np.array(system.equalities.row_levels + system.limits.row_levels, dtype=object)
    is_limit = np.arange(rows) >= system.equalities.size
    # No step leads to the first sample; an acceleration is that from one step to the next.
    values[0] = np.where(levels == "position", values[0], np.where(is_limit, np.inf, 0.0))
    values[-1, levels == "acceleration"] = np.inf
    residuals, margins = np.split(values, [system.equalities.size], axis=1)
    limits = zip(system.limits.names, system.limits.constraints, strict=True)
    projected = ProjectedTrajectory(
        trajectory=_motion(times, found, parts["first_twist"], parts["last_twist"]),
        turns=turns_between(
            reference[3 * samples :].reshape(-1, 4), found[3 * samples :].reshape(-1, 4)
        ),
        converged=True,
        iterations=iterations,
        residual=float(np.abs(residuals).max(initial=0.0)),
        residuals=residuals,
        multipliers=multipliers,
        margins=margins,
        backing=backing,
        smoothing=parts["smoothing"].item(),
        left_out=tuple(name for name, limit in limits if limit.priority > heeded),
    )
    return Made(planned, Request(moved, system, tuple(ends), weights, begin=begin), projected)


def _given(law: Law, state: State) -> Floats:
    """A state as ``noslip_planned`` takes it."""
    clock = state.time, law.clock.fraction(state.phase), state.previous_step, state.duration
    goal = state.goal_position, state.goal_rotation.as_quat(scalar_first=True)
    return np.concatenate([state.vector(), clock, *goal])


def _rotation(quaternion: Floats) -> Rotation:
    return Rotation.from_quat(quaternion, scalar_first=True)


def _motion(times: Floats, poses: Floats, *twists: Floats) -> PoseTrajectory:
    """Positions, then quaternions, as a trajectory; with what is asked for at its ends."""
    count = len(times)
    positions, quaternions = poses[: 3 * count].reshape(-1, 3), poses[3 * count :].reshape(-1, 4)
    motion = PoseTrajectory(times, positions, _rotation(quaternions), name="planned")
    if twists:
        linear, angular = motion.linear_velocities.copy(), motion.angular_velocities.copy()
        for k, twist in zip((0, -1), twists, strict=True):
            linear[k], angular[k] = twist[:3], twist[3:]
        motion = replace(motion, linear_velocities=linear, angular_velocities=angular)
    return motion
