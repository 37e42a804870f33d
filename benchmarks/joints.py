"""Joints that carry a blade: ``python -m benchmarks.joints``.

Hands led a tool along a contour.  Placed before an arm of seven joints, inverse kinematics make
joints of each recording, and of these a primitive is learned whose tool must not slip.  Asked is
that it does not, that its tool keeps to the recorded path, that the joints keep their limits, that
they come to another goal when pushed, and what a step takes in C.  The exit code is 1 if one is not
as it must be.
"""

from __future__ import annotations

import argparse
import ctypes
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np
from scipy.spatial import cKDTree

import noslip as ns
from benchmarks.control_loop import compiling, in_c
from noslip import robots
from noslip._typing import Floats
from noslip.chain import Chain
from noslip.codegen import library
from noslip.constraints.check import step_residuals
from noslip.constraints.joints import JointLimits, joint_limits
from noslip.control import SpaceController

RECORDINGS = Path(__file__).resolve().parents[2] / "shared" / "data" / "contour_following"
LOWPASS = 2.0
"""Hz, as the other recordings are learned."""
SLIP, PATH, STEP = 1e-10, 1e-3, 5e-6
"""What is asked: m/s, m, s."""
FINE = 20_000
"""Points of a recorded path, from which distances are taken: half of their spacing is 15 um."""
NARROWER = 0.9
"""Share of its own range, in the primitive without limits, that is left to the joint that moves
most."""
PUSH, CYCLE, HELD_FOR, PATIENCE = 0.05, 0.01, 0.4, 10.0
"""rad, of each joint, and of its goal; s, of the loop and of the push; times the duration."""
END, PUSHED_SLIP = 1e-3, 1e-9
"""Of a joint's range, and m/s: what is asked of joints that are pushed."""
STEPS, CALLS = 200_000, 100_000
CANDIDATES = 60
"""Placements that are tried: the arm has room."""


@dataclass(frozen=True)
class Outcome:
    """What became of one recording; ``slipped`` is the person's own slip, a peak (m/s)."""

    name: str
    limits: str
    slipped: float
    slip: float
    path: float
    turned: float
    moved: float
    room: float
    rates: float
    seconds: float
    step: float

    @property
    def failures(self) -> list[str]:
        """What is not as it must be."""
        asked = {
            f"slips by {self.slip:.1e} m/s": self.slip <= SLIP,
            f"leaves the path by {1e3 * self.path:.2f} mm": self.path <= PATH,
            f"joints leave their range by {-self.room:.1e} of it": self.room >= 0,
            f"joints move at {self.rates:.2f} of their limits": self.rates <= 1,
            f"a step in C takes {1e6 * self.step:.2f} us": self.step <= STEP,
        }
        return [f"{self.name}, {self.limits}: {what}" for what, kept in asked.items() if not kept]


def recorded(path: Path, arm: robots.Robot, chain: Chain) -> ns.Trajectory:
    """A recording of the tool as joints of an arm, where the arm has most room."""
    [person] = ns.load_demonstrations(path)
    tool = ns.prepare(person, lowpass=LOWPASS)
    [best, *_] = robots.place(arm, tool, level="tool", candidates=CANDIDATES)
    joints = chain.inverse(best.placement.apply(tool), best.start)
    return ns.Trajectory(tool.times, joints, chain.joint_names, carrier=chain, name=path.stem)


def attempt(
    demonstration: ns.Trajectory,
    limits: str,
    constraints: Sequence[ns.Constraint],
    arm: robots.Robot,
) -> tuple[Outcome, Floats]:
    """Learn, roll out every millisecond, and step in C; with the motion's joints."""
    chain = demonstration.carrier
    assert chain is not None
    begun = time.process_time()
    dmp = ns.learn(demonstration, [ns.Blade(), *constraints], robot=chain)
    seconds = time.process_time() - begun
    motion = dmp.rollout(time_step=1e-3)
    tool, before = chain.poses(motion.times, motion.values), demonstration.tool
    ends = before.times[[0, -1]]
    fine = before.resampled(times=np.linspace(*ends, FINE))
    same_time = before.resampled(times=np.minimum(ends[0] + motion.times, ends[1]))
    turned = (tool.rotations * same_time.rotations.inv()).magnitude()
    there = demonstration.resampled(times=same_time.times).values
    rates = np.abs(np.diff(motion.values, axis=0)) / np.diff(motion.times)[:, None]
    outcome = Outcome(
        demonstration.name,
        limits,
        slipped=_slip(before),
        slip=_slip(tool),
        path=float(cKDTree(fine.positions).query(tool.positions)[0].max()),
        turned=float(np.sqrt(np.mean(turned**2))),
        moved=float(np.abs(motion.values - there).max()),
        room=float(_room(constraints, motion.values, arm)),
        rates=float((rates / chain.velocity_limits).max()),
        seconds=seconds,
        step=in_c(dmp, STEPS).median,
    )
    return outcome, motion.values


