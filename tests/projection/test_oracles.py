"""The pointwise projection as a simulator of constrained mechanical systems, against mechanics.

A free body under external accelerations, moved onto its constraints in each step, is a mechanical
system: Gauss's principle in the metric of its masses.  Closed forms where textbooks have them,
else independent equations of motion (minimal coordinates, Newton-Euler) that SciPy integrates.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import casadi as ca
import mpmath
import numpy as np
import pytest
import sympy as sp
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.integrate import cumulative_simpson, solve_ivp
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation
from scipy.special import ellipk

from noslip import Blade, Constraint, position_constraint, velocity_constraint
from noslip._typing import Floats
from noslip.constraints import ConstraintSystem, Instant
from noslip.law.step import StepSymbols
from noslip.projection.pointwise import POSITION_ONLY, Push, coupling, gauss_acceleration
from noslip.rotations import Expression

Pair = tuple[Expression, Expression]
External = Callable[[StepSymbols], Pair]

G = 9.81
RESIDUAL_RATE = 10.0
IDENTITY = Rotation.identity()

# Constraints' forces act along the rows before the step, so that a step is symmetric in time to
# second order: at position level the steps are Verlet's (SHAKE), with no drift of energies and with
# momenta kept to rounding; at velocity level the middle of the step satisfies the constraint.


# -------------------------------------------------------------------- simulation


@dataclass(frozen=True)
class Start:
    """Pose and velocities that a system begins with."""

    position: Sequence[float] | Floats = (0.0, 0.0, 0.0)
    velocity: Sequence[float] | Floats = (0.0, 0.0, 0.0)
    rotation: Rotation = IDENTITY
    spin: Sequence[float] | Floats = (0.0, 0.0, 0.0)

    @property
    def vector(self) -> Floats:
        quaternion = self.rotation.as_quat(scalar_first=True)
        return np.concatenate([self.position, quaternion, self.velocity, self.spin])


@dataclass(frozen=True)
class Path:
    """What a system did; its velocities are of the middle of the step that led to a sample."""

    times: Floats
    positions: Floats
    rotations: Rotation
    velocities: Floats
    spins: Floats
    multipliers: Floats

    @property
    def sampled_velocities(self) -> Floats:
        """Means of the steps before and after each sample but the first and the last."""
        return (self.velocities[1:-1] + self.velocities[2:]) / 2

    @property
    def sampled_spins(self) -> Floats:
        return (self.spins[1:-1] + self.spins[2:]) / 2


def free(symbols: StepSymbols) -> Pair:
    """No external acceleration."""
    return ca.SX(3, 1), ca.SX(3, 1)


def falling(symbols: StepSymbols) -> Pair:
    return ca.DM([0, 0, -G]), ca.SX(3, 1)


def coupled(
    constraints: Sequence[Constraint],
    metric: Sequence[float],
    push: Push,
    symbols: StepSymbols,
    linear: Expression,
    angular: Expression,
) -> tuple[Expression, Expression, Expression, Expression]:
    """Constrained velocities, residuals, multipliers: the only place that knows the interface."""
    couple = coupling(ConstraintSystem(constraints), inverse_metric=metric, push=push)
    found = couple(symbols, linear, angular)
    return found.linear, found.angular, found.values, found.multipliers


def step_function(
    constraints: Sequence[Constraint],
    metric: Sequence[float],
    external: External,
    push: Push = "force",
) -> ca.Function:
    rows = ConstraintSystem(constraints).size
    state, step = ca.SX.sym("state", 13 + rows), ca.SX.sym("step", 4)
    symbols = StepSymbols(
        position=state[:3],
        quaternion=state[3:7],
        linear_velocity=state[7:10],
        angular_velocity=state[10:13],
        values=state[13:],
        time_step=step[0],
        kick=step[1],
        previous_step=step[2],
        time=step[3],
        residual_rate=ca.SX(RESIDUAL_RATE),
        slip_rate=ca.SX(RESIDUAL_RATE),
        barrier_rate=ca.SX(0),
    )
    linear, angular = external(symbols)
    linear, angular, values, multipliers = coupled(
        constraints,
        metric,
        push,
        symbols,
        symbols.linear_velocity + symbols.kick * linear,
        symbols.angular_velocity + symbols.kick * angular,
    )
    position, quaternion = symbols.advance(linear, angular)
    after = ca.vertcat(position, quaternion / ca.norm_2(quaternion), linear, angular, values)
    outputs = [ca.densify(after), ca.densify(multipliers)]
    return ca.Function("step", [state, step], ca.cse(outputs))


def carried(constraints: Sequence[Constraint], state: Floats) -> Floats:
    """Return a start as steps carry it: with residuals, of no step yet."""
    return np.concatenate([state, np.zeros(ConstraintSystem(constraints).size)])


def simulate(
    constraints: Sequence[Constraint],
    start: Start,
    duration: float,
    steps: int,
    *,
    metric: Sequence[float] = POSITION_ONLY,
    external: External = free,
    push: Push = "force",
) -> Path:
    """Move a body over a duration; every step of it must satisfy the constraints."""
    h = duration / steps
    table = np.empty((4, steps))
    # Half a kick first: velocities lie between samples, positions on them (leapfrog).
    table[0], table[1], table[2] = h, h, h
    table[1, 0], table[2, 0] = h / 2, 0.0
    table[3] = h * np.arange(1, steps + 1)
    function = step_function(constraints, metric, external, push)
    first = carried(constraints, start.vector)
    states, multipliers = (np.array(x).T for x in function.mapaccum(steps)(first, table))
    assert np.abs(states[:, 13:]).max() <= 1e-10
    states = np.vstack([first, states])
    return Path(
        times=h * np.arange(steps + 1),
        positions=states[:, :3],
        rotations=Rotation.from_quat(states[:, 3:7], scalar_first=True),
        velocities=states[:, 7:10],
        spins=states[:, 10:13],
        multipliers=multipliers.reshape(steps, -1),
    )


def masses(mass: float, inertia: float) -> tuple[float, ...]:
    """M^-1 of a body whose moments of inertia are all equal."""
    return (1 / mass,) * 3 + (1 / inertia,) * 3


def converges(
    error: Callable[[int], float], steps: int, *, accuracy: float, order: float = 1.9
) -> None:
    """The error falls with this order as the step is halved twice, to this accuracy at last."""
    errors = np.array([error(steps * 2**k) for k in range(3)])
    orders = -np.diff(np.log2(np.maximum(errors, 1e-16)))
    assert errors[2] <= accuracy, errors
    # What has fallen to rounding falls no more.
    assert np.all((orders >= order) | (errors[1:] <= 1e-10)), (orders, errors)


def farthest(found: Floats, expected: Floats) -> float:
    return float(np.linalg.norm(np.atleast_2d(found - expected), axis=1).max())


def angle_between(a: Rotation, b: Rotation) -> float:
    return float((a * b.inv()).magnitude().max())


def planar(x: Any, y: Any) -> Floats:
    return np.column_stack([x, y, np.zeros_like(x)])


def gudermannian(x: Any) -> Any:
    return 2 * np.arctan(np.tanh(np.asarray(x) / 2))


# -------------------------------------------------------------------- knife edge on a slope


@dataclass(frozen=True)
class KnifeEdge:
    """A blade on an inclined plane that turns at a constant rate: a cycloid across the slope.

    In the plane, with x down the slope, heading ``th = w t`` and speed u along the edge, the
    constraint's force has no part along the edge: ``du/dt = k cos th``, ``k = g sin(slope)``.  So
    ``u = u0 + k/w sin th`` and

        x = u0/w sin th + k/(2 w^2) sin^2 th
        y = u0/w (1 - cos th) + k/(2 w^2) (th - sin th cos th)

    and the force across is ``m (u w + k sin th)`` (Bloch, Nonholonomic Mechanics and Control, 2nd
    ed., section 1.6): the edge does not slide down.
    """

    slope: float = 0.5
    rate: float = 2.0
    speed: float = 0.3

    @property
    def pull(self) -> float:
        return G * np.sin(self.slope)

    @property
    def plane(self) -> Rotation:
        """From the plane's axes (down, across, normal) to the world's."""
        return Rotation.from_euler("y", self.slope)

    @property
    def on_plane(self) -> Constraint:
        normal = ca.DM(self.plane.apply([0, 0, 1]))
        return position_constraint(lambda m: ca.dot(normal, m.position), name="on plane")

    @property
    def start(self) -> Start:
        return Start(
            velocity=self.plane.apply([self.speed, 0, 0]),
            rotation=self.plane,
            spin=self.plane.apply([0, 0, self.rate]),
        )

    def positions(self, t: Floats) -> Floats:
        th, w, k = self.rate * t, self.rate, self.pull
        x = self.speed / w * np.sin(th) + k / (2 * w**2) * np.sin(th) ** 2
        y = self.speed / w * (1 - np.cos(th)) + k / (2 * w**2) * (th - np.sin(th) * np.cos(th))
        return self.plane.apply(planar(x, y))

    def force_across(self, t: Floats) -> Floats:
        """Of a unit mass."""
        th = self.rate * t
        return self.speed * self.rate + 2 * self.pull * np.sin(th)


FREE_KNIFE = masses(0.7, 0.4)


@pytest.mark.parametrize(
    "metric",
    [
        pytest.param(POSITION_ONLY, id="rotation given"),
        pytest.param(FREE_KNIFE, id="free body"),
    ],
)
def test_a_knife_edge_on_a_slope_draws_a_cycloid(metric: Any) -> None:
    knife = KnifeEdge()

    def error(steps: int) -> float:
        path = simulate(
            [Blade(), knife.on_plane], knife.start, 5.0, steps, metric=metric, external=falling
        )
        return farthest(path.positions, knife.positions(path.times))

    converges(error, 1000, accuracy=3e-2)


def test_a_knife_edges_force_turns_no_free_body() -> None:
    knife = KnifeEdge()
    path = simulate(
        [Blade(), knife.on_plane], knife.start, 5.0, 1000, metric=FREE_KNIFE, external=falling
    )
    np.testing.assert_allclose(path.spins, np.tile(knife.start.spin, (1001, 1)), atol=1e-9)


@given(st.floats(0.1, 1.2), st.floats(0.5, 4), st.floats(-1, 1))
@settings(max_examples=5)
def test_knife_edges_on_any_slope_draw_cycloids(slope: float, rate: float, speed: float) -> None:
    knife = KnifeEdge(slope, rate, speed)
    duration = 2 * np.pi / rate

    def error(steps: int) -> float:
        path = simulate([Blade(), knife.on_plane], knife.start, duration, steps, external=falling)
        return farthest(path.positions, knife.positions(path.times))

    converges(error, 500, accuracy=5e-3 * (abs(speed) + knife.pull / rate) * duration)


def test_the_knife_edges_multiplier_is_the_force_across_even_where_it_stops() -> None:
    # From rest, and at rest again at each half turn; no step of it jumps.
    knife = KnifeEdge(speed=0.0)

    def error(steps: int) -> float:
        path = simulate([Blade(), knife.on_plane], knife.start, 5.0, steps, external=falling)
        t = path.times[1:-1]
        found = path.multipliers[1:]
        assert np.abs(np.diff(found, axis=0)).max() < 3 * knife.pull * knife.rate * 5.0 / steps
        normal = G * np.cos(knife.slope)
        expected = np.column_stack([knife.force_across(t), np.full_like(t, normal)])
        return farthest(found, expected) / G

    converges(error, 1000, accuracy=1e-9)


# -------------------------------------------------------------------- Chaplygin's sleigh


@dataclass(frozen=True)
class Sleigh:
    """A body on ice with a blade at distance a behind its center of mass.

    The blade's point moves at u along the blade, the center of mass at ``u x + a w y``.  Newton's
    equations with a force f across, at the blade: ``du/dt = a w^2``, ``f = m (u w + a dw/dt)`` and
    ``I dw/dt = -a f``, hence ``dw/dt = -m a u w / J`` with ``J = I + m a^2``.  With
    ``U^2 = u^2 + J w^2 / m`` (energy) and ``k = m a U / J``,

        u = U tanh(k t),   w = sqrt(m/J) U sech(k t),   heading = sqrt(J/m)/a gd(k t)

    (Neimark and Fufaev, Dynamics of Nonholonomic Systems, chapter II; Bloch, section 1.7): it ends
    with the center of mass ahead, however it starts.
    """

    mass: float = 1.3
    inertia: float = 0.2
    arm: float = 0.4
    top_speed: float = 0.8
    begin: float = -1.2

    @property
    def J(self) -> float:
        return self.inertia + self.mass * self.arm**2

    @property
    def rate(self) -> float:
        return self.mass * self.arm * self.top_speed / self.J

    @property
    def blade(self) -> Constraint:
        def residual(motion: Instant) -> Any:
            return ca.dot(motion.rotation[:, 1], motion.at((-self.arm, 0, 0)).linear_velocity)

        return velocity_constraint(residual, name="sleigh")

    def speed(self, t: Any) -> Any:
        return self.top_speed * np.tanh(self.rate * (t + self.begin))

    def spin(self, t: Any) -> Any:
        return np.sqrt(self.mass / self.J) * self.top_speed / np.cosh(self.rate * (t + self.begin))

    def heading(self, t: Any) -> Any:
        return np.sqrt(self.J / self.mass) / self.arm * gudermannian(self.rate * (t + self.begin))

    def force(self, t: Any) -> Any:
        return self.mass * self.inertia / self.J * self.speed(t) * self.spin(t)

    def positions(self, t: Floats) -> Floats:
        """Of the center of mass; the blade begins at the origin."""
        fine = np.linspace(0, t[-1], 20 * (len(t) - 1) + 1)
        heading = self.heading(fine)
        forward = planar(np.cos(heading), np.sin(heading))
        along = self.speed(fine)[:, None] * forward
        blade = cumulative_simpson(along, x=fine, axis=0, initial=0)
        return (blade + self.arm * forward)[::20]

    @property
    def start(self) -> Start:
        spin, turn = self.spin(0.0), Rotation.from_euler("z", self.heading(0.0))
        x, y, _ = turn.as_matrix().T
        return Start(
            position=self.arm * x,
            velocity=self.speed(0.0) * x + self.arm * spin * y,
            rotation=turn,
            spin=[0, 0, spin],
        )

    def run(self, steps: int, duration: float = 4.0) -> Path:
        return simulate(
            [self.blade], self.start, duration, steps, metric=masses(self.mass, self.inertia)
        )


def test_chaplygins_sleigh_moves_as_in_closed_form() -> None:
    sleigh = Sleigh()

    def error(steps: int) -> float:
        path = sleigh.run(steps)
        turns = Rotation.from_euler("z", sleigh.heading(path.times)[:, None])
        return max(
            farthest(path.positions, sleigh.positions(path.times)),
            angle_between(path.rotations, turns),
        )

    converges(error, 1000, accuracy=5e-3)


def test_chaplygins_sleigh_turns_round_and_keeps_its_energy() -> None:
    sleigh = Sleigh()

    def error(steps: int) -> float:
        path = sleigh.run(steps)
        energies = sleigh.mass * np.sum(path.velocities**2, axis=1)
        energies += sleigh.inertia * np.sum(path.spins**2, axis=1)
        return float(np.ptp(energies) / energies[0])

    converges(error, 1000, accuracy=5e-3)
    path = sleigh.run(1000, duration=8.0)
    along = np.sum(path.rotations.apply([1, 0, 0]) * path.velocities, axis=1)
    assert along[0] < -0.5
    assert along[-1] == pytest.approx(sleigh.top_speed, rel=1e-2)


@given(st.floats(0.5, 2), st.floats(0.2, 1), st.floats(0.2, 0.7), st.floats(0.3, 2))
@settings(max_examples=5)
def test_the_sleighs_speeds_and_force_follow_sech_and_tanh(
    mass: float, inertia: float, arm: float, top_speed: float
) -> None:
    sleigh = Sleigh(mass, inertia, arm, top_speed)
    sleigh = Sleigh(mass, inertia, arm, top_speed, begin=-1 / sleigh.rate)
    duration = 3 / sleigh.rate
    largest = sleigh.spin(-sleigh.begin)

    def error(steps: int) -> float:
        path = sleigh.run(steps, duration)
        t = path.times[1:-1]
        spin = np.abs(path.sampled_spins[:, 2] - sleigh.spin(t)).max()
        force = np.abs(path.multipliers[1:, 0] - sleigh.force(t)).max()
        return float(spin / largest + force / (mass * top_speed * largest))

    converges(error, 500, accuracy=3e-2)


# -------------------------------------------------------------------- rolling disc

RADIUS = 0.5


def arm_to_contact(axle: Any) -> Any:
    """From the disc's center to its lowest point."""
    uphill = ca.DM([0, 0, 1]) - axle[2] * axle
    return -RADIUS * uphill / ca.norm_2(uphill)


