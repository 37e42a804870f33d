"""Trial and error under constraints: a primitive whose motion costs less.

What is searched is a smooth displacement of the path, and a smooth turn of the tool, by CMA-ES
(Hansen 2016, "The CMA Evolution Strategy: A Tutorial").  Each candidate is projected onto the
constraints and fitted by a law as an adaptation is, so that every trial keeps the constraints,
starts and ends as the given motion does and takes its time: a robot may carry it out.

A displacement has a few cubic B-splines a coordinate, evenly spaced and each all within the motion.
They are what the law's weights can do and little else: a weight alone moves the path from its time
on, and the goal's attractor back again, by an amount that differs a hundredfold along the motion;
hundreds of them would take ten thousands of trials.  A spline's value is the path's way (m) or turn
(rad), and it leaves pose, velocity and acceleration at both ends as they are.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np
import scipy

from noslip import _arguments
from noslip._extras import need
from noslip._typing import Floats
from noslip.adapting.around import samples_of
from noslip.adapting.ends import moving, placed
from noslip.adapting.plan import Adapted, carried_out
from noslip.boundary import Boundary
from noslip.errors import (
    CompromiseWarning,
    ConstraintError,
    ConvergenceError,
    InputError,
    MissedError,
    muted,
    warn,
)
from noslip.law.channels import Channels
from noslip.law.law import Law
from noslip.primitive import ConstrainedDMP
from noslip.projection.request import LEARNING, Request
from noslip.provenance import LearningRecord, Origin
from noslip.rule import Rule, no_rule
from noslip.runtime.motion import Motion
from noslip.runtime.rollout import initial_state, motion_from
from noslip.verification import Deviation

Vary = Literal["position", "rotation", "pose"]
"""What of a motion a search may change."""

SHAPES = 4
"""Splines a coordinate: with three coordinates 12 numbers, that some 200 trials tell apart."""
_MOST_SHAPES = 50
"""Beyond, a search takes longer than anybody waits."""
_SHARE, _TURN = 0.01, np.radians(3.0)
"""First spread of a trial's splines, by default: of the path's length, and turn (rad)."""
_FINEST = 1e-3
"""Spread over the first one at which a search ends: what is left to find is not seen."""


def improve(
    dmp: ConstrainedDMP,
    cost: Callable[[Motion], float],
    *,
    evaluations: int = 200,
    vary: Vary = "position",
    shapes: int = SHAPES,
    sigma: float | None = None,
    turn_sigma: float = _TURN,
    seed: int = 0,
    executor: Executor | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> ConstrainedDMP:
    """Search for a motion near a primitive's own that costs less, by trials that keep the rule.

    Parameters
    ----------
    dmp : ConstrainedDMP
    cost : callable
        From a rollout to what it costs, any number; infinite for a motion that must not be.  It is
        called once a trial, in the order of the search.
    evaluations : int
        Calls of the cost at most; the first is for the given primitive.
    vary : "position", "rotation" or "pose"
        What each trial displaces: the path, the tool's rotation, or both.  What the constraints ask
        for follows: a blade turns into its path.
    shapes : int
        Splines a coordinate: more bend the path oftener, and take more trials.
    sigma : float, optional
        First spread of the path's displacement (m, or the coordinates' own unit); a hundredth of
        its length by default.
    turn_sigma : float
        The same of the tool's turn (rad).
    seed : int
        Of the search: with the same one, the same trials, to the bit.
    executor : concurrent.futures.Executor, optional
        That evaluates the trials of a generation side by side.
    progress : callable, optional
        Called with (evaluations done, all) after each generation.

    Returns
    -------
    ConstrainedDMP
        Of the trial that cost least, or the given law if none cost less.  The last entry of its
        ``history`` tells in ``outcome`` what it cost before and after, how many trials there were
        and were refused, and the least cost after each generation.

    Raises
    ------
    InputError
        If an argument is not what it must be; if the cost raises or is no number.
    ConvergenceError
        If no trial kept its constraints and came to its goal.
    MissingDependencyError
        Without the package cma (extra ``improve``).
    """
    search = _Search.of(dmp, cost, vary, shapes, sigma, turn_sigma)
    most = _arguments.count("evaluations", evaluations)
    if not isinstance(seed, (int, np.integer)) or isinstance(seed, bool) or seed < 0:
        raise InputError(f"seed must be a whole number, 0 or more, got {_arguments.short(seed)}")
    cma = need("improve", "cma", "improve")
    random = np.random.default_rng(seed)
    strategy = cma.CMAEvolutionStrategy(
        np.zeros(search.size),
        1.0,
        {
            # Of its own: the search neither reads nor moves NumPy's global one.
            "randn": lambda *size: random.standard_normal(size),
            "seed": np.nan,
            "verbose": -9,
            "verb_log": 0,
            "tolx": _FINEST,
            # What a difference of costs means is not known.
            "tolfun": 0.0,
            "tolfunhist": 0.0,
        },
    )
    if most <= strategy.popsize:
        raise InputError(
            f"evaluations must be {strategy.popsize + 1} or more for {search.size} numbers to "
            f"search, got {most}"
        )
    before = _paid(cost, dmp.rollout(), 1)
    if not np.isfinite(before):
        raise InputError(
            "the given primitive's motion has an infinite cost; begin with one that may be"
        )
    least, best = before, np.zeros(0)
    done, refused, reason, curve = 1, 0, "", [before]
    while done + strategy.popsize <= most and not strategy.stop():
        tried = strategy.ask()
        numbered = [(x, done + k + 1) for k, x in enumerate(tried)]
        evaluated = map if executor is None else executor.map
        found = list(evaluated(search.cost_of, *zip(*numbered, strict=True)))
        done += len(found)
        costs = np.array([np.inf if isinstance(f, str) else f for f in found])
        refused += int(np.sum(~np.isfinite(costs)))
        reason = next((f for f in found if isinstance(f, str)), reason)
        strategy.tell(tried, _ordered(costs, tried))
        if costs.min() < least:
            least, best = float(costs.min()), tried[int(costs.argmin())]
        curve.append(least)
        if progress is not None:
            progress(done, most)
    if refused == done - 1:
        raise ConvergenceError(
            f"none of {refused} trials kept its constraints and came to its goal, and the cost "
            f"refused none else{f': {reason}' if reason else ''}; give a smaller sigma"
        )
    origin = Origin.of(
        "improve",
        improve,
        dmp,
        cost,
        evaluations=evaluations,
        vary=vary,
        shapes=shapes,
        sigma=sigma,
        turn_sigma=turn_sigma,
        seed=seed,
    )
    outcome = {
        "before": before,
        "after": least,
        "evaluations": done,
        "refused": refused,
        "least": curve,
    }
    history = (*dmp.history, replace(origin, outcome=outcome))
    if not len(best):
        warn(
            f"none of {done - 1} trials cost less than the given motion ({before:.4g}); give more "
            "evaluations or another sigma",
            CompromiseWarning,
        )
        return replace(dmp, history=history)
    planned = search.planned(best).told()
    made_of = LearningRecord.of(
        planned.request.reference,
        planned.projected,
        Deviation.between(planned.motion, planned.projected.trajectory),
    )
    # Of other motions than its own, the demonstrations' spread says nothing.
    return replace(dmp, law=planned.law, record=(made_of,), spread=None, history=history)


@dataclass(frozen=True, eq=False)
class _Search:
    """What is searched: displacements of a law's own motion, and what each costs.

    Attributes
    ----------
    law, rule
    own : Motion
        Of the law alone.
    ends : (Boundary, Boundary)
        Start and goal, which stay.
    cost : callable
    splines : array, shape (N, k)
        At the samples of its own motion.
    scales : array, shape (n + 3 b,)
        What a number of 1 displaces; 0 for what does not vary.
    channels : Channels or None
        What goes with each motion.
    """

    law: Law
    rule: Rule
    own: Motion
    ends: tuple[Boundary, Boundary]
    cost: Callable[[Motion], float]
    splines: Floats
    scales: Floats
    channels: Channels | None

    @classmethod
    def of(
        cls,
        dmp: ConstrainedDMP,
        cost: Callable[[Motion], float],
        vary: Vary,
        shapes: int,
        sigma: float | None,
        turn_sigma: float,
    ) -> _Search:
        """Return the search near a primitive's own motion."""
        if not callable(cost):
            raise InputError(f"cost must be a function of a motion, got {_arguments.short(cost)}")
        if vary not in get_args(Vary):
            raise InputError(
                f"vary must be position, rotation or pose, got {_arguments.short(vary)}"
            )
        law, rule, space = dmp.law, dmp.rule, dmp.law.space
        if law.clock.returns:
            raise InputError("improve takes a primitive that ends, not a rhythmic one")
        if vary == "rotation" and not space.rotations:
            raise InputError("vary='rotation' of what has no rotations; vary its position")
        shapes = _arguments.count("shapes", shapes, _MOST_SHAPES)
        count = samples_of(law.basis.count, law.steps, None)
        begun = initial_state(law, rule)
        own = motion_from(law, no_rule(space), begun, law.duration / (count - 1))
        if sigma is None:
            sigma = _SHARE * own.path_length
        far = _arguments.positive("sigma", sigma, "meters")
        turn = _arguments.positive("turn_sigma", turn_sigma, "radians")
        scales = np.repeat(
            [far * (vary != "rotation"), turn * (vary != "position")],
            [space.linear, space.angular],
        )
        poses = (law.start_position, law.start_rotation), (law.goal_position, law.goal_rotation)
        first, last = (
            moving(
                placed(Boundary(at), pose, rule.system, rule.inverse_metric, time), own, rule, time,
                "pose",
            )
            for at, pose in zip((0.0, 1.0), poses, strict=True)
            for time in [law.begin + at * law.duration]
        )  # fmt: skip
        fractions = np.linspace(0.0, 1.0, count)
        return cls(
            law, rule, own, (first, last), cost, splines(fractions, shapes), scales, dmp.channels
        )

    @property
    def size(self) -> int:
        """How many numbers it searches."""
        return int(self.splines.shape[1] * np.count_nonzero(self.scales))

    def planned(self, numbers: Floats) -> Adapted:
        """Return the law displaced by some numbers, and what became of that.

        Raises
        ------
        ConvergenceError, ConstraintError, MissedError
            If there is no such motion that keeps the constraints and comes to the goal.
        """
        varied = self.scales > 0
        changes = np.zeros((len(self.own), len(self.scales)))
        amounts = numbers.reshape(self.splines.shape[1], -1) * self.scales[varied]
        changes[:, varied] = self.splines @ amounts
        reference = self.own.with_points(self.law.space.moved(self.own.points, changes))
        request = Request(reference, self.rule.system, self.ends, LEARNING, begin=self.law.begin)
        plan = carried_out(
            self.law,
            self.rule,
            request,
            self.law.steps,
            self.law.duration,
            exact_start=not self.ends[0].moves,
        )
        return plan.verified(self.law, self.rule)

    def cost_of(self, numbers: Floats, number: int) -> float | str:
        """Return what a trial costs; why it is refused, if there is no such motion."""
        try:
            # A search is full of compromises; those of what it finds are told.
            with muted():
                found = self.planned(numbers)
        except (ConvergenceError, ConstraintError, MissedError) as error:
            return str(error)
        if not found.is_exact:
            return "; ".join(found.notes)
        motion = found.motion
        if self.channels is not None:
            motion = motion.accompanied(self.channels)
        return _paid(self.cost, motion, number)


