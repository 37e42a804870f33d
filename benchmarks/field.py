"""The field's data sets: ``python -m benchmarks.field --data FOLDER``.

LASA (30 handwritten shapes of 7 demonstrations; Khansari-Zadeh and Billard, IEEE T-RO 2011),
HelloWorld (7 letters of 8) and RoboTasks (tasks of 9; both Auddy et al., RAS 2023), in the folder
that holds them: a clone of github.com/sayantanauddy/clfd has all three.  A primitive is learned
of each demonstration, or one of all, begun where each begins.  What it does is compared with that
demonstration as the data sets' papers do: dynamic time warping and the discrete Frechet distance
over the samples, in the data's own units.  Planar shapes are also driven by a wheel, which must
point along its way.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
from rich.console import Console
from rich.table import Table
from scipy.spatial.transform import Rotation

import noslip as ns
from benchmarks.environment import environment
from noslip._typing import Floats
from noslip.constraints.check import step_residuals

UNIT = 1e-3
"""Metres in a unit of the data: the screen of LASA is some 100 mm wide."""
SECONDS = 5.0
"""Where a data set has no times."""
SAMPLES = 200
"""Of each motion, compared: time warping sums over them, and takes the square of their number."""
WIDTH = 132
"""Columns of the table."""
SLOW = 0.05
"""Of the greatest speed: below it the direction of travel is that before or after."""


@dataclass(frozen=True)
class Found:
    """One method on one shape: means over its demonstrations, in the data's units and SI."""

    data: str
    shape: str
    method: str
    dtw: float
    frechet: float
    end: float
    degrees: float
    slip: float
    seconds: float
    failed: int


def lasa(folder: Path) -> Iterator[tuple[str, list[ns.Trajectory]]]:
    """The planar shapes of LASA, with their own times."""
    for file in sorted(folder.rglob("LASA/DataSet/*.mat")):
        demos = scipy.io.loadmat(file, squeeze_me=True)["demos"]
        yield (
            file.stem,
            [
                ns.Trajectory(demo["t"].item(), UNIT * demo["pos"].item().T, names=("x", "y"))
                for demo in demos
            ],
        )


def hello_world(folder: Path) -> Iterator[tuple[str, list[ns.Trajectory]]]:
    """The planar letters of HelloWorld."""
    for file in sorted(folder.rglob("robot_hello_world/processed_demos/*.npy")):
        yield (
            file.stem,
            [
                ns.Trajectory(np.linspace(0, SECONDS, len(demo)), UNIT * demo, names=("x", "y"))
                for demo in np.load(file)
            ],
        )


def robot_tasks(folder: Path) -> Iterator[tuple[str, list[ns.PoseTrajectory]]]:
    """The poses of RoboTasks: centimetres, and quaternions with their real part first."""
    for file in sorted(folder.rglob("robottasks/pos_ori/*.npy")):
        yield (
            file.stem,
            [
                ns.PoseTrajectory(
                    np.linspace(0, SECONDS, len(demo)),
                    10 * UNIT * demo[:, :3],
                    Rotation.from_quat(demo[:, 3:], scalar_first=True),
                )
                for demo in np.load(file)
            ],
        )


def driven(planar: ns.Trajectory) -> ns.PoseTrajectory:
    """A planar path as poses that point along it, where it moves."""
    velocities = np.gradient(planar.values, planar.times, axis=0)
    speeds = np.linalg.norm(velocities, axis=1)
    moves = np.flatnonzero(speeds > SLOW * speeds.max())
    headings = np.unwrap(np.arctan2(velocities[moves, 1], velocities[moves, 0]))
    headings = np.interp(np.arange(len(planar)), moves, headings)
    return ns.PoseTrajectory(
        planar.times,
        np.column_stack([planar.values, np.zeros(len(planar))]),
        Rotation.from_euler("z", headings[:, None]),
    )


def ours(constraints: Sequence[ns.Constraint]) -> Callable[[Sequence[Any]], list[Any]]:
    """A primitive of each demonstration."""
    return lambda demos: [ns.learn(demo, constraints).rollout() for demo in demos]


def generalized(constraints: Sequence[ns.Constraint]) -> Callable[[Sequence[Any]], list[Any]]:
    """One primitive of all demonstrations, begun where each begins, in its time."""

    def moved(demos: Sequence[Any]) -> list[Any]:
        dmp = ns.learn(demos, constraints)
        return [begun(dmp, demo) for demo in demos]

    return moved


def begun(dmp: Any, demo: Any) -> Any:
    """Its motion from where a demonstration begins, to where all end; None where it is refused."""
    try:
        if dmp.rule.system.constraints:
            return dmp.adapt(start_position=demo.positions[0], duration=demo.duration).rollout()
        start = (demo.positions[0], demo.rotations[0]) if is_pose(demo) else demo.values[0]
        return dmp.rollout(start=start, duration=demo.duration)
    except ns.NoslipError as error:
        print(f"{demo.name}: {error}", file=sys.stderr)
        return None


def is_pose(motion: Any) -> bool:
    return isinstance(motion, ns.PoseTrajectory)


