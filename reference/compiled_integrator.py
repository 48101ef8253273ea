"""DOP853 in machine code: SciPy's method, coefficients and choice of steps, with steps that Numba has compiled."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from scipy.integrate import DOP853, DenseOutput

from ..models.arrays import FloatArray
from .compiled import CompiledEquations, kernel, not_unique
from .integrator import Integrator, StepLimit

# As in SciPy's RungeKutta: of the step that the error estimate promises, least and greatest change
# of a step.
_SAFETY, _LEAST_FACTOR, _GREATEST_FACTOR = 0.9, 0.2, 10.0
_EXPONENT = -1.0 / 8.0  # of the error, whose estimate is of seventh order


class CompiledIntegrator(Integrator):
    """:class:`.integrator.Integrator` of compiled equations; arguments as there."""

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
            # An error that is no number asks for the shortest step.
            size, rejected = size * np.fmax(_LEAST_FACTOR, _SAFETY * error**_EXPONENT), True
        factor = (
            _GREATEST_FACTOR if error == 0 else min(_GREATEST_FACTOR, _SAFETY * error**_EXPONENT)
        )
        self.h_previous, self.y_old = size, self.y
        self.t, self.y, self.f = t, end, stages[-1]
        self.h_abs, self._stages = size * (min(1.0, factor) if rejected else factor), stages
        return True, None

    def _dense_output_impl(self) -> DenseOutput:
        extra, weights = _extra()
        coefficients = kernel().dense_output(
            self.y_old,
            self.y,
            self._stages,
            self.h_previous,
            extra,
            weights,
            self._equations.arrays,
        )
        self.nfev += len(extra)
        return Interpolant(
            self.t_old, self.t, np.asarray(self.y_old, dtype=np.float64), coefficients
        )


class Interpolant(DenseOutput):
    """DOP853's polynomial of seventh degree over one step."""

    def __init__(self, start: float, end: float, y: FloatArray, coefficients: FloatArray) -> None:
        super().__init__(start, end)
        self._size, self._coefficients = end - start, coefficients
        self._y = np.ascontiguousarray(
            y
        )  # one layout, as in the compiled equations: pickling makes it so

    def _call_impl(self, t: FloatArray) -> FloatArray:
        parts = (np.atleast_1d(t) - self.t_old) / self._size
        values = kernel().interpolate(parts, self._y, self._coefficients)
        return values if np.ndim(t) else values[:, 0]


@cache
def _tableau() -> tuple[Any, ...]:
    """Stages and the end's weights as the last row, and the weights of both error estimates."""
    return np.ascontiguousarray(np.vstack([DOP853.A, DOP853.B])), DOP853.E5, DOP853.E3


@cache
def _extra() -> tuple[Any, ...]:
    """Three further stages, and the weights of the interpolant's coefficients."""
    return np.ascontiguousarray(DOP853.A_EXTRA), np.ascontiguousarray(DOP853.D)