@velocity_constraint
def rolling(motion: Instant) -> Any:
    """The point of contact rests: no slip along or across, and none through the ground."""
    arm = arm_to_contact(motion.rotation[:, 1])
    return motion.linear_velocity + ca.cross(motion.angular_velocity, arm)


@position_constraint
def upright(motion: Instant) -> Any:
    return motion.rotation[2, 1]


DISC = masses(2.0, 0.15)


def test_an_upright_disc_rolls_in_a_circle() -> None:
    """Spin s and yaw rate w stay as they are: a circle of radius r s / w."""
    spin, yaw = 3.0, 1.1
    start = Start(velocity=[RADIUS * spin, 0, 0], spin=[0, spin, yaw])
    circle = RADIUS * spin / yaw

    def error(steps: int) -> float:
        path = simulate([rolling, upright], start, 4.0, steps, metric=DISC, external=falling)
        t = path.times
        where = circle * planar(np.sin(yaw * t), 1 - np.cos(yaw * t))
        turns = Rotation.from_euler("ZY", np.column_stack([yaw * t, spin * t]))
        return max(farthest(path.positions, where), angle_between(path.rotations, turns))

    converges(error, 1000, accuracy=1e-5)


def tilted_disc() -> Callable[[float, Floats], Floats]:
    """Newton-Euler without multipliers; the state is (center, axle, angular velocity).

    The contact force ``F = m (a + g z)`` turns a disc of isotropic inertia I by
    ``I dw/dt = c x F``, with c the arm to the contact.  Rolling, ``v = -w x c``, gives the
    acceleration ``a = -dw/dt x c - w x dc/dt``: a linear system for ``dw/dt``.
    """
    n, w, rate = (sp.Matrix(sp.symbols(f"{name}:3")) for name in ("n", "w", "r"))
    z = sp.Matrix([0, 0, 1])
    uphill = z - n[2] * n
    arm = -sp.Float(RADIUS) * uphill / sp.sqrt(uphill.dot(uphill))
    axle_rate = w.cross(n)
    arm_rate = arm.jacobian(n) * axle_rate
    mass, inertia = 1 / sp.Float(DISC[0]), 1 / sp.Float(DISC[3])
    acceleration = -rate.cross(arm) - w.cross(arm_rate)
    balance = inertia * rate - arm.cross(mass * (acceleration + G * z))
    matrix = balance.jacobian(rate)
    right = -balance.subs(dict.fromkeys(rate, 0))
    compiled = sp.lambdify([list(n), list(w)], [matrix, right, axle_rate, -w.cross(arm)], cse=True)

    def motion(t: float, state: Floats) -> Floats:
        matrix, right, axle_rate, velocity = compiled(state[3:6], state[6:9])
        found = np.linalg.solve(matrix, right)
        return np.concatenate([velocity, axle_rate, found]).ravel()

    return motion


