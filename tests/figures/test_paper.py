"""Figures for papers: axis-level functions in figures of one and two columns, in either unit."""

from __future__ import annotations

import re
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import noslip as ns
from learned import under
from noslip import figures
from noslip.errors import InputError
from noslip.figures.learned_spread import QUANTITIES, turns

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "paper_figure.py"


def cut(aside: float = 0.0) -> ns.PoseTrajectory:
    """10 cm in 4 s, the blade only roughly along the path."""
    s = np.linspace(0, 1, 81)
    path = np.column_stack([0.1 * s, 0.02 * np.sin(2 * np.pi * s) + aside * s * (1 - s), 0 * s])
    yaw = 0.9 * np.cos(2 * np.pi * s)
    return ns.PoseTrajectory(4 * s, path, Rotation.from_euler("z", yaw), name="demonstration")


@pytest.fixture(scope="module")
def dmp():
    return ns.learn([cut(aside) for aside in (-0.004, 0.0, 0.004)], ns.Blade(), basis_functions=20)


def data(lines):
    return [line.get_xydata() for line in lines]


def test_an_orientation_in_radians_is_the_one_in_degrees():
    ax = figures.column_figure().subplots()
    (degrees,) = data(figures.plot_orientation(ax, cut()))
    assert ax.get_ylabel() == "yaw (°)"
    (radians,) = data(figures.plot_orientation(ax, cut(), degrees=False))
    assert ax.get_ylabel() == "yaw (rad)"
    yaw = cut().rotations.as_euler("xyz")[:, 2]
    np.testing.assert_allclose(radians[:, 1], yaw, atol=1e-12)
    np.testing.assert_allclose(degrees[:, 1], np.degrees(yaw), atol=1e-10)
    low, high = ax.get_ylim()
    assert low < yaw.min() and yaw.max() < high < 1.2


def test_a_speed_is_the_way_of_a_step_over_its_time():
    motion, ax = cut(), figures.column_figure().subplots()
    (drawn,) = data(figures.plot_speed(ax, motion))
    assert ax.get_ylabel() == "speed (mm/s)"
    ways = np.linalg.norm(np.diff(motion.positions, axis=0), axis=1)
    np.testing.assert_allclose(drawn[:, 1], 1e3 * ways / np.diff(motion.times))
    np.testing.assert_array_equal(drawn[:, 0], motion.times[1:])


@pytest.mark.parametrize(("degrees", "factor", "unit"), [(False, 1.0, "rad"), (True, 57.2958, "°")])
def test_an_angular_speed_is_the_turn_of_a_step_over_its_time(degrees, factor, unit):
    motion, ax = cut(), figures.column_figure().subplots()
    (drawn,) = data(figures.plot_speed(ax, motion, "angular", degrees=degrees))
    assert ax.get_ylabel() == f"angular speed ({unit}/s)"
    turned = (motion.rotations[1:] * motion.rotations[:-1].inv()).magnitude()
    np.testing.assert_allclose(drawn[:, 1], factor * turned / np.diff(motion.times), rtol=1e-5)


def test_a_spread_is_drawn_in_degrees_and_in_radians(dmp):
    motion = dmp.rollout()
    for axis, name in enumerate("xyz"):
        for degrees, scale, unit in ((True, np.degrees(1.0), "°"), (False, 1.0, "rad")):
            ax = figures.column_figure().subplots()
            outer, inner, line = figures.plot_learned_spread(
                ax, dmp, f"turned about {name}", degrees=degrees
            )
            assert ax.get_ylabel() == f"turned about {name} ({unit})"
            np.testing.assert_allclose(line.get_ydata(), scale * turns(motion)[:, axis])
            wide, narrow = (np.ptp(a.get_paths()[0].vertices[:, 1]) for a in (outer, inner))
            assert wide >= narrow
    assert len(QUANTITIES) == 6


def test_ellipses_lie_along_the_path(dmp):
    ax = figures.column_figure().subplots()
    line, *ellipses = figures.plot_ellipses(ax, dmp)
    path = line.get_xydata()
    assert len(ellipses) == 11
    np.testing.assert_allclose(path, 1e3 * dmp.rollout().positions[:, :2])
    for ellipse in ellipses:
        middle = ellipse.get_xy()[:-1].mean(axis=0)
        assert np.linalg.norm(path - middle, axis=1).min() < 1.0


