"""Mistakes of reading a right motion: wrong scale, sign, point, time, unit or precision of what is recorded."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np

from ...models.arrays import FloatArray
from ...models.elements import GROUND
from ...models.kinematics import Kinematics
from ...models.mechanism import Body, Mechanism
from ...models.spec import Vector
from ...models.trajectory import PointMotion, Trajectory
from ...reference.equations import Equations
from ...reference.solution import Solution
from .faults import mechanism_length

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


def energy_readings(r: Trajectory) -> Iterator[Reading]:
    """Readings of the reference whose energies are wrong."""
    unit = float(np.abs(r.kinetic_energy).max()) or 1.0
    raised = replace(r, potential_energy=r.potential_energy + unit)
    yield Reading("zero of the potential energy", (raised,), lambda f: f"{f[0] * unit:+.4g} J")
    moved = replace(
        r,
        kinetic_energy=2 * r.kinetic_energy,
        potential_energy=r.potential_energy - r.kinetic_energy,
    )
    yield Reading(
        "kinetic energy counted as potential", (moved,), lambda f: f"{-100 * f[0]:+.3g} %"
    )
    yield from _kinetic(r)
    for name, part in _potential_parts(r):
        if part.any() and _is_part(part, r.potential_energy):
            wrong = replace(r, potential_energy=r.potential_energy + part)
            yield Reading(f"{name} in the potential energy", (wrong,), lambda f: scale_text(f[0]))
    origins = Equations(_changed_bodies(r.mechanism, centre=(0.0, 0.0))).potential_energy(r.q)
    if (origins != r.potential_energy).any():
        yield Reading(
            "potential energy of the bodies' origins", (replace(r, potential_energy=origins),)
        )


def _is_part(part: FloatArray, whole: FloatArray) -> bool:
    """Whether it has another course than the whole: else its scale is that of the whole."""
    left = part - whole * float(part @ whole) / (float(whole @ whole) or 1.0)
    return bool(np.linalg.norm(left) > _ALIKE_energies * np.linalg.norm(part))


_ALIKE_energies = 1e-6


def _kinetic(r: Trajectory) -> Iterator[Reading]:
    """Without a body, of it alone, without that it turns, or with its inertia about the joint."""
    bodies = r.mechanism.bodies
    spin = {body.name: _spin(r, body.name) for body in bodies}
    turning = {body.name: 0.5 * body.inertia * spin[body.name] for body in bodies if body.inertia}
    every, zero = r.kinetic_energy, np.zeros_like(r.t)
    wrong: dict[str, FloatArray] = {}
    for body in bodies if len(bodies) > 1 else ():
        own = 0.5 * body.mass * _square(r, body) + turning.get(body.name, zero)
        wrong |= {f"without the {body.name}": every - own, f"of the {body.name} alone": own}
    wrong |= {f"without the rotation of the {name}": every - own for name, own in turning.items()}
    if len(turning) > 1:
        wrong["without the rotation of the bodies"] = every - sum(turning.values(), zero)
    arms = {b.name: np.subtract(b.centre, r.mechanism.joint_of(b.name).child_point) for b in bodies}
    parallel = [0.5 * b.mass * float(arms[b.name] @ arms[b.name]) * spin[b.name] for b in bodies]
    wrong["with inertias about the joints"] = every + sum(parallel, zero)
    for how, energy in wrong.items():
        if _is_part(energy, every):
            yield Reading(f"kinetic energy {how}", (replace(r, kinetic_energy=energy),))


def _square(r: Trajectory, body: Body) -> FloatArray:
    row = r.kinematics.point(body.name, body.centre)
    return (r.kinematics.velocity(row, r.q, r.u) ** 2).sum(axis=1)


def _spin(r: Trajectory, body: str) -> FloatArray:
    return (r.u @ r.kinematics.angle(body).coefficients) ** 2


def _potential_parts(r: Trajectory) -> Iterator[tuple[str, FloatArray]]:
    """Of single bodies' weights, of single springs, and of all of these; each of shape (n,)."""
    m = r.mechanism

    def less(other: Mechanism) -> FloatArray:
        return r.potential_energy - Equations(other).potential_energy(r.q)

    if m.gravity:
        for body in m.bodies:
            yield f"weight of the {body.name}", less(_changed_bodies(m, body.name, mass=0.0))
    for element in m.force_elements:
        others = tuple(each for each in m.force_elements if each != element)
        yield element.name, less(m.model_copy(update={"force_elements": others}))
    if m.force_elements:
        yield "springs", less(m.model_copy(update={"force_elements": ()}))


