"""Tools kept out of fields of distances: in Python, in plans and in C."""

from __future__ import annotations

import ctypes
import json
import shutil
import subprocess
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip._typing import Floats
from noslip.codegen import c99
from noslip.constraints import ConstraintSystem, DistanceField, KeepOut
from noslip.constraints.catalog import parse_constraint, restore, specification
from noslip.errors import ConstraintError, InputError
from noslip.exporting import export
from refusals import refusal

CENTER, RADIUS = np.array([0.05, -0.006, 0.0]), 0.01
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror")
TOUCHING = [((0.0, 0.0, 0.0), 0.002), ((-0.006, 0.0, 0.0), 0.001)]


def nerve() -> DistanceField:
    return DistanceField.from_points(CENTER[None], RADIUS, 0.003, margin=0.02)


def room() -> DistanceField:
    grid = np.zeros((40, 30), dtype=bool)
    grid[20:24, 3:6] = True
    return DistanceField.from_grid(grid, 0.004, (-0.03, -0.05), yaw=0.1)


def hand() -> ns.PoseTrajectory:
    s = np.linspace(0, 1, 101)
    u = s**3 * (10 - 15 * s + 6 * s**2)
    path = np.column_stack([0.1 * u, 0 * u, 0 * u])
    return ns.PoseTrajectory(4 * s, path, Rotation.identity(len(s)))


def clearances(motion: ns.PoseTrajectory) -> Floats:
    """True distances of the spheres to the nerve."""
    return np.column_stack(
        [
            np.linalg.norm(motion.positions + motion.rotations.apply(at) - CENTER, axis=1)
            - RADIUS
            - radius
            for at, radius in TOUCHING
        ]
    )


@pytest.fixture(scope="module")
def rules() -> list[ns.Constraint]:
    return [ns.Blade(), KeepOut(nerve(), clearance=0.001, spheres=TOUCHING), KeepOut(room())]


@pytest.fixture(scope="module")
def primitive(rules: list[ns.Constraint]) -> ns.ConstrainedDMP:
    return ns.learn(hand(), rules)


# ---------------------------------------------------------------- declared


def test_margins_are_distances_less_what_is_kept(rules):
    rng = np.random.default_rng(0)
    positions, turns = rng.uniform(-0.02, 0.1, (50, 3)), Rotation.random(50, rng=rng)
    system, still = ConstraintSystem(rules[1]), np.zeros((50, 3))
    quaternions = turns.as_quat(scalar_first=True)
    found = system.residuals(np.zeros(50), positions, quaternions, still, still)
    for row, (center, radius) in enumerate(TOUCHING):
        at = positions + turns.apply(center)
        assert found[:, row] == pytest.approx(nerve().distance(at) - radius - 0.001, abs=1e-12)
    tip = ConstraintSystem(KeepOut(nerve(), reference_point=(0.01, 0, 0)))
    found = tip.residuals(np.zeros(50), positions, quaternions, still, still)
    at = positions + turns.apply([0.01, 0, 0])
    assert found[:, 0] == pytest.approx(nerve().distance(at), abs=1e-12)


def test_it_is_kept_as_data(rules):
    for rule in rules[1:]:
        again = restore(json.loads(json.dumps(specification(rule))))
        assert again == rule and hash(again) == hash(rule)
    assert ConstraintSystem(rules) == ConstraintSystem([restore(specification(r)) for r in rules])
    damaged = specification(rules[2])
    damaged["arguments"]["field"]["distances"]["shape"] = [1, 2]
    refusal(InputError, restore, damaged)
    damaged["arguments"]["field"] = "room.yaml"
    assert "only a user may name" in refusal(ConstraintError, restore, damaged)


def test_the_command_line_names_files(tmp_path):
    image = pytest.importorskip("PIL.Image")
    pixels = np.full((20, 30), 254, dtype=np.uint8)
    pixels[3, 5] = 0
    image.fromarray(pixels).save(tmp_path / "room.png")
    path = tmp_path / "room.yaml"
    path.write_text(
        "image: room.png\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    rule = parse_constraint(f"keep-out(field={str(path)!r}, clearance=0.4)")
    assert isinstance(rule, KeepOut)
    assert rule == KeepOut(DistanceField.from_map(path, margin=0.4), clearance=0.4)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"field": "cave.yaml"}, "no such file"),
        ({"field": "cave.xyz"}, "must be a DistanceField"),
        ({"field": np.eye(3)}, "must be a DistanceField"),
        ({"clearance": -1}, "clearance must be"),
        ({"clearance": 1}, "margin=1 or more"),
        ({"spheres": [1]}, "pairs of a center"),
        ({"spheres": [((0, 0, 0), -1)]}, "radius must be"),
        ({"spheres": [((0, 0), 1)]}, "center must be"),
        ({"spheres": TOUCHING, "reference_point": (1, 0, 0)}, "one of both"),
    ],
    ids=str,
)
def test_what_cannot_be_kept_is_refused(given, said):
    assert said in refusal(ConstraintError, KeepOut, **given)


