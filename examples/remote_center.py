# /// script
# requires-python = ">=3.11"
# dependencies = ["noslip"]
# [tool.uv.sources]
# noslip = { path = ".." }
# ///
"""A laparoscope through an incision: its shaft pivots about the port and slides through it."""

import argparse

import numpy as np
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.figures import save_figure, style

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--out", default="remote_center.png", help="the picture's file")
out = parser.parse_args().out

# The tip draws a figure of eight 10 cm below the port; the shaft, body z, points up to it roughly.
PORT = np.array([0.0, 0.0, 0.1])
s = np.linspace(0, 1, 501)
u = s**3 * (10 - 15 * s + 6 * s**2)
a = 2 * np.pi * u
tip = np.column_stack([0.04 * np.sin(a), 0.03 * np.sin(2 * a), 0.02 * np.cos(a) - 0.02])
toward = PORT - tip
swing = np.column_stack([-np.arctan2(toward[:, 1], toward[:, 2]), 0 * s, 0 * s])
lean = np.arctan2(toward[:, 0], np.hypot(toward[:, 1], toward[:, 2]))
swing[:, 1] = lean + 0.08 * np.sin(3 * np.pi * s)
hand = ns.PoseTrajectory(6 * s, tip, Rotation.from_euler("XYZ", swing), name="demonstration")

port = ns.constraints.RemoteCenter(point=PORT, shaft="z")
dmp = ns.learn(hand, [port])
motion = dmp.rollout()

motions = {"demonstration": hand, "learned motion": motion}
for m in motions.values():
    print(ns.check(m, port))
moved = np.linalg.norm(motion.positions - hand.positions, axis=1).max()
print(f"largest residual {np.abs(motion.constraint_residuals).max():.1e} m")
print(f"largest distance of the tip from its demonstrated path {1e3 * moved:.3f} mm")


def beside_the_port(m: ns.PoseTrajectory) -> np.ndarray:
    """Distance of the shaft's line from the port (m)."""
    return np.linalg.norm(np.cross(PORT - m.positions, m.rotations.apply([0, 0, 1])), axis=1)


figure = style.new_figure(6.0, 2.8)
side, near, distance = figure.subplots(1, 3, width_ratios=(1, 1, 1.2))
for name, line in style.line_styles(motions).items():
    m = motions[name]
    shaft = m.rotations[::50].apply([0, 0, 0.16])
    shafts = 1e3 * np.stack([m.positions[::50], m.positions[::50] + shaft])
    for ax in (side, near):
        ax.plot(
            *shafts[:, :, [0, 2]].transpose(2, 0, 1),
            **line | {"linewidth": line["linewidth"] / 2},
        )
    distance.semilogy(m.times, np.maximum(1e3 * beside_the_port(m), 1e-17), **line)
side.plot(*1e3 * motion.positions[:, [0, 2]].T, color="black", lw=1)
for ax in (side, near):
    ax.plot(0, 1e3 * PORT[2], "o", color=style.PALETTE["vermillion"], ms=5, zorder=3)
side.set_aspect("equal", adjustable="datalim")
near.set(xlim=(-12, 12), ylim=(85, 115))
style.dress(side, "x (mm)", "z (mm)", title="shafts, from the side")
style.dress(near, "x (mm)", "", title="at the port (dot)")
style.dress(distance, "time (s)", "shaft off the port (mm)")
style.name_lines(figure, motions)
peaks = [style.number(1e3 * beside_the_port(m).max()) for m in motions.values()]
style.write_title(
    figure,
    f"The shaft misses the port by up to {peaks[0]} mm as demonstrated, {peaks[1]} mm as learned",
)
save_figure(figure, out)
