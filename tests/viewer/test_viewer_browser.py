"""The page in a browser: Chromium, headless, drawn in software.

Pictures go to the folder that NOSLIP_ARTIFACTS names, else to the tests' temporary folder.
"""

from __future__ import annotations

import contextlib
import io
import os
import time
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import parse_qsl, urlsplit

import numpy as np
import pytest
from scipy.spatial import ConvexHull

import noslip as ns
from browser import ARGUMENTS, CHROMIUM, NEEDS_CHROMIUM
from kinds import joint_cut
from waiting import PATIENCE, until

pytest.importorskip("viser", reason="the viewer needs viser (extra: viewer)")
pytest.importorskip("playwright", reason="browser tests need playwright (extra: dev)")

from matplotlib.image import imread
from playwright.sync_api import sync_playwright

from noslip.viewer import Page, read_simulation, save_page
from noslip.viewer.entries import extent
from noslip.viewer.found import LENGTH
from noslip.viewer.handles import GIZMO, TURNING
from noslip.viewer.tool import HANDLE

pytestmark = NEEDS_CHROMIUM
WIDTH, HEIGHT = 1100, 620
SHARPNESS = 0.5
"""Pixels drawn per pixel of the scene's picture, in either direction: fewer are faster."""
CALM = """
window.requestAnimationFrame = draw => setTimeout(() => draw(performance.now()), 150);
window.cancelAnimationFrame = clearTimeout;
"""
"""Some pictures a second: drawn in software, as many as there can be take a processor each."""
EXACT = 1e-10


@pytest.fixture(scope="module")
def chromium() -> Iterator[object]:
    with sync_playwright() as p:
        browser = p.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def artifacts(tmp_path_factory) -> Path:
    named = os.environ.get("NOSLIP_ARTIFACTS")
    folder = Path(named) if named else tmp_path_factory.mktemp("pictures")
    folder.mkdir(parents=True, exist_ok=True)
    return folder


@pytest.fixture(scope="module")
def page(primitive, slipping) -> Iterator[Page]:
    page = Page({"cut.json": primitive, "slipping.csv": slipping}, port=0)
    yield page
    page.stop()


class Tab:
    """A browser's tab, and the errors it met."""

    def __init__(
        self,
        browser,
        *,
        width: int = WIDTH,
        height: int = HEIGHT,
        sharpness: float = SHARPNESS,
        offline: bool = False,
    ) -> None:
        self.context = browser.new_context(
            viewport={"width": width, "height": height}, offline=offline
        )
        self.context.add_init_script(CALM)
        self.sharpness = sharpness
        self.view = self.context.new_page()
        self.view.set_default_timeout(1e3 * PATIENCE)
        self.errors: list[str] = []
        self.asked: list[str] = []
        self.view.on("pageerror", lambda error: self.errors.append(str(error)))
        self.view.on("console", self._note)
        self.view.on("request", lambda request: self.asked.append(request.url))

    def open(self, address: str) -> None:
        """Go there."""
        self.view.goto(f"{address}?fixedDpr={self.sharpness}")

    def _note(self, message) -> None:
        if message.type == "error":
            self.errors.append(message.text)


@pytest.fixture(scope="module")
def tab(chromium, page) -> Iterator[Tab]:
    tab = Tab(chromium)
    tab.open(f"{page.address}/")
    tab.view.get_by_text("slip angle").wait_for()
    settle(page)
    yield tab
    tab.context.close()


def fill(tab: Tab, label: str, text: str, component: int = 0) -> None:
    """Type into one of the numbers beside a label, as a person would."""
    row = tab.view.get_by_text(label, exact=True).locator("xpath=ancestor::div[.//input][1]")
    field = row.locator("input:not([type=hidden])").nth(component)
    field.fill(text)
    field.press("Enter")


def choose(tab: Tab, label: str, option: str) -> None:
    row = tab.view.get_by_text(label, exact=True).locator("xpath=ancestor::div[.//input][1]")
    row.locator("input:not([type=hidden])").click()
    tab.view.get_by_role("option", name=option, exact=True).click()


