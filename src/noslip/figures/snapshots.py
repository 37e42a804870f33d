"""A blade drawn along its path in 3-D, to see whether it points where it goes."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle, product
from string import ascii_uppercase
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]
from mpl_toolkits.mplot3d.proj3d import proj_transform  # type: ignore[import-untyped]
from numpy.typing import NDArray
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip.constraints.blade import Blade
from noslip.constraints.edge_motion import edge_steps
from noslip.edge import Edge
from noslip.errors import InputError
from noslip.figures import style
from noslip.figures.quantities import Motions, extent, length_unit, named, value_text
from noslip.figures.residuals import finding, residual_rows
from noslip.trajectory import PoseTrajectory

PATH: dict[str, Any] = {"color": style.PALETTE["blue"], "linestyle": "-", "linewidth": 1.3}
"""Of the path that was taken."""
DESIRED: dict[str, Any] = {"color": style.PALETTE["black"], "linestyle": ":", "linewidth": 1.2}
"""Of the path that was asked for: dotted, above the one that was taken."""
AXIS: dict[str, Any] = {"color": style.PALETTE["green"], "linestyle": "-", "linewidth": 1.1}
"""Of the blade's travel axis: green, as velocities are in the viewer."""
SLIP_COLORS = LinearSegmentedColormap.from_list("slip", ["#DCE6EE", style.PALETTE["vermillion"]])
"""From none to all of the speed sideways: pale, so that a blade that does not slip stays in the
background."""

SCALPEL: Floats = np.array(
    [(0.00, 0.00), (-0.05, -0.05), (-0.14, -0.10), (-0.27, -0.12), (-0.40, -0.12)]
    + [(-0.45, -0.06), (-1.00, -0.06), (-1.00, 0.06), (-0.40, 0.06), (-0.30, 0.03)]
)
"""Outline of a blade and its handle in the body's x-z plane, the tip at the origin, length 1."""
BLADE_LENGTH = 0.33
"""Share of the path's largest extent, so that it is seen and neighbors can be told apart; meters,
of a tool that stays in place."""
FRAME_BLADE, FRAME_ELEVATION = 1.9, 26.0
"""Length of the blade beside its frame's axes, which have length 1; elevation of the eye
(degrees)."""
FRAME_NAMES = ("x̂, travel", "ŷ, lateral", "ẑ")
"""Of the body's axes."""
FRAME_COLORS = (style.PALETTE["vermillion"], style.PALETTE["green"], style.PALETTE["blue"])
"""Of the body's axes: the usual red, green and blue, for all to tell apart."""
ASLANT = 0.35
"""Share of an axis that leads sideways, or up, from which its name stands on that side of it."""
AXIS_NAME = 1.12
"""How far out along an axis its name begins, over the axis' length: past the arrow's head."""
WORLD_DROP, WORLD_SIZE = 1.5, 0.5
"""How far below the blade's tip the world's axes are drawn, and how long, smaller than its own."""
AT_REST = 1e-3
"""Share of the top speed below which a tool stands: it slips nowhere."""
VIEW = (55.0, -80.0)
"""Elevation and azimuth of the eye (degrees): from above the side that work in the plane faces."""
TITLE_ROOM, HEADING_ROOM, LEGEND_ROOM, BAR_ROOM, EDGE = 0.3, 0.6, 0.3, 0.65, 0.06
LABEL_ROOM, FOOT_ROOM = 0.5, 0.3
"""Inches for the text around panels: three-dimensional ones do not know how large it is."""
Place = tuple[float, float, float, float]
"""Of an axes in a figure: left, bottom, width and height, as shares."""