def _changed_bodies(m: Mechanism, only: str = "", **fields: object) -> Mechanism:
    """With other fields of a body, or of all."""
    bodies = [b.model_copy(update=fields) if only in ("", b.name) else b for b in m.bodies]
    return m.model_copy(update={"bodies": tuple(bodies)})


_INSTANT = 1e-6  # of the compared time


_LATEST = 0.2  # of the compared time: what is later by more is not the same motion at another time


Take = Callable[[Trajectory], Trajectory]


"""The reference with those quantities taken from the later motion that are read late."""


@dataclass(frozen=True)
class _Times:
    """The reference at other times, by the size of the mistake."""

    solution: Solution
    reference: Trajectory
    step: float

    @property
    def instant(self) -> float:
        """A shift of size one [s]."""
        return _INSTANT * float(self.reference.t[-1])

    def read(self, times: FloatArray) -> Trajectory:
        """What is said to be at the reference's times, but is at others."""
        end = self.solution.segments[-1].end
        return replace(self.solution.trajectory(np.clip(times, 0.0, end)), t=self.reference.t)

    def shifted(self, name: str, taken: Take) -> Reading:
        """Some quantities read at other times."""
        t = self.reference.t

        def at(factor: float) -> Trajectory | None:
            return (
                taken(self.read(t + factor * self.instant))
                if abs(factor) * _INSTANT < _LATEST
                else None
            )

        def text(f: Sequence[float]) -> str:
            return f"{f[0] * self.instant:+.3g} s, {f[0] * self.instant / self.step:+.3g} steps"

        return Reading(name, (taken(self._later),), text, at)

    @cached_property
    def _later(self) -> Trajectory:
        return self.read(self.reference.t + self.instant)

    def rated(self) -> Reading:
        """Times that run at another rate."""
        t = self.reference.t

        def at(factor: float) -> Trajectory | None:
            return (
                self.read(t * (1 + factor * _INSTANT)) if abs(factor) * _INSTANT < _LATEST else None
            )

        first = self.read(t * (1 + _INSTANT))
        return Reading(
            "rate of time", (first,), lambda f: f"times {1 / (1 + f[0] * _INSTANT):.6g}", at
        )


def late_readings(solution: Solution, r: Trajectory, step: float) -> Iterator[Reading]:
    """Everything, or one kind of quantity, read at another time; or times that run at another rate."""
    times = _Times(solution, r, step)
    yield times.rated()
    yield times.shifted("time shifted", lambda x: x)
    forces = {"stop_torques": r.stop_torques, "joint_reactions": r.joint_reactions}
    yield times.shifted("motion shifted in time, and no force", lambda x: replace(x, **forces))
    speeds = _SPEEDS | {"velocity": _velocities}
    yield times.shifted("velocities shifted in time", lambda x: _taken(r, x, speeds.values()))
    places = {"coordinates": _coordinates, "position": _positions}
    yield times.shifted("positions shifted in time", lambda x: _taken(r, x, places.values()))
    points = (_positions, _velocities)
    yield times.shifted("markers shifted in time", lambda x: _taken(r, x, points))
    for kind, name in _ALONE.items():
        yield times.shifted(f"{name} shifted in time", lambda x, kind=kind: _KINDS[kind](r, x))


def partly_late_readings(
    solution: Solution, r: Trajectory, step: float, wrong: Sequence[str]
) -> Iterator[Reading]:
    """All those kinds of quantity read at one other time that deviate, and no others.

    Args:
        wrong: names of the quantities that deviate.
    """
    times = _Times(solution, r, step)
    kinds = [kind for kind in _KINDS if any(name.split(" of the ")[0] == kind for name in wrong)]
    kinds = [kind for kind in _KINDS if kind in kinds or (kind == "torque" and "force" in kinds)]
    if len(kinds) > 1 and {*kinds} not in _TOGETHER:
        name = f"{', '.join(_ALONE[kind] for kind in kinds)} shifted in time"
        yield times.shifted(name, lambda x: _taken(r, x, [_KINDS[kind] for kind in kinds]))
    if {*_SPEEDS, "kinetic energy"} <= {*kinds} and "coordinates" not in kinds:
        yield times.shifted(
            "speeds, and the energy of them, shifted in time", lambda x: _of_speeds(solution, r, x)
        )


