"""What is called impossible is: random admissible motions never come there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import noslip as ns
from motions import facing, planar_cut
from noslip._typing import Floats
from noslip.adapting.impossible import require_reachable
from noslip.boundary import Boundary
from noslip.constraints import Constraint
from noslip.constraints.system import ConstraintSystem
from noslip.errors import ConstraintError, Refusal, muted
from refusals import refusal

SEEDS = st.integers(0, 2**32 - 1)
LEVER = np.array([0.1, 0.0, 0.2])
UP = np.array([1.0, 2.0, 3.0]) / np.sqrt(14)


def rule(name: str, rows: Callable[[Any], Any]) -> Constraint:
    return ns.velocity_constraint(name=name)(rows)


STIFF = rule("stiff", lambda m: [m.angular_velocity[k] for k in range(3)])
YAW = rule("yaw", lambda m: [m.angular_velocity[k] for k in range(2)])
ROLL = rule("roll", lambda m: [(m.rotation.T @ m.angular_velocity)[k] for k in (1, 2)])
STILL = rule("still", lambda m: ca.vertcat(m.rotation.T @ m.linear_velocity, m.angular_velocity))
SKEW = rule("skew", lambda m: m.linear_velocity[2] - m.position[0] * m.linear_velocity[1])

Rows = Callable[[Floats, Floats], Sequence[Floats]]
"""(positions, rotation matrices) -> rows, by NumPy: on velocity and turn, each shape (N, 6)."""


def linear(direction: Floats, lever: Any = (0.0, 0.0, 0.0)) -> Floats:
    """D . (v + w x l) as a row."""
    both = np.broadcast_arrays(direction, np.cross(lever, direction))
    return np.concatenate(both, axis=-1)


def angular(direction: Floats) -> Floats:
    return np.concatenate([np.zeros_like(direction), direction], axis=-1)


WORLD = np.eye(3)
CASES: dict[str, tuple[list[Constraint], Rows, str]] = {
    "wheel": (
        [ns.Wheel(normal=tuple(UP))],
        lambda p, R: [linear(R[..., 1]), linear(UP)],
        "goal lies 0.05 m from the start along (0.267, 0.535, 0.802), which 'wheel' rules out",
    ),
    "fork": (
        [ns.Wheel(reference_point=tuple(LEVER)), ns.SpeedLimit(speed=9.0)],
        lambda p, R: [linear(R[..., 1], R @ LEVER), linear(WORLD[2], R @ LEVER)],
        "goal with its point (0.1, 0, 0.2) lies 0.05 m from the start along (0, 0, 1), which",
    ),
    "ball": (
        [ns.constraints.RollingSphere()],
        lambda p, R: [
            linear(WORLD[0], [0, 0, -0.1]),
            linear(WORLD[1], [0, 0, -0.1]),
            linear(WORLD[2]),
        ],
        "lies 0.05 m from the start along (0, 0, 1), which 'rolling-sphere'",
    ),
    "stiff blade": (
        [ns.Blade(), STIFF],
        lambda p, R: [linear(R[..., 1]), *map(angular, WORLD)],
        "is turned by 17.2 degrees from the start, which 'stiff' rules out",
    ),
    "turntable": (
        [YAW],
        lambda p, R: [angular(WORLD[0]), angular(WORLD[1])],
        "is tilted by 17.2 degrees from the start, off (0, 0, 1), which 'yaw' rules out",
    ),
    "drill": (
        [ROLL, ns.Blade(lateral="z")],
        lambda p, R: [angular(R[..., 1]), angular(R[..., 2]), linear(R[..., 2])],
        "is tilted by 17.2 degrees from the start, off (",
    ),
    "still": (
        [STILL],
        lambda p, R: [*map(linear, WORLD), *map(angular, WORLD)],
        "is turned by 17.2 degrees from the start, which 'still' rules out",
    ),
    "blade": ([ns.Blade()], lambda p, R: [linear(R[..., 1])], ""),
    "needle": ([ns.Needle()], lambda p, R: [linear(R[..., 1]), linear(R[..., 2])], ""),
    "skew": (
        [SKEW],
        lambda p, R: [linear(WORLD[2] - p[:, :1] * WORLD[1])],
        "",
    ),
}
"""Constraints, their rows in closed form, and what is said of a goal that is off."""


def moved(
    rows: Rows, start: tuple[Floats, Rotation], rng: np.random.Generator, count: int
) -> tuple[Floats, Rotation]:
    """Where random admissible controls lead: the classical Runge-Kutta method on SE(3)."""
    pieces, steps, h = 3, 12, 0.02
    positions, rotations = np.tile(start[0], (count, 1)), Rotation.concatenate([start[1]] * count)

    def rate(x: Floats, wanted: Floats) -> Floats:
        """Of coordinates about the step's begin: a rotation vector x turns by w + w x x / 2 ..."""
        r = x[:, 3:]
        several = rows(x[:, :3], (Rotation.from_rotvec(r) * rotations).as_matrix())
        A = np.stack([np.broadcast_to(row, (count, 6)) for row in several], axis=1)
        v = wanted - np.einsum("nij,nj->ni", np.linalg.pinv(A) @ A, wanted)
        w = v[:, 3:]
        turning = w + np.cross(w, r) / 2 + np.cross(r, np.cross(r, w)) / 12
        return np.hstack([v[:, :3], turning])

    for _ in range(pieces):
        wanted = 2 * rng.normal(size=(count, 6))
        for _ in range(steps):
            x = np.hstack([positions, np.zeros((count, 3))])
            k1 = rate(x, wanted)
            k2 = rate(x + h / 2 * k1, wanted)
            k3 = rate(x + h / 2 * k2, wanted)
            x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + rate(x + h * k3, wanted))
            positions, rotations = x[:, :3], Rotation.from_rotvec(x[:, 3:]) * rotations
    return positions, rotations


