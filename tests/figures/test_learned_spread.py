"""The figure of a primitive's demonstrations: their spread as it is, and where it is largest."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.patches import Polygon
from panels import panel, title_of
from scipy.spatial.transform import Rotation

import noslip
from noslip import figures
from noslip.errors import InputError
from noslip.figures.learned_spread import AGREED, SEEN, enlargement, turns
from noslip.law.fitting import fit
from noslip.spread import Spread

SHARE = np.linspace(0, 1, 121)
BUMP = (4 * SHARE * (1 - SHARE)) ** 3


def learned(count=5, aside=4e-3, turned=0.05, high=False):
    """A bent path of 0.1 m in count demonstrations that differ most across it, halfway."""
    rng = np.random.default_rng(2)
    path = np.column_stack([0.1 * SHARE, 0.03 * SHARE**2, 0.01 * SHARE])
    demonstrations = []
    for _ in range(count):
        off = np.outer(BUMP, rng.normal(size=3) * [0.3, 1.0, 0.2]) * aside
        spun = Rotation.from_rotvec(np.outer(BUMP, turned * rng.normal(size=3) * [0.2, 0.1, 1.0]))
        positions = (path + off)[:, [1, 0, 2]] if high else path + off
        yaw = Rotation.from_euler("z", 0.6 * SHARE)
        demonstrations.append(noslip.PoseTrajectory(2 * SHARE, positions, spun * yaw))
    return noslip.learn(demonstrations, basis_functions=30)


@pytest.fixture(scope="module")
def dmp():
    return learned()


@pytest.fixture(scope="module")
def every_figure(dmp):
    rest = np.zeros((2, 3))
    resting = [
        noslip.PoseTrajectory([0.0, 1.0], rest + k * 1e-3, Rotation.identity(2)) for k in (0, 1)
    ]
    law = fit(resting, basis_functions=5)
    at_rest = noslip.ConstrainedDMP(law, spread=Spread.about(law, resting))
    return {
        "wide": figures.learned_spread(dmp),
        "high": figures.learned_spread(learned(high=True)),
        "two": figures.learned_spread(learned(count=2)),
        "small": figures.learned_spread(learned(aside=2e-5, turned=1e-4)),
        "equal": figures.learned_spread(learned(aside=0, turned=0)),
        "turned only": figures.learned_spread(learned(aside=0)),
        "moved only": figures.learned_spread(learned(turned=0)),
        "large": figures.learned_spread(learned(aside=0.05, turned=0.8)),
        "resting": figures.learned_spread(at_rest),
        "adapted": figures.learned_spread(dmp.adapt(goal_position=[0.2, 0.1, 0.05], duration=7)),
    }


def path_of(figure):
    (found,) = [ax for ax in figure.axes if "start" in ax.get_title()]
    return found


def outlines(figure):
    return [patch.get_xy() for patch in path_of(figure).patches if isinstance(patch, Polygon)]


def bands(ax):
    """Upper and lower edge of each band at the middle of the time, the outer band first."""
    found = []
    for band in ax.collections:
        if isinstance(band, PolyCollection):
            (outline,) = (path.vertices for path in band.get_paths())
            at_half = outline[np.isclose(outline[:, 0], 50), 1]
            found.append((at_half.max(), at_half.min()))
    return found


def test_every_figure_has_finite_content_units_and_seven_panels(every_figure):
    unit = re.compile(r"\((m|mm|°|%)\)$")
    for name, figure in every_figure.items():
        assert len(figure.axes) == 7, name
        for ax in figure.axes:
            assert unit.search(ax.get_ylabel().replace("\n", " ")), (name, ax.get_ylabel())
            assert not ax.get_xlabel() or unit.search(ax.get_xlabel())
            assert np.isfinite([*ax.get_xlim(), *ax.get_ylim()]).all()
            for line in ax.get_lines():
                assert np.isfinite(np.asarray(line.get_xydata(), dtype=float)).all(), name


def test_nothing_is_cut_off_and_no_labels_meet(every_figure):
    for name, figure in every_figure.items():
        figure.canvas.draw()
        page = figure.bbox
        labels = [text for ax in figure.axes for text in (ax.yaxis.label, ax.xaxis.label, ax.title)]
        boxes = [text.get_window_extent() for text in labels if text.get_text()]
        texts = [figure._suptitle, *figure.legends[0].get_texts()]
        boxes += [text.get_window_extent() for text in texts]
        for index, box in enumerate(boxes):
            assert box.x0 >= 0 and box.y0 >= 0, name
            assert box.x1 <= page.x1 and box.y1 <= page.y1, name
            assert not any(box.overlaps(other) for other in boxes[index + 1 :]), name


def test_the_motion_is_drawn_as_it_is(every_figure, dmp):
    motion, figure = dmp.rollout(), every_figure["wide"]
    for axis, name in enumerate("xyz"):
        for label, values in (
            (f"{name} (mm)", 1e3 * motion.positions),
            (f"turned about {name} (°)", np.degrees(turns(motion))),
        ):
            share, drawn = panel(figure, label).get_lines()[0].get_xydata().T
            np.testing.assert_allclose(share, 100 * motion.times / motion.duration)
            np.testing.assert_allclose(drawn, values[:, axis])
    np.testing.assert_allclose(
        path_of(figure).get_lines()[0].get_xydata(), 1e3 * motion.positions[:, :2]
    )


def test_bands_are_one_and_two_standard_deviations_to_either_side(every_figure, dmp):
    middle = len(dmp.spread.fractions) // 2
    for axis, name in enumerate("xyz"):
        for label, deviation in (
            (f"{name} (mm)", 1e3 * dmp.spread.position_deviation[middle, axis]),
            (f"turned about {name} (°)", np.degrees(dmp.spread.rotation_deviation[middle, axis])),
        ):
            ax = panel(every_figure["wide"], label)
            share, drawn = ax.get_lines()[0].get_xydata().T
            value = np.interp(50, share, drawn)
            (high_2, low_2), (high_1, low_1) = bands(ax)
            np.testing.assert_allclose([high_1 - value, value - low_1], deviation, rtol=1e-6)
            np.testing.assert_allclose([high_2 - value, value - low_2], 2 * deviation, rtol=1e-6)
            low, high = ax.get_ylim()
            assert low < low_2 < high_2 < high


@pytest.mark.parametrize("name", ["wide", "small", "large"])
def test_outlines_are_two_standard_deviations_off_enlarged_as_told(every_figure, dmp, name):
    options = {"wide": {}, "small": {"aside": 2e-5, "turned": 1e-4}}
    spread = learned(**options.get(name, {"aside": 0.05, "turned": 0.8})).spread
    figure = every_figure[name]
    told = re.search(r"× (\d+)", path_of(figure).get_title())
    factor = float(told[1]) if told else 1.0
    assert (factor > 1) == (name == "small")
    covariance = 1e6 * spread.positions[len(spread.fractions) // 2][:2, :2]
    middle = outlines(figure)[5]
    off = (middle - (middle.max(axis=0) + middle.min(axis=0)) / 2) / factor
    distances = np.einsum("ki,ij,kj->k", off, np.linalg.inv(covariance), off)
    np.testing.assert_allclose(np.sqrt(distances), 2, rtol=1e-3)
    assert len(outlines(figure)) == 11
    widths = [np.ptp(outline, axis=0).max() for outline in outlines(figure)]
    assert widths[0] < 1e-6 > widths[-1]
    bounds = np.transpose([path_of(figure).get_xlim(), path_of(figure).get_ylim()])
    points = np.concatenate(outlines(figure))
    assert np.all((points > bounds[0]) & (points < bounds[1]))


def test_enlargements_are_round_and_bring_into_sight():
    for size in np.geomspace(1e-6, 1, 50):
        factor = enlargement(size, 1.0)
        assert factor / 10 ** np.floor(np.log10(factor)) in (1, 2, 5)
        assert factor == 1 or SEEN <= factor * size < 2.5 * SEEN
    assert enlargement(0.0, 1.0) == enlargement(1.0, 0.0) == enlargement(0.0, 0.0) == 1


def test_the_title_says_where_they_agree_least_and_by_how_much(every_figure, dmp):
    largest = 1e3 * dmp.spread.position_deviation[:, 1].max()
    turned = np.degrees(dmp.spread.rotation_deviation[:, 2].max())
    assert title_of(every_figure["wide"]) == (
        f"5 demonstrations agree least along y at 50 % of the time (standard deviation "
        f"{largest:.3g} mm), and about z at 50 % ({turned:.3g}°)"
    )
    assert title_of(every_figure["equal"]) == "5 demonstrations agree, starts and goals aside"
    assert title_of(every_figure["two"]).startswith("2 demonstrations agree least along ")
    assert title_of(every_figure["high"]).startswith("5 demonstrations agree least along x ")
    assert "along" not in title_of(every_figure["turned only"])
    assert "about" not in title_of(every_figure["moved only"])
    assert figures.learned_spread(dmp, title="mine").get_suptitle() == "mine"


def test_where_they_agree_least_is_marked(every_figure):
    for name, marked in (("wide", {"y (mm)", "turned about z (°)"}), ("equal", set())):
        figure = every_figure[name]
        found = {
            ax.get_ylabel(): line.get_xdata()
            for ax in figure.axes
            for line in ax.get_lines()
            if line.is_dashed()
        }
        assert set(found) == marked
        assert all(np.allclose(at, 50) for at in found.values())
        named = [text.get_text() for text in figure.legends[0].get_texts()]
        assert ("agree least" in named) == bool(marked)


def test_a_primitive_adapted_elsewhere_has_the_spread_where_it_is_now(every_figure, dmp):
    figure = every_figure["adapted"]
    assert title_of(figure) == title_of(every_figure["wide"])
    end = path_of(figure).get_lines()[0].get_xydata()[-1]
    np.testing.assert_allclose(end, [0.2, 0.1], atol=1e-4)


def test_turns_go_on_beyond_half_a_turn():
    times = np.linspace(0, 1, 400)
    spinning = noslip.PoseTrajectory(times, np.zeros((400, 3)), Rotation.from_euler("y", 9 * times))
    np.testing.assert_allclose(turns(spinning), np.outer(9 * times, [0, 1, 0]), atol=1e-12)


def test_rounding_is_no_disagreement(dmp):
    count = len(dmp.spread.fractions)
    tiny = np.broadcast_to(0.25 * AGREED**2 * np.eye(3), (count, 3, 3))
    figure = figures.learned_spread(replace(dmp, spread=Spread(3, tiny, tiny)))
    assert title_of(figure) == "3 demonstrations agree, starts and goals aside"


def test_a_primitive_of_one_demonstration_is_refused():
    with pytest.raises(InputError, match="no spread: it was learned from one demonstration"):
        figures.learned_spread(learned(count=1))
