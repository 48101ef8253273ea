"""The paper's own Lagrangian, Eqs. (1) to (10), derived once more: a third formulation.

Nothing here knows of `Mechanism`. SymPy (a test dependency) differentiates the Lagrangian as
printed; the result must agree with :mod:`..equations` at any state. The paper's angles are ours;
its multipliers relate to our stop torques by lambda_(G1) = -torque(sling rest) and lambda_(G2) =
+torque(hanger rest), because it writes G1 = theta - phi + phi_0, which is minus the sling's gap.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import sympy as sp

from ...models.arrays import FloatArray
from ...models.launch import Launch
from ...models.library.trebuchet import ARM_STOP, HANGER_REST, SLING_REST, TrebuchetParameters
from .constrained import ConstrainedMotion, PointState, integrate

# Signs by which the paper's multipliers become torques, and its constraints gaps: G1 is minus the
# sling's gap.
_SIGNS = {SLING_REST: -1.0, HANGER_REST: 1.0}
_GAPS = {SLING_REST: (-1.0, 1.0, 0.0), HANGER_REST: (1.0, 0.0, -1.0)}
_PARAMETERS = ("l1", "l2", "m_b", "m_cw", "m_a", "h", "r", "g")


@dataclass(frozen=True)
class PaperEquations:
    """The Euler-Lagrange equations of the paper's Eq. (1), fixed (Sec. II) or rolling (Sec. VI)."""

    rolling: bool

    def _energies(self, coordinates: list[Any], s: dict[str, Any]) -> tuple[Any, Any]:
        """T and U, Eqs. (2)-(5) fixed, Eqs. (3), (4), (8)-(10) rolling."""
        t = sp.Symbol("t")
        theta, phi, alpha = coordinates[:3]
        x_p = coordinates[3] if self.rolling else sp.Integer(0)
        x_b = x_p + s["l1"] * sp.cos(theta) + s["r"] * sp.cos(phi)  # (4a), (10a)
        y_b = -s["l1"] * sp.sin(theta) - s["r"] * sp.sin(phi)  # (4b)
        x_cw = x_p - s["l2"] * sp.cos(theta) + s["h"] * sp.cos(alpha)  # (4c), (10b)
        y_cw = s["l2"] * sp.sin(theta) - s["h"] * sp.sin(alpha)  # (4d)
        x_a = x_p + (s["l1"] - s["l2"]) / 2 * sp.cos(theta)  # (10c)
        y_a = -(s["l1"] - s["l2"]) / 2 * sp.sin(theta)  # (4e)

        def square(x: Any, y: Any) -> Any:
            return sp.diff(x, t) ** 2 + sp.diff(y, t) ** 2

        kinetic = s["m_b"] * square(x_b, y_b) + s["m_cw"] * square(x_cw, y_cw)
        if self.rolling:
            inertia = s["m_a"] * (s["l1"] + s["l2"]) ** 2 / 12  # (9)
            kinetic += s["m_a"] * square(x_a, y_a)  # (8)
        else:
            inertia = s["m_a"] * (s["l1"] ** 3 + s["l2"] ** 3) / (s["l1"] + s["l2"]) / 3  # (5)
        kinetic += inertia * sp.diff(theta, t) ** 2  # (2), (8)
        potential = s["g"] * (s["m_cw"] * y_cw + s["m_b"] * y_b + s["m_a"] * y_a)  # (3)
        return kinetic / 2, potential

    @cached_property
    def _functions(self) -> tuple[Callable[..., Any], Callable[..., Any]]:
        """M(q) and the forces f(q, u) of M a = f + (dG/dq)^T lambda, as NumPy functions."""
        t = sp.Symbol("t")
        names = ("theta", "phi", "alpha", "x_p") if self.rolling else ("theta", "phi", "alpha")
        q = [sp.Function(name)(t) for name in names]
        symbols: dict[str, Any] = {name: sp.Symbol(name, positive=True) for name in _PARAMETERS}
        kinetic, potential = self._energies(q, symbols)
        lagrangian = kinetic - potential  # (1), the constraint terms being linear in q
        u = [sp.diff(c, t) for c in q]
        plain_q, plain_u = sp.symbols(f"q0:{len(q)}"), sp.symbols(f"u0:{len(q)}")
        plain_a = sp.symbols(f"a0:{len(q)}")
        swap: dict[Any, Any] = dict(zip([sp.diff(v, t) for v in u], plain_a, strict=True))
        swap |= dict(zip(u, plain_u, strict=True)) | dict(zip(q, plain_q, strict=True))
        left: list[Any] = []
        for c, v in zip(q, u, strict=True):
            left.append(sp.diff(sp.diff(lagrangian, v), t) - sp.diff(lagrangian, c))
        residual = sp.Matrix([sp.sympify(expression).subs(swap) for expression in left])
        mass = residual.jacobian(list(plain_a))
        forces = -residual.subs(dict.fromkeys(plain_a, 0))
        arguments = [list(symbols.values()), list(plain_q), list(plain_u)]
        return sp.lambdify(arguments, mass, "numpy"), sp.lambdify(arguments, forces, "numpy")

    def solve(
        self,
        parameters: TrebuchetParameters,
        q: FloatArray,
        u: FloatArray,
        sling_active: bool,
        hanger_active: bool,
    ) -> tuple[FloatArray, FloatArray]:
        """Accelerations (n_q,), and multipliers of the active constraints, G1 (sling) first."""
        values = [getattr(parameters, name) for name in _PARAMETERS]
        mass, forces = (np.array(f(values, q, u), dtype=np.float64) for f in self._functions)
        g1, g2 = np.zeros(len(q)), np.zeros(len(q))
        g1[:2] = 1.0, -1.0  # (6): G1 = theta - phi + phi_0
        g2[[0, 2]] = 1.0, -1.0  # (7): G2 = theta - alpha + alpha_0
        active = [row for row, is_active in ((g1, sling_active), (g2, hanger_active)) if is_active]
        jacobian = np.array(active).reshape(len(active), len(q))
        kkt = np.block([[mass, -jacobian.T], [jacobian, np.zeros((len(active), len(active)))]])
        right = np.concatenate([forces.ravel(), np.zeros(len(active))])
        solution = np.asarray(np.linalg.solve(kkt, right), dtype=np.float64)
        return solution[: len(q)], solution[len(q) :]


