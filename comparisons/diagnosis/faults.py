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
    AnyStop,
    ElementTable,
    FreeJoint,
    PinJoint,
    PointStop,
    PrismaticJoint,
    SlotJoint,
    Stop,
    TranslationJoint,
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
    residuals = mechanism.loop_closure_residual | mechanism.coupler_residual
    if not any(residuals.values()):
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
_MOST = 10.0  # times the right value: a parameter that is wrong by more is no small mistake of it

_Result = TypeVar("_Result")


def once_a_mechanism(function: Callable[[Mechanism], _Result]) -> Callable[[Mechanism], _Result]:
    """Keep a function's results for the last mechanisms, of which several runs are diagnosed."""
    return lru_cache(maxsize=2)(function)  # pyright: ignore[reportReturnType]  (specs are hashable)


def mechanism_length(mechanism: Mechanism) -> float:
    """The largest distance of a point from the origin of its body [m]; 1 where all are zero."""
    points = [body.centre for body in mechanism.bodies]
    points += [
        point for joint in mechanism.joints for point in (joint.parent_point, joint.child_point)
    ]
    points += [marker.point for marker in mechanism.markers]
    return max(math.hypot(*point) for point in points) or 1.0


# --------------------------------------------------------------------------- faults of a size


@dataclass(frozen=True)
class Component:
    """One number of a fault."""

    label: str
    scale: float
    """Its small size, in its unit; relative where it has none."""
    unit: str
    length: float = math.inf
    """The mechanism's [m]: no point of it is farther off than that."""
    positive: bool = False
    """A stiffness or a damping: less than none would drive the mechanism."""

    def is_sensible(self, factor: float) -> bool:
        """Tell whether `factor` times the small size is a value that such a fault can have."""
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
class Fault:
    """A fault whose size is one number or several, or none: it is there or not."""

    name: str
    kind: Kind
    components: tuple[Component, ...]
    group: str
    """Faults of one group are the same mistake with more or fewer components."""
    make: Callable[[Sequence[float]], Equations | None]
    """Equations with so many times each component's small size; None where there are none."""

    def equations(self, factors: Sequence[float]) -> Equations | None:
        """Equations with a fault of that size; None where there is no such mechanism."""
        pairs = zip(self.components, factors, strict=True)
        return self.make(factors) if all(c.is_sensible(factor) for c, factor in pairs) else None

    def text(self, factors: Sequence[float]) -> str:
        """The size."""
        return ", ".join(c.text(factor) for c, factor in zip(self.components, factors, strict=True))


def sizeless(name: str, kind: Kind, equations: Equations) -> Fault:
    """A fault that is there or not."""
    return Fault(name, kind, (), name, lambda _: equations)


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
    of_wall: bool = False
    """Whether it is about a stop on a point."""


def combined(
    mechanism: Mechanism, suspects: Sequence[Suspect], factors: Sequence[float]
) -> Mechanism | None:
    """The mechanism with so many times each suspect's amount; None where there is none."""
    if any(suspect.scale == 0 for suspect in suspects):
        return None
    fields = [mechanism.model_dump(), *(suspect.wrong.model_dump() for suspect in suspects)]
    # Start speeds that are left out are zeros.
    n = max(len(each["start_speeds"]) for each in fields)
    right, *wrong = (each | {"start_speeds": each["start_speeds"] or (0.0,) * n} for each in fields)
    blended = _blended(right, wrong, factors)
    return consistent_mechanism(blended, any(suspect.start_moves for suspect in suspects))


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


_AXIS: ElementTable[Callable[[Any], Vector | None]] = ElementTable(
    "The diagnosis",
    JOINTS,
    {
        PinJoint: lambda _: None,
        WeldJoint: lambda _: None,
        SlotJoint: lambda joint: joint.axis,
        PrismaticJoint: lambda joint: joint.axis,
        FreeJoint: lambda _: None,
        TranslationJoint: lambda _: None,
    },
)
"""Direction in which the two bodies slide."""
_TURNS: ElementTable[bool] = ElementTable(
    "The diagnosis",
    JOINTS,
    {
        PinJoint: True,
        WeldJoint: False,
        SlotJoint: True,
        PrismaticJoint: False,
        FreeJoint: False,
        TranslationJoint: False,
    },
)
"""Whether two bodies turn against each other in a joint: a free body turns against none."""


