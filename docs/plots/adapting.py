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

figure, (moved, pushed) = plt.subplots(1, 2, figsize=(8.5, 3.0), layout="constrained")
for name, motion, line in (
    ("as learned", dmp.rollout(), {"color": "0.7", "lw": 4}),
    (
        "reacting: rollout",
        dmp.rollout(goal_position=goal),
        {"color": style.PALETTE["vermillion"], "ls": "--"},
    ),
    ("planning: adapt", dmp.adapt(goal_position=goal).rollout(), {"color": "k", "lw": 1.2}),
):
    moved.plot(*1e3 * motion.positions[:, :2].T, **line, label=name)
moved.plot(*1e3 * goal[:2], "kx", ms=8)
moved.legend(loc="upper center", fontsize=7)
style.dress(moved, "x (mm)", "y (mm)", title="a goal moved sideways (×)")

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
pushed.plot(*positions[:200, :2].T, "k-", lw=1.2, label="in the loop")
pushed.plot(*positions[200:, :2].T, "k-", lw=1.2)
pushed.annotate(
    "",
    positions[200, :2],
    positions[199, :2],
    arrowprops={"color": style.PALETTE["vermillion"], "arrowstyle": "->"},
)
pushed.legend(loc="upper right", fontsize=7)
style.dress(pushed, "x (mm)", "y (mm)", title="a push of 8 mm")
