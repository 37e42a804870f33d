"""A small quadratic program as a fixed expression graph: who must push, and how hard.

Gauss's principle with limits is ``min |d|_M^2 / 2`` subject to ``G d >= c``; its dual is a linear
complementarity problem in the multipliers,

    ``w = Q l + q,   0 <= l <= cap,   w >= 0 where l < cap,   l = 0 where w > 0``

with ``Q = G M^-1 G^T``.  It is solved by the dual active-set method (Goldfarb and Idnani 1983): the
most violated row is driven to its limit, and rows whose multiplier reaches zero on the way let go.
The number of exchanges is fixed and nothing branches, so the graph has one known cost and exports
as C.

A finite cap makes a limit soft: it is the weight of an exact penalty (Han and Mangasarian 1979).  A
row that would have to push harder than its cap gives way.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from noslip._typing import Expression

REGULAR = 1e-11
"""Added to the diagonal of Q, whose rows have unit norm: keeps dependent rows solvable."""
_FLAT = 1e-9
"""A driven row that moves less than this per unit of its multiplier cannot be satisfied."""
_NEVER = 1e300
_INEXACT = 30.0
"""What the regularization leaves of a row, over REGULAR and its multiplier, and a margin."""


@dataclass(frozen=True)
class Pushes:
    """Who pushes, after the exchanges.

    Attributes
    ----------
    multipliers : expression, shape (k,)
        Such that the pushing rows stand exactly at their limits.
    pushing, yielding : expression, shape (k,)
        1 for rows at their limit, and for rows that gave way; else 0.
    """

    multipliers: Expression
    pushing: Expression
    yielding: Expression


def least_push(
    Q: Expression,
    q: Expression,
    cap: Expression,
    tolerance: Expression,
    exchanges: int,
    before: Expression | None = None,
    start: Pushes | None = None,
) -> Pushes:
    """Solve the complementarity problem above.

    Parameters
    ----------
    Q : expression, shape (k, k)
        Positive semi-definite, diagonal at most 1.
    q : expression, shape (k,)
        Margin of each row without any push.
    cap : expression, shape (k,)
        Largest multiplier of each row.
    tolerance : expression
        Violation that is left alone.
    exchanges : int
        Rows that may arrive or leave.  From nothing, 2 k suffice for 99.9 % of random problems.
    before : expression, shape (k,), optional
        Multipliers to which those found here are added: a row lets go where the sum is zero.
    start : Pushes, optional
        Who pushes and who yields to begin with.
    """
    size = q.shape[0]
    before = ca.SX(size, 1) if before is None else before
    # Symmetric by half: rounding aside it is, and so it costs half.
    Q = ca.tril2symm(ca.tril(ca.densify(Q)))
    regular = Q + REGULAR * ca.SX.eye(size)
    pushing, yielding = ca.SX(size, 1), ca.SX(size, 1)
    multipliers, margins = ca.SX(size, 1), q
    if start is not None:
        pushing, yielding = start.pushing, start.yielding
        multipliers = -_solve_masked(regular, pushing, q)
        margins = q + ca.mtimes(Q, multipliers)
    driven = ca.SX(size, 1)
    for _ in range(exchanges):
        # Drive the most violated row, unless one is on its way already.
        violation = ca.if_else((1 - pushing) * (1 - yielding), -margins, 0)
        largest = ca.mmax(violation)
        inexact = _INEXACT * REGULAR * ca.mmax(ca.fabs(before + multipliers))
        new = _first(violation, largest) * (largest > ca.fmax(tolerance, inexact))
        driven = ca.if_else(ca.sum1(driven) > 0, driven, new)
        is_driven = ca.sum1(driven) > 0
        direction = driven - _solve_masked(regular, pushing, ca.mtimes(Q, driven))
        rates = ca.mtimes(Q, direction)
        rate, margin = ca.dot(driven, rates), ca.dot(driven, margins)
        full = ca.if_else(rate > _FLAT, -margin / rate, _NEVER)
        # How far until a multiplier meets zero or its cap.
        total = before + multipliers
        lost = ca.if_else(pushing * (direction < 0), ca.fmax(total, 0) / -direction, _NEVER)
        room = ca.fmax(cap - total, 0)
        spent = ca.if_else((pushing + driven) * (direction > 0), room / direction, _NEVER)
        nearest = ca.mmin(ca.fmin(lost, spent))
        arrives = full <= nearest
        # Leaves: another row, or the driven one itself that cannot be satisfied; then none moves.
        leaves = _first(-ca.fmin(lost, spent), -nearest) * (1 - arrives) * is_driven
        hopeless = ca.dot(leaves, driven)
        length = ca.if_else(is_driven * (1 - hopeless), ca.fmin(full, nearest), 0)
        multipliers += length * direction
        margins += length * rates
        gives_way = leaves * (spent <= lost)
        yielding += gives_way
        multipliers = ca.if_else(leaves * (1 - gives_way), -before, multipliers)
        pushing = pushing * (1 - leaves) + driven * arrives
        if start is None:
            # Once a row has given way, the others stand as if it had never pushed.  (Later there
            # are too few exchanges for that to matter.)
            gave = ca.sum1(gives_way) > 0
            kept = driven * (1 - gives_way) * multipliers - (1 - pushing - driven) * before
            anew = kept - _solve_masked(regular, pushing, q + ca.mtimes(Q, kept))
            multipliers = ca.if_else(gave, anew, multipliers)
            margins = ca.if_else(gave, q + ca.mtimes(Q, anew), margins)
        driven = driven * (1 - arrives) * (1 - gives_way)
    # From the set alone: what yields pushes with its whole cap against those that hold, which
    # moves nothing and would only eat up precision.
    held = q - ca.mtimes(Q, (1 - pushing) * before)
    multipliers = -_solve_masked(regular, pushing, held) - (1 - pushing) * before
    return Pushes(multipliers, pushing, yielding)


def _solve_masked(matrix: Expression, mask: Expression, right: Expression) -> Expression:
    """Solve the rows and columns that the mask selects; zero elsewhere."""
    size = right.shape[0]
    both = ca.mtimes(mask, mask.T)
    chosen = both * matrix + ca.diag(1 - mask)
    if size == 1:
        return mask * right / chosen
    return ca.ldl_solve(mask * right, *ca.ldl(ca.densify(chosen)))


def _first(values: Expression, wanted: Expression) -> Expression:
    """Mask of the first entry that equals a value."""
    found, mask = ca.SX(0), []
    for i in range(values.shape[0]):
        hit = (values[i] == wanted) * (1 - found)
        mask.append(hit)
        found = found + hit
    return ca.vertcat(*mask)
