"""Mistakes of adapters in reading a right motion, as a table of names and transformations.

A mistake changes the arrays of some kinds of quantity (:func:`change`): it scales, mirrors, shifts,
rounds or exchanges them, or takes them from another time. Those with a size are made with size one
and fitted to a deviation. The others are not fitted, so that what they explain is evidence; of
those that not every joint, marker or coordinate need share, each subject has the value, right or
misread, that is nearer to the recorded one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np

from ...models.arrays import FloatArray
from ...models.elements import GROUND
from ...models.mechanism import Mechanism
from ...models.spec import Vector
from ...models.trajectory import PointMotion, Trajectory
from ...reference.equations import Equations
from ...reference.solution import MotionSamples, Solution
from ..runs.quantities import Kind
from .faults import mechanism_length, parallel_axis_term

NO_MOTION = "no motion: everything as at the start"

_DEGREES = 180 / math.pi
_UNIT = 1e-3  # of a factor that is taken for a sign or a unit
_NOTHING = 1e-6  # a factor that is taken for zero
_SAME_COURSE = 1e-6  # of a part: what is left of it beside the whole
_INSTANT = 1e-6  # of the compared time: a shift of size one
_LATEST = 0.2  # of the compared time: what is later by more is not the same motion at another time
_STEADY = 0.01  # of an angle's largest difference: one that varies by more is no other zero
_ROUNDING = 1e-9  # of values that are the same

_ALL = frozenset(Kind)
_POINTS = frozenset({Kind.POSITION, Kind.VELOCITY})
_FORCES = frozenset({Kind.TORQUE, Kind.FORCE})
_ENERGIES = frozenset({Kind.KINETIC_ENERGY, Kind.POTENTIAL_ENERGY})
_PLACES = frozenset({Kind.COORDINATES, Kind.POSITION, Kind.POTENTIAL_ENERGY})

Values = Mapping[str, FloatArray]
Transform = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class Reading:
    """The reference, read with a mistake."""

    name: str
    wrong: tuple[Trajectory, ...]
    """The mistake of size one; of several numbers, each of them. Linear, but for times."""
    text: Callable[[Sequence[float]], str] | None = None
    """The size, from the fitted factors; None: it has none."""
    at: Callable[[float], Trajectory | None] | None = None
    """The mistake of another size, where that is not linear; None where it makes no sense."""
    least: float = -math.inf
    """The smallest factor that makes sense."""


def change(
    r: Trajectory,
    kinds: Collection[Kind],
    to: Callable[[Kind, str, FloatArray], FloatArray],
    only: Collection[str] | None = None,
) -> Trajectory:
    """A trajectory with the arrays of some kinds of quantity changed.

    Args:
        r: the trajectory.
        kinds: torques are those of all stops, forces those of all joints.
        to: new values by kind, subject ('' of coordinates and energies) and old values.
        only: subjects that are changed; None: all.
    """

    def new(kind: Kind, values: FloatArray, subject: str = "") -> FloatArray:
        chosen = kind in kinds and (only is None or subject in only)
        return to(kind, subject, values) if chosen else values

    return replace(
        r,
        q=new(Kind.COORDINATES, r.q),
        u=new(Kind.SPEEDS, r.u),
        markers={
            n: PointMotion(new(Kind.POSITION, m.position, n), new(Kind.VELOCITY, m.velocity, n))
            for n, m in r.markers.items()
        },
        stop_torques={n: new(Kind.TORQUE, v, n) for n, v in r.stop_torques.items()},
        joint_reactions={n: new(Kind.FORCE, v, n) for n, v in r.joint_reactions.items()},
        kinetic_energy=new(Kind.KINETIC_ENERGY, r.kinetic_energy),
        potential_energy=new(Kind.POTENTIAL_ENERGY, r.potential_energy),
    )


def _values(r: Trajectory) -> dict[tuple[Kind, str], FloatArray]:
    """Arrays of a trajectory by kind and subject."""
    values: dict[tuple[Kind, str], FloatArray] = {}

    def keep(kind: Kind, subject: str, array: FloatArray) -> FloatArray:
        values[kind, subject] = array
        return array

    change(r, _ALL, keep)
    return values


def all_readings(
    solution: Solution, reference: Trajectory, recorded: Trajectory, step: float
) -> Iterator[Reading]:
    """Readings of the reference that are wrong in one way.

    Args:
        solution: the reference's.
        reference: at the recorded times.
        recorded: the engine's trajectory.
        step: the engine's [s].
    """
    yield from _scales(reference, step)
    for how, mirror in MIRRORS:
        for what, kinds in (("markers", _POINTS), ("velocities of the markers", {Kind.VELOCITY})):
            yield _unsized(f"{what} {how}", reference, kinds, mirror)
    yield from _points(reference)
    yield from _of_coordinates(reference)
    # The reference, rounded in those quantities that are rounded in the recorded trajectory.
    given = _values(recorded)
    for what, cut in _CUTS.items():

        def rounded(kind: Kind, subject: str, v: FloatArray, cut: Transform = cut) -> FloatArray:
            other = given.get((kind, subject))
            return cut(v) if other is not None and np.array_equal(cut(other), other) else v

        yield Reading(f"values in {what}", (change(reference, _ALL, rounded),))
    # Everything as at the start; forces stay, which may be those of a state at rest.
    start = _values(solution.trajectory(np.zeros(1)))

    def frozen(kind: Kind, subject: str, v: FloatArray) -> FloatArray:
        return np.broadcast_to(start[kind, subject], v.shape) if kind in _PLACES else 0.0 * v

    yield Reading(NO_MOTION, (change(reference, _ALL - _FORCES, frozen),))
    yield from _energies(reference)
    times = _Times(solution, reference, step)
    yield times.rate()
    alone = {f"{name} shifted in time": frozenset({kind}) for kind, name in _ALONE.items()}
    for name, kinds in (_LATE | alone).items():
        yield times.shifted(name, kinds)
    yield from _forces(reference, recorded)
    # Torques of stops, and forces of those on points, each under another one's name.
    stops = [stop.name for stop in reference.mechanism.stops if stop.closed]
    right = _common({n: reference.stop_torques[n] for n in stops}, recorded.stop_torques)
    yield from _renamed(reference, Kind.TORQUE, "torques", right, recorded.stop_torques)
    yield from _markers(reference, recorded)
    yield from _orders(reference, recorded)
    yield from _conventions(reference, recorded)


def _unsized(name: str, r: Trajectory, kinds: Collection[Kind], to: Transform) -> Reading:
    return Reading(name, (change(r, kinds, lambda _, __, v: to(v)),))


# ------------------------------------------------------------------------------------------ scales

_SCALES: tuple[tuple[str, str, int, frozenset[Kind]], ...] = (
    ("the {}'s {effort}", "all stop torques", 2, frozenset({Kind.TORQUE})),
    ("the {}'s force", "all joint forces", 0, frozenset({Kind.FORCE})),
    ("the {}", "the markers", 2, _POINTS),
    ("the position of {}", "the position of markers", 2, frozenset({Kind.POSITION})),
    ("the velocity of {}", "the velocity of markers", 2, frozenset({Kind.VELOCITY})),
    ("", "the coordinates", 0, frozenset({Kind.COORDINATES})),
    ("", "the coordinates' speeds", 0, frozenset({Kind.SPEEDS})),
    ("", "the coordinates and their speeds", 0, frozenset({Kind.COORDINATES, Kind.SPEEDS})),
    ("", "all speeds", 0, frozenset({Kind.SPEEDS, Kind.VELOCITY})),
    ("", "the kinetic energy", 0, frozenset({Kind.KINETIC_ENERGY})),
    ("", "the potential energy", 0, frozenset({Kind.POTENTIAL_ENERGY})),
    ("", "all masses, forces and energies", 0, _FORCES | _ENERGIES),
    ("", "both energies", 0, _ENERGIES),
)
"""Name of one subject's scale, name of that of all, how many there must be for it, and kinds."""


