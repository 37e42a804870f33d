"""Chunks of recorded tools, with noise, through a shield: ``python -m benchmarks.shield``.

Each stream is a random part of a recording in ``../shared/data``, resampled to 30 Hz, as it was
recorded or first projected onto its constraint; its chunks of 16, 50 or 100 poses get noise of 1 mm
along each axis and 0.6 degrees about each, and a random share of each is executed.  A chunk fails
if anything is raised, if what is executed slips by more than 1e-10 m/s (across joins, too), or if
it ends more than 20 mm or 23 degrees off and nothing is said of that.
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
import time
import warnings
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import noslip as ns
from benchmarks import single_threaded
from noslip.constraints.check import step_residuals
from noslip.errors import NoslipWarning

RECORDINGS = Path(__file__).resolve().parents[2] / "shared" / "data"
RATE, NOISE, TURN_NOISE = 30.0, 1e-3, np.radians(0.6)
SIZES = (16, 50, 100)
STREAM = 20
"""Chunks of one stream."""
SLIP, FAR, FAR_TURN = 1e-10, 0.02, 0.4
FAMILIES: dict[str, tuple[str, ns.Constraint, dict[str, float]]] = {
    "contour": ("contour_following", ns.Blade(), {}),
    "needle": ("needle_insertion", ns.Needle(shaft="-x", curvature=None), {"rate": 14.5}),
    "wheel": ("wheeled_robots", ns.Wheel(), {}),
}


@dataclass
class Tally:
    """What is counted of the chunks of one kind; arrays have one entry a pose, join or chunk."""

    chunks: int = 0
    failed: list[str] = field(default_factory=list)
    told: int = 0
    slip: float = 0.0
    arrays: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))

    def add(self, other: Tally) -> None:
        """Count what another one has counted, too."""
        self.chunks += other.chunks
        self.failed += other.failed
        self.told += other.told
        self.slip = max(self.slip, other.slip)
        for name, values in other.arrays.items():
            self.arrays[name].extend(values)


@lru_cache(maxsize=4)
def motions(family: str, feasible: bool) -> list[ns.PoseTrajectory]:
    """Recordings at 30 Hz, projected onto their constraint or not."""
    folder, constraint, loading = FAMILIES[family]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NoslipWarning)
        loaded = ns.load_demonstrations(RECORDINGS / folder / "*.csv", **loading)  # type: ignore[arg-type]
    found = [each.resampled(rate=RATE)[:900] for each in loaded]
    if not feasible:
        return found
    projected = [ns.project_trajectory(each, constraint, on_failure="return") for each in found]
    return [each.trajectory for each in projected if each.converged]


def stream(task: tuple[str, bool, int, int]) -> tuple[str, bool, int, Tally]:
    """Send one stream through a shield."""
    family, feasible, size, seed = task
    rng, several, tally = np.random.default_rng(seed), motions(family, feasible), Tally()
    motion = several[rng.integers(len(several))]
    shield, sent, done = ns.Shield(FAMILIES[family][1], rate=RATE), [], None
    k = int(rng.integers(max(1, len(motion) - size)))
    # Compiles.
    ns.Shield(shield.system, rate=RATE).chunk(_noisy(motion[:size], np.random.default_rng(0)))
    while k + size <= len(motion) and tally.chunks < STREAM:
        meant = motion[k : k + size]
        asked = _noisy(meant, rng)
        begun = time.process_time()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", NoslipWarning)
                found = shield.chunk(asked, done)
        except Exception as error:
            tally.failed.append(f"{task}: {type(error).__name__}: {error}")
            break
        tally.arrays["time"].append((time.process_time() - begun) * RATE / size)
        tally.chunks += 1
        tally.told += bool(shield.compromise)
        far = found.end_error > FAR or found.end_rotation_error > FAR_TURN
        if far and not shield.compromise:
            tally.failed.append(f"{task}: {found.end_error:.3g} m off, and nothing said")
        for name, reference in (("moved", asked), ("off", meant)):
            apart = np.linalg.norm(found.positions - reference.positions, axis=1)
            tally.arrays[name].extend(1e3 * apart)
            turns = (found.rotations * reference.rotations.inv()).magnitude()
            tally.arrays[f"{name} turn"].extend(np.degrees(turns))
        done = int(rng.integers(1, size + 1))
        sent.append((found, done))
        k += done
    _judge(task, sent, tally)
    return family, feasible, size, tally


def _noisy(motion: ns.PoseTrajectory, rng: np.random.Generator) -> ns.PoseTrajectory:
    shifts, turns = rng.normal(size=(2, len(motion), 3))
    rotations = Rotation.from_rotvec(TURN_NOISE * turns) * motion.rotations
    return replace(motion, positions=motion.positions + NOISE * shifts, rotations=rotations)


def _judge(task: Any, sent: Sequence[tuple[ns.Motion, int]], tally: Tally) -> None:
    """Slip, and changes of the twist, of what was executed."""
    if not sent:
        return
    times, positions, turns = (
        np.concatenate([getattr(motion, name)[:done] for motion, done in sent])
        for name in ("times", "positions", "quaternions")
    )
    if len(times) < 4:
        return
    motion = ns.PoseTrajectory(times, positions, Rotation.from_quat(turns, scalar_first=True))
    constraint = FAMILIES[task[0]][1]
    tally.slip = float(np.abs(step_residuals(motion, constraint)).max())
    if not tally.slip <= SLIP:
        tally.failed.append(f"{task}: slips by {tally.slip:.3g}")
    joined = np.zeros(len(times) - 2, dtype=bool)
    for k in np.cumsum([done for _, done in sent])[:-1]:
        joined[max(k - 2, 0) : k] = True
    for name, velocities in zip(("linear", "angular"), motion.step_velocities(), strict=True):
        changes = np.linalg.norm(np.diff(velocities, axis=0), axis=1)
        tally.arrays[f"{name} joined"].extend(changes[joined])
        tally.arrays[f"{name} elsewhere"].extend(changes[~joined])


def tasks(chunks: int) -> Iterator[tuple[str, bool, int, int]]:
    """Streams of all kinds in turn, enough for so many chunks."""
    kinds = [(family, ok, size) for family in FAMILIES for ok in (False, True) for size in SIZES]
    for seed in range(chunks // STREAM * 3 + len(kinds)):
        yield *kinds[seed % len(kinds)], seed


def table(tallies: dict[tuple[str, bool, int], Tally]) -> Iterator[str]:
    """Lines of Markdown, one a kind."""
    yield (
        "| recordings | poses | chunks | failed | told | slip, m/s | moved, mm (95 %) | "
        "degrees (95 %) | off what was meant, mm | degrees | twist's change at joins over that "
        "elsewhere | time (largest) |"
    )
    yield "|---|---|---|---|---|---|---|---|---|---|---|---|"
    for (family, feasible, size), tally in tallies.items():
        found = {name: np.array(values) for name, values in tally.arrays.items()}

        def both(name: str, found: dict[str, Any] = found) -> str:
            return f"{np.median(found[name]):.2f} ({np.quantile(found[name], 0.95):.2f})"

        def ratio(name: str, found: dict[str, Any] = found) -> str:
            rms = [np.sqrt(np.mean(found[f"{name} {w}"] ** 2)) for w in ("joined", "elsewhere")]
            return f"{rms[0] / rms[1]:.2f}"

        yield (
            f"| {family}, {'projected' if feasible else 'as recorded'} | {size} | {tally.chunks} | "
            f"{len(tally.failed)} | {tally.told} | {tally.slip:.0e} | {both('moved')} | "
            f"{both('moved turn')} | {np.median(found['off']):.2f} | "
            f"{np.median(found['off turn']):.2f} | {ratio('linear')}, {ratio('angular')} | "
            f"{np.median(found['time']):.1%} ({found['time'].max():.1%}) |"
        )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run so many chunks and print a table; the exit code is 1 if any failed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--chunks", type=int, default=1000)
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args(arguments)
    if not RECORDINGS.is_dir():
        print(f"skipped: no recordings in {RECORDINGS}")
        return 0
    tallies: dict[tuple[str, bool, int], Tally] = defaultdict(Tally)
    # Of the processes that are started.
    single_threaded()
    with multiprocessing.get_context("spawn").Pool(options.processes) as pool:
        for family, feasible, size, tally in pool.imap(stream, tasks(options.chunks), 8):
            tallies[family, feasible, size].add(tally)
            if sum(each.chunks for each in tallies.values()) >= options.chunks:
                break
        pool.terminate()
    print("\n".join(table(tallies)))
    failed = [line for each in tallies.values() for line in each.failed]
    print(f"\n{sum(each.chunks for each in tallies.values())} chunks, {len(failed)} failed")
    print("\n".join(failed[:20]), file=sys.stderr)
    return bool(failed)


if __name__ == "__main__":
    sys.exit(main())
