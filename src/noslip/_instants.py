"""Instants of a recording's clock, as a person reads and asks for them."""

from __future__ import annotations

DAY = 86400.0
"""Seconds.  A clock that has run for so long when a recording begins counts from when a machine was
started, or from 1970: its count tells a person nothing, and three digits of it nothing at all."""


EXACT = 15
"""Digits, where two instants may differ by little."""


def counts_from_afar(first: float) -> bool:
    """Whether a clock that shows this at the first sample is told from there on."""
    return abs(first) >= DAY


def seconds(time: float, first: float, digits: int = 6) -> str:
    """Return an instant for a message: on the clock, or after the first sample where that is long.

    Parameters
    ----------
    time, first : float
        Of the instant, and of the recording's first sample (s).
    digits : int
        How many it has; 6 or more from 100 s on.
    """
    after = counts_from_afar(first)
    # What is left of so long a count is known to a microsecond.
    shown = round(float(time - first), 6) if after else float(time)
    # Three digits of ten minutes are ten seconds.
    text = f"{shown:.{digits}g}" if abs(shown) < 100 else f"{shown:.{max(digits, 6)}g}"
    return f"{text} s after its start" if after else f"{text} s"


def interval(begin: float, end: float, first: float) -> str:
    """Return ``"1 to 2.5 s"``, the same of two instants."""
    return f"{seconds(begin, first).partition(' ')[0]} to {seconds(end, first)}"


def on_clock(asked: float, first: float) -> float:
    """Return an instant that was asked for on the recording's clock (s).

    Of a clock that counts from afar, less than a day is after the first sample.
    """
    return asked + first if counts_from_afar(first) and abs(asked) < DAY else asked