def _scales(r: Trajectory, step: float) -> Iterator[Reading]:
    """Kinds of quantity, of one subject or of all, times a number."""
    subjects = {Kind.TORQUE: r.stop_torques, Kind.FORCE: r.joint_reactions}
    for one, every, at_least, kinds in _SCALES:
        impulse = step if kinds <= _FORCES else math.nan  # a force times the step is an impulse
        # A mass that is negative makes no sense.
        least = _NOTHING - 1.0 if kinds == _FORCES | _ENERGIES else -math.inf
        names = list(subjects.get(next(iter(kinds)), r.markers)) if one or at_least else []
        chosen: list[tuple[str, list[str] | None]] = []
        for name in names if one else ():
            if Kind.TORQUE not in kinds:
                chosen.append((one.format(name), [name]))
            elif r.stop_torques[name].any():
                effort = r.mechanism.stop(name).effort
                chosen.append((one.format(name, effort=effort), [name]))
        if len(names) >= at_least:
            chosen.append((every, None))
        for what, only in chosen:
            wrong = change(r, kinds, lambda _, __, v: 2 * v, only)
            yield Reading(
                f"scale of {what}",
                (wrong,),
                lambda f, impulse=impulse: scale_text(f[0], impulse),
                least=least,
            )


def scale_text(factor: float, step: float = math.nan) -> str:
    """The mistake that adds `factor` times the right value; a sign or a unit where it is one.

    Args:
        factor: of the right value, added to it.
        step: the engine's [s], of a force; else not a number.
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
        if abs(value - number) < _UNIT * abs(number):
            return text
    return "always zero" if abs(value) < _NOTHING else f"times {value:.6g}"


# --------------------------------------------------------------- axes, points, coordinates, digits

MIRRORS: tuple[tuple[str, Transform], ...] = (
    ("mirrored, x", lambda v: v * [-1, 1]),
    ("mirrored, y", lambda v: v * [1, -1]),
    ("x and y exchanged", lambda v: v[:, ::-1]),
)
"""Components of vectors with the wrong sign, or exchanged."""

_WRAPS: dict[str, Transform] = {
    "half a turn": lambda q: np.angle(np.exp(1j * q)),
    "a turn": lambda q: q % (2 * math.pi),
}


def _six_digits(values: FloatArray) -> FloatArray:
    unit = 10.0 ** (np.floor(np.log10(np.maximum(np.abs(values), 1e-300))) - 5)
    return np.round(values / unit) * unit


_CUTS: dict[str, Transform] = {
    "single precision": lambda v: v.astype(np.float32).astype(np.float64),
    "six digits": _six_digits,
}


def _points(r: Trajectory) -> Iterator[Reading]:
    """Positions from another origin, and markers at a point that is a little off on the body."""
    length = mechanism_length(r.mechanism)

    def text(f: Sequence[float]) -> str:
        return f"x {f[0] * length:+.3g} m, y {f[1] * length:+.3g} m"

    origins = {"the positions": list(r.markers)}
    if len(r.markers) > 1:
        origins |= {f"the {name}'s position": [name] for name in r.markers}
    for what, names in origins.items():
        wrong = tuple(
            change(r, {Kind.POSITION}, lambda _, __, v, s=shift: v + length * np.array(s), names)
            for shift in ((1, 0), (0, 1))
        )
        yield Reading(f"origin of {what}", wrong, text)
    for marker in r.mechanism.markers:
        if marker.name in r.markers and marker.body != GROUND:
            x, y = marker.point
            moved = [_at(r, marker.body, point) for point in ((x + length, y), (x, y + length))]
            wrong = tuple(_with(r, {marker.name: motion}) for motion in moved)
            yield Reading(f"point of the {marker.name} on the {marker.body}", wrong, text)


def _at(r: Trajectory, body: str, point: Vector) -> PointMotion:
    """Motion of a point of a body."""
    row = r.kinematics.point(body, point)
    return PointMotion(r.kinematics.position(row, r.q), r.kinematics.velocity(row, r.q, r.u))


def _with(r: Trajectory, changed: Mapping[str, PointMotion]) -> Trajectory:
    """The trajectory with other motions of some markers."""
    return replace(r, markers={**r.markers, **changed})


def _of_coordinates(r: Trajectory) -> Iterator[Reading]:
    """Single signs of coordinates and speeds, and angles that are wrapped."""
    both = {Kind.COORDINATES, Kind.SPEEDS}
    for i, name in enumerate(r.mechanism.coordinates):
        sign = np.ones(r.q.shape[1])
        sign[i] = -1.0
        for what, kinds in (
            (f"{name} and its speed", both),
            (name, {Kind.COORDINATES}),
            (f"the speed of {name}", {Kind.SPEEDS}),
        ):
            yield _unsized(f"sign of {what}", r, kinds, lambda v, sign=sign: sign * v)
    is_angle = np.arange(r.q.shape[1]) < len(r.mechanism.angles)
    for what, wrap in _WRAPS.items():
        q = np.where(is_angle, wrap(r.q), r.q)
        yield Reading(f"angles wrapped to {what}", (replace(r, q=q),))


# ---------------------------------------------------------------------------------------- energies


def _energies(r: Trajectory) -> Iterator[Reading]:
    """Energies from another zero, as the other kind, or in part."""
    kinetic, potential, m = r.kinetic_energy, r.potential_energy, r.mechanism
    unit = float(np.abs(kinetic).max()) or 1.0
    raised = replace(r, potential_energy=potential + unit)
    yield Reading("zero of the potential energy", (raised,), lambda f: f"{f[0] * unit:+.4g} J")
    moved = replace(r, kinetic_energy=2 * kinetic, potential_energy=potential - kinetic)
    yield Reading(
        "kinetic energy counted as potential", (moved,), lambda f: f"{-100 * f[0]:+.3g} %"
    )
    for how, energy in _kinetic_mistakes(r).items():
        if _is_part(energy, kinetic):
            yield Reading(f"kinetic energy {how}", (replace(r, kinetic_energy=energy),))
    # Energies of single weights, of single springs, and of all springs.
    others: list[tuple[str, Mechanism]] = []
    for body in m.bodies if m.gravity else ():
        bodies = [b.model_copy(update={"mass": 0.0}) if b == body else b for b in m.bodies]
        weightless = m.model_copy(update={"bodies": tuple(bodies)})
        others.append((f"weight of the {body.name}", weightless))
    for element in m.force_elements:
        left = tuple(each for each in m.force_elements if each != element)
        others.append((element.name, m.model_copy(update={"force_elements": left})))
    if m.force_elements:
        others.append(("springs", m.model_copy(update={"force_elements": ()})))
    for name, other in others:
        part = potential - Equations(other).potential_energy(r.q)
        if part.any() and _is_part(part, potential):
            wrong = replace(r, potential_energy=potential + part)
            yield Reading(f"{name} in the potential energy", (wrong,), lambda f: scale_text(f[0]))
    bodies = [body.model_copy(update={"centre": (0.0, 0.0)}) for body in m.bodies]
    at_origins = Equations(m.model_copy(update={"bodies": tuple(bodies)})).potential_energy(r.q)
    if (at_origins != potential).any():
        wrong = replace(r, potential_energy=at_origins)
        yield Reading("potential energy of the bodies' origins", (wrong,))


def _is_part(part: FloatArray, whole: FloatArray) -> bool:
    """Tell whether it has another course than the whole: else its scale is that of the whole."""
    left = part - whole * float(part @ whole) / (float(whole @ whole) or 1.0)
    return bool(np.linalg.norm(left) > _SAME_COURSE * np.linalg.norm(part))


def _kinetic_mistakes(r: Trajectory) -> dict[str, FloatArray]:
    """Kinetic energies without a body, of it alone, without rotation, or about the joint."""
    bodies, every, zero = r.mechanism.bodies, r.kinetic_energy, np.zeros_like(r.t)
    spin = {b.name: (r.u @ r.kinematics.angle(b.name).coefficients) ** 2 for b in bodies}
    turning = {b.name: 0.5 * b.inertia * spin[b.name] for b in bodies if b.inertia}
    wrong: dict[str, FloatArray] = {}
    for body in bodies if len(bodies) > 1 else ():
        square = (_at(r, body.name, body.centre).velocity ** 2).sum(axis=1)
        part = 0.5 * body.mass * square + turning.get(body.name, zero)
        wrong |= {f"without the {body.name}": every - part, f"of the {body.name} alone": part}
    wrong |= {f"without the rotation of the {name}": every - v for name, v in turning.items()}
    if len(turning) > 1:
        wrong["without the rotation of the bodies"] = every - sum(turning.values(), zero)
    parallel = [0.5 * parallel_axis_term(r.mechanism, b) * spin[b.name] for b in bodies]
    wrong["with inertias about the joints"] = every + sum(parallel, zero)
    return wrong


# ------------------------------------------------------------------------------------- other times

_ALONE = {
    Kind.COORDINATES: "coordinates",
    Kind.SPEEDS: "speeds of the coordinates",
    Kind.POSITION: "positions of the markers",
    Kind.VELOCITY: "velocities of the markers",
    Kind.TORQUE: "torques",
    Kind.FORCE: "forces",
    Kind.KINETIC_ENERGY: "kinetic energy",
    Kind.POTENTIAL_ENERGY: "potential energy",
}
_LATE: dict[str, frozenset[Kind]] = {
    "time shifted": _ALL,
    "motion shifted in time, and no force": _ALL - _FORCES,
    "velocities shifted in time": frozenset({Kind.SPEEDS, Kind.VELOCITY}),
    "positions shifted in time": frozenset({Kind.COORDINATES, Kind.POSITION}),
    "markers shifted in time": _POINTS,
}
"""Kinds of quantity that are read at another time together; and each alone."""


@dataclass(frozen=True)
class _Times:
    """The reference sampled at other times, but labelled with its own."""

    solution: Solution
    reference: Trajectory
    step: float

    @cached_property
    def _motion(self) -> MotionSamples:
        """The reference's, at its own times."""
        return self.solution.motion(self.reference.t)

    @property
    def _instant(self) -> float:
        """A shift of size one [s]."""
        return _INSTANT * float(self.reference.t[-1])

    @cached_property
    def _later(self) -> Trajectory:
        """The motion later by one instant."""
        return self._read(self.reference.t + self._instant, _ALL)

    def _read(self, times: FloatArray, kinds: Collection[Kind]) -> Trajectory:
        """The reference's values at other times; forces, which cost most, only if asked for."""
        solution, t = self.solution, np.clip(times, 0.0, self.solution.segments[-1].end)
        if not _FORCES.isdisjoint(kinds):
            return replace(solution.trajectory(t), t=self.reference.t)
        q, u = np.empty_like(self._motion.q), np.empty_like(self._motion.u)
        ends = [segment.end for segment in solution.segments[:-1]]
        of = np.searchsorted(ends, t, side="right")
        for k, segment in enumerate(solution.segments):
            if (of == k).any():
                q[of == k], u[of == k] = np.split(segment.interpolant(t[of == k]).T, 2, axis=1)
        return solution.reading(self.reference.t, replace(self._motion, q=q, u=u))

    def rate(self) -> Reading:
        """Times that run at another rate."""
        t = self.reference.t

        def at(factor: float) -> Trajectory | None:
            late = abs(factor) * _INSTANT
            return self._read(t * (1 + factor * _INSTANT), _ALL) if late < _LATEST else None

        def text(f: Sequence[float]) -> str:
            return f"times {1 / (1 + f[0] * _INSTANT):.6g}"

        return Reading("rate of time", (self._read(t * (1 + _INSTANT), _ALL),), text, at)

    def shifted(
        self,
        name: str,
        kinds: Collection[Kind],
        taken: Callable[[Trajectory], Trajectory] | None = None,
    ) -> Reading:
        """A reading of which some kinds of quantity are those of a later time.

        Args:
            name: of the reading.
            kinds: that are taken from the later motion.
            taken: the reading, by a later motion; None: the reference with those kinds from it.
        """
        t, instant = self.reference.t, self._instant

        def with_kinds(later: Trajectory) -> Trajectory:
            values = _values(later)
            return change(self.reference, kinds, lambda kind, subject, _: values[kind, subject])

        wrong = taken or with_kinds

        def at(factor: float) -> Trajectory | None:
            late = abs(factor) * _INSTANT
            return wrong(self._read(t + factor * instant, kinds)) if late < _LATEST else None

        def text(f: Sequence[float]) -> str:
            return f"{f[0] * instant:+.3g} s, {f[0] * instant / self.step:+.3g} steps"

        return Reading(name, (wrong(self._later),), text, at)


