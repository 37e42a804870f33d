"""What the viewer draws, as numbers."""

from __future__ import annotations

import re
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import noslip as ns
from learned import under
from noslip.constraints import ConstraintSystem
from noslip.constraints.declaration import Instant
from noslip.constraints.edge_motion import edge_motion
from noslip.edge import Edge
from refusals import refusal

pytest.importorskip("viser", reason="the viewer needs viser (extra: viewer)")

from noslip.viewer.charts import CHART_POINTS, cursor, curves
from noslip.viewer.colors import SLIP_COLORS, slip_colors
from noslip.viewer.entries import extent, node_name
from noslip.viewer.shapes import Frame, Shape, shapes
from noslip.viewer.tool import load_tool, scalpel
from noslip.viewer.track import ARROW, LONGEST, MOST_SEGMENTS, Track


def track(motion: ns.PoseTrajectory, *constraints: ns.Constraint) -> Track:
    return Track(motion.name, motion, ConstraintSystem(constraints))


# ---------------------------------------------------------------- along a motion


def test_the_angle_between_velocity_and_lateral_axis_tells_the_slip(slipping):
    shown = track(slipping, ns.Blade())
    for sample in (50, 200, 333):
        arrows = shown.arrows(sample, 1.0)
        lateral, velocity = (np.diff(arrows[a], axis=0)[0] for a in ("lateral", "velocity"))
        cosine = lateral @ velocity / np.linalg.norm(lateral) / np.linalg.norm(velocity)
        assert np.arcsin(cosine) == pytest.approx(shown.slip_angle(sample), abs=1e-12)
        # Rolled by 0.2 rad; chords differ from the tangent by half a step's turn.
        assert shown.slip_angle(sample) == pytest.approx(-0.2, abs=0.01)
        speed = np.linalg.norm(shown.velocities[sample])
        assert shown.violation[sample] == pytest.approx(abs(cosine) * speed, rel=1e-9)


def test_where_the_constraint_holds_the_arrows_are_at_right_angles(primitive):
    shown = track(primitive.rollout(), *primitive.constraints)
    angles = [shown.slip_angle(k) for k in range(20, 380, 20)]
    assert np.abs(angles).max() < 1e-10


def test_the_arrows_of_a_state_are_those_of_its_sample(primitive):
    dmp = under(primitive, (ns.Blade(reference_point=(0.01, 0.0, 0.0)),))
    motion = dmp.rollout()
    shown = track(motion, *dmp.constraints)
    state = dmp.initial_state()
    for _ in range(150):
        state = dmp.step(state, motion.period)
    drawn, known = shown.arrows_in(state, 1.0), shown.arrows(150, 1.0)
    assert list(drawn) == list(known) == ["lateral", "velocity", "force"]
    for name in drawn:
        assert drawn[name] == pytest.approx(known[name], abs=1e-9)


def test_a_reference_point_has_its_own_velocity(slipping):
    point = (0.03, 0.0, 0.01)
    shown = track(slipping, ns.Blade(reference_point=point))
    assert shown.points == pytest.approx(slipping.positions + slipping.rotations.apply(point))
    lateral = np.einsum("ij,ij->i", shown.velocities, shown.lateral_axes)
    assert np.abs(lateral) == pytest.approx(shown.violation, abs=1e-12)


def test_violations_agree_with_check(slipping):
    constraints = [ns.Blade(), ns.KeepOutSphere(center=(0.05, 0.0, 0.0), radius=0.01)]
    shown, report = track(slipping, *constraints), ns.check(slipping, constraints)
    assert shown.report == report
    assert shown.violation.max() == pytest.approx(max(c.peak for c in report.constraints))
    assert min(shown.margins["keep-out-sphere"]) == report["keep-out-sphere"].margin


def test_without_constraints_there_is_nothing_to_tell(cut):
    shown = track(cut)
    assert shown.report is None and shown.slip_angle(100) is None
    assert not shown.violation.any()
    assert set(shown.arrows(100, 1.0)) == {"velocity"}
    assert curves(shown) == {}


def test_forces_are_drawn_against_the_accelerations_of_the_motion(primitive):
    # Without its learned orientation the coupling term has much to do.
    motion = primitive.rollout(goal_position=primitive.goal_position + [0.0, 0.02, 0.0])
    shown = track(motion, *primitive.constraints)
    k = int(np.argmax(np.linalg.norm(motion.constraint_forces[:, :3], axis=1)))
    arrow = np.diff(shown.arrows(k, 1.0)["force"], axis=0)[0]
    force = motion.constraint_forces[k, :3]
    assert np.cross(arrow, force) == pytest.approx(np.zeros(3), abs=1e-12)
    assert 0 < np.linalg.norm(arrow) < 0.5


