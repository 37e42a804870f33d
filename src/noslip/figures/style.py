"""What all figures share: colors, line styles, sizes, and saving."""

from __future__ import annotations

import io
import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import cycle, islice
from pathlib import Path
from textwrap import fill
from threading import Lock
from typing import Any, Literal

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.ticker import ScalarFormatter

from noslip._arguments import positive
from noslip._files import write_beside
from noslip._typing import Floats
from noslip.errors import InputError

PALETTE = {
    "blue": "#0072B2",
    "vermillion": "#D55E00",
    "green": "#009E73",
    "purple": "#CC79A7",
    "orange": "#E69F00",
    "sky": "#56B4E9",
    "black": "#000000",
    "gray": "#999999",
}
"""Okabe and Ito's colors, which the color-blind can tell apart; gray for their yellow, which
is too pale for a line on white."""

ONE_COLUMN, TWO_COLUMNS = 3.5, 7.16
"""Width of a figure over one column and over two columns of a page (inches): those of IEEE's
journals."""
COLUMNS = {1: (ONE_COLUMN, 2.2), 2: (TWO_COLUMNS, 2.6)}
"""Width and usual height of a paper's figure, by the columns that it goes over (inches)."""
FONT_SIZE, SMALL_FONT_SIZE = 8.0, 7.0
"""Of titles, and of everything else (points): as a caption beside text of 10."""
UNITS = r"(?:[mnµ]?m|s|rad)\b"
"""What the units of figures begin with."""
PAD = 0.07
"""Inches left and right of a panel with its labels: those of neighbors do not read as one."""
DPI = 200
"""Of a PNG: sharp on a screen of high density, and small enough for a web page."""
LONGEST_NAME = 40
"""Characters of a motion's name that a legend shows, the last ones: that of a file is in its
end."""

LEAST_TURN = 4.0
"""Degrees that an angle's axis spans at least: a tool that does not turn has a flat line."""
LEAST_SHARE = 0.04
"""Share of the path's extent that a coordinate's axis spans at least: rounding stays flat."""
FORBIDDEN_SHARE = 0.12
"""Share of a margin's axis below zero, and below the least margin, that is shown at least: what is
forbidden is always seen."""
DECADES = 1e-5
"""Share of the smallest curve's peak at which a logarithmic axis ends: zeros lie below."""

_REFERENCE = {"color": PALETTE["gray"], "linestyle": "-", "linewidth": 3.2, "zorder": 1.9}
"""What others are compared with lies below them, wide."""
_NAMED: dict[str, dict[str, Any]] = {
    "demonstration": _REFERENCE,
    "regular": {"color": PALETTE["blue"], "linestyle": "-", "linewidth": 1.1},
    "constrained": {"color": PALETTE["vermillion"], "linestyle": (0, (5, 2)), "linewidth": 1.4},
    "optimized": {"color": PALETTE["black"], "linestyle": (0, (1, 1.8)), "linewidth": 1.7},
}
"""Of the motions that every figure shows: the paper's four look alike everywhere."""
_DASHES: tuple[Any, ...] = ("-", (0, (5, 2)), (0, (1, 1.8)), (0, (5, 1.5, 1, 1.5)))
"""Of further motions, which differ by them where colors recur."""
_SAVING = Lock()
"""Matplotlib's settings are the process's: one figure is written at a time."""


Styles = Mapping[str, dict[str, Any]]
"""Of lines, by the names of motions."""
MOST_NAMED = 8
"""Motions that get a color and a name each; more of them share one color, for colors can no longer
be told apart."""
MANY: dict[str, Any] = {"color": PALETTE["sky"], "linestyle": "-", "linewidth": 0.6}
"""Thin, so that many can cross."""


