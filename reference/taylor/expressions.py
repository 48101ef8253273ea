r"""The equations of motion and the events as heyoka expressions.

One compiled integrator serves every machine of a structure and every active set: the numbers are
runtime parameters, and a stop is switched by a parameter h, 1 active and 0 free, in the symmetric
system

    [ M      (hG)^T    ] [   a  ]   [    f   ]
    [ hG   -diag(1-h)  ] [ -lam ] = [ -gamma ],      f = Q - b,

whose row of a free stop reads lam = 0 (loops of joints are always active; gamma of a stop on angles
is 0). M is positive definite and what elimination leaves of the constraints is negative definite,
so that L D L^T needs no pivoting (symmetric quasidefinite matrices: Vanderbei, SIAM J. Optim. 5
(1995) 100).
"""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate
from typing import Any, cast

import numpy as np

from ...models.errors import EngineNotInstalledError
from ...models.kinematics import Kinematics
from ...models.problem import Problem
from ..equations import Equations
from .numbers import Row, Structure, numbers_of, structure_of


def heyoka() -> Any:
    """The library, imported when first asked for: it takes a quarter of a second.

    Raises:
        EngineNotInstalledError: it is not here.
    """
    try:
        return importlib.import_module("heyoka")
    except ImportError:
        raise EngineNotInstalledError(
            "the Taylor integrator needs heyoka, which is not installed here; on Linux `pip "
            "install heyoka` brings it."
        ) from None