class _Suspects:
    """The table of a mechanism's suspects as it is made; mechanisms that are none are left out."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism, self.fields = mechanism, mechanism.model_dump()
        self.step = _SMALL * mechanism_length(mechanism)
        self.rows: list[Suspect] = []

    def add(self, name: str, fields: Mapping[str, Any], kind: Kind = "machine", **row: Any) -> None:
        """Other fields of the mechanism."""
        wrong = consistent_mechanism({**self.fields, **fields}, row.get("start_moves", False))
        if wrong is not None:
            self.rows.append(Suspect(name, kind, wrong, **row))

    def part(self, name: str, parts: str, part: str, fields: Mapping[str, Any], **row: Any) -> None:
        """Other fields of one body, joint, stop or force element."""
        every = [each.model_dump() for each in getattr(self.mechanism, parts)]
        changed = [each | fields if each["name"] == part else each for each in every]
        self.add(name, {parts: changed}, **row)

    def vector(self, parts: str, part: str, field: str) -> Vector:
        """A point or a direction of a part."""
        every = getattr(self.mechanism, parts)
        return getattr(next(each for each in every if each.name == part), field)

    def point(self, name: str, parts: str, part: str, field: str) -> None:
        """A point: farther from its body's origin, or across; along x and y where it is there."""
        x, y = self.vector(parts, part, field)
        step, size = self.step, math.hypot(x, y)
        if size == 0:
            moved = {", x": (step, 0.0), ", y": (0.0, step)}
        else:
            longer = {field: (x * (1 + _SMALL), y * (1 + _SMALL))}
            self.part(name, parts, part, longer, group=name)
            aside = step / size
            moved = {", across": (x - aside * y, y + aside * x)}
        for where, place in moved.items():
            row: dict[str, Any] = {"scale": step, "unit": "m", "group": name}
            self.part(name + where, parts, part, {field: place}, **row)

    def shifted(
        self, name: str, parts: str, part: str, field: str, axis: Vector | None = None, **row: Any
    ) -> None:
        """A point along x and y; not along an axis, on which a slot stays the same."""
        x, y = self.vector(parts, part, field)
        places = {"x": (x + _SMALL, y), "y": (x, y + _SMALL)}
        for (where, place), along in zip(places.items(), ((1.0, 0.0), (0.0, 1.0)), strict=True):
            if axis is None or abs(np.dot(along, axis)) != 1.0:
                row |= {"unit": "m", "group": name}
                self.part(f"{name}, {where}", parts, part, {field: place}, **row)

    def turned(self, name: str, parts: str, part: str, field: str, **row: Any) -> None:
        """A direction, anticlockwise by a small angle; it is brought to length one later."""
        x, y = self.vector(parts, part, field)
        direction = {field: (x - _SMALL * y, y + _SMALL * x)}
        self.part(name, parts, part, direction, unit="rad", **row)

    def without(self, name: str, parts: str, kind: Kind = "law") -> None:
        """The mechanism without a part."""
        every = getattr(self.mechanism, parts)
        left = [part.model_dump() for part in every if part.name != name]
        self.add(f"{name} missing", {parts: left}, kind, scale=0.0)


@once_a_mechanism
def machine_suspects(mechanism: Mechanism) -> tuple[Suspect, ...]:
    """Suspects of a built model."""
    table, parameters = _Suspects(mechanism), parameters_of(mechanism)
    if parameters is not None:
        for name, field in TrebuchetParameters.model_fields.items():
            value, is_angle = float(getattr(parameters, name)), name.endswith("0")
            step = _SMALL if is_angle else value * _SMALL
            wrong = model(mechanism.name, parameters.model_copy(update={name: value + step}))
            name_text = f"{name} ({str(field.description).partition(' [')[0]})"
            kind: Kind = "start" if is_angle else "machine"
            table.rows.append(Suspect(name_text, kind, wrong, unit="rad" if is_angle else ""))
    _suspect_bodies(table, parameters is not None)
    _suspect_joints_and_walls(table)
    _suspect_force_elements(table)
    if parameters is None:
        table.add("gravity", {"gravity": mechanism.gravity * (1 + _SMALL)})
    _suspect_start(table, parameters is not None)
    for stop in mechanism.stops:
        if stop.closed:
            table.without(stop.name, "stops")
    for joint in mechanism.loop_joints:
        table.without(joint.name, "joints", "machine")
    _suspect_couplers(table)
    # All data rounded to what common formats keep.
    cuts: dict[str, Callable[[float], float]] = {
        "six digits, as text formats write them": lambda value: float(f"{value:.6g}"),
        "single precision": lambda value: float(np.float32(value)),
    }
    for what, cut in cuts.items():
        if parameters is not None:
            rounded = TrebuchetParameters(**_cut(parameters.model_dump(), cut))
            if rounded != parameters:
                wrong = model(mechanism.name, rounded)
                table.rows.append(Suspect(f"parameters in {what}", "machine", wrong, scale=0.0))
        data = consistent_mechanism(_cut(table.fields, cut))
        if data is not None and data != mechanism:
            table.rows.append(Suspect(f"data in {what}", "machine", data, scale=0.0))
    return tuple(table.rows)


