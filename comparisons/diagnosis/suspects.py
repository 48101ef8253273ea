"""Mechanisms with one thing wrong, whose effects are compared with a deviation.

For a mechanism that a named builder makes, its parameters are suspects, because a wrong length changes a mass and an
inertia, too. Every single number of a mechanism is a suspect in any case.
Consistent initialisation makes the stops, or the start, fit the thing that was changed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from pydantic import TypeAdapter

from ...models.errors import InputError
from ...models.kinematics import Kinematics
from ...models.machines.parameters import TrebuchetParameters
from ...models.machines.registry import model
from ...models.machines.trebuchet import parameters_of
from ...models.mechanism import AnyStop, Mechanism, PinJoint, PointStop, SlotJoint, Stop
from ...models.spec import Vector
from ...reference.equations import Equations, consistent_coordinates
from ..runs.results import Cause

Kind = Literal["machine", "start", "law", "reading", "settings"]
_SMALL = 1e-6  # relative, or [rad] or [m]: well above rounding and linear


@dataclass(frozen=True)
class Suspect:
    """A mechanism with one thing wrong by a small amount (or, where `scale` is 0, something missing or replaced)."""

    name: str
    kind: Kind
    wrong: Mechanism
    scale: float = _SMALL
    """How wrong `wrong` is; 0: not a matter of degree."""
    unit: str = ""
    """Of the amount; '': relative."""
    start_moves: bool = False
    """Where a closed stop no longer touches: whether the start is moved to where it does, instead of the stop."""

    def amount(self, factor: float) -> str:
        """The error that explains the deviation, `factor` times `scale`, as text."""
        if self.scale == 0:
            return ""
        size = factor * self.scale
        return f"{100 * size:+.3g} %" if not self.unit else f"{size:+.3g} {self.unit}"

    def cause(self, factor: float, explained: float) -> Cause:
        """As a cause of the share `explained` of a deviation, by `factor` times its amount."""
        return Cause(name=self.name, kind=self.kind, amount=self.amount(factor), explained=explained)


def machine_suspects(mechanism: Mechanism) -> tuple[Suspect, ...]:
    """All suspects of a built model."""
    parts = (
        _parameters,
        _masses,
        _centres,
        _positions,
        _slots,
        wall_suspects,
        _gravity,
        _starts,
        _missing,
        _rounded,
    )
    return tuple(suspect for part in parts for suspect in part(mechanism))


def more_wrong(mechanism: Mechanism, suspect: Suspect, factor: float) -> Suspect | None:
    """The same suspect with `factor` times its amount, for what is not linear; None where there is no such machine."""
    if suspect.scale == 0:
        return None
    blended = _blended(mechanism.model_dump(), suspect.wrong.model_dump(), factor)
    wrong = consistent_mechanism(blended, suspect.start_moves)
    return None if wrong is None else replace(suspect, wrong=wrong, scale=suspect.scale * factor)


def _blended(right: Any, wrong: Any, factor: float) -> Any:
    """Right + factor (wrong - right), number by number."""
    if isinstance(right, dict):
        return {key: _blended(value, wrong[key], factor) for key, value in right.items()}
    if isinstance(right, tuple | list):
        return tuple(_blended(a, b, factor) for a, b in zip(right, wrong, strict=True))
    if isinstance(right, float):
        return right + factor * (wrong - right)
    return right


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
        yield Suspect(f"{name} ({what})", "start" if is_angle else "machine", wrong, unit="rad" if is_angle else "")


def _changed(mechanism: Mechanism, start_moves: bool = False, **fields: Any) -> Mechanism | None:
    return consistent_mechanism({**mechanism.model_dump(), **fields}, start_moves)


def _with_part(
    mechanism: Mechanism, parts: str, name: str, fields: Mapping[str, Any], start_moves: bool = False
) -> Mechanism | None:
    """With one of the bodies, joints or stops changed."""
    every = [part.model_dump() | (dict(fields) if part.name == name else {}) for part in getattr(mechanism, parts)]
    return _changed(mechanism, start_moves, **{parts: every})


def _suspect(name: str, kind: Kind, wrong: Mechanism | None, **others: Any) -> Iterator[Suspect]:
    """The suspect, where there is such a mechanism."""
    if wrong is not None:
        yield Suspect(name, kind, wrong, **others)


def _masses(mechanism: Mechanism) -> Iterator[Suspect]:
    """Masses and inertias of single bodies; a parameter of the same effect comes before them."""
    named = parameters_of(mechanism) is not None
    for body in mechanism.bodies:
        if not named:
            wrong = _with_part(mechanism, "bodies", body.name, {"mass": body.mass * (1 + _SMALL)})
            yield from _suspect(f"mass of the {body.name}", "machine", wrong)
        grown = body.inertia * _SMALL or body.mass * _SMALL  # of a point mass: a radius of gyration of a millimetre
        wrong = _with_part(mechanism, "bodies", body.name, {"inertia": body.inertia + grown})
        amount: dict[str, Any] = {} if body.inertia else {"scale": grown, "unit": "kg m^2"}
        yield from _suspect(f"inertia of the {body.name}", "machine", wrong, **amount)


def _centres(mechanism: Mechanism) -> Iterator[Suspect]:
    """Centres of mass along their bodies."""
    for body in mechanism.bodies:
        if body.centre != (0.0, 0.0):
            wrong = _with_part(mechanism, "bodies", body.name, {"centre": _longer(body.centre)})
            yield from _suspect(f"centre of mass of the {body.name}", "machine", wrong)


def _positions(mechanism: Mechanism) -> Iterator[Suspect]:
    """Places of joints on the bodies that carry them."""
    for joint in mechanism.joints:
        for end in ("parent", "child"):
            point = getattr(joint, f"{end}_point")
            if point != (0.0, 0.0):
                wrong = _with_part(mechanism, "joints", joint.name, {f"{end}_point": _longer(point)})
                yield from _suspect(f"place of the {joint.name} on the {getattr(joint, end)}", "machine", wrong)
    for joint in mechanism.loop_joints:
        yield from _shifted(mechanism, joint)


def _shifted(mechanism: Mechanism, joint: PinJoint | SlotJoint) -> Iterator[Suspect]:
    """A loop joint's points, moved a little along each axis of their frames: more than a change of length."""
    for end in ("parent", "child"):
        for point, axis in zip(_aside(getattr(joint, f"{end}_point")), "xy", strict=True):
            if end == "parent" and isinstance(joint, SlotJoint) and abs(np.dot(_AXES[axis], joint.axis)) == 1.0:
                continue  # a slot moved along its own line is the same slot
            wrong = _with_part(mechanism, "joints", joint.name, {f"{end}_point": point})
            name = f"place of the {joint.name} on the {getattr(joint, end)}, {axis}"
            yield from _suspect(name, "machine", wrong, unit="m")


