# /// script
# requires-python = ">=3.11"
# dependencies = ["noslip"]
# [tool.uv.sources]
# noslip = { path = ".." }
# ///
"""A tool that stays on a surface, plane, sphere, cylinder or formula, with a blade that cuts it."""

import argparse

import numpy as np
from matplotlib.lines import Line2D
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.figures import save_figure, style

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--out", default="contact.png", help="the picture's file")
out = parser.parse_args().out

# A hand sweeps over four bodies, up to 3 mm off their surfaces; its blade yaws as it likes.
s = np.linspace(0, 1, 501)
u = s**3 * (10 - 15 * s + 6 * s**2)
x, y = 0.12 * (u - 0.5), 0.03 * np.sin(2 * np.pi * u)
off = 0.002 + 0.001 * np.sin(5 * np.pi * s)
yaw = Rotation.from_euler("z", np.cos(2 * np.pi * u) + 0.3 * np.sin(3 * np.pi * s))


def hills(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return 0.01 * np.sin(60 * x) * np.cos(40 * y)


contacts = {
    "plane": (ns.constraints.PlaneContact(normal=(0.2, 0, 1)), -0.2 * x),
    "sphere": (ns.constraints.SphereContact((0, 0, -0.1), 0.1), np.sqrt(0.01 - x**2 - y**2) - 0.1),
    "cylinder": (
        ns.constraints.CylinderContact((0, 0, -0.08), (1, 0, 0), 0.08),
        np.sqrt(0.0064 - y**2) - 0.08,
    ),
    "formula": (ns.constraints.SurfaceContact("z - 0.01*sin(60*x)*cos(40*y)"), hills(x, y)),
}
blade = ns.Blade()
colors = dict(zip(contacts, ("vermillion", "green", "purple", "blue"), strict=True))

figure = style.new_figure(6.0, 2.9)
above, distance = figure.subplots(1, 2, width_ratios=(1.35, 1))
styles = {"shown": {"color": style.PALETTE["gray"], "lw": 3}}
off_as_shown, off_as_learned, slips = [], [], []
for name, (contact, z) in contacts.items():
    hand = ns.PoseTrajectory(4 * s, np.column_stack([x, y, z + off]), yaw, name=name)
    motion = ns.learn(hand, [contact, blade]).rollout()
    for m in (hand, motion):
        print(ns.check(m, [contact, blade]))
    off_as_shown.append(ns.check(hand, contact).peak)
    off_as_learned.append(ns.check(motion, contact).peak)
    slips.append(ns.check(motion, blade).peak)
    styles[name] = {"color": style.PALETTE[colors[name]], "lw": 0.9}
    size = np.abs(motion.constraint_residuals[:, 0])
    distance.semilogy(motion.times, np.maximum(1e3 * size, 1e-16), **styles[name])
distance.semilogy(4 * s, 1e3 * off, **styles["shown"])
print(f"largest residuals {max(off_as_learned):.1e} m, {max(slips):.1e} m/s")

# The last of them, from above; levels every 2 mm.
X, Y = np.meshgrid(np.linspace(-0.07, 0.07, 80), np.linspace(-0.042, 0.042, 60))
levels = np.arange(-10, 10.1, 2)
colored = above.contourf(1e3 * X, 1e3 * Y, 1e3 * hills(X, Y), levels, cmap="Grays", alpha=0.5)
for m, line in ((hand, styles["shown"]), (motion, {"color": "black", "lw": 1.2})):
    tips, edges = 1e3 * m.positions[::20], 5 * m.rotations[::20].apply([1, 0, 0])
    blades = np.stack([tips - edges, tips + edges])
    above.plot(*blades[:, :, :2].transpose(2, 0, 1), **line)
above.plot(*1e3 * motion.positions[:, :2].T, **styles["formula"])
above.set_aspect("equal")
bar = figure.colorbar(colored, ax=above, location="right", shrink=0.8, aspect=25)
bar.set_label("height (mm)", fontsize=7)
bar.ax.tick_params(labelsize=7)
style.dress(above, "x (mm)", "y (mm)", title="blades on z = 0.01 sin(60 x) cos(40 y), from above")
style.dress(distance, "time (s)", "off the surface (mm)")
style.put_legend(figure, {name: Line2D([], [], **line) for name, line in styles.items()})
shown, learned = style.number(1e3 * max(off_as_shown)), style.number(1e3 * max(off_as_learned))
style.write_title(
    figure,
    f"Shown {shown} mm off four kinds of surface, learned {learned} mm; the blade slips at most "
    f"{style.number(1e3 * max(slips))} mm/s",
)
save_figure(figure, out)
