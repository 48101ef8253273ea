"""Impacts by Chipmunk's own impulses.

A step without gravity to the place where the machine stands finds nothing but the impulses that bring each joint's
speed to what it aims at: zero for the joints, -e times its speed before for a stop (Newton's law of restitution).
Which of the stops that touch take part is a question of signs, decided for all of them at once: those that do push,
and the others part no more slowly than their restitution has it (Moreau).
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from pymunk import constraints

from ...models.arrays import FloatArray
from ...models.errors import SimulationError
from ...models.kinematics import Kinematics
from ...models.mechanism import Mechanism
from .build import Machine, build, start_of
from .forces import forces_of
from .velocity_increment import STEP, reading_of, settled_kick

_ROUNDING = 1e-9  # of the speeds, or of the largest impulse: what settled impulses may leave of a zero


@dataclass(frozen=True)
class Impact:
    """What an impact does."""

    u: FloatArray
    """Generalized speeds after it, shape (n_q,)."""
    impulses: Mapping[str, float]
    """Of the stops that touch [N m s, or N s for one on a point]."""
    resting: tuple[str, ...]
    """Those of them whose gap does not move after it."""


def gap_speeds(mechanism: Mechanism, names: Collection[str], q: FloatArray, u: FloatArray) -> dict[str, float]:
    """Speeds of the stops' gaps [rad/s or m/s]."""
    kinematics = Kinematics(mechanism)
    return {name: float(kinematics.gap_jacobian(name, q) @ u) for name in names}


def strike(placed: Mechanism, restitution: Mapping[str, float], pivot_mass: float) -> Impact:
    """The impact of the stops that touch.

    Args:
        placed: the mechanism where it stands, with the speeds before; stops that touch are closed in it.
        restitution: e of each of them.
        pivot_mass: as the engine's option.

    Raises:
        SimulationError: the impulses do not settle, or no set of stops takes part.
    """
    # Not validated: stops keep the word on whether they touch.
    weightless = placed.model_copy(update={"gravity": 0.0})
    for size in range(len(restitution), -1, -1):
        for taking_part in itertools.combinations(restitution, size):
            found = _by(weightless, taking_part, restitution, pivot_mass)
            if found is not None:
                return found
    raise SimulationError(f"pymunk finds no impact of the stops {', '.join(restitution)} in which all of them push.")


def _by(
    placed: Mechanism, taking_part: Sequence[str], restitution: Mapping[str, float], pivot_mass: float
) -> Impact | None:
    """The impact by these stops alone; None if one of them would have to pull, or another one goes on closing."""
    machine = build(placed, taking_part, 0.0, pivot_mass)
    for name in taking_part:
        _aim(machine.stops[name], restitution[name])
    kick = settled_kick(machine)
    impulses = _impulses(machine, kick, taking_part)
    (q, before), after = start_of(placed), _speeds_after(machine, kick)
    came, left = (gap_speeds(placed, restitution, q, u) for u in (before, after))
    slack = _ROUNDING * (1.0 + max(map(abs, came.values()), default=0.0))
    pushes = all(impulse >= -_ROUNDING * max(impulses.values()) for impulse in impulses.values())
    if not pushes or any(left[name] < -restitution[name] * came[name] - slack for name in restitution):
        return None
    resting = tuple(name for name in restitution if abs(left[name]) <= slack)
    return Impact(after, dict.fromkeys(restitution, 0.0) | impulses, resting)


def _aim(joint: constraints.Constraint, restitution: float) -> None:
    """Set a stop's joint aside by the way it is to part in the step."""
    if isinstance(joint, constraints.GearJoint):
        turning = joint.b.angular_velocity - joint.a.angular_velocity
        joint.phase += -restitution * turning * STEP
    elif isinstance(joint, constraints.PinJoint):
        a = joint.a.position + joint.anchor_a.rotated(joint.a.angle)
        b = joint.b.position + joint.anchor_b.rotated(joint.b.angle)
        ends = (
            joint.a.velocity_at_local_point(joint.anchor_a),
            joint.b.velocity_at_local_point(joint.anchor_b),
        )
        joint.distance += -restitution * (ends[1] - ends[0]).dot((b - a).normalized()) * STEP


def _impulses(machine: Machine, kick: FloatArray, closed: Sequence[str]) -> dict[str, float]:
    """Of the stops that take part: what the change of momentum needs, the machine being still."""
    for body in machine.bodies:
        body.velocity, body.angular_velocity = (0.0, 0.0), 0.0
    found = forces_of(reading_of(machine, kick), closed).torques
    return {name: float(found[name][0]) for name in closed}


def _speeds_after(machine: Machine, kick: FloatArray) -> FloatArray:
    """Generalized speeds: those before, and what the bodies' change of velocity makes of them."""
    for body, (x, y, spin) in zip(machine.bodies, kick.tolist(), strict=True):
        body.velocity, body.angular_velocity = (x, y), spin
    change = reading_of(machine).coordinates()[1][0]
    return np.asarray(start_of(machine.mechanism)[1] + change, dtype=np.float64)
