"""Saved primitives: the same motion to the bit, and one clear line for each thing wrong."""

from __future__ import annotations

import copy
import errno
import hashlib
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import refusals
from noslip import (
    Blade,
    ConstrainedDMP,
    Constraint,
    PoseTrajectory,
    learn,
    load_primitive,
    position_constraint,
    prepare,
    velocity_constraint,
)
from noslip.constraints import Instant
from noslip.constraints.catalog import specification
from noslip.errors import InputError


def demonstration(seed: int = 0, turns: float = 0.0, name: str = "cut") -> PoseTrajectory:
    rng = np.random.default_rng(seed)
    s = np.linspace(0, 1, 151)
    x = np.column_stack([s, 0.2 * np.sin(3 * s + rng.uniform(0, 6)), 0.05 * s * rng.uniform()])
    v = np.gradient(x, s, axis=0)
    yaw = np.arctan2(v[:, 1], v[:, 0]) + 0.2 * np.sin(5 * s)
    # Rolled about its edge, the blade stays in the path.
    roll = Rotation.from_rotvec(np.outer(2 * np.pi * turns * s, [1, 0, 0]))
    held = Rotation.from_euler("ZY", np.column_stack([yaw, 0.3 + 0.1 * s]))
    return PoseTrajectory(times=1.7 * s, positions=x, rotations=held * roll, name=name)


def own_rules() -> list[Constraint]:
    """Declare what exists nowhere else: the functions are gone once this returns."""
    height = 0.3

    @velocity_constraint(name="no twist")
    def no_twist(motion: Instant) -> Any:
        return motion.rotation[:, 0].T @ motion.angular_velocity

    @position_constraint
    def on_the_table(motion: Instant) -> Any:
        return motion.position[2] - height + 0.01 * motion.time

    return [no_twist, Blade(lateral="-y"), on_the_table]


def own_rule(expression: Any) -> dict[str, Any]:
    """Saved rule of this expression."""
    return {**specification(own_rules()[0]), "name": "bad", "expression": expression}


@pytest.fixture(scope="module")
def dmp() -> ConstrainedDMP:
    two = [prepare(demonstration(k, name="ab"[k]), relative=True) for k in range(2)]
    return learn(two, [Blade()], basis_functions=20)


@pytest.fixture
def saved(dmp: ConstrainedDMP, tmp_path: Path) -> Path:
    return dmp.save(tmp_path / "cut.json")


def assert_same_motions(a: ConstrainedDMP, b: ConstrainedDMP, **asked: Any) -> None:
    for one, other in ((a, b), (a.constrained, b.constrained), (a.regular, b.regular)):
        mine, theirs = one.rollout(**asked), other.rollout(**asked)
        for name in (
            "times",
            "positions",
            "linear_velocities",
            "angular_velocities",
            "constraint_residuals",
            "multipliers",
            "constraint_forces",
        ):
            np.testing.assert_array_equal(getattr(mine, name), getattr(theirs, name))
        np.testing.assert_array_equal(mine.rotations.as_quat(), theirs.rotations.as_quat())
        assert mine.constraint_names == theirs.constraint_names


# -------------------------------------------------------------------- round trip


@given(
    seed=st.integers(0, 2**32 - 1),
    turns=st.sampled_from([0.0, 1.3]),
    constants=st.fixed_dictionaries(
        {
            "alpha": st.floats(10, 40) | st.just(25),
            "beta": st.floats(2, 10),
            "alpha_s": st.floats(0.3, 3),
            "basis_functions": st.integers(2, 40),
            "stabilization": st.floats(0, 50),
            "metric": st.sampled_from(["position", "shared", (1, 2, 1, 0.5, 0.5, 3.0)]),
        }
    ),
)
@settings(max_examples=20)
def test_a_loaded_primitive_moves_the_same_to_the_bit(
    tmp_path_factory: pytest.TempPathFactory, seed: int, turns: float, constants: dict[str, Any]
) -> None:
    dmp = learn(demonstration(seed, turns), [Blade()], **constants)
    path = dmp.save(tmp_path_factory.mktemp("saved") / "primitive.json")
    again = load_primitive(path)
    rng = np.random.default_rng(seed)
    assert_same_motions(dmp, again)
    assert_same_motions(
        dmp,
        again,
        duration=rng.uniform(0.05, 600),
        goal_position=rng.normal(size=3),
        start_rotation=Rotation.from_rotvec(0.2 * rng.normal(size=3)) * dmp.start_rotation,
    )
    assert_same_motions(dmp, again, time_step=dmp.duration / 137)
    assert again == dmp
    assert hash(again) == hash(dmp)
    assert again != replace(dmp, law=replace(dmp.law, duration=2 * dmp.duration))


