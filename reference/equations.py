r"""Equations of motion of a mechanism in its minimal coordinates, constraints by multipliers.

With w = (-i e^{-i q}) on angles and 1 on slides (:mod:`..models.phasors`) and K = C^H diag(m) C
over the bodies' centres C, one Hermitian matrix H_ij = conj(w_i) K_ij w_j holds everything
quadratic:

    M(q)   = Re H + diag(I) + sum J g g^T   mass matrix (Re(K_ij e^{i(q_i - q_j)}) for two angles;
                                            J of rotors on the angles g . q)
    b(q,u) = Im(H) (s u^2),  s = 1 on angles    centrifugal, on the left: M a + b = Q + G^T lam
    Q(q)   = Re(conj(w) (C^H m) (-i g))         gravity

Slides along lines that turn add a second derivative to w, so that its Jacobian J is not diagonal:
then H = J^H K J, b = Re(J^H K dJ/dt u) and Q = Re(J^H (C^H m) (-i g)). Force elements add theirs
(:mod:`..models.applied_forces`).

Constraints (closed stops, loops of joints) enter by the index-1 form of KKT: G a = -gamma. Where
some of them follow from the others (a beam on three parallel cranks), the accelerations are unique
and the multipliers are not: those of least norm are taken (:class:`ConstraintScales`).

Consistent initialisation: the nearest coordinates and speeds that fulfil the constraints.
Gauss-Newton with the least step that removes the linearised residual, G(q) dq = -residual; speeds
are projected onto the null space of G (e.g. Haug, Computer Aided Kinematics and Dynamics of
Mechanical Systems, 1989, Sec. 3.6). "Nearest" is in the plain norm of the coordinates, not in the
metric of the mass matrix: no force acts here.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..models.applied_forces import AppliedForces
from ..models.arrays import ComplexArray, FloatArray
from ..models.elements.base import LinearElement
from ..models.errors import SimulationError
from ..models.functions import PointFunction, ScalarFunction
from ..models.kinematics import Kinematics, immovable_stops
from ..models.mechanism import Mechanism
from .compiled import Added, CompiledEquations, compiled_equations, not_unique

_ITERATIONS = 30  # from a slightly changed mechanism's start it takes three or four
_FITS = 1e-14  # [rad or m] relative to the size of the coordinates
_BESIDE = 1e-2  # [rad; slides: of the largest length] distance of the positions tried beside one
_POSITIONS = 3  # number of these
# Of the largest singular value of S: loops need to close to 1e-9 m, and S is as far off.
_DEPENDENT = 1e-6


class Equations:
    """M a + b = Q + G^T lam and G a + gamma = 0, for states of shape (n_q,) or (n, n_q)."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism
        self.kinematics = Kinematics(mechanism)
        centres, masses = self.kinematics.centres, self.kinematics.masses
        self._angles, self._rates = self.kinematics.is_angle, self.kinematics.rates
        self._products: ComplexArray = (centres.conj().T * masses) @ centres
        gravity = mechanism.gravity * complex(*mechanism.gravity_direction)
        self._weights: ComplexArray = gravity * (centres.conj().T @ masses)
        self._inertias = self.kinematics.inertia_matrix
        self._applied = AppliedForces(self.kinematics) if mechanism.force_elements else None
        self._gaps = self.kinematics.gaps
        self._ranks: dict[tuple[str, ...], int] = {}
        self._ranks_at_start: dict[tuple[str, ...], int] = {}
        self._compilations: dict[tuple[str, ...], CompiledEquations | None] = {}

    @cached_property
    def n_loops(self) -> int:
        """Number of scalar constraints of the loop joints."""
        return len(self.kinematics.loop_closures)

    @cached_property
    def _loops(self) -> ComplexArray | None:
        """Rows L with Re(L . w) the loop constraints' rates; None if some are of other kinds."""
        closures = self.kinematics.loop_closures
        rows = [closure.coefficients for closure in closures if isinstance(closure, PointFunction)]
        if self.kinematics.carried or len(rows) < len(closures):
            return None
        return np.array(rows, dtype=np.complex128).reshape(len(rows), len(self._angles))

    def loop_residual(self, q: FloatArray) -> FloatArray:
        """Loop-closure residuals [m or rad], shape (..., n_loops)."""
        return self.kinematics.loop_residual(q)

    def mass_matrix(self, q: FloatArray) -> FloatArray:
        """M(q), shape (..., n_q, n_q)."""
        return self._quadratic(q, self._rates(q)).real + self._inertias

    def bias(self, q: FloatArray, u: FloatArray) -> FloatArray:
        """b(q, u): centrifugal forces on the left-hand side, shape (..., n_q)."""
        rates = self._rates(q)
        return self._bias(q, u, rates, self._quadratic(q, rates))

    def gravity_forces(self, q: FloatArray) -> FloatArray:
        """Q(q): generalized forces of gravity, shape (..., n_q)."""
        return self._gravity_forces(q, self._rates(q))

    def _gravity_forces(self, q: FloatArray, rates: ComplexArray) -> FloatArray:
        return self.kinematics.gradient(self._weights.conj(), q, rates).real

    def applied_on_bodies(self, q: FloatArray, u: FloatArray) -> dict[str, FloatArray]:
        """Resultant force of the force elements on each body [N], world frame, shape (..., 2)."""
        return {} if self._applied is None else self._applied.on_bodies(q, u)

    def potential_energy(self, q: FloatArray) -> FloatArray:
        """Energy of gravity, zero at the world's origin, and of springs [J], shape (...,)."""
        energy = self.kinematics.potential_energy(q)
        return energy if self._applied is None else energy + self._applied.potential_energy(q)

    def forces(self, q: FloatArray, u: FloatArray) -> FloatArray:
        """Q(q) - b(q, u): all generalized forces but the constraints', shape (..., n_q)."""
        rates = self._rates(q)
        return self._forces(q, u, rates, self._quadratic(q, rates))

    def _forces(
        self, q: FloatArray, u: FloatArray, rates: ComplexArray, quadratic: ComplexArray
    ) -> FloatArray:
        """Q - b: generalized forces without the constraints', shape (..., n_q)."""
        forces = self._gravity_forces(q, rates) - self._bias(q, u, rates, quadratic)
        return forces if self._applied is None else forces + self._applied.generalized(q, u, rates)

    def _quadratic(self, q: FloatArray, rates: ComplexArray) -> ComplexArray:
        """J^H K J, shape (..., n_q, n_q)."""
        if not self.kinematics.carried:
            return rates.conj()[..., :, None] * self._products * rates[..., None, :]
        jacobian = rates[..., None, :] * np.eye(len(self._angles))  # dw/dq
        for k, c in self.kinematics.carried:
            jacobian[..., k, c] = -1j * q[..., k] * rates[..., k]
        return np.swapaxes(jacobian.conj(), -1, -2) @ self._products @ jacobian

    def _bias(
        self, q: FloatArray, u: FloatArray, rates: ComplexArray, quadratic: ComplexArray
    ) -> FloatArray:
        if not self.kinematics.carried:
            return (quadratic.imag @ (self._angles * u * u)[..., None])[..., 0]
        forces = self.kinematics.curvature(q, u, rates) @ self._products.T
        return self.kinematics.gradient(forces.conj(), q, rates).real

    def constraint_jacobian(self, q: FloatArray, closed: Sequence[str]) -> FloatArray:
        """G(q): loop joints, then gaps of the closed stops, shape (..., n_constraints, n_q)."""
        rates = self._rates(q)
        jacobian = np.empty((*q.shape[:-1], self.n_loops + len(closed), len(self._angles)))
        if self._loops is not None:
            jacobian[..., : self.n_loops, :] = (self._loops * rates[..., None, :]).real
        for k, function in self._functions(closed):
            jacobian[..., k, :] = function.jacobian(q, rates)
        return jacobian

    def constraint_bias(self, q: FloatArray, u: FloatArray, closed: Sequence[str]) -> FloatArray:
        """gamma(q, u) = dG/dt u, which is 0 for gaps of angles; shape (..., n_constraints)."""
        curvature = self.kinematics.curvature(q, u, self._rates(q))
        bias = np.empty((*q.shape[:-1], self.n_loops + len(closed)))
        if self._loops is not None:
            bias[..., : self.n_loops] = (curvature @ self._loops.T).real
        for k, function in self._functions(closed):
            bias[..., k] = function.bias(q, u, curvature)
        return bias

    def _functions(self, closed: Sequence[str]) -> Iterator[tuple[int, ScalarFunction]]:
        """Constraints that are no rows of L, each with its index: stops', and some of loops."""
        if self._loops is None:
            yield from enumerate(self.kinematics.loop_closures)
        yield from enumerate((self._gaps[name] for name in closed), start=self.n_loops)

    def solve(
        self, q: FloatArray, u: FloatArray, closed: Sequence[str]
    ) -> tuple[FloatArray, FloatArray]:
        """Accelerations and multipliers under the loop joints and the closed stops.

        Returns:
            a, shape (..., n_q) [rad/s^2 or m/s^2], and lam, shape (..., n_loops + n_closed):
            generalized forces conjugate to the constraints [N or N m].
        """
        if (compiled := self.compiled(q, closed)) is not None:
            return compiled.solve(q, u)
        rates = self._rates(q)
        quadratic = self._quadratic(q, rates)
        mass = quadratic.real + self._inertias
        forces = self._forces(q, u, rates, quadratic)
        if self.n_loops + len(closed) == 0:
            return self._solved(mass, forces), np.zeros((*q.shape[:-1], 0))
        jacobian, right = self.constraint_jacobian(q, closed), -self.constraint_bias(q, u, closed)
        if (basis := self.basis(q, closed)) is not None:
            a, reduced = self._constrained(
                mass, basis.rows @ jacobian, forces, _times(basis.rows, right)
            )
            return a, _times(np.swapaxes(basis.rows, -1, -2), reduced)
        return self._constrained(mass, jacobian, forces, right)

    def compiled(self, q: FloatArray, closed: Sequence[str]) -> CompiledEquations | None:
        """The compiled equations; None where there are none, as with forces that are not linear."""
        names = tuple(closed)
        if names not in self._compilations:
            compiled, added = None, self._added()
            if added is not None and self.basis(q, names) is None:
                functions = (*self.kinematics.loop_closures, *(self._gaps[name] for name in names))
                matrices = self._products, self._weights, self._inertias
                compiled = compiled_equations(self.kinematics, matrices, added, functions)
            self._compilations[names] = compiled
        return self._compilations[names]

    def _added(self) -> Added | None:
        """Forces beside gravity's; None where the equations are of another form."""
        return self._linear_forces() if type(self) is Equations else None

    def _linear_forces(self) -> Added | None:
        """Forces of the force elements, if all of them are linear in coordinates and speeds."""
        added, at_zero = Added.none(len(self._angles)), np.zeros(len(self._angles))
        for element, along in () if self._applied is None else self._applied.terms:
            if not isinstance(element, LinearElement) or element.linear_law is None:
                return None
            stiffness, damping = element.linear_law
            row = along.coefficients
            added = replace(
                added,
                constant=added.constant + float(element.effort(along, at_zero, at_zero)) * row,
                stiffness=added.stiffness + stiffness * np.outer(row, row),
                damping=added.damping + damping * np.outer(row, row),
            )
        return added

    def response(self, q: FloatArray, force: FloatArray) -> FloatArray:
        """Accelerations (speed jumps) by a generalized force (impulse) alone, with the loop joints.

        Args:
            q, force: of one state, shape (n_q,).
        """
        jacobian, basis = self.constraint_jacobian(q, ()), self.basis(q, ())
        rows = jacobian if basis is None else basis.rows @ jacobian
        return self._constrained(self.mass_matrix(q), rows, force, np.zeros(len(rows)))[0]

    def basis(self, q: FloatArray, closed: Sequence[str]) -> Basis | None:
        """Independent combinations of the constraints in states (..., n_q); None if all are.

        Raises:
            SimulationError: the first state is in a singular position (a four-bar with all its pins
                on one line), in which fewer constraints are independent than beside it:
                accelerations are not unique there.
        """
        names = tuple(closed)
        if names not in self._ranks:
            self._ranks[names] = _rank_near(self, np.atleast_2d(q)[0], names)
        if self._ranks[names] == self.n_loops + len(names):
            return None
        return self._scales(names).basis(self.constraint_jacobian(q, names), self._ranks[names])

    def _scales(self, closed: Sequence[str]) -> ConstraintScales:
        functions = (*self.kinematics.loop_closures, *(self._gaps[name] for name in closed))
        inertia = np.diag(self._products).real + np.diag(self._inertias)
        for k, c in self.kinematics.carried:  # with the slide at 1 m
            inertia[c] += inertia[k]
        scales = scales_of(
            inertia, np.array([f.amplitudes for f in functions]).reshape(-1, len(inertia))
        )
        # A gap that nothing changes has a row of rounding errors, which would count as independent.
        idle = np.array([False] * self.n_loops + [name in self._immovable for name in closed])
        return replace(scales, rows=np.where(idle, 0.0, scales.rows))

    @cached_property
    def _immovable(self) -> frozenset[str]:
        return frozenset(immovable_stops(self.mechanism))

    def rank(self, q: FloatArray, closed: Sequence[str]) -> int:
        """Number of independent constraints in one position, shape (n_q,)."""
        return self._scales(closed).rank(self.constraint_jacobian(q, closed))

    def independence(self, q: FloatArray, closed: Sequence[str], length: float) -> FloatArray:
        """Least singular value of the independent constraints in positions (..., n_q), (...,).

        Of their Jacobian, with lengths in parts of a given one [m]: rounding errors of positions
        show in the coordinates, speeds and forces that constraints determine divided by it.
        """
        names = tuple(closed)
        functions = (*self.kinematics.loop_closures, *(self._gaps[name] for name in names))
        rank = len(functions) if self.basis(q, names) is None else self._ranks[names]
        if rank == 0:
            return np.full(q.shape[:-1], np.inf)
        rows = np.array([1.0 / length if f.is_length else 1.0 for f in functions])
        columns = np.where(self.kinematics.is_angle > 0, 1.0, length)
        scaled = rows[:, None] * self.constraint_jacobian(q, names) * columns
        return np.asarray(np.linalg.svd(scaled, compute_uv=False)[..., rank - 1], dtype=np.float64)

    def note_rank(self, closed: Sequence[str], rank: int) -> None:
        """Note how many constraints are independent beside a position in which they lose rank."""
        self._ranks[tuple(closed)] = rank

    def rank_at_start(self, closed: Sequence[str]) -> int:
        """Number of independent constraints of the loops and of the closed stops.

        Stops that depend on other constraints in the start alone, and not beside it, count as
        independent.
        """
        most, names = self._loop_rank + len(closed), tuple(closed)
        if not names:
            return most
        if names not in self._ranks_at_start:
            with suppress(SimulationError):
                most = _rank_near(self, np.array(self.mechanism.start), names)
            self._ranks_at_start[names] = most
        return self._ranks_at_start[names]

    @cached_property
    def _loop_rank(self) -> int:
        return _rank_near(self, np.array(self.mechanism.start), ())

    def _constrained(
        self, mass: FloatArray, jacobian: FloatArray, forces: FloatArray, right: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Accelerations and multipliers of M a - G^T lam = f, G a = right."""
        both = np.concatenate([forces, right], axis=-1)
        solution = self._solved(kkt_matrix(mass, jacobian), both)
        return solution[..., : mass.shape[-1]], solution[..., mass.shape[-1] :]

    def _solved(self, matrix: FloatArray, right: FloatArray) -> FloatArray:
        try:
            return np.asarray(np.linalg.solve(matrix, right[..., None])[..., 0], dtype=np.float64)
        except np.linalg.LinAlgError:
            raise not_unique(self.mechanism.name) from None


def kkt_matrix(mass: FloatArray, jacobian: FloatArray) -> FloatArray:
    """((M, -G^T), (G, 0)), shape (..., n_q + n_constraints, n_q + n_constraints)."""
    n_q, n_c = mass.shape[-1], jacobian.shape[-2]
    kkt = np.zeros((*mass.shape[:-2], n_q + n_c, n_q + n_c))
    kkt[..., :n_q, :n_q] = mass
    kkt[..., :n_q, n_q:] = -np.swapaxes(jacobian, -1, -2)
    kkt[..., n_q:, :n_q] = jacobian
    return kkt


def _times(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    return (matrix @ vector[..., None])[..., 0]


def consistent_coordinates(
    equations: Equations, q: FloatArray, closed: Sequence[str], gaps: FloatArray | None = None
) -> FloatArray | None:
    """The coordinates near q at which loops close and the closed stops have given gaps.

    Args:
        q: first guess, shape (n_q,) [rad or m].
        closed: names of the closed stops.
        gaps: of each of them, where its wall is to be, shape (n_closed,) [rad or m]; 0 where left
            out.

    Returns:
        Shape (n_q,); None if the iteration does not converge.
    """
    targets = np.zeros(len(closed)) if gaps is None else gaps
    return _nearest(equations, q, closed, targets, equations.rank_at_start(closed))


def _nearest(
    equations: Equations, q: FloatArray, closed: Sequence[str], gaps: FloatArray, rank: int
) -> FloatArray | None:
    for _ in range(_ITERATIONS):
        open_by = np.array([float(equations.kinematics.gap(name, q)) for name in closed]) - gaps
        residual = np.concatenate([np.atleast_1d(equations.loop_residual(q)), open_by])
        if np.abs(residual).max(initial=0.0) <= _FITS * (1 + np.abs(q).max()):
            return q
        q = q - least_step(equations.constraint_jacobian(q, closed), residual, rank)
    return None


def consistent_speeds(
    equations: Equations, q: FloatArray, u: FloatArray, closed: Sequence[str]
) -> FloatArray:
    """The nearest speeds that keep loops closed and closed stops touching, shape (n_q,)."""
    jacobian = equations.constraint_jacobian(q, closed)
    if len(jacobian):
        return u - least_step(jacobian, jacobian @ u, equations.rank_at_start(closed))
    return u


def _rank_near(equations: Equations, q: FloatArray, closed: Sequence[str]) -> int:
    """Number of independent constraints in the positions near q, shape (n_q,)."""
    n_constraints = equations.n_loops + len(closed)
    rank = equations.rank(q, closed)
    if rank == n_constraints:
        return rank
    # Where constraints follow from others, whatever fulfils those others fulfils them, too.
    random, angles = np.random.default_rng(1), equations.kinematics.is_angle > 0
    size = _BESIDE * np.where(
        angles, 1.0, np.abs(equations.kinematics.centres[:, angles]).max(initial=0.0)
    )
    for _ in range(_POSITIONS):
        guess = q + size * random.uniform(-1, 1, len(q))
        if _nearest(equations, guess, closed, np.zeros(len(closed)), rank) is None:
            names = (*equations.mechanism.bound_by, *closed)
            raise SimulationError(
                f"{equations.mechanism.name!r} is in a singular position: the constraints of "
                f"{', '.join(names)} depend "
                "on each other there and not beside it, so accelerations are not unique."
            )
    return rank


@dataclass(frozen=True)
class ConstraintScales:
    r"""Scales in which constraints are compared: diagonals of D_r (n_constraints,) and D_c (n_q,).

    Redundant constraints (a beam on three parallel cranks) leave accelerations unique and
    multipliers not: with G^T n = 0, every lam + c n exerts the same generalized forces. Let
    S = D_r G D_c, with columns divided by the root of the mass matrix' diagonal, and each row by
    the greatest length it can have then in any position, so that no unit matters. With
    S = U sigma V^T and rank r, the first r columns of U make independent constraints of them,

        (U_r^T D_r) G a = -(U_r^T D_r) gamma,        lam = D_r U_r mu,

    whose multipliers mu are unique. Of all lam that exert the same forces, this one has the least
    norm of D_r^{-1} lam.
    """

    rows: FloatArray
    columns: FloatArray

    def rank(self, jacobian: FloatArray) -> int:
        """Number of independent constraints in one position."""
        values = np.linalg.svd(self._scaled(jacobian), compute_uv=False)
        return int((values > _DEPENDENT * values.max(initial=0.0)).sum())

    def basis(self, jacobian: FloatArray, rank: int) -> Basis:
        """The basis of constraints of a known rank, in positions (...)."""
        basis = np.swapaxes(np.linalg.svd(self._scaled(jacobian))[0], -1, -2) * self.rows
        return Basis(basis[..., :rank, :], basis[..., rank:, :])

    def _scaled(self, jacobian: FloatArray) -> FloatArray:
        """S of constraints in positions (...), shape (..., n_constraints, n_q)."""
        return self.rows[..., None] * jacobian * self.columns[..., None, :]


@dataclass(frozen=True)
class Basis:
    """Independent combinations of constraints, and multipliers that exert no force."""

    rows: FloatArray
    """U_r^T D_r, shape (..., rank, n_constraints)."""
    null: FloatArray
    """Multipliers without a generalized force, (..., n_constraints - rank, n_constraints)."""


def scales_of(inertia: FloatArray, amplitudes: FloatArray) -> ConstraintScales:
    """Scales of constraints.

    Args:
        inertia: the mass matrix' diagonal, shape (..., n_q).
        amplitudes: the greatest values of the constraints' derivatives in any position, (...,
            n_constraints, n_q).
    """
    columns = 1.0 / np.sqrt(np.where(inertia > 0, inertia, 1.0))
    lengths = np.linalg.norm(amplitudes * columns[..., None, :], axis=-1)
    return ConstraintScales(1.0 / np.where(lengths > 0, lengths, 1.0), columns)


def least_step(jacobian: FloatArray, residual: FloatArray, rank: int) -> FloatArray:
    """The least dq with G dq = residual for constraints of a known rank, shape (n_q,).

    Beside the positions in which all constraints are fulfilled, dependent ones contradict each
    other: their combination is left out, as small as it is, for it would move the mechanism along
    its own motion.
    """
    if rank == len(jacobian):
        return np.asarray(np.linalg.lstsq(jacobian, residual, rcond=None)[0], dtype=np.float64)
    left, values, right = np.linalg.svd(jacobian)
    return right[:rank].T @ (left[:, :rank].T @ residual / values[:rank])
