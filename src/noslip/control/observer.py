"""What a robot makes of a command: lag, bias and noise told apart from a real displacement.

    measured = lag_tau(command) + bias + noise + what is left

for the position and, as turns against the command, for the orientation.  A Kalman filter finds the
lag tau (first order) and the bias; row i of a measurement tells ``e_i = -rate_i dtau + dbias_i``
(Jazwinski, *Stochastic Processes and Filtering Theory*, 1970, chapter 8: unknown parameters as
states).  The scale of the noise is that of second differences, since what a robot does is smooth.
What is left, low-passed, is a displacement if it is beyond a *band* that all of these make up.

All of it is one expression graph of one row of numbers (:data:`SEEN`), so that it runs the same in
CasADi's virtual machine, and as C.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import lru_cache
from math import sqrt
from typing import Any

import casadi as ca
import numpy as np

from noslip._typing import Expression, Floats
from noslip.codegen import c99
from noslip.codegen.library import Native, built, function
from noslip.law.layout import STATE, Layout
from noslip.rotations import quaternion_conjugate, quaternion_log, quaternion_product

LAG_STD, KNOWN_LAG_STD = 0.05, 0.005
"""s: how far a lag that nobody told may be expected, and one that was told may be off."""
LONGEST_LAG = 0.2
"""s: a longer lag looks like a stall; it must be told."""
NOISE_SAMPLES, WINSORIZED = 40, 9.0
"""Samples over which the noise is averaged, and how many times as large a squared difference counts
at most: one outlier must not open the band."""
SMOOTH = 0.04
"""s, of the low-pass of what is left: shorter than a push, longer than sensors' periods."""
BACK = 0.01
"""s, the same while a tool that was off comes back: that is no outlier."""
RATE_SMOOTH = 0.03
"""s, of the acceleration that is expected."""
STAYS = 0.1
"""s: what the model leaves out, such as another order of the lag, is no white noise but stays for
so long; a filter that does not know becomes sure of what is wrong."""
SIGMAS = 4.5
"""Of the noise, that what is left may be off by: passed once in 150 000 samples by chance."""
_TINY = 1e-18

_ONE = Layout(
    lag=1,
    bias=3,
    covariance=10,
    behind=3,
    rate=3,
    change=3,
    left=3,
    variance=1,
    noise=1,
    last=3,
    before_last=3,
    samples=1,
    band=1,
    far=1,
)
"""Of one channel: lag (s), bias, their covariance (upper triangle, row by row), where the tool is
expected against the command, how fast that moves and how that changes, what is left, the variance
of it, the squared noise, two offsets for differences, how many samples; band; size of ``left``."""
_CONSTANTS = ("lag_drift", "bias_drift", "longest_lag", "floor", "tolerance")
CHANNELS = ("place", "turn")
SEEN = Layout(
    **{f"{channel}_{name}": _ONE.width(name) for channel in CHANNELS for name in _ONE},
    **{f"{channel}_{name}": 1 for channel in CHANNELS for name in _CONSTANTS},
    age=1,
    gap=1,
    pace=1,
)
"""The row of numbers: both channels, their constants, the time since the last measurement, the mean
time between two (s), and how fast the clock may run: 1 while what is left is within its band, 0
from three bands on."""
_FIRST, _UPPER = 2, [(i, j) for i in range(4) for j in range(i, 4)]
_MOVE, _MEASURE = (
    Layout(before=7, after=7, passed=1),
    Layout(command=7, measured=7, learns=1),
)


