"""One step of Chipmunk's machine to the state where it stands, its impulses found as exactly as they can be."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pymunk

from ...models.arrays import FloatArray
from ...models.errors import SimulationError
from .build import Machine
from .read import Reading, Samples

STEP = 1.0  # [s]
# How far the impulses are solved is an option of a run, not of the model: passes are doubled until they are settled.
_FIRST_PASSES, _ROUNDS = 500, 12
_SETTLED = 5e-14  # change of the velocities in a round: some 200 roundings, beyond which they only flicker
_ENOUGH = 1e-11  # a tenth of what models are compared to; rounding that adds up over the passes may end nearer to it

_Place = tuple[pymunk.Vec2d, float]  # position [m] and angle [rad] of a body


def settled_kick(machine: Machine) -> FloatArray:
    """Change of the bodies' rates (:func:`rates_of`) in a step of `STEP`, shape (n_bodies, 3); they are left as before.

    Raises:
        SimulationError: the impulses do not settle, because masses differ too much.
    """
    before = rates_of(machine)
    places = [(body.position, body.angle) for body in machine.bodies]
    kick = _kick(machine, places, before)
    for body, (x, y, spin) in zip(machine.bodies, before.tolist(), strict=True):
        body.velocity, body.angular_velocity = (x, y), spin
    return kick


def _kick(machine: Machine, places: Sequence[_Place], before: FloatArray) -> FloatArray:
    # A joint feels its ends' rounding, which is of the places' size, however small the accelerations are.
    reach = max(abs(complex(*position)) for position, _ in places) / STEP
    kick, change = np.full_like(before, np.inf), math.inf
    for doublings in range(_ROUNDS):
        _put_back(machine, places, before)
        # Taken once more from where it began, the step goes on with the impulses it has found.
        machine.space.iterations = _FIRST_PASSES * 2**doublings
        machine.space.step(STEP)
        last, kick = kick, rates_of(machine) - before
        previous, change = change, float(np.abs(kick - last).max() / max(np.abs(kick).max(), reach))
        if change <= _SETTLED or previous < change <= _ENOUGH:
            break
    if not change <= _ENOUGH:
        raise SimulationError(
            f"pymunk cannot hold {machine.mechanism.name!r} in one place: its impulses are not settled after "
            f"{machine.space.iterations} passes; its masses differ too much for them."
        )
    return kick


def rates_of(machine: Machine) -> FloatArray:
    """Velocities and angular velocities of the bodies, shape (n_bodies, 3)."""
    return np.array([[*body.velocity, body.angular_velocity] for body in machine.bodies])


def _put_back(machine: Machine, places: Sequence[_Place], rates: FloatArray) -> None:
    """By one step, which moves the bodies first and so brings them to where they stand."""
    for body, (position, angle), (x, y, spin) in zip(machine.bodies, places, rates.tolist(), strict=True):
        body.velocity, body.angular_velocity = (x, y), spin
        body.position = position - STEP * body.velocity
        body.angle = angle - STEP * spin


def reading_of(machine: Machine, accelerations: FloatArray | None = None) -> Reading:
    """The bodies as they are, as one sample; accelerations as in :func:`rates_of`, left out where none are asked."""
    rates = rates_of(machine)
    rates, changes = rates.T, (np.zeros_like(rates) if accelerations is None else accelerations).T
    samples = Samples(
        place=np.array([[complex(*body.position) for body in machine.bodies]]),
        angle=np.array([[body.angle for body in machine.bodies]]),
        velocity=(rates[0] + 1j * rates[1])[None],
        spin=rates[2][None],
        acceleration=(changes[0] + 1j * changes[1])[None],
        spin_rate=changes[2][None],
    )
    return Reading(machine, samples)
