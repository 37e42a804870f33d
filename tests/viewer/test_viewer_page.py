"""The page without a browser: what the server does, how fast, and what it survives."""

from __future__ import annotations

import contextlib
import html
import socket
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import noslip as ns
from waiting import PATIENCE, until

pytest.importorskip("viser", reason="the viewer needs viser (extra: viewer)")

from noslip.viewer import Page, found_panel, save_page
from noslip.viewer.drawing import _linear
from noslip.viewer.found_panel import SOUGHT
from noslip.viewer.shield_panel import MOST_STEPS_AT_ONCE, RATE, ShieldedRun

EXACT = 1e-10


@contextlib.contextmanager
def opened(shown: dict[str, object], **options: object) -> Iterator[Page]:
    page = Page(shown, port=0, **options)
    try:
        yield page
    finally:
        page.stop()


def done(page: Page, action: Callable[[], None] = lambda: None) -> None:
    """Have the page do something and wait until it did."""
    over = threading.Event()
    page.post("test", action)
    page.post("over", over.set)
    assert over.wait(PATIENCE)


def upload(page: Page, name: str, content: bytes) -> str:
    """Have a file read, and return what is told of it."""
    page._upload_note.content = ""
    page.uploads.take(name, content)
    until(lambda: page._upload_note.content, f"an answer for {name}")
    done(page)
    return page._upload_note.content


class Arm:
    """Stands for whatever follows a tool."""

    def __init__(self) -> None:
        self.node, self.shown = "", []

    def add(self, scene, node):
        self.node = node
        scene.add_frame(f"{node}/hand", axes_length=0.01, axes_radius=0.001)

    def show(self, motion, sample):
        self.shown.append((motion, sample))


def test_ten_demonstrations_of_1000_samples_stay_fluid(demonstrate):
    shown = {
        f"cut_{k}.csv": demonstrate(0.02 * k).resampled(times=np.linspace(0, 4, 1000))
        for k in range(10)
    }
    # Time that this process computes: others on the machine do not count.
    began = time.process_time()
    with opened(shown, constraints=[ns.Blade()]) as page:
        assert time.process_time() - began < 30
        taken = []
        for instant in np.linspace(0, 4, 40):
            began = time.thread_time()
            page._show_time(float(instant))
            taken.append(time.thread_time() - began)
        assert np.median(taken) < 0.05


def test_it_is_served_to_this_machine_alone(cut):
    with opened({"cut.csv": cut}) as page:
        assert page.address.startswith("http://127.0.0.1:")
        with urllib.request.urlopen(page.address, timeout=PATIENCE) as answer:
            assert b"<html" in answer.read()
        port = page.server.get_port()
        others = {i[4][0] for i in socket.getaddrinfo(socket.gethostname(), port)} - {"127.0.0.1"}
        for address in (a for a in others if not a.startswith(("127.", "::1"))):
            with pytest.raises(OSError):
                socket.create_connection((address, port), timeout=1).close()


def test_an_address_that_is_not_ours_is_refused(cut):
    with pytest.raises(ns.errors.InputError, match=r"nothing can be served at 203\.0\.113\.7"):
        Page({"cut.csv": cut}, host="203.0.113.7")


def test_there_must_be_something_to_show():
    with pytest.raises(ns.errors.InputError, match="needs a recording or a primitive"):
        Page({})


def test_recordings_are_checked_against_what_the_primitives_hold(primitive, slipping):
    with opened({"cut.json": primitive, "slipping.csv": slipping}) as page:
        assert page.chosen == "cut.json"
        reports = {name: entry.track.report for name, entry in page.entries.items()}
        assert reports["cut.json"].satisfied
        assert reports["slipping.csv"].verdict == "violated: blade"


def test_a_follower_is_told_where_the_tool_is(primitive):
    arm = Arm()
    with opened({"cut.json": primitive}, followers={"cut.json": arm}) as page:
        done(page, lambda: page._seek(2.0))
        motion, sample = arm.shown[-1]
        assert motion is page.entry.track.motion
        assert motion.times[sample] == pytest.approx(2.0, abs=motion.period)
        assert arm.node == "/motions/cut.json/follower"


