"""What to cite: BibTeX of the methods that a primitive was made with, and of no others."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.resources import files
from typing import TextIO

from noslip._version import __version__
from noslip.constraints import InMovingFrame
from noslip.constraints.catalog import resolved
from noslip.constraints.declaration import Constraint
from noslip.constraints.of_body import OfBody
from noslip.distribution import MotionDistribution
from noslip.errors import InputError
from noslip.primitive import ConstrainedDMP
from noslip.provenance import Origin


def cite(used: ConstrainedDMP | MotionDistribution, *, file: TextIO | None = None) -> None:
    """Print BibTeX entries of what a primitive, or a distribution of motions, was made with.

    That is noslip, the primitives themselves, and what the constraints, the limits and each call in
    ``dmp.history`` brought in.

    Parameters
    ----------
    used : ConstrainedDMP or MotionDistribution
    file : text file, optional
        Where to write; by default standard output.

    Raises
    ------
    InputError
        If it is something else.

    Examples
    --------
    >>> ns.cite(dmp)
    >>> with open("used.bib", "w") as bibliography:
    ...     ns.cite(dmp, file=bibliography)
    """
    if not isinstance(used, (ConstrainedDMP, MotionDistribution)):
        raise InputError(
            f"cite: takes a primitive or a distribution of motions, got a {type(used).__name__}; "
            "give what learn or load_primitive returned"
        )
    entries = _entries()
    print("\n\n".join(entries[key] for key in dict.fromkeys(_keys(used))), file=file)


def _entries() -> dict[str, str]:
    """BibTeX entries by key."""
    text = (files("noslip") / "references.bib").read_text(encoding="utf-8")
    entries = text.replace("VERSION", __version__).strip().split("\n\n")
    return {entry.partition("{")[2].partition(",")[0]: entry for entry in entries}


def _keys(used: ConstrainedDMP | MotionDistribution) -> Iterator[str]:
    """Keys of what was used, in the order in which they are printed; some come twice."""
    dmp = used.primitive if isinstance(used, MotionDistribution) else used
    yield "noslip"
    if dmp.system.equalities.size:
        yield from ("straizys2022", "udwadia1992")
    yield "ijspeert2013"
    if dmp.law.space.rotations:
        yield "ude2014"
    if dmp.system.limits.size:
        yield from ("ames2019", "goldfarb1983")
    if any(_innermost(constraint).name == "needle" for constraint in dmp.constraints):
        yield "webster2006"
    if isinstance(used, MotionDistribution):
        yield "paraschos2013"
    for origin in dmp.history:
        yield from _keys_of_call(origin, dmp.record[0].maneuver if dmp.record else "")
    if dmp.system.size:
        yield "andersson2019"


def _keys_of_call(origin: Origin, maneuver: str) -> Iterator[str]:
    if origin.options.get("distribution"):
        yield "paraschos2013"
    if origin.options.get("robot") is not None:
        yield "todorov2012"
    if origin.options.get("scaling") == "rotation-dilation":
        yield "ginesi2021"
    if origin.verb in ("adapt", "replan") and not maneuver:
        yield "flash1985"
    # Turns on the spot, and a needle's bends (the only ones about its shaft), are of neither.
    if origin.verb == "adapt" and maneuver and "turn" not in maneuver and "roll" not in maneuver:
        yield "reeds1990" if "back" in maneuver else "dubins1957"
    if origin.verb == "improve":
        yield "hansen2001"


def _innermost(constraint: Constraint) -> Constraint:
    """Return the constraint that another one asks of a body, or in a frame that moves."""
    while isinstance(constraint, (InMovingFrame, OfBody)):
        constraint = resolved(constraint.name, constraint.constraint)
    return constraint
