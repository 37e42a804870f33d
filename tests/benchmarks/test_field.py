"""The field's data sets, in small: what is compared, and what a perfect and a lazy method score."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from benchmarks import field, peers
from benchmarks.likeness import frechet, swept_area, warping

COUNT = 150
COORDINATES = st.floats(-10, 10, width=32)


def paths(least: int = 1) -> st.SearchStrategy[np.ndarray]:
    return st.integers(least, 12).flatmap(
        lambda rows: arrays(float, (rows, 2), elements=COORDINATES)
    )


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A shape in the layout of LASA: two arcs, 50 wide."""
    (tmp_path / "LASA" / "DataSet").mkdir(parents=True)
    u = np.linspace(0, 1, COUNT)
    eased = u**3 * (10 - 15 * u + 6 * u**2)
    demos = [
        {"pos": np.stack([50 * eased - 50, (height * eased * (1 - eased))]), "t": 3 * u}
        for height in (20.0, 24.0)
    ]
    scipy.io.savemat(tmp_path / "LASA" / "DataSet" / "Arc.mat", {"demos": demos})
    return tmp_path


@settings(max_examples=40)
@given(there=paths(), here=paths())
def test_warping_and_frechet_are_those_of_another_library(there, here):
    measures = pytest.importorskip("similaritymeasures", reason="needs the extra dev")
    assert warping(there, here) == pytest.approx(measures.dtw(there, here)[0], abs=1e-9)
    assert frechet(there, here) == pytest.approx(measures.frechet_dist(there, here), abs=1e-9)


@settings(max_examples=40)
@given(path=paths(2), shift=COORDINATES, turn=st.floats(0, 6))
def test_a_shifted_path_sweeps_its_length_times_the_shift_across_it(path, shift, turn):
    aside = shift * np.array([np.cos(turn), np.sin(turn)])
    # Parallelograms: a step along the path and the shift are their sides.
    sides = [np.array([step, aside]) for step in np.diff(path, axis=0)]
    expected = np.abs(np.linalg.det(sides)).sum()
    assert swept_area(path, path + aside) == pytest.approx(expected, rel=1e-9, abs=1e-9)
    assert swept_area(path, path) == 0


def test_metrics_are_none_for_the_same_and_of_the_data_s_units_for_another(folder: Path) -> None:
    [shape] = field.lasa(folder)
    assert (shape.name, len(shape.demos)) == ("Arc", 2)
    same = field.compare(shape, "itself", list)
    assert same.dtw == same.frechet == same.area == same.end == same.refused == 0
    swapped = field.compare(shape, "the other", lambda both: list(both)[::-1])
    # The arcs are 1 unit apart at most, in the middle, and 2/3 in the mean of 50.
    assert 0.8 <= swapped.frechet <= 1.01
    assert swapped.frechet < swapped.dtw <= field.SAMPLES
    assert swapped.area == pytest.approx(50 * 2 / 3, rel=0.01)


def test_a_wheel_points_along_its_way(folder: Path) -> None:
    [shape] = field.lasa(folder)
    wheeled = field.driven(shape.demos[0])
    step = np.diff(wheeled.positions[40:110, :2], axis=0)
    along = wheeled.rotations[40:109].as_matrix()[:, :2, 0]
    cosines = np.sum(step * along, axis=1) / np.linalg.norm(step, axis=1)
    assert cosines.min() > 0.999


def test_the_command_tells_every_method_and_what_it_skips(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if peers.MISSING:
        pytest.skip(peers.MISSING)
    written = folder / "found.json"
    asked = ["--data", str(folder), "--recordings", str(folder), "--json", str(written)]
    assert field.main(asked) == 0
    found = {each["method"]: each for each in json.loads(written.read_text())["shapes"]}
    assert set(found) == {
        "noslip",
        "movement-primitives",
        "noslip, Wheel",
        "noslip, of all",
        "noslip, of all, Wheel",
    }
    assert max(each["slip"] for name, each in found.items() if "Wheel" in name) <= 1e-10
    assert found["noslip, Wheel"]["frechet"] < 0.05
    assert found["noslip, of all, Wheel"]["frechet"] < 1.01
    told = capsys.readouterr()
    assert "LASA, noslip, Wheel" in told.out
    for absent in ("HelloWorld", "RoboTasks", "contour"):
        assert f"{absent} is skipped" in told.err


def test_what_is_refused_is_told_by_name(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    [shape] = field.lasa(folder)
    still = [demo.with_points(0 * demo.values) for demo in shape.demos[:1]]
    found = field.compare(shape, "noslip", field.ours(), [*still, shape.demos[1]])
    assert found.refused == 1
    assert found.frechet < 0.1
    field.show([found])
    assert "LASA Arc, noslip: refused: Arc 1: " in capsys.readouterr().out
    none = field.compare(shape, "noslip", field.ours(), still)
    assert none.refused == 1
    assert none.dtw is None


def test_a_folder_without_data_is_said_to_have_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert field.main(["--data", str(tmp_path), "--recordings", str(tmp_path)]) == 2
    assert "LASA is skipped" in capsys.readouterr().err
