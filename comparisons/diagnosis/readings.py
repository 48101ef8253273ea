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
from itertools import product

import numpy as np

from ...models.arrays import FloatArray
from ...models.elements import GROUND
from ...models.mechanism import Body, Mechanism
from ...models.spec import Vector
from ...models.trajectory import PointMotion, Trajectory
from ...reference.equations import Equations
from ...reference.solution import Solution
from ..runs.quantities import Kind
from .faults import mechanism_length

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
    """All arrays of a trajectory by kind and subject."""
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
    yield from _rounded(reference, recorded)
    yield _frozen(solution, reference)
    yield from _energies(reference)
    yield from _late(solution, reference, step)
    yield from _forces(reference, recorded)
    yield from _torques(reference, recorded)
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
    """Some kinds of quantity, of one subject or of all, times a number."""
    subjects = {Kind.TORQUE: r.stop_torques, Kind.FORCE: r.joint_reactions}
    for one, every, at_least, kinds in _SCALES:
        names = list(subjects.get(next(iter(kinds)), r.markers)) if one or at_least else []
        for name in names if one else ():
            if Kind.TORQUE not in kinds:
                yield _scale(one.format(name), r, kinds, step, [name])
            elif r.stop_torques[name].any():
                what = one.format(name, effort=r.mechanism.stop(name).effort)
                yield _scale(what, r, kinds, step, [name])
        if len(names) >= at_least:
            yield _scale(every, r, kinds, step)


def _scale(
    what: str,
    r: Trajectory,
    kinds: frozenset[Kind],
    step: float,
    only: Collection[str] | None = None,
) -> Reading:
    impulse = step if kinds <= _FORCES else math.nan  # a force times the step is an impulse
    # A mass that is negative makes no sense.
    least = _NOTHING - 1.0 if kinds == _FORCES | _ENERGIES else -math.inf
    wrong = change(r, kinds, lambda _, __, v: 2 * v, only)
    return Reading(f"scale of {what}", (wrong,), lambda f: scale_text(f[0], impulse), least=least)


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


# ------------------------------------------------------------------------ axes, points, coordinates

MIRRORS: tuple[tuple[str, Transform], ...] = (
    ("mirrored, x", lambda v: v * [-1, 1]),
    ("mirrored, y", lambda v: v * [1, -1]),
    ("x and y exchanged", lambda v: v[:, ::-1]),
)
"""Components of vectors with the wrong sign, or exchanged."""


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
    wraps: tuple[tuple[str, Transform], ...] = (
        ("half a turn", lambda q: np.angle(np.exp(1j * q))),
        ("a turn", lambda q: q % (2 * math.pi)),
    )
    for what, wrap in wraps:
        q = np.where(is_angle, wrap(r.q), r.q)
        yield Reading(f"angles wrapped to {what}", (replace(r, q=q),))


# ------------------------------------------------------------------------- precision, and no motion


def _rounded(r: Trajectory, recorded: Trajectory) -> Iterator[Reading]:
    """The reference, rounded in those quantities that are rounded in the recorded trajectory."""
    given = _values(recorded)
    cuts: tuple[tuple[str, Transform], ...] = (
        ("single precision", _single),
        ("six digits", _six_digits),
    )
    for what, cut in cuts:

        def like(kind: Kind, subject: str, v: FloatArray, cut: Transform = cut) -> FloatArray:
            other = given.get((kind, subject))
            return cut(v) if other is not None and np.array_equal(cut(other), other) else v

        yield Reading(f"values in {what}", (change(r, _ALL, like),))


def _single(values: FloatArray) -> FloatArray:
    return values.astype(np.float32).astype(np.float64)


def _six_digits(values: FloatArray) -> FloatArray:
    unit = 10.0 ** (np.floor(np.log10(np.maximum(np.abs(values), 1e-300))) - 5)
    return np.round(values / unit) * unit


