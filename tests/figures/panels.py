"""Where tests find things in a drawn figure."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure


def panel(figure: Figure, ylabel: str) -> Axes:
    """The axes over time of that y label; its line breaks do not count."""
    over_time = [ax for ax in figure.axes if not ax.get_title().startswith("path")]
    (found,) = [ax for ax in over_time if ax.get_ylabel().replace("\n", " ") == ylabel]
    return found


def title_of(figure: Figure) -> str:
    return figure.get_suptitle().replace("\n", " ")
