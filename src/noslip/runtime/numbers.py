"""A primitive's numbers as C knows them: text for a robot, a struct for this process."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from noslip._typing import Floats
from noslip.learning import ConstrainedDMP

Number = int | float | Floats

_ARRAYS = ("centers", "widths", "weights", "knot_quaternions", "knot_splines")
"""Behind pointers; the other fields stand in the struct itself."""


def numbers(dmp: ConstrainedDMP) -> dict[str, Number]:
    """Fields of ``noslip_primitive`` (``noslip.h``), in order."""
    basis, winding = dmp.position.forcing.basis, dmp.orientation.winding
    attractor, state = dmp.position.attractor, dmp.initial_state()
    splines = winding.splines.reshape(-1, 12)
    return {
        "basis_functions": basis.count,
        "centers": basis.centers,
        "widths": basis.widths,
        "weights": dmp.offset_weights,
        "alpha": attractor.alpha,
        "beta": attractor.beta,
        "alpha_s": dmp.phase.alpha_s,
        "knots": len(winding.quaternions),
        "knot_quaternions": winding.quaternions,
        # C knows no empty arrays.
        "knot_splines": splines if len(splines) else np.zeros((1, 12)),
        "duration": dmp.duration,
        "residual_rate": dmp.stabilization,
        "barrier_rate": dmp.barrier_rate,
        "begin": dmp.begin,
        "start_position": state.position,
        "start_quaternion": state.rotation.as_quat(scalar_first=True),
        "start_linear_velocity": state.linear_velocity,
        "start_angular_velocity": state.angular_velocity,
        "goal_position": state.goal_position,
        "goal_quaternion": state.goal_rotation.as_quat(scalar_first=True),
    }


class Struct:
    """``noslip_primitive`` in this process's memory.

    Attributes
    ----------
    address, size : int
    """

    def __init__(self, dmp: ConstrainedDMP) -> None:
        fields: list[tuple[str, Any]] = []
        values: dict[str, Any] = {}
        # What pointers point to must live as long as the struct.
        self._kept: list[Floats] = []
        for name, value in numbers(dmp).items():
            if isinstance(value, int):
                fields.append((name, ctypes.c_int))
                values[name] = value
            elif name in _ARRAYS:
                array = np.array(value, dtype=np.float64, order="C")
                self._kept.append(array)
                fields.append((name, ctypes.c_void_p))
                values[name] = array.ctypes.data
            elif isinstance(value, np.ndarray):
                fields.append((name, ctypes.c_double * value.size))
                values[name] = tuple(value.tolist())
            else:
                fields.append((name, ctypes.c_double))
                values[name] = float(value)
        layout = type("noslip_primitive", (ctypes.Structure,), {"_fields_": fields})
        self._struct = layout(**values)
        self.address, self.size = ctypes.addressof(self._struct), ctypes.sizeof(self._struct)


def text(dmp: ConstrainedDMP, name: str) -> str:
    """A C file with the numbers of a primitive, as ``const noslip_primitive name``."""
    arrays, values = [], []
    for field, value in numbers(dmp).items():
        if isinstance(value, int):
            values.append(f"    .{field} = {value}")
        elif isinstance(value, np.ndarray) and field in _ARRAYS:
            arrays.append(_array(field, value))
            values.append(f"    .{field} = {field}")
        elif isinstance(value, np.ndarray):
            values.append(f"    .{field} = {_list(value)}")
        else:
            values.append(f"    .{field} = {_number(value)}")
    return (
        '#include "noslip.h"\n\n#define R(x) ((noslip_real)(x))\n\n'
        + "\n\n".join(arrays)
        + f"\n\nextern const noslip_primitive {name};\n"
        + f"const noslip_primitive {name} = {{\n"
        + ",\n".join(values)
        + ",\n};\n"
    )


def _number(value: float) -> str:
    return f"R({float(value)!r})"


def _list(values: ArrayLike) -> str:
    return "{" + ", ".join(_number(x) for x in np.ravel(values).tolist()) + "}"


def _array(name: str, values: Floats) -> str:
    if values.ndim == 1:
        lines = ",\n".join("    " + _number(x) for x in values.tolist())
        return f"static const noslip_real {name}[{len(values)}] = {{\n{lines},\n}};"
    lines = ",\n".join("    " + _list(row) for row in values)
    shape = f"[{len(values)}][{values.shape[1]}]"
    return f"static const noslip_real {name}{shape} = {{\n{lines},\n}};"
