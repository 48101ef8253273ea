"""The velocity increment of one Chipmunk step to the assembly's present position, its impulses converged."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pymunk

from ...models.arrays import FloatArray
from ...models.errors import SimulationError
from .build import Assembly
from .read import Reading, Samples

STEP = 1.0  # [s]
# The accuracy of the impulses is an option of a run, not of the model: passes are doubled until they converge.
_FIRST_PASSES, _ROUNDS = 500, 12
_SETTLED = 5e-14  # change of the velocities in a round: some 200 roundings, the noise that remains
_ENOUGH = 1e-11  # a tenth of the tolerance to which models are compared; rounding errors add up over the passes

_Position = tuple[pymunk.Vec2d, float]  # position [m] and angle [rad] of a body


def settled_increment(assembly: Assembly) -> FloatArray:
    """Change of the bodies' rates (:func:`rates_of`) in a step of `STEP`, shape (n_bodies, 3); they are then restored.

    Raises:
        SimulationError: the impulses do not converge, because masses differ too much.
    """
    before = rates_of(assembly)
    positions = [(body.position, body.angle) for body in assembly.bodies]
    increment = _increment(assembly, positions, before)
    set_rates(assembly, before)
    return increment


def _increment(assembly: Assembly, positions: Sequence[_Position], before: FloatArray) -> FloatArray:
    # A joint's error has the rounding of its ends' positions, however small the accelerations are.
    reach = max(abs(complex(*position)) for position, _ in positions) / STEP
    increment, change = np.full_like(before, np.inf), math.inf
    for doublings in range(_ROUNDS):
        _move_back(assembly, positions, before)
        # The step is repeated from the same state, and starts with the impulses found so far.
        assembly.space.iterations = _FIRST_PASSES * 2**doublings
        assembly.space.step(STEP)
        last, increment = increment, rates_of(assembly) - before
        previous, change = change, float(np.abs(increment - last).max() / max(np.abs(increment).max(), reach))
        if change <= _SETTLED or previous < change <= _ENOUGH:
            break
    if not change <= _ENOUGH:
        raise SimulationError(
            f"pymunk's impulses on {assembly.mechanism.name!r} are not settled after "
            f"{assembly.space.iterations} passes: its masses differ too much for them."
        )
    return increment


def rates_of(assembly: Assembly) -> FloatArray:
    """Velocities and angular velocities of the bodies, shape (n_bodies, 3)."""
    return np.array([[*body.velocity, body.angular_velocity] for body in assembly.bodies])


def set_rates(assembly: Assembly, rates: FloatArray) -> None:
    """Give the bodies these velocities and angular velocities, shape (n_bodies, 3)."""
    for body, (x, y, spin) in zip(assembly.bodies, rates.tolist(), strict=True):
        body.velocity, body.angular_velocity = (x, y), spin


def _move_back(assembly: Assembly, positions: Sequence[_Position], rates: FloatArray) -> None:
    """By one step: Chipmunk's step moves the bodies first, and so brings them to these positions."""
    set_rates(assembly, rates)
    for body, (position, angle) in zip(assembly.bodies, positions, strict=True):
        body.position = position - STEP * body.velocity
        body.angle = angle - STEP * body.angular_velocity


def reading_of(assembly: Assembly, accelerations: FloatArray | None = None) -> Reading:
    """The bodies' present state as one sample; accelerations as in :func:`rates_of`, zero if left out."""
    rates = rates_of(assembly)
    rates, changes = rates.T, (np.zeros_like(rates) if accelerations is None else accelerations).T
    samples = Samples(
        position=np.array([[complex(*body.position) for body in assembly.bodies]]),
        angle=np.array([[body.angle for body in assembly.bodies]]),
        velocity=(rates[0] + 1j * rates[1])[None],
        spin=rates[2][None],
        acceleration=(changes[0] + 1j * changes[1])[None],
        spin_rate=changes[2][None],
    )
    return Reading(assembly, samples)