def somewhere(rng: np.random.Generator) -> tuple[Floats, Rotation]:
    return rng.normal(size=3), Rotation.random(rng=rng)


# Of each 200 controls of three pieces, from 4 starts and more.
@pytest.mark.parametrize("name", CASES)
@settings(max_examples=4)
@given(SEEDS)
def test_what_admissible_motions_reach_is_never_called_impossible(name: str, seed: int) -> None:
    constraints, rows, _ = CASES[name]
    rng, system = np.random.default_rng(seed), ConstraintSystem(constraints)
    start = somewhere(rng)
    begin, (positions, rotations) = Boundary(0, *start), moved(rows, start, rng, 50)
    if name != "still":
        way = np.linalg.norm(positions - start[0], axis=1)
        assert np.all(way + (rotations * start[1].inv()).magnitude() > 1e-3)
    for position, rotation in zip(positions, rotations, strict=True):
        require_reachable(system, begin, Boundary(1, position, rotation))
        require_reachable(system, begin, Boundary(1, position))
        require_reachable(system, begin, Boundary(1, None, rotation))


@pytest.mark.parametrize("name", [name for name, case in CASES.items() if case[2]])
def test_what_is_kept_is_said_by_the_constraints_that_keep_it(name: str) -> None:
    constraints, rows, told = CASES[name]
    start = somewhere(np.random.default_rng(1))
    (position,), (rotation,) = moved(rows, start, np.random.default_rng(2), 1)
    if "turned" in told or "tilted" in told:
        # About an axis that is not free, at rotations that are reached.
        axis = WORLD[1] if name == "turntable" else start[1].apply(WORLD[1])
        rotation = Rotation.from_rotvec(0.3 * axis) * rotation
    else:
        position = position + 0.05 * (UP if name == "wheel" else WORLD[2])
    message = refusal(
        ConstraintError,
        require_reachable,
        ConstraintSystem(constraints),
        Boundary(0, *start),
        Boundary(1, position, rotation),
    )
    assert told in message
    assert "no motion that satisfies it ends there" in message


def test_where_no_turn_is_free_the_blades_lateral_axis_is_one_of_the_world() -> None:
    start = somewhere(np.random.default_rng(3))
    travel, lateral, _ = start[1].as_matrix().T
    begin = Boundary(0, *start)

    def to(way: Floats, *more: Constraint) -> None:
        system = ConstraintSystem([ns.Blade(), STIFF, *more])
        require_reachable(system, begin, Boundary(1, start[0] + way, start[1]))

    to(2.0 * travel)
    to(-2.0 * travel)
    message = refusal(ConstraintError, to, 0.3 * lateral)
    assert "lies 0.3 m from the start along (" in message
    assert "'blade' and 'stiff' together rule out; no motion that satisfies them" in message
    # What leads on leads nowhere back, if it is hard.
    to(2.0 * travel, ns.constraints.ForwardOnly())
    to(-2.0 * travel, ns.constraints.ForwardOnly(priority=1))
    message = refusal(ConstraintError, to, -2.0 * travel, ns.constraints.ForwardOnly())
    assert "lies 2 m from the start along (" in message
    assert "'stiff' and 'forward-only' together rule out" in message


def beyond(name: str, margin: Callable[[Any], Any], priority: int = 0) -> Constraint:
    return ns.keep_nonnegative(name=name, priority=priority)(margin)


ON = beyond("on", lambda m: 2 * m.linear_velocity[0] - 0.1)


