"""Kane's equations of a planar mechanism by SymPy, moved by PyDy.

A scene is plain data. Bodies turn clockwise, about -z, by coordinates q and constants. A number of
a scene becomes a symbol, unless it is 0, 1 or -1. The child's point of every joint of the tree has
two auxiliary speeds along the world's axes: Kane's auxiliary equations give the force of the joint.
A loop is closed by constraints of position and speed, with dependent speeds.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import numpy as np
import sympy
from pydy.system import System
from scipy.integrate import DOP853, ODEintWarning, odeint
from scipy.linalg import qr
from sympy.physics import mechanics as me

RANK = (
    1e-9  # of the largest pivot of the constraints at the start: redundant ones have smaller ones
)


def dop853(
    rates: Callable[..., Any], x: Any, times: Any, args: Any = (), *, rtol: float, atol: float
) -> Any:
    """SciPy's DOP853 with the signature of `odeint`, in steps that end at the times [s]."""
    states = [np.asarray(x, dtype=float)]
    for start, end in zip(times[:-1], times[1:], strict=True):
        solver = DOP853(
            lambda t, x: rates(x, t, *args), start, states[-1], end, first_step=end - start,
            rtol=rtol, atol=atol,
        )  # fmt: skip
        while solver.status == "running":
            message = solver.step()
            if solver.status == "failed":
                raise RuntimeError(f"DOP853: {message}")
        states.append(solver.y)
    return np.array(states)


SOLVERS: dict[str, Callable[..., Any]] = {"odeint": odeint, "DOP853": dop853}


