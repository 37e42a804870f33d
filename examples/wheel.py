# /// script
# requires-python = ">=3.11"
# dependencies = ["noslip"]
# [tool.uv.sources]
# noslip = { path = ".." }
# ///
"""A cart that parks with wheels: no slip along the axle, forward and in reverse."""

import argparse

import numpy as np
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.figures import plot_residuals, save_figure, style

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--out", default="wheel.png", help="the picture's file")
out = parser.parse_args().out

# Past the gap, and back into it, as someone pushed the cart; it was nudged sideways and lifted.
s = np.linspace(0, 1, 501)


def from_rest_to_rest(first: float, last: float) -> np.ndarray:
    u = np.clip((s - first) / (last - first), 0, 1)
    return u**3 * (10 - 15 * u + 6 * u**2)


ahead, back = from_rest_to_rest(0, 0.5), from_rest_to_rest(0.5, 1)
x = 2.0 * ahead - 1.6 * back
y = 0.3 * ahead**2 - 1.0 * back**2 * (3 - 2 * back)
height = 0.005 * np.sin(6 * np.pi * s) ** 2
heading = 0.3 * ahead + 0.1 * np.sin(4 * np.pi * s) + 0.4 * np.sin(np.pi * back)
pushed = ns.PoseTrajectory(
    10 * s, np.column_stack([x, y, height]), Rotation.from_euler("z", heading), name="demonstration"
)

wheel = ns.Wheel(axle="y")
dmp = ns.learn(pushed, [wheel])
motion = dmp.rollout()

motions = {"demonstration": pushed, "learned motion": motion}
for m in motions.values():
    print(ns.check(m, wheel))
print(f"largest residual {np.abs(motion.constraint_residuals).max():.1e} m/s")
print(f"stretches in reverse: {dmp.record[0].backing}")

figure = style.new_figure(6.0, 2.9)
above, slip = figure.subplots(1, 2, width_ratios=(1.35, 1))
for name, line in style.line_styles(motions).items():
    center = motions[name].positions[::20]
    axle = 0.12 * motions[name].rotations[::20].apply([0, 1, 0])
    above.plot(*np.stack([center - axle, center + axle])[:, :, :2].transpose(2, 0, 1), **line)
    above.plot(*motions[name].positions[:, :2].T, **line)
above.set_aspect("equal", adjustable="datalim")
style.dress(above, "x (m)", "y (m)", title="path, and the axle along it, from above")
plot_residuals(slip, motions, wheel, row=0, scale="log")
style.dress(slip, "time (s)", "speed along the axle (mm/s)")
style.name_lines(figure, motions)
peaks = [style.number(1e3 * ns.check(m, wheel).peak) for m in motions.values()]
style.write_title(
    figure,
    f"Pushed by hand, the cart's wheels slip up to {peaks[0]} mm/s; learned, {peaks[1]} mm/s, "
    "forward as in reverse",
)
save_figure(figure, out)
