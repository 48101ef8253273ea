r"""The equations of motion and the events as heyoka expressions, and their compilation.

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

import importlib.util
import sys
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from ...models.errors import EngineNotInstalledError
from ...models.kinematics import Kinematics
from ...models.problem import Problem
from ..equations import Equations
from .numbers import RealType, Structure, numbers_of, structure_of

_KEPT = 32  # compiled systems; one takes about a megabyte and a second
# Products of one evaluation: to compile more without loops takes longer than it saves.
_UNROLLED = 90
# Of fewer, two vectors side by side keep the processor's units busy, and their code is short.
_SHORT = 60
_WORTH = 0.75  # of the usual order's products: an order that saves less is not worth a change
MOST_PRODUCTS = 3000
"""Limit of one evaluation's products, to which compilation and steps take time in proportion.

They grow with the cube of the length of a chain (20 rods have 2550), while an evaluation of DOP853
is one call of LAPACK."""


_ABSENT = (
    "the Taylor integrator needs heyoka, which is not installed here; on Linux `pip install "
    "heyoka` brings it."
)


def _is_installed() -> bool:
    """Tell whether heyoka is there, without importing it."""
    return importlib.util.find_spec("heyoka") is not None


def refuse_absence() -> None:
    """Raise EngineNotInstalledError if heyoka is not installed; it is not imported."""
    if not _is_installed():
        raise EngineNotInstalledError(_ABSENT)


def heyoka() -> Any:
    """The library, imported when first asked for: it takes a quarter of a second."""
    try:
        import heyoka
    except ImportError:
        raise EngineNotInstalledError(_ABSENT) from None
    return heyoka


def import_without_sympy() -> None:
    """Import the library, if it is there, without SymPy, which takes three times as long as itself.

    It imports SymPy where that is installed, to convert expressions from and to it; in this process
    it does not convert any from then on. For processes that are ours alone.
    """
    if "heyoka" in sys.modules or "sympy" in sys.modules or not _is_installed():
        return
    sys.modules["sympy"] = None  # pyright: ignore[reportArgumentType]  # as if it was not installed
    try:
        heyoka()
    finally:
        del sys.modules["sympy"]


def why_not_taylor(problem: Problem) -> str | None:
    """Reason for "auto" to take DOP853, half a sentence; None where it takes Taylor series."""
    if not _is_installed():
        return "heyoka is not installed"
    mechanism = problem.mechanism
    closed = [stop.name for stop in mechanism.stops if stop.closed]
    if Equations(mechanism).basis(np.array(mechanism.start), closed) is not None:
        return "its constraints depend on each other"
    kinematics = Kinematics(mechanism)
    structure = structure_of(problem, kinematics, numbers_of(problem, kinematics, np.float64) != 0)
    products = TaylorSystem(structure).operations
    if products > MOST_PRODUCTS:
        return f"one evaluation would take {products} products, which are {MOST_PRODUCTS} at most"
    return None


# Sparse algebra of expressions: None stands for what is zero by structure.
_Pair = tuple[Any, Any]  # Re and Im of a complex expression
_Matrix = dict[tuple[int, int], Any]
"""Both triangles of a symmetric matrix; what is zero by structure is absent."""
LinearSolver = Callable[[_Matrix, Sequence[Any]], list[Any]]
"""Makes the solution's expressions of a matrix and a right-hand side, in which None is zero."""


def _times(x: Any, y: Any) -> Any:
    return None if x is None or y is None else x * y


def _minus(x: Any) -> Any:
    return None if x is None else -x


def _total(terms: Iterable[Any]) -> Any:
    """The sum; None if all terms are."""
    kept = [term for term in terms if term is not None]
    return sum(kept[1:], kept[0]) if kept else None


def _dot(x: Iterable[Any], y: Iterable[Any]) -> Any:
    return _total(_times(a, b) for a, b in zip(x, y, strict=True))