def partly_late_readings(
    solution: Solution, r: Trajectory, step: float, wrong: Collection[Kind]
) -> Iterator[Reading]:
    """Read the kinds of quantity that deviate at one other time, and no others.

    Args:
        solution: the reference's.
        r: its trajectory at the recorded times.
        step: the engine's [s].
        wrong: kinds of the quantities that deviate.
    """
    times, kinds = _Times(solution, r, step), set(wrong)
    if Kind.FORCE in kinds:
        kinds.add(Kind.TORQUE)  # a stop on a point pushes with a force
    if len(kinds) > 1 and kinds not in _LATE.values():
        names = ", ".join(_ALONE[kind] for kind in Kind if kind in kinds)
        yield times.shifted(f"{names} shifted in time", kinds)
    if {Kind.SPEEDS, Kind.KINETIC_ENERGY} <= kinds and Kind.COORDINATES not in kinds:

        def fast(later: Trajectory) -> Trajectory:
            # What an engine shows whose speeds are those of another time than its coordinates.
            mixed = solution.reading(r.t, solution.motion_of(r.t, r.q, later.u))
            right = _values(r)
            return change(mixed, _FORCES, lambda kind, subject, _: right[kind, subject])

        yield times.shifted("speeds, and the energy of them, shifted in time", {Kind.SPEEDS}, fast)


