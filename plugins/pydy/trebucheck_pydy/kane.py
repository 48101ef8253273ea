"""Kane's equations of a planar mechanism by SymPy, moved by PyDy.

A scene is plain data, in joint coordinates: each body's slides, and its clockwise turn (about -z)
from its parent. The child's point of each joint has two auxiliary speeds along the world's axes, so
that Kane's auxiliary equations give the joint's force. A loop is closed by constraints of position
and speed with dependent speeds, those that the start determines best.
"""

from __future__ import annotations

import re
import warnings
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import sympy
from pydy.system import System
from scipy.integrate import DOP853, ODEintWarning, odeint
from scipy.linalg import qr
from sympy.physics import mechanics as me

RANK = 1e-9  # of the constraints' largest pivot at the start: redundant ones have smaller pivots


def dop853(rates: Any, x: Any, times: Any, args: Any = (), *, rtol: float, atol: float) -> Any:
    """SciPy's DOP853 with the signature of `odeint`, in steps that end at the times [s]."""
    states = [np.asarray(x, dtype=float)]
    for start, end in pairwise(times):
        options: Any = {"first_step": end - start, "rtol": rtol, "atol": atol}
        # PyDy writes all its results into one array, and SciPy keeps what it is given.
        solver = DOP853(
            lambda t, x: np.array(rates(x, t, *args)), start, states[-1], end, **options
        )
        while solver.status == "running":
            if message := solver.step():
                raise RuntimeError(f"DOP853: {message}")
        states.append(solver.y)
    return np.array(states)


