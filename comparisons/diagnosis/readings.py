"""Mistakes of reading a right motion: wrong scale, sign, point, time, unit or precision of what is recorded."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...models.arrays import FloatArray
from ...models.joints import GROUND
from ...models.kinematics import Kinematics
from ...models.spec import Vector
from ...models.trajectory import PointMotion, Trajectory
from ...reference.solution import Solution
from .suspects import mechanism_length

NO_MOTION = "no motion: everything as at the start"
_DEGREES = 180 / math.pi
_ALIKE = 1e-3  # of a factor that is taken for a sign or a unit
_NOTHING = 1e-6  # a factor that is taken for zero


@dataclass(frozen=True)
class Reading:
    """The reference, read with a mistake."""

    name: str
    wrong: tuple[Trajectory, ...]
    """With a mistake of size one; of several numbers, with each of them. Linear in them, but for times."""
    text: Callable[[Sequence[float]], str] | None = None
    """The size, from the fitted factors; None: it has none."""
    at: Callable[[float], Trajectory | None] | None = None
    """With a mistake of another size, where that is not linear; None where that makes no sense."""
    least: float = -math.inf
    """The smallest factor that makes sense."""


def plain_readings(
    solution: Solution, reference: Trajectory, given: Trajectory, step: float
) -> Iterator[Reading]:
    """Readings of the reference that are wrong in one way.

    Args:
        reference: at the engine's times.
        given: the engine's.
        step: the engine's [s].
    """
    yield from _scales(reference, step)
    yield from _axes(reference)
    yield from _points(solution, reference)
    yield from _of_coordinates(reference)
    for kind, cut in (("single precision", _single), ("six digits", _six_digits)):
        yield Reading(f"values in {kind}", (_rounded(reference, given, cut),))
    yield Reading(NO_MOTION, (_frozen(solution, reference),))


def _scales(r: Trajectory, step: float) -> Iterator[Reading]:
    """One kind of quantity, or that of one stop, joint or marker, times a number."""

    def scaled(what: str, **doubled: object) -> Reading:
        wrong = replace(r, **doubled)  # type: ignore[arg-type]
        of_force = step if what.endswith(("torque", "torques", "force", "forces")) else math.nan
        return Reading(f"scale of {what}", (wrong,), lambda f: scale_text(f[0], of_force))

    for name, torque in r.stop_torques.items():
        if torque.any():
            effort = r.mechanism.stop(name).effort
            yield scaled(
                f"the {name}'s {effort}", stop_torques={**r.stop_torques, name: 2 * torque}
            )
    if len(r.stop_torques) > 1:
        yield scaled("all stop torques", stop_torques={n: 2 * v for n, v in r.stop_torques.items()})
    for name, force in r.joint_reactions.items():
        yield scaled(f"the {name}'s force", joint_reactions={**r.joint_reactions, name: 2 * force})
    yield scaled(
        "all joint forces", joint_reactions={n: 2 * v for n, v in r.joint_reactions.items()}
    )
    for position, velocity, what in ((2, 2, ""), (2, 1, "position of "), (1, 2, "velocity of ")):
        points = {
            n: PointMotion(position * m.position, velocity * m.velocity)
            for n, m in r.markers.items()
        }
        for name in r.markers:
            yield scaled(f"the {what}{name}", markers={**r.markers, name: points[name]})
        if len(points) > 1:
            yield scaled(f"the {what}markers", markers=points)
    yield scaled("the coordinates", q=2 * r.q)
    yield scaled("the coordinates' speeds", u=2 * r.u)
    yield scaled("the coordinates and their speeds", q=2 * r.q, u=2 * r.u)
    yield scaled(
        "all speeds",
        u=2 * r.u,
        markers={n: PointMotion(m.position, 2 * m.velocity) for n, m in r.markers.items()},
    )
    yield scaled("the kinetic energy", kinetic_energy=2 * r.kinetic_energy)
    yield scaled("the potential energy", potential_energy=2 * r.potential_energy)
    yield _unit_of_mass(r)
    yield scaled(
        "both energies",
        kinetic_energy=2 * r.kinetic_energy,
        potential_energy=2 * r.potential_energy,
    )


def _unit_of_mass(r: Trajectory) -> Reading:
    """All that is proportional to mass."""
    wrong = replace(
        r,
        stop_torques={n: 2 * v for n, v in r.stop_torques.items()},
        joint_reactions={n: 2 * v for n, v in r.joint_reactions.items()},
        kinetic_energy=2 * r.kinetic_energy,
        potential_energy=2 * r.potential_energy,
    )
    return Reading(
        "scale of all masses, forces and energies",
        (wrong,),
        lambda f: scale_text(f[0]),
        least=_NOTHING - 1.0,
    )


def _axes(r: Trajectory) -> Iterator[Reading]:
    """Components of the markers' motion with the wrong sign, or exchanged."""
    changes: tuple[tuple[str, Callable[[FloatArray], FloatArray]], ...] = (
        ("mirrored, x", lambda v: v * [-1, 1]),
        ("mirrored, y", lambda v: v * [1, -1]),
        ("x and y exchanged", lambda v: v[:, ::-1]),
    )
    for how, change in changes:
        mirrored = {
            n: PointMotion(change(m.position), change(m.velocity)) for n, m in r.markers.items()
        }
        yield Reading(f"markers {how}", (replace(r, markers=mirrored),))
        slow = {n: PointMotion(m.position, mirrored[n].velocity) for n, m in r.markers.items()}
        yield Reading(f"velocities of the markers {how}", (replace(r, markers=slow),))


