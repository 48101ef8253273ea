"""The reference's best release of a machine, by which the rewards are measured."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, cast

import numpy as np
from trebucheck.api.mechanics import (
    Air,
    InputError,
    Mechanism,
    Projectile,
    StopLaw,
    Surroundings,
    fly,
    surroundings_of,
    swing,
)
from trebucheck.api.mjcf import RecordedMotion

# Most first sweeps end within the first or second; beyond, stops strike often.
_SPANS = (1.75, 2.4, 3.0, 6.0, 12.0)
_PICTURES = 60  # states that the camera is fitted to


@dataclass(frozen=True)
class BestThrow:
    """The longest throw of a machine's first sweep, by the reference."""

    time: float
    """Time of the release [s]."""
    range: float
    """Distance of the landing [m], at the height of the fulcrum and measured from its start."""
    sweep_end: float
    """When the first sweep is over [s]; what follows is chaotic."""
    surroundings: Surroundings
    """Surroundings of the flight."""
    projectile: Projectile
    """Its continuous motion, longer than the first sweep."""
    motion: RecordedMotion
    """Up to the release; it has no keyframes."""


def best_throw(mechanism: Mechanism) -> BestThrow:
    """The longest throw without air; stops close again, as MuJoCo's do.

    Args:
        mechanism: with a marker "projectile".

    Raises:
        InputError: there is no projectile, gravity is not downwards, or no release throws forwards.
        SimulationError: the reference cannot move the mechanism.
    """
    # Type checkers do not see that a description has a hash.
    return _best_throw(cast("Any", mechanism))


@lru_cache(maxsize=128)
def _best_throw(mechanism: Mechanism) -> BestThrow:
    projectile = swing(mechanism, stop_law=StopLaw.UNILATERAL, spans=_SPANS)
    surroundings = surroundings_of(projectile, Air(), 0.0)
    release = projectile.best_release(surroundings)
    farthest = 0.0 if release is None else fly(release, surroundings).range
    if release is None or farthest <= 0:
        raise InputError(
            f"{mechanism.name!r} with these parameters throws nothing forwards, whenever it "
            "releases."
        )
    path = _path(mechanism, projectile, release.time)
    return BestThrow(release.time, farthest, projectile.sweep()[1], surroundings, projectile, path)


def _path(mechanism: Mechanism, projectile: Projectile, end: float) -> RecordedMotion:
    q = projectile.solution.motion(np.linspace(0.0, end, _PICTURES)).q
    return RecordedMotion(
        mechanism_hash=mechanism.content_hash,
        keyframes=(),
        path=tuple(tuple(row) for row in q.tolist()),
    )