def tilted_start(lean: float = 0.2, spin: float = 6.0, yaw: float = 0.5) -> Start:
    turn = Rotation.from_euler("x", lean)
    angular = spin * turn.apply([0, 1, 0]) + np.array([0.1, 0, yaw])
    arm = -RADIUS * turn.apply([0, 0, 1])
    return Start(velocity=-np.cross(angular, arm), rotation=turn, spin=angular)


def test_a_tilted_disc_rolls_as_newton_and_euler_say() -> None:
    start, motion = tilted_start(), tilted_disc()
    axle = start.rotation.apply([0, 1, 0])
    exact = solve_ivp(
        motion,
        (0, 2),
        np.concatenate([start.position, axle, start.spin]),
        method="DOP853",
        rtol=1e-11,
        atol=1e-12,
        dense_output=True,
    ).sol

    def error(steps: int) -> float:
        path = simulate([rolling], start, 1.5, steps, metric=DISC, external=falling)
        expected = exact(path.times).T
        axles = path.rotations.apply([0, 1, 0])
        return farthest(np.hstack([path.positions, axles]), expected[:, :6])

    converges(error, 1000, accuracy=1e-3)


def test_a_disc_that_nearly_falls_flat_keeps_rolling() -> None:
    # Up to 77 degrees from upright; each step must hold the constraint.
    start = tilted_start(lean=0.4, spin=3.0)
    path = simulate([rolling], start, 2.0, 1000, metric=DISC, external=falling)
    assert np.abs(path.rotations.apply([0, 1, 0])[:, 2]).max() < 0.99


# -------------------------------------------------------------------- bead on a sphere

SPHERE = 1.5


@position_constraint
def on_sphere(motion: Instant) -> Any:
    return ca.norm_2(motion.position) - SPHERE


def great_circle_error(speed: float, duration: float, direction: Rotation) -> Any:
    x, y, _ = direction.as_matrix().T
    start = Start(position=SPHERE * x, velocity=speed * y)

    def error(steps: int) -> float:
        path = simulate([on_sphere], start, duration, steps)
        turn = speed / SPHERE * path.times[:, None]
        return farthest(path.positions, SPHERE * (np.cos(turn) * x + np.sin(turn) * y))

    return error