def _frozen(solution: Solution, r: Trajectory) -> Reading:
    """Everything as at the start; forces stay, which may be those of a state at rest."""
    start = _values(solution.trajectory(np.zeros(1)))

    def frozen(kind: Kind, subject: str, v: FloatArray) -> FloatArray:
        return np.broadcast_to(start[kind, subject], v.shape) if kind in _PLACES else 0.0 * v

    return Reading(NO_MOTION, (change(r, _ALL - _FORCES, frozen),))


# ---------------------------------------------------------------------------------------- energies


def _energies(r: Trajectory) -> Iterator[Reading]:
    """Energies from another zero, as the other kind, or in part."""
    kinetic, potential = r.kinetic_energy, r.potential_energy
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
    for name, part in _potential_parts(r):
        if part.any() and _is_part(part, potential):
            wrong = replace(r, potential_energy=potential + part)
            yield Reading(f"{name} in the potential energy", (wrong,), lambda f: scale_text(f[0]))
    origins = Equations(_changed_bodies(r.mechanism, centre=(0.0, 0.0))).potential_energy(r.q)
    if (origins != potential).any():
        wrong = replace(r, potential_energy=origins)
        yield Reading("potential energy of the bodies' origins", (wrong,))


def _is_part(part: FloatArray, whole: FloatArray) -> bool:
    """Whether it has another course than the whole: else its scale is that of the whole."""
    left = part - whole * float(part @ whole) / (float(whole @ whole) or 1.0)
    return bool(np.linalg.norm(left) > _SAME_COURSE * np.linalg.norm(part))


def _kinetic_mistakes(r: Trajectory) -> dict[str, FloatArray]:
    """Without a body, of it alone, without rotation, or with its inertia about the joint."""
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
    parallel = [0.5 * _parallel(r.mechanism, b) * spin[b.name] for b in bodies]
    wrong["with inertias about the joints"] = every + sum(parallel, zero)
    return wrong


def _parallel(m: Mechanism, body: Body) -> float:
    """Inertia about the joint less that about the centre of mass [kg m^2]."""
    arm = np.subtract(body.centre, m.joint_of(body.name).child_point)
    return body.mass * float(arm @ arm)


def _potential_parts(r: Trajectory) -> Iterator[tuple[str, FloatArray]]:
    """Energies of single weights, of single springs, and of all springs; each of shape (n,)."""
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
    """The mechanism with other fields of a body, or of all."""
    bodies = [b.model_copy(update=fields) if only in ("", b.name) else b for b in m.bodies]
    return m.model_copy(update={"bodies": tuple(bodies)})


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

    def read(self, times: FloatArray) -> Trajectory:
        """The reference's values at other times."""
        end = self.solution.segments[-1].end
        return replace(self.solution.trajectory(np.clip(times, 0.0, end)), t=self.reference.t)

    def shifted(
        self, name: str, later: Trajectory, taken: Callable[[Trajectory], Trajectory]
    ) -> Reading:
        """A reading of which some quantities are taken from a later motion.

        Args:
            later: the motion later by one instant.
            taken: the reading, from a later motion.
        """
        t, instant = self.reference.t, self.instant

        def at(factor: float) -> Trajectory | None:
            late = abs(factor) * _INSTANT
            return taken(self.read(t + factor * instant)) if late < _LATEST else None

        def text(f: Sequence[float]) -> str:
            return f"{f[0] * instant:+.3g} s, {f[0] * instant / self.step:+.3g} steps"

        return Reading(name, (taken(later),), text, at)

    @property
    def instant(self) -> float:
        """A shift of size one [s]."""
        return _INSTANT * float(self.reference.t[-1])

    def later(self) -> Trajectory:
        """The motion later by one instant."""
        return self.read(self.reference.t + self.instant)

    def rated(self) -> Reading:
        """Times that run at another rate."""
        t = self.reference.t

        def at(factor: float) -> Trajectory | None:
            late = abs(factor) * _INSTANT
            return self.read(t * (1 + factor * _INSTANT)) if late < _LATEST else None

        def text(f: Sequence[float]) -> str:
            return f"times {1 / (1 + f[0] * _INSTANT):.6g}"

        return Reading("rate of time", (self.read(t * (1 + _INSTANT)),), text, at)


