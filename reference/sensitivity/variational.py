r"""Variational equations: derivatives of accelerations, multipliers and impacts.

With the state (q, u) and the data p along a direction as dual numbers, the functions of
:mod:`..equations` give mass matrix, forces and constraints with their derivatives, whatever the
mechanism is made of. The accelerations follow by the implicit function theorem: of

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

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, cast

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from ...models.applied_forces import AppliedForces
from ...models.arrays import FloatArray
from ...models.errors import InputError
from ...models.functions import Phasors, PointCoefficients, ScalarFunction
from ...models.kinematics import initial_state
from ...models.mechanism import Mechanism
from ...models.spec import Spec
from ...models.stacked import numbers, with_numbers
from ..equations import Equations, kkt_matrix, least_step

Direction = Mapping[str, float]
_FITS = 1e-9  # per unit of a direction: how well it must move closed stops and loops along
_STEPS = (-2.0, -1.0, 1.0, 2.0)
# Of the odd parts at one and two steps h = 1: exact for x and for sin x, and 0 for x^2 and cos x.
_WEIGHTS = np.linalg.solve([[2.0, 4.0], [2 * np.sin(1.0), 2 * np.sin(2.0)]], [1.0, 1.0])[
    [1, 0, 0, 1]
] * np.sign(_STEPS)


class Dual(NDArrayOperatorsMixin):
    """An array of one or two axes (or a number) and its derivatives: forward differentiation.

    NumPy's functions, applied to such arrays, apply the chain rule (Griewank and Walther,
    Evaluating Derivatives, 2008, Chapter 3), so that what is written once for numbers gives
    derivatives as well, exact but for rounding. Real and complex arrays are alike; |z|, Re z and
    conj z are differentiated as functions of two real numbers, for the directions are real.

    Args:
        value: shape (...,).
        tangents: derivatives along m directions, shape (..., m).
    """

    def __init__(self, value: Any, tangents: Any) -> None:
        self.value: Any = np.asarray(value)
        self.tangents: Any = tangents

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *operands: Any, **_: Any) -> Any:
        """A new array; one that is to be written into an array of numbers replaces that."""
        rule = _UFUNCS.get(ufunc) if method == "__call__" else None
        return NotImplemented if rule is None else rule(*operands)

    def __array_function__(self, function: Any, types: Any, args: Any, kwargs: Any) -> Any:
        rule = _FUNCTIONS.get(function)
        return NotImplemented if rule is None else rule(*args, **kwargs)

    def __getitem__(self, key: Any) -> Dual:
        return Dual(self.value[key], self.tangents[_with_directions(key)])

    def __setitem__(self, key: Any, item: Any) -> None:
        self.value[key], self.tangents[_with_directions(key)] = value_of(item), _tangents(item)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the value."""
        return self.value.shape

    @property
    def ndim(self) -> int:
        """Number of the value's axes."""
        return self.value.ndim

    @property
    def real(self) -> Dual:
        """Real part."""
        return Dual(self.value.real, self.tangents.real)

    @property
    def imag(self) -> Dual:
        """Imaginary part."""
        return Dual(self.value.imag, self.tangents.imag)

    @property
    def T(self) -> Dual:  # noqa: N802 (NumPy's name)
        """Transpose of a matrix."""
        return Dual(self.value.T, np.swapaxes(self.tangents, 0, -2))

    def conj(self) -> Dual:
        """Complex conjugate."""
        return Dual(self.value.conj(), self.tangents.conj())

    conjugate = conj


def value_of(operand: Any) -> Any:
    """The value of an array with or without derivatives."""
    return operand.value if isinstance(operand, Dual) else operand


def _tangents(operand: Any) -> Any:
    return operand.tangents if isinstance(operand, Dual) else 0.0


def _full_tangents(operand: Any, m: int) -> FloatArray:
    """Derivatives, also of what has none, shape (..., m)."""
    return operand.tangents if isinstance(operand, Dual) else np.zeros((*np.shape(operand), m))


def _with_directions(key: Any) -> Any:
    return (*key, slice(None)) if isinstance(key, tuple) and Ellipsis in key else key


def _factor(operand: Any) -> Any:
    """The value beside an axis of directions."""
    return np.asarray(value_of(operand))[..., None]


def _of_shape(value: Any, tangents: Any) -> Dual:
    shape = (*np.shape(value), tangents.shape[-1])
    if tangents.shape != shape:
        tangents = np.broadcast_to(tangents, shape).copy()
    return Dual(value, tangents)


