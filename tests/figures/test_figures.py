"""Figures: they carry the data, say the finding, name their units, and are the same each time."""

import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from itertools import combinations, pairwise

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_hex, to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text
from mpl_toolkits.mplot3d import Axes3D
from panels import panel, title_of
from scipy.spatial.transform import Rotation

import measures
import noslip
from learned import cutting, under
from motions import numerical_example
from noslip import figures
from noslip.constraints.check import step_residuals
from noslip.demonstrations.excision import TOOL_FRAME, synthetic_excisions
from noslip.errors import InputError
from noslip.figures import quantities, snapshots, style
from noslip.figures.quantities import roll_pitch_yaw

BLADE = noslip.Blade()
TRIALS = 3
SPHERE = noslip.KeepOutSphere(center=(0.9, 0.5, 0), radius=0.1)
SPEED = noslip.SpeedLimit(speed=3.0)
BOX = noslip.constraints.Box(lower=(-0.2, -0.8, -0.1), upper=(1.1, 1.2, 0.1))
LIMITED = [BLADE, SPHERE, SPEED, BOX]


@noslip.position_constraint
def stay_on_table(motion):
    return motion.position[2]


@noslip.velocity_constraint
def upright(motion):
    return [motion.angular_velocity[0], motion.angular_velocity[1]]


@pytest.fixture(scope="module")
def motions():
    demonstration = numerical_example(100)
    dmp = noslip.learn(demonstration, BLADE, basis_functions=30)
    return {
        "demonstration": demonstration,
        "regular": dmp.regular.rollout(),
        "constrained": dmp.constrained.rollout(),
        "optimized": dmp.rollout(),
    }


@pytest.fixture(scope="module")
def cuts():
    return [
        noslip.prepare(
            recording,
            tool_frame=TOOL_FRAME,
            trim_speed=0.005,
            rate=60,
            lowpass=4.8,
            relative=True,
        )
        for recording in synthetic_excisions(count=TRIALS)
    ]


@pytest.fixture(scope="module")
def trained(cuts):
    return [noslip.learn(cut, BLADE, basis_functions=30).rollout() for cut in cuts]


@pytest.fixture(scope="module")
def resting():
    count = 12
    return noslip.PoseTrajectory(
        times=5 + 0.1 * np.arange(count),
        positions=np.tile([1.0, 2.0, 3.0], (count, 1)),
        rotations=Rotation.from_euler("xyz", np.tile([10.0, 90.0, 0.0], (count, 1)), degrees=True),
        name="resting",
    )


@pytest.fixture(scope="module")
def recording():
    """28 Hz, irregular, far from the world's origin, steepest along z."""
    times = 1000 + np.cumsum(np.random.default_rng(3).uniform(0.03, 0.04, 60))
    share = np.linspace(0, 1, 60)
    return noslip.PoseTrajectory(
        times=times,
        positions=np.column_stack([1.5 + 0.3 * share, -2 + 0.02 * share, 0.4 * share**2]),
        rotations=Rotation.from_euler("xyz", share[:, None] * [30, 200, 400], degrees=True),
        name="recordings/of_a/person/far/away/run_07.csv",
    )


@pytest.fixture(scope="module")
def blade_dmp():
    """Learned without limits, which then have something to do."""
    return noslip.learn(numerical_example(100), BLADE, basis_functions=30)


@pytest.fixture(scope="module")
def limited(blade_dmp):
    return under(blade_dmp, LIMITED).rollout()


@noslip.velocity_constraint
def hurry(motion):
    return motion.linear_velocity[1] - 2.0


@noslip.keep_nonnegative(priority=1)
def a_limit_of_a_rather_long_name_that_gives_way(motion):
    return 0.4 - motion.position[1]


TURN = noslip.constraints.AngularRateLimit(rate=4.0)
EVERY = [
    BLADE,
    hurry,
    a_limit_of_a_rather_long_name_that_gives_way,
    noslip.constraints.AccelerationLimit(linear=1e5, angular=1e5),
    noslip.constraints.KeepOutCapsule(start=(5, 5, -1), end=(5, 5, 1), radius=0.05),
    TURN,
]


@pytest.fixture(scope="module")
def yielding(blade_dmp):
    return under(blade_dmp, EVERY, inverse_metric=(1.0,) * 6).rollout()


@pytest.fixture(scope="module")
def every_figure(motions, cuts, trained, resting, recording, limited, yielding):
    several = [BLADE, stay_on_table, upright]
    pair = {name: motions[name] for name in ("demonstration", "optimized")}
    awkward = {"_private $x$ name": recording, "a name " * 12: resting, "third": cuts[0]}
    return {
        "compare": figures.compare_motions(motions, BLADE, tool=True),
        "compare wheel": figures.compare_motions(motions["demonstration"], noslip.Wheel()),
        "compare many": figures.compare_motions(
            {f"cut {i}": cuts[i % TRIALS] for i in range(9)} | {"learned": trained[0]}, BLADE
        ),
        "compare rows": figures.compare_motions(pair, several),
        "compare one": figures.compare_motions(motions["optimized"], BLADE),
        "compare recording": figures.compare_motions(recording, BLADE),
        "compare resting": figures.compare_motions(resting, several),
        "compare awkward": figures.compare_motions(awkward, BLADE),
        "compare unconstrained": figures.compare_motions(recording),
        "snapshots": figures.blade_snapshots(motions, desired=motions["demonstration"]),
        "snapshots one": figures.blade_snapshots(recording),
        "snapshots resting": figures.blade_snapshots(resting, blades=3),
        "spread": figures.demonstration_spread(cuts, BLADE),
        "spread trained": figures.demonstration_spread(trained, BLADE),
        "spread rows": figures.demonstration_spread(cuts, several),
        "spread resting": figures.demonstration_spread([resting, resting], BLADE),
        "spread one": figures.demonstration_spread(recording),
        "compare limits": figures.compare_motions({"a": recording, "b": limited}, LIMITED),
        "compare limit": figures.compare_motions(limited, SPHERE),
        "compare yielding": figures.compare_motions(yielding, EVERY),
        "spread limits": figures.demonstration_spread([limited, recording], LIMITED),
        "history": figures.constraint_history(limited, LIMITED),
        "history without units": figures.constraint_history(limited),
        "history yielding": figures.constraint_history(yielding, EVERY),
        "history of a blade": figures.constraint_history(motions["optimized"], BLADE),
        "adjustments": figures.orientation_adjustments(cuts, trained),
        "adjustments resting": figures.orientation_adjustments(resting, resting),
    }


def curves(ax):
    """Data of the labeled lines, by label."""
    return {line.get_label(): line.get_xydata() for line in ax.get_lines()}


def numbers_in(text):
    return [float(n.replace("−", "-")) for n in re.findall(r"[-−+]?\d+\.?\d*(?:e-?\d+)?", text)]


# ---------------------------------------------------------------- all figures