def blade_snapshots(
    motions: Motions,
    *,
    desired: PoseTrajectory | None = None,
    blades: int = 14,
    title: str | None = None,
) -> Figure:
    """Draw the blade along the path of each motion, a panel a motion, all to the same scale.

    A blade lies in the body's x-z plane with its tip on the path; the green arrow is the body's
    y axis, along which it must not move.  The blade's color is the share of the speed that
    nevertheless goes that way.

    Parameters
    ----------
    motions : PoseTrajectory or mapping of them by name
        The paper's figure has the demonstration, the constrained and the optimized motion.
    desired : PoseTrajectory, optional
        The path that should have been cut: dotted; the largest distance from it is told, and
        how far from its end the motion ends.
    blades : int
        How many to draw, equally far apart along the path.
    title : str, optional
        By default the finding: the lateral velocity of the last motion, and of the first.

    Raises
    ------
    InputError
        If there is no motion, or fewer than 2 blades are asked for.
    """
    shown = named(motions)
    if blades < 2:
        raise InputError(f"blade_snapshots draws 2 blades or more, got {blades}")
    scale, unit = length_unit(shown.values())
    size = BLADE_LENGTH * max(map(extent, shown.values())) or BLADE_LENGTH
    slips = residual_rows(shown, Blade())

    figure = style.new_figure(style.TWO_COLUMNS, style.TWO_COLUMNS, layout=None)
    panels: list[Any] = [figure.add_subplot(projection="3d") for _ in shown]
    for letter, ax, (name, motion) in zip(cycle(ascii_uppercase), panels, shown.items()):
        plot_blades(ax, motion, blades=blades, size=size, scale=scale)
        lines = []
        if len(shown) > 1:
            lines += [f"{letter}   {style.capitalized(style.short_name(name))}"]
            lines += [slips[0].slip_text(name)]
        if desired is not None:
            ax.plot(*(scale * desired.positions.T), zorder=3, **DESIRED)
            off = distance_to_path(motion.positions, desired.positions)
            missed = float(np.linalg.norm(motion.positions[-1] - desired.positions[-1]))
            lines += (
                [
                    f"leaves the path by up to {value_text(off, 'm')}",
                    f"ends {value_text(missed, 'm')} from its end",
                ]
                if off or missed
                else ["on the desired path"]
            )
        ax.set_title("\n".join(lines), fontsize=style.SMALL_FONT_SIZE, y=1)
    _frame(panels, unit)
    beside = _arrange(figure, panels)

    bar = figure.colorbar(ScalarMappable(Normalize(0, 100), SLIP_COLORS), cax=beside)
    bar.set_label("share of the speed along ŷ (%)", fontsize=style.SMALL_FONT_SIZE)
    bar.ax.tick_params(labelsize=style.SMALL_FONT_SIZE)
    styles = {"path": PATH, "ŷ, the blade's lateral axis": AXIS}
    if desired is not None:
        styles["desired path"] = DESIRED
    style.put_legend(figure, styles)
    style.write_title(figure, title or finding(slips, shown))
    return figure


def plot_blades(
    ax: Any,
    motion: PoseTrajectory,
    *,
    blades: int = 14,
    size: float | None = None,
    scale: float = 1.0,
) -> list[Artist]:
    """Draw a motion's path with blades along it into 3-D axes.

    Parameters
    ----------
    ax : Axes3D
    motion : PoseTrajectory
    blades : int
    size : float, optional
        Length of a blade and its handle (m); by default ``BLADE_LENGTH`` of the path's extent.
    scale : float
        Units of the axes a meter.

    Returns
    -------
    list
        The path's line, the blades' polygons and the lateral axes' arrows.
    """
    size = size or BLADE_LENGTH * extent(motion) or BLADE_LENGTH
    where = equally_far_apart(motion, blades)
    tips, corners = motion.positions[where], blade_corners(motion, where, size)
    arrows = 0.45 * size * Edge().lateral_axes(motion.rotations[where])

    (path,) = ax.plot(*(scale * motion.positions.T), zorder=2, **PATH)
    polygons = Poly3DCollection(
        list(scale * corners),
        facecolors=SLIP_COLORS(slip_shares(motion)[where]),
        edgecolors="0.25",
        linewidths=0.5,
        zorder=1,
    )
    ax.add_collection3d(polygons)
    # What lies on the path must be seen, whatever stands in front of it.
    ax.computed_zorder = False
    axes = ax.quiver(*(scale * tips.T), *(scale * arrows.T), zorder=4, **AXIS)
    ax.auto_scale_xyz(*(scale * np.concatenate([corners.reshape(-1, 3), tips + arrows]).T))
    return [path, polygons, axes]


