"""What the viewer shows of joints, two tools, rhythms, vehicles and vectors; and what it prints."""

from __future__ import annotations

import re
from collections.abc import Iterator
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import noslip as ns
from kinds import ARM, joint_cut, reached, tools
from learned import under
from noslip.constraints import JointLimits, of, relative_to
from refusals import refusal

pytest.importorskip("viser", reason="the viewer needs viser (extra: viewer)")

from noslip.viewer import Page, save_page
from noslip.viewer.charts import curves
from noslip.viewer.entries import Entry, entries, suitable_tool
from noslip.viewer.handles import GIZMO, TURNING
from noslip.viewer.links import Links, carrier_of
from noslip.viewer.printed import HEIGHT, WIDTH, chart, ticks
from noslip.viewer.texts import field_step, plain
from noslip.viewer.tool import cart, rod, scalpel


def entry(shown: object, *constraints: ns.Constraint) -> Entry:
    (found,) = entries({"shown": shown}, constraints).values()
    return found


def arc(turn: float = 0.0) -> ns.PoseTrajectory:
    """A circle at constant speed, 2 degrees a step, the blade along the tangent but for a turn."""
    angle = np.radians(2.0) * np.arange(46)
    path = 0.1 * np.column_stack([np.sin(angle), 1 - np.cos(angle), 0 * angle])
    return ns.PoseTrajectory(0.01 * np.arange(46), path, Rotation.from_euler("z", angle + turn))


# ---------------------------------------------------------------- at t = 0


@pytest.mark.parametrize("turn", [0.0, 0.2])
def test_the_slip_angle_is_right_from_the_first_sample_on(turn):
    track = entry(arc(turn), ns.Blade()).track
    # A chord is parallel to the tangent in its middle, which no sample is: half a step is 1 degree.
    angles = [track.slip_angle(k) for k in (0, 1, 20, 45)]
    assert angles == pytest.approx([-turn] * 4, abs=1e-12)
    lateral, velocity = (
        np.diff(track.arrows(0, 1.0)[a], axis=0)[0] for a in ("lateral", "velocity")
    )
    sine = lateral @ velocity / np.linalg.norm(lateral) / np.linalg.norm(velocity)
    assert np.arcsin(sine) == pytest.approx(-turn, abs=1e-12)


def test_a_slip_angle_of_rounding_is_told_as_such():
    assert entry(arc(), ns.Blade()).track.readout(0.0)["slip angle"] == "below 0.001°"
    assert entry(arc(0.2), ns.Blade()).track.readout(0.0)["slip angle"] == "-11°"


# ---------------------------------------------------------------- kinds


def test_joints_are_checked_as_joints_and_drawn_as_their_tool():
    joints = joint_cut()
    limits = JointLimits(lower=(-3.0,) * 4, upper=(1.0,) * 4)
    shown = entry(joints, ns.Blade(), limits)
    track, report = shown.track, ns.check(joints, [ns.Blade(), limits])
    assert track.report == report
    assert track.violation.max() == pytest.approx(max(c.peak for c in report.constraints))
    assert track.margins["joint position limits"].min() == report["joint position limits"].margin
    assert track.motion.positions == pytest.approx(ARM.forward(joints.values)[0])
    # The tool's own slip, by closed form: its lateral axis and velocity in the middle of a step.
    assert np.degrees(np.abs([track.slip_angle(k) for k in range(20, 80)]).max()) > 1
    # A tool's pose has no joints that a shield could hold.
    assert shown.held == (ns.Blade(),)
    assert list(curves(track)) == ["residual", "margin"]


def test_the_links_of_an_arm_are_where_its_joints_are():
    joints = joint_cut()
    links = carrier_of(ARM, joints.values)
    assert isinstance(links, Links)
    headings = np.cumsum(joints.values, axis=1)
    lengths = (0.4, 0.3, 0.2, 0.1)
    steps = [
        length * np.column_stack([np.cos(a), np.sin(a), 0 * a])
        for length, a in zip(lengths, headings.T, strict=True)
    ]
    base = np.zeros((len(joints), 3))
    expected = np.cumsum([base, base, *steps], axis=0).transpose(1, 0, 2)
    assert links.corners == pytest.approx(expected, abs=1e-12)


