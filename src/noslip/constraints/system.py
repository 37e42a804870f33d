"""Several constraints as one stacked system, in the forms that the projections need."""

from __future__ import annotations

from collections import Counter, OrderedDict
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from functools import cached_property, lru_cache
from itertools import compress
from threading import RLock
from typing import Any, TypeVar
from weakref import WeakValueDictionary

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from noslip import _arguments
from noslip._instants import seconds
from noslip._typing import Expression, Floats
from noslip._values import LONGEST_REPR, shortened
from noslip.constraints.declaration import (
    CATALOG,
    Constraint,
    Level,
    constraint_function,
    declared,
    names_of_rows,
    require_size,
    row_units,
)
from noslip.constraints.undefined import Watch
from noslip.errors import ConstraintError, InputError
from noslip.rotations import quaternion_product, rotation_matrix
from noslip.space import POSE, Space, Twisted

T = TypeVar("T")

MOST_SYSTEMS = 64
"""Kept though no system of theirs lives: more than a program uses in turn; one takes some 100 kB to
10 MB."""
MOST_OWNED = 64
"""Of one system: its own five graphs, and steps and stages in a dozen metrics and forms."""


class ConstraintSystem:
    """Constraints stacked row by row, in the order given.

    Equal to another of the same constraints in the same order; both share their graphs, and what
    else is kept with :meth:`owned`.

    The residual of an inequality is its margin.  Projections treat :attr:`equalities` and
    :attr:`limits` apart; checks and figures take all rows together.

    Parameters
    ----------
    constraints : Constraint or iterable of them
        May be empty.
    space : Space
        What moves; a pose by default.  Positions, quaternions and velocities of the methods have
        its n, 4 b, n and 3 b numbers.

    Attributes
    ----------
    constraints : tuple of Constraint
    names : tuple of str
        One a constraint; equal ones are numbered.
    rows : tuple of int
        Number of rows of each constraint.

    Raises
    ------
    ConstraintError
        If one is not a constraint, or its declaration is wrong; the message names it.
    """

    def __init__(
        self, constraints: Constraint | Iterable[Constraint] = (), space: Space = POSE
    ) -> None:
        self.space = space
        kept, rows, operations = [], 0, 0
        # One after the other, so that of too many the last are never even read.
        for each in each_of(constraints):
            constraint = each.in_space(space)
            _require_seen(constraint, space)
            function = constraint_function(constraint)
            rows, operations = rows + function.size1_out(0), operations + function.n_instructions()
            kept.append(constraint)
            require_size(f"together, {len(kept)} constraints have", rows, operations)
        self.constraints: tuple[Constraint, ...] = tuple(kept)
        self.names = _numbered([c.name for c in self.constraints])
        self._own()

    def _own(self) -> None:
        self.rows: tuple[int, ...] = tuple(
            constraint_function(c).size1_out(0) for c in self.constraints
        )
        self._identity = tuple(map(declared, self.constraints)), self.names, self.space
        self._hash = hash(self._identity)
        self._graphs = _graphs(self._identity)

    def __repr__(self) -> str:
        return shortened(f"ConstraintSystem({', '.join(self.names)})", LONGEST_REPR)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, ConstraintSystem):
            return NotImplemented
        return self._hash == other._hash and self._identity == other._identity

    def __hash__(self) -> int:
        return self._hash

    def __reduce__(self) -> Any:
        return _named, (self.constraints, self.names, self.space)

    def owned(self, key: Hashable, build: Callable[[], T]) -> T:
        """Return what is kept under a key for all systems that declare the same.

        Parameters
        ----------
        key : hashable
            Names what is kept, and all that it depends on besides the constraints.
        build : callable
            Called without arguments if there is nothing yet, or no longer; by one thread at a time.
        """
        found: T = self._graphs.get(key, build)
        return found

    @cached_property
    def equalities(self) -> ConstraintSystem:
        """Those of the constraints that must be zero."""
        return self.part([c.relation == "zero" for c in self.constraints])

    @cached_property
    def limits(self) -> ConstraintSystem:
        """Those of the constraints that must not be negative."""
        return self.part([c.relation == "nonnegative" for c in self.constraints])

    @cached_property
    def of_poses(self) -> ConstraintSystem:
        """Those of the constraints that are declared of the pose."""
        return self.part([c.level == "position" for c in self.constraints])

    def part(self, chosen: Sequence[bool]) -> ConstraintSystem:
        """Return those of the constraints that are chosen; they keep their names."""
        if all(chosen):
            return self
        constraints = tuple(compress(self.constraints, chosen))
        names = tuple(compress(self.names, chosen))
        return self.owned(("part", *chosen), lambda: _named(constraints, names, self.space))

    @property
    def edged(self) -> Constraint | None:
        """The constraint that says where the tool's edge is, and what moves under it.

        The first with a lateral axis, else the first with an axis of travel.
        """
        named = [c for c in self.constraints if c.edge is not None]
        return next((c for c in named if c.edge and c.edge.lateral), named[0] if named else None)

    @property
    def size(self) -> int:
        """Number of rows, all constraints together."""
        return sum(self.rows)

    def per_row(self, values: Iterable[T]) -> list[T]:
        """Repeat a value of each constraint for each of its rows."""
        return [value for value, rows in zip(values, self.rows, strict=True) for _ in range(rows)]

    @cached_property
    def row_levels(self) -> list[Level]:
        """For each row, the level at which its constraint is declared."""
        return self.per_row(c.level for c in self.constraints)

    @cached_property
    def row_radii(self) -> list[float]:
        """For each row, the radius of the ball that it is; 0 where it is none."""
        both = zip(self.constraints, self.rows, strict=True)
        return [radius for c, rows in both for radius in c.radii or (0.0,) * rows]

    @cached_property
    def row_is_velocity(self) -> NDArray[np.bool_]:
        """For each row, whether it stems from a velocity-level constraint."""
        return np.array([level == "velocity" for level in self.row_levels], dtype=bool)

    @cached_property
    def row_is_limit(self) -> NDArray[np.bool_]:
        """For each row, whether it is an inequality."""
        return np.array(self.per_row(c.relation != "zero" for c in self.constraints), dtype=bool)

    @cached_property
    def row_units(self) -> list[str]:
        """For each row, the unit of its residual."""
        return [unit for constraint in self.constraints for unit in row_units(constraint)]

    @cached_property
    def row_names(self) -> list[str]:
        """For each row, the constraint's name, and which row of several it is."""
        of_each = zip(self.constraints, self.rows, self.names, strict=True)
        return [row for each in of_each for row in names_of_rows(*each)]

    @property
    def function(self) -> Any:
        """CasADi function (t, p, q, v, w, a, alpha) -> stacked residual."""
        return self.owned("residual", self._residual)

    def _residual(self) -> Any:
        t, p, q, v, w = self._symbols()
        a, alpha = ca.SX.sym("a", self.space.linear), ca.SX.sym("alpha", self.space.angular)
        bodies = self.space.bodies_at(p, q, v, w, a, alpha)
        stacked = self.of_bodies(t, bodies, p, v, a)
        return ca.Function("residual", [t, p, q, v, w, a, alpha], [stacked])

    def of_bodies(
        self,
        t: Expression,
        bodies: Sequence[Twisted],
        coordinates: Expression,
        rates: Expression,
        accelerations: Expression = 0,
    ) -> Expression:
        """Stacked residual of bodies, and of the coordinates where it is declared of these."""
        column = [ca.SX(0, 1)]
        for constraint in self.constraints:
            function = constraint_function(constraint)
            if constraint.coordinates:
                column.append(function(t, coordinates, rates, accelerations))
                continue
            body = bodies[self.space.body(constraint.body)]
            R = rotation_matrix(body.quaternion)
            pushed = body.linear_acceleration, body.angular_acceleration
            column.append(function(t, body.position, R, body.linear, body.angular, *pushed))
        return ca.vertcat(*column)

    def residual(
        self,
        t: Expression,
        p: Expression,
        q: Expression,
        v: Expression,
        w: Expression,
        a: Expression = 0,
        alpha: Expression = 0,
    ) -> Expression:
        """Stacked residual as an expression of other expressions."""
        return self.function(t, p, q, v, w, a, alpha)

    def residuals(
        self,
        times: ArrayLike,
        positions: ArrayLike,
        quaternions: ArrayLike,
        linear_velocities: ArrayLike,
        angular_velocities: ArrayLike,
        linear_accelerations: ArrayLike | None = None,
        angular_accelerations: ArrayLike | None = None,
    ) -> Floats:
        """Residuals of many instants, shape (N, m); arguments have time first."""
        return self._mapped(
            "residual",
            self.function,
            times,
            positions,
            quaternions,
            linear_velocities,
            angular_velocities,
            linear_accelerations,
            angular_accelerations,
        )

    def _mapped(
        self, key: str, function: ca.Function, times: ArrayLike, *given: ArrayLike | None
    ) -> Floats:
        """Residuals at many instants or steps; what is not given is zero."""
        count = np.size(times)
        if self.size == 0:
            return np.zeros((count, 0))
        sizes = map(function.size1_in, range(function.n_in()))
        arguments = [
            np.zeros((size, count))
            if a is None
            else np.asarray(a, dtype=np.float64).reshape(count, size).T
            for a, size in zip((times, *given), sizes, strict=True)
        ]
        residuals = np.array(function.map(count)(*arguments)).T.reshape(count, self.size)
        counted = "step" if key == "of step" else "sample"
        self._require_defined(key, function, residuals, np.ravel(times), arguments, counted)
        return residuals

    @property
    def has_angles(self) -> bool:
        """Whether a rule takes an angle, which is undefined where computers say 0."""
        watch: Watch = self.owned(("residual", "watch"), lambda: Watch(self.function))
        return watch.has_angles

    def _require_defined(
        self,
        key: str,
        function: ca.Function,
        values: Floats,
        times: Floats,
        arguments: Sequence[ArrayLike],
        counted: str = "",
    ) -> None:
        """Refuse values, shape (N, m or more), that are no numbers; say where, and by what.

        Beyond the first m, they are derivatives.
        """
        undefined = ~np.isfinite(values)
        watch: Watch = self.owned((key, "watch"), lambda: Watch(function))
        if not (undefined.any() or watch.has_angles):
            return
        found = watch.first(*arguments)
        if found is None and not undefined.any():
            return
        at, entry = (int(k) for k in (found or np.argwhere(undefined)[0])[:2])
        what = found[2] if found else "it"
        row = (
            entry if entry < 2 * self.size else (entry - 2 * self.size) // self.space.velocity_size
        )
        name = self.row_names[row % self.size]
        verb = "is" if entry < self.size else "has a slope of"
        where = seconds(times[at], times[0]) + (f" ({counted} {at})" if counted else "")
        value = values[at, entry] if undefined[at, entry] else np.nan
        raise ConstraintError(
            f"constraint {name!r} {verb} {value} at {where}: {what} is undefined; write it such "
            "that it is a number wherever the tool may be, also at rest, as in sqrt(x + 1e-12)"
        )

    def require_slopes(
        self,
        times: ArrayLike,
        positions: ArrayLike,
        quaternions: ArrayLike,
        linear_velocities: ArrayLike,
        angular_velocities: ArrayLike,
        counted: str = "",
    ) -> None:
        """Refuse instants, of shape (N, ...), at which a residual or its derivative is no number.

        Parameters
        ----------
        counted : str
            What the instants are counted as, such as "step".
        """
        parts = (positions, quaternions, linear_velocities, angular_velocities)
        given = np.column_stack([np.ravel(times), *parts]).T
        function = self.owned("instant", self._instant)
        values = np.array(function.map(given.shape[1])(given)).T
        self._require_defined("instant", function, values, given[0], [given], counted)

    def of_step(
        self,
        t: Expression,
        h: Expression,
        p: Expression,
        q: Expression,
        v: Expression,
        w: Expression,
        a: Expression = None,
        alpha: Expression = None,
    ) -> Expression:
        """Residual of the step of length h from (t, p, q) at constant velocities v, w.

        Rows at velocity level are those of the step's middle, ``p + h v / 2``, ``Exp(h w / 2) R``,
        which is second order and symmetric in time; rows at position level those of its end.
        """
        still = ca.SX(self.space.linear, 1), ca.SX(self.space.angular, 1)
        a, alpha = still[0] if a is None else a, still[1] if alpha is None else alpha
        middles, ends = self.space.bodies_of_step(h, p, q, v, w, a, alpha)
        return self.by_level(
            self.of_bodies(t + h / 2, middles, p + h / 2 * v, v, a),
            self.of_bodies(t + h, ends, p + h * v, v, a),
        )

    def by_level(self, middle: Expression, end: Expression) -> Expression:
        """Of residuals in the middle and at the end of a step, row by row those that are asked."""
        levels = enumerate(self.row_levels)
        rows = [(end if level == "position" else middle)[i] for i, level in levels]
        return ca.vertcat(ca.SX(0, 1), *rows)

    def _step_residual(self) -> Any:
        t, p, q, v, w = self._symbols()
        h, a = ca.SX.sym("h"), ca.SX.sym("a", self.space.linear)
        alpha = ca.SX.sym("alpha", self.space.angular)
        arguments = [t, h, p, q, v, w, a, alpha]
        return ca.Function("of_step", arguments, [ca.cse(self.of_step(*arguments))])

    def of_steps(
        self,
        times: ArrayLike,
        positions: ArrayLike,
        quaternions: ArrayLike,
        linear_velocities: ArrayLike,
        angular_velocities: ArrayLike,
        linear_accelerations: ArrayLike | None = None,
        angular_accelerations: ArrayLike | None = None,
    ) -> Floats:
        """Residuals of the N - 1 steps between N samples, as :meth:`of_step`, shape (N - 1, m).

        Parameters
        ----------
        times, positions, quaternions : array, shape (N, ...)
            Of the samples (s, m, w first).
        linear_velocities, angular_velocities : array, shape (N - 1, 3)
            Of the steps.
        linear_accelerations, angular_accelerations : array, shape (N - 1, 3), optional
        """
        times = np.asarray(times, dtype=np.float64)
        return self._mapped(
            "of step",
            self.owned("of step", self._step_residual),
            times[:-1],
            np.diff(times),
            np.asarray(positions)[:-1],
            np.asarray(quaternions)[:-1],
            linear_velocities,
            angular_velocities,
            linear_accelerations,
            angular_accelerations,
        )

    def _first_order(self) -> Any:
        state = self._symbols()
        value = self.residual(*state)
        rate = self._time_derivative(value, *state)
        rows = [
            rate[i] if level == "position" else value[i] for i, level in enumerate(self.row_levels)
        ]
        return ca.Function("first_order", [*state], [ca.vertcat(ca.SX(0, 1), *rows)])

    def first_order(
        self, t: Expression, p: Expression, q: Expression, v: Expression, w: Expression
    ) -> Expression:
        """Rows as conditions on velocities: phi itself, and d psi/dt for position level."""
        return self.owned("first order", self._first_order)(t, p, q, v, w)

    def _instant(self) -> Any:
        state = self._symbols()
        phi = self.first_order(*state)
        rows = ca.jacobian(phi, ca.vertcat(*state[3:]))
        outputs = ca.vertcat(self.residual(*state), phi, ca.vec(rows.T))
        given = ca.vertcat(*state)
        return ca.Function("instant", [given], [ca.cse(ca.densify(outputs))])

    def instant(
        self,
        time: float,
        position: ArrayLike,
        quaternion: ArrayLike,
        linear_velocity: ArrayLike,
        angular_velocity: ArrayLike,
    ) -> tuple[Floats, Floats, Floats]:
        """Residual, its rows as conditions on velocities (phi, or d psi/dt), and their Jacobian.

        Returns
        -------
        residual, phi : array, shape (m,)
        jacobian : array, shape (m, 6)
            Of phi with respect to linear, then angular velocity.
        """
        size, space = self.size, self.space
        given = np.empty(1 + space.point_size + space.velocity_size)
        found = np.empty((2 + space.velocity_size) * size)
        end = 1 + space.linear, 1 + space.point_size, 1 + space.point_size + space.linear
        given[0], given[1 : end[0]], given[end[0] : end[1]] = time, position, quaternion
        given[end[1] : end[2]], given[end[2] :] = linear_velocity, angular_velocity
        if size:
            # Read and written in place: a call that converts takes ten times as long.
            buffer, evaluate = self.owned("instant", self._instant).buffer()
            buffer.set_arg(0, given.data)
            buffer.set_res(0, found.data)
            evaluate()
            if not np.isfinite(found[:size]).all():
                function = self.owned("instant", self._instant)
                self._require_defined("instant", function, found[None], given[:1], [given[:, None]])
        return (
            found[:size],
            found[size : 2 * size],
            found[2 * size :].reshape(size, space.velocity_size),
        )

    def rows_at(self, instants: Floats) -> Floats:
        """Jacobians that :meth:`instant` finds, of many instants at once, shape (N, m, 6).

        Parameters
        ----------
        instants : array, shape (N, 14)
            Time, position, quaternion, linear and angular velocity.
        """
        function = self.owned("instant", self._instant).map(len(instants))
        rows = np.array(function(instants.T)).T[:, 2 * self.size :]
        return rows.reshape(-1, self.size, self.space.velocity_size)

    def _acceleration_form(self) -> Any:
        if "acceleration" in self.row_levels:
            raise ConstraintError("limits of accelerations have no form A a = b; leave them out")
        t, p, q, v, w = state = self._symbols()
        kappa, zeta = ca.SX.sym("kappa"), ca.SX.sym("zeta")
        value = self.residual(*state)
        phi = self.first_order(*state)
        drift = self._time_derivative(phi, *state)
        A = ca.jacobian(phi, ca.vertcat(v, w))
        pull = [
            kappa * value[i] if is_velocity else 2 * zeta * kappa * phi[i] + kappa**2 * value[i]
            for i, is_velocity in enumerate(self.row_is_velocity)
        ]
        b = -drift - ca.vertcat(ca.SX(0, 1), *pull)
        return ca.Function("acceleration_form", [t, p, q, v, w, kappa, zeta], [ca.densify(A), b])

    def acceleration_form(
        self,
        time: float,
        position: ArrayLike,
        quaternion: ArrayLike,
        linear_velocity: ArrayLike,
        angular_velocity: ArrayLike,
        *,
        stabilization: float = 0.0,
        damping_ratio: float = 1.0,
    ) -> tuple[Floats, Floats]:
        """A and b of the Udwadia-Kalaba form ``A a = b`` (the paper's eq. 13).

        ``b = -d(phi)/dt at a = 0, - kappa phi`` at velocity level, and
        ``- 2 zeta kappa d(psi)/dt - kappa^2 psi`` at position level (Baumgarte).

        Parameters
        ----------
        stabilization : float
            kappa (1/s): how fast a violation decays; 0 leaves it.
        damping_ratio : float
            zeta, position level only.

        Returns
        -------
        A : array, shape (m, 6)
            Columns: linear, then angular acceleration, world frame.
        b : array, shape (m,)
        """
        A, b = self.owned("acceleration form", self._acceleration_form)(
            time,
            position,
            quaternion,
            linear_velocity,
            angular_velocity,
            stabilization,
            damping_ratio,
        )
        return np.array(A).reshape(self.size, self.space.velocity_size), np.array(b).reshape(
            self.size
        )

    def _symbols(self) -> tuple[Expression, ...]:
        space = self.space
        sizes = 1, space.linear, 4 * space.rotations, space.linear, space.angular
        return tuple(ca.SX.sym(name, size) for name, size in zip("tpqvw", sizes, strict=True))

    def _time_derivative(
        self,
        value: Expression,
        t: Expression,
        p: Expression,
        q: Expression,
        v: Expression,
        w: Expression,
    ) -> Expression:
        """d/dt of an expression along the motion, with all accelerations zero."""

        def rate(w: Expression, q: Expression) -> Expression:
            return 0.5 * quaternion_product(ca.vertcat(0, w), q)

        along = ca.vertcat(1, v, self.space.each(rate, w, q))
        return ca.jtimes(value, ca.vertcat(t, p, q), along)