def test_every_axis_has_a_unit(every_figure):
    unit = re.compile(r"\((m|mm|s|m/s|mm/s|rad/s|m/s²|rad/s²|°|%|SI|own unit)\)$")
    for name, figure in every_figure.items():
        for ax in figure.axes:
            sides = {"x": ax.xaxis, "y": ax.yaxis} | ({"z": ax.zaxis} if ax.name == "3d" else {})
            for side, axis in sides.items():
                if any(tick.label1.get_visible() for tick in axis.get_major_ticks()):
                    label = axis.get_label_text().replace("\n", " ")
                    bar = hasattr(ax, "_colorbar") and side == "x"
                    assert bar or unit.search(label), (name, side, label)


def test_every_figure_has_a_title_with_a_number(every_figure):
    for name, figure in every_figure.items():
        told = title_of(figure)
        assert numbers_in(told) or told.endswith("does not slip"), name


def test_no_text_of_a_figure_numbers_a_row_in_brackets(every_figure):
    for name, figure in every_figure.items():
        for text in figure.findobj(Text):
            assert not re.search(r"\[\d+\]", text.get_text()), (name, text.get_text())


def test_own_title_replaces_the_finding(motions, cuts, trained):
    pair = {"a": motions["regular"], "b": motions["optimized"]}
    made = [
        figures.compare_motions(pair, BLADE, title="mine"),
        figures.blade_snapshots(pair, title="mine"),
        figures.demonstration_spread(cuts, BLADE, title="mine"),
        figures.orientation_adjustments(cuts, trained, title="mine"),
    ]
    assert [title_of(figure) for figure in made] == ["mine"] * 4


def test_lines_have_colors_of_the_palette_and_no_nan(every_figure):
    palette = {color.lower() for color in style.PALETTE.values()}
    for name, figure in every_figure.items():
        for ax in figure.axes:
            for line in ax.get_lines():
                assert to_hex(line.get_color()).lower() in palette, name
                assert np.all(np.isfinite(line.get_xydata().astype(float))), name


def test_nothing_is_clipped_and_nothing_overlaps(every_figure):
    for name, figure in every_figure.items():
        figure.canvas.draw()
        renderer = figure.canvas.get_renderer()
        page = figure.bbox
        boxes = {"title": figure._suptitle.get_window_extent(renderer)}
        if figure.legends:
            boxes["legend"] = figure.legends[0].get_window_extent(renderer)
        for index, ax in enumerate(figure.axes):
            if ax.name != "3d":
                # A heading may go on above the next panel.
                if heading := ax.get_title(loc="left"):
                    boxes[f"heading {index}"] = ax._left_title.get_window_extent(renderer)
                ax.set_title("", loc="left")
                boxes[f"panel {index}"] = ax.get_tightbbox(renderer)
                ax.set_title(heading, loc="left")
        for what, box in boxes.items():
            assert box.x0 >= -1 and box.y0 >= -1, (name, what)
            assert box.x1 <= page.x1 + 1 and box.y1 <= page.y1 + 1, (name, what)
        for (a, first), (b, second) in combinations(boxes.items(), 2):
            across = min(first.x1, second.x1) - max(first.x0, second.x0)
            up = min(first.y1, second.y1) - max(first.y0, second.y0)
            assert across <= 1 or up <= 1, (name, a, b)


def test_data_lie_within_their_axes(every_figure):
    for name, figure in every_figure.items():
        for ax in figure.axes:
            if ax.name == "3d" or ax.get_yscale() == "log":
                continue
            low, high = ax.get_ylim()
            for line in ax.get_lines():
                if line.get_transform().contains_branch(ax.transData):
                    data = line.get_xydata()[:, 1]
                    assert low <= data.min() and data.max() <= high, (name, ax.get_ylabel())
            for band in ax.collections:
                if isinstance(band, PolyCollection):
                    data = band.get_paths()[0].vertices[:, 1]
                    assert low <= data.min() and data.max() <= high, (name, ax.get_ylabel())


def test_legend_names_every_motion(every_figure, motions):
    texts = [text.get_text() for text in every_figure["compare"].legends[0].get_texts()]
    assert texts == list(motions)
    awkward = [text.get_text() for text in every_figure["compare awkward"].legends[0].get_texts()]
    assert len(awkward) == 3 and all(len(text) <= 42 for text in awkward)
    assert not every_figure["compare one"].legends


def test_pyplot_stays_unused():
    code = "import sys, noslip.figures; sys.exit('matplotlib.pyplot' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)


# ---------------------------------------------------------------- compare_motions


def test_comparison_draws_each_motions_samples(every_figure, motions):
    figure = every_figure["compare"]
    for index, coordinate in enumerate("xy"):
        drawn = curves(panel(figure, f"{coordinate} (m)"))
        for name, motion in motions.items():
            np.testing.assert_array_equal(drawn[name][:, 0], motion.times - motion.times[0])
            np.testing.assert_array_equal(drawn[name][:, 1], motion.positions[:, index])


def test_comparison_draws_roll_pitch_and_yaw(every_figure, motions):
    for index, angle in enumerate(("roll", "pitch", "yaw")):
        drawn = {}
        for name, motion in motions.items():
            figures.plot_orientation(ax := Figure().subplots(), motion, angle)
            drawn[name] = ax.get_lines()[0].get_ydata()
            wanted = np.unwrap(motion.rotations.as_euler("xyz"), axis=0)[:, index]
            np.testing.assert_allclose(drawn[name], np.degrees(wanted), atol=1e-9)
    yaw = curves(panel(every_figure["compare"], "yaw (°)"))
    assert set(yaw) == set(motions)


def test_what_does_not_change_has_no_panel_and_is_named(every_figure, recording):
    note = every_figure["compare"].legends[0].get_title().get_text()
    assert note == "Without a panel, as it does not change: z 0 m; roll 0°; pitch 45°"
    labels = {ax.get_ylabel() for ax in every_figure["compare"].axes}
    assert not labels & {"z (m)", "roll (°)", "pitch (°)"}
    figure = every_figure["compare wheel"]
    labels = {label_of(ax) for ax in figure.axes}
    assert "lateral velocity (m/s)" in labels and "wheel, vertical (m/s)" not in labels
    assert figure.get_supxlabel().endswith("wheel, vertical below 1e-9 m/s")
    # Of what moves, nothing is left out.
    labels = [ax.get_ylabel() for ax in every_figure["compare recording"].axes]
    assert {"x (m)", "y (m)", "z (m)", "roll (°)", "pitch (°)", "yaw (°)"} <= set(labels)
    assert not every_figure["compare recording"].get_supxlabel()


def test_comparison_draws_the_residual_of_each_step(every_figure, motions):
    figure = every_figure["compare"]
    signed = curves(panel(figure, "lateral velocity (m/s)"))
    sizes = panel(figure, "|lateral velocity| (m/s)")
    assert sizes.get_yscale() == "log"
    for name, motion in motions.items():
        wanted = step_residuals(motion, BLADE)[:, 0]
        np.testing.assert_array_equal(signed[name][:, 0], motion.times[1:] - motion.times[0])
        np.testing.assert_array_equal(signed[name][:, 1], wanted)
        np.testing.assert_array_equal(curves(sizes)[name][:, 1], np.abs(wanted))


