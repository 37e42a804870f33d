"""To and from other libraries: pytransform3d, SciPy's RigidTransform, movement_primitives.

Poses carry over as they are.  Primitives of movement_primitives obey the same equations with other
basis functions; their weights are fitted anew, which leaves a difference that each function states.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import lstsq
from scipy.spatial.transform import RigidTransform, Rotation

from noslip import _arguments
from noslip._extras import need
from noslip._pose_checks import MAX_NORM_ERROR
from noslip._typing import Floats
from noslip.errors import InputError
from noslip.law.attractor import Attractor
from noslip.law.basis import Basis
from noslip.law.clock import Phase
from noslip.law.fitting import FEWEST_STEPS, MOST_BASIS_FUNCTIONS
from noslip.law.forcing import ForcingTerm
from noslip.law.law import Law
from noslip.law.layout import FORCE
from noslip.law.points import Goal
from noslip.law.winding import Winding
from noslip.primitive import ConstrainedDMP
from noslip.trajectory import PoseTrajectory

if TYPE_CHECKING:
    from movement_primitives.dmp import CartesianDMP

SAMPLES_PER_FUNCTION = 10
"""Samples of a force, of the finer basis, when it is fitted in another one."""
WEIGHTS_PER_BASIS_FUNCTION = 2
"""Of a CartesianDMP, whose functions are wider than ours: as many of them leave 4e-4 of the path of
a noisy force, twice as many 3e-7."""
BASIS_FUNCTIONS_PER_WEIGHT = 4
"""The other way: so many leave 7e-5 of the path where weights follow noise."""
FEWEST_BASIS_FUNCTIONS = 200
"""However few the weights: so many follow their wide functions to 1e-6 of the path."""
UNIT = 4 * np.finfo(np.float64).eps
"""A quaternion whose norm is 1 to within this is kept to the bit."""


# -------------------------------------------------------------------- poses


def from_pqs(times: ArrayLike, pqs: ArrayLike, *, name: str = "pqs") -> PoseTrajectory:
    """Return the trajectory of poses as pytransform3d and movement_primitives write them.

    Parameters
    ----------
    times : array, shape (N,)
        Seconds.
    pqs : array, shape (N, 7)
        Position (x, y, z), meters, and unit quaternion (qw, qx, qy, qz) of the tool in the world;
        of pytransform3d's transforms those from "tool" to "world".
    name : str
        Of the trajectory, for error messages.

    Raises
    ------
    InputError
        If a shape is wrong, a number is not finite, or a quaternion's norm is not 1 to within
        0.001.
    """
    poses = _numbers(name, "pqs", pqs, (7,))
    quaternions = poses[:, 3:]
    norms = np.linalg.norm(quaternions, axis=1)
    _check(name, norms, "the quaternion's norm", np.abs(norms - 1) <= MAX_NORM_ERROR, "be 1")
    # SciPy would divide by norms that differ from 1 by rounding alone, and change the last bits.
    norms[np.abs(norms - 1) <= UNIT] = 1.0
    unit = quaternions / norms[:, None]
    return PoseTrajectory(
        times=np.asarray(times),
        positions=poses[:, :3],
        rotations=Rotation(unit[:, [1, 2, 3, 0]], normalize=False),
        name=name,
    )


def to_pqs(trajectory: PoseTrajectory) -> Floats:
    """Return positions and quaternions (x, y, z, qw, qx, qy, qz), shape (N, 7).

    Quaternions do not flip their sign from one sample to the next.  ``from_pqs`` gives the same
    poses back to the bit; velocities it estimates anew.
    """
    return np.hstack([trajectory.positions, trajectory.quaternions])


def from_transforms(
    times: ArrayLike, transforms: RigidTransform | ArrayLike, *, name: str = "transforms"
) -> PoseTrajectory:
    """Return the trajectory of homogeneous transforms.

    Parameters
    ----------
    times : array, shape (N,)
        Seconds.
    transforms : RigidTransform of length N, or array, shape (N, 4, 4)
        Tool to world, meters.
    name : str
        Of the trajectory, for error messages.

    Raises
    ------
    InputError
        If a shape is wrong, a number is not finite, or a matrix is no rigid transform: its last
        row not (0, 0, 0, 1), or its rotation not orthonormal to within 0.001.
    """
    given = transforms.as_matrix() if isinstance(transforms, RigidTransform) else transforms
    matrices = _numbers(name, "transforms", given, (4, 4))
    turns, bottom = matrices[:, :3, :3], np.abs(matrices[:, 3] - [0, 0, 0, 1]).max(axis=1)
    _check(name, bottom, "the last row's error", bottom <= MAX_NORM_ERROR, "be 0")
    skew = np.abs(np.swapaxes(turns, 1, 2) @ turns - np.eye(3)).max(axis=(1, 2))
    _check(name, skew, "the rotation's error |R^T R - 1|", skew <= MAX_NORM_ERROR, "be 0")
    determinants = np.linalg.det(turns)
    _check(name, determinants, "the rotation's determinant", determinants > 0, "be 1")
    return PoseTrajectory(
        times=np.asarray(times),
        positions=matrices[:, :3, 3],
        rotations=Rotation.from_matrix(turns),
        name=name,
    )


def to_transforms(trajectory: PoseTrajectory) -> RigidTransform:
    """Return the poses as SciPy's RigidTransform, tool to world, length N.

    ``to_transforms(trajectory).as_matrix()`` are pytransform3d's transforms, shape (N, 4, 4).
    ``from_transforms`` gives the same positions back to the bit, rotations to 1e-15 rad.
    """
    return RigidTransform.from_components(trajectory.positions, trajectory.rotations)


def _numbers(name: str, what: str, value: Any, columns: tuple[int, ...]) -> Floats:
    """Return an array of finite numbers whose first axis is time."""
    array = _arguments.numbers(f"{name}: {what}", value)
    if array.shape[1:] != columns or array.ndim != len(columns) + 1:
        expected = ", ".join(map(str, ("N", *columns)))
        raise InputError(f"{name}: {what} has shape {array.shape}, expected ({expected})")
    if not np.isfinite(array).all():
        raise InputError(f"{name}: {what}[{np.argwhere(~np.isfinite(array))[0][0]}] is not finite")
    return array


def _check(name: str, found: Floats, what: str, good: NDArray[np.bool_], wanted: str) -> None:
    """Point at the first sample that is not good."""
    if not good.all():
        row = int(np.argmin(good))
        raise InputError(
            f"{name}: sample {row}: {what} is {found[row]:.6g} and must {wanted}; "
            "correct or remove the sample"
        )


# -------------------------------------------------------------------- movement_primitives


def to_movement_primitives(
    dmp: ConstrainedDMP, *, weights: int | None = None, time_step: float | None = None
) -> CartesianDMP:
    """Return the primitive as movement_primitives' CartesianDMP.

    Both obey ``tau^2 y'' = alpha (beta (g - y) - tau y') + f(s)``, with the same logarithm for the
    orientation, so start, goal, duration, alpha and beta carry over as they are and a new goal has
    the same effect.  The forcing terms are not spanned by the same functions: CartesianDMP's phase
    always falls to 0.01 and its Gaussians are 1.5 distances wide, ours fall to ``exp(-alpha_s)``
    and are one distance wide.  Its weights are fitted to our force, densely sampled.

    How much differs: with twice as many weights as basis functions, the default, the exact
    solutions of both are 3e-7 of the path and 1e-4 degrees apart, also for a noisy recording; with
    as many weights 2e-7 for a smooth one and 4e-4 for a noisy one, with half as many 3e-3.  Its own
    integration adds an error of first order: with 1000 steps 0.002 of the path and 0.2 degrees
    where the motion is smooth, up to 0.03 and 2 degrees where it is noisy.

    What does not carry over: constraints (those of a ConstrainedDMP hold in noslip only); and, in
    ``open_loop``, the velocity at the start, which CartesianDMP always begins without.  It is
    stored, and kept by ``cartesian.step(y, yd)`` from ``reset()`` on.

    Parameters
    ----------
    dmp : ConstrainedDMP
        Its constraints are left out.
    weights : int, optional
        A dimension, 2 or more; by default two a basis function.
    time_step : float, optional
        Its ``dt_`` (s); by default that of our rollouts.

    Returns
    -------
    CartesianDMP
        In seconds, meters and radians, quaternions (qw, qx, qy, qz); ``smooth_scaling`` is off.

    Raises
    ------
    MissingDependencyError
        If movement_primitives is not installed.
    InputError
        If the motion turns more than 135 degrees away from its goal: noslip leads it there by a
        goal that moves, CartesianDMP has none.
    """
    cartesian_dmp = need("interop", "movement_primitives.dmp", "interop").CartesianDMP
    if not isinstance(dmp, ConstrainedDMP):
        raise InputError(f"dmp must be a ConstrainedDMP, got {_arguments.short(dmp)}")
    law, tau = dmp.law, dmp.duration
    if len(law.goal.winding.quaternions) > 1:
        raise InputError(
            "dmp turns more than 135 degrees away from its goal, which a CartesianDMP with its "
            "fixed goal does not follow; cut the demonstration into parts that turn less"
        )
    own = law.basis.count
    count = min(WEIGHTS_PER_BASIS_FUNCTION * own, MOST_BASIS_FUNCTIONS)
    if weights is not None:
        count = _arguments.count("weights", weights, MOST_BASIS_FUNCTIONS)
        if count < 2:
            raise InputError("weights must be 2 or more, got 1")
    step = tau / law.steps
    if time_step is not None:
        step = _arguments.positive("time_step", time_step, "seconds")
    made = cartesian_dmp(
        execution_time=tau,
        dt=step,
        n_weights_per_dim=count,
        alpha_y=law.attractor.alpha,
        beta_y=law.attractor.beta,
    )
    fractions = _fractions(own, count)
    forces = law.forcing(law.clock.at(fractions))
    for theirs, part in ((made.forcing_term_pos, "linear"), (made.forcing_term_rot, "angular")):
        activations = theirs.design_matrix(fractions * tau).T
        theirs.weights_[:, :] = _fitted(activations, forces[:, FORCE[part]]).T
    made.configure(
        t=0.0, start_y=law.start, start_yd=law.start_velocity / tau, goal_y=law.goal.point
    )
    return made


def from_movement_primitives(
    dmp: CartesianDMP, *, basis_functions: int | None = None
) -> ConstrainedDMP:
    """Return movement_primitives' CartesianDMP as a primitive without constraints.

    Start, goal, duration, alpha, beta and the phase carry over as they are; the weights are fitted
    to its force, densely sampled, since its Gaussians are wider (see
    :func:`to_movement_primitives`).  With ``smooth_scaling`` the term that makes the start smooth
    becomes part of the force: the motion to the goal it has is the same, a new goal has our effect,
    not its.

    How much differs: with four functions a weight, the default, the exact solutions of both are
    1e-6 of the path and 1e-4 degrees apart; 7e-5 and 0.01 degrees where many weights follow the
    noise of a recording.  Its own rollouts are farther off, by their integration.

    Parameters
    ----------
    dmp : CartesianDMP
        With a start and a goal (``imitate`` and ``configure`` set them).  ``start_yd`` is the
        velocity the motion starts with; its own ``open_loop`` leaves it out.
    basis_functions : int, optional
        By default four a weight, 200 or more.

    Returns
    -------
    ConstrainedDMP
        Without constraints; ``learn(made.rollout(), constraints)`` adds them.

    Raises
    ------
    MissingDependencyError
        If movement_primitives is not installed.
    InputError
        If start or goal are missing, a number is not finite, or alpha_y or beta_y differ between
        dimensions, which we have one of.
    """
    if not isinstance(dmp, need("interop", "movement_primitives.dmp", "interop").CartesianDMP):
        raise InputError(f"dmp must be a CartesianDMP, got {_arguments.short(dmp)}")
    tau = _arguments.positive("execution_time_", dmp.execution_time_, "seconds")
    own_step = _arguments.positive("dt_", dmp.dt_, "seconds")
    attractor = Attractor(_single("alpha_y", dmp.alpha_y), _single("beta_y", dmp.beta_y))
    # A CartesianDMP that was never configured has zeros in place of quaternions.
    ends = from_pqs([0.0, tau], [dmp.start_y, dmp.goal_y], name="CartesianDMP (start, goal)")
    usual = max(FEWEST_BASIS_FUNCTIONS, BASIS_FUNCTIONS_PER_WEIGHT * dmp.n_weights_per_dim)
    count = min(usual, MOST_BASIS_FUNCTIONS)
    if basis_functions is not None:
        count = _arguments.count("basis_functions", basis_functions, MOST_BASIS_FUNCTIONS)
    phase = Phase(float(dmp.forcing_term_pos.alpha_z))
    basis = Basis(count, phase)
    fractions = _fractions(count, dmp.n_weights_per_dim)
    phases = phase.at(fractions)
    activations = basis.activations(phases)

    def weights(theirs: Any, way: Floats) -> Floats:
        forces = theirs(fractions * tau).T
        if dmp.smooth_scaling:
            forces = forces - attractor.stiffness * np.outer(phases, way)
        if not np.isfinite(forces).all():
            raise InputError("CartesianDMP: a weight is not finite; imitate a demonstration first")
        return _fitted(activations, forces)

    velocity = np.array(dmp.start_yd, dtype=np.float64) * tau
    if not np.isfinite(velocity).all():
        raise InputError("CartesianDMP: start_yd is not finite")
    start, goal = to_pqs(ends)
    turn = ends.rotations[1] * ends.rotations[0].inv()
    own = max(1, round(tau / own_step))
    moved = weights(dmp.forcing_term_pos, goal[:3] - start[:3])
    turned = weights(dmp.forcing_term_rot, turn.as_rotvec())
    law = Law(
        attractor,
        ForcingTerm(basis, np.hstack([moved, turned])),
        start,
        velocity,
        Goal(goal[:3], Winding(goal[None, 3:])),
        duration=tau,
        steps=own * -(-FEWEST_STEPS // own),
    )
    return ConstrainedDMP(law)


def _fractions(*counts: int) -> Floats:
    """Instants of the motion, evenly spaced from 0 to 1, at which a force is sampled."""
    return np.linspace(0.0, 1.0, SAMPLES_PER_FUNCTION * max(counts) + 1)


def _fitted(activations: Floats, forces: Floats) -> Floats:
    """Weights, shape (K, d), of the least squares fit to forces, shape (N, d)."""
    # Activations shrink with the phase, to a hundredth: scaled, so that no function counts as null.
    scale = np.linalg.norm(activations, axis=0)
    weights = lstsq(activations / scale, forces, lapack_driver="gelsy")[0]
    return np.asarray(weights / scale[:, None])


def _single(name: str, values: Floats) -> float:
    """Return what all six dimensions share."""
    if np.ptp(values) != 0.0:
        raise InputError(
            f"CartesianDMP: {name} is {_arguments.short(values)}, and must be one number here; "
            "learn from its rollout: learn(from_pqs(*dmp.open_loop()))"
        )
    return float(values[0])