class TaylorSystem:
    """Expressions of a structure: accelerations, stop torques and event functions."""

    def __init__(self, structure: Structure) -> None:
        self.structure = structure
        self._hy = heyoka()
        names = range(structure.n_q)
        self.q: list[Any] = list(self._hy.make_vars(*(f"q{i}" for i in names), "q_")[:-1])
        self.u: list[Any] = list(self._hy.make_vars(*(f"u{i}" for i in names), "u_")[:-1])
        self.observer: Any = self._hy.make_vars("s")
        self._cosines: dict[tuple[int, int | None], tuple[Any, Any]] = {}

    @cached_property
    def rates(self) -> list[tuple[Any, Any]]:
        """The differential equations, variable and its time derivative; the observer comes last.

        The step is chosen from the last two Taylor coefficients (Jorba and Zou, Exp. Math. 14
        (2005) 99). A symmetry may make both vanish: a pendulum let go from level has only every
        fourth power of time in its angle, and steps then become far too long. The observer s' =
        sum_i (cos q_i + sin q_i) - s has no such symmetry, and is bounded.
        """
        a = self.solved[: self.structure.n_q]
        waves = [wave for i in range(self.structure.n_angles) for wave in self._phase(i, None)]
        return [
            *zip(self.q, self.u, strict=True),
            *zip(self.u, a, strict=True),
            (self.observer, total([*waves, -self.observer])),
        ]

    @cached_property
    def torques(self) -> list[Any]:
        """Torque of each stop [N m]: zero where it is free."""
        first = self.structure.n_q + self.structure.n_loops
        return [-multiplier for multiplier in self.solved[first:]]

    @cached_property
    def events(self) -> list[Any]:
        """Event functions, falling through zero: one a stop (1 without event), then the launch."""
        functions: list[Any] = []
        for k, torque in enumerate(self.torques):
            active = self._par(self.structure.active.start + k)
            function = active * torque + (1.0 - active)
            if self.structure.closes:
                watched = self._par(self.structure.watched.start + k)
                function = active * torque + watched * self._gap(k) + (1.0 - active - watched)
            functions.append(function)
        if self.structure.throws:
            launch_active = self._par(self.structure.launch)
            functions.append(launch_active * self._lead + (1.0 - launch_active))
        return functions

    def _par(self, index: int) -> Any:
        return self._hy.par[index]

    @cached_property
    def _numbers(self) -> dict[str, np.ndarray[Any, Any]]:
        """Runtime parameters by section; None where a number is zero by structure."""
        indices = np.cumsum(self.structure.present) - 1
        flat = np.empty(len(indices), dtype=object)
        for i, (index, present) in enumerate(zip(indices, self.structure.present, strict=True)):
            flat[i] = self._par(int(index)) if present else None
        sections: dict[str, np.ndarray[Any, Any]] = {}
        start = 0
        for name, shape in self.structure.sections.items():
            size = int(np.prod(shape))
            sections[name] = flat[start : start + size].reshape(shape)
            start += size
        return sections

    def _wave(self, section: str, at: tuple[int, ...], i: int, j: int | None = None) -> Pair:
        """Re and Im of z e^{i(p_i - p_j)}, the phase p an angle itself, of a slide its line's."""
        real, imaginary = (self._numbers[section][(part, *at)] for part in (0, 1))
        if real is None and imaginary is None:
            return None, None
        first, second = self._phases[i], None if j is None else self._phases[j]
        if first == second:
            return real, imaginary
        if first is None:
            cosine, sine = self._phase(cast("int", second), None)
            sine = -sine
        else:
            cosine, sine = self._phase(first, second)
        return (
            total([times(real, cosine), minus(times(imaginary, sine))]),
            total([times(real, sine), times(imaginary, cosine)]),
        )

    @cached_property
    def _phases(self) -> list[int | None]:
        s = self.structure
        turning = dict(s.carried)
        return [*range(s.n_angles), *(turning.get(k) for k in range(s.n_angles, s.n_q))]

    def _phase(self, i: int, j: int | None) -> tuple[Any, Any]:
        if (i, j) not in self._cosines:
            phase = self.q[i] if j is None else self.q[i] - self.q[j]
            self._cosines[i, j] = (self._hy.cos(phase), self._hy.sin(phase))
        return self._cosines[i, j]

    @cached_property
    def _squares(self) -> list[Any]:
        return [u * u for u in self.u[: self.structure.n_angles]]

    @cached_property
    def _curvature(self) -> list[Pair]:
        """Minus the second derivatives of w without accelerations, over its own rates."""
        s = self.structure
        found: list[Pair] = [(None, square) for square in self._squares] + [
            (None, None)
        ] * s.n_slides
        for k, c in s.carried:
            found[k] = (self.q[k] * self._squares[c], 2.0 * self.u[k] * self.u[c])
        return found

    def _component(self, section: str, *at: int) -> tuple[list[Any], Any]:
        """Gradient of a row of waves, and minus its second derivative without accelerations."""
        waves = [self._wave(section, (*at, j), j) for j in range(self.structure.n_q)]
        gradient = [wave[0] for wave in waves]
        for k, c in self.structure.carried:
            gradient[c] = total([gradient[c], minus(times(self.q[k], waves[k][1]))])
        inward = [times(waves[j][1], self._squares[j]) for j in range(self.structure.n_angles)]
        for k, _ in self.structure.carried:
            real, imaginary = self._curvature[k]
            inward += [times(waves[k][0], real), times(waves[k][1], imaginary)]
        return gradient, total(inward)

    def _vector(self, section: str, offsets: str, at: int) -> Vector:
        """A vector between points from its parts' waves z; Re z - i Im z is an angle's d/dq."""
        s = self.structure
        waves = [self._wave(section, (at, j), j) for j in range(s.n_q)]
        gradient: list[Pair] = [(real, minus(imaginary)) for real, imaginary in waves]
        constant: Pair = (self._numbers[offsets][0, at], self._numbers[offsets][1, at])
        angles: list[tuple[Any, Pair]] = [
            (1.0, (imaginary, real)) for real, imaginary in waves[: s.n_angles]
        ]
        slides = list(zip(self.q[s.n_angles :], gradient[s.n_angles :], strict=True))
        inward = [multiplied(mu, part) for mu, part in zip(self._curvature, gradient, strict=True)]
        for k, c in s.carried:
            gradient[c] = combined([(1.0, gradient[c]), (-self.q[k], (waves[k][1], waves[k][0]))])
        return Vector(
            combined([(1.0, constant), *angles, *slides]),
            gradient,
            combined(zip(self.u, gradient, strict=True)),
            combined((1.0, part) for part in inward),
        )

    def _gap(self, k: int) -> Any:
        row, limit = self.structure.gap_rows[k], minus(self._numbers["limits"][k])
        place = self._places[self.structure.n_loops + k]
        if isinstance(row, int):
            return total([self._line(place, row)[2], limit])
        if row is None:
            return total([*(self._gap_term(place, j) for j in range(self.structure.n_q)), limit])
        turned = [q if sense > 0 else -q for q, sense in zip(self.q, row, strict=False) if sense]
        return total([*turned, limit])

    def _gap_term(self, point: int, j: int) -> Any:
        """Coordinate's term in a point stop's gap: Im of its wave; a slide's is itself times Re."""
        real, imaginary = self._wave("points", (point, j), j)
        return times(real, self.q[j]) if j >= self.structure.n_angles else imaginary

    @cached_property
    def _places(self) -> list[int]:
        """Where in its section each constraint stands that is not one of angles, loops first."""
        loops, stops = self.structure.loop_rows, self.structure.gap_rows
        lines = list(accumulate((isinstance(row, int) for row in loops + stops), initial=0))
        waves = [*accumulate((row is None for row in loops), initial=0)][:-1]
        waves += accumulate((row is None for row in stops), initial=0)
        rows = zip(loops + stops, lines, waves, strict=False)  # the sums have one number more
        return [line if isinstance(row, int) else wave for row, line, wave in rows]

    @cached_property
    def _lead(self) -> Any:
        """The projectile's velocity across the launch direction (:func:`...models.launch.lead`)."""
        return total(
            times(slope, u) for slope, u in zip(self._component("lead")[0], self.u, strict=True)
        )

    def _line(self, number: int, body: int) -> tuple[list[Any], Any, Any]:
        """Component in a direction that turns: gradient, minus second derivative, value."""
        vector = self._vector("lines", "line_offsets", number)
        real, imaginary = (self._numbers["directions"][part, number] for part in (0, 1))
        along = multiplied((real, minus(imaginary)), self._phase(body, None))
        gradient = [multiplied(along, part)[0] for part in vector.gradient]
        value, across = multiplied(along, vector.value)
        gradient[body] = total([gradient[body], minus(across)])
        spin = self.u[body]
        inward = [
            multiplied(along, vector.inward)[0],
            times(2.0 * spin, multiplied(along, vector.rate)[1]),
            times(self._squares[body], value),
        ]
        return gradient, total(inward), value

    @cached_property
    def _constraints(self) -> list[tuple[list[Any], Any]]:
        """Gradient of each constraint, loops first, and minus gamma."""
        s = self.structure
        sections = ["loops"] * s.n_loops + ["points"] * s.n_stops
        rows = zip(s.loop_rows + s.gap_rows, self._places, sections, strict=True)
        return [self._constraint(row, place, section) for row, place, section in rows]

    @property
    def jacobian(self) -> list[Any]:
        """Gradients of all loops, then of all stops whether active or not, row by row."""
        slopes = (slope for gradient, _ in self._constraints for slope in gradient)
        return [self._hy.expression(0.0 if slope is None else slope) for slope in slopes]

    def _constraint(self, row: Row, place: int, section: str) -> tuple[list[Any], Any]:
        """Gradient of a constraint, and minus gamma."""
        if isinstance(row, int):
            return self._line(place, row)[:2]
        if row is None:
            return self._component(section, place)
        return [float(sense) if sense else None for sense in row], None

    @cached_property
    def solved(self) -> list[Any]:
        """Accelerations, then minus the multipliers of loops and stops."""
        matrix, right = self._kkt
        solved = solve_ldl(matrix, right, self._order[0])
        # A coordinate that nothing accelerates has a plain zero, of which heyoka makes no
        # expression by itself.
        return [
            self._hy.expression(value) if isinstance(value, float) else value for value in solved
        ]

    @cached_property
    def operations(self) -> int:
        """Estimated products of one evaluation: of the elimination, and three of each wave."""
        return self._order[1] + 3 * len(self._cosines)

    @cached_property
    def _kkt(self) -> tuple[Matrix, list[Any]]:
        """Matrix and right-hand side of the system above."""
        s = self.structure
        matrix, right = self._mass_and_forces()
        for k, (gradient, inward) in enumerate(self._constraints[: s.n_loops]):
            right.append(inward)
            for j, slope in enumerate(gradient):
                put(matrix, s.n_q + k, j, slope)
        for k, (gradient, inward) in enumerate(self._constraints[s.n_loops :]):
            row, active = s.n_q + s.n_loops + k, self._par(s.active.start + k)
            put(matrix, row, row, active - 1.0)
            right.append(times(active, inward))
            for j, slope in enumerate(gradient):
                put(matrix, row, j, _switched(active, slope))
        return matrix, right

    @cached_property
    def _order(self) -> tuple[list[int], int]:
        """Order of elimination and what it costs."""
        matrix, right = self._kkt
        n_angles = self.structure.n_angles
        # Outer bodies first: a tree then fills in nothing. Slides couple all bodies and come after
        # them.
        usual = [*reversed(range(n_angles)), *range(n_angles, len(right))]
        return elimination(matrix, self.structure.n_q, usual)

    def _mass_and_forces(self) -> tuple[Matrix, list[Any]]:
        s = self.structure
        matrix: Matrix = {}
        forces: list[list[Any]] = [[slope] for slope in self._component("weights")[0]]
        for i in range(s.n_q):
            for j in range(i, s.n_q):
                wave = self._wave("products", (i, j), i, j)
                for a, b, entry in self._mass_terms(i, j, wave):
                    put(matrix, a, b, total([matrix.get((a, b)), entry]))
                for a, force in self._centrifugal(i, j, wave):
                    forces[a].append(force)
        for j, force in (*self._of_springs(), *self._of_twists()):
            forces[j].append(force)
        return matrix, [total(terms) for terms in forces]

    def _mass_terms(self, i: int, j: int, wave: Pair) -> Iterator[tuple[int, int, Any]]:
        """Entries of the mass matrix that an entry of H makes, i <= j, with slides on lines."""
        real, imaginary = wave
        yield i, j, real
        turning = dict(self.structure.carried)
        c, d = turning.get(i), turning.get(j)
        if c is not None:  # by the angle that slide i is carried by: q_i Re(i H)
            yield from _mirrored(c, j, minus(times(self.q[i], imaginary)), i != j)
        if d is not None and i != j:
            yield from _mirrored(d, i, times(self.q[j], imaginary), True)
        if c is not None and d is not None:
            yield from _mirrored(c, d, times(self.q[i] * self.q[j], real), i != j)

    def _centrifugal(self, i: int, j: int, wave: Pair) -> Iterator[tuple[int, Any]]:
        """Minus what an entry of H, i <= j, adds to b."""
        conjugate = (wave[0], minus(wave[1]))
        pairs = ((i, j, wave), (j, i, conjugate)) if i != j else ((i, j, wave),)
        turning = dict(self.structure.carried)
        for k, other, entry in pairs:
            real, imaginary = multiplied(entry, self._curvature[other])
            yield k, real
            if k in turning:
                yield turning[k], minus(times(self.q[k], imaginary))

    def _of_springs(self) -> Iterator[tuple[int, Any]]:
        """Generalized forces of springs and dampers between points."""
        for k, needs_length in enumerate(self.structure.springs):
            stiffness, damping, rest = self._numbers["spring_data"][:, k]
            vector = self._vector("springs", "spring_offsets", k)
            factor = minus(stiffness)
            if needs_length:
                square = total(times(part, part) for part in vector.value)
                stretching = total(
                    times(part, rate) for part, rate in zip(vector.value, vector.rate, strict=True)
                )
                of_rest, of_rate = times(stiffness, rest), minus(times(damping, stretching))
                over_length = None if of_rest is None else of_rest / self._hy.sqrt(square)
                factor = total([factor, over_length, None if of_rate is None else of_rate / square])
            force = combined([(factor, vector.value)])
            for j, slope in enumerate(vector.gradient):
                yield j, total(times(f, part) for f, part in zip(force, slope, strict=True))

    def _of_twists(self) -> Iterator[tuple[int, Any]]:
        """Generalized forces of springs, dampers and motors between angles."""
        for k, row in enumerate(self.structure.twists):
            stiffness, damping, constant, cubic, middle = self._numbers["twist_data"][:, k]
            turned = total(q * float(sense) for q, sense in zip(self.q, row, strict=True) if sense)
            turning = total(u * float(sense) for u, sense in zip(self.u, row, strict=True) if sense)
            from_middle = total([turned, minus(middle)])
            cube = times(times(from_middle, from_middle), from_middle)
            torque = total(
                [
                    constant,
                    minus(times(stiffness, turned)),
                    minus(times(damping, turning)),
                    minus(times(cubic, cube)),
                ]
            )
            for j, sense in enumerate(row):
                yield j, times(torque, float(sense) if sense else None)