def _cut(data: Any, cut: Callable[[float], float]) -> Any:
    if isinstance(data, dict):
        return {key: _cut(value, cut) for key, value in data.items()}
    if isinstance(data, tuple | list):
        return tuple(_cut(value, cut) for value in data)
    return cut(data) if isinstance(data, float) else data


def _suspect_bodies(table: _Suspects, named: bool) -> None:
    """Masses, inertias and centres; a parameter of the same effect comes before them."""
    bodies = table.mechanism.bodies
    for body in bodies:
        name, inertia = body.name, body.inertia
        denser = {"mass": body.mass * (1 + _SMALL)}
        if not named or inertia:  # the mass of a named point is a parameter
            table.part(f"mass of the {name}", "bodies", name, denser)
        if inertia and not named:
            denser["inertia"] = inertia * (1 + _SMALL)
            table.part(f"mass and inertia of the {name}", "bodies", name, denser)
        # Of a point mass: a radius of gyration of a millimetre.
        grown = inertia * _SMALL or body.mass * _SMALL
        amount: dict[str, Any] = {} if inertia else {"scale": grown, "unit": "kg m^2"}
        larger = {"inertia": inertia + grown}
        table.part(f"inertia of the {name}", "bodies", name, larger, **amount)
    if sum(body.inertia > 0 for body in bodies) > 1:
        every = [body.model_dump() | {"inertia": body.inertia * (1 + _SMALL)} for body in bodies]
        table.add("inertias of all bodies", {"bodies": every})
    for body in bodies:
        table.point(f"centre of mass of the {body.name}", "bodies", body.name, "centre")


def _suspect_joints_and_walls(table: _Suspects) -> None:
    """Points and directions of joints, and of stops on points."""
    mechanism = table.mechanism
    for joint in mechanism.tree_joints:
        for end, body in (("parent", joint.parent), ("child", joint.child)):
            field = f"{end}_point"
            name = f"place of the {joint.name} on the {body}"
            table.point(name, "joints", joint.name, field)
    for joint in mechanism.loop_joints:
        for end, body in (("parent", joint.parent), ("child", joint.child)):
            slot = _AXIS[joint](joint) if end == "parent" else None
            name = f"place of the {joint.name} on the {body}"
            table.shifted(name, "joints", joint.name, f"{end}_point", slot)
    for joint in mechanism.joints:
        if _AXIS[joint](joint) is not None:
            table.turned(f"direction of the {joint.name}", "joints", joint.name, "axis")
    for stop in mechanism.point_stops:
        name, place = stop.name, {"offset": stop.offset + _SMALL}
        row: dict[str, Any] = {"start_moves": True, "of_wall": True}
        table.part(f"place of the {name}", "stops", name, place, unit="m", **row)
        table.turned(f"direction of the {name}", "stops", name, "normal", of_wall=True)
        point = f"point of the {name} on the {stop.body}"
        table.shifted(point, "stops", name, "point", None, **row)


def _suspect_force_elements(table: _Suspects) -> None:
    """Springs, dampers, forces and torques: a wrong number, a wrong point, a missing element."""
    refuse_unknown("The diagnosis", table.mechanism.force_elements)
    for element in table.mechanism.force_elements:
        name = element.name
        for field in element.numbers():
            value = getattr(element, field)
            what = f"{field.replace('_', ' ')} of the {name}"
            if isinstance(value, tuple):
                x, y = cast("Vector", value)
                value, what = (x * (1 + _SMALL), y * (1 + _SMALL)), f"size of the {name}"
            elif value:
                value = value * (1 + _SMALL)
            else:
                continue
            table.part(what, "force_elements", name, {field: value})
        for field, body in zip(element.points(), (element.body, element.bodies[-1]), strict=False):
            table.point(f"place of the {name} on the {body}", "force_elements", name, field)
        table.without(name, "force_elements")