# ------------------------------------------------------------ other names, frames, points and zeros


def _distance(one: FloatArray, other: FloatArray) -> float:
    distance = float(np.linalg.norm(one - other))
    return distance if math.isfinite(distance) else math.inf


def _common(right: Values, given: Values) -> dict[str, FloatArray]:
    return {name: v for name, v in right.items() if name in given and given[name].shape == v.shape}


def _nearer(given: Values, right: Values, wrong: Values) -> tuple[list[str], str]:
    """Subjects of which the wrong values are nearer to the recorded ones than the right ones.

    And their names in words, unless they are all that the mistake changes.
    """
    nearer: list[str] = []
    for name, v in right.items():
        if _distance(given[name], wrong[name]) < _distance(given[name], v):
            nearer.append(name)
    changed = [name for name, values in right.items() if _distance(values, wrong[name]) > 0]
    return nearer, "" if len(nearer) == len(changed) else f" of the {', '.join(nearer)}"


def _exchange(of: str, right: Values, given: Values) -> tuple[str, dict[str, str]] | None:
    """A sentence and whose value each subject has, where it is another one's."""
    nearest = {
        name: min(right, key=lambda m: (_distance(given[name], right[m]), m != name))
        for name in right
    }
    wrong = {name: other for name, other in nearest.items() if name != other}
    if not wrong:
        return None
    if len(wrong) == 2 and all(wrong.get(other) == name for name, other in wrong.items()):
        return f"{of}{' and '.join(wrong)} exchanged", nearest
    return f"{of}{', '.join(wrong)} are those of {', '.join(wrong.values())}", nearest