def _take(r: Trajectory, later: Trajectory, kinds: Collection[Kind]) -> Trajectory:
    """The reference with some kinds of quantity from a later motion."""
    values = _values(later)
    return change(r, kinds, lambda kind, subject, _: values[kind, subject])


def _late(solution: Solution, r: Trajectory, step: float) -> Iterator[Reading]:
    """Times at another rate; everything, or some kinds of quantity, read at another time."""
    times = _Times(solution, r, step)
    yield times.rated()
    later = times.later()
    alone = {f"{name} shifted in time": frozenset({kind}) for kind, name in _ALONE.items()}
    for name, kinds in (_LATE | alone).items():
        yield times.shifted(name, later, lambda x, kinds=kinds: _take(r, x, kinds))


def partly_late_readings(
    solution: Solution, r: Trajectory, step: float, wrong: Collection[Kind]
) -> Iterator[Reading]:
    """All those kinds of quantity read at one other time that deviate, and no others.

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
        name = ", ".join(_ALONE[kind] for kind in Kind if kind in kinds)
        yield times.shifted(f"{name} shifted in time", times.later(), lambda x: _take(r, x, kinds))
    if {Kind.SPEEDS, Kind.KINETIC_ENERGY} <= kinds and Kind.COORDINATES not in kinds:

        def fast(x: Trajectory) -> Trajectory:
            # What an engine shows whose speeds are those of another time than its coordinates.
            mixed = solution.reading(r.t, solution.motion_of(r.t, r.q, x.u))
            return _take(mixed, r, _FORCES)

        yield times.shifted("speeds, and the energy of them, shifted in time", times.later(), fast)


# ------------------------------------------------------------ other names, frames, points and zeros


def _apart(one: FloatArray, other: FloatArray) -> float:
    distance = float(np.linalg.norm(one - other))
    return distance if math.isfinite(distance) else math.inf


def _common(right: Values, given: Values) -> dict[str, FloatArray]:
    return {name: v for name, v in right.items() if name in given and given[name].shape == v.shape}


def _nearer(given: Values, right: Values, wrong: Values) -> list[str]:
    """Subjects of which the wrong values are nearer to the recorded ones than the right ones."""
    return [
        name
        for name, v in right.items()
        if _apart(given[name], wrong[name]) < _apart(given[name], v)
    ]


def _subjects(names: Sequence[str], right: Values, wrong: Values) -> str:
    """The subjects in words, unless they are all that the mistake changes."""
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
    """Forces under other joints' names, mirrored, in a body's frame, or without a weight."""
    right = _common(r.joint_reactions, given.joint_reactions)
    exchanged = _exchange("joint forces of the ", right, given.joint_reactions)
    if exchanged is not None:
        forces = {name: right[other] for name, other in exchanged[1].items()}
        yield Reading(exchanged[0], (replace(r, joint_reactions={**r.joint_reactions, **forces}),))
    for how, mistake in _force_mistakes(r):
        wrong = {name: mistake(name, values) for name, values in right.items()}
        names = _nearer(given.joint_reactions, right, wrong)
        # The wrong sign of one force, or of all, is a scale.
        if names and not (how == _WRONG_SIGN and len(names) in (1, len(right))):
            forces = {**r.joint_reactions, **{name: wrong[name] for name in names}}
            what = f"joint forces{_subjects(names, right, wrong)} {how}"
            yield Reading(what, (replace(r, joint_reactions=forces),))


_WRONG_SIGN = "wrong sign"


def _force_mistakes(r: Trajectory) -> Iterator[tuple[str, Callable[[str, FloatArray], FloatArray]]]:
    for how, mirror in MIRRORS:
        yield how, lambda _, v, mirror=mirror: mirror(v)
    yield _WRONG_SIGN, lambda _, v: -v
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
    closed = {s.name: r.stop_torques[s.name] for s in r.mechanism.stops if s.closed}
    right = _common(closed, given.stop_torques)
    exchanged = _exchange("torques of the ", right, given.stop_torques)
    if exchanged is not None:
        torques = {name: right[other] for name, other in exchanged[1].items()}
        yield Reading(exchanged[0], (replace(r, stop_torques={**r.stop_torques, **torques}),))


def _markers(r: Trajectory, given: Trajectory) -> Iterator[Reading]:
    """Markers under other names, taken for other points, or with velocities in a body's frame."""
    names = [name for name in r.markers if name in given.markers]
    right = {n: _stacked(r.markers[n]) for n in names}
    exchanged = _exchange("", right, {n: _stacked(given.markers[n]) for n in names})
    nearest = dict.fromkeys(names, "")
    if exchanged is not None:
        nearest = exchanged[1]
        yield Reading(exchanged[0], (_with(r, {n: r.markers[m] for n, m in nearest.items()}),))
    taken = {n: _nearest_points(r, n, given.markers[n]) for n in names}
    text = "; ".join(filter(None, (_taken_text(n, *labels) for n, (labels, _) in taken.items())))
    same = [_is_same(motion, r.markers.get(nearest[n])) for n, (_, motion) in taken.items()]
    if text and not all(same):  # else they are exchanged
        yield Reading(text, (_with(r, {n: motion for n, (_, motion) in taken.items()}),))
    bodies = {marker.name: marker.body for marker in r.mechanism.markers}
    velocities = {n: r.markers[n].velocity for n in names}
    local = {n: in_frame(r, bodies[n], v) for n, v in velocities.items()}
    turned = _nearer({n: given.markers[n].velocity for n in names}, velocities, local)
    if turned:
        wrong = _with(r, {n: replace(r.markers[n], velocity=local[n]) for n in turned})
        of = _subjects(turned, velocities, local) or " of the markers"
        yield Reading(f"velocities{of} in the frame of the body", (wrong,))


