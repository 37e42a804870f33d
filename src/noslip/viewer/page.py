"""The page in the browser: a scene, a panel beside it, and what a person may do there."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np
import viser

from noslip.constraints.declaration import Constraint
from noslip.errors import InputError, one_line
from noslip.viewer import serving
from noslip.viewer.actions import Actions
from noslip.viewer.changes import Wish
from noslip.viewer.charts import Charts
from noslip.viewer.drawing import Follower
from noslip.viewer.entries import (
    Entry,
    Shown,
    drawn,
    entries,
    key,
    node_name,
    of_a_tool,
    unique,
    worst,
)
from noslip.viewer.found_panel import FoundPanel
from noslip.viewer.goal_panel import GoalPanel
from noslip.viewer.push_panel import PushPanel
from noslip.viewer.shield_panel import ShieldPanel
from noslip.viewer.texts import note, pad, table
from noslip.viewer.tool import Part
from noslip.viewer.uploads import Upload, Uploads

SWITCHES = {"ghost": "Ghosts", "arrows": "Arrows", "shapes": "Surfaces and zones"}
"""What can be hidden, and how it is called."""


class Page:
    """Motions on a page that a browser opens.

    Parameters
    ----------
    shown : mapping of str to PoseTrajectory, Trajectory, Bodies, ConstrainedDMP or Simulation
        By name, one or more; vectors must have a place: joints of a robot, or a position.
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
    goals : GoalPanel
    pushes : PushPanel
    finds : FoundPanel
    shields : ShieldPanel
    time : float
        Of the instant that is shown (s).
    address : str
        To open in a browser; served beyond this machine, with a token that lets in.
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
        self._actions = Actions(lambda: self._runs, self._advance, self._notify)
        self.post = self._actions.post
        self.server, self.address = serving.serve(host, port)
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
        self._actions.start()

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
        self.uploads.stop()
        self.finds.stop()
        self._actions.stop()
        serving.stop(self.server)

    # ---------------------------------------------------------------- the panel

    def _build(self) -> None:
        gui, actions = self.server.gui, self._actions
        self._choice: Any = gui.add_dropdown(
            "Motion", tuple(self.entries), initial_value=self.chosen
        )
        self._slider: Any = gui.add_slider(
            "Time (s)", min=0.0, max=self.duration, step=1e-3, initial_value=0.0
        )
        self._play = gui.add_button("Play", icon=viser.Icon.PLAYER_PLAY)
        self._speed = gui.add_dropdown(
            "Speed", ("0.1x", "0.25x", "0.5x", "1x", "2x", "4x"), initial_value="1x"
        )
        self._notice = gui.add_html("", visible=False)
        tabs = gui.add_tab_group()
        with tabs.add_tab("Look"):
            self._readout = gui.add_html("")
            self._legend = gui.add_html("")
            self._charts = Charts(gui)
            self._verdict = gui.add_html("")
            with gui.add_folder("Show", expand_by_default=False):
                for what, label in SWITCHES.items():
                    box = gui.add_checkbox(label, initial_value=True)
                    actions.on_change(box, what, partial(self._show, what, box))
        with tabs.add_tab("Change"):
            shown = self.chosen, self.entry
            self.goals = GoalPanel(self.server, self.drawing.size, actions, self._follow, shown[1])
            self.pushes = PushPanel(self.server, self.drawing, actions, self._mark_run, *shown)
        with tabs.add_tab("Hold"):
            self.finds = FoundPanel(
                self.server, self.drawing, actions, lambda: self.shields.offer(), *shown
            )
            self.shields = ShieldPanel(self.server, self.drawing, actions, self._lead, *shown)
        with tabs.add_tab("Check a file"):
            upload = gui.add_upload_button(
                "Open CSV, npz or primitive", icon=viser.Icon.UPLOAD, mime_type=".csv,.npz,.json"
            )
            self._upload_note = gui.add_html("")

        actions.on_change(self._choice, "choose", lambda: self._choose(str(self._choice.value)))
        actions.on_change(self._slider, "seek", lambda: self._seek(float(self._slider.value)))
        actions.on_click(self._play, "play", self._press)

        self.uploads = Uploads(
            self.server,
            upload,
            # Each has its own key: none takes another's place.
            lambda *file: self.post(object(), partial(self._answer_upload, *file)),
            lambda told: self.post(object(), partial(self._tell_upload, told, False)),
        )

    def _notify(self, message: str) -> None:
        self._notice.content = note(message, "vermillion")
        self._notice.visible = bool(message)

    # ---------------------------------------------------------------- time

    @property
    def _runs(self) -> bool:
        """Whether there is a next picture without anything being asked for."""
        return self.playing or self.shields.run is not None

    def _press(self) -> None:
        self.shields.end()
        self._toggle()

    def _toggle(self) -> None:
        self.playing = not self.playing
        if self.playing and self.pushes.run is None and self.time >= self.duration:
            self._show_time(0.0)
        self._play.label = "Pause" if self.playing else "Play"
        self._play.icon = viser.Icon.PLAYER_PAUSE if self.playing else viser.Icon.PLAYER_PLAY

    def _seek(self, instant: float) -> None:
        self.shields.end()
        if self.pushes.run is not None:
            self.pushes.end()
        self._show_time(instant)

    def _advance(self, passed: float) -> None:
        if self.shields.run is not None:
            self.shields.advance(passed)
            return
        passed *= float(str(self._speed.value).rstrip("x"))
        if self.pushes.run is not None:
            self.pushes.advance(passed)
            if self.pushes.run is None:
                self._toggle()
            return
        # A rhythm goes on in the middle of a picture.
        self._show_time((self.time + passed) % self.duration)

    def _show_time(self, instant: float) -> None:
        self.time = float(np.clip(instant, 0.0, self.duration))
        self._slider.value = self.time
        self.drawing.move(self.time)
        self._readout.content = table(self.entry.track.readout(self.time))
        self._charts.move(self.time, playing=self.playing)

    # ---------------------------------------------------------------- the chosen motion

    def _choose(self, name: str) -> None:
        self.chosen = name
        self.pushes.choose(name, self.entry)
        self.shields.choose(name, self.entry)
        self.finds.choose(name, self.entry)
        self.goals.choose(self.entry)
        self.goals.offer(True)
        self._describe(self.entry)
        self._show_time(self.time)

    def _describe(self, entry: Entry) -> None:
        """Tell verdict and figures of a motion, and draw its charts."""
        track = entry.track
        lines = [f"<b>{html.escape(track.name)}</b>"]
        if track.report is None:
            lines.append(note("Nothing to check: start with --constraint, such as blade."))
        else:
            lines += [
                note(str(checked), "black" if checked.satisfied else "vermillion")
                for checked in track.report.constraints
            ]
        if merits := track.merits():
            lines.append(f"<br>Against {track.against}" + table(merits))
        self._verdict.content = pad("".join(lines))
        self._legend.content = pad(key(self.entries, track))
        self._charts.draw(track, self.time)

    def _show(self, what: str, box: Any) -> None:
        self.drawing.show(what, bool(box.value))
        self._show_time(self.time)

    # ---------------------------------------------------------------- changes

    def _redraw(self, name: str) -> None:
        """Draw a motion anew, and the others where the colors' scale changed."""
        now = worst(self.entries)
        for other, entry in self.entries.items():
            if other == name or now != self._worst:
                self.drawing.put(other, entry.track, now, entry.follower)
        self._worst = now

    def _follow(self, wish: Wish, coarse: bool) -> None:
        """Adapt the chosen primitive; if it cannot be, its motion stays what it was."""
        entry = self.entry
        if entry.adapter is None:
            return
        self.pushes.end()
        self.shields.end()
        entry.wish = wish
        entry.outcome = entry.adapter(wish, coarse=coarse)
        if entry.outcome.motion is not None:
            entry.current = entry.outcome.primitive
            entry.track = replace(entry.track, motion=entry.outcome.motion)
            self._redraw(self.chosen)
            self._slider.max = self.duration
            if not coarse:
                self._describe(entry)
        self.goals.show()
        self._show_time(self.time)

    def _mark_run(self, running: bool) -> None:
        """Let a person drag the tool while it runs, else the goal and the start."""
        if running:
            self.shields.end()
        self.goals.offer(not running)
        if running and not self.playing:
            self._toggle()

    def _lead(self, leading: bool) -> None:
        """Let a person drag the command of a shielded tool, else the goal and the start."""
        if leading:
            self.pushes.end()
            if self.playing:
                self._toggle()
        else:
            self._show_time(self.time)
        self.goals.offer(not leading)

    # ---------------------------------------------------------------- files

    def _tell_upload(self, text: str, good: bool) -> None:
        self._upload_note.content = note(text, "black" if good else "vermillion")

    def _answer_upload(self, name: str, upload: Upload) -> None:
        """Add what was in a file to the page and check it; what cannot be shown leaves no trace."""
        found, warned = upload
        node, before = node_name(name, self.entries), self.chosen
        try:
            others = [c for e in self.entries.values() for c in e.track.system.constraints]
            held = unique([*self.constraints, *(c for c in others if of_a_tool(c))])
            (entry,) = entries({name: found}, held).values()
            self.entries[node] = entry
            self._redraw(node)
            self._offer(node)
        except Exception as error:
            self.entries.pop(node, None)
            self.drawing.remove(node)
            # No scale: all is drawn anew.
            self._worst = np.nan
            self._redraw(before)
            self._offer(before)
            self._tell_upload(one_line(f"{name}: cannot be shown: {error}"), False)
            return
        report = entry.track.report
        text = (
            f"{name}: nothing to check; start with --constraint" if report is None else str(report)
        )
        self._tell_upload("\n".join([text, *warned]), report is None or report.satisfied)

    def _offer(self, name: str) -> None:
        """List the motions that there are, and choose one."""
        self._choice.options = tuple(self.entries)
        self._choice.value = name
        self._slider.max = self.duration
        self._choose(name)
