# /// script
# requires-python = ">=3.11"
# dependencies = ["noslip"]
# [tool.uv.sources]
# noslip = { path = ".." }
# ///
"""Contradicting limits: the hard one holds, and of the soft ones the less important gives way."""

import argparse

import numpy as np
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.figures import save_figure, style

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--out", default="priorities.png", help="the picture's file")
out = parser.parse_args().out

# A tool led level over tissue that breathes by 4 mm up and down.  It must not touch it (hard), and
# should pass below a ceiling of 2 mm and at least 3 mm above the tissue (soft): it cannot do all.
s = np.linspace(0, 1, 401)
u = s**3 * (10 - 15 * s + 6 * s**2)
path = np.column_stack([0.1 * u, 0 * u, 0 * u])
hand = ns.PoseTrajectory(8 * s, path, Rotation.identity(len(s)), name="demonstration")
breath = {"amplitude": (0.0, 0.0, 0.004), "period": 4.0, "phase": -np.pi / 2}
touch = ns.constraints.InMovingFrame(ns.constraints.HalfSpace(), **breath)


def ceiling(priority: int) -> ns.Constraint:
    @ns.keep_nonnegative(name="ceiling", priority=priority)
    def below(motion):
        return 0.002 - motion.position[2]

    return below


def clearance(priority: int) -> ns.Constraint:
    return ns.constraints.InMovingFrame(
        ns.constraints.HalfSpace(point=(0, 0, 0.003), priority=priority), **breath
    )


orders = {
    "ceiling before clearance": [touch, ceiling(1), clearance(2)],
    "clearance before ceiling": [touch, ceiling(2), clearance(1)],
}
figure = style.new_figure(6.0, 3.0)
panels = figure.subplots(1, 2, sharey=True)
least = []
for ax, (title, limits) in zip(panels, orders.items(), strict=True):
    motion = ns.learn(hand, limits).rollout()
    hard, *soft = 1e3 * motion.margins.min(axis=0)
    least.append(hard)
    print(f"{title}: least margins {hard:.1e} mm (hard), {soft[0]:.4f} and {soft[1]:.4f} mm (soft)")
    for limit in motion.gave_way:
        print(f"  {limit.name} gave way by {1e3 * limit.violation:.4f} mm at {limit.time:g} s")
    gave = [
        f"{name} by {style.number(-margin)} mm"
        for name, margin in zip(("ceiling", "clearance"), soft, strict=True)
        if margin < -1e-6
    ]
    t, tissue = motion.times, -4 * np.cos(2 * np.pi * motion.times / 4)
    ax.fill_between(t, tissue, -5, color=style.PALETTE["sky"], alpha=0.4, lw=0, label="tissue")
    ax.axhline(2, color=style.PALETTE["vermillion"], lw=1, label="ceiling")
    ax.plot(t, tissue + 3, color=style.PALETTE["green"], lw=1, ls="--", label="clearance")
    ax.plot(
        t, 1e3 * motion.positions[:, 2], color=style.PALETTE["blue"], lw=2, label="learned motion"
    )
    ax.set_ylim(-5, 8)
    style.dress(ax, "time (s)", "", title=f"{title}:\n{' and '.join(gave)}")
panels[0].set_ylabel("height (mm)", fontsize=7)
style.put_legend(figure, dict(zip(*ax.get_legend_handles_labels()[::-1], strict=True)))
style.write_title(
    figure,
    f"The hard limit holds to {style.number(max(0, -min(least)))} mm; of the soft ones, the less "
    "important gives way first, by as much as it must",
)
save_figure(figure, out)
