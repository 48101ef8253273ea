"""Mechanisms and forces with a fault, whose effects are compared with a deviation.

Every single number of a mechanism is a suspect, and so are its parameters where a named builder
makes it, because a wrong length changes a mass and an inertia, too. Consistent initialisation makes
the stops, or the start, fit what was changed. Other faults are made in every body, force element or
stop alike, as one line of a builder makes them, or in the equations: a further or a missing force.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import groupby
from typing import Any, Literal, TypeVar, cast

import numpy as np
from pydantic import TypeAdapter

from ...models.arrays import FloatArray
from ...models.elements import (
    GROUND,
    JOINTS,
    AnyForceElement,
    AnyJoint,
    AnyStop,
    ElementTable,
    FreeJoint,
    PinJoint,
    PointStop,
    PrismaticJoint,
    SlotJoint,
    Stop,
    WeldJoint,
    refuse_unknown,
)
from ...models.errors import InputError, SimulationError
from ...models.kinematics import Kinematics, initial_state
from ...models.library.registry import model
from ...models.library.trebuchet import TrebuchetParameters, parameters_of
from ...models.mechanism import Body, Mechanism
from ...models.spec import Vector
from ...reference.equations import Equations, consistent_coordinates, consistent_speeds
from ...reference.perturbed import (
    with_damping,
    with_friction,
    with_joint_element,
    with_tilted_gravity,
    without_centrifugal,
)
from ..runs.results import RankedCause

_STOPS = TypeAdapter[tuple[Stop | PointStop, ...]](tuple[AnyStop, ...])


def consistent_mechanism(fields: dict[str, Any], start_moves: bool = False) -> Mechanism | None:
    """A mechanism of these fields whose closed stops touch at its start; None if there is none.

    Joints that close a loop may be open there, see :func:`with_closed_loops`.

    Args:
        fields: as a mechanism's `model_dump`; directions are brought to length one.
        start_moves: where a closed stop does not touch, the start is taken to where it does; else
            the stop is.
    """
    fields = {
        **fields,
        "joints": _unit(fields["joints"], "axis"),
        "stops": _unit(fields["stops"], "normal"),
    }
    try:
        return _mechanism(fields)
    except InputError:
        pass
    try:
        bare, stops = _mechanism(fields, stops=()), _STOPS.validate_python(fields["stops"])
        touching = bare.model_copy(update={"stops": _touching(bare, stops)})
        if not start_moves:
            return _mechanism(touching.model_dump())
        start = _consistent_start(touching, stops)
        return None if start is None else _mechanism(fields, start=start)
    except InputError:
        return None


def with_closed_loops(mechanism: Mechanism) -> Mechanism | None:
    """The mechanism with its start moved to the nearest one where loops close; None if none.

    Closed stops stay where they are, and still touch.
    """
    if not any(mechanism.loop_closure_residual.values()):
        return mechanism
    start = _consistent_start(mechanism, mechanism.stops)
    return (
        None if start is None else consistent_mechanism({**mechanism.model_dump(), "start": start})
    )


def _mechanism(fields: dict[str, Any], **changes: Any) -> Mechanism:
    return Mechanism(**{**fields, **changes})


def _unit(parts: Sequence[dict[str, Any]], direction: str) -> list[dict[str, Any]]:
    return [
        part | {direction: tuple(value / math.hypot(*part[direction]) for value in part[direction])}
        if direction in part
        else dict(part)
        for part in parts
    ]


def _touching(bare: Mechanism, stops: Sequence[Stop | PointStop]) -> tuple[Stop | PointStop, ...]:
    """The stops, with those that are closed moved to where they touch at the mechanism's start."""
    kinematics, q = Kinematics(bare), np.array(bare.start)

    def angle(body: str) -> float:
        return float(kinematics.angle(body).value(q))

    def position(body: str, point: Vector) -> complex:
        return complex(*kinematics.position(kinematics.point(body, point), q))

    def moved(stop: Stop | PointStop) -> Stop | PointStop:
        return stop.model_copy(update={stop.position_field: float(stop.component(angle, position))})

    return tuple(moved(stop) if stop.closed else stop for stop in stops)


