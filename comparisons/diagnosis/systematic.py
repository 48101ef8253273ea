"""Mechanisms with the same mistake in every body, force element or stop, as one line of a builder makes it.

They have no size: the mistake is made or it is not.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from ...models.force_elements import AnyForceElement
from ...models.joints import GROUND
from ...models.mechanism import Body, Mechanism
from .consistent import consistent_mechanism
from .suspects import Kind, Suspect

Changes = Callable[[Any], Mapping[str, Any]]
"""Other fields of a part."""


def systematic_faults(mechanism: Mechanism) -> Iterator[Suspect]:
    """Those that make another mechanism of it, and a possible one."""
    seen = [mechanism]
    for name, kind, fields in _faults(mechanism):
        wrong = consistent_mechanism({**mechanism.model_dump(), **fields})
        if wrong is not None and wrong not in seen:
            seen.append(wrong)
            yield Suspect(name, kind, wrong, scale=0.0)


def _faults(m: Mechanism) -> Iterator[tuple[str, Kind, dict[str, Any]]]:
    for name, change in _BODIES.items():
        bodies = _each(m.bodies, lambda body, change=change: change(m, body))
        if all(body["inertia"] >= 0 for body in bodies):
            yield name, "machine", {"bodies": bodies}
    yield "all force elements missing", "law", {"force_elements": ()}
    for name, changes in _ELEMENTS.items():
        yield name, "law", {"force_elements": _each(m.force_elements, changes)}
    yield "start speeds ignored", "start", {"start_speeds": (0.0,) * len(m.coordinates)}
    yield (
        "start speeds reversed",
        "start",
        {"start_speeds": tuple(-speed for speed in m.start_speeds)},
    )
    yield "gravity along -y", "law", {"gravity_direction": (0.0, -1.0)}
    yield from _stops(m)


def _stops(m: Mechanism) -> Iterator[tuple[str, Kind, dict[str, Any]]]:
    """Missing ones, beyond each closed one alone, and other restitutions."""
    yield "all stops missing", "law", {"stops": ()}
    yield (
        "stops that are open at the start missing",
        "law",
        {"stops": _dumped([s for s in m.stops if s.closed])},
    )
    for stop in m.stops:
        if not stop.closed:
            yield (
                f"{stop.name} missing",
                "law",
                {"stops": _dumped([s for s in m.stops if s != stop])},
            )
    for value in (0.0, 1.0):
        yield (
            f"restitution {value:g} of all stops",
            "law",
            {"stops": _each(m.stops, lambda _, e=value: {"restitution": e})},
        )


def _dumped(parts: Sequence[Any]) -> list[dict[str, Any]]:
    return [part.model_dump() for part in parts]


def _each(parts: Sequence[Any], changes: Changes) -> list[dict[str, Any]]:
    """All parts, those with some other fields that have these."""
    changed: list[dict[str, Any]] = []
    for part in parts:
        fields = part.model_dump()
        changed.append(
            fields | {key: value for key, value in changes(part).items() if key in fields}
        )
    return changed


def _parallel(m: Mechanism, body: Body) -> float:
    """What the inertia about the joint has more than that about the centre of mass [kg m^2]."""
    arm = np.subtract(body.centre, m.joint_of(body.name).child_point)
    return body.mass * float(arm @ arm)


_BODIES: dict[str, Callable[[Mechanism, Body], dict[str, Any]]] = {
    "inertias about the joints in place of those about the centres of mass": lambda m, b: {
        "inertia": b.inertia + _parallel(m, b)
    },
    "inertias about the centres of mass taken for those about the joints": lambda m, b: {
        "inertia": b.inertia - _parallel(m, b)
    },
    "inertias of all bodies missing": lambda _, b: {"inertia": 0.0},
    "centres of mass at the bodies' origins": lambda _, b: {"centre": (0.0, 0.0)},
    "centres of mass at the joints": lambda m, b: {"centre": m.joint_of(b.name).child_point},
}
"""By name."""


def _zero(field: str) -> Callable[[AnyForceElement], dict[str, Any]]:
    return lambda _: {field: 0.0}


def _times(factor: float, *fields: str) -> Callable[[AnyForceElement], dict[str, Any]]:
    return lambda e: {name: factor * getattr(e, name) for name in fields if hasattr(e, name)}


_ELEMENTS: dict[str, Callable[[AnyForceElement], dict[str, Any]]] = {
    "damping of all elements missing": _zero("damping"),
    "damping of all elements doubled": _times(2.0, "damping"),
    "stiffness of all elements missing": _zero("stiffness"),
    "stiffness and damping of all elements doubled": _times(2.0, "stiffness", "damping"),
    "rest lengths ignored": _zero("rest_length"),
    "rest angles ignored": _zero("rest_angle"),
    "rest angles with the wrong sign": _times(-1.0, "rest_angle"),
    "torques of motors missing": _zero("torque"),
    "torques of motors with the wrong sign": _times(-1.0, "torque"),
    "constant forces missing": lambda _: {"force": (0.0, 0.0)},
    "torques on one body only, without their reaction": lambda e: (
        {"relative_to": GROUND} if hasattr(e, "torque") else {}
    ),
    "rotational springs and dampers against the ground": lambda e: (
        {"relative_to": GROUND} if hasattr(e, "rest_angle") else {}
    ),
}
"""By name."""
