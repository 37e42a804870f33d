"""Checks of arguments; each error is one line that names the argument."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip.errors import InputError


def positive(name: str, value: Any, unit: str = "") -> float:
    """Return a finite number above 0."""
    found = number(value)
    if not 0 < found <= LARGEST:
        wanted = f"a positive number of {unit}" if unit else "positive"
        limit = f" up to {LARGEST:g}" if found > LARGEST else ""
        raise InputError(f"{name} must be {wanted}{limit}, got {short(value)}")
    return found


def between(name: str, value: Any, least: float, most: float) -> float:
    """Return a number within bounds."""
    found = number(value)
    if not least <= found <= most:
        raise InputError(
            f"{name} must be a positive number from {least:g} to {most:g}, got {short(value)}"
        )
    return found


def inside(name: str, value: Any) -> float:
    """Return a number between 0 and 1, neither of them."""
    found = number(value)
    if not 0 < found < 1:
        raise InputError(f"{name} must be between 0 and 1, got {short(value)}")
    return found


def not_negative(name: str, value: Any) -> float:
    """Return a finite number, 0 or more."""
    found = number(value)
    if not 0 <= found <= LARGEST:
        raise InputError(f"{name} must be a number, 0 or more, got {short(value)}")
    return found


def finite(name: str, value: Any) -> float:
    """Return a finite number."""
    found = number(value)
    if not np.isfinite(found):
        raise InputError(f"{name} must be a finite number, got {short(value)}")
    return found


def flag(name: str, value: Any) -> bool:
    """Return whether something is so."""
    if not isinstance(value, (bool, np.bool_)):
        raise InputError(f"{name} must be True or False, got {short(value)}")
    return bool(value)


LARGEST = 1e12
"""Beyond any length or weight that means something, and far from where doubles overflow."""
MOST_SAMPLES = 2_000_000
"""Of a recording or a motion: half an hour at 1 kHz, and about a gigabyte while it is read or
made."""


def samples(name: str, number: float) -> int:
    """Return a number of samples that an argument asks for, if memory holds it."""
    if not number <= MOST_SAMPLES:
        raise InputError(f"{name} asks for {number:.3g} samples; at most {MOST_SAMPLES:,} are made")
    return int(number)


def count(name: str, value: Any, most: int | None = None) -> int:
    """Return a whole number, 1 or more."""
    found = number(value)
    if not (np.isfinite(found) and found >= 1 and found == int(found)):
        raise InputError(f"{name} must be a whole number, 1 or more, got {short(value)}")
    if most is not None and found > most:
        raise InputError(f"{name} must be {most} or less, got {short(value)}")
    return int(found)


def vector(name: str, value: Any, unit: str = "m", size: int = 3) -> Floats:
    """Return so many finite numbers, shape (size,)."""
    try:
        array = numbers(name, value)
    except InputError:
        array = np.empty(0)
    if array.shape != (size,) or not np.all(np.abs(array) <= LARGEST):
        raise InputError(
            f"{name} must be {size} finite numbers up to {LARGEST:g} ({unit}), got {short(value)}"
        )
    return array


def coordinates(name: str, value: Any, unit: str = "m") -> Floats:
    """Return finite numbers, 1 or more, shape (n,)."""
    try:
        array = numbers(name, value)
    except InputError:
        array = np.empty(0)
    if array.ndim != 1 or not len(array) or not np.all(np.abs(array) <= LARGEST):
        raise InputError(
            f"{name} must be 3 finite numbers up to {LARGEST:g} ({unit}), or as many as what moves "
            f"has coordinates; got {short(value)}"
        )
    return array


def rotation(name: str, value: Any) -> Rotation:
    """Return a single rotation."""
    if not isinstance(value, Rotation) or not value.single:
        yaw = isinstance(value, (float, int, np.floating)) and not isinstance(value, bool)
        hint = f"; of a yaw take Rotation.from_euler('z', {value})" if yaw else ""
        raise InputError(f"{name} must be a single scipy Rotation, got {short(value)}{hint}")
    return value


def inverse_metric(value: Sequence[float], size: int = 6) -> tuple[float, ...]:
    """Return the diagonal of M^-1: so many numbers, none negative, not all 0."""
    weights = _each(value)
    # Over the square of a length.
    largest = LARGEST**2
    fits = len(weights) == size and all(0 <= x <= largest for x in weights)
    if not fits or not any(weights):
        raise InputError(
            f"inverse_metric must be {size} numbers from 0 to {largest:g}, not all 0; "
            f"got {short(value)}"
        )
    return weights


def positive_weights(name: str, value: Sequence[float], size: int = 6) -> tuple[float, ...]:
    """Return so many positive numbers; infinite ones hold what they weigh."""
    weights = _each(value)
    fits = len(weights) == size and all(x > 0 for x in weights)
    if not fits or not any(map(np.isfinite, weights)):
        raise InputError(
            f"{name} must be {size} positive numbers, not all infinite; got {short(value)}"
        )
    return weights


def _each(value: Sequence[float]) -> tuple[float, ...]:
    """Numbers of a sequence, NaN for what is none; nothing if it is no sequence."""
    try:
        return tuple(map(number, value))
    except TypeError:
        return ()


def numbers(name: str, value: Any) -> Floats:
    """Return a copy as an array of floats; text and truth values are no numbers."""
    try:
        given = np.array(value)
        if given.dtype.kind in "iufO":
            return given.astype(np.float64)
    except (TypeError, ValueError, OverflowError):
        pass
    raise InputError(f"{name} is not an array of numbers: got {short(value)}")


def number(value: Any) -> float:
    """Return a number, or NaN for what is none: text and truth values too."""
    if isinstance(value, (str, bytes, bool, np.bool_)):
        return float("nan")
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        return float("nan")


def short(value: Any) -> str:
    """Return a value as text of one line."""
    return " ".join(repr(value).split())[:80]
