"""The field's data sets: ``python -m benchmarks.field --data FOLDER``.

LASA (30 handwritten shapes of 7 demonstrations; Khansari-Zadeh and Billard, IEEE T-RO 2011),
HelloWorld (7 letters of 8) and RoboTasks (4 tasks of 9; both Auddy et al., RAS 2023), in the folder
that holds them: a clone of github.com/sayantanauddy/clfd has all three.  With them the recordings
of a hand that led a tool along a contour (``--recordings``).  What is absent is skipped, and said.

A primitive is learned of each demonstration, or one of all of a shape, begun where each begins.
What it does is compared with that demonstration as the code published with Auddy et al. does: over
1000 samples each, in the data's own unit, dynamic time warping, the discrete Fréchet distance, and
for planar shapes the swept area.  Planar shapes are also driven by a wheel, which must point along
its way, and the contour by a blade.  No random numbers are drawn.  The exit code is 1 if anything
was refused.
"""

from __future__ import annotations

import argparse
import json
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from time import process_time
from typing import Any

from benchmarks import single_threaded

single_threaded()

import numpy as np  # noqa: E402
import scipy.io  # noqa: E402
from rich import box  # noqa: E402
from rich.console import Console  # noqa: E402
from rich.table import Table  # noqa: E402
from scipy.spatial.transform import Rotation  # noqa: E402

import noslip as ns  # noqa: E402
from benchmarks import peers  # noqa: E402
from benchmarks.environment import environment  # noqa: E402
from benchmarks.likeness import frechet, swept_area, warping  # noqa: E402
from noslip._typing import Floats  # noqa: E402
from noslip.constraints.check import step_residuals  # noqa: E402

RECORDINGS = Path(__file__).resolve().parents[2] / "shared" / "data"
MILLIMETER, CENTIMETER = 1e-3, 1e-2
SECONDS = 5.0
"""Where a data set has no times."""
LOWPASS = 2.0
"""Hz, as the contour is learned in the other benchmarks."""
SAMPLES = 1000
"""Of each motion, compared: as many as the data sets have, and warping sums over them."""
WIDTH = 300
"""Columns of the table."""
REFUSED = "refused: "
SLOW = 0.05
"""Of the greatest speed: below it the direction of travel is that before or after."""

Motion = Any
"""A trajectory of vectors or of poses."""
Moves = Callable[[Sequence[Motion]], list[Motion | None]]
"""What a method makes of demonstrations: a motion for each, None where it is refused."""


@dataclass(frozen=True)
class Shape:
    """Demonstrations of one motion, and the meters in a unit of their data."""

    data: str
    name: str
    demos: Sequence[Motion]
    unit: float


@dataclass(frozen=True)
class Found:
    """One method on one shape: means over its demonstrations, in the data's unit.

    ``slip`` is the worst (m/s), ``rate`` the fastest turn (rad/s); ``seconds`` are processor time a
    demonstration; ``told`` is what was refused or warned of.  None where there is no such number.
    """

    data: str
    shape: str
    method: str
    dtw: float | None = None
    frechet: float | None = None
    area: float | None = None
    end: float | None = None
    degrees: float | None = None
    slip: float | None = None
    rate: float | None = None
    seconds: float | None = None
    refused: int = 0
    told: list[str] = field(default_factory=list)


# ---------------------------------------------------------------- data


def lasa(folder: Path) -> Iterator[Shape]:
    """The planar shapes of LASA, with their own times; four hold several patterns each."""
    for file in sorted(folder.rglob("DataSet/*.mat")):
        demos = scipy.io.loadmat(file, squeeze_me=True)["demos"]
        moves = [(demo["t"].item(), MILLIMETER * demo["pos"].item().T) for demo in demos]
        data = "LASA, several patterns" if file.stem.startswith("Multi") else "LASA"
        yield Shape(data, file.stem, _planar(file.stem, moves), MILLIMETER)


def hello_world(folder: Path) -> Iterator[Shape]:
    """The planar letters of HelloWorld."""
    for file in sorted(folder.rglob("robot_hello_world/processed_demos/*.npy")):
        moves = [(_times(demo), CENTIMETER * demo) for demo in np.load(file)]
        yield Shape("HelloWorld", file.stem, _planar(file.stem, moves), CENTIMETER)


def robot_tasks(folder: Path) -> Iterator[Shape]:
    """The poses of RoboTasks: quaternions with their real part first."""
    for file in sorted(folder.rglob("robottasks/pos_ori/*.npy")):
        demos = [
            ns.PoseTrajectory(
                _times(demo),
                CENTIMETER * demo[:, :3],
                Rotation.from_quat(demo[:, 3:], scalar_first=True),
                name=f"{file.stem} {number}",
            )
            for number, demo in enumerate(np.load(file), start=1)
        ]
        yield Shape("RoboTasks", file.stem, demos, CENTIMETER)


def contour(recordings: Path) -> Iterator[Shape]:
    """A hand that led a tool along a contour, each time placed elsewhere."""
    for file in sorted(recordings.glob("contour_following/*.csv")):
        [recorded] = ns.load_demonstrations(file)
        name = file.stem.removeprefix("data_demo_")
        demo = replace(ns.prepare(recorded, lowpass=LOWPASS), name=f"contour {name}")
        yield Shape("contour", name, [demo], MILLIMETER)


