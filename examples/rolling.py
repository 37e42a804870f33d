# /// script
# requires-python = ">=3.11"
# dependencies = ["noslip"]
# [tool.uv.sources]
# noslip = { path = ".." }
# ///
"""A rotary cutter and a ball that roll: the point that touches the ground stands still."""

import argparse

import numpy as np
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.figures import save_figure, style

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--out", default="rolling.png", help="the picture's file")
out = parser.parse_args().out

# A disc of 2 cm radius along a straight cut, and a ball of the same radius round a loop; recorded
# with too little turning, two thirds of what their ways ask for.
RADIUS = 0.02
s = np.linspace(0, 1, 501)
u = s**3 * (10 - 15 * s + 6 * s**2)
straight = np.column_stack([0.16 * u, 0 * s, RADIUS + 0 * s])
spin = Rotation.from_euler("y", 2 / 3 * 0.16 * u / RADIUS)
loop = np.column_stack([0.04 * np.cos(5 * u), 0.04 * np.sin(5 * u), RADIUS + 0 * s])
# The loop's radius is twice the ball's, so a ball that rolls turns 2 rad per rad of the loop.
tumble = Rotation.from_euler("xz", np.column_stack([-2 / 3 * 2 * 5 * u, 5 * u]))
recorded = {
    "disc": (
        ns.PoseTrajectory(3 * s, straight, spin),
        ns.constraints.RollingDisc(RADIUS, axle="y"),
    ),
    "ball": (ns.PoseTrajectory(3 * s, loop, tumble), ns.constraints.RollingSphere(RADIUS)),
}


def rolled_off(motion: ns.PoseTrajectory) -> np.ndarray:
    """Length of ground that turning alone makes a round body cover (m)."""
    w = motion.step_velocities()[1]
    return np.cumsum(RADIUS * np.hypot(w[:, 0], w[:, 1])) * motion.period


figure = style.new_figure(6.0, 2.4)
rim, ways = figure.subplots(1, 2, width_ratios=(1.8, 1))
scrapes = []
for name, (hand, rolling) in recorded.items():
    motion = ns.learn(hand, [rolling]).rollout()
    motions = {"demonstration": hand, "learned motion": motion}
    for m in motions.values():
        print(f"{name}: {ns.check(m, rolling)}")
        scrapes.append(ns.check(m, rolling).peak)
    print(f"{name}: largest residual {np.abs(motion.constraint_residuals).max():.1e} m/s")
    for label, line in style.line_styles(motions).items():
        m = motions[label]
        if name == "disc":
            point = 1e3 * (m.positions + RADIUS * m.rotations.apply([0, 0, -1]))
            rim.plot(point[:, 0], point[:, 2], **line)
        else:
            ways.plot(m.times[1:], 1e3 * rolled_off(m), **line)
way = np.cumsum(np.linalg.norm(motion.step_velocities()[0], axis=1)) * motion.period
ways.plot(motion.times[1:], 1e3 * way, "k:", lw=2.2)
ways.annotate(
    "the center's way", (1.95, 155), (0.2, 175), fontsize=7, arrowprops={"arrowstyle": "-"}
)
rim.set_aspect("equal", adjustable="box")
style.dress(rim, "x (mm)", "height (mm)", title="way of one point of the disc's rim")
style.dress(ways, "time (s)", "way rolled off (mm)", title="the ball, round a loop")
style.name_lines(figure, motions)
hand, learned = style.number(1e3 * max(scrapes[::2])), style.number(1e3 * max(scrapes[1::2]))
style.write_title(
    figure,
    f"Demonstrated, the point on the ground scrapes at up to {hand} mm/s; learned, it rests "
    f"({learned} mm/s)",
)
save_figure(figure, out)
