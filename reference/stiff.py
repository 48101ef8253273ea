r"""Steps of a motion, and of a stiff one: collocation at Radau's points, an implicit method.

A damper on a light body decays within microseconds. DOP853 is stable with steps of that length
alone, though nothing moves as fast any more. Radau IIA with seven stages is stable with any, and
goes on where its steps are longer by more than they cost:

    y_i = y_0 + h sum_j a_ij f(y_j),    i = 1 ... 7,    y(t + h) = y_7

The stages lie on a polynomial of seventh degree through the start, which is the dense output. It
errs by O(h^8) as DOP853's does, and the ends of steps by O(h^14). The error of an embedded formula
of seventh order chooses the step (Hairer and Wanner, Solving Ordinary Differential Equations II,
1996, Sections IV.5 and IV.8, for three stages; the same authors for more in Stiff differential
equations solved by Radau methods, J. Comput. Appl. Math. 111, 1999).

Coordinates follow from speeds, q_i = q_0 + h sum_j a_ij u_j, so that Newton's method is for the
speeds alone: with J_q and J_u the derivatives of the accelerations in the step's start, its matrix
is I - h (A x J_u) - h^2 (A^2 x J_q).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.polynomial.legendre import legvander
from scipy.integrate import DenseOutput
from scipy.linalg import lu_factor, lu_solve
from scipy.special import roots_jacobi

from ..models.arrays import FloatArray
from ..models.elements import refuse_unknown
from .equations import Equations
from .integrator import CompiledIntegrator, Integrator, Interpolant, StepLimit, step_factor

# When Radau's method is tried: after steps, one after another, of a length in parts of the longest
# that is stable, if so many more are to follow; steps of its trial; how much longer they must be,
# and, for the next segment to begin with it, than the longest that is stable.
_SHORT, _AS_SHORT, _MANY = 100, 0.1, 200
_TRIAL, _LONGER = 20, 10.0
_TIME_CONSTANTS = 3.0  # length of DOP853's steps where a damper decides
_STAGES = 7
_ITERATIONS = 10  # of Newton's method; where it converges, it takes about four
_CONVERGED = 1e-2  # last change of a stage, in parts of the tolerance
_DIFFERENCE = float(np.cbrt(np.finfo(np.float64).eps))  # relative, of central differences


class Steps:
    """Steps under one active set: DOP853's, and Radau's where dampers keep those short.

    Args:
        closed: active stops.
        start, end: [s].
        y: state (q, u) at the start, shape (2 n_q,).
        tolerance: relative and absolute local error bounds.
        limit: of the motion that this is a segment of; one of its own if left out.
    """

    def __init__(
        self,
        equations: Equations,
        closed: tuple[str, ...],
        start: float,
        y: FloatArray,
        end: float,
        tolerance: tuple[float, float],
        limit: StepLimit | None,
    ) -> None:
        self._equations, self._closed, self._n_q = equations, closed, len(y) // 2
        self._limit = limit or StepLimit(len(y), end)
        self._bounds = end, tolerance, self._limit
        self._longest = longest_step(equations, y[: self._n_q], closed)
        self._short, self._explicit_step, self._before = 0, 0.0, 0
        if self._limit.is_stiff:
            self._short, self._stepper = _SHORT + _TRIAL + 1, self._radau(start, y)
        else:
            self._stepper = self._dop853(start, y)

    @property
    def evaluations(self) -> int:
        """Number of states whose accelerations were asked for."""
        return self._before + self._stepper.nfev

    def step(self) -> Integrator:
        """Take one step; the integrator after it."""
        if self._short == _SHORT:
            self._explicit_step = float(self._stepper.step_size or 0.0)
            self._stepper = self._radau(*self._replaced())
        elif self._short == _SHORT + _TRIAL and self._stepper.h_abs < _LONGER * self._explicit_step:
            self._stepper = self._dop853(*self._replaced())
        self._stepper.step()
        steps, longest = self._stepper, _LONGER * self._longest
        self._limit.is_stiff = isinstance(steps, RadauIntegrator) and steps.h_abs > longest
        # After the trial the count goes on: there is no second one.
        self._short = self._short + 1 if self._short >= _SHORT or self._is_short() else 0
        return self._stepper

    def _is_short(self) -> bool:
        """Tell whether a step is as short as a damper's decay, and many such are to follow."""
        last, left = float(self._stepper.step_size or 0.0), self._limit.end - self._stepper.t
        return last > _AS_SHORT * self._longest and left > _MANY * last

    def _replaced(self) -> tuple[float, FloatArray]:
        """Time and state of the integrator that another one follows."""
        self._before += self._stepper.nfev
        return self._stepper.t, self._stepper.y

    def _radau(self, t: float, y: FloatArray) -> Integrator:
        return RadauIntegrator(self._accelerations, t, y, *self._bounds)

    def _dop853(self, t: float, y: FloatArray) -> Integrator:
        compiled = self._equations.compiled(y[: self._n_q], self._closed)
        if compiled is not None:
            return CompiledIntegrator(compiled, t, y, *self._bounds, self._longest)
        return Integrator(_rates_by(self._accelerations), t, y, *self._bounds, self._longest)

    def _accelerations(self, q: FloatArray, u: FloatArray) -> FloatArray:
        return self._equations.solve(q, u, self._closed)[0]


