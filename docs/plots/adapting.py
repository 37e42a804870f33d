"""A goal moved sideways, and a push: what reacting does, and what planning does."""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.figures import style

s = np.linspace(0, 1, 401)
u = s**3 * (10 - 15 * s + 6 * s**2)
path = np.column_stack([0.1 * u, 0.01 * np.sin(2 * np.pi * u), 0 * u])
along = np.arctan2(0.02 * np.pi * np.cos(2 * np.pi * u), 0.1)
hand = ns.PoseTrajectory(3 * s, path, Rotation.from_euler("z", along))
dmp = ns.learn(hand, ns.Blade())
goal = dmp.goal_position + [0, 0.02, 0]

figure, (moved, pushed) = plt.subplots(1, 2, figsize=(8.5, 3.4), layout="constrained")
reacting, planning = dmp.rollout(goal_position=goal), dmp.adapt(goal_position=goal).rollout()
for name, motion, line in (
    ("as learned", dmp.rollout(), {"color": "0.7", "lw": 4}),
    ("reacting: rollout", reacting, {"color": style.PALETTE["vermillion"], "ls": "--"}),
    ("planning: adapt", planning, {"color": "k", "lw": 1.2}),
):
    moved.plot(*1e3 * motion.positions[:, :2].T, **line, label=name)
moved.plot(*1e3 * goal[:2], "kx", ms=8)
missed = 1e3 * np.linalg.norm(reacting.positions[-1] - goal)
told = f"a goal moved sideways (×): reacting misses it by {missed:.0f} mm, planning reaches it"
style.dress(moved, "x (mm)", "y (mm)", title=told)

controller = dmp.controller(time_step=0.005, follows=True)
state, held, positions = controller.reset(), None, []
while not controller.done:
    if len(positions) == 200:
        held = replace(state, position=state.position + [0, 0.008, 0])
    if controller.replanned:
        # The hand lets go where the controller leads on.
        held = None
    state = controller.step(held or state)
    positions.append((held or state).position)
positions = 1e3 * np.array(positions)
pushed.plot(*1e3 * dmp.rollout().positions[:, :2].T, color="0.7", lw=4, label="as learned")
pushed.plot(*positions[:200, :2].T, "k-", lw=1.2, label="pushed, in the loop")
pushed.plot(*positions[200:, :2].T, "k-", lw=1.2)
pushed.annotate(
    "",
    positions[200, :2],
    positions[199, :2],
    arrowprops={"color": style.PALETTE["vermillion"], "arrowstyle": "->"},
)
left = 1e3 * dmp.goal_position[:2] - positions[-1, :2]
told = f"a push of 8 mm: the loop leads on, to {np.linalg.norm(left):.1g} mm from the goal"
style.dress(pushed, "x (mm)", "y (mm)", title=told)
for ax in (moved, pushed):
    # Below, where it hides no line.
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.18), ncols=3, fontsize=7, frameon=False)