def test_comparison_title_is_what_check_reports(every_figure, motions):
    told = title_of(every_figure["compare"])
    assert told.startswith("Demonstration slips ") and "; optimized does not slip, ends " in told
    slipped, peak, off = numbers_in(told)
    found = noslip.check(motions["demonstration"], BLADE)
    assert slipped == pytest.approx(found.slip_distance, rel=0.005)
    assert peak == pytest.approx(found.peak, rel=0.005)
    assert noslip.check(motions["optimized"], BLADE).peak < 1e-9
    unit = 1e-6 if "µm" in told else 1e-3
    assert motions["optimized"].end_error <= 1.01 * off * unit


def test_a_motion_that_slips_or_misses_its_goal_is_said_to(motions):
    slipping = figures.compare_motions({"regular": motions["regular"]}, BLADE)
    assert title_of(slipping).startswith("Regular slips ")
    pair = {"optimized": motions["optimized"], "regular": motions["regular"]}
    told = title_of(figures.compare_motions(pair, BLADE))
    assert re.match("Optimized does not slip; regular slips .* m .up to ", told)
    missed = motions["constrained"].end_error
    told = title_of(figures.compare_motions({"constrained": motions["constrained"]}, BLADE))
    assert told == f"Constrained does not slip, ends {missed:.3g} m from its goal"


def test_more_than_eight_motions_share_a_line_but_for_those_that_are_told_apart(every_figure, cuts):
    figure = every_figure["compare many"]
    worst = max(range(TRIALS), key=lambda i: noslip.check(cuts[i], BLADE).peak)
    assert f"the worst, cut {worst}, slips" in title_of(figure)
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert texts == [f"cut {worst}", "learned", "8 others"]
    lines = {line.get_label(): line for line in panel(figure, "x (mm)").get_lines()}
    others = {line.get_color() for name, line in lines.items() if name not in texts}
    assert others == {style.MANY["color"]}
    assert len({lines[name].get_color() for name in texts[:2]} | others) == 3


def test_lines_that_coincide_differ_in_color_and_dashes(motions):
    styles = style.line_styles(motions)
    assert len({s["color"] for s in styles.values()}) == 4
    assert len({str(s["linestyle"]) for s in styles.values()}) == 3
    assert styles["demonstration"]["linewidth"] > 2 * styles["regular"]["linewidth"]
    eight = style.line_styles(f"motion {i}" for i in range(8))
    assert len({(s["color"], str(s["linestyle"])) for s in eight.values()}) == 8


def test_residuals_that_can_be_seen_need_no_logarithmic_axis(every_figure):
    scales = [ax.get_yscale() for ax in every_figure["compare recording"].axes]
    assert set(scales) == {"linear"}
    # One motion whose residual is zero but for rounding shows none.
    labels = [ax.get_ylabel() for ax in every_figure["compare one"].axes]
    assert not any("lateral velocity" in label for label in labels)


def test_a_constraint_forces_panel_shows_rollouts_alone(every_figure, motions):
    label = "constraint's linear acceleration (m/s²)"
    drawn = curves(panel(every_figure["compare"], label))
    assert set(drawn) == {"constrained", "optimized"}
    wanted = np.linalg.norm(motions["constrained"].constraint_forces[:, :3], axis=1)
    np.testing.assert_array_equal(drawn["constrained"][:, 1], wanted)
    assert curves(panel(every_figure["compare one"], label))
    assert all("acceleration" not in ax.get_ylabel() for ax in every_figure["spread"].axes)


def test_angular_constraint_forces_have_a_panel_where_there_are_any(motions):
    dmp = noslip.learn(motions["demonstration"], BLADE, basis_functions=20, metric=(1.0,) * 6)
    rollout = dmp.constrained.rollout()
    ax = panel(
        figures.compare_motions(rollout, BLADE), "constraint's angular acceleration (rad/s²)"
    )
    wanted = np.linalg.norm(rollout.constraint_forces[:, 3:], axis=1)
    np.testing.assert_array_equal(ax.get_lines()[0].get_ydata(), wanted)


def test_each_row_of_several_constraints_has_a_panel_or_is_named(every_figure, motions):
    figure, system = every_figure["compare rows"], [BLADE, stay_on_table, upright]
    wanted = step_residuals(motions["demonstration"], system)
    drawn = curves(panel(figure, "lateral velocity (m/s)"))["demonstration"][:, 1]
    np.testing.assert_array_equal(drawn, wanted[:, 0])
    assert np.abs(wanted[:, 1:]).max() < 1e-9
    note = figure.legends[0].get_title().get_text().replace("\n", " ")
    for zero in ("stay on table below 1e-9 m", "upright, row 1 below 1e-9 rad/s"):
        assert zero in note


def test_other_constraints_are_called_by_their_names(recording):
    figure = figures.compare_motions({"a": recording, "b": recording}, stay_on_table)
    peak = np.abs(step_residuals(recording, stay_on_table)).max()
    assert (
        title_of(figure)
        == f"B violates “stay on table” by up to {peak:.3g} m, a up to {peak:.3g} m"
    )


def test_path_is_seen_where_it_reaches_furthest(every_figure, recording):
    labels = [(ax.get_xlabel(), ax.get_ylabel()) for ax in every_figure["compare"].axes]
    assert ("x (m)", "y (m)") in labels
    (path,) = [ax for ax in every_figure["compare recording"].axes if ax.get_xlabel() == "x (m)"]
    assert path.get_ylabel() == "z (m)" and "XZ plane" in path.get_title()
    assert path.get_aspect() == 1
    np.testing.assert_array_equal(path.get_lines()[0].get_xydata(), recording.positions[:, [0, 2]])


def test_short_paths_are_in_millimeters(cuts):
    figure = figures.compare_motions(cuts[0], BLADE)
    np.testing.assert_array_equal(
        panel(figure, "z (mm)").get_lines()[0].get_ydata(), 1e3 * cuts[0].positions[:, 2]
    )
    slip = panel(figure, "lateral velocity (mm/s)").get_lines()[0].get_ydata()
    np.testing.assert_array_equal(slip, 1e3 * step_residuals(cuts[0], BLADE)[:, 0])


def test_rounding_errors_do_not_fill_an_axis(motions):
    ax = Figure().subplots()
    figures.plot_positions(ax, motions, "z")
    assert np.ptp(ax.get_ylim()) > 0.02
    figures.plot_residuals(ax := Figure().subplots(), motions["optimized"], BLADE)
    assert np.ptp(ax.get_ylim()) > 0.1