def test_a_follower_of_nothing_is_refused(cut):
    with pytest.raises(ns.errors.InputError, match=r"no motion 'cut'; there are cut\.csv"):
        Page({"cut.csv": cut}, followers={"cut": Arm()})


def test_a_new_goal_changes_path_residual_and_duration(primitive):
    with opened({"cut.json": primitive}) as page:
        goal = primitive.goal_position + [0.01, 0.0, 0.0]

        def ask() -> None:
            page.goals.goal.value, page.goals.duration.value = tuple(goal), 6.0
            page.goals.ask_for_numbers()

        done(page, ask)
        motion = page.entry.track.motion
        assert np.linalg.norm(motion.positions[-1] - goal) < 1e-4
        assert np.abs(motion.constraint_residuals).max() < EXACT
        assert page.duration == pytest.approx(6.0, rel=1e-3)
        assert "residual below 1e-9" in page.goals.note.content
        done(page, lambda: page._seek(5.9))
        done(page, page.goals.undo)
        assert page.time == page.duration == pytest.approx(4.0)
        assert page.entry.track.motion.positions == pytest.approx(primitive.rollout().positions)


def test_what_cannot_be_done_is_told_and_the_motion_stays(primitive):
    with opened({"cut.json": primitive}) as page:
        before = page.entry.track

        def ask() -> None:
            page.goals.goal.value = tuple(primitive.goal_position + [0.0, 0.0, 0.01])
            page.goals.ask_for_numbers()

        done(page, ask)
        assert page.entry.track is before
        assert "no such motion" in page.goals.note.content
        assert "plane-contact" in page.goals.note.content


def test_a_fault_is_told_and_the_page_lives(cut, capsys):
    with opened({"cut.csv": cut}) as page:

        def fail() -> None:
            raise RuntimeError("of our own making")

        page.post("fail", fail)
        until(lambda: page._notice.visible, "the notice")
        assert "RuntimeError: of our own making" in page._notice.content
        done(page, lambda: page._seek(1.0))
        assert page.time == 1.0
        assert not page._notice.visible
    assert "of our own making" in capsys.readouterr().err


def test_of_what_is_asked_again_only_the_last_is_done(cut):
    with opened({"cut.csv": cut}) as page:
        begun, held, seen = threading.Event(), threading.Event(), []
        page.post("hold", lambda: begun.set() or held.wait(PATIENCE))
        assert begun.wait(PATIENCE)
        for k in range(20):
            page.post("drag", lambda k=k: seen.append(k))
        held.set()
        done(page)
        assert seen == [19]


def test_a_file_that_slips_more_changes_the_colors_of_all(demonstrate, primitive, slipping):
    with opened({"cut.json": primitive, "slipping.csv": slipping}) as page:
        before = page._legend.content
        worse = demonstrate(0.6, "worse.csv").csv_text().encode()
        upload(page, "worse.csv", worse)
        assert page.chosen == "worse.csv" and list(page.entries)[-1] == "worse.csv"
        assert page._legend.content != before
        colors = page.drawing._nodes["slipping.csv"]["trail"].colors
        assert (
            colors.tolist()
            == _linear(page.entries["slipping.csv"].track.trail(page._worst)[1]).tolist()
        )


def test_a_broken_file_is_told_and_changes_nothing(primitive):
    with opened({"cut.json": primitive}) as page:
        assert upload(page, "broken.csv", b"t,x\n0,0\n").count("broken.csv: ") == 1
        assert list(page.entries) == ["cut.json"]


def test_a_pushed_run_on_the_page_leaves_a_trail_until_something_changes(primitive):
    with opened({"cut.json": primitive}) as page:
        page._speed.value = "4x"
        done(page, page.pushes.start)
        done(page, page.pushes.push)
        until(lambda: page.pushes.run is None, "the end of the run")
        done(page)
        assert "arrived" in page.pushes.note.content and not page.playing
        assert "pushed" in page.drawing._nodes["cut.json"]
        done(page, page.goals.undo)
        assert "pushed" not in page.drawing._nodes["cut.json"]