def _planar(shape: str, moves: Sequence[tuple[Floats, Floats]]) -> list[ns.Trajectory]:
    return [
        ns.Trajectory(times, values, names=("x", "y"), name=f"{shape} {number}")
        for number, (times, values) in enumerate(moves, start=1)
    ]


def _times(samples: Floats) -> Floats:
    return np.linspace(0, SECONDS, len(samples))


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
        name=planar.name,
    )


# ---------------------------------------------------------------- methods


def ours(constraints: Sequence[ns.Constraint] = ()) -> Moves:
    """A primitive of each demonstration."""
    return lambda demos: [
        _unless_refused(demo.name, lambda demo=demo: ns.learn(demo, constraints).rollout())
        for demo in demos
    ]


def generalized(constraints: Sequence[ns.Constraint] = ()) -> Moves:
    """One primitive of all demonstrations, begun where each begins, in its time."""

    def moved(demos: Sequence[Motion]) -> list[Motion | None]:
        dmp = _unless_refused(f"all of {demos[0].name}", lambda: ns.learn(demos, constraints))
        if dmp is None:
            return [None] * len(demos)
        return [_unless_refused(demo.name, partial(begun, dmp, demo)) for demo in demos]

    return moved


def begun(dmp: Any, demo: Motion) -> Motion:
    """Its motion from where a demonstration begins, in its time."""
    if dmp.rule.system.constraints:
        return dmp.adapt(start_position=demo.positions[0], duration=demo.duration).rollout()
    start = (demo.positions[0], demo.rotations[0]) if is_pose(demo) else demo.values[0]
    return dmp.rollout(start=start, duration=demo.duration)


def theirs(weights: Sequence[int]) -> Moves:
    """movement-primitives' primitive of each demonstration, of so many weights."""

    def moved(demos: Sequence[Motion]) -> list[Motion | None]:
        return [_imitated(demo, count) for demo, count in zip(demos, weights, strict=True)]

    return moved


def _imitated(demo: Motion, weights: int) -> Motion:
    """Its own defaults in all else, the step of its integration (1 ms) included."""
    from movement_primitives.dmp import DMP, CartesianDMP

    timing = {"execution_time": demo.duration, "dt": demo.duration / (len(demo) - 1)}
    if is_pose(demo):
        dmp = CartesianDMP(**timing, n_weights_per_dim=weights)
        dmp.imitate(*peers.imitation(demo))
        return peers.rollout(dmp)
    dmp = DMP(demo.values.shape[1], **timing, n_weights_per_dim=weights)
    dmp.imitate(demo.clock, demo.values)
    times, values = dmp.open_loop()
    return ns.Trajectory(times, values, names=demo.names)


def _unless_refused(name: str, make: Callable[[], Any]) -> Any:
    """What is made, or None, with a warning that tells why not."""
    try:
        return make()
    except ns.NoslipError as error:
        warnings.warn(f"{REFUSED}{name}: {error}", ns.NoslipWarning, stacklevel=2)
        return None


def is_pose(motion: Motion) -> bool:
    return isinstance(motion, ns.PoseTrajectory)


# ---------------------------------------------------------------- comparing


def compare(
    shape: Shape,
    method: str,
    moves: Moves,
    demos: Sequence[Motion] | None = None,
    constraint: ns.Constraint | None = None,
) -> Found:
    """Have a method move, and compare with each demonstration."""
    demos = shape.demos if demos is None else demos
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", ns.NoslipWarning)
        begin = process_time()
        moved = moves(demos)
        seconds = process_time() - begin
    told = list(dict.fromkeys(str(each.message) for each in caught))
    pairs = [pair for pair in zip(demos, moved, strict=True) if pair[1] is not None]
    found = Found(shape.data, shape.name, method, refused=len(demos) - len(pairs), told=told)
    if not pairs:
        return found
    merits = [_merit(demo, motion, shape.unit) for demo, motion in pairs]
    slips, rates = [], []
    if constraint:
        slips = [np.abs(step_residuals(motion, [constraint])).max() for _, motion in pairs]
        turning = [motion.step_velocities()[1] for _, motion in pairs]
        rates = [np.linalg.norm(angular, axis=1).max() for angular in turning]
    return replace(
        found,
        **{name: _mean([merit[name] for merit in merits]) for name in merits[0]},
        slip=float(max(slips)) if slips else None,
        rate=float(max(rates)) if rates else None,
        seconds=seconds / len(demos),
    )


def _merit(demo: Motion, motion: Motion, unit: float) -> dict[str, float | None]:
    """Figures of one motion, in the data's unit."""
    demo, motion = _sampled(demo), _sampled(motion)
    there, here = (each.positions / unit for each in (demo, motion))
    turned = (motion.rotations.inv() * demo.rotations).magnitude() if is_pose(demo) else None
    planar = not np.ptp(there[:, 2:], axis=0).any()
    return {
        "dtw": warping(there, here),
        "frechet": frechet(there, here),
        "area": swept_area(there[:, :2], here[:, :2]) if planar else None,
        "end": float(np.linalg.norm(there[-1] - here[-1])),
        "degrees": None if turned is None else float(np.degrees(turned.mean())),
    }


