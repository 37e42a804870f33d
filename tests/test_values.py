"""What flows is sent and copied without what was built from it, and compares by what it says."""

from __future__ import annotations

import copy
import io
import multiprocessing
import pickle
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import noslip as ns
from learned import cutting
from noslip.boundary import Boundary
from noslip.constraints.system import ConstraintSystem
from noslip.learning import learn
from noslip.provenance import Origin
from noslip.rule import Rule
from noslip.runtime.stepper import Stepper, stepper_of
from noslip.spread import Spread


def limited() -> list[ns.Constraint]:
    return [ns.Blade(), ns.SpeedLimit(5.0)]


@cache
def values() -> dict[str, Any]:
    """Of everything that a user holds, one that was used."""
    dmp = learn(cutting().rollout(), limited(), basis_functions=20)
    controller = dmp.controller(time_step=0.01)
    for _ in range(3):
        controller.step()
    goal = dmp.goal_position + [0.0, 0.02, 0.0]
    return {
        "recording": cutting().rollout().resampled(rate=50.0),
        "motion": dmp.rollout(),
        "motions": dmp.rollout_many(goals=np.array([goal, goal])),
        "state": controller.state,
        "first state": dmp.initial_state(),
        "law": dmp.law,
        "rule": dmp.rule,
        "system": dmp.system,
        "primitive": dmp,
        "without constraints": dmp.regular,
        "adapted": dmp.adapt(goal_position=goal, via=[(0.5, goal / 2)]),
        "re-planned": dmp.replan(controller.state),
        "controller": controller,
        "boundary": Boundary(1.0, goal, Rotation.identity()),
        "spread": Spread(2, np.eye(3)[None], np.eye(3)[None]),
        "origin": Origin("learn", {"alpha": 25.0, "metric": [1.0] * 6}),
    }


NAMES = list(values())


def there_and_back(value: Any) -> Any:
    return pickle.loads(pickle.dumps(value))


class Strict(pickle.Pickler):
    """Refuses what is built from values."""

    def reducer_override(self, value: Any) -> Any:
        assert not isinstance(value, (ca.SX, ca.Function, Stepper)), value
        return NotImplemented


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("copied", [there_and_back, copy.deepcopy, copy.copy])
def test_a_copy_is_equal(name: str, copied: Callable[[Any], Any]) -> None:
    value = values()[name]
    again = copied(value)
    assert again == value
    if name != "controller":
        assert hash(again) == hash(value)


@pytest.mark.parametrize("name", NAMES)
def test_no_graph_is_sent(name: str) -> None:
    Strict(io.BytesIO()).dump(values()[name])


@pytest.mark.parametrize("name", NAMES)
def test_it_differs_from_all_others(name: str) -> None:
    value = values()[name]
    assert [other for other, found in values().items() if found == value] == [name]
    assert value != 3


def test_what_was_not_used_yet_is_sent_too() -> None:
    dmp = ns.ConstrainedDMP(cutting().law, Rule(ConstraintSystem(ns.Blade(lateral="z"))))
    again = there_and_back(dmp)
    assert again == dmp
    np.testing.assert_array_equal(again.rollout().positions, dmp.rollout().positions)


def test_one_number_makes_a_difference() -> None:
    dmp = values()["primitive"]
    for changed in (
        replace(dmp, law=replace(dmp.law, duration=np.nextafter(dmp.duration, 9))),
        replace(dmp, rule=replace(dmp.rule, barrier_rate=301.0)),
        replace(dmp, history=()),
    ):
        assert changed != dmp


@pytest.mark.parametrize("copied", [there_and_back, copy.deepcopy])
def test_arrays_of_a_copy_cannot_be_written_to(copied: Callable[[Any], Any]) -> None:
    again = copied(values()["motion"])
    with pytest.raises(ValueError, match="read-only"):
        again.positions[0] = 0.0


@pytest.mark.parametrize("copied", [there_and_back, copy.deepcopy])
def test_a_copied_controller_goes_on_by_itself(copied: Callable[[Any], Any]) -> None:
    controller = copied(values()["controller"])
    again = copied(controller)
    for _ in range(5):
        one, other = controller.step(), again.step()
        np.testing.assert_allclose(one.vector(), other.vector(), rtol=0, atol=1e-14)
    before = controller.state
    again.step()
    assert controller.state == before


@pytest.mark.parametrize("copied", [there_and_back, copy.deepcopy])
def test_a_copy_rolls_out_by_the_graph_and_machine_code_of_its_original(
    copied: Callable[[Any], Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    # Its graphs may be others than those of what was made long ago: another test forgets all.
    dmp = copy.deepcopy(values()["primitive"])
    stepper = stepper_of(dmp.rule)
    # Nor need anything have been built for it in this process.
    dmp.rollout()
    again = copied(dmp)
    assert stepper_of(again.rule) is stepper
    # Whatever is built is built through these.
    monkeypatch.setattr("casadi.Function", None)
    again.rollout()


def elsewhere(value: Any) -> Any:
    """In another process: the value, and the positions of its motion if it has one."""
    return value, getattr(value, "rollout", lambda: None)()


@pytest.mark.slow
def test_values_cross_processes() -> None:
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context) as pool:
        for name, (again, motion) in zip(
            NAMES, pool.map(elsewhere, values().values()), strict=True
        ):
            value = values()[name]
            assert again == value
            if motion is not None:
                np.testing.assert_array_equal(motion.positions, value.rollout().positions)


@pytest.mark.parametrize("demonstrations", [1, 3])
def test_each_graph_is_built_once(demonstrations: int, monkeypatch: pytest.MonkeyPatch) -> None:
    rule = [ns.Blade(reference_point=(0.01, 0.002, 0.0003 * demonstrations))]
    built: list[str] = []
    real = ca.Function

    def counted(name: str, *arguments: Any, **options: Any) -> Any:
        built.append(name)
        return real(name, *arguments, **options)

    monkeypatch.setattr(ca, "Function", counted)
    recorded = [cutting().rollout(duration=1.0 + 0.1 * k) for k in range(demonstrations)]
    built.clear()

    def used() -> None:
        dmp = learn(recorded, rule, basis_functions=20)
        there = dmp.adapt(goal_position=dmp.goal_position + 0.01)
        there.rollout()
        there.controller(time_step=0.01)
        there.replan(dmp.initial_state())

    used()
    assert sorted(set(built)) == sorted(built)
    # A primitive learned anew, under an equal rule: not even an expression is built.
    monkeypatch.setattr(ca, "Function", None)
    monkeypatch.setattr(ca, "vertcat", None)
    used()
