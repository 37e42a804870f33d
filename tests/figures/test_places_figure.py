"""What limits of the position forbid, in views of a path: where it is, and only there."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.proj3d import proj_transform
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.constraints import Box, FixedPoint, HalfSpace, PlaneContact, SphereContact
from noslip.figures import adapted_family, bodies_paths, plot_path, plot_tool_frame, style


def line(height: float = 0.0) -> ns.PoseTrajectory:
    """1 m along x."""
    s = np.linspace(0, 1, 21)
    path = np.column_stack([s, 0 * s, 0 * s + height])
    return ns.PoseTrajectory(s, path, Rotation.identity(21))


def drawn(constraints, *, plane="XY", motion=None):
    """Axes, and the vertices of the hatched region's edge and of other contours."""
    ax = Figure().subplots()
    plot_path(ax, motion or line(), constraints, plane=plane)
    edges = [c for c in ax.collections if not any(getattr(c, "hatches", None) or [])]
    points = [p.vertices for c in edges for p in c.get_paths() if len(p.vertices)]
    hatched = [c for c in ax.collections if any(getattr(c, "hatches", None) or [])]
    return ax, (np.concatenate(points) if points else np.zeros((0, 2))), hatched


@pytest.mark.parametrize("height", [0.0, 0.06])
def test_a_ball_is_the_circle_in_which_the_paths_plane_cuts_it(height):
    ball = ns.KeepOutSphere(center=(0.5, 0.3, 0.0), radius=0.1)
    ax, edge, hatched = drawn(ball, motion=line(height))
    radius = np.sqrt(0.1**2 - height**2)
    away = np.linalg.norm(edge - [0.5, 0.3], axis=1)
    np.testing.assert_allclose(away, radius, atol=2e-3)
    assert len(edge) > 20 and len(hatched) == 1
    assert "hatched: forbidden" in ax.get_title()
    # All of it is in sight, and to scale.
    assert ax.get_ylim()[1] >= 0.3 + radius - 0.03
    assert ax.get_aspect() == 1


def test_what_lies_above_is_outlined_alone():
    ball = ns.KeepOutSphere(center=(0.5, 0.3, 0.4), radius=0.1)
    ax, edge, hatched = drawn(ball)
    assert not hatched and "dashed: forbidden above or below" in ax.get_title()
    assert np.linalg.norm(edge - [0.5, 0.3], axis=1).max() == pytest.approx(0.1, abs=5e-3)
    _, _, hatched = drawn(ball, plane="YZ")
    assert len(hatched) == 1


def test_planes_and_boxes_are_hatched_on_the_side_that_is_forbidden():
    aside = HalfSpace(point=(0, -0.2, 0), normal=(0, 1, 0))
    _, edge, (region,) = drawn(aside)
    np.testing.assert_allclose(edge[:, 1], -0.2, atol=1e-9)
    assert all(path.vertices[:, 1].max() <= -0.2 + 1e-9 for path in region.get_paths())
    box = Box(lower=(-0.3, None, None), upper=(None, 0.4, None))
    _, edge, _ = drawn(box)
    assert np.all((np.abs(edge[:, 0] + 0.3) < 1e-2) | (np.abs(edge[:, 1] - 0.4) < 1e-2))


def test_a_tools_point_is_where_the_tool_has_it():
    wall = HalfSpace(point=(0, -0.2, 0), normal=(0, 1, 0), reference_point=(0, -0.05, 0))
    _, edge, _ = drawn(wall)
    np.testing.assert_allclose(edge[:, 1], -0.15, atol=1e-9)


def test_contacts_are_lines_and_points_that_stay_are_marked():
    ball = SphereContact(center=(0.5, 0.0, 0.0), radius=0.2)
    ax, edge, hatched = drawn(ball)
    assert not hatched and "line: contact" in ax.get_title()
    np.testing.assert_allclose(np.linalg.norm(edge - [0.5, 0], axis=1), 0.2, atol=2e-3)
    ax, _, _ = drawn(FixedPoint(point=(0.2, 0.7, 0)))
    assert [0.2, 0.7] in [list(mark.get_xydata()[0]) for mark in ax.lines]


