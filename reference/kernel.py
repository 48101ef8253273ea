"""The kernel of :mod:`.compiled`, to be compiled by Numba: imported where that is installed, when first needed.

It is written in loops over numbers, which take machine code no longer than operations on whole arrays. Its arguments
are the fields of :class:`.compiled.CompiledEquations`.
"""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np

numba: Any = importlib.import_module("numba")  # it has no type stubs


def _compiled(function: Any) -> Any:
    return numba.njit(cache=True)(function)


@_compiled
def _fill_rates(q: Any, u: Any, angles: Any, carried: Any, rates: Any, curvature: Any) -> None:
    """Rates dw_k/dq_k and the second derivative of w without accelerations."""
    for i in range(len(q)):
        rates[i] = complex(-np.sin(q[i]), -np.cos(q[i])) if angles[i] > 0 else complex(1.0, 0.0)
        curvature[i] = -1j * angles[i] * rates[i] * u[i] * u[i]
    for k, i in carried:
        rates[k] = 1j * rates[i]
        curvature[k] = -rates[k] * u[i] * (2j * u[k] + q[k] * u[i])


@_compiled
def _add_carried(row: Any, q: Any, carried: Any) -> None:
    """Complete a gradient by what slides on turning lines add to it."""
    for k, i in carried:
        row[i] += row[k] * (-1j * q[k])


@_compiled
def _fill_mass(matrix: Any, q: Any, carried: Any, products: Any, inertias: Any, rates: Any, moved: Any) -> None:
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


@_compiled
def _fill_forces(right: Any, q: Any, carried: Any, products: Any, weights: Any, rates: Any, curvature: Any) -> None:
    """Q - b = Re(J^H (W - K dJ/dt u))."""
    n = len(q)
    row = np.empty(n, dtype=np.complex128)
    for i in range(n):
        total = weights[i]
        for j in range(n):
            total -= (products[i, j] * curvature[j]).conjugate()
        row[i] = total * rates[i]
    _add_carried(row, q, carried)
    for i in range(n):
        right[i] = row[i].real


@_compiled
def _fill_constraints(
    matrix: Any, right: Any, q: Any, carried: Any, point_rows: Any, angle_rows: Any, rates: Any, curvature: Any
) -> None:
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


@_compiled
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


@_compiled
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
    """Accelerations and multipliers of states, shape (n, n_q + n_constraints), and whether they are unique."""
    angles, carried, products, weights, inertias, point_rows, angle_rows = arrays
    (n_states, n), m = positions.shape, len(point_rows)
    solution, matrix = np.empty((n_states, n + m)), np.empty((n + m, n + m))
    rates, curvature = np.empty(n, dtype=np.complex128), np.empty(n, dtype=np.complex128)
    moved, regular = np.empty((n, n), dtype=np.complex128), True
    for state in range(n_states):
        q, right = positions[state], solution[state]
        _fill_rates(q, speeds[state], angles, carried, rates, curvature)
        _fill_mass(matrix, q, carried, products, inertias, rates, moved)
        _fill_forces(right, q, carried, products, weights, rates, curvature)
        _fill_constraints(matrix, right, q, carried, point_rows, angle_rows, rates, curvature)
        regular = _eliminate(matrix, right) and regular
    return solution, regular


@_compiled
def _fill_stages(stages: Any, first: int, y: Any, h: float, coefficients: Any, arrays: Any) -> bool:
    """Rates of the stages of a Runge-Kutta step from `first` on, each from those before it."""
    n, regular = len(y) // 2, True
    for s in range(first, first + len(coefficients)):
        at = y.copy()
        for k in range(s):
            at += h * coefficients[s - first, k] * stages[k]
        solution, unique = solve(at[:n].reshape(1, n), at[n:].reshape(1, n), arrays)
        stages[s, :n], stages[s, n:] = at[n:], solution[0, :n]
        regular = regular and unique
    return regular


@_compiled
def step(y: Any, f: Any, h: float, tableau: Any, tolerance: Any, arrays: Any) -> Any:
    """One step of DOP853: its end, its stages, its error over the tolerance, and whether accelerations are unique."""
    matrix, error_5, error_3 = tableau
    stages = np.empty((len(matrix), len(y)))
    stages[0] = f
    regular = _fill_stages(stages, 1, y, h, matrix[1:], arrays)
    end = y.copy()
    for k in range(matrix.shape[1]):
        end += h * matrix[-1, k] * stages[k]
    fifth, third = 0.0, 0.0
    for i in range(len(y)):
        scale = tolerance[1] + tolerance[0] * max(abs(y[i]), abs(end[i]))
        fifth += ((error_5 * stages[:, i]).sum() / scale) ** 2
        third += ((error_3 * stages[:, i]).sum() / scale) ** 2
    error = 0.0
    if fifth > 0.0 or third > 0.0:
        error = abs(h) * fifth / np.sqrt((fifth + 0.01 * third) * len(y))
    return end, stages, error, regular


@_compiled
def dense_output(y: Any, end: Any, stages: Any, h: float, extra: Any, weights: Any, arrays: Any) -> Any:
    """Coefficients of DOP853's interpolant, shape (7, n_states), from three further stages."""
    first = len(stages)
    all_stages = np.empty((first + len(extra), len(y)))
    all_stages[:first] = stages
    _fill_stages(all_stages, first, y, h, extra, arrays)
    coefficients = np.empty((3 + len(weights), len(y)))
    moved = end - y
    coefficients[0], coefficients[1] = moved, h * stages[0] - moved
    coefficients[2] = 2.0 * moved - h * (stages[first - 1] + stages[0])
    coefficients[3:] = h * np.dot(weights, all_stages)
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
