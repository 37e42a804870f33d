# /// script
# requires-python = ">=3.11"
# dependencies = ["noslip"]
# [tool.uv.sources]
# noslip = { path = ".." }
# ///
"""A policy learned from recordings that slip, and the same policy behind a shield."""

import argparse

import numpy as np
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.figures import plot_residuals, save_figure, style
from noslip.shielding import ActionShield

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--out", default="shielded_policy.png", help="the picture's file")
out = parser.parse_args().out

RATE, CHUNK, EXECUTED = 30, 16, 8
random = np.random.default_rng(0)
s = np.linspace(0, 1, 4 * RATE + 1)


def recording() -> np.ndarray:
    """A hand's cut at 30 Hz: x, y, z, rotation vector, gripper.  It trembles, and it slips."""
    u, bend = s**3 * (10 - 15 * s + 6 * s**2), random.uniform(0.015, 0.025)
    path = np.column_stack([0.1 * u, bend * np.sin(2 * np.pi * u), 0 * u])
    yaw = np.arctan2(bend * 2 * np.pi * np.cos(2 * np.pi * u), 0.1) + random.normal(0, 0.1)
    turns = np.column_stack([0 * s, 0 * s, yaw + 0.2 * np.sin(9 * s + random.uniform(0, 6))])
    trembling = random.normal(0, [3e-4, 3e-4, 0, 0, 0, 0.01], (len(s), 6))
    return np.hstack([np.hstack([path, turns]) + trembling, np.ones((len(s), 1))])


# The policy: what the hand did next where it was nearest to here, the mean of eight cuts.
cuts = [recording() for _ in range(8)]
windows = [np.stack([cut[k : k + CHUNK + 1] for k in range(len(s) - CHUNK)]) for cut in cuts]


def policy(pose: np.ndarray) -> np.ndarray:
    """The next 16 actions, from where the tool is."""
    found = []
    for of_cut in windows:
        apart = np.linalg.norm(of_cut[:, 0, :3] - pose[:3], axis=1)
        found.append(of_cut[apart[:-1].argmin() + 1, 1:])
    actions = np.mean(found, axis=0)
    # From here, and on to where the cuts go.
    fade = np.linspace(1, 0, CHUNK)[:, None]
    actions[:, :3] += fade * (pose[:3] - np.mean([w[0, :3] for w in found], axis=0))
    return actions


def run(through: ActionShield | None) -> np.ndarray:
    """What is executed: half of each chunk, then the policy is asked again."""
    executed = [cuts[0][0]]
    while len(executed) < len(s) - CHUNK:
        actions = policy(executed[-1])
        executed += list((actions if through is None else through(actions, EXECUTED))[:EXECUTED])
    return np.array(executed[1:])


def motion_of(actions: np.ndarray, name: str) -> ns.PoseTrajectory:
    times, turns = np.arange(len(actions)) / RATE, Rotation.from_rotvec(actions[:, 3:6])
    return ns.PoseTrajectory(times, actions[:, :3], turns, name=name)


blade = ns.Blade()
shield = ns.Shield([blade], rate=RATE)
alone, motion = motion_of(run(None), "policy"), motion_of(run(ActionShield(shield)), "shielded")
for m in (alone, motion):
    print(ns.check(m, blade))
print(f"largest residual {ns.check(motion, blade).peak:.1e} m/s")

motions = {"policy": alone, "policy behind the shield": motion}
figure = style.new_figure(6.0, 2.7)
above, slip = figure.subplots(1, 2, width_ratios=(1.35, 1))
for cut in cuts:
    above.plot(*1e3 * cut[:, :2].T, color=style.PALETTE["gray"], lw=0.4)
for name, line in style.line_styles(motions).items():
    tips, edges = (
        1e3 * motions[name].positions[::5],
        4 * motions[name].rotations[::5].apply([1, 0, 0]),
    )
    above.plot(*np.stack([tips - edges, tips + edges])[:, :, :2].transpose(2, 0, 1), **line)
above.set_aspect("equal", adjustable="datalim")
style.dress(above, "x (mm)", "y (mm)", title="the recordings (gray), and the blade, from above")
plot_residuals(slip, motions, blade)
style.dress(slip, "time (s)", "speed across the blade (mm/s)")
style.name_lines(figure, motions)
peaks = [style.number(1e3 * ns.check(m, blade).peak) for m in motions.values()]
style.write_title(
    figure, f"The policy slips up to {peaks[0]} mm/s, behind the shield {peaks[1]} mm/s"
)
save_figure(figure, out)
