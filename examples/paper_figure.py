# /// script
# requires-python = ">=3.11"
# dependencies = ["noslip"]
# [tool.uv.sources]
# noslip = { path = ".." }
# ///
"""A paper's figure, one column wide or two: a blade's path, yaw, slip and speed."""

import argparse

import numpy as np
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.figures import (
    column_figure,
    plot_orientation,
    plot_path,
    plot_residuals,
    plot_speed,
    save_figure,
    style,
)

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--columns", type=int, choices=(1, 2), default=2)
parser.add_argument("--radians", action="store_true", help="angles in radians, not degrees")
parser.add_argument("--out", default="paper_figure.png", help=".pdf or .svg for a paper")
options = parser.parse_args()

# An S-shaped cut of 10 cm in 4 s; the hand turns the blade only roughly into the path.
s = np.linspace(0, 1, 501)
u = s**3 * (10 - 15 * s + 6 * s**2)
path = np.column_stack([0.1 * u, 0.02 * np.sin(2 * np.pi * u), 0 * u])
yaw = 0.5 * np.cos(2 * np.pi * s) + 0.3 * np.sin(3 * np.pi * s)
hand = ns.PoseTrajectory(4 * s, path, Rotation.from_euler("z", yaw), name="demonstration")

blade = ns.Blade()
motion = ns.learn(hand, [blade]).rollout()
motions = {"demonstration": hand, "optimized": motion}
print(f"largest residual {np.abs(motion.constraint_residuals).max():.1e} m/s")

if options.columns == 1:
    figure = column_figure(1, height=3.3)
    above, slip = figure.subplots(2, 1, height_ratios=(1.2, 1))
else:
    figure = column_figure(2, height=3.3)
    (above, turned), (slip, speed) = figure.subplots(2, 2, height_ratios=(1.2, 1))
    plot_orientation(turned, motions, "yaw", degrees=not options.radians)
    plot_speed(speed, motions)
plot_path(above, motions)
plot_residuals(slip, motions, blade)
# A caption says what a title would; panels need letters.
for letter, ax in zip("abcd"[: len(figure.axes)], figure.axes, strict=True):
    ax.set_title(f"({letter})", loc="left", fontsize=style.SMALL_FONT_SIZE)
above.set_title("")
figure.align_ylabels()
style.name_lines(figure, motions)
save_figure(figure, options.out)
