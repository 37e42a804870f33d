"""The formula evaluated once a step, beside steps whose next state is on the constraint."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.ticker import NullFormatter
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.constraints.system import ConstraintSystem
from noslip.figures import style
from noslip.projection.pointwise import gauss_acceleration

# A blade that is turned to and fro, and driven by a force that pushes it aside.
DURATION = 1.0
STEPS = (125, 250, 500, 1000, 2000)
blade = ConstraintSystem([ns.Blade()])


def yaw(t: np.ndarray) -> np.ndarray:
    return 0.8 * np.sin(2 * np.pi * t)


def yaw_rate(t: float) -> float:
    return 0.8 * 2 * np.pi * np.cos(2 * np.pi * t)


def published(steps: int) -> np.ndarray:
    """Slip after each step of the semi-implicit method, the acceleration on the constraint."""
    dt = DURATION / steps
    t = np.arange(steps + 1) * dt
    rotations = Rotation.from_euler("z", yaw(t))
    quaternions, lateral = rotations.as_quat(scalar_first=True), rotations.apply([0, 1, 0])
    position, velocity, slips = np.zeros(3), np.array([0.1, 0, 0]), []
    for k in range(steps):
        pull = np.array([0.2 * np.cos(3 * t[k]), 0.3 * np.sin(5 * t[k]), 0, 0, 0, 0])
        spin = [0, 0, yaw_rate(t[k])]
        A, b = blade.acceleration_form(t[k], position, quaternions[k], velocity, spin)
        velocity = velocity + dt * gauss_acceleration(pull, A, b)[:3]
        position = position + dt * velocity
        slips.append(abs(lateral[k + 1] @ velocity))
    return np.array(slips)


def exact(steps: int) -> np.ndarray:
    """Slip of noslip's steps, on a motion with the same turns."""
    t = np.linspace(0, DURATION, 1001)
    path = np.column_stack([0.1 * t, 0.02 * np.sin(np.pi * t) ** 2, 0 * t])
    hand = ns.PoseTrajectory(t, path, Rotation.from_euler("z", yaw(t)))
    dmp = ns.learn(hand, ns.Blade()).constrained
    return np.abs(dmp.rollout(time_step=DURATION / steps).constraint_residuals[1:, 0])


figure, (course, order) = plt.subplots(1, 2, figsize=(8.5, 3.0), layout="constrained")
for name, slip, line in (
    (
        "acceleration on the constraint",
        published,
        {"color": style.PALETTE["vermillion"], "ls": "--"},
    ),
    ("next state on the constraint", exact, {"color": "k"}),
):
    over_time = slip(1000)
    course.semilogy(np.linspace(0, DURATION, len(over_time)), np.maximum(over_time, 1e-19), **line)
    peaks = [slip(n).max() for n in STEPS]
    order.loglog([DURATION / n for n in STEPS], peaks, **line, marker="o", ms=4, label=name)
h = np.array([DURATION / STEPS[-1], DURATION / STEPS[0]])
order.loglog(h, 3 * h, color="0.6", lw=0.8, label="slope 1")
order.xaxis.set_minor_formatter(NullFormatter())
figure.legend(loc="outside lower center", ncols=3, fontsize=8)
style.dress(course, "time (s)", "slip (m/s)", title="steps of 1 ms: the drift")
style.dress(order, "step (s)", "largest slip (m/s)", title="the order of the error")
