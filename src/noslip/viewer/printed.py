"""Charts as SVG, for a page where nothing computes: the page's own, drawn once."""

from __future__ import annotations

import html
from collections.abc import Mapping

import numpy as np

from noslip._typing import Floats
from noslip.figures.style import PALETTE
from noslip.viewer.charts import LINES, axis_range, title

WIDTH, HEIGHT = 360.0, 150.0
"""Of a chart, in its own units; the page scales it to the space that there is."""
_LEFT, _RIGHT, _TOP, _BOTTOM = 48.0, 350.0, 20.0, 108.0
"""Ends of its axes: left, right, above and below is text."""
_TICKS = 4
"""Numbers along an axis, about."""


def chart(name: str, curves: Mapping[str, Floats]) -> str:
    """Return one of :func:`noslip.viewer.charts.curves` as SVG.

    Its upright line of class ``now`` says in its data which times its ends are.
    """
    times = curves["t"]
    start, end = float(times[0]), float(times[-1])
    low, high = axis_range(name, curves)

    def x(time: Floats | float) -> Floats:
        return np.asarray(_LEFT + (_RIGHT - _LEFT) * (time - start) / (end - start))

    def y(value: Floats | float) -> Floats:
        return np.asarray(_BOTTOM - (_BOTTOM - _TOP) * (value - low) / (high - low))

    lines = [
        f'<line x1="{_LEFT}" x2="{_RIGHT}" y1="{y(v):.1f}" y2="{y(v):.1f}" stroke="#ddd"/>'
        f'<text x="{_LEFT - 5}" y="{y(v) + 3:.1f}" text-anchor="end">{v:g}</text>'
        for v in ticks(low, high)
    ]
    lines += [
        f'<text x="{x(t):.1f}" y="{_BOTTOM + 12}" text-anchor="middle">{t:g}</text>'
        for t in ticks(start, end)
    ]
    named = [key for key in curves if key != "t"]
    across = (WIDTH - 10) / len(named)
    for number, key in enumerate(named):
        color = PALETTE[LINES[number % len(LINES)]]
        points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x(times), y(curves[key]), strict=True))
        lines += [
            f'<polyline points="{points}" fill="none" stroke="{color}" stroke-width="1.5"/>',
            f'<text x="{10 + number * across:.0f}" y="{HEIGHT - 8}" fill="{color}">'
            f"{html.escape(key)}</text>",
        ]
    lines.append(
        f'<line class="now" x1="{_LEFT}" x2="{_LEFT}" y1="{_TOP}" y2="{_BOTTOM}" stroke="#666" '
        f'data-start="{start:g}" data-end="{end:g}" data-left="{_LEFT}" data-right="{_RIGHT}"/>'
    )
    heading = html.escape(title(name, curves))
    return (
        f'<svg viewBox="0 0 {WIDTH:g} {HEIGHT:g}" font-size="10" fill="#444" role="img" '
        f'aria-label="{heading}"><text x="{WIDTH / 2}" y="12" text-anchor="middle">{heading}'
        f'</text>{"".join(lines)}<text x="{(_LEFT + _RIGHT) / 2}" y="{_BOTTOM + 24}" '
        f'text-anchor="middle">t (s)</text></svg>'
    )


def ticks(low: float, high: float) -> Floats:
    """Return round numbers within two ends: 1, 2 or 5 times a power of ten apart."""
    raw = (high - low) / _TICKS
    power = 10.0 ** np.floor(np.log10(raw))
    step = next(s for s in (1.0, 2.0, 5.0, 10.0) if s * power >= raw) * power
    found = step * np.arange(np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1)
    return np.asarray(np.round(found, 12) + 0.0)
