"""Limits on lengths in the pointwise projection: ``r - |x| >= 0``, x affine in the velocities.

Linearized, a ball is a half-space.  Beside another limit that all but always leaves something,
however far to the side, even where the ball leaves nothing.  So while the nearest velocities are
sought a ball is no row but a spring of stiffness k, which pulls by ``k |x|``.  With ``x = C nu +
c`` the least change against springs is a quadratic program in the metric ``M + k C^T C``; ``|x|``
falls as k rises, and ``1 / |x|`` is all but linear in k, so that Newton's method on it finds where
``|x| = r`` (Hebden 1973; More and Sorensen, Computing a trust region step, 1983).  A ball that the
stiffest spring cannot hold gives way, by little more than the other rows ask for.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca

from noslip._typing import Expression
from noslip.constraints.system import ConstraintSystem
from noslip.projection.quadratic import CALLED

_STIFFEST = 1e6
"""Over the metric: stiffer, and hard limits at a narrow angle, which push several times as hard,
would give way before it; and too few digits are left of what the spring does not hold."""
_FLATTEST = 1e-5
"""Share of a ball's compliance that other rows leave it at least: bounds a step of Newton's."""


class Balls:
    """The springs of a step.

    Parameters
    ----------
    limits : ConstraintSystem
    margins : expression, shape (k,)
        Of the limits, at a pose that does not depend on the velocities.
    unknown, at : expression, shape (n + 3 b,)
        Velocities that the margins are expressions of; some that they may have.

    Attributes
    ----------
    rows : list of int
        Which limits are balls.
    stiffness, yielding : expression, shape (b,)
        Of each ball's spring, over the velocity; 1 for those that gave way, else 0.
    """

    def __init__(
        self, limits: ConstraintSystem, margins: Expression, unknown: Expression, at: Expression
    ) -> None:
        self.rows = [i for i, radius in enumerate(limits.row_radii) if radius]
        self.radii = ca.DM([limits.row_radii[i] for i in self.rows])
        self.squares = []
        for i in self.rows:
            slope = ca.jacobian(margins[i], unknown)
            # C^T C, of |x| = r - h and its derivatives.
            bend = (limits.row_radii[i] - margins[i]) * ca.jacobian(slope, unknown)
            self.squares.append(ca.substitute(slope.T @ slope - bend, unknown, at))
        none = ca.SX.zeros(len(self.rows))
        self.stiffness = self.softest = self.stiffest = self.yielding = none

    def inverse(self, weights: Expression) -> Expression:
        """Inverse of the metric with the springs, of that without them, shape (6, 6)."""
        if not self.rows:
            return ca.diag(weights)
        stiff = sum(self.stiffness[b] * square for b, square in enumerate(self.squares))
        return _inverse(weights.numel())(ca.densify(weights), ca.densify(stiff))

    def forces(self, lengths: Expression, slopes: Expression, change: Expression) -> Expression:
        """What each spring pulls with after a change of velocities, shape (6, b).

        Parameters
        ----------
        lengths, slopes : expression, shape (b,), (b, 6)
            ``|x|`` before, and the derivatives of ``-|x|``.
        """
        pulls = [
            self.stiffness[b] * (lengths[b] * slopes[b, :].T - square @ change)
            for b, square in enumerate(self.squares)
        ]
        return ca.horzcat(ca.SX(change.shape[0], 0), *pulls)

    def stretch(
        self,
        lengths: Expression,
        radii: Expression,
        slopes: Expression,
        compliance: Expression,
        weights: Expression,
        strongest: Expression,
    ) -> None:
        """Newton's step of each stiffness, after velocities were found under those before.

        Parameters
        ----------
        lengths, radii : expression, shape (b,)
            ``|x|``, and what it may be.
        slopes : expression, shape (b, 6)
        compliance : expression, shape (b, b)
            How much each ``|x|`` falls by a unit pull of each spring, all that push heeded.
        weights : expression, shape (6,)
            Inverse metric without springs.
        strongest : expression, shape (b,)
            Pull beyond which a ball gives way, over that of a row of unit norm.
        """
        k, over = self.stiffness, lengths > radii
        self.yielding = over * (k >= self.stiffest) * (k > 0)
        norms = ca.sum2(slopes * (slopes @ ca.diag(weights)))
        own = ca.sum2(slopes * (slopes @ self.inverse(weights)))
        # As if all that pull were stretched alike: of equal balls each takes its share.
        pulls = lengths * ca.logic_or(over, k > 0)
        slope = ca.mtimes(ca.fabs(compliance), pulls) / lengths
        newton = k + (lengths / radii - 1) / ca.fmax(slope, _FLATTEST * own)
        # Never back to where the ball did not hold.
        self.softest = ca.if_else(over, ca.fmax(self.softest, k), self.softest)
        between = ca.sqrt((self.softest + 1 / norms) * (k + 1 / norms)) - 1 / norms
        self.stiffest = ca.fmin(strongest / radii / ca.sqrt(norms), _STIFFEST / norms)
        back = ca.if_else(newton > self.softest, newton, between)
        self.stiffness = ca.fmin(ca.fmax(ca.if_else(k > 0, back, newton), 0), self.stiffest)


@lru_cache(maxsize=16)
def _inverse(size: int) -> ca.Function:
    """(inverse weights, stiffness) -> inverse metric; weights may be 0."""
    weights, stiff = ca.SX.sym("weights", size), ca.SX.sym("stiff", size, size)
    root = ca.diag(ca.sqrt(weights))
    matrix = ca.densify(root @ stiff @ root + ca.SX.eye(size))
    found = root @ ca.ldl_solve(ca.densify(root), *ca.ldl(matrix))
    return ca.Function("inverse", [weights, stiff], [found], CALLED)
