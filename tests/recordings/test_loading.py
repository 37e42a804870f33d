"""Recordings in files: what is understood, and what each refusal says."""

from __future__ import annotations

import time
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import refusals
from noslip import PoseTrajectory
from noslip.errors import InputError, RecordingWarning
from noslip.recordings import load_demonstrations

HEADER = "t,x,y,z,qw,qx,qy,qz"
Write = Callable[..., Path]


def rows(count: int = 20) -> list[str]:
    """Return a recording of 20 samples at 10 Hz; sample k is in line k + 2 of the file."""
    return [f"{k / 10},{k / 100},{-k / 50},0.5,0.8,0,0,0.6" for k in range(count)]


def changed(line: int, column: str, cell: str, header: str = HEADER) -> list[str]:
    """Return the recording with one cell changed."""
    body = rows()
    cells = body[line - 2].split(",")
    cells[header.split(",").index(column)] = cell
    body[line - 2] = ",".join(cells)
    return body


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def write(body: list[str], header: str = HEADER, ending: str = "\n") -> Path:
        path = tmp_path / "run.csv"
        path.write_bytes((ending.join([header, *body]) + ending).encode())
        return path

    return write


def refusal(path: str | Path | list[str], **arguments: float) -> str:
    """Return the message of the refusal: one line that starts with the file."""
    message = refusals.refusal(InputError, load_demonstrations, path, **arguments)
    if isinstance(path, (str, Path)):
        assert message.startswith(f"{path}: ")
    return message


def load(path: Path, **arguments: float) -> PoseTrajectory:
    (trajectory,) = load_demonstrations(path, **arguments)
    return trajectory


def same(one: PoseTrajectory, other: PoseTrajectory) -> None:
    np.testing.assert_array_equal(one.times, other.times)
    np.testing.assert_array_equal(one.positions, other.positions)
    np.testing.assert_allclose(one.quaternions, other.quaternions, atol=1e-15)


# -------------------------------------------------------------------- CSV: what is understood


def test_the_columns_are_what_they_are_called(write: Write) -> None:
    trajectory = load(write(rows()))
    k = np.arange(20)
    np.testing.assert_array_equal(trajectory.times, k / 10)
    np.testing.assert_array_equal(
        trajectory.positions, np.stack([k / 100, -k / 50, np.full(20, 0.5)], axis=1)
    )
    np.testing.assert_allclose(trajectory.quaternions, np.tile([0.8, 0, 0, 0.6], (20, 1)))


def test_columns_come_in_any_order_among_others_that_hold_anything(write: Write) -> None:
    plain = load(write(rows()))
    body = []
    for row in rows():
        t, x, y, z, qw, qx, qy, qz = row.split(",")
        body.append(f'"a, ""note""",{qz},{z},nan,{y},{x},{qw},,{qx},{qy},{t}')
    mixed = load(write(body, "note,qz,z,force,y,x,qw,empty,qx,qy,t"))
    same(mixed, plain)


@pytest.mark.parametrize(
    "header",
    [
        " T , X,Y ,z,QW,qx,Qy,qz",
        "Time,x,y,z,qw,qx,qy,qz",
        "\ufefft,x,y,z,qw,qx,qy,qz",
        '"t","x","y","z","qw","qx","qy","qz"',
        "\n\n" + HEADER,
        HEADER + ",",
    ],
)
def test_headers_as_programs_write_them(write: Write, header: str) -> None:
    plain = load(write(rows()))
    same(load(write(rows(), header)), plain)