def test_a_tool_that_is_held_waits_and_is_pushed_to_where_it_is_released(primitive):
    with opened({"cut.json": primitive}) as page:
        assert not page.pushes.grip.visible
        page._speed.value = "0.25x"
        done(page, page.pushes.start)
        run = page.pushes.run
        until(lambda: run.clock >= 0.3, "the tool to run")
        assert page.pushes.grip.visible and not page.goals.handles["goal"].visible
        done(page, lambda: page.pushes.pull(False))
        held = len(run.states)
        tool = run.states[-1].position
        time.sleep(0.3)
        assert len(run.states) == held
        assert page.pushes.grip.position == pytest.approx(tool)

        def release() -> None:
            page.pushes.grip.position = tool + [0.0, 0.006, 0.0]
            page.pushes.pull(True)

        done(page, release)
        assert page.pushes.by.value == pytest.approx((0.0, 0.006, 0.0), abs=1e-7)
        page._speed.value = "4x"
        until(lambda: page.pushes.run is None, "the end of the run")
        done(page)
        # The command goes to where the hand holds the tool.
        reached = np.array([state.position for state in run.states[held:]])
        assert np.linalg.norm(reached - (tool + [0.0, 0.006, 0.0]), axis=1).min() < 2e-3
        assert run.goal_error < 2e-3 and run.residual < EXACT
        assert not page.pushes.grip.visible and page.goals.handles["goal"].visible


def test_a_tool_that_does_not_run_cannot_be_pulled(primitive):
    with opened({"cut.json": primitive}) as page:
        done(page, lambda: page.pushes.pull(True))
        assert page.pushes.run is None and not page._notice.visible


def test_what_moves_is_drawn_where_it_is(cut):
    moving = ns.constraints.InMovingFrame(
        ns.constraints.PlaneContact(), amplitude=(0.0, 0.0, 0.01), period=4.0
    )
    with opened({"cut.csv": cut}, constraints=[moving]) as page:
        nodes = [node for node, _ in page.drawing._shapes]
        assert len(nodes) == 2
        for instant, height in ((1.0, 0.01), (3.0, -0.01)):
            done(page, lambda instant=instant: page._seek(instant))
            for node in nodes:
                assert node.position == pytest.approx((0.0, 0.0, height), abs=1e-9)


def test_a_name_cannot_bring_html_onto_the_page(cut):
    with opened({"<img src=x onerror=alert(1)>.csv": cut}, constraints=[ns.Blade()]) as page:
        told = page._verdict.content + page._readout.content + page._legend.content
        assert "<img" not in told


def test_a_saved_page_needs_nothing_but_itself(tmp_path, primitive, slipping):
    file = save_page(tmp_path / "scene.html", {"cut.json": primitive, "<b>.csv": slipping})
    text = file.read_text()
    assert text.count("__VISER_EMBED_DATA__") >= 1
    assert text.rstrip().endswith("</html>")
    assert "<b>.csv" not in text
    assert "violated: blade" in text and "cut.json</b>: holds" in text


# ---------------------------------------------------------------- what holds


def tick(page: Page, box: object, ask: Callable[[], None], value: bool = True) -> None:
    """Tick a box as a person does, or untick it."""

    def act() -> None:
        box.value = value
        ask()

    done(page, act)


def seek_what_holds(page: Page) -> object:
    """Ask what holds in the chosen recording; return what was found."""
    tick(page, page.finds.box, page.finds.ask)
    until(lambda: page.entry.found != SOUGHT, "what holds")
    done(page)
    return page.entry.found


