"""The field's data sets, in small: what is compared, and what a perfect and a lazy method score."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from benchmarks import field

pytest.importorskip("dtaidistance", reason="needs the extra align")
pytest.importorskip("similaritymeasures", reason="needs similaritymeasures (extra bench)")

COUNT = 150


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


def test_metrics_are_none_for_the_same_and_of_the_data_s_units_for_another(folder: Path) -> None:
    [(shape, demos)] = field.lasa(folder)
    assert shape == "Arc" and len(demos) == 2
    same = field.compare("LASA", shape, "itself", demos, list)
    assert same.dtw == same.frechet == same.end == same.failed == 0
    swapped = field.compare("LASA", shape, "the other", demos, lambda both: list(both)[::-1])
    # The arcs are 1 unit apart at most, in the middle.
    assert 0.8 <= swapped.frechet <= 1.01
    assert swapped.frechet < swapped.dtw <= field.SAMPLES


def test_a_wheel_points_along_its_way(folder: Path) -> None:
    [(_, demos)] = field.lasa(folder)
    wheeled = field.driven(demos[0])
    step = np.diff(wheeled.positions[40:110, :2], axis=0)
    along = wheeled.rotations[40:109].as_matrix()[:, :2, 0]
    cosines = np.sum(step * along, axis=1) / np.linalg.norm(step, axis=1)
    assert cosines.min() > 0.999


def test_the_command_tells_every_method(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("movement_primitives", reason="needs the extra interop")
    written = folder / "found.json"
    assert field.main(["--data", str(folder), "--json", str(written)]) == 0
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
    assert "LASA" in capsys.readouterr().out


def test_a_folder_without_data_is_said_to_have_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert field.main(["--data", str(tmp_path)]) == 2
    assert "none of the data sets" in capsys.readouterr().err
