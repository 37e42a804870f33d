# /// script
# requires-python = ">=3.11"
# dependencies = ["noslip[robots]"]
# [tool.uv.sources]
# noslip = { path = ".." }
# ///
"""A robot arm executes a learned cut: the hand slipped, the arm's blade does not."""

import argparse

import numpy as np
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip import robots
from noslip.figures import save_figure, style

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--out", default="arm.png", help="the picture's file")
out = parser.parse_args().out

# A cut of 24 cm in 5 s along an S; the hand turns the blade only roughly into the path.
s = np.linspace(0, 1, 501)
u = s**3 * (10 - 15 * s + 6 * s**2)
path = np.column_stack([0.24 * u, 0.05 * np.sin(2 * np.pi * u), 0.01 * np.cos(np.pi * u)])
yaw = 0.6 * np.cos(2 * np.pi * s) + 0.2 * np.sin(3 * np.pi * s)
hand = ns.PoseTrajectory(5 * s, path, Rotation.from_euler("z", yaw), name="hand")

blade = ns.Blade()
dmp = ns.learn(hand, [blade])
motion = dmp.rollout(time_step=1e-3)

# Where the work lies is searched; sensors are noisy, late by 1 ms, and the arm 5 % heavier.
arm = robots.panda()
tracked = robots.track(arm, motion, blade)
done = robots.execute(tracked, noise=1.0, delay=0.001, model_error=0.05)
least, whose = tracked.margins.smallest
print(f"largest residual of the joints' motion {np.abs(tracked.slip).max():.1e} m/s")
print(f"off the path by at most {1e3 * tracked.errors.position.max():.1e} mm, as joints")
print(f"smallest margin {least:.0%}, of the {whose}")
print(f"under torque control {1e3 * done.errors.position.max():.3f} mm off the path")

ways = {
    "hand": 1e3 * np.abs(robots.slip(hand, blade)[:, 0]) * np.diff(hand.times),
    "arm, torque control": 1e3 * np.abs(done.slip[:, 0]) * np.diff(tracked.times),
    "arm, kinematic": 1e3 * np.abs(tracked.slip[:, 0]) * np.diff(tracked.times),
}
times = {"hand": hand.times}
# Gray and black, for the colors are the joints'.
looks = (("gray", "-", 3.2), ("black", "-", 1.1), ("black", ":", 1.4))
lines = {
    name: {"color": style.PALETTE[color], "linestyle": dashes, "linewidth": width}
    for name, (color, dashes, width) in zip(ways, looks, strict=True)
}
figure = style.new_figure(style.TWO_COLUMNS, 3.2)
above, joints, slipped = figure.subplots(1, 3)
for name, path, width in (("commanded", tracked.commanded, 3), ("executed", done.executed, 1)):
    color = style.PALETTE["gray" if width > 1 else "black"]
    above.plot(*1e3 * path.positions[:, :2].T, color=color, linewidth=width, label=name)
edges = done.executed.rotations[::200].apply([12, 0, 0])
tips = 1e3 * done.executed.positions[::200]
above.plot(*np.stack([tips - edges, tips + edges])[:, :, :2].transpose(2, 0, 1), "k", lw=1.4)
above.set_aspect("equal", adjustable="datalim")
shares = (done.joint_positions - (arm.upper + arm.lower) / 2) / (arm.upper - arm.lower) * 2
for joint, name, line in zip(shares.T, arm.joint_names, style.joint_styles(arm.size), strict=True):
    joints.plot(tracked.times, joint, label=name, **line)
joints.axhline(1, color=style.PALETTE["gray"], lw=1)
joints.axhline(-1, color=style.PALETTE["gray"], lw=1, label="limits")
joints.set_ylim(-1.1, 1.1)
for name, way in ways.items():
    since = times.get(name, tracked.times)[1:]
    slipped.semilogy(since, np.cumsum(way) + 1e-9, label=name, **lines[name])
style.dress(above, "x (mm)", "y (mm)", title="the blade, from above the arm's table")
style.dress(joints, "time (s)", "joint in its range (share)", title="all within their limits")
style.dress(slipped, "time (s)", "way slipped so far (mm)", title="slip")
# Each panel has its own lines, and so its own legend, below it.
for ax, columns in ((above, 2), (joints, 3), (slipped, 1)):
    ax.legend(
        loc="upper center",
        bbox_to_anchor=(0.5, -0.24),
        ncols=columns,
        fontsize=style.SMALL_FONT_SIZE,
        frameon=False,
        handlelength=1.8,
        columnspacing=1.0,
    )
person, robot = (style.number(float(ways[name].sum())) for name in list(ways)[:2])
style.write_title(figure, f"The hand slips {person} mm in all, the arm's blade {robot} mm")
save_figure(figure, out)
