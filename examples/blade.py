# /// script
# requires-python = ">=3.11"
# dependencies = ["noslip"]
# [tool.uv.sources]
# noslip = { path = ".." }
# ///
"""A blade along a curved cut: the hand slips sideways, the learned motion cannot."""

import argparse

import numpy as np
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.figures import plot_residuals, save_figure, style

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--out", default="blade.png", help="the picture's file")
out = parser.parse_args().out

# An S-shaped cut of 10 cm in 4 s; the hand turns the blade only roughly into the path.
s = np.linspace(0, 1, 501)
u = s**3 * (10 - 15 * s + 6 * s**2)
path = np.column_stack([0.1 * u, 0.02 * np.sin(2 * np.pi * u), 0 * u])
yaw = 0.5 * np.cos(2 * np.pi * s) + 0.3 * np.sin(3 * np.pi * s)
hand = ns.PoseTrajectory(4 * s, path, Rotation.from_euler("z", yaw), name="demonstration")

blade = ns.Blade()
dmp = ns.learn(hand, [blade])
motion = dmp.rollout()

motions = {"demonstration": hand, "learned motion": motion}
for m in motions.values():
    print(ns.check(m, blade))
moved = np.linalg.norm(motion.positions - hand.positions, axis=1).max()
print(f"largest residual {np.abs(motion.constraint_residuals).max():.1e} m/s")
print(f"largest distance from the demonstrated path {1e3 * moved:.3f} mm")

figure = style.new_figure(6.0, 2.7)
above, slip = figure.subplots(1, 2, width_ratios=(1.35, 1))
for name, line in style.line_styles(motions).items():
    tips = 1e3 * motions[name].positions[::25]
    edges = 6 * motions[name].rotations[::25].apply([1, 0, 0])
    blades = np.stack([tips - edges, tips + edges])
    above.plot(*blades[:, :, :2].transpose(2, 0, 1), **line)
above.plot(*1e3 * path[:, :2].T, color="black", lw=0.6)
above.set_aspect("equal", adjustable="datalim")
style.dress(above, "x (mm)", "y (mm)", title="the path, and the blade along it, from above")
plot_residuals(slip, motions, blade, scale="log")
style.dress(slip, "time (s)", "speed across the blade (mm/s)")
style.name_lines(figure, motions)
peaks = [style.number(1e3 * ns.check(m, blade).peak) for m in motions.values()]
style.write_title(
    figure, f"The hand slips up to {peaks[0]} mm/s, the learned motion {peaks[1]} mm/s"
)
save_figure(figure, out)