def _slip(tool: ns.PoseTrajectory) -> float:
    return float(np.abs(step_residuals(tool, ns.Blade())).max())


def _room(constraints: Sequence[ns.Constraint], joints: Floats, arm: robots.Robot) -> float:
    """Least share of a range that is left, of the arm's own and of those that are asked for."""
    room = [float(arm.room(joints).min())]
    for limit in constraints:
        if isinstance(limit, JointLimits) and limit.level == "position":
            lower, upper = (np.array(side, dtype=float) for side in (limit.lower, limit.upper))
            room.append(float(np.minimum(joints - lower, upper - joints).min()))
    return min(room)


def narrower(joints: Floats, chain: Chain) -> JointLimits:
    """A range of the joint that moves most, of which the primitive without it leaves the ends."""
    k = int(np.argmax(np.ptp(joints, axis=0)))
    middle, half = np.mean([joints[:, k].min(), joints[:, k].max()]), np.ptp(joints[:, k]) / 2
    lower, upper = chain.lower.tolist(), chain.upper.tolist()
    lower[k], upper[k] = middle - NARROWER * half, middle + NARROWER * half
    return JointLimits(lower, upper)


# ---------------------------------------------------------------- pushed


@dataclass(frozen=True)
class Pushed:
    """Worst of loops in which joints were pushed and given another goal."""

    name: str
    loops: int
    ended: int
    off: float
    slip: float
    longest: float
    plans: int

    @property
    def failures(self) -> list[str]:
        """What is not as it must be."""
        asked = {
            f"{self.loops - self.ended} of {self.loops} loops do not end": self.ended == self.loops,
            f"ends {self.off:.1e} of the range from its goal": self.off <= END,
            f"slips by {self.slip:.1e} m/s when pushed": self.slip <= PUSHED_SLIP,
        }
        return [f"{self.name}, pushed: {what}" for what, kept in asked.items() if not kept]


def pushed(demonstration: ns.Trajectory, arm: robots.Robot, loops: int) -> Pushed:
    """Step a primitive whose joints are pushed once, and whose goal is another from then on."""
    chain = demonstration.carrier
    assert chain is not None
    dmp, rng = ns.learn(demonstration, ns.Blade(), robot=chain), np.random.default_rng(0)
    ended, plans, longest = 0, 0, 0.0
    off, slip = [0.0], [0.0]
    for _ in range(loops):
        loop = SpaceController(dmp, CYCLE)
        goal = dmp.goal_position + rng.uniform(-PUSH, PUSH, chain.size)
        push = PUSH * rng.choice([-1, 1], chain.size)
        when, at = rng.uniform(0.1, 0.9) * dmp.duration, loop.state.position
        joints, taken = [at], [0]
        for k in range(round(PATIENCE * dmp.duration / CYCLE)):
            held = when <= k * CYCLE < when + HELD_FOR
            if held and k * CYCLE < when + CYCLE:
                at = at + push
            state = loop.step(at, goal if k * CYCLE >= when else None)
            at = at if held else state.position
            joints.append(state.position)
            taken.append(loop.taken_over)
            if loop.done and k * CYCLE >= when + HELD_FOR:
                ended += 1
                break
        tool = chain.poses(CYCLE * np.arange(len(joints)), np.array(joints))
        # In the cycle in which the command moves to what was measured, nothing holds.
        kept = np.diff(taken) == 0
        slip.append(float(np.abs(step_residuals(tool, ns.Blade())).max(axis=1)[kept].max()))
        off.append(float((np.abs(joints[-1] - goal) / (arm.upper - arm.lower)).max()))
        longest = max(longest, CYCLE * len(joints) / dmp.duration)
        plans += len(loop.replanned)
    return Pushed(demonstration.name, loops, ended, max(off), max(slip), longest, plans)


# ---------------------------------------------------------------- expressions


def expressions(chain: Chain) -> Iterator[str]:
    """Lines of Markdown: how many operations kinematics are, and what they take in C."""
    q = ca.SX.sym("q", chain.size)
    pose = chain.pose(q)
    derivative = [ca.jacobian(each, q) for each in pose]
    yield "| expression | operations | in C, ns |"
    yield "|---|---|---|"
    for name, found in {
        "pose": pose,
        "pose and geometric Jacobian": (*pose, chain.jacobian(q)),
        "pose and its derivative": (*pose, *derivative),
    }.items():
        function = ca.Function("kinematics", [q], [ca.densify(e) for e in ca.cse(list(found))])
        count = function.n_instructions() - function.nnz_in() - function.nnz_out()
        yield f"| {name} | {count} | {1e9 * _seconds(function):.0f} |"


