"""One HTML file that plays a scene without Python, from disk and with the network off."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np

from noslip._files import write_beside
from noslip.constraints.check import residual_text
from noslip.constraints.declaration import Constraint
from noslip.viewer import serving
from noslip.viewer.charts import curves
from noslip.viewer.drawing import Drawing, Follower
from noslip.viewer.entries import TOOL_LENGTH, Shown, drawn, entries, key
from noslip.viewer.printed import chart
from noslip.viewer.shell import NARROW, amended
from noslip.viewer.tool import Part
from noslip.viewer.track import Track

FRAMES_PER_SECOND = 30.0
"""Smooth to the eye; more would make the file larger."""
MOST_FRAMES = 600
"""Of a long motion, which then has fewer frames per second: the file's size has a bound."""
_BOX = f"""<style>
.noslip {{ position: fixed; right: 12px; top: 12px; z-index: 5; padding: 8px 12px;
  width: 27em; max-width: calc(100vw - 48px); max-height: calc(100vh - 80px); overflow: auto;
  background: rgba(255,255,255,.9); border: 1px solid #ddd; border-radius: 6px;
  font: 13px/1.4 system-ui, sans-serif; color: #222 }}
.noslip svg {{ display: block; width: 100%; margin: 6px 0 }}
</style>
<div class="noslip">{{}}</div>
<script>
// On a phone, one line a motion, until it is touched.
if (innerWidth < {NARROW}) for (const d of document.querySelectorAll(".noslip details")) d.open = 0;
function follow() {{
  // The thumb of viser's own slider, which tells the time.
  const clock = document.querySelector("[role=slider]");
  if (clock) for (const line of document.querySelectorAll(".noslip .now")) {{
    const {{ start, end, left, right }} = line.dataset;
    const share = (clock.ariaValueNow - start) / (end - start);
    const x = +left + Math.min(Math.max(share, 0), 1) * (right - left);
    line.setAttribute("x1", x); line.setAttribute("x2", x);
  }}
  requestAnimationFrame(follow);
}}
follow();
</script>"""
"""Where verdicts and charts stand: on the right, as the panel of a page that is served."""


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
    speed, the verdicts and the charts; nothing in it can be dragged, for nothing there computes.
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
            violation = residual_text(float(track.violation[k]), "1")
            label.text = f"{first}: {time:.2f} s, violation {violation}"
            serializer.insert_sleep(duration / frames)
        page = amended(serializer.as_html(), _for_phones(drawing))
    finally:
        serving.stop(server)
    told = "".join(
        _told(name, entry.track, number == 0)
        for number, (name, entry) in enumerate(prepared.items())
    )
    # The page's own script holds closing tags as text; the last one is the document's.
    head, end, tail = page.rpartition("</body>")
    box = _BOX.replace("{}", told + key(prepared, track), 1)
    return write_beside(path, f"{head}{box}{end}{tail}".encode())


def _told(name: str, track: Track, unfolded: bool) -> str:
    """Return a line that unfolds into what each constraint does, and the charts, as HTML."""
    found = () if track.report is None else track.report.constraints
    lines = "".join(f"<div>{html.escape(str(each))}</div>" for each in found)
    drawn = "".join(chart(name, lines) for name, lines in curves(track).items())
    verdict = "" if track.report is None else f": {html.escape(track.report.verdict)}"
    return (
        f"<details{' open' * unfolded}><summary><b>{html.escape(name)}</b>{verdict}</summary>"
        f"{lines}{drawn}</details>"
    )


def _for_phones(drawing: Drawing) -> str:
    """Return a script by which an upright window sees what a wide one does.

    viser's page takes a camera from its address alone, and has no server here that could move it.
    """
    place, look_at = (point - drawing.middle for point in drawing.upright_camera(1.0))
    return f"""<script>
if (innerWidth < innerHeight) {{
  const url = new URL(location), middle = {drawing.middle.tolist()};
  const far = (from) => middle.map((x, i) => x + from[i] * innerHeight / innerWidth).join();
  url.searchParams.set("initialCameraPosition", far({place.tolist()}));
  url.searchParams.set("initialCameraLookAt", far({look_at.tolist()}));
  history.replaceState(null, "", url);
}}
</script>"""