def test_an_arm_of_this_library_is_drawn_as_it_is():
    pytest.importorskip("mujoco", reason="the extra robots is not installed")
    from noslip import robots
    from noslip.viewer import Arm

    robot = robots.panda()
    chain = robots.chain(robot)
    values = robot.home + 0.1 * np.arange(3)[:, None]
    arm = carrier_of(chain, values)
    assert isinstance(arm, Arm) and arm.joint_positions == pytest.approx(values)
    still = robots.chain(robot, joints=chain.joint_names[1:])
    assert isinstance(carrier_of(still, values[:, 1:]), Links)


def test_two_tools_are_drawn_and_the_one_that_is_ruled_is_told_of():
    both = tools()
    shown = entry(both, of(ns.Blade(), "holder")).track
    assert shown.motion is both["holder"] and list(shown.beside) == ["knife"]
    assert shown.report == ns.check(both, of(ns.Blade(), "holder"))
    knife = entry(both).track
    assert knife.motion is both["knife"] and list(knife.beside) == ["holder"]


def test_what_slips_relative_to_another_tool_has_that_tools_velocities():
    both = tools()
    rule = relative_to(ns.Blade(), "knife", "holder")
    shown, seen = entry(both, rule).track, entry(both["knife in holder"], ns.Blade()).track
    assert shown.motion is both["knife"]
    for k in (0, 20, 60):
        assert shown.slip_angle(k) == pytest.approx(seen.slip_angle(k), abs=1e-9)
        # The holder does not turn: its axes are the world's, turned once.
        turn = both["holder"].rotations[0]
        assert shown.velocities[k] == pytest.approx(turn.apply(seen.velocities[k]), abs=1e-9)


def test_vectors_without_a_place_are_refused_in_one_line():
    told = refusal(ns.errors.InputError, Page, {"grip.csv": reached(2)})
    assert told.startswith("grip.csv: moves q0, q1, which have no place in a scene")
    position = ns.Trajectory([0.0, 1.0], [[0, 0, 0], [0, 0, 0.1]], names=("x", "y", "z"))
    assert entry(position).track.motion.positions[-1] == pytest.approx([0, 0, 0.1])


def test_recordings_beside_joints_are_checked_against_what_can_be_said_of_them(slipping):
    limits = JointLimits((-3.0,) * 4, (6.0,) * 4)
    dmp = under(ns.learn(joint_cut(), basis_functions=20), (ns.Blade(), limits))
    found = entries({"arm": dmp, "slipping": slipping})
    assert [c.name for c in found["arm"].track.system.constraints] == [
        "blade",
        "joint position limits",
    ]
    assert [c.name for c in found["slipping"].track.system.constraints] == ["blade"]
    # Its goals are joints: nothing there can be dragged.
    assert found["arm"].primitive is None and "noslip adapt" in found["arm"].fixed


@pytest.fixture(scope="module")
def lap() -> Iterator[Page]:
    """A wheel that goes round for ever."""
    t = np.linspace(0, 6, 121)
    a = 2 * np.pi * t / 6
    path = np.column_stack([np.cos(a), 0.6 * np.sin(a), 0 * a])
    yaw = np.unwrap(np.arctan2(0.6 * np.cos(a), -np.sin(a)))
    driven = ns.PoseTrajectory(t, path, Rotation.from_euler("z", yaw), name="lap.csv")
    rhythm = ns.learn(driven, [ns.Wheel()], rhythmic=True, basis_functions=20)
    page = Page({"lap": rhythm}, port=0)
    yield page
    page.stop()


def test_a_rhythm_goes_round_without_a_jump(lap):
    motion = lap.entry.track.motion
    assert lap.duration == pytest.approx(6.0)
    assert motion.positions[-1] == pytest.approx(motion.positions[0], abs=1e-6)
    lap._seek(5.9)
    lap._advance(0.3)
    # 0.2 s into the next round, not at its beginning.
    assert lap.time == pytest.approx(0.2)
    assert not lap.goals.handles["goal"].visible and "goes round" in lap.goals.note.content


@pytest.mark.parametrize("aspect", [390 / 844, 0.8])
def test_an_upright_window_sees_the_whole_path_above_its_panel(lap, aspect):
    place, look_at = lap.drawing.upright_camera(aspect)
    ahead = (look_at - place) / np.linalg.norm(look_at - place)
    right = np.cross(ahead, [0, 0, 1]) / np.linalg.norm(np.cross(ahead, [0, 0, 1]))
    off = np.vstack([lap.drawing.middle, lap.entry.track.motion.positions]) - place
    half = np.tan(lap.server.initial_camera.fov / 2) * (off @ ahead)
    # From -1 to 1 within the window, to the right and upwards.
    x, y = off @ right / half / aspect, off @ np.cross(right, ahead) / half
    assert (x[0], y[0]) == pytest.approx((0, 2 * 0.18), abs=0.05)
    assert np.abs(x).max() < 0.9
    # Unfolded, the panel covers three fifths.
    assert y.min() > 1 - 2 * 2 / 5


