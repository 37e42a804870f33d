"""What carries a state over steps: one graph for each system and metric, shared by all."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca

from noslip._typing import Floats
from noslip.codegen.library import Library, Native
from noslip.constraints.system import ConstraintSystem
from noslip.law.layout import layouts
from noslip.law.step import step_function
from noslip.projection.pointwise import Push, coupling, position_only, without_limits
from noslip.rule import Rule


def stepper_of(rule: Rule) -> Stepper:
    """Return the stepper of a rule; built once for all that are alike."""
    system = rule.system
    # Nothing gives way where nothing is held.
    alike: tuple[tuple[float, ...], Push] = (rule.inverse_metric, rule.push)
    if not system.size:
        alike = (position_only(system.space), "force")
    return system.owned(("stepper", *alike), lambda: Stepper(system, *alike))


class Stepper:
    """The step under constraints, as a graph and, once it is compiled, as machine code.

    Parameters
    ----------
    system : ConstraintSystem
        What its steps hold; may be empty.
    inverse_metric : tuple of floats
    push : "force" or "steering"
        See :mod:`noslip.projection.pointwise`.
    """

    def __init__(
        self, system: ConstraintSystem, inverse_metric: tuple[float, ...], push: Push
    ) -> None:
        places = layouts(system.space)
        self.carried, self.outputs = places.carried(system.size), places.output(system.size)
        held, alone = None, None
        if system.size:
            held = coupling(system, inverse_metric=inverse_metric, push=push)
        if system.limits.size:
            alone = without_limits(system, inverse_metric=inverse_metric, push=push)
        self.function = step_function(held, system.size, alone, system.space)
        self._accumulated = lru_cache(maxsize=8)(self._accumulate)
        self.native = Native(lambda: Library.of(self.function, system.size, system.space))
        self._runs = 0

    def _accumulate(self, count: int) -> ca.Function:
        return self.function if count == 1 else self.function.mapaccum(count)

    def run(self, state: Floats, table: Floats, states: Floats, outputs: Floats) -> None:
        """Carry a state over the table's steps.

        Parameters
        ----------
        state, table, states, outputs : array, shape (...,), (count, ...) each
            States and outputs are written to: after each step.  Columns as
            :class:`noslip.law.layout.Layouts` says: carried, step, carried, output.  All arrays are
            contiguous.
        """
        count = len(table)
        # What was learned is rolled out twice to verify it; whoever runs it twice will do so often.
        self._runs += count > 1
        if self._runs == 4:
            self.native.begin()
        if (library := self.native.library) is not None:
            library.run(*(a.ctypes.data for a in (state, table, states, outputs)), count)
            return
        # CasADi reads and writes these arrays in place: a call that converts costs 80 us.
        buffer, evaluate = self._accumulated(count).buffer()
        buffer.set_arg(0, state.data)
        buffer.set_arg(1, table.data)
        buffer.set_res(0, states.data)
        buffer.set_res(1, outputs.data)
        evaluate()
