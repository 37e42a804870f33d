"""The figure of an adapted family: it carries the data, says the finding, and stays legible."""

import re

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from panels import panel, title_of
from scipy.spatial.transform import Rotation

import noslip
from noslip import figures
from noslip.errors import InputError
from noslip.figures.family import MANY, MOST_NAMED, end_errors

BLADE = noslip.Blade()
SPEED = noslip.SpeedLimit(speed=0.04)


def cut(length=0.1, bend=0.03, rise=0.0, samples=60):
    """A blade along a bent path, that points where it goes."""
    share = np.linspace(0, 1, samples)
    positions = np.column_stack([length * share, bend * share**2, rise * share])
    yaw = np.arctan2(2 * bend * share, length)
    return noslip.PoseTrajectory(2 * share, positions, Rotation.from_euler("z", yaw))


ORIGINAL = cut()


def family(count, rise=0.0):
    """Motions that miss their goals by 1 um and 0.01 rad times their number, to 0.1 m away."""
    motions, goals = {}, {}
    for index in range(1, count + 1):
        name = f"goal_{index:03}"
        motions[name] = cut(0.1, 0.03 + 0.1 * index / count, rise * index / count)
        end, turn = motions[name].positions[-1], motions[name].rotations[-1]
        goals[name] = noslip.Boundary(
            1,
            end + [0, 1e-6 * index, 0],
            turn * Rotation.from_euler("x", 0.01 * index / count),
        )
    return motions, goals


def drawn(count, rise=0.0, constraints=BLADE):
    return figures.adapted_family(ORIGINAL, *family(count, rise), constraints)


@pytest.fixture(scope="module")
def every_figure():
    motions, goals = family(3)
    lost = {**goals, "lost": noslip.Boundary(1, [0.1, 0.0, 0.0])}
    free = dict.fromkeys(goals, noslip.Boundary(1))
    exact = {name: noslip.Boundary.keeping(m, 1, "pose") for name, m in motions.items()}
    resting = noslip.PoseTrajectory(
        np.arange(9.0), np.ones((9, 3)), Rotation.identity(9), name="resting"
    )
    return {
        "one": drawn(1),
        "eight": drawn(MOST_NAMED, rise=0.08),
        "hundred": drawn(100),
        "two hundred": drawn(200, rise=0.08),
        "failed": figures.adapted_family(ORIGINAL, motions, lost, [BLADE, SPEED]),
        "free": figures.adapted_family(ORIGINAL, motions, free),
        "exact": figures.adapted_family(ORIGINAL, motions, exact, BLADE),
        "resting": figures.adapted_family(
            resting, {"still": resting}, {"still": noslip.Boundary(1, [1.0, 1.0, 1.1])}, BLADE
        ),
    }


def values_of(ax):
    """Values of the goals, without the marks at the axis' foot."""
    return np.array([ln.get_ydata()[0] for ln in ax.get_lines() if ln.get_marker() == "o"])


def test_every_figure_has_finite_content_units_and_a_number_in_its_title(every_figure):
    unit = re.compile(r"\((m|mm|°|number|SI|m/s|mm/s)\)$")
    for name, figure in every_figure.items():
        assert re.search(r"\d|One", title_of(figure)), name
        for ax in figure.axes:
            assert unit.search(ax.get_ylabel().replace("\n", " ")), (name, ax.get_ylabel())
            assert not ax.get_xlabel() or unit.search(ax.get_xlabel())
            assert np.isfinite([*ax.get_xlim(), *ax.get_ylim()]).all()
            for line in ax.get_lines():
                assert np.isfinite(np.asarray(line.get_xydata(), dtype=float)).all(), name
            for ticks in ax.collections:
                assert np.isfinite(ticks.get_segments()).all(), name


def test_nothing_is_cut_off_and_no_labels_meet(every_figure):
    for name in ("one", "eight", "hundred", "failed", "resting"):
        figure = every_figure[name]
        figure.canvas.draw()
        page = figure.bbox
        labels = [ax.yaxis.label for ax in figure.axes]
        boxes = [text.get_window_extent() for text in labels if text.get_text()]
        texts = [figure._suptitle, *figure.legends[0].get_texts()]
        for box in boxes + [text.get_window_extent() for text in texts]:
            assert box.x0 >= 0 and box.y0 >= 0, name
            assert box.x1 <= page.x1 and box.y1 <= page.y1, name
        for index, box in enumerate(boxes):
            assert not any(box.overlaps(other) for other in boxes[index + 1 :]), name


@pytest.mark.parametrize("count", [1, MOST_NAMED, 20])
def test_errors_are_those_of_the_motions(count):
    motions, goals = family(count)
    figure = figures.adapted_family(ORIGINAL, motions, goals, BLADE)
    errors = np.array([end_errors(motions[name], goals[name]) for name in motions])
    np.testing.assert_allclose(errors[:, 0], 1e-6 * np.arange(1, count + 1), rtol=1e-6)
    position, rotation = panel(figure, "ends off by (mm)"), panel(figure, "ends off by (°)")
    np.testing.assert_allclose(values_of(position), 1e3 * errors[:, 0])
    np.testing.assert_allclose(values_of(rotation), np.degrees(errors[:, 1]))
    assert position.get_yscale() == rotation.get_yscale() == "log"
    residuals = [1e3 * noslip.check(motion, BLADE).peak for motion in motions.values()]
    np.testing.assert_allclose(values_of(panel(figure, "residual (mm/s)")), residuals)
    for ax in (position, rotation):
        low, high = ax.get_ylim()
        assert np.all((values_of(ax) > low) & (values_of(ax) < high))


