"""In the control loop: latencies of a step, rollouts compiled and not, batches, and the floor.

The floor is what the step's arithmetic would take at this machine's measured peak, and its bytes at
the measured speed of memory: no step of this graph can be faster on it.
"""

from __future__ import annotations

import gc
import os
import subprocess
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter, perf_counter_ns
from typing import Any

import casadi as ca
import numpy as np

from benchmarks import peers
from benchmarks.example import demonstration
from noslip import Blade, ConstrainedDMP, learn
from noslip.runtime.batch import cores
from noslip.runtime.stepper import stepper_of

LATE_STEPS = 1_000_000
MOTIONS = 10_000
DMPBBO = "dmpbbo's C++ is left out: its source is in no package registry"
_WARM = 2000
_TRANSCENDENTAL = ("OP_EXP", "OP_SIN", "OP_COS", "OP_ATAN2", "OP_SQRT", "OP_DIV")


@dataclass(frozen=True)
class Latency:
    """How long single steps take.

    Attributes
    ----------
    name : str
    steps : int
    median, late, worst : float
        Seconds; ``late`` is the 99.9th percentile.
    target, late_target : float or None
        Of median and 99.9th percentile (s).
    """

    name: str
    steps: int
    median: float
    late: float
    worst: float
    target: float | None = None
    late_target: float | None = None


@dataclass(frozen=True)
class Floor:
    """What the step's graph asks of the machine.

    Attributes
    ----------
    operations : int
        Additions, multiplications and the like of a step with its forces.
    functions : int
        Exponentials, roots, divisions and the like.
    bytes : int
        Read and written: numbers, state, the weights near.
    peak : float
        Operations a second, one core (a matrix product in double precision).
    bandwidth : float
        Bytes a second (a copy).
    """

    operations: int
    functions: int
    bytes: int
    peak: float
    bandwidth: float

    @property
    def seconds(self) -> float:
        """Least time, every function counted as one operation."""
        arithmetic = (self.operations + self.functions) / self.peak
        return max(arithmetic, self.bytes / self.bandwidth)


@dataclass(frozen=True)
class Share:
    """A ratio with its target; ``at_most`` says on which side of it is well."""

    name: str
    value: float
    target: float
    at_most: bool = False

    @property
    def met(self) -> bool:
        """Whether this run reaches it."""
        return self.value <= self.target if self.at_most else self.value >= self.target


@dataclass(frozen=True)
class ControlLoop:
    """Everything measured here."""

    latencies: tuple[Latency, ...]
    rollouts: dict[str, float]
    batch: dict[str, float]
    floor: Floor
    shares: tuple[Share, ...]
    left_out: tuple[str, ...]


@contextmanager
def compiling(wanted: bool) -> Iterator[None]:
    """Allow or forbid compiling."""
    before = os.environ.get("NOSLIP_COMPILE")
    os.environ["NOSLIP_COMPILE"] = "1" if wanted else "0"
    try:
        yield
    finally:
        if before is None:
            del os.environ["NOSLIP_COMPILE"]
        else:
            os.environ["NOSLIP_COMPILE"] = before