def _is_same(one: PointMotion, other: PointMotion | None) -> bool:
    if other is None:
        return False
    size = float(np.abs(_stacked(one)).max())
    return _apart(_stacked(one), _stacked(other)) < _ROUNDING * size


def _stacked(motion: PointMotion) -> FloatArray:
    return np.concatenate([motion.position, motion.velocity], axis=1)


def _nearest_points(
    r: Trajectory, name: str, given: PointMotion
) -> tuple[tuple[str, str], PointMotion]:
    """The known points that a marker's position and its velocity are nearest to, and their motion.

    The name of its own point is ''.
    """
    marker = r.mechanism.marker(name)
    assert marker is not None
    points = {"": r.markers[name]}
    for at, what in _known_points(r).items():
        if at != (marker.body, marker.point):
            points[what] = _at(r, *at)
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


def _orders(r: Trajectory, given: Trajectory) -> Iterator[Reading]:
    """Coordinates, or their speeds, in another order."""
    names = r.mechanism.coordinates
    texts: list[str] = []
    wrong: list[FloatArray] = []
    for right, recorded in ((r.q, given.q), (r.u, given.u)):
        columns = {name: right[:, i] for i, name in enumerate(names)}
        other = {name: recorded[:, i] for i, name in enumerate(names)}
        exchanged = _exchange("coordinates ", columns, other)
        order = list(names) if exchanged is None else list(exchanged[1].values())
        texts += [] if exchanged is None else [exchanged[0]]
        wrong.append(np.stack([columns[name] for name in order], axis=1))
    if texts:
        yield Reading(texts[0], (replace(r, q=wrong[0], u=wrong[1]),))