@pytest.mark.parametrize(
    ("plot", "arguments"),
    [
        (figures.plot_positions, ("y",)),
        (figures.plot_orientation, ("yaw",)),
        (figures.plot_path, ()),
        (figures.plot_residuals, (BLADE,)),
        (figures.plot_forces, ()),
    ],
)
def test_axes_functions_take_one_motion_or_several_and_return_lines(motions, plot, arguments):
    one = plot(Figure().subplots(), motions["optimized"], *arguments)
    several = plot(Figure().subplots(), motions, *arguments)
    assert all(isinstance(line, Line2D) for line in one + several)
    assert len(one) == 1
    assert len(several) == (2 if plot is figures.plot_forces else len(motions))


def test_wrong_arguments_are_named(motions):
    ax, motion = Figure().subplots(), motions["regular"]
    with pytest.raises(InputError, match="at least one motion"):
        figures.compare_motions({}, BLADE)
    with pytest.raises(InputError, match="'a' is a ndarray"):
        figures.compare_motions({"a": motion.positions}, BLADE)
    with pytest.raises(InputError, match="coordinate is one of x, y, z; got 'w'"):
        figures.plot_positions(ax, motion, "w")
    with pytest.raises(InputError, match="angle is one of roll, pitch, yaw"):
        figures.plot_orientation(ax, motion, "z")
    with pytest.raises(InputError, match="1 rows"):
        figures.plot_residuals(ax, motion, BLADE, row=1)
    with pytest.raises(InputError, match="2 blades or more"):
        figures.blade_snapshots(motion, blades=1)


# ---------------------------------------------------------------- limits


def margins_of(motion):
    """Of SPHERE and BOX at each sample, of SPEED in each step, by NumPy."""
    p = motion.positions
    v = np.diff(motion.positions, axis=0) / np.diff(motion.times)[:, None]
    sides = np.column_stack([p - [-0.2, -0.8, -0.1], [1.1, 1.2, 0.1] - p])
    return {
        "keep-out-sphere": np.linalg.norm(p - [0.9, 0.5, 0], axis=1) - 0.1,
        "speed-limit": 3.0 - np.linalg.norm(v, axis=1),
        "box": sides.min(axis=1),
    }


def forbidden_side(ax):
    """Lower and upper end of the shaded band."""
    (band,) = [patch for patch in ax.patches if patch.get_hatch()]
    box = band.get_extents().transformed(ax.transData.inverted())
    return box.y0, box.y1


def test_comparison_draws_a_margin_a_limit_and_shades_what_is_forbidden(
    every_figure, limited, recording
):
    figure = every_figure["compare limits"]
    for name, unit in [("keep-out-sphere", "m"), ("speed-limit", "m/s"), ("box", "m")]:
        ax = panel(figure, f"margin of {name} ({unit})")
        drawn = curves(ax)
        for motion_name, motion in (("a", recording), ("b", limited)):
            np.testing.assert_allclose(
                drawn[motion_name][:, 1], margins_of(motion)[name], atol=1e-11
            )
            np.testing.assert_allclose(
                drawn[motion_name][:, 0],
                (motion.times - motion.times[0])[int(unit == "m/s") :],
                atol=1e-12,
            )
        low, high = forbidden_side(ax)
        assert high == pytest.approx(0, abs=1e-12)
        assert low == pytest.approx(ax.get_ylim()[0])
        assert low < min(0, *(c[:, 1].min() for c in drawn.values()))
        assert ax.get_ylim()[1] > 0
        assert ax.get_yscale() == "linear"
    # Of the equality alone there is no such side.
    assert not panel(figure, "lateral velocity (m/s)").patches


def test_rows_of_a_limit_are_drawn_one_by_one_if_asked_for(limited):
    ax = Figure().subplots()
    (line,) = figures.plot_residuals(ax, limited, BOX, row=4)
    np.testing.assert_allclose(line.get_ydata(), 1.2 - limited.positions[:, 1], atol=1e-12)
    assert ax.get_ylabel().replace("\n", " ") == "margin of box, largest y (m)"
    assert forbidden_side(ax)[1] == pytest.approx(0, abs=1e-12)


def test_a_logarithmic_axis_shows_how_far_a_limit_is_violated(motions):
    ax = Figure().subplots()
    (line,) = figures.plot_residuals(ax, motions["regular"], SPEED, scale="log")
    wanted = np.maximum(0, -margins_of(motions["regular"])["speed-limit"])
    np.testing.assert_allclose(line.get_ydata(), wanted, atol=1e-12)
    assert wanted.max() > 0 and ax.get_yscale() == "log"
    assert ax.get_ylabel().replace("\n", " ") == "violation of speed-limit (m/s)"


def test_small_margins_are_in_millimeters_and_others_in_their_own_unit(cuts):
    near = noslip.constraints.HalfSpace(point=(0, 0, -0.1))
    ax = Figure().subplots()
    (line,) = figures.plot_residuals(ax, cuts[0], near)
    assert ax.get_ylabel().endswith("(mm)")
    np.testing.assert_allclose(line.get_ydata(), 1e3 * (cuts[0].positions[:, 2] + 0.1), rtol=1e-12)
    ax = Figure().subplots()
    (line,) = figures.plot_residuals(ax, cuts[0], noslip.constraints.AngularRateLimit(rate=0.01))
    assert ax.get_ylabel().replace("\n", " ").endswith("(rad/s)")
    turns = (cuts[0].rotations[1:] * cuts[0].rotations[:-1].inv()).magnitude()
    rates = turns / np.diff(cuts[0].times)
    np.testing.assert_allclose(line.get_ydata(), 0.01 - rates, atol=1e-12)


def test_titles_say_which_limit_is_kept_and_by_how_much(motions, limited):
    before, after = motions["demonstration"], limited
    pair = {"demonstration": before, "optimized": after}
    # Kept with room to spare, by both.
    far = noslip.KeepOutSphere(center=(0.5, 0.5, 0), radius=0.05)
    told = title_of(figures.compare_motions(pair, far))
    first, last = (
        1e3 * (np.linalg.norm(m.positions[1:] - [0.5, 0.5, 0], axis=1).min() - 0.05)
        for m in (before, after)
    )
    kept = re.fullmatch(
        r"Optimized keeps (.*) from “keep-out-sphere”, demonstration keeps (.*) from it", told
    )
    assert kept, told
    for text, wanted in zip(kept.groups(), (last, first), strict=True):
        millimeters = numbers_in(text)[0] * (1 if " mm" in text else 1e3)
        assert millimeters == pytest.approx(wanted, rel=0.006)
    # Violated before, used up after.
    told = title_of(figures.compare_motions(pair, SPEED))
    violation = -margins_of(before)["speed-limit"].min()
    reached = limited.times[1:][np.argmax(margins_of(limited)["speed-limit"] < 1e-9)]
    limit = f"Optimized reaches “speed-limit” at {reached:.3g} s and keeps it"
    assert told == f"{limit}, demonstration violates it by up to {violation:.3g} m/s"
    # An equality first, then the limit.
    told = title_of(figures.compare_motions(pair, [SPEED, BLADE]))
    assert re.match(
        r"Demonstration slips .*; optimized does not slip, ends .*\.\s+Optimized reaches", told
    )


