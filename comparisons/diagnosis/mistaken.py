"""Mistakes of reading that not every joint, marker or coordinate need share: other names, frames, points and zeros.

Each of these readings takes for every subject that value of the reference, right or misread in one
way, which is nearer to the given one. None is fitted, so that what it accounts for is evidence.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from ...models.arrays import FloatArray
from ...models.joints import GROUND
from ...models.spec import Vector
from ...models.trajectory import PointMotion, Trajectory
from .readings import Reading

_STEADY = 0.01  # of an angle's largest difference: one that varies by more is no other zero
_ROUNDING = 1e-9  # of values that are the same
_DEGREES = 180 / math.pi

Values = Mapping[str, FloatArray]


def mistaken_readings(reference: Trajectory, given: Trajectory) -> Iterator[Reading]:
    """Readings of the reference, at the times of the given trajectory, as they are nearest to it."""
    yield from _forces(reference, given)
    yield from _torques(reference, given)
    yield from _markers(reference, given)
    yield from _coordinates(reference, given)


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
    taken = {n: _taken(r, n, given.markers[n]) for n in names}
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


def _taken(r: Trajectory, name: str, given: PointMotion) -> tuple[tuple[str, str], PointMotion]:
    """The known points that a marker's position and its velocity are nearest to, '' for its own; and their motion."""
    marker = r.mechanism.marker(name)
    assert marker is not None
    own = {"": r.markers[name]}
    known = {
        w: _at(r, *at) for at, w in _known_points(r).items() if at != (marker.body, marker.point)
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


def _at(r: Trajectory, body: str, point: Vector) -> PointMotion:
    row = r.kinematics.point(body, point)
    return PointMotion(r.kinematics.position(row, r.q), r.kinematics.velocity(row, r.q, r.u))


def _coordinates(r: Trajectory, given: Trajectory) -> Iterator[Reading]:
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
