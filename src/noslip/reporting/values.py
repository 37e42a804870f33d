"""What a report is made of: tables of numbers and how they are told, pictures, sentences."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from noslip.figures.quantities import value_text
from noslip.figures.style import number


@dataclass(frozen=True)
class Value:
    """A number (SI units, radians) and how it is told."""

    number: float
    text: str


Cell = str | Value
"""Of a table."""


@dataclass(frozen=True)
class Table:
    """Rows under headings, with a note below.

    Attributes
    ----------
    title : str
    columns : tuple of str
        The first one's cells head their rows.
    rows : tuple of tuple of str or Value
    note : str
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ""


@dataclass(frozen=True, eq=False)
class Picture:
    """A figure and what it shows."""

    caption: str
    figure: Figure


@dataclass(frozen=True, eq=False)
class Report:
    """All that a report of a primitive says.

    Attributes
    ----------
    title : str
        The finding.
    primitive : str
        The primitive's file.
    lead : str
        What was learned from what, in a sentence or two.
    verdict : str
        What :func:`noslip.check` says of the motion; empty without constraints.
    holds : bool
    warnings : tuple of str
        Where recordings and primitive do not fit together.
    tables, provenance : tuple of Table
        What it tells, and what it was made of: settings, versions, files and their hashes.
    pictures : tuple of Picture
    commands : tuple of str
        Shell commands that make it again.
    """

    title: str
    primitive: str
    lead: str
    verdict: str
    holds: bool
    warnings: tuple[str, ...]
    tables: tuple[Table, ...]
    provenance: tuple[Table, ...]
    pictures: tuple[Picture, ...]
    commands: tuple[str, ...]


def plain(value: float) -> Value:
    return Value(value, number(value))


def count(value: int) -> Value:
    return Value(value, str(value))


def cell(value: float | None, unit: str) -> Cell:
    """Return a number with its unit: of an angle (rad) in degrees; a dash where there is none."""
    if value is None:
        return "–"
    if unit == "rad":
        return Value(value, f"{number(float(np.degrees(value)))}°")
    return Value(value, value_text(value, unit))