def plot_tool_frame(ax: Any, rotation: Rotation) -> list[Artist]:
    """Draw a blade with its body-fixed frame, and the world's beside it, into 3-D axes.

    The paper's figure 2, left.  x leads along the edge, y, along which the blade must not move, is
    across, and z points out of the work.

    Parameters
    ----------
    ax : Axes3D
    rotation : Rotation
        Body to world, of the blade.

    Returns
    -------
    list
        The blade's polygon, then the axes' arrows: of the body x, y, z, of the world x, y, z.
    """
    outline = np.column_stack([SCALPEL[:, 0], np.zeros(len(SCALPEL)), SCALPEL[:, 1]])
    corners = rotation.apply(FRAME_BLADE * outline)
    polygon = Poly3DCollection([corners], facecolors="#DCE6EE", edgecolors="0.25", linewidths=0.6)
    ax.add_collection3d(polygon)
    ax.computed_zorder = False
    artists: list[Artist] = [polygon]
    frames: list[tuple[Floats, Floats, list[str], list[str], float]] = [
        (np.zeros(3), rotation.apply(np.eye(3)), list(FRAME_NAMES), list(FRAME_COLORS), 1.6),
        (np.array([0, 0, -WORLD_DROP]), WORLD_SIZE * np.eye(3), list("xyz"), ["0.45"] * 3, 0.9),
    ]
    tips, azimuth = [corners], _clearest_azimuth(rotation)
    right, up = _page_axes(azimuth)
    for origin, axes, names, colors, width in frames:
        for axis, name, color in zip(axes, names, colors, strict=True):
            arrow = ax.quiver(*origin, *axis, color=color, linewidth=width, arrow_length_ratio=0.15)
            arrow.set_zorder(4)
            artists.append(arrow)
            place = origin + AXIS_NAME * axis
            tips.append(np.stack([origin, origin + 1.22 * axis]))
            # Beside the arrow's tip on the side that it points to, so that it lies on no arrow.
            x, y = np.array([axis @ right, axis @ up]) / np.hypot(axis @ right, axis @ up)
            sides: dict[str, Any] = {
                "ha": "left" if x > ASLANT else "right" if x < -ASLANT else "center",
                "va": "bottom" if y > ASLANT else "top" if y < -ASLANT else "center",
            }
            ax.text(*place, name, color=color, fontsize=style.SMALL_FONT_SIZE, **sides)
    seen = np.concatenate(tips)
    low, high = seen.min(axis=0), seen.max(axis=0)
    for k, name in enumerate("xyz"):
        ax.set(**{f"{name}lim": (low[k], high[k]), f"{name}ticks": []})
    ax.set_box_aspect(high - low, zoom=1.25)
    ax.set_proj_type("ortho")
    ax.view_init(FRAME_ELEVATION, azimuth)
    ax.set_axis_off()
    # Names go on beyond the axes, and a neighbor's background would hide them.
    ax.patch.set_visible(False)
    return artists


def _clearest_azimuth(rotation: Rotation) -> float:
    """Azimuth (degrees) of an eye in front for which no axis of a frame hides another or is short.

    The smallest area between two axes of the body or of the world, as they are seen, is the
    largest.
    """
    frames = rotation.as_matrix().T, np.eye(3)

    def least_area(azimuth: float) -> float:
        right, up = _page_axes(azimuth)
        return min(
            abs(float(np.linalg.det([axes[[i, j]] @ right, axes[[i, j]] @ up])))
            for axes in frames
            for i, j in ((0, 1), (1, 2), (0, 2))
        )

    return float(max(range(-170, 0, 10), key=least_area))


def _page_axes(azimuth: float) -> tuple[Floats, Floats]:
    """World directions that lead to the right and up on the page, of an eye at an azimuth."""
    a, elevation = np.radians(azimuth), np.radians(FRAME_ELEVATION)
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    up = np.array([*(-np.sin(elevation) * np.array([np.cos(a), np.sin(a)])), np.cos(elevation)])
    return right, up


def blade_corners(motion: PoseTrajectory, where: NDArray[np.intp], size: float) -> Floats:
    """Return the blade's outline at some samples, shape (samples, corners, 3), meters, world."""
    outline = size * np.column_stack([SCALPEL[:, 0], np.zeros(len(SCALPEL)), SCALPEL[:, 1]])
    turned = np.einsum("nij,kj->nki", motion.rotations[where].as_matrix(), outline)
    return np.asarray(motion.positions[where, None] + turned)


def equally_far_apart(motion: PoseTrajectory, count: int) -> NDArray[np.intp]:
    """Return samples equally far apart along the path; in time, of a tool that stays in place."""
    steps = np.linalg.norm(np.diff(motion.positions, axis=0), axis=1)
    if not steps.any():
        steps = np.diff(motion.times)
    traveled = np.concatenate([[0.0], np.cumsum(steps)])
    nearest = np.searchsorted(traveled, np.linspace(0, traveled[-1], count))
    return np.unique(np.minimum(nearest, len(motion) - 1))


def slip_shares(motion: PoseTrajectory) -> Floats:
    """Share of the speed along the body's y axis in the step that ends at each sample, 0 to 1.

    The first sample has that of the first step.  A tool at rest does not slip.
    """
    steps = edge_steps(motion, Blade())
    speeds = np.linalg.norm(steps.velocities, axis=1)
    moving = speeds > AT_REST * speeds.max()
    shares = np.where(moving, np.abs(np.sin(steps.slip_angles)), 0.0)
    return np.concatenate([shares[:1], shares])


def distance_to_path(points: Floats, path: Floats) -> float:
    """Return the largest distance from points to the polyline through a path (m).

    Of each point, to the pieces of the path that meet at its nearest vertex.
    """
    nearest = KDTree(path).query(points)[1]
    distances = np.full(len(points), np.inf)
    for first in (nearest - 1, nearest):
        begin = path[np.clip(first, 0, len(path) - 1)]
        piece = path[np.clip(first + 1, 0, len(path) - 1)] - begin
        length = np.einsum("ni,ni->n", piece, piece)
        along = np.einsum("ni,ni->n", points - begin, piece) / np.where(length > 0, length, 1.0)
        foot = begin + np.clip(along, 0, 1)[:, None] * piece
        distances = np.minimum(distances, np.linalg.norm(points - foot, axis=1))
    return float(distances.max())


