"""Nearest poses on constraints, and contradictions found and named."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip import Constraint, PoseTrajectory, velocity_constraint
from noslip._typing import Floats
from noslip.constraints import ConstraintSystem
from noslip.errors import ConstraintError
from noslip.projection.feasibility import project_pose, require_consistent
from refusals import refusal
from strategies import seeds, triple, unit

FULL = (1.0,) * 6


def through(rng: np.random.Generator, p: Floats, R: Rotation, names: Sequence[str]) -> Any:
    """Constraints and limits that a pose satisfies."""
    lower, upper = p - rng.uniform(0.01, 0.3, 3), p + rng.uniform(0.01, 0.3, 3)
    away = np.cross(unit(rng), axis := unit(rng))
    rules: dict[str, Constraint] = {
        "plane": ns.constraints.PlaneContact(point=triple(p), normal=triple(unit(rng))),
        "sphere": ns.constraints.SphereContact(center=triple(p - 0.5 * unit(rng)), radius=0.5),
        "cylinder": ns.constraints.CylinderContact(
            point=triple(p - 0.4 * away / np.linalg.norm(away)), axis=triple(axis), radius=0.4
        ),
        "remote center": ns.constraints.RemoteCenter(point=triple(p + 0.3 * R.apply([0, 0, 1]))),
        "tool axis": ns.constraints.ToolAxis(axis="x", direction=triple(R.apply([1, 0, 0]))),
        "tilt": ns.constraints.ToolAxis(
            axis="x",
            direction=triple(u := unit(rng)),
            angle=float(np.arccos(R.apply([1, 0, 0]) @ u)),
        ),
        "box": ns.constraints.Box(lower=triple(lower), upper=triple(upper)),
    }
    return [rules[name] for name in names]


def away_from(
    rng: np.random.Generator, p: Floats, R: Rotation, size: float
) -> tuple[Floats, Rotation]:
    turn = Rotation.from_rotvec(size * rng.normal(size=3))
    return p + size * rng.normal(size=3), turn * R


def nearest(
    rules: Sequence[Constraint], position: Floats, rotation: Rotation, weights: Sequence[float]
) -> tuple[Floats, Rotation, float]:
    """The nearest pose by sequential quadratic programming, and its distance squared."""
    system = ConstraintSystem(rules)

    def pose(x: Floats) -> tuple[Floats, Rotation]:
        return position + x[:3], Rotation.from_rotvec(x[3:]) * rotation

    def residual(x: Floats) -> Floats:
        p, R = pose(x)
        # A pose at a time: the graph itself, which is not mapped over many first.
        return np.array(system.function(0, p, R.as_quat(scalar_first=True), 0, 0, 0, 0)).ravel()

    weighed = 1 / np.asarray(weights)
    is_limit = system.row_is_limit
    found = minimize(
        lambda x: float(weighed @ x**2),
        1e-3 * np.random.default_rng(0).normal(size=6),
        jac=lambda x: 2 * weighed * x,
        method="SLSQP",
        constraints=[
            {"type": "eq", "fun": lambda x: residual(x)[~is_limit]},
            {"type": "ineq", "fun": lambda x: residual(x)[is_limit]},
        ],
        options={"ftol": 1e-15, "maxiter": 60},
    )
    missed = np.where(is_limit, np.minimum(residual(found.x), 0), residual(found.x))
    assert np.abs(missed).max() < 1e-8
    return *pose(found.x), float(found.fun)


SETS = [
    ["plane"],
    ["sphere"],
    ["cylinder"],
    ["remote center"],
    ["tool axis"],
    ["tilt"],
    ["box"],
    ["plane", "sphere"],
    ["plane", "cylinder"],
    ["plane", "remote center"],
    ["sphere", "tilt"],
    ["plane", "box"],
    ["sphere", "box"],
    ["remote center", "box"],
    ["plane", "remote center", "box"],
]


@pytest.mark.parametrize("names", SETS, ids="-".join)
@pytest.mark.parametrize("weights", [FULL, (1, 2, 0.5, 4, 1, 3)], ids=["full", "uneven"])
def test_a_projected_pose_is_the_nearest(names: list[str], weights: Any) -> None:
    compared = 0
    for seed in range(3):
        rng = np.random.default_rng(seed)
        p, R = rng.normal(size=3), Rotation.random(random_state=rng)
        rules = through(rng, p, R, names)
        given_position, given_rotation = away_from(rng, p, R, 0.03)
        position, quaternion = project_pose(
            rules,
            0.0,
            given_position,
            given_rotation.as_quat(scalar_first=True),
            inverse_metric=weights,
        )
        expected, turned, cost = nearest(rules, given_position, given_rotation, weights)
        found = Rotation.from_quat(quaternion, scalar_first=True)
        moved = np.concatenate(
            [position - given_position, (found * given_rotation.inv()).as_rotvec()]
        )
        # On it, and no farther away than the other.
        system = ConstraintSystem(rules)
        residual = system.residuals(0.0, position, quaternion, np.zeros(3), np.zeros(3))[0]
        missed = np.where(system.row_is_limit, np.minimum(residual, 0), residual)
        assert np.abs(missed).max() <= 1e-11
        first_order = 1e-7 if weights == FULL else 1e-3
        assert np.sum(moved**2 / weights) <= cost * (1 + first_order) + 1e-12
        # Where axes weigh differently, the rotation vector of a turn is its angular velocity's
        # integral only to first order, and so is the nearest pose found.
        turn = float(np.linalg.norm(moved[3:]))
        # The oracle itself is as exact as the square root of its cost's precision.
        close = 1e-5 if weights == FULL else 1e-5 + turn**2
        np.testing.assert_allclose(position, expected, rtol=0, atol=close)
        assert (found * turned.inv()).magnitude() <= close
        compared += 1
    assert compared == 3


@given(seeds)
@settings(max_examples=20)
def test_flat_constraints_and_boxes_are_projected_onto_exactly(seed: int) -> None:
    # Closed forms: onto a plane along its normal, into a box side by side.
    rng = np.random.default_rng(seed)
    p, normal, on = rng.normal(size=3), unit(rng), rng.normal(size=3)
    quaternion = Rotation.random(random_state=rng).as_quat(scalar_first=True)
    plane = ns.constraints.PlaneContact(point=triple(on), normal=triple(normal))
    found, turned = project_pose(plane, 0.0, p, quaternion)
    np.testing.assert_allclose(found, p - normal * (normal @ (p - on)), rtol=0, atol=1e-12)
    np.testing.assert_allclose(turned, quaternion, rtol=0, atol=1e-15)
    box = ns.constraints.Box(lower=(-0.5, -0.2, None), upper=(0.5, None, 0.1))
    found, _ = project_pose(box, 0.0, p, quaternion)
    inside = np.clip(p, [-0.5, -0.2, -np.inf], [0.5, np.inf, 0.1])
    np.testing.assert_allclose(found, inside, rtol=0, atol=1e-11)


def test_a_pose_that_satisfies_all_stays_as_it_is() -> None:
    rng = np.random.default_rng(1)
    p, R = rng.normal(size=3), Rotation.random(random_state=rng)
    quaternion = R.as_quat(scalar_first=True)
    rules = through(rng, p, R, ["plane", "sphere", "tilt", "box"])
    found, turned = project_pose(rules, 0.0, p, quaternion)
    np.testing.assert_allclose(found, p, rtol=0, atol=1e-12)
    np.testing.assert_allclose(turned, quaternion, rtol=0, atol=1e-12)


def test_velocity_constraints_leave_every_pose() -> None:
    quaternion = Rotation.random(random_state=1).as_quat(scalar_first=True)
    found, turned = project_pose([ns.Blade(), ns.SpeedLimit()], 0.0, (1, 2, 3), quaternion)
    np.testing.assert_array_equal(found, (1, 2, 3))
    np.testing.assert_allclose(turned, quaternion, rtol=0, atol=1e-16)


def test_a_pose_that_no_constraint_allows_is_refused_by_name() -> None:
    rules = [ns.constraints.PlaneContact(), ns.constraints.PlaneContact(point=(0, 0, 1))]
    message = refusal(ConstraintError, project_pose, rules, 0.0, (0, 0, 0.3), (1, 0, 0, 0))
    assert "plane-contact and plane-contact 2" in message
    with pytest.raises(ConstraintError, match="tool-axis"):
        project_pose(
            ns.constraints.ToolAxis(),
            0.0,
            (0, 0, 0),
            (0.8, 0.6, 0, 0),
            inverse_metric=(1, 1, 1, 0, 0, 0),
        )


# -------------------------------------------------------------------- contradictions


def demonstration() -> PoseTrajectory:
    s = np.linspace(0, 1, 201)
    positions = np.column_stack([s, 0.3 * s**2, 0.05 * np.sin(3 * s)])
    heading = np.arctan(0.6 * s)
    return PoseTrajectory(times=s, positions=positions, rotations=Rotation.from_euler("z", heading))


CUT = demonstration()
START, TURN = CUT.positions[0], CUT.rotations[0]


def pace(speed: float, name: str) -> Constraint:
    return velocity_constraint(name=name)(lambda motion: motion.linear_velocity[0] - speed)


HARMLESS: list[Constraint] = [
    ns.Blade(),
    ns.KeepOutSphere(center=(0, 0, 5), radius=0.1),
    ns.SpeedLimit(speed=50.0),
    ns.constraints.HalfSpace(point=(0, 0, -3)),
    ns.constraints.ToolAxis(axis="y", direction=(0, 1, 0), angle=0.5),
]
CONTRADICTIONS: dict[str, list[Constraint]] = {
    "planes": [ns.constraints.PlaneContact(), ns.constraints.PlaneContact(point=(0, 0, 0.1))],
    "sphere off a plane": [
        ns.constraints.PlaneContact(point=(0, 0, -0.5)),
        ns.constraints.SphereContact(center=(0, 0, 0.5), radius=0.7),
    ],
    "two speeds": [pace(1, "one"), pace(2, "two")],
    "a box that excludes a plane": [
        ns.constraints.PlaneContact(point=(0, 0, 0.3)),
        ns.constraints.Box(upper=(None, None, 0.2), lower=(None, None, -1)),
    ],
    "two boxes": [
        ns.constraints.Box(lower=(0.5, None, None), upper=(0.6, None, None)),
        ns.constraints.Box(lower=(0.7, None, None), upper=(0.8, None, None)),
    ],
    "an obstacle around all of a small sphere": [
        ns.constraints.SphereContact(center=(0, 0, 0), radius=0.1),
        ns.KeepOutSphere(center=(0, 0, 0.01), radius=0.3),
    ],
    "two angles": [
        ns.constraints.ToolAxis(axis="x", angle=1.3),
        ns.constraints.ToolAxis(axis="x", angle=0.9),
    ],
    "three planes": [
        ns.constraints.PlaneContact(normal=(0, 0, 1)),
        ns.constraints.PlaneContact(normal=(0, 1, 1), point=(0, 0, 0.2)),
        ns.constraints.PlaneContact(normal=(0, 1, 0), point=(0, 0.9, 0)),
    ],
}


@pytest.mark.parametrize(
    "name",
    CONTRADICTIONS,
)
@pytest.mark.parametrize("seed", range(3))
def test_a_planted_contradiction_is_named_and_nothing_else(name: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    culprits = CONTRADICTIONS[name]
    others = [HARMLESS[i] for i in rng.choice(len(HARMLESS), 2 if seed else 0, replace=False)]
    if name == "two angles":
        others = [rule for rule in others if rule.name != "tool-axis"]
    rules = [*culprits, *others]
    order = rng.permutation(len(rules))
    system = ConstraintSystem([rules[i] for i in order])
    message = refusal(ConstraintError, require_consistent, system, CUT)
    assert "contradict each other" in message
    for constraint, label in zip(system.constraints, system.names, strict=True):
        assert (repr(label) in message) == any(constraint is rule for rule in culprits), message
    with pytest.raises(ConstraintError, match="contradict each other"):
        ns.learn(CUT, system.constraints, basis_functions=20)


CONSISTENT = [
    ["plane", "sphere"],
    ["plane", "cylinder"],
    ["plane", "box"],
    ["sphere", "box"],
    ["remote center", "tilt"],
    ["remote center", "box"],
    ["plane", "tilt", "box"],
    ["plane", "remote center"],
    ["tool axis", "box"],
    ["sphere", "cylinder"],
]


@pytest.mark.parametrize("names", CONSISTENT, ids="-".join)
def test_constraints_that_a_pose_satisfies_raise_no_alarm(names: list[str]) -> None:
    still = PoseTrajectory(
        times=np.linspace(0, 1, 50),
        positions=START + np.linspace(0, 0.02, 50)[:, None] * [1, 0.2, 0],
        rotations=Rotation.concatenate([TURN] * 50),
    )
    for seed in range(10):
        rng = np.random.default_rng(seed)
        rules = [*through(rng, START, TURN, names), ns.Blade()]
        require_consistent(ConstraintSystem(rules), still)


def test_constraints_that_the_start_satisfies_raise_no_alarm_along_a_demonstration() -> None:
    alarms = []
    names = ["plane", "sphere", "cylinder", "remote center", "tool axis", "tilt", "box"]
    for seed in range(100):
        rng = np.random.default_rng(seed)
        chosen = [str(name) for name in rng.choice(names, int(rng.integers(2, 4)), replace=False)]
        try:
            require_consistent(ConstraintSystem(through(rng, START, TURN, chosen)), CUT)
        except ConstraintError:
            alarms.append((seed, chosen))
    assert not alarms


@given(seeds)
@settings(max_examples=20)
def test_soft_limits_contradict_nothing(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rules: list[Constraint] = [
        ns.constraints.PlaneContact(),
        ns.constraints.Box(
            lower=(None, None, 0.5), priority=int(rng.integers(1, 5)), upper=(None,) * 3
        ),
        ns.constraints.HalfSpace(point=(0, 0, -1), normal=(0, 0, -1), priority=1),
        ns.KeepOutSphere(center=triple(START), radius=3.0, priority=2),
        ns.SpeedLimit(speed=1e-3, priority=3),
    ]
    require_consistent(ConstraintSystem([rules[i] for i in rng.permutation(5)]), CUT)


def test_a_single_constraint_or_none_is_consistent() -> None:
    require_consistent(ConstraintSystem(), CUT)
    require_consistent(ConstraintSystem(ns.constraints.PlaneContact(point=(0, 0, 40))), CUT)


def test_looking_for_contradictions_takes_little_time() -> None:
    rules = [
        ns.Blade(),
        *through(np.random.default_rng(0), START, TURN, ["plane", "box"]),
        ns.KeepOutSphere(center=(0, 0, 5)),
    ]
    system = ConstraintSystem(rules)
    taken = []
    for _ in range(5):
        begin = time.process_time()
        require_consistent(system, CUT)
        taken.append(time.process_time() - begin)
    # Typically 5 ms of the processor.
    assert min(taken) <= 0.1