@given(time=st.floats(0, 10))
def test_the_sample_shown_is_the_last_one_before_the_time(cut, time):
    shown = track(cut[40:])
    k = shown.sample(time)
    assert shown.clock[k] <= time + 1e-9
    assert k == len(shown.motion) - 1 or shown.clock[k + 1] > time


def test_trails_are_thinned_out_but_keep_their_worst_moment(slipping):
    fine = slipping.resampled(rate=1000)
    shown = track(fine, ns.Blade())
    worst = float(shown.violation.max())
    segments, colors = shown.trail(worst)
    assert len(segments) == MOST_SEGMENTS and colors.shape == segments.shape
    assert segments[0, 0] == pytest.approx(fine.positions[0])
    assert segments[-1, 1] == pytest.approx(fine.positions[-1])
    assert segments[1:, 0] == pytest.approx(segments[:-1, 1])
    assert (colors[:, 0] == SLIP_COLORS[-1]).all(axis=1).any()


def test_colors_go_from_none_to_the_worst():
    colors = slip_colors(np.array([0.0, 0.5, 1.0, 7.0]), 1.0)
    assert colors.tolist() == [list(SLIP_COLORS[i]) for i in (0, 1, 2, 2)]


def test_charts_are_short_and_keep_their_peaks(primitive, slipping):
    shown = track(slipping.resampled(rate=1000), *primitive.constraints)
    charts = curves(shown)
    assert list(charts) == ["residual", "margin"]
    assert all(len(chart["t"]) == CHART_POINTS for chart in charts.values())
    assert charts["residual"]["blade (m/s)"].max() == pytest.approx(
        np.log10(shown.sizes["blade"].max())
    )
    least = charts["margin"]["keep-out-sphere (mm)"].min()
    assert least == pytest.approx(1e3 * shown.margins["keep-out-sphere"].min())
    assert "force" in curves(track(primitive.rollout(), *primitive.constraints))


@given(time=st.floats(-1, 5))
def test_the_cursor_is_an_upright_line_that_bends_no_curve(time):
    t = np.linspace(0, 4, 30)
    times, curve, line = cursor({"t": t, "a": 3 * t + 1}, time, -2.0, 9.0)
    assert (np.diff(times) >= 0).all()
    assert curve == pytest.approx(3 * times + 1)
    drawn = np.flatnonzero(np.isfinite(line))
    assert line[drawn].tolist() == [-2.0, 9.0]
    assert times[drawn] == pytest.approx(np.clip(time, 0, 4))


def test_a_tool_that_only_turns_is_shown_at_a_size():
    still = ns.PoseTrajectory([0.0, 1.0], np.zeros((2, 3)), Rotation.identity(2))
    assert extent([still])[1] == 0.1


def test_names_of_nodes_are_plain_and_different():
    assert node_name("runs/a b.csv", {}) == "a_b.csv"
    assert node_name("other/a b.csv", {"a_b.csv": 1}) == "a_b.csv_2"
    assert node_name("//", {}) == "motion"


# ---------------------------------------------------------------- shapes

ROUND = [
    ns.constraints.SphereContact(center=(0.1, 0.2, 0.3), radius=0.07),
    ns.constraints.CylinderContact(point=(0.1, 0.0, 0.0), axis=(1.0, 2.0, -1.0), radius=0.04),
    ns.KeepOutSphere(center=(0.0, 0.1, 0.0), radius=0.02),
    ns.constraints.KeepOutCapsule(start=(0.1, 0.0, 0.0), end=(0.0, 0.2, 0.1), radius=0.03),
    ns.constraints.KeepOutCapsule(start=(0.1, 0.0, 0.0), end=(0.1, 0.0, 0.0), radius=0.03),
]
FLAT = [
    ns.constraints.PlaneContact(point=(0.0, 0.0, 0.1), normal=(1.0, -2.0, 0.5)),
    ns.constraints.HalfSpace(point=(0.2, 0.0, 0.0), normal=(0.0, 3.0, 0.1)),
    ns.DepthLimit(depth=0.02, surface_point=(0.0, 0.0, 0.05), normal=(0.1, 0.0, 2.0)),
    ns.constraints.SurfaceContact(surface="z - 0.3*x**2 - 0.1*sin(9*y)"),
]


