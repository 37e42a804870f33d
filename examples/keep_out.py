# /// script
# requires-python = ">=3.11"
# dependencies = ["noslip"]
# [tool.uv.sources]
# noslip = { path = ".." }
# ///
"""A cut around a nerve and a vessel: the tool keeps out of a sphere and of a capsule."""

import argparse

import numpy as np
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.figures import save_figure, style

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--out", default="keep_out.png", help="the picture's file")
out = parser.parse_args().out

# A straight cut of 10 cm in 4 s, demonstrated before either was known of.
s = np.linspace(0, 1, 501)
u = s**3 * (10 - 15 * s + 6 * s**2)
path = np.column_stack([0.1 * u, 0 * u, 0 * u])
hand = ns.PoseTrajectory(4 * s, path, Rotation.identity(len(s)), name="demonstration")

CENTER, RADIUS = np.array([0.03, -0.004, 0.0]), 0.012
START, END, WIDTH = np.array([0.07, 0.006, 0.0]), np.array([0.09, 0.03, 0.0]), 0.01
nerve = ns.KeepOutSphere(center=CENTER, radius=RADIUS)
vessel = ns.constraints.KeepOutCapsule(start=START, end=END, radius=WIDTH)

rules = [nerve, vessel, ns.Blade(), ns.constraints.PlaneContact()]
dmp = ns.learn(hand, rules)
motion = dmp.rollout()
motions = {"demonstration": hand, "learned motion": motion}
print(f"least margins {motion.margins.min(axis=0)} m ({', '.join(motion.limit_names)})")
print(f"gave way: {motion.gave_way}")
print(f"largest residual {np.abs(motion.constraint_residuals).max():.1e} m/s, m")

figure = style.new_figure(6.0, 2.9)
above, margin = figure.subplots(1, 2, width_ratios=(1.5, 1))
X, Y = np.meshgrid(np.linspace(-0.005, 0.105, 300), np.linspace(-0.03, 0.045, 300))
P = np.stack([X, Y, 0 * X], axis=-1)
along = np.clip((P - START) @ (END - START) / np.sum((END - START) ** 2), 0, 1)
to_vessel = np.linalg.norm(P - START - along[..., None] * (END - START), axis=-1) - WIDTH
inside = np.minimum(np.linalg.norm(P - CENTER, axis=-1) - RADIUS, to_vessel) < 0
color = [style.PALETTE["vermillion"]]
above.contourf(1e3 * X, 1e3 * Y, inside, [0.5, 1.5], colors=color, alpha=0.25)
for name, line in style.line_styles(motions).items():
    m = motions[name]
    above.plot(*1e3 * m.positions[:, :2].T, **line)
for name, place in (("nerve", CENTER), ("vessel", (START + END) / 2)):
    above.annotate(name, 1e3 * np.array(place[:2]), fontsize=7, ha="center", va="center")
tips, edges = 1e3 * motion.positions[::20], 3 * motion.rotations[::20].apply([1, 0, 0])
blades = np.stack([tips - edges, tips + edges])
above.plot(*blades[:, :, :2].transpose(2, 0, 1), color=line["color"], lw=2.5)
for name, values in zip(("nerve", "vessel"), 1e3 * motion.margins.T, strict=True):
    margin.plot(
        motion.times, values, label=name, ls="-" if name == "nerve" else "--", color="black"
    )
margin.axhspan(-5, 0, color=style.PALETTE["vermillion"], alpha=0.25, lw=0)
margin.set_ylim(-5, None)
margin.legend(fontsize=7, frameon=False)
above.set_aspect("equal")
style.dress(above, "x (mm)", "y (mm)", title="path and blade, from above")
style.dress(
    margin, "time (s)", "distance to it (mm)", title="of the learned motion; shaded: inside"
)
style.name_lines(figure, motions)
least = style.number(1e3 * motion.margins.min())
slip = style.number(1e3 * np.abs(motion.constraint_residuals[:, 0]).max())
style.write_title(
    figure,
    f"The blade passes nerve and vessel {least} mm off, and slips {slip} mm/s",
)
save_figure(figure, out)
