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
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...models.arrays import FloatArray
from ...models.errors import SimulationError, UnsupportedProblemError
from ...models.joints import GROUND, AnyJoint
from ...models.launch import Launch, rest_opened
from ...models.mechanism import Mechanism
from ...models.problem import Problem, StopLaw
from ...models.spec import Vector
from ...models.stops import PointStop, Stop
from .cartesian import AppliedCartesian, BodyPoint, Components, angle_rows, right_angle, turned
from .constrained import ConstrainedMotion, integrate
from .quantities import PointState

_DEPENDENT = (
    1e-6  # of the largest singular value: constraints more nearly dependent follow from each other
)
_PROJECTIONS = 3  # Newton converges in one from the rounding of a step; the start may need another


class RedundantSystem:
    """A mechanism with three coordinates a body; states are y = (x, v), shape (6 n_bodies,).

    `x` runs body by body: centre x, centre y, angle. Constraint rows: held directions of the
    joints, in the mechanism's order (two for a pin, one for a slot), then the angles that joints
    hold, then the active stops.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism
        self.n = 3 * len(mechanism.bodies)
        self._index = {body.name: i for i, body in enumerate(mechanism.bodies)}
        masses = [(body.mass, body.mass, body.inertia) for body in mechanism.bodies]
        self._mass = np.diag(np.ravel(masses))
        self._applied = AppliedCartesian(mechanism)
        held = [
            (joint, direction) for joint in mechanism.joints for direction in joint.held_directions
        ]
        self._held = _components(mechanism, held)
        rigid = [joint for joint in mechanism.joints if joint.turned_by is not None]
        self._rigid = angle_rows(mechanism, [(joint.child, joint.parent) for joint in rigid])
        self._free = _components(
            mechanism, [(slide.joint, slide.direction) for slide in mechanism.slides]
        )
        self._turning = np.array([body.angle is not None for body in mechanism.bodies])
        self._walls = {stop.name: _distance(mechanism, stop) for stop in mechanism.point_stops}
        self._angle_rows = {stop.name: self._angle_row(stop) for stop in mechanism.angle_stops}
        self.stops = tuple(stop.name for stop in mechanism.stops if stop.closed)
        self._ranks: dict[tuple[str, ...], int] = {}
        self._start = self._placed()
        angles = (self._rigid @ self._start[: self.n]).tolist()
        # Of a joint that closes a loop the angle may be full turns apart.
        apart = [
            math.remainder(a - (joint.turned_by or 0.0), 2 * math.pi)
            for a, joint in zip(angles, rigid, strict=True)
        ]
        self._turned_by = np.array(angles) - np.array(apart)

    @property
    def start(self) -> FloatArray:
        """State at t = 0."""
        return self._start

    def _placed(self) -> FloatArray:
        """The state at t = 0, bodies placed from the ground outwards."""
        mechanism = self.mechanism
        q = dict(zip(mechanism.coordinates, mechanism.start, strict=True))
        u = dict(zip(mechanism.coordinates, mechanism.start_speeds or (0.0,) * len(q), strict=True))
        x, v = np.zeros(self.n), np.zeros(self.n)
        for joint in mechanism.tree_joints:
            i, name = 3 * self._index[joint.child], mechanism.body(joint.child).angle
            angle, spin = self._turn(x, joint.parent), self._turn(v, joint.parent)
            position, speed = self._point(x, v, joint.parent, joint.parent_point)
            for coordinate, free in zip(joint.slides, joint.free_directions, strict=True):
                along = turned(np.array(_vector(free)), angle)
                position = position + q[coordinate] * along
                speed = speed + u[coordinate] * along + q[coordinate] * spin * right_angle(along)
            x[i + 2] = q[name] if name is not None else angle + (joint.turned_by or 0.0)
            v[i + 2] = u[name] if name is not None else spin
            arm, turn = self._arm(x[i + 2], joint.child, joint.child_point)
            x[i : i + 2], v[i : i + 2] = position - arm, speed - v[i + 2] * turn
        return np.concatenate([x, v])

    def rates(self, y: FloatArray, active: tuple[str, ...]) -> FloatArray:
        """dy/dt under the joints and the active stops."""
        return np.concatenate([y[self.n :], self._solve(y, active)[: self.n]])

    def torques(self, y: FloatArray, active: tuple[str, ...]) -> FloatArray:
        """Torques of the active stops [N m], in their order."""
        return self._solve(y, active)[self.n + len(self._held) + len(self._rigid) :]

    def gap_accelerations(
        self, y: FloatArray, active: tuple[str, ...], of: tuple[str, ...]
    ) -> FloatArray:
        """Second derivatives of gaps [rad/s^2 or m/s^2] while `active` are active."""
        x, v, a = y[: self.n], y[self.n :], self._solve(y, active)[: self.n]
        gaps = (self._gap_derivatives(x, v, name) for name in of)
        return np.array([row[0] @ a - inward[0] for row, inward in gaps])

    def projected(self, y: FloatArray, active: tuple[str, ...]) -> FloatArray:
        """The nearest state, in the mass metric, that fulfils constraints and their rates to rounding."""
        x, v = y[: self.n].copy(), y[self.n :]
        nothing = np.zeros(self.n)
        for _ in range(_PROJECTIONS):
            error = np.concatenate([self.joint_errors(x), [self.gap(x, name) for name in active]])
            x += self._kkt(active, self._constraints(x, v, active)[0], nothing, -error)[: self.n]
            if np.abs(error).max(initial=0.0) < 1e-12:
                break
        jacobian = self._constraints(x, v, active)[0]
        return np.concatenate(
            [x, v + self._kkt(active, jacobian, nothing, -jacobian @ v)[: self.n]]
        )

    def joint_errors(self, x: FloatArray) -> FloatArray:
        """By how much each joint's rows are broken [m, rad]."""
        return np.concatenate([self._held.values(x), self._rigid @ x - self._turned_by])

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

    def point(
        self, y: FloatArray, a: FloatArray, body: str, point: Vector
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position [m], velocity [m/s] and acceleration [m/s^2] of a body's point, each (2,)."""
        x, v = y[: self.n], y[self.n :]
        position, speed = self._point(x, v, body, point)
        if body == GROUND:
            return position, speed, np.zeros(2)
        i = 3 * self._index[body]
        arm, turn = self._arm(x[i + 2], body, point)
        return position, speed, a[i : i + 2] + a[i + 2] * turn - v[i + 2] ** 2 * arm

    def energy(self, y: FloatArray) -> float:
        """Total energy, of gravity (zero at the world's origin) and springs [J]."""
        x, v = y[: self.n], y[self.n :]
        return float(v @ self._mass @ v) / 2 + self._applied.potential_energy(x)

    def reactions(self, y: FloatArray, active: tuple[str, ...]) -> dict[str, FloatArray]:
        """Force of each joint on its child, world frame [N], (2,): the multipliers themselves."""
        multipliers = self._solve(y, active)[self.n :]
        rows = multipliers[: len(self._held), None] * self._held.along(y[: self.n])
        ends = np.cumsum([len(joint.held_directions) for joint in self.mechanism.joints])
        parts = np.split(rows, ends[:-1])
        return {
            joint.name: part.sum(axis=0)
            for joint, part in zip(self.mechanism.joints, parts, strict=True)
        }

    def _angle_row(self, stop: Stop) -> FloatArray:
        row = np.zeros(self.n)
        for body, sign in ((stop.body, stop.sense), (stop.relative_to, -stop.sense)):
            if body != GROUND:
                row[3 * self._index[body] + 2] += sign
        return row

    def _gap_derivatives(
        self, x: FloatArray, v: FloatArray, name: str
    ) -> tuple[FloatArray, FloatArray]:
        """Gradient of a stop's gap (1, 3 n_bodies), and minus its gamma (1,)."""
        if name in self._angle_rows:
            return self._angle_rows[name][None], np.zeros(1)
        return self._walls[name].derivatives(x, v)

    def _turn(self, x: FloatArray, body: str) -> float:
        """Angle of a body or the ground [rad], or what stands in its place in x."""
        return 0.0 if body == GROUND else float(x[3 * self._index[body] + 2])

    def _arm(self, angle: float, body: str, point: Vector) -> tuple[FloatArray, FloatArray]:
        """A point's offset from its body's centre in the world, and its derivative by the angle."""
        arm = turned(np.subtract(point, self.mechanism.bodies[self._index[body]].centre), angle)
        return arm, right_angle(arm)

    def _point(
        self, x: FloatArray, v: FloatArray, body: str, point: Vector
    ) -> tuple[FloatArray, FloatArray]:
        if body == GROUND:
            return np.array(point), np.zeros(2)
        i = 3 * self._index[body]
        arm, turn = self._arm(x[i + 2], body, point)
        return x[i : i + 2] + arm, v[i : i + 2] + v[i + 2] * turn

    def _constraints(
        self, x: FloatArray, v: FloatArray, active: tuple[str, ...]
    ) -> tuple[FloatArray, FloatArray]:
        """G, and minus gamma."""
        held, inward = self._held.derivatives(x, v)
        stops = [self._gap_derivatives(x, v, name) for name in active]
        rows = np.vstack([held, self._rigid, *(row for row, _ in stops)])
        return rows, np.concatenate(
            [inward, np.zeros(len(self._rigid)), *(gamma for _, gamma in stops)]
        )

    def _kkt(
        self, active: tuple[str, ...], jacobian: FloatArray, forces: FloatArray, right: FloatArray
    ) -> FloatArray:
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
        try:
            return np.asarray(
                np.linalg.solve(matrix, np.concatenate([forces, right])), dtype=np.float64
            )
        except np.linalg.LinAlgError:
            name = self.mechanism.name
            raise SimulationError(
                f"{name!r} has no unique accelerations in a state it comes to."
            ) from None

    def _solve(self, y: FloatArray, active: tuple[str, ...]) -> FloatArray:
        """Accelerations, then multipliers."""
        x, v = y[: self.n], y[self.n :]
        jacobian, right = self._constraints(x, v, active)
        return self._kkt(active, jacobian, self._applied.generalized(x, v), right)


def _components(mechanism: Mechanism, of: list[tuple[AnyJoint, complex]]) -> Components:
    """Of the vectors from the parents' points to the children's; where all are held, in the world's directions."""
    ends = [
        ((joint.child, joint.child_point), (joint.parent, joint.parent_point)) for joint, _ in of
    ]
    turning = [bool(joint.free_directions) and joint.parent != GROUND for joint, _ in of]
    return Components(mechanism, ends, [direction for _, direction in of], turning)


def _distance(mechanism: Mechanism, stop: PointStop) -> Components:
    ends: tuple[BodyPoint, BodyPoint] = ((stop.body, stop.point), (stop.relative_to, (0.0, 0.0)))
    return Components(mechanism, [ends], [complex(*stop.normal)], [stop.relative_to != GROUND])


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
        marker_model = next(
            marker for marker in self.system.mechanism.markers if marker.name == name
        )
        return self.system.point(
            self.motion.state(t), self.accelerations(t), marker_model.body, marker_model.point
        )

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