@given(st.floats(0.2, 3), st.integers(0, 2**32 - 1))
@settings(max_examples=5)
def test_a_free_bead_on_a_sphere_follows_a_great_circle(speed: float, seed: int) -> None:
    error = great_circle_error(speed, 4 / speed, Rotation.random(random_state=seed))
    converges(error, 500, accuracy=1e-5)


def test_a_free_bead_on_a_sphere_keeps_its_speed() -> None:
    path = simulate([on_sphere], Start([SPHERE, 0, 0], [0, 1, 0]), 10.0, 1000)
    speeds = np.linalg.norm(path.velocities[1:], axis=1)
    np.testing.assert_allclose(speeds, speeds[0], rtol=1e-9)


def spherical_pendulum() -> Any:
    """Polar angle from the top and azimuth: ``th'' = ph'^2 sin th cos th + (g/r) sin th``."""

    def motion(t: float, state: Floats) -> list[float]:
        th, _, th_rate, ph_rate = state
        return [
            th_rate,
            ph_rate,
            ph_rate**2 * np.sin(th) * np.cos(th) + G / SPHERE * np.sin(th),
            -2 * th_rate * ph_rate / np.tan(th),
        ]

    th0, rates = 2.0, (0.4, 1.8)
    solution = solve_ivp(
        motion, (0, 4), [th0, 0.0, *rates], method="DOP853", rtol=1e-11, atol=1e-12, dense_output=1
    ).sol

    def positions(t: Floats) -> Floats:
        th, ph = solution(t)[:2]
        return SPHERE * np.column_stack(
            [np.sin(th) * np.cos(ph), np.sin(th) * np.sin(ph), np.cos(th)]
        )

    velocity = SPHERE * np.array(
        [rates[0] * np.cos(th0), rates[1] * np.sin(th0), -rates[0] * np.sin(th0)]
    )
    return Start(position=positions(np.zeros(1))[0], velocity=velocity), positions


def test_a_bead_on_a_sphere_swings_as_a_spherical_pendulum() -> None:
    start, positions = spherical_pendulum()

    def error(steps: int) -> float:
        path = simulate([on_sphere], start, 4.0, steps, external=falling)
        return farthest(path.positions, positions(path.times))

    converges(error, 1000, accuracy=1e-3)


def momentum_about_the_vertical(path: Path) -> Floats:
    return np.cross(path.positions[1:], path.velocities[1:])[:, 2]


def test_a_swinging_beads_momentum_about_the_vertical_is_conserved() -> None:
    start, _ = spherical_pendulum()
    path = simulate([on_sphere], start, 4.0, 1000, external=falling)
    about = momentum_about_the_vertical(path)
    np.testing.assert_allclose(about, about[0], rtol=1e-9)


# -------------------------------------------------------------------- pendulum


@position_constraint
def rod(motion: Instant) -> Any:
    return ca.norm_2(motion.position) - 1


def pendulum(amplitude: float, periods: float, steps: int) -> Path:
    start = Start([np.sin(amplitude), 0, -np.cos(amplitude)])
    return simulate([rod], start, periods * period(amplitude), steps, external=falling)


def period(amplitude: float) -> float:
    """Of a rod of 1 m: ``4 sqrt(l/g) K(sin^2(amplitude/2))``, K the complete elliptic integral."""
    return float(4 / np.sqrt(G) * ellipk(np.sin(amplitude / 2) ** 2))


def period_error(amplitude: float) -> Callable[[int], float]:
    def error(steps: int) -> float:
        path = pendulum(amplitude, 2.0, steps)
        crossings = CubicSpline(path.times, path.positions[:, 0]).roots(extrapolate=False)
        return float(abs(crossings[2] - crossings[0] - period(amplitude)))

    return error


def energies(path: Path) -> Floats:
    """Per unit mass, of all samples but the first and the last."""
    return np.sum(path.sampled_velocities**2, axis=1) / 2 + G * path.positions[1:-1, 2]


@given(st.floats(0.3, 1.5))
@settings(max_examples=5)
def test_a_pendulums_period_is_an_elliptic_integral(amplitude: float) -> None:
    converges(period_error(amplitude), 500, accuracy=5e-5)


def test_a_pendulums_energy_stays_over_many_periods() -> None:
    found = energies(pendulum(1.0, 20.0, 8000))
    swing = G * (1 - np.cos(1.0))
    assert np.ptp(found) <= 1e-3 * swing
    # Bounded, not drifting: the last periods are like the first.
    first, last = found[:1600], found[-1600:]
    assert abs(first.mean() - last.mean()) <= 1e-5 * swing


# -------------------------------------------------------------------- rolling balls


@dataclass(frozen=True)
class Ball:
    """A homogeneous ball: of moment of inertia ``2/5 m r^2``, whose center is its position."""

    mass: float = 0.8
    radius: float = 0.3

    @property
    def inertia(self) -> float:
        return 2 / 5 * self.mass * self.radius**2

    @property
    def metric(self) -> tuple[float, ...]:
        return masses(self.mass, self.inertia)

    def spin(self, slip: Floats, normal: Floats, about: float) -> Floats:
        """Spin under which the point at ``r normal`` rests, so that ``slip + w x r normal = 0``."""
        return np.cross(slip, normal) / self.radius + about * normal


def test_a_ball_on_a_turntable_goes_round_at_two_sevenths_of_its_rate() -> None:
    """``dv/dt = 2/7 W z x v``: a circle anywhere on the table, however the ball begins.

    The table's point below the center p moves at ``W z x p``; rolling, ``v - r w x z = W z x p``,
    and ``I dw/dt = -r z x m dv/dt`` (Earnshaw 1844; Neimark and Fufaev, chapter II).
    """
    ball, table = Ball(), 3.0
    up = np.array([0, 0, 1.0])

    @velocity_constraint
    def on_the_turntable(motion: Instant) -> Any:
        z = ca.DM(up)
        contact = motion.linear_velocity - ball.radius * ca.cross(motion.angular_velocity, z)
        return contact - table * ca.cross(z, motion.position)

    position, velocity = np.array([0.4, -0.1, 0]), np.array([0.3, 0.5, 0])
    spin = ball.spin(velocity - table * np.cross(up, position), -up, about=0.6)
    start = Start(position=position, velocity=velocity, spin=spin)
    rate = 2 / 7 * table

    def error(steps: int) -> float:
        path = simulate([on_the_turntable], start, 8.0, steps, metric=ball.metric, external=falling)
        turn = rate * path.times[:, None]
        moved = np.sin(turn) * velocity + (1 - np.cos(turn)) * np.cross(up, velocity)
        return farthest(path.positions, position + moved / rate)

    converges(error, 500, accuracy=1e-4)


