"""A margin's approach to zero by its barrier rate, and a blade in tissue that moves."""

import matplotlib.pyplot as plt
import numpy as np
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.figures import style

s = np.linspace(0, 1, 401)
u = s**3 * (10 - 15 * s + 6 * s**2)
path = np.column_stack([0.1 * u, 0 * u, -0.02 * np.sin(np.pi * u) ** 2])
hand = ns.PoseTrajectory(2 * s, path, Rotation.from_rotvec(np.zeros((401, 3))))

figure, (margin, across) = plt.subplots(1, 2, figsize=(8.5, 2.8), layout="constrained")
margin.plot(hand.times, 1e3 * (path[:, 2] + 0.012), color="0.7", lw=4, label="demonstrated")
for rate, color in ((5, "blue"), (20, "orange"), (100, "green")):
    limit = ns.DepthLimit(depth=0.012, barrier_rate=rate)
    # Held by the run time alone, so that the barrier shows and not the plan around it.
    motion = ns.learn(hand, limit).constrained.rollout()
    margin.plot(
        motion.times,
        1e3 * motion.margins[:, 0],
        color=style.PALETTE[color],
        label=f"γ = {rate} 1/s",
    )
margin.axhline(0, color="k", lw=0.6)
margin.legend(loc="lower left", fontsize=7)
style.dress(margin, "time (s)", "margin h (mm)", title="the larger γ, the later the limit brakes")

still = hand.positions * [1, 1, 0]
yaw = Rotation.from_euler("z", 0.3 * np.sin(np.pi * s))
cut = ns.PoseTrajectory(2 * s, still, yaw)
tissue = ns.constraints.InMovingFrame(ns.Blade(), amplitude=(0, 0.004, 0), period=1.0)
motion = ns.learn(cut, tissue).rollout()
lateral = np.sum(motion.rotations.apply([0, 1, 0]) * motion.linear_velocities, axis=1)
across.plot(
    motion.times, 1e3 * lateral, "--", color=style.PALETTE["vermillion"], label="seen from the room"
)
across.plot(
    motion.times, 1e3 * motion.constraint_residuals[:, 0], "k-", lw=1, label="seen from the tissue"
)
across.legend(loc="upper right", fontsize=7)
style.dress(
    across,
    "time (s)",
    "speed across the blade (mm/s)",
    title="tissue sways: no slip in it, though in the room",
)
