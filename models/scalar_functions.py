"""Scalar functions of the coordinates, which a stop or a loop holds: angles, and components of vectors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .arrays import ComplexArray, FloatArray
from .phasors import Phasors, PointCoefficients, weighted


@dataclass(frozen=True)
class AngleFunction:
    """A difference of angles: constant + coefficients . q [rad]; linear, so its Jacobian is constant."""

    constant: float
    coefficients: FloatArray

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

    def bias(self, q: FloatArray, u: FloatArray, curvature: ComplexArray) -> FloatArray:
        """d/dt(Jacobian) u: 0."""
        return np.zeros(curvature.shape[:-1])


@dataclass(frozen=True)
class PointFunction:
    """A point's component in a direction that does not turn: constant + Re(coefficients . w(q)) [m]."""

    phasors: Phasors
    constant: float
    coefficients: ComplexArray

    @property
    def amplitudes(self) -> FloatArray:
        """The greatest values of its derivatives, shape (n_q,); of slides on turning lines, with these at 1 m."""
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
        apparent = weighted(curvature, self.vector.coefficients) + 2j * spin * phasors.rate(
            self.vector, q, u
        )
        apparent -= spin**2 * phasors.vector(self.vector, q)
        return (self._turned(q) * apparent).real


ScalarFunction = AngleFunction | PointFunction | LineFunction
"""A function of q that a constraint holds at zero, or at or above zero."""