def residual_at(constraint: ns.Constraint, points: np.ndarray, time: float = 0.0) -> np.ndarray:
    """The constraint's own residual with the tool's origin at a point: what the shape must show."""
    p = ca.SX.sym("p", 3)
    motion = Instant(ca.SX(time), p, ca.SX.eye(3), ca.SX.zeros(3), ca.SX.zeros(3))
    function = ca.Function("residual", [p], [ca.vertcat(ca.SX(constraint.residual(motion)))])
    return np.array(function(points.T)).T


def only(constraint: ns.Constraint, size: float = 0.2) -> Shape:
    (shape,) = shapes([constraint], (0.05, 0.1, 0.02), size)
    return shape


@pytest.mark.parametrize("yaw", [0.0, 0.5])
def test_a_field_is_drawn_where_its_margin_is_zero(yaw):
    grid = np.zeros((14, 12, 10), dtype=bool)
    grid[3:7, 4:9, 3:6] = grid[3:10, 4:6, 3:6] = True
    solid = ns.constraints.DistanceField.from_grid(grid, 0.02, (0.1, 0.0, 0.3), yaw=yaw)
    flat = ns.constraints.DistanceField.from_grid(grid[:, :, 4], 0.02, yaw=yaw)
    for field in (solid, flat):
        rule = ns.constraints.KeepOut(field, clearance=0.003)
        shape = only(rule)
        assert residual_at(rule, shape.vertices)[:, 0] == pytest.approx(0, abs=1e-4)
        # Each edge has a face on both sides; of walls those above and below have one.
        edges = np.sort(np.stack([shape.faces, np.roll(shape.faces, -1, axis=1)], axis=2), axis=2)
        counts = np.unique(edges.reshape(-1, 2), axis=0, return_counts=True)[1]
        assert set(counts) == ({2} if field is solid else {1, 2})
    nothing = ns.constraints.DistanceField(np.ones((4, 4)), 0.1)
    assert shapes([ns.constraints.KeepOut(nothing)], (0, 0, 0), 1.0) == []


@pytest.mark.parametrize("constraint", ROUND + FLAT, ids=lambda c: c.name)
def test_shapes_lie_where_the_residual_is_zero(constraint):
    shape = only(constraint)
    corners = np.unique(shape.faces)
    residuals = residual_at(constraint, shape.vertices[corners])
    # trimesh rounds the corners that it makes to single precision in places.
    assert np.abs(residuals).max() < 1e-7
    assert len(shape.faces) >= 2


def test_the_middle_of_triangles_lies_near_the_surface_too():
    for constraint in ROUND:
        shape = only(constraint)
        middles = shape.vertices[shape.faces].mean(axis=1)
        assert np.abs(residual_at(constraint, middles)).max() < 0.02 * constraint.radius


def test_a_box_shows_the_sides_that_it_has():
    box = ns.constraints.Box(lower=(0.0, None, -0.1), upper=(0.2, None, None))
    shape = only(box)
    triangles = shape.vertices[shape.faces]
    assert len(triangles) == 6
    least = residual_at(box, triangles.reshape(-1, 3)).min(axis=1)
    assert least == pytest.approx(np.zeros(18), abs=1e-12)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    assert sorted(np.argmax(np.abs(normals), axis=1)) == [0, 0, 0, 0, 2, 2]
    # Two triangles cover a side, neither covers it twice.
    areas = np.linalg.norm(normals, axis=1) / 2
    assert areas[:2] == pytest.approx([areas[0]] * 2)


def test_what_has_no_place_is_not_drawn():
    constraints = [ns.Blade(), ns.SpeedLimit()]
    assert shapes(constraints, np.zeros(3), 0.1) == []
    assert shapes([ns.constraints.SurfaceContact(surface="1 + x**2")], np.zeros(3), 0.1) == []


# ---------------------------------------------------------------- what moves

BREATH = {
    "amplitude": (0.002, 0.0, 0.01),
    "period": 3.0,
    "phase": 0.4,
    "rotation_amplitude": (0.2, 0.0, 0.1),
    "velocity": (0.0, 0.01, 0.0),
}
CONVEYOR = {"amplitude": (0.0, 0.0, 0.0), "velocity": (0.03, 0.0, 0.0)}