def test_what_holds_in_a_recording_is_told_drawn_on_the_tool_and_can_be_held(knife):
    with opened({"knife.csv": knife}) as page:
        assert page.shields.box.disabled and "Nothing to hold" in page.shields._held.content
        found = seek_what_holds(page)
        assert found.kinds == ("blade",)
        assert html.escape(str(found).splitlines()[0]) in page.finds.note.content
        node = page.drawing._nodes["knife.csv"]["tool/found"]
        assert node.name == "/motions/knife.csv/tool/found" and node.visible
        assert page.entry.held == found.constraints
        assert not page.shields.box.disabled and "Holds blade." in page.shields._held.content
        tick(page, page.finds.box, page.finds.ask, False)
        assert "tool/found" not in page.drawing._nodes["knife.csv"]
        assert page.entry.held == () and page.finds.note.content == ""


def test_what_was_found_once_is_not_sought_again_nor_shown_when_no_longer_asked(
    cut, slipping, monkeypatch
):
    let, asked = threading.Event(), []

    def slow(motion: ns.PoseTrajectory) -> str:
        asked.append(motion.name)
        assert let.wait(PATIENCE)
        return f"found in {motion.name}"

    monkeypatch.setattr(found_panel, "find", slow)
    with opened({"cut.csv": cut, "slipping.csv": slipping}) as page:
        tick(page, page.finds.box, page.finds.ask)
        assert SOUGHT in page.finds.note.content
        tick(page, page.finds.box, page.finds.ask, False)
        tick(page, page.finds.box, page.finds.ask)
        done(page, lambda: page._choose("slipping.csv"))
        assert not page.finds.box.value and page.finds.note.content == ""
        let.set()
        until(lambda: page.entries["cut.csv"].found != SOUGHT, "the answer")
        # The answer is about another recording than the one that is looked at.
        assert page.finds.note.content == ""
        done(page, lambda: page._choose("cut.csv"))
        assert page.finds.box.value and "found in cut.csv" in page.finds.note.content
        assert asked == ["cut.csv"]


def test_a_recording_in_which_it_cannot_be_told_is_answered(monkeypatch):
    still = ns.PoseTrajectory(np.arange(50) / 100, np.zeros((50, 3)), Rotation.identity(50))
    with opened({"still.csv": still}) as page:
        told = seek_what_holds(page)
        assert isinstance(told, str) and html.escape(told) in page.finds.note.content
        assert not page._notice.visible and page.entry.held == ()

        def fail(motion: object) -> None:
            raise RuntimeError("of our own making")

        monkeypatch.setattr(found_panel, "identify", fail)
        page.entry.found = None
        assert "RuntimeError('of our own making')" in seek_what_holds(page)


def test_a_primitive_says_itself_what_holds(primitive, slipping):
    with opened({"cut.json": primitive, "slipping.csv": slipping}) as page:
        assert not page.finds._folder.visible
        done(page, lambda: page._choose("slipping.csv"))
        assert page.finds._folder.visible


# ---------------------------------------------------------------- a shield


def lead(page: Page) -> ShieldedRun:
    """Have the chosen motion's tool follow a command."""
    tick(page, page.shields.box, page.shields.ask)
    assert page.shields.run is not None, page._notice.content
    return page.shields.run


def test_a_shielded_tool_follows_its_command_and_does_not_slip(primitive):
    with opened({"cut.json": primitive}) as page:
        done(page, lambda: page._seek(2.0))
        before, turn = page.drawing.tool_pose("cut.json")
        run = lead(page)
        assert page.shields.command.visible and not page.goals.handles["goal"].visible
        assert page.shields.command.position == pytest.approx(before, abs=1e-6)
        ahead = before + turn.apply([0.015, 0.003, 0.0])
        page.shields.command.position = ahead
        seen = []
        until(
            lambda: seen.append(run.residual) or run.state.time > 2.0, "two seconds of the shield"
        )
        done(page)
        tool = page.drawing.tool_pose("cut.json")[0]
        assert np.linalg.norm(tool - ahead) < 0.5 * np.linalg.norm(before - ahead)
        assert run.shield.distance == pytest.approx(np.linalg.norm(run.state.position - ahead))
        assert max(seen) < EXACT
        assert "pushed" in page.drawing._nodes["cut.json"]
        assert page.shields._ghost.visible
        assert page.shields._ghost.position == pytest.approx(ahead)
        assert "mm and" in page.shields.note.content
        # Back where it began.
        done(page, page.shields.start)
        assert page.shields.run.path[0] == pytest.approx(before, abs=1e-6)
        assert page.shields.command.position == pytest.approx(before, abs=1e-6)
        tick(page, page.shields.box, page.shields.ask, False)
        assert page.shields.run is None and not page.shields.command.visible
        assert page.drawing.tool_pose("cut.json")[0] == pytest.approx(before)
        assert "pushed" not in page.drawing._nodes["cut.json"]
        assert page.goals.handles["goal"].visible


