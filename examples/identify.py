# /// script
# requires-python = ">=3.11"
# dependencies = ["noslip"]
# [tool.uv.sources]
# noslip = { path = ".." }
# ///
"""Which constraint holds: a tracker on a knife tells that it is one, and where its edge is."""

import argparse

import numpy as np
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.figures import save_figure

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--out", default="identify.png", help="the picture's file")
out = parser.parse_args().out

# Where nobody has measured it: the edge is 52 mm ahead of the tracker and 13 mm up, and the tracker
# is turned by some degrees.
EDGE, TURNED = np.array([0.052, -0.01, 0.013]), Rotation.from_rotvec([0.02, -0.04, 0.06])
rng = np.random.default_rng(1)
t = np.linspace(0, 10, 1001)


def wave(size, fastest):
    return size * np.sin(rng.uniform(0.5, fastest) * t + rng.uniform(0, 6))


def record():
    """Cut at 5 cm/s, plunging and turning at will, and read the tracker: 0.05 mm, 0.03 degrees."""
    angles = np.column_stack([wave(0.9, 1.5), wave(0.3, 2), wave(0.3, 2)])
    knife = Rotation.from_euler("ZYX", angles)
    velocities = np.column_stack([0.05 + 0 * t, 0 * t, wave(0.02, 2)])
    turns = (knife[1:] * knife[:-1].inv()).as_rotvec() / 2
    steps = (Rotation.from_rotvec(turns) * knife[:-1]).apply(velocities[1:] * np.diff(t)[:, None])
    tips = np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
    tracker = knife * TURNED.inv()
    read = tips - tracker.apply(EDGE) + 5e-5 * rng.normal(size=tips.shape)
    noise = Rotation.from_rotvec(5e-4 * rng.normal(size=tips.shape))
    return ns.PoseTrajectory(t, read, tracker * noise, name="recording")


recordings = [record() for _ in range(3)]
found = ns.identify(recordings)
print(found)
off = np.cross(found.reference_point - EDGE, found.lateral)
print(f"beside the edge by {1e3 * np.linalg.norm(off):.2f} mm")

# What was found is what to learn with, in the tracker's own frame.
smooth = ns.prepare(recordings[0], lowpass=4.8)
dmp = ns.learn(smooth, found.constraints)
motion = dmp.rollout()
for m in (smooth, motion):
    print(ns.check(m, found.constraints))
print(f"largest residual {np.abs(motion.constraint_residuals).max():.1e} m/s")
save_figure(found.plot(), out)
