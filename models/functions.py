r"""Functions of a mechanism's coordinates: points as complex numbers z = x + i y, and scalars.

With absolute angles every point is a plain sum,

    z = z_0 + sum_k c_k w_k,    w_k = exp(-i q_k) of an angle, w_k = q_k of a slide along a line
                                that does not turn, w_k = q_k exp(-i q_c) of a slide along a line
                                that turns with the angle q_c,

with constant complex coefficients c_k (positive clockwise: the exponent is -i q). So a point is a
row of coefficients, and velocities and accelerations follow by differentiating w alone. Its
derivatives are dw_k/dq_k, the rates, and for a slide on a turning line dw_k/dq_c = -i q_k dw_k/dq_k
as well. Of n mechanisms as one (:mod:`.stacked`) coefficients and constants have a first axis of
that length.

A stop or a loop joint constrains a scalar function: an angle, or a component of a vector.
"""

from __future__ import annotations

from cmath import exp
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from operator import mul
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from .arrays import ComplexArray, FloatArray

# Numbers of a product that BLAS still takes in one thread. Two threads take microseconds to share
# 8000 of them, but on a busy machine milliseconds to meet.
_BLOCK = 2048


@dataclass(frozen=True)
class PointCoefficients:
    """A body's point as coefficients over the coordinates: z = offset + coefficients . w(q)."""

    offset: complex
    coefficients: ComplexArray


class Phasors:
    """w(q) of a mechanism and its derivatives; arrays of states are shaped (n, n_q)."""

    @cached_property
    def is_angle(self) -> FloatArray:
        """1.0 for an angle, 0.0 for a slide; shape (n_q,)."""
        raise NotImplementedError

    @cached_property
    def carried(self) -> tuple[tuple[int, int], ...]:
        """Index of each slide along a line that turns, and of the angle that it turns with."""
        raise NotImplementedError

    def phasors(self, q: FloatArray) -> ComplexArray:
        """w(q), shape like q."""
        w = np.where(self.is_angle > 0, np.exp(-1j * q), q)
        for k, c in self.carried:
            w[..., k] *= w[..., c]
        return w

    @cached_property
    def _rates_at_zero(self) -> tuple[ComplexArray, ComplexArray]:
        """Rate of each coordinate at q = 0, and the factor of q in its exponent."""
        exponent = np.asarray(-1j * self.is_angle, dtype=np.complex128)
        return np.where(self.is_angle > 0, -1j, 1.0 + 0j), exponent

    @cached_property
    def _turns(self) -> list[bool]:
        return (self.is_angle > 0).tolist()

    def rates(self, q: FloatArray) -> ComplexArray:
        """dw_k/dq_k, shape like q.

        It is -i exp(-i q) for an angle, 1 for a slide, exp(-i q_c) for one on a turning line.
        """
        at_zero, exponent = self._rates_at_zero
        rates = at_zero * np.exp(exponent * q)
        for k, c in self.carried:
            rates[..., k] = 1j * rates[..., c]
        return rates

    def curvature(
        self, q: FloatArray, u: FloatArray, rates: ComplexArray | None = None
    ) -> ComplexArray:
        """d2w/dt2 without accelerations of q, shape like q."""
        rates = self.rates(q) if rates is None else rates
        curvature = -1j * self.is_angle * rates * u * u
        for k, c in self.carried:
            spin = u[..., c]
            curvature[..., k] = -rates[..., k] * spin * (2j * u[..., k] + q[..., k] * spin)
        return curvature

    def gradient(
        self, coefficients: ComplexArray, q: FloatArray, rates: ComplexArray
    ) -> ComplexArray:
        """d(coefficients . w)/dq for a row or several, shape (..., n_q)."""
        gradient = rates * coefficients
        for k, c in self.carried:
            gradient[..., c] += gradient[..., k] * -1j * q[..., k]
        return gradient

    def amplitudes(self, coefficients: ComplexArray) -> FloatArray:
        """Largest values of a gradient, with slides on turning lines at 1 m; shape (n_q,)."""
        amplitudes = np.abs(coefficients)
        for k, c in self.carried:
            amplitudes[c] += amplitudes[k]
        return amplitudes

    def flow(self, q: FloatArray, u: FloatArray, rates: ComplexArray) -> ComplexArray:
        """dw/dt for speeds u, shape like q."""
        flow = rates * u
        for k, c in self.carried:
            flow[..., k] -= 1j * q[..., k] * rates[..., k] * u[..., c]
        return flow

    def rate_alone(
        self, coefficients: Sequence[complex], q: Sequence[float], u: Sequence[float]
    ) -> complex:
        """Rate of one point in one state [m/s]: :meth:`rate` in a tenth of the time of arrays."""
        rates = [
            -1j * exp(-1j * angle) if turns else 1.0
            for angle, turns in zip(q, self._turns, strict=False)
        ]
        flow = [rate * speed for rate, speed in zip(rates, u, strict=True)]
        for k, c in self.carried:
            rate = 1j * rates[c]
            flow[k] = rate * u[k] - 1j * q[k] * rate * u[c]
        return sum(map(mul, flow, coefficients), 0j)

    def second_flow(self, q: FloatArray, u: FloatArray, a: FloatArray) -> ComplexArray:
        """d2w/dt2 for speeds u and accelerations a, shape like q."""
        rates = self.rates(q)
        return self.flow(q, a, rates) + self.curvature(q, u, rates)

    def vector(self, row: PointCoefficients, q: FloatArray) -> ComplexArray:
        """A point, or the vector between two, as a complex number [m], shape (...,)."""
        w, c = self.phasors(q), row.coefficients
        return row.offset + (weighted(w, c) if c.ndim == 1 else np.sum(w * c, axis=-1))

    def rate(self, row: PointCoefficients, q: FloatArray, u: FloatArray) -> ComplexArray:
        """Its derivative with respect to time [m/s], shape (...,)."""
        return weighted(self.flow(q, u, self.rates(q)), row.coefficients)


