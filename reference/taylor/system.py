r"""The equations of motion and the events as heyoka expressions, and their compilation.

One compiled integrator serves every machine of a structure and every active set: the numbers are runtime
parameters, and a stop is switched by a parameter h, 1 active and 0 free, in the symmetric system

    [ M      (hG)^T    ] [   a  ]   [    f   ]
    [ hG   -diag(1-h)  ] [ -lam ] = [ -gamma ],      f = Q - b,

whose row of a free stop reads lam = 0 (loops of joints are always active; gamma of a stop on angles is 0). M is
positive definite and what elimination leaves of the constraints is negative definite, so that L D L^T needs no pivoting
(symmetric quasidefinite matrices: Vanderbei, SIAM J. Optim. 5 (1995) 100).
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import contextmanager
from copy import deepcopy
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from ...models.errors import EngineNotInstalledError
from .machine import RealType, Structure

_KEPT = 32  # compiled systems; one takes about a megabyte and a second

_Wave = tuple[Any, Any]
"""Re and Im of z e^{i phase} as expressions; None where zero by structure."""


def heyoka() -> Any:
    """The library, imported when first asked for: it takes a quarter of a second.

    Raises:
        EngineNotInstalledError: it is not here.
    """
    try:
        return importlib.import_module("heyoka")
    except ImportError:
        raise EngineNotInstalledError(
            "the Taylor integrator needs heyoka, which is not installed here; on Linux `pip install heyoka` brings it."
        ) from None


class TaylorSystem:
    """Expressions of a structure: accelerations, stop torques, and functions that fall through zero at events."""

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

        The step is chosen from the last two Taylor coefficients (Jorba and Zou, Exp. Math. 14 (2005) 99). A symmetry
        may make both vanish: a pendulum let go from level has only every fourth power of time in its angle, and steps
        then become far too long. The observer s' = sum_i (cos q_i + sin q_i) - s has no such symmetry, and is bounded.
        """
        a = self._solved[: self.structure.n_q]
        waves = [wave for i in range(self.structure.n_angles) for wave in self._phase(i, None)]
        return [
            *zip(self.q, self.u, strict=True),
            *zip(self.u, a, strict=True),
            (self.observer, _sum([*waves, -self.observer])),
        ]

    @cached_property
    def torques(self) -> list[Any]:
        """Torque of each stop [N m]: zero where it is free."""
        first = self.structure.n_q + self.structure.n_loops
        return [-multiplier for multiplier in self._solved[first:]]

    @cached_property
    def events(self) -> list[Any]:
        """Falls through zero at an event: one for each stop (1 where it has no event), then the launch."""
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

    def _wave(self, section: str, at: tuple[int, ...], i: int, j: int | None = None) -> _Wave:
        """Re and Im of z e^{i(q_i - q_j)}, the phase of a slide being none."""
        real, imaginary = (self._numbers[section][(part, *at)] for part in (0, 1))
        if real is None and imaginary is None:
            return None, None
        n = self.structure.n_angles
        if i >= n or i == j:
            return real, None
        cosine, sine = self._phase(i, j if j is not None and j < n else None)
        return (
            _sum([_times(real, cosine), _minus(_times(imaginary, sine))]),
            _sum([_times(real, sine), _times(imaginary, cosine)]),
        )

    def _phase(self, i: int, j: int | None) -> tuple[Any, Any]:
        if (i, j) not in self._cosines:
            phase = self.q[i] if j is None else self.q[i] - self.q[j]
            self._cosines[i, j] = (self._hy.cos(phase), self._hy.sin(phase))
        return self._cosines[i, j]

    @cached_property
    def _squares(self) -> list[Any]:
        return [u * u for u in self.u[: self.structure.n_angles]]

    def _gap(self, k: int) -> Any:
        row = self.structure.gap_rows[k]
        if row is None:
            waves = [self._gap_term(self.structure.point_stops.index(k), j) for j in range(self.structure.n_q)]
            return _sum([*waves, _minus(self._numbers["limits"][k])])
        turned = [q if sense > 0 else -q for q, sense in zip(self.q, row, strict=False) if sense]
        return _sum([*turned, _minus(self._numbers["limits"][k])])

    def _gap_term(self, point: int, j: int) -> Any:
        """The term of one coordinate in a point stop's gap: Im of its gradient's wave; of a slide, itself times Re."""
        real, imaginary = self._wave("points", (point, j), j)
        return _times(real, self.q[j]) if j >= self.structure.n_angles else imaginary

    @cached_property
    def _lead(self) -> Any:
        """The projectile's velocity across the launch direction (:func:`...models.launch.lead`)."""
        terms = [_times(self._wave("lead", (j,), j)[0], u) for j, u in enumerate(self.u)]
        return _sum(terms)

    @cached_property
    def _solved(self) -> list[Any]:
        """Accelerations, then minus the multipliers of loops and stops."""
        s = self.structure
        matrix, right = self._mass_and_forces()
        for k in range(s.n_loops):
            row, bias = s.n_q + k, list[Any]()
            for j in range(s.n_q):
                real, imaginary = self._wave("loops", (k, j), j)
                _put(matrix, row, j, real)
                bias.append(_times(imaginary, self._squares[j]) if j < s.n_angles else None)
            right.append(_sum(bias))  # -gamma
        for k, gap_row in enumerate(s.gap_rows):
            row, active = s.n_q + s.n_loops + k, self._par(s.active.start + k)
            _put(matrix, row, row, active - 1.0)
            if gap_row is None:
                right.append(self._hold_point(matrix, row, s.point_stops.index(k), active))
                continue
            for j, sense in enumerate(gap_row):
                _put(matrix, row, j, {1: active, -1: -active, 0: None}[sense])
            right.append(None)
        # Outer bodies first: a tree then fills in nothing. Slides couple all bodies and come after them.
        order = [*reversed(range(s.n_angles)), *range(s.n_angles, len(right))]
        solved = solve_ldl(matrix, right, order)
        # A coordinate that nothing accelerates has a plain zero, of which heyoka makes no expression by itself.
        return [self._hy.expression(value) if isinstance(value, float) else value for value in solved]

    def _hold_point(self, matrix: dict[tuple[int, int], Any], row: int, point: int, active: Any) -> Any:
        """Put a point stop's gradient into its row; what belongs on the right, -gamma."""
        bias: list[Any] = []
        for j in range(self.structure.n_q):
            real, imaginary = self._wave("points", (point, j), j)
            _put(matrix, row, j, _times(active, real))
            bias.append(_times(imaginary, self._squares[j]) if j < self.structure.n_angles else None)
        return _times(active, _sum(bias))

    def _mass_and_forces(self) -> tuple[dict[tuple[int, int], Any], list[Any]]:
        s = self.structure
        matrix: dict[tuple[int, int], Any] = {}
        forces: list[list[Any]] = [[self._wave("weights", (i,), i)[0]] for i in range(s.n_q)]
        for i in range(s.n_q):
            for j in range(i, s.n_q):
                real, imaginary = self._wave("products", (i, j), i, j)
                _put(matrix, i, j, real)
                if j < s.n_angles and j > i:
                    forces[i].append(_minus(_times(imaginary, self._squares[j])))
                if i < s.n_angles and j > i:  # H_ji = conj(H_ij)
                    forces[j].append(_times(imaginary, self._squares[i]))
        return matrix, [_sum(terms) for terms in forces]