def placed(page: Page) -> bool:
    """Whether the page's camera has come to where a window of its size has it first."""
    clients = list(page.server.get_clients().values())
    if not clients:
        return False
    camera = clients[0].camera
    place, look_at = page.drawing.first_camera(camera.aspect, camera.image_width)
    return np.allclose([camera.position, camera.look_at], [place, look_at], atol=1e-6)


def settle(page: Page) -> None:
    """Wait until the camera stays there: what is drawn later moves it once more."""

    def stays() -> bool:
        for _ in range(4):
            if not placed(page):
                return False
            time.sleep(0.25)
        return True

    until(stays, "the camera to come to its place")


def pixel(page: Page, point: np.ndarray) -> tuple[float, float]:
    """Where the browser's camera shows a point of the world."""
    (client,) = page.server.get_clients().values()
    camera = client.camera
    ahead = np.asarray(camera.look_at) - camera.position
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, camera.up_direction)
    right /= np.linalg.norm(right)
    offset = np.asarray(point) - camera.position
    half = np.tan(camera.fov / 2) * (offset @ ahead)
    x, y = offset @ right, offset @ np.cross(right, ahead)
    return WIDTH / 2 + x / half * HEIGHT / 2, HEIGHT / 2 - y / half * HEIGHT / 2


@contextlib.contextmanager
def alone(chromium, shown: dict) -> Iterator[tuple[Tab, Page]]:
    """A page of its own, in a tab of its own."""
    page, tab = Page(shown, port=0), Tab(chromium)
    try:
        tab.open(f"{page.address}/")
        settle(page)
        yield tab, page
        assert tab.errors == []
    finally:
        tab.context.close()
        page.stop()


def drag(tab: Tab, page: Page, grip: np.ndarray, there: np.ndarray) -> None:
    """Press the mouse on a gizmo's arrow or arc, and move it; it stays pressed."""
    mouse = tab.view.mouse
    mouse.move(*pixel(page, grip))
    time.sleep(1.0)
    mouse.down()
    time.sleep(0.5)
    mouse.move(*pixel(page, 0.5 * (grip + there)), steps=3)
    time.sleep(0.5)
    mouse.move(*pixel(page, there), steps=3)


def open_tab(tab: Tab, name: str) -> None:
    tab.view.get_by_role("tab", name=name).click()


def tool_position(page: Page, name: str = "cut.json") -> np.ndarray:
    return np.array(page.drawing._nodes[name]["tool"].position)


# ---------------------------------------------------------------- saved (first: alone, it is fast)


def test_a_saved_page_plays_from_disk_with_the_network_off(
    chromium, primitive, slipping, tmp_path, artifacts
):
    file = save_page(tmp_path / "scene.html", {"cut.json": primitive, "slipping.csv": slipping})
    tab = Tab(chromium, offline=True, sharpness=0.3)
    tab.open(file.as_uri())
    clock = tab.view.locator("input").first
    clock.wait_for()
    shown = set()
    until(lambda: shown.add(clock.input_value()) or len(shown) > 2, "the clock to go on")
    tab.view.keyboard.press("Space")
    pictures = []
    for instant in ("0.5", "2.5"):
        clock.fill(instant)
        time.sleep(1.5)
        pictures.append(tab.view.screenshot(path=artifacts / f"saved_{instant}.png"))
    assert clock.input_value() == "2.5"
    assert pictures[0] != pictures[1]
    assert "violated: blade" in tab.view.inner_text("body")
    # The cursor of a chart is at the time that is shown.
    line = tab.view.locator(".noslip line.now").first
    until(lambda: float(line.get_attribute("x1")) > 200, "the cursor to move")
    left, right, end = (float(line.get_attribute(f"data-{d}")) for d in ("left", "right", "end"))
    share = (float(line.get_attribute("x1")) - left) / (right - left)
    assert share == pytest.approx(2.5 / end, abs=0.01)
    assert tab.errors == []
    assert all(url.startswith(("file:", "blob:", "data:")) for url in tab.asked)
    tab.context.close()


