# /// script
# requires-python = ">=3.11"
# dependencies = ["noslip"]
# [tool.uv.sources]
# noslip = { path = ".." }
# ///
"""A start off the constraint: replaced by the nearest one that is on it, or pulled in smoothly."""

import argparse

import numpy as np
from matplotlib.lines import Line2D
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.figures import save_figure, style

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--out", default="any_start.png", help="the picture's file")
out = parser.parse_args().out

# A cut of 10 cm on a table in 2 s, along which the blade points 11 degrees aside.
s = np.linspace(0, 1, 1001)
path = np.column_stack([0.1 * s, 0.02 * s, 0 * s])
hand = ns.PoseTrajectory(2 * s, path, Rotation.identity(len(s)), name="demonstration")
table = ns.learn(hand, [ns.constraints.PlaneContact()])
blade = ns.learn(hand, [ns.Blade()]).constrained

# Started 10 mm above the table, and with the hand's 10 mm/s across the blade.
above = {"start_position": [0.0, 0.0, 0.01]}
on_the_table = table.rollout(**above, project_start="pose")
left = np.abs(on_the_table.constraint_residuals).max()
print(f'project_start="pose": largest residual {left:.1e} m')

panels = {
    'table, project_start="nothing"': (table, above, "nothing"),
    'table, project_start="velocity"': (table, above, "velocity"),
    'blade, project_start="nothing"': (blade, {}, "nothing"),
}
rates = dict(zip((5.0, 10.0, 20.0), ("blue", "green", "purple"), strict=True))
figure = style.new_figure(6.0, 2.9)
errors = []
for ax, (title, (dmp, start, project)) in zip(figure.subplots(1, 3), panels.items(), strict=True):
    for rate, color in rates.items():
        motion = dmp.rollout(**start, project_start=project, pull_in=rate)
        t, residual = motion.times, 1e3 * np.abs(motion.constraint_residuals[:, 0])
        if dmp is blade:  # A velocity is asked at the middle of each step, a position at its end.
            t = np.append(t[0], (t[1:] + t[:-1]) / 2)
        # At position level, a start whose velocity is not projected is critically damped.
        damped = 1 + rate * t if (dmp, project) == (table, "nothing") else 1
        predicted = residual[0] * damped * np.exp(-rate * t)
        errors.append(np.abs(residual - predicted).max() / residual[0])
        ax.semilogy(t, np.maximum(residual, 1e-18), color=style.PALETTE[color], lw=1.4)
        ax.semilogy(t, predicted, color="black", ls=(0, (1, 2.5)), lw=1.6)
        print(f"{title}, pull_in={rate:g}: {errors[-1]:.1e} of the first residual off the formula")
    ax.set_ylim(1e-12, 50)
    unit = "height (mm)" if dmp is table else "speed across (mm/s)"
    style.dress(ax, "time (s)", unit, title=title.replace(", ", ",\n"))
handles = {
    f"pull_in={rate:g}/s": Line2D([], [], color=style.PALETTE[color])
    for rate, color in rates.items()
}
handles["predicted"] = Line2D([], [], color="black", ls=(0, (1, 2.5)), lw=1.6)
style.put_legend(figure, handles)
style.write_title(
    figure,
    f"A violation at the start decays as predicted: off by {style.number(max(errors))} of it",
)
save_figure(figure, out)
