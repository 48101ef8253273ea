r"""The motion once more, in redundant coordinates: the independent formulation.

Every body has three coordinates of its own, its centre's x and y [m] and its angle [rad, positive
clockwise]; joints, tree or loop, and closed stops are constraints g(x) = 0 alike, solved in the
index-1 form

    M a - G^T lam = Q,      G a = -gamma,      gamma = (dG/dt) v,

(Haug, *Computer Aided Kinematics and Dynamics of Mechanical Systems*, ch. 11). The multipliers
*are* the joints' forces on their children and the stops' torques. After each step the state is put
back on g = 0 and G v = 0 by the smallest move in the mass metric (coordinate projection, Eich
1993), so nothing drifts and no Baumgarte term acts.

Nothing here uses :mod:`...models.kinematics`, :mod:`...models.applied_forces`, :mod:`..equations`
or :mod:`..solver`: what the two formulations agree on is not a shared mistake. Stops follow the
release-once law.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...models import elements
from ...models.arrays import FloatArray
from ...models.elements import GROUND, ElementTable
from ...models.errors import SimulationError, UnsupportedProblemError
from ...models.launch import Launch, rest_opened
from ...models.mechanism import Mechanism
from ...models.problem import Problem, StopLaw
from ...models.spec import Vector
from .constrained import ConstrainedMotion, PointState, integrate

# Of the largest singular value: constraints more nearly dependent follow from each other.
_DEPENDENT = 1e-6
_PROJECTIONS = 3  # Newton converges in one from the rounding of a step; the start may need another
BodyPoint = tuple[str, Vector]  # A body (or the ground) and a point in its frame [m]

_CLOCKWISE = np.array([1.0, -1.0])


def _right_angle(vectors: FloatArray) -> FloatArray:
    """Vectors (..., 2) turned by a right angle clockwise: the derivative of a clockwise turn."""
    return vectors[..., ::-1] * _CLOCKWISE


def _turned(vectors: FloatArray, angles: FloatArray | float) -> FloatArray:
    """Vectors (..., 2) turned clockwise by angles (...) [rad]."""
    return vectors * np.cos(angles)[..., None] + _right_angle(vectors) * np.sin(angles)[..., None]


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    products = a * b
    return products[..., 0] + products[..., 1]


@dataclass(frozen=True)
class _Ends:
    """Ends of m vectors, the leading one first: arrays (m, 2, 2), spins (m, 2)."""

    centres: FloatArray
    arms: FloatArray
    centre_speeds: FloatArray
    spins: FloatArray

    @property
    def vectors(self) -> FloatArray:
        """Shape (m, 2) [m]."""
        points = self.centres + self.arms
        return points[:, 0] - points[:, 1]

    @property
    def rates(self) -> FloatArray:
        """Rates of the vectors, shape (m, 2) [m/s]."""
        speeds = self.centre_speeds + self.spins[..., None] * _right_angle(self.arms)
        return speeds[:, 0] - speeds[:, 1]


class _Vectors:
    r"""Vectors to points of bodies from points of others.

    A state is x = (centre x, centre y, angle) body by body and its rate v, each of shape
    (3 n_bodies,). With the arm r of a point from its body's centre, turned clockwise by the angle,
    the vector from a point to another one is d = c_1 + r_1 - c_0 - r_0, and a function e . d of it
    has the derivatives

        d(e . d)/dt   = e . (v_1 + w_1 r_1' - v_0 - w_0 r_0')  [+ w_0 e' . d]
        d2(e . d)/dt2 = the same of accelerations  - e . (w_1^2 r_1 - w_0^2 r_0)
                        [+ 2 w_0 e' . dd/dt - w_0^2 e . d],

    where r' is r turned by a right angle clockwise; what stands in brackets is there if e turns
    with the second body.
    """

    def __init__(self, mechanism: Mechanism, ends: Sequence[tuple[BodyPoint, BodyPoint]]) -> None:
        self._n = 3 * len(mechanism.bodies)
        indices = {body.name: i for i, body in enumerate(mechanism.bodies)}
        indices[GROUND] = len(mechanism.bodies)
        centres = {body.name: body.centre for body in mechanism.bodies} | {GROUND: (0.0, 0.0)}
        bodies = np.array([[indices[body] for body, _ in pair] for pair in ends], dtype=int)
        offsets = [[np.subtract(point, centres[body]) for body, point in pair] for pair in ends]
        self._offsets = np.array(offsets, dtype=np.float64).reshape(-1, 2, 2)
        self._columns = 3 * bodies.reshape(-1, 2)[..., None] + np.arange(3)
        self._number = np.arange(len(ends))[:, None]

    def __len__(self) -> int:
        return len(self._columns)

    def ends(self, x: FloatArray, v: FloatArray) -> _Ends:
        states = np.zeros((2, self._n + 3))  # the ground is the last body
        states[0, : self._n], states[1, : self._n] = x, v
        at, moving = states[:, self._columns]
        arms = _turned(self._offsets, at[..., 2])
        return _Ends(at[..., :2], arms, moving[..., :2], moving[..., 2])

    def rows(self, ends: _Ends, along: FloatArray, turning: FloatArray | None = None) -> FloatArray:
        """Gradients of components along directions (m, 2), shape (m, 3 n_bodies).

        Some directions, or none, are turning with the second body, shape (m,).
        """
        rows = np.zeros((len(self), self._n + 3))
        moments = _dot(along[:, None], _right_angle(ends.arms))
        rows[self._number, self._columns[:, 0, :2]] = along
        rows[self._number[:, 0], self._columns[:, 0, 2]] = moments[:, 0]
        rows[self._number, self._columns[:, 1, :2]] -= along
        if turning is not None:
            moments[:, 1] -= np.where(turning, _dot(_right_angle(along), ends.vectors), 0.0)
        rows[self._number[:, 0], self._columns[:, 1, 2]] -= moments[:, 1]
        return rows[:, : self._n]


class _Components(_Vectors):
    """Components of vectors along directions of the ground, or of the body that they start from."""

    def __init__(
        self,
        mechanism: Mechanism,
        ends: Sequence[tuple[BodyPoint, BodyPoint]],
        directions: Sequence[complex],
        turning: Sequence[bool],
    ) -> None:
        super().__init__(mechanism, ends)
        pairs = [(direction.real, direction.imag) for direction in directions]
        self._directions = np.array(pairs, dtype=np.float64).reshape(-1, 2)
        self._turning = np.array(turning, dtype=bool) if any(turning) else None

    def along(self, x: FloatArray) -> FloatArray:
        """The directions in the world, shape (m, 2)."""
        if self._turning is None:
            return self._directions
        angles = np.append(x, np.zeros(3))[self._columns[:, 1, 2]]
        return _turned(self._directions, np.where(self._turning, angles, 0.0))

    def values(self, x: FloatArray) -> FloatArray:
        """Shape (m,) [m]."""
        ends = self.ends(x, x)
        projected = _dot(self.along(x)[:, None], ends.centres + ends.arms)
        return projected[:, 0] - projected[:, 1]

    def jacobian(self, x: FloatArray) -> FloatArray:
        """Shape (m, 3 n_bodies)."""
        return self.rows(self.ends(x, x), self.along(x), self._turning)

    def derivatives(self, x: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Jacobian, and minus the second derivatives without accelerations, (m,) [m/s^2]."""
        ends, along = self.ends(x, v), self.along(x)
        centripetal = _dot(along[:, None], ends.arms) * ends.spins**2
        inward = centripetal[:, 0] - centripetal[:, 1]
        if self._turning is not None:
            spin = np.where(self._turning, ends.spins[:, 1], 0.0)
            coriolis = 2 * spin * _dot(_right_angle(along), ends.rates)
            inward += spin**2 * _dot(along, ends.vectors) - coriolis
        return self.rows(ends, along, self._turning), inward


def _between_ends(
    mechanism: Mechanism, parts: Sequence[tuple[elements.AnyJoint, complex]]
) -> _Components:
    """Components of the vectors from the parents' points of joints to the children's."""
    ends = [
        ((joint.child, joint.child_point), (joint.parent, joint.parent_point)) for joint, _ in parts
    ]
    turning = [bool(j.free_directions) and j.parent != GROUND for j, _ in parts]
    return _Components(mechanism, ends, [direction for _, direction in parts], turning)


def _angle_rows(mechanism: Mechanism, pairs: Sequence[tuple[str, str]]) -> FloatArray:
    """Gradients of bodies' angles less those of others, shape (m, 3 n_bodies)."""
    index = {body.name: 3 * i + 2 for i, body in enumerate(mechanism.bodies)}
    rows = np.zeros((len(pairs), 3 * len(mechanism.bodies)))
    for row, (body, other) in zip(rows, pairs, strict=True):
        for name, sign in ((body, 1.0), (other, -1.0)):
            if name != GROUND:
                row[index[name]] += sign
    return rows


class _AngleGap:
    """Gap of a stop on an angle, linear in the bodies' angles."""

    def __init__(self, mechanism: Mechanism, stop: elements.Stop) -> None:
        self._row = stop.sense * _angle_rows(mechanism, [(stop.body, stop.relative_to)])

    def derivatives(self, x: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Its gradient (1, 3 n_bodies), and minus its gamma (1,)."""
        return self._row, np.zeros(1)


_GAPS: ElementTable[Callable[[Mechanism, Any], _AngleGap | _Components]] = ElementTable(
    "The redundant formulation",
    elements.STOPS,
    {
        elements.Stop: _AngleGap,
        elements.PointStop: lambda mechanism, stop: _Components(
            mechanism,
            [((stop.body, stop.point), (stop.relative_to, (0.0, 0.0)))],
            [complex(*stop.normal)],
            [stop.relative_to != GROUND],
        ),
    },
)
_HELD: ElementTable[Callable[[Any], tuple[complex, ...]]] = ElementTable(
    "The redundant formulation",
    elements.JOINTS,
    {
        elements.PinJoint: lambda joint: (1.0, 1j),
        elements.WeldJoint: lambda joint: (1.0, 1j),
        elements.SlotJoint: lambda joint: (1j * complex(*joint.axis),),
        elements.PrismaticJoint: lambda joint: (1j * complex(*joint.axis),),
        elements.FreeJoint: lambda joint: (),
        elements.TranslationJoint: lambda joint: (),
    },
)
"""Directions, in the parent's frame, in which each joint holds the child's point."""

_FORCES: ElementTable[str] = ElementTable(
    "The redundant formulation",
    elements.FORCE_ELEMENTS,
    {
        elements.SpringDamper: "springs",
        elements.RotationalSpringDamper: "twists",
        elements.CubicTorsionSpring: "cubics",
        elements.ConstantForce: "forces",
        elements.ConstantTorque: "motors",
        elements.RotorInertia: "rotors",
        elements.SlideSpringDamper: "slides",
        elements.SlideInertia: "slide inertias",
        elements.RecordedTorque: "recorded torques",
        elements.RecordedForce: "recorded forces",
    },
)

BUILT: frozenset[type] = frozenset(
    {*_HELD.handlers, *_GAPS.handlers, *_FORCES.handlers, elements.Coupler}
)
"""Classes of elements that the redundant formulation has."""


class _Couplers:
    """Couplers as functions of the bodies' angles and of slides, n of them."""

    def __init__(self, mechanism: Mechanism, free: _Components) -> None:
        couplers, self._free = mechanism.couplers, free
        of_angle = {b.angle: 3 * i + 2 for i, b in enumerate(mechanism.bodies) if b.angle}
        slides = [slide.coordinate for slide in mechanism.slides]
        self._angles = np.zeros((len(couplers), 3 * len(mechanism.bodies)))
        self._slides = np.zeros((len(couplers), len(slides)))
        for k, coupler in enumerate(couplers):
            terms = [(coupler.coordinate, 1.0), *((t.coordinate, -t.ratio) for t in coupler.terms)]
            for name, factor in terms:
                if name in of_angle:
                    self._angles[k, of_angle[name]] = factor
                else:
                    self._slides[k, slides.index(name)] = factor
        self._offsets = np.array([coupler.offset for coupler in couplers])

    def __len__(self) -> int:
        return len(self._offsets)

    def values(self, x: FloatArray) -> FloatArray:
        """Error of each one's coordinate, shape (n,) [rad or m]."""
        return self._angles @ x + self._slides @ self._free.values(x) - self._offsets

    def derivatives(self, x: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Jacobian (n, 3 n_bodies), and minus the second derivatives without accelerations (n,)."""
        rows, inward = self._free.derivatives(x, v)
        return self._angles + self._slides @ rows, self._slides @ inward


def _columns(rows: Sequence[tuple[float, ...]]) -> FloatArray:
    return np.array(rows, dtype=np.float64).reshape(-1, 3).T


def _held(record: Any, values: tuple[float, ...]) -> float:
    """The one value of a record.

    Raises:
        UnsupportedProblemError: there are several.
    """
    match values:
        case (value,):
            return value
        case _:
            raise UnsupportedProblemError(
                f"the redundant formulation cannot use {record.name!r} ({record.kind}): it changes "
                "over time."
            )


class _AppliedCartesian:
    """Weights and the forces of springs, dampers and motors on three coordinates a body.

    Nothing here calls a force element's own methods, on purpose.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self._any = bool(mechanism.force_elements)
        kinds: dict[str, list[Any]] = {kind: [] for kind in _FORCES.handlers.values()}
        for element in mechanism.force_elements:
            kinds[_FORCES[element]].append(element)
        gravity = mechanism.gravity_vector
        weights = [(*np.multiply(body.mass, gravity), 0.0) for body in mechanism.bodies]
        self._weight = np.ravel(weights)

        def angles(kind: str) -> FloatArray:
            return _angle_rows(mechanism, [(e.body, e.relative_to) for e in kinds[kind]])

        springs, forces = kinds["springs"], kinds["forces"]
        ends = [((e.body, e.point), (e.relative_to, e.relative_point)) for e in springs]
        self._springs = _Vectors(mechanism, ends)
        self._spring_data = _columns([(e.stiffness, e.damping, e.rest_length) for e in springs])
        self._twists, self._cubics = angles("twists"), angles("cubics")
        twists = [(e.stiffness, e.damping, e.rest_angle) for e in kinds["twists"]]
        cubics = [(e.stiffness, e.cubic_stiffness, e.rest_angle) for e in kinds["cubics"]]
        self._twist_data, self._cubic_data = _columns(twists), _columns(cubics)
        torques = [_held(e, e.torques) for e in kinds["recorded torques"]]
        self._torque = np.array([e.torque for e in kinds["motors"]]) @ angles("motors")
        self._torque += np.array(torques) @ angles("recorded torques")
        self._pulled = _Vectors(
            mechanism, [((e.body, e.point), (GROUND, (0.0, 0.0))) for e in forces]
        )
        self._pulls = np.array([e.force for e in forces], dtype=np.float64).reshape(-1, 2)
        sliding = [*kinds["slides"], *kinds["recorded forces"]]
        along = [mechanism.slide(e.coordinate) for e in sliding]
        self._slides = _between_ends(mechanism, [(s.joint, s.direction) for s in along])
        pushes = [(e.stiffness, e.damping, e.rest_position, e.force) for e in kinds["slides"]]
        pushes += [(0.0, 0.0, 0.0, _held(e, e.forces)) for e in kinds["recorded forces"]]
        self._slide_data = np.array(pushes, dtype=np.float64).reshape(-1, 4).T
        driven = [mechanism.slide(e.coordinate) for e in kinds["slide inertias"]]
        self._driven = _between_ends(mechanism, [(s.joint, s.direction) for s in driven])
        self._driven_by = np.array([e.inertia for e in kinds["slide inertias"]])
        rotors = angles("rotors")
        self.rotors = rotors.T @ (np.array([e.inertia for e in kinds["rotors"]])[:, None] * rotors)
        """Their part of the mass matrix, shape (3 n_bodies, 3 n_bodies)."""

    def generalized(self, x: FloatArray, v: FloatArray) -> FloatArray:
        """Forces and torques on all coordinates, shape (3 n_bodies,) [N, N m]."""
        if not self._any:
            return self._weight
        pulls = self._pulled.rows(self._pulled.ends(x, v), self._pulls).sum(axis=0)
        stiffness, damping, rest = self._twist_data
        torques = stiffness * (self._twists @ x - rest) + damping * (self._twists @ v)
        forces = self._weight + pulls + self._torque + -torques @ self._twists
        # A spring pulls both ends together; without a length it has no direction and no force.
        stiffness, damping, rest = self._spring_data
        ends = self._springs.ends(x, v)
        lengths = np.hypot(ends.vectors[:, 0], ends.vectors[:, 1])
        along = ends.vectors / np.where(lengths > 0, lengths, 1.0)[:, None]
        tension = stiffness * (lengths - rest) + damping * _dot(along, ends.rates)
        forces = forces + -tension @ self._springs.rows(ends, along)
        if len(self._cubics):
            linear, cubic, rest = self._cubic_data
            twist = self._cubics @ x - rest
            forces -= (linear * twist + cubic * twist**3) @ self._cubics
        if len(self._slides):
            stiffness, damping, rest, constant = self._slide_data
            rows = self._slides.jacobian(x)
            stretch = self._slides.values(x) - rest
            forces += (constant - stiffness * stretch - damping * (rows @ v)) @ rows
        return forces

    def drives(self, x: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Part of the mass matrix of inertias along slides, and forces without accelerations."""
        if not len(self._driven):
            return np.zeros((len(x), len(x))), np.zeros(len(x))
        rows, inward = self._driven.derivatives(x, v)
        weighted = self._driven_by[:, None] * rows
        return rows.T @ weighted, inward @ weighted

    def potential_energy(self, x: FloatArray) -> float:
        """Energy of gravity, zero at the world's origin, and of springs [J]."""
        energy = -float(self._weight @ x)
        if self._any:
            stiffness, _, rest = self._spring_data
            vectors = self._springs.ends(x, x).vectors
            energy += float(stiffness @ (np.hypot(vectors[:, 0], vectors[:, 1]) - rest) ** 2) / 2
            stiffness, _, rest = self._twist_data
            energy += float(stiffness @ (self._twists @ x - rest) ** 2) / 2
            linear, cubic, rest = self._cubic_data
            twist = self._cubics @ x - rest
            energy += float(linear @ twist**2) / 2 + float(cubic @ twist**4) / 4
            stiffness, _, rest, _ = self._slide_data
            energy += float(stiffness @ (self._slides.values(x) - rest) ** 2) / 2
        return energy


class RedundantSystem:
    """A mechanism with three coordinates a body; states are y = (x, v), shape (6 n_bodies,).

    `x` runs body by body: centre x, centre y, angle. Constraint rows: held directions of the
    joints, in the mechanism's order (two for a pin, one for a slot), then the angles that joints
    hold, then couplers, then the active stops.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism
        self.n = 3 * len(mechanism.bodies)
        self._index = {body.name: i for i, body in enumerate(mechanism.bodies)}
        masses = [(body.mass, body.mass, body.inertia) for body in mechanism.bodies]
        self._applied = _AppliedCartesian(mechanism)
        self._mass = np.diag(np.ravel(masses)) + self._applied.rotors

        held = [(j, along) for j in mechanism.joints for along in _HELD[j](j)]
        self._held = _between_ends(mechanism, held)
        free = [(slide.joint, slide.direction) for slide in mechanism.slides]
        self._free = _between_ends(mechanism, free)
        self._couplers = _Couplers(mechanism, self._free)
        rigid = [joint for joint in mechanism.joints if joint.turned_by is not None]
        self._rigid = _angle_rows(mechanism, [(joint.child, joint.parent) for joint in rigid])
        self._turning = np.array([body.angle is not None for body in mechanism.bodies])
        self._gaps = {stop.name: _GAPS[stop](mechanism, stop) for stop in mechanism.stops}
        self.stops = tuple(stop.name for stop in mechanism.stops if stop.closed)
        self._ranks: dict[tuple[str, ...], int] = {}
        self.start = self._start()
        angles = (self._rigid @ self.start[: self.n]).tolist()
        # Of a joint that closes a loop the angle may be full turns off.
        errors = [
            math.remainder(angle - (joint.turned_by or 0.0), 2 * math.pi)
            for angle, joint in zip(angles, rigid, strict=True)
        ]
        self._turned_by = np.array(angles) - np.array(errors)

    def _start(self) -> FloatArray:
        """The state at t = 0, bodies placed from the ground outwards."""
        mechanism = self.mechanism
        q = dict(zip(mechanism.coordinates, mechanism.start, strict=True))
        u = dict(zip(mechanism.coordinates, mechanism.start_speeds or (0.0,) * len(q), strict=True))
        x, v = np.zeros(self.n), np.zeros(self.n)
        for joint in mechanism.tree_joints:
            i, name = 3 * self._index[joint.child], mechanism.body(joint.child).angle
            angle = spin = 0.0
            if joint.parent != GROUND:
                parent = 3 * self._index[joint.parent] + 2
                angle, spin = float(x[parent]), float(v[parent])
            position, speed = self._point(x, v, joint.parent, joint.parent_point)
            for coordinate, free in zip(joint.slides, joint.free_directions, strict=True):
                along = _turned(np.array((free.real, free.imag)), angle)
                position = position + q[coordinate] * along
                speed = speed + u[coordinate] * along + q[coordinate] * spin * _right_angle(along)
            x[i + 2] = q[name] if name is not None else angle + (joint.turned_by or 0.0)
            v[i + 2] = u[name] if name is not None else spin
            arm, slope = self._arm(x[i + 2], joint.child, joint.child_point)
            x[i : i + 2], v[i : i + 2] = position - arm, speed - v[i + 2] * slope
        return np.concatenate([x, v])

    def rates(self, y: FloatArray, active: tuple[str, ...]) -> FloatArray:
        """dy/dt under the joints and the active stops."""
        return np.concatenate([y[self.n :], self._solve(y, active)[: self.n]])

    def torques(self, y: FloatArray, active: tuple[str, ...]) -> FloatArray:
        """Torques of the active stops [N m], in their order."""
        joints = len(self._held) + len(self._rigid) + len(self._couplers)
        return self._solve(y, active)[self.n + joints :]

    def gap_accelerations(
        self, y: FloatArray, active: tuple[str, ...], of: tuple[str, ...]
    ) -> FloatArray:
        """Second derivatives of gaps [rad/s^2 or m/s^2] while `active` are active."""
        x, v, a = y[: self.n], y[self.n :], self._solve(y, active)[: self.n]
        gaps = (self._gaps[name].derivatives(x, v) for name in of)
        return np.array([row[0] @ a - inward[0] for row, inward in gaps])

    def projected(self, y: FloatArray, active: tuple[str, ...]) -> FloatArray:
        """The nearest state, in the mass metric, that fulfils constraints and their rates."""
        x, v = y[: self.n].copy(), y[self.n :]
        no_forces = np.zeros(self.n)
        for _ in range(_PROJECTIONS):
            gaps = [self.gap(x, name) for name in active]
            error = np.concatenate([self.joint_errors(x), self._couplers.values(x), gaps])
            jacobian = self._constraints(x, v, active)[0]
            x += self._kkt(active, self._mass, jacobian, no_forces, -error)[: self.n]
            if np.abs(error).max(initial=0.0) < 1e-12:
                break
        jacobian = self._constraints(x, v, active)[0]
        v = v + self._kkt(active, self._mass, jacobian, no_forces, -jacobian @ v)[: self.n]
        return np.concatenate([x, v])

    def joint_errors(self, x: FloatArray) -> FloatArray:
        """Errors of the joints' constraints [m, rad]."""
        return np.concatenate([self._held.values(x), self._rigid @ x - self._turned_by])

    def gap(self, x: FloatArray, name: str) -> float:
        """Gap of a stop [rad, or m for one on a point]."""

        def angle(body: str) -> float:
            return float(x[3 * self._index[body] + 2])

        def point(body: str, local: Vector) -> complex:
            return complex(*self._point(x, x, body, local)[0])

        stop = self.mechanism.stop(name)
        return stop.component(angle, point) - stop.position

    def coordinates(self, x: FloatArray) -> FloatArray:
        """The mechanism's own coordinates q, shape (n_q,) [rad or m]."""
        return np.concatenate([x[2::3][self._turning], self._free.values(x)])

    def speeds(self, y: FloatArray) -> FloatArray:
        """The mechanism's own speeds u, shape (n_q,)."""
        x, v = y[: self.n], y[self.n :]
        return np.concatenate([v[2::3][self._turning], self._free.jacobian(x) @ v])

    def accelerations(self, y: FloatArray, active: tuple[str, ...]) -> FloatArray:
        """The mechanism's own accelerations under the joints and the active stops, shape (n_q,)."""
        x, v, a = y[: self.n], y[self.n :], self._solve(y, active)[: self.n]
        jacobian, inward = self._free.derivatives(x, v)
        return np.concatenate([a[2::3][self._turning], jacobian @ a - inward])

    def point(self, y: FloatArray, a: FloatArray, body: str, point: Vector) -> PointState:
        """Position [m], velocity [m/s] and acceleration [m/s^2] of a body's point, each (2,)."""
        x, v = y[: self.n], y[self.n :]
        position, speed = self._point(x, v, body, point)
        if body == GROUND:
            return position, speed, np.zeros(2)
        i = 3 * self._index[body]
        arm, slope = self._arm(x[i + 2], body, point)
        return position, speed, a[i : i + 2] + a[i + 2] * slope - v[i + 2] ** 2 * arm

    def energy(self, y: FloatArray) -> float:
        """Total energy, of gravity (zero at the world's origin) and springs [J]."""
        x, v = y[: self.n], y[self.n :]
        mass = self._mass + self._applied.drives(x, v)[0]
        return float(v @ mass @ v) / 2 + self._applied.potential_energy(x)

    def reactions(self, y: FloatArray, active: tuple[str, ...]) -> dict[str, FloatArray]:
        """Force of each joint on its child, world frame [N], (2,): the multipliers themselves."""
        multipliers = self._solve(y, active)[self.n :]
        rows = multipliers[: len(self._held), None] * self._held.along(y[: self.n])
        forces: dict[str, FloatArray] = {}
        for joint in self.mechanism.joints:
            n = len(_HELD[joint](joint))
            forces[joint.name], rows = rows[:n].sum(axis=0), rows[n:]
        return forces

    def _arm(self, angle: float, body: str, point: Vector) -> tuple[FloatArray, FloatArray]:
        """A point's offset from its body's centre in the world, and its derivative by the angle."""
        arm = _turned(np.subtract(point, self.mechanism.bodies[self._index[body]].centre), angle)
        return arm, _right_angle(arm)

    def _point(
        self, x: FloatArray, v: FloatArray, body: str, point: Vector
    ) -> tuple[FloatArray, FloatArray]:
        if body == GROUND:
            return np.array(point), np.zeros(2)
        i = 3 * self._index[body]
        arm, slope = self._arm(x[i + 2], body, point)
        return x[i : i + 2] + arm, v[i : i + 2] + v[i + 2] * slope

    def _constraints(
        self, x: FloatArray, v: FloatArray, active: tuple[str, ...]
    ) -> tuple[FloatArray, FloatArray]:
        """G, and minus gamma."""
        held, inward = self._held.derivatives(x, v)
        coupled, of_couplers = self._couplers.derivatives(x, v)
        rows = [held, self._rigid, coupled]
        right = [inward, np.zeros(len(self._rigid)), of_couplers]
        for name in active:
            row, gamma = self._gaps[name].derivatives(x, v)
            rows.append(row)
            right.append(gamma)
        return np.vstack(rows), np.concatenate(right)

    def _kkt(
        self,
        active: tuple[str, ...],
        mass: FloatArray,
        jacobian: FloatArray,
        forces: FloatArray,
        right: FloatArray,
    ) -> FloatArray:
        """Accelerations and multipliers; of dependent constraints the multipliers of least norm."""
        if active not in self._ranks:
            self._ranks[active] = int(np.linalg.matrix_rank(jacobian, rtol=_DEPENDENT))
        rank, independent = self._ranks[active], None
        if rank < len(jacobian):
            independent = np.linalg.svd(jacobian)[0][:, :rank]
            jacobian, right = independent.T @ jacobian, independent.T @ right
        n, m = self.n, len(jacobian)
        matrix = np.zeros((n + m, n + m))
        matrix[:n, :n], matrix[:n, n:], matrix[n:, :n] = mass, -jacobian.T, jacobian
        try:
            right = np.concatenate([forces, right])
            solution = np.asarray(np.linalg.solve(matrix, right), dtype=np.float64)
        except np.linalg.LinAlgError:
            raise SimulationError(
                f"{self.mechanism.name!r} has no unique accelerations in a state it comes to."
            ) from None
        if independent is None:
            return solution
        return np.concatenate([solution[:n], independent @ solution[n:]])

    def _solve(self, y: FloatArray, active: tuple[str, ...]) -> FloatArray:
        """Accelerations, then multipliers."""
        x, v = y[: self.n], y[self.n :]
        jacobian, right = self._constraints(x, v, active)
        inertia, inward = self._applied.drives(x, v)
        forces = self._applied.generalized(x, v) + inward
        return self._kkt(active, self._mass + inertia, jacobian, forces, right)


@dataclass(frozen=True)
class RedundantMotion:
    """A redundant motion, read in the mechanism's own coordinates at single times [s]."""

    system: RedundantSystem
    motion: ConstrainedMotion

    @property
    def release_times(self) -> Mapping[str, float | None]:
        """Times when the stops opened [s]; None if one did not, or was never closed."""
        stops = self.system.mechanism.stops
        return {stop.name: self.motion.release_times.get(stop.name) for stop in stops}

    def energy(self, t: float) -> float:
        """Total energy [J], zero of potential at y = 0."""
        return self.system.energy(self.motion.state(t))

    def state(self, t: float) -> tuple[FloatArray, FloatArray]:
        """Q and u of the mechanism at t, each of shape (n_q,) [rad, m, rad/s, m/s]."""
        y = self.motion.state(t)
        return self.system.coordinates(y[: self.system.n]), self.system.speeds(y)

    def accelerations(self, t: float) -> FloatArray:
        """Accelerations of the redundant coordinates, shape (3 n_bodies,)."""
        return self.system.rates(self.motion.state(t), self.motion.active(t))[self.system.n :]

    def marker(self, name: str, t: float) -> PointState:
        """Position [m], velocity [m/s] and acceleration [m/s^2] of a marker, each (2,)."""
        marker = next(m for m in self.system.mechanism.markers if m.name == name)
        y, a = self.motion.state(t), self.accelerations(t)
        return self.system.point(y, a, marker.body, marker.point)

    def stop_torques(self, t: float) -> dict[str, float]:
        """Torque of every stop [N m]; 0 where it is open."""
        return dict.fromkeys(self.release_times, 0.0) | self.motion.torques(t)

    def joint_reactions(self, t: float) -> dict[str, FloatArray]:
        """Force of each joint on its child, world frame [N], (2,)."""
        return self.system.reactions(self.motion.state(t), self.motion.active(t))

    def drift(self, t: float) -> float:
        """Largest error of a joint [m] or active gap [rad] before any projection."""
        x = self.motion.raw_state(t)[: self.system.n]
        gaps = [abs(self.system.gap(x, name)) for name in self.motion.active(t)]
        return max([float(np.abs(self.system.joint_errors(x)).max()), *gaps])

    @property
    def launch(self) -> Launch | None:
        """The launch at 45 degrees after the projectile's stops have opened."""
        system = self.system
        projectile = system.mechanism.marker("projectile")
        if projectile is None:
            return None
        after = rest_opened(system.mechanism, projectile.body, self.release_times)
        at_rest = np.zeros(system.n)

        def velocity(y: FloatArray) -> FloatArray:
            return system.point(y, at_rest, projectile.body, projectile.point)[1]

        return self.motion.first_launch(velocity, after)


def solve_redundant(problem: Problem, tolerance: float = 3e-14) -> RedundantMotion:
    """Integrate a problem in redundant coordinates with SciPy's DOP853.

    Args:
        tolerance: local error bound of the integrator, relative and absolute.

    Raises:
        UnsupportedProblemError: the law of the stops is not release-once.
        SimulationError: the integrator's step size collapsed, as it does at a singular position.
    """
    if problem.stop_law is not StopLaw.RELEASE_ONCE:
        raise UnsupportedProblemError(
            "the redundant formulation follows the release-once law of a stop only."
        )
    system = RedundantSystem(problem.mechanism)
    try:
        return RedundantMotion(system, integrate(system, problem.duration, tolerance))
    except SimulationError as error:
        raise SimulationError(
            f"in redundant coordinates, which pass no singular position, {error}"
        ) from None
