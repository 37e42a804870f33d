"""The formula evaluated once a step, beside steps whose middle is on the constraint."""

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.ticker import NullFormatter
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.constraints.system import ConstraintSystem
from noslip.figures import style
from noslip.law.step import StepSymbols
from noslip.projection.pointwise import coupling, gauss_acceleration

# A blade that is turned to and fro, and driven by a force that pushes it aside.
DURATION = 1.0
STEPS = (125, 250, 500, 1000, 2000)
# A knife edge on a slope, in the slope's plane: pulled along x (m/s^2), turning evenly (rad/s).
PULL, SPEED, TURNING, SLIDE = 9.81 * np.sin(0.5), 0.3, 2.0, 5.0
SLIDE_STEPS = (250, 500, 1000)
blade = ConstraintSystem([ns.Blade()])


def yaw(t: np.ndarray) -> np.ndarray:
    return 0.8 * np.sin(2 * np.pi * t)


def published(steps: int) -> np.ndarray:
    """Slip of each step of the semi-implicit method, the acceleration on the constraint."""
    h = DURATION / steps
    t = np.arange(steps + 1) * h
    turns = Rotation.from_euler("z", yaw(t))
    lateral = Rotation.from_euler("z", (yaw(t[1:]) + yaw(t[:-1])) / 2).apply([0, 1, 0])
    position, velocity, slips = np.zeros(3), np.array([0.1, 0, 0]), []
    for k in range(steps):
        pull = np.array([0.2 * np.cos(3 * t[k]), 0.3 * np.sin(5 * t[k]), 0, 0, 0, 0])
        spin = [0, 0, 0.8 * 2 * np.pi * np.cos(2 * np.pi * t[k])]
        A, b = blade.acceleration_form(
            t[k], position, turns[k].as_quat(scalar_first=True), velocity, spin
        )
        # Half a kick first, to its advantage: its velocities, too, are those of the middles.
        kick = h if k else h / 2
        velocity = velocity + kick * gauss_acceleration(pull, A, b)[:3]
        position = position + h * velocity
        slips.append(abs(lateral[k] @ velocity))
    return np.array(slips)


def exact(steps: int) -> np.ndarray:
    """Slip of noslip's steps, on a motion with the same turns."""
    t = np.linspace(0, DURATION, 1001)
    path = np.column_stack([0.1 * t, 0.02 * np.sin(np.pi * t) ** 2, 0 * t])
    hand = ns.PoseTrajectory(t, path, Rotation.from_euler("z", yaw(t)))
    dmp = ns.learn(hand, ns.Blade()).constrained
    return np.abs(dmp.rollout(time_step=DURATION / steps).constraint_residuals[1:, 0])


def knife_edge(t: np.ndarray) -> np.ndarray:
    """Where the knife edge is: a cycloid across the slope, in closed form."""
    th, w = TURNING * t, TURNING
    x = SPEED / w * np.sin(th) + PULL / (2 * w**2) * np.sin(th) ** 2
    y = SPEED / w * (1 - np.cos(th)) + PULL / (2 * w**2) * (th - np.sin(th) * np.cos(th))
    return np.column_stack([x, y])


def middle_step() -> ca.Function:
    """One of noslip's steps, pulled along x: (state, turn, h, kick, previous h) -> velocity."""
    parts = [ca.SX.sym(name, n) for name, n in (("p", 3), ("q", 4), ("v", 3), ("w", 3))]
    h, kick, previous = (ca.SX.sym(name) for name in ("h", "kick", "previous"))
    rates = [ca.SX(0)] * 3
    # The blade's residual of the step before is 0.
    symbols = StepSymbols(*parts, ca.SX.zeros(1), h, kick, previous, ca.SX(0), *rates)
    pulled = parts[2] + kick * ca.DM([PULL, 0, 0])
    held = coupling(blade)(symbols, pulled, parts[3])
    return ca.Function("step", [*parts, h, kick, previous], [held.linear])


def middle(steps: int) -> np.ndarray:
    """Positions of noslip's steps."""
    step, h = middle_step(), SLIDE / steps
    turns = Rotation.from_euler("z", TURNING * h * np.arange(steps)[:, None])
    position, velocity, path = np.zeros(3), np.array([SPEED, 0, 0]), [np.zeros(3)]
    for k, turn in enumerate(turns.as_quat(scalar_first=True)):
        kick, previous = (h, h) if k else (h / 2, 0)
        found = step(position, turn, velocity, [0, 0, TURNING], h, kick, previous)
        velocity = np.array(found)[:, 0]
        position = position + h * velocity
        path.append(position)
    return np.array(path)[:, :2]


def end(steps: int) -> np.ndarray:
    """Positions where the constraint is asked at the end of each step."""
    h = SLIDE / steps
    velocity, path = np.array([SPEED, 0]), [np.zeros(2)]
    for th in TURNING * h * np.arange(1, steps + 1):
        edge = np.array([np.cos(th), np.sin(th)])
        velocity = edge * (edge @ (velocity + [h * PULL, 0]))
        path.append(path[-1] + h * velocity)
    return np.array(path)


def farthest(path: np.ndarray) -> float:
    exactly = knife_edge(np.linspace(0, SLIDE, len(path)))
    return float(np.linalg.norm(path - exactly, axis=1).max())


MIDDLE, END = {"color": "k"}, {"color": style.PALETTE["blue"], "ls": "-."}
AT_ONCE = {"color": style.PALETTE["vermillion"], "ls": "--"}
figure, (course, order, error) = plt.subplots(1, 3, figsize=(10.5, 3.2), layout="constrained")
for name, slip, line in (
    ("acceleration on the constraint", published, AT_ONCE),
    ("middle of the step on the constraint", exact, MIDDLE),
):
    over_time = slip(1000)
    course.semilogy(np.linspace(0, DURATION, len(over_time)), np.maximum(over_time, 1e-19), **line)
    peaks = [slip(n).max() for n in STEPS]
    order.loglog([1e3 * DURATION / n for n in STEPS], peaks, **line, marker="o", ms=4, label=name)
h = np.array([DURATION / STEPS[-1], DURATION / STEPS[0]])
order.loglog(1e3 * h, 0.3 * h, color="0.6", lw=0.8)
h = SLIDE / np.array(SLIDE_STEPS)
for name, path, line in (
    ("end of the step on the constraint", end, END),
    (None, middle, MIDDLE),
):
    errors = [farthest(path(n)) for n in SLIDE_STEPS]
    error.loglog(1e3 * h, errors, **line, marker="o", ms=4, label=name)
error.loglog(1e3 * h, 30 * h, color="0.6", lw=0.8, label="slope 1")
error.loglog(1e3 * h, 8 * h**2, color="0.6", lw=0.8, ls=":", label="slope 2")
for ax, steps in ((order, [1e3 * DURATION / n for n in STEPS]), (error, 1e3 * h)):
    ax.set_xticks(steps, [f"{step:g}" for step in steps])
    ax.xaxis.set_minor_formatter(NullFormatter())
figure.legend(loc="outside lower center", ncols=5, fontsize=7, frameon=False)
style.dress(course, "time (s)", "slip (m/s)", title="steps of 1 ms: the acceleration drifts")
style.dress(order, "step (ms)", "largest slip (m/s)", title="its drift grows with the step")
style.dress(
    error, "step (ms)", "farthest off (m)", title="knife edge: the middle is of second order"
)