def test_a_vehicle_is_a_cart(lap, cut):
    def widths(tool: list) -> list[float]:
        return [float(np.ptp(part.vertices[:, 1])) for part in tool]

    track = lap.entry.track
    vehicle = widths(cart(0.22, track.edge))
    assert widths(suitable_tool([track], 1.0)) == pytest.approx(vehicle)
    # Nobody said what it is, but no hand goes 2 m without rising or tilting.
    unruled = entry(track.motion).track
    assert widths(suitable_tool([unruled], 1.0)) == pytest.approx(vehicle)
    lifted = track.motion.positions + np.outer(np.sin(track.clock), [0, 0, 0.01])
    tilting = ns.PoseTrajectory(track.motion.times, lifted, track.motion.rotations)
    for other in (entry(tilting), entry(cut), entry(cut, ns.Blade())):
        assert widths(suitable_tool([other.track], 1.0)) == pytest.approx(widths(scalpel(0.45)))


@pytest.mark.parametrize("made", [cart(0.1), rod(0.1)], ids=["cart", "rod"])
def test_what_stands_for_a_body_is_closed_and_stands_on_its_origin(made):
    trimesh = pytest.importorskip("trimesh")
    for part in made:
        shell = trimesh.Trimesh(part.vertices, part.faces)
        assert shell.is_watertight and shell.volume > 0
    assert min(part.vertices[:, 2].min() for part in made) == pytest.approx(0.0, abs=0.011)


# ---------------------------------------------------------------- numbers


@given(
    value=st.floats(-1e3, 1e3),
    size=st.floats(1e-3, 1e3),
)
def test_no_field_shows_a_negative_zero(value, size):
    step = field_step(size)
    # Three digits of the scene's size, at least.
    assert 1e-4 * size <= step * (1 + 1e-6) and step <= 1e-3 * size * (1 + 1e-6)
    digits = max(0, round(-np.log10(step)))
    (told,) = plain([value], step)
    assert not re.fullmatch(r"-0(\.0*)?", f"{told:.{digits}f}")
    assert abs(told - value) <= max(step / 2, 1e-7)


