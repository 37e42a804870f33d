"""Where a rule is undefined: 0 / 0 at rest, the angle of no direction, a negative root."""

from __future__ import annotations

from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from noslip._typing import Floats
from noslip.constraints.expression import Instructions
from noslip.errors import ConstraintError

_SIGNS = {"ADD": "+", "SUB": "-", "MUL": "*", "DIV": "/", "POW": "**", "CONSTPOW": "**"}


_NO_DIRECTION = 1e-9
"""Length of a vector (m/s, m or 1) whose direction is rounding: splines leave 1e-12 m/s of a tool
at rest."""


class _Graph(NamedTuple):
    """Functions of the same arguments, of the outputs and of all operations' results; what each
    operation is called and works on, by number; which of them are outputs.
    """

    outputs: Any
    results: Any
    names: list[str]
    operands: list[list[int]]
    ends: list[int]

    def blamed(self, values: Floats, at: int) -> str:
        """The operation on numbers that gave none, on the way back from a result."""
        while worse := [k for k in self.operands[at] if not np.isfinite(values[k])]:
            at = worse[0]
        # Not -0.
        operands = [f"{values[k] + 0.0:.3g}" for k in self.operands[at]]
        sign = _SIGNS.get(self.names[at])
        call = f"{self.names[at].lower()}({', '.join(operands)})"
        return f" {sign} ".join(operands) if sign else call


class Watch:
    """A function's operations, to be asked which of them gives no number.

    ``atan2(0, 0)`` is none here, though computers say 0, and what is as near to it as rounding.

    Parameters
    ----------
    function : casadi.Function
        With one output.
    """

    def __init__(self, function: Any) -> None:
        try:
            self._steps = Instructions.of(function).steps
        except ConstraintError:
            # More than arithmetic: nothing can be told of it.
            self._steps = ()
        self.has_angles = any(name == "ATAN2" for name, *_ in self._steps)
        self._sizes = [function.numel_in(i) for i in range(function.n_in())]

    @cached_property
    def _graph(self) -> _Graph:
        symbols = [ca.SX.sym("x", size) for size in self._sizes]
        results: list[Any] = []
        names: list[str] = []
        inputs: list[list[int]] = []
        held: dict[int, int] = {}
        rows: dict[int, int] = {}
        for name, place, *given in self._steps:
            if name == "OUTPUT":
                rows[place] = held[given[0]]
                continue
            operands: list[int] = []
            if name == "CONST":
                result = ca.SX(float(given[0]))
            elif name == "INPUT":
                result = symbols[given[0]][given[1]]
            else:
                operands = [held[k] for k in given]
                parts = [results[k] for k in operands]
                result = Instructions.applied(name, parts)
                if name == "ATAN2":
                    directed = ca.sumsqr(ca.vertcat(*parts)) > _NO_DIRECTION**2
                    result = ca.if_else(directed, result, np.nan)
            held[place] = len(results)
            results.append(result)
            names.append(name)
            inputs.append(operands)
        ends = [rows[row] for row in range(len(rows))]
        outputs, all_results = (
            ca.Function("watch", symbols, [ca.vertcat(*column)])
            for column in ([results[end] for end in ends], results)
        )
        return _Graph(outputs, all_results, names, inputs, ends)

    def first(self, *arguments: ArrayLike) -> tuple[int, int, str] | None:
        """Find the first instant at which an output is no number.

        Parameters
        ----------
        arguments : arrays, shape (size, N)

        Returns
        -------
        instant, row, what : int, int, str
            The operation that is to blame, as in "0 / 0".
        """
        if not self._steps:
            return None
        columns = [np.atleast_2d(np.asarray(a, dtype=np.float64)) for a in arguments]
        graph = self._graph
        found = np.array(graph.outputs.map(columns[0].shape[1])(*columns)).T
        if np.isfinite(found).all():
            return None
        instant, row = (int(k) for k in np.argwhere(~np.isfinite(found))[0])
        values = np.array(graph.results(*(column[:, instant] for column in columns))).ravel()
        return instant, row, graph.blamed(values, graph.ends[row])
