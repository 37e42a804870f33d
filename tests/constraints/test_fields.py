"""Fields of distances, against distances found one by one."""

from __future__ import annotations

import json
import math
import pickle
from pathlib import Path

import casadi as ca
import numpy as np
import PIL.Image
import PIL.ImageFile
import pytest
from hypothesis import given, settings
from hypothesis.extra import numpy as arrays
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip.constraints import DistanceField, KeepOutCapsule, KeepOutSphere
from noslip.errors import InputError
from refusals import refusal

SMALL = arrays.array_shapes(min_dims=2, max_dims=3, min_side=3, max_side=6)
GRIDS = arrays.arrays(np.bool_, SMALL).filter(lambda grid: grid.any() and not grid.all())


def to_cells(points: Floats, cells: Floats) -> Floats:
    """Distances to the nearest of unit squares or cubes, whose first corners are given."""
    beyond = np.maximum(cells - points[:, None], points[:, None] - cells - 1)
    return np.linalg.norm(np.maximum(beyond, 0), axis=2).min(axis=1)


def random_points(shape: tuple[int, ...], count: int = 400, beyond: float = 0.0) -> Floats:
    rng = np.random.default_rng(1)
    return rng.uniform(-beyond, np.array(shape) + beyond, (count, len(shape)))


def small_field(dimensions: int = 3) -> DistanceField:
    rng = np.random.default_rng(dimensions)
    grid = rng.random((5, 6, 7)[:dimensions]) < 0.15
    return DistanceField.from_grid(grid, 0.1, (0.3, -0.2, 0.1), yaw=0.4)


# ---------------------------------------------------------------- grids


@given(GRIDS)
@settings(max_examples=60)
def test_it_says_no_more_than_the_distance_and_not_much_less(grid):
    points = random_points(grid.shape)
    true = to_cells(points, np.argwhere(grid))
    inside = to_cells(points, np.argwhere(~grid))
    found = DistanceField.from_grid(grid, 1.0).distance(points)
    assert (found <= true + 1e-6)[true > 0].all()
    assert (found >= true - 1.3)[true > 0].all()
    assert (found < 0)[inside > 0.5].all()


@given(GRIDS)
@settings(max_examples=30)
def test_beyond_the_grid_it_says_no_more_than_the_distance_to_what_is_in_it(grid):
    points = random_points(grid.shape, beyond=20.0)
    found = DistanceField.from_grid(grid, 1.0).distance(points)
    assert (found <= to_cells(points, np.argwhere(grid)) + 1e-6).all()


def test_a_wall_is_as_far_as_it_is():
    grid = np.zeros((20, 12), dtype=bool)
    grid[:4] = True
    field = DistanceField.from_grid(grid, 0.05, (1.0, 2.0))
    x = np.linspace(1.25, 1.9, 50)
    found = field.distance(np.column_stack([x, np.full(50, 2.3)]))
    # Lower by what no spline of a random map exceeds its distances by.
    assert found == pytest.approx(x - 1.2 - 0.2 * 0.05, abs=1e-7)


@pytest.mark.parametrize("dimensions", [2, 3])
def test_a_turned_grid_is_the_grid_turned(dimensions):
    grid = np.random.default_rng(0).random((5, 6, 7)[:dimensions]) < 0.2
    plain = DistanceField.from_grid(grid, 0.1)
    turned = DistanceField.from_grid(grid, 0.1, (0.3, -0.2, 0.1), yaw=0.7)
    points = np.random.default_rng(1).uniform(-0.2, 0.8, (200, 3))
    moved = Rotation.from_euler("z", 0.7).apply(points) + [0.3, -0.2, 0.1]
    assert turned.distance(moved) == pytest.approx(plain.distance(points), abs=1e-12)


def test_of_two_dimensions_height_means_nothing():
    field, points = small_field(2), np.random.default_rng(0).uniform(0, 1, (50, 3))
    assert (field.distance(points) == field.distance(points[:, :2])).all()
    assert field.distance(points[0]) == field.distance(points)[0]
    assert field.distance(np.zeros((0, 3))).shape == (0,)


def test_a_margin_is_free():
    grid = np.ones((3, 3, 3), dtype=bool)
    field = DistanceField.from_grid(grid, 0.1, (1, 2, 3), yaw=0.5, margin=0.35)
    assert field.rim >= 0.35
    middle = [1, 2, 3] + Rotation.from_euler("z", 0.5).apply([0.15, 0.15, 0.15])
    assert field.distance(middle) < -0.1
    assert field.distance(middle + [0, 0, 0.45]) == pytest.approx(0.3 - 0.035, abs=1e-3)


