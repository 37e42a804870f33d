# /// script
# requires-python = ">=3.11"
# dependencies = ["noslip"]
# [tool.uv.sources]
# noslip = { path = ".." }
# ///
"""A cut adapted to other goals, under the blade's constraint: each is reached, none slips."""

import argparse

import numpy as np
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.figures import adapted_family, save_figure

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--out", default="new_goals.png", help="the picture's file")
out = parser.parse_args().out

# An S-shaped cut of 10 cm in 4 s.
s = np.linspace(0, 1, 501)
u = s**3 * (10 - 15 * s + 6 * s**2)
path = np.column_stack([0.1 * u, 0.02 * np.sin(2 * np.pi * u), 0 * u])
yaw = np.arctan(0.4 * np.pi * np.cos(2 * np.pi * u))
hand = ns.PoseTrajectory(4 * s, path, Rotation.from_euler("z", yaw), name="demonstration")

blade = ns.Blade()
dmp = ns.learn(hand, [blade])
original = dmp.rollout()

# All round the goal, half of them with another orientation at the end, one by way of a point.
motions, goals = {}, {}
for i, angle in enumerate(np.linspace(0, 2 * np.pi, 8, endpoint=False)):
    goal = dmp.goal_position + 0.03 * np.array([np.cos(angle), np.sin(angle), 0.0])
    turned = Rotation.from_euler("z", 25 * (i % 2), degrees=True) * dmp.goal_rotation
    via = [(0.5, [0.05, 0.015, 0.0])] if i == 2 else []
    adapted = dmp.adapt(goal_position=goal, goal_rotation=turned, via=via)
    name = f"{np.degrees(angle):.0f}°" + (", via a point" if via else "")
    motions[name], goals[name] = adapted.rollout(), ns.Boundary(1, goal, turned)

motion = motions["0°"]
for name, m in motions.items():
    missed = np.linalg.norm(m.positions[-1] - goals[name].position)
    off = np.degrees((m.rotations[-1] * goals[name].rotation.inv()).magnitude())
    slip = np.abs(m.constraint_residuals).max()
    print(f"{name}: ends {1e6 * missed:.2g} µm and {off:.1e}° off, residual {slip:.1e} m/s")

# What a primitive that is not adapted makes of the first sideways goal.
sideways = goals["90°, via a point"].position
missed = np.linalg.norm(dmp.rollout(goal_position=sideways).positions[-1] - sideways)
print(f"without adaptation, 30 mm sideways: {1e3 * missed:.1f} mm short")
save_figure(adapted_family(original, motions, goals, blade), out)
