# /// script
# requires-python = ">=3.11"
# dependencies = ["noslip"]
# [tool.uv.sources]
# noslip = { path = ".." }
# ///
"""A steerable needle with a beveled tip: its path bends everywhere alike, and roll steers it."""

import argparse

import numpy as np
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.figures import plot_residuals, save_figure, style

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--out", default="needle.png", help="the picture's file")
out = parser.parse_args().out

# A planner's sketch, 12 cm into tissue at 1 cm/s: a bend to the left, half a turn of roll, a bend
# to the right.  While it rolls, the sketch straightens out, which no beveled needle does.
CURVATURE, LENGTH = 5.0, 0.12
s = np.linspace(0, 1, 601)
roll = np.pi / (1 + np.exp(-30 * (s - 0.5)))
heading = np.cumsum(CURVATURE * LENGTH * np.cos(roll)) / len(s)
path = np.cumsum(np.column_stack([np.cos(heading), np.sin(heading), 0 * s]), axis=0)
turned = Rotation.from_euler("ZX", np.column_stack([heading, roll]))
sketch = ns.PoseTrajectory(12 * s, LENGTH / len(s) * path, turned, name="demonstration")

needle = ns.Needle(shaft="x", curvature=CURVATURE, bevel="z")
dmp = ns.learn(sketch, [needle])
motion = dmp.rollout()

motions = {"demonstration": sketch, "learned motion": motion}
for m in motions.values():
    print(ns.check(m, needle))
moved = np.linalg.norm(motion.positions - sketch.positions, axis=1)
print(f"largest residual {np.abs(motion.constraint_residuals).max():.1e} m/s, rad/s")
print(f"distance from the sketch: at most {1e3 * moved.max():.3f} mm, at the end {moved[-1]:.1e} m")

figure = style.new_figure(6.0, 3.6)
(top, bend), (side, residual) = figure.subplots(2, 2, width_ratios=(1.3, 1), sharex="col")
for name, line in style.line_styles(motions).items():
    x, y, z = 1e3 * motions[name].positions.T
    top.plot(x, y, **line)
    side.plot(x, z, **line)
    v = motions[name].step_velocities()[0]
    a = np.diff(v, axis=0) / motions[name].period
    curvature = np.linalg.norm(np.cross(v[1:], a), axis=1) / np.linalg.norm(v[1:], axis=1) ** 3
    bend.plot(motions[name].times[1:-1], curvature, **line)
style.dress(top, "", "y (mm)", title="path of the tip")
style.dress(side, "depth x (mm)", "z (mm)")
style.dress(bend, "", "curvature (1/m)", title="how the path bends")
bend.set_ylim(0, 1.6 * CURVATURE)
plot_residuals(residual, motions, needle, row=2, scale="log")
style.dress(residual, "time (s)", "turn across the bend (rad/s)")
style.name_lines(figure, motions)
away = style.number(1e3 * moved.max())
style.write_title(
    figure, f"The needle bends by {CURVATURE:g}/m all the way, {away} mm off the sketch"
)
save_figure(figure, out)
