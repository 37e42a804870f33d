"""Parquet, Feather and TUM files, and options that no file takes."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from noslip import load_demonstrations
from noslip.errors import MissingDependencyError
from noslip.recordings import bag_topics, write_bag, write_recording

COLUMNS = ("t", "x", "y", "z", "qw", "qx", "qy", "qz")


# -------------------------------------------------------------------- tables


def columns(motion) -> dict[str, np.ndarray]:
    poses = np.column_stack([motion.times, motion.positions, motion.quaternions])
    return dict(zip(COLUMNS, poses.T.copy(), strict=True))


def write(path: Path, of: dict) -> Path:
    pa = pytest.importorskip("pyarrow", reason="needs the extra tables")
    import pyarrow.feather
    import pyarrow.parquet

    if path.suffix == ".feather":
        pyarrow.feather.write_feather(pa.table(of), path)
    else:
        pyarrow.parquet.write_table(pa.table(of), path, row_group_size=7)
    return path


@pytest.mark.parametrize("suffix", [".parquet", ".feather"])
def test_tables_name_their_columns_as_csv_does(tmp_path, motion, same, suffix) -> None:
    of = {"note": ["cut"] * len(motion), **columns(motion)}
    [found] = load_demonstrations(write(tmp_path / f"run{suffix}", dict(reversed(of.items()))))
    same(found, motion, 1e-15)
    np.testing.assert_array_equal(found.times, motion.times)


def test_tables_planar_numbered_and_by_option(tmp_path, motion, same) -> None:
    n = np.arange(20)
    [planar] = load_demonstrations(
        write(tmp_path / "p.parquet", {"i": n, "x": n * 0.1, "y": n * 0.0, "theta": n * 0.2}),
        rate=10,
    )
    np.testing.assert_allclose(planar.times, n / 10)
    np.testing.assert_allclose(planar.rotations[3].as_rotvec(), [0, 0, 0.6])
    of = {
        "time": motion.times,
        "x": np.zeros(len(motion)),
        "pose": np.column_stack([motion.positions, motion.quaternions]).tolist(),
    }
    [chosen] = load_demonstrations(write(tmp_path / "v.parquet", of), columns="pose")
    same(chosen, motion)


def test_table_refusals(tmp_path, motion, refusal) -> None:
    def refused(change: dict, **options: str) -> str:
        return refusal(write(tmp_path / "bad.parquet", columns(motion) | change), **options)

    x, n = motion.positions[:, 0], len(motion)
    assert "column x: found nan" in refused({"x": np.where(np.arange(n) == 5, np.nan, x)})
    assert "sample 5, column x" in refused({"x": [None if k == 5 else v for k, v in enumerate(x)]})
    assert "column x (string) does not hold" in refused({"x": ["a"] * n})
    ragged = {"p": [[1.0]] * 9 + [[1.0, 2.0]] * (n - 9)}
    assert "does not hold the same count" in refused(ragged, columns="p[0],y,z,qw,qx,qy,qz")
    assert "time runs backwards" in refused({"t": motion.times[::-1].copy()})
    assert "quaternion is zero" in refused({f"q{a}": np.zeros(n) for a in "wxyz"})
    assert "no column pose; found t, x, y" in refused({}, columns="pose")
    partial = {key: value for key, value in columns(motion).items() if key != "qw"}
    message = refusal(write(tmp_path / "part.parquet", partial))
    assert "column qw missing, found 't', 'x'" in message
    assert "a header and" not in message
    (tmp_path / "bad.parquet").write_bytes(b"PAR1 no")
    assert "cannot be read as a table" in refusal(tmp_path / "bad.parquet")


def test_an_empty_table(tmp_path, refusal) -> None:
    empty = {name: np.zeros(0) for name in COLUMNS}
    assert "0 distinct samples" in refusal(write(tmp_path / "empty.parquet", empty))


# -------------------------------------------------------------------- TUM


TUM = "# ground truth\n# timestamp tx ty tz qx qy qz qw\n\n"


@pytest.mark.parametrize("suffix", [".tum", ".txt"])
def test_tum(tmp_path, motion, same, suffix) -> None:
    scalar_last = motion.rotations.as_quat()
    poses = np.column_stack([motion.times, motion.positions, scalar_last])
    lines = ["  ".join(f"{number:.12f}" for number in row) for row in poses]
    lines[3] += "  # a remark"
    path = tmp_path / f"groundtruth{suffix}"
    path.write_text(TUM + "\r\n".join(lines))
    same(load_demonstrations(path)[0], motion, 1e-11)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("4.1 0 0 0 0 0 0", "line 12, column qw: the row ends after 7 of 8 cells"),
        ("4.1 0 0 0 0 0 0 1 5", "line 12, column qw: the row goes on after it"),
        ("4.1 0 a 0 0 0 0 1", "line 12, column ty: found 'a', not a number"),
        ("4.1 0 0 nan 0 0 0 1", "line 12, column tz: found nan"),
        ("4.1 0 0 0 0 0 0 0", "line 12, columns qw, qx, qy, qz: the quaternion is zero"),
        ("0.1 0 0 0 0 0 0 1", "line 12, column timestamp: time runs backwards"),
        ("3.7 0 0 0 0 0 0 1", "line 12, column timestamp: 3.7 s is also the time of line 11"),
    ],
)
def test_tum_refusals(tmp_path, refusal, line, words) -> None:
    good = [f"{3 + k / 10} {k} 0 0 0 0 0 1" for k in range(20)]
    path = tmp_path / "run.tum"
    path.write_text(TUM + "\n".join([*good[:8], line, *good[9:]]))
    assert words in refusal(path)


def test_an_empty_tum_file(tmp_path, refusal) -> None:
    (tmp_path / "run.tum").write_text(TUM)
    assert "a header and no samples" in refusal(tmp_path / "run.tum")


# -------------------------------------------------------------------- all formats


@pytest.mark.parametrize(
    ("option", "words"),
    [
        ({"topic": "/tf"}, "topic='/tf' is for a ROS bag"),
        ({"child_frame": "tool"}, "child_frame='tool' is for a ROS bag"),
        ({"episode": 3}, "episode=3 is for a LeRobot data set or an HDF5 file"),
        ({"frame": "base"}, "frame='base' is for a ROS bag"),
    ],
)
def test_an_option_that_no_file_takes(tmp_path, motion, refusal, option, words) -> None:
    assert words in refusal(motion.to_csv(tmp_path / "run.csv"), **option)


@pytest.mark.parametrize(
    ("name", "module", "extra"),
    [
        ("run.bag", "rosbags.typesys", "bags"),
        ("run.mcap", "rosbags.typesys", "bags"),
        ("run.hdf5", "h5py", "hdf5"),
        ("run.parquet", "pyarrow.parquet", "tables"),
        ("run.feather", "pyarrow.feather", "tables"),
    ],
)
def test_a_missing_extra_is_named(tmp_path, monkeypatch, name, module, extra) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    (tmp_path / name).write_bytes(b"")
    with pytest.raises(MissingDependencyError) as caught:
        load_demonstrations(tmp_path / name)
    package = module.partition(".")[0]
    assert str(caught.value) == (
        f"{tmp_path / name}: {package} is needed and cannot be imported; "
        f"pip install 'noslip[{extra}]'"
    )


def test_a_missing_extra_is_named_elsewhere_too(tmp_path, monkeypatch, motion) -> None:
    for module in ("rosbags.rosbag2", "rosbags.typesys", "pyarrow", "pyarrow.parquet"):
        monkeypatch.setitem(sys.modules, module, None)
    (tmp_path / "set" / "meta").mkdir(parents=True)
    (tmp_path / "set" / "meta" / "info.json").write_text("{}")
    with pytest.raises(MissingDependencyError, match=r"noslip\[tables\]"):
        load_demonstrations(tmp_path / "set")
    with pytest.raises(MissingDependencyError, match=r"noslip\[tables\]"):
        write_recording(motion, tmp_path / "run.parquet")
    with pytest.raises(MissingDependencyError, match=r"noslip\[bags\]"):
        write_bag(tmp_path / "bag", poses=motion)
    with pytest.raises(MissingDependencyError, match=r"noslip\[bags\]"):
        bag_topics(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["set"]
