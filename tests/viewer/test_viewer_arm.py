"""The arm of a simulation, as numbers, on the page and in a saved file."""

from __future__ import annotations

import base64
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import noslip as ns
from refusals import refusal

pytest.importorskip("viser", reason="the viewer needs viser (extra: viewer)")
pytest.importorskip("mujoco", reason="the extra robots is not installed")

from noslip import robots
from noslip.viewer import Arm, Page, Simulation, read_simulation, save_page

BLADE = (-0.004, 0.0, 0.015)
"""Middle of the blade in the tool's frame (m), by the model's XML."""


@pytest.fixture(scope="module")
def simulation(arm_folder) -> Simulation:
    return read_simulation(arm_folder)


def part_named(arm: Arm, name: str) -> int:
    return [arm.robot.model.geom(g).name for g in arm._geoms].index(name)


def in_world(arm: Arm, part: int, sample: int) -> np.ndarray:
    positions, _ = arm.poses(sample)
    return np.asarray(arm.rotation.apply(positions[part]) + arm.position)


# ---------------------------------------------------------------- what was simulated


def test_the_arm_holds_its_blade_where_the_tool_is(simulation):
    blade = part_named(simulation.arm, "blade")
    for sample in (0, 400, 1100, -1):
        tool = simulation.executed
        expected = tool.positions[sample] + tool.rotations[sample].apply(BLADE)
        assert in_world(simulation.arm, blade, sample) == pytest.approx(expected, abs=1e-9)


def test_all_lies_in_the_world_of_the_primitive(simulation, cut_file):
    dmp = ns.load_primitive(cut_file)
    assert simulation.constraints == dmp.constraints
    motion = dmp.rollout(time_step=robots.TIME_STEP)
    asked = robots.timed(motion, dmp.system)
    assert np.abs(simulation.commanded.positions - asked.positions).max() < 1e-6
    turned = simulation.commanded.rotations * asked.rotations.inv()
    assert turned.magnitude().max() < 1e-5
    assert ns.check(simulation.commanded, dmp.constraints, tolerance=1e-6).satisfied
    # The table is below, and the base stands on it.
    assert simulation.arm.position[2] == pytest.approx(-0.25, abs=1e-6)


def test_the_arm_is_shown_as_it_executed_not_as_it_was_told(simulation, arm_folder):
    told = np.loadtxt(arm_folder / "joints.csv", delimiter=",", skiprows=1)[:, 1:8]
    sagging = np.abs(simulation.arm.joint_positions - told).max()
    assert 1e-4 < sagging < 0.1
    off = simulation.executed.positions - simulation.commanded.positions
    assert np.linalg.norm(off, axis=1).max() > 1e-4


def test_without_dynamics_it_is_shown_as_told(simulate):
    folder = simulate(dynamics="none")
    assert not (folder / "executed.csv").exists()
    shown = read_simulation(folder)
    assert shown.executed.positions == pytest.approx(shown.commanded.positions, abs=1e-9)


def test_a_model_of_ones_own_is_found_again(simulate, tmp_path):
    model = tmp_path / "arm.xml"
    model.write_text(Path(robots.__file__).with_name("panda.xml").read_text())
    folder = simulate(robot=str(model), robot_tool="tool", dynamics="none")
    arm = read_simulation(folder).arm
    assert arm.robot.name == "arm.xml"
    assert len(arm.parts) == len(robots.panda(table=None).model.geom_type)
    model.unlink()
    with pytest.raises(ns.errors.InputError, match=r"field model: .*arm\.xml is not there"):
        read_simulation(folder)


# ---------------------------------------------------------------- shapes

SHAPES = """
<mujoco>
  <asset>
    <material name="red" rgba="1 0 0 1"/>
    <mesh name="wedge" vertex="0 0 0  0.1 0 0  0 0.2 0  0 0 0.3"/>
  </asset>
  <worldbody>
    <geom name="floor" type="plane" size="0 0.5 0.1"/>
    <body name="link">
      <joint name="turn" axis="0 0 1" range="-2 2"/>
      <geom name="ball" type="sphere" size="0.05" pos="0 0 0.1"/>
      <geom name="egg" type="ellipsoid" size="0.02 0.03 0.05" pos="0.1 0 0.1"/>
      <geom name="rod" type="cylinder" size="0.02 0.1" pos="0.2 0 0.1" material="red"/>
      <geom name="pill" type="capsule" fromto="0.3 0 0.1 0.4 0.2 0.1" size="0.03"/>
      <geom name="brick" type="box" size="0.01 0.02 0.03" pos="0.5 0 0.1" rgba="0 1 0 1"/>
      <geom name="shard" type="mesh" mesh="wedge" pos="0.6 0 0.1"/>
      <geom name="ghost" type="sphere" size="0.4" rgba="1 1 1 0"/>
      <geom name="collision" type="sphere" size="0.4" group="3"/>
      <site name="tip" pos="0.7 0 0.1"/>
    </body>
  </worldbody>
</mujoco>
"""


