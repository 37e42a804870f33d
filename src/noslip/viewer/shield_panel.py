"""Where a person drags a command, and a shielded tool follows as far as the constraints let it."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import viser
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip.constraints.check import residual_text
from noslip.constraints.declaration import Constraint
from noslip.constraints.system import ConstraintSystem
from noslip.errors import NoslipError
from noslip.shielding import Shield
from noslip.viewer.actions import Actions
from noslip.viewer.drawing import Drawing, place
from noslip.viewer.entries import Entry
from noslip.viewer.handles import Handle
from noslip.viewer.texts import note

RATE = 500.0
"""Steps a second: as a loop has them, and few enough to be computed between two pictures."""
MOST_STEPS_AT_ONCE = 100
"""Of them between two pictures: what takes longer runs slower than the clock, instead of holding
the page up."""
TRAIL = 600
"""Pictures in which the tool moved, after which its trail is forgotten: twenty seconds."""


class ShieldedRun:
    """A tool behind a shield, from a pose on, and where it went.

    ``residual`` is the largest between the last two pictures: that of a surface beside which a
    recording begins is gone soon.
    """

    def __init__(
        self, constraints: Sequence[Constraint], position: Floats, rotation: Rotation
    ) -> None:
        system = ConstraintSystem(constraints)
        self.shield = Shield(
            system.equalities.constraints, rate=RATE, limits=system.limits.constraints
        )
        self.shield.reset((position, rotation))
        self.state = self.shield.step((position, rotation))
        self.residual, self._due = 0.0, 0.0
        self._path = deque([self.state.position], maxlen=TRAIL)

    @property
    def path(self) -> Floats:
        """Positions at the pictures in which it moved (m), shape (N, 3)."""
        return np.array(self._path)

    def advance(self, passed: float, position: Floats, rotation: Rotation) -> None:
        """Follow a command for some time (s)."""
        due = self._due + passed * RATE
        steps = min(int(due), MOST_STEPS_AT_ONCE)
        self._due = due - int(due)
        sizes = []
        for _ in range(steps):
            self.state = self.shield.step((position, rotation))
            sizes.append(np.abs(self.state.constraint_residuals).max(initial=0.0))
        self.residual = float(max(sizes, default=self.residual))
        if np.any(self.state.position != self._path[-1]):
            self._path.append(self.state.position)


class ShieldPanel:
    """The command, the tool that follows it, and how far it is away.

    Widgets are added where the server's interface is being built.  ``running`` is called with
    whether a tool follows, when it begins or ends to.
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
        self.run: ShieldedRun | None = None
        self._node, self._entry = node, entry
        with gui.add_folder("Shield"):
            self._held = gui.add_html("")
            self.box: Any = gui.add_checkbox("Drag a command", False)
            self.reset: Any = gui.add_button("Reset", disabled=True)
            self.note = gui.add_html("")
        self.command = Handle(server.scene, "command", "command", drawing.size)
        # Placed with each picture, so that it shows what is followed.
        self._ghost = drawing.add_parts("/commanded", drawing.tool, ghost=True)
        self._ghost.visible = False
        actions.on_change(self.box, "shield", self.ask)
        actions.on_click(self.reset, "reset", self.start)

    def choose(self, node: str, entry: Entry) -> None:
        """Be about an entry of the page, by its node in the scene."""
        self.end()
        self._node, self._entry = node, entry
        self.offer()

    def offer(self) -> None:
        """Tell what can be held; what is held already no longer is."""
        self.end()
        held = self._entry.held
        self.box.disabled = not held
        self._held.content = note(
            f"Holds {', '.join(ConstraintSystem(held).names)}."
            if held
            else "Nothing to hold: ask what holds, or start with --constraint, such as blade."
        )

    def ask(self) -> None:
        """Begin, or end."""
        if self.box.value:
            self.start()
        else:
            self.end()

    def start(self) -> None:
        """Have the tool follow a command from where the motion has it now."""
        self.end()
        if not self._entry.held:
            return
        try:
            self.run = ShieldedRun(self._entry.held, *self._drawing.tool_pose(self._node))
        except NoslipError:
            self._offer(False)
            raise
        self.command.place(self.run.state.position, self.run.state.rotation)
        self._offer(True)
        self._show(self.run)

    def end(self) -> None:
        """End it, and leave nothing of it in the scene."""
        if self.run is None:
            return
        self.run = None
        self.note.content = ""
        self._drawing.clear_path(self._node)
        self._offer(False)

    def advance(self, passed: float) -> None:
        """Follow the command for some time (s)."""
        if self.run is None:
            return
        try:
            self.run.advance(passed, *self.command.pose)
        except NoslipError:
            self.end()
            raise
        self._show(self.run)

    def _offer(self, running: bool) -> None:
        self.box.value, self.reset.disabled = running, not running
        self.command.visible = self._ghost.visible = running
        self._running(running)

    def _show(self, run: ShieldedRun) -> None:
        self._drawing.place_tool(self._node, run.state)
        place(self._ghost, *self.command.pose)
        if len(run.path) > 1:
            self._drawing.draw_path(self._node, run.path)
        shield = run.shield
        self.note.content = note(
            f"The command is {1e3 * shield.distance:.1f} mm and {np.degrees(shield.angle):.1f}° "
            f"away; residual {residual_text(run.residual, '1', order='at most')}"
        )