def _points(solution: Solution, r: Trajectory) -> Iterator[Reading]:
    """Positions from another origin, and markers at a point that is a little off on the body."""
    kinematics, length = solution.equations.kinematics, mechanism_length(r.mechanism)
    yield _origin("the positions", r, list(r.markers), length)
    if len(r.markers) > 1:
        yield from (_origin(f"the {name}'s position", r, [name], length) for name in r.markers)
    for marker in r.mechanism.markers:
        if marker.name not in r.markers:
            continue
        if marker.body != GROUND:
            shifts = [
                (marker.point[0] + length, marker.point[1]),
                (marker.point[0], marker.point[1] + length),
            ]
            moved = [_at(kinematics, r, marker.body, point) for point in shifts]
            wrong = tuple(
                replace(r, markers={**r.markers, marker.name: motion}) for motion in moved
            )
            yield Reading(
                f"point of the {marker.name} on the {marker.body}", wrong, _shift_text(length)
            )


def _origin(what: str, r: Trajectory, names: Sequence[str], length: float) -> Reading:
    """Positions of markers counted from elsewhere."""

    def moved(shift: Sequence[float]) -> Trajectory:
        points = {
            n: PointMotion(r.markers[n].position + length * np.array(shift), r.markers[n].velocity)
            for n in names
        }
        return replace(r, markers={**r.markers, **points})

    return Reading(f"origin of {what}", (moved((1, 0)), moved((0, 1))), _shift_text(length))


def _at(kinematics: Kinematics, r: Trajectory, body: str, point: Vector) -> PointMotion:
    row = kinematics.point(body, point)
    return PointMotion(kinematics.position(row, r.q), kinematics.velocity(row, r.q, r.u))


def _shift_text(length: float) -> Callable[[Sequence[float]], str]:
    return lambda f: f"x {f[0] * length:+.3g} m, y {f[1] * length:+.3g} m"


def _of_coordinates(r: Trajectory) -> Iterator[Reading]:
    """Angles and their speeds: single signs, wrapped."""
    for i, name in enumerate(r.mechanism.coordinates):
        sign = np.ones(r.q.shape[1])
        sign[i] = -1.0
        yield Reading(f"sign of {name} and its speed", (replace(r, q=sign * r.q, u=sign * r.u),))
        yield Reading(f"sign of {name}", (replace(r, q=sign * r.q),))
        yield Reading(f"sign of the speed of {name}", (replace(r, u=sign * r.u),))
    is_angle = np.arange(r.q.shape[1]) < len(r.mechanism.angles)
    wrapped = np.angle(np.exp(1j * r.q))
    yield Reading(
        "angles wrapped to half a turn", (replace(r, q=np.where(is_angle, wrapped, r.q)),)
    )
    yield Reading(
        "angles wrapped to a turn", (replace(r, q=np.where(is_angle, r.q % (2 * math.pi), r.q)),)
    )


def scale_text(factor: float, step: float = math.nan) -> str:
    """Of a mistake that adds so many times the right value; a sign or a unit where it is one.

    Args:
        factor: of the right value, added to it.
        step: the engine's [s]: a force times it is an impulse.
    """
    value = 1.0 + factor
    known = {
        -1.0: "wrong sign",
        _DEGREES: "degrees for radians",
        1 / _DEGREES: "radians for degrees",
        step: f"times {value:.6g}, the step",
        1 / step: f"times {value:.6g}, one over the step",
    }
    for number, text in known.items():
        if abs(value - number) < _ALIKE * abs(number):
            return text
    return "always zero" if abs(value) < _NOTHING else f"times {value:.6g}"


def _rounded(
    r: Trajectory, given: Trajectory, cut: Callable[[FloatArray], FloatArray]
) -> Trajectory:
    """The reference, rounded in those quantities that are rounded in the given trajectory."""

    def like(own: FloatArray, other: FloatArray | None) -> FloatArray:
        return cut(own) if other is not None and np.array_equal(cut(other), other) else own

    def each(
        own: Mapping[str, FloatArray], other: Mapping[str, FloatArray]
    ) -> dict[str, FloatArray]:
        return {name: like(values, other.get(name)) for name, values in own.items()}

    points = {name: given.markers.get(name, motion) for name, motion in r.markers.items()}
    return replace(
        r,
        q=like(r.q, given.q),
        u=like(r.u, given.u),
        markers={
            n: PointMotion(
                like(m.position, points[n].position), like(m.velocity, points[n].velocity)
            )
            for n, m in r.markers.items()
        },
        kinetic_energy=like(r.kinetic_energy, given.kinetic_energy),
        potential_energy=like(r.potential_energy, given.potential_energy),
        stop_torques=each(r.stop_torques, given.stop_torques),
        joint_reactions=each(r.joint_reactions, given.joint_reactions),
    )


def _single(values: FloatArray) -> FloatArray:
    return values.astype(np.float32).astype(np.float64)


def _six_digits(values: FloatArray) -> FloatArray:
    unit = 10.0 ** (np.floor(np.log10(np.maximum(np.abs(values), 1e-300))) - 5)
    return np.round(values / unit) * unit


def _frozen(solution: Solution, r: Trajectory) -> Trajectory:
    start = solution.trajectory(np.zeros(1))
    points = {
        n: PointMotion(
            np.broadcast_to(m.position, r.markers[n].position.shape), 0.0 * r.markers[n].velocity
        )
        for n, m in start.markers.items()
    }
    return replace(
        r,
        q=np.broadcast_to(start.q, r.q.shape),
        u=0.0 * r.u,
        markers=points,
        kinetic_energy=0.0 * r.kinetic_energy,
        potential_energy=np.broadcast_to(start.potential_energy, r.potential_energy.shape),
    )