@dataclass(frozen=True)
class Vector:
    """A vector between points as expressions."""

    value: Pair
    gradient: list[Pair]
    rate: Pair
    inward: Pair
    """Minus its second derivative without accelerations."""


def _switched(active: Any, slope: Any) -> Any:
    """A gradient's entry times a switch."""
    if isinstance(slope, float):
        return active if slope > 0 else -active
    return times(active, slope)


def _mirrored(i: int, j: int, value: Any, twice: bool) -> Iterator[tuple[int, int, Any]]:
    """An entry that (i, j) and (j, i) of a product both make: on the diagonal they add up."""
    yield min(i, j), max(i, j), times(2.0, value) if i == j and twice else value


_WORTH = 0.75  # of the usual order's products: an order that saves less is not worth a change

# Sparse linear algebra of expressions: None stands for what is zero by structure.
Matrix = dict[tuple[int, int], Any]
"""Both triangles of a symmetric matrix; what is zero by structure is absent."""

Pair = tuple[Any, Any]
"""Re and Im of a complex expression."""


def put(matrix: Matrix, i: int, j: int, value: Any) -> None:
    """Enter a value and its mirror image, unless it is zero by structure."""
    if value is not None:
        matrix[i, j] = matrix[j, i] = value


def times(x: Any, y: Any) -> Any:
    """The product."""
    return None if x is None or y is None else x * y


