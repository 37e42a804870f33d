"""Vectors and channels over time: every value is drawn, and the title says what moves most."""

from __future__ import annotations

import re

import numpy as np
import pytest

import noslip as ns
from noslip.constraints.joints import JointLimits
from noslip.errors import InputError
from noslip.figures import plot_values
from refusals import refusal


def test_every_value_is_a_line_under_its_name_and_unit() -> None:
    t = np.linspace(3, 5, 60)
    values = np.column_stack([np.sin(k * t) * k for k in range(1, 8)])
    names, units = [f"q{k}" for k in range(1, 8)], ("rad",) * 5 + ("m", "1")
    joints = ns.Trajectory(t, values, names=names, units=units, name="reach")
    figure = joints.plot()
    drawn = {line.get_label(): line for ax in figure.axes for line in ax.get_lines()}
    assert sorted(drawn) == sorted(names)
    for name, column in zip(names, values.T, strict=True):
        np.testing.assert_array_equal(drawn[name].get_ydata(), column)
        np.testing.assert_allclose(drawn[name].get_xdata(), t - 3)
    labels = [ax.get_ylabel() for ax in figure.axes]
    assert labels == ["values (rad)", "values (rad)", "q6 (m)", "q7 (1)"]
    (most,) = [k for k in range(5) if np.ptp(values[:, k]) == np.ptp(values[:, :5], axis=0).max()]
    assert f"q{most + 1} spans {np.ptp(values[:, most]):.3g} rad" in figure.get_suptitle()
    assert joints.plot(title="Mine").get_suptitle() == "Mine"


def test_several_motions_have_a_panel_a_value_and_limits_that_they_come_near() -> None:
    t = np.linspace(0, 1, 40)
    reach = ns.Trajectory(t, np.column_stack([t, 0.1 * t, t**2]), units=("rad",) * 3)
    limits = JointLimits((-9.0, None, None), (1.1, 5.0, 1.0))
    far = ns.Trajectory(t, 0.9 * reach.values, units=reach.units)
    figure = plot_values({"demonstration": reach, "learned": far}, limits)
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [
        "demonstration",
        "learned",
    ]
    assert [ax.get_ylabel() for ax in figure.axes] == [f"{name} (rad)" for name in reach.names]
    beside = [
        [line.get_ydata()[0] for line in ax.get_lines() if len(line.get_ydata()) == 2]
        for ax in figure.axes
    ]
    assert beside == [[1.1], [], [1.0]]
    for ax, limit in zip(figure.axes, (1.1, 0.0, 1.0), strict=True):
        assert ax.get_ylim()[0] <= limit <= ax.get_ylim()[1]
    rolled = ns.learn(reach).rollout()
    told = plot_values({"demonstration": reach, "learned": rolled}).get_suptitle()
    off = re.search("learned ends (.*) rad from its goal", told.replace("\n", " "))
    assert off and float(off[1]) == pytest.approx(rolled.end_error, rel=0.06)


def test_motions_of_other_values_are_refused() -> None:
    one, two = (ns.Trajectory([0, 1], np.zeros((2, n))) for n in (1, 2))
    with pytest.raises(InputError, match="draw motions of the same values together"):
        plot_values({"a": one, "b": two})


def test_poses_are_drawn_elsewhere() -> None:
    assert "compare_motions draws poses" in refusal(InputError, plot_values, 1)
