"""A primitive's numbers as C knows them: text for a robot, a struct for this process."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from noslip._typing import Floats
from noslip.errors import InputError
from noslip.law.channels import Channels
from noslip.law.law import Law
from noslip.law.layout import Field, layouts
from noslip.rule import Rule
from noslip.runtime.rollout import initial_state

Number = int | float | Floats


def numbers(law: Law, rule: Rule, channels: Channels | None = None) -> dict[str, Number]:
    """Values of the fields of ``noslip_primitive``, see :mod:`noslip.law.layout`."""
    windings, state = law.goal.windings, initial_state(law, rule)
    knots = [winding.quaternions for winding in windings] or [np.zeros((1, 0))]
    splines = [winding.splines.reshape(-1, 12) for winding in windings] or [np.zeros((1, 0))]
    if len(set(map(len, knots))) > 1:
        raise InputError("rotations wind by different numbers of knots, which C does not know yet")
    curves = np.hstack(splines)
    return {
        "basis_functions": law.basis.count,
        "centers": law.basis.centers,
        "widths": law.basis.widths,
        "weights": law.offset_weights,
        "alpha": law.attractor.alpha,
        "beta": law.attractor.beta,
        "alpha_s": law.clock.alpha_s,
        "knots": len(knots[0]),
        "knot_quaternions": np.hstack(knots),
        # C knows no empty arrays.
        "knot_splines": curves if len(curves) else np.zeros((1, curves.shape[1])),
        "steps": law.steps,
        "duration": law.duration,
        "residual_rate": rule.stabilization,
        "barrier_rate": rule.barrier_rate,
        "begin": law.begin,
        "start_position": state.position,
        "start_quaternion": state.quaternion,
        "start_linear_velocity": state.linear_velocity,
        "start_angular_velocity": state.angular_velocity,
        "goal_position": state.goal_position,
        "goal_quaternion": state.goal_quaternion,
        **_of_channels(channels),
    }


def _of_channels(channels: Channels | None) -> dict[str, Number]:
    """The same of what follows the phase; arrays without numbers, if nothing does."""
    if channels is None:
        arrays = ("centers", "widths", "weights", "trend", "least", "most")
        none = dict.fromkeys((f"channel_{name}" for name in arrays), np.zeros(0))
        return {"channels": 0, "channel_functions": 0, **none, "channel_begin": 0.0}
    return {
        "channels": len(channels.names),
        "channel_functions": channels.basis.count,
        "channel_centers": channels.basis.centers,
        "channel_widths": channels.basis.widths,
        "channel_weights": channels.weights.ravel(),
        "channel_trend": channels.trend.ravel(),
        "channel_least": channels.least,
        "channel_most": channels.most,
        "channel_begin": channels.begin,
    }


def _fields(law: Law) -> list[Field]:
    """Those of the struct; C knows no empty arrays."""
    return [field for field in layouts(law.space).primitive if field.size or not field.shape]


class Struct:
    """``noslip_primitive`` in this process's memory.

    Attributes
    ----------
    address, size : int
    """

    def __init__(self, law: Law, rule: Rule) -> None:
        fields: list[tuple[str, Any]] = []
        values: dict[str, Any] = {}
        # What pointers point to must live as long as the struct.
        self._kept: list[Floats] = []
        given = numbers(law, rule)
        for field in _fields(law):
            value = given[field.name]
            if field.kind == "array":
                array = np.array(value, dtype=np.float64, order="C")
                self._kept.append(array)
                fields.append((field.name, ctypes.c_void_p))
                values[field.name] = array.ctypes.data
            elif field.kind == "int":
                fields.append((field.name, ctypes.c_int))
                values[field.name] = value
            elif field.shape:
                fields.append((field.name, ctypes.c_double * field.size))
                values[field.name] = tuple(np.asarray(value, dtype=float).ravel().tolist())
            else:
                fields.append((field.name, ctypes.c_double))
                values[field.name] = float(np.asarray(value, dtype=float))
        layout = type("noslip_primitive", (ctypes.Structure,), {"_fields_": fields})
        self._struct = layout(**values)
        self.address, self.size = ctypes.addressof(self._struct), ctypes.sizeof(self._struct)


def text(law: Law, rule: Rule, name: str, channels: Channels | None = None) -> str:
    """A C file with the numbers of a primitive, as ``const noslip_primitive name``."""
    arrays, values = [], []
    given = numbers(law, rule, channels)
    for field in _fields(law):
        value = given[field.name]
        if field.kind == "array":
            if not np.size(value):
                # What is not named is null in C.
                continue
            arrays.append(_array(field.name, np.asarray(value)))
            shown = field.name
        elif field.kind == "int":
            shown = str(value)
        else:
            shown = _list(value) if field.shape else _number(float(value))
        values.append(f"    .{field.name} = {shown}")
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
