"""How a new start and goal take the place of the learned ones.

The paper's form draws to the new goal g' from the start on: a spring stretched by ``g' - g`` while
the learned motion is still at rest, which may pull the tool backwards first.  By default the goal
moves instead, from where the learned way leads from the start, ``g_0 = g + x_0' - x_0``, along the
minimum-jerk blend (Flash and Hogan 1985)

    ``m(t) = 10 t^3 - 15 t^4 + 6 t^5``

of the fraction t of the duration, ahead by what the attractor lags behind,

    ``g(t) = g_0 + (g' - g_0) (m + m' / beta + m'' / (alpha beta))``

so that the motion is ``x(t) + (1 - m) (x_0' - x_0) + m (g' - g)``, x the learned one: a motion from
rest to rest stays one, and makes no detour.  Rotations likewise: the learned ones, from the start
on turned in the tool's frame as that is, and then in the world's by ``Exp(m Log(R' R_0^T))``, the
learned torque with them; what this leaves out is the product of both angular velocities.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Literal

import numpy as np

from noslip._typing import Floats
from noslip.law.attractor import Attractor

GoalForm = Literal["minimum-jerk", "paper"]


@lru_cache(maxsize=4)
def goal_entry(
    attractor: Attractor, begin: float, steps: int, step_fraction: float, earlier: float
) -> tuple[Floats, Floats]:
    """Return how far a goal has entered where each of the coming steps begins, and how it draws.

    Parameters
    ----------
    attractor : Attractor
    begin : float
        Fraction of the duration at which the first step begins.
    steps : int
    step_fraction : float
        ``dt / tau``.
    earlier : float
        The step before the first one; 0 at the start of the motion.

    Returns
    -------
    entered : array, shape (steps,)
        m.
    drawn : array, shape (steps,)
        What stands beside ``g' - g_0``, and what a target that stands still for a step leaves out,
        as in :meth:`noslip.law.basis.Basis.stepping_activations`.
    """
    h = step_fraction
    t = np.clip(begin + np.arange(-1, steps + 1) * h, 0.0, 1.0)
    entered = t * t * t * (10 - t * (15 - 6 * t))
    slope, curve = 30 * t * t * (1 - t) * (1 - t), 60 * t * (1 - t) * (1 - 2 * t)
    target = entered + slope / attractor.beta + curve / attractor.stiffness
    changed, bent = (target[2:] - target[:-2]) / 2, np.diff(target, 2)
    change, bend = attractor.led_by(h, h)
    drawn = target[1:-1] + change * changed + bend * bent
    if earlier != h:
        change, bend = attractor.led_by(earlier, h)
        drawn[0] = target[1] + change * changed[0] + bend * bent[0]
    found = entered[1:-1], drawn
    for part in found:
        part.flags.writeable = False
    return found