Accelerations = Callable[[FloatArray, FloatArray], FloatArray]
"""Accelerations of states (q, u), each of shape (..., n_q)."""


def _rates_by(accelerations: Accelerations) -> Callable[[float, FloatArray], FloatArray]:
    """Time derivative of a state (q, u), shape (2 n_q,)."""

    def rates(_: float, y: FloatArray) -> FloatArray:
        q, u = np.split(y, 2)
        return np.concatenate([u, accelerations(q, u)])

    return rates


def longest_step(equations: Equations, q: FloatArray, closed: Sequence[str]) -> float:
    """Longest step in a position, shape (n_q,) [s]; infinite without dampers.

    DOP853's steps are limited by stability, not by accuracy, where a damper decides. On the border
    of stability a step's end is accurate, for the error estimate of the next step corrects it, but
    the dense output in between is not: with h times the decay rate at 6 it errs a hundred times
    more than the step. Steps of at most `_TIME_CONSTANTS` are well inside.

    Args:
        closed: active stops.
    """
    elements = equations.mechanism.force_elements
    refuse_unknown("The reference's limit of steps", elements)
    if not any(element.dissipates for element in elements):
        return np.inf
    units = np.eye(len(q))
    # Accelerations are quadratic in speeds: dampers are what is odd in them.
    up, down = (
        equations.solve(np.broadcast_to(q, units.shape), sign * units, closed)[0]
        for sign in (1.0, -1.0)
    )
    fastest = np.abs(np.linalg.eigvals((up - down).T / 2)).max()
    return _TIME_CONSTANTS / float(fastest) if fastest > 0 else np.inf