def test_what_has_no_place_in_the_view_is_not_drawn():
    for constraint in (ns.Blade(), ns.SpeedLimit(), PlaneContact(), HalfSpace(point=(0, 0, -1))):
        ax, edge, hatched = drawn(constraint)
        assert not len(edge) and not hatched
        assert ax.get_title() == "path from above (○ start, ■ end)"
    ax, *_ = drawn(())
    alone = Figure().subplots()
    plot_path(alone, line(), plane="XY")
    assert ax.get_xlim() == alone.get_xlim()


def test_a_rule_of_ones_own_is_drawn_as_any_other():
    @ns.keep_nonnegative(level="position")
    def hill(motion):
        return 0.3 - motion.position[1] - 0.2 * motion.position[0]

    _, edge, (_,) = drawn(hill)
    np.testing.assert_allclose(edge[:, 1], 0.3 - 0.2 * edge[:, 0], atol=1e-9)


def holes(ax):
    """Middle and radius of each hatched region of an axes."""
    hatched = [c for c in ax.collections if any(getattr(c, "hatches", None) or [])]
    found = []
    for region in hatched:
        edge = np.concatenate([path.vertices for path in region.get_paths()])
        low, high = edge.min(axis=0), edge.max(axis=0)
        found.append([*(low + high) / 2, *(high - low) / 2])
    return np.array(found)


def test_each_body_has_its_own_obstacles_in_the_world_and_in_the_other_body():
    tray = line()
    hand = ns.PoseTrajectory(tray.times, tray.positions[:, [1, 0, 2]], tray.rotations)
    own = [ns.KeepOutSphere(center=(0.3 * k, 0.5, 0.0), radius=0.1) for k in (1, 2, -2)]
    rules = [
        ns.constraints.of(own[0], "hand"),
        ns.constraints.of(own[1], "tray"),
        ns.constraints.relative_to(own[2], "hand", "tray"),
        ns.Blade(),
    ]
    figure = bodies_paths(ns.Bodies(hand=hand, tray=tray), rules)
    world, seen, violated = figure.axes
    np.testing.assert_allclose(
        holes(world), [[0.3, 0.5, 0.1, 0.1], [0.6, 0.5, 0.1, 0.1]], atol=4e-3
    )
    np.testing.assert_allclose(holes(seen), [[-0.6, 0.5, 0.1, 0.1]], atol=4e-3)
    assert "hatched: forbidden" in world.get_title() and "hatched" in seen.get_title()
    # What is never violated has no line, and is named; the title tells what is.
    assert violated.get_ylabel() == "violation (SI)"
    told = figure.legends[0].get_title().get_text().replace("\n", " ")
    assert told.endswith("never violated: keep-out-sphere of hand, keep-out-sphere of tray")
    assert figure.get_suptitle().replace("\n", " ").endswith("; the other 2 hold")


def test_what_is_in_the_way_of_a_family_is_drawn_with_it():
    ball = ns.KeepOutSphere(center=(0.5, 0.3, 0.0), radius=0.1)
    goal = ns.Boundary(1, line().positions[-1])
    figure = adapted_family(line(), {"far": line()}, {"far": goal}, ball)
    np.testing.assert_allclose(holes(figure.axes[0]), [[0.5, 0.3, 0.1, 0.1]], atol=4e-3)
    assert figure.axes[0].get_title().endswith("\nhatched: forbidden")


@pytest.mark.parametrize("seed", range(5))
def test_the_names_of_a_tools_axes_lie_on_no_arrow(seed):
    rotation = Rotation.random(rng=seed)
    figure = style.new_figure(3.5, 3.5)
    ax = figure.add_subplot(projection="3d")
    _, *arrows = plot_tool_frame(ax, rotation)
    figure.canvas.draw()
    names = [text.get_window_extent() for text in ax.texts]
    for arrow in arrows[:3]:
        shaft = np.array(arrow._segments3d[0])
        along = shaft[0] + np.linspace(0, 1, 50)[:, None] * (shaft[-1] - shaft[0])
        x, y, _ = proj_transform(*along.T, ax.get_proj())
        places = ax.transData.transform(np.column_stack([x, y]))
        for name in names[:3]:
            assert not any(name.contains(*place) for place in places)