def _suspect_couplers(table: _Suspects) -> None:
    """Couplers: a wrong ratio, which the start follows, or none at all."""
    for coupler in table.mechanism.couplers:
        for term in coupler.terms:
            wrong = term.model_copy(update={"ratio": term.ratio * (1 + _SMALL)})
            terms = [wrong if each == term else each for each in coupler.terms]
            what = f"ratio of {term.coordinate} in the {coupler.name}"
            changes = {"terms": [each.model_dump() for each in terms]}
            table.part(what, "couplers", coupler.name, changes, start_moves=True)
        table.without(coupler.name, "couplers", "machine")


def _suspect_start(table: _Suspects, named: bool) -> None:
    """Suspect each start coordinate, with which closed stops are moved, and each start speed."""
    mechanism, length = table.mechanism, mechanism_length(table.mechanism)
    equations, (q, u) = Equations(mechanism), initial_state(mechanism)
    closed = [stop.name for stop in mechanism.stops if stop.closed]
    rate = math.sqrt((mechanism.gravity or 1.0) / length)
    for i, name in enumerate(mechanism.coordinates):
        is_angle = i < len(mechanism.angles)
        unit = "rad" if is_angle else "m"
        step = _SMALL * rate * (1.0 if is_angle else length)
        wrong = np.zeros_like(u)
        wrong[i] = step
        # The other speeds are moved with it where stops or loops tie them to it, or hold it.
        wrong = consistent_speeds(equations, q, wrong, closed)
        if abs(wrong[i]) > 1e-3 * step:
            speeds = {"start_speeds": tuple((u + wrong).tolist())}
            table.add(f"start speed of {name}", speeds, "start", scale=step, unit=f"{unit}/s")
        if not (named and is_angle):  # else it is a parameter
            start = tuple(value + _SMALL * (k == i) for k, value in enumerate(mechanism.start))
            table.add(f"start of {name}", {"start": start}, "start", unit=unit)


def hypotheses(mechanism: Mechanism, closing: bool = True) -> list[Fault]:
    """Faults of a size; those of several components also with each of them alone.

    Args:
        mechanism: without faults.
        closing: whether the start of a faulty mechanism is moved to where its loops close, as a
            motion needs it.
    """
    suspects = [suspect for suspect in machine_suspects(mechanism) if suspect.scale]
    faults: list[Fault] = []
    for _, group in groupby(suspects, key=lambda suspect: suspect.group or suspect.name):
        members = list(group)
        faults += [of_suspects(mechanism, suspect.name, [suspect], closing) for suspect in members]
        if len(members) > 1:
            faults.append(of_suspects(mechanism, members[0].group, members, closing))
    return [*faults, *_laws(mechanism)]


def of_suspects(
    mechanism: Mechanism, name: str, suspects: Sequence[Suspect], closing: bool = False
) -> Fault:
    """A fault of as many numbers as there are suspects."""
    length = 2 * mechanism_length(mechanism)
    components: list[Component] = []
    for suspect in suspects:
        label = suspect.name.removeprefix(suspect.group).lstrip(", ") or "along"
        label = label if len(suspects) > 1 else ""
        components.append(Component(label, suspect.scale, suspect.unit, length))

    def make(factors: Sequence[float]) -> Equations | None:
        wrong = combined(mechanism, suspects, factors)
        closed = with_closed_loops(wrong) if wrong is not None and closing else wrong
        return None if closed is None else Equations(closed)

    return Fault(name, suspects[0].kind, tuple(components), suspects[0].group or name, make)