@dataclass(frozen=True)
class BallInCylinder:
    """A ball that rolls inside a vertical cylinder: it does not fall, it oscillates.

    Its center, at distance d of the axis, goes round at a constant rate W.  With e outward,
    ``v + w x r e = 0`` and ``I dw/dt = r e x F`` give ``d(w e)/dt = W v_z / r`` and ``dv_z/dt =
    -2/7 W r (w e) - 5/7 g``: vertical oscillations of the frequency ``sqrt(2/7) W`` (Neimark and
    Fufaev, chapter II; Gualtieri et al., Am. J. Phys. 74, 2006, "Golfer's dilemma").
    """

    ball: Ball = Ball()
    distance: float = 0.9
    rate: float = 2.5
    climbing: float = 0.4
    about: float = -3.0
    """Spin about the outward normal at the start."""

    @property
    def rolling(self) -> Constraint:
        def residual(motion: Instant) -> Any:
            across = ca.vertcat(motion.position[:2], 0)
            arm = self.ball.radius * across / ca.norm_2(across)
            return motion.linear_velocity + ca.cross(motion.angular_velocity, arm)

        return velocity_constraint(residual, name="in cylinder")

    @property
    def start(self) -> Start:
        velocity = np.array([0, self.distance * self.rate, self.climbing])
        outward = np.array([1.0, 0, 0])
        spin = self.ball.spin(velocity, outward, self.about)
        return Start(position=self.distance * outward, velocity=velocity, spin=spin)

    def positions(self, t: Floats) -> Floats:
        turn, frequency = self.rate * t, np.sqrt(2 / 7) * self.rate
        pull = -2 / 7 * self.rate * self.ball.radius * self.about - 5 / 7 * G
        height = self.climbing / frequency * np.sin(frequency * t)
        height += pull / frequency**2 * (1 - np.cos(frequency * t))
        d = self.distance
        return np.column_stack([d * np.cos(turn), d * np.sin(turn), height])

    def run(self, steps: int) -> Path:
        return simulate(
            [self.rolling], self.start, 6.0, steps, metric=self.ball.metric, external=falling
        )


def test_a_ball_in_a_vertical_cylinder_oscillates() -> None:
    cylinder = BallInCylinder()

    def error(steps: int) -> float:
        path = cylinder.run(steps)
        return farthest(path.positions, cylinder.positions(path.times))

    converges(error, 1000, accuracy=1e-3)


def test_a_ball_in_a_vertical_cylinder_keeps_its_energy() -> None:
    cylinder = BallInCylinder()

    def error(steps: int) -> float:
        path = cylinder.run(steps)
        spinning = cylinder.ball.inertia / cylinder.ball.mass
        found = energies(path) + spinning * np.sum(path.sampled_spins**2, axis=1) / 2
        return float(np.ptp(found) / found[0])

    converges(error, 1000, accuracy=1e-4)


# -------------------------------------------------------------------- what moves by itself


def test_a_bead_on_a_heaving_slope_slides_down_it_at_a_constant_acceleration() -> None:
    """Without friction the plane's motion along its normal n leaves the rest alone.

    ``n p = A sin(w t)``, the acceleration in the plane is gravity's, the force on a unit mass
    ``n (g_n - A w^2 sin(w t))``; leapfrog has no error under a constant acceleration.
    """
    amplitude, rate, slope = 0.2, 3.0, Rotation.from_euler("ZY", [0.3, 0.4])
    down, across, normal = slope.as_matrix().T

    @position_constraint
    def heaving(motion: Instant) -> Any:
        heave = amplitude * ca.sin(rate * motion.time)
        return ca.dot(ca.DM(normal), motion.position) - heave

    start = Start(velocity=0.3 * across - 0.5 * down + amplitude * rate * normal)

    def force_error(steps: int) -> float:
        path = simulate([heaving], start, 3.0, steps, external=falling)
        t = path.times[:, None]
        fall = -G * down[2] * t**2 / 2
        along = (fall - 0.5 * t) * down + 0.3 * t * across
        expected = along + amplitude * np.sin(rate * t) * normal
        assert farthest(path.positions, expected) < 1e-10
        force = G * normal[2] - amplitude * rate**2 * np.sin(rate * path.times[1:-1])
        return float(np.abs(path.multipliers[1:, 0] - force).max())

    converges(force_error, 500, accuracy=1e-4)


def test_a_conveyor_carries_a_bead_at_its_own_speed() -> None:
    """``v_x = V(t)``; along y the bead is free and falls."""

    @velocity_constraint
    def carried(motion: Instant) -> Any:
        return motion.linear_velocity[0] - 0.5 - 0.3 * ca.sin(2 * motion.time)

    start = Start(velocity=[0.5, 0.2, 0])

    def error(steps: int) -> float:
        path = simulate([carried], start, 3.0, steps, external=falling)
        t = path.times
        x = 0.5 * t + 0.15 * (1 - np.cos(2 * t))
        expected = np.column_stack([x, 0.2 * t, -G * t**2 / 2])
        middles = (t[1:] + t[:-1]) / 2
        np.testing.assert_allclose(
            path.velocities[1:, 0], 0.5 + 0.3 * np.sin(2 * middles), atol=1e-12
        )
        # The force is the belt's acceleration.
        force = np.abs(path.multipliers[1:, 0] - 0.6 * np.cos(2 * t[1:-1])).max()
        return max(farthest(path.positions, expected), float(force))

    converges(error, 500, accuracy=2e-3)


def test_a_blade_on_a_belt_that_speeds_up_falls_back_like_one_on_a_slope() -> None:
    """On a belt with acceleration c, d'Alembert's force is a slope's gravity of -c."""
    belt, push, rate, speed = 0.3, 0.7, 2.0, 0.4

    @velocity_constraint
    def no_slip_on_the_belt(motion: Instant) -> Any:
        moving = ca.vertcat(belt + push * motion.time, 0, 0)
        return ca.dot(motion.rotation[:, 1], motion.linear_velocity - moving)

    knife = KnifeEdge(slope=-np.arcsin(push / G), rate=rate, speed=speed)
    start = Start(velocity=[belt + speed, 0, 0], spin=[0, 0, rate])

    def error(steps: int) -> float:
        path = simulate([no_slip_on_the_belt], start, 4.0, steps)
        t = path.times
        on_belt = knife.plane.apply(knife.positions(t), inverse=True)
        return farthest(path.positions, on_belt + planar(belt * t + push * t**2 / 2, 0 * t))

    converges(error, 500, accuracy=1e-2)


@pytest.mark.parametrize("rate", [2.0, 4.5])
def test_a_bead_on_a_rotating_hoop_moves_as_in_its_one_coordinate(rate: float) -> None:
    """``th'' = sin th (W^2 cos th - g/r)``, th from the bottom of a hoop that turns about z at W.

    Of the two rates one is below and one above ``sqrt(g/r)``, where the bottom is left.
    """
    r, th0, th_rate = 0.7, 0.5, 0.8

    @position_constraint
    def on_the_hoop(motion: Instant) -> Any:
        turn, p = rate * motion.time, motion.position
        across = ca.cos(turn) * p[1] - ca.sin(turn) * p[0]
        return ca.vertcat(ca.norm_2(p) - r, across)

    exact = solve_ivp(
        lambda t, y: [y[1], np.sin(y[0]) * (rate**2 * np.cos(y[0]) - G / r)],
        (0, 4),
        [th0, th_rate],
        method="DOP853",
        rtol=1e-12,
        atol=1e-12,
        dense_output=True,
    ).sol
    start = Start(
        position=[r * np.sin(th0), 0, -r * np.cos(th0)],
        velocity=r * np.array([th_rate * np.cos(th0), rate * np.sin(th0), th_rate * np.sin(th0)]),
    )

    def error(steps: int) -> float:
        path = simulate([on_the_hoop], start, 4.0, steps, external=falling)
        th, turn = exact(path.times)[0], rate * path.times
        out = np.sin(th)
        expected = np.column_stack([out * np.cos(turn), out * np.sin(turn), -np.cos(th)])
        return farthest(path.positions, r * expected)

    converges(error, 1000, accuracy=1e-3)


def by_area(velocity: Expression, sight: Expression) -> Expression:
    return ca.cross(velocity, sight)[2]