def _of_speeds(solution: Solution, r: Trajectory, x: Trajectory) -> Trajectory:
    """What an engine shows whose speeds are those of another time than its coordinates."""
    mixed = solution.reading(r.t, solution.motion_of(r.t, r.q, x.u))
    return replace(mixed, stop_torques=r.stop_torques, joint_reactions=r.joint_reactions)


def _taken(
    r: Trajectory, x: Trajectory, takes: Iterable[Callable[[Trajectory, Trajectory], Trajectory]]
) -> Trajectory:
    for take in takes:
        r = take(r, x)
    return r


def _coordinates(r: Trajectory, x: Trajectory) -> Trajectory:
    return replace(r, q=x.q)


def _speeds(r: Trajectory, x: Trajectory) -> Trajectory:
    return replace(r, u=x.u)


def _positions(r: Trajectory, x: Trajectory) -> Trajectory:
    return replace(
        r, markers={n: replace(m, position=x.markers[n].position) for n, m in r.markers.items()}
    )


def _velocities(r: Trajectory, x: Trajectory) -> Trajectory:
    return replace(
        r, markers={n: replace(m, velocity=x.markers[n].velocity) for n, m in r.markers.items()}
    )


_SPEEDS = {"speeds of coordinates": _speeds}


_KINDS: dict[str, Callable[[Trajectory, Trajectory], Trajectory]] = {
    "coordinates": _coordinates,
    **_SPEEDS,
    "position": _positions,
    "velocity": _velocities,
    "torque": lambda r, x: replace(r, stop_torques=x.stop_torques),
    "force": lambda r, x: replace(r, joint_reactions=x.joint_reactions),
    "kinetic energy": lambda r, x: replace(r, kinetic_energy=x.kinetic_energy),
    "potential energy": lambda r, x: replace(r, potential_energy=x.potential_energy),
}


"""By the beginning of a quantity's name (:mod:`.signatures`); a stop on a point has a force, too."""


_TOGETHER = (
    {"speeds of coordinates", "velocity"},
    {"coordinates", "position"},
    {"position", "velocity"},
    {*_KINDS},
    {*_KINDS} - {"torque", "force"},
)


"""Those that :func:`late_readings` has."""


_ALONE = {
    "coordinates": "coordinates",
    "speeds of coordinates": "speeds of the coordinates",
    "position": "positions of the markers",
    "velocity": "velocities of the markers",
    "torque": "torques",
    "force": "forces",
    "kinetic energy": "kinetic energy",
    "potential energy": "potential energy",
}


"""As a report names them."""


_STEADY = 0.01  # of an angle's largest difference: one that varies by more is no other zero


_ROUNDING = 1e-9  # of values that are the same


Values = Mapping[str, FloatArray]


def mistaken_readings(reference: Trajectory, given: Trajectory) -> Iterator[Reading]:
    """Readings of the reference, at the times of the given trajectory, as they are nearest to it."""
    yield from _forces(reference, given)
    yield from _torques(reference, given)
    yield from _markers(reference, given)
    yield from _coordinates_mistaken(reference, given)


def _common(right: Values, given: Values) -> dict[str, FloatArray]:
    return {name: v for name, v in right.items() if name in given and given[name].shape == v.shape}


def _apart(one: FloatArray, other: FloatArray) -> float:
    distance = float(np.linalg.norm(one - other))
    return distance if math.isfinite(distance) else math.inf


def _nearer(given: Values, right: Values, wrong: Values) -> list[str]:
    """Subjects of which the wrong values are nearer to the given ones than the right ones."""
    return [
        name
        for name, values in right.items()
        if _apart(given[name], wrong[name]) < _apart(given[name], values)
    ]


def _subjects(names: Sequence[str], right: Values, wrong: Values) -> str:
    """Of whom, unless it is all that the mistake changes."""
    changed = [name for name, values in right.items() if _apart(values, wrong[name]) > 0]
    return "" if len(names) == len(changed) else f" of the {', '.join(names)}"