@pytest.mark.parametrize("aspect, covered", [(1.77, 0.36), (1.0, 0.5), (2.4, 0.36)])
def test_a_wide_window_sees_both_handles_beside_the_panel(primitive, aspect, covered):
    page = Page({"cut.json": primitive}, port=0)
    try:
        drawing, camera = page.drawing, page.server.initial_camera
        place, look_at = drawing.wide_camera(aspect, covered)
        ahead = (look_at - place) / np.linalg.norm(look_at - place)
        right = np.cross(ahead, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        for handle in page.goals.handles.values():
            # What turns is the larger of the gizmos; viser draws its arcs at 0.65 of its size.
            around = 0.65 * TURNING * GIZMO * drawing.size * np.vstack([np.eye(3), -np.eye(3)])
            off = np.array(handle.gizmo.position) + around - place
            across = (off @ right) / (np.tan(camera.fov / 2) * aspect * (off @ ahead))
            # From -1 at the left edge to 1 at the right one.
            assert np.all((across > -1) & (across < 1 - 2 * covered)), across
    finally:
        page.stop()


def test_what_turns_lies_beyond_what_moves_and_takes_it_along(primitive):
    page = Page({"cut.json": primitive}, port=0)
    try:
        handle = page.goals.handles["goal"]
        assert handle.gizmo.disable_rotations and handle._turning.disable_axes
        assert 0.65 * handle._turning.scale > handle.gizmo.scale
        handle.position = primitive.goal_position + [0.01, 0.0, 0.0]
        assert np.array_equal(handle._turning.position, handle.gizmo.position)
        turn = Rotation.from_euler("z", 0.3) * primitive.goal_rotation
        handle.place(primitive.goal_position, turn)
        assert handle._turning.wxyz == pytest.approx(turn.as_quat(scalar_first=True))
        handle.visible = False
        assert not handle._turning.visible
    finally:
        page.stop()


def test_handles_stand_beside_the_tool_and_move_the_pose(primitive):
    page = Page({"cut.json": primitive}, port=0)
    try:
        for what in ("goal", "start"):
            handle = page.goals.handles[what]
            own = getattr(primitive, f"{what}_position")
            assert handle.position == pytest.approx(own, abs=1e-12)
            away = np.array(handle.gizmo.position) - page.entry.track.motion.positions
            assert np.linalg.norm(away, axis=1).min() > 0.2 * page.drawing.size
            handle.position = own + [0.01, 0.0, 0.0]
            page.goals._ask_for_handle(what, True)
            assert getattr(page.entry.wish, what).position == pytest.approx(own + [0.01, 0, 0])
    finally:
        page.stop()


@pytest.mark.parametrize("scale", [0.1, 10.0])
def test_the_push_that_is_offered_grows_with_the_motion(cut, scale):
    large = ns.PoseTrajectory(cut.times, scale * cut.positions, cut.rotations)
    page = Page({"cut": ns.learn(large, [ns.Blade()], basis_functions=20)}, port=0)
    try:
        size = float(np.linalg.norm(np.ptp(large.positions, axis=0)))
        push = np.array(page.pushes.by.value)
        assert np.linalg.norm(push) == pytest.approx(0.05 * size, rel=0.05)
        assert abs(push @ page.entry.track.lateral_axes[200]) > 0.9 * np.linalg.norm(push)
    finally:
        page.stop()


# ---------------------------------------------------------------- charts on a page that is saved


@given(low=st.floats(-1e4, 1e4), span=st.floats(1e-3, 1e5))
def test_ticks_are_round_and_within(low, span):
    found = ticks(low, low + span)
    assert 1 <= len(found) <= 9
    slack = 1e-6 * span
    assert (found >= low - slack).all() and (found <= low + span + slack).all()
    if len(found) > 1:
        step = np.diff(found).mean()
        assert np.diff(found) == pytest.approx(np.full(len(found) - 1, step), rel=1e-6)
        assert float(f"{step:e}".split("e")[0]) == pytest.approx(
            round(step / 10 ** np.floor(np.log10(step) + 1e-9)), rel=1e-6
        )


def test_a_printed_chart_shows_its_curve_where_its_numbers_say(slipping):
    track = entry(slipping, ns.Blade(), ns.KeepOutSphere((0.05, 0.0, 0.0), 0.01)).track
    charts = curves(track)
    assert list(charts) == ["residual", "margin"]
    for name, lines in charts.items():
        drawn = ElementTree.fromstring(chart(name, lines))
        texts = [(t.attrib, t.text) for t in drawn.iter("text")]
        assert "t (s)" in [text for _, text in texts]
        key = next(k for k in lines if k != "t")
        assert key in [text for _, text in texts] and re.search(r"\((m/s|mm)\)$", key)
        # Numbers beside the axes tell the scale; the curve must agree with them.
        upright = [(float(a["y"]) - 3, float(t)) for a, t in texts if a.get("text-anchor") == "end"]
        level = [
            (float(a["x"]), float(t))
            for a, t in texts
            if a.get("text-anchor") == "middle" and re.fullmatch(r"[\d.]+", t)
        ]
        (line,) = drawn.iter("polyline")
        points = np.array([p.split(",") for p in line.attrib["points"].split()], dtype=float)
        assert (points >= 0).all() and (points <= [WIDTH, HEIGHT]).all()
        times = np.polyval(np.polyfit(*np.array(level).T, 1), points[:, 0])
        values = np.polyval(np.polyfit(*np.array(upright).T, 1), points[:, 1])
        assert times == pytest.approx(lines["t"], abs=0.02)
        reach = np.ptp([value for _, value in upright])
        assert values == pytest.approx(lines[key], abs=0.02 * reach)


def test_a_saved_page_has_verdict_and_charts_of_each_motion(tmp_path, cut, slipping):
    shown = {"cut.csv": cut, "slipping.csv": slipping}
    text = save_page(tmp_path / "scene.html", shown, constraints=[ns.Blade()]).read_text()
    box = text[text.rindex('<div class="noslip">') :]
    assert box.count("<svg") == 2 and box.count('class="now"') == 2
    assert box.count("<details open>") == 1 and box.count("<details") == 2
    assert "<title>noslip</title>" in text
