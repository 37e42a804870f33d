# /// script
# requires-python = ">=3.11"
# dependencies = ["noslip"]
# [tool.uv.sources]
# noslip = { path = ".." }
# ///
"""Eight cuts, what they have in common, and cuts like them through a pose: none of them slips."""

import argparse

import numpy as np
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.figures import column_figure, save_figure, style

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--out", default="distributions.png", help="the picture's file")
out = parser.parse_args().out

# A hand cuts 10 cm eight times in about 4 s; each time it bends, ends and hurries otherwise.
rng, s = np.random.default_rng(4), np.linspace(0, 1, 201)
cuts = []
for number in range(8):
    bend, end, late, tilt = rng.normal(size=4)
    u = s**3 * (10 - 15 * s + 6 * s**2)
    u = u + 0.04 * late * np.sin(np.pi * u) * u * (1 - u)
    height = (0.02 + 0.003 * bend) * np.sin(np.pi * u) + 0.004 * end * u**2
    slope = (0.2 + 0.03 * bend) * np.pi * np.cos(np.pi * u) + 0.08 * end * u
    held = Rotation.from_euler(
        "ZX", np.column_stack([np.arctan(slope), 0.05 * tilt * np.sin(3 * u)])
    )
    path = np.column_stack([0.1 * u, height, 0 * u])
    cuts.append(ns.PoseTrajectory(4 * s, path, held, name=f"cut {number + 1}"))

blade = ns.Blade()
cutting = ns.learn(cuts, [blade], distribution=True)

# At 45 % of the time, 3 mm aside, in the direction that the tool has there.
k = round(0.45 * (len(cutting.motion) - 1))
place = cutting.motion.positions[k] + [0, 0.003, 0]
passing = cutting.condition(ns.Boundary(0.45, place, cutting.motion.rotations[k]))
samples = passing.sample(40, seed=1)
slip = np.abs(samples.constraint_residuals).max()
missed = np.linalg.norm(samples.positions[:, k] - place, axis=1).max()
narrower = passing.interval()[45:70, 1].mean() / cutting.interval()[45:70, 1].mean()
print(f"{len(samples)} samples: residual {slip:.1e} m/s, {1e9 * missed:.2g} nm from the pose")
print(f"each cut under the others: {cutting.score:.1f} nats a value")
print(f"after the pose, intervals are {narrower:.2f} times as wide")

figure = column_figure(2, 3.0)
paths, widths = figure.subplots(1, 2, width_ratios=(1.6, 1))
for number, cut in enumerate(cuts):
    label = "demonstrations" if number == 0 else None
    paths.plot(*1e3 * cut.positions[:, :2].T, color=style.PALETTE["gray"], lw=1.2, label=label)
for number, path in enumerate(samples.positions):
    label = "samples through the pose" if number == 0 else None
    paths.plot(*1e3 * path[:, :2].T, color=style.PALETTE["sky"], lw=0.6, label=label)
motion = passing.mean.rollout()
paths.plot(
    *1e3 * motion.positions[:, :2].T, color=style.PALETTE["blue"], lw=1.6, label="their mean"
)
mark = {"marker": "s", "ms": 6, "mfc": "none", "ls": "none", "color": "black", "zorder": 4}
paths.plot(*1e3 * place[:2], label="the pose", **mark)
style.dress(paths, "x (mm)", "y (mm)", title="paths")

share = np.linspace(0, 100, 101)
for learned, color, name in (
    (cutting, style.PALETTE["gray"], "as demonstrated"),
    (passing, style.PALETTE["blue"], "through the pose"),
):
    middle = 1e3 * (learned.middle[:, 1] - cutting.middle[:, 1])
    half = 1e3 * learned.interval(0.95)[:, 1]
    widths.fill_between(share, middle - half, middle + half, color=color, alpha=0.35, lw=0)
    widths.plot(share, middle, color=color, lw=1.2, label=name)
widths.plot(45, 3, **mark)
style.dress(widths, "time (%)", "y, beside the mean (mm)", title="95 % of motions")
for panel in (paths, widths):
    panel.legend(fontsize=style.SMALL_FONT_SIZE, frameon=False, loc="best")
style.write_title(
    figure,
    f"{len(samples)} cuts like eight demonstrated ones, all through one pose: slip at most "
    f"{style.number(slip)} m/s",
)
save_figure(figure, out)
