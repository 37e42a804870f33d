# /// script
# requires-python = ">=3.11"
# dependencies = ["noslip"]
# [tool.uv.sources]
# noslip = { path = ".." }
# ///
"""Rules of your own: a screw that advances as it turns, and that is never turned back."""

import argparse

import numpy as np
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.figures import save_figure, style

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--out", default="own_rule.png", help="the picture's file")
out = parser.parse_args().out


@ns.velocity_constraint
def screw(motion: ns.Instant, *, lead: float):
    """Along its axis z, the driver advances by the lead (m) for each turn."""
    axis = motion.rotation[:, 2]
    return axis.T @ motion.linear_velocity - lead / (2 * np.pi) * axis.T @ motion.angular_velocity


@ns.keep_nonnegative
def never_back(motion: ns.Instant):
    """The ratchet holds: no turn to the left."""
    return motion.rotation[:, 2].T @ motion.angular_velocity


LEAD = 0.004  # meters a turn
held = screw(lead=LEAD)

# Four turns in 8 s by a wrist that goes back a little between them; 1.2 leads deep a turn.
s = np.linspace(0, 1, 801)
u = s**3 * (10 - 15 * s + 6 * s**2)
turned = 8 * np.pi * u + 2.0 * np.sin(8 * np.pi * u) * np.sin(np.pi * s)
depth = 1.2 * LEAD * turned / (2 * np.pi)
hand = ns.PoseTrajectory(
    8 * s,
    np.column_stack([0 * s, 0 * s, depth]),
    Rotation.from_euler("z", turned),
    name="demonstration",
)

motion = ns.learn(hand, [held, never_back]).rollout()
motions = {"demonstration": hand, "learned motion": motion}
for m in motions.values():
    print(ns.check(m, [held]))
print(f"largest residual {np.abs(motion.constraint_residuals).max():.1e} m/s")
print(f"least margin {motion.margins.min():.1e} rad/s; gave way: {motion.gave_way}")

figure = style.new_figure(6.0, 2.7)
thread, ratchet = figure.subplots(1, 2)
for name, line in style.line_styles(motions).items():
    m = motions[name]
    spin = m.step_velocities()[1][:, 2]
    turns = np.cumsum(spin) * m.period / (2 * np.pi)
    thread.plot(turns, 1e3 * (m.positions[1:, 2] - m.positions[0, 2]), **line)
    ratchet.plot(m.times[1:], spin, **line)
ratchet.axhspan(-6, 0, color=style.PALETTE["vermillion"], alpha=0.2, lw=0)
ratchet.set_ylim(-6, None)
style.dress(thread, "turns", "depth (mm)", title="screw: 4 mm a turn")
style.dress(ratchet, "time (s)", "turning (rad/s)", title="ratchet: never back (shaded)")
style.name_lines(figure, motions)
strays = [style.number(1e3 * ns.check(m, held).peak) for m in motions.values()]
style.write_title(
    figure,
    f"Off its thread by up to {strays[0]} mm/s as demonstrated, {strays[1]} mm/s as learned, and "
    "never turned back",
)
save_figure(figure, out)
