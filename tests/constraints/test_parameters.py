"""Rules of one's own with parameters: called, compared, saved and read back, named in commands."""

from __future__ import annotations

import copy
import inspect
import json
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import noslip as ns
from motions import planar_cut
from noslip.constraints import ConstraintSystem
from noslip.constraints.catalog import parse_constraint, restore, specification
from noslip.errors import ConstraintError

RULES = '''
"""Rules of a user."""
import noslip as ns


@ns.velocity_constraint
def sideways(motion: ns.Instant, *, slope: float = 0.0, label: str = "a"):
    """The tool moves along its x axis, tilted by a slope."""
    velocity = motion.rotation.T @ motion.linear_velocity
    return velocity[1] - slope * velocity[0]


@ns.keep_nonnegative(priority=2)
def above(motion: ns.Instant, height, *, along=(0, 0, 1)):
    return sum(a * motion.position[k] for k, a in enumerate(along)) - height


flat = ns.position_constraint(lambda motion: motion.position[2], name="flat")
'''


@pytest.fixture
def rules(tmp_path: Path) -> Path:
    path = tmp_path / "rules.py"
    path.write_text(RULES)
    return path


@ns.velocity_constraint
def drift(motion: ns.Instant, *, slope: float = 0.25, note: Any = None) -> Any:
    """Sideways, in proportion to the way ahead."""
    return motion.linear_velocity[1] - slope * motion.linear_velocity[0]


VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**53), 2**53)
    | st.text(max_size=8)
    | st.floats(allow_nan=False, allow_infinity=False),
    lambda inner: st.lists(inner, max_size=3),
    max_leaves=6,
)


def as_tuples(value: Any) -> Any:
    return tuple(map(as_tuples, value)) if isinstance(value, list) else value


@given(slope=st.floats(-1e3, 1e3), note=VALUES)
@settings(max_examples=20)
def test_what_is_saved_comes_back_with_its_parameters(slope: float, note: Any) -> None:
    rule = drift(slope=slope, note=note)
    assert rule.parameters == {"slope": slope, "note": as_tuples(note)}
    back = restore(json.loads(json.dumps(specification(rule), allow_nan=False)))
    assert (back.name, back.parameters, back.level) == ("drift", rule.parameters, "velocity")
    assert back == rule and hash(back) == hash(rule) and repr(back) == repr(rule)
    assert pickle.loads(pickle.dumps(rule)) == copy.deepcopy(rule) == rule


@given(slopes=st.tuples(st.floats(-9, 9), st.floats(-9, 9)))
@settings(max_examples=10)
def test_parameters_are_what_tells_rules_apart(slopes: tuple[float, float]) -> None:
    one, other = (drift(slope=slope) for slope in slopes)
    assert (one == other) == (slopes[0] == slopes[1])
    # Called again, what is not named stays.
    assert one(note="x")(slope=slopes[1]) == drift(slope=slopes[1], note="x")
    # The residual is that of the function, called by hand.
    motion = planar_cut(0.4)
    v = motion.step_velocities()[0]
    expected = np.abs(v[:, 1] - slopes[0] * v[:, 0]).max()
    assert ns.check(motion, one).constraints[0].peak == pytest.approx(expected, abs=1e-12)


def test_a_rule_says_what_it_takes() -> None:
    assert drift.__doc__ == "Sideways, in proportion to the way ahead."
    assert list(inspect.signature(drift).parameters) == ["slope", "note"]
    assert repr(drift(slope=0.5)) == "<velocity constraint 'drift' (slope=0.5, note=None)>"
    assert ns.Blade().parameters == {
        "lateral": "y",
        "edge": "x",
        "reference_point": (0.0, 0.0, 0.0),
    }


def test_a_primitive_comes_back_with_name_and_parameters(rules: Path, tmp_path: Path) -> None:
    held = [parse_constraint(f"{rules}:sideways(slope=0.1)"), ns.DepthLimit(depth=1.0)]
    dmp = ns.learn(planar_cut(0.4), held, basis_functions=20)
    path = dmp.save(tmp_path / "cut.json")
    rules.unlink()
    found = ns.load_primitive(path)
    assert found.constraints == dmp.constraints
    assert found.constraints[0].name == "sideways"
    assert found.constraints[0].parameters == {"slope": 0.1, "label": "a"}


def test_a_level_follows_from_what_the_parameters_complete(rules: Path) -> None:
    above = parse_constraint(f"{rules}:above(height=0.1)")
    assert (above.level, above.relation, above.priority) == ("position", "nonnegative", 2)
    assert above.parameters == {"height": 0.1, "along": (0, 0, 1)}
    with pytest.raises(
        ConstraintError, match=r"'above': give its parameters: above\(height=\.\.\."
    ):
        ConstraintSystem([parse_constraint(f"{rules}:above")])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("sideways(slop=1)", "did you mean slope?"),
        ("sideways(slope=open('x'))", "nothing is evaluated"),
        ("sideways(1)", "name each argument"),
        ("sideways(slope=1", "is not understood"),
        ("sideway", "did you mean sideways?"),
        ("flat(height=1)", "it has none"),
        ("sideways(slope={'a': 1})", "a finite number, a text or a sequence"),
        ("sideways(slope=1e999)", "a finite number, a text or a sequence"),
    ],
)
def test_what_is_no_parameter_is_refused(rules: Path, text: str, said: str) -> None:
    with pytest.raises(ConstraintError) as caught:
        parse_constraint(f"{rules}:{text}")
    assert said in str(caught.value) and "\n" not in str(caught.value)


def test_defaults_that_are_no_data_are_part_of_the_expression_alone() -> None:
    places = {"row": 1}
    rule = ns.velocity_constraint(lambda m, k=2, at=places: k * m.linear_velocity[at["row"]])
    assert rule.parameters == {"k": 2}


@pytest.mark.parametrize("wrong", [[1], {"slope": {"a": 1}}, {"slope": None, "x": [{}]}, "slope"])
def test_a_file_whose_parameters_are_no_data_is_refused(wrong: Any) -> None:
    data = specification(drift(slope=1.0)) | {"parameters": wrong}
    with pytest.raises(ConstraintError, match="cannot be read"):
        restore(data)


def test_an_editor_completes_a_motion_inside_a_rule() -> None:
    jedi = pytest.importorskip("jedi", reason="what completes in IPython is not installed")
    lines = [
        "import noslip as ns",
        "@ns.velocity_constraint",
        "def rule(motion: ns.Instant):",
        "    return motion.",
    ]
    found = {each.name for each in jedi.Script("\n".join(lines)).complete(4, len(lines[3]))}
    assert {"position", "rotation", "linear_velocity", "angular_velocity", "time", "at"} <= found
