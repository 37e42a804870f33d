"""Whatever a public function takes as a number refuses what is none, in one line."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import noslip as ns
from motions import planar_cut
from noslip.boundary import Boundary
from noslip.constraints.declaration import CATALOG
from noslip.constraints.system import ConstraintSystem
from noslip.demonstrations.excision import synthetic_excisions
from noslip.errors import InputError, NoslipError
from noslip.law.fitting import fit
from noslip.robots.timing import timed
from refusals import refusal

CUT = planar_cut()
DMP = ns.learn(CUT, ns.Blade(), basis_functions=20)
STATE = DMP.initial_state()
CALLS: dict[str, Callable[..., object]] = {
    "learn": lambda **given: ns.learn(CUT, ns.Blade(), **given),
    "fit": lambda **given: fit(CUT, **given),
    "check": lambda **given: ns.check(CUT, ns.Blade(), **given),
    "prepare": lambda **given: ns.prepare(CUT, **given),
    "segment": lambda **given: ns.segment(CUT, **given),
    "outliers": lambda **given: ns.demonstrations.outliers([CUT] * 5, **given),
    "project_trajectory": lambda **given: ns.project_trajectory(CUT, ns.Blade(), **given),
    "resampled": lambda **given: CUT.resampled(**given),
    "rollout": lambda **given: DMP.rollout(**given),
    "initial_state": lambda **given: DMP.initial_state(**given),
    "adapt": lambda **given: DMP.adapt(**given),
    "replan": lambda **given: DMP.replan(STATE, **given),
    "rollout_many": lambda **given: DMP.rollout_many(**({"goals": np.ones((2, 3))} | given)),
    "Controller": lambda **given: ns.Controller(DMP, **({"time_step": 0.01} | given)),
    "Controller.step": lambda **given: ns.Controller(DMP, time_step=0.01).step(**given),
    "Boundary.via": lambda **given: Boundary.via(**({"at": 0.5, "position": [0, 0, 0]} | given)),
    "timed": lambda **given: timed(CUT, **given),
    "learn_each": lambda **given: ns.learn_each(__file__, **given),
    "synthetic_excisions": lambda **given: synthetic_excisions(**given),
}
OF = {
    "learn": ns.learn,
    "fit": fit,
    "check": ns.check,
    "prepare": ns.prepare,
    "segment": ns.segment,
    "outliers": ns.demonstrations.outliers,
    "project_trajectory": ns.project_trajectory,
    "resampled": ns.PoseTrajectory.resampled,
    "rollout": ns.ConstrainedDMP.rollout,
    "initial_state": ns.ConstrainedDMP.initial_state,
    "adapt": ns.ConstrainedDMP.adapt,
    "replan": ns.ConstrainedDMP.replan,
    "rollout_many": ns.ConstrainedDMP.rollout_many,
    "Controller": ns.Controller,
    "Controller.step": ns.Controller.step,
    "Boundary.via": Boundary.via,
    "timed": timed,
    "learn_each": ns.learn_each,
    "synthetic_excisions": synthetic_excisions,
}
"""Whose signature tells what they take; a new number among it is asked for here by itself."""


def takes_numbers(function: Callable[..., object]) -> Iterator[tuple[str, str]]:
    for name, parameter in inspect.signature(function).parameters.items():
        kind = str(parameter.annotation).removesuffix(" | None")
        if kind in ("float", "int", "ArrayLike", "Floats", "Triple", "float | bool"):
            yield name, kind


NUMBERS = [(call, *found) for call, function in OF.items() for found in takes_numbers(function)]
NO_NUMBERS = ["3", "three", True, np.nan, object(), {}, [["a"]]]
VALUES = [
    pytest.param(call, name, value, id=f"{call}-{name}-{value!r:.12}")
    for call, name, kind in NUMBERS
    for value in NO_NUMBERS
    if not (kind == "float | bool" and value is True)
]


@pytest.mark.parametrize(("call", "name", "value"), VALUES)
def test_what_is_no_number_is_refused_in_one_line(call: str, name: str, value: Any) -> None:
    message = refusal(NoslipError, CALLS[call], **{name: value})
    assert name.replace("_", " ") in message.replace("_", " ")


# Those of joints ask for the robot first; tests/constraints/test_joint_limits.py.
@pytest.mark.parametrize("name", sorted(set(CATALOG) - {"joint-limits"}))
@pytest.mark.parametrize("value", NO_NUMBERS)
def test_constraints_are_declared_with_numbers(name: str, value: Any) -> None:
    declared = CATALOG[name]

    def declare(**given: Any) -> ConstraintSystem:
        return ConstraintSystem([declared(**given)])

    for field, kind in takes_numbers(declared):
        if kind != "int":
            assert field in refusal(NoslipError, declare, **{field: value})


@pytest.mark.parametrize(
    "given",
    [
        {"times": ["0", "1"]},
        {"times": [False, True]},
        {"positions": [["0", "0", "0"], ["1", "0", "0"]]},
        {"positions": np.zeros((2, 3), dtype=bool)},
    ],
)
def test_a_trajectory_is_made_of_numbers(given: dict[str, Any]) -> None:
    fields = {"times": [0, 1], "positions": np.eye(3)[:2], "rotations": Rotation.identity(2)}
    ns.PoseTrajectory(**fields)  # type: ignore[arg-type]
    [name] = given
    message = refusal(InputError, ns.PoseTrajectory, **(fields | given))
    assert f"{name} is not an array of numbers" in message


@pytest.mark.parametrize("pair", [("0", None), (None, True), (0.1, "1.0")])
def test_times_to_trim_at_are_numbers(pair: tuple[Any, Any]) -> None:
    assert "trim_time" in refusal(InputError, ns.prepare, CUT, trim_time=pair)
    assert "trim_time" in refusal(InputError, ns.segment, CUT, times=[pair])
    assert "thresholds" in refusal(InputError, ns.segment, CUT, thresholds=("1", 2))
