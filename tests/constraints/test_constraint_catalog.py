"""Constraints by name: what a text may say, and that nothing in it is evaluated."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from noslip import Blade, Constraint, position_constraint, velocity_constraint
from noslip.constraints import ConstraintSystem, catalog
from noslip.constraints.catalog import parse_constraint, restore, specification
from noslip.errors import ConstraintError
from refusals import refusal

RULES = '''
"""Rules of one user."""
import casadi
import noslip as ns

@ns.position_constraint
def stay_flat(motion):
    return motion.position[2] - 0.02

class Wheel(ns.Constraint):
    name = "wheel"
    def residual(self, motion):
        return motion.linear_velocity[1]

height = 0.02
'''


@pytest.fixture
def rules(tmp_path: Path) -> Path:
    path = tmp_path / "my_rules.py"
    path.write_text(RULES)
    return path


refused = partial(refusal, ConstraintError, parse_constraint)


# -------------------------------------------------------------------- names and calls


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("blade", Blade()),
        (" blade\n", Blade()),
        ("blade()", Blade()),
        ("blade(lateral='z')", Blade(lateral="z")),
        ('blade( edge = "-x" )', Blade(edge="-x")),
        ("blade(lateral='-z', edge='-y')", Blade(lateral="-z", edge="-y")),
    ],
)
def test_names_and_calls_with_literals_are_understood(text: str, expected: Blade) -> None:
    assert parse_constraint(text) == expected


def test_names_may_have_hyphens(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(catalog.CATALOG, "scalpel-blade", Blade)
    for text in ("scalpel-blade", "scalpel_blade", "scalpel-blade(edge='-x')"):
        assert isinstance(parse_constraint(text), Blade)
    # Only the name's hyphens; those of arguments are signs.
    assert parse_constraint("scalpel-blade(edge='-x')") == Blade(edge="-x")


@pytest.mark.parametrize(
    "argument",
    [
        "__import__('os')",
        "open('canary', 'w')",
        "[].append(1)",
        "f'{1}'",
        "'x' + 'y'",
        "lambda: 'z'",
        "x",
        "(lambda: open('canary', 'w'))()",
        "[open('canary', 'w') for _ in 'x']",
    ],
)
def test_code_in_arguments_is_refused_and_not_run(
    argument: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    message = refused(f"blade(lateral={argument})")
    assert "lateral" in message
    assert "nothing is evaluated" in message
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "text",
    [
        "",
        "   ",
        "1",
        "'blade'",
        "blade.evil()",
        "blade; import os",
        "blade(lateral='z'",
        "lambda: 1",
        "[blade]",
        "blade if 1 else blade",
        "__import__('os').system('true')",
        "blade()()",
        "blade\0",
        "(" * 300 + ")" * 300,
    ],
)
def test_anything_else_is_refused_with_what_is_known(text: str) -> None:
    message = refused(text)
    assert "not understood" in message
    assert "blade" in message
    assert "file.py:name" in message


def test_code_as_a_call_is_looked_up_and_not_run() -> None:
    assert "no constraint is called 'eval'" in refused("eval(lateral='1')")
    assert "name each argument" in refused("eval('1')")


@pytest.mark.parametrize("text", ["knife", "Blade", "BLADE()", "nee-dle", "os"])
def test_unknown_names_are_refused_with_those_known(text: str) -> None:
    message = refused(text)
    assert "known are" in message
    assert "blade" in message


def test_unknown_arguments_are_refused_with_those_known() -> None:
    message = refused("blade(lateral='z', sharpness=3)")
    assert "'sharpness'" in message
    assert "lateral, edge" in message


@pytest.mark.parametrize("text", ["blade('z')", "blade(*'yz')", "blade(**{'lateral': 'z'})"])
def test_arguments_without_names_are_refused(text: str) -> None:
    assert "name each argument" in refused(text)


@pytest.mark.parametrize("value", ["'w'", "3", "None", "['z']", "b'z'", "'y'", "-1.5"])
def test_wrong_arguments_are_refused_with_what_they_may_be(value: str) -> None:
    assert "x" in refused(f"blade(edge={value})")


def test_an_argument_given_twice_is_refused() -> None:
    assert "lateral" in refused("blade(lateral='z', lateral='y')")


def test_a_literal_that_cannot_be_built_is_refused() -> None:
    assert "lateral" in refused("blade(lateral={[]: 1})")


# -------------------------------------------------------------------- files


def test_a_users_constraint_is_imported(rules: Path) -> None:
    flat = parse_constraint(f"{rules}:stay_flat")
    assert (flat.name, flat.level) == ("stay flat", "position")
    system = ConstraintSystem(flat)
    found = system.residuals(0.0, [1, 2, 3.0], [1, 0, 0, 0], np.zeros(3), np.zeros(3))
    assert found[0] == pytest.approx([2.98])


def test_a_users_class_is_called(rules: Path) -> None:
    wheel = parse_constraint(f"{rules}:Wheel")
    assert isinstance(wheel, Constraint)
    assert wheel.name == "wheel"


@pytest.mark.parametrize("name", ["missing", "height", "casadi", "", "stay_flat.name"])
def test_what_is_no_constraint_is_refused_with_those_declared(rules: Path, name: str) -> None:
    message = refused(f"{rules}:{name}")
    assert str(rules) in message
    assert "it declares stay_flat" in message


def test_a_file_without_constraints_says_so(tmp_path: Path) -> None:
    path = tmp_path / "empty.py"
    path.write_text("")
    assert "it declares no constraint" in refused(f"{path}:rule")


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    assert str(tmp_path / "none.py") in refused(f"{tmp_path / 'none.py'}:rule")


@pytest.mark.parametrize(
    ("source", "reason"),
    [
        ("def (:", "SyntaxError"),
        ("import no_such_module_at_all", "ModuleNotFoundError"),
        ("1 / 0", "ZeroDivisionError"),
        ("raise ValueError('two\\nlines')", "ValueError"),
    ],
)
def test_a_file_that_fails_is_named_with_its_error(
    tmp_path: Path, source: str, reason: str
) -> None:
    path = tmp_path / "broken.py"
    path.write_text(source)
    with pytest.raises(ConstraintError) as caught:
        parse_constraint(f"{path}:rule")
    assert str(path) in str(caught.value)
    assert reason in str(caught.value)


def test_a_file_that_fails_is_named_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "broken.py"
    path.write_text("raise ValueError('two\\nlines')")
    refused(f"{path}:rule")


def test_a_users_class_that_needs_arguments_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "wheels.py"
    path.write_text(
        "import noslip as ns\n"
        "class Wheel(ns.Constraint):\n"
        "    name = 'wheel'\n"
        "    def __init__(self, radius):\n"
        "        self.radius = radius\n"
        "    def residual(self, motion):\n"
        "        return motion.linear_velocity[1] - self.radius\n"
    )
    assert str(path) in refused(f"{path}:Wheel")


# -------------------------------------------------------------------- as plain data, and back

INSTANT = (
    0.3,
    [0.1, -0.2, 0.4],
    Rotation.from_euler("xyz", [0.2, 0.4, -0.9]).as_quat(scalar_first=True),
    [1.0, 2.0, 3.0],
    [0.4, 0.5, 0.6],
)


def twist_free(motion: Any) -> Any:
    return [
        motion.rotation[:, 0].T @ motion.angular_velocity,
        motion.time * motion.linear_velocity[0],
    ]


def tilted(motion: Any) -> Any:
    return motion.rotation[2, 0] - 0.1 * motion.position[0]


@pytest.mark.parametrize(
    "constraint",
    [
        Blade(lateral="-z", edge="y"),
        velocity_constraint(name="twist free")(twist_free),
        position_constraint(tilted),
    ],
    ids=["blade", "velocity", "position"],
)
def test_a_specification_restores_the_same_constraint(constraint: Constraint) -> None:
    again = restore(specification(constraint))
    assert (again.name, again.level, again.edge) == (
        constraint.name,
        constraint.level,
        constraint.edge,
    )
    np.testing.assert_array_equal(
        ConstraintSystem(again).residuals(*INSTANT),
        ConstraintSystem(constraint).residuals(*INSTANT),
    )
    for mine, theirs in zip(
        ConstraintSystem(again).acceleration_form(*INSTANT),
        ConstraintSystem(constraint).acceleration_form(*INSTANT),
        strict=True,
    ):
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-15)
    # Saved, loaded and saved again.
    assert restore(specification(again)).name == constraint.name
