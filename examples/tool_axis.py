# /// script
# requires-python = ">=3.11"
# dependencies = ["noslip"]
# [tool.uv.sources]
# noslip = { path = ".." }
# ///
"""A glass carried upright, and a torch at its work angle to a pipe."""

import argparse

import numpy as np
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.figures import save_figure, style

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--out", default="tool_axis.png", help="the picture's file")
out = parser.parse_args().out

# A glass moved by half a meter, which the hand tilts; and a torch round a pipe of 10 cm radius,
# whose axis should lean by 30 degrees from the pipe's normal, and does so only roughly.
s = np.linspace(0, 1, 501)
u = s**3 * (10 - 15 * s + 6 * s**2)
carried = np.column_stack([0.5 * u, 0 * s, 0.1 * np.sin(np.pi * u)])
tilt = np.column_stack([0.1 * np.sin(4 * np.pi * s), 0.15 * np.sin(2 * np.pi * u)])
glass = ns.PoseTrajectory(2 * s, carried, Rotation.from_euler("xy", tilt), name="glass")
turn = 2.5 * u - 1.25
around = 0.1 * np.column_stack([np.sin(turn), 0 * s, np.cos(turn)])
lean = turn + np.radians(30) + 0.15 * np.sin(3 * np.pi * s)
torch = ns.PoseTrajectory(8 * s, around, Rotation.from_euler("y", lean), name="torch")

upright = ns.constraints.ToolAxis(axis="z", direction=(0, 0, 1))
work_angle = ns.constraints.ToolAxis(
    axis="z", angle=np.radians(30), surface="sqrt(x**2 + z**2) - 0.1"
)
on_the_pipe = ns.constraints.CylinderContact(axis=(0, 1, 0), radius=0.1)


def up(m: ns.PoseTrajectory) -> np.ndarray:
    return np.tile([0.0, 0.0, 1.0], (len(m), 1))


def off_the_pipe(m: ns.PoseTrajectory) -> np.ndarray:
    return m.positions * [1, 0, 1] / np.hypot(m.positions[:, :1], m.positions[:, 2:])


def angle(m: ns.PoseTrajectory, direction: np.ndarray) -> np.ndarray:
    """Between the tool's z axis and a direction (degrees)."""
    axis = m.rotations.apply([0, 0, 1])
    sine = np.linalg.norm(np.cross(axis, direction), axis=1)
    return np.degrees(np.arctan2(sine, np.sum(axis * direction, axis=1)))


figure = style.new_figure(6.0, 3.0)
picture, tilts, leans = figure.subplots(1, 3, width_ratios=(1.2, 1, 1))
found = []
for ax, hand, rules, direction, wanted in (
    (tilts, glass, [upright], up, 0.0),
    (leans, torch, [work_angle, on_the_pipe], off_the_pipe, 30.0),
):
    motion = ns.learn(hand, rules).rollout()
    motions = {"demonstration": hand, "learned motion": motion}
    for m in motions.values():
        print(ns.check(m, rules[0]))
        found.append(np.abs(angle(m, direction(m)) - wanted).max())
    print(f"{hand.name}: largest residual {np.abs(motion.constraint_residuals).max():.1e}")
    for name, line in style.line_styles(motions).items():
        ax.plot(motions[name].times, angle(motions[name], direction(motions[name])), **line)
        if hand is torch:
            tips = 1e3 * motions[name].positions[::40]
            tools = np.stack([tips, tips + 50 * motions[name].rotations[::40].apply([0, 0, 1])])
            picture.plot(*tools[:, :, [0, 2]].transpose(2, 0, 1), **line)
pipe = np.linspace(-1.6, 1.6, 100)
picture.fill_between(
    100 * np.sin(pipe), 100 * np.cos(pipe), -5, color=style.PALETTE["sky"], alpha=0.4
)
picture.set_aspect("equal", adjustable="datalim")
style.dress(picture, "x (mm)", "z (mm)", title="torch round a pipe")
style.dress(tilts, "time (s)", "tilt (°)", title="glass, to be upright")
style.dress(leans, "time (s)", "angle to the normal (°)", title="torch, to be at 30°")
style.name_lines(figure, motions)
style.write_title(
    figure,
    f"The glass tilts by up to {style.number(found[0])}° as shown, {style.number(found[1])}° as "
    f"learned; the torch errs by {style.number(found[2])}° and {style.number(found[3])}°",
)
save_figure(figure, out)