def _consistent_start(
    mechanism: Mechanism, stops: Sequence[Stop | PointStop]
) -> tuple[float, ...] | None:
    """The start nearest to the mechanism's at which loops close and closed stops touch.

    Args:
        stops: the mechanism's, where they really stand.
    """
    closed = [(own, real) for own, real in zip(mechanism.stops, stops, strict=True) if own.closed]
    gaps = np.array([real.position - own.position for own, real in closed])
    names = [own.name for own, _ in closed]
    try:
        start = consistent_coordinates(Equations(mechanism), np.array(mechanism.start), names, gaps)
    except SimulationError:  # a fault may lead to a singular position
        return None
    return None if start is None else tuple(start.tolist())


Kind = Literal["machine", "start", "law", "reading", "settings"]


_SMALL = 1e-6  # relative, or [rad] or [m]: well above rounding and linear


_Result = TypeVar("_Result")


def once_a_mechanism(function: Callable[[Mechanism], _Result]) -> Callable[[Mechanism], _Result]:
    """Keep a function's results for the last mechanisms, of which several runs are diagnosed."""
    return lru_cache(maxsize=2)(function)  # pyright: ignore[reportReturnType]  (specs are hashable)


@dataclass(frozen=True)
class Suspect:
    """A mechanism with one thing wrong by a small amount; missing or replaced if `scale` is 0."""

    name: str
    kind: Kind
    wrong: Mechanism
    scale: float = _SMALL
    """How wrong `wrong` is; 0: not a matter of degree."""
    unit: str = ""
    """Unit of the amount; '': relative."""
    start_moves: bool = False
    """Whether the start, not the stop, is moved where a closed stop no longer touches."""
    group: str = ""
    """Suspects of one group are components of one mistake, as a point off along x and y."""

    def amount(self, factor: float) -> str:
        """The error that explains the deviation, `factor` times `scale`, as text."""
        if self.scale == 0:
            return ""
        size = factor * self.scale
        return f"{100 * size:+.3g} %" if not self.unit else f"{size:+.3g} {self.unit}"

    def cause(self, factor: float, explained: float) -> RankedCause:
        """The cause that explains a share of a deviation by `factor` times its amount."""
        return RankedCause(
            name=self.name, kind=self.kind, amount=self.amount(factor), explained=explained
        )


@once_a_mechanism
def machine_suspects(mechanism: Mechanism) -> tuple[Suspect, ...]:
    """All suspects of a built model."""
    parts = (
        _parameters,
        _masses,
        _centres,
        _positions,
        _slots,
        wall_suspects,
        _force_elements,
        _gravity,
        _starts,
        _missing,
        _rounded,
    )
    return tuple(suspect for part in parts for suspect in part(mechanism))


def combined(
    mechanism: Mechanism, suspects: Sequence[Suspect], factors: Sequence[float]
) -> Mechanism | None:
    """The mechanism with so many times each suspect's amount; None where there is none."""
    if any(suspect.scale == 0 for suspect in suspects):
        return None
    right, *wrong = _with_speeds(
        [mechanism.model_dump(), *(suspect.wrong.model_dump() for suspect in suspects)]
    )
    blended = _blended(right, wrong, factors)
    return consistent_mechanism(blended, any(suspect.start_moves for suspect in suspects))