_AXES = {"x": (1.0, 0.0), "y": (0.0, 1.0)}


def _longer(point: tuple[float, float]) -> tuple[float, float]:
    return point[0] * (1 + _SMALL), point[1] * (1 + _SMALL)


def _aside(point: tuple[float, float]) -> tuple[tuple[float, float], tuple[float, float]]:
    return (point[0] + _SMALL, point[1]), (point[0], point[1] + _SMALL)


def _turned(direction: tuple[float, float]) -> tuple[float, float]:
    """A direction turned anticlockwise by a small angle; its length is corrected where a mechanism is built from it."""
    x, y = direction
    return x - _SMALL * y, y + _SMALL * x


def _slots(mechanism: Mechanism) -> Iterator[Suspect]:
    """Wrong directions of slots."""
    for joint in mechanism.joints:
        if isinstance(joint, SlotJoint):
            wrong = _with_part(mechanism, "joints", joint.name, {"axis": _turned(joint.axis)})
            yield from _suspect(f"direction of the {joint.name}", "machine", wrong, unit="rad")


def wall_suspects(mechanism: Mechanism) -> Iterator[Suspect]:
    """Stops on points: a wrong offset, normal or point of the body."""
    for stop in mechanism.point_stops:
        wrong = _with_part(mechanism, "stops", stop.name, {"offset": stop.offset + _SMALL}, start_moves=True)
        yield from _suspect(f"place of the {stop.name}", "machine", wrong, unit="m", start_moves=True)
        wrong = _with_part(mechanism, "stops", stop.name, {"normal": _turned(stop.normal)})
        yield from _suspect(f"direction of the {stop.name}", "machine", wrong, unit="rad")
        for point, axis in zip(_aside(stop.point), "xy", strict=True):
            wrong = _with_part(mechanism, "stops", stop.name, {"point": point}, start_moves=True)
            name = f"point of the {stop.name} on the {stop.body}, {axis}"
            yield from _suspect(name, "machine", wrong, unit="m", start_moves=True)


