# /// script
# requires-python = ">=3.11"
# dependencies = ["noslip"]
# [tool.uv.sources]
# noslip = { path = ".." }
# ///
"""A lid on its hinge, opened by the handle: the hand knows no axis, the motion keeps to it."""

import argparse

import numpy as np
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.figures import save_figure, style

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--out", default="fixed_point.png", help="the picture's file")
out = parser.parse_args().out

# The hinge lies along the world's y axis; the handle, which is what was recorded, 0.3 m from it.
HINGE, HANDLE = np.array([0.5, 0.0, 0.1]), np.array([-0.3, 0.0, 0.0])
s = np.linspace(0, 1, 401)
angle = 1.9 * s**3 * (10 - 15 * s + 6 * s**2)
lid = Rotation.from_rotvec(np.outer(angle, [0, 1, 0]))
# A hand that never held the lid's weight shows a rounder and shorter way, and twists on it.
drift = 0.012 * np.column_stack([np.sin(3 * angle), np.sin(2 * angle), 1 - np.cos(2 * angle)])
twist = Rotation.from_rotvec(0.06 * np.outer(np.sin(4 * angle), [1, 0, 0.5]))
hand = ns.PoseTrajectory(4 * s, HINGE + lid.apply(HANDLE) + drift, twist * lid, name="hand")

hinge = [
    ns.constraints.FixedPoint(point=HINGE, reference_point=-HANDLE),
    ns.constraints.ToolAxis(axis="y", direction=(0, 1, 0)),
]
dmp = ns.learn(hand, hinge)
motion = dmp.rollout()

motions = {"demonstration": hand, "learned motion": motion}
for m in motions.values():
    print(ns.check(m, hinge))
print(f"largest residual {np.abs(motion.constraint_residuals).max():.1e} m, rad")


def off_the_hinge(m: ns.PoseTrajectory) -> np.ndarray:
    """Distance of the lid's axis from the hinge (m)."""
    return np.linalg.norm(m.positions - m.rotations.apply(HANDLE) - HINGE, axis=1)


figure = style.new_figure(6.0, 2.8)
side, distance = figure.subplots(1, 2, width_ratios=(1, 1.2))
for name, line in style.line_styles(motions).items():
    m = motions[name]
    lids = np.stack([m.positions, m.positions - m.rotations.apply(HANDLE)])[:, ::50]
    side.plot(
        *1e3 * lids[:, :, [0, 2]].transpose(2, 0, 1), **line | {"linewidth": line["linewidth"] / 2}
    )
    distance.semilogy(m.times, np.maximum(1e3 * off_the_hinge(m), 1e-14), **line)
side.plot(*1e3 * HINGE[[0, 2]], "o", color=style.PALETTE["vermillion"], ms=5, zorder=3)
side.set_aspect("equal", adjustable="datalim")
style.dress(side, "x (mm)", "z (mm)", title="the lid, from the side (dot: hinge)")
style.dress(distance, "time (s)", "lid off its hinge (mm)")
style.name_lines(figure, motions)
peaks = [style.number(1e3 * off_the_hinge(m).max()) for m in motions.values()]
style.write_title(
    figure, f"The lid leaves its hinge by {peaks[0]} mm as demonstrated, {peaks[1]} mm as learned"
)
save_figure(figure, out)
