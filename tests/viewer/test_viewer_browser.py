"""The page in a browser: Chromium, headless, drawn in software.

Pictures go to the folder that NOSLIP_ARTIFACTS names, else to the tests' temporary folder.
"""

from __future__ import annotations

import contextlib
import io
import os
import shutil
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from waiting import PATIENCE, until

pytest.importorskip("viser", reason="the viewer needs viser (extra: viewer)")
pytest.importorskip("playwright", reason="browser tests need playwright (extra: dev)")

from matplotlib.image import imread
from playwright.sync_api import sync_playwright

from noslip.viewer import Page, read_simulation, save_page
from noslip.viewer.found import LENGTH
from noslip.viewer.handles import GIZMO

CHROMIUM = os.environ.get("NOSLIP_CHROMIUM") or shutil.which("chromium")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        CHROMIUM is None, reason="no Chromium found; name it with NOSLIP_CHROMIUM=/path/to/chromium"
    ),
]
ARGUMENTS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
]
WIDTH, HEIGHT = 1100, 620
SHARPNESS = 0.5
"""Pixels drawn per pixel of the scene's picture, in either direction: fewer are faster."""
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
        yield tab, page
        assert tab.errors == []
    finally:
        tab.context.close()
        page.stop()


def drag(tab: Tab, page: Page, grip: np.ndarray, there: np.ndarray) -> None:
    """Press the mouse on a gizmo's arrow, and move it; it stays pressed."""
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
    assert tab.errors == []
    assert all(url.startswith(("file:", "blob:", "data:")) for url in tab.asked)
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
    assert "log₁₀ of the residual" in text and "constraint force" in text
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
    # The gizmo's first arrow, which is the tool's x axis at the goal.
    axis = primitive.goal_rotation.apply([1.0, 0.0, 0.0])
    goal = primitive.goal_position
    handle = np.array(page.goals.handles["goal"].gizmo.position)
    grip = handle + 0.95 * GIZMO * page.drawing.size * axis
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
    tab.view.get_by_role("button", name="As learned").click()
    until(lambda: page.entry.wish.goal.position is None, "the motion as learned")


def test_a_pushed_tool_comes_back(tab, page, artifacts):
    open_tab(tab, "Change")
    choose(tab, "Speed", "0.5x")
    tab.view.get_by_role("button", name="Run in the control loop").click()
    until(lambda: page.pushes.run is not None and page.pushes.run.clock > 1.2, "the tool to run")
    tab.view.get_by_role("button", name="Push now").click()
    run = page.pushes.run
    assert run is not None
    until(lambda: run.off(page.entry.track.motion.positions) > 1e-3, "the push")
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