def _multiplied(x: _Pair, y: _Pair) -> _Pair:
    """The complex product."""
    real = _total([_times(x[0], y[0]), _minus(_times(x[1], y[1]))])
    return real, _total([_times(x[0], y[1]), _times(x[1], y[0])])


def _combined(terms: Iterable[tuple[Any, _Pair]]) -> _Pair:
    """The sum of complex expressions times real factors."""
    kept = list(terms)
    real = _total(_times(factor, pair[0]) for factor, pair in kept)
    return real, _total(_times(factor, pair[1]) for factor, pair in kept)


def _put(matrix: _Matrix, i: int, j: int, value: Any) -> None:
    """Enter a value and its mirror image, unless it is zero by structure."""
    if value is not None:
        matrix[i, j] = matrix[j, i] = value


@dataclass(frozen=True)
class _Vector:
    """A vector between points as expressions."""

    value: _Pair
    gradient: list[_Pair]
    rate: _Pair
    inward: _Pair  # minus its second derivative without accelerations


class TaylorSystem:
    """Expressions of a structure: accelerations, stop torques and event functions.

    Args:
        structure: sizes, stops, and which numbers are zero.
        algebra: what makes variables, parameters and functions of them; heyoka if left out.
        solve: solves a symmetric system of expressions; elimination if left out.
    """

    def __init__(
        self, structure: Structure, algebra: Any = None, solve: LinearSolver | None = None
    ) -> None:
        self.structure = structure
        self._solve = solve or self._eliminated
        self._hy = algebra or heyoka()
        names = range(structure.n_q)
        self.q: list[Any] = list(self._hy.make_vars(*(f"q{i}" for i in names), "q_")[:-1])
        self.u: list[Any] = list(self._hy.make_vars(*(f"u{i}" for i in names), "u_")[:-1])
        self.observer: Any = self._hy.make_vars("s")
        self._cosines: dict[tuple[int, int | None], _Pair] = {}
        self._turning = dict(structure.carried)
        self._squares = [u * u for u in self.u[: structure.n_angles]]
        # Runtime parameters by section; None where a number is zero by structure.
        indices = np.cumsum(structure.present) - 1
        flat = np.empty(len(indices), dtype=object)
        for i in np.flatnonzero(structure.present):
            flat[i] = self._hy.par[int(indices[i])]
        self._numbers: dict[str, np.ndarray[Any, Any]] = {}
        for name, shape in structure.sections.items():
            size = int(np.prod(shape))
            self._numbers[name], flat = flat[:size].reshape(shape), flat[size:]

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
        observer_rate = _total([*waves, -self.observer])
        return [
            *zip(self.q, self.u, strict=True),
            *zip(self.u, a, strict=True),
            (self.observer, observer_rate),
        ]

    @cached_property
    def torques(self) -> list[Any]:
        """Torque of each stop [N m]: zero where it is free."""
        first = self.structure.n_q + self.structure.n_loops
        return [-multiplier for multiplier in self.solved[first:]]

    @cached_property
    def events(self) -> list[Any]:
        """Event functions, falling through zero: one a stop (1 without event), then the launch."""
        s, par = self.structure, self._hy.par
        functions: list[Any] = []
        for k, torque in enumerate(self.torques):
            active = par[s.active.start + k]
            function = active * torque + (1.0 - active)
            if s.closes:
                watched = par[s.watched.start + k]
                function = active * torque + watched * self.gap(k) + (1.0 - active - watched)
            functions.append(function)
        if s.throws:
            functions.append(par[s.launch] * self.lead + (1.0 - par[s.launch]))
        return functions

    @property
    def lead(self) -> Any:
        """The projectile's velocity across the launch direction (`models.launch.lead`) [m/s]."""
        return _dot(self._component("lead")[0], self.u)

    def gap_speed(self, k: int) -> Any:
        """Speed of the gap of stop k [rad/s or m/s]."""
        return _dot(self._constraints[self.structure.n_loops + k][0], self.u)

    def jump(self, restitution: Sequence[float]) -> list[Any]:
        """Changes of the speeds in an impact of the active stops, then minus the impulses.

        Loops keep their speeds, and each active stop leaves at e times its speed of approach.

        Args:
            restitution: e of each stop.
        """
        s = self.structure
        right: list[Any] = [None] * (s.n_q + s.n_loops)
        for k, e in enumerate(restitution):
            speed = self.gap_speed(k)
            right.append(_times(self._hy.par[s.active.start + k], _minus(speed + e * speed)))
        return self._solve(self._kkt[0], right)

    def _eliminated(self, matrix: _Matrix, right: Sequence[Any]) -> list[Any]:
        return _solve_ldl(matrix, right, self._order[0])

    @property
    def jacobian(self) -> list[Any]:
        """Gradients of all loops, then of all stops whether active or not, row by row."""
        slopes = [slope for gradient, _ in self._constraints for slope in gradient]
        return [self._hy.expression(0.0 if slope is None else slope) for slope in slopes]

    @cached_property
    def solved(self) -> list[Any]:
        """Accelerations, then minus the multipliers of loops and stops."""
        matrix, right = self._kkt
        solved = self._solve(matrix, right)
        # A coordinate that nothing accelerates has a plain zero, of which heyoka makes no
        # expression by itself.
        return [self._hy.expression(x) if isinstance(x, float) else x for x in solved]

    @cached_property
    def operations(self) -> int:
        """Estimated products of one evaluation: of the elimination, and three of each wave."""
        return self._order[1] + 3 * len(self._cosines)

    @cached_property
    def _order(self) -> tuple[list[int], int]:
        """Order of elimination and what it costs."""
        matrix, right = self._kkt
        n_angles = self.structure.n_angles
        # Outer bodies first: a tree then fills in nothing. Slides couple all bodies and come after
        # them.
        usual = [*reversed(range(n_angles)), *range(n_angles, len(right))]
        return _elimination(matrix, self.structure.n_q, usual)

    @cached_property
    def _kkt(self) -> tuple[_Matrix, list[Any]]:
        """Matrix and right-hand side of the system above."""
        s = self.structure
        matrix, right = self._mass_and_forces()
        for k, (gradient, inward) in enumerate(self._constraints[: s.n_loops]):
            right.append(inward)
            for j, slope in enumerate(gradient):
                _put(matrix, s.n_q + k, j, slope)
        for k, (gradient, inward) in enumerate(self._constraints[s.n_loops :]):
            row, active = s.n_q + s.n_loops + k, self._hy.par[s.active.start + k]
            _put(matrix, row, row, active - 1.0)
            right.append(_times(active, inward))
            for j, slope in enumerate(gradient):
                if isinstance(slope, float):  # of an angle, 1 or -1
                    _put(matrix, row, j, active if slope > 0 else -active)
                else:
                    _put(matrix, row, j, _times(active, slope))
        return matrix, right

    def _mass_and_forces(self) -> tuple[_Matrix, list[Any]]:
        """Mass matrix and f = Q - b."""
        s = self.structure
        matrix: _Matrix = {}
        forces: list[list[Any]] = [[slope] for slope in self._component("weights")[0]]
        for i in range(s.n_q):
            for j in range(i, s.n_q):
                wave = self._wave("products", (i, j), i, j)
                for a, b, entry in self._mass_terms(i, j, wave):
                    _put(matrix, a, b, _total([matrix.get((a, b)), entry]))
                # Minus what an entry of H, i <= j, adds to b.
                pairs = [(i, j, wave), (j, i, (wave[0], _minus(wave[1])))]
                for k, other, entry in pairs if i != j else pairs[:1]:
                    real, imaginary = _multiplied(entry, self._curvature[other])
                    forces[k].append(real)
                    if k in self._turning:
                        forces[self._turning[k]].append(_minus(_times(self.q[k], imaginary)))
        for j, force in (*self._spring_forces(), *self._twist_forces()):
            forces[j].append(force)
        for i, j, inertia in self._rotor_inertias():
            _put(matrix, i, j, _total([matrix.get((i, j)), inertia]))
        return matrix, [_total(terms) for terms in forces]

    def _mass_terms(self, i: int, j: int, wave: _Pair) -> Iterator[tuple[int, int, Any]]:
        """Entries of the mass matrix that an entry of H makes, i <= j, with slides on lines."""

        def mirrored(k: int, m: int, value: Any, twice: bool) -> tuple[int, int, Any]:
            """An entry that (i, j) and (j, i) of a product both make: on the diagonal twice."""
            return min(k, m), max(k, m), _times(2.0, value) if k == m and twice else value

        real, imaginary = wave
        yield i, j, real
        c, d = self._turning.get(i), self._turning.get(j)
        if c is not None:  # by the angle that slide i is carried by: q_i Re(i H)
            yield mirrored(c, j, _minus(_times(self.q[i], imaginary)), i != j)
        if d is not None and i != j:
            yield mirrored(d, i, _times(self.q[j], imaginary), True)
        if c is not None and d is not None:
            yield mirrored(c, d, _times(self.q[i] * self.q[j], real), i != j)

    def _spring_forces(self) -> Iterator[tuple[int, Any]]:
        """Generalized forces of springs and dampers between points."""
        for k, needs_length in enumerate(self.structure.springs):
            stiffness, damping, rest = self._numbers["spring_data"][:, k]
            vector = self._vector("springs", "spring_offsets", k)
            factor = _minus(stiffness)
            if needs_length:
                square = _dot(vector.value, vector.value)
                of_rest = _times(stiffness, rest)
                of_rate = _minus(_times(damping, _dot(vector.value, vector.rate)))
                over_length = None if of_rest is None else of_rest / self._hy.sqrt(square)
                over_square = None if of_rate is None else of_rate / square
                factor = _total([factor, over_length, over_square])
            force = _combined([(factor, vector.value)])
            for j, slope in enumerate(vector.gradient):
                yield j, _dot(force, slope)

    def _twist_forces(self) -> Iterator[tuple[int, Any]]:
        """Generalized forces of springs, dampers and motors between angles."""
        for k, row in enumerate(self.structure.twists):
            stiffness, damping, constant, cubic, middle, _ = self._numbers["twist_data"][:, k]
            senses = [(j, float(sense)) for j, sense in enumerate(row) if sense]
            angle = _total(self.q[j] * sense for j, sense in senses)
            rate = _total(self.u[j] * sense for j, sense in senses)
            twist = _total([angle, _minus(middle)])
            cube = _times(_times(twist, twist), twist)
            parts = [(stiffness, angle), (damping, rate), (cubic, cube)]
            torque = _total([constant, *(_minus(_times(factor, x)) for factor, x in parts)])
            for j, sense in senses:
                yield j, _times(torque, sense)

    def _rotor_inertias(self) -> Iterator[tuple[int, int, Any]]:
        """Entries J g_i g_j of the mass matrix, i <= j, of rotors on the angles g . q."""
        for k, row in enumerate(self.structure.twists):
            inertia = self._numbers["twist_data"][5, k]
            senses = [(j, float(sense)) for j, sense in enumerate(row) if sense]
            for i, first in senses:
                for j, second in senses:
                    if i <= j and inertia is not None:
                        yield i, j, _times(inertia, first * second)

    @cached_property
    def _constraints(self) -> list[tuple[list[Any], Any]]:
        """Gradient of each constraint, loops first, and minus gamma."""
        s = self.structure
        constraints: list[tuple[list[Any], Any]] = []
        for k, row in enumerate(s.loop_rows + s.gap_rows):
            if isinstance(row, int):
                constraints.append(self._line(self._places[k], row)[:2])
            elif row is None:
                section = "loops" if k < s.n_loops else "points"
                constraints.append(self._component(section, self._places[k]))
            else:
                constraints.append(([float(sense) if sense else None for sense in row], None))
        return constraints

    def gap(self, k: int) -> Any:
        """Gap of stop k [rad or m]; under the release-once law without its constant."""
        s = self.structure
        row, place = s.gap_rows[k], self._places[s.n_loops + k]
        if isinstance(row, int):
            terms = [self._line(place, row)[2]]
        elif row is None:  # Im of an angle's wave; of a slide itself times Re
            waves = [self._wave("points", (place, j), j) for j in range(s.n_q)]
            terms = [imaginary for _, imaginary in waves[: s.n_angles]]
            for (real, _), q in zip(waves[s.n_angles :], self.q[s.n_angles :], strict=True):
                terms.append(_times(real, q))
        else:
            terms = [q if sense > 0 else -q for q, sense in zip(self.q, row, strict=False) if sense]
        return _total([*terms, _minus(self._numbers["limits"][k])])

    @cached_property
    def _places(self) -> list[int]:
        """Index in its section of each constraint that is not one of angles, loops first."""
        places: list[int] = []
        lines = 0
        for rows in (self.structure.loop_rows, self.structure.gap_rows):
            waves = 0
            for row in rows:
                places.append(lines if isinstance(row, int) else waves)
                lines += isinstance(row, int)
                waves += row is None
        return places

    def _line(self, number: int, body: int) -> tuple[list[Any], Any, Any]:
        """Component in a direction that turns: gradient, minus second derivative, value."""
        vector = self._vector("lines", "line_offsets", number)
        real, imaginary = self._numbers["directions"][:, number]
        along = _multiplied((real, _minus(imaginary)), self._phase(body, None))
        gradient = [_multiplied(along, part)[0] for part in vector.gradient]
        value, across = _multiplied(along, vector.value)
        gradient[body] = _total([gradient[body], _minus(across)])
        inward = [
            _multiplied(along, vector.inward)[0],
            _times(2.0 * self.u[body], _multiplied(along, vector.rate)[1]),
            _times(self._squares[body], value),
        ]
        return gradient, _total(inward), value

    def _component(self, section: str, *at: int) -> tuple[list[Any], Any]:
        """Gradient of a row of waves, and minus its second derivative without accelerations."""
        waves = [self._wave(section, (*at, j), j) for j in range(self.structure.n_q)]
        gradient = [wave[0] for wave in waves]
        for k, c in self._turning.items():
            gradient[c] = _total([gradient[c], _minus(_times(self.q[k], waves[k][1]))])
        inward = [_times(waves[j][1], square) for j, square in enumerate(self._squares)]
        for k in self._turning:
            real, imaginary = self._curvature[k]
            inward += [_times(waves[k][0], real), _times(waves[k][1], imaginary)]
        return gradient, _total(inward)

    def _vector(self, section: str, offsets: str, at: int) -> _Vector:
        """A vector between points from its parts' waves z; Re z - i Im z is an angle's d/dq."""
        n = self.structure.n_angles
        waves = [self._wave(section, (at, j), j) for j in range(self.structure.n_q)]
        gradient: list[_Pair] = [(real, _minus(imaginary)) for real, imaginary in waves]
        terms: list[tuple[Any, _Pair]] = [(1.0, tuple(self._numbers[offsets][:, at]))]
        terms += [(1.0, (imaginary, real)) for real, imaginary in waves[:n]]
        terms += zip(self.q[n:], gradient[n:], strict=True)
        inward = [_multiplied(mu, part) for mu, part in zip(self._curvature, gradient, strict=True)]
        for k, c in self._turning.items():
            gradient[c] = _combined([(1.0, gradient[c]), (-self.q[k], (waves[k][1], waves[k][0]))])
        rate = _combined(zip(self.u, gradient, strict=True))
        return _Vector(_combined(terms), gradient, rate, _combined((1.0, part) for part in inward))

    @cached_property
    def _curvature(self) -> list[_Pair]:
        """Minus the second derivatives of w without accelerations, over its own rates."""
        curvature: list[_Pair] = [(None, square) for square in self._squares]
        curvature += [(None, None)] * self.structure.n_slides
        for k, c in self._turning.items():
            curvature[k] = (self.q[k] * self._squares[c], 2.0 * self.u[k] * self.u[c])
        return curvature

    def _wave(self, section: str, at: tuple[int, ...], i: int, j: int | None = None) -> _Pair:
        """Re and Im of z e^{i(p_i - p_j)}, the phase p an angle itself, of a slide its line's."""
        real, imaginary = (self._numbers[section][(part, *at)] for part in (0, 1))
        n_angles = self.structure.n_angles
        first = i if i < n_angles else self._turning.get(i)
        second = j if j is None or j < n_angles else self._turning.get(j)
        if first == second or (real is None and imaginary is None):
            return real, imaginary
        if first is None:
            assert second is not None
            cosine, sine = self._phase(second, None)
            sine = -sine
        else:
            cosine, sine = self._phase(first, second)
        return (
            _total([_times(real, cosine), _minus(_times(imaginary, sine))]),
            _total([_times(real, sine), _times(imaginary, cosine)]),
        )

    def _phase(self, i: int, j: int | None) -> _Pair:
        if (i, j) not in self._cosines:
            phase = self.q[i] if j is None else self.q[i] - self.q[j]
            self._cosines[i, j] = (self._hy.cos(phase), self._hy.sin(phase))
        return self._cosines[i, j]


