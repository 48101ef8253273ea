r"""Variational equations: derivatives of accelerations, multipliers and impacts.

With the state (q, u) and the data p along a direction as dual numbers (:mod:`.dual`), the
functions of :mod:`..equations` give mass matrix, forces and constraints with their derivatives,
whatever the mechanism is made of. The accelerations follow by the implicit function theorem: of

    M a - G^T lam = f,        G a = g

the derivative is the same matrix with the right-hand side df - dM a + dG^T lam, dg - dG a. An
impact (the mass matrix and the constraints of the stops that take part, f = M u-, g = -e G u- of
those and 0 of the loops) has the same form.

The data are the coefficients of points, angles and masses that :mod:`...models.kinematics` makes of
a mechanism's numbers. In each number they are polynomials of degree two at most, or, in the angle
of a weld or rail, of degree one and sine and cosine: for both a difference rule of four values is
exact (`_WEIGHTS`).

A *direction* maps names of a mechanism's numbers ("bodies.arm.mass", "start.0", "stops.hanger
rest.limit") to their derivatives with respect to one quantity; numbers it does not name do not
change.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, cast

import numpy as np

from ...models.applied_forces import AppliedForces
from ...models.arrays import FloatArray
from ...models.errors import InputError
from ...models.functions import Phasors, PointCoefficients, ScalarFunction
from ...models.kinematics import initial_state
from ...models.mechanism import Mechanism
from ...models.spec import Spec
from ..equations import Equations, kkt_matrix, least_step
from .dual import Dual, value_of

Direction = Mapping[str, float]
_FITS = 1e-9  # per unit of a direction: how well it must move closed stops and loops along
_STEPS = (-2.0, -1.0, 1.0, 2.0)
# Of the odd parts at one and two steps h = 1: exact for x and for sin x, and 0 for x^2 and cos x.
_WEIGHTS = np.linalg.solve([[2.0, 4.0], [2 * np.sin(1.0), 2 * np.sin(2.0)]], [1.0, 1.0])[
    [1, 0, 0, 1]
] * np.sign(_STEPS)


def numbers(mechanism: Mechanism) -> dict[str, float]:
    """Every number of a mechanism by name, its start speeds included where it rests."""
    return dict(_walk(_with_speeds(mechanism), ""))


def moved(mechanism: Mechanism, direction: Direction, step: float = 1.0) -> Mechanism:
    """The mechanism with its numbers moved along a direction; it is not validated.

    Raises:
        InputError: the direction names a number that the mechanism does not have.
    """
    known = numbers(mechanism)
    for name in direction:
        if name not in known:
            raise InputError(
                f"there is no number {name!r} in {mechanism.name!r}; there is {sorted(known)}."
            )
    return cast("Mechanism", _moved(_with_speeds(mechanism), "", direction, step))


def consistent_direction(mechanism: Mechanism, direction: Direction) -> dict[str, float]:
    """The direction with the least change of the start that keeps its constraints.

    Of a stop whose gap the loops alone fix, the gap changes with the direction, whatever the start.
    Speeds need no
    change: what the constraints take of a change of them is taken at the start
    (:meth:`VariationalEquations.start`).

    Raises:
        InputError: the direction names a number that the mechanism does not have.
    """
    return consistent_directions(mechanism, [direction])[0]


def consistent_directions(
    mechanism: Mechanism, directions: Sequence[Direction]
) -> list[dict[str, float]]:
    """Several of :func:`consistent_direction`."""
    equations, q = VariationalEquations(mechanism, directions), initial_state(mechanism)[0]
    closed = movable(equations, [stop.name for stop in mechanism.stops if stop.closed])
    dq = equations.along_each("start", len(q))
    jacobian = equations.constraint_jacobian(q, closed)
    if len(jacobian):
        residuals = equations.residual_tangents(Dual(q, dq), closed)
        rank = equations.rank(q, closed)
        dq = dq - np.stack(
            [least_step(jacobian, residual, rank) for residual in residuals.T], axis=1
        )
    starts = [{f"start.{i}": float(value) for i, value in enumerate(column)} for column in dq.T]
    return [dict(direction) | start for direction, start in zip(directions, starts, strict=True)]


def movable(equations: Equations, stops: Sequence[str]) -> tuple[str, ...]:
    """Those of some stops whose gaps can change, because the loops alone do not fix them."""
    return tuple(
        name for name in stops if equations.rank_at_start((name,)) > equations.rank_at_start(())
    )


def _with_speeds(mechanism: Mechanism) -> Mechanism:
    speeds = mechanism.start_speeds or (0.0,) * len(mechanism.start)
    return mechanism.model_copy(update={"start_speeds": speeds})


def _parts(value: object) -> Iterator[tuple[str, Any]]:
    """Fields of a description by their names; items of a tuple by theirs, or by number."""
    if isinstance(value, Spec):
        for field in type(value).model_fields:
            yield field, getattr(value, field)
    elif isinstance(value, tuple):
        for i, item in enumerate(cast("tuple[object, ...]", value)):
            yield str(getattr(item, "name", i)), item


def _walk(value: object, path: str) -> Iterator[tuple[str, float]]:
    if isinstance(value, float):
        yield path, value
    for name, part in _parts(value):
        yield from _walk(part, f"{path}.{name}" if path else name)


def _moved(value: object, path: str, direction: Direction, step: float) -> object:
    if isinstance(value, float):
        return value + step * direction.get(path, 0.0)
    parts = {
        name: _moved(part, f"{path}.{name}" if path else name, direction, step)
        for name, part in _parts(value)
    }
    if isinstance(value, Spec):
        return value.model_copy(update=parts)
    return tuple(parts.values()) if isinstance(value, tuple) else value


@dataclass(frozen=True)
class Data:
    """Data of the equations of motion: numbers and arrays, or Duals; symbols as in `Equations`."""

    products: Any
    weights: Any
    inertias: Any
    closures: tuple[ScalarFunction, ...]
    gaps: dict[str, ScalarFunction]
    restitution: dict[str, Any]
    markers: dict[str, PointCoefficients]
    applied: Any
    """Force elements with what they act along: springs, rotational ones and forces."""

    @classmethod
    def of(cls, mechanism: Mechanism) -> Data:
        """Data of a mechanism as numbers."""
        equations = _Open(mechanism)
        kinematics = equations.kinematics
        applied = AppliedForces(kinematics)
        return cls(
            *equations.matrices,
            closures=kinematics.loop_closures,
            gaps=kinematics.gaps,
            restitution={stop.name: stop.restitution for stop in mechanism.stops},
            markers={
                marker.name: kinematics.point(marker.body, marker.point)
                for marker in mechanism.markers
            },
            applied=(applied.springs, applied.rotational, applied.forces),
        )

    @classmethod
    def along(cls, mechanism: Mechanism, directions: Sequence[Direction]) -> Data:
        """Data with the derivatives along directions, where there are any."""
        names = sorted(
            {name for direction in directions for name, value in direction.items() if value}
        )
        names = [name for name in names if not name.startswith(("start.", "start_speeds."))]
        changes = np.array(
            [[direction.get(name, 0.0) for direction in directions] for name in names]
        )
        slopes = [_slopes(mechanism, name) for name in names]

        def dual(value: Any, *derivatives: Any) -> Any:
            tangents = (
                np.tensordot(np.array(derivatives), changes, axes=(0, 0)) if names else np.zeros(1)
            )
            return Dual(value, tangents) if tangents.any() else value

        return _mapped(dual, cls.of(mechanism), *slopes)


class _Open(Equations):
    """Equations that show their matrices."""

    @property
    def matrices(self) -> tuple[Any, Any, Any]:
        """K, the weights and the inertias."""
        return self._products, self._weights, self._inertias


def _slopes(mechanism: Mechanism, name: str) -> Data:
    """Derivatives of the data with respect to one number."""
    value = numbers(mechanism)[name]
    size = 1.0 if name.endswith(".angle") else max(1.0, abs(value))
    values = [Data.of(moved(mechanism, {name: size}, step)) for step in _STEPS]
    return _mapped(lambda *each: np.tensordot(_WEIGHTS / size, np.array(each), axes=1), *values)


def _mapped(function: Callable[..., Any], *values: Any) -> Any:
    """A function of corresponding numbers and arrays of data of one structure, as such data."""
    first = values[0]
    if isinstance(first, float | complex | np.ndarray):
        return function(*values)
    if isinstance(first, tuple):
        return tuple(_mapped(function, *items) for items in zip(*values, strict=True))
    if isinstance(first, dict):
        return {
            key: _mapped(function, *(value[key] for value in values))
            for key in cast("dict[str, Any]", first)
        }
    if isinstance(first, Spec):
        parts = {
            name: [getattr(value, name) for value in values] for name in type(first).model_fields
        }
        return first.model_copy(
            update={name: _mapped(function, *part) for name, part in parts.items()}
        )
    if is_dataclass(first) and not isinstance(first, Phasors):
        parts = {
            field.name: [getattr(value, field.name) for value in values] for field in fields(first)
        }
        return replace(
            cast("Any", first), **{name: _mapped(function, *part) for name, part in parts.items()}
        )
    return first


class DualEquations(Equations):
    """The equations of motion of data and states with derivatives; states are of shape (n_q,)."""

    def __init__(self, mechanism: Mechanism, data: Data) -> None:
        super().__init__(mechanism)
        self.data = data
        self._products, self._weights, self._inertias = data.products, data.weights, data.inertias
        if self._applied is not None:
            # Where its cached properties keep them.
            lifted = zip(("springs", "rotational", "forces"), data.applied, strict=True)
            vars(self._applied).update(lifted)

    def constraint_jacobian(self, q: Any, closed: Sequence[str]) -> Any:
        """Constraint Jacobian, as that of `Equations`."""
        return self._jacobian_of(q, self._rates(q), closed)

    def _jacobian_of(self, q: Any, rates: Any, closed: Sequence[str]) -> Any:
        rows = [function.jacobian(q, rates) for function in self._constraints(closed)]
        return np.stack(rows) if rows else np.zeros((0, len(self._angles)))

    def residual(self, q: Any, closed: Sequence[str]) -> Any:
        """Loop closures and gaps of closed stops, shape (n_loops + n_closed,)."""
        rows = [function.value(q) for function in self._constraints(closed)]
        return np.stack(rows) if rows else np.zeros(0)

    def _constraints(self, closed: Sequence[str]) -> list[ScalarFunction]:
        return [*self.data.closures, *(self.data.gaps[name] for name in closed)]

    def system(self, q: Any, u: Any, closed: Sequence[str]) -> tuple[Any, Any, Any, Any]:
        """Mass matrix, constraint Jacobian, all forces but the constraints', and what G a is."""
        rates = self._rates(q)
        quadratic, curvature = self._quadratic(q, rates), self.kinematics.curvature(q, u, rates)
        mass, forces = quadratic.real + self._inertias, self._forces(q, u, rates, quadratic)
        rows = [function.bias(q, u, curvature) for function in self._constraints(closed)]
        return (
            mass,
            self._jacobian_of(q, rates, closed),
            forces,
            -np.stack(rows) if rows else np.zeros(0),
        )


