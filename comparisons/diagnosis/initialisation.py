"""A machine with one thing changed no longer fits together: its stops and its start are made to."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ...models.arrays import FloatArray
from ...models.errors import InputError
from ...models.kinematics import Kinematics
from ...models.mechanism import GROUND, Mechanism, PointStop, Stop
from ...reference.equations import Equations

_ROUNDS = 30  # of Gauss and Newton: from a changed machine's start it takes three or four
_FITS = 1e-14  # [rad or m] relative to the size of the coordinates


def built(fields: dict[str, Any], start_moves: bool = False) -> Mechanism | None:
    """A mechanism of these fields whose closed stops touch at its start; None if there is none.

    Joints that close a loop may be open there, see :func:`looped`.

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
        bare = _mechanism(fields, stops=())
        touching = bare.model_copy(update={"stops": _touching(bare, fields["stops"])})
        if not start_moves:
            return _mechanism(touching.model_dump())
        start = _nearest(touching, [_place_of(stop) for stop in fields["stops"]])
        return None if start is None else _mechanism(fields, start=start)
    except InputError:
        return None


def looped(mechanism: Mechanism) -> Mechanism | None:
    """The mechanism with its start moved to the nearest one at which its loops close; None if there is none.

    Closed stops stay where they are, and still touch.
    """
    if not any(mechanism.loop_closure_residual.values()):
        return mechanism
    start = _nearest(mechanism, [_place_of(stop.model_dump()) for stop in mechanism.stops])
    return None if start is None else built({**mechanism.model_dump(), "start": start})


def _mechanism(fields: dict[str, Any], **changes: Any) -> Mechanism:
    return Mechanism(**{**fields, **changes})


def _unit(parts: Sequence[dict[str, Any]], direction: str) -> list[dict[str, Any]]:
    return [
        part | {direction: tuple(value / math.hypot(*part[direction]) for value in part[direction])}
        if direction in part
        else dict(part)
        for part in parts
    ]


def _place_of(stop: dict[str, Any]) -> float:
    return float(stop["offset"] if "offset" in stop else stop["limit"])


def _touching(bare: Mechanism, stops: Sequence[dict[str, Any]]) -> tuple[Stop | PointStop, ...]:
    """The stops, with those that are closed moved to where they touch at the mechanism's start."""
    kinematics, q = Kinematics(bare), np.array(bare.start)
    angles = {body.name: bare.start[i] for i, body in enumerate(bare.bodies)} | {GROUND: 0.0}
    moved: list[Stop | PointStop] = []
    for stop in stops:
        if "offset" in stop:
            at = kinematics.position(kinematics.point(stop["body"], stop["point"]), q)
            place: dict[str, Any] = {"offset": float(np.dot(stop["normal"], at))} if stop["closed"] else {}
            moved.append(PointStop(**{**stop, **place}))
        else:
            between = stop["sense"] * (angles[stop["body"]] - angles[stop["relative_to"]])
            place = {"limit": between} if stop["closed"] else {}
            moved.append(Stop(**{**stop, **place}))
    return tuple(moved)


def _nearest(mechanism: Mechanism, places: Sequence[float]) -> tuple[float, ...] | None:
    """The start nearest to the mechanism's at which loops close and closed stops touch (Gauss-Newton).

    Args:
        places: where each stop really stands, its offset or limit.
    """
    equations = Equations(mechanism)
    closed = [
        (stop.name, _place_of(stop.model_dump()) - place)
        for stop, place in zip(mechanism.stops, places, strict=True)
        if stop.closed
    ]
    names, shifts = [name for name, _ in closed], np.array([shift for _, shift in closed])
    q: FloatArray = np.array(mechanism.start)
    for _ in range(_ROUNDS):
        gaps = np.array([float(equations.kinematics.gap(name, q)) for name in names]) + shifts
        error: FloatArray = np.concatenate([np.atleast_1d(equations.loop_residual(q)), gaps])
        if np.abs(error).max(initial=0.0) <= _FITS * (1 + np.abs(q).max()):
            return tuple(q.tolist())
        q = np.asarray(q - np.linalg.lstsq(equations.constraint_jacobian(q, names), error, rcond=None)[0])
    return None