def test_the_paths_carry_the_positions_with_ticks_across():
    motions, goals = family(2)
    ax = figures.adapted_family(ORIGINAL, motions, goals, BLADE).axes[0]
    curves = {line.get_label(): line.get_xydata() for line in ax.get_lines()}
    for name, motion in motions.items():
        np.testing.assert_allclose(curves[name], 1e3 * motion.positions[:, :2])
    ticks = [c for c in ax.collections if isinstance(c, LineCollection)]
    assert len(ticks) == len(motions)
    motion = motions["goal_002"]
    last = np.diff(ticks[1].get_segments()[-1], axis=0)[0]
    lateral = motion.rotations[-1].as_matrix()[:2, 1]
    assert abs(last @ lateral) == pytest.approx(np.linalg.norm(last))


def test_the_title_says_how_far_the_goals_are_and_how_near_the_ends(every_figure):
    motions, goals = family(100)
    away = max(np.linalg.norm(goal.position - ORIGINAL.positions[-1]) for goal in goals.values())
    told = title_of(every_figure["hundred"])
    assert told.startswith(f"100 goals up to {100 * away / ORIGINAL.path_length:.3g} % of the path")
    assert "ends within 0.1 mm and 0.573°, residual " in told
    assert title_of(every_figure["one"]).startswith("One goal ")
    assert title_of(every_figure["free"]) == "3 goals"
    assert figures.adapted_family(ORIGINAL, motions, goals, title="mine").get_suptitle() == "mine"


def test_few_motions_have_colors_and_names_and_many_share_one(every_figure):
    few, many = every_figure["eight"], every_figure["hundred"]
    named = [text.get_text() for text in few.legends[0].get_texts()]
    assert [name for name in named if name.startswith("goal_")] == list(family(MOST_NAMED)[0])
    lines = [ln for ln in few.axes[0].get_lines() if ln.get_label().startswith("goal_")]
    assert len({(ln.get_color(), str(ln.get_linestyle())) for ln in lines}) == MOST_NAMED
    assert "adapted (100)" in [text.get_text() for text in many.legends[0].get_texts()]
    shared = [ln for ln in many.axes[0].get_lines() if ln.get_label().startswith("goal_")]
    assert {ln.get_color() for ln in shared} == {MANY["color"]} and len(shared) == 100


def test_ticks_lie_along_a_lateral_axis_that_has_no_letter():
    motions, goals = family(1)
    lateral = np.array([0.2, 1.0, 0.1])
    ax = figures.adapted_family(ORIGINAL, motions, goals, noslip.Blade(lateral)).axes[0]
    (ticks,) = (c for c in ax.collections if isinstance(c, LineCollection))
    last = np.diff(ticks.get_segments()[-1], axis=0)[0]
    seen = motions["goal_001"].rotations[-1].apply(lateral)[:2]
    assert abs(last @ seen) == pytest.approx(np.linalg.norm(last) * np.linalg.norm(seen))
    names = [text.get_text() for text in ax.figure.legends[0].get_texts()]
    assert "the tool's lateral axis" in names


def test_a_family_that_leaves_its_plane_is_seen_from_the_side_too(every_figure):
    assert {ax.get_ylabel() for ax in every_figure["hundred"].axes} & {"z (mm)", "z (m)"} == set()
    assert panel(every_figure["eight"], "z (mm)").get_xlabel() in ("x (mm)", "y (mm)")


def test_a_goal_that_failed_is_marked_and_counted(every_figure):
    figure = every_figure["failed"]
    assert title_of(figure).startswith("3 of 4 goals up to ")
    crosses = [ln for ax in figure.axes for ln in ax.get_lines() if ln.get_marker() == "x"]
    assert len(crosses) == len(figure.axes)
    assert "failed" in [text.get_text() for text in figure.legends[0].get_texts()]
    speeds = [noslip.check(motion, SPEED).peak for motion in family(3)[0].values()]
    assert values_of(panel(figure, "violation (mm/s)")).max() >= 1e3 * max(speeds) * (1 - 1e-9)


def test_what_is_exactly_zero_is_marked_at_the_foot(every_figure):
    ax = panel(every_figure["exact"], "ends off by (m)")
    assert not len(values_of(ax))
    assert [ln.get_marker() for ln in ax.get_lines()] == ["v"] * 3
    assert "exactly 0" in [t.get_text() for t in every_figure["exact"].legends[0].get_texts()]


def test_what_is_left_free_has_no_error(every_figure):
    assert end_errors(ORIGINAL, noslip.Boundary(1)) == (None, None)
    assert [ax.get_ylabel() for ax in every_figure["free"].axes] == ["y (mm)"]


def test_a_motion_without_a_goal_is_refused():
    motions, goals = family(2)
    del goals["goal_002"]
    with pytest.raises(InputError, match="goals lack 'goal_002'"):
        figures.adapted_family(ORIGINAL, motions, goals)
    with pytest.raises(InputError, match="at least one motion"):
        figures.adapted_family(ORIGINAL, {}, goals)
