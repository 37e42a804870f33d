"""Movement primitives that know no constraint: fitted to the demonstration, led to the goal.

Orientations are those of the library where it has them.  Where it has vectors only, a pose is six
numbers: the position, and the rotation vector from the first pose, which turns by less than pi.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, partial
from importlib.util import find_spec
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks import peers
from benchmarks.example import ALPHA, BASIS_FUNCTIONS
from benchmarks.side_by_side.job import Job, Row, judged, version_of
from noslip import PoseTrajectory
from noslip._typing import Floats


def coordinates(given: PoseTrajectory) -> Floats:
    """Return positions (m) and rotation vectors from the first pose (rad), shape (N, 6)."""
    turns = (given.rotations * given.rotations[0].inv()).as_rotvec()
    return np.hstack([given.positions, turns])


def motion_of(job: Job, times: Floats, values: Floats) -> PoseTrajectory:
    """Return the motion of such coordinates."""
    rotations = Rotation.from_rotvec(values[:, 3:]) * job.given.rotations[0]
    return PoseTrajectory(times, values[:, :3], rotations)


def goal_of(job: Job) -> Floats:
    """Return the goal's coordinates; the rotation is as demonstrated."""
    return np.r_[job.goal, coordinates(job.given)[-1, 3:]]


def cartesian(job: Job, *, smooth: bool) -> PoseTrajectory:
    """movement-primitives' ``CartesianDMP``; a new goal pulls at once, or comes in smoothly."""
    times, poses = peers.imitation(job.given)
    dmp = peers.fit(times, poses, smooth_scaling=smooth)
    dmp.configure(goal_y=np.r_[job.goal, poses[-1, 3:]])
    return peers.rollout(dmp)


CARTESIAN = {
    "CartesianDMP": partial(cartesian, smooth=False),
    "CartesianDMP, smooth_scaling": partial(cartesian, smooth=True),
}


def pydmps(job: Job) -> PoseTrajectory:
    """The discrete primitive of pydmps, of six coordinates, with as many steps as samples.

    It lasts one second whatever the demonstration does.  It scales the force of each coordinate
    with the way to its goal, and the example's x ends where it begins: it is given axes at 45
    degrees, in which both have a way to go.  Along x and y another goal throws it more than
    a hundred meters.
    """
    from pydmps.dmp_discrete import DMPs_discrete

    axes = np.eye(6)
    axes[:2, :2] = [[np.sqrt(0.5), -np.sqrt(0.5)], [np.sqrt(0.5), np.sqrt(0.5)]]
    dmp = DMPs_discrete(n_dmps=6, n_bfs=BASIS_FUNCTIONS, dt=1 / len(job.given))
    dmp.imitate_path((coordinates(job.given) @ axes).T, plot=False)
    dmp.goal = goal_of(job) @ axes
    values, _, _ = dmp.rollout()
    return motion_of(job, job.given.times, values @ axes.T)


def dmpbbo(job: Job) -> PoseTrajectory:
    """The primitive of dmpbbo, of six coordinates, of its newest kind, solved analytically."""
    from dmpbbo.dmps.Dmp import Dmp
    from dmpbbo.dmps.Trajectory import Trajectory
    from dmpbbo.functionapproximators.FunctionApproximatorRBFN import FunctionApproximatorRBFN

    times = job.given.times - job.given.times[0]
    functions = [FunctionApproximatorRBFN(BASIS_FUNCTIONS, 0.7) for _ in range(6)]
    dmp = Dmp.from_traj(Trajectory(times, coordinates(job.given)), functions, dmp_type="2022")
    dmp.y_attr = goal_of(job)
    states, rates, _, _ = dmp.analytical_solution(times)
    return motion_of(job, job.given.times, dmp.states_as_trajectory(times, states, rates).ys)


def prodmp(job: Job) -> PoseTrajectory:
    """MP_PyTorch's ProDMP of six coordinates, in double precision."""
    import torch

    times, values = job.given.times - job.given.times[0], coordinates(job.given)
    mp = _prodmp(float(times[-1]), job.time_step)
    clock, demonstrated = torch.tensor(times)[None], torch.tensor(values)[None]
    learned = mp.learn_mp_params_from_trajs(clock, demonstrated)
    # The last of each coordinate is its goal.
    parameters = learned["params"].reshape(6, -1)
    parameters[:, -1] += torch.tensor(goal_of(job) - values[-1])
    found = mp.get_traj_pos(clock, **{**learned, "params": parameters.reshape(1, -1)})
    return motion_of(job, job.given.times, found[0].numpy())


@cache
def _prodmp(duration: float, time_step: float) -> Any:
    """Integrate its basis functions once, which is most of the work."""
    import torch
    from mp_pytorch.mp import MPFactory

    arguments: dict[str, Any] = {
        "num_basis": BASIS_FUNCTIONS,
        "basis_bandwidth_factor": 2,
        "num_basis_outside": 0,
        "alpha": ALPHA,
        "alpha_phase": 2,
        "dt": time_step,
        "weights_scale": 1.0,
        "goal_scale": 1.0,
    }
    return MPFactory.init_mp(
        "prodmp", arguments, num_dof=6, tau=duration, dtype=torch.float64, device="cpu"
    )


@dataclass(frozen=True)
class Library:
    """Where it comes from, and what of it is fitted and rolled out.

    Attributes
    ----------
    package, module : str
        The distribution; what is imported.
    advice : str
        How to have it.
    ways : dict
        Functions of a job that return its motion, by name.
    """

    package: str
    module: str
    advice: str
    ways: dict[str, Callable[[Job], PoseTrajectory]]


LIBRARIES = {
    "movement_primitives": Library(
        "movement-primitives",
        "movement_primitives",
        "pip install movement-primitives pytransform3d",
        CARTESIAN,
    ),
    "pydmps": Library("pydmps", "pydmps", "pip install pydmps", {"DMPs_discrete": pydmps}),
    "dmpbbo": Library(
        "dmpbbo",
        "dmpbbo",
        "on no registry: a clone of github.com/stulp/dmpbbo on PYTHONPATH",
        {"Dmp, kind 2022": dmpbbo},
    ),
    "MP_PyTorch": Library(
        "mp-pytorch",
        "mp_pytorch",
        "pip install mp-pytorch addict (with PyTorch, of gigabytes)",
        {"ProDMP": prodmp},
    ),
}


def rows(library: str, job: Job) -> Iterator[Row]:
    """Fit and roll out."""
    known = LIBRARIES[library]
    version = version_of(known.package)
    for way, move in known.ways.items():
        if find_spec(known.module) is None:
            yield Row(library, version, way, job.name, skipped=known.advice)
        else:
            yield judged(library, version, way, job, partial(move, job))
