"""What may be wrong with a mechanism or the forces in it, each as equations with a fault of a given size."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import groupby

import numpy as np

from ...models.arrays import FloatArray
from ...models.joints import AnyJoint, FreeJoint
from ...models.kinematics import Kinematics
from ...models.mechanism import Mechanism
from ...reference.equations import Equations
from ...reference.perturbed import (
    WithDamping,
    WithJoint,
    WithoutCentrifugal,
    WithRubbing,
    WithTiltedGravity,
)
from .consistent import with_closed_loops
from .suspects import Kind, Suspect, combined, machine_suspects, mechanism_length

_SMALL = 1e-6
_MOST = 10.0  # times the right value: a parameter that is wrong by more is no small mistake of it


@dataclass(frozen=True)
class Component:
    """One number of a hypothesis."""

    label: str
    scale: float
    """Its small size, in its unit; relative where it has none."""
    unit: str
    length: float = math.inf
    """The mechanism's [m]: no point of it is farther off than that."""
    positive: bool = False
    """A stiffness or a damping: less than none would drive the mechanism."""

    def is_sensible(self, factor: float) -> bool:
        """Whether `factor` times the small size is a value that such a fault can have."""
        size = factor * self.scale
        lowest = {"": -1.0, "rad": -math.pi, "m": -self.length}.get(self.unit, -math.inf)
        highest = {"": _MOST, "rad": math.pi, "m": self.length}.get(self.unit, math.inf)
        return (
            math.isfinite(size) and lowest <= size <= highest and not (self.positive and size < 0)
        )

    def text(self, factor: float) -> str:
        """`factor` times the small size."""
        size = factor * self.scale
        value = f"{size:+.3g} {self.unit}" if self.unit else f"{100 * size:+.3g} %"
        return f"{self.label} {value}" if self.label else value


@dataclass(frozen=True)
class Hypothesis:
    """A fault whose size is one number or two."""

    name: str
    kind: Kind
    components: tuple[Component, ...]
    group: str
    """Hypotheses of one group are the same mistake with more or fewer components."""
    make: Callable[[Sequence[float]], Equations | None]
    """Equations with so many times each component's small size; None where there is no such mechanism."""

    def equations(self, factors: Sequence[float]) -> Equations | None:
        """With a fault of that size; None where the size makes no sense, or there is no such mechanism."""
        pairs = zip(self.components, factors, strict=True)
        return self.make(factors) if all(c.is_sensible(factor) for c, factor in pairs) else None

    def text(self, factors: Sequence[float]) -> str:
        """The size."""
        return ", ".join(c.text(factor) for c, factor in zip(self.components, factors, strict=True))


def hypotheses(mechanism: Mechanism, closing: bool = True) -> list[Hypothesis]:
    """All faults of a size; those of several components also with each of them alone.

    Args:
        mechanism: without faults.
        closing: whether the start of a faulty mechanism is moved to where its loops close, as a
            motion needs it.
    """
    suspects = [suspect for suspect in machine_suspects(mechanism) if suspect.scale]
    found: list[Hypothesis] = []
    for _, group in groupby(suspects, key=lambda suspect: suspect.group or suspect.name):
        members = list(group)
        found += [of_suspects(mechanism, suspect.name, [suspect], closing) for suspect in members]
        if len(members) > 1:
            found.append(of_suspects(mechanism, members[0].group, members, closing))
    return [*found, *_laws(mechanism)]


def of_suspects(
    mechanism: Mechanism, name: str, suspects: Sequence[Suspect], closing: bool = False
) -> Hypothesis:
    """A fault of as many numbers as there are suspects."""
    length = 2 * mechanism_length(mechanism)
    labels = (
        [s.name.removeprefix(s.group).lstrip(", ") or "along" for s in suspects]
        if len(suspects) > 1
        else [""]
    )
    components = [
        Component(label, s.scale, s.unit, length) for label, s in zip(labels, suspects, strict=True)
    ]

    def make(factors: Sequence[float]) -> Equations | None:
        wrong = combined(mechanism, suspects, factors)
        closed = with_closed_loops(wrong) if wrong is not None and closing else wrong
        return None if closed is None else Equations(closed)

    return Hypothesis(name, suspects[0].kind, tuple(components), suspects[0].group or name, make)