def splines(fractions: Floats, count: int) -> Floats:
    """Cubic B-splines, evenly spaced and each within 0 to 1, at fractions; shape (N, count).

    Each is 1 at its peak; value, slope and curvature vanish at 0 and 1.
    """
    knots = np.linspace(0.0, 1.0, count + 4)
    found = [
        scipy.interpolate.BSpline.basis_element(knots[k : k + 5], extrapolate=False)(fractions)
        for k in range(count)
    ]
    # Of uniform cubic B-splines the peak is 2 / 3.
    return np.asarray(np.nan_to_num(np.array(found).T) * 1.5)


def _paid(cost: Callable[[Motion], float], motion: Motion, number: int) -> float:
    """Return what a motion costs, checked."""
    try:
        paid: Any = cost(motion)
    except Exception as error:
        raise InputError(
            f"the cost raised {type(error).__name__} at evaluation {number}: {error}; return "
            "infinity for a motion that must not be"
        ) from error
    found = _arguments.number(paid)
    if np.isnan(found) or found == -np.inf:
        raise InputError(
            f"the cost returned {_arguments.short(paid)} at evaluation {number}; it must be a "
            "number, infinity for a motion that must not be"
        )
    return found


def _ordered(costs: Floats, tried: list[Floats]) -> Floats:
    """Return costs in which what is refused comes last, what is nearer to the given motion first.

    The strategy looks at the order alone.
    """
    may = np.isfinite(costs)
    top = costs[may].max(initial=-np.inf)
    top = top if np.isfinite(top) else 0.0
    far = np.array([np.linalg.norm(x) for x in tried])
    # Far beside any cost, so that rounding leaves the order.
    return np.where(may, costs, top + max(1.0, abs(top)) * (1.0 + far / max(far.max(), 1e-300)))