def line_styles(names: Iterable[str], apart: Iterable[str] = ()) -> dict[str, dict[str, Any]]:
    """Return color, dashes and width of the line of each motion.

    The motions of the paper have styles of their own: the demonstration is broad and gray and
    lies underneath, the regular primitive is solid, the constrained one dashed, the optimized one
    dotted, so that lines which coincide are all seen.  Others take the remaining colors in turn;
    of more than 8 motions they share one thin line, but for those that are told apart.
    """
    names, apart = list(names), list(apart)
    if len(names) > MOST_NAMED:
        own = line_styles([name for name in names if name in _NAMED or name in apart][:MOST_NAMED])
        # What has a line of its own lies above all others.
        return {name: {"zorder": 2.5} | own[name] if name in own else MANY for name in names}
    styles: dict[str, dict[str, Any]] = {}
    free = zip(cycle(c for c in PALETTE.values() if c != PALETTE["gray"]), cycle(_DASHES))
    taken = {_NAMED[name]["color"] for name in names if name in _NAMED}
    for name in names:
        if name in _NAMED:
            styles[name] = dict(_NAMED[name])
            continue
        color, dashes = next(free)
        while color in taken and len(names) < len(PALETTE):
            color, dashes = next(free)
        styles[name] = {"color": color, "linestyle": dashes, "linewidth": 1.2}
    return styles


def trial_styles(count: int) -> list[dict[str, Any]]:
    """Return one thin line's style a trial: a color each, then the same colors dashed.

    Of more trials than can be told apart all are the same.
    """
    if count > len(PALETTE) * len(_DASHES):
        return [MANY] * count
    looks = ((color, dashes) for dashes in cycle(_DASHES) for color in PALETTE.values())
    return [
        {"color": color, "linestyle": dashes, "linewidth": 1.1}
        for color, dashes in islice(looks, count)
    ]


def joint_styles(count: int) -> list[dict[str, Any]]:
    """Return one thin line's style a joint: a color each, none of them gray or black.

    Those are left for motions drawn beside them, and for limits.
    """
    colors = [color for name, color in PALETTE.items() if name not in ("gray", "black")]
    looks = ((color, dashes) for dashes in cycle(_DASHES) for color in colors)
    return [
        {"color": color, "linestyle": dashes, "linewidth": 1.1}
        for color, dashes in islice(looks, count)
    ]


class Picture(Figure):
    """A figure that a notebook shows by itself, though no window of pyplot knows it."""

    def _repr_png_(self) -> bytes:
        data = io.BytesIO()
        self.savefig(data, format="png")
        return data.getvalue()


class _Layout(ConstrainedLayoutEngine):
    """Constrained layout to nine digits: its solver's rounding depends on addresses in memory.

    An SVG's identifiers are hashes of places, so that the same figure would have other bytes.
    """

    def execute(self, fig: Figure) -> Any:
        found = super().execute(fig)
        for ax in fig.axes:
            was = ax.get_in_layout()
            place = ax.get_position(original=True)
            left, bottom, width, height = np.round(place.bounds, 9).tolist()
            ax.set_position((left, bottom, width, height))
            ax.set_in_layout(was)
        return found


