"""The physical numbers of any mechanism, by names that can be read, and what moves with each."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...models.elements import (
    refuse_unknown,
)
from ...models.kinematics import initial_state
from ...models.mechanism import Marker, Mechanism
from ...models.spec import Spec, number_units
from ..equations import Equations, least_step
from .dual import Dual
from .variational import Direction, VariationalEquations, consistent_directions, movable

_HELD = 1e-9  # a coordinate of which less is free than this cannot be chosen


_PLACES = {
    "point": "body",
    "relative_point": "relative_to",
    "parent_point": "parent",
    "child_point": "child",
}
"""The field with the body on which a point is."""
_UNIT_VECTORS = ("axis", "normal")


@dataclass(frozen=True)
class PhysicalNumber:
    """One number of a mechanism, and how the mechanism changes with it."""

    name: str
    """Such as "stiffness of strut spring"."""
    unit: str
    value: float
    direction: Direction


def physical_numbers(
    mechanism: Mechanism, thrown: str | None = None
) -> tuple[list[PhysicalNumber], list[str]]:
    """All numbers that change a motion, and sentences on those along which none is possible.

    With a number the start changes by the least that keeps loops closed and closed stops touching.
    With a coordinate of the start the closed stops move along, and the others of a loop follow.
    Unit vectors turn, anticlockwise.

    Args:
        mechanism: whose motion it is.
        thrown: the marker whose motion counts; all markers if left out.
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


def _of_elements(mechanism: Mechanism, thrown: str | None) -> Iterator[PhysicalNumber]:
    elements = (*mechanism.joints, *mechanism.stops, *mechanism.force_elements)
    refuse_unknown("The table of sensitivities", elements)
    for kind in ("bodies", "joints", "stops", "force_elements", "markers"):
        for part in getattr(mechanism, kind):
            if kind != "markers" or thrown in (None, part.name):
                yield from _of_fields(part, f"{kind}.{part.name}")


def _of_fields(part: Spec, path: str) -> Iterator[PhysicalNumber]:
    """The numbers of a part of a mechanism, in the order of its fields."""
    for field, unit in number_units(type(part)).items():
        value = getattr(part, field)
        if value is None or (isinstance(part, Marker) and field == "mass"):
            continue  # a marker's mass is a part of its body's
        name = _name_of_number(part, field)
        if field in _UNIT_VECTORS:
            x, y = value
            turned = {f"{path}.{field}.0": -y, f"{path}.{field}.1": x}
            yield PhysicalNumber(name, "rad", math.atan2(y, x), turned)
        elif isinstance(value, tuple):
            for i, component in enumerate("xy"):
                direction = {f"{path}.{field}.{i}": 1.0}
                yield PhysicalNumber(f"{name}, {component}", unit, value[i], direction)
        else:
            yield PhysicalNumber(name, unit, value, {f"{path}.{field}": 1.0})


def _name_of_number(part: Any, field: str) -> str:
    """Such as "stiffness of strut spring", "place of knee on thigh" or "direction of rail"."""
    name = part.name
    if "spring" in getattr(part, "kind", "") and "spring" not in name.lower():
        name += " spring"
    if field in _PLACES:
        return f"place of {name} on {getattr(part, _PLACES[field])}"
    if field in _UNIT_VECTORS:
        return f"direction of {name}"
    if field == "centre":
        return f"centre of mass of {name}"
    return f"{field.replace('_', ' ')} of {name}"


def _starts(mechanism: Mechanism) -> Iterator[PhysicalNumber]:
    """The coordinates that loops let choose; closed stops stay where they touch."""
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
    equations = VariationalEquations(mechanism, [number.direction for number in found])
    q = mechanism.start
    start = Dual(np.array(q), equations.along_each("start", len(q)))
    torn = equations.misfits(
        start, movable(equations, [stop.name for stop in mechanism.stops if stop.closed])
    )
    sentences = [
        f"there is no derivative by the {found[j].name}: a change of it alone would lock the "
        "mechanism or open a loop"
        for j in torn
    ]
    return [number for j, number in enumerate(found) if j not in torn], sentences
