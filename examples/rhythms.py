# /// script
# requires-python = ">=3.11"
# dependencies = ["noslip"]
# [tool.uv.sources]
# noslip = { path = ".." }
# ///
"""A saw cut from one recording of seven strokes: entered, sped up, and left to a goal."""

import argparse

import numpy as np
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.figures import compare_motions, save_figure

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--out", default="rhythms.png", help="the picture's file")
out = parser.parse_args().out

# A hand saws to and fro for 14 s, 12 cm each way, no two strokes alike; its blade wavers.
rng, times = np.random.default_rng(2), np.arange(0, 14.3, 0.01)
knots = np.arange(0, 17, 2.0)
late, aside, deep, yaw, roll = (np.interp(times, knots, rng.normal(size=9)) for _ in range(5))
angle = np.pi * times + 0.15 * late
path = [60 * np.cos(angle), 0.8 * aside, 4 * np.sin(angle) + 0.5 * deep]
held = np.stack([0.02 * yaw, 0.06 * np.sin(angle), 0.02 * roll], axis=1)
hand = ns.PoseTrajectory(
    times, np.stack(path, axis=1) / 1e3, Rotation.from_euler("zyx", held), name="hand"
)

blade = ns.Blade()
sawing = ns.learn(hand, blade, rhythmic=True, period=2.0)
print(f"{len(sawing.record)} strokes, learned as one of {sawing.duration:.3g} s")

# A plain cut of 25 cm in 1.5 s, which the rhythm is entered by, and left by to a goal.
share = np.linspace(0, 1, 101)
along = np.outer(share**3 * (10 - 15 * share + 6 * share**2), [0.25, 0, 0])
cut = ns.learn(ns.PoseTrajectory(1.5 * share, along, Rotation.identity(101)), blade)

h, begin = 0.005, sawing.initial_state()
back = begin.position + begin.rotation.apply([-0.05, 0, 0.03])
entering = cut.adapt(goal=begin, start_position=back, start_rotation=begin.rotation)
states = [entering.initial_state()]
while not states[-1].done:
    states.append(entering.step(states[-1], h))
state = sawing.initial_state(start=states[-1])
# Twice as fast from 5 s on, and left on its way forwards.
while state.time < 9 or not 0.7 < state.phase < 0.8:
    faster = 2.0 if state.time < 5 else 1.0
    state = sawing.modulated(state, h, within=1.0, period=faster)
    states.append(state := sawing.step(state, h))
leaving = cut.adapt(
    start=state, goal_position=[0.25, 0, 0.02], goal_rotation=Rotation.identity(), goal_velocity=0
)
state = leaving.initial_state()
while not state.done:
    states.append(state := leaving.step(state, h))

motion = ns.PoseTrajectory(
    [each.time for each in states],
    [each.position for each in states],
    Rotation.concatenate([each.rotation for each in states]),
    name="saw",
)
residual = ns.check(motion, blade).peak
off = np.linalg.norm(state.position - leaving.goal_position)
print(f"residual at most {residual:.0e} m/s; ends {1e3 * off:.0e} mm from its goal")
velocities, _ = motion.step_velocities()
changes = np.linalg.norm(np.diff(velocities, axis=0), axis=1)
print(
    f"velocity changes by {1e3 * changes.max():.0f} mm/s a step at most, entering and leaving too"
)

save_figure(compare_motions({"hand": hand, "saw": motion}, blade), out)
