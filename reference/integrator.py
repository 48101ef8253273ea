"""SciPy's DOP853 with limits: an integration that gets nowhere ends with one sentence.

Near a singular position of a loop of joints the rounding of its equations exceeds the tolerance
however short the step, so that steps are accepted that hardly advance. A part that swings a million
times faster than the machine moves takes a million times the steps. Neither ends by itself, and
each step's dense output is kept.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from contextlib import contextmanager
from functools import cache
from typing import Any, cast

import numpy as np
from scipy.integrate import DOP853, DenseOutput
from threadpoolctl import ThreadpoolController

from ..models.arrays import FloatArray
from ..models.errors import SimulationError, TrebucheckError
from .compiled import CompiledEquations, interpolated, kernel, not_unique

MOST_STEPS = 500_000
"""Limit of one motion, over all its segments; Table I's machine takes some 50 to 100 a second."""

_MOST_MEMORY = 1 << 30  # [B] of the dense output
_WINDOW = 500  # steps over which progress is measured
_HOPELESS = 100  # times the most steps, as many as the rest would take at this pace


class StepLimit:
    """Counts the steps of one motion, over its segments.

    Args:
        states: length of the state vector.
        end: of the motion [s].
        most: steps, in whole windows of 500, if fewer than are possible.
    """

    def __init__(self, states: int, end: float, most: int = MOST_STEPS) -> None:
        self.end = end
        # 8 vectors a step, and their objects.
        most = min(most, MOST_STEPS, _MOST_MEMORY // (500 + 64 * states))
        self.most = most // _WINDOW * _WINDOW
        self._taken, self._marked = 0, 0.0
        self.is_stiff = False
        """Whether the segment before ended with an implicit method."""

    def count(self, t: float) -> None:
        """Count one step that ended at t [s].

        Raises:
            SimulationError: there are too many, or at this pace there will be.
        """
        self._taken += 1
        if self._taken % _WINDOW:
            return
        pace = (t - self._marked) / _WINDOW
        left = (self.end - t) / pace if pace > 0 else np.inf
        if self._taken >= self.most or left > _HOPELESS * self.most:
            raise SimulationError(
                f"the reference gave up at t = {t:.9g} s of {self.end:.6g} s after {self._taken} "
                f"steps, the last of {pace:.2g} s: the motion is near a singular position of its "
                "joints, or a part moves too fast; a shorter duration may be within reach."
            )
        self._marked = t


class Integrator(DOP853):
    """DOP853 that raises where SciPy's would return a message, warn, or go on without end.

    Args:
        rates: of the state y at t [s].
        start, end: [s].
        y: state at the start, shape (n,).
        tolerance: relative and absolute local error bounds.
        limit: of the motion that this is a segment of; one of its own if left out.
        longest: step [s].
    """

    def __init__(
        self,
        rates: Callable[[float, FloatArray], FloatArray],
        start: float,
        y: FloatArray,
        end: float,
        tolerance: tuple[float, float],
        limit: StepLimit | None = None,
        longest: float = np.inf,
    ) -> None:
        self._rates, self._tolerance = rates, tolerance
        self.limit = limit or StepLimit(len(y), end)
        with numerical(f"at t = {start:.6g} s"):
            rtol, atol = tolerance
            function: Any = rates
            super().__init__(function, start, y, end, max_step=longest, rtol=rtol, atol=atol)
            if not (np.isfinite(self.f).all() and np.isfinite(self.h_abs)):
                raise SimulationError(
                    f"the reference's accelerations are not finite at t = {start:.6g} s."
                )

    def step(self) -> None:
        """Take one step.

        Raises:
            SimulationError: the step size collapsed, the equations are singular, or a limit is
                reached.
        """
        with numerical(f"after t = {self.t:.6g} s"):
            message = super().step()
        if message is not None:
            raise SimulationError(
                f"the reference's integrator stopped at t = {self.t:.6g} s: {message.rstrip('.')}."
            )
        self.limit.count(self.t)

    def go_on(self, t: float, y: FloatArray) -> None:
        """Go on from a later state, to which another method has moved the mechanism.

        Args:
            t: time of the state [s].
            y: the state, shape (n,).
        """
        evaluations = self.nfev
        rates, (rtol, atol) = cast("Any", self._rates), self._tolerance
        super().__init__(rates, t, y, self.t_bound, max_step=self.max_step, rtol=rtol, atol=atol)
        self.nfev += evaluations
        if t >= self.t_bound:
            self.status = "finished"


_blas = cache(ThreadpoolController)


@contextmanager
def one_thread() -> Generator[None]:
    """Computing in which linear algebra runs in one thread.

    Two threads share a system of a hundred unknowns in less time than they take to meet, and on a
    busy machine they wait for each other a hundred times longer.
    """
    with _blas().limit(limits=1, user_api="blas"):
        yield


@contextmanager
def numerical(when: str) -> Generator[None, None, None]:
    """Context of computations that may leave the finite numbers: one error for what fails.

    Whoever uses this checks that the result is finite.

    Raises:
        SimulationError: a matrix is singular, or a root or complementarity problem is not solved.
    """
    try:
        with np.errstate(all="ignore"):
            yield
    except TrebucheckError:
        raise
    except np.linalg.LinAlgError as error:
        raise SimulationError(
            f"the reference cannot go on {when}: its equations are singular ({error}); a body "
            "without inertia, or joints and stops that depend on each other, may be the cause."
        ) from error
    except (ArithmeticError, ValueError, RuntimeError) as error:
        raise SimulationError(f"the reference cannot go on {when}: {error}.") from error


def refuse_infinite(what: str, *values: FloatArray) -> None:
    """Raise SimulationError if a number of the reference is not finite.

    Args:
        what: the quantity, in the plural.
        values: of any shapes.
    """
    if not all(np.isfinite(value).all() for value in values):
        raise SimulationError(
            f"the reference's {what} are not finite: the machine's numbers are too large or too "
            "small."
        )


# As in SciPy's RungeKutta: of the step that the error estimate promises, least and greatest change
# of a step.
_SAFETY, _LEAST_FACTOR, _GREATEST_FACTOR = 0.9, 0.2, 10.0
_EXPONENT = -1.0 / 8.0  # of the error, whose estimate is of seventh order


def step_factor(error: float) -> float:
    """Ratio of the next step to one with an error in parts of the tolerance."""
    if error == 0:
        return _GREATEST_FACTOR
    # An error that is no number asks for the shortest step.
    return float(min(_GREATEST_FACTOR, np.fmax(_LEAST_FACTOR, _SAFETY * error**_EXPONENT)))


class CompiledIntegrator(Integrator):
    """:class:`Integrator` whose steps run in machine code; arguments as there.

    Method, coefficients and choice of steps are SciPy's.
    """

    def __init__(
        self,
        equations: CompiledEquations,
        start: float,
        y: FloatArray,
        end: float,
        tolerance: tuple[float, float],
        limit: StepLimit | None = None,
        longest: float = np.inf,
    ) -> None:
        self._equations = equations
        super().__init__(equations.rates, start, y, end, tolerance, limit, longest)

    def _step_impl(self) -> tuple[bool, str | None]:
        """One step, as short as its error asks for."""
        least = 10 * abs(float(np.nextafter(self.t, np.inf)) - self.t)
        size, rejected = float(np.clip(self.h_abs, least, self.max_step)), False
        while True:
            if not size >= least:
                return False, self.TOO_SMALL_STEP
            t = min(self.t + size, self.t_bound)
            size = t - self.t
            end, stages, error, regular = kernel().step(
                self.y, self.f, size, _tableau(), self._tolerance, self._equations.arrays
            )
            if not regular:
                raise not_unique(self._equations.name)
            self.nfev += len(stages) - 1
            if error < 1:
                break
            size, rejected = size * step_factor(error), True
        factor = step_factor(error)
        self.h_previous, self.y_old = size, self.y
        self.t, self.y, self.f = t, end, stages[-1]
        self.h_abs, self._stages = size * (min(1.0, factor) if rejected else factor), stages
        return True, None

    def _dense_output_impl(self) -> DenseOutput:
        extra, weights = np.ascontiguousarray(DOP853.A_EXTRA), np.ascontiguousarray(DOP853.D)
        step = self.y_old, self.y, self._stages, self.h_previous
        coefficients = kernel().dense_output(*step, extra, weights, self._equations.arrays)
        self.nfev += len(extra)
        start = np.asarray(self.y_old, dtype=np.float64)
        return Interpolant(self.t_old, self.t, start, coefficients)


class Interpolant(DenseOutput):
    """DOP853's polynomial of seventh degree over one step.

    With the part x of the step it is the start + x (c_0 + (1 - x) (c_1 + x (c_2 + ...))), with the
    rows c_k of the coefficients, shape (7, n): no change from the start exceeds sum |c_k|.
    """

    def __init__(self, start: float, end: float, y: FloatArray, coefficients: FloatArray) -> None:
        super().__init__(start, end)
        self._size, self.coefficients = end - start, coefficients
        # One layout, as in the compiled equations: pickling makes it so.
        self.start_state = np.ascontiguousarray(y)

    def _call_impl(self, t: FloatArray) -> FloatArray:
        parts = (np.atleast_1d(t) - self.t_old) / self._size
        values = interpolated(parts, self.start_state, self.coefficients)
        return values if np.ndim(t) else values[:, 0]


@cache
def _tableau() -> tuple[Any, ...]:
    """Stages and the end's weights as the last row, and the weights of both error estimates."""
    return np.ascontiguousarray(np.vstack([DOP853.A, DOP853.B])), DOP853.E5, DOP853.E3