def _laws(mechanism: Mechanism) -> Iterator[Hypothesis]:
    """Forces that the mechanism does not have, in parts of what gravity can do."""
    length, gravity = mechanism_length(mechanism), mechanism.gravity or 1.0
    torque = _SMALL * sum(body.mass for body in mechanism.bodies) * gravity * length

    def law(
        name: str, make: Callable[[Sequence[float]], Equations], *components: Component
    ) -> Hypothesis:
        return Hypothesis(name, "law", components, name, make)

    if mechanism.gravity:
        tilt = Component("", _SMALL, "rad")
        yield law(
            "direction of gravity", lambda f: WithTiltedGravity(mechanism, f[0] * _SMALL), tilt
        )
    rate = Component("rate", _SMALL * math.sqrt(gravity / length), "1/s", positive=True)
    yield law("damping of all bodies", lambda f: WithDamping(mechanism, f[0] * rate.scale), rate)
    yield from _rubbing(mechanism, torque, math.sqrt(gravity / length), length)
    viscous = Component("viscous", torque * math.sqrt(length / gravity), "N m s/rad", positive=True)
    spring = Component("stiffness", torque, "N m/rad", positive=True)
    constant = Component("torque at the start", torque, "N m")
    for joint in _turning(mechanism):
        element = partial(WithJoint, mechanism, joint.name)
        yield law(
            f"friction or damping of the {joint.name}",
            lambda f, e=element: e(damping=f[0] * viscous.scale),
            viscous,
        )
        yield law(
            f"torque on the {joint.name}", lambda f, e=element: e(torque=f[0] * torque), constant
        )
        yield law(
            f"spring on the {joint.name}", lambda f, e=element: e(stiffness=f[0] * torque), spring
        )
        both = partial(_sprung, element, torque)
        yield law(f"spring on the {joint.name}", both, spring, constant)


def _rubbing(
    mechanism: Mechanism, torque: float, rate: float, length: float
) -> Iterator[Hypothesis]:
    """Viscous friction of slides, each alone, and the same in all joints of a kind."""
    kinematics, n = Kinematics(mechanism), len(mechanism.coordinates)
    pins = np.array(
        [kinematics.angle(joint.child, joint.parent).coefficients for joint in _turning(mechanism)]
    )
    slides = np.eye(n)[
        [i for i, name in enumerate(mechanism.coordinates) if name not in mechanism.angles]
    ]
    hinges = np.array([joint.kind == "pin" for joint in _turning(mechanism)])
    turning = {"all turning joints": pins} | ({} if hinges.all() else {"all pins": pins[hinges]})
    groups = {
        name: (rows, torque / rate, "N m s/rad") for name, rows in turning.items() if len(rows) > 1
    }
    force = torque / length / (length * rate), "N s/m"
    for row in slides:
        groups[f"slide {mechanism.coordinates[int(row.argmax())]}"] = row[None], *force
    if len(slides) > 1:
        groups["all slides"] = slides, *force
    for name, (rows, size, unit) in groups.items():
        make = partial(_rubbed, mechanism, rows, size)
        viscous = (Component("viscous", size, unit, positive=True),)
        yield Hypothesis(f"friction or damping of {name}", "law", viscous, name, make)


def _rubbed(
    mechanism: Mechanism, rows: FloatArray, size: float, factors: Sequence[float]
) -> Equations:
    return WithRubbing(mechanism, rows, factors[0] * size)


def _turning(mechanism: Mechanism) -> Iterator[AnyJoint]:
    """Joints in which two bodies turn against each other: a free body turns in none."""
    return (
        joint
        for joint in mechanism.joints
        if not (joint.holds_angle or isinstance(joint, FreeJoint))
    )


def armatures(mechanism: Mechanism) -> Iterator[Hypothesis]:
    """Rotors' inertias on the joints, which engines have: in a motion they are like inertias of bodies."""
    size = _SMALL * sum(body.mass for body in mechanism.bodies) * mechanism_length(mechanism) ** 2
    for joint in _turning(mechanism):
        name, element = f"armature of the {joint.name}", partial(WithJoint, mechanism, joint.name)
        inertia = Component("", size, "kg m^2", positive=True)
        yield Hypothesis(
            name, "law", (inertia,), name, lambda f, e=element: e(armature=f[0] * size)
        )


def _sprung(element: Callable[..., Equations], unit: float, factors: Sequence[float]) -> Equations:
    return element(stiffness=factors[0] * unit, torque=factors[1] * unit)


def gross_faults(mechanism: Mechanism) -> Iterator[tuple[str, Equations]]:
    """Faults without a size that no small fault leads to."""
    yield "velocity-dependent forces dropped", WithoutCentrifugal(mechanism)
    if mechanism.gravity:
        down = mechanism.gravity_direction == (0.0, -1.0)
        yield "gravity reversed", WithTiltedGravity(mechanism, math.pi)
        for angle, where in ((90, "along +x"), (-90, "along -x")):
            turned = where if down else f"turned by {angle:+d} deg"
            yield f"gravity {turned}", WithTiltedGravity(mechanism, math.radians(angle))
        yield "no gravity", Equations(mechanism.model_copy(update={"gravity": 0.0}))
