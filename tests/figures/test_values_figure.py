"""Vectors and channels over time: every value is drawn, and the title says what moves most."""

from __future__ import annotations

import numpy as np

import noslip as ns
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


def test_poses_are_drawn_elsewhere() -> None:
    assert "compare_motions draws poses" in refusal(InputError, plot_values, 1)
