"""States in which a built model is looked into: random ones, under every set of stops that are closed at the start."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain, combinations

import numpy as np

from ...engines.inspection import State
from ...engines.units import units_of
from ...models.arrays import FloatArray
from ...models.mechanism import Mechanism
from ...reference.contact import active_contacts
from ...reference.equations import Equations, consistent_coordinates, consistent_speeds

# In the units that engines build a mechanism in:
_SPREAD = 0.5  # [rad or m] of the coordinates about the start
SPEED = 1.0  # [rad/s or m/s]
_ROUNDING = 1e-12  # [rad/s or m/s], or of the terms whose sum is a gap speed
_OPEN = 0.02  # [rad] least gap of an open stop: well beyond the margin at which any engine makes a contact
_DRAWS = 60  # for one set of stops; if they are never all active, those that are are taken


def random_states(mechanism: Mechanism, n: int = 24, seed: int = 20) -> tuple[State, ...]:
    """States over all sets of stops that are closed at the start, the same ones each time.

    The first one is the start itself, with the stops that are active there; if its speeds move the
    gap of a closed stop, with the nearest ones that do not. Fewer than n come back only where a
    machine allows no state with its other stops open near the start.

    Args:
        n: how many.
        seed: of the random numbers.
    """
    units = units_of(
        mechanism
    )  # a state far off a small machine is none that an engine has to get right
    equations = Equations(units.mechanism(mechanism))
    sets = _subsets([stop.name for stop in mechanism.stops if stop.closed])
    random = np.random.default_rng(seed)
    states = [_start(equations)]
    for k in range(n - 1):
        state = _state(equations, sets[k % len(sets)], random)
        if state is not None:
            states.append(state)
    return tuple(units.inverse.states(mechanism, states))


def _subsets(names: list[str]) -> list[tuple[str, ...]]:
    return list(
        chain.from_iterable(combinations(names, size) for size in range(len(names), -1, -1))
    )


def _start(equations: Equations) -> State:
    mechanism = equations.mechanism
    q = np.array(mechanism.start)
    u = np.array(mechanism.start_speeds or [0.0] * len(q))
    touching = tuple(stop.name for stop in mechanism.stops if stop.closed)
    if not all(_rests(equations, stop, q, u) for stop in touching):
        u = consistent_speeds(equations, q, u, touching)
    return State(q, u, active_contacts(equations, q, u, touching))


def _rests(equations: Equations, stop: str, q: FloatArray, u: FloatArray) -> bool:
    """Whether the gap of a stop does not move: a start may drive into a closed stop, or off it."""
    terms = equations.kinematics.gap_jacobian(stop, q) * u
    return abs(float(terms.sum())) <= _ROUNDING * max(1.0, float(np.abs(terms).sum()))


def _state(
    equations: Equations, touching: tuple[str, ...], random: np.random.Generator
) -> State | None:
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
        q = consistent_coordinates(
            equations, start + random.uniform(-_SPREAD, _SPREAD, len(start)), touching
        )
        if q is None or any(float(equations.kinematics.gap(name, q)) < _OPEN for name in others):
            continue
        yield (
            q,
            consistent_speeds(equations, q, random.uniform(-SPEED, SPEED, len(start)), touching),
        )