def minus(x: Any) -> Any:
    """The negative."""
    return None if x is None else -x


def total(terms: Iterable[Any]) -> Any:
    """The sum; None if all terms are."""
    kept = [term for term in terms if term is not None]
    return sum(kept[1:], kept[0]) if kept else None


def multiplied(x: Pair, y: Pair) -> Pair:
    """The complex product."""
    return (
        total([times(x[0], y[0]), minus(times(x[1], y[1]))]),
        total([times(x[0], y[1]), times(x[1], y[0])]),
    )


def combined(terms: Iterable[tuple[Any, Pair]]) -> Pair:
    """The sum of complex expressions times real factors."""
    kept = list(terms)
    return total(times(f, pair[0]) for f, pair in kept), total(
        times(f, pair[1]) for f, pair in kept
    )


def elimination(
    keys: Iterable[tuple[int, int]], n_free: int, usual: Sequence[int]
) -> tuple[list[int], int]:
    """An order of elimination with little fill-in, and the number of products that it takes.

    Least degree first, of what may be eliminated; the usual order where that is not clearly better.

    Args:
        keys: the matrix's entries that are not zero by structure.
        n_free: number of accelerations, the first of the unknowns.
        usual: another valid order.
    """
    neighbours: dict[int, set[int]] = {i: set() for i in usual}
    for i, j in keys:
        if i != j:
            neighbours[i].add(j)
    waits = {i: {j for j in neighbours[i] if j < n_free} for i in usual if i >= n_free}
    least = _least_degree(neighbours, waits, usual)
    usual_cost, least_cost = _products(neighbours, usual), _products(neighbours, least)
    return (least, least_cost) if least_cost < _WORTH * usual_cost else (list(usual), usual_cost)


