"""The ways in which tables write rotations, as quaternions."""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip.errors import RecordingError

KINDS = (
    "wxyz, xyzw (quaternions), rotvec, euler:ZYX (capitals: about the moving axes; small: about "
    "the fixed ones; any order), rpy (euler:xyz), planar, matrix:rows, matrix:columns; :deg where "
    "angles are in degrees"
)
"""What a rotation may be called, for messages."""
NOT_ORTHOGONAL = 1e-3
"""How far a matrix may be off a rotation, as the norm of a quaternion: rounding to three decimals
does no more."""


@dataclass(frozen=True)
class Turn:
    """A way to write a rotation.

    Attributes
    ----------
    kind : "quaternion", "rotvec", "euler", "planar" or "matrix"
    order : str
        ``wxyz`` or ``xyzw``; axes as SciPy has them; ``rows`` or ``columns``, empty if unknown.
    degrees : bool or None
        None where nothing tells.
    """

    kind: str
    order: str = ""
    degrees: bool | None = None

    @property
    def counts(self) -> tuple[int, ...]:
        """How many numbers it takes; more of them hold the position, too."""
        return {"quaternion": (4,), "planar": (1,), "matrix": (9, 12, 16)}.get(self.kind, (3,))

    @property
    def angular(self) -> bool:
        """Whether it is in radians or degrees."""
        return self.kind in ("rotvec", "euler", "planar")

    def __str__(self) -> str:
        name = {"quaternion": "quaternion", "rotvec": "rotation vector", "planar": "angle about z"}
        if self.kind == "euler":
            about = "moving" if self.order.isupper() else "fixed"
            text = f"Euler angle, {self.order} about the {about} axes"
        elif self.kind == "matrix":
            text = f"rotation matrix by {self.order}"
        else:
            text = name[self.kind]
        return f"{text}, {'deg' if self.degrees else 'rad'}" if self.angular else text

    def quaternions(self, where: str, numbers: Floats) -> Floats:
        """Return unit quaternions, scalar first, shape (N, 4), of numbers, shape (N, count).

        A quaternion keeps its norm, so that it can be refused; what is not finite stays so.

        Raises
        ------
        InputError
            If angles are too large for radians, or a matrix is no rotation.
        """
        if self.kind == "quaternion":
            return numbers if self.order == "wxyz" else np.roll(numbers, 1, axis=1)
        whole = np.isfinite(numbers).all(axis=1)
        quaternions = np.full((len(numbers), 4), np.nan)
        good = numbers[whole]
        if self.angular and self.degrees is None and len(good):
            _require_radians(where, good)
        angles = np.radians(good) if self.degrees else good
        match self.kind:
            case "planar":
                half = angles[:, 0] / 2
                still = np.zeros(len(half))
                of = np.column_stack([np.cos(half), still, still, np.sin(half)])
            case "rotvec":
                of = Rotation.from_rotvec(angles).as_quat(scalar_first=True)
            case "euler":
                of = Rotation.from_euler(self.order, angles).as_quat(scalar_first=True)
            case _:
                of = self._of_matrices(where, good)
        quaternions[whole] = of
        return quaternions

    def _of_matrices(self, where: str, numbers: Floats) -> Floats:
        matrices = numbers.reshape(-1, 3, 3)
        if self.order == "columns":
            matrices = matrices.transpose(0, 2, 1)
        # Of a lost pose all numbers are zero: it is refused, or left out, as a quaternion.
        lost = ~numbers.any(axis=1)
        off = np.abs(matrices @ matrices.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
        off = np.where(np.linalg.det(matrices) > 0, off, np.inf)
        if np.any(bad := (off > NOT_ORTHOGONAL) & ~lost):
            raise RecordingError(
                f"{where}: the matrix of sample {int(np.argmax(bad))} is no rotation (off by "
                f"{off[np.argmax(bad)]:.2g}); choose other columns, or say by --rotation "
                f"(rotation=) what they hold: {KINDS}"
            )
        quaternions = np.zeros((len(numbers), 4))
        if not lost.all():
            turns = Rotation.from_matrix(matrices[~lost])
            quaternions[~lost] = turns.as_quat(scalar_first=True)
        return quaternions


def _require_radians(where: str, angles: Floats) -> None:
    """Refuse angles beyond a turn that nobody says are radians."""
    if (largest := float(np.abs(angles).max())) > 2 * np.pi + 1e-3:
        raise RecordingError(
            f"{where}: angles reach {largest:.4g}; add :deg or :rad to the rotation (--rotation)"
        )


def parse_turn(text: str) -> Turn:
    """Return the way to write a rotation that a text names.

    Raises
    ------
    InputError
        If it names none; the message lists them.
    """
    words = [word for word in re.split(r"[^A-Za-z]+", text) if word]
    degrees = next((word.lower().startswith("deg") for word in words if _is_angle(word)), None)
    rest = [word for word in words if not _is_angle(word)]
    for axes, change in (("intrinsic", str.upper), ("extrinsic", str.lower)):
        if axes in map(str.lower, rest):
            rest = [change(word) for word in rest if word.lower() != axes]
    lower = "".join(rest).lower()
    known = {
        "wxyz": Turn("quaternion", "wxyz"),
        "xyzw": Turn("quaternion", "xyzw"),
        "rotvec": Turn("rotvec"),
        "rotationvector": Turn("rotvec"),
        "axisangle": Turn("rotvec"),
        "angleaxis": Turn("rotvec"),
        "rpy": Turn("euler", "xyz"),
        "rollpitchyaw": Turn("euler", "xyz"),
        "ypr": Turn("euler", "ZYX"),
        "planar": Turn("planar"),
        "theta": Turn("planar"),
        "matrix": Turn("matrix"),
        "matrixrows": Turn("matrix", "rows"),
        "matrixcolumns": Turn("matrix", "columns"),
    }
    for prefix in ("quaternion", "quat"):
        known |= {prefix: known["wxyz"], f"{prefix}wxyz": known["wxyz"]}
        known |= {f"{prefix}xyzw": known["xyzw"]}
    found = known.get(lower)
    order = rest[-1] if rest else ""
    if found is None and re.fullmatch(r"([xyz]{3}|[XYZ]{3})", order):
        named = lower in (order.lower(), f"euler{order.lower()}")
        if named and all(a != b for a, b in pairwise(order)):
            found = Turn("euler", order)
    if found is None:
        raise RecordingError(f"rotation {text!r} is not known; known are {KINDS}")
    return Turn(found.kind, found.order, degrees if found.angular else None)


def _is_angle(word: str) -> bool:
    return word.lower() in ("deg", "degrees", "rad", "radians")
