"""A small quadratic program as an expression graph: who must push, and how hard.

Gauss's principle with limits is ``min |d|_M^2 / 2`` subject to ``G d >= c``; its dual is a linear
complementarity problem in the multipliers,

    ``w = Q l + q,   0 <= l <= cap,   w >= 0 where l < cap,   l = 0 where w > 0``

with ``Q = G M^-1 G^T``.  It is solved by the dual active-set method (Goldfarb and Idnani 1983): the
most violated row is driven to its limit, and rows whose multiplier reaches zero on the way let go.
One exchange is a graph of its own, called until nobody is left to be driven, a bounded number of
times: by conditions between graphs in CasADi's virtual machine, in C by a loop (``push.c``).

A finite cap makes a limit soft: it is the weight of an exact penalty (Han and Mangasarian 1979).  A
row that would have to push harder than its cap gives way.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca

from noslip._typing import Expression

REGULAR = 1e-11
"""Added to the diagonal of Q, whose rows have unit norm: keeps dependent rows solvable."""
_FLAT = 1e-9
"""A driven row that moves less than this per unit of its multiplier cannot be satisfied."""
_NEVER = 1e300
CALLED = {"never_inline": True}
"""Of functions that stay calls in the graphs that use them."""
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
    fresh: bool = False,
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
    fresh : bool
        Whether of those none pushes yet, as without a start.
    """
    none = ca.SX(q.shape[0], 1)
    # Symmetric by half: rounding aside it is, and so it costs half.
    Q = ca.tril2symm(ca.tril(ca.densify(Q)))
    pushing, yielding = (start.pushing, start.yielding) if start else (none, none)
    given = Q, q, cap, tolerance, none if before is None else before, pushing, yielding
    found = _search(q.shape[0], exchanges, fresh or start is None)(*map(ca.densify, given))
    return Pushes(*found)


def hold(Q: Expression, pushing: Expression, margins: Expression) -> Expression:
    """Multipliers of the rows that push which take margins away, a problem a column."""
    regular = Q + REGULAR * ca.SX.eye(Q.shape[0])
    return ca.horzcat(*(_solve_masked(regular, pushing, each) for each in ca.horzsplit(margins)))


@lru_cache(maxsize=64)
def _search(size: int, exchanges: int, fresh: bool) -> ca.Function:
    """All of it: (Q, q, cap, tolerance, before, pushing, yielding) -> parts of :class:`Pushes`.

    What is called, and not written out, may stop where nobody is left to be driven.
    """
    begin, exchange = _parts(size, fresh)
    given = [ca.MX.sym("x", *begin.size_in(k)) for k in range(begin.n_in())]
    problem = given[:5]
    state, wanted = begin(*given)
    if exchanges:
        state, _ = _up_to(exchange, exchanges)(wanted, *problem, state)
    Q, q, _, _, before = problem
    name = f"push_{'fresh' if fresh else 'later'}_{exchanges}"
    return ca.Function(name, given, _finish(size)(Q, q, before, state), CALLED)


def _up_to(exchange: ca.Function, count: int) -> ca.Function:
    """(wanted, problem, state) -> (state, wanted) after so many exchanges, or fewer."""
    given = [ca.MX.sym("x", *exchange.size_in(k)) for k in range(exchange.n_in())]
    found = exchange(*given)
    if count > 1:
        half = count // 2
        state, wanted = _up_to(exchange, half)(1, *given)
        found = _up_to(exchange, count - half)(wanted, *given[:-1], state)
    some = ca.Function("some", given, found)
    none = ca.Function("none", given, [given[-1], 0])
    return ca.Function.if_else("up_to", some, none)