def by_sine(velocity: Expression, sight: Expression) -> Expression:
    return ca.cross(velocity, sight)[2] / ca.norm_2(velocity) / ca.norm_2(sight)


@pytest.mark.parametrize("across", [by_area, by_sine])
def test_a_hunter_that_always_heads_for_its_prey_draws_the_pursuit_curve(across: Any) -> None:
    """Bouguer's curve (1732): the prey leaves (a, 0) along y, k times as fast as the hunter.

    The force is across the hunter's velocity, so that it keeps its speed V.  With ``u = 1 - x/a``
    the way is at a slope of ``(u^-k - u^k) / 2``; its integral is y, and that of its secant the
    length V t.  The rule moves with time and, as a sine, is not linear in the velocities.
    """
    a, speed, k = 1.2, 0.9, 0.6

    @velocity_constraint
    def heading_for_the_prey(motion: Instant) -> Any:
        prey = ca.vertcat(a, k * speed * motion.time, 0)
        return across(motion.linear_velocity, prey - motion.position)

    def error(steps: int) -> float:
        # It would be caught after a / V / (1 - k^2), a duration of 2.08 s.
        path = simulate([heading_for_the_prey], Start(velocity=[speed, 0, 0]), 1.5, steps)
        u = 1 - path.positions[:, 0] / a
        flat, steep = (1 - u ** (1 + k)) / (1 + k), (1 - u ** (1 - k)) / (1 - k)
        y, length = a / 2 * (steep - flat), a / 2 * (steep + flat)
        return farthest(
            np.column_stack([path.positions[:, 1], length]),
            np.column_stack([y, speed * path.times]),
        )

    converges(error, 500, accuracy=1e-5)


# -------------------------------------------------------------------- not linear in velocities


def test_a_body_that_must_keep_its_speed_turns_into_its_fall() -> None:
    """Gauss's isokinetic constraint (Evans et al., Phys. Rev. A 28, 1983): ``|v| = V``.

    ``dv/dt = g - (g v) v / V^2``; thrown level, ``v_x = V sech(g t/V)``, ``v_z = -V tanh(g t/V)``,
    a catenary of equal strength.
    """
    speed = 2.0

    @velocity_constraint
    def isokinetic(motion: Instant) -> Any:
        return (ca.sumsqr(motion.linear_velocity) / speed**2 - 1) * speed

    def error(steps: int) -> float:
        path = simulate([isokinetic], Start(velocity=[speed, 0, 0]), 1.0, steps, external=falling)
        t = G / speed * path.times
        expected = np.column_stack([gudermannian(t), 0 * t, -np.log(np.cosh(t))])
        return farthest(path.positions, speed**2 / G * expected)

    converges(error, 500, accuracy=2e-3)


@given(st.floats(0.2, 3), st.floats(-3, 3))
@settings(max_examples=5)
def test_appell_and_hamels_mechanism_slows_down_evenly(ratio: float, heading: float) -> None:
    """``v_z = k |v_xy|``: speed u over ground changes at ``-k g / (1 + k^2)``, on a straight line.

    Appell's and Hamel's example of a constraint that is not linear in the velocities (Neimark and
    Fufaev, chapter IV), for a unit mass.
    """

    @velocity_constraint
    def climbing(motion: Instant) -> Any:
        return motion.linear_velocity[2] - ratio * ca.norm_2(motion.linear_velocity[:2])

    direction = np.array([np.cos(heading), np.sin(heading), ratio])
    path = simulate([climbing], Start(velocity=6 * direction), 1.0, 200, external=falling)
    t = path.times[:, None]
    slowing = ratio * G / (1 + ratio**2)
    np.testing.assert_allclose(
        path.positions, (6 * t - slowing * t**2 / 2) * direction, rtol=0, atol=1e-10
    )


# -------------------------------------------------------------------- redundant rows


@dataclass(frozen=True)
class System:
    """One of the systems above, and something of its motion that is zero all along."""

    constraints: tuple[Constraint, ...]
    start: Start
    noise: Callable[[Instant], Any]
    metric: tuple[float, ...] = POSITION_ONLY
    external: External = falling

    def run(self, *more: Constraint) -> Path:
        return simulate(
            [*self.constraints, *more],
            self.start,
            1.5,
            600,
            metric=self.metric,
            external=self.external,
        )


def nearly(constraint: Constraint, noise: Callable[[Instant], Any]) -> Constraint:
    """Another row that says almost the same, consistently."""
    declare = velocity_constraint if constraint.level == "velocity" else position_constraint
    return declare(name="nearly")(
        lambda motion: (1 + 1e-9) * constraint.residual(motion) + 1e-9 * noise(motion)
    )


def systems() -> dict[str, System]:
    knife, sleigh = KnifeEdge(), Sleigh()
    normal = ca.DM(knife.plane.apply([0, 0, 1]))
    mix = ca.DM(np.random.default_rng(0).normal(size=(3, 3)))

    def through_the_plane(motion: Instant) -> Any:
        return ca.dot(normal, motion.linear_velocity)

    return {
        "knife edge": System((Blade(), knife.on_plane), knife.start, through_the_plane),
        "free knife edge": System(
            (Blade(), knife.on_plane), knife.start, through_the_plane, FREE_KNIFE
        ),
        "sleigh": System(
            (sleigh.blade,),
            sleigh.start,
            lambda motion: motion.linear_velocity[2],
            masses(sleigh.mass, sleigh.inertia),
            free,
        ),
        "disc": System(
            (rolling,), tilted_start(), lambda motion: mix @ rolling.residual(motion), DISC
        ),
        "bead": System(
            (on_sphere,),
            spherical_pendulum()[0],
            lambda motion: on_sphere.residual(motion) * motion.position[0],
        ),
    }


@pytest.mark.parametrize("name", ["knife edge", "free knife edge", "sleigh", "disc", "bead"])
def test_repeated_and_nearly_dependent_rows_change_no_path(name: str) -> None:
    system = systems()[name]
    once = system.run()
    first, noise = system.constraints[0], system.noise
    for more in (system.constraints, (*system.constraints, nearly(first, noise))):
        path = system.run(*more)
        assert farthest(path.positions, once.positions) <= 1e-8
        assert angle_between(path.rotations, once.rotations) <= 1e-8
        h = once.times[1]
        accelerations = [np.diff(p.velocities[1:], axis=0) / h for p in (path, once)]
        assert farthest(*accelerations) <= 1e-6 * np.abs(accelerations[1]).max()


# -------------------------------------------------------------------- rest
#
# From rest to rest in the first second, at rest in the next, and on in the third.


def pace(t: Any) -> Any:
    """Speed: ``sin^2(pi t)`` in the first and the third second."""
    resting = (t >= 1) * (t <= 2)
    return (1 - resting) * np.sin(np.pi * t) ** 2


def way(t: Any) -> Any:
    """Integral of the pace."""

    def of_first(u: Any) -> Any:
        return u / 2 - np.sin(2 * np.pi * u) / (4 * np.pi)

    return of_first(np.minimum(t, 1)) + of_first(np.maximum(t - 2, 0))


def symbolic_pace(t: Expression) -> Expression:
    resting = ca.logic_and(t >= 1, t <= 2)
    return ca.if_else(resting, 0, ca.sin(ca.pi * t) ** 2)


def symbolic_way(t: Expression) -> Expression:
    def of_first(u: Expression) -> Expression:
        return u / 2 - ca.sin(2 * ca.pi * u) / (4 * ca.pi)

    return of_first(ca.fmin(t, 1)) + of_first(ca.fmax(t - 2, 0))