def _gravity(mechanism: Mechanism) -> Iterator[Suspect]:
    if parameters_of(mechanism) is None:
        yield from _suspect("gravity", "machine", _changed(mechanism, gravity=mechanism.gravity * (1 + _SMALL)))


def _starts(mechanism: Mechanism) -> Iterator[Suspect]:
    """Each start coordinate; closed stops are moved with it."""
    named = parameters_of(mechanism) is not None
    for i, name in enumerate(mechanism.coordinates):
        is_angle = i < len(mechanism.bodies)
        if named and is_angle:
            continue  # a parameter
        start = tuple(value + _SMALL * (k == i) for k, value in enumerate(mechanism.start))
        unit = "rad" if is_angle else "m"
        yield from _suspect(f"start of {name}", "start", _changed(mechanism, start=start), unit=unit)


def _missing(mechanism: Mechanism) -> Iterator[Suspect]:
    for stop in mechanism.stops:
        if stop.closed:
            left = [other.model_dump() for other in mechanism.stops if other.name != stop.name]
            yield from _suspect(f"{stop.name} missing", "law", _changed(mechanism, stops=left), scale=0.0)
    for joint in mechanism.loop_joints:
        left = [other.model_dump() for other in mechanism.joints if other.name != joint.name]
        yield from _suspect(f"{joint.name} missing", "machine", _changed(mechanism, joints=left), scale=0.0)


def _rounded(mechanism: Mechanism) -> Iterator[Suspect]:
    """All data rounded to what common formats keep."""
    parameters = parameters_of(mechanism)
    for cut, what in ((_six_digits, "six digits, as text formats write them"), (_single, "single precision")):
        if parameters is not None:
            chosen = TrebuchetParameters(**{name: cut(value) for name, value in parameters.model_dump().items()})
            if chosen != parameters:
                yield Suspect(f"parameters in {what}", "machine", model(mechanism.name, chosen), scale=0.0)
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


_STOPS = TypeAdapter[tuple[Stop | PointStop, ...]](tuple[AnyStop, ...])


def consistent_mechanism(fields: dict[str, Any], start_moves: bool = False) -> Mechanism | None:
    """A mechanism of these fields whose closed stops touch at its start; None if there is none.

    Joints that close a loop may be open there, see :func:`with_closed_loops`.

    Args:
        fields: as a mechanism's `model_dump`; directions are brought to length one.
        start_moves: where a closed stop does not touch, the start is taken to where it does; else the stop is.
    """
    fields = {**fields, "joints": _unit(fields["joints"], "axis"), "stops": _unit(fields["stops"], "normal")}
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
    """The mechanism with its start moved to the nearest one at which its loops close; None if there is none.

    Closed stops stay where they are, and still touch.
    """
    if not any(mechanism.loop_closure_residual.values()):
        return mechanism
    start = _consistent_start(mechanism, mechanism.stops)
    return None if start is None else consistent_mechanism({**mechanism.model_dump(), "start": start})


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
    angle = {body.name: bare.start[i] for i, body in enumerate(bare.bodies)}

    def position(body: str, point: Vector) -> complex:
        return complex(*kinematics.position(kinematics.point(body, point), q))

    def moved(stop: Stop | PointStop) -> Stop | PointStop:
        return stop.model_copy(update={stop.position_field: float(stop.component(angle.__getitem__, position))})

    return tuple(moved(stop) if stop.closed else stop for stop in stops)


def _consistent_start(mechanism: Mechanism, stops: Sequence[Stop | PointStop]) -> tuple[float, ...] | None:
    """The start nearest to the mechanism's at which loops close and closed stops touch.

    Args:
        stops: the mechanism's, where they really stand.
    """
    closed = [(own, real) for own, real in zip(mechanism.stops, stops, strict=True) if own.closed]
    gaps = np.array([real.position - own.position for own, real in closed])
    names = [own.name for own, _ in closed]
    start = consistent_coordinates(Equations(mechanism), np.array(mechanism.start), names, gaps)
    return None if start is None else tuple(start.tolist())
