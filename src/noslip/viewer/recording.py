"""One HTML file that plays a scene without Python, from disk and with the network off."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np

from noslip._files import write_beside
from noslip.constraints.declaration import Constraint
from noslip.viewer import serving
from noslip.viewer.drawing import Follower
from noslip.viewer.entries import TOOL_LENGTH, Shown, drawn, entries, key
from noslip.viewer.tool import Part
from noslip.viewer.track import Track

FRAMES_PER_SECOND = 30.0
"""Smooth to the eye; more would make the file larger."""
MOST_FRAMES = 600
"""Of a long motion, which then has fewer frames per second: the file's size has a bound."""
_BOX = (
    '<div style="position:fixed;left:12px;top:12px;z-index:5;max-width:30em;padding:8px 12px;'
    "background:rgba(255,255,255,.88);border:1px solid #ddd;border-radius:6px;"
    'font:13px/1.4 system-ui,sans-serif;color:#222">{}</div>'
)
"""Where the verdicts stand: above the scene, where viser's page has nothing."""


def save_page(
    path: str | Path,
    shown: Mapping[str, Shown],
    *,
    constraints: Sequence[Constraint] = (),
    tool: Sequence[Part] | None = None,
    followers: Mapping[str, Follower] = MappingProxyType({}),
) -> Path:
    """Write a scene and its motion as one HTML file; return its path.

    The parameters are those of :class:`noslip.viewer.Page`.  The file has a time slider, play and
    speed, and the verdicts; nothing in it can be dragged, for nothing there computes.
    """
    prepared = entries(shown, constraints, followers)
    duration = max(entry.track.motion.duration for entry in prepared.values())
    frames = min(max(round(duration * FRAMES_PER_SECOND), 2), MOST_FRAMES)
    server, _ = serving.serve(serving.LOOPBACK, 0)
    try:
        drawing = drawn(server, prepared, tool)
        first, track = next((name, entry.track) for name, entry in prepared.items())
        # Above the tool, where it hides no arrow.
        above = np.array([0.0, 0.0, 1.15 * TOOL_LENGTH * drawing.size])
        label = server.scene.add_label(
            "/readout", "", font_screen_scale=0.8, anchor="bottom-center"
        )
        serializer = server.get_scene_serializer()
        for frame in range(frames + 1):
            time = duration * frame / frames
            drawing.move(time)
            k = track.sample(time)
            label.position = track.points[k] + above
            label.text = f"{first}: {time:.2f} s, violation {track.violation[k]:.1e}"
            serializer.insert_sleep(duration / frames)
        page = serializer.as_html()
    finally:
        serving.stop(server)
    verdicts = "".join(_verdict(name, entry.track) for name, entry in prepared.items())
    box = _BOX.format(verdicts + key(prepared, track))
    # The page's own script holds closing tags as text; the last one is the document's.
    head, end, tail = page.rpartition("</body>")
    return write_beside(path, f"{head}{box}{end}{tail}".encode())


def _verdict(name: str, track: Track) -> str:
    """Return a line that unfolds into what each constraint does, as HTML."""
    name = html.escape(name)
    if track.report is None:
        return f"<div>{name}</div>"
    lines = "".join(f"<div>{html.escape(str(found))}</div>" for found in track.report.constraints)
    verdict = html.escape(track.report.verdict)
    return f"<details><summary><b>{name}</b>: {verdict}</summary>{lines}</details>"
