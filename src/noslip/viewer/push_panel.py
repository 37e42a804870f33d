"""Where a person runs a primitive in its control loop, and pushes the tool off its path."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import viser

from noslip.constraints.check import residual_text
from noslip.errors import NoslipError
from noslip.viewer.actions import Actions
from noslip.viewer.changes import PushedRun
from noslip.viewer.drawing import Drawing
from noslip.viewer.entries import Entry, extent
from noslip.viewer.handles import Handle
from noslip.viewer.texts import field_step, note, plain

PUSH = 0.05
"""Length of the push that is offered first, over the motion's size: seen at once, and recovered
from long before the end."""


class PushPanel:
    """The run that is under way, if any, the push that is offered, and the grip on the tool.

    Widgets are added where the server's interface is being built, and the run is shown in the
    drawing.  ``running`` is called with whether a run is under way, when one begins or ends.  The
    run waits while ``held``, that is while a person holds the tool.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        drawing: Drawing,
        actions: Actions,
        running: Callable[[bool], None],
        node: str,
        entry: Entry,
    ) -> None:
        gui, self._drawing, self._running = server.gui, drawing, running
        self.run: PushedRun | None = None
        self.held = False
        self._node, self._entry = node, entry
        with gui.add_folder("Push the tool") as self._folder:
            self._step = field_step(drawing.size)
            self.by: Any = gui.add_vector3("Push (m)", (0.0, 0.0, 0.0), step=self._step)
            begin = gui.add_button(
                "Run in the control loop",
                hint="Steps the primitive as on a robot; meanwhile the tool can be dragged.",
            )
            push = gui.add_button("Push now")
            self.note = gui.add_html("")
        self.grip = Handle(server.scene, "push", "push", drawing.size, turns=False)
        actions.on_click(begin, "run", self.start)
        actions.on_click(push, "push", self.push)
        self.grip.on_drag(actions, "grip", self.pull)

    def choose(self, node: str, entry: Entry) -> None:
        """Be about an entry of the page, by its node in the scene."""
        self.end()
        self._node, self._entry = node, entry
        self._folder.visible = entry.primitive is not None
        if entry.primitive is not None:
            axes = entry.track.lateral_axes
            sideways = np.array([0.0, 1.0, 0.0]) if axes is None else axes[len(axes) // 2]
            _, size = extent([entry.track.motion])
            by = np.round(PUSH * size * sideways / self._step) * self._step
            self.by.value = plain(by, self._step)

    def start(self) -> None:
        """Run the chosen primitive from its beginning."""
        if self._entry.current is None:
            return
        self.run, self.held = PushedRun(self._entry.current), False
        self._show(self.run, "runs")
        self._offer(True)

    def push(self) -> None:
        """Push the tool; one that does not run is started first."""
        if self.run is None:
            self.start()
        if self.run is not None:
            self.run.push(self.by.value)

    def pull(self, released: bool) -> None:
        """Let the run wait while a person holds the tool; push it to where it is released."""
        if self.run is None:
            return
        self.held = not released
        if released:
            by = self.grip.position - self.run.states[-1].position
            self.by.value = plain(by, self._step)
            self.run.push(by)

    def advance(self, passed: float) -> None:
        """Run on by some time (s), up to the end."""
        run = self.run
        if run is None or self.held:
            return
        try:
            run.advance(run.clock + passed)
        except NoslipError:
            self.end()
            raise
        self._show(run, "arrived" if run.done else "runs")
        if run.done:
            self.run = None
            self._offer(False)

    def end(self) -> None:
        """End the run, and leave nothing of it in the scene."""
        self.run = None
        self._offer(False)
        self.note.content = ""
        self._drawing.clear_path(self._node)

    def _offer(self, running: bool) -> None:
        self.grip.visible = running
        self._running(running)

    def _show(self, run: PushedRun, what: str) -> None:
        state = run.states[-1]
        self._drawing.place_tool(self._node, state)
        self.grip.place(state.position, state.rotation)
        if len(run.states) > 1:
            step = max(1, len(run.states) // 500)
            self._drawing.draw_path(self._node, run.path[::-step][::-1])
        off = 1e3 * run.off(self._entry.track.motion.positions)
        self.note.content = note(
            f"{what}: {run.clock:.2f} s, {off:.2g} mm off the path, "
            f"{1e3 * run.goal_error:.2g} mm from the goal, residual "
            + residual_text(run.residual, "1", order="at most")
        )