def _least_degree(
    neighbours: Mapping[int, set[int]], waits: Mapping[int, set[int]], usual: Sequence[int]
) -> list[int]:
    left, order = {i: set(found) for i, found in neighbours.items()}, list[int]()
    while left:
        ready = [i for i in usual if i in left and not waits.get(i, set()) & left.keys()]
        k = min(ready, key=lambda i: len(left[i]))
        order.append(k)
        _eliminate(left, k)
    return order


def _eliminate(left: dict[int, set[int]], k: int) -> int:
    """Take an unknown out of a graph, joining its neighbours; their number."""
    found = left.pop(k)
    for i in found:
        left[i] |= found
        left[i] -= {i, k}
    return len(found)


def _products(neighbours: Mapping[int, set[int]], order: Sequence[int]) -> int:
    left = {i: set(found) for i, found in neighbours.items()}
    degrees = [_eliminate(left, k) for k in order]
    return sum(d * (d + 1) // 2 + 3 * d + 1 for d in degrees)


def solve_ldl(matrix: Matrix, right: Sequence[Any], order: Sequence[int]) -> list[Any]:
    """Solve a sparse symmetric system by L D L^T in the given order, without pivoting.

    The matrix is positive definite among the accelerations, and after their elimination negative
    definite among the multipliers. So accelerations may be eliminated in any order, and a
    multiplier as soon as all accelerations of its constraint are: what is left on its diagonal is
    -G M^-1 G^T of those, which is not zero.

    Args:
        matrix: both triangles; what is zero by structure is absent.
        right: the right-hand side; None where zero by structure.
        order: of elimination.
    """
    a, b = dict(matrix), list(right)
    for step, k in enumerate(order):
        below = [i for i in order[step + 1 :] if (i, k) in a]
        factors = {i: a[i, k] / a[k, k] for i in below}
        for i, factor in factors.items():
            for j in below:
                a[i, j] = total([a.get((i, j)), -(factor * a[j, k])])
            b[i] = total([b[i], minus(times(factor, b[k]))])
    x: dict[int, Any] = {}
    for step, k in reversed(list(enumerate(order))):
        rest = [minus(times(a.get((k, i)), x[i])) for i in order[step + 1 :]]
        x[k] = total([b[k], *rest])
        x[k] = None if x[k] is None else x[k] / a[k, k]
    return [x[k] if x[k] is not None else 0.0 for k in range(len(right))]


MOST_PRODUCTS = 3000
"""Limit of one evaluation's products, to which compilation and steps take time in proportion.

They grow with the cube of the length of a chain (20 rods have 2550), while an evaluation of DOP853
is one call of LAPACK."""


def why_not_taylor(problem: Problem) -> str | None:
    """Reason for "auto" to take DOP853, half a sentence; None where it takes Taylor series."""
    if importlib.util.find_spec("heyoka") is None:
        return "heyoka is not installed"
    mechanism = problem.mechanism
    closed = [stop.name for stop in problem.mechanism.stops if stop.closed]
    if Equations(mechanism).basis(np.array(mechanism.start), closed) is not None:
        return "its constraints depend on each other"
    kinematics = Kinematics(mechanism)
    structure = structure_of(problem, kinematics, numbers_of(problem, kinematics, np.float64) != 0)
    products = TaylorSystem(structure).operations
    if products > MOST_PRODUCTS:
        return f"one evaluation would take {products} products, which are {MOST_PRODUCTS} at most"
    return None
