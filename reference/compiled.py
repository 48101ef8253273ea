"""Accelerations and multipliers in machine code, where Numba is installed.

A mechanism of a few bodies spends its time in the calls of NumPy's functions and not in their
arithmetic: Numba's code takes a tenth of it. It is compiled once for all mechanisms and kept on
disk. Its results differ from those of :mod:`.equations` by rounding.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any

import numpy as np

from ..models.arrays import ComplexArray, FloatArray, IndexArray
from ..models.errors import SimulationError
from ..models.functions import PointFunction, ScalarFunction, linear_form
from ..models.kinematics import Kinematics

MOST_UNKNOWNS = 24
"""Accelerations and multipliers up to which this is faster than NumPy's assembly and LAPACK."""

_LARGEST = 1e100
"""Mass, moment or weight in SI beyond which LAPACK is used: it scales, and finds overflow."""


@dataclass(frozen=True)
class Added:
    """Forces c - S (q - q0) - D u - r M u beside those of the mechanism, with its mass matrix M."""

    constant: FloatArray
    """c, shape (n_q,)."""
    stiffness: FloatArray
    """S, symmetric, shape (n_q, n_q)."""
    relaxed: FloatArray
    """q0, shape (n_q,)."""
    damping: FloatArray
    """D, shape (n_q, n_q)."""
    rate: float = 0.0
    """r [1/s]."""
    centrifugal: bool = True
    """Whether the mechanism's own velocity-dependent forces act."""

    @classmethod
    def none(cls, n_q: int) -> Added:
        """Add nothing beside them."""
        return cls(np.zeros(n_q), np.zeros((n_q, n_q)), np.zeros(n_q), np.zeros((n_q, n_q)))

    def plus(self, other: Added) -> Added:
        """Both, with the rate and the velocity-dependent forces of the other."""
        return replace(
            other,
            constant=self.constant
            + self.stiffness @ self.relaxed
            + other.constant
            + other.stiffness @ other.relaxed,
            stiffness=self.stiffness + other.stiffness,
            relaxed=np.zeros_like(self.relaxed),
            damping=self.damping + other.damping,
        )

    @cached_property
    def arrays(self) -> tuple[Any, ...]:
        """Arrays in the order in which the kernel takes them."""
        constant = self.constant + self.stiffness @ self.relaxed
        return constant, self.stiffness, self.damping, float(self.rate), self.centrifugal


@dataclass(frozen=True)
class CompiledEquations:
    """The equations under one set of constraints, as arrays."""

    name: str
    """Name of the mechanism."""
    n_q: int
    angles: FloatArray
    """1 for an angle, 0 for a slide, shape (n_q,)."""
    carried: IndexArray
    """Slides along lines that turn, and their angles, shape (n, 2)."""
    products: ComplexArray
    weights: ComplexArray
    """Conjugate of the weights W."""
    inertias: FloatArray
    added: Added
    point_rows: ComplexArray
    """Rows of the constraints; zero for one on angles, shape (n_constraints, n_q)."""
    angle_rows: FloatArray
    """Rows of the constraints; zero for one on points, shape (n_constraints, n_q)."""

    @cached_property
    def arrays(self) -> tuple[Any, ...]:
        """Arrays, in the order in which the kernel takes them."""
        matrices = self.products, self.weights, self.inertias, self.added.arrays
        return (self.angles, self.carried, *matrices, self.point_rows, self.angle_rows)

    def solve(self, q: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Accelerations and multipliers of states of shape (n_q,) or (n, n_q).

        Raises:
            SimulationError: there are no unique ones.
        """
        # One layout of the arrays: Numba compiles anew, and rounds in another way, for each.
        positions, speeds = (np.ascontiguousarray(np.atleast_2d(values)) for values in (q, u))
        solution, regular = kernel().solve(positions, speeds, self.arrays)
        if not regular:
            raise not_unique(self.name)
        solution = solution.reshape(*q.shape[:-1], -1)
        return solution[..., : self.n_q], solution[..., self.n_q :]

    def rates(self, t: float, y: FloatArray) -> FloatArray:
        """Time derivative of the state (q, u), shape (2 n_q,)."""
        return np.concatenate([y[self.n_q :], self.solve(y[: self.n_q], y[self.n_q :])[0]])


def not_unique(name: str) -> SimulationError:
    """The error of a mechanism without unique accelerations."""
    return SimulationError(
        f"{name!r} has no unique accelerations in a state it comes to: a body without inertia "
        "about its joint, or a singular position, in which its constraints are dependent."
    )


@cache
def kernel() -> Any:
    """The compiled functions; importing them takes a third of a second."""
    from . import kernel as functions

    return functions


@cache
def is_available() -> bool:
    """Tell whether Numba is installed."""
    return importlib.util.find_spec("numba") is not None


def interpolated(parts: FloatArray, y: FloatArray, coefficients: FloatArray) -> FloatArray:
    """DOP853's interpolant at parts of a step from y, shape (n_states, n), also without Numba."""
    if is_available():
        return kernel().interpolate(parts, y, coefficients)
    values, factors = np.zeros((len(y), len(parts))), (parts, 1.0 - parts)
    for k, row in enumerate(coefficients[::-1]):
        values = (values + row[:, None]) * factors[k % 2]
    return values + y[:, None]


def compiled_equations(
    kinematics: Kinematics,
    matrices: tuple[ComplexArray, ComplexArray, FloatArray],
    added: Added,
    functions: Sequence[ScalarFunction],
) -> CompiledEquations | None:
    """The compiled equations; None without Numba, or if the mechanism is too large or unusual.

    Args:
        matrices: K, W and the inertias of :mod:`.equations`.
        added: forces that a fault adds.
        functions: of the constraints, which must be independent.
    """
    n_q, n_c = len(kinematics.is_angle), len(functions)
    products, weights, inertias = matrices
    extreme = max(np.abs(products).max(), np.abs(weights).max(), np.abs(inertias).max()) > _LARGEST
    if n_q + n_c > MOST_UNKNOWNS or extreme or not is_available():
        return None
    points, angles = np.zeros((n_c, n_q), dtype=np.complex128), np.zeros((n_c, n_q))
    for k, function in enumerate(functions):
        if isinstance(function, PointFunction):
            points[k] = function.coefficients
        elif (linear := linear_form(function)) is not None:
            angles[k] = linear.coefficients
        else:
            return None
    return CompiledEquations(
        name=kinematics.mechanism.name,
        n_q=n_q,
        angles=kinematics.is_angle,
        carried=np.array(kinematics.carried, dtype=np.intp).reshape(-1, 2),
        products=np.ascontiguousarray(products),
        weights=weights.conj(),
        inertias=inertias,
        added=added,
        point_rows=points,
        angle_rows=angles,
    )
