"""Rhythms under constraints: 1e4 periods in one run, other frequencies, and pydmps beside them.

``python -m benchmarks.rhythms`` prints three tables:

- A saw cut, a rock chop, a wheel's lap and a figure eight, each led by a hand that wavers: how far
  a run of 1e4 periods is from where it began, after any of them; its largest slip, found from its
  poses alone, of all steps; how far it is after being pushed aside.
- The frequency changed to 3 and 0.3 times its own, led there (in a second), and swept, while the
  motion runs: the largest change of twist in a step, over what an acceleration can change in it.
- The places of the same periods without constraints, fitted with as many functions here and by
  pydmps, by its defaults and with our number of steps: how well, and how fast.

The exit code is 1 if a run does not close, slips, or jumps.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from time import process_time
from typing import Any

from benchmarks import single_threaded

single_threaded()

import numpy as np  # noqa: E402
from scipy.spatial import cKDTree  # noqa: E402
from scipy.spatial.transform import Rotation  # noqa: E402

import noslip as ns  # noqa: E402
from benchmarks.control_loop import compiling  # noqa: E402
from benchmarks.environment import environment  # noqa: E402
from noslip._typing import Floats  # noqa: E402
from noslip.constraints.check import step_residuals  # noqa: E402
from noslip.runtime.rhythm import modulated, retimed  # noqa: E402
from noslip.runtime.rollout import steps_ahead  # noqa: E402
from noslip.runtime.stepper import stepper_of  # noqa: E402

try:
    from pydmps.dmp_rhythmic import DMPs_rhythmic

    MISSING = ""
except ImportError as error:
    DMPs_rhythmic, MISSING = None, f"pydmps is left out: {error}"

DMPBBO = "dmpbbo is left out: its version 2 has no rhythmic primitive, and no registry has it"
PERIOD, RATE = 2.0, 100.0
"""Seconds, and Hz of the recordings."""
CLOSED, SLIP, JUMP = 1e-9, 1e-10, 1.05
"""What is asked: m or rad from where a run began; m/s; over what an acceleration changes in a step,
whose peak samples find a little low."""
BLOCK = 100
"""Periods whose poses are looked at together."""
ASIDE = 0.005
"""By which a run is pushed aside (m)."""
LED, STEP = 1.0, 0.002
"""Seconds in which a frequency is led to 95 % of the way to another, and of a step of that run."""
FACTORS = ((3.0, 2.5), (0.3, 4.0), (1.0, 2.0))
"""Factors on the frequency, and for how many seconds each is asked for."""
RISING = 3 * np.log(10) / LED
"""At most, of the frequency's logarithm (1/s): at the beginning of the longest way, 3 to 0.3."""
FUNCTIONS = 100
"""Of both; noslip's default."""


@dataclass(frozen=True)
class Shape:
    """One period as it was recorded, and the constraint that it is to keep."""

    recorded: ns.PoseTrajectory
    constraint: ns.Constraint

    @property
    def name(self) -> str:
        return f"{self.recorded.name}, {self.constraint.name}"


def shapes(seed: int) -> list[Shape]:
    """A saw cut, a rock chop, a lap and a figure eight, by a hand that wavers."""
    rng = np.random.default_rng(seed)
    times = np.linspace(0.0, PERIOD, round(PERIOD * RATE) + 1)
    a = 2 * np.pi * times / PERIOD

    def wavering(size: float) -> Floats:
        waves = [
            rng.normal(0, size / k) * np.cos(k * a) + rng.normal(0, size / k) * np.sin(k * a)
            for k in range(1, 5)
        ]
        return np.asarray(np.sum(waves, axis=0))

    def led(name: str, places: Sequence[Any], turns: Sequence[Any]) -> ns.PoseTrajectory:
        """About by 1 mm and 1 degree; turns about the world's z, then the tool's y."""
        path = np.column_stack([place + wavering(0.001) for place in places])
        angles = np.column_stack([turn + wavering(0.02) for turn in turns])
        return ns.PoseTrajectory(times, path, Rotation.from_euler("ZYX", angles), name=name)

    def rolled(name: str, x: Floats, y: Floats, yaw: Floats) -> ns.PoseTrajectory:
        path = np.column_stack([x + wavering(0.001), y + wavering(0.001), 0 * a])
        return ns.PoseTrajectory(
            times, path, Rotation.from_euler("z", yaw + wavering(0.02)), name=name
        )

    yaw = np.unwrap(np.arctan2(np.cos(2 * a), np.cos(a)))
    return [
        Shape(
            led("saw cut", [0.06 * np.cos(a), 0, 0.004 * np.sin(a)], [0, 0.05 * np.sin(a), 0]),
            ns.Blade(),
        ),
        Shape(
            led(
                "rock chop",
                [0.02 * np.sin(a), 0, 0.03 * (1 - np.cos(a))],
                [0, 0.25 * (1 - np.cos(a)), 0],
            ),
            ns.Blade(),
        ),
        Shape(rolled("lap", 0.1 * np.cos(a), 0.1 * np.sin(a), a + np.pi / 2), ns.Wheel()),
        Shape(rolled("figure eight", 0.1 * np.sin(a), 0.05 * np.sin(2 * a), yaw), ns.Wheel()),
    ]


