"""Start angles from printed figures: least squares, and the set that gives every printed digit.

A printed number is uniform over what rounds to it, of standard deviation half width / sqrt(3).
Least squares with these gives a best point and a covariance. The set of compatible angles, those
with no miss beyond one half width, is the likelihood's whole support; its ends along each angle are
found by linear programs, repeated until the numbers themselves, not their linear pictures, stand at
their bounds.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.optimize import least_squares, linprog
from scipy.stats import chi2, norm
from trebucheck.api.mechanics import FloatArray, InputError

from .quantities import (
    ANGLES,
    Angles,
    Conditioning,
    Extent,
    Fit,
    Headlines,
    Left,
    QuantityAt,
    Start,
)

_PER_HALF = math.sqrt(3.0)  # standard deviations in a half width, for a uniform distribution
_CONFIDENCE = 0.95
_STEP = 0.05  # [rad] the largest a linear program may go at once
_ROUNDS = 40
_SETTLED = 1e-9  # [rad] 1e-6 of the narrowest compatible sets, 100 times our error
_BINDING = 1e-4  # half widths: distance from a bound that still counts as active
_HARDLY = 1e-6  # of the largest singular value: below it a direction is undetermined (noise)


def fit(
    headlines: Headlines,
    start: Start,
    free: Sequence[str] = ANGLES,
    *,
    name: str,
    because: str = "",
) -> Fit:
    """Fit the free angles; the others stay as they are in `start` [rad].

    Raises:
        InputError: the printed numbers do not bound the free angles, or a machine does not launch.
    """
    columns = [ANGLES.index(angle) for angle in free]
    best, slopes, chi_square = _least_squares(headlines, np.array(start, dtype=np.float64), columns)
    covariance = _covariance(slopes, free)
    errors = np.sqrt(np.diag(covariance))
    width = float(norm.ppf(0.5 + _CONFIDENCE / 2)) * errors
    freedom = len(headlines.fitted) - len(free)
    everywhere = headlines.jacobian(best)[:, columns]
    least, centre = _centre(headlines, best, columns, everywhere)
    return Fit(
        name=name,
        held_because=because,
        free=tuple(free),
        angles=_angles(best),
        standard_errors=tuple(errors.tolist()),
        covariance=tuple(tuple(row) for row in covariance.tolist()),
        confidence=tuple(
            (float(v - w), float(v + w)) for v, w in zip(best[columns], width, strict=True)
        ),
        chi_square=chi_square,
        degrees_of_freedom=freedom,
        p_value=float(chi2.sf(chi_square, freedom)) if freedom else 1.0,
        figures=quantities_at(headlines, best),
        least_worst=least,
        compatible=least <= 1.0,
        extents=_extents(headlines, centre, columns, everywhere) if least <= 1.0 else (),
    )


def _least_squares(
    headlines: Headlines, start: FloatArray, columns: list[int]
) -> tuple[FloatArray, FloatArray, float]:
    """Best angles (3,), the Jacobian there in standard deviations per radian, and chi square."""
    fitted = headlines.fitted
    if len(fitted) < len(columns):
        raise InputError(
            f"{len(fitted)} fitted numbers are too few for {len(columns)} free angles."
        )

    def angles(values: FloatArray) -> FloatArray:
        whole = start.copy()
        whole[columns] = values
        return whole

    def residuals(values: FloatArray) -> FloatArray:
        return headlines.misses(angles(values))[fitted] * _PER_HALF

    def jacobian(values: FloatArray) -> FloatArray:
        return headlines.jacobian(angles(values))[fitted][:, columns] * _PER_HALF

    # Levenberg and Marquardt's method walks the curved valley, some 300 times as long as wide, in
    # the fewest steps.
    solution: Any = least_squares(
        residuals, start[columns], jacobian, method="lm", xtol=1e-9, ftol=1e-10, gtol=1e-9
    )
    return angles(solution.x), np.asarray(solution.jac, dtype=np.float64), 2 * float(solution.cost)


def _covariance(slopes: FloatArray, free: Sequence[str]) -> FloatArray:
    values = np.linalg.svd(slopes, compute_uv=False)
    if values[-1] <= _HARDLY * values[0]:
        raise InputError(
            f"the printed numbers leave a combination of {' and '.join(free)} open; others are "
            "needed."
        )
    return np.asarray(np.linalg.inv(slopes.T @ slopes), dtype=np.float64)


def quantities_at(headlines: Headlines, angles: Start) -> tuple[QuantityAt, ...]:
    """Printed numbers at a start."""
    misses = headlines.misses(angles)
    return tuple(
        QuantityAt(name=f.name, computed=float(f.value + m * f.half), miss=float(m))
        for f, m in zip(headlines.printed, misses, strict=True)
    )


def _angles(values: FloatArray) -> Angles:
    theta, phi, alpha = values.tolist()
    return (theta, phi, alpha)


def _centre(
    headlines: Headlines, at: FloatArray, columns: list[int], slopes: FloatArray
) -> tuple[float, FloatArray]:
    """The point whose worst miss is least, and that miss: min s with |misses + slopes d| <= s."""
    best, worst = at, float(np.abs(headlines.misses(at)).max())
    cost = np.append(np.zeros(len(columns)), 1.0)
    for _ in range(_ROUNDS):
        misses = headlines.misses(best)
        minus = -np.ones((len(misses), 1))
        rows = np.block([[slopes, minus], [-slopes, minus]])
        bounds = [(-_STEP, _STEP)] * len(columns) + [(0.0, None)]
        solution: Any = linprog(cost, rows, np.concatenate([-misses, misses]), bounds=bounds)
        further = best.copy()
        further[columns] += solution.x[:-1]
        miss = float(np.abs(headlines.misses(further)).max())
        if miss >= worst - _SETTLED:
            break
        best, worst = further, miss
    return worst, best


def _extents(
    headlines: Headlines, centre: FloatArray, columns: list[int], slopes: FloatArray
) -> tuple[Extent, ...]:
    extents: list[Extent] = []
    for k, column in enumerate(columns):
        (low, ends_low), (high, ends_high) = (
            _end(headlines, centre, columns, slopes, sign * np.eye(len(columns))[k])
            for sign in (-1, 1)
        )
        extents.append(
            Extent(
                angle=ANGLES[column],
                low=float(low[column]),
                high=float(high[column]),
                ends_low=ends_low,
                ends_high=ends_high,
            )
        )
    return tuple(extents)


def _end(
    headlines: Headlines,
    centre: FloatArray,
    columns: list[int],
    slopes: FloatArray,
    towards: FloatArray,
) -> tuple[FloatArray, tuple[str, ...]]:
    """Farthest compatible point in a direction, and the numbers that stand at their bounds there.

    The slopes stay those of the fit: they only steer, and what the steps settle on solves the
    numbers' own bounds.
    """
    at = centre.copy()
    for _ in range(_ROUNDS):
        step = _program(headlines.misses(at), slopes, towards)
        at[columns] += step
        if float(np.abs(step).max()) < _SETTLED:
            misses = np.abs(headlines.misses(at))
            ends = [
                f.name
                for f, miss in zip(headlines.printed, misses, strict=True)
                if miss > 1 - _BINDING
            ]
            return at, tuple(ends)
    names = " and ".join(ANGLES[column] for column in columns)
    raise InputError(
        f"the printed numbers do not bound {names}; more of them, or ones with more digits, are "
        "needed."
    )


def _program(misses: FloatArray, slopes: FloatArray, towards: FloatArray) -> FloatArray:
    """The step that goes farthest and keeps |misses + slopes step| <= 1."""
    rows, room = np.vstack([slopes, -slopes]), np.concatenate([1 - misses, 1 + misses])
    solution: Any = linprog(-towards, rows, room, bounds=[(-_STEP, _STEP)] * len(towards))
    return (
        np.zeros(len(towards)) if solution.x is None else np.asarray(solution.x, dtype=np.float64)
    )


def conditioning(slopes: FloatArray, names: Sequence[str]) -> Conditioning:
    """Conditioning of a Jacobian of misses [1/rad], shape (n, 3), with the names of its rows."""
    left, values, directions = np.linalg.svd(slopes * _PER_HALF, full_matrices=False)
    # A singular vector's sign is arbitrary: its largest component is shown as positive.
    largest = np.argmax(np.abs(directions), axis=1)
    directions = directions * np.sign(directions[np.arange(len(directions)), largest])[:, None]
    reach = math.sqrt(float(chi2.ppf(_CONFIDENCE, len(ANGLES))))
    return Conditioning(
        singular_values=tuple(values.tolist()),
        directions=tuple(_angles(row) for row in directions),
        decided_by=tuple(names[int(i)] for i in np.argmax(np.abs(left), axis=0)),
        rank=int(np.sum(values > _HARDLY * values[0])),
        condition_number=float(values[0] / values[-1]),
        half_lengths=tuple((reach / values).tolist()),
    )


def left_out(headlines: Headlines, at: FloatArray) -> tuple[Left, ...]:
    """Growth of the compatible set when a number is left out, to first order about a point."""
    misses, slopes = headlines.misses(at), headlines.jacobian(at)
    whole = _linear_widths(misses, slopes)
    every = np.arange(len(misses))
    growths: list[Left] = []
    for i, quantity in enumerate(headlines.printed):
        without = _linear_widths(misses[every != i], slopes[every != i])
        growth = [
            w / known if w and known else None for w, known in zip(without, whole, strict=True)
        ]
        growths.append(Left(name=quantity.name, growth=tuple(growth)))
    return tuple(growths)


def _linear_widths(misses: FloatArray, slopes: FloatArray) -> list[float | None]:
    """Widths of {d: |misses + slopes d| <= 1} by angle [rad]; None if unbounded or empty."""
    rows, room = np.vstack([slopes, -slopes]), np.concatenate([1 - misses, 1 + misses])
    free = [(None, None)] * slopes.shape[1]
    widths: list[float | None] = []
    for axis in np.eye(slopes.shape[1]):
        ends: list[Any] = [linprog(sign * axis, rows, room, bounds=free) for sign in (1, -1)]
        widths.append(
            None if any(end.x is None for end in ends) else -sum(float(end.fun) for end in ends)
        )
    return widths