class Observer:
    """Keeps :data:`SEEN` up to date.

    Parameters
    ----------
    tolerances : (float, float)
        Within which what is left is nobody's concern (m, rad).
    biases : (float, float)
        Standard deviations of the bias that may be expected (m, rad).
    lag : float or None
        Seconds, if known.
    time_step : float
        Of the loop (s).

    Attributes
    ----------
    seen : array
        Columns as :data:`SEEN` says.
    """

    def __init__(
        self,
        tolerances: tuple[float, float],
        biases: tuple[float, float],
        lag: float | None,
        time_step: float,
    ) -> None:
        self.seen = np.zeros(SEEN.size)
        std = LAG_STD if lag is None else KNOWN_LAG_STD
        most = LONGEST_LAG if lag is None else lag + 4 * KNOWN_LAG_STD
        for channel, tolerance, bias in zip(CHANNELS, tolerances, biases, strict=True):
            variances = np.diag([std**2, *[bias**2] * 3])
            # At first it is taken for noise of a fifth of what is tolerated.
            noise = (tolerance / 5) ** 2
            given: dict[str, float | list[float]] = {
                "lag": lag or 0.0,
                "covariance": [variances[i, j] for i, j in _UPPER],
                "variance": noise,
                "noise": noise,
                "band": tolerance,
                # Within a second both drift by a small part of what they may be.
                "lag_drift": (0.15 * std) ** 2,
                "bias_drift": (0.1 * bias) ** 2,
                "longest_lag": most,
                "floor": tolerance / 3,
                "tolerance": tolerance,
            }
            for name, value in given.items():
                self.seen[SEEN[f"{channel}_{name}"]] = value
        self.seen[SEEN["gap"]], self.seen[SEEN["pace"]] = time_step, 1.0

    def bind(self, command: Floats, before: Floats, pose: Floats) -> None:
        """Say where poses stand, shape (7,) each, in memory that stays in place.

        That commanded now, that commanded before, and that measured.
        """
        poses = self.seen, command, before, pose
        library = _native().library
        self._observe = library or _virtual(self.seen)
        # Of machine code, addresses: the arrays are kept by those who have them.
        self._places: tuple[Any, ...] = poses
        if library is not None:
            self._places = tuple(array.ctypes.data for array in poses)

    def __getstate__(self) -> Floats:
        return self.seen

    def __setstate__(self, seen: Floats) -> None:
        self.seen = np.array(seen)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Observer) and np.array_equal(self.seen, other.seen)

    __hash__ = None  # type: ignore[assignment]

    def moved(self, passed: float) -> None:
        """The command moved from the pose before to that now, within some seconds."""
        seen, command, before, _ = self._places
        self._observe(seen, before, command, passed, True)

    def measured(self, learns: bool) -> None:
        """A pose was measured while that of now was commanded.

        ``learns`` tells whether lag and bias may be learned from it.
        """
        seen, command, _, pose = self._places
        self._observe(seen, command, pose, float(learns), False)

    def shifted(self, place: Floats, turn: Floats) -> None:
        """The command was moved to where the tool is, which thus is no longer off by so much."""
        for channel, by in zip(CHANNELS, (place, turn), strict=True):
            self.seen[SEEN[f"{channel}_left"]] -= by
            # Where it is expected moves along.
            self.seen[SEEN[f"{channel}_behind"]] += by

    def accept(self) -> None:
        """Take what is left for a bias."""
        for channel in CHANNELS:
            left = SEEN[f"{channel}_left"]
            self.seen[SEEN[f"{channel}_bias"]] += self.seen[left]
            self.seen[left] = 0.0
            self.seen[SEEN[f"{channel}_far"]] = 0.0
        self.seen[SEEN["pace"]] = 1.0

    def size(self, channel: str, *names: str) -> float:
        """Length of the sum of parts of a channel."""
        total = sum(self.seen[SEEN[f"{channel}_{name}"]] for name in names)
        x, y, z = total.tolist()  # type: ignore[union-attr]
        return sqrt(x * x + y * y + z * z)


def _virtual(seen: Floats) -> Callable[..., None]:
    """Observe in CasADi's virtual machine, from and into a row of numbers."""
    given, found = np.empty(_MOVE.size), np.empty(SEEN.size)
    buffers = [graph.buffer() for graph in functions()]
    for buffer, _ in buffers:
        buffer.set_arg(0, seen.data)
        buffer.set_arg(1, given.data)
        buffer.set_res(0, found.data)

    def observe(_: Floats, one: Floats, other: Floats, number: float, has_moved: bool) -> None:
        given[:7], given[7:14], given[14] = one, other, number
        # The buffer lives as long as this does.
        buffers[not has_moved][1]()
        seen[:] = found

    return observe