def _renamed(
    r: Trajectory, kind: Kind, what: str, right: Values, given: Values
) -> Iterator[Reading]:
    """Values of a kind, each under another subject's name."""
    exchanged = _exchange(f"{what} of the ", right, given)
    if exchanged is not None:
        name, nearest = exchanged
        wrong = change(r, {kind}, lambda _, subject, __: right[nearest[subject]], only=right)
        yield Reading(name, (wrong,))


_WRONG_SIGN = "wrong sign"


def _forces(r: Trajectory, given: Trajectory) -> Iterator[Reading]:
    """Forces under other joints' names, mirrored, in a body's frame, or without a weight."""
    right = _common(r.joint_reactions, given.joint_reactions)
    yield from _renamed(r, Kind.FORCE, "joint forces", right, given.joint_reactions)
    ends = {joint.name: (joint.child, joint.parent) for joint in r.mechanism.joints}
    gravity = np.array(r.mechanism.gravity_vector)
    mistakes: dict[str, Callable[[str, FloatArray], FloatArray]] = {}
    for how, mirror in MIRRORS:
        mistakes[how] = lambda _, v, mirror=mirror: mirror(v)
    mistakes[_WRONG_SIGN] = lambda _, v: -v
    for sign, other in ((1, ""), (-1, ", wrong sign")):
        for end, whose in enumerate(("the body", "the parent")):
            mistakes[f"in the frame of {whose}{other}"] = lambda name, v, sign=sign, end=end: (
                sign * _in_frame(r, ends[name][end], v)
            )
    mistakes["without the weight of the body"] = lambda name, v: (
        v + r.mechanism.body(ends[name][0]).mass * gravity
    )
    for how, mistake in mistakes.items():
        wrong = {name: mistake(name, values) for name, values in right.items()}
        names, subjects = _nearer(given.joint_reactions, right, wrong)
        # The wrong sign of one force, or of all, is a scale.
        if names and not (how == _WRONG_SIGN and len(names) in (1, len(right))):
            forces = {**r.joint_reactions, **{name: wrong[name] for name in names}}
            yield Reading(f"joint forces{subjects} {how}", (replace(r, joint_reactions=forces),))


