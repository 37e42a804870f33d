# /// script
# requires-python = ">=3.11"
# dependencies = ["noslip"]
# [tool.uv.sources]
# noslip = { path = ".." }
# ///
"""How fast a tool may move, turn and accelerate: it takes the time that it needs."""

import argparse
import warnings

import numpy as np
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.figures import save_figure, style

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--out", default="rates.png", help="the picture's file")
out = parser.parse_args().out

# Half a turn along an arc of 10 cm in 4 s, from rest to rest.
s = np.linspace(0, 1, 501)
u = s**3 * (10 - 15 * s + 6 * s**2)
radius, angle = 0.1 / np.pi, np.pi * u
arc = radius * np.column_stack([np.sin(angle), 1 - np.cos(angle), 0 * u])
hand = ns.PoseTrajectory(4 * s, arc, Rotation.from_euler("z", angle), name="demonstration")


def speed(m: ns.PoseTrajectory) -> np.ndarray:
    return 1e3 * np.linalg.norm(m.step_velocities()[0], axis=1)


def turning(m: ns.PoseTrajectory) -> np.ndarray:
    return np.linalg.norm(m.step_velocities()[1], axis=1)


def acceleration(m: ns.PoseTrajectory) -> np.ndarray:
    return 1e3 * np.linalg.norm(np.diff(m.step_velocities()[0], axis=0), axis=1) / m.period


panels = {
    "speed (mm/s)": (ns.SpeedLimit(0.035), speed, 35),
    "turning (rad/s)": (ns.constraints.AngularRateLimit(1.2), turning, 1.2),
    "acceleration (mm/s²)": (ns.constraints.AccelerationLimit(linear=0.04), acceleration, 40),
}
figure = style.new_figure(6.0, 2.8)
found = []
for ax, (label, (limit, size, allowed)) in zip(figure.subplots(1, 3), panels.items(), strict=True):
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        motion = ns.learn(hand, [limit]).rollout()
    print(*(warning.message for warning in told), sep="\n")
    missed = np.linalg.norm(motion.positions[-1] - hand.positions[-1])
    found.append(f"{style.number(size(motion).max())} of {style.number(size(hand).max())}")
    print(
        f"{limit.name}: least margin {motion.margins.min():.1e}, ends {1e3 * missed:.2f} mm from "
        f"the demonstrated end; {label} at most {found[-1]}; gave way: {motion.gave_way}"
    )
    motions = {"demonstration": hand, "learned motion": motion}
    for name, line in style.line_styles(motions).items():
        values = size(motions[name])
        ax.plot(motions[name].times[-len(values) :], values, **line)
    ax.axhspan(allowed, 1.15 * size(hand).max(), color=style.PALETTE["vermillion"], alpha=0.2, lw=0)
    ax.set_ylim(0, 1.15 * size(hand).max())
    style.dress(ax, "time (s)", label, title=limit.name)
style.name_lines(figure, motions)
style.write_title(
    figure,
    f"Learned motions keep below their limits (shaded): {found[0]} mm/s, {found[1]} rad/s and "
    f"{found[2]} mm/s² that were demonstrated",
)
save_figure(figure, out)