# ---------------------------------------------------------------- many periods


@dataclass(frozen=True)
class Run:
    """What became of many periods.

    Attributes
    ----------
    away, turned : float
        From where it began, after any period, the largest (m, rad).
    slip : float
        Of any step, from poses alone (m/s).
    pushed : tuple of float
        Distance from the cycle 0, 1 and 2 periods after being pushed aside (m).
    """

    name: str
    periods: int
    slipped: float
    away: float
    turned: float
    slip: float
    pushed: tuple[float, ...]

    @property
    def failures(self) -> Iterator[str]:
        if not max(self.away, self.turned) <= CLOSED:
            yield f"{self.name}: {self.away:.1e} m, {self.turned:.1e} rad off after a period"
        if not self.slip <= SLIP:
            yield f"{self.name}: slips by {self.slip:.1e} m/s"


def many_periods(shape: Shape, dmp: ns.ConstrainedDMP, periods: int) -> Run:
    """Run a rhythm on and on, in machine code where there is a compiler, and look at each step."""
    law, rule, h = dmp.law, dmp.rule, dmp.duration / dmp.steps
    stepper, state = stepper_of(rule), dmp.initial_state()
    stepper.native.wait()
    # What depends on the phase alone is the same in all periods, but for the very first step.
    begun = steps_ahead(law, rule, state, 1, h)
    once = steps_ahead(law, rule, replace(state, previous_step=h), dmp.steps, h)
    table = np.tile(once, (BLOCK, 1))
    states = np.empty((len(table) + 1, stepper.carried.size))
    outputs = np.empty((len(table), stepper.outputs.size))
    states[0] = state.carried(rule.system)
    first, away, turned, slip = states[0, :7].copy(), 0.0, 0.0, 0.0
    for done in range(0, periods, BLOCK):
        table[0] = once[0] if done else begun[0]
        stepper.run(states[0], table, states[1:], outputs)
        block = ns.PoseTrajectory(
            h * np.arange(len(states)),
            states[:, :3],
            Rotation.from_quat(states[:, 3:7], scalar_first=True),
        )
        slip = max(slip, float(np.abs(step_residuals(block, shape.constraint)).max()))
        ends = states[dmp.steps :: dmp.steps, :7]
        off = law.space.difference(ends, np.tile(first, (len(ends), 1)))
        away = max(away, float(np.linalg.norm(off[:, :3], axis=1).max()))
        turned = max(turned, float(np.linalg.norm(off[:, 3:], axis=1).max()))
        states[0] = states[-1]
    lateral = dmp.start_rotation.as_matrix()[:, 1]
    pushed = dmp.rollout(cycles=2, start_position=dmp.start_position + ASIDE * lateral)
    back = np.linalg.norm(pushed.positions[:: dmp.steps] - dmp.start_position, axis=1)
    own = float(np.abs(step_residuals(shape.recorded, shape.constraint)).max())
    return Run(
        shape.name,
        periods,
        own,
        away,
        turned,
        slip,
        tuple(float(x) for x in back),
    )


def table_of_runs(runs: Sequence[Run]) -> Iterator[str]:
    """Lines of Markdown, one a shape."""
    yield (
        "| rhythm | periods | from where it began, at most | slip, m/s: hand, primitive | "
        "pushed 5 mm aside, after 1 and 2 periods |"
    )
    yield "|---|---|---|---|---|"
    for run in runs:
        _, once, twice = run.pushed
        yield (
            f"| {run.name} | {run.periods:.0e} | {run.away:.0e} m, {run.turned:.0e} rad | "
            f"{run.slipped:.3f}, {run.slip:.0e} | {1e6 * once:.2g} um, {1e6 * twice:.2g} um |"
        )


# ---------------------------------------------------------------- frequencies


@dataclass(frozen=True)
class Change:
    """What became of a run whose frequency changes; ``jumps`` linear and angular."""

    name: str
    how: str
    jumps: tuple[float, float]
    slip: float
    away: float

    @property
    def failures(self) -> Iterator[str]:
        if not max(self.jumps) <= JUMP:
            yield f"{self.name}, {self.how}: jumps to {max(self.jumps):.3g} of what may be"
        if not self.slip <= SLIP:
            yield f"{self.name}, {self.how}: slips by {self.slip:.1e} m/s"