def test_the_frame_sways_as_it_is_declared():
    origin, turn = Frame(ns.constraints.InMovingFrame(ns.Blade(), **BREATH)).pose(1.1)
    sway = np.sin(2 * np.pi / 3.0 * 1.1 + 0.4)
    assert origin == pytest.approx([0.002 * sway, 0.01 * 1.1, 0.01 * sway])
    assert turn.as_rotvec() == pytest.approx([0.2 * sway, 0.0, 0.1 * sway])


def test_frames_nest_and_carry_points_along():
    nested = ns.constraints.InMovingFrame(
        ns.constraints.InMovingFrame(ns.Blade(), **BREATH), **CONVEYOR
    )
    frame = Frame(nested)
    assert isinstance(frame.inner, ns.Blade)
    alone, _ = Frame(ns.constraints.InMovingFrame(ns.Blade(), **BREATH)).pose(2.0)
    origin, turn = frame.pose(2.0)
    assert origin == pytest.approx(alone + [0.06, 0.0, 0.0])
    point, h = np.array([0.3, -0.1, 0.2]), 1e-5
    own = turn.inv().apply(point - origin)
    before, after = (np.add(f[0], f[1].apply(own)) for f in (frame.pose(2 - h), frame.pose(2 + h)))
    # Seen from there, what is at rest in the world moves the other way.
    seen = edge_motion(nested, [2.0], point, Rotation.identity()).world_velocities[0]
    assert -seen == pytest.approx((after - before) / (2 * h), abs=1e-8)


def carried(motion: ns.PoseTrajectory, frame: Frame) -> ns.PoseTrajectory:
    """The motion as it is seen from the world when its own world moves."""
    poses = [frame.pose(t) for t in motion.times]
    turns = Rotation.concatenate([turn for _, turn in poses])
    places = np.array([origin for origin, _ in poses]) + turns.apply(motion.positions)
    return ns.PoseTrajectory(motion.times, places, turns * motion.rotations)


@pytest.mark.parametrize("point", [(0.0, 0.0, 0.0), (0.02, 0.0, 0.01)])
def test_slip_in_a_moving_frame_is_slip_relative_to_it(slipping, point):
    blade = ns.Blade(reference_point=point)
    rule = ns.constraints.InMovingFrame(blade, **BREATH)
    still = track(slipping, blade)
    shown = track(carried(slipping, Frame(rule)), rule)
    for sample in (50, 200, 333):
        lateral, velocity = (
            np.diff(shown.arrows(sample, 1.0)[a], axis=0)[0] for a in ("lateral", "velocity")
        )
        cosine = lateral @ velocity / np.linalg.norm(lateral) / np.linalg.norm(velocity)
        assert np.arcsin(cosine) == pytest.approx(shown.slip_angle(sample), abs=1e-12)
        # Chords of the sum are not sums of the chords.
        assert shown.slip_angle(sample) == pytest.approx(still.slip_angle(sample), abs=0.01)
        speed = np.linalg.norm(shown.velocities[sample])
        assert abs(cosine) * speed == pytest.approx(shown.violation[sample], rel=1e-9)
    assert "speed in the moving frame" in shown.readout(1.0)
    # In the room, the same motion slips otherwise.
    room = track(shown.motion, blade)
    angles = [abs(room.slip_angle(k) - shown.slip_angle(k)) for k in (50, 200, 333)]
    assert max(angles) > 0.02


def test_the_arrows_of_a_state_are_relative_to_the_moving_frame_too(cut):
    rule = ns.constraints.InMovingFrame("blade", amplitude=(0.0, 0.003, 0.004), period=4.0)
    dmp = ns.learn(cut, rule, basis_functions=30)
    motion = dmp.rollout()
    shown = track(motion, rule)
    state = dmp.initial_state()
    for _ in range(150):
        state = dmp.step(state, motion.period)
    drawn, known = shown.arrows_in(state, 1.0), shown.arrows(150, 1.0)
    for name in ("lateral", "velocity"):
        assert drawn[name] == pytest.approx(known[name], abs=1e-9)
    lateral, velocity = (np.diff(drawn[name], axis=0)[0] for name in ("lateral", "velocity"))
    assert lateral @ velocity == pytest.approx(0.0, abs=1e-10)