class Equations:
    """A scene in SymPy's frames, points, bodies and loads."""

    def __init__(self, scene: dict[str, Any]) -> None:
        n, self.scene, self.auxiliary = len(scene["start"]), scene, list[Any]()
        self.q, self.u = (list(me.dynamicsymbols(f"{name}:{n}")) for name in "qu")
        self.rates = {q.diff(): u for q, u in zip(self.q, self.u, strict=True)}
        self.world, origin = me.ReferenceFrame("N"), me.Point("O")
        origin.set_vel(self.world, 0)
        self.frames, self.origins = {"ground": self.world}, {"ground": origin}
        self.angles: dict[str, tuple[Any, Any]] = {"ground": (0, 0)}
        self.constants: dict[Any, float] = {}  # PyDy 0.9.4's System fails where there are none
        self.bodies, self.loads, self.potential_energy = list[Any](), list[Any](), sympy.Integer(0)
        for body in scene["bodies"]:
            self._add_body(*body)
        for kind, numbers in scene["loads"]:
            getattr(self, f"_add_{kind}")(**numbers)
        self.closures = [row for loop in scene["loops"] for row in self._closures(*loop)]

    def vector(self, body: str, value: Any) -> Any:
        """A vector of a body's frame."""
        return sympy.Float(value[0]) * self.frames[body].x + value[1] * self.frames[body].y

    def point(self, body: str, place: Any) -> Any:
        """A point of a body."""
        point = self.origins[body].locatenew("P", self.vector(body, place))
        point.v2pt_theory(self.origins[body], self.world, self.frames[body])
        return point

    def _add_body(
        self, name: str, mass: float, inertia: float, centre: Any,
        parent: str, parent_point: Any, child_point: Any, slides: Any, turn: Any,
    ) -> None:  # fmt: skip
        at, (angle, speed) = self.point(parent, parent_point), self.angles[parent]
        along, velocity = 0 * self.world.x, at.vel(self.world)
        for k, direction in slides:
            axis = self.vector(parent, (direction.real, direction.imag))
            along += self.q[k] * axis
            velocity += self.u[k] * axis - self.q[k] * speed * self.world.z.cross(axis)
        coordinate, turned = turn
        if coordinate is not None:
            angle, speed = angle + self.q[coordinate], speed + self.u[coordinate]
        n = len(self.bodies)
        parting, (m, moment) = me.dynamicsymbols(f"x{n} y{n}"), sympy.symbols(f"m{n} I{n}")
        self.auxiliary += parting
        self.constants |= {m: mass, moment: inertia}
        frame = me.ReferenceFrame(re.sub(r"\W", "_", name))
        frame.orient_axis(self.world, angle + turned, -self.world.z)
        frame.set_ang_vel(self.world, -speed * self.world.z)
        self.frames[name], self.angles[name] = frame, (angle + turned, speed)
        pin = at.locatenew("P", along)
        pin.set_vel(self.world, velocity + parting[0] * self.world.x + parting[1] * self.world.y)
        self.origins[name] = pin.locatenew("O", -self.vector(name, child_point))
        self.origins[name].v2pt_theory(pin, self.world, frame)
        middle, gravity = self.point(name, centre), self.vector("ground", self.scene["gravity"])
        turning = (me.inertia(frame, 0, 0, moment), middle)
        self.bodies.append(me.RigidBody(name, middle, frame, m, turning))
        self.loads.append(me.Force(middle, m * gravity))
        self.potential_energy -= m * gravity.dot(middle.pos_from(self.origins["ground"]))

    def _add_spring(
        self, body: str, point: Any, relative_to: str, relative_point: Any,
        stiffness: float, damping: float, rest_length: float,
    ) -> None:  # fmt: skip
        ends = self.point(relative_to, relative_point), self.point(body, point)
        pathway = me.LinearPathway(*ends)
        self.loads += me.LinearSpring(stiffness, pathway, rest_length).to_loads()
        self.loads += me.LinearDamper(damping, pathway).to_loads() if damping else []
        self.potential_energy += stiffness * (pathway.length - rest_length) ** 2 / 2

    def _add_torque(
        self, body: str, relative_to: str, torque: float = 0, stiffness: float = 0,
        damping: float = 0, cubic_stiffness: float = 0, rest_angle: float = 0,
    ) -> None:  # fmt: skip
        ends = self.angles[body], self.angles[relative_to]
        bend, rate = (one - other for one, other in zip(*ends, strict=True))
        energy = stiffness * (bend - rest_angle) ** 2 / 2
        energy += cubic_stiffness * (bend - rest_angle) ** 4 / 4
        spring = stiffness * (bend - rest_angle) + cubic_stiffness * (bend - rest_angle) ** 3
        law, frames = (
            torque - spring - damping * rate,
            (self.frames[body], self.frames[relative_to]),
        )
        self.loads += me.TorqueActuator(law, -self.world.z, *frames).to_loads()
        self.potential_energy += energy

    def _add_force(self, body: str, point: Any, force: Any) -> None:
        self.loads.append(me.Force(self.point(body, point), self.vector("ground", force)))

    def _closures(self, one: Any, other: Any, frame: str, held: Any, turned: Any) -> list[Any]:
        between = self.point(*one).pos_from(self.point(*other))
        rows = [between.dot(self.vector(frame, (axis.real, axis.imag))) for axis in held]
        angle = self.angles[one[0]][0] - self.angles[other[0]][0]
        return rows if turned is None else [*rows, angle - turned]

    def kanes_method(self, **dependent: Any) -> Any:
        """SymPy's KanesMethod with its equations formed."""
        options: dict[str, Any] = {"q_ind": self.q, "u_ind": self.u, **dependent}
        kinematic = [speed - rate for rate, speed in self.rates.items()]
        kane = me.KanesMethod(self.world, kd_eqs=kinematic, u_auxiliary=self.auxiliary, **options)
        kane.kanes_equations(self.bodies, self.loads)
        return kane

    @cached_property
    def tree(self) -> Any:
        """KanesMethod without the loops."""
        return self.kanes_method()

    def function(self, values: Any, *more: Any) -> Any:
        """The values as a function of q, u and what more they depend on, to an array."""
        numbers = self.constants | dict.fromkeys(self.auxiliary, 0)
        plain = [me.msubs(sympy.sympify(value), self.rates, numbers) for value in values]
        compute = sympy.lambdify([self.q, self.u, *more], plain, "math", cse=True)
        return lambda *state: np.array(compute(*(x.tolist() for x in state)), dtype=float)

    def closed(self) -> Any:
        """KanesMethod with the loops, less their redundant constraints."""
        if not self.closures:
            return self.tree
        rows = [me.msubs(row.diff(me.dynamicsymbols._t), self.rates) for row in self.closures]
        start = (np.array(self.scene[key]) for key in ("start", "start_speeds"))
        jacobian = self.function(sympy.Matrix(rows).jacobian(self.u))(*start)
        jacobian = jacobian.reshape(len(rows), -1)
        _, pivots, columns = qr(jacobian, pivoting=True)
        rank = int(np.sum(np.abs(np.diag(pivots)) > RANK * abs(pivots[0, 0])))
        kept, bound = sorted(qr(jacobian.T, pivoting=True)[2][:rank]), sorted(columns[:rank])
        free = sorted(columns[rank:])
        return self.kanes_method(
            q_ind=[self.q[k] for k in free],
            u_ind=[self.u[k] for k in free],
            q_dependent=[self.q[k] for k in bound],
            u_dependent=[self.u[k] for k in bound],
            configuration_constraints=[self.closures[k] for k in kept],
            velocity_constraints=[rows[k] for k in kept],
        )

    def integrate(self, times: Any, integrator: str, tolerance: float) -> tuple[Any, Any]:
        """Joint coordinates and speeds at times [s], each of shape (n, n_q), by PyDy's System."""
        solver = {"odeint": odeint, "DOP853": dop853}[integrator]
        system = System(self.closed(), ode_solver=solver, times=times)
        system.constants = {each: self.constants[each] for each in system.constants_symbols}
        start, states = self.scene["start"] + self.scene["start_speeds"], [*self.q, *self.u]
        system.initial_conditions = dict(zip(states, start, strict=True))
        with warnings.catch_warnings():
            warnings.simplefilter("error", ODEintWarning)  # it goes on with what is no solution
            x = system.integrate(rtol=tolerance, atol=tolerance)
        return tuple(np.split(x[:, [system.states.index(each) for each in states]], 2, axis=1))