def _with_speeds(every: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Fields with start speeds of zero where those are left out, if one of them has any."""
    n = max(len(fields["start_speeds"]) for fields in every)
    return [fields | {"start_speeds": fields["start_speeds"] or (0.0,) * n} for fields in every]


def _blended(right: Any, wrong: Sequence[Any], factors: Sequence[float]) -> Any:
    """Right + sum of factor (wrong - right), number by number."""
    if isinstance(right, dict):
        return {
            key: _blended(value, [w[key] for w in wrong], factors) for key, value in right.items()
        }
    if isinstance(right, tuple | list) and all(len(right) == len(w) for w in wrong):
        return tuple(
            _blended(a, b, factors) for a, b in zip(right, zip(*wrong, strict=True), strict=True)
        )
    if isinstance(right, float):
        return right + sum(factor * (w - right) for w, factor in zip(wrong, factors, strict=True))
    return wrong[0]


def _parameters(mechanism: Mechanism) -> Iterator[Suspect]:
    parameters = parameters_of(mechanism)
    if parameters is None:
        return
    for name, field in TrebuchetParameters.model_fields.items():
        value = float(getattr(parameters, name))
        is_angle = name.endswith("0")
        step = _SMALL if is_angle else value * _SMALL
        wrong = model(mechanism.name, parameters.model_copy(update={name: value + step}))
        what = str(field.description).partition(" [")[0]
        yield Suspect(
            f"{name} ({what})",
            "start" if is_angle else "machine",
            wrong,
            unit="rad" if is_angle else "",
        )


def _changed(mechanism: Mechanism, start_moves: bool = False, **fields: Any) -> Mechanism | None:
    return consistent_mechanism({**mechanism.model_dump(), **fields}, start_moves)


def _with_part(
    mechanism: Mechanism,
    parts: str,
    name: str,
    fields: Mapping[str, Any],
    start_moves: bool = False,
) -> Mechanism | None:
    """The mechanism with one of its bodies, joints or stops changed."""
    every = [
        part.model_dump() | (dict(fields) if part.name == name else {})
        for part in getattr(mechanism, parts)
    ]
    return _changed(mechanism, start_moves, **{parts: every})


def _suspect(name: str, kind: Kind, wrong: Mechanism | None, **others: Any) -> Iterator[Suspect]:
    """The suspect, where there is such a mechanism."""
    if wrong is not None:
        yield Suspect(name, kind, wrong, **others)


def _masses(mechanism: Mechanism) -> Iterator[Suspect]:
    """Masses and inertias of single bodies; a parameter of the same effect comes before them."""
    named = parameters_of(mechanism) is not None
    for body in mechanism.bodies:
        if not named or body.inertia:  # the mass of a named point is a parameter
            wrong = _with_part(mechanism, "bodies", body.name, {"mass": body.mass * (1 + _SMALL)})
            yield from _suspect(f"mass of the {body.name}", "machine", wrong)
        if body.inertia and not named:
            denser = {"mass": body.mass * (1 + _SMALL), "inertia": body.inertia * (1 + _SMALL)}
            wrong = _with_part(mechanism, "bodies", body.name, denser)
            yield from _suspect(f"mass and inertia of the {body.name}", "machine", wrong)
        grown = (
            body.inertia * _SMALL or body.mass * _SMALL
        )  # of a point mass: a radius of gyration of a millimetre
        wrong = _with_part(mechanism, "bodies", body.name, {"inertia": body.inertia + grown})
        amount: dict[str, Any] = {} if body.inertia else {"scale": grown, "unit": "kg m^2"}
        yield from _suspect(f"inertia of the {body.name}", "machine", wrong, **amount)
    if sum(body.inertia > 0 for body in mechanism.bodies) > 1:
        every = [
            body.model_dump() | {"inertia": body.inertia * (1 + _SMALL)}
            for body in mechanism.bodies
        ]
        yield from _suspect("inertias of all bodies", "machine", _changed(mechanism, bodies=every))


def _centres(mechanism: Mechanism) -> Iterator[Suspect]:
    """Centres of mass, along their bodies and across."""
    for body in mechanism.bodies:
        name = f"centre of mass of the {body.name}"
        for moved in _moves(mechanism, body.centre):
            wrong = _with_part(mechanism, "bodies", body.name, {"centre": moved.point})
            yield from moved.suspect(name, wrong)


def _positions(mechanism: Mechanism) -> Iterator[Suspect]:
    """Places of joints on the bodies that carry them."""
    for joint in mechanism.tree_joints:
        for end in ("parent", "child"):
            body = getattr(joint, end)
            for moved in _moves(mechanism, getattr(joint, f"{end}_point")):
                wrong = _with_part(mechanism, "joints", joint.name, {f"{end}_point": moved.point})
                yield from moved.suspect(f"place of the {joint.name} on the {body}", wrong)
    for joint in mechanism.loop_joints:
        yield from _shifted(mechanism, joint)


@dataclass(frozen=True)
class _Move:
    """A point moved a little: along its direction from the body's origin, or across."""

    point: tuple[float, float]
    where: str
    scale: float
    unit: str

    def suspect(self, name: str, wrong: Mechanism | None) -> Iterator[Suspect]:
        own = f"{name}, {self.where}" if self.where else name
        yield from _suspect(own, "machine", wrong, scale=self.scale, unit=self.unit, group=name)


def _moves(mechanism: Mechanism, point: tuple[float, float]) -> Iterator[_Move]:
    step, size = _SMALL * mechanism_length(mechanism), math.hypot(*point)
    if size == 0:
        yield _Move((step, 0.0), "x", step, "m")
        yield _Move((0.0, step), "y", step, "m")
        return
    yield _Move(_longer(point), "", _SMALL, "")
    aside = step / size
    yield _Move((point[0] - aside * point[1], point[1] + aside * point[0]), "across", step, "m")


def mechanism_length(mechanism: Mechanism) -> float:
    """The largest distance of a point from the origin of its body [m]; 1 where all are zero."""
    points = [joint.parent_point for joint in mechanism.joints] + [
        joint.child_point for joint in mechanism.joints
    ]
    points += [body.centre for body in mechanism.bodies] + [
        marker.point for marker in mechanism.markers
    ]
    return max(math.hypot(*point) for point in points) or 1.0


def _shifted(mechanism: Mechanism, joint: AnyJoint) -> Iterator[Suspect]:
    """A loop joint's points, moved a little along each axis of their frames."""
    for end in ("parent", "child"):
        for point, axis in zip(_aside(getattr(joint, f"{end}_point")), "xy", strict=True):
            slot = _AXIS[joint](joint) if end == "parent" else None
            if slot is not None and abs(np.dot(_AXES[axis], slot)) == 1.0:
                continue  # a slot moved along its own line is the same slot
            wrong = _with_part(mechanism, "joints", joint.name, {f"{end}_point": point})
            group = f"place of the {joint.name} on the {getattr(joint, end)}"
            yield from _suspect(f"{group}, {axis}", "machine", wrong, unit="m", group=group)


_AXIS: ElementTable[Callable[[Any], Vector | None]] = ElementTable(
    "The diagnosis",
    JOINTS,
    {
        PinJoint: lambda _: None,
        WeldJoint: lambda _: None,
        SlotJoint: lambda joint: joint.axis,
        PrismaticJoint: lambda joint: joint.axis,
        FreeJoint: lambda _: None,
    },
)
"""Direction in which the two bodies slide."""
_TURNS: ElementTable[bool] = ElementTable(
    "The diagnosis",
    JOINTS,
    {PinJoint: True, WeldJoint: False, SlotJoint: True, PrismaticJoint: False, FreeJoint: False},
)
"""Whether two bodies turn against each other in a joint: a free body turns against none."""
_AXES = {"x": (1.0, 0.0), "y": (0.0, 1.0)}


def _longer(point: tuple[float, float]) -> tuple[float, float]:
    return point[0] * (1 + _SMALL), point[1] * (1 + _SMALL)


def _aside(point: tuple[float, float]) -> tuple[tuple[float, float], tuple[float, float]]:
    return (point[0] + _SMALL, point[1]), (point[0], point[1] + _SMALL)


def _turned(direction: tuple[float, float]) -> tuple[float, float]:
    """A direction turned anticlockwise by a small angle; it is brought to length one later."""
    x, y = direction
    return x - _SMALL * y, y + _SMALL * x


def _slots(mechanism: Mechanism) -> Iterator[Suspect]:
    """Wrong directions of slots."""
    for joint in mechanism.joints:
        axis = _AXIS[joint](joint)
        if axis is not None:
            wrong = _with_part(mechanism, "joints", joint.name, {"axis": _turned(axis)})
            yield from _suspect(f"direction of the {joint.name}", "machine", wrong, unit="rad")


def wall_suspects(mechanism: Mechanism) -> Iterator[Suspect]:
    """Stops on points: a wrong offset, normal or point of the body."""
    for stop in mechanism.point_stops:
        wrong = _with_part(
            mechanism, "stops", stop.name, {"offset": stop.offset + _SMALL}, start_moves=True
        )
        yield from _suspect(
            f"place of the {stop.name}", "machine", wrong, unit="m", start_moves=True
        )
        wrong = _with_part(mechanism, "stops", stop.name, {"normal": _turned(stop.normal)})
        yield from _suspect(f"direction of the {stop.name}", "machine", wrong, unit="rad")
        for point, axis in zip(_aside(stop.point), "xy", strict=True):
            wrong = _with_part(mechanism, "stops", stop.name, {"point": point}, start_moves=True)
            group = f"point of the {stop.name} on the {stop.body}"
            yield from _suspect(
                f"{group}, {axis}", "machine", wrong, unit="m", start_moves=True, group=group
            )


def _force_elements(mechanism: Mechanism) -> Iterator[Suspect]:
    """Springs, dampers, forces and torques: a wrong number, a wrong point, a missing element."""
    refuse_unknown("The diagnosis", mechanism.force_elements)
    for element in mechanism.force_elements:
        name = element.name

        def changed(field: str, value: Any, name: str = name) -> Mechanism | None:
            return _with_part(mechanism, "force_elements", name, {field: value})

        for field in element.numbers():
            value = getattr(element, field)
            if isinstance(value, tuple):
                wrong = changed(field, _longer(cast("Vector", value)))
                yield from _suspect(f"size of the {name}", "machine", wrong)
            elif value:
                wrong = changed(field, value * (1 + _SMALL))
                yield from _suspect(f"{field.replace('_', ' ')} of the {name}", "machine", wrong)
        for field, body in zip(element.points(), (element.body, element.bodies[-1]), strict=False):
            for moved in _moves(mechanism, getattr(element, field)):
                wrong = changed(field, moved.point)
                yield from moved.suspect(f"place of the {name} on the {body}", wrong)
        left = [other.model_dump() for other in mechanism.force_elements if other.name != name]
        without = _changed(mechanism, force_elements=left)
        yield from _suspect(f"{name} missing", "law", without, scale=0.0)


def _gravity(mechanism: Mechanism) -> Iterator[Suspect]:
    if parameters_of(mechanism) is None:
        yield from _suspect(
            "gravity", "machine", _changed(mechanism, gravity=mechanism.gravity * (1 + _SMALL))
        )


def _starts(mechanism: Mechanism) -> Iterator[Suspect]:
    """Each start coordinate; closed stops are moved with it."""
    named = parameters_of(mechanism) is not None
    for i, name in enumerate(mechanism.coordinates):
        is_angle = i < len(mechanism.angles)
        yield from _start_speed(mechanism, i)
        if named and is_angle:
            continue  # a parameter
        start = tuple(value + _SMALL * (k == i) for k, value in enumerate(mechanism.start))
        unit = "rad" if is_angle else "m"
        yield from _suspect(
            f"start of {name}", "start", _changed(mechanism, start=start), unit=unit
        )


def _start_speed(mechanism: Mechanism, i: int) -> Iterator[Suspect]:
    """One start speed; the others are moved with it where stops or loops tie them to it."""
    equations, (q, u) = Equations(mechanism), initial_state(mechanism)
    is_angle = i < len(mechanism.angles)
    rate = math.sqrt((mechanism.gravity or 1.0) / mechanism_length(mechanism))
    step = _SMALL * rate * (1.0 if is_angle else mechanism_length(mechanism))
    wrong = np.zeros_like(u)
    wrong[i] = step
    wrong = consistent_speeds(
        equations, q, wrong, [stop.name for stop in mechanism.stops if stop.closed]
    )
    if abs(wrong[i]) > 1e-3 * step:  # else it is held
        name = f"start speed of {mechanism.coordinates[i]}"
        changed = _changed(mechanism, start_speeds=tuple((u + wrong).tolist()))
        yield from _suspect(name, "start", changed, scale=step, unit="rad/s" if is_angle else "m/s")


def _missing(mechanism: Mechanism) -> Iterator[Suspect]:
    for stop in mechanism.stops:
        if stop.closed:
            left = [other.model_dump() for other in mechanism.stops if other.name != stop.name]
            yield from _suspect(
                f"{stop.name} missing", "law", _changed(mechanism, stops=left), scale=0.0
            )
    for joint in mechanism.loop_joints:
        left = [other.model_dump() for other in mechanism.joints if other.name != joint.name]
        yield from _suspect(
            f"{joint.name} missing", "machine", _changed(mechanism, joints=left), scale=0.0
        )


def _rounded(mechanism: Mechanism) -> Iterator[Suspect]:
    """All data rounded to what common formats keep."""
    parameters = parameters_of(mechanism)
    for cut, what in (
        (_six_digits, "six digits, as text formats write them"),
        (_single, "single precision"),
    ):
        if parameters is not None:
            chosen = TrebuchetParameters(
                **{name: cut(value) for name, value in parameters.model_dump().items()}
            )
            if chosen != parameters:
                yield Suspect(
                    f"parameters in {what}", "machine", model(mechanism.name, chosen), scale=0.0
                )
        wrong = _changed(mechanism, **_cut(mechanism.model_dump(), cut))
        if wrong and wrong != mechanism:
            yield Suspect(f"data in {what}", "machine", wrong, scale=0.0)


def _six_digits(value: float) -> float:
    return float(f"{value:.6g}")


def _single(value: float) -> float:
    return float(np.float32(value))


def _cut(data: Any, cut: Callable[[float], float]) -> Any:
    if isinstance(data, dict):
        return {key: _cut(value, cut) for key, value in data.items()}
    if isinstance(data, tuple | list):
        return tuple(_cut(value, cut) for value in data)
    return cut(data) if isinstance(data, float) else data


Changes = Callable[[Any], Mapping[str, Any]]


"""Other fields of a part."""


@once_a_mechanism
def systematic_faults(mechanism: Mechanism) -> tuple[Suspect, ...]:
    """Those that make another mechanism of it, and a possible one."""
    seen, found = [mechanism], list[Suspect]()
    for name, kind, fields in _faults(mechanism):
        wrong = consistent_mechanism({**mechanism.model_dump(), **fields})
        if wrong is not None and wrong not in seen:
            seen.append(wrong)
            found.append(Suspect(name, kind, wrong, scale=0.0))
    return tuple(found)


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
    """Inertia about the joint less that about the centre of mass [kg m^2]."""
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


"""Mistakes in all bodies, by name."""


def _zero(*fields: str) -> Callable[[AnyForceElement], dict[str, Any]]:
    return lambda _: dict.fromkeys(fields, 0.0)


def _times(factor: float, *fields: str) -> Callable[[AnyForceElement], dict[str, Any]]:
    return lambda e: {name: factor * getattr(e, name) for name in fields if hasattr(e, name)}


_ELEMENTS: dict[str, Callable[[AnyForceElement], dict[str, Any]]] = {
    "damping of all elements missing": _zero("damping"),
    "damping of all elements doubled": _times(2.0, "damping"),
    "stiffness of all elements missing": _zero("stiffness", "cubic_stiffness"),
    "stiffness and damping of all elements doubled": _times(
        2.0, "stiffness", "cubic_stiffness", "damping"
    ),
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


"""Mistakes in all force elements, by name."""


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
    """Equations with so many times each component's small size; None where there are none."""

    def equations(self, factors: Sequence[float]) -> Equations | None:
        """Equations with a fault of that size; None where there is no such mechanism."""
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
            "direction of gravity", lambda f: with_tilted_gravity(mechanism, f[0] * _SMALL), tilt
        )
    rate = Component("rate", _SMALL * math.sqrt(gravity / length), "1/s", positive=True)
    yield law("damping of all bodies", lambda f: with_damping(mechanism, f[0] * rate.scale), rate)
    yield from _rubbing(mechanism, torque, math.sqrt(gravity / length), length)
    viscous = Component("viscous", torque * math.sqrt(length / gravity), "N m s/rad", positive=True)
    spring = Component("stiffness", torque, "N m/rad", positive=True)
    constant = Component("torque at the start", torque, "N m")
    for joint in _turning(mechanism):
        element = partial(with_joint_element, mechanism, joint.name)
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
    return with_friction(mechanism, rows, factors[0] * size)


def _turning(mechanism: Mechanism) -> list[AnyJoint]:
    return [joint for joint in mechanism.joints if _TURNS[joint]]


def armatures(mechanism: Mechanism) -> Iterator[Hypothesis]:
    """Rotors' inertias on the joints, which engines have; they move like bodies' inertias."""
    size = _SMALL * sum(body.mass for body in mechanism.bodies) * mechanism_length(mechanism) ** 2
    for joint in _turning(mechanism):
        name, element = (
            f"armature of the {joint.name}",
            partial(with_joint_element, mechanism, joint.name),
        )
        inertia = Component("", size, "kg m^2", positive=True)
        yield Hypothesis(
            name, "law", (inertia,), name, lambda f, e=element: e(armature=f[0] * size)
        )


def _sprung(element: Callable[..., Equations], unit: float, factors: Sequence[float]) -> Equations:
    return element(stiffness=factors[0] * unit, torque=factors[1] * unit)


def gross_faults(mechanism: Mechanism) -> Iterator[tuple[str, Equations]]:
    """Faults without a size that no small fault leads to."""
    yield "velocity-dependent forces dropped", without_centrifugal(mechanism)
    if mechanism.gravity:
        down = mechanism.gravity_direction == (0.0, -1.0)
        yield "gravity reversed", with_tilted_gravity(mechanism, math.pi)
        for angle, where in ((90, "along +x"), (-90, "along -x")):
            turned = where if down else f"turned by {angle:+d} deg"
            yield f"gravity {turned}", with_tilted_gravity(mechanism, math.radians(angle))
        yield "no gravity", Equations(mechanism.model_copy(update={"gravity": 0.0}))