def test_an_arrow_beside_the_motion_is_no_longer_than_the_picture(primitive):
    shown = track(primitive.rollout(), *primitive.constraints)
    state = primitive.initial_state()
    for times, length in ((0.1, 0.1), (1e6, LONGEST)):
        velocity = times * shown.peak_speed * np.array([0.6, 0.0, 0.8])
        drawn = shown.arrows_in(replace(state, linear_velocity=velocity), 1.0)["velocity"]
        assert drawn[1] - drawn[0] == pytest.approx(length * ARROW * np.array([0.6, 0.0, 0.8]))


@pytest.mark.parametrize("time", [0.0, 1.3])
@pytest.mark.parametrize("inner", [*ROUND[:3], *FLAT[:3]], ids=lambda c: c.name)
def test_shapes_move_with_their_frame(inner, time):
    rule = ns.constraints.InMovingFrame(inner, **BREATH)
    shape, axes = shapes([rule], (0.05, 0.1, 0.02), 0.2)
    origin, turn = shape.pose(time)
    points = origin + turn.apply(shape.vertices[np.unique(shape.faces)])
    assert np.abs(residual_at(rule, points, time)).max() < 1e-7
    assert axes.kind == "frame" and axes.pose(time)[0] == pytest.approx(origin)


def test_a_frame_without_a_surface_shows_its_axes_beside_the_path():
    (axes,) = shapes([ns.constraints.InMovingFrame(ns.Blade(), **BREATH)], (0.05, 0.1, 0.02), 0.2)
    origin, turn = axes.pose(0.0)
    points = origin + turn.apply(axes.vertices)
    assert np.linalg.norm(points - [0.05, 0.1, 0.02], axis=1).max() < 0.1 * 0.2


# ---------------------------------------------------------------- the tool


@pytest.mark.parametrize("edge", ["x", "-x", "z"])
def test_the_scalpel_is_flat_across_and_its_tip_is_the_origin(edge):
    lateral = "y"
    for part in scalpel(0.1, Edge(edge, lateral)):
        assert np.abs(part.vertices[:, 1]).max() < 0.03 * 0.1
        assert part.vertices[:, 1].sum() == pytest.approx(0.0, abs=1e-12)
    blade = scalpel(0.1, Edge(edge, lateral))[0].vertices
    assert np.linalg.norm(blade, axis=1).min() < 1e-3 * 0.1
    ahead = {"x": blade[:, 0], "-x": -blade[:, 0], "z": blade[:, 2]}[edge]
    assert ahead.max() > 2 * -ahead.min()


def test_the_scalpel_of_directions_is_that_of_a_turned_tool():
    turn = Rotation.from_rotvec([0.3, -0.5, 0.8])
    turned = Edge(turn.apply([1, 0, 0]), turn.apply([0, 1, 0]))
    for plain, part in zip(scalpel(0.1), scalpel(0.1, turned), strict=True):
        np.testing.assert_allclose(part.vertices, turn.apply(plain.vertices), atol=1e-15)


def test_the_scalpel_is_closed():
    trimesh = pytest.importorskip("trimesh")
    for part in scalpel(0.1):
        made = trimesh.Trimesh(part.vertices, part.faces)
        assert made.is_watertight and made.is_winding_consistent
        # Seen from inside, it would be lit wrongly.
        assert made.volume > 0


def test_a_flipped_scalpel_has_its_handle_below():
    up, down = (scalpel(0.1, flip=flip)[1].vertices[:, 2].mean() for flip in (False, True))
    assert up > 0.03 and down == pytest.approx(-up)


@pytest.mark.parametrize("suffix", [".stl", ".obj", ".glb"])
def test_a_tool_is_read_from_a_file(tmp_path, suffix):
    trimesh = pytest.importorskip("trimesh")
    file = tmp_path / f"tool{suffix}"
    trimesh.creation.box((10, 20, 30)).export(file)
    (part,) = load_tool(file, scale=1e-3)
    assert np.ptp(part.vertices, axis=0) == pytest.approx([0.01, 0.02, 0.03])
    assert len(part.faces) == 12


def test_a_tool_that_is_none_is_refused_in_one_line(tmp_path):
    (tmp_path / "broken.stl").write_bytes(b"solid of nothing")
    (tmp_path / "empty.obj").write_text("v 0 0 0\n")
    (tmp_path / "tool.step").write_text("")
    for name, expected in {
        "broken.stl": "broken.stl",
        "empty.obj": "holds no triangles",
        "tool.step": "a tool is a mesh in .stl, .obj, .glb",
        "missing.stl": "no such file",
    }.items():
        assert re.search(expected, refusal(ns.errors.InputError, load_tool, tmp_path / name))