# A product with a single row of activations adds up in the order in which weights lie in memory.
def test_steps_are_the_same_to_the_bit_too(dmp: ConstrainedDMP, saved: Path) -> None:
    again = load_primitive(saved)
    mine, theirs = dmp.initial_state(), again.initial_state()
    for _ in range(20):
        mine, theirs = dmp.step(mine, 0.01), again.step(theirs, 0.01)
    np.testing.assert_array_equal(mine.vector(), theirs.vector())


def test_a_users_constraints_need_no_users_code(tmp_path: Path) -> None:
    dmp = learn(demonstration(), own_rules(), basis_functions=20, metric=(1,) * 6)
    again = load_primitive(dmp.save(tmp_path / "own.json"))
    assert_same_motions(dmp, again)
    assert again == dmp
    assert [c.name for c in again.constraints] == ["no twist", "blade", "on the table"]
    assert [c.level for c in again.constraints] == ["velocity", "velocity", "position"]
    assert again.constraints[1] == Blade(lateral="-y")
    # Loaded ones can be saved again, and say the same.
    twice = load_primitive(again.save(tmp_path / "again.json"))
    assert_same_motions(dmp, twice)
    assert (tmp_path / "again.json").read_bytes() == (tmp_path / "own.json").read_bytes()


def test_a_primitive_without_constraints_is_saved_too(tmp_path: Path) -> None:
    dmp = learn(demonstration(), basis_functions=20)
    assert_same_motions(dmp, load_primitive(dmp.save(tmp_path / "free.json")))


def test_the_file_is_plain_json_that_says_what_it_is(dmp: ConstrainedDMP, saved: Path) -> None:
    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is no JSON")

    document = json.loads(saved.read_text(encoding="utf-8"), parse_constant=refuse)
    assert document["format"] == "noslip-primitive"
    assert document["version"] == 2
    content = document["content"]
    assert content["law"]["duration"] == dmp.duration
    arguments = {"lateral": "y", "edge": "x", "reference_point": [0.0, 0.0, 0.0]}
    assert content["rule"]["constraints"] == [{"type": "blade", "arguments": arguments}]
    assert [record["demonstration"] for record in content["record"]] == ["a", "b"]


def test_names_outside_of_ascii_survive(tmp_path: Path) -> None:
    dmp = learn(demonstration(name="Schnitt für Łódź \N{HOCHO}"), [Blade()], basis_functions=5)
    again = load_primitive(dmp.save(tmp_path / "ä ö.json"))
    assert again.record[0].demonstration == "Schnitt für Łódź \N{HOCHO}"


def test_missing_folders_are_made_and_the_path_is_returned(
    dmp: ConstrainedDMP, tmp_path: Path
) -> None:
    path = dmp.save(str(tmp_path / "new" / "folder" / "cut.json"))
    assert path == tmp_path / "new" / "folder" / "cut.json"
    assert load_primitive(str(path)).duration == dmp.duration


@pytest.mark.parametrize("kind", [np.int64, np.float32])
def test_constants_may_be_numpy_scalars(kind: Any, tmp_path: Path) -> None:
    dmp = learn(demonstration(), [Blade()], basis_functions=5, alpha=kind(25))
    assert_same_motions(dmp, load_primitive(dmp.save(tmp_path / "cut.json")))


# -------------------------------------------------------------------- what cannot be loaded


def refusal(path: Path) -> str:
    message = refusals.refusal(InputError, load_primitive, path)
    assert message.startswith(f"{path}: ")
    return message


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    assert "No such file" in refusal(tmp_path / "none.json")


