"""The whole motion as one optimization: jaxls, sparse least squares under equalities.

pyroki plans with jaxls and says of itself that its constraints are soft; jaxls has had equalities
since.  It is given what noslip minimizes (:mod:`noslip.projection.trajectory`, but for the slope of
the correction at rest), with the same weights, the same steps and the same first guess, the blade
turned into its path: from the demonstration itself it ends elsewhere, 11 mm off at 200 samples.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from functools import cache, partial
from importlib.util import find_spec
from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.side_by_side.job import DEMONSTRATED, Job, Row, judged
from noslip import Blade, PoseTrajectory
from noslip.constraints.system import as_system
from noslip.projection.heading import turn_edge_into_path
from noslip.projection.request import ADAPTING, LEARNING, Weights

MISSING = (
    "from github.com/brentyi/jaxls, with jax and scikit-sparse: "
    "the package that PyPI calls jaxls is another"
)
TIGHT = 1e-10
"""Absolute tolerance of the equalities, in place of jaxls' own 1e-5."""
_REST = 1e-3
"""What a turn costs at rest, over its cost at mean speed; as in noslip."""


def missing() -> str:
    """Return why it cannot be measured; the other package of its name has no problems to solve."""
    if find_spec("jax") is None or find_spec("jaxlie") is None or find_spec("jaxls") is None:
        return MISSING
    return "" if hasattr(_jaxls().jaxls, "LeastSquaresProblem") else MISSING


@cache
def _jaxls() -> SimpleNamespace:
    """Import it in double precision, quiet."""
    os.environ.setdefault("JAX_PLATFORMS", "cpu")
    import jax
    import jaxlie
    import jaxls

    jax.config.update("jax_enable_x64", True)
    if find_spec("loguru") is not None:
        from loguru import logger

        logger.disable("jaxls")
    return SimpleNamespace(jax=jax, jaxlie=jaxlie, jaxls=jaxls)


def moved(motion: PoseTrajectory, job: Job) -> PoseTrajectory:
    """Return a motion to the demonstrated end, moved to the job's by minimum jerk."""
    u = np.linspace(0.0, 1.0, len(motion))
    share = u**3 * (10 - 15 * u + 6 * u**2)
    positions = motion.positions + share[:, None] * (job.goal - motion.positions[-1])
    return PoseTrajectory(motion.times, positions, motion.rotations)