def test_spread_tells_how_many_violate_a_limit(motions, limited, every_figure):
    told = title_of(figures.demonstration_spread([motions["demonstration"], limited], SPEED))
    violation = -margins_of(motions["demonstration"])["speed-limit"].min()
    assert told == f"Speed-limit of 2 motions: violated by 1, by up to {violation:.3g} m/s"
    told = title_of(figures.demonstration_spread([limited, limited], BOX))
    least = margins_of(limited)["box"].min()
    assert told == f"Box of 2 motions: kept by all, least margin {1e3 * least:.3g} mm"
    ax = panel(every_figure["spread limits"], "margin of box (m)")
    np.testing.assert_allclose(
        ax.get_lines()[0].get_ydata(), margins_of(limited)["box"], atol=1e-11
    )
    assert forbidden_side(ax)[1] == pytest.approx(0, abs=1e-12)


def test_forces_of_limits_alone_are_shown_too(blade_dmp):
    rollout = under(blade_dmp, (SPEED,)).rollout()
    assert not rollout.constraint_names
    ax = panel(figures.compare_motions(rollout, SPEED), "constraint's linear acceleration (m/s²)")
    wanted = np.linalg.norm(rollout.constraint_forces[:, :3], axis=1)
    assert wanted.max() > 0
    np.testing.assert_array_equal(ax.get_lines()[0].get_ydata(), wanted)


# ---------------------------------------------------------------- constraint_history


def rows_of(figure):
    """Panels of a history, a list a row."""
    grid = {}
    for ax in figure.axes:
        place = ax.get_subplotspec()
        grid.setdefault(place.rowspan.start, []).append(ax)
    return [grid[row] for row in sorted(grid)]


def label_of(ax):
    return ax.get_ylabel().replace("\n", " ")


def test_history_has_a_row_of_panels_a_constraint(every_figure, limited):
    rows = rows_of(every_figure["history"])
    headings = [row[0].get_title(loc="left").split(":")[0] for row in rows]
    assert headings == ["blade", "keep-out-sphere", "speed-limit", "box"]
    labels = [[label_of(ax) for ax in row] for row in rows]
    assert [row[0] for row in labels] == [
        *("|residual| (m/s)", "margin (m)", "margin (m/s)", "margin (m)")
    ]
    added = ["multiplier (m/s²)", "added acceleration (m/s²)"]
    # The box did nothing, and has no panels to say so.
    assert [bool(limited.force_of(name).any()) for name in headings] == [True] * 3 + [False]
    assert [row[1:] for row in labels] == [added, added, added, []]
    assert [ax.get_xlabel() for ax in rows[-1]] == ["time since start (s)"]
    assert [bool(row[0].patches) for row in rows] == [False, True, True, True]


def test_history_draws_what_the_rollout_says(every_figure, limited):
    blade, sphere, speed, box = rows_of(every_figure["history"])
    expected = [
        (blade, np.abs(limited.constraint_residuals), limited.multipliers),
        (sphere, limited.margins[:, :1], limited.limit_multipliers[:, :1]),
        (speed, limited.margins[:, 1:2], limited.limit_multipliers[:, 1:2]),
        (box, limited.margins[:, 2:], limited.limit_multipliers[:, 2:]),
    ]
    for (values, *more), margins, pushes in expected:
        name = values.get_title(loc="left").split(":")[0]
        for ax, columns in zip([values, *more[:1]], (margins, pushes), strict=False):
            drawn = list(curves(ax).items())
            lines = [xy for label, xy in drawn if not label.startswith("_child")]
            assert len(lines) == columns.shape[1]
            for line, column in zip(lines, columns.T, strict=True):
                np.testing.assert_array_equal(line[:, 0], limited.times)
                np.testing.assert_array_equal(line[:, 1], column)
        wanted = np.linalg.norm(limited.force_of(name)[:, :3], axis=1)
        if not wanted.any():
            assert not more
            continue
        (line,) = more[-1].get_lines()
        np.testing.assert_array_equal(line.get_ydata(), wanted)
        heading = more[-1].get_title(loc="left")
        peak, at = numbers_in(heading.replace(" m/s²", ""))
        assert peak == pytest.approx(wanted.max(), rel=0.06)
        assert at == pytest.approx(limited.times[np.argmax(wanted)], abs=1e-3)


def test_all_forces_of_a_history_add_up_to_the_constraint_force(limited):
    names = ("blade", "keep-out-sphere", "speed-limit", "box")
    total = sum(limited.force_of(name) for name in names)
    np.testing.assert_allclose(total, limited.constraint_forces, atol=1e-6)


def test_history_names_the_rows_of_a_box(every_figure):
    texts = [text.get_text() for text in every_figure["history"].legends[0].get_texts()]
    assert texts == [f"{end} {axis}" for end in ("least", "largest") for axis in "xyz"]
    lines = rows_of(every_figure["history"])[3][0].get_lines()
    assert len({line.get_color() for line in lines if line.get_label() in texts}) == 6
    assert not every_figure["history of a blade"].legends


def test_history_says_the_finding(every_figure, limited):
    told = title_of(every_figure["history"])
    residual = np.abs(limited.constraint_residuals).max()
    found = re.fullmatch(
        r"Blade holds within (.*) m/s; (.*) is reached at (.*) s, and kept; "
        r"(.*) pushes hardest, up to (.*) m/s², from (.*) to (.*) s",
        told,
    )
    assert found, told
    assert residual < float(found[1]) == 1e-9
    limits = {"keep-out-sphere": [0], "speed-limit": [1], "box": [2, 3, 4, 5, 6, 7]}
    margin = limited.margins[:, limits[found[2]]].min(axis=1)
    assert margin.min() < 1e-9
    assert float(found[3]) == pytest.approx(limited.times[np.argmax(margin <= 1e-9)], abs=1e-3)
    forces = {n: np.linalg.norm(limited.force_of(n)[:, :3], axis=1) for n in limits}
    hardest = max(forces, key=lambda name: forces[name].max())
    assert found[4] == hardest
    assert float(found[5]) == pytest.approx(forces[hardest].max(), rel=0.006)
    when = limited.times[forces[hardest] > 1e-6 * forces[hardest].max()]
    assert [float(found[6]), float(found[7])] == pytest.approx([when[0], when[-1]], abs=1e-3)


def test_history_says_what_gave_way_and_shows_turning_forces(every_figure, yielding):
    figure = every_figure["history yielding"]
    labels = {label_of(ax) for ax in figure.axes}
    assert "added angular acceleration (rad/s²)" in labels
    assert {"margin (rad/s)", "margin (m/s²)", "margin (rad/s²)"} <= labels
    gave_way = {limit.name: limit for limit in yielding.gave_way}
    assert "a limit of a rather long name that gives way" in gave_way
    told = title_of(figure)
    mentioned = 0
    for name, limit in gave_way.items():
        if f"{style.short_name(name)} gave way by up to" in told:
            scale = 1e3 if f"{quantities.number(1e3 * limit.violation)} mm" in told else 1
            assert quantities.number(scale * limit.violation) in told
            mentioned += 1
    assert mentioned == min(2, len(gave_way))


