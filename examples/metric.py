# /// script
# requires-python = ">=3.11"
# dependencies = ["noslip"]
# [tool.uv.sources]
# noslip = { path = ".." }
# ///
"""Who gives way: position, rotation or both, where a blade moves forth, rests, and comes back."""

import argparse

import numpy as np
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.figures import save_figure, style

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--out", default="metric.png", help="the picture's file")
out = parser.parse_args().out

# 8 cm forth along a bend, a rest of half a second, and back, with a blade held almost straight.
s = np.linspace(0, 1, 601)
forth = np.clip(s / 0.45, 0, 1) - np.clip((s - 0.55) / 0.45, 0, 1)
u = forth**3 * (10 - 15 * forth + 6 * forth**2)
path = np.column_stack([0.08 * u, 0.02 * u**2, 0 * u])
yaw = 0.1 * np.sin(2 * np.pi * s)
hand = ns.PoseTrajectory(5 * s, path, Rotation.from_euler("z", yaw), name="demonstration")

# Without the projected orientation, so that all is left to the run time.
motions = {
    metric: ns.learn(hand, [ns.Blade()], metric=metric).constrained.rollout()
    for metric in ("position", "shared")
}
figure = style.new_figure(6.0, 2.9)
above, off, turning = figure.subplots(1, 3, width_ratios=(1.2, 1, 1))
lines = style.line_styles(["demonstration", *motions])
above.plot(*1e3 * path[:, :2].T, **lines["demonstration"])
aside, push = {}, {}
for name, m in motions.items():
    moved = 1e3 * np.linalg.norm(m.positions - hand.positions, axis=1)
    rate = np.linalg.norm(m.constraint_forces[:, 3:], axis=1)
    aside[name], push[name] = moved.max(), rate.max()
    print(
        f"{name}: largest residual {np.abs(m.constraint_residuals).max():.1e} m/s, up to "
        f"{moved.max():.3g} mm off, up to {rate.max():.3g} rad/s² of angular acceleration"
    )
    above.plot(*1e3 * m.positions[:, :2].T, **lines[name])
    off.semilogy(m.times, np.maximum(moved, 1e-9), **lines[name])
    turning.semilogy(m.times, np.maximum(rate, 1e-9), **lines[name])
for ax in (off, turning):
    ax.axvspan(0.45 * 5, 0.55 * 5, color="0.9", lw=0)
off.text(2.5, 1.5e-3, "rest", ha="center", fontsize=7)
off.set_ylim(1e-3, 50)
turning.set_ylim(1e-3, 5e3)
above.set_aspect("equal", adjustable="datalim")
style.dress(above, "x (mm)", "y (mm)", title="path, from above")
style.dress(off, "time (s)", "off the path (mm)", title="what the position gives")
style.dress(turning, "time (s)", "angular acceleration (rad/s²)", title="what the rotation gives")
style.name_lines(figure, ["demonstration", *motions])
aside = {name: style.number(size) for name, size in aside.items()}
push = {name: style.number(size) for name, size in push.items()}
style.write_title(
    figure,
    f"Where only the position gives way it leaves the path by {aside['position']} mm; where the "
    f"rotation shares, by {aside['shared']} mm, turned at up to {push['shared']} rad/s²",
)
save_figure(figure, out)