class Plan:
    """One job as a problem of jaxls, analyzed once, to be solved again and again.

    A sample's unknowns are the displacement over the path's length and the rotation vector of the
    correction.  Both ends keep their positions.

    Parameters
    ----------
    given : PoseTrajectory
        The result is the nearest to it.
    weights : Weights
    tight : bool
        Whether equalities are solved to :data:`TIGHT`.
    """

    def __init__(self, given: PoseTrajectory, weights: Weights, tight: bool) -> None:
        self.given = given
        self.length, count = given.path_length, len(given)
        found = turn_edge_into_path(given, as_system([Blade()]), weights.rotation_smoothing)
        self.guess = np.hstack([np.zeros((count, 3)), found.turns])
        self.problem, self.variables = self._problem(weights)
        self.options: dict[str, Any] = {"linear_solver": "cholmod", "verbose": False}
        if tight:
            jaxls = _jaxls().jaxls
            bounds = {"penalty_max": 1e10, "lambda_min": -1e10, "lambda_max": 1e10}
            self.options["augmented_lagrangian"] = jaxls.AugmentedLagrangianConfig(
                tolerance_absolute=TIGHT, tolerance_relative=TIGHT, **bounds
            )

    def _problem(self, weights: Weights) -> tuple[Any, Any]:
        its = _jaxls()
        np_, jaxls, SO3 = its.jax.numpy, its.jaxls, its.jaxlie.SO3
        count, length = len(self.given), self.length
        h, time_step = 1 / (count - 1), self.given.duration / (count - 1)

        class Correction(jaxls.Var[its.jax.Array], default_factory=lambda: np_.zeros(6)): ...

        speeds = np.linalg.norm(self.given.linear_velocities, axis=1)
        costs_of_turning = np_.array(speeds / speeds.mean() + _REST)
        bending = np.repeat([weights.position_smoothing, weights.rotation_smoothing], 3)
        bends = np_.array(np.sqrt(bending / h**3))

        @jaxls.Cost.factory
        def off(values: Any, at: Any, turning: Any) -> Any:
            shift, turn = values[at][:3], values[at][3:]
            return np_.concatenate(
                [np_.sqrt(weights.position * h) * shift, np_.sqrt(turning * h) * turn]
            )

        @jaxls.Cost.factory
        def bent(values: Any, before: Any, at: Any, after: Any) -> Any:
            return bends * (values[before] - 2 * values[at] + values[after])

        @jaxls.Cost.factory(kind="constraint_eq_zero")
        def slip(values: Any, a: Any, b: Any, p_a: Any, p_b: Any, q_a: Any, q_b: Any) -> Any:
            first = SO3.exp(values[a][3:]) @ SO3(q_a)
            last = SO3.exp(values[b][3:]) @ SO3(q_b)
            middle = first @ SO3.exp(0.5 * (first.inverse() @ last).log())
            way = p_b + length * values[b][:3] - p_a - length * values[a][:3]
            return (middle.inverse() @ (way / time_step))[1:2]

        @jaxls.Cost.factory(kind="constraint_eq_zero")
        def kept(values: Any, at: Any) -> Any:
            return values[at][:3]

        def at(*samples: Any) -> Any:
            return Correction(np_.array(np.r_[samples]))

        p = np_.array(self.given.positions)
        q = np_.array(self.given.rotations.as_quat(scalar_first=True))
        k = np.arange(count)
        costs = [
            off(at(k), costs_of_turning),
            bent(at(k[:-2]), at(k[1:-1]), at(k[2:])),
            slip(at(k[:-1]), at(k[1:]), p[:-1], p[1:], q[:-1], q[1:]),
            kept(at(0, count - 1)),
        ]
        variables = at(k)
        return jaxls.LeastSquaresProblem(costs, [variables]).analyze(), variables

    def solve(self) -> PoseTrajectory:
        """Return the motion; the first time it is compiled."""
        its = _jaxls()
        begin = self.variables.with_value(its.jax.numpy.array(self.guess))
        found = self.problem.solve(its.jaxls.VarValues.make((begin,)), **self.options)
        z = np.array(found[self.variables])
        rotations = Rotation.from_rotvec(z[:, 3:]) * self.given.rotations
        return PoseTrajectory(
            self.given.times, self.given.positions + self.length * z[:, :3], rotations
        )


def rows(jobs: Sequence[Job]) -> Iterator[Row]:
    """Plan both jobs with jaxls' own tolerances, and with tight ones.

    As by noslip, another end is reached from the motion that was found to the demonstrated one.
    """
    reason = missing()
    if reason:
        for job in jobs:
            yield Row("jaxls", "", "one optimization", job.name, skipped=reason)
        return
    for way, tight in (("its tolerances", False), (f"tolerance {TIGHT:g}", True)):
        planner = Planner(tight)
        for job in jobs:
            move = partial(planner.move, job)
            yield judged("jaxls", version(), f"one optimization, {way}", job, move)


class Planner:
    """Remembers its problems, which are dear to analyze and compile, and its motions."""

    def __init__(self, tight: bool) -> None:
        self.tight = tight
        self.plans: dict[str, Plan] = {}
        self.motions: dict[str, PoseTrajectory] = {}

    def move(self, job: Job) -> PoseTrajectory:
        """Plan a job; the demonstrated end comes first."""
        if job.name not in self.plans:
            self.plans[job.name] = (
                Plan(job.given, LEARNING, self.tight)
                if job.name == DEMONSTRATED
                else Plan(moved(self.motions[DEMONSTRATED], job), ADAPTING, self.tight)
            )
        motion = self.motions[job.name] = self.plans[job.name].solve()
        return motion


def version() -> str:
    """Return what it says of itself, 0.0.0 in its repository."""
    return str(_jaxls().jaxls.__version__)