def test_history_of_a_violated_equality_shows_it_on_a_linear_axis(blade_dmp):
    table = under(blade_dmp, (stay_on_table,))
    off = table.rollout(start_position=[0, 0, 0.3])
    figure = figures.constraint_history(off, stay_on_table)
    (line,) = rows_of(figure)[0][0].get_lines()
    assert label_of(rows_of(figure)[0][0]) == "residual (m)"
    np.testing.assert_array_equal(line.get_ydata(), off.constraint_residuals[:, 0])
    assert title_of(figure) == "Stay on table is violated by up to 0.3 m"


def test_history_without_constraints_has_no_units_of_residuals(every_figure):
    labels = {label_of(row[0]) for row in rows_of(every_figure["history without units"])}
    assert labels == {"|residual| (own unit)", "margin (own unit)"}
    assert " m/s;" not in title_of(every_figure["history without units"])


def test_history_needs_a_rollout_with_its_own_constraints(motions, limited):
    with pytest.raises(InputError, match="takes the rollout of a primitive, got a PoseTrajectory"):
        figures.constraint_history(motions["demonstration"])
    with pytest.raises(InputError, match="no constraint took part"):
        figures.constraint_history(motions["regular"])
    with pytest.raises(InputError, match="'speed-limit' took part"):
        figures.constraint_history(limited, [BLADE, SPHERE])
    assert title_of(figures.constraint_history(limited, LIMITED, title="mine")) == "mine"


# ---------------------------------------------------------------- angles


def test_angles_are_those_of_the_rotation_and_do_not_jump():
    rng = np.random.default_rng(0)
    knots = Rotation.random(30, random_state=rng)
    steps = [
        Rotation.from_rotvec(np.linspace(0, 1, 200)[:, None] * (b * a.inv()).as_rotvec()) * a
        for a, b in pairwise(knots)
    ]
    rotations = Rotation.concatenate(steps)
    angles = roll_pitch_yaw(rotations)
    back = Rotation.from_euler("xyz", angles, degrees=True)
    assert np.max((back * rotations.inv()).magnitude()) < 1e-12
    turns = np.abs(np.diff(angles, axis=0))
    # Near a pitch of 90 degrees roll and yaw turn fast, together; elsewhere nothing does.
    regular = np.abs(np.cos(np.radians(angles[1:, 1]))) > 0.1
    assert turns[regular].max() < 30


def test_angles_begin_as_scipys():
    rotations = Rotation.random(50, random_state=np.random.default_rng(1))
    for rotation in rotations:
        mine = roll_pitch_yaw(Rotation.concatenate([rotation]))
        np.testing.assert_allclose(mine[0], rotation.as_euler("xyz", degrees=True), atol=1e-9)


def test_angles_go_on_through_a_pitch_of_90_degrees():
    pitch = np.arange(0.0, 360.0, 5.0)
    wanted = np.column_stack([np.full_like(pitch, 20.0), pitch, np.full_like(pitch, -50.0)])
    angles = roll_pitch_yaw(Rotation.from_euler("xyz", wanted, degrees=True))
    np.testing.assert_allclose(angles, wanted, atol=1e-6)


def test_angles_unwrap_over_several_turns():
    wanted = np.column_stack([np.zeros(200), np.zeros(200), np.linspace(0, 1500, 200)])
    rotations = Rotation.from_euler("xyz", wanted, degrees=True)
    np.testing.assert_allclose(roll_pitch_yaw(rotations), wanted, atol=1e-9)


@pytest.mark.parametrize("pitch", [90, -90])
def test_angles_at_gimbal_lock_keep_the_roll(pitch):
    angles = np.column_stack([np.zeros(9), np.full(9, pitch), np.linspace(0, 160, 9)])
    rotations = Rotation.from_euler("xyz", angles, degrees=True)
    np.testing.assert_allclose(roll_pitch_yaw(rotations), angles, atol=1e-6)


def test_angles_begin_near_what_is_asked():
    rotations = Rotation.from_euler("xyz", [[0, 0, -179], [0, 0, -178]], degrees=True)
    near = roll_pitch_yaw(rotations, near=[0, 0, 179])
    np.testing.assert_allclose(near, [[0, 0, 181], [0, 0, 182]], atol=1e-9)
    flipped = roll_pitch_yaw(rotations, near=[180, 180, 0])
    np.testing.assert_allclose(flipped, [[180, 180, 1], [180, 180, 2]], atol=1e-9)


# ---------------------------------------------------------------- snapshots


def snapshots_of(figure):
    return [ax for ax in figure.axes if isinstance(ax, Axes3D)]


def test_blades_stand_on_the_path_in_the_bodys_xz_plane(motions):
    motion = motions["demonstration"]
    ax = Figure().add_subplot(projection="3d")
    path, blades, _ = figures.plot_blades(ax, motion, blades=9, size=0.2)
    np.testing.assert_array_equal(np.transpose(path.get_data_3d()), motion.positions)
    where = snapshots.equally_far_apart(motion, 9)
    assert len(where) == 9 == len(blades.get_facecolor())
    for sample, corners in zip(where, snapshots.blade_corners(motion, where, 0.2), strict=True):
        body = motion.rotations[sample].inv().apply(corners - motion.positions[sample])
        np.testing.assert_allclose(body[:, 1], 0, atol=1e-12)
        np.testing.assert_allclose(body[0], 0, atol=1e-12)
        assert np.ptp(body[:, 0]) == pytest.approx(0.2)


def test_blades_are_equally_far_apart(motions):
    motion = motions["demonstration"]
    traveled = np.concatenate(
        [[0], np.cumsum(np.linalg.norm(np.diff(motion.positions, axis=0), axis=1))]
    )
    gaps = np.diff(traveled[snapshots.equally_far_apart(motion, 10)])
    assert np.ptp(gaps) < 2 * np.diff(traveled).max()
    assert gaps.sum() == pytest.approx(traveled[-1])


def test_blades_are_colored_by_the_share_of_slip(motions, resting):
    for name in ("demonstration", "optimized"):
        motion = motions[name]
        speeds = np.linalg.norm(measures.steps(motion).linear, axis=1)
        moving = speeds > 2e-3 * speeds.max()
        shares = snapshots.slip_shares(motion)
        np.testing.assert_allclose(
            shares[1:][moving], np.abs(measures.slip(motion)[moving]) / speeds[moving], atol=1e-12
        )
        ax = Figure().add_subplot(projection="3d")
        blades = figures.plot_blades(ax, motion)[1]
        wanted = snapshots.SLIP_COLORS(shares[snapshots.equally_far_apart(motion, 14)])
        # Faces are sorted by depth.
        drawn = sorted(blades.get_facecolor().tolist())
        np.testing.assert_allclose(drawn, sorted(wanted.tolist()))
    assert snapshots.slip_shares(motions["optimized"]).max() < 1e-9
    assert not snapshots.slip_shares(resting).any()