def _exchange(of: str, right: Values, given: Values) -> tuple[str, dict[str, str]] | None:
    """A sentence and whose value each subject has, where it is another one's."""
    nearest = {
        name: min(right, key=lambda m: (_apart(given[name], right[m]), m != name)) for name in right
    }
    wrong = {name: other for name, other in nearest.items() if name != other}
    if not wrong:
        return None
    if len(wrong) == 2 and all(wrong.get(other) == name for name, other in wrong.items()):
        return f"{of}{' and '.join(wrong)} exchanged", nearest
    return f"{of}{', '.join(wrong)} are those of {', '.join(wrong.values())}", nearest


def _forces(r: Trajectory, given: Trajectory) -> Iterator[Reading]:
    right = _common(r.joint_reactions, given.joint_reactions)
    exchanged = _exchange("joint forces of the ", right, given.joint_reactions)
    if exchanged is not None:
        forces = {name: right[other] for name, other in exchanged[1].items()}
        yield Reading(exchanged[0], (replace(r, joint_reactions={**r.joint_reactions, **forces}),))
    for how, change in _force_mistakes(r):
        wrong = {name: change(name, values) for name, values in right.items()}
        names = _nearer(given.joint_reactions, right, wrong)
        if names and not (
            how == _OTHER_BODY and len(names) in (1, len(right))
        ):  # else it is a scale
            forces = {**r.joint_reactions, **{name: wrong[name] for name in names}}
            yield Reading(
                f"joint forces{_subjects(names, right, wrong)} {how}",
                (replace(r, joint_reactions=forces),),
            )


_OTHER_BODY = "wrong sign"


def _force_mistakes(r: Trajectory) -> Iterator[tuple[str, Callable[[str, FloatArray], FloatArray]]]:
    """Components with the wrong sign, exchanged, in the frame of a body, or without the weight that the joint bears."""
    yield "mirrored, x", lambda _, v: v * [-1, 1]
    yield "mirrored, y", lambda _, v: v * [1, -1]
    yield "x and y exchanged", lambda _, v: v[:, ::-1]
    yield _OTHER_BODY, lambda _, v: -v
    ends = {joint.name: (joint.child, joint.parent) for joint in r.mechanism.joints}
    for sign, other in ((1, ""), (-1, ", wrong sign")):
        for end, whose in enumerate(("the body", "the parent")):
            yield (
                f"in the frame of {whose}{other}",
                lambda name, v, sign=sign, end=end: sign * in_frame(r, ends[name][end], v),
            )
    gravity = np.array(r.mechanism.gravity_vector)
    yield (
        "without the weight of the body",
        lambda name, v: v + r.mechanism.body(ends[name][0]).mass * gravity,
    )


def in_frame(r: Trajectory, body: str, vectors: FloatArray) -> FloatArray:
    """Vectors of the world by their components in a body's frame."""
    angle = r.kinematics.angle(body).value(r.q)
    z = (vectors[:, 0] + 1j * vectors[:, 1]) * np.exp(1j * angle)
    return np.stack([z.real, z.imag], axis=1)


def _torques(r: Trajectory, given: Trajectory) -> Iterator[Reading]:
    """Torques of stops, and forces of those on points, each under another one's name."""
    right = _common(
        {s.name: r.stop_torques[s.name] for s in r.mechanism.stops if s.closed}, given.stop_torques
    )
    exchanged = _exchange("torques of the ", right, given.stop_torques)
    if exchanged is not None:
        torques = {name: right[other] for name, other in exchanged[1].items()}
        yield Reading(exchanged[0], (replace(r, stop_torques={**r.stop_torques, **torques}),))


