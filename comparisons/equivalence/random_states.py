"""Random states in which built models are compared: near the start, consistent, with chosen active contacts."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain, combinations

import numpy as np

from ...engines.inspection import State
from ...models.arrays import FloatArray
from ...models.mechanism import Mechanism
from ...reference.contact import active_contacts
from ...reference.equations import Equations, consistent_coordinates, consistent_speeds

_SPREAD = 0.5  # [rad or m] of the coordinates about the start
_SPEED = 1.0  # [rad/s or m/s]
_OPEN = 0.02  # [rad] least gap of an open stop: well beyond the margin at which any engine makes a contact
_DRAWS = 60  # for one set of stops; if they are never all active, those that are are taken


def random_states(mechanism: Mechanism, n: int = 24, seed: int = 20) -> tuple[State, ...]:
    """States over all sets of stops that are closed at the start, the same ones each time.

    The first one is the start itself, with the stops that are active there. Fewer than n come back only where a machine
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
    """A state in which exactly these stops are active; else one with fewer; None if there is none."""
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
        q = consistent_coordinates(equations, start + random.uniform(-_SPREAD, _SPREAD, len(start)), touching)
        if q is None or any(float(equations.kinematics.gap(name, q)) < _OPEN for name in others):
            continue
        yield q, consistent_speeds(equations, q, random.uniform(-_SPEED, _SPEED, len(start)), touching)
