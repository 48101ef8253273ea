"""Looking for machines whose two instants coincide: constrained optimisation over r, h and l1."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from scipy.optimize import Bounds as Box
from scipy.optimize import NonlinearConstraint, brentq, minimize
from trebucheck.api.mechanics import FloatArray, TrebuchetParameters, rolling

from .first_forward_swing import (
    Bounds,
    FirstForwardSwing,
    Optimality,
    Reading,
    first_forward_swing_of,
)

NAMES = ("r", "h", "l1")
_STEP = 1e-4  # relative, of differences: errors 1e-8 (third derivative) and 1e-6 (rounding)
_GRID = (6, 4, 5)  # places of r, h and l1 in the coarse look
_NEAR = 0.06  # [s] largest difference of a start's two instants: Table I's rolling machine has 0.05
_STARTS = 3
# Steps towards the condition, how near is enough [ms], longest of them.
_DRAWS, _DRAWN, _LONGEST = (12, 0.5, 0.2)
_REACH = 0.4  # of x, to either side, in which a search goes on before it looks around again
_BOXES = 10
_ITERATIONS = 15  # in one box
_CONVERGED = 1e-9  # of the objective, in thousands of metres
_SAME = 1e-3  # relative: lengths that count as one design
_AT_BOUND = 1e-6  # relative
_SIDESTEP = 0.01  # relative: how far neighbours stand for the second-order condition
_FARTHEST = 0.05  # relative, along the gradient, to where a neighbour coincides
_NO_THROW = np.array([0.0, 1e3])  # [km], [ms]


class NoThrowError(Exception):
    """A machine that must throw does not."""


@dataclass(frozen=True)
class Family:
    """Rolling machines on one beam; x is (r, h, l1) relative to the given machine's."""

    parameters: TrebuchetParameters
    beam: float
    bounds: Bounds
    reading: Reading = Reading.RANGE_OPTIMAL
    _known: dict[tuple[float, ...], FirstForwardSwing | None] = field(
        default_factory=dict, repr=False, compare=False
    )

    @cached_property
    def scale(self) -> FloatArray:
        """r, h and l1 of the given machine [m]."""
        return np.array([getattr(self.parameters, name) for name in NAMES])

    @cached_property
    def box(self) -> tuple[FloatArray, FloatArray]:
        """Bounds of x."""
        edges = np.array([getattr(self.bounds, name) for name in NAMES])
        return edges[:, 0] / self.scale, edges[:, 1] / self.scale

    def machine(self, x: FloatArray) -> TrebuchetParameters:
        """Parameters at x."""
        r, h, l1 = (float(value) for value in x * self.scale)
        others = self.parameters.model_dump(exclude={"l1", "l2", "r", "h"})
        return TrebuchetParameters.with_beam(l1, self.beam, r=r, h=h, **others)

    def scaled(self, parameters: TrebuchetParameters) -> FloatArray:
        """The design variables x of a machine, in units of the scale."""
        return np.array([getattr(parameters, name) for name in NAMES]) / self.scale

    def sweep(self, x: FloatArray) -> FirstForwardSwing | None:
        """The first forward swing at x; None where there is no throw."""
        key = tuple(x.tolist())
        if key not in self._known:
            self._known[key] = first_forward_swing_of(rolling(self.machine(x)))
        return self._known[key]

    def values(self, x: FloatArray) -> FloatArray:
        """Range [km] and delay between the instants [ms]; without a throw, values to reject."""
        swing = self.sweep(x)
        return (
            _NO_THROW
            if swing is None
            else np.array([1e-3 * swing.range, 1e3 * swing.delay(self.reading)])
        )

    def slopes(self, x: FloatArray) -> FloatArray:
        """Derivatives of :meth:`values` by x, central differences, shape (2, 3).

        Raises:
            NoThrowError: a machine next to it is none that throws.
        """
        beside = [(x + d, x - d) for d in _STEP * np.eye(len(x))]
        if any(self.sweep(y) is None for pair in beside for y in pair):
            raise NoThrowError
        columns = [self.values(after) - self.values(before) for after, before in beside]
        return np.array(columns).T / (2 * _STEP)

    def starts(self) -> list[FloatArray]:
        """Machines of a coarse grid with near instants, the farthest throwing first."""
        low, high = self.box
        axes = [np.linspace(a, b, n + 2)[1:-1] for a, b, n in zip(low, high, _GRID, strict=True)]
        candidates: list[tuple[float, FloatArray]] = []
        for point in itertools.product(*axes):
            x = np.array(point)
            sweep = self.sweep(x)
            if sweep is not None and abs(sweep.delay(self.reading)) < _NEAR:
                candidates.append((sweep.range, x))
        candidates.sort(key=lambda pair: -pair[0])
        return [x for _, x in candidates[:_STARTS]]

    def maximised(self, starts: Sequence[FloatArray], objective: Objective) -> list[FloatArray]:
        """Optima from each start with coinciding instants, the best first."""
        optima = [
            x
            for start in starts
            if (x := self._optimum(start, objective, coincide=True)) is not None
        ]
        return sorted(optima, key=lambda x: -objective.value(self, x))

    def farthest(self, start: FloatArray) -> FloatArray | None:
        """Machine of the largest range, whatever the two instants."""
        return self._optimum(start, RANGE, coincide=False)

    def _optimum(
        self, start: FloatArray, objective: Objective, coincide: bool
    ) -> FloatArray | None:
        """Optimum in boxes that follow the search: full steps may reach machines that fail."""
        low, high = (edge + sign * 2 * _STEP for edge, sign in zip(self.box, (1, -1), strict=True))
        try:
            x, reach = (
                self._drawn(np.clip(start, low, high), low, high) if coincide else start,
                _REACH,
            )
            for _ in range(_BOXES):
                box = (np.maximum(low, x - reach), np.minimum(high, x + reach))
                try:
                    optimum, converged = self._in_box(x, objective, coincide, box)
                except NoThrowError:
                    reach /= 2
                    continue
                inside = np.all(
                    (np.abs(optimum - x) < reach * 0.999) | (optimum <= low) | (optimum >= high)
                )
                x = optimum
                if inside and converged:
                    break
            return self.coincident(x) if coincide else x
        except NoThrowError:
            return None

    def _drawn(self, x: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
        """Machine whose two instants nearly coincide, by Newton steps along the gradient.

        Raises:
            NoThrowError: a machine on the way does not throw.
        """
        for _ in range(_DRAWS):
            delay = self.values(x)[1]
            if abs(delay) < _DRAWN:
                break
            slope = self.slopes(x)[1]
            step = -delay * slope / (slope @ slope)
            x = np.clip(x + step * min(1.0, _LONGEST / float(np.linalg.norm(step))), low, high)
        return x

    def _in_box(
        self,
        x: FloatArray,
        objective: Objective,
        coincide: bool,
        box: tuple[FloatArray, FloatArray],
    ) -> tuple[FloatArray, bool]:
        condition = NonlinearConstraint(
            lambda x: self.values(x)[1], 0.0, 0.0, jac=lambda x: self.slopes(x)[1:2]
        )
        result: Any = minimize(
            lambda x: -objective.value(self, x),
            x,
            jac=lambda x: -objective.slope(self, x),
            method="SLSQP",
            bounds=Box(*box),
            constraints=[condition] if coincide else [],
            options={"maxiter": _ITERATIONS, "ftol": _CONVERGED},
        )
        return np.asarray(result.x, dtype=np.float64), bool(result.success)

    def coincident(self, x: FloatArray, normal: FloatArray | None = None) -> FloatArray | None:
        """The machine nearest along a direction whose two instants coincide; None if none is near.

        Args:
            normal: the direction; the condition's own gradient if left out.

        Raises:
            NoThrowError: a machine on the way does not throw.
        """
        direction = self.slopes(x)[1] if normal is None else normal
        direction = direction / np.linalg.norm(direction)

        def delay(s: float) -> float:
            swing = self.sweep(x + s * direction)
            if swing is None:
                raise NoThrowError
            return swing.delay(self.reading)

        for far in (1e-4, 1e-3, 1e-2, _FARTHEST):
            if delay(-far) * delay(far) < 0:
                return x + float(brentq(delay, -far, far, xtol=1e-13)) * direction
        return None

    def conditions(
        self, x: FloatArray, objective: Objective, optima: Sequence[FloatArray], starts: int
    ) -> Optimality:
        """First and second order, at a machine whose two instants coincide.

        Raises:
            NoThrowError: a neighbour does not throw.
        """
        slopes, gradient = self.slopes(x), objective.slope(self, x)
        low, high = self.box
        active = [
            i
            for i in range(len(x))
            if min(abs(x[i] - low[i]), abs(x[i] - high[i])) < _AT_BOUND + 3 * _STEP
        ]
        free = np.array([i not in active for i in range(len(x))])
        normal = slopes[1] * free
        multiplier = float(gradient @ normal / (normal @ normal))
        left = (gradient - multiplier * slopes[1]) * free
        near = [y for y in optima if np.abs(y / x - 1).max() < _SAME]
        return Optimality(
            residual=float(np.linalg.norm(left) / np.linalg.norm(gradient)),
            multiplier=multiplier * 1e6 if objective is RANGE else None,  # km per ms
            neighbours=tuple(self._neighbours(x, normal, objective)),
            active=tuple(f"{NAMES[i]} at {x[i] * self.scale[i]:.6g} m" for i in active),
            starts=starts,
            reached=len(near),
        )

    def _neighbours(self, x: FloatArray, normal: FloatArray, objective: Objective) -> list[float]:
        """Changes of the objective at neighbouring coinciding machines, along two tangents."""
        _, _, tangents = np.linalg.svd(normal[None, :])
        value, gains = objective.value(self, x), list[float]()
        for direction in (*tangents[1:], *(-tangents[1:])):
            beside = self.coincident(np.clip(x + _SIDESTEP * direction, *self.box), normal)
            if beside is not None:
                gains.append(objective.unit * (objective.value(self, beside) - value))
        return gains


@dataclass(frozen=True)
class Objective:
    """Quantity to maximise, with its derivative."""

    value: Callable[[Family, FloatArray], float]
    slope: Callable[[Family, FloatArray], FloatArray]
    unit: float = 1.0
    """Size of its unit in the unit that is reported."""


RANGE = Objective(
    lambda family, x: float(family.values(x)[0]), lambda family, x: family.slopes(x)[0], 1e3
)
"""The range of the best release [km], reported in m."""
NEARNESS = Objective(lambda _, x: -float(np.sum((x - 1) ** 2)), lambda _, x: -2 * (x - 1))
"""Minus the sum of the squares of the relative changes of r, h and l1."""