@pytest.mark.parametrize("ending", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("delimiter", [",", ";", "\t", ", "])
def test_line_ends_and_delimiters(write: Write, ending: str, delimiter: str) -> None:
    plain = load(write(rows()))
    body = [row.replace(",", delimiter) for row in rows()]
    same(load(write(body, HEADER.replace(",", delimiter), ending)), plain)


def test_blank_lines_and_trailing_delimiters_hold_nothing(write: Write) -> None:
    plain = load(write(rows()))
    same(load(write([*(row + ",," for row in rows()), "", "   ", ""])), plain)
    path = write(rows())
    path.write_text(path.read_text().rstrip("\n"))
    same(load(path), plain)


def test_blank_lines_count_as_lines(write: Write) -> None:
    body = rows()
    body[10] = "1.0,x,0,0,1,0,0,0"
    assert "line 14, column x" in refusal(write(["", "", *body]))


def test_planar_poses_turn_about_z_without_bound(write: Write) -> None:
    k = np.arange(100)
    body = [f"{t},{t},{-t},{theta}" for t, theta in zip(k / 20, 0.3 * k - 2, strict=True)]
    trajectory = load(write(body, "t,x,y,theta"))
    np.testing.assert_array_equal(trajectory.positions[:, 2], 0)
    turned = Rotation.from_rotvec((0.3 * k - 2)[:, None] * [0, 0, 1])
    apart = (trajectory.rotations * turned.inv()).magnitude()
    np.testing.assert_allclose(apart, 0, atol=1e-14)
    np.testing.assert_allclose(trajectory.angular_velocities, np.tile([0, 0, 6], (100, 1)))
    assert np.all(trajectory.quaternions[:, 1:3] == 0)


def test_planar_headings_may_be_in_degrees(write: Write) -> None:
    k = np.arange(50)
    body = [f"{t},{t},{-t},{angle}" for t, angle in zip(k / 20, 4.0 * k - 30, strict=True)]
    trajectory = load(write(body, "t,x,y,theta_deg"))
    turned = Rotation.from_euler("z", 4.0 * k - 30, degrees=True)
    np.testing.assert_allclose((trajectory.rotations * turned.inv()).magnitude(), 0, atol=1e-14)


def test_a_table_of_the_plane_misses_its_heading_not_a_quaternion(write: Write) -> None:
    assert "yaw does not say its unit" in refusal(write(["0,1,2,3"] * 9, "t,X,Y,yaw"))
    message = refusal(write(["0,1,2,3"] * 9, "t,X,Y,heading"))
    assert "column theta missing" in message
    assert "x,y,theta_deg" in message and "planar:rad of x, y and yaw" in message


@pytest.mark.parametrize(
    ("header", "degrees", "rotation"),
    [
        ("t,x,y,yaw_deg", True, None),
        ("t,x,y,yaw [rad]", False, None),
        ("t,x,y,yaw", True, "planar:deg"),
        ("t,x,y,yaw", False, "planar:rad"),
        ("t,x,y,theta", True, "planar:deg"),
    ],
)
def test_a_yaw_in_the_plane_is_read_where_its_unit_is_said(
    write: Write, header: str, degrees: bool, rotation: str | None
) -> None:
    k = np.arange(50)
    angles = np.radians(4.0 * k - 30)
    written = np.degrees(angles) if degrees else angles
    body = [f"{t},{t},{-t},{angle}" for t, angle in zip(k / 20, written, strict=True)]
    trajectory = load(write(body, header), rotation=rotation)
    turned = Rotation.from_rotvec(angles[:, None] * [0, 0, 1])
    np.testing.assert_allclose((trajectory.rotations * turned.inv()).magnitude(), 0, atol=1e-12)


def test_numbered_samples_take_their_time_from_the_rate(write: Write) -> None:
    header = HEADER.replace("t", "i")
    body = [f"{k}," + row.split(",", 1)[1] for k, row in enumerate(rows(), start=5)]
    trajectory = load(write(body, header), rate=14.5)
    np.testing.assert_array_equal(trajectory.times, np.arange(5, 25) / 14.5)


def test_stamps_are_preferred_to_numbers_and_to_the_rate(write: Write) -> None:
    body = [f"{k},{row}" for k, row in enumerate(rows())]
    plain = load(write(rows()))
    for path in (write(body, "i," + HEADER), write(rows())):
        with pytest.warns(RecordingWarning, match=r"t stamps .* rate=1000 .* not used; ns.prepare"):
            same(load(path, rate=1000.0), plain)


@given(start=st.floats(-1e9, 2e9), seed=st.integers(0, 2**32 - 1))
def test_time_starts_anywhere_and_runs_at_any_rate(
    tmp_path_factory: pytest.TempPathFactory, start: float, seed: int
) -> None:
    periods = np.random.default_rng(seed).uniform(0.01, 0.09, 20)
    times = start + np.cumsum(periods)
    path = tmp_path_factory.getbasetemp() / "anywhere.csv"
    body = [f"{t!r}," + row.split(",", 1)[1] for t, row in zip(times.tolist(), rows(), strict=True)]
    path.write_text("\n".join([HEADER, *body]))
    np.testing.assert_array_equal(load(path).times, times)


def test_a_quaternion_that_flips_sign_is_no_jump(write: Write) -> None:
    body = rows()
    for k in (3, 4, 11):
        body[k] = body[k].replace("0.8,0,0,0.6", "-0.8,-0,-0,-0.6")
    trajectory = load(write(body))
    np.testing.assert_allclose(trajectory.quaternions, np.tile([0.8, 0, 0, 0.6], (20, 1)))
    np.testing.assert_allclose(trajectory.angular_velocities, 0, atol=1e-12)


@pytest.mark.parametrize("norm", [0.9991, 1.0009])
def test_quaternions_a_little_off_are_normalized(write: Write, norm: float) -> None:
    body = rows()
    body[7] = body[7].replace("0.8,0,0,0.6", f"{0.8 * norm},0,0,{0.6 * norm}")
    trajectory = load(write(body))
    np.testing.assert_allclose(np.linalg.norm(trajectory.quaternions, axis=1), 1, atol=1e-15)
    np.testing.assert_allclose(trajectory.quaternions[7], [0.8, 0, 0, 0.6], atol=1e-15)


def test_quaternions_are_normalized_as_scipy_does_to_the_bit(write: Write) -> None:
    random = np.random.default_rng(0)
    off = Rotation.random(200, random).as_quat(scalar_first=True)
    off *= random.uniform(0.9991, 1.0009, (200, 1))
    file = write([f"{k},{k},0,0,{','.join(map(repr, q))}" for k, q in enumerate(off.tolist())])
    expected = Rotation.from_quat(off, scalar_first=True)
    np.testing.assert_array_equal(load(file).rotations.as_quat(), expected.as_quat())


def test_repeated_samples_are_dropped(write: Write) -> None:
    body = rows()
    repeat = body[4].replace("0.8,0,0,0.6", "-0.8,0,0,-0.6").replace("0.04", "0.0400000001")
    plain = load(write(body))
    same(load(write([*body[:5], repeat, body[4], *body[5:], body[-1]])), plain)


def test_a_gap_of_ten_periods_is_allowed(write: Write) -> None:
    body = rows(40)
    assert len(load(write(body[:20] + body[29:]))) == 31
    assert "line 22, column t: no sample from 1.9 s" in refusal(write(body[:20] + body[30:]))


def test_100_000_rows_are_read_quickly(tmp_path: Path) -> None:
    count = 100_000
    times = np.arange(count) / 500
    path = PoseTrajectory(
        times=times,
        positions=np.stack([np.sin(times), np.cos(times), times], axis=1),
        rotations=Rotation.from_rotvec(times[:, None] * [0.1, 0.2, 0.3]),
    ).to_csv(tmp_path / "long.csv")
    start = time.process_time()
    assert len(load(path)) == count
    assert time.process_time() - start < 4  # about 1 s; a slow machine must not fail


# -------------------------------------------------------------------- CSV: what is refused


@pytest.mark.parametrize("content", [b"", b"\n\r\n  \n", b"\xef\xbb\xbf", b'""\n'])
def test_an_empty_file(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "run.csv"
    path.write_bytes(content)
    assert refusal(path) == f"{path}: the file is empty"


def test_a_header_only(write: Write) -> None:
    assert "line 1: a header and no samples" in refusal(write([]))


def test_no_header(write: Write) -> None:
    path = write(rows()[1:], rows()[0])
    message = refusal(path)
    assert "line 1: columns t, x, y, z, qw, qx, qy, qz missing, found '0', '1', '2'" in message
    same(load(path, columns="1,2,3,4,5,6,7", time="0"), load(write(rows())))


def test_missing_columns_are_named_with_those_found(write: Write) -> None:
    message = refusal(write(rows(), "s,x,y,z,qw,qx,qy,w"))
    assert "line 1: columns t, qz missing" in message
    assert "found 's', 'x', 'y', 'z', 'qw', 'qx', 'qy', 'w'" in message
    assert "x,y,theta" in message
    message = refusal(write(rows(), "t,x,why,theta,a,b,c,d"))
    assert "line 1: column y missing, found 't', 'x', 'why', 'theta'" in message


def test_hundreds_of_columns_are_not_all_listed(write: Write) -> None:
    assert len(refusal(write(rows(), ",".join(f"c{k}" for k in range(500))))) < 500


def test_numbered_samples_without_a_rate(write: Write) -> None:
    path = write(rows(), HEADER.replace("t", "i"))
    message = refusal(path)
    assert "line 1: column i counts samples" in message
    assert "pass rate=... (samples per second" in message
    for rate in (0.0, -14.5, np.nan, np.inf):
        assert f"rate must be positive (samples per second), got {rate}" in refusal(path, rate=rate)


@pytest.mark.parametrize("name", HEADER.split(","))
def test_a_column_twice(write: Write, name: str) -> None:
    body = [row + ",0" for row in rows()]
    message = refusal(write(body, f"{HEADER}, {name.upper()}"))
    assert f"line 1: column {name} appears 2 times; keep one" in message


def test_two_columns_of_time(write: Write) -> None:
    body = [row + ",0" for row in rows()]
    assert "line 1: columns t and time both" in refusal(write(body, HEADER + ",time"))


def test_an_unused_column_twice_is_no_matter(write: Write) -> None:
    body = [row + ",a,b" for row in rows()]
    assert len(load(write(body, HEADER + ",note,note"))) == 20


@pytest.mark.parametrize("name", HEADER.split(","))
@pytest.mark.parametrize(
    ("cell", "problem"),
    [
        ("abc", "found 'abc', not a number; fill in or remove the row"),
        ("1_5", "found '1_5', not a number"),
        ("0x1F", "found '0x1F', not a number"),
        ('"0,5"', "found '0,5', not a number; write a decimal point"),
        ('"two\nlines"', r"found 'two\nlines', not a number"),
        ("", "found nan, not a finite number; lost='drop'"),
        ("  ", "found nan"),
        ("nan", "found nan, not a finite number; lost='drop' (--lost drop) leaves"),
        ("-inf", "found -inf, not a finite number"),
        ("1e999", "found inf, not a finite number"),
    ],
)
def test_a_cell_that_is_no_number(write: Write, name: str, cell: str, problem: str) -> None:
    assert f"line 17, column {name}: {problem}" in refusal(write(changed(17, name, cell)))


def test_the_first_of_several_faults_is_named(write: Write) -> None:
    body = changed(17, "x", "abc")
    body[12] = body[12].replace("0.5", "NaN")
    body[9] = body[9].replace("0.5", "nan")
    assert "line 17, column x: found 'abc'" in refusal(write(body))
    body[15] = rows()[15]
    assert "line 11, column z: found nan" in refusal(write(body))


def test_a_decimal_comma(write: Write) -> None:
    plain = load(write(rows()))
    body = [row.replace(",", ";").replace(".", ",") for row in rows()]
    same(load(write(body, HEADER.replace(",", ";"))), plain)
    body[4] = body[4].replace("0,4", "1.000,4")
    message = refusal(write(body, HEADER.replace(",", ";")))
    assert "line 6, column t: found '1.000,4', not a number; write a decimal point" in message
    message = refusal(write([row.replace(".", ",") for row in rows()]))
    assert "line 2, column qz: the row goes on after it, 14 cells under 8 names" in message


def test_a_row_too_short(write: Write) -> None:
    body = rows()
    body[15] = "1.5,0.15,-0.3"
    message = refusal(write(body))
    assert "line 17, column z: the row ends after 3 of 8 cells" in message


def test_a_row_cut_in_its_last_columns(write: Write) -> None:
    body = [*(row + ",1,2" for row in rows()), "2.0,0.2,-0.4,0.5,0.8,0,0,0.6,1"]
    message = refusal(write(body, HEADER + ",fx,fy"))
    assert "line 22, column fy: the row ends after 9 of 10 cells" in message


def test_a_row_too_long(write: Write) -> None:
    body = rows()
    body[15] += ",7"
    assert "line 17, column qz: the row goes on after it" in refusal(write(body))


def test_a_quote_left_open(write: Write) -> None:
    body = [row + ",fine" for row in rows()]
    body[15] = rows()[15] + ',"oops'
    message = refusal(write(body, HEADER + ",note"))
    assert "line 17: cannot be split into cells" in message
    assert "check its quotes" in message


def test_time_running_backwards(write: Write) -> None:
    message = refusal(write(changed(17, "t", "0.25")))
    assert "line 17, column t: time runs backwards, from 1.4 s (line 16) to 0.25 s" in message
    body = [f"{t},{row}" for t, row in zip([*range(15), *range(5)], rows(), strict=True)]
    message = refusal(write(body, "i,tt" + HEADER[1:]), rate=2.0)
    assert "line 17, column i: time runs backwards, from 7 s (line 16) to 0 s" in message


@pytest.mark.parametrize(("name", "cell"), [("x", "0.140000002"), ("z", "0.6")])
def test_two_poses_at_one_time(write: Write, name: str, cell: str) -> None:
    body = changed(17, "t", "1.4")
    body[15] = ",".join(["1.4", *body[14].split(",")[1:]])
    assert len(load(write(body))) == 19
    cells = body[15].split(",")
    cells[HEADER.split(",").index(name)] = cell
    body[15] = ",".join(cells)
    message = refusal(write(body))
    assert "line 17, column t: 1.4 s is also the time of line 16, at another pose" in message


def test_two_rotations_at_one_time(write: Write) -> None:
    body = rows()
    body[15] = body[14].replace("0.8,0,0,0.6", "0.6,0,0,0.8")
    message = refusal(write(body))
    assert "line 17, column t: 1.4 s is also the time of line 16" in message
    assert "(0 m and 0.57 rad away)" in message


def test_stamps_since_1970_are_told_apart_in_messages(write: Write) -> None:
    body = [f"{1.7e9 + k / 10!r}," + row.split(",", 1)[1] for k, row in enumerate(rows())]
    message = refusal(write([*body[:15], *body[13:]]))
    assert "line 17, column t: time runs backwards, from 1.4 s after its start" in message
    assert "to 1.3 s after its start" in message


def test_too_few_samples(write: Write) -> None:
    assert len(load(write(rows(8)))) == 8
    for few in (1, 2, 7):
        assert f"{few} distinct samples, at least 8 are needed" in refusal(write(rows(few)))
    assert "7 distinct samples" in refusal(write([*rows(7), rows(7)[-1]]))


def test_a_zero_quaternion(write: Write) -> None:
    body = rows()
    body[15] = body[15].replace("0.8,0,0,0.6", "0,0,0,0")
    message = refusal(write(body))
    assert "line 17, columns qw, qx, qy, qz: the quaternion is zero" in message


@pytest.mark.parametrize("cell", ["0.802", "0.798", "1e200"])
def test_a_quaternion_off_unit_norm(write: Write, cell: str) -> None:
    norm = np.hypot(float(cell), 0.6) if float(cell) < 1e100 else np.inf
    message = refusal(write(changed(17, "qw", cell)))
    assert f"line 17, columns qw, qx, qy, qz: the quaternion has norm {norm:.6g};" in message


def test_a_gap(write: Write) -> None:
    body = rows(40)
    message = refusal(write(body[:15] + body[26:]))
    assert "line 17, column t: no sample from 1.4 s (line 16) to 2.6 s" in message
    assert "over 10 times the median period of 0.1 s; gaps='split'" in message


def test_a_missing_file(tmp_path: Path) -> None:
    path = tmp_path / "none.csv"
    assert refusal(path) == f"{path}: no such file; check the path"
    for read in (PoseTrajectory.from_csv, PoseTrajectory.from_npz):
        with pytest.raises(InputError, match=r"none\.csv: no such file"):
            read(path)


def test_a_folder(tmp_path: Path) -> None:
    assert refusal(tmp_path) == f"{tmp_path}: a folder, not a file; give {tmp_path / '*.csv'}"
    for read in (PoseTrajectory.from_csv, PoseTrajectory.from_npz):
        with pytest.raises(InputError, match="a folder, not a file"):
            read(tmp_path)


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ("t,x\n0,°\n".encode("latin-1"), "line 2: not UTF-8 text (byte 0xb0)"),
        (b"PK\x03\x04\0\0", "line 1: binary content"),
        (bytes(range(256)) * 9, "line"),
    ],
)
def test_what_is_not_text(tmp_path: Path, content: bytes, problem: str) -> None:
    path = tmp_path / "run.csv"
    path.write_bytes(content)
    message = refusal(path)
    assert problem in message
    assert "UTF-8" in message


