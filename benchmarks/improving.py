"""A cut improved on an arm: joints that turn less fast, by trials whose blade never slips.

``python -m benchmarks.improving --out improving.png`` takes some minutes.  The cost is what the arm
makes of a trial: the largest share of a joint's speed limit, tracked by inverse kinematics in
MuJoCo, and by how much the path leaves the demonstrated one beyond 5 mm.
"""

from __future__ import annotations

import argparse

import numpy as np
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip import robots
from noslip._typing import Floats
from noslip.figures import save_figure, style

NEAR = 5e-3
"""Distance from the demonstrated path (m) up to which leaving it costs nothing."""
PER_METER = 100.0
"""What each meter beyond costs, in shares of a limit: a millimeter as much as a tenth."""
COARSE = 0.02
"""Step of the arm in a trial (s): peaks of the joints' speeds last ten times as long."""


def recording() -> ns.PoseTrajectory:
    """A cut of 24 cm in 4 s along an S; the hand turns the blade only roughly into the path."""
    s = np.linspace(0, 1, 251)
    u = s**3 * (10 - 15 * s + 6 * s**2)
    path = np.column_stack([0.24 * u, 0.05 * np.sin(2 * np.pi * u), 0.01 * np.cos(np.pi * u)])
    yaw = 0.6 * np.cos(2 * np.pi * s) + 0.2 * np.sin(3 * np.pi * s)
    return ns.PoseTrajectory(4 * s, path, Rotation.from_euler("z", yaw), name="hand")


def speeds(arm: robots.Robot, tracked: robots.TrackedMotion) -> Floats:
    """Each joint's share of its speed limit, shape (N, n)."""
    return np.abs(tracked.joint_velocities) / arm.velocity_limits


def main() -> None:
    """Improve the cut, execute it before and after, and draw both."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", default="improving.png", help="the picture's file")
    parser.add_argument("--evaluations", type=int, default=300)
    parser.add_argument("--vary", default="pose")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()

    blade, arm = ns.Blade(), robots.panda()
    dmp = ns.learn(recording(), [blade], basis_functions=50)
    before = robots.track(arm, dmp.rollout(time_step=1e-3), blade)
    demonstrated = dmp.rollout().positions
    placed = {"placement": before.placement, "start": before.joint_positions[0]}
    slips: list[float] = []

    def cost(motion: ns.Motion) -> float:
        slips.append(float(np.abs(motion.constraint_residuals).max()))
        try:
            tracked = robots.track(arm, motion, blade, time_step=COARSE, **placed)
        except robots.InfeasibleMotionError:
            return np.inf
        off = float(np.linalg.norm(motion.positions - demonstrated, axis=1).max())
        return float(speeds(arm, tracked).max()) + PER_METER * max(off - NEAR, 0.0)

    improved = ns.improve(
        dmp,
        cost,
        evaluations=given.evaluations,
        vary=given.vary,
        sigma=0.003,
        turn_sigma=np.radians(5.0),
        seed=given.seed,
        progress=lambda done, most: print(f"{done} of {most}", flush=True),
    )
    outcome = improved.history[-1].outcome
    after = robots.track(arm, improved.rollout(time_step=1e-3), blade, **placed)
    off = np.linalg.norm(improved.rollout().positions - demonstrated, axis=1).max()
    for name, tracked in (("demonstrated", before), ("improved", after)):
        done = robots.execute(tracked, noise=1.0, delay=0.001, model_error=0.05)
        print(
            f"{name}: fastest joint {speeds(arm, tracked).max():.1%} of its limit, torques "
            f"{done.torque_share.max():.1%}, tool off by {1e3 * done.errors.position.max():.3f} mm"
        )
    print(
        f"cost {outcome['before']:.4f} to {outcome['after']:.4f}, {outcome['evaluations']} motions"
    )
    print(f"{outcome['refused']} refused; largest slip of any trial {max(slips):.1e} m/s")
    print(f"the path is moved by at most {1e3 * off:.2f} mm")

    figure = style.new_figure(style.TWO_COLUMNS, 2.9)
    found, turning, path = figure.subplots(1, 3)
    found.plot(outcome["least"], color=style.PALETTE["blue"])
    lines = style.line_styles(("demonstrated", "improved"))
    for name, tracked in (("demonstrated", before), ("improved", after)):
        line = lines[name]
        turning.plot(tracked.times, 100 * speeds(arm, tracked).max(axis=1), **line)
        path.plot(*1e3 * tracked.placement.undo(tracked.executed).positions[:, :2].T, **line)
    path.set_aspect("equal", adjustable="datalim")
    style.dress(found, "generation", "least cost", title="search")
    style.dress(turning, "time (s)", "share of its limit (%)", title="the fastest joint")
    style.dress(path, "x (mm)", "y (mm)", title="the path, from above")
    style.name_lines(figure, lines)
    fast, slow = (100 * float(speeds(arm, tracked).max()) for tracked in (before, after))
    style.write_title(
        figure,
        f"{outcome['evaluations']} trials without slip: the fastest joint needs {slow:.0f} % of "
        f"its limit, not {fast:.0f} %",
    )
    save_figure(figure, given.out)


if __name__ == "__main__":
    main()
