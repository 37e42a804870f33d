# /// script
# requires-python = ">=3.11"
# dependencies = ["noslip"]
# [tool.uv.sources]
# noslip = { path = ".." }
# ///
"""A cut in tissue that breathes: the blade must not slip in the tissue, which itself moves."""

import argparse

import numpy as np
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.figures import plot_residuals, save_figure, style

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--out", default="moving_frame.png", help="the picture's file")
out = parser.parse_args().out

# Tissue that breathes by 3 mm to and fro and 4 mm up and down, every 4 s; and a hand that follows
# it with a bent cut of 8 cm in 12 s, off the surface by up to 1 mm and out of line by up to 11 deg.
breath = {"amplitude": (0.0, 0.003, 0.004), "period": 4.0}
s = np.linspace(0, 1, 601)
u = s**3 * (10 - 15 * s + 6 * s**2)
cut = np.column_stack([0.08 * u, 0.02 * np.sin(np.pi * u), 0.001 * np.sin(7 * np.pi * s)])
carried = cut + np.outer(np.sin(2 * np.pi * 12 * s / breath["period"]), breath["amplitude"])
yaw = np.arctan2(0.02 * np.pi * np.cos(np.pi * u), 0.08) + 0.2 * np.sin(5 * np.pi * s)
hand = ns.PoseTrajectory(12 * s, carried, Rotation.from_euler("z", yaw), name="demonstration")

blade = ns.constraints.InMovingFrame(ns.Blade(), **breath)
surface = ns.constraints.InMovingFrame(ns.constraints.PlaneContact(), **breath)
motion = ns.learn(hand, [blade, surface]).rollout()
in_the_room = ns.learn(hand, [ns.Blade(), surface]).rollout()

motions = {"demonstration": hand, "held in the room": in_the_room, "held in the tissue": motion}
for m in motions.values():
    print(ns.check(m, [blade, surface]))
print(f"largest residual {np.abs(motion.constraint_residuals).max():.1e} m/s, m")

figure = style.new_figure(6.0, 2.9)
height, turn, slip = figure.subplots(1, 3)
tissue = 4 * np.sin(np.pi / 2 * motion.times)
height.fill_between(motion.times, tissue, -6, color=style.PALETTE["sky"], alpha=0.35, lw=0)
for name, line in style.line_styles(motions).items():
    m = motions[name]
    height.plot(m.times, 1e3 * m.positions[:, 2], **line)
    heading = np.unwrap(m.rotations.as_euler("ZYX", degrees=True)[:, 0], period=360)
    turn.plot(m.times, heading, **line)
height.set_ylim(-6, 6)
plot_residuals(slip, motions, blade, scale="log")
style.dress(height, "time (s)", "height (mm)", title="on the tissue (shaded)")
style.dress(turn, "time (s)", "heading of the blade (°)", title="from above")
style.dress(slip, "time (s)", "speed across (mm/s)", title="slip in the tissue")
style.name_lines(figure, motions)
peaks = [style.number(1e3 * ns.check(m, blade).peak) for m in motions.values()]
style.write_title(
    figure,
    f"A blade held in the room slips up to {peaks[1]} mm/s in breathing tissue; held in the "
    f"tissue, {peaks[2]} mm/s",
)
save_figure(figure, out)