def _sampled(motion: Motion) -> Motion:
    """At so many instants of its time."""
    return motion.resampled(times=np.linspace(*motion.times[[0, -1]], SAMPLES))


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def rows(folder: Path, recordings: Path) -> Iterator[Found]:
    """Every data set that is there, every method that can take it."""
    wheel, blade = ns.Wheel(), ns.Blade()
    for shape in (*lasa(folder), *hello_world(folder)):
        wheeled = list(map(driven, shape.demos))
        yield from _alone(shape)
        yield compare(shape, "noslip, Wheel", ours([wheel]), wheeled, wheel)
        yield compare(shape, "noslip, of all", generalized())
        yield compare(shape, "noslip, of all, Wheel", generalized([wheel]), wheeled, wheel)
    for shape in robot_tasks(folder):
        yield from _alone(shape)
        yield compare(shape, "noslip, of all", generalized())
    for shape in contour(recordings):
        yield from _alone(shape, blade)
        yield compare(shape, "noslip, Blade", ours([blade]), constraint=blade)


def _alone(shape: Shape, constraint: ns.Constraint | None = None) -> Iterator[Found]:
    """Without constraints, ours and theirs of as many weights; what they slip, where asked."""
    yield compare(shape, "noslip", ours(), constraint=constraint)
    if not peers.MISSING:
        weights = [ns.learn(demo).law.basis.count for demo in shape.demos]
        yield compare(shape, "movement-primitives", theirs(weights), constraint=constraint)


# ---------------------------------------------------------------- telling


def show(found: Sequence[Found]) -> None:
    """A line for each data set and method, then what was refused."""
    table = Table(
        title="Against each demonstration: median over shapes (least to most)", box=box.MARKDOWN
    )
    table.add_column("data, method")
    for name in ("shapes", "DTW", "Fréchet", "swept area", "end", "turned (deg)"):
        table.add_column(name, justify="right")
    for name in ("slip, most (m/s)", "fastest turn (rad/s)", "s a demonstration"):
        table.add_column(name, justify="right")
    for name in ("refused", "warned", "worst DTW"):
        table.add_column(name, justify="right")
    for data, method in dict.fromkeys((each.data, each.method) for each in found):
        own = [each for each in found if (each.data, each.method) == (data, method)]
        slips = [each.slip for each in own if each.slip is not None]
        table.add_row(
            f"{data}, {method}",
            str(len(own)),
            *(_range(own, what) for what in ("dtw", "frechet", "area", "end", "degrees")),
            f"{max(slips):.1e}" if slips else "",
            _range(own, "rate"),
            _range(own, "seconds"),
            str(sum(each.refused for each in own)),
            str(sum(bool(each.told) for each in own)),
            max(own, key=lambda each: each.dtw or 0.0).shape,
        )
    Console(width=WIDTH).print(table)
    for each in found:
        for message in each.told:
            if message.startswith(REFUSED):
                print(f"{each.data} {each.shape}, {each.method}: {message}")


def _range(found: Sequence[Found], what: str) -> str:
    values = [getattr(each, what) for each in found if getattr(each, what) is not None]
    if not values:
        return ""
    middle, least, most = map(_figure, (np.median(values), min(values), max(values)))
    return f"{middle} ({least} to {most})"


def _figure(value: float) -> str:
    """Two digits, in full where that is short."""
    if value and not 1e-3 <= abs(value) < 1e5:
        return f"{value:.0e}"
    return np.format_float_positional(value, 2, unique=False, fractional=False, trim="-")


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.field", description=__doc__)
    parser.add_argument("--data", type=Path, required=True, help="folder that has the data sets")
    parser.add_argument(
        "--recordings",
        type=Path,
        default=RECORDINGS,
        help="folder that has contour_following/*.csv (default: %(default)s)",
    )
    parser.add_argument("--json", type=Path, help="write every shape's figures here")
    chosen = parser.parse_args(arguments)
    if peers.MISSING:
        print(peers.MISSING, file=sys.stderr)
    found = []
    for row in rows(chosen.data, chosen.recordings):
        found.append(row)
        print(f"{row.data} {row.shape}, {row.method}: DTW {row.dtw}", file=sys.stderr, flush=True)
    there = {each.data for each in found}
    for data in {"LASA", "HelloWorld", "RoboTasks"} - there:
        print(f"{data} is skipped: {chosen.data} does not hold it; see --help", file=sys.stderr)
    if "contour" not in there:
        print(f"contour is skipped: {chosen.recordings} does not hold it", file=sys.stderr)
    if not there:
        return 2
    show(found)
    print(json.dumps(environment(), indent=1))
    if chosen.json:
        told = {"environment": environment(), "shapes": [asdict(each) for each in found]}
        chosen.json.write_text(json.dumps(told, indent=1, allow_nan=False) + "\n")
    return int(any(each.refused for each in found))


if __name__ == "__main__":
    sys.exit(main())