def control(
    *,
    steps: int = LATE_STEPS,
    motions: int = MOTIONS,
    rounds: int = 200,
    progress: Callable[[str], None] = lambda message: None,
) -> ControlLoop:
    """Measure; what needs a C compiler is left out without one."""
    given = demonstration(1001)
    latencies, rollouts, batch = [], {}, {}
    with compiling(False):
        progress("rollout, virtual machine")
        plain = learn(given, Blade())
        rollouts["uncompiled"] = _median(plain.rollout, rounds)
        progress("steps, virtual machine")
        latencies.append(_stepping("Python, virtual machine: advance()", plain, steps // 10, 8e-6))
    left_out = [DMPBBO]
    with compiling(True):
        dmp = learn(given, Blade())
        if dmp.compile():
            progress("rollout, compiled")
            rollouts["compiled"] = _median(dmp.rollout, rounds)
            progress("steps, compiled")
            latencies += [
                _stepping("Python: advance(), in place", dmp, steps, 8e-6),
                _stepping("Python: step()", dmp, steps, 8e-6, how="step"),
                _stepping("Python: step(measured_state)", dmp, steps // 10, 8e-6, how="measured"),
            ]
            progress("steps, C")
            latencies.append(in_c(dmp, steps))
            progress("batches")
            batch = _batch(dmp, motions)
        else:
            left_out.append("compiled steps are left out: no C compiler")
    if not peers.MISSING:
        progress("movement-primitives")
        fitted = peers.fit(*peers.imitation(given))
        rollouts["movement-primitives, unconstrained"] = _median(
            fitted.open_loop, max(3, rounds // 20)
        )
        latencies.append(_of_peer(fitted, given, min(steps, 20_000)))
    floor = _floor(dmp)
    return ControlLoop(
        tuple(latencies),
        rollouts,
        batch,
        floor,
        tuple(_shares(latencies, rollouts, batch)),
        tuple(left_out),
    )


def _shares(
    latencies: list[Latency], rollouts: dict[str, float], batch: dict[str, float]
) -> Iterator[Share]:
    median = {latency.name: latency.median for latency in latencies}
    theirs = rollouts.get("movement-primitives, unconstrained")
    if theirs is not None:
        peer = median["movement-primitives: step, unconstrained"]
        if "C: noslip_step" in median:
            yield Share(
                "C step, times movement-primitives' step", peer / median["C: noslip_step"], 50
            )
        yield Share("rollout uncompiled, times theirs", theirs / rollouts["uncompiled"], 30)
        if "compiled" in rollouts:
            yield Share("rollout compiled, times theirs", theirs / rollouts["compiled"], 130)
    if batch:
        yield Share(
            "a motion of a batch, over a single rollout's cost by the cores used",
            batch["seconds a motion"] * batch["cores"] / rollouts["compiled"],
            2.2,
            at_most=True,
        )


def _median(call: Callable[[], Any], rounds: int) -> float:
    for _ in range(3):
        call()
    taken = []
    gc.disable()
    try:
        for _ in range(rounds):
            begin = perf_counter()
            call()
            taken.append(perf_counter() - begin)
    finally:
        gc.enable()
    return float(np.median(taken))


def _latency(name: str, nanoseconds: np.ndarray, target: float | None = None) -> Latency:
    median, late, worst = np.percentile(nanoseconds, [50, 99.9, 100]) * 1e-9
    late_target = None if target is None else 50e-6
    return Latency(name, len(nanoseconds), median, late, worst, target, late_target)


def _stepping(
    name: str, dmp: ConstrainedDMP, steps: int, target: float, how: str = "advance"
) -> Latency:
    controller = dmp.controller(time_step=dmp.duration / dmp.steps)
    taken = np.empty(steps)
    state = controller.reset()
    # The first are written over at the end: the caches are cold.
    for k in range(-min(_WARM, steps), steps):
        if controller.done:
            state = controller.reset()
        if how == "advance":
            begin = perf_counter_ns()
            controller.advance()
        elif how == "step":
            begin = perf_counter_ns()
            state = controller.step()
        else:
            begin = perf_counter_ns()
            state = controller.step(state)
        taken[k] = perf_counter_ns() - begin
    return _latency(name, taken, target)


def _of_peer(fitted: Any, given: Any, steps: int) -> Latency:
    _, poses = peers.imitation(given)
    taken, state = np.empty(steps), (poses[0], np.zeros(6))
    fitted.reset()
    for k in range(steps):
        if k % (len(given) - 1) == 0:
            fitted.reset()
            state = (poses[0], np.zeros(6))
        begin = perf_counter_ns()
        state = fitted.step(*state)
        taken[k] = perf_counter_ns() - begin
    return _latency("movement-primitives: step, unconstrained", taken)


def in_c(dmp: ConstrainedDMP, steps: int) -> Latency:
    source = Path(__file__).with_name("latency.c")
    with tempfile.TemporaryDirectory() as folder:
        dmp.export_c(folder, name="cut")
        sources = ["noslip.c", "cut.c", str(source)]
        build = ["cc", "-std=c99", "-O2", "-I.", *sources, "-lm", "-o", "latency"]
        subprocess.run(build, cwd=folder, check=True)
        run = ["./latency", str(steps)]
        told = subprocess.run(run, cwd=folder, check=True, capture_output=True, text=True).stdout
    median, late, worst = (1e-9 * float(x) for x in told.split())
    return Latency("C: noslip_step", steps, median, late, worst, 1e-6)


def _batch(dmp: ConstrainedDMP, motions: int) -> dict[str, float]:
    rng = np.random.default_rng(0)
    goals = dmp.goal_position + 0.1 * rng.normal(size=(motions, 3))
    dmp.rollout_many(goals=goals[: motions // 10 or 1])
    taken = []
    for _ in range(3):
        begin = perf_counter()
        found = dmp.rollout_many(goals=goals)
        taken.append(perf_counter() - begin)
        del found
    return {
        "motions": float(motions),
        "cores": float(cores()),
        "seconds a motion": float(np.median(taken)) / motions,
    }


def _floor(dmp: ConstrainedDMP) -> Floor:
    function = stepper_of(dmp.rule).function
    names = {getattr(ca, name): name for name in dir(ca) if name.startswith("OP_")}
    count = Counter(names[function.instruction_id(k)] for k in range(function.n_instructions()))
    functions = sum(count[name] for name in _TRANSCENDENTAL)
    moves = count["OP_INPUT"] + count["OP_OUTPUT"] + count["OP_CONST"]
    operations = function.n_instructions() - functions - moves
    # One new evaluation of the forces a step: the Gaussians within nine standard deviations.
    near = min(18, dmp.law.basis.count)
    operations += near * (6 + 2 * 6)
    functions += near * 2
    moved = 8 * (function.nnz_in() + function.nnz_out() + near * 8)
    return Floor(operations, functions, moved, peak(), bandwidth())


def peak() -> float:
    """Double-precision operations a second of one core."""
    size = 400
    a = np.random.default_rng(0).normal(size=(size, size))
    threads = int(os.environ.get("OPENBLAS_NUM_THREADS", "0")) or (os.cpu_count() or 1)
    return 2 * size**3 / _median(lambda: a @ a, 30) / threads


def bandwidth(size: int = 1024) -> float:
    """Bytes a second of copies of so many numbers; by default what stays in the nearest cache."""
    a = np.zeros(size)
    b = np.zeros(size)

    def copies() -> None:
        for _ in range(100):
            np.copyto(a, b)

    return 100 * 2 * a.nbytes / _median(copies, 30)
