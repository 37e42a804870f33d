"""To and from other libraries: pytransform3d, SciPy's RigidTransform, movement_primitives, pydmps.

Poses carry over as they are.  Primitives of movement_primitives and pydmps obey the same equations
with other basis functions; their weights are fitted anew, which leaves a difference that each
function states.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import pi
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
from noslip.law.clock import Cycle, Phase
from noslip.law.fitting import FEWEST_STEPS, MOST_BASIS_FUNCTIONS
from noslip.law.forcing import ForcingTerm
from noslip.law.law import Law
from noslip.law.points import Goal
from noslip.law.winding import Winding
from noslip.primitive import ConstrainedDMP
from noslip.rule import no_rule
from noslip.runtime.rhythm import settled
from noslip.space import POSE, Space, vectors
from noslip.trajectory import PoseTrajectory

if TYPE_CHECKING:
    from movement_primitives.dmp import DMP, CartesianDMP

SAMPLES_PER_FUNCTION = 10
"""Samples of a force, of the finer basis, when it is fitted in another one."""
WEIGHTS_PER_BASIS_FUNCTION = 2
"""Of movement_primitives, whose functions are wider than ours: as many of them leave 4e-4 of the
path of a noisy force, twice as many 3e-7."""
BASIS_FUNCTIONS_PER_WEIGHT = 4
"""The other way: so many leave 7e-5 of the path where weights follow noise."""
FEWEST_BASIS_FUNCTIONS = 200
"""However few the weights: so many follow their wide functions to 1e-6 of the path."""
APART = 1e-4
"""By so much pydmps moves a goal that is equal to its start: its force is scaled by the way."""
LEAST_APART = 1e-9
"""Share of their size by which functions of pydmps must differ from each other: they are so wide
that the weights of all would be 1e13, and a step lose what it sums."""
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
    """Return positions and quaternions (x, y, z, qw, qx, qy, qz), shape (N, 7), without channels.

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
    """Return the poses as SciPy's RigidTransform, tool to world, length N, without channels.

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
) -> CartesianDMP | DMP:
    """Return the primitive as movement_primitives' CartesianDMP, that of vectors as its DMP.

    Both obey ``tau^2 y'' = alpha (beta (g - y) - tau y') + f(s)``, with the same logarithm for the
    orientation, so start, goal, duration, alpha and beta carry over as they are and a new goal has
    the same effect.  The forcing terms are not spanned by the same functions: theirs have a phase
    that always falls to 0.01 and Gaussians 1.5 distances wide, ours fall to ``exp(-alpha_s)`` and
    are one distance wide.  Its weights are fitted to our force, densely sampled.

    How much differs: with twice as many weights as basis functions, the default, the exact
    solutions of both are 3e-7 of the path and 1e-4 degrees apart, also for a noisy recording; with
    as many weights 2e-7 for a smooth one and 4e-4 for a noisy one, with half as many 3e-3.  Its own
    integration adds an error of first order: with 1000 steps 0.002 of the path and 0.2 degrees
    where the motion is smooth, up to 0.03 and 2 degrees where it is noisy.

    What does not carry over: constraints (those of a ConstrainedDMP hold in noslip only; joints
    leave theirs and their robot behind); channels; and, in ``open_loop``, the velocity at the
    start, which theirs always begin without.  It is stored, and kept by ``theirs.step(y, yd)`` from
    ``reset()`` on.

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
    CartesianDMP or DMP
        In seconds, meters and radians, quaternions (qw, qx, qy, qz), or the coordinates' own units;
        ``smooth_scaling`` is off.

    Raises
    ------
    MissingDependencyError
        If movement_primitives is not installed.
    InputError
        If it has no such primitive: of a rhythm or several tools; or if the motion turns more than
        135 degrees away from its goal: noslip leads it there by a goal that moves, CartesianDMP has
        none.
    """
    library = need("interop", "movement_primitives.dmp", "interop")
    law = _law(dmp)
    space, tau = law.space, dmp.duration
    if law.clock.returns:
        raise InputError(
            "dmp is a rhythm, of which movement_primitives has none; to_pydmps takes those of "
            "vectors"
        )
    if space.rotations and (space.linear, space.rotations) != (POSE.linear, POSE.rotations):
        raise InputError(
            f"dmp moves {space.rotations} tools, a CartesianDMP one; learn a primitive of each"
        )
    if space.rotations and len(law.goal.winding.quaternions) > 1:
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
    options = {
        "execution_time": tau,
        "dt": _step(time_step, tau / law.steps),
        "n_weights_per_dim": count,
        "alpha_y": law.attractor.alpha,
        "beta_y": law.attractor.beta,
    }
    if space.rotations:
        made = library.CartesianDMP(**options)
    else:
        made = library.DMP(space.linear, **options)
    fractions = _fractions(own, count)
    forces = law.forcing(law.clock.at(fractions))
    for theirs, columns in zip(_terms(made), _parts(space), strict=True):
        activations = theirs.design_matrix(fractions * tau).T
        theirs.weights_[:, :] = _fitted(activations, forces[:, columns]).T
    # Theirs to write to; ours are not.
    start, goal = np.array(law.start), np.array(law.goal.point)
    made.configure(t=0.0, start_y=start, start_yd=law.start_velocity / tau, goal_y=goal)
    return made


def from_movement_primitives(
    dmp: CartesianDMP | DMP,
    *,
    basis_functions: int | None = None,
    names: Sequence[str] | None = None,
) -> ConstrainedDMP:
    """Return movement_primitives' CartesianDMP or DMP as a primitive without constraints.

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
    dmp : CartesianDMP or DMP
        With a start and a goal (``imitate`` and ``configure`` set them).  ``start_yd`` is the
        velocity the motion starts with; its own ``open_loop`` leaves it out.
    basis_functions : int, optional
        By default four a weight, 200 or more.
    names : sequence of str, optional
        Of the coordinates of a DMP; by default "x0", "x1", ...

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
    library = need("interop", "movement_primitives.dmp", "interop")
    if not isinstance(dmp, (library.CartesianDMP, library.DMP)):
        raise InputError(f"dmp must be a CartesianDMP or a DMP, got {_arguments.short(dmp)}")
    kind = type(dmp).__name__
    tau = _arguments.positive("execution_time_", dmp.execution_time_, "seconds")
    own_step = _arguments.positive("dt_", dmp.dt_, "seconds")
    poses = isinstance(dmp, library.CartesianDMP)
    instead = f": learn({'from_pqs' if poses else 'ns.Trajectory'}(*dmp.open_loop()))"
    attractor = Attractor(
        *(_single(kind, name, getattr(dmp, name), instead) for name in _CONSTANTS)
    )
    velocity = tau * _finite(kind, "start_yd", dmp.start_yd)
    if poses:
        if names is not None:
            raise InputError("names: are those of a DMP's coordinates; a CartesianDMP has poses")
        # A CartesianDMP that was never configured has zeros in place of quaternions.
        ends = from_pqs([0.0, tau], [dmp.start_y, dmp.goal_y], name=f"{kind} (start, goal)")
        space, (start, last) = POSE, to_pqs(ends)
        goal = Goal(last[:3], Winding(last[None, 3:]))
    else:
        space = _space(names, len(velocity))
        start, last = (_finite(kind, name, getattr(dmp, name)) for name in ("start_y", "goal_y"))
        goal = Goal(last)
    usual = max(FEWEST_BASIS_FUNCTIONS, BASIS_FUNCTIONS_PER_WEIGHT * dmp.n_weights_per_dim)
    basis = _basis(basis_functions, usual, Phase(float(_terms(dmp)[0].alpha_z)))
    fractions = _fractions(basis.count, dmp.n_weights_per_dim)
    phases = basis.phase.at(fractions)
    forces = np.vstack([theirs(fractions * tau) for theirs in _terms(dmp)]).T
    if dmp.smooth_scaling:
        way = space.difference(goal.point[None], start[None])[0]
        forces = forces - attractor.stiffness * np.outer(phases, way)
    if not np.isfinite(forces).all():
        raise InputError(f"{kind}: a weight is not finite; imitate a demonstration first")
    law = Law(
        attractor,
        ForcingTerm(basis, _fitted(basis.activations(phases), forces)),
        start,
        velocity,
        goal,
        duration=tau,
        steps=_enough_steps(tau / own_step),
        space=space,
    )
    return ConstrainedDMP(law, no_rule(space))


_CONSTANTS = ("alpha_y", "beta_y")
"""Of the attractor, as movement_primitives calls them."""


def _terms(theirs: Any) -> tuple[Any, ...]:
    """Forcing terms of a primitive of movement_primitives."""
    if hasattr(theirs, "forcing_term_pos"):
        return theirs.forcing_term_pos, theirs.forcing_term_rot
    return (theirs.forcing_term,)


def _parts(space: Space) -> tuple[slice, ...]:
    """Columns of our force that each of them has."""
    moved, turned = slice(space.linear), slice(space.linear, None)
    return (moved, turned) if space.rotations else (moved,)


# -------------------------------------------------------------------- pydmps


def to_pydmps(
    dmp: ConstrainedDMP, *, functions: int | None = None, time_step: float | None = None
) -> dict[str, Any]:
    """Return what makes pydmps' DMPs_discrete, or of a rhythm its DMPs_rhythmic, of vectors.

    ``DMPs_discrete(**to_pydmps(dmp)).rollout(tau=1 / dmp.duration)`` moves alike, and of a rhythm
    ``DMPs_rhythmic(**to_pydmps(dmp)).rollout(tau=2 * np.pi / dmp.duration)`` a period.  noslip
    needs no pydmps for it.

    Both obey the same equation, a rhythm in radians of its phase, which starts at 1 there.  Start,
    goal, alpha, beta and alpha_s carry over as they are; the weights are fitted to our force,
    densely sampled.

    How much differs: the exact solutions are 1e-6 of the path apart for smooth motions, with as
    many functions as ours.  Its own integration is of first order: 0.01 of the path with 500 steps,
    twice as many half of it.

    What does not carry over: constraints, those of joints as well; the velocity at the start, which
    theirs always begins without; and the effect of a new goal, by which it stretches the motion of
    each coordinate.  A goal equal to the start, which that cannot have, is 1e-4 off it there, and
    reached where it is all the same.

    Parameters
    ----------
    dmp : ConstrainedDMP
        Of vectors or joints.
    functions : int, optional
        Its ``n_bfs``; by default as many as ours.
    time_step : float, optional
        Its ``dt`` (s); by default that of our rollouts.

    Returns
    -------
    dict
        Arguments by name; arrays of shape (n,), weights of shape (n, n_bfs).

    Raises
    ------
    InputError
        If something turns: pydmps knows vectors alone.
    """
    law = _law(dmp)
    if law.space.rotations:
        raise InputError(
            "dmp has rotations, which pydmps has not; to_movement_primitives takes poses"
        )
    own, size = law.basis.count, law.space.linear
    count = own
    if functions is not None:
        count = _arguments.count("functions", functions, MOST_BASIS_FUNCTIONS)
    start, goal = law.start_position, law.goal_position
    goal = np.where(goal == start, goal + APART, goal)
    fractions = _fractions(own, count)
    forces = law.forcing(law.clock.at(fractions))
    forces = forces - law.attractor.stiffness * (goal - law.goal_position)
    constants: dict[str, Any] = {}
    if law.clock.returns:
        unit = 2 * pi
        angles = FIRST_ANGLE + unit * fractions
        centers = unit * np.arange(count) / count
        functions_there = np.exp(count * (np.cos(angles[:, None] - centers) - 1))
        factor = np.ones(len(fractions))
    else:
        unit, constants["ax"] = 1.0, law.clock.alpha_s
        factor = law.clock.at(fractions)
        centers = law.clock.at(np.linspace(0, 1, count))
        sharpness = count**1.5 / centers / law.clock.alpha_s
        functions_there = np.exp(-sharpness * (factor[:, None] - centers) ** 2)
        forces = forces / (goal - start)
    activations = factor[:, None] * functions_there / functions_there.sum(axis=1)[:, None]
    return constants | {
        "n_dmps": size,
        "n_bfs": count,
        "dt": _step(time_step, dmp.duration / law.steps),
        "y0": np.array(start),
        "goal": goal,
        "w": _fitted(activations, forces / unit**2, LEAST_APART).T,
        "ay": np.full(size, law.attractor.alpha / unit),
        "by": np.full(size, law.attractor.beta / unit),
    }


FIRST_ANGLE = 1.0
"""Radians of its phase at which a rhythm of pydmps starts."""


def from_pydmps(
    dmp: Any,
    *,
    duration: float | None = None,
    basis_functions: int | None = None,
    names: Sequence[str] | None = None,
) -> ConstrainedDMP:
    """Return pydmps' DMPs_discrete or DMPs_rhythmic as a primitive without constraints.

    Of what it is nothing is asked but its attributes.  Start, goal, alpha, beta and alpha_s carry
    over; the weights are fitted to its force, densely sampled, to 1e-6 of the path.  Its own
    rollouts are farther off, by their integration.  A new goal has our effect: it stretches
    nothing.  A rhythm begins here on the cycle that theirs comes to, without the way there from
    rest.

    Parameters
    ----------
    dmp : DMPs_discrete or DMPs_rhythmic
    duration : float, optional
        Seconds, or of a rhythm its period; by default those of ``rollout()``, 1 and 2 pi.  Of
        ``rollout(tau=...)`` they are divided by tau.
    basis_functions : int, optional
        By default as many as its, 200 or more.
    names : sequence of str, optional
        Of the coordinates; by default "x0", "x1", ...

    Returns
    -------
    ConstrainedDMP
        Without constraints; ``learn(made.rollout(), constraints)`` adds them.

    Raises
    ------
    InputError
        If it is none of them, a number is not finite, or ay or by differ between dimensions.
    """
    pattern = getattr(getattr(dmp, "cs", None), "pattern", None)
    if pattern not in ("discrete", "rhythmic"):
        raise InputError(
            f"dmp must be a DMPs_discrete or a DMPs_rhythmic of pydmps, got {_arguments.short(dmp)}"
        )
    kind = type(dmp).__name__
    is_cyclic = pattern == "rhythmic"
    unit = 2 * pi if is_cyclic else 1.0
    tau = float(dmp.cs.run_time)
    own = tau / _arguments.positive(f"{kind}: dt", dmp.dt, "seconds")
    if duration is not None:
        tau = _arguments.positive("duration", duration, "seconds")
    attractor = Attractor(*(unit * _single(kind, name, getattr(dmp, name)) for name in _ITS))
    start, last = (_finite(kind, name, getattr(dmp, name)) for name in ("y0", "goal"))
    space = _space(names, len(start))
    clock = Cycle() if is_cyclic else Phase(float(dmp.cs.ax))
    basis = _basis(basis_functions, max(FEWEST_BASIS_FUNCTIONS, dmp.n_bfs), clock)
    fractions = _fractions(basis.count, dmp.n_bfs)
    phases = clock.at(fractions)
    theirs = FIRST_ANGLE + unit * fractions if is_cyclic else phases
    functions_there = dmp.gen_psi(theirs)
    weighed = functions_there @ np.asarray(dmp.w).T / functions_there.sum(axis=1)[:, None]
    factors = [dmp.gen_front_term(theirs, index) for index in range(len(start))]
    forces = unit**2 * weighed * np.column_stack(factors)
    if not np.isfinite(forces).all():
        raise InputError(f"{kind}: a weight is not finite; imitate a demonstration first")
    law = Law(
        attractor,
        ForcingTerm(basis, _fitted(basis.activations(phases), forces)),
        start,
        np.zeros(len(start)),
        Goal(last),
        duration=tau,
        steps=_enough_steps(own),
        space=space,
    )
    rule = no_rule(space)
    return ConstrainedDMP(settled(law, rule) if is_cyclic else law, rule)


_ITS = ("ay", "by")
"""Constants of the attractor, as pydmps calls them."""


# -------------------------------------------------------------------- both


def _law(dmp: Any) -> Law:
    if not isinstance(dmp, ConstrainedDMP):
        raise InputError(f"dmp must be a ConstrainedDMP, got {_arguments.short(dmp)}")
    return dmp.law


def _step(asked: float | None, usual: float) -> float:
    return usual if asked is None else _arguments.positive("time_step", asked, "seconds")


def _basis(asked: int | None, usual: int, clock: Phase | Cycle) -> Basis:
    count = min(usual, MOST_BASIS_FUNCTIONS)
    if asked is not None:
        count = _arguments.count("basis_functions", asked, MOST_BASIS_FUNCTIONS)
    return Basis(count, clock)


def _space(names: Sequence[str] | None, size: int) -> Space:
    called = [f"x{k}" for k in range(size)] if names is None else list(names)
    if len(called) != size:
        raise InputError(f"names: got {len(called)}, but dmp has {size} dimensions; give one each")
    return vectors(called, ["1"] * size)


def _enough_steps(own: float) -> int:
    """Its own number of steps, multiplied until there are enough."""
    steps = max(1, round(own))
    return steps * -(-FEWEST_STEPS // steps)


def _fractions(*counts: int) -> Floats:
    """Instants of the motion, evenly spaced from 0 to 1, at which a force is sampled."""
    return np.linspace(0.0, 1.0, SAMPLES_PER_FUNCTION * max(counts) + 1)


def _fitted(activations: Floats, forces: Floats, apart: float | None = None) -> Floats:
    """Weights, shape (K, d), of the least squares fit to forces, shape (N, d).

    What of the functions is less apart from the others than a share of their size is left out.
    """
    # Activations shrink with the phase, to a hundredth: scaled, so that no function counts as null.
    scale = np.linalg.norm(activations, axis=0)
    weights = lstsq(activations / scale, forces, cond=apart, lapack_driver="gelsy")[0]
    return np.asarray(weights / scale[:, None])


def _finite(kind: str, name: str, values: Any) -> Floats:
    found = np.array(_arguments.numbers(f"{kind}: {name}", values), dtype=np.float64)
    if not np.isfinite(found).all():
        raise InputError(f"{kind}: {name} is not finite")
    return found


def _single(kind: str, name: str, values: Any, instead: str = "") -> float:
    """Return what all dimensions share; else say how to go on instead."""
    if np.ptp(values) != 0.0:
        raise InputError(
            f"{kind}: {name} is {_arguments.short(values)}, and must be one number here; "
            f"learn from its rollout{instead}"
        )
    return float(np.ravel(values)[0])
