"""Files that people brought, each with the value or the refusal that is right."""

from __future__ import annotations

import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.errors import RecordingError, RecordingWarning

pytestmark = pytest.mark.recordings

RIGHT = (
    "comment_header.csv",
    "euroc.csv",
    "franka.csv",
    "names_ros_flat.csv",
    "names_timestamp.csv",
    "plotjuggler_pose.csv",
    "rostopic_echo_p.csv",
    "timedelta.parquet",
    "ts.parquet",
    "tum_csv_header.tum",
    "unit_row.csv",
    "ur_rtde.csv",
)
"""Read without a word."""
ASKED: dict[str, tuple[str, dict[str, Any]]] = {
    "epoch_ms.csv": ("--time-unit ms", {"units": "ms"}),
    "tum_ns.tum": ("--time-unit ns", {"units": "ns"}),
    "kitti.txt": ("--sample-rate", {"rate": 100}),
    "ndi.csv": ("--sample-rate", {"rate": 100}),
    "motive_quat.csv": ("--lost drop", {"lost": "drop"}),
    "one_gap.tum": ("--gaps", {"gaps": "interpolate"}),
    "duplicate_stamp.tum": ("--duplicates", {"duplicates": "first"}),
}
"""Refused with an option, which then makes them right."""
SLIPPING = ("csv_same_in_seconds.csv", "csv_ms_false_pass.csv")
BAGS = (".bag", ".mcap", ".db3")


@pytest.fixture(scope="module")
def cases(recordings: Path) -> Path:
    folder = recordings.parent / "cases"
    if not folder.is_dir():
        pytest.skip("the cases (../shared/cases, seen from the repository) are absent")
    return folder


def assert_right(found: list[ns.PoseTrajectory]) -> None:
    """Sample k at 0.01 k s, (0.3 + 0.001 k, 0.1, 0.2) m, turned about z by 0.01 k rad."""
    (one,) = found
    k = np.round((one.times - one.times[0]) / 0.01)
    # Stamps since 1970 are rounded by up to 0.24 us, quaternions in the files to six digits.
    np.testing.assert_allclose(one.times - one.times[0], 0.01 * k, atol=5e-7)
    right = np.column_stack([0.3 + 0.001 * k, 0.1 + 0 * k, 0.2 + 0 * k])
    np.testing.assert_allclose(one.positions, right, atol=1e-9)
    turned = one.rotations * Rotation.from_euler("z", 0.01 * k).inv()
    np.testing.assert_allclose(turned.magnitude(), 0, atol=3e-6)
    assert k[-1] == 59
    assert len(one) >= 55


def test_every_case_is_looked_at(cases: Path) -> None:
    table = (cases / "README.md").read_text()
    named = {name for name in re.findall(r"`([\w.]+)`", table) if (cases / name).is_file()}
    tables = {name for name in named if not name.endswith(BAGS)}
    assert tables <= {*RIGHT, *ASKED, *SLIPPING} | {"README.md"}
    assert tables


@pytest.mark.parametrize("name", RIGHT)
def test_read_right(cases: Path, name: str) -> None:
    assert_right(ns.load_demonstrations(cases / name))


@pytest.mark.parametrize("name", ASKED)
def test_refused_with_the_option_that_makes_it_right(cases: Path, name: str) -> None:
    option, asked = ASKED[name]
    with pytest.raises(RecordingError) as caught:
        ns.load_demonstrations(cases / name)
    assert option in str(caught.value)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RecordingWarning)
        assert_right(ns.load_demonstrations(cases / name, **asked))


def test_a_motion_in_milliseconds_is_no_silent_pass(cases: Path, noslip) -> None:
    seconds, milliseconds = (str(cases / name) for name in SLIPPING)
    told = noslip("check", seconds, "--constraint", "blade")
    assert told.code == 1 and "VIOLATED" in told.out and "0.05 m/s" in told.out
    assert noslip("check", milliseconds, "--constraint", "blade").code == 2
    told = noslip("check", milliseconds, "--constraint", "blade", "--time-unit", "ms")
    assert told.code == 1 and "VIOLATED" in told.out and "0.05 m/s" in told.out


# -------------------------------------------------------------------- real recordings


@pytest.fixture(scope="module")
def real(recordings: Path) -> Path:
    folder = recordings / "real"
    if not folder.is_dir():
        pytest.skip("the real recordings (../shared/data/real) are absent")
    return folder


def test_motives_export_of_a_robot_on_the_floor(real: Path) -> None:
    file = real / "optiodom_motive" / "run-01_opti_excerpt.csv"
    with pytest.raises(RecordingError, match="--lost drop"):
        ns.load_demonstrations(file)
    with pytest.warns(RecordingWarning, match="12 of 500 samples left out"):
        (robot,) = ns.load_demonstrations(file, lost="drop")
    assert robot.period == pytest.approx(0.01)
    np.testing.assert_allclose(robot.positions[0], [0.356745, 0.079279, 0.628898])
    # On the floor, Y up, and heading as the file's first angle says.
    up = robot.rotations.apply([0, 1, 0])
    assert up[:, 1].min() > 0.995
    heading = robot.rotations[0].apply([0, 0, 1])
    assert np.degrees(np.arctan2(heading[0], heading[2])) == pytest.approx(112.26, abs=1.5)


def test_a_table_without_a_header_is_read_by_numbers(real: Path) -> None:
    folder = real / "gsutanto_dmp"
    file = folder / "sample_quat_traj_recorded_demo_wiggling.txt"
    with pytest.raises(RecordingError, match=r"found '0', '1'.*--columns"):
        ns.load_demonstrations(file)
    # Rotations alone: where the tool is does not matter here.
    table = np.loadtxt(file)
    asked = {"columns": "5,6,7,1,2,3,4", "time": "0"}
    with pytest.warns(RecordingWarning, match="are its positions in other units"):
        (found,) = ns.load_demonstrations(file, **asked)
    np.testing.assert_array_equal(found.times, table[:, 0])
    turned = found.rotations * Rotation.from_quat(table[:, 1:5], scalar_first=True).inv()
    assert turned.magnitude().max() < 1e-7
    (tool,) = ns.load_demonstrations(folder / "unscrewing_prim02_05_100Hz.csv")
    assert len(tool) == 534
