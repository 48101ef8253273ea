"""Machines of the same kind as the one asked about: settings are to hold on them, too.

They are drawn at random, each independently of the others. Of n machines so drawn and one more, each is as likely as
any other to be the worst; so a fresh one from the same ranges is worse than the worst of n in one case of n + 1,
whatever the distribution of their errors.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np

from ...models.errors import TrebucheckError
from ...models.machines.registry import model, parameters_type
from ...models.mechanism import Mechanism
from ...models.spec import Spec

LENGTH, MASS, ANGLE, GRAVITY = 1.4, 2.5, 0.3, 1.4
"""Lengths, masses and gravity are varied up to these factors, up and down; start angles by that much [rad]."""

_LENGTHS, _MASSES, _ANGLES = ("l1", "l2", "r", "h"), ("m_b", "m_cw", "m_a"), ("theta0", "phi0", "alpha0")
_SEED = 1  # the family is the same in every run

Neighbour = tuple[Mechanism, dict[str, float]]
"""A machine, and the parameters (or factors) it was made with."""


def of_parameters(name: str, parameters: Spec | None) -> Iterator[Neighbour]:
    """Endless neighbours of a named machine: lengths, masses and start angles varied; gravity kept."""
    kind = parameters_type(name)
    base = (parameters or kind()).model_dump()
    random = np.random.default_rng(_SEED)
    while True:
        own = {key: base[key] * _factor(random, LENGTH) for key in _LENGTHS if key in base}
        own |= {key: base[key] * _factor(random, MASS) for key in _MASSES if key in base}
        own |= {key: base[key] + float(random.uniform(-ANGLE, ANGLE)) for key in _ANGLES if key in base}
        yield from _built(lambda own=own: model(name, kind(**(base | own))), own)


def of_mechanism(mechanism: Mechanism) -> Iterator[Neighbour]:
    """Endless neighbours of any mechanism: masses (inertia with them) and gravity; its geometry is its own."""
    random = np.random.default_rng(_SEED)
    while True:
        factors = {f"mass of {body.name}": _factor(random, MASS) for body in mechanism.bodies}
        gravity = _factor(random, GRAVITY)
        yield from _built(
            lambda factors=factors, gravity=gravity: _scaled(mechanism, list(factors.values()), gravity),
            factors | {"gravity": gravity},
        )


def _factor(random: np.random.Generator, largest: float) -> float:
    return float(math.exp(random.uniform(-1.0, 1.0) * math.log(largest)))


def _scaled(mechanism: Mechanism, factors: list[float], gravity: float) -> Mechanism:
    bodies = tuple(
        body.model_copy(update={"mass": body.mass * factor, "inertia": body.inertia * factor})
        for body, factor in zip(mechanism.bodies, factors, strict=True)
    )
    return mechanism.model_copy(update={"bodies": bodies, "gravity": mechanism.gravity * gravity})


def _built(make: Callable[[], Mechanism], own: dict[str, float]) -> Iterator[Neighbour]:
    try:
        yield make(), own
    except TrebucheckError:
        return  # outside what a machine can be: the next draw will do
