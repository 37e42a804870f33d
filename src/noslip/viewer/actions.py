"""What a person asks for, done by one thread, in order, between two frames.

Of what is asked again before it was done, such as every move of a dragged goal, only the last
counts.
"""

from __future__ import annotations

import threading
import time
import traceback
from collections.abc import Callable
from functools import partial
from typing import Any

import viser

from noslip.errors import NoslipError

FRAME = 1 / 30
"""Seconds between two pictures while a motion plays: as many as a film has, and few to send."""


class Actions:
    """The one thread, and what waits for it.

    Frames are drawn while ``playing`` says so, by ``advance``, called with the seconds since the
    one before.  ``notify`` tells a person what failed, or with an empty text that nothing did.
    """

    def __init__(
        self,
        playing: Callable[[], bool],
        advance: Callable[[float], None],
        notify: Callable[[str], None],
    ) -> None:
        self._playing, self._advance, self._notify = playing, advance, notify
        self._pending: dict[object, Callable[[], None]] = {}
        self._lock, self._woken, self._stopped = threading.Lock(), threading.Event(), False
        self._thread = threading.Thread(target=self._work, name="noslip-viewer", daemon=True)

    def start(self) -> None:
        """Begin with what waits."""
        self._thread.start()

    def stop(self) -> None:
        """End the thread, once it has done what it is doing."""
        self._stopped = True
        self._woken.set()
        self._thread.join(timeout=5)

    def post(self, key: object, action: Callable[[], None]) -> None:
        """Have something done before the next frame, in place of what waits under the same key."""
        with self._lock:
            self._pending.pop(key, None)
            self._pending[key] = action
        self._woken.set()

    def on_change(self, handle: Any, key: str, action: Callable[[], None]) -> None:
        """Do something when a person, not the page itself, changes a value."""

        @handle.on_update  # type: ignore[untyped-decorator]
        async def _(event: viser.GuiEvent[Any]) -> None:
            if event.client is not None:
                self.post(key, action)

    def on_click(self, button: Any, key: str, action: Callable[[], None]) -> None:
        """Do something when a person presses a button."""

        @button.on_click  # type: ignore[untyped-decorator]
        async def _(event: viser.GuiEvent[Any]) -> None:
            self.post(key, action)

    def on_drag(self, gizmo: Any, key: str, action: Callable[[bool], None]) -> None:
        """Do something when a person drags a gizmo; it is called with whether it was released."""

        @gizmo.on_update  # type: ignore[untyped-decorator]
        async def _(event: viser.TransformControlsEvent) -> None:
            released = event.phase == "end"
            self.post(key, lambda: action(released))

    def _work(self) -> None:
        before = time.monotonic()
        while not self._stopped:
            playing = self._playing()
            self._woken.wait(max(0.0, before + FRAME - time.monotonic()) if playing else None)
            # What comes in from now on wakes the next turn.
            self._woken.clear()
            with self._lock:
                actions, self._pending = list(self._pending.values()), {}
            now = time.monotonic()
            if actions:
                self._notify("")
            for action in actions:
                self._try(action)
            if playing and self._playing():
                self._try(partial(self._advance, now - before))
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