def theirs(demos: Sequence[ns.Trajectory]) -> list[ns.Trajectory]:
    """movement-primitives' DMP of each demonstration, of as many weights."""
    from movement_primitives.dmp import DMP

    moved = []
    for demo in demos:
        times = demo.times - demo.times[0]
        step = demo.duration / (len(demo) - 1)
        weights = ns.learn(demo).law.basis.count
        dmp = DMP(2, execution_time=demo.duration, dt=step, int_dt=step, n_weights_per_dim=weights)
        dmp.imitate(times, demo.values)
        then, values = dmp.open_loop()
        moved.append(ns.Trajectory(then, values, names=("x", "y")))
    return moved


def places(motion: Any) -> Floats:
    """Where it is at so many instants of its time, in the data's units, shape (SAMPLES, n)."""
    values = motion.positions if is_pose(motion) else motion.values
    instants = np.linspace(motion.times[0], motion.times[-1], SAMPLES)
    found = np.column_stack([np.interp(instants, motion.times, each) for each in values.T])
    kept: Floats = np.ascontiguousarray(found / UNIT)
    return kept


def compare(
    data: str,
    shape: str,
    method: str,
    demos: Sequence[Any],
    moves: Callable[[Sequence[Any]], list[Any]],
) -> Found:
    """Have a method move, and compare with each demonstration."""
    from dtaidistance import dtw_ndim
    from similaritymeasures import frechet_dist

    begin = time.perf_counter()
    moved = moves(demos)
    seconds = time.perf_counter() - begin
    rows = []
    for demo, motion in zip(demos, moved, strict=True):
        if motion is None:
            continue
        there, here = places(demo), places(motion)
        slip = degrees = 0.0
        if is_pose(motion):
            turned = motion.rotations.inv() * demo.resampled(times=motion.clock).rotations
            degrees = float(np.degrees(turned.magnitude()).mean())
            slip = float(np.abs(step_residuals(motion, [ns.Wheel()])).max())
        rows.append(
            (
                dtw_ndim.distance(there, here, inner_dist="euclidean", use_c=True),
                frechet_dist(there, here),
                float(np.linalg.norm(there[-1] - here[-1])),
                degrees,
                slip,
            )
        )
    dtw, frechet, end, degrees, _ = np.mean(rows, axis=0) if rows else [np.nan] * 5
    slip = max((row[-1] for row in rows), default=np.nan)
    failed = len(demos) - len(rows)
    return Found(data, shape, method, dtw, frechet, end, degrees, slip, seconds, failed)


def rows(folder: Path) -> Iterator[Found]:
    """Every data set that lies in the folder, every method that can take it."""
    wheel = [ns.Wheel()]
    for data, shapes in (("LASA", lasa(folder)), ("HelloWorld", hello_world(folder))):
        for shape, demos in shapes:
            named = [replace(demo, name=f"{shape} {k}") for k, demo in enumerate(demos, start=1)]
            wheeled = list(map(driven, named))
            yield compare(data, shape, "noslip", named, ours(()))
            yield compare(data, shape, "movement-primitives", named, theirs)
            yield compare(data, shape, "noslip, Wheel", wheeled, ours(wheel))
            yield compare(data, shape, "noslip, of all", named, generalized(()))
            yield compare(data, shape, "noslip, of all, Wheel", wheeled, generalized(wheel))
    for shape, demos in robot_tasks(folder):
        yield compare("RoboTasks", shape, "noslip", demos, ours(()))
        yield compare("RoboTasks", shape, "noslip, of all", demos, generalized(()))


def show(found: Sequence[Found]) -> None:
    """A line for each data set and method: medians over shapes, the worst slip, what failed."""
    table = Table(title="against each demonstration; medians over shapes")
    for name in ("data", "method", "shapes", "DTW", "Frechet", "end", "turn (deg)"):
        table.add_column(name, justify="right")
    for name in ("slip, worst (m/s)", "learn and move (s)", "refused"):
        table.add_column(name, justify="right")
    for data, method in dict.fromkeys((each.data, each.method) for each in found):
        own = [each for each in found if (each.data, each.method) == (data, method)]

        def median(what: str, own: list[Found] = own) -> float:
            return float(np.nanmedian([getattr(each, what) for each in own]))

        worst = max(each.slip for each in own)
        table.add_row(
            data,
            method,
            str(len(own)),
            *(f"{median(what):.3g}" for what in ("dtw", "frechet", "end")),
            f"{median('degrees'):.2f}" if "Wheel" in method or data == "RoboTasks" else "",
            f"{worst:.1e}" if "Wheel" in method else "",
            f"{median('seconds'):.2f}",
            str(sum(each.failed for each in own)),
        )
    Console(width=WIDTH).print(table)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.field", description=__doc__)
    parser.add_argument("--data", type=Path, required=True, help="folder that has the data sets")
    parser.add_argument("--json", type=Path, help="write every shape's figures here")
    chosen = parser.parse_args(arguments)
    found = []
    for row in rows(chosen.data):
        found.append(row)
        print(f"{row.data} {row.shape}, {row.method}: DTW {row.dtw:.4g}", file=sys.stderr)
    if not found:
        print(f"{chosen.data}: none of the data sets is in it; see --help", file=sys.stderr)
        return 2
    show(found)
    print(json.dumps(environment(), indent=1))
    if chosen.json:
        told = {"environment": environment(), "shapes": [asdict(each) for each in found]}
        chosen.json.write_text(json.dumps(told, indent=1))
    return int(any(each.failed for each in found))


if __name__ == "__main__":
    sys.exit(main())