def test_a_file_that_cannot_be_read(write: Write, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write(rows())

    def denied(_: Path) -> bytes:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "read_bytes", denied)
    assert refusal(path) == f"{path}: cannot be read: Permission denied"


@given(st.binary(max_size=400))
def test_any_bytes_at_all_are_refused_in_one_line(
    tmp_path_factory: pytest.TempPathFactory, content: bytes
) -> None:
    for name in ("any.csv", "any.npz"):
        path = tmp_path_factory.getbasetemp() / name
        path.write_bytes(content)
        refusal(path)


@given(st.lists(st.text('0123456789.,;-"\t\n\r eEinfa', max_size=30), max_size=15))
def test_any_text_under_a_header_is_read_or_refused_in_one_line(
    tmp_path_factory: pytest.TempPathFactory, body: list[str]
) -> None:
    path = tmp_path_factory.getbasetemp() / "text.csv"
    path.write_text("\n".join(["t,x,y,theta", *body]))
    try:
        load(path)
    except InputError as error:
        assert "\n" not in str(error)


# -------------------------------------------------------------------- npz


@pytest.fixture
def store(tmp_path: Path) -> Write:
    def store(**changes: object) -> Path:
        arrays: dict[str, object] = {
            "times": np.arange(20) / 10,
            "positions": np.arange(60.0).reshape(20, 3) / 100,
            "quaternions": np.tile([0.8, 0, 0, 0.6], (20, 1)),
            **changes,
        }
        path = tmp_path / "run.npz"
        np.savez(path, **{name: a for name, a in arrays.items() if a is not None})  # type: ignore[arg-type]
        return path

    return store