class PaperSystem:
    """States y = (q, u) of the paper's machine; q = (theta, phi, alpha) and, rolling, x_p."""

    def __init__(self, parameters: TrebuchetParameters, equations: PaperEquations) -> None:
        self.parameters, self.equations = parameters, equations
        self.stops: tuple[str, ...] = (SLING_REST, HANGER_REST)  # in the order of their constraints
        angles = [parameters.theta0, parameters.phi0, parameters.alpha0]
        q = angles + [0.0] * equations.rolling
        self.start = np.array(q + [0.0] * len(q))  # at rest

    def rates(self, y: FloatArray, active: tuple[str, ...]) -> FloatArray:
        """dy/dt."""
        return np.concatenate([y[len(y) // 2 :], self._solve(y, active)[0]])

    def torques(self, y: FloatArray, active: tuple[str, ...]) -> FloatArray:
        """Torques of the active stops [N m], in their order."""
        in_order = [name for name in self.stops if name in active]
        torques = dict(zip(in_order, self._solve(y, active)[1], strict=True))
        return np.array([_SIGNS[name] * torques[name] for name in active])

    def gap_accelerations(
        self, y: FloatArray, active: tuple[str, ...], of: tuple[str, ...]
    ) -> FloatArray:
        """Second derivatives of gaps [rad/s^2]."""
        rows = np.array([_GAPS[name] for name in of]).reshape(len(of), 3)
        return rows @ self._solve(y, active)[0][:3]

    def projected(self, y: FloatArray, active: tuple[str, ...]) -> FloatArray:
        """The state itself: its linear constraints are kept to rounding."""
        return y

    def _solve(self, y: FloatArray, active: tuple[str, ...]) -> tuple[FloatArray, FloatArray]:
        q, u = np.split(y, 2)
        sling, hanger = SLING_REST in active, HANGER_REST in active
        return self.equations.solve(self.parameters, q, u, sling, hanger)


@dataclass(frozen=True)
class PaperMotion:
    """A motion by the paper's equations (:class:`.certify.Motion`)."""

    system: PaperSystem
    motion: ConstrainedMotion

    @property
    def release_times(self) -> Mapping[str, float | None]:
        """Times when the stops opened [s]."""
        return {**self.motion.release_times, ARM_STOP: None}

    def state(self, t: float) -> tuple[FloatArray, FloatArray]:
        """Q and u."""
        q, u = np.split(self.motion.state(t), 2)
        return q, u

    def stop_torques(self, t: float) -> Mapping[str, float]:
        """Torque of every stop [N m]."""
        return dict.fromkeys(self.release_times, 0.0) | self.motion.torques(t)

    def marker(self, name: str, t: float) -> PointState:
        """Position, velocity and acceleration by Eq. (4) or (10), each (2,)."""
        rates = self.system.rates(self.motion.state(t), self.motion.active(t))
        return self._point(name, self.motion.state(t), rates[len(rates) // 2 :])

    def energy(self, t: float) -> float:
        """T + U, Eqs. (2), (3), (8) [J], summed over the three masses."""
        p, y = self.system.parameters, self.motion.state(t)
        at_rest, speeds = np.zeros(len(y) // 2), y[len(y) // 2 :]
        total = p.m_a * (p.l1 + p.l2) ** 2 / 24 * speeds[0] ** 2  # (9), half of it
        for name, mass in (("projectile", p.m_b), ("counterweight", p.m_cw), ("arm centre", p.m_a)):
            position, velocity, _ = self._point(name, y, at_rest)
            total += mass * (velocity @ velocity / 2 + p.g * position[1])
        return float(total)

    @property
    def launch(self) -> Launch | None:
        """Velocity of the projectile at 45 degrees, after its rest has opened."""
        at_rest = np.zeros(len(self.system.start) // 2)

        def velocity(y: FloatArray) -> FloatArray:
            return self._point("projectile", y, at_rest)[1]

        return self.motion.first_launch(velocity, self.release_times[SLING_REST])

    def _point(self, name: str, y: FloatArray, a: FloatArray) -> PointState:
        """Eq. (4), (10): lengths along the arm and along sling or hanger, differentiated twice."""
        p, (q, u) = self.system.parameters, np.split(y, 2)
        lengths = {
            "projectile": (p.l1, p.r, 0.0),
            "counterweight": (-p.l2, 0.0, p.h),
            "arm centre": ((p.l1 - p.l2) / 2, 0.0, 0.0),
        }[name]
        position, velocity, acceleration = np.zeros(2), np.zeros(2), np.zeros(2)
        if self.system.equations.rolling:
            position[0], velocity[0], acceleration[0] = q[3], u[3], a[3]
        for i, length in enumerate(lengths):
            along = length * np.array([np.cos(q[i]), -np.sin(q[i])])
            across = length * np.array([-np.sin(q[i]), -np.cos(q[i])])
            position += along
            velocity += u[i] * across
            acceleration += a[i] * across - u[i] ** 2 * along
        return position, velocity, acceleration


def solve_paper(
    parameters: TrebuchetParameters, rolling: bool, duration: float, tolerance: float
) -> PaperMotion:
    """Integrate the paper's equations with DOP853, release-once."""
    system = PaperSystem(parameters, PaperEquations(rolling))
    return PaperMotion(system, integrate(system, duration, tolerance))