def led(law: Any, state: Any, time: float) -> Any:
    """The state with a frequency a step nearer to the one that is asked for at a time (s)."""
    ends = np.cumsum([seconds for _, seconds in FACTORS])
    factor, _ = FACTORS[min(int(np.searchsorted(ends, time)), len(FACTORS) - 1)]
    return modulated(law, state, STEP, within=LED, period=law.duration / factor)


def swept(law: Any, state: Any, time: float) -> Any:
    """The same of a frequency that goes up to 3 times, down to 0.3 times and back, evenly."""
    corners = np.cumsum([0.0, *(seconds for _, seconds in FACTORS)])
    factors = np.log([1.0, *(factor for factor, _ in FACTORS)])
    return retimed(state, law.duration / float(np.exp(np.interp(time, corners, factors))))


def changed(
    shape: Shape, dmp: ns.ConstrainedDMP, how: str, leading: Callable[[Any, Any, float], Any]
) -> Change:
    """Run a rhythm at other frequencies, and look at each step.

    A cycle of speed v0 and acceleration a0 (its own peaks), run through f times as fast, changes
    its twist in a step h by no more than ``h (f^2 a0 + f' v0)``, where f' is as large as
    :data:`RISING` says, or as the even slope.
    """
    seconds = sum(each for _, each in FACTORS)
    state, twists, periods = dmp.initial_state(), [], []
    points = [state.vector()[:7]]
    for k in range(round(seconds / STEP)):
        state = dmp.step(leading(dmp.law, state, k * STEP), STEP)
        twists.append([state.linear_velocity, state.angular_velocity])
        periods.append(state.duration)
        points.append(state.vector()[:7])
    own = dmp.rollout(time_step=STEP, cycles=2)
    found = np.array(twists)
    frequency = dmp.duration / np.array(periods)
    rising = RISING if leading is led else np.log(10) / FACTORS[1][1]
    faster = np.maximum(frequency[1:], frequency[:-1])
    jumps = []
    for part, velocities in enumerate((own.linear_velocities, own.angular_velocities)):
        speed = np.linalg.norm(velocities, axis=1).max()
        acceleration = np.linalg.norm(np.diff(velocities[1:], axis=0), axis=1).max() / STEP
        change = np.linalg.norm(np.diff(found[:, part], axis=0), axis=1)
        allowed = STEP * (faster**2 * acceleration + rising * faster * speed)
        jumps.append(float((change / allowed).max()))
    walked = np.array(points)
    moved = ns.PoseTrajectory(
        STEP * np.arange(len(walked)),
        walked[:, :3],
        Rotation.from_quat(walked[:, 3:], scalar_first=True),
    )
    fine = dmp.rollout(cycles=1, time_step=STEP / 10).positions
    slip = float(np.abs(step_residuals(moved, shape.constraint)).max())
    away, _ = cKDTree(fine).query(walked[:, :3])
    return Change(
        shape.name,
        how,
        (jumps[0], jumps[1]),
        slip,
        float(away.max()),
    )


def table_of_changes(changes: Sequence[Change]) -> Iterator[str]:
    """Lines of Markdown, one a shape and a way."""
    yield (
        "| rhythm | frequency | largest change of twist in a step, over the allowed: linear, "
        "angular | slip, m/s | from its own path, mm |"
    )
    yield "|---|---|---|---|---|"
    for each in changes:
        yield (
            f"| {each.name} | {each.how} | {each.jumps[0]:.2f}, {each.jumps[1]:.2f} | "
            f"{each.slip:.0e} | {1e3 * each.away:.2g} |"
        )


# ---------------------------------------------------------------- beside pydmps


@dataclass(frozen=True)
class Fit:
    """How well and how fast the places of a period are fitted.

    Errors are over the path; times are of the processor, seconds.
    """

    name: str
    library: str
    rms: float
    peak: float
    fit: float
    rollout: float


PERIODS = 4
"""Rolled out, of which the last is compared: pydmps starts at rest."""


