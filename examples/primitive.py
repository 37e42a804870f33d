# /// script
# requires-python = ">=3.11"
# dependencies = ["noslip"]
# [tool.uv.sources]
# noslip = { path = ".." }
# ///
"""No constraint at all: a reach learned from one demonstration, and sent to other goals."""

import argparse

import numpy as np
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.figures import plot_orientation, plot_path, plot_speed, save_figure, style

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--out", default="primitive.png", help="the picture's file")
out = parser.parse_args().out

# A reach of 30 cm in 2 s, over a bump, while the hand turns by 60 degrees.
s = np.linspace(0, 1, 401)
u = s**3 * (10 - 15 * s + 6 * s**2)
path = np.column_stack([0.3 * u, 0.06 * np.sin(np.pi * u), 0 * u])
hand = ns.PoseTrajectory(
    2 * s, path, Rotation.from_euler("z", 60 * u, degrees=True), name="demonstration"
)

dmp = ns.learn(hand)
motion = dmp.rollout()

goal = dmp.goal_position + [0.0, 0.08, 0.0]
turned = Rotation.from_euler("z", 30, degrees=True) * dmp.goal_rotation
motions = {
    "demonstration": hand,
    "learned motion": motion,
    "other goal": dmp.rollout(goal_position=goal, goal_rotation=turned),
    "half as fast": dmp.rollout(duration=4.0),
}
off = np.linalg.norm(motion.positions - hand.positions, axis=1).max()
missed = np.linalg.norm(motions["other goal"].positions[-1] - goal)
print(f"off the demonstration by at most {1e3 * off:.2g} mm, without any constraint")
print(f"ends {1e3 * missed:.2g} mm from the other goal")

figure = style.new_figure(6.0, 2.7)
above, turning, speed = figure.subplots(1, 3)
plot_path(above, motions)
plot_orientation(turning, motions, "yaw")
plot_speed(speed, motions)
style.name_lines(figure, motions)
style.write_title(
    figure,
    f"From one demonstration to a goal 80 mm aside: missed by {style.number(1e3 * missed)} mm",
)
save_figure(figure, out)
