"""Distributions of motions: how likely they find what they have not seen, and what a sample costs.

``python -m benchmarks.distributions`` prints three tables:

- Each demonstration's log-likelihood under the others', beside movement-primitives' ``ProMP``, that
  gets the same numbers, as they are and made of unit variance, 10 weights each and 20, whichever is
  better: with the noise that it estimates itself, and with that which in hindsight suits it best.
- Samples under a blade that pass a pose: their time beside the exact projection's of the same
  motions, taken in turn; the largest slip; how far the pose and the drawn ends are missed; how far
  from the exact projection they are.
- How many motions of a known distribution lie within the intervals that are learned from a few.

``--recordings FOLDER`` adds recorded contours and needles to the first.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import process_time

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table
from scipy.spatial.transform import Rotation

import noslip as ns
from benchmarks import single_threaded
from noslip._typing import Floats
from noslip.constraints.system import as_system
from noslip.demonstrations.excision import RATE, TOOL_FRAME, synthetic_excisions
from noslip.distribution import MotionDistribution, learn_distribution
from noslip.distribution.curves import FRACTIONS
from noslip.distribution.demonstrated import deviations, projected
from noslip.errors import NoslipWarning
from noslip.experiments.excision import PAPER_CUTOFF, TRIM_SPEED
from noslip.projection.request import ADAPTING, Request
from noslip.projection.trajectory import project

ENDS: tuple[ns.boundary.End, ns.boundary.End] = ("free", "position")
PEER_WEIGHTS = (10, 20)
"""Of ProMP in each dimension: its default, and twice as many."""
NOISES = 10.0 ** np.arange(-12, 0.5, 0.5)
"""Variances, of which ProMP gets the best in hindsight."""
LEVELS = (0.9, 0.95, 0.99)
CONFIDENCE = 0.9
"""Of sets of demonstrations."""
VIA, ASIDE, TURNED = 0.5, 1.0, 1.0
"""Where samples pass a pose, and how far from the mean it is (standard deviations)."""


@dataclass(frozen=True)
class Likelihood:
    """Of one demonstration under the others, nats a value.

    Attributes
    ----------
    name : str
    ours : float
    theirs : float
        ProMP's, with its own noise; the best of its settings.
    hindsight : float
        The same with the noise that suits this very demonstration best.
    """

    name: str
    ours: float
    theirs: float
    hindsight: float


@dataclass(frozen=True)
class Sampling:
    """What samples cost and keep.

    Attributes
    ----------
    count : int
    seconds, exact_seconds : float
        CPU time of a sample, and of its exact projection; lowest of the rounds.
    residual : float
        Largest (m/s), as :func:`noslip.check` finds it.
    via, via_turn : float
        Largest distance (m) and angle (rad) from the pose to pass.
    end : float
        Largest distance of an end from the one that was drawn, over the path.
    fallback : float
        Share of samples that did not arrive and were projected exactly.
    apart, apart_turn : float
        From the exact projection: largest distance over the path, and angle (rad), medians.
    """

    count: int
    seconds: float
    exact_seconds: float
    residual: float
    via: float
    via_turn: float
    end: float
    fallback: float
    apart: float
    apart_turn: float

    @property
    def ratio(self) -> float:
        """How many samples one exact projection takes the time of."""
        return self.exact_seconds / self.seconds


def excisions(count: int = 8, seed: int = 7) -> list[ns.PoseTrajectory]:
    """Return the demonstrations of ``noslip demo``."""
    return [
        ns.prepare(
            recording,
            tool_frame=TOOL_FRAME,
            trim_speed=TRIM_SPEED,
            rate=RATE,
            lowpass=PAPER_CUTOFF,
            relative=True,
        )
        for recording in synthetic_excisions(seed=seed, count=count)
    ]


def contours(folder: Path) -> list[ns.PoseTrajectory]:
    """Return the recorded runs along a contour at one placement."""
    names = [
        folder / "contour_following" / f"data_demo_{run}.csv"
        for run in ("c_1", "c_2", "d_1", "d_2")
    ]
    return [
        ns.prepare(run, trim_speed=0.05, rate=120, lowpass=4.8)
        for run in ns.load_demonstrations(names)
    ]


def needles(folder: Path) -> list[ns.PoseTrajectory]:
    """Return recorded insertions of a needle, from where each starts."""
    runs = ns.load_demonstrations(folder / "needle_insertion" / "*.csv", rate=14.5)
    return [ns.prepare(run, relative=True) for run in runs]


def likelihoods(
    demonstrations: Sequence[ns.PoseTrajectory], constraint: ns.Constraint
) -> Iterator[Likelihood]:
    """Yield what each demonstration is to the others."""
    system = as_system(constraint)
    feasible = [projected(d, system, ENDS, 100) for d in demonstrations]
    for k, left_out in enumerate(feasible):
        others = [d for j, d in enumerate(feasible) if j != k]
        primitive = ns.learn([d for j, d in enumerate(demonstrations) if j != k], constraint)
        learned = MotionDistribution.about(primitive, others)
        known = np.array([deviations(d, learned.reference) for d in others])
        unseen = deviations(left_out, learned.reference)
        peers = [_promp(known, unseen, n, unit) for n in PEER_WEIGHTS for unit in (False, True)]
        theirs, hindsight = np.max(peers, axis=0)
        yield Likelihood(
            demonstrations[k].name, learned.log_likelihood(left_out), theirs, hindsight
        )


def _promp(known: Floats, unseen: Floats, weights: int, unit: bool) -> tuple[float, float]:
    """ProMP's log-density of a motion, nats a value: with its own noise, and with the best."""
    from movement_primitives.promp import ProMP

    scale = known.std(axis=(0, 1)) if unit else np.ones(known.shape[2])
    middle = known.mean(axis=(0, 1))
    peer = ProMP(known.shape[2], weights)
    peer.imitate([FRACTIONS.copy() for _ in known], (known - middle) / scale)
    values, vectors = np.linalg.eigh(peer.cov_trajectory(FRACTIONS.copy()))
    mean = peer.mean_trajectory(FRACTIONS.copy())
    off = vectors.T @ ((unseen - middle) / scale - mean).T.ravel()

    def score(noise: float) -> float:
        variances = np.maximum(values, 0.0) + noise
        density = -0.5 * np.sum(off**2 / variances + np.log(2 * np.pi * variances))
        return float(density / off.size - np.log(scale).mean())

    return score(peer.variance), max(score(noise) for noise in NOISES)


