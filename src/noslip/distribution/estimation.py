"""A normal distribution of curves, from few of them.

The covariance of n curves in D weights, D far above n, is singular, and says that whatever was not
seen cannot be.  It is shrunk towards one that is not (Ledoit and Wolf 2004),

    ``(1 - a) S + a T,   T(s, s') = c(s) c(s') (1 + r) exp(-r),   r = sqrt(3) |s - s'| / l``

(Matern's of order 3/2) in each channel alone, c(s)^2 being the variance that was seen there, and
then taken along the constraints, as the curves themselves are.  How much (a), how smooth (l), and
how many weights a curve gets is what makes each of the curves most likely under the others
(leave-one-out).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy

from noslip._typing import Floats
from noslip.distribution.curves import SAMPLES, Curves
from noslip.distribution.gaussian import Gaussian

Tangent = Callable[[Curves], Floats]
"""Matrix, shape (d count, d count), that takes weights of curves to those that lead along the
constraints: channel after channel."""

FEWEST = 3
"""Curves: of two, the one left tells nothing of a spread."""
CHOICES: dict[str, tuple[float, ...]] = {
    "weights": (8, 12, 16, 24),
    "shrinkage": (0.02, 0.05, 0.1, 0.2, 0.35, 0.5, 0.7, 0.9),
    "length": (0.05, 0.08, 0.12, 0.2, 0.35, 0.6),
}
"""What is tried of each; the likelihood is flat between neighbors."""
_LEAST_NOISE = 1e-6
"""Least noise of a channel, over its rms: what is closer to a curve is rounding."""
_EVENING = 0.01
"""Share of its mean along the motion that a variance has at least: what all demonstrations have in
common can still be asked to be otherwise."""
_SWEEPS = 2
"""Rounds of choosing each in turn; a third changes nothing on the demonstrations at hand."""


@dataclass(frozen=True)
class Shape:
    """How a covariance is shrunk.

    Attributes
    ----------
    weights : int
        Of a curve in each channel.
    shrinkage : float
        a, from 0 to 1.
    length : float
        l, as a fraction of the motion.
    """

    weights: int
    shrinkage: float
    length: float


@dataclass(frozen=True, eq=False)
class Estimate:
    """What is estimated of curves.

    Attributes
    ----------
    gaussian : Gaussian
        Of the weights, channel after channel, then of the context.
    noise : array, shape (d,)
        Standard deviation of what the curves leave of each channel.
    shape : Shape
    score : float
        Log-likelihood of each curve under the others, nats a value.
    """

    gaussian: Gaussian
    noise: Floats
    shape: Shape
    score: float


def estimate(values: Floats, context: Floats, curves: Curves, tangent: Tangent) -> Estimate:
    """Estimate a normal distribution of curves and of the context that goes with each.

    Parameters
    ----------
    values : array, shape (n, SAMPLES, d)
        Of n curves in d channels, at :data:`noslip.distribution.curves.FRACTIONS`.
    context : array, shape (n, c)
    """
    best, score = Shape(16, 0.7, 0.2), -np.inf
    tried: dict[Shape, float] = {}
    for _ in range(_SWEEPS):
        before = best
        for name, choices in CHOICES.items():
            for choice in choices:
                shape = replace(best, **{name: choice})  # type: ignore[arg-type]
                if shape not in tried:
                    tried[shape] = leave_one_out(values, context, shape, curves, tangent)
                if tried[shape] > score:
                    best, score = shape, tried[shape]
        if best == before:
            break
    gaussian, noise = fitted(values, context, best, curves, tangent)
    return Estimate(gaussian, noise, best, score)


def leave_one_out(
    values: Floats, context: Floats, shape: Shape, curves: Curves, tangent: Tangent
) -> float:
    """Log-likelihood of each curve under the others and its context, nats a value."""
    total = 0.0
    for k in range(len(values)):
        others = np.arange(len(values)) != k
        gaussian, noise = fitted(values[others], context[others], shape, curves, tangent)
        if context.shape[1]:
            rows = context_rows(gaussian, context.shape[1])
            gaussian = gaussian.given(rows, context[k], np.zeros(len(rows)))
        freedom = freedom_of(len(values) - 1, context.shape[1])
        total += log_likelihood(gaussian, noise, values[k], curves.of(shape.weights), freedom)
    return total / len(values)


def log_likelihood(
    gaussian: Gaussian, noise: Floats, values: Floats, curves: Curves, freedom: int
) -> float:
    """Log-density of a curve, shape (SAMPLES, d), over the number of its values (nats).

    Student's: the scale of a covariance that so few motions tell is itself uncertain, and a motion
    unlike them is possible (Murphy 2007, eq. 232).

    Parameters
    ----------
    freedom : int
        nu: degrees of freedom of the covariance.
    """
    basis, channels, size = curves.values, values.shape[1], values.size
    held = values.T @ basis
    left = values.T - held @ basis.T
    own = slice(channels * curves.count)
    spread = gaussian.covariance[own, own] + np.diag(np.repeat(noise**2, curves.count))
    seen = Gaussian(gaussian.mean[own], spread)
    # Orthonormal curves: what they leave is white noise in so many dimensions, and nothing else.
    variance = noise[:, None] ** 2
    square = seen.distance(held.ravel()) ** 2 + float(np.sum(left**2 / variance))
    volume = seen.log_volume + (values.shape[0] - curves.count) * float(np.log(noise).sum())
    gamma = scipy.special.gammaln((freedom + size) / 2) - scipy.special.gammaln(freedom / 2)
    constant = gamma - size / 2 * np.log(np.pi * freedom)
    density = constant - volume - (freedom + size) / 2 * np.log1p(square / freedom)
    return float(density / size)


def freedom_of(count: int, context: int) -> int:
    """Degrees of freedom of what is estimated from so many curves in so many numbers of context."""
    return max(1, count - 1 - context)


def fitted(
    values: Floats, context: Floats, shape: Shape, curves: Curves, tangent: Tangent
) -> tuple[Gaussian, Floats]:
    """Return the distribution of weights and context in one shape, and the noise of each channel.

    Weights follow the context linearly, by least squares; what is left of them is their own spread.
    The mean of n is itself uncertain by an n-th of the covariance, which is added.
    """
    curves = curves.of(shape.weights)
    count, basis = len(values), curves.values
    held = np.einsum("nsd,sk->ndk", values, basis)
    left = values - np.einsum("ndk,sk->nsd", held, basis)
    rms = np.sqrt(np.mean(values**2, axis=(0, 1)))
    floor = _LEAST_NOISE * max(float(rms.max()), 1e-12)
    freedom = SAMPLES - shape.weights
    noise = np.sqrt(np.sum(left**2, axis=(0, 1)) / (count * freedom))
    noise = np.maximum(noise, np.maximum(_LEAST_NOISE * rms, floor))

    weights = held.reshape(count, -1)
    mean, middle = weights.mean(axis=0), context.mean(axis=0)
    apart, aside = weights - mean, context - middle
    slopes = np.linalg.lstsq(aside, apart, rcond=None)[0]
    own = apart - aside @ slopes
    freedom = freedom_of(count, context.shape[1])
    seen = own.T @ own / freedom
    spread = (1 - shape.shrinkage) * seen + shape.shrinkage * _target(
        own, freedom, shape, curves, tangent
    )
    spread *= 1 + 1 / count
    there = aside.T @ aside / max(1, count - 1)
    across = there @ slopes
    covariance = np.block([[spread + slopes.T @ across, across.T], [across, there]])
    return Gaussian(np.concatenate([mean, middle]), covariance), noise


def _target(own: Floats, freedom: int, shape: Shape, curves: Curves, tangent: Tangent) -> Floats:
    """T in the weights of the curves: channel by channel, then along the constraints."""
    basis, channels = curves.values, own.shape[1] // curves.count
    apart = np.sqrt(3) * np.abs(np.subtract.outer(curves.places, curves.places)) / shape.length
    alike = (1 + apart) * np.exp(-apart)
    found = np.zeros((channels, curves.count) * 2)
    for channel, weights in enumerate(np.split(own, channels, axis=1)):
        variance = np.sum((weights @ basis.T) ** 2, axis=0) / freedom
        variance += _EVENING * (variance.mean() - variance)
        size = np.sqrt(variance)
        found[channel, :, channel] = basis.T @ (size[:, None] * alike * size) @ basis
    along = tangent(curves)
    return np.asarray(along @ found.reshape(own.shape[1], -1) @ along.T)


def context_rows(gaussian: Gaussian, size: int) -> Floats:
    """Rows that pick the context out of the weights, shape (size, D)."""
    return np.eye(len(gaussian.mean))[len(gaussian.mean) - size :]
