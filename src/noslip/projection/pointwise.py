"""Pointwise projection: Gauss's principle in each step, exact in discrete time.

The paper's coupling term is the least change of the acceleration, in a metric M, that satisfies the
constraint (Udwadia-Kalaba, eq. 15):

    ``a = a_u + M^-1 A^T (A M^-1 A^T)^+ (b - A a_u)``

Evaluated once a step, this formula leaves an error of the order of the step.  Here the velocities
``v+, w+`` of a step are chosen such that the *discrete motion* satisfies the constraint itself,
:meth:`ConstraintSystem.of_step`: at velocity level the middle of the step, at position level its
end.  It is the same projection, iterated by Newton's method in the same metric a fixed number of
times, unrolled in the expression graph.

Along which rows a correction goes is one choice, :data:`Push`:

- ``"force"``: along the rows at the step's start, ``D = d phi / d (v, w)`` at ``(t_k, p_k, R_k)``
  with the mean of the velocities before and after.  The motion of a body under constraint forces is
  then of second order (at position level this is SHAKE, Ryckaert et al. 1977).
- ``"steering"``: along the derivative of the step's own residual, J.  Where rotation shares a
  correction it does so through a lever of half a step, which D does not have.

Limits ``h >= 0`` take part in the same projection as barrier rows, so that each pass is a quadratic
program (:mod:`noslip.projection.quadratic`).  Equality and limit share one rule for what a residual
may be after a step (:func:`_residual_after`): the equality must equal it, the limit must not fall
below it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from noslip import _arguments
from noslip._typing import Expression, Floats
from noslip.constraints.declaration import Constraint
from noslip.constraints.system import ConstraintSystem, as_system
from noslip.errors import ConstraintError
from noslip.law.step import Coupled, Coupling, StepSymbols
from noslip.projection.balls import Balls
from noslip.projection.nearest import nearest
from noslip.projection.quadratic import Pushes, hold, least_push
from noslip.rotations import quaternion_product, quaternion_turn
from noslip.space import Space

Push = Literal["force", "steering"]

POSITION_ONLY: tuple[float, ...] = (1.0, 1.0, 1.0, 0.0, 0.0, 0.0)
"""M^-1 of the paper: infinite rotational inertia, so that only the position gives way."""


def position_only(space: Space) -> tuple[float, ...]:
    """The paper's M^-1 in a space: the coordinates give way, rotations are held."""
    return (1.0,) * space.linear + (0.0,) * space.angular


RELATIVE_TIKHONOV = 1e-12
"""Added to ``A M^-1 A^T``, its rows scaled to unit norm: makes dependent rows harmless."""
_VANISHED = 1e-14
"""A row this much smaller than the others, squared, has vanished."""
_SMALLEST_PIVOT = 1e-200
_NEGLIGIBLE = 1e-12
"""Violation of a limit, over the velocity that the limits ask for, that is left alone."""
_REACHED, _STOPPING = 1e-7, 0.1
"""Violation, so relative, up to which a hard limit is kept; how much less that of a stop is."""
_MISSED, _ROUNDING = 1e-10, 1e-14
"""Residual at which an equality is missed, besides what the rounding of positions makes of it."""
_SMALL_TURN, _LARGEST_TURN = 0.02, 0.5
"""Correction of a step's turn (rad) in which rows are near linear, and the longest: half as much
lets tools that pass an obstacle slide off their path, twice as much is not always converged."""
_STRAIGHT = 0.01
"""Largest share of the rotation in corrections of what is left, over that of the position."""
_BEYOND = 1e300
"""A margin that no motion has."""
_STILL = 1e-11
"""Speed (m/s) of a tool at rest."""
_APPROACHING, _RESTORING = 3, 3
"""Newton steps to the nearest point, and then straight onto the constraint: what is asked and what
pushes differ by half a step's turn, of which each of the former leaves a higher power.  Of limits
who pushes is settled in the first, and each of the others may mend it."""
_STRETCHING = 6
"""Of the former with balls among the limits."""
_HARD_CAP, _SOFT_CAPS = 1e7, (3e1, 3e4)
"""Largest multiplier of a hard limit, and of the least and most important soft one, over the
velocity that the limits ask for."""


