"""Mechanisms of changed data whose closed stops touch and whose loops close at the start."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from ...models.errors import InputError
from ...models.kinematics import Kinematics
from ...models.mechanism import Mechanism
from ...models.spec import Vector
from ...models.stops import AnyStop, PointStop, Stop
from ...reference.equations import Equations, consistent_coordinates

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
    """The mechanism with its start moved to the nearest one at which its loops close; None if there is none.

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
    start = consistent_coordinates(Equations(mechanism), np.array(mechanism.start), names, gaps)
    return None if start is None else tuple(start.tolist())