def test_snapshots_have_one_scale_in_all_axes_and_panels(every_figure):
    panels = snapshots_of(every_figure["snapshots"])
    assert len(panels) == 4
    limits = np.array([[ax.get_xlim(), ax.get_ylim(), ax.get_zlim()] for ax in panels])
    np.testing.assert_array_equal(limits, np.broadcast_to(limits[0], limits.shape))
    for ax in panels:
        scale = ax._box_aspect / np.ptp(limits[0], axis=1)
        np.testing.assert_allclose(scale, scale[0])


def test_snapshots_hold_everything_they_draw(every_figure):
    for name in ("snapshots", "snapshots one", "snapshots resting"):
        figure = every_figure[name]
        figure.canvas.draw()
        page = figure.bbox
        for ax in snapshots_of(figure):
            limits = np.array([ax.get_xlim(), ax.get_ylim(), ax.get_zlim()])
            for line in ax.get_lines():
                points = np.array(line.get_data_3d())
                assert np.all(points >= limits[:, :1]) and np.all(points <= limits[:, 1:])
            corners = snapshots._on_page(ax, [tuple(limits[:, i]) for i in (0, 1)])
            assert corners.min() >= 0 and np.all(corners <= [page.x1, page.y1])
            assert len(ax.texts) == 3
            for text in [*ax.texts, ax.title]:
                box = text.get_window_extent()
                assert box.x0 >= 0 and box.y0 >= 0, (name, text.get_text())
                assert box.x1 <= page.x1 and box.y1 <= page.y1, (name, text.get_text())


def test_snapshots_tell_slip_and_distance_from_the_desired_path(every_figure, motions):
    titles = [ax.get_title().split("\n") for ax in snapshots_of(every_figure["snapshots"])]
    assert [title[0] for title in titles] == [
        "A   Demonstration",
        "B   Regular",
        "C   Constrained",
        "D   Optimized",
    ]
    for (_, slip, off, *end), motion in zip(titles, motions.values(), strict=True):
        found = noslip.check(motion, BLADE)
        if found.peak < 1e-9:
            assert slip == "does not slip"
        else:
            assert numbers_in(slip) == pytest.approx([found.slip_distance, found.peak], rel=0.06)
        if motion is motions["demonstration"]:
            assert off == "on the desired path"
            continue
        dense = motions["demonstration"].resampled(times=np.linspace(0, 0.99, 20_000)).positions
        nearest = [np.linalg.norm(dense - point, axis=1).min() for point in motion.positions]
        told, missed = (
            numbers_in(text)[0] * (1e-3 if " mm" in text else 1) for text in (off, *end)
        )
        goal = motions["demonstration"].positions[-1]
        assert missed == pytest.approx(np.linalg.norm(motion.positions[-1] - goal), rel=0.06)
        assert told == pytest.approx(max(nearest), rel=0.02, abs=3e-4)


def test_distance_to_a_path_is_that_to_its_pieces():
    path = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [1, 1, 0]])
    assert snapshots.distance_to_path(np.array([[0.5, 0, 0], [1, 0.3, 0]]), path) == 0
    assert snapshots.distance_to_path(np.array([[0.5, 0.2, 0]]), path) == pytest.approx(0.2)
    assert snapshots.distance_to_path(np.array([[1, 3.0, 0]]), path) == pytest.approx(2)


# ---------------------------------------------------------------- spread


def test_spread_shows_samples_as_they_are_and_their_mean(every_figure, cuts):
    ax = panel(every_figure["spread"], "x (mm)")
    *each, mean = ax.get_lines()
    for line, cut in zip(each, cuts, strict=True):
        share = 100 * (cut.times - cut.times[0]) / cut.duration
        np.testing.assert_allclose(line.get_xdata(), share)
        np.testing.assert_array_equal(line.get_ydata(), 1e3 * cut.positions[:, 0])
        assert line.get_linewidth() < 1 and line.get_alpha() < 1
    grid = mean.get_xdata()
    assert (grid[0], grid[-1]) == (0, 100)
    sampled = np.array([np.interp(grid, *line.get_data()) for line in each])
    np.testing.assert_allclose(mean.get_ydata(), sampled.mean(axis=0))
    (band,) = [c for c in ax.collections if isinstance(c, PolyCollection)]
    middle = np.abs(band.get_paths()[0].vertices[:, 0] - 50) < 1e-9
    width = np.ptp(band.get_paths()[0].vertices[middle, 1])
    assert width == pytest.approx(2 * np.std(sampled[:, grid == 50], ddof=1))


def test_spread_does_not_depend_on_the_clock(cuts, resting):
    double = noslip.PoseTrajectory(
        times=100 + 2 * cuts[0].times, positions=cuts[0].positions, rotations=cuts[0].rotations
    )
    figure = figures.demonstration_spread([cuts[0], double])
    first, second, mean = panel(figure, "y (mm)").get_lines()
    np.testing.assert_allclose(first.get_xydata(), second.get_xydata(), atol=1e-9)
    assert mean.get_ydata().max() == pytest.approx(first.get_ydata().max(), rel=1e-3)


def test_spread_shows_the_signed_lateral_velocity(every_figure, cuts):
    ax = panel(every_figure["spread"], "lateral velocity (mm/s)")
    *each, mean = ax.get_lines()
    for line, cut in zip(each, cuts, strict=True):
        np.testing.assert_array_equal(line.get_ydata(), 1e3 * step_residuals(cut, BLADE)[:, 0])
    peak, at, largest = numbers_in(title_of(every_figure["spread"]))[1:]
    grid, values = mean.get_data()
    assert peak == pytest.approx(values[np.argmax(np.abs(values))], rel=0.005)
    assert at == pytest.approx(grid[np.argmax(np.abs(values))], abs=0.5)
    wanted = max(noslip.check(cut, BLADE).peak for cut in cuts)
    assert largest == pytest.approx(1e3 * wanted, rel=0.005)
    assert all(ax.get_yscale() == "linear" for ax in every_figure["spread"].axes)


def test_spread_of_trained_motions_says_that_they_are_zero(every_figure, trained):
    figure = every_figure["spread trained"]
    wanted = 1e3 * max(noslip.check(motion, BLADE).peak for motion in trained)
    assert wanted < 1e-9
    assert not any("lateral velocity" in ax.get_ylabel() for ax in figure.axes)
    note = figure.legends[0].get_title().get_text()
    assert note == "Without a panel, as all motions keep it: lateral velocity below 1e-9 m/s"
    assert title_of(figure).endswith("below 1e-9 m/s")


def test_spread_shows_sizes_of_residuals_too_small_to_be_seen(cuts):
    nearly = noslip.velocity_constraint(name="nearly")(lambda m: 1e-6 * m.linear_velocity[0])
    ax = panel(figures.demonstration_spread(cuts, nearly), "|nearly| (mm/s)")
    assert ax.get_yscale() == "log"
    wanted = 1e3 * max(noslip.check(cut, nearly).peak for cut in cuts)
    assert max(line.get_ydata().max() for line in ax.get_lines()) == pytest.approx(wanted)
    assert ax.texts[0].get_text().startswith("largest of all: ")