def _elimination(
    keys: Iterable[tuple[int, int]], n_free: int, usual: Sequence[int]
) -> tuple[list[int], int]:
    """An order of elimination with little fill-in, and the number of products that it takes.

    Least degree first, of what may be eliminated; the usual order where that is not clearly better.
    The keys are the matrix's entries; the first `n_free` unknowns are accelerations.
    """
    neighbours: dict[int, set[int]] = {i: set() for i in usual}
    for i, j in keys:
        if i != j:
            neighbours[i].add(j)
    # A multiplier waits for the accelerations of its constraint.
    waits = {i: {j for j in neighbours[i] if j < n_free} for i in usual if i >= n_free}
    left, least = {i: set(others) for i, others in neighbours.items()}, list[int]()
    while left:
        ready = [i for i in usual if i in left and not waits.get(i, set()) & left.keys()]
        least.append(min(ready, key=lambda i: len(left[i])))
        _eliminate(left, least[-1])
    usual_cost, least_cost = _products(neighbours, usual), _products(neighbours, least)
    return (least, least_cost) if least_cost < _WORTH * usual_cost else (list(usual), usual_cost)


def _eliminate(left: dict[int, set[int]], k: int) -> int:
    """Take an unknown out of a graph, joining its neighbours; their number."""
    neighbours = left.pop(k)
    for i in neighbours:
        left[i] |= neighbours
        left[i] -= {i, k}
    return len(neighbours)