def _seconds(function: ca.Function) -> float:
    """Time of a call in machine code (s), the least of several rounds."""
    generator = ca.CodeGenerator("kinematics", {"with_header": False, "casadi_int": "int"})
    generator.add(function)
    sizes = [function.numel_out(i) for i in range(function.n_out())]
    places = "".join(f"found[{i}] = y + {sum(sizes[:i])};\n" for i in range(len(sizes)))
    text = f"""{generator.dump()}
void repeat(double *x, double *y, int count) {{
    const double *given[1]; double *found[{len(sizes)}], work[{function.sz_w() + 1}];
    int k;
    given[0] = x;
    {places}
    for (k = 0; k < count; ++k) {{
        {function.name()}(given, found, 0, work, 0);
        x[0] += 1e-9 * y[0];
    }}
}}
"""
    code = ctypes.CDLL(str(library.built("kinematics", {"kinematics.c": text})))
    x = (ctypes.c_double * function.nnz_in())(*np.linspace(0.1, 0.7, function.nnz_in()))
    y = (ctypes.c_double * sum(sizes))()
    taken = []
    for _ in range(7):
        begun = time.perf_counter()
        code.repeat(x, y, CALLS)
        taken.append((time.perf_counter() - begun) / CALLS)
    return min(taken)


# ---------------------------------------------------------------- what is told


def table(outcomes: Sequence[Outcome]) -> Iterator[str]:
    """Lines of Markdown, one a primitive."""
    yield (
        "| recording | limits of joints | slip, m/s: person, primitive | off the path, mm | "
        "turned, ° (rms) | joints moved, ° | room | rates over limits | learned in, CPU s | "
        "step in C, us |"
    )
    yield "|---|---|---|---|---|---|---|---|---|---|"
    for each in outcomes:
        turned, moved = np.degrees([each.turned, each.moved])
        yield (
            f"| {each.name} | {each.limits} | {each.slipped:.3f}, {each.slip:.0e} | "
            f"{1e3 * each.path:.2f} | {turned:.1f} | {moved:.1f} | "
            f"{each.room:.2g} | {each.rates:.2f} | {each.seconds:.1f} | {1e6 * each.step:.2f} |"
        )


def table_of_pushes(loops: Sequence[Pushed]) -> Iterator[str]:
    """Lines of Markdown, one a primitive."""
    yield (
        "| recording | pushed, ended | off the goal, of the range | slip, m/s | plans | "
        "longest, over the duration |"
    )
    yield "|---|---|---|---|---|---|"
    for each in loops:
        yield (
            f"| {each.name} | {each.loops}, {each.ended} | {each.off:.0e} | {each.slip:.0e} | "
            f"{each.plans} | {each.longest:.1f} |"
        )


def main(arguments: Sequence[str] | None = None) -> int:
    """Learn each recording without limits of joints, and within; print tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--recordings", type=Path, default=RECORDINGS, help="folder of CSV files")
    parser.add_argument("--names", nargs="*", help="of files, without .csv; all by default")
    parser.add_argument(
        "--limits",
        nargs="*",
        choices=("none", "range", "all"),
        default=["none", "range"],
        help="of joints: none; a range that is left without it; all of the arm's, which takes "
        "minutes to compile",
    )
    parser.add_argument("--pushes", type=int, default=4, help="loops with a push, a recording")
    options = parser.parse_args(arguments)
    files = sorted(options.recordings.glob("*.csv"))
    files = [file for file in files if not options.names or file.stem in options.names]
    if not files:
        parser.error(f"{options.recordings}: no such recordings")
    arm = robots.panda()
    chain = robots.chain(arm)
    outcomes: list[Outcome] = []
    loops: list[Pushed] = []
    with compiling(True):
        print("\n".join(expressions(chain)), flush=True)
        for file in files:
            demonstration = recorded(file, arm, chain)
            free, joints = attempt(demonstration, "none", (), arm)
            asked = {"range": [narrower(joints, chain)], "all": joint_limits(chain)}
            outcomes += [free] if "none" in options.limits else []
            for kind in set(options.limits) & set(asked):
                outcomes.append(attempt(demonstration, kind, asked[kind], arm)[0])
            if options.pushes:
                loops.append(pushed(demonstration, arm, options.pushes))
    print("\n".join(table(outcomes)))
    print("\n".join(table_of_pushes(loops)))
    failed = [line for each in (*outcomes, *loops) for line in each.failures]
    print("\n".join(failed), file=sys.stderr)
    return bool(failed)


if __name__ == "__main__":
    sys.exit(main())