@pytest.fixture(scope="module")
def shaped(tmp_path_factory) -> Arm:
    file = tmp_path_factory.mktemp("model") / "shapes.xml"
    file.write_text(SHAPES)
    still = robots.Placement.of(flat(), [0.0, 0.0, 0.0])
    return Arm(robots.load(file, tool="tip"), np.linspace([0.0], [1.0], 5), still)


def flat() -> ns.PoseTrajectory:
    return ns.PoseTrajectory([0.0, 1.0], np.zeros((2, 3)), Rotation.identity(2))


def test_what_is_hidden_is_not_drawn(shaped):
    names = [shaped.robot.model.geom(g).name for g in shaped._geoms]
    assert names == ["floor", "ball", "egg", "rod", "pill", "brick", "shard"]
    assert shaped.moving.tolist() == [False] + 6 * [True]
    assert shaped.parts[names.index("rod")].color == (255, 0, 0)
    assert shaped.parts[names.index("brick")].color == (0, 255, 0)


@pytest.mark.parametrize("name", ["ball", "egg", "rod", "pill", "brick", "shard"])
def test_the_triangles_lie_on_what_mujoco_collides_with(shaped, name):
    """A ray from a middle of a triangle, from outside, meets MuJoCo's own shape there."""
    import mujoco

    model, part = shaped.robot.model, part_named(shaped, name)
    data = mujoco.MjData(model)
    data.qpos[:] = shaped.joint_positions[2]
    mujoco.mj_forward(model, data)
    positions, quaternions = shaped.poses(2)
    turn = Rotation.from_quat(quaternions[part], scalar_first=True)
    mesh = shaped.parts[part]
    corners = turn.apply(mesh.vertices[mesh.faces].reshape(-1, 3)).reshape(-1, 3, 3)
    corners += positions[part]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    size = np.ptp(mesh.vertices, axis=0).max()
    picked = np.linspace(0, len(corners) - 1, 60).astype(int)
    away = []
    for middle, normal in zip(corners[picked].mean(axis=1), normals[picked], strict=True):
        start = middle + 0.5 * size * normal
        if name == "shard":
            met = mujoco.mj_rayMesh(model, data, shaped._geoms[part], start, -normal, None)
        else:
            geom = shaped._geoms[part]
            met = mujoco.mju_rayGeom(
                data.geom_xpos[geom],
                data.geom_xmat[geom],
                model.geom_size[geom],
                start,
                -normal,
                model.geom_type[geom],
                None,
            )
        away.append(met - 0.5 * size)
    # Triangles of what is round lie within it.
    assert np.abs(away).max() < 0.01 * size


def test_the_parts_turn_with_the_joint(shaped):
    brick, floor = part_named(shaped, "brick"), part_named(shaped, "floor")
    positions, _ = shaped.poses(-1)
    assert positions[brick] == pytest.approx([0.5 * np.cos(1), 0.5 * np.sin(1), 0.1])
    assert positions[floor] == pytest.approx(np.zeros(3))
    assert np.ptp(shaped.parts[floor].vertices, axis=0) == pytest.approx([2.0, 1.0, 0.0])


def test_a_model_of_collision_shapes_alone_shows_these(tmp_path):
    file = tmp_path / "shapes.xml"
    file.write_text(re.sub(r"<geom ", '<geom group="3" ', SHAPES.replace(' group="3"', "")))
    still = robots.Placement.of(flat(), [0.0, 0.0, 0.0])
    assert len(Arm(robots.load(file, tool="tip"), [0.0], still).parts) == 8


# ---------------------------------------------------------------- drawn


def node_positions(page: Page, name: str = "arm") -> np.ndarray:
    arm = page.entries[name].follower
    return np.array([node.position for node in arm._nodes])