class VariationalEquations(Equations):
    """The equations of motion and their derivatives along directions of the mechanism's numbers.

    Args:
        mechanism: at whose numbers the derivatives are.
        directions: of its numbers.
        names: what sentences call the directions.

    Raises:
        InputError: a direction names a number that the mechanism does not have.
    """

    def __init__(
        self, mechanism: Mechanism, directions: Sequence[Direction], names: Sequence[str] = ()
    ) -> None:
        super().__init__(mechanism)
        self._names = tuple(names) or tuple(f"direction {j}" for j in range(len(directions)))
        for direction in directions:
            moved(mechanism, direction)  # refuses unknown names
        self.directions = tuple(directions)
        self._dual = DualEquations(mechanism, Data.along(mechanism, directions))
        self._still = DualEquations(mechanism, Data.of(mechanism))

    @property
    def data(self) -> Data:
        """Data with the derivatives along the directions."""
        return self._dual.data

    def along(self, path: str) -> FloatArray:
        """Derivatives of one number, shape (m,)."""
        return np.array([direction.get(path, 0.0) for direction in self.directions])

    def along_each(self, path: str, n: int) -> FloatArray:
        """Derivatives of the n numbers of one tuple, shape (n, m)."""
        return np.array([self.along(f"{path}.{i}") for i in range(n)])

    def residual_tangents(self, q: Dual, closed: Sequence[str]) -> FloatArray:
        """Derivatives of loop closures and gaps of closed stops, shape (n_constraints, m)."""
        return _tangents(self._dual.residual(q, closed), len(self.directions))

    def gap_tangents(self, q: Dual, u: Dual, stop: str) -> tuple[FloatArray, FloatArray, float]:
        """Derivatives of a stop's gap and gap speed, shape (m,) each, and that speed."""
        speed = (self._dual.constraint_jacobian(q, (stop,)) @ u)[-1]
        return (
            self.residual_tangents(q, (stop,))[-1],
            _tangents(speed, len(self.directions)),
            float(value_of(speed)),
        )

    def start(
        self, q: FloatArray, u: FloatArray, closed: Sequence[str], restitution: Mapping[str, Any]
    ) -> tuple[Dual, Dual]:
        """The start's q and u with their derivatives, u as the constraints let it through.

        A change of a start speed is a kick before the start: the part that the closed stops and the
        joints of loops take up is gone at once (their impulses solve M du+ - G^T P = M du, G du+ +
        dG u = 0). A kick away from a stop that pushes ends the same way under the unilateral law
        with e = 0: the stop catches the body again after a time that shrinks with the kick, and to
        first order in it only impulses along the gaps have acted by then.

        Args:
            q, u: the start, shape (n_q,).
            closed: stops that are active from the start on, or struck there.
            restitution: of those that rebound at once, by name.

        Raises:
            InputError: a direction would open or penetrate an active stop, or open a loop, at the
                start.
        """
        dq, du = (self.along_each(name, len(q)) for name in ("start", "start_speeds"))
        start = Dual(q, dq)
        self.refuse_misfits(start, closed, "the start")
        return start, self.impact(start, Dual(u, du), closed, restitution)[0]

    def refuse_misfits(
        self, q: Dual, closed: Sequence[str], what: str, fits: float = _FITS
    ) -> None:
        """Refuse directions that open loops or closed stops, which no motion can follow."""
        misfits = np.abs(self.residual_tangents(q, closed)).max(axis=0, initial=0.0)
        for j in self.misfits(q, closed, fits):
            raise InputError(
                f"{self._names[j]} moves {what} off its closed stops {tuple(closed)} or loops by "
                f"{misfits[j]:.3g} per unit; a motion is not differentiable there: move the stop's "
                "limit (or the joint) along."
            )

    def misfits(self, q: Dual, closed: Sequence[str], fits: float = _FITS) -> list[int]:
        """Which directions open loops or closed stops."""
        misfits = np.abs(self.residual_tangents(q, closed)).max(axis=0, initial=0.0)
        return np.flatnonzero(
            misfits > fits * np.maximum(1.0, np.abs(q.tangents).max(axis=0))
        ).tolist()

    def accelerations(self, q: Dual, u: Dual, closed: Sequence[str]) -> tuple[Dual, Dual]:
        """Accelerations and multipliers of a state, with their derivatives (where unique)."""
        return self._accelerations(self._dual, q, u, closed)

    def rates(
        self, q: FloatArray, u: FloatArray, closed: Sequence[str]
    ) -> tuple[FloatArray, FloatArray]:
        """Time derivatives of accelerations (n_q,) and multipliers (n_constraints,)."""
        a = self.solve(q, u, closed)[0]
        da, rate = self._accelerations(
            self._still, Dual(q, u[:, None]), Dual(u, a[:, None]), closed
        )
        return da.tangents[:, 0], rate.tangents[:, 0]

    def _accelerations(
        self, of: DualEquations, q: Dual, u: Dual, closed: Sequence[str]
    ) -> tuple[Dual, Dual]:
        return self._solved_dual(q, closed, *of.system(q, u, closed))

    def impact(
        self, q: Any, u: Any, taking_part: Sequence[str], restitution: Mapping[str, Any]
    ) -> tuple[Dual, Dual]:
        """Speeds after an impact, and the impulses, with their derivatives.

        Args:
            q, u: the state before, Duals; its derivatives are those on the impact's side.
            taking_part: stops whose gap speed the impact sets.
            restitution: of those that rebound, by name.
        """
        mass, jacobian = self._dual.mass_matrix(q), self._dual.constraint_jacobian(q, taking_part)
        e = [0.0] * self.n_loops + [restitution.get(name, 0.0) for name in taking_part]
        tangents = np.array([_tangents(each, len(self.directions)) for each in e])
        factors = Dual(
            np.array([value_of(each) for each in e]), tangents.reshape(len(e), len(self.directions))
        )
        return self._solved_dual(
            q, taking_part, mass, jacobian, mass @ u, -factors * (jacobian @ u)
        )

    def _solved_dual(
        self, q: Dual, closed: Sequence[str], mass: Any, jacobian: Any, forces: Any, right: Any
    ) -> tuple[Dual, Dual]:
        """The solution of M x - G^T lam = f, G x = g by the implicit function theorem."""
        n_q, m = len(self._angles), q.tangents.shape[-1]
        rows = self._independent(q.value, closed)
        inverse = np.linalg.inv(kkt_matrix(value_of(mass), rows @ value_of(jacobian)))
        solution = inverse @ np.concatenate([value_of(forces), rows @ value_of(right)])
        x, multipliers = solution[:n_q], rows.T @ solution[n_q:]
        above = _tangents(forces - mass @ x + jacobian.T @ multipliers, m)
        below = rows @ _tangents(right - jacobian @ x, m)
        tangents = inverse @ np.concatenate([above, below])
        return Dual(x, tangents[:n_q]), Dual(multipliers, rows.T @ tangents[n_q:])

    def _independent(self, q: FloatArray, closed: Sequence[str]) -> FloatArray:
        """Independent combinations of the constraints, constant at one state."""
        basis = self.basis(q, closed)
        return np.eye(self.n_loops + len(closed)) if basis is None else basis.rows


def _tangents(value: Any, m: int) -> FloatArray:
    return value.tangents if isinstance(value, Dual) else np.zeros((*np.shape(value), m))