def gauss_acceleration(
    unconstrained: ArrayLike, A: ArrayLike, b: ArrayLike, inverse_metric: ArrayLike = POSITION_ONLY
) -> Floats:
    """Constrained acceleration by the Udwadia-Kalaba formula (the paper's eqs. 13 and 15).

    Parameters
    ----------
    unconstrained : array, shape (6,)
        Linear, then angular acceleration (m/s^2, rad/s^2), world frame.
    A : array, shape (m, 6)
    b : array, shape (m,)
    inverse_metric : array, shape (6,)
        Diagonal of M^-1; a zero keeps that acceleration as it is.

    Returns
    -------
    array, shape (6,)
    """
    a, A, b = (np.asarray(x, dtype=np.float64) for x in (unconstrained, A, b))
    weighted = np.asarray(inverse_metric, dtype=np.float64)[:, None] * A.T
    return np.asarray(a + weighted @ (np.linalg.pinv(A @ weighted, hermitian=True) @ (b - A @ a)))


def coupling(
    constraints: ConstraintSystem | Constraint | Sequence[Constraint],
    *,
    inverse_metric: Sequence[float] | None = None,
    push: Push = "force",
) -> Coupling:
    """Build the coupling term that holds constraints at each step.

    A violation present before a step shrinks at the step's ``residual_rate``: like
    ``exp(-rate t)`` at velocity level, like a critically damped oscillator of that rate at
    position level.  The margin of a limit shrinks no faster than that, at its ``barrier_rate``.

    Parameters
    ----------
    constraints : ConstraintSystem or constraints
        Equalities and limits.
    inverse_metric : n + 3 b numbers
        Diagonal of M^-1; position only by default, as in the paper.
    push : "force" or "steering"
        Along which rows velocity-level equalities push.

    Returns
    -------
    Coupling
        For :class:`noslip.runtime.stepper.Stepper`; rows of equalities first.
    """
    system = as_system(constraints)
    space = system.space
    metric = _arguments.inverse_metric(
        position_only(space) if inverse_metric is None else inverse_metric, space.velocity_size
    )
    _require_holdable(system, metric)

    def couple(s: StepSymbols, linear: Expression, angular: Expression) -> Coupled:
        step = _Step(system, metric, push, s, ca.vertcat(linear, angular))
        velocities, multipliers, forces, yielding = step.solve()
        return Coupled(
            *step.parted(velocities),
            step.values(velocities),
            multipliers / s.kick,
            forces / s.kick,
            yielding,
        )

    return couple


def without_limits(
    system: ConstraintSystem, *, inverse_metric: Sequence[float], push: Push
) -> Coupling:
    """Build the coupling term of the equalities alone; it suffices where no limit stops its motion.

    Parameters
    ----------
    system : ConstraintSystem
        With limits.
    inverse_metric, push
        As for :func:`coupling`.
    """
    metric = tuple(inverse_metric)

    def couple(s: StepSymbols, linear: Expression, angular: Expression) -> Coupled:
        free, limits = ca.vertcat(linear, angular), ca.SX(system.limits.size, 1)
        whole = _Step(system, metric, push, s, free)
        size = system.space.velocity_size
        velocities, multipliers, forces, lost = free, ca.SX(0, 1), ca.SX(size, 0), ca.SX(0)
        if system.equalities.size:
            alone = _Step(system.equalities, metric, push, s, free)
            velocities, multipliers, forces, _ = alone.solve()
            lost, _, _ = alone.merit(velocities, alone.jacobian)
        # Of limits, how far beyond each; and not so near that one could be met on the way there, of
        # which the passes see linear parts.
        values, before = (whole.values(at) for at in (velocities, free))
        there, here = (each[system.equalities.size :, :] for each in (values, before))
        goal = _residual_after(system.limits, s, _barrier_rates(system.limits, s), usual=True)
        # Written so that what is undefined stops it.
        clear = ca.sum1(goal - there + ca.fabs(there - here) <= 0) == system.limits.size
        return Coupled(
            *whole.parted(velocities),
            values,
            ca.vertcat(multipliers, limits) / s.kick,
            ca.horzcat(forces, ca.SX(size, system.limits.size)) / s.kick,
            ca.SX(system.size, 1),
            suffices=ca.logic_and(clear, ca.logic_not(lost)),
        )

    return couple