def rows_of(kind: str) -> list[Constraint]:
    blade = Blade()
    return {
        "once": [blade],
        "twice": [blade, blade],
        "nearly": [blade, blade, nearly(blade, lambda motion: motion.linear_velocity[2])],
    }[kind]


def paced(heading: Callable[[Expression], Expression], drift: float = 0.0) -> External:
    """Ask for the pace along a heading, from no spin unless the constraint turns."""

    def external(symbols: StepSymbols) -> Pair:
        t, angle = symbols.time, heading(symbols.time)
        wanted = symbolic_pace(t) * ca.vertcat(ca.cos(angle), ca.sin(angle), 0)
        wanted += ca.DM([drift, 0, 0])
        return (wanted - symbols.linear_velocity) / symbols.kick, ca.SX(3, 1)

    return external


@pytest.mark.parametrize("kind", ["once", "twice", "nearly"])
def test_a_turning_blade_that_rests_for_a_while_moves_on(kind: str) -> None:
    """Driven along the edge as it was in the middle of the step before.

    Across it, ``u w`` comes from the blade.
    """
    rate = 1.3

    def error(steps: int) -> float:
        h = 3.0 / steps
        driven = paced(lambda t: rate * (t - 1.5 * h))
        path = simulate(rows_of(kind), Start(spin=[0, 0, rate]), 3.0, steps, external=driven)
        t, force = path.times[2:], path.multipliers[1:].sum(axis=1)
        # As fast as the pace changes (its derivative is at most pi), and no faster.
        assert np.abs(np.diff(force)).max() <= 1.1 * np.pi * rate * h
        assert np.abs(force[(t > 1 + h) & (t < 2)]).max() <= 1e-10
        return float(np.abs(force - rate * pace(t)).max())

    converges(error, 750, accuracy=5e-6)


BEND = 1.5


@velocity_constraint
def bending(motion: Instant) -> Any:
    """A turn in proportion to the way, whose row, of the spin, vanishes where the tool rests."""
    speed = motion.linear_velocity[0]
    return speed * (motion.angular_velocity[2] - BEND * speed)


@velocity_constraint
def bending_but_for_rounding(motion: Instant) -> Any:
    """The same, with errors as those of the rounding of terms that cancel."""
    return bending.residual(motion) + 1e-17 * ca.sin(1e3 * motion.time)


def bent(kind: str, drift: float = 0.0, steps: int = 1450) -> tuple[Path, Floats]:
    """Turn a tool as it moves on, its motion given; stop before the last moment at rest."""
    external = paced(lambda t: ca.SX(0), drift)

    def at_ease(symbols: StepSymbols) -> Pair:
        return external(symbols)[0], -symbols.angular_velocity / symbols.kick

    rows = {
        "once": [bending],
        "twice": [bending, bending],
        "nearly": [bending, bending, nearly(bending, lambda motion: motion.angular_velocity[0])],
        "rounded": [bending_but_for_rounding],
    }[kind]
    metric = (0, 0, 0, 1, 1, 1)
    path = simulate(rows, Start(), steps / 500, steps, metric=metric, external=at_ease)
    return path, BEND * way(path.times)


@pytest.mark.parametrize("kind", ["once", "twice", "nearly"])
def test_a_tool_whose_row_vanishes_where_it_rests_does_not_turn_there(kind: str) -> None:
    path, heading = bent(kind)
    speeds = path.velocities[1:, 0]
    moving = speeds > 1e-8
    np.testing.assert_allclose(path.spins[1:, 2][moving], BEND * speeds[moving], atol=1e-9)
    at_rest = (path.times[1:] > 1.001) & (path.times[1:] < 2)
    assert at_rest.sum() > 490
    np.testing.assert_allclose(path.spins[1:][at_rest], 0.0, rtol=0, atol=1e-9)
    # The pace is asked for at the end of each step: a sum to the right of the integral.
    turns = Rotation.from_euler("z", heading[:, None])
    assert angle_between(path.rotations, turns) <= BEND * 1.1 * path.times[1]


def test_a_resting_tool_is_not_turned_by_rounding_errors() -> None:
    """Nor is it turned where its speed is one of rounding, and asks for next to no turn.

    There the row is of the size of the errors: divided by it they would be a spin of 10 rad/s.
    """
    path, _ = bent("once", steps=900)
    at_rest = (path.times > 1.001) & (path.times < 2)
    drifting, _ = bent("once", drift=1e-18, steps=900)
    np.testing.assert_allclose(drifting.velocities[at_rest, 0], 1e-18)
    assert angle_between(path.rotations, drifting.rotations) < 1e-15
    rounded, _ = bent("rounded", drift=1e-18, steps=900)
    assert angle_between(path.rotations, rounded.rotations) < 1e-8


@pytest.mark.parametrize("kind", ["once", "twice", "nearly"])
def test_a_blade_that_steers_into_its_path_rests_without_a_turn(kind: str) -> None:
    """Driven along a bending heading, all but what half a step's lever leaves is steered."""
    steps = 1450
    h = steps / 500 / steps

    def at_ease(symbols: StepSymbols) -> Pair:
        driven = paced(lambda t: BEND * symbolic_way(t))
        return driven(symbols)[0], -symbols.angular_velocity / symbols.kick

    # The way of half a step at mean speed weighs as much as a radian.
    turn = 1 / (0.25 * h) ** 2
    path = simulate(
        rows_of(kind),
        Start(),
        steps * h,
        steps,
        metric=(1, 1, 1, turn, turn, turn),
        external=at_ease,
        push="steering",
    )
    at_rest = (path.times[1:] > 1.001) & (path.times[1:] < 2)
    assert np.abs(path.spins[1:][at_rest]).max() <= 1e-9
    heading = Rotation.from_euler("z", BEND * way(path.times)[:, None])
    assert angle_between(path.rotations, heading) <= 0.02


# -------------------------------------------------------------------- constrained equations
#
# Rules in components, into which CasADi's and SymPy's symbols fit.


def dot(a: Any, b: Any) -> Any:
    return sum(a[i] * b[i] for i in range(3))


def column(motion: Any, index: int) -> list[Any]:
    return [motion.rotation[i, index] for i in range(3)]


def blade_rule(motion: Any) -> Any:
    return dot(column(motion, 1), motion.linear_velocity)


def sphere_rule(motion: Any) -> Any:
    return dot(motion.position, motion.position) - 2 - motion.time


def tilting_rule(motion: Any) -> Any:
    return motion.rotation[2, 0] - motion.position[1] * motion.time**2


def belt_rule(motion: Any) -> Any:
    return motion.linear_velocity[0] - motion.time * motion.position[1] * motion.rotation[0, 2]


def curving_rule(motion: Any) -> Any:
    v, w = motion.linear_velocity, motion.angular_velocity
    return dot(column(motion, 2), w) - motion.time * dot(v, v) + dot(w, v)


RULES = {
    blade_rule: velocity_constraint,
    sphere_rule: position_constraint,
    tilting_rule: position_constraint,
    belt_rule: velocity_constraint,
    curving_rule: velocity_constraint,
}
DECLARED = {rule: declare(name=rule.__name__)(rule) for rule, declare in RULES.items()}


