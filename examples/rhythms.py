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
from noslip.constraints.check import step_residuals
from noslip.figures import column_figure, save_figure, style
from noslip.runtime.rhythm import modulated

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
state = entering.initial_state()
states, parts = [state], [0]
while not state.done:
    states.append(state := entering.step(state, h))
parts.append(len(states) - 1)
state = sawing.initial_state(start=state)
# Left on its way forwards.
while state.time < 9 or not 0.7 < state.phase < 0.8:
    faster = 2.0 if state.time < 5 else 1.0
    state = modulated(sawing.law, state, h, within=1.0, period=faster)
    states.append(state := sawing.step(state, h))
parts.append(len(states) - 1)
leaving = cut.adapt(
    start=state, goal_position=[0.25, 0, 0.02], goal_rotation=Rotation.identity(), goal_velocity=0
)
state = leaving.initial_state()
while not state.done:
    states.append(state := leaving.step(state, h))
parts.append(len(states) - 1)

state_off = float(np.linalg.norm(state.position - leaving.goal_position))

run = ns.PoseTrajectory(
    [each.time for each in states],
    [each.position for each in states],
    Rotation.concatenate([each.rotation for each in states]),
)
velocities = run.step_velocities()
changes = [np.linalg.norm(np.diff(each, axis=0), axis=1) for each in velocities]
slips = {"hand": step_residuals(hand, blade)[:, 0], "run": step_residuals(run, blade)[:, 0]}
print(f"slip: hand {1e3 * np.abs(slips['hand']).max():.0f} mm/s,", end=" ")
print(f"run {np.abs(slips['run']).max():.0e} m/s; {1e3 * state_off:.0e} mm off the goal")
for name, seam in (("entering", parts[1]), ("leaving", parts[2])):
    print(f"{name}: velocity changes by {1e3 * changes[0][seam - 1]:.1f} mm/s in that step")

figure = column_figure(2, 3.2)
grid = figure.add_gridspec(2, 2, width_ratios=(1, 1.5))
portrait, course, slip = (
    figure.add_subplot(place) for place in (grid[:, 0], grid[0, 1], grid[1, 1])
)
gray, blue = style.PALETTE["gray"], style.PALETTE["blue"]
colors = style.PALETTE["vermillion"], blue, style.PALETTE["green"]
x = 1e3 * hand.positions[:, 0]
portrait.plot(x[1:], 1e3 * hand.step_velocities()[0][:, 0], color=gray, lw=0.8, label="hand")
for first, last, color, name in zip(
    parts[:-1], parts[1:], colors, ("entering", "sawing", "leaving"), strict=True
):
    x, v = 1e3 * run.positions[first : last + 1, 0], 1e3 * velocities[0][first:last, 0]
    portrait.plot(x[1:], v, color=color, lw=1.2, label=name)
    course.plot(run.times[first : last + 1], x, color=color, lw=1.2)
style.dress(portrait, "x (mm)", "velocity (mm/s)", title="to and fro")
style.dress(course, "", "x (mm)", title="twice as fast from 5 s on")
for name, recorded, color in (("hand", hand, gray), ("run", run, blue)):
    slip.plot(recorded.times[1:], 1e3 * slips[name], color=color, lw=1.0)
slip.set_xlim(course.get_xlim())
style.dress(slip, "time (s)", "slip (mm/s)", title="sideways: hand (gray), run (blue)")
portrait.legend(fontsize=style.SMALL_FONT_SIZE, frameon=False, loc="lower right")
style.write_title(
    figure,
    f"A saw that is entered, sped up and left without a jump: slip at most "
    f"{style.number(float(np.abs(slips['run']).max()))} m/s",
)
save_figure(figure, out)