def _in_frame(r: Trajectory, body: str, vectors: FloatArray) -> FloatArray:
    """Vectors of the world by their components in a body's frame."""
    angle = r.kinematics.angle(body).value(r.q)
    z = (vectors[:, 0] + 1j * vectors[:, 1]) * np.exp(1j * angle)
    return np.stack([z.real, z.imag], axis=1)


def _markers(r: Trajectory, given: Trajectory) -> Iterator[Reading]:
    """Markers under other names, taken for other points, or with velocities in a body's frame."""
    names = [name for name in r.markers if name in given.markers]
    right = {n: _stacked(r.markers[n]) for n in names}
    exchanged = _exchange("", right, {n: _stacked(given.markers[n]) for n in names})
    nearest = dict.fromkeys(names, "")
    if exchanged is not None:
        nearest = exchanged[1]
        yield Reading(exchanged[0], (_with(r, {n: r.markers[m] for n, m in nearest.items()}),))
    texts: list[str] = []
    taken: dict[str, PointMotion] = {}
    same: list[bool] = []
    for name in names:
        position, velocity, motion = _nearest_points(r, name, given.markers[name])
        taken[name] = motion
        if position == velocity:
            texts += [f"{name} taken for {position}"] if position else []
        else:
            for what, other in (("position", position), ("velocity", velocity)):
                texts += [f"{what} of the {name} taken for that of {other}"] if other else []
        mistaken, stacked = r.markers.get(nearest[name]), _stacked(motion)
        size = _ROUNDING * float(np.abs(stacked).max())
        same.append(mistaken is not None and _distance(stacked, _stacked(mistaken)) < size)
    if texts and not all(same):  # else they are exchanged
        yield Reading("; ".join(texts), (_with(r, taken),))
    bodies = {marker.name: marker.body for marker in r.mechanism.markers}
    velocities = {n: r.markers[n].velocity for n in names}
    local = {n: _in_frame(r, bodies[n], v) for n, v in velocities.items()}
    turned, subjects = _nearer({n: given.markers[n].velocity for n in names}, velocities, local)
    if turned:
        wrong = _with(r, {n: replace(r.markers[n], velocity=local[n]) for n in turned})
        of = subjects or " of the markers"
        yield Reading(f"velocities{of} in the frame of the body", (wrong,))


