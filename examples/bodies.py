# /// script
# requires-python = ">=3.11"
# dependencies = ["noslip"]
# [tool.uv.sources]
# noslip = { path = ".." }
# ///
"""A knife and the tissue that another tool moves: the blade must not slip in the tissue."""

import argparse

import numpy as np
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.figures import save_figure

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--out", default="bodies.png", help="the picture's file")
out = parser.parse_args().out

# Forceps that lift and turn the tissue, and a bent cut of 5 cm in it, out of line by up to 10 deg.
s = np.linspace(0, 1, 301)
u = s**3 * (10 - 15 * s + 6 * s**2)
tissue = ns.PoseTrajectory(
    3 * s,
    np.column_stack([0.006 * np.sin(4 * s), 0.012 * u, 0.004 * np.sin(6 * s)]),
    Rotation.from_rotvec(0.2 * np.column_stack([np.sin(4 * s), 0 * s, 2 * u])),
)
cut = np.column_stack([0.05 * u, 0.01 * np.sin(np.pi * u), 0.003 * u])
heading = Rotation.from_euler("z", 0.5 * np.cos(np.pi * u) + 0.17 * np.sin(7 * s))
knife = ns.PoseTrajectory(
    3 * s, tissue.positions + tissue.rotations.apply(cut), tissue.rotations * heading
)

hands = ns.Bodies(knife=knife, tissue=tissue)
rule = ns.constraints.relative_to(ns.Blade(), "knife", "tissue")
print(ns.check(hands, rule))
dmp = ns.learn(hands, [rule])
print(ns.check(dmp.rollout(), rule))

# A new goal of the knife; the tissue ends where it did.
place, turn = dmp.goal_position[:3], dmp.goal_rotation[0]
there = dmp.adapt(goal={"knife": (place + [0.004, 0.006, 0], Rotation.from_euler("z", 0.2) * turn)})
motion = there.rollout()
print(ns.check(motion, rule))
print(f"largest residual {np.abs(motion.constraint_residuals).max():.1e} m/s")
save_figure(motion.plot(rule), out)
