"""What was found to hold in recordings, and how surely."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import numpy as np

from noslip._supplied import Supplied
from noslip._typing import Floats
from noslip._values import Value, html_table
from noslip.constraints.catalog import constraint_text
from noslip.constraints.declaration import Constraint
from noslip.edge import AXES
from noslip.trajectory import PoseTrajectory

ALONG, FAR = np.radians([0.05, 20.0])
"""Radians from a body axis within which a direction is called that axis, and beyond which it is
told by its numbers: between, by the axis and the angle."""
_FINEST_DIGITS = 4
"""Behind the point of a value that is said: tenths of a micrometer."""
MOSTLY = 0.9
"""Length of a body axis's part along directions of which nothing is told, from which nothing is
told along that axis."""


@dataclass(frozen=True, eq=False, repr=False)
class Row(Value):
    """One direction of the body along which one point of it does not move: ``a . (v + w x r) = 0``.

    Attributes
    ----------
    axis : array, shape (3,)
        a, unit vector, body frame.
    point : array, shape (3,)
        r (m), body frame, nearest the origin along what cannot be told.
    axis_covariance, point_covariance : array, shape (3, 3)
        Of both (rad^2, m^2), body frame; the point's is that across `unknown`.
    unknown : array, shape (k, 3)
        Orthonormal directions along which the recordings do not tell where the point is; the axis
        is always among them.
    given : float
        Root mean square speed of the body's origin along the axis, over that of its speed.
    slip : float
        The same of the point, the share of the noise subtracted.
    holdout : float
        The same on recordings, or blocks of time, that the row was not fitted to.
    """

    axis: Floats
    point: Floats
    axis_covariance: Floats
    point_covariance: Floats
    unknown: Floats
    given: float
    slip: float
    holdout: float


@dataclass(frozen=True, eq=False, repr=False)
class Place(Value):
    """One position-level rule that was fitted: where in the world a point of the body stays.

    Attributes
    ----------
    kind : str
        ``"plane"``, ``"sphere"``, ``"cylinder"``, ``"remote center"``, ``"fixed point"``,
        ``"fixed axis"``, ``"rolling disc"``, ...
    constraints : tuple of Constraint
        Ready for ``learn`` and ``check`` on those recordings; empty if it does not hold.
    rows : int
        How many numbers it takes away from the pose.
    residual, holdout : float
        Root mean square distance from it (m; of an axis rad), as fitted, and on what it was not
        fitted to.
    ratio : float
        Residual over what noise alone would leave; near 1 if it holds.
    holds : bool
        Whether it is believed.
    values, errors : dict
        Its parameters by name, and of a number the standard error, of a vector the covariance,
        shape (3, 3): see :func:`noslip.identification.places.fit_places`.
    notes : tuple of str
        What the recordings cannot tell of it, a sentence each.
    """

    kind: str
    constraints: tuple[Constraint, ...]
    rows: int
    residual: float
    holdout: float
    ratio: float
    holds: bool
    values: dict[str, Any]
    errors: dict[str, Any]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False, repr=False)
class Identified(Value):
    """What holds in recordings.

    Attributes
    ----------
    constraints : tuple of Constraint
        In the body frame of the recordings, ready for ``learn`` and ``check``; empty if none holds.
    kinds : tuple of str
        Their names in the catalog.
    travel : array, shape (3,), or None
        Unit vector along which the tool moves, body frame.
    lateral : array, shape (3,), or None
        Unit vector along which it must not, body frame.
    reference_point : array, shape (3,), or None
        The point that does not slip (m), body frame; nearest the origin along what cannot be told.
    rows : tuple of Row
        The directions free of slip.
    candidates : tuple of Row
        Three of them, whether believed or not, the least slip first.
    surfaces : tuple of Place
        What was tried at position level.
    curvature, curvature_error : float or None
        Of a beveled needle (1/m), and its standard error.
    turning_radius : float or None
        The least that bounds it (m), if one does.
    noise : (float, float)
        Standard deviation of a sample's position (m) and rotation (rad, about each axis).
    speed : float
        Root mean square speed of the body's origin while it moves (m/s).
    names : tuple of str
        Of the recordings.
    notes : tuple of str
        What would tell more, a sentence each.
    recordings : tuple of PoseTrajectory
        What it was found in, in the order of the names.
    """

    constraints: tuple[Constraint, ...]
    kinds: tuple[str, ...]
    travel: Floats | None
    lateral: Floats | None
    reference_point: Floats | None
    rows: tuple[Row, ...]
    candidates: tuple[Row, ...]
    surfaces: tuple[Place, ...]
    curvature: float | None
    curvature_error: float | None
    turning_radius: float | None
    noise: tuple[float, float]
    speed: float
    names: tuple[str, ...]
    notes: tuple[str, ...] = ()
    recordings: tuple[PoseTrajectory, ...] = ()

    plot = Supplied(
        "Draw why: slip of each direction, the point and its region; return the figure."
    )

    @property
    def tool_frame(self) -> Floats | None:
        """The tool's pose in the body's frame, shape (4, 4), ready for ``prepare(tool_frame=)``.

        x along the travel, y along the lateral axis, origin at the reference point; None if no
        lateral axis was found.
        """
        if self.lateral is None or self.travel is None or self.reference_point is None:
            return None
        matrix = np.eye(4)
        matrix[:3, :3] = np.column_stack(
            [self.travel, self.lateral, np.cross(self.travel, self.lateral)]
        )
        matrix[:3, 3] = self.reference_point
        return matrix

    def to_dict(self) -> dict[str, Any]:
        """Plain data, for JSON: constraints as texts for the command line, arrays as lists."""
        data = {f.name: _plain(getattr(self, f.name)) for f in fields(self)}
        del data["recordings"]
        return data | {"tool_frame": _plain(self.tool_frame)}

    def __str__(self) -> str:
        return "\n".join(f"{'  ' * (k > 0)}{line}" for k, line in enumerate(self.sentences))

    def _repr_html_(self) -> str:
        return html_table(self.sentences[0], [(line,) for line in self.sentences[1:]])

    @property
    def sentences(self) -> tuple[str, ...]:
        """What was found, and how surely; numbers after a ± are standard errors."""
        held = [place for place in self.surfaces if place.holds]
        places = [constraint for place in held for constraint in place.constraints]
        tools = [type(c).name for c in self.constraints if c not in places]
        kinds = " and ".join([*tools, *(place.kind for place in held)]) or "no constraint"
        count = len(self.names)
        lines = [f"{kinds} in {count} recording{'s' if count > 1 else ''}"]
        if self.rows:
            lines += [self._axes, self._place]
            if self.curvature is not None:
                radius = (
                    f", a radius of {1e3 / abs(self.curvature):.3g} mm" if self.curvature else ""
                )
                bend = measured(self.curvature, self.curvature_error)
                lines.append(f"its path bends by {bend} 1/m{radius}")
            if self.turning_radius is not None:
                lines.append(f"turns no tighter than {1e3 * self.turning_radius:.3g} mm")
        if rows := self.rows or self.candidates[: not held]:
            given, slip, holdout = (
                100 * np.sqrt(sum(getattr(row, name) ** 2 for row in rows))
                for name in ("given", "slip", "holdout")
            )
            least = "" if self.rows else f"the stillest direction is {axis_text(rows[0].axis)}: "
            lines.append(
                f"{least}slips {slip:.2g} % of its speed, {given:.2g} % about the origin; "
                f"{holdout:.2g} % where it was not fitted"
            )
        for place in held:
            lines += [_place_text(place), *place.notes]
        return (*lines, *self.notes)

    @property
    def _axes(self) -> str:
        """Which way it must not move, and which way it does, with the axes' standard errors."""
        assert self.lateral is not None and self.travel is not None
        needle = "needle" in self.kinds
        texts = (
            [] if needle else [f"lateral axis {axis_text(self.lateral, self._error(self.lateral))}"]
        )
        travel = axis_text(self.travel, self._error(self.travel) if needle else None)
        return ", ".join([*texts, f"{'shaft' if needle else 'travel'} {travel}"])

    def _error(self, axis: Floats) -> float:
        """Largest standard error (rad) of an axis, by those of the rows that are turned with it."""
        own = [row.axis_covariance for row in self.rows if np.allclose(row.axis, axis)]
        if own:
            return float(np.sqrt(max(np.linalg.eigvalsh(own[0])[-1], 0.0)))
        return float(np.sqrt(max(axis @ row.axis_covariance @ axis for row in self.rows)))

    @property
    def _place(self) -> str:
        """Where its point is, along the axes that are told, and what would tell the others."""
        # The ground of a wheel tells nothing of its point.
        rows = self.rows if "needle" in self.kinds else self.rows[:1]
        row = rows[0]
        if len(row.unknown) == 3:
            return "nothing tells where its point is: turn it in other ways as it moves"
        errors = 1e3 * np.sqrt(np.maximum(np.diag(row.point_covariance), 0))
        told = np.linalg.norm(row.unknown, axis=0) < MOSTLY if len(row.unknown) else [True] * 3
        places = [
            f"{letter} {measured(1e3 * row.point[k], errors[k])}"
            for k, letter in enumerate(AXES)
            if told[k]
        ]
        texts = [f"its point is at {', '.join(places)} mm"]
        # What may not move makes no difference along itself: that direction first.
        for direction in np.linalg.svd((row.unknown @ row.axis)[None])[2] @ row.unknown:
            turns = [np.cross(direction, other.axis) for other in rows]
            about = [roughly(turn) for turn in turns if np.linalg.norm(turn) > MOSTLY / 2]
            tells = f"nothing tells where it is: turn about {' or '.join(about)}"
            texts.append(f"along {roughly(direction)} {tells if about else 'it may be anywhere'}")
        return "; ".join(texts)