def _stacked(motion: PointMotion) -> FloatArray:
    return np.concatenate([motion.position, motion.velocity], axis=1)


def _nearest_points(r: Trajectory, name: str, given: PointMotion) -> tuple[str, str, PointMotion]:
    """The known points that a marker's position and its velocity are nearest to, and their motion.

    The name of its own point is ''.
    """
    marker = r.mechanism.marker(name)
    assert marker is not None
    points = {"": r.markers[name]}
    for at, what in _known_points(r.mechanism).items():
        if at != (marker.body, marker.point):
            points[what] = _at(r, *at)
    position = min(points, key=lambda what: _distance(given.position, points[what].position))
    speeds = {what: _distance(given.velocity, point.velocity) for what, point in points.items()}
    velocity = min(speeds, key=speeds.__getitem__)
    if speeds[position] == speeds[velocity]:
        velocity = position  # on a body that does not turn the velocity tells no point
    return (
        position,
        velocity,
        PointMotion(points[position].position, points[velocity].velocity),
    )


def _known_points(m: Mechanism) -> dict[tuple[str, Vector], str]:
    """Points of the bodies that something is at; the first name of a point counts."""
    points: dict[tuple[str, Vector], str] = {}
    for body in m.bodies:
        points.setdefault((body.name, body.centre), f"the {body.name}'s centre of mass")
    for joint in m.joints:
        points.setdefault((joint.child, joint.child_point), f"the {joint.name}")
        if joint.parent != GROUND:
            points.setdefault((joint.parent, joint.parent_point), f"the {joint.name}")
    for body in m.bodies:
        points.setdefault((body.name, (0.0, 0.0)), f"the {body.name}'s origin")
    return points