def _products(neighbours: Mapping[int, set[int]], order: Sequence[int]) -> int:
    left = {i: set(others) for i, others in neighbours.items()}
    degrees = [_eliminate(left, k) for k in order]
    return sum(d * (d + 1) // 2 + 3 * d + 1 for d in degrees)


def _solve_ldl(matrix: _Matrix, right: Sequence[Any], order: Sequence[int]) -> list[Any]:
    """Solve a sparse symmetric system by L D L^T in the given order, without pivoting.

    The matrix is positive definite among the accelerations, and after their elimination negative
    definite among the multipliers. So accelerations may be eliminated in any order, and a
    multiplier as soon as all accelerations of its constraint are: what is left on its diagonal is
    -G M^-1 G^T of those, which is not zero.
    """
    a, b = dict(matrix), list(right)
    for step, k in enumerate(order):
        below = [i for i in order[step + 1 :] if (i, k) in a]
        factors = {i: a[i, k] / a[k, k] for i in below}
        for i, factor in factors.items():
            for j in below:
                a[i, j] = _total([a.get((i, j)), -(factor * a[j, k])])
            b[i] = _total([b[i], _minus(_times(factor, b[k]))])
    x: dict[int, Any] = {}
    for step, k in reversed(list(enumerate(order))):
        rest = [_minus(_times(a.get((k, i)), x[i])) for i in order[step + 1 :]]
        x[k] = _total([b[k], *rest])
        x[k] = None if x[k] is None else x[k] / a[k, k]
    return [x[k] if x[k] is not None else 0.0 for k in range(len(right))]


class _Pool:
    """Idle integrators of one kind; lending is re-entrant and safe between threads."""

    def __init__(self, prototype: Any) -> None:
        self._prototype = prototype
        self._idle: list[Any] = []

    @contextmanager
    def lend(self) -> Generator[Any, None, None]:
        try:
            integrator = self._idle.pop()
        except IndexError:
            integrator = deepcopy(self._prototype)  # a millisecond; compiling takes a second
        yield integrator
        self._idle.append(integrator)  # not after an error: its state is then unknown


@lru_cache(_KEPT)
def scalar_pool(structure: Structure, tolerance: float, real: RealType) -> _Pool:
    """Integrators of one machine at a time, with the system's events as terminal ones."""
    hy, system = heyoka(), TaylorSystem(structure)
    falls = hy.event_direction.negative
    # Parameters are left out: heyoka has as many as it uses, which are less where the last numbers
    # move nothing.
    integrator = hy.taylor_adaptive(
        system.rates,
        np.zeros(2 * structure.n_q + 1, dtype=real),
        t_events=[hy.t_event(f, direction=falls, fp_type=real) for f in system.events],
        tol=real(tolerance),
        fp_type=real,
        compact_mode=system.operations > _UNROLLED,
    )
    integrator.pars[:] = 1.0
    return _Pool(integrator)


class Relay:
    """Callback of an event of a batch integrator, which passes it on to who has borrowed that one.

    heyoka copies it with the integrator. The receiver gets the index of the event and the lane, and
    says whether the integrator is to go on.
    """

    def __init__(self, event: int) -> None:
        self._event = event
        self.receiver: Callable[[int, int], bool] | None = None

    def __call__(self, integrator: Any, sign: int, lane: int) -> bool:
        """Pass an event on; heyoka calls this."""
        return self.receiver is not None and self.receiver(self._event, lane)


@lru_cache(_KEPT)
def batch_pool(structure: Structure, tolerance: float, many: bool) -> _Pool:
    """Integrators of several machines at once, in the lanes of the processor's vectors.

    For many machines it is worth while to compile longer, for two vectors of lanes.
    """
    hy, system = heyoka(), TaylorSystem(structure)
    lanes = int(hy.recommended_simd_size()) * (1 + (many and system.operations <= _SHORT))
    falls, events = hy.event_direction.negative, list[Any]()
    for k, function in enumerate(system.events):
        events.append(hy.t_event_batch(function, direction=falls, callback=Relay(k)))
    integrator = hy.taylor_adaptive_batch(
        system.rates,
        np.zeros((2 * structure.n_q + 1, lanes)),
        pars=np.ones((structure.n_parameters, lanes)),
        t_events=events,
        tol=tolerance,
        compact_mode=system.operations > _UNROLLED,
    )
    return _Pool(integrator)


def _compiled(system: TaylorSystem, outputs: list[Any], inputs: list[Any], **options: Any) -> Any:
    return heyoka().cfunc(outputs, inputs, compact_mode=system.operations > _UNROLLED, **options)


@lru_cache(_KEPT)
def jacobian_function(structure: Structure) -> Any:
    """Jacobian of all constraints: f(q, pars=...), (n_q, n) -> (n_constraints * n_q, n)."""
    system = TaylorSystem(structure)
    return _compiled(system, system.jacobian, system.q)


@lru_cache(_KEPT)
def torque_function(structure: Structure, real: RealType) -> Any:
    """Stop torques: f(state, pars=...), (2 n_q,) or (2 n_q, n); active switches end pars."""
    system = TaylorSystem(structure)
    return _compiled(system, system.torques, [*system.q, *system.u], fp_type=real)