# ---------------------------------------------------------------- kept


def test_motions_keep_the_clearance(primitive, rules):
    for motion in (primitive.rollout(), primitive.rollout(time_step=0.004)):
        assert clearances(motion).min() >= 0.001 - 1e-9
        assert room().distance(motion.positions).min() >= -1e-9
        assert ns.check(motion, rules).satisfied
    # It would not, freely.
    assert clearances(hand()).min() < -0.005
    there = primitive.adapt(goal_position=(0.105, 0.006, 0.0)).rollout()
    assert there.positions[-1] == pytest.approx([0.105, 0.006, 0.0], abs=1e-5)
    assert clearances(there).min() >= 0.001 - 1e-9


def test_a_saved_primitive_moves_as_before(primitive, tmp_path):
    primitive.save(tmp_path / "cut.json")
    again = ns.load_primitive(tmp_path / "cut.json")
    assert (again.rollout().positions == primitive.rollout().positions).all()


# ---------------------------------------------------------------- C

needs_cc = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")


def built(folder: Path, files: list[str], *options: str) -> None:
    command = ["cc", *options, *files, "-lm"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[:2000]


@needs_cc
def test_what_c_looks_up_is_the_same_to_the_bit(tmp_path):
    p = ca.SX.sym("p", 3)
    several = [nerve().expression(p), room().expression(p), nerve().expression(2 * p)]
    value = ca.vertcat(*several)
    rows = ca.vertcat(value, ca.vec(ca.jacobian(value, p)), ca.vec(ca.hessian(value[0], p)[0]))
    function = ca.Function("rows", [p], [ca.densify(ca.cse(rows))])
    code = c99.plain(c99.Plain({"rows": function}, ("p",), ("found",)))
    code = '#include "inside.h"\n' + code
    code += "\nvoid rows(const double *p, double *found);\n"
    code += "void rows(const double *p, double *found) { noslip_rows(p, found); }\n"
    texts = {
        "noslip.h": c99.header(0, 0),
        "inside.h": c99.template("inside.h"),
        "rows.c": code,
        **c99.grids(function),
    }
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
    built(
        tmp_path,
        ["rows.c", "grids.c"],
        *STRICT,
        "-ffp-contract=off",
        "-fPIC",
        "-shared",
        "-orows.so",
    )
    call = ctypes.CDLL(str(tmp_path / "rows.so")).rows
    points = np.random.default_rng(0).uniform(-0.1, 0.2, (1000, 3))
    points[:2] = [[np.nan, 0, 0], [1e9, -1e9, 0]]
    expected = np.array(function.map(1000)(points.T)).T
    found = np.empty(expected.shape)
    for point, row in zip(points, found, strict=True):
        call(point.ctypes.data_as(ctypes.c_void_p), row.ctypes.data_as(ctypes.c_void_p))
    np.testing.assert_array_equal(found, expected)
    assert np.isnan(found[0]).any() and np.isfinite(found[1:]).all()


@needs_cc
def test_exported_c_keeps_out_as_python_does(primitive, tmp_path, monkeypatch):
    # Counting takes longer than all else.
    monkeypatch.setattr(export, "most_instructions", lambda *given: None)
    files = primitive.export_c(tmp_path, name="cut").files
    sources = [
        f.name for f in files if f.suffix == ".c" and not f.name.startswith(("test", "exam"))
    ]
    assert "grids.c" in sources and "grids.c" in (tmp_path / "CMakeLists.txt").read_text()
    built(tmp_path, [*sources, "test.c"], *STRICT, "-O0", "-otest")
    done = subprocess.run(["./test"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_what_is_too_large_for_c_is_refused():
    p = ca.SX.sym("p", 3)
    field = DistanceField(np.ones((513, 512)), 0.1)
    function = ca.Function("rows", [p], [field.expression(p)])
    said = refusal(InputError, c99.grids, function)
    assert "262,656 cells" in said and "at most 262,144" in said


def test_without_fields_there_is_no_table():
    assert c99.grids(ConstraintSystem([ns.Blade()]).function) == {}
