"""The impact of all contacts that touch, by Chipmunk's own impulses.

A step without gravity to the assembly's present position yields only the impulses that bring each
joint's speed to its target: zero for the joints, -e times its speed before for a stop (Newton's law
of restitution). Which contacts take part is decided for all of them at once: those that do push,
and the others part at no less than their restitution demands (:mod:`..impact_law`).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
from pymunk import constraints

from ...models.arrays import FloatArray
from ...models.errors import SimulationError
from ...models.kinematics import Kinematics, initial_state
from ...models.mechanism import Mechanism
from ..events import Contacts, resting
from ..impact import pushing
from .bodies import Assembly
from .build import build
from .leapfrog import STEP, settled_increment
from .reactions import forces_of
from .read import reading_of

_ROUNDING = 1e-9  # of the speeds or the largest impulse: error of what should be zero


@dataclass(frozen=True)
class Impact:
    """Result of an impact."""

    u: FloatArray
    """Generalized speeds after it, shape (n_q,)."""
    impulses: Mapping[str, float]
    """Impulse of each contact that touches [N m s, or N s for one on a point]."""
    resting: Contacts
    """Those of them whose gap does not move after it."""
    violated: str | None
    """A contact that would have to pull or goes on closing: other contacts take part."""


def gap_speeds(
    mechanism: Mechanism, names: Collection[str], q: FloatArray, u: FloatArray
) -> dict[str, float]:
    """Speeds of the stops' gaps [rad/s or m/s]."""
    kinematics = Kinematics(mechanism)
    return {name: float(kinematics.gap_jacobian(name, q) @ u) for name in names}


def resolve_impact(
    placed: Mechanism,
    restitution: Mapping[str, float],
    pivot_mass: float,
    held: Collection[str] = (),
) -> Impact:
    """The impact of the contacts that touch.

    Args:
        placed: the mechanism at its position there, with the speeds before; stops that touch are
        closed in it.
        restitution: e of each of them.
        pivot_mass: as the engine's option.
        held: those that come to rest even if they have to pull, which is not recorded: forces bring
            them back to their walls at once. They are left to the others' impact where that
            contradicts itself.

    Raises:
        SimulationError: the impulses do not converge, or no set of contacts takes part.
    """
    # Not validated: stops keep the word on whether they touch.
    weightless = placed.model_copy(update={"gravity": 0.0, "force_elements": ()})
    impact = _complementary(weightless, restitution, pivot_mass, held) if held else None
    impact = impact or _complementary(weightless, restitution, pivot_mass)
    if impact is None and any(restitution.values()):
        impact = _complementary(weightless, dict.fromkeys(restitution, 0.0), pivot_mass)
    if impact is None:
        raise SimulationError(
            f"pymunk finds no impact of the stops {', '.join(restitution)} in which all of them "
            "push."
        )
    return impact


def _complementary(
    placed: Mechanism,
    restitution: Mapping[str, float],
    pivot_mass: float,
    held: Collection[str] = (),
) -> Impact | None:
    impacts: dict[Contacts, Impact] = {}

    def violated(active: Contacts) -> str | None:
        if active not in impacts:
            taking_part = tuple(name for name in restitution if name in active or name in held)
            impacts[active] = _impact_of(placed, taking_part, restitution, pivot_mass, held)
        return impacts[active].violated

    active = pushing(tuple(name for name in restitution if name not in held), violated)
    return (
        None if active is None or not set(held) <= set(impacts[active].resting) else impacts[active]
    )


def _impact_of(
    placed: Mechanism,
    active: Contacts,
    restitution: Mapping[str, float],
    pivot_mass: float,
    held: Collection[str] = (),
) -> Impact:
    """The impact if these contacts alone take part, those that are held even if they pull."""
    assembly = build(placed, active, 0.0, pivot_mass)
    for name in active:
        _set_target(assembly.stops[name], restitution[name])
    increment = settled_increment(assembly)
    impulses = _impulses(assembly, increment, active)
    (q, before), after = initial_state(placed), _speeds_after(assembly, increment)
    came, left = (gap_speeds(placed, restitution, q, u) for u in (before, after))
    rounding = _ROUNDING * (1.0 + max(map(abs, came.values()), default=0.0))
    total = dict.fromkeys(restitution, 0.0) | impulses
    least = -_ROUNDING * max(total.values())
    kinematics = Kinematics(placed)

    def gap(name: str) -> float:
        return float(kinematics.gap(name, q))

    beyond = {name: left[name] + restitution[name] * came[name] for name in restitution}
    wrong = [
        name
        for name in restitution
        if (total[name] < least if name in active else beyond[name] < -rounding)
    ]
    # Stops whose targets contradict each other meet one of them at most. A gap that is left is
    # closed in the step, unless the stop's joint was built where its bodies are.
    wrong += [
        name
        for name in active
        if min(abs(beyond[name]), abs(beyond[name] + gap(name) / STEP)) > rounding
    ]
    recorded = {
        name: max(impulse, 0.0) if name in held else impulse for name, impulse in total.items()
    }
    violated = next((name for name in wrong if name not in held), None)
    return Impact(after, recorded, resting(left, rounding), violated)


def _set_target(joint: constraints.Constraint, restitution: float) -> None:
    """Displace the target of a stop's joint by the way it is to part in the step."""
    if isinstance(joint, constraints.GearJoint):
        spin = joint.b.angular_velocity - joint.a.angular_velocity
        joint.phase += -restitution * spin * STEP
    elif isinstance(joint, constraints.PinJoint):
        a = joint.a.position + joint.anchor_a.rotated(joint.a.angle)
        b = joint.b.position + joint.anchor_b.rotated(joint.b.angle)
        ends = (
            joint.a.velocity_at_local_point(joint.anchor_a),
            joint.b.velocity_at_local_point(joint.anchor_b),
        )
        joint.distance += -restitution * (ends[1] - ends[0]).dot((b - a).normalized()) * STEP


def _impulses(assembly: Assembly, increment: FloatArray, active: Contacts) -> dict[str, float]:
    """Impulses of the contacts that take part, by the bodies' change of momentum."""
    assembly.rates = np.zeros_like(increment)
    torques = forces_of(reading_of(assembly, increment), active).torques
    return {name: float(torques[name][0]) for name in active}


def _speeds_after(assembly: Assembly, increment: FloatArray) -> FloatArray:
    """Generalized speeds after the bodies' change of velocity, shape (n_q,)."""
    assembly.rates = increment
    change = reading_of(assembly).coordinates()[1][0]
    return np.asarray(initial_state(assembly.mechanism)[1] + change, dtype=np.float64)
