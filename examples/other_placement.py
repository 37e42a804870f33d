# /// script
# requires-python = ">=3.11"
# dependencies = ["noslip"]
# [tool.uv.sources]
# noslip = { path = ".." }
# ///
"""A cut learned in one placement, adapted to others, beside what a person did there."""

import argparse

import numpy as np

import noslip as ns
from noslip.figures import save_figure, style

FOLDER = "../shared/data/contour_following"
parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--out", default="other_placement.png", help="the picture's file")
parser.add_argument("--recordings", default=FOLDER, help="folder of the contour runs (%(default)s)")
options = parser.parse_args()

# A person led a tool along a rigid contour; it stood elsewhere, and turned, from run to run.
try:
    raw = ns.load_demonstrations(f"{options.recordings}/data_demo_*.csv")
except ns.errors.InputError as error:
    raise SystemExit(f"no recordings to compare with: {error}") from None
runs = {run.name[-7:-4]: ns.prepare(run, trim_speed=0.05, rate=120, lowpass=4.8) for run in raw}
shown = runs.pop("a_1")
blade = ns.Blade()
dmp = ns.learn(shown, [blade])


def moved(run: ns.PoseTrajectory) -> dict[str, ns.PoseTrajectory]:
    """Return what each method makes of the learned motion between a run's first and last pose."""
    ends = {
        "start_position": run.positions[0],
        "start_rotation": run.rotations[0],
        "goal_position": run.positions[-1],
        "goal_rotation": run.rotations[-1],
        "duration": run.duration,
    }
    turned = dmp.adapt(**ends, scaling="rotation-dilation")
    return {
        "unconstrained": dmp.regular.rollout(**ends),
        "unconstrained, path turned": turned.regular.rollout(),
        "adapted": dmp.adapt(**ends).rollout(),
        "adapted, path turned": turned.rollout(),
    }


def figures(m: ns.PoseTrajectory, run: ns.PoseTrajectory) -> list[float]:
    """Rms distance in time and along the way (%), rms angle (°), residual (m/s), speed (rad/s)."""
    in_time = run.resampled(times=run.times[0] + np.clip(m.times, 0, run.duration))
    pair = []
    for k in (m, run):
        way = np.r_[0, np.cumsum(np.linalg.norm(np.diff(k.positions, axis=0), axis=1))]
        pair.append(k.resampled(times=np.interp(np.linspace(0, way[-1], 201), way, k.times)))
    apart = [np.linalg.norm(a.positions - b.positions, axis=1) for a, b in ((m, in_time), pair)]
    angles = np.degrees((pair[0].rotations * pair[1].rotations.inv()).magnitude())
    rms = [np.sqrt(np.mean(x**2)) for x in (*(100 * d / run.path_length for d in apart), angles)]
    speeds = np.linalg.norm(m.angular_velocities, axis=1)
    return [*rms, ns.check(m, blade).constraints[0].peak, speeds.max()]


found = {name: moved(run) for name, run in runs.items()}
methods = list(found["a_2"])
table = np.array([[figures(found[name][k], runs[name]) for name in runs] for k in methods])
print("rms distance over the way, in time and along it; rms angle; largest residual; fastest turn")
for k, rows in zip(methods, table, strict=True):
    for name, row in zip(runs, rows, strict=True):
        line = "{:5.2f} % {:6.2f} % {:5.1f}°   residual {:.0e} m/s {:5.1f} rad/s".format(*row)
        print(f"{name} {k:26} {line}")
motion = found["d_2"]["adapted, path turned"]

figure = style.new_figure(style.TWO_COLUMNS, 3.2)
above, distances, angles = figure.subplots(1, 3, width_ratios=(1.2, 1, 1))
lines = style.line_styles(["demonstration", *methods])
for name, run in runs.items():
    for k, m in {"demonstration": run, **found[name]}.items():
        above.plot(*m.positions[:, :2].T, **lines[k])
for k, rows in zip(methods, table, strict=True):
    distances.semilogy(list(runs), rows[:, 1], marker="o", ms=3, **lines[k])
    angles.plot(list(runs), rows[:, 2], marker="o", ms=3, **lines[k])
above.set_aspect("equal", adjustable="datalim")
style.dress(above, "x (m)", "y (m)", title="from above")
style.dress(distances, "run", "rms distance (% of way)", title="to the person's path")
style.dress(angles, "run", "rms angle (°)", title="to the person's orientation")
style.name_lines(figure, lines)
off = f"{table[-1, :, 1].min():.1f} to {table[-1, :, 1].max():.1f} % of its way"
style.write_title(figure, f"Turned and adapted, the cut is {off} off a person's: no slip")
save_figure(figure, options.out)