def test_a_hard_limit_that_leads_one_way_everywhere_leads_nowhere_back() -> None:
    start = Boundary(0, np.zeros(3), Rotation.identity())
    require_reachable(ConstraintSystem([ON]), start, Boundary(1, [1.0, -5.0, 2.0]))
    assert "along (-1, 0, 0), which 'on' rules out" in refusal(
        ConstraintError,
        require_reachable,
        ConstraintSystem([ON]),
        start,
        Boundary(1, [-1.0, 0.0, 0.0]),
    )


@pytest.mark.parametrize(
    "constraint",
    [
        # Each lets one thing happen that looks as if nothing could: p beyond 9 m, a given pace,
        # a ground that moves, a margin that lets back up, a limit that may give way.
        rule("pieces", lambda m: ca.if_else(m.position[0] < 9, m.linear_velocity[2], 0)),
        rule("roots", lambda m: m.linear_velocity[2] ** 2 - 0.01),
        rule("pace", lambda m: m.linear_velocity[2] - 0.3),
        rule("waves", lambda m: m.linear_velocity[2] - ca.cos(m.time)),
        ns.constraints.InMovingFrame(ns.Wheel()),
        beyond("slow", lambda m: m.linear_velocity[2] + 0.1),
        beyond("there", lambda m: m.linear_velocity[2] + m.position[0] - 9),
        rule("cone", lambda m: m.linear_velocity[2] + ca.norm_2(m.linear_velocity[:2])),
        beyond("soft", lambda m: m.linear_velocity[2], priority=1),
        beyond("here", lambda m: ca.if_else(m.position[0] < 9, m.linear_velocity[2], 1)),
        ns.SpeedLimit(),
        ns.KeepOutSphere(center=(0.5, 0, 0.5), radius=0.3),
        ns.constraints.Box(lower=(-1, -1, -1), upper=(1, 1, 1)),
    ],
    ids=lambda c: c.name,
)
def test_what_is_not_proven_is_not_called_impossible(constraint: Constraint) -> None:
    start = Boundary(0, np.zeros(3), Rotation.identity())
    goal = Boundary(1, [0.3, 0.2, -0.4], Rotation.from_rotvec([0.1, 0.2, 0.3]))
    require_reachable(ConstraintSystem([constraint]), start, goal)


# ---------------------------------------------------------------- adapting


@cache
def wheeled() -> ns.ConstrainedDMP:
    return ns.learn(planar_cut(), [ns.Wheel()], basis_functions=20)


HIGHER = "lies 0.02 m from the start along (0, 0, 1), which 'wheel' rules out; no motion"


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        ({"goal_position": [0.1, 0, 0.02]}, f"goal {HIGHER} that satisfies it ends there"),
        ({"goal_position": [0.1, 0, 0.02], "end": "position"}, f"goal {HIGHER}"),
        ({"start_position": [0, 0, -0.02]}, f"goal {HIGHER}"),
        ({"via": [(0.5, [0.05, 0.01, 0.02])]}, f"via at 0.5 {HIGHER} that satisfies it passes"),
    ],
)
def test_a_wheel_is_not_asked_to_leave_its_ground(asked: dict[str, Any], told: str) -> None:
    with pytest.raises(ConstraintError) as caught:
        wheeled().adapt(**asked)
    assert caught.value.code is Refusal.IMPOSSIBLE and told in str(caught.value)


def test_nor_in_a_new_plan() -> None:
    state = wheeled().initial_state()
    with pytest.raises(ConstraintError, match="'wheel' rules out") as caught:
        wheeled().replan(state, goal_position=[0.1, 0, 0.02])
    assert caught.value.code is Refusal.IMPOSSIBLE


# Rows are asked in the middle of a step: of a point of the tool that bounds what a turn may miss.
@pytest.mark.parametrize(
    "constraints",
    [[ns.Wheel(reference_point=(0.1, 0.0, 0.2))], [ns.Wheel(), ns.Blade(lateral="y")]],
    ids=["fork", "twice"],
)
def test_its_own_goal_is_never_impossible(constraints: list[Constraint]) -> None:
    demonstration = facing(4, 101, flat=True)
    with muted():
        dmp = ns.learn(demonstration, constraints, basis_functions=30)
        again = dmp.adapt()
        longer = again.adapt(goal_position=again.goal_position + 0.05 * travel(again))
    for each in (again, longer):
        np.testing.assert_allclose(each.rollout().positions[-1], each.goal_position, atol=1e-4)


def travel(dmp: ns.ConstrainedDMP) -> Floats:
    flat = dmp.goal_rotation.as_matrix()[:, 0] * [1, 1, 0]
    return np.asarray(flat / np.linalg.norm(flat))
