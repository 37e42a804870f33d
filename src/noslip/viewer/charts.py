"""Charts beside the scene: residuals, margins and force over time, with a cursor at an instant."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from noslip._typing import Floats
from noslip.figures.style import PALETTE
from noslip.viewer.track import Track, group_starts

CHART_POINTS = 200
"""Of a line in a chart: on a panel so narrow, more could not be told apart."""
LEAST_RESIDUAL = 1e-10
"""Where a logarithmic axis ends: what rounding leaves lies below, and tells nothing."""
PAUSE = 0.15
"""Seconds between two pictures of the charts while a motion plays: all their curves are sent."""
TITLES = {
    "residual": "residual, log₁₀ of {}",
    "margin": "least margin of the limits, {}",
    "force": "constraint force, {}",
}
"""Of the charts, in the order in which they stand, and where their units go."""
LINES = ("blue", "vermillion", "green", "purple", "orange", "sky")
"""Colors of a chart's lines, in the palette's names; the more lines, the fainter."""


class Charts:
    """The charts of one motion in a folder of the panel."""

    def __init__(self, gui: Any) -> None:
        self._gui, self._folder = gui, gui.add_folder("Over time")
        self._handles: dict[str, Any] = {}
        self._curves: dict[str, dict[str, Floats]] = {}
        self._ranges: dict[str, tuple[float, float]] = {}
        self._drawn = -np.inf

    def draw(self, track: Track, instant: float) -> None:
        """Draw the charts of a motion anew, with the cursor at an instant (s)."""
        for handle in self._handles.values():
            handle.remove()
        self._curves = curves(track)
        self._ranges = {name: axis_range(name, lines) for name, lines in self._curves.items()}
        self._handles = {name: self._add(name, instant) for name in self._curves}
        self._folder.visible = bool(self._curves)

    def _add(self, name: str, instant: float) -> Any:
        names = [key for key in self._curves[name] if key != "t"]
        lines = [
            {"label": key, "stroke": PALETTE[LINES[i % len(LINES)]], "width": 1.5}
            for i, key in enumerate(names)
        ]
        now = {"label": "now", "stroke": PALETTE["gray"], "width": 1.5}
        with self._folder:
            return self._gui.add_uplot(
                self._columns(name, instant),
                ({"label": "t (s)"}, *lines, now),
                title=title(name, self._curves[name]),
                height=165,
                padding=(10, 24, 0, 0),
                scales={"x": {"time": False}, "y": {"range": self._ranges[name]}},
                axes=({"size": 30, "label": "t (s)", "labelSize": 16}, {"size": 62}),
                legend={"show": True, "live": False},
            )

    def move(self, instant: float, *, playing: bool) -> None:
        """Put the cursor to an instant (s); while a motion plays, only now and then."""
        if playing and time.monotonic() - self._drawn <= PAUSE:
            return
        self._drawn = time.monotonic()
        for name, handle in self._handles.items():
            handle.data = self._columns(name, instant)

    def _columns(self, name: str, instant: float) -> tuple[Floats, ...]:
        return tuple(cursor(self._curves[name], instant, *self._ranges[name]))


def curves(track: Track) -> dict[str, dict[str, Floats]]:
    """Curves over time, at most ``CHART_POINTS`` long; each chart has its times as ``t``.

    Residuals are decadic logarithms, the others in a unit in which they are not tiny.  The peaks of
    what is thinned out stay: the largest residual and force, the least margin.
    """
    starts = group_starts(len(track.clock), CHART_POINTS)
    found: dict[str, dict[str, Floats]] = {name: {} for name in TITLES}
    for name, size in track.sizes.items():
        largest = np.maximum(np.maximum.reduceat(size, starts), LEAST_RESIDUAL)
        found["residual"][f"{name} ({track.units[name]})"] = np.log10(largest)
    for name, margin in track.margins.items():
        scale, unit = _prefixed(track.units[name], float(np.abs(margin).max()))
        found["margin"][f"{name} ({unit})"] = scale * np.minimum.reduceat(margin, starts)
    if track.forces is not None:
        size = np.linalg.norm(track.forces, axis=1)
        scale, unit = _prefixed("m/s²", float(size.max()))
        found["force"][f"force ({unit})"] = scale * np.maximum.reduceat(size, starts)
    return {chart: {"t": track.clock[starts]} | lines for chart, lines in found.items() if lines}


def cursor(curves: Mapping[str, Floats], time: float, low: float, high: float) -> list[Floats]:
    """Columns of a chart with a vertical line at a time as its last: times, curves, line.

    The instant is inserted twice, so that the line is upright; everywhere else it is not a number.
    """
    times = curves["t"]
    time = float(np.clip(time, times[0], times[-1]))
    k = int(np.searchsorted(times, time))
    line = np.full(len(times), np.nan)
    columns = [np.insert(times, k, [time, time])]
    columns += [
        np.insert(curve, k, [np.interp(time, times, curve)] * 2)
        for name, curve in curves.items()
        if name != "t"
    ]
    return [*columns, np.insert(line, k, [low, high])]


def title(chart: str, curves: Mapping[str, Floats]) -> str:
    """Return what stands above a chart: what it shows, and in which units."""
    units = [name.rpartition(" (")[2][:-1] for name in curves if name != "t"]
    return TITLES[chart].format(", ".join(dict.fromkeys(units)))


def axis_range(chart: str, curves: Mapping[str, Floats]) -> tuple[float, float]:
    """Ends of a chart's axis: whole decades of a residual; else zero is always within."""
    lines = [line for name, line in curves.items() if name != "t"]
    low, high = min(line.min() for line in lines), max(line.max() for line in lines)
    if chart == "residual":
        return float(np.floor(low)), float(np.floor(high) + 1)
    low, high = min(low, 0.0), max(high, 0.0)
    room = 0.06 * (high - low) or 1.0
    return float(low - room), float(high + room)


def _prefixed(unit: str, peak: float) -> tuple[float, str]:
    """Factor and unit in which a quantity whose largest size is ``peak`` is not tiny."""
    if not unit.startswith("m") or peak >= 1:
        return 1.0, unit
    prefixes = ((1e3, "m"), (1e6, "µ"), (1e9, "n"))
    scale, prefix = next((found for found in prefixes if found[0] * peak >= 1), prefixes[-1])
    return scale, prefix + unit