@dataclass(frozen=True)
class _Convention:
    """Coordinates and speeds by another convention, and the start by it."""

    how: str
    q: FloatArray
    u: FloatArray
    start: FloatArray

    def scaled(self, size: FloatArray, how: str) -> _Convention:
        """The same in other units, or with other signs."""
        named = ", ".join(filter(None, (self.how, how)))
        return _Convention(named, self.q * size, self.u * size, self.start * size)


def _conventions(r: Trajectory, given: Trajectory) -> Iterator[Reading]:
    """Angles relative to the parents', anticlockwise, in degrees, from another zero."""
    is_angle = np.arange(r.q.shape[1]) < len(r.mechanism.angles)
    signs, units = ((1, ""), (-1, "anticlockwise")), ((1, ""), (_DEGREES, "degrees"))
    for angles in _frames(r):
        for (sign, turned), (factor, unit) in product(signs, units):
            how = ", ".join(filter(None, (turned, unit)))
            # In other units alone, and of angles alone, it is a scale of all coordinates.
            if angles.how or not how or not is_angle.all():
                wrong = angles.scaled(np.where(is_angle, sign * factor, 1.0), how)
                yield from _by(r, given, wrong)


def _by(r: Trajectory, given: Trajectory, wrong: _Convention) -> Iterator[Reading]:
    """Coordinates and speeds, or the one that is nearer so, by a convention and its zeros."""
    zeros = _zeros(given.q - wrong.q, np.ptp(wrong.q, axis=0))
    misread = _apart(given.q, wrong.q + zeros) < _apart(given.q, r.q)
    fast = _apart(given.u, wrong.u) < _apart(given.u, r.u)
    if not (misread or fast):
        return
    taken = replace(r, q=wrong.q + zeros if misread else r.q, u=wrong.u if fast else r.u)
    if not wrong.how:
        yield Reading(f"coordinates {_zero_text(r, zeros, wrong)}", (taken,))
        return
    if misread and fast:
        what = "angles"
    else:
        what = "angles, not their speeds," if misread else "speeds of the angles"
    text = _zero_text(r, zeros, wrong) if misread and zeros.any() else ""
    yield Reading(" ".join(filter(None, (what, wrong.how, text))), (taken,))


def _zeros(difference: FloatArray, motion: FloatArray) -> FloatArray:
    """The constant that each coordinate differs by; 0 where it varies beside what it moves by."""
    middle = np.median(difference, axis=0)
    spread = np.abs(difference - middle).max(axis=0)
    least = _ROUNDING * np.abs(middle)
    steady = (spread <= least + _STEADY * np.minimum(np.abs(middle), motion)) & np.isfinite(spread)
    return np.where(steady, middle, 0.0)


def _zero_text(r: Trajectory, zeros: FloatArray, wrong: _Convention) -> str:
    if np.allclose(zeros, -wrong.start, rtol=_STEADY, atol=_STEADY * float(np.abs(zeros).max())):
        return "relative to the start"
    angle = "deg" if wrong.how.endswith("degrees") else "rad"
    units = [angle if i < len(r.mechanism.angles) else "m" for i in range(len(zeros))]
    shown = zip(r.mechanism.coordinates, zeros, units, strict=True)
    return f"from another zero ({', '.join(f'{n} {v:+.4g} {unit}' for n, v, unit in shown if v)})"


def _frames(r: Trajectory) -> Iterator[_Convention]:
    """Angles as they are, and relative to the parents', where those turn."""
    start = np.array(r.mechanism.start)
    yield _Convention("", r.q, r.u, start)
    joints = [joint for joint in r.mechanism.tree_joints if not joint.holds_angle]  # one an angle
    columns = [r.mechanism.attitudes[joint.parent][0] for joint in joints]
    relative = np.eye(len(start))
    for i, column in enumerate(columns):
        if column is not None:
            relative[i, column] -= 1.0
    if any(column is not None for column in columns):
        q, u = r.q @ relative.T, r.u @ relative.T
        yield _Convention("relative to the parent", q, u, relative @ start)
