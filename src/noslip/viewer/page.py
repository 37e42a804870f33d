"""The page in the browser: a scene, a panel beside it, and what a person may do there.

What callbacks ask for is done by one thread, in order, between two frames; of what is asked again
before it was done, such as every move of a dragged goal, only the last counts.
"""

from __future__ import annotations

import html
import threading
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np
import viser
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip.boundary import Boundary
from noslip.constraints.declaration import Constraint
from noslip.errors import InputError, NoslipError
from noslip.figures.style import PALETTE
from noslip.viewer import serving
from noslip.viewer.changes import METRICS, PushedRun, Wish
from noslip.viewer.drawing import Follower
from noslip.viewer.entries import Entry, Shown, drawn, entries, key, unique, worst
from noslip.viewer.scene import Track, cursor, node_name
from noslip.viewer.tool import Part
from noslip.viewer.uploads import read_upload

FRAME = 1 / 30
"""Seconds between two pictures while it plays."""
CHART_PAUSE = 0.15
"""Seconds between two pictures of the charts, which are more to send."""
SPEEDS = ("0.1x", "0.25x", "0.5x", "1x", "2x", "4x")
PUSH = 0.04
"""Length of the push that is offered first, over the scene's size."""
GIZMO = 0.18
"""Size of what the goal and the start are dragged by, over the scene's."""
CHART_HEIGHT = 150
CHART_TITLES = {
    "residual": "log₁₀ of the residual",
    "margin": "least margin of the limits",
    "force": "constraint force",
}
LINES = ("blue", "vermillion", "green", "purple", "orange", "sky")