def _laws(mechanism: Mechanism) -> Iterator[Fault]:
    """Forces that the mechanism does not have, in parts of what gravity can do."""
    length, gravity = mechanism_length(mechanism), mechanism.gravity or 1.0
    torque = _SMALL * sum(body.mass for body in mechanism.bodies) * gravity * length
    frequency = math.sqrt(gravity / length)

    def law(
        name: str, make: Callable[[Sequence[float]], Equations], *components: Component
    ) -> Fault:
        return Fault(name, "law", components, name, make)

    if mechanism.gravity:
        tilt = Component("", _SMALL, "rad")
        yield law(
            "direction of gravity", lambda f: with_tilted_gravity(mechanism, f[0] * _SMALL), tilt
        )
    rate = Component("rate", _SMALL * frequency, "1/s", positive=True)
    yield law("damping of all bodies", lambda f: with_damping(mechanism, f[0] * rate.scale), rate)
    # Viscous friction of slides, each alone, and the same in all joints of a kind.
    joints = [joint for joint in mechanism.joints if _TURNS[joint]]
    kinematics, groups = Kinematics(mechanism), dict[str, tuple[FloatArray, float, str]]()
    pins = np.array([kinematics.angle(joint.child, joint.parent).coefficients for joint in joints])
    hinges = np.array([joint.kind == "pin" for joint in joints])
    if len(pins) > 1:
        groups["all turning joints"] = pins, torque / frequency, "N m s/rad"
    if not hinges.all() and len(pins[hinges]) > 1:
        groups["all pins"] = pins[hinges], torque / frequency, "N m s/rad"
    names = mechanism.coordinates
    slides = [i for i, name in enumerate(names) if name not in mechanism.angles]
    rows, force = np.eye(len(names))[slides], torque / length / (length * frequency)
    for i, row in zip(slides, rows, strict=True):
        groups[f"slide {names[i]}"] = row[None], force, "N s/m"
    if len(slides) > 1:
        groups["all slides"] = rows, force, "N s/m"
    for name, (rates, size, unit) in groups.items():
        friction = Component("viscous", size, unit, positive=True)
        yield Fault(
            f"friction or damping of {name}",
            "law",
            (friction,),
            name,
            lambda f, rates=rates, size=size: with_friction(mechanism, rates, f[0] * size),
        )
    viscous = Component("viscous", torque * math.sqrt(length / gravity), "N m s/rad", positive=True)
    spring = Component("stiffness", torque, "N m/rad", positive=True)
    constant = Component("torque at the start", torque, "N m")
    for joint in joints:
        add, name = partial(with_joint_element, mechanism, joint.name), joint.name
        yield law(
            f"friction or damping of the {name}",
            lambda f, add=add: add(damping=f[0] * viscous.scale),
            viscous,
        )
        yield law(f"torque on the {name}", lambda f, add=add: add(torque=f[0] * torque), constant)
        yield law(f"spring on the {name}", lambda f, add=add: add(stiffness=f[0] * torque), spring)
        yield law(
            f"spring on the {name}",
            lambda f, add=add: add(stiffness=f[0] * torque, torque=f[1] * torque),
            spring,
            constant,
        )


def armatures(mechanism: Mechanism) -> Iterator[Fault]:
    """Rotors' inertias on the joints, which engines have; they move like bodies' inertias."""
    size = _SMALL * sum(body.mass for body in mechanism.bodies) * mechanism_length(mechanism) ** 2
    inertia = Component("", size, "kg m^2", positive=True)
    for joint in mechanism.joints:
        if _TURNS[joint]:
            name, add = f"armature of the {joint.name}", partial(with_joint_element, mechanism)
            yield Fault(
                name,
                "law",
                (inertia,),
                name,
                lambda f, add=add, joint=joint.name: add(joint, armature=f[0] * size),
            )


# ------------------------------------------------------------------------ faults without a size

_Changes = Callable[[Mechanism, Any], dict[str, Any]]
"""Other fields of a body, or of a force element."""


def parallel_axis_term(m: Mechanism, body: Body) -> float:
    """Inertia about the joint less that about the centre of mass [kg m^2]."""
    arm = np.subtract(body.centre, m.joint_of(body.name).child_point)
    return body.mass * float(arm @ arm)


_BODIES: dict[str, _Changes] = {
    "inertias about the joints in place of those about the centres of mass": lambda m, b: {
        "inertia": b.inertia + parallel_axis_term(m, b)
    },
    "inertias about the centres of mass taken for those about the joints": lambda m, b: {
        "inertia": b.inertia - parallel_axis_term(m, b)
    },
    "inertias of all bodies missing": lambda _, b: {"inertia": 0.0},
    "centres of mass at the bodies' origins": lambda _, b: {"centre": (0.0, 0.0)},
    "centres of mass at the joints": lambda m, b: {"centre": m.joint_of(b.name).child_point},
}
"""Mistakes in all bodies."""


def _times(factor: float, *fields: str) -> _Changes:
    return lambda _, e: {name: factor * getattr(e, name) for name in fields if hasattr(e, name)}


def _zero(*fields: str) -> _Changes:
    return lambda _, __: dict.fromkeys(fields, 0.0)