@pytest.mark.parametrize(
    "act",
    [
        lambda page: page._press(),
        lambda page: page._seek(1.0),
        lambda page: page._choose("slipping.csv"),
        lambda page: page.goals.undo(),
        lambda page: page.pushes.start(),
    ],
    ids=["play", "seek", "choose", "adapt", "push"],
)
def test_whatever_else_a_person_does_ends_it(primitive, slipping, act):
    with opened({"cut.json": primitive, "slipping.csv": slipping}) as page:
        lead(page)
        done(page, lambda: act(page))
        assert page.shields.run is None and not page.shields.box.value
        assert not page.shields.command.visible and page.shields.note.content == ""


def test_what_cannot_be_held_is_told(primitive, monkeypatch):
    def refuse(*_: object) -> None:
        raise ns.errors.ConstraintError("blade: of our own making")

    with opened({"cut.json": primitive}) as page:
        with monkeypatch.context() as patched:
            patched.setattr(ShieldedRun, "__init__", refuse)
            tick(page, page.shields.box, page.shields.ask)
        assert "of our own making" in page._notice.content
        assert page.shields.run is None and not page.shields.box.value
        run = lead(page)
        # Nor does what fails on the way hold the page up.
        monkeypatch.setattr(run, "advance", refuse)
        until(lambda: page.shields.run is None, "the end")
        done(page)
        assert not page.shields.box.value and not page.shields.command.visible


def test_what_was_found_is_what_is_held_beside_the_limits(knife):
    fence = ns.KeepOutSphere(center=(5.0, 0.0, 0.0), radius=0.01)
    with opened({"knife.csv": knife}, constraints=[ns.Blade(), fence]) as page:
        assert page.entry.held == (ns.Blade(), fence)
        found = seek_what_holds(page)
        assert page.entry.held == (*found.constraints, fence)
        run = lead(page)
        assert run.shield.system.constraints == page.entry.held
        # What is held changes: the tool is let go.
        tick(page, page.finds.box, page.finds.ask, False)
        assert page.shields.run is None and page.entry.held == (ns.Blade(), fence)


def test_a_tool_beside_its_surface_is_led_onto_it():
    run = ShieldedRun(
        [ns.constraints.PlaneContact()], np.array([0.0, 0, 1e-4]), Rotation.identity()
    )
    run.advance(1 / 30, np.zeros(3), Rotation.identity())
    assert 1e-6 < run.residual < 1e-4
    for _ in range(60):
        run.advance(1 / 30, np.zeros(3), Rotation.identity())
    assert run.residual < 1e-9


def test_a_shielded_run_keeps_time_and_does_not_hold_the_page_up(primitive):
    motion = primitive.rollout()
    pose = motion.positions[100], motion.rotations[100]
    run = ShieldedRun(primitive.constraints, *pose)
    began = run.state.time
    for _ in range(30):
        run.advance(1 / 30, *pose)
    assert run.state.time - began == pytest.approx(1.0, abs=2 / RATE)
    before = run.state.time
    run.advance(100.0, *pose)
    assert run.state.time - before == pytest.approx(MOST_STEPS_AT_ONCE / RATE)
