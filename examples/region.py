# /// script
# requires-python = ">=3.11"
# dependencies = ["noslip"]
# [tool.uv.sources]
# noslip = { path = ".." }
# ///
"""Where a tool must stay: no deeper than allowed, on its side of a plane, within a box."""

import argparse

import numpy as np
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.figures import save_figure, style

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--out", default="region.png", help="the picture's file")
out = parser.parse_args().out

# A cut of 10 cm in 4 s that goes 12 mm deep, with a blade that must not slip sideways.
s = np.linspace(0, 1, 501)
u = s**3 * (10 - 15 * s + 6 * s**2)
path = np.column_stack([0.1 * u, 0 * u, -0.012 * np.sin(np.pi * u) ** 2])
hand = ns.PoseTrajectory(4 * s, path, Rotation.identity(len(s)), name="demonstration")

limits = {
    "at most 8 mm deep": ns.DepthLimit(depth=0.008),
    "this side of a slanted plane": ns.constraints.HalfSpace(
        point=(0, 0, -0.003), normal=(0.1, 0, 1)
    ),
    "within a box": ns.constraints.Box(lower=(None, None, -0.01), upper=(0.085, None, None)),
}
figure = style.new_figure(6.0, 3.0)
panels = figure.subplots(1, 3, sharey=True)
X, Z = np.meshgrid(np.linspace(-0.005, 0.105, 300), np.linspace(-0.016, 0.004, 200))
forbidden = [Z < -0.008, 0.1 * X + Z + 0.003 < 0, (Z < -0.01) | (X > 0.085)]
margins = []
for ax, beyond, (title, limit) in zip(panels, forbidden, limits.items(), strict=True):
    motion = ns.learn(hand, [limit, ns.Blade()]).rollout()
    margins.append(motion.margins.min())
    print(
        f"{title}: least margin {margins[-1]:.1e} m, blade's largest residual "
        f"{np.abs(motion.constraint_residuals).max():.1e} m/s, gave way: {motion.gave_way}"
    )
    color = [style.PALETTE["vermillion"]]
    ax.contourf(1e3 * X, 1e3 * Z, beyond, [0.5, 1.5], colors=color, alpha=0.2)
    motions = {"demonstration": hand, "learned motion": motion}
    for name, line in style.line_styles(motions).items():
        ax.plot(*1e3 * motions[name].positions[:, [0, 2]].T, **line)
    style.dress(ax, "x (mm)", "", title=title)
panels[0].set_ylabel("z (mm)", fontsize=7)
style.name_lines(figure, motions)
least = style.number(1e3 * min(margins))
style.write_title(
    figure, f"No learned motion enters what is forbidden (shaded): least margin {least} mm"
)
save_figure(figure, out)