@lru_cache(maxsize=1)
def _native() -> Native[Callable[..., None]]:
    """Observe by machine code, in a hundredth of the time."""

    def load() -> Callable[..., None]:
        code = [
            '#include "inside.h"',
            f"#define SIZE {SEEN.size}",
            c99.plain(plain()),
            c99.template("observed.c"),
        ]
        texts = {
            "noslip.h": c99.header(1, 0),
            "inside.h": c99.template("inside.h"),
            "observed.c": "\n".join(code),
        }
        # It is over before another thread could have taken its turn.
        library = ctypes.PyDLL(str(built("observer", texts)))
        pointer = ctypes.c_void_p
        return function(library, "noslip_observe", *[pointer] * 3, ctypes.c_double, ctypes.c_int)

    return Native(load)


def compile_now() -> None:
    """Have the observer compiled, if that may be, so that none waits for it."""
    _native().wait()


def plain() -> c99.Plain:
    """Return both graphs for C: ``noslip_moved`` and ``noslip_measured``."""
    graphs = dict(zip(("moved", "measured"), functions(), strict=True))
    return c99.Plain(graphs, ("seen", "given"), ("found",))


@lru_cache(maxsize=1)
def functions() -> tuple[ca.Function, ca.Function]:
    """Return (seen, what happened) -> seen: the command moved; a pose was measured."""
    seen, moved, measured = (
        ca.SX.sym(name, layout.size)
        for name, layout in (("seen", SEEN), ("moved", _MOVE), ("measured", _MEASURE))
    )
    before, after, passed = (moved[_MOVE[name]] for name in _MOVE)
    command, pose, learns = (measured[_MEASURE[name]] for name in _MEASURE)
    age, gap = seen[SEEN["age"]], seen[SEEN["gap"]]
    steps, offsets = _difference(before, after), _difference(command, pose)
    found: list[list[Expression]] = [[], []]
    paces: list[list[Expression]] = [[], []]
    for channel, step, offset in zip(CHANNELS, steps, offsets, strict=True):
        x = {name: seen[SEEN[f"{channel}_{name}"]] for name in (*_ONE, *_CONSTANTS)}
        for k, after_it in enumerate(
            (_moved(x, step, passed), _measured(x, offset, learns, age, gap))
        ):
            found[k] += [after_it[name] for name in _ONE]
            beyond = after_it["far"] - after_it["band"]
            paces[k].append(1 - beyond / (2 * after_it["band"]))
    constants = seen[SEEN.span("place_lag_drift", "turn_tolerance")]
    pace = [ca.fmin(ca.fmax(ca.fmin(*both), 0.0), 1.0) for both in paces]
    aged = ca.vertcat(age + passed, gap, pace[0])
    told = ca.vertcat(0, gap + 0.1 * (ca.fmin(age, 0.2) - gap), pace[1])
    functions = [
        ca.Function(
            name,
            [seen, given],
            [ca.cse(ca.densify(ca.vertcat(*parts, constants, times)))],
        )
        for name, given, parts, times in (
            ("moved", moved, found[0], aged),
            ("measured", measured, found[1], told),
        )
    ]
    return functions[0], functions[1]


def _difference(one: Expression, other: Expression) -> tuple[Expression, Expression]:
    """Way and turn from one pose to another; the second's quaternion may be of any length."""
    position, quaternion = STATE["position"], STATE["quaternion"]
    unit = other[quaternion] / ca.norm_2(other[quaternion])
    turn = quaternion_log(quaternion_product(unit, quaternion_conjugate(one[quaternion])))
    return other[position] - one[position], turn


def _moved(x: dict[str, Expression], step: Expression, h: Expression) -> dict[str, Expression]:
    behind, lag = x["behind"] - step, x["lag"]
    done = ca.if_else(lag < 1e-6, 1.0, 1 - ca.exp(-h / ca.fmax(lag, 1e-6)))
    rate = -done * behind / h
    change = x["change"] + (1 - ca.exp(-h / RATE_SMOOTH)) * ((rate - x["rate"]) / h - x["change"])
    return _banded(x | {"behind": behind - done * behind, "rate": rate, "change": change})


