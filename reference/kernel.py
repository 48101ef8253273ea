"""Kernel of :mod:`.compiled`, compiled by Numba: imported when first needed.

It is written in loops over numbers, which take machine code no longer than operations on whole
arrays and Numba a third of the time to compile. Its arguments are the fields of
:class:`.compiled.CompiledEquations`.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np


def _compiled(function: Any) -> Any:
    return numba.njit(cache=True)(function)


def _inlined(function: Any) -> Any:
    """Inlined where it is called: half the time of compiling it by itself, too."""
    return numba.njit(inline="always")(function)


@_inlined
def _fill_rates(q: Any, u: Any, angles: Any, carried: Any, rates: Any, curvature: Any) -> None:
    """Rates dw_k/dq_k and the second derivative of w without accelerations."""
    for i in range(len(q)):
        rates[i] = complex(-np.sin(q[i]), -np.cos(q[i])) if angles[i] > 0 else complex(1.0, 0.0)
        curvature[i] = -1j * angles[i] * rates[i] * u[i] * u[i]
    for k, i in carried:
        rates[k] = 1j * rates[i]
        curvature[k] = -rates[k] * u[i] * (2j * u[k] + q[k] * u[i])


@_inlined
def _add_carried(row: Any, q: Any, carried: Any) -> None:
    """Complete a gradient by what slides on turning lines add to it."""
    for k, i in carried:
        row[i] += row[k] * (-1j * q[k])


@_inlined
def _fill_mass(
    matrix: Any, q: Any, carried: Any, products: Any, inertias: Any, rates: Any, moved: Any
) -> None:
    """Re(J^H K J) + I, by way of K J."""
    n = len(q)
    for i in range(n):
        for j in range(n):
            moved[i, j] = products[i, j] * rates[j]
        _add_carried(moved[i], q, carried)
    for j in range(n):
        for i in range(n):
            moved[i, j] = rates[i].conjugate() * moved[i, j]
        for k, i in carried:
            moved[i, j] += moved[k, j] * (1j * q[k])
        for i in range(n):
            matrix[i, j] = moved[i, j].real + inertias[i, j]


@_inlined
def _fill_forces(
    right: Any, q: Any, carried: Any, products: Any, weights: Any, rates: Any, curvature: Any,
    centrifugal: bool,
) -> None:  # fmt: skip
    """Q - b = Re(J^H (W - K dJ/dt u)), or Q alone."""
    n = len(q)
    row = np.empty(n, dtype=np.complex128)
    for i in range(n):
        total = weights[i]
        if centrifugal:
            for j in range(n):
                total -= (products[i, j] * curvature[j]).conjugate()
        row[i] = total * rates[i]
    _add_carried(row, q, carried)
    for i in range(n):
        right[i] = row[i].real


@_inlined
def _add_linear(
    right: Any, matrix: Any, q: Any, u: Any, constant: Any, stiffness: Any, damping: Any, rate: Any
) -> None:
    """Add c - S q - (D + r M) u."""
    for i in range(len(q)):
        force = constant[i]
        for j in range(len(q)):
            force -= stiffness[i, j] * q[j] + (damping[i, j] + rate * matrix[i, j]) * u[j]
        right[i] += force


@_inlined
def _fill_constraints(
    matrix: Any, right: Any, q: Any, carried: Any, point_rows: Any, angle_rows: Any, rates: Any,
    curvature: Any,
) -> None:  # fmt: skip
    """G, -G^T and -gamma."""
    n, m = len(q), len(point_rows)
    row = np.empty(n, dtype=np.complex128)
    for a in range(m):
        bias = 0.0
        for i in range(n):
            row[i] = point_rows[a, i] * rates[i]
            bias += (point_rows[a, i] * curvature[i]).real
        _add_carried(row, q, carried)
        right[n + a] = -bias
        for i in range(n):
            matrix[n + a, i] = row[i].real + angle_rows[a, i]
            matrix[i, n + a] = -matrix[n + a, i]
        for b in range(m):
            matrix[n + a, n + b] = 0.0


@_inlined
def _pivoted(matrix: Any, right: Any, k: int) -> bool:
    """Bring the largest entry of a column to its diagonal; False if all are zero."""
    pivot = k
    for i in range(k + 1, len(right)):
        if abs(matrix[i, k]) > abs(matrix[pivot, k]):
            pivot = i
    if pivot != k:
        for j in range(k, len(right)):
            matrix[k, j], matrix[pivot, j] = matrix[pivot, j], matrix[k, j]
        right[k], right[pivot] = right[pivot], right[k]
    return matrix[k, k] != 0.0


@_inlined
def _eliminate(matrix: Any, right: Any) -> bool:
    """Solve in place by Gauss' elimination with row pivoting; False if a pivot is zero."""
    n = len(right)
    for k in range(n):
        if not _pivoted(matrix, right, k):
            return False
        for i in range(k + 1, n):
            factor = matrix[i, k] / matrix[k, k]
            if factor != 0.0:
                for j in range(k + 1, n):
                    matrix[i, j] -= factor * matrix[k, j]
                right[i] -= factor * right[k]
    for k in range(n - 1, -1, -1):
        for j in range(k + 1, n):
            right[k] -= matrix[k, j] * right[j]
        right[k] /= matrix[k, k]
    return True


