"""What trackers and robots export, by the program that writes it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.errors import RecordingError

COUNT = 40
T = 0.01 * np.arange(COUNT)
POSITIONS = np.column_stack([0.3 + 0.1 * T, 0.1 - 0.05 * T, 0.2 + 0.02 * np.sin(9 * T)])
TURNS = Rotation.from_rotvec(np.column_stack([0.3 + T, 0.2 - 0.5 * T, 0.4 + 0.8 * T]))
XYZW = TURNS.as_quat()
MM = 1e3 * POSITIONS
ZYX = TURNS.as_euler("ZYX", degrees=True)


def assert_right(file: Path, **asked) -> None:
    (found,) = ns.load_demonstrations(file, **asked)
    np.testing.assert_allclose(found.times - found.times[0], T, atol=5e-7)
    np.testing.assert_allclose(found.positions, POSITIONS, atol=1e-12)
    assert (found.rotations * TURNS.inv()).magnitude().max() < 1e-7


def written(folder: Path, preamble: list[str], columns: list, name: str = "run.csv") -> Path:
    rows = zip(*(np.asarray(c).tolist() for c in columns), strict=True)
    lines = [",".join(c if isinstance(c, str) else repr(c) for c in row) for row in rows]
    (folder / name).write_text("\n".join([*preamble, *lines, ""]))
    return folder / name


def motive(rotation: str, units: str, bodies: list[str]) -> list[str]:
    parts = ["W"] * (rotation == "Quaternion")
    letters = ["X", "Y", "Z", *parts] if parts else list(rotation)
    each = len(letters) + 4
    kinds = ["Rotation"] * len(letters) + ["Position"] * 3 + ["Mean Marker Error"]
    return [
        f"Format Version,1.23,Take Name,a,Export Frame Rate,100.0,Rotation Type,{rotation},"
        f"Length Units,{units},Coordinate Space,Global",
        "",
        ",Type," + ",".join(["Rigid Body"] * each * len(bodies)),
        ",Name," + ",".join(name for name in bodies for _ in range(each)),
        ",ID," + ",".join(["AB"] * each * len(bodies)),
        ",," + ",".join(kinds * len(bodies)),
        "Frame,Time (Seconds)," + ",".join([*letters, "X", "Y", "Z", ""] * len(bodies)),
    ]


@pytest.mark.parametrize("order", ["Quaternion", "XYZ", "YXZ", "ZYX"])
@pytest.mark.parametrize(("units", "scale"), [("Meters", 1.0), ("Millimeters", 1e3)])
def test_motive(tmp_path: Path, order: str, units: str, scale: float) -> None:
    turns = XYZW.T if order == "Quaternion" else TURNS.as_euler(order, degrees=True).T
    error = np.full(COUNT, 0.001)
    columns = [np.arange(COUNT), T, *turns, *(scale * POSITIONS.T), error]
    assert_right(written(tmp_path, motive(order, units, ["knife"]), columns))


def test_motive_with_two_bodies_asks_which(tmp_path: Path) -> None:
    other = [0 * T, 0 * T, 0 * T, 1 + 0 * T, *(POSITIONS.T + 1), 0 * T]
    columns = [np.arange(COUNT), T, *other, *XYZW.T, *POSITIONS.T, 0 * T]
    file = written(tmp_path, motive("Quaternion", "Meters", ["phantom", "Knife 2"]), columns)
    with pytest.raises(RecordingError, match=r"phantom and knife_2.*--columns phantom"):
        ns.load_demonstrations(file)
    assert_right(file, columns="Knife 2")


@pytest.mark.parametrize("unit", ["rad", "deg"])
def test_vicon_asks_what_its_angles_are(tmp_path: Path, unit: str) -> None:
    vector = TURNS.as_rotvec() if unit == "rad" else np.degrees(TURNS.as_rotvec())
    preamble = [
        "Objects",
        "100",
        ",,Global Angle:knife:knife,,,,,",
        "Frame,Sub Frame,RX,RY,RZ,TX,TY,TZ",
        f",,{unit},{unit},{unit},mm,mm,mm",
    ]
    file = written(tmp_path, preamble, [np.arange(COUNT), [0] * COUNT, *vector.T, *MM.T])
    with pytest.raises(RecordingError, match="--rotation"):
        ns.load_demonstrations(file)
    assert_right(file, rotation="rotvec")


def test_ndi_polhemus_kuka_and_ur(tmp_path: Path) -> None:
    ok, one = ["OK"] * COUNT, ["1"] * COUNT
    frames = np.arange(COUNT)
    header = "Tools,Port 1:8700340,Frame,Face,State,Rz,Ry,Rx,Tx,Ty,Tz,Error,Markers"
    file = written(
        tmp_path, [header], [one, one, frames, 0 * frames, ok, *ZYX.T, *MM.T, T, one], "ndi.csv"
    )
    assert_right(file, rate=100)
    header = "Frame,Face,State,Q0,Qx,Qy,Qz,Tx,Ty,Tz"
    wxyz = np.roll(XYZW, 1, axis=1)
    file = written(tmp_path, [header], [frames, 0 * frames, ok, *wxyz.T, *MM.T], "ndi_q.csv")
    assert_right(file, rate=100)
    file = written(tmp_path, ["Frame,X,Y,Z,Az,El,Ro"], [frames, *(MM.T / 25.4), *ZYX.T], "p.csv")
    assert_right(file, rate=100, units="in")
    file = written(tmp_path, ["Time,X,Y,Z,A,B,C"], [T, *MM.T, *ZYX.T], "kuka.csv")
    assert_right(file)
    names = ["timestamp", *(f"actual_TCP_pose_{k}" for k in range(6))]
    forces = [f"actual_TCP_force_{k}" for k in range(6)]
    columns = [T, *POSITIONS.T, *TURNS.as_rotvec().T, *[T] * 6]
    assert_right(written(tmp_path, [",".join(names + forces)], columns, "ur.csv"))


def test_franka_openvr_and_kitti(tmp_path: Path) -> None:
    pose = np.zeros((COUNT, 4, 4))
    pose[:, :3, :3], pose[:, :3, 3], pose[:, 3, 3] = TURNS.as_matrix(), POSITIONS, 1
    names = [f"O_T_EE[{k}]" for k in range(16)]
    by_columns = pose.transpose(0, 2, 1).reshape(COUNT, 16).T
    assert_right(written(tmp_path, [",".join(["time", *names])], [T, *by_columns], "franka.csv"))
    by_rows = pose[:, :3].reshape(COUNT, 12).T
    names = [f"m{k}" for k in range(12)]
    file = written(tmp_path, [",".join(["time", *names])], [T, *by_rows], "vive.csv")
    assert_right(file, columns=",".join(names))
    assert_right(written(tmp_path, [], by_rows, "kitti.csv"), rate=100)
    (tmp_path / "kitti.txt").write_text(
        "\n".join(" ".join(map(repr, row)) for row in by_rows.T.tolist())
    )
    assert_right(tmp_path / "kitti.txt", rate=100)


def test_what_ros_prints(tmp_path: Path) -> None:
    seconds, ticks = [1_700_000_000] * COUNT, 10_000_000 * np.arange(COUNT)
    base = ["base"] * COUNT
    columns = [seconds, ticks, base, *POSITIONS.T, *XYZW.T]
    assert_right(written(tmp_path, [], columns, "ros2.csv"))
    stamps = 1_700_000_000_000_000_000 + ticks
    late = stamps + 7_000_000_000 + 3_000_000 * np.arange(COUNT)
    header = ["%time", "field.header.seq", "field.header.stamp", "field.header.frame_id"]
    header += [f"field.pose.position.{a}" for a in "xyz"]
    header += [f"field.pose.orientation.{a}" for a in "xyzw"]
    columns = [late, np.arange(COUNT), stamps, base, *POSITIONS.T, *XYZW.T]
    assert_right(written(tmp_path, [",".join(header)], columns, "ros1.csv"))


@pytest.mark.parametrize("sign", ["#", "# ", "%", "% "])
def test_a_tum_file_is_read_in_the_order_that_its_header_names(tmp_path: Path, sign: str) -> None:
    wxyz = np.roll(XYZW, 1, axis=1)
    rows = np.column_stack([T, POSITIONS, wxyz]).tolist()
    lines = [" ".join(map(repr, row)) for row in rows]
    file = tmp_path / "run.tum"
    file.write_text("\n".join([f"{sign}timestamp tx ty tz qw qx qy qz", *lines]))
    assert_right(file)


@pytest.mark.parametrize(
    "asked",
    [
        {"rotation": "euler:ZYX:deg"},
        {"rotation": "euler-zyx-intrinsic-deg"},
        {"rotation": "ZYX", "units": ["mm", "deg"]},
        {"rotation": "ypr:degrees"},
        {"rotation": "euler xyz", "units": {"rotation": "deg", "length": "mm"}},
        {"rotation": "rpy:deg"},
    ],
)
def test_one_rotation_has_several_names(tmp_path: Path, asked: dict) -> None:
    """About the moving z, y, x, or about the fixed x, y, z: the same."""
    file = written(tmp_path, ["t,a1,a2,a3,r1,r2,r3"], [T, *MM.T, *ZYX.T])
    fixed = "xyz" in asked["rotation"] or asked["rotation"].startswith("rpy")
    columns = ["a1", "a2", "a3", *(["r3", "r2", "r1"] if fixed else ["r1", "r2", "r3"])]
    assert_right(file, columns=columns, **({"units": "mm"} | asked))
    with pytest.raises(RecordingError, match="rotation 'euler:xxz' is not known"):
        ns.load_demonstrations(file, columns=columns, rotation="euler:xxz")
    with pytest.raises(RecordingError, match=r"angles reach .* add :deg or :rad"):
        ns.load_demonstrations(file, columns=columns, rotation="ZYX", units="mm")
    with pytest.raises(RecordingError, match="units 'parsec' are not known"):
        ns.load_demonstrations(file, columns=columns, rotation="ZYX", units="parsec")


def test_text_in_utf_16_and_with_a_line_for_spreadsheets(tmp_path: Path) -> None:
    rows = np.column_stack([T, POSITIONS, XYZW]).tolist()
    lines = [";".join(repr(x).replace(".", ",") for x in row) for row in rows]
    text = "\n".join(["sep=;", "Time (s);X;Y;Z;QX;QY;QZ;QW", *lines])
    for encoding in ("utf-8", "utf-8-sig", "utf-16"):
        (tmp_path / "run.csv").write_bytes(text.encode(encoding))
        assert_right(tmp_path / "run.csv")


def test_forces_and_velocities_are_no_positions(tmp_path: Path) -> None:
    for names in ("fx,fy,fz", "force_x,force_y,force_z", "vx,vy,vz", "linear.x,linear.y,linear.z"):
        file = written(tmp_path, [f"t,{names},qx,qy,qz,qw"], [T, *POSITIONS.T, *XYZW.T])
        with pytest.raises(RecordingError, match="columns x, y, z missing"):
            ns.load_demonstrations(file)