def _place_text(place: Place) -> str:
    """Say where in the world a point of the body stays, and how nearly."""
    texts = []
    for name, value in place.values.items():
        lengths = "point" in name or np.ndim(value) == 0
        numbers = np.atleast_1d(value) * (1e3 if lengths else 1)
        text = ", ".join(f"{number:.4g}" for number in np.round(numbers, 3) + 0.0)
        text = f"({text})" if np.ndim(value) else text
        texts.append(f"{name.replace('_', ' ')} {text}{' mm' if lengths else ''}")
    # A tool axis is off by an angle.
    residual, holdout, unit = 1e3 * place.residual, 1e3 * place.holdout, "mm"
    if place.kind == "tool axis":
        residual, holdout, unit = np.degrees(place.residual), np.degrees(place.holdout), "degrees"
    off = f"off by {residual:.2g} {unit} (rms), {holdout:.2g} where it was not fitted"
    return f"{place.kind}: {', '.join(texts)}; {off}"


def _off(axis: Floats) -> tuple[str, float]:
    """The signed letter nearest to a direction of the body, and the angle between them (rad)."""
    nearest = int(np.argmax(np.abs(axis)))
    beside = np.linalg.norm(np.delete(axis, nearest))
    return ("-" if axis[nearest] < 0 else "") + AXES[nearest], np.arctan2(
        beside, abs(axis[nearest])
    )


