# /// script
# requires-python = ">=3.11"
# dependencies = ["noslip"]
# [tool.uv.sources]
# noslip = { path = ".." }
# ///
"""One long recording cut into its demonstrations: at rests, without the one held differently."""

import argparse

import numpy as np
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.figures import recording_cuts, save_figure

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--out", default="segmenting.png", help="the picture's file")
out = parser.parse_args().out

RATE = 120.0
rng = np.random.default_rng(4)


def minimum_jerk(duration: float) -> np.ndarray:
    u = np.linspace(0, 1, round(duration * RATE))
    return u**3 * (10 - 15 * u + 6 * u**2)


# Six cuts of 5 cm with a blade that lags behind the path, the fourth held rolled to the side;
# between them the hand rests, lifts the blade, goes back and rests again.
positions, angles = [], []
for cut in range(6):
    origin, height = rng.uniform(-4e-3, 4e-3, 2), rng.uniform(14e-3, 18e-3)
    roll = np.radians(30 if cut == 3 else rng.uniform(-3, 3))
    pose = np.array([*origin, 0, roll, np.arctan2(4 * height, 0.05)])
    if positions:
        for kind in ("rest", "back", "rest"):
            s = minimum_jerk(rng.uniform(0.5, 1.2))[:, None]
            last = np.array([*positions[-1][-1], *angles[-1][-1]])
            moved = last + (pose - last) * (s if kind == "back" else 0 * s)
            lift = 0.03 * np.sin(np.pi * s[:, 0]) ** 2 if kind == "back" else 0
            positions.append(moved[:, :3] + np.outer(lift * np.ones(len(s)), [0, 0, 1]))
            angles.append(moved[:, 3:])
    s = minimum_jerk(rng.uniform(3, 5))
    path = np.column_stack([0.05 * s, 4 * height * s * (1 - s), 0 * s])
    lag = np.radians(15) * np.sin(np.pi * s) ** 2
    slope = np.arctan2(4 * height * (1 - 2 * s), 0.05)
    positions.append(path + [*origin, 0])
    angles.append(np.column_stack([roll + 0 * s, slope - lag]))

path = np.concatenate(positions)
path = path + 1e-4 * rng.standard_normal(path.shape)  # the tracker's noise, 0.1 mm
poses = Rotation.from_euler("xz", np.concatenate(angles))
session = ns.PoseTrajectory(np.arange(len(path)) / RATE, path, poses, name="session")

# Filtered as a whole, then cut where the hand rests; the thresholds come from the recording.
session = ns.prepare(session, lowpass=4.8)
segments = ns.segment(session)
for interval in segments.intervals:
    print(f"{interval.start:6.2f} to {interval.end:6.2f} s: {interval.reason or 'kept'}")

# What lies far from the others is named, and left out if one says so.
judged = ns.demonstrations.outliers(segments.pieces)
far = {int(i): judged.reason(int(i)) for i in np.flatnonzero(judged.outlying)}
for i, reason in far.items():
    print(f"{segments.pieces[i].name}: {reason}")
segments = segments.without(far)

pieces = [ns.prepare(piece, relative=True) for piece in segments.pieces]
motion = ns.learn(pieces, [ns.Blade()]).rollout()
residual = np.abs(motion.constraint_residuals).max()
print(f"learned from {len(pieces)} pieces, residual at most {residual:.1e} m/s")
save_figure(recording_cuts(segments), out)