def test_a_folder_is_no_primitive(tmp_path: Path) -> None:
    assert "directory" in refusal(tmp_path)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"not JSON",
        b"{}",
        b"[]",
        b"null",
        b"3",
        b'"noslip-primitive"',
        b'{"format": "another", "version": 2, "content": {}}',
        b'{"version": 2, "checksum": "x", "content": {}}',
        b"\xff\xfe\x00garbage",
        b"t,x,y,z,qw,qx,qy,qz\n0,0,0,0,1,0,0,0\n",
        pytest.param(
            b"[" * 100_000,
            id="deep",
        ),
    ],
)
def test_anything_else_is_no_primitive(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "foreign.json"
    path.write_bytes(content)
    assert "not a noslip primitive" in refusal(path)


@pytest.mark.parametrize("share", [0.001, 0.1, 0.5, 0.9, 0.999])
def test_a_truncated_file_is_no_primitive(saved: Path, share: float) -> None:
    content = saved.read_bytes()
    saved.write_bytes(content[: int(share * len(content))])
    assert "not a noslip primitive" in refusal(saved)


@pytest.mark.parametrize(
    ("version", "remedy"),
    [
        (0, "learn the primitive again"),
        (1, "learn the primitive again"),
        (3, "update noslip"),
        ("2", "update noslip"),
        (None, "update noslip"),
        (1.5, "update noslip"),
    ],
)
def test_another_version_is_refused_with_what_to_do(saved: Path, version: Any, remedy: str) -> None:
    document = json.loads(saved.read_text())
    document["version"] = version
    saved.write_text(json.dumps(document))
    message = refusal(saved)
    assert repr(version) in message
    assert "reads 2" in message
    assert remedy in message


def leaves(content: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Paths to all numbers and texts in a document."""
    if isinstance(content, dict | list):
        items = content.items() if isinstance(content, dict) else enumerate(content)
        for key, value in items:
            yield from leaves(value, (*path, key))
    else:
        yield path


def changed(document: Any, path: tuple[Any, ...], value: Any) -> Any:
    """Copy a document with the entry at a path replaced, or removed (value ``...``)."""
    document = copy.deepcopy(document)
    entry = document
    for key in path[:-1]:
        entry = entry[key]
    if value is ...:
        del entry[path[-1]]
    else:
        entry[path[-1]] = value(entry[path[-1]]) if callable(value) else value
    return document


def test_any_change_of_the_content_is_noticed(saved: Path) -> None:
    document = json.loads(saved.read_text())
    paths = list(leaves(document["content"], ("content",)))
    assert len(paths) > 250
    for path in paths[:: len(paths) // 60]:

        def other(value: Any) -> Any:
            if isinstance(value, float):
                return np.nextafter(value, np.inf)
            return value + 1 if isinstance(value, int) else str(value) + "x"

        saved.write_text(json.dumps(changed(document, path, other)))
        assert "changed or damaged" in refusal(saved), path


def test_a_change_of_the_checksum_is_noticed(saved: Path) -> None:
    document = json.loads(saved.read_text())
    for checksum in ("sha256:0", None, 1):
        saved.write_text(json.dumps(document | {"checksum": checksum}))
        assert "checksum" in refusal(saved)


def test_layout_and_order_do_not_matter(dmp: ConstrainedDMP, saved: Path) -> None:
    document = json.loads(saved.read_text())
    saved.write_text(json.dumps(dict(reversed(document.items())), indent=None))
    assert_same_motions(dmp, load_primitive(saved))


# Python's JSON reads them all.
@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity", "1e999"])
def test_numbers_that_are_not_finite_are_refused(saved: Path, number: str) -> None:
    document = json.loads(saved.read_text())
    text = json.dumps(changed(document, ("content", "duration"), "HERE"))
    saved.write_text(text.replace('"HERE"', number))
    refusal(saved)


# -------------------------------------------------------------------- wrong, and signed


def sign(document: dict[str, Any]) -> str:
    """Renew a document's checksum, as a program that writes such files would."""
    text = json.dumps(document["content"], sort_keys=True, separators=(",", ":"))
    checksum = "sha256:" + hashlib.sha256(text.encode()).hexdigest()
    return json.dumps(document | {"checksum": checksum})


def test_a_document_signed_again_is_loaded(dmp: ConstrainedDMP, saved: Path) -> None:
    saved.write_text(sign(json.loads(saved.read_text())))
    assert_same_motions(dmp, load_primitive(saved))


@pytest.mark.parametrize(
    "field",
    [
        "law",
        "demonstrated",
        "rule",
        "record",
        "history",
        "spread",
        "law.basis_functions",
        "law.duration",
        "law.steps",
        "law.begin",
        "law.attractor",
        "law.attractor.alpha",
        "law.attractor.beta",
        "law.alpha_s",
        "law.weights",
        "demonstrated.winding",
        "rule.constraints",
        "rule.inverse_metric",
        "rule.push",
        "rule.stabilization",
        "rule.barrier_rate",
        "record.0.samples",
        "history.0.verb",
        "history.0.options",
    ],
)
def test_a_missing_field_is_named(saved: Path, field: str) -> None:
    path = ["content", *(int(key) if key.isdigit() else key for key in field.split("."))]
    document = json.loads(saved.read_text())
    saved.write_text(sign(changed(document, tuple(path), ...)))
    assert path[-1] in refusal(saved)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("law.duration", "long"),
        ("law.steps", None),
        ("rule.inverse_metric", [1, 1, 1]),
        ("rule.push", "pull"),
        ("rule.stabilization", []),
        ("rule.constraints", 3),
        ("law.goal_position", [1, 2]),
        ("law.weights", [[1, 2, 3]]),
        ("law.start", [1, 0, 0]),
        ("law.winding", [1, 0, 0, 0]),
        ("law.duration", 0),
        ("law.duration", -2.5),
        ("law.steps", 0),
        ("law.alpha_s", 0),
        ("law.attractor.alpha", -1),
        ("record", "none"),
        ("history", "none"),
    ],
)
def test_a_wrong_field_is_named(saved: Path, field: str, value: Any) -> None:
    path = ("content", *field.split("."))
    document = json.loads(saved.read_text())
    saved.write_text(sign(changed(document, path, lambda _: value)))
    assert path[-1] in refusal(saved)