def _multiply(a: Any, b: Any) -> Dual:
    if not isinstance(b, Dual):
        return _of_shape(a.value * b, a.tangents * _factor(b))
    if not isinstance(a, Dual):
        return _of_shape(a * b.value, _factor(a) * b.tangents)
    return _of_shape(a.value * b.value, a.tangents * _factor(b) + _factor(a) * b.tangents)


def _divide(a: Any, b: Any) -> Dual:
    value = value_of(a) / value_of(b)
    return _of_shape(value, (_tangents(a) - _factor(value) * _tangents(b)) / _factor(b))


def _matmul(a: Any, b: Any) -> Dual:
    left, right = value_of(a), value_of(b)
    parts = list[Any]()
    if isinstance(a, Dual):
        part = np.swapaxes(a.tangents, -1, -2) @ right
        parts.append(part if right.ndim == 1 else np.swapaxes(part, -1, -2))
    if isinstance(b, Dual):
        vector = right.ndim == 1
        parts.append(left @ b.tangents if vector else np.tensordot(left, b.tangents, axes=1))
    return Dual(left @ right, parts[0] if len(parts) == 1 else parts[0] + parts[1])


def _exp(a: Dual) -> Dual:
    value = np.exp(a.value)
    return Dual(value, value[..., None] * a.tangents)


def _absolute(a: Dual) -> Dual:
    size = np.abs(a.value)
    return Dual(size, (_factor(a).conj() * a.tangents).real / size[..., None])


def _where(condition: Any, a: Any, b: Any) -> Dual:
    tangents = np.where(np.asarray(condition)[..., None], _tangents(a), _tangents(b))
    return _of_shape(np.where(condition, value_of(a), value_of(b)), tangents)


def _sum(a: Dual, axis: int) -> Dual:
    return Dual(a.value.sum(axis), a.tangents.sum(axis - 1 if axis < 0 else axis))


def _stack(items: Sequence[Any], axis: int = 0) -> Dual:
    empty = np.zeros_like(next(item.tangents for item in items if isinstance(item, Dual)))
    tangents = [item.tangents if isinstance(item, Dual) else empty for item in items]
    values = np.stack([value_of(item) for item in items], axis)
    return Dual(values, np.stack(tangents, axis - 1 if axis < 0 else axis))


def _transposed(a: Dual, *_: int) -> Dual:
    return a.T


_BINARY: dict[Any, Callable[[Any, Any], Dual]] = {
    np.add: lambda a, b: _of_shape(value_of(a) + value_of(b), _tangents(a) + _tangents(b)),
    np.subtract: lambda a, b: _of_shape(value_of(a) - value_of(b), _tangents(a) - _tangents(b)),
    np.multiply: _multiply,
    np.divide: _divide,
    np.matmul: _matmul,
    np.power: lambda a, n: Dual(a.value**n, n * _factor(a) ** (n - 1) * a.tangents),
}
_UNARY: dict[Any, Callable[[Any], Dual]] = {
    np.negative: lambda a: Dual(-a.value, -a.tangents),
    np.exp: _exp,
    np.absolute: _absolute,
    np.conjugate: Dual.conj,
}
_UFUNCS: dict[Any, Callable[..., Dual]] = {**_BINARY, **_UNARY}
_FUNCTIONS: dict[Any, Callable[..., Dual]] = {
    np.where: _where,
    np.sum: _sum,
    np.stack: _stack,
    np.swapaxes: _transposed,
}


def moved(mechanism: Mechanism, direction: Direction, step: float = 1.0) -> Mechanism:
    """The mechanism with its numbers moved along a direction; it is not validated."""
    known = numbers(mechanism)
    for name in direction:
        if name not in known:
            raise InputError(
                f"there is no number {name!r} in {mechanism.name!r}; there is {sorted(known)}."
            )

    def move(name: str, value: float) -> float:
        return value + step * direction.get(name, 0.0)

    return with_numbers(mechanism, move)