def _markers(r: Trajectory, given: Trajectory) -> Iterator[Reading]:
    names = [name for name in r.markers if name in given.markers]
    right = {n: _stacked(r.markers[n]) for n in names}
    exchanged = _exchange("", right, {n: _stacked(given.markers[n]) for n in names})
    if exchanged is not None:
        yield Reading(
            exchanged[0],
            (replace(r, markers=_with(r, {n: r.markers[m] for n, m in exchanged[1].items()})),),
        )
    taken = {n: _taken_mistaken(r, n, given.markers[n]) for n in names}
    nearest = exchanged[1] if exchanged is not None else dict.fromkeys(names, "")
    known = {
        n: motion
        for n, (_, motion) in taken.items()
        if not _is_same(motion, r.markers.get(nearest[n]))
    }
    text = "; ".join(filter(None, (_taken_text(n, *labels) for n, (labels, _) in taken.items())))
    if text and known:  # else they are exchanged
        yield Reading(
            text, (replace(r, markers=_with(r, {n: motion for n, (_, motion) in taken.items()})),)
        )
    bodies = {marker.name: marker.body for marker in r.mechanism.markers}
    velocities = {n: r.markers[n].velocity for n in names}
    local = {n: in_frame(r, bodies[n], v) for n, v in velocities.items()}
    turned = _nearer({n: given.markers[n].velocity for n in names}, velocities, local)
    if turned:
        wrong = _with(r, {n: replace(r.markers[n], velocity=local[n]) for n in turned})
        of = _subjects(turned, velocities, local) or " of the markers"
        yield Reading(f"velocities{of} in the frame of the body", (replace(r, markers=wrong),))


def _with(r: Trajectory, changed: Mapping[str, PointMotion]) -> dict[str, PointMotion]:
    return {**r.markers, **changed}


def _is_same(one: PointMotion, other: PointMotion | None) -> bool:
    return other is not None and _apart(_stacked(one), _stacked(other)) < _ROUNDING * float(
        np.abs(_stacked(one)).max()
    )


def _stacked(motion: PointMotion) -> FloatArray:
    return np.concatenate([motion.position, motion.velocity], axis=1)


def _taken_mistaken(
    r: Trajectory, name: str, given: PointMotion
) -> tuple[tuple[str, str], PointMotion]:
    """The known points that a marker's position and its velocity are nearest to, '' for its own; and their motion."""
    marker = r.mechanism.marker(name)
    assert marker is not None
    own = {"": r.markers[name]}
    known = {
        w: _at_mistaken(r, *at)
        for at, w in _known_points(r).items()
        if at != (marker.body, marker.point)
    }
    points = own | known
    position = min(points, key=lambda what: _apart(given.position, points[what].position))
    velocity = min(points, key=lambda what: _apart(given.velocity, points[what].velocity))
    if _apart(given.velocity, points[position].velocity) == _apart(
        given.velocity, points[velocity].velocity
    ):
        velocity = position  # on a body that does not turn the velocity tells no point
    return (position, velocity), PointMotion(points[position].position, points[velocity].velocity)


def _taken_text(name: str, position: str, velocity: str) -> str:
    if position == velocity:
        return f"{name} taken for {position}" if position else ""
    parts = (("position", position), ("velocity", velocity))
    return "; ".join(
        f"{what} of the {name} taken for that of {other}" for what, other in parts if other
    )


def _known_points(r: Trajectory) -> dict[tuple[str, Vector], str]:
    """Points of the bodies that something is at; the first name of a point counts."""
    points: dict[tuple[str, Vector], str] = {}
    for body in r.mechanism.bodies:
        points.setdefault((body.name, body.centre), f"the {body.name}'s centre of mass")
    for joint in r.mechanism.joints:
        points.setdefault((joint.child, joint.child_point), f"the {joint.name}")
        if joint.parent != GROUND:
            points.setdefault((joint.parent, joint.parent_point), f"the {joint.name}")
    for body in r.mechanism.bodies:
        points.setdefault((body.name, (0.0, 0.0)), f"the {body.name}'s origin")
    return points


def _at_mistaken(r: Trajectory, body: str, point: Vector) -> PointMotion:
    row = r.kinematics.point(body, point)
    return PointMotion(r.kinematics.position(row, r.q), r.kinematics.velocity(row, r.q, r.u))


def _coordinates_mistaken(r: Trajectory, given: Trajectory) -> Iterator[Reading]:
    """Coordinates in another order; and angles of joints, anticlockwise, in degrees, from another zero."""
    q, u = (
        {n: values[:, i] for i, n in enumerate(r.mechanism.coordinates)} for values in (r.q, r.u)
    )
    own = [{n: values[:, i] for i, n in enumerate(q)} for values in (given.q, given.u)]
    orders = [_exchange("coordinates ", *pair) for pair in zip((q, u), own, strict=True)]
    text = next((found[0] for found in orders if found is not None), None)
    if text is not None:
        names = [list(q) if found is None else list(found[1].values()) for found in orders]
        columns = [
            np.stack([v[n] for n in order], axis=1) for v, order in zip((q, u), names, strict=True)
        ]
        yield Reading(text, (replace(r, q=columns[0], u=columns[1]),))
    yield from _angles(r, given)