def test_one_constraint_of_a_rollout_is_drawn_as_it_was(dmp):
    box = ns.constraints.Box(upper=(0.2, 0.01, 1.0))
    held = (ns.Blade(), box)
    motion = under(dmp, held).rollout()
    drawn = {}
    for show, axis in (("residual", "margin (m)"), ("multiplier", "multiplier (m/s²)")):
        ax = figures.column_figure().subplots()
        drawn[show] = data(figures.plot_constraint(ax, motion, held, "box", show))
        assert ax.get_ylabel().replace("\n", " ") == axis
    sides = len(motion.limit_names)
    for row in range(sides):
        np.testing.assert_allclose(drawn["residual"][row][:, 1], motion.margins[:, row])
        multipliers = motion.limit_multipliers[:, row]
        np.testing.assert_array_equal(drawn["multiplier"][row][:, 1], multipliers)
    ax = figures.column_figure().subplots()
    (force,) = data(figures.plot_constraint(ax, motion, held, "blade", "acceleration"))
    pushed = np.linalg.norm(motion.force_of("blade")[:, :3], axis=1)
    np.testing.assert_allclose(force[:, 1], pushed)
    with pytest.raises(InputError, match="constraint is one of blade, box; got 'needle'"):
        figures.plot_constraint(ax, motion, held, "needle")
    with pytest.raises(InputError, match="show is one of residual, multiplier, acceleration"):
        figures.plot_constraint(ax, motion, held, "blade", "push")


def test_a_figure_is_as_wide_as_columns_of_a_paper():
    assert figures.column_figure().get_figwidth() == 3.5
    assert figures.column_figure(2).get_figwidth() == 7.16
    assert figures.column_figure(2, height=4).get_figheight() == 4
    with pytest.raises(InputError, match="1 or 2 columns wide, got 3"):
        figures.column_figure(3)
    with pytest.raises(InputError, match="height must be a positive number of inches"):
        figures.column_figure(height=0)


def test_unknown_parts_and_quantities_are_named(dmp):
    ax = figures.column_figure().subplots()
    for plot in (figures.plot_speed, figures.plot_forces):
        with pytest.raises(InputError, match="part is one of linear, angular; got 'both'"):
            plot(ax, dmp.rollout(), "both")
    with pytest.raises(InputError, match="quantity is one of x, y, z, turned about x"):
        figures.plot_learned_spread(ax, dmp, "yaw")
    alone = ns.learn(cut(), ns.Blade(), basis_functions=20)
    for plot in (figures.plot_learned_spread, figures.plot_ellipses):
        with pytest.raises(InputError, match="no spread"):
            plot(ax, alone)


def test_a_pdf_has_the_papers_width_and_no_type_3_fonts(tmp_path):
    figure = figures.column_figure()
    figures.plot_path(figure.subplots(), cut())
    content = figures.save_figure(figure, tmp_path / "figure.pdf")[0].read_bytes()
    (box,) = re.findall(rb"/MediaBox \[ ([\d. ]+)\]", content)
    assert float(box.split()[2]) == pytest.approx(72 * 3.5)
    assert b"/Type3" not in content and b"/Type0" in content


@pytest.mark.parametrize("columns", [1, 2])
def test_the_example_has_nothing_clipped_and_nothing_overlapping(columns, tmp_path, monkeypatch):
    out = tmp_path / "figure.svg"
    arguments = [str(EXAMPLE), "--columns", str(columns), "--radians", "--out", str(out)]
    monkeypatch.setattr(sys, "argv", arguments)
    figure = runpy.run_path(str(EXAMPLE), run_name="__main__")["figure"]
    assert out.read_bytes().startswith(b"<?xml")
    figure.canvas.draw()
    renderer = figure.canvas.get_renderer()
    boxes = [ax.get_tightbbox(renderer) for ax in figure.axes]
    boxes.append(figure.legends[0].get_window_extent(renderer))
    assert len(boxes) == 1 + 2 * columns
    for index, box in enumerate(boxes):
        assert box.x0 >= -1 and box.y0 >= -1
        assert box.x1 <= figure.bbox.x1 + 1 and box.y1 <= figure.bbox.y1 + 1
        for other in boxes[index + 1 :]:
            across = min(box.x1, other.x1) - max(box.x0, other.x0)
            up = min(box.y1, other.y1) - max(box.y0, other.y0)
            assert across <= 1 or up <= 1