def test_more_points_than_are_taken_at_once():
    field = small_field(2)
    points = np.random.default_rng(0).uniform(0, 1, (70_000, 2))
    assert field.distance(points)[-3:] == pytest.approx(field.distance(points[-3:]), abs=0)


# ---------------------------------------------------------------- shapes and points


def test_a_union_is_as_far_as_its_nearest_shape():
    sphere, capsule = (
        KeepOutSphere((0.1, 0.2, 0.3), 0.1),
        KeepOutCapsule((0.5, 0, 0), (0.8, 0.3, 0.1), 0.08),
    )
    low, high = np.array([-0.5, -0.5, -0.2]), np.array([-0.2, -0.3, 0.3])
    cell = 0.03
    field = DistanceField.union(sphere, capsule, (low, high), cell=cell)
    points = np.random.default_rng(0).uniform([-0.7, -0.7, -0.4], [1.0, 0.5, 0.6], (3000, 3))
    start, axis = np.array([0.5, 0, 0]), np.array([0.3, 0.3, 0.1])
    along = np.clip((points - start) @ axis / (axis @ axis), 0, 1)[:, None]
    true = np.min(
        [
            np.linalg.norm(points - [0.1, 0.2, 0.3], axis=1) - 0.1,
            np.linalg.norm(points - start - along * axis, axis=1) - 0.08,
            np.linalg.norm(points - np.clip(points, low, high), axis=1),
        ],
        axis=0,
    )
    found = field.distance(points)
    assert (found <= true)[true > 0].all()
    assert (found >= true - 1.3 * cell)[true > 0].all()
    assert field.rim >= 10 * cell
    both = DistanceField.union(field, sphere, cell=cell).distance(points)
    assert (both <= true)[true > 0].all()
    assert (both >= true - 2.6 * cell)[true > 0].all()


@pytest.mark.parametrize("dimensions", [2, 3])
def test_points_are_balls(dimensions):
    rng = np.random.default_rng(0)
    centers, points = rng.uniform(0, 1, (30, dimensions)), rng.uniform(0, 1, (2000, dimensions))
    field = DistanceField.from_points(centers, 0.06, 0.04)
    true = np.linalg.norm(points[:, None] - centers, axis=2).min(axis=1) - 0.06
    found = field.distance(points)
    assert (found <= true)[true > 0].all()
    assert (found >= true - 1.3 * 0.04)[true > 0].all()


# ---------------------------------------------------------------- expressions


@pytest.mark.parametrize("dimensions", [2, 3])
def test_the_expression_is_the_distance_with_its_first_and_second_derivatives(dimensions):
    field, p = small_field(dimensions), ca.SX.sym("p", 3)
    d = field.expression(p)
    function = ca.Function("d", [p], [d, ca.gradient(d, p), ca.vec(ca.hessian(d, p)[0])])
    points = np.random.default_rng(0).uniform(-0.3, 1.2, (300, 3))

    def of(at: Floats) -> list[Floats]:
        return [np.array(found).T for found in function.map(len(at))(at.T)]

    value, gradient, curvature = of(points)
    assert value.ravel() == pytest.approx(field.distance(points), abs=1e-13)
    for axis, step in enumerate(1e-6 * np.eye(3)):
        slope = (field.distance(points + step) - field.distance(points - step)) / 2e-6
        assert gradient[:, axis] == pytest.approx(slope, abs=1e-7)
        bend = (of(points + step)[1] - of(points - step)[1]) / 2e-6
        assert curvature.reshape(-1, 3, 3)[:, axis] == pytest.approx(bend, abs=1e-5)


def test_what_is_no_number_stays_none():
    p = ca.SX.sym("p", 3)
    function = ca.Function("d", [p], [small_field().expression(p)])
    assert math.isnan(float(function([math.nan, 0, 0])))
    assert math.isfinite(float(function([1e12, -1e12, 0])))


# ---------------------------------------------------------------- kept and sent


def test_it_is_what_it_holds():
    one, same, other = small_field(), small_field(), small_field(2)
    assert one == same and hash(one) == hash(same) and one != other and one != "field"
    moved = DistanceField(one.coefficients, one.cell, (0, 0, 0), one.yaw)
    assert moved != one
    assert pickle.loads(pickle.dumps(one)) == one
    assert DistanceField.from_data(json.loads(json.dumps(one.to_data()))) == one
    assert len(json.dumps(DistanceField.example().to_data())) < 4 * one.example().coefficients.size
    with pytest.raises(ValueError):
        one.coefficients[0, 0, 0] = 1.0