def sampling(learned: MotionDistribution, count: int, rounds: int, exact: int = 8) -> Sampling:
    """Draw motions that pass a pose, and project some of the same exactly, in turn."""
    mean, spread = learned.motion, learned.spread
    k, at = round(VIA * (len(mean) - 1)), round(VIA * (len(FRACTIONS) - 1))
    aside = ASIDE * spread.position_deviation[at]
    turned = Rotation.from_rotvec(TURNED * spread.rotation_deviation[at])
    # Along the path a tool passes a pose earlier or later; aside it must go elsewhere.
    pose = ns.Boundary(VIA, mean.positions[k] + aside, turned * mean.rotations[k])
    given = learned.condition(pose)
    given.sample(2)

    fast, slow = np.inf, np.inf
    residual = via = via_turn = end = lost = 0.0
    apart: list[tuple[float, float]] = []
    lot = max(exact, count // rounds)
    for index in range(rounds):
        begun = process_time()
        motions = given.sample(lot, seed=index)
        fast = min(fast, (process_time() - begun) / lot)
        drawn = given.drawn(lot, seed=index)
        lost += float((~given.retraction(drawn.transpose(1, 2, 0)).arrived).sum())
        requests = []
        for number in range(exact):
            trajectory = given.trajectory(drawn[number], "drawn")
            requests.append(
                Request(trajectory, given.system, given.boundaries(trajectory), ADAPTING)
            )
        begun = process_time()
        results = [project(request) for request in requests]
        slow = min(slow, (process_time() - begun) / exact)

        for motion in (motions[number] for number in range(lot)):
            residual = max(residual, *(r.peak for r in ns.check(motion, given.system).constraints))
        via = max(via, float(np.abs(motions.positions[:, k] - pose.position).max()))
        passed = Rotation.from_quat(motions.quaternions[:, k], scalar_first=True)
        via_turn = max(via_turn, float((passed * pose.rotation.inv()).magnitude().max()))
        ends = np.linalg.norm(motions.positions[:, -1] - drawn[:, -1, :3], axis=1)
        end = max(end, float((ends / motions.path_lengths).max()))
        for number, result in enumerate(results):
            off, angles = ns.verification.deviations(motions[number], result.trajectory)
            apart.append((off.max() / mean.path_length, angles.max()))
    off, angle = np.median(apart, axis=0)
    return Sampling(
        count=lot * rounds,
        seconds=fast,
        exact_seconds=slow,
        residual=residual,
        via=via,
        via_turn=via_turn,
        end=end,
        fallback=lost / (lot * rounds),
        apart=float(off),
        apart_turn=float(angle),
    )


def coverage(
    truth: MotionDistribution, count: int, repetitions: int, unseen: int
) -> dict[tuple[float, float | None], list[float]]:
    """Share of motions of a known distribution within intervals learned from a few.

    By level and confidence, a share a repetition: each learns from other demonstrations.
    """
    fresh = truth.sample(unseen, seed=10_000)
    found: dict[tuple[float, float | None], list[float]] = {
        (level, confidence): [] for level in LEVELS for confidence in (None, CONFIDENCE)
    }
    for seed in range(repetitions):
        drawn = truth.sample(count, seed=seed)
        learned = MotionDistribution.about(truth.primitive, [drawn[k] for k in range(count)])
        off = [deviations(fresh[k], learned.reference) - learned.middle for k in range(unseen)]
        for (level, confidence), shares in found.items():
            width = learned.interval(level, confidence)
            shares.append(float((np.abs(off) <= width).mean()))
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.distributions")
    parser.add_argument("--samples", type=int, default=10_000)
    parser.add_argument("--repetitions", type=int, default=20, help="of the coverage")
    parser.add_argument("--recordings", type=Path, help="folder of recordings to judge, too")
    options = parser.parse_args(arguments)
    warnings.simplefilter("ignore", NoslipWarning)
    console = Console(width=None if sys.stdout.isatty() else 110)

    sets: dict[str, tuple[list[ns.PoseTrajectory], ns.Constraint]] = {
        "demo excisions": (excisions(), ns.Blade())
    }
    if options.recordings:
        sets["contour"] = (contours(options.recordings), ns.Blade())
        needle = ns.Needle(shaft="-x", curvature=None)
        sets["needle"] = (needles(options.recordings), needle)
    table = Table(
        title="Log-likelihood of each under the others, nats a value", box=box.SIMPLE_HEAD
    )
    for name in ("set", "demonstration", "noslip", "ProMP", "its noise chosen in hindsight"):
        table.add_column(name, justify="left" if name in ("set", "demonstration") else "right")
    for name, (demonstrations, constraint) in sets.items():
        for one in likelihoods(demonstrations, constraint):
            numbers = (one.ours, one.theirs, one.hindsight)
            table.add_row(name, one.name[-28:], *(f"{x:.2f}" for x in numbers))
    console.print(table)

    shown = sets["demo excisions"][0]
    learned = learn_distribution(ns.learn(shown, ns.Blade()), shown)
    cost = sampling(learned, options.samples, max(1, options.samples // 500))
    table = Table(title=f"{cost.count} samples through a pose", box=box.SIMPLE_HEAD)
    for what, number in {
        "a sample (CPU ms)": 1e3 * cost.seconds,
        "its exact projection (CPU ms)": 1e3 * cost.exact_seconds,
        "ratio": cost.ratio,
        "largest slip (m/s)": cost.residual,
        "pose passed within (m)": cost.via,
        "and (rad)": cost.via_turn,
        "ends off the drawn ones by, of the path": cost.end,
        "projected exactly, share": cost.fallback,
        "from the exact projection, of the path (median)": cost.apart,
        "and (rad)  ": cost.apart_turn,
    }.items():
        table.add_row(what, f"{number:.3g}")
    console.print(table)

    tables: dict[float | None, Table] = {}
    for confidence, title in (
        (None, "Share of motions within stated intervals: mean, least of the sets"),
        (CONFIDENCE, f"The same with confidence {CONFIDENCE:.0%}: mean, sets that hold the level"),
    ):
        tables[confidence] = Table(title=title, box=box.SIMPLE_HEAD)
        for name in ("demonstrations", *(f"{level:.0%}" for level in LEVELS)):
            tables[confidence].add_column(name, justify="right")
    for count in (5, 8, 16):
        shares = coverage(learned, count, options.repetitions, 100)
        for confidence, table in tables.items():
            cells = []
            for level in LEVELS:
                found = np.array(shares[level, confidence])
                second = found.min() if confidence is None else np.mean(found >= level)
                cells.append(f"{found.mean():.1%}, {second:.1%}")
            table.add_row(str(count), *cells)
    for table in tables.values():
        console.print(table)
    return 0


if __name__ == "__main__":
    single_threaded()
    sys.exit(main())