@dataclass(frozen=True)
class _Angles:
    """Coordinates and speeds by another convention, and the start by it."""

    how: str
    q: FloatArray
    u: FloatArray
    start: FloatArray

    def scaled(self, size: FloatArray, how: str) -> _Angles:
        """In other units, or with other signs."""
        named = ", ".join(filter(None, (self.how, how)))
        return _Angles(named, self.q * size, self.u * size, self.start * size)


def _angles(r: Trajectory, given: Trajectory) -> Iterator[Reading]:
    """Angles relative to the parents', anticlockwise, in degrees, from another zero."""
    is_angle = np.arange(r.q.shape[1]) < len(r.mechanism.angles)
    for angles in _frames(r):
        for (sign, turned), (factor, unit) in product(
            ((1, ""), (-1, "anticlockwise")), ((1, ""), (_DEGREES, "degrees"))
        ):
            how = ", ".join(filter(None, (turned, unit)))
            wrong = angles.scaled(np.where(is_angle, sign * factor, 1.0), how)
            if angles.how or not how or not is_angle.all():  # else it is a scale of all coordinates
                yield from _by(r, given, wrong)


def _by(r: Trajectory, given: Trajectory, wrong: _Angles) -> Iterator[Reading]:
    """Angles by a convention and their speeds, or that of the two which is nearer so; with the zeros that they have."""
    zeros = _zeros(given.q - wrong.q, np.ptp(wrong.q, axis=0))
    misread = _apart(given.q, wrong.q + zeros) < _apart(given.q, r.q)
    fast = _apart(given.u, wrong.u) < _apart(given.u, r.u)
    if not (misread or fast):
        return
    taken = replace(r, q=wrong.q + zeros if misread else r.q, u=wrong.u if fast else r.u)
    if not wrong.how:
        yield Reading(f"coordinates {_zero_text(r, zeros, wrong)}", (taken,))
        return
    what = (
        "angles"
        if misread and fast
        else "angles, not their speeds,"
        if misread
        else "speeds of the angles"
    )
    text = _zero_text(r, zeros, wrong) if misread and zeros.any() else ""
    yield Reading(" ".join(filter(None, (what, wrong.how, text))), (taken,))


def _zeros(difference: FloatArray, motion: FloatArray) -> FloatArray:
    """Of each coordinate the constant that it differs by; 0 where that is no constant beside what it moves by."""
    middle = np.median(difference, axis=0)
    spread = np.abs(difference - middle).max(axis=0)
    least = _ROUNDING * np.abs(middle)
    steady = (spread <= least + _STEADY * np.minimum(np.abs(middle), motion)) & np.isfinite(spread)
    return np.where(steady, middle, 0.0)


def _zero_text(r: Trajectory, zeros: FloatArray, wrong: _Angles) -> str:
    if np.allclose(zeros, -wrong.start, rtol=_STEADY, atol=_STEADY * float(np.abs(zeros).max())):
        return "relative to the start"
    angle = "deg" if wrong.how.endswith("degrees") else "rad"
    units = [angle if i < len(r.mechanism.angles) else "m" for i in range(len(zeros))]
    shown = zip(r.mechanism.coordinates, zeros, units, strict=True)
    return f"from another zero ({', '.join(f'{n} {v:+.4g} {unit}' for n, v, unit in shown if v)})"


def _frames(r: Trajectory) -> Iterator[_Angles]:
    """Angles as they are, and relative to the parents', where those turn."""
    start = np.array(r.mechanism.start)
    yield _Angles("", r.q, r.u, start)
    joints = [
        joint for joint in r.mechanism.tree_joints if not joint.holds_angle
    ]  # one for each angle
    columns = [r.mechanism.attitudes[joint.parent][0] for joint in joints]
    relative = np.eye(len(start))
    for i, column in enumerate(columns):
        if column is not None:
            relative[i, column] -= 1.0
    if any(column is not None for column in columns):
        yield _Angles(
            "relative to the parent", r.q @ relative.T, r.u @ relative.T, relative @ start
        )