def array_with(index: int, value: object, name: str = "positions") -> np.ndarray:
    array = {
        "times": np.arange(20) / 10,
        "quaternions": np.tile([0.8, 0, 0, 0.6], (20, 1)),
    }.get(name, np.arange(60.0).reshape(20, 3) / 100)
    array[index] = value
    return array


def test_an_npz_is_what_its_arrays_say(store: Write) -> None:
    trajectory = load(store(comment=np.array(["ignored"])))
    np.testing.assert_array_equal(trajectory.times, np.arange(20) / 10)
    np.testing.assert_array_equal(trajectory.positions, np.arange(60).reshape(20, 3) / 100)
    np.testing.assert_allclose(trajectory.quaternions, np.tile([0.8, 0, 0, 0.6], (20, 1)))
    np.testing.assert_allclose(trajectory.linear_velocities, np.full((20, 3), 0.3))


def test_velocities_stored_are_velocities_read(store: Write) -> None:
    velocities = np.arange(60.0).reshape(20, 3)
    both = load(store(linear_velocities=velocities, angular_velocities=-velocities))
    np.testing.assert_array_equal(both.linear_velocities, velocities)
    np.testing.assert_array_equal(both.angular_velocities, -velocities)
    one = load(store(angular_velocities=velocities))
    np.testing.assert_allclose(one.linear_velocities, np.full((20, 3), 0.3))
    np.testing.assert_array_equal(one.angular_velocities, velocities)


