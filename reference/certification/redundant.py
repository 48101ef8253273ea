r"""The motion once more, in redundant coordinates: the independent formulation.

Every body has three coordinates of its own, its centre's x and y [m] and its angle [rad, positive clockwise]; joints,
tree or loop, and closed stops are constraints g(x) = 0 alike, solved in the index-1 form

    M a - G^T lam = Q,      G a = -gamma,      gamma = (dG/dt) v,

(Haug, *Computer Aided Kinematics and Dynamics of Mechanical Systems*, ch. 11). The multipliers *are* the joints'
forces on their children and the stops' torques. After each step the state is put back on g = 0 and G v = 0 by the
smallest move in the mass metric (coordinate projection, Eich 1993), so nothing drifts and no Baumgarte term acts.

Nothing here uses :mod:`...models.kinematics`, :mod:`..equations` or :mod:`..solver`: what the two formulations agree on
is not a shared mistake. Stops follow the release-once law.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...models.arrays import FloatArray
from ...models.errors import UnsupportedProblemError
from ...models.features import Feature, refuse_features
from ...models.joints import GROUND
from ...models.launch import Launch, rest_opened
from ...models.mechanism import Body, Mechanism, Slide
from ...models.problem import Problem, StopLaw
from ...models.spec import Vector
from ...models.stops import Stop
from .constrained import ConstrainedMotion, integrate
from .quantities import PointState

FEATURES: frozenset[Feature] = frozenset()
"""Elements that it has."""
_DEPENDENT = 1e-6  # of the largest singular value: constraints more nearly dependent follow from each other
_PROJECTIONS = 3  # Newton converges in one from the rounding of a step; the start may need another


class RedundantSystem:
    """A mechanism with three coordinates a body; states are y = (x, v), shape (6 n_bodies,).

    `x` runs body by body: centre x, centre y, angle. Constraint rows: joints in the mechanism's order (two for a
    pin, one for a slot), then the active stops.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        refuse_features(mechanism, FEATURES, "the redundant formulation")
        self.mechanism = mechanism
        self.n = 3 * len(mechanism.bodies)
        self._index = {body.name: i for i, body in enumerate(mechanism.bodies)}
        masses = [(body.mass, body.mass, body.inertia) for body in mechanism.bodies]
        self._mass = np.diag(np.ravel(masses))
        self._weight = np.ravel([(0.0, -body.mass * mechanism.gravity, 0.0) for body in mechanism.bodies])
        self._gather_joints()
        self._point_stops = {stop.name: stop for stop in mechanism.point_stops}
        self._angle_rows = {stop.name: self._angle_row(stop) for stop in mechanism.angle_stops}
        self.stops = tuple(stop.name for stop in mechanism.stops if stop.closed)
        self._ranks: dict[tuple[str, ...], int] = {}

    @property
    def start(self) -> FloatArray:
        """State at t = 0, bodies placed from the ground outwards."""
        mechanism = self.mechanism
        q = dict(zip(mechanism.coordinates, mechanism.start, strict=True))
        u = dict(zip(mechanism.coordinates, mechanism.start_speeds or (0.0,) * len(q), strict=True))
        x, v = np.zeros(self.n), np.zeros(self.n)
        for joint in mechanism.tree_joints:
            body, i = mechanism.body(joint.child), 3 * self._index[joint.child]
            x[i + 2], v[i + 2] = q[body.angle or ""], u[body.angle or ""]
            position, speed = self._point(x, v, joint.parent, joint.parent_point)
            for name, direction in zip(joint.slides, joint.free_directions, strict=True):
                position = position + q[name] * np.array(_vector(direction))
                speed = speed + u[name] * np.array(_vector(direction))
            arm, turn = self._arm(x[i + 2], body, joint.child_point)
            x[i : i + 2], v[i : i + 2] = position - arm, speed - v[i + 2] * turn
        return np.concatenate([x, v])

    def rates(self, y: FloatArray, active: tuple[str, ...]) -> FloatArray:
        """dy/dt under the joints and the active stops."""
        return np.concatenate([y[self.n :], self._solve(y, active)[: self.n]])

    def torques(self, y: FloatArray, active: tuple[str, ...]) -> FloatArray:
        """Torques of the active stops [N m], in their order."""
        return self._solve(y, active)[self.n + len(self._fixed) :]

    def gap_accelerations(self, y: FloatArray, active: tuple[str, ...], of: tuple[str, ...]) -> FloatArray:
        """Second derivatives of gaps [rad/s^2 or m/s^2] while `active` are active."""
        x, v, a = y[: self.n], y[self.n :], self._solve(y, active)[: self.n]
        return np.array([self._stop_row(x, name) @ a - self._inward(x, v, name) for name in of])

    def projected(self, y: FloatArray, active: tuple[str, ...]) -> FloatArray:
        """The nearest state, in the mass metric, that fulfils constraints and their rates to rounding."""
        x, v = y[: self.n].copy(), y[self.n :]
        nothing = np.zeros(self.n)
        for _ in range(_PROJECTIONS):
            error = np.concatenate([self.joint_errors(x), [self.gap(x, name) for name in active]])
            x += self._kkt(active, self._jacobian(x, active), nothing, -error)[: self.n]
            if np.abs(error).max(initial=0.0) < 1e-12:
                break
        jacobian = self._jacobian(x, active)
        return np.concatenate([x, v + self._kkt(active, jacobian, nothing, -jacobian @ v)[: self.n]])

    def joint_errors(self, x: FloatArray) -> FloatArray:
        """By how much each joint's rows are broken [m]."""
        arms, _ = self._arms(x)
        places = x[self._columns] + arms
        return self._fixed + self._gather @ np.sum(self._directions * places, axis=1)

    def gap(self, x: FloatArray, name: str) -> float:
        """Gap of a stop [rad, or m for one on a point]."""
        stop = self.mechanism.stop(name)
        return (
            stop.component(
                lambda body: float(x[3 * self._index[body] + 2]),
                lambda body, point: complex(*self._point(x, x, body, point)[0]),
            )
            - stop.position
        )

    def coordinates(self, x: FloatArray) -> FloatArray:
        """The mechanism's own coordinates q, shape (n_q,) [rad or m]."""
        slides = [self._slide(x, slide) for slide in self.mechanism.slides]
        return np.concatenate([x[2::3], slides])

    def speeds(self, y: FloatArray) -> FloatArray:
        """The mechanism's own speeds u, shape (n_q,)."""
        x, v = y[: self.n], y[self.n :]
        slides = [
            float(np.dot(_vector(s.direction), self._point(x, v, s.joint.child, s.joint.child_point)[1]))
            for s in self.mechanism.slides
        ]
        return np.concatenate([v[2::3], slides])

    def point(
        self, y: FloatArray, a: FloatArray, body: str, point: Vector
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position [m], velocity [m/s] and acceleration [m/s^2] of a body's point, each (2,)."""
        x, v, i = y[: self.n], y[self.n :], 3 * self._index[body]
        position, speed = self._point(x, v, body, point)
        arm, turn = self._arm(x[i + 2], self.mechanism.body(body), point)
        return position, speed, a[i : i + 2] + a[i + 2] * turn - v[i + 2] ** 2 * arm

    def energy(self, y: FloatArray) -> float:
        """Total energy [J], zero of potential at y = 0."""
        x, v = y[: self.n], y[self.n :]
        return float(v @ self._mass @ v) / 2 - float(self._weight @ x)

    def reactions(self, y: FloatArray, active: tuple[str, ...]) -> dict[str, FloatArray]:
        """Force of each joint on its child, world frame [N], (2,): the multipliers themselves."""
        multipliers = self._solve(y, active)[self.n :]
        forces: dict[str, FloatArray] = {}
        row = 0
        for joint in self.mechanism.joints:
            held = np.array([_vector(direction) for direction in joint.held_directions])
            forces[joint.name] = multipliers[row : row + len(held)] @ held
            row += len(held)
        return forces

    def _gather_joints(self) -> None:
        """Points that constraint rows are made of: a row gains direction . (centre + turned offset) of a body."""
        constants: list[float] = []
        anchors: list[tuple[int, int, Vector, Vector]] = []
        for joint in self.mechanism.joints:
            directions = [_vector(direction) for direction in joint.held_directions]
            ends = ((joint.child, joint.child_point, 1.0), (joint.parent, joint.parent_point, -1.0))
            for x, y in directions:
                constants.append(0.0)
                for body, (a, b), sign in ends:
                    if body == GROUND:
                        constants[-1] += sign * x * a + sign * y * b
                        continue
                    centre = self.mechanism.body(body).centre
                    offset = (a - centre[0], b - centre[1])
                    anchors.append((len(constants) - 1, self._index[body], (sign * x, sign * y), offset))
        self._fixed = np.array(constants)
        self._rows, bodies, self._directions, self._offsets = (np.array(part) for part in zip(*anchors, strict=True))
        self._columns = 3 * bodies[:, None] + np.array([0, 1])
        self._angles = 3 * bodies + 2
        self._gather = np.zeros((len(constants), len(bodies)))
        self._gather[self._rows, np.arange(len(bodies))] = 1.0
        self._straight = np.zeros((len(constants), self.n))
        np.add.at(self._straight, (self._rows[:, None], self._columns), self._directions)

    def _angle_row(self, stop: Stop) -> FloatArray:
        row = np.zeros(self.n)
        for body, sign in ((stop.body, stop.sense), (stop.relative_to, -stop.sense)):
            if body != GROUND:
                row[3 * self._index[body] + 2] += sign
        return row

    def _stop_row(self, x: FloatArray, name: str) -> FloatArray:
        """Gradient of a stop's gap, shape (3 n_bodies,)."""
        if name in self._angle_rows:
            return self._angle_rows[name]
        stop = self._point_stops[name]
        row = np.zeros(self.n)
        if stop.body != GROUND:
            i = 3 * self._index[stop.body]
            _, turn = self._arm(x[i + 2], self.mechanism.body(stop.body), stop.point)
            row[i : i + 3] = (*stop.normal, np.dot(stop.normal, turn))
        return row

    def _inward(self, x: FloatArray, v: FloatArray, name: str) -> float:
        """Minus gamma of a stop: the centripetal acceleration of its point towards where it may be."""
        stop = self._point_stops.get(name)
        if stop is None or stop.body == GROUND:
            return 0.0
        i = 3 * self._index[stop.body]
        arm, _ = self._arm(x[i + 2], self.mechanism.body(stop.body), stop.point)
        return float(np.dot(stop.normal, arm) * v[i + 2] ** 2)

    def _arms(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Offsets of the anchors in the world, and their derivatives by the angle, shape (n_anchors, 2)."""
        c, s = np.cos(x[self._angles]), np.sin(x[self._angles])
        a, b = self._offsets[:, 0], self._offsets[:, 1]
        along, up = a * c + b * s, b * c - a * s
        return np.stack([along, up], axis=1), np.stack([up, -along], axis=1)

    def _arm(self, angle: float, body: Body, point: Vector) -> tuple[FloatArray, FloatArray]:
        a, b = point[0] - body.centre[0], point[1] - body.centre[1]
        c, s = np.cos(angle), np.sin(angle)
        arm = np.array([a * c + b * s, b * c - a * s])
        return arm, np.array([arm[1], -arm[0]])

    def _point(self, x: FloatArray, v: FloatArray, body: str, point: Vector) -> tuple[FloatArray, FloatArray]:
        if body == GROUND:
            return np.array(point), np.zeros(2)
        i = 3 * self._index[body]
        arm, turn = self._arm(x[i + 2], self.mechanism.body(body), point)
        return x[i : i + 2] + arm, v[i : i + 2] + v[i + 2] * turn

    def _slide(self, x: FloatArray, slide: Slide) -> float:
        position, _ = self._point(x, x, slide.joint.child, slide.joint.child_point)
        return float(np.dot(_vector(slide.direction), position - np.array(slide.joint.parent_point)))

    def _jacobian(self, x: FloatArray, active: tuple[str, ...]) -> FloatArray:
        _, turns = self._arms(x)
        joints = self._straight.copy()
        np.add.at(joints, (self._rows, self._angles), np.sum(self._directions * turns, axis=1))
        return np.vstack([joints, *(self._stop_row(x, name) for name in active)])

    def _kkt(self, active: tuple[str, ...], jacobian: FloatArray, forces: FloatArray, right: FloatArray) -> FloatArray:
        """Accelerations and multipliers; of dependent constraints the multipliers of least norm."""
        if active not in self._ranks:
            self._ranks[active] = int(np.linalg.matrix_rank(jacobian, rtol=_DEPENDENT))
        rank = self._ranks[active]
        if rank == len(jacobian):
            return self._solved(jacobian, forces, right)
        independent = np.linalg.svd(jacobian)[0][:, :rank]
        solution = self._solved(independent.T @ jacobian, forces, independent.T @ right)
        return np.concatenate([solution[: self.n], independent @ solution[self.n :]])

    def _solved(self, jacobian: FloatArray, forces: FloatArray, right: FloatArray) -> FloatArray:
        n, m = self.n, len(jacobian)
        matrix = np.zeros((n + m, n + m))
        matrix[:n, :n], matrix[:n, n:], matrix[n:, :n] = self._mass, -jacobian.T, jacobian
        return np.asarray(np.linalg.solve(matrix, np.concatenate([forces, right])), dtype=np.float64)

    def _solve(self, y: FloatArray, active: tuple[str, ...]) -> FloatArray:
        """Accelerations, then multipliers."""
        x, v = y[: self.n], y[self.n :]
        arms, _ = self._arms(x)
        inward = np.sum(self._directions * arms, axis=1) * v[self._angles] ** 2  # minus gamma, anchor by anchor
        right = np.concatenate([self._gather @ inward, [self._inward(x, v, name) for name in active]])
        return self._kkt(active, self._jacobian(x, active), self._weight, right)


@dataclass(frozen=True)
class RedundantMotion:
    """A motion in redundant coordinates, read in the mechanism's own; times are single floats [s]."""

    system: RedundantSystem
    motion: ConstrainedMotion

    @property
    def release_times(self) -> Mapping[str, float | None]:
        """When each stop opened [s]; None if it did not, or was never closed."""
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
        """Of the redundant coordinates, shape (3 n_bodies,)."""
        return self.system.rates(self.motion.state(t), self.motion.active(t))[self.system.n :]

    def marker(self, name: str, t: float) -> PointState:
        """Position [m], velocity [m/s] and acceleration [m/s^2] of a marker, each (2,)."""
        marker_model = next(marker for marker in self.system.mechanism.markers if marker.name == name)
        return self.system.point(self.motion.state(t), self.accelerations(t), marker_model.body, marker_model.point)

    def stop_torques(self, t: float) -> dict[str, float]:
        """Torque of every stop [N m]; 0 where it is open."""
        return dict.fromkeys(self.release_times, 0.0) | self.motion.torques(t)

    def joint_reactions(self, t: float) -> dict[str, FloatArray]:
        """Force of each joint on its child, world frame [N], (2,)."""
        return self.system.reactions(self.motion.state(t), self.motion.active(t))

    def drift(self, t: float) -> float:
        """Largest error of a joint [m] or active gap [rad] on the dense output, before any projection."""
        x = self.motion.raw_state(t)[: self.system.n]
        gaps = [abs(self.system.gap(x, name)) for name in self.motion.active(t)]
        return max([float(np.abs(self.system.joint_errors(x)).max()), *gaps])

    @property
    def launch(self) -> Launch | None:
        """First fall of the projectile's velocity to 45 degrees after its body's stops have opened."""
        return self._launch

    @cached_property
    def _launch(self) -> Launch | None:
        mechanism = self.system.mechanism
        projectile = mechanism.marker("projectile")
        if projectile is None:
            return None
        after = rest_opened(mechanism, projectile.body, self.release_times)
        none = np.zeros(self.system.n)

        def velocity(y: FloatArray) -> FloatArray:
            return self.system.point(y, none, projectile.body, projectile.point)[1]

        return self.motion.first_launch(velocity, after)


def _vector(direction: complex) -> Vector:
    return direction.real, direction.imag


def solve_redundant(problem: Problem, tolerance: float = 3e-14) -> RedundantMotion:
    """Integrate a problem in redundant coordinates with SciPy's DOP853.

    Args:
        tolerance: local error bound of the integrator, relative and absolute.

    Raises:
        UnsupportedProblemError: the law of the stops is not release-once.
        SimulationError: the integrator's step size collapsed.
    """
    if problem.stop_law is not StopLaw.RELEASE_ONCE:
        raise UnsupportedProblemError("the redundant formulation follows the release-once law of a stop only.")
    system = RedundantSystem(problem.mechanism)
    return RedundantMotion(system, integrate(system, problem.duration, tolerance))