def beside(shape: Shape, rounds: int) -> Iterator[Fit]:
    """Fit the places of a period here and by pydmps."""
    recorded = shape.recorded
    places = ns.Trajectory(recorded.times, recorded.positions, names=["x", "y", "z"])

    def learned() -> ns.ConstrainedDMP:
        return ns.learn(places, rhythmic=True, basis_functions=FUNCTIONS)

    def held() -> ns.ConstrainedDMP:
        return ns.learn(recorded, shape.constraint, rhythmic=True, basis_functions=FUNCTIONS)

    def theirs(step: float) -> Callable[[], Any]:
        def imitated() -> Any:
            dmp = DMPs_rhythmic(n_dmps=3, n_bfs=FUNCTIONS, dt=step)
            dmp.imitate_path(y_des=places.values.T)
            return dmp

        return imitated

    def own_rollout(dmp: ns.ConstrainedDMP) -> Floats:
        return np.asarray(dmp.rollout(cycles=PERIODS).positions)

    def their_rollout(dmp: Any) -> Floats:
        return np.asarray(dmp.rollout(timesteps=PERIODS * dmp.timesteps)[0])

    makers: list[tuple[str, Callable[[], Any], Callable[[Any], Floats]]] = [
        ("noslip", learned, own_rollout),
        (f"noslip, poses under {shape.constraint.name}", held, own_rollout),
    ]
    if not MISSING:
        dmp = learned()
        makers += [
            ("pydmps, dt=0.01 of 2 pi, its default", theirs(0.01), their_rollout),
            (f"pydmps, {dmp.steps} steps", theirs(2 * np.pi / dmp.steps), their_rollout),
        ]
    made = {name: make() for name, make, _ in makers}
    taken: dict[str, list[tuple[float, float]]] = {name: [] for name in made}
    with compiling(False):
        # In turn, so that a slow phase of the machine hits all alike; the first time is not told.
        for _ in range(rounds + 1):
            for name, make, roll in makers:
                begun = process_time()
                dmp = make()
                fitted = process_time()
                roll(dmp)
                taken[name].append((fitted - begun, process_time() - fitted))
    for name, _, roll in makers:
        path = roll(made[name])
        rms, peak = apart(path[-(len(path) // PERIODS) - 1 :], places)
        yield Fit(recorded.name, name, rms, peak, *np.median(taken[name][1:], axis=0).tolist())


def apart(path: Floats, places: ns.Trajectory) -> tuple[float, float]:
    """RMS and largest distance of a period from the recorded one, over its path.

    At the shift in time at which they lie nearest: pydmps' phase is off by what its canonical
    system starts with.
    """
    fractions = np.linspace(0, 1, len(path))
    there = (places.times - places.times[0]) / places.duration

    def off(shift: float) -> Floats:
        own = [np.interp((there + shift) % 1.0, fractions, column) for column in path.T]
        return np.asarray(np.linalg.norm(np.column_stack(own) - places.values, axis=1))

    shifts = np.linspace(-0.5, 0.5, 2001)
    best = min(shifts, key=lambda shift: float(np.mean(off(shift) ** 2)))
    distances = off(best) / places.path_length
    return float(np.sqrt(np.mean(distances**2))), float(distances.max())


def table_of_fits(fits: Sequence[Fit]) -> Iterator[str]:
    """Lines of Markdown, one a shape and library; times as ratios of the first one's."""
    yield (
        "| places of | fitted by | off, rms and most, over the path | time to fit | to roll out "
        f"{PERIODS} periods |"
    )
    yield "|---|---|---|---|---|"
    first = fits[0]
    for each in fits:
        first = first if first.name == each.name else each
        yield (
            f"| {each.name} | {each.library} | {each.rms:.1e}, {each.peak:.1e} | "
            f"{1e3 * each.fit:.1f} ms, {each.fit / first.fit:.2g} | "
            f"{1e3 * each.rollout:.2f} ms, "
            f"{each.rollout / first.rollout:.2g} |"
        )


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the tables; whether all is as it must be."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--periods", type=int, default=10_000, help=f"in {BLOCK}s")
    parser.add_argument(
        "--rounds", type=int, default=10, help="of fits and rollouts that are timed"
    )
    parser.add_argument("--seed", type=int, default=0, help="of the hands")
    options = parser.parse_args(arguments)
    found = shapes(options.seed)
    runs, changes = [], []
    with compiling(True):
        for shape in found:
            dmp = ns.learn(shape.recorded, shape.constraint, rhythmic=True)
            runs.append(many_periods(shape, dmp, options.periods))
            changes.append(changed(shape, dmp, "3, 0.3, 1 times, led", led))
            changes.append(changed(shape, dmp, "swept to 3, 0.3, 1 times", swept))
    print("\n".join(table_of_runs(runs)), end="\n\n", flush=True)
    print("\n".join(table_of_changes(changes)), end="\n\n", flush=True)
    fits = [fit for shape in found for fit in beside(shape, options.rounds)]
    print("\n".join(table_of_fits(fits)), end="\n\n")
    told = environment() | {"seed": options.seed, "pydmps": None if MISSING else version("pydmps")}
    print(", ".join(f"{name} {value}" for name, value in told.items()))
    print("\n".join(filter(None, (MISSING, DMPBBO))))
    failed = [line for each in (*runs, *changes) for line in each.failures]
    print("\n".join(failed), file=sys.stderr)
    return bool(failed)


if __name__ == "__main__":
    sys.exit(main())