class RadauIntegrator(Integrator):
    """Integrator of stiff motions.

    Args:
        accelerations: of states (q, u), each of shape (..., n_q).
        start, end: [s].
        y: state (q, u) at the start, shape (2 n_q,).
        tolerance: relative and absolute local error bounds.
        limit: of the motion that this is a segment of; one of its own if left out.
        longest: step [s].
    """

    def __init__(
        self,
        accelerations: Accelerations,
        start: float,
        y: FloatArray,
        end: float,
        tolerance: tuple[float, float],
        limit: StepLimit | None = None,
        longest: float = np.inf,
    ) -> None:
        self._accelerations, self._n_q = accelerations, len(y) // 2
        self._last: Interpolant | None = None
        super().__init__(_rates_by(accelerations), start, y, end, tolerance, limit, longest)

    def _step_impl(self) -> tuple[bool, str | None]:
        """One step, as short as its error and the convergence of its stages ask for."""
        least = 10 * abs(float(np.nextafter(self.t, np.inf)) - self.t)
        size, rejected = float(np.clip(self.h_abs, least, self.max_step)), False
        derivatives = self._derivatives()
        while True:
            if not size >= least:
                return False, self.TOO_SMALL_STEP
            t = min(self.t + size, self.t_bound)
            size = t - self.t
            changes = self._stages(size, derivatives)
            if changes is not None:
                error = self._error(size, changes, derivatives, again=rejected)
                if error < 1:
                    break
                size *= step_factor(error)
            else:
                size, self._last = size / 2, None
            rejected = True
        factor = step_factor(error)
        y, self.h_previous, self.y_old = self.y, size, self.y
        self._last = Interpolant(self.t, t, y, tableau().of_interpolant @ changes)
        self.t, self.y = t, y + changes[-1]
        self.f = self.fun(self.t, self.y)
        self.h_abs = size * (min(1.0, factor) if rejected else factor)
        return True, None

    def _dense_output_impl(self) -> DenseOutput:
        assert self._last is not None
        return self._last

    def _derivatives(self) -> FloatArray:
        """Derivatives of the accelerations by the state, central differences, (n_q, 2 n_q)."""
        steps = _DIFFERENCE * np.maximum(1.0, np.abs(self.y))
        states = self.y + np.concatenate([np.diag(steps), -np.diag(steps)])
        up, down = np.split(self._of_states(states), 2)
        return ((up - down) / (2 * steps[:, None])).T

    def _of_states(self, states: FloatArray) -> FloatArray:
        """Accelerations, shape (n, n_q)."""
        self.nfev += len(states)
        return self._accelerations(states[:, : self._n_q], states[:, self._n_q :])

    def _stages(self, size: float, derivatives: FloatArray) -> FloatArray | None:
        """Changes of the state up to each stage, shape (7, 2 n_q); None without convergence.

        Args:
            size: of the step [s].
            derivatives: as :meth:`_derivatives` has them.
        """
        n_q, matrix, nodes = self._n_q, tableau().matrix, tableau().nodes
        by_q, by_u = derivatives[:, :n_q], derivatives[:, n_q:]
        system = np.eye(_STAGES * n_q) - size * np.kron(matrix, by_u)
        system -= size**2 * np.kron(matrix @ matrix, by_q)
        if not np.isfinite(system).all():
            return None
        factors, scale = lu_factor(system), self._scale(self.y)
        speeds = np.zeros((_STAGES, n_q))
        if self._last is not None and self._last.t == self.t:  # the last polynomial goes on
            speeds = np.asarray(self._last(self.t + nodes * size)).T[:, n_q:] - self.y[n_q:]
        before = np.inf
        for _ in range(_ITERATIONS):
            changes = np.hstack([size * matrix @ (self.y[n_q:] + speeds), speeds])
            excess = speeds - size * matrix @ self._of_states(self.y + changes)
            if not np.isfinite(excess).all():
                return None
            step = -lu_solve(factors, excess.ravel()).reshape(speeds.shape)
            speeds = speeds + step
            moved = np.hstack([size * matrix @ step, step])
            largest = float(np.abs(moved / scale).max())
            # Rounding is what is left where the changes are small and shrink no more.
            if largest < _CONVERGED or before <= largest < 1:
                return np.hstack([size * matrix @ (self.y[n_q:] + speeds), speeds])
            if not largest < 2 * before:
                return None
            before = largest
        return None

    def _error(
        self, size: float, changes: FloatArray, derivatives: FloatArray, *, again: bool
    ) -> float:
        """Error of a step in parts of the tolerance.

        The difference from the embedded formula grows with the step times the fastest rate, as the
        error does not: I - h gamma J filters it, once more if the step was rejected.
        """
        n_q, at_start = self._n_q, tableau().at_start
        by_state = np.vstack([np.eye(2 * n_q)[n_q:], derivatives])
        filtered = lu_factor(np.eye(2 * n_q) - size * at_start * by_state)
        scale = np.maximum(self._scale(self.y), self._scale(self.y + changes[-1]))
        fixed = tableau().of_error @ changes
        difference = lu_solve(filtered, size * at_start * self.f + fixed, check_finite=False)
        if again:
            rates = self.fun(self.t, self.y + difference)
            difference = lu_solve(filtered, size * at_start * rates + fixed, check_finite=False)
        return float(np.linalg.norm(difference / scale) / np.sqrt(2 * n_q))

    def _scale(self, y: FloatArray) -> FloatArray:
        rtol, atol = self._tolerance
        return atol + rtol * np.abs(y)


@dataclass(frozen=True)
class Tableau:
    """Radau IIA with seven stages."""

    nodes: FloatArray
    """c, shape (7,); the last is 1."""
    matrix: FloatArray
    """a_ij, shape (7, 7)."""
    at_start: float
    """gamma, weight of the start's rates in the embedded formula: 1 over the real eigenvalue of
    the inverse of A."""
    of_error: FloatArray
    """Weights of the changes in the embedded formula's difference, shape (7,)."""
    of_interpolant: FloatArray
    """Coefficients of :class:`.integrator.Interpolant` by the changes, shape (7, 7)."""


@cache
def tableau() -> Tableau:
    """Compute the coefficients, with Legendre's polynomials on a step, which are orthogonal."""
    nodes = np.append((roots_jacobi(_STAGES - 1, 1.0, 0.0)[0] + 1) / 2, 1.0)
    values = legvander(2 * nodes - 1, _STAGES)
    polynomials, order = values[:, :_STAGES], np.arange(1, _STAGES)
    integrals = np.column_stack([nodes, (values[:, 2:] - values[:, :-2]) / (4 * order + 2)])
    matrix = np.asarray(np.linalg.solve(polynomials.T, integrals.T).T, dtype=np.float64)
    inverse = np.linalg.inv(matrix)
    eigenvalues = np.linalg.eigvals(inverse)
    at_start = 1.0 / float(eigenvalues[np.argmin(np.abs(eigenvalues.imag))].real)
    moments = np.eye(_STAGES)[0] - at_start * (-1.0) ** np.arange(_STAGES)
    embedded = np.linalg.solve(polynomials.T, moments)
    factors = np.where(np.arange(_STAGES) % 2, 1.0 - nodes[:, None], nodes[:, None])
    return Tableau(
        nodes=nodes,
        matrix=matrix,
        at_start=at_start,
        of_error=(embedded - matrix[-1]) @ inverse,
        of_interpolant=np.linalg.inv(np.cumprod(factors, axis=1)),
    )
