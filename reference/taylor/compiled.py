"""Compilation of a structure's equations, and the integrators that are kept."""

from __future__ import annotations

from collections.abc import Callable, Generator
from contextlib import contextmanager
from copy import deepcopy
from functools import lru_cache
from typing import Any

import numpy as np

from .expressions import TaylorSystem, heyoka
from .numbers import RealType, Structure

_KEPT = 32  # compiled systems; one takes about a megabyte and a second
# Products of one evaluation: to compile more without loops takes longer than it saves.
_UNROLLED = 90


def _is_compact(system: TaylorSystem) -> bool:
    return system.operations > _UNROLLED


class _Pool:
    """Idle integrators of one kind; lending is re-entrant and safe between threads."""

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
        # Parameters are left out: heyoka has as many as it uses, which are less where the last
        # numbers move nothing.
        integrator = hy.taylor_adaptive(
            system.rates,
            state,
            t_events=events,
            tol=real(tolerance),
            fp_type=real,
            compact_mode=_is_compact(system),
        )
        integrator.pars[:] = 1.0
        return integrator

    return _Pool(make)


@lru_cache(_KEPT)
def batch_pool(structure: Structure, tolerance: float, lanes: int) -> _Pool:
    """Integrators of several machines at once, in the lanes of the processor's vectors."""

    def make() -> Any:
        hy, system = heyoka(), TaylorSystem(structure)
        falls = hy.event_direction.negative
        events = [hy.t_event_batch(function, direction=falls) for function in system.events]
        state = np.zeros((structure.n_states, lanes))
        pars = np.ones((structure.n_parameters, lanes))
        compact = _is_compact(system)
        return hy.taylor_adaptive_batch(
            system.rates, state, pars=pars, t_events=events, tol=tolerance, compact_mode=compact
        )

    return _Pool(make)


@lru_cache(_KEPT)
def jacobian_function(structure: Structure) -> Any:
    """Jacobian of all constraints: f(q, pars=...), (n_q, n) -> (n_constraints * n_q, n)."""
    system = TaylorSystem(structure)
    return heyoka().cfunc(system.jacobian, system.q, compact_mode=_is_compact(system))


@lru_cache(_KEPT)
def torque_function(structure: Structure, real: RealType) -> Any:
    """Stop torques: f(state, pars=...), (2 n_q,) or (2 n_q, n); active switches end pars."""
    hy, system = heyoka(), TaylorSystem(structure)
    return hy.cfunc(
        system.torques, [*system.q, *system.u], fp_type=real, compact_mode=_is_compact(system)
    )