class Equations:
    """A scene in SymPy's frames, points, bodies and loads."""

    def __init__(self, scene: dict[str, Any]) -> None:
        n, self.scene = len(scene["start"]), scene
        self.q: list[Any] = list(me.dynamicsymbols(f"q:{n}"))
        self.u: list[Any] = list(me.dynamicsymbols(f"u:{n}"))
        self.constants: dict[Any, float] = {}
        self.world, origin = me.ReferenceFrame("N"), me.Point("O")
        origin.set_vel(self.world, 0)
        self.frames, self.origins = {"ground": self.world}, {"ground": origin}
        self.angles: dict[str, tuple[Any, Any]] = {"ground": (0, 0)}
        self.auxiliary: list[Any] = []
        self.bodies: list[Any] = []
        self.loads: list[Any] = []
        self.potential_energy: Any = 0
        self.gravity = self.vector("ground", scene["gravity"], "g")
        for body in scene["bodies"]:
            self._add_body(**body)
        for kind, *numbers in scene["loads"]:
            getattr(self, f"_add_{kind}")(*numbers)
        self.closures = [row for loop in scene["loops"] for row in self._closures(*loop)]

    def number(self, name: str, value: float) -> Any:
        """A symbol with this value."""
        if value in (0, 1, -1):
            return sympy.Integer(int(value))
        symbol = sympy.Symbol(re.sub(r"\W", "_", f"{name}_{len(self.constants)}"), real=True)
        self.constants[symbol] = float(value)
        return symbol

    def vector(self, body: str, value: Sequence[float], name: str) -> Any:
        """A vector of a body's frame."""
        x, y = (self.number(f"{name}_{axis}", each) for axis, each in zip("xy", value, strict=True))
        return x * self.frames[body].x + y * self.frames[body].y

    def point(self, body: str, place: Sequence[float], name: str) -> Any:
        """A point of a body."""
        point = self.origins[body].locatenew(name, self.vector(body, place, name))
        point.v2pt_theory(self.origins[body], self.world, self.frames[body])
        return point

    def place(self, point: Any) -> Any:
        """Vector from the world's origin."""
        return point.pos_from(self.origins["ground"])

    def _add_body(
        self, name: str, mass: float, inertia: float, centre: Any, turn: Any, joint: Any
    ) -> None:
        index, constant = turn
        angle, speed = (0, 0) if index is None else (self.q[index], self.u[index])
        angle += self.number(f"angle_{name}", constant)
        parent, parent_point, child_point, slides = joint
        at = self.point(parent, parent_point, f"joint_{name}")
        along, velocity = 0 * self.world.x, at.vel(self.world)
        for slide, direction in slides:
            axis = self.vector(parent, direction, f"axis_{name}")
            turning = self.frames[parent].ang_vel_in(self.world).cross(axis)
            along += self.q[slide] * axis
            velocity += self.u[slide] * axis + self.q[slide] * turning
        parting = me.dynamicsymbols(f"aux_x{len(self.bodies)} aux_y{len(self.bodies)}")
        self.auxiliary += parting
        velocity += parting[0] * self.world.x + parting[1] * self.world.y
        frame = me.ReferenceFrame(re.sub(r"\W", "_", name))
        frame.orient_axis(self.world, angle, -self.world.z)
        frame.set_ang_vel(self.world, -speed * self.world.z)
        self.frames[name], self.angles[name] = frame, (angle, speed)
        pin = at.locatenew(f"pin_{name}", along)
        pin.set_vel(self.world, velocity)
        origin = pin.locatenew(f"o_{name}", -self.vector(name, child_point, f"pin_{name}"))
        origin.v2pt_theory(pin, self.world, frame)
        self.origins[name] = origin
        middle, m = self.point(name, centre, f"centre_{name}"), self.number(f"m_{name}", mass)
        turned = me.inertia(frame, 0, 0, self.number(f"I_{name}", inertia))
        self.bodies.append(me.RigidBody(name, middle, frame, m, (turned, middle)))
        self.loads.append(me.Force(middle, m * self.gravity))
        self.potential_energy -= m * self.gravity.dot(self.place(middle))

    def _add_spring(
        self, name: str, one: Any, other: Any, stiffness: float, damping: float, rest: float
    ) -> None:
        ends = [self.point(*end, f"end_{name}") for end in (other, one)]
        k, c, rest = (
            self.number(f"{name}_{i}", v) for i, v in enumerate((stiffness, damping, rest))
        )
        pathway = me.LinearPathway(*ends)
        self.loads += me.LinearSpring(k, pathway, rest).to_loads()
        if damping:
            self.loads += me.LinearDamper(c, pathway).to_loads()
        self.potential_energy += k * (pathway.length - rest) ** 2 / 2

    def _law(self, name: str, along: Any, rate: Any, numbers: Sequence[float]) -> Any:
        """Constant, less a spring with a cubic term and a damper; notes the spring's energy."""
        constant, k, cubic, c, rest = (
            self.number(f"{name}_{i}", value) for i, value in enumerate(numbers)
        )
        self.potential_energy += k * (along - rest) ** 2 / 2 + cubic * (along - rest) ** 4 / 4
        return constant - k * (along - rest) - cubic * (along - rest) ** 3 - c * rate

    def _add_torque(self, name: str, body: str, other: str, *numbers: float) -> None:
        (angle, speed), (start, turning) = self.angles[body], self.angles[other]
        torque = self._law(name, angle - start, speed - turning, numbers) * self.world.z
        self.loads += [me.Torque(self.frames[body], -torque), me.Torque(self.frames[other], torque)]

    def _add_slide(
        self, name: str, one: Any, other: Any, slide: int, direction: Any, *numbers: float
    ) -> None:
        axis = self.vector(other[0], direction, f"axis_{name}")
        force = self._law(name, self.q[slide], self.u[slide], numbers) * axis
        for end, sign in ((one, 1), (other, -1)):
            self.loads.append(me.Force(self.point(*end, f"end_{name}"), sign * force))

    def _add_force(self, name: str, body: str, place: Any, force: Any) -> None:
        point = self.point(body, place, f"point_{name}")
        self.loads.append(me.Force(point, self.vector("ground", force, name)))

    def _closures(
        self, name: str, one: Any, other: Any, held: Any, in_world: bool, turned: float | None
    ) -> list[Any]:
        there, here = self.point(*other, f"there_{name}"), self.point(*one, f"here_{name}")
        between, frame = self.place(here) - self.place(there), "ground" if in_world else other[0]
        rows = [between.dot(self.vector(frame, axis, f"held_{name}")) for axis in held]
        if turned is not None:
            angle = self.angles[one[0]][0] - self.angles[other[0]][0]
            rows.append(angle - self.number(f"turned_{name}", turned))
        return rows

    # --- Equations

    def kanes_method(self, **dependent: Any) -> Any:
        """SymPy's KanesMethod with its equations formed."""
        options: dict[str, Any] = {"q_ind": self.q, "u_ind": self.u, **dependent}
        rates = [speed - place.diff() for place, speed in zip(self.q, self.u, strict=True)]
        kane = me.KanesMethod(self.world, kd_eqs=rates, u_auxiliary=self.auxiliary, **options)
        kane.kanes_equations(self.bodies, self.loads)
        return kane

    @cached_property
    def tree(self) -> Any:
        """KanesMethod without the loops."""
        return self.kanes_method()

    def function(self, values: Sequence[Any], *more: Sequence[Any]) -> Callable[..., Any]:
        """The values as a function of q, u and what more they depend on, to an array."""
        none = dict.fromkeys(self.auxiliary, 0)
        rates = {q.diff(): u for q, u in zip(self.q, self.u, strict=True)}
        plain = [me.msubs(sympy.sympify(value), rates, none) for value in values]
        names = [self.q, self.u, *more, list(self.constants)]
        compute, numbers = (
            sympy.lambdify(names, plain, "math", cse=True),
            [*self.constants.values()],
        )
        return lambda *state: np.array(compute(*(x.tolist() for x in state), numbers), dtype=float)

    def closed(self) -> Any:
        """KanesMethod with the loops: dependent speeds are those that the start determines best."""
        if not self.closures:
            return self.tree
        rates = {q.diff(): u for q, u in zip(self.q, self.u, strict=True)}
        rows = [me.msubs(row.diff(me.dynamicsymbols._t), rates) for row in self.closures]
        jacobian = self.function(list(sympy.Matrix(rows).jacobian(self.u)))
        at = jacobian(*map(np.array, (self.scene["start"], self.scene["start_speeds"])))
        _, pivots, columns = qr(at.reshape(len(rows), -1), pivoting=True)
        rank = int(np.sum(np.abs(np.diag(pivots)) > RANK * abs(pivots[0, 0])))
        kept = sorted(qr(at.reshape(len(rows), -1).T, pivoting=True)[2][:rank])
        free, bound = sorted(columns[rank:]), sorted(columns[:rank])
        return self.kanes_method(
            q_ind=[self.q[k] for k in free],
            u_ind=[self.u[k] for k in free],
            q_dependent=[self.q[k] for k in bound],
            u_dependent=[self.u[k] for k in bound],
            configuration_constraints=[self.closures[k] for k in kept],
            velocity_constraints=[rows[k] for k in kept],
        )

    def integrate(self, times: Any, integrator: str, tolerance: float) -> tuple[Any, Any]:
        """Coordinates and speeds at times [s], each of shape (n, n_q), by PyDy's System."""
        start = [*self.scene["start"], *self.scene["start_speeds"]]
        system = System(self.closed(), ode_solver=SOLVERS[integrator], times=times)
        system.constants = {name: self.constants[name] for name in system.constants_symbols}
        system.initial_conditions = dict(zip([*self.q, *self.u], start, strict=True))
        with warnings.catch_warnings():
            warnings.simplefilter("error", ODEintWarning)  # it gives zeros, and a warning
            x = system.integrate(rtol=tolerance, atol=tolerance)
        columns = [system.states.index(each) for each in (*self.q, *self.u)]
        return x[:, columns[: len(self.q)]], x[:, columns[len(self.q) :]]