def new_figure(
    width: float, height: float, *, layout: Literal["constrained"] | None = "constrained"
) -> Figure:
    """Return an empty figure (inches), of no window and of no global state."""
    engine = _Layout(w_pad=PAD) if layout else None
    figure = Picture(figsize=(width, height), dpi=DPI, layout=engine, facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def column_figure(columns: Literal[1, 2] = 1, height: float | None = None) -> Figure:
    """Return an empty figure as wide as one column of a paper, or two (IEEE: 3.5 or 7.16 inches).

    Text drawn by this package's functions is 7 and 8 points high in it: include it unscaled.

    Parameters
    ----------
    columns : 1 or 2
    height : float, optional
        Inches; by default 2.2 of one column, 2.6 of two.
    """
    if columns not in COLUMNS:
        raise InputError(f"column_figure is 1 or 2 columns wide, got {columns!r}")
    width, usual = COLUMNS[columns]
    return new_figure(width, usual if height is None else positive("height", height, "inches"))


def write_title(figure: Figure, title: str) -> None:
    """Put the finding above a figure, in as many lines as its width asks for."""
    characters = int(figure.get_figwidth() * 72 / (0.64 * FONT_SIZE))
    # A number stays beside its unit.
    bound = re.sub(rf"(?<=\d) (?=%|{UNITS})", "\xa0", title)
    lines = [fill(line, characters).replace("\xa0", " ") for line in bound.splitlines()]
    figure.suptitle("\n".join(lines), fontsize=FONT_SIZE, fontweight="bold")


def write_note(figure: Figure, text: str) -> None:
    """Put a remark below the panels of a figure, above its legend, which is there already."""
    characters = int(figure.get_figwidth() * 72 / (0.55 * SMALL_FONT_SIZE))
    look: Any = {"fontsize": SMALL_FONT_SIZE, "color": "0.3"}
    if figure.legends:
        figure.legends[0].set_title(fill(text, characters))
        figure.legends[0].get_title().set(**look)
    else:
        figure.supxlabel(fill(text, characters), **look)


def name_lines(figure: Figure, names: Iterable[str], styles: Styles | None = None) -> None:
    """Put the legend of the motions' lines below a figure, in as many columns as fit.

    Lines of one style that many share are named once, with their number.
    """
    names = list(names)
    styles = styles or line_styles(names)
    own = {name: styles[name] for name in names if styles[name] is not MANY}
    shared = len(names) - len(own)
    others = {f"{shared} {'others' if own else 'motions'}": MANY} if shared else {}
    put_legend(figure, own | others)


def put_legend(figure: Figure, handles: Mapping[str, Artist | dict[str, Any]]) -> None:
    """Put a legend of artists, or of lines by their styles, below a figure."""
    labels = [short_name(name) for name in handles]
    # An entry is its handle, as wide as 8 characters, its label and the space between columns.
    characters = figure.get_figwidth() * 72 / (0.52 * SMALL_FONT_SIZE)
    columns = max(1, min(len(labels), int(characters / (max(map(len, labels)) + 14))))
    # Rows of one length, rather than a last one of what is left.
    columns = -(-len(labels) // -(-len(labels) // columns))
    figure.legend(
        [Line2D([], [], **h) if isinstance(h, dict) else h for h in handles.values()],
        labels,
        loc="outside lower center" if figure.get_layout_engine() else "lower center",
        ncols=columns,
        fontsize=SMALL_FONT_SIZE,
        frameon=False,
        handlelength=3.5,
    )


def draw_curves(
    ax: Axes, curves: Mapping[str, tuple[Floats, Floats]], styles: Styles | None = None
) -> list[Line2D]:
    """Draw a line a motion, in its style."""
    styles = styles or line_styles(curves)
    return [
        line
        for name, curve in curves.items()
        for line in ax.plot(*curve, label=short_name(name), **styles[name])
    ]


def dress(ax: Axes, xlabel: str, ylabel: str, *, title: str | None = None) -> None:
    """Give axes their labels, readable sizes and a faint grid."""
    ax.set_xlabel(fill(xlabel, 40), fontsize=SMALL_FONT_SIZE)
    ax.set_ylabel(fill(ylabel, 26), fontsize=SMALL_FONT_SIZE)
    if title is not None:
        ax.set_title(title, fontsize=SMALL_FONT_SIZE)
    ax.tick_params(labelsize=SMALL_FONT_SIZE)
    ax.grid(True, color="0.9", linewidth=0.6)
    ax.set_axisbelow(True)
    for axis in (ax.xaxis, ax.yaxis):
        axis.get_offset_text().set_fontsize(SMALL_FONT_SIZE)
        if isinstance(formatter := axis.get_major_formatter(), ScalarFormatter):
            formatter.set_useOffset(False)


def with_places(title: str, places: Iterable[str]) -> str:
    """Return a title with what is drawn of places below it, if anything is."""
    return "\n".join(filter(None, [title, ", ".join(places)]))


def stack(figure: Figure, panels: Sequence[Axes]) -> None:
    """Let panels that stand above each other say once, below, what their x axes show."""
    for ax in panels[:-1]:
        ax.set_xlabel("")
        ax.tick_params(labelbottom=False)
    figure.align_ylabels(panels)


def span_at_least(ax: Axes, curves: Iterable[Floats], least: float) -> None:
    """Keep rounding errors from filling an axis."""
    curves = list(curves)
    low, high = min(c.min() for c in curves), max(c.max() for c in curves)
    missing = max(0.0, (least or 1.0) - (high - low)) / 2
    margin = 0.06 * max(high - low, least or 1.0)
    ax.set_ylim(low - missing - margin, high + missing + margin)


def shade_forbidden(ax: Axes, curves: Iterable[Floats], least: float) -> None:
    """Gray and hatch where margins, in the axis' unit, are negative; zero is always in sight."""
    curves = list(curves)
    low, high = min(0.0, *(c.min() for c in curves)), max(0.0, *(c.max() for c in curves))
    span = max(high - low, least)
    bottom = low - FORBIDDEN_SHARE * span
    ax.set_ylim(bottom, low + 1.06 * span)
    ax.axhspan(bottom, 0, facecolor="0.93", edgecolor="0.78", hatch="////", linewidth=0, zorder=0.5)
    ax.axhline(0, color=PALETTE["gray"], linewidth=0.8, zorder=1)


def log_axis(ax: Axes, sizes: Iterable[Floats], least_top: float) -> None:
    """Make the y axis logarithmic over the decades of sizes; zeros lie below its end."""
    positive = [size[size > 0] for size in sizes if size.any()]
    if positive:
        low = min(size.min() for size in positive)
        floor = DECADES * min(size.max() for size in positive)
        top = max(size.max() for size in positive)
        ax.set_ylim(max(low / 3, floor), max(top * 3, least_top))
        ax.set_yscale("log")


def short_name(name: str) -> str:
    """Return a name that fits a legend: of a long path the file, of a long name the end."""
    if len(name) > LONGEST_NAME:
        name = re.split(r"[/\\]", name)[-1]
    if len(name) > LONGEST_NAME:
        name = "…" + name[1 - LONGEST_NAME :]
    # To matplotlib, dollars enclose a formula and an underscore in front says "not in a legend".
    return re.sub("^_", " _", name.replace("$", r"\$"))


def capitalized(name: str) -> str:
    """Return a name as a sentence begins with it; a file's name stays as it is."""
    return name if set(name) & set("./\\") else name[:1].upper() + name[1:]


def number(value: float) -> str:
    """Return a number with two or three digits, with an exponent where it needs one."""
    if value == 0 or 1e-3 <= abs(value) < 999.5:
        return f"{value:.3g}"
    return f"{value:.1e}".replace("e-0", "e-").replace("e+0", "e").replace("e+", "e")


def save_figure(figure: Figure, path: str | Path) -> list[Path]:
    """Write a figure as PNG (200 dpi) and SVG, or as what the path ends in; return the paths.

    The same figure gives the same bytes.  No file is ever there by half.

    Parameters
    ----------
    figure : Figure
    path : path
        ``results/comparison`` gives ``results/comparison.png`` and ``results/comparison.svg``;
        ``comparison.png``, ``.svg`` or ``.pdf`` that file alone.

    Raises
    ------
    InputError
        If a file cannot be written.
    """
    own = Path(path).suffix
    files = {path: own} if own in _METADATA else {f"{path}{s}": s for s in (".png", ".svg")}
    return [write_beside(file, rendered(figure, suffix)) for file, suffix in files.items()]


_METADATA: dict[str, dict[str, Any]] = {
    ".png": {"Software": None},
    ".svg": {"Date": None, "Creator": None},
    ".pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}
"""Formats, and what of their metadata differs from one run or version to the next."""


_SETTINGS: dict[Any, Any] = {"svg.hashsalt": "noslip", "pdf.fonttype": 42}
"""Global settings of matplotlib: the salt of an SVG's identifiers, random by default; fonts in PDF
as TrueType, because publishers refuse Type 3, its default."""


def rendered(figure: Figure, suffix: str) -> bytes:
    """Return a figure as the content of a .png, .svg or .pdf file."""
    buffer = io.BytesIO()
    with _SAVING, mpl.rc_context(_SETTINGS):
        figure.savefig(buffer, format=suffix[1:], dpi=DPI, metadata=_METADATA[suffix])
    return buffer.getvalue()
