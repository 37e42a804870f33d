"""Where it can go: a cart that takes no tight bend, and a needle with a beveled tip."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import ListedColormap
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.constraints import TurningRadius
from noslip.errors import muted
from noslip.figures import style
from noslip.maneuvers.maneuver import integrated
from noslip.maneuvers.planar import dubins

RADIUS, BEND, LENGTH = 0.3, 5.0, 0.2
NAMED = {"ls": "none", "marker": "o", "ms": 5, "mec": "k"}

figure, (cart, needle) = plt.subplots(1, 2, figsize=(9, 5.2), layout="constrained")

# The other half is its mirror image.
x, half = np.linspace(-1.2, 1.2, 161), np.linspace(0, 1.2, 81)
left = np.array([[dubins(a, b, 0.0, RADIUS)[0].length for a in x] for b in half])
y, ways = np.append(-half[:0:-1], half), np.vstack([left[:0:-1], left])
levels = np.arange(0, 3.51, 0.5)
grays = ListedColormap(plt.get_cmap("Greys")(np.linspace(0.02, 0.6, len(levels) - 1)))
shades = cart.contourf(x, y, ways, levels, cmap=grays)
cart.contour(x, y, ways, levels, colors="w", linewidths=0.6)
bar = figure.colorbar(shades, ax=cart, location="bottom", shrink=0.8, aspect=40, pad=0.02)
bar.set_label(
    "length of the shortest way to goals that head as the start does (m)",
    fontsize=style.SMALL_FONT_SIZE,
)
bar.ax.tick_params(labelsize=style.SMALL_FONT_SIZE)

s = np.linspace(0, 1, 201)
u = s**3 * (10 - 15 * s + 6 * s**2)
ahead = np.column_stack([u, 0 * u, 0 * u])
hand = ns.PoseTrajectory(4 * s, ahead, Rotation.from_rotvec(0 * ahead))
dmp = ns.learn(hand, [ns.Wheel(), TurningRadius(RADIUS)])
goals = {
    "blue": (1.0, 0.6, 0),
    "vermillion": (0.1, -0.5, 0),
    "green": (-0.8, 0.1, 0),
    "purple": (0.6, 0.9, 180),
}
for color, (gx, gy, turned) in goals.items():
    turn = Rotation.from_euler("z", turned, degrees=True)
    # A longer way takes longer, which would be told.
    with muted():
        there = dmp.adapt(goal_position=[gx, gy, 0], goal_rotation=turn, shape="shortest")
    motion = there.rollout()
    look = {"color": style.PALETTE[color]}
    name = f"{there.record[0].maneuver}" + (f", turned by {turned}°" if turned else "")
    cart.plot(*motion.positions[:, :2].T, lw=2, label=name, **look)
    way = turn.apply([0.16, 0, 0])[:2]
    cart.annotate(
        "", np.add((gx, gy), way), (gx, gy), arrowprops={"arrowstyle": "->", "lw": 2} | look
    )
    cart.plot(gx, gy, **NAMED, **look)
cart.plot(0, 0, "ks", ms=5)
cart.annotate("start", (0, 0), (-0.05, -0.02), ha="right", va="center", fontsize=6.5)
cart.set(aspect="equal", xlim=(-1.2, 1.2), ylim=(-1.2, 1.2))
cart.legend(loc="lower right", fontsize=6.5, framealpha=0.9)
style.dress(
    cart,
    "x (m)",
    "y (m)",
    title=f"a cart that turns in {RADIUS} m comes to any pose:\n"
    "what lies beside or behind it, by a long way round",
)
cart.grid(visible=False)

rng = np.random.default_rng(0)
steps, count = 200, 1200
ds = LENGTH / steps
waves = np.cos(np.pi * np.outer(np.arange(10), (np.arange(steps) + 0.5) / steps))
# From hardly any roll to some turns, smooth along the way.
amounts = 10 ** rng.uniform(-1, 2, (count, 1)) * rng.normal(size=(count, 10))
tips = []
for rolls in amounts @ waves / steps:
    twists = np.zeros((steps, 6))
    twists[:, 0], twists[:, 3], twists[:, 5] = ds, rolls, BEND * ds
    tips.append(integrated(twists)[0][1 + rng.choice(steps, 8, replace=False)])
depth, *aside = 1e3 * np.concatenate(tips).T
off = np.hypot(*aside) * rng.choice([-1, 1], len(depth))
needle.plot(depth, off, ".", ms=2, color=style.PALETTE["sky"], label="tips after random rolls")

angles = np.linspace(0, BEND * LENGTH, 101)
arc = 1e3 / BEND * np.array([np.sin(angles), 1 - np.cos(angles)])
rest = 1e3 * (LENGTH - angles / BEND)
cap = arc + rest * np.array([np.cos(angles), np.sin(angles)])
held, rolled = "without roll", f"then rolled all the time, {1e3 * LENGTH:.0f} mm of way"
dashed = {"color": style.PALETTE["vermillion"], "ls": "--"}
for side, shown in ((1, ""), (-1, "_")):
    needle.plot(arc[0], side * arc[1], "k", lw=1.6, label=shown + held)
    needle.plot(cap[0], side * cap[1], lw=1.6, label=f"{shown}{held}, {rolled}", **dashed)
needle.set(aspect="equal", xlim=(-5, 215), ylim=(-130, 130))
needle.legend(loc="upper left", fontsize=6.5, markerscale=3)
wide = np.interp(100, *arc)
style.dress(
    needle,
    "depth (mm)",
    "aside (mm)",
    title=f"a beveled needle comes to places in a trumpet:\nup to {wide:.0f} mm aside, 100 mm deep",
)