@pytest.mark.filterwarnings("ignore::noslip.errors.RecordingWarning")
def test_whole_and_single_precision_numbers_are_numbers(store: Write) -> None:
    positions = np.arange(60, dtype=np.int32).reshape(20, 3)
    quaternions = np.tile(np.array([0.8, 0, 0, 0.6], dtype=np.float32), (20, 1))
    trajectory = load(store(times=np.arange(20), positions=positions, quaternions=quaternions))
    np.testing.assert_array_equal(trajectory.positions, positions)
    np.testing.assert_allclose(np.linalg.norm(trajectory.quaternions, axis=1), 1, atol=1e-15)


@pytest.mark.filterwarnings("ignore::noslip.errors.RecordingWarning")
def test_a_sample_dropped_takes_its_velocities_with_it(store: Write) -> None:
    index = np.array([*range(10), *range(9, 19)])
    velocities = np.arange(60.0).reshape(20, 3)
    path = store(
        times=index / 10.0,
        positions=np.repeat(index[:, None], 3, axis=1),
        quaternions=np.tile([0.8, 0, 0, 0.6], (20, 1))
        * np.where(np.arange(20) < 10, 1, -1)[:, None],
        linear_velocities=velocities,
    )
    trajectory = load(path)
    np.testing.assert_array_equal(trajectory.times, np.arange(19) / 10)
    np.testing.assert_array_equal(trajectory.linear_velocities, np.delete(velocities, 10, axis=0))


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"times": None, "quaternions": None}, "arrays times, quaternions missing, found 'pos"),
        ({"positions": None}, "array positions missing, found 'times', 'quaternions'; needed"),
        ({"times": np.zeros((20, 1))}, "array times has shape (20, 1), expected (20,)"),
        ({"times": 3.0}, "array times has shape (), expected (1,)"),
        ({"positions": np.zeros((3, 20))}, "array positions has shape (3, 20), expected (20, 3)"),
        ({"quaternions": np.ones((20, 3))}, "array quaternions has shape (20, 3), expected (20, 4"),
        ({"linear_velocities": np.ones((19, 3))}, "array linear_velocities has shape (19, 3)"),
        ({"angular_velocities": np.ones(20)}, "array angular_velocities has shape (20,)"),
        ({"positions": np.full((20, 3), "a")}, "array positions holds <U1, not real numbers"),
        ({"positions": np.full((20, 3), 1j)}, "array positions holds complex128, not real"),
        ({"positions": np.full((20, 3), None)}, "array positions holds object"),
        ({"positions": array_with(17, np.nan)}, "sample 17, array positions: found [nan nan nan]"),
        ({"times": array_with(17, np.inf, "times")}, "sample 17, array times: found inf, not a"),
        (
            {"linear_velocities": array_with(17, [0, np.nan, 0])},
            "sample 17, array linear_velocities: found [ 0. nan  0.], not a finite number",
        ),
        (
            {"times": array_with(17, 0.25, "times")},
            "sample 17, array times: time runs backwards, from 1.6 s (sample 16) to 0.25 s",
        ),
        (
            {"times": array_with(17, 1.6, "times")},
            "sample 17, array times: 1.6 s is also the time of sample 16, at another pose",
        ),
        (
            {"times": np.arange(20) / 10 + 2 * (np.arange(20) > 16)},
            "sample 17, array times: no sample from 1.6 s (sample 16) to 3.7 s",
        ),
        (
            {"quaternions": array_with(17, 0, "quaternions")},
            "sample 17, array quaternions: the quaternion is zero",
        ),
        (
            {"quaternions": array_with(17, 0.6, "quaternions")},
            "sample 17, array quaternions: the quaternion has norm 1.2;",
        ),
        (
            {
                "times": np.arange(7.0),
                "positions": np.ones((7, 3)),
                "quaternions": np.eye(4)[[0] * 7],
            },
            "7 distinct samples, at least 8 are needed",
        ),
        (
            {"times": [], "positions": np.ones((0, 3)), "quaternions": np.ones((0, 4))},
            "0 distinct samples, at least 8 are needed",
        ),
    ],
)
def test_an_npz_that_is_no_recording(
    store: Write, changes: dict[str, object], problem: str
) -> None:
    assert problem in refusal(store(**changes))