@_compiled
def solve(positions: Any, speeds: Any, arrays: Any) -> Any:
    """Accelerations and multipliers, shape (n, n_q + n_constraints), and if they are unique."""
    angles, carried, products, weights, inertias, added, point_rows, angle_rows = arrays
    constant, stiffness, damping, rate, centrifugal = added
    (n_states, n), m = positions.shape, len(point_rows)
    solution, matrix = np.empty((n_states, n + m)), np.empty((n + m, n + m))
    rates, curvature = np.empty(n, dtype=np.complex128), np.empty(n, dtype=np.complex128)
    moved, regular = np.empty((n, n), dtype=np.complex128), True
    for state in range(n_states):
        q, right = positions[state], solution[state]
        _fill_rates(q, speeds[state], angles, carried, rates, curvature)
        _fill_mass(matrix, q, carried, products, inertias, rates, moved)
        _fill_forces(right, q, carried, products, weights, rates, curvature, centrifugal)
        _add_linear(right, matrix, q, speeds[state], constant, stiffness, damping, rate)
        _fill_constraints(matrix, right, q, carried, point_rows, angle_rows, rates, curvature)
        regular = _eliminate(matrix, right) and regular
    return solution, regular


@_inlined
def _fill_stages(stages: Any, y: Any, h: float, coefficients: Any, arrays: Any) -> bool:
    """Rates of the last stages of a Runge-Kutta step, a row of coefficients each."""
    n, regular, first = len(y) // 2, True, len(stages) - len(coefficients)
    positions, speeds = np.empty((1, n)), np.empty((1, n))
    for s in range(first, first + len(coefficients)):
        for i in range(n):
            positions[0, i] = _advanced(y, stages, i, h, coefficients[s - first], s)
            speeds[0, i] = _advanced(y, stages, n + i, h, coefficients[s - first], s)
        solution, unique = solve(positions, speeds, arrays)
        for i in range(n):
            stages[s, i], stages[s, n + i] = speeds[0, i], solution[0, i]
        regular = regular and unique
    return regular


@_inlined
def _advanced(y: Any, stages: Any, i: int, h: float, coefficients: Any, count: int) -> float:
    """A component of the state, moved on by the first stages."""
    value = y[i]
    for k in range(count):
        value += h * coefficients[k] * stages[k, i]
    return value


@_inlined
def _weighted(weights: Any, stages: Any, i: int) -> float:
    """A component of the weighted sum of stages."""
    total = 0.0
    for k in range(len(weights)):
        total += weights[k] * stages[k, i]
    return total


@_compiled
def step(y: Any, f: Any, h: float, tableau: Any, tolerance: Any, arrays: Any) -> Any:
    """One step of DOP853: end, stages, error over tolerance, and if accelerations are unique."""
    matrix, error_5, error_3 = tableau
    stages, end = np.empty((len(matrix), len(y))), np.empty(len(y))
    for i in range(len(y)):
        stages[0, i] = f[i]
    regular = _fill_stages(stages, y, h, matrix[1:], arrays)
    fifth, third = 0.0, 0.0
    for i in range(len(y)):
        end[i] = _advanced(y, stages, i, h, matrix[-1], matrix.shape[1])
        scale = tolerance[1] + tolerance[0] * max(abs(y[i]), abs(end[i]))
        fifth += (_weighted(error_5, stages, i) / scale) ** 2
        third += (_weighted(error_3, stages, i) / scale) ** 2
    error = 0.0
    if fifth > 0.0 or third > 0.0:
        error = abs(h) * fifth / np.sqrt((fifth + 0.01 * third) * len(y))
    return end, stages, error, regular


@_compiled
def dense_output(
    y: Any, end: Any, stages: Any, h: float, extra: Any, weights: Any, arrays: Any
) -> Any:
    """Coefficients of DOP853's interpolant, shape (7, n_states), from three further stages."""
    first = len(stages)
    all_stages = np.empty((first + len(extra), len(y)))
    for s in range(first):
        for i in range(len(y)):
            all_stages[s, i] = stages[s, i]
    _fill_stages(all_stages, y, h, extra, arrays)
    coefficients, further = np.empty((3 + len(weights), len(y))), np.dot(weights, all_stages)
    for i in range(len(y)):
        moved = end[i] - y[i]
        coefficients[0, i], coefficients[1, i] = moved, h * stages[0, i] - moved
        coefficients[2, i] = 2.0 * moved - h * (stages[first - 1, i] + stages[0, i])
        for k in range(len(weights)):
            coefficients[3 + k, i] = h * further[k, i]
    return coefficients


@_compiled
def interpolate(parts: Any, y: Any, coefficients: Any) -> Any:
    """DOP853's interpolant at parts of a step, shape (n_states, n)."""
    values = np.empty((len(y), len(parts)))
    for j in range(len(parts)):
        factors = (parts[j], 1.0 - parts[j])
        for i in range(len(y)):
            value = 0.0
            for k in range(len(coefficients)):
                value = (value + coefficients[len(coefficients) - 1 - k, i]) * factors[k % 2]
            values[i, j] = value + y[i]
    return values


def _load() -> None:
    """Load all of it from the disk, or compile it: a process that is forked afterwards need not."""
    numbers, complexes, y = np.zeros((1, 1)), np.zeros((1, 1), dtype=np.complex128), np.zeros(2)
    added = y[:1], numbers, numbers, 0.0, True
    rows, none = np.zeros((0, 1), dtype=np.complex128), np.zeros((0, 2), dtype=np.intp)
    matrices = complexes, complexes[0], np.ones((1, 1))
    arrays = np.ones(1), none, *matrices, added, rows, np.zeros((0, 1))
    solve(numbers, numbers, arrays)
    _, stages, _, _ = step(y, y, 1.0, (np.zeros((2, 1)), y, y), (1.0, 1.0), arrays)
    coefficients = dense_output(y, y, stages, 1.0, np.zeros((1, 2)), np.zeros((1, 3)), arrays)
    interpolate(y, y, coefficients)


_load()
