"""A constraint, and a system of them, is what it declares: equal, hashed and sent by that."""

from __future__ import annotations

import copy
import pickle
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any

import casadi as ca
import numpy as np
import pytest

import noslip as ns
from noslip import Constraint
from noslip.constraints import ConstraintSystem, Instant
from noslip.constraints.catalog import restore, specification
from noslip.constraints.declaration import CATALOG

INSTANT = (0.5, [0.1, 0.2, 0.3], [0.8, 0.0, 0.6, 0.0], [1.0, 2.0, 3.0], [0.4, 0.5, 0.6])


class Rail(Constraint):
    """A user's own class, with what no process could send."""

    name = "rail"

    def __init__(self, slope: float) -> None:
        self.slope, self.unsendable = slope, lambda: None

    def residual(self, motion: Instant) -> Any:
        return motion.linear_velocity[1] - self.slope * motion.linear_velocity[0]


@ns.velocity_constraint
def decorated(motion: Instant) -> Any:
    """Written by a user."""
    return motion.rotation[:, 1].T @ motion.linear_velocity


def pairs() -> dict[str, tuple[Constraint, Constraint]]:
    """Each constraint declared twice."""

    def bowl() -> Any:
        return lambda p: p[2] - 0.1 * p[0] ** 2

    def table() -> Any:
        return ns.position_constraint(name="table")(lambda m: m.position[2] - 0.02)

    def frame() -> Any:
        return lambda t: [0.1 * t, 0, ca.sin(t)]

    found = {name: (kind(), kind()) for name, kind in CATALOG.items() if name != "joint-limits"}
    found["decorated"] = (decorated, ns.velocity_constraint(decorated.function))  # type: ignore[attr-defined]
    found["lambda"] = (table(), table())
    found["class"] = (Rail(0.5), Rail(0.5))
    found["surface"] = tuple(ns.constraints.SurfaceContact(bowl()) for _ in range(2))  # type: ignore[assignment]
    found["axis"] = tuple(ns.constraints.ToolAxis(surface=bowl(), angle=0.3) for _ in range(2))  # type: ignore[assignment]
    found["moving"] = tuple(
        ns.constraints.InMovingFrame(Rail(1.0), frame=frame()) for _ in range(2)
    )  # type: ignore[assignment]
    found["limit"] = (
        ns.keep_nonnegative(lambda m: m.position[2], priority=1, barrier_rate=3.0),
    ) * 2
    return found


PAIRS = pairs()
EACH = pytest.mark.parametrize("name", PAIRS)


def values(constraint: Constraint) -> list[float]:
    return list(ConstraintSystem(constraint).residuals(*INSTANT)[0])


@EACH
def test_what_is_declared_alike_is_equal(name: str) -> None:
    one, other = PAIRS[name]
    assert one == other
    assert hash(one) == hash(other)
    assert len({one, other}) == 1
    assert ConstraintSystem(one) == ConstraintSystem(other)
    assert hash(ConstraintSystem(one)) == hash(ConstraintSystem(other))
    assert ConstraintSystem(one).function is ConstraintSystem(other).function


def test_what_is_declared_otherwise_is_not_equal() -> None:
    several = [one for one, _ in PAIRS.values()]
    several += [Rail(0.6), ns.Blade(lateral="z"), ns.DepthLimit(priority=1), ns.SpeedLimit(0.2)]
    for i, one in enumerate(several):
        for j, other in enumerate(several):
            assert (one == other) == (i == j)
            assert (ConstraintSystem(one) == ConstraintSystem(other)) == (i == j)
    assert ns.Blade() != "blade"


@EACH
@pytest.mark.parametrize("used", [False, True])
@pytest.mark.parametrize(
    "again",
    [
        copy.copy,
        copy.deepcopy,
        lambda c: pickle.loads(pickle.dumps(c)),
        lambda c: restore(specification(c)),
    ],
    ids=["copy", "deepcopy", "pickle", "file"],
)
def test_a_copy_is_what_the_original_is(name: str, used: bool, again: Any) -> None:
    constraint = pairs()[name][0]
    if used:
        values(constraint)
    found = again(constraint)
    assert found == constraint
    assert constraint == found
    assert hash(found) == hash(constraint)
    assert (found.name, found.level, found.relation) == (
        constraint.name,
        constraint.level,
        constraint.relation,
    )
    np.testing.assert_array_equal(values(found), values(constraint))


def test_order_and_names_belong_to_a_system() -> None:
    blade, depth = ns.Blade(), ns.DepthLimit()
    assert ConstraintSystem([blade, depth]) != ConstraintSystem([depth, blade])
    assert ConstraintSystem([blade, depth]).equalities == ConstraintSystem([blade])
    # The second of two equal limits keeps its number without the first.
    mixed = ns.keep_nonnegative(name="blade")(lambda m: m.position[2])
    assert ConstraintSystem([blade, mixed]).limits.names == ("blade 2",)
    assert ConstraintSystem([blade, mixed]).limits != ConstraintSystem([mixed])


def test_a_system_is_sent_without_its_graphs() -> None:
    several = [one for one, _ in PAIRS.values()]
    system = ConstraintSystem(several)
    fresh = len(pickle.dumps(system))
    system.residuals(*INSTANT)
    system.equalities.acceleration_form(*INSTANT)
    for part in (system, system.equalities, system.limits):
        again = pickle.loads(pickle.dumps(part))
        assert again == part
        assert again.names == part.names
        assert copy.deepcopy(part) == part
        np.testing.assert_array_equal(again.residuals(*INSTANT), part.residuals(*INSTANT))
    assert len(pickle.dumps(system)) == fresh


def test_a_system_owns_what_is_built_for_it() -> None:
    built = []

    def build() -> object:
        built.append(object())
        return built[-1]

    system = ConstraintSystem([ns.Blade(), ns.DepthLimit(0.123)])
    found = system.owned(("step", 0.01), build)
    again = ConstraintSystem([ns.Blade(), ns.DepthLimit(0.123)])
    assert again.owned(("step", 0.01), build) is found
    assert copy.deepcopy(system).owned(("step", 0.01), build) is found
    assert len(built) == 1
    assert system.owned(("step", 0.02), build) is not found
    assert ConstraintSystem([ns.Blade()]).owned(("step", 0.01), build) is not found


def test_a_system_shares_with_its_copies_whatever_was_declared_in_between() -> None:
    system = ConstraintSystem([ns.DepthLimit(0.456)])
    found = system.owned("step", lambda: [1])
    for number in range(200):
        ConstraintSystem([ns.DepthLimit(0.001 * number)]).owned("step", lambda: [2])
    assert copy.deepcopy(system).owned("step", lambda: [3]) is found


def test_what_a_system_owns_is_bounded() -> None:
    system = ConstraintSystem([ns.DepthLimit(0.321)])
    for number in range(1000):
        assert system.owned(number, lambda number=number: [number]) == [number]  # type: ignore[misc]
    assert system.owned(999, lambda: "built anew") == [999]
    assert system.owned(0, lambda: "built anew") == "built anew"


def sent(constraint: Constraint) -> tuple[Constraint, list[float]]:
    """Run in another process: what arrives there, and its residuals."""
    return constraint, values(constraint)


def test_constraints_and_systems_cross_processes() -> None:
    several = [one for one, _ in PAIRS.values()]
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        for constraint, (found, there) in zip(several, pool.map(sent, several), strict=True):
            assert found == constraint
            np.testing.assert_array_equal(there, values(constraint))
        system = ConstraintSystem(several)
        assert pool.submit(copy.copy, system).result() == system