def test_an_object_array_beside_the_recording_is_never_opened(store: Write) -> None:
    class Trap:
        def __reduce__(self) -> tuple[Callable[..., object], tuple[object, ...]]:
            return pytest.fail, ("unpickled",)

    trap = np.array([Trap()], dtype=object)
    assert len(load(store(note=trap))) == 20
    assert "array linear_velocities holds object" in refusal(store(linear_velocities=trap))


def test_what_is_not_an_npz(tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    for content in (b"", b"t,x,y\n", b"PK\x03\x04 no more"):
        path.write_bytes(content)
        assert refusal(path) == f"{path}: not an npz file; write it with numpy.savez"
    with path.open("wb") as file:
        np.save(file, np.zeros(3))
    assert "not an npz file" in refusal(path)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("times", b"not an array")
    assert "arrays positions, quaternions missing" in refusal(path)


def test_a_damaged_npz(store: Write) -> None:
    path = store()
    whole = path.read_bytes()
    path.write_bytes(whole[:300] + bytes(40) + whole[340:])
    assert "cannot be read" in refusal(path)
    path.write_bytes(whole[: len(whole) // 2])
    assert "not an npz file" in refusal(path)


# -------------------------------------------------------------------- which files


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "deep").mkdir()
    for name in ("b.csv", "a.csv", "c10.CSV", "c9.csv", "deep/d.csv"):
        (tmp_path / name).write_text("\n".join([HEADER, *rows()]))
    load(tmp_path / "a.csv").to_npz(tmp_path / "e.npz")
    (tmp_path / "notes.txt").write_text("not a recording")
    return tmp_path


def names(folder: Path, paths: object) -> list[str]:
    loaded = load_demonstrations(paths)  # type: ignore[arg-type]
    return [Path(trajectory.name).relative_to(folder).as_posix() for trajectory in loaded]


def test_globs_expand_sorted(folder: Path) -> None:
    assert names(folder, f"{folder}/*.csv") == ["a.csv", "b.csv", "c9.csv"]
    assert names(folder, folder / "[ac]*.[cC][sS]*") == ["a.csv", "c10.CSV", "c9.csv"]
    assert names(folder, f"{folder}/**/*.csv") == ["a.csv", "b.csv", "c9.csv", "deep/d.csv"]


def test_lists_keep_their_order_and_a_file_twice_is_kept_once(folder: Path) -> None:
    given = [folder / "b.csv", f"{folder}/*.csv", str(folder / "deep/../a.csv"), folder / "e.npz"]
    assert names(folder, given) == ["b.csv", "a.csv", "c9.csv", "e.npz"]
    assert names(folder, iter(given)) == ["b.csv", "a.csv", "c9.csv", "e.npz"]
    (folder / "link.csv").symlink_to(folder / "a.csv")
    assert names(folder, [folder / "link.csv", folder / "a.csv"]) == ["link.csv"]


def test_the_name_is_the_path_as_given(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    monkeypatch.setenv("HOME", str(folder))
    assert [t.name for t in load_demonstrations("deep/*.csv")] == [str(Path("deep/d.csv"))]
    assert [t.name for t in load_demonstrations(Path("e.npz"))] == ["e.npz"]
    assert [t.name for t in load_demonstrations("~/a.csv")] == [str(folder / "a.csv")]
    assert names(folder, "~/[ab].csv") == ["a.csv", "b.csv"]


def test_a_path_that_exists_is_no_glob(folder: Path) -> None:
    (folder / "[ab].csv").write_text("\n".join([HEADER, *rows(9)]))
    (trajectory,) = load_demonstrations(folder / "[ab].csv")
    assert len(trajectory) == 9


def test_a_glob_passes_over_folders(folder: Path) -> None:
    (folder / "more.csv").mkdir()
    assert names(folder, f"{folder}/*.csv") == ["a.csv", "b.csv", "c9.csv"]
    assert refusal(f"{folder}/mor*.csv").endswith(
        "no file matches; check the folder and the pattern"
    )


def test_nothing_found(folder: Path) -> None:
    assert "no file matches" in refusal(f"{folder}/*.tsv")
    assert "no such file" in refusal(str(folder / "z.csv"))
    assert refusal([]) == ("no demonstrations given; give at least one file, such as runs/*.csv")
    assert "no such file" in refusal([f"{folder}/*.csv", str(folder / "z.csv")])


@pytest.mark.parametrize("name", ["notes.rst", "README"])
def test_an_unknown_suffix(folder: Path, name: str) -> None:
    (folder / name).write_text("not a recording")
    message = refusal(folder / name)
    assert f"{Path(name).suffix or 'no suffix'} is not a known kind of recording" in message
    assert "known are .csv, .tsv, .tum, " in message


def test_the_rate_is_for_numbered_samples_alone(folder: Path) -> None:
    numbered = folder / "numbered.csv"
    numbered.write_text("\n".join(["i" + HEADER[1:], *changed_to_numbers()]))
    with pytest.warns(RecordingWarning, match=r"a\.csv.* is not used"):
        stamped, counted = load_demonstrations([folder / "a.csv", numbered], rate=2.0)
    assert stamped.period == pytest.approx(0.1)
    assert counted.period == pytest.approx(0.5)


def changed_to_numbers() -> list[str]:
    return [f"{k}," + row.split(",", 1)[1] for k, row in enumerate(rows())]


# -------------------------------------------------------------------- real recordings


HELD = pytest.mark.filterwarnings("ignore:.*stands still:noslip.errors.RecordingWarning")
"""The trolleys' tracker lost them for up to half a second, and held the pose."""


@HELD
@pytest.mark.recordings
@pytest.mark.parametrize(
    ("pattern", "files", "rate", "period"),
    [
        ("contour_following/*.csv", 8, None, 0.035),
        ("peg_on_hole/*.csv", 3, None, 0.035),
        ("needle_insertion/*.csv", 20, 14.5, 1 / 14.5),
        ("trolley_mocap/trolley_fast.csv", 1, None, 0.025),
        ("wheeled_robots/*.csv", 13, None, 0.05),
    ],
)
def test_real_recordings_load(
    recordings: Path, pattern: str, files: int, rate: float | None, period: float
) -> None:
    loaded = load_demonstrations(recordings / pattern, rate=rate)
    assert len(loaded) == files
    for trajectory in loaded:
        assert trajectory.period == pytest.approx(period, rel=0.01)
        quaternions = trajectory.quaternions
        assert np.all(np.sum(quaternions[1:] * quaternions[:-1], axis=1) > 0)
        lines = Path(trajectory.name).read_text().splitlines()
        assert len(trajectory) == len(lines) - 1
        first = dict(zip(lines[0].split(","), lines[1].split(","), strict=True))
        assert trajectory.positions[0, 0] == float(first["x"])


@HELD
@pytest.mark.recordings
def test_a_real_recording_with_samples_stamped_on_late_arrival_is_refused(
    recordings: Path,
) -> None:
    # Seven times, frames that were held up were stamped together as they came in: two poses, 4 to
    # 6 mm apart, at one time.  No velocity can be had from those.
    message = refusal(recordings / "trolley_mocap" / "trolley_mid.csv")
    assert "line 4223, column t: 105.58 s is also the time of line 4222, at another" in message


@pytest.mark.recordings
def test_real_numbered_recordings_ask_for_the_rate(recordings: Path) -> None:
    message = refusal(recordings / "needle_insertion" / "trial_01.csv")
    assert "pass rate=... (samples per second" in message
