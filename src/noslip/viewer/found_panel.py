"""Where a person asks what holds in a recording."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import viser

from noslip.errors import NoslipError, one_line
from noslip.identification import Identified, identify
from noslip.trajectory import PoseTrajectory
from noslip.viewer.actions import Actions
from noslip.viewer.drawing import Drawing
from noslip.viewer.entries import Entry, extent
from noslip.viewer.found import found_parts, placed_parts
from noslip.viewer.texts import note

MOST_SAMPLES = 20_000
"""Of a recording that are looked at, evenly: a page answers in seconds, and the noise of more is
seldom what limits the answer."""
SOUGHT = "Being looked for ..."
"""Told until there is an answer."""
KEY = (
    "Orange: axes free of slip, and the point that does not slip, in their 95 % regions; along a "
    "thin line nothing tells where it is."
)


class FoundPanel:
    """A box that is ticked to find what holds in the chosen recording, and what was found.

    Widgets are added where the server's interface is being built.  Finding takes seconds, so it is
    done by a thread of its own, one recording after the other.  ``changed`` is called when what is
    shown of the chosen recording does.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        drawing: Drawing,
        actions: Actions,
        changed: Callable[[], None],
        node: str,
        entry: Entry,
    ) -> None:
        gui, self._drawing, self._changed, self._post = server.gui, drawing, changed, actions.post
        self._node, self._entry = node, entry
        self._thread = ThreadPoolExecutor(1, "noslip-identify")
        with gui.add_folder("This recording") as self._folder:
            self.box: Any = gui.add_checkbox("What holds?", False)
            self.note = gui.add_html("")
        actions.on_change(self.box, "find", self.ask)

    def choose(self, node: str, entry: Entry) -> None:
        """Be about an entry of the page, by its node in the scene."""
        self._node, self._entry = node, entry
        self._folder.visible = entry.primitive is None
        self.box.value = entry.sought
        self._tell()

    def stop(self) -> None:
        """Begin to look for nothing more."""
        self._thread.shutdown(wait=False, cancel_futures=True)

    def ask(self) -> None:
        """Show what holds, or no longer; find it, the first time."""
        node, entry = self._node, self._entry
        entry.sought = bool(self.box.value)
        if entry.sought and entry.found is None:
            entry.found = SOUGHT
            self._thread.submit(self._find, node, entry)
        self._show(node, entry)

    def _find(self, node: str, entry: Entry) -> None:
        found = find(entry.track.motion)

        def answer() -> None:
            entry.found = found
            self._show(node, entry)

        # Each has its own key: none takes another's place.
        self._post(object(), answer)

    def _show(self, node: str, entry: Entry) -> None:
        found = entry.found if entry.sought else None
        if isinstance(found, Identified):
            center, _ = extent([entry.track.motion])
            size = self._drawing.size
            carried, placed = found_parts(found, size), placed_parts(found, center, size)
            self._drawing.show_found(node, carried, placed)
        else:
            self._drawing.clear_found(node)
        if entry is self._entry:
            self._tell()
            self._changed()

    def _tell(self) -> None:
        found = self._entry.found if self._entry.sought else None
        drawn = isinstance(found, Identified) and bool(found.rows)
        self.note.content = note("" if found is None else str(found)) + note(KEY * drawn, "orange")


def find(motion: PoseTrajectory) -> Identified | str:
    """Return what holds in a recording, or why that cannot be told."""
    try:
        return identify(motion[:: -(-len(motion) // MOST_SAMPLES)])
    except NoslipError as error:
        return str(error)
    except Exception as error:
        # Whatever a stranger's file does, it is answered.
        return one_line(f"what holds cannot be found: {error!r}")
