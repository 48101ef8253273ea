"""Mechanisms with one thing wrong, whose effects are compared with a deviation.

For a mechanism that a named builder makes, its parameters are suspects, because a wrong length
changes a mass and an inertia, too. Every single number of a mechanism is a suspect in any case.
Consistent initialisation makes the stops, or the start, fit the thing that was changed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from ...models.force_elements import ConstantForce
from ...models.joints import AnyJoint, PrismaticJoint, SlotJoint
from ...models.kinematics import initial_state
from ...models.machines.parameters import TrebuchetParameters
from ...models.machines.registry import model
from ...models.machines.trebuchet import parameters_of
from ...models.mechanism import Mechanism
from ...reference.equations import Equations, consistent_speeds
from ..runs.results import Cause
from .consistent import consistent_mechanism

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
    group: str = ""
    """Suspects of one group are components of one mistake, such as a point that is wrong along x and along y."""

    def amount(self, factor: float) -> str:
        """The error that explains the deviation, `factor` times `scale`, as text."""
        if self.scale == 0:
            return ""
        size = factor * self.scale
        return f"{100 * size:+.3g} %" if not self.unit else f"{size:+.3g} {self.unit}"

    def cause(self, factor: float, explained: float) -> Cause:
        """As a cause of the share `explained` of a deviation, by `factor` times its amount."""
        return Cause(
            name=self.name, kind=self.kind, amount=self.amount(factor), explained=explained
        )


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
    """The mechanism with several suspects at once, each with so many times its amount; None where there is none."""
    if any(suspect.scale == 0 for suspect in suspects):
        return None
    right, *wrong = _with_speeds(
        [mechanism.model_dump(), *(suspect.wrong.model_dump() for suspect in suspects)]
    )
    blended = _blended(right, wrong, factors)
    return consistent_mechanism(blended, any(suspect.start_moves for suspect in suspects))


def _with_speeds(every: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """With start speeds of zero where those are left out, if one of them has any."""
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
    """With one of the bodies, joints or stops changed."""
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
    """The largest distance of any of its points from the origin of its body [m]; 1 where all are at the origins."""
    points = [joint.parent_point for joint in mechanism.joints] + [
        joint.child_point for joint in mechanism.joints
    ]
    points += [body.centre for body in mechanism.bodies] + [
        marker.point for marker in mechanism.markers
    ]
    return max(math.hypot(*point) for point in points) or 1.0


def _shifted(mechanism: Mechanism, joint: AnyJoint) -> Iterator[Suspect]:
    """A loop joint's points, moved a little along each axis of their frames: more than a change of length."""
    for end in ("parent", "child"):
        for point, axis in zip(_aside(getattr(joint, f"{end}_point")), "xy", strict=True):
            if (
                end == "parent"
                and isinstance(joint, SlotJoint | PrismaticJoint)
                and abs(np.dot(_AXES[axis], joint.axis)) == 1.0
            ):
                continue  # a slot moved along its own line is the same slot
            wrong = _with_part(mechanism, "joints", joint.name, {f"{end}_point": point})
            group = f"place of the {joint.name} on the {getattr(joint, end)}"
            yield from _suspect(f"{group}, {axis}", "machine", wrong, unit="m", group=group)


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
        if isinstance(joint, SlotJoint | PrismaticJoint):
            wrong = _with_part(mechanism, "joints", joint.name, {"axis": _turned(joint.axis)})
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
    for element in mechanism.force_elements:
        name = element.name
        for field in ("stiffness", "damping", "rest_length", "rest_angle", "torque"):
            if value := getattr(element, field, 0.0):
                wrong = _with_part(mechanism, "force_elements", name, {field: value * (1 + _SMALL)})
                yield from _suspect(f"{field.replace('_', ' ')} of the {name}", "machine", wrong)
        if isinstance(element, ConstantForce):
            wrong = _with_part(mechanism, "force_elements", name, {"force": _longer(element.force)})
            yield from _suspect(f"size of the {name}", "machine", wrong)
        for field, body in (("point", element.body), ("relative_point", element.bodies[-1])):
            for moved in (
                _moves(mechanism, getattr(element, field)) if hasattr(element, field) else ()
            ):
                wrong = _with_part(mechanism, "force_elements", name, {field: moved.point})
                yield from moved.suspect(f"place of the {name} on the {body}", wrong)
        left = [other.model_dump() for other in mechanism.force_elements if other.name != name]
        yield from _suspect(
            f"{name} missing", "law", _changed(mechanism, force_elements=left), scale=0.0
        )


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