class Page:
    """Motions on a page that a browser opens.

    Parameters
    ----------
    shown : mapping of str to PoseTrajectory, ConstrainedDMP or Simulation
        By name, one or more.
    constraints : sequence of Constraint
        What they are checked against, besides the primitives' own.
    tool : sequence of Part, optional
        By default a scalpel.
    host, port : str, int
        Where it is served; a port that is taken gives way to the next free one.
    followers : mapping of str to Follower
        What moves along with a motion, by the motion's name; a simulation has its arm.

    Attributes
    ----------
    entries : dict of str to Entry
    drawing : Drawing
    time : float
        Of the instant that is shown (s).
    address : str
        To open in a browser.
    """

    def __init__(
        self,
        shown: Mapping[str, Shown],
        *,
        constraints: Sequence[Constraint] = (),
        tool: Sequence[Part] | None = None,
        host: str = serving.LOOPBACK,
        port: int = 8080,
        followers: Mapping[str, Follower] = MappingProxyType({}),
    ) -> None:
        if not shown:
            raise InputError("the viewer needs a recording or a primitive to show")
        self.constraints = tuple(constraints)
        self.entries = entries(shown, constraints, followers)
        self.time, self.playing = 0.0, False
        self._run: PushedRun | None = None
        self._held = False
        self._pending: dict[str, Callable[[], None]] = {}
        self._lock, self._woken, self._stopped = threading.Lock(), threading.Event(), False
        self._charted = -np.inf
        self.server = serving.serve(host, port)
        self.address = f"http://{host}:{self.server.get_port()}"
        self.server.gui.configure_theme(
            control_width="large", show_logo=False, show_share_button=False
        )
        self.drawing = drawn(self.server, self.entries, tool)
        self._worst = worst(self.entries)
        self.chosen = next(
            (n for n, e in self.entries.items() if e.primitive), next(iter(self.entries))
        )
        self._build()
        self._choose(self.chosen)
        self._thread = threading.Thread(target=self._work, name="noslip-viewer", daemon=True)
        self._thread.start()

    @property
    def entry(self) -> Entry:
        """The motion that the panel is about."""
        return self.entries[self.chosen]

    @property
    def duration(self) -> float:
        """Of the longest motion (s)."""
        return max(entry.track.motion.duration for entry in self.entries.values())

    def stop(self) -> None:
        """Stop serving."""
        self._stopped = True
        self._woken.set()
        self._thread.join(timeout=5)
        serving.stop(self.server)

    # ---------------------------------------------------------------- the panel

    def _build(self) -> None:
        gui = self.server.gui
        self._choice: Any = gui.add_dropdown(
            "Motion", tuple(self.entries), initial_value=self.chosen
        )
        self._slider: Any = gui.add_slider(
            "Time (s)", min=0.0, max=self.duration, step=1e-3, initial_value=0.0
        )
        self._play = gui.add_button("Play", icon=viser.Icon.PLAYER_PLAY)
        self._speed = gui.add_dropdown("Speed", SPEEDS, initial_value="1x")
        self._notice = gui.add_html("", visible=False)
        tabs = gui.add_tab_group()
        with tabs.add_tab("Look"):
            self._readout = gui.add_html("")
            self._legend = gui.add_html("")
            self._charts: dict[str, Any] = {}
            self._chart_folder = gui.add_folder("Over time")
            self._verdict = gui.add_html("")
            with gui.add_folder("Show", expand_by_default=False):
                for what in ("ghost", "arrows", "shapes"):
                    self._add_switch(what)
        with tabs.add_tab("Change"):
            self._change_note = gui.add_html("")
            with gui.add_folder("Goal and start") as self._change_folder:
                self._goal: Any = gui.add_vector3("Goal (m)", (0.0, 0.0, 0.0), step=1e-4)
                self._start: Any = gui.add_vector3("Start (m)", (0.0, 0.0, 0.0), step=1e-4)
                self._duration: Any = gui.add_number("Duration (s)", 1.0, min=1e-3, step=1e-2)
                self._metric: Any = gui.add_dropdown("Metric", METRICS)
                self._undo = gui.add_button("As learned")
            with gui.add_folder("Push the tool") as self._push_folder:
                self._push_by: Any = gui.add_vector3("Push (m)", (0.0, 0.0, 0.0), step=1e-4)
                self._begin = gui.add_button("Run in the control loop")
                self._pusher = gui.add_button("Push now")
                self._push_note = gui.add_html("")
        with tabs.add_tab("Check a file"):
            self._upload = gui.add_upload_button(
                "Open CSV, npz or primitive", icon=viser.Icon.UPLOAD, mime_type=".csv,.npz,.json"
            )
            self._upload_note = gui.add_html("")
        size = self.drawing.size
        self._gizmos = {
            what: self.server.scene.add_transform_controls(
                f"/{what}", scale=GIZMO * size, line_width=3.0, depth_test=False, visible=False
            )
            for what in ("goal", "start")
        }
        self._grip = self.server.scene.add_transform_controls(
            "/push",
            scale=GIZMO * size,
            line_width=3.0,
            disable_rotations=True,
            depth_test=False,
            visible=False,
        )
        self._connect()

    def _add_switch(self, what: str) -> None:
        names = {"ghost": "ghosts", "arrows": "arrows", "shapes": "surfaces and zones"}
        box = self.server.gui.add_checkbox(names[what].capitalize(), initial_value=True)
        self._on(box, what, lambda: self._show(what, bool(box.value)))

    def _connect(self) -> None:
        self._on(self._choice, "choose", lambda: self._choose(str(self._choice.value)))
        self._on(self._slider, "seek", lambda: self._seek(float(self._slider.value)))
        self._on(self._goal, "wish", self._wish_from_numbers)
        self._on(self._start, "wish", self._wish_from_numbers)
        self._on(self._duration, "wish", self._wish_from_numbers)
        self._on(self._metric, "wish", self._wish_from_numbers)

        for what, gizmo in self._gizmos.items():

            @gizmo.on_update
            async def _(event: viser.TransformControlsEvent, what: str = what) -> None:
                coarse = event.phase != "end"
                self.post(f"wish {what}", lambda: self._wish_from_gizmo(what, coarse))

        @self._grip.on_update
        async def _(event: viser.TransformControlsEvent) -> None:
            released = event.phase == "end"
            self.post("grip", lambda: self._pull(released))

        for button, action in (
            (self._play, self._toggle),
            (self._undo, self._as_learned),
            (self._begin, self._start_run),
            (self._pusher, self._push),
        ):

            @button.on_click
            async def _(event: viser.GuiEvent[Any], action: Callable[[], None] = action) -> None:
                self.post(action.__name__, action)

        @self._upload.on_upload
        async def _(event: viser.GuiEvent[viser.GuiUploadButtonHandle]) -> None:
            file = event.target.value
            self.post(f"upload {file.name}", lambda: self._check(file.name, file.content))

    def _on(self, handle: Any, key: str, action: Callable[[], None]) -> None:
        """Do something when a person, not the page itself, changes a value."""

        @handle.on_update  # type: ignore[untyped-decorator]
        async def _(event: viser.GuiEvent[Any]) -> None:
            if event.client is not None:
                self.post(key, action)

    # ---------------------------------------------------------------- the one thread

    def post(self, key: str, action: Callable[[], None]) -> None:
        """Have something done before the next frame, in place of what waits under the same key."""
        with self._lock:
            self._pending.pop(key, None)
            self._pending[key] = action
        self._woken.set()

    def _work(self) -> None:
        before = time.monotonic()
        while not self._stopped:
            moving = self.playing or self._run is not None
            self._woken.wait(max(0.0, before + FRAME - time.monotonic()) if moving else None)
            # What comes in from now on wakes the next turn.
            self._woken.clear()
            with self._lock:
                actions, self._pending = list(self._pending.values()), {}
            now = time.monotonic()
            if actions:
                self._notify("")
            for action in actions:
                self._try(action)
            if self.playing and moving:
                passed = (now - before) * float(str(self._speed.value).rstrip("x"))
                self._try(partial(self._advance, passed))
            before = now

    def _try(self, action: Callable[[], None]) -> None:
        try:
            action()
        except NoslipError as error:
            self._notify(str(error))
        except Exception as error:
            # The page must outlive any fault; the terminal tells what it was.
            traceback.print_exc()
            self._notify(f"{type(error).__name__}: {error}")

    def _notify(self, message: str) -> None:
        self._notice.content = _note(message, "vermillion")
        self._notice.visible = bool(message)

    # ---------------------------------------------------------------- time

    def _toggle(self) -> None:
        self.playing = not self.playing
        if self.playing and self._run is None and self.time >= self.duration:
            self._show_time(0.0)
        self._play.label = "Pause" if self.playing else "Play"
        self._play.icon = viser.Icon.PLAYER_PAUSE if self.playing else viser.Icon.PLAYER_PLAY

    def _seek(self, instant: float) -> None:
        if self._run is not None:
            self._end_run()
        self._show_time(instant)

    def _advance(self, passed: float) -> None:
        if self._run is not None:
            self._run_on(passed)
            return
        over = self.time + passed
        self._show_time(over if over < self.duration else 0.0)

    def _show_time(self, instant: float) -> None:
        self.time = float(np.clip(instant, 0.0, self.duration))
        self._slider.value = self.time
        self.drawing.move(self.time)
        self._readout.content = _table(self.entry.track.readout(self.time))
        if not self.playing or time.monotonic() - self._charted > CHART_PAUSE:
            self._draw_cursor()

    # ---------------------------------------------------------------- what is told of a motion

    def _choose(self, name: str) -> None:
        self._end_run()
        self.chosen = name
        entry = self.entry
        self._offer(running=False)
        self._change_folder.visible = self._push_folder.visible = entry.primitive is not None
        if entry.primitive is None:
            self._change_note.content = _note(
                "What was recorded or executed stays as it is; choose a primitive."
            )
        else:
            self._tell_wish(entry)
            self._push_by.value = _plain(PUSH * self.drawing.size * self._sideways(entry))
            self._push_note.content = ""
        self._tell(entry)
        self._show_time(self.time)

    def _tell(self, entry: Entry) -> None:
        """Tell verdict and figures of a motion, and draw its charts."""
        track = entry.track
        told = [f"<b>{html.escape(track.name)}</b>"]
        if track.report is None:
            told.append(_note("Nothing to check: start with --constraint, such as blade."))
        else:
            told += [
                _note(str(checked), "black" if checked.satisfied else "vermillion")
                for checked in track.report.constraints
            ]
        if merits := track.merits():
            told.append(f"<br>Against {track.against}" + _table(merits))
        self._verdict.content = _pad("".join(told))
        self._legend.content = _pad(key(self.entries, track))
        self._make_charts(track)

    def _make_charts(self, track: Track) -> None:
        charts = track.charts()
        for name in CHART_TITLES:
            if name in self._charts:
                self._charts.pop(name).remove()
        self._ranges: dict[str, tuple[float, float]] = {}
        self._curves = charts
        for name, curves in charts.items():
            lines = [curve for key, curve in curves.items() if key != "t"]
            low, high = _range(name, lines)
            self._ranges[name] = (low, high)
            series: list[Any] = [{"label": "t (s)"}]
            series += [
                {"label": key, "stroke": PALETTE[LINES[i % len(LINES)]], "width": 1.5}
                for i, key in enumerate(key for key in curves if key != "t")
            ]
            series.append({"label": "now", "stroke": PALETTE["gray"], "width": 1.5})
            with self._chart_folder:
                self._charts[name] = self.server.gui.add_uplot(
                    tuple(cursor(curves, self.time, low, high)),
                    tuple(series),
                    title=CHART_TITLES[name],
                    height=CHART_HEIGHT,
                    padding=(10, 24, 0, 0),
                    scales={
                        "x": {"time": False},
                        "y": {"range": (low, high)},
                    },
                    axes=({"size": 34}, {"size": 62}),
                    legend={"show": True, "live": False},
                )
        self._chart_folder.visible = bool(charts)

    def _draw_cursor(self) -> None:
        self._charted = time.monotonic()
        for name, chart in self._charts.items():
            chart.data = tuple(cursor(self._curves[name], self.time, *self._ranges[name]))

    def _show(self, what: str, visible: bool) -> None:
        self.drawing.show(what, visible)
        self._show_time(self.time)

    # ---------------------------------------------------------------- changes

    def _wish_from_numbers(self) -> None:
        if self.entry.primitive is None:
            return
        wish, own = self.entry.wish, self.entry.primitive
        self._follow(
            replace(
                wish,
                goal=_changed(self._goal.value, wish.goal, own.goal_position),
                start=_changed(self._start.value, wish.start, own.start_position),
                duration=self._duration.value
                if wish.duration is not None or abs(self._duration.value - own.duration) > 1e-6
                else None,
                metric=self._metric.value,
            )
        )

    def _wish_from_gizmo(self, what: str, coarse: bool) -> None:
        primitive, gizmo = self.entry.primitive, self._gizmos[what]
        if primitive is None:
            return
        known = getattr(self.entry.wish, what)
        asked = replace(known, position=np.array(gizmo.position))
        rotation = Rotation.from_quat(np.array(gizmo.wxyz), scalar_first=True)
        own = getattr(primitive, f"{what}_rotation")
        if known.rotation is not None or (rotation * own.inv()).magnitude() > 1e-6:
            asked = replace(asked, rotation=rotation)
        wish: dict[str, Any] = {what: asked}
        self._follow(replace(self.entry.wish, **wish), coarse=coarse)

    def _redraw(self, name: str) -> None:
        """Draw a motion anew, and the others where the colors' scale changed."""
        now = worst(self.entries)
        for other, entry in self.entries.items():
            if other == name or now != self._worst:
                self.drawing.put(other, entry.track, now, entry.follower)
        self._worst = now

    def _as_learned(self) -> None:
        self._follow(Wish())

    def _follow(self, wish: Wish, *, coarse: bool = False) -> None:
        """Adapt the chosen primitive; if it cannot be, its motion stays what it was."""
        entry = self.entry
        if entry.adapter is None:
            return
        self._end_run()
        entry.wish = wish
        entry.outcome = entry.adapter(wish, coarse=coarse)
        if entry.outcome.motion is not None:
            entry.current = entry.outcome.primitive
            entry.track = replace(entry.track, motion=entry.outcome.motion)
            self._redraw(self.chosen)
            self._slider.max = self.duration
            if not coarse:
                self._tell(entry)
        self._tell_wish(entry)
        self._show_time(self.time)

    def _tell_wish(self, entry: Entry) -> None:
        """Put what is asked for into the panel, and the gizmos where it is."""
        own, wish = entry.primitive, entry.wish
        assert own is not None
        for what, field_ in (("goal", self._goal), ("start", self._start)):
            own_pose = getattr(own, f"{what}_position"), getattr(own, f"{what}_rotation")
            position, rotation = getattr(wish, what).pose_or(*own_pose)
            field_.value = _plain(position)
            gizmo = self._gizmos[what]
            gizmo.position, gizmo.wxyz = position, rotation.as_quat(scalar_first=True)
        self._duration.value = wish.duration or own.duration
        self._metric.value = wish.metric
        failed = entry.outcome is not None and entry.outcome.primitive is None
        told = (
            "As learned; drag the goal or the start."
            if entry.outcome is None
            else str(entry.outcome)
        )
        self._change_note.content = _note(told, "vermillion" if failed else "black")

    # ---------------------------------------------------------------- pushes

    def _sideways(self, entry: Entry) -> Floats:
        """Direction of the push that is offered first: across the tool, in the middle."""
        axes = entry.track.lateral_axes
        return np.array([0.0, 1.0, 0.0]) if axes is None else axes[len(axes) // 2]

    def _start_run(self) -> None:
        if self.entry.current is None:
            return
        self._run, self._held = PushedRun(self.entry.current), False
        self._show_run("runs")
        self._offer(running=True)
        if not self.playing:
            self._toggle()

    def _push(self) -> None:
        if self._run is None:
            self._start_run()
        if self._run is not None:
            self._run.push(self._push_by.value)

    def _offer(self, *, running: bool) -> None:
        """Let a person drag the tool while it runs, else the goal and the start."""
        self._grip.visible = running
        for gizmo in self._gizmos.values():
            gizmo.visible = not running and self.entry.primitive is not None

    def _pull(self, released: bool) -> None:
        """Let the run wait while a person holds the tool; push it to where it is released."""
        run = self._run
        if run is None:
            return
        self._held = not released
        if released:
            by = np.array(self._grip.position) - run.states[-1].position
            self._push_by.value = _plain(by)
            run.push(by)

    def _run_on(self, passed: float) -> None:
        run = self._run
        assert run is not None
        if self._held:
            return
        try:
            run.advance(run.clock + passed)
        except NoslipError:
            self._end_run()
            raise
        self._show_run("arrived" if run.done else "runs")
        if run.done:
            self._toggle()
            self._run = None
            self._offer(running=False)

    def _end_run(self) -> None:
        self._run = None
        self._offer(running=False)
        self._push_note.content = ""
        self.drawing.clear_path(self.chosen)

    def _show_run(self, what: str) -> None:
        run = self._run
        assert run is not None
        state = run.states[-1]
        self.drawing.place_tool(self.chosen, state)
        self._grip.position = state.position
        self._grip.wxyz = state.rotation.as_quat(scalar_first=True)
        if len(run.states) > 1:
            step = max(1, len(run.states) // 500)
            self.drawing.draw_path(self.chosen, run.path[::-step][::-1])
        off = 1e3 * run.off(self.entry.track.motion.positions)
        told = (
            f"{what}: {run.clock:.2f} s, {off:.2g} mm off the path, "
            f"{1e3 * run.goal_error:.2g} mm from the goal, residual at most {run.residual:.1e}"
        )
        self._push_note.content = _note(told)

    # ---------------------------------------------------------------- files

    def _check(self, name: str, content: bytes) -> None:
        """Add a file to the page and check it, or tell what is wrong with it."""
        try:
            found = read_upload(name, content)
            others = [c for e in self.entries.values() for c in e.track.system.constraints]
            (entry,) = entries({name: found}, unique([*self.constraints, *others])).values()
        except NoslipError as error:
            self._upload_note.content = _note(str(error), "vermillion")
            return
        node = node_name(name, self.entries)
        self.entries[node] = entry
        self._redraw(node)
        self._choice.options = tuple(self.entries)
        self._choice.value = node
        self._slider.max = self.duration
        self._choose(node)
        report = entry.track.report
        told = (
            f"{name}: nothing to check; start with --constraint" if report is None else str(report)
        )
        good = report is None or report.satisfied
        self._upload_note.content = _note(told, "black" if good else "vermillion")


# -------------------------------------------------------------------- texts


def _changed(value: Sequence[float], known: Boundary, own: Floats) -> Boundary:
    """What a field says, unless it says what the primitive does and was never changed."""
    given = np.array(value, dtype=np.float64)
    # A browser shows and returns fewer digits than were set.
    shown, digits = (own, 1e-6) if known.position is None else (known.position, 1e-9)
    return known if np.abs(given - shown).max() <= digits else replace(known, position=given)


def _plain(vector: Floats) -> tuple[float, ...]:
    """Return numbers without the noise that would be shown as a negative zero."""
    return tuple(float(x) + 0.0 for x in np.round(vector, 7))


def _range(chart: str, curves: Sequence[Floats]) -> tuple[float, float]:
    """Ends of a chart's axis: whole decades of a residual; else zero is always within."""
    low, high = min(c.min() for c in curves), max(c.max() for c in curves)
    if chart == "residual":
        return float(np.floor(low)), float(np.floor(high) + 1)
    low, high = min(low, 0.0), max(high, 0.0)
    room = 0.06 * (high - low) or 1.0
    return float(low - room), float(high + room)


def _pad(content: str) -> str:
    return f'<div style="padding:4px 12px;font-size:13px;line-height:1.4">{content}</div>'


def _note(text: str, color: str = "black") -> str:
    lines = html.escape(text).replace("\n", "<br>")
    return _pad(f'<span style="color:{PALETTE[color]}">{lines}</span>') if text else ""


def _table(told: Mapping[str, str]) -> str:
    rows = "".join(
        f'<tr><td style="color:#666;padding-right:10px">{html.escape(label)}</td>'
        f'<td style="font-variant-numeric:tabular-nums">{html.escape(text)}</td></tr>'
        for label, text in told.items()
    )
    return _pad(f"<table>{rows}</table>")