def consistent_direction(mechanism: Mechanism, direction: Direction) -> dict[str, float]:
    """The direction with the least change of the start that keeps its constraints.

    Of a stop whose gap the loops alone fix, the gap changes with the direction, whatever the start.
    Speeds need no change: what the constraints take of a change of them is taken at the start
    (:meth:`VariationalEquations.start`).
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
        steps = [least_step(jacobian, residual, rank) for residual in residuals.T]
        dq = dq - np.stack(steps, axis=1)
    consistent: list[dict[str, float]] = []
    for direction, column in zip(directions, dq.T, strict=True):
        start = {f"start.{i}": float(value) for i, value in enumerate(column)}
        consistent.append(dict(direction) | start)
    return consistent


def movable(equations: Equations, stops: Sequence[str]) -> tuple[str, ...]:
    """Select the stops whose gaps can change, because the loops alone do not fix them."""
    loops = equations.rank_at_start(())
    return tuple(name for name in stops if equations.rank_at_start((name,)) > loops)


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
    applied: Any  # force elements with what they act along: springs, rotational ones and forces


def _mapped(function: Callable[..., Any], *values: Any) -> Any:
    """A function of corresponding numbers and arrays of data of one structure, as such data."""
    first = values[0]
    if isinstance(first, float | complex | np.ndarray):
        return function(*values)
    if isinstance(first, tuple):
        return tuple(_mapped(function, *items) for items in zip(*values, strict=True))
    if isinstance(first, dict):
        keys = cast("dict[str, Any]", first)
        return {key: _mapped(function, *(value[key] for value in values)) for key in keys}
    if isinstance(first, Spec):
        names = list(type(first).model_fields)
    elif is_dataclass(first) and not isinstance(first, Phasors):
        names = [field.name for field in fields(first)]
    else:
        return first
    parts: dict[str, Any] = {}
    for name in names:
        parts[name] = _mapped(function, *(getattr(value, name) for value in values))
    return (
        first.model_copy(update=parts)
        if isinstance(first, Spec)
        else replace(cast("Any", first), **parts)
    )


class DualEquations(Equations):
    """The equations of motion of data and states with derivatives; states are of shape (n_q,).

    The data have derivatives along directions of the mechanism's numbers; without any they are
    plain numbers.
    """

    def __init__(self, mechanism: Mechanism, directions: Sequence[Direction] = ()) -> None:
        super().__init__(mechanism)
        values = numbers(mechanism)
        moving = {name for direction in directions for name, value in direction.items() if value}
        names = [n for n in sorted(moving) if not n.startswith(("start.", "start_speeds."))]
        changes = np.array([[d.get(name, 0.0) for d in directions] for name in names])

        def slopes(name: str) -> Data:
            """Derivatives of the data with respect to one number."""
            size = 1.0 if name.endswith(".angle") else max(1.0, abs(values[name]))
            data = [self._data(moved(mechanism, {name: size}, step)) for step in _STEPS]
            weights = _WEIGHTS / size
            return _mapped(lambda *parts: np.tensordot(weights, np.array(parts), axes=1), *data)

        def dual(value: Any, *derivatives: Any) -> Any:
            if not names:
                return value
            tangents = np.tensordot(np.array(derivatives), changes, axes=(0, 0))
            return Dual(value, tangents) if tangents.any() else value

        data = _mapped(dual, self._data(mechanism), *(slopes(name) for name in names))
        self.data: Data = data
        self._products, self._weights, self._inertias = data.products, data.weights, data.inertias
        if self._applied is not None:
            # Where its cached properties keep them.
            lifted = zip(("springs", "rotational", "forces"), data.applied, strict=True)
            vars(self._applied).update(lifted)

    @staticmethod
    def _data(mechanism: Mechanism) -> Data:
        """Data of a mechanism as numbers."""
        equations = Equations(mechanism)
        kinematics = equations.kinematics
        applied = AppliedForces(kinematics)
        return Data(
            equations._products,
            equations._weights,
            equations._inertias,
            closures=kinematics.loop_closures,
            gaps=kinematics.gaps,
            restitution={stop.name: stop.restitution for stop in mechanism.stops},
            markers={m.name: kinematics.point(m.body, m.point) for m in mechanism.markers},
            applied=(applied.springs, applied.rotational, applied.forces),
        )

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
        right = -np.stack(rows) if rows else np.zeros(0)
        return mass, self._jacobian_of(q, rates, closed), forces, right


class VariationalEquations(Equations):
    """The equations of motion and their derivatives along directions of the mechanism's numbers.

    `names` are what sentences call the directions. InputError if a direction names a number that
    the mechanism does not have.
    """

    def __init__(
        self, mechanism: Mechanism, directions: Sequence[Direction], names: Sequence[str] = ()
    ) -> None:
        super().__init__(mechanism)
        self._names = tuple(names) or tuple(f"direction {j}" for j in range(len(directions)))
        for direction in directions:
            moved(mechanism, direction)  # refuses unknown names
        self.directions = tuple(directions)
        self._dual = DualEquations(mechanism, directions)
        self._still = DualEquations(mechanism)
        self.data = self._dual.data
        """Data with the derivatives along the directions."""

    def along(self, path: str) -> FloatArray:
        """Derivatives of one number, shape (m,)."""
        return np.array([direction.get(path, 0.0) for direction in self.directions])

    def along_each(self, path: str, n: int) -> FloatArray:
        """Derivatives of the n numbers of one tuple, shape (n, m)."""
        return np.array([self.along(f"{path}.{i}") for i in range(n)])

    def residual_tangents(self, q: Dual, closed: Sequence[str]) -> FloatArray:
        """Derivatives of loop closures and gaps of closed stops, shape (n_constraints, m)."""
        return _full_tangents(self._dual.residual(q, closed), len(self.directions))

    def gap_tangents(self, q: Dual, u: Dual, stop: str) -> tuple[FloatArray, FloatArray, float]:
        """Derivatives of a stop's gap and gap speed, shape (m,) each, and that speed."""
        speed = (self._dual.constraint_jacobian(q, (stop,)) @ u)[-1]
        gap = self.residual_tangents(q, (stop,))[-1]
        return gap, _full_tangents(speed, len(self.directions)), float(value_of(speed))

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
        start = Dual(q, self.along_each("start", len(q)))
        self.refuse_misfits(start, closed, "the start")
        kicked = Dual(u, self.along_each("start_speeds", len(q)))
        return start, self.impact(start, kicked, closed, restitution)[0]

    def refuse_misfits(
        self, q: Dual, closed: Sequence[str], what: str, fits: float = _FITS
    ) -> None:
        """Refuse directions that open loops or closed stops, which no motion can follow."""
        for j, misfit in self.misfits(q, closed, fits).items():
            raise InputError(
                f"{self._names[j]} moves {what} off its closed stops {tuple(closed)} or loops by "
                f"{misfit:.3g} per unit; a motion is not differentiable there: move the stop's "
                "limit (or the joint) along."
            )

    def misfits(self, q: Dual, closed: Sequence[str], fits: float = _FITS) -> dict[int, float]:
        """Directions that open loops or closed stops, and by how much per unit."""
        misfits = np.abs(self.residual_tangents(q, closed)).max(axis=0, initial=0.0)
        largest = fits * np.maximum(1.0, np.abs(q.tangents).max(axis=0))
        return {j: float(misfits[j]) for j in np.flatnonzero(misfits > largest).tolist()}

    def accelerations(self, q: Dual, u: Dual, closed: Sequence[str]) -> tuple[Dual, Dual]:
        """Accelerations and multipliers of a state, with their derivatives (where unique)."""
        return self._solved_dual(q, closed, *self._dual.system(q, u, closed))

    def rates(
        self, q: FloatArray, u: FloatArray, closed: Sequence[str]
    ) -> tuple[FloatArray, FloatArray]:
        """Time derivatives of accelerations (n_q,) and multipliers (n_constraints,)."""
        a = self.solve(q, u, closed)[0]
        state = Dual(q, u[:, None]), Dual(u, a[:, None])
        solved = self._solved_dual(state[0], closed, *self._still.system(*state, closed))
        return solved[0].tangents[:, 0], solved[1].tangents[:, 0]

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
        m = len(self.directions)
        tangents = np.array([_full_tangents(factor, m) for factor in e]).reshape(len(e), m)
        factors = Dual(np.array([value_of(factor) for factor in e]), tangents)
        rebound = -factors * (jacobian @ u)
        return self._solved_dual(q, taking_part, mass, jacobian, mass @ u, rebound)

    def _solved_dual(
        self, q: Dual, closed: Sequence[str], mass: Any, jacobian: Any, forces: Any, right: Any
    ) -> tuple[Dual, Dual]:
        """The solution of M x - G^T lam = f, G x = g by the implicit function theorem."""
        n_q, m = len(self._angles), q.tangents.shape[-1]
        # Independent combinations of the constraints, constant at one state.
        basis = self.basis(q.value, closed)
        rows = np.eye(self.n_loops + len(closed)) if basis is None else basis.rows
        inverse = np.linalg.inv(kkt_matrix(value_of(mass), rows @ value_of(jacobian)))
        solution = inverse @ np.concatenate([value_of(forces), rows @ value_of(right)])
        x, multipliers = solution[:n_q], rows.T @ solution[n_q:]
        above = _full_tangents(forces - mass @ x + jacobian.T @ multipliers, m)
        below = rows @ _full_tangents(right - jacobian @ x, m)
        tangents = inverse @ np.concatenate([above, below])
        return Dual(x, tangents[:n_q]), Dual(multipliers, rows.T @ tangents[n_q:])
