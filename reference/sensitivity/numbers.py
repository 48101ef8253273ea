"""The physical numbers of any mechanism, by names that can be read, and what moves with each."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from ...models.elements import (
    ELEMENTS,
    ConstantForce,
    ConstantTorque,
    CubicTorsionSpring,
    ElementTable,
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
from ...models.errors import UnsupportedProblemError
from ...models.kinematics import initial_state
from ...models.mechanism import Mechanism
from ...models.spec import Spec
from ..equations import Equations, least_step
from .dual import Dual
from .variational import Direction, VariationalEquations, consistent_directions, movable

_HELD = 1e-9  # a coordinate of which less is free than this cannot be chosen


# Names of the numbers of each class, field by field. A number that is not here is refused: its
# derivative would be missing among the others without a word.
_Names = Mapping[str, str]
_BODY: _Names = {
    "mass": "mass of {name}",
    "centre": "centre of mass of {name}",
    "inertia": "inertia of {name}",
}
_MARKER: _Names = {"point": "place of {name} on {body}", "mass": ""}  # a part of its body's mass
_ENDS: _Names = {
    "parent_point": "place of {name} on {parent}",
    "child_point": "place of {name} on {child}",
}
_ANGLE: _Names = {"angle": "angle of {name}"}
_AXIS: _Names = {"axis": "direction of {name}"}
_RESTITUTION: _Names = {"restitution": "restitution of {name}"}
_POINT: _Names = {"point": "place of {name} on {body}"}
_SPRING: _Names = {"stiffness": "stiffness of {spring}"}
_DAMPER: _Names = {"damping": "damping of {spring}"}
_REST_ANGLE: _Names = {"rest_angle": "rest angle of {spring}"}
_NAMES: ElementTable[_Names] = ElementTable(
    "The table of sensitivities",
    ELEMENTS,
    {
        PinJoint: _ENDS,
        WeldJoint: {**_ENDS, **_ANGLE},
        SlotJoint: {**_ENDS, **_AXIS},
        PrismaticJoint: {**_ENDS, **_AXIS, **_ANGLE},
        FreeJoint: _ENDS,
        Stop: {"limit": "limit of {name}", **_RESTITUTION},
        PointStop: {
            **_POINT,
            "normal": "direction of {name}",
            "offset": "offset of {name}",
            **_RESTITUTION,
        },
        SpringDamper: {
            "point": "place of {spring} on {body}",
            "relative_point": "place of {spring} on {relative_to}",
            **_SPRING,
            **_DAMPER,
            "rest_length": "rest length of {spring}",
        },
        RotationalSpringDamper: {**_SPRING, **_DAMPER, **_REST_ANGLE},
        CubicTorsionSpring: {
            **_SPRING,
            "cubic_stiffness": "cubic stiffness of {spring}",
            **_REST_ANGLE,
        },
        ConstantForce: {**_POINT, "force": "force of {name}"},
        ConstantTorque: {"torque": "torque of {name}"},
    },
)
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
    markers = [marker for marker in mechanism.markers if thrown in (None, marker.name)]
    for item in mechanism.bodies:
        yield from _of_fields(item, f"bodies.{item.name}", _BODY)
    for item in mechanism.joints:
        yield from _of_fields(item, f"joints.{item.name}", _NAMES[item])
    for item in mechanism.stops:
        yield from _of_fields(item, f"stops.{item.name}", _NAMES[item])
    for item in mechanism.force_elements:
        yield from _of_fields(item, f"force_elements.{item.name}", _NAMES[item])
    for item in markers:
        yield from _of_fields(item, f"markers.{item.name}", _MARKER)


def _is_number(value: object) -> bool:
    """Whether a field's value is a number or a vector of them."""
    parts = cast("tuple[object, ...]", value) if isinstance(value, tuple) else (value,)
    return any(isinstance(part, float) for part in parts)


def _of_fields(item: Spec, path: str, names: _Names) -> Iterator[PhysicalNumber]:
    """The numbers of a part of a mechanism, in the order of its fields.

    Raises:
        UnsupportedProblemError: it has a number that is not among these names.
    """
    for field, description in type(item).model_fields.items():
        value = getattr(item, field)
        if not _is_number(value):
            continue
        if field not in names:
            raise UnsupportedProblemError(
                f"The table of sensitivities does not know {field!r} of {path!r} "
                f"({type(item).__name__}): a derivative by it would be missing."
            )
        if not names[field]:
            continue
        name = names[field].format(**_called(item))
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
    spring = "" if "spring" in names["name"].lower() else " spring"
    return names | {"spring": names["name"] + spring}


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
