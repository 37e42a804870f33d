"""Where a person asks a primitive for another goal, start, duration or metric."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import viser

from noslip._typing import Floats
from noslip.boundary import Boundary
from noslip.viewer.actions import Actions
from noslip.viewer.changes import METRICS, Wish
from noslip.viewer.entries import Entry
from noslip.viewer.handles import ASIDE, Handle
from noslip.viewer.texts import field_step, note, plain

UNCHANGED = 1e-6
"""Difference (m, s, rad) from the primitive's own value that is no wish: a browser rounds."""


class GoalPanel:
    """Fields and handles for goal and start, and what became of the last wish.

    Widgets are added where the server's interface is being built.  ``follow`` is called with a
    wish, and whether a coarse motion will do, while a handle is being dragged.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        size: float,
        actions: Actions,
        follow: Callable[[Wish, bool], None],
        entry: Entry,
    ) -> None:
        gui, self._follow, self._entry = server.gui, follow, entry
        self.note = gui.add_html("")
        with gui.add_folder("Goal and start") as self._folder:
            zero, self._step = (0.0, 0.0, 0.0), field_step(size)
            self.goal: Any = gui.add_vector3("Goal (m)", zero, step=self._step)
            self.start: Any = gui.add_vector3("Start (m)", zero, step=self._step)
            self.duration: Any = gui.add_number("Duration (s)", 1.0, min=1e-3, step=1e-2)
            self.metric: Any = gui.add_dropdown(
                "Metric",
                METRICS,
                hint="What gives way to the constraints: the position alone, or the rotation too.",
            )
            undo = gui.add_button("As learned")
        for field in (self.goal, self.start, self.duration, self.metric):
            actions.on_change(field, "wish", self.ask_for_numbers)
        actions.on_click(undo, "undo", self.undo)
        self._away = ASIDE * size
        self.handles = {what: Handle(server.scene, what, what, size) for what in ("goal", "start")}
        for what, handle in self.handles.items():
            handle.on_drag(actions, f"wish {what}", partial(self._ask_for_handle, what))

    def choose(self, entry: Entry) -> None:
        """Be about an entry of the page."""
        self._entry = entry
        self._folder.visible = entry.primitive is not None
        if entry.primitive is None:
            self.note.content = note(entry.fixed)
        else:
            # Beyond the ends of the path, where neither it nor the tool is.
            along = entry.primitive.goal_position - entry.primitive.start_position
            far = float(np.linalg.norm(along))
            along = along / far if far > UNCHANGED else np.array([1.0, 0.0, 0.0])
            self.handles["goal"].aside = self._away * along
            self.handles["start"].aside = -self._away * along
            self.show()

    def offer(self, visible: bool) -> None:
        """Let a person drag goal and start, or not."""
        for handle in self.handles.values():
            handle.visible = visible and self._entry.primitive is not None

    def undo(self) -> None:
        """Ask for the motion as it was learned."""
        self._follow(Wish(), False)

    def ask_for_numbers(self) -> None:
        """Ask for what the fields say."""
        if self._entry.primitive is None:
            return
        wish, own = self._entry.wish, self._entry.primitive
        asked = wish.duration is not None
        asked = asked or abs(self.duration.value - own.duration) > UNCHANGED
        self._follow(
            replace(
                wish,
                goal=self._changed(self.goal.value, wish.goal, own.goal_position),
                start=self._changed(self.start.value, wish.start, own.start_position),
                duration=self.duration.value if asked else None,
                metric=self.metric.value,
            ),
            False,
        )

    def _ask_for_handle(self, what: str, released: bool) -> None:
        if self._entry.primitive is None:
            return
        wish, (position, rotation) = self._entry.wish, self.handles[what].pose
        known: Boundary = getattr(wish, what)
        asked = replace(known, position=position)
        own = getattr(self._entry.primitive, f"{what}_rotation")
        if known.rotation is not None or (rotation * own.inv()).magnitude() > UNCHANGED:
            asked = replace(asked, rotation=rotation)
        changes: dict[str, Any] = {what: asked}
        self._follow(replace(wish, **changes), not released)

    def show(self) -> None:
        """Show what is asked for in fields and handles, and say what came of it."""
        own, wish, outcome = self._entry.primitive, self._entry.wish, self._entry.outcome
        assert own is not None
        for what, field in (("goal", self.goal), ("start", self.start)):
            own_pose = getattr(own, f"{what}_position"), getattr(own, f"{what}_rotation")
            position, rotation = getattr(wish, what).pose_or(*own_pose)
            field.value = plain(position, self._step)
            self.handles[what].place(position, rotation)
        self.duration.value = wish.duration or own.duration
        self.metric.value = wish.metric
        failed = outcome is not None and outcome.primitive is None
        text = "As learned; drag the goal or the start." if outcome is None else str(outcome)
        self.note.content = note(text, "vermillion" if failed else "black")

    def _changed(self, value: Sequence[float], known: Boundary, own: Floats) -> Boundary:
        """What a field says, unless it says what the primitive does and was never changed."""
        given = np.array(value, dtype=np.float64)
        now, digits = (own, UNCHANGED) if known.position is None else (known.position, 1e-9)
        # A browser shows and returns fewer digits than were set.
        same = np.abs(given - plain(now, self._step)) <= digits
        return known if same.all() else replace(known, position=np.where(same, now, given))