def _frame(panels: list[Any], unit: str) -> None:
    """Give all panels the same limits and view."""
    limits = np.array([_limits(ax) for ax in panels])
    low, high = limits[:, :, 0].min(axis=0), limits[:, :, 1].max(axis=0)
    spans = high - low
    for ax in panels:
        ax.set_proj_type("ortho")
        ax.view_init(*VIEW)
        ax.patch.set_visible(False)
        ax.tick_params(labelsize=style.SMALL_FONT_SIZE - 1, pad=-1.5)
        for index, name in enumerate("xyz"):
            ax.set(**{f"{name}lim": (low[index], high[index]), f"{name}label": f"{name} ({unit})"})
            axis = getattr(ax, f"{name}axis")
            axis.set_major_locator(MaxNLocator(max(1, round(4 * spans[index] / spans.max()))))
            axis.pane.set_facecolor("white")
            axis._axinfo["grid"].update(color="0.88", linewidth=0.5)


def _arrange(figure: Figure, panels: list[Any]) -> Axes:
    """Put panels of equal scales side by side, as large as they fit; return axes for a color bar.

    The layouts of matplotlib give 3-D axes a square each, of which a flat box fills little.
    """
    spans = np.ptp(_limits(panels[0]), axis=1)
    elevation, azimuth = np.radians(VIEW)
    turned = np.abs([[np.sin(azimuth), np.cos(azimuth)], [np.cos(azimuth), np.sin(azimuth)]])
    wide, deep = turned @ spans[:2]
    high = deep * np.sin(elevation) + spans[2] * np.cos(elevation)

    columns = min(len(panels), 3)
    rows = -(-len(panels) // columns)
    side = (style.TWO_COLUMNS - BAR_ROOM) / max(columns, 2)
    inches = (side - LABEL_ROOM) * min(1 / wide, 1 / high)
    pitch = HEADING_ROOM + inches * high + FOOT_ROOM
    width, height = columns * side + BAR_ROOM, TITLE_ROOM + rows * pitch + LEGEND_ROOM
    figure.set_size_inches(width, height)

    def place(left: float, bottom: float, wide: float, high: float) -> Place:
        return left / width, bottom / height, wide / width, high / height

    for index, ax in enumerate(panels):
        row, column = divmod(index, columns)
        center = (column + 0.5) * side - LABEL_ROOM / 2 + EDGE
        middle = height - TITLE_ROOM - row * pitch - HEADING_ROOM - inches * high / 2
        ax.set_position(place(center - side / 2, middle - side / 2, side, side))
        ax.title.set_position((0.5, 0.5 + (inches * high / 2 + EDGE) / side))
        ax.set_box_aspect(spans)
        ax.apply_aspect()
        drawn = np.ptp(_on_page(ax, list(product(*_limits(ax))))[:, 0]) / figure.dpi
        ax.set_box_aspect(spans, zoom=inches * wide / drawn)
        _label(ax)
    bar = min(1.6, height - TITLE_ROOM - LEGEND_ROOM)
    middle = (height - TITLE_ROOM + LEGEND_ROOM) / 2
    return figure.add_axes(place(width - BAR_ROOM + EDGE, middle - bar / 2, 0.1, bar))


def _label(ax: Any) -> None:
    """Write the axes' labels beside their edges; matplotlib's own places run into each other."""
    (left, right), (front, back), (low, high) = _limits(ax)
    edges = {
        "x": ([(left, front, low), (right, front, low)], (0, -17), 0),
        "y": ([(right, front, low), (right, back, low)], (25, 0), 90),
        "z": ([(right, back, low), (right, back, high)], (25, 0), 90),
    }
    for name, (edge, offset, angle) in edges.items():
        label = getattr(ax, f"{name}axis").label
        label.set_visible(False)
        ax.annotate(
            label.get_text(),
            ax.transData.inverted().transform(_on_page(ax, edge).mean(axis=0)),
            xytext=offset,
            textcoords="offset points",
            fontsize=style.SMALL_FONT_SIZE,
            rotation=angle,
            ha="center",
            va="center",
            annotation_clip=False,
        )


def _on_page(ax: Any, points: Sequence[tuple[float, ...]]) -> Floats:
    """Where 3-D points are drawn, in pixels, shape (N, 2)."""
    x, y, _ = proj_transform(*np.transpose(points), ax.get_proj())
    return np.asarray(ax.transData.transform(np.column_stack([x, y])))


def _limits(ax: Any) -> list[tuple[float, float]]:
    return [ax.get_xlim(), ax.get_ylim(), ax.get_zlim()]
