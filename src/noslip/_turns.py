"""The ways in which tables write rotations, as quaternions."""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip.errors import RecordingError

KINDS = (
    "wxyz, xyzw (quaternions), rotvec, euler:ZYX (capitals: about the moving axes; small: about "
    "the fixed ones; any order), rpy (euler:xyz), planar, matrix:rows, matrix:columns, 6d (its "
    "first two rows), 6d:columns; :deg where angles are in degrees"
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
    kind : "quaternion", "rotvec", "euler", "planar", "matrix" or "6d"
    order : str
        ``wxyz`` or ``xyzw``; axes as SciPy has them; ``rows`` or ``columns``, empty if unknown.
        Six numbers are a matrix's first two rows (PyTorch3D, diffusion policies) or columns.
    degrees : bool or None
        None where nothing tells.
    """

    kind: str
    order: str = ""
    degrees: bool | None = None

    @property
    def counts(self) -> tuple[int, ...]:
        """How many numbers it takes; more of them hold the position, too."""
        several = {"quaternion": (4,), "planar": (1,), "matrix": (9, 12, 16), "6d": (6,)}
        return several.get(self.kind, (3,))

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
        elif self.kind == "6d":
            text = f"first two {self.order} of the rotation matrix"
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
            case "6d":
                of = self._of_matrices(where, _completed(good, self.order))
            case _:
                of = self._of_matrices(where, good)
        quaternions[whole] = of
        return quaternions

    def numbers(self, quaternions: Floats, near: Floats) -> Floats:
        """Return the numbers, shape (N, count), of unit quaternions, shape (N, 4), scalar first.

        Of the many ways to write a rotation, quaternions of either sign and angles a turn apart,
        the one nearest to other numbers, shape (N, count): so a policy sees no jump.
        """
        turns = Rotation.from_quat(quaternions, scalar_first=True)
        match self.kind:
            case "quaternion":
                found = quaternions if self.order == "wxyz" else np.roll(quaternions, -1, axis=1)
                opposite = np.sum(found * near, axis=1, keepdims=True) < 0
                return np.asarray(np.where(opposite, -found, found))
            case "matrix" | "6d":
                matrices = turns.as_matrix()
                matrices = matrices.transpose(0, 2, 1) if self.order == "columns" else matrices
                return np.asarray(matrices.reshape(-1, 9)[:, : self.counts[0]])
        unit, whole = (np.degrees(1.0), 360.0) if self.degrees else (1.0, 2 * np.pi)
        if self.kind == "rotvec":
            found = turns.as_rotvec() * unit
            axis = np.where(np.any(found, axis=1, keepdims=True), found, near)
            axis = axis / np.maximum(np.linalg.norm(axis, axis=1, keepdims=True), 1e-300)
            behind = np.sum((near - found) * axis, axis=1, keepdims=True)
            return np.asarray(found + axis * whole * np.round(behind / whole))
        order = "ZYX" if self.kind == "planar" else self.order
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # At gimbal lock any of them will do.
            angles = turns.as_euler(order) * unit
        if self.kind == "planar":
            return np.asarray(angles[:, :1] + whole * np.round((near - angles[:, :1]) / whole))
        # Half a turn about the first and last axis, and the middle angle mirrored, is the same.
        mirrored = angles * [1, -1, 1] + whole / 2 * np.array([1, order[0] != order[2], 1])
        ways = np.stack([angles, mirrored])
        ways += whole * np.round((near - ways) / whole)
        nearest = np.abs(ways - near).sum(axis=2).argmin(axis=0)
        return np.asarray(ways[nearest, np.arange(len(near))])

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


def _completed(numbers: Floats, order: str) -> Floats:
    """Return the nine numbers of the matrices whose first two rows or columns six say.

    By Gram and Schmidt, as networks mean them (Zhou et al., CVPR 2019): the first as it is, the
    second as far as it is across.
    """
    first, second = numbers[:, :3], numbers[:, 3:]
    with np.errstate(invalid="ignore", divide="ignore"):
        one = first / np.linalg.norm(first, axis=1, keepdims=True)
        across = second - np.sum(one * second, axis=1, keepdims=True) * one
        two = across / np.linalg.norm(across, axis=1, keepdims=True)
    matrices = np.hstack([one, two, np.cross(one, two)])
    return np.where(np.isfinite(matrices).all(axis=1, keepdims=True), matrices, 0.0)


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
    words = [word for word in re.split(r"[^A-Za-z0-9]+", text) if word]
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
    for prefix in ("6d", "rot6d", "rotation6d"):
        known |= {prefix: Turn("6d", "rows"), f"{prefix}columns": Turn("6d", "columns")}
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
