"""Random states in which to look at a built model: near the start, joints fitted, chosen stops closed and pushing."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain, combinations

import numpy as np

from ...engines.inspection import State
from ...models.arrays import FloatArray
from ...models.mechanism import Mechanism
from ...reference.contact import active_contacts
from ...reference.equations import Equations

_SPREAD = 0.5  # [rad or m] of the coordinates about the start
_SPEED = 1.0  # [rad/s or m/s]
_OPEN = 0.02  # [rad] least gap of an open stop: well beyond the margin in which any engine feels a stop
_DRAWS = 60  # for one set of stops; if they never all push, those that do are taken
_FITS = 1e-14  # [rad or m] relative to the size of the coordinates


def random_states(mechanism: Mechanism, n: int = 24, seed: int = 20) -> tuple[State, ...]:
    """States over all sets of stops that are closed at the start, the same ones each time.

    The first one is the start itself, with the stops that push there. Fewer than n come back only where a machine
    allows no state with its other stops open near the start.

    Args:
        n: how many.
        seed: of the random numbers.
    """
    equations = Equations(mechanism)
    sets = _subsets([stop.name for stop in mechanism.stops if stop.closed])
    random = np.random.default_rng(seed)
    states = [_start(equations)]
    for k in range(n - 1):
        found = _state(equations, sets[k % len(sets)], random)
        if found is not None:
            states.append(found)
    return tuple(states)


def _subsets(names: list[str]) -> list[tuple[str, ...]]:
    return list(chain.from_iterable(combinations(names, size) for size in range(len(names), -1, -1)))


def _start(equations: Equations) -> State:
    mechanism = equations.mechanism
    q = np.array(mechanism.start)
    u = np.array(mechanism.start_speeds or [0.0] * len(q))
    touching = tuple(stop.name for stop in mechanism.stops if stop.closed)
    return State(q, u, active_contacts(equations, q, u, touching))


def _state(equations: Equations, touching: tuple[str, ...], random: np.random.Generator) -> State | None:
    """A state in which exactly these stops are closed and push; else one with fewer; None if there is none."""
    fallback: State | None = None
    for q, u in _draws(equations, touching, random):
        if active_contacts(equations, q, u, touching) == touching:
            return State(q, u, touching)
        if fallback is None and touching:
            fallback = _state(equations, touching[:-1], random)
    return fallback


def _draws(
    equations: Equations, touching: tuple[str, ...], random: np.random.Generator
) -> Iterator[tuple[FloatArray, FloatArray]]:
    mechanism = equations.mechanism
    start = np.array(mechanism.start)
    others = [stop.name for stop in mechanism.stops if stop.name not in touching]
    for _ in range(_DRAWS):
        q = _fitted(equations, start + random.uniform(-_SPREAD, _SPREAD, len(start)), touching)
        if q is None or any(float(equations.kinematics.gap(name, q)) < _OPEN for name in others):
            continue
        yield q, _along(equations, q, random.uniform(-_SPEED, _SPEED, len(start)), touching)


def _fitted(equations: Equations, q: FloatArray, touching: tuple[str, ...]) -> FloatArray | None:
    """The nearest coordinates at which loops close and the stops touch (Gauss-Newton); None if there are none."""
    for _ in range(30):
        gaps = [float(equations.kinematics.gap(name, q)) for name in touching]
        error = np.concatenate([np.atleast_1d(equations.loop_residual(q)), gaps])
        if np.abs(error).max(initial=0.0) <= _FITS * (1 + np.abs(q).max()):
            return q
        q = q - np.linalg.lstsq(equations.constraint_jacobian(q, touching), error, rcond=None)[0]
    return None


def _along(equations: Equations, q: FloatArray, u: FloatArray, touching: tuple[str, ...]) -> FloatArray:
    """The nearest speeds that keep loops closed and the stops touching."""
    rows = equations.constraint_jacobian(q, touching)
    return u - np.linalg.lstsq(rows, rows @ u, rcond=None)[0] if len(rows) else u