class _Step:
    """The projection of one step's velocities: equalities first, then limits, row by row."""

    def __init__(
        self,
        system: ConstraintSystem,
        metric: tuple[float, ...],
        push: Push,
        s: StepSymbols,
        unconstrained: Expression,
    ) -> None:
        self.s, self.unconstrained, self.metric = s, unconstrained, metric
        self.weights = ca.DM(list(metric))
        self.space, self.n = system.space, system.space.linear
        self.size = self.space.velocity_size
        self.shared = any(metric[: self.n]) and any(metric[self.n :])
        self.equalities, self.limits = system.equalities, system.limits
        self.unknown = ca.SX.sym("nu", self.size)
        # What the metric holds stays a known value: it then drops out of the derivatives.
        self.free = ca.vertcat(
            *(unconstrained[i] if metric[i] == 0 else self.unknown[i] for i in range(self.size))
        )
        # Position-level rows over the step's length have the scale of velocities, and multipliers
        # of accelerations, as velocity-level rows do.
        levels = self.equalities.row_levels + self.limits.row_levels
        scale = ca.vertcat(
            ca.SX(0, 1),
            *(1 / s.time_step if level == "position" else ca.SX(1) for level in levels),
        )
        after = ca.vertcat(
            _residual_after(
                self.equalities,
                s,
                [
                    s.slip_rate if is_velocity else s.residual_rate
                    for is_velocity in self.equalities.row_is_velocity
                ],
                s.values[: self.equalities.size],
            ),
            _residual_after(self.limits, s, _barrier_rates(self.limits, s)),
        )
        self.phi = scale * self.values(self.free)
        self.goal = scale * after
        self.jacobian = ca.jacobian(self.phi, self.unknown)
        is_force = [push == "force"] * self.equalities.size + [False] * self.limits.size
        self.by_force = [
            i
            for i, (level, pushes) in enumerate(zip(levels, is_force, strict=True))
            if level == "position" or (level == "velocity" and pushes)
        ]
        self.start_rows = self._start_rows()
        # Of limits it is settled step by step who pushes.
        self.is_linear = not self.limits.size and not ca.depends_on(self.jacobian, self.unknown)
        # One linear row, rotation held: along the row at the start it is one division.
        self.is_division = (
            self.is_linear
            and self.by_force == [0]
            and self.equalities.row_levels == ["velocity"]
            and not any(metric[self.n :])
            and not ca.depends_on(self.start_rows, self.unknown)
        )
        self.caps, self.asked = _caps(self.limits), ca.SX(_SMALLEST_PIVOT)
        at = (s.time - s.time_step, s.position, s.quaternion, *self.parted(self.free))
        margins = self.limits.residual(*at, *self._accelerations(self.free))
        self.hard = ca.SX([float(priority == 0) for priority in _priorities(self.limits)])
        self.balls = Balls(self.limits, margins, self.unknown, unconstrained)
        self.ball_rows = [self.equalities.size + i for i in self.balls.rows]
        # Slower than this, a turn can do nothing for a tool that must not slip.
        self.floor = ca.sum1(self.weights) * (_STILL * s.time_step) ** 2 + _SMALLEST_PIVOT

    def _start_rows(self) -> Expression:
        """Rows as they are at the step's start, along which forces act."""
        s, now = self.s, ca.SX.sym("now", self.size)
        at = (s.time - s.time_step, s.position, s.quaternion, *self.parted(now))
        rates = ca.vertcat(self.equalities.first_order(*at), self.limits.first_order(*at))
        held = ca.DM([float(weight != 0) for weight in self.metric])
        rows = ca.jacobian(rates, now) @ ca.diag(held)
        before = ca.vertcat(s.linear_velocity, s.angular_velocity)
        return ca.substitute(rows, now, (before + self.free) / 2)

    def values(self, velocities: Expression) -> Expression:
        """Residuals, then margins, of the step."""
        s, moving = self.s, self.parted(velocities)
        step = (s.time - s.time_step, s.time_step, s.position, s.quaternion, *moving)
        return ca.vertcat(
            self.equalities.of_step(*step),
            self.limits.of_step(*step, *self._accelerations(velocities)),
        )

    def _accelerations(self, velocities: Expression) -> tuple[Expression, Expression]:
        s = self.s
        before = ca.vertcat(s.linear_velocity, s.angular_velocity)
        return self.parted((velocities - before) / s.kick)

    def parted(self, velocities: Expression) -> tuple[Expression, Expression]:
        """Linear and angular part of a velocity or acceleration."""
        return velocities[: self.n], velocities[self.n :]

    def solve(self) -> tuple[Expression, Expression, Expression, Expression]:
        """Velocities, impulses (m,), their parts of the velocities (n + 3 b, m), who yields."""
        approaching, restoring = self._passes()
        velocities, impulses = self.unconstrained, ca.SX(self.phi.shape[0], 1)
        parts = ca.SX(self.size, self.phi.shape[0])
        pushes = None
        value, rows, along = self._linear_at(velocities)
        for iteration in range(approaching + restoring):
            reach = self.goal - value
            if self.is_division:
                impulses = reach / (rows @ ca.diag(self.weights) @ along.T + self.floor)
                parts = _columns(ca.diag(self.weights), along, impulses)
                velocities = self.unconstrained + parts
            elif iteration < approaching:
                rows[self.by_force, :] = along[self.by_force, :]
                # Nearest to the unconstrained velocities.  Multipliers are corrected, not found
                # anew: what the regularization leaves out of one pass the next makes up for.
                lengths, facets = self._lengths(value), rows[self.ball_rows, :]
                pull = self.balls.forces(lengths, facets, self.unconstrained - velocities)
                pulled = self.unconstrained + self._inverse() @ ca.sum2(pull)
                reach += ca.mtimes(rows, velocities - pulled)
                impulses, pushes = self._push(rows, reach, iteration, impulses, pushes, False)
                before = velocities
                velocities = pulled + ca.sum2(_columns(self._inverse(), rows, impulses))
                parts = _columns(ca.diag(self.weights), rows, impulses)
                pull = self.balls.forces(lengths, facets, velocities - before)
                parts[:, self.ball_rows] = ca.diag(self.weights) @ pull
                value, rows, along = self._linear_at(velocities)
                if self.balls.rows and pushes:
                    impulses[self.ball_rows] = self.balls.stiffness * self._lengths(value)
                    pushes = self._stretch(value, rows, pushes)
                if iteration == 0 and self.shared and not self.is_linear:
                    self._stiffen(velocities - self.unconstrained)
            else:
                # Straight onto the constraint: quadratic, where the nearest point is linear.
                if self.shared and not self.is_linear:
                    self._balance(rows)
                more, pushes = self._push(rows, reach, iteration, impulses, pushes, True)
                impulses += more
                added = _columns(self._inverse(), rows, more)
                parts += added
                velocities += ca.sum2(added)
                value, rows, along = self._linear_at(velocities)
        if pushes is not None and self.equalities.size:
            # Where limits contradict each other, their multipliers are large and inexact; the
            # equalities are not to suffer from that.
            more = self._hold(rows, self.goal - value)
            impulses += more
            added = _columns(ca.diag(self.weights), rows, more)
            parts += added
            velocities += ca.sum2(added)
        yielding = ca.SX(self.phi.shape[0], 1)
        if pushes is not None:
            yielding[self.equalities.size :] = pushes.yielding
            # A ball that gave way is as little missed as the others allow.
            self.hard[self.balls.rows, :] *= 1 - self.balls.yielding
        if restoring and not self.is_linear:
            change = self._fallback(velocities, rows)
            velocities = velocities + change
            # It is for all rows alike.
            parts += ca.repmat(change / parts.shape[1], 1, parts.shape[1])
        return velocities, impulses, parts, yielding

    def _linear_at(self, velocities: Expression) -> list[Expression]:
        """Residuals, their rows, and those along which forces act."""
        parts = [self.phi, self.jacobian, self.start_rows]
        return list(ca.substitute(parts, [self.unknown], [velocities]))

    def _inverse(self) -> Expression:
        return self.balls.inverse(self.weights)

    def _lengths(self, value: Expression) -> Expression:
        """What the balls bound."""
        return self.balls.radii - value[self.ball_rows, :]

    def _stretch(self, value: Expression, rows: Expression, pushes: Pushes) -> Pushes:
        """Stretch the springs of balls; who then pushes."""
        facets, balls = rows[self.ball_rows, :], self.balls
        pulls = balls.stiffness > 0
        balls.stretch(
            self._lengths(value),
            balls.radii - self.goal[self.ball_rows, :],
            facets,
            self.compliance(facets),
            self.weights,
            self.asked * self.caps[balls.rows],
        )
        pushing, yielding = ca.SX(pushes.pushing), ca.SX(pushes.yielding)
        pushing[balls.rows] = pulls * (1 - balls.yielding)
        yielding[balls.rows] = balls.yielding
        return Pushes(pushes.multipliers, pushing, yielding)

    def _stiffen(self, change: Expression) -> None:
        """Weigh rotation more where the metric would turn the tool beyond what rows are linear in.

        A rotation that is cheap beside a lever would turn it so far that Newton's method, of few
        passes, does not converge; the position takes over what the rotation leaves.  A row whose
        correction is the rotation's by r, the position's by 1 (in the metric), turns by ``f (1 + r)
        / (1 + f r)`` times as much with the rotation's inverse weights times f: that f is taken
        which leaves the small turn.
        """
        n = self.n
        turn = self.s.time_step * ca.norm_2(change[n:] + _SMALLEST_PIVOT)
        masses = ca.DM([1 / weight if weight else 0.0 for weight in self.metric])
        work = masses * change**2
        ratio = ca.sum1(work[n:]) / (ca.sum1(work[:n]) + _SMALLEST_PIVOT)
        left = ca.fmin(1, _SMALL_TURN / (turn + _SMALLEST_PIVOT))
        factor = left / (1 + ratio * (1 - left))
        self.weights = ca.vertcat(self.weights[:n], factor * self.weights[n:])

    def _balance(self, rows: Expression) -> None:
        """Weigh rotation such that what is left is for the position wherever that can mend it."""
        m, n = self.equalities.size, self.n
        A = rows[:m, :] if m else rows
        moving, turning = (
            ca.sumsqr(A[:, part] @ ca.diag(ca.sqrt(ca.DM(list(self.metric[part])))))
            for part in (slice(0, n), slice(n, self.size))
        )
        share = ca.fmin(1, _STRAIGHT * moving / (turning + _SMALLEST_PIVOT))
        factor = ca.if_else(moving > 0, share, 1)
        self.weights = ca.vertcat(self.weights[:n], factor * ca.DM(list(self.metric[n:])))

    def _fallback(self, velocities: Expression, rows: Expression) -> Expression:
        """What leads to other velocities where the passes have not come to what they should.

        Where constraints or limits all but contradict each other, a fixed number of passes may not
        suffice: a hard limit or an equality is missed, or the tool is turned by more than a step's
        linearization can bear.  Then the better of two takes their place: to stand still, which
        violates no limit that allows it, or to heed the equalities alone.
        """
        rest = ca.DM([float(weight == 0) for weight in self.metric]) * velocities
        found = self.merit(velocities, rows)
        others = [(rest, self.merit(rest, rows))]
        if self.limits.size:
            without = self._without_limits()
            others.append((without, self.merit(without, rows)))
        failed = ca.logic_or(found[0] > 0, found[1] > _REACHED * self.asked)
        best, (lost, hard, soft) = velocities, found
        for candidate, (lost_there, hard_there, soft_there) in others:
            # First the equalities, then hard limits, then soft ones by their weights.
            harder = hard_there < _STOPPING * hard
            alike = hard_there <= hard + _REACHED * self.asked
            better = ca.logic_or(
                lost_there < lost,
                ca.logic_and(
                    lost_there == lost,
                    ca.logic_or(harder, ca.logic_and(alike, soft_there < soft)),
                ),
            )
            take = ca.logic_and(failed, better)
            best = ca.if_else(take, candidate, best)
            lost = ca.if_else(take, lost_there, lost)
            hard = ca.if_else(take, hard_there, hard)
            soft = ca.if_else(take, soft_there, soft)
        return best - velocities

    def merit(
        self, velocities: Expression, rows: Expression
    ) -> tuple[Expression, Expression, Expression]:
        """Whether equalities are missed or a turn is too long; how much of limits is missed."""
        m, n = self.equalities.size, self.n
        left = self.goal - ca.substitute(self.phi, self.unknown, velocities)
        size = ca.norm_inf(self.s.position) / self.s.time_step + ca.norm_inf(velocities[:n])
        lost = ca.SX(0)
        if self.space.rotations:
            turn = self.s.time_step * ca.norm_inf(velocities[n:] - self.unconstrained[n:])
            lost = turn > _LARGEST_TURN
        if m:
            off = ca.mmax(ca.fabs(left[:m, :]))
            lost = ca.logic_or(lost, off > _MISSED + _ROUNDING * size)
        if not self.limits.size:
            return lost, ca.SX(0), ca.SX(0)
        # Where limits ask for next to nothing, what is left of it is rounding: no reason to stand.
        over = ca.fmax(left[m:, :] - ca.fmax(self.goal[m:, :], 0) - _ROUNDING * size, 0)
        G = rows[m:, :]
        norms = ca.sqrt(ca.sum2(G * (G @ ca.diag(self.weights))) + _SMALLEST_PIVOT)
        over = over / ca.fmax(norms, 1)
        return lost, ca.mmax(self.hard * over), ca.dot(self.caps * (1 - self.hard), over)

    def _without_limits(self) -> Expression:
        """Velocities that the equalities allow, without limits."""
        velocities, held = self.unconstrained, ca.SX(self.equalities.size, 1)
        if not self.equalities.size:
            return velocities
        for iteration in range(_APPROACHING + _RESTORING):
            value, rows = ca.substitute([self.phi, self.jacobian], [self.unknown], [velocities])
            A, reach = rows[: self.equalities.size, :], self.goal - value
            if iteration < _APPROACHING:
                reach += ca.mtimes(rows, velocities - self.unconstrained)
                normal = A @ ca.diag(self.weights) @ A.T
                left = reach[: self.equalities.size, :] - normal @ held
                held += _solve_regularized(normal, left, self.floor)
                velocities = self.unconstrained + ca.diag(self.weights) @ A.T @ held
            else:
                more = self._hold(rows, reach)[: self.equalities.size, :]
                velocities += ca.diag(self.weights) @ A.T @ more
        return velocities

    def _passes(self) -> tuple[int, int]:
        if self.is_division:
            return 1, 0
        if self.is_linear:
            # Rows at the step's start, along which forces push, are not those that it is asked by.
            if self.by_force:
                return _APPROACHING, 2
            # One row is divided by exactly; several are regularized, which further passes undo.
            return (1 if self.equalities.size == 1 else 3), 0
        return _STRETCHING if self.balls.rows else _APPROACHING, _RESTORING

    def _push(
        self,
        rows: Expression,
        reach: Expression,
        iteration: int,
        before: Expression,
        pushes: Pushes | None,
        restoring: bool,
    ) -> tuple[Expression, Pushes | None]:
        """Impulses such that ``A d = reach`` and ``G d >= reach`` for the d that they cause.

        All of them when approaching, those to be added to the ones before when restoring.
        """
        m, k = self.equalities.size, self.limits.size
        A, G, inverse = rows[:m, :], rows[m:, :], self._inverse()
        weighted = ca.mtimes(inverse, A.T)
        normal = ca.mtimes(A, weighted)
        known = ca.SX(m, 1) if restoring else before[:m, :]
        left = reach[:m, :] - ca.mtimes(normal, known)
        if not k:
            return known + _solve_regularized(normal, left, self.floor), None
        # Limits of unit norm, in the freedom that the equalities leave.
        pushed = ca.mtimes(inverse, G.T)
        norms = ca.sqrt(ca.sum2(G * pushed.T) + _SMALLEST_PIVOT)
        pushed, reached = pushed / ca.repmat(norms.T, self.size, 1), reach[m:, :] / norms
        both = ca.mtimes(A, pushed)
        solved = _solve_regularized(normal, ca.horzcat(left, both), self.floor)
        across = ca.mtimes(G / ca.repmat(norms, 1, self.size), weighted)
        Q = ca.mtimes(pushed.T, G.T) / ca.repmat(norms.T, k, 1) - ca.mtimes(across, solved[:, 1:])
        q = ca.mtimes(across, known + solved[:, 0]) - reached
        # In later passes little is left to ask for; what pushed before may go on.
        share = ca.SX(1)
        if self.balls.rows:
            share = norms / ca.sqrt(ca.sum2(G * (G @ ca.diag(self.weights))) + _SMALLEST_PIVOT)
        self.asked = ca.fmax(self.asked, -ca.mmin(q * share))
        springy = bool(self.balls.rows) and not restoring
        if springy:
            # Springs pull instead of their rows.
            none, yielding = ca.SX(k, 1), ca.SX(pushes.yielding) if pushes else ca.SX(k, 1)
            yielding[self.balls.rows] = 1
            pushes = Pushes(none, none, yielding)
        # Whoever pushes is found in the first pass; in the last ones hardly any is exchanged.
        late = iteration - self._passes()[0]
        some = (1 + k // 6, 1, 0)[max(late, 0)]
        exchanges = k + 3 if springy or not iteration else some
        found = least_push(
            Q,
            q,
            self.asked * self.caps * share,
            _NEGLIGIBLE * ca.fmax(self.asked, -ca.mmin(q)),
            exchanges,
            before=before[m:, :] * norms * (1 - pushes.yielding) if restoring and pushes else None,
            start=pushes,
            fresh=springy,
        )
        equal = known + solved[:, 0] - ca.mtimes(solved[:, 1:], found.multipliers)

        def compliance(facets: Expression) -> Expression:
            held = _solve_regularized(normal, ca.mtimes(facets, weighted).T, self.floor)
            own = ca.mtimes(facets, ca.mtimes(inverse, facets.T) - ca.mtimes(weighted, held))
            met = ca.mtimes(pushed.T, facets.T) - ca.mtimes(across, held)
            return own - ca.mtimes(met.T, hold(Q, found.pushing, met))

        self.compliance = compliance
        return ca.vertcat(equal, found.multipliers / norms), found

    def _hold(self, rows: Expression, reach: Expression) -> Expression:
        """Impulses of the equalities alone, straight onto them."""
        m = self.equalities.size
        A = rows[:m, :]
        normal = A @ ca.diag(self.weights) @ A.T
        held = _solve_regularized(normal, reach[:m, :], self.floor)
        return ca.vertcat(held, ca.SX(self.limits.size, 1))


def _caps(limits: ConstraintSystem) -> Expression:
    """How hard each limit may push, over the velocity that the limits ask for."""
    priorities = _priorities(limits)
    soft = sorted({p for p in priorities if p > 0})
    graded = np.geomspace(_SOFT_CAPS[1], _SOFT_CAPS[0], max(2, len(soft)))
    return ca.DM([_HARD_CAP if p == 0 else graded[soft.index(p)] for p in priorities])


def _priorities(limits: ConstraintSystem) -> list[int]:
    return limits.per_row(c.priority for c in limits.constraints)


def _columns(inverse: Expression, rows: Expression, impulses: Expression) -> Expression:
    """What each row adds to the velocities, in an inverse metric, shape (n + 3 b, m)."""
    return ca.mtimes(ca.mtimes(inverse, rows.T), ca.diag(impulses))


def _require_holdable(system: ConstraintSystem, metric: tuple[float, ...]) -> None:
    """Refuse a constraint that nothing which the metric leaves free can influence."""
    for name, holdable in zip(system.row_names, holdable_rows(system, metric), strict=True):
        if not holdable:
            raise ConstraintError(
                f"constraint {name!r} asks nothing of what the metric leaves free; let position "
                'and rotation give way: metric="shared"'
            )


def holdable_rows(system: ConstraintSystem, metric: Sequence[float]) -> list[bool]:
    """For each row, whether what a metric leaves free influences it within a step."""
    influence = system.owned("influence", lambda: _influence(system))
    reaches = influence * np.asarray(metric, dtype=np.float64) > 1e-9 * influence.max(
        axis=1, keepdims=True, initial=0.0
    )
    return [bool(row.any()) for row in reaches]


def _influence(system: ConstraintSystem) -> Floats:
    """Largest slope of each row with respect to the velocities of a step, shape (m, n + 3 b).

    Tried at random states: an expression may mention what it does not depend on.
    """
    space, h = system.space, 1e-3
    sizes = (1, space.linear, 4 * space.rotations, space.linear, space.angular)
    t, p, q, v, w = (ca.SX.sym(name, size) for name, size in zip("tpqvw", sizes, strict=True))
    turned = space.each(lambda q: q / ca.norm_2(q), q)
    after = system.of_step(t, h, p, turned, v, w, v / h, w / h)
    rows = ca.Function("rows", [t, p, q, v, w], [ca.jacobian(after, ca.vertcat(v, w))])
    random = np.random.default_rng(0)
    influence = np.zeros((system.size, space.velocity_size))
    for _ in range(3):
        found = rows(*(random.normal(size=n) for n in sizes))
        influence = np.fmax(influence, np.abs(np.array(found)).reshape(influence.shape))
    return influence


def _residual_after(
    system: ConstraintSystem,
    s: StepSymbols,
    rates: Sequence[Expression],
    values: Expression | None = None,
    *,
    usual: bool = False,
) -> Expression:
    """What residuals may be after the step: zero, once they were zero.

    At velocity level ``exp(-rate kick)`` times what they were in the middle of the step before, or
    are at the start: the values that the state carries, of a motion that was commanded; for limits,
    found from the state, which may have been measured.  At position level the solution of the
    critically damped oscillator, ``(r + c dt) exp(-rate dt)`` with ``c = dr/dt + rate r`` found
    from the previous sample; that is where the discrete motion came from, so a motion on the
    constraint stays on it to rounding.

    The margin of a limit may shrink like that, which is a barrier of relative degree one or two;
    three things are kept besides.  It never falls below zero from above, however fast the limit is
    approached (c < 0).  Standing still is always allowed, so that limits which allow rest never
    contradict each other: at position level no more is asked for than to come no closer, at
    velocity level no more than not to violate it, unless a rate is named.  And a tool outside of a
    limit of poses, though its way out is stopped at that rate, comes in as onto an equality, at
    :attr:`StepSymbols.residual_rate` unless one is named: from rest by d at ``rate d / e`` at most.

    ``usual`` leaves out the start and the outside of limits of poses, where nothing then suffices.
    """
    before, dt, previous = s.time - s.time_step, s.time_step, s.previous_step
    state = (before, s.position, s.quaternion, s.linear_velocity, s.angular_velocity)
    now, drift = system.residual(*state), system.first_order(*state)
    each = system.space.each
    half_back = each(quaternion_turn, -previous / 2 * s.angular_velocity)
    middle = system.residual(
        before - previous / 2,
        s.position - previous / 2 * s.linear_velocity,
        each(quaternion_product, half_back, s.quaternion),
        s.linear_velocity,
        s.angular_velocity,
    )
    back = each(quaternion_product, half_back, half_back)
    earlier = system.residual(
        before - previous,
        s.position - previous * s.linear_velocity,
        each(quaternion_product, back, s.quaternion),
        s.linear_velocity,
        s.angular_velocity,
    )
    targets = [ca.SX(0, 1)]
    named = system.per_row(c.barrier_rate is not None for c in system.constraints)
    for i, (level, is_limit, rate) in enumerate(
        zip(system.row_levels, system.row_is_limit, rates, strict=True)
    ):
        if level == "acceleration":
            targets.append(ca.SX(0))
            continue
        if level == "velocity":
            found = middle[i] if values is None else ca.if_else(previous > 0, values[i], now[i])
            asked = ca.exp(-rate * s.kick) * found
            targets.append(asked if named[i] or not is_limit else ca.fmin(asked, 0))
            continue

        def decayed(rate: Expression, i: int = i) -> Expression:
            change = (now[i] - ca.exp(-rate * previous) * earlier[i]) * dt / previous
            if not usual:
                # No step has led to the start; there the velocities tell.
                change = ca.if_else(previous > 0, change, (drift[i] + rate * now[i]) * dt)
            return ca.exp(-rate * dt) * (now[i] + change)

        asked = decayed(rate)
        if is_limit:
            inside = ca.fmin(ca.fmax(asked, ca.exp(-rate * dt) * now[i]), now[i])
            if usual:
                targets.append(ca.if_else((now[i] >= 0) * (previous > 0), inside, _BEYOND))
                continue
            slowly = asked if named[i] else decayed(s.residual_rate)
            outside = ca.fmax(slowly, ca.fmin(asked, now[i]))
            asked = ca.if_else(now[i] >= 0, inside, outside)
        targets.append(asked)
    return ca.vertcat(*targets)


def _barrier_rates(limits: ConstraintSystem, s: StepSymbols) -> list[Expression]:
    rates = limits.per_row(c.barrier_rate for c in limits.constraints)
    return [s.barrier_rate if rate is None else ca.SX(rate) for rate in rates]


def _solve_regularized(matrix: Expression, right: Expression, floor: Expression) -> Expression:
    """Solve a positive semi-definite system; dependent and vanished rows do no harm."""
    size = matrix.shape[0]
    if size == 0:
        return right
    if size == 1:
        return right / (matrix + floor)
    # Rows of unit norm: what is small against the others is not therefore dependent.
    diagonal = ca.diag(matrix)
    scale = ca.diag(1 / ca.sqrt(diagonal + _VANISHED * ca.sum1(diagonal) + floor))
    scaled = scale @ matrix @ scale + RELATIVE_TIKHONOV * ca.SX.eye(size)
    return scale @ ca.ldl_solve(scale @ right, *ca.ldl(ca.densify(scaled)))


def project_velocities(
    constraints: ConstraintSystem | Constraint | Sequence[Constraint],
    time: float,
    position: ArrayLike,
    quaternion: ArrayLike,
    linear_velocity: ArrayLike,
    angular_velocity: ArrayLike,
    *,
    inverse_metric: Sequence[float] | None = None,
    residual_rate: float = 0.0,
) -> tuple[Floats, Floats, Floats]:
    """Nearest velocities, in the metric, that the constraints allow at a pose.

    For the blade and the paper's metric this is the paper's projection of the initial velocity onto
    the blade's plane, ``P (P^T P)^-1 P^T v``.

    Parameters
    ----------
    residual_rate : float
        At a pose off a position-level constraint, ``d psi/dt = - rate psi`` is asked for (1/s).

    Returns
    -------
    linear_velocity, angular_velocity : array, shape (n,) and (3 b,)
    residual : array, shape (m,)
        Of the equalities at this pose and the projected velocities.
    """
    system = as_system(constraints)
    n = system.space.linear
    metric = position_only(system.space) if inverse_metric is None else inverse_metric
    levels = np.array(system.row_levels, dtype=object)
    # Limits of poses say nothing of velocities yet: their barriers do, step by step.
    counts = ~system.row_is_limit | (levels == "velocity")
    given = np.concatenate([np.ravel(linear_velocity), np.ravel(angular_velocity)]).astype(float)

    def conditions(change: Floats) -> tuple[Floats, Floats]:
        velocities = given + change
        residual, phi, rows = system.instant(
            time, position, quaternion, velocities[:n], velocities[n:]
        )
        phi = phi + np.where(levels == "position", residual_rate * residual, 0.0)
        return phi[counts], rows[counts]

    change, _ = nearest(
        conditions,
        np.add,
        system.row_is_limit[counts],
        metric,
        approaching=_APPROACHING,
        tolerance=1e-15 * max(1.0, np.abs(given).max()),
    )
    found = given + change
    residual, _, _ = system.instant(time, position, quaternion, found[:n], found[n:])
    return found[:n], found[n:], residual[~system.row_is_limit]
