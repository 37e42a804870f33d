# /// script
# requires-python = ">=3.11"
# dependencies = ["noslip"]
# [tool.uv.sources]
# noslip = { path = ".." }
# ///
"""Pushed off its path, a blade comes back without slipping, and follows a goal that moves."""

import argparse
from dataclasses import replace

import numpy as np
from matplotlib.lines import Line2D
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.figures import save_figure, style

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--out", default="pushes.png", help="the picture's file")
out = parser.parse_args().out

# A cut of 10 cm in 4 s.
s = np.linspace(0, 1, 501)
u = s**3 * (10 - 15 * s + 6 * s**2)
path = np.column_stack([0.1 * u, 0.02 * np.sin(2 * np.pi * u), 0 * u])
yaw = np.arctan(0.4 * np.pi * np.cos(2 * np.pi * u))
hand = ns.PoseTrajectory(4 * s, path, Rotation.from_euler("z", yaw), name="demonstration")
dmp = ns.learn(hand, [ns.Blade()])
motion = dmp.rollout()
step = dmp.duration / dmp.steps
push, moved = np.array([0.0, -0.012, 0.0]), dmp.goal_position + [0.01, 0.02, 0.0]


def run(with_controller: bool, push: np.ndarray, goal: np.ndarray) -> list[ns.State]:
    """Push the tool at 1.6 s, and move the goal then.

    A hand holds it there until the controller leads on; without one it goes on from there at once.
    """
    controller = dmp.controller(time_step=step, follows=True)
    states, held = [controller.reset()], None
    while states[-1].time < dmp.duration - step / 2 if not with_controller else not controller.done:
        now = states[-1]
        if abs(now.time - 1.6) < step / 2:
            held = replace(now, position=now.position + push, goal_position=goal)
        if controller.replanned:
            held = None
        if with_controller:
            states.append(controller.step(held or now, None if now.time < 1.6 else goal))
        else:
            states.append(dmp.step(held or now, step))
            held = None
    return states


runs = {
    "pushed sideways": (True, push, dmp.goal_position),
    "goal moved": (True, 0 * push, moved),
    "both, without a controller": (False, push, moved),
}
figure = style.new_figure(6.0, 3.0)
above, error = figure.subplots(1, 2, width_ratios=(1.4, 1))
above.plot(*1e3 * motion.positions[:, :2].T, color="black", lw=3, alpha=0.25)
lines = dict(zip(runs, ("blue", "green", "vermillion"), strict=True))
ends = {}
for name, (with_controller, by, goal) in runs.items():
    states = run(with_controller, by, goal)
    slip = max(np.abs(state.constraint_residuals).max() for state in states)
    ends[name] = np.linalg.norm(states[-1].position - goal)
    print(f"{name}: ends {1e3 * ends[name]:.2g} mm off, residual {slip:.1e} m/s")
    x, y = 1e3 * np.array([state.position[:2] for state in states]).T
    off = [1e3 * np.linalg.norm(state.position - goal) for state in states]
    color = style.PALETTE[lines[name]]
    above.plot(x, y, color=color, lw=1.4)
    above.plot(*1e3 * goal[:2], "s", color=color, mfc="none", ms=7)
    error.semilogy([state.time for state in states], off, color=color, lw=1.4)
above.set_aspect("equal", adjustable="datalim")
style.dress(above, "x (mm)", "y (mm)", title="from above; squares are goals")
style.dress(error, "time (s)", "distance to the goal (mm)")
handles = {name: Line2D([], [], color=style.PALETTE[color]) for name, color in lines.items()}
style.put_legend(figure, {"as learned": Line2D([], [], color="black", lw=3, alpha=0.25)} | handles)
worst = max(ends["pushed sideways"], ends["goal moved"])
style.write_title(
    figure,
    f"Led back, the blade ends within {style.number(1e3 * worst)} mm; left alone it misses by "
    f"{style.number(1e3 * ends['both, without a controller'])} mm",
)
save_figure(figure, out)