def test_a_saved_page_leaves_a_phone_room_for_the_scene(chromium, slipping, tmp_path, artifacts):
    file = save_page(tmp_path / "scene.html", {"slipping.csv": slipping}, constraints=[ns.Blade()])
    tab = Tab(chromium, width=390, height=844, offline=True, sharpness=0.3)
    tab.open(file.as_uri())
    tab.view.locator("input").first.wait_for()
    tab.view.screenshot(path=artifacts / "saved_phone.png")
    box = tab.view.locator(".noslip").bounding_box()
    assert box["x"] >= 0 and box["x"] + box["width"] <= 390 and box["height"] < 844 / 4
    # The camera stands farther away than in a wide window, by the window's own shape.
    told = dict(parse_qsl(urlsplit(tab.view.url).query))
    place, look_at = (
        np.array([float(x) for x in told[f"initialCamera{what}"].split(",")])
        for what in ("Position", "LookAt")
    )
    _, size = extent([slipping])
    half = np.linalg.norm(place - look_at) * np.tan(np.radians(25)) * 390 / 844
    assert half > 0.7 * size
    tab.view.locator(".noslip summary").click()
    assert tab.view.locator(".noslip svg").first.is_visible()
    tab.context.close()


# ---------------------------------------------------------------- an arm (alone too)


def darkness(tab: Tab, page: Page, point: np.ndarray) -> float:
    """How dark the picture is where the camera shows a point: 0 is white."""
    image = imread(io.BytesIO(tab.view.screenshot()))[..., :3]
    x, y = pixel(page, point)
    around = image[round(y) - 2 : round(y) + 3, round(x) - 2 : round(x) + 3]
    return float(1 - around.mean())


def orange(tab: Tab, page: Page, point: np.ndarray) -> float:
    """How much more red than blue there is where the camera shows a point, or beside it."""
    image = imread(io.BytesIO(tab.view.screenshot()))
    x, y = pixel(page, point)
    around = image[round(y) - 5 : round(y) + 6, round(x) - 5 : round(x) + 6]
    return float((around[..., 0] - around[..., 2]).max())


def test_the_arm_of_a_simulation_is_drawn_where_it_is(chromium, arm_folder, artifacts):
    simulation = read_simulation(arm_folder)
    arm = simulation.arm
    with alone(chromium, {"arm": simulation}) as (tab, page):
        tab.view.get_by_text("Against the commanded motion").wait_for()
        # The tool's holder is the only dark thing in the scene.
        (holder,) = (k for k, part in enumerate(arm.parts) if max(part.color) < 100)
        places = []
        for instant in ("0.0", f"{page.duration:.3f}"):
            fill(tab, "Time (s)", instant)
            until(lambda instant=instant: page.time == float(instant), "the time that was typed")
            sample = page.entry.track.sample(page.time)
            middle = arm.poses(sample)[0][holder]
            places.append(arm.rotation.apply(middle) + arm.position)
            until(lambda: darkness(tab, page, places[-1]) > 0.6, "the holder to be drawn there")
            tab.view.screenshot(path=artifacts / f"arm_{instant}.png")
        assert darkness(tab, page, places[0]) < 0.6


# ---------------------------------------------------------------- what is drawn (alone too)


def picture(tab: Tab) -> np.ndarray:
    """The scene's pixels, shape (HEIGHT, WIDTH, 3), each from 0 to 1."""
    image = imread(io.BytesIO(tab.view.screenshot()))[..., :3]
    assert image.shape == (HEIGHT, WIDTH, 3)
    return image


def near(image: np.ndarray, x: float, y: float, reach: int = 3) -> np.ndarray:
    """Pixels about a place, shape (K, 3)."""
    return image[
        round(y) - reach : round(y) + reach + 1, round(x) - reach : round(x) + reach + 1
    ].reshape(-1, 3)