class _Graphs:
    """What is dear to build from a declaration, the most recently used."""

    def __init__(self) -> None:
        self._kept: OrderedDict[Hashable, Any] = OrderedDict()
        # Building one thing may ask for another.
        self._lock = RLock()

    def get(self, key: Hashable, build: Callable[[], Any]) -> Any:
        with self._lock:
            if key not in self._kept:
                self._kept[key] = build()
                while len(self._kept) > MOST_OWNED:
                    self._kept.popitem(last=False)
            self._kept.move_to_end(key)
            return self._kept[key]


_living: WeakValueDictionary[Hashable, _Graphs] = WeakValueDictionary()
_living_lock = RLock()


def _graphs(identity: Hashable) -> _Graphs:
    """The graphs of a declaration: one object while a system of it lives, and some time beyond."""
    with _living_lock:
        return _recent(_living.setdefault(identity, _Graphs()))


@lru_cache(maxsize=MOST_SYSTEMS)
def _recent(graphs: _Graphs) -> _Graphs:
    return graphs


def _named(
    constraints: tuple[Constraint, ...], names: tuple[str, ...], space: Space
) -> ConstraintSystem:
    """Part of a system, whose constraints keep the names that they have there."""
    system = ConstraintSystem.__new__(ConstraintSystem)
    system.constraints, system.names, system.space = constraints, names, space
    system._own()
    return system