_ELEMENTS: dict[str, _Changes] = {
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
    "constant forces missing": lambda _, __: {"force": (0.0, 0.0)},
    "torques on one body only, without their reaction": lambda _, e: (
        {"relative_to": GROUND} if hasattr(e, "torque") else {}
    ),
    "rotational springs and dampers against the ground": lambda _, e: (
        {"relative_to": GROUND} if hasattr(e, "rest_angle") else {}
    ),
}
"""Mistakes in all force elements."""


@once_a_mechanism
def missing_faults(mechanism: Mechanism) -> tuple[Fault, ...]:
    """Parts that are missing, and data that are rounded; loops closed, as a motion needs it."""
    faults: list[Fault] = []
    for suspect in machine_suspects(mechanism):
        closed = None if suspect.scale else with_closed_loops(suspect.wrong)
        if closed is not None:
            faults.append(sizeless(suspect.name, suspect.kind, Equations(closed)))
    return tuple(faults)


@once_a_mechanism
def systematic_faults(mechanism: Mechanism) -> tuple[Fault, ...]:
    """Mistakes in all parts of a kind that make another mechanism of it, and a possible one."""
    m, fields = mechanism, mechanism.model_dump()
    rows: list[tuple[str, Kind, dict[str, Any]]] = []

    def in_all(parts: str, changes: _Changes) -> dict[str, Any]:
        """Parts, those with some other fields that have these."""
        changed: list[dict[str, Any]] = []
        for part in getattr(m, parts):
            own, new = part.model_dump(), changes(m, part).items()
            changed.append(own | {name: value for name, value in new if name in own})
        return {parts: changed}

    def left(keep: Callable[[AnyStop], bool]) -> dict[str, Any]:
        return {"stops": [stop.model_dump() for stop in m.stops if keep(stop)]}

    for name, changes in _BODIES.items():
        changed = in_all("bodies", changes)
        if all(body["inertia"] >= 0 for body in changed["bodies"]):
            rows.append((name, "machine", changed))
    rows.append(("all force elements missing", "law", {"force_elements": ()}))
    for name, changes in _ELEMENTS.items():
        rows.append((name, "law", in_all("force_elements", changes)))
    reversed_speeds = tuple(-speed for speed in m.start_speeds)
    still = (0.0,) * len(m.coordinates)
    rows.append(("start speeds ignored", "start", {"start_speeds": still}))
    rows.append(("start speeds reversed", "start", {"start_speeds": reversed_speeds}))
    rows.append(("gravity along -y", "law", {"gravity_direction": (0.0, -1.0)}))
    rows.append(("all stops missing", "law", {"stops": ()}))
    rows.append(("all couplers missing", "law", {"couplers": ()}))
    closed = left(lambda stop: stop.closed)
    rows.append(("stops that are open at the start missing", "law", closed))
    for stop in m.stops:
        if not stop.closed:
            others = left(lambda other, stop=stop: other != stop)
            rows.append((f"{stop.name} missing", "law", others))
    for value in (0.0, 1.0):
        bounce = in_all("stops", lambda _, __, e=value: {"restitution": e})
        rows.append((f"restitution {value:g} of all stops", "law", bounce))

    seen, faults = [mechanism], list[Fault]()
    for name, kind, changed in rows:
        wrong = consistent_mechanism({**fields, **changed})
        if wrong is None or wrong in seen:
            continue
        seen.append(wrong)
        loops = with_closed_loops(wrong)
        if loops is not None:
            faults.append(sizeless(name, kind, Equations(loops)))
    return tuple(faults)


@once_a_mechanism
def gross_faults(mechanism: Mechanism) -> tuple[Fault, ...]:
    """Faults of the laws without a size, that no small fault leads to."""
    laws = {"velocity-dependent forces dropped": without_centrifugal(mechanism)}
    if mechanism.gravity:
        down = mechanism.gravity_direction == (0.0, -1.0)
        laws["gravity reversed"] = with_tilted_gravity(mechanism, math.pi)
        for angle, where in ((90, "along +x"), (-90, "along -x")):
            turned = where if down else f"turned by {angle:+d} deg"
            laws[f"gravity {turned}"] = with_tilted_gravity(mechanism, math.radians(angle))
        laws["no gravity"] = Equations(mechanism.model_copy(update={"gravity": 0.0}))
    return tuple(sizeless(name, "law", equations) for name, equations in laws.items())