def symbolic_rows() -> dict[Any, Any]:
    """For each rule, (A, b) by the chain rule over ``dR/dt = [w] R``."""
    t = sp.Symbol("t")
    p, v, w, a, alpha = (sp.Matrix(sp.symbols(f"{n}:3")) for n in ("p", "v", "w", "a", "z"))
    R = sp.Matrix(3, 3, sp.symbols("R:9"))
    skew = sp.Matrix([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
    motion = SimpleNamespace(time=t, position=p, rotation=R, linear_velocity=v, angular_velocity=w)
    state = [t, *p, *R, *v, *w]
    rates = [1, *v, *(skew * R), *a, *alpha]

    def derivative(expression: Any) -> Any:
        return sum(sp.diff(expression, x) * rate for x, rate in zip(state, rates, strict=True))

    accelerations = [*a, *alpha]
    rows = {}
    for rule, declare in RULES.items():
        along = derivative(rule(motion))
        if declare is position_constraint:
            along = derivative(along)
        A = sp.Matrix([along]).jacobian(accelerations)
        b = -along.subs(dict.fromkeys(accelerations, 0))
        rows[rule] = sp.lambdify([state], [*A, b], modules="mpmath")
    return rows


@pytest.fixture(scope="module")
def rows() -> dict[Any, Any]:
    return symbolic_rows()


@dataclass(frozen=True)
class RandomInstant:
    """A random state, a free acceleration and a metric."""

    state: tuple[Any, ...]
    unconstrained: Floats
    metric: tuple[float, ...]

    @classmethod
    def random(cls, seed: int) -> RandomInstant:
        rng = np.random.default_rng(seed)
        quaternion = Rotation.random(random_state=rng).as_quat(scalar_first=True)
        t, (p, v, w) = rng.uniform(0.2, 1), rng.normal(size=(3, 3))
        metric = tuple(rng.uniform(0.2, 5, 6))
        return cls((t, p, quaternion, v, w), rng.normal(size=6), metric)

    @property
    def numbers(self) -> list[float]:
        t, p, quaternion, v, w = self.state
        R = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
        return [float(x) for x in (t, *p, *R.ravel(), *v, *w)]


selections = st.lists(st.sampled_from(list(RULES)), min_size=1, max_size=4, unique=True)


@given(selections, st.integers(0, 2**32 - 1))
@settings(max_examples=25)
def test_accelerations_solve_the_symbolic_constrained_equations(
    rows: Any, rules: Any, seed: int
) -> None:
    """Lagrange's equations ``M a = M a_u + A' l``, ``A a = b``, solved with 40 digits."""
    instant = RandomInstant.random(seed)
    with mpmath.workdps(40):
        found = [rows[rule](instant.numbers) for rule in rules]
        A = mpmath.matrix([row[:6] for row in found])
        b = mpmath.matrix([row[6] for row in found])
        inverse = mpmath.diag(list(instant.metric))
        unconstrained = mpmath.matrix(list(instant.unconstrained))
        assume(np.linalg.cond(np.array(A.tolist(), dtype=float)) < 30)
        multipliers = mpmath.lu_solve(A * inverse * A.T, b - A * unconstrained)
        expected = unconstrained + inverse * A.T * multipliers
    numeric = ConstraintSystem([DECLARED[rule] for rule in rules]).acceleration_form(*instant.state)
    acceleration = gauss_acceleration(instant.unconstrained, *numeric, instant.metric)
    exact = np.array([float(x) for x in expected])
    scale = 1 + np.abs(exact).max()
    np.testing.assert_allclose(acceleration, exact, rtol=0, atol=1e-10 * scale)


@given(selections, st.integers(0, 2**32 - 1), st.integers(1, 4))
@settings(max_examples=25)
def test_repeated_and_dependent_rows_are_weighted_pseudoinverses(
    rules: Any, seed: int, more: int
) -> None:
    # Udwadia and Kalaba's a + M^-1/2 (A M^-1/2)^+ (b - A a), by NumPy, in any metric.
    instant = RandomInstant.random(seed)
    A, b = ConstraintSystem([DECLARED[rule] for rule in rules]).acceleration_form(*instant.state)
    assume(np.linalg.cond(A) < 30)
    mix = np.random.default_rng(seed).normal(size=(more, len(b)))
    A, b = np.vstack([A, mix @ A]), np.append(b, mix @ b)
    root, a = np.sqrt(instant.metric), instant.unconstrained
    expected = a + root * (np.linalg.pinv(A * root, rcond=1e-9) @ (b - A @ a))
    found = gauss_acceleration(a, A, b, instant.metric)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * (1 + np.abs(b).max()))


@given(st.integers(0, 2**32 - 1), st.integers(1, 5), st.integers(0, 3))
@settings(max_examples=20)
def test_a_step_under_linear_rules_is_the_pseudoinverse_too(
    seed: int, rank: int, more: int
) -> None:
    """Rows that are constant and linear in the velocities leave nothing to iterate."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(rank, 6))
    assume(np.linalg.cond(A) < 30)
    A = np.vstack([A, rng.normal(size=(more, rank)) @ A])
    goal, start, metric = rng.normal(size=6), rng.normal(size=6), rng.uniform(0.2, 5, 6)

    @velocity_constraint
    def rule(motion: Instant) -> Any:
        twist = ca.vertcat(motion.linear_velocity, motion.angular_velocity)
        return ca.mtimes(ca.DM(A), twist - ca.DM(goal))

    # The first kick lasts half a step.
    h = 1e-2
    push = 2 / h * (start - goal)
    path = simulate(
        [rule],
        Start(velocity=goal[:3], spin=goal[3:]),
        h,
        1,
        metric=metric,
        external=lambda s: (ca.DM(push[:3]), ca.DM(push[3:])),
    )
    root = np.sqrt(metric)
    expected = start + root * (np.linalg.pinv(A * root, rcond=1e-9) @ (A @ (goal - start)))
    found = np.concatenate([path.velocities[1], path.spins[1]])
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10)


@pytest.mark.parametrize(
    "rules",
    [
        (curving_rule,),
        (curving_rule, belt_rule),
        (tilting_rule,),
        (tilting_rule, sphere_rule),
        (curving_rule, tilting_rule),
    ],
)
def test_a_first_step_off_the_rules_tends_to_the_stabilized_acceleration(rules: Any) -> None:
    """Rules about the spin, or not linear, from states that violate them.

    The first kick leads from the instant to the step's middle: half a step.
    """
    declared = [DECLARED[rule] for rule in rules]
    for seed in range(3):
        instant = RandomInstant.random(seed)
        converges(first_step_error(declared, instant), 10_000, accuracy=1e-3, order=0.9)


def first_step_error(
    constraints: Sequence[Constraint], instant: RandomInstant
) -> Callable[[int], float]:
    t, p, quaternion, v, w = instant.state
    push = ca.DM(instant.unconstrained)
    step = step_function(constraints, instant.metric, lambda symbols: (push[:3], push[3:]))
    A, b = ConstraintSystem(constraints).acceleration_form(
        *instant.state, stabilization=RESIDUAL_RATE
    )
    exact = gauss_acceleration(instant.unconstrained, A, b, instant.metric)

    def error(steps: int) -> float:
        h = 1 / steps
        state = carried(constraints, np.concatenate([p, quaternion, v, w]))
        after = np.array(step(state, [h, h / 2, 0, t + h])[0]).ravel()
        found = (after - state)[7:13] / (h / 2)
        return float(np.linalg.norm(found - exact) / (1 + np.linalg.norm(exact)))

    return error