def each_of(constraints: Constraint | Iterable[Constraint]) -> Iterator[Constraint]:
    """Yield constraints, one or several; refuse what is none."""
    several = isinstance(constraints, Iterable) and not isinstance(constraints, (type, str))
    for constraint in constraints if several else (constraints,):  # type: ignore[union-attr]
        if not isinstance(constraint, Constraint):
            raise ConstraintError(
                f"expected a constraint, got {_arguments.short(constraint)}{_remedy(constraint)}"
            )
        yield constraint


def _remedy(given: object) -> str:
    """Say how to make a constraint of what is none, where that is known."""
    kind = CATALOG.get(given) if isinstance(given, str) else given
    if isinstance(kind, type) and issubclass(kind, Constraint):
        return f"; call it: {kind.__name__}()"
    return "; declare it first, as with @velocity_constraint" if callable(given) else ""


def as_system(
    constraints: ConstraintSystem | Constraint | Sequence[Constraint], space: Space | None = None
) -> ConstraintSystem:
    """Return the constraints as a system of a space, a pose's by default; a system passes."""
    if isinstance(constraints, ConstraintSystem):
        if space not in (None, constraints.space):
            raise InputError("these constraints are a system of another space; give them alone")
        return constraints
    return ConstraintSystem(constraints, space or POSE)


def _require_seen(constraint: Constraint, space: Space) -> None:
    """Refuse a constraint that a space has nothing for."""
    if constraint.coordinates:
        if constraint.coordinates != space.linear:
            raise ConstraintError(
                f"constraint {constraint.name!r} is declared of {constraint.coordinates} "
                f"coordinates, but what moves has {space.linear}"
            )
        return
    try:
        space.body(constraint.body)
    except InputError as error:
        raise ConstraintError(f"constraint {constraint.name!r}: {error}") from None


def _numbered(names: Sequence[str]) -> tuple[str, ...]:
    """Names, those that occur more than once with their number from the second on."""
    seen: Counter[str] = Counter()
    numbered = []
    for name in names:
        seen[name] += 1
        numbered.append(name if seen[name] == 1 else f"{name} {seen[name]}")
    return tuple(numbered)