def _measured(
    x: dict[str, Expression],
    offset: Expression,
    learns: Expression,
    age: Expression,
    gap: Expression,
) -> dict[str, Expression]:
    h, samples, lag = age, x["samples"], x["lag"]
    # The noise, from a second difference: 6 times its variance a component, 3 components.
    difference = x["before_last"] - 2 * x["last"] + offset
    seen = ca.sumsqr(difference) / 18
    known = ca.fmin(samples - 1, NOISE_SAMPLES)
    seen = ca.if_else(known > 8, ca.fmin(seen, WINSORIZED * x["noise"] + _TINY), seen)
    noise = ca.if_else(
        samples >= _FIRST, x["noise"] + (seen - x["noise"]) / (known + 1), x["noise"]
    )
    # What is new.  One outlier says little: it counts as far as it may mean something.
    off = offset - x["behind"] - x["bias"]
    jump, most = ca.norm_2(off - x["left"]), 4 * x["band"]
    out = ca.logic_and(samples > 3, jump > most)
    off = ca.if_else(out, x["left"] + most / ca.fmax(jump, most) * (off - x["left"]), off)
    learning = ca.if_else(out, 0.0, learns)
    # The Kalman filter.
    P = ca.SX(4, 4)
    for (i, j), value in zip(_UPPER, ca.vertsplit(x["covariance"]), strict=True):
        P[i, j] = P[j, i] = value
    drift = ca.vertcat(x["lag_drift"], *[x["bias_drift"]] * 3)
    P = P + learning * h * ca.diag(drift)
    H = ca.horzcat(-x["rate"], ca.SX.eye(3))
    model = 0.5 * lag**2 * x["change"]
    stays = x["floor"] ** 2 * ca.fmax(1.0, STAYS / ca.fmax(h, 1e-6))
    S = H @ P @ H.T + (noise + stays) * ca.SX.eye(3) + model @ model.T
    gains = learning * P @ H.T @ _inverse(S)
    correction = gains @ off
    P = P - gains @ H @ P
    new = ca.fmin(ca.fmax(lag + correction[0], 0.0), x["longest_lag"])
    # Where the lag may not go on, the bias is what it is given that lag.
    correction += (new - lag - correction[0]) / P[0, 0] * P[:, 0]
    # What is left, low-passed.
    comes_back = ca.logic_and(x["far"] > x["band"], ca.norm_2(off) < x["far"])
    share = 1 - ca.exp(-h / ca.if_else(comes_back, BACK, SMOOTH))
    share = ca.if_else(samples > 0, share, 1.0)
    left = x["left"] + share * (off - x["left"])
    return _banded(
        x
        | {
            "lag": new,
            "bias": x["bias"] + correction[1:],
            "covariance": ca.vertcat(*(P[i, j] for i, j in _UPPER)),
            "behind": x["behind"] - (new - lag) * x["rate"],
            "left": left,
            "variance": (1 - share) ** 2 * x["variance"] + share**2 * noise,
            "noise": noise,
            "last": offset,
            "before_last": x["last"],
            "samples": samples + 1,
        }
    )


def _banded(x: dict[str, Expression]) -> dict[str, Expression]:
    """The same with its band: tolerance, noise, what is not sure, and what the model leaves out."""
    first, bias = x["covariance"][0], x["covariance"][4]
    unsure = 3 * ca.sqrt(first) * ca.norm_2(x["rate"]) + 3 * ca.sqrt(bias)
    model = 0.75 * x["lag"] ** 2 * ca.norm_2(x["change"])
    band = x["tolerance"] + SIGMAS * ca.sqrt(x["variance"]) + unsure + model
    return x | {"band": band, "far": ca.norm_2(x["left"])}


def _inverse(S: Expression) -> Expression:
    """Of a symmetric 3 x 3 matrix, by its adjugate."""
    a, b, c, d, e, f = S[0, 0], S[0, 1], S[0, 2], S[1, 1], S[1, 2], S[2, 2]
    A, B, C = d * f - e * e, c * e - b * f, b * e - c * d
    rows = [[A, B, C], [B, a * f - c * c, b * c - a * e], [C, b * c - a * e, a * d - b * b]]
    adjugate = ca.vertcat(*(ca.horzcat(*row) for row in rows))
    return adjugate / (a * A + b * B + c * C)
