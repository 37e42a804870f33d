"""Pieces of HTML that the panel is made of, and numbers as its fields show them."""

from __future__ import annotations

import html
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from noslip.figures.style import PALETTE


def field_step(size: float) -> float:
    """Last digit of a field of lengths (m) in a scene of a size: 0.1 mm of one of 10 cm."""
    return float(10.0 ** np.floor(np.log10(size) - 3 + 1e-9))


def plain(vector: ArrayLike, step: float) -> tuple[float, ...]:
    """Return numbers for a field with a step: what it would show as a negative zero is zero."""
    return tuple(
        0.0 if abs(x) < step / 2 else float(x)
        for x in np.round(np.asarray(vector, dtype=np.float64), 7)
    )


def pad(content: str) -> str:
    """Return HTML with the panel's own margins."""
    return f'<div style="padding:4px 12px;font-size:13px;line-height:1.4">{content}</div>'


def note(text: str, color: str = "black") -> str:
    """Return text as HTML, in a color of the palette; nothing for no text."""
    lines = html.escape(text).replace("\n", "<br>")
    return pad(f'<span style="color:{PALETTE[color]}">{lines}</span>') if text else ""


def table(texts: Mapping[str, str]) -> str:
    """Return labels and texts as rows of HTML."""
    rows = "".join(
        f'<tr><td style="color:#666;padding-right:10px">{html.escape(label)}</td>'
        f'<td style="font-variant-numeric:tabular-nums">{html.escape(text)}</td></tr>'
        for label, text in texts.items()
    )
    return pad(f"<table>{rows}</table>")
