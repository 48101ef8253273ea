"""Random mechanisms of a stated family: trees of bodies, loops, springs, motors and stops.

They are consistent at the start: loops are closed, closed stops touch and neither open nor press.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from ...models.elements import (
    GROUND,
    AnyForceElement,
    AnyJoint,
    ConstantForce,
    ConstantTorque,
    FreeJoint,
    PinJoint,
    PointStop,
    PrismaticJoint,
    RotationalSpringDamper,
    SlotJoint,
    SpringDamper,
    Stop,
    WeldJoint,
)
from ...models.kinematics import Kinematics
from ...models.mechanism import Body, Marker, Mechanism
from ...models.spec import Spec, Vector
from ...reference.equations import Equations, consistent_speeds

_JOINTS = ("pin", "pin", "pin", "slot", "rail", "weld", "free")
_LOOPS = ("pin", "slot", "slot", "rail", "weld")
_HELD = {"pin": 2, "slot": 1, "rail": 2, "weld": 3}


_Count = Annotated[int, Field(ge=0)]


class Family(Spec):
    """Limits of random mechanisms of some 1 m and 1 kg, which move at some 1 m/s.

    Raises:
        InputError: a limit is not valid.
    """

    bodies: Annotated[int, Field(ge=1, le=50)] = 6
    """Largest number of bodies; there is one at least."""
    loops: _Count = 2
    """Largest number of joints that close a loop; one that would leave no freedom is left out."""
    force_elements: _Count = 4
    stops: _Count = 3


class _Draw:
    """Random numbers of a mechanism."""

    def __init__(self, seed: int) -> None:
        self.random = np.random.default_rng(seed)

    def number(self, low: float, high: float) -> float:
        return float(self.random.uniform(low, high))

    def point(self, reach: float = 0.6) -> Vector:
        return self.number(-reach, reach), self.number(-reach, reach)

    def direction(self) -> Vector:
        angle = self.number(-math.pi, math.pi)
        return math.cos(angle), math.sin(angle)

    def choice(self, names: tuple[str, ...]) -> str:
        return names[int(self.random.integers(len(names)))]

    def count(self, most: int) -> int:
        return int(self.random.integers(most + 1))


def random_mechanism(seed: int, stops: bool = True, family: Family | None = None) -> Mechanism:
    """Make a random mechanism; the same for a seed and a family.

    Args:
        seed: any number.
        stops: whether it may have stops.
        family: limits; its defaults if left out.
    """
    draw, family = _Draw(seed), family or Family()
    mechanism = _closed(_tree(draw, family), draw, family)
    mechanism = _changed(mechanism, force_elements=_force_elements(mechanism, draw, family))
    if not stops:
        return mechanism
    return _at_rest_on(_changed(mechanism, stops=_stops(mechanism, draw, family)))


def _changed(mechanism: Mechanism, **fields: Any) -> Mechanism:
    return Mechanism(**(dict(mechanism) | fields))


def _tree(draw: _Draw, family: Family) -> Mechanism:
    names = tuple(f"b{k}" for k in range(1 + draw.count(family.bodies - 1)))
    joints = [
        _tree_joint(draw, draw.choice((GROUND, *names[:k])), name, k == 0)
        for k, name in enumerate(names)
    ]
    bodies = tuple(
        Body(
            name=name,
            angle=None if joint.holds_angle else f"angle {name}",
            mass=draw.number(0.3, 3),
            centre=draw.point(0.4),
            inertia=draw.number(0.02, 0.3),
        )
        for name, joint in zip(names, joints, strict=True)
    )
    n = sum(body.angle is not None for body in bodies) + sum(len(joint.slides) for joint in joints)
    return Mechanism(
        name="random",
        bodies=bodies,
        joints=tuple(joints),
        markers=(Marker(name="tip", body=names[-1], point=(0.5, 0.1)),),
        gravity=(draw.choice(("0", "9.81")) == "0" and 1.6) or 9.81,
        gravity_direction=draw.direction(),
        start=tuple(draw.number(-1, 1) for _ in range(n)),
        start_speeds=tuple(draw.number(-1, 1) for _ in range(n)),
    )


def _tree_joint(draw: _Draw, parent: str, child: str, first: bool) -> AnyJoint:
    kind = draw.choice(
        tuple(
            k for k in _JOINTS if not (first and k == "weld") and (parent == GROUND or k != "free")
        )
    )
    if kind == "free":
        points: dict[str, Any] = {"parent_point": draw.point(), "child_point": draw.point()}
        return FreeJoint(
            name=f"to {child}", child=child, coordinates=(f"x {child}", f"y {child}"), **points
        )
    return _joint(
        draw, kind, f"to {child}", parent, child, draw.point(), draw.number(-2, 2), f"slide {child}"
    )


def _joint(
    draw: _Draw,
    kind: str,
    name: str,
    parent: str,
    child: str,
    at: Vector,
    angle: float,
    slide: str | None,
) -> AnyJoint:
    fields: dict[str, Any] = {
        "name": name,
        "parent": parent,
        "child": child,
        "parent_point": at,
        "child_point": draw.point(),
    }
    if kind == "pin":
        return PinJoint(**fields)
    if kind == "weld":
        return WeldJoint(**fields, angle=angle)
    fields |= {"axis": draw.direction(), "coordinate": slide}
    return SlotJoint(**fields) if kind == "slot" else PrismaticJoint(**fields, angle=angle)


def _closed(mechanism: Mechanism, draw: _Draw, family: Family) -> Mechanism:
    """Add loops, as long as a freedom is left.

    Their joints are put where their points are at the start.
    """
    attitudes, free = mechanism.attitudes, len(mechanism.coordinates)
    for k in range(draw.count(family.loops)):
        child, kind = (
            draw.choice(tuple(body.name for body in mechanism.bodies)),
            draw.choice(_LOOPS),
        )
        others = {GROUND, *(body.name for body in mechanism.bodies)}
        others -= {name for name in others if attitudes[name][0] == attitudes[child][0]}
        others -= {
            mechanism.joint_of(child).parent,
            *(body.name for body in mechanism.children(child)),
        }
        if not others or free - _HELD[kind] < 1:
            continue
        free -= _HELD[kind]
        joint = _loop_joint(
            mechanism, draw, kind, f"loop {k}", draw.choice(tuple(sorted(others))), child
        )
        mechanism = _changed(mechanism, joints=(*mechanism.joints, joint))
    return _at_rest_on(mechanism)


def _at_rest_on(mechanism: Mechanism) -> Mechanism:
    """Give it the nearest speeds that keep loops closed and the closed stops touching."""
    closed = tuple(stop.name for stop in mechanism.stops if stop.closed)
    equations, q = Equations(mechanism), np.array(mechanism.start)
    speeds = consistent_speeds(equations, q, np.array(mechanism.start_speeds), closed)
    return _changed(mechanism, start_speeds=tuple(speeds.tolist()))


def _loop_joint(
    mechanism: Mechanism, draw: _Draw, kind: str, name: str, parent: str, child: str
) -> AnyJoint:
    kinematics, q = Kinematics(mechanism), np.array(mechanism.start)
    angle = float(kinematics.angle(child, parent).value(q))
    joint = _joint(draw, kind, name, parent, child, (0.0, 0.0), angle, None)
    vector = kinematics.between(child, joint.child_point, parent, (0.0, 0.0))
    turned = complex(*kinematics.position(vector, q)) * np.exp(
        1j * float(kinematics.angle(parent).value(q))
    )
    return joint.model_copy(update={"parent_point": (float(turned.real), float(turned.imag))})


def _force_elements(
    mechanism: Mechanism, draw: _Draw, family: Family
) -> tuple[AnyForceElement, ...]:
    names = tuple(body.name for body in mechanism.bodies)
    elements: list[AnyForceElement] = []
    for k in range(draw.count(family.force_elements)):
        kind, body = draw.choice(("spring", "twist", "force", "torque")), draw.choice(names)
        other = draw.choice(tuple({GROUND: None} | {name: None for name in names if name != body}))
        pair: dict[str, Any] = {"name": f"{kind} {k}", "body": body, "relative_to": other}
        strength: dict[str, Any] = {"stiffness": draw.number(0, 30), "damping": draw.number(0, 1.5)}
        if kind == "spring":
            points: dict[str, Any] = {"point": draw.point(), "relative_point": draw.point(1.0)}
            elements.append(
                SpringDamper(**pair, **strength, **points, rest_length=draw.number(0, 1))
            )
        elif kind == "twist":
            elements.append(
                RotationalSpringDamper(**pair, **strength, rest_angle=draw.number(-2, 2))
            )
        elif kind == "force":
            elements.append(
                ConstantForce(
                    name=f"force {k}", body=body, point=draw.point(), force=draw.point(5.0)
                )
            )
        else:
            elements.append(ConstantTorque(**pair, torque=draw.number(-2, 2)))
    return tuple(elements)


def _stops(mechanism: Mechanism, draw: _Draw, family: Family) -> tuple[Stop | PointStop, ...]:
    """Stops, each at the start closed or open."""
    stops: list[Stop | PointStop] = []
    for k in range(draw.count(family.stops)):
        stop = _stop(mechanism, draw, f"stop {k}")
        gap = Kinematics(_changed(mechanism, stops=(stop,))).gaps[stop.name]
        # One that cannot move relative to its wall holds nothing.
        if np.abs(gap.amplitudes).max() > 0:
            stops.append(stop)
    return tuple(stops)


def _stop(mechanism: Mechanism, draw: _Draw, name: str) -> Stop | PointStop:
    names = tuple(body.name for body in mechanism.bodies)
    body = draw.choice(names)
    other = draw.choice(tuple({GROUND: None} | {name: None for name in names if name != body}))
    fields: dict[str, Any] = {
        "name": name,
        "body": body,
        "relative_to": other,
        "restitution": draw.choice(("0", "0.5", "0.8")),
    }
    closed = draw.number(0, 1) < 0.2
    gap = 0.0 if closed else draw.number(0.05, 0.5)
    kinematics, q = Kinematics(mechanism), np.array(mechanism.start)
    if draw.number(0, 1) < 0.5:
        sense = 1 if draw.number(0, 1) < 0.5 else -1
        limit = sense * float(kinematics.angle(body, other).value(q)) - gap
        return Stop(**fields, sense=sense, limit=limit, closed=closed)
    normal, point = draw.direction(), draw.point()
    at = kinematics.component(
        complex(*normal), other, kinematics.between(body, point, other, (0.0, 0.0))
    ).value(q)
    return PointStop(**fields, point=point, normal=normal, offset=float(at) - gap, closed=closed)
