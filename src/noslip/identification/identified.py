"""What was found to hold in recordings, and how surely."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from noslip._supplied import Supplied
from noslip._typing import Floats
from noslip._values import Value
from noslip.constraints.declaration import Constraint


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
        Ready for ``learn`` and ``check`` on those recordings.
    rows : int
        How many numbers it takes away from the pose.
    residual, holdout : float
        Root mean square distance from it (m), as fitted, and on what it was not fitted to.
    ratio : float
        Residual over what noise alone would leave; near 1 if it holds.
    holds : bool
        Whether it is believed.
    values, errors : dict
        Its parameters by name, and their standard errors, body or world frame as named.
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