@pytest.mark.parametrize(
    "change",
    [
        {"shape": [5, 6]},
        {"shape": [10**5] * 3},
        {"shape": [-5, 6, 7]},
        {"coefficients": "no base64"},
        {"coefficients": "AAAA"},
        {"cell": 0},
        {"cell": math.nan},
        {"origin": 3},
        {"yaw": None},
        {"origin": [1, 2]},
        {"shape": None},
    ],
    ids=str,
)
def test_data_that_are_none_are_refused(change):
    data = small_field().to_data() | change
    if change == {"origin": [1, 2]}:
        # In the plane: with no height.
        assert DistanceField.from_data(data).origin == (1, 2, 0)
        return
    refusal(InputError, DistanceField.from_data, data)


# ---------------------------------------------------------------- maps


def write_map(folder: Path, pixels: Floats, **told: object) -> Path:
    image = pytest.importorskip("PIL.Image")
    image.fromarray(pixels.astype(np.uint8)).save(folder / "room.pgm")
    values = {
        "image": "room.pgm",
        "resolution": 0.05,
        "origin": [-1.0, 2.0, 0.0],
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.196,
    } | told
    path = folder / "room.yaml"
    path.write_text("".join(f"{key}: {value}\n" for key, value in values.items() if value != ""))
    return path


def test_a_map_lies_as_its_image_does(tmp_path):
    pixels = np.full((20, 30), 254)
    # Three from the top, the fifth column.
    pixels[3, 5] = 0
    for yaw in (0.0, 0.6):
        field = DistanceField.from_map(write_map(tmp_path, pixels, origin=[-1, 2, yaw]))
        turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        middle = [-1, 2] + turn @ (0.05 * np.array([5.5, 16.5]))
        assert field.distance(middle) < 0
        around = middle + 0.2 * np.stack([np.cos(np.arange(8)), np.sin(np.arange(8))], axis=1)
        assert field.distance(around) == pytest.approx(0.15, abs=0.04)


def test_what_a_map_does_not_know_is_as_it_is_told(tmp_path):
    pixels = np.full((20, 30), 254)
    pixels[:, 20:], pixels[10, 2] = 205, 0
    path, there = write_map(tmp_path, pixels), [-1 + 0.05 * 25, 2.5]
    assert DistanceField.from_map(path).distance(there) < 0
    assert DistanceField.from_map(path, unknown="free").distance(there) > 0.5
    negated = write_map(tmp_path, 255 - pixels, negate=1)
    assert DistanceField.from_map(negated) == DistanceField.from_map(write_map(tmp_path, pixels))


@pytest.mark.parametrize(
    ("told", "said"),
    [
        ({"image": "other.pgm"}, "no such image"),
        ({"resolution": ""}, "names no resolution"),
        ({"resolution": -1}, "resolution must be"),
        ({"origin": "[1, .nan, 0]"}, "origin must be"),
        ({"origin": "[1, 2"}, "is no YAML"),
        ({"mode": "raw"}, "mode is 'raw'"),
        ({"free_thresh": "none"}, "free_thresh must be"),
    ],
    ids=str,
)
def test_a_map_that_is_none_is_refused(tmp_path, told, said):
    assert said in refusal(
        InputError, DistanceField.from_map, write_map(tmp_path, np.eye(4), **told)
    )


def test_damaged_empty_and_large_images_are_refused(tmp_path):
    path = write_map(tmp_path, np.full((4, 4), 254))
    assert "no occupied cell" in refusal(InputError, DistanceField.from_map, path)
    assert "unknown must be" in refusal(InputError, DistanceField.from_map, path, unknown="x")
    (tmp_path / "room.pgm").write_bytes(b"P5 5000 5000 255\n")
    assert "pixels, at most" in refusal(InputError, DistanceField.from_map, path)
    refusal(InputError, DistanceField.from_map, tmp_path / "none.yaml")


@pytest.mark.parametrize("filled", [False, True])
def test_images_that_end_early_are_refused_whatever_pillow_was_told(tmp_path, monkeypatch, filled):
    # WeasyPrint tells it, when it is imported, to fill what is missing.
    monkeypatch.setattr(PIL.ImageFile, "LOAD_TRUNCATED_IMAGES", filled)
    path, image = write_map(tmp_path, np.eye(6), image="room.png"), tmp_path / "room.png"
    PIL.Image.fromarray(254 * np.eye(6, dtype=np.uint8)).save(image)
    DistanceField.from_map(path)
    for early in (b"P5 6 6 255\n12", image.read_bytes()[:-30]):
        image.write_bytes(early)
        assert "cannot be read" in refusal(InputError, DistanceField.from_map, path)
    assert PIL.ImageFile.LOAD_TRUNCATED_IMAGES is filled


