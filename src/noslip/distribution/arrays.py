"""Expression graphs evaluated on arrays: each operation once for many instants.

CasADi's virtual machine takes an instant at a time, some 4 ns an operation.  NumPy does one
operation for a thousand instants at a time, in less than 1 ns each.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import casadi as ca
import numpy as np

from noslip._typing import Floats

CHUNK = 2048
"""Instants of one pass: all numbers of a graph then stay in the cache."""


def in_cache(count: int, several: int) -> Iterator[slice]:
    """Rows of arrays, shape (N, S), of which all numbers of an evaluation stay in the cache."""
    rows = max(1, CHUNK // max(1, several))
    for first in range(0, count, rows):
        yield slice(first, min(first + rows, count))


def _if_else_zero(condition: Floats, value: Floats, out: Floats) -> None:
    out[:] = np.where(condition != 0, value, 0.0)


def _twice(value: Floats, out: Floats) -> None:
    np.add(value, value, out=out)


_OPERATIONS: dict[int, Callable[..., Any]] = {
    ca.OP_ASSIGN: np.positive,
    ca.OP_ADD: np.add,
    ca.OP_SUB: np.subtract,
    ca.OP_MUL: np.multiply,
    ca.OP_DIV: np.divide,
    ca.OP_NEG: np.negative,
    ca.OP_SQ: np.square,
    ca.OP_TWICE: _twice,
    ca.OP_INV: np.reciprocal,
    ca.OP_SQRT: np.sqrt,
    ca.OP_EXP: np.exp,
    ca.OP_LOG: np.log,
    ca.OP_POW: np.power,
    ca.OP_CONSTPOW: np.power,
    ca.OP_SIN: np.sin,
    ca.OP_COS: np.cos,
    ca.OP_TAN: np.tan,
    ca.OP_ASIN: np.arcsin,
    ca.OP_ACOS: np.arccos,
    ca.OP_ATAN: np.arctan,
    ca.OP_ATAN2: np.arctan2,
    ca.OP_TANH: np.tanh,
    ca.OP_FABS: np.abs,
    ca.OP_SIGN: np.sign,
    ca.OP_FMIN: np.fmin,
    ca.OP_FMAX: np.fmax,
    ca.OP_LT: np.less,
    ca.OP_LE: np.less_equal,
    ca.OP_EQ: np.equal,
    ca.OP_NE: np.not_equal,
    ca.OP_NOT: np.logical_not,
    ca.OP_AND: np.logical_and,
    ca.OP_OR: np.logical_or,
    ca.OP_IF_ELSE_ZERO: _if_else_zero,
}
"""What constraints are made of; a graph with anything else is left to the virtual machine."""


class OnArrays:
    """A function of numbers, evaluated on arrays.

    Parameters
    ----------
    function : casadi.Function
        Of SX, with one input and one dense output.
    """

    def __init__(self, function: ca.Function) -> None:
        self._function, self._width = function, function.numel_out(0)
        self._steps = []
        for k in range(function.n_instructions()):
            operation, inputs = function.instruction_id(k), function.instruction_input(k)
            outputs = function.instruction_output(k)
            constant = function.instruction_constant(k) if operation == ca.OP_CONST else 0.0
            self._steps.append((operation, inputs, outputs, constant))
        known = {ca.OP_CONST, ca.OP_INPUT, ca.OP_OUTPUT, *_OPERATIONS}
        self._is_known = all(operation in known for operation, *_ in self._steps)

    def __call__(self, given: Sequence[Floats | float]) -> Floats:
        """Evaluate for inputs that broadcast to shape (N, S); of the result, (N, outputs, S)."""
        arrays = np.broadcast_arrays(*given)
        count, several = arrays[0].shape
        if not self._is_known:
            columns = np.stack([a.ravel() for a in arrays])
            mapped = np.array(self._function.map(columns.shape[1])(columns))
            return mapped.reshape(self._width, count, several).swapaxes(0, 1)
        found = np.zeros((count, self._width, several))
        with np.errstate(all="ignore"):
            for rows in in_cache(count, several):
                self._run([a[rows] for a in arrays], found[rows])
        return found

    def _run(self, given: Sequence[Floats], found: Floats) -> None:
        work = np.empty((self._function.sz_w(), len(found), found.shape[2]))
        for operation, inputs, outputs, constant in self._steps:
            if operation == ca.OP_INPUT:
                work[outputs[0]] = given[inputs[1]]
            elif operation == ca.OP_OUTPUT:
                found[:, outputs[1]] = work[inputs[0]]
            elif operation == ca.OP_CONST:
                work[outputs[0]] = constant
            else:
                _OPERATIONS[operation](*(work[i] for i in inputs), out=work[outputs[0]])
