"""Trajectory projection: the feasible trajectory nearest to a given one.

Unknown at each sample are a rotation correction delta (``R = Exp(delta) R_ref``) and, unless held,
a displacement of the position.  Minimized is, with time normalized by the duration and L the path's
length,

    ``int (w_p |p - p_ref|^2 + mu_p |p'' - p_ref''|^2) / L^2
    + w_R u |delta|^2 + g |delta'|^2 + mu_R |delta''|^2``

subject to the constraints on the discrete motion that the primitive will run: at the middle of each
step, of position level at its end.  The weight u follows the speed: a turn of the tool costs per
path cut, so nothing pulls the tool round while it rests; g is felt there alone, and keeps the turn
as it was before.  Only the change of the *correction* costs, so a feasible trajectory comes back
unchanged.

The paper's "orientation optimized for zero constraint force" is the case with the position held; a
new goal or start is the case with other boundary values.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from noslip import _arguments
from noslip._typing import Floats
from noslip.boundary import Boundary, End
from noslip.constraints.declaration import Constraint
from noslip.constraints.system import ConstraintSystem, as_system
from noslip.errors import ConvergenceError, InputError, Refusal
from noslip.projection.blend import spread
from noslip.projection.detour import around
from noslip.projection.heading import NO_TURN, turn_edge_into_path
from noslip.projection.problem import Problem
from noslip.projection.request import LEARNING, MAX_ITERATIONS, Request, Weights
from noslip.projection.result import ProjectedTrajectory
from noslip.projection.tool_first import kept_ends, led_by, tool_request
from noslip.space import Samples

_ATTEMPTS = (
    (1.0, False, 1), (10.0, True, 2), (100.0, True, 2), (100.0, False, 1), (500.0, False, 1),
    (1000.0, False, 1),
)  # fmt: skip
"""Factor on the rotation's smoothing, whether careful, factor on the iterations allowed: what one
attempt does not reach, a smoother and more patient one does; the last are for noise, and for what
curves so much that patience leads nowhere: of these one converges by luck, several surely."""
_LIMIT_ATTEMPTS = ((1.0, 1e-2, False), (1.0, 1.0, False), (1.0, 1.0, True), (100.0, 1.0, True))
"""Factor on the rotation's smoothing, first tau over the step in time normalized, careful: a small
tau is fast where few limits bind, a large one finds its way where many do."""
_LIMIT_PATIENCE = 4
"""Iterations with limits over those without: tau falls by a tenth in each at best."""
_NEARBY, _MOSTLY, _SWINGING = 20, 0.5, 1e-4
"""Steps on either side of a kept rotation in which it is seen to swing, share of the changes from
step to step that alternate, and least amplitude (rad): of a smooth turn a twentieth alternates."""
_KEPT = 1e-8
"""Residual, in the constraint's own unit, and violation of a limit at which a motion satisfies its
constraints, whether or not the iteration saw that it is the nearest: what limits converge to."""
_CLEARANCE = 3e-4
"""Of the path's length: what a fit of the path is off it, and what barriers act before a limit that
a tool passes by.  Without it every touch is a jolt, and a blade misses its goal by up to 2 %."""


def project_trajectory(
    trajectory: Any,
    constraints: ConstraintSystem | Constraint | Sequence[Constraint],
    *,
    hold_position: bool = False,
    start: End | Boundary = "free",
    end: End | Boundary = "free",
    boundaries: Sequence[Boundary] = (),
    begin: float = 0.0,
    position_weight: float = LEARNING.position,
    position_smoothing: float = LEARNING.position_smoothing,
    rotation_smoothing: float = LEARNING.rotation_smoothing,
    max_iterations: int = MAX_ITERATIONS,
    periodic: bool = False,
    on_failure: Literal["raise", "return"] = "raise",
) -> ProjectedTrajectory:
    """Find the nearest trajectory that satisfies constraints and limits at every step.

    Parameters
    ----------
    trajectory : PoseTrajectory or Trajectory
        Uniformly sampled, 4 samples or more.
    constraints : ConstraintSystem or constraints
    hold_position : bool
        Only the orientation gives way, as in the paper.
    start, end : "free", "position", "rotation", "pose" or Boundary
        What of the first and last sample stays as it is, or what it becomes: a pose, a part of one,
        or a pose with the velocities there.
    boundaries : sequence of Boundary
        What else must be reached, such as poses between the ends.
    begin : float
        Time at the first sample (s), for constraints that depend on it.
    position_weight, position_smoothing, rotation_smoothing : float
        w_p, mu_p and mu_R of the module's formula; w_R is 1.
    max_iterations : int
        Newton steps in the first attempt.  If they do not suffice, it tries again with more
        smoothing of the rotation, up to a thousandfold, and with steps that converge from farther;
        the result says with how much.
    periodic : bool
        The last sample is the first one again, of the result, too.  What does not quite end where
        it begins is closed by :func:`noslip.demonstrations.cycles.closed` first.
    on_failure : "raise" or "return"

    Raises
    ------
    InputError
        If the samples are not uniform or too many for so much smoothing, or boundary values
        contradict ``hold_position``.
    ConvergenceError
        If no attempt converges (unless ``on_failure="return"``).
    """
    given = [_given("start", start, 0.0), _given("end", end, 1.0)]
    asked: list[End] = ["free" if isinstance(e, Boundary) else e for e in (start, end)]
    kept, of_tool = kept_ends(trajectory, trajectory.space, *asked)
    first, last = (g or k for g, k in zip(given, kept, strict=True))
    request = Request(
        trajectory,
        as_system(constraints, trajectory.space),
        (first, *boundaries, last),
        Weights(position_weight, position_smoothing, rotation_smoothing),
        hold_position,
        _arguments.finite("begin", begin),
        max_iterations,
        is_periodic=_arguments.flag("periodic", periodic),
        tool_ends=of_tool,
    )
    result = project(request)
    return result if on_failure == "return" else _converged(result, request)


def project(request: Request, *, turn: bool = True) -> ProjectedTrajectory:
    """Solve a request; the best that was found if nothing converges.

    It begins with the edge turned into the path, or with the reference's own rotations.

    What the reference leads straight into it passes on one side, see :func:`detour.around`.
    Where joints carry the tool, its own motion comes first: :mod:`noslip.projection.tool_first`.

    The result's trajectory has at its ends the velocities that were asked for.
    """
    led = None
    if (of_tool := tool_request(request)) is not None:
        led = project(of_tool, turn=turn)
        request = led_by(request, led)
    elif not request.hold_position and "position" in request.system.limits.row_levels:
        passed = around(request.reference, request.system, request.begin)
        request = replace(request, reference=passed)
    best = _attempt(replace(request, system=request.system.equalities), turn)
    if best.converged and request.system.limits.size:
        best = _heed_limits(request, best)
    if _swing(best, request):
        best = replace(best, converged=False)
    if led is not None:
        best = replace(best, backing=led.backing)
    return replace(best, trajectory=_with_twists(best.trajectory, request))


def project_nearby(request: Request) -> ProjectedTrajectory:
    """Solve a request whose reference all but satisfies it, as a maneuver does; the best if not.

    It begins with the reference itself and heeds limits from the first step on: the way over the
    equalities alone leads such a reference elsewhere, and back by no step.
    """
    best: ProjectedTrajectory | None = None
    clearance = max(request.clearance, _CLEARANCE * request.reference.path_length)
    request = replace(request, clearance=clearance)
    limited = request.system.limits.size > 0
    for factor, barrier, careful in _LIMIT_ATTEMPTS:
        # Without limits all attempts begin alike, and only the careful ones lead far: of a needle's
        # turn that is all but lost, the curvature of the first steps leads nowhere.
        if not (careful or limited):
            continue
        weights = request.weights.smoother(factor)
        if len(request.reference) > weights.most_samples:
            break
        problem = Problem(replace(request, weights=weights), NO_TURN.turns)
        found = problem.solve(_LIMIT_PATIENCE * request.max_iterations, careful, barrier)
        if best is None or found.converged or found.residual < best.residual:
            best = found
        if found.converged:
            break
    assert best is not None
    return replace(best, trajectory=_with_twists(best.trajectory, request))


def project_heeding_what_it_can(request: Request) -> ProjectedTrajectory:
    """Solve a request for a primitive; limits that it cannot heed are left to the run time.

    From limits a primitive's path keeps a little clear (:data:`_CLEARANCE`).

    Raises
    ------
    ConvergenceError
        If the equalities alone do not converge.
    """
    system = request.system
    if system.limits.size:
        clear = _CLEARANCE * request.reference.path_length
        result = project(replace(request, clearance=clear))
        if result.converged:
            return result
    alone = replace(request, system=system.equalities)
    return replace(_converged(project(alone), alone), left_out=system.limits.names)


def _given(name: str, asked: End | Boundary, at: float) -> Boundary | None:
    if isinstance(asked, Boundary) and asked.at != at:
        raise InputError(f"{name}: a boundary at {at:g} is needed, got one at {asked.at:g}")
    return asked if isinstance(asked, Boundary) else None


def _converged(result: ProjectedTrajectory, request: Request) -> ProjectedTrajectory:
    """Return the result if it converged; else say what to change."""
    if result.converged:
        return result
    # What is undefined on the way lets nothing converge, and nothing that follows would help.
    for tried in (request.reference, result.trajectory):
        space, (linear, angular) = request.system.space, tried.step_velocities()
        half = np.diff(tried.times)[:, None] / 2
        middles = space.moved(tried.points[:-1], half * np.hstack([linear, angular]))
        times = tried.clock[:-1] + half[:, 0] + request.begin
        pose = middles[:, : space.linear], middles[:, space.linear :]
        request.system.require_slopes(times, *pose, linear, angular, "step")
    names = ", ".join(c.name for c in request.system.constraints)
    if swing := _swing(result, request):
        raise ConvergenceError(
            f"{request.reference.name}: with the positions held, a rotation that is kept does not "
            f"fit the path under {names}: the tool would swing by {np.degrees(swing):.2g} degrees "
            "from step to step; let the position give way (hold_position=False), or free it",
            iterate=result.trajectory,
        )
    if request.is_periodic:
        _require_closing(request, names)
    least = result.margins.min(initial=0.0)
    left = f"residual {result.residual:.2g}" + (f", margin {least:.2g}" if least < 0 else "")
    # More smoothing of the rotation is no advice: it was tried.
    remedies = ["let the position give way (hold_position=False)"] if request.hold_position else []
    remedies += ["low-pass it more", "trim its rests"]
    remedies += ["free its ends or take others"] if request.fixed else []
    advice = f"{', '.join(remedies[:-1])}, or {remedies[-1]}"
    if result.residual <= _KEPT and least >= -_KEPT:
        raise ConvergenceError(
            f"{request.reference.name}: a trajectory that satisfies {names} is found ({left} after "
            f"{result.iterations} iterations), but the projection did not converge to the nearest; "
            f"{advice}",
            iterate=result.trajectory,
        )
    raise ConvergenceError(
        f"{request.reference.name}: no trajectory near it found that satisfies {names} ({left} "
        f"after {result.iterations} iterations); {advice}",
        code=Refusal.NOT_FOUND,
        iterate=result.trajectory,
    )


def _require_closing(request: Request, names: str) -> None:
    """Refuse a period that constraints let not close, and say by how much."""
    opened = project(replace(request, is_periodic=False))
    if not opened.converged:
        return
    space, points = request.system.space, opened.trajectory.points
    gap = space.difference(points[-1:], points[:1])[0]
    away, turn = np.linalg.norm(gap[: space.linear]), np.abs(gap[space.linear :]).max(initial=0.0)
    raise ConvergenceError(
        f"{request.reference.name}: no period near it found that satisfies {names}, which let it "
        f"end {away:.3g} {request.reference.unit} from where it begins, turned by "
        f"{np.degrees(turn):.3g} degrees; take a path that closes under them",
        code=Refusal.NOT_FOUND,
        iterate=opened.trajectory,
    )


def _swing(result: ProjectedTrajectory, request: Request) -> float:
    """Amplitude (rad) by which a kept rotation that does not fit its path swings; 0 if none does.

    Held positions say where the tool heads in the middle of each step.  A rotation beside that is
    one step to the left of it and the next to the right, for ever: no smooth motion does that.
    """
    kept = [k for k, boundary in request.fixed.items() if boundary.rotation is not None]
    if not request.hold_position or not kept:
        return 0.0
    turns = result.trajectory.step_velocities()[1] * request.time_step
    steps = np.diff(turns, axis=0)
    signs = np.resize([1.0, -1.0], len(steps))[:, None]
    largest = 0.0
    for k in kept:
        near = slice(max(0, k - _NEARBY), k + _NEARBY)
        alternating = float(np.linalg.norm((signs * steps)[near].mean(axis=0)))
        if alternating > _MOSTLY * np.linalg.norm(steps[near], axis=1).mean():
            largest = max(largest, alternating / 4)
    return largest if largest > _SWINGING else 0.0


def _with_twists(trajectory: Samples, request: Request) -> Samples:
    """Return a trajectory that says of its ends what was asked for."""
    velocities = trajectory.linear_velocities.copy(), trajectory.angular_velocities.copy()
    if request.is_periodic:
        for found, steps in zip(velocities, trajectory.step_velocities(), strict=True):
            found[[0, -1]] = (steps[0] + steps[-1]) / 2
    for k, asked in request.twists.items():
        for found, wanted in zip(velocities, asked, strict=True):
            found[k] = wanted
    return trajectory.with_velocities(*velocities)


# ---------------------------------------------------------------- attempts


def _attempt(request: Request, turn: bool) -> ProjectedTrajectory:
    """Attempt after attempt at the equalities; the best result if none converges."""
    best: ProjectedTrajectory | None = None
    moved = _moved(request.reference, request.fixed)
    for factor, careful, patience in _ATTEMPTS:
        weights = request.weights.smoother(factor)
        if len(request.reference) > weights.most_samples and best is not None:
            break
        smoother = replace(request, weights=weights)
        heading = NO_TURN
        if turn:
            smoothing, periodic = weights.rotation_smoothing, request.is_periodic
            heading = turn_edge_into_path(moved, request.system, smoothing, periodic=periodic)
        problem = Problem(smoother, heading.turns)
        found = problem.solve(patience * request.max_iterations, careful)
        result = replace(found, backing=heading.backing)
        if result.converged:
            return result
        if best is None or result.residual < best.residual:
            best = result
    assert best is not None
    return best


def _heed_limits(request: Request, without: ProjectedTrajectory) -> ProjectedTrajectory:
    """Go on from the projection without limits; leave out soft ones, the least important first."""
    system = request.system
    kept, left_out = list(system.constraints), list[str]()
    names = dict(zip(map(id, system.constraints), system.names, strict=True))
    while True:
        heeded = ConstraintSystem(kept) if left_out else system
        result = _project_within(replace(request, system=heeded), without)
        least = max((c.priority for c in kept if c.relation == "nonnegative"), default=0)
        if result.converged or least == 0:
            return replace(result, left_out=tuple(left_out))
        left_out += [names[id(c)] for c in kept if c.priority == least]
        kept = [c for c in kept if c.priority < least]


def _project_within(request: Request, without: ProjectedTrajectory) -> ProjectedTrajectory:
    """Interior-point iterations from a trajectory that satisfies the equalities."""
    weights = replace(request.weights, rotation_smoothing=without.smoothing)
    turns = np.asarray(without.turns)
    best: ProjectedTrajectory | None = None
    for factor, barrier, careful in _LIMIT_ATTEMPTS[: 1 if request.is_hurried else None]:
        smoother = weights.smoother(factor)
        if len(request.reference) > smoother.most_samples:
            break
        problem = Problem(replace(request, weights=smoother), turns)
        problem.begin_at(without.trajectory)
        if problem.keeps_limits():
            held = np.zeros((len(request.reference), request.system.size))
            held[:, : request.system.equalities.size] = without.multipliers
            kept = problem.result(True, without.iterations, held)
            return replace(kept, backing=without.backing)
        result = problem.solve(_LIMIT_PATIENCE * request.max_iterations, careful, barrier)
        result = replace(result, iterations=without.iterations + result.iterations)
        if result.converged or best is None:
            best = replace(result, backing=without.backing)
        if result.converged:
            break
    assert best is not None
    return best


def _moved(trajectory: Samples, boundaries: dict[int, Boundary]) -> Samples:
    """Return the trajectory with its samples moved to where boundaries want their positions."""
    shifts: dict[int, Floats] = {
        k: boundary.position - trajectory.positions[k]
        for k, boundary in boundaries.items()
        if boundary.position is not None
    }
    if not any(shift.any() for shift in shifts.values()):
        return trajectory
    positions = trajectory.positions + spread(shifts, np.arange(len(trajectory)))
    return trajectory.with_points(np.hstack([positions, trajectory.quaternions]))
