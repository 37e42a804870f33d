"""The figure of the cuts: it carries the data, counts right, and stays legible."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import noslip as ns
from motions import eased
from noslip.demonstrations.segmentation import segment
from noslip.errors import InputError
from noslip.figures.segments import recording_cuts
from refusals import refusal


@pytest.fixture(scope="module")
def recording():
    """Two strokes of 2 s and a short one between them."""
    x = [np.zeros(50)]
    for number, count in enumerate((100, 30, 100)):
        u = np.arange(1, count + 1) / count
        s = eased(u)
        x += [0.1 * (number + s), np.full(50, 0.1 * (number + 1))]
    x = np.concatenate(x)
    path = np.column_stack([x, 0.5 * x, 0 * x])
    return ns.PoseTrajectory(
        np.arange(len(x)) / 50, path, Rotation.identity(len(x)), name="run.csv"
    )


def texts(ax):
    return [text.get_text() for text in ax.texts]


def test_it_shows_speed_thresholds_pieces_and_reasons(recording):
    segments = segment(recording)
    figure = recording_cuts(segments)
    over_time, above = figure.axes
    np.testing.assert_array_equal(over_time.lines[0].get_xdata(), recording.times)
    np.testing.assert_allclose(over_time.lines[0].get_ydata(), segments.signal)
    drawn = sorted(line.get_ydata()[0] for line in over_time.lines[1:3])
    np.testing.assert_allclose(drawn, segments.thresholds)
    low, _ = over_time.get_ylim()
    assert low < drawn[0]
    (dropped,) = (i.reason for i in segments.intervals if i.reason not in (None, "rest"))
    assert sorted(texts(over_time)) == ["1", "2", "a"]
    assert texts(above) == ["1", "2"]
    assert figure.get_suptitle().startswith("run.csv: 2 pieces of ")
    assert figure.get_suptitle().endswith("1 more cut out")
    (legend,) = figure.legends
    named = {text.get_text() for text in legend.get_texts()}
    assert {"rest", f"a: cut out, {dropped.split(', ')[1]}", "path cut out"} <= named


def test_true_cuts_are_drawn_where_they_are(recording):
    true = np.array([[1.0, 3.0], [5.6, 7.7]])
    for began in (0.0, 1.7e9):
        late = ns.PoseTrajectory(
            began + recording.times, recording.positions, recording.rotations, name="run.csv"
        )
        figure = recording_cuts(segment(late), true=began + true)
        bars = [line for line in figure.axes[0].lines if len(line.get_xdata()) == 2][-2:]
        np.testing.assert_allclose([bar.get_xdata() for bar in bars], true, atol=1e-6)
        assert "true cut" in {text.get_text() for text in figure.legends[0].get_texts()}
    assert "shape (2,)" in refusal(InputError, recording_cuts, segment(late), true=[1, 3])


def test_numbers_and_reasons_stay_inside_the_axes(recording):
    segments = segment(recording).without({0: "far from the others: turned by 40 degrees"})
    figure = recording_cuts(segments)
    figure.canvas.draw()
    ax = figure.axes[0]
    frame = ax.get_window_extent()
    for text in ax.texts:
        box = text.get_window_extent()
        assert frame.y0 <= box.y0
        assert box.y1 <= frame.y1
    named = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "a: cut out, far from the others" in named
    assert any(text.startswith("b: cut out, less than ") for text in named)


def test_labels_do_not_meet_and_can_be_read(recording):
    """Of 30 pieces too."""
    many = segment(recording, times=[(0.28 * k, 0.28 * k + 0.2) for k in range(30)])
    for segments in (many, segment(recording)):
        figure = recording_cuts(segments)
        figure.canvas.draw()
        for ax in figure.axes[:1]:
            boxes = [text.get_window_extent() for text in ax.texts]
            assert len(boxes) > 2 or segments is not many
            assert all(text.get_fontsize() >= 7 and not text.get_rotation() for text in ax.texts)
            for a, b in combinations(boxes, 2):
                assert min(a.x1, b.x1) <= max(a.x0, b.x0)


def test_contact_times_and_no_rest_have_figures_of_their_own(recording):
    height = np.where(np.arange(len(recording)) % 130 < 60, 0.0, 0.03)
    by_height = recording_cuts(segment(recording, contact=height, in_contact="below"))
    assert by_height.axes[0].get_ylabel() == "contact signal"
    assert by_height.axes[0].get_yscale() == "linear"
    at_times = recording_cuts(segment(recording, times=[(1, 3)]), title="mine")
    assert at_times.get_suptitle() == "mine"
    assert len(at_times.axes[0].lines) == 1
    moving = recording_cuts(segment(recording[55:140]))
    moving.canvas.draw()
    one = segment(recording[75:125])
    assert one.thresholds is None
    assert recording_cuts(one).get_suptitle() == "run.csv: no rest stands out, one piece"