def test_an_unknown_constraint_is_named(saved: Path) -> None:
    document = json.loads(saved.read_text())
    path = ("content", "rule", "constraints", 0, "type")
    saved.write_text(sign(changed(document, path, "guillotine")))
    assert "'guillotine'" in refusal(saved)


def test_an_expression_that_casadi_cannot_read_is_named(tmp_path: Path) -> None:
    dmp = learn(demonstration(), own_rules(), basis_functions=5, metric=(1,) * 6)
    path = dmp.save(tmp_path / "own.json")
    document = json.loads(path.read_text())
    where = ("content", "rule", "constraints", 0, "expression", "instructions")
    path.write_text(sign(changed(document, where, lambda text: text[: len(text) // 2])))
    assert "'no twist'" in refusal(path)


def test_no_code_in_a_file_is_run(saved: Path, tmp_path: Path) -> None:
    document = json.loads(saved.read_text())
    canary = tmp_path / "canary"
    for path in (
        ("content", "rule", "constraints", 0, "type"),
        ("content", "rule", "constraints", 0, "arguments"),
    ):
        code = f"__import__('pathlib').Path({str(canary)!r}).touch()"
        value: Any = code if path[-1] == "type" else {"lateral": code}
        saved.write_text(sign(changed(document, path, lambda _, value=value: value)))
        refusal(saved)
    assert not canary.exists()


# -------------------------------------------------------------------- writing fails


def test_a_failing_write_leaves_the_old_file(
    dmp: ConstrainedDMP, saved: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = saved.read_bytes()

    def full(self: Path, target: Path) -> Path:
        raise OSError(errno.ENOSPC, "No space left on device")

    other = learn(demonstration(3), [Blade()], basis_functions=5)
    with monkeypatch.context() as patched:
        patched.setattr(Path, "replace", full)
        with pytest.raises(InputError) as caught:
            other.save(saved)
    assert str(caught.value) == f"{saved}: cannot be written: No space left on device"
    assert saved.read_bytes() == before
    assert list(saved.parent.iterdir()) == [saved]
    assert_same_motions(dmp, load_primitive(saved))


def test_an_interrupted_write_leaves_the_old_file(
    saved: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = saved.read_bytes()

    def interrupt(self: Path, target: Path) -> Path:
        raise KeyboardInterrupt

    other = learn(demonstration(3), [Blade()], basis_functions=5)
    with monkeypatch.context() as patched:
        patched.setattr(Path, "replace", interrupt)
        with pytest.raises(KeyboardInterrupt):
            other.save(saved)
    assert saved.read_bytes() == before
    assert list(saved.parent.iterdir()) == [saved]


def test_an_impossible_place_is_named(dmp: ConstrainedDMP, saved: Path) -> None:
    for place in (saved.parent, saved / "below.json"):
        message = refusals.refusal(InputError, dmp.save, place)
        assert str(place) in message and "cannot be written" in message
    assert list(saved.parent.iterdir()) == [saved]


# Reading a function that CasADi serialized may run a compiler, or load a library, that it names.
def test_a_constraint_as_casadi_serializes_it_is_refused(dmp: ConstrainedDMP, saved: Path) -> None:
    document = json.loads(saved.read_text())
    function = casadi.Function("f", [casadi.SX.sym("x")], [casadi.SX(1)])
    entry = {
        **specification(own_rules()[0]),
        "name": "bad",
        "expression": {"instructions": function.serialize()},
    }
    saved.write_text(sign(changed(document, ("content", "rule", "constraints"), [entry])))
    assert "constraints" in refusal(saved)


@pytest.mark.parametrize(
    "instructions", [3, [["CALL", 0, 0]], [["ADD", 0, 7, 8]], [["INPUT", 0, 9, 0]], [["OUTPUT"]]]
)
def test_instructions_that_are_no_arithmetic_are_refused(saved: Path, instructions: Any) -> None:
    document = json.loads(saved.read_text())
    entry = {
        **specification(own_rules()[0]),
        "name": "bad",
        "expression": {"instructions": instructions},
    }
    saved.write_text(sign(changed(document, ("content", "rule", "constraints"), [entry])))
    assert "bad" in refusal(saved)