def test_one_motion_has_no_spread(every_figure):
    ax = panel(every_figure["spread one"], "x (m)")
    assert len(ax.get_lines()) == 1 and not ax.collections


# ---------------------------------------------------------------- adjustments


def test_adjustments_are_the_differences_of_the_angles(every_figure, cuts, trained):
    for index, angle in enumerate(("roll", "pitch", "yaw")):
        ax = panel(every_figure["adjustments"], f"adjustment of {angle} (°)")
        for line, cut, motion in zip(ax.get_lines(), cuts, trained, strict=False):
            share = 100 * motion.times / motion.duration
            before = np.degrees(np.unwrap(cut.rotations.as_euler("xyz"), axis=0)[:, index])
            after = np.degrees(np.unwrap(motion.rotations.as_euler("xyz"), axis=0)[:, index])
            own = 100 * (cut.times - cut.times[0]) / cut.duration
            np.testing.assert_allclose(line.get_xdata(), share)
            np.testing.assert_allclose(
                line.get_ydata(), after - np.interp(share, own, before), atol=1e-9
            )


def test_the_largest_adjustment_is_named(every_figure, cuts):
    figure = every_figure["adjustments"]
    peaks = []
    for ax in figure.axes:
        each = [line.get_ydata() for line in ax.get_lines()[:TRIALS]]
        peaks.append([np.abs(values).max() for values in each])
        trial = int(np.argmax(peaks[-1]))
        largest = each[trial][np.argmax(np.abs(each[trial]))]
        name, _, told = ax.texts[0].get_text().partition(": ")
        assert name == cuts[trial].name
        assert numbers_in(told)[0] == pytest.approx(largest, abs=0.05)
    typical = np.median(peaks, axis=1)
    most = int(np.argmax(typical))
    told = numbers_in(title_of(figure))
    assert title_of(figure).startswith(("Roll", "Pitch", "Yaw")[most])
    assert told[:2] == pytest.approx([typical[most], max(peaks[most])], rel=0.005)
    colors = [line.get_color() for line in figure.axes[0].get_lines()[:TRIALS]]
    assert len(set(colors)) == TRIALS


def test_adjustments_need_a_pair_for_each(cuts, trained):
    with pytest.raises(InputError, match=f"got 1 for {TRIALS}"):
        figures.orientation_adjustments(cuts, trained[:1])


def test_trials_of_the_same_name_are_told_apart(trained):
    figure = figures.orientation_adjustments(trained, trained)
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert names == [f"rollout ({i})" for i in range(1, TRIALS + 1)]
    assert title_of(figure) == "No angle is adjusted by more than 0°"


# ---------------------------------------------------------------- style and saving


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0, "0"),
        (3.4796, "3.48"),
        (999.7, "1.0e3"),
        (42.23, "42.2"),
        (8.06e-14, "8.1e-14"),
        (0.0123, "0.0123"),
        (4e-4, "4.0e-4"),
    ],
)
def test_numbers_are_short(value, text):
    assert style.number(value) == text


def test_time_counts_from_where_a_replanned_motion_begins():
    dmp = cutting()
    controller = dmp.controller(time_step=dmp.duration / 100)
    state = [controller.step() for _ in range(20)][-1]
    motion = dmp.replan(state).rollout()
    assert motion.times[0] > 0
    figure = style.column_figure(2)
    axes = figure.subplots(1, 4)
    drawn = [
        figures.plot_positions(axes[0], motion),
        figures.plot_orientation(axes[1], motion),
        figures.plot_forces(axes[2], motion),
        figures.plot_constraint(axes[3], motion, dmp.constraints, "blade"),
    ]
    drawn.append(figures.constraint_history(motion, dmp.constraints).axes[0].lines)
    for lines in drawn:
        np.testing.assert_allclose(lines[0].get_xdata(), motion.times - motion.times[0])
    spread = figures.demonstration_spread([motion]).axes[0].lines[0].get_xdata()
    assert (spread[0], spread[-1]) == (0, pytest.approx(100))


def test_units_follow_the_size():
    assert quantities.value_text(0.00121, "m") == "1.21 mm"
    assert quantities.value_text(0.25, "m") == "0.25 m"


def saved(figure, path):
    return [file.read_bytes() for file in figures.save_figure(figure, path)]


def test_saving_writes_png_and_svg(every_figure, tmp_path):
    written = figures.save_figure(every_figure["spread"], tmp_path / "made" / "spread.v2")
    assert [path.name for path in written] == ["spread.v2.png", "spread.v2.svg"]
    assert written[0].read_bytes().startswith(b"\x89PNG")
    width, height = every_figure["spread"].get_size_inches()
    pixels = mpl.image.imread(written[0]).shape
    assert pixels[:2] == (round(200 * height), round(200 * width))
    assert b"</svg>" in written[1].read_bytes()
    assert sorted(p.name for p in written[0].parent.iterdir()) == [p.name for p in written]


def test_the_same_data_give_the_same_bytes(motions, tmp_path):
    def make(name):
        figure = figures.compare_motions(motions["optimized"], BLADE)
        snapshot = figures.blade_snapshots(motions["optimized"])
        return saved(figure, tmp_path / name) + saved(snapshot, tmp_path / f"{name}b")

    salt = mpl.rcParams["svg.hashsalt"]
    first = make("a")
    assert first == make("b")
    assert mpl.rcParams["svg.hashsalt"] == salt
    assert b"<dc:date>" not in first[1]
    with ThreadPoolExecutor(2) as pool:
        assert all(found == first for found in pool.map(make, ["c", "d"]))


def test_what_cannot_be_written_leaves_what_was_there(motions, tmp_path):
    (tmp_path / "file").write_text("kept")
    figure = figures.compare_motions(motions["regular"])
    with pytest.raises(InputError, match="cannot be written"):
        figures.save_figure(figure, tmp_path / "file" / "figure")
    assert (tmp_path / "file").read_text() == "kept"


def test_interrupted_rendering_leaves_what_was_there(motions, tmp_path, monkeypatch):
    figure = figures.compare_motions(motions["regular"])
    before = saved(figure, tmp_path / "figure")
    monkeypatch.setattr(figure, "savefig", lambda *a, **k: (_ for _ in ()).throw(KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt):
        figures.save_figure(figure, tmp_path / "figure")
    assert [(tmp_path / f"figure{s}").read_bytes() for s in (".png", ".svg")] == before
    assert len(list(tmp_path.iterdir())) == 2


def test_bands_and_blades_are_drawn_in_the_palette_too(every_figure):
    palette = {to_rgba(color)[:3] for color in style.PALETTE.values()}
    for ax in every_figure["spread"].axes:
        for band in ax.collections:
            assert tuple(band.get_facecolor()[0][:3]) in palette
    assert isinstance(every_figure["spread"].axes[0], Axes)