def weighted(w: ComplexArray, coefficients: ComplexArray) -> ComplexArray:
    """The product w @ coefficients, shape (...,), of as many states as there are in one thread.

    Args:
        w: or a derivative of it, shape (..., n_q).
        coefficients: shape (n_q,).
    """
    rows = max(_BLOCK // coefficients.shape[0], 1)
    if w.ndim == 1 or w.shape[0] <= rows:
        return w @ coefficients
    return np.concatenate([w[k : k + rows] @ coefficients for k in range(0, w.shape[0], rows)])


@dataclass(frozen=True)
class AngleFunction:
    """A linear function of angles [rad], or a slide [m]: constant + coefficients . q."""

    constant: float
    coefficients: FloatArray
    is_length: bool = False
    """True where its unit is [m], not [rad]."""

    @property
    def amplitudes(self) -> FloatArray:
        """The greatest values of its derivatives, shape (n_q,)."""
        return np.abs(self.coefficients)

    def value(self, q: FloatArray) -> FloatArray:
        """Shape (...,)."""
        return q @ self.coefficients + self.constant

    def jacobian(self, q: FloatArray, rates: ComplexArray) -> FloatArray:
        """Shape (n_q,): the same in every state."""
        return self.coefficients

    def outer(self, size: ArrayLike) -> FloatArray:
        """A number, shape (...,), times the gradient's product with itself, (..., n_q, n_q)."""
        return np.asarray(size)[..., None, None] * np.outer(self.coefficients, self.coefficients)

    def bias(self, q: FloatArray, u: FloatArray, curvature: ComplexArray) -> FloatArray:
        """d/dt(Jacobian) u: 0."""
        return np.zeros(curvature.shape[:-1])


@dataclass(frozen=True)
class PointFunction:
    """A point's component in a fixed direction: constant + Re(coefficients . w(q)) [m]."""

    is_length: ClassVar[bool] = True
    phasors: Phasors
    constant: float
    coefficients: ComplexArray

    @property
    def amplitudes(self) -> FloatArray:
        """Largest values of its derivatives, with slides on turning lines at 1 m; shape (n_q,)."""
        return self.phasors.amplitudes(self.coefficients)

    def value(self, q: FloatArray) -> FloatArray:
        """Shape (...,)."""
        return self.phasors.vector(PointCoefficients(self.constant, self.coefficients), q).real

    def jacobian(self, q: FloatArray, rates: ComplexArray) -> FloatArray:
        """Shape (..., n_q)."""
        return self.phasors.gradient(self.coefficients, q, rates).real

    def bias(self, q: FloatArray, u: FloatArray, curvature: ComplexArray) -> FloatArray:
        """d/dt(Jacobian) u, shape (...,)."""
        return weighted(curvature, self.coefficients).real


@dataclass(frozen=True)
class LineFunction:
    r"""A point's component in a direction that turns with the angle q_b [m].

    It is Re(conj(d) e^{i q_b} (z_0 + c . w)) + constant, where z_0 + c . w is the vector to the
    point from one of the body b, and d the direction in its frame.
    """

    is_length: ClassVar[bool] = True
    phasors: Phasors
    constant: float
    direction: complex
    body: int
    """Index of the angle."""
    vector: PointCoefficients

    @property
    def amplitudes(self) -> FloatArray:
        """The greatest values of its derivatives, shape (n_q,)."""
        amplitudes = self.phasors.amplitudes(self.vector.coefficients)
        amplitudes[self.body] += abs(self.vector.offset) + amplitudes.sum()
        return amplitudes

    def _turned(self, q: FloatArray) -> ComplexArray:
        return self.direction.conjugate() * np.exp(1j * q[..., self.body])

    def value(self, q: FloatArray) -> FloatArray:
        """Shape (...,)."""
        return (self._turned(q) * self.phasors.vector(self.vector, q)).real + self.constant

    def jacobian(self, q: FloatArray, rates: ComplexArray) -> FloatArray:
        """Shape (..., n_q)."""
        turned = self._turned(q)
        gradient = turned[..., None] * self.phasors.gradient(self.vector.coefficients, q, rates)
        gradient[..., self.body] += 1j * turned * self.phasors.vector(self.vector, q)
        return gradient.real

    def bias(self, q: FloatArray, u: FloatArray, curvature: ComplexArray) -> FloatArray:
        """d/dt(Jacobian) u, shape (...,)."""
        phasors, spin = self.phasors, u[..., self.body]
        coriolis = 2j * spin * phasors.rate(self.vector, q, u)
        apparent = weighted(curvature, self.vector.coefficients) + coriolis
        apparent -= spin**2 * phasors.vector(self.vector, q)
        return (self._turned(q) * apparent).real


ScalarFunction = AngleFunction | PointFunction | LineFunction
"""A function of q that a constraint holds at zero, or at or above zero."""


def linear_form(function: ScalarFunction) -> AngleFunction | None:
    """The function as one that is linear in the coordinates; None if it is not.

    A point's component along the line on which its body slides is linear, whether the line turns
    or not.
    """
    match function:
        case AngleFunction():
            return function
        case PointFunction():
            phasors, still = function.phasors, function.coefficients
            moved = [k for k, turns in enumerate(phasors.is_angle) if turns]
            moved += [k for k, _ in phasors.carried]
            constant = function.constant
        case LineFunction():
            phasors, along = function.phasors, function.direction.conjugate()
            still, own = along * function.vector.coefficients, function.body
            slides = {k for k, carrier in phasors.carried if carrier == own}
            moved = [k for k in range(len(still)) if k not in slides and k != own]
            constant = function.constant + still[own].real
            still = np.asarray(still * (np.arange(len(still)) != own), dtype=np.complex128)
            if function.vector.offset != 0:
                return None
    if still[moved].any():
        return None
    return AngleFunction(constant, np.ascontiguousarray(still.real), is_length=True)