def roughly(axis: Floats) -> str:
    """Say about which body axis a direction is, up to its sign, or else its numbers."""
    letter, angle = _off(axis)
    return letter[-1] if angle < FAR else axis_text(axis)


def axis_text(axis: Floats, error: float | None = None) -> str:
    """Say a direction of the body: a letter and by how much it is turned, or its numbers.

    `error` is its standard error (rad).
    """
    letter, angle = _off(axis)
    if angle > FAR:
        numbers = ", ".join(f"{value:.3g}" for value in np.round(axis, 3) + 0.0)
        return f"({numbers})" if error is None else f"({numbers}) ± {np.degrees(error):.1g} degrees"
    if angle < ALONG and error is None:
        return letter
    turn = measured(np.degrees(angle), None if error is None else np.degrees(error))
    return f"{letter} turned by {turn} degrees"


def measured(value: float, error: float | None) -> str:
    """Say a value to the first digit of its standard error, and that; else with one decimal."""
    if not error:
        return f"{value:.1f}"
    digits = int(np.clip(-np.floor(np.log10(error)), 0, _FINEST_DIGITS))
    return f"{value:.{digits}f} ± {error:.{digits}f}"


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Constraint):
        return constraint_text(value)
    if is_dataclass(value):
        return {f.name: _plain(getattr(value, f.name)) for f in fields(value)}
    if isinstance(value, Mapping):
        return {name: _plain(each) for name, each in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(each) for each in value]
    return value.item() if isinstance(value, np.generic) else value