def dark(image: np.ndarray, x: np.ndarray, y: np.ndarray) -> float:
    """Share of pixels that are as dark as the tool's handle, and nothing else in the scene."""
    return float((image[y, x].max(axis=1) < 0.55).mean())


def on_screen(page: Page, points: np.ndarray) -> np.ndarray:
    return np.array([pixel(page, point) for point in points])


def covered(outline: np.ndarray, inset: float) -> np.ndarray:
    """Pixels that lie within a convex outline, shape (K, 2), as x and y; farther in than inset."""
    hull = ConvexHull(outline)
    grid = np.stack(np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT)), axis=-1).reshape(-1, 2)
    away = grid @ hull.equations[:, :2].T + hull.equations[:, 2]
    return grid[(away <= -inset).all(axis=1)]


def test_what_is_drawn_is_what_is_computed(chromium, slipping, artifacts):
    """Tool, path and obstacle, each where its own geometry is projected to, in its own colors."""
    ball = ns.KeepOutSphere(center=(0.06, -0.05, 0.0), radius=0.012)
    page = Page({"slipping.csv": slipping}, constraints=[ns.Blade(), ball], port=0)
    tab = Tab(chromium, sharpness=1.0)
    tab.open(f"{page.address}/")
    track = page.entry.track
    tab.view.get_by_text("slip angle").wait_for()
    settle(page)
    handles = []
    for instant in (0.8, 3.2):
        page.post("seek", lambda instant=instant: page._seek(instant))
        until(lambda instant=instant: page.time == instant, "the time")
        k = track.sample(instant)
        # The tool's handle: its corners, moved by the pose and projected by the camera.
        (handle,) = (p for p in page.drawing.tool if p.color == HANDLE)
        corners = slipping.positions[k] + slipping.rotations[k].apply(handle.vertices)
        handles.append(covered(on_screen(page, corners), 4))
        x, y = handles[-1].T
        assert len(x) > 200
        until(
            lambda x=x, y=y: dark(picture(tab), x, y) > 0.95,
            "the handle to be dark where it must be",
        )
    image = picture(tab)
    tab.view.screenshot(path=artifacts / "computed.png")
    # Where it was before is nothing of it now.
    x, y = handles[0].T
    assert dark(image, x, y) < 0.1

    # The path has the colors of its violations, in front of a grid that is gray.
    segments, colors = track.trail(page._worst)
    tool = on_screen(page, slipping.positions[k] + slipping.rotations[k].apply(
        np.concatenate([p.vertices for p in page.drawing.tool])
    ))  # fmt: skip
    low, high = tool.min(axis=0) - 8, tool.max(axis=0) + 8
    matched = []
    for number in range(10, len(segments) - 10, 12):
        x, y = pixel(page, segments[number].mean(axis=0))
        if ((low < [x, y]) & ([x, y] < high)).all():
            continue
        off = np.abs(near(image, x, y) - colors[number, 0] / 255).max(axis=1).min()
        # The picture's tone mapping brightens by up to 0.16; blue and orange are 0.8 apart.
        matched.append(off < 0.2)
    assert len(matched) > 15 and np.mean(matched) > 0.9
    # It slips most in the middle, and not at its ends: the colors differ.
    assert np.abs(colors[10, 0].astype(int) - colors[len(colors) // 2, 0]).max() > 100

    # The obstacle is a disc of vermillion, seen through, as large as its radius says.
    ahead = np.subtract(page.server.initial_camera.look_at, page.server.initial_camera.position)
    aside = np.cross(ahead, [0, 0, 1]) / np.linalg.norm(np.cross(ahead, [0, 0, 1]))
    center, redder = np.array(ball.center), []
    for share in (0.0, 0.8, -0.8, 1.3, -1.3):
        spot = near(image, *pixel(page, center + share * ball.radius * aside), 2)
        redder.append(float((spot[:, 0] - spot[:, 2]).mean()))
    assert min(redder[:3]) > 0.12 and max(redder[3:]) < 0.06
    assert tab.errors == []
    tab.context.close()
    page.stop()


def test_the_arm_of_joints_moves(chromium, artifacts):
    joints = joint_cut()
    page = Page({"joints.csv": joints}, constraints=[ns.Blade()], port=0)
    tab = Tab(chromium, sharpness=1.0)
    tab.open(f"{page.address}/")
    tab.view.get_by_text("slip angle").wait_for()
    settle(page)
    links = page.entry.follower
    for instant in (0.0, page.duration):
        page.post("seek", lambda instant=instant: page._seek(instant))
        until(lambda instant=instant: page.time == pytest.approx(instant), "the time")
        corners = links.corners[page.entry.track.sample(page.time)]
        # Of each of the three upper links the middle.
        for place in (corners[1:4] + corners[2:5]) / 2:
            x, y = pixel(page, place)
            assert 0 < x < WIDTH and 0 < y < HEIGHT
            until(
                lambda x=x, y=y: near(picture(tab), x, y).max(axis=1).min() < 0.5,
                "a link to be drawn there",
            )
    tab.view.screenshot(path=artifacts / "joints.png")
    assert tab.errors == []
    tab.context.close()
    page.stop()


def test_on_a_phone_the_scene_comes_first_and_the_panel_unfolds(chromium, cut, artifacts):
    page = Page({"cut.csv": cut}, constraints=[ns.Blade()], port=0)
    tab = Tab(chromium, width=390, height=844)
    tab.open(f"{page.address}/")
    bar = tab.view.get_by_text("noslip", exact=True)
    play = tab.view.get_by_role("button", name="Play")
    bar.wait_for()
    play.wait_for(state="hidden")
    until(lambda: page.server.get_clients(), "the page's camera")
    (client,) = page.server.get_clients().values()
    _, size = extent([cut])
    away = lambda: np.linalg.norm(np.subtract(client.camera.position, client.camera.look_at))  # noqa: E731
    # Half of the window's width, where the path is.
    until(
        lambda: away() * np.tan(np.radians(25)) * 390 / 844 > 0.7 * size, "the camera to step back"
    )
    tab.view.screenshot(path=artifacts / "phone_folded.png")
    bar.click()
    play.wait_for()
    assert tab.view.evaluate("document.documentElement.scrollWidth") <= 390
    tab.view.screenshot(path=artifacts / "phone_unfolded.png")
    assert tab.errors == []
    tab.context.close()
    page.stop()


# ---------------------------------------------------------------- what holds (alone too)


def test_what_holds_in_a_recording_is_told_and_drawn_on_its_tool(chromium, knife, artifacts):
    with alone(chromium, {"knife.csv": knife}) as (tab, page):
        open_tab(tab, "Hold")
        tab.view.get_by_text("What holds?", exact=True).click()
        tab.view.get_by_text("Orange: axes free of slip").wait_for()
        found = page.entry.found
        assert str(found).splitlines()[0] in tab.view.inner_text("body")
        for instant in ("1.0", "5.0"):
            fill(tab, "Time (s)", instant)
            until(lambda instant=instant: page.time == float(instant), "the time that was typed")
            position, rotation = page.drawing.tool_pose("knife.csv")
            row = found.rows[0]
            ends = row.point + np.outer([-0.9, 0.9], LENGTH * page.drawing.size * row.axis)
            for end in position + rotation.apply(ends):
                # Grid and trail are no redder than blue; a thin rod is pale at few pixels.
                until(lambda end=end: orange(tab, page, end) > 0.15, "an end of the axis")
            tab.view.screenshot(path=artifacts / f"found_{instant}.png")


def test_a_command_that_is_dragged_leads_the_shielded_tool(chromium, primitive, artifacts):
    with alone(chromium, {"cut.json": primitive}) as (tab, page):
        open_tab(tab, "Hold")
        tab.view.get_by_text("Drag a command", exact=True).click()
        tab.view.get_by_text("The command is").wait_for()
        run = page.shields.run
        before = np.array(run.state.position)
        axis = run.state.rotation.apply([1.0, 0.0, 0.0])
        grip = before + 0.95 * GIZMO * page.drawing.size * axis
        drag(tab, page, grip, grip + 0.02 * axis)
        until(lambda: (run.state.position - before) @ axis > 5e-3, "the tool to follow")
        tab.view.screenshot(path=artifacts / "shielded.png")
        tab.view.mouse.up()
        moved = np.array(page.shields.command.position) - before
        assert moved == pytest.approx(0.02 * axis, abs=6e-3)
        assert run.residual < EXACT
        tab.view.get_by_role("button", name="Reset").click()
        until(lambda: page.shields.run is not run, "the beginning")
        assert page.shields.command.position == pytest.approx(before, abs=1e-6)
        tab.view.get_by_text("Drag a command", exact=True).click()
        until(lambda: page.shields.run is None, "the end")


# ---------------------------------------------------------------- looking


def test_the_page_loads_without_errors(tab, page, artifacts):
    text = tab.view.inner_text("body")
    assert "blade: HOLDS" in text and "Against the demonstration" in text
    assert "residual, log₁₀ of m/s, m" in text and "constraint force, " in text
    # Nothing stands before it: no notice of the library that draws.
    assert tab.view.locator(".mantine-Notification-root").count() == 0
    assert tab.view.title() == "noslip"
    assert tab.view.locator("canvas").count() >= 3
    tab.view.screenshot(path=artifacts / "loaded.png")
    assert tab.errors == []
    # All of it comes from the server beside it.
    assert all(url.startswith((page.address, "blob:", "data:")) for url in tab.asked)


def test_the_slider_moves_the_tool(tab, page, artifacts):
    track = page.entries["cut.json"].track
    slider = tab.view.get_by_role("slider").first
    slider.focus()
    for _ in range(3):
        slider.press("PageUp")
    slider.press("Home")
    until(lambda: page.time == 0.0, "the time of the slider's beginning")
    fill(tab, "Time (s)", "2.5")
    until(lambda: page.time == 2.5, "the time that was typed")
    assert tool_position(page) == pytest.approx(track.motion.positions[track.sample(2.5)])
    tab.view.get_by_text(track.readout(2.5)["position"]).wait_for()
    tab.view.get_by_text(track.readout(2.5)["keep-out-sphere: margin"], exact=True).wait_for()
    tab.view.screenshot(path=artifacts / "slider.png")


def test_it_plays_and_pauses(tab, page):
    fill(tab, "Time (s)", "0.5")
    tab.view.get_by_role("button", name="Play").click()
    until(lambda: page.time > 1.0, "half a second to pass")
    tab.view.get_by_role("button", name="Pause").click()
    until(lambda: not page.playing, "the pause")
    stopped = page.time
    time.sleep(0.3)
    assert page.time == stopped


def test_another_motion_is_looked_at(tab, page, artifacts):
    choose(tab, "Motion", "slipping.csv")
    tab.view.get_by_text("blade: VIOLATED").wait_for()
    fill(tab, "Time (s)", "2.0")
    until(lambda: page.time == 2.0, "the time that was typed")
    tab.view.screenshot(path=artifacts / "slipping.png")
    choose(tab, "Motion", "cut.json")
    tab.view.get_by_text("blade: HOLDS").wait_for()


# ---------------------------------------------------------------- changing


def test_a_goal_that_is_typed_moves_the_path(tab, page, primitive, artifacts):
    open_tab(tab, "Change")
    goal = primitive.goal_position + [0.01, 0.0, 0.0]
    fill(tab, "Goal (m)", f"{goal[0]:.4f}")
    tab.view.get_by_text("residual below 1e-9").wait_for()
    motion = page.entry.track.motion
    assert np.linalg.norm(motion.positions[-1] - goal) < 1e-4
    assert np.abs(motion.constraint_residuals).max() < EXACT
    assert page.entry.outcome.residual < 1e-9
    tab.view.screenshot(path=artifacts / "goal.png")


def test_a_goal_off_the_plane_is_explained(tab, page, primitive):
    open_tab(tab, "Change")
    before = page.entry.track
    fill(tab, "Goal (m)", "0.02", component=2)
    tab.view.get_by_text("no such motion").wait_for()
    assert page.entry.track is before
    tab.view.get_by_role("button", name="As learned").click()
    tab.view.get_by_text("residual below 1e-9").wait_for()
    assert page.entry.track.motion.positions == pytest.approx(primitive.rollout().positions)


def test_a_goal_that_is_dragged_takes_the_path_along(tab, page, primitive, artifacts):
    open_tab(tab, "Change")
    # Tests of this file may run in any order: another may have moved the goal before.
    tab.view.get_by_role("button", name="As learned").click()
    until(lambda: page.entry.wish.goal.is_free, "the motion as learned")
    # The shaft of the first arrow, the tool's x axis at the goal.
    axis = primitive.goal_rotation.apply([1.0, 0.0, 0.0])
    goal = primitive.goal_position
    handle = np.array(page.goals.handles["goal"].gizmo.position)
    grip = handle + 0.6 * GIZMO * page.drawing.size * axis
    there = grip + 0.02 * axis
    drag(tab, page, grip, there)
    until(lambda: page.entry.wish.goal.position is not None, "the goal to be dragged")
    tab.view.screenshot(path=artifacts / "dragged.png")
    tab.view.mouse.up()
    until(lambda: len(page.entry.track.motion) > 300, "the motion at full resolution")
    moved = page.entry.wish.goal.position - goal
    assert moved == pytest.approx(0.02 * axis, abs=6e-3)
    assert np.cross(moved, axis) == pytest.approx(np.zeros(3), abs=1e-6)
    motion = page.entry.track.motion
    assert np.linalg.norm(motion.positions[-1] - page.entry.wish.goal.position) < 1e-4
    assert np.abs(motion.constraint_residuals).max() < EXACT
    # The middle of the arc about z, outside of the arrows.
    own, moved = page.entry.wish.goal.rotation or primitive.goal_rotation, page.entry.wish.goal
    radius = 0.65 * TURNING * GIZMO * page.drawing.size
    middle = np.array(page.goals.handles["goal"].gizmo.position)
    grip, there = (
        middle + radius * own.apply([np.cos(a), np.sin(a), 0.0]) for a in (0.25 * np.pi, 1.0)
    )
    drag(tab, page, grip, there)
    until(lambda: page.entry.wish.goal.rotation is not None, "the goal to be turned")
    tab.view.mouse.up()
    until(lambda: not page.playing and len(page.entry.track.motion) > 300, "the whole motion")
    wanted = page.entry.wish.goal
    turned = (own.inv() * wanted.rotation).as_rotvec()
    assert turned == pytest.approx([0.0, 0.0, 1.0 - 0.25 * np.pi], abs=0.08)
    assert wanted.position == pytest.approx(moved.position, abs=1e-9)
    tab.view.get_by_role("button", name="As learned").click()
    until(lambda: page.entry.wish.goal.position is None, "the motion as learned")


def test_a_pushed_tool_comes_back(tab, page, artifacts):
    open_tab(tab, "Change")
    # Slowly: a busy machine must have time to push before the motion ends.
    choose(tab, "Speed", "0.1x")
    tab.view.get_by_role("button", name="Run in the control loop").click()
    until(lambda: page.pushes.run is not None and page.pushes.run.clock > 0.2, "the tool to run")
    run = page.pushes.run
    assert run is not None
    tab.view.get_by_role("button", name="Push now").click()
    # Not where it is: between two looks it may have come back, and a plan may be there at once.
    until(lambda: run._let_go > 0, "the push")
    tab.view.screenshot(path=artifacts / "pushed.png")
    choose(tab, "Speed", "4x")
    tab.view.get_by_text("arrived").wait_for()
    choose(tab, "Speed", "1x")
    assert run.goal_error < 2e-3 and run.residual < EXACT


def test_a_tool_that_is_dragged_while_it_runs_is_pushed(tab, page, artifacts):
    open_tab(tab, "Change")
    choose(tab, "Speed", "0.1x")
    tab.view.get_by_role("button", name="Run in the control loop").click()
    until(lambda: page.pushes.run is not None and page.pushes.run.clock > 0.2, "the tool to run")
    run = page.pushes.run
    # It hardly moves between two pictures; the grip's first arrow lies along the tool's x axis.
    tool = run.states[-1]
    axis = tool.rotation.apply([1.0, 0.0, 0.0])
    grip = tool.position + 0.95 * GIZMO * page.drawing.size * axis
    mouse = tab.view.mouse
    mouse.move(*pixel(page, grip))
    time.sleep(1.0)
    mouse.down()
    until(lambda: page.pushes.held, "the tool to be held")
    held = len(run.states)
    there = grip + 0.015 * axis
    mouse.move(*pixel(page, 0.5 * (grip + there)), steps=3)
    time.sleep(0.5)
    mouse.move(*pixel(page, there), steps=3)
    time.sleep(0.5)
    tab.view.screenshot(path=artifacts / "held.png")
    assert len(run.states) == held
    mouse.up()
    until(lambda: len(run.states) > held, "the tool to go on")
    moved = np.array(page.pushes.by.value)
    assert np.linalg.norm(moved) > 5e-3
    assert moved @ axis == pytest.approx(np.linalg.norm(moved), rel=0.1)
    choose(tab, "Speed", "4x")
    tab.view.get_by_text("arrived").wait_for()
    choose(tab, "Speed", "1x")
    assert run.residual < EXACT


# ---------------------------------------------------------------- files


def upload(tab: Tab, name: str, content: bytes) -> None:
    with tab.view.expect_file_chooser() as chooser:
        tab.view.get_by_role("button", name="Open CSV").click()
    chooser.value.set_files([{"name": name, "mimeType": "text/csv", "buffer": content}])


def test_an_uploaded_recording_is_checked(tab, page, cut, slipping, artifacts):
    open_tab(tab, "Check a file")
    upload(tab, "mine.csv", slipping.csv_text().encode())
    tab.view.get_by_text("blade: VIOLATED").locator("visible=true").wait_for()
    assert page.chosen == "mine.csv"
    tab.view.screenshot(path=artifacts / "uploaded.png")


def test_a_broken_file_gives_its_message_and_breaks_nothing(tab, page):
    # Tests of this file may run in any process, so each opens its tab.
    open_tab(tab, "Check a file")
    count, chosen = len(page.entries), page.chosen
    upload(tab, "broken.csv", b"t,x,y,z\n0,0,0,0\n")
    tab.view.get_by_text("broken.csv: ").wait_for()
    assert len(page.entries) == count and page.chosen == chosen
    fill(tab, "Time (s)", "1.5")
    until(lambda: page.time == 1.5, "the time that was typed")
    expected = page.entry.track.motion.positions[page.entry.track.sample(1.5)]
    assert tool_position(page, chosen) == pytest.approx(expected)
    assert tab.errors == []


def test_a_page_for_the_network_opens_with_its_token_alone(chromium, cut):
    page = Page({"cut.csv": cut}, host="0.0.0.0", port=0)
    address = page.address.replace("0.0.0.0", "127.0.0.1")
    tab = Tab(chromium)
    assert tab.view.goto(address.partition("?")[0]).status == 403
    tab.view.goto(address)
    # The panel comes over the page's own connection, which has the cookie alone.
    tab.view.get_by_role("button", name="Play").wait_for()
    tab.context.close()
    page.stop()