def _orders(r: Trajectory, given: Trajectory) -> Iterator[Reading]:
    """Coordinates, or their speeds, in another order."""
    names = r.mechanism.coordinates
    texts: list[str] = []
    wrong: list[FloatArray] = []
    kinds = ("coordinates ", r.q, given.q), ("speeds of the coordinates ", r.u, given.u)
    for of, right, recorded in kinds:
        columns = dict(zip(names, right.T, strict=True))
        exchanged = _exchange(of, columns, dict(zip(names, recorded.T, strict=False)))
        order = list(names)
        if exchanged is not None:
            order = list(exchanged[1].values())
            texts.append(exchanged[0])
        wrong.append(np.stack([columns[name] for name in order], axis=1))
    if texts:
        yield Reading(texts[0], (replace(r, q=wrong[0], u=wrong[1]),))


def _conventions(r: Trajectory, given: Trajectory) -> Iterator[Reading]:
    """Angles relative to the parents', anticlockwise, in degrees, from another zero."""
    start, is_angle = np.array(r.mechanism.start), np.arange(r.q.shape[1]) < len(r.mechanism.angles)
    # Angles as they are, and relative to the parents', where those turn.
    frames = [("", r.q, r.u, start)]
    joints = [joint for joint in r.mechanism.tree_joints if not joint.holds_angle]  # one an angle
    columns = [r.mechanism.attitudes[joint.parent][0] for joint in joints]
    relative = np.eye(len(start))
    for i, column in enumerate(columns):
        if column is not None:
            relative[i, column] -= 1.0
    if any(column is not None for column in columns):
        q, u = r.q @ relative.T, r.u @ relative.T
        frames.append(("relative to the parent", q, u, relative @ start))
    signs, units = ((1, ""), (-1, "anticlockwise")), ((1, ""), (_DEGREES, "degrees"))
    for (frame, q, u, first), (sign, turned), (factor, unit) in product(frames, signs, units):
        # In other units alone, and of angles alone, it is a scale of all coordinates.
        if not frame and (turned or unit) and is_angle.all():
            continue
        size = np.where(is_angle, sign * factor, 1.0)
        how = ", ".join(filter(None, (frame, turned, unit)))
        yield from _by(r, given, how, (q * size, u * size, first * size))


def _by(
    r: Trajectory, given: Trajectory, how: str, wrong: tuple[FloatArray, FloatArray, FloatArray]
) -> Iterator[Reading]:
    """Coordinates and speeds, or the one that is nearer so, by a convention and its zeros.

    Args:
        r: the reference.
        given: the recorded trajectory.
        how: name of the convention; '' for that of the reference.
        wrong: coordinates, speeds and start by the convention.
    """
    q, u, start = wrong
    # The constant that each coordinate differs by; 0 where it varies beside what it moves by.
    difference = given.q - q
    middle = np.median(difference, axis=0)
    spread, size = np.abs(difference - middle).max(axis=0), np.abs(middle)
    allowed = _ROUNDING * size + _STEADY * np.minimum(size, np.ptp(q, axis=0))
    zeros = np.where((spread <= allowed) & np.isfinite(spread), middle, 0.0)
    misread = _distance(given.q, q + zeros) < _distance(given.q, r.q)
    fast = _distance(given.u, u) < _distance(given.u, r.u)
    if not (misread or fast):
        return
    from_zero = "relative to the start"
    if not np.allclose(zeros, -start, rtol=_STEADY, atol=_STEADY * float(np.abs(zeros).max())):
        angle = "deg" if how.endswith("degrees") else "rad"
        shown: list[str] = []
        for i, (name, zero) in enumerate(zip(r.mechanism.coordinates, zeros, strict=True)):
            if zero:
                shown.append(f"{name} {zero:+.4g} {angle if i < len(r.mechanism.angles) else 'm'}")
        from_zero = f"from another zero ({', '.join(shown)})"
    what = f"coordinates {from_zero}"
    if how:
        which = "angles" if fast else "angles, not their speeds,"
        which = which if misread else "speeds of the angles"
        what = " ".join(filter(None, (which, how, from_zero if misread and zeros.any() else "")))
    taken = replace(r, q=q + zeros if misread else r.q, u=u if fast else r.u)
    yield Reading(what, (taken,))