# ---------------------------------------------------------------- meshes


def test_a_mesh_is_as_far_as_its_triangles(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    cell, box = 0.02, trimesh.creation.box((0.2, 0.1, 0.06))
    box.apply_translation((0.5, 0, 0))
    points = np.random.default_rng(0).uniform([0.3, -0.2, -0.2], [0.7, 0.2, 0.2], (2000, 3))
    nearest = np.clip(points, [0.4, -0.05, -0.03], [0.6, 0.05, 0.03])
    true = np.linalg.norm(points - nearest, axis=1)
    found = DistanceField.from_mesh(box, cell).distance(points)
    assert (found <= true)[true > 0].all()
    assert (found >= true - 3.2 * cell).all()
    box.apply_scale(1000)
    for name in ("box.stl", "box.obj"):
        box.export(tmp_path / name)
        same = DistanceField.from_mesh(tmp_path / name, cell, scale=0.001).distance(points)
        assert same == pytest.approx(found, abs=2 * cell)


def test_meshes_that_are_none_are_refused(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    ball = trimesh.creation.icosphere(subdivisions=1)
    half = trimesh.Trimesh(ball.vertices, ball.faces[:-1])
    assert "not closed" in refusal(InputError, DistanceField.from_mesh, half, 0.1)
    assert "cells of 1e-05 m" in refusal(InputError, DistanceField.from_mesh, ball, 1e-5)
    assert "no such file" in refusal(InputError, DistanceField.from_mesh, tmp_path / "x.stl")
    (tmp_path / "x.stl").write_bytes(b"solid nothing")
    refusal(InputError, DistanceField.from_mesh, tmp_path / "x.stl")
    refusal(InputError, DistanceField.from_mesh, 3)
    refusal(InputError, DistanceField.from_mesh, ball, -1)


# ---------------------------------------------------------------- what is none


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: DistanceField.from_grid(np.zeros((4, 4)), 0.1), "no occupied cell"),
        (lambda: DistanceField.from_grid(np.ones((4, 4)), 0.1), "all cells"),
        (lambda: DistanceField.from_grid(np.full((4, 4), math.nan), 0.1), "True or False"),
        (lambda: DistanceField.from_grid(np.full((4, 4), 0.7), 0.1), "grid > 0.5"),
        (lambda: DistanceField.from_grid([[1], [1, 0]], 0.1), "2 or 3 dimensions"),
        (lambda: DistanceField.from_grid(np.eye(4), math.nan), "cell must be"),
        (lambda: DistanceField.from_grid(np.eye(4), 0.1, (0, math.inf)), "origin must be"),
        (lambda: DistanceField.from_grid(np.eye(4), 0.1, yaw=math.nan), "yaw must be"),
        (lambda: DistanceField.from_grid(np.eye(4), 0.1, margin=1e9), "cells"),
        (lambda: DistanceField.from_grid(np.broadcast_to(True, (1000,) * 3), 1), "1e+09 cells"),
        (lambda: DistanceField.from_points(np.zeros((1, 3)), 0.1, 1e-5), "cells"),
        (lambda: DistanceField.from_points(np.zeros((1, 3)), 0.01, 0.1), "radius must be a cell"),
        (lambda: DistanceField.from_points(np.zeros((0, 3)), 0.1, 0.1), "points must have shape"),
        (lambda: DistanceField.from_points([[0, 0, math.nan]], 0.1, 0.1), "points must be finite"),
        (lambda: DistanceField.union(cell=0.1), "at least one"),
        (lambda: DistanceField.union("ball", cell=0.1), "a union is of"),
        (lambda: DistanceField.union(((0, 0, 0), (1, 1, 0.1)), cell=0.1), "two cells"),
        (lambda: DistanceField.union(KeepOutSphere(radius=0.01), cell=0.1), "take smaller cells"),
        (lambda: small_field().distance([[0, math.nan, 0]]), "finite"),
        (lambda: small_field().distance([[0, 0]]), "shape (N, 3)"),
        (lambda: DistanceField(np.full((3, 3), np.inf), 0.1), "finite numbers"),
    ],
    ids=range(21),
)
def test_what_is_no_field_is_refused(call, said):
    assert said in refusal(InputError, call)