def test_the_arm_moves_with_the_slider(arm_folder, cut_file):
    simulation = read_simulation(arm_folder)
    shown = {"cut.json": ns.load_primitive(cut_file), "arm": simulation}
    page = Page(shown, port=0)
    try:
        entry = page.entries["arm"]
        assert page.chosen == "cut.json"
        assert entry.track.reference is simulation.commanded
        assert page.entries["cut.json"].follower is None
        for instant in (0.0, 0.7, page.duration):
            page._show_time(instant)
            sample = entry.track.sample(instant)
            assert node_positions(page) == pytest.approx(simulation.arm.poses(sample)[0])
        page._choose("arm")
        assert "Against the commanded motion" in page._verdict.content
        assert "blade" in page._readout.content
        # The camera sees base and work, and stands across from the base.
        camera = page.server.initial_camera
        ahead = np.array(camera.look_at) - camera.position
        for point in (simulation.arm.position, simulation.executed.positions[0]):
            towards = point - np.array(camera.position)
            cosine = towards @ ahead / np.linalg.norm(towards) / np.linalg.norm(ahead)
            assert np.arccos(cosine) < np.radians(40)
        near, far = (
            np.linalg.norm(point - np.array(camera.position))
            for point in (simulation.executed.positions[0], simulation.arm.position)
        )
        assert near < far
    finally:
        page.stop()


def test_a_saved_page_has_the_arm_and_moves_it(tmp_path, arm_folder):
    msgspec = pytest.importorskip("msgspec", reason="of viser's file")
    zstandard = pytest.importorskip("zstandard", reason="of viser's file")
    simulation = read_simulation(arm_folder)
    text = save_page(tmp_path / "scene.html", {"arm": simulation}).read_text()
    packed = base64.b64decode(re.search(r'__VISER_EMBED_DATA__="([^"]+)"', text)[1])
    data = zstandard.ZstdDecompressor().decompressobj().decompress(packed[8:])
    length = int.from_bytes(data[:8], "little")
    messages = [m for _, m in msgspec.msgpack.decode(data[8 : 8 + length])["messages"]]
    node = "/motions/arm/follower/"
    added = {m["name"] for m in messages if m["type"] == "MeshMessage"}
    assert {f"{node}{k}" for k in range(len(simulation.arm.parts))} <= added
    blade = f"{node}{part_named(simulation.arm, 'blade')}"
    places = [
        m["position"] for m in messages if m["type"] == "SetPositionMessage" and m["name"] == blade
    ]
    assert len(places) > 30
    last, _ = simulation.arm.poses(-1)
    expected = last[part_named(simulation.arm, "blade")]
    assert places[-1] == pytest.approx(expected, abs=1e-6)


# ---------------------------------------------------------------- what is refused


@pytest.mark.parametrize(
    ("file", "change", "message"),
    [
        ("summary.json", lambda text: "{", "not JSON"),
        ("summary.json", lambda text: "[]", "no field robot"),
        ("summary.json", lambda text: text.replace('"tool"', '"pool"'), "no field tool"),
        ("summary.json", lambda text: text.replace('"panda"', '"ur5"', 1), "there is panda"),
        ("summary.json", lambda text: text.replace('"blade"', '"sword"'), "no constraint is"),
        ("summary.json", lambda text: text.replace('"quaternion"', '"q"'), "quaternion"),
        ("joints.csv", lambda text: text.replace(",", "|"), "expected the columns"),
        (
            "joints.csv",
            lambda text: re.sub(r",[^,\n]*\n", "\n", text),
            "expected the columns t, q1",
        ),
        ("executed.csv", None, "no such file"),
        ("executed.csv", lambda text: text[: len(text) // 2].rpartition("\n")[0], "simulate again"),
        ("tool.csv", None, "tool.csv"),
    ],
)
def test_a_damaged_folder_is_refused_in_one_line(arm_folder, tmp_path, file, change, message):
    folder = shutil.copytree(arm_folder, tmp_path / "arm")
    if change is None:
        (folder / file).unlink()
    else:
        (folder / file).write_text(change((folder / file).read_text()))
    assert re.search(message, refusal(ns.errors.InputError, read_simulation, folder))
    assert json.loads((arm_folder / "summary.json").read_text())["robot"] == "panda"