@lru_cache(maxsize=64)
def _parts(size: int, fresh: bool) -> tuple[ca.Function, ca.Function]:
    """Return how the search begins, and one exchange."""
    Q, tolerance = ca.SX.sym("Q", size, size), ca.SX.sym("tolerance")
    q, cap, before, pushing, yielding, multipliers, margins, driven = (
        ca.SX.sym(name, size)
        for name in ("q", "cap", "before", "pushing", "yielding", "l", "w", "driven")
    )
    problem = [Q, q, cap, tolerance, before]
    state = ca.vertcat(pushing, yielding, multipliers, margins, driven)
    regular, kind = Q + REGULAR * ca.SX.eye(size), "fresh" if fresh else "later"

    def left(pushing: Any, yielding: Any, multipliers: Any, margins: Any) -> tuple[Any, Any, Any]:
        """How much each row is violated, and pulls where it may but push; what is left alone."""
        violation = ca.if_else((1 - pushing) * (1 - yielding), -margins, 0)
        inexact = _INEXACT * REGULAR * ca.mmax(ca.fabs(before + multipliers))
        pull = ca.if_else(pushing, -(before + multipliers), 0)
        return violation, pull, ca.fmax(tolerance, inexact)

    def after(*state: Any) -> list[Any]:
        """A state, and whether anyone is still to be driven."""
        *rows, driven = state
        violation, pull, alone = left(*rows)
        wanted = ca.logic_or(ca.sum1(driven) > 0, ca.mmax(ca.fmax(violation, pull)) > alone)
        return [ca.densify(ca.vertcat(*state)), wanted]

    first = ca.SX(size, 1), q
    if not fresh:
        already = -_solve_masked(regular, pushing, q)
        first = already, q + ca.mtimes(Q, already)
    begun = after(pushing, yielding, *first, ca.SX(size, 1))
    begin = ca.Function(f"begin_{kind}", [*problem, pushing, yielding], begun)

    # Drive the most violated row, unless one is on its way already.  Before that, whoever pulls
    # lets go: those that pushed in an earlier pass need not push in this one.
    violation, pull, alone = left(pushing, yielding, multipliers, margins)
    largest, strongest, idle = ca.mmax(violation), ca.mmax(pull), ca.sum1(driven) == 0
    lets_go = _first(pull, strongest) * (strongest > alone) * idle
    is_let_go = ca.sum1(lets_go) > 0
    pushing = pushing - lets_go
    new = _first(violation, largest) * (largest > alone)
    drives = ca.if_else(is_let_go, lets_go, ca.if_else(idle, new, driven))
    is_driven = ca.sum1(drives) > 0
    direction = drives - _solve_masked(regular, pushing, ca.mtimes(Q, drives))
    rates = ca.mtimes(Q, direction)
    rate, margin = ca.dot(drives, rates), ca.dot(drives, margins)
    full = ca.if_else(rate > _FLAT, -margin / rate, _NEVER)
    full = ca.if_else(is_let_go, strongest, full)
    # How far until a multiplier meets zero or its cap.
    total = before + multipliers
    lost = ca.if_else(pushing * (direction < 0), ca.fmax(total, 0) / -direction, _NEVER)
    room = ca.fmax(cap - total, 0)
    spent = ca.if_else((pushing + drives) * (direction > 0), room / direction, _NEVER)
    nearest = ca.if_else(is_let_go, _NEVER, ca.mmin(ca.fmin(lost, spent)))
    arrives = full <= nearest
    # Leaves: another row, or the driven one itself that cannot be satisfied; then none moves.
    leaves = _first(-ca.fmin(lost, spent), -nearest) * (1 - arrives) * is_driven
    hopeless = ca.dot(leaves, drives)
    length = ca.if_else(is_driven * (1 - hopeless), ca.fmin(full, nearest), 0)
    pushes, stands = multipliers + length * direction, margins + length * rates
    gives_way = leaves * (spent <= lost)
    pushes = ca.if_else(leaves * (1 - gives_way), -before, pushes)
    holds = pushing * (1 - leaves) + drives * arrives * (1 - is_let_go)
    if fresh:
        # Once a row has given way, the others stand as if it had never pushed.  (Later there
        # are too few exchanges for that to matter.)
        gave = ca.sum1(gives_way) > 0
        kept = drives * (1 - gives_way) * pushes - (1 - holds - drives) * before
        anew = kept - _solve_masked(regular, holds, q + ca.mtimes(Q, kept))
        pushes = ca.if_else(gave, anew, pushes)
        stands = ca.if_else(gave, q + ca.mtimes(Q, anew), stands)
    drives = drives * (1 - arrives) * (1 - gives_way)
    found = ca.cse(after(holds, yielding + gives_way, pushes, stands, drives))
    exchange = ca.Function(f"exchange_{kind}", [*problem, state], found)

    return begin, exchange


@lru_cache(maxsize=64)
def _finish(size: int) -> ca.Function:
    """(Q, q, before, state) -> parts of :class:`Pushes`."""
    Q, q, before = ca.SX.sym("Q", size, size), ca.SX.sym("q", size), ca.SX.sym("before", size)
    state = ca.SX.sym("state", 5 * size)
    pushing, yielding = state[:size], state[size : 2 * size]
    # From the set alone: what yields pushes with its whole cap against those that hold, which
    # moves nothing and would only eat up precision.
    held = q - ca.mtimes(Q, (1 - pushing) * before)
    regular = Q + REGULAR * ca.SX.eye(size)
    multipliers = -_solve_masked(regular, pushing, held) - (1 - pushing) * before
    return ca.Function("finish", [Q, q, before, state], [multipliers, pushing, yielding])


def _solve_masked(matrix: Expression, mask: Expression, right: Expression) -> Expression:
    """Solve the rows and columns that the mask selects; zero elsewhere."""
    return _solver(mask.shape[0])(matrix, ca.densify(mask), ca.densify(right))


@lru_cache(maxsize=64)
def _solver(size: int) -> ca.Function:
    """(matrix, mask, right) -> solution; called, because it is long and asked for everywhere."""
    matrix, mask, right = ca.SX.sym("Q", size, size), ca.SX.sym("mask", size), ca.SX.sym("b", size)
    chosen = ca.mtimes(mask, mask.T) * matrix + ca.diag(1 - mask)
    if size == 1:
        found = mask * right / chosen
    else:
        found = ca.ldl_solve(mask * right, *ca.ldl(ca.densify(chosen)))
    return ca.Function("solve", [matrix, mask, right], [found], CALLED)


def _first(values: Expression, wanted: Expression) -> Expression:
    """Mask of the first entry that equals a value."""
    found, mask = ca.SX(0), []
    for i in range(values.shape[0]):
        hit = (values[i] == wanted) * (1 - found)
        mask.append(hit)
        found = found + hit
    return ca.vertcat(*mask)
