# /// script
# requires-python = ">=3.11"
# dependencies = ["noslip"]
# [tool.uv.sources]
# noslip = { path = ".." }
# ///
"""Edge first, and no bend too tight: a saw that never backs up, a cart that turns like a car."""

import argparse

import numpy as np
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.figures import save_figure, style

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--out", default="travel.png", help="the picture's file")
out = parser.parse_args().out

# A hand that hesitates and draws back twice on its way along 10 cm; and one that takes a corner of
# 90 degrees within 2 cm.
s = np.linspace(0, 1, 501)
u = s**3 * (10 - 15 * s + 6 * s**2)
hesitant = 0.1 * u + 0.012 * np.sin(6 * np.pi * u) * np.sin(np.pi * u)
saw = ns.PoseTrajectory(
    5 * s, np.column_stack([hesitant, 0 * s, 0 * s]), Rotation.identity(len(s)), name="saw"
)
heading = np.pi / 2 / (1 + np.exp(-40 * (s - 0.5)))
corner = np.cumsum(np.column_stack([np.cos(heading), np.sin(heading), 0 * s]), axis=0) / len(s)
cart = ns.PoseTrajectory(5 * s, 0.2 * corner, Rotation.from_euler("z", heading), name="cart")

RADIUS = 0.05
only = ns.constraints.ForwardOnly(edge="x")
forward = ns.learn(saw, [only]).rollout()
car = ns.constraints.TurningRadius(radius=RADIUS)
wide = ns.learn(cart, [car, ns.Wheel()]).rollout()
for motion in (forward, wide):
    print(f"least margins {motion.margins.min(axis=0)} m/s; gave way: {motion.gave_way}")
print(f"wheels: largest residual {np.abs(wide.constraint_residuals).max():.1e} m/s")


def path_radius(m: ns.PoseTrajectory) -> np.ndarray:
    """Of the path, from one step to the next (m)."""
    v, w = m.step_velocities()
    return np.linalg.norm(v, axis=1) / np.maximum(np.abs(w[:, 2]), 1e-9)


figure = style.new_figure(6.0, 2.9)
way, above, bend = figure.subplots(1, 3)
motions = {"demonstration": saw, "learned motion": forward}
for (name, line), m in zip(style.line_styles(motions).items(), (cart, wide), strict=True):
    way.plot(motions[name].times, 1e3 * motions[name].positions[:, 0], **line)
    above.plot(*1e3 * m.positions[:, :2].T, **line)
    bend.semilogy(m.times[1:], 1e3 * np.minimum(path_radius(m), 10), **line)
bend.axhspan(1, 1e3 * RADIUS, color=style.PALETTE["vermillion"], alpha=0.2, lw=0)
bend.set_ylim(5, 2e3)
above.set_aspect("equal", adjustable="datalim")
style.dress(way, "time (s)", "way (mm)", title=only.name)
style.dress(above, "x (mm)", "y (mm)", title=f"{car.name}, from above")
style.dress(bend, "time (s)", "radius of the path (mm)", title="shaded: too tight")
style.name_lines(figure, motions)
backwards = [np.abs(np.minimum(np.diff(m.positions[:, 0]), 0)).sum() for m in (saw, forward)]
back = [style.number(1e3 * way) for way in backwards]
tight = [style.number(1e3 * path_radius(m).min()) for m in (cart, wide)]
style.write_title(
    figure,
    f"As learned, the saw backs up by {back[1]} mm and no bend is below {tight[1]} mm; "
    f"as demonstrated, {back[0]} mm and {tight[0]} mm",
)
save_figure(figure, out)
