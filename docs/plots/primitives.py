"""Phase, basis functions, and what the forcing term adds to the attractor."""

import matplotlib.pyplot as plt
import numpy as np
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.figures import style
from noslip.law.basis import Basis

t = np.linspace(0, 1, 401)
basis = Basis(count=9)
phases = basis.phase.at(t)
goal = t**3 * (10 - 15 * t + 6 * t**2)
height = goal + 0.25 * np.sin(2 * np.pi * t) * np.sin(np.pi * t) ** 2
positions = np.column_stack([goal, height, 0 * t])
demonstration = ns.PoseTrajectory(t, positions, Rotation.from_rotvec(np.zeros((401, 3))))
learned = ns.learn(demonstration)

figure, (clock, motion, turned) = plt.subplots(1, 3, figsize=(9.5, 2.7), layout="constrained")
clock.plot(t, basis.activations(phases), lw=1, color=style.PALETTE["sky"])
clock.plot(t, phases, "k--", lw=1.5, label="phase s")
clock.legend(loc="upper right", fontsize=7)
style.dress(
    clock, "t / τ", "activation of f's weights", title="the clock and nine of its functions"
)

root = learned.law.attractor.alpha / 2
spring = 1 - (1 + root * t) * np.exp(-root * t)
motion.plot(t, height, color="0.7", lw=4, label="demonstrated")
motion.plot(t, learned.rollout().positions[:, 1], "k-", lw=1, label="with the forcing term")
motion.plot(t, spring, "--", color=style.PALETTE["blue"], label="the attractor alone")
motion.legend(loc="lower right", fontsize=7)
style.dress(motion, "t / τ", "y (m)", title="the forcing term makes the motion")

winding = 2.5 * 2 * np.pi * goal
turns = ns.PoseTrajectory(t, positions, Rotation.from_euler("z", winding))
followed = ns.learn(turns).rollout().rotations
angle = np.unwrap(followed.as_euler("xyz")[:, 2])
turned.plot(t, winding / (2 * np.pi), color="0.7", lw=4, label="demonstrated")
turned.plot(t, angle / (2 * np.pi), "k-", lw=1, label="learned")
turned.legend(loc="upper left", fontsize=7)
style.dress(turned, "t / τ", "turns about z", title="turns count on beyond half a turn")
