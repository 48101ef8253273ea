"""The physical numbers of any mechanism, by names that can be read, and the directions that change them one by one."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...models.force_elements import RotationalSpringDamper, SpringDamper
from ...models.kinematics import initial_state
from ...models.mechanism import Mechanism
from ...models.spec import Spec
from ..dependence import least_step
from ..dual import Dual
from ..equations import Equations
from .variational import Direction, VariationalEquations, consistent_directions, movable

_HELD = 1e-9  # a coordinate of which less is free than this cannot be chosen

# What a field is called; fields that are not here are no physical numbers, or do not change a
# motion.
_FIELDS = {
    "mass": "mass of {name}",
    "centre": "centre of mass of {name}",
    "inertia": "inertia of {name}",
    "parent_point": "place of {name} on {parent}",
    "child_point": "place of {name} on {child}",
    "axis": "direction of {name}",
    "angle": "angle of {name}",
    "limit": "limit of {name}",
    "normal": "direction of {name}",
    "offset": "offset of {name}",
    "restitution": "restitution of {name}",
    "point": "place of {name} on {body}",
    "relative_point": "place of {name} on {relative_to}",
    "stiffness": "stiffness of {name}",
    "damping": "damping of {name}",
    "rest_length": "rest length of {name}",
    "rest_angle": "rest angle of {name}",
    "force": "force of {name}",
    "torque": "torque of {name}",
}
_UNIT_VECTORS = ("axis", "normal")


@dataclass(frozen=True)
class PhysicalNumber:
    """One number of a mechanism, and how the mechanism changes with it."""

    name: str
    """Such as "stiffness of strut spring"."""
    unit: str
    value: float
    direction: Direction


def physical_numbers(mechanism: Mechanism, thrown: str) -> tuple[list[PhysicalNumber], list[str]]:
    """All numbers that change how a mechanism throws, and sentences on those along which no motion is possible.

    With a number the start changes by the least that keeps loops closed and closed stops touching.
    With a coordinate of the start the closed stops move along, and the others of a loop follow.
    Unit vectors turn, anticlockwise.

    Args:
        mechanism: that throws.
        thrown: the marker that is thrown.
    """
    found = [
        *_of_elements(mechanism, thrown),
        PhysicalNumber("gravity", "m/s^2", mechanism.gravity, {"gravity": 1.0}),
    ]
    follow = consistent_directions(mechanism, [number.direction for number in found])
    found = [
        replace(number, direction=direction)
        for number, direction in zip(found, follow, strict=True)
    ]
    found += [*_starts(mechanism), *_start_speeds(mechanism)]
    return _possible(mechanism, found)


def _of_elements(mechanism: Mechanism, thrown: str) -> Iterator[PhysicalNumber]:
    markers = [marker for marker in mechanism.markers if marker.name == thrown]
    for item in mechanism.bodies:
        yield from _of_fields(item, f"bodies.{item.name}", ("mass", "centre", "inertia"))
    for group, items in (("joints", mechanism.joints), ("stops", mechanism.stops)):
        for item in items:
            yield from _of_fields(item, f"{group}.{item.name}", tuple(_FIELDS))
    for item in mechanism.force_elements:
        yield from _of_fields(item, f"force_elements.{item.name}", tuple(_FIELDS))
    for item in markers:
        yield from _of_fields(item, f"markers.{item.name}", ("point",))


def _of_fields(item: Spec, path: str, names: Sequence[str]) -> Iterator[PhysicalNumber]:
    for field, description in type(item).model_fields.items():
        if field not in names:
            continue
        name, value = _FIELDS[field].format(**_called(item)), getattr(item, field)
        unit = re.search(r"\[(.+)\]", description.description or "")
        if field in _UNIT_VECTORS:
            x, y = value
            yield PhysicalNumber(
                name, "rad", math.atan2(y, x), {f"{path}.{field}.0": -y, f"{path}.{field}.1": x}
            )
        elif isinstance(value, tuple):
            for i, component in enumerate("xy"):
                direction = {f"{path}.{field}.{i}": 1.0}
                yield PhysicalNumber(
                    f"{name}, {component}", unit[1] if unit else "", value[i], direction
                )
        else:
            yield PhysicalNumber(name, unit[1] if unit else "", value, {f"{path}.{field}": 1.0})


def _called(item: Spec) -> dict[str, str]:
    """Names that a field's phrase needs; a spring is called one."""
    names = {name: value for name, value in item if isinstance(value, str)}
    if (
        isinstance(item, SpringDamper | RotationalSpringDamper)
        and "spring" not in item.name.lower()
    ):
        names["name"] += " spring"
    return names


def _starts(mechanism: Mechanism) -> Iterator[PhysicalNumber]:
    """Of the coordinates that loops let choose; the loops' others follow, and closed stops stay where they touch."""
    equations, q = Equations(mechanism), initial_state(mechanism)[0]
    closed = [stop for stop in mechanism.stops if stop.closed]
    jacobian = equations.constraint_jacobian(q, [stop.name for stop in closed])
    loops, gaps = jacobian[: equations.n_loops], jacobian[equations.n_loops :]
    for i, name in enumerate(mechanism.coordinates):
        dq = np.eye(len(q))[i]
        if len(loops):
            dq = dq - least_step(loops, loops @ dq, equations.rank(q, ()))
        if dq[i] < _HELD:
            continue
        dq = dq / dq[i]
        angle = i < len(mechanism.angles)
        along = {
            f"stops.{s.name}.{s.position_field}": float(g @ dq)
            for s, g in zip(closed, gaps, strict=True)
        }
        direction = {f"start.{k}": float(value) for k, value in enumerate(dq)} | along
        what = f"start {'angle' if angle else 'position'} {name}"
        yield PhysicalNumber(what, "rad" if angle else "m", float(q[i]), direction)


def _start_speeds(mechanism: Mechanism) -> Iterator[PhysicalNumber]:
    for i, (name, value) in enumerate(
        zip(mechanism.coordinates, initial_state(mechanism)[1], strict=True)
    ):
        unit = "rad/s" if i < len(mechanism.angles) else "m/s"
        yield PhysicalNumber(
            f"start speed of {name}", unit, float(value), {f"start_speeds.{i}": 1.0}
        )


def _possible(
    mechanism: Mechanism, found: list[PhysicalNumber]
) -> tuple[list[PhysicalNumber], list[str]]:
    """Without those that tear loops apart, whatever the start does."""
    equations, q = (
        VariationalEquations(mechanism, [number.direction for number in found]),
        mechanism.start,
    )
    start = Dual(np.array(q), equations.along_each("start", len(q)))
    torn = equations.misfits(
        start, movable(equations, [stop.name for stop in mechanism.stops if stop.closed])
    )
    sentences = [
        f"there is no derivative by the {found[j].name}: a change of it alone would lock the mechanism or open a loop"
        for j in torn
    ]
    return [number for j, number in enumerate(found) if j not in torn], sentences