def _put(matrix: dict[tuple[int, int], Any], i: int, j: int, value: Any) -> None:
    if value is not None:
        matrix[i, j] = matrix[j, i] = value


def _times(x: Any, y: Any) -> Any:
    return None if x is None or y is None else x * y


def _minus(x: Any) -> Any:
    return None if x is None else -x


def _sum(terms: Iterable[Any]) -> Any:
    kept = [term for term in terms if term is not None]
    return sum(kept[1:], kept[0]) if kept else None


def solve_ldl(matrix: dict[tuple[int, int], Any], right: Sequence[Any], order: Sequence[int]) -> list[Any]:
    """Solve a sparse symmetric system by L D L^T in the given order, without pivoting.

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
                a[i, j] = _sum([a.get((i, j)), -(factor * a[j, k])])
            b[i] = _sum([b[i], _minus(_times(factor, b[k]))])
    x: dict[int, Any] = {}
    for step, k in reversed(list(enumerate(order))):
        rest = [_minus(_times(a.get((k, i)), x[i])) for i in order[step + 1 :]]
        x[k] = _sum([b[k], *rest])
        x[k] = None if x[k] is None else x[k] / a[k, k]
    return [x[k] if x[k] is not None else 0.0 for k in range(len(right))]


class _Pool:
    """Integrators of one kind that are not in use: lending is re-entrant and safe between threads."""

    def __init__(self, make: Callable[[], Any]) -> None:
        self._prototype = make()
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

    def make() -> Any:
        hy, system = heyoka(), TaylorSystem(structure)
        falls = hy.event_direction.negative
        events = [hy.t_event(function, direction=falls, fp_type=real) for function in system.events]
        state = np.zeros(structure.n_states, dtype=real)
        pars = np.ones(structure.n_parameters, dtype=real)
        return hy.taylor_adaptive(system.rates, state, pars=pars, t_events=events, tol=real(tolerance), fp_type=real)

    return _Pool(make)


@lru_cache(_KEPT)
def batch_pool(structure: Structure, tolerance: float, lanes: int) -> _Pool:
    """Integrators of several machines at once, in the lanes of the processor's vectors."""

    def make() -> Any:
        hy, system = heyoka(), TaylorSystem(structure)
        falls = hy.event_direction.negative
        events = [hy.t_event_batch(function, direction=falls) for function in system.events]
        state, pars = np.zeros((structure.n_states, lanes)), np.ones((structure.n_parameters, lanes))
        return hy.taylor_adaptive_batch(system.rates, state, pars=pars, t_events=events, tol=tolerance)

    return _Pool(make)


@lru_cache(_KEPT)
def torque_function(structure: Structure, real: RealType) -> Any:
    """Stop torques: f(state, pars=...), shapes (2 n_q,) or (2 n_q, n); the parameters end with the active switches."""
    hy, system = heyoka(), TaylorSystem(structure)
    return hy.cfunc(system.torques, [*system.q, *system.u], fp_type=real)
